"""Lattices of samples of which a part can be made into a field of its own."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import Bounds, Triple
from sheetsplat.errors import complain
from sheetsplat.fields import Normalization, RegularField
from sheetsplat.fields.regular import Lattice, NanPolicy
from sheetsplat.ripple import lattice_constant, lattice_ripple

#: First and last index, the last one outside, along k, j, i.
Box = tuple[tuple[int, int], tuple[int, int], tuple[int, int]]

#: Coefficients are the same within 1e-8 of the largest sample this many samples away from where a volume was cut.
PREFILTER_MARGIN = 24


@dataclass(frozen=True)
class LatticeSpec:
    """Everything about a `RegularField` but its samples.

    Attributes
    ----------
    shape
        (nk, nj, ni) of the whole volume.
    spacing, origin, lattice, radius, falloff, normalization, w0, nan, prefilter
        As for `RegularField`.
    """

    shape: tuple[int, int, int]
    spacing: Triple = (1.0, 1.0, 1.0)
    origin: Triple = (0.0, 0.0, 0.0)
    lattice: Lattice = "cartesian"
    radius: float = 2.0
    falloff: float = 5.0
    normalization: Normalization = "lattice"
    w0: float = 1.0
    nan: NanPolicy = "error"
    prefilter: bool = False

    @classmethod
    def of(cls, field: RegularField) -> LatticeSpec:
        """Return what a field is made of, beside its samples."""
        return cls(
            shape=field.shape,
            spacing=field.spacing,
            origin=field.origin,
            lattice=cast(Lattice, field.lattice),
            radius=field.radius,
            falloff=field.falloff,
            normalization=cast(Normalization, field.normalization),
            w0=field.w0,
            nan=cast(NanPolicy, field.nan),
            prefilter=field.prefilter,
        )

    @property
    def steps(self) -> Triple:
        """World units from one index to the next along x, y, z; in a layer of a BCC lattice."""
        if self.lattice == "bcc":
            edge = self.spacing[0]
            return edge, edge, 0.5 * edge
        return self.spacing

    @property
    def semi_axes(self) -> Triple:
        """Semi-axes of every kernel's support along x, y, z, world units."""
        if self.lattice == "bcc":
            return (self.radius * self.spacing[0] / math.sqrt(2.0),) * 3
        x, y, z = (self.radius * step for step in self.spacing)
        return x, y, z

    @property
    def default_slice_spacing(self) -> float:
        """Distance of slices unless given, world units."""
        return 0.5 * self.spacing[0] if self.lattice == "bcc" else min(self.spacing)

    @property
    def largest_sum(self) -> float:
        """Largest scalar that kernels of factor 1 add up to."""
        if self.normalization == "threshold":
            return 1.0
        ripple = lattice_ripple(self.radius, self.falloff, lattice=self.lattice, normalization="none")
        plain = self.normalization == "none" or self.prefilter
        constant = lattice_constant(self.radius, self.falloff, self.lattice) if plain else 1.0
        return constant * (1.0 + 1.01 * ripple.peak + 1e-6)

    @property
    def centres(self) -> Bounds:
        """World-aligned box of all samples' places."""
        nk, nj, ni = self.shape
        # Odd layers of a BCC lattice are moved by half a step along x and y.
        moved = 0.5 if self.lattice == "bcc" and nk > 1 else 0.0
        last = (ni - 1 + moved, nj - 1 + moved, nk - 1.0)
        x, y, z = (o + step * n for o, step, n in zip(self.origin, self.steps, last, strict=True))
        return self.origin, (x, y, z)

    def face(self, axis: int, index: int) -> float:
        """Return the coordinate of the plane midway between samples index - 1 and index along x, y or z."""
        middle = index - 0.25 if self.lattice == "bcc" and axis < 2 else index - 0.5
        return self.origin[axis] + middle * self.steps[axis]

    def around(self, cell: Bounds, margin: float) -> Box:
        """Return the box of all samples whose kernels reach closer to a cell than `margin`, [k, j, i].

        The box has at least one sample. Layers of a BCC lattice begin with an even one.
        """
        found = []
        for axis in (2, 1, 0):
            count, step = self.shape[2 - axis], self.steps[axis]
            reach = self.semi_axes[axis] + margin
            low, high = (
                (cell[0][axis] - reach - self.origin[axis]) / step,
                (cell[1][axis] + reach - self.origin[axis]) / step,
            )
            moved = 0.5 if self.lattice == "bcc" and axis < 2 else 0.0
            first = 0 if low <= 0 else min(math.floor(low - moved), count - 1)
            last = count if high >= count - 1 else max(math.ceil(high) + 1, first + 1)
            if self.lattice == "bcc" and axis == 2:
                first -= first % 2
            found.append((max(first, 0), min(last, count)))
        return found[0], found[1], found[2]

    def to_read(self, box: Box) -> Box:
        """Return the samples that the kernels of a box depend on: with `prefilter` also others around them."""
        if not self.prefilter:
            return box
        k, j, i = (
            (max(first - PREFILTER_MARGIN, 0), min(last + PREFILTER_MARGIN, count))
            for (first, last), count in zip(box, self.shape, strict=True)
        )
        if self.lattice == "bcc":
            k = (k[0] - k[0] % 2, k[1])
        return k, j, i

    def field(self, samples: NDArray[Any], box: Box, value_range: tuple[float, float] | None = None) -> RegularField:
        """Return the field of a box of the samples, in their place in the world.

        Parameters
        ----------
        samples
            Those of ``to_read(box)``, [k, j, i].
        box
            As `around` gives it.
        value_range
            Range of the factors of all kernels of the whole volume, by which the picture's numbers are scaled: of the
            samples, with `prefilter` of the coefficients.
        """
        read = self.to_read(box)
        wanted = tuple(last - first for first, last in read)
        if samples.shape != wanted:
            raise complain("a brick cannot be made", f"samples of shape {samples.shape}", f"shape {wanted}")
        options: dict[str, Any] = {
            "lattice": self.lattice,
            "radius": self.radius,
            "falloff": self.falloff,
            "spacing": self.spacing,
            "w0": self.w0,
            "nan": self.nan,
        }
        (k, _), (j, _), (i, _) = box
        origin = tuple(o + step * n for o, step, n in zip(self.origin, self.steps, (i, j, k), strict=True))
        if not self.prefilter:
            return RegularField.part(
                samples, value_range=value_range, origin=origin, normalization=self.normalization, **options
            )
        found = RegularField(samples, prefilter=True, **options)
        cut = tuple(slice(a - c, b - c) for (a, b), (c, _) in zip(box, read, strict=True))
        return RegularField.part(
            np.ascontiguousarray(samples[cut]),
            coefficients=np.ascontiguousarray(found.coefficients[cut]),
            figures=found.native.prefilter_figures,
            value_range=value_range,
            origin=origin,
            normalization="none",
            **options,
        )

    def replace(self, **changes: Any) -> LatticeSpec:
        """Return the same with some attributes changed."""
        return replace(self, **changes)


__all__ = ["PREFILTER_MARGIN", "Box", "LatticeSpec"]
