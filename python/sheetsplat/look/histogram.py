"""Limits and opacities by the histogram of samples."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.fields.samples import Samples, samples_of

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
# Sums of float64 resolve the others beside values up to so many times their range.
_RESOLVED = 1e10


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


def choose_for(samples: NDArray[Any] | Samples, *, decades: bool = False, extremes: bool = False) -> Look:
    """Return limits and opacities for samples.

    Parameters
    ----------
    samples
        Finite or NaN; with three axes, a volume.
    decades
        They are logarithms.
    extremes
        The largest values count although they are few, unless they more than double the range.
    """
    known = samples_of(samples)
    values = _samples(known)
    # Differences of the largest numbers must not overflow; scaling by a power of two is exact.
    scale = 4.0 if values.size and float(np.abs(values).max()) > 1e307 else 1.0
    if not decades:
        values = without_outliers(values / scale, known, scale) * scale
    look = _choose(values / scale, even=decades, extremes=extremes)
    pairs = tuple((value * scale, opacity) for value, opacity in look.opacity)
    return Look((look.clim[0] * scale, look.clim[1] * scale), pairs, look.surface * scale)


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
    start = low + (_between_classes(values - low) if even else _between_classes(np.sqrt(values - low)) ** 2)
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
