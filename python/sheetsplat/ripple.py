"""The ripple of sums of kernels on a lattice: how far they vary where the data are constant; visible in lit close-ups.

The sum over a lattice of equal samples is nearly constant, but differs slightly between the samples. Wider kernels,
division by the sum of weights (normalisation "threshold") and interpolating coefficients
(`RegularField(..., prefilter=True)`) reduce the ripple, each with another remainder. Conventions, section 2.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _sheetsplat
from sheetsplat._checks import choice, number, truth
from sheetsplat.errors import complain, option_ref, unusable
from sheetsplat.fields import Lattice, Normalization
from sheetsplat.fields.ending import lattice_constant, unit_radius

Floats = NDArray[np.float64]

# Places along an edge of the irreducible part of a cell, both ends included.
_PLACES = 21
# Largest radius in sample distances; wider kernels have negligible ripple and very many neighbours.
_WIDEST = 8.0


@dataclass(frozen=True)
class Ripple:
    """Deviations for constant data and for a ramp.

    Attributes
    ----------
    peak, rms
        Largest and root mean square difference from 1 where all samples are 1.
    slope
        Root mean square length of the gradient there, per sample distance: visible as a pattern under lights.
    ramp
        Root mean square difference from 1 of the slope, along x, where samples rise by 1 a sample distance along x
        from 0 in the cell at the origin.
    """

    peak: float
    rms: float
    slope: float
    ramp: float


def lattice_ripple(
    radius: float = 2.0,
    falloff: float = 5.0,
    *,
    lattice: Lattice = "cartesian",
    normalization: Normalization = "lattice",
    w0: float = 1.0,
    prefilter: bool = False,
) -> Ripple:
    """Return the ripple of kernels on an endless lattice, in float64, from the sums themselves.

    Parameters
    ----------
    radius, falloff, lattice, normalization, w0, prefilter
        As for `RegularField`. Sums of "none" are judged by their mean.

    Raises
    ------
    InvalidInput
        For invalid parameters, kernels that leave holes between samples, and those that cannot be prefiltered.

    Examples
    --------
    >>> ss.lattice_ripple(2.5, 7).rms < 0.2 * ss.lattice_ripple(2, 5).rms
    True
    """
    what = "lattice_ripple"
    choice(f"{what}: lattice", lattice, ("cartesian", "bcc"))
    way = choice(f"{what}: normalization", normalization, ("none", "lattice", "threshold"))
    size, k = number(f"{what}: radius", radius), number(f"{what}: falloff", falloff)
    least = number(f"{what}: w0", w0)
    for name, value, most in (("radius", size, _WIDEST), ("falloff", k, 700.0), ("w0", least, 1e300)):
        if not 0.0 < value <= most:
            raise complain(unusable(f"{what}: {name}"), f"{value:g}", f"a number above 0, at most {most:g}")
    if truth(f"{what}: prefilter", prefilter):
        if way == "threshold":
            raise complain(
                f"{what}: these options cannot be used together",
                option_ref("prefilter", "true") + " and " + option_ref("normalization", "threshold"),
                "one of them",
            )
        _sheetsplat.prefilter_condition(size, k, lattice)
        way = "prefilter"
    return _ripple(size, k, lattice, way, least)


@lru_cache(maxsize=256)
def _ripple(radius: float, falloff: float, lattice: Lattice, way: str, w0: float) -> Ripple:
    reach = unit_radius(radius, lattice)
    # Mirror planes go through all samples and midway between them: an eighth of a cell stands for all of it.
    edge = np.linspace(0.0, 1.0 if lattice == "bcc" else 0.5, _PLACES)
    x, y, z = (part.ravel() for part in np.meshgrid(edge, edge, edge, indexing="ij"))
    one = np.ones(_PLACES)
    one[[0, -1]] = 0.5
    share = (one[:, None, None] * one[:, None] * one).ravel()
    share /= share.sum()
    weight, ramp, ramp_along = (np.zeros(x.size) for _ in range(3))
    gradient = np.zeros((3, x.size))
    lowered = -math.expm1(-falloff)
    steps = range(-math.ceil(reach), math.ceil(reach) + 2)
    for at in itertools.product(steps, repeat=3):
        if lattice == "bcc" and len({n % 2 for n in at}) > 1:
            continue
        away = np.stack([x - at[0], y - at[1], z - at[2]])
        squares = (away**2).sum(axis=0) / reach**2
        near = squares < 1.0
        if not near.any():
            continue
        bell = np.where(near, np.exp(-falloff * squares), 0.0)
        value = np.where(near, (bell - math.exp(-falloff)) / lowered, 0.0)
        slope = -2.0 * falloff / (reach**2 * lowered) * bell * away
        weight += value
        gradient += slope
        ramp += at[0] * value
        ramp_along += at[0] * slope[0]
    if not weight.min() > 0.0:
        raise complain(
            "lattice_ripple: the kernels leave holes",
            f"radius {radius:g}",
            "kernels that reach everywhere between the samples",
            "use a larger " + option_ref("radius"),
        )
    if way == "threshold":
        divides = weight > w0
        divisor = np.where(divides, weight, w0)
        flat = weight / divisor
        rise = np.where(divides, (ramp_along - ramp / divisor * gradient[0]) / divisor, ramp_along / w0)
        gradient = np.where(divides, 0.0, gradient / w0)
    else:
        # Samples that are equal, or rise evenly, are multiplied by the sum of weights at a sample: so the coefficients
        # that interpolate them are the samples over that sum.
        mean = float(weight[0]) if way == "prefilter" else lattice_constant(radius, falloff, lattice)
        flat, gradient, rise = weight / mean, gradient / mean, ramp_along / mean
    # From the unit of whole numbers to sample distances.
    distance = reach / radius
    return Ripple(
        peak=float(np.abs(flat - 1.0).max()),
        rms=math.sqrt(float(share @ (flat - 1.0) ** 2)),
        slope=distance * math.sqrt(float(share @ (gradient**2).sum(axis=0))),
        ramp=math.sqrt(float(share @ (rise - 1.0) ** 2)),
    )


__all__ = ["Ripple", "lattice_constant", "lattice_ripple", "unit_radius"]
