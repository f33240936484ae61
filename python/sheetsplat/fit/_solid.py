"""Spheres that fill a closed mesh."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat import _memory
from sheetsplat.errors import complain

from ._kernels import Floats, Kernels, Numbers
from ._mesh import ClosedMesh, close, winding_on_grid
from ._points import count_of, positive, scalars

_WHAT = "fit.solid"
_LEVELS = 8
_MOST = 50_000_000
_ROUNDS = 16
_NEAR = 0.003


@dataclass(frozen=True)
class _Filling:
    """Cells of a hierarchy: middles, (N, 3), and edges, (N,)."""

    centers: Floats
    edges: Floats


def _eroded(full: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the cells all of whose 26 neighbours are full; beyond the grid nothing is."""
    result = full
    for axis in range(3):
        padded = np.pad(result, [(1, 1) if one == axis else (0, 0) for one in range(3)])
        parts = [[slice(None)] * 3 for _ in range(3)]
        for shift, part in enumerate(parts):
            part[axis] = slice(shift, shift + full.shape[axis])
        result = padded[tuple(parts[0])] & padded[tuple(parts[1])] & padded[tuple(parts[2])]
    return result


def _halved(full: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which blocks of 2 x 2 x 2 cells are full."""
    x, y, z = (size // 2 for size in full.shape)
    return np.asarray(full.reshape(x, 2, y, 2, z, 2).all(axis=(1, 3, 5)))


def _doubled(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return cells.repeat(2, axis=0).repeat(2, axis=1).repeat(2, axis=2)


def _fill(mesh: ClosedMesh, spacing: float, levels: int) -> _Filling:
    """Return the cells of a subdivision hierarchy whose smallest ones have the edge `spacing`.

    A cell is divided unless it and all cells of its size around it are full, so that sizes of neighbours differ by a
    factor of 2 at most.
    """
    lower, upper = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    block = 2 ** (levels - 1)
    # Whole numbers of cells, the nearest to the box: faces along the axes are off by a quarter of a cell at most.
    across = np.maximum(np.rint((upper - lower) / spacing), 1.0)
    wide = block * np.ceil(across / block)
    total = float(np.prod(wide))
    _memory.require(int(min(total * 8.0, 2.0**62)), f"a grid of {total:.3g} cells in which the solid is filled")
    nx, ny, nz = (int(part) for part in wide)
    origin = 0.5 * (lower + upper) - spacing * (0.5 * across + (wide - across) // 2)
    # The inside of any shell is solid; a hollow is where they cancel.
    full = winding_on_grid(mesh, origin, spacing, (nx, ny, nz)) != 0
    pyramid = [full]
    for _ in range(levels - 1):
        pyramid.append(_halved(pyramid[-1]))
    centers, edges = [], []
    covered: NDArray[np.bool_] | None = None
    for level in range(levels - 1, -1, -1):
        free = pyramid[level] if level == 0 else _eroded(pyramid[level])
        if covered is not None:
            covered = _doubled(covered)
            free = free & ~covered
        covered = free if covered is None else covered | free
        edge = spacing * 2**level
        cells: Numbers = np.argwhere(free)
        centers.append(origin + (cells + 0.5) * edge)
        edges.append(np.full(len(cells), edge))
    return _Filling(np.concatenate(centers), np.concatenate(edges))


def _fill_to_count(mesh: ClosedMesh, wanted: int, levels: int) -> tuple[_Filling, float]:
    """Return the filling whose number of cells is nearest to `wanted` of those that were tried, and its spacing."""
    extent = float(np.max(np.ptp(mesh.vertices, axis=0)))
    # More cells of the smallest size than wanted are never needed; where cells are larger inside, fewer.
    spacing = min((mesh.volume / wanted) ** (1.0 / 3.0), extent)
    best: tuple[float, _Filling, float] | None = None
    smaller, larger = 0.0, math.inf
    for _ in range(_ROUNDS):
        filling = _fill(mesh, spacing, levels)
        count = len(filling.edges)
        off = abs(count / wanted - 1.0)
        if best is None or off < best[0]:
            best = off, filling, spacing
        if off <= _NEAR:
            break
        if count > wanted:
            smaller = max(smaller, spacing)
        else:
            larger = min(larger, spacing)
        spacing *= (max(count, 0.1) / wanted) ** 0.4
        if not smaller < spacing < larger:
            spacing = math.sqrt(smaller * larger) if smaller > 0.0 else 0.7 * larger
    assert best is not None
    return best[1], best[2]


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
) -> Kernels:
    """Return spheres that fill a closed triangle mesh: small ones at its surface, larger ones inside.

    The cells of a subdivision hierarchy, each halved along every axis until it is one of the smallest or until neither
    it nor a cell of its size beside it meets the surface; of the smallest ones those count whose middle is inside. A
    sphere sits in the middle of each cell.

    Measured with the defaults on a cube, a ball and a torus of 4,000 to 20,000 spheres: an edge of the smallest cells
    below the surface W is 1.07 to 2.2, so that the density is 1; no sphere reaches farther out than 1.9 edges; its
    integral exceeds the mesh's volume by the surface's area times a tenth to a third of an edge; the cells' volumes add
    up to the mesh's to within 1 %, or, where faces lie along the axes, to whole numbers of cells across.

    Parameters
    ----------
    vertices
        World positions, (V, 3). Those at exactly the same place are one.
    triangles
        Numbers of vertices, (T, 3). The surface must be closed; it may have several shells, which may overlap: inside
        of any is inside. Shells that lie inside another and are turned the other way are hollows. Triangles that
        disagree with their neighbours are turned round, and so is a surface that encloses a negative volume; triangles
        without area do no harm.
    kernels
        Approximate number of spheres; 20,000 where `spacing` is not given either.
    spacing
        Edge of the smallest cells, world units, instead of `kernels`.
    levels
        How many sizes of cells there may be, from 1 (all equal) to 8.
    values
        The spheres' value, or a function that takes their centres, (N, 3), and returns a value each.
    overlap
        Radius of a sphere in edges of its cell.
    falloff
        k of the kernel's profile.

    Returns
    -------
    Kernels
        Larger spheres first; `report` has `spacing`, `mesh_volume`, `cell_volume` (the sum of all cells'), `shells`,
        `merged` (vertices), `degenerate` and `turned` (triangles).

    Raises
    ------
    InvalidInput
        For meshes that are not closed (the message has the number of boundary edges and the first of them), not
        orientable, or without volume; for numbers that are not finite or arrays of wrong shape; where no cell's middle
        is inside.
    OutOfMemory
        Where the smallest cells are too many to fit.
    """
    mesh = close(_WHAT, vertices, triangles)
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
        filling = _fill(mesh, size, levels)
    else:
        wanted = 20_000 if kernels is None else count_of(_WHAT, "kernels", kernels, 1, _MOST)
        filling, size = _fill_to_count(mesh, wanted, levels)
    count = len(filling.edges)
    if not count:
        raise complain(
            f"{_WHAT}: the mesh cannot be filled",
            f"no cell of edge {size:g} whose middle is inside",
            "at least one",
            "use smaller cells",
        )
    if callable(values):
        data = scalars(_WHAT, values(filling.centers), "values", count)
    else:
        data = scalars(_WHAT, np.full(count, values), "values", count)
    return Kernels(
        centers=filling.centers,
        scales=overlap * filling.edges,
        values=data,
        falloff=falloff,
        report={
            "spacing": size,
            "mesh_volume": mesh.volume,
            "cell_volume": float(np.sum(filling.edges**3)),
            "shells": mesh.shells,
            "merged": mesh.merged,
            "degenerate": mesh.degenerate,
            "turned": mesh.turned,
        },
    )
