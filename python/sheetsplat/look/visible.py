"""Where the visible part of a scene is: the points that a camera has to show."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import Bounds, triple
from sheetsplat.camera import Camera, bounds_of
from sheetsplat.fields import EllipsoidField, Field, RegularField
from sheetsplat.labels import LabelColors
from sheetsplat.look.measure import Floats, Measure, coarse_picture, measure_kernels, measure_volumes
from sheetsplat.modes import TRAITS
from sheetsplat.scene import Scene
from sheetsplat.transfer import TransferFunction

# A cell is visible where its opacity is above this share of the largest.
_VISIBLE = 0.06
# Where a smaller share of the positions is brighter than that, these are hot samples, and everything is shown.
_FEW_BRIGHT = 2e-4
# Share of the picture's opacity that may lie outside on each side.
_OUTLIERS = 0.002
# Parts of a picture that hang together and have less than this share of its opacity are strays, and do not count where
# all others together are smaller than that share of the picture's size; but strays have at most so much of the opacity.
# Where there are many parts, none of which is large, those at least so large beside the largest are none.
_STRAY = 0.05
_ALIKE = 0.05
_WITHOUT_STRAYS = 0.7
_STRAYS = 0.25
# What fills less of a coarse picture than this is looked at again, nearer.
_SMALL = 0.5
_LOOKS = 6


def camera_axes(camera: Camera) -> Floats:
    """Return right, up and backwards of a camera in the world, as rows."""
    unit = np.eye(3)
    return np.array([camera.native.direction_to_eye(triple("axis", axis)) for axis in unit]).T


def corners_of(box: Bounds) -> Floats:
    """Return the corners of a box, (8, 3); columns lie in one piece, as sums over rows round by their layout."""
    return np.array(np.meshgrid(*np.transpose(box))).reshape(3, 8).T


def depths_of(points: Floats, camera: Camera) -> Floats:
    """Return depths of points (N, 3) before a camera."""
    found: Floats = -((points - np.asarray(camera.eye)) @ camera_axes(camera)[2])
    return found


def visible_points(scene: Scene, camera: Camera) -> tuple[Floats, float] | None:
    """Return points (M, 3) at which something can be seen, and how far it reaches beyond them, world units.

    None where that is everything. What can be seen is found in a coarse picture along the view: the opacity of a ray is
    1 - exp(-sum of optical depths), whatever lies in front, so a histogram of positions weighted by their optical
    depths is enough. Integrals have values for optical depths, surfaces all that is on their dense side, maxima and
    means all that is not dark; where the minimum of a ray is shown, everything counts. Integrals of a region are those
    of all that it keeps, and integrals of a periodic box those of the box. Slice planes go through all of the data.
    """
    mode = TRAITS[scene.mode]
    if scene.options["slice_planes"] and not mode.is_scalar:
        return _region(scene)
    if mode.fold == "smallest":
        return None
    if mode.integrates:
        region = _region(scene)
        if region is not None or all(isinstance(one, EllipsoidField) and one.periodic for one in scene.fields):
            return region
    as_sum, by_brightness = mode.integrates, mode.counts
    parts, looked_at = [], 0
    for one, others, function in _measures(scene):
        looked_at += len(one.values)
        weights = _shown(one.values, scene, others, function) * one.volumes
        kept = (weights > 0) & np.isfinite(weights) & scene.options["clip"].keeps(one.points)
        if kept.any():
            parts.append((one.points[kept], weights[kept], float(np.median(one.reaches[kept]))))
    if not parts:
        return None
    points, weights = (np.concatenate([part[at] for part in parts]) for at in (0, 1))
    reach = max(part[2] for part in parts)
    if len(points) < 2 or (by_brightness and len(points) < _FEW_BRIGHT * looked_at):
        return None
    # Relative to the middle, so that volumes far from 0 keep their digits.
    middle = points.mean(axis=0)
    places = (points - middle) @ camera_axes(camera).T
    seen = np.ones(len(places), bool)
    for _ in range(_LOOKS):
        extent = np.ptp(places[seen, :2], axis=0)
        seen[seen] = _seen(places[seen, :2], weights[seen], as_sum=as_sum)
        if not seen.any():
            return None
        core = _without_strays(places[seen, :2], weights[seen], as_sum=as_sum)
        if not core.all():
            seen[seen] = core
            continue
        if not extent.any() or float((np.ptp(places[seen, :2], axis=0) / extent.max()).max()) > _SMALL:
            break
    first, last = _quantiles(places[seen, 2], weights[seen])
    seen &= (places[:, 2] >= first) & (places[:, 2] <= last)
    return points[seen], reach


def _region(scene: Scene) -> tuple[Floats, float] | None:
    """Return the middle and the radius of a sphere that is kept, or the corners of a box; None where all is kept."""
    clip, ends = scene.options["clip"], np.asarray(bounds_of(scene))
    if clip.region is None:
        return None
    low, high = np.maximum(clip.region[0], ends[0]), np.minimum(clip.region[1], ends[1])
    if clip.box is None and np.array_equal([low, high], clip.region):
        return np.array([clip.sphere[0]]), clip.sphere[1]
    # Nothing is kept where they do not meet.
    return (corners_of((triple("", low), triple("", high))), 0.0) if np.all(low < high) else None


def _quantiles(numbers: Floats, weights: Floats) -> tuple[float, float]:
    """Return the range of numbers without its outliers."""
    order = np.argsort(numbers)
    share = np.cumsum(weights[order])
    first = int(np.searchsorted(share, _OUTLIERS * share[-1]))
    last = int(np.searchsorted(share, (1.0 - _OUTLIERS) * share[-1]))
    return float(numbers[order[first]]), float(numbers[order[min(last, len(order) - 1)]])


def _seen(places: Floats, weights: Floats, *, as_sum: bool) -> NDArray[np.bool_]:
    """Return which positions in the picture (N, 2) lie where something can be seen, outliers aside."""
    depth, at = coarse_picture(places, weights)
    opacity = depth if as_sum else -np.expm1(-depth)
    picture = np.where(opacity >= _VISIBLE * opacity.max(), opacity, 0.0)
    found: NDArray[np.bool_] = picture[at[:, 0], at[:, 1]] > 0
    for axis in (0, 1):
        share = np.cumsum(picture.sum(axis=1 - axis))
        first = np.searchsorted(share, _OUTLIERS * share[-1], side="right")
        last = np.searchsorted(share, (1.0 - _OUTLIERS) * share[-1], side="left")
        found = found & (at[:, axis] >= first) & (at[:, axis] <= last)
    return found


def _without_strays(places: Floats, weights: Floats, *, as_sum: bool) -> NDArray[np.bool_]:
    """Return which positions in the picture (N, 2) are in its larger parts; all where that hardly changes its size."""
    every = np.ones(len(places), bool)
    depth, at = coarse_picture(places, weights)
    opacity = depth if as_sum else -np.expm1(-depth)
    parts = _connected(opacity > 0)
    shares = np.bincount(parts.ravel(), opacity.ravel()) / opacity.sum()
    large = shares >= min(_STRAY, _ALIKE * float(shares.max()))
    if not large.any() or shares[~large].sum() > _STRAYS:
        return every
    kept: NDArray[np.bool_] = large[parts[at[:, 0], at[:, 1]]]
    smaller = np.ptp(places[kept], axis=0).max() < _WITHOUT_STRAYS * np.ptp(places, axis=0).max()
    return kept if smaller else every


def _connected(picture: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return a number for each cell, the same in cells that hang together over edges and corners, 0 where it is False.

    As `scipy.ndimage.label`, whose import would take as long as a first picture.
    """
    parts = np.where(picture, np.arange(1, picture.size + 1).reshape(picture.shape), 0)
    while True:
        wider = np.pad(parts, 1)
        for axis in (0, 1):
            # The largest of three cells along each axis.
            ends = [np.take(wider, np.arange(start, wider.shape[axis] - 2 + start), axis) for start in range(3)]
            wider = np.maximum(np.maximum(ends[0], ends[1]), ends[2])
        grown = np.where(picture, wider, 0)
        if np.array_equal(grown, parts):
            return parts
        # The cell that a number came from may know a larger one by now: fewer steps through long parts.
        parts = np.where(picture, grown.ravel()[np.maximum(grown.ravel() - 1, 0)].reshape(picture.shape), 0)


def _measures(scene: Scene) -> Iterator[tuple[Measure, Sequence[Field], TransferFunction]]:
    """Yield positions in each field, the other fields of its group, and the group's transfer function.

    Fields of a group on one lattice count as one, the sum.
    """
    for group, function in zip(scene.groups, scene.transfer_functions, strict=True):
        fields = [one for one in group if one.size]
        for field in fields:
            if isinstance(field, EllipsoidField):
                yield measure_kernels(field), [one for one in fields if one is not field], function
        volumes = [one for one in fields if isinstance(one, RegularField)]
        if volumes and volumes[0].labels:
            function = LabelColors.of(function, volumes[0].labels_found)
        while volumes:
            alike = [one for one in volumes if _lattice(one) == _lattice(volumes[0])]
            others = [one for one in fields if not any(one is other for other in alike)]
            yield measure_volumes(alike), others, function
            volumes = [one for one in volumes if not any(one is other for other in alike)]


def _lattice(field: RegularField) -> tuple[Any, ...]:
    return field.shape, field.spacing, field.origin, field.lattice, field.axes


def _shown(values: Floats, scene: Scene, others: Sequence[Field], function: TransferFunction) -> Floats:
    """Return optical depths of values; where other fields may be added, the largest of without, lowest and highest."""
    ranges = [(*one.value_range, one.base) for one in others]
    shifts = {
        sum(base for _, _, base in ranges),
        sum(min(low, base) for low, _, base in ranges),
        sum(max(high, base) for _, high, base in ranges),
    }
    found: Floats = np.max([_depths(values + shift, scene, function) for shift in shifts], axis=0)
    return found


def _limits_of(scene: Scene) -> tuple[float, float]:
    """Return about the limits of the colours of a scalar picture: those of its values, not of its numbers."""
    ranges = [one.value_range for one in scene.fields if one.size]
    return replace(scene.scalar_colors, log=False).limits(np.sum(ranges or [(0.0, 0.0)], axis=0))


def _depths(values: Floats, scene: Scene, function: TransferFunction) -> Floats:
    """Return optical depths per world unit, or what stands for them in other modes."""
    mode = TRAITS[scene.mode]
    if mode.integrates:
        return np.abs(values)
    if mode.is_scalar:
        low, high = _limits_of(scene)
        return np.where(values > low + _VISIBLE * (high - low), 1e3 / scene.reference_length, 0.0)
    opacity = function.at(values)[..., 3]
    if mode.shows_surfaces:
        # A wall of any thickness hides what is behind it. Labels have surfaces at their borders, not at iso values.
        lowest = min((value for value, opacity in scene.surfaces if opacity > 0), default=math.inf)
        inside = opacity > 0 if isinstance(function, LabelColors) else values >= lowest
        return np.where(inside, 1e3 / scene.reference_length, 0.0)
    found: Floats = -np.log1p(-np.minimum(opacity, 1.0 - 1e-9)) / scene.reference_length
    return found
