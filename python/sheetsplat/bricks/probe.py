"""Values at points of one brick of a volume."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.bricks.lattice import Box, LatticeSpec
from sheetsplat.bricks.partition import Partition
from sheetsplat.bricks.resident import residents
from sheetsplat.bricks.sources import BrickSource
from sheetsplat.fields import RegularField

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Probing:
    """What values at points need of a volume but its samples.

    Attributes
    ----------
    lattice, partition
        The volume.
    value_range
        Of all its samples, offset by its base.
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
        field, box = self._field(source, brick.samples, box)
        sums, nearest = field.native.sums_at(np.ascontiguousarray(places))
        found = nearest >= 0
        parts = np.unravel_index(nearest[found], field.shape)
        in_box = [first + part for (first, _), part in zip(box, parts, strict=True)]
        in_volume = _in_volume(lattice, in_box)
        numbers = np.full(len(nearest), -1, np.int64)
        numbers[found] = np.ravel_multi_index(in_volume, lattice.shape)
        return sums[:, : self.columns], numbers

    def _field(self, source: BrickSource, core: Box, box: Box) -> tuple[RegularField, Box]:
        """Return a field of at least a box of samples, that of the last picture or a new one, and what samples it has.

        Coefficients of a prefilter then agree within 1e-8 of the largest sample.
        """
        lattice = self.lattice
        found: list[Box] = []

        def holds(key: tuple[LatticeSpec, Box, Any]) -> bool:
            found[:] = [key[1]]
            return key[0] == lattice and all(a <= c and d <= b for (a, b), (c, d) in zip(key[1], box, strict=True))

        if (kept := residents().kept(source, core, holds)) is not None:
            return kept, found[0]
        key = (lattice, box, self.value_range)
        made = residents().made(
            source, core, lattice.to_read(box), key, lambda samples: lattice.field(samples, box, self.value_range)
        )
        return made, box


def _in_volume(lattice: LatticeSpec, numbers: list[NDArray[np.int64]]) -> list[NDArray[np.int64]]:
    """Return indices along k, j, i of the samples that some are, or are mirror images of."""
    if lattice.lattice != "bcc":
        return [lattice.samples_of(axis, one) for axis, one in enumerate(numbers)]
    odd = numbers[0] % 2 == 1
    found = [lattice.samples_of(0, numbers[0])]
    for axis in (1, 2):
        even, others = (lattice.samples_of(axis, numbers[axis], n) for n in (0, 1))
        found.append(np.where(odd, others, even))
    return found
