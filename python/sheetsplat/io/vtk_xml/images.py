"""Images (.vti, .pvti) and rectilinear grids (.vtr, .pvtr)."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import triple
from sheetsplat.io.axes import Placed, nearest_the_world, on_even_axes
from sheetsplat.io.checks import floats, printable, unreadable
from sheetsplat.io.records import Floats, Volume
from sheetsplat.io.source import Source
from sheetsplat.io.vtk_xml.arrays import ArrayReader
from sheetsplat.io.vtk_xml.document import KINDS, VOLUMES, Piece
from sheetsplat.io.vtk_xml.extents import Assembly, extent, piece_extent
from sheetsplat.io.vtk_xml.pieces import Pieces
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
    pieces = Pieces(source)
    if pieces.kind not in VOLUMES:
        raise unreadable(path, f"a {pieces.kind}", " or ".join(VOLUMES))
    chosen = pieces.pick_scalar(scalar)
    whole = extent(path, pieces.attributes.get("WholeExtent", ""), "WholeExtent")
    assembly = Assembly(path, whole, of_cells=chosen.of_cells)
    # Axes are no longer than the numbers that the pieces have for them.
    axes: list[dict[tuple[int, int], Floats]] = [{}, {}, {}]
    for reader, piece in pieces:
        numbers = piece_extent(path, piece, whole)
        assembly.add(numbers, partial(reader.scalar, piece, chosen))
        if pieces.kind == "RectilinearGrid":
            for axis in range(3):
                first, last = numbers[2 * axis : 2 * axis + 2]
                axes[axis][first, last] = _coordinates(path, reader, piece, axis, last - first + 1)
    values = assembly.whole()
    if pieces.kind == "ImageData":
        placed = _image(path, pieces.attributes, whole, values, chosen.of_cells)
    else:
        places = [_along(whole, axis, axes[axis]) for axis in range(3)]
        if chosen.of_cells:
            places = [0.5 * (along[1:] + along[:-1]) if along.size > 1 else along for along in places]
        placed = on_even_axes(path, ("x", "y", "z"), places, values, resample=resample)
    details = {"content": chosen.name, **placed.details}
    quantity = Quantity(printable(chosen.name))
    return Volume(placed.values, placed.spacing, placed.origin, KINDS[pieces.kind], details, quantity)


def _image(
    path: Path, attributes: dict[str, str], whole: list[int], values: NDArray[np.generic], of_cells: bool
) -> Placed:
    spacing = triple("Spacing", floats(path, "Spacing", attributes.get("Spacing", "1 1 1"), 3))
    origin = np.asarray(floats(path, "Origin", attributes.get("Origin", "0 0 0"), 3))
    if min(spacing) <= 0:
        raise unreadable(path, f"Spacing = {spacing}", "three numbers above 0")
    matrix = floats(path, "Direction", attributes.get("Direction", "1 0 0 0 1 0 0 0 1"), 9)
    # Columns of the matrix are the directions of the axes.
    steps = np.reshape(matrix, (3, 3)).T * np.asarray(spacing)[:, None]
    first = np.asarray(whole[::2], dtype=np.float64) + 0.5 * of_cells
    return nearest_the_world(path, "Direction", steps, origin + first @ steps, values, None)


def _coordinates(path: Path, reader: ArrayReader, piece: Piece, axis: int, count: int) -> Floats:
    """Return the coordinates of a piece's points along an axis."""
    arrays = piece.arrays.get("Coordinates", [])
    if len(arrays) != 3 or arrays[axis].components != 1:
        raise unreadable(path, f"{len(arrays)} arrays of Coordinates", "three, along x, y and z")
    return reader.array(arrays[axis], count).astype(np.float64)


def _along(whole: list[int], axis: int, pieces: dict[tuple[int, int], Floats]) -> Floats:
    """Return the coordinates of all points along an axis, from those of pieces by their first and last point."""
    first, last = whole[2 * axis : 2 * axis + 2]
    # As many as the samples along this axis, which are in memory.
    along = np.full(last - first + 1, np.nan)
    for (low, high), numbers in pieces.items():
        along[low - first : high - first + 1] = numbers
    return along
