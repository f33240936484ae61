"""Which arrays of a file can be shown, and can give colours."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from sheetsplat.errors import Error
from sheetsplat.io.names import Names
from sheetsplat.io.opening import arrays

_MOST = 200


def arrays_of(data: object, options: Mapping[str, Any]) -> Names:
    """Return the names of the arrays of a file; none where it has one, and for data that are no file.

    Parameters
    ----------
    data
        The path of the file.
    options
        Those of `sheetsplat.open` that were given.
    """
    if not isinstance(data, str | os.PathLike):
        return Names()
    try:
        found = arrays(data, options)
    except (Error, OSError):
        # Whoever opens it is told why.
        return Names()
    return Names(found.names[:_MOST], found.shown) if len(found.names) > 1 else Names()
