"""Segmentations of DICOM (PS3.3, section A.51): a frame for each segment and slice, as a volume of labels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory, notices
from sheetsplat.io.channels import label_colors
from sheetsplat.io.checks import Where, checked_shape, floats, printable, unreadable
from sheetsplat.io.records import Floats
from sheetsplat.labels import LabelColors

# Classes of segmentations: one segment a frame, and numbers of segments.
_CLASSES = ("1.2.840.10008.5.1.4.1.1.66.4", "1.2.840.10008.5.1.4.1.1.66.7")
# Most numbers of segments, and planes.
_MOST = 65_535
# Largest distance of a plane from its place, in distances of planes.
_UNEVEN = 0.02
# The white point of CIELab, red, green and blue of XYZ (sRGB), and where its curve becomes a line.
_WHITE = np.array([0.95047, 1.0, 1.08883])
_OF_XYZ = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])
_LINE = 6.0 / 29.0


def is_segmentation(header: Any) -> bool:
    """Return whether a file of DICOM is a segmentation."""
    return str(header.get("SOPClassUID", "")) in _CLASSES


def planes_of(where: Where, heights: Floats) -> tuple[NDArray[np.int64], float]:
    """Return the number of the plane of each frame, and the distance of planes.

    Planes without a segment may have no frame. InvalidInput for heights that are not whole numbers of the least
    distance apart, and for a single plane.
    """
    gaps = np.diff(np.unique(heights))
    gaps = gaps[gaps > _UNEVEN * gaps.max(initial=0.0)]
    if not gaps.size:
        raise unreadable(where, "a segmentation of one slice", "several: a volume")
    gap = float(gaps.min())
    places = (heights - heights.min()) / gap
    numbers = np.round(places)
    if np.abs(places - numbers).max() > _UNEVEN or numbers.max() >= _MOST:
        raise unreadable(where, f"slices {gap:g} apart, and others between them", "slices at even distances")
    return numbers.astype(np.int64), gap


def labels_of(where: Where, header: Any, frames: NDArray[Any], planes: NDArray[np.int64]) -> NDArray[Any]:
    """Return the numbers of segments, [plane, row, column], 0 where there is none; of two at one place the later one.

    `frames`: those of the file, [frame, row, column]; `planes`: the number of the plane of each.
    """
    shape = checked_shape(where, (int(planes.max()) + 1, *frames.shape[1:]), "the size of the segmentation")
    _memory.require(2 * int(np.prod(shape)), f"the labels of {where}")
    values = np.zeros(shape, np.uint16)
    # A share of the largest number, of segmentations whose pixels are probabilities.
    largest = int(header.get("MaximumFractionalValue") or 1)
    maps, twice = str(header.get("SegmentationType", "")) == "LABELMAP", False
    for number, (frame, plane) in enumerate(zip(frames, planes.tolist(), strict=True)):
        inside = frame > 0 if maps else 2 * frame.astype(np.int64) >= largest
        twice |= bool((values[plane][inside] > 0).any())
        values[plane][inside] = frame[inside] if maps else _segment_of(where, header, number)
    if twice:
        notices.warn(f"{where}: segments overlap; where they do the last one is shown")
    return values


def _segment_of(where: Where, header: Any, frame: int) -> int:
    """Return the number of the segment that a frame shows."""
    groups = [header.get("PerFrameFunctionalGroupsSequence") or [], header.get("SharedFunctionalGroupsSequence") or []]
    for group in (*groups[0][frame : frame + 1], *groups[1][:1]):
        told = group.get("SegmentIdentificationSequence")
        number = int(told[0].get("ReferencedSegmentNumber") or 0) if told else 0
        if 0 < number <= _MOST:
            return number
    raise unreadable(where, f"frame {frame} without the number of its segment", f"one from 1 to {_MOST}")


def stated_colors(where: Where, header: Any) -> LabelColors | bool:
    """Return names and colours of the segments; True where there are none."""
    colors, names = [], {}
    for segment in header.get("SegmentSequence") or []:
        number = int(segment.get("SegmentNumber") or 0)
        names[number] = printable(str(segment.get("SegmentLabel", "")))
        lab = segment.get("RecommendedDisplayCIELabValue")
        if lab is not None:
            colors.append((number, rgb_of(floats(where, "RecommendedDisplayCIELabValue", list(lab), 3))))
    return label_colors(where, colors, names) or True


def rgb_of(lab: Sequence[float]) -> list[float]:
    """Return red, green and blue, 0 to 1 (sRGB), of CIELab as DICOM stores it, each from 0 to 65535."""
    lightness, a, b = lab[0] / 655.35, lab[1] / 257.0 - 128.0, lab[2] / 257.0 - 128.0
    middle = (lightness + 16.0) / 116.0
    curve = np.array([middle + a / 500.0, middle, middle - b / 200.0])
    xyz = _WHITE * np.where(curve > _LINE, curve**3, 3.0 * _LINE**2 * (curve - 4.0 / 29.0))
    linear = np.clip(_OF_XYZ @ xyz, 0.0, 1.0)
    shown: Floats = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    found: list[float] = np.clip(shown, 0.0, 1.0).tolist()
    return found
