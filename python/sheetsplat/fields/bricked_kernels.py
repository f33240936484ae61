"""Scattered kernels that are in files or other processes, and are read in bricks when a picture is drawn."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, NoReturn, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat._checks import Bounds
from sheetsplat.errors import Unsupported, complain
from sheetsplat.fields.base import Field
from sheetsplat.fields.bricked import INSTEAD_OF_WEIGHTS, BrickedField
from sheetsplat.fields.ellipsoid import EllipsoidField


class KernelSource(Protocol):
    """Where the kernels are: `sheetsplat.bricks.kernel_source.KernelSource`."""

    @property
    def name(self) -> str:
        """How messages call it."""

    def replace(self, **changes: Any) -> KernelSource:
        """Return the same kernels with their values shown in another way."""

    def summed(self) -> KernelSource:
        """Return the same kernels for plain sums."""

    def shown_as(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values as they are stored in the way in which they are shown."""


@dataclass(frozen=True)
class KernelFacts:
    """What is known of all kernels.

    Attributes
    ----------
    count
        How many there are.
    stride
        Of so many one is in the sample.
    centres, supports
        World-aligned boxes around all centres, and around all supports.
    value_range
        Smallest and largest value.
    default_slice_spacing
        Of a field of all of them.
    """

    count: int
    stride: int
    centres: Bounds
    supports: Bounds
    value_range: tuple[float, float]
    default_slice_spacing: float


class BrickedKernels(EllipsoidField):
    """Scattered kernels that are read in bricks when a picture is drawn. Made by `sheetsplat.open_bricks`. Immutable.

    Pictures of it are drawn by `sheetsplat.render`, brick by brick: no more is in memory than the bricks that are drawn
    and a sample. As an EllipsoidField it is that sample: its arrays, and the scalar at points, are those of every
    `facts.stride`-th kernel, whose semi-axes are the cube root of that number longer, so that sums of weights stay what
    they are on average. Colours, opacities and camera are chosen by it. Where all kernels are in the sample, they are
    those of the field in memory.

    Attributes
    ----------
    source
        Where the kernels are.
    facts
        What is known of all of them.

    Examples
    --------
    >>> bricked = ss.open_bricks({"x": [0, 1], "y": [0, 0], "z": [0, 0], "radius": [1, 1], "value": [1, 2]})
    >>> bricked.kernels, bricked.bounds
    (2, ((-1.0, -1.0, -1.0), (2.0, 1.0, 1.0)))
    """

    __slots__ = ("facts", "source")
    source: KernelSource
    facts: KernelFacts

    @classmethod
    def of(cls, sample: EllipsoidField, source: KernelSource, facts: KernelFacts) -> BrickedKernels:
        """Return the field of a source.

        Parameters
        ----------
        sample
            Every `facts.stride`-th kernel, with semi-axes as they are.
        source, facts
            As the attributes.
        """
        longer = facts.stride ** (1.0 / 3.0)
        native = sample.native
        if facts.stride > 1:
            rows = (sample.centers, sample.scales * longer, sample.rotations, sample.values, sample.weights)
            native = sample.with_rows(*rows, value_range=facts.value_range).native
        made = object.__new__(cls)
        for kind in EllipsoidField.__mro__[:-1]:
            for name in getattr(kind, "__slots__", ()):
                setattr(made, name, getattr(sample, name))
        made.native, made.source, made.facts = native, source, facts
        return made

    def _parts(self) -> dict[str, Any]:
        return super()._parts() | {"source": self.source, "facts": self.facts}

    def _restore(self, parts: dict[str, Any]) -> None:
        self.source, self.facts = parts.pop("source"), parts.pop("facts")
        super()._restore(parts)

    @property
    def sample(self) -> EllipsoidField:
        """The sample as a field in memory."""
        made = object.__new__(EllipsoidField)
        for kind in EllipsoidField.__mro__[:-1]:
            for name in getattr(kind, "__slots__", ()):
                setattr(made, name, getattr(self, name))
        return made

    @property
    def kernels(self) -> int:
        """Number of all kernels; `size` is that of the sample."""
        return self.facts.count

    @property
    def bounds(self) -> Bounds:  # type: ignore[override]
        """World-aligned box around all supports: its lower and its upper corner."""
        return self.facts.supports

    @property
    def centre_bounds(self) -> Bounds:  # type: ignore[override]
        """World-aligned box around all kernel centres: its lower and its upper corner."""
        return self.facts.centres

    @property
    def value_range(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return self.facts.value_range

    @property
    def default_slice_spacing(self) -> float:  # type: ignore[override]
        """Default distance of slices in scenes, world units. Conventions, section 3."""
        return self.facts.default_slice_spacing

    def _shown(self, **changes: Any) -> BrickedKernels:
        source = self.source.replace(**changes)
        low, high = source.shown_as(np.asarray(self.facts.value_range)).tolist()
        facts = replace(self.facts, value_range=(low, high))
        rows = (self.centers, self.scales, self.rotations, source.shown_as(self.values), self.weights)
        native = self.with_rows(*rows, value_range=facts.value_range).native
        return self._with(source=source, facts=facts, native=native)

    def logarithmic(self, floor: float | None) -> BrickedKernels:
        """Return a field of log10(value / floor), 0 for smaller values; without a floor one of the values."""
        return self._shown(floor=floor)

    def summed(self) -> Self:
        """Return the field of the plain sums where it keeps the mass; any other as it is."""
        made = super().summed()
        return made if made is self else made._with(source=self.source.summed())  # noqa: SLF001

    def clipped(self, limits: tuple[float, float]) -> BrickedKernels:
        """Return a field whose values are clamped to the limits."""
        return self._shown(limits=limits)

    def nearest_kernel(self, points: ArrayLike) -> NDArray[np.int64]:
        """Raise Unsupported: kernels are not in memory."""
        self._refuse("numbers of kernels")

    def weighted_by(self, weight: Any) -> NoReturn:
        """Raise Unsupported: kernels are not in memory."""
        self._refuse("weighted means", INSTEAD_OF_WEIGHTS)

    def with_ghost_points(self, *, distance: float = 1.0, weight: float = 1.0) -> NoReturn:
        """Raise Unsupported: kernels are not in memory."""
        self._refuse("ghost points")

    def _refuse(self, what: str, advice: str = "open it with sheetsplat.open") -> NoReturn:
        raise complain(
            f"{what} of scattered data in bricks cannot be had",
            f"{self.source.name}, whose kernels are not in memory",
            "a field in memory",
            advice,
            kind=Unsupported,
        )

    def __repr__(self) -> str:
        """Return a short description."""
        low, high = self.value_range
        kinds = "spheres" if self.isotropic else "ellipsoids"
        return (
            f"BrickedKernels({self.kernels} {kinds} of {self.source.name}, values {low:g} to {high:g}, "
            f"normalization {self._normalization!r})"
        )


#: A field whose data are read in bricks.
Bricked = BrickedField | BrickedKernels


def any_in_bricks(fields: Iterable[Field]) -> bool:
    """Return whether one of some fields is read in bricks."""
    return any(isinstance(field, Bricked) for field in fields)


def has_values_at_points(field: Field) -> bool:
    """Return whether a field has its scalar at points, of all kernels."""
    return field.can_be_probed if isinstance(field, BrickedField) else not isinstance(field, BrickedKernels)
