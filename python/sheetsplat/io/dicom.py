"""DICOM series: slices of a folder, ordered by their positions, in the units of the scanner."""

from __future__ import annotations

import io
import logging
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import shown, triple
from sheetsplat.errors import Unsupported, complain, option_ref
from sheetsplat.io.checks import Where, checked_shape, chosen_step, floats, listed, printable, unreadable
from sheetsplat.io.dicom_segments import is_segmentation, labels_of, planes_of, stated_colors
from sheetsplat.io.formats import is_dicom
from sheetsplat.io.names import tell_names
from sheetsplat.io.records import Floats, Packing, Volume
from sheetsplat.io.source import Folder, Source
from sheetsplat.orientation import PATIENT
from sheetsplat.quantity import Quantity

# Deflated Explicit VR Little Endian is unpacked as a whole, without a bound.
_DEFLATED = "1.2.840.10008.1.2.1.99"
# Largest difference of a distance from the mean one, in distances, and of directions.
_UNEVEN = 0.02
_TURNED = 1e-3
# Largest difference of products of directions from those of unit vectors at right angles.
_ASKEW = 0.01
# Slices that are closer than this share of the largest distance lie at one place.
_SAME = 0.01
# Largest distance of a slice from its place in the plane, in pixels.
_BESIDE = 0.1
_LONGEST = 64
_MOST_FRAMES = 100_000
# Most bytes of what a file says about how it is written.
_MOST_META = 1 << 16
# What tells slices of one place apart, in the order of time.
_TIMES = ("TemporalPositionIdentifier", "TriggerTime", "EchoNumbers", "AcquisitionNumber", "InstanceNumber")

_log = logging.getLogger("sheetsplat")


@dataclass(frozen=True)
class _Slice:
    """A slice: its file, its frame in it, where it lies, and which of those of its place it is."""

    file: Path
    frame: int
    place: Floats
    rows: Floats
    columns: Floats
    pixel: tuple[float, float]
    packing: Packing
    order: tuple[float, ...]

    @property
    def normal(self) -> Floats:
        """Direction of the slice's normal."""
        return np.cross(self.rows, self.columns)


def _word(header: Any, name: str) -> str:
    return printable(str(header.get(name, ""))[:_LONGEST])


def _header(file: Path) -> Any:
    """Return the header of a file without its pixels, or None where it is no DICOM file."""
    from pydicom import filereader  # type: ignore[import-not-found, unused-ignore]

    with Source(file) as source:
        if not is_dicom(source):
            return None
        if source.packed:
            raise unreadable(file, "a gzipped file", "one that is not packed")
        head = source.head(_MOST_META)
    # Some files lack the 128 bytes before these letters, and the letters.
    begin = io.BytesIO(head[132:] if head[128:132] == b"DICM" else head)
    about = filereader.read_dataset(begin, False, True, stop_when=lambda tag, *_: bool(tag.group != 2))
    if len(head) == _MOST_META and begin.tell() > _MOST_META - 256:
        raise unreadable(file, f"more than {_MOST_META} bytes about how it is written", "fewer")
    if str(about.get("TransferSyntaxUID", "")) == _DEFLATED:
        raise complain(f"{file} cannot be read", "a deflated file", "one that is not deflated", kind=Unsupported)
    return _data(file, stop_before_pixels=True)


def _data(file: Path, **options: Any) -> Any:
    from pydicom import dcmread, uid  # type: ignore[import-not-found, unused-ignore]

    data = dcmread(str(file), force=True, **options)
    if "TransferSyntaxUID" not in data.file_meta:
        # A file that does not say how it is written has been read by what its first element looks like.
        implicit, little = data.original_encoding
        explicit = uid.ExplicitVRLittleEndian if little else uid.ExplicitVRBigEndian
        data.file_meta.TransferSyntaxUID = uid.ImplicitVRLittleEndian if implicit else explicit
    return data


def _item(header: Any, frame: int, sequence: str) -> Any:
    """Return the functional group of a frame, its own or the common one; the header itself in files of one slice."""
    for owner in ("PerFrameFunctionalGroupsSequence", "SharedFunctionalGroupsSequence"):
        groups = header.get(owner)
        if groups:
            group = groups[frame if owner.startswith("Per") and frame < len(groups) else 0].get(sequence)
            if group:
                return group[0]
    return header


def _frames_of(header: Any) -> int:
    return min(max(int(header.get("NumberOfFrames") or 1), 1), _MOST_FRAMES)


def _places(file: Path, header: Any, first: Floats, normal: Floats) -> Floats:
    """Return where the frames of a file lie that have no groups of their own: by the first one and their distances."""
    frames = _frames_of(header)
    if frames == 1:
        return first[None]
    offsets, step = header.get("GridFrameOffsetVector"), header.get("SpacingBetweenSlices")
    if offsets is not None:
        # They count from the first frame, or are the coordinates of the frames: what lies between is the same.
        along = np.array(floats(file, "GridFrameOffsetVector", offsets, frames))
    elif step is not None:
        along = np.arange(frames) * floats(file, "SpacingBetweenSlices", step, 1)[0]
    else:
        wanted = "the distances of frames, GridFrameOffsetVector or SpacingBetweenSlices"
        raise unreadable(file, f"{frames} frames with one position", wanted)
    found: Floats = first + (along - along[0])[:, None] * normal
    return found


def _packing(file: Path, header: Any, frame: int) -> Packing:
    """Return how the numbers of a frame become samples."""
    scaling = _item(header, frame, "PixelValueTransformationSequence")
    # Of a frame's own group, else of the file.
    slope = scaling.get("RescaleSlope", header.get("RescaleSlope", header.get("DoseGridScaling", 1)))
    intercept = scaling.get("RescaleIntercept", header.get("RescaleIntercept", 0))
    scale, offset = floats(file, "RescaleSlope, RescaleIntercept", (slope, intercept), 2)
    return Packing(scale, offset)


def _order(header: Any, frame: int) -> tuple[float, ...]:
    index = _item(header, frame, "FrameContentSequence").get("TemporalPositionIndex", 0)
    found = []
    for told in (index, *map(header.get, _TIMES), frame):
        try:
            found.append(float(told or 0))
        except (TypeError, ValueError):
            found.append(0.0)
    return tuple(found)


def _slice_of(file: Path, header: Any, frame: int) -> _Slice | None:
    """Return a frame as a slice; None where it has no place."""
    place = _item(header, frame, "PlanePositionSequence").get("ImagePositionPatient")
    facing = _item(header, frame, "PlaneOrientationSequence").get("ImageOrientationPatient")
    if place is None or facing is None:
        return None
    # The first three numbers are the direction of a row, along which columns count.
    turned = np.array(floats(file, "ImageOrientationPatient", facing, 6))
    sides = turned.reshape(2, 3)
    if np.abs(sides @ sides.T - np.eye(2)).max() > _ASKEW:
        wanted = "the directions of rows and columns, of length 1 and at right angles"
        raise unreadable(file, f"ImageOrientationPatient {turned.tolist()}", wanted)
    pixel = floats(file, "PixelSpacing", _item(header, frame, "PixelMeasuresSequence").get("PixelSpacing"), 2)
    if min(pixel) <= 0:
        raise unreadable(file, f"PixelSpacing {pixel}", "two numbers above 0")
    return _Slice(
        file,
        frame,
        np.array(floats(file, "ImagePositionPatient", place, 3)),
        turned[:3],
        turned[3:],
        (pixel[1], pixel[0]),
        _packing(file, header, frame),
        _order(header, frame),
    )


def _slices_of(file: Path, header: Any) -> list[_Slice]:
    """Return the slices of a file; none where it has no pixels or no place."""
    if header.get("Rows") is None or header.get("Columns") is None:
        return []
    frames, groups = _frames_of(header), len(header.get("PerFrameFunctionalGroupsSequence") or ())
    if groups and groups != frames:
        raise unreadable(file, f"{frames} frames with {groups} groups", "a group for each frame")
    found = [_slice_of(file, header, frame) for frame in range(groups or 1)]
    slices = [one for one in found if one is not None]
    if len(slices) < len(found):
        return []
    if groups:
        return slices
    first = slices[0]
    places = _places(file, header, first.place, first.normal)
    return [replace(first, frame=at, place=place, order=(*first.order, at)) for at, place in enumerate(places)]


def _series(where: Where, headers: dict[Path, Any], chosen: str | None) -> list[Path]:
    """Return the files of one series: the one asked for by number, description or identifier, else the only one."""
    known: dict[str, list[Path]] = {}
    for file, header in headers.items():
        known.setdefault(str(header.get("SeriesInstanceUID", "")), []).append(file)
    names = {}
    for uid, files in known.items():
        first = headers[files[0]]
        names[uid] = (_word(first, "SeriesNumber"), _word(first, "SeriesDescription"), uid)
    words = [word for one in names.values() for word in one]
    tell_names(next((word for word in one if word and words.count(word) == 1), uid) for uid, one in names.items())
    fitting = [uid for uid, one in names.items() if chosen is None or chosen in one]
    if len(fitting) != 1:
        text = listed([f"{one[0]} ({one[1] or uid}, {len(known[uid])} files)" for uid, one in names.items()])
        advice = "pass " + option_ref("name", "...") + ", its number, its description or its identifier"
        found = f"{len(known)} series: {text}" if chosen is None else f"no single series {shown(chosen)}, but {text}"
        raise unreadable(where, found, "one series", advice, option="name")
    return known[fitting[0]]


def _steps_of(slices: list[_Slice]) -> list[list[_Slice]]:
    """Return the slices of each time step: as many slices lie at each place as there are steps, else one step."""
    along = np.array([one.place for one in slices]) @ slices[0].normal
    order = np.argsort(along, kind="stable")
    gaps = np.diff(along[order])
    ends = np.flatnonzero(gaps > _SAME * gaps.max(initial=0.0)) + 1
    places = np.split(order, ends)
    counts = {len(one) for one in places}
    if len(counts) > 1 or len(places) < 2:
        return [slices]
    sorted_places = [sorted((slices[at] for at in one), key=lambda one: one.order) for one in places]
    return [list(one) for one in zip(*sorted_places, strict=True)]


def _ordered(where: Where, slices: list[_Slice]) -> tuple[list[_Slice], Floats]:
    """Return slices by their positions and the step from one to the next; InvalidInput for missing and doubled ones."""
    first = slices[0]
    turns = np.array([(one.rows, one.columns) for one in slices]) - (first.rows, first.columns)
    turned = np.flatnonzero(np.abs(turns).max(axis=(1, 2)) > _TURNED)
    if turned.size:
        found = f"{slices[turned[0]].file.name} turned against {first.file.name}"
        raise unreadable(where, found, "parallel slices")
    other = next((one for one in slices if one.pixel != first.pixel), None)
    if other is not None:
        found = f"pixels of {other.pixel} in {other.file.name}"
        raise unreadable(where, found, f"{first.pixel}, as {first.file.name}")
    heights = np.array([one.place for one in slices]) @ first.normal
    order = np.argsort(heights, kind="stable")
    slices, heights = [slices[at] for at in order], heights[order]
    if len(slices) < 2:
        raise unreadable(where, "one slice", "several: a volume")
    gaps = np.diff(heights)
    gap = float(np.median(gaps))
    if gaps.min() <= 1e-4 * max(gap, 1e-12):
        at = int(np.argmin(gaps))
        found = f"two slices at {heights[at]:g}: {slices[at].file.name} and {slices[at + 1].file.name}"
        raise unreadable(
            where, found, "one slice at each place", "put the slices of one volume into a folder of their own"
        )
    wrong = np.flatnonzero(np.abs(gaps - gap) > _UNEVEN * gap)
    if wrong.size:
        at = int(wrong[0])
        missing = round(float(gaps[at] / gap)) - 1
        text = f"{missing} slices are missing" if missing > 0 else "the distance differs"
        raise unreadable(
            where,
            f"slices {gap:g} apart, but {gaps[at]:g} after {slices[at].file.name} at {heights[at]:g}: {text}",
            "slices at even distances",
            "fetch the whole series",
        )
    places = np.array([one.place for one in slices])
    step = (places[-1] - places[0]) / (len(slices) - 1)
    # Slices of a tilted gantry lie beside each other by as much from each to the next.
    beside = (places - places[0] - np.arange(len(slices))[:, None] * step) @ np.stack([first.rows, first.columns]).T
    if np.abs(beside).max() > _BESIDE * min(first.pixel):
        at = int(np.argmax(np.abs(beside).max(axis=1)))
        found = f"{slices[at].file.name} {np.abs(beside[at]).max():g} mm beside the line of the others"
        raise unreadable(where, found, "slices at even distances")
    return slices, step


def _pixels(where: Where, slices: list[_Slice], header: Any) -> tuple[NDArray[Any], Packing]:
    """Return what is stored for the slices, [slice, row, column], and how it becomes samples.

    Where each slice has a scale of its own, these are the samples.
    """
    rows, columns = int(header["Rows"].value), int(header["Columns"].value)
    shape = checked_shape(where, (len(slices), rows, columns), "the size of the series")
    packings = list(dict.fromkeys(one.packing for one in slices))
    own = len(packings) > 1
    values: NDArray[Any] = np.empty(0)
    last, frames = None, np.empty(0)
    for number, one in enumerate(slices):
        if one.file != last:
            frames, last = _frames(one.file, _data(one.file), rows, columns), one.file
        raw = frames[one.frame]
        if not number:
            kinds = [np.result_type(packing.kind(raw.dtype), raw.dtype) for packing in packings]
            kind = np.result_type(*kinds) if own else raw.dtype
            _memory.require(math.prod(shape) * kind.itemsize, f"the samples of {where}")
            values = np.empty(shape, kind)
        values[number] = one.packing.unpacked(raw, where) if own else raw
    return values, Packing() if own else packings[0]


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


def _found(source: Source | Folder, name: str | None) -> tuple[list[list[_Slice]], Any]:
    """Return the slices of each time step of a series, and its first header."""
    folder = Folder(source.path.parent) if isinstance(source, Source) else source
    headers: dict[Path, Any] = {}
    own = None
    if isinstance(source, Source):
        own = _header(source.path)
        if _frames_of(own) > 1:
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
        found = "pictures without positions"
        raise unreadable(where, found, "slices with ImagePositionPatient and ImageOrientationPatient")
    header = headers[slices[0].file]
    return [slices] if is_segmentation(header) else _steps_of(slices), header


def count_steps(source: Source | Folder, name: str | None = None) -> int:
    """Return the number of time steps."""
    return len(_found(source, name)[0])


def read(source: Source | Folder, name: str | None = None, step: int | None = None) -> Volume:
    """Read one series: that of a file in its folder, or the one in a folder.

    Slices are ordered by their positions, and rescaled: CT is in Hounsfield units, doses are in Gy. World axes run to
    the left, the back and the head of the patient, in mm.

    Parameters
    ----------
    source
    name
        The series, where there are several: its number, its description or its identifier.
    step
        Where several slices lie at each place, which of them: a time step, from 0 on.

    Raises
    ------
    InvalidInput
        For missing or doubled slices, uneven distances, slices that are not parallel, and several series.
    Unsupported
        For pixels that no installed decoder can unpack.
    """
    where = source.path
    steps, header = _found(source, name)
    if is_segmentation(header):
        return _segmentation(where, steps[0], header)
    slices, step_between = _ordered(where, steps[chosen_step(where, len(steps), step)])
    _log.info("%s: %d slices of series %s", where, len(slices), _word(header, "SeriesNumber") or "without a number")
    values, packing = _pixels(where, slices, header)
    first = slices[0]
    kind = _word(header, "Modality")
    stated = printable(str(header.get("RescaleType", "")))
    name_of, unit = {"CT": ("CT number", "HU"), "RTDOSE": ("dose", _dose_unit(header))}.get(kind, (kind, stated))
    details = {"content": _word(header, "SeriesDescription"), "slices": str(len(slices))}
    return Volume(
        values,
        origin=triple("ImagePositionPatient", first.place),
        format="dicom",
        details={key: text for key, text in details.items() if text},
        quantity=Quantity(name_of, unit, "mm"),
        orientation=PATIENT,
        axes=np.stack([first.rows * first.pixel[0], first.columns * first.pixel[1], step_between]),
        packing=packing,
    )


def _segmentation(where: Where, slices: list[_Slice], header: Any) -> Volume:
    """Return the labels of a segmentation, which is one file."""
    first = slices[0]
    if any(one.file != first.file for one in slices):
        raise unreadable(where, "a segmentation in several files", "one file", "choose one of its files")
    turns = np.array([(one.rows, one.columns) for one in slices]) - (first.rows, first.columns)
    if np.abs(turns).max() > _TURNED:
        raise unreadable(where, "frames that are turned against each other", "parallel slices")
    heights = np.array([one.place for one in slices]) @ first.normal
    planes, gap = planes_of(where, heights)
    frames = _frames(first.file, _data(first.file), int(header["Rows"].value), int(header["Columns"].value))
    lowest = slices[int(np.argmin(heights))]
    return Volume(
        labels_of(where, header, frames, planes),
        origin=triple("ImagePositionPatient", lowest.place),
        format="dicom",
        details={"content": text} if (text := _word(header, "SeriesDescription")) else {},
        quantity=Quantity("segment", "", "mm"),
        orientation=PATIENT,
        axes=np.stack([first.rows * first.pixel[0], first.columns * first.pixel[1], first.normal * gap]),
        labels=stated_colors(where, header),
    )


def _dose_unit(header: Any) -> str:
    unit = _word(header, "DoseUnits")
    return "Gy" if unit == "GY" else unit
