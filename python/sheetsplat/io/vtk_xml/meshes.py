"""Meshes (.vtu, .pvtu), structured grids (.vts, .pvts) and surfaces (.vtp, .pvtp): points, a scalar and the cells."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from sheetsplat.io.checks import require_rows, unreadable
from sheetsplat.io.records import Floats, Scattered
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
from sheetsplat.io.vtk_grids import Picked
from sheetsplat.io.vtk_xml.arrays import ArrayReader
from sheetsplat.io.vtk_xml.document import KINDS
from sheetsplat.io.vtk_xml.extents import Assembly, extent, piece_extent
from sheetsplat.io.vtk_xml.pieces import Pieces


def _mesh(path: Path, kind: str, reader: ArrayReader, piece: Element, count: int) -> Cells:
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


def _points(path: Path, reader: ArrayReader, piece: Element, count: int) -> Floats:
    require_rows(path, count)
    place = reader.arrays(piece, "Points")
    if len(place) != 1 or place[0].components != 3:
        raise unreadable(path, f"{len(place)} arrays of Points", "one with three components")
    return reader.array(place[0], count).astype(np.float64)


def _values(reader: ArrayReader, piece: Element, picked: Picked, count: int) -> Floats:
    return reader.scalar(piece, picked, count).astype(np.float64)


def _structured(pieces: Pieces, meshes: Meshes, picked: Picked) -> None:
    """Add a structured grid, whose pieces are put together."""
    path = pieces.path
    whole = extent(path, pieces.data.get("WholeExtent", ""), "WholeExtent")
    points = Assembly(path, whole, of_cells=False, columns=3)
    values = Assembly(path, whole, of_cells=meshes.of_cells)
    counts = points.shape[::-1]
    if meshes.of_cells and min(counts) < 2:
        raise unreadable(path, "values of cells without a volume", "values of points")
    for reader, piece in pieces:
        numbers = piece_extent(path, piece, whole)
        points.add(numbers, partial(_points, path, reader, piece))
        values.add(numbers, partial(_values, reader, piece, picked))
    placed = points.whole().reshape(-1, 3)
    meshes.add(placed, same_cells(hexahedra_of(counts), HEXAHEDRON), values.whole().reshape(-1))


def read(source: Source, scalar: str | None = None) -> Scattered:
    """Read a mesh, a structured grid or a surface, in one file or in several: points, a scalar of theirs and the cells.

    The scalar is an array of the points or of the cells, the length of a vector's rows, or one column of it (uvw_x);
    the file's active scalars unless another is named. Values of cells are at the means of their points; then the result
    has no mesh. Cells that VTK marks as hidden, or as those of another piece, are left out.

    Raises
    ------
    InvalidInput
        For damaged files, sizes that disagree, cells with missing points, and numbers that are not finite.
    Unsupported
        For an unknown compressor.
    """
    path = source.path
    pieces = Pieces(source)
    picked = pieces.pick_scalar(scalar)
    meshes = Meshes(path, picked.of_cells)
    if pieces.kind == "StructuredGrid":
        _structured(pieces, meshes, picked)
        return meshes.scattered(picked, KINDS[pieces.kind])
    for reader, piece in pieces:
        count = reader.count(piece, "NumberOfPoints")
        if not count:
            continue
        here = _points(path, reader, piece, count)
        cells = _mesh(path, pieces.kind, reader, piece, count)
        values = _values(reader, piece, picked, cells.ends.size if picked.of_cells else count)
        ghosts = reader.ghosts(piece, cells.ends.size)
        if ghosts is not None:
            cells, values = cells.where(~ghosts), values[~ghosts] if picked.of_cells else values
        meshes.add(here, cells, values)
    return meshes.scattered(picked, KINDS[pieces.kind])
