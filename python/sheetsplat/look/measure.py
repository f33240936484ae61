"""Fields as positions with values and volumes: what histograms and coarse pictures are made of."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sheetsplat.fields import EllipsoidField, RegularField

Floats = NDArray[np.float64]

# Positions in each field.
_MOST = 400_000
_MOST_KERNELS = 40_000
# Positions in a field of few kernels, several in each.
_FEW = 20_000
# How far from its centre a kernel is looked at, in its semi-axes: there its profile is still above a fiftieth.
_INNER = 0.7
# How far kernels are seen beyond that, in semi-axes: where many overlap their mean is still high.
_RIM = 0.2


@dataclass(frozen=True)
class Measure:
    """Positions in a field, each with its value and the volume that it stands for.

    Attributes
    ----------
    points
        (N, 3), world units.
    values, volumes
        (N,); volumes in world units.
    reaches
        (N,), how far what the positions stand for reaches beyond them, world units.
    """

    points: Floats
    values: Floats
    volumes: Floats
    reaches: Floats


def measure_volumes(fields: Sequence[RegularField]) -> Measure:
    """Return every n-th sample along each axis, as many as are needed, of the sum of fields on one lattice."""
    field, values = fields[0], fields[0].values
    step = max(1, math.ceil((values.size / _MOST) ** (1 / 3)))
    steps = [min(step, size) for size in values.shape]
    if field.lattice == "bcc":
        # Every second layer is shifted.
        steps[0] |= 1
    picked = np.zeros([])
    for one in fields:
        picked = picked + one.values[:: steps[0], :: steps[1], :: steps[2]].astype(np.float64)
    k, j, i = (np.arange(0, size, gap, dtype=np.float64) for size, gap in zip(values.shape, steps, strict=True))
    known = picked.reshape(-1)
    at = np.flatnonzero(~np.isnan(known))
    a, b, c = np.unravel_index(at, picked.shape)
    dx, dy, dz = field.spacing
    x, y, z = i[c], j[b], k[a]
    if field.lattice == "bcc":
        shift = 0.5 * (z % 2)
        x, y, z = x + shift, y + shift, 0.5 * z
        dy = dz = dx
    points = np.asarray(field.origin) + np.stack((x, y, z), axis=1) * (dx, dy, dz)
    volume = dx * dy * dz * math.prod(steps) * (0.5 if field.lattice == "bcc" else 1.0)
    reach = 0.5 * max(gap * width for gap, width in zip(steps, (dz, dy, dx), strict=True))
    return Measure(points, known[at], np.full(len(at), volume), np.full(len(at), reach))


def measure_kernels(field: EllipsoidField) -> Measure:
    """Return positions inside the kernels of a field; each kernel has the value at its centre."""
    known = field.size - field.ghosts
    picked = np.arange(0, known, max(1, math.ceil(known / _MOST_KERNELS)))
    if field.weights is not None:
        picked = picked[field.weights[picked] > 0]
    centers, scales = field.centers[picked], field.scales[picked]
    # Integrals of the profiles: that of exp(-k r^2) is (pi / k)^(3/2).
    volumes = (scales**3 if scales.ndim == 1 else scales.prod(axis=1)) * (math.pi / field.falloff) ** 1.5
    # Where many kernels overlap, each stands for its share of the volume.
    crowd = np.maximum(1.0, field.weight_at(centers) / max(field.weight_range[1], 1e-300))
    volumes = volumes / crowd * (known / max(len(picked), 1))
    copies = max(1, math.ceil(_FEW / max(len(picked), 1)))
    shapes = field.native.shapes(picked.astype(np.int64))
    points = [centers + np.einsum("nij,nj->ni", shapes, inner) for inner in _directions(copies, len(picked))]
    longest = scales if scales.ndim == 1 else scales.max(axis=1)
    return Measure(
        np.concatenate(points),
        np.tile(field.at(centers), copies),
        np.tile(volumes / copies, copies),
        np.tile(_RIM * longest, copies),
    )


def _directions(copies: int, count: int) -> Iterator[Floats]:
    """Yield `copies` times `count` positions in the inner part of the unit sphere, the same ones in every call."""
    generator = np.random.default_rng(2006)
    for _ in range(copies):
        found = generator.normal(size=(count, 3))
        yield found * (_INNER * generator.random(count) ** (1 / 3) / np.linalg.norm(found, axis=1))[:, np.newaxis]
