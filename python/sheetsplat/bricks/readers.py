"""Readers of boxes of samples, which any process with the same files can use, and files that must not change."""

from __future__ import annotations

import contextlib
import os
import pkgutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sheetsplat.bricks.lattice import Box
from sheetsplat.errors import Error, OutOfMemory, complain, missing_package
from sheetsplat.io.source import Source, guarded

Shape = tuple[int, int, int]
# Axes with fewer samples than a box may be are no reason to read more than this many bytes of a remote file at once.
_ROW_BYTES = 1 << 26


class Reader(Protocol):
    """Reads boxes of samples. It can be pickled, and any process with the same files can use it."""

    def read(self, box: Box) -> Any:
        """Return the samples of a box, an array [k, j, i]."""


def is_url(text: str) -> bool:
    """Return whether a text is a URL, and not the path of a file that is there."""
    return "://" in text and not os.path.lexists(text)


@contextlib.contextmanager
def placed_errors(what: str) -> Iterator[None]:
    """Turn errors of reading into errors that say which samples could not be read."""
    try:
        yield
    except Error as error:
        raise complain(what, error.found or error.what, error.wanted, error.advice, kind=type(error)) from error
    except MemoryError as error:
        raise complain(
            what, "too little memory", "memory for a brick", "use smaller bricks", kind=OutOfMemory
        ) from error
    except ImportError as error:
        raise missing_package(what, error) from error
    except OSError as error:
        if error.errno is not None:
            raise complain(what, error.strerror or str(error), "the file as it was opened", kind=Error) from error
        raise _damaged(what, error) from error
    except Exception as error:
        raise _damaged(what, error) from error


def _damaged(what: str, error: Exception) -> Error:
    reason = (str(error).strip().splitlines() or [""])[0] or type(error).__name__
    return complain(what, f"damaged or cut-off data ({reason})", "whole data", "fetch them again")


@dataclass(frozen=True)
class Stamp:
    """A file, and its size and time of change when it was opened."""

    path: Path
    size: int
    changed: int

    @classmethod
    def of(cls, path: Path) -> Stamp:
        """Return the stamp of a file."""
        found = os.stat(path)
        return cls(Path(os.path.abspath(path)), found.st_size, found.st_mtime_ns)

    def check(self) -> None:
        """Raise an error where the file was changed or is gone."""
        try:
            now = Stamp.of(self.path)
        except OSError as error:
            reason = error.strerror or str(error)
            raise complain(f"{self.path} cannot be read", reason, "the file as it was opened", kind=Error) from None
        if now != self:
            raise complain(f"{self.path} cannot be read", "a file that was changed", "the file as it was opened")


@dataclass(frozen=True, eq=False)
class ArrayReader:
    """Samples in memory."""

    values: NDArray[Any]

    def read(self, box: Box) -> NDArray[Any]:
        """Return the samples of a box."""
        return self.values[_cuts(box)]


@dataclass(frozen=True)
class RawReader:
    """Samples in a file, one after the other."""

    stamp: Stamp
    shape: Shape
    stored: np.dtype[Any]
    offset: int
    fortran: bool = False

    def read(self, box: Box) -> NDArray[Any]:
        """Return the samples of a box."""
        self.stamp.check()
        order: Any = "F" if self.fortran else "C"
        mapped = np.memmap(self.stamp.path, self.stored, "r", self.offset, self.shape, order)
        # A copy: what is mapped would be read when a picture is drawn, and fail there.
        return np.array(mapped[_cuts(box)])


@dataclass(frozen=True)
class MappedReader:
    """Raw samples behind a header, or beside it.

    `reader`: "module:function" that reads the header and maps the samples.
    """

    stamps: tuple[Stamp, ...]
    reader: str

    def read(self, box: Box) -> NDArray[Any]:
        """Return the samples of a box."""
        for stamp in self.stamps:
            stamp.check()
        with Source(self.stamps[0].path) as source:
            mapped = pkgutil.resolve_name(self.reader)(source, mapped=True).values
            # A copy: what is mapped would be read when a picture is drawn, and fail there.
            return np.array(mapped[_cuts(box)])


@dataclass(frozen=True)
class RemoteRawReader:
    """Samples in a file that fsspec reads."""

    url: str
    length: int
    shape: Shape
    stored: np.dtype[Any]
    offset: int

    def read(self, box: Box) -> NDArray[Any]:
        """Return the samples of a box."""
        import fsspec  # type: ignore[import-not-found, import-untyped, unused-ignore]

        (k0, k1), (j0, j1), (i0, i1) = box
        _, nj, ni = self.shape
        found = np.empty((k1 - k0, j1 - j0, i1 - i0), self.stored)
        # Whole rows of a layer lie together.
        rows = max(1, _ROW_BYTES // (ni * self.stored.itemsize))
        with fsspec.open(self.url, "rb") as file:
            for k in range(k0, k1):
                for j in range(j0, j1, rows):
                    count = min(rows, j1 - j)
                    file.seek(self.offset + ((k * nj + j) * ni) * self.stored.itemsize)
                    piece = file.read(count * ni * self.stored.itemsize)
                    part = np.frombuffer(piece, self.stored)
                    if part.size < count * ni:
                        raise EOFError(f"the file ends within layer {k}")
                    found[k - k0, j - j0 : j - j0 + count] = part.reshape(count, ni)[:, i0:i1]
        return found


@dataclass(frozen=True)
class Hdf5Reader:
    """A dataset of an HDF5 file."""

    stamp: Stamp
    dataset: str

    def read(self, box: Box) -> NDArray[Any]:
        """Return the samples of a box."""
        from sheetsplat.io.hdf5_volumes import read_part

        self.stamp.check()
        with Source(self.stamp.path, self.dataset) as source:
            return read_part(source, self.dataset, box)


@dataclass(frozen=True)
class ZarrReader:
    """An array of a Zarr folder."""

    located: Any

    def read(self, box: Box) -> Any:
        """Return the samples of a box."""
        with guarded(self.located.path):
            return self.located.part(box)


@dataclass(frozen=True)
class NetcdfReader:
    """A variable of a NetCDF file."""

    stamp: Stamp
    inner: str
    name: str | None
    step: int | None

    def read(self, box: Box) -> Any:
        """Return the samples of a box."""
        from sheetsplat.io.netcdf import opened as opened_variable
        from sheetsplat.io.xarray_data import one_step, placed

        self.stamp.check()
        with Source(self.stamp.path, self.inner) as source, opened_variable(source, self.name, mapped=True) as array:
            return _part_of(placed(one_step(array, source.path, self.step), source.path), box)


@dataclass(frozen=True)
class LazyReader:
    """An array of another library that reads parts of itself: dask, Zarr."""

    array: Any

    def read(self, box: Box) -> Any:
        """Return the samples of a box."""
        part = self.array[_cuts(box)]
        # Tasks of a worker draw bricks; further tasks of its scheduler would wait for them.
        return part.compute(scheduler="synchronous") if hasattr(part, "compute") else part


@dataclass(frozen=True)
class DataArrayReader:
    """A DataArray of xarray."""

    placed: Any

    def read(self, box: Box) -> Any:
        """Return the samples of a box."""
        return _part_of(self.placed, box)


def _cuts(box: Box) -> tuple[slice, ...]:
    return tuple(slice(first, last) for first, last in box)


def _part_of(found: Any, box: Box) -> Any:
    """Return a box of a placed DataArray; coordinates that fall turn an axis round."""
    cuts = []
    turned = found.falling
    for (first, last), size, falls in zip(box, found.array.shape, turned, strict=True):
        cuts.append(slice(size - last, size - first) if falls else slice(first, last))
    part = found.array[tuple(cuts)].data
    values = np.asarray(part.compute(scheduler="synchronous") if hasattr(part, "compute") else part)
    return np.flip(values, tuple(axis for axis in range(3) if turned[axis]))
