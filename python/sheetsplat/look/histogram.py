"""Limits and opacities by the histogram of samples."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.fields.samples import Samples, samples_of
from sheetsplat.look.background import is_above, is_signed, step_of_distances, without_padding

# More samples than this do not change a histogram.
_ENOUGH = 1_000_000
_BINS = 512
TOP_OPACITY = 0.5
# Few bright samples, metal for instance, must not push everything else to the dark end.
_TOP_PERCENTILE = 99.0
# Where the extremes are wanted: limits end at the largest value if that widens them at most so many times.
_WHOLE = 2.0
# A ramp that starts flat keeps soft material transparent and still shows thin structures.
_RAMP_POWER = 1.5
_RAMP_POINTS = 9
# Outliers: this share of the samples on either side, at least one, where they widen the range of the others so many
# times. Up to that, a histogram of square roots still tells the others apart.
_OUTLYING = 1e-4
_APART = 100.0
# Differences of larger numbers may overflow.
_LARGE = 1e307
# Sums of float64 resolve the others beside values up to so many times their range.
_RESOLVED = 1e10
# Colours of values on both sides of a level.
DIVERGING = "coolwarm"
# Opacity of what a surface encloses, at depths below it in sample distances.
_ENCLOSED = ((0.0, 0.0), (1.5, 0.9))


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
    cmap
        Colormap that suits these limits; None: the default.
    """

    clim: tuple[float, float]
    opacity: tuple[tuple[float, float], ...]
    surface: float
    top_opacity: float = TOP_OPACITY
    slice_spacing: float | None = None
    reference_length: float | None = None
    cmap: str | None = None


def scaled_opacity(look: Look, share: float) -> Look:
    """Return a look with the optical depths multiplied by `share`: the opacity a becomes 1 - (1 - a)^share."""

    def scaled(opacity: float) -> float:
        return -math.expm1(share * math.log1p(-opacity))

    pairs = tuple((value, scaled(opacity)) for value, opacity in look.opacity)
    return replace(look, opacity=pairs, top_opacity=scaled(look.top_opacity))


def stride_of(size: int) -> int:
    """Return of how many samples one counts in a histogram. An odd stride does not take the same columns of rows."""
    return max(1, -(-size // _ENOUGH)) | 1


def _samples(samples: Samples) -> NDArray[np.float64]:
    picked: NDArray[np.float64] = samples.every(stride_of(samples.size)).astype(np.float64)
    known: NDArray[np.float64] = picked[~np.isnan(picked)]
    return known


def usual_value(samples: Samples, base: float) -> float:
    """Return the median of the samples that are not missing, without padding where `base` is padding; 0 without any.

    `base` as it is, where it is an end of the range and no padding.
    """
    values = _samples(samples)
    if not values.size:
        return 0.0
    if base not in (float(values.min()), float(values.max())) or float(np.abs(values).max()) > _LARGE:
        return float(np.median(values))
    others = without_padding(values, samples, 1.0, _threshold)
    return base if others.size == values.size or base in others else float(np.median(others))


def _between_classes(values: NDArray[np.float64]) -> float:
    """Return the threshold that splits values best into two classes (Otsu 1979)."""
    # Squares must not overflow, and the smallest numbers have bins too; scaling by a power of two is exact.
    power = math.frexp(float(np.abs(values).max()))[1]
    counts, edges = np.histogram(np.ldexp(values, -power), bins=_BINS)
    weights = counts / counts.sum()
    centres = 0.5 * (edges[1:] + edges[:-1])
    below = np.cumsum(weights)[:-1]
    moment = np.cumsum(weights * centres)
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = (moment[-1] * below - moment[:-1]) ** 2 / (below * (1 - below))
    spread = np.nan_to_num(spread, nan=-1.0, posinf=-1.0)
    # All empty bins between two classes are equally good thresholds: take the middle of them.
    best = np.flatnonzero(spread >= spread.max() * (1 - 1e-12))
    return math.ldexp(float(0.5 * (edges[1:-1][best[0]] + edges[1:-1][best[-1]])), power)


def _inner_range(values: NDArray[np.float64]) -> tuple[float, float] | None:
    """Return the range of values without those that may be outliers; None where it is empty or hardly anything."""
    count = max(1, round(_OUTLYING * values.size))
    if values.size < 4 * count:
        return None
    ordered = np.partition(values, (count, values.size - 1 - count))
    low, high = float(ordered[count]), float(ordered[-1 - count])
    return (low, high) if low < high else None


def without_outliers(
    values: NDArray[np.float64], samples: NDArray[Any] | Samples, scale: float = 1.0
) -> NDArray[np.float64]:
    """Return values with outliers moved to the nearest of the others.

    Outliers are few samples far beyond the range of all others: sensors with a fault, a division by nearly 0. In a
    volume they have no neighbour of their kind; a small bright object is none. Those beyond what a picture of the
    others can resolve stay (`beyond_pictures`).

    Parameters
    ----------
    values
        A subset of the samples without NaN, (N,), divided by `scale`. Without outliers it is returned as it is.
    samples
        All of them; with three axes, a volume.
    scale
        A power of two.
    """
    inner = _inner_range(values)
    if inner is None:
        return values
    low, high = inner
    reach, most = _APART * (high - low), _RESOLVED * (high - low)
    known = samples_of(samples)
    if reach < float(values.max()) - high < most and _are_alone(known, (high + reach) * scale, above=True):
        values = np.minimum(values, high)
    if reach < low - float(values.min()) < most and _are_alone(known, (low - reach) * scale, above=False):
        values = np.maximum(values, low)
    return values


def beyond_pictures(samples: NDArray[Any] | Samples) -> tuple[float, float, float] | None:
    """Return the worst of few samples that are so large that no picture resolves the others, and the others' range."""
    values = _samples(samples_of(samples))
    inner = _inner_range(values)
    if inner is None:
        return None
    low, high = inner
    worst = max(float(values.max()), float(values.min()), key=abs)
    return (worst, low, high) if abs(worst) > _RESOLVED * (high - low) + max(abs(low), abs(high)) else None


def within_pictures(samples: Samples, values: tuple[float, float]) -> tuple[float, float] | None:
    """Return the range of samples without those beyond what a picture of the others can resolve; None without such.

    Parameters
    ----------
    samples
        Any number of axes.
    values
        The smallest and the largest of them.
    """
    wide = samples.dtype.kind == "f" or samples.dtype.itemsize > 2
    inner = _inner_range(_samples(samples)) if wide else None
    if inner is None:
        return None
    low, high = inner
    most = _RESOLVED * (high - low) + max(abs(low), abs(high))
    if max(abs(values[0]), abs(values[1])) < most:
        return None
    count, least, largest = samples.within(most)
    few = count + max(1, round(_OUTLYING * samples.size)) >= samples.size - samples.missing
    return (least, largest) if few else None


def _are_alone(samples: Samples, limit: float, *, above: bool) -> bool:
    """Return whether most samples of a volume beyond a limit have no neighbour there; True for samples of no volume."""
    if len(samples.shape) != 3:
        return True
    at = samples.beyond(limit, above=above)
    # Steps along the axes; beyond a border they lead to samples that are hardly ever marked.
    steps = (1, samples.shape[2], samples.shape[1] * samples.shape[2])
    beside = np.zeros(at.size, bool)
    for step in steps:
        beside |= np.isin(at + step, at, assume_unique=True) | np.isin(at - step, at, assume_unique=True)
    return 2 * int(beside.sum()) <= at.size


def choose_for(
    samples: NDArray[Any] | Samples,
    *,
    decades: bool = False,
    extremes: bool = False,
    spacing: Sequence[float] = (1.0, 1.0, 1.0),
) -> Look:
    """Return limits and opacities for samples.

    Opacity rises from the background: upwards from the lower end of the range, unless values lie on both sides of 0
    (`is_signed`), the background is at the upper end, or values are distances from a surface.

    Parameters
    ----------
    samples
        Finite or NaN; with three axes, a volume.
    decades
        They are logarithms.
    extremes
        The largest values count although they are few, unless they more than double the range.
    spacing
        Of a volume, along x, y and z.
    """
    known = samples_of(samples)
    values = _samples(known)
    # Differences of the largest numbers must not overflow; scaling by a power of two is exact.
    scale = 4.0 if values.size and float(np.abs(values).max()) > _LARGE else 1.0
    if decades:
        return _scaled(_choose(values / scale, even=True, extremes=extremes), scale)
    values = without_outliers(values / scale, known, scale)
    step = step_of_distances(values, known, spacing) if scale == 1.0 else 0.0
    if step:
        return _enclosed(values, step)
    if is_signed(values):
        return _scaled(_both_sides(values, extremes=extremes), scale)
    values = without_padding(values, known, scale, _threshold)
    if is_above(values, known, scale, _middle(values)):
        return _scaled(_choose(-values, even=False, extremes=extremes), -scale)
    return _scaled(_choose(values, even=False, extremes=extremes), scale)


def _scaled(look: Look, scale: float) -> Look:
    """Return the look of values times `scale`."""
    low, high = sorted(part * scale for part in look.clim)
    pairs = tuple(sorted((value * scale, opacity) for value, opacity in look.opacity))
    return replace(look, clim=(low, high), opacity=pairs, surface=look.surface * scale)


def _middle(values: NDArray[np.float64]) -> float:
    """Return the threshold between two classes of values as they are."""
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
    # Of large numbers that hardly differ, too.
    return low + _between_classes(values - low) if low < high else math.inf


def _threshold(values: NDArray[np.float64]) -> float:
    """Return the threshold between objects and a background at the lower end of a range."""
    low = float(values.min())
    return low + _between_classes(np.sqrt(values - low)) ** 2


def _enclosed(values: NDArray[np.float64], step: float) -> Look:
    """Return the look of what a surface encloses, of distances from it that grow outwards by `step` a sample."""
    pairs = sorted((0.0 - depth * step, opacity) for depth, opacity in _ENCLOSED)
    inside = (float(values.min()), 0.0) if step > 0.0 else (0.0, float(values.max()))
    return Look(inside, tuple(pairs), 0.0, _ENCLOSED[-1][1])


def _both_sides(values: NDArray[np.float64], *, extremes: bool) -> Look:
    """Return a look whose opacities rise from 0 to both sides."""
    look = _choose(np.abs(values), even=False, extremes=extremes)
    above = look.opacity if look.opacity[0][0] > 0.0 else ((0.0, 0.0), *look.opacity[1:])
    below = tuple((-value, opacity) for value, opacity in reversed(above) if value > 0.0)
    top = look.clim[1]
    return replace(look, clim=(-top, top), opacity=(*below, *above), cmap=DIVERGING)


def _choose(values: NDArray[np.float64], *, even: bool, extremes: bool) -> Look:
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
    if not low < high:
        # One value everywhere: show it, almost transparent. Outside the supports the scalar is 0, and of logarithms the
        # least.
        width = max(abs(low), 1.0) * 1e-3
        surface = low if even else 0.5 * low
        return Look((low - width, high + width), ((low - width, 0.05), (high + width, 0.05)), surface)
    # Low values vary little and high ones much. Square roots make the variation similar, so that thin branches and
    # faint shells are classified as objects, not as background; logarithms do that already.
    start = low + _between_classes(values - low) if even else _threshold(values)
    shown = values[values > start]
    top = float(np.percentile(shown, _TOP_PERCENTILE)) if shown.size else high
    if not start < top or (extremes and high - start <= _WHOLE * (top - start)):
        top = high
    if not start < top:
        # Two adjacent floating-point numbers.
        start = low
    share = np.linspace(0.0, 1.0, _RAMP_POINTS)
    opacity = TOP_OPACITY * share**_RAMP_POWER
    pairs = zip((start + share * (top - start)).tolist(), opacity.tolist(), strict=True)
    return Look((start, top), tuple(pairs), start)
