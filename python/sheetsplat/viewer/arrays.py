"""Which arrays of a file can be shown."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from sheetsplat.errors import Error
from sheetsplat.io.opening import kind_of, read_scattered
from sheetsplat.notices import muted

# Files are read once more for the names of their arrays: those that are soon read.
_LARGEST = 100_000_000
_MOST = 200
# What `read_scattered` takes beside the scalar.
_READING = ("grid", "particles", "support", "step", "nan")


def arrays_of(path: str | os.PathLike[str], options: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of the scalars that a file of scattered data has, that which is shown by itself first.

    None where it has one, where the options name one, and for files that are large or hold something else.

    Parameters
    ----------
    path
        The file.
    options
        Those of `sheetsplat.open` that were given.
    """
    if any(name in options for name in ("scalar", "name")):
        return ()
    try:
        if os.path.getsize(path) > _LARGEST or not kind_of(path, options).scattered:
            return ()
        with muted():
            found = read_scattered(path, **{name: options[name] for name in _READING if name in options})
    except (Error, OSError):
        # Whoever opens it is told why.
        return ()
    names = (found.scalar, *(one for one in found.scalars if one != found.scalar))[:_MOST]
    return names if len(names) > 1 else ()
