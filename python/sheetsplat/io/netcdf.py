"""NetCDF files: classic ones through SciPy, those of version 4 through h5netcdf, both as xarray's Datasets."""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

import h5py  # type: ignore[import-untyped, unused-ignore]
import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat.io.hdf5_access import checked, walk
from sheetsplat.io.names import tell_names
from sheetsplat.io.records import Volume
from sheetsplat.io.source import Source
from sheetsplat.io.xarray_data import named, variable


def _classic(source: Source) -> Any:
    """Return what xarray reads a classic file from: the file, or its bytes where it is packed."""
    if not source.packed:
        from sheetsplat.io.netcdf_classic import ClassicStore

        return ClassicStore(source)
    # Its length is known before memory is taken.
    size = source.length(_memory.available())
    return io.BytesIO(source.payload("raw").array(np.dtype(np.uint8), size).tobytes())


@contextlib.contextmanager
def opened(source: Source, name: str | None) -> Iterator[Any]:
    """Yield a variable as a DataArray: FILE:/group/variable or `name`, else the only one; links are checked."""
    import xarray  # type: ignore[import-not-found, unused-ignore]

    # Times stay numbers, with their units, and packed numbers what they are: `cf` unpacks those of every format.
    options: dict[str, Any] = {"decode_times": False, "mask_and_scale": False}
    group = ""
    if source.inner:
        place = PurePosixPath(source.inner)
        group, name = str(place.parent).strip("/"), place.name
    if source.head(3) == b"CDF":
        file_or_bytes, engine = _classic(source), "scipy" if source.packed else None
    else:
        import h5netcdf  # type: ignore[import-not-found, import-untyped, unused-ignore]  # noqa: F401

        file_or_bytes, engine = checked(source), "h5netcdf"
        with h5py.File(file_or_bytes, "r") as file:
            # h5netcdf follows links.
            walk(source.path, file, strict=True)
        options |= {"group": group or None, "phony_dims": "access"}
    if source.inner:
        # FILE:/variable leaves no choice.
        tell_names([])
    with xarray.open_dataset(file_or_bytes, engine=engine, **options) as data:
        yield variable(data, source.path, name)


def count_steps(source: Source, name: str | None = None) -> int:
    """Return the number of time steps of a variable."""
    with opened(source, name) as array:
        return named(array, source.path).steps


def read(source: Source, name: str | None = None, resample: bool = False, step: int | None = None) -> Volume:
    """Read a variable with three dimensions: FILE:/group/variable or `name`, else the only one.

    Of a variable with times as well, `step` is one of them. Coordinates, names, units, packed numbers and missing ones
    are those of the CF conventions; see `cf.NamedArray`.

    Raises InvalidInput where there is no variable or more than one, for several times without `step`, for uneven
    coordinates unless `resample` is true, and for links to other files.
    """
    with opened(source, name) as array:
        return named(array, source.path).at_step(step).read("netcdf", resample=resample)


def locate(source: Source, name: str | None = None, step: int | None = None) -> Volume:
    """Return what `read` reads without its samples, which any process with the same file reads."""
    with opened(source, name) as array:
        one = named(array, source.path).at_step(step)
    fetch = partial(_part, Path(os.path.abspath(source.path)), source.inner, name)
    return replace(one, samples=replace(one.samples, fetch=fetch)).volume("netcdf")


def _part(path: Path, inner: str, name: str | None, index: tuple[int | slice, ...]) -> NDArray[Any]:
    with Source(path, inner) as source, opened(source, name) as array:
        return np.asarray(array[index].values)
