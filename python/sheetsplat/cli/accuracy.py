"""sheetsplat accuracy."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, Literal

import click

from sheetsplat.accuracy.knobs import KNOBS
from sheetsplat.cli.help import GroupedCommand
from sheetsplat.cli.options import as_json, check_mode, common, scene_options
from sheetsplat.cli.output import check_outputs, console, progress_bar, report, report_json, say
from sheetsplat.cli.scene import forced_effects, prepare
from sheetsplat.cli.types import Parsed
from sheetsplat.options.core import pick
from sheetsplat.options.renderer import RendererOptions

_MOST_REPEATS = 1000
# With these the renderer chooses the settings that are varied here.
_GOALS = ("max_error", "max_seconds")


def _knobs(text: str) -> tuple[str, ...]:
    names = tuple(part.strip() for part in text.split(","))
    if not set(names) <= KNOBS.keys():
        raise ValueError
    return names


@click.command("accuracy", cls=GroupedCommand)
@click.argument("file", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False), help="The plot: .png, .svg or .pdf.")
@click.option(
    "--knobs",
    type=Parsed("NAME,NAME,…", f"any of {', '.join(KNOBS)}", _knobs),
    help=f"Knobs to vary: {', '.join(KNOBS)}.  [default: all]",
)
@click.option(
    "--repeats",
    type=click.IntRange(1, _MOST_REPEATS),
    default=3,
    show_default=True,
    help="Number of timed frames for each setting; the median is reported.",
)
@click.option(
    "--reference-seconds",
    type=click.FloatRange(min=0.0),
    default=2.0,
    show_default=True,
    help="Approximate time limit of the float64 reference for a setting; 0: no arithmetic errors.",
)
@click.option(
    "--clock",
    type=click.Choice(["wall", "cpu"]),
    default="wall",
    show_default=True,
    help="Reported time: elapsed, or of the processor, which other processes disturb less.",
)
@scene_options
@as_json
@common
def command(
    file: Path,
    output: Path | None,
    knobs: tuple[str, ...] | None,
    repeats: int,
    reference_seconds: float,
    clock: Literal["wall", "cpu"],
    as_json: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Measure error and time of FILE for each setting that trades one for the other.

    Each knob is varied alone; each of its settings is timed and compared with the float64 reference at the same slices
    and with the converged picture. FILE and options are those of "sheetsplat render".
    """
    from sheetsplat._matplotlib import require_matplotlib
    from sheetsplat.accuracy import accuracy
    from sheetsplat.accuracy.plot import check_path

    if output is not None:
        # Before the measurement, which takes long.
        check_outputs([output], [file, *([options["grid"]] if options["grid"] else [])])
        if output.suffix.lower() not in (".png", ".svg", ".pdf"):
            raise click.UsageError(f"{output}: a plot's name ends with .png, .svg or .pdf")
        check_path(output)
        require_matplotlib("leave out -o")
    if any(options.get(name) is not None for name in _GOALS):
        raise click.UsageError("leave out --max-error and --max-seconds: they choose the settings that are varied here")
    check_mode(options)
    scene, camera, _, size = prepare(file, options)
    settings = {**pick(RendererOptions, options), "effects": forced_effects(options["effects"])}
    with progress_bar(file.name, quiet=quiet) as progress:
        found = accuracy(
            scene,
            camera,
            size=size,
            knobs=knobs,
            repeats=repeats,
            reference_seconds=reference_seconds,
            clock=clock,
            progress=progress,
            **settings,
        )
    if output is not None:
        found.plot(output)
        say(f"{output}: the plot", quiet=quiet)
    if as_json:
        report_json(found.to_dict())
        return
    terminal = console(sys.stdout)
    # Files and pipes have no width.
    if terminal is None:
        report(*str(found).split("\n"))
        return
    terminal.print(found.table())
    terminal.print(found.text_below(), markup=False, highlight=False)
