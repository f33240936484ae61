"""Backend cpu beside VTK on eight scenes: time, growth, memory and error."""

from __future__ import annotations

import json
import math
import os
import statistics
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sheetsplat as ss
from bench.growth import Spheres
from bench.measure import (
    Judge,
    Timing,
    attempt,
    clock,
    decibels,
    device_of,
    difference,
    exponent,
    forget_peak,
    in_new_process,
    renderer_for,
    resident,
    rms,
    time_frames,
    usable_processors,
)
from bench.pictures import keep_columns
from bench.report import Goal, Options, Report, Row, columns, environment, load
from bench.scenes import CASES, GRID, LARGE, MATERIAL, SCATTERED, VIEWS, Case, gridded, sections, spheres
from bench.vtk_casters import CASTERS, Caster, Look, Volume, Vtk, VtkMissing

# VTK casters other than the compared one are drawn in one round only if a frame takes longer, s.
_SLOW = 0.4
_COUNTS = (10_000, 100_000, 1_000_000, 10_000_000)
_SIZES = (100, 200, 400, 800, 1600)
# Conventions, section 9: RMSE and P99.9 of scenes with gentle transfer functions, and of all.
_GENTLE = (2e-5, 2e-4)
_EVERY = (1e-4, 1e-3)
_STEEPEST = 10.0
# A program that prints [kernel sections a second on one core] for: spheres|ellipsoids, pixels of a section.
_BARE_LOOP = "sheetsplat_bare_loop"


def judged(row: Row, goals: list[Goal], options: Options, goal: Goal) -> Row:
    """Return a row with the figure of a goal, which is judged at the full scale only."""
    row = {**row, "measured": goal.value, "goal": goal.bound, "unit": goal.unit, "quotient": goal.value / goal.bound}
    if options.scale == 1.0:
        goals.append(goal)
        row["verdict"] = "pass" if goal.reached else "MISS"
    return row


def _least(timing: Timing, prefix: str = "") -> Row:
    """Return the least and median times of a frame in milliseconds."""
    return {
        f"{prefix}ms": 1000.0 * timing.least,
        f"{prefix}median_ms": 1000.0 * timing.median,
        f"{prefix}cpu_ms": 1000.0 * timing.least_cpu,
    }


# ------------------------------------------------------------------------------------------------- the scenes


def _opacity(name: str, rgba: NDArray[np.float32]) -> float:
    """Return the mean opacity of a picture, which must show something."""
    opacity = float(rgba[..., 3].mean())
    if not opacity > 1e-3:
        raise ss.Error(f"the benchmark is invalid: {name} shows an empty picture (mean opacity {opacity:.1e})")
    return opacity


@dataclass
class _Side:
    """One of VTK's casters beside ours."""

    caster: Caster
    pictures: list[NDArray[np.float32]]
    timing: Timing = field(default_factory=Timing)
    done: bool = False


@dataclass
class _Run:
    """What all parts of the benchmark share."""

    options: Options
    vtk: Vtk | None = None
    goals: list[Goal] = field(default_factory=list)

    def renderer(self, **settings: Any) -> ss.Renderer:
        return renderer_for(self.options, **settings)

    def judged(self, row: Row, name: str, value: float, bound: float, unit: str = "", *, least: bool = False) -> Row:
        goal = Goal(name, value, bound, unit, least)
        return judged({"load": load(), **row}, self.goals, self.options, goal)

    def each(self, what: str, names: tuple[str, ...], measure: Callable[[str, Case], Row]) -> list[Row]:
        """Return a row for each of some scenes, or the reason why there is none."""
        rows = []
        for name in names:
            self.options.say(f"{what}: {name}")
            case = CASES[name](self.options)
            rows.append({"row": f"{what}: {case.title}"} | attempt(partial(measure, name, case)))
        return rows

    # VTK beside ours

    def sides(self, case: Case, volume: Volume, look: Look, cameras: list[ss.Camera]) -> tuple[list[_Side], list[str]]:
        """Return VTK's casters that can draw a scene, after one frame that does not count, with their pictures."""
        sides: list[_Side] = []
        remarks: list[str] = []
        assert self.vtk is not None
        for caster in case.casters:
            self.options.say(f"{case.title}: VTK, {caster}")
            try:
                self.vtk.show(caster, volume, look)
                self.vtk.frame(caster, cameras[-1])
                shots = [self.vtk.frame(caster, camera, picture=True) for camera in cameras]
            except VtkMissing as error:
                remarks.append(f"VTK {caster}: {error}")
                continue
            side = _Side(caster, [one.rgba for one in shots if one.rgba is not None])
            for rgba in side.pictures:
                _opacity(f"VTK's {caster} caster", rgba)
            if caster != case.peer and statistics.median(one.wall for one in shots) > _SLOW:
                for view, one in enumerate(shots):
                    side.timing.add(one.wall, one.cpu, view=view)
                side.done = True
            sides.append(side)
        return sides, remarks

    def beside(self, case: Case, shaded: bool, volume: Volume | None) -> tuple[Row, dict[Caster, Timing], Timing]:
        """Time ours and VTK's casters in turn on one scene."""
        size, cameras = case.picture(self.options.size), case.cameras()
        kind = "shaded" if shaded else "flat"
        self.options.say(f"{case.title}, {kind}")
        scene, ours, renderer = case.scene(shaded=shaded), Timing(), self.renderer()
        stats = renderer.render(scene, cameras[-1], size=size).stats
        threads = max(1, round(stats.get("threads", usable_processors())))
        look = Look(case.points, case.unit, case.distance, MATERIAL if shaded else None, size, threads)
        sides, remarks = ([], []) if self.vtk is None or volume is None else self.sides(case, volume, look, cameras)
        pictures: list[ss.Image] = []
        forget_peak()
        if self.vtk is not None:
            self.vtk.forget_peak()
        for _ in range(self.options.views):
            pictures = ours.round(renderer, scene, cameras, size)
            for side in sides:
                assert self.vtk is not None
                for view, camera in enumerate(cameras if not side.done else ()):
                    shot = self.vtk.frame(side.caster, camera)
                    side.timing.add(shot.wall, shot.cpu, view=view)
        row: Row = {
            "case": case.name,
            "shaded": shaded,
            "size": f"{size[0]}x{size[1]}",
            "distance": case.distance,
            "opacity": statistics.fmean(_opacity("ours", picture.rgba) for picture in pictures),
            "load": load(),
            **ours.row("view", "bucket", "draw"),
            **_least(ours),
            "row": f"{case.title}, {kind}",
        }
        for side in sides:
            row |= _least(side.timing, f"vtk_{side.caster}_")
            if side.caster == case.peer:
                row["vtk_opacity"] = statistics.fmean(float(rgba[..., 3].mean()) for rgba in side.pictures)
                pairs = zip(pictures, side.pictures, strict=True)
                row["apart"] = math.sqrt(statistics.fmean(rms(ours.rgba - rgba) ** 2 for ours, rgba in pairs))
        if case.alone and self.vtk is not None:
            ours_peak, vtk_peak = (round(peak / 2**20) for peak in (resident("VmHWM"), self.vtk.peak))
            remarks.append(f"peak memory while drawing: ours {ours_peak} MB, VTK's {vtk_peak} MB")
        if remarks:
            row["remark"] = "; ".join(remarks)
        shown = [[picture.rgba for picture in pictures[:2]], *(side.pictures[:2] for side in sides)]
        keep_columns(self.options, shown, "cpu", case.name, kind)
        return row, {side.caster: side.timing for side in sides}, ours

    def scene_rows(self, name: str) -> list[Row]:
        """Time one scene shaded, and flat too where its kernels are scattered."""
        case = CASES[name](self.options)
        volume, remark = case.volume, ""
        if volume is None and self.vtk is not None:
            assert isinstance(case.field, ss.EllipsoidField)
            kernels = case.field
            self.options.say(f"{case.title}: gridding")
            grid, spent, _ = clock(lambda: gridded(kernels, case.edge, self.options.edge(GRID)))
            volume, remark = grid, f"VTK on a grid of {len(grid.values)}^3 after {spent:.1f} s of gridding"
        peer: list[Timing] = []

        def measure(shaded: bool) -> Row:
            row, others, ours = self.beside(case, shaded, volume)
            if remark:
                row["remark"] = "; ".join(filter(None, [remark, row.get("remark")]))
            if shaded and case.peer in others:
                peer.append(others[case.peer])
            if not peer:
                return row
            row["by_cpu"] = ours.least_cpu / peer[0].least_cpu
            # Flat pictures too are compared with the peer's shaded one.
            text = f"{row['row']}, over VTK's {case.peer.upper()} caster" + ("" if shaded else ", shaded")
            return self.judged(row, text, ours.least / peer[0].least, case.share)

        kinds = (True,) if case.volume is not None else (True, False)
        rows = [{"row": case.title} | attempt(partial(measure, shaded)) for shaded in kinds]
        if self.vtk is not None:
            self.vtk.forget()
        return rows

    # Rates and growth

    def rate(self) -> list[Row]:
        """Measure kernel sections a second on one thread where splatting takes nearly all time, and the bare loop."""

        def measure(name: str, case: Case) -> Row:
            assert isinstance(case.field, ss.EllipsoidField)
            cameras, size = case.cameras()[:2], self.options.size
            # A line integral of an unnormalised field is a sum of its slices: one addition a pixel and slice.
            scene = case.scene(shaded=False, mode="xray")
            timing, _ = time_frames(self.renderer(threads=1), scene, cameras, size, self.options.views)
            least = [math.inf] * len(cameras)
            for shot in timing.shots:
                spent = shot.stats.get("seconds_splat", shot.stats["seconds_draw"])
                least[shot.view] = min(least[shot.view], spent)
            counts = [sections(case.field, camera, case.distance) for camera in cameras]
            rate = sum(counts) / sum(least)
            pixels = section_pixels(case.field, cameras[0], size, counts[0])
            row: Row = {"sections": counts[0], "section_pixels": pixels, "rate": rate, "load": load()}
            row["remark"] = f"{1e-6 * rate:.2f} M sections/s of {pixels:.0f} pixels, x-ray"
            try:
                row["bare"] = bare_loop(name, pixels)
            except FileNotFoundError as error:
                row["remark"] += f"; {error}"
                return row
            row["remark"] += f"; bare loop {1e-6 * row['bare']:.2f} M"
            return self.judged(row, f"the bare loop's rate over ours, {name}", row["bare"] / rate, 1.5)

        return self.each("sections a second on one thread", SCATTERED, measure)

    def threads(self) -> list[Row]:
        """Compare one thread with two, in time and to the bit."""

        def measure(name: str, case: Case) -> Row:
            scene, cameras, size = case.scene(), case.cameras(), self.options.size
            both = {threads: (self.renderer(threads=threads), Timing()) for threads in (1, 2)}
            last: dict[int, NDArray[np.float32]] = {}
            for one, _ in both.values():
                one.render(scene, cameras[-1], size=size)
            for _ in range(self.options.views):
                for threads, (one, timing) in both.items():
                    last[threads] = timing.round(one, scene, cameras, size)[-1].rgba
            alone, together = 1000.0 * both[1][1].least, 1000.0 * both[2][1].least
            same = bool(np.array_equal(last[1], last[2]))
            row: Row = {"ms": together, "alone_ms": alone, "identical": same}
            row["remark"] = f"{alone:.0f} ms alone; the same bits: {'yes' if same else 'NO'}"
            return self.judged(row, f"one thread over two, {name}", alone / together, 1.8, least=True)

        return self.each("one thread over two", ("ball", *SCATTERED), measure)

    def grown(self, series: str, count: int, side: int) -> Row:
        """Draw spheres of radius 3 pixels in a block 64 deep that fills the picture, in a new process."""
        self.options.say(f"{series}: {count:,} kernels, {side}x{side}")
        row = Spheres(
            count=count,
            box=(float(side), float(side), 64.0),
            radius=3.0,
            few_radius=3.0,
            points=((0.0, 0.1, 0.2, 0.9, 0.0), (0.5, 0.2, 0.9, 0.3, 0.005), (1.0, 1.0, 0.8, 0.2, 0.02)),
            settings={"slice_spacing": 1.0, "reference_length": 1.0, "opacity_stop": 1.0},
            # A few degrees off the block's axes: it still fills the picture, and no frame equals the one before.
            angles=[(0.02 + 0.01 * view, 0.01 + 0.005 * view) for view in range(1 + min(3, self.options.views))],
            height=float(side),
            size=(side, side),
            backend=self.options.backend,
        ).measure()
        cpu = row["least_cpu_ms"]
        return row | {
            "row": f"{series}: {count:,} kernels at {side}x{side}",
            "count": count,
            "ms": row["least_ms"],
            "cpu_ms": cpu,
            "load": load(),
            "remark": f"cpu {cpu:.1f} ms, {1e3 * cpu / count:.2f} us a kernel",
        }

    def laws(self, title: str, rows: list[Row], name: str) -> list[Row]:
        """Return the exponents over all rows, and over the last two, where constant costs matter least."""
        found = []
        for part, over in ((rows, "all"), (rows[-2:], "the last two")):
            text = f"exponent over {over}: {title}"
            found.append(self.judged({"row": text, "remark": "cpu time"}, text, exponent(part, name), 1.05))
        return found

    def kernels(self) -> list[Row]:
        """Grow the number of kernels: with the picture, so that as many lie over each pixel, and in one picture."""
        counts = sorted({max(1000, round(count * self.options.scale**3)) for count in _COUNTS})
        # Five kernels over two pixels: 100,000 of them fill 200 x 200.
        both = [self.grown("kernels with pixels", n, round(math.sqrt(0.4 * n))) for n in counts]
        both += self.laws("kernels and pixels together", both, "count")
        alone = [self.grown("kernels", n, self.options.size[0]) for n in counts]
        most = alone[-1]
        row = {"row": f"memory of {most['count']:,} spheres, a drawn kernel, beside the field"} | _memory_row(most)
        name = "memory a drawn kernel beside the data, spheres"
        laws = self.laws("kernels in one picture", alone, "count")
        return [*both, *alone, *laws, self.judged(row, name, most["peak_draw"] / most["kernels_drawn"], 64.0, "bytes")]

    def pixels(self) -> list[Row]:
        """Grow the picture of the ball."""
        case = CASES["ball"](self.options)
        rows: list[Row] = []
        for side in sorted({max(8, round(edge * self.options.scale)) for edge in _SIZES}):
            self.options.say(f"pixels: {side}x{side}")
            rounds = min(3, self.options.views)
            timing, _ = time_frames(self.renderer(), case.scene(), case.cameras()[:3], (side, side), rounds)
            row: Row = {"row": f"pixels: {case.title} at {side}x{side}", "pixels": side * side, **_least(timing)}
            rows.append(row | {"load": load(), "remark": f"cpu {row['cpu_ms']:.1f} ms"})
        return rows + self.laws("pixels, the ball", rows, "pixels")

    def memory(self) -> list[Row]:
        """Measure the bytes of a lattice in a new process."""
        self.options.say("memory: Marschner-Lobb")
        arguments = {"backend": self.options.backend, "scale": self.options.scale, "size": self.options.size}
        found = in_new_process(lattice_memory, **arguments)
        row = {"row": "memory of Marschner-Lobb, 256^3, a drawn kernel, beside the field"} | _memory_row(found)
        name = "memory a drawn kernel beside the data, lattice"
        return [self.judged(row, name, found["peak_draw"] / found["kernels_drawn"], 64.0, "bytes")]

    def camera(self) -> list[Row]:
        """Measure what is prepared anew for each view of a million scattered kernels."""
        edge, count = self.options.edge(128), self.options.count(1_000_000)
        self.options.say(f"camera: {count:,} kernels")
        case = replace(CASES["spheres"](self.options), field=spheres(count, edge), distance=1.0)
        renderer, scene, cameras = self.renderer(), case.scene(), case.cameras()
        first = renderer.render(scene, cameras[-1], size=self.options.size).stats
        timing = Timing()
        for _ in range(min(3, self.options.views)):
            timing.round(renderer, scene, cameras, self.options.size)
        # Backends differ in the names of what they sort and make for a view.
        names = [f"seconds_{part}" for part in ("index", "view", "bucket", "vertices")]
        found = [1000.0 * sum(shot.stats.get(name, 0.0) for name in names) for shot in timing.shots]
        row: Row = {**timing.row(), "row": f"a camera change of {count:,} spheres prepared"}
        row["median_ms"] = statistics.median(found)
        row["remark"] = f"ms, the least; the index, made once: {1000.0 * first.get('seconds_index', 0.0):.0f} ms"
        return [self.judged(row, "a camera change of a million kernels prepared", min(found), 40.0, "ms")]

    # Errors

    def psnr(self) -> list[Row]:
        """Compare flat pictures of the scattered scenes, ours and those of VTK's grid, with converged ones."""

        def measure(name: str, case: Case) -> Row:
            assert isinstance(case.field, ss.EllipsoidField)
            cameras, size, renderer = [case.cameras()[n] for n in (0, 3)], self.options.size, self.renderer()

            def flat(parts: int) -> ss.Scene:
                return case.scene(shaded=False, slice_spacing=case.distance / parts, reference_length=case.unit)

            fine = [renderer.render(flat(16), camera, size=size) for camera in cameras]
            pictures = [renderer.render(flat(1), camera, size=size) for camera in cameras]
            worst = max(difference(p, f)["rmse"] for p, f in zip(pictures, fine, strict=True))
            left = difference(renderer.render(flat(8), cameras[0], size=size), fine[0])["rmse"]
            row: Row = {"rmse": worst, "remark": f"dB; distance 1/8 and 1/16 differ by {decibels(left):.0f} dB"}
            if self.vtk is not None:
                look = Look(case.points, case.unit, case.distance, None, size, 2)
                volume = gridded(case.field, case.edge, self.options.edge(GRID))
                try:
                    for caster in CASTERS:
                        self.vtk.show(caster, volume, look)
                        shots = [self.vtk.frame(caster, camera, picture=True).rgba for camera in cameras]
                        pairs = zip(shots, fine, strict=True)
                        found = decibels(max(rms(rgba - f.rgba) for rgba, f in pairs if rgba is not None))
                        row[f"vtk_{caster}_psnr"] = found
                        row["remark"] += f"; grid and VTK {caster.upper()} {found:.1f} dB"
                except VtkMissing as error:
                    row["remark"] += f"; VTK: {error}"
            text = f"PSNR of {name}, flat, against the converged picture"
            return self.judged(row, text, decibels(worst), 50.0, "dB", least=True)

        return self.each("PSNR, flat, of the converged picture", SCATTERED, measure)

    def errors(self) -> list[Row]:
        """Measure the shaded pictures' distance from the reference; pixels where opacity stops nearby are left out."""

        def measure(name: str, case: Case) -> Row:
            scene, camera = case.scene(), case.cameras()[0]
            expected = Judge(self.options.size, self.options.reference_seconds).reference(scene, camera)
            size = expected.size
            jumps = np.zeros(size[::-1], bool)
            reference = ss.Renderer(backend="reference")
            for step in (-1e-5, 1e-5) if case.opacity_stop < 1.0 else ():
                moved = reference.render(case.scene(opacity_stop=case.opacity_stop + step), camera, size=size)
                jumps |= np.abs(moved.rgba - expected.rgba).max(axis=-1) > 1e-3
            picture = self.renderer().render(scene, camera, size=size).rgba
            apart = np.where(jumps[..., None], 0.0, picture.astype(np.float64) - expected.rgba)
            rmse, p99_9 = rms(apart), float(np.percentile(np.abs(apart).max(axis=-1), 99.9))
            bounds = _GENTLE if steepness(case) <= _STEEPEST else _EVERY
            share = float(jumps.mean())
            row: Row = {"rmse": rmse, "p99_9": p99_9, "ambiguous": share}
            row["remark"] = (
                f"RMSE {rmse:.1e} of {bounds[0]:.0e}, P99.9 {p99_9:.1e} of {bounds[1]:.0e}, "
                f"{100.0 * share:.2g} % at jumps; {size[0]}x{size[1]}"
            )
            worst = max(rmse / bounds[0], p99_9 / bounds[1], share / 0.005)
            return self.judged(row, f"error of {name}, shaded, as a share of the bounds", worst, 1.0)

        return self.each("error, shaded", tuple(name for name in CASES if name not in LARGE), measure)

    def float64(self) -> list[Row]:
        """Time float64 beside float32 and the reference, in a small picture of the same view."""
        size = (max(8, self.options.size[0] // 2), max(8, self.options.size[1] // 2))

        def measure(name: str, case: Case) -> Row:
            scene, cameras = case.scene(), case.cameras()[:2]
            renderers = [self.renderer(precision=kind) for kind in ("float64", "float32")]
            renderers[0].plan(scene, cameras[0], size=size)
            reference = ss.Renderer(backend="reference")
            expected, wall, cpu = clock(lambda: reference.render(scene, cameras[0], size=size))
            rounds = min(3, self.options.views)
            exact, usual = (time_frames(one, scene, cameras, size, rounds)[0].least for one in renderers)
            errors = [difference(one.render(scene, cameras[0], size=size), expected)["rmse"] for one in renderers]
            row: Row = {"ms": 1000.0 * exact, "float32_ms": 1000.0 * usual, "reference_ms": 1000.0 * wall}
            row |= {"rmse": errors[0], "float32_rmse": errors[1]}
            row["remark"] = (
                f"float32 {row['float32_ms']:.0f} ms, reference {row['reference_ms']:.0f} ms (cpu {1000.0 * cpu:.0f}); "
                f"RMSE {errors[0]:.1e}, float32 {errors[1]:.1e}; {size[0]}x{size[1]}"
            )
            return self.judged(row, f"float64 over the reference, {name}", exact / wall, 0.1)

        return self.each("float64, time over the reference's", ("ball", *SCATTERED), measure)


def _memory_row(found: Row) -> Row:
    kept = f"index and view: {found['named'] / found['kernels_drawn']:.1f}"
    remark = f"bytes; the process's peak over what it had with the field; {kept}"
    return {"kernels_drawn": found["kernels_drawn"], "remark": remark}


def bare_loop(kind: str, pixels: float) -> float:
    """Return kernel sections a second of the bare loop on one core. FileNotFoundError where it is not built."""
    built = Path(__file__).resolve().parents[2] / "build" / _BARE_LOOP
    program = Path(os.environ.get("SHEETSPLAT_BARE_LOOP") or built)
    if not program.is_file():
        raise FileNotFoundError(
            f"{program} is not built; ./run bench builds it, SHEETSPLAT_BARE_LOOP names another one"
        )
    done = subprocess.run(
        [str(program.resolve()), kind, f"{pixels:.3f}"], capture_output=True, text=True, check=False, timeout=120
    )
    if done.returncode != 0:
        raise ss.Error(f"{_BARE_LOOP} failed with code {done.returncode}: {done.stderr.strip()[-500:]}")
    return float(json.loads(done.stdout.strip().splitlines()[-1])[0])


def section_pixels(field: ss.EllipsoidField, camera: ss.Camera, size: tuple[int, int], count: int) -> float:
    """Return the mean area of a section in pixels: the volume of all supports over the number of sections."""
    scales = np.asarray(field.scales)
    volume = 4.0 / 3.0 * math.pi * (scales**3 if scales.ndim == 1 else scales.prod(axis=1)).sum()
    return float(volume * (size[1] / camera.height) ** 2 / max(count, 1))


def lattice_memory(backend: str, scale: float, size: list[int]) -> Row:
    """Draw two views of the largest lattice and return bytes over those with the field; for a new process."""
    shown = (size[0], size[1])
    small = CASES["ball"](Options(scale=0.25))
    renderer = renderer_for(Options(backend=backend))
    renderer.render(small.scene(), small.cameras()[0], size=shown)
    case = CASES["ml256"](Options(scale=scale))
    scene = case.scene()
    forget_peak()
    before = resident()
    for camera in case.cameras()[:2]:
        stats = renderer.render(scene, camera, size=shown).stats
    named = sum(stats.get(name, 0.0) for name in ("bytes_index", "bytes_view"))
    return {"kernels_drawn": round(stats["kernels_drawn"]), "peak_draw": resident("VmHWM") - before, "named": named}


def steepness(case: Case) -> float:
    """Return how steep opacity and colours are, times the slice distance over the reference length, over the range."""
    table = np.array(case.points)
    rise = np.abs(np.diff(table[:, 1:], axis=0)) / np.diff(table[:, 0])[:, None]
    return float(rise.max() * (table[-1, 0] - table[0, 0]) * case.distance / case.unit)


# ---------------------------------------------------------------------------------------------------------- together

_PARTS: dict[str, Callable[[_Run], list[Row]]] = {
    **{name: partial(_Run.scene_rows, name=name) for name in CASES},
    "rate": _Run.rate,
    "threads": _Run.threads,
    "kernels": _Run.kernels,
    "pixels": _Run.pixels,
    "memory": _Run.memory,
    "camera": _Run.camera,
    "psnr": _Run.psnr,
    "errors": _Run.errors,
    "float64": _Run.float64,
}

#: Names of the parts that can be run alone.
ROWS = tuple(_PARTS)


@contextmanager
def _peer(options: Options) -> Iterator[tuple[Vtk | None, str]]:
    """Give VTK where it is needed and present, and a note about it."""
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
            "projection, linear interpolation, read back by GetRGBACharPixelData. Its rays end at an opacity of about "
            "0.99.",
        )


def run(options: Options) -> Report:
    """Measure the rows that are wanted."""
    options = options.preferring("cpu")
    rows: list[Row] = []
    with _peer(options) as (vtk, told):
        run = _Run(options, vtk)
        for name, measure in _PARTS.items():
            if options.wants(name):
                rows += measure(run)
    notes = [
        f"Scenes: {VIEWS} views on an orbit, each drawn {options.views} times with the others between; the least (and "
        "the median) of each view, averaged over the views, in elapsed ms from the change of the camera until the "
        "picture is an array. Ours and VTK's casters take turns. measured: our time over that of VTK, least by least; "
        "by cpu time: the same of all threads of each process, which other load on the machine hardly changes.",
        told,
        "opacity: mean over the picture and the views, ours and that of the compared caster; rmse to VTK: of "
        "premultiplied RGBA; the two reconstruct differently. load: mean number of running processes over the last "
        "minute.",
        "Kernels with pixels: radius 3 pixels, 64 deep, five kernels to two pixels, so that overlap and work for a "
        "pixel stay. Kernels: the same ones in one picture. Fitted: cpu time = c x number ^ exponent.",
    ]
    if options.backend != "cpu":
        notes.insert(0, f"This run measures backend {options.backend}, not cpu.")
    found = environment(device_of(renderer_for(options)))
    return Report(
        name="cpu",
        title=f"Backend {options.backend} at {options.size[0]}x{options.size[1]}",
        columns=columns(
            "row=what, kernels_drawn, slices, ms=ours ms (least), median_ms=median, vtk_cpu_ms=VTK CPU ms (least), "
            "vtk_cpu_median_ms=median, vtk_gpu_ms=VTK GPU ms (least), vtk_gpu_median_ms=median, opacity, "
            "vtk_opacity=VTK's opacity, apart=rmse to VTK, measured, goal, quotient=over goal, verdict, "
            "by_cpu=measured by cpu time, load, remark"
        ),
        rows=rows,
        notes=notes,
        goals=run.goals,
        environment=found | {"threads": str(usable_processors())},
    )
