"""What the commands that write films share."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sheetsplat.cli.cluster import connected, in_bricks, is_cut, without_bricks
from sheetsplat.cli.options import apply, as_json, common, options_of, scene_options
from sheetsplat.cli.output import progress_bar, report_json, say
from sheetsplat.cli.scene import given_keywords
from sheetsplat.options.bricks import BrickOptions
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
    "--scheduler",
    metavar="ADDRESS",
    help="Let the workers of a dask scheduler draw the frames, tcp://host:8786: with --brick each frame by all of "
    "them, in bricks, which all of them must be able to read.",
)
_OVERWRITE = click.option("--overwrite", is_flag=True, help="Replace frames of another film in the folder.")


def film_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of films, and all of pictures."""
    added = [_OUTPUT, *options_of(FilmOptions), _SCHEDULER, _OVERWRITE, *options_of(BrickOptions), scene_options]
    added += [as_json, common]
    decorated: Callable[..., Any] = apply(added)(function)
    return decorated


@dataclass(frozen=True)
class Film:
    """A film as a command is asked for it.

    Attributes
    ----------
    files
        Its data.
    make
        Makes the film of the data, a path or several or data in bricks, with keywords of `turntable` and `animate`.
    """

    files: Sequence[Path]
    make: Callable[..., Animation]

    def write(self, output: Path, options: dict[str, Any], *, as_json: bool, quiet: bool) -> None:
        """Write it and report; `options`: those of `film_options`."""
        overwrite = options.pop("overwrite")
        if len(self.files) > 1 and is_cut(options, by_workers=False):
            raise click.UsageError("--brick is for one file: a time series cannot be drawn in bricks")
        began = time.perf_counter()
        with in_bricks(options, by_workers=False) as bricks:
            keywords = given_keywords(without_bricks(options))
            drawing: contextlib.AbstractContextManager[Any]
            if bricks is None:
                made = self.make(self.files[0] if len(self.files) == 1 else list(self.files), **keywords)
                drawing = connected(options["scheduler"])
            else:
                data, keywords = bricks.opened(self.files[0], keywords)
                made = self.make(data, client=bricks.client, **keywords)
                drawing = contextlib.nullcontext(bricks.client)
            workers = options["workers"] if bricks is None else None
            with drawing as client, progress_bar(self.files[0].name, quiet=quiet) as progress:
                made.save(
                    output, workers=workers, client=client, worker_timeout=options["worker_timeout"],
                    progress=progress, overwrite=overwrite,
                )  # fmt: skip
        seconds = time.perf_counter() - began
        width, height = made.size
        if as_json:
            report: dict[str, Any] = {"output": str(output), "frames": len(made), "fps": made.fps, "size": made.size}
            report_json({**report, "backend": made.renderer.settings["backend"], "seconds": seconds})
        say(f"{output}: {len(made)} frames of {width} x {height} pixels in {seconds:.1f} s", quiet=quiet)
