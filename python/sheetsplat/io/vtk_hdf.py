"""VTK's data sets in HDF5 (.vtkhdf): images, unstructured grids and surfaces, in one or more partitions.

Source: the VTKHDF file format, versions 1 and 2, of VTK's documentation.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped, unused-ignore]
import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import shown, triple
from sheetsplat.io.axes import nearest_the_world
from sheetsplat.io.checks import checked_shape, finite_points, printable, require_rows, unreadable
from sheetsplat.io.hdf5_access import attribute, inside, read_dataset, seekable
from sheetsplat.io.records import Scattered, Volume
from sheetsplat.io.scalars import choose_scalar, column_of, scalar_names
from sheetsplat.io.source import Source
from sheetsplat.io.vtk_cells import Cells, Meshes, checked_lists, joined
from sheetsplat.quantity import Quantity

_GROUP = "VTKHDF"
_MESHES = ("UnstructuredGrid", "PolyData")
_LISTS = ("Vertices", "Lines", "Polygons", "Strips")
_MOST_ARRAYS = 1000
_MOST_PARTITIONS = 100_000


def _type(path: Path, file: Any) -> str:
    group = inside(path, file, _GROUP) if _GROUP in file else None
    return printable(attribute(group, "Type")) if isinstance(group, h5py.Group) else ""


def kind_of(path: Path, file: Any) -> str:
    """Return "vtkhdf image", "vtkhdf" for everything else in a group VTKHDF, or ""."""
    if _GROUP not in file:
        return ""
    return "vtkhdf image" if _type(path, file) == "ImageData" else "vtkhdf"


def _one_step(path: Path, group: Any) -> None:
    """Raise InvalidInput for several time steps."""
    steps = inside(path, group, "Steps")
    count = attribute(steps, "NSteps") if isinstance(steps, h5py.Group) else None
    if count is not None and int(count) > 1:
        raise unreadable(path, f"{int(count)} time steps", "one", "save one of them as a file of its own")


class _Arrays:
    """The arrays of points and cells of a data set, and that of them which is shown."""

    def __init__(self, path: Path, group: Any, scalar: str | None, grid_axes: int) -> None:
        self._path = path
        found: dict[str, tuple[str, Any]] = {}
        widths: dict[str, int] = {}
        preferred = []
        for where in ("PointData", "CellData"):
            owner = inside(path, group, where)
            if not isinstance(owner, h5py.Group):
                continue
            names = list(owner)
            if len(names) > _MOST_ARRAYS:
                raise unreadable(path, f"{len(names)} arrays of {where}", f"at most {_MOST_ARRAYS}")
            preferred.append(printable(attribute(owner, "Scalars")))
            for name in names:
                one = inside(path, owner, name)
                usable = isinstance(one, h5py.Dataset) and one.dtype.kind in "iuf" and name not in widths
                if usable and one.ndim in (grid_axes, grid_axes + 1) and one.shape[grid_axes:] != (0,):
                    found[name] = (where, one)
                    widths[name] = 1 if one.ndim == grid_axes else int(one.shape[-1])
        self.name, self._base, self.column = choose_scalar(path, scalar, [one for one in preferred if one], widths)
        self.known = scalar_names(widths)
        where, self.dataset = found[self._base]
        self.of_cells = where == "CellData"
        self.of_vectors = widths[self._base] > 1

    def rows(self) -> NDArray[Any]:
        """Return all rows of the array that is shown."""
        return read_dataset(self._path, self.dataset, str(self.dataset.name), 8 * self.dataset.size)


def _image(path: Path, group: Any, scalar: str | None) -> Volume:
    _one_step(path, group)
    arrays = _Arrays(path, group, scalar, 3)
    whole = attribute(group, "WholeExtent", 6)
    numbers = [] if whole is None else [int(one) for one in np.asarray(whole).reshape(-1)]
    if len(numbers) != 6:
        raise unreadable(path, f"WholeExtent = {shown(numbers)}", "six whole numbers")
    points = [numbers[2 * axis + 1] - numbers[2 * axis] + 1 for axis in (2, 1, 0)]
    counts = checked_shape(path, [max(one - 1, 1) if arrays.of_cells else one for one in points], "the extent")
    if tuple(arrays.dataset.shape[:3]) != counts:
        raise unreadable(path, f"{arrays.name} of {arrays.dataset.shape}", f"{counts}, as WholeExtent says")
    rows = arrays.rows()
    if arrays.of_vectors:
        rows = column_of(rows.reshape(-1, rows.shape[-1]), arrays.column)
    values = rows.reshape(counts)

    def told(name: str, default: tuple[float, ...]) -> NDArray[np.float64]:
        given = attribute(group, name, 9)
        found = np.asarray(default if given is None else given, dtype=np.float64).reshape(-1)
        if found.size != len(default) or not np.all(np.isfinite(found)):
            raise unreadable(path, f"{name} = {shown(given)}", f"{len(default)} finite numbers")
        return found

    spacing = triple("Spacing", told("Spacing", (1.0, 1.0, 1.0)))
    if min(spacing) <= 0:
        raise unreadable(path, f"Spacing = {spacing}", "three numbers above 0")
    steps = told("Direction", (1.0, 0, 0, 0, 1, 0, 0, 0, 1)).reshape(3, 3).T * np.asarray(spacing)[:, None]
    first = np.asarray(numbers[::2], dtype=np.float64) + 0.5 * arrays.of_cells
    placed = nearest_the_world(path, "Direction", steps, told("Origin", (0.0, 0, 0)) + first @ steps, values, None)
    details = {"content": arrays.name, **placed.details}
    return Volume(placed.values, placed.spacing, placed.origin, "vtkhdf", details, Quantity(printable(arrays.name)))


def read_image(source: Source, name: str | None = None) -> Volume:
    """Read an image: an array of its points, or of its cells, whose values lie at their middles.

    Raises InvalidInput for damaged files, several time steps and links to other files.
    """
    with h5py.File(seekable(source), "r") as file, np.errstate(all="ignore"):
        return _image(source.path, inside(source.path, file, _GROUP), name)


class _Partitions:
    """Numbers of a mesh whose partitions lie one after another in each dataset."""

    def __init__(self, path: Path, group: Any) -> None:
        self._path, self._group = path, group
        self._read: dict[str, NDArray[Any]] = {}
        self._used: dict[str, int] = {}

    def counts(self, name: str, wanted: int | None = None) -> list[int]:
        """Return a number for each partition."""
        one = inside(self._path, self._group, name)
        if not isinstance(one, h5py.Dataset) or one.ndim != 1 or one.dtype.kind not in "iu":
            raise unreadable(self._path, f"no whole numbers in {name}", "one for each partition")
        if one.shape[0] > _MOST_PARTITIONS or one.shape[0] != (one.shape[0] if wanted is None else wanted):
            limit = f"at most {_MOST_PARTITIONS}" if wanted is None else f"{wanted}"
            raise unreadable(self._path, f"{one.shape[0]} partitions in {name}", limit)
        numbers = [int(count) for count in read_dataset(self._path, one, name)]
        if any(count < 0 for count in numbers):
            raise unreadable(self._path, f"negative numbers in {name}", "numbers that are not negative")
        return numbers

    def take(self, name: str, count: int) -> NDArray[Any]:
        """Return the next rows of a dataset."""
        if name not in self._read:
            one = inside(self._path, self._group, name)
            if not isinstance(one, h5py.Dataset) or one.dtype.kind not in "iuf" or one.ndim not in (1, 2):
                raise unreadable(self._path, f"no numbers in {name}", "a dataset")
            self._read[name] = read_dataset(self._path, one, name)
        rows, first = self._read[name], self._used.get(name, 0)
        if first + count > len(rows):
            raise unreadable(self._path, f"{len(rows)} rows of {name}", f"{first + count}, as its partitions have")
        self._used[name] = first + count
        return rows[first : first + count]

    def cells(self, prefix: str, count: int, connections: int, points: int) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return point numbers and ends of the cells of the next partition."""
        offsets = self.take(prefix + "Offsets", count + 1).astype(np.int64)
        connectivity = self.take(prefix + "Connectivity", connections).astype(np.int64).reshape(-1)
        ends = offsets[1:].reshape(-1)
        checked_lists(self._path, prefix + "Connectivity", connectivity, ends, points)
        return connectivity, ends


def _mesh(path: Path, group: Any, kind: str, scalar: str | None) -> Scattered:
    _one_step(path, group)
    arrays = _Arrays(path, group, scalar, 1)
    parts = _Partitions(path, group)
    points_of = parts.counts("NumberOfPoints")
    partitions = len(points_of)
    prefixes = ("",) if kind == "UnstructuredGrid" else tuple(f"{name}/" for name in _LISTS)
    cells_of = [parts.counts(prefix + "NumberOfCells", partitions) for prefix in prefixes]
    sizes_of = [parts.counts(prefix + "NumberOfConnectivityIds", partitions) for prefix in prefixes]
    require_rows(path, sum(points_of))
    rows = arrays.rows()
    values = column_of(rows, arrays.column)
    meshes = Meshes(path, arrays.of_cells)
    used = 0
    for part, count in enumerate(points_of):
        points = parts.take("Points", count)
        if points.ndim != 2 or points.shape[1] != 3:
            raise unreadable(path, f"Points of {points.shape}", "(N, 3)")
        lists = [
            parts.cells(prefix, cells[part], sizes[part], count)
            for prefix, cells, sizes in zip(prefixes, cells_of, sizes_of, strict=True)
        ]
        number = sum(cells[part] for cells in cells_of)
        types = parts.take("Types", number).astype(np.int64).reshape(-1) if prefixes == ("",) else np.empty(0, np.int64)
        cells: Cells = joined(lists, types)
        taken = number if arrays.of_cells else count
        if used + taken > len(values):
            raise unreadable(path, f"{len(values)} rows of {arrays.name}", f"{used + taken}")
        meshes.add(finite_points(path, points.astype(np.float64)), cells, values[used : used + taken])
        used += taken
    return meshes.scattered(arrays.name, "vtkhdf", arrays.known)


def read(source: Source, scalar: str | None = None) -> Scattered:
    """Read an unstructured grid or a surface; see `vtk_xml.meshes.read`.

    Raises InvalidInput for other types, damaged files, several time steps and links to other files.
    """
    path = source.path
    with h5py.File(seekable(source), "r") as file, np.errstate(all="ignore"):
        kind = _type(path, file)
        if kind not in _MESHES:
            found = f"a VTKHDF file of type {shown(kind)}"
            raise unreadable(path, found, "ImageData, " + ", ".join(_MESHES), "save one data set of it")
        return _mesh(path, inside(path, file, _GROUP), kind, scalar)
