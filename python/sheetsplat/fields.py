"""Fields: sets of kernels whose weighted sums are the scalar that is shown. Conventions, section 2 (Fields)."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat import _memory, _sheetsplat
from sheetsplat._checks import Bounds, Triple, Vector, choice, number, shown, triple
from sheetsplat.errors import complain

Normalization = Literal["none", "lattice", "threshold"]
Lattice = Literal["cartesian", "bcc"]
NanPolicy = Literal["error", "skip"]

_KEPT = ("uint8", "int16", "uint16", "float32", "float64")
_FAILED = "RegularField: the samples cannot be used"


def _narrow_integers(values: NDArray[Any]) -> np.dtype[Any]:
    """Return the smallest kept type that holds all of these integers exactly."""
    if values.size == 0:
        return np.dtype(np.float64)
    low, high = int(values.min()), int(values.max())
    for name in ("uint8", "int16", "uint16"):
        info = np.iinfo(name)
        if info.min <= low and high <= info.max:
            return np.dtype(name)
    largest = max(-low, high)
    if largest <= 2**24:
        return np.dtype(np.float32)
    if largest <= 2**53:
        return np.dtype(np.float64)
    raise complain(
        _FAILED,
        f"integers up to {largest}",
        f"at most {2**53}, what float64 holds exactly",
        "scale the values, or convert them with values.astype(float) where the loss does not matter",
    )


def _kept_type(values: NDArray[Any]) -> np.dtype[Any]:
    """Return the type in which the samples are kept; no value changes by it."""
    native = values.dtype.newbyteorder("=")
    if native.name in _KEPT:
        return native
    if native.kind == "b":
        return np.dtype(np.uint8)
    if native.kind in "iu":
        return _narrow_integers(values)
    if native == np.float16:
        return np.dtype(np.float32)
    if native.kind == "f":
        with np.errstate(over="ignore"):
            shorter = values.astype(np.float64)
        if not np.array_equal(shorter, values, equal_nan=True):
            raise complain(
                _FAILED, f"{native.name} values that float64 cannot hold", "at most float64", "use values.astype(float)"
            )
        return np.dtype(np.float64)
    raise complain(_FAILED, f"values of type {native}", "integers, booleans or real floating-point numbers")


def as_samples(values: ArrayLike) -> NDArray[Any]:
    """Return `values` as a contiguous array [k, j, i] of a type that fields keep, without loss.

    Masked entries become NaN. Raises InvalidInput for other types and for anything but three axes, OutOfMemory where a
    copy would not fit.
    """
    if isinstance(values, np.ma.MaskedArray):
        if np.ma.is_masked(values):
            wide = np.float32 if values.dtype.itemsize <= 2 else np.float64
            array: NDArray[Any] = np.ma.filled(values.astype(wide), np.nan)
        else:
            array = values.data
    else:
        try:
            array = np.asarray(values)
        except (ValueError, TypeError) as error:
            raise complain(
                _FAILED, f"{type(values).__name__}: {error}", "an array of numbers with three axes"
            ) from None
    if array.ndim != 3:
        raise complain(
            _FAILED,
            f"{array.ndim} axes, shape {array.shape}",
            "three axes, values[k, j, i]",
            "choose one channel or one time step" if array.ndim > 3 else "reshape it to (nk, nj, ni)",
        )
    if array.dtype.kind not in "biuf":
        raise complain(_FAILED, f"values of type {array.dtype}", "integers, booleans or real floating-point numbers")
    # The copy that the field keeps, and one more where the type, the byte order or the layout changes on the way.
    _memory.require(array.size * array.dtype.itemsize, f"a copy of the samples, {' x '.join(map(str, array.shape))}")
    return np.require(array, dtype=_kept_type(array), requirements=("C", "A"))


class RegularField:
    """A Cartesian or body-centred cubic volume. Immutable.

    Sample (i, j, k) of ``values[k, j, i]`` is a kernel at ``origin + (i dx, j dy, k dz)`` (Cartesian) or at
    ``origin + ((i + (k mod 2)/2) a, (j + (k mod 2)/2) a, k a/2)`` (BCC). Conventions, section 2 (Fields).

    Parameters
    ----------
    values
        Array of shape (nk, nj, ni), anything that NumPy can read. uint8, int16, uint16, float32 and float64 are kept as
        they are; other real types are converted to one of these without loss; masked entries count as NaN.
    spacing
        World units between samples along x, y, z; for ``lattice="bcc"`` its first entry is the edge a.
    origin
        World position of sample (0, 0, 0).
    lattice
        "cartesian" or "bcc".
    radius
        Radius of a kernel's support in sample distances (BCC: of a/√2); unequal spacing: per axis.
    falloff
        k of the kernel (exp(−k r²) − exp(−k)) / (1 − exp(−k)).
    normalization
        How sums become the scalar: "none" (D), "lattice" (D/C) or "threshold" (D / max(w0, W)).
    w0
        Threshold of "threshold", > 0.
    nan
        What a NaN sample is: "error", or "skip" for "no sample there".

    Raises
    ------
    InvalidInput
        For empty arrays, other than three axes, other than real numbers, NaN (unless skipped), infinities, and for
        spacing, radius, falloff or w0 that are not positive.
    OutOfMemory
        Where the copy of the samples does not fit.
    """

    __slots__ = ("_falloff", "_lattice", "_nan", "_native", "_normalization", "_origin", "_radius", "_spacing", "_w0")

    def __init__(
        self,
        values: ArrayLike,
        *,
        spacing: Vector = (1.0, 1.0, 1.0),
        origin: Vector = (0.0, 0.0, 0.0),
        lattice: Lattice = "cartesian",
        radius: float = 2.0,
        falloff: float = 5.0,
        normalization: Normalization = "lattice",
        w0: float = 1.0,
        nan: NanPolicy = "error",
    ) -> None:
        self._spacing = triple("RegularField: spacing", spacing)
        self._origin = triple("RegularField: origin", origin)
        self._lattice = choice("RegularField: lattice", lattice, ("cartesian", "bcc"))
        self._radius = number("RegularField: radius", radius)
        self._falloff = number("RegularField: falloff", falloff)
        self._normalization = choice("RegularField: normalization", normalization, ("none", "lattice", "threshold"))
        self._w0 = number("RegularField: w0", w0)
        self._nan = choice("RegularField: nan", nan, ("error", "skip"))
        self._native = _sheetsplat.RegularField(
            as_samples(values),
            spacing=self._spacing,
            origin=self._origin,
            lattice=self._lattice,
            radius=self._radius,
            falloff=self._falloff,
            normalization=self._normalization,
            w0=self._w0,
            nan=self._nan,
        )

    @property
    def values(self) -> NDArray[Any]:
        """The samples, shape (nk, nj, ni), in the type in which they are kept; read-only, no copy."""
        return self._native.values

    @property
    def shape(self) -> tuple[int, int, int]:
        """Samples along k, j, i."""
        nk, nj, ni = self.values.shape
        return nk, nj, ni

    @property
    def spacing(self) -> Triple:
        """World units between samples along x, y, z (BCC: the first is the edge a)."""
        return self._spacing

    @property
    def origin(self) -> Triple:
        """World position of sample (0, 0, 0)."""
        return self._origin

    @property
    def lattice(self) -> str:
        """Either "cartesian" or "bcc"."""
        return self._lattice

    @property
    def radius(self) -> float:
        """Radius of a kernel's support, in sample distances."""
        return self._radius

    @property
    def falloff(self) -> float:
        """The k of the kernel's profile."""
        return self._falloff

    @property
    def normalization(self) -> str:
        """One of "none", "lattice" and "threshold"."""
        return self._normalization

    @property
    def w0(self) -> float:
        """Threshold of the weight sum, for normalisation "threshold"."""
        return self._w0

    @property
    def nan(self) -> str:
        """What a NaN sample is: "error" or "skip"."""
        return self._nan

    @property
    def size(self) -> int:
        """Number of kernels; skipped samples are none."""
        return self._native.size

    @property
    def value_range(self) -> tuple[float, float]:
        """Smallest and largest sample."""
        low, high = self._native.value_range
        return low, high

    @property
    def bounds(self) -> Bounds:
        """World-aligned box around all supports: its lower and its upper corner."""
        return self._native.supports

    @property
    def centre_bounds(self) -> Bounds:
        """World-aligned box around all kernel centres: its lower and its upper corner."""
        return self._native.centres

    @property
    def default_slice_spacing(self) -> float:
        """Distance of slices that scenes take unless told otherwise, world units. Conventions, section 3."""
        return self._native.default_slice_spacing

    @property
    def memory(self) -> int:
        """Bytes that the field keeps."""
        return self._native.memory

    def __repr__(self) -> str:
        """Return a short description."""
        nk, nj, ni = self.shape
        low, high = self.value_range
        return (
            f"RegularField({ni} x {nj} x {nk} {self.values.dtype.name}, {self._lattice}, "
            f"spacing {self._spacing}, values {low:g} to {high:g})"
        )


def as_fields(field: object, what: str) -> list[RegularField]:
    """Return one field or a sequence of fields as a list; InvalidInput for anything else and for none at all."""
    fields = [field] if isinstance(field, RegularField) else field
    if not isinstance(fields, list | tuple) or not all(isinstance(one, RegularField) for one in fields) or not fields:
        raise complain(
            f"{what} cannot be used",
            shown(field),
            "a RegularField, or a sequence of them",
            "make one with sheetsplat.RegularField(values) or sheetsplat.open(path)",
        )
    return list(fields)


def joined_bounds(boxes: list[Bounds]) -> Bounds:
    """Return the smallest box around all boxes."""
    # A field without a kernel has a box whose lower corner is the upper one.
    there = [box for box in boxes if all(low <= high for low, high in zip(*box, strict=True))] or boxes
    lower = np.min([box[0] for box in there], axis=0)
    upper = np.max([box[1] for box in there], axis=0)
    return triple("bounds", lower), triple("bounds", upper)
