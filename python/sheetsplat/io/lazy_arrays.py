"""Arrays that other libraries read when they are asked for: those of dask, Zarr and h5py."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from sheetsplat.io.cf import READ, NamedArray, dimension_names
from sheetsplat.io.checks import Where, check_volume
from sheetsplat.io.records import Volume
from sheetsplat.io.stored import LazySamples


def part_of(array: Any, index: tuple[int | slice, ...], **how: str) -> Any:
    """Return a part of an array; what dask holds is computed, `how` its scheduler is told."""
    part = array[index]
    part = part.data if hasattr(part, "dims") else part
    return part.compute(**how) if hasattr(part, "compute") else part


def named(data: Any, where: Where) -> NamedArray:
    """Return an array with what it says about itself, of which no sample is read yet."""
    module = type(data).__module__.partition(".")[0]
    if module == "h5py":
        from sheetsplat.io.hdf5_volumes import named as named_dataset

        one = named_dataset(where, data)
        return replace(one, samples=replace(one.samples, fetch=partial(part_of, data)))
    told = dict(getattr(data, "attrs", {})) if module == "zarr" else {}
    names = getattr(getattr(data, "metadata", None), "dimension_names", None) or told.get("_ARRAY_DIMENSIONS")
    if not names or len(names) != len(data.shape):
        names = [None] * len(data.shape)
    check_volume(str(where), data.shape, data.dtype)
    samples = LazySamples.of(partial(part_of, data), data.dtype, data.shape)
    # Names that dask makes up say nothing.
    name = "" if module == "dask" else str(getattr(data, "name", None) or "").rpartition("/")[2]
    one = NamedArray(where, name, dimension_names(names), samples, {key: told[key] for key in READ if key in told})
    root = getattr(getattr(data, "store", None), "root", None)
    if root is not None:
        from sheetsplat.io.zarr_folders import placed_beside

        return placed_beside(Path(root) / data.path, one)
    return one


def read(data: Any, where: Where) -> Volume:
    """Return an array as a volume: [k, j, i], or by the names of its dimensions."""
    return named(data, where).read(type(data).__module__.partition(".")[0])
