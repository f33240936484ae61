"""Processes of this machine that draw frames side by side."""

from __future__ import annotations

import contextlib
import os
import pickle
import queue
import subprocess
import threading
from concurrent.futures import Future
from typing import Any

from sheetsplat._processes import require_files, start_module
from sheetsplat.animation.drawing import Portion, Task
from sheetsplat.animation.sources import Source
from sheetsplat.errors import Error, complain

_Job = tuple[Source, tuple[Task, ...], "Future[Portion]"]


class Workers:
    """A number of processes, each with a thread here that hands it some frames after the other."""

    def __init__(self, count: int) -> None:
        self._jobs: queue.SimpleQueue[_Job | None] = queue.SimpleQueue()
        self._processes: list[subprocess.Popen[bytes]] = []
        self._closed = False
        # Their pipes, and those with which each of them begins.
        require_files(2 * count + 8, "processes that draw frames")
        for _ in range(count):
            self._processes.append(start_module("sheetsplat.animation.worker"))
        self._threads = [
            threading.Thread(target=self._serve, args=(process,), daemon=True) for process in self._processes
        ]
        for thread in self._threads:
            thread.start()

    def submit(self, source: Source, tasks: tuple[Task, ...]) -> Future[Portion]:
        """Return the future frames."""
        future: Future[Portion] = Future()
        self._jobs.put((source, tasks, future))
        return future

    def _serve(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdin is not None and process.stdout is not None
        known: Source | None = None
        while (job := self._jobs.get()) is not None:
            source, tasks, future = job
            if self._closed or not future.set_running_or_notify_cancel():
                continue
            try:
                sent = None if source is known else source
                pickle.dump((sent, tasks), process.stdin, 5)
                process.stdin.flush()
                answer: Any = pickle.load(process.stdout)
                known = source
            except (OSError, EOFError, pickle.UnpicklingError):
                code = process.wait()
                found = f"a process that ended with the code {code}"
                answer = complain("frames were not drawn", found, "frames", "use fewer workers", kind=Error)
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
        for process in self._processes:
            process.terminate()
        for process in self._processes:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(timeout=5)
            for stream in (process.stdin, process.stdout):
                if stream is not None:
                    with contextlib.suppress(OSError):
                        stream.close()


def cores() -> int:
    """Return the number of cores that this process may run on."""
    return len(os.sched_getaffinity(0))
