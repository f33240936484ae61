"""Data sets of VTK and PyVista: images, rectilinear, structured and unstructured grids, surfaces."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.io import amr
from sheetsplat.io.checks import Where, require_rows, unreadable
from sheetsplat.io.records import Floats, Scattered, Volume
from sheetsplat.io.vtk_cells import HEXAHEDRON, Cells, hexahedra_of, joined, one_mesh, same_cells
from sheetsplat.io.vtk_grids import Picked, image, pick, rectilinear


def _numbers(array: Any) -> NDArray[Any]:
    """Return the numbers of an array of VTK, without a copy where there is one array in memory."""
    from vtkmodules.util.numpy_support import (  # type: ignore[import-not-found, import-untyped, unused-ignore]
        vtk_to_numpy,
    )

    found: NDArray[Any] = vtk_to_numpy(array)
    return found


def _scalar(data: Any, where: Where, wanted: str | None) -> tuple[Picked, NDArray[Any]]:
    """Return the chosen scalar, of the points or else of the cells, the active one unless named, and its numbers."""
    owners = (data.GetPointData(), data.GetCellData())

    def arrays() -> Iterator[tuple[str | None, bool, int, Any]]:
        for of_cells, owner in enumerate(owners):
            for number in range(owner.GetNumberOfArrays()):
                if (one := owner.GetArray(number)) is not None:
                    yield one.GetName(), bool(of_cells), int(one.GetNumberOfComponents()), one

    active = [owner.GetScalars() for owner in owners]
    picked = pick(where, arrays(), [str(one.GetName()) for one in active if one is not None], wanted)
    return picked, picked.of(_numbers(picked.array))


def read_image(data: Any, where: Where, scalar: str | None = None) -> Volume:
    """Return an image (vtkImageData) as a volume; see `vtk_grids.image`. Raises InvalidInput for unknown scalars."""
    matrix = data.GetDirectionMatrix()
    direction = [matrix.GetElement(row, column) for row in range(3) for column in range(3)]
    place = (data.GetExtent(), data.GetSpacing(), data.GetOrigin(), direction)
    return image(where, *_scalar(data, where, scalar), *place, "vtk image")


def read_rectilinear(data: Any, where: Where, scalar: str | None = None, resample: bool = False) -> Volume:
    """Return a rectilinear grid as a volume.

    Raises InvalidInput for unknown scalars, and for uneven coordinates unless `resample` is true.
    """
    axes = (data.GetXCoordinates(), data.GetYCoordinates(), data.GetZCoordinates())
    points = [_numbers(one).astype(np.float64) for one in axes]
    return rectilinear(where, *_scalar(data, where, scalar), points, resample, "vtk rectilinear grid")


def _points(data: Any, where: Where) -> Floats:
    points = data.GetPoints()
    count = 0 if points is None else points.GetNumberOfPoints()
    if not count:
        raise unreadable(where, "no points", "at least one")
    require_rows(where, count)
    return _numbers(points.GetData()).astype(np.float64)


def _scattered(data: Any, where: Where, scalar: str | None, cells: Cells, file_format: str) -> Scattered:
    """Return points with their values, or the middles of cells with theirs."""
    picked, values = _scalar(data, where, scalar)
    points = _points(data, where)
    if picked.of_cells and cells.ends.size != values.size:
        raise unreadable(where, "values of cells without a volume", "values of points", "use cell_data_to_point_data()")
    return one_mesh(where, picked, points, cells, values, file_format)


def read_structured(data: Any, where: Where, scalar: str | None = None) -> Scattered:
    """Return a structured grid as a mesh of hexahedra; raises InvalidInput for unknown scalars."""
    counts = [0, 0, 0]
    data.GetDimensions(counts)
    cells = same_cells(hexahedra_of(counts), HEXAHEDRON)
    return _scattered(data, where, scalar, cells, "vtk structured grid")


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
    types = _numbers(_types(data)).astype(np.int64) if data.GetNumberOfCells() else np.empty(0, np.int64)
    return _scattered(data, where, scalar, _lists([data.GetCells()], types), "vtk unstructured grid")


def read_surface(data: Any, where: Where, scalar: str | None = None) -> Scattered:
    """Return the points of a surface, or the middles of its cells; raises InvalidInput for unknown scalars."""
    # The order in which VTK counts cells.
    groups = [data.GetVerts(), data.GetLines(), data.GetPolys(), data.GetStrips()]
    return _scattered(data, where, scalar, _lists(groups, np.empty(0, np.int64)), "vtk surface")


def read_amr(data: Any, where: Where, scalar: str | None = None) -> Scattered:
    """Return the cells of overlapping AMR that no finer level covers; raises InvalidInput for unknown scalars."""
    # Older versions of VTK have other names.
    count_of = getattr(data, "GetNumberOfBlocks", None) or data.GetNumberOfDataSets
    block_of = getattr(data, "GetDataSetAsImageData", None) or data.GetDataSet
    levels = []
    for level in range(data.GetNumberOfLevels()):
        blocks = [block_of(level, number) for number in range(count_of(level))]
        levels.append([read_image(one, where, scalar) for one in blocks if one is not None])
    return amr.scattered(where, levels, "vtk amr")


def read_blocks(data: Any, where: Where, **options: Any) -> Volume | Scattered:
    """Return the only data set of a composite one; InvalidInput where there is none or more than one."""
    from sheetsplat._objects import kind_of_object
    from sheetsplat.io.objects import read_object

    blocks = [data.GetBlock(number) for number in range(data.GetNumberOfBlocks())]
    there = [(one, kind) for one in blocks if one is not None and (kind := kind_of_object(one)) is not None]
    if len(there) != 1:
        advice = "choose one block, or join them to one grid, in PyVista by combine()"
        raise unreadable(where, f"{len(there)} blocks", "one", advice)
    return read_object(*there[0], options)
