"""Automatic transfer functions, chosen by the histogram of the scalar."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.errors import option_ref
from sheetsplat.fields import EllipsoidField, Field, RegularField
from sheetsplat.notices import warn

# More samples than this do not change a histogram.
_ENOUGH = 1_000_000
_BINS = 512
TOP_OPACITY = 0.5
# Few bright samples, metal for instance, must not push everything else to the dark end.
_TOP_PERCENTILE = 99.0
# A ramp that starts flat keeps soft material transparent and still shows thin structures.
_RAMP_POWER = 1.5
_RAMP_POINTS = 9
# Number of positions at which a scattered field is sampled.
_PLACES = 16_384
# Where thousands of kernels overlap, fewer positions suffice: at least so many, with so many summands in total.
_FEW_PLACES = 256
_SUMMANDS = 1e8
# The opacities suit volumes of some hundred slices; scattered data may have many more.
_USUAL_SLICES = 300.0
_OUTLIERS = 1.0
# Largest ratio of a value to the width of the limits: half of what sums of float32 resolve within the error bound.
_WIDEST = 20.0
_EXTREMES = 256
# Distance of slices, in radii of the kernels that are shown, where those are far smaller than the others.
_DENSE_SPACING = 0.4


@dataclass(frozen=True)
class Look:
    """Limits and opacities that `choose` found.

    Attributes
    ----------
    clim
        Values at which the colormap begins and ends.
    opacity
        Pairs (value, opacity per reference length).
    surface
        Value that separates objects from background.
    top_opacity
        The largest of these opacities, for objects of this thickness.
    slice_spacing
        Distance of slices in world units that shows borders without steps; None: the default of the fields.
    reference_length
        Length in world units to which these opacities refer; None: the default of the fields.
    """

    clim: tuple[float, float]
    opacity: tuple[tuple[float, float], ...]
    surface: float
    top_opacity: float = TOP_OPACITY
    slice_spacing: float | None = None
    reference_length: float | None = None


def _samples(samples: NDArray[Any]) -> NDArray[np.float64]:
    flat = samples.reshape(-1)
    # An odd stride does not sample the same columns of every row.
    stride = max(1, -(-flat.size // _ENOUGH)) | 1
    picked: NDArray[np.float64] = flat[::stride].astype(np.float64)
    known: NDArray[np.float64] = picked[~np.isnan(picked)]
    return known


def _between_classes(values: NDArray[np.float64]) -> float:
    """Return the threshold that splits values best into two classes (Otsu 1979)."""
    counts, edges = np.histogram(values, bins=_BINS)
    weights = counts / counts.sum()
    centres = 0.5 * (edges[1:] + edges[:-1])
    below = np.cumsum(weights)[:-1]
    moment = np.cumsum(weights * centres)
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = (moment[-1] * below - moment[:-1]) ** 2 / (below * (1 - below))
    spread = np.nan_to_num(spread, nan=-1.0, posinf=-1.0)
    # All empty bins between two classes are equally good thresholds: take the middle of them.
    best = np.flatnonzero(spread >= spread.max() * (1 - 1e-12))
    return float(0.5 * (edges[1:-1][best[0]] + edges[1:-1][best[-1]]))


def choose(fields: Sequence[Field]) -> Look:
    """Return limits and opacities for fields, by the one with the most kernels.

    Of regular fields the samples count, of scattered ones the scalar at positions inside the kernels, as many in each
    as its share of the volume (`places_in`).
    """
    field = max(fields, key=lambda one: one.size)
    if isinstance(field, RegularField):
        return choose_for(field.values, decades=field.quantity.floor is not None)
    if not isinstance(field, EllipsoidField):
        raise TypeError(f"automatic.choose: {type(field).__name__}")
    places = places_in(field)
    if field.quantity.floor is not None and places.size:
        # Decades: of particles most count where they are dense, not where they are large.
        known = slice(0, field.size - field.ghosts)
        look = choose_for(field.values[known], decades=True)
        dense = field.values[known] > look.surface
        if np.count_nonzero(dense) > 1:
            return _of_dense(look, field.centers[known][dense], field.scales[known][dense])
    else:
        look = _wide_enough(choose_for(field.at(affordable_places_in(field))), field)
    spacing = min(one.default_slice_spacing for one in fields if one.size) if places.size else 1.0
    usual = _usual_spacing(places, spacing)
    share = min(1.0, spacing / usual)
    # Opacity of a shorter length: 1 - (1 - a)^share.
    scaled = tuple((value, -math.expm1(share * math.log1p(-opacity))) for value, opacity in look.opacity)
    top_opacity = -math.expm1(share * math.log1p(-TOP_OPACITY))
    # A weighted mean ends abruptly at the border of the weights; too few slices leave visible steps there.
    finer = max(0.5 * spacing, usual) if usual < spacing else None
    return replace(look, opacity=scaled, top_opacity=top_opacity, slice_spacing=finer)


def _of_dense(look: Look, centers: NDArray[np.float64], scales: NDArray[np.float64]) -> Look:
    """Return a look whose lengths are those of the kernels that it shows, which may be far smaller than the others."""
    thinnest = scales if scales.ndim == 1 else scales.min(axis=1)
    spacing = _DENSE_SPACING * float(np.median(thinnest))
    share = min(1.0, spacing / _usual_spacing(centers, spacing))
    scaled = tuple((value, -math.expm1(share * math.log1p(-opacity))) for value, opacity in look.opacity)
    return replace(look, opacity=scaled, top_opacity=scaled[-1][1], slice_spacing=spacing, reference_length=spacing)


def _wide_enough(look: Look, field: EllipsoidField) -> Look:
    """Return a look with limits wide enough to sum the largest values within the error bound of pictures.

    Where most of the volume has small values and a few small kernels thousands of times larger ones, limits chosen for
    the volume would be too narrow.
    """
    low, high = look.clim
    known = np.abs(field.values[: field.size - field.ghosts])
    extremes = np.argpartition(known, -_EXTREMES)[-_EXTREMES:] if known.size > _EXTREMES else slice(None)
    places = field.centers[: known.size][extremes]
    largest = float(np.abs(field.at(places)).max(initial=0.0))
    if field.normalization == "threshold" and field.weight_at(places).max(initial=0.0) >= field.w0:
        # The weighted mean of a large value and small neighbours is computed from the sum of the large one.
        largest = max(largest, float(known.max()))
    if not _WIDEST * (high - low) < largest < math.inf:
        return look
    warn(
        f"values up to {largest:g} lie in a field that is mostly below {high:g}: showing them leaves little contrast "
        "for the others; their logarithm, " + option_ref("log", "true") + ", would show both"
    )
    stretch = largest / (_WIDEST * (high - low))
    pairs = tuple((low + (value - low) * stretch, opacity) for value, opacity in look.opacity)
    return replace(look, clim=(low, low + (high - low) * stretch), opacity=pairs)


def _usual_spacing(places: NDArray[np.float64], spacing: float) -> float:
    """Return the usual slice distance of a volume as large as the box around these positions, else `spacing`."""
    if not places.size:
        return spacing
    low, high = np.percentile(places, (_OUTLIERS, 100.0 - _OUTLIERS), axis=0)
    return math.hypot(*(high - low).tolist()) / _USUAL_SLICES or spacing


def _affordable(field: EllipsoidField) -> int:
    """Return at how many positions the scalar can be evaluated: fewer where very many kernels overlap."""
    few = places_in(field, _FEW_PLACES)
    heaviest = field.weight_range[1]
    # A kernel contributes at most its weight to W, and a tenth of it on average.
    crowd = 10.0 * float(np.median(field.weight_at(few))) / heaviest if few.size and heaviest > 0 else 0.0
    return int(min(_PLACES, max(_FEW_PLACES, _SUMMANDS / max(crowd, 1.0))))


def affordable_places_in(field: EllipsoidField) -> NDArray[np.float64]:
    """Return as many positions in a scattered field, (M, 3), as the scalar can be evaluated at in reasonable time."""
    return places_in(field, _affordable(field))


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


def choose_for(samples: NDArray[Any], *, decades: bool = False) -> Look:
    """Return limits and opacities for samples, finite or NaN; `decades`: they are logarithms."""
    values = _samples(samples)
    # Differences of the largest numbers must not overflow; scaling by a power of two is exact.
    scale = 4.0 if values.size and float(np.abs(values).max()) > 1e307 else 1.0
    look = _choose(values / scale, even=decades)
    pairs = tuple((value * scale, opacity) for value, opacity in look.opacity)
    return Look((look.clim[0] * scale, look.clim[1] * scale), pairs, look.surface * scale)


def _choose(values: NDArray[np.float64], *, even: bool) -> Look:
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
    if not low < high:
        # One value everywhere: show it, almost transparent.
        width = max(abs(low), 1.0) * 1e-3
        return Look((low - width, high + width), ((low - width, 0.05), (high + width, 0.05)), low)
    # Low values vary little and high ones much. Square roots make the variation similar, so that thin branches and
    # faint shells are classified as objects, not as background; logarithms do that already.
    start = low + (_between_classes(values - low) if even else _between_classes(np.sqrt(values - low)) ** 2)
    shown = values[values > start]
    top = float(np.percentile(shown, _TOP_PERCENTILE)) if shown.size else high
    if not start < top:
        top = high
    if not start < top:
        # Two adjacent floating-point numbers.
        start = low
    share = np.linspace(0.0, 1.0, _RAMP_POINTS)
    opacity = TOP_OPACITY * share**_RAMP_POWER
    pairs = zip((start + share * (top - start)).tolist(), opacity.tolist(), strict=True)
    return Look((start, top), tuple(pairs), start)
