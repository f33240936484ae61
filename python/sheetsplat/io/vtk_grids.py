"""Which array of a data set of VTK is shown, and its regular grids: of files of every kind, and of VTK's objects."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import triple
from sheetsplat.io.axes import on_even_axes
from sheetsplat.io.checks import Where, printable, unreadable
from sheetsplat.io.records import Floats, Volume
from sheetsplat.io.scalars import choose_scalar, column_of, scalar_names
from sheetsplat.quantity import Quantity

#: The array by which VTK marks points and cells that belong to another piece, or are hidden.
GHOSTS = "vtkGhostType"
# Arrays that VTK writes for itself.
_OWN_ARRAYS = (GHOSTS, "vtkOriginalPointIds", "vtkOriginalCellIds")
#: Directions of the axes of a grid that is not turned.
STRAIGHT = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Picked:
    """The scalar that is shown.

    Attributes
    ----------
    name, base, array
        Its name, that of its array, and the array as the data set has it.
    of_cells
        Whether it belongs to the cells.
    columns, column
        Of the array, and the one that is shown; None: the length of its rows.
    known
        The names of all scalars.
    """

    name: str
    base: str
    array: Any
    of_cells: bool
    columns: int
    column: int | None
    known: tuple[str, ...]

    def of(self, rows: NDArray[Any]) -> NDArray[Any]:
        """Return the scalar of rows of the array, in their own type where it is a whole array."""
        return rows.reshape(-1) if self.columns == 1 else column_of(rows, self.column)


def pick(
    where: Where, arrays: Iterable[tuple[str | None, bool, int, Any]], preferred: Sequence[str], wanted: str | None
) -> Picked:
    """Return the scalar with the name `wanted`, else the first of `preferred` that there is, else the first one.

    Parameters
    ----------
    where
        For messages.
    arrays
        Name, whether it belongs to the cells, number of columns, and the array as the data set has it. Of one name the
        first counts.
    preferred, wanted
        Names of arrays, and of the scalar that the user asks for.
    """
    found: dict[str, tuple[bool, int, Any]] = {}
    for name, of_cells, columns, array in arrays:
        if name and name not in _OWN_ARRAYS and columns > 0:
            found.setdefault(name, (of_cells, columns, array))
    widths = {name: columns for name, (_, columns, _) in found.items()}
    name, base, column = choose_scalar(where, wanted, preferred, widths)
    of_cells, columns, array = found[base]
    return Picked(name, base, array, of_cells, columns, column, scalar_names(widths))


def counts_of(points: Sequence[int], *, of_cells: bool) -> list[int]:
    """Return how many samples a grid has along each axis: cells are one fewer than points, at least one."""
    return [max(count - 1, 1) if of_cells else count for count in points]


def sizes_of(extent: Sequence[int]) -> list[int]:
    """Return the points along x, y and z from the first and the last number along each."""
    return [last - first + 1 for first, last in zip(extent[::2], extent[1::2], strict=True)]


def _samples(where: Where, picked: Picked, values: NDArray[Any], points: Sequence[int]) -> NDArray[Any]:
    """Return the values of the points, or of the cells between them, as samples [k, j, i]."""
    counts = counts_of(points, of_cells=picked.of_cells)
    if values.size != np.prod(counts, dtype=np.int64) or not values.size:
        raise unreadable(where, f"{values.size} values of {picked.name!r}", " x ".join(map(str, counts)))
    return values.reshape(counts[::-1])


def _told(picked: Picked) -> dict[str, Any]:
    """Return the fields of a volume that say what its samples are."""
    name = printable(picked.name)
    details = {"content": name, "scalar of": "the cells" if picked.of_cells else "the points"}
    return {"details": details, "quantity": Quantity(name)}


def image(
    where: Where,
    picked: Picked,
    values: NDArray[Any],
    extent: Sequence[int],
    spacing: Sequence[float] | Floats,
    origin: Sequence[float] | Floats,
    direction: Sequence[float] | Floats,
    file_format: str,
) -> Volume:
    """Return an image as a volume; cells have their values at their middles.

    Parameters
    ----------
    where, file_format
        The data, for messages, and the format of the volume.
    picked, values
        The scalar, and its samples, the axis x the fastest.
    extent
        First and last number of the points along x, y and z.
    spacing, origin
        World units along x, y, z; the origin is the place of the point with the numbers 0, 0, 0.
    direction
        Nine numbers, of a matrix whose columns are the directions of the axes.
    """
    steps = np.reshape(np.asarray(direction, np.float64), (3, 3)).T * np.asarray(spacing, np.float64)[:, None]
    first = np.asarray(extent[::2], dtype=np.float64) + 0.5 * picked.of_cells
    start = np.asarray(origin, dtype=np.float64) + first @ steps
    samples = _samples(where, picked, values, sizes_of(extent))
    return Volume(samples, origin=triple("origin", start), format=file_format, axes=steps, **_told(picked))


def rectilinear(
    where: Where, picked: Picked, values: NDArray[Any], points: Sequence[Floats], resample: bool, file_format: str
) -> Volume:
    """Return a rectilinear grid as a volume from the coordinates of its points along x, y and z; see `image`.

    Raises InvalidInput for uneven coordinates unless `resample` is true.
    """
    places = [0.5 * (along[1:] + along[:-1]) if picked.of_cells and along.size > 1 else along for along in points]
    samples = _samples(where, picked, values, [along.size for along in points])
    made = on_even_axes(where, ("x", "y", "z"), places, samples, resample=resample)
    found = Volume(made.values, made.spacing, made.origin, file_format, **_told(picked))
    return replace(found, details=found.details | made.details)
