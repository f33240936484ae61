"""Scattered kernels sorted by bricks, of which any process reads those that reach a cell.

Kernels are sorted piece by piece into the bricks that their centres lie in, and within a brick along a curve that fills
space (Morton 1966), so that a few hundred rows in a row lie close together. Of such a segment it is known where its
supports reach: a brick reads its own segments and, of its neighbours, those that reach it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import Bounds
from sheetsplat.bricks.partition import Brick, Partition
from sheetsplat.bricks.store import Store
from sheetsplat.fields import EllipsoidField
from sheetsplat.fields.axes import frames
from sheetsplat.io.kernels import logarithm

Floats = NDArray[np.float64]

# Bits along an axis of the curve by which the kernels of a brick are sorted.
_BITS = 10
# Supports of kernels are enlarged by this, so that rounding does not leave out one that just reaches.
_ROUNDING = 1.0 + 1e-12


@dataclass(frozen=True)
class Columns:
    """Which columns a table of kernels has: x, y, z, semi-axes, a quaternion, value, weight, and the row of the piece.

    Attributes
    ----------
    axes
        Columns of semi-axes: 1 of spheres, 3 of ellipsoids.
    turned, weighted
        Whether there are quaternions, and weights.
    """

    axes: int
    turned: bool
    weighted: bool

    @classmethod
    def of(cls, field: EllipsoidField) -> Columns:
        """Return the columns that the kernels of a field need."""
        return cls(1 if field.scales.ndim == 1 else 3, field.rotations is not None, field.weights is not None)

    @property
    def count(self) -> int:
        """Number of columns."""
        return 5 + self.axes + 4 * self.turned + self.weighted

    @property
    def value(self) -> int:
        """The column of values."""
        return 3 + self.axes + 4 * self.turned

    def table(self, field: EllipsoidField) -> Floats:
        """Return the kernels of a field as a table."""
        parts = [field.centers, field.scales.reshape(field.size, self.axes)]
        parts += [] if field.rotations is None else [field.rotations]
        parts += [field.values[:, None]] + ([] if field.weights is None else [field.weights[:, None]])
        return np.concatenate([*parts, np.arange(field.size, dtype=np.float64)[:, None]], axis=1)

    def arrays(self, table: Floats) -> tuple[Floats, Floats, Floats | None, Floats, Floats | None]:
        """Return centres, semi-axes, quaternions, values and weights of a table."""
        scales = table[:, 3] if self.axes == 1 else table[:, 3:6]
        turns = table[:, 3 + self.axes : 7 + self.axes] if self.turned else None
        weights = table[:, self.value + 1] if self.weighted else None
        return table[:, :3], scales, turns, table[:, self.value], weights

    def extents(self, table: Floats) -> Floats:
        """Return half the extents of supports along the world's axes, (N, 3)."""
        _, scales, turns, _, _ = self.arrays(table)
        axes = np.broadcast_to(scales.reshape(len(table), self.axes), (len(table), 3))
        if turns is None:
            return np.asarray(axes * _ROUNDING)
        return np.asarray(np.sqrt(((frames(turns) * axes[:, None, :]) ** 2).sum(axis=2)) * _ROUNDING)


@dataclass(frozen=True, eq=False)
class Segments:
    """Rows of sorted pieces that lie close together in one brick. All arrays have one entry, or row, a segment.

    Attributes
    ----------
    piece, first, last
        The piece, its first row, and the row behind the last.
    brick
        Number of the brick that the centres lie in.
    lower, upper
        The box around the supports, (N, 3).
    ranges
        Smallest and largest value, (N, 2).
    """

    piece: NDArray[np.int64]
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    brick: NDArray[np.int64]
    lower: Floats
    upper: Floats
    ranges: Floats

    @classmethod
    def joined(cls, _: Any, *parts: Segments) -> Segments:
        """Return all segments of several."""
        names = ("piece", "first", "last", "brick", "lower", "upper", "ranges")
        return cls(*(np.concatenate([getattr(one, name) for one in parts]) for name in names))

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays."""
        return sum(int(one.nbytes) for one in vars(self).values())

    def reaching(self, cell: Bounds, margin: float) -> NDArray[np.int64]:
        """Return the numbers of segments that may reach closer to a cell than `margin`."""
        lower, upper = np.asarray(cell)
        near = ((self.upper + margin >= lower) & (self.lower - margin <= upper)).all(axis=1)
        return np.flatnonzero(near)

    def supports(self, bricks: int) -> tuple[Bounds, ...]:
        """Return the boxes around the supports of the kernels of each brick that has any."""
        lower, upper = np.full((bricks, 3), np.inf), np.full((bricks, 3), -np.inf)
        np.minimum.at(lower, self.brick, self.lower)
        np.maximum.at(upper, self.brick, self.upper)
        there = np.flatnonzero((lower <= upper).all(axis=1))
        return tuple((tuple(lower[n].tolist()), tuple(upper[n].tolist())) for n in there)


def sort_piece(table: Floats, number: int, columns: Columns, partition: Partition, rows: int, store: Store) -> Segments:
    """Sort a piece by bricks, keep it, and return its segments of at most so many rows."""
    centers = table[:, :3]
    bricks = partition.brick_of(centers)
    order = np.lexsort((_curve(centers), bricks))
    table, bricks = table[order], bricks[order]
    store.write(_name(number), table)
    starts = np.flatnonzero(np.diff(bricks, prepend=-1))
    ends = np.append(starts[1:], len(bricks))
    first = np.concatenate([np.arange(a, b, rows) for a, b in zip(starts.tolist(), ends.tolist(), strict=True)])
    last = np.append(first[1:], len(bricks))
    extents, values = columns.extents(table), table[:, columns.value]
    return Segments(
        np.full(len(first), number, np.int64),
        first.astype(np.int64),
        last.astype(np.int64),
        bricks[first].astype(np.int64),
        np.minimum.reduceat(table[:, :3] - extents, first, axis=0),
        np.maximum.reduceat(table[:, :3] + extents, first, axis=0),
        np.stack((np.minimum.reduceat(values, first), np.maximum.reduceat(values, first)), axis=1),
    )


def _name(piece: int) -> str:
    return f"piece_{piece:07d}"


def _curve(points: Floats) -> NDArray[np.int64]:
    """Return the numbers of points along a curve that fills their box (Morton 1966)."""
    low = points.min(axis=0)
    extent = np.maximum(np.ptp(points, axis=0), 1e-300)
    cells = np.minimum((points - low) / extent * (1 << _BITS), (1 << _BITS) - 1).astype(np.int64)
    found = np.zeros(len(points), np.int64)
    for bit in range(_BITS):
        for axis in range(3):
            found |= (cells[:, axis] >> bit & 1) << (3 * bit + axis)
    return found


@dataclass(frozen=True, eq=False)
class KernelSource:
    """Scattered kernels that stay where they are until those of a brick are read.

    Attributes
    ----------
    name
        As that of the pieces they were sorted from.
    token
        The same for the same kernels cut in the same way.
    template
        A field without kernels that has their options, quantity and orientation.
    columns, store, segments
        The sorted pieces, and what is known of them.
    partition
        The bricks.
    longest
        Largest semi-axis of all kernels, world units.
    floor
        The values are log10(value / floor), 0 for smaller values; None: as they are.
    limits
        Values beyond these are moved to them; None: as they are.
    """

    name: str
    token: str
    template: EllipsoidField
    columns: Columns
    store: Store
    segments: Segments
    partition: Partition
    longest: float
    floor: float | None = None
    limits: tuple[float, float] | None = None

    @property
    def key(self) -> tuple[Any, ...]:
        """What `read` depends on: equal for the same kernels shown in the same way."""
        return self.token, self.floor, self.limits

    def __eq__(self, other: object) -> bool:
        """Return whether the kernels are the same, shown in the same way."""
        return self.key == other.key if isinstance(other, KernelSource) else NotImplemented

    def __hash__(self) -> int:
        """Return a hash of `key`."""
        return hash(self.key)

    def __repr__(self) -> str:
        """Return a text that is the same for the same kernels."""
        return f"KernelSource({self.key!r}, {len(self.partition)} bricks)"

    def replace(self, **changes: Any) -> KernelSource:
        """Return the same kernels shown in another way."""
        return replace(self, **changes)

    @property
    def owner(self) -> object:
        """What exists as long as anything shows these kernels, in whatever way."""
        return self.store

    @property
    def carried(self) -> int:
        """Bytes that go along where it is pickled."""
        return self.store.carried + self.segments.nbytes

    def shown_as(self, values: Floats) -> Floats:
        """Return values as they are stored in the way in which they are shown."""
        if self.floor is not None:
            values = logarithm(values, self.name, self.floor)
        return values if self.limits is None else np.clip(values, *self.limits)

    def value_range(self, number: int, margin: float) -> tuple[float, float] | None:
        """Return a range of the values of all kernels that reach a brick; None where there are none."""
        ranges = self.segments.ranges[self.segments.reaching(self._brick(number).cell, margin)]
        if not len(ranges):
            return None
        low, high = self.shown_as(np.array([ranges[:, 0].min(), ranges[:, 1].max()])).tolist()
        return low, high

    def _brick(self, number: int) -> Brick:
        return self.partition.bricks[number]

    def read(self, number: int, margin: float, value_range: tuple[float, float]) -> tuple[EllipsoidField, int]:
        """Return the kernels that reach closer to a brick than `margin`, and the bytes that were read for them.

        Kernels are in the order of the pieces and of their rows, whatever the bricks.

        Parameters
        ----------
        number
            Of the brick.
        margin
            World units.
        value_range
            Of all kernels.

        Raises
        ------
        OutOfMemory
            Where they do not fit.
        Error
            Where they cannot be read any more.
        """
        brick = self._brick(number)
        found = self.segments.reaching(brick.cell, margin)
        count = int((self.segments.last[found] - self.segments.first[found]).sum())
        # What is read, what is kept of it, and the field.
        what = f"{count} kernels around brick {number} of {self.name}"
        _memory.require(3 * 8 * self.columns.count * count, what, "use smaller bricks")
        tables, pieces = [], []
        for piece, first, last in self._spans(found):
            table = self.store.read(_name(piece), slice(first, last))
            extents = self.columns.extents(table)
            near = table[brick.reached(table[:, :3], extents, margin)]
            tables.append(near)
            pieces.append(np.full(len(near), piece))
        table = np.concatenate(tables) if tables else np.empty((0, self.columns.count))
        order = np.lexsort((table[:, -1], np.concatenate(pieces))) if tables else slice(0)
        centers, scales, turns, values, weights = self.columns.arrays(table[order])
        field = self.template.with_rows(centers, scales, turns, self.shown_as(values), weights, value_range=value_range)
        return field, 8 * self.columns.count * count

    def _spans(self, found: NDArray[np.int64]) -> list[tuple[int, int, int]]:
        """Return piece, first and last row of segments, those that follow one another as one."""
        spans: list[tuple[int, int, int]] = []
        known = self.segments
        for piece, first, last in zip(
            known.piece[found].tolist(), known.first[found].tolist(), known.last[found].tolist(), strict=True
        ):
            if spans and spans[-1][0] == piece and spans[-1][2] == first:
                spans[-1] = (piece, spans[-1][1], last)
            else:
                spans.append((piece, first, last))
        return spans


__all__ = ["Columns", "KernelSource", "Segments", "sort_piece"]
