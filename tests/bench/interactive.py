"""How soon a picture follows the camera: the first stage and the whole picture of quality `good` on an orbit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

import sheetsplat as ss
from bench.measure import clock, device_of, measured_rows, orbit, renderer_for
from bench.quality import composed, measured
from bench.report import Goal, Options, Report, Row, columns, environment
from sheetsplat import datasets

# Camera moves for each of --views: 200 unless told otherwise.
_MOVES = 40
# Pictures are twice as wide and high as those of other benchmarks: 800 x 800.
_WIDER = 2
# Seconds that are wanted at the 95th percentile.
_FIRST, _WHOLE = 0.05, 0.6
_MOST_OF_THEM = 95.0


def _ball(options: Options) -> ss.RegularField:
    return datasets.noisy_ball(options.edge(256)).field()


FIELDS: Mapping[str, Callable[[Options], ss.RegularField]] = {
    "bonsai": lambda options: measured(options, "bonsai"),
    "noisy ball": _ball,
}

#: Fields that can be measured alone; where none is named, the first one is.
ROWS = tuple(FIELDS)


def _figures(name: str, seconds: Sequence[float]) -> Row:
    """Return median, 95th percentile and largest of some times, ms."""
    found = 1000.0 * np.array(seconds)
    parts = {"median": np.median(found), "most": np.percentile(found, _MOST_OF_THEM), "worst": found.max()}
    return {f"{name}_{part}": float(value) for part, value in parts.items()}


def follow(
    renderer: ss.Renderer, scene: ss.Scene, cameras: Sequence[ss.Camera], size: tuple[int, int]
) -> list[tuple[float, float, float, int]]:
    """Return, for each camera, seconds to the first stage and to the last, processor seconds, and how many stages."""
    found = []
    for camera in cameras:
        stages = renderer.progressive(scene, camera, size=size, first_seconds=_FIRST)
        _, first, first_cpu = clock(lambda: next(stages))  # noqa: B023
        others, rest, rest_cpu = clock(lambda: sum(1 for _ in stages))  # noqa: B023
        found.append((first, first + rest, first_cpu + rest_cpu, 1 + others))
    return found


def run(options: Options) -> Report:
    """Orbit the fields that are wanted."""
    options = options.preferring("cpu")
    size = (_WIDER * options.size[0], _WIDER * options.size[1])
    moves = _MOVES * options.views
    goals: list[Goal] = []

    def measure(name: str, field: Callable[[Options], ss.RegularField]) -> Row:
        volume = field(options)
        cameras = orbit(volume, moves)
        scene, _ = composed(volume, "good", size, cameras[0])
        renderer = renderer_for(options)
        # The renderer learns how long its pictures take.
        follow(renderer, scene, cameras[-2:], size)
        times = follow(renderer, scene, cameras, size)
        first, whole = ([one[n] for one in times] for n in (0, 1))
        row = {**_figures("first", first), **_figures("whole", whole)}
        row |= {"cpu_ms": 1000.0 * float(np.median([one[2] for one in times])), "stages": max(one[3] for one in times)}
        if options.scale == 1.0:
            goals.append(Goal(f"{name}, first stage, 95th percentile", row["first_most"], 1000.0 * _FIRST, "ms"))
            goals.append(Goal(f"{name}, whole picture, 95th percentile", row["whole_most"], 1000.0 * _WHOLE, "ms"))
        return row

    wanted = {name: FIELDS[name] for name in options.rows or ROWS[:1]}
    return Report(
        name="interactive",
        title=f"{moves} camera moves at {size[0]}x{size[1]}, quality good, backend {options.backend}",
        columns=columns(
            "row=field, first_median=first stage ms, first_most=95 %, first_worst=worst, whole_median=whole ms, "
            "whole_most=95 %, whole_worst=worst, cpu_ms, stages, remark"
        ),
        rows=measured_rows(options, wanted, measure),
        goals=goals,
        notes=[
            "After each move of an orbit the picture is drawn by Renderer.progressive. first stage: until that "
            "is there; whole: until the last one, which is the picture of render; elapsed times. cpu ms: median "
            "processor time of all stages of a move.",
        ],
        environment=environment(device_of(renderer_for(options))),
    )
