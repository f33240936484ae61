"""Pictures in bricks by the workers of a client of dask.distributed.

Nothing passes through the client but plans and pictures. A brick is read by a worker, which keeps it for further views
(`bricks.resident`) and draws all pictures of it. Where a worker is gone, others take its bricks, and the picture begins
again. A brick is drawn as soon as the bricks that cover its pixels are done, with the opacity that is in front of it:
stop and depth are those of a picture in one process, and what an opaque front hides is neither read nor drawn. What
bricks add is merged on the workers along the k-d tree, so that the bits of a picture do not depend on the workers.
"""

from __future__ import annotations

import itertools
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._waiting import asking, begun, note, wait
from sheetsplat.bricks.kernel_pieces import Pieces
from sheetsplat.bricks.kernel_source import Columns, Segments, Store
from sheetsplat.bricks.kernel_survey import KernelSurvey
from sheetsplat.bricks.levels import LevelStore
from sheetsplat.bricks.light import light_key, planned_light
from sheetsplat.bricks.light_error import Probes
from sheetsplat.bricks.needs import may_dim, may_show, source_key
from sheetsplat.bricks.partial import Finished, empty, finish
from sheetsplat.bricks.partition import MERGED, Grouped, Partition, grouped
from sheetsplat.bricks.probe import Probing
from sheetsplat.bricks.sources import BrickSource
from sheetsplat.bricks.statistics import BrickSurvey, SurveyPlan
from sheetsplat.bricks.tasks import (
    choose_spots,
    coarsen_one,
    counts_of,
    finish_picture,
    let_go_of_all,
    light_brick,
    light_lines,
    light_spots,
    make_light,
    measure_light,
    merge_brick_surveys,
    merge_light,
    merge_lines,
    merge_parts,
    merge_piece_surveys,
    merge_segments,
    merge_spots,
    merge_values,
    nothing,
    probe_brick,
    render_brick,
    same,
    sort_piece,
    survey_brick,
    survey_piece,
)
from sheetsplat.bricks.view import BrickView
from sheetsplat.bricks.watch import Watch, connected
from sheetsplat.bricks.workers import Workers, memory_limit, workers_of
from sheetsplat.errors import Error, OutOfMemory, complain
from sheetsplat.fields import BrickedField, BrickedKernels
from sheetsplat.options.renderer import Progress

# How many workers may be lost in one picture.
_MOST_LOST = 4
# Seconds without a task that is done until it is looked for workers that dask has paused, and until these, which have
# let go of all that they kept meanwhile, are given up.
_STALLED = 5.0
_GIVEN_UP = 30.0
# Of the memory of a worker, what all bricks of a film may take so that each worker keeps them all; the borders of
# bricks, with a prefilter, and the bytes of a kernel.
_ALL_OF_IT = 0.25
_BORDERS = 1.8
_KERNEL_BYTES = 112


def frames_side_by_side(client: Any, field: BrickedField | BrickedKernels) -> int:
    """Return how many pictures of a film are best drawn side by side, each by one worker; 0: all draw each picture.

    Workers that can keep all of the data need not wait for each other.

    Raises
    ------
    Unsupported
        For workers with another version of this package.
    Error
        Where there is no worker, or the scheduler is gone.
    """
    cluster = workers_of(client)
    cluster.check()
    with connected(client):
        found = cluster.watch.call(lambda: client.run(memory_limit, on_error="ignore"))
    limits = [one or 0 for one in found.values()]
    return len(limits) if limits and min(limits) * _ALL_OF_IT >= _kept_bytes(field) else 0


def _kept_bytes(field: BrickedField | BrickedKernels) -> float:
    """Return about how much memory all bricks take, with their borders."""
    if isinstance(field, BrickedKernels):
        return _BORDERS * _KERNEL_BYTES * field.kernels
    sample = field.source.dtype.itemsize + (np.dtype(np.float32).itemsize if field.prefilter else 0)
    return _BORDERS * sample * field.survey.size


class Pending:
    """A result that workers are busy with.

    Parameters
    ----------
    client
        Of the cluster.
    what
        Its name, for messages.
    submit
        Submits all tasks to workers that are there, and returns their futures by their keys, the result last.
    convert
        Makes the result of what the last future gives.
    """

    def __init__(
        self, client: Any, what: str, submit: Callable[[Workers], dict[str, Any]], convert: Callable[[Any], Any]
    ) -> None:
        self._client, self._what, self._submit, self._convert = client, what, submit, convert
        self._tasks: list[Any] = []
        # How many tasks there were.
        self._count = 1
        self._lost: list[str] = []
        self._begin()

    def _begin(self) -> None:
        cluster = workers_of(self._client)
        cluster.check()
        self._watch, self._workers = cluster.watch, set(cluster.workers)
        with connected(self._client):
            self._tasks = list(self._submit(cluster).values())
            self._count = len(self._tasks)
        self._stalled = _Stalled(self._client, self._what, self._watch)

    def result(self, progress: Progress | None = None) -> Any:
        """Return the result; where `progress` returns False, or Ctrl-C is pressed, all tasks are cancelled.

        Raises
        ------
        Cancelled
            Where `progress` returned False.
        Error
            What the tasks raise, and where the scheduler or the workers are gone.
        """
        try:
            with asking(progress):
                while True:
                    with connected(self._client):
                        last = self._tasks[-1]
                        # A worker may hang that has the result already.
                        fetched = begun(last.result)
                        if wait(fetched, self._look) and last.status in ("finished", "error"):
                            found = self._convert(fetched.result())
                            break
                    self._again()
            if progress is not None:
                progress(1.0)
            return found
        finally:
            self.cancel()

    def _look(self) -> bool:
        """Look after workers and tasks; return whether all workers that have tasks are there."""
        self._watch.look()
        self._stalled.look(self._let_go())
        note(1.0 - len(self._tasks) / self._count)
        return self._workers <= self._watch.there

    def _again(self) -> None:
        """Begin again with the workers that are left; what they keep is not read again."""
        with connected(self._client):
            # A worker that restarts has a new address. Without one that is gone, its data alone were lost.
            gone = self._workers - self._watch.now()
            self._lost += sorted(gone) or ["unknown"]
        if len(self._lost) > _MOST_LOST:
            raise complain(
                f"{self._what} cannot be drawn",
                f"{len(self._lost)} workers that ended meanwhile, the last at {self._lost[-1]}",
                "workers that live",
                "give workers more memory, or use smaller bricks",
                kind=Error,
            )
        self.cancel()
        self._begin()

    def _let_go(self) -> bool:
        """Forget what is done but the result: workers keep it until all tasks that take it are done.

        Return whether anything was.
        """
        *others, last = self._tasks
        left = []
        for one in others:
            if one.status == "finished":
                one.release()
            else:
                left.append(one)
        self._tasks = [*left, last]
        return len(left) < len(others)

    def cancel(self) -> None:
        """Give up what is not done; workers stop within a slice. What is done is forgotten."""
        # Client.cancel would fail for tasks between these, of which no future is kept.
        for one in self._tasks:
            one.release()
        self._tasks = []
        workers_of(self._client).drop_unfinished()


class _Stalled:
    """Looks after workers that dask has paused, as their memory is short: they would wait for ever."""

    def __init__(self, client: Any, what: str, watch: Watch) -> None:
        self._client, self._what, self._watch = client, what, watch
        self._moved = self._looked = time.monotonic()
        self._relieved = False

    def look(self, moved: bool) -> None:
        """Look now and then, while no task ends, `moved`: whether one has.

        Raises
        ------
        Error
            Where workers are paused that keep nothing more which they could let go.
        """
        now = time.monotonic()
        if moved:
            self._moved, self._relieved = now, False
        if now - max(self._moved, self._looked) < _STALLED:
            return
        self._looked = now
        paused = self._watch.paused
        if paused and not self._relieved:
            self._watch.call(lambda: self._client.run(let_go_of_all, workers=paused, on_error="ignore"))
            self._relieved = True
        elif paused and now - self._moved > _GIVEN_UP:
            raise complain(
                f"{self._what} cannot be drawn",
                f"{len(paused)} workers paused for lack of memory, the first at {paused[0]}",
                "workers with memory left",
                "give them more memory, use smaller bricks, or free other bricks",
                kind=OutOfMemory,
            )


class _Tasks:
    """The tasks of one run, by readable names: a graph that is submitted in one message.

    Parameters
    ----------
    client, cluster
        Of the workers.
    source
        What the tasks read.
    shared
        What else all of them take. It is sent once, and is one object for all tasks of a worker.
    """

    def __init__(self, client: Any, cluster: Workers, source: Any, shared: Any) -> None:
        self._client, self._cluster, self._source = client, cluster, source
        self._run, self._names = uuid.uuid4().hex, itertools.count()
        self._sent = cluster.sent(client, source)
        # By the worker that they are asked of; None: any.
        self._tasks: dict[str | None, dict[str, tuple[Any, ...]]] = {}
        self._keys: list[str] = []
        # As a task, whose result is made again where a worker takes it along.
        self._shared = self._add(None, f"plan-{self._run}", partial(same, shared))

    def _add(self, worker: str | None, key: str, function: Callable[..., Any], *given: Any) -> str:
        self._tasks.setdefault(worker, {})[key] = (function, *given)
        self._keys.append(key)
        return key

    def place(self, name: str, function: Callable[..., Any], number: int, *more: Any) -> str:
        """Add ``function(shared, source, number, *more)``, for the worker that a brick or a piece is asked of.

        Tasks are named by the key that is returned, and take what those have made whose keys they are given.
        """
        worker = self._cluster.place(self._source, number)
        return self._add(worker, f"{name}-{self._run}-{number}", function, self._shared, self._sent, number, *more)

    def anywhere(self, name: str, function: Callable[..., Any], *more: Any) -> str:
        """Add ``function(shared, *more)``, for any worker."""
        return self._add(None, f"{name}-{self._run}-{next(self._names)}", function, self._shared, *more)

    def merged(self, name: str, function: Callable[..., Any], tasks: Sequence[str], left: int = 1) -> list[str]:
        """Add merges of results in their order, a few at a time; return the last ones, so many at most."""
        level = list(tasks)
        while len(level) > left:
            level = [self.anywhere(name, function, *level[at : at + MERGED]) for at in range(0, len(level), MERGED)]
        return level

    def submit(self) -> dict[str, Any]:
        """Submit all tasks; return their futures by their keys, in the order in which they were added."""
        from dask.base import get_annotations
        from dask.highlevelgraph import HighLevelGraph, MaterializedLayer

        span = get_annotations().get("span", self._cluster.span)
        layers = {
            f"{worker}-{self._run}": MaterializedLayer(
                tasks, annotations={"span": span} if worker is None else {"span": span, "workers": [worker]}
            )
            for worker, tasks in self._tasks.items()
        }
        graph = HighLevelGraph(layers, {name: set() for name in layers})
        # All of them are wanted, for progress tells how many are done; what is not needed any more is let go later.
        return dict(zip(self._keys, self._client.get(graph, self._keys, sync=False), strict=True))


def each(
    client: Any, source: Any, shared: Any, count: int, task: tuple[str, Callable[..., Any]],
    merge: tuple[str, Callable[..., Any]],
) -> Any:  # fmt: skip
    """Return what a task says of each brick or piece, merged."""

    def submit(cluster: Workers) -> dict[str, Any]:
        tasks = _Tasks(client, cluster, source, shared)
        tasks.merged(*merge, [tasks.place(*task, number) for number in range(count)])
        return tasks.submit()

    return Pending(client, source.name, submit, lambda one: one).result()


def survey(client: Any, source: BrickSource, partition: Partition, plan: SurveyPlan) -> BrickSurvey:
    """Return what is known of all samples: each brick is read by the worker that will draw it.

    Raises
    ------
    Error
        What reading raises, with worker, brick and file; and where the workers cannot be used.
    """
    task, merge = ("survey-brick", survey_brick), ("merge-surveys", merge_brick_surveys)
    found: BrickSurvey = each(client, source, (partition, plan), len(partition), task, merge)
    return found


def coarsen(client: Any, source: BrickSource, partition: Partition, store: LevelStore, count: int) -> None:
    """Make the levels of all bricks, each where it will be drawn; raises what `survey` does."""
    task, merge = ("coarsen-brick", coarsen_one), ("merge-levels", nothing)
    each(client, source, (partition, store, count), len(partition), task, merge)


def survey_kernels(client: Any, pieces: Pieces, stride: int) -> KernelSurvey:
    """Return what is known of all kernels; raises what `survey` does."""
    task, merge = ("survey-kernels", survey_piece), ("merge-surveys", merge_piece_surveys)
    found: KernelSurvey = each(client, pieces, (stride, pieces.name), len(pieces.counts), task, merge)
    return found


def sort_kernels(
    client: Any, pieces: Pieces, columns: Columns, partition: Partition, rows: int, store: Store
) -> Segments:
    """Sort all pieces into bricks; raises what `survey` does."""
    task, merge = ("sort-kernels", sort_piece), ("merge-segments", merge_segments)
    shared = (columns, partition, rows, store)
    found: Segments = each(client, pieces, shared, len(pieces.counts), task, merge)
    return found


def probe(
    client: Any, source: BrickSource, probing: Probing, jobs: Mapping[int, NDArray[np.float64]]
) -> dict[int, tuple[NDArray[np.float64], NDArray[np.int64]]]:
    """Return what `Probing.sums` says of the points in each of some bricks; raises what `survey` does."""

    def submit(cluster: Workers) -> dict[str, Any]:
        tasks = _Tasks(client, cluster, source, probing)
        asked = [tasks.place("probe-brick", probe_brick, number, places) for number, places in jobs.items()]
        tasks.merged("merge-values", merge_values, asked)
        return tasks.submit()

    found: dict[int, tuple[NDArray[np.float64], NDArray[np.int64]]]
    found = Pending(client, source.name, submit, lambda one: one).result()
    return found


class _Light:
    """The light volumes of a picture: those of the last one, or tasks that make them.

    Attributes
    ----------
    light
        What tasks take.
    made
        The task that makes them; None: there are.
    count
        How many bricks are asked for it.
    """

    def __init__(
        self,
        tasks: _Tasks,
        cluster: Workers,
        view: BrickView,
        field: BrickedField | BrickedKernels,
        dimming: Sequence[int],
    ) -> None:
        self._cluster, self._source = cluster, field.source
        self._key = light_key(view, source_key(field))
        self.light: Any = cluster.kept(self._key)
        self.made: str | None = None
        self.count = 0
        if self.light is None:
            self.count = len(dimming)
            pieces = [tasks.place("light-brick", light_brick, number) for number in dimming]
            merged = tasks.merged("merge-light", merge_light, pieces, MERGED)
            self.light = self.made = tasks.anywhere("make-light", make_light, *merged)

    def keep(self, futures: dict[str, Any]) -> None:
        """Keep what was made for further pictures: it outlives this one, whose futures do not have it any more."""
        if self.made is not None:
            self._cluster.keep(self._key, futures.pop(self.made), self._source)


def begin(client: Any, field: BrickedField | BrickedKernels, view: BrickView) -> Pending:
    """Let the workers of a client begin a picture. Its result is a `Finished` picture, and figures.

    Raises
    ------
    Unsupported
        For workers with another version of this package.
    Error
        Where there is no worker, or the scheduler is gone.
    """
    source: Any = field.source
    view = planned_light(view, field)
    shown = [number for number in view.order() if may_show(field, view, number)]
    dimming = [] if view.light is None else [n for n in range(len(view.partition)) if may_dim(field, view, n)]
    behind = {} if view.any_order else covering(view, shown)
    tree = grouped(view.nested(), shown)
    of_light = 0

    def submit(cluster: Workers) -> dict[str, Any]:
        nonlocal of_light
        tasks = _Tasks(client, cluster, source, view)
        if tree is None:
            tasks.anywhere("merge", _blank)
            return tasks.submit()
        lit = None if view.light is None else _Light(tasks, cluster, view, field, dimming)
        reads = light = None
        if lit is not None:
            light, of_light = lit.light, lit.count
            reads = None if lit.made is None else tasks.anywhere("count-light", counts_of, light)
        drawn: dict[int, str] = {}
        for number in shown:
            before = (drawn[one] for one in behind.get(number, ()))
            drawn[number] = tasks.place("render-brick", render_brick, number, light, *before)

        def merged(group: Grouped) -> str:
            return drawn[group] if isinstance(group, int) else tasks.anywhere("merge", merge_parts, *map(merged, group))

        last = [drawn[tree]] if isinstance(tree, int) else map(merged, tree)
        tasks.anywhere("merge", finish_picture, reads, *last)
        futures = tasks.submit()
        if lit is not None:
            lit.keep(futures)
        return futures

    def convert(found: tuple[Finished, tuple[int, ...]]) -> tuple[Finished, dict[str, float]]:
        finished, (reads, count, done, coarse) = found
        return finished, {
            "bricks": float(len(view.partition)),
            "workers": float(len(workers_of(client).workers)),
            "bricks_drawn": float(done),
            "bricks_coarse": float(coarse),
            "bricks_read": float(reads),
            "bytes_read": float(count),
            "bricks_of_light": float(of_light),
        }

    return Pending(client, source.name, submit, convert)


def begin_measure(
    client: Any, field: BrickedField | BrickedKernels, view: BrickView, opacity: NDArray[np.float32]
) -> Pending:
    """Let the workers measure light in a picture with some opacities; the result is that of `Measure`.

    Raises what `begin` does.
    """
    view = planned_light(view, field)
    shown = [number for number in view.order() if may_show(field, view, number)]
    dimming = [number for number in range(len(view.partition)) if may_dim(field, view, number)]
    probes = Probes.of(view, opacity)

    def submit(cluster: Workers) -> dict[str, Any]:
        # Light is made from the view alone.
        before = _Tasks(client, cluster, field.source, view)
        lit = _Light(before, cluster, view, field, dimming)
        made = before.submit()
        lit.keep(made)
        light = lit.light if lit.made is None else cluster.kept(light_key(view, source_key(field)))
        tasks = _Tasks(client, cluster, field.source, (view, probes))
        spots = [tasks.place("light-spots", light_spots, number, light) for number in shown]
        chosen = tasks.anywhere("choose-spots", choose_spots, *tasks.merged("merge-spots", merge_spots, spots, MERGED))
        lines = [
            tasks.place("light-lines", light_lines, number, light, chosen) for number in sorted({*shown, *dimming})
        ]
        merged = tasks.merged("merge-lines", merge_lines, lines, MERGED)
        tasks.anywhere("measure-light", measure_light, chosen, *merged)
        return made | tasks.submit()

    return Pending(client, field.source.name, submit, lambda one: one)


def _blank(view: BrickView) -> tuple[Finished, tuple[int, ...]]:
    return finish(view, empty(view)), (0, 0, 0, 0)


def covering(view: BrickView, numbers: Sequence[int]) -> dict[int, list[int]]:
    """Return for each brick those in front of it that tell all the opacity there.

    Of the bricks in front that cover a pixel the last one is enough: it was drawn behind the others.

    Parameters
    ----------
    view
        The picture.
    numbers
        The bricks that are drawn, from front to back.
    """
    width, height = view.size
    # The last brick in front of each pixel so far; -1: none.
    last = np.full((height, width), -1, np.int32)
    found: dict[int, list[int]] = {}
    for number in numbers:
        rect = view.footprint(number)
        assert rect is not None
        x0, y0, x1, y1 = rect
        part, inside = last[y0:y1, x0:x1], view.outline(number)
        row = part[inside]
        # Neighbours mostly have the same brick.
        changes = row[np.flatnonzero(np.diff(row, prepend=-2))]
        found[number] = np.unique(changes[changes >= 0]).tolist()
        part[inside] = number
    return found
