"""Points on curves and surfaces: which they are, and the near neighbours that take the place of cells there."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ._kernels import Floats, Numbers
from ._points import nearest_neighbours

# Near neighbours of a point among which its edges are chosen, by which its surroundings are told to be flat, and which
# hold a part together.
_NEAR = 24
_AROUND = 16
_TOGETHER = 8
# Parts with fewer points are too small to be told from a volume: columns of levels, for instance.
_LEAST = 256
# Least share of the points on curves and surfaces: fewer are outer layers of a grid, or cost little in the volume.
_SHARE = 1.0 / 16.0
# A neighbourhood is flat where it is this much thinner than wide, and smooth where a paraboloid leaves this much of
# its thickness, or of the distance of points.
_FLAT = 0.25
_ROUGH = 0.25
_NOISE = 0.1
# Wider neighbourhoods: this share of a part, at most so many points, of so many points of the part.
_WIDER = 128
_WIDEST = 256
_VOTERS = 256
# A point is a stray where it is farther away than this many times the neighbours of its neighbours.
_STRAY = 2.0
_CHUNK = 1 << 14


def _chunks(array: NDArray[np.generic]) -> Iterator[NDArray[np.generic]]:
    return (array[first : first + _CHUNK] for first in range(0, len(array), _CHUNK))


def _smooth(points: Floats, rounding: float, most: int, chosen: Numbers | None = None) -> NDArray[np.bool_]:
    """Return which neighbourhoods of so many points are flat, and a paraboloid but for little of their thickness, (N,).

    `chosen`: of these points only.
    """
    near, _ = nearest_neighbours(points, most, chosen)
    found = []
    for own, others in zip(_chunks(points if chosen is None else points[chosen]), _chunks(near), strict=True):
        at = np.concatenate([own[:, None], points[others]], axis=1)
        at -= at.mean(axis=1, keepdims=True)
        sizes, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", at, at))
        height, v, u = np.moveaxis(at @ axes, 2, 0)
        wide, thick = np.sqrt(np.maximum(sizes[:, 2], 0.0)), np.linalg.norm(height, axis=1)
        flat = thick <= _FLAT * wide + rounding
        height, u, v = height[flat], u[flat] / wide[flat, None], v[flat] / wide[flat, None]
        basis, _ = np.linalg.qr(np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=2))
        rest = height - np.einsum("nkb,nb->nk", basis, np.einsum("nkb,nk->nb", basis, height))
        spacing = np.linalg.norm(at[flat, min(2, at.shape[1] - 1)] - at[flat, 0], axis=1)
        rough = np.maximum(_ROUGH * thick[flat], _NOISE * spacing * math.sqrt(at.shape[1]))
        flat[flat] = np.linalg.norm(rest, axis=1) <= rough + rounding
        found.append(flat)
    return np.concatenate(found)


def _seen(points: Floats) -> Iterator[Floats]:
    """Yield the points as they are and with the same extent along all their axes.

    Sheets of points that only the units of the axes hold apart are a volume.
    """
    yield points
    middle = points - points.mean(axis=0)
    _, extent, axes = np.linalg.svd(np.linalg.qr(middle, mode="r"))
    yield middle @ axes.T / (extent * np.sqrt(1.0 / len(points)))


def parts_of(points: Floats) -> Numbers:
    """Return the number of the part that each point is in, (N,): near neighbours hold parts together."""
    from scipy.sparse import coo_array  # type: ignore[import-untyped]
    from scipy.sparse.csgraph import connected_components  # type: ignore[import-untyped]

    near, _ = nearest_neighbours(points, _TOGETHER)
    pairs = np.repeat(np.arange(len(points)), near.shape[1]), near.reshape(-1)
    graph = coo_array((np.ones(near.size, dtype=np.int8), pairs), (len(points), len(points)))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def flat_parts(points: Floats, rounding: float) -> NDArray[np.bool_]:
    """Return which points lie on curves and surfaces, (N,).

    A part is flat where most of its neighbourhoods are smooth; small
    parts follow if there is a flat one, and are part of the volume otherwise.
    """
    part = parts_of(points)
    sizes = np.bincount(part)
    flat = np.ones(len(points), dtype=bool)
    for seen in _seen(points):
        flat &= _smooth(seen, rounding, _AROUND)
        sheets = (sizes >= _LEAST) & (2.0 * np.bincount(part, flat) > sizes)
        # Near neighbours in a grid of long cells are those in a row or layer; farther ones tell it from a surface.
        for number in np.flatnonzero(sheets & (sizes > _WIDER * _AROUND)):
            inside = np.flatnonzero(part == number)
            voters = np.random.default_rng(1).choice(inside, _VOTERS, replace=False)
            sheets[number] = _smooth(seen, rounding, min(_WIDEST, len(inside) // _WIDER), voters).mean() > 0.5
        if sizes[sheets].sum() < _SHARE * len(points):
            return np.zeros(len(points), dtype=bool)
    return np.asarray((sheets | (sizes < _LEAST))[part])


def edges_along(points: Floats, chosen: NDArray[np.bool_]) -> Numbers:
    """Return pairs of near neighbours, one of them chosen, that no other neighbour lies between, (E, 2).

    A point lies between two where it sees them more than 135 degrees apart: along a curve the next points on both
    sides are left, on a surface those around.
    """
    near, distance = nearest_neighbours(points, _NEAR)
    first = np.flatnonzero(chosen)
    pairs = []
    for own, others in zip(_chunks(first), _chunks(near[first]), strict=True):
        offsets = points[others] - points[own][:, None]
        product = offsets @ offsets.transpose(0, 2, 1)
        squared = np.einsum("njj->nj", product)
        # [between, end]: the cosine of the angle at `between`, times both distances.
        cosine = squared[:, :, None] - product
        beyond = squared[:, :, None] - 2.0 * product + squared[:, None, :]
        between = (cosine < 0.0) & (cosine * cosine > 0.5 * squared[:, :, None] * beyond)
        row, column = np.nonzero(~between.any(axis=1))
        one, other = own[row], others[row, column]
        # A stray point would stretch those that it is nearest to.
        pairs.append(np.stack([one, other], axis=1)[np.sqrt(squared[row, column]) <= _STRAY * distance[other, -1]])
    ends = np.sort(np.concatenate(pairs), axis=1)
    keys = np.unique(ends[:, 0] * len(points) + ends[:, 1])
    return np.stack(np.divmod(keys, len(points)), axis=1)


def triangles_of(edges: Numbers, points: Floats) -> Numbers:
    """Return the triangles of a point and two others with edges to it, less than 120 degrees apart, (M, 3)."""
    ends = np.concatenate([edges, edges[:, ::-1]])
    at, other = ends[np.argsort(ends[:, 0], kind="stable")].T
    starts = np.searchsorted(at, np.arange(len(points) + 1))
    # Each edge with those that follow it at the same point.
    lengths = starts[at + 1] - np.arange(len(at)) - 1
    one = np.repeat(np.arange(len(at)), lengths)
    two = np.arange(len(one)) - np.repeat(np.cumsum(lengths) - lengths, lengths) + one + 1
    a, b = (points[other[edge]] - points[at[edge]] for edge in (one, two))
    apart = np.einsum("ni,ni->n", a, b) / (np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1))
    return np.asarray(np.stack([at[one], other[one], other[two]], axis=1)[apart > -0.5], dtype=np.int64)
