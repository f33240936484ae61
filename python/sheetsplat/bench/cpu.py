"""The processor's backend side by side with VTK on six scenes; what its work costs, how it grows, how exact it is."""

from __future__ import annotations

import json
import math
import os
import statistics
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sheetsplat as ss
from sheetsplat.bench._cpu_scenes import CASES, GRID, MATERIAL, SCATTERED, VIEWS, Case, gridded, sections, spheres
from sheetsplat.bench._measure import Judge, attempt, device_of, difference
from sheetsplat.bench._report import Goal, Options, Report, Row, environment
from sheetsplat.bench._vtk import CASTERS, Caster, Look, Shot, Volume, Vtk, VtkMissing
from sheetsplat.bench.startup import in_new_process
from sheetsplat.errors import Error
from sheetsplat.renderer import BACKENDS

#: Names of the parts that can be run alone.
ROWS = (*CASES, "rate", "threads", "kernels", "pixels", "memory", "camera", "psnr", "errors", "float64")

# A caster that is there for comparison only and takes longer than this for a frame is drawn in one round, s.
_SLOW = 0.4
_COUNTS = (10_000, 100_000, 1_000_000, 10_000_000)
_SIZES = (100, 200, 400, 800, 1600)
# Conventions, section 9: RMSE and P99.9 of scenes with gentle transfer functions, and of all.
_GENTLE = (2e-5, 2e-4)
_EVERY = (1e-4, 1e-3)
_STEEPEST = 10.0
# A program that prints [kernel sections a second on one core] for: spheres|ellipsoids, pixels of a section.
_BARE_LOOP = "sheetsplat_bare_loop"

_COLUMNS = {
    "row": "what",
    "drawn": "drawn",
    "slices": "slices",
    "ms": "ours ms, least",
    "median_ms": "median",
    "vtk_cpu_ms": "VTK CPU ms, least",
    "vtk_cpu_median_ms": "median ",
    "vtk_gpu_ms": "VTK GPU ms, least",
    "vtk_gpu_median_ms": "median  ",
    "opacity": "opacity",
    "vtk_opacity": "VTK's",
    "apart": "rmse to VTK",
    "measured": "measured",
    "goal": "goal",
    "quotient": "over goal",
    "verdict": "verdict",
    "by_cpu": "measured by cpu time",
    "load": "load",
    "remark": "remark",
}


def measured_backend(options: Options) -> str:
    """Return the backend that is measured: the one that was asked for, else "cpu" where this version has it."""
    if options.backend != "auto":
        return options.backend
    return "cpu" if "cpu" in BACKENDS else "gl"


def renderer(options: Options, **settings: Any) -> ss.Renderer:
    """Return a renderer of that backend. Unsupported where this version does not know a setting."""
    try:
        return ss.Renderer(**{"backend": measured_backend(options), **settings})
    except TypeError as error:
        raise ss.Unsupported(f"this version's Renderer does not take {', '.join(settings)}") from error


def judged(row: Row, goals: list[Goal], options: Options, goal: Goal) -> Row:
    """Return a row with a figure that is to be reached; at smaller scales it is shown and not judged."""
    row = {**row, "measured": goal.value, "goal": goal.bound, "unit": goal.unit}
    row["quotient"] = goal.value / goal.bound
    if options.scale == 1.0:
        goals.append(goal)
        row["verdict"] = "pass" if goal.reached else "MISS"
    return row


def _load() -> float:
    try:
        return os.getloadavg()[0]
    except OSError:
        return math.nan


# ------------------------------------------------------------------------------------------------- the six scenes


@dataclass
class Rounds:
    """Frames of every view, in rounds, in seconds.

    Between two frames of one view the camera went all round, so that nothing is kept from the first.
    """

    walls: list[list[float]] = field(default_factory=list)
    cpus: list[list[float]] = field(default_factory=list)

    def add(self, shots: Sequence[tuple[float, float]]) -> None:
        """Add a round: a wall time and a processor time a view."""
        self.walls.append([wall for wall, _ in shots])
        self.cpus.append([cpu for _, cpu in shots])

    @property
    def least(self) -> float:
        """The least time of each view, and their mean."""
        return statistics.fmean(map(min, zip(*self.walls, strict=True)))

    @property
    def median(self) -> float:
        """The median of each view, and their mean."""
        return statistics.fmean(map(statistics.median, zip(*self.walls, strict=True)))

    @property
    def least_cpu(self) -> float:
        """As `least`, by all processors of the process together."""
        return statistics.fmean(map(min, zip(*self.cpus, strict=True)))

    def row(self, prefix: str = "") -> Row:
        """Return the figures in milliseconds."""
        return {
            f"{prefix}ms": 1000.0 * self.least,
            f"{prefix}median_ms": 1000.0 * self.median,
            f"{prefix}cpu_ms": 1000.0 * self.least_cpu,
            f"{prefix}rounds": len(self.walls),
        }


def shot(one: ss.Renderer, scene: ss.Scene, camera: ss.Camera, size: tuple[int, int]) -> tuple[float, float, ss.Image]:
    """Return seconds by the clock and by the processors until the picture is a NumPy array, and the picture."""
    wall, cpu = time.perf_counter(), time.process_time()
    picture = one.render(scene, camera, size=size)
    np.asarray(picture)
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    return wall, cpu, picture


def round_of(
    one: ss.Renderer, scene: ss.Scene, cameras: Sequence[ss.Camera], size: tuple[int, int]
) -> tuple[list[tuple[float, float]], list[ss.Image]]:
    """Draw every view once."""
    shots = [shot(one, scene, camera, size) for camera in cameras]
    return [(wall, cpu) for wall, cpu, _ in shots], [picture for _, _, picture in shots]


def _not_empty(name: str, rgba: NDArray[np.float32]) -> float:
    """Return the mean opacity of a picture, which must show something."""
    opacity = float(rgba[..., 3].mean())
    if not opacity > 1e-3:
        raise Error(f"the benchmark is worth nothing: {name} shows an empty picture (mean opacity {opacity:.1e})")
    return opacity


@dataclass
class _Side:
    """One of VTK's casters beside ours."""

    caster: Caster
    done: bool = False
    rounds: Rounds = field(default_factory=Rounds)
    pictures: list[NDArray[np.float32]] = field(default_factory=list)


def _sides(
    vtk: Vtk, case: Case, volume: Volume, look: Look, cameras: list[ss.Camera], options: Options
) -> tuple[list[_Side], list[str]]:
    """Return the casters of VTK that can draw this, warmed up, each with its pictures."""
    sides: list[_Side] = []
    remarks: list[str] = []
    for caster in CASTERS:
        try:
            options.say(f"{case.title}: VTK, {caster}")
            vtk.show(caster, volume, look)
            vtk.frame(caster, cameras[-1])
            shots = [vtk.frame(caster, camera, picture=True) for camera in cameras]
        except VtkMissing as error:
            remarks.append(f"VTK {caster}: {error}")
            continue
        side = _Side(caster, pictures=[one.rgba for one in shots if one.rgba is not None])
        for one in side.pictures:
            _not_empty(f"VTK's {caster} caster", one)
        if caster != case.peer and statistics.median(one.wall for one in shots) > _SLOW:
            side.rounds.add([(one.wall, one.cpu) for one in shots])
            side.done = True
        sides.append(side)
    return sides, remarks


def _beside(
    case: Case, shaded: bool, volume: Volume | None, vtk: Vtk | None, options: Options
) -> tuple[Row, dict[Caster, Rounds], Rounds]:
    """Time ours and VTK's casters in turns on one scene."""
    size, cameras = options.size, case.cameras()
    kind = "shaded" if shaded else "flat"
    options.say(f"{case.title}, {kind}")
    scene, ours = case.scene(shaded=shaded), Rounds()
    one = renderer(options)
    first = shot(one, scene, cameras[-1], size)[2]
    look = Look(
        case.points,
        case.unit,
        case.distance,
        MATERIAL if shaded else None,
        size,
        _threads_of(first),
    )
    sides, remarks = ([], []) if vtk is None or volume is None else _sides(vtk, case, volume, look, cameras, options)
    pictures: list[ss.Image] = []
    for _ in range(options.views):
        shots, pictures = round_of(one, scene, cameras, size)
        ours.add(shots)
        for side in sides:
            assert vtk is not None
            if side.done:
                continue
            taken: list[Shot] = [vtk.frame(side.caster, camera) for camera in cameras]
            side.rounds.add([(frame.wall, frame.cpu) for frame in taken])
    row: Row = {
        "row": f"{case.title}, {kind}",
        "case": case.name,
        "shaded": shaded,
        "size": f"{size[0]}x{size[1]}",
        "distance": case.distance,
        "drawn": round(statistics.fmean(p.stats["kernels_drawn"] for p in pictures)),
        "slices": round(statistics.fmean(p.stats["slices"] for p in pictures)),
        "opacity": statistics.fmean(_not_empty("ours", p.rgba) for p in pictures),
        **ours.row(),
        "load": _load(),
    }
    for name in ("seconds_view", "seconds_bucket", "seconds_draw"):
        row[name] = statistics.median(p.stats.get(name, 0.0) for p in pictures)
    for side in sides:
        row |= side.rounds.row(f"vtk_{side.caster}_")
        opacity = statistics.fmean(float(rgba[..., 3].mean()) for rgba in side.pictures)
        apart = math.sqrt(
            statistics.fmean(
                float(np.square(p.rgba - rgba).mean()) for p, rgba in zip(pictures, side.pictures, strict=True)
            )
        )
        row[f"vtk_{side.caster}_opacity"], row[f"vtk_{side.caster}_apart"] = opacity, apart
        if side.caster == case.peer:
            row["vtk_opacity"], row["apart"] = opacity, apart
    if remarks:
        row["remark"] = "; ".join(remarks)
    _keep(options, f"{case.name}-{kind}", [p.rgba for p in pictures[:2]], [side.pictures[:2] for side in sides])
    return row, {side.caster: side.rounds for side in sides}, ours


def _threads_of(picture: ss.Image) -> int:
    """Return how many threads drew a picture, else those that this process may run."""
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, round(picture.stats.get("threads", usable)))


def _keep(
    options: Options, name: str, ours: list[NDArray[np.float32]], others: list[list[NDArray[np.float32]]]
) -> None:
    """Save views below each other, ours at the left, each of VTK's casters to the right of it; on black."""
    if options.pictures is None:
        return
    from PIL import Image as Pillow

    columns = [np.concatenate(column) for column in [ours, *others]]
    shown = np.rint(255.0 * np.clip(np.concatenate(columns, axis=1)[..., :3], 0.0, 1.0)).astype(np.uint8)
    options.pictures.mkdir(parents=True, exist_ok=True)
    Pillow.fromarray(shown).save(options.pictures / f"cpu-{name}.png")


def _case_rows(case: Case, vtk: Vtk | None, options: Options, goals: list[Goal]) -> list[Row]:
    """Time one scene shaded, and flat too where its kernels are scattered."""
    volume, remark = case.volume, ""
    if volume is None and vtk is not None:
        assert isinstance(case.field, ss.EllipsoidField)
        options.say(f"{case.title}: gridding")
        began = time.perf_counter()
        volume = gridded(case.field, case.edge, options.edge(GRID))
        spent = time.perf_counter() - began
        remark = f"VTK on a grid of {len(volume.values)}^3 after {spent:.1f} s of gridding"
    peer: list[Rounds] = []

    def measure(shaded: bool) -> Row:
        row, others, ours = _beside(case, shaded, volume, vtk, options)
        if remark:
            row["remark"] = "; ".join(filter(None, [remark, row.get("remark")]))
        if shaded and case.peer in others:
            peer.append(others[case.peer])
        if not peer:
            return row
        row["by_cpu"] = ours.least_cpu / peer[0].least_cpu
        # Flat pictures too are held against the peer's shaded one.
        text = f"{row['row']}, over VTK's {case.peer.upper()} caster" + ("" if shaded else ", shaded")
        return judged(row, goals, options, Goal(text, ours.least / peer[0].least, case.share))

    kinds = (True,) if case.volume is not None else (True, False)
    return [{"row": case.title} | attempt(partial(measure, shaded)) for shaded in kinds]


def _scenes(vtk: Vtk | None, options: Options, goals: list[Goal]) -> list[Row]:
    rows: list[Row] = []
    for name, make in CASES.items():
        if options.wants(name):
            rows += _case_rows(make(options), vtk, options, goals)
            if vtk is not None:
                vtk.forget()
    return rows


# ------------------------------------------------------------------------------------------------- rates and growth


def _bare_loop(kind: str, pixels: float) -> float:
    """Return kernel sections a second that the bare loop does on one core. FileNotFoundError where it is not built."""
    name = os.environ.get("SHEETSPLAT_BARE_LOOP", "")
    places = [Path(name)] if name else [Path("build") / _BARE_LOOP, *Path("build").glob(f"*/{_BARE_LOOP}")]
    program = next((place for place in places if place.is_file()), None)
    if program is None:
        raise FileNotFoundError(
            f"the program {_BARE_LOOP} is not built here (looked in build/; SHEETSPLAT_BARE_LOOP names it elsewhere)"
        )
    done = subprocess.run(
        [str(program.resolve()), kind, f"{pixels:.3f}"], capture_output=True, text=True, check=False, timeout=120
    )
    if done.returncode != 0:
        raise Error(f"{_BARE_LOOP} failed with code {done.returncode}: {done.stderr.strip()[-500:]}")
    return float(json.loads(done.stdout.strip().splitlines()[-1])[0])


def _section_pixels(field: ss.EllipsoidField, camera: ss.Camera, size: tuple[int, int], count: int) -> float:
    """Return the mean area of a section's ellipse in pixels: that of all supports' volumes over their sections."""
    scales = np.asarray(field.scales)
    volume = 4.0 / 3.0 * math.pi * (scales**3 if scales.ndim == 1 else scales.prod(axis=1)).sum()
    return float(volume * (size[1] / camera.height) ** 2 / max(count, 1))


def _rates(options: Options, goals: list[Goal]) -> list[Row]:
    """Measure kernel sections a second on one thread where hardly anything is done but splatting, and the bare loop."""
    rows = []
    for name in SCATTERED:

        def measure(name: str = name) -> Row:
            case = CASES[name](options)
            assert isinstance(case.field, ss.EllipsoidField)
            field, cameras = case.field, case.cameras()[:2]
            one = renderer(options, threads=1)
            # A line integral of an unnormalised field is a sum of its slices: one addition a pixel and slice.
            scene = case.scene(shaded=False, mode="xray")
            shot(one, scene, cameras[-1], options.size)
            least = [math.inf] * len(cameras)
            for _ in range(options.views):
                for n, camera in enumerate(cameras):
                    picture = shot(one, scene, camera, options.size)[2]
                    stats = picture.stats
                    least[n] = min(least[n], stats.get("seconds_splat", stats["seconds_draw"]))
            counts = [sections(field, camera, case.distance) for camera in cameras]
            rate = sum(counts) / sum(least)
            pixels = _section_pixels(field, cameras[0], options.size, counts[0])
            row: Row = {
                "row": f"sections a second on one thread: {name}",
                "sections": counts[0],
                "section_pixels": pixels,
                "rate": rate,
                "load": _load(),
                "remark": f"{1e-6 * rate:.2f} M sections/s of {pixels:.0f} pixels, x-ray",
            }
            try:
                bare = _bare_loop(name, pixels)
            except FileNotFoundError as error:
                row["remark"] += f"; {error}"
                return row
            row["bare"] = bare
            row["remark"] += f"; bare loop {1e-6 * bare:.2f} M"
            return judged(row, goals, options, Goal(f"the bare loop's rate over ours, {name}", bare / rate, 1.5))

        options.say(f"rate: {name}")
        rows.append({"row": f"sections a second: {name}"} | attempt(measure))
    return rows


def _two_threads(options: Options, goals: list[Goal]) -> list[Row]:
    rows = []
    for name in ("ball", *SCATTERED):

        def measure(name: str = name) -> Row:
            case = CASES[name](options)
            scene, cameras = case.scene(), case.cameras()
            both = {threads: (renderer(options, threads=threads), Rounds()) for threads in (1, 2)}
            last: dict[int, NDArray[np.float32]] = {}
            for one, _ in both.values():
                shot(one, scene, cameras[-1], options.size)
            for _ in range(options.views):
                for threads, (one, rounds) in both.items():
                    shots, pictures = round_of(one, scene, cameras, options.size)
                    rounds.add(shots)
                    last[threads] = pictures[-1].rgba
            alone, together = both[1][1], both[2][1]
            row: Row = {
                "row": f"one thread over two: {case.title}",
                "ms": 1000.0 * together.least,
                "alone_ms": 1000.0 * alone.least,
                "identical": bool(np.array_equal(last[1], last[2])),
                "load": _load(),
            }
            row["remark"] = f"{row['alone_ms']:.0f} ms alone; the same bits: {'yes' if row['identical'] else 'NO'}"
            goal = Goal(f"one thread over two, {name}", alone.least / together.least, 1.8, least=True)
            return judged(row, goals, options, goal)

        options.say(f"threads: {name}")
        rows.append({"row": f"one thread over two: {name}"} | attempt(measure))
    return rows


# Kernels of radius 3 pixels in a block 64 deep that fills the picture. The arrays are the caller's, and there before
# the clock starts; so are the renderer and whatever it makes once.
_GROWTH = """
import json, math, statistics, sys, time
import numpy as np
import sheetsplat as ss
from sheetsplat.datasets._random import Stream

def resident(name):
    with open("/proc/self/status") as status:
        return 1024 * next(int(line.split()[1]) for line in status if line.startswith(name))

count, side, views, backend = int(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), sys.argv[4]
size = np.array([side, side, 64.0])
centers, values = np.empty((count, 3)), np.empty(count)
random = Stream(2006)
for first in range(0, count, 1 << 16):
    part = slice(first, min(first + (1 << 16), count))
    drawn = random.uniform(part.stop - part.start, 4)
    centers[part], values[part] = size * drawn[:, :3], drawn[:, 3]
points = [(0.0, 0.1, 0.2, 0.9, 0.0), (0.5, 0.2, 0.9, 0.3, 0.005), (1.0, 1.0, 0.8, 0.2, 0.02)]

def scene_of(field):
    return ss.Scene(field, points, slice_spacing=1.0, reference_length=1.0, opacity_stop=1.0, lights=[ss.Light()])

def camera(view):
    # A few degrees off the block's own axes: it still fills the picture, and no frame is that before it.
    turn = 0.02 + 0.01 * view
    away = (math.sin(turn), 0.5 * math.sin(turn), math.cos(turn))
    middle = 0.5 * size
    return ss.Camera.orthographic(tuple(middle + 200.0 * np.array(away)), tuple(middle), height=float(side))

renderer = ss.Renderer(backend)
few = slice(0, min(count, 64))
renderer.render(scene_of(ss.EllipsoidField(centers[few], 3.0, None, values[few])), camera(0), size=(side, side))
scene = scene_of(ss.EllipsoidField(centers, 3.0, None, values))
try:
    # From here on the mark counts anew: making the field took memory that is no renderer's.
    with open("/proc/self/clear_refs", "w") as mark:
        mark.write("5")
except OSError:
    pass
before = resident("VmRSS:")
walls, cpus, stats = [], [], []
for view in range(1 + views):
    wall, cpu = time.perf_counter(), time.process_time()
    picture = renderer.render(scene, camera(view), size=(side, side))
    walls.append(time.perf_counter() - wall)
    cpus.append(time.process_time() - cpu)
    stats.append(picture.stats)
if not picture.rgba[..., 3].mean() > 1e-4:
    sys.exit("the picture is empty")
last = stats[-1]
made = [one.get("seconds_view", 0.0) + one.get("seconds_bucket", 0.0) for one in stats[1:]]
named = sum(last.get(name, 0.0) for name in ("bytes_index", "bytes_view"))
print(json.dumps([
    last["kernels_drawn"], last["slices"], walls[0], min(walls[1:]), min(cpus[1:]), min(made),
    statistics.median(made), stats[0].get("seconds_index", 0.0), resident("VmHWM:") - before, named,
    float(picture.rgba[..., 3].mean()),
]))
"""


def _grown(series: str, count: int, side: int, options: Options) -> Row:
    options.say(f"{series}: {count:,} kernels, {side}x{side}")
    arguments = (str(count), str(side), str(min(3, options.views)), measured_backend(options))
    found = in_new_process(_GROWTH, *arguments)
    drawn, slices, first, wall, cpu, made, usual, index, peak, named, opacity = found
    return {
        "row": f"{series}: {count:,} kernels at {side}x{side}",
        "count": count,
        "drawn": round(drawn),
        "slices": round(slices),
        "ms": 1000.0 * wall,
        "cpu_ms": 1000.0 * cpu,
        "first_ms": 1000.0 * first,
        "index_ms": 1000.0 * index,
        "prepared_ms": 1000.0 * made,
        "prepared_median_ms": 1000.0 * usual,
        "peak": peak,
        "bytes": named,
        "opacity": opacity,
        "load": _load(),
        "remark": f"cpu {1000.0 * cpu:.1f} ms, {1e6 * cpu / count:.2f} us a kernel",
    }


def exponent(rows: Sequence[Row], name: str) -> float:
    """Return the exponent p of cpu time = c * figure^p: a straight line through the rows, in logarithms."""
    if len(rows) < 2:
        return math.nan
    figures, times = ([math.log(row[one]) for row in rows] for one in (name, "cpu_ms"))
    return float(np.polyfit(figures, times, 1)[0])


def _laws(title: str, rows: list[Row], name: str, options: Options, goals: list[Goal]) -> list[Row]:
    """Return the exponents over all rows and over the last two, where what a frame costs anyhow counts least."""
    found = []
    for part, over in ((rows, "all"), (rows[-2:], "the last two")):
        value = exponent(part, name)
        row: Row = {"row": f"exponent over {over}: {title}", "remark": "cpu time"}
        found.append(judged(row, goals, options, Goal(f"exponent over {over}: {title}", value, 1.05)))
    return found


def _kernels(options: Options, goals: list[Goal]) -> list[Row]:
    """Grow the number of kernels: with the picture, so that as many lie over each pixel, and in one picture."""
    counts = sorted({max(1000, round(count * options.scale**3)) for count in _COUNTS})
    # Five kernels over two pixels: 100,000 of them fill 200 x 200.
    both = [_grown("kernels with pixels", n, round(math.sqrt(0.4 * n)), options) for n in counts]
    both += _laws("kernels and pixels together", both, "count", options, goals)
    grown = [_grown("kernels", n, options.size[0], options) for n in counts]
    most = grown[-1]
    row: Row = {
        "row": f"memory of {most['count']:,} spheres, a drawn kernel, beside the field",
        "drawn": most["drawn"],
        "remark": f"bytes; the process's peak over what it had with the field; {_kept(most)}",
    }
    goal = Goal("memory a drawn kernel beside the data, spheres", most["peak"] / most["drawn"], 64.0, "bytes")
    laws = _laws("kernels in one picture", grown, "count", options, goals)
    return [*both, *grown, *laws, judged(row, goals, options, goal)]


def _kept(row: Row) -> str:
    return f"index and view: {row['bytes'] / row['drawn']:.1f}"


def _pixels(options: Options, goals: list[Goal]) -> list[Row]:
    case = CASES["ball"](options)
    scene, cameras = case.scene(), case.cameras()[:3]
    one, rows = renderer(options), []
    for side in sorted({max(8, round(edge * options.scale)) for edge in _SIZES}):
        options.say(f"pixels: {side}x{side}")
        rounds, size = Rounds(), (side, side)
        shot(one, scene, cameras[-1], size)
        for _ in range(min(3, options.views)):
            rounds.add(round_of(one, scene, cameras, size)[0])
        row: Row = {"row": f"pixels: {case.title} at {side}x{side}", "pixels": side * side, **rounds.row()}
        rows.append({**row, "load": _load(), "remark": f"cpu {row['cpu_ms']:.1f} ms"})
    return rows + _laws("pixels, the ball", rows, "pixels", options, goals)


# The bytes of a lattice: what the process takes while it draws, over what it had with the field.
_LATTICE = """
import json, sys
import sheetsplat as ss
from sheetsplat.bench import Options
from sheetsplat.bench._cpu_scenes import CASES

def resident(name):
    with open("/proc/self/status") as status:
        return 1024 * next(int(line.split()[1]) for line in status if line.startswith(name))

small, size = CASES["ball"](Options(scale=0.25)), (int(sys.argv[3]), int(sys.argv[4]))
renderer = ss.Renderer(sys.argv[1])
renderer.render(small.scene(), small.cameras()[0], size=size)
case = CASES["ml256"](Options(scale=float(sys.argv[2])))
scene = case.scene()
try:
    with open("/proc/self/clear_refs", "w") as mark:
        mark.write("5")
except OSError:
    pass
before = resident("VmRSS:")
for camera in case.cameras()[:2]:
    stats = renderer.render(scene, camera, size=size).stats
named = sum(stats.get(name, 0.0) for name in ("bytes_index", "bytes_view"))
print(json.dumps([stats["kernels_drawn"], resident("VmHWM:") - before, named]))
"""


def _memory(options: Options, goals: list[Goal]) -> list[Row]:
    options.say("memory: Marschner-Lobb")
    arguments = (measured_backend(options), str(options.scale), str(options.size[0]), str(options.size[1]))
    drawn, peak, named = in_new_process(_LATTICE, *arguments)
    row: Row = {
        "row": "memory of Marschner-Lobb, 256^3, a drawn kernel, beside the field",
        "drawn": round(drawn),
        "peak": peak,
        "bytes": named,
        "load": _load(),
    }
    row["remark"] = f"bytes; the process's peak over what it had with the field; {_kept(row)}"
    return [judged(row, goals, options, Goal("memory a drawn kernel beside the data, lattice", peak / drawn, 64.0))]


def _camera(options: Options, goals: list[Goal]) -> list[Row]:
    """Measure what is prepared anew for each view of a million scattered kernels."""
    edge = options.edge(128)
    count = max(64, round(1_000_000 * (edge / 128) ** 3))
    options.say(f"camera: {count:,} kernels")
    example = CASES["spheres"](options)
    case = Case(**{**vars(example), "field": spheres(count, edge), "distance": 1.0})
    scene, cameras = case.scene(), case.cameras()
    one = renderer(options)
    first = shot(one, scene, cameras[-1], options.size)[2].stats
    found = []
    for _ in range(min(3, options.views)):
        for camera in cameras:
            stats = shot(one, scene, camera, options.size)[2].stats
            # Backends differ in how they name what they sort and make for a view.
            names = ("seconds_index", "seconds_view", "seconds_bucket", "seconds_vertices")
            found.append(sum(stats.get(name, 0.0) for name in names))
    row: Row = {
        "row": f"a camera change of {count:,} spheres prepared",
        "drawn": round(stats["kernels_drawn"]),
        "slices": round(stats["slices"]),
        "median_ms": 1000.0 * statistics.median(found),
        "load": _load(),
        "remark": f"ms, the least; the index, made once: {1000.0 * first.get('seconds_index', 0.0):.0f} ms",
    }
    goal = Goal("a camera change of a million kernels prepared", 1000.0 * min(found), 40.0, "ms")
    return [judged(row, goals, options, goal)]


# ------------------------------------------------------------------------------------------------- how exact


def decibels(rmse: float) -> float:
    """Return a distance of pictures in [0, 1] as a peak signal-to-noise ratio."""
    return math.inf if rmse == 0.0 else -20.0 * math.log10(rmse)


def _converged(options: Options, vtk: Vtk | None, goals: list[Goal]) -> list[Row]:
    """Compare flat pictures of the scattered scenes, ours and those of VTK's grid, with what small distances give."""
    rows: list[Row] = []
    for name in SCATTERED:

        def measure(name: str = name) -> Row:
            case = CASES[name](options)
            assert isinstance(case.field, ss.EllipsoidField)
            cameras = [case.cameras()[n] for n in (0, 3)]
            one = renderer(options)
            scene = case.scene(shaded=False)
            finer = [
                case.scene(shaded=False, slice_spacing=case.distance / parts, reference_length=case.unit)
                for parts in (8, 16)
            ]
            fine = [one.render(finer[1], camera, size=options.size) for camera in cameras]
            pictures = [one.render(scene, camera, size=options.size) for camera in cameras]
            worst = max(difference(p, f)["rmse"] for p, f in zip(pictures, fine, strict=True))
            left = difference(one.render(finer[0], cameras[0], size=options.size), fine[0])["rmse"]
            row: Row = {
                "row": f"PSNR, flat, of the converged picture: {name}",
                "rmse": worst,
                "load": _load(),
                "remark": f"dB; distance 1/8 and 1/16 differ by {decibels(left):.0f} dB",
            }
            if vtk is not None:
                try:
                    look = Look(case.points, case.unit, case.distance, None, options.size, 2)
                    volume = gridded(case.field, case.edge, options.edge(GRID))
                    for caster in CASTERS:
                        vtk.show(caster, volume, look)
                        shots = [vtk.frame(caster, camera, picture=True).rgba for camera in cameras]
                        apart = max(
                            math.sqrt(float(np.square(rgba - f.rgba).mean()))
                            for rgba, f in zip(shots, fine, strict=True)
                            if rgba is not None
                        )
                        row[f"vtk_{caster}_psnr"] = decibels(apart)
                        row["remark"] += f"; grid and VTK {caster.upper()} {decibels(apart):.1f} dB"
                except VtkMissing as error:
                    row["remark"] += f"; VTK: {error}"
            goal = Goal(f"PSNR of {name}, flat, against the converged picture", decibels(worst), 50.0, "dB", least=True)
            return judged(row, goals, options, goal)

        options.say(f"psnr: {name}")
        rows.append({"row": f"PSNR: {name}"} | attempt(measure))
    return rows


def steepness(case: Case) -> float:
    """Return how steep opacity and colours are, times the slice distance over the reference length, over the range."""
    table = np.array(case.points)
    rise = np.abs(np.diff(table[:, 1:], axis=0)) / np.diff(table[:, 0])[:, None]
    return float(rise.max() * (table[-1, 0] - table[0, 0]) * case.distance / case.unit)


def _errors(options: Options, goals: list[Goal]) -> list[Row]:
    """Measure the shaded pictures' distance from the reference; pixels where opacity stops nearby are left out."""
    rows: list[Row] = []
    reference = ss.Renderer(backend="reference")
    for name in CASES:
        options.say(f"errors: {name}")
        case = CASES[name](options)
        scene, camera = case.scene(), case.cameras()[0]
        judge = Judge(options.size, options.reference_seconds)
        expected = judge.reference(scene, camera)
        size = expected.size
        jumps = np.zeros(size[::-1], bool)
        if case.opacity_stop < 1.0:
            for step in (-1e-5, 1e-5):
                moved = reference.render(case.scene(opacity_stop=case.opacity_stop + step), camera, size=size)
                jumps |= np.abs(moved.rgba - expected.rgba).max(axis=-1) > 1e-3

        def measure(
            name: str = name,
            case: Case = case,
            scene: ss.Scene = scene,
            camera: ss.Camera = camera,
            expected: ss.Image = expected,
            jumps: NDArray[np.bool_] = jumps,
        ) -> Row:
            picture = renderer(options).render(scene, camera, size=expected.size).rgba
            apart = np.where(jumps[..., None], 0.0, picture.astype(np.float64) - expected.rgba)
            rmse = math.sqrt(float(np.square(apart).mean()))
            p99_9 = float(np.percentile(np.abs(apart).max(axis=-1), 99.9))
            bounds = _GENTLE if steepness(case) <= _STEEPEST else _EVERY
            row: Row = {
                "row": f"error, shaded: {case.title}",
                "rmse": rmse,
                "p99_9": p99_9,
                "ambiguous": float(jumps.mean()),
                "load": _load(),
            }
            row["remark"] = (
                f"RMSE {rmse:.1e} of {bounds[0]:.0e}, P99.9 {p99_9:.1e} of {bounds[1]:.0e}, "
                f"{100.0 * row['ambiguous']:.2g} % at jumps; {expected.size[0]}x{expected.size[1]}"
            )
            worst = max(rmse / bounds[0], p99_9 / bounds[1], row["ambiguous"] / 0.005)
            return judged(row, goals, options, Goal(f"error of {name}, shaded, in parts of the bounds", worst, 1.0))

        rows.append({"row": f"error, shaded: {case.title}"} | attempt(measure))
    return rows


def _float64(options: Options, goals: list[Goal]) -> list[Row]:
    """Time float64 beside float32 and the reference, in a small picture of the same view."""
    rows: list[Row] = []
    size = (max(8, options.size[0] // 2), max(8, options.size[1] // 2))
    for name in ("ball", *SCATTERED):

        def measure(name: str = name) -> Row:
            case = CASES[name](options)
            scene, cameras = case.scene(), case.cameras()[:2]
            exact, usual = (renderer(options, precision=kind) for kind in ("float64", "float32"))
            exact.plan(scene, cameras[0], size=size)
            wall, cpu, expected = shot(ss.Renderer(backend="reference"), scene, cameras[0], size)
            times = []
            for one in (exact, usual):
                shot(one, scene, cameras[-1], size)
                rounds = Rounds()
                for _ in range(min(3, options.views)):
                    rounds.add(round_of(one, scene, cameras, size)[0])
                times.append(rounds)
            errors = [difference(one.render(scene, cameras[0], size=size), expected)["rmse"] for one in (exact, usual)]
            row: Row = {
                "row": f"float64, time over the reference's: {case.title}",
                "ms": 1000.0 * times[0].least,
                "float32_ms": 1000.0 * times[1].least,
                "reference_ms": 1000.0 * wall,
                "rmse": errors[0],
                "float32_rmse": errors[1],
                "load": _load(),
            }
            row["remark"] = (
                f"float32 {row['float32_ms']:.0f} ms, reference {row['reference_ms']:.0f} ms (cpu {1000.0 * cpu:.0f}); "
                f"RMSE {errors[0]:.1e}, float32 {errors[1]:.1e}; {size[0]}x{size[1]}"
            )
            return judged(row, goals, options, Goal(f"float64 over the reference, {name}", times[0].least / wall, 0.1))

        options.say(f"float64: {name}")
        rows.append({"row": f"float64: {name}"} | attempt(measure))
    return rows


# ------------------------------------------------------------------------------------------------- all together


@contextmanager
def _peer(options: Options) -> Iterator[tuple[Vtk | None, str]]:
    """Give VTK where it is wanted and there, and what to say of it."""
    if not any(options.wants(row) for row in (*CASES, "psnr")):
        yield None, "VTK was not needed."
        return
    try:
        vtk = Vtk()
    except VtkMissing as error:
        yield None, f"Without VTK: {error}."
        return
    with vtk:
        yield (
            vtk,
            f"VTK {vtk.version} in a process of its own: {CASTERS['cpu']} (as many threads as ours, image sample "
            f"distance 1, no automatic or interactive adjustment) and {CASTERS['gpu']} (no jittering), parallel "
            "projection, linear interpolation, read back by GetRGBACharPixelData. Its rays end at an opacity of some "
            "0.99.",
        )


def run(options: Options) -> Report:
    """Measure whatever rows are wanted."""
    rows: list[Row] = []
    goals: list[Goal] = []
    backend = measured_backend(options)
    with _peer(options) as (vtk, told):
        rows += _scenes(vtk, options, goals)
        parts: dict[str, Callable[[], list[Row]]] = {
            "rate": lambda: _rates(options, goals),
            "threads": lambda: _two_threads(options, goals),
            "kernels": lambda: _kernels(options, goals),
            "pixels": lambda: _pixels(options, goals),
            "memory": lambda: _memory(options, goals),
            "camera": lambda: _camera(options, goals),
            "psnr": lambda: _converged(options, vtk, goals),
            "errors": lambda: _errors(options, goals),
            "float64": lambda: _float64(options, goals),
        }
        for name, measure in parts.items():
            if options.wants(name):
                rows += measure()
    notes = [
        f"Scenes: {VIEWS} views on an orbit, each drawn {options.views} times with the others between; the least (and "
        "the median) of each view, then the mean over the views, in ms by the clock, from the change of the camera "
        "until the picture is an array. Ours and VTK's casters take turns. measured: our time over that of VTK, least "
        "by least; beside it the same by the time of all processors of each process, which holds where others use the "
        "machine too.",
        told,
        "opacity: mean over the picture and the views, ours and that of the caster that counts; rmse to VTK: of "
        "premultiplied RGBA, the two reconstruct differently. load: running processes, a mean over the last minute.",
        "Kernels with pixels: radius 3 pixels, 64 deep, five kernels to two pixels, so that overlap and work for a "
        "pixel stay. Kernels: the same ones in one picture. Fitted: cpu time = c x number ^ exponent.",
    ]
    if backend != "cpu":
        notes.insert(0, f"Measured here is backend {backend}, not cpu.")
    return Report(
        name="cpu",
        title=f"Backend {backend} at {options.size[0]}x{options.size[1]}",
        columns=_COLUMNS,
        rows=rows,
        notes=notes,
        goals=goals,
        environment=environment(device_of(renderer(options))) | {"threads": str(_usable())},
    )


def _usable() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
