"""Triangles of .obj and .ply files. Every number is checked, and sizes are checked before memory is taken.

Read here and not by trimesh, which takes damaged files for whole ones: faces of missing vertices, texts that end too
soon.
"""

from __future__ import annotations

import io
from abc import ABC, abstractmethod
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import shown
from sheetsplat.errors import Error, complain
from sheetsplat.io.checks import checked_shape
from sheetsplat.io.ply_header import Element, Header, Property, read_header
from sheetsplat.io.records import Floats
from sheetsplat.io.source import Source

Numbers = NDArray[np.int64]

# Largest ratio of the memory of parsed text to its size.
_PARSED = 40
_FACES = ("vertex_indices", "vertex_index")
_ADVICE = "the file is damaged or cut off; fetch it again"
# Lines that are converted at once: Ctrl-C waits for them.
_ROWS = 20_000
# Larger numbers of vertices than any that memory holds.
_MOST = 2**48


def _unreadable(path: Path, found: str, wanted: str, advice: str = _ADVICE) -> Error:
    return complain(f"{path} cannot be read as a mesh", found, wanted, advice)


def read_triangles(source: Source) -> tuple[Floats, Numbers]:
    """Return the vertices, (V, 3), and the triangles, (T, 3), of a .obj or .ply file; polygons become fans.

    Raises
    ------
    InvalidInput
        With the line or the number of the element: for numbers that are missing or unreadable, faces of vertices that
        there are not, sizes other than those of the header; for a file without a face.
    OutOfMemory
        Where the file does not fit.
    """
    path = source.path
    is_ply = source.head(3) == b"ply"
    if not is_ply and source.suffix != ".obj":
        raise _unreadable(path, f"the suffix {source.suffix!r}, and no PLY", "a .obj or .ply file", "")
    header = read_header(source) if is_ply else None
    length = source.length(_memory.available() // _PARSED + 1)
    if header is not None:
        _check_length(path, header, length)
    _memory.require(length * _PARSED, f"the mesh of {path}", "use a mesh of fewer triangles")
    source.stream.seek(0)
    content = source.stream.read()
    vertices, corners, counts, where = _of_obj(path, content) if header is None else _of_ply(path, header, content)
    if not len(counts):
        raise _unreadable(path, f"{len(vertices)} vertices and no face", "faces", "")
    few = counts < 3
    if few.any():
        first = int(np.argmax(few))
        raise _unreadable(path, f"a face of {counts[first]} vertices, {where(first)}", "faces of 3 vertices or more")
    wrong = (corners < 0) | (corners >= len(vertices))
    if wrong.any():
        at = int(np.argmax(wrong))
        face = int(np.searchsorted(np.cumsum(counts), at, side="right"))
        # Those of .obj files count from 1.
        shift = 1 if header is None else 0
        found = f"vertex {corners[at] + shift}, {where(face)}"
        raise _unreadable(path, found, f"vertices from {shift} to {len(vertices) - 1 + shift}")
    known = np.isfinite(vertices).all(axis=1)
    if not known.all():
        first = int(np.argmin(known))
        raise _unreadable(path, f"vertex {first} at {tuple(vertices[first].tolist())}", "finite positions")
    return vertices, _fans(corners, counts)


def _fans(corners: Numbers, counts: Numbers) -> Numbers:
    """Return the triangles of polygons, each from its first corner; `corners` has those of all, one after the other."""
    triangles = counts - 2
    starts = np.cumsum(counts) - counts
    first = np.repeat(starts, triangles)
    step = np.arange(len(first)) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    found: Numbers = corners[np.stack((first, first + step + 1, first + step + 2), axis=1)]
    return found


class _Lines:
    """Where faces are: in lines of a text, or by their numbers alone."""

    def __init__(self, lines: list[int] | None = None, first: int = 0) -> None:
        self._lines, self._first = lines, first

    def __call__(self, face: int) -> str:
        if self._lines is not None:
            return f"in line {self._lines[face]}"
        return f"in face {face}" + (f", line {self._first + face}" if self._first else "")


_Mesh = tuple[Floats, Numbers, Numbers, _Lines]


def _of_obj(path: Path, content: bytes) -> _Mesh:
    """Return vertices, corners of all faces, the number of each face's corners, and where faces are."""
    vertices: list[list[float]] = []
    corners: list[int] = []
    counts: list[int] = []
    lines: list[int] = []
    carried = b""
    for number, line in enumerate(io.BytesIO(content), 1):
        if line.rstrip().endswith(b"\\"):
            carried += line.rstrip()[:-1] + b" "
            continue
        words = (carried + line).split() if carried else line.split()
        carried = b""
        if not words or words[0] not in (b"v", b"f"):
            continue
        try:
            if words[0] == b"v":
                x, y, z = words[1:4]
                vertices.append([float(x), float(y), float(z)])
                continue
            found = [int(word.partition(b"/")[0]) for word in words[1:]]
        except ValueError:
            told = shown(line.decode("latin-1").strip())
            wanted = "v and three numbers" if words[0] == b"v" else "f and numbers of vertices"
            raise _unreadable(path, f"{told} in line {number}", wanted) from None
        before = [one for one in found if one == 0 or -one > len(vertices)]
        if before:
            wanted = f"vertices that count from 1, or backwards from -1 to {-len(vertices)}"
            raise _unreadable(path, f"vertex {before[0]} in line {number}", wanted)
        # Numbers below 0 count backwards from the vertex before.
        corners += [one - 1 if one > 0 else len(vertices) + one for one in found]
        if not all(-_MOST < one < _MOST for one in found):
            raise _unreadable(path, f"vertex {max(found, key=abs)} in line {number}", "numbers of vertices")
        counts.append(len(found))
        lines.append(number)
    points = np.array(vertices, dtype=np.float64).reshape(-1, 3)
    return points, np.array(corners, np.int64), np.array(counts, np.int64), _Lines(lines)


def _element(path: Path, header: Header, name: str) -> Element:
    found = [one for one in header.elements if one.name == name]
    if len(found) != 1:
        names = ", ".join(one.name for one in header.elements) or "none"
        raise _unreadable(path, f"the elements {names}", f"one element {name}", "")
    return found[0]


def _check_length(path: Path, header: Header, length: int) -> None:
    """Raise InvalidInput where the elements need more bytes than the file has."""
    text = header.order == "text"
    for one in header.elements:
        if one.count:
            checked_shape(path, (one.count, max(len(one.properties), 1)), f"element {one.name}")
    # A number and its separator, or the end of the file, take two characters.
    least = sum(one.count * (2 * len(one.properties) if text else one.least_bytes) for one in header.elements)
    if least - text > length - header.length:
        listed = " and ".join(f"{one.count} of {one.name}" for one in header.elements)
        found = f"{length - header.length} bytes after the header"
        raise _unreadable(path, found, f"at least {least}, for {listed}")


def _of_ply(path: Path, header: Header, content: bytes) -> _Mesh:
    """Return vertices, corners of all faces, the number of each face's corners, and where faces are."""
    vertex, face = _element(path, header, "vertex"), _element(path, header, "face")
    missing = [name for name in "xyz" if name not in dict(vertex.numbers)]
    if missing:
        raise _unreadable(path, f"vertices without {', '.join(missing)}", "x, y and z", "")
    chosen = next((one for one in face.properties if one.name in _FACES and one.counts), None)
    if chosen is None or np.dtype(chosen.kind).kind == "f":
        told = ", ".join(f"{one.name} ({'list of ' * bool(one.counts)}{one.kind})" for one in face.properties)
        raise _unreadable(path, f"faces of {told or 'nothing'}", f"a list {_FACES[0]} of whole numbers", "")
    rows: _Rows = _TextRows(path, header, content) if header.order == "text" else _BinaryRows(path, header, content)
    points = np.empty((0, 3))
    lists: list[Any] = []
    where = _Lines()
    for element in header.elements:
        if element is face:
            where = _Lines(first=rows.line)
        found = rows.take(element)
        if element is vertex:
            points = np.stack([np.asarray(found[name], np.float64) for name in "xyz"], axis=1)
        elif element is face:
            lists = found[chosen.name]
    rows.finish()
    if isinstance(lists, np.ndarray):
        return points, lists.reshape(-1).astype(np.int64), np.full(len(lists), lists.shape[1], np.int64), where
    counts = np.array([len(one) for one in lists], np.int64)
    corners = np.concatenate([np.asarray(one, np.int64) for one in lists]) if lists else np.empty(0, np.int64)
    return points, corners, counts, where


class _Rows(ABC):
    """The rows of a file's elements, one element after the other."""

    line = 0

    @abstractmethod
    def take(self, element: Element) -> dict[str, Any]:
        """Return the properties of the next element by name: arrays (N,); of lists (N, M), or a list of arrays."""

    @abstractmethod
    def finish(self) -> None:
        """Raise InvalidInput where something is left."""


class _TextRows(_Rows):
    """Those of a text, each in a line; `line` is the number of the next one, from 1."""

    def __init__(self, path: Path, header: Header, content: bytes) -> None:
        self._path = path
        self._lines = io.BytesIO(content)
        self._lines.seek(header.length)
        self.line = header.lines + 1

    def take(self, element: Element) -> dict[str, Any]:
        blocks: list[dict[str, Any]] = []
        for done in range(0, element.count, _ROWS):
            count = min(_ROWS, element.count - done)
            words = [line.split() for line in islice(self._lines, count)]
            first, self.line = self.line, self.line + len(words)
            try:
                if len(words) < count:
                    raise ValueError
                blocks.append(self._columns(element, words))
            except (ValueError, OverflowError):
                raise self._fault(element, words, first, done) from None
        found: dict[str, Any] = {}
        for one in element.properties:
            parts = [block[one.name] for block in blocks]
            found[one.name] = (
                [row for part in parts for row in part] if element.has_lists else np.concatenate([np.empty(0), *parts])
            )
        return found

    def _columns(self, element: Element, words: list[list[bytes]]) -> dict[str, Any]:
        if not element.has_lists:
            table = np.array(words, dtype=np.float64).reshape(len(words), len(element.properties))
            return {one.name: table[:, at] for at, one in enumerate(element.properties)}
        found: dict[str, Any] = {one.name: [] for one in element.properties}
        for row in words:
            self._take_row(element, row, found)
        return found

    @staticmethod
    def _take_row(element: Element, row: list[bytes], found: dict[str, Any]) -> None:
        at = 0
        for one in element.properties:
            count = int(row[at]) if one.counts and at < len(row) else 1
            start = at + bool(one.counts)
            at = start + count
            if count < 0 or at > len(row):
                raise ValueError
            kind: Any = float if np.dtype(one.kind).kind == "f" else int
            numbers = [kind(word) for word in row[start:at]]
            if not all(-_MOST < number < _MOST for number in numbers if kind is int):
                raise ValueError
            found[one.name].append(numbers if one.counts else numbers[0])
        if at != len(row):
            raise ValueError

    def _fault(self, element: Element, words: list[list[bytes]], first: int, done: int) -> Error:
        """Return the error for the first row that is not what the header says; `done`: how many rows were before."""
        for number, row in enumerate(words):
            if not row:
                break
            try:
                self._columns(element, [row])
            except (ValueError, OverflowError):
                told = shown(b" ".join(row).decode("latin-1"))
                wanted = ", ".join(
                    f"a number of entries and the entries of {one.name}" if one.counts else one.name
                    for one in element.properties
                )
                return _unreadable(
                    self._path, f"{told} in {element.name} {done + number}, line {first + number}", wanted
                )
        full = next((number for number, row in enumerate(words) if not row), len(words))
        found = f"{done + full} of {element.name} up to line {first + full}"
        return _unreadable(self._path, found, f"{element.count}, as the header says")

    def finish(self) -> None:
        rest = [line for line in self._lines if line.strip()]
        if rest:
            found = f"{len(rest)} more lines, from line {self.line} on, {shown(rest[0].decode('latin-1').strip())}"
            raise _unreadable(self._path, found, "the end of the file, as the header says")


class _BinaryRows(_Rows):
    """Those of a binary file."""

    def __init__(self, path: Path, header: Header, content: bytes) -> None:
        self._path, self._order, self._content, self._at = path, header.order, content, header.length

    def _array(self, element: str, kind: Any, count: int) -> NDArray[Any]:
        dtype = np.dtype(kind).newbyteorder(self._order)
        left = len(self._content) - self._at
        if count * dtype.itemsize > left:
            wanted = f"{count * dtype.itemsize}, as the header and the lists say"
            raise _unreadable(self._path, f"{left} bytes for {element}", wanted)
        found = np.frombuffer(self._content, dtype, count, self._at)
        self._at += count * dtype.itemsize
        return found

    def take(self, element: Element) -> dict[str, Any]:
        if not element.has_lists:
            if not element.properties:
                return {}
            kinds = [(f"p{at}", one.kind) for at, one in enumerate(element.properties)]
            table = self._array(element.name, kinds, element.count)
            return {one.name: table[f"p{at}"] for at, one in enumerate(element.properties)}
        start = self._at
        return self._alike(element) or self._each(element, start)

    def _alike(self, element: Element) -> dict[str, Any] | None:
        """Return the rows of an element whose lists are as long as those of its first row, else None."""
        if not element.count:
            return {one.name: [] for one in element.properties}
        start = self._at
        kinds: list[Any] = []
        for at, one in enumerate(element.properties):
            if not one.counts:
                kinds.append((f"p{at}", one.kind))
                self._array(element.name, one.kind, 1)
                continue
            count = self._length_of(element, one, 0)
            kinds += [(f"n{at}", one.counts), (f"p{at}", one.kind, (count,))]
            self._array(element.name, one.kind, count)
        width, self._at = self._at - start, start
        if width * element.count > len(self._content) - start:
            return None
        table = self._array(element.name, kinds, element.count)
        lists = [at for at, one in enumerate(element.properties) if one.counts]
        if any((table[f"n{at}"] != table[f"n{at}"][0]).any() for at in lists):
            self._at = start
            return None
        return {one.name: table[f"p{at}"] for at, one in enumerate(element.properties)}

    def _each(self, element: Element, start: int) -> dict[str, Any]:
        """Return the rows of an element, one by one."""
        self._at = start
        found: dict[str, Any] = {one.name: [] for one in element.properties}
        for row in range(element.count):
            for one in element.properties:
                count = self._length_of(element, one, row) if one.counts else 1
                numbers = self._array(f"{element.name} {row}", one.kind, count)
                found[one.name].append(numbers if one.counts else numbers[0])
        return found

    def _length_of(self, element: Element, one: Property, row: int) -> int:
        count = int(self._array(f"{element.name} {row}", one.counts, 1)[0])
        if count < 0:
            raise _unreadable(self._path, f"a list {one.name} of {count} entries in {element.name} {row}", "0 or more")
        return count

    def finish(self) -> None:
        left = len(self._content) - self._at
        if left:
            raise _unreadable(self._path, f"{left} more bytes after the last element", "the end of the file")
