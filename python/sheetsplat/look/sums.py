"""Slice distance of pictures of numbers of scattered kernels: x-rays, maxima, averages."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from sheetsplat.fields import EllipsoidField, Field
from sheetsplat.look.measure import Floats

# Slices for each smallest semi-axis of a kernel, as in the default distance.
_PER_SEMI_AXIS = 2.0
# How many times finer than the default such a distance is at least to take its place.
_FINER = 2.0
# Kernels that count at most.
_MOST = 1_000_000


def spacing_of_numbers(fields: Sequence[Field]) -> float | None:
    """Return the distance of slices that kernels call for by what they add to a picture of numbers, or None.

    The default distance is that of the median kernel. Where values go over decades, as densities of SPH do, few and
    small kernels make what is seen: here each kernel counts as much as it adds to the sum of the picture's squares, the
    square of its line integral times its area. None where that is not far below the default, and for other fields.
    """
    known = [one for one in fields if one.size]
    scattered = [one for one in known if isinstance(one, EllipsoidField)]
    if not known or len(scattered) < len(known):
        return None
    thinnest: list[Floats] = []
    shares: list[tuple[Floats, Floats]] = []
    for one in scattered:
        some = slice(None, None, math.ceil(one.size / _MOST))
        scales = one.scales[some]
        axes = np.repeat(scales[:, None], 3, axis=1) if scales.ndim == 1 else scales
        sizes = np.exp(np.log(axes).mean(axis=1))
        values = np.abs(one.values[some].astype(np.float64) - one.base)
        if one.normalization == "none" and one.weights is not None:
            values = values * one.weights[some]
        thinnest.append(axes.min(axis=1))
        shares.append((values, sizes))
    # Relative to the largest, so that powers stay finite.
    value = max(float(values.max()) for values, _ in shares)
    size = max(float(sizes.max()) for _, sizes in shares)
    if not (value > 0.0 and math.isfinite(value)):
        return None
    added = np.concatenate([(values / value) ** 2 * (sizes / size) ** 4 for values, sizes in shares])
    lengths = np.concatenate(thinnest)
    order = np.argsort(lengths)
    summed = np.cumsum(added[order])
    if not summed[-1] > 0.0:
        return None
    median = float(lengths[order[np.searchsorted(summed, 0.5 * summed[-1])]])
    spacing = median / _PER_SEMI_AXIS
    return spacing if spacing * _FINER < min(one.default_slice_spacing for one in known) else None
