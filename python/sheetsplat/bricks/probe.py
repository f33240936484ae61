"""Values at points of one brick of a volume."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sheetsplat.bricks.lattice import LatticeSpec
from sheetsplat.bricks.partition import Partition
from sheetsplat.bricks.resident import residents
from sheetsplat.bricks.sources import BrickSource

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Probing:
    """What values at points need of a volume but its samples.

    Attributes
    ----------
    lattice, partition
        The volume.
    value_range
        Of all its samples.
    columns
        How many of D, W and their derivatives are wanted.
    """

    lattice: LatticeSpec
    partition: Partition
    value_range: tuple[float, float]
    columns: int

    def sums(self, source: BrickSource, number: int, places: Floats) -> tuple[Floats, NDArray[np.int64]]:
        """Return sums at points in a brick, (M, columns), and the numbers of the nearest kernels in the volume, (M,).

        Raises
        ------
        Error
            What reading the brick raises.
        """
        lattice, brick = self.lattice, self.partition.bricks[number]
        assert brick.samples is not None
        box = lattice.around(brick.cell, 0.0)
        # Kept with what pictures use, and no picture of its own that others would have to give way to.
        key = (lattice, box, self.value_range)
        field = residents().made(
            source, brick.samples, lattice.to_read(box), key,
            lambda samples: lattice.field(samples, box, self.value_range),
        )  # fmt: skip
        sums, nearest = field.native.sums_at(np.ascontiguousarray(places))
        found = nearest >= 0
        parts = np.unravel_index(nearest[found], field.shape)
        in_volume = [first + part for (first, _), part in zip(box, parts, strict=True)]
        numbers = np.full(len(nearest), -1, np.int64)
        numbers[found] = np.ravel_multi_index(in_volume, lattice.shape)
        return sums[:, : self.columns], numbers
