"""sheetsplat animate."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sheetsplat.cli.films import Film, film_options
from sheetsplat.cli.help import GroupedCommand
from sheetsplat.cli.options import apply, options_of
from sheetsplat.cli.output import check_outputs
from sheetsplat.errors import InvalidInput
from sheetsplat.options.film import MOST_FRAMES, BetweenOptions

if TYPE_CHECKING:
    from sheetsplat.animation import Animation
    from sheetsplat.camera import Camera


def _camera_of(path: Path) -> Camera:
    """Return the camera of a picture that says how it was made, or of a scene file with an eye."""
    from sheetsplat.cli.scene import is_scene_file
    from sheetsplat.describe.recipe import Recipe
    from sheetsplat.describe.scene_file import SceneFile

    if not is_scene_file(path):
        return Recipe.read(path).camera
    scene = SceneFile.read(path)
    return scene.camera if scene.camera is not None else scene.prepare().camera


@click.command("animate", cls=GroupedCommand)
@click.argument("files", type=click.Path(path_type=Path), nargs=-1, required=True)
@click.option(
    "--frames",
    type=click.IntRange(1, MOST_FRAMES),
    help="Number of frames, over which the files are spread evenly.  [default: as many as there are files, or steps]",
)
@click.option(
    "--key",
    "keys",
    type=click.Path(path_type=Path),
    multiple=True,
    help="A picture (.png) or scene file (.toml) whose camera is a key frame; repeated, the camera moves smoothly "
    "through them, in their order.",
)
@apply(options_of(BetweenOptions))
@film_options
def command(
    files: tuple[Path, ...],
    output: Path,
    frames: int | None,
    keys: tuple[Path, ...],
    between: int | None,
    fps: float,
    as_json: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Write a film of a time series, FILES in their order, with one look for all; or of one file and a moving camera.

    One file with several time steps (NetCDF, OME-Zarr, .pvd) is a time series, too.

    Range, opacity, quality, camera and backend are decided once, by up to eight of the files from the first to the
    last. A folder goes on where it stopped.

    \b
    Examples:
      sheetsplat animate run/step*.nrrd -o run.mp4 --fps 12
      sheetsplat animate snapshot_*.hdf5 --between 9 -o run.mp4
      sheetsplat animate head.nrrd -o flight.mp4 --frames 120 --key front.png --key side.png --key top.toml
    """  # noqa: D301
    from sheetsplat.animation import animate

    check_outputs([output], [*dict.fromkeys([*files, *keys])])

    def made(data: Any, **keywords: Any) -> Animation:
        camera = [_camera_of(path) for path in keys] or None
        try:
            return animate(data, frames, between=between, fps=fps, camera=camera, **keywords)
        except InvalidInput as error:
            if frames is None and error.option == "frames":
                told = "this file stays the same; give --frames, and --key for a camera that moves"
                raise click.UsageError(told) from None
            raise

    Film(files, made).write(output, options, as_json=as_json, quiet=quiet)
