"""Where scattered kernels come from: tables that any process with the same files reads piece by piece.

A piece is some rows of a table, in their order. All pieces have the same columns and the same options of a field.
"""

from __future__ import annotations

import glob
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from sheetsplat._checks import shown
from sheetsplat._objects import kind_of_object
from sheetsplat.bricks.readers import Stamp, is_url, placed_errors
from sheetsplat.errors import complain
from sheetsplat.fields import EllipsoidField
from sheetsplat.io.formats import PARQUET
from sheetsplat.io.records import Scattered
from sheetsplat.io.source import Source

#: Options that say what of a table is read, and which kernels it becomes.
READING = ("scalar", "particles", "support")
KERNELS = ("normalization", "w0", "falloff", "min_scale", "base")
# Rows of a piece, at most; of Parquet a piece is a row group.
_ROWS = 1 << 20
# Weights that are all 0 in a piece need not be so in all.
_LEAST_WEIGHT = 1e-30


class Pieces(Protocol):
    """Tables of kernels. It can be pickled, and any process with the same files can use it."""

    @property
    def name(self) -> str:
        """The file or the data, for messages."""

    @property
    def token(self) -> str:
        """The same for the same data; another one after a file was changed."""

    @property
    def counts(self) -> Sequence[int]:
        """Number of rows of each piece."""

    def read(self, number: int) -> EllipsoidField:
        """Return the kernels of a piece."""


@dataclass(frozen=True, eq=False)
class FieldPieces:
    """Kernels in memory."""

    field: EllipsoidField
    name: str = "the kernels"

    @cached_property
    def token(self) -> str:
        """Of all arrays."""
        import hashlib

        digest = hashlib.blake2b(digest_size=12)
        for array in (self.field.centers, self.field.scales, self.field.rotations, self.field.values,
                      self.field.weights):  # fmt: skip
            digest.update(b"-" if array is None else np.ascontiguousarray(array).data)
        return digest.hexdigest()

    @property
    def counts(self) -> Sequence[int]:
        """Number of rows of each piece."""
        return [min(_ROWS, self.field.size - first) for first in range(0, self.field.size, _ROWS)]

    def read(self, number: int) -> EllipsoidField:
        """Return some of the kernels."""
        first = number * _ROWS
        return self.field.part(np.arange(first, min(first + _ROWS, self.field.size)))


@dataclass(frozen=True)
class _FilePieces:
    """Pieces of files, which are named by them."""

    stamps: tuple[Stamp, ...]

    @property
    def name(self) -> str:
        return _listed(self.stamps)

    @property
    def token(self) -> str:
        return repr(self)


@dataclass(frozen=True)
class _Hdf5Pieces(_FilePieces):
    """Particles of HDF5 files with the layout of Gadget."""

    # File, first row, and the row behind the last.
    spans: tuple[tuple[int, int, int], ...]
    options: Mapping[str, Any]
    kernels: Mapping[str, Any]

    @property
    def counts(self) -> Sequence[int]:
        return [last - first for _, first, last in self.spans]

    def read(self, number: int) -> EllipsoidField:
        from sheetsplat.io import sph_hdf5

        at, first, last = self.spans[number]
        stamp = self.stamps[at]
        with placed_errors(f"rows {first} to {last} of {stamp.path} cannot be read"):
            stamp.check()
            with Source(stamp.path, "") as source, np.errstate(all="ignore"):
                return _field(sph_hdf5.read(source, rows=(first, last), **self.options), self.kernels, str(stamp.path))


@dataclass(frozen=True)
class _ParquetPieces(_FilePieces):
    """Row groups of Parquet files."""

    # File, row group, and its rows.
    groups: tuple[tuple[int, int, int], ...]
    scalar: str | None
    kernels: Mapping[str, Any]

    @property
    def counts(self) -> Sequence[int]:
        return [rows for _, _, rows in self.groups]

    def read(self, number: int) -> EllipsoidField:
        at, group, _ = self.groups[number]
        stamp = self.stamps[at]
        with placed_errors(f"row group {group} of {stamp.path} cannot be read"):
            from pyarrow import parquet  # type: ignore[import-not-found, import-untyped, unused-ignore]

            stamp.check()
            table = parquet.ParquetFile(stamp.path).read_row_group(group)
            columns = {name: table.column(name).to_numpy() for name in table.column_names}
            return _of_columns(columns, str(stamp.path), self.scalar, self.kernels)


@dataclass(frozen=True, eq=False)
class _FramePieces:
    """Partitions of a DataFrame of dask."""

    frame: Any
    token: str
    # Number of a partition, and its rows.
    partitions: tuple[tuple[int, int], ...]
    scalar: str | None
    kernels: Mapping[str, Any]
    name: str = "the dask DataFrame"

    @property
    def counts(self) -> Sequence[int]:
        return [rows for _, rows in self.partitions]

    def read(self, number: int) -> EllipsoidField:
        partition, _ = self.partitions[number]
        with placed_errors(f"partition {partition} of {self.name} cannot be read"):
            # Tasks of a worker read pieces; further tasks of its scheduler would wait for them.
            frame = self.frame.get_partition(partition).compute(scheduler="synchronous")
            return _of_columns(frame, self.name, self.scalar, self.kernels)


def _listed(stamps: Sequence[Stamp]) -> str:
    more = f" and {len(stamps) - 1} more" if len(stamps) > 1 else ""
    return f"{stamps[0].path}{more}"


def _of_columns(columns: Any, where: str, scalar: str | None, kernels: Mapping[str, Any]) -> EllipsoidField:
    from sheetsplat.io.tables import read_columns

    with np.errstate(all="ignore"):
        return _field(read_columns(columns, where, scalar), kernels, where)


def _field(record: Scattered, kernels: Mapping[str, Any], where: str) -> EllipsoidField:
    """Return the kernels of a piece of a table, which must have their sizes."""
    from sheetsplat.io.checks import printable
    from sheetsplat.io.kernels import field_of

    if not record.has_kernels:
        raise complain(
            f"{where} cannot be opened in bricks",
            "points without the sizes of kernels, which follow from their neighbours",
            "smoothing lengths, a column radius, or sx, sy, sz",
            "open it with sheetsplat.open",
        )
    if record.weights is not None and (record.weights == 0).all():
        record = replace(record, weights=np.full_like(record.weights, _LEAST_WEIGHT))
    field = field_of(record, **kernels)
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
        return FieldPieces(_checked(data))
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
        return FieldPieces(made, kind.name)
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


def _checked(field: EllipsoidField) -> EllipsoidField:
    if field.ghosts or not field.size:
        found = f"{field.ghosts} ghost points" if field.ghosts else "no kernels"
        raise complain("the field cannot be opened in bricks", found, "kernels of data")
    return field


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
    if wrong := [name for name in READING if name in options and name not in known]:
        raise complain(
            f"{where} cannot be opened in bricks",
            ", ".join(wrong) + " for a table of columns",
            "only " + ", ".join(known),
            option=wrong[0] if len(wrong) == 1 else None,
        )
    return {name: options[name] for name in KERNELS if name in options}


def _of_hdf5(files: Sequence[str], options: Mapping[str, Any]) -> Pieces:
    from sheetsplat.io import sph_hdf5

    kernels = _reading(files[0], options, READING)
    reading = {name: options[name] for name in READING if name in options}
    stamps, spans = [], []
    for number, name in enumerate(files):
        with Source(Path(name), "") as source:
            if source.packed:
                found = "a gzipped file"
                raise complain(f"{name} cannot be opened in bricks", found, "one that is not packed", "unpack it first")
            count, support = sph_hdf5.locate(source, options.get("particles"), reading.get("support"))
        if support is not None:
            # One for all files of a snapshot.
            reading["support"] = support
        stamps.append(Stamp.of(Path(name)))
        spans += [(number, first, min(first + _ROWS, count)) for first in range(0, count, _ROWS)]
    return _some(_Hdf5Pieces(tuple(stamps), tuple(spans), reading, kernels))


def _of_parquet(files: Sequence[str], options: Mapping[str, Any]) -> Pieces:
    kernels = _reading(files[0], options, ("scalar",))
    stamps, groups = [], []
    for number, name in enumerate(files):
        what = f"{name} cannot be opened in bricks"
        if is_url(name):
            advice = "pass a DataFrame of dask, which reads URLs: dask.dataframe.read_parquet"
            raise complain(what, "Parquet at a URL", "its path; at URLs raw samples alone are read", advice)
        with placed_errors(what), Source(Path(name), "") as source:
            from pyarrow import parquet

            about = parquet.ParquetFile(source.path).metadata
            rows = [about.row_group(group).num_rows for group in range(about.num_row_groups)]
            stamps.append(Stamp.of(source.path))
        groups += [(number, group, count) for group, count in enumerate(rows) if count]
    return _some(_ParquetPieces(tuple(stamps), tuple(groups), options.get("scalar"), kernels))


def _is_dask_frame(data: Any) -> bool:
    module = type(data).__module__.partition(".")[0]
    return module in ("dask", "dask_expr") and hasattr(data, "npartitions") and hasattr(data, "columns")


def _of_frame(data: Any, options: Mapping[str, Any], client: Any) -> Pieces:
    from dask.base import tokenize  # type: ignore[import-not-found, import-untyped, unused-ignore]

    kernels = _reading("the dask DataFrame", options, ("scalar",))
    with placed_errors("the dask DataFrame cannot be opened in bricks"):
        lengths = data.map_partitions(len)
        counts = lengths.compute(scheduler="synchronous" if client is None else client)
        scalar = options.get("scalar")
        token = repr((tokenize(data), scalar, kernels))
    # Of filtered tables some partitions are empty.
    filled = tuple((number, int(count)) for number, count in enumerate(counts) if count)
    return _some(_FramePieces(data, token, filled, scalar, kernels))


def _some(pieces: Pieces) -> Pieces:
    if not sum(pieces.counts):
        raise complain(f"{pieces.name} cannot be opened in bricks", "no rows", "at least one")
    return pieces


__all__ = ["KERNELS", "READING", "FieldPieces", "Pieces", "pieces_of"]
