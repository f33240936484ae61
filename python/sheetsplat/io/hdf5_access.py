"""HDF5 files that are not trusted.

No other file is opened, sizes are checked before memory is taken, and what the library would read for ever is refused.
"""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, cast

import h5py  # type: ignore[import-untyped, unused-ignore]
import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import shown
from sheetsplat.io.checks import unreadable
from sheetsplat.io.source import DEFLATE_RATIO, Source, hdf5_start

_MOST_LINKS = 16
_MOST_ENTRIES = 10_000


# Bytes that are read at once: Ctrl-C is seen between them.
_CHUNK = 1 << 19
# Global heaps, which hold texts and lists of any length (HDF5 file format specification, III.E): how one begins, and
# the bytes of its head and of that of an object in it.
_HEAP = b"GCOL\x01"
_HEAD = 16


@dataclass(frozen=True)
class _Superblock:
    """What the superblock says (HDF5 file format specification, II.A): the file's length, the bytes of a length."""

    end: int
    length_bytes: int


def _superblock(source: Source) -> _Superblock:
    start = hdf5_start(source) or 0
    head = source.head(start + 64)[start:]
    version = head[8] if len(head) > 14 else -1
    if version in (0, 1):
        width, lengths, at = head[13], head[14], 24 if version == 0 else 28
        at += 2 * width
    elif version in (2, 3):
        width, lengths = head[9], head[10]
        at = 12 + 2 * width
    else:
        raise unreadable(source.path, f"an HDF5 superblock of version {version}", "version 0, 1, 2 or 3")
    if not {width, lengths} <= {4, 8} or len(head) < at + width:
        found = f"an HDF5 superblock with offsets of {width} bytes, lengths of {lengths}"
        raise unreadable(source.path, found, "4 or 8 bytes")
    return _Superblock(int.from_bytes(head[at : at + width], "little"), lengths)


class _Checked(io.RawIOBase):
    """The bytes of a file as the library reads them, global heaps with which it would go round for ever left out.

    The library steps from object to object of a heap by their sizes, also by 0 and by those that lead back.
    """

    def __init__(self, path: Path, inner: BinaryIO, length_bytes: int) -> None:
        self._path, self._inner, self._length_bytes = path, inner, length_bytes

    def readable(self) -> bool:
        """Return True."""
        return True

    def seekable(self) -> bool:
        """Return True."""
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Go to a place and return it."""
        return self._inner.seek(offset, whence)

    def tell(self) -> int:
        """Return the place."""
        return self._inner.tell()

    def readinto(self, buffer: Any) -> int:
        """Fill the buffer, with zeros behind the end of the file, and return the number of bytes; heaps are checked."""
        view = memoryview(buffer).cast("B")
        filled = self._fill(view)
        view[filled:] = bytes(len(view) - filled)
        if view[: len(_HEAP)] == _HEAP:
            self._check_heap(self._inner.tell() - filled)
        return filled

    def _fill(self, view: memoryview) -> int:
        filled = 0
        while piece := self._inner.readinto(view[filled : filled + _CHUNK]):  # type: ignore[attr-defined]
            filled += piece
        return filled

    def _check_heap(self, start: int) -> None:
        """Raise InvalidInput where a step from object to object does not lead on within the heap."""
        back = self._inner.tell()
        end, at = start + self._numbers(start)[1], start + _HEAD
        # What is too short for an object is free.
        while at + _HEAD <= end:
            number, size = self._numbers(at)
            # An object of the number 0 is what is free, its head included.
            step = _HEAD + -(-size // 8) * 8 if number else size
            if not _HEAD <= step <= end - at:
                found = f"an object of {size} bytes in a heap, at byte {at}"
                raise unreadable(self._path, found, "objects that follow each other", "fetch it again")
            at += step
        self._inner.seek(back)

    def _numbers(self, at: int) -> tuple[int, int]:
        """Return the number of a heap's object, and its bytes; of a heap itself its bytes."""
        self._inner.seek(at)
        head = self._inner.read(_HEAD)
        if len(head) < _HEAD:
            raise unreadable(self._path, f"a heap that goes beyond byte {at}", "one within the file", "fetch it again")
        return int.from_bytes(head[:2], "little"), int.from_bytes(head[8 : 8 + self._length_bytes], "little")


def seekable(source: Source) -> Path | BinaryIO:
    """Return the file, or the decompressed bytes of a gzipped one, at most as many as its superblock says.

    For arrays of numbers alone; `checked` is for all else.
    """
    end = _superblock(source).end
    if not source.packed:
        return source.path
    return io.BytesIO(source.payload("raw").array(np.dtype(np.uint8), end).tobytes())


def checked(source: Source) -> BinaryIO:
    """Return the bytes of the file for h5py; a heap that its library would read for ever raises InvalidInput."""
    unpacked = seekable(source)
    inner = source.stream if isinstance(unpacked, Path) else unpacked
    return cast(BinaryIO, _Checked(source.path, inner, _superblock(source).length_bytes))


def inside(path: Path, start: Any, name: str, links: int = _MOST_LINKS) -> Any:
    """Return the object of this file with a name relative to `start`, link by link; None where there is none.

    No other file is opened: InvalidInput for an external link on the way, through soft links too. At most `links` soft
    links are followed.
    """
    here = start.file if name.startswith("/") else start
    for part in name.split("/"):
        if part in ("", "."):
            continue
        if not isinstance(here, h5py.Group):
            return None
        raw = part.encode("utf-8", "surrogateescape")
        if not here.id.links.exists(raw):
            return None
        kind = here.id.links.get_info(raw).type
        where = f"{here.name.rstrip('/')}/{part}"
        if kind == h5py.h5l.TYPE_HARD:
            here = here[part]
        elif kind == h5py.h5l.TYPE_SOFT and links > 0:
            target = here.id.links.get_val(raw).decode("utf-8", "surrogateescape")
            here = inside(path, here, target, links - 1)
        else:
            what = "a chain of links at" if kind == h5py.h5l.TYPE_SOFT else "a link to another file at"
            raise unreadable(path, f"{what} {shown(where)}", "its data in this file", "copy them into it")
    return here


def attribute(one: Any, name: str, most: int = 3) -> Any:
    """Return an attribute of at most so many numbers, or of text; None where there is none, or it is anything else."""
    if name not in one.attrs:
        return None
    kind = one.attrs.get_id(name)
    if len(kind.shape) > 1 or math.prod(kind.shape) > most or kind.dtype.kind not in "iufSO":
        return None
    return one.attrs[name]


def read_dataset(path: Path, one: Any, what: str, spare: int = 0, rows: tuple[int, int] | None = None) -> NDArray[Any]:
    """Return a dataset after a check of its size against its stored bytes.

    Parameters
    ----------
    path, one, what
        The file, the dataset, and its name for messages.
    spare
        So many more bytes must be available.
    rows
        The first row to read, and the one behind the last; None: all.
    """
    needed = check_stored(path, one, what)
    if rows is not None:
        needed = needed // max(one.shape[0], 1) * (rows[1] - rows[0])
    _memory.require(needed + spare, f"{what} of {path}")
    found: NDArray[Any] = one[()] if rows is None else one[rows[0] : rows[1]]
    return found


def read_rows(path: Path, one: Any, what: str, rows: slice, spare: int = 0) -> NDArray[Any]:
    """Return the rows first to last of a dataset, and no others; `spare` more bytes must be available for each number.

    Raises InvalidInput where it has fewer.
    """
    check_stored(path, one, what)
    if not 0 <= rows.start <= rows.stop <= one.shape[0]:
        raise unreadable(path, f"{one.shape[0]} rows of {what}", f"{rows.stop}, as other numbers of the file say")
    count = (rows.stop - rows.start) * math.prod(one.shape[1:])
    # A chunk is unpacked as a whole.
    _memory.require(
        count * (one.dtype.itemsize + spare) + math.prod(one.chunks or (0,)) * one.dtype.itemsize, f"{what} of {path}"
    )
    found: NDArray[Any] = one[rows]
    return found


def check_stored(path: Path, one: Any, what: str) -> int:
    """Return the bytes of a dataset; InvalidInput where fewer are stored, or in another file."""
    if one.is_virtual or one.external:
        raise unreadable(path, f"{what} in another file", "the numbers in this file", "copy them into it")
    # Chunks that were not written have no stored bytes.
    needed: int = math.prod(one.shape) * one.dtype.itemsize
    stored = one.id.get_storage_size()
    if needed > (stored if one.chunks is None else stored * DEFLATE_RATIO):
        raise unreadable(path, f"{stored} stored bytes of {what}", f"{needed} bytes, as its shape says")
    return needed


def walk(path: Path, group: Any, *, strict: bool = False) -> list[Any]:
    """Return the datasets of a group and of those in it, along links within the file.

    `strict`: InvalidInput for links to other files and for datasets in other files, for readers that would follow them.
    """
    found, seen, left = [], set(), [group]
    entries = 0
    while left:
        here = left.pop()
        for name in here:
            entries += 1
            if entries > _MOST_ENTRIES:
                raise unreadable(path, f"more than {_MOST_ENTRIES} entries", "fewer")
            kind = here.id.links.get_info(name.encode("utf-8", "surrogateescape")).type
            if kind != h5py.h5l.TYPE_HARD:
                if strict:
                    inside(path, here, name)
                continue
            one = here[name]
            if isinstance(one, h5py.Dataset):
                if strict and (one.is_virtual or one.external):
                    raise unreadable(
                        path, f"{one.name} in another file", "the numbers in this file", "copy them into it"
                    )
                found.append(one)
            elif isinstance(one, h5py.Group):
                address = h5py.h5o.get_info(one.id).addr
                if address not in seen:
                    seen.add(address)
                    left.append(one)
    return sorted(found, key=lambda one: str(one.name))
