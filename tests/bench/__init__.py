"""Benchmarks: how long pictures take and how far they are from the reference.

Each module named in ``BENCHES`` has a function ``run(options)`` that returns a report, and may have ``ROWS``, the names
of the rows that can be run alone. The first line of its docstring is its summary. Command line: :mod:`bench.__main__`.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from types import ModuleType

from bench.report import Goal, Options, Report

__all__ = ["BENCHES", "Bench", "Goal", "Options", "Report"]


@dataclass(frozen=True)
class Bench:
    """A benchmark, whose module is imported when it is used."""

    name: str

    @property
    def module(self) -> ModuleType:
        """The module of this name."""
        return importlib.import_module(f"{__name__}.{self.name}")

    @property
    def summary(self) -> str:
        """What it measures, in one line."""
        return (self.module.__doc__ or "").splitlines()[0].rstrip(".")

    @property
    def rows(self) -> tuple[str, ...]:
        """Names of the rows that can be run alone; empty where the benchmark runs as a whole."""
        names: tuple[str, ...] = getattr(self.module, "ROWS", ())
        return names

    def run(self, options: Options | None = None) -> Report:
        """Run it."""
        report = self.module.run(options or Options())
        assert isinstance(report, Report)
        return report


#: Every benchmark by its name.
BENCHES: dict[str, Bench] = {
    name: Bench(name)
    for name in (
        "table2005",
        "table2006",
        "ablation",
        "frame",
        "ellipsoids",
        "cpu",
        "prefilter",
        "encode",
        "quality",
        "ripple",
        "claims",
        "first_sight",
        "startup",
        "memory",
        "scaling",
        "scattered_scaling",
        "error_estimate",
        "max_error",
        "huge",
        "cliffs",
        "interactive",
        "distributed",
        "gpu",
    )
}
