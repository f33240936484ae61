"""VTK's data sets in HDF5 (.vtkhdf): images, unstructured grids and surfaces, in partitions and in time steps.

Read through h5py and its checks (`hdf5_access`), as all HDF5 is, and without VTK.
Source: the VTKHDF file format, versions 1 and 2, of VTK's documentation.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped, unused-ignore]
import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import shown
from sheetsplat.io.checks import checked_shape, chosen_step, floats, printable, require_rows, unreadable
from sheetsplat.io.hdf5_access import attribute, check_stored, checked, inside, read_rows
from sheetsplat.io.records import Scattered, Volume
from sheetsplat.io.source import Source
from sheetsplat.io.vtk_cells import Cells, Meshes, checked_lists, joined
from sheetsplat.io.vtk_grids import STRAIGHT, Picked, counts_of, image, pick, sizes_of

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


def _pick(path: Path, group: Any, scalar: str | None, grid_axes: int) -> Picked:
    """Return the scalar that is shown; its array is the dataset, and where Steps has its first rows."""
    owners = [(name, inside(path, group, name)) for name in ("PointData", "CellData")]
    owners = [(name, one) for name, one in owners if isinstance(one, h5py.Group)]

    def arrays() -> Iterator[tuple[str, bool, int, Any]]:
        for owner, there in owners:
            names = list(there)
            if len(names) > _MOST_ARRAYS:
                raise unreadable(path, f"{len(names)} arrays of {owner}", f"at most {_MOST_ARRAYS}")
            for name in names:
                one = inside(path, there, name)
                usable = isinstance(one, h5py.Dataset) and one.dtype.kind in "iuf"
                if usable and one.ndim in (grid_axes, grid_axes + 1):
                    columns = 1 if one.ndim == grid_axes else int(one.shape[-1])
                    yield name, owner == "CellData", columns, (one, f"{owner}Offsets/{name}")

    return pick(path, arrays(), [printable(attribute(one, "Scalars")) for _, one in owners], scalar)


def _image(path: Path, group: Any, scalar: str | None, number: int | None) -> Volume:
    step = _Step(path, group)
    step.choose(number)
    picked = _pick(path, group, scalar, 3 + step.has_axis)
    dataset, offsets = picked.array

    def told(name: str, *default: float) -> list[float]:
        given = attribute(group, name, 9)
        return floats(path, name, default if given is None else given, len(default))

    whole = attribute(group, "WholeExtent", 6)
    extent = [] if whole is None else [int(one) for one in np.asarray(whole).reshape(-1)]
    if len(extent) != 6:
        raise unreadable(path, f"WholeExtent = {shown(extent)}", "six whole numbers")
    counts = counts_of(sizes_of(extent), of_cells=picked.of_cells)[::-1]
    axes = dataset.shape[step.has_axis :]
    if tuple(axes[:3]) != checked_shape(path, counts, "the extent"):
        raise unreadable(path, f"{picked.name} of {axes}", f"{tuple(counts)}, as WholeExtent says")
    first, rows = 0, counts[0]
    if step.has_axis:
        at = step.first(offsets)
        first, rows = step.number if at is None else at, 1
    values = _rows(path, picked.name, dataset, first, rows).reshape(-1, picked.columns)
    spacing, origin = told("Spacing", 1.0, 1.0, 1.0), told("Origin", 0.0, 0.0, 0.0)
    if min(spacing) <= 0:
        raise unreadable(path, f"Spacing = {spacing}", "three numbers above 0")
    return image(path, picked, picked.of(values), extent, spacing, origin, told("Direction", *STRAIGHT), "vtkhdf")


def read_image(source: Source, name: str | None = None, step: int | None = None) -> Volume:
    """Read an image: an array of its points, or of its cells, whose values lie at their middles.

    Raises InvalidInput for damaged files, several time steps without `step`, and links to other files.
    """
    with h5py.File(checked(source), "r") as file, np.errstate(all="ignore"):
        return _image(source.path, inside(source.path, file, _GROUP), name, step)


def _rows(path: Path, name: str, dataset: Any, first: int, count: int) -> NDArray[Any]:
    return read_rows(path, dataset, name, slice(first, first + count), 8)


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

    def rows(self, name: str, counts: Sequence[int], first: int | None) -> list[NDArray[Any]]:
        """Return so many rows of each partition; `first` as the step has it, 0 unless it does."""
        one = inside(self._path, self._group, name)
        if not isinstance(one, h5py.Dataset) or one.dtype.kind not in "iuf" or one.ndim not in (1, 2):
            raise unreadable(self._path, f"no numbers in {name}", "a dataset")
        return np.split(_rows(self._path, name, one, first or 0, sum(counts)), np.cumsum(counts)[:-1])


class _Lists:
    """Lists of cells of all partitions: those of a mesh, or one of the four of a surface."""

    def __init__(self, path: Path, parts: _Partitions, step: _Step, prefix: str, number: int) -> None:
        self._path, self._name = path, prefix + "Connectivity"
        self.cells = parts.counts(prefix + "NumberOfCells")
        sizes = parts.counts(prefix + "NumberOfConnectivityIds")
        self.first = step.first("CellOffsets", number) or 0
        # A partition has one more of them than cells.
        starts = self.first + parts.first
        self._offsets = parts.rows(prefix + "Offsets", [count + 1 for count in self.cells], starts)
        self._connectivity = parts.rows(self._name, sizes, step.first("ConnectivityIdOffsets", number))

    def of(self, part: int, points: int) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return point numbers and ends of the cells of a partition."""
        connectivity = self._connectivity[part].astype(np.int64).reshape(-1)
        ends = self._offsets[part].astype(np.int64)[1:].reshape(-1)
        checked_lists(self._path, self._name, connectivity, ends, points)
        return connectivity, ends


def _mesh(path: Path, group: Any, kind: str, scalar: str | None, number: int | None) -> Scattered:
    step = _Step(path, group)
    step.choose(number)
    picked = _pick(path, group, scalar, 1)
    dataset, offsets = picked.array
    parts = _Partitions(path, group, step)
    points_of = parts.counts("NumberOfPoints")
    require_rows(path, sum(points_of))
    is_mesh = kind == "UnstructuredGrid"
    prefixes = ("",) if is_mesh else tuple(f"{name}/" for name in _LISTS)
    lists = [_Lists(path, parts, step, prefix, number) for number, prefix in enumerate(prefixes)]
    cells_of = [sum(one.cells[part] for one in lists) for part in range(len(points_of))]
    first_point = step.first("PointOffsets") or 0
    all_points = parts.rows("Points", points_of, first_point)
    all_types = parts.rows("Types", cells_of, lists[0].first) if is_mesh else None
    first = step.first(offsets)
    if first is None:
        first = sum(one.first for one in lists) if picked.of_cells else first_point
    counts = cells_of if picked.of_cells else points_of
    values = np.split(picked.of(_rows(path, picked.name, dataset, first, sum(counts))), np.cumsum(counts)[:-1])
    meshes = Meshes(path, picked.of_cells)
    for part, count in enumerate(points_of):
        points = all_points[part]
        if points.ndim != 2 or points.shape[1] != 3:
            raise unreadable(path, f"Points of {points.shape}", "(N, 3)")
        types = np.empty(0, np.int64) if all_types is None else all_types[part].astype(np.int64)
        cells: Cells = joined([one.of(part, count) for one in lists], types.reshape(-1))
        meshes.add(points.astype(np.float64), cells, values[part].astype(np.float64))
    return meshes.scattered(picked, "vtkhdf")


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
