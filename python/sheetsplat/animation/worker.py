"""A process that draws frames: it reads tasks from stdin and writes frames to stdout, as pickles, until stdin ends.

Started by `sheetsplat.animation.workers`. Processes of `multiprocessing` would run the caller's script again, or share
the threads and the OpenGL context of a fork.
"""

from __future__ import annotations

import os
import pickle
import sys
from typing import Any

from sheetsplat.animation.drawing import Portion, Task, draw_elsewhere
from sheetsplat.animation.sources import Source


def main() -> None:
    """Draw frames until there are no more tasks."""
    results = os.fdopen(os.dup(1), "wb")
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
        try:
            results.write(content)
            results.flush()
        except BrokenPipeError:
            return


if __name__ == "__main__":
    main()
