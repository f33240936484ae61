"""PLOT3D structured grids and solutions: binary, either byte order, single or double precision, one block or several.

A grid is a header of sizes, then per block x, y, z and perhaps IBLANK (int32); a solution the same header, then per
block four numbers (free-stream Mach number, angle of attack, Reynolds number, time) and five arrays: density, three
components of momentum, stagnation energy per volume. Each may be written as Fortran records, with the length of every
record before and after it. A file does not declare its layout, which is found by the exact size of the file. Numbers
are dimensionless as in PLOT3D's manual (Walatka et al., NASA RP-1243). Hand-written, because readers of libraries must
be told the layout, and trust the sizes in a file.
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.errors import complain, option_ref
from sheetsplat.io.checks import require_rows, sides, unreadable
from sheetsplat.io.names import tell_names
from sheetsplat.io.records import Floats, Scattered
from sheetsplat.io.scalars import unknown_scalar
from sheetsplat.io.source import Source
from sheetsplat.io.vtk_cells import hexahedra_of

# More blocks or longer sides indicate the wrong byte order.
_MOST_BLOCKS = 4096
_LONGEST = 1 << 24
# Most unused bytes at the end of a solution; some files have them.
_SURPLUS = 4096
# Magnitudes outside these indicate the wrong byte order.
_TINY, _HUGE = 1e-30, 1e30

_ENDIANS = {"<": "little-endian", ">": "big-endian"}

GAMMA = 1.4

Shape = tuple[int, int, int]


@dataclass(frozen=True)
class Layout:
    """The layout of a file: byte order, Fortran records, blocks, bytes of a float, IBLANK, grid or solution."""

    order: str
    records: bool
    blocks: tuple[Shape, ...]
    several: bool
    itemsize: int
    blanked: bool
    kind: str

    @property
    def header(self) -> int:
        """Bytes before the first block."""
        sizes = 12 * len(self.blocks)
        if not self.several:
            return sizes + 8 * self.records
        return sizes + 4 + 16 * self.records

    def parts(self, shape: Shape) -> list[int]:
        """Return the lengths in bytes of the records of one block."""
        count = math.prod(shape)
        if self.kind == "grid":
            return [count * (3 * self.itemsize + 4 * self.blanked)]
        return [4 * self.itemsize, 5 * count * self.itemsize]

    @property
    def size(self) -> int:
        """Bytes of the file."""
        return self.header + sum(part + 8 * self.records for shape in self.blocks for part in self.parts(shape))

    def __str__(self) -> str:
        """Return the layout in words."""
        words = {
            _ENDIANS[self.order]: True,
            f"float{8 * self.itemsize}": True,
            "Fortran records": self.records,
            "iblank": self.blanked,
            f"{len(self.blocks)} blocks": self.several,
        }
        return ", ".join(word for word, used in words.items() if used) + ", " + _listed(self.blocks)


def _listed(blocks: Sequence[Shape]) -> str:
    return ", ".join(map(sides, blocks[:8]))


def _headers(head: bytes) -> Iterator[tuple[str, bool, bool, tuple[Shape, ...]]]:
    """Yield every valid interpretation of the first bytes: byte order, records, several blocks, their sizes."""
    for order, records, several in itertools.product("<>", (False, True), (False, True)):
        numbers = np.frombuffer(head[: len(head) // 4 * 4], f"{order}i4")
        at, count = 0, 1
        if several:
            at = 3 if records else 1
            if numbers.size < at or (records and not numbers[0] == numbers[2] == 4):
                continue
            count = int(numbers[at - 2] if records else numbers[0])
        if not 1 <= count <= _MOST_BLOCKS:
            continue
        if records:
            length, at = 12 * count, at + 1
            if numbers.size < at + 3 * count + 1 or not numbers[at - 1] == numbers[at + 3 * count] == length:
                continue
        sizes = numbers[at : at + 3 * count].astype(np.int64)
        if sizes.size == 3 * count and np.all((sizes >= 1) & (sizes <= _LONGEST)):
            yield order, records, several, tuple((int(i), int(j), int(k)) for i, j, k in sizes.reshape(-1, 3))


def _find(source: Source, kind: str) -> tuple[list[Layout], int]:
    """Return the layouts that fit the file's size, the best first, and the size, which may be a lower bound."""
    head = source.head(16 + 12 * _MOST_BLOCKS + 8)
    if len(head) < 12:
        raise unreadable(source.path, f"{len(head)} bytes", "a PLOT3D file, which begins with its sizes")
    layouts = [
        Layout(order, records, blocks, several, itemsize, blanked, kind)
        for order, records, several, blocks in _headers(head)
        for itemsize in (4, 8)
        for blanked in ((False, True) if kind == "grid" else (False,))
    ]
    if not layouts:
        first = [", ".join(str(int(part)) for part in np.frombuffer(head[:12], f"{order}i4")) for order in "<>"]
        raise unreadable(
            source.path,
            f"first numbers {first[0]} (little-endian) or {first[1]} (big-endian)",
            "a binary PLOT3D file: three sizes, or the number of blocks and three for each",
            "convert text files",
        )
    longest = source.at_most()
    size = source.length(min(longest, max(layout.size for layout in layouts) + _SURPLUS + 1))
    exact = [layout for layout in layouts if layout.size == size]
    near = [one for one in layouts if kind == "solution" and 0 < size - one.size <= min(_SURPLUS, one.size // 2)]
    # Of several layouts of one size, the simplest first.
    exact.sort(key=lambda one: (one.several, one.itemsize))
    near.sort(key=lambda one: (size - one.size, one.several))
    if exact or near:
        return [*exact, *near], size
    choices = sorted(layouts, key=lambda one: (abs(one.size - size), one.size))[:4]
    raise unreadable(
        source.path,
        f"{size} bytes" + (" or more" if size > max(layout.size for layout in layouts) else ""),
        f"that of a PLOT3D {kind} of its header: " + "; ".join(f"{layout.size} bytes ({layout})" for layout in choices),
        "check that the file is complete"
        + ("" if kind == "grid" else "; pass the grid itself as " + option_ref("grid", "...")),
    )


def _check_order(path: Path, layout: Layout, numbers: NDArray[Any]) -> None:
    """Raise InvalidInput where the numbers are plausible in the other byte order only."""

    def odd(array: NDArray[Any]) -> float:
        with np.errstate(all="ignore"):
            size = np.abs(array)
            return float(np.mean(~np.isfinite(array) | (size > _HUGE) | ((size > 0) & (size < _TINY))))

    here = odd(numbers)
    if here > 0.01 and odd(numbers.view(numbers.dtype.newbyteorder())) < 0.5 * here:
        other = "<" if layout.order == ">" else ">"
        found = f"sizes that are {_ENDIANS[layout.order]} beside numbers that are {_ENDIANS[other]}"
        raise unreadable(path, found, "one byte order in one file", "write the file again")


def _blocks(source: Source, layout: Layout, size: int) -> Iterator[list[NDArray[Any]]]:
    """Yield the records of every block as arrays of bytes."""
    source.stream.seek(0)
    data = source.payload("raw").array(np.dtype(np.uint8), size)
    at = layout.header
    for shape in layout.blocks:
        parts = []
        for length in layout.parts(shape):
            if layout.records:
                ends = [data[mark : mark + 4].view(f"{layout.order}i4")[0] for mark in (at, at + 4 + length)]
                if ends != [length, length]:
                    found = f"a record with the lengths {ends[0]} and {ends[1]}"
                    wanted = f"{length} bytes, as the sizes {sides(shape)} need ({layout})"
                    raise unreadable(source.path, found, wanted)
                at += 4
            parts.append(data[at : at + length])
            at += length + 4 * layout.records
        yield parts


def _read_grid(source: Source) -> tuple[Layout, Floats, NDArray[np.bool_]]:
    """Return the layout, the points of all blocks, and where IBLANK is not 0."""
    layouts, size = _find(source, "grid")
    layout = layouts[0]
    count = sum(map(math.prod, layout.blocks))
    require_rows(source.path, count)
    points = np.empty((count, 3))
    shown = np.ones(count, dtype=bool)
    first = 0
    for shape, (data,) in zip(layout.blocks, _blocks(source, layout, size), strict=True):
        here = math.prod(shape)
        numbers = data[: 3 * here * layout.itemsize].view(f"{layout.order}f{layout.itemsize}")
        _check_order(source.path, layout, numbers)
        points[first : first + here] = numbers.reshape(3, here).T
        if layout.blanked:
            shown[first : first + here] = data[3 * here * layout.itemsize :].view(f"{layout.order}i4") != 0
        first += here
    return layout, points, shown


def _read_solution(source: Source, blocks: tuple[Shape, ...]) -> tuple[Layout, Floats, Floats, int]:
    """Return the layout, the five arrays (5, N), the four numbers of each block, and the unused bytes."""
    layouts, size = _find(source, "solution")
    same = [layout for layout in layouts if layout.blocks == blocks]
    if not same:
        raise unreadable(
            source.path,
            f"a solution of {_listed(layouts[0].blocks)} points",
            f"{_listed(blocks)}, as the grid has",
            "pass the grid that belongs to this solution as " + option_ref("grid", "..."),
        )
    layout = same[0]
    count = sum(map(math.prod, blocks))
    require_rows(source.path, count)
    flow = np.empty((5, count))
    conditions = np.empty((len(blocks), 4))
    first = 0
    number = f"{layout.order}f{layout.itemsize}"
    for block, (four, data) in enumerate(_blocks(source, layout, layout.size)):
        numbers = data.view(number)
        _check_order(source.path, layout, numbers)
        conditions[block] = four.view(number)
        last = first + numbers.size // 5
        flow[:, first:last] = numbers.reshape(5, -1)
        first = last
    return layout, flow, conditions, size - layout.size


def _velocity(q: Floats) -> Floats:
    return np.asarray(q[1:4] / q[0])


def _kinetic(q: Floats) -> Floats:
    """Kinetic energy per volume, |momentum|² / (2 density)."""
    return np.asarray(0.5 * np.square(q[1:4]).sum(axis=0) / q[0])


def _pressure(q: Floats) -> Floats:
    return np.asarray((GAMMA - 1.0) * (q[4] - _kinetic(q)))


def _sound(q: Floats) -> Floats:
    return np.asarray(np.sqrt(GAMMA * _pressure(q) / q[0]))


def _length(vectors: Floats) -> Floats:
    return np.asarray(np.sqrt(np.square(vectors).sum(axis=0)))


# Formulas and functions of q: density, momentum x, y, z, energy. In the units of the file the density, the speed of
# sound and the temperature of the free stream are 1, and the gas constant is 1 / GAMMA.
SCALARS: dict[str, tuple[str, Callable[[Floats], Floats]]] = {
    "density": ("q1", lambda q: q[0]),
    "momentum": ("√(q2² + q3² + q4²)", lambda q: _length(q[1:4])),
    "momentum_x": ("q2", lambda q: q[1]),
    "momentum_y": ("q3", lambda q: q[2]),
    "momentum_z": ("q4", lambda q: q[3]),
    "energy": ("q5, stagnation energy per volume", lambda q: q[4]),
    "velocity": ("momentum / density", lambda q: _length(_velocity(q))),
    "velocity_x": ("momentum_x / density", lambda q: _velocity(q)[0]),
    "velocity_y": ("momentum_y / density", lambda q: _velocity(q)[1]),
    "velocity_z": ("momentum_z / density", lambda q: _velocity(q)[2]),
    "kinetic_energy": ("momentum² / (2 density), per volume", _kinetic),
    "pressure": ("(γ − 1)(energy − kinetic_energy), γ = 1.4", _pressure),
    "temperature": ("γ pressure / density", lambda q: np.asarray(GAMMA * _pressure(q) / q[0])),
    "enthalpy": ("γ / (γ − 1) · pressure / density", lambda q: np.asarray(GAMMA / (GAMMA - 1.0) * _pressure(q) / q[0])),
    "sound_speed": ("√(γ pressure / density)", _sound),
    "mach": ("velocity / sound_speed", lambda q: np.asarray(_length(_velocity(q)) / _sound(q))),
    "entropy": (
        "ln(γ pressure / density^γ) / (γ − 1)",
        lambda q: np.asarray(np.log(GAMMA * _pressure(q) / q[0] ** GAMMA) / (GAMMA - 1.0)),
    ),
}


def read(source: Source, grid: str | os.PathLike[str], scalar: str | None = None) -> Scattered:
    """Read a solution and its grid.

    Parameters
    ----------
    source
        The solution.
    grid
        The file of the grid. The two files may differ in byte order, precision and compression.
    scalar
        A name of `SCALARS`; density unless given.

    Raises
    ------
    InvalidInput
        For files whose sizes are not those of their headers, sizes that differ between the two, byte orders mixed in
        one file, and scalars that are not finite. Points with IBLANK 0 are left out; others are kept.
    """
    name = "density" if scalar is None else scalar
    known = tell_names(SCALARS, "density")
    if name not in known:
        raise unknown_scalar(source.path, name, known)
    with Source(Path(grid)) as other:
        layout, points, shown = _read_grid(other)
    written, flow, conditions, surplus = _read_solution(source, layout.blocks)
    details = {
        "grid": f"{grid} ({layout})",
        "solution": str(written) + (f", {surplus} unused bytes at the end" if surplus else ""),
        "conditions": "; ".join(
            f"Mach {mach:g}, angle {angle:g}, Reynolds {reynolds:g}, time {time:g}"
            for mach, angle, reynolds, time in conditions[:8]
        ),
        "formula": f"{name} = {SCALARS[name][0]}",
    }
    cells = _hexahedra(layout.blocks, shown)
    if not shown.all():
        points, flow = points[shown], flow[:, shown]
        details["blanked"] = f"{int((~shown).sum())} points with iblank 0 are left out"
    with np.errstate(all="ignore"):
        values = np.ascontiguousarray(SCALARS[name][1](flow))
        negative = int((_pressure(flow) <= 0).sum())
    why = ""
    if flow.size and not flow[4].any():
        why = "the energy field of this file is all 0"
    elif np.any(flow[0] <= 0):
        why = "there are densities that are not above 0"
    elif negative:
        why = f"the pressure is not above 0 at {negative} points"
    if why and name in ("pressure", "temperature", "enthalpy"):
        raise complain(f"the scalar {name!r} of {source.path} has no meaning", why, "pressures above 0")
    return Scattered(points, values, name, "plot3d", tuple(SCALARS), cells=cells, details=details, why=why)


def _hexahedra(blocks: tuple[Shape, ...], shown: NDArray[np.bool_]) -> tuple[NDArray[np.int64], ...] | None:
    """Return the cells without blanked corners, (M, 8), with numbers of the points that are left."""
    number = np.cumsum(shown) - 1
    found: list[NDArray[np.int64]] = []
    first = 0
    for ni, nj, nk in blocks:
        if min(ni, nj, nk) > 1:
            cells = first + hexahedra_of((ni, nj, nk))
            found.append(number[cells[shown[cells].all(axis=1)]])
        first += ni * nj * nk
    found = [cells for cells in found if len(cells)]
    return tuple(found) or None
