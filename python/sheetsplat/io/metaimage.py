"""MetaImage files, .mhd with its data beside it and .mha with its data inside."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from sheetsplat._checks import Triple
from sheetsplat.io.checks import beside, checked_shape, unreadable
from sheetsplat.io.records import Volume
from sheetsplat.io.source import Source

_HEADER_LIMIT = 1 << 16
_TYPES = {
    "MET_CHAR": "int8",
    "MET_UCHAR": "uint8",
    "MET_SHORT": "int16",
    "MET_USHORT": "uint16",
    "MET_INT": "int32",
    "MET_UINT": "uint32",
    "MET_LONG": "int32",
    "MET_ULONG": "uint32",
    "MET_LONG_LONG": "int64",
    "MET_ULONG_LONG": "uint64",
    "MET_FLOAT": "float32",
    "MET_DOUBLE": "float64",
}


def _header(source: Source) -> tuple[dict[str, str], int]:
    """Return the header's fields, ending with ElementDataFile, and its length in bytes."""
    head = source.head(_HEADER_LIMIT)
    fields: dict[str, str] = {}
    position = 0
    while position < len(head):
        end = head.find(b"\n", position)
        end = len(head) if end < 0 else end
        line = head[position:end].decode("latin-1").strip()
        position = end + 1
        if not line:
            continue
        name, equals, value = line.partition("=")
        if not equals:
            raise unreadable(source.path, f"the line {line[:60]!r}", "a MetaImage header of lines name = value")
        fields[name.strip()] = value.strip()
        if name.strip() == "ElementDataFile":
            return fields, min(position, len(head))
    raise unreadable(source.path, "a header without ElementDataFile", "a MetaImage header that ends with it")


def _numbers(path: Path, fields: dict[str, str], names: tuple[str, ...], default: list[float]) -> list[float]:
    for name in names:
        if name in fields:
            try:
                numbers = [float(word) for word in fields[name].split()]
            except ValueError:
                numbers = []
            if len(numbers) != len(default) or not all(map(math.isfinite, numbers)):
                raise unreadable(path, f"{name} = {fields[name][:60]}", f"{len(default)} finite numbers")
            return numbers
    return default


def _truth(path: Path, fields: dict[str, str], names: tuple[str, ...]) -> bool:
    for name in names:
        if name in fields:
            if fields[name].lower() not in ("true", "false", "1", "0"):
                raise unreadable(path, f"{name} = {fields[name][:60]}", "True or False")
            return fields[name].lower() in ("true", "1")
    return False


def _dtype(path: Path, fields: dict[str, str]) -> np.dtype[Any]:
    name = fields.get("ElementType", "")
    if name not in _TYPES:
        raise unreadable(path, f"ElementType = {name or '(none)'}", "one of: " + ", ".join(_TYPES))
    big = _truth(path, fields, ("BinaryDataByteOrderMSB", "ElementByteOrderMSB"))
    return np.dtype(_TYPES[name]).newbyteorder(">" if big else "<")


def _three(numbers: list[float]) -> Triple:
    return numbers[0], numbers[1], numbers[2]


def _check_supported(path: Path, fields: dict[str, str]) -> None:
    if fields.get("NDims") != "3":
        raise unreadable(path, f"NDims = {fields.get('NDims', '(none)')}", "3")
    if fields.get("ElementNumberOfChannels", "1") != "1":
        raise unreadable(
            path, f"ElementNumberOfChannels = {fields['ElementNumberOfChannels']}", "1", "choose one channel"
        )
    if not _truth(path, dict({"BinaryData": "True"}, **fields), ("BinaryData",)):
        raise unreadable(path, "BinaryData = False", "binary samples", "convert the file to binary samples")
    identity = [1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0]
    matrix = _numbers(path, fields, ("TransformMatrix", "Rotation", "Orientation"), identity)
    if matrix != identity:
        raise unreadable(
            path, f"TransformMatrix = {matrix}", "the identity", "resample the volume to the axes of the world"
        )


def read(source: Source) -> Volume:
    """Read a MetaImage volume with three axes; the fastest is x. Samples are raw or packed by zlib."""
    path = source.path
    fields, length = _header(source)
    _check_supported(path, fields)
    sizes = checked_shape(path, fields.get("DimSize", "").split(), "DimSize")
    if len(sizes) != 3:
        raise unreadable(path, f"DimSize of {len(sizes)} numbers", "three numbers")
    dtype = _dtype(path, fields)
    spacing = _numbers(path, fields, ("ElementSpacing", "ElementSize"), [1.0, 1.0, 1.0])
    if any(part == 0 for part in spacing):
        raise unreadable(path, f"ElementSpacing = {spacing}", "numbers other than 0")
    origin = _numbers(path, fields, ("Offset", "Position", "Origin"), [0.0, 0.0, 0.0])
    packed = _truth(path, fields, ("CompressedData",))
    try:
        skip = int(fields.get("HeaderSize", "0"))
    except ValueError:
        skip = -2
    if skip < -1:
        raise unreadable(path, f"HeaderSize = {fields['HeaderSize'][:60]}", "a number of bytes, or -1")

    name = fields["ElementDataFile"]
    count = math.prod(sizes)
    if name.upper() == "LOCAL":
        values = _samples(source, length, dtype, count, packed=packed, skip=max(0, skip))
    elif name.upper().startswith("LIST") or "%" in name:
        raise unreadable(path, f"ElementDataFile = {name}", "one data file", "join the files into one")
    else:
        with Source(beside(path, name)) as samples:
            values = _samples(samples, 0, dtype, count, packed=packed, skip=skip)
    return Volume(values.reshape(sizes[::-1]), _three([abs(part) for part in spacing]), _three(origin), "metaimage", {})


def _samples(source: Source, start: int, dtype: np.dtype[Any], count: int, *, packed: bool, skip: int) -> Any:
    if skip == -1:
        if packed or source.packed:
            raise unreadable(source.path, "HeaderSize = -1 for packed samples", "a number of bytes")
        start, skip = max(0, source.path.stat().st_size - count * dtype.itemsize), 0
    source.seek(start)
    payload = source.payload("zlib" if packed else "raw")
    payload.skip(skip)
    return payload.array(dtype, count)
