"""The arrays of pieces by their names, and which of them is shown."""

from __future__ import annotations

from pathlib import Path

from sheetsplat._checks import shown
from sheetsplat.io.checks import natural, unreadable
from sheetsplat.io.scalars import choose_scalar, scalar_names
from sheetsplat.io.vtk_xml.arrays import TYPES
from sheetsplat.io.vtk_xml.document import DataArray, Document, Piece


def count_of(path: Path, piece: Piece, name: str) -> int:
    """Return a number of points or cells that a piece declares, 0 unless it does."""
    return natural(path, name, piece.attributes.get(name, "0").strip())


def _widths(piece: Piece, where: str) -> dict[str, int]:
    known: dict[str, int] = {}
    for one in piece.arrays.get(where, []):
        if one.type in TYPES and one.name:
            known.setdefault(one.name, one.components)
    return known


def array_named(path: Path, piece: Piece, where: str, name: str) -> DataArray:
    """Return an array of a piece by its element (PointData, Cells ...) and its name."""
    for one in piece.arrays.get(where, []):
        if one.name == name:
            return one
    raise unreadable(path, f"a Piece whose {where} has no array {shown(name)}", "the same arrays in every Piece")


def pick_scalar(
    path: Path, document: Document, scalar: str | None
) -> tuple[str, str, str, int | None, tuple[str, ...]]:
    """Return where the scalar stands (PointData or CellData), its name, its array, its column, and all names."""
    first = document.pieces[0]
    of_points, of_cells = _widths(first, "PointData"), _widths(first, "CellData")
    preferred = [first.chosen[role] for role in ("PointData Scalars", "CellData Scalars") if role in first.chosen]
    both = of_points | {name: width for name, width in of_cells.items() if name not in of_points}
    name, base, column = choose_scalar(path, scalar, preferred, both)
    where = "PointData" if base in of_points else "CellData"
    return where, name, base, column, scalar_names(both)
