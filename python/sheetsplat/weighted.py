"""Weighted means along rays: two x-rays, of the product and of the weight. Conventions, section 7 (Modes)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.fields import EllipsoidField, Field, RegularField
from sheetsplat.look.measure import with_values
from sheetsplat.modes import TRAITS

#: The mode of both sums.
SUMS = next(name for name, mode in TRAITS.items() if mode.integrates)


def is_weighted(field: Field, mode: object) -> bool:
    """Return whether a mode shows weighted means of a field."""
    return field.weighting is not None and isinstance(mode, str) and mode in TRAITS and TRAITS[mode].mean


def sums_of(field: Field) -> tuple[Field, Field]:
    """Return the fields of the product and of the weight of one with weights, which have its kernels and the base 0.

    Weights are divided by the largest: those of densities in cgs units are too small for float32. Volumes whose values
    pass through their samples are plain sums where a coefficient of the weight would be below 0: means of such weights
    may be anything.
    """
    assert field.weighting is not None and isinstance(field, RegularField | EllipsoidField)
    # Where one of them is missing both are, for volumes whose NaN samples are left out.
    weights = np.where(np.isnan(field.values), np.nan, field.weighting) / float(np.nanmax(field.weighting))
    if isinstance(field, EllipsoidField):
        plain: dict[str, Any] = {"normalization": "none", "base": 0.0}
        kernels = with_values(field, weights, **plain), with_values(field, weights * field.values, **plain)
        return kernels[1].weighted_by(None), kernels[0].weighted_by(None)
    kind = np.float32 if field.values.dtype.itemsize <= 4 else np.float64
    own: dict[str, Any] = {"base": 0.0}
    weight = field.replace(weights.astype(kind), **own)
    if weight.prefilter and weight.coefficients.min() < 0.0:
        own["prefilter"] = False
        weight = field.replace(weights.astype(kind), **own)
    product = field.replace((weights * field.values).astype(kind), **own)
    return product.weighted_by(None), weight.weighted_by(None)


def mean_of(
    product: NDArray[np.float32], weight: NDArray[np.float32], value_range: tuple[float, float]
) -> NDArray[np.float32]:
    """Return the weighted mean of each pixel, (h, w), from both x-rays; NaN where there is no weight."""
    there = weight > 0.0
    found = np.full(weight.shape, np.nan)
    np.divide(product, weight, out=found, where=there, dtype=np.float64)
    # Rounding alone leaves the range.
    made: NDArray[np.float32] = np.clip(found, *value_range).astype(np.float32)
    return made
