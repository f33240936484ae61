"""Kernels, the result of every fit, before they become a field."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat._checks import Bounds
from sheetsplat.errors import complain
from sheetsplat.fields import EllipsoidField
from sheetsplat.fields.axes import frames

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]

# Pairs of a kernel and a point that are evaluated together, of some hundred bytes each.
_PAIRS = 1 << 19


def profile(squared: Floats, falloff: float) -> Floats:
    """Return the kernel's profile g at squared distances in units of its support (conventions, section 2)."""
    lowered = (np.expm1(-falloff * squared) - np.expm1(-falloff)) / -np.expm1(-falloff)
    return np.asarray(np.maximum(lowered, 0.0), dtype=np.float64)


def quaternions(frames: Floats) -> Floats:
    """Return unit quaternions w, x, y, z of orthonormal frames, (N, 3, 3), whose columns are axes.

    The sign of an axis does not matter: mirrored frames have their third column negated.
    """
    from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

    if not len(frames):
        return np.empty((0, 4))
    turned = frames.copy()
    turned[np.linalg.det(turned) < 0.0, :, 2] *= -1.0
    return np.asarray(Rotation.from_matrix(turned).as_quat()[:, [3, 0, 1, 2]], dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Kernels:
    """Kernels with centres, shapes and values. All arrays are float64 and read-only.

    :meth:`field` makes a :class:`sheetsplat.EllipsoidField` of them; :func:`sheetsplat.render` takes them as they are.

    Attributes
    ----------
    centers
        World positions, (N, 3).
    scales
        Semi-axes of the supports, world units: (N, 3), or (N,) for spheres.
    values
        Values f, (N,).
    rotations
        Unit quaternions w, x, y, z, (N, 4), from own axes to the world's; None for spheres.
    weights
        Weights m, (N,); None: 1 each.
    falloff
        The k of the kernel's profile.
    normalization, w0
        How sums become the scalar, as for :class:`sheetsplat.EllipsoidField`.
    report
        Counts of merged points and similar numbers; each fit documents its own.
    periodic
        The box in which they wrap, as for :class:`sheetsplat.EllipsoidField`; None: they do not.
    keeps_mass
        Whether the kernels' integrals are the volumes of particles, so that integrals of plain sums keep masses.

    Examples
    --------
    >>> kernels = ss.fit.nearest(np.random.default_rng(1).random((50, 3)), np.ones(50))
    >>> kernels.field(w0=0.5).size
    50
    """

    centers: Floats
    scales: Floats
    values: Floats
    rotations: Floats | None = None
    weights: Floats | None = None
    falloff: float = 8.0
    normalization: str = "threshold"
    w0: float = 1.0
    report: Mapping[str, Any] = field(default_factory=dict)
    periodic: Bounds | None = None
    keeps_mass: bool = False

    def __post_init__(self) -> None:
        for name in ("centers", "scales", "values", "rotations", "weights"):
            given = getattr(self, name)
            if given is not None:
                kept = np.ascontiguousarray(given, dtype=np.float64).view()
                kept.flags.writeable = False
                object.__setattr__(self, name, kept)
        object.__setattr__(self, "report", MappingProxyType(dict(self.report)))

    def __len__(self) -> int:
        """Return the number of kernels."""
        return len(self.centers)

    def __repr__(self) -> str:
        """Return a short description."""
        kind = "spheres" if self.scales.ndim == 1 else "ellipsoids"
        counts = [f", {name}={value:.4g}" for name, value in self.report.items() if isinstance(value, int | float)]
        return f"Kernels({len(self)} {kind}, falloff {self.falloff:.6g}{''.join(counts)})"

    def field(self, **options: Any) -> EllipsoidField:
        """Return the field of these kernels; `options` of :class:`sheetsplat.EllipsoidField` take precedence."""
        own: dict[str, Any] = {
            name: getattr(self, name) for name in ("weights", "normalization", "w0", "falloff", "periodic")
        }
        made = EllipsoidField(self.centers, self.scales, self.rotations, self.values, **{**own, **options})
        chosen = {"normalization", "w0", "base"} & options.keys()
        return made.of_particles() if self.keeps_mass and not chosen else made

    def shapes(self) -> Floats:
        """Return the shape matrices M = R S, (N, 3, 3): the unit ball becomes a kernel's support."""
        axes = self._semi_axes()
        if self.rotations is None:
            return np.asarray(axes[:, :, None] * np.eye(3))
        return np.asarray(frames(self.rotations) * axes[:, None, :])

    def _semi_axes(self) -> Floats:
        return np.broadcast_to(self.scales[:, None] if self.scales.ndim == 1 else self.scales, (len(self), 3))

    def _inverse_shapes(self) -> Floats:
        """Return the inverses of the shape matrices from their factors, (N, 3, 3)."""
        axes = self._semi_axes()[:, :, None]
        own = np.eye(3) if self.rotations is None else frames(self.rotations).transpose(0, 2, 1)
        return np.asarray(own / axes)

    def masses(self) -> Floats:
        """Return the integral of each kernel's m g over space, (N,), world units cubed."""
        radius = self.scales**3 if self.scales.ndim == 1 else self.scales.prod(axis=1)
        return radius * unit_mass(self.falloff) * (1.0 if self.weights is None else self.weights)

    def sums(self, points: ArrayLike) -> tuple[Floats, Floats]:
        """Return the sums D and W at points, in float64 and from all kernels, and their images in a periodic box.

        Parameters
        ----------
        points
            World positions, (M, 3).

        Returns
        -------
        D, W
            Sums of m f g and of m g, (M,) each (conventions, section 2).
        """
        from scipy.spatial import cKDTree  # type: ignore[import-untyped]

        at = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        data, weight = np.zeros(len(at)), np.zeros(len(at))
        if not len(at) or not len(self):
            return data, weight
        if self.periodic is not None:
            # (A field counts images.)
            whole = self.field(normalization="none").with_images()
            names = ("centers", "scales", "values", "rotations", "weights")
            return replace(self, periodic=None, **{name: getattr(whole, name) for name in names}).sums(at)
        tree = cKDTree(at)
        reach = self._semi_axes().max(axis=1)
        inverse = self._inverse_shapes()
        own = np.ones(len(self)) if self.weights is None else self.weights
        counts = tree.query_ball_point(self.centers, reach, return_length=True)
        for first, last in spans(counts, _PAIRS):
            lists = tree.query_ball_point(self.centers[first:last], reach[first:last])
            kernel = np.repeat(np.arange(first, last), counts[first:last])
            point = np.concatenate([np.asarray(one, dtype=np.int64) for one in lists])
            unit = np.einsum("nij,nj->ni", inverse[kernel], at[point] - self.centers[kernel])
            part = own[kernel] * profile(np.einsum("ni,ni->n", unit, unit), self.falloff)
            weight += np.bincount(point, part, len(at))
            data += np.bincount(point, part * self.values[kernel], len(at))
        return data, weight


def unit_mass(falloff: float) -> float:
    """Return the integral of the profile over the unit ball (closed form)."""
    from scipy.special import erf  # type: ignore[import-untyped]

    k = falloff
    edge = np.exp(-k)
    gauss = (np.pi / k) ** 1.5 * erf(np.sqrt(k)) - 2.0 * np.pi / k * edge
    return float((gauss - edge * 4.0 * np.pi / 3.0) * (-1.0 / np.expm1(-k)))


def spans(counts: NDArray[Any], most: int) -> list[tuple[int, int]]:
    """Return ranges of items whose counts add up to at most `most`, or of one item."""
    ends = np.cumsum(counts, dtype=np.int64)
    stretches, first, done = [], 0, 0
    while first < len(ends):
        last = max(first + 1, int(np.searchsorted(ends, done + most, side="right")))
        stretches.append((first, last))
        first, done = last, int(ends[last - 1])
    return stretches


def require_kernels(kernels: object, what: str) -> Kernels:
    """Return the argument, or InvalidInput where it is not what a fit returns."""
    if not isinstance(kernels, Kernels):
        raise complain(
            f"{what} cannot be used", type(kernels).__name__, "sheetsplat.fit.Kernels", "use what a fit returns"
        )
    return kernels
