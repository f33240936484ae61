"""Spheres that fill a closed mesh."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat import _memory
from sheetsplat._checks import number, truth
from sheetsplat.errors import complain
from sheetsplat.notices import warn

from ._kernels import Floats, Kernels, Numbers
from ._mesh import ClosedMesh, close, winding_on_grid
from ._points import count_of, positive, scalars

_WHAT = "fit.solid"
_LEVELS = 8
_MOST = 50_000_000
_ROUNDS = 16
_NEAR = 0.003
_SAME = 1.0001
# With shares of cells: how near the number is searched for, and how often.
_NEAR_SHARES = 0.05
_CORRECTIONS = 4
# Kernels unless asked for more; at least so many smallest cells across a wall, with at most so many kernels unasked.
_USUAL = 20_000
_ACROSS_WALL = 1.75
_MOST_UNASKED = 500_000
# Samples along each axis of a cell for its share inside, and how many of them are held at a time.
_SAMPLES = 3
_MOST_SAMPLES = 2**25


def _eroded(full: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the cells all of whose 26 neighbours are full; outside the grid none are."""
    result = np.pad(full, 1)
    for axis in range(3):
        line = np.moveaxis(result, axis, 0)
        result = np.moveaxis(line[:-2] & line[1:-1] & line[2:], 0, axis)
    return result


def _halved(full: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which blocks of 2 x 2 x 2 cells are full."""
    x, y, z = (size // 2 for size in full.shape)
    return np.asarray(full.reshape(x, 2, y, 2, z, 2).all(axis=(1, 3, 5)))


_Shape = tuple[int, int, int]


def _grid(mesh: ClosedMesh, spacing: float, levels: int, margin: int) -> tuple[Floats, _Shape, _Shape, _Shape]:
    """Return the corner of a grid of cells around a mesh, its shape in whole largest cells, and its part with the mesh.

    The part is the first cell and the number of cells along each axis; in all others nothing is inside.
    margin: further cells on both sides.
    """
    lower, upper = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    block = 2 ** (levels - 1)
    # Whole numbers of cells, the nearest to the box: faces across the axes are off by a quarter of a cell at most.
    across = np.maximum(np.rint((upper - lower) / spacing), 1.0) + 2 * margin
    wide = block * np.ceil(across / block)
    total = float(np.prod(wide))
    what = f"a grid of {total:.3g} cells in which the solid is filled"
    _memory.require(int(min(total * 8.0, 2.0**62)), what, "use larger cells: a larger spacing, or fewer kernels")
    first = (wide - across) // 2
    origin = 0.5 * (lower + upper) - spacing * (0.5 * across + first)
    (nx, ny, nz), (x, y, z), (mx, my, mz) = (tuple(int(part) for part in sizes) for sizes in (wide, first, across))
    return origin, (nx, ny, nz), (x, y, z), (mx, my, mz)


def _shares(mesh: ClosedMesh, origin: Floats, spacing: float, shape: tuple[int, int, int]) -> Floats:
    """Return the share of each cell of a grid that is inside, by `_SAMPLES` samples along each axis."""
    nx, ny, nz = shape
    fine = spacing / _SAMPLES
    step = max(1, _MOST_SAMPLES // (_SAMPLES**3 * ny * nz))
    parts = []
    for start in range(0, nx, step):
        count = min(step, nx - start)
        corner = origin + np.array([start * spacing, 0.0, 0.0])
        inside = winding_on_grid(mesh, corner, fine, (_SAMPLES * count, _SAMPLES * ny, _SAMPLES * nz)) != 0
        counts = inside.astype(np.uint8)
        for axis in (2, 1, 0):
            line = np.moveaxis(counts, axis, 0)
            counts = np.moveaxis(sum(line[sample::_SAMPLES] for sample in range(_SAMPLES)), 0, axis)
        parts.append(counts / float(_SAMPLES**3))
    return np.concatenate(parts)


def _fill(mesh: ClosedMesh, spacing: float, levels: int, *, shares: bool = False) -> tuple[Floats, Floats, Floats]:
    """Return the centres, (N, 3), edge lengths and shares inside, (N,), of cells whose smallest edge is `spacing`.

    A cell is divided unless it and all cells of its size around it are full, so that sizes of neighbours differ by a
    factor of 2 at most. Without `shares`, smallest cells whose centre is inside are full, and others are left out.
    """
    origin, shape, first, size = _grid(mesh, spacing, levels, 1 if truth("solid: shares", shares) else 0)
    corner = origin + spacing * np.array(first, dtype=np.float64)
    share = np.zeros(shape)
    part = share[tuple(slice(at, at + count) for at, count in zip(first, size, strict=True))]
    # In cavities the winding numbers of shells cancel.
    part[...] = _shares(mesh, corner, spacing, size) if shares else winding_on_grid(mesh, corner, spacing, size) != 0
    pyramid = [share == 1.0]
    for _ in range(levels - 1):
        pyramid.append(_halved(pyramid[-1]))
    centers, edges, inside = [], [], []
    covered = np.zeros_like(pyramid[-1])
    for level in range(levels - 1, -1, -1):
        free = (_eroded(pyramid[level]) if level else share > 0.0) & ~covered
        edge = spacing * 2**level
        cells: Numbers = np.argwhere(free)
        centers.append(origin + (cells + 0.5) * edge)
        edges.append(np.full(len(cells), edge))
        inside.append(np.ones(len(cells)) if level else share[free])
        if level:
            covered = (covered | free).repeat(2, axis=0).repeat(2, axis=1).repeat(2, axis=2)
    return np.concatenate(centers), np.concatenate(edges), np.concatenate(inside)


def _fill_to_count(mesh: ClosedMesh, wanted: int, levels: int, *, shares: bool) -> tuple[int, float]:
    """Return the number of cells that is nearest to `wanted` among those tried, and their spacing."""
    count, spacing = _fill_by_centers(mesh, wanted, levels)
    if not shares:
        return count, spacing
    # Shares take many samples, so cells are searched for by their centres: for as many fewer as shares make more.
    fewer, best = float(wanted), (math.inf, 0, spacing)
    for _ in range(_CORRECTIONS):
        count = len(_fill(mesh, spacing, levels, shares=True)[1])
        best = min(best, (abs(count / wanted - 1.0), count, spacing))
        if best[0] <= _NEAR_SHARES:
            break
        fewer *= wanted / max(count, 1)
        _, spacing = _fill_by_centers(mesh, max(1, round(fewer)), levels)
    return best[1], best[2]


def _fill_by_centers(mesh: ClosedMesh, wanted: int, levels: int) -> tuple[int, float]:
    """Return the number nearest to `wanted` of cells whose centre is inside, and their spacing."""
    extent = float(np.max(np.ptp(mesh.vertices, axis=0)))
    # The spacing for `wanted` cells of the smallest size; larger cells need a smaller one.
    spacing = min((mesh.volume / wanted) ** (1.0 / 3.0), extent)
    best: tuple[float, int, float] | None = None
    smaller, larger = 0.0, math.inf
    for _ in range(_ROUNDS):
        count = len(_fill(mesh, spacing, levels)[1])
        off = abs(count / wanted - 1.0)
        if best is None or off < best[0]:
            best = off, count, spacing
        if off <= _NEAR:
            break
        if count > wanted:
            smaller = max(smaller, spacing)
        else:
            larger = min(larger, spacing)
        spacing *= (max(count, 0.1) / wanted) ** 0.4
        # Numbers jump where cells come and go in whole layers: nothing is left to choose in between.
        if larger < smaller * _SAME:
            break
        if not smaller < spacing < larger:
            spacing = math.sqrt(smaller * larger) if smaller > 0.0 else 0.7 * larger
    assert best is not None
    return best[1], best[2]


def _wall(mesh: ClosedMesh) -> float:
    """Return twice the volume over the surface's area: the thickness of a shell; of a ball two thirds of its radius."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    return 4.0 * mesh.volume / float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def _spacing_unasked(mesh: ClosedMesh, levels: int, *, shares: bool) -> float:
    """Return the edge of the smallest cells: for the usual number, or smaller where walls are thinner than cells."""
    _, size = _fill_to_count(mesh, _USUAL, levels, shares=shares)
    wall = _wall(mesh)
    if size * _ACROSS_WALL <= wall:
        return size
    size = wall / _ACROSS_WALL
    if mesh.volume <= _MOST_UNASKED * size**3:
        return size
    count, size = _fill_to_count(mesh, _MOST_UNASKED, levels, shares=shares)
    warn(
        f"gaps in walls of the mesh: they are {wall:.3g} thick, its smallest cells {size:.3g}; "
        f"take more than {count:,} kernels, or show the surface with a program for meshes"
    )
    return size


def solid(
    vertices: ArrayLike,
    triangles: ArrayLike,
    *,
    kernels: int | None = None,
    spacing: float | None = None,
    levels: int = 3,
    values: float | Callable[[Floats], ArrayLike] = 1.0,
    overlap: float = 1.85,
    falloff: float = 8.0,
    shares: bool = False,
) -> Kernels:
    """Return spheres that fill a closed triangle mesh: small ones at its surface, larger ones inside.

    Cells of a hierarchy are halved along every axis until they are of the smallest size, or neither they nor a cell
    beside them of the same size meets the surface; of the smallest cells those are taken whose centre is inside, or
    all that are inside in part (`shares`). Each cell gets a sphere at its centre. Without shares the spheres' integral
    exceeds the mesh's volume by the surface's area times a tenth to a third of a smallest edge.

    Parameters
    ----------
    vertices
        World positions, (V, 3). Those at exactly the same position are one.
    triangles
        Numbers of vertices, (T, 3). The surface must be closed. It may have several shells, which may overlap; inside
        is what is inside any of them. Shells inside another with the opposite orientation are cavities. Triangles whose
        orientation disagrees with their neighbours' are flipped, and so is a surface that encloses a negative volume;
        triangles without area are left out.
    kernels
        Approximate number of spheres. Where `spacing` is not given either: 20,000, or as many, up to 500,000, as let
        walls be 7/4 of a smallest cell thick; walls that are thinner than that have gaps, and a warning says so.
    spacing
        Edge of the smallest cells, world units, instead of `kernels`.
    levels
        Most sizes of cells, from 1 to 8.
    values
        The spheres' value, or a function from their centres, (N, 3), to values, (N,).
    overlap
        Radius of a sphere in edges of its cell.
    falloff
        k of the kernel's profile.
    shares
        Whether the spheres of the smallest cells get weights: the share of the cell that is inside, by 3 x 3 x 3
        samples. Surfaces across the axes then show no steps.

    Returns
    -------
    Kernels
        Larger spheres first; `report` has `spacing`, `mesh_volume`, `cell_volume` (of all cells together), `shells`,
        `merged` (vertices), `degenerate`, `repeated` and `turned` (flipped) triangles.

    Raises
    ------
    InvalidInput
        For meshes that are not closed (the message has the number of boundary edges and the first of them), not
        orientable, or without volume; for numbers that are not finite or arrays of wrong shape; where no cell's centre
        is inside.
    OutOfMemory
        Where the smallest cells are too many to fit.

    Examples
    --------
    >>> vertices = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], dtype=float)
    >>> triangles = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]
    >>> kernels = ss.fit.solid(vertices, triangles, kernels=200)
    """
    mesh = close(_WHAT, vertices, triangles)
    shares = truth(f"{_WHAT}: shares", shares)
    levels = count_of(_WHAT, "levels", levels, 1, _LEVELS)
    overlap = positive(_WHAT, "overlap", overlap)
    falloff = positive(_WHAT, "falloff", falloff)
    if kernels is not None and spacing is not None:
        raise complain(f"{_WHAT}: the size cannot be chosen", "both kernels and spacing", "one of them")
    extent = np.ptp(mesh.vertices, axis=0)
    if not mesh.volume > 1e-12 * float(extent.max()) ** 3:
        raise complain(
            f"{_WHAT}: the mesh cannot be filled",
            f"a volume of {mesh.volume:g} in a box of {' x '.join(f'{part:.3g}' for part in extent)}",
            "a surface with a volume inside",
        )
    if spacing is not None:
        size = positive(_WHAT, "spacing", spacing)
    elif kernels is None:
        size = _spacing_unasked(mesh, levels, shares=shares)
    else:
        wanted = count_of(_WHAT, "kernels", kernels, 1, _MOST)
        _, size = _fill_to_count(mesh, wanted, levels, shares=shares)
    centers, edges, inside = _fill(mesh, size, levels, shares=shares)
    count = len(edges)
    if not count:
        raise complain(
            f"{_WHAT}: the mesh cannot be filled",
            f"no cell of edge {size:g} that is inside",
            "at least one",
            "use smaller cells",
        )
    data = scalars(
        _WHAT,
        values(centers) if callable(values) else np.full(count, number(f"{_WHAT}: values", values)),
        "values",
        count,
    )
    return Kernels(
        centers=centers,
        scales=overlap * edges,
        values=data,
        falloff=falloff,
        weights=inside if shares else None,
        report={
            "spacing": size,
            "mesh_volume": mesh.volume,
            "cell_volume": float(np.sum(inside * edges**3)),
            **{name: getattr(mesh, name) for name in ("shells", "merged", "degenerate", "repeated", "turned")},
        },
    )
