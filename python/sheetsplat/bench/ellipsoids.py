"""Frames of 35,000 ellipsoids that overlap 23 times everywhere, against bare fills; and what slab sampling buys."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

import numpy as np

import sheetsplat as ss
from sheetsplat import _sheetsplat
from sheetsplat.bench._measure import Judge, attempt, device_of, difference, renderer_of_papers, require
from sheetsplat.bench._report import Goal, Options, Report, Row, environment
from sheetsplat.datasets._random import Stream

Result = TypeVar("Result")

_COUNT = 35_000
_EDGE = 128
_OVERLAP = 23.0
_ASPECT = 20.0
# Longest semi-axis, in slice distances.
_LONGEST = 24.0
# Slice distances at which point and slab sampling are compared, and that of the picture that counts as converged.
_SPACINGS = (8.0, 4.0, 2.0, 1.0, 0.5)
_CONVERGED = 0.125
# A frame of another way that would take longer is not begun, s.
_PATIENCE = 60.0

_COLUMNS = {
    "row": "what",
    "spacing": "ds",
    "size": "size",
    "kernels_drawn": "drawn",
    "splats": "splats",
    "slices": "slices",
    "fragments": "fragments",
    "wall_ms": "ms",
    "cpu_ms": "cpu ms",
    "over_bare": "over own bare",
    "cpu_over_bare": "by cpu",
    "over_fill": "over fill test",
    "cpu_over_fill": "by cpu ",
    "usual_ms": "usual ms",
    "usual_cpu_ms": "cpu ms  ",
    "over_usual": "over usual",
    "cpu_over_usual": "by cpu  ",
    "apart": "rmse to usual",
    "index_ms": "grid ms",
    "view_ms": "view ms",
    "vertices_ms": "records ms",
    "rmse": "rmse",
    "p99_9": "p99.9",
    "error_size": "error at",
    "remark": "remark",
}

#: Names of the parts that can be run alone.
ROWS = ("wide", "paper", "ways", "sampling")


def ellipsoids(
    count: int = _COUNT, edge: float = _EDGE, *, seed: int = 2006, normalization: str = "threshold", shrunk: float = 1.0
) -> ss.EllipsoidField:
    """Return turned ellipsoids all through a cube whose supports together fill it 23 times.

    Parameters
    ----------
    count
        How many.
    edge
        Of the cube from (0, 0, 0) on, world units; a slice distance is 1.
    seed
        Of the random numbers, which are the same everywhere.
    normalization
        Of the field.
    shrunk
        All semi-axes are this many times as long in the end, at the same centres.

    Returns
    -------
    EllipsoidField
        Half of the ellipsoids are long, half flat, with aspects from 1 to 20, evenly in their logarithm; volumes differ
        by a factor of some 30. No semi-axis is much longer than 24. Values fall from the cube's middle outwards.
    """
    random = Stream(seed)
    aspect = _ASPECT ** random.uniform(count)
    axes = np.ones((count, 3))
    axes[:, 0] = aspect
    flat = random.uniform(count) < 0.5
    axes[flat, 1] = aspect[flat]
    axes *= np.exp(np.clip(0.3 * random.normal(count), -0.9, 0.45))[:, None]
    axes /= np.cbrt(np.where(flat, aspect**2, aspect))[:, None]
    ball = 4.0 / 3.0 * math.pi
    for longest in (_LONGEST, math.inf):
        axes *= np.cbrt(_OVERLAP * edge**3 / (ball * axes.prod(axis=1).sum()))
        axes = np.minimum(axes, longest)
    turns = random.normal(count, 4)
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    centers = edge * random.uniform(count, 3)
    middle = 0.5 * edge
    away = np.linalg.norm(centers - middle, axis=1) / middle
    values = np.clip(1.0 - away, 0.0, 1.0) + 0.05 * random.uniform(count)
    return ss.EllipsoidField(centers, shrunk * axes, turns, values, normalization=normalization)  # type: ignore[arg-type]


def _scene(field: ss.EllipsoidField, *, shaded: bool = True, **options: Any) -> ss.Scene:
    """Return a semi-transparent scene; opacities are per unit of length whatever the slice distance is."""
    points = [(0.1, 0.1, 0.2, 0.9, 0.0), (0.5, 0.2, 0.9, 0.3, 0.02), (1.0, 1.0, 0.8, 0.2, 0.1)]
    lights = [ss.Light((0.3, 0.5, 1.0))] if shaded else []
    settings: dict[str, Any] = {"slice_spacing": 1.0, "reference_length": 1.0, "opacity_stop": 1.0, **options}
    return ss.Scene(field, points, lights=lights, **settings)


def _cameras(edge: float, views: int) -> list[ss.Camera]:
    """Return views, the first along z, the others turned by up to 40 degrees; the cube fills the picture in each."""
    cameras = []
    for view in range(views):
        turn = math.radians(40.0 * view / max(1, views - 1))
        rise = 0.5 * turn
        away = (math.sin(turn) * math.cos(rise), math.sin(rise), math.cos(turn) * math.cos(rise))
        eye = tuple(0.5 * edge + 2.0 * edge * part for part in away)
        cameras.append(ss.Camera.orthographic(eye, (0.5 * edge,) * 3, height=edge))
    return cameras


@dataclass
class _Times:
    """Times of frames, one a view, in seconds, and what their pictures say."""

    walls: list[float] = field(default_factory=list)
    cpus: list[float] = field(default_factory=list)
    stats: list[Mapping[str, float]] = field(default_factory=list)

    @property
    def wall(self) -> float:
        return statistics.median(self.walls)

    @property
    def cpu(self) -> float:
        return statistics.median(self.cpus)

    def median(self, name: str) -> float:
        return statistics.median(one.get(name, 0.0) for one in self.stats)

    def frame(self, renderer: ss.Renderer, scene: ss.Scene, camera: ss.Camera, size: tuple[int, int]) -> ss.Image:
        """Render a picture that counts."""
        wall, cpu = time.perf_counter(), time.process_time()
        picture = renderer.render(scene, camera, size=size)
        self.add(time.perf_counter() - wall, time.process_time() - cpu, picture.stats)
        return picture

    def bare(self, renderer: ss.Renderer, scene: ss.Scene, camera: ss.Camera, size: tuple[int, int]) -> None:
        """Draw what is no picture; the package would look for a reason why nothing can be seen in it."""
        wall, cpu = time.perf_counter(), time.process_time()
        drawn = renderer.native.render(
            scene.native, camera.native, size=size, coverage=False, depth=False, progress=None
        )
        self.add(time.perf_counter() - wall, time.process_time() - cpu, drawn.stats)

    def add(self, wall: float, cpu: float, stats: Mapping[str, float] | None = None) -> None:
        self.walls.append(wall)
        self.cpus.append(cpu)
        self.stats.append(stats or {})

    def row(self) -> Row:
        return {"wall_ms": 1000.0 * self.wall, "cpu_ms": 1000.0 * self.cpu}


def _over(these: Sequence[float], those: Sequence[float]) -> float:
    """Return the median of quotients of neighbours in time, which met the same machine."""
    return statistics.median(one / max(other, 1e-9) for one, other in zip(these, those, strict=True))


@dataclass
class _Packing:
    """What was measured of one packing."""

    rows: list[Row]
    frame: _Times
    first: Mapping[str, float]
    bare: _Times | None
    fill: _Times | None


def _packing(
    name: str, scene: ss.Scene, cameras: list[ss.Camera], options: Options, judge: Judge, **settings: Any
) -> _Packing:
    """Time every view, and right after it what the same fragments take bare, so that all meet the same machine."""
    size = options.size
    renderer = renderer_of_papers(options, **settings)
    first = renderer.render(scene, cameras[0], size=size)
    bare: ss.Renderer | None = None
    counting: ss.Renderer | None = None
    if first.plan.backend == "gl":
        filling = {**settings, "allow_inexact": True}
        bare = renderer_of_papers(options, **filling, effects={"bare_fill": True})
        # The rectangles are those of the frame.
        counting = renderer_of_papers(options, **filling, effects={"bare_fill": True, "count_fragments": True})
        _Times().bare(bare, scene, cameras[0], size)
    frame, alone, bared, filled = _Times(), _Times(), _Times(), _Times()
    # Where a picture has hardly a pixel, nothing is drawn beside the preparation, which is otherwise the same.
    few = (max(1, size[0] // 50), max(1, size[1] // 50))
    counts = []
    picture = first
    for camera in cameras:
        picture = frame.frame(renderer, scene, camera, size)
        if bare is not None and counting is not None:
            bared.bare(bare, scene, camera, size)
            counted = _Times()
            counted.bare(counting, scene, camera, size)
            fragments = counted.median("fragments")
            splats = picture.stats["splats"]
            counts.append(fragments)
            # Sprites are squares.
            edge = math.sqrt(fragments / max(splats, 1.0))
            filled.add(*_sheetsplat.fill_test(round(splats), edge, *size, 4, 1))
        alone.frame(renderer, scene, camera, few)
    options.keep(picture, "ellipsoids", name)
    row: Row = {
        "row": name,
        "spacing": scene.slice_spacing,
        "size": f"{size[0]}x{size[1]}",
        "kernels_drawn": round(frame.median("kernels_drawn")),
        "splats": round(frame.median("splats")),
        "slices": round(frame.median("slices")),
        **frame.row(),
        "index_ms": 1000.0 * first.stats.get("seconds_index", 0.0),
        "view_ms": 1000.0 * frame.median("seconds_view"),
        "vertices_ms": 1000.0 * frame.median("seconds_vertices"),
        **judge.error(renderer, scene, cameras[0]),
    }
    rows = [row]
    rows.append(
        {
            "row": f"{name}: preparation, hardly a pixel drawn",
            "spacing": scene.slice_spacing,
            "size": f"{few[0]}x{few[1]}",
            "splats": round(alone.median("splats")),
            **alone.row(),
            "view_ms": 1000.0 * alone.median("seconds_view"),
            "vertices_ms": 1000.0 * alone.median("seconds_vertices"),
        }
    )
    if counts:
        fragments = round(statistics.median(counts))
        row["fragments"] = fragments
        row |= {
            "over_bare": _over(frame.walls, bared.walls),
            "cpu_over_bare": _over(frame.cpus, bared.cpus),
            "over_fill": _over(frame.walls, filled.walls),
            "cpu_over_fill": _over(frame.cpus, filled.cpus),
        }
        rows.append({"row": f"{name}: own rectangles in one colour", "fragments": fragments, **bared.row()})
        rows.append(
            {"row": f"{name}: fill test, as many sprites of that area, 4 targets", "fragments": fragments}
            | filled.row()
        )
    else:
        rows.append({"row": f"{name}: bare fills", "remark": f"not run: {first.plan.backend} has no rectangles"})
    return _Packing(rows, frame, first.stats, bared if counts else None, filled if counts else None)


# Other ways to the same picture: [NM06] section 5.1, its section 4.1 to the letter, and slicing with and without the
# device, one of which is the usual way.
_WAYS: dict[str, Mapping[str, bool]] = {
    "gather: pixels look for kernels": {"gather": True},
    "slicing step by step, as the paper": {"paper_slicing": True},
    "slicing by the device": {"resident_sections": True},
    "slicing by the processor": {"resident_sections": False},
}


def knows(effects: Mapping[str, bool], options: Options) -> bool:
    """Return whether this version has the effects."""
    scene = _scene(ellipsoids(8, 4.0))
    try:
        renderer_of_papers(options, effects=effects).plan(scene, _cameras(4.0, 1)[0], size=(8, 8))
    except ss.InvalidInput:
        return False
    except ss.Error:
        # It has them, and may or may not draw this scene so.
        return True
    return True


def _beside(
    name: str, effects: Mapping[str, bool], scene: ss.Scene, cameras: list[ss.Camera], options: Options, judge: Judge
) -> list[Row]:
    """Time another way and the usual one side by side: all views in a small picture, the first in a larger one."""
    usual, other = renderer_of_papers(options), renderer_of_papers(options, effects=effects)
    require(other, scene, cameras[0], options.size, {"effects": effects})
    small = (max(1, options.size[0] // 4), max(1, options.size[1] // 4))
    larger = (max(1, options.size[0] // 2), max(1, options.size[1] // 2))
    rows: list[Row] = []
    took = 0.0
    for size, seen in ((small, cameras), (larger, cameras[:1])):
        row: Row = {"row": name, "spacing": scene.slice_spacing, "size": f"{size[0]}x{size[1]}"}
        rows.append(row)
        more = took * size[0] * size[1] / (small[0] * small[1])
        if more > _PATIENCE:
            row["remark"] = f"not run: about {more:.0f} s of the processors a frame"
            continue
        these, those = _Times(), _Times()
        usual.render(scene, seen[0], size=size)
        if size == small:
            other.render(scene, seen[0], size=size)
        apart = 0.0
        for camera in seen:
            expected = those.frame(usual, scene, camera, size)
            picture = these.frame(other, scene, camera, size)
            apart = max(apart, difference(picture, expected)["rmse"])
        took = these.cpu
        row |= {
            "kernels_drawn": round(these.median("kernels_drawn")),
            "slices": round(these.median("slices")),
            **these.row(),
            "usual_ms": 1000.0 * those.wall,
            "usual_cpu_ms": 1000.0 * those.cpu,
            "over_usual": _over(these.walls, those.walls),
            "cpu_over_usual": _over(these.cpus, those.cpus),
            "apart": apart,
        }
        if size == small:
            row |= judge.error(other, scene, seen[0])
    return rows


def _sampling(options: Options, edge: int, count: int) -> tuple[list[Row], list[str]]:
    """Compare point and slab sampling by their distance from a converged picture, and by their time."""
    size = (max(1, options.size[0] // 2), max(1, options.size[1] // 2))
    camera = _cameras(edge, 1)[0]
    renderer = renderer_of_papers(options)
    rows: list[Row] = []
    notes: list[str] = []
    # The line integral of a sum is linear in its kernels: there slabs are exact at every distance. Of small kernels
    # slices miss much.
    for name, mode, normalization, shrunk, finest in (
        ("composite", "composite", "threshold", 1.0, _CONVERGED),
        ("composite, a quarter as large", "composite", "threshold", 0.25, _CONVERGED),
        ("xray", "xray", "none", 1.0, 0.5),
    ):
        kernels = ellipsoids(count, edge, normalization=normalization, shrunk=shrunk)

        def scene(sampling: str, spacing: float, kernels: ss.EllipsoidField = kernels, mode: str = mode) -> ss.Scene:
            return _scene(kernels, shaded=False, mode=mode, sampling=sampling, slice_spacing=spacing)

        options.say(f"sampling: {name}, converged picture")
        converged = renderer.render(scene("slab", finest), camera, size=size)
        unit = float(np.abs(converged.scalar).max()) if converged.is_scalar else 1.0
        found: dict[str, list[tuple[float, float]]] = {"point": [], "slab": []}
        for spacing in (one for one in _SPACINGS if one > finest):
            for sampling, errors in found.items():
                options.say(f"sampling: {name}, {sampling}s, distance {spacing:g}")
                one = scene(sampling, spacing)
                renderer.render(one, camera, size=(max(1, size[0] // 8), max(1, size[1] // 8)))
                times = _Times()
                for _ in range(min(3, options.views)):
                    picture = times.frame(renderer, one, camera, size)
                apart = difference(picture, converged)
                errors.append((times.cpu, apart["rmse"] / unit))
                rows.append(
                    {
                        "row": f"{name}: {sampling}s",
                        "spacing": spacing,
                        "size": f"{size[0]}x{size[1]}",
                        "slices": round(times.median("slices")),
                        "splats": round(times.median("splats")),
                        **times.row(),
                        "rmse": apart["rmse"] / unit,
                        "p99_9": apart["p99_9"] / unit,
                        "error_size": f"{size[0]}x{size[1]}",
                    }
                )
        if mode == "composite":
            notes.append(_equal_time(name, found))
    return rows, notes


def at_equal_time(points: Sequence[tuple[float, float]], seconds: float) -> float:
    """Return the error at a time: straight lines through (time, error) in logarithms, the outer ones carried on."""
    if len(points) < 2 or min(min(pair) for pair in points) <= 0.0:
        return math.nan
    known = sorted((math.log(time), math.log(error)) for time, error in points)
    at = math.log(seconds)
    upper = min(max(1, sum(time < at for time, _ in known)), len(known) - 1)
    (t0, e0), (t1, e1) = known[upper - 1], known[upper]
    return math.exp(e1 if t1 == t0 else e0 + (e1 - e0) * (at - t0) / (t1 - t0))


def _equal_time(name: str, found: Mapping[str, Sequence[tuple[float, float]]]) -> str:
    """Say what slabs come to in the times that points take at distances 1 and 1/2."""
    told = []
    for spacing in (1.0, 0.5):
        seconds, error = found["point"][_SPACINGS.index(spacing)]
        other = at_equal_time(found["slab"], seconds)
        told.append(
            f"{1000.0 * seconds:.0f} cpu ms (points at distance {spacing:g}) points have rmse {error:.1e}, slabs "
            f"{other:.1e}"
        )
    return f"Sampling, {name}: in " + "; in ".join(told) + " (slabs: read between the measured times)."


def _tried(name: str, measure: Callable[[], Result]) -> tuple[Result | None, list[Row]]:
    """Return what was measured, or a row with the reason why it could not be."""
    kept: list[Result] = []

    def keep() -> Row:
        kept.append(measure())
        return {}

    remark = attempt(keep)
    return (kept[0], []) if kept else (None, [{"row": name} | remark])


def run(options: Options) -> Report:
    """Time the frames with their floors, and the two samplings."""
    edge = options.edge(_EDGE)
    count = max(64, round(_COUNT * (edge / _EDGE) ** 3))
    scene = _scene(ellipsoids(count, edge))
    cameras = _cameras(edge, options.views)
    judge = Judge(options.size, options.reference_seconds)
    rows: list[Row] = []
    notes = [
        f"{count:,} ellipsoids of aspects up to 1:{_ASPECT:g}, {_OVERLAP:g} supports over every point of a cube of "
        f"{edge}. Medians over {options.views} views; quotients are medians over views, each measured right after the "
        "other. cpu ms counts all processors of the process together.",
        "fragments are those that the splat pass blends, counted by the device; in packing wide one of them holds up "
        "to eight slices. Own rectangles: the same draws, in one constant colour, and nothing else. Fill test: as many "
        "square sprites of the same mean area in one draw, 4 targets of 4 floats.",
        "grid: made once, in the first frame. view: which kernels start in which slab, once a view. records: each "
        "kernel's section, made while the device draws; the row below shows it alone.",
        "Errors are those of the first view against the float64 reference. usual ms: the usual way, timed right beside "
        "another one.",
    ]
    goals: list[Goal] = []
    for packing in ("wide", "paper"):
        if options.wants(packing):
            options.say(f"frame, packing {packing}")
            measured, failed = _tried(
                packing, partial(_packing, packing, scene, cameras, options, judge, packing=packing)
            )
            rows += failed
            if measured is not None:
                rows += measured.rows
                if packing == "wide" and options.scale == 1.0:
                    goals += _goals(measured)
    small = Judge((max(1, options.size[0] // 4), max(1, options.size[1] // 4)), options.reference_seconds)
    for name, effects in _WAYS.items():
        if options.wants("ways"):
            options.say(name)
            if knows(effects, options):
                found, failed = _tried(name, partial(_beside, name, effects, scene, cameras, options, small))
                rows += found or failed
            else:
                rows.append({"row": name, "remark": f"not run: this version has no effect {next(iter(effects))}"})
    if options.wants("sampling"):
        compared, failed = _tried("sampling", partial(_sampling, options, edge, count))
        rows += failed
        if compared is not None:
            rows += compared[0]
            notes.append(
                f"Sampling: unlit, against slabs at distance {_CONVERGED:g}; x-rays, in parts of their largest value, "
                "against slabs at 0.5, which are exact there."
            )
            notes += compared[1]
    return Report(
        name="ellipsoids",
        title=f"Scattered ellipsoids at {options.size[0]}x{options.size[1]}",
        columns=_COLUMNS,
        rows=rows,
        notes=notes,
        goals=goals,
        environment=environment(device_of(renderer_of_papers(options))),
    )


def _goals(measured: _Packing) -> list[Goal]:
    goals = []
    frame = measured.frame
    for name, floor in (("the same rectangles in one colour", measured.bare), ("the fill test", measured.fill)):
        if floor is not None:
            goals.append(Goal(f"the frame over {name}, by the clock", _over(frame.walls, floor.walls), 2.5))
            goals.append(Goal(f"the frame over {name}, by the processors", _over(frame.cpus, floor.cpus), 2.5))
    names = ("seconds_index", "seconds_view", "seconds_vertices")
    first = 1000.0 * sum(measured.first.get(name, 0.0) for name in names)
    further = 1000.0 * sum(frame.median(name) for name in names[1:])
    goals.append(Goal("preparation of the first frame: grid, view and records", first, 50.0, "ms"))
    goals.append(Goal("preparation of a further frame: view and records", further, 50.0, "ms"))
    return goals
