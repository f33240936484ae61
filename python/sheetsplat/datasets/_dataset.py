"""What the generators of :mod:`sheetsplat.datasets` return."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.fields import EllipsoidField, RegularField
from sheetsplat.light import Light
from sheetsplat.scene import Scene
from sheetsplat.transfer import TransferFunction

Vector = tuple[float, float, float]
Floats = NDArray[np.float64]
# Vertices, (V, 3), and triangles, (T, 3).
Mesh = tuple[Floats, NDArray[np.int64]]


class DrawableDataset(ABC):
    """A data set with a suggested picture."""

    suggested: Mapping[str, Any]

    @property
    @abstractmethod
    def clim(self) -> tuple[float, float]:
        """The range of values to show."""

    @abstractmethod
    def field(self, **options: Any) -> RegularField | EllipsoidField:
        """Return the data as a field of kernels."""

    @property
    def bounds(self) -> tuple[Vector, Vector]:
        """World-aligned box around all supports, as :attr:`sheetsplat.RegularField.bounds`."""
        return self.field().bounds

    def transfer_function(self) -> TransferFunction:
        """Return the suggested transfer function, else a grey ramp over :attr:`clim`."""
        lower, upper = self.clim
        ramp = [(lower, 0.0, 0.0, 0.0, 0.0), (upper, 1.0, 1.0, 1.0, 0.2)]
        return TransferFunction(list(self.suggested.get("points", ramp)))

    def scene(self, **options: Any) -> Scene:
        """Return the suggested scene; `options` are those of :class:`sheetsplat.Scene` and take precedence."""
        arguments: dict[str, Any] = {"lights": [Light((0.3, 0.5, 1.0))]}
        arguments |= {name: self.suggested[name] for name in ("mode", "iso_value") if name in self.suggested}
        arguments |= options
        field = arguments.pop("field", None)
        transfer_function = arguments.pop("transfer_function", None)
        return Scene(
            self.field() if field is None else field,
            self.transfer_function() if transfer_function is None else transfer_function,
            **arguments,
        )


@dataclass(frozen=True, eq=False)
class Dataset(DrawableDataset):
    """A generated volume, and how to draw it.

    Attributes
    ----------
    name
        Short name, usable as a file name.
    values
        Samples, indexed ``[k, j, i]``; read-only.
    spacing
        World units between samples along x, y, z; on a BCC lattice three times its edge ``a``.
    origin
        World position of sample (0, 0, 0).
    lattice
        ``"cartesian"`` or ``"bcc"``.
    description
        What it is and how it was made, in one or two sentences.
    stand_in_for
        The data set of a paper that this one replaces, or None.
    suggested
        Options of a suitable picture: ``points`` of a transfer function, ``clim``, ``mode``, ``iso_value``.
    """

    name: str
    values: NDArray[Any]
    spacing: Vector
    origin: Vector
    lattice: str = "cartesian"
    description: str = ""
    stand_in_for: str | None = None
    suggested: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        values = np.ascontiguousarray(self.values)
        if values is self.values and values.flags.writeable:
            values = values.view()
        values.flags.writeable = False
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "suggested", MappingProxyType(dict(self.suggested)))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of samples along k, j, i."""
        nk, nj, ni = self.values.shape
        return nk, nj, ni

    def __repr__(self) -> str:
        """Return a short description."""
        nk, nj, ni = self.shape
        return f"Dataset({self.name!r}, {ni} x {nj} x {nk} {self.values.dtype.name}, {self.lattice})"

    @property
    def clim(self) -> tuple[float, float]:
        """The suggested range of values, or the smallest and largest value."""
        if "clim" in self.suggested:
            lower, upper = self.suggested["clim"]
            return float(lower), float(upper)
        return float(self.values.min()), float(self.values.max())

    def field(self, **options: Any) -> RegularField:
        """Return the volume as a field of kernels; `options` are those of :class:`sheetsplat.RegularField`."""
        arguments: dict[str, Any] = {"spacing": self.spacing, "origin": self.origin, "lattice": self.lattice}
        return RegularField(self.values, **{**arguments, **options})
