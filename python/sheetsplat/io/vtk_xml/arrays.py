"""The numbers of a DataArray: text, base64 or raw, inline or appended, packed by zlib or LZMA.

Sizes are checked before memory is taken, and packed blocks yield no more than they announce.
"""

from __future__ import annotations

import base64
import io
import lzma
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import shown
from sheetsplat.errors import Error, Unsupported, complain
from sheetsplat.io.checks import natural, numbers_in_text, unreadable
from sheetsplat.io.source import Source
from sheetsplat.io.vtk_grids import GHOSTS, Picked, pick
from sheetsplat.io.vtk_xml.document import DataArray, Document, arrays_of

_NAMES = "Int8 UInt8 Int16 UInt16 Int32 UInt32 Int64 UInt64 Float32 Float64"
TYPES = {name: name.lower() for name in _NAMES.split()}
#: Elements with the arrays of points and cells.
OWNERS = ("PointData", "CellData")
# Of cells, vtkDataSetAttributes: DUPLICATECELL and HIDDENCELL.
_LEFT_OUT = 1 | 32
# Most characters of a number as text, and a margin for other text of an array.
_LONGEST_WORD = 64
_SLACK = 1 << 16


def pick_scalar(path: Path, owner: Element, scalar: str | None, prefix: str = "") -> Picked:
    """Return the scalar to show of those that a piece has, or a file declares: the active one unless named."""
    preferred = [one.get("Scalars", "") for name in OWNERS for one in owner.findall(prefix + name)]

    def arrays() -> Iterator[tuple[str, bool, int, str]]:
        for of_cells, where in enumerate(OWNERS):
            for one in arrays_of(path, owner, where, prefix):
                if one.type in TYPES:
                    yield one.name, bool(of_cells), one.components, where

    return pick(path, arrays(), preferred, scalar)


class _Bytes:
    """Bytes of one array: raw, or base64 whose pieces are encoded separately; at most `bound` are read at once."""

    def __init__(self, stream: BinaryIO, bound: int, *, encoded: bool) -> None:
        self._stream, self._bound, self._encoded = stream, bound, encoded
        self._left = b""

    def _take(self, count: int) -> bytes:
        return self._stream.read(count) if count <= self._bound else b""

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
    """Finds and reads the arrays of a document's pieces."""

    def __init__(self, source: Source, document: Document) -> None:
        self._source, self._document, self._path = source, document, source.path

    def _fail(self, found: str, wanted: str, advice: str = "") -> Error:
        return unreadable(self._path, found, wanted, advice)

    def arrays(self, piece: Element, where: str) -> list[DataArray]:
        """Return what an element of a piece (PointData, Cells ...) declares."""
        return arrays_of(self._path, piece, where)

    def count(self, piece: Element, name: str) -> int:
        """Return a number of points or cells that a piece declares, 0 unless it does."""
        return natural(self._path, name, piece.get(name, "0").strip())

    def named(self, piece: Element, where: str, name: str, count: int) -> NDArray[Any]:
        """Return the numbers of an array of a piece by its element and its name."""
        for one in self.arrays(piece, where):
            if one.name == name:
                return self.array(one, count)
        found = f"a Piece whose {where} has no array {shown(name)}"
        raise self._fail(found, "the same arrays in every Piece")

    def scalar(self, piece: Element, picked: Picked, count: int) -> NDArray[Any]:
        """Return the scalar of a piece, (count,): in the file's own type where it is a whole array."""
        rows = self.named(piece, picked.array, picked.base, count)
        if rows.size != count * picked.columns:
            found = f"{rows.size // max(count, 1)} components of the array {shown(picked.base)}"
            raise self._fail(found, f"{picked.columns}, as other pieces have")
        return picked.of(rows)

    def ghosts(self, piece: Element, count: int) -> NDArray[np.bool_] | None:
        """Return which cells of a piece stand for those of another one, or are hidden; None where it does not say."""
        for one in self.arrays(piece, "CellData"):
            if one.name == GHOSTS:
                marks = self.array(one, count).reshape(-1).astype(np.int64)
                return np.asarray(marks & _LEFT_OUT, dtype=np.bool_)
        return None

    def array(self, one: DataArray, count: int) -> NDArray[Any]:
        """Return the numbers of an array in its own type, in `count` rows."""
        if one.type not in TYPES:
            raise self._fail(f"the array {shown(one.name)} of type {shown(one.type)}", "one of: " + ", ".join(TYPES))
        dtype = np.dtype(TYPES[one.type]).newbyteorder(self._document.order)  # type: ignore[arg-type]
        count *= one.components
        _memory.require(2 * count * max(8, dtype.itemsize), f"the array {one.name!r} of {self._path}")
        if one.format == "appended":
            values = self._appended(one, dtype, count)
        else:
            text = one.text
            if len(text) > _LONGEST_WORD * count + _SLACK:
                raise self._fail(f"{len(text)} characters of the array {shown(one.name)}", f"{count} numbers")
            _memory.require(8 * len(text), f"the array {one.name!r} of {self._path}")
            data = text.encode("ascii", "replace")
            if one.format == "ascii":
                values = numbers_in_text(data, dtype)
            else:
                data = b"".join(data.split())
                values = self._unpacked(one, dtype, count, _Bytes(io.BytesIO(data), len(data), encoded=True))
        if values.size != count:
            raise self._fail(f"{values.size} numbers in the array {shown(one.name)}", f"{count}")
        return values.reshape(-1, one.components) if one.components > 1 else values

    def _appended(self, one: DataArray, dtype: np.dtype[Any], count: int) -> NDArray[Any]:
        if not self._document.appended:
            raise self._fail(f"the array {shown(one.name)} in appended data", "AppendedData, which the file has not")
        self._source.stream.seek(self._document.start + one.offset)
        encoded = self._document.appended == "base64"
        stream = _Bytes(self._source.stream, self._source.at_most(), encoded=encoded)
        return self._unpacked(one, dtype, count, stream)

    def _read(self, one: DataArray, stream: _Bytes, size: int) -> bytes:
        data = stream.read(size)
        if len(data) < size:
            found = f"an end of the file inside the array {shown(one.name)}"
            raise self._fail(found, f"{size - len(data)} more bytes", "fetch it again")
        return data

    def _unpacked(self, one: DataArray, dtype: np.dtype[Any], count: int, stream: _Bytes) -> NDArray[Any]:
        header, packed = self._document.header, bool(self._document.compressor)

        def numbers(amount: int) -> list[int]:
            return [int(part) for part in np.frombuffer(self._read(one, stream, amount * header.itemsize), header)]

        # The number of blocks, the bytes of each, and of the last one where that is shorter.
        blocks, each, last = numbers(3) if packed else (1, *numbers(1), 0)
        size = (blocks - 1) * each + (last or each) if blocks else 0
        if size != count * dtype.itemsize:
            wanted = f"{count * dtype.itemsize} bytes, as its piece says"
            raise self._fail(f"{size} bytes of the array {shown(one.name)}", wanted)
        if not packed:
            return np.frombuffer(self._read(one, stream, size), dtype)
        lengths = numbers(blocks)
        stream.next_part()
        return np.frombuffer(self._blocks(one, stream, lengths, each, last or each), dtype)

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
