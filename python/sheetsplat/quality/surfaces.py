"""The distance of slices that isosurfaces of scattered kernels call for, where these are of very different size."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sheetsplat.camera import Camera
from sheetsplat.fields import joined_bounds
from sheetsplat.look.visible import camera_axes
from sheetsplat.quality.thin import ShownKernels, shown_kernels, widest_pixel
from sheetsplat.scene import Scene

# Slices a pixel, and in the length of a ray in a kernel.
_PER_PIXEL, _PER_KERNEL = 2.0, 8.0
# Share of the surfaces in which there may be fewer in a kernel.
_THINNER = 0.05
# Kernels of a field that are looked at; of more, every n-th.
_MOST = 2048


def spacing_for_surfaces(scene: Scene, camera: Camera, size: tuple[int, int], least: float = 0.0) -> float:
    """Return the distance of slices that the kernels call for through which isosurfaces pass.

    The default one is that of the thinnest kernels, wherever they are. Light changes from pixel to pixel along a
    surface as it does from slice to slice, so that slices far closer than pixels show nothing more. World units; 0
    without such kernels, and where pixels alone tell that it is not above `least`.
    """
    if widest_pixel(camera, size, joined_bounds([one.bounds for one in scene.fields])) <= least * _PER_PIXEL:
        return 0.0
    wanted, covers = [np.zeros(0)], [np.zeros(0)]
    for shown in shown_kernels(scene, camera, size):
        each = max(1, math.ceil(len(shown.picked) / _MOST))
        some = np.arange(0, len(shown.picked), each)
        met = some[_are_met(scene, shown, some, camera)]
        axes = shown.axes[met]
        # A flat kernel that leans is long along the view, and each ray is in little of it.
        areas = np.linalg.norm(np.cross(axes[:, 0], axes[:, 1]), axis=1)
        lengths = 2.0 * np.abs(np.linalg.det(axes)) / np.maximum(areas, np.finfo(float).tiny)
        wanted.append(np.minimum(shown.pixels[met] / _PER_PIXEL, lengths / _PER_KERNEL))
        covers.append(shown.covers[met] * (each * shown.step))
    distances, weights = np.concatenate(wanted), np.concatenate(covers)
    order = np.argsort(distances)
    summed = np.cumsum(weights[order])
    return float(distances[order[np.searchsorted(summed, _THINNER * summed[-1])]]) if len(order) else 0.0


def _are_met(scene: Scene, shown: ShownKernels, some: NDArray[np.int64], camera: Camera) -> NDArray[np.bool_]:
    """Return through which of some kernels a surface passes: between their centres and the ends of their semi-axes."""
    axes = np.einsum("ai,naj->jni", camera_axes(camera), shown.axes[some])
    points = shown.field.centers[shown.picked[some]] + np.stack([*axes, *-axes, np.zeros_like(axes[0])])
    group = next(group for group in scene.groups if any(one is shown.field for one in group))
    found = [one.scalars_and_weights(points.reshape(-1, 3))[0] for one in group]
    scalars = np.sum(found, axis=0).reshape(points.shape[:2])
    values = np.array([value for value, opacity in scene.surfaces if opacity > 0])[:, None]
    met: NDArray[np.bool_] = ((scalars.min(axis=0) < values) & (values <= scalars.max(axis=0))).any(axis=0)
    return met
