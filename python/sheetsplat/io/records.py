"""The data of files: regular volumes and scattered data."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import Bounds, Triple
from sheetsplat._rows import usable_rows
from sheetsplat.orientation import Orientation
from sheetsplat.quantity import Quantity

Floats = NDArray[np.float64]
# Columns of sizes; a record has one of them.
_SIZES = ("supports", "deviations", "scales")


@dataclass(frozen=True)
class Volume:
    """A regular volume of a file.

    Attributes
    ----------
    values
        Array of shape (nk, nj, ni).
    spacing, origin
        World units along x, y, z.
    format
        Name of the file format.
    details
        Further entries of the header, as texts.
    quantity
        What the samples and the lengths are.
    orientation
        Which way up it is; None where the file does not say.

    Examples
    --------
    >>> ss.io.Volume(np.zeros((4, 4, 4)), spacing=(1, 1, 2)).values.shape
    (4, 4, 4)
    """

    values: NDArray[Any]
    spacing: Triple = (1.0, 1.0, 1.0)
    origin: Triple = (0.0, 0.0, 0.0)
    format: str = ""
    details: dict[str, str] = field(default_factory=dict)
    quantity: Quantity = Quantity()
    orientation: Orientation | None = None


@dataclass(frozen=True)
class Scattered:
    """Scattered data of a file: N rows in each array.

    Attributes
    ----------
    points
        World positions, (N, 3).
    values
        The chosen scalar, (N,).
    scalar
        Its name.
    scalars
        Names of all scalars.
    format
        Name of the file format.
    cells
        Of a mesh of the points: arrays of point numbers, (M, 4) tetrahedra, (M, 5) pyramids, (M, 6) wedges or (M, 8)
        hexahedra in the order of VTK.
    supports
        Radii of the supports of SPH kernels, (N,), world units.
    particles
        Whether rows are particles, which no fit to their neighbours may join unless it is asked for.
    masses, densities
        Of SPH particles, (N,); their quotient is a particle's volume.
    deviations
        Standard deviations of Gaussians along their own axes, (N, 3), world units.
    scales
        Semi-axes of supports, (N, 3) or (N,), world units.
    rotations
        Quaternions w, x, y, z of kernels, (N, 4).
    weights
        Of kernels, (N,).
    normalization, w0, falloff, cell_volume, base
        From the file; None: the default of `EllipsoidField`.
    details
        Further information, as texts.
    orientation
        Which way up they are; None where the format does not say.
    unit, length_unit
        Of the values and of the positions, for figures.
    why
        Why values may be NaN, for messages.
    periodic
        The box in which they wrap, as for `EllipsoidField`; None: they do not.
    """

    points: Floats
    values: Floats
    scalar: str
    format: str
    scalars: tuple[str, ...] = ()
    cells: tuple[NDArray[np.int64], ...] | None = None
    particles: bool = False
    supports: Floats | None = None
    masses: Floats | None = None
    densities: Floats | None = None
    deviations: Floats | None = None
    scales: Floats | None = None
    rotations: Floats | None = None
    weights: Floats | None = None
    normalization: str | None = None
    w0: float | None = None
    falloff: float | None = None
    cell_volume: float | None = None
    base: float | None = None
    details: dict[str, str] = field(default_factory=dict)
    orientation: Orientation | None = None
    unit: str = ""
    length_unit: str = ""
    why: str = ""
    periodic: Bounds | None = None

    def usable(self, where: object, nan: str = "error") -> Scattered:
        """Return the rows whose numbers are finite, and the cells of them; see `usable_rows`, which raises."""
        sizes = next((name for name in _SIZES if getattr(self, name) is not None), "supports")
        told = {"points": "position", "values": f"scalar {self.scalar}", sizes: "size", "rotations": "rotation"}
        told |= {"weights": "weight", "masses": "mass", "densities": "density"}
        rows = {name: getattr(self, name) for name in told}
        hints = {told["values"]: (self.why, "choose another scalar" if len(self.scalars) > 1 else "")}
        kept = usable_rows(str(where), {told[name]: one for name, one in rows.items()}, nan, hints=hints)
        if kept is None:
            return self
        fewer: dict[str, Any] = {name: one[kept] for name, one in rows.items() if one is not None}
        if self.cells is not None:
            # A cell needs all of its corners.
            number = np.cumsum(kept) - 1
            blocks = [number[block[kept[block].all(axis=1)]] for block in self.cells]
            fewer["cells"] = tuple(block for block in blocks if len(block)) or None
        return replace(self, **fewer)

    @property
    def has_kernels(self) -> bool:
        """Whether the file has the sizes of kernels."""
        return any(getattr(self, name) is not None for name in _SIZES)
