"""The XML of VTK's files: what each DataArray, Piece and the file itself declare.

Entities and document types are refused; the number of elements and the text kept are bounded.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np

from sheetsplat import _memory
from sheetsplat._checks import shown
from sheetsplat.io.checks import natural, unreadable
from sheetsplat.io.source import Source

KINDS = {
    "UnstructuredGrid": "vtu",
    "StructuredGrid": "vts",
    "PolyData": "vtp",
    "ImageData": "vti",
    "RectilinearGrid": "vtr",
}
#: The kinds that are regular volumes.
VOLUMES = ("ImageData", "RectilinearGrid")
#: What the type of a parallel file, whose pieces are files, begins with.
PARALLEL = "P"
_CHUNK = 1 << 20
_APPENDED = b"<AppendedData"
_MOST_ELEMENTS = 100_000
# Bytes of one tag or comment: the parser starts again at its beginning with every chunk.
_LONGEST_TAG = 16 * _CHUNK
# Elements that contain a DataArray: VTKFile, the kind, Piece, and PointData, CellData, Points, Coordinates or Cells.
_ARRAY_DEPTH = 4
_DECLARED = {"PPointData": "PointData", "PCellData": "CellData"}


@dataclass
class DataArray:
    """A DataArray: the attributes of its element, and its text where the numbers are inline."""

    name: str
    type: str
    components: int
    format: str
    offset: int
    text: list[bytes] = field(default_factory=list)
    length: int = 0


@dataclass
class Piece:
    """A Piece: its attributes, its arrays by their element, and its active arrays by element and role."""

    attributes: dict[str, str]
    arrays: dict[str, list[DataArray]] = field(default_factory=dict)
    chosen: dict[str, str] = field(default_factory=dict)

    def add_element(self, name: str, attributes: dict[str, str]) -> None:
        """Add an element that holds arrays, and the names of its active ones."""
        self.arrays.setdefault(name, [])
        for role in ("Scalars", "Vectors"):
            if role in attributes:
                self.chosen.setdefault(f"{name} {role}", attributes[role])


@dataclass
class Document:
    """A file: its kind, the encoding of its numbers, its pieces, and the first byte of appended data.

    The pieces of a parallel file have no arrays; `declared` has those that the pieces of its files are to have.
    """

    kind: str
    order: str
    header: np.dtype[Any]
    compressor: str
    attributes: dict[str, str]
    pieces: list[Piece]
    appended: str = ""
    start: int = 0
    declared: Piece | None = None

    @property
    def element(self) -> str:
        """Return the name of the element of its kind."""
        return self.kind if self.declared is None else PARALLEL + self.kind


class GuardedParser:
    """A parser of XML that refuses document types and entities, and whose tags and elements are bounded."""

    def __init__(self, path: Path) -> None:
        self._path = path
        parser = expat.ParserCreate()
        parser.buffer_text = True
        parser.StartElementHandler = self._begin
        parser.EndElementHandler = self._end
        parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = self._refuse
        self._parser = parser
        self._fed = 0
        self._stack: list[str] = []
        self._elements = 0

    def feed(self, data: bytes, last: bool = False) -> None:
        """Parse the next bytes of the file."""
        self._parser.Parse(data, last)
        self._fed += len(data)
        if self._fed - self._parser.CurrentByteIndex > _LONGEST_TAG:
            raise unreadable(self._path, f"a tag of more than {_LONGEST_TAG >> 20} MiB", "the tags of VTK's files")

    def _refuse(self, *_: Any) -> None:
        raise unreadable(self._path, "a document type or an entity of its own", "plain XML")

    def _begin(self, name: str, attributes: dict[str, str]) -> None:
        self._elements += 1
        if self._elements > _MOST_ELEMENTS:
            raise unreadable(self._path, f"more than {_MOST_ELEMENTS} elements", "fewer")
        self.start(name, attributes)
        self._stack.append(name)

    def start(self, name: str, attributes: dict[str, str]) -> None:
        """Take an element whose parents are in `_stack`."""

    def _end(self, _: str) -> None:
        self._stack.pop()


class _Parser(GuardedParser):
    """Parser of the XML before the appended data."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._parser.CharacterDataHandler = self._text
        self._array: DataArray | None = None
        self._taken = 0
        self.document: Document | None = None

    def start(self, name: str, attributes: dict[str, str]) -> None:
        """Take what VTK's elements declare."""
        depth = len(self._stack)
        if depth == 0:
            self._root(name, attributes)
        document = self.document
        assert document is not None
        if depth == 1 and name == document.element:
            document.attributes = dict(attributes)
        elif depth == 2 and name == "Piece" and self._stack[1] == document.element:
            document.pieces.append(Piece(dict(attributes)))
        elif document.declared is not None:
            self._declare(document.declared, depth, name, attributes)
        elif depth == 3 and self._stack[2] == "Piece" and document.pieces:
            document.pieces[-1].add_element(name, attributes)
        elif depth == _ARRAY_DEPTH and name == "DataArray" and document.pieces and self._stack[2] == "Piece":
            self._array = self._new_array(attributes)
            document.pieces[-1].arrays[self._stack[3]].append(self._array)

    def _declare(self, declared: Piece, depth: int, name: str, attributes: dict[str, str]) -> None:
        """Take the arrays that a parallel file declares."""
        if depth == 2 and name in _DECLARED:
            declared.add_element(_DECLARED[name], attributes)
        elif depth == 3 and name == "PDataArray" and self._stack[2] in _DECLARED:
            declared.arrays[_DECLARED[self._stack[2]]].append(self._new_array(attributes))

    def _root(self, name: str, attributes: dict[str, str]) -> None:
        told = attributes.get("type", "")
        kind = told.removeprefix(PARALLEL) if told.removeprefix(PARALLEL) in KINDS else told
        if name != "VTKFile" or kind not in KINDS:
            found = f"<{shown(name)[1:-1]}>" if name != "VTKFile" else f"a VTK file of type {shown(told)}"
            then = "save it as one file of one of these types"
            raise unreadable(self._path, found, "a VTK file of type " + ", ".join(KINDS), then)
        orders, widths = {"LittleEndian": "<", "BigEndian": ">"}, {"UInt32": "u4", "UInt64": "u8"}
        order, width = attributes.get("byte_order", "LittleEndian"), attributes.get("header_type", "UInt32")
        if order not in orders or width not in widths:
            found = f"byte_order {shown(order)}, header_type {shown(width)}"
            raise unreadable(self._path, found, "LittleEndian or BigEndian, UInt32 or UInt64")
        header = np.dtype(orders[order] + widths[width])
        declared = None if kind == told else Piece({})
        packer = attributes.get("compressor", "")
        self.document = Document(kind, orders[order], header, packer, {}, [], declared=declared)

    def _new_array(self, attributes: dict[str, str]) -> DataArray:
        def whole(name: str, default: str) -> int:
            return natural(self._path, f"{name} of a DataArray", attributes.get(name) or default)

        kind = attributes.get("format", "ascii")
        if kind not in ("ascii", "binary", "appended"):
            raise unreadable(self._path, f"format {shown(kind)} of a DataArray", "ascii, binary or appended")
        name = attributes.get("Name", "")
        components = max(1, whole("NumberOfComponents", "1"))
        return DataArray(name, attributes.get("type", ""), components, kind, whole("offset", "0"))

    def _end(self, name: str) -> None:
        super()._end(name)
        if len(self._stack) == _ARRAY_DEPTH:
            self._array = None

    def _text(self, text: str) -> None:
        # VTK writes information keys, which have texts, into arrays.
        if self._array is None or self._array.format == "appended" or len(self._stack) > _ARRAY_DEPTH + 1:
            return
        data = text.encode("ascii", "replace")
        self._array.text.append(data)
        self._array.length += len(data)
        self._taken += len(data)
        if self._taken > 16 * _CHUNK:
            # The texts are kept until their arrays are read.
            _memory.require(4 * self._array.length, f"the text of {self._path}")
            self._taken = 0


def parse_document(source: Source) -> Document:
    """Return the document; nothing is read of the appended data."""
    parser = _Parser(source.path)
    before = b""
    fed = 0
    source.stream.seek(0)
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
            parser.feed(window, True)
            return _checked(source, parser.document)
        done = max(0, len(window) - len(_APPENDED) + 1)
        before = window[done:]
        parser.feed(window[:done])
        fed += done


def _checked(source: Source, document: Document | None) -> Document:
    if document is None or not document.pieces:
        raise unreadable(source.path, "no Piece", "a VTK file with a Piece of data")
    return document


def _with_appended(source: Source, document: Document, text: bytes, start: int) -> Document:
    close = text.find(b">")
    mark = text.find(b"_", close + 1)
    element = text[:close]
    encoding = "base64" if b'"base64"' in element or b"'base64'" in element else "raw"
    if close < 0 or mark < 0 or text[close + 1 : mark].strip():
        raise unreadable(source.path, "appended data without the first character _", "AppendedData of VTK")
    document.appended, document.start = encoding, start + mark + 1
    return document
