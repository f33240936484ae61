"""What it costs to make one Gaussian of two: the squared difference of their sum before and after, over space.

Symmetric matrices are six rows xx, yy, zz, xy, xz, yz. A kernel of the integral Q stands for Q times a normal density
of its covariance, whose products have integrals in closed form: ∫ N(x; c, A) N(x; d, B) dx = N(c − d; 0, A + B).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]

# Determinants of flat kernels may vanish by rounding: of the product of the diagonal, at least this share is taken.
_FLATTEST = 1e-15
# Pairs that are looked at at once: their numbers stay in the cache.
_CHUNK = 1 << 14
# Kernels that are farther apart than this share of the overlap of two at one place, three standard deviations of both,
# cost the more, and at most so much: they are joined last, as what becomes of them bridges a gap.
_NEAR, _MOST = 0.01, 1e12


def squares(d: Floats) -> Floats:
    """Return d dᵀ of vectors (3, n)."""
    x, y, z = d
    return np.stack((x * x, y * y, z * z, x * y, x * z, y * z))


def determinant(a: Floats) -> Floats:
    """Return the determinants of symmetric matrices."""
    xx, yy, zz, xy, xz, yz = a
    found = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    return np.asarray(np.maximum(found, _FLATTEST * xx * yy * zz))


def _overlap(a: Floats, d: Floats) -> Floats:
    """Return N(d; 0, A) but for the factor (2 pi)^(-3/2), which all terms have."""
    xx, yy, zz, xy, xz, yz = a
    x, y, z = d
    first, second, third = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    size = np.maximum(xx * first + xy * second + xz * third, _FLATTEST * xx * yy * zz)
    square = first * x * x + (xx * zz - xz * xz) * y * y + (xx * yy - xy * xy) * z * z
    square += 2.0 * (second * x * y + third * x * z + (xy * xz - xx * yz) * y * z)
    # (No square of a length is negative.)
    return np.asarray(np.exp(-0.5 * np.maximum(square / size, 0.0)) / np.sqrt(size))


@dataclass
class Clusters:
    """Clusters by their moments, the columns of arrays.

    Attributes
    ----------
    mass
        Integrals of m g, (n,).
    centers
        Means of place, (3, n).
    covariances
        Of place, (6, n).
    sums
        Integrals of what is kept beside the mass, (k, n); sums of clusters are those of their kernels.
    kernels
        The kernel that is a cluster by itself, (n,); -1 of others.
    """

    mass: Floats
    centers: Floats
    covariances: Floats
    sums: Floats
    kernels: Whole

    def __len__(self) -> int:
        """Return the number of clusters."""
        return len(self.mass)

    def energies(self) -> Floats:
        """Return the integral of the square of each cluster's density."""
        return np.asarray(1.0 / np.sqrt(8.0 * determinant(self.covariances)))

    def joined(self, i: Whole, j: Whole, apart: Floats) -> None:
        """Add clusters j to clusters i, `apart` the way from i to j (3, n), and leave j out."""
        a = self.mass[i] / (self.mass[i] + self.mass[j])
        b = 1.0 - a
        both = a * self.covariances[:, i] + b * self.covariances[:, j] + a * b * squares(apart)
        self.covariances[:, i] = both
        self.centers[:, i] += b * apart
        self.mass[i] += self.mass[j]
        self.sums[:, i] += self.sums[:, j]
        self.kernels[i] = -1
        kept = np.ones(len(self), dtype=bool)
        kept[j] = False
        for name in ("mass", "centers", "covariances", "sums", "kernels"):
            setattr(self, name, np.ascontiguousarray(getattr(self, name)[..., kept]))


@dataclass(frozen=True)
class Measure:
    """A density whose change counts: a row of the sums, or the mass, by a power of a cluster's own mass.

    Attributes
    ----------
    row
        Of `Clusters.sums`; None: the mass.
    power
        Squared differences are divided by the mass of a pair to this power: 0, all of space counts the same; 1, all
        kernels do; more, small ones count more.
    scale
        What the cost is divided by.
    contrast
        Only what a pair's values differ by counts, as where sums of values are divided by sums of weights: there what
        both change alike does not show.
    """

    row: int | None
    power: float
    scale: float = 1.0
    contrast: bool = False

    def of(self, clusters: Clusters) -> Floats:
        """Return the integrals of the density."""
        return clusters.mass if self.row is None else np.asarray(clusters.sums[self.row])

    def total(self, clusters: Clusters) -> float:
        """Return the sum of what clusters cost that are left out."""
        return float(np.sum(self.of(clusters) ** 2 * clusters.energies() / clusters.mass**self.power))


def costs(clusters: Clusters, i: Whole, j: Whole, apart: Floats, measures: Sequence[Measure]) -> Floats:
    """Return what it costs to make one cluster of each pair, `apart` the way from i to j (3, n)."""
    own = clusters.energies()
    found = np.empty(len(i))
    for first in range(0, len(i), _CHUNK):
        part = slice(first, first + _CHUNK)
        one, two, d = i[part], j[part], apart[:, part]
        both = clusters.mass[one] + clusters.mass[two]
        a = clusters.mass[one] / both
        b = 1.0 - a
        first_spread, second_spread = clusters.covariances[:, one], clusters.covariances[:, two]
        spread = a * first_spread + b * second_spread + a * b * squares(d)
        mixed = _overlap(first_spread + second_spread, d)
        with_first, with_second = _overlap(first_spread + spread, b * d), _overlap(second_spread + spread, a * d)
        alone = 1.0 / np.sqrt(8.0 * determinant(spread))
        cost = np.zeros(len(one))
        for measure in measures:
            density = measure.of(clusters)
            p, q = density[one], density[two]
            if measure.contrast:
                # Less the mean value of the two.
                p, q = b * p - a * q, a * q - b * p
            change = p * p * own[one] + q * q * own[two] + 2.0 * p * q * mixed
            change += (p + q) * ((p + q) * alone - 2.0 * (p * with_first + q * with_second))
            cost += change / (both**measure.power * measure.scale)
        # Equal kernels at one place cost nothing, but for rounding.
        near = mixed * np.sqrt(determinant(first_spread + second_spread))
        found[part] = np.maximum(cost, 0.0) / np.clip(near / _NEAR, 1.0 / _MOST, 1.0)
    return found
