"""Which scalar of a file is shown: one of its arrays, one column of an array, or the length of its rows."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._rows import pieces
from sheetsplat.errors import Error, complain, option_ref
from sheetsplat.io.checks import Where, listed, unreadable
from sheetsplat.io.names import tell_names
from sheetsplat.io.records import Floats

_PART = re.compile(r"(.+)_([xyz]|\d{1,3})")
# Most columns of an array that get names; the number in a header is not trusted.
_MOST_COLUMNS = 1000


def unknown_scalar(path: Where, wanted: str, known: Sequence[str]) -> Error:
    """Return the InvalidInput for a scalar that a file does not have."""
    return complain(
        f"the scalar {wanted!r} cannot be taken from {path}",
        f"these: {listed(known)}",
        "one of them",
        "pass " + option_ref("scalar", "..."),
        option="scalar",
    )


def choose_scalar(
    path: Where, wanted: str | None, preferred: Sequence[str], widths: Mapping[str, int]
) -> tuple[str, str, int | None]:
    """Return the name of a scalar, the array that it is made of, and the column; None: the length of its rows.

    Parameters
    ----------
    path
        For messages.
    wanted
        The scalar that the user asks for: an array, in any case where one alone is meant, or one column of one, NAME_x,
        NAME_y, NAME_z or NAME_0, NAME_1 …
    preferred
        Arrays to take in this order where `wanted` is None; after them the first with one column, then the first.
    widths
        Columns of every array.
    """
    if not widths:
        raise unreadable(path, "no array of numbers that belongs to the points", "one, to be shown")
    single = [name for name, width in widths.items() if width == 1]
    first = next(name for name in (*preferred, *single, *widths) if name in widths)
    known = tell_names(scalar_names(widths), first)
    wanted = first if wanted is None else wanted
    same = [name for name in widths if name.lower() == wanted.lower()]
    if wanted not in widths and len(same) == 1:
        wanted = same[0]
    if wanted in widths:
        return wanted, wanted, 0 if widths[wanted] == 1 else None
    match = _PART.fullmatch(wanted)
    if match is not None and widths.get(match[1], 1) > 1:
        column = "xyz".index(match[2]) if match[2] in "xyz" else int(match[2])
        if column < widths[match[1]]:
            return wanted, match[1], column
    raise unknown_scalar(path, wanted, known)


def scalar_names(widths: Mapping[str, int]) -> tuple[str, ...]:
    """Return every name that `choose_scalar` accepts; that of an array with columns means the length of its rows."""
    found: list[str] = []
    for name, width in widths.items():
        columns = "xyz"[:width] if width <= 3 else range(min(width, _MOST_COLUMNS))
        found += [name, *(f"{name}_{column}" for column in columns if width > 1)]
    return tuple(found)


def column_of(rows: NDArray[Any], column: int | None) -> Floats:
    """Return one column of rows as float64, or their lengths where the column is None."""
    made = np.empty(len(rows))
    for piece in pieces(len(rows)):
        part = rows[piece]
        if column is None:
            made[piece] = np.sqrt(np.square(part, dtype=np.float64).sum(axis=1))
        else:
            made[piece] = part if part.ndim == 1 else part[:, column]
    return made
