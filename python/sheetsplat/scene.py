"""Scenes: fields, how they are classified, lit and composited. Conventions, sections 3 (Slices) to 7 (Modes)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, Literal

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
Gradient = Literal["sheets", "analytic"]
GRADIENTS = ("sheets", "analytic")
Preintegration = bool | Literal["second_order"]


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
                raise complain(f"Light: {name} cannot be used", shown(three), "three finite numbers")
        if not any(self.direction):
            raise complain("Light: direction cannot be used", "(0, 0, 0)", "a direction towards the light")
        native = _sheetsplat.Light(direction=_three(self.direction), color=_three(self.color), space=self.space)
        object.__setattr__(self, "native", native)


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


# More planes than anybody has; an iterator may have no end.
_MOST_PLANES = 64


def _planes(planes: object) -> tuple[tuple[Triple, float], ...]:
    wanted = "a sequence of planes (normal, offset); () for none"
    if isinstance(planes, str | bytes) or not isinstance(planes, Iterable):
        raise complain("Clip: planes cannot be used", shown(planes), wanted)
    found = _parts(planes, _MOST_PLANES + 1, "Clip: planes", wanted)
    if len(found) > _MOST_PLANES:
        raise complain("Clip: planes cannot be used", f"more than {_MOST_PLANES} planes", "fewer")
    result = []
    for plane in found:
        if isinstance(plane, str | bytes) or not isinstance(plane, Sequence) or len(plane) != 2:
            raise complain("Clip: planes cannot be used", shown(plane), wanted)
        normal, offset = plane
        what = "Clip: a plane's normal"
        advice = "divide it, and the plane's offset with it, by its length"
        result.append((measurable(what, triple(what, normal), advice), number("Clip: a plane's offset", offset)))
    return tuple(result)


@dataclass(frozen=True)
class Clip:
    """What of a picture's points is kept. Conventions, section 10 (Effects beyond the papers).

    Parameters
    ----------
    planes
        Pairs (normal, offset): points x with normal · x >= offset are kept. World units.
    box
        Two corners ((x0, y0, z0), (x1, y1, z1)), the lower one first: what lies in between is kept. World units.

    Points must be kept by all planes and by the box. What is cut off is transparent; the field itself, and with it
    gradients next to a cut, stay as they are.

    Raises
    ------
    InvalidInput
        For anything but finite numbers, a normal of length 0, and corners in the wrong order.
    """

    planes: Sequence[tuple[Vector, float]] = ()
    box: tuple[Vector, Vector] | None = None
    native: _sheetsplat.Clip = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check and convert."""
        planes = _planes(self.planes)
        for normal, offset in planes:
            if not any(normal) or not all(map(math.isfinite, (*normal, offset))):
                raise complain(
                    "Clip: planes cannot be used", shown((normal, offset)), "a finite normal of a length above 0"
                )
        object.__setattr__(self, "planes", planes)
        box = None if self.box is None else _corners(self.box)
        object.__setattr__(self, "box", box)
        object.__setattr__(self, "native", _sheetsplat.Clip(planes=planes, box=box))


def _parts(value: Iterable[object], most: int, what: str, wanted: str) -> list[object]:
    """Return the first parts of a sequence; arrays without an axis only say that they can be iterated over."""
    try:
        return list(islice(value, most))
    except TypeError:
        raise complain(f"{what} cannot be used", shown(value), wanted) from None


def _corners(box: object) -> tuple[Triple, Triple]:
    wanted = "two corners ((x0, y0, z0), (x1, y1, z1)), the lower one first"
    if isinstance(box, str | bytes) or not isinstance(box, Iterable):
        raise complain("Clip: box cannot be used", shown(box), wanted)
    corners = _parts(box, 3, "Clip: box", wanted)
    if len(corners) != 2:
        raise complain("Clip: box cannot be used", shown(box), wanted)
    lower, upper = triple("Clip: box", corners[0]), triple("Clip: box", corners[1])
    if not all(
        math.isfinite(low) and math.isfinite(high) and low <= high for low, high in zip(lower, upper, strict=True)
    ):
        raise complain("Clip: box cannot be used", shown((lower, upper)), wanted)
    return lower, upper


@dataclass(frozen=True)
class DepthCue:
    """Shaded colours fade with depth. Conventions, section 10 (Effects beyond the papers).

    Parameters
    ----------
    start, end
        Depths, world units from the eye along the view direction, start < end: where fading begins and where it is
        done.
    color
        Red, green, blue to fade to.
    strength
        Share of that colour from `end` on, 0 to 1.

    Raises
    ------
    InvalidInput
        For anything but finite numbers in these ranges.
    """

    start: float
    end: float
    color: Vector = (0.0, 0.0, 0.0)
    strength: float = 1.0
    native: _sheetsplat.DepthCue = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check and convert."""
        for name in ("start", "end", "strength"):
            object.__setattr__(self, name, number(f"DepthCue: {name}", getattr(self, name)))
        shade = strengths("DepthCue: color", triple("DepthCue: color", self.color))
        object.__setattr__(self, "color", shade)
        if not (math.isfinite(self.start) and math.isfinite(self.end) and self.start < self.end):
            raise complain(
                "DepthCue: start and end cannot be used", f"{self.start:g} and {self.end:g}", "finite, start below end"
            )
        _share("DepthCue: strength", self.strength)
        if not all(map(math.isfinite, shade)):
            raise complain("DepthCue: color cannot be used", shown(shade), "three finite numbers")
        native = _sheetsplat.DepthCue(start=self.start, end=self.end, color=shade, strength=self.strength)
        object.__setattr__(self, "native", native)


@dataclass(frozen=True)
class AmbientOcclusion:
    """Ambient light fades where the surroundings are dense. Conventions, section 10 (Effects beyond the papers).

    Parameters
    ----------
    radius
        How far away what occludes may be, world units, above 0.
    strength
        Share of ambient light that dense surroundings take, 0 to 1.

    Raises
    ------
    InvalidInput
        For anything but finite numbers in these ranges.
    """

    radius: float
    strength: float = 1.0
    native: _sheetsplat.AmbientOcclusion = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check and convert."""
        for name in ("radius", "strength"):
            object.__setattr__(self, name, number(f"AmbientOcclusion: {name}", getattr(self, name)))
        if not 0.0 < self.radius < math.inf:
            raise complain("AmbientOcclusion: radius cannot be used", f"{self.radius:g}", "a finite length above 0")
        _share("AmbientOcclusion: strength", self.strength)
        native = _sheetsplat.AmbientOcclusion(radius=self.radius, strength=self.strength)
        object.__setattr__(self, "native", native)


def _share(what: str, value: float) -> None:
    if not 0.0 <= value <= 1.0:
        raise complain(f"{what} cannot be used", f"{value:g}", "a number from 0 to 1")


def _order(value: object) -> tuple[bool, bool]:
    """Return whether there is pre-integration, and whether it is of second order."""
    if isinstance(value, str):
        if value != "second_order":
            raise complain("Scene: preintegration cannot be used", shown(value), 'True, False or "second_order"')
        return True, True
    return truth("Scene: preintegration", value), False


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
        Classify the interval between slices instead of the slices; "second_order" also follows the curvature of the
        scalar inside it, and what its front half hides of its back half.
    filter
        None, or "ewa": kernels are widened by a pixel across and a slice distance along the view and keep their mass,
        so that those smaller than that do not vanish between pixels or slices; they flicker less, though somewhat
        still: usage, EWA filter. Conventions, section 10 (Effects beyond the papers).
    gradient
        "sheets": differences between pixels and slices; "analytic": sums of the kernels' own derivatives, which do
        not depend on pixels and slices.
    clip
        What is kept; everything unless given.
    gradient_opacity
        Opacity is multiplied by min(1, gradient / gradient_opacity), which hides what hardly changes. Scalar per
        world unit, > 0.
    depth_cue
        Colours fade with depth.
    shadows
        What lies between a point and a light dims it.
    ambient_occlusion
        What lies around a point dims ambient light.
    background
        Red, green, blue to put behind the picture; transparent unless given.

    Raises
    ------
    InvalidInput
        Where a number or a combination has no meaning.
    """

    __slots__ = (
        "_ambient_occlusion",
        "_background",
        "_clip",
        "_depth_cue",
        "_fields",
        "_filter",
        "_gradient",
        "_given",
        "_iso_value",
        "_lights",
        "_material",
        "_mode",
        "native",
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
        preintegration: Preintegration = False,
        filter: Filter | None = None,
        gradient: Gradient = "sheets",
        clip: Clip | None = None,
        gradient_opacity: float | None = None,
        depth_cue: DepthCue | None = None,
        shadows: bool = False,
        ambient_occlusion: AmbientOcclusion | None = None,
        background: Vector | str | None = None,
    ) -> None:
        # What was given, before anything else has a name here.
        given = dict(locals())
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
        self._gradient = choice("Scene: gradient", gradient, GRADIENTS)
        self._clip = Clip() if clip is None else clip
        instance("Scene: clip", self._clip, Clip)
        self._depth_cue = depth_cue
        if depth_cue is not None:
            instance("Scene: depth_cue", depth_cue, DepthCue)
        self._ambient_occlusion = ambient_occlusion
        if ambient_occlusion is not None:
            instance("Scene: ambient_occlusion", ambient_occlusion, AmbientOcclusion)
        preintegrated, second_order = _order(preintegration)
        self.native = _sheetsplat.Scene(
            [one.native for one in self._fields],
            transfer_function.native,
            slice_spacing=optional_number("Scene: slice_spacing", slice_spacing),
            sampling=choice("Scene: sampling", sampling, ("point", "slab")),
            reference_length=optional_number("Scene: reference_length", reference_length),
            mode=self._mode,
            iso_value=self._iso_value,
            lights=[light.native for light in self._lights],
            material=self._material.native,
            opacity_stop=number("Scene: opacity_stop", opacity_stop),
            preintegration=preintegrated,
            background=self._background,
            filter="none" if self._filter is None else self._filter,
            second_order=second_order,
            gradient=self._gradient,
            clip=self._clip.native,
            gradient_opacity=optional_number("Scene: gradient_opacity", gradient_opacity),
            depth_cue=None if depth_cue is None else depth_cue.native,
            shadows=truth("Scene: shadows", shadows),
            ambient_occlusion=None if ambient_occlusion is None else ambient_occlusion.native,
        )

        del given["self"]
        self._given = given | {"field": self._fields, "transfer_function": transfer_function, "lights": self._lights}

    def replace(self, **changes: Any) -> Scene:
        """Return a scene that has some other options, and all the others of this one.

        Parameters
        ----------
        changes
            Options of `Scene`, `field` and `transfer_function` among them. Distances that this scene took from its
            field are taken from the field of the new one.

        Raises
        ------
        InvalidInput
            As `Scene`, and for names that are none of its options.
        """
        strange = [name for name in changes if name not in self._given]
        if strange:
            raise complain(
                "Scene: this cannot be replaced", ", ".join(strange), f"options of Scene: {', '.join(self._given)}"
            )
        return Scene(**{**self._given, **changes})

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
        return self.native.slice_distance

    @property
    def reference_length(self) -> float:
        """World units to which opacities refer, as they will be used."""
        return self.native.reference_distance

    @property
    def bounds(self) -> Bounds:
        """World-aligned box around all supports: its lower and its upper corner."""
        return joined_bounds([one.bounds for one in self._fields])

    def __repr__(self) -> str:
        """Return a short description."""
        return f"Scene({', '.join(map(repr, self._fields))}, mode {self._mode!r}, {len(self._lights)} lights)"
