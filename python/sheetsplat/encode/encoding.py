"""Few kernels for any field."""

from __future__ import annotations

import json
import math
import os
import pkgutil
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory, _sheetsplat
from sheetsplat._checks import number
from sheetsplat._waiting import ask, asking, note, part
from sheetsplat.encode.coder import Nodes, Whole
from sheetsplat.encode.container import Chunk, chunks_in, damaged, written
from sheetsplat.encode.kernel_chunks import field_in
from sheetsplat.encode.lattice_chunks import LatticeCode, Placement, layers_of, read_header, read_layers, size_of_header
from sheetsplat.encode.lattices import THRESHOLD, Fitted, Fitting, Geometry
from sheetsplat.encode.scattered import (
    BYTES_OF_FREE,
    LEAST_FREE,
    MOST_FREE,
    MOST_SAMPLES,
    PERCENTS,
    encoded_kernels,
    free_ellipsoids,
    stored_ellipsoids,
)
from sheetsplat.errors import complain, option_refs, unusable
from sheetsplat.fields import EllipsoidField, Field, RegularField
from sheetsplat.fields.code import Bound, Code
from sheetsplat.notices import warn
from sheetsplat.quantity import Quantity

if TYPE_CHECKING:
    from sheetsplat.options.renderer import Progress

Floats = NDArray[np.float64]

_WHAT = "fit.encode"
# Of a bound: what the root mean square of the first trial is, and how the step changes from trial to trial.
_RMS_OF_BOUND, _FINER, _FINEST_STEP, _MOST_TRIALS = 0.28, 0.7, 0.7, 10
# The share that is done before free ellipsoids are tried.
_MOST_TOLD = 0.95
# Digits of float64 that sums of kernels lose.
_ROUNDING = 1e-13
# The least bound that is tried for, of the range of values.
_LEAST_BOUND = 1e-7


def encode(
    data: Any,
    *,
    bytes: float | None = None,
    kernels: int | None = None,
    max_error: float | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> EllipsoidField:
    """Return a field of few kernels that is close to data, with a bound of how close.

    Volumes become sparse lattices of kernels of several spacings, whose coefficients are coded in some ten bits each,
    or, of a few hundred bytes, free ellipsoids, if these are closer. Scattered kernels are merged to fewer and rounded;
    without an option they stay as many, and are rounded to 70 decibels of the range (docs/encoding.md).

    Parameters
    ----------
    data
        What `sheetsplat.open` and `sheetsplat.render` take: an array, a volume, kernels, a path.
    bytes
        Most bytes of the file.
    kernels
        Most kernels.
    max_error
        Bound of |scalar - data| at every sample, units of the data; of kernels, at every centre, from the scalar there.
    seed
        Nothing is left to chance; the same data and options give the same bytes.
    progress
        Called now and then with the share that is done, in [0, 1]; if it returns False, `Cancelled` is raised.

    Returns
    -------
    EllipsoidField
        Of a volume: of normalisation "none", ending where the volume ends. Its `bound` says how far it is from the
        data, `save` writes it to a .ssk file.

    Raises
    ------
    InvalidInput
        For data that are labels, colours or several fields, without any option or with several of them, and for sizes
        and bounds that cannot be kept.
    OutOfMemory
        Where the lattices do not fit.

    Examples
    --------
    >>> k, j, i = np.mgrid[:24, :24, :24]
    >>> few = ss.fit.encode(np.hypot(i - 11, j - 12) + 0.2 * k, bytes=600)
    >>> few.bound.rms < 0.5
    True
    """
    options = {"bytes": bytes, "kernels": kernels, "max_error": max_error}
    given = {name: number(f"{_WHAT}: {name}", one) for name, one in options.items() if one is not None}
    for option, one in given.items():
        if not (math.isfinite(one) and one > 0.0):
            raise complain(unusable(f"{_WHAT}: {option}"), f"{one:g}", "a finite number above 0", option=option)
    field = only_field(pkgutil.resolve_name("sheetsplat.api:to_fields")(data))
    if len(given) != 1 and (given or isinstance(field, RegularField)):
        found = option_refs(given) if given else "none of them"
        raise complain(f"{_WHAT} cannot be used", found, "one of " + option_refs(options), "give one of them")
    chosen: tuple[str | None, float] = next(iter(given.items()), (None, 0.0))
    name, asked = chosen
    with asking(progress, "the encoding"):
        if isinstance(field, EllipsoidField):
            made = encoded_kernels(field, name, asked, _names(field.quantity), _told)
        else:
            assert name is not None
            made = _encoded_volume(field, name, asked)
        _told(1.0)
    return made


def _told(share: float) -> None:
    note(share)
    ask()


def only_field(fields: Sequence[Field]) -> RegularField | EllipsoidField:
    """Return the one field of some that can be encoded; InvalidInput for several, and for others than values."""
    if len(fields) != 1:
        raise complain(f"{_WHAT} cannot be used", f"{len(fields)} fields", "one", "encode them one by one")
    (field,) = fields
    if isinstance(field, EllipsoidField) or (isinstance(field, RegularField) and field.has_values):
        return field
    found = "labels or colours" if isinstance(field, RegularField) else type(field).__name__
    raise complain(f"{_WHAT} cannot be used", found, "values", "encode volumes of values, or kernels")


class _Volume:
    """A volume as samples, from the middle of its values and over their range."""

    def __init__(self, field: RegularField) -> None:
        samples = field.samples.on_grid((1, 1, 1))
        _memory.require(5 * 4 * samples.size + 8 * samples.size, "encoding a volume", "encode a part of it")
        low, high = field.value_range
        self.range = high - low
        self.placement = Placement(
            (samples.shape[2], samples.shape[1], samples.shape[0]),
            field.lattice == "bcc",
            np.asarray(field.origin, np.float64),
            np.diag((field.spacing[0],) * 3) if field.lattice == "bcc" else np.asarray(field.steps, np.float64),
            field.domain is not None,
            field.base if low <= field.base <= high else 0.5 * (low + high),
            field.default_slice_spacing,
            (low, high),
        )
        self.samples = samples
        self.missing = int(np.isnan(samples).sum()) if samples.dtype.kind == "f" else 0

    def grids(self) -> list[tuple[tuple[float, float, float], Floats]]:
        """Return the samples in grids of unit distance, less the base and over the range, with their offsets."""
        scaled = (self.samples.astype(np.float64) - self.placement.base) / (self.range or 1.0)
        if self.placement.bcc:
            grids = [((0.0, 0.0, 0.0), scaled[::2]), ((0.5, 0.5, 0.5), scaled[1::2])]
            return [(at, np.ascontiguousarray(one)) for at, one in grids if one.size]
        return [((0.0, 0.0, 0.0), scaled)]

    def nodes_of_samples(self, nodes: Nodes) -> NDArray[np.int64]:
        """Return the node of level 0 where each sample of the grids is."""
        found = []
        for offset, grid in self.grids():
            along = [
                np.rint((np.arange(count) + offset[axis]) / nodes.spacing).astype(np.int64) - nodes.first[axis]
                for axis, count in zip((2, 1, 0), grid.shape, strict=True)
            ]
            x, y, _ = nodes.counts
            found.append((((along[0][:, None] * y + along[1])[:, :, None]) * x + along[2]).ravel())
        return np.concatenate(found)

    def descent(self, geometry: Geometry) -> Callable[[list[Nodes], bool], _sheetsplat.LatticeDescent]:
        """Return what makes the descent on the samples."""
        threads = max(1, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)

        def make(nodes: list[Nodes], exact: bool) -> _sheetsplat.LatticeDescent:
            levels: Any = [tuple(one) for one in nodes]
            return _sheetsplat.LatticeDescent(self.grids(), levels, geometry.falloff, geometry.radius, threads, exact)

        return make


def _encoded_volume(field: RegularField, name: str, asked: float) -> EllipsoidField:
    volume = _Volume(field)
    if volume.missing:
        warn(f"{volume.missing} samples are missing: the encoded field goes on there, and its bound holds elsewhere")
    geometry = Geometry.of(volume.placement.extent, 0.5 if volume.placement.bcc else 1.0)
    fitting = Fitting(volume.descent(geometry), geometry, _told)
    names = _names(field.quantity)
    beside = size_of_header(volume.placement) + len(names)
    if volume.range == 0.0:
        fitted = Fitted([np.zeros(one.shape, np.int32) for one in fitting.nodes], 1.0)
    elif name == "max_error":
        fitted = _for_bound(fitting, volume, asked)
    else:
        measure = fitting.size if name == "bytes" else _kernels_in
        least = beside if name == "bytes" else math.prod(fitting.nodes[-1].counts)
        if asked < least:
            raise complain(unusable(f"{_WHAT}: {name}"), f"{asked:g}", f"at least {least}", "ask for more", option=name)
        fitted = fitting.for_size(asked - beside if name == "bytes" else asked, measure)
    free = _free(field, volume, name, asked, names) if volume.range > 0.0 else None
    while True:
        made = _finished(volume, fitting, fitted, names)
        size = len(made.code.data)
        if name != "bytes" or size <= asked or not any(one.any() for one in fitted.numbers):
            if free is not None and free.code.bound.rms < made.code.bound.rms:
                made = free
            return made.of_quantity(field.quantity).with_orientation(field.orientation)
        # The estimate of the size was below it.
        beside += max(8, size - int(asked))
        fitted = fitting.for_less(fitted, asked - beside, fitting.size)


def _free(field: RegularField, volume: _Volume, name: str, asked: float, names: bytes) -> EllipsoidField | None:
    """Return free ellipsoids for a volume of which so few are asked for that they may be closer; None: not so few."""
    place = volume.placement
    count = int((asked - size_of_header(place) - len(names)) / BYTES_OF_FREE) if name == "bytes" else int(asked) - 1
    box = field.domain
    upright = np.count_nonzero(place.steps - np.diag(np.diag(place.steps))) == 0
    if (
        name == "max_error"
        or not LEAST_FREE <= count <= MOST_FREE
        or volume.samples.size > MOST_SAMPLES
        or place.bcc
        or not upright
    ):
        return None
    ends = None if box is None else (np.asarray(box[0]), np.asarray(box[1]))
    values = volume.samples.astype(np.float64)
    with part(_MOST_TOLD, 1.0):
        free = free_ellipsoids(values, count)
    most = asked if name == "bytes" else math.inf
    return stored_ellipsoids(free, place.origin, place.steps, values, most, names, ends, place.slice_spacing)


def _kernels_in(numbers: list[Whole]) -> float:
    return float(sum(np.count_nonzero(one) for one in numbers[:-1]) + numbers[-1].size)


def _names(quantity: Quantity) -> bytes:
    told = {"name": quantity.name, "unit": quantity.unit, "length_unit": quantity.length_unit}
    kept = {key: one for key, one in told.items() if one}
    return json.dumps(kept, ensure_ascii=False).encode() if kept else b""


def _finished(volume: _Volume, fitting: Fitting, fitted: Fitted, names: bytes) -> EllipsoidField:
    """Return the field of coefficients, with its bytes and its bound."""
    placement, span = volume.placement, volume.range or 1.0
    code = LatticeCode(placement, fitting.geometry, fitted.numbers, fitted.step * span)
    bounds: dict[int, Bound] = {}
    reach = max(abs(placement.value_range[0]), abs(placement.value_range[1]), span)
    for level, residual in fitting.exact(fitted.numbers, fitted.step):
        off = np.abs(residual[~np.isnan(residual)])
        shares = tuple(float(one) * span for one in np.percentile(off, PERCENTS)) if level == 0 and off.size else ()
        largest = float(off.max(initial=0.0)) * span + _ROUNDING * reach
        rms = math.sqrt(float(off @ off) / max(1, off.size)) * span
        bounds[level] = Bound(largest, rms, shares, placement.value_range)
    chunks = layers_of(code, bounds)
    if names:
        chunks.insert(1, Chunk(b"N", names))
    return code.field().encoded_as(Code(written(chunks), bounds[0]))


def _for_bound(fitting: Fitting, volume: _Volume, asked: float) -> Fitted:
    """Return coefficients that keep a bound at every sample."""
    bound = asked / volume.range * (1.0 - 1e-9) - _ROUNDING * 4.0
    if bound < _LEAST_BOUND:
        raise complain(
            unusable(f"{_WHAT}: max_error"), f"{asked:g}", f"at least {_LEAST_BOUND * volume.range:g}",
            "keep the data as they are", option="max_error",
        )  # fmt: skip
    count = volume.samples.size - volume.missing
    step = bound
    for threshold in fitting.soften():
        squares, _ = fitting.descent.misfit()
        step = threshold / THRESHOLD
        # Rounding to finer steps than these does not bring samples nearer; noise is left to corrections.
        if math.sqrt(squares / count) <= _RMS_OF_BOUND * bound or step <= _FINEST_STEP * bound:
            break
    step = min(step, 1.5 * bound)
    fitting.settle(step)
    for _ in range(_MOST_TRIALS):
        fitting.round_off(step)
        found = fitting.corrected(step, bound * (1.0 - 1e-6), volume.nodes_of_samples(fitting.nodes[0]))
        if found is not None:
            return found
        step *= _FINER
    raise complain(
        f"{_WHAT}: max_error cannot be kept", f"a distance of more than {asked:g} at some samples", "a larger bound",
        "ask for a larger bound", option="max_error",
    )  # fmt: skip


def decoded(data: bytes, what: str) -> EllipsoidField:
    """Return the field of the bytes of a .ssk file.

    Raises
    ------
    InvalidInput
        For anything that is no encoded field.
    """
    chunks, whole = chunks_in(data, what)
    kinds = b"".join(one.kind for one in chunks)
    names = next((one.data for one in chunks if one.kind == b"N"), b"")
    if kinds.startswith(b"E") and kinds.count(b"E") == 1 and b"G" not in kinds:
        made, bound = field_in(chunks[0].data, what)
        made = made.encoded_as(Code(data, bound))
        return made.with_quantity(**_quantity(names, what)) if names else made
    if not kinds.startswith(b"G") or kinds.count(b"G") > 1:
        raise damaged(what, f"chunks {kinds[:8]!r}", "a chunk G or E first")
    header, full, wanted = read_header(chunks[0].data, what)
    layers = [one.data for one in chunks if one.kind == b"L"]
    if not layers or len(layers) > wanted or (whole and len(layers) < wanted):
        raise damaged(what, f"{len(layers)} chunks L", f"{wanted}")
    code, bound = read_layers(header, full, layers, what)
    if len(layers) < wanted:
        warn(f"{what} ends early: it shows a coarser field, up to {bound.max:.3g} from the data; copy the whole file")
    field = code.field().encoded_as(Code(data, bound))
    return field.with_quantity(**_quantity(names, what)) if names else field


def _quantity(data: bytes, what: str) -> dict[str, Any]:
    try:
        found = json.loads(data)
    except (ValueError, RecursionError):
        found = None
    known = ("name", "unit", "length_unit")
    if not isinstance(found, dict) or not all(key in known and isinstance(one, str) for key, one in found.items()):
        raise damaged(what, "a chunk N", "names and units")
    return {key: one[:200] for key, one in found.items()}
