"""What single bricks add to a picture, and how two such parts become one.

`merge` is associative up to the rounding of float32, so that parts can be merged in any tree whose leaves are in the
order from front to back (`BrickView.nested`).

There are two kinds of coloured parts. One is drawn alone, as if nothing were in front of it; parts are composited by
*over*. The stop at an opacity and the depth at which opacity reaches one half do not follow from such parts. The other
kind is drawn behind others, of which it knows the opacity: colours add up, and stop and depth are exact.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.bricks.places import Rect
from sheetsplat.bricks.view import BrickView

Numbers = NDArray[Any]
# Attributes of a part that are arrays.
_ARRAYS = ("rgba", "scalar", "counts", "coverage", "depth")
# Modes in which slices count, and a pixel without any is no number.
_COUNTED = ("mip", "minimum", "average")


@dataclass(frozen=True, eq=False)
class Partial:
    """What some bricks, neighbours in depth, add to a picture. Arrays cover a rectangle of it, row 0 at the top.

    Attributes
    ----------
    mode
        The mode of the picture.
    rect
        The rectangle.
    rgba
        Premultiplied, float32 (h, w, 4); None in scalar modes. Of parts behind others the opacity is that of all that
        is in front too, and the colours are what they add.
    scalar
        Modes xray and average: sums, float64; mip and minimum: extrema, float32.
    counts
        Modes mip, minimum and average: how many slices count, 0 where the scalar means nothing.
    coverage
        Sums, float64, where asked for.
    depth
        Depths at which opacity reaches one half, float32, where asked for of parts behind others: infinite where it
        does not.
    is_behind
        Whether it was drawn behind others.
    """

    mode: str
    rect: Rect
    rgba: Numbers | None = None
    scalar: Numbers | None = None
    counts: Numbers | None = None
    coverage: Numbers | None = None
    depth: Numbers | None = None
    is_behind: bool = False

    def opacity(self, rect: Rect) -> Numbers:
        """Return the opacity in a rectangle, 0 where it has none, float32 (h, w)."""
        found = np.zeros((rect[3] - rect[1], rect[2] - rect[0]), np.float32)
        if self.rgba is not None and (both := _common(rect, self.rect)):
            found[_within(both, rect)] = self.rgba[_within(both, self.rect)][..., 3]
        return found


def empty(view: BrickView) -> Partial:
    """Return what no brick adds."""
    return _blank(view, (0, 0, 0, 0))


def _blank(view: BrickView, rect: Rect) -> Partial:
    shape = (max(rect[3] - rect[1], 0), max(rect[2] - rect[0], 0))
    mode = view.mode
    sums = mode in ("xray", "average")
    return Partial(
        mode,
        rect,
        rgba=None if view.is_scalar else np.zeros((*shape, 4), np.float32),
        scalar=np.zeros(shape, np.float64 if sums else np.float32) if view.is_scalar else None,
        counts=np.zeros(shape, np.float32) if mode in _COUNTED else None,
        coverage=np.zeros(shape, np.float64) if "coverage" in view.outputs else None,
        depth=np.full(shape, np.inf, np.float32) if "depth" in view.outputs else None,
    )


def _common(first: Rect, second: Rect) -> Rect | None:
    x0, y0 = max(first[0], second[0]), max(first[1], second[1])
    x1, y1 = min(first[2], second[2]), min(first[3], second[3])
    return (x0, y0, x1, y1) if x0 < x1 and y0 < y1 else None


def _around(first: Rect, second: Rect) -> Rect:
    return (
        min(first[0], second[0]),
        min(first[1], second[1]),
        max(first[2], second[2]),
        max(first[3], second[3]),
    )


def _within(inner: Rect, outer: Rect) -> tuple[slice, slice]:
    return (
        slice(inner[1] - outer[1], inner[3] - outer[1]),
        slice(inner[0] - outer[0], inner[2] - outer[0]),
    )


def _is_empty(part: Partial) -> bool:
    return part.rect[0] >= part.rect[2] or part.rect[1] >= part.rect[3]


def merge(*parts: Partial) -> Partial:
    """Return what parts add together, each of which is in front of those after it for every pixel.

    Parts that do not overlap, and parts of scalar modes, may come in any order.
    """
    there = [one for one in parts if not _is_empty(one)]
    if len(there) < 2:
        return there[0] if there else parts[0]
    first = there[0]
    if any(one.is_behind != first.is_behind for one in there):
        raise ValueError("a part that was drawn alone cannot be merged with one that was drawn behind others")
    rect = first.rect
    for one in there[1:]:
        rect = _around(rect, one.rect)
    # What is changed below is no part's own.
    own = first.rect == rect
    made = {name: array.copy() if own else array for name, array in _spread(first, rect).items()}
    for one in there[1:]:
        # Elsewhere it adds nothing.
        within = _within(one.rect, rect)
        _add({name: array[within] for name, array in made.items()}, one)
    return Partial(first.mode, rect, is_behind=first.is_behind, **made)


def _add(front: Mapping[str, Numbers], back: Partial) -> None:
    """Change arrays to those of both what they hold and a part behind it."""
    if back.rgba is not None:
        rgba = front["rgba"]
        before = rgba[..., 3].copy()
        if back.is_behind:
            np.add(rgba, back.rgba, out=rgba)
            # Where bricks of the back are, it has the opacity of both, which is no less than that of the front.
            np.maximum(before, back.rgba[..., 3], out=rgba[..., 3])
        else:
            np.add(rgba, _times(back.rgba, np.float32(1.0) - before), out=rgba)
        if back.depth is not None:
            np.minimum(front["depth"], back.depth, out=front["depth"])
    if back.scalar is not None:
        _merge_scalars(back.mode, front, back)
    if back.coverage is not None:
        front["coverage"] += back.coverage


def _times(rgba: Numbers, left: Numbers) -> Numbers:
    """Return colours times a number a pixel, a channel at a time: NumPy takes longer for four numbers a loop."""
    found = np.empty_like(rgba)
    for channel in range(rgba.shape[2]):
        np.multiply(left, rgba[..., channel], out=found[..., channel])
    return found


def _merge_scalars(mode: str, front: Mapping[str, Numbers], back: Partial) -> None:
    """Change the numbers of scalar modes to those of both parts."""
    a, b = front["scalar"], back.scalar
    assert b is not None
    if mode in ("mip", "minimum"):
        assert back.counts is not None
        better = np.maximum if mode == "mip" else np.minimum
        a[...] = np.where(front["counts"] == 0, b, np.where(back.counts == 0, a, better(a, b)))
    else:
        a += b
    if back.counts is not None:
        front["counts"][...] += back.counts


def _spread(part: Partial, rect: Rect) -> dict[str, Numbers]:
    """Return the arrays of a part over a larger rectangle; its own where that is the same."""
    found: dict[str, Numbers] = {}
    here = _within(part.rect, rect)
    shape = (rect[3] - rect[1], rect[2] - rect[0])
    for name in _ARRAYS:
        own = getattr(part, name)
        if own is None:
            continue
        if rect == part.rect:
            found[name] = own
            continue
        wide = np.full((*shape, *own.shape[2:]), np.inf, own.dtype) if name == "depth" else _zeros(own, shape)
        wide[here] = own
        found[name] = wide
    return found


def _zeros(like: Numbers, shape: tuple[int, int]) -> Numbers:
    return np.zeros((*shape, *like.shape[2:]), like.dtype)


@dataclass(frozen=True, eq=False)
class Finished:
    """A whole picture, row 0 at the top; its arrays are those of `sheetsplat.Image`.

    Attributes
    ----------
    rgba
        float32 (h, w, 4), premultiplied, with the background; None in scalar modes.
    scalar, coverage, depth
        float32 (h, w), or None.
    """

    rgba: Numbers | None
    scalar: Numbers | None
    coverage: Numbers | None
    depth: Numbers | None


def finish(view: BrickView, part: Partial) -> Finished:
    """Return the picture of all bricks."""
    width, height = view.size
    whole: Rect = (0, 0, width, height)
    wide = _spread(_blank(view, whole) if _is_empty(part) else part, whole)
    rgba = wide.get("rgba")
    if rgba is not None:
        rgba = over_background(view, rgba.astype(np.float32, copy=False))
    scalar = wide.get("scalar")
    if scalar is not None:
        if view.mode == "average":
            scalar = scalar / np.maximum(wide["counts"], 1.0)
        if view.mode in _COUNTED:
            scalar = np.where(wide["counts"] > 0, scalar, np.nan)
        scalar = scalar.astype(np.float32)
    coverage = wide.get("coverage")
    return Finished(rgba, scalar, None if coverage is None else coverage.astype(np.float32), wide.get("depth"))


def over_background(view: BrickView, rgba: Numbers) -> Numbers:
    """Return colours of a picture over the background that its options name, (h, w, 4); without one as they are."""
    if view.options["background"] is None:
        return rgba
    behind = (1.0 - rgba[..., 3:].astype(np.float64)) * np.asarray(view.options["background"])
    found = np.ones_like(rgba)
    found[..., :3] = (rgba[..., :3] + behind).astype(np.float32)
    return found
