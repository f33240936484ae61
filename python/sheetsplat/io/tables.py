"""Ellipsoids and points as tables: .npz and .csv."""

from __future__ import annotations

import io
import os
import re
import warnings
import zipfile
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import file_path, instance, shown
from sheetsplat._rows import pieces
from sheetsplat.errors import complain
from sheetsplat.fields import EllipsoidField, periodic_box
from sheetsplat.io import numpy_files, pictures
from sheetsplat.io.checks import Where, listed, unreadable
from sheetsplat.io.records import Floats, Scattered
from sheetsplat.io.scalars import choose_scalar, column_of, scalar_names
from sheetsplat.io.source import Source

_OWN = ("centers", "scales", "radii", "rotations", "weights", "periodic")
_NUMBERS = ("w0", "falloff", "cell_volume", "base")
# Arrays of positions, three numbers a row.
_CENTERS = ("centers", "points", "positions", "position", "coordinates")
# Characters that are parsed at once: Ctrl-C waits for them, some 30 ms.
_CHUNK = 1 << 18
_LONGEST_LINE = 1 << 22
_MOST_COLUMNS = 512
_LONGEST_HEADER = 1 << 16
_FEWER = "use a table of fewer rows or columns"


def holds_ellipsoids(source: Source) -> bool:
    """Return True for an .npz with an array "centers"."""
    source.stream.seek(0)
    with zipfile.ZipFile(source.stream) as archive:
        return "centers.npy" in archive.namelist()


def read_npz(source: Source, scalar: str | None = None) -> Scattered:
    """Read ellipsoids: arrays centers (N, 3), scales (N, 3) or (N,), or radii (N,), values, rotations, weights.

    Rotations are quaternions w, x, y, z, (N, 4). The numbers w0, falloff, cell_volume and base, the box periodic, (2,
    3), and the text normalization of `save_npz` are optional. Without scales and radii the rows are points. Every other
    array of N rows can be the scalar; "values" unless another is named.

    Raises
    ------
    InvalidInput
        For missing or additional rows, and anything pickled.
    """
    path = source.path
    arrays, texts = numpy_files.read_arrays(source, most=_MOST_COLUMNS)
    if "centers" not in arrays:
        raise unreadable(path, f"arrays {', '.join(arrays) or '(none)'}", "an array centers, and values")
    points = arrays["centers"]
    if points.ndim != 2 or points.shape[1] != 3:
        raise unreadable(path, f"centers of shape {points.shape}", "(N, 3)")
    count = len(points)
    one = (count,)
    shapes: dict[str, tuple[tuple[int, ...], ...]] = {
        "scales": ((count, 3), one),
        "radii": (one,),
        "rotations": ((count, 4),),
        "weights": (one,),
        "periodic": ((2, 3),),
        "values": (one, (count, *arrays["values"].shape[1:2])) if "values" in arrays else (),
        **dict.fromkeys(_NUMBERS, ((),)),
        # (As a column it may be the scalar.)
        "base": ((), *((count, *width) for width in ((), arrays["base"].shape[1:2]))) if "base" in arrays else (),
    }
    for name, allowed in shapes.items():
        if name in arrays and arrays[name].shape not in allowed:
            wanted = " or ".join(str(shape) if shape else "a number" for shape in allowed)
            raise unreadable(path, f"{name} of shape {arrays[name].shape}", f"{wanted}, for {count} centers")
    if "scales" in arrays and "radii" in arrays:
        raise unreadable(path, "scales and radii", "one of them")
    rows = {
        name: array
        for name, array in arrays.items()
        if name not in _OWN and array.ndim in (1, 2) and len(array) == count and (array.ndim == 1 or array.shape[1])
    }
    widths = {name: 1 if array.ndim == 1 else array.shape[1] for name, array in rows.items()}
    if not widths:
        raise unreadable(path, f"arrays {', '.join(arrays)}", "an array values, a number for each centre")
    name, base, column = choose_scalar(path, scalar, ("values",), widths)
    numbers: dict[str, Any] = {
        name: float(arrays[name]) for name in _NUMBERS if name in arrays and not arrays[name].ndim
    }
    return Scattered(
        points.astype(np.float64),
        column_of(rows[base], column),
        name,
        "npz, ellipsoids",
        scalar_names(widths),
        scales=_optional(arrays.get("scales", arrays.get("radii"))),
        rotations=_optional(arrays.get("rotations")),
        weights=_optional(arrays.get("weights")),
        normalization=texts.get("normalization"),
        periodic=periodic_box(str(path), arrays.get("periodic")),
        **numbers,
    )


def _optional(array: NDArray[Any] | None) -> Floats | None:
    return None if array is None else array.astype(np.float64)


def save_npz(field: EllipsoidField, path: str | os.PathLike[str]) -> None:
    """Write a field of ellipsoids that `sheetsplat.open` reads.

    Parameters
    ----------
    field
        The field.
    path
        A name with the suffix .npz. An error leaves no file.

    Raises
    ------
    InvalidInput
        For names with another suffix, and where the folder is missing.
    Error
        Where the file cannot be written.

    Examples
    --------
    >>> field = ss.EllipsoidField([(0, 0, 0)], [1.0], values=[1.0])
    >>> ss.io.save_npz(field, "one.npz")
    >>> ss.open("one.npz").values
    array([1.])
    """
    instance("save_npz: the field", field, EllipsoidField)
    target = file_path("the field cannot be saved", path, "a path that ends with .npz")
    if target.suffix.lower() != ".npz":
        raise complain(f"{target} cannot be written", f"the suffix {target.suffix!r}", ".npz")
    names = ("centers", "scales", "rotations", "values", "weights", "normalization", "periodic", *_NUMBERS)
    arrays = {name: getattr(field, name) for name in names if getattr(field, name) is not None}
    pictures.check_folder(target)
    with pictures.whole_file(target) as made, made.open("wb") as stream:
        np.savez(stream, allow_pickle=False, **arrays)


_COLUMNS = ("x", "y", "z", "radius", "sx", "sy", "sz", "qw", "qx", "qy", "qz", "weight")


def _lines(source: Source) -> tuple[list[str], str | None]:
    """Read the names of the columns and their separator, None for white space."""
    source.stream.seek(0)
    first = source.stream.readline(_LONGEST_HEADER)
    text = first.decode("utf-8-sig", "replace").strip().lstrip("#").strip()
    if len(first) >= _LONGEST_HEADER or not text:
        found = "no line of names" if not text else "a first line that is too long"
        raise unreadable(source.path, found, "names of columns")
    part = next((one for one in (",", ";", "\t") if one in text), None)
    names = [name.strip().strip('"') for name in text.split(part)]
    if len(names) > _MOST_COLUMNS or len(set(names)) != len(names):
        raise unreadable(source.path, f"{len(names)} columns, {len(set(names))} names", "names that differ")
    return names, part


def _rows(source: Source, part: str | None, columns: int) -> Floats:
    """Return the numbers of all rows, read in pieces."""
    blocks: list[Floats] = []
    rest = b""
    row = 0
    while True:
        piece = source.stream.read(_CHUNK)
        source.refuse_repetition()
        # For the numbers, and their text during parsing.
        _memory.require(8 * len(piece) + 8 * columns * row, f"the rows of {source.path}", _FEWER)
        whole, cut, rest = (rest + piece).rpartition(b"\n") if piece else (rest, b"", b"")
        if len(rest) > _LONGEST_LINE:
            raise unreadable(source.path, f"a line of more than {_LONGEST_LINE} characters", "lines of numbers")
        if whole.strip():
            block = _numbers(source, whole, part, columns, row)
            blocks.append(block)
            row += len(block)
        if not piece:
            break
    _memory.require(8 * columns * row, f"{row} rows of {source.path}", _FEWER)
    table = np.empty((row, columns))
    # Block by block, so that Ctrl-C need not wait for all of them.
    for block in reversed(blocks):
        table[row - len(block) : row] = block
        row -= len(block)
    return table


def _numbers(source: Source, text: bytes, part: str | None, columns: int, row: int) -> Floats:
    block = _parsed(text, part)
    if block is None:
        # Looking for cells that hold nothing takes longer than to parse the rows.
        text = _with_nan(text, part)
        block = _parsed(text, part)
    if block is None:
        found = _fault(text, part, columns, row) or f"a row after row {row} that is not of numbers"
        raise unreadable(source.path, found, f"{columns} numbers in every row")
    if block.size and block.shape[1] != columns:
        found = f"{block.shape[1]} numbers in row {row}"
        raise unreadable(source.path, found, f"{columns}, as the first line has names")
    return block.reshape(-1, columns)


def _parsed(text: bytes, part: str | None) -> Floats | None:
    """Return the numbers of rows, None where a row is not of as many numbers as the others."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            block: Floats = np.loadtxt(io.BytesIO(text), delimiter=part, comments="#", ndmin=2, encoding="utf-8")
    except (ValueError, UnicodeDecodeError):
        return None
    return block


def _with_nan(text: bytes, part: str | None) -> bytes:
    """Return rows with "nan" in the cells that hold nothing, as pandas and spreadsheets write missing numbers."""
    if part is None:
        return text
    mark = re.escape(part.encode())
    return re.sub(rb"(?<=%b) *(?=%b|\r?$)|^ *(?=%b)" % (mark, mark, mark), b"nan", text, flags=re.MULTILINE)


def _fault(text: bytes, part: str | None, columns: int, row: int) -> str:
    """Return what is wrong with the first row that is not of so many numbers; empty where every row is.

    Rows count from 0; `row` is the number of the first one.
    """
    for line in text.decode("utf-8", "replace").splitlines():
        words = line.partition("#")[0].strip().split(part)
        if words in ([], [""]):
            continue
        if len(words) != columns:
            return f"{len(words)} numbers in row {row}"
        for word in words:
            try:
                float(word)
            except ValueError:
                return f"{shown(word.strip())} in row {row}"
        row += 1
    return ""


def read_csv(source: Source, scalar: str | None = None) -> Scattered:
    """Read a table with the names of columns in its first line: x, y, z, a scalar, and optional ones of kernels.

    These are radius (or r), or sx, sy, sz (semi-axes of the support) with or without qw, qx, qy, qz (quaternion), and
    weight. Every other one can be the scalar; "value" unless another is named. Names may be of any case, separated by
    commas, semicolons, tabs or spaces. Without radius and semi-axes the rows are points.

    Raises
    ------
    InvalidInput
        For missing columns, rows of other lengths, and what is no number.
    """
    path = source.path
    names, part = _lines(source)
    at = _places(path, names)
    if offered := _widths(dict.fromkeys(names, 1), at):
        choose_scalar(path, scalar, _preferred(offered), offered)
    table = _rows(source, part, len(names))
    columns = {name: table[:, column] for column, name in enumerate(names)}
    return _of_columns(path, columns, at, scalar, "csv")


def _widths(columns: Mapping[str, int], at: Mapping[str, str]) -> dict[str, int]:
    """Return the widths of the columns that can be the scalar: those that are no places and no kernels."""
    return {name: width for name, width in columns.items() if name not in at.values()}


def _preferred(names: Iterable[str]) -> list[str]:
    return [name for name in names if name.lower() in ("value", "values", "scalar")]


def _of_columns(
    where: Where, columns: Mapping[str, NDArray[Any]], at: Mapping[str, str], scalar: str | None, file_format: str
) -> Scattered:
    """Return kernels or points from columns by their names; `at`: which of them places and kernels are."""
    widths = _widths({name: 1 if one.ndim == 1 else one.shape[1] for name, one in columns.items()}, at)
    if not widths:
        raise unreadable(where, f"columns {listed(list(columns))}", "one more, value")
    name, base, column = choose_scalar(where, scalar, _preferred(widths), widths)

    def picked(*names: str) -> Floats | None:
        parts = [columns[at[one]] for one in names if one in at]
        made = np.empty((len(parts[0]), len(parts))) if parts else None
        for piece in pieces(len(parts[0]) if parts else 0):
            for column, part in enumerate(parts):
                made[piece, column] = part[piece]  # type: ignore[index]
        return made

    points = picked("x", "y", "z")
    assert points is not None
    radius, weight = picked("radius"), picked("weight")
    scales = picked("sx", "sy", "sz") if radius is None else radius[:, 0]
    return Scattered(
        points,
        column_of(columns[base], column),
        name,
        file_format,
        scalar_names(widths),
        scales=scales,
        rotations=picked("qw", "qx", "qy", "qz"),
        weights=None if weight is None else weight[:, 0],
    )


def _places(where: Where, names: Iterable[str]) -> dict[str, str]:
    """Return which columns positions and kernels are, by the names that they have here."""
    lower = {name.lower(): name for name in names}
    for short, long in (("r", "radius"), ("radii", "radius"), ("weights", "weight")):
        if short in lower and long not in lower:
            lower[long] = lower[short]
    at = {name: lower[name] for name in _COLUMNS if name in lower}
    _require_columns(where, list(names), at)
    return at


def read_columns(data: Any, where: Where, scalar: str | None = None) -> Scattered:
    """Return the kernels or points of a DataFrame, or of a dict of arrays, with columns as those of `read_csv`.

    In a dict an array of N rows of three numbers may stand for x, y, z: centers, points, positions or Coordinates; and
    a scalar may have several columns. What does not hold numbers is left out.

    Raises
    ------
    InvalidInput
        For missing columns, and other lengths.
    """
    columns: dict[str, NDArray[Any]] = {}
    names = list(data.keys() if isinstance(data, Mapping) else data.columns)
    if len(names) > _MOST_COLUMNS:
        raise unreadable(where, f"{len(names)} columns", f"at most {_MOST_COLUMNS}")
    if not {"x", "y", "z", *_CENTERS}.intersection(str(name).lower() for name in names):
        first = shown(names[0] if names else "name")
        raise complain(
            f"{where} cannot be used",
            f"a {type(data).__name__} with the keys {shown(names)}",
            "columns x, y, z and others, an array, a file or fields",
            f"choose one array: RegularField(data[{first}]).with_quantity({first})",
        )
    for name in names:
        column = np.asarray(data[name])
        if column.dtype.kind in "biuf" and column.ndim in (1, 2):
            columns[str(name)] = column
    centers = next((name for name in columns if name.lower() in _CENTERS and columns[name].shape[1:] == (3,)), None)
    if centers is not None:
        positions = columns.pop(centers)
        columns |= {axis: positions[:, at] for at, axis in enumerate("xyz")}
    at = _places(where, columns)
    count = len(columns[at["x"]])
    wrong = [name for name, one in columns.items() if len(one) != count or (one.ndim == 2 and name in at.values())]
    if wrong:
        found = f"a column {shown(wrong[0])} of shape {columns[wrong[0]].shape}"
        raise unreadable(where, found, f"({count},), as x has")
    columns = {name: one for name, one in columns.items() if one.ndim == 1 or one.shape[1]}
    return _of_columns(where, columns, at, scalar, "columns")


def _require_columns(path: Where, names: list[str], at: Mapping[str, str]) -> None:
    advice = "name the columns x,y,z,value,radius or x,y,z,value,sx,sy,sz,qw,qx,qy,qz"
    for group in (("x", "y", "z"), ("sx", "sy", "sz"), ("qw", "qx", "qy", "qz")):
        missing = [name for name in group if name not in at]
        if missing and ("x" in group or len(missing) < len(group)):
            raise unreadable(path, f"columns {', '.join(names)[:200]}", f"also {', '.join(missing)}", advice)
    if "radius" in at and "sx" in at:
        raise unreadable(path, "columns radius and sx, sy, sz", "one of them")
    if "qw" in at and "sx" not in at:
        raise unreadable(path, "a quaternion without sx, sy, sz", "both, or neither")
