"""Automatic transfer functions, chosen by the histogram of the scalar and, of scattered data, by optical depths."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.errors import option_ref
from sheetsplat.fields import EllipsoidField, Field, RegularField, default_spacing
from sheetsplat.fields.samples import Samples
from sheetsplat.look.histogram import Look, beyond_pictures, choose_for, scaled_opacity, without_outliers
from sheetsplat.look.measure import with_values
from sheetsplat.look.surface import SURFACE_SHARE
from sheetsplat.look.transparency import see_through
from sheetsplat.notices import warn

# Opacity of solids at shares of their value: nothing at their border, and opaque within a kernel's radius.
_SOLID = ((0.25, 0.0), (0.75, 0.9))
# Kernels at whose centres weights are summed to tell a solid.
_FEW_KERNELS = 500
# Number of positions at which a scattered field is sampled.
_PLACES = 16_384
# Where thousands of kernels overlap, fewer positions suffice: at least so many, with so many summands in total.
_FEW_PLACES = 256
_SUMMANDS = 2e7
# The opacities suit volumes of some hundred slices; scattered data may have many more.
_USUAL_SLICES = 300.0
_OUTLIERS = 1.0
# Largest ratio of a value to the width of the limits: half of what sums of float32 resolve within the error bound.
_WIDEST = 20.0
_EXTREMES = 256
# Distance of slices, in radii of the kernels that are shown, where those are far smaller than the others.
_DENSE_SPACING = 0.4
# Least distance of slices in default ones where borders would show steps, hatching of lit layers.
_BORDER_SPACING = 0.25
# Samples across a field that was encoded from a volume.
_SAMPLES_ACROSS = 48


def choose(fields: Sequence[Field]) -> Look:
    """Return limits and opacities for fields, by the one with the most kernels.

    Of regular fields the samples count, of scattered ones the scalar at positions inside the kernels, as many in each
    as its share of the volume (`places_in`).
    """
    field = max(fields, key=lambda one: one.size)
    if isinstance(field, EllipsoidField) and field.bound is not None and field.domain is not None:
        field = _as_volume(field)
    if isinstance(field, RegularField):
        _warn_of_extremes(field.samples)
        return choose_for(field.samples, decades=field.quantity.floor is not None, spacing=field.spacing)
    if not isinstance(field, EllipsoidField):
        raise TypeError(f"automatic.choose: {type(field).__name__}")
    solid = _of_solid(field)
    if solid is not None:
        return solid
    _warn_of_extremes(field.values)
    field = _without_outlying_kernels(field)
    places, (few, affordable) = places_in(field), _looked_at(field)
    if field.quantity.floor is not None and places.size:
        # Decades: of particles most count where they are dense, not where they are large.
        known = slice(0, field.size - field.ghosts)
        look = choose_for(field.values[known], decades=True)
        dense = field.values[known] > look.surface
        if np.count_nonzero(dense) > 1:
            dense_look = _of_dense(look, field.centers[known][dense], field.scales[known][dense])
            return see_through(dense_look, field, field.default_slice_spacing, affordable)
    else:
        # Of simulations, which most scattered data are, the extremes are wanted: a flame is small.
        # Hardly more positions are not worth the time.
        values = field.at(places_in(field, affordable)) if affordable >= 2 * _FEW_PLACES else few
        look = _wide_enough(choose_for(values, extremes=True), field)
    spacing = default_spacing(fields) if places.size else 1.0
    usual = _usual_spacing(places, spacing)
    share = min(1.0, spacing / usual)
    # A weighted mean ends abruptly at the border of the weights; too few slices leave visible steps there.
    finer = max(_BORDER_SPACING * spacing, usual) if usual < spacing else None
    return see_through(replace(scaled_opacity(look, share), slice_spacing=finer), field, spacing, affordable)


def _as_volume(field: EllipsoidField) -> RegularField:
    """Return a volume of few samples of a field that was encoded from one: its look is that of a volume."""
    low, high = (np.asarray(corner) for corner in field.bounds)
    counts = np.maximum(2, np.rint((high - low) / (high - low).max() * _SAMPLES_ACROSS)).astype(int)
    spacing = (high - low) / counts
    grid = np.stack(np.meshgrid(*(np.arange(count) + 0.5 for count in counts), indexing="ij"), axis=-1)
    values = field.at(low + grid.reshape(-1, 3) * spacing).reshape(counts).transpose(2, 1, 0)
    x, y, z = spacing.tolist()
    return RegularField(np.ascontiguousarray(values), spacing=(x, y, z)).of_quantity(field.quantity)


def _of_solid(field: EllipsoidField) -> Look | None:
    """Return a look of kernels of one value, of which there is nothing to see but the surface; None for any others.

    A translucent solid would be dark: light needs gradients, and inside there are none.
    """
    low, high = field.value_range if not field.ghosts else (0.0, 0.0)
    if not low == high != 0.0 or field.normalization != "threshold" or field.quantity.floor is not None:
        return None
    # Where weights stay below w0, the scalar is a sum that is far from the value.
    some = field.centers[:: max(1, field.size // _FEW_KERNELS)]
    if float(np.median(field.scalars_and_weights(some)[1])) < field.w0:
        return None
    ends = sorted((0.0, low / SURFACE_SHARE))
    opacity = sorted((share * low, part) for share, part in _SOLID)
    # Opacity rises across a fraction of a kernel: coarser slices show as contour lines on the surface.
    spacing = _BORDER_SPACING * field.default_slice_spacing
    return Look((ends[0], ends[1]), tuple(opacity), 0.5 * low, _SOLID[-1][1], slice_spacing=spacing)


def _warn_of_extremes(values: NDArray[Any] | Samples) -> None:
    if (found := beyond_pictures(values)) is not None:
        worst, low, high = found
        warn(
            f"few values up to {worst:g} lie so far beyond all others, {low:g} to {high:g}, that nothing else can be "
            "seen; leave them out, in volumes as NaN with " + option_ref("nan", "skip")
        )


def _without_outlying_kernels(field: EllipsoidField) -> EllipsoidField:
    """Return a field in which outliers have the value of the nearest other kernel, else the field itself.

    Where kernels overlap, a single one of them sets the values of all positions in its support.
    """
    known = field.values[: field.size - field.ghosts]
    values = without_outliers(known, known)
    return field if values is known else with_values(field, np.concatenate((values, field.values[len(known) :])))


def _of_dense(look: Look, centers: NDArray[np.float64], scales: NDArray[np.float64]) -> Look:
    """Return a look whose lengths are those of the kernels that it shows, which may be far smaller than the others."""
    thinnest = scales if scales.ndim == 1 else scales.min(axis=1)
    spacing = _DENSE_SPACING * float(np.median(thinnest))
    share = min(1.0, spacing / _usual_spacing(centers, spacing))
    return replace(scaled_opacity(look, share), slice_spacing=spacing, reference_length=spacing)


def _wide_enough(look: Look, field: EllipsoidField) -> Look:
    """Return a look with limits wide enough to sum the largest values within the error bound of pictures.

    Where most of the volume has small values and a few small kernels thousands of times larger ones, limits chosen for
    the volume would be too narrow.
    """
    low, high = look.clim
    known = np.abs(field.values[: field.size - field.ghosts] - field.base)
    extremes = np.argpartition(known, -_EXTREMES)[-_EXTREMES:] if known.size > _EXTREMES else slice(None)
    places = field.centers[: known.size][extremes]
    scalars, weights = field.scalars_and_weights(places)
    largest = float(np.abs(scalars - field.base).max(initial=0.0))
    if field.normalization == "threshold" and weights.max(initial=0.0) >= field.w0:
        # The weighted mean of a large value and small neighbours is computed from the sum of the large one.
        largest = max(largest, float(known.max()))
    if not _WIDEST * (high - low) < largest < math.inf:
        return look
    which = "up to" if field.base == 0.0 else "that differ from the base by"
    warn(
        f"values {which} {largest:g} lie in a field that is mostly below {high:g}: showing them leaves little contrast "
        "for the others; their logarithm, " + option_ref("log", "true") + ", would show both"
    )
    stretch = largest / (_WIDEST * (high - low))
    # Of values on both sides of a level that one stays.
    fixed = low if look.cmap is None else 0.5 * (low + high)
    pairs = tuple((fixed + (value - fixed) * stretch, opacity) for value, opacity in look.opacity)
    return replace(look, clim=(fixed + (low - fixed) * stretch, fixed + (high - fixed) * stretch), opacity=pairs)


def _usual_spacing(places: NDArray[np.float64], spacing: float) -> float:
    """Return the usual slice distance of a volume as large as the box around these positions, else `spacing`."""
    if not places.size:
        return spacing
    low, high = np.percentile(places, (_OUTLIERS, 100.0 - _OUTLIERS), axis=0)
    return math.hypot(*(high - low).tolist()) / _USUAL_SLICES or spacing


def _looked_at(field: EllipsoidField) -> tuple[NDArray[np.float64], int]:
    """Return the scalar at a few positions, and at how many it can be evaluated: fewer where many kernels overlap."""
    scalars, weights = field.scalars_and_weights(places_in(field, _FEW_PLACES))
    heaviest = field.weight_range[1]
    # A kernel contributes at most its weight to W, and a tenth of it on average.
    crowd = 10.0 * float(np.median(weights)) / heaviest if weights.size and heaviest > 0 else 0.0
    return scalars, int(min(_PLACES, max(_FEW_PLACES, _SUMMANDS / max(crowd, 1.0))))


def scalars_in(field: EllipsoidField) -> NDArray[np.float64]:
    """Return the scalar at positions in a scattered field, (M,); where thousands of kernels overlap, at a few."""
    few, affordable = _looked_at(field)
    return field.at(places_in(field)) if affordable == _PLACES else few


def places_in(field: EllipsoidField, count: int = _PLACES) -> NDArray[np.float64]:
    """Return positions in a scattered field, (M, 3): in each kernel as many as its share of the volume.

    They lie in the inner halves of the supports and are the same in every call. M is 0 where there are no kernels
    except ghost points.
    """
    known = field.size - field.ghosts
    if not known:
        return np.empty((0, 3))
    scales = field.scales[:known] / field.scale_range[1]
    volumes = scales**3 if scales.ndim == 1 else scales.prod(axis=1)
    if field.weights is not None:
        volumes[field.weights[:known] == 0] = 0.0
    ends = np.cumsum(volumes)
    if not ends[-1] > 0:
        # All kernels are so thin that the products of their semi-axes underflow.
        ends = np.arange(1.0, known + 1.0)
    picked = np.searchsorted(ends, (np.arange(count) + 0.5) / count * ends[-1], side="right").clip(max=known - 1)
    generator = np.random.default_rng(2006)
    inner = generator.normal(size=(count, 3))
    inner *= (0.5 * generator.random(count) ** (1 / 3) / np.linalg.norm(inner, axis=1))[:, np.newaxis]
    shapes = field.native.shapes(picked.astype(np.int64))
    found: NDArray[np.float64] = field.centers[picked] + np.einsum("nij,nj->ni", shapes, inner)
    return found
