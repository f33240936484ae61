"""Triangle meshes, .obj and .ply: solids that are filled with spheres."""

from __future__ import annotations

import logging
import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sheetsplat.io.records import Floats, Scattered
from sheetsplat.io.source import Source
from sheetsplat.orientation import Orientation

if TYPE_CHECKING:
    from sheetsplat.fit import Kernels

Numbers = NDArray[np.int64]

# Kernels, as many as `fit.solid` makes unless asked, and the least number of them across the thinnest side of a mesh.
_KERNELS = 20_000
_ACROSS = 4.0
# Of spheres: their radii in edges of their cells, and the weight from which on the inside has its full value: two
# thirds of what it is there. Rounder than the default of `fit.solid`, whose spheres show as beads; rods and plates are
# too thin for it.
_OVERLAP = 2.5
_FULL_WEIGHT = 2.5
# Logarithm of the volume of a box in a mesh's own axes over that of one in the world's, from which on it is taken.
_SMALLER = math.log(0.5)
# As nearly all programs write .obj.
_Y_UP = Orientation((0.0, 1.0, 0.0))

_log = logging.getLogger("sheetsplat")


def read(source: Source) -> Scattered:
    """Fill the mesh of a file with spheres of value 1 (`sheetsplat.fit.solid`); its holes are closed before.

    Of rods and plates, whose spheres would be larger than they are thick, spheres become ellipsoids along their axes.

    Raises
    ------
    InvalidInput
        For damaged files, and for meshes without an inside.
    """
    from sheetsplat import fit

    vertices, triangles = fit.read_mesh(source.path)
    vertices, triangles, holes = without_holes(vertices, triangles)
    # Vertices of no triangle are no part of the solid.
    axes, lengths = _stretching(vertices[np.unique(triangles)])
    stretched = bool((lengths != lengths[0]).any())
    if stretched:
        kernels = fit.solid((vertices @ axes) / lengths, triangles)
    else:
        kernels = fit.solid(vertices, triangles, overlap=_OVERLAP, shares=True)
    shape = f"ellipsoids, at most {lengths.max() / lengths.min():.3g} times as long as thin" if stretched else "spheres"
    details = {"mesh": f"{len(vertices) - holes} vertices, {len(triangles)} triangles, filled with {shape}"}
    if holes:
        details["holes"] = f"{holes}, closed by triangles to the middle of their edges"
        _log.info("%s: holes: %s", source.path, details["holes"])
    return Scattered(
        (kernels.centers * lengths) @ axes.T if stretched else kernels.centers,
        kernels.values,
        "inside",
        "mesh",
        ("inside",),
        scales=kernels.scales[:, None] * lengths if stretched else kernels.scales,
        rotations=_turns(kernels, axes) if stretched and (axes != np.eye(3)).any() else None,
        weights=kernels.weights,
        w0=None if stretched else _FULL_WEIGHT,
        falloff=kernels.falloff,
        details=details,
        orientation=_Y_UP if source.suffix == ".obj" else None,
    )


def _stretching(vertices: Floats) -> tuple[Floats, Floats]:
    """Return axes of a mesh as columns, and the lengths along them that are one cell: equal unless it is thin.

    Cells are as many as `_KERNELS` in the box around the mesh, at least `_ACROSS` of them along every axis, and cubes
    where that allows it. The axes are those of the world, or the mesh's own where these make a much smaller box.
    """
    axes = np.eye(3)
    extent = np.ptp(vertices, axis=0) if len(vertices) else np.zeros(3)
    if extent.any():
        middle = (vertices - vertices.mean(axis=0)) / extent.max()
        _, own = np.linalg.eigh(middle.T @ middle)
        turned = np.ptp(vertices @ own, axis=0)
        if turned.all() and float(np.log(turned).sum()) < float(np.log(extent).sum()) + _SMALLER:
            axes, extent = own * np.sign(np.linalg.det(own)), turned
    lengths = _cells(extent)
    return (axes, lengths) if (lengths != lengths[0]).any() else (np.eye(3), lengths)


def _cells(extent: Floats) -> Floats:
    """Return the edges of the cells of a box."""
    thin = np.zeros(3, bool)
    for _ in range(3):
        if not extent[~thin].all():
            # Flat: it has no volume, which the fit says better.
            return np.ones(3)
        count = _KERNELS / _ACROSS ** float(thin.sum())
        edge = math.exp((float(np.log(extent[~thin]).sum()) - math.log(count)) / float((~thin).sum()))
        thinner = ~thin & (extent < _ACROSS * edge)
        if not thinner.any():
            break
        thin |= thinner
    return np.where(thin, extent / _ACROSS, edge) if thin.any() else np.ones(3)


def _turns(kernels: Kernels, axes: Floats) -> Floats:
    """Return the rotation of every kernel as a quaternion w, x, y, z, (N, 4)."""
    from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

    x, y, z, w = Rotation.from_matrix(axes).as_quat()
    return np.tile((w, x, y, z), (len(kernels.centers), 1))


def without_holes(vertices: Floats, triangles: Numbers) -> tuple[Floats, Numbers, int]:
    """Return a mesh whose holes are closed by triangles to the middle of their edges, and the number of holes.

    Holes are closed chains of edges that belong to one triangle each, which must agree about the direction of the
    chain; other open edges stay.
    """
    start, end = triangles.reshape(-1), np.roll(triangles, -1, axis=1).reshape(-1)
    count = len(vertices)
    lone = ~np.isin(start * count + end, end * count + start)
    following = dict(zip(start[lone].tolist(), end[lone].tolist(), strict=True))
    if len(following) < int(lone.sum()):
        return vertices, triangles, 0
    middles: list[Floats] = []
    added: list[tuple[int, int, int]] = []
    while following:
        first, at = following.popitem()
        chain = [first]
        while at != first and at in following:
            chain.append(at)
            at = following.pop(at)
        if at == first:
            top = count + len(middles)
            middles.append(vertices[chain].mean(axis=0))
            added += [(after, before, top) for before, after in zip(chain, [*chain[1:], first], strict=True)]
    if not middles:
        return vertices, triangles, 0
    return np.concatenate((vertices, middles)), np.concatenate((triangles, added)), len(middles)
