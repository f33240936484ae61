"""Volumes in HDF5 files: one dataset with three axes, FILE:/group/dataset."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped, unused-ignore]
import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import shown, triple
from sheetsplat.errors import option_ref
from sheetsplat.io import vtk_hdf
from sheetsplat.io.checks import floats, listed, printable, unreadable
from sheetsplat.io.hdf5_access import attribute, check_stored, checked, inside, read_dataset, seekable, walk
from sheetsplat.io.records import Volume
from sheetsplat.io.source import Source
from sheetsplat.quantity import Quantity

_NETCDF_SUFFIXES = (".nc", ".nc4", ".cdf", ".netcdf")


def _is_volume(one: Any) -> bool:
    return one.ndim >= 3 and sum(size > 1 for size in one.shape) <= 3 and one.dtype.kind in "biuf"


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


def read(source: Source, name: str | None = None) -> Volume:
    """Read a dataset with three axes, those of size 1 aside: FILE:/dataset or `name`, else the only one.

    An attribute ``element_size_um`` (z, y, x) gives the spacing; ``long_name`` and ``units`` label the colour bar.

    Raises InvalidInput where there is none or more than one, for links to other files, and for sizes beyond what is
    stored.
    """
    with h5py.File(checked(source), "r") as file:
        chosen = _chosen(source, file, name)
        values = read_dataset(source.path, chosen, str(chosen.name))
        values = values.reshape([size for size in values.shape if size > 1] if values.ndim > 3 else values.shape)
        return _told(source.path, chosen, values.reshape((1,) * (3 - values.ndim) + values.shape))


def _chosen(source: Source, file: Any, name: str | None) -> Any:
    """Return the dataset that is asked for, else the only volume."""
    path, wanted = source.path, source.inner or name
    # Where nothing is chosen, what is in other files is no reason to take what is in this one.
    known = [one for one in walk(path, file, strict=wanted is None) if _is_volume(one)]
    names = listed([f"{one.name} {one.shape}" for one in known])
    if wanted is not None:
        chosen = inside(path, file, wanted)
        if not isinstance(chosen, h5py.Dataset) or not _is_volume(chosen):
            found = f"no dataset {shown(wanted)} of real numbers with three axes"
            raise unreadable(path, found, f"one of: {names}" if known else "one")
        return chosen
    if len(known) == 1:
        return known[0]
    advice = f"choose one, {path.name}:{known[0].name}, or pass " + option_ref("name", "...")
    raise unreadable(path, f"{len(known)} datasets with three axes: {names}", "one of them", advice)


def _told(path: Path, chosen: Any, values: NDArray[Any]) -> Volume:
    """Return samples as a volume, with what the attributes of the dataset say."""
    title = str(chosen.name).rsplit("/", 1)[-1]
    label = printable(attribute(chosen, "long_name")) or printable(title)
    quantity = Quantity(label, printable(attribute(chosen, "units")))
    size = attribute(chosen, "element_size_um")
    spacing = (1.0, 1.0, 1.0)
    if size is not None:
        steps = floats(path, "element_size_um", size, 3)[::-1]
        if min(steps) <= 0:
            raise unreadable(path, f"element_size_um = {shown(size)}", "three numbers above 0")
        spacing = triple("element_size_um", steps)
        quantity = Quantity(quantity.name, quantity.unit, "µm")
    return Volume(values, spacing, format="hdf5", details={"content": str(chosen.name)}, quantity=quantity)


def locate(source: Source, name: str | None = None) -> Volume:
    """Return what `read` reads without its samples: they stand for themselves by shape and type alone."""
    with h5py.File(checked(source), "r") as file:
        chosen = _chosen(source, file, name)
        check_stored(source.path, chosen, str(chosen.name))
        sizes = [size for size in chosen.shape if size > 1] if chosen.ndim > 3 else list(chosen.shape)
        shape = (1,) * (3 - len(sizes)) + tuple(sizes)
        return _told(source.path, chosen, np.broadcast_to(np.zeros((), chosen.dtype), shape))


def read_part(source: Source, name: str, box: tuple[tuple[int, int], ...]) -> NDArray[Any]:
    """Return the samples of a box, ((k0, k1), (j0, j1), (i0, i1)), of a dataset."""
    with h5py.File(seekable(source), "r") as file:
        one = inside(source.path, file, name)
        if not isinstance(one, h5py.Dataset) or not _is_volume(one):
            raise unreadable(source.path, f"no dataset {shown(name)} any more", "the file as it was opened")
        check_stored(source.path, one, name)
        count = math.prod(last - first for first, last in box)
        _memory.require((count + math.prod(one.chunks or (0,))) * one.dtype.itemsize, f"a brick of {source.path}")
        # Axes of one sample stand beside the three; a volume may have axes of one sample itself.
        spare, cuts = one.ndim - 3, [slice(first, last) for first, last in box]
        if spare <= 0:
            return np.asarray(one[tuple(cuts[-one.ndim :])])
        large = [axis for axis, size in enumerate(one.shape) if size > 1]
        index: list[Any] = [0] * one.ndim
        for axis, cut in zip(large, cuts[3 - len(large) :], strict=True):
            index[axis] = cut
        found = np.asarray(one[tuple(index)])
        return found.reshape((1,) * (3 - found.ndim) + found.shape)
