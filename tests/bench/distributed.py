"""Pictures in bricks on clusters: measured costs, and a simulation of clusters that are not here."""

from __future__ import annotations

import heapq
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
from sheetsplat import api
from sheetsplat.bricks.cluster import covering, each
from sheetsplat.bricks.draw import draw_brick
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
_NULL_TASKS = 400
# Views whose fastest counts, and by how much they are turned.
_VIEWS = 3
_TURN = 0.01
_SPIN = 0.3


@dataclass(frozen=True)
class Costs:
    """What drawing takes, seconds of one core.

    Attributes
    ----------
    brick, kernel, sample
        Of a brick, of each of its kernels, and of each pixel and slice in it.
    merge
        Of each pixel of a part that is merged with others.
    scheduler
        Of the scheduler and the client, for each task.
    overhead
        Of a worker, for each task.
    client
        Of the client, before the first task is submitted.
    result
        Of the client, for the picture to reach it.
    """

    brick: float
    kernel: float
    sample: float
    merge: float
    scheduler: float = 1e-3
    overhead: float = 0.0
    client: float = 0.0
    result: float = 0.0

    def drawing(self, kernels: float, samples: float) -> float:
        """Return the time of a brick."""
        return self.brick + self.kernel * kernels + self.sample * samples


@dataclass(frozen=True)
class Machine:
    """A cluster.

    Attributes
    ----------
    workers
        How many.
    speed
        Cores that a worker draws a brick with.
    cores
        Cores that all of them share, with those of the others.
    bandwidth, latency
        Bytes a second of a worker's network, and seconds of a message.
    """

    workers: int
    speed: float = _CORES * _SHARE
    cores: float = math.inf
    bandwidth: float = _BANDWIDTH
    latency: float = _LATENCY


@dataclass(frozen=True)
class Task:
    """A task of a picture.

    Attributes
    ----------
    seconds
        Of one core.
    bytes
        Of the result.
    before
        Tasks whose results it takes.
    place
        Number by which a worker is chosen; None: where most of what it takes is.
    """

    seconds: float
    bytes: float
    before: tuple[int, ...]
    place: int | None = None


@dataclass(frozen=True)
class Run:
    """What a simulation says: seconds of the picture, bytes between workers, and what kept it from being shorter."""

    seconds: float
    moved: float
    work: float
    chain: float
    scheduler: float

    @property
    def limit(self) -> str:
        """The longest of what a picture cannot be shorter than."""
        known = {"work": self.work, "longest chain": self.chain, "scheduler": self.scheduler}
        return max(known, key=lambda name: known[name])


def simulated(tasks: Sequence[Task], machine: Machine, costs: Costs) -> Run:
    """Return what a picture takes, event by event.

    The scheduler serves one message after the other: a task when it is submitted, and when it is done. A worker draws
    one brick at a time, those of lower numbers first; what a task takes from elsewhere comes through the worker's
    network before, one after the other.
    """
    waiting = [len(task.before) + 1 for task in tasks]
    after: list[list[int]] = [[] for _ in tasks]
    for number, task in enumerate(tasks):
        for one in task.before:
            after[one].append(number)
    where = [-1] * len(tasks)
    ready: list[list[int]] = [[] for _ in range(machine.workers)]
    network, busy = [0.0] * machine.workers, [False] * machine.workers
    served = moved = end = 0.0
    active = 0
    # Events: time, order, kind, task.
    order = itertools.count()
    begin = costs.client
    events: list[tuple[float, int, str, int]] = [(begin, next(order), "submit", number) for number in range(len(tasks))]
    heapq.heapify(events)

    def start(worker: int, now: float) -> None:
        nonlocal active
        if busy[worker] or not ready[worker]:
            return
        number = heapq.heappop(ready[worker])
        busy[worker] = True
        active += 1
        # The scheduler is at work while it has messages.
        share = max(1.0, (active + (served > now)) / machine.cores)
        took = costs.overhead + tasks[number].seconds / machine.speed
        heapq.heappush(events, (now + took * share, next(order), "done", number))

    def release(number: int, now: float) -> None:
        nonlocal moved
        waiting[number] -= 1
        if waiting[number]:
            return
        task = tasks[number]
        held: dict[int, float] = {}
        for one in task.before:
            held[where[one]] = held.get(where[one], 0.0) + tasks[one].bytes
        if task.place is not None:
            worker = task.place % machine.workers
        else:
            worker = max(held, key=lambda one: held[one], default=number % machine.workers)
        far = sum(size for one, size in held.items() if one != worker)
        where[number] = worker
        arrived = now + machine.latency
        if far:
            network[worker] = max(network[worker], arrived) + far / machine.bandwidth
            arrived = network[worker] + machine.latency
            moved += far
        heapq.heappush(events, (arrived, next(order), "there", number))

    while events:
        now, _, kind, number = heapq.heappop(events)
        if kind == "submit":
            served = max(served, now) + 0.5 * costs.scheduler
            heapq.heappush(events, (served, next(order), "known", number))
        elif kind == "known":
            release(number, now)
        elif kind == "there":
            heapq.heappush(ready[where[number]], number)
            start(where[number], now)
        elif kind == "done":
            busy[where[number]] = False
            active -= 1
            start(where[number], now)
            served = max(served, now + machine.latency) + 0.5 * costs.scheduler
            heapq.heappush(events, (served, next(order), "told", number))
        else:
            end = now
            for one in after[number]:
                release(one, now)
    longest = [0.0] * len(tasks)
    for number, task in enumerate(tasks):
        longest[number] = task.seconds / machine.speed + max((longest[one] for one in task.before), default=0.0)
    capacity = min(machine.workers, machine.cores) * machine.speed
    work = sum(task.seconds for task in tasks) / capacity
    return Run(end + costs.result, moved, work, max(longest), costs.scheduler * len(tasks))


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


def _picture(data: Any, pixels: int, turn: int = 0) -> dict[str, Any]:
    """Return options of a lit, translucent picture without a stop: of one of many views."""
    table = [(0.0, 0.2, 0.4, 0.9, 0.0), (255.0, 1.0, 0.8, 0.5, 0.02)]
    camera = ss.Camera.fit(data, direction=(-0.5 + _TURN * turn, -0.4, -1.0))
    return {"size": pixels, "camera": camera, "transfer_function": table, "quality": "draft", "backend": "cpu",
            "opacity_stop": 1.0}  # fmt: skip


def _view(field: Any, pixels: int, turn: int = 0) -> tuple[BrickView, list[int]]:
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
    renderer = ss.Renderer("cpu", threads=1)
    for size in pixels:
        views = [_view(field, size, turn) for turn in range(1 + _VIEWS)]
        shown = [number for number in views[0][1] if all(number in others for _, others in views)]
        chosen = shown[:: max(1, len(shown) // 6)]
        # The first view also reads the bricks.
        times = np.array([[_seconds_of_brick(field, view, number, renderer) for number in chosen] for view, _ in views])
        for number, least in zip(chosen, times[1:].min(axis=0).tolist(), strict=True):
            samples = float(np.mean([_samples(view, number) for view, _ in views[1:]]))
            facts.append((1.0, float(field_of(field.source, views[0][0], number).size), samples))
            seconds.append(least)
    return np.asarray(facts), np.asarray(seconds)


def _seconds_of_brick(field: Any, view: BrickView, number: int, renderer: ss.Renderer) -> float:
    """Return seconds of a core for a brick of a picture, as a task draws it."""
    began = time.thread_time()
    draw_brick(view, number, field_of(field.source, view, number), renderer)
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
        merge(*parts)
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


def _nothing(*_: Any) -> None:
    """Take the time of a task that does nothing."""


def _cores_used() -> float:
    return time.process_time()


@dataclass(frozen=True)
class _NoSource:
    """What tasks take that read nothing."""

    token: str = "nothing"
    name: str = "nothing"


def costs_of_cluster(client: Any, field: Any, pixels: int, costs: Costs) -> Costs:
    """Return costs with what the cluster itself takes, measured by tasks that do nothing and views that are not drawn.

    The scheduler shares a process with the client here. What both take for a task is processor time of this process;
    what a worker takes beside a task's own work is that of the workers.
    """
    task, merge = ("render-brick", _nothing), ("merge", _nothing)
    source: Any = _NoSource()
    count = 0
    for turn in range(2):
        # The first time finds out where functions are.
        used, there = time.process_time(), sum(client.run(_cores_used).values())
        each(client, source, None, _NULL_TASKS, task, merge)
        count = _NULL_TASKS + math.ceil(_NULL_TASKS / (MERGED - 1))
        scheduler = (time.process_time() - used) / count
        overhead = (sum(client.run(_cores_used).values()) - there) / count
        _view(field, pixels, turn)
    planning, fetching = [], []
    for turn in range(1, 1 + _VIEWS):
        used = time.process_time()
        _view(field, pixels, turn)
        planning.append(time.process_time() - used)
        future = client.submit(np.full, (pixels, pixels, 4), np.float32(turn), pure=False)
        future.add_done_callback(_nothing)
        while not future.done():
            time.sleep(0.01)
        used = time.process_time()
        future.result()
        fetching.append(time.process_time() - used)
    return replace(
        costs,
        scheduler=scheduler,
        overhead=overhead,
        client=float(np.median(planning)),
        result=float(np.median(fetching)),
    )


def _share(_: int) -> float:
    """Return the share of a core that a task gets: other programs, and the worker itself, may have the rest."""
    began, used = time.perf_counter(), time.thread_time()
    while time.perf_counter() - began < _SPIN:
        pass
    return (time.thread_time() - used) / (time.perf_counter() - began)


def real(options: Options, costs: Costs) -> list[Row]:
    """Draw pictures with one, two and four worker processes, and simulate the same."""
    import distributed

    start: Any = distributed.LocalCluster
    connect: Any = distributed.Client
    edge, brick = options.edge(_EDGE), options.edge(_BRICK)
    pixels = max(60, round(_PIXELS * options.scale))
    values = ball(edge)
    rows = []
    for workers in _WORKERS:
        options.say(f"{workers} workers")
        with (
            start(
                n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
            ) as made,
            connect(made) as client,
        ):
            field = ss.open_bricks(values, brick=brick, client=client, quality="draft")
            known = costs_of_cluster(client, field, pixels, costs)
            times, shares = [], []
            known_workers = sorted(client.nthreads())
            for turn in range(max(2, options.views) + 1):
                picture = {**_picture(field, pixels, turn), "threads": 1}
                spins = [client.submit(_share, n, pure=False, workers=[one]) for n, one in enumerate(known_workers)]
                shares.append(sum(client.gather(spins)))
                began = time.perf_counter()
                image = ss.render(field, client=client, **picture)
                times.append(time.perf_counter() - began)
            cores = float(np.mean(shares[1:]))
            here = ss.open_bricks(values, brick=brick, quality="draft")
            view, shown = _view(here, pixels)
            tasks = Graph.of(view, shown).tasks(_seconds_of(view, known), known)
            machine = Machine(workers, 1.0, cores, 1e9, 1e-3)
            run = simulated(tasks, machine, known)
        took = float(np.median(times[1:]))
        rows.append(
            {
                "row": f"{edge}^3 in {len(shown)} bricks, {workers} workers",
                "cores": cores,
                "seconds": took,
                "simulated": run.seconds,
                "off": run.seconds / took - 1.0,
                "client": known.client + known.result,
                "task": 1e3 * (known.scheduler + known.overhead),
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
    whole = Whole.of_lattice(lattice, (0.0, 1.0))
    look = ss.TransferFunction([(0, 0, 0, 0, 0), (1, 1, 1, 1, 0.02)])
    middle = 0.5 * (bricks - 1)
    direction = np.array((-0.5, -0.4, -1.0)) / np.linalg.norm((-0.5, -0.4, -1.0))
    eye = np.full(3, middle) - 2.0 * bricks * direction
    camera = ss.Camera.orthographic(tuple(eye), (middle,) * 3, height=1.5 * bricks)
    view = BrickView.of(
        partition, whole, look, {"slice_spacing": 1e-3, "opacity_stop": stop}, camera, size, lattice=lattice
    )
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

            run = simulated(_grid(cut, _FILM, stop).tasks(seconds, costs), Machine(workers), costs)
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
        f"Gbit/s; the scheduler takes {1e3 * lattice.scheduler:g} ms a task. Pictures have {_FILM[0]}x{_FILM[1]} "
        "pixels; data are resident, nothing is empty or hidden, and no level of a pyramid is taken but where means are "
        "told: the worst case. Coarser levels have the slices of all samples.",
        "work, chain, scheduler: seconds that the picture cannot be shorter than, by all drawing on all cores, by "
        "bricks that wait for those in front, and by tasks that the scheduler handles one by one.",
        "cores there: what spinning workers got between the pictures, whose median counts; others had the rest.",
        f"Load of this machine: {os.getloadavg()[0]:.1f}.",
    ]
    if scattered is not None:
        notes.insert(1, f"The fit of spheres is {100 * scattered:.0f} % from its bricks.")
    return Report(
        name="distributed",
        title="Pictures in bricks on clusters",
        columns=columns(
            "row=what, bricks, cores=cores there, seconds=s, simulated=simulated s, off=off by, client=client s, "
            "task=ms a task, work=work s, "
            "chain=chain s, scheduler=scheduler s, moved=GB moved, memory=GB a worker, read=bricks read, limit, remark"
        ),
        rows=rows,
        goals=goals,
        notes=notes,
    )


__all__ = ["ROWS", "Costs", "Graph", "Machine", "Run", "Task", "run", "simulated"]
