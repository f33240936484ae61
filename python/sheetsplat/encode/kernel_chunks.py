"""Scattered kernels as a chunk of a file, and as a field.

Chunk "E": version (1 byte), normalisation (1: 0 none, 1 threshold), flags (1), w0, falloff, base (8-byte floats),
bound and root mean square of the distances, least and largest value of the data (4-byte floats), then what the flags
say, in 8-byte floats: 1 a periodic box (6: lower and upper corner), 2 a box where the field ends (6), 4 the default
distance of slices (1); 8 x-rays are plain sums (nothing). The kernels follow as `ellipsoids` says, values counted
from the base.
"""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np

from sheetsplat.encode.container import Chunk, damaged
from sheetsplat.encode.ellipsoids import unpack
from sheetsplat.fields import EllipsoidField, Normalization
from sheetsplat.fields.code import Bound

_FIXED = struct.Struct("<BBB3d4f")
_VERSION = 1
_PERIODIC, _ENDS, _SLICES, _MASS = (1 << bit for bit in range(4))
_KINDS: tuple[Normalization, ...] = ("none", "threshold")
_UPRIGHT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def kernel_chunk(field: EllipsoidField, data: bytes, bound: Bound, slices: float | None) -> Chunk:
    """Return the chunk of a field whose kernels, counted from the base, are `data`.

    Parameters
    ----------
    field
        Of normalisation "none" or "threshold"; where it ends it does so along the world's axes.
    data
        Of `ellipsoids.pack`.
    bound
        How far it is from the data.
    slices
        The default distance of slices; None: that of the kernels.
    """
    flags, more = 0, []
    if field.periodic is not None:
        flags |= _PERIODIC
        more += [*field.periodic[0], *field.periodic[1]]
    elif field.domain is not None:
        flags |= _ENDS
        more += [*field.domain[0], *field.domain[1]]
    if slices is not None:
        flags |= _SLICES
        more.append(slices)
    flags |= _MASS * field.keeps_mass
    kind = _KINDS.index(field.normalization)
    numbers = (field.w0, field.falloff, field.base, bound.max, bound.rms, *bound.value_range)
    return Chunk(b"E", _FIXED.pack(_VERSION, kind, flags, *numbers) + struct.pack(f"<{len(more)}d", *more) + data)


def field_in(data: bytes, what: str) -> tuple[EllipsoidField, Bound]:
    """Return the field of a chunk "E", and its bound.

    Raises
    ------
    InvalidInput
        For anything that `kernel_chunk` does not write.
    OutOfMemory
        Where the kernels do not fit.
    """
    if len(data) < _FIXED.size:
        raise damaged(what, f"a chunk E of {len(data)} bytes", f"at least {_FIXED.size}")
    version, kind, flags, w0, falloff, base, most, rms, low, high = _FIXED.unpack_from(data)
    wanted = 6 * bool(flags & _PERIODIC) + 6 * bool(flags & _ENDS) + bool(flags & _SLICES)
    if version != _VERSION or kind >= len(_KINDS) or flags > 15 or len(data) < _FIXED.size + 8 * wanted:
        raise damaged(what, f"a chunk E of version {version}", "version 1, as its flags say")
    more = np.frombuffer(data, "<f8", wanted, _FIXED.size).tolist()
    if not np.isfinite([w0, falloff, base, low, high]).all() or any(map(math.isnan, more)) or not min(most, rms) >= 0.0:
        raise damaged(what, "a chunk E with numbers that no encoder writes", "numbers as in the docs")
    box, ends, slices = None, None, None
    if flags & _PERIODIC:
        box, more = (tuple(more[:3]), tuple(more[3:6])), more[6:]
    if flags & _ENDS:
        ends, more = (tuple(more[:3]), tuple(more[3:6]), _UPRIGHT), more[6:]
    if flags & _SLICES:
        slices = float(more[0])
    if (slices is not None and not 0.0 < slices < math.inf) or (ends is not None and not np.isfinite(ends[:2]).all()):
        raise damaged(what, "ends or a distance of slices that no encoder writes", "numbers as in the docs")
    rows = unpack(data[_FIXED.size + 8 * wanted :])
    options: dict[str, Any] = {"periodic": box}
    field = EllipsoidField(
        rows.centers, rows.scales, rows.rotations, rows.values + base, weights=rows.weights,
        normalization=_KINDS[kind], w0=w0, falloff=falloff, base=base, **options,
    )  # fmt: skip
    if ends is not None or slices is not None:
        field = field.standing_for(ends, slices)
    if flags & _MASS:
        field = field.of_particles()
    return field, Bound(most, rms, (), (low, high))
