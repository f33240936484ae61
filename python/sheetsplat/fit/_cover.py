"""Enlargement of kernels until the weight sums at the centres of cells and edges are large enough."""

from __future__ import annotations

import math

import numpy as np

from ._cells import Neighbourhoods
from ._kernels import Floats, Numbers, profile, spans

_CHUNK = 1 << 18
_ROUNDS = 60


class Cover:
    """Kernels that are enlarged until the weight sums at the centres of cells and edges are large enough.

    Attributes
    ----------
    scales
        Semi-axes, (N, 3).
    raised
        Which kernels were enlarged, (N,).
    thinnest
        Lower bound of the least weight sum at a centre.
    thin
        Number of centres whose weight sum stayed too small.
    """

    def __init__(
        self, points: Floats, axes: Floats, scales: Floats, limits: Floats, around: Neighbourhoods, falloff: float
    ) -> None:
        self._points = points
        self._axes = axes
        self.scales = scales
        self._limits = limits
        self._around = around
        self._falloff = falloff
        self.raised = np.zeros(len(points), dtype=bool)
        self.thinnest = math.inf
        self.thin = 0

    def _weights(self, at: Floats, points: Numbers) -> Floats:
        """Return the profile g of kernels at positions, (M,)."""
        unit = np.einsum("nji,nj->ni", self._axes[points], at - self._points[points]) / self.scales[points]
        return profile(np.einsum("ni,ni->n", unit, unit), self._falloff)

    def _own(self, block: Numbers, at: Floats) -> Floats:
        total = np.zeros(len(block))
        for corner in range(block.shape[1]):
            for first in range(0, len(block), _CHUNK):
                some = slice(first, first + _CHUNK)
                total[some] += self._weights(at[some], block[some, corner])
        return total

    def _all(self, at: Floats, item: Numbers, point: Numbers) -> Floats:
        total = np.zeros(len(at))
        for first in range(0, len(item), _CHUNK):
            some = slice(first, first + _CHUNK)
            total += np.bincount(item[some], self._weights(at[item[some]], point[some]), len(at))
        return total

    def cover(self, block: Numbers, lowest: float) -> None:
        """Enlarge kernels until the weight sum at the centre of every item, (M, corners), is at least `lowest`.

        Only the item's own points and their neighbours are summed, so that the sum is a lower bound.
        """
        at = self._points[block].mean(axis=1)
        own = self._own(block, at)
        short = np.flatnonzero(own < lowest)
        if len(own) > len(short):
            self.thinnest = min(self.thinnest, float(own[own >= lowest].min()))
        lengths = self._around.degrees[block[short]].sum(axis=1) + block.shape[1] if len(short) else np.zeros(0)
        for first, last in spans(lengths, 8 * _CHUNK):
            some = short[first:last]
            self._raise(block[some], at[some], lowest)

    def _raise(self, block: Numbers, at: Floats, lowest: float) -> None:
        item, point = self._around.ring(block)
        for _ in range(_ROUNDS):
            total = self._all(at, item, point)
            short = total < lowest
            if (~short).any():
                self.thinnest = min(self.thinnest, float(total[~short].min()))
            if not short.any():
                return
            # Small steps, because the factor is not known where no kernel reaches.
            factor = np.clip((lowest / np.maximum(total[short], 1e-9)) ** (1.0 / 3.0), 1.02, 1.15)
            growth = np.ones(len(self._points))
            for corner in range(block.shape[1]):
                np.maximum.at(growth, block[short, corner], factor)
            grown = np.minimum(self.scales * growth[:, None], np.maximum(self._limits[:, None], self.scales))
            self.raised |= (grown > self.scales).any(axis=1)
            stuck = not (grown > self.scales).any()
            self.scales = grown
            renumbered = np.cumsum(short) - 1
            kept = short[item]
            item, point = renumbered[item[kept]], point[kept]
            block, at = block[short], at[short]
            if stuck:
                break
        left = self._all(at, item, point)
        self.thin += int((left < lowest).sum())
        self.thinnest = min(self.thinnest, float(left.min()))
