"""Lights and materials. Conventions, section 5 (Gradients and light)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from sheetsplat import _sheetsplat
from sheetsplat._checks import Vector, choice, measurable, shown, strength, strengths, triple, truth
from sheetsplat._values import OfArguments
from sheetsplat.errors import complain, unusable


@dataclass(frozen=True)
class Light(OfArguments):
    """A directional light. Conventions, section 5 (Gradients and light).

    Parameters
    ----------
    direction
        Points towards the light; any length but 0.
    color
        Red, green, blue; 1 is full strength.
    space
        "eye" (moves with the camera: x right, y up, z towards the viewer) or "world".

    Raises
    ------
    InvalidInput
        Where the vectors are not three finite numbers, the direction has length 0, or the space is unknown.

    Examples
    --------
    >>> sun = ss.Light((1, 0, 2), color=(1, 0.9, 0.8), space="world")
    >>> image = ss.render(values, lights=[sun], size=(32, 32))
    """

    direction: Vector = (0.0, 0.0, 1.0)
    color: Vector = (1.0, 1.0, 1.0)
    space: Literal["eye", "world"] = "eye"
    native: _sheetsplat.Light = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check and convert."""
        object.__setattr__(
            self, "direction", measurable("Light: direction", triple("Light: direction", self.direction))
        )
        object.__setattr__(self, "color", strengths("Light: color", triple("Light: color", self.color)))
        choice("Light: space", self.space, ("eye", "world"))
        for name, three in (("direction", self.direction), ("color", self.color)):
            if not all(map(math.isfinite, three)):
                raise complain(unusable(f"Light: {name}"), shown(three), "three finite numbers")
        if not any(self.direction):
            raise complain(unusable("Light: direction"), "(0, 0, 0)", "a direction towards the light")
        native = _sheetsplat.Light(
            direction=triple("Light: direction", self.direction),
            color=triple("Light: color", self.color),
            space=self.space,
        )
        object.__setattr__(self, "native", native)


@dataclass(frozen=True)
class Material(OfArguments):
    """Phong coefficients. Conventions, section 5 (Gradients and light).

    Parameters
    ----------
    ambient, diffuse, specular
        Reflection coefficients, finite.
    shininess
        Exponent of the specular term, at least 0.
    two_sided
        Light both sides of a surface: the normal is flipped towards each light.

    Raises
    ------
    InvalidInput
        For anything but numbers.

    Examples
    --------
    >>> shiny = ss.Material(specular=0.5, shininess=60)
    >>> image = ss.render(values, material=shiny, size=(32, 32))
    """

    ambient: float = 0.1
    diffuse: float = 0.9
    specular: float = 0.0
    shininess: float = 32.0
    two_sided: bool = False
    native: _sheetsplat.Material = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check and convert."""
        for name in ("ambient", "diffuse", "specular", "shininess"):
            object.__setattr__(self, name, strength(f"Material: {name}", getattr(self, name)))
        native = _sheetsplat.Material(
            ambient=self.ambient,
            diffuse=self.diffuse,
            specular=self.specular,
            shininess=self.shininess,
            two_sided=truth("Material: two_sided", self.two_sided),
        )
        object.__setattr__(self, "native", native)
