"""A computation in a process of its own, so that an interrupt ends it at once.

Within one call of a library no interrupt is answered, and Qhull may take minutes.
"""

from __future__ import annotations

import importlib
import io
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._processes import ignore_interrupts, start
from sheetsplat.errors import OutOfMemory, complain

Arrays = Mapping[str, NDArray[Any]]


def _packed(arrays: Arrays) -> bytes:
    content = io.BytesIO()
    np.savez(content, **arrays)  # type: ignore[arg-type]
    return content.getvalue()


def _unpacked(content: bytes) -> dict[str, NDArray[Any]]:
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        return dict(arrays)


def _started(module: str, name: str) -> subprocess.Popen[bytes] | None:
    """Return a process that waits for the arrays of a function, or None where none can be started."""
    program = f"from {__name__} import main; main()"
    command = [sys.executable, "-P", "-c", program, module, name, str(os.getpid())]
    try:
        return start(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    except OSError:
        return None


def computed_apart(what: str, function: Callable[[Arrays], Arrays], arrays: Arrays) -> Arrays:
    """Return the arrays that a function of a module makes of arrays, computed in a process of its own.

    Where the function raises there, or no process can be started, it is called here, so that its errors are its own.
    OutOfMemory where the system ended the process; `what` begins the message.
    """
    process = _started(function.__module__, function.__name__) if sys.executable else None
    if process is None:
        return function(arrays)
    try:
        content, _ = process.communicate(_packed(arrays))
    finally:
        # Also where KeyboardInterrupt ends the wait.
        process.kill()
        process.communicate()
    if process.returncode == 0:
        return _unpacked(content)
    if process.returncode < 0:
        raise complain(
            f"{what}: the process that computes it was ended",
            f"signal {-process.returncode}",
            "a result",
            "use fewer points if there was too little memory",
            kind=OutOfMemory,
        )
    return function(arrays)


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


def main() -> None:
    """Read arrays from stdin, and write those that a function makes of them to stdout: the process's own program."""
    module, name, parent = sys.argv[1:]
    ignore_interrupts()
    threading.Thread(target=_end_with, args=(int(parent),), daemon=True).start()
    results = os.fdopen(os.dup(1), "wb")
    # What libraries print must not be taken for arrays.
    os.dup2(2, 1)
    given = _unpacked(sys.stdin.buffer.read())
    results.write(_packed(getattr(importlib.import_module(module), name)(given)))
    results.close()
