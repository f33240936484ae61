"""A process that draws frames: it reads tasks from stdin and writes frames to stdout, as pickles, until stdin ends.

In between it writes None, as a sign of life.

Started by `sheetsplat.animation.workers`. Processes of `multiprocessing` would run the caller's script again, or share
the threads and the OpenGL context of a fork.
"""

from __future__ import annotations

import os
import pickle
import sys
import threading
import time
from typing import IO, Any

from sheetsplat.animation.drawing import Portion, Task, draw_elsewhere
from sheetsplat.animation.sources import Source

# Seconds between two signs of life.
_SIGN = 0.5


class _Results:
    """What the process that started this one reads, written by two threads."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream, self._lock = stream, threading.Lock()
        threading.Thread(target=self._live, daemon=True).start()

    def write(self, content: bytes) -> bool:
        """Write a pickle; return whether anybody reads it."""
        try:
            with self._lock:
                self._stream.write(content)
                self._stream.flush()
        except BrokenPipeError:
            return False
        return True

    def _live(self) -> None:
        while self.write(pickle.dumps(None)):
            time.sleep(_SIGN)


def main() -> None:
    """Draw frames until there are no more tasks."""
    results = _Results(os.fdopen(os.dup(1), "wb"))
    # What libraries print must not be taken for frames.
    os.dup2(2, 1)
    tasks = sys.stdin.buffer
    source: Any = None
    while True:
        try:
            task: tuple[Source | None, tuple[Task, ...]] = pickle.load(tasks)
        except EOFError:
            return
        answer: Portion | BaseException
        try:
            source = task[0] or source
            answer = draw_elsewhere(source, task[1])
        except Exception as error:
            answer = error
        try:
            content = pickle.dumps(answer, 5)
        except Exception:
            content = pickle.dumps(RuntimeError(f"{type(answer).__name__}: {answer}"))
        if not results.write(content):
            return


if __name__ == "__main__":
    main()
