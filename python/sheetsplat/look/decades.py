"""Values of many decades: whether a picture shows their logarithm, the field of it, and the field of the values."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import is_off
from sheetsplat.errors import complain, option_ref
from sheetsplat.fields import BrickedField, BrickedKernels, EllipsoidField, Field, RegularField
from sheetsplat.fields.derived import derived
from sheetsplat.fields.samples import Samples, samples_of
from sheetsplat.look.histogram import beyond_pictures, choose_for
from sheetsplat.look.measure import with_values
from sheetsplat.modes import TRAITS
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


def in_decades(fields: Sequence[Field], look: Mapping[str, Any], log: Any) -> list[Field]:
    """Return fields with the logarithms of their values where a picture shows them.

    Modes that add along rays show sums and means of the values, never of their logarithms.

    Parameters
    ----------
    fields
        Of a picture. The histogram never asks for logarithms of several fields, which would not add up.
    look
        The options of the picture; where some of them are values of the field, the histogram is not asked.
    log
        The option of this name; None: as the histogram says.

    Raises
    ------
    InvalidInput
        What `log_base` and `itself` raise.
    """
    same = list(fields)
    if not all(one.has_values for one in same if isinstance(one, RegularField)):
        return same
    mode = look.get("mode", MODES[0])
    if _adds(mode):
        return [itself(one) for one in same]
    if not is_off(log):
        return [_shown_by(one, log) for one in same]
    if log is not None or len(same) != 1 or not (isinstance(mode, str) and mode in COLORED):
        return same
    if _holds_pairs(look.get("opacity")) or any(look.get(name) is not None for name in IN_VALUES):
        return same
    floor = floor_of(same[0])
    return same if floor is None else [logarithmic(same[0], floor)]


def with_log_scale(fields: Sequence[Field], look: Mapping[str, Any], log: Any) -> Mapping[str, Any]:
    """Return the look of a picture; one of sums along rays for which logarithms were asked shows those of the sums.

    `fields`: as they were given; `look`, `log`: as for `in_decades`.
    """
    asked = not is_off(log) or any(one.quantity.floor is not None for one in fields)
    chosen = any(look.get(name) is not None for name in ("scalar_colors", "log_scale"))
    return {**look, "log_scale": True} if _adds(look.get("mode")) and asked and not chosen else look


def _adds(mode: object) -> bool:
    return isinstance(mode, str) and mode in TRAITS and TRAITS[mode].adds


def _shown_by(field: Field, log: Any) -> Field:
    """Return a field with the logarithms that the option `log` asks for; one that has them stays as it is."""
    # Readers are not needed before.
    from sheetsplat.io.kernels import log_base

    if field.quantity.floor is not None or not field.size:
        return field
    values: Any = field.values if isinstance(field, RegularField | EllipsoidField) else np.zeros(0)
    return logarithmic(field, log_base(values, field.quantity.name or "the samples", log))


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
    """Return a field of log10(value / floor), 0 for smaller values. OutOfMemory where they do not fit."""
    # Readers are not needed before.
    from sheetsplat.io.kernels import logarithm

    name = field.quantity.name or "the samples"
    shown = _with_numbers(field, floor, lambda values: logarithm(values, name, floor))
    return shown.opened_with({**field.opened, "log": floor})


def itself(field: Field) -> Field:
    """Return the field of the values whose logarithms a field has; any other field as it is.

    Raises
    ------
    InvalidInput
        Where values may have been raised to the number from which decades count, which cannot be taken back.
    """
    floor, log = field.quantity.floor, field.opened.get("log")
    if floor is None:
        return field
    in_bricks = isinstance(field, BrickedField | BrickedKernels)
    if not (in_bricks or log is None or log is True) and field.value_range[0] <= 0.0:
        raise complain(
            "sums along rays cannot be shown",
            f"logarithms of values raised to {floor:g}",
            "the values themselves",
            "open them without " + option_ref("log") + ", and give it to the picture",
            option="log",
        )
    made = _with_numbers(field, None, lambda values: floor * 10.0**values)
    return made.opened_with({name: one for name, one in field.opened.items() if name != "log"})


def _with_numbers(field: Field, floor: float | None, change: Callable[[NDArray[np.float64]], Any]) -> Field:
    """Return a field whose numbers are decades above `floor`, or values where that is None, by a change of them."""
    shown: Field
    if isinstance(field, BrickedField | BrickedKernels):
        shown = field.logarithmic(floor)
    elif isinstance(field, RegularField):
        _memory.require(3 * 8 * field.values.size, f"the logarithms of {field.quantity.name or 'the samples'}")
        wide = np.float32 if field.values.dtype.itemsize <= 4 else np.float64
        # NaN samples stay: their kernels are left out.
        values = np.where(np.isnan(field.values), np.nan, change(field.values.astype(np.float64))).astype(wide)
        shown = field.replace(values, **({} if floor is not None else {"base": None}))
        shown = derived(shown, field, "floor", floor, field.quantity.floor)
    else:
        assert isinstance(field, EllipsoidField)
        numbers = change(field.values)
        if floor is None:
            # Ghost points have the base.
            numbers[field.size - field.ghosts :] = 0.0
        shown = with_values(field, numbers, **({} if floor is not None else {"base": 0.0}))
    return shown.of_quantity(replace(field.quantity, floor=floor)).with_orientation(field.orientation)
