"""Several samples a pixel: a picture of n times the width and height, and its mean. Conventions, section 1."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.errors import OutOfMemory, complain, option_ref
from sheetsplat.limits import Depths

Floats = NDArray[np.float32]
_LONGEST_EDGE = 2**31 - 1
# Numbers of a picture that are combined at once.
_AT_ONCE = 1 << 20


@dataclass(frozen=True)
class Arrays:
    """The arrays of a picture, row 0 at the top, float32; None: it has none of this kind.

    Attributes
    ----------
    rgba
        Premultiplied, linear, (h, w, 4).
    scalar, coverage, depth
        (h, w).
    """

    rgba: Floats | None
    scalar: Floats | None
    coverage: Floats | None
    depth: Floats | None


def fine_size(size: tuple[int, int], samples: int) -> tuple[int, int]:
    """Return the size of the picture that has a pixel for each of samples x samples in a pixel, or InvalidInput."""
    width, height = samples * size[0], samples * size[1]
    if max(width, height) > _LONGEST_EDGE:
        raise complain(
            "the picture cannot be drawn",
            f"{size[0]} x {size[1]} pixels, {samples} x {samples} samples each",
            f"at most {_LONGEST_EDGE} samples along an edge",
            option="supersampling",
        )
    return width, height


def fine_depths(depths: Depths | None, samples: int) -> Depths | None:
    """Return the depths of a surface for every sample: those of its pixel."""
    if depths is None or samples == 1:
        return depths
    return depths.repeat(samples, axis=0).repeat(samples, axis=1)


def averaged(picture: Any, samples: int) -> Any:
    """Return the arrays of a picture that was drawn at n times its size: means, and of depths the nearest.

    `picture` has the attributes of `Arrays`; with one sample a pixel it is returned as it is.
    """
    if samples == 1:
        return picture
    return Arrays(
        mean(picture.rgba, samples),
        _over_pixels(picture.scalar, samples, np.add, samples * samples, numbers=True),
        mean(picture.coverage, samples),
        _over_pixels(picture.depth, samples, np.minimum),
    )


def mean(fine: NDArray[Any] | None, samples: int) -> Floats | None:
    """Return the mean over the samples of each pixel, summed in float64."""
    return _over_pixels(fine, samples, np.add, samples * samples)


def _over_pixels(
    fine: NDArray[Any] | None, samples: int, combine: Callable[..., Any], divisor: int = 1, *, numbers: bool = False
) -> Floats | None:
    """Return what the samples of each pixel become; `numbers`: the mean of those that are, NaN where none is."""
    if fine is None:
        return None
    height, width = fine.shape[0] // samples, fine.shape[1] // samples
    made = np.empty((height, width, *fine.shape[2:]), np.float32)
    # A few rows at a time: the float64 sums of all would be as large as the fine picture.
    rows = max(1, _AT_ONCE // max(1, made[0].size))
    for start in range(0, height, rows):
        part = fine[start * samples : (start + rows) * samples]
        there = ~np.isnan(part) if numbers else None
        count: Any = divisor
        if there is not None and not there.all():
            part = np.where(there, part, np.float32(0.0))
            count = sum(
                there[place // samples :: samples, place % samples :: samples].astype(np.int64)
                for place in range(samples * samples)
            )
        found = part[::samples, ::samples].astype(np.float64)
        for place in range(1, samples * samples):
            combine(found, part[place // samples :: samples, place % samples :: samples], out=found)
        with np.errstate(invalid="ignore"):
            made[start : start + rows] = found / count
    return made


@contextmanager
def counting_samples(samples: int) -> Iterator[None]:
    """Say in errors about memory how many samples a pixel has."""
    try:
        yield
    except OutOfMemory as error:
        if samples == 1:
            raise
        told = error.complaint
        advice = "use " + option_ref("supersampling", "1") + f", which takes 1/{samples * samples} of it"
        what = f"{samples} x {samples} samples a pixel: {told.what}"
        raise complain(what, told.found, told.wanted, advice, option=error.option, kind=OutOfMemory) from None
