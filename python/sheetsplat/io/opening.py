"""Fields of files: regular volumes and scattered data, each with the options that belong to it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from sheetsplat import _memory
from sheetsplat.errors import complain, option_refs
from sheetsplat.fields import EllipsoidField, RegularField
from sheetsplat.io.scattered import Scattered, field_of, logarithm, read_scattered
from sheetsplat.io.volume import SCATTERED, Volume, find_format, read_volume

# Options by what they make sense for; what is in none of these is for both.
REGULAR = ("shape", "dtype", "offset", "name", "spacing", "origin", "lattice", "radius", "prefilter", "nan")
SCATTERED_ONLY = ("grid", "particles", "support", "fit", "neighbors", "min_scale")
_POINTS = ("grid", "scalar", "particles", "support")
_ELLIPSOIDS = ("fit", "neighbors", "normalization", "w0", "falloff", "min_scale")
_SAMPLES = ("spacing", "origin", "lattice", "radius", "falloff", "normalization", "w0", "prefilter", "nan")
_READING = ("shape", "dtype", "offset", "name")


def _refuse(path: str | os.PathLike[str], options: Mapping[str, Any], names: tuple[str, ...], what: str) -> None:
    wrong = [name for name in names if name in options]
    if wrong:
        raise complain(
            f"{path} cannot be opened with these options",
            option_refs(wrong) + f" for {what}",
            "only options that its format uses",
            "leave them out",
            option=wrong[0] if len(wrong) == 1 else None,
        )


def kind_of(path: str | os.PathLike[str], options: Mapping[str, Any]) -> str:
    """Return a file's format, "plot3d" where a grid is given; InvalidInput for options that do not belong to it."""
    if options.get("grid") is not None:
        found = "plot3d"
    else:
        raw = any(name in options for name in ("shape", "dtype"))
        found = find_format(path, raw_options=raw, name=options.get("name"))
    if found in SCATTERED:
        _refuse(path, options, REGULAR, f"scattered data ({found})")
    else:
        _refuse(path, options, SCATTERED_ONLY, f"a regular volume ({found})")
        if found != "vti":
            _refuse(path, options, ("scalar",), f"a volume of format {found}")
        elif "scalar" in options and "name" in options:
            raise complain(
                f"{path} cannot be opened with these options", option_refs(("scalar", "name")), "one of them"
            )
    return found


def read_regular(path: str | os.PathLike[str], options: Mapping[str, Any]) -> Volume:
    """Return the volume of a file; with `log` its samples are logarithms, float32 unless they were wider."""
    reading = {name: options[name] for name in _READING if name in options}
    if "scalar" in options:
        reading["name"] = options["scalar"]
    volume = read_volume(path, **reading)
    floor = options.get("log", False)
    if floor is False:
        return volume
    if volume.values.dtype.kind not in "biuf":
        return volume
    _memory.require(3 * 8 * volume.values.size, f"the logarithms of {path}")
    what = volume.details.get("content", "the samples")
    values = logarithm(volume.values.astype(np.float64), what, floor)
    narrow = volume.values.dtype.itemsize <= 4
    shown = values.astype(np.float32) if narrow else values
    return Volume(shown, volume.spacing, volume.origin, volume.format, volume.details)


def open_scattered(path: str | os.PathLike[str], options: Mapping[str, Any]) -> tuple[Scattered, EllipsoidField]:
    """Return what a file of scattered data holds, and the field of it; `options` as for `open_field`."""
    data = read_scattered(path, **{name: options[name] for name in _POINTS if name in options})
    given = {name: options[name] for name in _ELLIPSOIDS if name in options}
    return data, field_of(data, logarithmic=options.get("log", False), **given)


def open_field(path: str | os.PathLike[str], options: Mapping[str, Any]) -> RegularField | EllipsoidField:
    """Return the field of a file; `options` are those of `sheetsplat.open` that somebody gave."""
    if kind_of(path, options) in SCATTERED:
        return open_scattered(path, options)[1]
    volume = read_regular(path, options)
    placed = {"spacing": volume.spacing, "origin": volume.origin}
    return RegularField(volume.values, **{**placed, **{name: options[name] for name in _SAMPLES if name in options}})
