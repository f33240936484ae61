"""Meshes (.vtu), structured grids (.vts) and surfaces (.vtp): their points, a scalar and the cells."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sheetsplat.io.checks import finite_points, require_rows, unreadable
from sheetsplat.io.records import Floats, Scattered
from sheetsplat.io.scalars import column_of
from sheetsplat.io.source import Source
from sheetsplat.io.vtk_cells import (
    HEXAHEDRON,
    Cells,
    Meshes,
    checked_lists,
    hexahedra_of,
    joined,
    require_rising,
    same_cells,
)
from sheetsplat.io.vtk_xml.arrays import ArrayReader, Chosen
from sheetsplat.io.vtk_xml.document import KINDS, Document, Piece, parse_document
from sheetsplat.io.vtk_xml.extents import assembled


def _mesh(path: Path, kind: str, reader: ArrayReader, piece: Piece, count: int) -> Cells:
    """Return the cells of a piece; those of a surface in VTK's order: vertices, lines, strips, polygons."""
    if kind == "UnstructuredGrid":
        groups = [("Cells", reader.count(piece, "NumberOfCells"))]
    else:
        groups = [(name, reader.count(piece, f"NumberOf{name}")) for name in ("Verts", "Lines", "Strips", "Polys")]
    lists: list[tuple[NDArray[np.int64], NDArray[np.int64]]] = []
    types = np.empty(0, np.int64)

    def numbers(group: str, name: str, count: int) -> NDArray[np.int64]:
        return reader.named(piece, group, name, count).astype(np.int64).reshape(-1)

    for group, cells in groups:
        if not cells:
            continue
        ends = numbers(group, "offsets", cells)
        require_rising(path, group, ends)
        connectivity = numbers(group, "connectivity", int(ends[-1]))
        checked_lists(path, group, connectivity, ends, count)
        lists.append((connectivity, ends))
        if group == "Cells":
            types = numbers(group, "types", cells)
    return joined(lists, types)


def _points(path: Path, reader: ArrayReader, piece: Piece, count: int) -> Floats:
    require_rows(path, count)
    place = piece.arrays.get("Points", [])
    if len(place) != 1 or place[0].components != 3:
        raise unreadable(path, f"{len(place)} arrays of Points", "one with three components")
    return finite_points(path, reader.array(place[0], count).astype(np.float64))


def _structured(path: Path, document: Document, reader: ArrayReader, meshes: Meshes, chosen: Chosen) -> None:
    """Add a structured grid, whose pieces are put together."""
    points, _ = assembled(
        path, document, lambda piece, count: _points(path, reader, piece, count), of_cells=False, columns=3
    )
    counts = points.shape[2::-1]
    hexahedra = hexahedra_of(counts)
    if meshes.of_cells and not hexahedra.size:
        raise unreadable(path, "values of cells without a volume", "values of points")
    values, _ = assembled(
        path,
        document,
        lambda piece, count: column_of(reader.named(piece, chosen.where, chosen.base, count), chosen.column),
        of_cells=meshes.of_cells,
    )
    meshes.add(points.reshape(-1, 3), same_cells(hexahedra, HEXAHEDRON), values.reshape(-1))


def read(source: Source, scalar: str | None = None) -> Scattered:
    """Read a mesh, a structured grid or a surface: its points, a scalar of theirs and its cells.

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
    chosen = reader.pick_scalar(scalar)
    of_cells = chosen.where == "CellData"
    meshes = Meshes(path, of_cells)
    if document.kind == "StructuredGrid":
        _structured(path, document, reader, meshes, chosen)
        return meshes.scattered(chosen.name, KINDS[document.kind], chosen.known)
    for piece in document.pieces:
        count = reader.count(piece, "NumberOfPoints")
        if not count:
            continue
        here = _points(path, reader, piece, count)
        cells = _mesh(path, document.kind, reader, piece, count)
        rows = reader.named(piece, chosen.where, chosen.base, cells.ends.size if of_cells else count)
        meshes.add(here, cells, column_of(rows, chosen.column))
    return meshes.scattered(chosen.name, KINDS[document.kind], chosen.known)
