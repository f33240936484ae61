"""Regular volumes: kernels at the samples of a Cartesian or a body-centred cubic lattice."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Literal, Self, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat import _memory, _sheetsplat
from sheetsplat._checks import Bounds, Triple, Vector, as_array, choice, number, optional_number, triple, truth
from sheetsplat._properties import Forwarded
from sheetsplat.errors import complain
from sheetsplat.fields import ending, labelled
from sheetsplat.fields.apart import Apart
from sheetsplat.fields.base import NOT_OPENED, Field, NanPolicy, Normalization
from sheetsplat.fields.samples import ArraySamples, Samples
from sheetsplat.fields.stated import Stated, Stating
from sheetsplat.fields.trim import Trim
from sheetsplat.quantity import Quantity

Lattice = Literal["cartesian", "bcc"]
Boundary = Literal["edge", "zero"]

BOUNDARIES: tuple[str, ...] = get_args(Boundary)

_KEPT = ("uint8", "int16", "uint16", "float32", "float64")
_FAILED = "RegularField: the samples cannot be used"
#: Radius and falloff of kernels whose sums are the samples, smoothed a little.
PLAIN_KERNEL = (2.0, 5.0)
# All that a field is made of, beside its samples and coefficients.
PARTS = (
    *("_spacing", "_origin", "_lattice", "_radius", "_falloff", "_normalization", "_w0", "_nan", "_settled"),
    *("_boundary", "_base", "_axes", "_labels", "_colors"),
)
# Lattices are the same where no sample lies farther from its like, in the shortest step.
_ALIKE = 1e-3
# Kernels that are summed at points in one call: a fraction of a second.
_SUMMED_AT_ONCE = 1 << 26


def narrowest(low: int, high: int) -> np.dtype[Any]:
    """Return the smallest kept type that holds all integers of a range exactly."""
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


def kept_type(native: np.dtype[Any]) -> np.dtype[Any] | None:
    """Return the type in which samples of a type are kept; None where that depends on their values."""
    if native.name in _KEPT:
        return native
    if native.kind == "b":
        return np.dtype(np.uint8)
    return np.dtype(np.float32) if native == np.float16 else None


def _kept_type(values: NDArray[Any]) -> np.dtype[Any]:
    """Return the type in which the samples are kept; no value changes by it."""
    native = values.dtype.newbyteorder("=")
    known = kept_type(native)
    if known is not None:
        return known
    if native.kind in "iu":
        return narrowest(int(values.min()), int(values.max())) if values.size else np.dtype(np.float64)
    if native.kind == "f":
        with np.errstate(over="ignore"):
            shorter = values.astype(np.float64)
        if not np.array_equal(shorter, values, equal_nan=True):
            raise complain(
                _FAILED, f"{native.name} values that float64 cannot hold", "at most float64", "use values.astype(float)"
            )
        return np.dtype(np.float64)
    raise complain(_FAILED, f"values of type {native}", "integers, booleans or real floating-point numbers")


def as_samples(values: ArrayLike, *, contiguous: bool = True) -> NDArray[Any]:
    """Return `values` as a contiguous array [k, j, i] of a type that fields keep, without loss.

    Unless it need be contiguous, there may be gaps between rows. Masked entries become NaN. Raises InvalidInput for
    other types and for anything but three axes, OutOfMemory where a copy would not fit.
    """
    if isinstance(values, np.ma.MaskedArray):
        if np.ma.is_masked(values):
            wide = np.float32 if values.dtype.itemsize <= 2 else np.float64
            array: NDArray[Any] = np.ma.filled(values.astype(wide), np.nan)
        else:
            array = values.data
    else:
        array = as_array(_FAILED, values, "an array of numbers with three axes")
    if array.ndim != 3:
        advice = "choose one channel or one time step" if array.ndim > 3 else "reshape it to (nk, nj, ni)"
        if array.ndim == 2 and array.shape[1] in (3, 4):
            advice = (
                "if these are points, give them and their values to sheetsplat.fit.nearest or sheetsplat.fit.delaunay, "
                "or their radii to sheetsplat.EllipsoidField; a volume: " + advice
            )
        raise complain(_FAILED, f"{array.ndim} axes, shape {array.shape}", "three axes, values[k, j, i]", advice)
    if array.dtype.kind not in "biuf":
        raise complain(_FAILED, f"values of type {array.dtype}", "integers, booleans or real floating-point numbers")
    # The copy that the field keeps; conversions of type, byte order or layout take another.
    _memory.require(array.size * array.dtype.itemsize, f"a copy of the samples, {' x '.join(map(str, array.shape))}")
    kept = np.asarray(array, dtype=_kept_type(array))
    if not contiguous and kept.flags.aligned and kept.strides[2] == kept.itemsize:
        return kept
    return np.require(kept, requirements=("C", "A"))


def one_place(options: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Return options of a field with either axes or a spacing: the one that was changed, else the axes if any."""
    dropped = "spacing" if options["axes"] is not None and changes.get("spacing") is None else "axes"
    return {name: one for name, one in options.items() if name != dropped}


def _axes_of(axes: ArrayLike, spacing: Vector | None) -> tuple[Triple, Triple, Triple]:
    """Return the steps of i, j and k, the rows of a matrix."""
    failed = "RegularField: axes cannot be used"
    rows = as_array(failed, axes, "(3, 3) numbers, the steps of i, j and k as rows")
    if rows.shape == (9,):
        rows = rows.reshape(3, 3)
    if rows.shape != (3, 3):
        raise complain(failed, f"an array of shape {rows.shape}", "(3, 3), the steps of i, j and k as rows")
    if spacing is not None:
        raise complain(failed, "spacing beside axes", "one of the two", "leave out spacing: axes have lengths")
    i, j, k = (triple("RegularField: axes", row) for row in rows)
    return i, j, k


class RegularField(Stating, Apart, Field):
    """A Cartesian or body-centred cubic volume. Immutable.

    Sample (i, j, k) of ``values[k, j, i]`` is a kernel at ``origin + (i dx, j dy, k dz)`` (Cartesian) or at
    ``origin + ((i + (k mod 2)/2) a, (j + (k mod 2)/2) a, k a/2)`` (BCC). Conventions, section 2 (Fields).

    Parameters
    ----------
    values
        Array of shape (nk, nj, ni), anything that NumPy can read. uint8, int16, uint16, float32 and float64 are kept as
        they are; other real types are converted to one of these without loss; masked entries count as NaN. Of shape
        (nk, nj, ni, 3) or (nk, nj, ni, 4): red, green, blue and opacity, uint8, uint16 or numbers from 0 to 1; the
        scalar is the opacity from 0 to 1, without a fourth component 0.2126 red + 0.7152 green + 0.0722 blue.
    spacing
        World units between samples along x, y, z; for ``lattice="bcc"`` its first entry is the edge a.
    origin
        World position of sample (0, 0, 0).
    axes
        (3, 3), in place of `spacing`: rows are the steps of i, j and k in the world, three directions that are not
        coplanar, of a Cartesian lattice. Sample (i, j, k) is at ``origin + (i, j, k) @ axes``, kernels are spheres in
        index space, and `spacing` is the length of each step.
    labels
        The samples are whole numbers that name things and are never mixed: pictures show which label weighs most at a
        point, in the colours of a `LabelColors`. `normalization`, `prefilter` and `base` stay as they are.
    lattice
        "cartesian" or "bcc".
    radius
        Radius of a kernel's support in sample distances (BCC: of a/√2); unequal spacing: per axis.
    falloff
        k of the kernel (exp(−k r²) − exp(−k)) / (1 − exp(−k)).
    normalization
        How sums become the scalar, offset by `base`: "none" (D), "lattice" (D/C) or "threshold" (D / max(w0, W)).
    w0
        Threshold of "threshold", > 0.
    prefilter
        Give the kernels coefficients in place of the samples, so that their sum passes through every sample;
        `normalization` is then "none". The field keeps the coefficients beside the samples, in float32 or float64; 4
        bytes a sample more are needed while they are computed. The kernel must be narrow enough to resolve the samples:
        (radius, falloff) = (2, 5), (2.5, 7) and (3, 8) are; (2.5, 7) is the best. None: the field has plain sums, and
        `sheetsplat.render` shows it with the kernels of its quality, as it shows an array; False: the field is shown
        with plain sums at every quality.
    nan
        What a NaN sample is: "error", or "skip" for a missing sample, which has no kernel.
    boundary
        What lies beyond the outermost samples. "edge": the samples are mirrored there, and the field ends half a sample
        distance beyond the outermost ones (`domain`); pictures are empty outside. "zero": nothing, and the field falls
        to `base` within a kernel's radius ([NM05]). A BCC lattice of one layer counts as "zero".
    base
        The value that all values are offset by; the scalar where no kernel reaches. Unless given, 0 with the
        boundary "zero" and with the normalisation "none"; else the value of the first sample that is not missing, if at
        least one sample in a hundred has it, else the middle between the least and the largest.

    Raises
    ------
    InvalidInput
        For empty arrays, other than three axes, other than real numbers, NaN (unless skipped), infinities, a base that
        is not finite, for axes that are coplanar or given beside `spacing` or for a BCC lattice, and for spacing,
        radius, falloff or w0 that are not positive; with `prefilter` for normalisation
        "threshold", for any NaN, and for kernels whose sums lose the samples.
    OutOfMemory
        Where the copy of the samples does not fit, or what `prefilter` needs.

    Examples
    --------
    >>> field = ss.RegularField(np.ones((4, 5, 6)), spacing=(0.5, 0.5, 2.0))  # 6 samples along x, 4 along z
    >>> field.size, field.spacing
    (120, (0.5, 0.5, 2.0))
    """

    __slots__ = (
        *("_axes", "_base", "_boundary", "_colors", "_labels", "_lattice", "_nan", "_origin", "_parts_made"),
        *("_radius", "_settled", "_spacing", "_stated"),
    )
    native: _sheetsplat.RegularField

    def __init__(
        self,
        values: ArrayLike,
        *,
        spacing: Vector | None = None,
        origin: Vector = (0.0, 0.0, 0.0),
        lattice: Lattice = "cartesian",
        radius: float = PLAIN_KERNEL[0],
        falloff: float = PLAIN_KERNEL[1],
        normalization: Normalization = "lattice",
        w0: float = 1.0,
        prefilter: bool | None = None,
        nan: NanPolicy = "error",
        boundary: Boundary = "edge",
        base: float | None = None,
        axes: ArrayLike | None = None,
        labels: bool = False,
    ) -> None:
        self._quantity, self._opened, self._orientation, self._trim = Quantity(), NOT_OPENED, None, Trim()
        self._weighting, self._stated = None, Stated()
        self._place(axes, spacing)
        self._origin = triple("RegularField: origin", origin)
        self._lattice = choice("RegularField: lattice", lattice, ("cartesian", "bcc"))
        self._radius = number("RegularField: radius", radius)
        self._falloff = number("RegularField: falloff", falloff)
        self._normalization = choice("RegularField: normalization", normalization, ("none", "lattice", "threshold"))
        self._w0 = number("RegularField: w0", w0)
        self._nan = choice("RegularField: nan", nan, ("error", "skip"))
        self._boundary = choice("RegularField: boundary", boundary, BOUNDARIES)
        self._base = optional_number("RegularField: base", base)
        self._settled = prefilter is not None
        self._labels = truth("RegularField: labels", labels)
        self._parts_made: dict[Any, Any] = {}
        self._colors: NDArray[Any] | None = None
        if not self._labels:
            values, self._colors = labelled.split_colors(values)
        wanted = prefilter is not None and truth("RegularField: prefilter", prefilter)
        if wanted and self._normalization == "none":
            # That of the coefficients: the base is the one of the samples.
            self._normalization = "lattice"
        samples = as_samples(values, contiguous=False)
        if self._labels:
            mixing: Any = {"prefilter": (wanted, False), "normalization": (self._normalization, "lattice")}
            labelled.require_labels(samples, **mixing, base=(self._base or 0.0, 0.0))
        if self._colors is not None:
            self._base = 0.0
        self.native = self._made(samples, prefilter=wanted)
        if self.prefilter:
            self._normalization = "none"

    def _place(self, axes: ArrayLike | None, spacing: Vector | None) -> None:
        """Set the axes, and the spacing, which is their lengths."""
        self._axes = None if axes is None else _axes_of(axes, spacing)
        self._spacing = triple("RegularField: spacing", (1.0, 1.0, 1.0) if spacing is None else spacing)
        if self._axes is not None:
            self._spacing = triple("RegularField: axes", np.hypot.reduce(self._axes, axis=1))

    def _made(
        self,
        samples: NDArray[Any],
        *,
        prefilter: bool = False,
        coefficients: NDArray[Any] | None = None,
        figures: dict[str, float] | None = None,
        base: float | None = None,
        boundary: str | None = None,
        **of_part: Any,
    ) -> _sheetsplat.RegularField:
        """Return the native field of some samples with this field's options.

        With coefficients that were found before goes the base that they are offset by.
        """
        return _sheetsplat.RegularField(
            samples,
            spacing=self._spacing,
            origin=self._origin,
            lattice=self._lattice,
            radius=self._radius,
            falloff=self._falloff,
            normalization=self._normalization,
            w0=self._w0,
            nan=self._nan,
            prefilter=prefilter,
            boundary=self._boundary if boundary is None else boundary,
            base=self._base if base is None else base,
            coefficients=coefficients,
            figures=figures,
            axes=self._axes,
            **of_part,
        )

    def _parts(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in PARTS} | {
            "samples": self.values,
            "coefficients": self.coefficients if self.prefilter else None,
            "figures": self.native.prefilter_figures,
            "base": self.native.base,
            "stated": self._stated,
        }

    def _restore(self, parts: dict[str, Any]) -> None:
        self._parts_made, self._stated = {}, parts["stated"]
        for name in PARTS:
            setattr(self, name, parts[name])
        self.native = self._made(
            parts["samples"], coefficients=parts["coefficients"], figures=parts["figures"], base=parts["base"]
        )

    def replace(self, values: ArrayLike | None = None, **changes: Any) -> RegularField:
        """Return a field with other samples, or some options changed, and all else as in this one.

        Parameters
        ----------
        values
            Its samples; the same ones unless given.
        changes
            Options of `RegularField`. Where only `prefilter` is taken back, the normalisation is "lattice". A base that
            was not given is found anew.

        Raises
        ------
        InvalidInput, OutOfMemory
            As `RegularField`.
        """
        options = {name.removeprefix("_"): getattr(self, name) for name in PARTS}
        options["prefilter"] = self.prefilter if options.pop("settled") else None
        colors = options.pop("colors")
        if self.prefilter:
            # The one that it set itself.
            del options["normalization"]
        made = RegularField(self.values if values is None else values, **one_place({**options, **changes}, changes))
        if values is None:
            made._colors = colors
        return made.told_by(self)

    def told_by(self, other: RegularField) -> Self:
        """Return the same field with what another one of its samples says about them."""
        same = {name: getattr(other, name) for name in ("_opened", "_orientation", "_trim", "_stated")}
        told = self._with(**same, _weighting=other._weighting_of(self.shape))
        return told.with_quantity_of_samples(other._quantity, other.spacing, other.origin, other.lattice)

    def _lies_as(self, other: Field) -> bool:
        """Return whether another volume has the same lattice."""
        if not isinstance(other, RegularField) or (self.shape, self.lattice) != (other.shape, other.lattice):
            return False
        # Of two lattices that differ in what is linear in the index, the farthest samples are at corners.
        last = np.subtract(self.shape, 1)[::-1]
        moved = np.abs(np.subtract(self.origin, other.origin)) + last @ np.abs(self.steps - other.steps)
        return bool(moved.max() <= _ALIKE * min(self.spacing))

    def with_quantity_of_samples(self, quantity: Quantity, spacing: Triple, origin: Triple, lattice: str) -> Self:
        """Return the same field with what its samples are where they lie at another spacing and origin.

        Their axes keep the coordinates of the samples; those of another lattice have none.
        """
        if self.lattice != lattice or self.axes is not None:
            quantity = dataclasses.replace(quantity, axes=())
        return self._with(_quantity=quantity.placed((spacing, self.spacing), (origin, self.origin)))

    @classmethod
    def part(
        cls,
        values: NDArray[Any],
        *,
        value_range: tuple[float, float] | None = None,
        coefficients: NDArray[Any] | None = None,
        figures: dict[str, float] | None = None,
        least_weight: float = 0.0,
        labels_found: tuple[int, ...] = (),
        **options: Any,
    ) -> RegularField:
        """Return the field of a part of a larger volume, for pictures in bricks.

        Parameters
        ----------
        values
            Samples of the part, [k, j, i].
        value_range
            Range of the factors of all kernels of the volume, offset by its base, by which pictures scale their
            numbers.
        coefficients, figures
            What the prefilter found for these samples in their surroundings.
        least_weight
            Points of a smaller sum of weights are empty.
        labels_found
            The labels that it has a native field of; those among its samples unless given.
        options
            Those of `RegularField`, except `prefilter`.
        """
        field = cls(np.zeros((1, 1, 1)), **options)
        field.native = field._made(
            as_samples(values, contiguous=False),
            coefficients=coefficients,
            figures=figures,
            value_range=value_range,
            least_weight=least_weight,
        )
        if labels_found:
            field._parts_made["found"] = labels_found
        return field

    values = Forwarded[NDArray[Any]](
        "native.given_values",
        "The samples, shape (nk, nj, ni), in the type in which they are kept; read-only, no copy. Rows may not follow "
        "each other without gaps.",
    )

    @property
    def samples(self) -> Samples:
        """Statistics of the samples from which colours and opacity are chosen."""
        return ArraySamples(self.values, self._lattice)

    @property
    def value_range(self) -> tuple[float, float]:
        """Smallest and largest sample, which coefficients may exceed; 0, 0 without samples."""
        low, high = self.native.given_range
        return low, high

    @property
    def prefilter(self) -> bool:
        """Whether the kernels' sum passes through the samples."""
        return self.native.prefilter_figures is not None

    settled = Forwarded[bool](
        "_settled",
        "Whether `prefilter` was given; if not, `sheetsplat.render` chooses kernels by its quality.",
    )

    @property
    def is_plain(self) -> bool:
        """Whether nothing was given that says how samples become sums: `prefilter`, `normalization` or a kernel."""
        return not self._settled and self._normalization == "lattice" and (self._radius, self._falloff) == PLAIN_KERNEL

    def as_settled(self) -> RegularField:
        """Return the same field, without a copy of its arrays, whose kernels stay as they are at every quality."""
        return self if self._settled else self._with(_settled=True)

    coefficients = Forwarded[NDArray[Any]](
        "native.values", "Factors of the kernels, [k, j, i]: the samples unless prefiltered; read-only, no copy."
    )

    @property
    def prefilter_residual(self) -> float | None:
        """Largest distance of the sum from a sample, over the largest sample; None unless prefiltered."""
        found = self.native.prefilter_figures
        return None if found is None else found["residual"]

    @property
    def prefilter_condition(self) -> float | None:
        """Largest amplification of errors from samples to coefficients; None unless prefiltered."""
        found = self.native.prefilter_figures
        return None if found is None else found["condition"]

    @property
    def shape(self) -> tuple[int, int, int]:
        """Samples along k, j, i."""
        nk, nj, ni = self.values.shape
        return nk, nj, ni

    spacing = Forwarded[Triple]("_spacing", "World units between samples along x, y, z (BCC: the first is the edge a).")
    axes = Forwarded[tuple[Triple, Triple, Triple] | None](
        "_axes", "Steps of i, j and k in the world, where they were given in place of the spacing."
    )
    labels = Forwarded[bool]("_labels", "Whether samples are whole numbers that name things, which are never mixed.")

    @property
    def has_values(self) -> bool:
        """Whether samples are values, and neither labels nor colours."""
        return not self._labels and self._colors is None

    origin = Forwarded[Triple]("_origin", "World position of sample (0, 0, 0).")
    lattice = Forwarded[str]("_lattice", 'Either "cartesian" or "bcc".')
    radius = Forwarded[float]("_radius", "Radius of a kernel's support, in sample distances.")
    nan = Forwarded[str]("_nan", 'What a NaN sample is: "error" or "skip".')
    boundary = Forwarded[str]("_boundary", 'What lies beyond the outermost samples: "edge" or "zero".')
    given_base = Forwarded[float | None]("_base", "The base that was given, or None.")

    @property
    def steps(self) -> NDArray[np.float64]:
        """Steps of i, j and k in the world, the rows of (3, 3); odd layers of BCC lie half of i and of j farther."""
        return ending.steps(self._lattice, self._spacing, self._axes)

    @property
    def domain(self) -> Bounds | None:
        """World-aligned box around where the volume ends, its lower and its upper corner; None: it ends nowhere."""
        if self._axes is None:
            return super().domain
        return ending.domain(self.shape, self._lattice, self._boundary, self._spacing, self._origin, self._axes)

    @property
    def kernels_at_a_point(self) -> float:
        """About how many kernels reach a point inside."""
        return 4.0 / 3.0 * math.pi * self.radius**3

    def _found(self, places: NDArray[np.float64], columns: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        # In pieces: Ctrl-C waits for each of them.
        most = max(1, int(_SUMMED_AT_ONCE / self.kernels_at_a_point))
        found = [super(RegularField, self)._found(places[n : n + most], columns) for n in range(0, len(places), most)]
        if len(found) == 1:
            return found[0]
        if not found:
            return super()._found(places, columns)
        sums, nearest = zip(*found, strict=True)
        return np.concatenate(sums), np.concatenate(nearest)

    def inside(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which points (M, 3) lie in the volume's domain, (M,)."""
        if self._axes is None or self.domain is None:
            return super().inside(points)
        places = (points - self._origin) @ np.linalg.inv(self._axes) + ending.DOMAIN
        within: NDArray[np.bool_] = np.all((places >= 0.0) & (places <= self.shape[::-1]), axis=1)
        return within

    @property
    def _least_divisor(self) -> float | None:
        least = self._least_weight
        return super()._least_divisor if least == 0.0 else least

    def __repr__(self) -> str:
        """Return a short description."""
        nk, nj, ni = self.shape
        low, high = self.value_range
        counted = f", base {self.base:g}" if self.base else ""
        boundary = ", boundary 'zero'" if self._boundary == "zero" else ""
        steps = f"spacing {self._spacing}" if self._axes is None else f"axes {self._axes}"
        return (
            f"{type(self).__name__}({ni} x {nj} x {nk} {self.samples.dtype.name}, {self._lattice}, "
            f"{steps}, values {low:g} to {high:g}{counted}{boundary}"
            f"{', prefiltered' if self.prefilter else ''}"
            f"{self._up_text})"
        )
