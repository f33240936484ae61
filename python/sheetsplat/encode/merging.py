"""Fewer kernels for nearly the same field: near ones become one of the same mass, mean place, covariance and value.

Kernels are joined in pairs, those first whose joining changes the field least (`pairs`), until as few are left as are
wanted. Each round finds every kernel's nearest others in a k-d tree, and joins the pairs that are the cheapest of both
their kernels, the cheaper half of them. Integrals of m g and of m (f - b) g are kept exactly.

The change has two parts, each as a share of its whole. Of plain sums, also those of particles, whose x-rays are, they
are the change of the sums, and that of the values as pictures show them, by their decades where they span many, of
which the details of small kernels count most. (Values fitted to the field by least squares afterwards were no closer
anywhere else, and lost mass.) Where sums of values are divided by sums of weights, they are what the
values of a pair differ by, which is all that shows inside the data, and a little of the change of the weights.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sheetsplat import _memory
from sheetsplat._checks import whole
from sheetsplat.errors import complain, unusable
from sheetsplat.fields import EllipsoidField
from sheetsplat.fields.axes import axes_of_frames, frames
from sheetsplat.fields.wrapping import Wrapping
from sheetsplat.look.decades import floor_of

from .pairs import Clusters, Floats, Measure, Whole, costs

# Neighbours of a kernel that are looked at.
_NEIGHBOURS = 3
# Of the pairs that are the cheapest of both their kernels, the share that is joined at once: more join too early.
_SHARE = 0.5
# How much more small kernels count than large ones where details do (Measure.power). Measured: powers from 1.5 to 1.75
# give the closest pictures of particles, 1.5 to 2 the closest fields of trained kernels.
_DETAIL = 1.6
# The share of the weights beside that of the values, where these are divided by them.
_WEIGHTS = 0.01
_NODES = 96
# So many kernels a side of the box of centres stays as it is (_ends) only where the ends are few among the kernels.
_SIDES = 16
_BYTES_OF_KERNEL = 1200
# Least semi-axis of a kernel in its largest.
_FLATTEST = 1e-7


def unit_moments(falloff: float) -> tuple[float, float]:
    """Return the integral of a kernel of the semi-axes 1, and its variance along each: ∫ g and ∫ x² g / ∫ g.

    By Gauss's rule over the radius, to the last digits for every falloff: the closed form cancels for small ones.
    """
    nodes, shares = np.polynomial.legendre.leggauss(_NODES)
    # exp(−k r²) is below the last digit beyond.
    end = min(1.0, 7.0 / np.sqrt(falloff))
    radius, shares = end * (nodes + 1.0) / 2.0, end * shares / 2.0
    profile = (np.expm1(-falloff * radius**2) - np.expm1(-falloff)) / -np.expm1(-falloff)
    second, fourth = float(shares @ (radius**2 * profile)), float(shares @ (radius**4 * profile))
    return 4.0 * np.pi * second, fourth / (3.0 * second)


def _ends(centers: Floats) -> Whole:
    """Return the kernels at the ends of the box of all centres, (3, n): pictures anchor their slices by it."""
    return np.unique(np.concatenate((centers.argmin(axis=1), centers.argmax(axis=1))))


def _clusters(field: EllipsoidField, unit: float) -> tuple[Clusters, list[Measure]]:
    """Return each kernel as a cluster, lengths in a unit, and what is measured of them."""
    from scipy.spatial import cKDTree  # type: ignore[import-untyped]

    falloff, size = field.falloff, field.size
    axes = np.broadcast_to(field.scales[:, None] if field.scales.ndim == 1 else field.scales, (size, 3)) / unit
    turned = np.eye(3)[None] if field.rotations is None else frames(field.rotations)
    shapes = turned * axes[:, None, :]
    spread = unit_moments(falloff)[1] * np.einsum("nij,nkj->nik", shapes, shapes)
    covariances = np.stack([spread[:, i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))])
    weights = np.ones(size) if field.weights is None else field.weights
    # A kernel of weight 0 has a place, but no say.
    weights = np.maximum(weights / weights.max(), np.finfo(np.float64).tiny ** 0.25)
    mass = weights * axes.prod(axis=1)
    floor = floor_of(field)
    values = field.values - field.base
    scale = float(np.abs(values).max()) or 1.0
    shown = values / scale if floor is None else np.log10(np.maximum(field.values, floor) / floor)
    sums = mass * np.stack((values / scale, shown))
    # In the order of a tree near kernels are near in memory.
    order = cKDTree(field.centers).indices
    arrays = (mass[order], field.centers[order].T / unit, covariances[:, order], sums[:, order], order)
    clusters = Clusters(*(np.ascontiguousarray(array) for array in arrays))
    if field.normalization != "threshold" or field.keeps_mass:
        wanted = ((Measure(0, 0.0), 1.0), (Measure(1, _DETAIL), 1.0))
    else:
        wanted = ((Measure(1, 0.0, contrast=True), 1.0), (Measure(None, 0.0), _WEIGHTS))
    measures = [replace(one, scale=total / share) for one, share in wanted if (total := one.total(clusters)) > 0.0]
    # Where all values are the base, the field is known by its weights alone.
    return clusters, measures or [Measure(None, 0.0)]


def _neighbours(centers: Floats, free: Whole, wrapping: Wrapping, unit: float) -> tuple[Whole, Whole, Floats]:
    """Return pairs i < j of near kernels, each once, and the ways between them, (3, pairs)."""
    from scipy.spatial import cKDTree

    sides = wrapping.sides / unit
    box = sides if sides.any() else None
    places = centers[:, free].T
    if wrapping.box is not None:
        lower = np.asarray(wrapping.box[0]) / unit
        places = places - lower
        places = np.where(sides > 0.0, np.mod(places, np.where(sides > 0.0, sides, 1.0)), places)
        places = np.where((sides > 0.0) & (places >= sides), 0.0, places)
    count = min(_NEIGHBOURS + 1, len(free))
    _, near = cKDTree(places, boxsize=box).query(places, k=count)
    one = np.repeat(free, count)
    two = free[near.reshape(-1)]
    i, j = np.minimum(one, two), np.maximum(one, two)
    codes = np.sort((i * centers.shape[1] + j)[i < j])
    codes = codes[np.diff(codes, prepend=-1) > 0]
    i, j = codes // centers.shape[1], codes % centers.shape[1]
    apart = centers[:, j] - centers[:, i]
    if box is not None:
        apart -= sides[:, None] * np.rint(apart / np.where(sides > 0.0, sides, 1.0)[:, None])
    return i, j, apart


def _join(clusters: Clusters, measures: list[Measure], count: int, wrapping: Wrapping, unit: float) -> None:
    """Join clusters until there are so many."""
    ends = _ends(clusters.centers) if count >= _SIDES * 6 else np.empty(0, dtype=np.int64)
    held = np.zeros(len(clusters), dtype=bool)
    held[ends] = True
    while len(clusters) > count:
        size = len(clusters)
        i, j, apart = _neighbours(clusters.centers, np.flatnonzero(~held), wrapping, unit)
        order = np.argsort(costs(clusters, i, j, apart, measures), kind="stable")
        # The rank of each kernel's cheapest pair: pairs that are that of both their kernels have no kernel in common.
        best = np.full(size, len(order))
        np.minimum.at(best, i[order], np.arange(len(order)))
        np.minimum.at(best, j[order], np.arange(len(order)))
        ranks = np.flatnonzero(best[i[order]] == best[j[order]])
        ranks = ranks[: min(size - count, max(1, int(_SHARE * len(ranks))))]
        chosen = order[ranks]
        kept = np.ones(size, dtype=bool)
        kept[j[chosen]] = False
        clusters.joined(i[chosen], j[chosen], apart[:, chosen])
        held = held[kept]


def _field_of(field: EllipsoidField, clusters: Clusters, unit: float) -> EllipsoidField:
    """Return the field of clusters; kernels that are alone stay as they are, to the bit."""
    count = len(clusters)
    xx, yy, zz, xy, xz, yz = clusters.covariances / unit_moments(field.falloff)[1]
    variances, axes = np.linalg.eigh(np.stack((xx, xy, xz, xy, yy, yz, xz, yz, zz), axis=1).reshape(count, 3, 3))
    lengths = np.sqrt(np.maximum(variances, _FLATTEST**2 * variances[:, 2:]))
    scales, rotations = axes_of_frames(axes * lengths[:, None, :], flat=False)
    most = 1.0 if field.weights is None else float(field.weights.max())
    weights = clusters.mass / scales.prod(axis=1) * most
    spread = float(np.abs(field.values - field.base).max()) or 1.0
    values = field.base + clusters.sums[0] / clusters.mass * spread
    # (Rounding leads nowhere beyond the values.)
    values = np.clip(values, field.values.min(), field.values.max())
    scales, centers = scales * unit, clusters.centers.T * unit
    if field.periodic is not None:
        centers = Wrapping(field.periodic).wrapped(centers)
    own = np.flatnonzero(clusters.kernels >= 0)
    kernels = clusters.kernels[own]
    centers[own], values[own] = field.centers[kernels], field.values[kernels]
    scales[own] = field.scales[kernels, None] if field.scales.ndim == 1 else field.scales[kernels]
    rotations[own] = np.eye(4)[0] if field.rotations is None else field.rotations[kernels]
    weights[own] = 1.0 if field.weights is None else field.weights[kernels]
    return field.with_rows(np.ascontiguousarray(centers), scales, rotations, values, weights)


def merged(field: EllipsoidField, count: int) -> EllipsoidField:
    """Return a field of fewer kernels that is nearly the same.

    It has the options of the given one: normalisation, w0, falloff, base, periodic box, orientation and quantity, and
    still keeps mass where that does. Kernels are ellipsoids with weights, whatever they were. The same field gives the
    same kernels.

    Parameters
    ----------
    field
        Without ghost points.
    count
        Of kernels, at least 1. A field that has no more is returned as it is.

    Raises
    ------
    InvalidInput
        For another count, and for a field with ghost points.
    OutOfMemory
        Where the clusters do not fit.
    """
    wanted = whole("merged: count", count, "a whole number above 0")
    if wanted < 1:
        raise complain(unusable("merged: count"), str(wanted), "a whole number above 0")
    if field.ghosts:
        found, advice = f"a field with {field.ghosts} ghost points", "add them after kernels are merged"
        raise complain("kernels cannot be merged", found, "a field without ghost points", advice)
    if field.size <= wanted:
        return field
    _memory.require(_BYTES_OF_KERNEL * field.size, f"clusters of {field.size} kernels", "merge parts of the field")
    # A power of two: worlds that are twice as large have the same clusters.
    unit = float(2.0 ** np.rint(np.log2(np.median(field.scales))))
    clusters, measures = _clusters(field, unit)
    _join(clusters, measures, wanted, Wrapping(field.periodic), unit)
    return _field_of(field, clusters, unit)
