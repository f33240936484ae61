"""A discrete-event simulation of pictures in bricks on a cluster."""

from __future__ import annotations

import heapq
import itertools
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Costs:
    """What drawing takes, seconds of one core.

    Attributes
    ----------
    brick, kernel, sample
        Of a brick, of each of its kernels, and of each pixel and slice in it.
    merge
        Of each pixel of a part that is merged with others.
    submit, scheduler
        Of the client and the scheduler for each task: before any of a picture begins, and when it is done.
    pause
        Between two tasks of a worker, in which it needs no core.
    overhead, beside
        Of a worker for each task: between two of them, and while it draws.
    client
        Of the client, before the tasks are submitted.
    result
        Of the client, for the picture to reach it.
    """

    brick: float
    kernel: float
    sample: float
    merge: float
    submit: float = 5e-4
    scheduler: float = 5e-4
    pause: float = 0.0
    overhead: float = 0.0
    beside: float = 0.0
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
        Cores that the workers, the client and the scheduler share; infinite: nobody waits for one.
    bandwidth, latency
        Bytes a second of a worker's network, and seconds of a message.
    """

    workers: int
    speed: float = 1.0
    cores: float = math.inf
    bandwidth: float = 1.25e9
    latency: float = 2e-4


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


class _Cores:
    """What is at work: all share the cores alike, each has one at most."""

    def __init__(self, count: float) -> None:
        self._count = count
        # Seconds of a core that each has had who was there from the beginning.
        self._had = 0.0
        self._jobs: list[tuple[float, int, str, int]] = []
        self._order = itertools.count()

    def begin(self, seconds: float, kind: str, number: int) -> None:
        """Begin what takes some seconds of a core."""
        heapq.heappush(self._jobs, (self._had + seconds, next(self._order), kind, number))

    @property
    def _pace(self) -> float:
        return min(1.0, self._count / len(self._jobs))

    def left(self) -> float:
        """Return seconds until the next one is done, if none begins."""
        return (self._jobs[0][0] - self._had) / self._pace if self._jobs else math.inf

    def work(self, seconds: float) -> None:
        """Let time pass, no more than is left."""
        if self._jobs:
            self._had += seconds * self._pace

    def end(self) -> tuple[str, int]:
        """Return the one that is done."""
        self._had, _, kind, number = heapq.heappop(self._jobs)
        return kind, number


class _Picture:
    """A picture while it is drawn."""

    def __init__(self, tasks: Sequence[Task], machine: Machine, costs: Costs) -> None:
        self._tasks, self._machine, self._costs = tasks, machine, costs
        self._cores = _Cores(machine.cores)
        self._waiting = [len(task.before) for task in tasks]
        self._after: list[list[int]] = [[] for _ in tasks]
        for number, task in enumerate(tasks):
            for one in task.before:
                self._after[one].append(number)
        self._where = [-1] * len(tasks)
        self._ready: list[list[int]] = [[] for _ in range(machine.workers)]
        self._busy = [False] * machine.workers
        self._network = [0.0] * machine.workers
        self._told: deque[int] = deque()
        self._serving = False
        # What takes time, but no core: time, order, kind, task.
        self._events: list[tuple[float, int, str, int]] = []
        self._order = itertools.count()
        self.now = self.moved = 0.0

    def draw(self) -> None:
        """Let all happen in its order."""
        costs = self._costs
        self._cores.begin(costs.client + costs.submit * len(self._tasks), "known", -1)
        while True:
            left = self._cores.left()
            later = self._events[0][0] - self.now if self._events else math.inf
            if left == later == math.inf:
                return
            step = max(0.0, min(left, later))
            self.now += step
            self._cores.work(step)
            if later <= left:
                _, _, kind, number = heapq.heappop(self._events)
            else:
                kind, number = self._cores.end()
            getattr(self, f"_{kind}")(number)

    def _at(self, time: float, kind: str, number: int) -> None:
        heapq.heappush(self._events, (time, next(self._order), kind, number))

    def _known(self, _: int) -> None:
        """The scheduler has all tasks."""
        for number, waiting in enumerate(self._waiting):
            if not waiting:
                self._send(number)

    def _send(self, number: int) -> None:
        """Let a worker have a task: what it takes comes through its network, one after the other."""
        task, machine = self._tasks[number], self._machine
        held: dict[int, float] = {}
        for one in task.before:
            held[self._where[one]] = held.get(self._where[one], 0.0) + self._tasks[one].bytes
        if task.place is not None:
            worker = task.place % machine.workers
        else:
            worker = max(held, key=lambda one: held[one], default=number % machine.workers)
        far = sum(size for one, size in held.items() if one != worker)
        self._where[number] = worker
        arrived = self.now + machine.latency
        if far:
            self._network[worker] = max(self._network[worker], arrived) + far / machine.bandwidth
            arrived = self._network[worker] + machine.latency
            self.moved += far
        self._at(arrived, "there", number)

    def _there(self, number: int) -> None:
        worker = self._where[number]
        heapq.heappush(self._ready[worker], number)
        self._next(worker)

    def _next(self, worker: int) -> None:
        if self._ready[worker] and not self._busy[worker]:
            self._busy[worker] = True
            number = heapq.heappop(self._ready[worker])
            self._at(self.now + self._costs.pause, "begun", number)

    def _begun(self, number: int) -> None:
        took = self._costs.overhead + self._tasks[number].seconds / self._machine.speed
        self._cores.begin(took, "done", number)

    def _done(self, number: int) -> None:
        worker = self._where[number]
        self._busy[worker] = False
        self._next(worker)
        if self._costs.beside:
            self._cores.begin(self._costs.beside, "nothing", number)
        self._at(self.now + self._machine.latency, "heard", number)

    def _nothing(self, number: int) -> None:
        """Let what a worker did beside drawing end."""

    def _heard(self, number: int) -> None:
        """The scheduler has a message that a task is done."""
        self._told.append(number)
        self._serve()

    def _serve(self) -> None:
        if self._told and not self._serving:
            self._serving = True
            self._cores.begin(self._costs.scheduler, "served", self._told.popleft())

    def _served(self, number: int) -> None:
        self._serving = False
        for one in self._after[number]:
            self._waiting[one] -= 1
            if not self._waiting[one]:
                self._send(one)
        self._serve()


def simulated(tasks: Sequence[Task], machine: Machine, costs: Costs) -> Run:
    """Return what a picture takes, event by event.

    The client plans, and the scheduler takes all tasks in one message; then it serves one message after the other, that
    a task is done. A worker draws one brick at a time, those of lower numbers first; what a task takes from elsewhere
    comes through the worker's network before, one after the other. All that is at work shares the cores.
    """
    picture = _Picture(tasks, machine, costs)
    picture.draw()
    longest = [0.0] * len(tasks)
    for number, task in enumerate(tasks):
        longest[number] = task.seconds / machine.speed + max((longest[one] for one in task.before), default=0.0)
    work = sum(task.seconds for task in tasks) / (min(machine.workers, machine.cores) * machine.speed)
    served = (costs.submit + costs.scheduler) * len(tasks)
    return Run(picture.now + costs.result, picture.moved, work, max(longest), served)


__all__ = ["Costs", "Machine", "Run", "Task", "simulated"]
