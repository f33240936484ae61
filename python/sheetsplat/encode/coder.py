"""Whole numbers on lattices of dyadic spacing in few bytes.

Levels are coded from the coarsest on, and of each level its eight phases one after the other: the nodes whose place is
odd along x (1), y (2) and z (4), in the order of these sums, x fastest. What is known by then tells nodes apart into
`CONTEXTS` contexts, each of which has a table of how often it met each magnitude; a magnitude is coded by that table,
then the tables count it. Signs, and what exceeds the largest magnitude of a table, are coded evenly.

The context of a node is 8 a + b:

- a, by the coarser level: 3 where one of the nodes around it (the one at its place; along axes where its place is odd,
  both neighbours) has a magnitude above 1, 2 where one has 1, else 1 where any of the 27 around the lowest of them is
  not 0, else 0. The coarsest level has 2.
- b, by the neighbours that are known: 7 in phase 0; 0 where all are 0; else 1 to 6 by 8 s / w, rounded down (below 1,
  2, 4, 8, 16, or not), s the sum of magnitudes, at most 7 each, in steps of w: 2 for neighbours along an axis, else 1.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sheetsplat.errors import missing_package

Whole = NDArray[np.int32]

CONTEXTS, MAGNITUDES = 32, 16
_PHASES = 8
_MOST_BESIDE, _MOST_ABOVE = 7, 3
# Counts of a table that has met nothing, how fast they grow, and where they are halved.
_UNKNOWN, _GAIN, _MOST = 8, 8, 1 << 14
# Symbols of one context that are coded by the same table: so many at first, then twice as many each time.
_FIRST_RUN, _LONGEST_RUN = 32, 4096
# Most bits of what exceeds a table.
_MOST_BITS = 24
_BESIDE = np.array([0, 1, 2, 3, 3, 4, 4, 4, 4] + [5] * 8 + [6] * 64, np.uint8)


def range_coder() -> Any:
    """Return `constriction.stream`; Unsupported where the package is missing."""
    try:
        import constriction  # type: ignore[import-untyped]
    except ImportError as error:
        raise missing_package("encoded fields cannot be written or read", error) from error
    return constriction.stream


class Nodes(NamedTuple):
    """The nodes of a level: node (x, y, z) lies at (first + (x, y, z)) times the spacing."""

    first: tuple[int, int, int]
    counts: tuple[int, int, int]
    spacing: float

    @property
    def shape(self) -> tuple[int, int, int]:
        """Of arrays of coefficients, [z, y, x]."""
        x, y, z = self.counts
        return z, y, x


def _starting_tables() -> NDArray[np.int64]:
    """Return counts by which little is expected where little is known."""
    above, beside = np.divmod(np.arange(CONTEXTS), 8)
    # Of phase 0, which has no neighbours that are known, as of some.
    mean = 0.02 * 4.0**above * 2.0 ** np.where(beside == 7, 2, beside)
    ratio = mean / (1.0 + mean)
    shares = (1.0 - ratio)[:, None] * ratio[:, None] ** np.arange(MAGNITUDES)
    return np.maximum(1, np.rint(_UNKNOWN * MAGNITUDES * shares)).astype(np.int64)


@dataclass
class Tables:
    """How often each context met each magnitude."""

    counts: NDArray[np.int64] = field(default_factory=_starting_tables)

    def shares(self, context: int) -> NDArray[np.float64]:
        """Return the share of each magnitude."""
        counts = self.counts[context]
        return np.asarray(counts / counts.sum())

    def bits(self) -> NDArray[np.float32]:
        """Return the bits of each magnitude in each context, (CONTEXTS, MAGNITUDES)."""
        return np.asarray(-np.log2(self.counts / self.counts.sum(axis=1, keepdims=True)), np.float32)

    def add(self, context: int, met: NDArray[np.int64]) -> None:
        """Count how often magnitudes were met."""
        counts = self.counts[context]
        counts += _GAIN * met
        while counts.sum() > _MOST:
            counts[:] = (counts + 1) // 2

    def copy(self) -> Tables:
        """Return tables that change by themselves."""
        return Tables(self.counts.copy())


def _phase(phase: int, nodes: Nodes) -> tuple[slice, slice, slice]:
    """Return where in [z, y, x] the nodes of a phase lie."""
    starts = [((phase >> axis & 1) - nodes.first[axis]) & 1 for axis in range(3)]
    x, y, z = (slice(start, None, 2) for start in starts)
    return z, y, x


def contexts(levels: Sequence[Whole], geometry: Sequence[Nodes], level: int, phase: int) -> NDArray[np.uint8]:
    """Return the contexts of the nodes of a phase, [z, y, x], by what is known before them."""
    nodes, own = geometry[level], levels[level]
    where = _phase(phase, nodes)
    shape = own[where].shape
    above: NDArray[Any] = np.full(shape, 2, np.uint8)
    if level + 1 < len(geometry):
        above = _above(levels[level + 1], geometry[level + 1], nodes, where, shape, phase)
    if phase == 0:
        return np.asarray(8 * above + 7, np.uint8)
    around = np.pad(np.minimum(np.abs(own), _MOST_BESIDE).astype(np.int16), 1)
    total, weights = np.zeros(shape, np.int16), 0
    for step in itertools.product((-1, 0, 1), repeat=3):
        dz, dy, dx = step
        if (phase ^ (abs(dx) | abs(dy) << 1 | abs(dz) << 2)) < phase:
            weight = 2 if abs(dx) + abs(dy) + abs(dz) == 1 else 1
            begin = [one.start + 1 + by for one, by in zip(where, step, strict=True)]
            near = around[
                tuple(slice(a, a + 2 * n - 1, 2) if n else slice(0) for a, n in zip(begin, shape, strict=True))
            ]
            total += np.int16(weight) * near
            weights += weight
    return np.asarray(8 * above + np.where(total == 0, 0, _BESIDE[np.minimum(8 * total // weights + 1, 80)]), np.uint8)


def _above(
    coarser: Whole, parents: Nodes, nodes: Nodes, where: tuple[slice, slice, slice], shape: tuple[int, ...], phase: int
) -> NDArray[np.uint8]:
    magnitudes = np.minimum(np.abs(coarser), _MOST_ABOVE).astype(np.uint8)
    odd = [phase >> axis & 1 for axis in (2, 1, 0)]
    begins = []
    for axis, one in enumerate(where):
        first, of_parents = nodes.first[2 - axis], parents.first[2 - axis]
        begins.append((first + one.start - odd[axis]) // 2 - of_parents)
    # So many zeros around that every node has parents, and these have neighbours.
    wide = [
        (max(0, 1 - begin), max(0, begin + count + 2 - size))
        for begin, count, size in zip(begins, shape, magnitudes.shape, strict=True)
    ]
    padded = np.pad(magnitudes, wide)
    begins = [begin + before for begin, (before, _) in zip(begins, wide, strict=True)]

    def largest(steps: Sequence[Sequence[int]]) -> NDArray[np.uint8]:
        found = np.zeros(shape, np.uint8)
        for step in itertools.product(*steps):
            part = tuple(slice(a + by, a + by + n) for a, by, n in zip(begins, step, shape, strict=True))
            np.maximum(found, padded[part], out=found)
        return found

    near = largest([range(one + 1) for one in odd])
    wider = largest([(-1, 0, 1)] * 3)
    return np.asarray(np.where(near > 0, np.where(near == 1, 2, 3), wider > 0), np.uint8)


def _runs(of_contexts: NDArray[np.uint8]) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """Yield each context with the places, in runs, that are coded by one table."""
    flat = of_contexts.ravel()
    order = np.argsort(flat, kind="stable")
    ends = np.searchsorted(flat[order], np.arange(CONTEXTS + 1))
    for context in range(CONTEXTS):
        begin, end, run = int(ends[context]), int(ends[context + 1]), _FIRST_RUN
        while begin < end:
            yield context, order[begin : min(begin + run, end)]
            begin, run = begin + run, min(2 * run, _LONGEST_RUN)


def bits_of(levels: Sequence[Whole], geometry: Sequence[Nodes], level: int, tables: Tables) -> float:
    """Return how many bits a level takes, and let the tables count it."""
    total = 0.0
    for phase in range(_PHASES):
        magnitudes = np.abs(levels[level][_phase(phase, geometry[level])]).ravel()
        told = np.minimum(magnitudes, MAGNITUDES - 1)
        for context, at in _runs(contexts(levels, geometry, level, phase)):
            met = np.bincount(told[at], minlength=MAGNITUDES)
            total -= float(met @ np.log2(tables.shares(context)))
            tables.add(context, met)
        more = magnitudes[magnitudes >= MAGNITUDES - 1] - (MAGNITUDES - 2)
        total += float((magnitudes > 0).sum() + (5.0 + np.floor(np.log2(more))).sum())
    return total


def write_level(encoder: Any, levels: Sequence[Whole], geometry: Sequence[Nodes], level: int, tables: Tables) -> None:
    """Append a level to a `constriction.stream.queue.RangeEncoder`, and let the tables count it."""
    model = range_coder().model

    for phase in range(_PHASES):
        numbers = levels[level][_phase(phase, geometry[level])].ravel()
        magnitudes = np.abs(numbers)
        told = np.minimum(magnitudes, MAGNITUDES - 1)
        for context, at in _runs(contexts(levels, geometry, level, phase)):
            some = np.ascontiguousarray(told[at], np.int32)
            encoder.encode(some, model.Categorical(tables.shares(context), perfect=False))
            tables.add(context, np.bincount(some, minlength=MAGNITUDES))
        larger = magnitudes[magnitudes >= MAGNITUDES - 1] - (MAGNITUDES - 2)
        for one in larger.tolist():
            length = one.bit_length() - 1
            encoder.encode(length, model.Uniform(_MOST_BITS))
            if length:
                encoder.encode(one - (1 << length), model.Uniform(1 << length))
        signs = numbers[numbers != 0] < 0
        if signs.size:
            encoder.encode(signs.astype(np.int32), model.Uniform(2))


def read_level(decoder: Any, levels: Sequence[Whole], geometry: Sequence[Nodes], level: int, tables: Tables) -> None:
    """Read a level, which becomes the numbers of levels[level], from a `constriction.stream.queue.RangeDecoder`.

    Raises
    ------
    AssertionError
        As the decoder does, for what no encoder wrote.
    """
    model = range_coder().model

    for phase in range(_PHASES):
        where = _phase(phase, geometry[level])
        magnitudes = np.zeros(levels[level][where].size, np.int32)
        for context, at in _runs(contexts(levels, geometry, level, phase)):
            some = decoder.decode(model.Categorical(tables.shares(context), perfect=False), len(at))
            magnitudes[at] = some
            tables.add(context, np.bincount(some, minlength=MAGNITUDES))
        for place in np.flatnonzero(magnitudes == MAGNITUDES - 1).tolist():
            length = int(decoder.decode(model.Uniform(_MOST_BITS)))
            rest = int(decoder.decode(model.Uniform(1 << length))) if length else 0
            magnitudes[place] = (1 << length) + rest + MAGNITUDES - 2
        known = np.flatnonzero(magnitudes)
        if known.size:
            negative = decoder.decode(model.Uniform(2), known.size).astype(bool)
            magnitudes[known[negative]] *= -1
        levels[level][where] = magnitudes.reshape(levels[level][where].shape)
