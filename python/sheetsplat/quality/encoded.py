"""What pictures of encoded fields differ from those of the data: in the error of a picture."""

from __future__ import annotations

from typing import Any

import numpy as np

from sheetsplat.fields import EllipsoidField, Field
from sheetsplat.image import ErrorEstimate
from sheetsplat.scene import Scene

#: The cause in an error's budget.
CAUSE = "the encoded field"
# How far fields are moved, in root mean squares of their errors: shading and maxima show more of them than values do.
_TIMES = 2.0


def moved_scenes(scene: Scene) -> tuple[Scene, ...]:
    """Return the scenes whose encoded fields are higher, and lower, by twice the root mean square of their errors.

    None where no field is encoded.
    """
    if not any(_rms(one) for one in scene.fields):
        return ()
    several = len(scene.groups) > 1
    made = []
    for sign in (1.0, -1.0):
        groups = [[_moved(one, sign) for one in group] for group in scene.groups]
        made.append(scene.sketch(field=groups if several else groups[0]))
    return tuple(made)


def _rms(field: Field) -> float:
    bound = field.bound if isinstance(field, EllipsoidField) else None
    return 0.0 if bound is None else bound.rms


def _moved(field: Field, sign: float) -> Field:
    if not _rms(field):
        return field
    assert isinstance(field, EllipsoidField)
    by = sign * _TIMES * _rms(field)
    rows = field.centers, field.scales, field.rotations, field.values + by, field.weights
    return field.with_rows(*rows, base=field.base + by)


def with_encoding(found: ErrorEstimate, drawn: Any, moved: list[Any]) -> ErrorEstimate:
    """Return an estimate with the larger of the differences of pictures of moved fields, pixel by pixel.

    Errors of a field that differ in sign along a ray change a picture less than a field that is moved everywhere.
    """
    scalar = drawn.scalar is not None
    own = np.nan_to_num(np.asarray(drawn.scalar if scalar else drawn.rgba, np.float64))
    scale = max(1.0, float(np.abs(own).max(initial=0.0))) if scalar else 1.0
    squares = np.zeros(own.shape[:2])
    for one in moved:
        other = np.nan_to_num(np.asarray(one.scalar if scalar else one.rgba, np.float64))
        off = np.square((other - own) / scale)
        np.maximum(squares, off if scalar else off.mean(axis=2), out=squares)
    part = float(np.sqrt(squares.mean())) if squares.size else 0.0
    total = np.square(found.map.astype(np.float64)) + squares
    return ErrorEstimate(
        float(np.hypot(found.rmse, part)), found.budget | {CAUSE: part}, np.sqrt(total).astype(np.float32)
    )
