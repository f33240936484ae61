"""Volumes whose values pass through their samples, and when they must not."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from sheetsplat import _memory
from sheetsplat.errors import InvalidInput, OutOfMemory
from sheetsplat.fields import BrickedField, RegularField
from sheetsplat.fields.derived import keep, kept
from sheetsplat.fields.samples import Samples

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
_THROUGH = "values pass through the samples; once about 40 ns a sample"


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
    if kept(field, radius, falloff) is None and (reason := _refusal(field)):
        return Sampled(field, reason)
    try:
        return Sampled(prefiltered(field, radius, falloff), _THROUGH)
    except OutOfMemory:
        return Sampled(field, "plain sums: the coefficients need more memory than there is")
    except InvalidInput as error:
        return Sampled(field, f"plain sums: these kernels cannot pass through the samples: {error.found}")


def prefiltered(field: RegularField, radius: float, falloff: float) -> RegularField:
    """Return a volume with kernels whose sum passes through its samples.

    Its coefficients are computed once as long as the field is there, but where another kernel was asked for meanwhile.

    Raises
    ------
    InvalidInput, OutOfMemory
        As `RegularField`.
    """
    options: dict[str, Any] = {"radius": radius, "falloff": falloff, "normalization": "lattice", "prefilter": True}
    if isinstance(field, BrickedField):
        # Its coefficients are computed brick by brick.
        return field.replace(**options)
    known = kept(field, radius, falloff)
    return keep(field, lambda: field.replace(**options), radius, falloff) if known is None else known


def _refusal(field: RegularField) -> str:
    """Return why the sums of a volume should not pass through its samples, or ""."""
    samples = field.samples
    if field.normalization == "threshold":
        return "plain sums: they are divided by their weights, and do not pass through samples"
    if not samples.size:
        return "plain sums: there are no samples"
    if samples.dtype.kind == "f" and field.size < samples.size:
        return "plain sums: samples are missing (NaN), and sums cannot pass through those beside them"
    # Of a volume in bricks, coefficients are found brick by brick.
    if not isinstance(field, BrickedField) and _BYTES * samples.size > _SHARE * _memory.available():
        return f"plain sums: the coefficients would take {_BYTES * samples.size / 1e6:,.0f} MB"
    if samples.dtype.kind != "f" and _is_of_classes(samples):
        return f"plain sums: up to {_FEWEST_VALUES} different values are classes; labels=True shows them as things"
    noise = noise_of(field)
    if noise > LARGEST_NOISE:
        return f"plain sums: {100.0 * noise:.3g} % of what the samples vary is noise, which coefficients would amplify"
    return ""


def stride_of(size: int) -> int:
    """Return of how many samples one is looked at. An odd stride does not take the same columns of every row."""
    return max(1, size // _ENOUGH) | 1


def _is_of_classes(samples: Samples) -> bool:
    return np.unique(samples.every(stride_of(samples.size))).size <= _FEWEST_VALUES


def noise_of(field: RegularField) -> float:
    """Return the standard deviation of noise over that of the samples, 0 to 1: 1 for nothing but noise.

    Second differences along all three axes at once are 0 where values are smooth along any one of them, which planes
    and edges are; of noise that differs from sample to sample they have a known part. (J. Immerkær, Fast noise variance
    estimation, 1996, has the same in two dimensions.)
    """
    low, high = field.value_range
    starts, apart = rough_layers(field.shape, field.lattice)
    if not starts or not 0.5 * high - 0.5 * low > 0.0:
        return 0.0
    mixed_squares, variance = field.samples.roughness(starts, apart, (low, high))
    return min(1.0, math.sqrt(mixed_squares / _GAIN / variance)) if variance > 0.0 else 0.0


def rough_layers(shape: tuple[int, int, int], lattice: str) -> tuple[list[int], int]:
    """Return the first of three layers where noise is estimated, and how far they are apart; none in thin volumes."""
    # Neighbours on a BCC lattice are two layers apart.
    apart = 2 if lattice == "bcc" else 1
    nk, nj, ni = shape
    if nk <= 2 * apart or min(nj, ni) <= 2:
        return [], apart
    layers = max(1, min(nk - 2 * apart, _ENOUGH // (nj * ni)))
    return np.unique(np.linspace(0, nk - 2 * apart - 1, layers).astype(int)).tolist(), apart
