"""Scattered kernels that are smaller than two pixels or a slice distance, and those that no slice meets."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sheetsplat.camera import Camera
from sheetsplat.fields import EllipsoidField
from sheetsplat.look.visible import camera_axes
from sheetsplat.scene import Scene
from sheetsplat.transfer import TransferFunction

Floats = NDArray[np.float64]

# Kernels of a field that are looked at; of more, every n-th.
_MOST = 50_000
# Kernels whose neighbours are looked at; one with less than this times its own weight at its centre stands alone.
_ENOUGH = 256
_ALONE = 2.0
#: Kernels between slices are told from this share of what shows on; `image.error` cannot see them.
LEAST_UNMET = 1e-3


@dataclass(frozen=True)
class Small:
    """The small ones among the scattered kernels that show and lie in the picture.

    Shares are parts of what all of these kernels cover in the picture, each its area times its opacity.

    Attributes
    ----------
    share
        Share of those that are narrower than two pixels, half a pixel for the standard deviation of a Gaussian, or
        thinner than a slice distance along the view, and stand alone: sums of many that overlap are as smooth as those
        of larger ones.
    hidden
        Share of the small ones whose values the filter would lower to where nothing shows.
    """

    share: float = 0.0
    hidden: float = 0.0


@dataclass(frozen=True)
class Unmet:
    """The scattered kernels in the picture that would show and that no slice meets.

    Attributes
    ----------
    share
        Their share of what all kernels that show cover in the picture, as in `Small`.
    count
        How many; an estimate where a field has more than 50,000 kernels.
    thinnest
        The shortest semi-axis of one of them along the view, world units; infinite without any.
    """

    share: float = 0.0
    count: int = 0
    thinnest: float = math.inf


@dataclass(frozen=True)
class _Shown:
    """Kernels of a field that show and lie in the picture, every `step`-th of those there are.

    `optical_depths` are those of values, for the field's group.
    """

    field: EllipsoidField
    step: int
    picked: NDArray[np.int64]
    # Rows: right, up and back in the camera's space.
    axes: Floats
    depths: Floats
    # Width of a pixel at the kernel's depth.
    pixels: Floats
    # Half the length along the view, the width of the projection, and its area times opacity.
    halves: Floats
    widths: Floats
    covers: Floats
    optical_depths: Callable[[Floats], Floats]


def small_kernels(scene: Scene, camera: Camera, size: tuple[int, int]) -> Small:
    """Return what a scene has of small kernels, as a camera sees it without a filter."""
    covered = small = hidden = 0.0
    for shown in _shown(scene, camera, size):
        covered += float(shown.covers.sum()) * shown.step
        found = (shown.widths < shown.pixels) | (2.0 * shown.halves < scene.slice_spacing)
        alone = shown.step * _share_alone(shown.field, shown.picked[found])
        gone = shown.optical_depths(_filtered_values(shown, found, scene.slice_spacing)) <= 0.0
        small += float(shown.covers[found].sum()) * alone
        hidden += float(shown.covers[found][gone].sum()) * alone
    return Small(small / covered, hidden / covered) if covered > 0.0 else Small()


def unmet_kernels(scene: Scene, camera: Camera, size: tuple[int, int]) -> Unmet:
    """Return what a scene has of kernels that no slice meets, as a camera sees it without a filter."""
    low, high = _centres(scene)
    middle = float(_depths(np.asarray([0.5 * (low + high)]), camera)[0])
    covered, unmet, count, thinnest = 0.0, 0.0, 0, math.inf
    for shown in _shown(scene, camera, size):
        # Slices lie at middle + (n + 1/2) spacing.
        place = (shown.depths - middle) / scene.slice_spacing - 0.5
        missed = np.abs(place - np.round(place)) * scene.slice_spacing >= shown.halves
        covered += float(shown.covers.sum()) * shown.step
        unmet += float(shown.covers[missed].sum()) * shown.step
        count += int(missed.sum()) * shown.step
        thinnest = min(thinnest, float(np.min(shown.halves[missed], initial=math.inf)))
    return Unmet(unmet / covered, count, thinnest) if covered > 0.0 else Unmet()


def may_be_thin(scene: Scene, camera: Camera, size: tuple[int, int]) -> bool:
    """Return whether some scattered kernel, shown or not, is smaller than two pixels or a slice distance."""
    if may_be_flat(scene):
        return True
    thinnest = min((one.scale_range[0] for one in _scattered(scene)), default=math.inf)
    pixel = _pixel(camera, size)
    if camera.kind == "perspective" and math.isfinite(thinnest):
        corners = np.array(np.meshgrid(*zip(*_centres(scene), strict=True))).reshape(3, -1).T
        pixel *= max(float(_depths(corners, camera).max()), camera.near)
    return thinnest < pixel


def may_be_flat(scene: Scene) -> bool:
    """Return whether some scattered kernel, shown or not, is thinner than a slice distance."""
    return any(2.0 * one.scale_range[0] < scene.slice_spacing for one in _scattered(scene))


def _scattered(scene: Scene) -> list[EllipsoidField]:
    return [one for one in scene.fields if isinstance(one, EllipsoidField) and one.size > one.ghosts]


def _shown(scene: Scene, camera: Camera, size: tuple[int, int]) -> Iterator[_Shown]:
    """Yield the kernels of each scattered field that show and lie in the picture."""
    for group, function in zip(scene.groups, scene.transfer_functions, strict=True):
        for field in group:
            if isinstance(field, EllipsoidField) and field.size > field.ghosts:
                found = partial(optical_depths, scene=scene, function=function)
                yield _shown_of(field, found, camera, size)


def _shown_of(
    field: EllipsoidField, optical: Callable[[Floats], Floats], camera: Camera, size: tuple[int, int]
) -> _Shown:
    known = field.size - field.ghosts
    step = max(1, math.ceil(known / _MOST))
    picked = np.arange(0, known, step)
    if field.weights is not None:
        picked = picked[field.weights[picked] > 0]
    pixel = _pixel(camera, size)
    depths, inside = _in_picture(field.centers[picked], camera, size, pixel)
    thickness = optical(_values(field, picked))
    kept = inside & (thickness > 0)
    picked, depths, opacity = picked[kept], depths[kept], -np.expm1(-thickness[kept])
    pixels = pixel * depths if camera.kind == "perspective" else np.full(len(depths), pixel)
    axes = np.einsum("ai,nij->naj", camera_axes(camera), field.native.shapes(picked))
    # The projection's semi-axes are the singular values of the first two rows.
    a, b = np.sum(axes[:, 0] ** 2, axis=1), np.sum(axes[:, 1] ** 2, axis=1)
    c = np.sum(axes[:, 0] * axes[:, 1], axis=1)
    area = np.sqrt(np.maximum(a * b - c * c, 0.0))
    widths = area / np.sqrt(0.5 * (a + b + np.hypot(a - b, 2.0 * c)))
    halves = np.linalg.norm(axes[:, 2], axis=1)
    return _Shown(field, step, picked, axes, depths, pixels, halves, widths, opacity * area, optical)


def _share_alone(field: EllipsoidField, picked: NDArray[np.int64]) -> float:
    """Return the share of kernels that stand alone."""
    if not len(picked):
        return 0.0
    some = picked[:: math.ceil(len(picked) / _ENOUGH)]
    own = 1.0 if field.weights is None else field.weights[some]
    return float(np.mean(field.weight_at(field.centers[some]) < _ALONE * own))


def _filtered_values(shown: _Shown, which: NDArray[np.bool_], spacing: float) -> Floats:
    """Return the scalar that a kernel alone would have at its centre with the filter (conventions, section 10)."""
    field, picked, axes = shown.field, shown.picked[which], shown.axes[which]
    added = np.zeros((len(picked), 3, 3))
    added[:, 0, 0] = added[:, 1, 1] = 0.5 * field.falloff * np.square(shown.pixels[which])
    added[:, 2, 2] = 0.5 * field.falloff * spacing * spacing
    own = axes @ np.swapaxes(axes, 1, 2)
    height = np.sqrt(np.maximum(np.linalg.det(own), 0.0) / np.linalg.det(own + added))
    if field.normalization == "threshold":
        weights = 1.0 if field.weights is None else field.weights[picked]
        height = np.minimum(height * weights / field.w0, 1.0)
    return np.asarray(_values(field, picked) * height)


def _values(field: EllipsoidField, picked: NDArray[np.int64]) -> Floats:
    """Return the scalar that a kernel alone would have at its centre."""
    values = field.values[picked]
    if field.weights is not None:
        values = values * field.weights[picked]
    if field.normalization == "threshold":
        return np.asarray(field.values[picked])
    return np.asarray(values / field.native.lattice_constant if field.normalization == "lattice" else values)


def optical_depths(values: Floats, scene: Scene, function: TransferFunction) -> Floats:
    """Return the optical depth over the reference length of values; in modes without opacity 1 where they count."""
    if scene.mode == "isosurface":
        lowest = min((value for value, opacity in scene.surfaces if opacity > 0), default=math.inf)
        return np.where(values >= lowest, 1.0, 0.0)
    if scene.mode != "composite":
        return np.where(values != 0.0, 1.0, 0.0)
    found: Floats = -np.log1p(-np.minimum(function.at(values)[..., 3], 1.0 - 1e-9))
    return found


def _pixel(camera: Camera, size: tuple[int, int]) -> float:
    """Return the width of a pixel, world units; in perspective at a depth of 1."""
    if camera.kind == "orthographic":
        return camera.height / size[1]
    return 2.0 * math.tan(0.5 * math.radians(camera.fov_y)) / size[1]


def _depths(points: Floats, camera: Camera) -> Floats:
    """Return depths of points (N, 3) before the camera."""
    back = camera_axes(camera)[2]
    found: Floats = -((points - np.asarray(camera.eye)) @ back)
    return found


def _in_picture(
    points: Floats, camera: Camera, size: tuple[int, int], pixel: float
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the depths of points, and which of them lie in the picture."""
    right, up, back = camera_axes(camera)
    away = points - np.asarray(camera.eye)
    depth = -(away @ back)
    width = pixel * np.maximum(depth, 0.0) if camera.kind == "perspective" else pixel
    x, y = (one * size[1] * width for one in camera.shift)
    inside = (np.abs(away @ right - x) <= 0.5 * size[0] * width) & (np.abs(away @ up - y) <= 0.5 * size[1] * width)
    if camera.kind == "perspective":
        inside &= depth > camera.near
    return depth, inside


def _centres(scene: Scene) -> tuple[Floats, Floats]:
    """Return the corners of the box around the centres of all kernels, which anchors the slices."""
    boxes = [one.centre_bounds for one in scene.fields if one.size]
    corners = np.asarray(boxes, dtype=np.float64)
    return corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
