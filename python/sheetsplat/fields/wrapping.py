"""Periodic boxes: what leaves by a face comes in by the opposite one."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import Bounds, Vector, parts, shown, triple
from sheetsplat.errors import complain, unusable

#: A lower and an upper corner.
Periodic = tuple[Vector, Vector] | None
# Of a side.
_COARSEST = 1e-3
Floats = NDArray[np.float64]


def periodic_box(what: str, box: object) -> Bounds | None:
    """Return a periodic box with ends of 0 along the axes that do not wrap; None where none does.

    Raises
    ------
    InvalidInput
        For anything but two corners, the lower one first.
    """
    if box is None:
        return None
    name, wanted = f"{what}: periodic", "two corners, ((x0, y0, z0), (x1, y1, z1)), the lower one first"
    corners = [parts(name, corner, wanted, 3) for corner in parts(name, box, wanted, 2)]
    if len(corners) != 2 or not all(len(one) == 3 for one in corners):
        raise complain(unusable(name), shown(box), wanted)
    ends = np.array([triple(name, corner) for corner in corners])
    if np.isnan(ends).any() or (ends[0] > ends[1]).any():
        raise complain(unusable(name), shown(box), wanted)
    ends[:, (ends[0] == ends[1]) | ~np.isfinite(ends).all(axis=0)] = 0.0
    return (triple(name, ends[0]), triple(name, ends[1])) if ends.any() else None


@dataclass(frozen=True)
class Wrapping:
    """The geometry of a periodic box, as `periodic_box` returns it; of None nothing wraps."""

    box: Bounds | None

    @property
    def sides(self) -> Floats:
        """The lengths of the sides, (3,); 0 along axes that do not wrap."""
        return np.zeros(3) if self.box is None else np.subtract(self.box[1], self.box[0])

    def wrapped(self, points: Floats) -> Floats:
        """Return points, (N, 3), moved into the box."""
        if self.box is None:
            return points
        lower, sides = np.asarray(self.box[0]), self.sides
        inside = (points >= lower) & (points < self.box[1])
        # As in EllipsoidField: what the digits of a position leave open.
        lost = (np.spacing(np.abs(points)) > _COARSEST * sides) & (sides > 0) & ~inside
        if lost.any():
            point = points[lost.any(axis=1)][0].tolist()
            found = f"a position of {shown(point)}, of which float64 does not say where in the box it lies"
            raise complain(unusable("periodic"), found, "positions and a box in one unit", "check the units of both")
        share = (points - lower) / np.where(sides > 0, sides, 1.0)
        moved = lower + (share - np.floor(share)) * sides
        moved = np.where(moved < self.box[1], moved, lower)
        # What lies in the box stays what it is to the last digit.
        return np.asarray(np.where(inside | (sides == 0), points, moved))

    def apart(self, offsets: Floats) -> Floats:
        """Return differences of positions, (..., 3), to the nearest images."""
        sides = self.sides
        return np.asarray(offsets - sides * np.round(offsets / np.where(sides > 0, sides, np.inf)))

    def images(self, points: Floats, reach: Floats) -> tuple[NDArray[np.int64], Floats]:
        """Return which of the points in the box, (N, 3), have images nearer to it than `reach`, and where these lie.

        `reach`: world units, of each point, (N,) or (N, 3), or of all, (3,); at most a side.
        """
        sides = self.sides
        if self.box is None or not len(points):
            return np.empty(0, np.int64), np.empty((0, 3))
        lower, upper = (np.where(sides > 0, end, (-np.inf, np.inf)[n]) for n, end in enumerate(self.box))
        around = np.broadcast_to(reach if reach.shape[-1:] == (3,) else reach[:, None], points.shape)
        owners, places = [np.empty(0, np.int64)], [np.empty((0, 3))]
        for steps in itertools.product(*((-1, 0, 1) if side > 0 else (0,) for side in sides)):
            if any(steps):
                moved = points + np.asarray(steps) * sides
                near = ((moved + around > lower) & (moved - around < upper)).all(axis=1)
                owners.append(np.flatnonzero(near))
                places.append(moved[near])
        return np.concatenate(owners), np.concatenate(places)
