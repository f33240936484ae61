"""Waits for other threads and processes: each of them asks meanwhile whether its result is still wanted.

What is asked is the callback `progress` of the caller, wherever its thread waits, with the share that it was told last.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any, TypeVar

from sheetsplat.errors import Cancelled, complain, option_ref
from sheetsplat.options.renderer import Progress

Result = TypeVar("Result")
#: Of a picture that is drawn twice, as slice planes end or cross in it, the share of the first time.
FIRST_OF_TWO = 0.7
# Seconds between two questions.
_LOOK = 0.05


@dataclass
class _Asked:
    progress: Progress
    what: str
    share: float = 0.0


_asked: ContextVar[_Asked | None] = ContextVar("asked", default=None)


@contextmanager
def asking(progress: Progress | None, what: str = "the picture") -> Iterator[None]:
    """Let waits of this thread ask a callback; None: whom they ask already. `what` is what it gives up."""
    if progress is None:
        yield
        return
    token = _asked.set(_Asked(progress, what))
    try:
        yield
    finally:
        _asked.reset(token)


def note(share: float) -> None:
    """Set the finished share that the callback is told next."""
    found = _asked.get()
    if found is not None:
        found.share = share


def ask() -> None:
    """Ask the callback; Cancelled where it returns False."""
    found = _asked.get()
    if found is not None and found.progress(found.share) is False:
        raise complain(f"{found.what} was given up", option_ref("progress") + " returned False", kind=Cancelled)


def asked() -> Progress | None:
    """Return the callback, for what calls it by itself; None: there is none."""
    found = _asked.get()
    return None if found is None else found.progress


def portion(progress: Progress | None, start: float, end: float) -> Progress | None:
    """Return the callback of a part of what is done, which begins and ends at some shares; None for none."""
    return None if progress is None else lambda share: progress(start + (end - start) * share)


@contextmanager
def part(start: float, end: float) -> Iterator[None]:
    """Let shares that are told meanwhile be those of a part of the whole."""
    found = _asked.get()
    if found is None:
        yield
        return
    with asking(portion(found.progress, start, end), found.what):
        yield
    note(end)


def counted(count: int) -> Iterator[int]:
    """Yield the numbers below `count`, and ask before each."""
    for number in range(count):
        note(number / count)
        ask()
        yield number


def wait(future: Any, look: Callable[[], object] | None = None) -> bool:
    """Wait for a future, and return whether it is done: not where `look`, called now and then, returns False.

    Raises
    ------
    Cancelled
        Where the callback returned False.
    """
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    while not (done.wait(_LOOK) or future.done()):
        if look is not None and look() is False:
            return bool(future.done())
        ask()
    return True


def begun(function: Callable[[], Result]) -> Future[Result]:
    """Return the future result of a function that may wait for ever: a thread of its own, which no exit waits for."""
    future: Future[Result] = Future()

    def run() -> None:
        try:
            future.set_result(function())
        except BaseException as error:
            future.set_exception(error)

    threading.Thread(target=run, daemon=True).start()
    return future


def call(function: Callable[[], Result]) -> Result:
    """Return what a function returns that waits for others; raises what it raises, and what `wait` does."""
    future = begun(function)
    wait(future)
    return future.result()
