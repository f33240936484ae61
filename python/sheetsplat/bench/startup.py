"""Import time and first frame, each in processes of their own."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys

from sheetsplat.bench._report import Goal, Options, Report, Row, environment
from sheetsplat.errors import Error

_COLUMNS = {"row": "what", "seconds": "s", "least": "least s", "cpu": "cpu s", "runs": "runs"}

_IMPORT = """
import json, time
wall, cpu = time.perf_counter(), time.process_time()
import sheetsplat
print(json.dumps([time.perf_counter() - wall, time.process_time() - cpu]))
"""

# The volume is made before the clock starts: a user has it already.
_FRAME = """
import json, sys, time
import sheetsplat
from sheetsplat import datasets
volume = datasets.noisy_ball(int(sys.argv[1]))
wall, cpu = time.perf_counter(), time.process_time()
scene = volume.scene()
camera = sheetsplat.Camera.fit(scene.fields[0], direction=(-1.0, -0.7, -1.2))
sheetsplat.Renderer(sys.argv[2]).render(scene, camera, size=(int(sys.argv[3]), int(sys.argv[4])))
print(json.dumps([time.perf_counter() - wall, time.process_time() - cpu]))
"""


def in_new_process(script: str, *arguments: str) -> list[float]:
    """Run a script in a new interpreter and return the numbers that it prints as its last line."""
    # The package is found where this process found it, whatever the folder and the path are.
    prelude = f"import sys; sys.path[:] = {sys.path!r}\n"
    done = subprocess.run(
        [sys.executable, "-c", prelude + script, *arguments], capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        raise Error(f"the benchmark's process failed with code {done.returncode}: {done.stderr.strip()[-2000:]}")
    numbers: list[float] = json.loads(done.stdout.strip().splitlines()[-1])
    return numbers


def _row(name: str, runs: list[list[float]]) -> Row:
    return {
        "row": name,
        "seconds": statistics.median(run[0] for run in runs),
        "least": min(run[0] for run in runs),
        "cpu": statistics.median(run[1] for run in runs),
        "runs": len(runs),
    }


def run(options: Options) -> Report:
    """Measure both, the first time uncounted: it fills the system's file cache."""
    options.say("import")
    in_new_process(_IMPORT)
    imports = _row("import sheetsplat", [in_new_process(_IMPORT) for _ in range(max(3, options.views))])
    edge = options.edge(128)
    options.say("first frame")
    arguments = (str(edge), options.backend, str(options.size[0]), str(options.size[1]))
    frames = _row(
        f"field, renderer and first frame, {edge}^3", [in_new_process(_FRAME, *arguments) for _ in range(options.views)]
    )
    return Report(
        name="import",
        title="Import and first frame",
        columns=_COLUMNS,
        rows=[imports, frames],
        notes=["Medians over new processes. The first frame includes making the field, the device and its programs."],
        goals=[
            Goal("import", imports["seconds"], 0.3, "s"),
            Goal("first frame", frames["seconds"], 1.5, "s"),
        ],
        environment=environment(),
    )
