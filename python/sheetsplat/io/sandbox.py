"""Readers of other libraries in a child process with limits: for those that trust the sizes in a file.

A child costs 0.12 to 0.2 s (0.3 s with VTK, Zarr, nibabel or pydicom), and another 0.1 s for 64 MB of arrays, 0.5 s for
512 MB. The readers of this package take 0.01 s and 0.1 s for as many raw samples: they stay in this process, behind
checks of their own.
"""

from __future__ import annotations

import contextlib
import json
import math
import mmap
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory, _processes
from sheetsplat.io.checks import unreadable
from sheetsplat.io.source import Source

_SCRIPT = Path(__file__).with_name("_apart.py")
# Of a child: address space of its modules, and memory for a byte of the file; seconds of a processor, and bytes that
# it reads in one.
_LEAST, _PER_BYTE = 1 << 30, 64
_SECONDS, _PER_SECOND = 10, 200_000
# Seconds for one of a processor.
_WAITED = 10

#: What an array is, such as ("cell_data", "load"), and the array.
Array = tuple[tuple[str, ...], NDArray[Any]]


def read_apart(source: Source, reader: str) -> list[Array]:
    """Return the arrays of numbers, which cannot be written to, that a reader of `_apart` makes of a file.

    What are no numbers are empty arrays.

    The child may take memory and time in proportion to the file, no more memory than there is. It is ended with this
    call, whatever ends that.

    Raises
    ------
    InvalidInput
        Where it takes longer or breaks down.
    ModuleNotFoundError, MemoryError, ValueError
        Where the reader fails: `source.guarded` makes errors of files of them.
    """
    size = source.at_most()
    memory = _LEAST + min(_memory.available(), _PER_BYTE * size)
    seconds = _SECONDS + size // _PER_SECOND
    with os.fdopen(os.memfd_create("arrays"), "rb", buffering=0) as arrays:
        file = arrays.fileno()
        numbers = map(str, (memory, seconds, file))
        command = [sys.executable, "-P", str(_SCRIPT), reader, str(source.path), *numbers]
        streams = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        text = b""
        with (
            _processes.started(command, pass_fds=(file,), **streams) as child,
            contextlib.suppress(subprocess.TimeoutExpired),
        ):
            text, _ = child.communicate(timeout=_WAITED * seconds)
        if not text:
            found = f"contents that its reader gave up within {seconds} s and {memory / 1e6:,.0f} MB"
            raise unreadable(source.path, found, "a whole file", "fetch it again")
        answer = json.loads(text)
        if "missing" in answer:
            raise ModuleNotFoundError(answer["text"], name=answer["missing"])
        if "arrays" not in answer:
            raise MemoryError if "memory" in answer else ValueError(answer["failed"])
        length = os.fstat(file).st_size
        stored = mmap.mmap(file, length, access=mmap.ACCESS_READ) if length else b""
    result: list[Array] = []
    at = 0
    for key, kind, shape in answer["arrays"]:
        array = np.frombuffer(stored, np.dtype(kind), math.prod(shape), at)
        result.append((tuple(key), array.reshape(shape)))
        at += array.nbytes
    return result
