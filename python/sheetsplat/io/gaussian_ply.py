"""Gaussians, and points, in PLY files: vertices whose properties are known by their names.

3D Gaussian Splatting (Kerbl et al. 2023, "3D Gaussian Splatting for Real-Time Radiance Field Rendering"): a vertex is a
Gaussian with the centre x, y, z, the logarithms of its standard deviations scale_0 … 2, the quaternion rot_0 … 3 (w, x,
y, z, of any length), the logit of its opacity, and coefficients of spherical harmonics, of which f_dc_0 … 2 are the
mean colour. SuperSplat packs these into four whole numbers, which count from ranges that 256 vertices each share.

Volume encoding Gaussians have the logit of a value in place of colour and opacity, weighted ones (W-VEG) also that of a
weight, and standard deviations whose length as a vector is softly capped.

Read here and not by plyfile, which allocates the memory that a header claims before it checks the file's size.
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sheetsplat.errors import option_ref
from sheetsplat.io.checks import checked_shape, listed, require_rows, unreadable
from sheetsplat.io.names import tell_names
from sheetsplat.io.ply_header import Element, read_header
from sheetsplat.io.records import Floats, Scattered
from sheetsplat.io.scalars import choose_scalar, unknown_scalar
from sheetsplat.io.source import Payload, Source
from sheetsplat.orientation import Orientation

_PLACE = ("x", "y", "z")
_SCALE = ("scale_0", "scale_1", "scale_2")
_TURN = ("rot_0", "rot_1", "rot_2", "rot_3")
# Spherical harmonic of degree 0: colour = 1/2 + this times f_dc.
_HARMONIC_0 = 0.28209479177387814
_COLORS = {"red": "f_dc_0", "green": "f_dc_1", "blue": "f_dc_2"}
# What is stored as its logit, by what is shown unless another property is named.
_LOGITS = {"opacity": ("opacity",), "value": ("value", "weight")}
# Scenes keep the axes of the cameras that they are trained from: y points down, z ahead.
_Y_DOWN = Orientation(up=(0.0, -1.0, 0.0))
# Of weighted Gaussians: the length that the vector of standard deviations stays below, and the sum of weights from
# which on values are means: far below that of a single Gaussian within its support.
_CAP = 0.02
_LEAST_WEIGHT = 1e-4
# Vertices that share the ranges of a chunk, and the properties of both.
_SHARING = 256
_PACKED = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
_RANGES = tuple(f"{end}_{of}{axis}" for of in ("", "scale_") for end in ("min", "max") for axis in "xyz")
# Most rows before the vertices that are passed over one by one: lines, and rows with lists.
_MOST_PASSED = 10_000_000
# Characters of a line that is passed over which are read at once.
_PIECE = 1 << 16
# Most characters of a number and its separator.
_LONGEST_WORD = 64
# Positions and other properties of points, which are not what is shown of them.
_NO_SCALARS = (*_PLACE, "nx", "ny", "nz")

Columns = Mapping[str, NDArray[Any]]


def _rows(source: Source) -> tuple[dict[str, Columns], str]:
    """Return the properties of the vertices and of chunks, and the encoding's name."""
    header = read_header(source)
    order, elements = header.order, header.elements
    wanted = {one.name: one for one in elements if one.name in ("vertex", "chunk")}
    if "vertex" not in wanted:
        raise unreadable(source.path, f"elements {listed([one.name for one in elements])}", "an element vertex")
    found: dict[str, Columns] = {}
    source.stream.seek(header.length)
    payload = None if order == "text" else source.payload("raw")
    for element in elements:
        if len(found) == len(wanted):
            break
        if element.name not in wanted or element.name in found:
            _skip(source, payload, order, element)
            continue
        _check(source.path, element)
        dtype = np.dtype(element.numbers).newbyteorder("<" if order == "text" else order)  # type: ignore[arg-type]
        table = _text(source, dtype, element) if payload is None else payload.array(dtype, element.count)
        found[element.name] = {name: table[name] for name in dtype.names or ()}
    names = {"text": "ascii", "<": "little-endian", ">": "big-endian"}
    return found, f"ply, {names[order]}"


def _check(path: Path, element: Element) -> None:
    names = [one.name for one in element.properties]
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise unreadable(path, f"the property {twice[0]!r} twice", "names that differ")
    if element.has_lists:
        raise unreadable(path, f"lists in the element {element.name}", "a number for each property")
    if element.count:
        checked_shape(path, (element.count, max(len(names), 1)), f"element {element.name}")
    require_rows(path, element.count, 12)


def _skip(source: Source, payload: Payload | None, order: str, element: Element) -> None:
    """Go on to the next element; binary lists say in each row how long they are."""
    if (payload is None or element.has_lists) and element.count > _MOST_PASSED:
        found, wanted = f"{element.count} rows of {element.name} before the vertices", f"at most {_MOST_PASSED}"
        raise unreadable(source.path, found, wanted, "write the vertices first")
    if payload is None:
        for _ in range(element.count):
            # Lists may be of any length.
            while (piece := source.stream.readline(_PIECE)) and not piece.endswith(b"\n"):
                pass
            if not piece:
                break
    elif not element.has_lists:
        payload.skip(element.count * element.least_bytes)
    else:
        counts = [np.dtype(one.counts) if one.counts else None for one in element.properties]
        widths = [np.dtype(one.kind).itemsize for one in element.properties]
        big: Literal["big", "little"] = "big" if order == ">" else "little"
        for _ in range(element.count):
            for kind, width in zip(counts, widths, strict=True):
                count = 1
                if kind is not None:
                    count = int.from_bytes(payload.read(kind.itemsize), big, signed=kind.kind == "i")
                    if count < 0:
                        raise unreadable(source.path, f"a list of {count} entries in {element.name}", "0 or more")
                if count:
                    payload.skip(count * width)


def _text(source: Source, dtype: np.dtype[Any], element: Element) -> NDArray[Any]:
    columns, count = len(dtype.names or ()), element.count
    if count * 2 * columns - 1 > source.at_most():
        found = f"at most {source.at_most()} characters of {element.name}"
        raise unreadable(source.path, found, f"{count} rows")
    rows = np.empty((count, columns))
    longest = _LONGEST_WORD * columns
    for row in range(count):
        words = source.stream.readline(longest).split()
        if len(words) != columns:
            found = f"{len(words)} numbers in {element.name} {row}"
            raise unreadable(source.path, found, f"{columns}, as the header says")
        rows[row] = words
    table = np.empty(count, dtype)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        for column, name in enumerate(dtype.names or ()):
            table[name] = rows[:, column]
    return table


def _stacked(columns: Columns, names: tuple[str, ...]) -> Floats:
    return np.stack([columns[name].astype(np.float64) for name in names], axis=1)


def _bits(packed: NDArray[Any], first: int, count: int) -> Floats:
    """Return `count` bits of whole numbers, from bit `first` on, as shares from 0 to 1."""
    return np.asarray(((packed >> np.uint32(first)) & np.uint32((1 << count) - 1)) / ((1 << count) - 1))


def _unpacked(path: Path, packed: Columns, chunks: Columns) -> Columns:
    """Return the properties of Gaussians that SuperSplat packed."""
    missing = [name for name in _PACKED if name not in packed] + [name for name in _RANGES if name not in chunks]
    if missing:
        raise unreadable(path, f"packed vertices without {listed(missing)}", listed([*_PACKED, *_RANGES]))
    whole = [packed[name].dtype for name in _PACKED if packed[name].dtype.kind + str(packed[name].itemsize) != "u4"]
    if whole:
        raise unreadable(path, f"packed numbers of type {whole[0]}", "uint32")
    position, turn, scale, color = (packed[name].astype(np.uint32) for name in _PACKED)
    count = len(position)
    if -(-count // _SHARING) > len(chunks["min_x"]):
        wanted = f"{-(-count // _SHARING)}, one for {_SHARING} vertices"
        raise unreadable(path, f"{len(chunks['min_x'])} chunks", wanted)
    chunk = np.arange(count) // _SHARING

    def within(shares: Floats, low: str, high: str) -> Floats:
        least, most = (chunks[name].astype(np.float64)[chunk] for name in (low, high))
        return np.asarray(least + shares * (most - least))

    found: dict[str, Floats] = {}
    for axis, (name, (first, bits)) in enumerate(zip("xyz", ((21, 11), (11, 10), (0, 11)), strict=True)):
        found[name] = within(_bits(position, first, bits), f"min_{name}", f"max_{name}")
        found[f"scale_{axis}"] = within(_bits(scale, first, bits), f"min_scale_{name}", f"max_scale_{name}")
    # The largest part of a quaternion follows from the other three, each at most 1/sqrt(2) of its length.
    parts = np.stack([(_bits(turn, first, 10) - 0.5) * np.sqrt(2.0) for first in (20, 10, 0)], axis=1)
    largest = (turn >> np.uint32(30)).astype(np.int64)
    whole_turn = np.empty((count, 4))
    whole_turn[np.arange(count), largest] = np.sqrt(np.maximum(1.0 - np.square(parts).sum(axis=1), 0.0))
    others = np.arange(4) != largest[:, None]
    whole_turn[others] = parts.reshape(-1)
    found |= dict(zip(_TURN, whole_turn.T, strict=True))
    for (name, part), first in zip(_COLORS.items(), (24, 16, 8), strict=True):
        shares = _bits(color, first, 8)
        ends = f"min_{name[0]}", f"max_{name[0]}"
        found[part] = ((within(shares, *ends) if ends[0] in chunks else shares) - 0.5) / _HARMONIC_0
    opacity = _bits(color, 0, 8)
    found["opacity"] = np.log(opacity) - np.log1p(-opacity)
    return found


def _scalar(columns: Columns, name: str, logits: tuple[str, ...]) -> Floats:
    numbers = columns[_COLORS.get(name, name)].astype(np.float64)
    if name in logits:
        # An infinite logit is a share of 0 or 1.
        numbers = 1.0 / (1.0 + np.exp(-numbers))
    elif name in _COLORS:
        numbers = 0.5 + _HARMONIC_0 * numbers
    return np.asarray(numbers)


def read(source: Source, scalar: str | None = None) -> Scattered:
    """Read Gaussians, or points where vertices have no sizes.

    The scalar of Gaussians is their opacity, or value, unless another property is named, or red, green or blue; of
    points the property value, scalar or intensity, else the only one. The opacity is 1 / (1 + exp(−opacity)) of the
    file, and so are value and weight; red is 0.5 + 0.28209 f_dc_0 and so on; all others are what the file has. Standard
    deviations are exp(scale), of weighted volume encoding Gaussians capped; the quaternions are normalised, and those
    of length 0 become NaN.

    Raises
    ------
    InvalidInput
        For missing properties, and files that end early.
    """
    path = source.path
    with np.errstate(all="ignore"):
        found, written = _rows(source)
        columns = found["vertex"]
        if "packed_position" in columns:
            columns = _unpacked(path, columns, found.get("chunk", {}))
            written += ", packed"
        details = {"encoding": written}
        missing = [name for name in (*_PLACE, *_SCALE, *_TURN) if name not in columns]
        if not {*missing}.intersection(_PLACE) and {*missing} == {*_SCALE, *_TURN}:
            return _points(path, columns, scalar, details)
        if missing:
            raise unreadable(
                path,
                f"vertices without {listed(missing)}",
                "Gaussians: x y z, scale_0 … scale_2, rot_0 … rot_3, and opacity or value",
                "for a mesh use sheetsplat.fit.read_mesh",
            )
        known = [*columns, *(color for color, part in _COLORS.items() if part in columns)]
        shown = next((name for name in _LOGITS if name in known), None)
        if shown is not None:
            known.insert(0, known.pop(known.index(shown)))
        tell_names(known, shown)
        name = shown if scalar is None else scalar
        if name is None:
            wanted, advice = "opacity or value, or the name of another scalar", "pass " + option_ref("scalar", "...")
            raise unreadable(path, "vertices without opacity and value", wanted, advice)
        if name not in known:
            raise unknown_scalar(path, name, known)
        logits = _LOGITS.get(shown or "", ())
        turns, deviations = _stacked(columns, _TURN), np.exp(_stacked(columns, _SCALE))
        is_weighted = shown == "value" and "weight" in columns
        if is_weighted:
            length = np.sqrt(np.square(deviations).sum(axis=1))[:, None]
            deviations *= np.where(length > 0, _CAP * np.tanh(length / _CAP) / length, 1.0)
        return Scattered(
            _stacked(columns, _PLACE),
            _scalar(columns, name, logits),
            name,
            "veg" if shown == "value" else "3dgs",
            tuple(known),
            deviations=deviations,
            # A quaternion of length 0 is no rotation: NaN.
            rotations=turns / np.sqrt(np.square(turns).sum(axis=1))[:, None],
            weights=_scalar(columns, "weight", logits) if is_weighted else None,
            w0=_LEAST_WEIGHT if shown == "value" else None,
            details=details,
            orientation=None if shown == "value" else _Y_DOWN,
        )


def _points(path: Path, columns: Columns, scalar: str | None, details: dict[str, str]) -> Scattered:
    """Return vertices without sizes as points with one of their other properties."""
    names = [name for name in columns if name not in _NO_SCALARS]
    preferred = [name for name in ("value", "scalar", "intensity") if name in names]
    if scalar is None and not preferred and len(names) != 1:
        found = f"points with {listed(names) or 'nothing'} beside their positions"
        raise unreadable(path, found, "one property to be shown", "pass " + option_ref("scalar", "..."), "scalar")
    name = choose_scalar(path, scalar, preferred, dict.fromkeys(names, 1))[0]
    values = columns[name].astype(np.float64)
    return Scattered(_stacked(columns, _PLACE), values, name, "ply, points", tuple(names), details=details)
