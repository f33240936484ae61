"""Fields and their kernels (section 2), relative to the eye."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_erf = np.vectorize(math.erf, otypes=[float])
_erfc = np.vectorize(math.erfc, otypes=[float])


def erf_between(x0: Array, x1: Array) -> Array:
    """Return erf(x1) - erf(x0), of which far from 0 hardly a digit would be left; SciPy's, which is quicker, if any."""
    try:
        from scipy.special import erf, erfc
    except ImportError:
        erf, erfc = _erf, _erfc
    return np.select(
        [x0 > 0, x1 < 0], [np.subtract(erfc(x0), erfc(x1)), np.subtract(erfc(-x1), erfc(-x0))], erf(x1) - erf(x0)
    )


# Of lattices that are not told where they end: what the package does with them.
DEFAULT_BOUNDARY = "edge"
# The points x with lower <= to_box x <= upper.
Box = tuple[Array, Array, Array]


@dataclass
class RegularField:
    """Samples values[k, j, i] of a Cartesian or BCC lattice."""

    values: ArrayLike
    spacing: Sequence[float] = (1, 1, 1)
    origin: Sequence[float] = (0, 0, 0)
    lattice: str = "cartesian"
    radius: float = 2.0
    falloff: float = 5.0
    normalization: str = "lattice"
    w0: float = 1.0
    nan: str = "error"
    boundary: str | None = None  # edge | zero
    base: float | None = None
    axes: ArrayLike | None = None  # rows: the steps of i, j, k

    def ends(self) -> bool:
        """Return whether the lattice ends, and has mirrored samples beyond its outermost ones."""
        values = np.asarray(self.values, float)
        one_layer = self.lattice == "bcc" and values.shape[0] < 2
        return (self.boundary or DEFAULT_BOUNDARY) == "edge" and not one_layer and not np.isnan(values).all()

    def counted_from(self) -> float:
        """Return b."""
        if self.base is not None:
            return float(self.base)
        values = np.asarray(self.values, float)
        values = values[~np.isnan(values)]
        if not self.ends() or self.normalization == "none":
            return 0.0
        if 100 * np.count_nonzero(values == values[0]) >= len(values):
            return float(values[0])
        return float(values.min() / 2 + values.max() / 2)

    def layers(self) -> tuple[Array, Array]:
        """Return samples [z, y, x] on a grid of all layers, NaN where there is none, and the steps of layers as rows.

        Of BCC lattices, layers are half an edge apart along all axes.
        """
        values = np.asarray(self.values, float)
        if self.lattice != "bcc":
            return values, np.diag(np.asarray(self.spacing, float)) if self.axes is None else np.asarray(
                self.axes, float
            )
        nk, nj, ni = values.shape
        grid = np.full((nk, 2 * nj, 2 * ni), np.nan)
        grid[0::2, 0::2, 0::2] = values[0::2]
        grid[1::2, 1::2, 1::2] = values[1::2]
        # A lattice of one layer has no odd ones.
        return (grid if nk > 1 else grid[:, :-1, :-1]), np.eye(3) * float(self.spacing[0]) / 2

    def domain(self) -> Box | None:
        """Return where the lattice ends: half a layer's distance beyond the outermost layers."""
        if not self.ends():
            return None
        grid, steps = self.layers()
        origin, last = np.asarray(self.origin, float), np.array(grid.shape[::-1]) - 0.5
        if self.axes is None:
            apart = np.diag(steps)
            return origin - apart / 2, origin + last * apart, np.eye(3)
        to_box = np.linalg.inv(steps.T)
        return to_box @ origin - 0.5, to_box @ origin + last, to_box

    def kernels(self, *, mirrored: bool = True) -> tuple[Array, Array]:
        """Return the centres (N, 3) in world units without the origin, and f - b (N,)."""
        grid, steps = self.layers()
        counts = np.array(grid.shape)
        radius = self.radius * (math.sqrt(2) if self.lattice == "bcc" else 1)
        more = math.ceil(radius + 0.5) if mirrored and self.ends() else 0
        for axis, count in enumerate(grid.shape):
            width = [(0, 0)] * 3
            width[axis] = (more, more)
            grid = np.pad(grid, width, mode="reflect" if count > 1 else "edge")
        z, y, x = np.meshgrid(*(np.arange(n, dtype=float) - more for n in grid.shape), indexing="ij")
        place = np.stack([x, y, z], -1)
        kept = ~np.isnan(grid)
        if more:
            # Distances to the domain, in layers: supports are open balls there, so that those that only touch stay out.
            beyond = np.maximum(0, np.maximum(-0.5 - place, place - (counts[::-1] - 0.5)))
            kept &= (beyond**2).sum(-1) < self.radius**2 * (2 if self.lattice == "bcc" else 1)
        return place[kept] @ steps, grid[kept] - self.counted_from()

    def least_weight(self) -> float:
        """Return the W below which a point is empty."""
        holes = self.ends() and self.normalization == "lattice" and bool(np.isnan(np.asarray(self.values, float)).any())
        return self.mass() / 2 if holes else 0.0

    def range(self) -> float:
        """Return the largest difference of two values."""
        values = np.asarray(self.values, float)
        return float(np.nanmax(values) - np.nanmin(values)) if not np.isnan(values).all() else 0.0

    def anchors(self, eye: Array) -> Array:
        """Return the centres of the samples that were given (N, 3), relative to the eye."""
        return self.kernels(mirrored=False)[0] + (np.asarray(self.origin, float) - eye)

    def shape(self) -> Array:
        """Return M of the kernels, (3, 3)."""
        if self.lattice == "bcc":
            return np.eye(3) * self.radius * float(self.spacing[0]) / math.sqrt(2)
        return self.radius * self.layers()[1].T

    def sample_volume(self) -> float:
        """Return the volume per sample."""
        if self.lattice == "bcc":
            return float(self.spacing[0]) ** 3 / 2
        return abs(float(np.linalg.det(self.layers()[1])))

    def default_slice_spacing(self) -> float:
        """Return the default distance of slices (section 3)."""
        if self.axes is None:
            return float(self.spacing[0]) / 2 if self.lattice == "bcc" else float(min(self.spacing))
        i, j, k = np.asarray(self.axes, float)
        faces = (np.cross(j, k), np.cross(k, i), np.cross(i, j))
        return min(self.sample_volume() / float(np.linalg.norm(face)) for face in faces)

    def mass(self) -> float:
        """Return C of normalisation lattice: a kernel's integral over the volume per sample."""
        return ball_integral(self.falloff) * abs(float(np.linalg.det(self.shape()))) / self.sample_volume()

    def placed(self, eye: Array, turn: Array) -> Kernels:
        """Return the kernels in eye space."""
        centres, values = self.kernels()
        # Relative to the eye from the start, so that far origins cost no digits.
        offset = centres + (np.asarray(self.origin, float) - eye)
        factor = turn @ self.shape()
        return Kernels(offset, offset @ turn.T, factor[None], np.linalg.inv(factor)[None], values, None)


@dataclass
class EllipsoidField:
    """Scattered kernels: centers (N, 3), semi-axes (N, 3) or (N,), rotations (N, 4) w, x, y, z or (N, 3, 3)."""

    centers: ArrayLike
    scales: ArrayLike
    rotations: ArrayLike | None = None
    values: ArrayLike = ()
    weights: ArrayLike | None = None
    normalization: str = "threshold"
    w0: float = 1.0
    falloff: float = 8.0
    min_scale: float | None = None
    cell_volume: float | None = None
    base: float = 0.0

    def counted_from(self) -> float:
        """Return b."""
        return float(self.base)

    def domain(self) -> Box | None:
        """Return nothing: scattered kernels end nowhere."""
        return None

    def least_weight(self) -> float:
        """Return the W below which a point is empty."""
        return 0.0

    def range(self) -> float:
        """Return the largest difference of two values."""
        values = np.asarray(self.values, float)
        return float(np.ptp(values)) if len(values) else 0.0

    def anchors(self, eye: Array) -> Array:
        """Return the centres (N, 3) relative to the eye."""
        return np.asarray(self.centers, float).reshape(-1, 3) - eye

    def semi_axes(self) -> Array:
        """Return the semi-axes of every kernel, (N, 3)."""
        scales = np.asarray(self.scales, float)
        if scales.ndim == 1:
            scales = np.repeat(scales[:, None], 3, 1)
        return scales if self.min_scale is None else np.maximum(scales, self.min_scale)

    def frames(self) -> Array:
        """Return the rotations from the kernels' own axes to the world's, (N, 3, 3)."""
        count = len(np.asarray(self.centers, float))
        if self.rotations is None:
            return np.tile(np.eye(3), (count, 1, 1))
        rotations = np.asarray(self.rotations, float)
        return rotations if rotations.ndim == 3 else turned(rotations)

    def default_slice_spacing(self) -> float:
        """Return the default distance of slices (section 3); without kernels there is none."""
        centres = np.asarray(self.centers, float).reshape(-1, 3)
        if len(centres) == 0:
            return math.inf
        diagonal = float(np.linalg.norm(centres.max(0) - centres.min(0)))
        return max(float(np.median(self.semi_axes().min(1))) / 2, diagonal / 2048)

    def mass(self) -> float:
        """Return C of normalisation lattice: a kernel's integral over the volume that it stands for."""
        volume = float(np.prod(self.semi_axes(), axis=1).max())
        return ball_integral(self.falloff) * volume / float(self.cell_volume or math.nan)

    def placed(self, eye: Array, turn: Array) -> Kernels:
        """Return the kernels in eye space."""
        world = np.asarray(self.centers, float).reshape(-1, 3) - eye
        semi, frames = self.semi_axes(), self.frames()
        weights = None if self.weights is None else np.asarray(self.weights, float)
        return Kernels(
            world,
            world @ turn.T,
            turn @ frames * semi[:, None, :],
            np.swapaxes(frames, 1, 2) @ turn.T / semi[:, :, None],
            np.asarray(self.values, float) - self.base,
            weights,
        )


def turned(quaternions: Array) -> Array:
    """Return the rotation matrices of quaternions w, x, y, z, (N, 3, 3): the columns are the turned axes."""
    w, x, y, z = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    return np.stack(
        [
            np.stack([w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
            np.stack([2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)], -1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z], -1),
        ],
        -2,
    )


@dataclass
class Kernels:
    """Kernels of one field relative to the eye. Shapes have a first axis of length N, or 1 where all are alike."""

    world: Array  # (N, 3) centres, world axes
    centres: Array  # (N, 3) eye axes
    factor: Array  # (N | 1, 3, 3) B: unit sphere to eye axes
    to_sphere: Array  # (N | 1, 3, 3) its inverse
    values: Array  # (N,) f - b
    weights: Array | None  # (N,), 1 unless given

    def reach(self) -> Array:
        """Return how far the supports extend in depth, (N,)."""
        return np.broadcast_to(np.linalg.norm(self.factor[:, 2], axis=1), (len(self.centres),))

    def scaled(self, by: float) -> Kernels:
        """Return the kernels with supports larger by that factor."""
        return replace(self, factor=self.factor * by, to_sphere=self.to_sphere / by)

    def filtered(self, pixel: Array, spacing: float, falloff: float) -> Kernels:
        """Return the kernels after the EWA filter (section 10); pixel (N,) is its width at the centres' depths."""
        # The radius of a support is the square root of 2 k standard deviations; those of the filter are one half.
        half = math.sqrt(2 * falloff) / 2
        count = len(self.centres)
        factor = np.broadcast_to(self.factor, (count, 3, 3))
        widening = np.zeros((count, 3, 3))
        widening[:, 0, 0] = widening[:, 1, 1] = half * pixel
        widening[:, 2, 2] = half * spacing
        upper = np.linalg.qr(np.concatenate([np.swapaxes(factor, 1, 2), widening], 1), mode="r")
        share = np.abs(np.linalg.det(factor) / np.prod(np.diagonal(upper, axis1=1, axis2=2), axis=1))
        weights = share if self.weights is None else self.weights * share
        wider = np.swapaxes(upper, 1, 2)
        return replace(self, factor=wider, to_sphere=np.linalg.inv(wider), weights=weights)

    def picked(self, which: Mask) -> Kernels:
        """Return some of the kernels."""
        alike = len(self.factor) == 1
        return Kernels(
            self.world[which],
            self.centres[which],
            self.factor if alike else self.factor[which],
            self.to_sphere if alike else self.to_sphere[which],
            self.values[which],
            None if self.weights is None else self.weights[which],
        )

    def turned(self, vectors: Array) -> Array:
        """Return vectors (P, 3) or (P, N, 3) of eye space in the unit-sphere spaces, (P, N | 1, 3)."""
        m = self.to_sphere
        v = vectors[:, None, :] if vectors.ndim == 2 else vectors
        return np.stack([sum(m[:, a, b] * v[..., b] for b in range(3)) for a in range(3)], -1)


def ball_integral(k: float) -> float:
    """Return the integral of g over the unit ball."""
    edge = math.exp(-k)
    radial = math.sqrt(math.pi) * math.erf(math.sqrt(k)) / (4 * k**1.5) - edge / (2 * k)
    return (4 * math.pi * radial - 4 * math.pi / 3 * edge) / (1 - edge)


def kernel(r2: Array, k: float) -> Array:
    """Return g of squared radii."""
    return np.maximum(0.0, (np.exp(-k * r2) - math.exp(-k)) / (1 - math.exp(-k)))


def kernel_mean(r2: Array, speed: float, t0: Array, t1: Array, k: float, length: float) -> Array:
    """Return the mean of g over a slab of the given length, of which the chord [t0, t1] is inside the support.

    The square of the radius is r2 + speed² t² along the ray, t from the nearest point.
    """
    root = math.sqrt(k)
    gauss = np.exp(-k * r2) * math.sqrt(math.pi) / (2 * root * speed)
    whole = gauss * erf_between(root * speed * t0, root * speed * t1) - (t1 - t0) * math.exp(-k)
    return np.maximum(0.0, whole) / (1 - math.exp(-k)) / length


def slab_mean(delta: Array, ray: Array, spacing: float, k: float) -> tuple[Array, Array]:
    """Return g's mean over the slab and whether it is met; delta (P, K, 3) mid-slab, ray (P, K | 1, 3) per depth."""
    speed = np.linalg.norm(ray, axis=-1)
    nearest = -(delta * ray).sum(-1) / speed**2
    r2 = ((delta + nearest[..., None] * ray) ** 2).sum(-1)
    half = np.sqrt(np.maximum(0.0, 1 - r2)) / speed
    t0 = np.maximum(-half, -spacing / 2 - nearest)
    t1 = np.minimum(half, spacing / 2 - nearest)
    inside = (r2 < 1) & (t1 > t0)
    g = np.zeros(r2.shape)
    full_speed = np.broadcast_to(speed, r2.shape)
    g[inside] = kernel_mean(r2[inside], full_speed[inside], t0[inside], t1[inside], k, spacing)  # type: ignore[arg-type]
    return g, inside


_SLAB_NODES, _SLAB_WEIGHTS = np.polynomial.legendre.leggauss(40)


def kernel_slopes(delta: Array, ray: Array, kernels: Kernels, k: float, length: float) -> Array:
    """Return ∇g in eye axes (P, K, 3), or its mean over a slab of that length along the ray, by quadrature."""

    def pulled(q: Array) -> Array:
        """Return -2k exp(-k r²) / (1 - exp(-k)) times the transposed inverse of B times q, without the support."""
        scale = -2 * k * np.exp(-k * (q**2).sum(-1)) / (1 - math.exp(-k))
        m = kernels.to_sphere
        return np.stack([scale * sum(m[:, a, b] * q[..., a] for a in range(3)) for b in range(3)], -1)

    if length == 0:
        return np.where(((delta**2).sum(-1) < 1)[..., None], pulled(delta), 0.0)
    speed = np.linalg.norm(ray, axis=-1)
    nearest = -(delta * ray).sum(-1) / speed**2
    r2 = ((delta + nearest[..., None] * ray) ** 2).sum(-1)
    half = np.sqrt(np.maximum(0.0, 1 - r2)) / speed
    t0, t1 = np.maximum(-half, -length / 2 - nearest), np.minimum(half, length / 2 - nearest)
    inside = (r2 < 1) & (t1 > t0)
    total = np.zeros(delta.shape)
    for node, weight in zip(_SLAB_NODES, _SLAB_WEIGHTS, strict=True):
        t = nearest + (t0 + t1) / 2 + node * (t1 - t0) / 2
        total += (weight * (t1 - t0) / 2)[..., None] * pulled(delta + t[..., None] * ray)
    return np.where(inside[..., None], total / length, 0.0)


def normalised(f: RegularField | EllipsoidField, data: Array, weights: Array) -> Array:
    """Return ρ - b of the sums D and W (section 2)."""
    if f.normalization == "none":
        return data
    if f.normalization == "threshold":
        return data / np.maximum(f.w0, weights)
    if f.least_weight() > 0:
        return data / np.maximum(f.least_weight(), weights)
    return data / f.mass()


def normalised_slope(
    f: RegularField | EllipsoidField, data: Array, weights: Array, data_slope: Array, weight_slope: Array
) -> Array:
    """Return ∇ρ of the sums D and W and their gradients (section 10)."""
    if f.normalization == "none":
        return data_slope
    if f.normalization == "lattice" and f.least_weight() == 0:
        return data_slope / f.mass()
    least = f.w0 if f.normalization == "threshold" else f.least_weight()
    above = weights > least
    w = np.where(above, weights, 1.0)[:, None]
    return np.where(above[:, None], (w * data_slope - data[:, None] * weight_slope) / w**2, data_slope / least)
