"""Reports on stdout; messages and progress bars on stderr.

Whatever is printed may hold names from files. What is a line here stays one, and `guarded` lets nothing but text, line
ends and tabs through, from wherever in the process it comes.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import click

from sheetsplat._escaping import escaped
from sheetsplat._json import plain

if TYPE_CHECKING:
    from rich.console import Console


class _Guard(io.TextIOBase):
    """Writes to a stream what is harmless for a terminal. To those who would style or overwrite text it is none."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """That of the stream."""
        return self.stream.encoding or "utf-8"

    @property
    def errors(self) -> str:  # type: ignore[override]
        """How letters that the encoding lacks are written."""
        return "backslashreplace"

    def write(self, text: str) -> int:
        """Write a text."""
        shown = escaped(text, kept="\n\t")
        self.stream.write(shown.encode(self.encoding, self.errors).decode(self.encoding))
        return len(text)

    def flush(self) -> None:
        """Flush the stream."""
        self.stream.flush()

    def fileno(self) -> int:
        """Return the number of the stream's file."""
        return self.stream.fileno()


@contextlib.contextmanager
def guarded() -> Iterator[None]:
    """Let nothing but text, line ends and tabs through to stdout and stderr."""
    guards = {name: _Guard(stream) for name in ("stdout", "stderr") if (stream := getattr(sys, name)) is not None}
    for name, guard in guards.items():
        setattr(sys, name, guard)
    try:
        yield
    finally:
        for name, guard in guards.items():
            # A stream that failed was replaced.
            if getattr(sys, name) is guard:
                setattr(sys, name, guard.stream)


def console(stream: TextIO | None) -> Console | None:
    """Return what writes styled, printable text to a stream past its guard, or None where it is no terminal."""
    open_stream = stream.stream if isinstance(stream, _Guard) else stream
    if open_stream is None or not open_stream.isatty():
        return None
    from rich.console import Console

    return Console(file=open_stream)


def report(*lines: str) -> None:
    """Print lines on stdout."""
    click.echo("\n".join(map(escaped, lines)))


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
        click.echo(escaped(text), err=True)
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
    terminal = None if quiet else console(sys.stderr)
    if terminal is None:
        yield None
        return
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

    from sheetsplat._time_left import time_left

    left = TextColumn("{task.fields[left]}")
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        left,
    )
    # While there is a bar, what others write goes by the console, above the bar.
    with Progress(*columns, console=terminal, transient=True) as bar, guarded():
        began = time.monotonic()
        task = bar.add_task(escaped(what), total=1.0, left="")

        def tell_share(share: float) -> None:
            bar.update(task, completed=share, left=time_left(time.monotonic() - began, share))

        yield tell_share
