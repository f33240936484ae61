"""MetaImage files, .mhd with its data beside it and .mha with its data inside.

Read here and not by a library (ITK's), so that the sizes in a header are checked before memory is taken, and samples
can be read in parts.
"""

from __future__ import annotations

import io
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sheetsplat import notices
from sheetsplat._checks import triple
from sheetsplat.io.axes import in_body
from sheetsplat.io.channels import split
from sheetsplat.io.checks import beside, checked_shape, floats, unreadable
from sheetsplat.io.records import Volume
from sheetsplat.io.source import Source
from sheetsplat.orientation import PATIENT
from sheetsplat.quantity import Quantity

_HEADER_LIMIT = 1 << 16
_NAMES = "CHAR UCHAR SHORT USHORT INT UINT LONG ULONG LONG_LONG ULONG_LONG FLOAT DOUBLE"
# Fields that become details of the volume, and values that say nothing.
_TOLD = (
    *("Name", "Comment", "Modality", "DistanceUnits"),
    *("ElementToIntensityFunctionSlope", "ElementToIntensityFunctionOffset"),
)
_NOTHING = ("", "?", "MET_MOD_UNKNOWN")
_LONGEST, _LONGEST_UNIT = 200, 32
_IDENTITY = "1 0 0 0 1 0 0 0 1"
_CODES = "i1 u1 i2 u2 i4 u4 i4 u4 i8 u8 f4 f8"
_TYPES = {f"MET_{name}": code for name, code in zip(_NAMES.split(), _CODES.split(), strict=True)}


def _header(source: Source) -> tuple[dict[str, str], int]:
    """Return the header's fields, ending with ElementDataFile, and its length in bytes."""
    length = 0
    fields: dict[str, str] = {}
    for line in io.BytesIO(source.head(_HEADER_LIMIT)):
        length += len(line)
        text = line.decode("latin-1").strip()
        if not text:
            continue
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals:
            raise unreadable(source.path, f"the line {text[:60]!r}", "a MetaImage header of lines name = value")
        fields[name] = value
        if name == "ElementDataFile":
            return fields, length
    raise unreadable(source.path, "a header without ElementDataFile", "a MetaImage header that ends with it")


def _first(fields: dict[str, str], *names: str, default: str) -> tuple[str, str]:
    """Return the name and the text of the first of these fields that is there."""
    return next(((name, fields[name]) for name in names if name in fields), (names[0], default))


def _truth(path: Path, fields: dict[str, str], *names: str, default: str = "False") -> bool:
    name, text = _first(fields, *names, default=default)
    if text.lower() not in ("true", "false", "1", "0"):
        raise unreadable(path, f"{name} = {text[:60]}", "True or False")
    return text.lower() in ("true", "1")


def _dtype(path: Path, fields: dict[str, str]) -> np.dtype[Any]:
    name = fields.get("ElementType", "")
    if name not in _TYPES:
        raise unreadable(path, f"ElementType = {name or '(none)'}", "one of: " + ", ".join(_TYPES))
    big = _truth(path, fields, "BinaryDataByteOrderMSB", "ElementByteOrderMSB")
    return np.dtype((">" if big else "<") + _TYPES[name])


def _check_supported(path: Path, fields: dict[str, str]) -> int:
    """Return the number of channels; InvalidInput for other than three axes, and for samples as text."""
    if fields.get("NDims") != "3":
        advice = "choose one time step, and write it to a file of its own"
        raise unreadable(path, f"NDims = {fields.get('NDims', '(none)')}", "3", advice)
    if not _truth(path, fields, "BinaryData", default="True"):
        raise unreadable(path, "BinaryData = False", "binary samples", "convert the file to binary samples")
    (count,) = checked_shape(path, [fields.get("ElementNumberOfChannels", "1")], "ElementNumberOfChannels")
    return count


def _in_body(volume: Volume, fields: dict[str, str], *, turned: bool) -> Volume:
    """Return a volume in the space of its file.

    ITK's world runs to the left, the back and the head of a patient, and ITK writes the sides that the axes of the file
    come from: RAI for the axes of that world. Other letters beside axes that are not turned are those of the format's
    own definition: the sides that the axes run to; "???" is "not known".
    """
    letters = fields.get("AnatomicalOrientation", "").strip()
    if turned or letters.upper() == "RAI":
        return replace(volume, orientation=PATIENT)
    return in_body(volume, letters)


def read(source: Source, name: str | None = None) -> list[Volume]:
    """Read the channels of a MetaImage volume with three axes, or the one of a number; the fastest axis is x.

    Samples are raw or packed by zlib; those of several channels follow each other at each place.
    """
    volume = _read(source, located=False)
    return split(source.path, volume, 3 if volume.values.ndim > 3 else None, name=name)


def locate(source: Source) -> Volume:
    """Return what `read` reads of one channel; its values are `StoredSamples`, Unsupported unless they are raw."""
    return _read(source, located=True)


def _read(source: Source, *, located: bool) -> Volume:
    path = source.path
    fields, length = _header(source)
    channels = _check_supported(path, fields)
    if located and channels > 1:
        raise unreadable(path, f"{channels} channels", "one, of volumes in bricks", "write each to a file of its own")
    sizes = checked_shape(path, fields.get("DimSize", "").split(), "DimSize")
    if len(sizes) != 3:
        raise unreadable(path, f"DimSize of {len(sizes)} numbers", "three numbers")
    dtype = _dtype(path, fields)
    spacing = floats(path, *_first(fields, "ElementSpacing", "ElementSize", default="1 1 1"), 3)
    if 0 in spacing:
        raise unreadable(path, f"ElementSpacing = {spacing}", "numbers other than 0")
    origin = floats(path, *_first(fields, "Offset", "Position", "Origin", default="0 0 0"), 3)
    # Each three numbers are the direction of an axis of the file, the fastest first.
    matrix = floats(path, *_first(fields, "TransformMatrix", "Rotation", "Orientation", default=_IDENTITY), 9)
    turned = matrix != floats(path, "", _IDENTITY, 9)
    encoding = "zlib" if _truth(path, fields, "CompressedData") else "raw"
    try:
        skip = int(fields.get("HeaderSize", "0"))
    except ValueError:
        skip = -2
    if skip < -1:
        raise unreadable(path, f"HeaderSize = {fields['HeaderSize'][:60]}", "a number of bytes, or -1")

    name = fields["ElementDataFile"]
    shape = (*sizes[::-1], *((channels,) if channels > 1 else ()))
    count = math.prod(checked_shape(path, shape, "DimSize and ElementNumberOfChannels"))
    if name.upper() == "LOCAL":
        values = source.samples(dtype, count, length, encoding=encoding, skip=max(0, skip), located=located)
    else:
        with Source(beside(path, name)) as other:
            values = other.samples(dtype, count, 0, encoding=encoding, skip=skip, located=located)
    if any(floats(path, "CenterOfRotation", fields.get("CenterOfRotation", "0 0 0"), 3)):
        # ITK turns volumes about the first sample, and writes 0 here.
        notices.warn(f"{path}: CenterOfRotation = {fields['CenterOfRotation']} is not used")
    details = {name.lower(): fields[name][:_LONGEST] for name in _TOLD if fields.get(name, "") not in _NOTHING}
    volume = Volume(
        values.reshape(shape),
        origin=triple("origin", origin),
        format="metaimage",
        details=details,
        quantity=_quantity(fields, dtype),
        axes=np.reshape(matrix, (3, 3)) * np.abs(spacing)[:, np.newaxis],
    )
    return _in_body(volume, fields, turned=turned)


def _quantity(fields: dict[str, str], dtype: np.dtype[Any]) -> Quantity:
    """Return what the samples and the lengths are, as far as the header says.

    Samples of CT are Hounsfield units where they can be below 0 and no function to intensities is stated; others may be
    shifted.
    """
    unit = fields.get("DistanceUnits", "")
    length_unit = unit if unit.isprintable() and unit not in _NOTHING and len(unit) <= _LONGEST_UNIT else ""
    shifted = fields.get("ElementToIntensityFunctionSlope", "1"), fields.get("ElementToIntensityFunctionOffset", "0")
    as_they_are = all(_number(text) == usual for text, usual in zip(shifted, (1.0, 0.0), strict=True))
    if fields.get("Modality") == "MET_MOD_CT" and dtype.kind in "if" and as_they_are:
        return Quantity("CT number", "HU", length_unit)
    return Quantity(length_unit=length_unit)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
