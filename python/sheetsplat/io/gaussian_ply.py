"""3D Gaussian Splatting scenes in PLY files, as the reference implementation writes them.

Kerbl et al. 2023, "3D Gaussian Splatting for Real-Time Radiance Field Rendering": a vertex is a Gaussian with the
centre x, y, z, the logarithms of its standard deviations scale_0 … 2, the quaternion rot_0 … 3 (w, x, y, z, of any
length), the logit of its opacity, and coefficients of spherical harmonics, of which f_dc_0 … 2 are the mean colour.

Read here and not by plyfile, which allocates the memory that a header claims before it checks the file's size.
"""

from __future__ import annotations

import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.errors import option_ref
from sheetsplat.io.checks import checked_shape, listed, require_rows, unreadable
from sheetsplat.io.ply_header import Element, read_header
from sheetsplat.io.records import Floats, Scattered
from sheetsplat.io.scalars import unknown_scalar
from sheetsplat.io.source import Source
from sheetsplat.orientation import Orientation

_PLACE = ("x", "y", "z")
_SCALE = ("scale_0", "scale_1", "scale_2")
_TURN = ("rot_0", "rot_1", "rot_2", "rot_3")
# Spherical harmonic of degree 0: colour = 1/2 + this times f_dc.
_HARMONIC_0 = 0.28209479177387814
_COLORS = {"red": "f_dc_0", "green": "f_dc_1", "blue": "f_dc_2"}
# Scenes keep the axes of the cameras that they are trained from: y points down, z ahead.
_Y_DOWN = Orientation(up=(0.0, -1.0, 0.0))
# Most characters of a number and its separator.
_LONGEST_WORD = 64


def _vertices(source: Source) -> tuple[NDArray[Any], str]:
    """Return the vertices, an array with a field for each property, and the encoding's name."""
    header = read_header(source)
    order, elements = header.order, header.elements
    before = next((at for at, element in enumerate(elements) if element.name == "vertex"), None)
    if before is None:
        raise unreadable(source.path, f"elements {listed([one.name for one in elements])}", "an element vertex")
    vertex = elements[before]
    _require_properties(source.path, vertex)
    count = vertex.count
    if count:
        checked_shape(source.path, (count, len(vertex.properties)), "element vertex")
    require_rows(source.path, count, 12)
    byte_order = "<" if order == "text" else order
    dtype = np.dtype(vertex.numbers).newbyteorder(byte_order)  # type: ignore[arg-type]
    source.stream.seek(header.length)
    if order == "text":
        return _text(source, dtype, count, sum(element.count for element in elements[:before])), "ply, ascii"
    payload = source.payload("raw")
    for element in elements[:before]:
        if element.has_lists and element.count:
            raise unreadable(source.path, f"lists in {element.name} before the vertices", "vertices first")
        payload.skip(element.count * element.least_bytes)
    name = "little-endian" if order == "<" else "big-endian"
    return payload.array(dtype, count), f"ply, {name}"


def _text(source: Source, dtype: np.dtype[Any], count: int, skipped: int) -> NDArray[Any]:
    columns = len(dtype.names or ())
    if count * 2 * columns - 1 > source.at_most():
        raise unreadable(source.path, f"at most {source.at_most()} characters of vertices", f"{count} vertices")
    rows = np.empty((count, columns))
    longest = _LONGEST_WORD * columns
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


def _require_properties(path: Path, vertex: Element) -> None:
    names = [one.name for one in vertex.properties]
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise unreadable(path, f"the property {twice[0]!r} twice", "names that differ")
    missing = [name for name in (*_PLACE, *_SCALE, *_TURN) if name not in names]
    if vertex.has_lists or missing:
        raise unreadable(
            path,
            "lists in the vertices" if vertex.has_lists else f"vertices without {listed(missing)}",
            "Gaussians: x y z, scale_0 … scale_2, rot_0 … rot_3, and opacity",
            "for a mesh use sheetsplat.fit.read_mesh",
        )


def _scalar(vertices: NDArray[Any], name: str) -> Floats:
    numbers = vertices[_COLORS.get(name, name)].astype(np.float64)
    with np.errstate(over="ignore"):
        if name == "opacity":
            # An infinite logit is an opacity of 0 or 1.
            numbers = 1.0 / (1.0 + np.exp(-numbers))
        elif name in _COLORS:
            numbers = 0.5 + _HARMONIC_0 * numbers
    return np.asarray(numbers)


def read(source: Source, scalar: str | None = None) -> Scattered:
    """Read the Gaussians of a scene; the scalar is opacity unless another property is named, or red, green or blue.

    The opacity is 1 / (1 + exp(−opacity)) of the file, red is 0.5 + 0.28209 f_dc_0 and so on; all others are what the
    file has. Standard deviations are exp(scale); the quaternions are normalised, and those
    of length 0 become NaN.

    Raises
    ------
    InvalidInput
        For missing properties, and files that end early.
    """
    vertices, written = _vertices(source)
    path = source.path
    properties = vertices.dtype.names or ()
    known = [*properties, *(color for color, part in _COLORS.items() if part in properties)]
    if "opacity" in known:
        known.insert(0, known.pop(known.index("opacity")))
    if scalar is None and "opacity" not in known:
        wanted, advice = "opacity, or the name of another scalar", "pass " + option_ref("scalar", "...")
        raise unreadable(path, "vertices without opacity", wanted, advice)
    name = scalar if scalar is not None else "opacity"
    if name not in known:
        raise unknown_scalar(path, name, known)
    points, logarithms, turns = (
        np.stack([vertices[part].astype(np.float64) for part in parts], axis=1) for parts in (_PLACE, _SCALE, _TURN)
    )
    with np.errstate(all="ignore"):
        deviations = np.exp(logarithms)
        # A quaternion of length 0 is no rotation: NaN.
        rotations = turns / np.sqrt(np.square(turns).sum(axis=1))[:, None]
    return Scattered(
        points,
        _scalar(vertices, name),
        name,
        "3dgs",
        tuple(known),
        deviations=deviations,
        rotations=rotations,
        details={"encoding": written},
        orientation=_Y_DOWN,
    )
