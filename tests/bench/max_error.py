"""``max_error``: whether pictures keep it, and, with --row sweep, their time over the best of an exhaustive sweep."""

from __future__ import annotations

from typing import Any

import error_scenes
import numpy as np

import sheetsplat as ss
from bench.error_estimate import cases as cases_of
from bench.measure import clock
from bench.report import Options, Report, Row, columns

_SEEDS = range(2000, 2040)
_SIZE = 160
_ERRORS = (1e-2, 1e-3, 2e-4)
_REPEATS = 4
_SPACINGS = [2.0**n for n in np.arange(2, -6.1, -0.25)]
_STOPS = (0.9, 0.98, 0.995, 0.9995)

#: "bound" compares pictures with max_error; "sweep", by name only, times every setting as well, which takes hours.
ROWS = ("bound", "sweep")


def _seconds(renderer: ss.Renderer, scene: ss.Scene, camera: ss.Camera, size: tuple[int, int]) -> float:
    """Return the least cpu time of a picture."""
    renderer.render(scene, camera, size)
    return min(clock(lambda: renderer.render(scene, camera, size))[2] for _ in range(_REPEATS))


def _kinds(case: error_scenes.Case) -> list[dict[str, Any]]:
    """Return the ways of classification and sampling that a scene can have."""
    found: list[dict[str, Any]] = [{"sampling": "point"}, {"sampling": "slab"}]
    if case.scene.mode == "composite":
        found += [{"sampling": "point", "preintegration": way} for way in (True, "second_order")]
    return found


def best_of_sweep(
    case: error_scenes.Case, reference: ss.Image, error: float, size: tuple[int, int]
) -> tuple[float, dict[str, Any]]:
    """Return the least time of all settings that keep an error, and the settings.

    For each kind and stop, bisection finds the largest slice distance that keeps it; finer slices only take longer.
    """
    renderer = ss.Renderer("cpu", threads=1)
    best: tuple[float, dict[str, Any]] = (np.inf, {})
    length = case.options["reference_length"]
    for kind in _kinds(case):
        for stop in _STOPS if case.scene.mode == "composite" else _STOPS[1:2]:

            def settings(n: int, kind: dict[str, Any] = kind, stop: float = stop) -> dict[str, Any]:
                return {**kind, "opacity_stop": stop, "slice_spacing": float(case.spacing * _SPACINGS[n])}

            coarse, fine = -1, len(_SPACINGS)
            while fine - coarse > 1:
                middle = (coarse + fine) // 2
                scene = case.scene.replace(**settings(middle), reference_length=length)
                kept = error_scenes.rmse(renderer.render(scene, case.camera, size), reference) <= error
                coarse, fine = (coarse, middle) if kept else (middle, fine)
            if fine < len(_SPACINGS):
                scene = case.scene.replace(**settings(fine), reference_length=length)
                took = _seconds(renderer, scene, case.camera, size)
                best = min(best, (took, settings(fine)), key=lambda pair: pair[0])
    return best


def _row(case: error_scenes.Case, error: float, exact: ss.Renderer, size: tuple[int, int], sweep: bool) -> Row:
    row: Row = {"row": case.name, "max_error": error}
    renderer = ss.Renderer("cpu", threads=1, max_error=error)
    try:
        image = renderer.render(case.default(), case.camera, size)
    except ss.Unsupported as refusal:
        return row | {"remark": f"refused: {refusal}"}
    assert image.settings is not None
    composite = {"preintegration": True} if case.scene.mode == "composite" else {}
    spacing = min(case.spacing, image.settings["slice_spacing"]) / 8
    reference = error_scenes.converged(exact, case, size, spacing, sampling="point", **composite)
    chosen = {name: value for name, value in image.settings.items() if name != "precision"}
    row |= {
        "true": error_scenes.rmse(image, reference) / error,
        "expected": image.stats["estimated_rmse"] / error,
        "chosen": ", ".join(f"{name} {value}" for name, value in chosen.items()),
    }
    if sweep:
        took = _seconds(renderer, case.default(), case.camera, size)
        best, settings = best_of_sweep(case, reference, error, size)
        row |= {"ms": 1000.0 * took, "best_ms": 1000.0 * best, "ratio": took / best, "best": settings}
    return row


def run(options: Options) -> Report:
    """Draw random scenes and measured volumes with every max_error."""
    side = min(_SIZE, *options.size)
    count = max(1, round(len(_SEEDS) * options.scale))
    cases = [error_scenes.random_case(seed, 1.0) for seed in range(_SEEDS.start, _SEEDS.start + count)]
    cases += cases_of("measured", options)
    exact, sweep = error_scenes.exact_renderer(), "sweep" in options.rows
    rows: list[Row] = []
    for case in cases:
        options.say(case.name)
        rows += [_row(case, error, exact, (side, side), sweep) for error in _ERRORS]
    drawn = [row for row in rows if "true" in row]
    kept = sum(row["true"] <= 1.0 for row in drawn)
    notes = [f"The bound holds for {kept} of {len(drawn)} pictures; {len(rows) - len(drawn)} were refused."]
    ratios = np.array([row["ratio"] for row in drawn if np.isfinite(row.get("ratio", np.inf))])
    if ratios.size:
        told = " / ".join(f"{one:.2f}" for one in np.percentile(ratios, [0, 50, 90, 100]))
        notes.append(
            f"Time over the best of the sweep: {told} (least, median, 90 %, largest); within 1.5 times: "
            f"{np.mean(ratios <= 1.5):.1%}."
        )
    return Report(
        name="max_error",
        title=f"Pictures chosen by max_error at {side}x{side}, one thread",
        columns=columns(
            "row=picture, max_error, true=true error over it, expected=expected over it, ms=cpu ms, "
            "best_ms=best cpu ms, ratio, best=best settings, chosen=chosen settings, remark"
        ),
        rows=rows,
        notes=notes,
    )
