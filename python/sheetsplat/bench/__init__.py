"""Benchmarks: what pictures cost and how far they are from the reference.

``BENCHES`` names them; each is run with :class:`Options` and answers with a :class:`Report`::

    from sheetsplat.bench import BENCHES, Options
    report = BENCHES["frame"].run(Options(views=3))
    print(report.table())
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass

from sheetsplat.bench._report import Goal, Options, Report

__all__ = ["BENCHES", "Bench", "Goal", "Options", "Report"]


@dataclass(frozen=True)
class Bench:
    """A benchmark.

    Attributes
    ----------
    name
        Short name.
    summary
        What it measures, in one line.
    module
        Where it lives; read when it is run.
    """

    name: str
    summary: str
    module: str

    @property
    def rows(self) -> tuple[str, ...]:
        """Names of the rows that can be run alone; none where it is all or nothing."""
        names: tuple[str, ...] = getattr(importlib.import_module(self.module), "ROWS", ())
        return names

    def run(self, options: Options | None = None) -> Report:
        """Run it."""
        report = importlib.import_module(self.module).run(options or Options())
        assert isinstance(report, Report)
        return report


_ALL = (
    Bench(
        "table2005", "the fifteen rows of the 2005 paper's Table 1, with the paper's figures", f"{__name__}.table2005"
    ),
    Bench("table2006", "the six rows of the 2006 paper's Table 1: scattered kernels", f"{__name__}.table2006"),
    Bench("ablation", "what each technique is worth: time and error with it and without it", f"{__name__}.ablation"),
    Bench("frame", "a shaded frame of 480,000 kernels against a bare fill test", f"{__name__}.frame"),
    Bench(
        "ellipsoids",
        "35,000 ellipsoids that overlap 23 times, against bare fills; point against slab sampling",
        f"{__name__}.ellipsoids",
    ),
    Bench(
        "cpu",
        "the processor's backend beside VTK on six scenes; what its work costs and how it grows",
        f"{__name__}.cpu",
    ),
    Bench(
        "prefilter",
        "Marschner-Lobb against its formula: kernels, trilinear, prefilter; decibels and time",
        f"{__name__}.prefilter",
    ),
    Bench("ripple", "ripple of sums on lattices, its cures, and lit close-ups", f"{__name__}.prefilter_ripple"),
    Bench("claims", "the papers' claims on quality, with figures and pictures", f"{__name__}.claims"),
    Bench("import", "import time and first frame, in new processes", f"{__name__}.startup"),
    Bench("memory", "memory of the process for a 256^3 volume, in a new process", f"{__name__}.memory"),
    Bench("scaling", "how time grows with kernels and with pixels", f"{__name__}.scaling"),
    Bench(
        "scattered_scaling",
        "how time and memory grow with scattered kernels, up to ten million",
        f"{__name__}.scattered_scaling",
    ),
)

#: Every benchmark by its name.
BENCHES: dict[str, Bench] = {bench.name: bench for bench in _ALL}
