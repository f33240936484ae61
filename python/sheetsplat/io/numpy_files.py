"""NumPy's .npy and .npz without pickles.

Samples are read here, because numpy.load allocates the memory that a header claims before it checks the file's size,
and reads no parts without a map of the file; in a child 64 MB would take 0.1 s in place of 0.01 s.
"""

from __future__ import annotations

import math
import re
import sys
import warnings
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from sheetsplat.errors import option_ref
from sheetsplat.io.channels import split
from sheetsplat.io.checks import checked_shape, printable, unreadable
from sheetsplat.io.names import tell_names
from sheetsplat.io.records import Volume
from sheetsplat.io.source import DEFLATE_RATIO, Payload, Source
from sheetsplat.quantity import Quantity

_Header = tuple[tuple[int, ...], bool, np.dtype[Any]]
# Bytes of a text beside arrays.
_LONGEST_TEXT = 1024
# Names of arrays that numpy.savez was given without one.
_NUMBERED = re.compile(r"arr_\d+")
# Places of an axis of channels, and of any axis beside it.
_MOST_CHANNELS, _LEAST = 4, 8


def _header(stream: IO[bytes]) -> _Header:
    """Read the shape, whether the first axis is the fastest, and the type."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        version = npy_format.read_magic(stream)
        # Version 3 differs from 2 only by the encoding of field names; arrays with fields are refused.
        if version == (1, 0):
            return npy_format.read_array_header_1_0(stream)
        if version in ((2, 0), (3, 0)):
            return npy_format.read_array_header_2_0(stream)
    raise ValueError(f"version {version} in place of 1, 2 or 3")


def _require_numbers(path: Path, what: str, dtype: np.dtype[Any]) -> None:
    if dtype.hasobject or dtype.kind not in "biuf":
        found = f"{what} of {'Python objects' if dtype.hasobject else dtype}"
        advice = "save it again as numbers" if dtype.hasobject else ""
        raise unreadable(path, found, "integers, booleans or real floating-point numbers", advice)


def _channel_axis(header: _Header) -> int | None:
    """Return which of four axes is that of channels: the first or the last, where it alone is short; None: neither."""
    shape = header[0]
    if len(shape) != 4 or min(shape[1:3]) < _LEAST:
        return None
    short = [axis for axis in (0, 3) if 2 <= shape[axis] <= _MOST_CHANNELS]
    return short[0] if len(short) == 1 and shape[3 - short[0]] >= _LEAST else None


def _are_colors(header: _Header) -> bool:
    """Return whether the last of four axes is that of red, green and blue, and if wanted opacity."""
    shape, _, dtype = header
    return _channel_axis(header) == 3 and shape[3] > 2 and dtype in (np.uint8, np.uint16)


def _sizes(source: Source, header: _Header, axes: int = 3) -> tuple[int, ...]:
    """Return the shape of a volume; InvalidInput for anything else."""
    shape, _, dtype = header
    _require_numbers(source.path, "an array", dtype)
    if len(shape) != axes:
        advice = "pass a part of it, numpy.load(path)[0], or a series to sheetsplat.animate" if len(shape) > 3 else ""
        raise unreadable(source.path, f"{len(shape)} axes, shape {tuple(shape)}", "three axes, values[k, j, i]", advice)
    return checked_shape(source.path, shape, "shape")


def _volume(source: Source, header: _Header, payload: Payload, file_format: str, axes: int = 3) -> Volume:
    _, first_fastest, dtype = header
    sizes = _sizes(source, header, axes)
    values = payload.array(dtype, math.prod(sizes))
    return Volume(values.reshape(sizes, order="F" if first_fastest else "C"), format=file_format)


def locate(source: Source) -> Volume:
    """Return what `read_npy` reads with `StoredSamples` as its values, for a file that is not packed."""
    header = _header(source.stream)
    _, first_fastest, dtype = header
    sizes = _sizes(source, header)
    flat = source.payload("raw").located(dtype, math.prod(sizes))
    samples: Any = flat.reshape(sizes[::-1]).transpose((2, 1, 0)) if first_fastest else flat.reshape(sizes)
    return Volume(samples, format="npy")


def read_npy(source: Source, name: str | None = None) -> list[Volume]:
    """Read the array of a .npy file; `name`: the channel, by number.

    Of four axes the first or the last is that of channels where it has 2 to 4 places and all others 8 and more. The
    last one of 3 or 4, of uint8 or uint16, is that of colours.
    """
    header = _header(source.stream)
    axis = _channel_axis(header)
    volume = _volume(source, header, source.payload("raw"), "npy", 3 if axis is None else 4)
    return split(source.path, volume, None if _are_colors(header) else axis, name=name)


def read_array(source: Source) -> NDArray[Any]:
    """Read the array of a .npy file, real numbers of any shape but ()."""
    shape, first_fastest, dtype = _header(source.stream)
    _require_numbers(source.path, "an array", dtype)
    values = source.payload("raw").array(dtype, math.prod(checked_shape(source.path, shape, "shape")))
    return values.reshape(shape, order="F" if first_fastest else "C")


def _payload(source: Source, entry: zipfile.ZipInfo, stream: IO[bytes]) -> Payload:
    return Payload(source, stream, min(entry.file_size, entry.compress_size * DEFLATE_RATIO + 64))


def read_npz(source: Source, name: str | None = None) -> Volume:
    """Read one array of a .npz file: `name`, else the only one with three axes."""
    with zipfile.ZipFile(source.stream) as archive:
        entries = {entry.filename.removesuffix(".npy"): entry for entry in archive.infolist()}
        if name is None:
            name = _only_volume(source, archive, entries)
        if name not in entries:
            raise unreadable(source.path, f"no array {name!r}", "one of: " + ", ".join(sorted(entries)))
        with archive.open(entries[name]) as stream:
            header = _header(stream)
            volume = _volume(source, header, _payload(source, entries[name], stream), "npz")
        # (Arrays that nobody named have numbers.)
        own = "" if _NUMBERED.fullmatch(name) else printable(name)
        return replace(volume, quantity=Quantity(name=own))


def read_arrays(source: Source, *, most: int) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Return the arrays of numbers of an .npz file, of any shape, and its single texts, each by its name.

    Raises InvalidInput for more than `most` entries and for anything pickled, OutOfMemory where they do not fit.
    """
    arrays: dict[str, NDArray[Any]] = {}
    texts: dict[str, str] = {}
    with zipfile.ZipFile(source.stream) as archive:
        entries = archive.infolist()
        if len(entries) > most:
            raise unreadable(source.path, f"{len(entries)} entries", f"at most {most}")
        for entry in entries:
            with archive.open(entry) as stream:
                shape, first_fastest, dtype = _header(stream)
                name = entry.filename.removesuffix(".npy")
                text = dtype.kind == "U" and shape == () and dtype.itemsize <= _LONGEST_TEXT
                if not text:
                    _require_numbers(source.path, f"an array {name!r}", dtype)
                # Empty arrays take no memory.
                sizes = tuple(shape) if 0 in shape else checked_shape(source.path, shape, f"shape of {name}")
                values = _payload(source, entry, stream).array(dtype, math.prod(sizes))
                if text:
                    texts[name] = _text(source, name, values)
                else:
                    arrays[name] = values.reshape(sizes, order="F" if first_fastest else "C")
    return arrays, texts


def _text(source: Source, name: str, values: NDArray[Any]) -> str:
    """Return the text of an array of one. NumPy makes strings that Python cannot read of numbers beyond Unicode."""
    order = {"<": "little", ">": "big"}.get(values.dtype.byteorder, sys.byteorder)
    try:
        return values.tobytes().decode("utf-32-le" if order == "little" else "utf-32-be").rstrip("\0")
    except UnicodeDecodeError:
        raise unreadable(source.path, f"numbers in the text {name!r} that are no characters", "Unicode") from None


def _only_volume(source: Source, archive: zipfile.ZipFile, entries: dict[str, zipfile.ZipInfo]) -> str:
    found = []
    for name, entry in entries.items():
        if entry.filename.endswith(".npy"):
            with archive.open(entry) as stream:
                if len(_header(stream)[0]) == 3:
                    found.append(name)
    names = tell_names(sorted(found))
    if len(names) != 1:
        raise unreadable(
            source.path,
            f"{len(names)} arrays with three axes" + (f": {', '.join(names)}" if names else ""),
            "one, or the name of one",
            "pass " + option_ref("name", "...") + " to choose one" if names else "",
            option="name" if names else None,
        )
    return names[0]
