"""Sparse lattices as chunks of a file, and as a field.

Chunk "G": version (1 byte), flags (1), number of levels (1), of chunks "L" (1), which levels are not all 0 (2, bit l
for level l), samples along x, y, z (4 each), spacing of level 0, falloff, radius in spacings (4-byte floats), base,
step (8-byte floats), least and largest value of the data (4-byte floats), then what the flags say, in 8-byte floats:
1 (BCC) nothing, 2 (the field ends half a sample distance beyond the samples; BCC: a quarter of the edge) nothing, 4
the origin (3), 8 steps of i, j and k in the world (9; else 1 along each axis), 16 the extent of the samples in index
coordinates (3), which else follows from their numbers, 32 the default distance of slices, which else is the least
length of the steps (BCC: half of it).

Chunk "L": first and last level, counted from the coarsest down (1 byte each), bound and root mean square of the
distances (4-byte floats), then 4-byte words of the range coder (package constriction, RangeEncoder) with the levels
that are not all 0 (`coder`). The tables go on from chunk to chunk.

A coefficient is its whole number times step / norm, the norm (pi / (2 falloff))^(3/4) (radius spacing)^(3/2).
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat.encode.coder import Tables, Whole, range_coder, read_level, write_level
from sheetsplat.encode.container import Chunk, damaged
from sheetsplat.encode.lattices import MOST_LEVELS, Geometry, kernels
from sheetsplat.fields import EllipsoidField
from sheetsplat.fields.axes import axes_of_frames
from sheetsplat.fields.code import Bound

Floats = NDArray[np.float64]

_FIXED = struct.Struct("<BBBBH3I3f2d2f")
_LAYER = struct.Struct("<BB2f")
_VERSION = 1
_BCC, _ENDS, _ORIGIN, _STEPS, _EXTENT, _SLICES = (1 << bit for bit in range(6))
# Bytes of coefficients in a chunk "L" at least, but for the last: coarser levels share one.
_LEAST_BYTES = 1024
# Zeros take at least so many bits: a table keeps a count of each magnitude.
_NODES_OF_A_BYTE = 1 << 14
_ENOUGH = 1 << 20
# Of the file's first bytes, and of the heads of a few chunks.
_OF_CHUNKS = 45


@dataclass(frozen=True)
class Placement:
    """Where the samples' index coordinates are in the world, and what else the field keeps of the data.

    Attributes
    ----------
    shape
        Samples along x, y, z; 0 each for samples that are scattered.
    bcc
        Whether they are a BCC lattice, in index coordinates of its edge.
    origin, steps
        World = origin + coordinates @ steps, (3,) and (3, 3).
    ends
        Whether the field ends where a volume with the boundary "edge" does.
    base
        What coefficients are counted from.
    slice_spacing
        The default distance of slices.
    value_range
        The least and the largest of the data.
    """

    shape: tuple[int, int, int]
    bcc: bool
    origin: Floats
    steps: Floats
    ends: bool
    base: float
    slice_spacing: float
    value_range: tuple[float, float]

    @property
    def usual_slices(self) -> float:
        """The distance of slices of a volume whose axes are at right angles (conventions, section 3)."""
        least = float(np.linalg.norm(self.steps, axis=1).min())
        return 0.5 * least if self.bcc else least

    @property
    def extent(self) -> tuple[float, float, float]:
        """Of a lattice in index coordinates."""
        x, y, z = (float(count - 1) for count in self.shape)
        if self.bcc:
            half = 0.5 * (z >= 1.0)
            return x + half, y + half, 0.5 * z
        return x, y, z


@dataclass(frozen=True)
class LatticeCode:
    """Coefficients of sparse lattices, in steps, by level, and where they are."""

    placement: Placement
    geometry: Geometry
    numbers: list[Whole]
    step: float

    def at_levels(self, first: int) -> LatticeCode:
        """Return the coarser field of the levels from one on."""
        kept = [one if level >= first else np.zeros_like(one) for level, one in enumerate(self.numbers)]
        return replace(self, numbers=kept)

    def field(self) -> EllipsoidField:
        """Return the field of ellipsoids."""
        place = self.placement
        centers, radii, values = kernels(self.geometry, self.numbers, self.step)
        world = place.origin + centers @ place.steps
        lengths = np.linalg.norm(place.steps, axis=1)
        scales: Floats
        rotations = None
        if np.allclose(place.steps @ place.steps.T, np.eye(3) * lengths[0] ** 2, rtol=0, atol=1e-12 * lengths[0] ** 2):
            scales = radii * lengths[0]
        else:
            # The semi-axes of the image of a sphere.
            turned, axes, _ = np.linalg.svd(place.steps.T)
            one, turn = axes_of_frames((turned * axes)[None], flat=False)
            scales = radii[:, None] * one
            rotations = None if turn is None else np.repeat(turn, len(radii), axis=0)
        made = EllipsoidField(
            world, scales, rotations, values + place.base, normalization="none", falloff=self.geometry.falloff,
            base=place.base,
        )  # fmt: skip
        return made.standing_for(self._ends(), place.slice_spacing)

    def _ends(self) -> Any:
        place = self.placement
        if not place.ends:
            return None
        beyond = 0.25 if place.bcc else 0.5
        far = place.extent
        if np.count_nonzero(place.steps - np.diag(np.diag(place.steps))) == 0 and (np.diag(place.steps) > 0).all():
            lower = place.origin - beyond * np.diag(place.steps)
            upper = place.origin + (np.asarray(far) + beyond) * np.diag(place.steps)
            return tuple(lower.tolist()), tuple(upper.tolist()), tuple(map(tuple, np.eye(3).tolist()))
        to_index = np.linalg.inv(place.steps.T)
        first = to_index @ place.origin
        lower, upper = first - beyond, first + np.asarray(far) + beyond
        return tuple(lower.tolist()), tuple(upper.tolist()), tuple(map(tuple, to_index.tolist()))


def layers_of(code: LatticeCode, bounds: dict[int, Bound]) -> list[Chunk]:
    """Return the chunks of a code.

    Parameters
    ----------
    code
    bounds
        The bound of the field of the levels from each on.
    """
    coder = range_coder().queue
    nodes, last = code.geometry.all_nodes(), code.geometry.levels - 1
    full = sum(1 << level for level, one in enumerate(code.numbers) if one.any())
    tables, sizes = Tables(), []
    # The size of all levels, for shares of it.
    pieces: list[tuple[int, int, bytes]] = []
    encoder, first = coder.RangeEncoder(), last
    for level in range(last, -1, -1):
        if full >> level & 1:
            write_level(encoder, code.numbers, nodes, level, tables)
        words = encoder.get_compressed()
        rest = full & ((1 << level) - 1)
        if (words.nbytes >= _LEAST_BYTES and rest) or level == 0:
            pieces.append((last - first, last - level, words.astype("<u4").tobytes()))
            encoder, first = coder.RangeEncoder(), level - 1
            sizes.append(words.nbytes)
    layers = []
    for begin, end, words in pieces:
        bound = bounds[last - end]
        layers.append(Chunk(b"L", _LAYER.pack(begin, end, _upward(bound.max), _upward(bound.rms)) + words))
    return [Chunk(b"G", _header(code, full, len(layers))), *layers]


def size_of_header(place: Placement) -> int:
    """Return how many bytes of a file are taken by what is not coefficients, names aside."""
    more = 3 * bool(place.origin.any()) + 9 * (not np.array_equal(place.steps, np.eye(3)))
    more += 3 * (not any(place.shape)) + (place.slice_spacing != place.usual_slices)
    return _FIXED.size + 8 * more + _OF_CHUNKS


def _upward(value: float) -> float:
    """Return the least float32 that is not below a number."""
    kept = np.float32(value)
    return float(kept if float(kept) >= value else np.nextafter(kept, np.float32(np.inf)))


def _header(code: LatticeCode, full: int, layers: int) -> bytes:
    place, geometry = code.placement, code.geometry
    flags, more = _BCC * place.bcc | _ENDS * place.ends, []
    if place.origin.any():
        flags |= _ORIGIN
        more += place.origin.tolist()
    if not np.array_equal(place.steps, np.eye(3)):
        flags |= _STEPS
        more += place.steps.ravel().tolist()
    if not any(place.shape):
        flags |= _EXTENT
        more += list(geometry.extent)
    if place.slice_spacing != place.usual_slices:
        flags |= _SLICES
        more.append(place.slice_spacing)
    low, high = place.value_range
    fixed = _FIXED.pack(
        _VERSION, flags, geometry.levels, layers, full, *place.shape, geometry.finest, geometry.falloff,
        geometry.radius, place.base, code.step, low, high,
    )  # fmt: skip
    return fixed + struct.pack(f"<{len(more)}d", *more)


def read_header(data: bytes, what: str) -> tuple[LatticeCode, int, int]:
    """Return the code without coefficients, which levels are not all 0, and the number of layers.

    Raises
    ------
    InvalidInput
        For anything that `layers_of` does not write.
    """
    if len(data) < _FIXED.size:
        raise damaged(what, f"a chunk G of {len(data)} bytes", f"at least {_FIXED.size}")
    version, flags, levels, layers, full, nx, ny, nz, *numbers = _FIXED.unpack_from(data)
    finest, falloff, radius, base, step, low, high = (float(one) for one in numbers)
    wanted = 3 * bool(flags & _ORIGIN) + 9 * bool(flags & _STEPS) + 3 * bool(flags & _EXTENT) + bool(flags & _SLICES)
    if version != _VERSION or flags >= 2 * _SLICES or len(data) != _FIXED.size + 8 * wanted:
        raise damaged(what, f"a chunk G of version {version}, {len(data)} bytes", "version 1, as its flags say")
    more = np.frombuffer(data, "<f8", offset=_FIXED.size).astype(np.float64)
    taken = iter(more.tolist())
    origin = np.array([next(taken) for _ in range(3)]) if flags & _ORIGIN else np.zeros(3)
    steps = np.array([next(taken) for _ in range(9)]).reshape(3, 3) if flags & _STEPS else np.eye(3)
    given = (next(taken), next(taken), next(taken)) if flags & _EXTENT else None
    slices = next(taken) if flags & _SLICES else None
    finite = np.isfinite([*numbers, *more]).all() and finest > 0 and radius > 0 and falloff > 0 and step > 0
    fits = 1 <= levels <= MOST_LEVELS and 1 <= layers <= levels and full < 1 << levels
    regular = given is None and min(nx, ny, nz) >= 1
    if not finite or not fits or not (regular or (given is not None and max(nx, ny, nz) == 0 and min(given) >= 0.0)):
        raise damaged(what, "a chunk G with numbers that no encoder writes", "numbers as in the docs")
    with np.errstate(all="ignore"):
        volume = abs(float(np.linalg.det(steps)))
    if not 0.0 < volume < math.inf or (slices is not None and not slices > 0.0):
        raise damaged(what, "steps that lie in a plane", "three directions")
    shape = (nx, ny, nz)
    placement = Placement(shape, bool(flags & _BCC), origin, steps, bool(flags & _ENDS), base, 0.0, (low, high))
    placement = replace(placement, slice_spacing=placement.usual_slices if slices is None else slices)
    geometry = Geometry(given or placement.extent, finest, levels, falloff, radius)
    if max(geometry.extent) / finest > 2.0**30 or radius > 16.0 or not 2.0**-6 <= finest <= 2.0**20:
        raise damaged(what, "lattices beyond all sizes", "what memory holds")
    return LatticeCode(placement, geometry, [], step), full, layers


def read_layers(header: LatticeCode, full: int, layers: list[bytes], what: str) -> tuple[LatticeCode, Bound]:
    """Return the code of the layers that are there, and its bound.

    Raises
    ------
    InvalidInput
        For anything that `layers_of` does not write.
    OutOfMemory
        Where the lattices do not fit.
    """
    nodes, last = header.geometry.all_nodes(), header.geometry.levels - 1
    sizes = [math.prod(one.counts) for one in nodes]
    told = sum(map(len, layers))
    coded = [level for level in range(last + 1) if full >> level & 1]
    if sum(sizes[level] for level in coded) > _ENOUGH + _NODES_OF_A_BYTE * told or sizes[last] > _ENOUGH:
        raise damaged(what, f"lattices of {max(sizes)} nodes in {told} bytes", "as many as were encoded")
    # Levels that are all 0 are not kept: one number stands for them.
    _memory.require(24 * sum(sizes[level] for level in coded) + 64 * sizes[last], f"the lattices of {what}")
    empty = np.zeros((), np.int32)
    numbers = [
        np.zeros(one.shape, np.int32) if level in coded else np.broadcast_to(empty, one.shape)
        for level, one in enumerate(nodes)
    ]
    tables, next_level, bound = Tables(), 0, Bound(math.inf, math.inf)
    coder = range_coder().queue
    for layer in layers:
        if len(layer) < _LAYER.size or (len(layer) - _LAYER.size) % 4:
            raise damaged(what, f"a chunk L of {len(layer)} bytes", "whole words")
        begin, end, most, rms = _LAYER.unpack_from(layer)
        if begin != next_level or not begin <= end <= last or not (most >= 0.0 and rms >= 0.0):
            raise damaged(what, f"levels {begin} to {end}", f"levels from {next_level} on")
        decoder = coder.RangeDecoder(np.frombuffer(layer, "<u4", offset=_LAYER.size).astype("u4"))
        for level in range(last - begin, last - end - 1, -1):
            if full >> level & 1:
                _decode(decoder, numbers, nodes, level, tables, what)
        next_level, bound = end + 1, Bound(most, rms, (), header.placement.value_range)
    return replace(header, numbers=numbers), bound


def _decode(decoder: Any, numbers: list[Whole], nodes: Any, level: int, tables: Tables, what: str) -> None:
    try:
        read_level(decoder, numbers, nodes, level, tables)
    except BaseException as error:
        # The decoder, which is written in Rust, panics about what no encoder wrote.
        if isinstance(error, Exception) and not isinstance(error, AssertionError | ValueError):
            raise
        if not isinstance(error, Exception) and "panic" not in type(error).__name__.lower():
            raise
        raise damaged(what, "words that no encoder writes", "what was written") from None
