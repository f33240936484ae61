"""The picture of a measurement: error over time, both logarithmic."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sheetsplat._matplotlib import module_of, require_matplotlib
from sheetsplat.accuracy.knobs import INTERPOLATED, KNOBS
from sheetsplat.errors import complain
from sheetsplat.io.pictures import check_folder, whole_file

if TYPE_CHECKING:
    from sheetsplat.accuracy.report import AccuracyReport, AccuracyRow

SUFFIXES = (".png", ".svg", ".pdf")
# Colours that most colour-blind readers can tell apart (after Okabe and Ito), with one marker each.
_STYLES = {
    "quality": ("#B22222", "p"),
    "slice_spacing": ("#0072B2", "o"),
    "classification": ("#D55E00", "s"),
    "gradient": ("#009E73", "^"),
    "cut_off": ("#CC79A7", "v"),
    "precision": ("#7A5FB5", "D"),
    "table_size": ("#8C6D31", "P"),
    "opacity_stop": ("#56B4E9", "X"),
    "filter": ("#333333", "*"),
    "image_scale": ("#E69F00", "h"),
    "lattice": ("#0072B2", "o"),
    "kernel": ("#D55E00", "s"),
    "prefilter": ("#009E73", "^"),
}
_INK, _FAINT = "#222222", "#8a8a8a"
_FRONT = "#f2c14e"
# Half a grey level of 8 bits: smaller errors are invisible on most screens.
_UNSEEN = 0.5 / 255
# Rank of the points that are labelled last.
_LEAST = 3
# Offsets of labels from their points, in points, in the order in which they are tried.
_PLACES = (
    *((7, 6, "left", "bottom"), (-7, 6, "right", "bottom"), (7, -6, "left", "top"), (-7, -6, "right", "top")),
    *((12, 16, "left", "bottom"), (-12, 16, "right", "bottom"), (12, -16, "left", "top"), (-12, -16, "right", "top")),
    *((14, 30, "left", "bottom"), (-14, 30, "right", "bottom"), (14, -30, "left", "top"), (-14, -30, "right", "top")),
)


def check_path(path: Path) -> None:
    """Raise InvalidInput for a suffix that no plot has, and Error where the folder is missing."""
    if path.suffix.lower() not in SUFFIXES:
        raise complain("the plot cannot be saved", str(path), f"a path that ends with {', '.join(SUFFIXES)}")
    check_folder(path)


def draw(report: AccuracyReport, path: Path) -> None:
    """Draw a report and save it; the file appears whole or not at all."""
    check_path(path)
    require_matplotlib("take the table or the JSON alone")
    rows = [row for row in report.rows if row.measured and not row.is_truth]
    panels = [
        (title, there)
        for title, lattices in (
            ("RMSE from the converged picture", False),
            ("lattices: RMSE from the field through the samples", True),
        )
        if (there := [row for row in rows if (row.truth == INTERPOLATED) == lattices])
    ]
    if not panels:
        raise complain("the plot cannot be drawn", "no row that was measured", "at least one")
    # Not pyplot, which would change the global state of a program with windows of its own.
    figure = module_of("figure").Figure(figsize=(9.4 + 4.4 * (len(panels) - 1), 6.8), dpi=100, facecolor="white")
    canvas: Any = module_of("backends.backend_agg").FigureCanvasAgg(figure)
    left = 0.08 if len(panels) == 1 else 0.06
    figure.subplots_adjust(left=left, right=0.985, top=0.85, bottom=0.2, wspace=0.14)
    all_axes = figure.subplots(1, len(panels), squeeze=False, width_ratios=(8.8, 4.4)[: len(panels)])[0]
    for number, (axes, (title, there)) in enumerate(zip(all_axes, panels, strict=True)):
        _panel(axes, canvas, there, report, title, first=number == 0)
    figure.text(left, 0.955, "What accuracy costs", size=16, weight="bold", color=_INK, va="center")
    width, height = report.size
    figure.text(
        left,
        0.912,
        f"{width} × {height} pixels, {report.backend} {report.precision}, Δs = {report.slice_spacing:.4g}; each knob "
        "varied alone, all else as in the scene",
        size=10,
        color=_FAINT,
        va="center",
    )
    kind = path.suffix.lower().removeprefix(".")
    with whole_file(path) as made:
        if kind != "png":
            figure.savefig(made, format=kind)
            return
        from PIL import Image

        canvas.draw()
        # A palette takes a quarter of the bytes.
        seen = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
        seen.quantize(256, dither=Image.Dither.NONE).save(made, format="PNG", optimize=True)


class _Point(NamedTuple):
    """A row, and where it is in the plot."""

    row: AccuracyRow
    milliseconds: float
    error: float

    @property
    def place(self) -> tuple[float, float]:
        """Coordinates in the plot."""
        return self.milliseconds, self.error


def _panel(
    axes: Any, canvas: Any, rows: Sequence[AccuracyRow], report: AccuracyReport, title: str, *, first: bool
) -> None:
    # Qualities, which come first, have a truth of their own.
    truth = next((one for one in report.truths if one.name == rows[-1].truth), None)
    floor = truth.uncertainty if truth is not None and math.isfinite(truth.uncertainty) else 0.0
    # An error of 0 is drawn at the end of the logarithmic axis.
    least = max(min((row.rmse for row in rows if row.rmse > 0.0), default=1e-8), 1e-9)
    points = [_Point(row, 1e3 * row.time(report.clock), max(row.rmse, least)) for row in rows]
    times, errors = [one.milliseconds for one in points], [one.error for one in points]
    left, right = min(times) / 1.5, max(times) * 1.7
    low, high = min(errors) / 2.5, max(errors) * 2.5
    axes.set(xscale="log", yscale="log", xlim=(left, right), ylim=(low, high))

    note = {"size": 8, "color": _FAINT, "ha": "right", "zorder": 1}
    if floor > low:
        axes.axhspan(low, min(floor, high), color="#f3f3f3", zorder=0)
        axes.text(right, floor, "not resolved by the truth ", va="top", **note)
    if max(low, floor) < _UNSEEN < high:
        axes.axhline(_UNSEEN, color="#cccccc", lw=1, ls=(0, (4, 3)), zorder=1)
        axes.text(right, _UNSEEN, "half a grey level of 8 bits ", va="bottom", **note)

    for knob, (color, marker) in _STYLES.items():
        there = [one for one in points if one.row.knob == knob]
        for run in _runs(there):
            axes.plot(*zip(*run, strict=True), color=color, lw=1.1, alpha=0.55, zorder=3)
        if there:
            style = {"marker": marker, "ms": 8 if marker == "*" else 6, "color": color, "mec": "white", "mew": 0.7}
            label = knob.replace("_", " ")
            axes.plot(*zip(*(one.place for one in there), strict=True), ls="", zorder=4, label=label, **style)
    now = next((one for one in points if one.row.current), None)
    if now is not None:
        ring = {"marker": "o", "ms": 15, "mfc": "none", "mec": _INK, "mew": 1.8, "ls": ""}
        axes.plot(*now.place, zorder=6, label="the scene as it is", **ring)
    best = sorted({one.place for one in points if one.row.pareto})
    if best:
        corners = [(best[0][0], high), *best, (right, best[-1][1])]
        line = {"color": _FRONT, "lw": 4, "alpha": 0.75, "solid_joinstyle": "round", "drawstyle": "steps-post"}
        axes.plot(*zip(*corners, strict=True), zorder=2, label="front: best for its time", **line)

    clock = " (processor time)" if report.clock == "cpu" else ""
    axes.set_xlabel(f"milliseconds a frame, median{clock}", size=10, color=_INK)
    if first:
        axes.set_ylabel("error, RMSE", size=10, color=_INK)
    axes.set_title(title, size=11, color=_INK, loc="left", pad=8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color("#bbbbbb")
    axes.grid(True, which="major", color="#ececec", lw=0.8, zorder=0)
    axes.set_axisbelow(True)
    axes.tick_params(which="both", color="#bbbbbb", labelcolor=_INK, labelsize=9)
    ticker = module_of("ticker")
    decades = math.log10(right / left)
    axes.xaxis.set_major_locator(ticker.LogLocator(subs=(1.0,) if decades > 2.5 else (1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(ticker.FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(ticker.NullFormatter())
    axes.yaxis.set_minor_formatter(ticker.NullFormatter())
    axes.legend(
        loc="upper left",
        bbox_to_anchor=(-0.01, -0.1),
        ncols=5 if first else 2,
        frameon=False,
        fontsize=9,
        labelcolor=_INK,
        handletextpad=0.5,
        columnspacing=1.4,
        labelspacing=0.55,
    )
    _label(axes, canvas, points, now)


def _runs(there: Sequence[_Point]) -> list[list[tuple[float, float]]]:
    """Return the points of each line: settings that differ in one number; classes and backends have one each."""
    found: dict[str, list[tuple[float, float]]] = {}
    for one in there:
        name = one.row.backend if one.row.knob == "precision" else one.row.series
        if not (one.row.knob == "table_size" and one.row.current):
            found.setdefault(name, []).append(one.place)
    return list(found.values())


def _label(axes: Any, canvas: Any, points: Sequence[_Point], now: _Point | None) -> None:
    """Write the settings beside their points where there is room: the current one, the front, then ends of lines."""
    stroke, text_class, box = module_of("patheffects").withStroke, module_of("text").Text, module_of("transforms").Bbox
    renderer = canvas.get_renderer()
    canvas.draw()
    taken = [box.from_bounds(x - 5, y - 5, 10, 10) for x, y in axes.transData.transform([one.place for one in points])]
    frame = axes.get_window_extent(renderer)
    taken += [text.get_window_extent(renderer) for text in axes.texts]
    written: set[tuple[float, float]] = set()
    for rank, one in _in_order(points, now):
        place = (round(one.milliseconds, 6), one.error)
        if place in written:
            continue
        is_now = now is not None and one.place == now.place
        color = _INK if is_now else _STYLES[one.row.knob][0]
        # Labels of the lowest rank are placed only directly beside their points.
        for dx, dy, ha, va in _PLACES if rank < _LEAST else _PLACES[:4]:
            far = 1.6 if is_now else 1.0
            leader = {"arrowstyle": "-", "color": color, "lw": 0.6, "alpha": 0.6, "shrinkA": 0, "shrinkB": 4}
            note = axes.annotate(
                "now" if is_now else _short(one.row),
                one.place,
                xytext=(far * dx, far * dy),
                textcoords="offset points",
                ha=ha,
                va=va,
                size=10 if is_now else 8.5,
                weight="bold" if is_now or one.row.pareto else "normal",
                color=color,
                zorder=7,
                path_effects=[stroke(linewidth=2.5, foreground="white", alpha=0.85)],
                arrowprops=leader if abs(dy) > 10 else None,
            )
            note.update_positions(renderer)
            # Leader lines may cross other labels; the texts may not.
            words = text_class.get_window_extent(note, renderer)
            inside = frame.x0 <= words.x0 and words.x1 <= frame.x1 + 30 and frame.y0 <= words.y0 <= frame.y1 - 4
            if inside and not any(words.overlaps(other) for other in taken):
                taken.append(words)
                written.add(place)
                break
            note.remove()


def _in_order(points: Sequence[_Point], now: _Point | None) -> list[tuple[int, _Point]]:
    """Return the points to label with their ranks: the current setting, the front, ends of lines, then the others."""
    ends = set()
    for knob in KNOBS:
        for run in _runs([one for one in points if one.row.knob == knob]):
            ends |= {(knob, run[0]), (knob, run[-1])}

    def rank(one: _Point) -> int:
        if now is not None and one.place == now.place:
            return 0
        return 1 if one.row.pareto else 2 if (one.row.knob, one.place) in ends else _LEAST

    return sorted(((rank(one), one) for one in points), key=lambda ranked: (ranked[0], ranked[1].milliseconds))


def _short(row: AccuracyRow) -> str:
    """Return a short label; the colour of the point stands for the knob."""
    if row.knob == "image_scale":
        return f"{row.setting} size"
    if row.knob == "opacity_stop":
        return f"stop {row.setting.split(',')[0]}"
    if row.knob == "filter":
        return "ewa" if row.setting == "ewa" else "no filter"
    if row.knob == "lattice":
        return row.setting.replace(" of the samples", "").replace("BCC, ", "BCC × ")
    return row.setting
