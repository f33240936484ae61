"""How many frames of a film one task draws: enough that handing it over costs little, few enough for all to be busy."""

from __future__ import annotations

from collections.abc import Sequence

from sheetsplat.animation.drawing import Drawn

# Seconds that a task should take, and bytes that it may return.
_SECONDS = 2.0
_BYTES = 64 << 20
# Tasks for each process that the frames that are left should make, so that all processes end together.
_TASKS_LEFT = 2


class PortionSize:
    """The number of frames of the next task, from what the last frames took.

    >>> size = PortionSize(processes=2)
    >>> size.of(100)
    1
    >>> size.learn([Drawn(b"", seconds=0.25)])
    >>> size.of(100), size.of(20), size.of(1)
    (8, 5, 1)

    Parameters
    ----------
    processes
        How many draw side by side.
    """

    def __init__(self, processes: int) -> None:
        self._processes = processes
        # Until a frame is drawn a task has one.
        self._most = 1

    def of(self, left: int) -> int:
        """Return how many frames the next task draws where so many are left."""
        return max(1, min(self._most, left // (_TASKS_LEFT * self._processes)))

    def learn(self, drawn: Sequence[Drawn]) -> None:
        """Look at what the frames of a task took. The first of a process read the data, so that only the last count."""
        if not drawn:
            return
        seconds = sum(one.seconds for one in drawn) / len(drawn)
        size = max(len(one.content) for one in drawn)
        self._most = max(1, int(min(_SECONDS / max(seconds, 1e-9), _BYTES / max(size, 1), 1 << 20)))
