"""sheetsplat render."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from sheetsplat._matplotlib import require_matplotlib
from sheetsplat.cli.cluster import brick_options, in_bricks, is_cut, without_bricks
from sheetsplat.cli.help import GroupedCommand
from sheetsplat.cli.options import apply, as_json, check_mode, common, options_of, scene_options
from sheetsplat.cli.output import check_outputs, progress_bar, report_json, say
from sheetsplat.cli.scene import given_keywords, is_scene_file, prepare, prepare_again, prepare_scene_file
from sheetsplat.io.formats import LISTED_REGULAR, LISTED_SCATTERED
from sheetsplat.modes import TRAITS
from sheetsplat.options.core import checked, definitions
from sheetsplat.options.figure import FigureOptions
from sheetsplat.options.renderer import Output
from sheetsplat.options.spelling import flags

_PATH = click.Path(path_type=Path, dir_okay=False)


_HELP = f"""Render FILE into a picture.

FILE is a volume: {LISTED_REGULAR} (these with --shape and --dtype). Or it is scattered data: {LISTED_SCATTERED}
(--grid). Each may be gzipped.

FILE may also be a scene file (.toml), which names its data; options that are given replace its own, and DATA its
files. -o SCENE.toml writes one in place of a picture.

Or FILE is a picture that this command wrote (.png): then DATA is what it was made of, one file for each field, and
the picture is made again. Options of files, of the renderer and --size may be given; all others are the picture's own.

Options whose help ends with names of modes are for these modes only.
"""


@click.command("render", help=_HELP, cls=GroupedCommand)
@click.argument("file", type=click.Path(path_type=Path))
@click.argument("data", type=click.Path(path_type=Path), nargs=-1)
@click.option(
    "-o",
    "--output",
    type=_PATH,
    help="The picture: .png, .jpg, .tif, .webp, .exr or .npy; or .toml, a scene file.  [default: NAME.png of a scene "
    "file NAME.toml; required for others]",
)
@click.option(
    "--depth", "depth_path", type=_PATH, help="Write the depth of opacity one half as well. [composite, isosurface]"
)
@click.option(
    "--coverage", "coverage_path", type=_PATH, help="Write the line integral of the kernels' weights as well."
)
@click.option(
    "--figure",
    "figure_path",
    type=_PATH,
    help="Write the picture with colour bar, axes and labels as well: .pdf or .svg, whose text is text, .png, .jpg, "
    ".tif or .webp.",
)
@apply(options_of(FigureOptions))
@click.option(
    "--metadata/--no-metadata", default=True, help="Say in a .png how it was made, so that it can be made again."
)
@brick_options
@scene_options
@as_json
@common
def command(
    file: Path,
    data: tuple[Path, ...],
    output: Path | None,
    depth_path: Path | None,
    coverage_path: Path | None,
    figure_path: Path | None,
    metadata: bool,
    as_json: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Run the command; `_HELP` describes it."""
    from sheetsplat.api import Prepared
    from sheetsplat.io import pictures
    from sheetsplat.io.png_text import is_png
    from sheetsplat.look.surface import surface_color, surface_text

    figure = _of_figure(figure_path, options)
    if output is None:
        if not is_scene_file(file):
            raise click.UsageError("Missing option '-o' / '--output'.")
        output = Path(f"{file.stem}.png")
    if is_scene_file(output):
        _write_scene(file, data, output, options)
        say(f"{output}: a scene file; `sheetsplat render {output}` makes its picture", quiet=quiet)
        return
    extra: dict[Output, Path] = {}
    if depth_path is not None:
        extra["depth"] = depth_path
    if coverage_path is not None:
        extra["coverage"] = coverage_path
    beside = [*extra.values(), *([] if figure_path is None else [figure_path])]
    check_outputs([output, *beside], [file, *data, *([options["grid"]] if options["grid"] else [])])
    for path in (output, *beside):
        suffixes = {output: pictures.SUFFIXES, figure_path: pictures.FIGURES}.get(path, pictures.CHANNEL_SUFFIXES)
        if path.suffix.lower() not in suffixes:
            raise click.UsageError(f"{path}: a picture's name ends with {pictures.listed_suffixes(suffixes)}")
        pictures.check_folder(path)
    again = is_png(file)
    if bool(data) != again and not is_scene_file(file):
        raise click.UsageError(
            f"{file} is a picture; name the data that it was made of after it"
            if again
            else f"{file} is no picture (.png) to make again from {data[0]}"
        )
    began = time.perf_counter()
    if is_cut(options, by_workers=True) and (again or is_scene_file(file)):
        raise click.UsageError("--brick, --workers and --scheduler are for files of data")
    with in_bricks(options) as bricks:
        options = without_bricks(options)
        if is_scene_file(file):
            scene, camera, renderer, size = prepare_scene_file(file, data, options)
        elif again:
            scene, camera, renderer, size = prepare_again(file, data, options)
        else:
            check_mode(options, tuple(extra))
            scene, camera, renderer, size = prepare(file, options, None if bricks is None else bricks.open)
        for note in (*scene.notes, *([surface_text(scene)] if TRAITS[scene.mode].shows_surfaces else [])):
            say(note, quiet=quiet)
        with progress_bar(file.name, quiet=quiet) as progress:
            picture: dict[str, Any] = {"size": size, "outputs": tuple(extra), "progress": progress}
            client = None if bricks is None else bricks.client
            image = Prepared(scene, camera, renderer=renderer, client=client, **picture).render()
    with pictures.whole_files([output, *beside]) as (made, *others):
        with pictures.naming(output):
            image.save(made, metadata=metadata)
        for (name, path), other in zip(extra.items(), others, strict=False):
            with pictures.naming(path):
                pictures.save_channel(getattr(image, name), other)
        if figure_path is not None:
            with pictures.naming(figure_path):
                image.save_figure(others[-1], **figure)
    seconds = time.perf_counter() - began
    if as_json:
        written = {"output": str(output)}
        written |= {name: str(path) for name, path in extra.items()}
        written |= {} if figure_path is None else {"figure": str(figure_path)}
        surface: dict[str, Any] = {}
        if TRAITS[scene.mode].shows_surfaces:
            surface = {"iso_value": scene.iso_value, "color": list(surface_color(scene, scene.surfaces[0][0]))}
        report_json({**written, **surface, "seconds": seconds, "plan": image.plan.to_dict(), "stats": image.stats})
    say(f"{output}: {size[0]} x {size[1]} pixels by {image.plan.backend} in {seconds:.2f} s", quiet=quiet)


def _of_figure(path: Path | None, options: dict[str, Any]) -> Any:
    """Take the options of the figure out of those of the command and return them, checked."""
    context, figure = click.get_current_context(), {}
    for name, defined in definitions(FigureOptions).items():
        (spelling,) = defined.spellings
        parameter = spelling.parameter or name
        value = options.pop(parameter)
        if context.get_parameter_source(parameter) is not ParameterSource.COMMANDLINE:
            continue
        figure[name] = value
        if path is None:
            raise click.UsageError(f"{flags(name, spelling).partition('/')[0]} is of --figure, which is missing")
    if path is not None:
        # Before anything is drawn.
        require_matplotlib()
        checked("render", figure, FigureOptions)
    return figure


def _write_scene(file: Path, data: tuple[Path, ...], output: Path, options: dict[str, Any]) -> None:
    """Write the scene file of a picture that says how it was made, or of a file and the options that were given."""
    from sheetsplat.describe.recipe import Recipe
    from sheetsplat.describe.scene_file import SceneFile
    from sheetsplat.io.png_text import is_png

    check_outputs([output], [file, *data])
    if is_scene_file(file):
        raise click.UsageError(f"{file} is a scene file already")
    if is_png(file):
        scene = SceneFile.of(Recipe.read(file), data)
    elif data:
        raise click.UsageError(f"{file} is no picture (.png) to make again from {data[0]}")
    else:
        check_mode(options)
        scene = SceneFile.of_options(file, **given_keywords(options))
    scene.save(output)
