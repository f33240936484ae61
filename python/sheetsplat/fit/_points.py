"""Arguments of the fits: points with values, checked."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat import _memory
from sheetsplat._checks import as_array, number, shown, whole
from sheetsplat._rows import usable_rows
from sheetsplat.errors import Words, complain, option_ref, unusable

from ._kernels import Floats, Numbers

_log = logging.getLogger("sheetsplat")
# Largest coordinate; squares and cubes of distances stay finite.
_FARTHEST = 1e90
# Points whose neighbours are searched for at a time.
_PIECE = 1 << 15


def numbers(what: str, given: ArrayLike, name: str) -> NDArray[Any]:
    """Return an array of real numbers, not yet converted, or InvalidInput."""
    array = as_array(unusable(f"{what}: {name}"), given, "an array of numbers")
    if isinstance(given, np.ma.MaskedArray) and np.ma.is_masked(given):
        raise complain(
            unusable(f"{what}: {name}"), "masked entries", "numbers throughout", "drop the points that have none"
        )
    if array.dtype.kind not in "biuf":
        raise complain(unusable(f"{what}: {name}"), f"values of type {array.dtype}", "an array of real numbers")
    return array


def shown_place(place: Floats) -> str:
    """Return a position for a message."""
    return f"({', '.join(f'{part:g}' for part in place)})"


def usable(what: str, nan: str, points: ArrayLike, **others: ArrayLike | None) -> dict[str, Any]:
    """Return arrays, not yet converted, without the rows that have numbers which are not finite; see `usable_rows`.

    None stays. Arrays of another length than the points are the caller's to refuse.
    """
    given = {"points": points, **others}
    found = {name: None if one is None else numbers(what, one, name) for name, one in given.items()}
    count = np.shape(points)[:1]
    rows = {name: one for name, one in found.items() if one is not None and count and one.shape[:1] == count}
    kept = usable_rows(what, {name.removesuffix("s"): one for name, one in rows.items()}, nan, row="point")
    return found if kept is None else found | {name: one[kept] for name, one in rows.items()}


def refuse_entries(
    what: str,
    name: str,
    entries: Floats,
    wrong: NDArray[np.bool_],
    wanted: str,
    advice: str | Words = "remove these entries or correct them",
) -> None:
    """Raise InvalidInput that names the first wrong entry, if there is one, of positions, (N, 3), or numbers, (N,)."""
    if wrong.any():
        first = int(np.argmax(wrong))
        found = shown_place(entries[first]) if entries.ndim == 2 else f"{entries[first]:g}"
        raise complain(
            unusable(f"{what}: {name}"),
            f"{found}, entry {first} (and {int(wrong.sum()) - 1} more like it)",
            wanted,
            advice,
        )


def places(what: str, given: ArrayLike, name: str = "points") -> Floats:
    """Return positions, (N, 3) float64, or InvalidInput that names the first one that cannot be used."""
    array = numbers(what, given, name)
    if array.ndim != 2 or array.shape[1] != 3:
        raise complain(unusable(f"{what}: {name}"), f"an array of shape {array.shape}", "an array of shape (N, 3)")
    _memory.require(24 * len(array), f"{len(array)} {name}")
    result = np.ascontiguousarray(array, dtype=np.float64)
    wrong = np.asarray(~(np.abs(result) <= _FARTHEST).all(axis=1))
    refuse_entries(what, name, result, wrong, f"finite numbers of at most {_FARTHEST:g}")
    return result


def scalars(what: str, given: ArrayLike, name: str, count: int) -> Floats:
    """Return finite numbers, (N,) float64, or InvalidInput that names the first one that is not."""
    array = numbers(what, given, name).reshape(-1)
    if len(array) != count:
        raise complain(
            f"{what}: the arrays do not fit together", f"{count} points and {len(array)} {name}", "as many of each"
        )
    result = np.ascontiguousarray(array, dtype=np.float64)
    refuse_entries(what, name, result, ~np.isfinite(result), "finite numbers")
    return result


def positive(what: str, name: str, given: object) -> float:
    """Return a finite number above 0, or InvalidInput."""
    value = number(f"{what}: {name}", given)
    if not (math.isfinite(value) and value > 0.0):
        raise complain(unusable(f"{what}: {name}"), f"{value:g}", "a finite number above 0")
    return value


def count_of(what: str, name: str, given: object, least: int, most: int) -> int:
    """Return a whole number from `least` to `most`, or InvalidInput."""
    value = whole(f"{what}: {name}", given)
    if not least <= value <= most:
        raise complain(unusable(f"{what}: {name}"), shown(value), f"a whole number from {least} to {most}")
    return value


@dataclass(frozen=True)
class Merged:
    """Points at different positions.

    Attributes
    ----------
    points
        Positions, (N, 3).
    values
        Means of the values given for each position, (N,).
    number
        The row in `points` of each given point.
    merged
        How many given points were merged into others.
    """

    points: Floats
    values: Floats
    number: Numbers
    merged: int


def merge(what: str, points: Floats, values: Floats) -> Merged:
    """Merge points at exactly the same position, in the order of their first appearance."""
    # Adding 0 turns -0 into 0.
    order = np.lexsort((points + 0.0).T)
    new = np.ones(len(order), dtype=bool)
    new[1:] = (points[order[1:]] != points[order[:-1]]).any(axis=1)
    # The sort is stable, so each group starts with its first point.
    first = order[new]
    if len(first) == len(points):
        return Merged(points, values, np.arange(len(points)), 0)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    number = np.empty(len(order), dtype=np.int64)
    number[order] = rank[np.cumsum(new) - 1]
    kept = np.sort(first)
    # Sums of shares do not overflow.
    share = 1.0 / np.bincount(number)
    mean = np.asarray(np.bincount(number, values * share[number]), dtype=np.float64)
    merged = len(points) - len(first)
    _log.info("%s: %d points at the position of another were merged with it", what, merged)
    return Merged(points[kept], mean, number, merged)


def nearest_neighbours(
    points: Floats, most: int, chosen: Numbers | None = None, sides: Floats | None = None
) -> tuple[Numbers, Floats]:
    """Return the numbers and the distances of at most so many other points nearest to each, (N, k), nearest first.

    `chosen`: of these points only. `sides`: those of a periodic box at the origin, 0 along axes that do not wrap.
    """
    from scipy.spatial import cKDTree  # type: ignore[import-untyped]

    tree = cKDTree(points, boxsize=sides)
    wanted = min(most, len(points) - 1) + 1
    # Between the pieces an interrupt is answered.
    asked = points if chosen is None else points[chosen]
    pieces = [tree.query(asked[first : first + _PIECE], k=wanted) for first in range(0, len(asked), _PIECE)]
    distance, number = (np.concatenate([piece[part][:, 1:] for piece in pieces]) for part in (0, 1))
    return number.astype(np.int64), distance


def scaled(points: Floats) -> tuple[Floats, float]:
    """Return coordinates relative to the mean of the points in units of the largest one, and this unit."""
    middle = points.mean(axis=0)
    size = float(np.abs(points - middle).max())
    return (points - middle) / size, size


def thickness(points: Floats) -> tuple[Floats, float]:
    """Return the extents of points along their own principal axes, (3,), and the rounding of their coordinates."""
    far = float(np.abs(points).max())
    middle = points - points.mean(axis=0)
    size = float(np.abs(middle).max())
    single = far < 3e38 and np.array_equal(points.astype(np.float32), points)
    rounding = far * (2.0**-22 if single else 2.0**-46)
    if size == 0.0:
        return np.zeros(3), rounding
    # The triangular factor has the same principal axes; sums of products would lose the thin direction to rounding.
    factor = np.linalg.qr(middle / size, mode="r")
    _, _, axes = np.linalg.svd(factor)
    return np.ptp(middle @ axes.T, axis=0), rounding


def require_volume(what: str, points: Floats) -> None:
    """Raise InvalidInput for points that lie in a plane or on a line, to within the rounding of their coordinates."""
    spread, rounding = thickness(points)
    if not spread.any():
        raise complain(f"{what}: the points cannot be used", "points at one position", "points that fill a volume")
    flat = int((spread <= rounding).sum())
    if flat:
        kind = "in one plane" if flat == 1 else "on one line"
        raise complain(
            f"{what}: the points cannot be used",
            f"{len(points)} points {kind}, of extents {', '.join(f'{part:.3g}' for part in spread)}",
            "points that fill a volume",
            "pass them without the mesh, or " + option_ref("fit", "nearest"),
        )
