"""Triangle meshes, .obj and .ply: solids that are filled with spheres."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from sheetsplat.io.records import Floats, Scattered
from sheetsplat.io.source import Source
from sheetsplat.orientation import Orientation

Numbers = NDArray[np.int64]

# As nearly all programs write .obj.
_Y_UP = Orientation((0.0, 1.0, 0.0))

_log = logging.getLogger("sheetsplat")


def read(source: Source) -> Scattered:
    """Fill the mesh of a file with spheres of value 1 (`sheetsplat.fit.solid`); its holes are closed before.

    Raises
    ------
    InvalidInput
        For damaged files, and for meshes without an inside.
    """
    from sheetsplat import fit

    vertices, triangles = fit.read_mesh(source.path)
    vertices, triangles, holes = without_holes(vertices, triangles)
    kernels = fit.solid(vertices, triangles)
    details = {"mesh": f"{len(vertices) - holes} vertices, {len(triangles)} triangles, filled with spheres"}
    if holes:
        details["holes"] = f"{holes}, closed by triangles to the middle of their edges"
        _log.info("%s: holes: %s", source.path, details["holes"])
    return Scattered(
        kernels.centers,
        kernels.values,
        "inside",
        "mesh",
        ("inside",),
        scales=kernels.scales,
        falloff=kernels.falloff,
        details=details,
        orientation=_Y_UP if source.suffix == ".obj" else None,
    )


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
