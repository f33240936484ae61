"""Kernels of volumes: their radius and falloff, and whether sums pass through the samples; those of particles: sums."""

from __future__ import annotations

import logging
from typing import TypeVar, cast

from sheetsplat.choose.asked import Asked
from sheetsplat.choose.decisions import AS_GIVEN, Decision, Who, of_quality
from sheetsplat.fields import EllipsoidField, Field, RegularField
from sheetsplat.fields.regular import PLAIN_KERNEL
from sheetsplat.modes import TRAITS
from sheetsplat.quality.samples import prefiltered, through_samples

Made = TypeVar("Made", bound=Field)
# Options that say how a lattice's sums become values: with one of them nothing is left to a prefilter.
_OWN_SUMS = ("normalization", "w0")
_log = logging.getLogger("sheetsplat")


def with_own_kernel(field: Made, asked: Asked) -> Made:
    """Return data that were opened with the kernels that were asked for, and log what was decided."""
    shown, made = with_kernel(field, asked, made=False)
    for setting in of_quality(asked.quality, made).settings:
        _log.info("quality %s: %s", asked.quality, setting)
    return shown


def with_kernel(field: Made, asked: Asked, *, made: bool, mode: object = None) -> tuple[Made, tuple[Decision, ...]]:
    """Return a field with the kernels that a mode shows of it, and what was decided.

    Parameters
    ----------
    field, asked
        The data, and what was asked for.
    made
        Whether the caller made the field.
    mode
        As it was given; None: it is not known.
    """
    if not isinstance(field, RegularField):
        return in_sums(field, mode)
    if field.labels:
        return field, (Decision("labels", True, "samples name things, which are not mixed", "data"),)
    if made and field.settled:
        return field, (Decision("prefilter", field.prefilter, "as the field has it", "caller"),)
    wanted, shown = asked.level.kernel, cast(RegularField, field)
    own = "radius" in asked or "falloff" in asked or (made and (field.radius, field.falloff) != PLAIN_KERNEL)
    radius, falloff = (field.radius, field.falloff) if own or wanted is None else wanted
    by: Who = "caller"
    if "prefilter" in asked:
        reason = AS_GIVEN
        if field.prefilter and (radius, falloff) != (field.radius, field.falloff):
            shown = prefiltered(field, radius, falloff)
    elif sums := [name for name in _OWN_SUMS if name in asked]:
        reason = f"{' and '.join(sums)} as given: sums are divided in another way"
    elif made and field.normalization != "lattice":
        reason = "normalization as the field has it: sums are divided in another way"
    elif wanted is None:
        by, reason = "quality", "plain sums of the samples, which smooth a little"
    else:
        found = through_samples(field, radius, falloff)
        by, reason, shown = "quality", found.reason, found.field
    wide = (shown.radius, shown.falloff) != PLAIN_KERNEL
    why = AS_GIVEN if own else "exact between samples too; frames take twice as long" if wide else "plain"
    whose: Who = "caller" if own else "quality" if wide else "default"
    decided = (
        Decision("prefilter", shown.prefilter, reason, by),
        Decision("radius", shown.radius, why, whose),
        Decision("falloff", shown.falloff, why, whose),
    )
    return cast(Made, shown.as_settled()), decided


def in_sums(field: Made, mode: object) -> tuple[Made, tuple[Decision, ...]]:
    """Return a field whose integrals keep the mass of its particles, where nobody chose how its sums are divided.

    `mode`: as for `with_kernel`; in those that do not integrate the field stays.
    """
    integrates = isinstance(mode, str) and mode in TRAITS and TRAITS[mode].integrates
    summed = field.summed() if integrates and isinstance(field, EllipsoidField) else field
    if summed is field:
        return field, ()
    told = summed.opened_with({**field.opened, "normalization": summed.normalization})
    reason = "kernels are added, not averaged, so that masses are kept"
    return told, (Decision("normalization", summed.normalization, reason, "data"),)
