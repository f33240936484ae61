"""Meshes (.vtu) and surfaces (.vtp): their points, a scalar and the cells."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sheetsplat.io.checks import finite_points, finite_values, require_rows, unreadable
from sheetsplat.io.records import Floats, Scattered
from sheetsplat.io.scalars import column_of
from sheetsplat.io.source import Source
from sheetsplat.io.vtk_xml.arrays import ArrayReader
from sheetsplat.io.vtk_xml.document import KINDS, Piece, parse_document
from sheetsplat.io.vtk_xml.pieces import array_named, count_of, pick_scalar

_log = logging.getLogger("sheetsplat")

# Corners of the cells that fill a volume, by VTK's number of their type, in the order of its hexahedron.
_VOLUMES = {
    10: (0, 1, 2, 3),
    11: (0, 1, 3, 2, 4, 5, 7, 6),
    12: (0, 1, 2, 3, 4, 5, 6, 7),
    13: (0, 1, 2, 3, 4, 5),
    14: (0, 1, 2, 3, 4),
}
# The last type that is a point, a line or flat, of the linear ones.
_FLAT = 9


@dataclass(frozen=True)
class Cells:
    """Point numbers of all cells, one cell after another, where each ends, and their types (none: flat)."""

    connectivity: NDArray[np.int64]
    ends: NDArray[np.int64]
    types: NDArray[np.int64]

    def sizes(self) -> NDArray[np.int64]:
        """Return how many points each cell has."""
        return np.diff(self.ends, prepend=0)


def _mesh(path: Path, kind: str, reader: ArrayReader, piece: Piece, count: int) -> Cells:
    """Return the cells of a piece; those of a surface in VTK's order: vertices, lines, strips, polygons."""
    if kind == "UnstructuredGrid":
        groups = [("Cells", count_of(path, piece, "NumberOfCells"))]
    else:
        groups = [(name, count_of(path, piece, f"NumberOf{name}")) for name in ("Verts", "Lines", "Strips", "Polys")]
    lists: list[NDArray[np.int64]] = []
    ends: list[NDArray[np.int64]] = []
    types: list[NDArray[np.int64]] = []
    used = 0
    for group, cells in groups:
        if not cells:
            continue
        # The ends come first, because they say how long the lists are.
        stops = reader.array(array_named(path, piece, group, "offsets"), cells).astype(np.int64).reshape(-1)
        if stops.size and (stops[0] < 0 or np.any(np.diff(stops) < 0)):
            raise unreadable(path, f"offsets of {group} that do not rise", "where each cell ends")
        points = (
            reader.array(array_named(path, piece, group, "connectivity"), int(stops[-1])).astype(np.int64).reshape(-1)
        )
        if points.size and not (points.min() >= 0 and points.max() < count):
            found = f"cells with the points {int(points.min())} to {int(points.max())}"
            raise unreadable(path, found, f"points 0 to {count - 1}")
        lists.append(points)
        ends.append(stops + used)
        used += points.size
        if group == "Cells":
            types.append(reader.array(array_named(path, piece, group, "types"), cells).astype(np.int64).reshape(-1))
    empty = np.empty(0, np.int64)
    return Cells(*(np.concatenate([empty, *parts]) for parts in (lists, ends, types)))


def _volumes(path: Path, cells: Cells, offset: int) -> list[NDArray[np.int64]] | None:
    """Return the cells that fill a volume, (M, corners) for each type; None where one is of another type."""
    sizes, found = cells.sizes(), []
    for kind in np.unique(cells.types[cells.types > _FLAT]):
        corners = _VOLUMES.get(int(kind))
        of_kind = np.flatnonzero(cells.types == kind)
        if corners is None:
            _log.info("%s: cells of VTK's type %d are not used, nor is the mesh", path, kind)
            return None
        if np.any(sizes[of_kind] != len(corners)):
            found_size = int(sizes[of_kind][sizes[of_kind] != len(corners)][0])
            raise unreadable(path, f"a cell of type {kind} with {found_size} points", f"{len(corners)} points")
        starts = cells.ends[of_kind] - len(corners)
        found.append(cells.connectivity[starts[:, None] + np.asarray(corners)] + offset)
    return found


def _centroids(points: Floats, cells: Cells) -> Floats:
    sizes = cells.sizes()
    owner = np.repeat(np.arange(sizes.size), sizes)
    sums = np.stack(
        [np.bincount(owner, points[cells.connectivity, axis], minlength=sizes.size) for axis in range(3)], axis=1
    )
    return np.asarray(sums / np.maximum(sizes, 1)[:, None])


def read(source: Source, scalar: str | None = None) -> Scattered:
    """Read a mesh or a surface: its points, a scalar of theirs and its cells.

    The scalar is an array of the points or of the cells, the length of a vector's rows, or one column of it (uvw_x);
    the array that the file itself names as its scalars unless another is named. Values of cells stand at the centroids
    of the cells (means of their points), where no value changes; the mesh is then left out.

    Raises
    ------
    InvalidInput
        For damaged files, sizes that do not agree, cells with points that are not there, and numbers that are not
        finite.
    Unsupported
        For data packed in a way that is not known.
    """
    path = source.path
    document = parse_document(source)
    reader = ArrayReader(source, document)
    where, name, base, column, known = pick_scalar(path, document, scalar)
    points: list[Floats] = []
    values: list[Floats] = []
    mesh: list[NDArray[np.int64]] | None = []
    offset = 0
    for piece in document.pieces:
        count = count_of(path, piece, "NumberOfPoints")
        if not count:
            continue
        require_rows(path, count)
        place = piece.arrays.get("Points", [])
        if len(place) != 1 or place[0].components != 3:
            raise unreadable(path, f"{len(place)} arrays of Points", "one with three components")
        here = finite_points(path, reader.array(place[0], count).astype(np.float64))
        cells = _mesh(path, document.kind, reader, piece, count)
        if where == "CellData":
            full = cells.sizes() > 0
            rows = reader.array(array_named(path, piece, where, base), full.size)
            points.append(_centroids(here, cells)[full])
            values.append(column_of(rows, column)[full])
            continue
        points.append(here)
        values.append(column_of(reader.array(array_named(path, piece, where, base), count), column))
        own = _volumes(path, cells, offset)
        mesh = None if mesh is None or own is None else mesh + own
        offset += count
    details = {"scalar of": "the cells, at their centroids" if where == "CellData" else "the points"}
    return Scattered(
        np.concatenate(points) if points else np.empty((0, 3)),
        finite_values(path, name, np.concatenate(values) if values else np.empty(0)),
        name,
        KINDS[document.kind],
        known,
        cells=tuple(mesh) if mesh else None,
        details=details,
    )
