"""Reports on stdout; messages and progress bars on stderr."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import time
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


def tell(text: str) -> None:
    """Print a line on stderr. Where stderr cannot be written, lines are lost and the work goes on."""
    try:
        click.echo(text, err=True)
    except OSError:
        # What is left in the buffer must not fail again when Python ends.
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115


def say(text: str, *, quiet: bool) -> None:
    """Print a line on stderr unless `quiet`."""
    if not quiet:
        tell(text)


@contextlib.contextmanager
def progress_bar(what: str, *, quiet: bool) -> Iterator[Callable[[float], object] | None]:
    """Yield a progress callback that draws a bar on stderr, with the time left, or None where stderr is no terminal."""
    if quiet or sys.stderr is None or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

    from sheetsplat._time_left import time_left

    left = TextColumn("{task.fields[left]}")
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn(), left)
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        began = time.monotonic()
        task = bar.add_task(what, total=1.0, left="")

        def tell_share(share: float) -> None:
            bar.update(task, completed=share, left=time_left(time.monotonic() - began, share))

        yield tell_share
