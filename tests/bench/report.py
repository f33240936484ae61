"""What a benchmark is asked for, and what it answers."""

from __future__ import annotations

import io
import json
import math
import os
import platform
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

import sheetsplat as ss
from sheetsplat.errors import complain

Row = dict[str, Any]

# Headings of the figures that many benchmarks report; any other name is its own heading.
_HEADINGS = {
    "kernels_drawn": "drawn",
    "wall_ms": "ms",
    "cpu_ms": "cpu ms",
    "p99_9": "p99.9",
    "maximum": "max",
    "error_size": "error at",
}


@dataclass(frozen=True)
class Options:
    """How a benchmark is run.

    Attributes
    ----------
    size
        (width, height) of the timed pictures in pixels.
    views
        Number of timed views of an orbit; the median counts.
    backend
        Backend that is measured.
    data
        Folder of the measured volumes; default: environment variable ``SHEETSPLAT_DATA``, else ``../shared/data``.
    reference_seconds
        Approximate time allowed for one reference picture, s; errors are measured at the largest size that fits.
    rows
        Names of the rows to run; empty: all.
    pictures
        Folder in which rows save their pictures.
    scale
        Edge of the generated volumes as a share of the usual one, for a quick run; files are always taken whole.
    tell
        Called with a description of each step before it begins.
    """

    size: tuple[int, int] = (400, 400)
    views: int = 5
    backend: str = "auto"
    data: Path | None = None
    reference_seconds: float = 10.0
    rows: tuple[str, ...] = ()
    pictures: Path | None = None
    scale: float = 1.0
    tell: Callable[[str], object] | None = None

    def __post_init__(self) -> None:
        """Check the numbers."""
        failed = "the benchmark cannot be run"
        if len(self.size) != 2 or min(self.size) < 1:
            raise complain(failed, f"size {self.size}", "two numbers of pixels, each at least 1")
        if self.views < 1:
            raise complain(failed, f"{self.views} views", "at least 1")
        if not 0.0 < self.scale <= 1.0:
            raise complain(failed, f"scale {self.scale}", "a number above 0, at most 1")

    def say(self, text: str) -> None:
        """Report the next step."""
        if self.tell is not None:
            self.tell(text)

    def wants(self, row: str) -> bool:
        """Return whether a row is to be run."""
        return not self.rows or row in self.rows

    def edge(self, usual: int, least: int = 16) -> int:
        """Return the edge of a generated volume whose usual edge is given."""
        return max(least, round(usual * self.scale))

    def count(self, usual: int, least: int = 64) -> int:
        """Return how many of `usual` kernels in a cube of edge 128 make the smaller cube as dense."""
        return max(least, round(usual * (self.edge(128) / 128) ** 3))

    def smaller(self, divisor: int) -> tuple[int, int]:
        """Return the size of the timed pictures divided by a whole number."""
        return max(1, self.size[0] // divisor), max(1, self.size[1] // divisor)

    def on(self, backend: str) -> Options:
        """Return options that measure a backend."""
        return replace(self, backend=backend)

    def preferring(self, backend: str) -> Options:
        """Return options that measure a backend where none was named."""
        return self.on(backend) if self.backend == "auto" else self

    @property
    def views_note(self) -> str:
        """How times are measured, for the notes of a report."""
        return (
            f"Times are medians over {self.views} views, each drawn once after a frame that is not counted. ms: "
            "elapsed time; cpu ms: all threads of the process, which other load on the machine hardly changes."
        )

    @property
    def error_note(self) -> str:
        """How errors are measured, for the notes of a report."""
        return (
            "Errors are those of the first view against the float64 reference, at the largest size whose reference "
            f"takes about {self.reference_seconds:g} s; pixels at jumps (isosurfaces, A_stop) are included."
        )


@dataclass(frozen=True)
class Goal:
    """A figure with its bound: the largest value that reaches the goal, or the smallest where `least` is set."""

    name: str
    value: float
    bound: float
    unit: str = ""
    least: bool = False

    @property
    def reached(self) -> bool:
        """Whether the value keeps the bound; NaN does not."""
        return self.value >= self.bound if self.least else self.value <= self.bound

    def __str__(self) -> str:
        """Return the goal in words."""
        mark, side = "reached" if self.reached else "MISSED", "at least" if self.least else "at most"
        return f"{mark}: {self.name} {_text(self.value)}, {side} {_text(self.bound)} {self.unit}".rstrip()


def columns(text: str) -> dict[str, str]:
    """Return names of figures with their headings from "name, name=heading, ..."."""
    pairs = (one.strip().partition("=") for one in text.split(","))
    return {name: heading or _HEADINGS.get(name, name) for name, _, heading in pairs}


@dataclass(frozen=True)
class Report:
    """Rows of figures with what is needed to read them.

    Attributes
    ----------
    name, title
        Of the benchmark.
    columns
        Names in the rows, in the order of the table, with their headings.
    rows
        One a line; a name that is missing is an empty cell.
    notes
        Sentences below the table.
    goals
        Figures with their bounds.
    environment
        Machine and versions.
    """

    name: str
    title: str
    columns: Mapping[str, str]
    rows: list[Row]
    notes: list[str] = field(default_factory=list)
    goals: list[Goal] = field(default_factory=list)
    environment: dict[str, str] = field(default_factory=lambda: environment())

    @property
    def reached(self) -> bool:
        """Whether all goals are reached."""
        return all(goal.reached for goal in self.goals)

    def table(self) -> str:
        """Return the report as plain text."""
        parts = [self.title, self._cells(box.SIMPLE_HEAD), *map(str, self.goals), *self.notes]
        return "\n".join([*parts, *(f"{name}: {value}" for name, value in self.environment.items())])

    def markdown(self) -> str:
        """Return the report as Markdown."""
        facts = "; ".join(f"{name}: {value}" for name, value in self.environment.items())
        lists = ["\n".join(f"- {one}" for one in part) for part in (self.goals, self.notes) if part]
        return "\n\n".join([f"## {self.title}", self._cells(box.MARKDOWN).strip("\n"), *lists, facts])

    def _cells(self, form: box.Box) -> str:
        """Return the table alone; columns without a figure are left out."""
        table = Table(box=form)
        names = [name for name in self.columns if any(row.get(name) is not None for row in self.rows)]
        for name in names:
            numeric = all(_is_number(row.get(name)) for row in self.rows)
            table.add_column(self.columns[name], justify="right" if numeric else "left", no_wrap=True)
        for row in self.rows:
            table.add_row(*(_text(row.get(name)) for name in names))
        out = io.StringIO()
        Console(file=out, width=10_000, markup=False, emoji=False, highlight=False, color_system=None).print(table)
        return "\n".join(line.rstrip() for line in out.getvalue().splitlines())

    def to_json(self) -> str:
        """Return the report as JSON; numbers that are not finite become texts."""
        content = asdict(self)
        for goal, written in zip(self.goals, content["goals"], strict=True):
            written["reached"] = goal.reached
        return json.dumps(_plain(content), indent=2, ensure_ascii=False, allow_nan=False)


def environment(device: str = "") -> dict[str, str]:
    """Return machine, versions, load and device."""
    found = {
        "sheetsplat": ss.__version__,
        "machine": f"{platform.machine()}, {os.cpu_count()} processors, {platform.system()}",
        "python": f"{sys.version_info.major}.{sys.version_info.minor}, NumPy {np.__version__}",
        "load": f"{load():.1f}",
    }
    if device:
        found["device"] = device
    return found


def load() -> float:
    """Return the mean number of running processes over the last minute; NaN where the system does not tell."""
    try:
        return os.getloadavg()[0]
    except OSError:
        return math.nan


def _is_number(value: object) -> bool:
    return value is None or (isinstance(value, int | float) and not isinstance(value, bool))


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, float):
        if value == 0.0 or not math.isfinite(value):
            return f"{value:g}"
        return f"{value:.1e}" if abs(value) < 1e-3 else f"{value:.3g}" if abs(value) < 1000.0 else f"{value:,.0f}"
    return str(value)


def _plain(value: object) -> object:
    """Return a value as JSON knows it."""
    if isinstance(value, Mapping):
        return {str(name): _plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if value is None or isinstance(value, bool | int | str):
        return value
    return value if isinstance(value, float) and math.isfinite(value) else str(value)
