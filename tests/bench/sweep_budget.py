"""Hold max_error against what pictures really have, and what it picks against an exhaustive sweep of settings.

    python tests/bench/sweep_budget.py [--seeds FIRST COUNT] [--errors E …] [--sweep] [--data FOLDER] [--json OUT]

Without --sweep only the bound is looked at. Times are processor time of one thread, the least of several pictures.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("SHEETSPLAT_DATA", ROOT.parent / "shared" / "data"))
sys.path.insert(0, str(ROOT / "tests" / "python"))

import error_scenes  # noqa: E402

import sheetsplat as ss  # noqa: E402

SPACINGS = [2.0**n for n in np.arange(2, -6.1, -0.25)]
STOPS = (0.9, 0.98, 0.995, 0.9995)


def seconds(renderer: ss.Renderer, scene: ss.Scene, camera: ss.Camera, size: tuple[int, int], repeats: int) -> float:
    """Return the least processor time of a picture."""
    renderer.render(scene, camera, size)
    least = np.inf
    for _ in range(repeats):
        began = time.process_time()
        renderer.render(scene, camera, size)
        least = min(least, time.process_time() - began)
    return float(least)


def kinds(case: error_scenes.Case) -> list[dict[str, Any]]:
    """Return the ways of classification and sampling that a scene can have."""
    found: list[dict[str, Any]] = [{"sampling": "point"}, {"sampling": "slab"}]
    if case.scene.mode == "composite":
        found += [{"sampling": "point", "preintegration": way} for way in (True, "second_order")]
    return found


def best_of_sweep(
    case: error_scenes.Case, reference: ss.Image, error: float, size: tuple[int, int], repeats: int
) -> tuple[float, dict[str, Any]]:
    """Return the least time of all settings that keep the error, and the settings.

    Of each kind and stop the largest slice distance that keeps it, found by halving, is timed: finer slices only take
    longer.
    """
    renderer = ss.Renderer("cpu", threads=1)
    best: tuple[float, dict[str, Any]] = (np.inf, {})
    for kind in kinds(case):
        for stop in STOPS if case.scene.mode == "composite" else STOPS[1:2]:
            settings = kind | {"opacity_stop": stop}
            coarse, fine = -1, len(SPACINGS)
            while fine - coarse > 1:
                middle = (coarse + fine) // 2
                settings["slice_spacing"] = float(case.spacing * SPACINGS[middle])
                scene = case.scene.replace(**settings, reference_length=case.options["reference_length"])
                kept = error_scenes.rmse(renderer.render(scene, case.camera, size), reference) <= error
                coarse, fine = (coarse, middle) if kept else (middle, fine)
            if fine < len(SPACINGS):
                settings["slice_spacing"] = float(case.spacing * SPACINGS[fine])
                scene = case.scene.replace(**settings, reference_length=case.options["reference_length"])
                took = seconds(renderer, scene, case.camera, size, repeats)
                best = min(best, (took, settings), key=lambda pair: pair[0])
    return best


def main() -> None:
    """Print a line a picture, then how often the bound holds and what is paid for not knowing."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", nargs=2, type=int, default=(2000, 40), metavar=("FIRST", "COUNT"))
    parser.add_argument("--errors", nargs="+", type=float, default=(1e-2, 1e-3, 2e-4))
    parser.add_argument("--size", type=int, default=160)
    parser.add_argument("--sweep", action="store_true")
    parser.add_argument("--repeats", type=int, default=4)
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--no-data", action="store_true")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    first, count = options.seeds
    cases = [error_scenes.random_case(seed, 1.0) for seed in range(first, first + count)]
    if not options.no_data and options.data.is_dir():
        cases += error_scenes.measured_cases(options.data)
    size = (options.size, options.size)
    exact = error_scenes.exact_renderer()
    rows: list[dict[str, Any]] = []
    for case in cases:
        composite = {"preintegration": True} if case.scene.mode == "composite" else {}
        for error in options.errors:
            row: dict[str, Any] = {"case": case.name, "max_error": error}
            renderer = ss.Renderer("cpu", threads=1, max_error=error)
            try:
                image = renderer.render(case.default(), case.camera, size)
            except ss.Unsupported as refusal:
                print(f"{case.name:56s} {error:.0e} refused: {refusal}", flush=True)
                rows.append(row | {"refused": str(refusal)})
                continue
            assert image.settings is not None
            spacing = min(case.spacing, image.settings["slice_spacing"]) / 8
            reference = error_scenes.converged(exact, case, size, spacing, sampling="point", **composite)
            row |= {"true": error_scenes.rmse(image, reference), "expected": image.stats["estimated_rmse"]}
            row["settings"] = image.settings
            text = f"true {row['true'] / error:.2f}, expected {row['expected'] / error:.2f} of it"
            if options.sweep:
                row["seconds"] = seconds(renderer, case.default(), case.camera, size, options.repeats)
                row["best"], row["best_settings"] = best_of_sweep(case, reference, error, size, options.repeats)
                row["ratio"] = row["seconds"] / row["best"]
                text += f"; {row['seconds'] * 1e3:.1f} ms, best {row['best'] * 1e3:.1f} ms {row['best_settings']}"
            chosen = {name: value for name, value in image.settings.items() if name != "precision"}
            print(f"{case.name:56s} {error:.0e} {text}; chosen {chosen}", flush=True)
            rows.append(row)
    drawn = [row for row in rows if "true" in row]
    kept = sum(row["true"] <= row["max_error"] for row in drawn)
    print(f"the bound holds for {kept} of {len(drawn)}; {len(rows) - len(drawn)} refused")
    ratios = np.array([row["ratio"] for row in drawn if np.isfinite(row.get("ratio", np.inf))])
    if ratios.size:
        least, median, most, largest = np.percentile(ratios, [0, 50, 90, 100])
        print(
            f"time over the best of the sweep: {least:.2f} / {median:.2f} / {most:.2f} / {largest:.2f} "
            f"(least, median, 90 %, largest); within 1.5 times: {np.mean(ratios <= 1.5):.1%}"
        )
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
