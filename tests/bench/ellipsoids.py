"""Frames of 35,000 ellipsoids that overlap 23 times: bare fills, other ways to draw them, point and slab sampling."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

import sheetsplat as ss
from bench.lab import fill_test, lab_renderer
from bench.measure import (
    Judge,
    Timing,
    attempt,
    away,
    clock,
    device_of,
    difference,
    need_gl,
    orthographic,
    quotient,
    renderer_for,
)
from bench.pictures import keep
from bench.report import Goal, Options, Report, Row, columns, environment
from bench.scenes import ASPECT, COUNT, EDGE, OVERLAP, SCATTERED_POINTS, ellipsoids

# Slice distances at which point and slab sampling are compared, and that of the converged picture.
_SPACINGS = (8.0, 4.0, 2.0, 1.0, 0.5)
_CONVERGED = 0.125
# A frame of another way that would take longer is not begun, s.
_PATIENCE = 60.0

#: Names of the parts that can be run alone.
ROWS = ("wide", "paper", "ways", "sampling")


def _scene(field: ss.EllipsoidField, *, shaded: bool = True, **options: Any) -> ss.Scene:
    """Return a semi-transparent scene; opacities are per unit of length whatever the slice distance is."""
    lights = [ss.Light((0.3, 0.5, 1.0))] if shaded else []
    settings: dict[str, Any] = {"slice_spacing": 1.0, "reference_length": 1.0, "opacity_stop": 1.0, **options}
    return ss.Scene(field, SCATTERED_POINTS, lights=lights, **settings)


def _cameras(edge: float, views: int) -> list[ss.Camera]:
    """Return views, the first along z, the others turned by up to 40 degrees; the cube fills the picture in each."""
    turns = [math.radians(40.0 * view / max(1, views - 1)) for view in range(views)]
    return [orthographic((0.5 * edge,) * 3, away(turn, 0.5 * turn), 2.0 * edge, edge) for turn in turns]


def _named(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"


# ------------------------------------------------------------------------------------------ frames and their floors


@dataclass
class _Packing:
    """Frames in one packing, and what was drawn right after each of them."""

    rows: list[Row]
    frame: Timing
    first: Mapping[str, float]
    floors: dict[str, Timing] = field(default_factory=dict)

    def goals(self) -> list[Goal]:
        """Return the goals of the frame against its floors, and of its preparation."""
        goals = []
        for name, floor in self.floors.items():
            goals.append(Goal(f"the frame over {name}, elapsed", quotient(self.frame, floor), 2.5))
            goals.append(Goal(f"the frame over {name}, cpu", quotient(self.frame, floor, cpu=True), 2.5))
        names = ("seconds_index", "seconds_view", "seconds_vertices")
        first = 1000.0 * sum(self.first.get(name, 0.0) for name in names)
        further = 1000.0 * sum(self.frame.stat(name) for name in names[1:])
        goals.append(Goal("preparation of the first frame: grid, view and records", first, 50.0, "ms"))
        goals.append(Goal("preparation of a further frame: view and records", further, 50.0, "ms"))
        return goals


def _bare(timing: Timing, renderer: ss.Renderer, scene: ss.Scene, camera: ss.Camera, size: tuple[int, int]) -> None:
    """Draw rectangles, which are no picture: the package would look for a reason why nothing can be seen in it."""
    drawn, wall, cpu = clock(
        lambda: renderer.native.render(
            scene.native, camera.native, size=size, coverage=False, depth=False, progress=None
        )
    )
    timing.add(wall, cpu, drawn.stats)


def _packing(packing: Any, scene: ss.Scene, cameras: list[ss.Camera], options: Options, judge: Judge) -> _Packing:
    """Time every view, and right after it the bare fill of the same fragments, so that both meet the same load."""
    size = options.size
    renderer = renderer_for(options, packing=packing)
    first = renderer.render(scene, cameras[0], size=size)
    gl = first.plan.backend == "gl"
    frame, alone, bare, fill = Timing(), Timing(), Timing(), Timing()
    if gl:
        bare_renderer = lab_renderer(options, "bare_fill", packing=packing)
        counter = lab_renderer(options, "bare_fill", "count_fragments", packing=packing)
        _bare(Timing(), bare_renderer, scene, cameras[0], size)
    # In a picture of a few pixels only the preparation takes time, and it is otherwise the same.
    few = options.smaller(50)
    counts = []
    picture = first
    for camera in cameras:
        picture = frame.frame(renderer, scene, camera, size)
        if gl:
            _bare(bare, bare_renderer, scene, camera, size)
            counted = Timing()
            _bare(counted, counter, scene, camera, size)
            counts.append(counted.stat("fragments"))
            splats = picture.stats["splats"]
            # Sprites are squares.
            edge = math.sqrt(counts[-1] / max(splats, 1.0))
            fill.shots += fill_test(round(splats), edge, size, 4, 1).shots
        alone.frame(renderer, scene, camera, few)
    keep(options, picture, "ellipsoids", packing)
    row: Row = {"row": packing, "spacing": scene.slice_spacing, "size": _named(size), "splats": frame.splats}
    row |= frame.row("view", "vertices") | judge.error(renderer, scene, cameras[0])
    row["index_ms"] = 1000.0 * first.stats.get("seconds_index", 0.0)
    small = {"row": f"{packing}: preparation, few pixels", "spacing": scene.slice_spacing, "size": _named(few)}
    rows = [row, small | {"splats": alone.splats} | alone.row("view", "vertices")]
    if not gl:
        rows.append({"row": f"{packing}: bare fills", "remark": f"not run: {first.plan.backend} has no rectangles"})
        return _Packing(rows, frame, first.stats)
    fragments = round(statistics.median(counts))
    row |= {
        "fragments": fragments,
        "over_bare": quotient(frame, bare),
        "cpu_over_bare": quotient(frame, bare, cpu=True),
        "over_fill": quotient(frame, fill),
        "cpu_over_fill": quotient(frame, fill, cpu=True),
    }
    rows += [
        {"row": f"{packing}: own rectangles in one colour", "fragments": fragments} | bare.times(),
        {"row": f"{packing}: fill test, as many sprites of that area, 4 targets", "fragments": fragments}
        | fill.times(),
    ]
    return _Packing(rows, frame, first.stats, {"the same rectangles in one colour": bare, "the fill test": fill})


# ---------------------------------------------------------------------------------------- other ways to the picture


def _gather(options: Options) -> ss.Renderer:
    return lab_renderer(options, "gather")


def _forced(effect: str, on: bool) -> Callable[[Options], ss.Renderer]:
    return lambda options: renderer_for(options, effects={effect: on})


#: [NM06] section 5.1, its section 4.1 to the letter, and slicing with and without the device, one of which is the
#: usual way.
WAYS: dict[str, Callable[[Options], ss.Renderer]] = {
    "gather: pixels look for kernels": _gather,
    "slicing step by step, as the paper": _forced("paper_slicing", True),
    "slicing by the device": _forced("resident_sections", True),
    "slicing by the processor": _forced("resident_sections", False),
}


def _beside(
    name: str, other: ss.Renderer, scene: ss.Scene, cameras: list[ss.Camera], options: Options, judge: Judge
) -> list[Row]:
    """Time another way and the usual one in turn: all views in a small picture, the first in a larger one."""
    usual = renderer_for(options)
    rows: list[Row] = []
    small, took = options.smaller(4), 0.0
    for size, seen in ((small, cameras), (options.smaller(2), cameras[:1])):
        row: Row = {"row": name, "spacing": scene.slice_spacing, "size": _named(size)}
        rows.append(row)
        expected_time = took * size[0] * size[1] / (small[0] * small[1])
        if expected_time > _PATIENCE:
            row["remark"] = f"not run: about {expected_time:.0f} s cpu a frame"
            continue
        these, those = Timing(), Timing()
        usual.render(scene, seen[0], size=size)
        if size == small:
            other.render(scene, seen[0], size=size)
        apart = 0.0
        for camera in seen:
            expected = those.frame(usual, scene, camera, size)
            picture = these.frame(other, scene, camera, size)
            apart = max(apart, difference(picture, expected)["rmse"])
        took = these.cpu
        row |= these.row() | {
            "usual_ms": 1000.0 * those.wall,
            "usual_cpu_ms": 1000.0 * those.cpu,
            "over_usual": quotient(these, those),
            "cpu_over_usual": quotient(these, those, cpu=True),
            "apart": apart,
        }
        if size == small:
            row |= judge.error(other, scene, seen[0])
    return rows


# ------------------------------------------------------------------------------------------- point and slab sampling


def _sampling(options: Options) -> tuple[list[Row], list[str]]:
    """Compare point and slab sampling by their distance from a converged picture, and by their time."""
    size, edge = options.smaller(2), options.edge(EDGE)
    camera = _cameras(edge, 1)[0]
    renderer = renderer_for(options)
    rows: list[Row] = []
    notes = [
        f"Sampling: unlit, against slabs at distance {_CONVERGED:g}; x-rays, relative to their largest value, against "
        "slabs at 0.5, which are exact there."
    ]
    # The line integral of a sum is linear in its kernels, so that slabs are exact at every distance. Of small kernels
    # slices miss much.
    for name, mode, normalization, shrunk, finest in (
        ("composite", "composite", "threshold", 1.0, _CONVERGED),
        ("composite, a quarter as large", "composite", "threshold", 0.25, _CONVERGED),
        ("xray", "xray", "none", 1.0, 0.5),
    ):
        kernels = ellipsoids(options.count(COUNT), edge, normalization=normalization, shrunk=shrunk)
        scene = partial(_scene, kernels, shaded=False, mode=mode)
        options.say(f"sampling: {name}, converged picture")
        converged = renderer.render(scene(sampling="slab", slice_spacing=finest), camera, size=size)
        unit = float(np.abs(converged.scalar).max()) if converged.is_scalar else 1.0
        found: dict[str, list[tuple[float, float]]] = {"point": [], "slab": []}
        for spacing in (one for one in _SPACINGS if one > finest):
            for sampling, errors in found.items():
                options.say(f"sampling: {name}, {sampling}s, distance {spacing:g}")
                one = scene(sampling=sampling, slice_spacing=spacing)
                renderer.render(one, camera, size=(max(1, size[0] // 8), max(1, size[1] // 8)))
                timing = Timing()
                for _ in range(min(3, options.views)):
                    picture = timing.frame(renderer, one, camera, size)
                apart = {key: value / unit for key, value in difference(picture, converged).items()}
                errors.append((timing.cpu, apart["rmse"]))
                row = {"row": f"{name}: {sampling}s", "spacing": spacing, "size": _named(size)}
                row |= timing.row() | {"splats": timing.splats, **apart, "error_size": _named(size)}
                rows.append(row)
        if mode == "composite":
            notes.append(_equal_time(name, found))
    return rows, notes


def at_equal_time(points: Sequence[tuple[float, float]], seconds: float) -> float:
    """Return the error at a time: straight lines through (time, error) in logarithms, the outer ones extended."""
    if len(points) < 2 or min(min(pair) for pair in points) <= 0.0:
        return math.nan
    known = sorted((math.log(time), math.log(error)) for time, error in points)
    at = math.log(seconds)
    upper = min(max(1, sum(time < at for time, _ in known)), len(known) - 1)
    (t0, e0), (t1, e1) = known[upper - 1], known[upper]
    return math.exp(e1 if t1 == t0 else e0 + (e1 - e0) * (at - t0) / (t1 - t0))


def _equal_time(name: str, found: Mapping[str, Sequence[tuple[float, float]]]) -> str:
    """Say which error slabs have in the times that points take at distances 1 and 1/2."""
    told = []
    for spacing in (1.0, 0.5):
        seconds, error = found["point"][_SPACINGS.index(spacing)]
        other = at_equal_time(found["slab"], seconds)
        told.append(
            f"{1000.0 * seconds:.0f} cpu ms (points at distance {spacing:g}) points have rmse {error:.1e}, slabs "
            f"{other:.1e}"
        )
    return f"Sampling, {name}: in " + "; in ".join(told) + " (slabs: interpolated between the measured times)."


# ---------------------------------------------------------------------------------------------------------- together


def run(options: Options) -> Report:
    """Time the frames with their floors, the other ways, and the two samplings."""
    options = options.preferring("gl")
    edge, count = options.edge(EDGE), options.count(COUNT)
    scene = _scene(ellipsoids(count, edge))
    cameras = _cameras(edge, options.views)
    judge, small = (Judge(size, options.reference_seconds) for size in (options.size, options.smaller(4)))
    rows: list[Row] = []
    goals: list[Goal] = []
    notes = [
        f"{count:,} ellipsoids of aspects up to 1:{ASPECT:g}, {OVERLAP:g} supports over every point of a cube of "
        f"{edge}. Quotients are medians over views, each measured right after the other.",
        options.views_note,
        "fragments: those that the splat pass blends, counted by the device; in packing wide each holds up to eight "
        "slices. Own rectangles: the same draws in one constant colour, and nothing else. Fill test: as many square "
        "sprites of the same mean area in one draw, 4 targets of 4 floats.",
        "grid: made once, in the first frame. view: which kernels start in which slab, once a view. records: the "
        "sections of all kernels, made while the device draws; the row below shows them alone.",
        "Errors are those of the first view against the float64 reference. usual ms: the usual way, timed in turn with "
        "another one.",
    ]

    def part(name: str, measure: Callable[[], list[Row]]) -> None:
        """Add the rows of a part, or one with the reason why it cannot be measured."""
        options.say(name)
        found: list[Row] = []
        remark = attempt(lambda: found.extend(measure()) or {})  # type: ignore[func-returns-value]
        rows.extend(found or [{"row": name} | remark])

    def frames(packing: str) -> list[Row]:
        measured = _packing(packing, scene, cameras, options, judge)
        if packing == "wide" and options.scale == 1.0:
            goals.extend(measured.goals())
        return measured.rows

    def way(name: str) -> list[Row]:
        need_gl(renderer_for(options).plan(scene, cameras[0], size=options.size), name)
        return _beside(name, WAYS[name](options), scene, cameras, options, small)

    def sampling() -> list[Row]:
        found, told = _sampling(options)
        notes.extend(told)
        return found

    for packing in ("wide", "paper"):
        if options.wants(packing):
            part(packing, partial(frames, packing))
    for name in WAYS if options.wants("ways") else ():
        part(name, partial(way, name))
    if options.wants("sampling"):
        part("sampling", sampling)
    return Report(
        name="ellipsoids",
        title=f"Scattered ellipsoids at {_named(options.size)}",
        columns=columns(
            "row=what, spacing=ds, size, kernels_drawn, splats, slices, fragments, wall_ms, cpu_ms, "
            "over_bare=over own rectangles, cpu_over_bare=by cpu, over_fill=over fill test, cpu_over_fill=by cpu, "
            "usual_ms=usual ms, usual_cpu_ms=usual cpu ms, over_usual=over usual, cpu_over_usual=by cpu, "
            "apart=rmse to usual, index_ms=grid ms, view_ms=view ms, vertices_ms=records ms, rmse, p99_9, error_size, "
            "remark"
        ),
        rows=rows,
        notes=notes,
        goals=goals,
        environment=environment(device_of(renderer_for(options))),
    )
