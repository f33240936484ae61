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
from sheetsplat.bricks.kernel_pieces import Pieces
from sheetsplat.bricks.partition import Brick, Partition
from sheetsplat.bricks.store import Store
from sheetsplat.fields import EllipsoidField
from sheetsplat.fields.axes import frames
from sheetsplat.io.kernels import logarithm

Floats = NDArray[np.float64]
#: A structured array.
Table = NDArray[Any]

# Bits along an axis of the curve by which the kernels of a brick are sorted.
_BITS = 10
# Supports of kernels are enlarged by this, so that rounding does not leave out one that just reaches.
_ROUNDING = 1.0 + 1e-12


#: Rows of sorted pieces that lie close together in one brick: the piece, its first row and the row behind the last; the
#: brick that the centres lie in; the box around the supports; smallest and largest value.
SEGMENTS = np.dtype(
    [("piece", "i8"), ("first", "i8"), ("last", "i8"), ("brick", "i8"), ("lower", "f8", 3), ("upper", "f8", 3),
     ("range", "f8", 2)]
)  # fmt: skip


def table_of(field: EllipsoidField) -> Table:
    """Return the kernels of a field as a table of what they have, (N,), with the row of each."""
    axes = 1 if field.scales.ndim == 1 else 3
    parts: dict[str, Any] = {"center": field.centers, "axes": field.scales.reshape(field.size, axes)}
    parts |= {} if field.rotations is None else {"turn": field.rotations}
    parts |= {"value": field.values} | ({} if field.weights is None else {"weight": field.weights})
    parts["row"] = np.arange(field.size)
    table = np.empty(field.size, [(name, "f8", np.shape(one)[1:]) for name, one in parts.items()])
    for name, one in parts.items():
        table[name] = one
    return table


def field_of_table(table: Table, template: EllipsoidField, value_range: tuple[float, float]) -> EllipsoidField:
    """Return the field of the kernels of a table, with the options of another field."""
    turns, weights = (table[name] if name in (table.dtype.names or ()) else None for name in ("turn", "weight"))
    scales = table["axes"][:, 0] if table["axes"].shape[1] == 1 else table["axes"]
    return template.with_rows(table["center"], scales, turns, table["value"], weights, value_range=value_range)


def _extents(table: Table) -> Floats:
    """Return half the extents of supports along the world's axes, (N, 3)."""
    axes = np.broadcast_to(table["axes"], (len(table), 3))
    if "turn" not in (table.dtype.names or ()):
        return np.asarray(axes * _ROUNDING)
    return np.asarray(np.sqrt(((frames(table["turn"]) * axes[:, None, :]) ** 2).sum(axis=2)) * _ROUNDING)


def supports_of(segments: Table, bricks: int) -> tuple[Bounds, ...]:
    """Return the boxes around the supports of the kernels of each brick that has any."""
    lower, upper = np.full((bricks, 3), np.inf), np.full((bricks, 3), -np.inf)
    np.minimum.at(lower, segments["brick"], segments["lower"])
    np.maximum.at(upper, segments["brick"], segments["upper"])
    there = np.flatnonzero((lower <= upper).all(axis=1))
    return tuple((tuple(lower[n].tolist()), tuple(upper[n].tolist())) for n in there)


def joined_segments(_: Any, *parts: Table) -> Table:
    """Return all segments of several pieces."""
    return np.concatenate(parts)


def sort_piece(shared: tuple[Partition, int, Store], pieces: Pieces, number: int) -> Table:
    """Sort a piece by bricks, keep it, and return its segments.

    `shared`: the bricks, how many rows a segment has at most, and where the piece is kept.
    """
    partition, rows, store = shared
    table = table_of(pieces.read(number).with_images())
    bricks = partition.brick_of(table["center"])
    order = np.lexsort((_curve(table["center"]), bricks))
    table, bricks = table[order], bricks[order]
    store.write(_name(number), table)
    starts = np.flatnonzero(np.diff(bricks, prepend=-1))
    ends = np.append(starts[1:], len(bricks))
    first = np.concatenate([np.arange(a, b, rows) for a, b in zip(starts.tolist(), ends.tolist(), strict=True)])
    found = np.empty(len(first), SEGMENTS)
    found["piece"], found["first"], found["last"], found["brick"] = (
        number,
        first,
        [*first[1:], len(bricks)],
        bricks[first],
    )
    extents, values = _extents(table), table["value"]
    found["lower"] = np.minimum.reduceat(table["center"] - extents, first, axis=0)
    found["upper"] = np.maximum.reduceat(table["center"] + extents, first, axis=0)
    found["range"] = np.stack((np.minimum.reduceat(values, first), np.maximum.reduceat(values, first)), axis=1)
    return found


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
    kind
        Of the tables of kernels.
    store, segments
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
    kind: np.dtype[Any]
    store: Store
    segments: Table
    partition: Partition
    longest: float
    floor: float | None = None
    limits: tuple[float, float] | None = None

    @property
    def key(self) -> tuple[Any, ...]:
        """What `read` depends on: equal for the same kernels shown in the same way."""
        return self.token, self.floor, self.limits, self.template.normalization

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

    def summed(self) -> KernelSource:
        """Return the same kernels for plain sums."""
        return self.replace(template=self.template.summed())

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
        ranges = self.segments["range"][self._reaching(self.partition.bricks[number], margin)]
        if not len(ranges):
            return None
        low, high = self.shown_as(np.array([ranges[:, 0].min(), ranges[:, 1].max()])).tolist()
        return low, high

    def _reaching(self, brick: Brick, margin: float) -> NDArray[np.bool_]:
        """Return which segments may reach closer to a brick than `margin`."""
        lower, upper = np.asarray(brick.cell)
        known = self.segments
        near = (known["upper"] + margin >= lower) & (known["lower"] - margin <= upper)
        found: NDArray[np.bool_] = near.all(axis=1)
        return found

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
        brick = self.partition.bricks[number]
        found = self.segments[self._reaching(brick, margin)]
        count = int((found["last"] - found["first"]).sum())
        # What is read, what is kept of it, and the field.
        what = f"{count} kernels around brick {number} of {self.name}"
        _memory.require(3 * self.kind.itemsize * count, what, "use smaller bricks")
        tables, pieces = [np.empty(0, self.kind)], [np.empty(0, np.int64)]
        # Segments that follow one another are read as one.
        begins = np.ones(len(found), bool)
        begins[1:] = (found["piece"][1:] != found["piece"][:-1]) | (found["first"][1:] != found["last"][:-1])
        for part in np.split(found, np.flatnonzero(begins)[1:]) if len(found) else ():
            piece, first, last = (int(one) for one in (part["piece"][0], part["first"][0], part["last"][-1]))
            table = self.store.read(_name(piece), slice(first, last))
            near = table[brick.reached(table["center"], _extents(table), margin)]
            tables.append(near)
            pieces.append(np.full(len(near), piece))
        table = np.concatenate(tables)
        table = table[np.lexsort((table["row"], np.concatenate(pieces)))]
        table["value"] = self.shown_as(table["value"])
        return field_of_table(table, self.template, value_range), self.kind.itemsize * count


__all__ = ["KernelSource", "field_of_table", "joined_segments", "sort_piece", "supports_of", "table_of"]
