"""Free ellipsoids as rows of ten numbers, and the samples that they are fitted to."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat import _memory, _sheetsplat
from sheetsplat._checks import numbers
from sheetsplat.errors import complain
from sheetsplat.fields import EllipsoidField

Floats = NDArray[np.float64]

#: Columns of a row: the centre, the frame (xx, yy, zz, xy, xz, yz of the triangular U), and the value.
CENTER, FRAME, VALUE = slice(0, 3), slice(3, 9), 9
COLUMNS = 10
FALLOFF = 8.0
# What occurs in one sample of so many is what the values are counted from.
_OFTEN = 100
# Bytes for each sample: what is given, the samples of the fit, and what is left of them.
_BYTES = 64


def triangles(rows: Floats) -> Floats:
    """Return the frames U of rows, (N, 3, 3): q = U (x - centre), |q| < 1 within the support."""
    made = np.zeros((len(rows), 3, 3))
    for column, (a, b) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))):
        made[:, a, b] = rows[:, 3 + column]
    return made


def frame_numbers(frames: Floats) -> Floats:
    """Return the numbers of frames of any form, (N, 3, 3): of the triangular U with the same U^T U."""
    upper = np.linalg.qr(frames)[1]
    upper *= np.where(np.diagonal(upper, axis1=1, axis2=2) < 0.0, -1.0, 1.0)[:, :, None]
    return np.asarray(upper[:, (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)])


@dataclass(frozen=True, eq=False)
class Ellipsoids:
    """Free ellipsoids, whose sum with a base is the scalar: rho = base + sum of f g (conventions, section 2).

    Attributes
    ----------
    rows
        (N, 10): centre, frame, value. Places are those of the samples: indices (i, j, k) of a lattice.
    base
        What the values are counted from.
    falloff
        The k of the profile.
    error
        Root mean square of what is left of the samples, in their units.
    """

    rows: Floats
    base: float = 0.0
    falloff: float = FALLOFF
    error: float = float("nan")

    @staticmethod
    def of_shapes(
        centers: ArrayLike, shapes: ArrayLike, values: ArrayLike, base: float = 0.0, falloff: float = FALLOFF
    ) -> Ellipsoids:
        """Return ellipsoids of shape matrices M, (N, 3, 3): their columns are semi-axes as vectors."""
        rows = np.empty((len(np.asarray(values)), COLUMNS))
        rows[:, CENTER], rows[:, VALUE] = np.asarray(centers).reshape(-1, 3), values
        inverse = np.linalg.inv(np.asarray(shapes, dtype=np.float64).reshape(-1, 3, 3))
        rows[:, FRAME] = frame_numbers(np.asarray(inverse, dtype=np.float64))
        return Ellipsoids(rows, base, falloff)

    def __len__(self) -> int:
        """Return the number of kernels."""
        return len(self.rows)

    @property
    def centers(self) -> Floats:
        """Centres, (N, 3)."""
        return self.rows[:, CENTER]

    @property
    def values(self) -> Floats:
        """What each kernel adds at its centre, (N,): its value counted from the base."""
        return self.rows[:, VALUE]

    def semi_axes(self) -> Floats:
        """Return the semi-axes of the supports, (N, 3), the longest first."""
        return np.asarray(1.0 / np.linalg.svd(triangles(self.rows), compute_uv=False)[:, ::-1])

    def shapes(self) -> Floats:
        """Return the symmetric shape matrices M, (N, 3, 3): the unit ball becomes the support."""
        _, singular, axes = np.linalg.svd(triangles(self.rows))
        return np.asarray((axes.transpose(0, 2, 1) / singular[:, None, :]) @ axes)

    def field(self, **options: Any) -> EllipsoidField:
        """Return the field, in the places of the samples; `options` of :class:`sheetsplat.EllipsoidField`."""
        _, singular, axes = np.linalg.svd(triangles(self.rows))
        axes[np.linalg.det(axes) < 0.0] *= -1.0
        given: dict[str, Any] = {"normalization": "none", "falloff": self.falloff, "base": self.base, **options}
        turned = axes.transpose(0, 2, 1)
        return EllipsoidField(self.centers, 1.0 / singular, turned, self.values + self.base, **given)


@dataclass(frozen=True, eq=False)
class Samples:
    """Numbers at the places of a lattice, or at points; NaN is a missing one.

    Attributes
    ----------
    values
        float64, (nk, nj, ni), or (M,) with points.
    weights
        As many, at least 0, 0 for missing ones; None: 1 each.
    points
        (M, 3), or None for a lattice.
    base, scale
        What a fit counts from, and its unit: the samples' range, 1 where they are all the same.
    """

    values: Floats
    weights: Floats | None
    points: Floats | None
    base: float
    scale: float

    @staticmethod
    def of(values: object, points: object = None, weights: object = None, base: float | None = None) -> Samples:
        """Return checked samples; base None: the value that one in a hundred has, the most frequent, else the median.

        Raises
        ------
        InvalidInput
            For anything but (nk, nj, ni) numbers, or (M,) numbers and (M, 3) points, and for infinite ones.
        OutOfMemory
            Where a fit does not fit.
        """
        if isinstance(values, Samples):
            return values
        wanted = "(nk, nj, ni) numbers" if points is None else "(M,) numbers"
        given = numbers("samples", values, wanted)
        if given.ndim != (3 if points is None else 1):
            raise complain("samples cannot be used", f"an array of shape {given.shape}", wanted)
        _memory.require(_BYTES * given.size, f"a fit to {given.size} samples", "use fewer samples")
        kept = np.ascontiguousarray(given, dtype=np.float64)
        at = None if points is None else np.ascontiguousarray(numbers("points", points, "(M, 3) places"), np.float64)
        if at is not None and (at.shape != (kept.size, 3) or not np.isfinite(at).all()):
            raise complain("points cannot be used", f"an array of shape {at.shape}", "(M, 3) finite numbers")
        known = ~np.isnan(kept)
        if np.isinf(kept).any():
            raise complain("samples cannot be used", "infinite numbers", "finite numbers or NaN")
        counts = None if weights is None else np.array(numbers("weights", weights, wanted), dtype=np.float64)
        if counts is not None:
            if counts.shape != kept.shape or not (np.isfinite(counts).all() and (counts >= 0.0).all()):
                raise complain("weights cannot be used", f"an array of shape {counts.shape}", "one of at least 0 each")
            known &= counts > 0.0
            counts[~known] = 0.0
        elif not known.all():
            counts = known.astype(np.float64)
        seen = kept[known]
        if base is None:
            base = _base(seen)
        with np.errstate(over="ignore"):
            scale = float(np.ptp(seen)) if seen.size else 0.0
        if not scale and seen.size:
            scale = abs(float(seen[0]) - base)
        if not np.isfinite(scale):
            raise complain("samples cannot be used", "a range beyond float64", "numbers below 1e300")
        return Samples(kept, counts, at, float(base), scale or 1.0)

    @property
    def weight(self) -> float:
        """The sum of all weights."""
        return float(self.values.size if self.weights is None else self.weights.sum())

    def unit_values(self) -> Floats:
        """Return the samples counted from the base in the unit of the fit, 0 where they are missing."""
        made = np.asarray((self.values - self.base) / self.scale)
        return made if self.weights is None else np.where(self.weights > 0.0, made, 0.0)

    def fit(self, falloff: float, values: Floats | None = None) -> _sheetsplat.EllipsoidFit:
        """Return the native fit to these samples, or to other values at their places, in the unit of the fit."""
        data = self.unit_values() if values is None else values.reshape(self.values.shape)
        return _sheetsplat.EllipsoidFit(data, points=self.points, weights=self.weights, falloff=falloff)

    def sides(self) -> Floats:
        """Return the sides of the box of all places, x, y, z."""
        if self.points is None:
            return np.asarray(self.values.shape[::-1], dtype=np.float64) - 1.0
        return np.ptp(self.points, axis=0) if len(self.points) else np.zeros(3)

    def spacing(self) -> float:
        """Return the distance of neighbouring places: 1 on lattices, else what points have that fill their box."""
        if self.points is None:
            return 1.0
        sides = self.sides()
        sides = sides[sides > 0.0]
        return float((sides.prod() / len(self.points)) ** (1.0 / len(sides))) if len(sides) else 1.0

    def every(self, step: int) -> Samples:
        """Return one of `step` samples along each axis of a lattice."""
        if step == 1:
            return self
        part = (slice(None, None, step),) * 3
        kept = None if self.weights is None else np.ascontiguousarray(self.weights[part])
        return replace(self, values=np.ascontiguousarray(self.values[part]), weights=kept)


def _base(seen: Floats) -> float:
    if not seen.size:
        return 0.0
    found, counts = np.unique(seen, return_counts=True)
    most = int(np.argmax(counts))
    often = counts[most] > 1 and counts[most] * _OFTEN >= seen.size
    return float(found[most] if often else np.median(seen))
