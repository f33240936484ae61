"""Pictures in bricks on clusters: measured costs, and a simulation of clusters that are not here."""

from __future__ import annotations

import hashlib
import itertools
import math
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

import sheetsplat as ss
from bench.report import Goal, Options, Report, Row, columns
from bench.simulation import Costs, Machine, Run, Task, simulated
from sheetsplat import api
from sheetsplat.bricks.cluster import covering, each
from sheetsplat.bricks.draw import draw_brick, render_brick
from sheetsplat.bricks.lattice import LatticeSpec
from sheetsplat.bricks.needs import field_of, may_show, planned, view_of
from sheetsplat.bricks.partial import Partial, merge
from sheetsplat.bricks.partition import MERGED, Grouped, grouped, partition_lattice
from sheetsplat.bricks.view import BrickView
from sheetsplat.bricks.whole import Whole

ROWS = ("real", "4096", "16384", "particles")
# Real runs: edge of the volume, of its bricks, and pixels of the picture.
_EDGE, _BRICK, _PIXELS = 160, 40, 400
_WORKERS = (1, 2, 4)
_SIMULATED = (10, 64, 256, 1024, 4096)
# Bytes of a part's pixel: float32 red, green, blue and opacity.
_PIXEL_BYTES = 16
# Bytes of a kernel that is resident: of a byte volume samples and their border, of spheres centre, radius and value.
_VOLUME_BYTES, _SPHERE_BYTES = 1.3, 48.0
# A cluster: cores of a worker, share of them that a brick uses, bytes a second and seconds of latency of its network.
_CORES, _SHARE, _BANDWIDTH, _LATENCY = 16, 0.7, 1.25e9, 2e-4
_FILM = (3840, 2160)
# Samples along each axis of which a coarser level has the mean.
_FEW = 4
# Tasks that only keep a core busy, seconds of each, and bytes that they hash again and again.
_TASKS, _BUSY, _HASHED = 64, 0.01, 200_000
# Of the bricks of a worker, every so many are drawn to know what they take; bytes of an array that is moved.
_EVERY, _LARGE = 4, 8_000_000
# Views whose fastest counts, and by how much they are turned.
_VIEWS = 3
_TURN = 0.01
_SPIN = 0.3


@dataclass(frozen=True)
class Graph:
    """The tasks of a picture in mode composite, as `sheetsplat.bricks.cluster` submits them.

    Attributes
    ----------
    bricks
        Numbers of the bricks from front to back, each with its pixels and the tasks that it waits for.
    merges
        Pixels of each merged part, and the tasks whose results it takes; the last one is the picture.
    """

    bricks: tuple[tuple[int, int, tuple[int, ...]], ...]
    merges: tuple[tuple[int, tuple[int, ...]], ...]

    @classmethod
    def of(cls, view: BrickView, shown: Sequence[int]) -> Graph:
        """Return the tasks of a picture of the bricks that may show, from front to back."""
        numbers = {brick: number for number, brick in enumerate(shown)}
        behind = {} if view.any_order else covering(view, shown)
        rects = {brick: view.footprint(brick) or (0, 0, 0, 0) for brick in shown}
        bricks = tuple(
            (brick, _area(rects[brick]), tuple(numbers[one] for one in behind.get(brick, ()))) for brick in shown
        )
        merges: list[tuple[int, tuple[int, ...]]] = []

        def merged(group: Grouped) -> tuple[int, Any]:
            if isinstance(group, int):
                return numbers[group], rects[group]
            parts = [merged(one) for one in group]
            firsts, lasts = zip(*((one[:2], one[2:]) for _, one in parts), strict=True)
            rect = (*map(min, zip(*firsts, strict=True)), *map(max, zip(*lasts, strict=True)))
            merges.append((_area(rect), tuple(number for number, _ in parts)))
            return len(shown) + len(merges) - 1, rect

        tree = grouped(view.nested(), shown)
        assert tree is not None
        last = merged(tree)
        merges.append((view.size[0] * view.size[1], (last[0],)))
        return cls(bricks, tuple(merges))

    def tasks(self, seconds: Callable[[int, int], float], costs: Costs) -> list[Task]:
        """Return the tasks; `seconds`: of drawing a brick, by its number and its pixels."""
        drawn = [
            Task(seconds(brick, pixels), pixels * _PIXEL_BYTES, before, brick) for brick, pixels, before in self.bricks
        ]
        areas = [pixels for _, pixels, _ in self.bricks] + [pixels for pixels, _ in self.merges]
        return drawn + [
            Task(costs.merge * sum(areas[one] for one in before), pixels * _PIXEL_BYTES, before)
            for pixels, before in self.merges
        ]


def _area(rect: tuple[int, int, int, int]) -> int:
    return (rect[2] - rect[0]) * (rect[3] - rect[1])


def ball(edge: int) -> np.ndarray[Any, Any]:
    """Return soft shells with noise, bytes: something shows in every brick."""
    axis = np.linspace(-1.0, 1.0, edge)
    radius = np.sqrt(axis[:, None, None] ** 2 + axis[None, :, None] ** 2 + axis[None, None, :] ** 2)
    noise = np.random.default_rng(4).normal(0.0, 6.0, radius.shape)
    return np.asarray(np.clip(110 + 60 * np.sin(9.0 * radius) + noise, 1, 255), np.uint8)


def _picture(data: Any, pixels: int, turn: float = 0) -> dict[str, Any]:
    """Return options of a lit, translucent picture without a stop: of one of many views."""
    table = [(0.0, 0.2, 0.4, 0.9, 0.0), (255.0, 1.0, 0.8, 0.5, 0.02)]
    camera = ss.Camera.fit(data, direction=(-0.5 + _TURN * turn, -0.4, -1.0))
    return {"size": pixels, "camera": camera, "transfer_function": table, "quality": "draft", "backend": "cpu",
            "opacity_stop": 1.0}  # fmt: skip


def _view(field: Any, pixels: int, turn: float = 0) -> tuple[BrickView, list[int]]:
    """Return the view of a picture of a bricked field, and the bricks that may show."""
    made = api.prepare(field, **_picture(field, pixels, turn))
    settings = {**made.renderer.settings, "threads": 1}
    view, _ = planned(made.scene, view_of(field, made.scene, made.camera, made.size, (), None, settings))
    return view, [number for number in view.order() if may_show(field, view, number)]


def _samples(view: BrickView, number: int) -> float:
    """Return pixels times slices of a brick."""
    region, rect = view.partition.bricks[number].cell, view.footprint(number)
    assert rect is not None
    lower, upper = np.asarray(view.whole.centres)
    extent = np.minimum(upper, region[1]) - np.maximum(lower, region[0])
    along = float(np.abs(extent) @ np.abs(np.asarray(view.camera.world_axes()[2])))
    return _area(rect) * along / view.slice_spacing


def measured(field: Any, pixels: Sequence[int]) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Return (1, kernels, samples) of some bricks of a field in pictures of some sizes, and their seconds of a core.

    Views differ, as those of films do: kernels are sorted by tiles for each.
    """
    facts, seconds = [], []
    for size in pixels:
        views = [_view(field, size, turn) for turn in range(1 + _VIEWS)]
        shown = [number for number in views[0][1] if all(number in others for _, others in views)]
        chosen = shown[:: max(1, len(shown) // 6)]
        # The first view also reads the bricks.
        times = np.array([[_seconds_of_brick(field, view, number) for number in chosen] for view, _ in views])
        for number, least in zip(chosen, times[1:].min(axis=0).tolist(), strict=True):
            samples = float(np.mean([_samples(view, number) for view, _ in views[1:]]))
            facts.append((1.0, float(field_of(field.source, views[0][0], number).size), samples))
            seconds.append(least)
    return np.asarray(facts), np.asarray(seconds)


def _seconds_of_brick(field: Any, view: BrickView, number: int) -> float:
    """Return seconds of a core for a brick of a picture, as a task draws it."""
    began = time.thread_time()
    draw_brick(view, number, field_of(field.source, view, number))
    return time.thread_time() - began


def fitted(facts: Any, seconds: Any) -> tuple[float, float, float]:
    """Return non-negative coefficients whose sums are nearest to the seconds, relative to them."""
    known = list(range(facts.shape[1]))
    while True:
        found = np.linalg.lstsq(facts[:, known] / seconds[:, None], np.ones(len(seconds)), rcond=None)[0]
        if (found >= 0).all():
            break
        del known[int(np.argmin(found))]
    result = np.zeros(facts.shape[1])
    result[known] = found
    a, b, c = result.tolist()
    return a, b, c


def _merge_seconds() -> float:
    """Return seconds of merging a pixel of a part."""
    side = 400
    parts = [
        Partial("composite", (0, 0, side, side), rgba=np.full((side, side, 4), 0.1, np.float32), is_behind=True)
        for _ in range(2)
    ]
    times = []
    for _ in range(5):
        began = time.process_time()
        merge(None, *parts)
        times.append(time.process_time() - began)
    return min(times) / (len(parts) * side**2)


def costs_of(options: Options, *, scattered: bool) -> tuple[Costs, float]:
    """Return measured costs, and the relative residual of the fit."""
    facts, seconds = [], []
    for edge, sizes in ((32, (150, 600)), (64, (150, 400))):
        edge = options.edge(edge)
        if scattered:
            count = edge**3
            random = np.random.default_rng(1)
            radius = 2.0 * (4.0 / 3.0 * math.pi * count / 6.0) ** (-1.0 / 3.0)
            points = random.uniform(-1.0, 1.0, (count, 3))
            made = ss.EllipsoidField(points, np.full(count, radius), values=random.uniform(1.0, 255.0, count), w0=0.1)
            field = ss.open_bricks(made, brick_kernels=-(-count // 8))
        else:
            field = ss.open_bricks(ball(2 * edge), brick=edge, quality="draft")
        one, other = measured(field, [max(40, round(size * options.scale)) for size in sizes])
        facts.append(one)
        seconds.append(other)
    every, took = np.concatenate(facts), np.concatenate(seconds)
    brick, kernel, sample = fitted(every, took)
    off = float(np.sqrt(np.mean((every @ (brick, kernel, sample) / took - 1.0) ** 2)))
    return Costs(brick, kernel, sample, _merge_seconds()), off


@dataclass(frozen=True)
class _NoSource:
    """What tasks take that read nothing."""

    token: str = "nothing"
    name: str = "nothing"


@dataclass(frozen=True)
class _Busy:
    """Tasks that are done: of each its process, its begin and end, and the seconds of a core that it took."""

    tasks: tuple[tuple[int, float, float, float], ...]


def _be_busy(seconds: float, *_: Any) -> _Busy:
    """Keep a core busy for some time as drawing does: other threads of the process go on meanwhile."""
    content = bytes(_HASHED)
    began, used = time.time(), time.thread_time()
    while (took := time.thread_time() - used) < seconds:
        hashlib.blake2b(content)
    return _Busy(((os.getpid(), began, time.time(), took),))


def _all_busy(_: Any, *parts: _Busy) -> _Busy:
    return _Busy(tuple(one for part in parts for one in part.tasks))


def _used() -> float:
    return time.process_time()


def costs_of_tasks(client: Any, costs: Costs) -> tuple[Costs, float]:
    """Return costs with what the cluster itself takes for tasks, and seconds between two tasks of a worker.

    Measured are pictures of tasks that do no more than keep a core busy: what the scheduler, which shares a process
    with the client here, and the workers take of the cores beside the tasks themselves.
    """
    found = []
    for _ in range(1 + _VIEWS):
        here, there, began = _used(), sum(client.run(_used).values()), time.time()
        source: Any = _NoSource()
        done: _Busy = each(client, source, _BUSY, _TASKS, ("render-brick", _be_busy), ("merge", _all_busy))
        here, there = _used() - here, sum(client.run(_used).values()) - there
        processes: dict[int, list[tuple[float, float]]] = {}
        for process, begin, end, _ in sorted(done.tasks, key=lambda one: one[1]):
            processes.setdefault(process, []).append((begin, end))
        gaps = [then[0] - before[1] for mine in processes.values() for before, then in itertools.pairwise(mine)]
        lead = min(begin for _, begin, _, _ in done.tasks) - began
        found.append((here, there - sum(took for *_, took in done.tasks), lead, float(np.median(gaps))))
    # The first time finds out where functions are.
    client_used, beside, lead, gap = np.median(found[1:], axis=0).tolist()
    count = _TASKS + math.ceil(_TASKS / (MERGED - 1))
    submit = lead / count
    return replace(costs, submit=submit, scheduler=max(0.0, client_used / count - submit), overhead=beside / count), gap


def _wait_for(future: Any) -> None:
    while not future.done():
        time.sleep(0.01)


def costs_of_client(field: Any, pixels: int, costs: Costs, client: Any) -> Costs:
    """Return costs with what the client takes before its tasks, by views that are not drawn, and for the picture."""
    planning, fetching = [], []
    for turn in range(1 + _VIEWS):
        used = time.process_time()
        _view(field, pixels, turn)
        planning.append(time.process_time() - used)
        future = client.submit(np.full, (pixels, pixels, 4), np.float32(turn), pure=False)
        _wait_for(future)
        began = time.perf_counter()
        future.result()
        fetching.append(time.perf_counter() - began)
    return replace(costs, client=float(np.median(planning[1:])), result=float(np.median(fetching[1:])))


def _length(array: Any) -> int:
    return len(array)


def network_of(client: Any) -> tuple[float, float]:
    """Return bytes a second from worker to worker, and seconds of a message."""
    first, second = sorted(client.nthreads())[:2]
    seconds = {}
    for size in (1, _LARGE):
        times = []
        for turn in range(1 + _VIEWS):
            array = client.submit(np.full, size, turn, np.uint8, pure=False, workers=[first])
            _wait_for(array)
            took = []
            for worker in (first, second):
                began = time.perf_counter()
                client.submit(_length, array, pure=False, workers=[worker]).result()
                took.append(time.perf_counter() - began)
            times.append(took[1] - took[0])
        seconds[size] = float(np.median(times[1:]))
    # A task that takes data from elsewhere waits for a question and its answer.
    return _LARGE / max(1e-9, seconds[_LARGE] - seconds[1]), max(1e-6, 0.5 * seconds[1])


def _share(_: int) -> float:
    """Return the share of a core that a task gets: other programs, and the worker itself, may have the rest."""
    content = bytes(_HASHED)
    began, used = time.perf_counter(), time.thread_time()
    while time.perf_counter() - began < _SPIN:
        hashlib.blake2b(content)
    return (time.thread_time() - used) / (time.perf_counter() - began)


def cores_there(client: Any) -> float:
    """Return how many cores busy workers get; where these are fewer than cores this process is busy too."""
    workers = sorted(client.nthreads())
    spins = [client.submit(_share, number, pure=False, workers=[one]) for number, one in enumerate(workers)]
    mine = [_share(0)] if len(workers) < len(os.sched_getaffinity(0)) else []
    return float(sum(client.gather(spins)) + sum(mine))


def _draw_some(view: BrickView, source: Any, numbers: Sequence[int]) -> list[tuple[tuple[float, float, float], float]]:
    """Return (1, kernels, samples) of bricks, and what their tasks take of a core."""
    found = []
    for number in numbers:
        used = time.thread_time()
        render_brick(view, source, number, None)
        took = time.thread_time() - used
        found.append(((1.0, float(field_of(source, view, number).size), _samples(view, number)), took))
    return found


def drawn_by_workers(client: Any, field: Any, pixels: int, turn: float, *, at_once: bool) -> list[Any]:
    """Return what `_draw_some` does of bricks of a view, by workers that draw one after another, or all at once."""
    view, shown = _view(field, pixels, turn)
    workers = sorted(client.nthreads())
    futures = []
    for place, worker in enumerate(workers):
        mine = [number for number in shown if number % len(workers) == place][::_EVERY]
        futures.append(client.submit(_draw_some, view, field.source, mine, pure=False, workers=[worker]))
        if not at_once:
            futures[-1].result()
    return [one for part in client.gather(futures) for one in part]


def real(options: Options, costs: Costs) -> list[Row]:
    """Draw pictures with one, two and four worker processes, and simulate the same.

    What is simulated is measured by experiments of their own, in turns with the pictures: bricks of views that no
    picture shows, by all workers at once; tasks that do nothing but keep a core busy; arrays that go from worker to
    worker; shares of the cores that busy processes get.
    """
    import distributed

    start: Any = distributed.LocalCluster
    connect: Any = distributed.Client
    edge, brick = options.edge(_EDGE), options.edge(_BRICK)
    pixels = max(60, round(_PIXELS * options.scale))
    values = ball(edge)
    rows = []
    gap = None
    for workers in _WORKERS:
        options.say(f"{workers} workers")
        with (
            start(
                n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
            ) as made,
            connect(made) as client,
        ):
            field = ss.open_bricks(values, brick=brick, client=client, quality="draft")
            known, found = costs_of_tasks(client, costs_of_client(field, pixels, costs, client))
            # Several workers leave less of the cores to each other, which is simulated.
            gap = found if gap is None else gap
            between = min(known.overhead, gap)
            known = replace(known, pause=gap - between, overhead=between, beside=known.overhead - between)
            network = network_of(client) if workers > 1 else (1e9, 1e-4)
            times, shares, alone, together = [], [], [], []
            for turn in range(max(2, options.views) + 1):
                shares.append(cores_there(client))
                alone.append(drawn_by_workers(client, field, pixels, turn + 0.5, at_once=False))
                together.append(drawn_by_workers(client, field, pixels, turn + 0.75, at_once=True))
                began = time.perf_counter()
                image = ss.render(field, client=client, **{**_picture(field, pixels, turn), "threads": 1})
                times.append(time.perf_counter() - began)
            cores = float(np.median(shares[1:]))
            each_alone, each_together = (
                [np.median([turn[n][1] for turn in one[1:]]) for n in range(len(one[0]))] for one in (alone, together)
            )
            coefficients = fitted(np.asarray([one for one, _ in together[-1]]), np.asarray(each_together))
            known = replace(known, **dict(zip(("brick", "kernel", "sample"), coefficients, strict=True)))
            view, shown = _view(field, pixels)
            tasks = Graph.of(view, shown).tasks(_seconds_of(view, known), known)
            run = simulated(tasks, Machine(workers, 1.0, cores, *network), known)
        took = float(np.median(times[1:]))
        rows.append(
            {
                "row": f"{edge}^3 in {len(shown)} bricks, {workers} workers",
                "cores": cores,
                "seconds": took,
                "spread": float(np.ptp(times[1:])) / took,
                "simulated": run.seconds,
                "off": run.seconds / took - 1.0,
                "brick_ms": 1e3 * float(np.mean(each_together)),
                "at_once": float(np.sum(each_together) / np.sum(each_alone)),
                "client": known.client + known.submit * len(tasks) + known.result,
                "task": 1e3 * (known.scheduler + known.overhead + known.beside),
                "gap": 1e3 * gap,
                "read": image.stats["bricks_read"],
                "moved": 1e-9 * run.moved,
                "limit": run.limit,
            }
        )
    return rows


def _seconds_of(view: BrickView, costs: Costs) -> Callable[[int, int], float]:
    def seconds(number: int, pixels: int) -> float:
        box = view.samples(number)
        kernels = math.prod(last - first for first, last in box)
        return costs.drawing(kernels, _samples(view, number))

    return seconds


@cache
def _grid(bricks: int, size: tuple[int, int], stop: float) -> Graph:
    """Return the tasks of a cube of so many bricks along each axis, with an opacity stop."""
    lattice = LatticeSpec((bricks,) * 3, radius=1e-3)
    partition = partition_lattice(lattice, 1)
    whole = Whole.of_lattice(lattice, (0.0, 1.0), ((0.0,) * 3, (bricks - 1.0,) * 3))
    look = ss.TransferFunction([(0, 0, 0, 0, 0), (1, 1, 1, 1, 0.02)])
    middle = 0.5 * (bricks - 1)
    direction = np.array((-0.5, -0.4, -1.0)) / np.linalg.norm((-0.5, -0.4, -1.0))
    eye = np.full(3, middle) - 2.0 * bricks * direction
    camera = ss.Camera.orthographic(tuple(eye), (middle,) * 3, height=1.5 * bricks)
    view = BrickView.of(partition, whole, look, {"slice_spacing": 1e-3, "opacity_stop": stop}, camera, size)
    return Graph.of(view, [number for number in view.order() if view.footprint(number) is not None])


def large(
    options: Options,
    name: str,
    data: tuple[float, float, float],
    costs: Costs,
    cuts: Sequence[int],
    stop: float,
) -> list[Row]:
    """Simulate pictures of data that are too large for this machine.

    Parameters
    ----------
    options
        Of the run.
    name
        What it is called.
    data
        Slices of a picture along an edge, number of kernels, and bytes of each in memory.
    costs
        Measured.
    cuts
        Numbers of bricks along an edge that are tried.
    stop
        Opacity at which pixels are finished; 1: bricks need not wait for those in front.
    """
    side, kernels, bytes_each = data
    rows = []
    for workers in _SIMULATED:
        options.say(f"{name}, {workers} workers")
        best: tuple[Run, int] | None = None
        for cut in cuts:

            def seconds(_: int, pixels: int, cut: int = cut) -> float:
                return costs.drawing(kernels / cut**3, pixels * side / cut)

            run = simulated(
                _grid(cut, _FILM, stop).tasks(seconds, costs),
                Machine(workers, _CORES * _SHARE, math.inf, _BANDWIDTH, _LATENCY),
                costs,
            )
            if best is None or run.seconds < best[0].seconds:
                best = run, cut
        assert best is not None
        run, cut = best
        rows.append(
            {
                "row": f"{name}, {workers} workers",
                "bricks": cut**3,
                "simulated": run.seconds,
                "work": run.work,
                "chain": run.chain,
                "scheduler": run.scheduler,
                "moved": 1e-9 * run.moved,
                "memory": 1e-9 * kernels * bytes_each / workers,
                "limit": run.limit,
            }
        )
    return rows


def run(options: Options) -> Report:
    """Measure what bricks, merges and tasks take here, draw with real workers, and simulate larger clusters."""
    options.say("costs of lattices")
    lattice, off = costs_of(options, scattered=False)
    rows: list[Row] = []
    goals: list[Goal] = []
    if options.wants("real"):
        try:
            found = real(options, lattice)
            rows += found
            if options.scale == 1.0:
                goals += [Goal(f"simulation, {one['row']}", abs(one["off"]), 0.2) for one in found]
        except ImportError as error:
            rows.append({"row": "real", "remark": f"skipped: {error}"})
    cuts = (4, 8, 16, 24) if options.scale == 1.0 else (4,)
    stops = {"": 0.98, ", no stop": 1.0}
    for name, side in {"4096": 4096.0, "16384": 16384.0}.items():
        # Where four samples lie behind a pixel along each axis, a pyramid has their means (`open_bricks(levels=2)`).
        levels = {"": 1.0} if side < _FEW * _FILM[0] else {"": 1.0, f", means of {_FEW}^3": 1.0 / _FEW**3}
        for (told, stop), (level, share) in itertools.product(stops.items(), levels.items()):
            if options.wants(name):
                data = (1.5 * side, share * side**3, _VOLUME_BYTES)
                rows += large(options, f"{side:.0f}^3{level}{told}", data, lattice, cuts, stop)
    if options.scale == 1.0 and options.wants("16384"):
        seconds = [one["simulated"] for one in rows if one["row"].startswith("16384^3") and "1024 w" in one["row"]]
        goals.append(Goal("16384^3 at 3840x2160 on 1,024 workers of 16 cores", min(seconds), 10.0, "s"))
    scattered = None
    if options.wants("particles"):
        options.say("costs of spheres")
        spheres, scattered = costs_of(options, scattered=True)
        for told, stop in stops.items():
            data = (4096.0, 1e11, _SPHERE_BYTES)
            rows += large(options, f"10^11 particles{told}", data, spheres, cuts, stop)
    each = f"{1e6 * lattice.brick:.0f} µs a brick, {1e9 * lattice.kernel:.1f} ns a kernel, "
    each += f"{1e9 * lattice.sample:.2f} ns a pixel and slice, {1e9 * lattice.merge:.1f} ns a merged pixel"
    notes = [
        f"Costs of lattices on one core: {each}; the fit is {100 * off:.0f} % from the bricks that it was made of.",
        f"Simulated workers have {_CORES} cores, of which a brick uses {_CORES * _SHARE:g}, and {8e-9 * _BANDWIDTH:g} "
        f"Gbit/s; the scheduler takes {1e3 * (lattice.submit + lattice.scheduler):g} ms a task. Pictures have "
        f"{_FILM[0]}x{_FILM[1]} pixels; data are resident, nothing is empty or hidden, and no level of a pyramid is "
        "taken but where means are told: the worst case. Coarser levels have the slices of all samples.",
        "work, chain, scheduler: seconds that the picture cannot be shorter than, by all drawing on all cores, by "
        "bricks that wait for those in front, and by tasks that the scheduler handles one by one.",
        "cores there: what busy processes got between the pictures, whose median counts, and whose spread is the "
        "largest less the least; others had the rest. ms a brick: of a core, drawn by all workers at once between the "
        "pictures; at once: that over what it takes where one worker draws alone. client: before the first task, and "
        "for the picture. ms a task: of the cores, beside drawing; ms between: from one task of a worker to the next.",
        f"Load of this machine: {os.getloadavg()[0]:.1f}.",
    ]
    if scattered is not None:
        notes.insert(1, f"The fit of spheres is {100 * scattered:.0f} % from its bricks.")
    return Report(
        name="distributed",
        title="Pictures in bricks on clusters",
        columns=columns(
            "row=what, bricks, cores=cores there, seconds=s, spread, simulated=simulated s, off=off by, "
            "brick_ms=ms a brick, at_once=at once, client=client s, task=ms a task, gap=ms between, work=work s, "
            "chain=chain s, scheduler=scheduler s, moved=GB moved, memory=GB a worker, read=bricks read, limit, remark"
        ),
        rows=rows,
        goals=goals,
        notes=notes,
    )


__all__ = ["ROWS", "Graph", "run"]
