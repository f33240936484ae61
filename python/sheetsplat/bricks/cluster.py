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

from sheetsplat._waiting import asking, begun, counted, note, wait
from sheetsplat.bricks.draw import render_brick
from sheetsplat.bricks.light import light_of, planned_light
from sheetsplat.bricks.light_error import measured_light
from sheetsplat.bricks.needs import dimming_bricks, shown_bricks, source_key
from sheetsplat.bricks.partial import Finished, Partial, empty, finish, merge
from sheetsplat.bricks.partition import MERGED, Grouped, Partition, grouped
from sheetsplat.bricks.sources import box_text
from sheetsplat.bricks.tasks import Made, Tasks, let_go_of_all, nothing, on_brick, on_results, same
from sheetsplat.bricks.view import BrickView, figures
from sheetsplat.bricks.watch import Watch, connected
from sheetsplat.bricks.workers import Workers, memory_limit, workers_of
from sheetsplat.errors import Error, OutOfMemory, complain
from sheetsplat.fields import Bricked, BrickedKernels
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


def frames_side_by_side(client: Any, field: Bricked) -> int:
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


def _kept_bytes(field: Bricked) -> float:
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


class _Tasks(Tasks):
    """The tasks of one run, by readable names: a graph that is submitted in one message.

    Parameters
    ----------
    client, cluster
        Of the workers.
    source
        What the tasks read.
    shared
        What else all of them take. It is sent once, and is one object for all tasks of a worker.
    partition
        The bricks, for messages; None: pieces.
    doing
        What is done with them, for messages.
    """

    def __init__(
        self, client: Any, cluster: Workers, source: Any, shared: Any, partition: Partition | None, doing: str = "drawn"
    ) -> None:
        self._client, self._cluster = client, cluster
        self._run, self._names = uuid.uuid4().hex, itertools.count()
        self._place, self._partition, self._doing = partial(cluster.place, source), partition, doing
        # By the worker that they are asked of; None: any.
        self._tasks: dict[str | None, dict[str, tuple[Any, ...]]] = {}
        self._keys: list[str] = []
        # Results that outlive this run, by what they depend on.
        self._to_keep: dict[bytes, str] = {}
        self._of = source
        # As a task, whose result is made again where a worker takes it along.
        super().__init__(cluster.sent(client, source), self._add(None, f"plan-{self._run}", partial(same, shared)))

    def _add(self, worker: str | None, key: str, function: Callable[..., Any], *given: Any) -> str:
        self._tasks.setdefault(worker, {})[key] = (function, *given)
        self._keys.append(key)
        return key

    def place(self, name: str, function: Callable[..., Any], number: int, *more: Any) -> str:
        """Add a task for the worker that a brick or a piece is asked of; return its key."""
        what = f"piece {number} of {self._of.name}"
        if self._partition is not None:
            core = self._partition.bricks[number].samples
            what = f"brick {number} {'' if core is None else box_text(core) + ' '}of {self._of.name}"
        do = partial(on_brick, what, self._doing, function)
        return self._add(
            self._place(number), f"{name}-{self._run}-{number}", do, self._shared, self._source, number, *more
        )

    def anywhere(self, name: str, function: Callable[..., Any], *more: Any) -> str:
        """Add a task for any worker; return its key."""
        do = partial(on_results, name, function)
        return self._add(None, f"{name}-{self._run}-{next(self._names)}", do, self._shared, *more)

    def merged(self, name: str, function: Callable[..., Any], tasks: Sequence[Any], left: int = 1) -> list[Any]:
        """Add merges of results in their order, a few at a time; return the last ones, so many at most."""
        level = list(tasks)
        while len(level) > left:
            level = [self.anywhere(name, function, *level[at : at + MERGED]) for at in range(0, len(level), MERGED)]
        return level

    def kept(self, key: bytes, make: Callable[[], Any]) -> tuple[Any, bool]:
        """Return what an earlier picture made, or the key of what makes it: it outlives this one."""
        found = self._cluster.kept(key, self._of)
        if found is not None:
            return found, False
        self._to_keep[key] = make()
        return self._to_keep[key], True

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
        futures = dict(zip(self._keys, self._client.get(graph, self._keys, sync=False), strict=True))
        for key, task in self._to_keep.items():
            self._cluster.keep(key, futures.pop(task), self._of)
        return futures


def each(
    client: Any, source: Any, shared: Any, numbers: Mapping[int, tuple[Any, ...]] | int,
    task: tuple[str, Callable[..., Any]], merge: tuple[str, Callable[..., Any]],
    partition: Partition | None = None, doing: str = "read",
) -> Any:  # fmt: skip
    """Return what a task says of each brick or piece, merged in their order.

    Parameters
    ----------
    client
        Its workers do it, each brick where it will be drawn; None: this process.
    source, shared
        As for `Tasks`.
    numbers
        What the task takes for each brick or piece; or how many there are.
    task, merge
        Names and functions, as for `Tasks.place` and `Tasks.merged`.
    partition, doing
        The bricks, None: pieces; and what is done, for messages.

    Raises
    ------
    Cancelled
        Where the callback that is asked returned False.
    Error
        What reading raises, with worker, brick and file; and where the workers cannot be used.
    """
    jobs = dict.fromkeys(range(numbers), ()) if isinstance(numbers, int) else numbers
    if client is None:
        here = Tasks(source, shared)
        every = zip(counted(len(jobs)), jobs.items(), strict=True)
        return here.merged(*merge, [here.place(*task, number, *more) for _, (number, more) in every])[0]

    def submit(cluster: Workers) -> dict[str, Any]:
        tasks = _Tasks(client, cluster, source, shared, partition, doing)
        tasks.merged(*merge, [tasks.place(*task, number, *more) for number, more in jobs.items()])
        return tasks.submit()

    return Pending(client, source.name, submit, lambda one: one.value).result()


def begin(client: Any, field: Bricked, view: BrickView) -> Pending:
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
    shown, dimming = shown_bricks(field, view), dimming_bricks(field, view)
    behind = {} if view.any_order else covering(view, shown)
    tree = grouped(view.nested(), shown)
    of_light = 0

    def submit(cluster: Workers) -> dict[str, Any]:
        nonlocal of_light
        tasks = _Tasks(client, cluster, source, view, view.partition)
        if tree is None:
            tasks.anywhere("merge", _finished, None)
            return tasks.submit()
        light, of_light = light_of(tasks, view, source_key(field), dimming)
        # Not light itself, which would be sent.
        reads = tasks.anywhere("count-light", nothing, light) if of_light else None
        drawn: dict[int, str] = {}
        for number in shown:
            before = (drawn[one] for one in behind.get(number, ()))
            drawn[number] = tasks.place("render-brick", render_brick, number, light, *before)

        def merged(group: Grouped) -> str:
            return drawn[group] if isinstance(group, int) else tasks.anywhere("merge", merge, *map(merged, group))

        last = [drawn[tree]] if isinstance(tree, int) else map(merged, tree)
        tasks.anywhere("merge", _finished, reads, *last)
        return tasks.submit()

    def convert(found: Made) -> tuple[Finished, dict[str, float]]:
        workers = {"workers": float(len(workers_of(client).workers))}
        return found.value, workers | figures(view, found.counts, of_light)

    return Pending(client, source.name, submit, convert)


def begin_measure(client: Any, field: Bricked, view: BrickView, opacity: NDArray[np.float32]) -> Pending:
    """Let the workers measure light in a picture with some opacities; the result is that of `Measure`.

    Raises what `begin` does.
    """
    view = planned_light(view, field)

    def submit(cluster: Workers) -> dict[str, Any]:
        tasks = _Tasks(client, cluster, field.source, view, view.partition)
        measured_light(tasks, view, field, opacity)
        return tasks.submit()

    return Pending(client, field.source.name, submit, lambda one: one.value)


def _finished(view: BrickView, _: None, *parts: Partial) -> Finished:
    return finish(view, merge(view, *parts) if parts else empty(view))


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
