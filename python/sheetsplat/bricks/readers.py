"""Readers of boxes of samples, which any process with the same files can use, and files that must not change."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sheetsplat.bricks.lattice import Box
from sheetsplat.errors import Error, OutOfMemory, complain, missing_package
from sheetsplat.io.source import Source, guarded
from sheetsplat.io.stored import StoredSamples, changed

Shape = tuple[int, int, int]
# How many bytes of a remote file come in the time that one more request takes.
_REMOTE_CALL = 1 << 22


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
            raise changed(self.path)


@contextlib.contextmanager
def unchanged(*stamps: Stamp) -> Iterator[None]:
    """Raise an error where a file is not as it was when it was opened, before it is read or after that."""
    for stamp in stamps:
        stamp.check()
    try:
        yield
    finally:
        for stamp in stamps:
            stamp.check()


@dataclass(frozen=True, eq=False)
class ArrayReader:
    """Samples in memory."""

    values: NDArray[Any]

    def read(self, box: Box) -> NDArray[Any]:
        """Return the samples of a box."""
        return self.values[_cuts(box)]


@dataclass(frozen=True)
class StoredReader:
    """Raw samples of a file.

    `stamps`: the files that say where they are, and the one that has them.
    """

    stamps: tuple[Stamp, ...]
    samples: StoredSamples

    def read(self, box: Box) -> NDArray[Any]:
        """Return the samples of a box."""
        with unchanged(*self.stamps), Source(self.samples.path) as source:
            return self.samples[_cuts(box)].read(source.fetch)


@dataclass(frozen=True)
class RemoteReader:
    """Raw samples of a file that fsspec reads."""

    url: str
    samples: StoredSamples

    def read(self, box: Box) -> NDArray[Any]:
        """Return the samples of a box."""
        import fsspec  # type: ignore[import-not-found, import-untyped, unused-ignore]

        with fsspec.open(self.url, "rb") as file:

            def fetch(position: int, count: int) -> bytes:
                file.seek(position)
                content: bytes = file.read(count)
                if len(content) < count:
                    raise EOFError("the file ends early")
                return content

            return self.samples[_cuts(box)].read(fetch, _REMOTE_CALL)


@dataclass(frozen=True)
class Hdf5Reader:
    """A dataset of an HDF5 file."""

    stamp: Stamp
    dataset: str

    def read(self, box: Box) -> NDArray[Any]:
        """Return the samples of a box."""
        from sheetsplat.io.hdf5_volumes import read_part

        with unchanged(self.stamp), Source(self.stamp.path, self.dataset) as source:
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

        with unchanged(self.stamp), Source(self.stamp.path, self.inner) as source:
            with opened_variable(source, self.name) as array:
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
