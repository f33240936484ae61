"""sheetsplat plan."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from sheetsplat.cli.options import as_json, check_mode, common, scene_options
from sheetsplat.cli.output import report_json
from sheetsplat.cli.scene import prepare


@click.command("plan")
@click.argument("file", type=click.Path(path_type=Path))
@scene_options
@click.option("--measure", is_flag=True, help="Draw the picture with and without each effect: what each costs in ms.")
@click.option(
    "--repeats", type=click.IntRange(min=1), default=3, show_default=True, help="Timed pictures of each kind."
)
@as_json
@common
def command(file: Path, measure: bool, repeats: int, as_json: bool, quiet: bool, **options: Any) -> None:
    """Show what rendering FILE with these options calls for, effect by effect, with the reason and the error it adds.

    With --measure also what each effect costs: of one that is on, what the picture takes longer with it; in brackets,
    what one that is off would cost. That takes some hundred pictures.

    Effects that --effect can force, and what each means: usage, "Words of the plan".
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
        click.echo(str(plan))
