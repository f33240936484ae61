"""Cuts of space into bricks by a k-d tree, and their order from front to back.

Every point belongs to exactly one brick: cells are half-open, and neighbours share the number of the face between them.
The kernels that a brick needs beside its own, its ghosts, follow from how far beyond its cell a picture looks.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import Bounds, Triple
from sheetsplat.bricks.lattice import Box, LatticeSpec
from sheetsplat.camera import Camera
from sheetsplat.errors import complain

#: Bricks in the order in which they are composited: a number, or the parts in front and behind.
Nested: TypeAlias = "int | tuple[Nested, Nested]"
#: Bricks in the order in which they are merged: a number, or what is merged at once, from front to back.
Grouped: TypeAlias = "int | tuple[Grouped, ...]"
#: Parts that are merged at once, at most: fewer tasks, and what they take still fits.
MERGED = 8
EVERYWHERE: Bounds = ((-math.inf,) * 3, (math.inf,) * 3)


@dataclass(frozen=True)
class Split:
    """A plane across an axis of the world that divides the bricks of a part of the tree.

    Attributes
    ----------
    axis
        0, 1 or 2.
    place
        The plane's coordinate; points on it lie above.
    below, above
        The parts of the tree on its sides: splits or the numbers of bricks.
    """

    axis: int
    place: float
    below: Split | int
    above: Split | int


@dataclass(frozen=True)
class Brick:
    """A cell of space, with the samples in it.

    Attributes
    ----------
    number
        Its place among `Partition.bricks`.
    cell
        Its points x, lower <= x < upper, in the world or the lattice's own coordinates (`Partition.to_box`); infinite
        where the brick has no neighbour.
    samples
        The samples that are its own, [k, j, i]; None for scattered kernels, whose centres say where they belong.
    """

    number: int
    cell: Bounds
    samples: Box | None = None

    def reached(
        self, centers: NDArray[np.float64], extents: NDArray[np.float64], margin: float = 0.0
    ) -> NDArray[np.bool_]:
        """Return which kernels reach closer to the cell than `margin`: its own and its ghosts.

        Parameters
        ----------
        centers
            (N, 3), world.
        extents
            Half the extents of the supports along the world's axes, (N, 3).
        margin
            World units, as `BrickView.margin` gives it.
        """
        lower, upper = np.asarray(self.cell)
        near = (centers + extents + margin >= lower) & (centers - extents - margin <= upper)
        found: NDArray[np.bool_] = near.all(axis=1)
        return found


@dataclass(frozen=True)
class Partition:
    """Bricks that fill space.

    Attributes
    ----------
    bricks
        The bricks by their numbers.
    tree
        How splits divide them.
    to_box
        What takes world positions to the coordinates of cells and splits, rows of (3, 3); None: these are the world's.
    """

    bricks: tuple[Brick, ...]
    tree: Split | int
    to_box: tuple[Triple, Triple, Triple] | None = None

    def __len__(self) -> int:
        """Return the number of bricks."""
        return len(self.bricks)

    def nested(self, camera: Camera) -> Nested:
        """Return the numbers of all bricks in pairs (in front, behind).

        Along the ray of each pixel everything in the first of a pair comes before everything in the second, so that
        pairs can be merged in any process, inner ones first, into one picture whose bits do not depend on where.
        """
        eye, back = np.asarray(camera.eye, np.float64), np.asarray(camera.world_axes()[2], np.float64)
        if self.to_box is not None:
            eye, back = np.asarray(self.to_box) @ eye, np.asarray(self.to_box) @ back
        return _nested(self.tree, eye if camera.kind == "perspective" else None, back)

    def order(self, camera: Camera) -> tuple[int, ...]:
        """Return the numbers of all bricks from front to back."""
        return tuple(_leaves(self.nested(camera)))

    def brick_of(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the numbers of the bricks that points (N, 3) belong to."""
        found = np.empty(len(points), np.int64)
        if self.to_box is not None:
            points = points @ np.transpose(self.to_box)

        def descend(part: Split | int, chosen: NDArray[np.int64]) -> None:
            if isinstance(part, int):
                found[chosen] = part
                return
            above = points[chosen, part.axis] >= part.place
            descend(part.below, chosen[~above])
            descend(part.above, chosen[above])

        descend(self.tree, np.arange(len(points)))
        return found


def _nested(part: Split | int, eye: NDArray[np.float64] | None, back: NDArray[np.float64]) -> Nested:
    if isinstance(part, int):
        return part
    below, above = _nested(part.below, eye, back), _nested(part.above, eye, back)
    # `back` points towards the viewer, who has no place in orthographic views.
    eye_above = back[part.axis] > 0 if eye is None else eye[part.axis] >= part.place
    return (above, below) if eye_above else (below, above)


def _leaves(nested: Nested) -> Iterator[int]:
    if isinstance(nested, int):
        yield nested
    else:
        for part in nested:
            yield from _leaves(part)


def grouped(nested: Nested, shown: Collection[int]) -> Grouped | None:
    """Return how bricks are merged, a few at a time: neighbours first. It does not depend on where they are drawn.

    Parameters
    ----------
    nested
        All bricks, as `Partition.nested` returns them.
    shown
        Those that are drawn; without one of them there is nothing to merge.
    """
    groups, are_bricks = _groups(nested, set(shown))
    groups = _closed(groups) if are_bricks else groups
    while len(groups) > 1:
        groups = [one for at in range(0, len(groups), MERGED) for one in _closed(groups[at : at + MERGED])]
    return groups[0] if groups else None


def _groups(nested: Nested, shown: Collection[int]) -> tuple[list[Grouped], bool]:
    """Return the bricks of a part of the tree, if they are merged at once, or else groups of them; and which it is."""
    if isinstance(nested, int):
        return ([nested] if nested in shown else []), True
    (front, first), (back, second) = (_groups(part, shown) for part in nested)
    if first and second and len(front) + len(back) <= MERGED:
        return front + back, True
    return (_closed(front) if first else front) + (_closed(back) if second else back), False


def _closed(groups: list[Grouped]) -> list[Grouped]:
    return [tuple(groups)] if len(groups) > 1 else groups


def partition_lattice(lattice: LatticeSpec, brick: int | Sequence[int] = 256) -> Partition:
    """Return a lattice cut into bricks of at most so many samples along each axis.

    Faces lie midway between samples, at multiples of the brick's size in samples, so that bricks can be the chunks of a
    file.

    Parameters
    ----------
    lattice
        The lattice.
    brick
        Samples along every axis, or along k, j, i.

    Raises
    ------
    InvalidInput
        For sizes below 1.
    """
    sizes = (brick,) * 3 if isinstance(brick, int) else tuple(brick)
    if len(sizes) != 3 or min(sizes) < 1:
        raise complain("bricks cannot be made", f"brick={brick}", "a whole number of samples, at least 1, or three")
    bricks: list[Brick] = []

    def cut(samples: Box, cell: Bounds) -> Split | int:
        # The longest side first, counted in bricks.
        counts = [math.ceil((last - first) / size) for (first, last), size in zip(samples, sizes, strict=True)]
        array_axis = max(range(3), key=lambda n: counts[n])
        if counts[array_axis] == 1:
            bricks.append(Brick(len(bricks), cell, samples))
            return len(bricks) - 1
        first, last = samples[array_axis]
        middle = first + sizes[array_axis] * (counts[array_axis] // 2)
        axis = 2 - array_axis
        place = lattice.face(axis, middle)
        sides = []
        for part, low, high in (((first, middle), None, place), ((middle, last), place, None)):
            inner: Box = tuple(part if n == array_axis else samples[n] for n in range(3))  # type: ignore[assignment]
            sides.append(cut(inner, _cut_off(cell, axis, low, high)))
        return Split(axis, place, sides[0], sides[1])

    nk, nj, ni = lattice.shape
    tree = cut(((0, nk), (0, nj), (0, ni)), EVERYWHERE)
    rows = None if lattice.to_box is None else tuple(_triple(row) for row in lattice.to_box.tolist())
    return Partition(tuple(bricks), tree, rows)  # type: ignore[arg-type]


def partition_points(points: NDArray[np.float64], bricks: int) -> Partition:
    """Return space cut into so many bricks with about as many of the points (N, 3) in each.

    The points may be a sample of all centres. Fewer bricks come out where points coincide.

    Raises
    ------
    InvalidInput
        For a number of bricks below 1.
    """
    if bricks < 1:
        raise complain("bricks cannot be made", f"{bricks} bricks", "a whole number of at least 1")
    made: list[Brick] = []

    def cut(chosen: NDArray[np.float64], count: int, cell: Bounds) -> Split | int:
        extent = chosen.max(axis=0) - chosen.min(axis=0) if len(chosen) else np.zeros(3)
        axis = int(np.argmax(extent))
        if count == 1 or not extent[axis] > 0:
            made.append(Brick(len(made), cell))
            return len(made) - 1
        low = count // 2
        along = chosen[:, axis]
        nth = min(max(round(len(chosen) * low / count), 1), len(chosen) - 1)
        place = float(np.partition(along, nth)[nth])
        if not along.min() < place:
            place = float(along[along > along.min()].min())
        above = along >= place
        return Split(
            axis,
            place,
            cut(chosen[~above], low, _cut_off(cell, axis, None, place)),
            cut(chosen[above], count - low, _cut_off(cell, axis, place, None)),
        )

    tree = cut(np.asarray(points, np.float64).reshape(-1, 3), bricks, EVERYWHERE)
    return Partition(tuple(made), tree)


def _cut_off(cell: Bounds, axis: int, low: float | None, high: float | None) -> Bounds:
    """Return a cell with another lower or upper end along an axis."""
    lower, upper = list(cell[0]), list(cell[1])
    lower[axis] = lower[axis] if low is None else low
    upper[axis] = upper[axis] if high is None else high
    return _triple(lower), _triple(upper)


def _triple(values: Sequence[float]) -> Triple:
    x, y, z = values
    return x, y, z
