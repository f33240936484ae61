"""Scenes: fields, how they are classified, lit and composited. Conventions, sections 3 (Slices) to 7 (Modes)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Literal

from sheetsplat import _sheetsplat
from sheetsplat._checks import (
    Bounds,
    Triple,
    Vector,
    choice,
    color,
    instance,
    measurable,
    number,
    optional_number,
    shown,
    strength,
    strengths,
    triple,
    truth,
)
from sheetsplat.errors import complain
from sheetsplat.fields import Field, as_fields, joined_bounds
from sheetsplat.transfer import TransferFunction

Mode = Literal["composite", "isosurface", "xray", "mip"]
Sampling = Literal["point", "slab"]
Filter = Literal["ewa"]
MODES = ("composite", "isosurface", "xray", "mip")
FILTERS = ("ewa",)


@dataclass(frozen=True)
class Light:
    """A directional light. Conventions, section 5 (Gradients and light).

    Parameters
    ----------
    direction
        Points towards the light; any length but 0.
    color
        Red, green, blue; 1 is full strength.
    space
        "eye" (turns with the camera: x right, y up, z towards the viewer) or "world".

    Raises
    ------
    InvalidInput
        For anything but three finite numbers and those two names, and for a direction of length 0.
    """

    direction: Vector = (0.0, 0.0, 1.0)
    color: Vector = (1.0, 1.0, 1.0)
    space: Literal["eye", "world"] = "eye"
    _native: _sheetsplat.Light = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check and convert."""
        object.__setattr__(
            self, "direction", measurable("Light: direction", triple("Light: direction", self.direction))
        )
        object.__setattr__(self, "color", strengths("Light: color", triple("Light: color", self.color)))
        choice("Light: space", self.space, ("eye", "world"))
        for name, three in (("direction", self.direction), ("color", self.color)):
            if not all(map(math.isfinite, three)):
                raise complain(f"Light: {name} cannot be used", shown(three), "three finite numbers")
        if not any(self.direction):
            raise complain("Light: direction cannot be used", "(0, 0, 0)", "a direction towards the light")
        native = _sheetsplat.Light(direction=_three(self.direction), color=_three(self.color), space=self.space)
        object.__setattr__(self, "_native", native)


@dataclass(frozen=True)
class Material:
    """Phong coefficients. Conventions, section 5 (Gradients and light).

    Parameters
    ----------
    ambient, diffuse, specular
        Shares of light, finite.
    shininess
        Exponent of the specular term, at least 0.
    two_sided
        Turn the normal round for lights on its far side.

    Raises
    ------
    InvalidInput
        For anything but numbers.
    """

    ambient: float = 0.1
    diffuse: float = 0.9
    specular: float = 0.0
    shininess: float = 32.0
    two_sided: bool = False
    _native: _sheetsplat.Material = field(init=False, repr=False, compare=False)

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
        object.__setattr__(self, "_native", native)


def _three(vector: Vector) -> Triple:
    return triple("vector", vector)


# More lights than anybody has; an iterator may have no end.
_MOST_LIGHTS = 4096


def _lights(lights: object) -> tuple[Light, ...]:
    if not isinstance(lights, Iterable):
        raise complain("Scene: lights cannot be used", shown(lights), "a sequence of lights; () for none")
    found = tuple(islice(lights, _MOST_LIGHTS + 1))
    if len(found) > _MOST_LIGHTS:
        raise complain("Scene: lights cannot be used", f"more than {_MOST_LIGHTS} lights", "fewer")
    return found


class Scene:
    """Everything about a picture but the camera and its size. Immutable.

    Parameters
    ----------
    field
        A field, or a sequence of fields of any kind whose scalars add up.
    transfer_function
        Scalar to colour and opacity per reference length; a TransferFunction, or its points.
    slice_spacing
        Distance Δs of slices in world units, > 0; the smallest of the fields' own unless given.
    sampling
        "point": a slice holds the field at its depth; "slab": the mean over its slab along the pixel's ray.
    reference_length
        World units to which opacities refer; the default slice distance unless given.
    mode
        "composite", "isosurface", "xray" or "mip".
    iso_value
        Scalar of the surface, for mode "isosurface".
    lights
        Lights; without any the scene shows the transfer function's colours themselves.
    material
        Phong coefficients.
    opacity_stop
        Opacity from which on a pixel does not change any more, in (0, 1]; 1 for never.
    preintegration
        Classify the interval between slices instead of the slices.
    filter
        None, or "ewa": kernels are widened by a pixel across and a slice distance along the view and keep their mass,
        so that those smaller than that do not vanish between pixels or slices; they flicker less, though somewhat
        still: usage, EWA filter. Conventions, section 10 (Effects beyond the papers).
    background
        Red, green, blue to put behind the picture; transparent unless given.

    Raises
    ------
    InvalidInput
        Where a number or a combination has no meaning.
    """

    __slots__ = (
        "_background",
        "_fields",
        "_filter",
        "_iso_value",
        "_lights",
        "_material",
        "_mode",
        "_native",
        "_transfer_function",
    )

    def __init__(
        self,
        field: Field | Sequence[Field],
        transfer_function: TransferFunction | Sequence[Sequence[float]],
        *,
        slice_spacing: float | None = None,
        sampling: Sampling = "point",
        reference_length: float | None = None,
        mode: Mode = "composite",
        iso_value: float | None = None,
        lights: Iterable[Light] = (),
        material: Material | None = None,
        opacity_stop: float = 0.98,
        preintegration: bool = False,
        filter: Filter | None = None,
        background: Vector | str | None = None,
    ) -> None:
        self._fields = tuple(as_fields(field, "Scene: field"))
        if not isinstance(transfer_function, TransferFunction):
            transfer_function = TransferFunction(transfer_function)
        self._transfer_function = transfer_function
        self._lights = (lights,) if isinstance(lights, Light) else _lights(lights)
        for light in self._lights:
            instance("Scene: lights", light, Light)
        self._material = Material() if material is None else material
        instance("Scene: material", self._material, Material)
        self._background = None if background is None else color("Scene: background", background)
        self._iso_value = optional_number("Scene: iso_value", iso_value)
        self._mode = choice("Scene: mode", mode, MODES)
        self._filter = None if filter is None else choice("Scene: filter", filter, FILTERS)
        self._native = _sheetsplat.Scene(
            [one._native for one in self._fields],
            transfer_function._native,
            slice_spacing=optional_number("Scene: slice_spacing", slice_spacing),
            sampling=choice("Scene: sampling", sampling, ("point", "slab")),
            reference_length=optional_number("Scene: reference_length", reference_length),
            mode=self._mode,
            iso_value=self._iso_value,
            lights=[light._native for light in self._lights],
            material=self._material._native,
            opacity_stop=number("Scene: opacity_stop", opacity_stop),
            preintegration=truth("Scene: preintegration", preintegration),
            background=self._background,
            **({} if self._filter is None else {"filter": self._filter}),
        )

    @property
    def fields(self) -> tuple[Field, ...]:
        """The fields whose scalars add up."""
        return self._fields

    @property
    def transfer_function(self) -> TransferFunction:
        """Scalar to colour and opacity."""
        return self._transfer_function

    @property
    def lights(self) -> tuple[Light, ...]:
        """The lights."""
        return self._lights

    @property
    def material(self) -> Material:
        """The Phong coefficients."""
        return self._material

    @property
    def mode(self) -> str:
        """One of "composite", "isosurface", "xray" and "mip"."""
        return self._mode

    @property
    def iso_value(self) -> float | None:
        """Value of the isosurface, or None."""
        return self._iso_value

    @property
    def filter(self) -> str | None:
        """What is done to kernels before they are sliced: None or "ewa"."""
        return self._filter

    @property
    def background(self) -> Triple | None:
        """Red, green, blue behind the picture, or None."""
        return self._background

    @property
    def slice_spacing(self) -> float:
        """Distance of slices in world units, as it will be used."""
        return self._native.slice_distance

    @property
    def reference_length(self) -> float:
        """World units to which opacities refer, as they will be used."""
        return self._native.reference_distance

    @property
    def bounds(self) -> Bounds:
        """World-aligned box around all supports: its lower and its upper corner."""
        return joined_bounds([one.bounds for one in self._fields])

    def __repr__(self) -> str:
        """Return a short description."""
        return f"Scene({', '.join(map(repr, self._fields))}, mode {self._mode!r}, {len(self._lights)} lights)"
