"""NumPy's .npy and .npz. Pickles are refused.

NumPy reads the headers; the samples are read here, because numpy.load takes the memory that a header claims before it
looks at the size of the file.
"""

from __future__ import annotations

import math
import warnings
import zipfile
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from sheetsplat.errors import complain, option_ref
from sheetsplat.io.checks import checked_shape
from sheetsplat.io.records import Volume
from sheetsplat.io.source import DEFLATE_RATIO, Payload, Source

_Header = tuple[tuple[int, ...], bool, np.dtype[Any]]
# Bytes of a text beside arrays.
_LONGEST_TEXT = 1024


def _header(stream: IO[bytes]) -> _Header:
    """Return shape, whether the first axis is the fastest, and the type, and leave the stream at the first value."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        version = npy_format.read_magic(stream)
        # Version 3 differs from 2 by the encoding of field names alone, and arrays with fields are refused anyway.
        if version == (1, 0):
            return npy_format.read_array_header_1_0(stream)
        if version in ((2, 0), (3, 0)):
            return npy_format.read_array_header_2_0(stream)
    raise ValueError(f"version {version} in place of 1, 2 or 3")


def _check(source: Source, header: _Header) -> None:
    shape, _, dtype = header
    if dtype.hasobject or dtype.kind not in "biuf":
        raise complain(
            f"{source.path} cannot be read",
            f"an array of {'Python objects' if dtype.hasobject else dtype}",
            "integers, booleans or real floating-point numbers",
            "save it again as numbers" if dtype.hasobject else "",
        )
    if len(shape) != 3:
        raise complain(
            f"{source.path} cannot be read", f"{len(shape)} axes, shape {tuple(shape)}", "three axes, values[k, j, i]"
        )


def _array(source: Source, header: _Header, payload: Payload, file_format: str) -> Volume:
    _check(source, header)
    shape, first_fastest, dtype = header
    sizes = checked_shape(source.path, shape, "shape")
    values = payload.array(dtype, math.prod(sizes))
    return Volume(values.reshape(sizes, order="F" if first_fastest else "C"), format=file_format)


def read_npy(source: Source) -> Volume:
    """Read the array of a .npy file."""
    header = _header(source.stream)
    return _array(source, header, source.payload("raw"), "npy")


def _payload(source: Source, entry: zipfile.ZipInfo, stream: IO[bytes]) -> Payload:
    bound = min(entry.file_size, entry.compress_size * DEFLATE_RATIO + 64)
    return Payload(source, stream, bound, exact=False)


def read_npz(source: Source, name: str | None = None) -> Volume:
    """Read one array of a .npz file: `name`, else the only one with three axes."""
    with zipfile.ZipFile(source.stream) as archive:
        entries = {entry.filename.removesuffix(".npy"): entry for entry in archive.infolist()}
        if name is None:
            name = _only_volume(source, archive, entries)
        if name not in entries:
            raise complain(
                f"{source.path} cannot be read", f"no array {name!r}", "one of: " + ", ".join(sorted(entries)), ""
            )
        entry = entries[name]
        with archive.open(entry) as stream:
            header = _header(stream)
            return _array(source, header, _payload(source, entry, stream), "npz")


def read_arrays(source: Source, *, most: int) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Return the arrays of numbers of an .npz file, of any shape, and its single texts, each by its name.

    Raises InvalidInput for more than `most` entries and for anything pickled, OutOfMemory where they do not fit.
    """
    arrays: dict[str, NDArray[Any]] = {}
    texts: dict[str, str] = {}
    source.seek(0)
    with zipfile.ZipFile(source.stream) as archive:
        entries = archive.infolist()
        if len(entries) > most:
            raise complain(f"{source.path} cannot be read", f"{len(entries)} entries", f"at most {most}")
        for entry in entries:
            with archive.open(entry) as stream:
                shape, first_fastest, dtype = _header(stream)
                name = entry.filename.removesuffix(".npy")
                text = dtype.kind == "U" and shape == () and dtype.itemsize <= _LONGEST_TEXT
                if not text and (dtype.hasobject or dtype.kind not in "biuf"):
                    raise complain(
                        f"{source.path} cannot be read",
                        f"an array {name!r} of {'Python objects' if dtype.hasobject else dtype}",
                        "integers, booleans or real floating-point numbers",
                    )
                # Empty arrays take no memory.
                sizes = tuple(shape) if 0 in shape else checked_shape(source.path, shape, f"shape of {name}")
                values = _payload(source, entry, stream).array(dtype, math.prod(sizes))
                if text:
                    texts[name] = str(values[0])
                else:
                    arrays[name] = values.reshape(sizes, order="F" if first_fastest else "C")
    return arrays, texts


def _only_volume(source: Source, archive: zipfile.ZipFile, entries: dict[str, zipfile.ZipInfo]) -> str:
    found = []
    for name, entry in entries.items():
        if entry.filename.endswith(".npy"):
            with archive.open(entry) as stream:
                if len(_header(stream)[0]) == 3:
                    found.append(name)
    if len(found) != 1:
        raise complain(
            f"{source.path} cannot be read",
            f"{len(found)} arrays with three axes" + (f": {', '.join(sorted(found))}" if found else ""),
            "one, or the name of one",
            "pass " + option_ref("name", "...") + " to choose one" if found else "",
            option="name" if found else None,
        )
    return found[0]
