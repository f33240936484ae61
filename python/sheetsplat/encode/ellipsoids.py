"""Scattered ellipsoids in few bytes: rounded numbers, in the order of a space-filling curve, in layers.

The bytes, with little-endian fields and the varints and blocks of `columns`:

1. a byte, the version, 1; a byte of flags: 1 spheres, 2 turned ellipsoids (neither: ellipsoids along the axes), 4 with
   weights, 8 with values by their logarithms; a byte, the number of layers, 1 to 16;
2. six float64, the lower and the upper corner of the box of all centres;
3. for each layer, the kernels that contribute most first: a varint, the number of its kernels; four int16 n, each a
   step of 2^(n / 16): of places, shapes, values and weights; a block of the columns
   place, the 1, 3 or 6 coordinates of the shape (`shapes`), value, and, with flag 4, weight;
4. zeros until a byte stands for at most 256 kernels.

A place is a number whose bits 3 j, 3 j + 1 and 3 j + 2 are the bits j of x, y and z (21 each): the world position is
the lower corner plus x, y, z times the step, but nowhere beyond the upper corner. So the box of all centres, by which
pictures anchor their slices, keeps its ends to the bit. A coordinate, and a value, is its number times its step; a
weight, and with flag 8 a value, is e to that. Within a layer kernels are in the order of their places.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat.errors import complain

from .columns import Bytes, Whole, damaged, read_columns, varint, write_columns
from .shapes import SPHERES, STRAIGHT, TURNED, Floats, coordinates, shapes

_VERSION = 1
_SPHERES, _TURNED, _WEIGHTED, _LOGARITHMS = 1, 2, 4, 8
MOST_LAYERS = 16
# Most kernels for which one byte may stand: what a reader allocates is at most some 50 KB for each byte that it has.
_KERNELS_OF_BYTE = 256
_BYTES_OF_KERNEL = 400
# Cells along an axis: three numbers of 21 bits are one of 63.
CELLS = 1 << 21
# What weights of 0 are drawn as (least_drawn_weight of the engine).
_LEAST_WEIGHT = 1e-30
_LARGEST_WEIGHT = 1e300
# Numbers of steps are whole below this.
_LARGEST_NUMBER = 2.0**52
# Shifts and masks that put two bits between every two of a number of 21.
_SPREAD = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)


@dataclass(frozen=True, eq=False)
class Rows:
    """The arrays of a field of ellipsoids, as `EllipsoidField` has them."""

    centers: Floats
    scales: Floats
    rotations: Floats | None
    values: Floats
    weights: Floats | None

    def __len__(self) -> int:
        """Return the number of kernels."""
        return len(self.centers)

    def of(self, chosen: NDArray[np.int64]) -> Rows:
        """Return some of the rows."""
        arrays = (self.centers, self.scales, self.rotations, self.values, self.weights)
        return Rows(*(None if array is None else array[chosen] for array in arrays))  # type: ignore[arg-type]

    @property
    def coordinates(self) -> int:
        """How many coordinates the shapes have."""
        if self.scales.ndim == 1:
            return SPHERES
        return STRAIGHT if self.rotations is None else TURNED


@dataclass(frozen=True)
class Steps:
    """The steps of a layer, in sixteenths of an octave: n stands for 2^(n / 16).

    Attributes
    ----------
    place
        World units.
    shape
        Of the coordinates of `shapes`, lengths relative to the lengths.
    value
        In values.
    weight
        Of logarithms of weights.
    """

    place: int
    shape: int
    value: int
    weight: int

    @staticmethod
    def nearest(step: float) -> int:
        """Return the largest n whose step is no larger than one that is given."""
        return int(np.floor(16.0 * np.log2(step) + 1e-9))

    @staticmethod
    def size(step: int) -> float:
        """Return the step itself; infinite, or 0, beyond float64."""
        with np.errstate(over="ignore", under="ignore"):
            return float(np.exp2(step / 16.0))


def _spread(cells: NDArray[np.uint64]) -> NDArray[np.uint64]:
    for shift, mask in _SPREAD:
        cells = (cells | cells << np.uint64(shift)) & np.uint64(mask)
    return cells


def _gathered(codes: NDArray[np.uint64]) -> NDArray[np.uint64]:
    masks = (*(mask for _, mask in reversed(_SPREAD)), CELLS - 1)
    codes = codes & np.uint64(masks[0])
    for (shift, _), mask in zip(reversed(_SPREAD), masks[1:], strict=True):
        codes = (codes | codes >> np.uint64(shift)) & np.uint64(mask)
    return codes


def _whole(numbers: Floats, step: int, what: str) -> Whole:
    """Return numbers in steps, rounded."""
    found = numbers / Steps.size(step)
    if not (np.abs(found) < _LARGEST_NUMBER).all():
        advice = "use larger steps"
        raise complain(f"{what} cannot be packed", f"steps of {Steps.size(step):g}", "steps that fit them", advice)
    return np.asarray(np.rint(found), dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Frame:
    """What the numbers of all layers count from.

    Attributes
    ----------
    box
        The lower and the upper corner of the box of all centres, (2, 3).
    logarithms
        Whether values, all above 0, are rounded by their logarithms.
    """

    box: Floats
    logarithms: bool

    @staticmethod
    def of(rows: Rows, *, logarithms: bool = False) -> Frame:
        """Return the frame of rows."""
        ends = (rows.centers.min(axis=0), rows.centers.max(axis=0)) if len(rows) else (np.zeros(3), np.zeros(3))
        return Frame(np.stack(ends), logarithms)


def columns_of(rows: Rows, frame: Frame, steps: Steps) -> list[Whole]:
    """Return rows as whole numbers, in their order: place, coordinates of the shape, value, weight.

    Raises
    ------
    InvalidInput
        For steps that are too small for the numbers.
    """
    cells = _whole(rows.centers - frame.box[0], steps.place, "centers")
    # What lies at the upper corner comes back to it: no farther than half a step beyond.
    short = (rows.centers == frame.box[1]) & (frame.box[0] + cells * Steps.size(steps.place) < frame.box[1])
    cells = cells + short
    if len(cells) and not 0 <= cells.min() <= cells.max() < CELLS:
        found = f"{int(cells.max())} steps from side to side"
        raise complain("centers cannot be packed", found, f"fewer than {CELLS}", "use larger steps")
    x, y, z = (_spread(axis.astype(np.uint64)) for axis in cells.T)
    places = (x | y << np.uint64(1) | z << np.uint64(2)).view(np.int64)
    sizes = _whole(coordinates(rows.scales, rows.rotations), steps.shape, "scales")
    values = np.log(rows.values) if frame.logarithms else rows.values
    columns = [places, *sizes.T, _whole(values, steps.value, "values")]
    if rows.weights is not None:
        columns.append(_whole(np.log(np.maximum(rows.weights, _LEAST_WEIGHT)), steps.weight, "weights"))
    return [np.ascontiguousarray(column) for column in columns]


def rows_of(columns: Sequence[Whole], kind: int, frame: Frame, steps: Steps) -> Rows:
    """Return the rows of whole numbers; `kind` is the number of coordinates of shapes.

    Raises
    ------
    InvalidInput
        For numbers that are those of no kernel.
    """
    places = columns[0].view(np.uint64)
    if (columns[0] < 0).any():
        raise damaged("a place of more than 63 bits", "at most 63")
    with np.errstate(all="ignore"):
        cells = np.stack([_gathered(places >> np.uint64(axis)) for axis in range(3)], axis=1)
        centers = np.minimum(frame.box[0] + cells.astype(np.float64) * Steps.size(steps.place), frame.box[1])
        found = shapes(np.stack(columns[1 : kind + 1], axis=1).astype(np.float64) * Steps.size(steps.shape))
        values = columns[kind + 1].astype(np.float64) * Steps.size(steps.value)
        values = np.exp(values) if frame.logarithms else values
        weights = np.exp(columns[kind + 2] * Steps.size(steps.weight)) if len(columns) > kind + 2 else None
    if found is None or not np.isfinite(centers).all() or not np.isfinite(values).all():
        raise damaged("kernels with numbers beyond float64", "finite ones")
    if weights is not None and not ((weights > 0.0) & (weights < _LARGEST_WEIGHT)).all():
        raise damaged("weights beyond float64", f"numbers above 0 and below {_LARGEST_WEIGHT:g}")
    return Rows(centers, *found, values, weights)


def layers_of(rows: Rows, layers: int) -> list[NDArray[np.int64]]:
    """Return the kernels of equally large layers, those with the largest integrals of m g in the first one."""
    radii = np.log(rows.scales)
    mass = 3.0 * radii if radii.ndim == 1 else radii.sum(axis=1)
    if rows.weights is not None:
        mass = mass + np.log(np.maximum(rows.weights, _LEAST_WEIGHT))
    return list(np.array_split(np.argsort(-mass, kind="stable"), layers))


def pack(rows: Rows, steps: Sequence[Steps], *, logarithms: bool = False) -> bytes:
    """Return the bytes of kernels, in as many layers as there are steps (module).

    `logarithms`: values, which are then all above 0, are rounded by their logarithms.

    Raises
    ------
    InvalidInput
        For steps that are too small for the numbers.
    """
    kind, frame = rows.coordinates, Frame.of(rows, logarithms=logarithms)
    flags = {SPHERES: _SPHERES, STRAIGHT: 0, TURNED: _TURNED}[kind]
    flags |= _WEIGHTED * (rows.weights is not None) | _LOGARITHMS * logarithms
    data = bytearray((_VERSION, flags, len(steps))) + struct.pack("<6d", *frame.box.reshape(-1))
    for chosen, own in zip(layers_of(rows, len(steps)), steps, strict=True):
        columns = columns_of(rows.of(chosen), frame, own)
        order = np.argsort(columns[0], kind="stable")
        data += varint(len(chosen)) + struct.pack("<4h", own.place, own.shape, own.value, own.weight)
        data += write_columns([column[order] for column in columns])
    return bytes(data) + bytes(max(0, -(-len(rows) // _KERNELS_OF_BYTE) - len(data)))


def unpack(data: bytes, *, layers: int = MOST_LAYERS) -> Rows:
    """Return the kernels of `pack`, of the first layers alone where fewer are wanted.

    The bytes may be anybody's: nothing in them is believed before it is checked.

    Raises
    ------
    InvalidInput
        For bytes that are not those of kernels.
    OutOfMemory
        Where the kernels do not fit.
    """
    source = Bytes(data)
    version, flags, count = source.take(3)
    if version != _VERSION:
        raise damaged(f"version {version}", f"version {_VERSION}")
    kinds = {_SPHERES: SPHERES, 0: STRAIGHT, _TURNED: TURNED}
    if flags & ~(_WEIGHTED | _LOGARITHMS) not in kinds:
        raise damaged(f"flags {flags}", "spheres or ellipsoids")
    if not 1 <= count <= MOST_LAYERS:
        raise damaged(f"{count} layers", f"1 to {MOST_LAYERS}")
    kind, weighted = kinds[flags & ~(_WEIGHTED | _LOGARITHMS)], bool(flags & _WEIGHTED)
    frame = Frame(np.frombuffer(source.take(48), "<f8").astype(np.float64).reshape(2, 3), bool(flags & _LOGARITHMS))
    if not np.isfinite(frame.box).all():
        raise damaged("a box that is not finite", "six numbers")
    found: list[Rows] = []
    for _ in range(min(count, layers)):
        size = source.varint()
        if sum(map(len, found)) + size > _KERNELS_OF_BYTE * len(data):
            raise damaged(f"{size} kernels in {len(data)} bytes", f"at most {_KERNELS_OF_BYTE} a byte")
        _memory.require(_BYTES_OF_KERNEL * size, f"{size} ellipsoids", "read fewer layers")
        steps = Steps(*(int(n) for n in np.frombuffer(source.take(8), "<i2")))
        columns = read_columns(source, size, 1 + kind + 1 + weighted)
        found.append(rows_of(columns, kind, frame, steps))
    if count <= layers and any(source.take(source.left)):
        raise damaged("bytes after the last layer", "zeros")

    def joined(name: str) -> Floats | None:
        arrays = [getattr(one, name) for one in found]
        return None if arrays[0] is None else np.concatenate(arrays)

    return Rows(*(joined(name) for name in ("centers", "scales", "rotations", "values", "weights")))  # type: ignore[arg-type]
