"""Attacks on the viewer, on bricks, on films and on arguments: what tests do a little of, by the thousand.

    cd tests && python -m attacks messages --seed 0 --count 100000

Each attack is a function of a seed and a count that returns a `Tally`: what was done, and what it found. An attack with
the same seed does the same. Tests run small counts of each (tests/python/attacks/test_attack_*.py).
"""

from __future__ import annotations

import signal
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

#: Failures that are kept in full: more of them are the same one.
MOST_KEPT = 50
# Elapsed over processor time beyond which a call waits for what never comes, also where other processes run.
_WAITING = 10.0


@dataclass
class Tally:
    """What an attack did, by kind, and what it found that must not be."""

    done: Counter[str] = field(default_factory=Counter)
    failures: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def did(self, kind: str, count: int = 1) -> None:
        """Count something that was done."""
        self.done[kind] += count

    def failed(self, text: str) -> None:
        """Keep a failure, in one text from which it can be repeated."""
        self.done["failures"] += 1
        if len(self.failures) < MOST_KEPT:
            self.failures.append(text)

    def note(self, text: str) -> None:
        """Keep what was measured."""
        self.notes.append(text)

    def __str__(self) -> str:
        """Return counts, a line each, what was measured, and then all failures."""
        lines = [f"{count:9,} {kind}" for kind, count in sorted(self.done.items())]
        return "\n".join([*lines, *self.notes, *(f"FAILED {one}" for one in self.failures)])


class _Late(BaseException):
    """What was asked for takes too long."""


def _late(*_: object) -> None:
    raise _Late


@contextmanager
def soon(tally: Tally, said: str, seconds: float) -> Iterator[None]:
    """Note a failure where a block takes more processor time of this process than `seconds`, or waits for ever."""
    limits = ((signal.SIGPROF, signal.ITIMER_PROF, seconds), (signal.SIGALRM, signal.ITIMER_REAL, _WAITING * seconds))
    before = [signal.signal(number, _late) for number, _, _ in limits]
    for _, timer, limit in limits:
        signal.setitimer(timer, limit)
    try:
        yield
    except _Late:
        tally.failed(f"{said}: longer than {seconds} s")
    finally:
        for (number, timer, _), handler in zip(limits, before, strict=True):
            signal.setitimer(timer, 0)
            signal.signal(number, handler)
