"""VTK's legacy files (.vtk): images, rectilinear, structured and unstructured grids, surfaces; text or binary.

Read here and not by VTK, whose reader trusts the sizes in a file: 10 of 120 damaged binary files ended its process.
Source: the VTK File Formats document, "Simple Legacy Formats", and what VTK 4.2 to 9.7 write.
"""

from __future__ import annotations

import math
import re
import urllib.parse
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import shown
from sheetsplat.errors import Error
from sheetsplat.io.checks import (
    checked_shape,
    floats,
    natural,
    numbers_in_text,
    require_rows,
    unreadable,
)
from sheetsplat.io.records import Floats, Scattered, Volume
from sheetsplat.io.source import Source
from sheetsplat.io.vtk_cells import HEXAHEDRON, Cells, checked_lists, hexahedra_of, joined, one_mesh, same_cells
from sheetsplat.io.vtk_grids import STRAIGHT, counts_of, image, pick, rectilinear, sizes_of

SIGNATURE = b"# vtk DataFile Version "
_KIND = re.compile(rb"[^\n]*\n[^\n]*\n\s*(?:ASCII|BINARY)\s+DATASET\s+(\w+)", re.IGNORECASE)
_VOLUMES = ("STRUCTURED_POINTS", "RECTILINEAR_GRID")
_MESHES = ("STRUCTURED_GRID", "UNSTRUCTURED_GRID", "POLYDATA")
# The order in which VTK counts the cells of a surface.
_LISTS = ("VERTICES", "LINES", "POLYGONS", "TRIANGLE_STRIPS")
_AXES = ("X_COORDINATES", "Y_COORDINATES", "Z_COORDINATES")
# A number of VTK's type vtkIdType has four bytes in legacy files.
_TYPES = {
    "bit": "u1", "unsigned_char": "u1", "char": "i1", "signed_char": "i1", "unsigned_short": "u2", "short": "i2",
    "unsigned_int": "u4", "int": "i4", "unsigned_long": "u8", "long": "i8", "vtkidtype": "i4", "vtktypeint64": "i8",
    "vtktypeuint64": "u8", "vtktypeint32": "i4", "vtktypeuint32": "u4", "float": "f4", "double": "f8",
}  # fmt: skip
# Attributes with a name, a type and so many columns.
_ATTRIBUTES = {
    "VECTORS": 3, "NORMALS": 3, "TENSORS": 9, "TENSORS6": 6, "GLOBAL_IDS": 1, "PEDIGREE_IDS": 1, "EDGE_FLAGS": 1,
}  # fmt: skip
_LONGEST_LINE = 1 << 16
_LONGEST_WORD = 64
_MOST_ARRAYS = 10_000
_CHUNK = 1 << 20


def kind_of(source: Source) -> str:
    """Return "volume" or "mesh" for a legacy file, else ""."""
    head = source.head(4096)
    if not head.startswith(SIGNATURE):
        return ""
    found = _KIND.match(head)
    return "volume" if found and found[1].decode("ascii").upper() in _VOLUMES else "mesh"


@dataclass(frozen=True)
class _Slot:
    """Where an array lies in the file."""

    type: str
    rows: int
    columns: int
    place: int
    of_cells: bool = False


@dataclass
class _Contents:
    """What a file declares."""

    kind: str = ""
    numbers: dict[str, str] = field(default_factory=dict)
    slots: dict[str, _Slot] = field(default_factory=dict)
    arrays: dict[str, _Slot] = field(default_factory=dict)
    preferred: list[str] = field(default_factory=list)


class _Stream:
    """Lines and arrays of a legacy file. Arrays are skipped first and read when they are known to be wanted."""

    def __init__(self, source: Source) -> None:
        self._source, self._path = source, source.path
        # Bytes that were read after the last number of a text.
        self._ahead = b""
        self.text = True
        source.stream.seek(0)

    def fail(self, found: str, wanted: str) -> Error:
        """Return the error for this file."""
        return unreadable(self._path, found, wanted)

    def place(self) -> int:
        """Return the number of bytes before the next one."""
        return self._source.stream.tell() - len(self._ahead)

    def go(self, place: int) -> None:
        """Go to a byte of the file."""
        self._ahead = b""
        self._source.stream.seek(place)

    def line(self) -> bytes | None:
        """Return the next line without its end, None at the end of the file."""
        while b"\n" not in self._ahead and len(self._ahead) < _LONGEST_LINE:
            piece = self._source.stream.readline(_LONGEST_LINE)
            self._ahead += piece
            if not piece:
                break
        if not self._ahead:
            return None
        line, end, self._ahead = self._ahead.partition(b"\n")
        if len(line) > _LONGEST_LINE - 2 or (not end and len(line) > _LONGEST_LINE // 2):
            raise self.fail(f"a line of more than {len(line)} bytes", "the lines of VTK's files")
        return line.rstrip(b"\r")

    def words(self) -> list[str] | None:
        """Return the words of the next line that has any, None at the end of the file."""
        while (line := self.line()) is not None:
            if line.strip():
                return line.decode("utf-8", "replace").split()
        return None

    def _dtype(self, type_: str) -> np.dtype[Any]:
        if type_.lower() not in _TYPES:
            raise self.fail(f"an array of type {shown(type_)}", "numbers: " + ", ".join(_TYPES))
        return np.dtype(_TYPES[type_.lower()]).newbyteorder(">")

    def skip(self, type_: str, rows: int, columns: int = 1) -> _Slot:
        """Go behind an array and return where it lies."""
        slot = _Slot(type_, rows, columns, self.place())
        count = rows * columns
        if type_.lower() in ("string", "variant", "utf8_string"):
            self._skip_strings(count)
            return slot
        dtype = self._dtype(type_)
        if self.text:
            self._numbers(dtype, count, kept=False)
            return slot
        size = -(-count // 8) if type_.lower() == "bit" else count * dtype.itemsize
        if size > self._source.at_most() + len(self._ahead):
            raise self.fail(f"fewer bytes than {size} of an array", "a whole file")
        place = self.place()
        self._ahead = b""
        self._source.stream.seek(place + size)
        return slot

    def _skip_strings(self, count: int) -> None:
        """Go behind texts: one a line, or each after its length in 1, 2, 4 or 8 bytes, as its first two bits say."""
        if count > self._source.at_most() + len(self._ahead):
            raise self.fail(f"fewer than {count} texts", "a whole file")
        for _ in range(count):
            if self.text:
                if self.line() is None:
                    break
                continue
            place = self.place()
            self.go(place)
            first = self._source.stream.read(1)
            if not first:
                raise self.fail("an end of the file among texts", "a whole file")
            width = (8, 4, 2, 1)[first[0] >> 6]
            number = int.from_bytes(first + self._source.stream.read(width - 1), "big") & ((1 << (8 * width - 2)) - 1)
            if number > self._source.at_most():
                raise self.fail(f"fewer bytes than {number} of a text", "a whole file")
            self.go(place + width + number)

    def read(self, slot: _Slot) -> NDArray[Any]:
        """Return the numbers of an array, (rows,) or (rows, columns)."""
        self.go(slot.place)
        dtype, count = self._dtype(slot.type), slot.rows * slot.columns
        _memory.require(2 * count * max(8, dtype.itemsize), f"an array of {self._path}")
        if self.text:
            values = self._numbers(dtype, count, kept=True)
        elif slot.type.lower() == "bit":
            packed = self._source.payload("raw").array(np.dtype(np.uint8), -(-count // 8))
            values = np.unpackbits(packed, count=count)
        else:
            values = self._source.payload("raw").array(dtype, count)
        return values.reshape(slot.rows, slot.columns) if slot.columns > 1 else values

    def _numbers(self, dtype: np.dtype[Any], count: int, *, kept: bool) -> NDArray[Any]:
        """Return the next numbers of a text, or nothing where they are not kept."""
        if count > self._source.at_most() + len(self._ahead) + 1:
            raise self.fail(f"fewer than {count} numbers of an array", "a whole file")
        parts: list[NDArray[Any]] = [np.empty(0, dtype.newbyteorder("="))]
        left = count
        while left > 0:
            piece = self._source.stream.read(_CHUNK)
            # To the end of a number.
            piece += self._source.stream.readline(_LONGEST_LINE)
            text = self._ahead + piece
            if not text.strip():
                raise self.fail(f"{count - left} numbers of an array", f"{count}, as it says")
            words = text.split(None, left)
            self._ahead = words.pop() if len(words) > left else b""
            # A chunk may end within a number where a line is very long.
            if piece and not self._ahead and not text[-1:].isspace():
                self._ahead = words.pop()
            left -= len(words)
            if any(len(word) > _LONGEST_WORD for word in (words if kept else words[:1])) or not (words or piece):
                raise self.fail(f"a number of more than {_LONGEST_WORD} digits", "numbers")
            if len(self._ahead) > 4 * _CHUNK:
                raise self.fail("an endless word", "numbers")
            if kept and words:
                parts.append(numbers_in_text(b" ".join(words), dtype))
                if parts[-1].size != len(words):
                    raise self.fail(f"{parts[-1].size} numbers of {len(words)}", "numbers")
        return np.concatenate(parts)


class _Parser:
    """Finds what a file declares, section by section."""

    def __init__(self, source: Source) -> None:
        self._path = source.path
        self.stream = _Stream(source)
        self.contents = _Contents()
        # Rows that arrays have, and whether they are those of cells.
        self._rows, self._of_cells = 0, False

    def parse(self) -> _Contents:
        """Return what the file declares."""
        stream = self.stream
        stream.line()
        stream.line()
        words = stream.words() or [""]
        if words[0].upper() not in ("ASCII", "BINARY"):
            raise stream.fail(shown(words[0]), "ASCII or BINARY in the third line")
        stream.text = words[0].upper() == "ASCII"
        while (section := stream.words()) is not None:
            self._section(section[0].upper(), section[1:])
        return self.contents

    def _natural(self, words: list[str], number: int, what: str) -> int:
        return natural(self._path, what, words[number] if number < len(words) else "")

    def _word(self, words: list[str], number: int, what: str) -> str:
        if number >= len(words):
            raise self.stream.fail(f"{what} without a word {number + 1}", "the words of VTK's files")
        return words[number]

    def _section(self, key: str, words: list[str]) -> None:
        contents, stream = self.contents, self.stream
        if len(contents.arrays) > _MOST_ARRAYS:
            raise stream.fail(f"more than {_MOST_ARRAYS} arrays", "fewer")
        if key == "DATASET":
            contents.kind = self._word(words, 0, key).upper()
        elif key in ("DIMENSIONS", "EXTENT", "SPACING", "ASPECT_RATIO", "ORIGIN"):
            contents.numbers["SPACING" if key == "ASPECT_RATIO" else key] = " ".join(words)
        elif key == "POINTS":
            contents.slots[key] = stream.skip(self._word(words, 1, key), self._natural(words, 0, key), 3)
        elif key in _AXES:
            contents.slots[key] = stream.skip(self._word(words, 1, key), self._natural(words, 0, key))
        elif key in _LISTS or key == "CELLS":
            self._cells(key, words)
        elif key == "CELL_TYPES":
            contents.slots[key] = stream.skip("int", self._natural(words, 0, key))
        elif key in ("POINT_DATA", "CELL_DATA"):
            self._rows, self._of_cells = self._natural(words, 0, key), key == "CELL_DATA"
        elif key == "METADATA":
            while stream.line():
                pass
        else:
            self._attribute(key, words)

    def _cells(self, key: str, words: list[str]) -> None:
        """Take lists of cells: numbers of points before the points, or, since version 5, ends and points apart."""
        count, size = self._natural(words, 0, key), self._natural(words, 1, key)
        place = self.stream.place()
        following = self.stream.words() if size else None
        if following and following[0].upper() == "OFFSETS":
            self.contents.slots[key + " OFFSETS"] = self.stream.skip(self._word(following, 1, key), count)
            following = self.stream.words() or [""]
            if following[0].upper() != "CONNECTIVITY":
                raise self.stream.fail(shown(following[0]), "CONNECTIVITY after OFFSETS")
            self.contents.slots[key] = self.stream.skip(self._word(following, 1, key), size)
            return
        self.stream.go(place)
        self.contents.slots[key] = self.stream.skip("int", size)
        self.contents.numbers[key] = str(count)

    def _add(self, name: str, slot: _Slot) -> None:
        known = slot.rows == self._rows and slot.type.lower() in _TYPES and slot.columns > 0 and self._rows > 0
        name = urllib.parse.unquote(name)
        if known and name not in self.contents.arrays:
            self.contents.arrays[name] = _Slot(slot.type, slot.rows, slot.columns, slot.place, self._of_cells)

    def _attribute(self, key: str, words: list[str]) -> None:
        stream, rows = self.stream, self._rows
        if key == "SCALARS":
            columns = self._natural(words, 2, key) if len(words) > 2 else 1
            place = stream.place()
            following = stream.words()
            if not following or following[0].upper() != "LOOKUP_TABLE":
                stream.go(place)
            name = self._word(words, 0, key)
            self._add(name, stream.skip(self._word(words, 1, key), rows, columns))
            self.contents.preferred.append(urllib.parse.unquote(name))
        elif key in _ATTRIBUTES:
            self._add(self._word(words, 0, key), stream.skip(self._word(words, 1, key), rows, _ATTRIBUTES[key]))
        elif key == "TEXTURE_COORDINATES":
            columns = self._natural(words, 1, key)
            self._add(self._word(words, 0, key), stream.skip(self._word(words, 2, key), rows, columns))
        elif key in ("COLOR_SCALARS", "LOOKUP_TABLE"):
            # Parts of 1 in a text, bytes otherwise.
            kind, columns = ("float" if stream.text else "unsigned_char"), self._natural(words, 1, key)
            if key == "COLOR_SCALARS":
                self._add(self._word(words, 0, key), stream.skip(kind, rows, columns))
            else:
                stream.skip(kind, columns, 4)
        elif key == "FIELD":
            self._fields(self._natural(words, 1, key))
        else:
            raise stream.fail(shown(key), "a section of VTK's files, such as POINTS or POINT_DATA")

    def _fields(self, count: int) -> None:
        """Take arrays that say their own sizes; those before POINT_DATA belong to nothing."""
        taken = 0
        while taken < count:
            words = self.stream.words()
            if words is None:
                raise self.stream.fail(f"{taken} arrays of a FIELD", f"{count}")
            if words[0].upper() == "METADATA":
                while self.stream.line():
                    pass
                continue
            columns, rows = self._natural(words, 1, "columns"), self._natural(words, 2, "rows")
            self._add(words[0], self.stream.skip(self._word(words, 3, words[0]), rows, columns))
            taken += 1


class _Chosen:
    """The scalar that is shown, of a file that is open."""

    def __init__(self, source: Source, wanted: str | None) -> None:
        parser = _Parser(source)
        self.path, self.contents, self.stream = source.path, parser.parse(), parser.stream
        # Those of the points first, in either order of the sections.
        arrays = sorted(self.contents.arrays.items(), key=lambda one: one[1].of_cells)
        preferred = [name for name, _ in arrays if name in self.contents.preferred]
        rows = ((name, slot.of_cells, slot.columns, slot) for name, slot in arrays)
        self.picked = pick(self.path, rows, preferred, wanted)

    def values(self, count: int) -> NDArray[Any]:
        """Return the values in their own type; InvalidInput unless there are so many."""
        slot: _Slot = self.picked.array
        if slot.rows != count:
            raise unreadable(self.path, f"{slot.rows} values of {shown(self.picked.name)}", f"{count}")
        return self.picked.of(self.stream.read(slot))

    def read(self, name: str) -> NDArray[Any]:
        """Return an array that the data set must have."""
        if name not in self.contents.slots:
            raise unreadable(self.path, f"no {name}", f"it in a {self.contents.kind}")
        return self.stream.read(self.contents.slots[name])

    def extent(self) -> list[int]:
        """Return the first and the last number of the points along x, y and z."""
        numbers = self.contents.numbers
        words = numbers.get("EXTENT", numbers.get("DIMENSIONS", "")).split()
        if "EXTENT" in numbers and len(words) == 6 and all(word.lstrip("-").isdigit() for word in words):
            found = [int(word) for word in words]
        else:
            found = [end for word in words for end in (0, natural(self.path, "DIMENSIONS", word) - 1)]
        if len(found) != 6:
            raise unreadable(self.path, f"DIMENSIONS {' '.join(words)}", "three whole numbers")
        checked_shape(self.path, sizes_of(found), "DIMENSIONS")
        return found

    def along(self, axis: str, count: int) -> Floats:
        """Return the coordinates of the points along an axis."""
        along = self.read(axis).astype(np.float64)
        if along.size != count:
            raise unreadable(self.path, f"{along.size} {axis}", f"{count}, as DIMENSIONS says")
        return along


def read_volume(source: Source, name: str | None = None, resample: bool = False) -> Volume:
    """Read an image or a rectilinear grid: a scalar of its points, or of its cells, which lies at their middles.

    Raises InvalidInput for damaged files, and for uneven coordinates unless `resample` is true.
    """
    path = source.path
    with np.errstate(all="ignore"):
        chosen = _Chosen(source, name)
        extent = chosen.extent()
        counts = counts_of(sizes_of(extent), of_cells=chosen.picked.of_cells)
        values = chosen.values(math.prod(counts))
        if chosen.contents.kind == "RECTILINEAR_GRID":
            points = [chosen.along(axis, count) for axis, count in zip(_AXES, sizes_of(extent), strict=True)]
            return rectilinear(path, chosen.picked, values, points, resample, "vtk")
        numbers = chosen.contents.numbers
        spacing = floats(path, "SPACING", numbers.get("SPACING", "1 1 1"), 3)
        origin = floats(path, "ORIGIN", numbers.get("ORIGIN", "0 0 0"), 3)
        if min(spacing) <= 0:
            raise unreadable(path, f"SPACING {spacing}", "three numbers above 0")
        return image(path, chosen.picked, values, extent, spacing, origin, STRAIGHT, "vtk")


def _lists(chosen: _Chosen, points: int) -> Cells:
    """Return the cells of an unstructured grid or a surface."""
    slots, numbers = chosen.contents.slots, chosen.contents.numbers
    grid = chosen.contents.kind == "UNSTRUCTURED_GRID"
    lists = []
    for name in ("CELLS",) if grid else _LISTS:
        if name not in slots:
            continue
        rows = chosen.read(name).astype(np.int64)
        if name + " OFFSETS" in slots:
            ends = chosen.read(name + " OFFSETS").astype(np.int64)[1:]
        else:
            rows, ends = _apart(chosen, name, rows, natural(chosen.path, name, numbers[name]))
        checked_lists(chosen.path, name, rows, ends, points)
        lists.append((rows, ends))
    types = chosen.read("CELL_TYPES").astype(np.int64) if grid and lists else np.empty(0, np.int64)
    cells = joined(lists, types)
    if grid and types.size != cells.ends.size:
        raise unreadable(chosen.path, f"{types.size} CELL_TYPES", f"{cells.ends.size}, one for each cell")
    return cells


def _apart(
    chosen: _Chosen, name: str, rows: NDArray[np.int64], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return point numbers and ends from lists in which each cell begins with its number of points."""
    starts, at = [], 0
    numbers = rows.tolist()
    for _ in range(count):
        if at >= len(numbers) or numbers[at] < 0:
            raise unreadable(chosen.path, f"a cell of {name} outside its list", f"{count} cells")
        starts.append(at)
        at += numbers[at] + 1
    if at != len(numbers):
        raise unreadable(chosen.path, f"{len(numbers)} numbers of {name}", f"{at}, as its cells have")
    first = np.asarray(starts, dtype=np.int64)
    return np.delete(rows, first), np.cumsum(rows[first])


def read_mesh(source: Source, scalar: str | None = None) -> Scattered:
    """Read a structured or unstructured grid or a surface; see `vtk_xml.meshes.read`.

    Raises InvalidInput for damaged files, sizes that disagree, and numbers that are not finite.
    """
    path = source.path
    with np.errstate(all="ignore"):
        chosen = _Chosen(source, scalar)
        kind = chosen.contents.kind
        if kind not in _MESHES:
            raise unreadable(path, f"a data set of type {shown(kind)}", ", ".join(_VOLUMES + _MESHES))
        require_rows(path, chosen.contents.slots["POINTS"].rows if "POINTS" in chosen.contents.slots else 0)
        points = chosen.read("POINTS").astype(np.float64).reshape(-1, 3)
        if kind == "STRUCTURED_GRID":
            counts = sizes_of(chosen.extent())
            if math.prod(counts) != len(points):
                raise unreadable(path, f"{len(points)} POINTS", f"{' x '.join(map(str, counts))}")
            cells = same_cells(hexahedra_of(counts), HEXAHEDRON)
        else:
            cells = _lists(chosen, len(points))
        number = cells.ends.size if chosen.picked.of_cells else len(points)
        return one_mesh(path, chosen.picked, points, cells, chosen.values(number), "vtk")
