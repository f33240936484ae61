"""Options that several commands share, and the types of their values."""

from __future__ import annotations

import functools
import logging
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from sheetsplat.renderer import BACKENDS, PACKINGS, PRECISIONS, TAGGINGS

# Generic for type checkers from click 8.4 on, and never at run time before.
if TYPE_CHECKING:
    _ParamType = click.ParamType[Any]
else:
    _ParamType = click.ParamType

Function = TypeVar("Function", bound=Callable[..., Any])


class Numbers(_ParamType):
    """Numbers with commas between them; whole ones may have an x: 256x256x128."""

    def __init__(self, name: str, count: int, *, whole: bool = False) -> None:
        self.name, self._count, self._whole = name, count, whole

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """Return the numbers."""
        if not isinstance(value, str):
            return tuple(value)
        parts = re.split(r"[,x]" if self._whole else r",", value.strip().lower())
        try:
            numbers = tuple((int if self._whole else float)(part) for part in parts)
        except ValueError:
            numbers = ()
        if len(numbers) != self._count:
            self.fail(f"{value!r}: wanted {self.name}, {self._count} numbers", param, ctx)
        return numbers


class Direction(Numbers):
    """Three numbers, or the name of an axis: x, -x, y, -y, z, -z."""

    def __init__(self) -> None:
        super().__init__("X,Y,Z", 3)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """Return the direction."""
        named = re.fullmatch(r"([+-]?)([xyz])", value.strip().lower()) if isinstance(value, str) else None
        if named is None:
            return super().convert(value, param, ctx)
        return tuple((-1.0 if named[1] == "-" else 1.0) * (axis == named[2]) for axis in "xyz")


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
                return [(float(at), float(opacity)) for at, opacity in pairs]
            numbers = [float(part) for part in value.split(",")]
        except ValueError:
            self.fail(f"{value!r}: wanted 0.5, or 0,0.1,0.9, or 40:0,90:0.1,200:0.9", param, ctx)
        return numbers[0] if len(numbers) == 1 else numbers


class ColorType(_ParamType):
    """R,G,B in [0, 1], #rrggbb, or a name."""

    name = "COLOR"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """Return red, green, blue."""
        if not isinstance(value, str):
            return tuple(value)
        from PIL import ImageColor

        try:
            if "," in value:
                numbers = tuple(float(part) for part in value.split(","))
                if len(numbers) == 3 and all(math.isfinite(number) for number in numbers):
                    return numbers
                raise ValueError
            return tuple(part / 255 for part in ImageColor.getrgb(value)[:3])
        except ValueError:
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

file_options: list[Callable[[Any], Any]] = [
    click.option(
        "--shape", type=Numbers("X,Y,Z", 3, whole=True), help="Raw samples: how many along x, y, z, x the fastest."
    ),
    click.option("--dtype", help='Raw samples: their type, as NumPy writes it: uint8, int16, ">i2", float32 …'),
    click.option("--offset", type=click.IntRange(min=0), help="Raw samples: bytes before the first one."),
    click.option("--name", help="The array of an .npz file to take."),
]

field_options: list[Callable[[Any], Any]] = [
    click.option(
        "--spacing", type=Numbers("DX,DY,DZ", 3), help="World units between samples; else what the file says."
    ),
    click.option(
        "--origin", type=Numbers("X,Y,Z", 3), help="World position of the first sample; else what the file says."
    ),
    click.option("--lattice", type=click.Choice(["cartesian", "bcc"]), help="BCC: DX of --spacing is its edge."),
    click.option("--radius", type=float, help="Radius of the kernels, in sample distances.  [default: 2]"),
    click.option("--falloff", type=float, help="Falloff k of the kernels.  [default: 5]"),
    click.option("--normalization", type=click.Choice(["none", "lattice", "threshold"]), help="[default: lattice]"),
    click.option("--w0", type=float, help="Threshold of --normalization threshold.  [default: 1]"),
    click.option("--nan", type=click.Choice(["error", "skip"]), help="What a NaN sample is.  [default: error]"),
]

look_options: list[Callable[[Any], Any]] = [
    click.option("--cmap", help="Colormap, a name of the cmap package.  [default: viridis]"),
    click.option("--opacity", type=OpacityType(), help="Opacity per reference length; else by the histogram."),
    click.option(
        "--clim", type=Numbers("LOW,HIGH", 2), help="Where the colormap begins and ends; else by the histogram."
    ),
    click.option("--shading/--no-shading", default=True, show_default=True, help="A light over the viewer's shoulder."),
    click.option("--background", type=ColorType(), help="Behind the picture; transparent unless given."),
    click.option(
        "--mode",
        type=click.Choice(["composite", "isosurface", "xray", "mip"]),
        default="composite",
        show_default=True,
        help="How slices become a pixel.",
    ),
    click.option("--iso", "iso_value", type=float, help="Value of --mode isosurface; else by the histogram."),
    click.option("--slice-spacing", type=float, help="Distance of slices in world units."),
    click.option("--sampling", type=click.Choice(["point", "slab"]), default="point", show_default=True),
    click.option("--reference-length", type=float, help="World units to which opacities refer."),
    click.option("--opacity-stop", type=float, default=0.98, show_default=True, help="1 for never."),
    click.option("--preintegration/--no-preintegration", default=False, show_default=True),
]

view_options: list[Callable[[Any], Any]] = [
    click.option("--size", type=Numbers("WxH", 2, whole=True), default="400x400", show_default=True, help="Pixels."),
    click.option("--direction", type=Direction(), help="Of the view: X,Y,Z, or an axis such as -z.  [default: -z]"),
    click.option("--up", type=Direction(), help="What is up in the picture.  [default: y]"),
    click.option("--azimuth", type=float, help="Degrees round up.  [default: 25, with --direction 0]"),
    click.option("--elevation", type=float, help="Degrees towards up.  [default: 20, with --direction 0]"),
    click.option("--zoom", type=float, default=1.0, show_default=True, help="Enlargement."),
    click.option(
        "--projection", type=click.Choice(["orthographic", "perspective"]), default="orthographic", show_default=True
    ),
    click.option("--fov", "fov_y", type=float, default=30.0, show_default=True, help="Vertical angle of perspective."),
    click.option("--margin", type=float, default=1.05, show_default=True, help="Picture over volume."),
]

renderer_options: list[Callable[[Any], Any]] = [
    click.option("--backend", type=click.Choice(BACKENDS), default="auto", show_default=True),
    click.option("--device", type=int, help="Number of the EGL device."),
    click.option("--precision", type=click.Choice(PRECISIONS), default="auto", show_default=True),
    click.option("--tagging", type=click.Choice(TAGGINGS), default="auto", show_default=True),
    click.option("--packing", type=click.Choice(PACKINGS), default="auto", show_default=True),
    click.option("--effect", "effects", multiple=True, metavar="NAME=on|off", help="Force an effect; may be repeated."),
    click.option("--allow-inexact", is_flag=True, help="Let settings through that cannot keep the error bound."),
]


def scene_options(function: Function) -> Function:
    """Add every option that `prepare` takes."""
    options = [*file_options, *field_options, *look_options, *view_options, *renderer_options]
    decorated: Function = apply(options)(function)
    return decorated


_LOOK = ("cmap", "opacity", "clim", "shading", "background", "mode", "iso_value", "slice_spacing", "sampling")
_LOOK_TOO = ("reference_length", "opacity_stop", "preintegration")
_VIEW = ("direction", "up", "azimuth", "elevation", "zoom", "projection", "fov_y", "margin")
_RENDERER = ("backend", "device", "precision", "tagging", "packing", "allow_inexact")
_FIELD = ("spacing", "origin", "lattice", "radius", "falloff", "normalization", "w0", "nan", "dtype", "offset", "name")


def forced_effects(texts: tuple[str, ...]) -> dict[str, bool]:
    """Return {name: on} of texts such as "elimination=off"."""
    words = {"on": True, "true": True, "1": True, "off": False, "false": False, "0": False}
    effects = {}
    for text in texts:
        name, equals, word = text.partition("=")
        if not equals or word.lower() not in words:
            raise click.BadParameter(f"{text!r}: wanted NAME=on or NAME=off", param_hint="--effect")
        effects[name] = words[word.lower()]
    return effects


def array_shape(shape: tuple[int, ...] | None) -> tuple[int, ...] | None:
    """Return the shape of the array [k, j, i] of samples along x, y, z."""
    return None if shape is None else tuple(reversed(shape))


def prepare(path: Path, options: dict[str, Any]) -> tuple[Any, Any, Any, tuple[int, int]]:
    """Return scene, camera, renderer and size of a file and the values of `scene_options`."""
    from sheetsplat import api
    from sheetsplat._checks import image_size
    from sheetsplat.renderer import Renderer

    effects = forced_effects(options["effects"])
    size = image_size(options["size"])
    given = {name: options[name] for name in _FIELD}
    fields = api.to_fields(path, shape=array_shape(options["shape"]), **given)
    scene = api.compose_scene(fields, **{name: options[name] for name in _LOOK + _LOOK_TOO})
    camera = api.compose_camera(scene, size, **{name: options[name] for name in _VIEW})
    renderer = Renderer(effects=effects, **{name: options[name] for name in _RENDERER})
    return scene, camera, renderer, size
