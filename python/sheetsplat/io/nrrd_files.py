"""NRRD files, attached and detached.

The header is read by pynrrd; samples are read here, also in parts: pynrrd decompresses without a bound, and read 6 of
240 damaged files that are refused here. In a child 64 MB would take 0.1 s in place of 0.01 s.
"""

from __future__ import annotations

import io
import math
import re
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import shown, triple
from sheetsplat.io.axes import in_body
from sheetsplat.io.channels import label_colors, split
from sheetsplat.io.checks import beside, checked_shape, floats, natural, sides, unreadable
from sheetsplat.io.records import Floats, Volume
from sheetsplat.io.source import MOST_SKIPPED, Source
from sheetsplat.labels import LabelColors

_HEADER_LIMIT = 1 << 20
_LONGEST_UNIT = 32
# Characters of ascii samples that are read at once, and the most of one number.
_PIECE, _LONGEST_WORD = 1 << 18, 1024
# Lines before the samples: more than any header of another program has.
_MOST_LINES = 1_000_000
# Fields that become details of the volume.
_TOLD: tuple[str, ...] = ("content", "space", "encoding")
# Fields with an entry for each axis.
_OF_AXES = (
    *("sizes", "space directions", "spacings", "axis mins", "axismins", "axis maxs", "axismaxs", "thicknesses"),
    *("centers", "centerings", "units", "kinds", "labels"),
)
# What a segmentation of 3D Slicer states of each segment.
_LABEL = re.compile(r"Segment(\d{1,6})_LabelValue")
_SEGMENT = ("LabelValue", "Layer", "Name", "Color")
_ENCODINGS = {
    "raw": "raw",
    **dict.fromkeys(("gzip", "gz"), "gzip"),
    **dict.fromkeys(("bzip2", "bz2"), "bzip2"),
    **dict.fromkeys(("ascii", "text", "txt"), "text"),
}
_TYPES = {
    "int8": ("signed char", "int8", "int8_t"),
    "uint8": ("uchar", "unsigned char", "uint8", "uint8_t"),
    "int16": ("short", "short int", "signed short", "signed short int", "int16", "int16_t"),
    "uint16": ("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"),
    "int32": ("int", "signed int", "int32", "int32_t"),
    "uint32": ("uint", "unsigned int", "uint32", "uint32_t"),
    "int64": ("longlong", "long long", "long long int", "signed long long", "signed long long int", "int64", "int64_t"),
    "uint64": ("ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"),
    "float32": ("float",),
    "float64": ("double",),
}
_TYPE_OF = {name: dtype for dtype, names in _TYPES.items() for name in names}


def _header(source: Source) -> tuple[dict[str, Any], int]:
    """Return the header's fields and its length in bytes."""
    import nrrd  # type: ignore[import-untyped]

    lines: list[bytes] = []
    # The header ends with an empty line, a detached one also with the file.
    for line in io.BytesIO(source.head(_HEADER_LIMIT)):
        lines.append(line)
        if not line.strip():
            break
        if line.startswith(b"sizes:") and not re.fullmatch(rb"sizes:[0-9\s]*", line):
            found = f"a damaged NRRD header ({shown(line.decode('latin-1').strip())})"
            raise unreadable(source.path, found, "sizes that are positive whole numbers")
    length = sum(map(len, lines))
    if length == _HEADER_LIMIT and lines[-1].strip():
        raise unreadable(source.path, f"no end of the header in the first {_HEADER_LIMIT} bytes", "an NRRD header")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return dict(nrrd.read_header(lines)), length


def _field(header: dict[str, Any], *names: str) -> Any:
    return next((header[name] for name in names if name in header), None)


def _dtype(path: Path, header: dict[str, Any], encoding: str) -> np.dtype[Any]:
    name = str(_field(header, "type"))
    if name not in _TYPE_OF:
        raise unreadable(path, f"samples of type {name!r}", "one of: " + ", ".join(_TYPES))
    dtype = np.dtype(_TYPE_OF[name])
    if dtype.itemsize == 1 or encoding == "text":
        return dtype
    endian = str(_field(header, "endian")).lower()
    if endian not in ("little", "big"):
        raise unreadable(path, f"endian {endian!r}", '"little" or "big"')
    return dtype.newbyteorder("<" if endian == "little" else ">")


def _numbers(path: Path, header: dict[str, Any], *names: str) -> Floats:
    """Return a number of a header for each axis; NaN, which is not known in this format, where there are none."""
    told = _field(header, *names)
    numbers = np.full(3, np.nan) if told is None else np.asarray(told, dtype=np.float64)
    if numbers.shape != (3,) or np.any(np.isinf(numbers)):
        raise unreadable(path, f"{names[0]} {shown(numbers.tolist())}", "three numbers")
    return numbers


def _place(path: Path, header: dict[str, Any], sizes: tuple[int, ...]) -> dict[str, Any]:
    """Return the fields of a volume that say where its samples lie."""
    directions, start = header.get("space directions"), header.get("space origin")
    origin = np.array(floats(path, "space origin", (0, 0, 0) if start is None else start, 3))
    if directions is not None:
        rows = [np.full(3, np.nan) if row is None else np.asarray(row, dtype=np.float64) for row in directions]
        if any(row.shape != (3,) for row in rows):
            raise unreadable(path, f"space directions {shown(directions)}", "three directions of three numbers")
        return {"axes": np.stack(rows), "origin": triple("origin", origin)}
    spacing = _numbers(path, header, "spacings")
    if np.any(spacing == 0):
        raise unreadable(path, f"spacings {shown(spacing.tolist())}", "three numbers other than 0")
    # Without an origin in space the ends of the axes place the samples: those of cells lie half a step inside.
    lower, upper = (_numbers(path, header, name, name.replace(" ", "")) for name in ("axis mins", "axis maxs"))
    told = _field(header, "centers", "centerings") or ()
    centers = told.split() if isinstance(told, str) else told
    inside = np.array([0.0 if str(one).lower() == "node" else 0.5 for one in (*centers, *("cell",) * 3)[:3]])
    between = (upper - lower) / (np.array(sizes) - 1.0 + 2.0 * inside)
    spacing = np.where(np.isnan(spacing), np.where(np.isnan(between) | (between == 0), 1.0, between), spacing)
    spacing = np.abs(spacing)
    if start is None:
        origin = np.where(
            np.isnan(lower), 0.0, np.fmin(lower, np.where(np.isnan(upper), lower, upper)) + inside * spacing
        )
    return {"spacing": triple("spacing", spacing), "origin": triple("origin", origin)}


def _sides(header: dict[str, Any]) -> tuple[str, ...]:
    """Return the sides of a body that the axes of the header's space run to, () where it is not that of a body.

    Scanner axes, right-handed axes, and names that are not of this format are no sides.
    """
    words = str(header.get("space", "")).lower().split("-")
    if len(words) == 1 and words[0][3:] in ("", "t"):
        # "RAS" and "LPST" stand for the words that they are made of.
        words = [*words[0][:3], *("time" for _ in words[0][3:])]
    if header.get("space directions") is None or len(words) < 3 or words[3:] not in ([], ["time"]):
        return ()
    return tuple(words[:3])


def _read_samples(source: Source, header: dict[str, Any], sizes: tuple[int, ...], start: int, *, located: bool) -> Any:
    encoding = _ENCODINGS.get(str(header["encoding"]).lower())
    if encoding is None:
        found = f"encoding {shown(header['encoding'])}"
        raise unreadable(source.path, found, "raw, gzip, bzip2 or ascii", "convert it with: unu save -e gzip")
    dtype = _dtype(source.path, header, encoding)
    count = math.prod(sizes)
    line_skip = _field(header, "line skip", "lineskip") or 0
    byte_skip = _field(header, "byte skip", "byteskip") or 0
    if line_skip < 0 or byte_skip < -1:
        raise unreadable(source.path, f"line skip {line_skip}, byte skip {byte_skip}", "numbers that are not negative")
    if line_skip > _MOST_LINES:
        raise unreadable(source.path, f"line skip {line_skip}", f"at most {_MOST_LINES} lines before the samples")
    source.stream.seek(start)
    skipped = 0
    for _ in range(line_skip):
        line = source.stream.readline(_HEADER_LIMIT)
        skipped += len(line)
        if not line or skipped > MOST_SKIPPED:
            found = f"{skipped} bytes of lines that the header skips" if line else "fewer lines than the header skips"
            wanted = f"{line_skip} lines before the samples, of at most {MOST_SKIPPED} bytes"
            raise unreadable(source.path, found, wanted)
    if encoding == "text":
        if located:
            raise unreadable(source.path, "samples as text, of which no part can be read", "raw samples")
        return _read_text(source, dtype, count)
    return source.samples(dtype, count, start + skipped, encoding=encoding, skip=byte_skip, located=located)


def _read_text(source: Source, dtype: np.dtype[Any], count: int) -> NDArray[Any]:
    # A number and its separator take from two to forty characters.
    if count * 2 - 1 > source.at_most():
        raise unreadable(source.path, f"at most {source.at_most()} characters of samples", f"{count} numbers")
    _memory.require(count * dtype.itemsize, f"the samples of {source.path}")
    values = np.empty(count, dtype)
    filled, rest = 0, b""
    while filled < count:
        piece = source.stream.read(_PIECE)
        words = (rest + piece).split()
        rest = words.pop() if piece and words and not piece[-1:].isspace() else b""
        if len(rest) > _LONGEST_WORD:
            raise unreadable(source.path, f"{len(rest)} characters without a separator", "numbers")
        words = words[: count - filled]
        # Numbers that the type cannot represent are errors; NumPy would only warn.
        with warnings.catch_warnings(), np.errstate(over="raise", invalid="raise"):
            warnings.simplefilter("ignore")
            values[filled : filled + len(words)] = np.array(words).astype(dtype) if words else ()
        filled += len(words)
        if not piece:
            break
    if filled < count:
        raise unreadable(source.path, f"{filled} numbers", f"{count} numbers, as the header says")
    return values


def read(source: Source, name: str | None = None) -> list[Volume]:
    """Read an NRRD volume with three axes, the fastest is x, or one with a fourth axis of channels or colours.

    Parameters
    ----------
    source
    name
        The channel, by number; of a segmentation in layers the layer.

    Raises
    ------
    InvalidInput
        For other axes, of which none is stated as that of channels or colours by its kind or by having no direction.
    """
    volume, header, axis = _read(source, located=False)
    colored = axis is not None and _kind(header, axis).endswith("-color") and header["sizes"][axis] in (3, 4)
    channels = split(source.path, volume, None if colored or axis is None else 3, name=name)
    if not any(_LABEL.fullmatch(key) for key in header):
        return channels
    return [replace(one, labels=_segments(source.path, header, one.channel.number)) for one in channels]


def locate(source: Source) -> Volume:
    """Return what `read` reads of three axes; its values are `StoredSamples`, Unsupported unless they are raw."""
    volume, header, axis = _read(source, located=True)
    stated = axis is None and any(_LABEL.fullmatch(key) for key in header)
    return replace(volume, labels=_segments(source.path, header, 0)) if stated else volume


def _kind(header: dict[str, Any], axis: int) -> str:
    kinds = header.get("kinds")
    return str(kinds[axis]).lower() if isinstance(kinds, list) and axis < len(kinds) else ""


def _channel_axis(header: dict[str, Any], count: int) -> int | None:
    """Return which of four axes is none of the space or of time; None where there is no single one."""
    directions = header.get("space directions")
    found = []
    for axis in range(count):
        row = directions[axis] if directions is not None and len(directions) == count else 0.0
        without = row is None or bool(np.isnan(np.asarray(row, dtype=np.float64)).all())
        if without or _kind(header, axis) not in ("", "domain", "space", "none", "???"):
            found.append(axis)
    return found[0] if count == 4 and len(found) == 1 and _kind(header, found[0]) != "time" else None


def _without(header: dict[str, Any], axis: int) -> dict[str, Any]:
    """Return a header without what it says of an axis."""
    count = len(header["sizes"])
    return {
        key: [part for at, part in enumerate(one) if at != axis]
        if key in _OF_AXES and isinstance(one, list | np.ndarray) and len(one) == count
        else one
        for key, one in header.items()
    }


def _segments(path: Path, header: dict[str, Any], layer: int) -> LabelColors | bool:
    """Return names and colours of the segments in a layer of 3D Slicer; True where there are none."""
    colors, names = [], {}
    for number in (found[1] for found in map(_LABEL.fullmatch, header) if found):
        told = {part: str(header.get(f"Segment{number}_{part}", "")) for part in _SEGMENT}
        if natural(path, f"Segment{number}_Layer", told["Layer"] or "0") != layer:
            continue
        label = natural(path, f"Segment{number}_LabelValue", told["LabelValue"])
        names[label] = told["Name"]
        if told["Color"]:
            colors.append((label, floats(path, f"Segment{number}_Color", told["Color"], 3)))
    return label_colors(path, colors, names) or True


def _read(source: Source, *, located: bool) -> tuple[Volume, dict[str, Any], int | None]:
    """Return the volume of a file, its header, and which axis of it is that of channels or colours."""
    header, length = _header(source)
    for name in ("type", "dimension", "sizes", "encoding"):
        if name not in header:
            raise unreadable(source.path, f"a header without {name}", "an NRRD header")
    sizes = checked_shape(source.path, header["sizes"], "sizes")
    channels = None if located else _channel_axis(header, len(sizes))
    of_space = header if channels is None else _without(header, channels)
    if header["dimension"] != len(sizes) or len(of_space["sizes"]) != 3:
        raise unreadable(
            source.path,
            f"{header['dimension']} axes, sizes {sides(sizes)}",
            "three axes, and at most one of channels or colours by its kind",
            "choose one channel or one time step, for instance with: unu slice",
        )
    data = _field(header, "data file", "datafile")
    if data is None:
        flat = _read_samples(source, header, sizes, length, located=located)
    else:
        with Source(beside(source.path, str(data))) as samples:
            # A data file .gz with the encoding gzip is compressed once.
            plain = dict(header, encoding="raw") if samples.packed and header["encoding"] in ("gzip", "gz") else header
            flat = _read_samples(samples, plain, sizes, 0, located=located)
    values = flat.reshape(sizes[::-1])
    details: dict[str, str] = {name: str(header[name]) for name in _TOLD if name in header}
    volume = Volume(
        values if channels is None else np.moveaxis(values, 3 - channels, 3),
        format="nrrd",
        details=details,
        units=_length_units(of_space),
        **_place(source.path, of_space, tuple(of_space["sizes"])),
    )
    return in_body(volume, _sides(header)), header, channels


def _length_units(header: dict[str, Any]) -> tuple[str, ...]:
    """Return the units of the axes of the world, () where the header does not state three."""
    told = _field(header, "space units") or _field(header, "units") or []
    units = [str(one).strip().strip('"') for one in ([told] if isinstance(told, str) else told)]
    usable = all(one.isprintable() and len(one) <= _LONGEST_UNIT for one in units)
    return tuple(units) if usable and len(units) == 3 else ()
