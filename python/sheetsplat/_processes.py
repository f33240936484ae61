"""Processes that the package starts: all of them are started by what is here.

They take no code from the current folder, where a file beside the data may have the name of a module of Python, and
Ctrl-C, which a terminal sends to all of its processes, is for the one that started them.
"""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.resource_tracker import ensure_running
from typing import Any, TypeVar

from sheetsplat.errors import Error, complain

Result = TypeVar("Result")

_SAFE_PATH = "PYTHONSAFEPATH"


def require_files(count: int, what: str) -> None:
    """Let this process, and those that it starts, have so many more files open.

    Raises
    ------
    Error
        Where the system does not allow them; `what` needs them.
    """
    count += len(os.listdir("/proc/self/fd"))
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or count <= soft:
        return
    if hard != resource.RLIM_INFINITY and count > hard:
        found, wanted = f"a limit of {hard} open files (ulimit -n)", f"at least {count}"
        raise complain(f"{what} cannot be started", found, wanted, "use fewer workers, or a higher limit", kind=Error)
    resource.setrlimit(resource.RLIMIT_NOFILE, (count, hard))


def start(command: Sequence[str], **streams: Any) -> subprocess.Popen[bytes]:
    """Start a program; `streams`: what `subprocess.Popen` takes. OSError where it cannot be started."""
    return subprocess.Popen(command, env={**os.environ, _SAFE_PATH: "1"}, start_new_session=True, **streams)


@contextlib.contextmanager
def started(command: Sequence[str], **streams: Any) -> Iterator[subprocess.Popen[bytes]]:
    """Start a program as `start` does, which ends with this context, whatever ends that.

    A Ctrl-C that comes while it starts, when nobody could end it yet, is heard after that.
    """
    heard: list[int] = []
    is_main = threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGINT, lambda number, _: heard.append(number)) if is_main else None

    def listen() -> None:
        if is_main:
            signal.signal(signal.SIGINT, signal.SIG_DFL if before is None else before)

    try:
        child = start(command, **streams)
    except BaseException:
        listen()
        raise
    try:
        listen()
        if heard:
            signal.raise_signal(signal.SIGINT)
        yield child
    finally:
        child.kill()
        child.wait()


def start_module(name: str) -> subprocess.Popen[bytes]:
    """Start a module of the package as a program, with pipes as stdin and stdout; OSError where that fails."""
    return start([sys.executable, "-P", "-m", name], stdin=subprocess.PIPE, stdout=subprocess.PIPE)


@contextlib.contextmanager
def safe_path() -> Iterator[None]:
    """Let processes that multiprocessing starts meanwhile, here or in a library, take no code from where they are."""
    before = os.environ.get(_SAFE_PATH)
    os.environ[_SAFE_PATH] = "1"
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(_SAFE_PATH, None)
        else:
            os.environ[_SAFE_PATH] = before


def deaf(function: Callable[[], Result]) -> Result:
    """Call a function, in a thread of its own, whose processes and threads do not hear Ctrl-C."""
    # It would let them hear it again when it starts.
    ensure_running()
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    return function()


def ignore_interrupts() -> None:
    """Ignore Ctrl-C, where this is the main thread of a process that another one ends."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
