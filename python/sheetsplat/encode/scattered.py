"""Scattered kernels in few bytes: rounded, merged to fewer, or found anew for a volume that few of them make."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from sheetsplat.encode.container import Chunk, written
from sheetsplat.encode.free import Ellipsoids
from sheetsplat.encode.kernel_chunks import field_in, kernel_chunk
from sheetsplat.encode.merging import merged
from sheetsplat.encode.refining import greedy
from sheetsplat.encode.steps import packed
from sheetsplat.errors import complain, option_ref, unusable
from sheetsplat.fields import EllipsoidField
from sheetsplat.fields.code import Bound, Code
from sheetsplat.notices import muted

Floats = NDArray[np.float64]

PERCENTS = (50.0, 90.0, 99.0, 99.9)
# Decibels of rounding where nothing is asked, and the finest; how they change from trial to trial.
_USUAL, _FINEST, _COARSEST, _FINER = 70.0, 200.0, 30.0, 6.0
# Bytes of a kernel that a first trial expects, and trials of fewer kernels.
_BYTES_OF_KERNEL, _TRIALS, _FEWER = 10.0, 8, 0.9
# Points of a kernel at which rounding is tried.
_POINTS_OF_KERNEL = 200
# Digits of float64 that sums of kernels lose.
_ROUNDING = 1e-12
# Free ellipsoids of a volume: bytes of one, how many are tried, and of how many samples.
BYTES_OF_FREE, LEAST_FREE, MOST_FREE, MOST_SAMPLES = 13.0, 4, 100, 1 << 21


def bound_of(off: Floats, span: float, values: Floats) -> Bound:
    """Return the bound of distances, of data of some size of numbers."""
    off = np.abs(off)
    shares = tuple(float(one) for one in np.percentile(off, PERCENTS)) if off.size else ()
    rms = math.sqrt(float(off @ off) / max(1, off.size))
    known = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
    return Bound(float(off.max(initial=0.0)) + _ROUNDING * span, rms, shares, known)


def encoded_kernels(
    field: EllipsoidField, name: str | None, asked: float, names: bytes, told: Callable[[float], None]
) -> EllipsoidField:
    """Return a field of kernels in few bytes.

    Parameters
    ----------
    field
        Of normalisation "none" or "threshold".
    name, asked
        "bytes", "kernels" or "max_error", and its value; None: the same kernels, to some 70 decibels.
    names
        The chunk of names and units.
    told
        Is told the share that is done.
    """
    if field.normalization == "lattice" or not field.size:
        found = f"normalization {field.normalization}" if field.size else "a field without kernels"
        raise complain(
            "fit.encode: the field cannot be encoded", found, 'kernels of normalization "none" or "threshold"'
        )
    exact = field.at(field.centers)
    if name == "kernels":
        few = field if field.size <= asked else merged(field, int(asked))
        told(0.5)
        return _rounded(few, field, exact, _USUAL, names)
    if name == "bytes":
        return _of_size(field, exact, asked, names, told)
    if name is None:
        return _rounded(field, field, exact, _USUAL, names)
    decibels = _USUAL
    while decibels <= _FINEST:
        made = _rounded(field, field, exact, decibels, names)
        if made.code.bound.max <= asked:
            return made
        told(min(0.9, decibels / _FINEST))
        decibels += 2.0 * _FINER
    raise complain(
        unusable("fit.encode: max_error"), f"{asked:g}", f"at least {made.code.bound.max:g}",
        "use a larger " + option_ref("max_error"), option="max_error",
    )  # fmt: skip


def _of_size(
    field: EllipsoidField, exact: Floats, most: float, names: bytes, told: Callable[[float], None]
) -> EllipsoidField:
    count = min(field.size, int(most / _BYTES_OF_KERNEL))
    decibels = _USUAL
    for trial in range(_TRIALS):
        if count < 1:
            break
        few = field if count >= field.size else merged(field, count)
        made = _rounded(few, field, exact, decibels, names)
        told(0.1 + 0.8 * trial / _TRIALS)
        size = len(made.code.data)
        if size <= most:
            return made
        # Rounding more than the kernels' own error is not worth a kernel.
        decibels = max(_COARSEST + 10.0, decibels - _FINER)
        count = int(_FEWER * count * min(1.0, (most / size) ** 0.5))
    raise complain(unusable("fit.encode: bytes"), f"{most:g}", "room for some kernels", "ask for more", option="bytes")


def _rounded(
    few: EllipsoidField, field: EllipsoidField, exact: Floats, decibels: float, names: bytes
) -> EllipsoidField:
    """Return rounded kernels, with their bytes and their bound at the centres of the kernels of a field."""
    return _stored(few, decibels, names, lambda made: made.at(field.centers) - exact, exact, None)


def _stored(
    few: EllipsoidField, decibels: float, names: bytes, off: Callable[[EllipsoidField], Floats], data: Floats,
    slices: float | None,
) -> EllipsoidField:  # fmt: skip
    with muted():
        plain = few.with_rows(few.centers, few.scales, few.rotations, few.values - few.base, few.weights, base=0.0)
        bytes_of_rows = packed(plain, decibels, points=min(50_000, _POINTS_OF_KERNEL * plain.size)).data
        made, _ = field_in(kernel_chunk(few, bytes_of_rows, Bound(0.0, 0.0), slices).data, "the field")
    span = max(float(np.abs(data).max(initial=0.0)), 1e-300)
    bound = bound_of(off(made), span, data)
    up = [float(np.nextafter(np.float32(one), np.float32(np.inf))) for one in (bound.max, bound.rms)]
    chunks = [kernel_chunk(few, bytes_of_rows, bound._replace(max=up[0], rms=up[1]), slices)]
    if names:
        chunks.append(Chunk(b"N", names))
    code = Code(written(chunks), bound)
    return made.of_quantity(few.quantity).with_orientation(few.orientation).encoded_as(code)


def free_ellipsoids(values: Floats, count: int) -> Ellipsoids:
    """Return few free ellipsoids for the samples of a volume, in index coordinates."""
    return greedy(values, count, moves=False)


def stored_ellipsoids(
    free: Ellipsoids, origin: Floats, steps: Floats, values: Floats, most: float, names: bytes,
    ends: tuple[Floats, Floats] | None, slices: float,
) -> EllipsoidField | None:  # fmt: skip
    """Return free ellipsoids as a field whose file is at most so large; None: there is none.

    Parameters
    ----------
    free
        In index coordinates.
    origin, steps
        World = origin + coordinates @ steps.
    values
        The samples, [k, j, i], whose world positions are theirs.
    most
        Bytes.
    names
        The chunk of names and units.
    ends
        Corners of the box where the field ends.
    slices
        The default distance of slices.
    """
    turned, lengths, _ = np.linalg.svd(steps.T @ free.shapes())
    # One more kernel, which adds nothing, reaches every sample: where no kernel reaches pictures are empty.
    middle = 0.5 * (np.array(values.shape[::-1], np.float64) - 1.0)
    reach = 2.0 * float(np.linalg.norm(steps, axis=1) @ (middle + 1.0))
    frames = np.concatenate((turned * lengths[:, None, :], reach * np.eye(3)[None]))
    centers = origin + np.concatenate((free.centers, middle[None])) @ steps
    field = EllipsoidField.from_frames(
        centers, frames, np.append(free.values, 0.0) + free.base, normalization="none", falloff=free.falloff,
        base=free.base,
    )  # fmt: skip
    corners = None if ends is None else (tuple(ends[0].tolist()), tuple(ends[1].tolist()))
    upright = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    field = field.standing_for(None if corners is None else (*corners, upright), slices)
    k, j, i = np.indices(values.shape).reshape(3, -1)
    known = ~np.isnan(values.ravel())
    places = (origin + np.stack((i, j, k), axis=1) @ steps)[known]
    data = values.ravel()[known]
    best: EllipsoidField | None = None
    decibels = _COARSEST
    while decibels <= _FINEST:
        made = _stored(field, decibels, names, lambda one: one.at(places) - data, data, slices)
        if len(made.code.data) > most:
            break
        if best is not None and made.code.bound.rms > 0.98 * best.code.bound.rms:
            return made if made.code.bound.rms < best.code.bound.rms else best
        best = made
        decibels += _FINER
    return best
