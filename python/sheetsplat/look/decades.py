"""Values of many decades: whether the histogram asks for their logarithm, and the field of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.fields import BrickedField, BrickedKernels, EllipsoidField, Field, RegularField
from sheetsplat.fields.samples import Samples, samples_of
from sheetsplat.look.histogram import beyond_pictures, choose_for
from sheetsplat.look.measure import with_values
from sheetsplat.options.core import COLORED, MODES
from sheetsplat.options.look import IN_VALUES

# Decades from the 1st to the 99.9th percentile of the kernels, or of the samples.
_DECADES = 3.0
_RANGE = (1.0, 99.9)
# Volumes: and fewer samples than this share would be seen. Integers, as scanners give them, are never that wide.
_LEAST_SEEN = 0.01
# Smaller values are raised to this percentile, from which decades count.
_FLOOR = 0.1
# Largest share of values of exactly 0.
_ZEROS = 0.5


def in_decades(fields: Sequence[Field], look: Mapping[str, Any], log: object) -> list[Field]:
    """Return fields with the logarithms of their values where the histogram asks for them and nobody chose.

    Parameters
    ----------
    fields
        Of a picture. Logarithms of several fields would not add up; they stay as they are.
    look
        The options of the picture; where some of them are values of the field, the field stays as it is.
    log
        The option of this name: only None asks.
    """
    same = list(fields)
    mode = look.get("mode", MODES[0])
    if log is not None or len(same) != 1 or not (isinstance(mode, str) and mode in COLORED):
        return same
    if _holds_pairs(look.get("opacity")) or any(look.get(name) is not None for name in IN_VALUES):
        return same
    floor = floor_of(same[0])
    return same if floor is None else [logarithmic(same[0], floor)]


def _holds_pairs(opacity: object) -> bool:
    if opacity is None or isinstance(opacity, str):
        return False
    try:
        return np.ndim(opacity) == 2  # type: ignore[arg-type]
    except Exception:
        # Objects of others raise whatever they like; whoever reads the option says what is wrong with it.
        return False


def floor_of(field: Field) -> float | None:
    """Return the value from which decades count, or None where values are shown as they are."""
    if field.quantity.floor is not None or field.normalization == "none" and not _interpolates(field):
        # Sums of logarithms mean nothing.
        return None
    if isinstance(field, EllipsoidField):
        positive = None if field.ghosts or beyond_pictures(field.values) else _positive(field.values)
        return None if positive is None or _decades(positive) < _DECADES else _floor(positive)
    return floor_of_samples(field.samples) if isinstance(field, RegularField) else None


def floor_of_samples(values: NDArray[Any] | Samples) -> float | None:
    """Return what `floor_of` does for the samples of a volume."""
    samples = samples_of(values)
    # Of a few numbers far beyond all others a warning tells; their decades are nobody's.
    usable = samples.dtype.kind == "f" and beyond_pictures(samples) is None
    positive = _positive(samples) if usable else None
    if positive is None or _decades(positive) < _DECADES or _shown(positive) >= _LEAST_SEEN:
        return None
    return _floor(positive)


def _floor(positive: NDArray[np.float64]) -> float | None:
    found = float(np.percentile(positive, _FLOOR))
    return found if found > 0 else None


def _interpolates(field: Field) -> bool:
    return isinstance(field, RegularField) and field.prefilter


def stride_of(size: int) -> int:
    """Return of how many samples one is looked at."""
    return max(1, size // 1_000_000) | 1


def _positive(values: NDArray[Any] | Samples) -> NDArray[np.float64] | None:
    """Return the values above 0; None where there are values below 0, or many of exactly 0."""
    samples = samples_of(values)
    flat = samples.every(stride_of(samples.size)).astype(np.float64)
    known = flat[~np.isnan(flat)]
    above = known[known > 0]
    usable = known.size > 1 and known.min() >= 0 and above.size >= (1.0 - _ZEROS) * known.size
    return above if usable else None


def _decades(values: NDArray[np.float64]) -> float:
    low, high = np.percentile(values, _RANGE)
    return float(np.log10(high) - np.log10(low))


def _shown(values: NDArray[np.float64]) -> float:
    """Return the share of samples that an automatic look in the values themselves would show."""
    return float((values > choose_for(values).surface).mean())


def logarithmic(field: Field, floor: float) -> Field:
    """Return a field of log10(value / floor), 0 for smaller values."""
    # Readers are not needed before.
    from sheetsplat.io.kernels import logarithm

    shown: Field
    values: Any
    if isinstance(field, BrickedField | BrickedKernels):
        shown = field.logarithmic(floor)
    elif isinstance(field, RegularField):
        wide = np.float32 if field.values.dtype.itemsize <= 4 else np.float64
        values = logarithm(field.values.astype(np.float64), field.quantity.name or "the samples", floor)
        # NaN samples stay: their kernels are left out.
        values = np.where(np.isnan(field.values), np.nan, values).astype(wide)
        shown = field.replace(values)
    else:
        assert isinstance(field, EllipsoidField)
        values = logarithm(field.values, field.quantity.name or "the values", floor)
        shown = with_values(field, values)
    shown = shown.with_quantity(**asdict(replace(field.quantity, floor=floor))).with_orientation(field.orientation)
    return shown.opened_with({**field.opened, "log": floor})
