"""Import time and first frame, in new processes."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence

import sheetsplat as ss
from bench.measure import clock, in_new_process, renderer_for, run_script
from bench.report import Goal, Options, Report, Row, columns
from sheetsplat import datasets

_IMPORT = """
import json, time
wall, cpu = time.perf_counter(), time.process_time()
import sheetsplat
print(json.dumps({"wall": time.perf_counter() - wall, "cpu": time.process_time() - cpu}))
"""


def first_frame(edge: int, backend: str, size: tuple[int, int]) -> Row:
    """Draw the noisy ball, whose samples exist before the clock starts; for a new process."""
    volume = datasets.noisy_ball(edge)

    def draw() -> ss.Image:
        scene = volume.scene()
        camera = ss.Camera.fit(scene.fields[0], direction=(-1.0, -0.7, -1.2))
        return renderer_for(Options(backend=backend)).render(scene, camera, size=(size[0], size[1]))

    _, wall, cpu = clock(draw)
    return {"wall": wall, "cpu": cpu}


def _row(name: str, runs: Sequence[Row]) -> Row:
    walls = [run["wall"] for run in runs]
    cpu = statistics.median(run["cpu"] for run in runs)
    return {"row": name, "seconds": statistics.median(walls), "least": min(walls), "cpu": cpu, "runs": len(runs)}


def _repeat(times: int, measure: Callable[[], Row]) -> list[Row]:
    return [measure() for _ in range(times)]


def run(options: Options) -> Report:
    """Measure both; one import that does not count fills the system's file cache."""
    options.say("import")
    imports = _row("import sheetsplat", _repeat(1 + max(3, options.views), lambda: dict(run_script(_IMPORT)))[1:])
    options.say("first frame")
    edge = options.edge(128)
    draw = {"edge": edge, "backend": options.backend, "size": options.size}
    name = f"field, renderer and first frame, {edge}^3"
    frames = _row(name, _repeat(options.views, lambda: in_new_process(first_frame, **draw)))
    return Report(
        name="startup",
        title="Import and first frame",
        columns=columns("row=what, seconds=s, least=least s, cpu=cpu s, runs"),
        rows=[imports, frames],
        notes=["Medians over new processes. The first frame includes making the field, the device and its programs."],
        goals=[Goal("import", imports["seconds"], 0.3, "s"), Goal("first frame", frames["seconds"], 1.5, "s")],
    )
