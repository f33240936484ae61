"""Cells of VTK's meshes: those with a volume, the middles of all, and meshes in pieces."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.io.checks import Where, unreadable
from sheetsplat.io.records import Floats, Scattered
from sheetsplat.io.vtk_grids import Picked

#: VTK's number of a hexahedron.
HEXAHEDRON = 12

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

    def where(self, kept: NDArray[np.bool_]) -> Cells:
        """Return some of the cells, by a mask."""
        sizes = self.sizes()
        types = self.types[kept] if self.types.size else self.types
        return Cells(self.connectivity[np.repeat(kept, sizes)], np.cumsum(sizes[kept]), types)


def hexahedra_of(counts: Sequence[int]) -> NDArray[np.int64]:
    """Return the corners of the cells of a structured grid with (ni, nj, nk) points, (M, 8), i the fastest."""
    ni, nj, nk = counts
    numbers = np.arange(ni * nj * nk, dtype=np.int64).reshape(nk, nj, ni)
    low, high = slice(None, -1), slice(1, None)
    corners: list[tuple[slice, ...]] = [(low, low, low), (low, low, high), (low, high, high), (low, high, low)]
    corners += [(high, *rest) for _, *rest in corners]
    hexahedra: NDArray[np.int64] = np.stack([numbers[one].reshape(-1) for one in corners], axis=1)
    return hexahedra


def same_cells(corners: NDArray[np.int64], kind: int) -> Cells:
    """Return cells of one type, (M, corners), as a list of all."""
    count, size = corners.shape
    ends = size * np.arange(1, count + 1, dtype=np.int64)
    return Cells(corners.reshape(-1), ends, np.full(count, kind, dtype=np.int64))


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


def require_rising(where: Where, what: str, ends: NDArray[np.int64]) -> None:
    """Raise InvalidInput unless each cell ends where the one before does, or later."""
    if ends.size and (ends[0] < 0 or np.any(np.diff(ends) < 0)):
        raise unreadable(where, f"offsets of {what} that do not rise", "where each cell ends")


def checked_lists(
    where: Where, what: str, connectivity: NDArray[np.int64], ends: NDArray[np.int64], points: int
) -> None:
    """Raise InvalidInput unless cells end one after another within the list, and name points that there are."""
    require_rising(where, what, ends)
    if ends.size and ends[-1] != connectivity.size:
        raise unreadable(where, f"{connectivity.size} points of {what}", f"{ends[-1]}, as the last cell ends there")
    if connectivity.size and not (connectivity.min() >= 0 and connectivity.max() < points):
        found = f"cells with the points {int(connectivity.min())} to {int(connectivity.max())}"
        raise unreadable(where, found, f"points 0 to {points - 1}")


def joined(groups: Sequence[tuple[NDArray[np.int64], NDArray[np.int64]]], types: NDArray[np.int64]) -> Cells:
    """Return several lists of cells, each as point numbers and ends, one after another."""
    lists, ends = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    used = 0
    for connectivity, stops in groups:
        lists.append(connectivity)
        ends.append(stops + used)
        used += connectivity.size
    return Cells(np.concatenate(lists), np.concatenate(ends), types)


@dataclass
class Meshes:
    """Pieces of a mesh, or of several, put one after another: points, values, and cells with a volume.

    Attributes
    ----------
    where
        For messages.
    of_cells
        Whether the values are those of cells: then they lie at the means of the cells' points, and there is no mesh.
    """

    where: Where
    of_cells: bool
    _points: list[Floats] = field(default_factory=lambda: [np.empty((0, 3))])
    _values: list[Floats] = field(default_factory=lambda: [np.empty(0)])
    _mesh: list[NDArray[np.int64]] | None = field(default_factory=list)
    _count: int = 0

    def add(self, points: Floats, cells: Cells, values: Floats) -> None:
        """Add a piece; `values` has a row for each point, or for each cell."""
        if self.of_cells:
            full = cells.sizes() > 0
            self._points.append(centroids_of(points, cells)[full])
            self._values.append(values[full])
            return
        own = volumes_of(self.where, cells, self._count)
        self._mesh = None if self._mesh is None or own is None else self._mesh + own
        self._points.append(points)
        self._values.append(values)
        self._count += len(points)

    def scattered(self, picked: Picked, file_format: str) -> Scattered:
        """Return all pieces with the scalar that is shown."""
        return Scattered(
            np.concatenate(self._points),
            np.concatenate(self._values),
            picked.name,
            file_format,
            picked.known,
            cells=tuple(self._mesh) if self._mesh and not self.of_cells else None,
            details={"scalar of": "the cells, at their centroids" if self.of_cells else "the points"},
        )


def one_mesh(
    where: Where, picked: Picked, points: Floats, cells: Cells, values: NDArray[Any], file_format: str
) -> Scattered:
    """Return a mesh of one piece; see `Meshes`."""
    made = Meshes(where, picked.of_cells)
    made.add(points, cells, values.astype(np.float64))
    return made.scattered(picked, file_format)
