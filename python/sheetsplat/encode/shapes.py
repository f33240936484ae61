"""Shapes of ellipsoids as six numbers that may be rounded: coordinates of the logarithm of the shape matrix.

An ellipsoid with the semi-axes s and the directions A (columns) has the symmetric matrix L = A diag(log s) Aᵀ. The
order and the signs of the axes are not in it, nearly round ellipsoids have matrices that are nearly diagonal however
they are turned, and an error of L is an error of lengths relative to the lengths, so that one step serves all six
numbers. They are coordinates in an orthonormal basis: the mean size, two of the diagonal, three beside it. Ellipsoids
that are not turned have the first three, spheres the first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sheetsplat.fields.axes import axes_of_frames, frames

Floats = NDArray[np.float64]

# Largest norm of L, so that semi-axes are from e^-400 to e^400, about 1e174.
_LARGEST = 400.0
SPHERES, STRAIGHT, TURNED = 1, 3, 6

_R2, _R3, _R6 = 2.0**-0.5, 3.0**-0.5, 6.0**-0.5
# Basis of symmetric matrices, each of the norm 1.
_BASIS = np.array(
    [
        [[_R3, 0, 0], [0, _R3, 0], [0, 0, _R3]],
        [[_R2, 0, 0], [0, -_R2, 0], [0, 0, 0]],
        [[_R6, 0, 0], [0, _R6, 0], [0, 0, -2 * _R6]],
        [[0, _R2, 0], [_R2, 0, 0], [0, 0, 0]],
        [[0, 0, _R2], [0, 0, 0], [_R2, 0, 0]],
        [[0, 0, 0], [0, 0, _R2], [0, _R2, 0]],
    ]
)


def coordinates(scales: Floats, rotations: Floats | None) -> Floats:
    """Return the coordinates of shapes, (N, 1) of spheres, (N, 3) or (N, 6) of ellipsoids that are turned."""
    logs = np.log(scales)
    if scales.ndim == 1:
        return np.asarray(logs[:, None] / _R3)
    if rotations is None:
        return np.asarray(np.einsum("ni,cii->nc", logs, _BASIS[:STRAIGHT]))
    axes = frames(rotations)
    return np.asarray(np.einsum("nij,nj,nkj,cik->nc", axes, logs, axes, _BASIS, optimize=True))


def shapes(found: Floats) -> tuple[Floats, Floats | None] | None:
    """Return scales and rotations of coordinates; None where a semi-axis would be no float64."""
    if not (np.linalg.norm(found, axis=1) <= _LARGEST).all():
        return None
    kind = found.shape[1]
    if kind == SPHERES:
        return np.exp(found[:, 0] * _R3), None
    if kind == STRAIGHT:
        return np.exp(np.einsum("nc,cii->ni", found, _BASIS[:STRAIGHT])), None
    logs, axes = np.linalg.eigh(np.einsum("nc,cij->nij", found, _BASIS))
    return axes_of_frames(axes * np.exp(logs)[:, None, :], flat=False)
