"""Volumes whose values pass through their samples, and when they must not."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat.errors import InvalidInput, OutOfMemory
from sheetsplat.fields import RegularField

#: Largest noise of samples that are interpolated, of their standard deviation. Coefficients have 8 times the noise of
#: the samples: with more, slices show again, empty space is not seen to be empty, and frames take 2 to 3 times as long.
#: docs/quality.md has it for measured volumes.
LARGEST_NOISE = 0.007
# Integers of so few different values are classes.
_FEWEST_VALUES = 8
# Samples at which noise is estimated, in whole layers, and the squared sum of the taps 1, -2, 1 along three axes.
_ENOUGH = 2_000_000
_GAIN = 6.0**3
# What coefficients and their solution need, bytes a sample; no more than this share of the free memory is taken.
_BYTES = 12
_SHARE = 0.5


@dataclass(frozen=True)
class Sampled:
    """A volume, prefiltered where that is right.

    Attributes
    ----------
    field
        The volume.
    reason
        Why its values pass through the samples, or why not.
    """

    field: RegularField
    reason: str


def through_samples(field: RegularField, radius: float, falloff: float) -> Sampled:
    """Return a volume of such kernels whose sum passes through its samples; where that is wrong, it as it is."""
    if reason := _refusal(field):
        return Sampled(field, reason)
    try:
        made = field.replace(radius=radius, falloff=falloff, normalization="lattice", prefilter=True)
    except OutOfMemory:
        return Sampled(field, "plain sums: the coefficients need more memory than there is")
    except InvalidInput as error:
        return Sampled(field, f"plain sums: these kernels cannot pass through the samples: {error.found}")
    return Sampled(made, "values pass through the samples; once about 40 ns a sample")


def _refusal(field: RegularField) -> str:
    """Return why the sums of a volume should not pass through its samples, or ""."""
    values = field.values
    if field.normalization == "threshold":
        return "plain sums: they are divided by their weights, and do not pass through samples"
    if not values.size:
        return "plain sums: there are no samples"
    if values.dtype.kind == "f" and field.size < values.size:
        return "plain sums: samples are missing (NaN), and sums cannot pass through those beside them"
    if _BYTES * values.size > _SHARE * _memory.available():
        return f"plain sums: the coefficients would take {_BYTES * values.size / 1e6:,.0f} MB"
    if values.dtype.kind != "f" and _is_of_classes(values):
        return f"plain sums: up to {_FEWEST_VALUES} different values are classes, between which there is nothing"
    noise = noise_of(field)
    if noise > LARGEST_NOISE:
        return f"plain sums: {100.0 * noise:.3g} % of what the samples vary is noise, which coefficients would amplify"
    return ""


def _is_of_classes(values: NDArray[Any]) -> bool:
    # An odd stride does not sample the same columns of every row.
    stride = max(1, values.size // _ENOUGH) | 1
    return np.unique(values.reshape(-1)[::stride]).size <= _FEWEST_VALUES


def noise_of(field: RegularField) -> float:
    """Return the standard deviation of noise over that of the samples, 0 to 1: 1 for nothing but noise.

    Second differences along all three axes at once are 0 where values are smooth along any one of them, which planes
    and edges are; of noise that differs from sample to sample they have a known part. (J. Immerkær, Fast noise variance
    estimation, 1996, has the same in two dimensions.)
    """
    values = field.values
    # Neighbours on a BCC lattice are two layers apart.
    apart = 2 if field.lattice == "bcc" else 1
    nk, nj, ni = values.shape
    if nk <= 2 * apart or min(nj, ni) <= 2:
        return 0.0
    layers = max(1, min(nk - 2 * apart, _ENOUGH // (nj * ni)))
    starts = np.unique(np.linspace(0, nk - 2 * apart - 1, layers).astype(int))
    # Differences of the largest numbers must not overflow, nor the squares of the smallest vanish.
    low, high = field.value_range
    middle, width = 0.5 * low + 0.5 * high, 0.5 * high - 0.5 * low
    if not width > 0.0:
        return 0.0
    mixed_squares = squares = mean = 0.0
    for k in starts:
        around = [(values[k + n * apart].astype(np.float64) - middle) / width for n in range(3)]
        mixed = around[0] - 2.0 * around[1] + around[2]
        mixed = mixed[:-2] - 2.0 * mixed[1:-1] + mixed[2:]
        mixed = mixed[:, :-2] - 2.0 * mixed[:, 1:-1] + mixed[:, 2:]
        mixed_squares += float(np.mean(mixed**2)) / len(starts)
        squares += float(np.mean(around[1] ** 2)) / len(starts)
        mean += float(np.mean(around[1])) / len(starts)
    variance = squares - mean**2
    return min(1.0, math.sqrt(mixed_squares / _GAIN / variance)) if variance > 0.0 else 0.0
