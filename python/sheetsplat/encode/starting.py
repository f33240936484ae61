"""Where further kernels begin: the spheres that take most of what is left, found at several sizes at once."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from sheetsplat.encode.free import COLUMNS, FRAME, VALUE, Floats, Samples

# Sizes of spheres from one to the next, and the smallest support in bins.
_STEP = math.sqrt(2.0)
_SMALLEST = 2.0
# Bins along the longest side at most.
_BINS = 96
# A sphere that so small a part of its weight lies in tells nothing.
_LEAST_WEIGHT = 0.05
# Local maxima that are looked at for each start.
_CANDIDATES = 64


class Bins:
    """The samples in cubic bins: weights, and where each bin and each sample's bin is."""

    def __init__(self, samples: Samples) -> None:
        sides = samples.sides()
        self.edge = max(samples.spacing(), float(sides.max(initial=0.0)) / _BINS)
        if samples.points is None:
            self.edge = float(math.ceil(self.edge))
            self.origin = np.zeros(3)
            self._numbers: Any = None
            counts = [math.ceil(n / self.edge) for n in samples.values.shape]
        else:
            self.origin = samples.points.min(axis=0) if len(samples.points) else np.zeros(3)
            at = np.floor((samples.points - self.origin) / self.edge).astype(np.int64)
            counts = [int(n) + 1 for n in at.max(axis=0, initial=0)[::-1]]
            self._numbers = np.ravel_multi_index((at[:, 2], at[:, 1], at[:, 0]), counts)
        self.shape = tuple(counts)
        weights = np.ones(samples.values.shape) if samples.weights is None else samples.weights
        self.weights = self.sum(weights)

    def sum(self, numbers: Floats) -> Floats:
        """Return the sums of numbers, one a sample, in each bin."""
        if self._numbers is not None:
            return np.bincount(self._numbers, numbers, math.prod(self.shape)).reshape(self.shape)
        step = int(self.edge)
        made = numbers
        if step > 1:
            for axis in range(3):
                made = np.add.reduceat(made, np.arange(0, made.shape[axis], step), axis=axis)
        return np.asarray(made, dtype=np.float64)

    def places(self, bins: Floats) -> Floats:
        """Return the middles of bins k, j, i as places x, y, z."""
        # (The places of a lattice are in the middles of bins of one sample.)
        middle = 0.5 if self._numbers is not None else 0.5 * (self.edge - 1.0) / self.edge
        return np.asarray(self.origin + (bins[:, ::-1] + middle) * self.edge)


def _smoothed(numbers: Floats, deviation: float) -> Floats:
    """Return the sums of numbers times a Gaussian of height 1."""
    from scipy.ndimage import gaussian_filter  # type: ignore[import-untyped]

    reach = max(1, int(4.0 * deviation + 0.5))
    total = float(np.exp(-0.5 * (np.arange(-reach, reach + 1) / deviation) ** 2).sum())
    spread = [deviation if n > 1 else 0.0 for n in numbers.shape]
    # Along an axis with a single place the Gaussian is its height.
    smooth = gaussian_filter(numbers, spread, mode="constant", radius=[reach if one else 0 for one in spread])
    return np.asarray(smooth * total ** sum(one > 0.0 for one in spread))


def starts(bins: Bins, left: Floats, count: int, apart: float, falloff: float) -> Floats:
    """Return rows of at most `count` spheres.

    Of a sphere with the profile g the share f of what is left, R, that fits best is sum of w R g / sum of w g g, and
    takes (sum of w R g)^2 / sum of w g g of its squares. Places and sizes where this is largest among their neighbours
    are taken in turn, none nearer to another than `apart` of the sum of their semi-axes.

    Parameters
    ----------
    bins
        Of the samples.
    left
        Weights times what is left to add, one a sample.
    count, apart
        As above.
    falloff
        Of the profile.
    """
    from scipy.ndimage import maximum_filter

    found = bins.sum(left)
    best = np.zeros(bins.shape)
    size, height = np.ones(bins.shape), np.zeros(bins.shape)
    semi_axis, longest = _SMALLEST, max(_SMALLEST, 1.5 * max(bins.shape))
    while semi_axis <= longest:
        deviation = semi_axis / math.sqrt(2.0 * falloff)
        products = _smoothed(found, deviation)
        squares = _smoothed(bins.weights, deviation / math.sqrt(2.0))
        whole = (math.sqrt(math.pi) * deviation) ** sum(n > 1 for n in bins.shape) * float(bins.weights.mean())
        squares = np.maximum(squares, max(_LEAST_WEIGHT * whole, np.finfo(np.float64).tiny))
        gain = products * products / squares
        better = gain > best
        best[better], size[better] = gain[better], semi_axis
        height[better] = (products / squares)[better]
        semi_axis *= _STEP
    peaks = np.argwhere((maximum_filter(best, 3) == best) & (best > 0.0) & (bins.weights > 0.0))
    peaks = peaks[np.argsort(-best[tuple(peaks.T)], kind="stable")][: _CANDIDATES * count]
    sizes = size[tuple(peaks.T)]
    taken: list[int] = []
    for n in range(len(peaks)):
        away = np.linalg.norm(peaks[taken] - peaks[n], axis=1)
        if (away > apart * (sizes[taken] + sizes[n])).all():
            taken.append(n)
            if len(taken) == count:
                break
    chosen = peaks[taken]
    rows = np.zeros((len(taken), COLUMNS))
    rows[:, :3] = bins.places(chosen.astype(np.float64))
    rows[:, FRAME][:, :3] = 1.0 / (sizes[taken] * bins.edge)[:, None]
    rows[:, VALUE] = height[tuple(chosen.T)]
    return rows
