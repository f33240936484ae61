"""Sparse lattices of kernels: their places, and the coefficients that are close to samples.

Level l has nodes at multiples of finest * 2^l of the samples' index coordinates, and a kernel (conventions, section 2)
of `radius` spacings at each; few coefficients are not 0. They are found by coordinate descent in C++
(cpp/include/sheetsplat/lattice_descent.hpp): passes that soften with falling thresholds lead to the minimum of a convex
function, from which passes that round each coefficient to a multiple of its step, weighing squared error against bits,
lead to what is coded.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _sheetsplat
from sheetsplat.encode.coder import Nodes, Tables, Whole, bits_of

Floats = NDArray[np.float64]
Told = Callable[[float], None]

# (Whole multiples of 1/8, which float32 keeps.)
FALLOFF, RADIUS = 8.0, 2.375
# Spacings of the coarsest level that the data have along their longest side, at least.
_COARSEST = 1
MOST_LEVELS = 16
# Rounds with falling thresholds, each with passes over the kernels that are not 0; rounds with the last one.
_FALL, _ACTIVE_PASSES, _MOST_ROUNDS, _LAST_ROUNDS = 0.5, 2, 40, 3
# The threshold that fits a step, and the squared error that a bit is worth, in squared steps.
THRESHOLD, _BIT = 0.6, 0.1
_ROUNDING_PASSES, _MOST_TRIALS = 4, 8
# Corrections of samples beyond a bound: rounds, the part of what they are beyond its inner part that each takes.
_CORRECTIONS, _DAMPED, _INNER = 150, 0.45, 0.8
# The size of a code may lie this share below what was asked.
_NEAR = 0.985


@dataclass(frozen=True)
class Geometry:
    """Where samples and nodes are, in index coordinates: samples of a Cartesian lattice at whole numbers.

    Attributes
    ----------
    extent
        Of the samples, from 0 on, along x, y, z.
    finest
        Spacing of level 0.
    levels
        Their number.
    falloff, radius
        Of the kernels; the radius in spacings.
    """

    extent: tuple[float, float, float]
    finest: float
    levels: int
    falloff: float = FALLOFF
    radius: float = RADIUS

    @staticmethod
    def of(extent: tuple[float, float, float], finest: float) -> Geometry:
        """Return the geometry of samples whose coarsest level is a few nodes across."""
        across = max(extent) / (finest * _COARSEST)
        return Geometry(extent, finest, min(MOST_LEVELS, 1 + max(0, math.floor(math.log2(max(across, 1.0))))))

    def nodes(self, level: int) -> Nodes:
        """Return the nodes of a level: beyond the samples there is one more, but for the finest level."""
        spacing = self.finest * 2.0**level
        more = int(level > 0 or self.levels == 1)
        beyond = [more * (length > 0.0) for length in self.extent]
        counts = [math.ceil(length / spacing) + 1 + 2 * by for length, by in zip(self.extent, beyond, strict=True)]
        x, y, z = (-by for by in beyond)
        a, b, c = counts
        return Nodes((x, y, z), (a, b, c), spacing)

    def all_nodes(self) -> list[Nodes]:
        """Return the nodes of all levels."""
        return [self.nodes(level) for level in range(self.levels)]

    def norm(self, level: int) -> float:
        """Return the norm of a level's kernel at samples of density 1, without its lowering."""
        width = math.sqrt(math.pi / (2.0 * self.falloff)) * self.radius * self.finest * 2.0**level
        return width * math.sqrt(width)


def unit_step(geometry: Geometry, level: int) -> float:
    """Return the step of a level's coefficients for a step of 1: kernels of all levels change samples alike."""
    return 1.0 / geometry.norm(level)


def kernels(geometry: Geometry, numbers: list[Whole], step: float) -> tuple[Floats, Floats, Floats]:
    """Return centres (N, 3), radii (N,), both in index coordinates, and coefficients (N,) of what is not 0.

    All kernels of the coarsest level are among them, so that no point between the samples is empty.
    """
    centers, radii, values = [], [], []
    for level in range(geometry.levels - 1, -1, -1):
        nodes, own = geometry.nodes(level), numbers[level]
        at = np.argwhere((own != 0) if level + 1 < geometry.levels else np.ones(own.shape, bool))
        centers.append((at[:, ::-1] + np.asarray(nodes.first)) * nodes.spacing)
        radii.append(np.full(len(at), geometry.radius * nodes.spacing))
        values.append(own[tuple(at.T)] * (step * unit_step(geometry, level)))
    return np.concatenate(centers), np.concatenate(radii), np.concatenate(values)


@dataclass
class Fitted:
    """Coefficients, in steps, by level."""

    numbers: list[Whole]
    step: float


class Fitting:
    """The search for coefficients.

    Parameters
    ----------
    make
        Makes a `LatticeDescent` of the samples for nodes; exact: in float64.
    geometry
    told
        Is told the share that is done.
    """

    def __init__(self, make: Callable[[list[Nodes], bool], Any], geometry: Geometry, told: Told) -> None:
        self.geometry = geometry
        self.nodes = geometry.all_nodes()
        self.descent: _sheetsplat.LatticeDescent = make(self.nodes, False)
        self._told = told
        self._active, self._largest = np.zeros(geometry.levels, np.int64), np.full(geometry.levels, math.inf)
        self._tables = [Tables() for _ in self.nodes]
        self._make = make

    def soften(self) -> Iterator[float]:
        """Yield falling thresholds, after rounds of passes with each, from where the first kernel matters."""
        threshold = math.inf
        for level in self._from_coarsest():
            self._pass(level, threshold)
        threshold = float(self._largest.max()) * _FALL
        for _ in range(_MOST_ROUNDS):
            if not threshold > 0.0:
                return
            self.round_of(threshold)
            yield threshold
            threshold *= _FALL

    def round_of(self, threshold: float) -> None:
        """Make one pass over all kernels and some over those that are not 0."""
        for level in self._from_coarsest():
            if self._active[level] or self._largest[level] > 0.8 * threshold:
                self._pass(level, threshold)
                for _ in range(_ACTIVE_PASSES):
                    if self._active[level]:
                        self.descent.soften(level, threshold, True)

    def _pass(self, level: int, threshold: float) -> None:
        self._largest[level], self._active[level] = self.descent.soften(level, threshold, False)

    def settle(self, step: float) -> None:
        """Make the last rounds before coefficients are rounded to a step."""
        for _ in range(_LAST_ROUNDS):
            self.round_of(THRESHOLD * step)

    def round_off(self, step: float, passes: int = _ROUNDING_PASSES) -> None:
        """Round coefficients to multiples of their steps, pass by pass."""
        for number in range(passes):
            for level in self._from_coarsest():
                if self._active[level] or self._largest[level] > 0.4 * step:
                    bits = self._tables[level].bits()
                    own = step * unit_step(self.geometry, level)
                    found = self.descent.round_off(level, own, _BIT * step * step, bits, False)
                    self._largest[level], self._active[level] = found
            if number + 1 < passes:
                self.size(self.rounded(step))

    def rounded(self, step: float) -> list[Whole]:
        """Return the coefficients in steps."""
        return [
            np.rint(self.descent.coefficients(level) * (1.0 / (step * unit_step(self.geometry, level)))).astype(
                np.int32
            )
            for level in range(self.geometry.levels)
        ]

    def size(self, numbers: list[Whole]) -> float:
        """Return about how many bytes numbers take, and keep the tables for the next pass."""
        tables, bits = Tables(), 0.0
        for level in self._from_coarsest():
            if numbers[level].any():
                bits += bits_of(numbers, self.nodes, level, tables)
            self._tables[level] = tables.copy()
        return bits / 8.0

    def exact(self, numbers: list[Whole], step: float) -> Iterator[tuple[int, NDArray[np.float64]]]:
        """Yield, from the coarsest level on, each level and the residual with it, in float64."""
        descent = self._make(self.nodes, True)
        for level in self._from_coarsest():
            if numbers[level].any():
                descent.set(level, numbers[level] * (step * unit_step(self.geometry, level)))
            yield level, descent.residual()

    def corrected(self, step: float, bound: float, samples: NDArray[np.int64]) -> Fitted | None:
        """Return rounded coefficients that keep a bound at every sample, by kernels of level 0; None: they do not.

        Parameters
        ----------
        step, bound
            Of the search, over the range of the data.
        samples
            The node of level 0 where each sample is: its kernel is 1 there.
        """
        numbers = self.rounded(step)
        own = step * unit_step(self.geometry, 0)
        descent, is_new = self._summed(numbers, step), True
        for _ in range(_CORRECTIONS):
            off = descent.residual()
            beyond = np.flatnonzero(np.abs(off) > bound)
            if not beyond.size and is_new:
                return Fitted(numbers, step)
            if not beyond.size:
                # Changes are rounded, sums that are made anew are not.
                descent, is_new = self._summed(numbers, step), True
                continue
            excess = off[beyond] - np.copysign(_INNER * bound, off[beyond])
            change = np.rint(_DAMPED * excess / own)
            still = change == 0.0
            change[still] = np.sign(excess)[still]
            numbers[0].ravel()[samples[beyond]] += change.astype(np.int32)
            descent.set(0, np.asarray(numbers[0] * own, np.float64))
            is_new = False
        return None

    def _summed(self, numbers: list[Whole], step: float) -> _sheetsplat.LatticeDescent:
        """Return the descent of coefficients in float64."""
        descent: _sheetsplat.LatticeDescent = self._make(self.nodes, True)
        for level in self._from_coarsest():
            if numbers[level].any():
                own = step * unit_step(self.geometry, level)
                descent.set(level, np.asarray(numbers[level] * own, np.float64))
        return descent

    def for_less(self, fitted: Fitted, most: float, measure: Callable[[list[Whole]], float]) -> Fitted:
        """Return coarser coefficients than those that were found, whose measure is at most `most`."""
        step = fitted.step
        while True:
            step *= 1.03
            self.round_off(step, 2)
            numbers = self.rounded(step)
            if measure(numbers) <= most or not any(one.any() for one in numbers):
                return Fitted(numbers, step)

    def _from_coarsest(self) -> range:
        return range(self.geometry.levels - 1, -1, -1)

    def for_size(self, most: float, measure: Callable[[list[Whole]], float]) -> Fitted:
        """Return the best coefficients whose measure (bytes, kernels) is at most `most`."""
        step, before = math.inf, 0.0
        for threshold in self.soften():
            found = measure(self.rounded(threshold / THRESHOLD))
            self._told(min(0.6, 0.6 * math.sqrt(found / most)))
            if found >= most:
                share = (most - before) / max(found - before, 1e-9)
                step = threshold / THRESHOLD * _FALL ** (share - 1.0)
                break
            step, before = threshold / THRESHOLD, found
        if not math.isfinite(step):
            return Fitted([np.zeros(one.shape, np.int32) for one in self.nodes], 1.0)
        self.settle(step)
        best: Fitted | None = None
        # The largest step that was too small, and the smallest that was not, with their measures.
        small, large = (0.0, math.inf), (math.inf, 0.0)
        for trial in range(_MOST_TRIALS):
            self.round_off(step, _ROUNDING_PASSES if trial == 0 else 2)
            numbers = self.rounded(step)
            found = measure(numbers)
            self._told(0.65 + 0.3 * trial / _MOST_TRIALS)
            if found > most:
                small = max(small, (step, found))
            elif step < large[0]:
                best, large = Fitted(numbers, step), (step, found)
            if best is not None and large[1] >= _NEAR * most:
                break
            if small[0] < large[0] < math.inf and small[0] > 0.0:
                share = math.log(small[1] / most) / math.log(small[1] / max(large[1], 1e-3 * most))
                step = small[0] * (large[0] / small[0]) ** min(max(share, 0.1), 0.9)
            else:
                step *= (max(found, 0.1 * most) / (0.995 * most)) ** 0.7
        return best or self.for_less(Fitted(self.rounded(step), step), most, measure)
