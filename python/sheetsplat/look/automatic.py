"""A transfer function that shows something useful when nobody gave one: from the histogram of the scalar."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.fields import EllipsoidField, Field, RegularField

# More samples than this do not change a histogram.
_ENOUGH = 1_000_000
_BINS = 512
TOP_OPACITY = 0.5
# Few bright samples, metal for instance, must not push everything else to the dark end.
_TOP_PERCENTILE = 99.0
# A ramp that begins flat lets the eye into soft things and still shows thin ones.
_RAMP_POWER = 1.5
_RAMP_POINTS = 9
# Places at which scattered fields are looked at.
_PLACES = 16_384
# Where thousands of kernels reach each place, fewer do: so many at least, and so many summands all told.
_FEW_PLACES = 256
_SUMMANDS = 1e8
# Volumes are some hundred slices deep, and their opacities are meant for that; the slices of scattered data may be
# many more.
_USUAL_SLICES = 300.0
_OUTLIERS = 1.0
# Largest value over the limits' difference; sums of float32 resolve about twice that within the pictures' bound.
_WIDEST = 20.0
_EXTREMES = 256

_log = logging.getLogger("sheetsplat")


@dataclass(frozen=True)
class Look:
    """What `choose` found.

    Attributes
    ----------
    clim
        Values at which the colormap begins and ends.
    opacity
        Pairs (value, opacity per reference length).
    surface
        Value that parts things from background.
    top_opacity
        The largest of these opacities that suits things as thick as this.
    slice_spacing
        Distance of slices in world units that shows borders smooth; None: what the fields have.
    """

    clim: tuple[float, float]
    opacity: tuple[tuple[float, float], ...]
    surface: float
    top_opacity: float = TOP_OPACITY
    slice_spacing: float | None = None


def _samples(samples: NDArray[Any]) -> NDArray[np.float64]:
    flat = samples.reshape(-1)
    # An odd stride does not fall into step with the rows of the array.
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
    # Empty bins between two classes all split alike: take the middle of them.
    best = np.flatnonzero(spread >= spread.max() * (1 - 1e-12))
    return float(0.5 * (edges[1:-1][best[0]] + edges[1:-1][best[-1]]))


def choose(fields: Sequence[Field]) -> Look:
    """Return limits and opacities for fields, by the one with the most kernels.

    Regular fields are judged by their samples, scattered ones by the scalar at places that lie the denser the more
    kernels' volumes there are (`places_in`).
    """
    field = max(fields, key=lambda one: one.size)
    if isinstance(field, RegularField):
        return choose_for(field.values)
    if not isinstance(field, EllipsoidField):
        raise TypeError(f"automatic.choose: {type(field).__name__}")
    places = places_in(field)
    look = _wide_enough(choose_for(field.at(affordable_places_in(field))), field)
    spacing = min(one.default_slice_spacing for one in fields if one.size) if places.size else 1.0
    usual = _usual_spacing(places, spacing)
    share = min(1.0, spacing / usual)
    # Opacity of a shorter length: 1 - (1 - a)^share.
    scaled = tuple((value, -math.expm1(share * math.log1p(-opacity))) for value, opacity in look.opacity)
    top_opacity = -math.expm1(share * math.log1p(-TOP_OPACITY))
    # A weighted mean ends abruptly where the weights do, and slices that are few leave steps there.
    finer = max(0.5 * spacing, usual) if usual < spacing else None
    return replace(look, opacity=scaled, top_opacity=top_opacity, slice_spacing=finer)


def _wide_enough(look: Look, field: EllipsoidField) -> Look:
    """Return a look whose limits let the largest values be summed within the pictures' bound.

    Where nearly all of the volume holds next to nothing, and a few small kernels thousands of times more, limits that
    suit the volume would be too narrow.
    """
    low, high = look.clim
    known = np.abs(field.values[: field.size - field.ghosts])
    extremes = np.argpartition(known, -_EXTREMES)[-_EXTREMES:] if known.size > _EXTREMES else slice(None)
    places = field.centers[: known.size][extremes]
    largest = float(np.abs(field.at(places)).max(initial=0.0))
    if field.normalization == "threshold" and field.weight_at(places).max(initial=0.0) >= field.w0:
        # The mean of a large value and small ones around it is formed of the large one's sum.
        largest = max(largest, float(known.max()))
    if not _WIDEST * (high - low) < largest < math.inf:
        return look
    _log.warning(
        "values up to %g lie in a field that is mostly below %g, and are shown at the cost of the others; "
        "their logarithm, log=True of sheetsplat.open, would show both",
        largest,
        high,
    )
    stretch = largest / (_WIDEST * (high - low))
    pairs = tuple((low + (value - low) * stretch, opacity) for value, opacity in look.opacity)
    return replace(look, clim=(low, low + (high - low) * stretch), opacity=pairs)


def _usual_spacing(places: NDArray[np.float64], spacing: float) -> float:
    """Return the slice distance of a volume that is as large as what lies at these places, else `spacing`."""
    if not places.size:
        return spacing
    low, high = np.percentile(places, (_OUTLIERS, 100.0 - _OUTLIERS), axis=0)
    return math.hypot(*(high - low).tolist()) / _USUAL_SLICES or spacing


def _affordable(field: EllipsoidField) -> int:
    """Return at how many places the scalar can be asked for: fewer where very many kernels reach each of them."""
    few = places_in(field, _FEW_PLACES)
    heaviest = field.weight_range[1]
    # A kernel adds its weight to W at most, and a tenth of it on the average.
    crowd = 10.0 * float(np.median(field.weight_at(few))) / heaviest if few.size and heaviest > 0 else 0.0
    return int(min(_PLACES, max(_FEW_PLACES, _SUMMANDS / max(crowd, 1.0))))


def affordable_places_in(field: EllipsoidField) -> NDArray[np.float64]:
    """Return as many places in a scattered field, (M, 3), as the scalar can be asked for at."""
    return places_in(field, _affordable(field))


def places_in(field: EllipsoidField, count: int = _PLACES) -> NDArray[np.float64]:
    """Return places in a scattered field, (M, 3), as many in each kernel as its volume's share of all volumes says.

    They lie in the inner halves of the supports, the same ones every time; M is 0 where there are no kernels, ghost
    points left aside.
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
        # Only kernels so thin that products of their semi-axes vanish.
        ends = np.arange(1.0, known + 1.0)
    picked = np.searchsorted(ends, (np.arange(count) + 0.5) / count * ends[-1], side="right").clip(max=known - 1)
    generator = np.random.default_rng(2006)
    inner = generator.normal(size=(count, 3))
    inner *= (0.5 * generator.random(count) ** (1 / 3) / np.linalg.norm(inner, axis=1))[:, np.newaxis]
    shapes = field.native.shapes(picked.astype(np.int64))
    found: NDArray[np.float64] = field.centers[picked] + np.einsum("nij,nj->ni", shapes, inner)
    return found


def choose_for(samples: NDArray[Any]) -> Look:
    """Return limits and opacities for samples, finite or NaN."""
    values = _samples(samples)
    # Differences of the largest numbers must not overflow; a power of two costs no digits.
    scale = 4.0 if values.size and float(np.abs(values).max()) > 1e307 else 1.0
    look = _choose(values / scale)
    pairs = tuple((value * scale, opacity) for value, opacity in look.opacity)
    return Look((look.clim[0] * scale, look.clim[1] * scale), pairs, look.surface * scale)


def _choose(values: NDArray[np.float64]) -> Look:
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
    if not low < high:
        # One value everywhere: show it, half transparent.
        width = max(abs(low), 1.0) * 1e-3
        return Look((low - width, high + width), ((low - width, 0.05), (high + width, 0.05)), low)
    # Low values spread little and high ones much; their roots spread alike, so that thin branches and faint shells stay
    # with the things and not with the background.
    start = low + _between_classes(np.sqrt(values - low)) ** 2
    shown = values[values > start]
    top = float(np.percentile(shown, _TOP_PERCENTILE)) if shown.size else high
    if not start < top:
        top = high
    if not start < top:
        # Two neighbours among the numbers.
        start = low
    share = np.linspace(0.0, 1.0, _RAMP_POINTS)
    opacity = TOP_OPACITY * share**_RAMP_POWER
    pairs = zip((start + share * (top - start)).tolist(), opacity.tolist(), strict=True)
    return Look((start, top), tuple(pairs), start)
