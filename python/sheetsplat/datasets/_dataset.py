"""What the generators of :mod:`sheetsplat.datasets` return."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import whole
from sheetsplat.errors import complain
from sheetsplat.fields import RegularField
from sheetsplat.light import Light
from sheetsplat.scene import Scene
from sheetsplat.transfer import TransferFunction

Vector = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Dataset:
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
        Options of a suitable picture: ``points`` of a transfer function, ``clim``, ``mode`` and ``iso_value``.

    Examples
    --------
    >>> data = ss.datasets.noisy_ball(16)
    >>> data.shape, data.field().size
    ((16, 16, 16), 4096)
    """

    name: str
    values: NDArray[Any]
    spacing: Vector = (1.0, 1.0, 1.0)
    origin: Vector = (0.0, 0.0, 0.0)
    lattice: str = "cartesian"
    description: str = field(default="", kw_only=True)
    stand_in_for: str | None = field(default=None, kw_only=True)
    suggested: Mapping[str, Any] = field(default_factory=dict, kw_only=True)

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
        lower, upper = self.suggested.get("clim") or (self.values.min(), self.values.max())
        return float(lower), float(upper)

    def field(self, **options: Any) -> RegularField:
        """Return the volume as a field of kernels; `options` are those of :class:`sheetsplat.RegularField`."""
        arguments: dict[str, Any] = {"spacing": self.spacing, "origin": self.origin, "lattice": self.lattice}
        return RegularField(self.values, **{**arguments, **options})

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
        field, transfer_function = options.pop("field", None), options.pop("transfer_function", None)
        suggested = {name: self.suggested[name] for name in ("mode", "iso_value") if name in self.suggested}
        return Scene(
            self.field() if field is None else field,
            self.transfer_function() if transfer_function is None else transfer_function,
            **{"lights": [Light((0.3, 0.5, 1.0))], **suggested, **options},
        )


def require_samples(name: str, n: int, least: int) -> None:
    """Raise InvalidInput for fewer than `least` samples along each axis of a data set."""
    if whole(f"{name}: n", n) < least:
        raise complain(f"the data set {name} cannot be made", f"n = {n}", f"at least {least} samples along each axis")
