"""Reports on stdout; messages and progress bars on stderr."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import click

from sheetsplat._json import plain


def report_json(value: Any) -> None:
    """Print a value as JSON on stdout; numbers that are not finite become null."""
    click.echo(json.dumps(plain(value), indent=2, allow_nan=False))


def check_outputs(outputs: Sequence[Path], inputs: Sequence[Path]) -> None:
    """Refuse an output that is named twice or is also an input: it would be overwritten."""
    taken = {path.resolve(): path for path in inputs}
    for path in outputs:
        if path.resolve() in taken:
            raise click.UsageError(f"{path}: an output that is named twice or is also an input")
        taken[path.resolve()] = path


def say(text: str, *, quiet: bool) -> None:
    """Print a line on stderr unless `quiet`."""
    if not quiet:
        click.echo(text, err=True)


@contextlib.contextmanager
def progress_bar(what: str, *, quiet: bool) -> Iterator[Callable[[float], object] | None]:
    """Yield a progress callback that draws a bar on stderr, or None where stderr is no terminal."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda share: bar.update(task, completed=share)
