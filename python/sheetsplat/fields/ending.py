"""Where lattices of samples end, and where kernels add up to enough, by what they are made of."""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import Bounds, Triple

Axes = tuple[Triple, Triple, Triple]

#: Beyond the outermost samples the domain goes on for this part of a layer's distance.
DOMAIN = 0.5


def ends(shape: tuple[int, int, int], lattice: str, boundary: str) -> bool:
    """Return whether a volume ends at its boundary, with mirrored samples beyond."""
    return boundary == "edge" and not (lattice == "bcc" and shape[0] < 2)


def layer_spacing(lattice: str, spacing: Triple) -> Triple:
    """Return world units from one layer of samples to the next along x, y, z: half an edge of a BCC lattice."""
    return (0.5 * spacing[0],) * 3 if lattice == "bcc" else spacing


def layer_counts(shape: tuple[int, int, int], lattice: str) -> tuple[int, int, int]:
    """Return the number of layers of samples along x, y, z."""
    nk, nj, ni = shape
    return (2 * ni, 2 * nj, nk) if lattice == "bcc" else (ni, nj, nk)


def steps(lattice: str, spacing: Triple, axes: Axes | None = None) -> NDArray[np.float64]:
    """Return the steps of i, j and k in the world, the rows of (3, 3)."""
    if axes is not None:
        return np.array(axes)
    a = spacing[0]
    return np.diag((a, a, 0.5 * a) if lattice == "bcc" else spacing)


def heights(steps: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the distances of opposite faces of a cell, (3,), and the unit normals of the faces, (3, 3), as rows."""
    across = np.linalg.inv(steps).T
    lengths = np.linalg.norm(across, axis=1)
    return 1.0 / lengths, across / lengths[:, None]


def domain(
    shape: tuple[int, int, int],
    lattice: str,
    boundary: str,
    spacing: Triple,
    origin: Triple,
    axes: Axes | None = None,
) -> Bounds | None:
    """Return the box around where a volume ends, its lower and its upper corner; None: nowhere."""
    if not ends(shape, lattice, boundary):
        return None
    if axes is not None:
        # Each step moves the corners by its own coordinates, up or down.
        first = np.asarray(origin) - DOMAIN * np.sum(axes, axis=0)
        moved = np.multiply(axes, np.reshape(shape[::-1], (3, 1)))
        corners = first + np.minimum(moved, 0.0).sum(axis=0), first + np.maximum(moved, 0.0).sum(axis=0)
        return cast(Bounds, tuple(tuple(map(float, corner)) for corner in corners))
    layer = layer_spacing(lattice, spacing)
    beyond = [DOMAIN * step for step in layer]
    last = [(count - 1) * step for count, step in zip(layer_counts(shape, lattice), layer, strict=True)]
    lower = tuple(o - more for o, more in zip(origin, beyond, strict=True))
    upper = tuple(o + far + more for o, far, more in zip(origin, last, beyond, strict=True))
    return cast(Bounds, (lower, upper))


def unit_radius(radius: float, lattice: str) -> float:
    """Return a support's radius in the unit in which all samples lie at whole numbers: for BCC a/2."""
    return radius * math.sqrt(2.0) if lattice == "bcc" else radius


def lattice_constant(radius: float, falloff: float, lattice: str = "cartesian") -> float:
    """Return C, the mean sum of weights: the kernel's integral over a sample's volume. Conventions, section 2."""
    edge = math.exp(-falloff)
    bell = math.sqrt(math.pi) * math.erf(math.sqrt(falloff)) / (4.0 * math.pow(falloff, 1.5))
    squares = bell - edge / (2.0 * falloff)
    ball = 4.0 * math.pi * (squares - edge / 3.0) / (1.0 - edge)
    # In units of a/2 a sample of a BCC lattice stands for half of 2^3.
    size = unit_radius(radius, lattice)
    return ball * size * size * size / (4.0 if lattice == "bcc" else 1.0)


def least_weight(radius: float, falloff: float, lattice: str) -> float:
    """Return the sum of weights below which points beside missing samples are empty."""
    return 0.5 * lattice_constant(radius, falloff, lattice)
