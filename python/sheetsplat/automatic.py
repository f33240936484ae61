"""A transfer function that shows something useful when nobody gave one: from the histogram of the samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.fields import RegularField

# More samples than this do not change a histogram.
_ENOUGH = 1_000_000
_BINS = 512
TOP_OPACITY = 0.5
# Few bright samples, metal for instance, must not push everything else to the dark end.
_TOP_PERCENTILE = 99.0
# A ramp that begins flat lets the eye into soft things and still shows thin ones.
_RAMP_POWER = 1.5
_RAMP_POINTS = 9


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
    """

    clim: tuple[float, float]
    opacity: tuple[tuple[float, float], ...]
    surface: float


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


def choose(fields: list[RegularField]) -> Look:
    """Return limits and opacities for fields, by the samples of the largest of them."""
    return choose_for(max(fields, key=lambda one: one.size).values)


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
