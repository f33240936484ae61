"""DICOM series: slices of a folder, ordered by their positions, in the units of the scanner."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import shown
from sheetsplat.errors import Unsupported, complain, option_ref
from sheetsplat.io.axes import nearest_the_world
from sheetsplat.io.checks import Where, checked_shape, floats, listed, printable, unreadable
from sheetsplat.io.records import Floats, Volume
from sheetsplat.io.source import Folder, Source
from sheetsplat.orientation import PATIENT
from sheetsplat.quantity import Quantity

# Deflated Explicit VR Little Endian is unpacked as a whole, without a bound.
_DEFLATED = "1.2.840.10008.1.2.1.99"
# Largest difference of a distance from the mean one, in distances, and of directions.
_UNEVEN = 0.02
_TURNED = 1e-3
_LONGEST = 64

_log = logging.getLogger("sheetsplat")


@dataclass(frozen=True)
class _Slice:
    """A slice: its file, its frame in it, and where it lies."""

    file: Path
    frame: int
    series: str
    place: Floats
    rows: Floats
    columns: Floats
    pixel: tuple[float, float]
    slope: float
    intercept: float


def _word(header: Any, name: str) -> str:
    return printable(str(header.get(name, ""))[:_LONGEST])


def _header(file: Path) -> Any:
    """Return the header of a file without its pixels, or None where it is no DICOM file."""
    from pydicom import dcmread, filereader  # type: ignore[import-not-found, unused-ignore]

    with Source(file) as source:
        if source.head(132)[128:] != b"DICM":
            return None
        if source.packed:
            raise unreadable(file, "a gzipped file", "one that is not packed")
        about = filereader.read_file_meta_info(str(file))
        if str(about.get("TransferSyntaxUID", "")) == _DEFLATED:
            raise complain(f"{file} cannot be read", "a deflated file", "one that is not deflated", kind=Unsupported)
        return dcmread(str(file), stop_before_pixels=True)


def _item(header: Any, frame: int, sequence: str) -> Any:
    """Return the functional group of a frame, its own or the common one; the header itself in files of one slice."""
    for owner in ("PerFrameFunctionalGroupsSequence", "SharedFunctionalGroupsSequence"):
        groups = header.get(owner)
        if groups:
            group = groups[frame if owner.startswith("Per") and frame < len(groups) else 0].get(sequence)
            if group:
                return group[0]
    return header


def _slices_of(file: Path, header: Any) -> list[_Slice]:
    """Return the slices of a file; none where it has no pixels or no place."""
    if header.get("Rows") is None or header.get("Columns") is None:
        return []
    found = []
    for frame in range(min(max(int(header.get("NumberOfFrames") or 1), 1), 100_000)):
        place = _item(header, frame, "PlanePositionSequence").get("ImagePositionPatient")
        if place is None:
            return []
        facing = _item(header, frame, "PlaneOrientationSequence").get("ImageOrientationPatient")
        measures = _item(header, frame, "PixelMeasuresSequence")
        turned = np.array(floats(file, "ImageOrientationPatient", facing, 6))
        pixel = floats(file, "PixelSpacing", measures.get("PixelSpacing"), 2)
        scaling = _item(header, frame, "PixelValueTransformationSequence")
        # Of a frame's own group, else of the file.
        slope = scaling.get("RescaleSlope", header.get("RescaleSlope", 1))
        intercept = scaling.get("RescaleIntercept", header.get("RescaleIntercept", 0))
        factors = floats(file, "RescaleSlope, RescaleIntercept", (slope, intercept), 2)
        if min(pixel) <= 0:
            raise unreadable(file, f"PixelSpacing {pixel}", "two numbers above 0")
        found.append(
            _Slice(
                file,
                frame,
                str(header.get("SeriesInstanceUID", "")),
                np.array(floats(file, "ImagePositionPatient", place, 3)),
                # The first three numbers are the direction of a row, along which columns count.
                turned[:3],
                turned[3:],
                (pixel[1], pixel[0]),
                factors[0],
                factors[1],
            )
        )
    return found


def _series(where: Where, headers: dict[Path, Any], chosen: str | None) -> list[Path]:
    """Return the files of one series: the one asked for by number, description or identifier, else the only one."""
    known: dict[str, list[Path]] = {}
    for file, header in headers.items():
        known.setdefault(str(header.get("SeriesInstanceUID", "")), []).append(file)
    names = {}
    for uid, files in known.items():
        first = headers[files[0]]
        names[uid] = (_word(first, "SeriesNumber"), _word(first, "SeriesDescription"), uid)
    fitting = [uid for uid, told in names.items() if chosen is None or chosen in told]
    if len(fitting) != 1:
        told = [f"{one[0]} ({one[1] or uid}, {len(known[uid])} files)" for uid, one in names.items()]
        text = listed(told)
        advice = "pass " + option_ref("name", "...") + ", its number, its description or its identifier"
        found = f"{len(known)} series: {text}" if chosen is None else f"no single series {shown(chosen)}, but {text}"
        raise unreadable(where, found, "one series", advice, option="name")
    return known[fitting[0]]


def _ordered(where: Where, slices: list[_Slice]) -> tuple[list[_Slice], Floats]:
    """Return slices by their positions and the step from one to the next; InvalidInput for missing and doubled ones."""
    first = slices[0]
    for one in slices:
        if np.abs([*(one.rows - first.rows), *(one.columns - first.columns)]).max() > _TURNED:
            raise unreadable(where, f"{one.file.name} turned against {first.file.name}", "parallel slices")
        if one.pixel != first.pixel:
            raise unreadable(where, f"pixels of {one.pixel} in {one.file.name}", f"{first.pixel}, as {first.file.name}")
    normal = np.cross(first.rows, first.columns)
    heights = np.array([one.place @ normal for one in slices])
    order = np.argsort(heights, kind="stable")
    slices, heights = [slices[at] for at in order], heights[order]
    if len(slices) < 2:
        raise unreadable(where, "one slice", "several: a volume")
    gaps = np.diff(heights)
    step = float(np.median(gaps))
    if gaps.min() <= 1e-4 * max(step, 1e-12):
        at = int(np.argmin(gaps))
        found = f"two slices at {heights[at]:g}: {slices[at].file.name} and {slices[at + 1].file.name}"
        raise unreadable(where, found, "one slice at each place", "choose one time step or channel")
    wrong = np.flatnonzero(np.abs(gaps - step) > _UNEVEN * step)
    if wrong.size:
        at = int(wrong[0])
        missing = round(float(gaps[at] / step)) - 1
        text = f"{missing} slices are missing" if missing > 0 else "the distance differs"
        raise unreadable(
            where,
            f"slices {step:g} apart, but {gaps[at]:g} after {slices[at].file.name} at {heights[at]:g}: {text}",
            "slices at even distances",
            "fetch the whole series",
        )
    return slices, (slices[-1].place - slices[0].place) / (len(slices) - 1)


def _pixels(where: Where, slices: list[_Slice], header: Any) -> NDArray[Any]:
    """Return the samples [slice, row, column] in the units of the scanner."""
    from pydicom import dcmread

    rows, columns = int(header["Rows"].value), int(header["Columns"].value)
    shape = checked_shape(where, (len(slices), rows, columns), "the size of the series")
    whole = all(one.slope.is_integer() and one.intercept.is_integer() for one in slices)
    values: NDArray[Any] = np.empty(0)
    last, frames = None, np.empty(0)
    for number, one in enumerate(slices):
        if one.file != last:
            frames, last = _frames(one.file, dcmread(str(one.file)), rows, columns), one.file
        raw = frames[one.frame]
        if not number:
            _memory.require(math.prod(shape) * 8, f"the samples of {where}")
            values = np.empty(shape, np.int32 if whole and raw.dtype.kind in "iu" else np.float32)
        values[number] = raw * (values.dtype.type(one.slope)) + values.dtype.type(one.intercept)
    return values


def _frames(file: Path, data: Any, rows: int, columns: int) -> NDArray[Any]:
    count = int(data.get("NumberOfFrames") or 1)
    found = (int(data.get("Rows", 0)), int(data.get("Columns", 0)), int(data.get("SamplesPerPixel", 1)))
    if found != (rows, columns, 1):
        wanted = f"({rows}, {columns}, 1), as the other slices"
        raise unreadable(file, f"rows, columns and channels {found}", wanted, "convert colours to grey")
    checked_shape(file, (count, rows, columns), "frames, rows and columns")
    _memory.require(8 * count * rows * columns, f"the pixels of {file}")
    try:
        pixels = np.asarray(data.pixel_array)
    except (NotImplementedError, RuntimeError) as error:
        syntax = getattr(data.file_meta.TransferSyntaxUID, "name", "an unknown way")
        advice = "pip install pylibjpeg pylibjpeg-libjpeg pylibjpeg-openjpeg, or convert the files"
        found_text = f"pixels packed as {syntax}"
        raise complain(f"{file} cannot be read", found_text, "a decoder", advice, kind=Unsupported) from error
    if pixels.dtype.kind not in "iuf" or pixels.size != count * rows * columns:
        raise unreadable(file, f"pixels of shape {pixels.shape}, {pixels.dtype}", f"({count}, {rows}, {columns})")
    return pixels.reshape(count, rows, columns)


def read(source: Source | Folder, name: str | None = None) -> Volume:
    """Read one series: that of a file in its folder, or the one in a folder.

    Slices are ordered by their positions, and rescaled: CT is in Hounsfield units. World axes run to the left, the back
    and the head of the patient, in mm. A series that is turned against them keeps its own axes.

    Parameters
    ----------
    source
    name
        The series, where there are several: its number, its description or its identifier.

    Raises
    ------
    InvalidInput
        For missing or doubled slices, uneven distances, slices that are not parallel, and several series.
    Unsupported
        For pixels that no installed decoder can unpack.
    """
    folder = Folder(source.path.parent) if isinstance(source, Source) else source
    headers: dict[Path, Any] = {}
    own = None
    if isinstance(source, Source):
        own = _header(source.path)
        if own.get("NumberOfFrames") is not None and int(own["NumberOfFrames"].value or 1) > 1:
            headers[source.path] = own
    where = source.path
    if not headers:
        for file in folder.files():
            header = _header(file)
            if header is not None and header.get("Rows") is not None:
                headers[file] = header
        if own is not None:
            uid = own.get("SeriesInstanceUID")
            headers = {file: one for file, one in headers.items() if one.get("SeriesInstanceUID") == uid}
    if not headers:
        raise unreadable(where, "no picture", "slices of a series")
    files = _series(where, headers, name)
    slices = [one for file in files for one in _slices_of(file, headers[file])]
    if not slices:
        raise unreadable(where, "pictures without positions", "slices with ImagePositionPatient")
    slices, step = _ordered(where, slices)
    header = headers[slices[0].file]
    _log.info("%s: %d slices of series %s", where, len(slices), _word(header, "SeriesNumber") or "without a number")
    values = _pixels(where, slices, header)
    first = slices[0]
    steps = np.stack([first.rows * first.pixel[0], first.columns * first.pixel[1], step])
    placed = nearest_the_world(where, "the directions of rows, columns and slices", steps, first.place, values, PATIENT)
    kind = _word(header, "Modality")
    unit = "HU" if kind == "CT" else printable(str(header.get("RescaleType", "")))
    details = {"content": _word(header, "SeriesDescription"), "slices": str(len(slices)), **placed.details}
    return Volume(
        placed.values,
        placed.spacing,
        placed.origin,
        "dicom",
        {key: text for key, text in details.items() if text},
        Quantity("CT number" if kind == "CT" else kind, unit, "mm"),
        placed.orientation,
    )
