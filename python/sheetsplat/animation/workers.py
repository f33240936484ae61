"""Processes of this machine that draw frames side by side."""

from __future__ import annotations

import contextlib
import os
import pickle
import queue
import threading
import time
from concurrent.futures import Future
from typing import Any

from sheetsplat._processes import require_files, start_module
from sheetsplat.animation.drawing import Portion, Task
from sheetsplat.animation.sources import Source
from sheetsplat.errors import Error, Words, complain, option_ref

# What counts at most of the seconds between two looks.
_MOST = 1.0
_Job = tuple[Source, tuple[Task, ...], "Future[Portion]"]


class _Process:
    """A process, and how long it has given no sign of life since it has a task."""

    def __init__(self) -> None:
        self.process = start_module("sheetsplat.animation.worker")
        self.is_busy = False
        self.silence = 0.0

    def draw(self, source: Source | None, tasks: tuple[Task, ...]) -> Any:
        """Return the answer to tasks; `source`: None for the one before. EOFError, OSError where it ended."""
        assert self.process.stdin is not None and self.process.stdout is not None
        self.silence, self.is_busy = 0.0, True
        try:
            pickle.dump((source, tasks), self.process.stdin, 5)
            self.process.stdin.flush()
            while (answer := pickle.load(self.process.stdout)) is None:
                self.silence = 0.0
        finally:
            self.is_busy = False
        return answer


class Workers:
    """A number of processes, each with a thread here that hands it some frames after the other.

    `timeout`: seconds without a sign of life after which a process is given up.
    """

    def __init__(self, count: int, timeout: float) -> None:
        self._jobs: queue.SimpleQueue[_Job | None] = queue.SimpleQueue()
        self._closed = False
        self._timeout, self._looked = timeout, time.monotonic()
        # Their pipes, and those with which each of them begins.
        require_files(2 * count + 8, "processes that draw frames")
        self._processes = [_Process() for _ in range(count)]
        self._threads = [threading.Thread(target=self._serve, args=(one,), daemon=True) for one in self._processes]
        for thread in self._threads:
            thread.start()

    def submit(self, source: Source, tasks: tuple[Task, ...]) -> Future[Portion]:
        """Return the future frames."""
        future: Future[Portion] = Future()
        self._jobs.put((source, tasks, future))
        return future

    def look(self) -> None:
        """End processes that hang, whose frames are an error then; called now and then while frames are waited for."""
        now = time.monotonic()
        # While this process is stopped it hears of nobody.
        passed, self._looked = min(now - self._looked, _MOST), now
        for one in self._processes:
            if one.is_busy:
                one.silence += passed
                if one.silence >= self._timeout:
                    one.process.kill()

    def _serve(self, one: _Process) -> None:
        known: Source | None = None
        while (job := self._jobs.get()) is not None:
            source, tasks, future = job
            if self._closed or not future.set_running_or_notify_cancel():
                continue
            try:
                answer = one.draw(None if source is known else source, tasks)
                known = source
            except (OSError, EOFError, pickle.UnpicklingError):
                code = one.process.wait()
                found, advice = f"a process that ended with the code {code}", Words.of("use fewer workers")
                if one.silence >= self._timeout:
                    found = f"no sign of life from process {one.process.pid} for {self._timeout:g} s"
                    advice = "allow more time by " + option_ref("worker_timeout")
                answer = complain("frames were not drawn", found, "frames", advice, kind=Error)
            except BaseException as error:
                answer = error
            if isinstance(answer, Portion):
                future.set_result(answer)
            else:
                future.set_exception(answer)

    def close(self) -> None:
        """End all processes; frames that are not drawn yet are given up."""
        self._closed = True
        for _ in self._threads:
            self._jobs.put(None)
        for one in self._processes:
            # They have nothing to tidy, and one that is stopped obeys nothing else.
            one.process.kill()
        for one in self._processes:
            one.process.wait()
            for stream in (one.process.stdin, one.process.stdout):
                if stream is not None:
                    with contextlib.suppress(OSError):
                        stream.close()


def cores() -> int:
    """Return the number of cores that this process may run on."""
    return len(os.sched_getaffinity(0))
