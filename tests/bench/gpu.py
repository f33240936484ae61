"""What graphics hardware does, in eight minutes: paths, tests, techniques, the papers' tables, effects, 1080p."""

from __future__ import annotations

import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import sheetsplat as ss
from bench import ablation, cliffs, table2005, table2006
from bench.effect_costs import EFFECTS, Conditions, Subject, surface
from bench.measure import attempt, device_of, need_gl, orbit, renderer_for, time_frames, usable_processors
from bench.report import Goal, Options, Report, Row, columns, environment
from bench.scenes import SCATTERED_POINTS, spheres

# Seconds that all of it may take; what has not begun by then is left out. The tests end earlier, with what is left.
_SECONDS = 480.0
_TEST_SECONDS = 200.0
# Of the papers' frame rates, and frames a second at 1080p.
_WANTED_TIMES, _WANTED_RATE = 100.0, 60.0
_FULL_HD = (1920, 1080)
_COUNTS = (1_000_000, 10_000_000)
# Spheres of this number fill a cube of this edge as densely as the other benchmarks' do.
_DENSE, _DENSE_EDGE = 100_000, 128.0
_VIEWS = 3
_REFERENCE_SECONDS = 1.0
_TECHNIQUES = ("skipping", "packing", "buffers", "elimination", "opacity buffer")
_FIELDS = ("engine", "ellipsoids")
_WAVE_POINTS = [
    (0.0, 0.1, 0.2, 0.8, 0.0),
    (100.0, 0.2, 0.8, 0.4, 0.0),
    (180.0, 1.0, 0.7, 0.3, 0.3),
    (255.0, 1.0, 1.0, 1.0, 0.6),
]
_ROOT = Path(__file__).resolve().parents[2]


# ------------------------------------------------------------------------------------------------------------- tests


def tested(command: Sequence[str], report: Path, seconds: float, folder: Path) -> Row:
    """Return how many tests of a runner passed, failed and were skipped.

    Parameters
    ----------
    command
        Writes `report`, JUnit's XML.
    report
        Path of the report.
    seconds
        The run is ended after so many; what it found until then is lost.
    folder
        Working folder.
    """
    began = time.perf_counter()
    try:
        subprocess.run(command, cwd=folder, capture_output=True, timeout=seconds, check=False)
    except (subprocess.TimeoutExpired, OSError) as error:
        return {"remark": f"not run: {error}"}
    if not report.is_file():
        return {"remark": "not run: the runner wrote no report"}
    counts = dict.fromkeys(("tests", "failures", "errors", "skipped"), 0)
    names: list[str] = []
    for case in ElementTree.parse(report).iter("testcase"):
        counts["tests"] += 1
        for kind, tag in (("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
            if case.find(tag) is not None:
                counts[kind] += 1
                if kind != "skipped":
                    names.append(f"{case.get('classname', '')}::{case.get('name')}")
    failed = counts["failures"] + counts["errors"]
    row: Row = {"passed": counts["tests"] - failed - counts["skipped"], "failed": failed, "skipped": counts["skipped"]}
    row["wall_ms"] = 1000.0 * (time.perf_counter() - began)
    return row | ({"remark": "failed: " + ", ".join(names)} if names else {})


def _tests(options: Options, seconds: Callable[[], float]) -> list[Row]:
    quick = options.scale < 1.0
    processes = str(max(1, usable_processors() // 2))
    rows: list[Row] = []
    with TemporaryDirectory() as made:
        build, report = _ROOT / "build", Path(made) / "report.xml"
        options.say("tests of C++ that need OpenGL")
        if (build / "tests" / "cpp").is_dir():
            labels = ["-C", "quick", "-L", "quick"] if quick else ["-L", "gl|image"]
            ctest = ["ctest", *labels, "-j", processes, "--output-junit", str(report)]
            found = tested(ctest, report, min(_TEST_SECONDS, seconds()), build)
        else:
            found = {"remark": "not run: the C++ tests are not built; ./run build builds them"}
        rows.append({"row": "C++ tests", **found})
        options.say("tests of Python that need OpenGL")
        report.unlink(missing_ok=True)
        pytest = [sys.executable, "-m", "pytest", "-m", "gl", "-n", processes, f"--junit-xml={report}"]
        found = tested([*pytest, *(["--quick"] if quick else [])], report, min(_TEST_SECONDS, seconds()), _ROOT)
        rows.append({"row": "Python tests", **found})
    return rows


# ------------------------------------------------------------------------------------------------------------ pictures


def _techniques(options: Options, seconds: Callable[[], float]) -> list[Row]:
    """Return times and errors of each way to tag and to pack, of 16 bits, and what the plan takes by itself."""
    renderer = renderer_for(options.on("gl"))
    field = spheres(options.count(_DENSE), options.edge(128))
    scene = _scene(field)

    def planned() -> Row:
        plan = renderer.plan(scene, ss.Camera.fit(field), size=options.size)
        need_gl(plan, "the plan")
        reason = next((effect.reason for effect in plan.effects if effect.name == "float16"), "")
        return {"precision": plan.precision, "remark": f"tags: {plan.tagging}; packing: {plan.packing}; {reason}"}

    own = replace(options.on("gl"), rows=_TECHNIQUES, views=min(_VIEWS, options.views))
    rows = ablation.run(replace(own, reference_seconds=_REFERENCE_SECONDS)).rows
    named = [{**row, "row": f"{row['group']}: {row['row']}, {row['scene']}"} for row in rows]
    return [{"row": "what the plan takes for spheres", **attempt(planned)}, *named]


def _beside(options: Options, run: Callable[[Options], Sequence[Row]]) -> list[Row]:
    """Return the rows of OpenGL with the processor's times beside them."""
    drawn, other = run(options.on("gl")), {row["row"]: row for row in run(options.on("cpu"))}
    rows = []
    for row in drawn:
        cpu = other.get(row["row"], {})
        found = dict(row)
        if "wall_ms" in row and "wall_ms" in cpu:
            found |= {"cpu_wall_ms": cpu["wall_ms"], "times": cpu["wall_ms"] / row["wall_ms"]}
        if "wall_ratio" in row and "wall_ratio" in cpu:
            found |= {"cpu_ratio": cpu["wall_ratio"]}
        rows.append(found)
    return rows


def _tables(options: Options, seconds: Callable[[], float]) -> list[Row]:
    """Return the rows of both papers' tables."""
    short = replace(options, rows=(), views=min(_VIEWS, options.views), reference_seconds=_REFERENCE_SECONDS)
    rows: list[Row] = []
    for table in (table2005, table2006):
        rows += _beside(short, lambda on, table=table: table.run(on).rows)  # type: ignore[misc]
    for row in rows:
        if "fps" in row and row.get("paper_fps"):
            row["over_paper"] = row["fps"] / float(row["paper_fps"])
    return rows


def _effects(options: Options, seconds: Callable[[], float]) -> list[Row]:
    """Return every effect over the plain picture, on a volume and on ellipsoids."""
    rows: list[Row] = []
    for name in _FIELDS:
        subject = cliffs.subject_of(options, name)

        def timed(on: Options, subject: Subject = subject) -> Sequence[Row]:
            conditions = Conditions(on.backend, on.size, min(_VIEWS, on.views), tell=on.say)
            return surface(subject, list(EFFECTS), conditions, [])

        rows += [{**row, "row": f"{row['row']}, {name}"} for row in _beside(options, timed)]
    return rows


def _scene(field: ss.EllipsoidField) -> ss.Scene:
    return ss.Scene(field, SCATTERED_POINTS, lights=[ss.Light((0.3, 0.5, 1.0))])


def _full_hd(options: Options, seconds: Callable[[], float]) -> list[Row]:
    """Return frames of a million and of ten million spheres at 1080p, or at the size of a rehearsal."""
    size = _FULL_HD if options.scale == 1.0 else options.size
    rows: list[Row] = []
    for usual in _COUNTS:
        count = max(100, round(usual * options.scale**3))
        options.say(f"{count:,} spheres at {size[0]}x{size[1]}")
        field = spheres(count, max(16.0, _DENSE_EDGE * (count / _DENSE) ** (1.0 / 3.0)))

        def drawn(on: Options, field: ss.EllipsoidField = field, count: int = count) -> Sequence[Row]:
            def one() -> Row:
                renderer = renderer_for(on)
                timing, image = time_frames(renderer, _scene(field), orbit(field, min(_VIEWS, on.views)), size)
                if on.backend == "gl":
                    need_gl(image.plan, "the picture")
                return timing.row() | {"fps": 1.0 / timing.wall, "precision": image.plan.precision}

            return [{"row": f"{count:,} spheres at {size[0]}x{size[1]}", **attempt(one)}]

        rows += _beside(options, drawn)
    return rows


def _path_scenes(options: Options) -> dict[str, tuple[ss.Scene, tuple[int, int]]]:
    """Return the scenes that the paths of OpenGL are compared on, with their sizes."""
    size = _FULL_HD if options.scale == 1.0 else options.size
    volume = ss.RegularField(_wave(options.edge(256)))
    kernels = spheres(options.count(1_000_000), max(16.0, _DENSE_EDGE * (options.count(1_000_000) / _DENSE) ** (1 / 3)))
    slender = ss.EllipsoidField(
        kernels.centers,
        scales=np.reshape(kernels.scales, (-1, 1)) * np.array([2.0, 0.1, 0.5]),
        rotations=_turns(len(kernels.centers)),
        values=kernels.values,
    )
    lit: Mapping[str, Any] = {"lights": [ss.Light((0.3, 0.5, 1.0))]}
    return {
        "wave, lit": (ss.Scene(volume, _WAVE_POINTS, **lit), size),
        "wave, surface": (
            ss.Scene(volume, _WAVE_POINTS, mode="isosurface", iso_value=180.0, **lit),
            size,
        ),
        "wave, x-ray": (ss.Scene(volume, _WAVE_POINTS, mode="xray"), size),
        "spheres, lit": (_scene(kernels), size),
        "ellipsoids 1:20, lit": (_scene(slender), size),
    }


def _wave(edge: int) -> np.ndarray[Any, Any]:
    """Return a volume of bytes with shells everywhere, none of it empty."""
    along = np.linspace(-1.0, 1.0, edge, dtype=np.float32)
    radius = np.sqrt(along[:, None, None] ** 2 + along[None, :, None] ** 2 + along[None, None, :] ** 2)
    return (127.5 + 127.5 * np.cos(14.0 * radius)).astype(np.uint8)


def _turns(count: int) -> np.ndarray[Any, Any]:
    turns = np.random.default_rng(3).normal(size=(count, 4))
    return turns / np.linalg.norm(turns, axis=1, keepdims=True)


def _timed_path(scene: ss.Scene, views: Sequence[ss.Camera], size: tuple[int, int], renderer: ss.Renderer) -> Row:
    """Return the time of the first frame, and of frames from moving cameras."""
    began = time.perf_counter()
    renderer.render(scene, views[0], size=size)
    first = time.perf_counter() - began
    timing, image = time_frames(renderer, scene, views, size)
    row: Row = timing.row() | {"fps": 1.0 / timing.wall, "first_ms": 1000.0 * first}
    return row | {"slices": image.stats["slices"], "kernels_drawn": image.stats["kernels_drawn"]}


def _paths(options: Options, seconds: Callable[[], float]) -> list[Row]:
    """Return first frames and frames of moving cameras by raster passes, by compute programs and on the processor."""
    rows: list[Row] = []
    for name, (scene, size) in _path_scenes(options).items():
        field = scene.fields[0]
        views = orbit(field, max(2, min(20, options.views)))
        for way, backend, settings in (
            ("raster", "gl", {"path": "raster"}),
            ("compute", "gl", {"path": "compute"}),
            ("processor", "cpu", {}),
        ):
            options.say(f"{name}, {way}")

            found = attempt(partial(_timed_path, scene, views, size, ss.Renderer(backend, **settings)))
            rows.append({"row": f"{name}, {way}, {size[0]}x{size[1]}", **found})
    return rows


def _count(options: Options, seconds: Callable[[], float]) -> list[Row]:
    """Return what the threads of the compute path do in the same scenes, on any device, at the size of the tables."""
    from bench.lab import LabRenderer

    rows: list[Row] = []
    small = replace(options, scale=min(options.scale, 0.125))
    for name, (scene, _) in _path_scenes(small).items():
        options.say(f"counting {name}")

        def one(scene: ss.Scene = scene) -> Row:
            renderer = LabRenderer(("count_work",), path="compute")
            stats = renderer.render(scene, orbit(scene.fields[0], 2)[0], size=(100, 100)).stats
            points = 100.0 * 100.0 * stats["slices"]
            return {
                "sections": stats["sections"] / points,
                "samples_read": stats["samples_read"] / points,
                "barriers": stats["barriers"] / points,
                "shared_bytes": stats["shared_bytes"],
                "threads": stats["threads_a_group"],
                "slices": stats["slices"],
                "kernels_drawn": stats["kernels_drawn"],
            }

        rows.append({"row": name, **attempt(one)})
    return rows


_PARTS: Mapping[str, Callable[[Options, Callable[[], float]], list[Row]]] = {
    "paths": _paths,
    "count": _count,
    "full hd": _full_hd,
    "tables": _tables,
    "techniques": _techniques,
    "tests": _tests,
    "effects": _effects,
}

#: Parts that can be run alone.
ROWS = tuple(_PARTS)


def run(options: Options) -> Report:
    """Run every part that is wanted, as long as there is time."""
    began = time.perf_counter()

    def left() -> float:
        return max(1.0, _SECONDS - (time.perf_counter() - began))

    rows: list[Row] = []
    for name, part in _PARTS.items():
        if not options.wants(name):
            continue
        started = time.perf_counter()
        if started - began > _SECONDS:
            rows.append({"part": name, "row": "all", "remark": f"left out: {_SECONDS:g} s are over"})
            continue
        found = part(replace(options, rows=()), left)
        options.say(f"{name}: {time.perf_counter() - started:.0f} s")
        rows += [{"part": name, **row} for row in found]
    spent = time.perf_counter() - began
    goals = [Goal("all of it", spent, _SECONDS, "s")]
    if options.scale == 1.0:
        goals += _goals(rows)
    return Report(
        name="gpu",
        title=f"OpenGL on this machine's device, and backend cpu beside it, at {options.size[0]}x{options.size[1]}",
        columns=columns(
            "part, row, passed, failed, skipped, wall_ms=gl ms, cpu_wall_ms=cpu ms, times=cpu over gl, fps, "
            "paper_fps=paper: fps, over_paper=over the paper, wall_ratio=effect over plain: gl, cpu_ratio=cpu, "
            "first_ms=first frame ms, sections=sections a point, samples_read=samples a point, barriers=barriers, "
            "shared_bytes=shared bytes, threads=threads, kernels_drawn, slices, precision, rmse, error_size, remark"
        ),
        rows=rows,
        notes=[
            "gl ms, cpu ms: median elapsed times of frames, the picture read back; of tests the whole run. cpu over "
            "gl: above 1, OpenGL is faster.",
            "effect over plain: elapsed time of a frame with the effect over that of the plain lit composite.",
            "count: what the threads of a compute program do for each pixel and slice of 100x100 pixels, of scenes "
            "an eighth as wide: sections of scattered kernels, samples of lattices, barriers (times threads).",
            f"Parts that have not begun after {_SECONDS:g} s are left out.",
        ],
        goals=goals,
        environment=environment(_device(options)),
    )


def _device(options: Options) -> str:
    try:
        return device_of(renderer_for(options.on("gl")))
    except ss.DeviceUnavailable:
        return "no OpenGL"


def _goals(rows: Sequence[Row]) -> list[Goal]:
    goals = [
        Goal(f"{row['row']}, of the paper's frame rate", row["over_paper"], _WANTED_TIMES, "times", least=True)
        for row in rows
        if "over_paper" in row
    ]
    goals += [
        Goal(row["row"], row["fps"], _WANTED_RATE, "frames a second", least=True)
        for row in rows
        if row["part"] == "full hd" and "fps" in row
    ]
    goals += [Goal(row["row"], float(row["failed"]), 0.0, "failed") for row in rows if "failed" in row]
    return goals
