"""Rows of scattered data: those with numbers that are not finite are refused, or left out and counted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import choice, shown
from sheetsplat.errors import Words, complain, option_ref
from sheetsplat.notices import warn

# Rows of a table that are looked at between two answers to Ctrl-C.
_PIECE = 1 << 18


def pieces(count: int) -> Iterator[slice]:
    """Yield the rows of a table in pieces, between which Ctrl-C is answered."""
    for first in range(0, count, _PIECE):
        yield slice(first, min(first + _PIECE, count))


def _wrong(rows: NDArray[Any]) -> NDArray[np.bool_] | None:
    """Return which rows are not finite; None where all are."""
    found: NDArray[np.bool_] | None = None
    for piece in pieces(len(rows)):
        part = np.isfinite(rows[piece])
        if not part.all():
            found = np.zeros(len(rows), bool) if found is None else found
            found[piece] = ~part.reshape(len(part), -1).all(axis=1)
    return found


def usable_rows(
    what: str,
    columns: Mapping[str, NDArray[Any] | None],
    nan: str,
    *,
    row: str = "row",
    hints: Mapping[str, tuple[str, str]] = MappingProxyType({}),
) -> NDArray[np.bool_] | None:
    """Return which rows have finite numbers in all columns, (N,); None where all have.

    Parameters
    ----------
    what
        The data, for messages.
    columns
        Arrays of N rows by what messages call them; None: a column that there is not.
    nan
        What a row with a number that is not finite is: "error", or "skip", which leaves it out, with one warning.
    row
        What messages call a row.
    hints
        By columns: why their numbers may be missing, and what helps besides leaving rows out.

    Raises
    ------
    InvalidInput
        For the first such row, with its column, unless they are left out; for another `nan`.
    """
    skips = choice(f"{what}: nan", nan, ("error", "skip")) == "skip"
    there = {name: one for name, one in columns.items() if one is not None}
    wrong = {name: found for name, one in there.items() if (found := _wrong(one)) is not None}
    if not wrong:
        return None
    bad: NDArray[np.bool_] = np.logical_or.reduce(list(wrong.values()))
    count = f"{int(bad.sum())} of {len(bad)} {row}s"
    if skips:
        told = ", ".join(f"{name} in {int(one.sum())}" for name, one in wrong.items())
        warn(f"{count} of {what} are left out, because numbers are not finite: {told}")
        return ~bad
    name, found = next(iter(wrong.items()))
    first, (why, advice) = int(np.argmax(found)), hints.get(name, ("", ""))
    value = shown(np.asarray(there[name][first], np.float64).tolist()).replace("nan", "NaN")
    raise complain(
        f"{what} cannot be used",
        f"{value}, the {name} of {row} {first}; numbers of {count} are not finite" + (f" ({why})" if why else ""),
        "finite numbers",
        Words.of(advice)
        + (", or " if advice else "")
        + "pass "
        + option_ref("nan", "skip")
        + f" to leave such {row}s out",
        option="nan",
    )
