"""Headers of PLY files: elements, and the types of their properties.

Read here and not by plyfile, so that a header can be checked against the size of its file before memory is taken.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sheetsplat._checks import shown
from sheetsplat.io.checks import natural, unreadable
from sheetsplat.io.source import Source

_LIMIT = 1 << 16
_NAMES = "char uchar short ushort int uint float double"
_CODES = "int8 uint8 int16 uint16 int32 uint32 float32 float64"
_TYPES = dict(zip(_NAMES.split() + _CODES.split(), 2 * _CODES.split(), strict=True))


@dataclass(frozen=True)
class Property:
    """A property of an element.

    Attributes
    ----------
    name
        Its name.
    kind
        NumPy's name of its type, of a list that of an entry.
    counts
        Of a list: the type of the number of its entries; empty for a single number.
    """

    name: str
    kind: str
    counts: str = ""


@dataclass
class Element:
    """An element: so many rows of properties."""

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)

    @property
    def numbers(self) -> list[tuple[str, str]]:
        """Names and types of the properties that are single numbers."""
        return [(one.name, one.kind) for one in self.properties if not one.counts]

    @property
    def has_lists(self) -> bool:
        """Whether a property is a list."""
        return any(one.counts for one in self.properties)

    @property
    def least_bytes(self) -> int:
        """Bytes of a row of a binary file at least: lists are empty."""
        return sum(np.dtype(one.counts or one.kind).itemsize for one in self.properties)


@dataclass(frozen=True)
class Header:
    """What the header says.

    Attributes
    ----------
    order
        "<" or ">", or "text" for a file of ASCII.
    elements
        In the order of the file.
    length, lines
        Bytes and lines of the header.
    """

    order: str
    elements: list[Element]
    length: int
    lines: int


def read_header(source: Source) -> Header:
    """Return the header of a file. InvalidInput, with the line, for anything else."""
    head = source.head(_LIMIT)
    end = head.find(b"end_header")
    end = -1 if end < 0 else head.find(b"\n", end) + 1
    if end <= 0:
        raise unreadable(source.path, f"no end_header in the first {len(head)} bytes", "a PLY header")
    order = ""
    elements: list[Element] = []
    lines = head[:end].decode("latin-1").splitlines()
    for number, line in enumerate(lines[1:], 2):
        words = line.split()
        kind = words[0] if words else "comment"
        if kind in ("comment", "obj_info", "end_header"):
            continue
        if kind == "format" and len(words) == 3 and words[2] == "1.0":
            order = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": "text"}.get(words[1], "")
        elif kind == "element" and len(words) == 3:
            elements.append(Element(words[1], natural(source.path, f"the number of {words[1]}", words[2])))
        elif kind == "property" and elements and len(words) == 3 and words[1] in _TYPES:
            elements[-1].properties.append(Property(words[2], _TYPES[words[1]]))
        elif kind == "property" and elements and len(words) == 5 and words[1] == "list":
            elements[-1].properties.append(_list(source, number, words))
        else:
            raise unreadable(source.path, f"the line {shown(line)}", "a line of a PLY header")
    if not order:
        raise unreadable(source.path, "no format", "ascii, binary_little_endian or binary_big_endian, version 1.0")
    return Header(order, elements, end, len(lines))


def _list(source: Source, line: int, words: list[str]) -> Property:
    counts, kind = (_TYPES.get(word, "") for word in words[2:4])
    for word, found, wanted in (
        (words[2], counts, "uchar, int or another type of whole numbers"),
        (words[3], kind, ""),
    ):
        if not found or (wanted and np.dtype(found).kind == "f"):
            what = "counts" if wanted else "entries"
            listed = f"lists {words[4]} whose {what} are of type {shown(word)}, in line {line} of the header"
            raise unreadable(source.path, listed, wanted or "one of: " + ", ".join(_NAMES.split()))
    return Property(words[4], kind, counts)
