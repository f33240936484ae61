"""Which arrays of a file, or of data of another library, can be shown, and can give colours."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from sheetsplat._objects import kind_of_object
from sheetsplat.errors import Error
from sheetsplat.io.names import Names
from sheetsplat.io.objects import arrays_of_object
from sheetsplat.io.opening import arrays

_MOST = 200


def has_arrays(data: object) -> bool:
    """Return whether data may have arrays by name: a file, or what another library holds."""
    return isinstance(data, str | os.PathLike) or kind_of_object(data) is not None


def arrays_of(data: object, options: Mapping[str, Any]) -> Names:
    """Return the names of the arrays of data; none where they have one, or none by name.

    Parameters
    ----------
    data
        The path of a file, or an object of another library.
    options
        Those of `sheetsplat.open` that were given.
    """
    kind = None if isinstance(data, str | os.PathLike) else kind_of_object(data)
    try:
        if isinstance(data, str | os.PathLike):
            found = arrays(data, options)
        else:
            found = Names() if kind is None else arrays_of_object(data, kind)
    except (Error, OSError):
        # Whoever opens it is told why.
        return Names()
    return Names(found.names[:_MOST], found.shown) if len(found.names) > 1 else Names()
