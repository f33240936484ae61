"""What all fields have in common."""

from __future__ import annotations

from typing import Literal

import numpy as np

from sheetsplat import _sheetsplat
from sheetsplat._checks import Bounds, shown, triple
from sheetsplat._properties import Forwarded
from sheetsplat.errors import complain

Normalization = Literal["none", "lattice", "threshold"]


class Field:
    """What all fields have in common: a set of kernels whose weighted sums are the scalar. Conventions, section 2.

    Made by `RegularField` and `EllipsoidField`.
    """

    __slots__ = ("_falloff", "native", "_normalization", "_w0")
    _falloff: float
    native: _sheetsplat.Field
    _normalization: str
    _w0: float

    def __init__(self) -> None:
        raise TypeError("a field is made by RegularField or EllipsoidField")

    falloff = Forwarded[float]("_falloff", "The k of the kernel's profile.")
    normalization = Forwarded[str]("_normalization", 'One of "none", "lattice" and "threshold".')
    w0 = Forwarded[float]("_w0", 'Threshold of the weight sum, for normalisation "threshold".')
    size = Forwarded[int]("native.size", "Number of kernels, skipped samples excluded.")
    bounds = Forwarded[Bounds](
        "native.supports", "World-aligned box around all supports: its lower and its upper corner."
    )
    centre_bounds = Forwarded[Bounds](
        "native.centres", "World-aligned box around all kernel centres: its lower and its upper corner."
    )
    default_slice_spacing = Forwarded[float](
        "native.default_slice_spacing", "Default distance of slices in scenes, world units. Conventions, section 3."
    )

    # Regular fields have their own of these two.
    @property
    def value_range(self) -> tuple[float, float]:
        """Smallest and largest value of a kernel; 0, 0 without kernels."""
        low, high = self.native.value_range
        return low, high

    @property
    def memory(self) -> int:
        """Bytes that the field keeps."""
        return self.native.memory


def as_fields(field: object, what: str) -> list[Field]:
    """Return one field or a sequence of fields as a list; InvalidInput for anything else and for none at all."""
    fields = [field] if isinstance(field, Field) else field
    if not isinstance(fields, list | tuple) or not all(isinstance(one, Field) for one in fields) or not fields:
        raise complain(
            f"{what} cannot be used",
            shown(field),
            "a RegularField, an EllipsoidField, or a sequence of them",
            "make one with sheetsplat.RegularField(values), sheetsplat.EllipsoidField or sheetsplat.open(path)",
        )
    return list(fields)


def joined_bounds(boxes: list[Bounds]) -> Bounds:
    """Return the smallest box around all boxes."""
    # The box of a field without kernels has its lower corner above its upper one.
    there = [box for box in boxes if all(low <= high for low, high in zip(*box, strict=True))] or boxes
    lower = np.min([box[0] for box in there], axis=0)
    upper = np.max([box[1] for box in there], axis=0)
    return triple("bounds", lower), triple("bounds", upper)
