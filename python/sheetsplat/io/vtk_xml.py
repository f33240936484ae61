"""VTK's XML files: unstructured meshes (.vtu), surfaces (.vtp) and images (.vti).

Numbers may be text, base64 or raw, within the XML or appended, packed by zlib or LZMA. The XML may declare no entities
and no document type, sizes are judged before memory is taken, and packed blocks yield no more than they announce.
Source: the VTK File Formats document, "XML File Formats".
"""

from __future__ import annotations

import base64
import binascii
import logging
import lzma
import math
import warnings
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import Triple, shown
from sheetsplat.errors import Error, Unsupported, complain
from sheetsplat.io.scattered import (
    Floats,
    Scattered,
    choose_scalar,
    column_of,
    finite_points,
    finite_values,
    require_rows,
    scalar_names,
    unreadable,
)
from sheetsplat.io.source import _DAMAGED, Source, checked_shape
from sheetsplat.io.volume import Volume

_TYPES = {
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
_KINDS = {"UnstructuredGrid": "vtu", "PolyData": "vtp", "ImageData": "vti"}
_CHUNK = 1 << 20
_APPENDED = b"<AppendedData"
_MOST_ELEMENTS = 100_000
# Elements around a DataArray: VTKFile, the kind, Piece, and PointData or the like.
_ARRAY_DEPTH = 4
# Characters that one number takes as text, and what arrays have besides.
_LONGEST_WORD = 64
_SLACK = 1 << 16
# One byte of deflate stands for at most this many.
_DEFLATE = 1032

_log = logging.getLogger("sheetsplat")


# Corners of the cells that fill a volume, by VTK's number of their type, in the order of its hexahedron.
_VOLUMES = {
    10: (0, 1, 2, 3),
    11: (0, 1, 3, 2, 4, 5, 7, 6),
    12: (0, 1, 2, 3, 4, 5, 6, 7),
    13: (0, 1, 2, 3, 4, 5),
    14: (0, 1, 2, 3, 4),
}
# The last type that is a point, a line or flat, of the linear ones.
_FLAT = 9


@dataclass(frozen=True)
class _Cells:
    """Point numbers of all cells, one cell after another, where each ends, and their types (none: flat)."""

    connectivity: NDArray[np.int64]
    ends: NDArray[np.int64]
    types: NDArray[np.int64]

    def sizes(self) -> NDArray[np.int64]:
        """Return how many points each cell has."""
        return np.diff(self.ends, prepend=0)


@dataclass
class _Array:
    """A DataArray: what its element says, and its text where that is where the numbers are."""

    name: str
    type: str
    components: int
    format: str
    offset: int
    tuples: int | None
    text: list[bytes] = field(default_factory=list)
    length: int = 0


@dataclass
class _Piece:
    """A Piece: its attributes, and its arrays by the element that they stand in."""

    attributes: dict[str, str]
    arrays: dict[str, list[_Array]] = field(default_factory=dict)
    chosen: dict[str, str] = field(default_factory=dict)


@dataclass
class _Document:
    kind: str
    order: str
    header: np.dtype[Any]
    compressor: str
    attributes: dict[str, str]
    pieces: list[_Piece]
    appended: str = ""
    start: int = 0


class _Parser:
    """Turns the XML before the appended data into a document."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._parser = expat.ParserCreate()
        self._parser.buffer_text = True
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._text
        self._parser.StartDoctypeDeclHandler = self._refuse
        self._parser.EntityDeclHandler = self._refuse
        self._stack: list[str] = []
        self._elements = 0
        self._array: _Array | None = None
        self._taken = 0
        self.document: _Document | None = None

    def feed(self, data: bytes, last: bool = False) -> None:
        """Parse more of the file."""
        try:
            self._parser.Parse(data, last)
        except expat.ExpatError as error:
            raise unreadable(self._path, f"damaged XML ({error})", "an XML file of VTK") from None

    def _refuse(self, *_: Any) -> None:
        raise unreadable(self._path, "a document type or an entity of its own", "the plain XML of VTK's files")

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        self._elements += 1
        if self._elements > _MOST_ELEMENTS:
            raise unreadable(self._path, f"more than {_MOST_ELEMENTS} elements", "fewer")
        depth = len(self._stack)
        if depth == 0:
            self._root(name, attributes)
        document = self.document
        assert document is not None
        if depth == 1 and name == document.kind:
            document.attributes = dict(attributes)
        elif depth == 2 and name == "Piece" and self._stack[1] == document.kind:
            document.pieces.append(_Piece(dict(attributes)))
        elif depth == 3 and self._stack[2] == "Piece" and document.pieces:
            document.pieces[-1].arrays.setdefault(name, [])
            for role in ("Scalars", "Vectors"):
                if role in attributes:
                    document.pieces[-1].chosen.setdefault(f"{name} {role}", attributes[role])
        elif depth == _ARRAY_DEPTH and name == "DataArray" and document.pieces and self._stack[2] == "Piece":
            self._array = self._new_array(attributes)
            document.pieces[-1].arrays[self._stack[3]].append(self._array)
        self._stack.append(name)

    def _root(self, name: str, attributes: dict[str, str]) -> None:
        kind = attributes.get("type", "")
        if name != "VTKFile" or kind not in _KINDS:
            found = f"<{shown(name)[1:-1]}>" if name != "VTKFile" else f"a VTK file of type {shown(kind)}"
            then = "save it as one file of one of these types"
            raise unreadable(self._path, found, "a VTK file of type " + ", ".join(_KINDS), then)
        orders = {"LittleEndian": "<", "BigEndian": ">"}
        order = attributes.get("byte_order", "LittleEndian")
        widths = {"UInt32": "u4", "UInt64": "u8"}
        width = attributes.get("header_type", "UInt32")
        if order not in orders or width not in widths:
            raise unreadable(
                self._path,
                f"byte_order {shown(order)}, header_type {shown(width)}",
                "LittleEndian or BigEndian, UInt32 or UInt64",
            )
        self.document = _Document(
            kind, orders[order], np.dtype(orders[order] + widths[width]), attributes.get("compressor", ""), {}, []
        )

    def _new_array(self, attributes: dict[str, str]) -> _Array:
        def whole(name: str, default: int) -> int:
            text = attributes.get(name, "")
            if not text:
                return default
            if not (text.isascii() and text.isdigit() and len(text) < 19):
                raise unreadable(self._path, f"{name} = {shown(text)} of a DataArray", "a number that is not negative")
            return int(text)

        kind = attributes.get("format", "ascii")
        if kind not in ("ascii", "binary", "appended"):
            raise unreadable(self._path, f"format {shown(kind)} of a DataArray", "ascii, binary or appended")
        name = attributes.get("Name", "")
        components = max(1, whole("NumberOfComponents", 1))
        tuples = whole("NumberOfTuples", 0) if "NumberOfTuples" in attributes else None
        return _Array(name, attributes.get("type", ""), components, kind, whole("offset", 0), tuples)

    def _end(self, _: str) -> None:
        self._stack.pop()
        if len(self._stack) == _ARRAY_DEPTH:
            self._array = None

    def _text(self, text: str) -> None:
        # VTK writes information keys with texts of their own into arrays.
        if self._array is None or self._array.format == "appended" or len(self._stack) > _ARRAY_DEPTH + 1:
            return
        data = text.encode("ascii", "replace")
        self._array.text.append(data)
        self._array.length += len(data)
        self._taken += len(data)
        if self._taken > 16 * _CHUNK:
            # The texts are kept until their arrays are made.
            _memory.require(4 * self._array.length, f"the text of {self._path}")
            self._taken = 0


def _parse(source: Source) -> _Document:
    """Return the document, up to the first byte of the appended data, of which nothing is read."""
    parser = _Parser(source.path)
    before = b""
    fed = 0
    try:
        source.seek(0)
        while True:
            piece = source.stream.read(_CHUNK)
            window = before + piece
            at = window.find(_APPENDED)
            if at >= 0:
                window += source.stream.read(4096)
                parser.feed(window[:at])
                document = _checked(source, parser.document)
                return _with_appended(source, document, window[at:], fed + at)
            if not piece:
                parser.feed(window, last=True)
                return _checked(source, parser.document)
            keep = min(len(window), len(_APPENDED) - 1)
            before = window[len(window) - keep :]
            parser.feed(window[: len(window) - keep])
            fed += len(window) - keep
    except _DAMAGED as error:
        raise source.damaged(error) from None


def _checked(source: Source, document: _Document | None) -> _Document:
    if document is None or not document.pieces:
        raise unreadable(source.path, "no Piece", "a VTK file with a Piece of data")
    return document


def _with_appended(source: Source, document: _Document, text: bytes, start: int) -> _Document:
    close = text.find(b">")
    mark = text.find(b"_", close + 1)
    element = text[:close]
    encoding = "base64" if b'"base64"' in element or b"'base64'" in element else "raw"
    if close < 0 or mark < 0 or text[close + 1 : mark].strip():
        raise unreadable(source.path, "appended data without their first character _", "AppendedData of VTK")
    document.appended, document.start = encoding, start + mark + 1
    return document


class _Bytes:
    """Bytes of one array in their order: raw, or base64 whose pieces are encoded each for itself."""

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


class _Reader:
    """Makes arrays of what a document says."""

    def __init__(self, source: Source, document: _Document) -> None:
        self._source, self._document, self._path = source, document, source.path

    def _fail(self, found: str, wanted: str, then: str = "") -> Error:
        return unreadable(self._path, found, wanted, then)

    def array(self, one: _Array, count: int | None) -> NDArray[Any]:
        """Return the numbers of an array, in its own type; `count` None: as many as there are."""
        if one.type not in _TYPES:
            raise self._fail(f"the array {shown(one.name)} of type {shown(one.type)}", "one of: " + ", ".join(_TYPES))
        dtype = np.dtype(self._document.order + _TYPES[one.type])
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
            values = self._numbers(one, dtype, text) if one.format == "ascii" else self._inline(one, dtype, count, text)
        if count is not None and values.size != count:
            raise self._fail(f"{values.size} numbers in the array {shown(one.name)}", f"{count}")
        return values.reshape(-1, one.components) if one.components > 1 else values

    def _numbers(self, one: _Array, dtype: np.dtype[Any], text: bytes) -> NDArray[Any]:
        try:
            with warnings.catch_warnings(), np.errstate(over="ignore"):
                warnings.simplefilter("error", DeprecationWarning)
                kind = np.dtype(np.float64) if dtype.kind == "f" else np.dtype(np.int64)
                return np.fromstring(text.decode("ascii"), dtype=kind, sep=" ").astype(dtype.newbyteorder("="))
        except (ValueError, DeprecationWarning, OverflowError) as error:
            raise self._fail(f"text of the array {shown(one.name)} that is no number ({error})", "numbers") from None

    def _inline(self, one: _Array, dtype: np.dtype[Any], count: int | None, text: bytes) -> NDArray[Any]:
        text = b"".join(text.split())
        position = 0

        def take(size: int) -> bytes:
            nonlocal position
            position += size
            return text[position - size : position]

        return self._unpacked(one, dtype, count, _Bytes(take, encoded=True), len(text))

    def _appended(self, one: _Array, dtype: np.dtype[Any], count: int | None) -> NDArray[Any]:
        if not self._document.appended:
            raise self._fail(f"the array {shown(one.name)} in appended data", "AppendedData, which the file has not")
        self._source.seek(self._document.start + one.offset)
        left = self._source.at_most()

        def take(size: int) -> bytes:
            if size > left:
                raise self._cut(one, size)
            try:
                return self._source.stream.read(size)
            except _DAMAGED as error:
                raise self._source.damaged(error) from None

        return self._unpacked(one, dtype, count, _Bytes(take, encoded=self._document.appended == "base64"), left)

    def _cut(self, one: _Array, size: int) -> Error:
        return self._fail(
            f"an end of the file inside the array {shown(one.name)}", f"{size} more bytes", "fetch it again"
        )

    def _read(self, one: _Array, stream: _Bytes, size: int) -> bytes:
        try:
            data = stream.read(size)
        except Error:
            raise
        except (binascii.Error, ValueError) as error:
            raise self._fail(f"damaged base64 in the array {shown(one.name)} ({error})", "base64") from None
        if len(data) < size:
            raise self._cut(one, size - len(data))
        return data

    def _unpacked(
        self, one: _Array, dtype: np.dtype[Any], count: int | None, stream: _Bytes, bound: int
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
            self._check_size(one, size, wanted, bound * _DEFLATE if wanted is None else None)
            lengths = numbers(blocks)
            if sum(lengths) > bound:
                raise self._cut(one, sum(lengths))
            stream.next_part()
            data = self._blocks(one, stream, lengths, each, last or each)
        if len(data) % dtype.itemsize:
            raise self._fail(f"{len(data)} bytes of the array {shown(one.name)}", f"whole numbers of type {one.type}")
        return np.frombuffer(data, dtype)

    def _check_size(self, one: _Array, size: int, wanted: int | None, bound: int | None) -> None:
        if wanted is not None and size != wanted:
            raise self._fail(f"{size} bytes of the array {shown(one.name)}", f"{wanted} bytes, as its piece says")
        if bound is not None and size > bound:
            raise self._cut(one, size)
        _memory.require(2 * size, f"the array {one.name!r} of {self._path}")

    def _blocks(self, one: _Array, stream: _Bytes, lengths: list[int], each: int, last: int) -> bytes:
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
            try:
                if compressor == "vtkZLibDataCompressor":
                    unpack = zlib.decompressobj()
                    block = unpack.decompress(data, size) if size else b""
                else:
                    block = lzma.LZMADecompressor().decompress(data, size)
            except (zlib.error, lzma.LZMAError, EOFError) as error:
                raise self._source.damaged(error) from None
            if len(block) != size:
                raise self._fail(f"a block of {len(block)} bytes in {shown(one.name)}", f"{size} bytes, as it says")
            parts.append(block)
        return b"".join(parts)


def _count(path: Path, piece: _Piece, name: str) -> int:
    text = piece.attributes.get(name, "0").strip()
    if not (text.isascii() and text.isdigit()) or len(text) > 18:
        raise unreadable(path, f"{name} = {shown(text)}", "a number that is not negative")
    return int(text)


def _widths(piece: _Piece, where: str) -> dict[str, int]:
    known: dict[str, int] = {}
    for one in piece.arrays.get(where, []):
        if one.type in _TYPES and one.name:
            known.setdefault(one.name, one.components)
    return known


def _named(path: Path, piece: _Piece, where: str, name: str) -> _Array:
    for one in piece.arrays.get(where, []):
        if one.name == name:
            return one
    raise unreadable(path, f"a Piece whose {where} has no array {shown(name)}", "the same arrays in every Piece")


def _pick(path: Path, document: _Document, scalar: str | None) -> tuple[str, str, str, int | None, tuple[str, ...]]:
    """Return where the scalar stands (PointData or CellData), its name, its array, its column, and all names."""
    first = document.pieces[0]
    of_points, of_cells = _widths(first, "PointData"), _widths(first, "CellData")
    preferred = [first.chosen[role] for role in ("PointData Scalars", "CellData Scalars") if role in first.chosen]
    both = of_points | {name: width for name, width in of_cells.items() if name not in of_points}
    name, base, column = choose_scalar(path, scalar, preferred, both)
    where = "PointData" if base in of_points else "CellData"
    return where, name, base, column, scalar_names(both)


def _mesh(path: Path, kind: str, reader: _Reader, piece: _Piece, count: int) -> _Cells:
    """Return the cells of a piece; those of a surface in VTK's order: vertices, lines, strips, polygons."""
    if kind == "UnstructuredGrid":
        groups = [("Cells", _count(path, piece, "NumberOfCells"))]
    else:
        groups = [(name, _count(path, piece, f"NumberOf{name}")) for name in ("Verts", "Lines", "Strips", "Polys")]
    lists: list[NDArray[np.int64]] = []
    ends: list[NDArray[np.int64]] = []
    types: list[NDArray[np.int64]] = []
    used = 0
    for group, cells in groups:
        if not cells:
            continue
        # The ends come first, because they say how long the lists are.
        stops = reader.array(_named(path, piece, group, "offsets"), cells).astype(np.int64).reshape(-1)
        if stops.size and (stops[0] < 0 or np.any(np.diff(stops) < 0)):
            raise unreadable(path, f"offsets of {group} that do not rise", "where each cell ends")
        points = reader.array(_named(path, piece, group, "connectivity"), int(stops[-1])).astype(np.int64).reshape(-1)
        if points.size and not (points.min() >= 0 and points.max() < count):
            found = f"cells with the points {int(points.min())} to {int(points.max())}"
            raise unreadable(path, found, f"points 0 to {count - 1}")
        lists.append(points)
        ends.append(stops + used)
        used += points.size
        if group == "Cells":
            types.append(reader.array(_named(path, piece, group, "types"), cells).astype(np.int64).reshape(-1))
    empty = np.empty(0, np.int64)
    return _Cells(*(np.concatenate([empty, *parts]) for parts in (lists, ends, types)))


def _volumes(path: Path, cells: _Cells, offset: int) -> list[NDArray[np.int64]] | None:
    """Return the cells that fill a volume, (M, corners) for each type; None where one is of another type."""
    sizes, found = cells.sizes(), []
    for kind in np.unique(cells.types[cells.types > _FLAT]):
        corners = _VOLUMES.get(int(kind))
        of_kind = np.flatnonzero(cells.types == kind)
        if corners is None:
            _log.info("%s: cells of VTK's type %d are not used, nor is the mesh", path, kind)
            return None
        if np.any(sizes[of_kind] != len(corners)):
            found_size = int(sizes[of_kind][sizes[of_kind] != len(corners)][0])
            raise unreadable(path, f"a cell of type {kind} with {found_size} points", f"{len(corners)} points")
        starts = cells.ends[of_kind] - len(corners)
        found.append(cells.connectivity[starts[:, None] + np.asarray(corners)] + offset)
    return found


def _centroids(points: Floats, cells: _Cells) -> Floats:
    sizes = cells.sizes()
    owner = np.repeat(np.arange(sizes.size), sizes)
    sums = np.stack(
        [np.bincount(owner, points[cells.connectivity, axis], minlength=sizes.size) for axis in range(3)], axis=1
    )
    return np.asarray(sums / np.maximum(sizes, 1)[:, None])


def read_points(source: Source, scalar: str | None = None) -> Scattered:
    """Read a mesh or a surface: its points, a scalar of theirs and its cells.

    The scalar is an array of the points or of the cells, the length of a vector's rows, or one column of it (uvw_x);
    the array that the file itself names as its scalars unless another is named. Values of cells stand at the centroids
    of the cells (means of their points), where no value changes; the mesh is then left out.

    Raises
    ------
    InvalidInput
        For damaged files, sizes that do not agree, cells with points that are not there, and numbers that are not
        finite.
    Unsupported
        For data packed in a way that is not known.
    """
    path = source.path
    document = _parse(source)
    reader = _Reader(source, document)
    where, name, base, column, known = _pick(path, document, scalar)
    points: list[Floats] = []
    values: list[Floats] = []
    mesh: list[NDArray[np.int64]] | None = []
    offset = 0
    for piece in document.pieces:
        count = _count(path, piece, "NumberOfPoints")
        if not count:
            continue
        require_rows(path, count)
        place = piece.arrays.get("Points", [])
        if len(place) != 1 or place[0].components != 3:
            raise unreadable(path, f"{len(place)} arrays of Points", "one with three components")
        here = finite_points(path, reader.array(place[0], count).astype(np.float64))
        cells = _mesh(path, document.kind, reader, piece, count)
        if where == "CellData":
            full = cells.sizes() > 0
            rows = reader.array(_named(path, piece, where, base), full.size)
            points.append(_centroids(here, cells)[full])
            values.append(column_of(rows, column)[full])
            continue
        points.append(here)
        values.append(column_of(reader.array(_named(path, piece, where, base), count), column))
        own = _volumes(path, cells, offset)
        mesh = None if mesh is None or own is None else mesh + own
        offset += count
    details = {"scalar of": "the cells, at their centroids" if where == "CellData" else "the points"}
    return Scattered(
        np.concatenate(points) if points else np.empty((0, 3)),
        finite_values(path, name, np.concatenate(values) if values else np.empty(0)),
        name,
        _KINDS[document.kind],
        known,
        cells=tuple(mesh) if mesh else None,
        details=details,
    )


def _integers(path: Path, text: str, what: str) -> list[int]:
    words = text.split()
    if len(words) != 6 or not all(word.lstrip("-").isdigit() and len(word) < 12 for word in words):
        raise unreadable(path, f"{what} = {shown(text)}", "six whole numbers")
    numbers = [int(word) for word in words]
    if any(numbers[2 * axis] > numbers[2 * axis + 1] for axis in range(3)):
        raise unreadable(path, f"{what} = {shown(text)}", "first numbers that are not above the last ones")
    return numbers


def _three(path: Path, text: str, what: str) -> Triple:
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != 3 or not all(map(math.isfinite, numbers)):
        raise unreadable(path, f"{what} = {shown(text)}", "three finite numbers")
    return numbers[0], numbers[1], numbers[2]


def read_image(source: Source, scalar: str | None = None) -> Volume:
    """Read an image: a scalar of its points, or of its cells, whose centres lie half a spacing further in.

    Raises InvalidInput for damaged files, pieces that do not fill the image, and axes that are turned; Unsupported for
    data packed in a way that is not known.
    """
    with np.errstate(all="ignore"):
        return _image(source, scalar)


def _image(source: Source, scalar: str | None) -> Volume:
    path = source.path
    document = _parse(source)
    reader = _Reader(source, document)
    where, name, base, column, _ = _pick(path, document, scalar)
    attributes = document.attributes
    whole = _integers(path, attributes.get("WholeExtent", ""), "WholeExtent")
    spacing = _three(path, attributes.get("Spacing", "1 1 1"), "Spacing")
    origin = _three(path, attributes.get("Origin", "0 0 0"), "Origin")
    if min(spacing) <= 0:
        raise unreadable(path, f"Spacing = {spacing}", "three numbers above 0")
    identity = "1 0 0 0 1 0 0 0 1"
    direction = attributes.get("Direction", identity)
    try:
        straight = [float(word) for word in direction.split()] == [float(word) for word in identity.split()]
    except ValueError:
        straight = False
    if not straight:
        raise unreadable(path, f"Direction = {shown(direction)}", "the identity", "resample to the axes of the world")
    cells = where == "CellData"

    def shape_of(extent: list[int]) -> tuple[int, ...]:
        counts = [extent[2 * axis + 1] - extent[2 * axis] + (not cells) for axis in (2, 1, 0)]
        return checked_shape(path, counts, "the extent in samples (z, y, x)")

    shape = shape_of(whole)
    values: NDArray[Any] | None = None
    filled = 0
    for piece in document.pieces:
        extent = _integers(path, piece.attributes.get("Extent", attributes.get("WholeExtent", "")), "Extent")
        if any(extent[2 * a] < whole[2 * a] or extent[2 * a + 1] > whole[2 * a + 1] for a in range(3)):
            raise unreadable(path, f"a Piece of extent {extent}", f"one inside of {whole}")
        here = shape_of(extent)
        rows = reader.array(_named(path, piece, where, base), math.prod(here))
        numbers = rows if column == 0 and rows.ndim == 1 else column_of(rows, column)
        if here == shape:
            values = numbers.reshape(shape)
            filled = math.prod(shape)
            break
        if values is None:
            _memory.require(math.prod(shape) * numbers.dtype.itemsize, f"the samples of {path}")
            values = np.zeros(shape, numbers.dtype)
        low = [extent[2 * axis] - whole[2 * axis] for axis in (2, 1, 0)]
        part = tuple(slice(first, first + size) for first, size in zip(low, here, strict=True))
        values[part] = numbers.reshape(here)
        # Pieces of points share the layers between them; each counts from its second layer on, but for the first.
        own = [size - (not cells and first > 0) for first, size in zip(low, here, strict=True)]
        filled += math.prod(own)
    assert values is not None
    if filled < math.prod(shape):
        raise unreadable(path, f"pieces with {filled} samples", f"{math.prod(shape)}, as WholeExtent says")
    start = [first + gap * (at + 0.5 * cells) for first, gap, at in zip(origin, spacing, whole[::2], strict=True)]
    return Volume(values, spacing, (start[0], start[1], start[2]), "vti", {"content": name})


def kind_of(head: bytes) -> str:
    """Return "vti" for an image, "vtk" for points, "" for other files, by the beginning of a file."""
    if b"<VTKFile" not in head:
        return ""
    return "vti" if b'"ImageData"' in head or b"'ImageData'" in head else "vtk"
