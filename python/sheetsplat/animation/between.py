"""Frames between two snapshots of particles: each particle on its own path from one to the other."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat import api
from sheetsplat._checks import instance, number, numbers, shown
from sheetsplat._rows import usable_rows
from sheetsplat.animation.sources import FileStep, MemoryStep, SharedLook
from sheetsplat.errors import complain, unusable
from sheetsplat.fields import EllipsoidField
from sheetsplat.quantity import time_text
from sheetsplat.scene import Scene

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Snapshot:
    """Particles at a time, with their numbers and velocities: what frames between two of them are made of.

    Where the field has a periodic box, particles go through its nearer side.

    Parameters
    ----------
    field
        Their kernels, N of them.
    ids
        Numbers of the particles, (N,), none of them twice; those of one particle are the same in all snapshots.
    velocities
        (N, 3), world units in a unit of time.
    time
        When it is, in that unit. Figures of frames tell it.
    unit
        Its name, for these figures.

    Raises
    ------
    InvalidInput
        For arrays of other lengths, numbers that are not finite, and a number that two particles have.

    Examples
    --------
    >>> one = ss.EllipsoidField([(0, 0, 0)], 1.0, values=[1.0])
    >>> other = ss.EllipsoidField([(2, 0, 0)], 1.0, values=[1.0])
    >>> first = ss.Snapshot(one, [7], [(1, 0, 0)], time=0.0)
    >>> second = ss.Snapshot(other, [7], [(1, 0, 0)], time=2.0)
    >>> first.towards(second, 0.5).centers
    array([[1., 0., 0.]])
    """

    field: EllipsoidField
    ids: ArrayLike
    velocities: ArrayLike
    time: float
    unit: str = ""

    def __post_init__(self) -> None:
        """Check and convert."""
        instance("Snapshot: field", self.field, EllipsoidField)
        count = self.field.size
        ids = np.asarray(self.ids)
        if ids.shape != (count,) or ids.dtype.kind not in "iu":
            found = f"an array of shape {ids.shape} and type {ids.dtype}"
            raise complain(unusable("Snapshot: ids"), found, f"({count},) whole numbers")
        if np.unique(ids).size < count:
            raise complain(unusable("Snapshot: ids"), "two particles of one number", "a number for each particle")
        velocities = numbers("Snapshot: velocities", self.velocities, f"({count}, 3) numbers").astype(np.float64)
        if velocities.shape != (count, 3):
            raise complain(unusable("Snapshot: velocities"), f"an array of shape {velocities.shape}", f"({count}, 3)")
        usable_rows("Snapshot", {"velocity": velocities}, "error", row="particle")
        time = number("Snapshot: time", self.time)
        if not np.isfinite(time):
            raise complain(unusable("Snapshot: time"), f"{time:g}", "a finite number")
        if not isinstance(self.unit, str) or not self.unit.isprintable():
            raise complain(unusable("Snapshot: unit"), shown(self.unit), "a printable text")
        # Numbers of one particle may have a sign in one file and none in the other; float64 would not tell them apart.
        known = {"ids": ids.astype(np.uint64), "velocities": velocities, "time": time}
        for name, value in known.items():
            object.__setattr__(self, name, value)

    @classmethod
    def read(cls, path: str | os.PathLike[str], **options: Any) -> Snapshot:
        """Return the snapshot of an HDF5 file with Gadget's layout; `options` as for `sheetsplat.open`.

        Raises
        ------
        InvalidInput
            Where numbers, velocities or the time are missing.
        Error
            What `sheetsplat.open` raises.
        """
        from sheetsplat.io.opening import rows_of
        from sheetsplat.io.particle_motion import read_motion

        motion = read_motion(Path(path), options.get("particles"))
        opened = api.Opened.of(Path(path), options).fields[0]
        assert isinstance(opened, EllipsoidField)
        ids, velocities = motion.ids, motion.velocities
        if options.get("nan") == "skip":
            rows = rows_of(path, options)
            ids, velocities = (one if rows is None else one[rows] for one in (ids, velocities))
            moving = np.flatnonzero(np.isfinite(velocities).all(axis=1))
            opened, ids, velocities = opened.part(moving), ids[moving], velocities[moving]
        return cls(opened, ids, velocities, motion.time, motion.unit)

    def towards(self, other: Snapshot, share: float) -> EllipsoidField:
        """Return the particles between this snapshot, at the share 0, and another one, at 1.

        Particles of both follow the cubic through both positions with both velocities (Hermite); semi-axes, weights and
        values change by one factor an equal time, so that kernels whose mass is the same in both keep it. Those of one
        alone move straight on, and their weight rises from 0 or falls to 0 in proportion to time.

        Raises
        ------
        InvalidInput
            Where kernels are turned, or ellipsoids in one and spheres in the other; where options of the fields differ;
            and where no particle is in both.
        """
        first, second = self._checked(other)
        _, mine, its = np.intersect1d(self.ids, other.ids, assume_unique=True, return_indices=True)
        if not mine.size:
            raise complain("frames between snapshots cannot be drawn", "no particle in both", "numbers that stay")
        gone = np.setdiff1d(np.arange(first.size), mine)
        new = np.setdiff1d(np.arange(second.size), its)
        scales = _between(first.scales[mine], second.scales[its], share)
        values = _between(first.values[mine], second.values[its], share)
        weights = [np.ones(one.size) if one.weights is None else one.weights for one in (first, second)]
        both = _between(weights[0][mine], weights[1][its], share)
        span = other.time - self.time
        ahead, back = np.asarray(self.velocities)[gone], np.asarray(other.velocities)[new]
        centers = np.concatenate(
            (
                self._path(other, mine, its, share),
                first.centers[gone] + share * span * ahead,
                second.centers[new] - (1.0 - share) * span * back,
            )
        )
        weight = np.concatenate((both, (1.0 - share) * weights[0][gone], share * weights[1][new]))
        options: Any = {name: getattr(first, name) for name in _SAME}
        made = EllipsoidField(
            centers,
            np.concatenate((scales, first.scales[gone], second.scales[new])),
            values=np.concatenate((values, first.values[gone], second.values[new])),
            weights=weight,
            **options,
        )
        if first.weighting is not None and second.weighting is not None:
            of_both = _between(first.weighting[mine], second.weighting[its], share)
            made = made.weighted_by(np.concatenate((of_both, first.weighting[gone], second.weighting[new])))
        made = made.of_particles() if first.keeps_mass and second.keeps_mass else made
        time = time_text((1.0 - share) * self.time + share * other.time, self.unit)
        return made.of_quantity(replace(first.quantity, time=time)).with_orientation(first.orientation)

    def _checked(self, other: Snapshot) -> tuple[EllipsoidField, EllipsoidField]:
        first, second = self.field, other.field
        what = "frames between snapshots cannot be drawn"
        if any(one.rotations is not None for one in (first, second)) or first.scales.ndim != second.scales.ndim:
            raise complain(what, "kernels that are turned, or of two kinds", "spheres")
        if (first.weighting is None) != (second.weighting is None):
            raise complain(what, "weights of means in one alone", "them in both, or in none")
        for name in _SAME:
            if getattr(first, name) != getattr(second, name):
                found = f"{name} {getattr(first, name)} and {getattr(second, name)}"
                raise complain(what, found, "the same in both")
        if not other.time > self.time:
            raise complain(what, f"times {self.time:g} and {other.time:g}", "times that rise", "order the snapshots")
        return first, second

    def _path(self, other: Snapshot, mine: NDArray[Any], its: NDArray[Any], share: float) -> Floats:
        """Return positions on Hermite's cubics."""
        start = self.field.centers[mine]
        way = other.field.centers[its] - start
        if self.field.periodic is not None:
            # Through the nearer side of the box.
            side = np.subtract(self.field.periodic[1], self.field.periodic[0])
            way -= side * np.round(np.divide(way, side, out=np.zeros_like(way), where=side > 0.0))
        span = other.time - self.time
        v0, v1 = span * np.asarray(self.velocities)[mine], span * np.asarray(other.velocities)[its]
        s, t = share, 1.0 - share
        made: Floats = start + s * s * (3.0 - 2.0 * s) * way + s * t * (t * v0 - s * v1)
        return made


_SAME = ("normalization", "w0", "falloff", "cell_volume", "base", "periodic")


def _between(first: Floats, second: Floats, share: float) -> Floats:
    """Return numbers that change by one factor an equal time; where one of them is not above 0, by one difference."""
    linear = (1.0 - share) * first + share * second
    above = (first > 0.0) & (second > 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(above, first ** (1.0 - share) * second**share, linear)


_Key = tuple[str, str]
# The last snapshots that were read: frames between the same two follow each other.
_read: dict[_Key, Snapshot] = {}


def _snapshot(step: FileStep) -> Snapshot:
    key = os.fspath(step.path), f"{step.digest()} {sorted(step.look.opened.items(), key=str)}"
    if key not in _read:
        made = Snapshot.read(step.path, **{**step.look.opened, **step.options})
        while len(_read) > 1:
            _read.pop(next(iter(_read)))
        _read[key] = made
    return _read[key]


@dataclass(frozen=True)
class BetweenFiles:
    """A frame between two files of a time series."""

    first: FileStep
    second: FileStep
    share: float

    @property
    def template(self) -> Scene:
        """The look of the series."""
        return self.first.template

    def scene(self) -> Scene:
        """Return the scene between them."""
        made = _snapshot(self.first).towards(_snapshot(self.second), self.share)
        return replace(self.first.look, opened={}).of(made)

    def digest(self) -> str:
        """Return what tells both files and the place between them."""
        return f"{self.first.digest()}, {self.second.digest()}, {self.share!r}"


def sources_between(
    steps: Sequence[FileStep] | Sequence[Snapshot], look: SharedLook, between: int
) -> list[BetweenFiles | MemoryStep]:
    """Return what frames show: the steps, and so many frames between each two of them, equally far apart in time."""
    made: list[BetweenFiles | MemoryStep] = []
    for frame in range((len(steps) - 1) * (between + 1) + 1):
        # The last one is the end of the last way.
        step = min(frame // (between + 1), len(steps) - 2)
        first, second, share = steps[step], steps[step + 1], frame / (between + 1) - step
        if isinstance(first, FileStep) and isinstance(second, FileStep):
            made.append(BetweenFiles(first, second, share))
        elif isinstance(first, Snapshot) and isinstance(second, Snapshot):
            made.append(MemoryStep(partial(first.towards, second, share), replace(look, opened={})))
    return made
