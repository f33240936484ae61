"""Cache of computed data sets: .npy files in the user's cache folder.

A file is in the .npy format, followed by a BLAKE2b digest of its bytes, which NumPy's reader ignores. A file that is
truncated, changed or of the wrong shape or type is discarded and computed again.
"""

from __future__ import annotations

import hashlib
import io
import logging
import os
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_log = logging.getLogger("sheetsplat")
_DIGEST = 32


def cache_folder() -> Path:
    """Return the folder of computed data sets: ``$XDG_CACHE_HOME/sheetsplat``, else the platform's cache folder.

    On Linux the latter is ``~/.cache/sheetsplat``. A relative ``XDG_CACHE_HOME`` is ignored, as the XDG specification
    requires.
    """
    import platformdirs

    return platformdirs.user_cache_path("sheetsplat", appauthor=False)


def cache_path(name: str, version: int, parameters: Mapping[str, Any]) -> Path:
    """Return the file of one result: its name, and a digest of version and parameters."""
    key = repr((name, version, sorted(parameters.items())))
    return cache_folder() / f"{name}-{hashlib.blake2b(key.encode(), digest_size=10).hexdigest()}.npy"


def _read(path: Path, shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any] | None:
    expected = int(np.prod(shape, dtype=np.int64)) * dtype.itemsize
    try:
        # The size is checked before the file is read.
        if not expected < path.stat().st_size < expected + 4096:
            _log.warning("the cached data set %s has the wrong size; it is computed again", path)
            return None
        content = path.read_bytes()
        body, digest = content[:-_DIGEST], content[-_DIGEST:]
        if hashlib.blake2b(body, digest_size=_DIGEST).digest() != digest:
            _log.warning("the cached data set %s is damaged; it is computed again", path)
            return None
        values: NDArray[Any] = np.load(io.BytesIO(body), allow_pickle=False)
    except FileNotFoundError:
        return None
    except Exception as error:  # NumPy's reader raises errors of many classes for damaged headers
        _log.warning("the cached data set %s cannot be read (%s); it is computed again", path, error)
        return None
    if values.shape != shape or values.dtype != dtype:
        _log.warning("the cached data set %s has another shape or type; it is computed again", path)
        return None
    return values


def _write(path: Path, values: NDArray[Any]) -> None:
    buffer = io.BytesIO()
    np.save(buffer, values, allow_pickle=False)
    body = buffer.getbuffer()
    temporary: str | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".part")
        with os.fdopen(handle, "wb") as file:
            file.write(body)
            file.write(hashlib.blake2b(body, digest_size=_DIGEST).digest())
        # A rename within a folder is atomic: readers see the old file, none, or the whole new one.
        os.replace(temporary, path)
        temporary = None
    except OSError as error:
        _log.warning("the data set could not be kept in %s (%s); it will be computed again next time", path, error)
    finally:
        if temporary is not None:
            try:
                os.unlink(temporary)
            except OSError:
                pass


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
    """Return the result of `compute`, from the cache where it is there and whole.

    Parameters
    ----------
    name, version, parameters
        What the result depends on; `version` is raised whenever the computation changes.
    shape, dtype
        What the result must be.
    compute
        Makes it.
    use
        False computes it and touches no file.
    """
    if not use:
        return compute()
    path = cache_path(name, version, parameters)
    kept = _read(path, shape, dtype)
    if kept is not None:
        return kept
    _log.info("computing the data set %s; it is kept in %s", name, path)
    values = compute()
    _write(path, values)
    return values
