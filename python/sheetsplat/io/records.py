"""The data of files: regular volumes and scattered data."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import Bounds, Triple
from sheetsplat._rows import usable_rows
from sheetsplat.fields.ellipsoid import EllipsoidField
from sheetsplat.labels import LabelColors
from sheetsplat.orientation import Orientation
from sheetsplat.quantity import Quantity

Floats = NDArray[np.float64]
# Columns of sizes; a record has one of them.
_SIZES = ("supports", "deviations", "scales")


# Scaled samples are float32 where these round to less than 1/256 of a step of what is stored, and whole where all
# products of 16 bits fit 32.
_FINE = 2.0**16
_WHOLE = 2.0**14
_LEAST_STEP = 2.0**-100


@dataclass(frozen=True)
class Packing:
    """How stored numbers become samples: those that are missing become NaN, all others scale * number + offset.

    Attributes
    ----------
    scale, offset
        Finite; the scale is not 0.
    missing
        Stored numbers that stand for a missing sample.
    unsigned
        The bits of stored integers are numbers without a sign.

    Examples
    --------
    >>> ss.io.Packing(0.5, 10.0, missing=(-1,)).unpacked(np.array([-1, 2, 4], "i2"), "a file").tolist()
    [nan, 11.0, 12.0]
    """

    scale: float = 1.0
    offset: float = 0.0
    missing: tuple[float, ...] = ()
    unsigned: bool = False

    def _view(self, stored: np.dtype[Any]) -> np.dtype[Any]:
        return np.dtype(stored.str.replace("i", "u")) if self.unsigned and stored.kind == "i" else stored

    def kind(self, stored: np.dtype[Any]) -> np.dtype[Any]:
        """Return the type of the samples that numbers of a type become."""
        stored = self._view(stored)
        scaled = (self.scale, self.offset) != (1.0, 0.0)
        if not scaled and (not self.missing or stored.kind == "f"):
            return stored
        short = stored.itemsize <= 2
        whole = self.scale.is_integer() and self.offset.is_integer()
        if stored.kind != "f" and short and not self.missing and whole and abs(self.scale) <= _WHOLE:
            return np.dtype(np.int32 if abs(self.offset) < 2**30 else np.float64)
        fine = stored.kind == "f" or not scaled or abs(self.offset) <= _FINE * abs(self.scale)
        # Steps, and products of 16 bits with them, within float32.
        fine &= _LEAST_STEP <= abs(self.scale) <= 1.0 / _LEAST_STEP
        return np.dtype(np.float32 if fine and (short or stored == np.float32) else np.float64)

    def unpacked(self, values: NDArray[Any], where: object) -> NDArray[Any]:
        """Return the samples of stored numbers, themselves where nothing is to do; OutOfMemory where they do not fit.

        `where` names the data in messages.
        """
        values = values.view(self._view(values.dtype))
        kind = self.kind(values.dtype)
        stated = [one for one in self.missing if not math.isnan(one)]
        if kind == values.dtype and not stated and (self.scale, self.offset) == (1.0, 0.0):
            return values
        _memory.require(values.size * (kind.itemsize + bool(stated)), f"the samples of {where}")
        lost = None
        for one in stated:
            with np.errstate(over="ignore"):
                # Fill values are often written wider than the numbers that they fill.
                same = values == (values.dtype.type(one) if values.dtype.kind == "f" else one)
            lost = same if lost is None else lost | same
        found: NDArray[Any] = values.astype(kind)
        if (self.scale, self.offset) != (1.0, 0.0):
            # Infinite samples are refused where they are used.
            with np.errstate(over="ignore", invalid="ignore"):
                np.multiply(found, kind.type(self.scale), out=found)
                np.add(found, kind.type(self.offset), out=found)
        if lost is not None:
            found[lost] = np.nan
        return found


@dataclass(frozen=True)
class Channel:
    """One of several channels of a file.

    Attributes
    ----------
    name
        Its label, by which `sheetsplat.open` takes it.
    color
        Red, green and blue in which it is shown; None where it is the only one.
    window
        The values at which its colour begins and is full; None where the file does not say.
    number
        Which one it is, from 0 on.

    Examples
    --------
    >>> ss.io.Channel("DAPI", (0, 0, 1), window=(50, 900)).name
    'DAPI'
    """

    name: str = ""
    color: Triple | None = None
    window: tuple[float, float] | None = None
    number: int = 0


@dataclass(frozen=True)
class Volume:
    """A regular volume of a file: what its reader found, from which `axes.settled` makes what is shown.

    Attributes
    ----------
    values
        Array of shape (nk, nj, ni), or of colours, (nk, nj, ni, 3) or (nk, nj, ni, 4), as for `RegularField`.
    spacing, origin
        World units along x, y, z; the origin is the place of sample (0, 0, 0).
    format
        Name of the file format.
    details
        Further entries of the header, as texts.
    quantity
        What the samples and the lengths are.
    orientation
        Which way up it is; None where the file does not say.
    axes
        (3, 3), rows: the steps of i, j and k in the world, in place of `spacing`; None: along the world.
    units
        Of the lengths along x, y and z of the world, where `quantity` has none for all; empty: that of `quantity`.
    packing
        How the values become samples.
    channel
        Which of several channels it is.
    labels
        Whether the file states that samples are labels; their names and colours where it states these.

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
    axes: Floats | None = None
    units: tuple[str, ...] = ()
    packing: Packing = Packing()
    channel: Channel = Channel()
    labels: LabelColors | bool = False


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
    rows
        Which rows of the data these are, (N,); None: all.
    made
        The field, where the file holds one.
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
    rows: NDArray[np.int64] | None = None
    made: EllipsoidField | None = None

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
        return replace(self, rows=np.flatnonzero(kept), **fewer)

    @property
    def has_kernels(self) -> bool:
        """Whether the file has the sizes of kernels."""
        return any(getattr(self, name) is not None for name in _SIZES)
