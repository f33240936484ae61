"""Meshes that meshio reads: Gmsh, MED and XDMF.

Others are left out: those whose files name other files (Abaqus, Nastran …), and those whose reader in meshio does not
end where a file is cut off (Tecplot). What an XDMF or MED file refers to is looked at before meshio reads it: only
files of its own folder. Files of Gmsh, whose reader takes the memory that 600 bytes ask for, are read in a child.
"""

from __future__ import annotations

import contextlib
import importlib
import io
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import h5py  # type: ignore[import-untyped, unused-ignore]
import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import shown
from sheetsplat.io.checks import Where, beside, require_rows, unreadable
from sheetsplat.io.hdf5_access import checked, inside, walk
from sheetsplat.io.records import Floats, Scattered
from sheetsplat.io.sandbox import Array, read_apart
from sheetsplat.io.source import DEFLATE_RATIO, Source
from sheetsplat.io.vtk_cells import Cells, checked_lists, joined, one_mesh
from sheetsplat.io.vtk_grids import pick
from sheetsplat.io.vtk_xml.document import parse_tree

#: Modules of meshio by the suffixes of their files.
MODULES = {".msh": "gmsh", ".med": "med", ".xdmf": "xdmf", ".xmf": "xdmf"}
_HDF5 = b"\x89HDF"
# VTK's numbers of linear cells; of others without a volume that of a polygon, of others with one what VTK has not.
_TYPES = {"tetra": 10, "hexahedron": 12, "wedge": 13, "pyramid": 14}
_FLAT = ("vertex", "line", "triangle", "quad", "polygon")
_POLYGON, _UNKNOWN = 7, 255
_LONGEST_NAME = 4096
# Bytes that meshio takes for a byte of a text.
_PER_BYTE = 16


def _references(source: Source) -> dict[str, set[str]]:
    """Return the files, and the datasets in them, that an XDMF file names."""
    found: dict[str, set[str]] = {}
    for one in parse_tree(source).iter():
        if one.tag.lower() == "include" or one.tag.lower().endswith(":include"):
            raise unreadable(source.path, f"an element {shown(one.tag)}", "one file")
        kind = one.get("Format", "XML")
        if one.tag == "DataItem" and kind != "XML":
            if kind != "HDF":
                raise unreadable(source.path, f"numbers of format {shown(kind)}", "XML or HDF")
            text = "".join(one.itertext())
            if len(text) > _LONGEST_NAME:
                raise unreadable(source.path, f"the name of a dataset of {len(text)} characters", "a shorter one")
            file, _, dataset = text.strip().partition(":")
            found.setdefault(file, set()).add(dataset)
    return found


def _check_hdf5(source: Source, of_numbers: Iterable[str] = ()) -> None:
    """Raise InvalidInput for links to other files, and for datasets larger than what is stored of them.

    The datasets named in `of_numbers` must hold numbers: meshio opens their file by its name, and the HDF5 library
    would read texts of any length for ever where the heap that they are in leads back.
    """
    path = source.path
    with h5py.File(checked(source), "r") as file:
        for name in of_numbers:
            one = inside(path, file, name)
            if isinstance(one, h5py.Dataset) and one.dtype.kind not in "biuf":
                raise unreadable(path, f"a dataset {shown(name)} of {shown(one.dtype)}", "numbers")
        needed = 0
        for one in walk(path, file, strict=True):
            if one.dtype.kind not in "biufSOV" or one.shape is None:
                continue
            size, stored = one.size * one.dtype.itemsize, one.id.get_storage_size()
            if size > (stored if one.chunks is None else stored * DEFLATE_RATIO) and one.dtype.kind in "biuf":
                raise unreadable(path, f"{stored} stored bytes of {one.name}", f"{size} bytes, as its shape says")
            needed += size
        _memory.require(2 * needed, f"the numbers of {path}")


def _check(source: Source) -> None:
    """Raise an error for what meshio would trust."""
    path = source.path
    if source.packed:
        raise unreadable(path, "a gzipped file", "a file as meshio reads it", "unpack it first")
    if source.head(len(_HDF5)) == _HDF5:
        _check_hdf5(source)
        return
    _memory.require(_PER_BYTE * source.at_most(), f"the numbers of {path}")
    if MODULES[source.suffix] == "xdmf":
        for name, datasets in sorted(_references(source).items()):
            with Source(beside(path, name)) as other:
                _check_hdf5(other, sorted(datasets))


def _arrays_of(mesh: Any) -> Iterator[Array]:
    """Yield the arrays of a mesh of meshio, as `sandbox.read_apart` returns them."""
    yield ("points",), np.asarray(mesh.points)
    for block in mesh.cells:
        yield ("cells", block.type), np.asarray(block.data)
    for name, values in mesh.point_data.items():
        yield ("point_data", str(name)), np.asarray(values)
    for name, blocks in mesh.cell_data.items():
        yield from ((("cell_data", str(name)), np.asarray(values)) for values in blocks)


def _cells(blocks: Sequence[tuple[str, NDArray[Any]]], points: int, path: Where) -> Cells:
    lists: list[tuple[NDArray[np.int64], NDArray[np.int64]]] = []
    types = [np.empty(0, np.int64)]
    for kind, rows in blocks:
        if rows.ndim != 2 or rows.dtype.kind not in "iu":
            raise unreadable(path, f"cells of type {shown(kind)}", "as many points in each of a type")
        count, size = rows.shape
        ends = size * np.arange(1, count + 1, dtype=np.int64)
        numbers = rows.astype(np.int64).reshape(-1)
        checked_lists(path, shown(kind), numbers, ends, points)
        lists.append((numbers, ends))
        number = _TYPES.get(kind, _POLYGON if kind.startswith(_FLAT) else _UNKNOWN)
        types.append(np.full(count, number, dtype=np.int64))
    return joined(lists, np.concatenate(types))


def _rows(values: NDArray[Any]) -> NDArray[Any] | None:
    """Return numbers as rows, (N,) or (N, columns); None for anything else."""
    if values.dtype.kind not in "biuf" or values.ndim < 1:
        return None
    return values if values.ndim == 1 else values.reshape(len(values), -1)


def _read(source: Source) -> list[Array]:
    kind, path = MODULES[source.suffix], source.path
    if kind == "gmsh":
        return read_apart(source, kind)
    with contextlib.redirect_stdout(io.StringIO()):
        read = importlib.import_module("meshio." + kind).read
        return list(_arrays_of(read(checked(source) if kind == "med" else str(path))))


def read(source: Source, scalar: str | None = None) -> Scattered:
    """Read a mesh: an array of its points or of its cells; see `vtk_xml.meshes.read`.

    Raises InvalidInput for damaged files, and for files that name others outside of their folder.
    """
    _check(source)
    return _scattered(source.path, _read(source), scalar, MODULES[source.suffix])


def read_mesh(mesh: Any, where: Where, scalar: str | None = None) -> Scattered:
    """Return a meshio.Mesh: its points, or the middles of its cells; raises InvalidInput for unknown scalars."""
    return _scattered(where, _arrays_of(mesh), scalar, "meshio")


def _scattered(path: Where, given: Iterable[Array], scalar: str | None, kind: str) -> Scattered:
    """Return the mesh of its arrays, as `sandbox.read_apart` returns them."""
    found: dict[str, list[tuple[str, NDArray[Any]]]] = {}
    for key, values in given:
        found.setdefault(key[0], []).append((key[-1], values))
    points: Floats = np.asarray(found["points"][0][1], dtype=np.float64)
    if points.ndim != 2 or not 1 <= points.shape[1] <= 3:
        raise unreadable(path, f"points of shape {points.shape}", "(N, 3)")
    require_rows(path, len(points))
    points = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))
    cells = _cells(found.get("cells", []), len(points), path)
    arrays: dict[str, tuple[bool, NDArray[Any]]] = {}
    for name, values in found.get("point_data", []):
        rows = _rows(values)
        if rows is not None and len(rows) == len(points) and rows.size:
            arrays[name] = (False, rows)
    of_cells: dict[str, list[NDArray[Any] | None]] = {}
    for name, values in found.get("cell_data", []):
        of_cells.setdefault(name, []).append(_rows(values))
    for name, parts in of_cells.items():
        same = all(part is not None and part.shape[1:] == parts[0].shape[1:] for part in parts)  # type: ignore[union-attr]
        rows = np.concatenate(parts) if same else None  # type: ignore[arg-type]
        if rows is not None and len(rows) == cells.ends.size and rows.size:
            arrays.setdefault(name, (True, rows))
    known = [(name, of, 1 if rows.ndim == 1 else int(rows.shape[1]), rows) for name, (of, rows) in arrays.items()]
    # Numbers of geometric parts are no data, unless there are no others.
    preferred = [name for name, _, width, _ in sorted(known, key=lambda one: one[2] > 1) if ":" not in name]
    picked = pick(path, known, preferred, scalar)
    return one_mesh(path, picked, points, cells, picked.of(picked.array), kind)
