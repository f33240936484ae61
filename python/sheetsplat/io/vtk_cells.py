"""Cells of VTK's meshes: those with a volume, and the middles of all."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sheetsplat.io.checks import Where, unreadable
from sheetsplat.io.records import Floats

_log = logging.getLogger("sheetsplat")

# By VTK's number of a cell type: its corners in the order of the tetrahedron, hexahedron, wedge or pyramid.
_VOLUMES = {
    10: (0, 1, 2, 3),
    11: (0, 1, 3, 2, 4, 5, 7, 6),
    12: (0, 1, 2, 3, 4, 5, 6, 7),
    13: (0, 1, 2, 3, 4, 5),
    14: (0, 1, 2, 3, 4),
}
# Linear types up to this one have no volume.
_FLAT = 9


@dataclass(frozen=True)
class Cells:
    """Point numbers of all cells, one cell after another, the end of each, and their types (none for surfaces)."""

    connectivity: NDArray[np.int64]
    ends: NDArray[np.int64]
    types: NDArray[np.int64]

    def sizes(self) -> NDArray[np.int64]:
        """Return how many points each cell has."""
        return np.diff(self.ends, prepend=0)


def volumes_of(path: Where, cells: Cells, offset: int) -> list[NDArray[np.int64]] | None:
    """Return the cells with a volume, (M, corners) for each type; None where one has an unknown type."""
    sizes, found = cells.sizes(), []
    for kind in np.unique(cells.types[cells.types > _FLAT]):
        corners = _VOLUMES.get(int(kind))
        of_kind = np.flatnonzero(cells.types == kind)
        if corners is None:
            _log.info("%s: cells of VTK's type %d are not used, nor is the mesh", path, kind)
            return None
        wrong = sizes[of_kind][sizes[of_kind] != len(corners)]
        if wrong.size:
            raise unreadable(path, f"a cell of type {kind} with {wrong[0]} points", f"{len(corners)} points")
        starts = cells.ends[of_kind] - len(corners)
        found.append(cells.connectivity[starts[:, None] + np.asarray(corners)] + offset)
    return found


def centroids_of(points: Floats, cells: Cells) -> Floats:
    """Return the mean of the points of each cell, (M, 3); 0 for cells without points."""
    sizes = cells.sizes()
    owner = np.repeat(np.arange(sizes.size), sizes)
    corners = points[cells.connectivity].T
    sums = np.stack([np.bincount(owner, along, minlength=sizes.size) for along in corners], axis=1)
    return np.asarray(sums / np.maximum(sizes, 1)[:, None])
