"""Volumes from formulas: Marschner and Lobb's signal, a noisy ball, thin tubes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat.errors import complain

from ._dataset import Dataset, Vector, require_samples
from .random_stream import Stream


def marschner_lobb_value(
    x: ArrayLike, y: ArrayLike, z: ArrayLike, *, f_m: float = 6.0, alpha: float = 0.25
) -> NDArray[np.float64]:
    """Return Marschner and Lobb's signal (1994, section 4), 0 to 1, at points of any shape.

    Parameters
    ----------
    x, y, z
        Coordinates; the signal is defined on [-1, 1]^3.
    f_m
        Its frequency.
    alpha
        The strength of its waves.

    Examples
    --------
    >>> float(ss.datasets.marschner_lobb_value(0, 0, 0))
    0.6
    """
    x, y, z = (np.asarray(c, dtype=np.float64) for c in (x, y, z))
    radius = np.hypot(x, y)
    wave = np.cos(2.0 * np.pi * f_m * np.cos(0.5 * np.pi * radius))
    return np.asarray((1.0 - np.sin(0.5 * np.pi * z) + alpha * (1.0 + wave)) / (2.0 * (1.0 + alpha)))


def marschner_lobb_gradient(
    x: ArrayLike, y: ArrayLike, z: ArrayLike, *, f_m: float = 6.0, alpha: float = 0.25
) -> NDArray[np.float64]:
    """Return the gradient of :func:`marschner_lobb_value`, with the components x, y, z along a new last axis.

    Examples
    --------
    >>> ss.datasets.marschner_lobb_gradient(0.1, [0.2, 0.3], 0.0).shape
    (2, 3)
    """
    x, y, z = np.broadcast_arrays(*(np.asarray(c, dtype=np.float64) for c in (x, y, z)))
    radius = np.hypot(x, y)
    # d wave / d radius over the radius; sinc(t) = sin(pi t) / (pi t) keeps it finite on the axis.
    slope = 0.5 * np.pi**3 * f_m * np.sinc(0.5 * radius) * np.sin(2.0 * np.pi * f_m * np.cos(0.5 * np.pi * radius))
    gradient = np.stack([alpha * slope * x, alpha * slope * y, -0.5 * np.pi * np.cos(0.5 * np.pi * z)], axis=-1)
    return np.asarray(gradient / (2.0 * (1.0 + alpha)))


def marschner_lobb(
    n: int = 128, f_m: float = 6.0, alpha: float = 0.25, *, lattice: str = "cartesian", dtype: Any = np.float32
) -> Dataset:
    """Return Marschner and Lobb's test signal on [-1, 1]^3.

    Its value and gradient are known everywhere: :func:`marschner_lobb_value`, :func:`marschner_lobb_gradient`.

    Parameters
    ----------
    n
        Samples along each axis of the Cartesian lattice, its ends included; at least 2.
    f_m, alpha
        Frequency and strength of the waves.
    lattice
        ``"cartesian"``, or ``"bcc"`` for the signal at the points of the BCC lattice of equal quality (the one that
        :func:`sheetsplat.bcc.resample_to_bcc` makes of the Cartesian one), about n^3 / sqrt(2) samples.
    dtype
        Type of the samples, float32 unless given.

    Examples
    --------
    >>> ss.datasets.marschner_lobb(16).shape
    (16, 16, 16)
    """
    require_samples("marschner_lobb", n, 2)
    spacing = 2.0 / (n - 1)
    if lattice == "cartesian":
        x = np.linspace(-1.0, 1.0, n)
        values = marschner_lobb_value(x, x[:, None], x[:, None, None], f_m=f_m, alpha=alpha)
        distances: Vector = (spacing, spacing, spacing)
        origin: Vector = (-1.0, -1.0, -1.0)
    elif lattice == "bcc":
        from sheetsplat.bcc import BccLattice

        grid = BccLattice.matching((n, n, n), (spacing,) * 3, (-1.0, -1.0, -1.0))
        values = np.empty(grid.shape)
        for k in range(grid.shape[0]):
            x, y, z = grid.layer(k)
            values[k] = marschner_lobb_value(x, y[:, None], z, f_m=f_m, alpha=alpha)
        distances, origin = (grid.a,) * 3, grid.origin
    else:
        raise complain("the data set marschner_lobb cannot be made", f"lattice {lattice!r}", "'cartesian' or 'bcc'")
    return Dataset(
        name="marschner_lobb" if lattice == "cartesian" else "marschner_lobb_bcc",
        values=values.astype(dtype),
        spacing=distances,
        origin=origin,
        lattice=lattice,
        description=f"Marschner and Lobb's signal, frequency {f_m:g}, strength {alpha:g}, from its formula.",
        suggested={
            "clim": (0.0, 1.0),
            "mode": "isosurface",
            "iso_value": 0.5,
            "points": [(0.0, 0.9, 0.55, 0.2, 0.0), (0.45, 0.9, 0.55, 0.2, 0.0), (1.0, 0.95, 0.9, 0.8, 0.5)],
        },
    )


def noisy_ball(n: int = 128, seed: int = 2005) -> Dataset:
    """Return a ball with noise in it, 8 bits: at n = 128, 480,000 samples of 2,097,152 are not 0.

    For benchmarks: a dense volume with gradients in all directions.

    Parameters
    ----------
    n
        Samples along each axis; the ball's diameter is 0.76 n.
    seed
        Seed of the noise.

    Examples
    --------
    >>> ss.datasets.noisy_ball(16).values.dtype
    dtype('uint8')
    """
    require_samples("noisy_ball", n, 1)
    # A ball of this radius holds 480,000 of 128^3 samples.
    radius = n * float(np.cbrt(480_000 / 128**3 * 3.0 / (4.0 * np.pi)))
    squares = (np.arange(n) - 0.5 * (n - 1)) ** 2
    values = np.empty((n, n, n), np.uint8)
    stream = Stream(seed)
    for k in range(n):
        share = (squares[k] + squares[:, None] + squares[None, :]) / radius**2
        grey = 190.0 - 90.0 * share + 60.0 * (stream.uniform(n, n) - 0.5)
        values[k] = np.where(share <= 1.0, np.rint(grey), 0.0).astype(np.uint8)
    return Dataset(
        "noisy_ball",
        values,
        description="A ball of falling density with uniform noise, 8 bits.",
        suggested={
            "clim": (0.0, 220.0),
            "points": [(0.0, 0.2, 0.3, 0.6, 0.0), (40.0, 0.2, 0.3, 0.6, 0.0), (220.0, 1.0, 0.85, 0.6, 0.08)],
        },
    )


def tubes(n: int = 128, seed: int = 2005) -> Dataset:
    """Return thin branching tubes with a bulge, like vessels with an aneurism, 8 bits.

    At n = 128, 17,000 samples are not 0.

    Parameters
    ----------
    n
        Samples along each axis, at least 16.
    seed
        Seed of the branching.

    Examples
    --------
    >>> image = ss.render(ss.datasets.tubes(24), size=(32, 32))
    """
    require_samples("tubes", n, 16)
    nearness = np.full((n, n, n), np.inf, np.float32)
    for start, end, radius in _branches(seed):
        _add_capsule(nearness, start, end, radius)
    # The count of samples in tubes is exact: those nearest to a tube's axis, in units of its radius.
    count = round(17_000 * (n / 128) ** 3)
    edge = float(np.partition(nearness, count, axis=None)[count])
    inside = nearness < edge
    share = nearness[inside] / edge
    values = np.zeros((n, n, n), np.uint8)
    values[inside] = np.rint(255.0 - 175.0 * share * share)
    return Dataset(
        "tubes",
        values,
        description="Thin branching tubes with a bulge, 8 bits.",
        stand_in_for="Aneurism, 128^3, of the 2005 paper, where that is not at hand",
        suggested={
            "clim": (0.0, 255.0),
            "points": [(0.0, 0.6, 0.1, 0.1, 0.0), (60.0, 0.6, 0.1, 0.1, 0.0), (200.0, 1.0, 0.5, 0.35, 0.6)],
        },
    )


Capsule = tuple[NDArray[np.float64], NDArray[np.float64], float]


def _branches(seed: int) -> list[Capsule]:
    """Return pieces of the tubes: two ends (x, y, z, in a cube of edge 1) and a radius."""
    stream = Stream(seed)
    pieces: list[Capsule] = []

    def grow(point: NDArray[np.float64], way: NDArray[np.float64], radius: float, length: float, depth: int) -> None:
        steps = 6
        for _ in range(steps):
            way = way + 0.28 * stream.normal(3)
            # Tubes turn back before they reach the wall.
            way = way - 3.5 * np.clip(np.abs(point - 0.5) - 0.24, 0.0, None) * np.sign(point - 0.5)
            way = way / np.linalg.norm(way)
            end = np.clip(point + way * (length / steps), 0.06, 0.94)
            pieces.append((point, end, radius))
            point = end
        # The one bulge is where a tube of medium width forks.
        if depth == 3 and not any(r > 0.04 for _, _, r in pieces):
            pieces.append((point, point, 0.055))
        if depth == 0:
            return
        aside = np.cross(way, stream.normal(3))
        aside = aside / max(float(np.linalg.norm(aside)), 1e-9)
        for side in (1.0, -1.0):
            spread = 0.5 + 0.5 * float(stream.uniform(1)[0])
            grow(point, way + side * spread * aside, 0.8 * radius, 0.88 * length, depth - 1)

    grow(np.array([0.5, 0.06, 0.5]), np.array([0.0, 1.0, 0.0]), 0.018, 0.27, 5)
    return pieces


def _add_capsule(
    nearness: NDArray[np.float32], start: NDArray[np.float64], end: NDArray[np.float64], radius: float
) -> None:
    """Lower `nearness` to the distance from the piece start-end over `radius`, near the piece."""
    n = len(nearness)
    start, end = start * (n - 1), end * (n - 1)
    wide = radius * n
    reach = 2.0 * wide + 1.0
    lower = np.maximum(np.floor(np.minimum(start, end) - reach), 0).astype(int)
    upper = np.minimum(np.ceil(np.maximum(start, end) + reach), n - 1).astype(int)
    x, y, z = (np.arange(lower[c], upper[c] + 1, dtype=np.float64) - start[c] for c in range(3))
    y, z = y[:, None], z[:, None, None]
    axis = end - start
    along = x * axis[0] + y * axis[1] + z * axis[2]
    along = np.clip(along / max(float(axis @ axis), 1e-12), 0.0, 1.0)
    square = (x - along * axis[0]) ** 2 + (y - along * axis[1]) ** 2 + (z - along * axis[2]) ** 2
    box = tuple(slice(lower[c], upper[c] + 1) for c in (2, 1, 0))
    nearness[box] = np.minimum(nearness[box], (np.sqrt(square) / wide).astype(np.float32))
