"""Images (.vti)."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import shown, triple
from sheetsplat.io.checks import checked_shape, floats, unreadable
from sheetsplat.io.records import Volume
from sheetsplat.io.scalars import column_of
from sheetsplat.io.source import Source
from sheetsplat.io.vtk_xml.arrays import ArrayReader
from sheetsplat.io.vtk_xml.document import parse_document
from sheetsplat.quantity import Quantity


def _integers(path: Path, text: str, what: str) -> list[int]:
    words = text.split()
    if len(words) != 6 or not all(word.lstrip("-").isdigit() and len(word) < 12 for word in words):
        raise unreadable(path, f"{what} = {shown(text)}", "six whole numbers")
    numbers = [int(word) for word in words]
    if any(numbers[2 * axis] > numbers[2 * axis + 1] for axis in range(3)):
        raise unreadable(path, f"{what} = {shown(text)}", "first numbers that are not above the last ones")
    return numbers


def read(source: Source, name: str | None = None) -> Volume:
    """Read an image: a scalar of its points, or of its cells, whose first centre is half a spacing from the origin.

    Raises InvalidInput for damaged files, pieces that do not fill the image, and axes that are turned; Unsupported for
    data packed in a way that is not known.
    """
    with np.errstate(all="ignore"):
        return _image(source, name)


def _image(source: Source, scalar: str | None) -> Volume:
    path = source.path
    document = parse_document(source)
    reader = ArrayReader(source, document)
    where, name, base, column, _ = reader.pick_scalar(scalar)
    attributes = document.attributes
    whole = _integers(path, attributes.get("WholeExtent", ""), "WholeExtent")
    spacing = triple("Spacing", floats(path, "Spacing", attributes.get("Spacing", "1 1 1"), 3))
    origin = floats(path, "Origin", attributes.get("Origin", "0 0 0"), 3)
    if min(spacing) <= 0:
        raise unreadable(path, f"Spacing = {spacing}", "three numbers above 0")
    direction = attributes.get("Direction", "1 0 0 0 1 0 0 0 1")
    if floats(path, "Direction", direction, 9) != [1, 0, 0, 0, 1, 0, 0, 0, 1]:
        raise unreadable(path, f"Direction = {shown(direction)}", "the identity", "resample to the axes of the world")
    cells = where == "CellData"

    def shape_of(extent: list[int]) -> tuple[int, ...]:
        counts = [extent[2 * axis + 1] - extent[2 * axis] + (not cells) for axis in (2, 1, 0)]
        return checked_shape(path, counts, "the extent in samples (z, y, x)")

    shape = shape_of(whole)
    values: NDArray[Any] | None = None
    filled = 0
    for piece in document.pieces:
        extent = _integers(path, piece.attributes.get("Extent", attributes.get("WholeExtent", "")), "Extent")
        if any(extent[2 * a] < whole[2 * a] or extent[2 * a + 1] > whole[2 * a + 1] for a in range(3)):
            raise unreadable(path, f"a Piece of extent {extent}", f"one inside of {whole}")
        here = shape_of(extent)
        rows = reader.named(piece, where, base, math.prod(here))
        numbers = rows if column == 0 and rows.ndim == 1 else column_of(rows, column)
        if here == shape:
            values = numbers.reshape(shape)
            filled = math.prod(shape)
            break
        if values is None:
            _memory.require(math.prod(shape) * numbers.dtype.itemsize, f"the samples of {path}")
            values = np.zeros(shape, numbers.dtype)
        low = [extent[2 * axis] - whole[2 * axis] for axis in (2, 1, 0)]
        part = tuple(slice(first, first + size) for first, size in zip(low, here, strict=True))
        values[part] = numbers.reshape(here)
        # Pieces of points share the layers between them, which are counted once.
        own = [size - (not cells and first > 0) for first, size in zip(low, here, strict=True)]
        filled += math.prod(own)
    assert values is not None
    if filled < math.prod(shape):
        raise unreadable(path, f"pieces with {filled} samples", f"{math.prod(shape)}, as WholeExtent says")
    start = [first + gap * (at + 0.5 * cells) for first, gap, at in zip(origin, spacing, whole[::2], strict=True)]
    return Volume(values, spacing, triple("Origin", start), "vti", {"content": name}, Quantity(name))
