"""Values at points of a volume in bricks: computed where its bricks are."""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat.bricks.cluster import probe
from sheetsplat.bricks.lattice import LatticeSpec
from sheetsplat.bricks.needs import factors_in, partition_of
from sheetsplat.bricks.probe import Probing
from sheetsplat.bricks.sources import BrickSource
from sheetsplat.bricks.view import shows
from sheetsplat.fields import BrickedField
from sheetsplat.transfer import TransferFunction

Floats = NDArray[np.float64]


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

    def sums(self, field: BrickedField, places: Floats, columns: int) -> tuple[Floats, NDArray[np.int64]]:
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
    ) -> dict[int, tuple[Floats, NDArray[np.int64]]]:
        source = field.source
        assert isinstance(source, BrickSource)
        jobs = {number: places[part] for number, part in groups.items()}
        _memory.require(8 * (probing.columns + 4) * len(places), f"values at {len(places)} points")
        client = None if self.client is None else self.client()
        if client is None or client.status != "running" or not jobs:
            return {number: probing.sums(source, number, points) for number, points in jobs.items()}
        return probe(client, source, probing, jobs)
