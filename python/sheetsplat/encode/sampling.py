"""Points at which the error of packed ellipsoids is measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sheetsplat.fields import EllipsoidField
from sheetsplat.fields.axes import frames

from .shapes import Floats

# Times that points in the whole box are drawn until as many lie where they count.
_DRAWS, _RARE = 16, 1000
# Share of the usual sum of weights.
_USUAL = 0.01
# One point of so many is enough to see what a part contributes.
_THINNED = 4


@dataclass(frozen=True, eq=False)
class Points:
    """Points at which errors are measured, and how much each counts: world positions (M, 3), and shares of 1 (M,)."""

    at: Floats
    shares: Floats

    @staticmethod
    def of(at: Floats, weights: Floats) -> Points:
        """Return points by weights of any sum."""
        return Points(at, weights / weights.sum())

    def thinned(self) -> Points:
        """Return some of the points."""
        return Points.of(self.at[::_THINNED], self.shares[::_THINNED])


def sample_points(field: EllipsoidField, count: int, seed: int) -> list[Points]:
    """Return two sets of points: random ones within kernels, and random ones in the whole box.

    Where values are divided by weights, points count where the sum of weights is above w0, or above a share of what it
    usually is, if that is less: in the sliver below, at the rim of the outermost kernels, the scalar jumps to the base
    and would hide all other errors. Of the second set points just inside the rim, where errors are rare and large, are
    drawn more densely than others. The set is left out where points that count are rare.
    """
    random = np.random.default_rng(seed)
    low, high = np.array(field.bounds)
    chosen = random.integers(0, field.size, count)
    within = random.normal(size=(count, 3))
    within *= (random.random(count) ** (1.0 / 3.0) / np.linalg.norm(within, axis=1))[:, None]
    within *= field.scales[chosen, None] if field.scales.ndim == 1 else field.scales[chosen]
    if field.rotations is not None:
        within = np.einsum("nij,nj->ni", frames(field.rotations[chosen]), within)
    within += field.centers[chosen]
    sums = field.weight_at(within)
    least = min(field.w0, _USUAL * float(np.median(sums))) if field.normalization == "threshold" else 0.0
    near = within[sums > least]
    found = []
    inner, draws = 0, 0
    for draw in range(1, _DRAWS + 1):
        points = low + (high - low) * random.random((count, 3))
        sums = field.weight_at(points)
        counted = (sums > least) & ((sums < 2.0 * least) | (inner < count))
        rim = sums[counted] < 2.0 * least
        found.append((points[counted], rim))
        if inner < count:
            inner, draws = inner + int((~rim).sum()), draw
    every, rims = (np.concatenate(arrays) for arrays in zip(*found, strict=True))
    box = Points.of(every, np.where(rims, draws / _DRAWS, 1.0)) if len(every) > min(count, _RARE) else None
    return [one for one in (Points.of(near, np.ones(len(near))) if len(near) else None, box) if one is not None]
