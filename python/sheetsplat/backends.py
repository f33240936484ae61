"""What each backend can do, as the engine has it: modules ask here instead of comparing names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from sheetsplat import _sheetsplat

Backend = Literal["auto", "gl", "cpu", "reference"]


@dataclass(frozen=True)
class BackendTraits:
    """One backend.

    Attributes
    ----------
    name
        Its name.
    defines
        It draws the scene itself in the one way that defines pictures: slowly, in float64.
    exact
        It draws in float64 what others would lose to rounding, and is there on every machine.
    ways
        It has several ways of tagging, packing and drawing tiles.
    precisions
        Those of its sheets.
    pixels, sections, points
        What a core, or OpenGL in software, does in a second: pixels of kernels in slices, slices of kernels, pixels of
        slices.
    rated_device
        What the name of a device holds that has these rates; empty: all have.
    """

    name: Backend
    defines: bool
    exact: bool
    ways: bool
    precisions: tuple[str, ...]
    pixels: float
    sections: float
    points: float
    rated_device: str


#: Every backend by its name.
BACKEND_TRAITS: Mapping[str, BackendTraits] = MappingProxyType(
    {row["name"]: BackendTraits(**row) for row in _sheetsplat.backend_traits()}
)
#: The backend from which errors are measured, and the one that defines pictures.
EXACT = next(one.name for one in BACKEND_TRAITS.values() if one.exact)
DEFINING = next(one.name for one in BACKEND_TRAITS.values() if one.defines)
