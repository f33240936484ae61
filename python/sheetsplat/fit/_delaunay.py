"""Ellipsoids for points with or without a mesh, by their neighbourhoods."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat import _memory
from sheetsplat._checks import Bounds, shown, truth
from sheetsplat._rows import usable_rows
from sheetsplat.errors import complain, option_ref, unusable
from sheetsplat.fields import NanPolicy, Periodic, Wrapping, periodic_box

from ._apart import Arrays, computed_apart
from ._cells import Neighbourhoods, cell_blocks, grid_cells
from ._cover import Cover
from ._kernels import Floats, Kernels, Numbers, quaternions
from ._points import merge, numbers, places, positive, require_volume, scalars, scaled, shown_place, thickness
from ._sheets import edges_along, flat_parts, parts_of, triangles_of

_log = logging.getLogger("sheetsplat")
_WHAT = "fit.delaunay"

# Delaunay neighbours of random points are farther away than the mean distance of points, those in a grid are not. With
# this factor the mean weight sums agree.
_RANDOM = 0.745
# Largest circumradius of tetrahedra on the hull, relative to what is usual at their corners.
_TRIM = 3.5
# How far images of points are taken along around a periodic box, in mean distances of points.
_AROUND = 8.0
_FEWEST = 5
# Tetrahedra of a point on average beyond which points lie along curves: random points have 7.
_MOST_CELLS = 64
# Share of the points that Qhull may leave out. Where clusters are far apart it loses squares of near distances to
# rounding; each is joined by itself then.
_MOST_LOST = 1.0 / 64.0
# Least radius across curves, in mean distances of their points from their middle: for straight ones 1/64 of the length.
_THINNEST = 1.0 / 16.0
# Points lie on a curve where the share of the directions of their neighbours is at most this on average; 1/3 is one.
_CURVE = 0.4
# Points and cells that take about a second; more are computed in a process of their own.
_SHORT_POINTS = 8_000
_SHORT_CELLS = 100_000
# Measured memory of Qhull, the edges and the moments, bytes per point.
_BYTES = 4000
_CHUNK = 1 << 18


def _tetrahedra(points: Floats) -> tuple[Numbers, Numbers, Numbers]:
    """Return the tetrahedra, their neighbours, and pairs of a point that Qhull left out and the nearest vertex."""
    from scipy.spatial import Delaunay, QhullError  # type: ignore[import-untyped]

    none = np.empty((0, 4), dtype=np.int64)
    try:
        found = Delaunay(points)
    except QhullError:
        return none, none, none[:, :2]
    simplices, neighbors, coplanar = (
        array.astype(np.int64) for array in (found.simplices, found.neighbors, found.coplanar[:, [0, 2]])
    )
    return simplices, neighbors, coplanar


def _circumradii(points: Floats, cells: Numbers) -> Floats:
    """Return the radii of the spheres through the corners of tetrahedra; infinite for flat ones."""
    a = points[cells[:, 0]]
    b, c, d = (points[cells[:, n]] - a for n in (1, 2, 3))
    bc, cd, db = np.cross(b, c), np.cross(c, d), np.cross(d, b)
    volume = 2.0 * np.abs(np.einsum("ni,ni->n", b, cd))
    b2, c2, d2 = (np.einsum("ni,ni->n", e, e)[:, None] for e in (b, c, d))
    radius = np.full(len(cells), np.inf)
    solid = volume > 1e-13 * np.maximum(np.maximum(b2, c2), d2)[:, 0] ** 1.5
    radius[solid] = np.linalg.norm(b2 * cd + c2 * db + d2 * bc, axis=1)[solid] / volume[solid]
    return radius


def _trimmed(points: Floats, cells: Numbers, beside: Numbers) -> NDArray[np.bool_]:
    """Return which tetrahedra are kept: those on the hull with spheres far larger than is usual there are removed.

    A tetrahedron is removed only if it is connected to the outside through removed ones. `beside` holds the neighbours
    of each, (T, 4), -1 outside.
    """
    from scipy.sparse import coo_array  # type: ignore[import-untyped]
    from scipy.sparse.csgraph import connected_components  # type: ignore[import-untyped]

    count = len(points)
    radius = np.repeat(_circumradii(points, cells), 4)
    corner = cells.reshape(-1)
    order = np.lexsort((radius, corner))
    starts = np.searchsorted(corner[order], np.arange(count + 1))
    there = starts[1:] > starts[:-1]
    # The smallest eighth: most tetrahedra at a point of the hull may be slivers or span a gap.
    usual = np.full(count, np.inf)
    usual[there] = radius[order[(starts[:-1] + (starts[1:] - starts[:-1]) // 8)[there]]]
    large = radius[::4] > _TRIM * usual[cells].min(axis=1)
    # Each point keeps its smallest tetrahedron.
    large[order[starts[:-1][there]] // 4] = False
    outside = len(cells)
    one = np.repeat(np.arange(len(cells)), 4)
    other = np.where(beside < 0, outside, beside).reshape(-1)
    passage = large[one] & np.append(large, True)[other]
    graph = coo_array((np.ones(int(passage.sum()), dtype=np.int8), (one[passage], other[passage])), (outside + 1,) * 2)
    _, part = connected_components(graph, directed=False)
    return np.asarray(part[:outside] != part[outside])


def _moments(points: Floats, around: Neighbourhoods) -> tuple[Floats, Floats]:
    """Return principal axes, (N, 3, 3) in columns, and the neighbours' root mean square distances along them, (N, 3).

    These are singular values of the differences; eigenvalues of their products would lose the thickness of flat
    neighbourhoods to rounding.
    """
    count = around.count
    degrees = around.degrees
    axes = np.tile(np.eye(3), (count, 1, 1))
    spread = np.zeros((count, 3))
    rows = (points[around.other] - points[around.at]) * np.sqrt(around.share)[:, None]
    for degree in np.unique(degrees[degrees > 0]):
        same = np.flatnonzero(degrees == degree)
        for first in range(0, len(same), 1 + _CHUNK // int(degree)):
            some = same[first : first + 1 + _CHUNK // int(degree)]
            stacked = np.zeros((len(some), max(3, int(degree)), 3))
            stacked[:, :degree] = rows[around.starts[some][:, None] + np.arange(degree)]
            _, sizes, turned = np.linalg.svd(stacked, full_matrices=False)
            spread[some] = sizes
            axes[some] = turned.transpose(0, 2, 1)
    return axes, spread


def _strays(points: Floats, lone: NDArray[np.bool_]) -> tuple[Numbers, Numbers]:
    """Return the points that are chosen, and the nearest of the others to each."""
    from scipy.spatial import cKDTree

    alone, others = np.flatnonzero(lone), np.flatnonzero(~lone)
    return alone, others[cKDTree(points[others]).query(points[alone])[1]] if len(alone) else alone


def _least_radii(points: Floats, share: Floats, around: Neighbourhoods) -> Floats:
    """Return the least radius across the curve that each point is on, (N,), 0 elsewhere.

    Parts are what edges hold together; curves are those whose neighbours lie in about one of three directions (`share`)
    on average.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(around.at), dtype=np.int8), (around.at, around.other)), (len(points),) * 2)
    _, part = connected_components(graph, directed=False)
    sizes = np.bincount(part)
    middle = np.stack([np.bincount(part, points[:, axis]) / sizes for axis in range(3)], axis=1)
    away = np.linalg.norm(points - middle[part], axis=1)
    curves = np.bincount(part, share) < _CURVE * sizes
    return np.asarray(np.where(curves, _THINNEST * np.bincount(part, away) / sizes, 0.0)[part])


def _along(points: Floats, spread: Floats, distance: Floats, around: Neighbourhoods, overlap: float) -> Floats:
    """Return semi-axes of kernels along curves and surfaces, (N, 3)."""
    squared = spread * spread
    # A third of the number of directions in which the neighbours lie; in all three the moments are those of a volume.
    share = squared.sum(axis=1) ** 2 / np.maximum(3.0 * (squared * squared).sum(axis=1), 1e-300)
    nearest = np.full(around.count, np.inf)
    np.minimum.at(nearest, around.at, distance)
    thickness = nearest.copy()
    np.maximum.at(thickness, around.at, nearest[around.other])
    # Neighbours along a curve are at the mean distance of points, in a volume farther away.
    scales = (overlap * np.sqrt(share) * _RANDOM ** (1.5 * share - 0.5))[:, None] * spread
    scales = np.maximum(scales, 0.5 * overlap * thickness[:, None])
    # Finely sampled curves would be too thin to be seen; along them they keep their resolution.
    scales[:, 1:] = np.maximum(scales[:, 1:], _least_radii(points, share, around)[:, None])
    return np.asarray(scales)


def _grid(points: ArrayLike, values: ArrayLike, shape: object) -> tuple[Any, Any, tuple[int, int, int] | None]:
    """Return points (N, 3), values and the shape of a structured grid, or None."""
    array = numbers(_WHAT, points, "points")
    if array.ndim == 4 and array.shape[-1] == 3:
        if shape is None:
            shape = array.shape[:3]
        array = array.reshape(-1, 3)
    data = numbers(_WHAT, values, "values")
    if shape is None:
        return array, data, None
    parts = list(shape[:4]) if isinstance(shape, Sequence) or (isinstance(shape, np.ndarray) and shape.ndim) else []
    if len(parts) != 3 or not all(isinstance(part, int | np.integer) and not isinstance(part, bool) for part in parts):
        raise complain(unusable(f"{_WHAT}: shape"), shown(shape), "three whole numbers, (nk, nj, ni)")
    nk, nj, ni = map(int, parts)
    if min(nk, nj, ni) < 2:
        raise complain(
            unusable(f"{_WHAT}: shape"),
            f"({nk}, {nj}, {ni})",
            "at least 2 points along each of k, j, i",
            "a grid of one layer has no volume; use the nearest neighbours, " + option_ref("fit", "nearest"),
        )
    if nk * nj * ni != len(array):
        raise complain(
            f"{_WHAT}: the arrays do not fit together",
            f"{len(array)} points and a shape of {nk} x {nj} x {ni} = {nk * nj * ni}",
            "as many points as the shape says, i fastest",
        )
    return array, data, (nk, nj, ni)


def _used(mask: ArrayLike | None, count: int) -> NDArray[np.bool_] | None:
    if mask is None:
        return None
    given = numbers(_WHAT, mask, "mask").reshape(-1)
    if given.dtype.kind not in "biu" or len(given) != count:
        raise complain(
            unusable(f"{_WHAT}: mask"),
            f"{len(given)} entries of type {given.dtype}",
            f"{count} entries, True (or not 0) for points that count",
        )
    return np.asarray(given != 0)


def _masked(used: NDArray[np.bool_] | None, points: Any, values: Any) -> tuple[Any, Any]:
    """Return points and values with 0 for those that are not used."""
    if used is None:
        return points, values
    return np.where(used[:, None], points, 0.0), np.where(used, values, 0.0)


def _wrapped(points: Floats, values: Floats, box: Bounds, options: Mapping[str, Any]) -> Kernels:
    """Return the kernels of points in a periodic box: those of the points among their images around the box."""
    wrapping = Wrapping(box)
    place = merge(_WHAT, wrapping.wrapped(points), values)
    there, count = place.points, len(place.points)
    extent = np.where(wrapping.sides > 0, wrapping.sides, np.ptp(there, axis=0))
    spacing = (float(np.prod(np.where(extent > 0, extent, 1.0))) / max(count, 1)) ** (1.0 / 3.0)
    owners, images = wrapping.images(there, np.minimum(_AROUND * spacing, wrapping.sides))
    made = delaunay(np.concatenate((there, images)), np.append(place.values, place.values[owners]), **options)
    arrays = {name: getattr(made, name)[:count] for name in ("centers", "scales", "values", "rotations")}
    report = {**made.report, "points": len(points), "merged": place.merged}
    return replace(made, **arrays, report=report, periodic=box)


def delaunay(
    points: ArrayLike,
    values: ArrayLike,
    *,
    cells: object = None,
    shape: Sequence[int] | None = None,
    mask: ArrayLike | None = None,
    overlap: float = 2.0,
    lowest: float = 1.1,
    falloff: float = 8.0,
    trim: bool = True,
    periodic: Periodic = None,
    nan: NanPolicy = "error",
) -> Kernels:
    """Return an ellipsoid for each point, shaped by its neighbours so that the ellipsoids cover without gaps.

    Neighbours share an edge: of the mesh that `cells` or `shape` gives, else of the Delaunay tetrahedra (Neophytou &
    Mueller 2006, section 5). The semi-axes lie along the principal axes of the neighbours' second moments about the
    point, to which each cell at the point contributes equally; their lengths are `overlap` times the square roots of
    the moments (times 0.745 for points without a mesh, whose neighbours are farther than the mean distance). On a
    regular lattice this is the unit lattice's sphere of radius `overlap`, mapped as the lattice is. Then kernels are
    enlarged at every cell and edge at whose centre the weight sum W is below `lowest`, no axis beyond `overlap` times
    the distance of the point's farthest neighbour.

    Points without a mesh that lie on curves and surfaces have near neighbours in place of tetrahedra: those that no
    other is between (seen from it, at more than 135 degrees). These are parts of at least 256 points, held together by
    their 8 nearest neighbours, where most of the points and their 16 nearest lie on a paraboloid at most a quarter as
    thick as wide, but for a tenth of their distance, also with the same extent along all axes and for a 128th of the
    part's points, if they have a sixteenth of all points; points in a plane or on a line; and points of more than 64
    tetrahedra each on average. Their kernels have the neighbours' extent along the curve or surface, and across it at
    least half of `overlap` times the distance of nearest neighbours; across curves also 1/16 of the mean distance of
    their points from their middle, so that they can be seen. W is at least `lowest` at the centres of their edges and
    of the triangles between; the space that they enclose stays empty.

    Parts so far apart that Qhull would leave out more than 1/64 of the points to rounding are joined each by itself.
    More than 8,000 points, or 100,000 cells, are computed in a process of their own, so that an interrupt is answered.

    Parameters
    ----------
    points
        World positions, (N, 3), or (nk, nj, ni, 3) of a structured grid; at least 5 different ones.
    values
        One for each point.
    cells
        An unstructured mesh: arrays of point numbers, (M, 4) tetrahedra, (M, 5) pyramids, (M, 6) wedges, (M, 8)
        hexahedra in the order of VTK; one array, a sequence of them, a mapping from meshio's names, or meshio's blocks.
        Points of no cell are left out.
    shape
        A structured grid, curvilinear or not: (nk, nj, ni), i fastest.
    mask
        One entry for each point; points where it is 0 or False are left out, with their cells, and may have any values.
    overlap
        Semi-axes in distances of points. A larger one smooths more, and the number of overlapping kernels is
        proportional to its cube.
    lowest
        Least weight sum at the centres of cells and edges; above w0 = 1 the field is D/W there.
    falloff
        k of the kernel's profile.
    trim
        For points without a mesh: leave out tetrahedra on the hull whose circumscribed sphere is more than 3.5 times as
        large as is usual at their corners: slivers on flat faces, and gaps that the data do not fill.
    periodic
        A box ((x0, y0, z0), (x1, y1, z1)), world units, in which points without a mesh wrap, as for
        :class:`sheetsplat.EllipsoidField`: neighbours across its faces count.
    nan
        What a point is whose position or value is not finite: "error", or "skip", which leaves it out with its cells,
        and with a `PictureWarning`.

    Returns
    -------
    Kernels
        In the order of the points; `report` has `points` (given), `merged` (at the position of another; values are
        averaged), `left_out` (masked or of no cell), `cells`, `trimmed` (tetrahedra), `flat` (points on curves and
        surfaces), `raised` (kernels enlarged), `lowest` (a lower bound of the least weight sum at a centre) and `thin`
        (centres that stayed below `lowest`).

    Raises
    ------
    InvalidInput
        For arrays whose sizes disagree, numbers that are not finite (the first is named) unless these points are left
        out, fewer than 5 positions, and meshes in a plane or on a line.
    OutOfMemory
        Where the points are too many for Qhull and the edges, or the system ended the process.

    Examples
    --------
    >>> points = np.random.default_rng(1).random((200, 3))
    >>> kernels = ss.fit.delaunay(points, points[:, 2])
    >>> len(kernels.centers)
    200
    """
    given, data, grid = _grid(points, values, shape)
    overlap = positive(_WHAT, "overlap", overlap)
    lowest = positive(_WHAT, "lowest", lowest)
    falloff = positive(_WHAT, "falloff", falloff)
    if grid is not None and cells is not None:
        raise complain(f"{_WHAT}: the mesh cannot be used", "both cells and shape", "one of them")
    if given.ndim != 2:
        wanted = "shape (N, 3), or (nk, nj, ni, 3) of a structured grid"
        raise complain(unusable(f"{_WHAT}: points"), f"an array of shape {given.shape}", wanted)
    count = len(given)
    _memory.require(_BYTES * count, f"the neighbourhoods of {count} points")
    used = _used(mask, count)
    data = data.reshape(-1)
    if len(data) == count:
        given, data = _masked(used, given, data)
        kept = usable_rows(_WHAT, {"point": given, "value": data}, nan, row="point")
        if kept is not None:
            used = kept if used is None else used & kept
            given, data = _masked(used, given, data)
    at = places(_WHAT, given)
    field = scalars(_WHAT, data, "values", count)
    box = periodic_box(_WHAT, periodic)
    if box is not None:
        if grid is not None or cells is not None:
            failed = f"{_WHAT}: the mesh cannot be used"
            raise complain(failed, "a mesh in a periodic box", "points alone", "leave out " + option_ref("periodic"))
        shape_options = {"overlap": overlap, "lowest": lowest, "falloff": falloff, "trim": trim}
        return _wrapped(at if used is None else at[used], field if used is None else field[used], box, shape_options)
    chosen = np.arange(count) if used is None else np.flatnonzero(used)
    blocks = [grid_cells(grid)] if grid is not None else None if cells is None else cell_blocks(cells, count)
    if blocks is not None:
        if used is not None:
            blocks = [block[used[block].all(axis=1)] for block in blocks]
        blocks = [block for block in blocks if len(block)]
        if not blocks:
            raise complain(f"{_WHAT}: the mesh cannot be used", "no cell without a masked point", "at least one cell")
        chosen = np.unique(np.concatenate([block.reshape(-1) for block in blocks]))
    place = merge(_WHAT, at[chosen], field[chosen])
    if len(place.points) < _FEWEST:
        raise complain(
            f"{_WHAT}: the points cannot be used",
            f"{len(place.points)} different positions of {count} points",
            f"at least {_FEWEST}",
            "use the nearest neighbours, " + option_ref("fit", "nearest") + ", or pass the ellipsoids themselves",
        )
    extents, rounding = thickness(place.points)
    if blocks is not None:
        require_volume(_WHAT, place.points)
    trim = truth("delaunay: trim", trim)
    if blocks is not None:
        renumbered = np.zeros(count, dtype=np.int64)
        renumbered[chosen] = place.number
        blocks = [renumbered[block] for block in blocks]
    at, size = scaled(place.points)
    arrays = {
        "points": at,
        "numbers": np.array([overlap, lowest, falloff, rounding / size]),
        "trim": np.array(trim),
        "volume": np.array((extents > rounding).all()),
        **{f"block{number}": block for number, block in enumerate(blocks or ())},
    }
    long = len(at) > _SHORT_POINTS if blocks is None else sum(map(len, blocks)) > _SHORT_CELLS
    made = computed_apart(_WHAT, _shapes, arrays) if long else _shapes(arrays)
    if "alone" in made:
        raise complain(
            f"{_WHAT}: the mesh cannot be used",
            f"{len(made['alone'])} points where all their neighbours are, the first at "
            + shown_place(place.points[made["alone"][0]]),
            "cells that have a volume",
            "leave out " + option_ref("cells") + " for the Delaunay neighbours",
        )
    cell_count, trimmed, flat, raised, thin = map(int, made["counts"])
    if thin:
        _log.info("%s: the weight sum is below %g at the centres of %d cells and edges", _WHAT, lowest, thin)
    return Kernels(
        centers=place.points,
        scales=made["scales"] * size,
        values=place.values,
        rotations=quaternions(made["axes"]),
        falloff=falloff,
        report={
            "points": count,
            "merged": place.merged,
            "left_out": count - len(chosen),
            "cells": cell_count,
            "trimmed": trimmed,
            "flat": flat,
            "raised": raised,
            "lowest": float(made["lowest"]),
            "thin": thin,
        },
    )


def _joined(
    points: Floats, volume: bool, rounding: float, trim: bool
) -> tuple[list[Numbers], NDArray[np.bool_], Numbers, int]:
    """Return tetrahedra and edges, which points have edges in place of tetrahedra, those left out, and what is trimmed.

    Those that Qhull leaves out are pairs of a point and the nearest vertex.
    """
    flat = flat_parts(points, rounding) if volume else np.ones(len(points), dtype=bool)
    cells, spares, trimmed = [np.empty((0, 4), dtype=np.int64)], [np.empty((0, 2), dtype=np.int64)], 0
    groups = [] if flat.all() else [np.flatnonzero(~flat)]
    while groups:
        group = groups.pop()
        own = points if len(group) == len(points) else scaled(points[group])[0]
        simplices, beside, spare = _tetrahedra(own)
        if len(spare) > _MOST_LOST * len(own):
            part = parts_of(own)
            if part.any():
                groups += [group[part == number] for number in range(part.max() + 1)]
                continue
        if not 0 < len(simplices) <= _MOST_CELLS * len(own):
            flat[group] = True
            continue
        if trim:
            keep = _trimmed(own, simplices, beside)
            trimmed += int((~keep).sum())
            simplices = simplices[keep]
        cells.append(group[simplices])
        spares.append(group[spare])
    blocks = [np.concatenate(cells)] + ([edges_along(points, flat)] if flat.any() else [])
    return [block for block in blocks if len(block)], flat, np.concatenate(spares), trimmed


def _shapes(given: Arrays) -> dict[str, NDArray[Any]]:
    """Return axes, (N, 3, 3), semi-axes, (N, 3), and numbers of a report for the arrays that `_fit` passes."""
    points, (overlap, lowest, falloff, rounding), trim = given["points"], given["numbers"], bool(given["trim"])
    blocks = [block for name, block in given.items() if name.startswith("block")]
    count = len(points)
    trimmed = 0
    flat = np.zeros(count, dtype=bool)
    spare = np.empty((0, 2), dtype=np.int64)
    ratio = float(overlap)
    if not blocks:
        blocks, flat, spare, trimmed = _joined(points, bool(given["volume"]), rounding, trim)
        ratio *= _RANDOM
    around = Neighbourhoods(blocks, count)
    axes, spread = _moments(points, around)
    distance = np.linalg.norm(points[around.other] - points[around.at], axis=1)
    farthest = np.zeros(count)
    np.maximum.at(farthest, around.at, distance)
    scales = ratio * spread
    if flat.any():
        scales[flat] = _along(points, spread, distance, around, overlap)[flat]
    # Points that Qhull left out get the shape of the nearest vertex, and so do stray points.
    for lone, like in (spare.T, _strays(points, flat & (farthest == 0.0))):
        for array in (axes, scales, farthest):
            array[lone] = array[like]
    alone = ~(farthest > 0.0)
    if alone.any():
        return {"alone": np.flatnonzero(alone)}
    # Kernels of flat neighbourhoods need a thickness.
    limits = overlap * farthest
    scales = np.maximum(scales, 1e-9 * limits[:, None])
    cover = Cover(points, axes, scales, limits, around, falloff)
    for block in blocks:
        cover.cover(block if block.shape[1] > 2 else triangles_of(block, points), lowest)
    cover.cover(around.edges(), lowest)
    return {
        "axes": axes,
        "scales": cover.scales,
        "lowest": np.array(cover.thinnest),
        "counts": np.array(
            [sum(len(b) for b in blocks if b.shape[1] > 2), trimmed, flat.sum(), cover.raised.sum(), cover.thin]
        ),
    }
