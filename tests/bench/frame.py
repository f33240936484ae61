"""A shaded frame of 480,000 kernels, against a bare fill test in the same run."""

from __future__ import annotations

import math

import sheetsplat as ss
from bench.lab import fill_test
from bench.measure import Timing, away, device_of, orthographic, renderer_for, time_frames
from bench.report import Goal, Options, Report, Row, columns, environment
from sheetsplat import datasets

# Pixels a sample distance: a kernel of radius 2 is 12 x 12 pixels.
_ZOOM = 3.0
_KERNEL_PIXELS = 12
_NAMES = (
    "bare fill test, two targets as in packing wide",
    "bare fill test, one target",
    "noisy ball, packing paper",
)


def _cameras(volume: datasets.Dataset, options: Options) -> list[ss.Camera]:
    """Return views near the cube's diagonal, where there are most slices, at 3 pixels a sample distance."""
    centre = [0.5 * (n - 1) for n in volume.shape[::-1]]
    turns = [35.0 + 20.0 * view / max(1, options.views - 1) for view in range(options.views)]
    rise, far = math.radians(35.0), 2.0 * max(volume.shape)
    return [orthographic(centre, away(math.radians(turn), rise), far, options.size[1] / _ZOOM) for turn in turns]


def _speed(fragments: int, timing: Timing) -> Row:
    return {"fragments": fragments, "million_a_second": 1e-6 * fragments / max(timing.cpu, 1e-9)}


def run(options: Options) -> Report:
    """Time the ball in both packings, the tubes, and the fill test."""
    options = options.preferring("gl")
    ball, tubes = datasets.noisy_ball(options.edge(128)), datasets.tubes(options.edge(128))
    renderer = renderer_for(options)
    rows: list[Row] = []

    def timed(name: str, volume: datasets.Dataset, renderer: ss.Renderer) -> Timing:
        options.say(name)
        timing, _ = time_frames(renderer, volume.scene(), _cameras(volume, options), options.size)
        rows.append({"row": name} | timing.row("view", "draw") | _speed(timing.splats * _KERNEL_PIXELS**2, timing))
        return timing

    def filled(name: str, kernels: int, targets: int) -> Timing:
        """Time the blending of as many fragments, as points of one size with nothing to look up or to shade."""
        options.say(name)
        timing = fill_test(kernels, _KERNEL_PIXELS, options.size, targets, options.views)
        rows.append({"row": name} | timing.times() | _speed(kernels * _KERNEL_PIXELS**2, timing))
        return timing

    whole = timed("noisy ball", ball, renderer)
    two, one, paper = _NAMES
    floor: Timing | None = None
    backend = renderer.plan(ball.scene(), _cameras(ball, options)[0], size=options.size).backend
    if backend == "gl":
        # Right after the frame, under the same load. Packing wide blends two targets a fragment: so does its floor.
        floor = filled(two, whole.splats, 2)
        filled(one, whole.splats, 1)
        timed(paper, ball, renderer_for(options, packing="paper"))
    else:
        rows += [{"row": name, "remark": f"not run: needs OpenGL, and this is backend {backend}"} for name in _NAMES]
    thin = timed("tubes", tubes, renderer)

    goals = []
    if options.scale == 1.0:
        goals.append(Goal("tubes over ball, cpu", thin.cpu / whole.cpu, 0.25))
    if options.scale == 1.0 and floor is not None:
        name = "the ball's frame over the fill test"
        goals += [
            Goal(f"{name}, cpu", whole.cpu / floor.cpu, 2.5),
            Goal(f"{name}, elapsed", whole.wall / floor.wall, 2.5),
            Goal("bucketing of the ball", 1000.0 * whole.stat("seconds_view"), 15.0, "ms"),
        ]
    return Report(
        name="frame",
        title=f"Shaded frames at {options.size[0]}x{options.size[1]}, kernels of {_KERNEL_PIXELS} pixels",
        columns=columns(
            "row=what, kernels_drawn, slices, fragments, wall_ms, cpu_ms, view_ms=bucketing ms, draw_ms=draw ms, "
            "million_a_second=M fragments/cpu s, remark"
        ),
        rows=rows,
        notes=[
            options.views_note,
            f"The views lie near the diagonal. fragments: splats times {_KERNEL_PIXELS}^2.",
        ],
        goals=goals,
        environment=environment(device_of(renderer)),
    )
