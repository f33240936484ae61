"""sheetsplat bench."""

from __future__ import annotations

import sys
import textwrap
from pathlib import Path
from typing import Any

import click

from sheetsplat.cli.options import Numbers, Real, as_json, common
from sheetsplat.cli.output import report_json, say
from sheetsplat.renderer import BACKENDS


def _hanging(width: int) -> dict[str, Any]:
    return {"initial_indent": " " * width, "subsequent_indent": " " * (width + 6), "break_long_words": False}


@click.command("bench")
@click.argument("name", required=False)
@click.option("--list", "list_names", is_flag=True, help="List the benchmarks and their rows.")
@click.option(
    "--size", type=Numbers("WxH", 2, whole=True, square=True), default="400x400", show_default=True, help="Pixels."
)
@click.option(
    "--views", type=click.IntRange(min=1), default=5, show_default=True, help="Views that are timed; the median counts."
)
@click.option("--backend", type=click.Choice(BACKENDS), default="auto", show_default=True)
@click.option("--data", type=click.Path(path_type=Path), help="Folder of the measured volumes.")
@click.option("--row", "rows", multiple=True, help="Run this row only, one that --list shows; may be repeated.")
@click.option("--scale", type=Real(above=0.0), default=1.0, show_default=True, help="Edge of generated volumes.")
@click.option(
    "--pictures", type=click.Path(file_okay=False, path_type=Path), help="Folder for the pictures, if wanted."
)
@click.option("--check", is_flag=True, help="Exit code 1 where a figure to be reached was missed.")
@as_json
@common
def command(
    name: str | None,
    list_names: bool,
    size: tuple[int, int],
    views: int,
    backend: str,
    data: Path | None,
    rows: tuple[str, ...],
    scale: float,
    pictures: Path | None,
    check: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Run the benchmark NAME and print its table."""
    from sheetsplat.bench import BENCHES, Options

    if list_names:
        if as_json:
            report_json({name: {"summary": bench.summary, "rows": list(bench.rows)} for name, bench in BENCHES.items()})
            return
        width = max(map(len, BENCHES))
        for known, bench in BENCHES.items():
            click.echo(f"{known:<{width}}  {bench.summary}")
            if bench.rows:
                click.echo(textwrap.fill("rows: " + ", ".join(bench.rows), 100, **_hanging(width + 2)))
        return
    if name is None:
        raise click.UsageError("give the NAME of a benchmark, or --list")
    if name not in BENCHES:
        raise click.BadParameter(f"{name!r}: wanted one of: {', '.join(BENCHES)}", param_hint="NAME")
    known_rows = BENCHES[name].rows
    strange = [row for row in rows if row not in known_rows]
    if strange:
        wanted = f"wanted one of: {', '.join(known_rows)}" if known_rows else f"{name} has no rows to choose from"
        raise click.BadParameter(f"{', '.join(map(repr, strange))}: {wanted}", param_hint="--row")
    options = Options(
        size=size,
        views=views,
        backend=backend,
        data=data,
        rows=rows,
        scale=scale,
        pictures=pictures,
        tell=lambda text: say(text, quiet=quiet),
    )
    report = BENCHES[name].run(options)
    click.echo(report.to_json() if as_json else report.table())
    if check and not report.reached:
        say(f"{name}: a figure to be reached was missed", quiet=quiet)
        sys.exit(1)
