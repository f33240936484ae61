"""sheetsplat plan."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from sheetsplat.cli.help import GroupedCommand
from sheetsplat.cli.options import as_json, check_mode, common, scene_options
from sheetsplat.cli.output import report, report_json
from sheetsplat.cli.scene import prepare


@click.command("plan", cls=GroupedCommand)
@click.argument("file", type=click.Path(path_type=Path))
@scene_options
@click.option("--measure", is_flag=True, help="Measure the time of each effect: draw with and without it.")
@click.option(
    "--repeats", type=click.IntRange(min=1), default=3, show_default=True, help="Number of timed pictures of each kind."
)
@as_json
@common
def command(file: Path, measure: bool, repeats: int, as_json: bool, quiet: bool, **options: Any) -> None:
    """Show the plan for rendering FILE: every effect, on or off, with the reason and the error that it adds.

    With --measure also the time that each effect adds to the picture; in brackets, the time that an effect which is off
    would add. That draws about a hundred pictures.

    "Reading a plan" in effects.md explains the effects, and which of them --effect can force.
    """
    check_mode(options)
    scene, camera, renderer, size = prepare(file, options)
    if measure:
        plan = renderer.measure_effects(scene, camera, size=size, repeats=repeats)
    else:
        plan = renderer.plan(scene, camera, size=size)
    if as_json:
        report_json(plan.to_dict())
    else:
        report(*str(plan).split("\n"))
