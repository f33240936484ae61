"""3D Gaussian Splatting scenes in PLY files, as the reference implementation writes them.

Kerbl et al. 2023, "3D Gaussian Splatting for Real-Time Radiance Field Rendering": a vertex is a Gaussian with the
centre x, y, z, the logarithms of its standard deviations scale_0 … 2, the quaternion rot_0 … 3 (w, x, y, z, of any
length), the logit of its opacity, and coefficients of spherical harmonics, of which f_dc_0 … 2 are the mean colour.

Read here and not by plyfile, which takes the memory that a header claims before it looks at the size of the file.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import shown
from sheetsplat.errors import option_ref
from sheetsplat.io.checks import checked_shape, finite_points, finite_values, listed, require_rows, unreadable
from sheetsplat.io.records import Floats, Scattered
from sheetsplat.io.scalars import unknown_scalar
from sheetsplat.io.source import Source

_HEADER_LIMIT = 1 << 16
_TYPES = {
    "char": "i1",
    "int8": "i1",
    "uchar": "u1",
    "uint8": "u1",
    "short": "i2",
    "int16": "i2",
    "ushort": "u2",
    "uint16": "u2",
    "int": "i4",
    "int32": "i4",
    "uint": "u4",
    "uint32": "u4",
    "float": "f4",
    "float32": "f4",
    "double": "f8",
    "float64": "f8",
}
_PLACE = ("x", "y", "z")
_SCALE = ("scale_0", "scale_1", "scale_2")
_TURN = ("rot_0", "rot_1", "rot_2", "rot_3")
# Spherical harmonic of degree 0: colour = 1/2 + this times f_dc.
_HARMONIC_0 = 0.28209479177387814
_COLORS = {"red": "f_dc_0", "green": "f_dc_1", "blue": "f_dc_2"}
# Most characters of a number and its separator.
_LONGEST_WORD = 64


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    # (name, type) of the properties; None where one is a list.
    properties: list[tuple[str, str]] | None


def _header(source: Source) -> tuple[str, list[_Element], int]:
    """Return "<", ">" or "text", the elements, and the length of the header in bytes."""
    head = source.head(_HEADER_LIMIT)
    end = head.find(b"end_header")
    end = -1 if end < 0 else head.find(b"\n", end) + 1
    if end <= 0:
        raise unreadable(source.path, f"no end_header in the first {len(head)} bytes", "a PLY header")
    order = ""
    names: list[tuple[str, int]] = []
    properties: list[list[tuple[str, str]] | None] = []
    for line in head[:end].decode("latin-1").splitlines()[1:]:
        words = line.split()
        kind = words[0] if words else "comment"
        if kind in ("comment", "obj_info", "end_header"):
            continue
        wrong = unreadable(source.path, f"the line {shown(line)}", "a line of a PLY header")
        if kind == "format" and len(words) == 3 and words[2] == "1.0":
            order = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": "text"}.get(words[1], "")
        elif kind == "element" and len(words) == 3 and words[2].isascii() and words[2].isdigit():
            names.append((words[1], int(words[2]) if len(words[2]) < 20 else 2**62))
            properties.append([])
        elif kind == "property" and properties and len(words) == 3 and words[1] in _TYPES:
            here = properties[-1]
            if here is not None:
                here.append((words[2], _TYPES[words[1]]))
        elif kind == "property" and properties and len(words) == 5 and words[1] == "list":
            properties[-1] = None
        else:
            raise wrong
    if not order:
        raise unreadable(source.path, "no format", "ascii, binary_little_endian or binary_big_endian, version 1.0")
    return order, [_Element(*name, part) for name, part in zip(names, properties, strict=True)], end


def _vertices(source: Source) -> tuple[NDArray[Any], str]:
    """Return the vertices as an array with a field for each property, and the format's name."""
    order, elements, start = _header(source)
    before = next((at for at, element in enumerate(elements) if element.name == "vertex"), None)
    if before is None:
        raise unreadable(source.path, f"elements {listed([one.name for one in elements])}", "an element vertex")
    vertex = elements[before]
    _require_properties(source.path, vertex)
    assert vertex.properties is not None
    count = vertex.count
    if count:
        checked_shape(source.path, (count, len(vertex.properties)), "element vertex")
    require_rows(source.path, count, 12)
    byte_order = "<" if order == "text" else order
    dtype = np.dtype([(name, byte_order + kind) for name, kind in vertex.properties])
    source.seek(start)
    if order == "text":
        return _text(source, dtype, count, sum(element.count for element in elements[:before])), "ply, ascii"
    payload = source.payload("raw")
    for element in elements[:before]:
        if element.properties is None and element.count:
            raise unreadable(source.path, f"lists in {element.name} before the vertices", "vertices first")
        payload.skip(element.count * sum(np.dtype(kind).itemsize for _, kind in element.properties or ()))
    name = "little-endian" if order == "<" else "big-endian"
    return payload.array(dtype, count), f"ply, {name}"


def _text(source: Source, dtype: np.dtype[Any], count: int, skipped: int) -> NDArray[Any]:
    columns = len(dtype.names or ())
    if count * 2 * columns - 1 > source.at_most():
        raise unreadable(source.path, f"at most {source.at_most()} characters of vertices", f"{count} vertices")
    rows = np.empty((count, columns))
    longest = _LONGEST_WORD * max(1, columns)
    for _ in range(skipped):
        if not source.stream.readline(longest):
            break
    for row in range(count):
        words = source.stream.readline(longest).split()
        if len(words) != columns:
            raise unreadable(source.path, f"{len(words)} numbers in vertex {row}", f"{columns}, as the header says")
        rows[row] = words
    vertices = np.empty(count, dtype)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        for column, name in enumerate(dtype.names or ()):
            vertices[name] = rows[:, column]
    return vertices


def _require_properties(path: Path, vertex: _Element) -> None:
    names = [name for name, _ in vertex.properties or ()]
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise unreadable(path, f"the property {twice!r} twice", "names that differ")
    missing = [name for name in (*_PLACE, *_SCALE, *_TURN) if name not in names]
    if vertex.properties is None or missing:
        raise unreadable(
            path,
            f"vertices without {listed(missing)}" if vertex.properties is not None else "lists in the vertices",
            "Gaussians: x y z, scale_0 … scale_2, rot_0 … rot_3, and opacity",
            "this reads scenes of 3D Gaussian Splatting; a surface mesh is no scattered field by itself",
        )


def _scalar(path: Path, vertices: NDArray[Any], name: str) -> Floats:
    with np.errstate(over="ignore"):
        if name == "opacity":
            # 1 / (1 + exp(−x)): an infinite logit is an opacity of 0 or 1.
            return np.asarray(1.0 / (1.0 + np.exp(-vertices["opacity"].astype(np.float64))))
        if name in _COLORS:
            return np.asarray(0.5 + _HARMONIC_0 * vertices[_COLORS[name]].astype(np.float64))
        return np.asarray(vertices[name].astype(np.float64))


def read(source: Source, scalar: str | None = None) -> Scattered:
    """Read the Gaussians of a scene; the scalar is opacity unless another property is named, or red, green or blue.

    The opacity is 1 / (1 + exp(−opacity)) of the file, red is 0.5 + 0.28209 f_dc_0 and so on; all others are what the
    file has. Standard deviations are exp(scale); the quaternions are normalised.

    Raises
    ------
    InvalidInput
        For missing properties, quaternions of length 0, numbers that are not finite, and files that end early.
    """
    vertices, written = _vertices(source)
    path = source.path
    properties = vertices.dtype.names or ()
    known = [*properties, *(color for color, part in _COLORS.items() if part in properties)]
    if "opacity" in known:
        known.insert(0, known.pop(known.index("opacity")))
    if scalar is None and "opacity" not in known:
        raise unreadable(
            path,
            "vertices without opacity",
            "opacity, or the name of another scalar",
            "pass " + option_ref("scalar", "..."),
        )
    name = scalar if scalar is not None else "opacity"
    if name not in known:
        raise unknown_scalar(path, name, known)
    points = np.stack([vertices[part].astype(np.float64) for part in _PLACE], axis=1)
    finite_points(path, points)
    with np.errstate(over="ignore"):
        deviations = np.exp(np.stack([vertices[part].astype(np.float64) for part in _SCALE], axis=1))
    turns = np.stack([vertices[part].astype(np.float64) for part in _TURN], axis=1)
    with np.errstate(all="ignore"):
        lengths = np.sqrt(np.square(turns).sum(axis=1))
    sized = (np.isfinite(deviations) & (deviations > 0)).all(axis=1)
    turned = np.isfinite(lengths) & (lengths > 1e-20)
    for what, wrong in (
        ("scale_0 … scale_2 whose exponential is not finite or 0", ~sized),
        ("a quaternion rot_0 … rot_3 that is 0 or not finite", ~turned),
    ):
        if wrong.any():
            found = f"{what}, in {int(wrong.sum())} vertices, the first is {int(np.argmax(wrong))}"
            raise unreadable(path, found, "Gaussians of finite size and with a direction")
    values = finite_values(path, name, _scalar(path, vertices, name))
    return Scattered(
        points,
        values,
        name,
        "3dgs",
        tuple(known),
        deviations=deviations,
        rotations=turns / lengths[:, None],
        normalization=None,
        details={"encoding": written},
    )
