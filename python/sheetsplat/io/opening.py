"""Files to fields: choice of the reader, and the options of each format."""

from __future__ import annotations

import os
import pkgutil
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from sheetsplat import _memory
from sheetsplat._checks import is_off, shown
from sheetsplat.errors import Error, about_option, complain, option_ref, option_refs
from sheetsplat.fields import EllipsoidField, Field, NanPolicy, RegularField
from sheetsplat.fields.labelled import with_labels
from sheetsplat.io.axes import placement, settled, tell_units
from sheetsplat.io.channels import only, several_channels
from sheetsplat.io.checks import Where, printable, unreadable
from sheetsplat.io.formats import FORMATS, SCATTERED, Format, find_format, format_of
from sheetsplat.io.kernels import field_of, given, log_base, logarithm
from sheetsplat.io.names import Names, names_in
from sheetsplat.io.records import Scattered, Volume
from sheetsplat.io.source import opened

# Options of regular volumes alone, and of scattered data alone.
REGULAR = (
    *("shape", "dtype", "offset", "name", "resample", "spacing", "origin", "lattice", "radius", "prefilter"),
    *("boundary", "axes", "labels"),
)
SCATTERED_ONLY = ("grid", "particles", "support", "fit", "neighbors", "min_scale", "periodic")
_POINTS = ("grid", "scalar", "particles", "support", "step", "nan")
_ELLIPSOIDS = ("fit", "neighbors", "normalization", "w0", "falloff", "min_scale", "base", "periodic")
_SAMPLES = ("lattice", "radius", "falloff", "normalization", "w0", "prefilter", "nan", "boundary", "base", "labels")
_RAW = ("shape", "dtype", "offset", "name", "resample", "step")
#: Options that say how data are read.
READING = (*_RAW, *(name for name in _POINTS if name != "nan"))
_SWITCHED = ("offset", "resample")
# The number in a header is not trusted.
_MOST_STEPS = 100_000
# Bytes of files that are read for the names of their arrays.
_MOST_READ = 100_000_000


def read_volume(
    path: str | os.PathLike[str],
    *,
    shape: tuple[int, int, int] | None = None,
    dtype: DTypeLike | None = None,
    offset: int = 0,
    name: str | None = None,
    resample: bool = False,
    step: int | None = None,
) -> Volume:
    """Read a volume; the format is found by content, then by suffix, and gzipped files are decompressed.

    Parameters
    ----------
    path
        A file of a format in `formats.LISTED_REGULAR`; headers of NRRD and MetaImage may name files of samples.
    shape, dtype
        For raw samples: (nk, nj, ni), the order of the array, and their type, with its byte order (">i2").
    offset
        For raw samples: bytes before the first one.
    name
        The array to take, where the file has several. For .vti: the array, one column of one (NAME_x), or the length of
        a vector; the file's own scalars unless given. For DICOM the series, for OME-Zarr the channel.
    resample
        For formats with coordinates: interpolate samples at uneven ones.
    step
        The time step to take of a file with several, from 0 on.

    Raises
    ------
    InvalidInput
        For files that are damaged, whose size is not that of their header, or that hold no real volume with three axes,
        and for several channels of which none is chosen.
    OutOfMemory
        Where the samples do not fit.
    Error
        Where the file cannot be read.

    Examples
    --------
    >>> np.save("cube.npy", values)
    >>> ss.io.read_volume("cube.npy").values.shape
    (8, 8, 8)
    """
    options = {"shape": shape, "dtype": dtype, "offset": offset, "name": name, "resample": resample, "step": step}
    return only(Path(path), read_volumes(path, options))


def read_volumes(path: str | os.PathLike[str], options: Mapping[str, Any]) -> list[Volume]:
    """Return all channels of a volume, or the one that is chosen; `options` as for `read_volume`, which raises."""
    options = given(**{name: None if name in _SWITCHED and is_off(one) else one for name, one in options.items()})
    with opened(path) as source:
        found = format_of(source, raw_options="shape" in options or "dtype" in options)
        if found.scattered:
            advice = "open it with sheetsplat.open, which converts it to ellipsoids"
            what, wrong = f"{path} cannot be read as a volume", f"scattered data ({found.name})"
            raise complain(what, wrong, "a regular volume", advice)
        _refuse_others(path, found, options)
        read: Volume | list[Volume] = found.read(source, **options)
        volumes = read if isinstance(read, list) else [read]
    return [settled(str(path), one) for one in volumes]


def read_scattered(
    path: str | os.PathLike[str],
    *,
    grid: str | os.PathLike[str] | None = None,
    scalar: str | None = None,
    particles: str | None = None,
    support: float | None = None,
    step: int | None = None,
    nan: NanPolicy = "error",
) -> Scattered:
    r"""Read scattered data; the format is found by content, then by suffix, and gzipped files are decompressed.

    Parameters
    ----------
    path
        A file of a format in `formats.LISTED_SCATTERED`; a PLOT3D solution where `grid` is given.
    grid
        The PLOT3D grid of the solution.
    scalar
        What is shown: a name that the format has; see the readers.
    particles
        For HDF5: the group, PartType0 unless given.
    support
        For HDF5: radius of the kernels' supports in smoothing lengths; found by the densities unless given.
    step
        The time step to take of a file with several, from 0 on.
    nan
        What a row is whose position, scalar, size, rotation or weight is not finite: "error", or "skip", which leaves
        it out, with a `PictureWarning`.

    Raises
    ------
    InvalidInput
        For files that are damaged or hold something else, for numbers that are not finite unless these rows are left
        out, and options that do not belong to their format.
    OutOfMemory
        Where the numbers do not fit.
    Error
        Where a file cannot be read.

    Examples
    --------
    >>> with open("points.csv", "w") as file:
    ...     written = file.write("x,y,z,radius,value\n0,0,0,1,0.5\n2,0,0,1,1\n")
    >>> ss.io.read_scattered("points.csv").points.shape
    (2, 3)
    """
    found = find_format(path, raw_options=False, name=None, grid=grid is not None)
    if not found.scattered:
        raise unreadable(Path(path), f"a file of format {found.name}", "scattered data: " + ", ".join(SCATTERED))
    options = given(grid=grid, scalar=scalar, particles=particles, support=support, step=step)
    _refuse_others(path, found, options)
    with opened(path) as source, np.errstate(all="ignore"):
        data: Scattered = found.read(source, **options)
        return data.usable(path, nan)


def _refuse(path: Where | os.PathLike[str], options: Mapping[str, Any], names: Iterable[str], what: str) -> None:
    wrong = [name for name in names if name in options]
    if wrong:
        alone = wrong[0] if len(wrong) == 1 else None
        takers = ", ".join(one.shown for one in FORMATS if set(wrong) <= set(one.options))
        wanted = f"{'it' if alone else 'them'} only for {takers}" if takers else "only options that its format uses"
        failed = f"{path} cannot be opened with these options"
        raise complain(failed, option_refs(wrong) + f" for {what}", wanted, "leave them out", option=alone)


def _refuse_others(path: Where | os.PathLike[str], found: Format, options: Mapping[str, Any]) -> None:
    """Raise InvalidInput for options that a format does not take."""
    others = [name for name in options if name not in found.options]
    _refuse(path, options, others, f"a file of format {found.name}")


def refused_for(where: Where, record: Volume | Scattered, options: Mapping[str, Any]) -> None:
    """Raise InvalidInput for options of fields that do not belong to what was read."""
    if isinstance(record, Scattered):
        _refuse(where, options, REGULAR, "scattered data")
    else:
        _refuse(where, options, SCATTERED_ONLY, "a regular volume")


def kind_of(path: str | os.PathLike[str], options: Mapping[str, Any]) -> Format:
    """Return a file's format, PLOT3D where a grid is given; InvalidInput for options that do not belong to it."""
    raw = any(name in options for name in ("shape", "dtype"))
    grid = options.get("grid") is not None
    found = find_format(path, raw_options=raw, name=options.get("name"), grid=grid)
    _refuse_others(path, found, {name: None for name in ("step",) if name in options})
    if found.scattered:
        _refuse(path, options, REGULAR, f"scattered data ({found.name})")
    else:
        _refuse(path, options, SCATTERED_ONLY, f"a regular volume ({found.name})")
        if "name" not in found.options:
            _refuse(path, options, ("scalar",), f"a volume of format {found.name}")
        elif "scalar" in options and "name" in options:
            raise complain(
                f"{path} cannot be opened with these options", option_refs(("scalar", "name")), "one of them"
            )
    return found


def read_regular(path: str | os.PathLike[str], options: Mapping[str, Any]) -> list[Volume]:
    """Return the channels of a file, of most the only one.

    With `log` their samples are logarithms, float32 unless the file's are wider.
    """
    reading = {name: options[name] for name in _RAW if name in options}
    if "scalar" in options:
        reading["name"] = options["scalar"]
    try:
        volumes = read_volumes(path, reading)
    except Error as error:
        if "scalar" not in options:
            raise
        raise about_option(error, "name", "scalar") from error
    return [_in_decades(one, options.get("log", False), str(path)) for one in volumes]


def _in_decades(volume: Volume, log: bool | float, where: str) -> Volume:
    """Return a volume whose samples are logarithms, float32 unless they were wider; itself where `log` is False."""
    if log is False:
        return volume
    if volume.values.ndim > 3:
        raise complain(f"{where} cannot be shown in decades", "colours", "values", "leave out " + option_ref("log"))
    _memory.require(3 * 8 * volume.values.size, f"the logarithms of {where}")
    what = volume.details.get("content", "the samples")
    values = logarithm(volume.values.astype(np.float64), what, log)
    kept = values.astype(np.float32) if volume.values.dtype.itemsize <= 4 else values
    floor = log_base(volume.values, what, log) if values.size else None
    return replace(volume, values=kept, quantity=replace(volume.quantity, floor=floor))


def arrays(path: str | os.PathLike[str], options: Mapping[str, Any] | None = None) -> Names:
    """Return the names of the arrays of a file among which ``name=``, or of scattered data ``scalar=``, chooses.

    No samples are read, but for Gmsh, MED, XDMF, .ply and .npz with an array "centers", which are read once where they
    are at most 100 MB. Channels, which are shown together, are no arrays to choose among.

    Parameters
    ----------
    path
        A file, or FILE:/part, which leaves no choice where the part is one array.
    options
        Those of `sheetsplat.open` that say how the file is read.

    Raises
    ------
    InvalidInput
        As reading it.
    Error
        Where the file cannot be read.

    Examples
    --------
    >>> np.savez("two.npz", density=values, speed=values)
    >>> ss.io.arrays("two.npz").names
    ('density', 'speed')
    """
    reading = {name: one for name, one in (options or {}).items() if name not in ("name", "scalar")}
    found = kind_of(path, reading)
    chosen = {name: reading[name] for name in found.options if name in reading}
    with opened(path) as source, warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        if not found.names or (found.names == "data" and source.path.stat().st_size > _MOST_READ):
            return Names()
        return names_in(partial(found.read, source, **chosen))


def time_steps(path: str | os.PathLike[str], options: Mapping[str, Any]) -> list[tuple[Path, dict[str, Any]]]:
    """Return a path and further options for each time step of a file; itself where it has one.

    `options` are those of `open_field`; where they choose a step, that is all.
    """
    alone: list[tuple[Path, dict[str, Any]]] = [(Path(path), {})]
    if options.get("step") is not None:
        return alone
    found = kind_of(path, options)
    if not found.steps:
        return alone
    with opened(path) as source:
        steps: int | list[Path] = pkgutil.resolve_name(found.steps)(source, options.get("scalar", options.get("name")))
    if isinstance(steps, int):
        if steps > _MOST_STEPS:
            raise unreadable(Path(path), f"{steps} time steps", f"at most {_MOST_STEPS}")
        return [(Path(path), {"step": number}) for number in range(steps)] if steps > 1 else alone
    return [(one, {}) for one in steps] or alone


def open_scattered(path: str | os.PathLike[str], options: Mapping[str, Any]) -> tuple[Scattered, EllipsoidField]:
    """Return what a file of scattered data holds, and the field of it; `options` as for `open_field`."""
    data = read_scattered(path, **{name: options[name] for name in _POINTS if name in options})
    return data, _of_scattered(data, options)


def rows_of(path: str | os.PathLike[str], options: Mapping[str, Any]) -> NDArray[np.int64] | None:
    """Return which rows of a file of scattered data its field has; None: all. `options` as for `open_field`."""
    with warnings.catch_warnings():
        # What is left out is told when the field is opened.
        warnings.simplefilter("ignore")
        return read_scattered(path, **{name: options[name] for name in _POINTS if name in options}).rows


def _of_scattered(data: Scattered, options: Mapping[str, Any]) -> EllipsoidField:
    chosen = {name: options[name] for name in _ELLIPSOIDS if name in options}
    log = options.get("log", False)
    if data.made is not None and not chosen and log is False:
        return data.made
    floor = log_base(data.values, data.scalar, log) if log is not False and data.values.size else None
    field = field_of(data, logarithmic=log, **chosen)
    name = printable(data.scalar)
    return field.with_quantity(name=name, unit=data.unit, length_unit=data.length_unit, floor=floor)


def _of_volume(volume: Volume, options: Mapping[str, Any]) -> RegularField:
    if "spacing" not in options:
        tell_units(volume.quantity, volume.values.shape, volume.spacing)
    chosen = placement(volume, options)
    if volume.packing.missing and np.isnan(volume.values).any():
        chosen["nan"] = "skip"
    chosen |= {name: options[name] for name in _SAMPLES if name in options}
    field = RegularField(volume.values, **labelled_options(volume, chosen))
    if field.labels and not isinstance(volume.labels, bool):
        field = field.with_label_colors(volume.labels)
    quantity, channel = volume.quantity, volume.channel
    quantity = replace(quantity, name=quantity.name or channel.name)
    window = channel.window if channel.color is not None and quantity.floor is None else None
    field = field.with_color(channel.color if field.has_values else None, window)
    field = field.with_quantity_of_samples(quantity, volume.spacing, volume.origin, "cartesian")
    return field.with_orientation(volume.orientation)


def labelled_options(volume: Volume, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return options of the field of a volume that say whether its samples are labels, where the caller did not."""
    if volume.channel.color is not None and volume.labels is False:
        # Beside others a channel is measured, whatever its numbers look like.
        options = {"labels": False, **options}
    return with_labels(volume.values, options, stated=volume.labels is not False)


def field_of_record(
    record: Volume | Scattered, options: Mapping[str, Any], where: str
) -> RegularField | EllipsoidField:
    """Return the field of data that were read; `options` are those of `sheetsplat.open` that the caller gave."""
    if isinstance(record, Scattered):
        return _of_scattered(record, options)
    return _of_volume(_in_decades(settled(where, record), options.get("log", False), where), options)


def open_field(path: str | os.PathLike[str], options: Mapping[str, Any]) -> RegularField | EllipsoidField:
    """Return the field of a file; `options` are those of `sheetsplat.open` that the caller gave.

    Raises InvalidInput for several channels of which none is chosen.
    """
    found = open_fields(path, options)
    if len(found) > 1:
        raise several_channels(Path(path), len(found), [one.name for one in found])
    return found[0]


def open_fields(path: str | os.PathLike[str], options: Mapping[str, Any]) -> list[RegularField | EllipsoidField]:
    """Return the fields of the channels of a file, of most files the only one; `options` as for `open_field`."""
    if not isinstance(path, str | os.PathLike):
        raise complain("the file cannot be read", f"{type(path).__name__}, {shown(path)}", "a path")
    # Paths are nothing that a field says about itself.
    opened = {name: value for name, value in options.items() if name != "grid"}
    if "weight" in options or kind_of(path, options).scattered:
        return [weighted(partial(_field, path), options).opened_with(opened)]
    volumes = read_regular(path, options)
    own = [{"name": one.channel.name} if len(volumes) > 1 else {} for one in volumes]
    return [_of_volume(one, options).opened_with({**opened, **told}) for one, told in zip(volumes, own, strict=True)]


def weighted(
    read: Callable[[Mapping[str, Any]], tuple[Volume | Scattered, RegularField | EllipsoidField]],
    options: Mapping[str, Any],
) -> RegularField | EllipsoidField:
    """Return the field that `read` makes by options, with weights where they name an array of the same data."""
    rest = {name: one for name, one in options.items() if name != "weight"}
    record, field = read(rest)
    if "weight" not in options:
        return field
    of_weight = {name: one for name, one in rest.items() if name not in ("name", "scalar", "log", "base")}
    try:
        record_of_weight, weight = read({**of_weight, "scalar": options["weight"]})
    except Error as error:
        raise about_option(error, "scalar", "weight") from error
    mine, its = _rows(record, field), _rows(record_of_weight, weight)
    if np.array_equal(mine, its) or (mine.size, its.size) != (field.size, weight.size):
        return field.weighted_by(weight)
    # Rows without a weight, which were left out, add nothing to a mean.
    known = np.zeros(1 + max(mine.max(initial=-1), its.max(initial=-1)))
    known[its] = weight.values
    return field.weighted_by(known[mine])


def _rows(record: Volume | Scattered, field: Field) -> NDArray[np.int64]:
    """Return which rows of scattered data a field has; of volumes none."""
    if not isinstance(record, Scattered):
        return np.empty(0, np.int64)
    return np.arange(field.size) if record.rows is None else record.rows


def _field(
    path: str | os.PathLike[str], options: Mapping[str, Any]
) -> tuple[Volume | Scattered, RegularField | EllipsoidField]:
    if kind_of(path, options).scattered:
        return open_scattered(path, options)
    volume = only(Path(path), read_regular(path, options))
    return volume, _of_volume(volume, options)
