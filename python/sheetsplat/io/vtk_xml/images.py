"""Images (.vti) and rectilinear grids (.vtr)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import triple
from sheetsplat.io.axes import Placed, nearest_the_world, on_even_axes
from sheetsplat.io.checks import floats, unreadable
from sheetsplat.io.records import Floats, Volume
from sheetsplat.io.scalars import column_of
from sheetsplat.io.source import Source
from sheetsplat.io.vtk_xml.arrays import ArrayReader
from sheetsplat.io.vtk_xml.document import KINDS, VOLUMES, Document, parse_document
from sheetsplat.io.vtk_xml.extents import assembled, piece_extent
from sheetsplat.quantity import Quantity


def read(source: Source, name: str | None = None, resample: bool = False) -> Volume:
    """Read an image or a rectilinear grid: a scalar of its points, or of its cells, which lies at their middles.

    Images that are turned keep their own axes (`axes.nearest_the_world`).

    Raises
    ------
    InvalidInput
        For damaged files, pieces that do not fill the extent, and uneven coordinates unless `resample` is true.
    Unsupported
        For data packed in a way that is not known.
    """
    with np.errstate(all="ignore"):
        return _volume(source, name, resample)


def _volume(source: Source, scalar: str | None, resample: bool) -> Volume:
    path = source.path
    document = parse_document(source)
    if document.kind not in VOLUMES:
        raise unreadable(path, f"a {document.kind}", " or ".join(VOLUMES))
    reader = ArrayReader(source, document)
    chosen = reader.pick_scalar(scalar)
    of_cells = chosen.where == "CellData"

    def rows(piece: object, count: int) -> NDArray[np.generic]:
        found = reader.named(piece, chosen.where, chosen.base, count)  # type: ignore[arg-type]
        return found if chosen.column == 0 and found.ndim == 1 else column_of(found, chosen.column)

    values, whole = assembled(path, document, rows, of_cells=of_cells)
    if document.kind == "ImageData":
        placed = _image(path, document, whole, values, of_cells)
    else:
        places = [_coordinates(path, document, reader, whole, axis) for axis in range(3)]
        if of_cells:
            places = [0.5 * (along[1:] + along[:-1]) if along.size > 1 else along for along in places]
        placed = on_even_axes(path, ("x", "y", "z"), places, values, resample=resample)
    details = {"content": chosen.name, **placed.details}
    quantity = Quantity(chosen.name)
    return Volume(placed.values, placed.spacing, placed.origin, KINDS[document.kind], details, quantity)


def _image(path: Path, document: Document, whole: list[int], values: NDArray[np.generic], of_cells: bool) -> Placed:
    attributes = document.attributes
    spacing = triple("Spacing", floats(path, "Spacing", attributes.get("Spacing", "1 1 1"), 3))
    origin = np.asarray(floats(path, "Origin", attributes.get("Origin", "0 0 0"), 3))
    if min(spacing) <= 0:
        raise unreadable(path, f"Spacing = {spacing}", "three numbers above 0")
    matrix = floats(path, "Direction", attributes.get("Direction", "1 0 0 0 1 0 0 0 1"), 9)
    # Columns of the matrix are the directions of the axes.
    steps = np.reshape(matrix, (3, 3)).T * np.asarray(spacing)[:, None]
    first = np.asarray(whole[::2], dtype=np.float64) + 0.5 * of_cells
    return nearest_the_world(path, "Direction", steps, origin + first @ steps, values, None)


def _coordinates(path: Path, document: Document, reader: ArrayReader, whole: list[int], axis: int) -> Floats:
    """Return the coordinates of the points along an axis, from the pieces that have them."""
    first, last = whole[2 * axis : 2 * axis + 2]
    # As many as the samples along this axis, which are in memory.
    along = np.full(last - first + 1, np.nan)
    for piece in document.pieces:
        numbers = piece_extent(path, piece, whole)
        low, high = numbers[2 * axis] - first, numbers[2 * axis + 1] - first + 1
        arrays = piece.arrays.get("Coordinates", [])
        if len(arrays) != 3 or arrays[axis].components != 1:
            raise unreadable(path, f"{len(arrays)} arrays of Coordinates", "three, along x, y and z")
        along[low:high] = reader.array(arrays[axis], high - low)
    return along
