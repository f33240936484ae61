"""HDF5 files that are not trusted: no other file is opened, and sizes are checked before memory is taken."""

from __future__ import annotations

import io
import math
import struct
from pathlib import Path
from typing import Any, BinaryIO

import h5py  # type: ignore[import-untyped, unused-ignore]
import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import shown
from sheetsplat.io.checks import unreadable
from sheetsplat.io.source import DEFLATE_RATIO, Source

_MOST_LINKS = 16
_MOST_ENTRIES = 10_000


def _end_of_file(source: Source) -> int:
    """Return the file's length according to its superblock (HDF5 file format specification, II.A)."""
    head = source.head(64)
    version = head[8] if len(head) > 13 else -1
    if version in (0, 1):
        width, at = head[13], 24 if version == 0 else 28
        at += 2 * width
    elif version in (2, 3):
        width = head[9]
        at = 12 + 2 * width
    else:
        raise unreadable(source.path, f"an HDF5 superblock of version {version}", "version 0, 1, 2 or 3")
    if width not in (4, 8) or len(head) < at + width:
        raise unreadable(source.path, f"an HDF5 superblock with offsets of {width} bytes", "offsets of 4 or 8 bytes")
    return int(struct.unpack_from("<Q" if width == 8 else "<I", head, at)[0])


def seekable(source: Source) -> Path | BinaryIO:
    """Return the file, or the decompressed bytes of a gzipped one, at most as many as its superblock says."""
    end = _end_of_file(source)
    if not source.packed:
        return source.path
    return io.BytesIO(source.payload("raw").array(np.dtype(np.uint8), end).tobytes())


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
