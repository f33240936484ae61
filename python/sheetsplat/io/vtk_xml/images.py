"""Images (.vti, .pvti) and rectilinear grids (.vtr, .pvtr)."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from sheetsplat.io.checks import floats, unreadable
from sheetsplat.io.records import Floats, Volume
from sheetsplat.io.source import Source
from sheetsplat.io.vtk_grids import image, rectilinear
from sheetsplat.io.vtk_xml.arrays import ArrayReader
from sheetsplat.io.vtk_xml.document import KINDS, VOLUMES
from sheetsplat.io.vtk_xml.extents import Assembly, extent, piece_extent
from sheetsplat.io.vtk_xml.pieces import Pieces


def read(source: Source, name: str | None = None, resample: bool = False) -> Volume:
    """Read an image or a rectilinear grid: a scalar of its points, or of its cells, which lies at their middles.

    See `vtk_grids.image`.

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
    picked = pieces.pick_scalar(scalar)
    whole = extent(path, pieces.data.get("WholeExtent", ""), "WholeExtent")
    assembly = Assembly(path, whole, of_cells=picked.of_cells)
    # Axes are no longer than the numbers that the pieces have for them.
    axes: list[dict[tuple[int, int], Floats]] = [{}, {}, {}]
    for reader, piece in pieces:
        numbers = piece_extent(path, piece, whole)
        assembly.add(numbers, partial(reader.scalar, piece, picked))
        if pieces.kind == "RectilinearGrid":
            for axis in range(3):
                first, last = numbers[2 * axis : 2 * axis + 2]
                axes[axis][first, last] = _coordinates(path, reader, piece, axis, last - first + 1)
    values = assembly.whole()
    if pieces.kind == "RectilinearGrid":
        places = [_along(whole, axis, axes[axis]) for axis in range(3)]
        return rectilinear(path, picked, values, places, resample, KINDS[pieces.kind])

    def told(name: str, default: str) -> list[float]:
        text = pieces.data.get(name, default)
        return floats(path, name, text, len(default.split()))

    spacing, origin = told("Spacing", "1 1 1"), told("Origin", "0 0 0")
    if min(spacing) <= 0:
        raise unreadable(path, f"Spacing = {spacing}", "three numbers above 0")
    direction = told("Direction", "1 0 0 0 1 0 0 0 1")
    return image(path, picked, values, whole, spacing, origin, direction, KINDS[pieces.kind])


def _coordinates(path: Path, reader: ArrayReader, piece: Element, axis: int, count: int) -> Floats:
    """Return the coordinates of a piece's points along an axis."""
    arrays = reader.arrays(piece, "Coordinates")
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
