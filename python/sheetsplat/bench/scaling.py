"""How the time of a frame grows with the number of kernels and with the number of pixels."""

from __future__ import annotations

import math

import numpy as np

import sheetsplat as ss
from sheetsplat import datasets
from sheetsplat.bench._measure import device_of, orbit, renderer_for, time_frames
from sheetsplat.bench._report import Options, Report, Row, environment

_EDGES = (32, 48, 64, 96, 128, 160, 192)
_SIZES = (100, 200, 400, 800, 1600)

_COLUMNS = {
    "row": "series",
    "edge": "edge",
    "kernels_drawn": "drawn",
    "pixels": "pixels",
    "slices": "slices",
    "wall_ms": "ms",
    "cpu_ms": "cpu ms",
    "view_ms": "bucketing ms",
    "ns_a_kernel": "cpu ns a kernel",
    "ns_a_pixel": "cpu ns a pixel and slice",
}


def _row(series: str, edge: int, size: tuple[int, int], options: Options, renderer: ss.Renderer) -> Row:
    options.say(f"{series}: {edge}^3 at {size[0]}x{size[1]}")
    scene = datasets.noisy_ball(edge).scene()
    timing = time_frames(renderer, scene, orbit(scene.fields[0], options.views), size)
    drawn, slices = timing.stats["kernels_drawn"], timing.stats["slices"]
    return {
        "row": series,
        "edge": edge,
        "kernels_drawn": round(drawn),
        "pixels": size[0] * size[1],
        "slices": round(slices),
        "wall_ms": 1000.0 * timing.wall,
        "cpu_ms": 1000.0 * timing.cpu,
        "view_ms": 1000.0 * timing.stats.get("seconds_view", 0.0),
        "ns_a_kernel": 1e9 * timing.cpu / max(drawn, 1.0),
        "ns_a_pixel": 1e9 * timing.cpu / max(slices * size[0] * size[1], 1.0),
    }


def _slope(rows: list[Row], name: str) -> float:
    """Return the exponent of the time in the upper half of a series."""
    upper = rows[len(rows) // 2 :] if len(rows) > 3 else rows
    if len(upper) < 2:
        return math.nan
    return float(np.polyfit(np.log([row[name] for row in upper]), np.log([row["cpu_ms"] for row in upper]), 1)[0])


def run(options: Options) -> Report:
    """Time the noisy ball at growing numbers of samples, and at growing sizes of the picture."""
    renderer = renderer_for(options)
    edges = sorted({options.edge(edge) for edge in _EDGES})
    kernels = [_row("kernels", edge, options.size, options, renderer) for edge in edges]
    sizes = sorted({max(8, round(size * options.scale)) for size in _SIZES})
    pixels = [_row("pixels", options.edge(64), (size, size), options, renderer) for size in sizes]
    return Report(
        name="scaling",
        title="Time of a frame of the noisy ball, shaded",
        columns=_COLUMNS,
        rows=kernels + pixels,
        notes=[
            f"Medians over {options.views} views. The picture always shows all of the volume, so that more kernels are "
            "smaller ones on more slices.",
            "In the upper half of each series cpu time grows with the kernels to the power "
            f"{_slope(kernels, 'kernels_drawn'):.2f} and with the pixels to the power {_slope(pixels, 'pixels'):.2f}.",
        ],
        environment=environment(device_of(renderer)),
    )
