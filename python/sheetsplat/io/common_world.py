"""Volumes of one body from files whose worlds have other axes, in one picture."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np

from sheetsplat import notices
from sheetsplat._checks import triple
from sheetsplat.fields import Field, RegularField
from sheetsplat.io.axes import placed
from sheetsplat.io.records import Volume
from sheetsplat.orientation import Orientation

_log = logging.getLogger("sheetsplat")


def in_one_world(fields: Sequence[Field]) -> list[Field]:
    """Return fields with those of a body in the world of the first of these: NIfTI's, or DICOM's.

    Fields whose orientation states no front, or none, stay where they are.
    """
    known = [one.orientation for one in fields if one.orientation is not None and one.orientation.front is not None]
    return [_turned(one, known[0]) for one in fields] if known else list(fields)


def _turned(field: Field, world: Orientation) -> Field:
    own = field.orientation
    if own is None or own.front is None:
        return field
    turn = own.turn_to(world)
    if np.array_equal(turn, np.eye(3)):
        return field
    if not isinstance(field, RegularField) or field.lattice != "cartesian" or field.colored:
        notices.warn("the data are turned against each other: their files have other axes of the world, and only "
                     "Cartesian volumes in memory, of values or labels, can be turned")  # fmt: skip
        return field
    origin = triple("origin", np.asarray(field.origin) @ turn)
    volume = placed("the volume", Volume(field.values, origin=origin, axes=field.steps @ turn))
    _log.info("a volume is turned to the axes of the first one")
    place = {"spacing": volume.spacing} if volume.axes is None else {"axes": volume.axes}
    return field.replace(volume.values, origin=volume.origin, **place).with_orientation(world)
