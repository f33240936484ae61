"""Which way up things are: what files state, and the first view of what states nothing."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import Triple, shown, triple
from sheetsplat._checks import direction as axis_or_vector
from sheetsplat.errors import complain, unusable

# Angles in degrees of the isometric view, from (1, 1, 1) where z is up: azimuth about the up direction, elevation.
ISOMETRIC = 45.0, math.degrees(math.atan(math.sqrt(0.5)))
_PARALLEL = 1e-6
_AXES = {
    "right": (-1.0, 0.0, 0.0),
    "left": (1.0, 0.0, 0.0),
    "anterior": (0.0, -1.0, 0.0),
    "posterior": (0.0, 1.0, 0.0),
    "inferior": (0.0, 0.0, -1.0),
    "superior": (0.0, 0.0, 1.0),
}


def _parallel(first: Triple, second: Triple) -> bool:
    a, b = np.asarray(first), np.asarray(second)
    return float(np.linalg.norm(np.cross(a / np.linalg.norm(a), b / np.linalg.norm(b)))) < _PARALLEL


@dataclass(frozen=True)
class Orientation:
    """Which world direction is up in the data, and which side is the front; for the default view alone.

    Parameters
    ----------
    up
        World direction from its bottom to its top: three numbers, or an axis such as "z" or "-y".
    front
        World direction from its middle to a viewer who sees its front; only its part at right angles to `up` counts.
        None: no side is the front, and the first view is the isometric one.

    Raises
    ------
    InvalidInput
        For directions that are not finite, 0, or along each other.

    Examples
    --------
    >>> field = ss.RegularField(values).with_orientation(ss.Orientation(up="y", front="z"))
    >>> field.orientation.up
    (0.0, 1.0, 0.0)
    """

    up: Triple = (0.0, 0.0, 1.0)
    front: Triple | None = None

    def __post_init__(self) -> None:
        """Check and convert."""
        for name in ("up", "front"):
            given = getattr(self, name)
            if given is None and name == "front":
                continue
            found = axis_or_vector(f"Orientation: {name}", given)
            if not any(found) or not all(map(math.isfinite, found)):
                raise complain(unusable(f"Orientation: {name}"), shown(given), "a direction, three finite numbers")
            object.__setattr__(self, name, found)
        if self.front is not None and _parallel(self.up, self.front):
            raise complain(
                unusable("Orientation: front"), shown(self.front), "a direction that is not along the up direction"
            )

    @classmethod
    def anatomical(cls, *axes: str) -> Orientation:
        """Return the orientation of a body in a space whose axes x, y, z run towards these sides of it.

        Parameters
        ----------
        axes
            Three of "right", "left", "anterior", "posterior", "inferior", "superior", or their first letters; one of
            each of the three opposite pairs.

        Raises
        ------
        InvalidInput
            For anything else.
        """
        names = [next((name for name in _AXES if one and name.startswith(str(one).lower())), "") for one in axes]
        towards = np.array([_AXES[name] for name in names]) if len(axes) == 3 and all(names) else np.zeros((3, 3))
        if not np.all(np.abs(towards).sum(axis=0) == 1):
            wanted = "three axes, one of each pair: right or left, anterior or posterior, inferior or superior"
            raise complain(unusable("Orientation: axes"), shown(axes), wanted)
        # Row: an axis of the space, in left, posterior, superior; column: that side in axes of the space.
        up, front = towards[:, 2], 0.0 - towards[:, 1]
        return cls(triple("up", up), triple("front", front))

    def horizontal_front(self, up: Triple | None = None) -> Triple:
        """Return the unit direction from which azimuth counts, at right angles to `up` (its own unless given).

        Where there is no front, it is the axis after the one that `up` is nearest to, with its sign: x for z, z for y.
        """
        above = np.asarray(self.up if up is None else up, dtype=np.float64)
        above = above / np.linalg.norm(above)
        front = self.front
        if front is None or _parallel(front, triple("up", above)):
            axis = int(np.argmax(np.abs(above)))
            ahead = np.zeros(3)
            ahead[(axis + 1) % 3] = math.copysign(1.0, above[axis])
        else:
            ahead = np.asarray(front)
        ahead = ahead - above * np.dot(ahead, above)
        ahead = ahead / np.linalg.norm(ahead)
        return triple("front", ahead)

    def turn_to(self, other: Orientation) -> NDArray[np.float64]:
        """Return the matrix that takes places in this space, as rows, to the same places of the body in another one."""
        frames = []
        for one in (self, other):
            up, front = np.asarray(one.up) / np.linalg.norm(one.up), np.asarray(one.horizontal_front())
            frames.append(np.stack([np.cross(up, front), front, up]))
        # Spaces whose axes run along those of the other have whole numbers.
        found: NDArray[np.float64] = np.round(frames[0].T @ frames[1], 12)
        return found

    @property
    def angles(self) -> tuple[float, float]:
        """Azimuth and elevation of the first view, degrees: from the front, or isometric without one."""
        return ISOMETRIC if self.front is None else (0.0, 0.0)


#: Of what states nothing: z is up, the view isometric, as in PyVista and ParaView.
Z_UP = Orientation()
#: By where y points: downwards, and the first slice nearest, as programs for microscopes and photographs show stacks.
BY_Y = {
    "up": Orientation((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "down": Orientation((0.0, -1.0, 0.0), (0.0, 0.0, -1.0)),
}
#: Of what scanners in hospitals write by the convention of DICOM: x to the left, y to the back, z to the head.
PATIENT = Orientation.anatomical("left", "posterior", "superior")
