"""Readers of boxes of samples, which any process with the same files can use, and files that must not change."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.bricks.lattice import Box, slices
from sheetsplat.errors import Error, OutOfMemory, complain, missing_package
from sheetsplat.io.records import Packing
from sheetsplat.io.source import Folder, Source
from sheetsplat.io.stored import LazySamples, StoredSamples, changed

Shape = tuple[int, int, int]
# How many bytes of a remote file come in the time that one more request takes.
_REMOTE_CALL = 1 << 22


#: Reads the samples of a box, an array [k, j, i]. It can be pickled, and any process with the same files can use it.
Reader = Callable[[Box], Any]


def is_url(text: str) -> bool:
    """Return whether a text is a URL, and not the path of a file that is there."""
    return "://" in text and not os.path.lexists(text)


def refused(name: object, found: str, wanted: str, advice: str = "", **more: Any) -> Error:
    """Return the error for data that cannot be opened in bricks."""
    return complain(f"{name} cannot be opened in bricks", found, wanted, advice, **more)


def check_options(name: object, given: Iterable[str], known: Sequence[str], what: str) -> None:
    """Raise InvalidInput for options of reading that were given and that `what` does not know."""
    if wrong := [one for one in given if one not in known]:
        found, wanted = f"{', '.join(wrong)} for {what}", "only " + ", ".join(known) if known else "none"
        raise refused(name, found, wanted, option=wrong[0] if len(wrong) == 1 else None)


def check_plain(source: Source | Folder, name: object) -> None:
    """Raise InvalidInput for a file that is packed as a whole."""
    if isinstance(source, Source) and source.packed:
        raise refused(name, "a gzipped file", "one that is not packed", "unpack it first")


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


def of_array(values: NDArray[Any], box: Box) -> NDArray[Any]:
    """Return samples in memory."""
    return values[slices(box)]


def of_file(stamps: tuple[Stamp, ...], samples: StoredSamples, box: Box) -> NDArray[Any]:
    """Return raw samples of a file; `stamps`: the files that say where they are, and the one that has them."""
    with unchanged(*stamps), Source(samples.path) as source:
        return samples[slices(box)].read(source.fetch)


def of_url(url: str, samples: StoredSamples, box: Box) -> NDArray[Any]:
    """Return raw samples of a file that fsspec reads."""
    import fsspec  # type: ignore[import-not-found, import-untyped, unused-ignore]

    with fsspec.open(url, "rb") as file:

        def fetch(position: int, count: int) -> bytes:
            file.seek(position)
            content: bytes = file.read(count)
            if len(content) < count:
                raise EOFError("the file ends early")
            return content

        return samples[slices(box)].read(fetch, _REMOTE_CALL)


def of_lazy(stamps: tuple[Stamp, ...], samples: LazySamples, box: Box) -> NDArray[Any]:
    """Return samples of an array that something else reads; `stamps`: the files that have them."""
    with unchanged(*stamps):
        return samples[slices(box)].read()


def unpacked(reader: Reader, packing: Packing, name: str, box: Box) -> NDArray[Any]:
    """Return the samples that the numbers of a reader stand for."""
    return packing.unpacked(np.asarray(reader(box)), name)
