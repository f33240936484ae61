"""Coarser levels of a volume in bricks: means of 2 x 2 x 2 samples, found brick by brick and kept in files.

Means are those of the samples that are there, so that level n has means of (2^n)^3 samples, fewer at the ends and
where some are NaN.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.bricks.lattice import Box, LatticeSpec, slices
from sheetsplat.bricks.partition import Partition
from sheetsplat.bricks.readers import Shape
from sheetsplat.bricks.resident import residents
from sheetsplat.bricks.sources import BrickSource, Level
from sheetsplat.bricks.store import Store
from sheetsplat.fields import ending


def means(values: NDArray[Any], kind: np.dtype[Any]) -> NDArray[Any]:
    """Return the means of 2 x 2 x 2 samples [k, j, i] of a type; NaN where there are none."""
    shape = tuple(-(-size // 2) for size in values.shape)
    made = np.empty(shape, kind)
    for k in range(shape[0]):
        # Two layers at a time: a whole brick in float64 would take many times its memory.
        layers = values[2 * k : 2 * k + 2].astype(np.float64)
        there = ~np.isnan(layers)
        total, count = np.where(there, layers, 0.0).sum(axis=0), there.sum(axis=0, dtype=np.float64)
        for axis in (0, 1):
            places = np.arange(0, total.shape[axis], 2)
            total, count = np.add.reduceat(total, places, axis=axis), np.add.reduceat(count, places, axis=axis)
        made[k] = np.where(count > 0, total / np.maximum(count, 1.0), np.nan)
    return made


def _of_level(store: Store, edge: int, level: int, stored: np.dtype[Any], box: Box) -> NDArray[Any]:
    """Return the samples of a box of a level whose bricks are in a store; `edge`: of a brick, in its samples."""
    found = np.empty([last - first for first, last in box], stored)
    for place in itertools.product(*(range(first // edge, (last - 1) // edge + 1) for first, last in box)):
        brick: Any = tuple((n * edge, n * edge + edge) for n in place)
        inner: Any = tuple((max(a, c), min(b, d)) for (a, b), (c, d) in zip(box, brick, strict=True))
        found[slices(inner, box)] = store.read(_name(level, place), slices(inner, brick))
    return found


def _name(level: int, place: Iterable[int]) -> str:
    return f"level_{level}_{'_'.join(map(str, place))}"


def coarsen_brick(shared: tuple[Partition, int, int, Store], source: BrickSource, number: int) -> None:
    """Make and keep levels of one brick, whose samples stay in this process where they fit.

    `shared`: the bricks, their edge in samples, how many levels, and where these are kept.
    """
    partition, edge, count, store = shared
    core = partition.bricks[number].samples
    assert core is not None
    values, kind = residents().samples(source, core, core), mean_type(source)
    for level in range(1, count + 1):
        values = means(values, kind)
        store.write(_name(level, (first // edge for first, _ in core)), values)


def mean_type(source: BrickSource) -> np.dtype[Any]:
    """Return the type of means of samples."""
    return np.dtype(np.float64 if source.dtype.itemsize > 4 else np.float32)


def levels_of(source: BrickSource, store: Store, edge: int, count: int) -> tuple[Level, ...]:
    """Return levels that `coarsen_brick` made of all bricks."""
    kind = mean_type(source)
    made = []
    for level in range(1, count + 1):
        width = 1 << level
        nk, nj, ni = (-(-size // width) for size in source.shape)
        coarse = BrickSource(
            f"{source.name}, level {level}",
            f"{source.token}level{level}",
            (nk, nj, ni),
            kind,
            partial(_of_level, store, edge >> level, level, kind),
            quantity=source.quantity,
        )
        made.append(Level(coarse, (float(width),) * 3, (0.5 * (width - 1),) * 3))
    return tuple(made)


def most_levels(shape: Shape, edge: int) -> int:
    """Return how many levels bricks of an edge can have: each of its samples is of one brick."""
    return min((edge & -edge).bit_length() - 1, max(1, math.ceil(math.log2(max(shape)))))


def lattices_of(source: BrickSource, lattice: LatticeSpec) -> Iterator[LatticeSpec]:
    """Yield the lattices of the coarser levels of a volume on a lattice."""
    for one in source.coarser:
        steps = ending.steps(lattice.lattice, lattice.spacing, lattice.axes)
        spacing = [a * b for a, b in zip(one.steps, lattice.spacing, strict=True)]
        axes = None if lattice.axes is None else tuple(map(tuple, (np.asarray(one.steps)[:, None] * steps).tolist()))
        origin = (np.asarray(lattice.origin) + np.asarray(one.start) @ steps).tolist()
        yield lattice.replace(shape=one.source.shape, spacing=tuple(spacing), axes=axes, origin=tuple(origin))
