"""Hold `image.error` against the error that pictures really have, over random scenes and measured volumes.

    python tests/bench/calibrate_error.py [--seeds FIRST COUNT] [--data FOLDER] [--json OUT]

Seeds below 1,000 may be used to tune the estimate; those from 1,000 on, and the measured volumes, never are.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("SHEETSPLAT_DATA", ROOT.parent / "shared" / "data"))
sys.path.insert(0, str(ROOT / "tests" / "python"))

import error_scenes  # noqa: E402

import sheetsplat as ss  # noqa: E402


def summary(ratios: list[float]) -> str:
    """Return how estimates lie round what they estimate."""
    found = np.array(ratios)
    away = np.maximum(found, 1 / found)
    at = np.percentile(found, [0, 5, 50, 95, 100])
    return (
        f"{len(found)} pictures: true error over estimate {at[0]:.2f} / {at[1]:.2f} / {at[2]:.2f} / {at[3]:.2f} / "
        f"{at[4]:.2f} (least, 5 %, median, 95 %, largest); within a factor of 2: {np.mean(away <= 2):.1%}; "
        f"true error above 4 estimates: {int((found > 4).sum())}"
    )


def main() -> None:
    """Print a line a picture, then the distribution."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", nargs=2, type=int, default=(1000, 100), metavar=("FIRST", "COUNT"))
    parser.add_argument("--size", type=int, default=64)
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--no-data", action="store_true")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    first, count = options.seeds
    groups = {"random": [error_scenes.random_case(seed) for seed in range(first, first + count)]}
    if not options.no_data and options.data.is_dir():
        groups["measured"] = error_scenes.measured_cases(options.data)
    exact, renderer = error_scenes.exact_renderer(), ss.Renderer("cpu")
    size = (options.size, options.size)
    rows = []
    for group, cases in groups.items():
        ratios = []
        for case in cases:
            image = renderer.render(case.drawn(), case.camera, size)
            true = error_scenes.rmse(image, error_scenes.converged(exact, case, size))
            estimated = image.error.rmse
            # What float32 pictures cannot tell apart.
            ratio = max(true, 3e-8) / max(estimated, 3e-8)
            ratios.append(ratio)
            rows.append({"case": case.name, "true": true, "estimated": estimated, "budget": image.error.budget})
            print(f"{case.name:60s} true {true:.2e}  estimated {estimated:.2e}  ratio {ratio:.2f}", flush=True)
        print(f"{group}: {summary(ratios)}")
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
