"""What a child process does: it judges cases one after another, and tells of each when it begins and ends."""

from __future__ import annotations

import faulthandler
import os
import resource
import signal
import sys
import time
import traceback
import warnings
from multiprocessing.connection import Connection
from pathlib import Path

import sheetsplat as ss
from fuzz.cases import Case
from fuzz.limits import Waited, time_limit
from fuzz.part import Outcome, Part

#: Processor time after which a child that nobody watches any more is ended, as a multiple of what a case may take.
_ABANDONED = 2.0
_PACKAGE = str(Path(ss.__file__).parent)


def _place(error: BaseException) -> str:
    """Return file and function of the package in which an error arose, else of the last one of all."""
    frames = traceback.extract_tb(error.__traceback__)
    if isinstance(error, Waited):
        frames.pop()  # who raised it
    own = [frame for frame in frames if frame.filename.startswith(_PACKAGE)] or frames
    return f"{Path(own[-1].filename).name}, {own[-1].name}" if own else ""


def judged(part: Part, case: Case, folder: Path) -> Outcome:
    """Return the outcome of a case; whatever is raised is a failure."""
    try:
        with warnings.catch_warnings(), time_limit(part.seconds):
            return part.run(case, folder)
    except Waited as error:
        return Outcome("wrong", f"waited in {_place(error)}", traceback.format_exc())
    except (Exception, RecursionError) as error:
        return Outcome("wrong", f"{type(error).__name__} in {_place(error)}", traceback.format_exc())


def work(part: Part, kind: str, folder: Path, line: Connection) -> None:
    """Judge the cases that come over a line, by their numbers or whole, until None comes.

    For each its outcome and the seconds of processor time that it took are sent back.
    """
    # What libraries print, and what Python says of a crash or on SIGUSR2, is read where the process ends badly.
    errors = os.open(folder / "stderr", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    os.dup2(errors, 1)
    os.dup2(errors, 2)
    sys.stdout = sys.stderr = open(2, "w", buffering=1, closefd=False)  # noqa: SIM115
    faulthandler.enable(2)
    faulthandler.register(signal.SIGUSR2, 2)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    place = folder / "case"
    place.mkdir()
    while (given := line.recv()) is not None:
        # A child that nobody watches any more is ended by the system.
        most = int(time.process_time() + _ABANDONED * (part.seconds + 60))
        resource.setrlimit(resource.RLIMIT_CPU, (most, resource.RLIM_INFINITY))
        began = time.process_time()
        case = given if isinstance(given, dict) else part.case(kind, given)
        outcome = judged(part, case, place)
        line.send((outcome, time.process_time() - began))
