"""Values at points of a volume in bricks: computed where its bricks are."""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat.bricks.cluster import each
from sheetsplat.bricks.lattice import Box, LatticeSpec, holds
from sheetsplat.bricks.needs import factors_in, partition_of
from sheetsplat.bricks.partition import Partition
from sheetsplat.bricks.resident import residents
from sheetsplat.bricks.sources import BrickSource
from sheetsplat.bricks.view import shows
from sheetsplat.fields import BrickedField, RegularField
from sheetsplat.transfer import TransferFunction

Floats = NDArray[np.float64]
#: Sums at points, and the numbers of the nearest kernels in the volume.
Sums = tuple[Floats, NDArray[np.int64]]


@dataclass(frozen=True)
class Probing:
    """What values at points need of a volume but its samples.

    Attributes
    ----------
    lattice, partition
        The volume.
    value_range
        Of all its samples, counted from its base.
    columns
        How many of D, W and their derivatives are wanted.
    """

    lattice: LatticeSpec
    partition: Partition
    value_range: tuple[float, float]
    columns: int

    def sums(self, source: BrickSource, number: int, places: Floats) -> dict[int, Sums]:
        """Return by the number of a brick the sums at points in it, (M, columns), and the nearest kernels, (M,).

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
        return {number: (sums[:, : self.columns], numbers)}

    def _field(self, source: BrickSource, core: Box, box: Box) -> tuple[RegularField, Box]:
        """Return a field of at least a box of samples, that of the last picture or a new one, and what samples it has.

        Coefficients of a prefilter then agree within 1e-8 of the largest sample.
        """
        lattice = self.lattice
        found: list[Box] = []

        def is_enough(key: tuple[LatticeSpec, Box, Any]) -> bool:
            found[:] = [key[1]]
            return key[0] == lattice and holds(key[1], box)

        if (kept := residents().kept(source, core, is_enough)) is not None:
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


def _together(_: Probing, *parts: dict[int, Sums]) -> dict[int, Sums]:
    """Return the sums of several bricks."""
    return {number: found for part in parts for number, found in part.items()}


@dataclass(frozen=True)
class BrickProber:
    """Reads bricks for values at points: by the workers of a client while it is there, else in this process.

    Attributes
    ----------
    client
        Refers to a client of dask.distributed, which may be gone; None: there is none.
    function
        Bricks in which it shows nothing are not read; None: all are.
    """

    client: weakref.ref[Any] | None = None
    function: TransferFunction | None = None

    @classmethod
    def of(cls, client: Any) -> BrickProber:
        """Return what reads by the workers of a client, or here."""
        return cls(None if client is None else weakref.ref(client))

    def where_seen(self, function: TransferFunction) -> BrickProber:
        """Return one that reads no bricks in which a transfer function shows nothing; sums are 0 there."""
        return replace(self, function=function)

    def sums(self, field: BrickedField, places: Floats, columns: int) -> Sums:
        """Return sums at points, (M, columns), and the numbers of the nearest kernels, (M,): see `BrickedField`."""
        lattice = LatticeSpec.of(field)
        low, high = field.value_range
        values = low - lattice.base, high - lattice.base
        probing = Probing(lattice, partition_of(lattice, field.brick), values, columns)
        sums, nearest = np.zeros((len(places), columns)), np.full(len(places), -1, np.int64)
        groups = self._groups(field, probing, places)
        for number, (found, numbers) in self._probed(field, probing, places, groups).items():
            sums[groups[number]], nearest[groups[number]] = found, numbers
        return sums, nearest

    def _groups(self, field: BrickedField, probing: Probing, places: Floats) -> dict[int, NDArray[np.int64]]:
        """Return which points lie in each brick that is read."""
        numbers = probing.partition.brick_of(places)
        order = np.argsort(numbers, kind="stable")
        first = np.flatnonzero(np.diff(numbers[order], prepend=-1))
        groups = {int(numbers[part[0]]): part for part in np.split(order, first[1:]) if part.size}
        return {number: part for number, part in groups.items() if self._may_be_seen(field, probing, number)}

    def _may_be_seen(self, field: BrickedField, probing: Probing, number: int) -> bool:
        if self.function is None:
            return True
        lattice = probing.lattice
        samples = lattice.to_read(lattice.around(probing.partition.bricks[number].cell, 0.0))
        low, high = (lattice.largest_sum * factor for factor in factors_in(field, samples))
        # Where few kernels reach, less than all of the smallest one is left.
        return shows(self.function, min(low, 0.0) + lattice.base, max(high, 0.0) + lattice.base)

    def _probed(
        self, field: BrickedField, probing: Probing, places: Floats, groups: Mapping[int, NDArray[np.int64]]
    ) -> dict[int, Sums]:
        jobs = {number: (places[part],) for number, part in groups.items()}
        if not jobs:
            return {}
        _memory.require(8 * (probing.columns + 4) * len(places), f"values at {len(places)} points")
        client = None if self.client is None else self.client()
        if client is not None and client.status != "running":
            client = None
        task, merge = ("probe-brick", Probing.sums), ("merge-values", _together)
        found: dict[int, Sums] = each(client, field.source, probing, jobs, task, merge, probing.partition)
        return found
