"""How time and memory grow with the number of scattered kernels, up to ten million."""

from __future__ import annotations

import math

import numpy as np

from sheetsplat.bench._measure import device_of, renderer_for
from sheetsplat.bench._report import Goal, Options, Report, Row, environment
from sheetsplat.bench.startup import in_new_process

_COUNTS = (10_000, 100_000, 1_000_000, 10_000_000)
_SIZE = (200, 200)
_OVERLAP = 6.0
_MEGA = 1e-6

_COLUMNS = {
    "row": "kernels",
    "radius": "radius",
    "spacing": "ds",
    "slices": "slices",
    "splats": "splats",
    "field_ms": "field ms",
    "first_ms": "first frame ms",
    "index_ms": "grid ms",
    "wall_ms": "further ms",
    "cpu_ms": "cpu ms",
    "view_ms": "view ms",
    "vertices_ms": "records ms",
    "us_a_kernel": "cpu us a kernel",
    "kept": "kept bytes a kernel",
    "resident": "peak over arrays MB",
    "per_kernel": "bytes a kernel",
}

# The arrays are the caller's and there before the clock starts; the context and its programs are there too.
_SCRIPT = """
import json, math, statistics, sys, time
import numpy as np
import sheetsplat as ss
from sheetsplat.datasets._random import Stream

def resident(name):
    # The kernel's own mark for this program; that of getrusage would begin with the size of the parent process.
    with open("/proc/self/status") as status:
        return 1024 * next(int(line.split()[1]) for line in status if line.startswith(name))

count, views, width, height = (int(sys.argv[n]) for n in (1, 2, 3, 4))
overlap, backend, edge = float(sys.argv[5]), sys.argv[6], 128.0
radius = (overlap * edge**3 / (4.0 / 3.0 * math.pi * count)) ** (1.0 / 3.0)
centers, radii, values = np.empty((count, 3)), np.full(count, radius), np.empty(count)
random = Stream(2006)
for first in range(0, count, 1 << 16):
    part = slice(first, min(first + (1 << 16), count))
    drawn = random.uniform(part.stop - part.start, 4)
    centers[part], values[part] = edge * drawn[:, :3], drawn[:, 3]
points = [(0.0, 0.1, 0.2, 0.9, 0.0), (0.5, 0.2, 0.9, 0.3, 0.02), (1.0, 1.0, 0.8, 0.2, 0.1)]

def scene_of(field):
    return ss.Scene(field, points, lights=[ss.Light((0.3, 0.5, 1.0))])

def camera(view):
    turn, rise = 0.6 + 0.3 * view, 0.4
    away = (math.sin(turn) * math.cos(rise), math.sin(rise), math.cos(turn) * math.cos(rise))
    eye = tuple(0.5 * edge + 3.0 * edge * part for part in away)
    return ss.Camera.orthographic(eye, (0.5 * edge,) * 3, height=1.25 * edge)

renderer = ss.Renderer(backend)
few = slice(0, min(count, 64))
small = scene_of(ss.EllipsoidField(centers[few], radii[few] * 4.0, None, values[few]))
renderer.render(small, camera(0), size=(width, height))
before = resident("VmRSS:")
wall = time.perf_counter()
field = ss.EllipsoidField(centers, radii, None, values)
made = time.perf_counter() - wall
scene = scene_of(field)
walls, cpus, stats = [], [], []
for view in range(1 + views):
    wall, cpu = time.perf_counter(), time.process_time()
    picture = renderer.render(scene, camera(view), size=(width, height))
    walls.append(time.perf_counter() - wall)
    cpus.append(time.process_time() - cpu)
    stats.append(picture.stats)
if not np.any(picture.rgba):
    sys.exit("the picture is empty")

def median(name):
    return statistics.median(one.get(name, 0.0) for one in stats[1:])

kept = field.memory + stats[-1].get("bytes_index", 0.0) + stats[-1].get("bytes_view", 0.0)
print(json.dumps([
    radius, scene.slice_spacing, median("slices"), median("splats"), made, walls[0],
    stats[0].get("seconds_index", 0.0), statistics.median(walls[1:]), statistics.median(cpus[1:]),
    median("seconds_view"), median("seconds_vertices"), kept, resident("VmHWM:") - before,
]))
"""


def _row(count: int, options: Options, size: tuple[int, int]) -> Row:
    views = min(3, options.views)
    arguments = (str(count), str(views), str(size[0]), str(size[1]), str(_OVERLAP), options.backend)
    figures = in_new_process(_SCRIPT, *arguments)
    radius, spacing, slices, splats, made, first, index, wall, cpu, view, vertices, kept, resident = figures
    return {
        "row": count,
        "radius": radius,
        "spacing": spacing,
        "slices": round(slices),
        "splats": round(splats),
        "field_ms": 1000.0 * made,
        "first_ms": 1000.0 * first,
        "index_ms": 1000.0 * index,
        "wall_ms": 1000.0 * wall,
        "cpu_ms": 1000.0 * cpu,
        "view_ms": 1000.0 * view,
        "vertices_ms": 1000.0 * vertices,
        "us_a_kernel": 1e6 * cpu / count,
        "kept": kept / count,
        "resident": _MEGA * resident,
        "per_kernel": resident / count,
    }


def exponent(rows: list[Row], name: str) -> float:
    """Return the exponent of a figure over the number of kernels: a straight line through all rows, in logarithms."""
    if len(rows) < 2:
        return math.nan
    counts, figures = ([math.log(row[one]) for row in rows] for one in ("row", name))
    return float(np.polyfit(counts, figures, 1)[0])


def run(options: Options) -> Report:
    """Draw growing numbers of spheres, each in a new process."""
    size = (min(_SIZE[0], options.size[0]), min(_SIZE[1], options.size[1]))
    counts = sorted({max(100, round(count * options.scale**3)) for count in _COUNTS})
    rows: list[Row] = []
    for count in counts:
        options.say(f"{count:,} kernels")
        rows.append(_row(count, options, size))
    goals = []
    if options.scale == 1.0:
        goals.append(Goal("memory over the caller's arrays for ten million", rows[-1]["per_kernel"], 100.0, "bytes"))
        goals.append(Goal("exponent of the time of a frame over the last decade", exponent(rows[-2:], "cpu_ms"), 1.1))
    upper = rows[-2:]
    return Report(
        name="scattered_scaling",
        title=f"Spheres that overlap {_OVERLAP:g} times everywhere, shaded, at {size[0]}x{size[1]}",
        columns=_COLUMNS,
        rows=rows,
        notes=[
            f"Each in a new process. A further frame: medians over {min(3, options.views)} other views, at the default "
            "slice distance, which follows the kernels' size.",
            f"Time of a further frame grows with the kernels to the power {exponent(rows, 'cpu_ms'):.2f} (cpu; all "
            f"rows), {exponent(upper, 'cpu_ms'):.2f} between the last two; that of the first frame by the clock "
            f"{exponent(upper, 'first_ms'):.2f}.",
            "bytes a kernel: the largest resident memory over that before the field was made, with the caller's "
            "float64 arrays, the context and its programs there already; the field's own copy is in it (kept: field, "
            "grid and view as they remain). Some MB are there whatever the number is.",
        ],
        goals=goals,
        environment=environment(device_of(renderer_for(options))),
    )
