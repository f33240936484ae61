"""The result of a measurement of accuracy against time: a table, JSON and a plot."""

from __future__ import annotations

import io
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from itertools import groupby
from typing import TYPE_CHECKING, Any

from sheetsplat._checks import file_path, shown
from sheetsplat._json import plain
from sheetsplat.accuracy.knobs import BEST, GIVEN, INTERPOLATED, KNOBS, SLICES
from sheetsplat.errors import complain

if TYPE_CHECKING:
    from rich.table import Table

_WIDTH = 128
# Characters of a reason in the table.
_REASON = 160


class _Figures:
    """Equality of data classes by their numbers; such as are not known, NaN, are equal, in other processes too."""

    def __eq__(self, other: object) -> bool:
        """Return whether all fields are the same."""
        if type(other) is not type(self):
            return NotImplemented
        pairs = ((getattr(self, one.name), getattr(other, one.name)) for one in fields(self))  # type: ignore[arg-type]
        return all(one == two or (one != one and two != two) for one, two in pairs)

    def __hash__(self) -> int:
        """Return a hash of the class."""
        return hash(type(self))


@dataclass(frozen=True, eq=False)
class AccuracyRow(_Figures):
    """One setting of one knob, all else as in the scene.

    Attributes
    ----------
    knob, setting
        Its names.
    how
        What to write in Python to use it; empty for the unchanged scene.
    truth
        The picture from which the error was measured: "converged", "interpolated" (for knobs that change the field of
        a lattice), "best" (for qualities, which change it too) or "given".
    current
        The scene has this setting already.
    reason
        Why it was not measured, or an empty text.
    seconds, cpu_seconds
        Medians of the elapsed time and of the processor time of a frame; NaN where it was not measured.
    fastest, slowest
        Extremes of the elapsed times of the frames, seconds.
    rmse, p99_9, maximum
        Distance from the truth, of all causes together. Conventions, section 8.
    slicing_rmse
        Distance from the limit of fine slices with the row's own kind of gradients: conventions, section 8, and what
        ``image.error`` estimates. `rmse` counts what differences of pixels lose as well. NaN for lattices' knobs.
    arithmetic_rmse, arithmetic_p99_9
        Distance from the float64 reference at the same slices; NaN where it was not measured.
    arithmetic_size
        (width, height) at which that was measured.
    arithmetic_reason
        Why it was not, or an empty text.
    ripple_rms, ripple_maximum
        Of lattices: relative deviation of the sum of equal samples from a constant; NaN for other knobs.
    backend, precision
        What drew it.
    slices, kernels_drawn
        Of the picture.
    pareto
        No other row with the same truth is both faster and more accurate (Pareto-optimal).
    is_truth
        The errors of other rows are measured from this setting, drawn in float64: its own error is only that of the
        number format, and it is left out of the front and the plot.
    series
        The line of the plot to which it belongs: the settings of one series differ in one number.

    Examples
    --------
    >>> report = ss.accuracy(scene, camera, size=(32, 32), knobs="opacity_stop", repeats=1, reference_seconds=0)
    >>> row = report.of("opacity_stop")[0]
    >>> row.measured, row.rmse >= 0
    (True, True)
    """

    knob: str
    setting: str
    how: str = ""
    truth: str = "converged"
    current: bool = False
    reason: str = ""
    seconds: float = math.nan
    cpu_seconds: float = math.nan
    fastest: float = math.nan
    slowest: float = math.nan
    rmse: float = math.nan
    p99_9: float = math.nan
    maximum: float = math.nan
    slicing_rmse: float = math.nan
    arithmetic_rmse: float = math.nan
    arithmetic_p99_9: float = math.nan
    arithmetic_size: tuple[int, int] | None = None
    arithmetic_reason: str = ""
    ripple_rms: float = math.nan
    ripple_maximum: float = math.nan
    backend: str = ""
    precision: str = ""
    slices: int = 0
    kernels_drawn: int = 0
    pareto: bool = False
    is_truth: bool = False
    series: str = ""

    @property
    def measured(self) -> bool:
        """Whether it was measured."""
        return not self.reason

    def time(self, clock: str) -> float:
        """Return `seconds` or `cpu_seconds`, for "wall" and "cpu"."""
        return self.cpu_seconds if clock == "cpu" else self.seconds


def front(rows: Sequence[AccuracyRow], clock: str) -> tuple[AccuracyRow, ...]:
    """Return the rows with `pareto` set: for each truth, those that no other row beats in both time and error."""
    best: dict[str, list[tuple[float, float]]] = {}
    for row in rows:
        if row.measured and not row.is_truth:
            best.setdefault(row.truth, []).append((row.time(clock), row.rmse))

    def beaten(row: AccuracyRow) -> bool:
        mine = (row.time(clock), row.rmse)
        return any(
            seconds <= mine[0] and error <= mine[1] and (seconds, error) != mine for seconds, error in best[row.truth]
        )

    return tuple(replace(row, pareto=row.measured and not row.is_truth and not beaten(row)) for row in rows)


@dataclass(frozen=True, eq=False)
class TruthText(_Figures):
    """How a picture was made from which errors are measured.

    Attributes
    ----------
    name
        As in the rows' `truth`.
    text
        Description.
    uncertainty
        Estimated root mean square distance from the limit that it stands for; smaller errors are not significant.
    order
        Order of convergence that was found in the distance of slices; NaN where it was not determined.
    """

    name: str
    text: str
    uncertainty: float
    order: float


@dataclass(frozen=True, eq=False)
class AccuracyReport(_Figures):
    """Error and time of each setting, for one scene and camera. ``print(report)`` prints a table.

    Attributes
    ----------
    size
        (width, height) in pixels.
    backend, precision, device
        What drew the scene unless a row says otherwise.
    slice_spacing
        Δs of the scene, world units.
    repeats
        Number of timed frames for each row; more for the unchanged scene.
    clock
        "wall" or "cpu": the times of the front and the plot.
    rows
        All settings by knob; those that could not be measured have a reason.
    truths
        The pictures from which errors were measured.
    notes
        Conclusions from the rows.
    environment
        Versions and machine.

    Examples
    --------
    >>> report = ss.accuracy(scene, camera, size=(32, 32), knobs="slice_spacing", repeats=1, reference_seconds=0)
    >>> report.current.knob, len(report.pareto) > 0
    ('slice_spacing', True)
    """

    size: tuple[int, int]
    backend: str
    precision: str
    device: str
    slice_spacing: float
    repeats: int
    clock: str
    rows: tuple[AccuracyRow, ...]
    truths: tuple[TruthText, ...]
    notes: tuple[str, ...] = ()
    environment: Mapping[str, str] = field(default_factory=dict)

    @property
    def current(self) -> AccuracyRow | None:
        """The unchanged scene, measured from the converged picture; None where only lattices were measured."""
        there = [row for row in self.rows if row.current and row.measured]
        same = (row for row in there if row.truth not in (INTERPOLATED, BEST))
        return next(same, there[0] if there else None)

    @property
    def pareto(self) -> tuple[AccuracyRow, ...]:
        """Pareto-optimal rows of the same field in time and error, the fastest first; each picture once."""
        found: dict[tuple[float, float], AccuracyRow] = {}
        for row in self.rows:
            if row.pareto and row.truth not in (INTERPOLATED, BEST):
                found.setdefault((row.time(self.clock), row.rmse), row)
        return tuple(sorted(found.values(), key=lambda row: row.time(self.clock)))

    def of(self, knob: str) -> tuple[AccuracyRow, ...]:
        """Return the rows of one knob. InvalidInput for an unknown name."""
        if knob not in KNOBS:
            raise complain("there is no such knob", shown(knob), f"one of: {', '.join(KNOBS)}")
        return tuple(row for row in self.rows if row.knob == knob)

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as dicts, lists, numbers and strings, for JSON; NaN and infinity become None."""
        pareto = [asdict(row) for row in self.pareto]
        current = None if self.current is None else asdict(self.current)
        report: dict[str, Any] = plain({**asdict(self), "pareto": pareto, "current": current})
        return report

    def to_json(self) -> str:
        """Return the report as JSON; numbers that are not finite become null."""
        return json.dumps(self.to_dict(), indent=2, ensure_ascii=False, allow_nan=False)

    def plot(self, path: str | os.PathLike[str]) -> None:
        """Save a plot of error over time.

        Parameters
        ----------
        path
            Ends with .png, .svg or .pdf.

        Raises
        ------
        Unsupported
            Where matplotlib is not installed; it comes with ``pip install "sheetsplat[plot]"``.
        InvalidInput
            For other suffixes, and where nothing was measured.
        Error
            Where the file cannot be written.
        """
        from sheetsplat.accuracy.plot import draw

        draw(self, file_path("the plot cannot be saved", path, "a path that ends with .png, .svg or .pdf"))

    def table(self) -> Table:
        """Return the report as a table of the package rich."""
        from rich.table import Table
        from rich.text import Text

        heading = (
            f"accuracy against time: {self.size[0]} x {self.size[1]} pixels, {self.backend} {self.precision}, "
            f"Δs {self.slice_spacing:g}, medians of {self.repeats}"
        )
        table = Table(title=heading, title_justify="left", title_style="bold", header_style="bold", pad_edge=False)
        table.add_column("knob", no_wrap=True)
        table.add_column("setting", no_wrap=True, overflow="fold")
        for name in ("ms", "cpu ms", "error, RMSE", "slicing", "arithmetic"):
            table.add_column(name, justify="right", no_wrap=True)
        table.add_column("", overflow="fold")
        for knob, rows in groupby(self.rows, key=lambda row: row.knob):
            for number, row in enumerate(rows):
                times = map(_milliseconds, (row.seconds, row.cpu_seconds))
                errors = map(_error, (row.rmse, row.slicing_rmse, row.arithmetic_rmse))
                figures = [*times, *errors] if row.measured else ["–"] * 5
                style = "dim" if not row.measured else "bold" if row.current else None
                table.add_row(knob if number == 0 else "", row.setting, *figures, Text(self._remarks(row)), style=style)
            table.add_section()
        return table

    def _remarks(self, row: AccuracyRow) -> str:
        if not row.measured:
            # A missing device lists every attempt; the row and the JSON have the whole text.
            return row.reason if len(row.reason) <= _REASON else row.reason[: _REASON - 2] + " …"
        is_small = any(truth.name == row.truth and row.rmse < truth.uncertainty for truth in self.truths)
        remarks = {
            "now": row.current,
            "front": row.pareto,
            "reference field": row.is_truth,
            f"ripple {100 * row.ripple_maximum:.2g} %": not math.isnan(row.ripple_maximum),
            "below the uncertainty": is_small,
        }
        return ", ".join(text for text, holds in remarks.items() if holds)

    def text_below(self) -> str:
        """Return the sentences below the table."""
        names = {
            "converged": "error",
            SLICES: "slicing of pictures with gradients by differences",
            INTERPOLATED: "error of lattice, kernel and prefilter",
            BEST: "error of quality",
            GIVEN: "error",
        }
        lines = [
            f"{names.get(one.name, one.name)}: distance from {one.text}"
            + (f" (itself uncertain by {_error(one.uncertainty)})" if math.isfinite(one.uncertainty) else "")
            for one in self.truths
        ]
        lines.append("now: the unchanged scene; front: no other row is both faster and more accurate")
        sizes = sorted({row.arithmetic_size for row in self.rows if row.arithmetic_size is not None})
        if sizes:
            texts = ", ".join(f"{width} x {height}" for width, height in sizes)
            lines.append(f"arithmetic: RMSE from the float64 reference at the same slices, at {texts} pixels")
        reasons = sorted({row.arithmetic_reason for row in self.rows if row.arithmetic_reason})
        if reasons:
            lines.append(f"arithmetic –: {'; '.join(reasons)}")
        return "\n".join([*lines, *self.notes])

    def __str__(self) -> str:
        """Return the table and the sentences below it."""
        from rich.console import Console

        console = Console(file=io.StringIO(), width=_WIDTH, color_system=None, force_terminal=False)
        console.print(self.table())
        console.print(self.text_below(), markup=False, highlight=False)
        text: str = console.file.getvalue()  # type: ignore[attr-defined]
        return text.rstrip()

    def __repr__(self) -> str:
        """Return a short description."""
        measured = sum(row.measured for row in self.rows)
        return f"AccuracyReport({measured} of {len(self.rows)} rows measured, {self.backend}, {self.size})"


def _milliseconds(seconds: float) -> str:
    value = 1e3 * seconds
    return f"{value:.2f}" if value < 10 else f"{value:.1f}" if value < 100 else f"{value:.0f}"


def _error(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.1e}"
