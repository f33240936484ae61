"""The XML of VTK's files, and of others, as trees of bounded size; what a file of VTK declares.

Entities and document types are refused; the number of elements and the text kept are bounded. Read here and not by VTK,
which read 17 of 840 damaged files that are refused here, some as what was in memory before, and ended or hung in 6 of
1,320; which would take 0.3 s to start a child; which reads no gzipped files; and without which no package is needed.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, TreeBuilder
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
#: What the type of a parallel file, whose pieces are files, begins with, and so its elements.
PARALLEL = "P"
_CHUNK = 1 << 20
_APPENDED = b"<AppendedData"
_MOST_ELEMENTS = 100_000
# Bytes of one tag or comment: the parser starts again at its beginning with every chunk.
_LONGEST_TAG = 16 * _CHUNK


@dataclass(frozen=True)
class DataArray:
    """A DataArray: the attributes of its element, and the element, which has the numbers that are inline."""

    name: str
    type: str
    components: int
    format: str
    offset: int
    element: Element

    @property
    def text(self) -> str:
        """Return the text between its tags; VTK writes information keys, which have texts of their own, among it."""
        return "".join([self.element.text or "", *(one.tail or "" for one in self.element)])


@dataclass(frozen=True)
class Document:
    """A file: its kind, the encoding of its numbers, the element of its data set, and the first byte of appended data.

    The pieces of a parallel file have no arrays; its own element declares those that the pieces of its files are to
    have.
    """

    kind: str
    order: str
    header: np.dtype[Any]
    compressor: str
    data: Element
    is_parallel: bool
    appended: str = ""
    start: int = 0

    @property
    def pieces(self) -> list[Element]:
        """Return the elements Piece."""
        return self.data.findall("Piece")


class _Tree:
    """A parser of XML that refuses document types and entities, and whose tags, elements and texts are bounded."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._builder = TreeBuilder()
        self.root: Element | None = None
        parser = expat.ParserCreate()
        parser.buffer_text = True
        parser.StartElementHandler = self._begin
        parser.EndElementHandler = self._builder.end
        parser.CharacterDataHandler = self._text
        parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = self._refuse
        self._parser = parser
        self._fed = self._elements = self._characters = 0

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
        one = self._builder.start(name, attributes)
        self.root = one if self.root is None else self.root

    def _text(self, text: str) -> None:
        before, self._characters = self._characters // _LONGEST_TAG, self._characters + len(text)
        if self._characters // _LONGEST_TAG > before:
            # The texts are kept until their arrays are read.
            _memory.require(4 * self._characters, f"the text of {self._path}")
        self._builder.data(text)


def parse_tree(source: Source) -> Element:
    """Return the root element of an XML file."""
    tree = _Tree(source.path)
    source.stream.seek(0)
    while piece := source.stream.read(_CHUNK):
        tree.feed(piece)
    tree.feed(b"", True)
    assert tree.root is not None
    return tree.root


def parse_document(source: Source) -> Document:
    """Return the document; nothing is read of the appended data."""
    tree = _Tree(source.path)
    before = b""
    fed = 0
    source.stream.seek(0)
    while True:
        piece = source.stream.read(_CHUNK)
        window = before + piece
        at = window.find(_APPENDED)
        if at >= 0:
            window += source.stream.read(4096)
            tree.feed(window[:at])
            return _document(source, tree.root, *_appended(source, window[at:], fed + at))
        if not piece:
            tree.feed(window, True)
            return _document(source, tree.root)
        done = max(0, len(window) - len(_APPENDED) + 1)
        before = window[done:]
        tree.feed(window[:done])
        fed += done


def _appended(source: Source, text: bytes, start: int) -> tuple[str, int]:
    """Return the encoding of appended data, and their first byte."""
    close = text.find(b">")
    mark = text.find(b"_", close + 1)
    element = text[:close]
    encoding = "base64" if b'"base64"' in element or b"'base64'" in element else "raw"
    if close < 0 or mark < 0 or text[close + 1 : mark].strip():
        raise unreadable(source.path, "appended data without the first character _", "AppendedData of VTK")
    return encoding, start + mark + 1


def _document(source: Source, root: Element | None, appended: str = "", start: int = 0) -> Document:
    if root is None:
        raise unreadable(source.path, "no element", "a VTK file with a Piece of data")
    told = root.get("type", "")
    kind = told.removeprefix(PARALLEL) if told.removeprefix(PARALLEL) in KINDS else told
    if root.tag != "VTKFile" or kind not in KINDS:
        found = f"<{shown(root.tag)[1:-1]}>" if root.tag != "VTKFile" else f"a VTK file of type {shown(told)}"
        then = "save it as one file of one of these types"
        raise unreadable(source.path, found, "a VTK file of type " + ", ".join(KINDS), then)
    orders, widths = {"LittleEndian": "<", "BigEndian": ">"}, {"UInt32": "u4", "UInt64": "u8"}
    order, width = root.get("byte_order", "LittleEndian"), root.get("header_type", "UInt32")
    if order not in orders or width not in widths:
        found = f"byte_order {shown(order)}, header_type {shown(width)}"
        raise unreadable(source.path, found, "LittleEndian or BigEndian, UInt32 or UInt64")
    data = root.find(told)
    if data is None or data.find("Piece") is None:
        raise unreadable(source.path, "no Piece", "a VTK file with a Piece of data")
    header = np.dtype(orders[order] + widths[width])
    return Document(kind, orders[order], header, root.get("compressor", ""), data, kind != told, appended, start)


def arrays_of(path: Path, owner: Element, element: str, prefix: str = "") -> list[DataArray]:
    """Return the arrays of a piece in its element PointData, Points …; `prefix`: of elements that declare them."""
    return [_array(path, one) for one in owner.findall(f"{prefix}{element}/{prefix}DataArray")]


def _array(path: Path, element: Element) -> DataArray:
    def whole(name: str, default: str) -> int:
        return natural(path, f"{name} of a DataArray", element.get(name) or default)

    kind = element.get("format", "ascii")
    if kind not in ("ascii", "binary", "appended"):
        raise unreadable(path, f"format {shown(kind)} of a DataArray", "ascii, binary or appended")
    components = max(1, whole("NumberOfComponents", "1"))
    return DataArray(element.get("Name", ""), element.get("type", ""), components, kind, whole("offset", "0"), element)
