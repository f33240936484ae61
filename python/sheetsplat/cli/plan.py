"""sheetsplat plan."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from sheetsplat.cli.options import as_json, check_mode, common, prepare, scene_options
from sheetsplat.cli.output import report_json


@click.command("plan")
@click.argument("file", type=click.Path(path_type=Path))
@scene_options
@as_json
@common
def command(file: Path, as_json: bool, quiet: bool, **options: Any) -> None:
    """Show what rendering FILE with these options calls for, effect by effect, with the reason.

    Effects that --effect can force, and what each means: usage, "Words of the plan".
    """
    check_mode(options)
    scene, camera, renderer, size = prepare(file, options)
    plan = renderer.plan(scene, camera, size=size)
    if as_json:
        report_json(plan.to_dict())
    else:
        click.echo(str(plan))
