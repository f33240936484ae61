"""Volumes in HDF5 files: one dataset with three axes, FILE:/group/dataset."""

from __future__ import annotations

import math
import os
from collections.abc import Hashable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped, unused-ignore]
import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import shown, triple
from sheetsplat.errors import option_ref
from sheetsplat.io import vtk_hdf
from sheetsplat.io.cf import READ, Coordinate, NamedArray, dimension_names
from sheetsplat.io.checks import Where, floats, listed, printable, unreadable
from sheetsplat.io.hdf5_access import attribute, check_stored, checked, inside, read_dataset, seekable, walk
from sheetsplat.io.names import tell_names
from sheetsplat.io.records import Volume
from sheetsplat.io.source import Source
from sheetsplat.io.stored import LazySamples

_NETCDF_SUFFIXES = (".nc", ".nc4", ".cdf", ".netcdf")


def _is_volume(one: Any) -> bool:
    return one.ndim >= 3 and one.dtype.kind in "biuf"


def kind_of(source: Source) -> str:
    """Return what an HDF5 file holds: "vtkhdf image", "vtkhdf", "netcdf", "volume", else "particles"."""
    if source.inner:
        return "netcdf" if source.suffix in _NETCDF_SUFFIXES else "volume"
    with h5py.File(checked(source), "r") as file:
        if "_NCProperties" in file.attrs or source.suffix in _NETCDF_SUFFIXES:
            return "netcdf"
        found = vtk_hdf.kind_of(source.path, file)
        if found:
            return found
        if any(name.startswith("PartType") for name in file):
            return "particles"
        if any(map(_is_volume, walk(source.path, file))):
            return "volume"
        # What the file is about may be in another one.
        walk(source.path, file, strict=True)
        return "particles"


def _attributes(one: Any) -> dict[str, Any]:
    found = {name: told for name in READ if (told := attribute(one, name, 16)) is not None}
    return {name: told.decode("utf-8", "replace") if isinstance(told, bytes) else told for name, told in found.items()}


def named(where: Where, one: Any) -> NamedArray:
    """Return a dataset with the dimension scales that are attached to it, of which no sample is read yet."""
    path = Path(where)
    titles: list[str] = []
    scales: list[Any] = []
    for number, size in enumerate(one.shape):
        along = one.dims[number]
        scale = along[0] if len(along) else None
        if not (isinstance(scale, h5py.Dataset) and scale.shape == (size,) and scale.dtype.kind in "iuf"):
            scale = None
        titles.append(printable(along.label) or ("" if scale is None else str(scale.name).rsplit("/", 1)[-1]))
        scales.append(scale)
    dimensions = dimension_names(titles)
    coordinates: dict[Hashable, Coordinate] = {
        name: Coordinate(read_dataset(path, scale, str(scale.name)), _attributes(scale))
        for name, scale in zip(dimensions, scales, strict=True)
        if scale is not None
    }
    name = str(one.name).rsplit("/", 1)[-1]
    samples = LazySamples.of(partial(_part_of, path, one), one.dtype, one.shape)
    return NamedArray(where, name, dimensions, samples, _attributes(one), coordinates)


def _part_of(path: Path, one: Any, index: tuple[int | slice, ...]) -> NDArray[Any]:
    check_stored(path, one, str(one.name))
    count = math.prod(one.shape[axis] if one_cut == slice(0, one.shape[axis]) else _length(one_cut)
                      for axis, one_cut in enumerate(index))  # fmt: skip
    # A chunk is unpacked as a whole.
    _memory.require((count + math.prod(one.chunks or (0,))) * one.dtype.itemsize, f"{one.name} of {path}")
    return np.asarray(one[index])


def _length(cut: int | slice) -> int:
    return 1 if isinstance(cut, int) else cut.stop - cut.start


def read(source: Source, name: str | None = None, step: int | None = None, resample: bool = False) -> Volume:
    """Read a dataset with three axes, those of size 1 aside: FILE:/dataset or `name`, else the only one.

    An attribute ``element_size_um`` (z, y, x) gives the spacing. Dimension scales, ``long_name``, ``units`` and packed
    numbers are those of the CF conventions; see `cf.NamedArray`. Of a dataset with a dimension of time as well, `step`
    is one of its steps, from 0 on.

    Raises InvalidInput where there is none or more than one, for links to other files, and for sizes beyond what is
    stored.
    """
    with h5py.File(checked(source), "r") as file:
        chosen = _chosen(source, file, name)
        one = named(source.path, chosen).at_step(step)
        return _told(source.path, chosen, one.read("hdf5", resample=resample))


def count_steps(source: Source, name: str | None = None) -> int:
    """Return the number of time steps of a dataset."""
    with h5py.File(checked(source), "r") as file:
        return named(source.path, _chosen(source, file, name)).steps


def _chosen(source: Source, file: Any, name: str | None) -> Any:
    """Return the dataset that is asked for, else the only volume."""
    path, wanted = source.path, source.inner or name
    # Where nothing is chosen, what is in other files is no reason to take what is in this one.
    known = [one for one in walk(path, file, strict=wanted is None) if _is_volume(one)]
    # FILE:/dataset leaves no choice.
    tell_names([] if source.inner else [str(one.name) for one in known])
    names = listed([f"{one.name} {one.shape}" for one in known])
    if wanted is not None:
        chosen = inside(path, file, wanted)
        if not isinstance(chosen, h5py.Dataset) or not _is_volume(chosen):
            found = f"no dataset {shown(wanted)} of real numbers with three axes"
            raise unreadable(path, found, f"one of: {names}" if known else "one")
        check_stored(path, chosen, str(chosen.name))
        return chosen
    if len(known) == 1:
        check_stored(path, known[0], str(known[0].name))
        return known[0]
    # The one with the most dimensions is meant more often than the first one.
    best = max(known, key=lambda one: (one.ndim, one.size), default=None)
    advice = f"choose one, {path.name}:{best.name}, or pass " + option_ref("name", "...") if best is not None else ""
    raise unreadable(path, f"{len(known)} datasets with three axes: {names}", "one of them", advice)


def _told(path: Path, chosen: Any, volume: Volume) -> Volume:
    """Return a volume with the place of its dataset, and with the spacing that an attribute of this states."""
    volume = replace(volume, details=volume.details | {"content": str(chosen.name)})
    size = attribute(chosen, "element_size_um")
    if size is None:
        return volume
    steps = floats(path, "element_size_um", size, 3)[::-1]
    if min(steps) <= 0:
        raise unreadable(path, f"element_size_um = {shown(size)}", "three numbers above 0")
    return replace(volume, spacing=triple("element_size_um", steps), units=("µm",) * 3)


def locate(source: Source, name: str | None = None, step: int | None = None) -> Volume:
    """Return what `read` reads without its samples, which any process with the same file reads."""
    with h5py.File(checked(source), "r") as file:
        chosen = _chosen(source, file, name)
        one = named(source.path, chosen).at_step(step)
        fetch = partial(_part, Path(os.path.abspath(source.path)), str(chosen.name))
        return _told(source.path, chosen, replace(one, samples=replace(one.samples, fetch=fetch)).volume("hdf5"))


def _part(path: Path, name: str, index: tuple[int | slice, ...]) -> NDArray[Any]:
    with Source(path, name) as source, h5py.File(seekable(source), "r") as file:
        one = inside(path, file, name)
        if not isinstance(one, h5py.Dataset) or one.ndim != len(index):
            raise unreadable(path, f"no dataset {shown(name)} any more", "the file as it was opened")
        return _part_of(path, one, index)
