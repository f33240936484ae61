"""What the child processes of `sandbox` run: a reader of another library, whose arrays are handed over as bytes.

Run by its path and not as a module, so that nothing of the package is imported: half of the time to start.
"""

import io
import json
import os
import resource
import sys
from collections.abc import Iterator
from typing import Any

# How often the end of a file may be met.
_ENDS = 100

Arrays = Iterator[tuple[list[Any], Any]]


class _Lines(io.BufferedReader):
    """A file that ends: meshio's reader of Gmsh reads as many lines as numbers in the file say, also beyond its end."""

    _beyond = 0

    def readline(self, size: int | None = -1, /) -> bytes:
        """Return the next line; EOFError where it has been asked for beyond the end again and again."""
        line = super().readline(size)
        self._beyond = 0 if line else self._beyond + 1
        if self._beyond > _ENDS:
            raise EOFError("lines beyond its end")
        return line


def _gmsh(path: str) -> Arrays:
    from meshio.gmsh import main as gmsh  # type: ignore[import-not-found, import-untyped, unused-ignore]

    with _Lines(io.FileIO(path)) as lines:
        mesh = gmsh.read_buffer(lines)
    yield ["points"], mesh.points
    for block in mesh.cells:
        yield ["cells", block.type], block.data
    for name, values in mesh.point_data.items():
        yield ["point_data", str(name)], values
    for name, blocks in mesh.cell_data.items():
        for values in blocks:
            yield ["cell_data", str(name)], values


_READERS = {"gmsh": _gmsh}


def _answer(reader: str, path: str, file: int) -> dict[str, Any]:
    """Write all arrays one after another and return what they are, or what went wrong."""
    told = []
    try:
        import numpy as np

        with os.fdopen(file, "wb") as out:
            for key, values in _READERS[reader](path):
                array: Any = np.ascontiguousarray(values)
                # What holds no numbers counts as nothing.
                array = array if array.dtype.kind in "biuf" else np.empty(0)
                told.append([key, array.dtype.str, array.shape])
                out.write(memoryview(array).cast("B") if array.size else b"")
    except MemoryError:
        return {"memory": True}
    except ModuleNotFoundError as error:
        return {"missing": error.name, "text": str(error)}
    except Exception as error:
        return {"failed": str(error)[:1000] or type(error).__name__}
    return {"arrays": told}


def main(reader: str, path: str, memory: int, seconds: int, file: int) -> None:
    """Read within limits; the answer is the only thing on stdout."""
    for limit, most in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_CPU, seconds), (resource.RLIMIT_CORE, 0)):
        _, hard = resource.getrlimit(limit)
        most = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(limit, (most, most))
    # A thread of it takes address space.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    out = os.dup(1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    with os.fdopen(out, "w", encoding="ascii") as stream:
        json.dump(_answer(reader, path, file), stream)


if __name__ == "__main__":
    main(*sys.argv[1:3], *map(int, sys.argv[3:]))  # type: ignore[arg-type]
