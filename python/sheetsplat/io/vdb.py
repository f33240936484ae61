"""OpenVDB files (.vdb): a grid of numbers, filled in over the box of its active voxels, by OpenVDB's own module."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from sheetsplat import _memory
from sheetsplat._checks import shown, triple
from sheetsplat.errors import Unsupported, complain, option_ref
from sheetsplat.io.checks import checked_shape, listed, printable, unreadable
from sheetsplat.io.names import tell_names
from sheetsplat.io.records import Volume
from sheetsplat.io.source import Source
from sheetsplat.quantity import Quantity

# What the module is called by conda-forge, and by Debian.
_MODULES = ("openvdb", "pyopenvdb")
_TYPES = {"float": np.float32, "double": np.float64, "int32": np.int32, "int64": np.int64, "bool": np.bool_}


def _module(source: Source) -> Any:
    for name in _MODULES:
        try:
            return importlib.import_module(name)
        except ImportError:
            continue
    what, wanted = f"{source.path} cannot be read as OpenVDB", "OpenVDB's own module, which is not a package of PyPI"
    advice = "conda install -c conda-forge openvdb, or apt-get install python3-openvdb"
    raise complain(what, "no module " + " or ".join(_MODULES), wanted, advice, kind=Unsupported)


def read(source: Source, name: str | None = None) -> Volume:
    """Read a grid: `name`, else the only one of numbers. Voxels that are not active have its background.

    Raises
    ------
    InvalidInput
        For damaged files, grids that are empty, and those whose voxels are no parallelepipeds.
    OutOfMemory
        Where the box of its active voxels does not fit.
    Unsupported
        Where there is no module of OpenVDB.
    """
    module, path = _module(source), source.path
    if source.packed:
        raise unreadable(path, "a gzipped OpenVDB file", "the file itself, which packs its own blocks", "unpack it")
    grids = {one.name: one for one in module.readAllGridMetadata(str(path)) if one.valueTypeName in _TYPES}
    names = tell_names(grids)
    if name is None and len(names) == 1:
        (name,) = names
    if name not in grids:
        found = f"no grid of numbers {shown(name)}" if name is not None else f"{len(grids)} grids of numbers"
        known = listed([printable(one) for one in names])
        advice = "pass " + option_ref("name", "...") if grids else ""
        raise unreadable(path, f"{found}; grids: {known or 'none'}", "one of them", advice)
    grid = module.read(str(path), name)
    if not grid.activeVoxelCount():
        raise unreadable(path, f"the grid {shown(name)} without active voxels", "some")
    low, high = (np.asarray(corner, dtype=np.int64) for corner in grid.evalActiveVoxelBoundingBox())
    shape = checked_shape(path, (high - low + 1).tolist(), f"the box of the grid {shown(name)} in voxels (x, y, z)")
    dtype = np.dtype(_TYPES[grid.valueTypeName])
    _memory.require(2 * int(np.prod(shape)) * dtype.itemsize, f"the samples of {path}")
    if not grid.transform.isLinear:
        raise unreadable(path, "voxels of a camera's frustum", "voxels that are parallelepipeds")
    values = np.empty(shape, dtype)
    grid.copyToArray(values, ijk=tuple(low.tolist()))
    first, *ends = (
        np.asarray(grid.transform.indexToWorld(tuple((low + step).tolist())), dtype=np.float64)
        for step in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
    )
    return Volume(
        np.ascontiguousarray(values.T),
        origin=triple("origin", first),
        format="openvdb",
        details={"content": printable(name)},
        quantity=Quantity(printable(name)),
        axes=np.stack(ends) - first,
    )
