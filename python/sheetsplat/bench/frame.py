"""One shaded frame of the noisy ball, against a bare fill test in the same run."""

from __future__ import annotations

import math

import sheetsplat as ss
from sheetsplat import _sheetsplat, datasets
from sheetsplat.bench._measure import Timing, device_of, renderer_of_papers, time_frames
from sheetsplat.bench._report import Goal, Options, Report, Row, environment

# Pixels a sample distance: a kernel of radius 2 is 12 x 12 pixels.
_ZOOM = 3.0
_KERNEL_PIXELS = 12

_COLUMNS = {
    "row": "what",
    "kernels_drawn": "drawn",
    "slices": "slices",
    "fragments": "fragments",
    "wall_ms": "ms",
    "cpu_ms": "cpu ms",
    "view_ms": "bucketing ms",
    "draw_ms": "draw ms",
    "million_a_second": "M fragments/cpu s",
    "remark": "remark",
}


def _cameras(volume: datasets.Dataset, options: Options) -> list[ss.Camera]:
    """Return views along directions near the cube's diagonal, where slices are most; 3 pixels a sample distance."""
    centre = tuple(0.5 * (n - 1) for n in volume.shape[::-1])
    far = 2.0 * max(volume.shape)
    cameras = []
    for view in range(options.views):
        turn = math.radians(35.0 + 20.0 * view / max(1, options.views - 1))
        rise = math.radians(35.0)
        away = (math.sin(turn) * math.cos(rise), math.sin(rise), math.cos(turn) * math.cos(rise))
        eye = tuple(c + far * a for c, a in zip(centre, away, strict=True))
        cameras.append(ss.Camera.orthographic(eye, centre, height=options.size[1] / _ZOOM))
    return cameras


def _row(name: str, timing: Timing) -> Row:
    fragments = round(timing.stats.get("splats", timing.stats["kernels_drawn"])) * _KERNEL_PIXELS**2
    return {
        "row": name,
        "kernels_drawn": round(timing.stats["kernels_drawn"]),
        "slices": round(timing.stats["slices"]),
        "fragments": fragments,
        "wall_ms": 1000.0 * timing.wall,
        "cpu_ms": 1000.0 * timing.cpu,
        "view_ms": 1000.0 * timing.stats.get("seconds_view", 0.0),
        "draw_ms": 1000.0 * timing.stats.get("seconds_draw", 0.0),
        "million_a_second": 1e-6 * fragments / max(timing.cpu, 1e-9),
    }


def _fill(kernels: int, options: Options, targets: int) -> Row:
    """Time the same number of blended fragments as points of one size, with nothing to look up or to shade."""
    width, height = options.size
    wall, cpu = _sheetsplat.fill_test(kernels, _KERNEL_PIXELS, width, height, targets, options.views)
    fragments = kernels * _KERNEL_PIXELS**2
    return {
        "fragments": fragments,
        "wall_ms": 1000.0 * wall,
        "cpu_ms": 1000.0 * cpu,
        "million_a_second": 1e-6 * fragments / max(cpu, 1e-9),
    }


def run(options: Options) -> Report:
    """Time the ball in both packings, the tubes, and the fill test."""
    edge = options.edge(128)
    ball, tubes = datasets.noisy_ball(edge), datasets.tubes(edge)
    renderer = renderer_of_papers(options)
    rows: list[Row] = []

    def timed(volume: datasets.Dataset, renderer: ss.Renderer) -> Timing:
        return time_frames(renderer, volume.scene(), _cameras(volume, options), options.size)

    options.say("noisy ball")
    ball_timing = timed(ball, renderer)
    rows.append(_row("noisy ball", ball_timing))
    two, one, paper = "bare fill test, two targets as packing wide has", "bare fill test, one target", "packing paper"
    backend = ball_timing.picture.plan.backend
    fill: Row = {}
    if backend == "gl":
        options.say("fill test")
        # As many points as the ball took, right after it, so that both meet the same machine.
        splats = round(ball_timing.stats.get("splats", ball_timing.stats["kernels_drawn"]))
        # What packing wide blends is two targets a fragment: the bare test that does the same is the floor.
        fill = _fill(splats, options, 2)
        rows.append({"row": two, **fill})
        rows.append({"row": one, **_fill(splats, options, 1)})
        rows.append(_row(f"noisy ball, {paper}", timed(ball, renderer_of_papers(options, packing="paper"))))
    else:
        remark = f"not run: OpenGL's, and this is backend {backend}"
        rows += [{"row": name, "remark": remark} for name in (two, one, f"noisy ball, {paper}")]
    options.say("tubes")
    tubes_timing = timed(tubes, renderer)
    rows.append(_row("tubes", tubes_timing))

    goals = []
    # Its figures are those of OpenGL.
    if options.scale == 1.0 and fill:
        clock = ball_timing.wall / max(1e-3 * fill["wall_ms"], 1e-9)
        goals.append(
            Goal(
                "the ball's frame over the fill test, by the processors", 1000.0 * ball_timing.cpu / fill["cpu_ms"], 2.5
            )
        )
        goals.append(Goal("the ball's frame over the fill test, by the clock", clock, 2.5))
        goals.append(Goal("bucketing of the ball", 1000.0 * ball_timing.stats["seconds_view"], 15.0, "ms"))
    goals.append(Goal("tubes over ball, by the processors", tubes_timing.cpu / ball_timing.cpu, 0.25))
    return Report(
        name="frame",
        title=f"Shaded frames at {options.size[0]}x{options.size[1]}, kernels of {_KERNEL_PIXELS} pixels",
        columns=_COLUMNS,
        rows=rows,
        notes=[
            f"Medians over {options.views} views near the diagonal. fragments: splats times {_KERNEL_PIXELS}^2.",
            "cpu ms counts all processors of the process and holds where others use the machine too.",
        ],
        goals=goals,
        environment=environment(device_of(renderer)),
    )
