"""xarray's DataArrays and Datasets: dimensions, coordinates, names and units."""

from __future__ import annotations

import logging
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sheetsplat.errors import complain, option_ref
from sheetsplat.io.axes import on_even_axes
from sheetsplat.io.checks import Where, chosen_step, listed, printable, unreadable
from sheetsplat.io.lazy_arrays import check_volume, require_volume
from sheetsplat.io.records import Floats, Volume
from sheetsplat.quantity import Axis, Quantity

# Names of dimensions along x, y and z of the world: those of the CF conventions and of common use.
_NAMES = (
    ("x", "lon", "longitude", "easting", "xc"),
    ("y", "lat", "latitude", "northing", "yc"),
    ("z", "lev", "level", "levels", "depth", "height", "altitude", "alt", "plev", "pressure", "isobaric", "zc"),
)
# Units in which a vertical coordinate counts downwards (CF conventions, section 4.3).
_PRESSURES = ("Pa", "hPa", "kPa", "mbar", "millibar", "bar", "dbar", "decibar")

_TIMES = ("time", "t", "step", "frame", "timestep", "date", "member")

_log = logging.getLogger("sheetsplat")


def _text(attributes: Any, *names: str) -> str:
    """Return the first of these attributes that is a text for figures, or ""."""
    return next((printable(attributes[name]) for name in names if printable(attributes.get(name))), "")


def _axis_of(name: Hashable, attributes: Any) -> int | None:
    """Return which axis of the world, 0 to 2, a dimension runs along; None where its name does not say."""
    stated = str(attributes.get("axis", "")).lower()
    if stated in ("x", "y", "z"):
        return "xyz".index(stated)
    words = {str(name).lower(), str(attributes.get("standard_name", "")).lower()}
    return next((axis for axis, names in enumerate(_NAMES) if words.intersection(names)), None)


def _world_order(dimensions: Sequence[Hashable], attributes: Sequence[Any]) -> list[int]:
    """Return the positions of the dimensions that run along x, y, z; [2, 1, 0] where their names do not say."""
    axes = [_axis_of(name, one) for name, one in zip(dimensions, attributes, strict=True)]
    known = [axis for axis in axes if axis is not None]
    if len(known) < 2 or len(set(known)) < len(known):
        return [2, 1, 0]
    rest = ({0, 1, 2} - set(known)).pop() if len(known) == 2 else -1
    return [axes.index(axis if axis != rest else None) for axis in range(3)]


def _positions(where: Where, array: Any, name: Hashable, size: int) -> Floats | None:
    """Return the coordinates of a dimension; None where it has none."""
    if name not in array.coords or array.coords[name].ndim != 1:
        return None
    numbers = np.asarray(array.coords[name].values)
    if size == 1 and numbers.dtype.kind not in "biuf":
        return None
    if numbers.dtype.kind not in "biuf":
        raise unreadable(
            where,
            f"coordinates of type {numbers.dtype} along {name}",
            "numbers",
            f"choose one of them, .isel({name}=0), or give them numbers: .assign_coords({name}=range({size}))",
        )
    return numbers.astype(np.float64)


def _upside_down(attributes: Any) -> bool:
    stated = str(attributes.get("positive", "")).lower()
    return stated == "down" or (not stated and str(attributes.get("units", "")) in _PRESSURES)


def read_array(array: Any, where: Where, resample: bool = False) -> Volume:
    """Return a DataArray with three dimensions, those of size 1 aside, as a volume.

    Dimensions that are named x, y, z, as longitude, latitude and height, or by an attribute ``axis`` are those of the
    world; any others are [k, j, i], as in arrays. One-dimensional coordinates give spacing and origin; a vertical one
    that counts downwards is negated, so that z is up. The long name and the units of the array, and the names and the
    units of its coordinates, become the quantity.

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
        For other numbers of dimensions, coordinates that are not numbers or do not rise or fall, and for uneven ones
        unless `resample` is true.
    OutOfMemory
        Where the samples do not fit.
    """
    found = placed(array, where)
    require_volume(str(where), found.array.shape, found.array.dtype)
    return found.volume(where, found.array.values, resample=resample)


@dataclass(frozen=True)
class PlacedArray:
    """A DataArray with the axes z, y, x of the world, of which no sample is read yet.

    Attributes
    ----------
    array
        The DataArray.
    names, attributes, positions
        Names, attributes and places of the dimensions along x, y, z: their coordinates, negated where these count
        downwards; None: without coordinates.
    """

    array: Any
    names: tuple[Hashable, ...]
    attributes: tuple[Any, ...]
    positions: tuple[Floats | None, ...]

    @property
    def falling(self) -> tuple[bool, ...]:
        """Whether places fall, along z, y, x."""
        return tuple(one is not None and one.size > 1 and bool(one[0] > one[-1]) for one in reversed(self.positions))

    def volume(self, where: Where, values: Any, *, resample: bool = False) -> Volume:
        """Return samples of this array, [k, j, i] in the order of its axes, as a volume."""
        names, attributes = self.names, self.attributes
        placed = on_even_axes(where, list(map(str, names)), self.positions, values, resample=resample)
        units = [_text(one, "units") for one in attributes]
        same = units[0] if len(set(units)) == 1 else ""
        signs = (1.0, 1.0, -1.0 if _upside_down(attributes[2]) else 1.0)
        axes = tuple(
            Axis() if places is None else Axis(printable(str(one)), unit, sign)
            for one, unit, places, sign in zip(names, units, self.positions, signs, strict=True)
        )
        name = _text(self.array.attrs, "long_name", "standard_name") or printable(self.array.name)
        details = {"content": name, "dimensions": ", ".join(map(str, names)), **placed.details}
        return Volume(
            placed.values,
            placed.spacing,
            placed.origin,
            "xarray",
            {key: text for key, text in details.items() if text},
            Quantity(name, _text(self.array.attrs, "units"), same, axes=axes if any(one.name for one in axes) else ()),
        )


def placed(array: Any, where: Where) -> PlacedArray:
    """Return a DataArray with three dimensions, those of size 1 aside, in the order of the world; no sample is read.

    Raises InvalidInput as `read_array`, but not for uneven coordinates.
    """
    if array.ndim > 3:
        array = array.squeeze([name for name, size in array.sizes.items() if size == 1][: array.ndim - 3])
    if array.ndim != 3:
        larger = [name for name, size in array.sizes.items() if size > 1]
        advice = f"choose one, for example .isel({larger[0]}=0)" if array.ndim > 3 else ""
        sizes = listed([f"{name} {size}" for name, size in array.sizes.items()])
        raise unreadable(where, f"{array.ndim} dimensions: {sizes}", "three dimensions", advice)
    check_volume(str(where), array.shape, array.dtype)
    told = [array.coords[name].attrs if name in array.coords else {} for name in array.dims]
    order = _world_order(array.dims, told)
    names = tuple(array.dims[at] for at in order)
    attributes = tuple(told[at] for at in order)
    along_x, along_y, along_z = (_positions(where, array, name, array.sizes[name]) for name in names)
    # A view that is turned upside down instead would show the data's mirror image: east in the west.
    if along_z is not None and _upside_down(attributes[2]):
        along_z = -along_z
    return PlacedArray(array.transpose(*reversed(names)), names, attributes, (along_x, along_y, along_z))


def time_axis(array: Any) -> Hashable | None:
    """Return the dimension that is time, by the name, the attributes or the type of its coordinate; None for none."""
    for name in array.dims:
        coordinate = array.coords[name] if name in array.coords else None
        told = {} if coordinate is None else coordinate.attrs
        words = {str(name).lower(), str(told.get("standard_name", "")).lower()}
        is_date = coordinate is not None and np.asarray(coordinate.values).dtype.kind in "mM"
        if words.intersection(_TIMES) or str(told.get("axis", "")).upper() == "T" or is_date:
            found: Hashable = name
            return found
    return None


def steps_of(array: Any) -> int:
    """Return the number of time steps of a DataArray with more than three dimensions; 1 for others."""
    axis = time_axis(array) if array.ndim > 3 else None
    return 1 if axis is None else int(array.sizes[axis])


def one_step(array: Any, where: Where, step: int | None) -> Any:
    """Return a DataArray at one time step; the only one unless given. InvalidInput where there are others."""
    count = steps_of(array)
    number = chosen_step(where, count, step)
    return array if count == 1 else array.isel({time_axis(array): number})


def variable(data: Any, where: Where, scalar: str | None = None) -> Any:
    """Return one variable of a Dataset: `scalar`, else the only one with three dimensions or more.

    Raises InvalidInput where there is none or more than one.
    """
    known = {str(name): name for name, one in data.data_vars.items() if one.ndim >= 3 and one.dtype.kind in "biuf"}
    if scalar is None and len(known) == 1:
        (scalar,) = known
    if scalar not in known:
        what = f"{where} cannot be read" if scalar is None else f"the scalar {scalar!r} cannot be taken from {where}"
        if known:
            found = f"these variables with three dimensions: {listed(list(known))}"
            raise complain(what, found, "one of them", "pass " + option_ref("scalar", "..."), option="scalar")
        there = listed([f"{name} {dict(one.sizes)}" for name, one in data.data_vars.items()])
        raise complain(what, f"no variable of three dimensions, but {there or 'nothing'}", "one")
    return data[known[scalar]]


def read_set(data: Any, where: Where, scalar: str | None = None, resample: bool = False) -> Volume:
    """Return one variable of a Dataset as a volume, as `variable` chooses it and `read_array` reads it."""
    return read_array(variable(data, where, scalar), where, resample)
