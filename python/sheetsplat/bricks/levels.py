"""Coarser levels of a volume in bricks: means of 2 x 2 x 2 samples, found brick by brick and kept in files.

Means are those of the samples that are there, so that level n has means of (2^n)^3 samples, fewer at the ends and
where some are NaN.
"""

from __future__ import annotations

import itertools
import math
import shutil
import tempfile
import weakref
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.bricks.lattice import Box, LatticeSpec
from sheetsplat.bricks.partition import Partition
from sheetsplat.bricks.readers import Shape
from sheetsplat.bricks.resident import residents
from sheetsplat.bricks.sources import BrickSource, Level
from sheetsplat.errors import Error, complain, option_ref


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


@dataclass(frozen=True, eq=False)
class LevelStore:
    """Levels of bricks in files of a folder that all processes see.

    Attributes
    ----------
    folder
        The folder.
    edge
        Of a brick, in samples of the volume.
    """

    folder: Path
    edge: int

    @classmethod
    def new(cls, parent: str | None, edge: int) -> LevelStore:
        """Return an empty store in a new folder, which goes with it."""
        try:
            made = cls(Path(tempfile.mkdtemp(prefix="sheetsplat-", dir=parent)), edge)
        except OSError as error:
            raise _unusable(parent or tempfile.gettempdir(), error) from None
        weakref.finalize(made, shutil.rmtree, made.folder, True)
        return made

    def write(self, level: int, place: Shape, values: NDArray[Any]) -> None:
        """Write a level of a brick, which is at a place among all bricks."""
        try:
            with tempfile.NamedTemporaryFile(dir=self.folder, suffix=".part", delete=False) as file:
                np.save(file, values)
            Path(file.name).replace(self._path(level, place))
        except OSError as error:
            raise _unusable(self.folder, error) from None

    def read(self, level: int, place: Shape, cuts: tuple[slice, ...]) -> NDArray[Any]:
        """Return a part of a level of a brick."""
        try:
            return np.array(np.load(self._path(level, place), mmap_mode="r")[cuts])
        except (OSError, ValueError) as error:
            raise _unusable(self.folder, error) from None

    def _path(self, level: int, place: Shape) -> Path:
        return self.folder / f"level_{level}_{'_'.join(map(str, place))}.npy"


def _unusable(folder: Path | str, error: Exception) -> Error:
    return complain(
        f"coarser levels in {folder} cannot be used",
        str(error),
        "a folder that all workers see, with room for a seventh of the samples in float32",
        "pass " + option_ref("scratch", "...") + " to sheetsplat.open_bricks",
        kind=Error,
    )


@dataclass(frozen=True, eq=False)
class LevelReader:
    """A level whose bricks are in a store."""

    store: LevelStore
    level: int
    stored: np.dtype[Any]

    def read(self, box: Box) -> NDArray[Any]:
        """Return the samples of a box of the level."""
        edge = self.store.edge >> self.level
        found = np.empty([last - first for first, last in box], self.stored)
        for place in itertools.product(*(range(first // edge, (last - 1) // edge + 1) for first, last in box)):
            k, j, i = place
            inner = [(max(first, n * edge), min(last, n * edge + edge))
                     for (first, last), n in zip(box, place, strict=True)]  # fmt: skip
            there = tuple(slice(a - n * edge, b - n * edge) for (a, b), n in zip(inner, place, strict=True))
            here = tuple(slice(a - first, b - first) for (a, b), (first, _) in zip(inner, box, strict=True))
            found[here] = self.store.read(self.level, (k, j, i), there)
        return found


def coarsen_brick(shared: tuple[Partition, LevelStore, int], source: BrickSource, number: int) -> None:
    """Make and keep so many levels of one brick, whose samples stay in this process where they fit."""
    partition, store, count = shared
    core = partition.bricks[number].samples
    assert core is not None
    k, j, i = (first // store.edge for first, _ in core)
    values, kind = residents().samples(source, core, core), mean_type(source)
    for level in range(1, count + 1):
        values = means(values, kind)
        store.write(level, (k, j, i), values)


def mean_type(source: BrickSource) -> np.dtype[Any]:
    """Return the type of means of samples."""
    return np.dtype(np.float64 if source.dtype.itemsize > 4 else np.float32)


def levels_of(source: BrickSource, store: LevelStore, count: int) -> tuple[Level, ...]:
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
            LevelReader(store, level, kind),
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
        spacing = [a * b for a, b in zip(one.steps, lattice.spacing, strict=True)]
        origin = [o + n * b for o, n, b in zip(lattice.origin, one.start, lattice.spacing, strict=True)]
        yield lattice.replace(shape=one.source.shape, spacing=tuple(spacing), origin=tuple(origin))
