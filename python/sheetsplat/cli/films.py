"""What the commands that write films share."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sheetsplat.cli.cluster import connected
from sheetsplat.cli.options import apply, as_json, common, options_of, scene_options
from sheetsplat.cli.output import progress_bar, report_json, say
from sheetsplat.options.film import FilmOptions

if TYPE_CHECKING:
    from sheetsplat.animation import Animation

_OUTPUT = click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    required=True,
    help="The film: .mp4, .webm or .gif; or a folder of pictures, which goes on where it stopped.",
)
_SCHEDULER = click.option(
    "--scheduler", metavar="ADDRESS", help="Let the workers of a dask scheduler draw the frames: tcp://host:8786."
)
_OVERWRITE = click.option("--overwrite", is_flag=True, help="Replace frames of another film in the folder.")


def film_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of films, and all of pictures."""
    added = [_OUTPUT, *options_of(FilmOptions), _SCHEDULER, _OVERWRITE, scene_options, as_json, common]
    decorated: Callable[..., Any] = apply(added)(function)
    return decorated


def write(
    film: Callable[[], Animation], output: Path, name: str, given: dict[str, Any], *, as_json: bool, quiet: bool
) -> None:
    """Write a film and report; `given`: scheduler, workers and overwrite."""
    if given["scheduler"] is not None and given["workers"] is not None:
        raise click.UsageError("--scheduler and --workers both say what draws the frames; leave out one or the other")
    began = time.perf_counter()
    made = film()
    with connected(given["scheduler"]) as client, progress_bar(name, quiet=quiet) as progress:
        made.save(output, workers=given["workers"], client=client, progress=progress, overwrite=given["overwrite"])
    seconds = time.perf_counter() - began
    width, height = made.size
    if as_json:
        report: dict[str, Any] = {"output": str(output), "frames": len(made), "fps": made.fps, "size": made.size}
        report_json({**report, "backend": made.renderer.settings["backend"], "seconds": seconds})
    say(f"{output}: {len(made)} frames of {width} x {height} pixels in {seconds:.1f} s", quiet=quiet)
