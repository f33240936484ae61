"""Structured files: extents, and arrays that lie in several pieces."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import shown
from sheetsplat.io.checks import checked_shape, unreadable
from sheetsplat.io.vtk_xml.document import Document, Piece


def extent(path: Path, text: str, what: str) -> list[int]:
    """Return the first and the last number along x, y and z in a text, InvalidInput for anything else."""
    words = text.split()
    if len(words) != 6 or not all(word.lstrip("-").isdigit() and len(word) < 12 for word in words):
        raise unreadable(path, f"{what} = {shown(text)}", "six whole numbers")
    numbers = [int(word) for word in words]
    if any(numbers[2 * axis] > numbers[2 * axis + 1] for axis in range(3)):
        raise unreadable(path, f"{what} = {shown(text)}", "first numbers that are not above the last ones")
    return numbers


def counts_of(path: Path, numbers: list[int], *, of_cells: bool) -> tuple[int, ...]:
    """Return (nk, nj, ni), the samples of an extent; cells are one fewer than points, at least one."""
    points = [numbers[2 * axis + 1] - numbers[2 * axis] + 1 for axis in (2, 1, 0)]
    counts = [max(count - 1, 1) if of_cells else count for count in points]
    return checked_shape(path, counts, "the extent in samples (z, y, x)")


def piece_extent(path: Path, piece: Piece, whole: list[int]) -> list[int]:
    """Return the extent of a piece, the whole one unless it says; InvalidInput unless it is inside."""
    own = piece.attributes.get("Extent")
    numbers = whole if own is None else extent(path, own, "Extent")
    if any(numbers[2 * a] < whole[2 * a] or numbers[2 * a + 1] > whole[2 * a + 1] for a in range(3)):
        raise unreadable(path, f"a Piece of extent {numbers}", f"one inside of {whole}")
    return numbers


def assembled(
    path: Path,
    document: Document,
    rows_of: Callable[[Piece, int], NDArray[Any]],
    *,
    of_cells: bool,
    columns: int = 0,
) -> tuple[NDArray[Any], list[int]]:
    """Return an array of all pieces, [k, j, i] or with columns [k, j, i, column], and the whole extent.

    Parameters
    ----------
    path, document
        The file.
    rows_of
        Returns the rows of a piece, as many as it is told.
    of_cells
        Whether rows are those of cells.
    columns
        Of a row; 0: rows are numbers.

    Raises
    ------
    InvalidInput
        For pieces that leave the extent, or leave a part of it without rows.
    """
    whole = extent(path, document.attributes.get("WholeExtent", ""), "WholeExtent")
    shape = counts_of(path, whole, of_cells=of_cells)
    ending = (columns,) if columns else ()
    values: NDArray[Any] | None = None
    filled = 0
    for piece in document.pieces:
        numbers = piece_extent(path, piece, whole)
        here = counts_of(path, numbers, of_cells=of_cells)
        rows = rows_of(piece, math.prod(here)).reshape(*here, *ending)
        if here == shape:
            return rows, whole
        if values is None:
            _memory.require(math.prod((*shape, *ending)) * rows.dtype.itemsize, f"the samples of {path}")
            values = np.zeros((*shape, *ending), rows.dtype)
        low = [numbers[2 * axis] - whole[2 * axis] for axis in (2, 1, 0)]
        values[tuple(slice(first, first + size) for first, size in zip(low, here, strict=True))] = rows
        # Pieces of points share the layers between them, which are counted once.
        own = [size - (not of_cells and first > 0) for first, size in zip(low, here, strict=True)]
        filled += math.prod(own)
    assert values is not None
    if filled < math.prod(shape):
        raise unreadable(path, f"pieces with {filled} samples", f"{math.prod(shape)}, as WholeExtent says")
    return values, whole
