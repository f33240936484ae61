"""Meshes (.vtu) and surfaces (.vtp): their points, a scalar and the cells."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sheetsplat.io.checks import finite_points, finite_values, require_rows, unreadable
from sheetsplat.io.records import Floats, Scattered
from sheetsplat.io.scalars import column_of
from sheetsplat.io.source import Source
from sheetsplat.io.vtk_cells import Cells, centroids_of, volumes_of
from sheetsplat.io.vtk_xml.arrays import ArrayReader
from sheetsplat.io.vtk_xml.document import KINDS, Piece, parse_document


def _mesh(path: Path, kind: str, reader: ArrayReader, piece: Piece, count: int) -> Cells:
    """Return the cells of a piece; those of a surface in VTK's order: vertices, lines, strips, polygons."""
    if kind == "UnstructuredGrid":
        groups = [("Cells", reader.count(piece, "NumberOfCells"))]
    else:
        groups = [(name, reader.count(piece, f"NumberOf{name}")) for name in ("Verts", "Lines", "Strips", "Polys")]
    empty = np.empty(0, np.int64)
    lists, ends, types = [empty], [empty], [empty]
    used = 0

    def numbers(group: str, name: str, count: int) -> NDArray[np.int64]:
        return reader.named(piece, group, name, count).astype(np.int64).reshape(-1)

    for group, cells in groups:
        if not cells:
            continue
        stops = numbers(group, "offsets", cells)
        if stops.size and (stops[0] < 0 or np.any(np.diff(stops) < 0)):
            raise unreadable(path, f"offsets of {group} that do not rise", "where each cell ends")
        points = numbers(group, "connectivity", int(stops[-1]))
        if points.size and not (points.min() >= 0 and points.max() < count):
            found = f"cells with the points {int(points.min())} to {int(points.max())}"
            raise unreadable(path, found, f"points 0 to {count - 1}")
        lists.append(points)
        ends.append(stops + used)
        used += points.size
        if group == "Cells":
            types.append(numbers(group, "types", cells))
    return Cells(*map(np.concatenate, (lists, ends, types)))


def read(source: Source, scalar: str | None = None) -> Scattered:
    """Read a mesh or a surface: its points, a scalar of theirs and its cells.

    The scalar is an array of the points or of the cells, the length of a vector's rows, or one column of it (uvw_x);
    the file's active scalars unless another is named. Values of cells are at the means of their points; then the result
    has no mesh.

    Raises
    ------
    InvalidInput
        For damaged files, sizes that disagree, cells with missing points, and numbers that are not finite.
    Unsupported
        For an unknown compressor.
    """
    path = source.path
    document = parse_document(source)
    reader = ArrayReader(source, document)
    where, name, base, column, known = reader.pick_scalar(scalar)
    points: list[Floats] = [np.empty((0, 3))]
    values: list[Floats] = [np.empty(0)]
    mesh: list[NDArray[np.int64]] | None = []
    offset = 0
    for piece in document.pieces:
        count = reader.count(piece, "NumberOfPoints")
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
            rows = reader.named(piece, where, base, full.size)
            points.append(centroids_of(here, cells)[full])
            values.append(column_of(rows, column)[full])
            continue
        points.append(here)
        values.append(column_of(reader.named(piece, where, base, count), column))
        own = volumes_of(path, cells, offset)
        mesh = None if mesh is None or own is None else mesh + own
        offset += count
    details = {"scalar of": "the cells, at their centroids" if where == "CellData" else "the points"}
    return Scattered(
        np.concatenate(points),
        finite_values(path, name, np.concatenate(values)),
        name,
        KINDS[document.kind],
        known,
        cells=tuple(mesh) if mesh else None,
        details=details,
    )
