"""Arrays whose dimensions have names, as the CF conventions describe them: of xarray, NetCDF, Zarr and HDF5."""

from __future__ import annotations

import base64
import binascii
import re
import struct
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import notices
from sheetsplat._checks import shown
from sheetsplat.io.axes import on_even_axes
from sheetsplat.io.checks import (
    Where,
    check_volume,
    chosen_step,
    floats,
    listed,
    printable,
    require_volume,
    unreadable,
)
from sheetsplat.io.records import Floats, Packing, Volume
from sheetsplat.io.stored import LazySamples
from sheetsplat.quantity import Axis, Quantity, time_text

# Names of dimensions along x, y and z of the world: those of the CF conventions and of common use.
_NAMES = (
    ("x", "lon", "longitude", "easting", "xc"),
    ("y", "lat", "latitude", "northing", "yc"),
    ("z", "lev", "level", "levels", "depth", "height", "altitude", "alt", "plev", "pressure", "isobaric", "zc"),
)
# Units in which a vertical coordinate counts downwards (CF conventions, section 4.3).
_PRESSURES = ("Pa", "hPa", "kPa", "mbar", "millibar", "bar", "dbar", "decibar")
_TIMES = ("time", "t", "step", "frame", "timestep", "date", "member")
#: Attributes that are read, of arrays and of coordinates.
READ = (
    *("scale_factor", "add_offset", "_FillValue", "missing_value", "_Unsigned"),
    *("units", "long_name", "standard_name", "axis", "positive", "coordinates", "calendar"),
)
# Times counted from a date (CF conventions, section 4.4): unit, date and clock; seconds in a unit; calendars, and the
# first day, that count as NumPy does.
_SINCE = re.compile(r"(\w+) since (\d{4}-\d\d-\d\d)(?:[ T](\d\d:\d\d(?::\d\d)?)\S*)?(?: .*)?")
_SECONDS = {
    "s": 1.0,
    "second": 1.0,
    "sec": 1.0,
    "minute": 60.0,
    "min": 60.0,
    "hour": 3600.0,
    "hr": 3600.0,
    "h": 3600.0,
    "day": 86400.0,
}
_CALENDARS = ("standard", "gregorian", "proleptic_gregorian")
_GREGORIAN = np.datetime64("1582-10-15", "ms")
_MOST_FILLS = 16
# How names of dimensions begin that have none.
_UNNAMED = "dim_"


def _text(attributes: Mapping[str, Any], *names: str) -> str:
    """Return the first of these attributes that is a text for figures, or ""."""
    return next((printable(attributes[name]) for name in names if printable(attributes.get(name))), "")


def _fill(told: Any, dtype: np.dtype[Any]) -> Any:
    """Return a fill value; Zarr 3 has those of floating-point numbers as the text of their eight bytes."""
    if isinstance(told, str) and dtype.kind == "f":
        try:
            return struct.unpack("<d", base64.b64decode(told, validate=True))[0]
        except (binascii.Error, struct.error):
            return told
    return told


def packing_of(where: Where, attributes: Mapping[str, Any], dtype: np.dtype[Any]) -> Packing:
    """Return how the numbers of an array become samples (CF conventions, sections 2.5.1 and 8.1).

    Raises InvalidInput for a scale or an offset that is no finite number, and a scale of 0.
    """
    scale, offset = (
        floats(where, name, attributes.get(name, default), 1)[0]
        for name, default in (("scale_factor", 1.0), ("add_offset", 0.0))
    )
    if scale == 0:
        raise unreadable(where, "scale_factor = 0", "another number")
    missing: list[float] = []
    for name in ("_FillValue", "missing_value"):
        told = _fill(attributes.get(name, ()), dtype)
        try:
            missing += [float(one) for one in np.asarray(told).reshape(-1)[:_MOST_FILLS]]
        except (TypeError, ValueError):
            raise unreadable(where, f"{name} = {shown(told)}", "numbers") from None
    unsigned = dtype.kind == "i" and str(attributes.get("_Unsigned", "")).lower() == "true"
    if unsigned:
        missing = [one % 2.0 ** (8 * dtype.itemsize) for one in missing]
    return Packing(scale, offset, tuple(dict.fromkeys(missing)), unsigned)


@dataclass(frozen=True)
class Coordinate:
    """The places of an array along a dimension.

    Attributes
    ----------
    numbers
        One for each place, as stored.
    attributes
        What is said of them.
    """

    numbers: NDArray[Any]
    attributes: Mapping[str, Any] = field(default_factory=dict)

    @property
    def is_date(self) -> bool:
        """Whether they are dates."""
        return self.numbers.dtype.kind in "mM"

    @property
    def counts_down(self) -> bool:
        """Whether larger numbers lie lower."""
        stated = str(self.attributes.get("positive", "")).lower()
        return stated == "down" or (not stated and str(self.attributes.get("units", "")) in _PRESSURES)

    def axis(self, name: Hashable) -> int | None:
        """Return which axis of the world, 0 to 2, a dimension runs along; None where its name does not say."""
        stated = str(self.attributes.get("axis", "")).lower()
        if stated in ("x", "y", "z"):
            return "xyz".index(stated)
        words = {str(name).lower(), str(self.attributes.get("standard_name", "")).lower()}
        return next((axis for axis, names in enumerate(_NAMES) if words.intersection(names)), None)

    def time_at(self, number: int, name: Hashable) -> str:
        """Return the time at one place as figures tell it, by the name of the dimension; "" where it is not known."""
        if not 0 <= number < self.numbers.size:
            return ""
        one, unit = self.numbers.reshape(-1)[number], _text(self.attributes, "units")
        if self.is_date:
            return _date_text(one)
        if one.dtype.kind not in "iuf" or not np.isfinite(one):
            return ""
        since = _SINCE.fullmatch(unit)
        if since is None:
            return time_text(float(one), unit, str(name))
        calendar = str(self.attributes.get("calendar", "standard")).lower()
        word = since[1].lower()
        seconds = _SECONDS.get(word, _SECONDS.get(word.removesuffix("s")))
        try:
            start = np.datetime64(f"{since[2]}T{since[3] or '00:00'}", "ms")
            if seconds is None or calendar not in _CALENDARS or start < _GREGORIAN:
                return time_text(float(one), since[1], str(name))
            return _date_text(start + np.timedelta64(round(1000.0 * seconds * float(one)), "ms"))
        except (ValueError, OverflowError):
            return time_text(float(one), since[1], str(name))

    def is_time(self, name: Hashable) -> bool:
        """Return whether a dimension is time, by its name, its attributes or the type of its places."""
        words = {str(name).lower(), str(self.attributes.get("standard_name", "")).lower()}
        return bool(words.intersection(_TIMES)) or str(self.attributes.get("axis", "")).upper() == "T" or self.is_date


def _date_text(one: Any) -> str:
    """Return a date and, of a duration, a number of seconds; "" for none."""
    if np.isnat(one):
        return ""
    if one.dtype.kind == "m":
        return time_text(float(one / np.timedelta64(1, "ms")) / 1000.0, "s")
    date, _, clock = str(one.astype("datetime64[s]")).partition("T")
    return f"{date} {clock.removesuffix(':00')}"


def dimension_names(names: Sequence[object]) -> tuple[str, ...]:
    """Return the names of dimensions, with others where there is none or one that is there already."""
    found: list[str] = []
    for number, name in enumerate(names):
        found.append(name if isinstance(name, str) and name and name not in found else f"{_UNNAMED}{number}")
    return tuple(found)


_UNKNOWN = Coordinate(np.empty(0))


@dataclass(frozen=True)
class NamedArray:
    """An array whose dimensions have names, of which no sample is read yet.

    Attributes
    ----------
    where, name
        The data, for messages, and what the array is called.
    dimensions
        Their names.
    samples
        All of it.
    attributes
        What is said of the samples.
    coordinates
        Of dimensions that have some.
    curved
        Names of coordinates that follow several dimensions: curvilinear ones.
    time
        When it is, where it is one of several times: "2020-01-01 06:00"; else empty.
    """

    where: Where
    name: str
    dimensions: tuple[Hashable, ...]
    samples: LazySamples
    attributes: Mapping[str, Any] = field(default_factory=dict)
    coordinates: Mapping[Hashable, Coordinate] = field(default_factory=dict)
    curved: tuple[str, ...] = ()
    time: str = ""

    def coordinate(self, name: Hashable) -> Coordinate:
        """Return the places along a dimension, and what is said of them."""
        return self.coordinates.get(name, _UNKNOWN)

    def time_axis(self) -> int | None:
        """Return the number of the dimension that is time; None where there is none, or no further ones.

        The first of four without a name counts as time, where each has several places.
        """
        if len(self.dimensions) <= 3:
            return None
        named = (at for at, name in enumerate(self.dimensions) if self.coordinate(name).is_time(name))
        sizes, first = self.samples.shape, str(self.dimensions[0])
        first_of_four = len(sizes) == 4 and min(sizes) > 1 and first.startswith(_UNNAMED)
        return next(named, 0 if first_of_four else None)

    @property
    def steps(self) -> int:
        """Number of time steps."""
        axis = self.time_axis()
        return 1 if axis is None else self.samples.shape[axis]

    def at_step(self, step: int | None) -> NamedArray:
        """Return the array at a time step, the only one unless given. InvalidInput where there are others."""
        number = chosen_step(self.where, self.steps, step)
        axis = self.time_axis()
        if axis is None or self.steps == 1:
            return self
        name = self.dimensions[axis]
        return replace(self._without({axis: number}), time=self.coordinate(name).time_at(number, name))

    def _without(self, chosen: Mapping[int, int]) -> NamedArray:
        """Return the array at one place along some dimensions, by their numbers."""
        index = list(self.samples.index)
        for axis, number in chosen.items():
            places = index[self.samples.order[axis]]
            assert isinstance(places, range)
            index[self.samples.order[axis]] = places[number]
        left = [at for at in range(len(self.dimensions)) if at not in chosen]
        samples = replace(self.samples, index=tuple(index), order=tuple(self.samples.order[at] for at in left))
        return replace(self, dimensions=tuple(self.dimensions[at] for at in left), samples=samples)

    def positions(self, name: Hashable, size: int) -> Floats | None:
        """Return the coordinates along a dimension; None where it has none."""
        one = self.coordinate(name)
        kind = one.numbers.dtype.kind
        if not one.numbers.size or (size == 1 and kind not in "biuf"):
            return None
        if kind not in "biuf" or one.numbers.shape != (size,):
            raise unreadable(
                self.where,
                f"coordinates of type {one.numbers.dtype} along {name}",
                "numbers, one for each place",
                f"choose one of them, .isel({name}=0), or give them numbers: .assign_coords({name}=range({size}))",
            )
        packing = replace(packing_of(self.where, one.attributes, one.numbers.dtype), missing=())
        places = packing.unpacked(one.numbers, self.where).astype(np.float64)
        return places

    def world_order(self) -> list[int]:
        """Return the numbers of the dimensions that run along x, y, z; [2, 1, 0] where their names do not say."""
        axes = [self.coordinate(name).axis(name) for name in self.dimensions]
        known = [axis for axis in axes if axis is not None]
        if len(known) < 2 or len(set(known)) < len(known):
            return [2, 1, 0]
        rest = ({0, 1, 2} - set(known)).pop() if len(known) == 2 else -1
        return [axes.index(axis if axis != rest else None) for axis in range(3)]

    def volume(self, file_format: str, *, resample: bool = False) -> Volume:
        """Return the array as a volume: three dimensions, those of size 1 aside.

        Dimensions that are named x, y, z, as longitude, latitude and height, or by an attribute ``axis`` are those of
        the world; any others are [k, j, i], as in arrays. One-dimensional coordinates give spacing and origin; a
        vertical one that counts downwards is negated, so that z is up. The long name and the units of the array, and
        the names and the units of its coordinates, become the quantity. The values are `LazySamples`, unless they are
        resampled.

        Parameters
        ----------
        file_format
            Of the volume.
        resample
            Interpolate to even coordinates.

        Raises
        ------
        InvalidInput
            For other numbers of dimensions, coordinates that are not numbers or do not rise or fall, and for uneven
            ones unless `resample` is true.
        """
        sizes, spare = self.samples.shape, len(self.dimensions) - 3
        single = [axis for axis, size in enumerate(sizes) if size == 1][: max(spare, 0)]
        made = self._without(dict.fromkeys(single, 0))
        if len(made.dimensions) != 3:
            larger = [name for name, size in zip(self.dimensions, sizes, strict=True) if size > 1]
            advice = f"choose one, for example .isel({larger[0]}=0)" if spare > 0 else ""
            if spare > 0 and isinstance(self.where, Path):
                advice = "open it with xarray, h5py or zarr, choose one, and pass that array"
            told = listed([f"{name} {size}" for name, size in zip(self.dimensions, sizes, strict=True)])
            raise unreadable(self.where, f"{len(sizes)} dimensions: {told}", "three dimensions", advice)
        return _placed(made, file_format, resample=resample)

    def read(self, file_format: str, *, resample: bool = False) -> Volume:
        """Return the array as `volume` does with its samples; OutOfMemory where they do not fit."""
        found = self.volume(file_format, resample=resample)
        values: Any = found.values
        if isinstance(values, LazySamples):
            require_volume(str(self.where), values.shape, values.dtype)
            found = replace(found, values=values.read())
        return found


def _placed(one: NamedArray, file_format: str, *, resample: bool) -> Volume:
    where = one.where
    check_volume(str(where), one.samples.shape, one.samples.dtype)
    packing = packing_of(where, one.attributes, one.samples.dtype)
    order = one.world_order()
    names = [one.dimensions[at] for at in order]
    told = [one.coordinate(name) for name in names]
    positions = [one.positions(name, one.samples.shape[at]) for name, at in zip(names, order, strict=True)]
    # A view that is turned upside down instead would show the data's mirror image: east in the west.
    down = positions[2] is not None and told[2].counts_down
    if positions[2] is not None and down:
        positions[2] = -positions[2]
    values: Any = one.samples.transpose(order[::-1])
    if resample:
        require_volume(str(where), values.shape, values.dtype)
        values, packing = packing.unpacked(values.read(), where), Packing(missing=packing.missing and (np.nan,))
    placed = on_even_axes(where, list(map(str, names)), positions, values, resample=resample)
    _tell_curved(one, names)
    units = [_text(along.attributes, "units") for along in told]
    axes: Sequence[Axis] = [
        Axis() if places is None else Axis(printable(str(name)), unit, sign)
        for name, unit, places, sign in zip(names, units, positions, (1.0, 1.0, -1.0 if down else 1.0), strict=True)
    ]
    name = _text(one.attributes, "long_name", "standard_name") or printable(one.name)
    has_names = not all(str(name).startswith(_UNNAMED) for name in names)
    details = {"content": name, "dimensions": ", ".join(map(str, names)) if has_names else "", **placed.details}
    return Volume(
        placed.values,
        placed.spacing,
        placed.origin,
        file_format,
        {key: text for key, text in details.items() if text},
        Quantity(
            name,
            _text(one.attributes, "units"),
            axes=tuple(axes) if any(axis.name for axis in axes) else (),
            time=printable(one.time),
        ),
        units=tuple(units),
        packing=packing,
    )


def _tell_curved(one: NamedArray, names: Sequence[Hashable]) -> None:
    """Warn of coordinates that follow several dimensions, which the lattice of the samples cannot."""
    if one.curved:
        along = listed([str(name) for name in names])
        notices.warn(f"{one.where}: the coordinates {listed(one.curved)} follow several dimensions and are not used; "
                     f"the samples are shown evenly along {along}; interpolate them to coordinates of one dimension "
                     "each to show them in their places")  # fmt: skip
