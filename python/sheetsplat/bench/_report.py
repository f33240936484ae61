"""What a benchmark is asked for, and what it answers."""

from __future__ import annotations

import json
import math
import os
import platform
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sheetsplat.errors import complain

if TYPE_CHECKING:
    from sheetsplat import Image

Row = dict[str, Any]


@dataclass(frozen=True)
class Options:
    """How a benchmark is run.

    Attributes
    ----------
    size
        (width, height) of the timed pictures in pixels.
    views
        Views of an orbit that are timed; the median counts.
    backend
        That which is measured.
    data
        Folder of the measured volumes; that of the environment variable ``SHEETSPLAT_DATA``, else ``../shared/data``,
        unless given.
    reference_seconds
        How long one picture of the reference may take, about; errors are measured at the largest size that it allows.
    rows
        Rows to run, by name; all unless given.
    pictures
        Folder for the pictures of the rows that are drawn (table2005, ablation).
    scale
        Edge of the generated volumes as a share of the usual one, for a quick look; files are always taken whole.
    tell
        Told what is done next.
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
        """Tell what is done next, where somebody listens."""
        if self.tell is not None:
            self.tell(text)

    def keep(self, picture: Image, *names: str) -> None:
        """Save a picture under a name of several parts, where pictures are wanted."""
        if self.pictures is not None:
            self.pictures.mkdir(parents=True, exist_ok=True)
            name = "-".join("".join(c if c.isalnum() else "_" for c in part) for part in names)
            picture.save(self.pictures / f"{name}.png")

    def wants(self, row: str) -> bool:
        """Return whether a row is to be run."""
        return not self.rows or row in self.rows

    def edge(self, usual: int, least: int = 16) -> int:
        """Return the edge of a generated volume whose usual edge is given."""
        return max(least, round(usual * self.scale))


@dataclass(frozen=True)
class Goal:
    """A figure that is to be reached.

    Attributes
    ----------
    name
        What was measured.
    value
        The figure.
    bound
        The largest that is wanted, or the smallest.
    unit
        Of both.
    least
        The bound is the smallest figure that is wanted.
    """

    name: str
    value: float
    bound: float
    unit: str = ""
    least: bool = False

    @property
    def reached(self) -> bool:
        """Whether the figure keeps to the bound; one that is not a number does not."""
        return self.value >= self.bound if self.least else self.value <= self.bound


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
        One a line; a name that is missing shows as empty.
    notes
        Sentences below the table.
    goals
        Figures to be reached.
    environment
        Where it ran.
    """

    name: str
    title: str
    columns: Mapping[str, str]
    rows: list[Row]
    notes: list[str] = field(default_factory=list)
    goals: list[Goal] = field(default_factory=list)
    environment: dict[str, str] = field(default_factory=dict)

    @property
    def reached(self) -> bool:
        """Whether all goals are reached."""
        return all(goal.reached for goal in self.goals)

    def table(self) -> str:
        """Return the report as plain text."""
        names = [name for name in self.columns if any(row.get(name) is not None for row in self.rows)]
        cells = [[self.columns[name] for name in names]]
        cells += [[_text(row.get(name)) for name in names] for row in self.rows]
        numeric = [all(_is_number(row.get(name)) for row in self.rows) for name in names]
        widths = [max(len(line[c]) for line in cells) for c in range(len(names))]
        lines = [self.title, ""]
        for number, line in enumerate(cells):
            padded = [
                text.rjust(width) if right else text.ljust(width)
                for text, width, right in zip(line, widths, numeric, strict=True)
            ]
            lines.append("  ".join(padded).rstrip())
            if number == 0:
                lines.append("  ".join("-" * width for width in widths))
        if self.goals:
            lines.append("")
            for goal in self.goals:
                mark = "reached" if goal.reached else "MISSED"
                side = "at least" if goal.least else "at most"
                lines.append(
                    f"{mark}: {goal.name} {_text(goal.value)}, {side} {_text(goal.bound)} {goal.unit}".rstrip()
                )
        if self.notes:
            lines += ["", *self.notes]
        if self.environment:
            lines += ["", *(f"{name}: {value}" for name, value in self.environment.items())]
        return "\n".join(lines)

    def to_json(self) -> str:
        """Return the report as JSON; numbers that are not finite become texts."""
        content = {
            "name": self.name,
            "title": self.title,
            "columns": dict(self.columns),
            "rows": [{name: _plain(value) for name, value in row.items()} for row in self.rows],
            "goals": [
                {
                    "name": goal.name,
                    "value": _plain(goal.value),
                    "bound": goal.bound,
                    "unit": goal.unit,
                    "least": goal.least,
                    "reached": goal.reached,
                }
                for goal in self.goals
            ],
            "notes": self.notes,
            "environment": self.environment,
        }
        return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)


def environment(device: str = "") -> dict[str, str]:
    """Return what a reader must know of the machine."""
    import numpy as np

    import sheetsplat

    found = {
        "sheetsplat": sheetsplat.__version__,
        "machine": f"{platform.machine()}, {os.cpu_count()} processors, {platform.system()}",
        "python": f"{sys.version_info.major}.{sys.version_info.minor}, NumPy {np.__version__}",
    }
    if device:
        found["device"] = device
    return found


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
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    if hasattr(value, "item"):
        return _plain(value.item())
    return str(value)
