"""xarray's DataArrays and Datasets; what they say is read by `cf`."""

from __future__ import annotations

from collections.abc import Hashable
from functools import partial
from typing import Any

import numpy as np

from sheetsplat.errors import complain, option_ref
from sheetsplat.io.cf import Coordinate, NamedArray
from sheetsplat.io.checks import Where, listed
from sheetsplat.io.lazy_arrays import part_of
from sheetsplat.io.names import tell_names
from sheetsplat.io.records import Volume
from sheetsplat.io.stored import LazySamples

_FILLS = ("_FillValue", "missing_value")


def named(array: Any, where: Where) -> NamedArray:
    """Return a DataArray as an array of which no sample is read yet."""
    attributes = dict(array.attrs)
    if array.dtype.kind == "f" and any(name in array.encoding for name in _FILLS):
        # xarray has put NaN in the places of what was stored.
        attributes.setdefault("_FillValue", np.nan)
    along = {name: one for name, one in array.coords.items() if one.dims == (name,)}
    coordinates = {name: Coordinate(np.asarray(one.values), dict(one.attrs)) for name, one in along.items()}
    curved = [str(name) for name, one in array.coords.items() if one.ndim > 1]
    samples = LazySamples.of(partial(part_of, array), array.dtype, array.shape)
    alone = {name: one for name, one in array.coords.items() if not one.ndim}
    known = {name: Coordinate(np.asarray(one.values), dict(one.attrs)) for name, one in alone.items()}
    time = next((one.time_at(0, name) for name, one in known.items() if one.is_time(name)), "")
    name = "" if array.name is None else str(array.name)
    return NamedArray(where, name, tuple(array.dims), samples, attributes, coordinates, tuple(curved), time)


def read_array(array: Any, where: Where, resample: bool = False) -> Volume:
    """Return a DataArray with three dimensions, those of size 1 aside, as a volume; see `cf.NamedArray.volume`.

    Parameters
    ----------
    array
        The DataArray; what dask holds is computed.
    where
        Its name for messages.
    resample
        Interpolate to even coordinates.

    Raises
    ------
    InvalidInput
        As `cf.NamedArray.volume`.
    OutOfMemory
        Where the samples do not fit.
    """
    return named(array, where).read("xarray", resample=resample)


def time_axis(array: Any) -> Hashable | None:
    """Return the dimension of a DataArray that is time; None for none, and where there are three or fewer."""
    one = named(array, "the DataArray")
    axis = one.time_axis()
    return None if axis is None else one.dimensions[axis]


def variable(data: Any, where: Where, scalar: str | None = None) -> Any:
    """Return one variable of a Dataset: `scalar`, else the only one with three dimensions or more.

    Raises InvalidInput where there is none or more than one.
    """
    known = {str(name): name for name, one in data.data_vars.items() if one.ndim >= 3 and one.dtype.kind in "biuf"}
    names = tell_names(known)
    if scalar is None and len(names) == 1:
        (scalar,) = names
    if scalar not in known:
        what = f"{where} cannot be read" if scalar is None else f"the scalar {scalar!r} cannot be taken from {where}"
        if known:
            found = f"these variables with three dimensions: {listed(names)}"
            raise complain(what, found, "one of them", "pass " + option_ref("scalar", "..."), option="scalar")
        there = listed([f"{name} {dict(one.sizes)}" for name, one in data.data_vars.items()])
        raise complain(what, f"no variable of three dimensions, but {there or 'nothing'}", "one")
    return data[known[scalar]]


def read_set(data: Any, where: Where, scalar: str | None = None, resample: bool = False) -> Volume:
    """Return one variable of a Dataset as a volume, as `variable` chooses it and `read_array` reads it."""
    return read_array(variable(data, where, scalar), where, resample)
