"""What the background of samples is: a level inside their range, one of its ends, padding, or all that is outside."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.fields.samples import Samples

Floats = NDArray[np.float64]

# Signed values: their percentiles on both sides of 0, the least quotient of the nearer and the farther of these, the
# mean at most so many deviations from 0, and at most this share in the outermost tenth of either side, where two
# classes would be.
_SIDES = (1.0, 99.0)
_LIKE = 0.3
_NEAR = 0.3
_END, _AT_END = 0.1, 0.3
# Padding: one number at an end of the range, at least this share of the samples, and so far from all others, in their
# range. Padding and others reach the faces of the box, at least this share of them each, and the others are mostly
# background there.
_SPIKE = 1e-3
_AWAY = 0.25
_OTHERS = 0.05
# The background is at the upper end, or outside of a surface, where this share of the faces of the box is.
_OUTSIDE = 0.9
# Distances change evenly: the tenth and the ninetieth percentile of their slopes differ by this share at most.
_EVEN = 0.1
_FEWEST = 4


def is_signed(values: Floats) -> bool:
    """Return whether values lie around 0 as those of a component of a vector do, with 0 as their background."""
    if not values.size or not float(values.min()) < 0.0 < float(values.max()):
        return False
    low, high = (float(part) for part in np.percentile(values, _SIDES))
    if not low < 0.0 < high or min(-low, high) < _LIKE * max(-low, high):
        return False
    # Squares must not overflow.
    scaled = np.ldexp(values, -math.frexp(max(-low, high))[1])
    middle, width = float(scaled.mean()), float(scaled.std())
    ends = max(float((values < (1.0 - _END) * low).mean()), float((values > (1.0 - _END) * high).mean()))
    return abs(middle) <= _NEAR * width and ends <= _AT_END


def without_padding(values: Floats, samples: Samples, scale: float, threshold: Any) -> Floats:
    """Return values without those that stand for no measurement; the same array where there are none.

    Padding is one number far from all others, beside which the volume has a background of its own: padding reaches the
    faces of the box, and so does what is not padding, and is mostly background there.

    Parameters
    ----------
    values
        A subset of the samples without NaN, (N,), divided by `scale`.
    samples
        All of them.
    scale
        A power of two.
    threshold
        Function that returns the value which separates objects from background.
    """
    if len(samples.shape) != 3 or not values.size:
        return values
    for end in (float(values.min()), float(values.max())):
        others: Floats = values[values != end]
        if not others.size or not _SPIKE * values.size <= values.size - others.size:
            continue
        low, high = float(others.min()), float(others.max())
        if not max(low - end, end - high) > _AWAY * (high - low) > 0.0:
            continue
        faces = _faces(samples) / scale
        known = faces[faces != end]
        background = known < threshold(others)
        least = _OTHERS * faces.size
        if least <= known.size <= faces.size - least and 2 * int(background.sum()) > known.size:
            return others
    return values


def is_above(values: Floats, samples: Samples, scale: float, threshold: float) -> bool:
    """Return whether the background of a volume is above a threshold: most samples, and nearly all of the faces."""
    if len(samples.shape) != 3 or 2 * int((values > threshold).sum()) < values.size:
        return False
    faces = _faces(samples) / scale
    return bool(faces.size and (faces > threshold).mean() >= _OUTSIDE)


def step_of_distances(values: Floats, samples: Samples, spacing: Sequence[float]) -> float:
    """Return by how much distances from a closed surface grow over a sample distance; negative if they grow inwards.

    0 for samples that are no such distances: they change evenly everywhere, and nearly all of the faces of the box lie
    on one side of 0.
    """
    if len(samples.shape) != 3 or not values.size or not float(values.min()) < 0.0 < float(values.max()):
        return 0.0
    steps = samples.steps
    coarse = samples.on_grid(steps).astype(np.float64)
    if min(coarse.shape) < _FEWEST or not np.isfinite(coarse).all():
        return 0.0
    apart = [step * width for step, width in zip(steps, spacing[::-1], strict=True)]
    with np.errstate(over="ignore", invalid="ignore"):
        slopes = np.sqrt(sum(part**2 for part in np.gradient(coarse, *apart)))
    if not np.isfinite(slopes).all():
        return 0.0
    low, middle, high = (float(part) for part in np.percentile(slopes, (10.0, 50.0, 90.0)))
    if not 0.0 < high - low <= _EVEN * middle and not low == high > 0.0:
        return 0.0
    faces = _faces_of(coarse)
    outside = float((faces > 0.0).mean())
    if max(outside, 1.0 - outside) < _OUTSIDE:
        return 0.0
    return math.copysign(middle * min(spacing), outside - 0.5)


def _faces(samples: Samples) -> Floats:
    """Return samples at the faces of the box, about, without NaN."""
    found = _faces_of(samples.on_grid(samples.steps).astype(np.float64))
    return found[~np.isnan(found)]


def _faces_of(volume: Floats) -> Floats:
    sides = []
    for axis, size in enumerate(volume.shape):
        # A few layers are seen from above: their large faces are not where data end, but all there is.
        if size >= _FEWEST or max(volume.shape) < _FEWEST:
            sides += [np.take(volume, at, axis).ravel() for at in (0, -1)]
    return np.concatenate(sides)
