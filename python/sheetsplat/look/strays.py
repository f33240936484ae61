"""Kernels and samples that would hide everything else: which they are, and fields without them.

Conventions, section 3, let one kernel far from all others make slices coarse; and sums cannot resolve values beside one
that is ten decades larger. A picture whose options leave this open is one of the others.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from sheetsplat.errors import Words, option_ref
from sheetsplat.fields import BrickedField, BrickedKernels, EllipsoidField, Field, RegularField, default_spacing
from sheetsplat.fields.derived import derived
from sheetsplat.fields.samples import ArraySamples, Samples
from sheetsplat.fields.trim import Trim
from sheetsplat.look.histogram import usual_value, within_pictures
from sheetsplat.notices import warn
from sheetsplat.options.core import COLORED, MODES
from sheetsplat.options.look import IN_VALUES

Floats = NDArray[np.float64]

# Strays: at most one in so many kernels, or a few, at least so many times as far from the middle as all others.
_ONE_IN = 1000
_A_FEW = 3
_FAR = 10.0
# Of fewer kernels than this none is a stray, of fewer than the second number one at most.
_FEWEST, _SEVERAL = 20, 100
# Scattered values fade to a base that is so many times their range away.
_FADING = 2.0
# Slices so many times as far apart as kernels call for miss much of them.
COARSE = 2.0
# Options that may be meant for the largest values of the field.
_FOR_LARGEST = tuple(name for name in IN_VALUES if name != "clim")


def kernel_spacing(field: EllipsoidField) -> float:
    """Return the distance of slices that the kernels call for, whatever their extent. Conventions, section 3."""
    thinnest = field.scales if field.scales.ndim == 1 else field.scales.min(axis=1)
    return 0.5 * float(np.median(thinnest))


def without_strays(fields: Sequence[Field], look: Mapping[str, Any], *, framed: bool) -> list[Field]:
    """Return fields without what would hide everything else, and warn of what is left out.

    Parameters
    ----------
    fields
        Of a picture.
    look
        Its options of scene and colours that were given.
    framed
        Whether the camera is chosen by what is seen. One that is given may look at the strays.
    """
    shown = list(fields)
    if not all(one.has_values for one in shown if isinstance(one, RegularField)):
        return shown
    if look.get("mode", MODES[0]) in COLORED and not any(look.get(name) is not None for name in _FOR_LARGEST):
        shown = [_within(one, look.get("clim")) for one in shown]
        if look.get("clim") is None:
            _warn_of_fading(shown)
    shown = [_counted_from_usual(one) for one in shown]
    if framed and look.get("slice_spacing") is None:
        shown = [_near(one, shown) if isinstance(one, EllipsoidField) else one for one in shown]
    return shown


def trimmed(field: Field, trim: Trim) -> Field:
    """Return a field of some data without what a trim leaves out."""
    if not trim:
        return field
    if isinstance(field, BrickedField | BrickedKernels):
        assert trim.limits is not None
        return field.clipped(trim.limits).with_trim(trim)
    values: NDArray[Any] = field.values if isinstance(field, EllipsoidField | RegularField) else np.empty(0)
    if trim.limits is not None:
        values = np.clip(values, *trim.limits).astype(values.dtype)
    if isinstance(field, RegularField):
        return derived(field.replace(values), field, "limits", trim.limits).with_trim(trim)
    made = cast(EllipsoidField, field)
    kept = np.setdiff1d(np.arange(made.size), trim.kernels)
    rotations, weights = (None if rows is None else rows[kept] for rows in (made.rotations, made.weights))
    fewer = made.with_rows(made.centers[kept], made.scales[kept], rotations, values[kept], weights)
    return fewer.weighted_by(None if made.weighting is None else made.weighting[kept]).with_trim(trim)


def _within(field: Field, clim: Any) -> Field:
    """Return a field whose values a picture can resolve beside each other."""
    known = isinstance(field, RegularField) or isinstance(field, EllipsoidField) and not field.ghosts
    if not known or not field.size:
        return field
    volume = isinstance(field, RegularField)
    samples: Samples = field.samples if volume else ArraySamples(field.values)  # type: ignore[attr-defined]
    limits = within_pictures(samples, field.value_range)
    if limits is None or _reaches(clim, limits):
        return field
    low, high = limits
    wrong = np.sort(np.concatenate((samples.beyond(low, above=False), samples.beyond(high, above=True))))
    at: Any = int(wrong[0])
    worst = samples.number(at)
    if volume:
        at = [int(part) for part in np.unravel_index(at, samples.shape)]
    advice: Words = "to leave it out, make it NaN with " + option_ref("nan", "skip") + "; " if volume else Words()
    what = "sample" if volume else "kernel"
    warn(
        f"{len(wrong)} {what}{'s' * (len(wrong) > 1)}, {worst:g} at {at}{' and others' * (len(wrong) > 1)}, "
        f"{'lie' if len(wrong) > 1 else 'lies'} so far beyond all others, {low:g} to {high:g}, that no picture shows "
        f"both: drawn as {min(max(worst, low), high):g}; " + advice + "to see it, pass " + option_ref("clim")
    )
    return trimmed(field, Trim(limits=(low, high)))


def _warn_of_fading(fields: Sequence[Field]) -> None:
    """Warn of scattered values that all lie far from the base to which they fade."""
    for one in fields:
        if not isinstance(one, EllipsoidField) or not one.size or one.ghosts or one.normalization != "threshold":
            continue
        low, high = (value - one.base for value in one.value_range)
        if low < high and max(low, -high) > _FADING * (high - low):
            low, high = one.value_range
            warn(
                f"values {low:g} to {high:g} fade to {one.base:g} where kernels end, through all values between; to "
                "let them fade to one of theirs, give the field a " + option_ref("base", f"{low:.3g}")
            )
            return


def _counted_from_usual(field: Field) -> Field:
    """Return a volume whose values are offset by their median, where nobody gave a base and the data have none.

    Padding is none, though many samples have it: kernels would ripple by a share of what the others differ from it.

    From the middle of the range, which the law of pictures then takes, the background would be counted too: none of its
    kernels could be left out, sums along rays would have the ripple of the kernels as a share of it, and a single
    sample far away would take the digits of all others.
    """
    if not isinstance(field, RegularField) or not field.size or field.boundary != "edge":
        return field
    low, high = field.value_range
    as_summed = field.normalization == "none" and not field.prefilter
    if field.given_base is not None or as_summed or field.base not in (0.5 * low + 0.5 * high, low, high):
        return field
    base = usual_value(field.samples, field.base)
    return field if base == field.base else derived(field.replace(base=base), field, "base", base)


def _reaches(clim: Any, limits: tuple[float, float]) -> bool:
    """Return whether limits of colours that were given go far beyond some values; whoever reads them checks them."""
    try:
        first, last = (float(part) for part in clim)
    except (TypeError, ValueError, OverflowError):
        return False
    width = limits[1] - limits[0]
    return bool(first < limits[0] - 100.0 * width or last > limits[1] + 100.0 * width)


def _near(field: EllipsoidField, fields: Sequence[Field]) -> EllipsoidField:
    """Return one of a picture's fields without its few kernels, far away from all others, that make slices coarse."""
    # Of kernels in bricks a sample alone is known; a warning tells of those far away.
    if field.ghosts or field.size < _FEWEST or isinstance(field, BrickedKernels):
        return field
    wanted = kernel_spacing(field)
    spacing = default_spacing(fields)
    if not spacing > COARSE * wanted > 0.0:
        return field
    middle, reach = _ball(field)
    if not reach > 0.0:
        return field
    alone = _distances(field, middle) > _FAR * reach
    for other in fields:
        if other is not field and other.size:
            middle, reach = _ball(other)
            alone &= _distances(field, middle) > reach
    far = np.flatnonzero(alone)
    if not len(far):
        return field
    first = ", ".join(f"{part:g}" for part in field.centers[far[0]])
    others = f" and {len(far) - 1} more" * (len(far) > 1)
    warn(
        f"{len(far)} of {field.size} kernels, number {field.trim.number_in_data(int(far[0]))} at ({first}){others}, "
        f"left out: {_FAR:g} times as far out as all others; slices would be {spacing:.3g} apart, not "
        f"{wanted:.3g}; to keep them pass " + option_ref("slice_spacing", f"{wanted:.3g}")
    )
    kept = trimmed(field, Trim(kernels=tuple(far.tolist())))
    assert isinstance(kept, EllipsoidField)
    # Values beyond the limits were replaced before.
    return kept.with_trim(Trim(kept.trim.kernels, field.trim.limits))


def _ball(field: Field) -> tuple[Floats, float]:
    """Return middle and radius of a ball around the centres of a field, but for the few that may be strays."""
    if not isinstance(field, EllipsoidField):
        lower, upper = field.centre_bounds
        return 0.5 * np.add(lower, upper), 0.5 * math.dist(lower, upper)
    few = max(1 if field.size < _SEVERAL else _A_FEW, field.size // _ONE_IN)
    middle = np.median(field.centers, axis=0)
    inner = max(field.size - 1 - few, 0)
    return middle, float(np.partition(_distances(field, middle), inner)[inner])


def _distances(field: EllipsoidField, middle: Floats) -> Floats:
    """Return the distances of a field's centres from a point, (N,); no square overflows."""
    largest = float(np.abs(field.centers).max()) or 1.0
    found: Floats = np.linalg.norm((field.centers - middle) / largest, axis=1) * largest
    return found
