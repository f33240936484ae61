"""``image.error`` against the true error of pictures, over random scenes and measured volumes."""

from __future__ import annotations

import error_scenes
import numpy as np

import sheetsplat as ss
from bench.measure import data_folder
from bench.report import Options, Report, Row, columns

# The estimate may be tuned on seeds below 1,000, never on these or on the measured volumes.
_SEEDS = range(1000, 1100)
_SIZE = 64
# Float32 pictures do not resolve smaller differences.
_RESOLVED = 3e-8

#: Groups that can be run alone; "tuning" only by name.
ROWS = ("random", "measured", "tuning")


def summary(group: str, ratios: list[float]) -> str:
    """Return the distribution of true error over estimate."""
    found = np.array(ratios)
    factor = np.maximum(found, 1 / found)
    at = " / ".join(f"{one:.2f}" for one in np.percentile(found, [0, 5, 50, 95, 100]))
    return (
        f"{group}, {len(found)} pictures: true error over estimate {at} (least, 5 %, median, 95 %, largest); within a "
        f"factor of 2: {np.mean(factor <= 2):.1%}; true error above 4 estimates: {int((found > 4).sum())}"
    )


def cases(group: str, options: Options) -> list[error_scenes.Case]:
    """Return the cases of a group; measured volumes whose files are missing are left out."""
    if group == "measured":
        measured: list[error_scenes.Case] = error_scenes.measured_cases(data_folder(options))
        return measured
    count = max(1, round(len(_SEEDS) * options.scale))
    first = _SEEDS.start if group == "random" else 0
    return [error_scenes.random_case(seed) for seed in range(first, first + count)]


def run(options: Options) -> Report:
    """Draw every case and its converged picture."""
    exact, renderer = error_scenes.exact_renderer(), ss.Renderer("cpu")
    side = min(_SIZE, *options.size)
    rows: list[Row] = []
    notes = []
    for group in options.rows or ROWS[:2]:
        options.say(group)
        ratios = []
        for case in cases(group, options):
            image = renderer.render(case.drawn(), case.camera, (side, side))
            true = error_scenes.rmse(image, error_scenes.converged(exact, case, (side, side)))
            ratios.append(max(true, _RESOLVED) / max(image.error.rmse, _RESOLVED))
            row: Row = {"group": group, "row": case.name, "true": true, "estimated": image.error.rmse}
            rows.append(row | {"ratio": ratios[-1], "budget": image.error.budget})
        if ratios:
            notes.append(summary(group, ratios))
    return Report(
        name="error_estimate",
        title=f"True and estimated error at {side}x{side}",
        columns=columns("group, row=picture, true, estimated, ratio=true over estimate"),
        rows=rows,
        notes=notes,
    )
