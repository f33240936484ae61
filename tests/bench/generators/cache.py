"""Cache of computed data sets: .npy files in the user's cache folder.

A file is in the .npy format, followed by a BLAKE2b digest of its bytes, which NumPy's reader ignores. A file that is
truncated, changed or of the wrong shape or type is discarded and computed again.
"""

from __future__ import annotations

import hashlib
import io
import logging
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.errors import Error

_log = logging.getLogger("sheetsplat")


def cache_folder() -> Path:
    """Return the folder of computed data sets: ``$XDG_CACHE_HOME/sheetsplat``, else the platform's cache folder.

    On Linux the latter is ``~/.cache/sheetsplat``. A relative ``XDG_CACHE_HOME`` is ignored, as the XDG specification
    requires.
    """
    import platformdirs

    return platformdirs.user_cache_path("sheetsplat", appauthor=False)


def _digest(body: bytes | memoryview, size: int = 32) -> bytes:
    return hashlib.blake2b(body, digest_size=size).digest()


def _read(path: Path, shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any] | None:
    expected = math.prod(shape) * dtype.itemsize
    try:
        # The size is checked before the file is read.
        if not expected < path.stat().st_size < expected + 4096:
            raise ValueError("its size is wrong")
        content = path.read_bytes()
        body, digest = content[:-32], content[-32:]
        if _digest(body) != digest:
            raise ValueError("its digest is wrong")
        values: NDArray[Any] = np.load(io.BytesIO(body), allow_pickle=False)
        if values.shape != shape or values.dtype != dtype:
            raise ValueError("its shape or type is wrong")
        return values
    except FileNotFoundError:
        return None
    except Exception as error:  # NumPy's reader raises errors of many classes for damaged headers
        _log.warning("the cached data set %s cannot be used (%s); it is computed again", path, error)
        return None


def _write(path: Path, values: NDArray[Any]) -> None:
    from sheetsplat.io.pictures import whole_file

    buffer = io.BytesIO()
    np.save(buffer, values, allow_pickle=False)
    body = buffer.getbuffer()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as made, made.open("wb") as file:
            file.write(body)
            file.write(_digest(body))
    except (OSError, Error) as error:
        _log.warning("the data set cannot be cached in %s (%s); it will be computed again next time", path, error)


def cached(
    name: str,
    version: int,
    parameters: Mapping[str, Any],
    shape: tuple[int, ...],
    dtype: np.dtype[Any],
    compute: Callable[[], NDArray[Any]],
    *,
    use: bool = True,
) -> NDArray[Any]:
    """Return the result of `compute`, from the cache where it has an undamaged file.

    Parameters
    ----------
    name, version, parameters
        What the result depends on; a change of the computation increases `version`.
    shape, dtype
        Of the result.
    compute
        Computes it.
    use
        False: compute it, without reading or writing a file.
    """
    if not use:
        return compute()
    key = repr((name, version, sorted(parameters.items())))
    path = cache_folder() / f"{name}-{_digest(key.encode(), 10).hex()}.npy"
    kept = _read(path, shape, dtype)
    if kept is not None:
        return kept
    _log.info("computing the data set %s; it is kept in %s", name, path)
    values = compute()
    _write(path, values)
    return values
