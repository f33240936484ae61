"""Spheres for points without a mesh, by their nearest neighbours."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from sheetsplat import _memory
from sheetsplat.errors import complain, option_ref
from sheetsplat.fields import NanPolicy, Periodic, Wrapping, periodic_box

from ._kernels import Floats, Kernels
from ._points import count_of, merge, nearest_neighbours, places, positive, scalars, scaled, usable

_WHAT = "fit.nearest"
_MOST = 256


def nearest(
    points: ArrayLike,
    values: ArrayLike,
    *,
    neighbors: int = 12,
    overlap: float = 2.0,
    falloff: float = 8.0,
    periodic: Periodic = None,
    nan: NanPolicy = "error",
) -> Kernels:
    """Return a sphere for each point, with a radius by the distances of its nearest neighbours.

    The radius is `overlap` times the local distance of points: the cube root of the volume per point, where the point
    and its neighbours fill a ball evenly that has the neighbours' root mean square radius. Nothing guarantees a least
    weight sum, because gaps in the data cannot be detected; where cells are anisotropic, :func:`delaunay` needs far
    less overlap.

    Parameters
    ----------
    points
        World positions, (N, 3), more than `neighbors` different ones.
    values
        One for each point.
    neighbors
        Number of neighbours, from 1 to 256.
    overlap
        Radius in local distances.
    falloff
        k of the kernel's profile.
    periodic
        A box ((x0, y0, z0), (x1, y1, z1)), world units, in which points wrap, as for
        :class:`sheetsplat.EllipsoidField`: neighbours across its faces count.
    nan
        What a point is whose position or value is not finite: "error", or "skip", which leaves it out, with a
        `PictureWarning`.

    Returns
    -------
    Kernels
        In the order of the points; `report` has `points` (given) and `merged` (at the position of another; values are
        averaged).

    Raises
    ------
    InvalidInput
        For arrays whose sizes disagree, numbers that are not finite (the first is named) unless these points are left
        out, and too few positions.
    OutOfMemory
        Where the distances do not fit.

    Examples
    --------
    >>> points = np.random.default_rng(1).random((200, 3))
    >>> len(ss.fit.nearest(points, points[:, 2], neighbors=8).centers)
    200
    """
    given = usable(_WHAT, nan, points=points, values=values)
    box = periodic_box(_WHAT, periodic)
    at = Wrapping(box).wrapped(places(_WHAT, given["points"]))
    field = scalars(_WHAT, given["values"], "values", len(at))
    count = count_of(_WHAT, "neighbors", neighbors, 1, _MOST)
    overlap = positive(_WHAT, "overlap", overlap)
    falloff = positive(_WHAT, "falloff", falloff)
    place = merge(_WHAT, at, field)
    if len(place.points) <= count:
        raise complain(
            f"{_WHAT}: the points cannot be used",
            f"{len(place.points)} different positions of {len(at)} points",
            "more than " + option_ref("neighbors") + f" = {count}",
            "use fewer " + option_ref("neighbors")
            if len(place.points) > 1
            else "make an EllipsoidField of the single point",
        )
    _memory.require(len(place.points) * (16 * (count + 1) + 200), f"the neighbours of {len(place.points)} points")
    near, size = scaled(place.points)
    if box is not None:
        # A tree of a box counts from its lower corner.
        near, size = place.points - box[0], 1.0
    _, distance = nearest_neighbours(near, count, sides=None if box is None else Wrapping(box).sides)
    # The mean square distance from the centre of a ball of radius r is 3/5 r^2.
    ball = np.sqrt(5.0 / 3.0 * np.mean(distance**2, axis=1))
    spacing: Floats = ball * (4.0 * math.pi / (3.0 * (count + 1))) ** (1.0 / 3.0) * size
    return Kernels(
        centers=place.points,
        scales=overlap * spacing,
        values=place.values,
        falloff=falloff,
        report={"points": len(at), "merged": place.merged},
        periodic=box,
    )
