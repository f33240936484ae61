"""Clipping, depth cueing and ambient occlusion. Conventions, section 10 (Effects beyond the papers)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat import _sheetsplat
from sheetsplat._checks import Triple, Vector, convert, measurable, number, parts, share, shown, strengths, triple
from sheetsplat._values import OfArguments
from sheetsplat.errors import complain, unusable

# Limit for iterators without an end.
_MOST_PLANES = 64
# Faces of a sphere, and directions by which their volume is found.
_FACES, _PROBES = 256, 20_000


def _plane(plane: object, wanted: str) -> tuple[Triple, float]:
    if isinstance(plane, str | bytes) or not isinstance(plane, Sequence) or len(plane) != 2:
        raise complain(unusable("Clip: planes"), shown(plane), wanted)
    what, advice = "Clip: a plane's normal", "divide it, and the plane's offset with it, by its length"
    normal = measurable(what, triple(what, plane[0]), advice)
    offset = number("Clip: a plane's offset", plane[1])
    if not any(normal) or not all(map(math.isfinite, (*normal, offset))):
        raise complain(unusable("Clip: planes"), shown((normal, offset)), "a finite normal of a length above 0")
    return normal, offset


def _planes(what: str, planes: object) -> tuple[tuple[Triple, float], ...]:
    wanted = "a sequence of planes (normal, offset); () for none"
    found = parts(what, planes, wanted, _MOST_PLANES)
    if len(found) > _MOST_PLANES:
        raise complain(unusable(what), f"more than {_MOST_PLANES} planes", "fewer")
    return tuple(_plane(plane, wanted) for plane in found)


def _box(what: str, box: object) -> tuple[Triple, Triple] | None:
    if box is None:
        return None
    wanted = "two corners ((x0, y0, z0), (x1, y1, z1)), the lower one first"
    corners = parts(what, box, wanted, 2)
    if len(corners) != 2:
        raise complain(unusable(what), shown(box), wanted)
    lower, upper = triple(what, corners[0]), triple(what, corners[1])
    if not all(-math.inf < low <= high < math.inf for low, high in zip(lower, upper, strict=True)):
        raise complain(unusable(what), shown((lower, upper)), wanted)
    return lower, upper


def _sphere(what: str, sphere: object) -> tuple[Triple, float] | None:
    if sphere is None:
        return None
    wanted = "a centre and a radius above 0, ((x, y, z), r)"
    found = parts(what, sphere, wanted, 2)
    if len(found) != 2:
        raise complain(unusable(what), shown(sphere), wanted)
    center, radius = triple(what, found[0]), number(what, found[1])
    if not all(map(math.isfinite, center)) or not 0.0 < radius < math.inf:
        raise complain(unusable(what), shown((center, radius)), wanted)
    return center, radius


def _spread(count: int) -> NDArray[np.float64]:
    """Return directions that are spread evenly, (count, 3)."""
    height = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angle = math.pi * (3.0 - math.sqrt(5.0)) * np.arange(count)
    around = np.sqrt(1.0 - height**2)
    return np.column_stack([around * np.cos(angle), around * np.sin(angle), height])


@cache
def _polyhedron() -> tuple[float, float]:
    """Return how far the faces of a polyhedron of the unit sphere's volume are from its middle, and from the sphere.

    The second is about the farthest that a point of it, in the middle of a face or at a corner, lies beside.
    """
    faces = _spread(_FACES)
    # Of faces at the distance 1: how far it reaches in each direction.
    reach = np.concatenate([1.0 / (part @ faces.T).max(axis=1) for part in np.array_split(_spread(_PROBES), 16)])
    distance = float(np.mean(reach**3) ** (-1.0 / 3.0))
    return distance, max(1.0 - distance, float(reach.max()) * distance - 1.0)


def _facets(center: Any, radius: float) -> list[tuple[Triple, float]]:
    """Return planes around a sphere: every backend knows half spaces."""
    faces, distance = _spread(_FACES), radius * _polyhedron()[0]
    least = (-(faces @ np.asarray(center)) - distance).tolist()
    return [((-x, -y, -z), offset) for (x, y, z), offset in zip(faces.tolist(), least, strict=True)]


@dataclass(frozen=True)
class Clip(OfArguments):
    """The region of space that is shown. Conventions, section 10 (Effects beyond the papers).

    Parameters
    ----------
    planes
        Pairs (normal, offset): points x with normal · x >= offset are kept. World units.
    box
        Two corners ((x0, y0, z0), (x1, y1, z1)), the lower one first: the box between them is kept. World units.
    sphere
        Centre and radius ((x, y, z), r): the sphere is kept, as the polyhedron of its volume with 256 faces. World
        units. Not with shadows and ambient occlusion.

    A point is kept where all planes, the box and the sphere keep it; of a kernel on the edge, what lies inside. The
    rest is transparent; the field itself, and with it the gradients next to a cut, do not change.

    Raises
    ------
    InvalidInput
        For anything but finite numbers, a normal of length 0, corners in the wrong order, and a radius not above 0.

    Examples
    --------
    >>> half = ss.Clip(planes=[((0, 0, 1), 4.0)])  # keeps z >= 4
    >>> ss.render(values, clip=half, size=(32, 32)).plan.has("clip")
    True
    """

    planes: Sequence[tuple[Vector, float]] = ()
    box: tuple[Vector, Vector] | None = None
    sphere: tuple[Vector, float] | None = None
    native: _sheetsplat.Clip = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check and convert."""
        convert(self, planes=_planes, box=_box, sphere=_sphere)
        facets = None if self.sphere is None else (_facets(*self.sphere), self.sphere[0])
        native = _sheetsplat.Clip(planes=self.planes, box=self.box, facets=facets)  # type: ignore[arg-type]
        object.__setattr__(self, "native", native)

    def keeps(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return which points (N, 3) of the world are kept, shape (N,)."""
        places = np.asarray(points, dtype=np.float64)
        kept = np.ones(len(places), bool)
        for normal, offset in self.planes:
            kept &= places @ np.asarray(normal) >= offset
        if self.box is not None:
            kept &= ((places >= self.box[0]) & (places <= self.box[1])).all(axis=1)
        if self.sphere is not None:
            kept &= np.linalg.norm(places - self.sphere[0], axis=1) <= self.sphere[1]
        return kept

    @property
    def aside(self) -> float:
        """About the farthest that the faces of what stands for the sphere lie beside it, world units; 0 without one."""
        return 0.0 if self.sphere is None else self.sphere[1] * _polyhedron()[1]

    @property
    def region(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Corners of the box around the box and the sphere; None without them."""
        boxes = [] if self.box is None else [np.asarray(self.box, dtype=np.float64)]
        if self.sphere is not None:
            center, radius = np.asarray(self.sphere[0], dtype=np.float64), self.sphere[1]
            boxes.append(np.stack([center - radius, center + radius]))
        if not boxes:
            return None
        return np.max([one[0] for one in boxes], axis=0), np.min([one[1] for one in boxes], axis=0)


def _finite_color(what: str, value: object) -> Triple:
    color = strengths(what, triple(what, value))
    if not all(map(math.isfinite, color)):
        raise complain(unusable(what), shown(color), "three finite numbers")
    return color


@dataclass(frozen=True)
class DepthCue(OfArguments):
    """Shaded colours fade with depth. Conventions, section 10 (Effects beyond the papers).

    Parameters
    ----------
    start, end
        Depths where fading begins and ends, world units from the eye along the view direction, start < end.
    color
        Colour to fade to: red, green, blue.
    strength
        Share of that colour at `end` and beyond, 0 to 1.

    Raises
    ------
    InvalidInput
        For anything but finite numbers in these ranges.

    Examples
    --------
    >>> cue = ss.DepthCue(10, 30, strength=0.7)
    >>> ss.render(values, depth_cue=cue, size=(32, 32)).plan.has("depth_cue")
    True
    """

    start: float
    end: float
    color: Vector = (0.0, 0.0, 0.0)
    strength: float = 1.0
    native: _sheetsplat.DepthCue = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check and convert."""
        convert(self, start=number, end=number, color=_finite_color, strength=share)
        if not (math.isfinite(self.start) and math.isfinite(self.end) and self.start < self.end):
            raise complain(
                "DepthCue: start and end cannot be used", f"{self.start:g} and {self.end:g}", "finite, start below end"
            )
        native = _sheetsplat.DepthCue(
            start=self.start, end=self.end, color=triple("", self.color), strength=self.strength
        )
        object.__setattr__(self, "native", native)


@dataclass(frozen=True)
class AmbientOcclusion(OfArguments):
    """Ambient light is dimmed where the surroundings are dense. Conventions, section 10 (Effects beyond the papers).

    Parameters
    ----------
    radius
        Largest distance of occluders, world units, > 0.
    strength
        Share of ambient light that dense surroundings absorb, 0 to 1.

    Raises
    ------
    InvalidInput
        For anything but finite numbers in these ranges.

    Examples
    --------
    >>> dim = ss.AmbientOcclusion(2.0)
    >>> image = ss.render(values, mode="isosurface", iso_value=0.5, ambient_occlusion=dim, size=(32, 32))
    >>> image.plan.has("ambient_occlusion")
    True
    """

    radius: float
    strength: float = 1.0
    native: _sheetsplat.AmbientOcclusion = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check and convert."""
        convert(self, radius=number, strength=share)
        if not 0.0 < self.radius < math.inf:
            raise complain(unusable("AmbientOcclusion: radius"), f"{self.radius:g}", "a finite length above 0")
        native = _sheetsplat.AmbientOcclusion(radius=self.radius, strength=self.strength)
        object.__setattr__(self, "native", native)
