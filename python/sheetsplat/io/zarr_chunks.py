"""What lies in a folder of Zarr: metadata, codecs and chunks, all checked before Zarr reads them.

Codecs that run code or unpack without a bound are refused, and so are links out of the folder.
"""

from __future__ import annotations

import itertools
import json
import math
import os
import stat
import struct
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import shown
from sheetsplat.errors import Error, InvalidInput, Unsupported, complain
from sheetsplat.io.checks import checked_shape, unreadable
from sheetsplat.io.source import DEFLATE_RATIO, guarded

_LONGEST_METADATA = 1 << 20
_METADATA = (".zarray", ".zattrs", ".zgroup", ".zmetadata", "zarr.json")
_MOST_FILES = 1_000_000
_SLACK = 4096
# Filters that neither run code nor change sizes by much.
_PLAIN = ("bytes", "endian", "transpose", "crc32c", "crc32", "shuffle", "delta", "bitround", "fixedscaleoffset",
          "adler32", "fletcher32")  # fmt: skip
# Compressors whose data say how long they are unpacked, and those with a known ratio.
_PACKED = ("blosc", "zstd", "lz4", "zlib", "gzip")
# Several chunks in a file: that codec, how their list may be stored, and the place of one that is not there.
_SHARDS = "sharding_indexed"
_INDEX_CODECS = (["bytes"], ["bytes", "crc32c"])
_NOWHERE = 2**64 - 1


def metadata_of(path: Path, name: str) -> dict[str, Any]:
    """Return what a file of metadata says, {} where there is none; InvalidInput for anything but an object."""
    file = path / name
    if not file.is_file() or file.is_symlink():
        return {}
    with file.open("rb") as stream:
        text = stream.read(_LONGEST_METADATA + 1)
    found = json.loads(text) if len(text) <= _LONGEST_METADATA else None
    if not isinstance(found, dict):
        raise unreadable(file, "metadata that are no object, or too long", "the metadata of a Zarr array or group")
    return found


def attributes_of(path: Path) -> dict[str, Any]:
    """Return the attributes of an array or a group."""
    newer = metadata_of(path, "zarr.json").get("attributes")
    return newer if isinstance(newer, dict) else metadata_of(path, ".zattrs")


def is_array(path: Path) -> bool:
    """Return whether a folder is an array."""
    return (path / ".zarray").is_file() or metadata_of(path, "zarr.json").get("node_type") == "array"


def below(root: Path, name: object) -> Path:
    """Return a folder inside of the root by its path; InvalidInput for others."""
    parts = str(name).strip("/").split("/")
    if not isinstance(name, str) or any(part in ("", ".", "..") or "\0" in part or "\\" in part for part in parts):
        raise unreadable(root, f"a path {shown(name)}", "the path of an array in this folder")
    return root.joinpath(*parts)


@dataclass(frozen=True)
class Grid:
    """How an array is stored.

    Attributes
    ----------
    shape, dtype
        Of the array.
    chunks
        Samples of a file along each axis.
    pieces
        Samples along each axis of what is unpacked at once: those of a file, or of a chunk in a shard.
    codecs
        Names of the codecs of a piece, the last one the last to pack.
    index_bytes, index_first
        Of a shard the bytes of its list of chunks, and whether this comes first; 0 where a file is one chunk.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    chunks: tuple[int, ...]
    pieces: tuple[int, ...]
    codecs: tuple[str, ...]
    index_bytes: int = 0
    index_first: bool = False

    @classmethod
    def of(cls, path: Path) -> Grid:
        """Return how the metadata of an array say that it is stored.

        Raises InvalidInput for sizes and types that have no meaning here, Unsupported for codecs that are not known.
        """
        older = metadata_of(path, ".zarray")
        newer = metadata_of(path, "zarr.json") if not older else {}
        if newer:
            kind, shape, stored = newer.get("data_type"), newer.get("shape"), newer.get("codecs") or []
            chunks = ((newer.get("chunk_grid") or {}).get("configuration") or {}).get("chunk_shape")
        else:
            kind, shape, chunks = older.get("dtype"), older.get("shape"), older.get("chunks")
            packer = older.get("compressor")
            stored = [{"name": one.get("id")} for one in [*(older.get("filters") or []), *([packer] if packer else [])]]
        try:
            dtype = np.dtype(kind) if isinstance(kind, str) else None
        except (TypeError, ValueError, SyntaxError):
            dtype = None
        if dtype is None or dtype.kind not in "biuf":
            raise unreadable(
                path, f"samples of type {shown(kind)}", "integers, booleans or real floating-point numbers"
            )
        sizes = checked_shape(path, shape, "shape"), checked_shape(path, chunks, "chunks")
        if len(sizes[0]) != len(sizes[1]):
            raise unreadable(path, f"chunks of {len(sizes[1])} axes", f"{len(sizes[0])}, as the array has")
        names = _names(stored)
        if names != [_SHARDS]:
            return cls(sizes[0], dtype, sizes[1], sizes[1], _checked(path, names))
        return cls(sizes[0], dtype, sizes[1], *_shard(path, stored[0].get("configuration") or {}, sizes[1]))

    @property
    def piece_bytes(self) -> int:
        """Bytes of what is unpacked at once."""
        return math.prod(self.pieces) * self.dtype.itemsize


def _names(codecs: Iterable[Any]) -> list[str]:
    return [str(one.get("name", "")) for one in codecs]


def _checked(path: Path, names: list[str]) -> tuple[str, ...]:
    """Return the names of codecs; Unsupported for those that are not known."""
    for name in names:
        if name.removeprefix("numcodecs.") not in (*_PLAIN, *_PACKED):
            known = ", ".join((*_PACKED, *_PLAIN))
            raise complain(f"{path} cannot be read", f"the codec {shown(name)}", f"one of {known}", kind=Unsupported)
    return tuple(names)


def _shard(path: Path, told: Any, chunks: tuple[int, ...]) -> tuple[tuple[int, ...], tuple[str, ...], int, bool]:
    """Return the last four entries of a `Grid` with several chunks in a file."""
    inner = checked_shape(path, told.get("chunk_shape"), "chunks of a shard")
    if len(inner) != len(chunks) or any(a % b for a, b in zip(chunks, inner, strict=True)):
        raise unreadable(path, f"chunks of {inner} in shards of {chunks}", "chunks that fill a shard")
    index = _names(told.get("index_codecs") or [])
    if index not in _INDEX_CODECS:
        wanted = " or ".join(", ".join(one) for one in _INDEX_CODECS)
        raise complain(f"{path} cannot be read", f"lists of chunks stored by {index}", wanted, kind=Unsupported)
    count = math.prod(a // b for a, b in zip(chunks, inner, strict=True))
    size = 16 * count + 4 * (len(index) - 1)
    return inner, _checked(path, _names(told.get("codecs") or [])), size, told.get("index_location", "end") == "start"


def _unpacked_size(codec: str, stream: BinaryIO, count: int, most: int) -> int:
    """Return how long a chunk says that it unpacks to; of deflated ones how long it does, not beyond `most` + 1."""
    if codec in ("zlib", "gzip"):
        # Both headers are recognized.
        return len(zlib.decompressobj(47).decompress(stream.read(count), most + 1))
    head = stream.read(min(18, count))
    if codec == "blosc":
        return int(struct.unpack_from("<I", head, 4)[0]) if len(head) >= 16 else 0
    if codec == "lz4":
        return int(struct.unpack_from("<I", head)[0]) if len(head) >= 4 else 0
    return _frame_size(head)


def _blosc_size(head: bytes) -> int:
    """Return how long a chunk of Blosc says that it is; its library reads so far, whatever there is."""
    return int(struct.unpack_from("<I", head, 12)[0]) if len(head) >= 16 else 16


def _frame_size(head: bytes) -> int:
    """Return the size that the header of a zstd frame states (RFC 8878, section 3.1.1.1); 2^62 where it does not."""
    if len(head) < 6 or head[:4] != b"\x28\xb5\x2f\xfd":
        return 0
    flags = head[4]
    single, width = flags & 0x20, (0, 2, 4, 8)[flags >> 6]
    if not width and single:
        width = 1
    at = 5 + (0 if single else 1) + (0, 1, 2, 4)[flags & 3]
    if not width or len(head) < at + width:
        return 2**62
    return int.from_bytes(head[at : at + width], "little") + (256 if width == 2 else 0)


@dataclass(frozen=True)
class _ChunkCheck:
    """What files of an array may hold: pieces of `most` bytes, packed by a codec or not."""

    path: Path
    grid: Grid
    packer: str
    most: int
    much: int

    @classmethod
    def of(cls, path: Path, grid: Grid) -> _ChunkCheck:
        """Return the check of an array."""
        packers = [name.removeprefix("numcodecs.") for name in grid.codecs if name not in _PLAIN]
        most = 2 * grid.piece_bytes + _SLACK
        # What deflate may unpack to at most is looked at only where that would be much.
        return cls(path, grid, packers[-1] if packers else "", most, max(most, _memory.available() // 4))

    def check(self, where: str) -> None:
        """Raise InvalidInput for a file that unpacks to more than it should."""
        size = self._regular(where)
        if not self.grid.index_bytes:
            self._check_size(where, size)
            if self.packer:
                with open(where, "rb") as stream:
                    self._check_piece(where, stream, 0, size)
            return
        with open(where, "rb") as stream:
            for first, count in self._pieces_of(where, stream, size):
                self._check_size(where, count)
                if self.packer:
                    self._check_piece(where, stream, first, count)

    def _check_size(self, where: str, size: int) -> None:
        if size > self.most:
            raise self._wrong(where, f"of {size} bytes", f"at most {self.most}")

    def _pieces_of(self, where: str, stream: BinaryIO, size: int) -> list[tuple[int, int]]:
        """Return the first byte and the length of each chunk that a shard has (Zarr's sharding codec)."""
        length = self.grid.index_bytes
        stream.seek(0 if self.grid.index_first else max(0, size - length))
        index = stream.read(length)
        if len(index) < length:
            raise self._wrong(where, f"of {size} bytes", f"at least {length}, for the list of its chunks")
        places = np.frombuffer(index, "<u8", length // 16 * 2).reshape(-1, 2)
        found = [(int(first), int(count)) for first, count in places if (first, count) != (_NOWHERE, _NOWHERE)]
        for first, count in found:
            if first + count > size:
                raise self._wrong(where, f"of bytes {first} to {first + count}", f"one inside of {size} bytes")
        return found

    def _check_piece(self, where: str, stream: BinaryIO, first: int, size: int) -> None:
        if self.packer in ("zlib", "gzip") and size * DEFLATE_RATIO <= self.much:
            return
        stream.seek(first)
        if self.packer == "blosc" and (stated := _blosc_size(stream.read(min(16, size)))) > size:
            raise self._wrong(where, f"of {size} bytes", f"{stated}, as its header says")
        stream.seek(first)
        found = _unpacked_size(self.packer, stream, size, self.most)
        if found > self.most:
            raise self._wrong(where, f"that unpacks to {found} bytes or more", f"at most {self.most}")

    def _regular(self, where: str) -> int:
        """Return the size of a file; InvalidInput for pipes and devices, which would be waited for."""
        found = os.stat(where)
        if not stat.S_ISREG(found.st_mode):
            raise unreadable(self.path, f"{where}, which is no regular file", "a file")
        return found.st_size

    def _wrong(self, where: str, found: str, wanted: str) -> Error:
        # Whoever reads a part of the array says what of it, not which file that is.
        return unreadable(self.path, f"a chunk {found}, {where}", wanted)

    def metadata(self) -> None:
        """Check what Zarr reads of the array beside its chunks."""
        for name in _METADATA:
            where = os.path.join(self.path, name)
            if os.path.lexists(where):
                self._regular(where)

    def all(self) -> None:
        """Check every file of the array; InvalidInput for links."""
        count = 0
        for folder, names, files in os.walk(self.path):
            for name in (*names, *files):
                count += 1
                if count > _MOST_FILES:
                    raise unreadable(self.path, f"more than {_MOST_FILES} files", "larger chunks")
                if os.path.islink(os.path.join(folder, name)):
                    raise self._link(name)
            for name in files:
                if name not in _METADATA:
                    self.check(os.path.join(folder, name))

    def these(self, keys: Iterable[str]) -> None:
        """Check the chunks of some keys, where they are there; InvalidInput for links."""
        root = os.path.realpath(self.path)
        for key in keys:
            where = os.path.join(root, *key.split("/"))
            if os.path.realpath(where) != where:
                raise self._link(key)
            if os.path.exists(where):
                self.check(where)

    def _link(self, name: str) -> Error:
        return unreadable(self.path, f"a link, {shown(name)}", "chunks in the folder itself")


def _chunk_keys(path: Path, ranges: Iterable[range]) -> Iterable[str]:
    """Return the keys of chunks by their numbers along each axis (specifications 2 and 3)."""
    older = metadata_of(path, ".zarray")
    if older:
        start, between = "", older.get("dimension_separator", ".")
    else:
        stated = metadata_of(path, "zarr.json").get("chunk_key_encoding") or {}
        is_default = stated.get("name", "default") == "default"
        start = "c" if is_default else ""
        between = (stated.get("configuration") or {}).get("separator", "/" if is_default else ".")
    if between not in (".", "/"):
        raise unreadable(path, f"the separator {shown(between)} of chunk keys", "a point or a slash")
    for numbers in itertools.product(*ranges):
        yield between.join(([start] if start else []) + [str(number) for number in numbers])


def read_array(path: Path, index: tuple[int | slice, ...]) -> NDArray[Any]:
    """Return a part of an array after all checks; of a part only those of the chunks that hold it.

    `index` has a number, or a slice with the step 1, for each axis.
    """
    import zarr  # type: ignore[import-not-found, unused-ignore]

    grid = Grid.of(path)
    check = _ChunkCheck.of(path, grid)
    steps = [one.indices(size) if isinstance(one, slice) else (one, one + 1, 1)
             for one, size in zip(index, grid.shape, strict=True)]  # fmt: skip
    # The chunks at the border of a part are read whole.
    count = math.prod(last - first for first, last, _ in steps) + math.prod(grid.pieces)
    _memory.require(2 * count * grid.dtype.itemsize, f"the samples of {path}")
    touched = [range(first // chunk, (last - 1) // chunk + 1)
               for (first, last, _), chunk in zip(steps, grid.chunks, strict=True)]  # fmt: skip
    if all(isinstance(one, int) or one.indices(size) == (0, size, 1)
           for one, size in zip(index, grid.shape, strict=True)):  # fmt: skip
        check.all()
    else:
        check.these(_chunk_keys(path, touched))
    check.metadata()
    store = zarr.storage.LocalStore(path, read_only=True)
    array = zarr.open_array(store=store, mode="r")
    try:
        return np.asarray(array[index])
    except (MemoryError, ImportError):
        raise
    except Exception:
        # Zarr does not say which one it was.
        for numbers, key in zip(itertools.product(*touched), _chunk_keys(path, touched), strict=True):
            places = zip(numbers, grid.chunks, strict=True)
            try:
                with guarded(path):
                    array[tuple(slice(at * size, (at + 1) * size) for at, size in places)]
            except InvalidInput as error:
                raise unreadable(path, f"{error.found} in {path / key}", error.wanted, error.advice) from error
        raise
