"""Child processes and how they end: a batch of cases each, under limits of time and memory."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import re
import shutil
import signal
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from multiprocessing import forkserver
from multiprocessing.context import ForkServerContext
from multiprocessing.process import BaseProcess
from pathlib import Path

from fuzz.cases import Case
from fuzz.child import work
from fuzz.limits import Clock, family, processor_seconds, resident
from fuzz.part import Outcome, Part

_TESTS = str(Path(__file__).resolve().parents[1])
#: Seconds between two looks at a child.
_LOOK = 0.25
#: The child itself ends a case that takes longer than it may. Where it cannot, in compiled code, it is killed later.
_LENIENT, _MORE = 1.5, 2.0
#: Characters of what a child printed that are kept with a crash.
_LAST_WORDS = 6000
#: File and function of the package in what Python's fault handler prints.
_PLACE = re.compile(r'File "[^"]*/sheetsplat/([^"]+)", line \d+ in (\w+)')


@cache
def _ready() -> ForkServerContext:
    """Return what starts children: a process that has imported all that they need, from which they are forked."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["fuzz.imports"])
    # That process finds its modules by the environment alone.
    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (_TESTS, before)))
    try:
        forkserver.ensure_running()
    finally:
        if before is None:
            del os.environ["PYTHONPATH"]
        else:
            os.environ["PYTHONPATH"] = before
    return context


class Stopped(Exception):
    """The command was told to end; what was under way does not count."""


@dataclass(frozen=True)
class Result:
    """What became of one case: its outcome, and the seconds of processor time that it took."""

    seed: int
    outcome: Outcome
    seconds: float


class Judge:
    """A child process that judges cases one after another; where one ends it, another child goes on.

    Parameters
    ----------
    part, kind
        Of the cases.
    stop
        When it is set, whatever is under way ends with `Stopped`.
    """

    def __init__(self, part: Part, kind: str, stop: threading.Event) -> None:
        self.part, self.kind, self.stop = part, kind, stop
        self._child: BaseProcess | None = None

    def __enter__(self) -> Judge:
        """Return the judge."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the child."""
        self._kill()

    def __call__(self, given: int | Case) -> Outcome:
        """Return the outcome of a numbered case, or of any."""
        return self.timed(given)[0]

    def timed(self, given: int | Case) -> tuple[Outcome, float]:
        """Return the outcome of a case, and the seconds of processor time that it took."""
        if self._child is None:
            self._start()
        pid = self._child.pid if self._child is not None and self._child.pid else 0
        began, clock = processor_seconds(pid), Clock(self.part.patience)
        with contextlib.suppress(BrokenPipeError):
            self._line.send(given)
        wrong = ""
        while not wrong:
            if self.stop.is_set():
                raise Stopped
            try:
                if self._line.poll(_LOOK):
                    found: tuple[Outcome, float] = self._line.recv()
                    return found
            except (EOFError, ConnectionResetError):
                return self._died(), 0.0
            if resident(pid) > self.part.memory:
                wrong = "memory"
            elif processor_seconds(pid) - began > _LENIENT * self.part.seconds + _MORE or clock.is_over():
                wrong = "hang"
        seconds = processor_seconds(pid) - began
        # A child that hangs says where.
        with contextlib.suppress(OSError):
            os.kill(pid, signal.SIGUSR2)
            time.sleep(0.5)
        return self._wrong(wrong), seconds

    def end(self) -> Outcome | None:
        """Let the child end by itself; return what is wrong with how it does."""
        if self._child is None:
            return None
        with contextlib.suppress(BrokenPipeError):
            self._line.send(None)
        clock = Clock(self.part.patience)
        while self._child.is_alive() and not clock.is_over():
            if self.stop.is_set():
                raise Stopped
            self._child.join(_LOOK)
        if self._child.is_alive():
            return self._wrong("hang at the end")
        return None if self._child.exitcode == 0 else self._died()

    def _start(self) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="sheetsplat-fuzz-"))
        context = _ready()
        self._line, theirs = context.Pipe()
        self._child = context.Process(target=work, args=(self.part, self.kind, self._folder, theirs))
        self._child.start()
        theirs.close()

    def _died(self) -> Outcome:
        assert self._child is not None
        self._child.join()
        return self._wrong(_ending(self._child.exitcode))

    def _wrong(self, what: str) -> Outcome:
        """Return a failure with what the child printed, which is ended."""
        text = ""
        with contextlib.suppress(OSError):
            text = (self._folder / "stderr").read_text(errors="replace")[-_LAST_WORDS:]
        if places := _PLACE.findall(text):
            what += f" in {places[0][0]}, {places[0][1]}"
        self._kill()
        return Outcome("wrong", what, text)

    def _kill(self) -> None:
        """End the child and all that it has started."""
        if self._child is None:
            return
        if self._child.pid is not None and self._child.is_alive():
            for pid in family(self._child.pid):
                with contextlib.suppress(OSError):
                    os.kill(pid, signal.SIGKILL)
            self._child.join()
        self._child = None
        self._line.close()
        shutil.rmtree(self._folder, ignore_errors=True)


def batch(part: Part, kind: str, seeds: Sequence[int], stop: threading.Event) -> list[Result]:
    """Return what became of numbered cases, all in one process while none ends it."""
    with Judge(part, kind, stop) as judge:
        found = [Result(seed, *judge.timed(seed)) for seed in seeds]
        # A child that ends badly after its last case does so because of one of them.
        if (ending := judge.end()) is not None:
            found[-1] = replace(found[-1], outcome=ending)
    return found


def _ending(code: int | None) -> str:
    """Return how a process ended, in words."""
    if code is not None and code < 0:
        return f"crash, {signal.Signals(-code).name}"
    return f"exit code {code}"
