"""What single bricks add to a picture, and how two such parts become one.

`merge` is associative up to the rounding of float32, so that parts can be merged in any tree whose leaves are in the
order from front to back (`BrickView.nested`).

There are two kinds of coloured parts. One is drawn alone, as if nothing were in front of it; parts are composited by
*over*. The stop at an opacity and the depth at which opacity reaches one half do not follow from such parts. The other
kind is drawn behind others, of which it knows the opacity: colours add up, and stop and depth are exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.bricks.places import Rect
from sheetsplat.bricks.view import BrickView
from sheetsplat.modes import TRAITS

Numbers = NDArray[Any]


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
        Sums, float64; or extrema, float32.
    counts
        How many slices count, in modes where that matters; 0 where the scalar means nothing.
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

    def arrays(self) -> dict[str, Numbers]:
        """Return the arrays that there are, by their names."""
        found = {name: getattr(self, name) for name in ("rgba", "scalar", "counts", "coverage", "depth")}
        return {name: one for name, one in found.items() if one is not None}

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
    return Partial(
        mode,
        rect,
        rgba=None if view.is_scalar else np.zeros((*shape, 4), np.float32),
        scalar=np.zeros(shape, np.float64 if TRAITS[mode].adds else np.float32) if view.is_scalar else None,
        counts=np.zeros(shape, np.float32) if TRAITS[mode].counts else None,
        coverage=np.zeros(shape, np.float64) if "coverage" in view.outputs else None,
        depth=np.full(shape, np.inf, np.float32) if "depth" in view.outputs else None,
    )


def _common(first: Rect, second: Rect) -> Rect | None:
    x0, y0 = max(first[0], second[0]), max(first[1], second[1])
    x1, y1 = min(first[2], second[2]), min(first[3], second[3])
    return (x0, y0, x1, y1) if x0 < x1 and y0 < y1 else None


def _within(inner: Rect, outer: Rect) -> tuple[slice, slice]:
    return (
        slice(inner[1] - outer[1], inner[3] - outer[1]),
        slice(inner[0] - outer[0], inner[2] - outer[0]),
    )


def _is_empty(part: Partial) -> bool:
    return part.rect[0] >= part.rect[2] or part.rect[1] >= part.rect[3]


def merge(_: Any, *parts: Partial) -> Partial:
    """Return what parts add together, each of which is in front of those after it for every pixel.

    Parts that do not overlap, and parts of scalar modes, may come in any order.
    """
    there = [one for one in parts if not _is_empty(one)]
    if len(there) < 2:
        return there[0] if there else parts[0]
    first = there[0]
    if any(one.is_behind != first.is_behind for one in there):
        raise ValueError("a part that was drawn alone cannot be merged with one that was drawn behind others")
    x0, y0, x1, y1 = zip(*(one.rect for one in there), strict=True)
    rect = min(x0), min(y0), max(x1), max(y1)
    made = {}
    for name, own in first.arrays().items():
        shape = (rect[3] - rect[1], rect[2] - rect[0], *own.shape[2:])
        made[name] = np.full(shape, np.inf if name == "depth" else 0.0, own.dtype)
    found = Partial(first.mode, rect, is_behind=first.is_behind, **made)
    for one in there:
        _add(found, one)
    return found


def _add(front: Partial, back: Partial) -> None:
    """Change a part to both what it holds and a part behind it, which lies in its rectangle."""
    within = _within(back.rect, front.rect)
    made, more = {name: array[within] for name, array in front.arrays().items()}, back.arrays()
    if back.rgba is not None:
        rgba = made["rgba"]
        before = rgba[..., 3].copy()
        if back.is_behind:
            np.add(rgba, back.rgba, out=rgba)
            # Where bricks of the back are, it has the opacity of both, which is no less than that of the front.
            np.maximum(before, back.rgba[..., 3], out=rgba[..., 3])
        else:
            np.add(rgba, _times(back.rgba, np.float32(1.0) - before), out=rgba)
    if back.depth is not None:
        np.minimum(made["depth"], back.depth, out=made["depth"])
    mode = TRAITS[back.mode]
    if mode.is_extreme:
        a, b = made["scalar"], more["scalar"]
        a[...] = np.where(made["counts"] == 0, b, np.where(more["counts"] == 0, a, mode.reduce(a, b)))
    elif back.scalar is not None:
        made["scalar"] += back.scalar
    for name in ("counts", "coverage"):
        if name in more:
            made[name] += more[name]


def _times(rgba: Numbers, left: Numbers) -> Numbers:
    """Return colours times a number a pixel, a channel at a time: NumPy takes longer for four numbers a loop."""
    found = np.empty_like(rgba)
    for channel in range(rgba.shape[2]):
        np.multiply(left, rgba[..., channel], out=found[..., channel])
    return found


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
    whole = _blank(view, (0, 0, *view.size))
    if not _is_empty(part):
        _add(whole, part)
    rgba, scalar, counts = whole.rgba, whole.scalar, whole.counts
    if rgba is not None:
        rgba = over_background(view, rgba)
    if counts is not None and scalar is not None:
        scalar = np.where(counts > 0, scalar / np.maximum(counts, 1.0) if TRAITS[view.mode].mean else scalar, np.nan)
    if scalar is not None:
        scalar = scalar.astype(np.float32)
    coverage = None if whole.coverage is None else whole.coverage.astype(np.float32)
    return Finished(rgba, scalar, coverage, whole.depth)


def over_background(view: BrickView, rgba: Numbers) -> Numbers:
    """Return colours of a picture over the background that its options name, (h, w, 4); without one as they are."""
    if view.options["background"] is None:
        return rgba
    behind = (1.0 - rgba[..., 3:].astype(np.float64)) * np.asarray(view.options["background"])
    found = np.ones_like(rgba)
    found[..., :3] = (rgba[..., :3] + behind).astype(np.float32)
    return found
