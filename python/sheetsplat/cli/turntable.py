"""sheetsplat turntable."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sheetsplat.cli.films import Film, film_options
from sheetsplat.cli.help import GroupedCommand
from sheetsplat.cli.options import apply, options_of
from sheetsplat.cli.output import check_outputs
from sheetsplat.options.film import TurnOptions

if TYPE_CHECKING:
    from sheetsplat.animation import Animation


@click.command("turntable", cls=GroupedCommand)
@click.argument("file", type=click.Path(path_type=Path))
@apply(options_of(TurnOptions))
@film_options
def command(
    file: Path,
    output: Path,
    frames: int,
    axis: tuple[float, ...] | None,
    degrees: float,
    fps: float,
    as_json: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Write a film in which the eye turns about FILE, a file of data or a scene file (.toml).

    Range, opacity, quality and backend are decided once. A folder goes on where it stopped.

    \b
    Examples:
      sheetsplat turntable head.nrrd -o head.mp4
      sheetsplat turntable head.nrrd -o frames --frames 180 --workers 4 --cmap magma
      sheetsplat turntable scene.toml -o scene.gif --size 320 --fps 15
      sheetsplat turntable large.zarr -o frames --brick 256 --scheduler tcp://host:8786
    """  # noqa: D301
    from sheetsplat.animation import turntable

    check_outputs([output], [file])

    def made(data: Any, **keywords: Any) -> Animation:
        return turntable(data, frames=frames, axis=axis, degrees=degrees, fps=fps, **keywords)

    Film([file], made).write(output, options, as_json=as_json, quiet=quiet)
