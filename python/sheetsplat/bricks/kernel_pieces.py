"""Where scattered kernels come from: tables that any process with the same files reads piece by piece.

A piece is some rows of a table, in their order. All pieces have the same columns and the same options of a field.
"""

from __future__ import annotations

import glob
import hashlib
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sheetsplat._checks import shown
from sheetsplat._objects import kind_of_object
from sheetsplat.bricks.readers import Stamp, check_options, check_plain, is_url, placed_errors, refused
from sheetsplat.errors import complain
from sheetsplat.fields import EllipsoidField
from sheetsplat.io.formats import PARQUET
from sheetsplat.io.records import Scattered
from sheetsplat.io.source import Source
from sheetsplat.notices import muted

#: Options that say what of a table is read, and which kernels it becomes.
READING = ("scalar", "particles", "support")
KERNELS = ("normalization", "w0", "falloff", "min_scale", "base", "periodic", "nan")
# Rows of a piece, at most; of Parquet a piece is a row group.
_ROWS = 1 << 20
# Weights that are all 0 in a piece need not be so in all.
_LEAST_WEIGHT = 1e-30
_FRAME = "the dask DataFrame"


@dataclass(frozen=True, eq=False)
class Pieces:
    """Tables of kernels. It can be pickled, and any process with the same files can use it.

    Attributes
    ----------
    name
        The file or the data, for messages.
    token
        The same for the same data; another one after a file was changed.
    counts
        Number of rows of each piece.
    read
        Returns the kernels of a piece, by its number.
    in_memory
        Whether they are here already.
    skips
        Whether rows whose numbers are not finite are left out, so that a piece may have fewer kernels than rows.
    """

    name: str
    token: str
    counts: tuple[int, ...]
    read: Callable[[int], EllipsoidField]
    in_memory: bool = False
    skips: bool = False


def _some(
    name: str, token: str, counts: Iterable[int], read: Callable[[int], EllipsoidField], kernels: Mapping[str, Any]
) -> Pieces:
    made = Pieces(name, token, tuple(counts), read, skips=kernels.get("nan") == "skip")
    if not sum(made.counts):
        raise refused(name, "no rows", "at least one")
    return made


def _in_memory(field: EllipsoidField, name: str = "the kernels") -> Pieces:
    if field.ghosts or not field.size:
        found = f"{field.ghosts} ghost points" if field.ghosts else "no kernels"
        raise refused("the field", found, "kernels of data")
    digest = hashlib.blake2b(digest_size=12)
    for array in (field.centers, field.scales, field.rotations, field.values, field.weights):
        digest.update(b"-" if array is None else np.ascontiguousarray(array).data)
    spans = [(first, min(first + _ROWS, field.size)) for first in range(0, field.size, _ROWS)]
    counts = tuple(last - first for first, last in spans)
    return Pieces(name, digest.hexdigest(), counts, lambda number: field.part(np.arange(*spans[number])), True)


def _of_files(
    stamps: Sequence[Stamp], spans: Sequence[tuple[int, int, int]], read: Any, reading: Any, kernels: Mapping[str, Any]
) -> Pieces:
    """Return pieces of files: the number of a file, its first row, or row group, and how many rows."""
    more = f" and {len(stamps) - 1} more" if len(stamps) > 1 else ""
    made = partial(read, tuple(stamps), tuple(spans), reading, kernels)
    counts = (rows for _, _, rows in spans)
    return _some(f"{stamps[0].path}{more}", repr((stamps, spans, reading, kernels)), counts, made, kernels)


def _read_particles(
    stamps: Sequence[Stamp], spans: Sequence[tuple[int, int, int]], options: Mapping[str, Any],
    kernels: Mapping[str, Any], number: int,
) -> EllipsoidField:  # fmt: skip
    """Return particles of an HDF5 file with the layout of Gadget."""
    from sheetsplat.io import sph_hdf5

    at, first, rows = spans[number]
    stamp, last = stamps[at], first + rows
    with placed_errors(f"rows {first} to {last} of {stamp.path} cannot be read"):
        stamp.check()
        with Source(stamp.path, "") as source, np.errstate(all="ignore"):
            return _field(sph_hdf5.read(source, rows=(first, last), **options), kernels, str(stamp.path))


def _read_group(
    stamps: Sequence[Stamp], groups: Sequence[tuple[int, int, int]], scalar: str | None, kernels: Mapping[str, Any],
    number: int,
) -> EllipsoidField:  # fmt: skip
    """Return a row group of a Parquet file."""
    at, group, _ = groups[number]
    stamp = stamps[at]
    with placed_errors(f"row group {group} of {stamp.path} cannot be read"):
        from pyarrow import parquet  # type: ignore[import-not-found, import-untyped, unused-ignore]

        stamp.check()
        table = parquet.ParquetFile(stamp.path).read_row_group(group)
        columns = {name: table.column(name).to_numpy() for name in table.column_names}
        return _of_columns(columns, str(stamp.path), scalar, kernels)


def _read_partition(
    frame: Any, partitions: Sequence[int], scalar: str | None, kernels: Mapping[str, Any], number: int
) -> EllipsoidField:
    """Return a partition of a DataFrame of dask."""
    with placed_errors(f"partition {partitions[number]} of {_FRAME} cannot be read"):
        # Tasks of a worker read pieces; further tasks of its scheduler would wait for them.
        found = frame.get_partition(partitions[number]).compute(scheduler="synchronous")
        return _of_columns(found, _FRAME, scalar, kernels)


def _of_columns(columns: Any, where: str, scalar: str | None, kernels: Mapping[str, Any]) -> EllipsoidField:
    from sheetsplat.io.tables import read_columns

    with np.errstate(all="ignore"):
        return _field(read_columns(columns, where, scalar), kernels, where)


def _field(record: Scattered, kernels: Mapping[str, Any], where: str) -> EllipsoidField:
    """Return the kernels of a piece of a table, which must have their sizes."""
    from sheetsplat.io.checks import printable
    from sheetsplat.io.kernels import field_of

    if not record.has_kernels:
        raise refused(
            where,
            "points without the sizes of kernels, which follow from their neighbours",
            "smoothing lengths, a column radius, or sx, sy, sz",
            "open it with sheetsplat.open",
        )
    with muted():
        # The whole table is counted once, and not each piece, which is read twice.
        record = record.usable(where, kernels.get("nan", "error"))
    if not len(record.points):
        raise refused(where, "no row whose numbers are finite", "at least one")
    if record.weights is not None and (record.weights == 0).all():
        record = replace(record, weights=np.full_like(record.weights, _LEAST_WEIGHT))
    field = field_of(record, **{name: one for name, one in kernels.items() if name != "nan"})
    return field.with_quantity(name=printable(record.scalar), unit=record.unit, length_unit=record.length_unit)


def pieces_of(data: Any, options: Mapping[str, Any], client: Any = None) -> Pieces | None:
    """Return scattered data as pieces; None for anything else, which may be a volume.

    Parameters
    ----------
    data
        A field of kernels, a dict or a DataFrame of columns, also one of dask; a path of HDF5 with particles, of
        Parquet, of a folder with files of Parquet, or several paths.
    options
        Those of `READING` and `KERNELS` that were given.
    client
        Its workers count the rows of a DataFrame of dask.

    Raises
    ------
    InvalidInput
        For options that do not belong to the format, and damaged headers.
    """
    if isinstance(data, EllipsoidField):
        return _in_memory(data)
    if _is_dask_frame(data):
        return _of_frame(data, options, client)
    kind = None if isinstance(data, str | os.PathLike) else kind_of_object(data)
    if kind is not None:
        if not kind.reader.endswith("tables:read_columns"):
            return None
        from sheetsplat.io.objects import field_of_object

        given = {name: value for name, value in options.items() if name in (*READING, *KERNELS)}
        made = field_of_object(data, kind, given)
        assert isinstance(made, EllipsoidField)
        return _in_memory(made, kind.name)
    several = isinstance(data, list | tuple) and data and all(isinstance(one, str | os.PathLike) for one in data)
    if isinstance(data, str | os.PathLike):
        files = _files(os.fspath(data))
    elif several:
        files = [name for one in data for name in _files(os.fspath(one))]
    else:
        return None
    if files and all(Path(name).suffix.lower() in PARQUET for name in files):
        return _of_parquet(files, options)
    if files and all(_holds_particles(name, options) for name in files):
        return _of_hdf5(files, options)
    if several:
        raise complain(
            "open_bricks: several files cannot be used",
            shown([os.fspath(one) for one in data]),
            "files of particles, all of HDF5 or all of Parquet; or one file",
        )
    return None


def _files(text: str) -> list[str]:
    """Return the files of Parquet in a folder, sorted; a file itself."""
    if os.path.isdir(text):
        return sorted(name for suffix in PARQUET for name in glob.glob(os.path.join(glob.escape(text), f"*{suffix}")))
    return [text]


def _holds_particles(text: str, options: Mapping[str, Any]) -> bool:
    from sheetsplat.io.formats import find_format

    if not os.path.isfile(text) or not options.keys().isdisjoint(("shape", "dtype", "offset")):
        return False
    return find_format(text, raw_options=False, name=options.get("name"), grid=False).name == "hdf5"


def _reading(where: str, options: Mapping[str, Any], known: Sequence[str]) -> dict[str, Any]:
    """Return the options of kernels; InvalidInput for options of reading that are not known."""
    check_options(where, [name for name in READING if name in options], known, "a table of columns")
    return {name: options[name] for name in KERNELS if name in options}


def _of_hdf5(files: Sequence[str], options: Mapping[str, Any]) -> Pieces:
    from sheetsplat.io import sph_hdf5

    kernels = _reading(files[0], options, READING)
    reading = {name: options[name] for name in READING if name in options}
    stamps, spans, boxes = [], [], []
    for number, name in enumerate(files):
        with Source(Path(name), "") as source:
            check_plain(source, name)
            count, support, box = sph_hdf5.locate(source, options.get("particles"), reading.get("support"))
        boxes.append(box)
        if support is not None:
            # One for all files of a snapshot.
            reading["support"] = support
        stamps.append(Stamp.of(Path(name)))
        spans += [(number, first, min(_ROWS, count - first)) for first in range(0, count, _ROWS)]
    if "periodic" not in kernels and len(set(boxes)) == 1 and boxes[0] is not None:
        kernels["periodic"] = boxes[0]
    return _of_files(stamps, spans, _read_particles, reading, kernels)


def _of_parquet(files: Sequence[str], options: Mapping[str, Any]) -> Pieces:
    kernels = _reading(files[0], options, ("scalar",))
    stamps, groups = [], []
    for number, name in enumerate(files):
        if is_url(name):
            advice = "pass a DataFrame of dask, which reads URLs: dask.dataframe.read_parquet"
            raise refused(name, "Parquet at a URL", "its path; at URLs raw samples alone are read", advice)
        with placed_errors(f"{name} cannot be opened in bricks"), Source(Path(name), "") as source:
            from pyarrow import parquet

            about = parquet.ParquetFile(source.path).metadata
            rows = [about.row_group(group).num_rows for group in range(about.num_row_groups)]
            stamps.append(Stamp.of(source.path))
        groups += [(number, group, count) for group, count in enumerate(rows) if count]
    return _of_files(stamps, groups, _read_group, options.get("scalar"), kernels)


def _is_dask_frame(data: Any) -> bool:
    module = type(data).__module__.partition(".")[0]
    return module in ("dask", "dask_expr") and hasattr(data, "npartitions") and hasattr(data, "columns")


def _of_frame(data: Any, options: Mapping[str, Any], client: Any) -> Pieces:
    from dask.base import tokenize  # type: ignore[import-not-found, import-untyped, unused-ignore]

    kernels = _reading(_FRAME, options, ("scalar",))
    with placed_errors(f"{_FRAME} cannot be opened in bricks"):
        lengths = data.map_partitions(len)
        counts = lengths.compute(scheduler="synchronous" if client is None else client)
        scalar = options.get("scalar")
        token = repr((tokenize(data), scalar, kernels))
    # Of filtered tables some partitions are empty.
    filled = {number: int(count) for number, count in enumerate(counts) if count}
    return _some(
        _FRAME, token, filled.values(), partial(_read_partition, data, tuple(filled), scalar, kernels), kernels
    )


__all__ = ["KERNELS", "READING", "Pieces", "pieces_of"]
