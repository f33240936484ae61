"""Structured data: extents, and arrays that lie in several pieces."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import shown
from sheetsplat.io.checks import checked_shape, unreadable
from sheetsplat.io.vtk_grids import counts_of, sizes_of


def extent(path: Path, text: str, what: str) -> list[int]:
    """Return the first and the last number along x, y and z in a text, InvalidInput for anything else."""
    words = text.split()
    if len(words) != 6 or not all(word.lstrip("-").isdigit() and len(word) < 12 for word in words):
        raise unreadable(path, f"{what} = {shown(text)}", "six whole numbers")
    numbers = [int(word) for word in words]
    if any(numbers[2 * axis] > numbers[2 * axis + 1] for axis in range(3)):
        raise unreadable(path, f"{what} = {shown(text)}", "first numbers that are not above the last ones")
    return numbers


def _shape(path: Path, numbers: list[int], *, of_cells: bool) -> tuple[int, ...]:
    """Return (nk, nj, ni), the samples of an extent."""
    counts = counts_of(sizes_of(numbers), of_cells=of_cells)[::-1]
    return checked_shape(path, counts, "the extent in samples (z, y, x)")


def piece_extent(path: Path, piece: Element, whole: list[int]) -> list[int]:
    """Return the extent of a piece, the whole one unless it says; InvalidInput unless it is inside."""
    own = piece.get("Extent")
    numbers = whole if own is None else extent(path, own, "Extent")
    if any(numbers[2 * a] < whole[2 * a] or numbers[2 * a + 1] > whole[2 * a + 1] for a in range(3)):
        raise unreadable(path, f"a Piece of extent {numbers}", f"one inside of {whole}")
    return numbers


class Assembly:
    """An array that is put together of the rows of pieces, [k, j, i] or with columns [k, j, i, column].

    Parameters
    ----------
    path
        The file, for messages.
    whole
        The extent of all pieces.
    of_cells
        Whether rows are those of cells.
    columns
        Of a row; 0: rows are numbers.
    """

    def __init__(self, path: Path, whole: list[int], *, of_cells: bool, columns: int = 0) -> None:
        self._path, self._whole, self._of_cells = path, whole, of_cells
        self._ending = (columns,) if columns else ()
        self.shape = _shape(path, whole, of_cells=of_cells)
        self._values: NDArray[Any] | None = None
        # Which rows there are; None: all of them. Pieces share layers of points, and overlap where they have ghosts.
        self._filled: NDArray[np.bool_] | None = None

    def add(self, numbers: list[int], rows_of: Callable[[int], NDArray[Any]]) -> None:
        """Add a piece by its extent; `rows_of` returns as many rows as it is told.

        Raises InvalidInput for rows of another type than those of pieces before.
        """
        if self._values is not None and self._filled is None:
            return
        here = _shape(self._path, numbers, of_cells=self._of_cells)
        rows = rows_of(math.prod(here)).reshape(*here, *self._ending)
        if here == self.shape:
            self._values, self._filled = rows, None
            return
        if self._values is None:
            count = math.prod(self.shape) * (math.prod(self._ending) * rows.dtype.itemsize + 1)
            _memory.require(count, f"the samples of {self._path}")
            self._values = np.zeros((*self.shape, *self._ending), rows.dtype.newbyteorder("="))
            self._filled = np.zeros(self.shape, np.bool_)
        if rows.dtype.newbyteorder("=") != self._values.dtype:
            found = f"pieces with samples of types {self._values.dtype} and {rows.dtype}"
            raise unreadable(self._path, found, "one type in all pieces")
        assert self._filled is not None
        low = [numbers[2 * axis] - self._whole[2 * axis] for axis in (2, 1, 0)]
        place = tuple(slice(first, first + size) for first, size in zip(low, here, strict=True))
        self._values[place] = rows
        self._filled[place] = True

    def whole(self) -> NDArray[Any]:
        """Return the array; InvalidInput where pieces leave a part of the extent without rows."""
        filled = math.prod(self.shape)
        if self._filled is not None:
            filled = int(np.count_nonzero(self._filled))
        if self._values is None or filled < math.prod(self.shape):
            found = f"pieces with {filled if self._values is not None else 0} samples"
            raise unreadable(self._path, found, f"{math.prod(self.shape)}, as WholeExtent says")
        return self._values
