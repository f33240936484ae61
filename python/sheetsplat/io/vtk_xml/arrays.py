"""The numbers of a DataArray: text, base64 or raw, inline or appended, packed by zlib or LZMA.

Sizes are checked before memory is taken, and packed blocks yield no more than they announce.
"""

from __future__ import annotations

import base64
import io
import lzma
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import shown
from sheetsplat.errors import Error, Unsupported, complain
from sheetsplat.io.checks import natural, numbers_in_text, unreadable
from sheetsplat.io.scalars import choose_scalar, column_of, scalar_names
from sheetsplat.io.source import Source
from sheetsplat.io.vtk_cells import GHOSTS, OWN_ARRAYS
from sheetsplat.io.vtk_xml.document import DataArray, Document, Piece

_NAMES = "Int8 UInt8 Int16 UInt16 Int32 UInt32 Int64 UInt64 Float32 Float64"
TYPES = {name: name.lower() for name in _NAMES.split()}
# Of cells, vtkDataSetAttributes: DUPLICATECELL and HIDDENCELL.
_LEFT_OUT = 1 | 32
# Most characters of a number as text, and a margin for other text of an array.
_LONGEST_WORD = 64
_SLACK = 1 << 16


@dataclass(frozen=True)
class Chosen:
    """The scalar that is shown: its element (PointData or CellData), its name, its array, its column, and all names.

    `components` is how many columns its array has.
    """

    where: str
    name: str
    base: str
    column: int | None
    components: int
    known: tuple[str, ...]

    @property
    def of_cells(self) -> bool:
        """Return whether it belongs to the cells."""
        return self.where == "CellData"


def pick_scalar(path: Path, piece: Piece, scalar: str | None) -> Chosen:
    """Return the scalar to show of those that a piece has: that with this name, or the active one, or the first."""
    owners: dict[str, str] = {}
    widths: dict[str, int] = {}
    for where in ("PointData", "CellData"):
        for one in piece.arrays.get(where, []):
            if one.type in TYPES and one.name and one.name not in widths and one.name not in OWN_ARRAYS:
                owners[one.name], widths[one.name] = where, one.components
    preferred = [piece.chosen[role] for role in ("PointData Scalars", "CellData Scalars") if role in piece.chosen]
    name, base, column = choose_scalar(path, scalar, preferred, widths)
    return Chosen(owners[base], name, base, column, widths[base], scalar_names(widths))


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

    def count(self, piece: Piece, name: str) -> int:
        """Return a number of points or cells that a piece declares, 0 unless it does."""
        return natural(self._path, name, piece.attributes.get(name, "0").strip())

    def named(self, piece: Piece, where: str, name: str, count: int) -> NDArray[Any]:
        """Return the numbers of an array of a piece by its element (PointData, Cells ...) and its name."""
        for one in piece.arrays.get(where, []):
            if one.name == name:
                return self.array(one, count)
        found = f"a Piece whose {where} has no array {shown(name)}"
        raise self._fail(found, "the same arrays in every Piece")

    def scalar(self, piece: Piece, chosen: Chosen, count: int) -> NDArray[Any]:
        """Return the scalar of a piece, (count,): in the file's own type where it is a whole array."""
        rows = self.named(piece, chosen.where, chosen.base, count)
        if rows.size != count * chosen.components:
            found = f"{rows.size // max(count, 1)} components of the array {shown(chosen.base)}"
            raise self._fail(found, f"{chosen.components}, as other pieces have")
        return rows if chosen.components == 1 else column_of(rows, chosen.column)

    def ghosts(self, piece: Piece, count: int) -> NDArray[np.bool_] | None:
        """Return which cells of a piece stand for those of another one, or are hidden; None where it does not say."""
        for one in piece.arrays.get("CellData", []):
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
            if one.length > _LONGEST_WORD * count + _SLACK:
                raise self._fail(f"{one.length} characters of the array {shown(one.name)}", f"{count} numbers")
            _memory.require(8 * one.length, f"the array {one.name!r} of {self._path}")
            text = b"".join(one.text)
            if one.format == "ascii":
                values = numbers_in_text(text, dtype)
            else:
                text = b"".join(text.split())
                values = self._unpacked(one, dtype, count, _Bytes(io.BytesIO(text), len(text), encoded=True))
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
