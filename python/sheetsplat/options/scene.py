"""The options of a scene: sampling, effects, mode, light."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any, Literal, TypedDict, get_args

import numpy as np

from sheetsplat._checks import (
    Vector,
    choice,
    color,
    instance,
    is_auto,
    number,
    optional_number,
    parts,
    shown,
    truth,
    whole,
)
from sheetsplat.effects import AmbientOcclusion, Clip, DepthCue
from sheetsplat.errors import complain, unusable
from sheetsplat.light import Light, Material
from sheetsplat.modes import TRAITS
from sheetsplat.options.checks import instance_of, one_of, optional, or_default
from sheetsplat.options.core import COLORED, COMPOSITE, MODES, SCALAR, SURFACES, CommandLine, Mode, Option, definitions
from sheetsplat.options.values import POSITIVE, Numbers, Real, Special, Whole
from sheetsplat.scalar_colors import ScalarColors
from sheetsplat.slice_planes import SlicePlane, slice_planes_of

Sampling = Literal["point", "slab"]
Filter = Literal["ewa", "off"]
Gradient = Literal["sheets", "analytic"]
Preintegration = bool | Literal["second_order"]

# A number, or pairs (value, opacity).
IsoValue = float | Sequence[tuple[float, float]]

# An iterator of lights may have no end.
_MOST_LIGHTS = 4096
_MOST_SURFACES = 256
#: Most samples a pixel along each axis.
MOST_SAMPLES = 16


def _lights(what: str, lights: object) -> tuple[Light, ...]:
    if isinstance(lights, Light):
        return (lights,)
    found = tuple(parts(what, lights, "a sequence of lights; () for none", _MOST_LIGHTS))
    if len(found) > _MOST_LIGHTS:
        raise complain(unusable(what), f"more than {_MOST_LIGHTS} lights", "fewer")
    for light in found:
        instance(what, light, Light)
    return found


def iso_value_of(what: str, value: object) -> IsoValue:
    """Return a number, or pairs (value, opacity)."""
    if not isinstance(value, Iterable) or isinstance(value, str) or _is_scalar(value):
        return number(what, value)
    wanted = "a number, or pairs (value, opacity)"
    given = parts(what, value, wanted, _MOST_SURFACES)
    if not given:
        raise complain(unusable(what), "no value", wanted)
    if len(given) > _MOST_SURFACES:
        raise complain(unusable(what), f"more than {_MOST_SURFACES} values", f"at most {_MOST_SURFACES}")
    pairs = [parts(what, one, wanted, 2) if isinstance(one, Iterable) else [] for one in given]
    if any(len(pair) != 2 for pair in pairs):
        advice = f"opaque surfaces are [({shown(given[0])}, 1), …]" if not any(pairs) else ""
        raise complain(unusable(what), shown(given), wanted, advice)
    return tuple((number(what, at), number(what, opacity)) for at, opacity in pairs)


def _is_scalar(value: Iterable[Any]) -> bool:
    """Return whether an array has no axes; iterators have one, whatever NumPy makes of them."""
    return isinstance(value, np.ndarray) and value.ndim == 0


def _preintegration(what: str, value: object) -> Preintegration:
    if isinstance(value, str):
        if value != "second_order":
            raise complain(unusable(what), shown(value), 'True, False or "second_order"')
        return "second_order"
    return truth(what, value)


def _cut_faces(what: str, value: object) -> bool:
    return value is not None and truth(what, value)


def _occlusion(what: str, value: object) -> AmbientOcclusion | None:
    """Return ambient occlusion, also by its radius alone; None for False."""
    if value is False:
        return None
    if isinstance(value, AmbientOcclusion):
        return value
    wanted = "a radius, AmbientOcclusion(radius, strength), or None"
    if value is True:
        raise complain(unusable(what), shown(value), wanted, "give it to sheetsplat.render, which knows the data")
    if isinstance(value, str):
        raise complain(unusable(what), shown(value), wanted, "of sheetsplat.render also True")
    return AmbientOcclusion(number(what, value))


def _samples(what: str, value: object) -> int:
    """Return the number of samples a pixel along each axis."""
    wanted = f"a whole number from 1 to {MOST_SAMPLES}"
    result = whole(what, value, wanted)
    if not 1 <= result <= MOST_SAMPLES:
        advice = "4 stands for 4 x 4 samples a pixel" if result > MOST_SAMPLES else ""
        raise complain(unusable(what), str(result), wanted, advice)
    return result


def _filter(what: str, value: object) -> str | None:
    """Return "ewa" or None; "off" is another name of None."""
    if is_auto(value):
        wanted = '"ewa", "off" or None'
        raise complain(unusable(what), '"auto"', wanted, "give it to sheetsplat.render, which knows the camera")
    is_none = value is None or (isinstance(value, str) and value == "off")
    return None if is_none else choice(what, value, get_args(Filter))


def surfaces_of(iso_value: IsoValue | None) -> tuple[tuple[float, float], ...]:
    """Return isosurfaces as pairs (value, opacity); none for None."""
    if iso_value is None:
        return ()
    return tuple(iso_value) if isinstance(iso_value, Sequence) else ((iso_value, 1.0),)


class LightOptions(TypedDict, total=False):
    """Lights, material and background."""

    lights: Annotated[
        Iterable[Light],
        Option(
            "Directional lights; without any the picture shows the colours of the transfer function.",
            default=(),
            chosen="one light over the viewer's left shoulder, or none where {shading} is off",
            accepts="sequence of Light",
            modes=COLORED,
            check=_lights,
            cli=(),
        ),
    ]
    material: Annotated[
        Material | None,
        Option(
            "Phong coefficients.",
            chosen="more diffuse, with a highlight",
            modes=COLORED,
            check=or_default(Material),
            cli=(),
        ),
    ]
    background: Annotated[
        Vector | str | None,
        Option(
            'Colour behind the picture: red, green, blue in [0, 1], a name such as "white", or "#rrggbb".',
            unset="transparent",
            accepts="three numbers or str",
            modes=COLORED,
            effect="background",
            check=optional(color),
            value=Special.COLOR,
        ),
    ]


class ModeOptions(TypedDict, total=False):
    """How slices are combined into pixels."""

    mode: Annotated[
        Mode,
        Option(
            "How slices are combined into pixels: " + ", ".join(one.meaning for one in TRAITS.values()) + ".",
            default=MODES[0],
            check=one_of(Mode),
        ),
    ]
    iso_value: Annotated[
        IsoValue | None,
        Option(
            "Scalar of the isosurface; or pairs (value, opacity) of several surfaces, 1 being opaque.",
            chosen="the value at which the histogram separates objects from background",
            accepts="float, or pairs",
            modes=SURFACES,
            in_values=True,
            check=optional(iso_value_of),
            flag="--iso",
            value=Special.SURFACES,
        ),
    ]
    scalar_colors: Annotated[
        ScalarColors | None,
        Option(
            "How the numbers of a scalar picture become colours.",
            unset="gray, from 0 to the largest number",
            chosen="by {cmap}, {clim} and {log_scale}",
            modes=SCALAR,
            check=or_default(ScalarColors),
            cli=(),
        ),
    ]


class SamplingOptions(TypedDict, total=False):
    """Slices, pre-integration between them, and filters."""

    slice_spacing: Annotated[
        float | None,
        Option(
            "Distance of slices in world units, greater than 0.",
            unset="the smallest that a field suggests",
            chosen="by {quality}: the smallest that a field suggests, or a share of it",
            check=optional_number,
            value=POSITIVE,
        ),
    ]
    sampling: Annotated[
        Sampling,
        Option(
            '"point": a slice holds the field at its depth; "slab": the mean over its slab along the pixel\'s ray.',
            default="point",
            effect="slab_sampling",
            check=one_of(Sampling),
        ),
    ]
    reference_length: Annotated[
        float | None,
        Option(
            "Length in world units to which opacities refer, greater than 0.",
            unset="the default slice distance of the fields",
            modes=COLORED,
            check=optional_number,
            value=POSITIVE,
        ),
    ]
    opacity_stop: Annotated[
        float,
        Option(
            "Opacity in (0, 1] at which a pixel is finished; 1: never.",
            default=0.98,
            chosen="0.98, or nearer to 1 as {quality} says",
            modes=COLORED,
            check=number,
            value=Real(above=0.0, most=1.0),
            harmless=True,
        ),
    ]
    preintegration: Annotated[
        Preintegration,
        Option(
            'Classify the intervals between slices instead of the slices; "second_order" also follows the curvature of '
            "the scalar inside an interval, and what the front half of an interval hides of its back half.",
            default=False,
            accepts='bool or "second_order"',
            modes=COMPOSITE,
            effect="preintegration",
            check=_preintegration,
            cli=(
                CommandLine(
                    "--preintegration/--no-preintegration",
                    help="Classify the intervals between slices instead of the slices.",
                ),
                CommandLine(
                    "--second-order",
                    "second_order",
                    help="Pre-integrate at second order: also follow the curvature of the scalar inside an interval.",
                    switch=True,
                ),
            ),
        ),
    ]
    supersampling: Annotated[
        int,
        Option(
            f"Samples a pixel along each axis, 1 to {MOST_SAMPLES}. The picture is the mean of n x n samples a pixel, "
            "those of the picture of n times the width and height, and takes up to n² times as long. 1: one sample at "
            "the centre.",
            default=1,
            chosen="1, or more where {quality} says so",
            check=_samples,
            value=Whole(1, MOST_SAMPLES),
        ),
    ]
    filter: Annotated[
        Filter | Literal["auto"] | None,
        Option(
            '"ewa": widen kernels by a pixel across and by a slice distance along the view, so that kernels smaller '
            'than that do not vanish between pixels or slices. Their mass stays the same. "off", or None: no filter. '
            '"auto": where scattered kernels in the picture are that small, and where sums along rays would lose mass '
            "without it; it needs `render` or the command line, which know the camera.",
            chosen='"auto", and "off" at {quality} draft',
            effect="ewa_filter",
            check=_filter,
            cli=(
                CommandLine(
                    help="ewa: widen kernels by a pixel across and by a slice distance along the view, so that kernels "
                    "smaller than that do not vanish between pixels or slices; their mass stays the same. auto: where "
                    "scattered kernels in the picture are that small, and where sums along rays would lose mass "
                    "without it.",
                ),
            ),
        ),
    ]


class EffectOptions(TypedDict, total=False):
    """Effects beyond the papers. Conventions, section 10."""

    gradient: Annotated[
        Gradient,
        Option(
            'Where normals come from: "sheets", differences between pixels and slices; "analytic", sums of the '
            "kernels' own derivatives, which do not depend on pixels and slices.",
            default="sheets",
            modes=COLORED,
            effect="analytic_gradient",
            check=one_of(Gradient),
        ),
    ]
    clip: Annotated[
        Clip | None,
        Option(
            "The region that is kept.",
            unset="everything",
            effect="clip",
            check=or_default(Clip),
            cli=(
                CommandLine(
                    "--clip-plane",
                    "clip_planes",
                    Numbers("NX,NY,NZ,OFFSET", 4),
                    "Keep the points x with N·x ≥ OFFSET, world units; may be repeated.",
                    multiple=True,
                ),
                CommandLine(
                    "--clip-box",
                    "clip_box",
                    Numbers("X0,Y0,Z0,X1,Y1,Z1", 6),
                    "Keep the box between two corners, the lower one first, world units.",
                ),
                CommandLine(
                    "--clip-sphere",
                    "clip_sphere",
                    Numbers("X,Y,Z,RADIUS", 4),
                    "Keep the sphere around a point, world units.",
                ),
            ),
        ),
    ]
    cut_faces: Annotated[
        bool | None,
        Option(
            "Where {clip}, or the end of a volume, cuts open what is opaque, light it by the normal of the cut. Inside "
            "nearly homogeneous matter the gradient, which gives normals elsewhere, has no direction.",
            unset="off",
            chosen="on where {clip} or the end of a volume cuts, unless {lights} or {material} are given",
            modes=COMPOSITE,
            effect="cut_faces",
            check=_cut_faces,
            flag="--cut-faces/--no-cut-faces",
        ),
    ]
    slice_planes: Annotated[
        Sequence[SlicePlane] | SlicePlane | Literal["orthogonal"] | None,
        Option(
            "Opaque planes through the data, coloured by their values and in depth order with the picture; "
            '"orthogonal": three through the middle of the data, at right angles to x, y and z.',
            accepts='SlicePlane, sequence of them, or "orthogonal"',
            modes=COLORED,
            check=slice_planes_of,
            cli=(
                CommandLine(
                    "--slice-plane",
                    "slice_plane",
                    Numbers("NX,NY,NZ,OFFSET", 4),
                    "Show the values on the points x with N·x = OFFSET, world units; may be repeated.",
                    multiple=True,
                ),
                CommandLine(help="Show the values on three planes through the middle of the data."),
            ),
        ),
    ]
    gradient_opacity: Annotated[
        float | None,
        Option(
            "Multiply the opacity by min(1, gradient / {gradient_opacity}), which hides regions of little change. "
            "Scalar per world unit, greater than 0.",
            modes=COMPOSITE,
            effect="gradient_opacity",
            in_values=True,
            gradients=True,
            check=optional_number,
            value=POSITIVE,
        ),
    ]
    depth_cue: Annotated[
        DepthCue | Literal["auto"] | None,
        Option(
            'Colours fade with depth, from one depth to another. "auto" fades to black, by 4/5, over the depths of the '
            "fields; it needs `render` or the command line, which know the camera.",
            accepts='DepthCue or "auto"',
            modes=COLORED,
            effect="depth_cue",
            check=optional(instance_of(DepthCue)),
            cli=(
                CommandLine(
                    value=Special.DEPTH_CUE,
                    help="Colours fade between two depths, world units from the eye, by a strength from 0 to 1; "
                    "auto: the depths of the fields.",
                ),
                CommandLine(
                    "--depth-cue-color",
                    "depth_cue_color",
                    Special.COLOR,
                    "Colour to which {depth_cue} fades.",
                    default="black",
                ),
            ),
        ),
    ]
    shadows: Annotated[
        bool, Option("Lights cast shadows.", default=False, modes=COLORED, effect="shadows", check=truth, switch=True)
    ]
    ambient_occlusion: Annotated[
        AmbientOcclusion | float | bool | None,
        Option(
            "Dim ambient light where the surroundings, up to a radius in world units, are dense. A number is the "
            "radius; True, in `render` alone: 4 % of the data's diagonal.",
            accepts="AmbientOcclusion, float or bool",
            modes=COLORED,
            effect="ambient_occlusion",
            check=optional(_occlusion),
            cli=(
                CommandLine(
                    value=Special.OCCLUSION,
                    help="Dim ambient light where the surroundings, up to a radius in world units, are dense, by a "
                    "strength from 0 to 1; without a number: a radius of 4 % of the data's diagonal.",
                    bare="auto",
                ),
            ),
        ),
    ]


class SceneOptions(ModeOptions, SamplingOptions, EffectOptions, LightOptions, total=False):
    """Every keyword argument of `Scene`."""


def calls_for_gradients(options: Mapping[str, Any]) -> bool:
    """Return whether the picture of a scene with these options, all of `Scene`'s, depends on gradients."""
    asked = any(defined.gradients and options[name] is not None for name, defined in definitions(SceneOptions).items())
    return (asked or bool(options["lights"])) and options["mode"] in COLORED
