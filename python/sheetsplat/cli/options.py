"""Options that several commands share, and the types of their values."""

from __future__ import annotations

import functools
import itertools
import logging
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.core import ParameterSource

from sheetsplat.renderer import BACKENDS, MOST_THREADS, PACKINGS, PRECISIONS, TAGGINGS
from sheetsplat.scene import GRADIENTS

# Generic for type checkers from click 8.4 on, and never at run time before.
if TYPE_CHECKING:
    _ParamType = click.ParamType[Any]
else:
    _ParamType = click.ParamType

# Rows of a table made of colours at values.
_TABLE = 1025

Function = TypeVar("Function", bound=Callable[..., Any])


class Real(_ParamType):
    """A finite number, perhaps above or below another, or at most as large as one."""

    name = "float"

    def __init__(self, *, above: float = -math.inf, below: float = math.inf, most: float = math.inf) -> None:
        self._above, self._below, self._most = above, below, most

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number."""
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if self._above < number < self._below and number <= self._most:
            return number
        limits = (("above", self._above), ("below", self._below), ("at most", self._most))
        wanted = " and ".join(f"{word} {limit:g}" for word, limit in limits if math.isfinite(limit))
        self.fail(f"{_short(value)}: wanted a finite number{' ' if wanted else ''}{wanted}", param, ctx)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "..."


class Numbers(_ParamType):
    """Finite numbers with commas between them; whole ones are positive and may have an x: 256x256x128.

    Square: one number stands for two. Positive: above 0. Rising: in order.
    """

    def __init__(
        self,
        name: str,
        count: int,
        *,
        whole: bool = False,
        square: bool = False,
        positive: bool = False,
        rising: bool = False,
    ) -> None:
        self.name, self._count, self._whole, self._square = name, count, whole, square
        self._positive, self._rising = positive or whole, rising

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """Return the numbers."""
        if not isinstance(value, str):
            return tuple(value)
        parts = re.split(r"[,x]" if self._whole else r",", value.strip().lower())
        try:
            numbers = tuple((int if self._whole else float)(part) for part in parts)
        except ValueError:
            numbers = ()
        if self._square and len(numbers) == 1:
            numbers *= 2
        if len(numbers) != self._count:
            self.fail(f"{_short(value)}: wanted {self.name}, {self._count} numbers", param, ctx)
        if not self._whole and not all(map(math.isfinite, numbers)):
            self.fail(f"{_short(value)}: wanted finite numbers", param, ctx)
        if self._whole and not all(abs(number) < 2**31 for number in numbers):
            self.fail(f"{_short(value)}: wanted numbers that are not so large", param, ctx)
        if self._positive and min(numbers) <= 0:
            self.fail(f"{_short(value)}: wanted numbers above 0", param, ctx)
        if self._rising and not all(low < high for low, high in itertools.pairwise(numbers)):
            self.fail(f"{_short(value)}: wanted the lower number first", param, ctx)
        return numbers


class Direction(Numbers):
    """Three numbers, or the name of an axis: x, -x, y, -y, z, -z."""

    def __init__(self) -> None:
        super().__init__("X,Y,Z", 3)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """Return the direction."""
        named = re.fullmatch(r"([+-]?)([xyz])", value.strip().lower()) if isinstance(value, str) else None
        if named is None:
            numbers = super().convert(value, param, ctx)
            if not any(numbers):
                self.fail(f"{_short(value)}: wanted a direction, not a point", param, ctx)
            return numbers
        return tuple((-1.0 if named[1] == "-" else 1.0) * (axis == named[2]) for axis in "xyz")


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError
    return number


def _share(text: str) -> float:
    number = float(text)
    if not 0.0 <= number <= 1.0:
        raise ValueError
    return number


class OpacityType(_ParamType):
    """One number, several spread over clim, or pairs value:opacity."""

    name = "A | A,A,… | V:A,V:A,…"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return what TransferFunction.from_colormap takes."""
        if not isinstance(value, str):
            return value
        try:
            if ":" in value:
                pairs = [part.split(":") for part in value.split(",")]
                points = [(_finite(at), _share(opacity)) for at, opacity in pairs]
                if any(later[0] < earlier[0] for earlier, later in itertools.pairwise(points)):
                    raise ValueError
                return points
            numbers = [_share(part) for part in value.split(",")]
        except ValueError:
            self.fail(f"{value!r}: wanted 0.5, or 0,0.1,0.9, or 40:0,90:0.1,200:0.9", param, ctx)
        return numbers[0] if len(numbers) == 1 else numbers


@dataclass(frozen=True)
class ColorPairs:
    """Colours at values, linear between."""

    values: tuple[float, ...]
    colors: tuple[tuple[float, float, float], ...]

    def table(self, clim: tuple[float, ...] | None) -> tuple[Any, tuple[float, ...]]:
        """Return rows of colours, and the limits that they spread over."""
        import numpy as np

        limits = (self.values[0], self.values[-1]) if clim is None else clim
        at = np.linspace(limits[0], limits[1], _TABLE)
        columns = np.asarray(self.colors).T
        return np.column_stack([np.interp(at, self.values, column) for column in columns]), limits


class ColormapType(_ParamType):
    """A name of the cmap package, colours with commas between them, or pairs value:colour."""

    name = "NAME | COLOR,COLOR,… | V:COLOR,V:COLOR,…"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return what TransferFunction.from_colormap takes, or ColorPairs."""
        if not isinstance(value, str) or "," not in value:
            return value
        from sheetsplat._checks import color
        from sheetsplat.errors import InvalidInput

        wanted = "wanted black,orange,white, or 0:black,90:#ff8000,200:white with values that rise"
        parts = [part.strip() for part in value.split(",")]
        try:
            if ":" not in value:
                return [color("colour", part) for part in parts]
            pairs = [part.split(":") for part in parts]
            values = tuple(float(at) for at, _ in pairs)
            colors = tuple(color("colour", name) for _, name in pairs)
        except (ValueError, InvalidInput):
            self.fail(f"{value!r}: {wanted}", param, ctx)
        if not all(low < high for low, high in itertools.pairwise(values)) or not all(map(math.isfinite, values)):
            self.fail(f"{value!r}: {wanted}", param, ctx)
        return ColorPairs(values, colors)


class CueType(_ParamType):
    """Auto, or the two depths between which colours fade, perhaps with a strength."""

    name = "auto | START,END[,STRENGTH]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return "auto", or the numbers."""
        if not isinstance(value, str) or value.strip().lower() == "auto":
            return value if not isinstance(value, str) else "auto"
        try:
            numbers = [_finite(part) for part in value.split(",")]
            if len(numbers) == 2:
                numbers.append(1.0)
            start, end, strength = numbers
        except ValueError:
            start = end = strength = math.nan
        if not (start < end and 0.0 <= strength <= 1.0):
            self.fail(f"{_short(value)}: wanted auto, or 3,8, or 3,8,0.7: start below end, strength 0 to 1", param, ctx)
        return start, end, strength


class OcclusionType(_ParamType):
    """A radius, perhaps with a strength."""

    name = "RADIUS[,STRENGTH]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return radius and strength."""
        if not isinstance(value, str):
            return value
        try:
            numbers = [_finite(part) for part in value.split(",")]
            radius, strength = numbers if len(numbers) == 2 else (*numbers, 1.0)
        except ValueError:
            radius = strength = math.nan
        if not (radius > 0.0 and 0.0 <= strength <= 1.0):
            self.fail(f"{_short(value)}: wanted 5, or 5,0.7: a radius above 0, strength 0 to 1", param, ctx)
        return radius, strength


class ColorType(_ParamType):
    """R,G,B in [0, 1], #rrggbb, or a name."""

    name = "COLOR"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """Return red, green, blue."""
        if not isinstance(value, str):
            return tuple(value)
        from sheetsplat._checks import color
        from sheetsplat.errors import InvalidInput

        try:
            if "," in value:
                numbers = tuple(float(part) for part in value.split(","))
                if len(numbers) == 3 and all(math.isfinite(number) for number in numbers):
                    return numbers
                raise ValueError
            return color("colour", value)
        except (ValueError, InvalidInput):
            self.fail(f"{value!r}: wanted r,g,b in 0 to 1, #rrggbb, or the name of a colour", param, ctx)


def apply(options: list[Callable[[Function], Function]]) -> Callable[[Function], Function]:
    """Return one decorator that adds several options, in their order."""

    def decorate(function: Function) -> Function:
        for option in reversed(options):
            function = option(function)
        return function

    return decorate


def _set_log(quiet: bool, verbose: int) -> None:
    logger = logging.getLogger("sheetsplat")
    for old in [handler for handler in logger.handlers if getattr(handler, "_of_command_line", False)]:
        logger.removeHandler(old)
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(message)s"))
    handler._of_command_line = True  # type: ignore[attr-defined]
    logger.addHandler(handler)
    logger.setLevel(logging.ERROR if quiet else (logging.WARNING, logging.INFO, logging.DEBUG)[min(verbose, 2)])


def common(function: Function) -> Function:
    """Add -q and -v. The command gets `quiet`."""

    @click.option("-q", "--quiet", is_flag=True, help="Say nothing but errors.")
    @click.option("-v", "--verbose", count=True, help="Say more on stderr; -vv says everything.")
    @functools.wraps(function)
    def wrapped(*args: Any, quiet: bool, verbose: int, **kwargs: Any) -> Any:
        _set_log(quiet, verbose)
        return function(*args, quiet=quiet, **kwargs)

    return wrapped  # type: ignore[return-value]


as_json = click.option("--json", "as_json", is_flag=True, help="Report as JSON on stdout.")


def _set_floor(context: click.Context, _: click.Parameter, floor: float | None) -> None:
    if floor is not None:
        context.params["log"] = floor


def _keep_floor(context: click.Context, _: click.Parameter, on: bool) -> bool | float:
    # A floor that was read first is in its place already.
    kept: bool | float = context.params.get("log", on)
    return kept


file_options: list[Callable[[Any], Any]] = [
    click.option(
        "--shape", type=Numbers("X,Y,Z", 3, whole=True), help="Raw samples: how many along x, y, z, x the fastest."
    ),
    click.option("--dtype", help='Raw samples: their type, as NumPy writes it: uint8, int16, ">i2", float32 …'),
    click.option("--offset", type=click.IntRange(min=0), help="Raw samples: bytes before the first one."),
    click.option("--name", help="The array of an .npz file to take."),
    click.option(
        "--scalar",
        help="Scattered data and .vti: what is shown, by its name in the file; NAME_x: one component of a vector. "
        "PLOT3D: density, momentum, energy, velocity, pressure, temperature, mach …",
    ),
    click.option(
        "--log/--no-log", default=False, callback=_keep_floor, help="Show log10(value / smallest), in decades."
    ),
    click.option(
        "--log-floor",
        type=Real(above=0.0),
        expose_value=False,
        callback=_set_floor,
        help="Show log10(value / FLOOR); values below FLOOR are raised to it.",
    ),
    click.option("--grid", type=click.Path(path_type=Path), help="PLOT3D: the file of the grid; FILE is the solution."),
    click.option("--particles", metavar="GROUP", help="HDF5: the group of particles.  [default: PartType0]"),
    click.option(
        "--support",
        type=Real(above=0.0),
        help="HDF5: radius of a kernel in smoothing lengths; else what gives the file's densities.",
    ),
    click.option(
        "--fit",
        type=click.Choice(["delaunay", "nearest"]),
        help="Scattered data: sizes of the kernels by the neighbours in the mesh (or of the Delaunay tetrahedra), or "
        "by the nearest ones; else what the file itself says, then delaunay.",
    ),
    click.option(
        "--neighbors", type=click.IntRange(1, 256), help="Scattered data: --fit nearest with so many neighbours."
    ),
    click.option(
        "--min-scale", type=Real(above=0.0), help="Scattered data: raise smaller semi-axes to this, world units."
    ),
]

place_options: list[Callable[[Any], Any]] = [
    click.option(
        "--spacing",
        type=Numbers("DX,DY,DZ", 3, positive=True),
        help="World units between samples; else what the file says.",
    ),
    click.option(
        "--origin", type=Numbers("X,Y,Z", 3), help="World position of the first sample; else what the file says."
    ),
    click.option("--lattice", type=click.Choice(["cartesian", "bcc"]), help="BCC: DX of --spacing is its edge."),
]

field_options: list[Callable[[Any], Any]] = [
    *place_options,
    click.option("--radius", type=Real(above=0.0), help="Radius of the kernels, in sample distances.  [default: 2]"),
    click.option("--falloff", type=Real(above=0.0), help="Falloff k of the kernels.  [default: 5; scattered: 8]"),
    click.option(
        "--normalization",
        type=click.Choice(["none", "lattice", "threshold"]),
        help="[default: lattice; scattered: threshold, or what the file says]",
    ),
    click.option("--w0", type=Real(above=0.0), help="Threshold of --normalization threshold.  [default: 1]"),
    click.option(
        "--prefilter",
        is_flag=True,
        help="Volumes: let the sum of the kernels pass through the samples; sharper. Best with "
        "--radius 2.5 --falloff 7.",
    ),
    click.option("--nan", type=click.Choice(["error", "skip"]), help="What a NaN sample is.  [default: error]"),
]

look_options: list[Callable[[Any], Any]] = [
    click.option(
        "--cmap",
        type=ColormapType(),
        help="Colormap: a name of the cmap package (viridis, gray, matlab:jet …), colours spread over --clim, or "
        "colours at values. [composite, isosurface; default: viridis]",
    ),
    click.option(
        "--opacity", type=OpacityType(), help="Opacity per reference length; else by the histogram. [composite]"
    ),
    click.option(
        "--clim",
        type=Numbers("LOW,HIGH", 2, rising=True),
        help="Where the colormap begins and ends; else by the histogram, or so that "
        "a surface has a colour from the upper part of the map. [composite, isosurface]",
    ),
    click.option(
        "--shading/--no-shading",
        default=True,
        show_default=True,
        help="A light over the viewer's shoulder. [composite, isosurface]",
    ),
    click.option(
        "--background",
        type=ColorType(),
        help="Behind the picture: r,g,b, #rrggbb or a name; transparent unless given. [composite, isosurface]",
    ),
    click.option(
        "--mode",
        type=click.Choice(["composite", "isosurface", "xray", "mip"]),
        default="composite",
        show_default=True,
        help="How slices become a pixel. Options that end with names of modes are for these only.",
    ),
    click.option("--iso", "iso_value", type=Real(), help="Value of the surface; else by the histogram. [isosurface]"),
    click.option("--slice-spacing", type=Real(above=0.0), help="Distance of slices in world units."),
    click.option("--sampling", type=click.Choice(["point", "slab"]), default="point", show_default=True),
    click.option(
        "--reference-length", type=Real(above=0.0), help="World units to which opacities refer. [composite, isosurface]"
    ),
    click.option(
        "--opacity-stop",
        type=Real(above=0.0, most=1.0),
        default=0.98,
        show_default=True,
        help="Opacity at which a pixel is done; 1: never. [composite]",
    ),
    click.option(
        "--preintegration/--no-preintegration",
        default=False,
        show_default=True,
        help="Classify between slices. [composite]",
    ),
    click.option("--second-order", is_flag=True, help="Pre-integrate by second order. [composite]"),
    click.option(
        "--filter", type=click.Choice(["ewa"]), help="Widen kernels that are smaller than a pixel or a slice distance."
    ),
    click.option(
        "--gradient",
        type=click.Choice(GRADIENTS),
        default="sheets",
        show_default=True,
        help="Where normals come from: differences, or the kernels' own derivatives. [composite, isosurface]",
    ),
    click.option(
        "--clip-plane",
        "clip_planes",
        type=Numbers("NX,NY,NZ,OFFSET", 4),
        multiple=True,
        help="Keep the points x with N·x ≥ OFFSET, world units; may be repeated.",
    ),
    click.option(
        "--clip-box", type=Numbers("X0,Y0,Z0,X1,Y1,Z1", 6), help="Keep what is between two corners, world units."
    ),
    click.option(
        "--gradient-opacity",
        type=Real(above=0.0),
        help="Hide what changes by less than this much per world unit. [composite]",
    ),
    click.option(
        "--depth-cue",
        type=CueType(),
        help="Let colours fade between two depths; auto: those of the field. [composite, isosurface]",
    ),
    click.option(
        "--depth-cue-color", type=ColorType(), help="What they fade to. [composite, isosurface; default: black]"
    ),
    click.option("--shadows", is_flag=True, help="Let lights cast shadows. [composite, isosurface]"),
    click.option(
        "--ambient-occlusion",
        type=OcclusionType(),
        help="Dim ambient light by what is nearer than a radius in world units. [composite, isosurface]",
    ),
]

view_options: list[Callable[[Any], Any]] = [
    click.option(
        "--size",
        type=Numbers("WxH", 2, whole=True, square=True),
        default="400x400",
        show_default=True,
        help="Pixels; one number: square.",
    ),
    click.option("--direction", type=Direction(), help="Of the view: X,Y,Z, or an axis such as -z.  [default: -z]"),
    click.option("--up", type=Direction(), help="What is up in the picture.  [default: y]"),
    click.option(
        "--azimuth", type=Real(), help="Degrees by which the eye goes round up.  [default: 25, with --direction 0]"
    ),
    click.option("--elevation", type=Real(), help="Degrees towards up.  [default: 20, with --direction 0]"),
    click.option("--zoom", type=Real(above=0.0), default=1.0, show_default=True, help="Enlargement."),
    click.option(
        "--target", type=Numbers("X,Y,Z", 3), help="World point in the middle of the picture.  [default: of the field]"
    ),
    click.option(
        "--projection", type=click.Choice(["orthographic", "perspective"]), default="orthographic", show_default=True
    ),
    click.option(
        "--fov",
        "fov_y",
        type=Real(above=0.0, below=180.0),
        default=30.0,
        show_default=True,
        help="Vertical angle of perspective.",
    ),
    click.option("--margin", type=Real(above=0.0), default=1.05, show_default=True, help="Picture over volume."),
]

renderer_options: list[Callable[[Any], Any]] = [
    click.option("--backend", type=click.Choice(BACKENDS), default="auto", show_default=True),
    click.option("--device", type=click.IntRange(min=0, max=2**31 - 1), help="Number of the EGL device."),
    click.option("--precision", type=click.Choice(PRECISIONS), default="auto", show_default=True),
    click.option("--tagging", type=click.Choice(TAGGINGS), default="auto", show_default=True),
    click.option("--packing", type=click.Choice(PACKINGS), default="auto", show_default=True),
    click.option(
        "--effect",
        "effects",
        multiple=True,
        metavar="NAME=on|off",
        help='Force an effect of the plan; may be repeated. Usage, "Words of the plan", lists them.',
    ),
    click.option(
        "--threads",
        type=click.IntRange(min=1, max=MOST_THREADS),
        help='Of backend "cpu"; as many as the process may run on unless given.',
    ),
    click.option(
        "--max-error",
        type=Real(above=0.0),
        help="Root mean square error that the picture may have against closer and closer slices: the cheapest settings "
        "that keep it are chosen, where options leave them open.",
    ),
    click.option(
        "--max-seconds",
        type=Real(above=0.0),
        help="How long drawing may take, about: settings of the smallest error are chosen. Goes before --max-error. "
        "The first picture takes longer, by the trials of settings.",
    ),
    click.option("--allow-inexact", is_flag=True, help="Let settings through that cannot keep the error bound."),
]


def scene_options(function: Function) -> Function:
    """Add every option that `prepare` takes."""
    options = [*file_options, *field_options, *look_options, *view_options, *renderer_options]
    decorated: Function = apply(options)(function)
    return decorated


_LOOK = ("cmap", "opacity", "clim", "shading", "background", "mode", "iso_value", "slice_spacing", "sampling")
_LOOK_TOO = ("reference_length", "opacity_stop", "preintegration", "filter")
_EFFECTS = ("second_order", "gradient", "gradient_opacity", "depth_cue", "depth_cue_color", "shadows")
_EFFECTS_TOO = ("ambient_occlusion", "clip_planes", "clip_box")
_VIEW = ("direction", "up", "azimuth", "elevation", "zoom", "target", "projection", "fov_y", "margin")
_RENDERER = (
    *("backend", "device", "precision", "tagging", "packing", "threads"),
    *("max_error", "max_seconds", "allow_inexact"),
)
_FIELD = (
    *("spacing", "origin", "lattice", "radius", "falloff", "normalization", "w0", "prefilter", "nan"),
    *("dtype", "offset", "name"),
    *("grid", "scalar", "particles", "support", "fit", "neighbors", "min_scale", "log"),
)


def forced_effects(texts: tuple[str, ...]) -> dict[str, bool]:
    """Return {name: on} of texts such as "elimination=off"."""
    words = {"on": True, "true": True, "1": True, "off": False, "false": False, "0": False}
    effects: dict[str, bool] = {}
    for text in texts:
        name, equals, word = text.partition("=")
        if not equals or word.lower() not in words:
            raise click.BadParameter(f"{text!r}: wanted NAME=on or NAME=off", param_hint="--effect")
        on = words[word.lower()]
        if effects.setdefault(name, on) != on:
            raise click.BadParameter(f"{name!r}: on and off at once", param_hint="--effect")
    return effects


def array_shape(shape: tuple[int, ...] | None) -> tuple[int, ...] | None:
    """Return the shape of the array [k, j, i] of samples along x, y, z."""
    return None if shape is None else tuple(reversed(shape))


# What options of the command line are called where it is not the name of the parameter.
_SPELLED = {"iso_value": "--iso", "fov_y": "--fov", "clip_planes": "--clip-plane"}
# A default that says nothing in a mode may be said aloud; it is no mistake about the picture.
_HARMLESS = ("shading", "opacity_stop")


def spelled(name: str) -> str:
    """Return the option of the command line that sets a parameter."""
    return _SPELLED.get(name, "--" + name.replace("_", "-"))


def check_mode(options: dict[str, Any], outputs: tuple[str, ...] = ()) -> None:
    """Refuse options that the mode does not use, and warn of those that change nothing in any case."""
    from sheetsplat import advice

    context = click.get_current_context()
    given = [
        name
        for name in (*_LOOK, *_LOOK_TOO, *_EFFECTS, *_EFFECTS_TOO)
        if name in options
        and context.get_parameter_source(name) is ParameterSource.COMMANDLINE
        # Switched off where it is off anyway.
        and not (name == "preintegration" and not options[name])
    ]
    mode = options["mode"]
    ignored = advice.unused(mode, [*given, *outputs])
    refused = [spelled(name) for name in ignored if name not in _HARMLESS]
    if refused:
        raise click.UsageError(f"--mode {mode} does not use {', '.join(refused)}; leave out one or the other")
    if ignored:
        names = ", ".join(spelled(name) for name in ignored)
        logging.getLogger("sheetsplat").warning("--mode %s does not use %s", mode, names)


def for_command_line(message: str) -> str:
    """Return the message of an error with the names of options in place of those of Python's arguments."""
    for pattern, option in _WORDS:
        message = re.sub(pattern, option, message)
    return message


_WORDS = (
    (r"pass allow_inexact=True", "give --allow-inexact"),
    (r"max_(error|seconds)\b", r"--max-\1"),
    (r"leave slice_spacing out", "leave out --slice-spacing"),
    (r'use backend="(\w+)"', r"use --backend \1"),
    (r'precision="(\w+)"', r"--precision \1"),
    (r"leave opacity_stop at its default", "leave out --opacity-stop"),
    (r"correct effects=", "correct --effect NAME=on|off"),
    (r"from effects=", "from --effect"),
    (r'pass nan="skip"', "give --nan skip"),
    (r'which nan="skip" leaves out', "which --nan skip leaves out"),
    (r'normalization="(\w+)"', r"--normalization \1"),
    (r"prefilter=True", "--prefilter"),
    (r"give name=\.\.\. to choose", "give --name NAME to choose"),
    (r"pass min_scale(=\w+)?", "give --min-scale"),
    (r"use fit\.nearest", "give --neighbors 32"),
    (r" \w+=\.\.\. \(on the command line (--[\w -]+)\)", r" \1"),
    (r" \w+=[\w.]+ \(on the command line (--[\w -]+)\)", r" \1"),
    (r"pass iso_value", "give --iso"),
    (r'preintegration=true with mode="(\w+)"', r"--preintegration with --mode \1"),
    (r'preintegration only in mode="composite"', "--preintegration only in --mode composite"),
    (r'turn preintegration off or use mode="composite"', "leave out --preintegration or use --mode composite"),
)


def scene_effects(options: dict[str, Any]) -> dict[str, Any]:
    """Return what `Scene` takes for the options of effects; a depth cue by the camera is left out."""
    from sheetsplat.scene import AmbientOcclusion, Clip, DepthCue

    effects: dict[str, Any] = {name: options[name] for name in ("gradient", "gradient_opacity", "shadows")}
    if options["second_order"]:
        source = click.get_current_context().get_parameter_source("preintegration")
        if source is ParameterSource.COMMANDLINE and not options["preintegration"]:
            raise click.UsageError("--second-order is a kind of pre-integration; leave out --no-preintegration")
        effects["preintegration"] = "second_order"
    if options["clip_planes"] or options["clip_box"]:
        box = options["clip_box"]
        effects["clip"] = Clip(
            planes=[(plane[:3], plane[3]) for plane in options["clip_planes"]],
            box=None if box is None else (box[:3], box[3:]),
        )
    if options["ambient_occlusion"] is not None:
        effects["ambient_occlusion"] = AmbientOcclusion(*options["ambient_occlusion"])
    cue, color = options["depth_cue"], options["depth_cue_color"]
    if color is not None and cue is None:
        raise click.UsageError("--depth-cue-color is the colour of --depth-cue; give that too, for example auto")
    if cue is not None and cue != "auto":
        start, end, strength = cue
        effects["depth_cue"] = DepthCue(start, end, color or (0, 0, 0), strength)
    return effects


def prepare(path: Path, options: dict[str, Any]) -> tuple[Any, Any, Any, tuple[int, int]]:
    """Return scene, camera, renderer and size of a file and the values of `scene_options`."""
    from sheetsplat import api
    from sheetsplat._checks import image_size
    from sheetsplat.renderer import Renderer

    effects = forced_effects(options["effects"])
    if isinstance(options["cmap"], ColorPairs):
        options["cmap"], options["clim"] = options["cmap"].table(options["clim"])
    size = image_size(options["size"])
    given = {name: options[name] for name in _FIELD}
    fields = api.to_fields(path, shape=array_shape(options["shape"]), **given)
    look = {name: options[name] for name in _LOOK + _LOOK_TOO} | scene_effects(options)
    free = options["max_error"] is not None or options["max_seconds"] is not None
    scene = api.compose_scene(fields, **look, spacing_is_free=free)
    camera = api.compose_camera(scene, size, **{name: options[name] for name in _VIEW})
    if options["depth_cue"] == "auto":
        scene = scene.replace(depth_cue=api.fitting_depth_cue(scene, camera, options["depth_cue_color"] or (0, 0, 0)))
    renderer = Renderer(effects=effects, **{name: options[name] for name in _RENDERER})
    return scene, camera, renderer, size
