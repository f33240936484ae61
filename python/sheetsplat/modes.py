"""What each mode makes of the slices along a ray, as the engine has it: modules ask here instead of comparing names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _sheetsplat


@dataclass(frozen=True)
class ModeTraits:
    """One mode.

    Attributes
    ----------
    name
        Its name.
    fold
        How the slices of a ray become one pixel: their colours are composited by "opacities", or "surfaces" between
        them are; else the pixel is a number, their "sum", or the "largest" or the "smallest" of them.
    counts
        Only slices that kernels reach count; a pixel without one is no number. Else it is 0.
    mean
        The sum is divided by how many slices count.
    integrates
        Slices count by the length of the ray in them, world units.
    of_values
        What its numbers are of the field's values, in a word; empty where they are not.
    label
        Its name in the viewer.
    meaning
        What a picture shows.
    """

    name: str
    fold: Literal["opacities", "surfaces", "sum", "largest", "smallest"]
    counts: bool
    mean: bool
    integrates: bool
    of_values: str
    label: str
    meaning: str

    @property
    def is_composited(self) -> bool:
        """Whether slices are composited by their opacities."""
        return self.fold == "opacities"

    @property
    def shows_surfaces(self) -> bool:
        """Whether crossings of iso values are shown."""
        return self.fold == "surfaces"

    @property
    def is_scalar(self) -> bool:
        """Whether a pixel is a number, without colours."""
        return not (self.is_composited or self.shows_surfaces)

    @property
    def adds(self) -> bool:
        """Whether pixels are sums along rays, or means: they have the mass of what they show, or lose it."""
        return self.fold == "sum"

    @property
    def is_extreme(self) -> bool:
        """Whether a pixel is the number of one slice."""
        return self.fold in ("largest", "smallest")

    @property
    def any_order(self) -> bool:
        """Whether parts of a ray may be drawn in any order: what they add is a number."""
        return self.is_scalar

    @property
    def reduce(self) -> np.ufunc:
        """What makes one number of those of two parts of a ray."""
        return {"largest": np.maximum, "smallest": np.minimum}.get(self.fold, np.add)

    def shown_at(self, values: NDArray[np.float64]) -> int:
        """Return which of some numbers along a ray shows, or shows most."""
        return int(values.argmin() if self.fold == "smallest" else values.argmax())


#: Every mode by its name.
TRAITS: Mapping[str, ModeTraits] = MappingProxyType(
    {one["name"]: ModeTraits(**one) for one in _sheetsplat.mode_traits()}
)
