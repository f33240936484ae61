"""VTK's data sets in HDF5 (.vtkhdf): images, unstructured grids and surfaces, in partitions and in time steps.

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
from sheetsplat.io.checks import checked_shape, chosen_step, finite_points, printable, require_rows, unreadable
from sheetsplat.io.hdf5_access import attribute, check_stored, checked, inside, read_rows
from sheetsplat.io.records import Scattered, Volume
from sheetsplat.io.scalars import choose_scalar, column_of, scalar_names
from sheetsplat.io.source import Source
from sheetsplat.io.vtk_cells import OWN_ARRAYS, Cells, Meshes, checked_lists, joined
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


class _Step:
    """A time step, and where its rows begin. A file without a group Steps has one, which begins at 0.

    Raises InvalidInput unless there is a time for each step that the file says it has.
    """

    def __init__(self, path: Path, group: Any) -> None:
        self._path = path
        found = inside(path, group, "Steps")
        self._group = found if isinstance(found, h5py.Group) else None
        self.count, self.number = 1, 0
        if self._group is None:
            return
        told = attribute(self._group, "NSteps", 1)
        self.count = 0 if told is None else int(np.asarray(told).reshape(-1)[0])
        times = inside(path, self._group, "Values")
        stored = times.shape[0] if isinstance(times, h5py.Dataset) and times.ndim == 1 else 0
        if self.count < 1 or self.count > stored:
            raise unreadable(path, f"{self.count} time steps with {stored} times", "one or more, each with its time")
        check_stored(path, times, "Steps/Values")

    @property
    def has_axis(self) -> bool:
        """Return whether arrays of images have an axis of time before the others."""
        return self._group is not None

    def choose(self, step: int | None) -> None:
        """Take a step, the only one unless given."""
        self.number = chosen_step(self._path, self.count, step)

    def first(self, name: str, column: int = 0) -> int | None:
        """Return what Steps/name has for this step; None where it has nothing."""
        one = None if self._group is None else inside(self._path, self._group, name)
        if not isinstance(one, h5py.Dataset):
            return None
        if one.ndim not in (1, 2) or one.dtype.kind not in "iu" or (one.ndim == 2 and column >= one.shape[1]):
            raise unreadable(self._path, f"no whole numbers in Steps/{name}", "one for each time step")
        row = read_rows(self._path, one, f"Steps/{name}", slice(self.number, self.number + 1)).reshape(-1)
        if row[column] < 0:
            raise unreadable(self._path, f"{row[column]} in Steps/{name}", "numbers that are not negative")
        return int(row[column])


def count_steps(source: Source, name: str | None = None) -> int:
    """Return the number of time steps."""
    with h5py.File(checked(source), "r") as file:
        return _Step(source.path, inside(source.path, file, _GROUP)).count


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
                usable = isinstance(one, h5py.Dataset) and one.dtype.kind in "iuf"
                usable = usable and name not in widths and name not in OWN_ARRAYS
                if usable and one.ndim in (grid_axes, grid_axes + 1) and one.shape[grid_axes:] != (0,):
                    found[name] = (where, one)
                    widths[name] = 1 if one.ndim == grid_axes else int(one.shape[-1])
        self.name, self._base, self.column = choose_scalar(path, scalar, [one for one in preferred if one], widths)
        self.known = scalar_names(widths)
        where, self.dataset = found[self._base]
        self.of_cells = where == "CellData"
        self.of_vectors = widths[self._base] > 1
        #: Where the dataset Steps/… has the first row of each time step.
        self.offsets = f"{where}Offsets/{self._base}"

    def rows(self, first: int, count: int) -> NDArray[Any]:
        """Return rows of the array that is shown."""
        return read_rows(self._path, self.dataset, self.name, slice(first, first + count), 8)


def _image(path: Path, group: Any, scalar: str | None, number: int | None) -> Volume:
    step = _Step(path, group)
    step.choose(number)
    arrays = _Arrays(path, group, scalar, 3 + step.has_axis)
    whole = attribute(group, "WholeExtent", 6)
    numbers = [] if whole is None else [int(one) for one in np.asarray(whole).reshape(-1)]
    if len(numbers) != 6:
        raise unreadable(path, f"WholeExtent = {shown(numbers)}", "six whole numbers")
    points = [numbers[2 * axis + 1] - numbers[2 * axis] + 1 for axis in (2, 1, 0)]
    counts = checked_shape(path, [max(one - 1, 1) if arrays.of_cells else one for one in points], "the extent")
    axes = arrays.dataset.shape[step.has_axis :]
    if tuple(axes[:3]) != counts:
        raise unreadable(path, f"{arrays.name} of {axes}", f"{counts}, as WholeExtent says")
    if step.has_axis:
        at = step.first(arrays.offsets)
        rows = arrays.rows(step.number if at is None else at, 1)[0]
    else:
        rows = arrays.rows(0, counts[0])
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


def read_image(source: Source, name: str | None = None, step: int | None = None) -> Volume:
    """Read an image: an array of its points, or of its cells, whose values lie at their middles.

    Raises InvalidInput for damaged files, several time steps without `step`, and links to other files.
    """
    with h5py.File(checked(source), "r") as file, np.errstate(all="ignore"):
        return _image(source.path, inside(source.path, file, _GROUP), name, step)


class _Rows:
    """Rows of a dataset that are taken one part after another, read at once."""

    def __init__(self, path: Path, group: Any, name: str, first: int, count: int) -> None:
        one = inside(path, group, name)
        if not isinstance(one, h5py.Dataset) or one.dtype.kind not in "iuf" or one.ndim not in (1, 2):
            raise unreadable(path, f"no numbers in {name}", "a dataset")
        self._rows = read_rows(path, one, name, slice(first, first + count), 8)
        self._used = 0

    def take(self, count: int) -> NDArray[Any]:
        """Return the next rows."""
        self._used += count
        return self._rows[self._used - count : self._used]


class _Partitions:
    """Numbers of the partitions of a time step, which lie one after another in each dataset."""

    def __init__(self, path: Path, group: Any, step: _Step) -> None:
        self._path, self._group, self._step = path, group, step
        self.first = step.first("PartOffsets") or 0
        self._of_all_steps: int = self._whole("NumberOfPoints").shape[0]
        told = step.first("NumberOfParts")
        # Without it every step has as many.
        self.count = max(1, self._of_all_steps // step.count) if told is None else told
        if self.count > _MOST_PARTITIONS:
            raise unreadable(path, f"{self.count} partitions", f"at most {_MOST_PARTITIONS}")

    def _whole(self, name: str) -> Any:
        one = inside(self._path, self._group, name)
        if not isinstance(one, h5py.Dataset) or one.ndim != 1 or one.dtype.kind not in "iu":
            raise unreadable(self._path, f"no whole numbers in {name}", "one for each partition")
        return one

    def counts(self, name: str) -> list[int]:
        """Return a number for each partition."""
        one = self._whole(name)
        if one.shape[0] != self._of_all_steps:
            raise unreadable(self._path, f"{one.shape[0]} partitions in {name}", f"{self._of_all_steps}")
        rows = read_rows(self._path, one, name, slice(self.first, self.first + self.count))
        if np.any(rows < 0):
            raise unreadable(self._path, f"negative numbers in {name}", "numbers that are not negative")
        return [int(count) for count in rows]

    def rows(self, name: str, count: int, first: int | None) -> _Rows:
        """Return rows of all partitions; `first` as the step has it, 0 unless it does."""
        return _Rows(self._path, self._group, name, first or 0, count)


class _Lists:
    """Lists of cells of all partitions: those of a mesh, or one of the four of a surface."""

    def __init__(self, path: Path, parts: _Partitions, step: _Step, prefix: str, number: int) -> None:
        self._path, self._name = path, prefix + "Connectivity"
        self.cells = parts.counts(prefix + "NumberOfCells")
        self._sizes = parts.counts(prefix + "NumberOfConnectivityIds")
        self.first = step.first("CellOffsets", number) or 0
        # A partition has one more of them than cells.
        starts = self.first + parts.first
        self._offsets = parts.rows(prefix + "Offsets", sum(self.cells) + parts.count, starts)
        ids = step.first("ConnectivityIdOffsets", number)
        self._connectivity = parts.rows(self._name, sum(self._sizes), ids)

    def take(self, part: int, points: int) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return point numbers and ends of the cells of the next partition."""
        offsets = self._offsets.take(self.cells[part] + 1).astype(np.int64)
        connectivity = self._connectivity.take(self._sizes[part]).astype(np.int64).reshape(-1)
        ends = offsets[1:].reshape(-1)
        checked_lists(self._path, self._name, connectivity, ends, points)
        return connectivity, ends


def _mesh(path: Path, group: Any, kind: str, scalar: str | None, number: int | None) -> Scattered:
    step = _Step(path, group)
    step.choose(number)
    arrays = _Arrays(path, group, scalar, 1)
    parts = _Partitions(path, group, step)
    points_of = parts.counts("NumberOfPoints")
    require_rows(path, sum(points_of))
    is_mesh = kind == "UnstructuredGrid"
    prefixes = ("",) if is_mesh else tuple(f"{name}/" for name in _LISTS)
    lists = [_Lists(path, parts, step, prefix, number) for number, prefix in enumerate(prefixes)]
    cells_of = [sum(one.cells[part] for one in lists) for part in range(len(points_of))]
    first_point = step.first("PointOffsets") or 0
    all_points = parts.rows("Points", sum(points_of), first_point)
    all_types = parts.rows("Types", sum(cells_of), lists[0].first) if is_mesh else None
    first = step.first(arrays.offsets)
    if first is None:
        first = sum(one.first for one in lists) if arrays.of_cells else first_point
    values = column_of(arrays.rows(first, sum(cells_of if arrays.of_cells else points_of)), arrays.column)
    meshes = Meshes(path, arrays.of_cells)
    used = 0
    for part, count in enumerate(points_of):
        points = all_points.take(count)
        if points.ndim != 2 or points.shape[1] != 3:
            raise unreadable(path, f"Points of {points.shape}", "(N, 3)")
        types = np.empty(0, np.int64) if all_types is None else all_types.take(cells_of[part]).astype(np.int64)
        cells: Cells = joined([one.take(part, count) for one in lists], types.reshape(-1))
        taken = cells_of[part] if arrays.of_cells else count
        meshes.add(finite_points(path, points.astype(np.float64)), cells, values[used : used + taken])
        used += taken
    return meshes.scattered(arrays.name, "vtkhdf", arrays.known)


def read(source: Source, scalar: str | None = None, step: int | None = None) -> Scattered:
    """Read an unstructured grid or a surface; see `vtk_xml.meshes.read`.

    Raises InvalidInput for other types, damaged files, several time steps without `step`, and links to other files.
    """
    path = source.path
    with h5py.File(checked(source), "r") as file, np.errstate(all="ignore"):
        kind = _type(path, file)
        if kind not in _MESHES:
            found = f"a VTKHDF file of type {shown(kind)}"
            raise unreadable(path, found, "ImageData, " + ", ".join(_MESHES), "save one data set of it")
        return _mesh(path, inside(path, file, _GROUP), kind, scalar, step)
