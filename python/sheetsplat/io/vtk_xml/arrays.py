"""The numbers of a DataArray: text, base64 or raw, inline or appended, packed by zlib or LZMA.

Sizes are checked before memory is taken, and packed blocks yield no more than they announce.
"""

from __future__ import annotations

import base64
import io
import lzma
import warnings
import zlib
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import shown
from sheetsplat.errors import Error, Unsupported, complain
from sheetsplat.io.checks import unreadable
from sheetsplat.io.source import DEFLATE_RATIO, Source
from sheetsplat.io.vtk_xml.document import DataArray, Document

_NAMES = "Int8 UInt8 Int16 UInt16 Int32 UInt32 Int64 UInt64 Float32 Float64"
TYPES = {name: name.lower() for name in _NAMES.split()}
# Characters that one number takes as text, and what arrays have besides.
_LONGEST_WORD = 64
_SLACK = 1 << 16


class _Bytes:
    """Bytes of one array: raw, or base64 whose pieces are encoded separately; at most `bound` are read at once."""

    def __init__(self, stream: BinaryIO, bound: int, *, encoded: bool) -> None:
        self._stream, self.bound, self._encoded = stream, bound, encoded
        self._left = b""

    def _take(self, count: int) -> bytes:
        return self._stream.read(count) if count <= self.bound else b""

    def read(self, count: int) -> bytes:
        """Return the next bytes, fewer where there are no more."""
        if not self._encoded:
            return self._take(count)
        missing = count - len(self._left)
        if missing > 0:
            self._left += base64.b64decode(self._take(4 * -(-missing // 3)), validate=True)
        data, self._left = self._left[:count], self._left[count:]
        return data

    def next_part(self) -> None:
        """Go to the next piece."""
        self._left = b""


class ArrayReader:
    """Reads the arrays of a document."""

    def __init__(self, source: Source, document: Document) -> None:
        self._source, self._document, self._path = source, document, source.path

    def _fail(self, found: str, wanted: str, advice: str = "") -> Error:
        return unreadable(self._path, found, wanted, advice)

    def array(self, one: DataArray, count: int | None) -> NDArray[Any]:
        """Return the numbers of an array, in its own type; `count` None: as many as there are."""
        if one.type not in TYPES:
            raise self._fail(f"the array {shown(one.name)} of type {shown(one.type)}", "one of: " + ", ".join(TYPES))
        dtype = np.dtype(TYPES[one.type]).newbyteorder(self._document.order)  # type: ignore[arg-type]
        if count is not None:
            count *= one.components
            _memory.require(2 * count * max(8, dtype.itemsize), f"the array {one.name!r} of {self._path}")
        if one.format == "appended":
            values = self._appended(one, dtype, count)
        else:
            if count is not None and one.length > _LONGEST_WORD * count + _SLACK:
                raise self._fail(f"{one.length} characters of the array {shown(one.name)}", f"{count} numbers")
            _memory.require(8 * one.length, f"the array {one.name!r} of {self._path}")
            text = b"".join(one.text)
            if one.format == "ascii":
                values = self._numbers(dtype, text)
            else:
                text = b"".join(text.split())
                values = self._unpacked(one, dtype, count, _Bytes(io.BytesIO(text), len(text), encoded=True))
        if count is not None and values.size != count:
            raise self._fail(f"{values.size} numbers in the array {shown(one.name)}", f"{count}")
        return values.reshape(-1, one.components) if one.components > 1 else values

    def _numbers(self, dtype: np.dtype[Any], text: bytes) -> NDArray[Any]:
        with warnings.catch_warnings(), np.errstate(over="ignore"):
            warnings.simplefilter("error", DeprecationWarning)
            kind = np.dtype(np.float64) if dtype.kind == "f" else np.dtype(np.int64)
            return np.fromstring(text.decode("ascii"), dtype=kind, sep=" ").astype(dtype.newbyteorder("="))

    def _appended(self, one: DataArray, dtype: np.dtype[Any], count: int | None) -> NDArray[Any]:
        if not self._document.appended:
            raise self._fail(f"the array {shown(one.name)} in appended data", "AppendedData, which the file has not")
        self._source.stream.seek(self._document.start + one.offset)
        encoded = self._document.appended == "base64"
        stream = _Bytes(self._source.stream, self._source.at_most(), encoded=encoded)
        return self._unpacked(one, dtype, count, stream)

    def _cut(self, one: DataArray, size: int) -> Error:
        return self._fail(
            f"an end of the file inside the array {shown(one.name)}", f"{size} more bytes", "fetch it again"
        )

    def _read(self, one: DataArray, stream: _Bytes, size: int) -> bytes:
        data = stream.read(size)
        if len(data) < size:
            raise self._cut(one, size - len(data))
        return data

    def _unpacked(self, one: DataArray, dtype: np.dtype[Any], count: int | None, stream: _Bytes) -> NDArray[Any]:
        header, bound = self._document.header, stream.bound
        packed = bool(self._document.compressor)
        wanted = None if count is None else count * dtype.itemsize

        def numbers(amount: int) -> list[int]:
            return [int(part) for part in np.frombuffer(self._read(one, stream, amount * header.itemsize), header)]

        if not packed:
            (size,) = numbers(1)
            self._check_size(one, size, wanted, bound)
            data = self._read(one, stream, size)
        else:
            blocks, each, last = numbers(3)
            # The lengths of all blocks must be in the file.
            if blocks * header.itemsize > bound:
                raise self._cut(one, blocks * header.itemsize)
            size = 0 if blocks == 0 else (blocks - 1) * each + (last or each)
            self._check_size(one, size, wanted, bound * DEFLATE_RATIO if wanted is None else None)
            lengths = numbers(blocks)
            if sum(lengths) > bound:
                raise self._cut(one, sum(lengths))
            stream.next_part()
            data = self._blocks(one, stream, lengths, each, last or each)
        if len(data) % dtype.itemsize:
            raise self._fail(f"{len(data)} bytes of the array {shown(one.name)}", f"whole numbers of type {one.type}")
        return np.frombuffer(data, dtype)

    def _check_size(self, one: DataArray, size: int, wanted: int | None, bound: int | None) -> None:
        if wanted is not None and size != wanted:
            raise self._fail(f"{size} bytes of the array {shown(one.name)}", f"{wanted} bytes, as its piece says")
        if bound is not None and size > bound:
            raise self._cut(one, size)
        _memory.require(2 * size, f"the array {one.name!r} of {self._path}")

    def _blocks(self, one: DataArray, stream: _Bytes, lengths: list[int], each: int, last: int) -> bytes:
        compressor = self._document.compressor
        if compressor not in ("vtkZLibDataCompressor", "vtkLZMADataCompressor"):
            what, advice = f"{self._path} cannot be read", "write it again with one of these"
            found = f"data packed by {shown(compressor)}"
            raise complain(what, found, "zlib, LZMA, or none", advice, kind=Unsupported)
        parts: list[bytes] = []
        for number, length in enumerate(lengths):
            size = last if number == len(lengths) - 1 else each
            data = self._read(one, stream, length)
            if compressor == "vtkZLibDataCompressor":
                unpack = zlib.decompressobj()
                block = unpack.decompress(data, size) if size else b""
            else:
                block = lzma.LZMADecompressor().decompress(data, size)
            if len(block) != size:
                raise self._fail(f"a block of {len(block)} bytes in {shown(one.name)}", f"{size} bytes, as it says")
            parts.append(block)
        return b"".join(parts)
