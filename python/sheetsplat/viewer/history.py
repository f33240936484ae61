"""The states that a viewer has shown, for undo and redo."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import replace

from sheetsplat.camera import Camera
from sheetsplat.viewer.state import State

# Changes of the same things so many seconds apart are one: a drag, a wheel, a slider.
_TOGETHER = 0.6
_MOST = 500


class History:
    """What was shown before the present state, and what was undone since.

    Not for several threads at once.
    """

    def __init__(self) -> None:
        self._past: list[State] = []
        self._future: list[State] = []
        self._names: frozenset[str] = frozenset()
        self._noted = 0.0

    def note(self, before: State, names: Iterable[str]) -> None:
        """Take a state that things of some names are changed of."""
        changed, now = frozenset(names), time.monotonic()
        goes_on = changed == self._names and now - self._noted < _TOGETHER
        self._names, self._noted = changed, now
        self._future.clear()
        if not goes_on:
            self._past = [*self._past[1 - _MOST :], before]

    def move(self, present: State, *, back: bool) -> State | None:
        """Return the state before the present one, or the one that was undone last; None where there is none."""
        source, target = (self._past, self._future) if back else (self._future, self._past)
        self._names = frozenset()
        while source:
            found = source.pop()
            # What was changed to and fro in one drag.
            if found != present:
                target.append(present)
                return found
        return None

    def drop(self, good: State) -> None:
        """Forget the last change, which could not be shown, of a state that could."""
        self._names = frozenset()
        if self._past and self._past[-1] == good:
            self._past.pop()

    def reframe(self, before: Camera, after: Camera) -> None:
        """Put another camera in place of one in all states."""
        for states in (self._past, self._future):
            states[:] = [replace(one, camera=after) if one.camera is before else one for one in states]

    @property
    def steps(self) -> dict[str, bool]:
        """Whether there is something to undo and to redo."""
        return {"undo": bool(self._past), "redo": bool(self._future)}
