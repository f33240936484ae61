"""The tasks of pictures in bricks: this process does them at once, or workers of a client do (`bricks.cluster`)."""

from __future__ import annotations

import ctypes
import gc
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._waiting import asking
from sheetsplat.bricks.resident import forget_renderers, residents
from sheetsplat.errors import Cancelled, Error, OutOfMemory, complain

# What the last picture of this process made for those after it, by what it depends on.
_last: dict[bytes, Any] = {}


class Tasks:
    """Tasks that this process does at once, in the order in which they are asked for.

    What `place` and `anywhere` return stands for a result, and can be given to further tasks.

    Parameters
    ----------
    source
        What the tasks read.
    shared
        What else all of them take.
    """

    def __init__(self, source: Any, shared: Any) -> None:
        self._source, self._shared = source, shared

    def place(self, name: str, function: Callable[..., Any], number: int, *more: Any) -> Any:
        """Do ``function(shared, source, number, *more)``, where a brick or a piece is asked of."""
        return function(self._shared, self._source, number, *more)

    def anywhere(self, name: str, function: Callable[..., Any], *more: Any) -> Any:
        """Do ``function(shared, *more)``."""
        return function(self._shared, *more)

    def merged(self, name: str, function: Callable[..., Any], tasks: Sequence[Any], left: int = 1) -> Sequence[Any]:
        """Merge results in their order, where they are not all here a few at a time; so many may be left."""
        return [function(self._shared, *tasks)] if left == 1 else tasks

    def kept(self, key: bytes, make: Callable[[], Any]) -> tuple[Any, bool]:
        """Return what the last picture made with the same key, or else make and keep it; and whether it is new."""
        is_new = key not in _last
        if is_new:
            made = make()
            _last.clear()
            _last[key] = made
        return _last[key], is_new


@dataclass(frozen=True, eq=False)
class Made:
    """The result of a worker's task, and what was done for it: `Counts.of_picture`."""

    value: Any
    counts: NDArray[np.int64]


def on_brick(what: str, doing: str, function: Callable[..., Any], *given: Any) -> Made:
    """Let this worker do `Tasks.place`; `what` and `doing` are for messages."""
    before = residents().counts.of_picture()
    with naming(what, doing), asking(is_wanted):
        value = function(*map(_value, given))
    return Made(value, residents().counts.of_picture() - before)


def on_results(name: str, function: Callable[..., Any], *given: Any) -> Made:
    """Let this worker do `Tasks.anywhere`: what was done for all that is given counts."""
    with naming(f"{name} of a picture in bricks"), asking(is_wanted):
        value = function(*map(_value, given))
    return Made(value, sum((one.counts for one in given if isinstance(one, Made)), np.zeros(4, np.int64)))


def _value(given: Any) -> Any:
    return given.value if isinstance(given, Made) else given


@contextmanager
def naming(what: str, doing: str = "drawn") -> Iterator[None]:
    """Name the worker, and what it does, in errors."""
    from distributed import get_worker  # type: ignore[import-not-found, import-untyped, unused-ignore]

    try:
        yield
    except Cancelled:
        raise
    except Error as error:
        found = f"{error.what}: {error.found}" if error.found else error.what
        what = f"{what} cannot be {doing} by worker {get_worker().address}"
        raise complain(what, found, error.wanted, error.advice, kind=type(error)) from None
    except MemoryError:
        what = f"{what} cannot be {doing} by worker {get_worker().address}"
        raise complain(what, "too little memory", "memory for it", "use smaller bricks", kind=OutOfMemory) from None


def let_go_of_all() -> None:
    """Let this process forget all bricks, and what was made of them, and give their memory back."""
    residents().clear()
    forget_renderers()
    gc.collect()
    # The allocator keeps what was freed; not every C library has this.
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def is_wanted(_: float) -> bool:
    """Return whether the task that runs in this thread was not cancelled meanwhile."""
    from distributed import get_worker
    from distributed.worker import thread_state  # type: ignore[attr-defined, import-not-found, unused-ignore]

    task = get_worker().state.tasks.get(thread_state.key)
    return task is not None and task.state != "cancelled"


def nothing(*_: Any) -> None:
    """Wait for all that is given."""


def same(value: Any) -> Any:
    """Return a value."""
    return value
