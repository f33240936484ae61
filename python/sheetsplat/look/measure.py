"""Fields as positions with values and volumes, and coarse pictures of them along a view."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.fields import EllipsoidField, RegularField
from sheetsplat.fields.samples import grid_steps

Floats = NDArray[np.float64]

# Positions in each field.
_MOST_KERNELS = 40_000
# Positions in a field of few kernels, several in each.
_FEW = 20_000
# How far from its centre a kernel is looked at, in its semi-axes: there its profile is still above a fiftieth.
_INNER = 0.7
# How far kernels are seen beyond that, in semi-axes: where many overlap their mean is still high.
_RIM = 0.2
# Cells of a coarse picture across, at least so many positions in a cell on average.
_CELLS = 96
_LEAST_CELLS = 12
_PER_CELL = 4.0


def with_values(field: EllipsoidField, values: Floats, **changes: Any) -> EllipsoidField:
    """Return a field of the same kernels with other values, (N,), and some options changed."""
    return field.with_rows(field.centers, field.scales, field.rotations, values, field.weights, **changes)


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
    field = fields[0]
    steps = grid_steps(field.shape, field.lattice)
    picked = np.zeros([])
    for one in fields:
        picked = picked + one.samples.on_grid(steps).astype(np.float64)
    k, j, i = (np.arange(0, size, gap, dtype=np.float64) for size, gap in zip(field.shape, steps, strict=True))
    known = picked.reshape(-1)
    at = np.flatnonzero(~np.isnan(known))
    a, b, c = np.unravel_index(at, picked.shape)
    x, y, z = i[c], j[b], k[a]
    if field.lattice == "bcc":
        shift = 0.5 * (z % 2)
        x, y = x + shift, y + shift
    points = np.asarray(field.origin) + np.stack((x, y, z), axis=1) @ field.steps
    volume = abs(float(np.linalg.det(field.steps))) * math.prod(steps)
    edge = field.spacing[0]
    widths = (edge,) * 3 if field.lattice == "bcc" else field.spacing
    reach = 0.5 * max(gap * width for gap, width in zip(reversed(steps), widths, strict=True))
    return Measure(points, known[at], np.full(len(at), volume), np.full(len(at), reach))


def measure_kernels(field: EllipsoidField, places: int | None = None) -> Measure:
    """Return positions inside the kernels of a field.

    Each kernel has the value at its centre, so that none is missed. With `places`, about as many positions have their
    own values and shares of the volume, so that sums over them are integrals.
    """
    known = field.size - field.ghosts
    most, few = (_MOST_KERNELS, _FEW) if places is None else (places, places)
    picked = np.arange(0, known, max(1, math.ceil(known / most)))
    if field.weights is not None:
        picked = picked[field.weights[picked] > 0]
    centers, scales = field.centers[picked], field.scales[picked]
    # Integrals of the profiles: that of exp(-k r^2) is (pi / k)^(3/2).
    volumes = (scales**3 if scales.ndim == 1 else scales.prod(axis=1)) * (math.pi / field.falloff) ** 1.5
    copies = max(1, math.ceil(few / max(len(picked), 1)))
    shapes = field.native.shapes(picked.astype(np.int64))
    spread = [centers + np.einsum("nij,nj->ni", shapes, inner) for inner in _directions(copies, len(picked))]
    points = np.concatenate(spread)
    longest = scales if scales.ndim == 1 else scales.max(axis=1)
    # Where kernels overlap, each stands for its share of the sum of weights, and so of the volume.
    where = points if places else centers
    heights = np.ones(len(picked)) if field.weights is None else field.weights[picked]
    values, sums = field.scalars_and_weights(where)
    if not places:
        sums, values = np.tile(sums, copies), np.tile(values, copies)
    shares = np.minimum(1.0, np.tile(heights, copies) / np.maximum(sums, 1e-300))
    volumes = np.tile(volumes * (known / max(len(picked), 1) / copies), copies) * shares
    return Measure(points, values, volumes, np.tile(_RIM * longest, copies))


def _directions(copies: int, count: int) -> Iterator[Floats]:
    """Yield `copies` times `count` positions in the inner part of the unit sphere, the same ones in every call."""
    generator = np.random.default_rng(2006)
    for _ in range(copies):
        found = generator.normal(size=(count, 3))
        yield found * (_INNER * generator.random(count) ** (1 / 3) / np.linalg.norm(found, axis=1))[:, np.newaxis]


def coarse_picture(places: Floats, weights: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Return sums of weights over the area of a cell, in a picture of square cells, and the cell of each position.

    Parameters
    ----------
    places
        Positions in the picture, (N, 2), world units; their box is the picture.
    weights
        (N,). Of optical depths times volumes the sums are optical depths of rays.

    Returns
    -------
    picture
        (columns, rows).
    cells
        Column and row of each position, (N, 2).
    """
    low = places.min(axis=0)
    extent = np.maximum(np.ptp(places, axis=0), 1e-12 * float(np.abs(places).max(initial=1e-280)))
    count = int(np.clip(math.sqrt(len(places) / _PER_CELL), _LEAST_CELLS, _CELLS))
    shape = np.maximum(1, np.ceil(count * extent / extent.max())).astype(int)
    cells = np.minimum((places - low) / extent * shape, shape - 1).astype(np.int64)
    sums = np.bincount(cells[:, 0] * shape[1] + cells[:, 1], weights, int(shape.prod()))
    # Of places in one point, or in a line, the depths of rays are not known, and are no numbers.
    with np.errstate(over="ignore", invalid="ignore"):
        return sums.reshape(shape) * float((shape / extent).prod()), cells
