"""Overlapping AMR: volumes in levels of finer and finer cells, of which the finest count, as scattered kernels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sheetsplat.io.axes import settled
from sheetsplat.io.checks import Where, require_rows, unreadable
from sheetsplat.io.records import Floats, Scattered, Volume

# The kernels of cells, as those of volumes: radius in cells, decay. Half of the coarsest level's weights are left on
# the faces of the data, and a little less beside the corners of finer levels: from a quarter on, sums are means. Finer
# kernels weigh more by the ratio of the edges: where levels meet, linear fields are off by half of what they are with
# equal weights, or with those of equal densities.
_RADIUS, _FALLOFF, _MEAN_FROM = 2.0, 5.0, 0.25
# Cells that a face may be off by, as rounding leaves it.
_ROUNDING = 1e-3


def _ends(block: Volume) -> tuple[Floats, Floats]:
    """Return the lower and the upper corner of the cells of a block, along x, y, z."""
    spacing, first = np.asarray(block.spacing), np.asarray(block.origin)
    return first - 0.5 * spacing, first + (np.asarray(block.values.shape[::-1]) - 0.5) * spacing


def _uncovered(block: Volume, lower: Floats, upper: Floats) -> NDArray[np.bool_]:
    """Return which cells of a block, [k, j, i], no finer block covers; their corners: (M, 3) each."""
    shown = np.ones(block.values.shape, bool)
    spacing, first, count = np.asarray(block.spacing), np.asarray(block.origin), np.asarray(shown.shape[::-1])
    # Cells whose middles lie in a finer block.
    begin = np.clip(np.ceil((lower - first) / spacing - _ROUNDING), 0, count).astype(np.int64)
    end = np.clip(np.floor((upper - first) / spacing + _ROUNDING) + 1, 0, count).astype(np.int64)
    for n in np.flatnonzero((begin < end).all(axis=1)):
        i, j, k = (slice(int(a), int(b)) for a, b in zip(begin[n], end[n], strict=True))
        shown[k, j, i] = False
    return shown


def scattered(where: Where, levels: Sequence[Sequence[Volume]], file_format: str) -> Scattered:
    """Return a kernel for each cell that no finer level covers, those of the finest level first.

    Parameters
    ----------
    where, file_format
        The data, for messages, and the format of the result.
    levels
        The blocks of each level, the coarsest first: values of cells, with the places of their middles.

    Raises
    ------
    InvalidInput
        For no block, turned ones, and values of points.
    OutOfMemory
        Where the cells do not fit.
    """
    levels = [[settled(where, one) for one in level] for level in levels]
    blocks = [one for level in levels for one in level]
    if not blocks:
        raise unreadable(where, "no blocks", "at least one")
    if any(one.details.get("scalar of") != "the cells" for one in blocks):
        raise unreadable(where, "values of points", "values of cells, of which the finest are shown")
    if any(one.axes is not None for one in blocks):
        raise unreadable(where, "blocks with turned axes", "axes along those of the world")
    require_rows(where, sum(one.values.size for one in blocks), 8)
    points, values, sizes, counts = [], [], [], []
    lower, upper = np.empty((0, 3)), np.empty((0, 3))
    for level in reversed(levels):
        # Blocks of this level hide coarser ones, not each other.
        ends = [_ends(one) for one in level]
        counts.append(0)
        for block in level:
            k, j, i = np.nonzero(_uncovered(block, lower, upper))
            points.append(np.stack((i, j, k), axis=1) * np.asarray(block.spacing) + np.asarray(block.origin))
            values.append(block.values[k, j, i].astype(np.float64))
            sizes.append(np.broadcast_to(_RADIUS * np.asarray(block.spacing), (len(i), 3)))
            counts[-1] += len(i)
        lower = np.concatenate([lower, *(one[0][None] for one in ends)])
        upper = np.concatenate([upper, *(one[1][None] for one in ends)])
    scales = np.concatenate(sizes)
    edges = np.cbrt(scales.prod(axis=1))
    cubes = bool((scales == scales[:, :1]).all())
    name = blocks[0].quantity.name
    told = ", ".join(f"{count} of level {len(counts) - 1 - n}" for n, count in enumerate(counts))
    return Scattered(
        np.concatenate(points),
        np.concatenate(values),
        name,
        file_format,
        (name,),
        scales=scales[:, 0].copy() if cubes else scales,
        weights=edges.max() / edges if len(edges) else None,
        w0=_MEAN_FROM * _weight(),
        falloff=_FALLOFF,
        details={"cells": told},
    )


def _weight() -> float:
    """Return the sum of weights inside: a kernel's integral over the volume of its cell."""
    from sheetsplat import fit

    return float(fit.Kernels(np.zeros((1, 3)), np.full(1, _RADIUS), np.zeros(1), falloff=_FALLOFF).masses()[0])
