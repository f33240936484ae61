"""Limits of what a case may take: processor time, which does not pass while the process is stopped, and memory."""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import threading
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path

#: Seconds between two looks at the clock, and those beyond which the process is taken to have been stopped meanwhile.
_LOOK, _GAP = 0.25, 2.0


class Waited(BaseException):
    """A case took too long. As an Exception it would become an error of a file."""


@contextlib.contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Raise `Waited` where the body takes more processor time than that."""

    def wait_no_longer(*_: object) -> None:
        raise Waited(f"more than {seconds:g} s of processor time")

    before = signal.signal(signal.SIGPROF, wait_no_longer)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


@contextlib.contextmanager
def memory_limit(size: int) -> Iterator[None]:
    """Let the body take no more than that many bytes beside those that are taken."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


class _Running:
    """Seconds that this process runs, counted by a thread: those in which it is stopped are left out."""

    def __init__(self) -> None:
        self.seconds = 0.0
        threading.Thread(target=self._count, daemon=True, name="seconds").start()

    def _count(self) -> None:
        last = time.monotonic()
        while True:
            time.sleep(_LOOK)
            now = time.monotonic()
            self.seconds += min(now - last, _GAP)
            last = now


@cache
def _running() -> _Running:
    return _Running()


class Clock:
    """A budget of seconds in which this process runs."""

    def __init__(self, budget: float) -> None:
        self.budget = budget
        self._began = _running().seconds

    def is_over(self) -> bool:
        """Return whether the budget is used up."""
        return _running().seconds - self._began >= self.budget


def processor_seconds(pid: int) -> float:
    """Return the processor time that a process has taken; 0 where it is gone."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident(pid: int | str = "self") -> int:
    """Return the bytes of a process that are in memory; 0 where it is gone."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * resource.getpagesize()
    except (OSError, IndexError):
        return 0


def family(pid: int) -> list[int]:
    """Return a process and all that it and its children have started, the youngest last."""
    parents: dict[int, list[int]] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            parents.setdefault(int(path.read_text().rpartition(")")[2].split()[1]), []).append(int(path.parent.name))
    found = [pid]
    for one in found:
        found += parents.get(one, [])
    return found
