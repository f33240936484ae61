"""Triangle meshes: reading, checks that they are closed, orientation, winding numbers."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat._checks import file_path, shown
from sheetsplat.errors import complain, unusable

from ._kernels import Floats, Numbers, spans
from ._points import merge, numbers, places

_CHUNK = 1 << 18
# Of a shell at most so many triangles are tested for being inside other shells; it is a cavity if three quarters are.
_PROBES, _OUTSIDE = 12, 0.25
# Halvings of the finest of the grids in which triangles are found.
_FINEST = 20


def read_mesh(path: str | os.PathLike[str]) -> tuple[Floats, Numbers]:
    r"""Return the vertices, (V, 3), and the triangles, (T, 3), of a .obj or .ply file, also gzipped.

    Polygons become fans of triangles; materials, textures and normals are ignored.

    Raises
    ------
    InvalidInput
        For other files, damaged ones, with the line or the number of the element, and ones without a face.
    OutOfMemory
        Where the file does not fit.
    Error
        Where the file cannot be read.

    Examples
    --------
    >>> with open("tetrahedron.obj", "w") as file:
    ...     written = file.write("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
    >>> vertices, triangles = ss.fit.read_mesh("tetrahedron.obj")
    >>> vertices.shape, triangles.shape
    ((4, 3), (4, 3))
    """
    from sheetsplat.io.mesh_files import read_triangles
    from sheetsplat.io.source import Source

    with Source(file_path("the mesh cannot be read", path, "the path of a mesh")) as source:
        return read_triangles(source)


@dataclass(frozen=True)
class ClosedMesh:
    """A closed surface, its triangles counter-clockwise as seen from outside.

    Attributes
    ----------
    vertices
        Different positions of corners of triangles, (V, 3).
    triangles
        Numbers of vertices, (T, 3).
    volume
        The sum of the shells' volumes.
    shells
        Number of connected pieces.
    merged, degenerate, repeated, turned
        Vertices at the position of another, triangles with two corners at one position and those at the place of
        another (both left out), flipped triangles.
    """

    vertices: Floats
    triangles: Numbers
    volume: float
    shells: int
    merged: int
    degenerate: int
    repeated: int
    turned: int


def _triangles(what: str, given: ArrayLike, count: int) -> Numbers:
    array = numbers(what, given, "triangles")
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "iu":
        raise complain(
            unusable(f"{what}: triangles"),
            f"an array of {array.dtype} of shape {array.shape}",
            "whole numbers of vertices, shape (T, 3)",
            "split polygons into triangles",
        )
    if not len(array):
        raise complain(unusable(f"{what}: triangles"), "no triangle", "a closed surface")
    result = array.astype(np.int64)
    wrong = ((result < 0) | (result >= count)).any(axis=1)
    if wrong.any():
        first = int(np.argmax(wrong))
        raise complain(
            unusable(f"{what}: triangles"),
            f"triangle {first} of the vertices {shown(result[first].tolist())}",
            f"numbers of the {count} vertices, from 0",
        )
    return result


def _edges(triangles: Numbers, count: int) -> tuple[Numbers, NDArray[np.bool_]]:
    """Return a number for each edge of each triangle, equal for equal edges, and which start at the lower vertex."""
    start, end = triangles.reshape(-1), np.roll(triangles, -1, axis=1).reshape(-1)
    return np.minimum(start, end) * count + np.maximum(start, end), start < end


def close(what: str, vertices: ArrayLike, triangles: ArrayLike) -> ClosedMesh:
    """Return a closed, oriented mesh of the vertices that are used, or InvalidInput with the first boundary edge.

    Triangles of the same corners count once, or not at all where they are a wall inside (`_once`).
    """
    at = places(what, vertices, "vertices")
    faces = _triangles(what, triangles, len(at))
    welded = merge(what, at, np.zeros(len(at)))
    joined = welded.number[faces]
    real = (joined != np.roll(joined, 1, axis=1)).all(axis=1)
    degenerate = int((~real).sum())
    joined, faces = joined[real], faces[real]
    if not len(joined):
        raise complain(f"{what}: the mesh cannot be used", "triangles without any area", "a closed surface")
    given = len(joined)
    joined, faces = _once(joined, faces)
    if not len(joined):
        raise complain(
            f"{what}: the mesh cannot be used",
            "pairs of triangles of the same corners, which have no volume inside",
            "a closed surface",
        )
    kept, number = np.unique(joined, return_inverse=True)
    points, joined, count = welded.points[kept], number.reshape(joined.shape), len(kept)
    edge, forward = _edges(joined, count)
    _, first, number, uses = np.unique(edge, return_index=True, return_inverse=True, return_counts=True)
    number = number.reshape(-1)
    open_edges = np.flatnonzero(uses % 2 == 1)
    if len(open_edges):
        where = int(first[open_edges].min())
        start, end = int(faces.reshape(-1)[where]), int(np.roll(faces, -1, axis=1).reshape(-1)[where])
        spot = ", ".join(f"{part:.6g}" for part in 0.5 * (at[start] + at[end]))
        raise complain(
            f"{what}: the mesh is not closed",
            f"{len(open_edges)} boundary edges, the first from vertex {start} to vertex {end}, around ({spot})",
            "triangles that meet in pairs",
            "fill the holes",
        )
    flipped, shell = _orientation(what, joined, number, forward, uses)
    oriented = np.where(flipped[:, None], joined[:, ::-1], joined)
    turned = _outward(points, oriented, shell)
    oriented = np.where(turned[:, None], oriented[:, ::-1], oriented)
    edge, forward = _edges(oriented, count)
    _, place = np.unique(edge, return_inverse=True)
    balance = np.bincount(place.reshape(-1), np.where(forward, 1.0, -1.0))
    if balance.any():
        raise complain(
            f"{what}: the mesh has no inside",
            f"{int((balance != 0.0).sum())} edges of triangles that are not in pairs of opposite direction",
            "a surface that can be oriented",
            "split it there into closed shells",
        )
    return ClosedMesh(
        vertices=points,
        triangles=oriented,
        volume=float(_volumes(points, oriented).sum()),
        shells=int(shell.max()) + 1,
        merged=welded.merged,
        degenerate=degenerate,
        repeated=given - len(joined),
        turned=int((flipped != turned).sum()),
    )


def _once(triangles: Numbers, faces: Numbers) -> tuple[Numbers, Numbers]:
    """Return the triangles, and their rows of another array, of which no two have the same corners.

    Of an odd number of triangles one stays, in the direction of most. Even numbers of them are either surfaces that are
    there twice or have two sides, of which one stays as well, or walls between two bodies, which go: there one would
    leave open edges.
    """
    low = np.sort(triangles, axis=1)
    order = np.lexsort((low[:, 2], low[:, 1], low[:, 0]))
    is_new = np.append(True, (low[order[1:]] != low[order[:-1]]).any(axis=1))
    if is_new.all():
        return triangles, faces
    place, first = np.cumsum(is_new) - 1, order[is_new]
    rows, least = np.arange(len(triangles)), triangles.argmin(axis=1)
    direction = np.sign(triangles[rows, (least + 2) % 3] - triangles[rows, (least + 1) % 3])
    turned = np.bincount(place, direction[order]) * direction[first] < 0.0
    stays = np.bincount(place) % 2 == 1
    _close_by_pieces(triangles[first], stays)
    first, turned = first[stays], turned[stays]
    in_order = np.argsort(first)
    first, turned = first[in_order], turned[in_order, None]
    once, rows = (np.where(turned, array[first, ::-1], array[first]) for array in (triangles, faces))
    return once, rows


def _close_by_pieces(triangles: Numbers, stays: NDArray[np.bool_]) -> None:
    """Let those connected pieces of the triangles that do not stay do so whose open edges are open without them."""
    from scipy.sparse import coo_array  # type: ignore[import-untyped]
    from scipy.sparse.csgraph import connected_components  # type: ignore[import-untyped]

    rest = np.flatnonzero(~stays)
    edge, _ = _edges(triangles, int(triangles.max()) + 1)
    _, number = np.unique(edge, return_inverse=True)
    number = number.reshape(-1, 3)
    edges, nodes = int(number.max()) + 1, len(rest) + int(number.max()) + 1
    own, owner = number[rest].reshape(-1), np.repeat(np.arange(len(rest)), 3)
    graph = coo_array((np.ones(len(own), dtype=np.int8), (owner, len(rest) + own)), (nodes, nodes))
    _, label = connected_components(graph, directed=False)
    is_open, without = (np.bincount(some.reshape(-1), minlength=edges) % 2 == 1 for some in (own, number[stays]))
    opens = np.bincount(label[len(rest) :], is_open & ~without, minlength=nodes) > 0.0
    stays[rest] = ~opens[label[: len(rest)]]


def _orientation(
    what: str, triangles: Numbers, edge: Numbers, forward: NDArray[np.bool_], uses: Numbers
) -> tuple[NDArray[np.bool_], Numbers]:
    """Return which triangles to flip so that neighbours agree, and the number of the shell of each.

    In the graph each triangle has two nodes, one for each orientation, and neighbours are connected in the orientations
    that agree. A surface that connects the two nodes of a triangle has one side only.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    count = len(triangles)
    order = np.argsort(edge, kind="stable")
    order = order[uses[edge[order]] == 2]
    one, other = order[::2], order[1::2]
    left, right = one // 3, other // 3
    # Neighbours agree where their common edge has opposite directions in them.
    differ = (forward[one] == forward[other]).astype(np.int64)
    rows = np.concatenate([left, left + count])
    columns = np.concatenate([right + count * differ, right + count * (1 - differ)])
    graph = coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), (2 * count, 2 * count))
    _, label = connected_components(graph, directed=False)
    if (label[:count] == label[count:]).any():
        raise complain(
            f"{what}: the mesh has no inside",
            "a surface with one side only, as a Klein bottle has",
            "a surface that can be oriented",
        )
    piece = np.minimum(label[:count], label[count:])
    _, shell = np.unique(piece, return_inverse=True)
    shell = shell.reshape(-1)
    flipped = label[:count] != piece
    # The orientation of most triangles is kept.
    votes = np.bincount(shell, np.where(flipped, 1.0, -1.0))
    return flipped ^ (votes > 0.0)[shell], shell


def _volumes(vertices: Floats, triangles: Numbers) -> Floats:
    """Return the signed volumes of the tetrahedra between the triangles and the mean of the vertices."""
    a, b, c = (vertices[triangles[:, n]] - vertices.mean(axis=0) for n in range(3))
    return np.asarray(np.einsum("ni,ni->n", a, np.cross(b, c)) / 6.0)


def _outward(vertices: Floats, triangles: Numbers, shell: Numbers) -> NDArray[np.bool_]:
    """Return which triangles to flip so that each shell encloses a positive volume, except cavities inside others."""
    volume = np.bincount(shell, _volumes(vertices, triangles))
    sign = -1.0 if volume.sum() < 0.0 else 1.0
    turn = np.full(len(triangles), sign < 0.0)
    inward = np.flatnonzero(sign * volume < 0.0)
    if not len(inward) or len(volume) == 1:
        return turn
    outer = vertices[np.where((volume < 0.0)[shell][:, None], triangles[:, ::-1], triangles)]
    # Triangles of those shells, by shells, at equal steps.
    probe = np.flatnonzero(np.isin(shell, inward))
    probe = probe[np.argsort(shell[probe], kind="stable")]
    first = np.flatnonzero(np.diff(shell[probe], prepend=-1))
    count = np.diff(first, append=len(probe))
    rank = np.arange(len(probe)) - np.repeat(first, count)
    probe = probe[rank % np.repeat(-(-count // _PROBES), count) == 0]
    around, of = _winding_before(outer, probe), np.searchsorted(inward, shell[probe])
    around, count = around[np.lexsort((around, of))], np.bincount(of)
    quartile = around[np.cumsum(count) - count + (_OUTSIDE * count).astype(np.int64)]
    turn[np.isin(shell, inward[quartile < 1])] ^= True
    return turn


def _winding_before(corners: Floats, some: Numbers) -> Numbers:
    """Return the winding numbers of triangles, (T, 3, 3), in front of the middles of some of them.

    They count triangles above the middles. Which these may be, grids tell: each triangle is in four cells at most, of
    one whose cells are as large as it, so that it is compared with the middles in its surroundings only.
    """
    # Directions that no model has.
    turned = corners @ np.linalg.qr(np.sin(np.arange(1.0, 10.0)).reshape(3, 3))[0]
    turned = (turned - turned.min(axis=(0, 1))) / np.ptp(turned, axis=(0, 1)).max()
    at, low, high = turned[some].mean(axis=1), turned.min(axis=1), turned.max(axis=1)
    fine = np.minimum(-np.log2(np.maximum((high - low)[:, :2].max(axis=1), 0.5**_FINEST)), _FINEST).astype(np.int64)
    near = (low[:, :2] <= at[:, :2].max(axis=0)).all(axis=1) & (high >= at.min(axis=0)).all(axis=1)
    a, b, c = turned[some, :, :2].swapaxes(0, 1)
    result = np.where(_area(b - a, c - a) < 0.0, -1, 0)
    for level in np.unique(fine[near]):
        here, cells = np.flatnonzero(near & (fine == level)), 2 ** int(level)
        start, end = (np.floor(part[here] * cells).astype(np.int64) for part in (low, high))
        column, x = _ranges(start[:, 0], end[:, 0] + 1)
        row, y = _ranges(start[column, 1], end[column, 1] + 1)
        cell, member = x[row] * 2 * cells + y, here[column[row]]
        order = np.argsort(cell, kind="stable")
        cell, member = cell[order], member[order]
        own = np.floor(at[:, :2] * cells).astype(np.int64) @ (2 * cells, 1)
        start, end = np.searchsorted(cell, own), np.searchsorted(cell, own, side="right")
        for one, last in spans(end - start, _CHUNK):
            point, other = _ranges(start[one:last], end[one:last])
            point, other = point + one, member[other]
            for axis in (0, 1, 2):
                may = at[point, axis] <= high[other, axis]
                may &= (at[point, axis] >= low[other, axis]) | (axis == 2)
                point, other = point[may], other[may]
            a, b, c = turned[other].swapaxes(0, 1) - at[point]
            parts = np.stack([_area(b, c), _area(c, a), _area(a, b)])
            up, total = parts > 0.0, parts.sum(axis=0)
            hit = (up.all(axis=0) | ~up.any(axis=0)) & (other != some[point])
            above = parts[0] * a[:, 2] + parts[1] * b[:, 2] + parts[2] * c[:, 2]
            hit &= (above * total > 0.0) & (total != 0.0)
            result += np.bincount(point[hit], np.sign(total[hit]), minlength=len(some)).astype(np.int64)
    return result


def _area(a: Floats, b: Floats) -> Floats:
    """Return twice the areas of triangles between the origin and two corners, as seen along z."""
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def winding_numbers(points: ArrayLike, vertices: ArrayLike, triangles: ArrayLike) -> Floats:
    """Return the winding numbers of a closed surface around points, (N,): 1 inside, 0 outside.

    They are sums of solid angles over 4 pi (van Oosterom & Strackee 1983), for every pair of a triangle and a point.

    Examples
    --------
    >>> vertices = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], dtype=float)
    >>> triangles = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]
    >>> np.round(ss.fit.winding_numbers([(0.1, 0.1, 0.1), (1, 1, 1)], vertices, triangles), 6).tolist()
    [1.0, 0.0]
    """
    what = "winding_numbers"
    at, ends = places(what, points), places(what, vertices, "vertices")
    wanted = f"rows of three whole numbers from 0 to below {len(ends)}, (T, 3)"
    indices = numbers(what, triangles, "triangles")
    is_right = indices.ndim == 2 and indices.shape[1] == 3 and indices.dtype.kind in "iu"
    if not is_right or not ((indices >= 0) & (indices < len(ends))).all():
        raise complain(unusable(f"{what}: triangles"), shown(triangles), wanted)
    corners = ends[indices]
    result = np.zeros(len(at))
    for first, last in spans(np.full(len(at), len(corners)), _CHUNK):
        a, b, c = (corners[None, :, n] - at[first:last, None] for n in range(3))
        la, lb, lc = (np.sqrt(_dot(e, e)) for e in (a, b, c))
        below = la * lb * lc + _dot(a, b) * lc + _dot(b, c) * la + _dot(c, a) * lb
        result[first:last] = np.arctan2(_dot(a, np.cross(b, c)), below).sum(axis=1) / (2.0 * np.pi)
    return result


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray(np.einsum("nti,nti->nt", a, b))


def _ranges(starts: Numbers, ends: Numbers) -> tuple[Numbers, Numbers]:
    """Return all whole numbers in ranges: pairs of the number of a range and one that it contains."""
    lengths = np.maximum(ends - starts, 0)
    owner = np.repeat(np.arange(len(starts)), lengths)
    inside = np.arange(len(owner)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    return owner, starts[owner] + inside


def winding_on_grid(mesh: ClosedMesh, origin: Floats, spacing: float, shape: tuple[int, int, int]) -> NDArray[np.int16]:
    """Return the winding number at the centres of the cells of a grid [ix, iy, iz] whose corner is `origin`.

    Lines along z through the centres intersect triangles; each intersection adds 1 or -1 to all cells below it. Which
    lines pass on which side of an edge is decided once for both triangles at the edge, so that rounding opens no gap.
    """
    nx, ny, nz = shape
    scaled = (mesh.vertices - origin) / spacing - 0.5
    # The first row of centres that is not below each vertex.
    row = np.ceil(scaled[:, 1]).astype(np.int64)
    triangles = mesh.triangles
    start = triangles.reshape(-1)
    end = np.roll(triangles, -1, axis=1).reshape(-1)
    owner = np.repeat(np.arange(len(triangles)), 3)
    lower, upper = np.minimum(start, end), np.maximum(start, end)

    def crossings(some: NDArray[np.bool_]) -> tuple[Numbers, Floats, Floats]:
        a, b, of = lower[some], upper[some], owner[some]
        first, last = np.minimum(row[a], row[b]), np.maximum(row[a], row[b])
        piece, at = _ranges(np.clip(first, 0, ny), np.clip(last, 0, ny))
        a, b, of = a[piece], b[piece], of[piece]
        share = (at - scaled[a, 1]) / (scaled[b, 1] - scaled[a, 1])
        x, z = (scaled[a, c] + share * (scaled[b, c] - scaled[a, c]) for c in (0, 2))
        order = np.lexsort((at, of))
        return at[order], x[order], z[order]

    # In every row that a triangle intersects, one of its edges ascends and one descends.
    line, x_up, z_up = crossings(row[start] < row[end])
    _, x_down, z_down = crossings(row[start] > row[end])
    swap = x_up > x_down
    sign = np.where(swap, 1, -1).astype(np.int16)
    x_left, x_right = np.where(swap, x_down, x_up), np.where(swap, x_up, x_down)
    z_left, z_right = np.where(swap, z_down, z_up), np.where(swap, z_up, z_down)
    change = np.zeros((nx, ny, nz + 1), dtype=np.int16)
    first = np.clip(np.ceil(x_left), 0, nx).astype(np.int64)
    last = np.clip(np.ceil(x_right), 0, nx).astype(np.int64)
    for some, until in spans(np.maximum(last - first, 0), 8 * _CHUNK):
        piece, column = _ranges(first[some:until], last[some:until])
        piece += some
        share = (column - x_left[piece]) / (x_right[piece] - x_left[piece])
        height = z_left[piece] + share * (z_right[piece] - z_left[piece])
        below = np.clip(np.ceil(height), 0, nz).astype(np.int64)
        np.add.at(change, (column, line[piece], below), sign[piece])
    # Only intersections above a centre count.
    return np.asarray(np.cumsum(change[:, :, :0:-1], axis=2, dtype=np.int16)[:, :, ::-1])
