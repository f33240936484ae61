"""Data sets of VTK and PyVista: images, rectilinear, structured and unstructured grids, surfaces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.io.axes import nearest_the_world, on_even_axes
from sheetsplat.io.checks import Where, finite_points, printable, require_rows, unreadable
from sheetsplat.io.records import Floats, Scattered, Volume
from sheetsplat.io.scalars import choose_scalar, column_of, scalar_names
from sheetsplat.io.vtk_cells import HEXAHEDRON, OWN_ARRAYS, Cells, Meshes, hexahedra_of, joined, same_cells
from sheetsplat.quantity import Quantity


def _numbers(array: Any) -> NDArray[Any]:
    """Return the numbers of an array of VTK, without a copy where there is one array in memory."""
    from vtkmodules.util.numpy_support import (  # type: ignore[import-not-found, import-untyped, unused-ignore]
        vtk_to_numpy,
    )

    found: NDArray[Any] = vtk_to_numpy(array)
    return found


@dataclass(frozen=True)
class _Scalar:
    """The scalar that is shown: its name, whether cells have it, its numbers in their own type, and all names."""

    name: str
    of_cells: bool
    values: NDArray[Any]
    known: tuple[str, ...]


def _scalar(data: Any, where: Where, wanted: str | None) -> _Scalar:
    """Return the chosen scalar: of the points, else of the cells; the active one unless another is named."""
    arrays: dict[str, tuple[bool, Any]] = {}
    widths: dict[str, int] = {}
    preferred = []
    for of_cells, attributes in ((False, data.GetPointData()), (True, data.GetCellData())):
        active = attributes.GetScalars()
        if active is not None and active.GetName():
            preferred.append(str(active.GetName()))
        for number in range(attributes.GetNumberOfArrays()):
            one = attributes.GetArray(number)
            name = None if one is None else one.GetName()
            if name and name not in arrays and name not in OWN_ARRAYS and one.GetNumberOfComponents() > 0:
                arrays[name], widths[name] = (of_cells, one), int(one.GetNumberOfComponents())
    name, base, column = choose_scalar(where, wanted, preferred, widths)
    of_cells, array = arrays[base]
    rows = _numbers(array)
    values = rows if rows.ndim == 1 else column_of(rows, column)
    return _Scalar(name, of_cells, values, scalar_names(widths))


def _samples(where: Where, scalar: _Scalar, points: tuple[int, int, int]) -> NDArray[Any]:
    """Return values as [k, j, i] of a grid with so many points along x, y, z."""
    counts = [max(count - 1, 1) if scalar.of_cells else count for count in points]
    if scalar.values.size != np.prod(counts) or not scalar.values.size:
        raise unreadable(where, f"{scalar.values.size} values of {scalar.name!r}", f"{' x '.join(map(str, counts))}")
    return scalar.values.reshape(counts[::-1])


def _told(scalar: _Scalar) -> dict[str, Any]:
    name = printable(scalar.name)
    return {"details": {"content": name, "scalar of": "the cells" if scalar.of_cells else "the points"},
            "quantity": Quantity(name)}  # fmt: skip


def read_image(data: Any, where: Where, scalar: str | None = None) -> Volume:
    """Return an image (vtkImageData) as a volume; cells have their values at their middles.

    Images that are turned keep their own axes (`axes.nearest_the_world`).

    Raises InvalidInput for unknown scalars.
    """
    chosen = _scalar(data, where, scalar)
    values = _samples(where, chosen, data.GetDimensions())
    matrix = data.GetDirectionMatrix()
    # Columns of the matrix are the directions of the axes.
    directions = np.array([[matrix.GetElement(row, axis) for row in range(3)] for axis in range(3)], dtype=np.float64)
    steps = directions * np.asarray(data.GetSpacing(), dtype=np.float64)[:, None]
    first = np.asarray(data.GetExtent()[::2], dtype=np.float64) + 0.5 * chosen.of_cells
    origin = np.asarray(data.GetOrigin(), dtype=np.float64) + first @ steps
    placed = nearest_the_world(where, "the direction matrix", steps, origin, values, None)
    told = _told(chosen)
    told["details"] |= placed.details
    return Volume(placed.values, placed.spacing, placed.origin, "vtk image", **told)


def read_rectilinear(data: Any, where: Where, scalar: str | None = None, resample: bool = False) -> Volume:
    """Return a rectilinear grid as a volume.

    Raises InvalidInput for unknown scalars, and for uneven coordinates unless `resample` is true.
    """
    chosen = _scalar(data, where, scalar)
    values = _samples(where, chosen, data.GetDimensions())
    places: list[Floats | None] = []
    for coordinates in (data.GetXCoordinates(), data.GetYCoordinates(), data.GetZCoordinates()):
        along = _numbers(coordinates).astype(np.float64)
        places.append(0.5 * (along[1:] + along[:-1]) if chosen.of_cells and along.size > 1 else along)
    placed = on_even_axes(where, ("x", "y", "z"), places, values, resample=resample)
    told = _told(chosen)
    told["details"] |= placed.details
    return Volume(placed.values, placed.spacing, placed.origin, "vtk rectilinear grid", **told)


def _points(data: Any, where: Where) -> Floats:
    points = data.GetPoints()
    count = 0 if points is None else points.GetNumberOfPoints()
    if not count:
        raise unreadable(where, "no points", "at least one")
    require_rows(where, count)
    return finite_points(where, _numbers(points.GetData()).astype(np.float64))


def _scattered(where: Where, points: Floats, cells: Cells, scalar: _Scalar, file_format: str) -> Scattered:
    """Return points with their values, or the middles of cells with theirs."""
    made = Meshes(where, scalar.of_cells)
    made.add(points, cells, scalar.values.astype(np.float64))
    return made.scattered(scalar.name, file_format, scalar.known)


def read_structured(data: Any, where: Where, scalar: str | None = None) -> Scattered:
    """Return a structured grid as a mesh of hexahedra; raises InvalidInput for unknown scalars."""
    chosen = _scalar(data, where, scalar)
    points = _points(data, where)
    counts = [0, 0, 0]
    data.GetDimensions(counts)
    hexahedra = hexahedra_of(counts)
    if chosen.of_cells and hexahedra.shape[0] != chosen.values.size:
        raise unreadable(where, "values of cells without a volume", "values of points", "use cell_data_to_point_data()")
    return _scattered(where, points, same_cells(hexahedra, HEXAHEDRON), chosen, "vtk structured grid")


def _lists(groups: list[Any], types: NDArray[np.int64]) -> Cells:
    """Return the cells of several vtkCellArrays, one after another."""
    there = [group for group in groups if group is not None and group.GetNumberOfCells()]
    lists = [(_numbers(one.GetConnectivityArray()), _numbers(one.GetOffsetsArray())[1:]) for one in there]
    return joined([(points.astype(np.int64), ends.astype(np.int64)) for points, ends in lists], types)


def _types(data: Any) -> Any:
    """Return the array of the types of all cells."""
    try:
        return data.GetCellTypes()
    except TypeError:
        # Before VTK 9.6 that method fills a list of the types that there are.
        return data.GetCellTypesArray()


def read_unstructured(data: Any, where: Where, scalar: str | None = None) -> Scattered:
    """Return an unstructured grid: its points and the cells with a volume; raises InvalidInput for unknown scalars."""
    chosen = _scalar(data, where, scalar)
    points = _points(data, where)
    types = _numbers(_types(data)).astype(np.int64) if data.GetNumberOfCells() else np.empty(0, np.int64)
    cells = _lists([data.GetCells()], types)
    return _scattered(where, points, cells, chosen, "vtk unstructured grid")


def read_surface(data: Any, where: Where, scalar: str | None = None) -> Scattered:
    """Return the points of a surface, or the middles of its cells; raises InvalidInput for unknown scalars."""
    chosen = _scalar(data, where, scalar)
    points = _points(data, where)
    # The order in which VTK counts cells.
    groups = [data.GetVerts(), data.GetLines(), data.GetPolys(), data.GetStrips()]
    return _scattered(where, points, _lists(groups, np.empty(0, np.int64)), chosen, "vtk surface")


def read_blocks(data: Any, where: Where, **options: Any) -> Volume | Scattered:
    """Return the only data set of a composite one; InvalidInput where there is none or more than one."""
    from sheetsplat._objects import kind_of_object
    from sheetsplat.io.objects import read_object

    blocks = [data.GetBlock(number) for number in range(data.GetNumberOfBlocks())]
    there = [one for one in blocks if one is not None and kind_of_object(one) is not None]
    if len(there) != 1:
        advice = "choose one block, or join them to one grid, in PyVista by combine()"
        raise unreadable(where, f"{len(there)} blocks", "one", advice)
    kind = kind_of_object(there[0])
    assert kind is not None
    return read_object(there[0], kind, options)
