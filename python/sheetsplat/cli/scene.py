"""From the options of a command to a scene, a camera and a renderer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from sheetsplat.cli.types import ColorPairs
from sheetsplat.cli.wording import usage_errors
from sheetsplat.options.core import definitions, pick
from sheetsplat.options.data import OpenOptions
from sheetsplat.options.picture import LookOptions, RenderOptions
from sheetsplat.options.renderer import RendererOptions
from sheetsplat.options.spelling import flag_of

if TYPE_CHECKING:
    from sheetsplat.camera import Camera
    from sheetsplat.fields import Field
    from sheetsplat.renderer import Renderer
    from sheetsplat.scene import Scene


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


def file_options(options: dict[str, Any]) -> dict[str, Any]:
    """Return what `sheetsplat.open` takes for the options of a file."""
    given = pick(OpenOptions, options)
    if given["shape"] is not None:
        # Along x, y, z on the command line; of the array [k, j, i] in Python.
        given["shape"] = tuple(reversed(given["shape"]))
    if given["periodic"] is not None:
        given["periodic"] = (given["periodic"][:3], given["periodic"][3:])
    if options["log_floor"] is not None:
        given["log"] = options["log_floor"]
    if given["weight"] is not None and Path(given["weight"]).is_file():
        given["weight"] = Path(given["weight"])
    return given


def _look(options: dict[str, Any]) -> dict[str, Any]:
    """Return what `compose_scene` takes for the options of the look; a depth cue by the camera is left out."""
    from sheetsplat.effects import AmbientOcclusion, Clip, DepthCue
    from sheetsplat.slice_planes import SlicePlane, slice_planes_of
    from sheetsplat.transfer import TransferFunction

    look = pick(LookOptions, options)
    for cmap, clim in (("cmap", "clim"), ("slice_cmap", "slice_clim")):
        if isinstance(look[cmap], ColorPairs):
            look[cmap], look[clim] = look[cmap].table(look[clim])
    if isinstance(look["color_map"], ColorPairs):
        rows, limits = look["color_map"].table(None)
        look["color_map"] = TransferFunction.from_colormap(rows, 1.0, limits)
    if options["second_order"]:
        source = click.get_current_context().get_parameter_source("preintegration")
        if source is ParameterSource.COMMANDLINE and not options["preintegration"]:
            raise click.UsageError("--second-order is a kind of pre-integration; leave out --no-preintegration")
        look["preintegration"] = "second_order"
    if options["clip_planes"] or options["clip_box"] or options["clip_sphere"]:
        box, sphere = options["clip_box"], options["clip_sphere"]
        look["clip"] = Clip(
            planes=[(plane[:3], plane[3]) for plane in options["clip_planes"]],
            box=None if box is None else (box[:3], box[3:]),
            sphere=None if sphere is None else (sphere[:3], sphere[3]),
        )
    planes = [SlicePlane(plane[:3], plane[3]) for plane in options["slice_plane"]]
    look["slice_planes"] = (*planes, *slice_planes_of("slice_planes", options["slice_planes"] or None))
    if isinstance(options["ambient_occlusion"], tuple):
        look["ambient_occlusion"] = AmbientOcclusion(*options["ambient_occlusion"])
    cue, color = look.pop("depth_cue"), options["depth_cue_color"]
    if color is not None and cue is None:
        raise click.UsageError("--depth-cue-color is the colour of --depth-cue; give that too, for example auto")
    if cue is not None and cue != "auto":
        start, end, strength = cue
        look["depth_cue"] = DepthCue(start, end, color or (0, 0, 0), strength)
    return look


def prepare_again(
    path: Path, data: tuple[Path, ...], options: dict[str, Any]
) -> tuple[Scene, Camera, Renderer, tuple[int, int]]:
    """Return scene, camera, renderer and size of a picture that says how it was made, from its data."""
    from sheetsplat._checks import image_size
    from sheetsplat.describe.recipe import Recipe, for_each
    from sheetsplat.renderer import Renderer

    context = click.get_current_context()
    given = {name for name in options if context.get_parameter_source(name) is ParameterSource.COMMANDLINE}
    of_files = {"log_floor", *definitions(OpenOptions)} - {"quality"}
    own = sorted(given - of_files - {"size", *definitions(RendererOptions)})
    if own:
        raise click.UsageError(f"{path} has its own {', '.join(map(flag_of, own))}; leave out one or the other")
    recipe = Recipe.read(path)
    files = for_each(data, [one.opened for one in recipe.fields])
    if len(files) != len(recipe.fields):
        raise click.UsageError(
            f"{path} was made of {len(recipe.fields)} files of data, not of {len(data)}; name that of each field, in "
            "their order; one alone stands for all of its channels or arrays"
        )
    opened = {name: value for name, value in file_options(options).items() if name in given}
    if "log_floor" in given:
        opened["log"] = options["log_floor"]
    scene = recipe.scene([one.open(file, **opened) for one, file in zip(recipe.fields, files, strict=True)])
    settings = {name: value for name, value in pick(RendererOptions, options).items() if name in given}
    if "effects" in settings:
        settings["effects"] = forced_effects(options["effects"])
    size = image_size(options["size"]) if "size" in given else recipe.size
    return scene, recipe.camera, Renderer(**{**recipe.renderer, **settings}), size


def given_keywords(options: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of `sheetsplat.render` that stand for what was given on the command line."""
    context = click.get_current_context()
    given = {name for name in options if context.get_parameter_source(name) is ParameterSource.COMMANDLINE}
    if "depth_cue_color" in given and options["depth_cue"] == "auto":
        raise click.UsageError("--depth-cue-color with --depth-cue auto needs a file of data; give the depths")
    with usage_errors():
        values = {**options, **file_options(options), **_look(options), "effects": forced_effects(options["effects"])}
    return {
        name: values[name]
        for name, defined in definitions(RenderOptions).items()
        if any((one.parameter or name) in given for one in defined.spellings)
    }


def is_scene_file(path: Path) -> bool:
    """Return whether a path is that of a scene file, by its name."""
    return path.suffix.lower() == ".toml"


def prepare_scene_file(
    path: Path, data: Sequence[Path], options: dict[str, Any]
) -> tuple[Scene, Camera, Renderer, tuple[int, int]]:
    """Return scene, camera, renderer and size of a scene file, with what was given on the command line in its place."""
    from sheetsplat.describe.scene_file import SceneFile

    made = SceneFile.read(path).prepare(list(data) or None, **given_keywords(options))
    return made.scene, made.camera, made.renderer, made.size


def prepare(
    path: Path, options: dict[str, Any], open_file: Callable[..., Field] | None = None
) -> tuple[Scene, Camera, Renderer, tuple[int, int]]:
    """Return scene, camera, renderer and size of a file and the values of `scene_options`.

    `open_file` opens it in place of `sheetsplat.open`.
    """
    if is_scene_file(path):
        return prepare_scene_file(path, (), options)
    from sheetsplat import api
    from sheetsplat._checks import image_size
    from sheetsplat.choose.asked import Asked
    from sheetsplat.choose.picture import choose
    from sheetsplat.renderer import Renderer

    effects = forced_effects(options["effects"])
    size = image_size(options["size"])
    with usage_errors():
        look = _look(options)
    opened = file_options(options)
    asked = Asked.of("render", {name: value for name, value in options.items() if value is not None})
    with usage_errors(reading=True):
        given: Mapping[str, Any] = {**options, **look, **opened}
        data = api.Opened.of(path, given) if open_file is None else api.Opened(path, (open_file(path, **opened),))
        given = api.with_coloring(data, given)
    with usage_errors():
        made = choose(data.fields, given, asked, size, cue_color=options["depth_cue_color"] or (0, 0, 0))
        return made.scene, made.camera, Renderer(**{**pick(RendererOptions, options), "effects": effects}), size
