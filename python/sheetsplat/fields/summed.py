"""Sums of fields that add up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sheetsplat.fields.base import Field
from sheetsplat.fields.ellipsoid import EllipsoidField
from sheetsplat.fields.regular import RegularField


def as_summed(fields: Sequence[Field]) -> tuple[Field, ...]:
    """Return the fields of a group as they are summed: those that end in different places end nowhere.

    Conventions, section 2.
    """
    if len({one.domain for one in fields}) == 1:
        return tuple(fields)
    return tuple(
        one.replace(boundary="zero", base=0.0)
        if isinstance(one, RegularField)
        else one.without_end()
        if isinstance(one, EllipsoidField)
        else one
        for one in fields
    )


def sum_at(fields: Sequence[Field], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the scalar of fields `as_summed` at points (M, 3), (M,)."""
    total: NDArray[np.float64] = np.sum([one.at(points) for one in fields], axis=0)
    return total
