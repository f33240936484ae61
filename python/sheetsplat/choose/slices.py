"""The distance of slices: `slice_spacing` decides on it; the rest says what data, and their light, call for."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from sheetsplat.camera import Camera
from sheetsplat.choose.asked import Asked, Level
from sheetsplat.choose.decisions import AS_GIVEN, Decision
from sheetsplat.fields import EllipsoidField, Field, RegularField, default_spacing
from sheetsplat.look.histogram import Look
from sheetsplat.look.measure import Floats
from sheetsplat.modes import TRAITS
from sheetsplat.options.core import COLORED, COMPOSITE
from sheetsplat.quality.slicing import (
    SLICES,
    can_be_estimated,
    depth_extent,
    has_lit_kernels,
    shows_scattered_alone,
    slicing_error,
)
from sheetsplat.quality.surfaces import spacing_for_surfaces
from sheetsplat.quality.thin import LEAST_UNMET, slices_for_ends, unmet_kernels
from sheetsplat.scene import Scene

Size = tuple[int, int]
# Of pictures of numbers: slices for each smallest semi-axis of a kernel, as in the default distance, and kernels that
# count at most. A distance takes the place of the default one if it is so many times finer. One of isosurfaces, which
# is less accurate, if it is so many times coarser.
_PER_SEMI_AXIS = 2.0
_FINER = 2.0
_COARSER = 3.0
_MOST = 1_000_000
# How many times the estimate for scattered kernels a picture may be off: errors fall with the distance and not with its
# square where kernels are thinner than it (1.1 to 1.9 measured).
_OF_KERNELS = 1.7


def error_of_light(scene: Scene, asked: Asked, camera: Camera, size: Size) -> float | None:
    """Return the estimated error of lit volumes with `SLICES` slices to a default one; None: it does not count."""
    if asked.level.lit is None or asked.free or "slice_spacing" in asked or not can_be_estimated(scene):
        return None
    return slicing_error(scene, camera, size)


def slice_spacing(
    scene: Scene, asked: Asked, seen: tuple[Camera, Size] | None = None, light: float | None = None, samples: int = 1
) -> Decision:
    """Return the distance of slices of a picture, world units.

    Parameters
    ----------
    scene
        Its own distance is what was given, or what the data call for (`spacing_of_data`).
    asked
        What the caller asked for.
    seen
        The camera and the size of the picture, (width, height) in pixels; None while there is no camera yet: then the
        distance is that of any view.
    light, samples
        The error of its light (`error_of_light`), and the samples a pixel for which light calls.
    """
    spacing, level = scene.slice_spacing, asked.level
    if "slice_spacing" in asked:
        return Decision("slice_spacing", spacing, AS_GIVEN, "caller")
    if asked.free:
        return Decision("slice_spacing", spacing, "chosen anew by max_error or max_seconds", "caller")
    if light is not None and level.lit is not None:
        most, least, at_most = level.lit
        least = level.samples[1] if level.samples is not None and samples > 1 else least
        slices = min(max(level.slices_for(light), least), at_most)
        reason = f"1/{slices} of the default: an estimated error of {light * SLICES / slices:.1e} by slices"
        return Decision("slice_spacing", default_spacing(scene.fields) / slices, reason, "quality")
    by_data = scene.options["slice_spacing"] is not None
    decided = Decision("slice_spacing", spacing, "the default", "data" if by_data else "default")
    if (more := slices_more(level, scene)) != 1:
        reason = f"1/{more} of the default, so that slices do not show"
        decided = Decision("slice_spacing", spacing / more, reason, "quality")
    if seen is not None and has_lit_kernels(scene):
        return _fewer(scene, level, seen, decided)
    if seen is not None and TRAITS[scene.mode].shows_surfaces and shows_scattered_alone(scene):
        return _of_surfaces(scene, level, seen, decided)
    if seen is not None and level.filters and (whole := slices_for_ends(scene, seen[0])) is not None:
        reason = "whole slabs of the volume, or of a box that cuts, so that an x-ray has its mass"
        return Decision("slice_spacing", whole, reason, "quality")
    return decided


def _fewer(scene: Scene, level: Level, seen: tuple[Camera, Size], usual: Decision) -> Decision:
    """Return fewer slices of scattered kernels than usual where thin kernels that hardly show call for many."""
    (most, first), (camera, size) = level.few, seen
    extent = depth_extent(scene, camera)
    for slices in (first, 2 * first):
        if extent <= 2 * slices * usual.value:
            break
        coarse = scene.sketch(slice_spacing=extent / slices)
        error = _OF_KERNELS * slicing_error(coarse, camera, size, SLICES * coarse.slice_spacing)
        if error <= most and unmet_kernels(coarse, camera, size).share < LEAST_UNMET:
            reason = f"{slices} slices, and not those of the thinnest kernels: an estimated error of {error:.1e}"
            return Decision("slice_spacing", coarse.slice_spacing, reason, "quality")
    return usual


def _of_surfaces(scene: Scene, level: Level, seen: tuple[Camera, Size], usual: Decision) -> Decision:
    """Return fewer slices of isosurfaces than usual where thin kernels of which they show little call for many."""
    more = slices_more(level, scene)
    least = _COARSER * usual.value
    wanted = spacing_for_surfaces(scene, *seen, least * more) / more
    if wanted <= least:
        return usual
    if unmet_kernels(scene.sketch(slice_spacing=wanted), *seen).share >= LEAST_UNMET:
        return usual
    reason = "that of pixels and of the kernels in which surfaces lie, and not of the thinnest kernels"
    return Decision("slice_spacing", wanted, reason, "quality")


def slices_more(level: Level, scene: Scene) -> int:
    """Return how many slices a quality takes in place of one of the default distance."""
    volumes = [one for one in scene.fields if isinstance(one, RegularField)]
    plain = not any(one.prefilter for one in volumes)
    counts = level.scattered if not volumes else level.plain_volumes if plain else level.volumes
    kind = "unlit" if TRAITS[scene.mode].is_composited and not scene.lights else scene.mode
    return counts.get(kind, counts.get(scene.mode, 1))


def spacing_of_data(fields: Sequence[Field], mode: str, look: Look | None) -> float | None:
    """Return the distance of slices that data call for in a mode, under a look that was chosen; None: the default."""
    if mode in COMPOSITE:
        return None if look is None else look.slice_spacing
    if mode not in COLORED:
        return _of_numbers(fields)
    if not any(isinstance(one, EllipsoidField) and one.size for one in fields):
        return None
    # The crossing is found between two slices by linear interpolation, which two slices in a kernel's thickness do not
    # allow. The reference length, and with it the meaning of opacities, stays.
    spacing = default_spacing(fields) / 4
    return spacing if look is None or look.reference_length is None else min(spacing, look.reference_length)


def _of_numbers(fields: Sequence[Field]) -> float | None:
    """Return the distance of slices that kernels call for by what they add to a picture of numbers, or None.

    The default distance is that of the median kernel. Where values go over decades, as densities of SPH do, few and
    small kernels make what is seen: here each kernel counts as much as it adds to the sum of the picture's squares, the
    square of its line integral times its area. None where that is not far below the default, and for other fields.
    """
    known = [one for one in fields if one.size]
    scattered = [one for one in known if isinstance(one, EllipsoidField)]
    if not known or len(scattered) < len(known):
        return None
    thinnest: list[Floats] = []
    shares: list[tuple[Floats, Floats]] = []
    for one in scattered:
        some = slice(None, None, math.ceil(one.size / _MOST))
        scales = one.scales[some]
        axes = np.repeat(scales[:, None], 3, axis=1) if scales.ndim == 1 else scales
        sizes = np.exp(np.log(axes).mean(axis=1))
        values = np.abs(one.values[some].astype(np.float64) - one.base)
        if one.normalization == "none" and one.weights is not None:
            values = values * one.weights[some]
        thinnest.append(axes.min(axis=1))
        shares.append((values, sizes))
    # Relative to the largest, so that powers stay finite.
    value = max(float(values.max()) for values, _ in shares)
    size = max(float(sizes.max()) for _, sizes in shares)
    if not (value > 0.0 and math.isfinite(value)):
        return None
    added = np.concatenate([(values / value) ** 2 * (sizes / size) ** 4 for values, sizes in shares])
    lengths = np.concatenate(thinnest)
    order = np.argsort(lengths)
    summed = np.cumsum(added[order])
    if not summed[-1] > 0.0:
        return None
    median = float(lengths[order[np.searchsorted(summed, 0.5 * summed[-1])]])
    spacing = median / _PER_SEMI_AXIS
    return spacing if spacing * _FINER < default_spacing(known) else None
