"""A picture of 20,000 x 20,000 pixels, drawn to disk tile by tile and compared with the reference in 64 windows."""

from __future__ import annotations

import tempfile
from pathlib import Path

import hard_cases as hard
import numpy as np
import scene_parts
from image_checks import FLOAT32

import sheetsplat as ss
from bench.measure import clock, renderer_for, resident
from bench.report import Goal, Options, Report, columns
from sheetsplat.compare import compare
from sheetsplat.tiles import render_tiles, window

_WINDOW = 48
_WINDOWS = 64
_SIDE = 20_000
_TILE = 2048


def the_scene() -> tuple[ss.Scene, ss.Camera]:
    """Return a lattice beside ellipsoids, unlit; at 20,000 pixels a sample is 1,800 wide."""
    fields = [scene_parts.cloud(np.random.default_rng(20), 300, 3.0), hard.lattice("huge", (11, 10, 9))]
    # Unlit, because a pixel is small against the slice distance, which is the length over which gradients are lit.
    made = scene_parts.parts(fields, scene_parts.parallel(height=2.2), slice_spacing=0.2, lit=False)
    scene, camera, _ = scene_parts.build(ss, made)
    return scene, camera


def corners(size: int, tile: int, rng: np.random.Generator) -> list[tuple[int, int]]:
    """Return the first columns and rows of the windows: 16 at corners of tiles, 16 at borders, the others anywhere."""
    borders = np.arange(tile, size, tile)
    found = []
    for number in range(_WINDOWS):
        free = rng.integers(0, size - _WINDOW + 1, 2)
        if number < 32 and borders.size:
            free[0] = rng.choice(borders) - _WINDOW // 2
        if number < 16 and borders.size:
            free[1] = rng.choice(borders) - _WINDOW // 2
        column, row = (int(np.clip(part, 0, size - _WINDOW)) for part in (free if number % 2 else free[::-1]))
        found.append((column, row))
    return found


def run(options: Options) -> Report:
    """Draw it into a temporary file (6.4 GB at the full scale; in the folder of pictures, if given) and compare."""
    options = options.preferring("cpu")
    side, tile = max(2 * _WINDOW, round(_SIDE * options.scale)), max(_WINDOW, round(_TILE * options.scale))
    scene, camera = the_scene()
    size = (side, side)
    if options.pictures is not None:
        options.pictures.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=options.pictures) as folder:
        path = Path(folder) / "huge.npy"
        options.say(f"{side}x{side} pixels")
        renderer = renderer_for(options)
        picture, seconds, _ = clock(lambda: render_tiles(scene, camera, size, path, renderer=renderer, tile=tile))
        peak, volume = resident("VmHWM"), path.stat().st_size
        reference = ss.Renderer("reference")
        worst = {"rmse": 0.0, "p99_9": 0.0, "maximum": 0.0}
        seen = 0
        options.say("windows")
        for column, row in corners(side, tile, np.random.default_rng(64)):
            part = window(camera, size, (column, row), (_WINDOW, _WINDOW))
            expected = reference.render(scene, part, size=(_WINDOW, _WINDOW)).pixels
            found = compare(picture[row : row + _WINDOW, column : column + _WINDOW], expected)
            seen += bool(expected.any())
            worst = {name: max(worst[name], found[name]) for name in worst}
        del picture
    return Report(
        name="huge",
        title=f"A picture of {side}x{side} pixels on backend {options.backend}",
        columns=columns(
            "row=what, seconds=s, gigabytes=GB, peak=peak MB, rmse, p99_9, maximum, seen=windows not empty"
        ),
        rows=[
            {"row": "drawn", "seconds": seconds, "gigabytes": 1e-9 * volume, "peak": 1e-6 * peak},
            {"row": f"{_WINDOWS} windows of {_WINDOW}x{_WINDOW}, the worst", **worst, "seen": seen},
        ],
        goals=[
            Goal("RMSE of the worst window", worst["rmse"], FLOAT32[0]),
            Goal("P99.9 of the worst window", worst["p99_9"], FLOAT32[1]),
            Goal("windows that are not empty", seen, _WINDOWS // 2, least=True),
        ],
    )
