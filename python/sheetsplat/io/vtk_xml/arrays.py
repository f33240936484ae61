"""The numbers of a DataArray: text, base64 or raw, inline or appended, packed by zlib or LZMA.

Sizes are checked before memory is taken, and packed blocks yield no more than they announce.
"""

from __future__ import annotations

import base64
import lzma
import warnings
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import shown
from sheetsplat.errors import Error, Unsupported, complain
from sheetsplat.io.checks import unreadable
from sheetsplat.io.source import DEFLATE_RATIO, Source
from sheetsplat.io.vtk_xml.document import DataArray, Document

TYPES = {
    "Int8": "i1",
    "UInt8": "u1",
    "Int16": "i2",
    "UInt16": "u2",
    "Int32": "i4",
    "UInt32": "u4",
    "Int64": "i8",
    "UInt64": "u8",
    "Float32": "f4",
    "Float64": "f8",
}
# Characters that one number takes as text, and what arrays have besides.
_LONGEST_WORD = 64
_SLACK = 1 << 16


class _Bytes:
    """Bytes of one array: raw, or base64 whose pieces are encoded separately."""

    def __init__(self, take: Callable[[int], bytes], *, encoded: bool) -> None:
        self._take, self._encoded = take, encoded
        self._left = b""

    def read(self, count: int) -> bytes:
        """Return the next bytes, fewer where there are no more."""
        if not self._encoded:
            return self._take(count)
        missing = count - len(self._left)
        if missing > 0:
            text = self._take(4 * -(-missing // 3))
            self._left += base64.b64decode(text, validate=True)
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
        dtype = np.dtype(self._document.order + TYPES[one.type])
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
            values = self._numbers(dtype, text) if one.format == "ascii" else self._inline(one, dtype, count, text)
        if count is not None and values.size != count:
            raise self._fail(f"{values.size} numbers in the array {shown(one.name)}", f"{count}")
        return values.reshape(-1, one.components) if one.components > 1 else values

    def _numbers(self, dtype: np.dtype[Any], text: bytes) -> NDArray[Any]:
        with warnings.catch_warnings(), np.errstate(over="ignore"):
            warnings.simplefilter("error", DeprecationWarning)
            kind = np.dtype(np.float64) if dtype.kind == "f" else np.dtype(np.int64)
            return np.fromstring(text.decode("ascii"), dtype=kind, sep=" ").astype(dtype.newbyteorder("="))

    def _inline(self, one: DataArray, dtype: np.dtype[Any], count: int | None, text: bytes) -> NDArray[Any]:
        text = b"".join(text.split())
        position = 0

        def take(size: int) -> bytes:
            nonlocal position
            position += size
            return text[position - size : position]

        return self._unpacked(one, dtype, count, _Bytes(take, encoded=True), len(text))

    def _appended(self, one: DataArray, dtype: np.dtype[Any], count: int | None) -> NDArray[Any]:
        if not self._document.appended:
            raise self._fail(f"the array {shown(one.name)} in appended data", "AppendedData, which the file has not")
        self._source.seek(self._document.start + one.offset)
        left = self._source.at_most()

        def take(size: int) -> bytes:
            if size > left:
                raise self._cut(one, size)
            return self._source.stream.read(size)

        return self._unpacked(one, dtype, count, _Bytes(take, encoded=self._document.appended == "base64"), left)

    def _cut(self, one: DataArray, size: int) -> Error:
        return self._fail(
            f"an end of the file inside the array {shown(one.name)}", f"{size} more bytes", "fetch it again"
        )

    def _read(self, one: DataArray, stream: _Bytes, size: int) -> bytes:
        data = stream.read(size)
        if len(data) < size:
            raise self._cut(one, size - len(data))
        return data

    def _unpacked(
        self, one: DataArray, dtype: np.dtype[Any], count: int | None, stream: _Bytes, bound: int
    ) -> NDArray[Any]:
        header = self._document.header
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
            # The length of a packed block stands in the header, which must be in the file.
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
            raise complain(
                f"{self._path} cannot be read",
                f"data packed by {shown(compressor)}",
                "zlib, LZMA, or none",
                "write it again with one of these",
                kind=Unsupported,
            )
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
