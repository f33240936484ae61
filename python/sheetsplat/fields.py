"""Fields: sets of kernels whose weighted sums are the scalar that is shown. Conventions, section 2 (Fields)."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat import _memory, _sheetsplat
from sheetsplat._checks import Bounds, Triple, Vector, choice, number, numbers, optional_number, shown, triple, truth
from sheetsplat._prefilter import Coefficients, require_kernel, solve
from sheetsplat.errors import Words, complain, option_ref, unusable

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


class Field:
    """What all fields have in common: a set of kernels whose weighted sums are the scalar. Conventions, section 2.

    Made by `RegularField` and `EllipsoidField`.
    """

    __slots__ = ("_falloff", "native", "_normalization", "_w0")
    _falloff: float
    native: _sheetsplat.Field
    _normalization: str
    _w0: float

    def __init__(self) -> None:
        raise TypeError("a field is made by RegularField or EllipsoidField")

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
    def size(self) -> int:
        """Number of kernels; skipped samples are none."""
        return self.native.size

    @property
    def value_range(self) -> tuple[float, float]:
        """Smallest and largest value of a kernel; 0, 0 without kernels."""
        low, high = self.native.value_range
        return low, high

    @property
    def bounds(self) -> Bounds:
        """World-aligned box around all supports: its lower and its upper corner."""
        return self.native.supports

    @property
    def centre_bounds(self) -> Bounds:
        """World-aligned box around all kernel centres: its lower and its upper corner."""
        return self.native.centres

    @property
    def default_slice_spacing(self) -> float:
        """Distance of slices that scenes take unless told otherwise, world units. Conventions, section 3."""
        return self.native.default_slice_spacing

    @property
    def memory(self) -> int:
        """Bytes that the field keeps."""
        return self.native.memory


class RegularField(Field):
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
    prefilter
        Give the kernels coefficients in place of the samples, so that their sum passes through every sample;
        `normalization` becomes "none" then. Beyond the volume there are no kernels, as always. Costs a copy of the
        samples in float32 or float64, and while it is found about 60 bytes a sample. The kernel must be narrow enough
        to tell samples apart: (radius, falloff) = (2, 5), (2.5, 7) and (3, 8) are, and the middle one is the best.
    nan
        What a NaN sample is: "error", or "skip" for "no sample there".

    Raises
    ------
    InvalidInput
        For empty arrays, other than three axes, other than real numbers, NaN (unless skipped), infinities, and for
        spacing, radius, falloff or w0 that are not positive; with `prefilter` for normalisation "threshold", for any
        NaN, and for kernels whose sums lose the samples.
    OutOfMemory
        Where the copy of the samples does not fit, or what `prefilter` needs.
    """

    __slots__ = ("_condition", "_lattice", "_nan", "_origin", "_radius", "_residual", "_samples", "_spacing")
    native: _sheetsplat.RegularField
    _condition: float | None
    _residual: float | None
    _samples: NDArray[Any] | None

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
        prefilter: bool = False,
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
        samples = as_samples(values)
        self._residual = self._condition = self._samples = None
        if truth("RegularField: prefilter", prefilter):
            found = self._prefiltered(samples)
            self._normalization = "none"
            self._residual, self._condition = found.residual, found.condition
            # Whoever gave the array may write to it.
            self._samples = samples.copy()
            self._samples.flags.writeable = False
            samples = found.values
        self.native = _sheetsplat.RegularField(
            samples,
            spacing=self._spacing,
            origin=self._origin,
            lattice=self._lattice,
            radius=self._radius,
            falloff=self._falloff,
            normalization=self._normalization,
            w0=self._w0,
            nan=self._nan,
        )

    def _prefiltered(self, samples: NDArray[Any]) -> Coefficients:
        """Return coefficients that interpolate; InvalidInput where something else is asked for at the same time."""
        failed = "RegularField: " + option_ref("prefilter", "true") + " cannot be used"
        if self._normalization == "threshold":
            raise complain(
                failed,
                option_ref("normalization", "threshold") + ", a mean that passes through no sample",
                option_ref("normalization", "none") + ", which " + option_ref("prefilter", "true") + " sets",
                "leave out one or the other",
            )
        kind, spacing, origin = samples.dtype, self._spacing, self._origin
        # Kernel, place and emptiness are judged as ever, before anything is solved.
        _sheetsplat.RegularField(
            np.zeros((1, 1, 1) if samples.size else samples.shape, kind),
            spacing=spacing,
            origin=origin,
            lattice=self._lattice,
            radius=self._radius,
            falloff=self._falloff,
            normalization="none",
            w0=self._w0,
            nan=self._nan,
        )
        require_kernel(self._radius, self._falloff, self._lattice)
        if kind.kind == "f":
            for k, layer in enumerate(samples):
                bad = ~np.isfinite(layer)
                if bad.any():
                    j, i = np.argwhere(bad)[0]
                    skips = self._nan == "skip" and np.isnan(layer[j, i])
                    raise complain(
                        failed,
                        f"{layer[j, i]} at sample ({i}, {j}, {k})"
                        + (", which " + option_ref("nan", "skip") + " leaves out" if skips else ""),
                        "finite numbers, since each coefficient depends on the samples all around it",
                        "fill such samples before, or leave out " + option_ref("prefilter"),
                    )
        # The samples, the coefficients, and the field's own copy of them.
        kept = samples.itemsize + 2 * max(samples.itemsize, 4)
        _memory.require(samples.size * kept, f"the coefficients of {' x '.join(map(str, samples.shape))} samples")
        return solve(samples, self._radius, self._falloff, self._lattice)

    @property
    def values(self) -> NDArray[Any]:
        """The samples, shape (nk, nj, ni), in the type in which they are kept; read-only, no copy."""
        return self.native.values if self._samples is None else self._samples

    @property
    def value_range(self) -> tuple[float, float]:
        """Smallest and largest sample, which coefficients may exceed; 0, 0 without samples."""
        if self._samples is None:
            return super().value_range
        return float(self._samples.min()), float(self._samples.max())

    @property
    def memory(self) -> int:
        """Bytes that the field keeps."""
        return super().memory + (0 if self._samples is None else self._samples.nbytes)

    @property
    def prefilter(self) -> bool:
        """Whether the kernels' sum passes through the samples."""
        return self._samples is not None

    @property
    def coefficients(self) -> NDArray[Any]:
        """What the kernels are multiplied by, [k, j, i]: the samples unless prefiltered; read-only, no copy."""
        return self.native.values

    @property
    def prefilter_residual(self) -> float | None:
        """Largest distance of the sum from a sample, over the largest sample; None unless prefiltered."""
        return self._residual

    @property
    def prefilter_condition(self) -> float | None:
        """How many times errors may grow from samples to coefficients, at the most; None unless prefiltered."""
        return self._condition

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
    def nan(self) -> str:
        """What a NaN sample is: "error" or "skip"."""
        return self._nan

    def __repr__(self) -> str:
        """Return a short description."""
        nk, nj, ni = self.shape
        low, high = self.value_range
        return (
            f"RegularField({ni} x {nj} x {nk} {self.values.dtype.name}, {self._lattice}, "
            f"spacing {self._spacing}, values {low:g} to {high:g}{', prefiltered' if self.prefilter else ''})"
        )


_FEWER = "use fewer kernels at a time"
# Matrices that are factored in one go; 1 MB of each array.
_BLOCK = 1 << 14
# Relative to the largest entry: what rounding to float32 leaves is far below it, what is no covariance far above.
_SYMMETRY = 1e-5
_POSITIVE = 1e-6
_ORTHOGONAL = 1e-3


def _rows(what: str, array: object, wanted: str, *shapes: tuple[int, ...]) -> NDArray[Any]:
    """Return an array of N rows, each of one of these shapes; InvalidInput otherwise. N = 0 has any shape."""
    found = numbers(f"EllipsoidField: {what}", array, wanted)
    if found.ndim == 1 and found.size == 0 and () not in shapes:
        return found.reshape(0, *shapes[0])
    if found.ndim == 0 or found.shape[1:] not in shapes:
        then: str | Words = ""
        if what == "rotations" and found.ndim == 1:
            then = "pass the values by name, " + option_ref("values", "...")
        raise complain(unusable(f"EllipsoidField: {what}"), f"an array of shape {found.shape}", wanted, then)
    return found


def _no_rows(what: str) -> Exception:
    return complain(
        unusable(f"EllipsoidField: {what}"), "None", "one number for each kernel", "pass " + option_ref(what, "...")
    )


def _same_length(count: int, **arrays: NDArray[Any] | None) -> None:
    for name, array in arrays.items():
        if array is not None and len(array) != count:
            raise complain(
                "EllipsoidField: the arrays do not fit together",
                f"{count} centers and {len(array)} {name}",
                "as many of each",
                "give one entry for each kernel",
            )


class EllipsoidField(Field):
    """Scattered Gaussians of any place, size and direction ([NM06]). Immutable.

    Kernel i is the ellipsoid around ``centers[i]`` whose semi-axes are ``scales[i]`` long and turned by
    ``rotations[i]``; within it lies the profile (exp(−k r²) − exp(−k)) / (1 − exp(−k)), r the distance from the centre
    in semi-axes, times ``weights[i]``, and times ``values[i]`` where values are summed. Conventions, section 2
    (Fields).

    All arrays are copied, anything that NumPy can read, and kept as float64: 40 bytes a kernel for spheres, 56 for
    ellipsoids, 32 more where they are turned, 8 more with weights. A field may have no kernels at all; its picture is
    empty. Two kernels may be at the same place.

    Parameters
    ----------
    centers
        (N, 3), world units.
    scales
        Semi-axes of the supports in world units, (N, 3) along each kernel's own axes, or (N,) for spheres. For a
        Gaussian with the standard deviation σ that is sqrt(2 k) σ, 4 σ at the falloff 8.
    rotations
        (N, 4) unit quaternions w, x, y, z, or (N, 3, 3) matrices whose columns are the kernel's own axes in the world;
        none is turned unless given. Quaternions within 1e-3 of unit length are normalised, and matrices within 1e-3 of
        orthogonal ones brought to the nearest rotation. A reflection spans the ellipsoid of the rotation that is its
        negative, and becomes that one. Spheres keep no rotations.
    values
        (N,), the scalars.
    weights
        (N,), at least 0 and not all 0; 1 unless given.
    normalization
        How sums become the scalar: "threshold" (D / max(w0, W), [NM06] eq. 20), "none" (D), or "lattice" (D/C) for
        kernels of equal volume.
    w0
        Threshold of "threshold", > 0. Where less weight than this adds up, the scalar falls to 0.
    falloff
        k of the profile, > 0.
    min_scale
        World units; shorter semi-axes, 0 too, are raised to it.
    cell_volume
        For "lattice": the volume that one kernel stands for.

    Raises
    ------
    InvalidInput
        With the index of the first offending kernel: for numbers that are not finite, semi-axes that are not positive,
        rotations that are none, negative weights. For arrays of other shapes or unequal length, and for options without
        meaning.
    OutOfMemory
        Where the copies do not fit.
    """

    __slots__ = ("_cell_volume", "_ghosts", "_min_scale")
    native: _sheetsplat.EllipsoidField

    def __init__(
        self,
        centers: ArrayLike,
        scales: ArrayLike,
        rotations: ArrayLike | None = None,
        values: ArrayLike | None = None,
        *,
        weights: ArrayLike | None = None,
        normalization: Normalization = "threshold",
        w0: float = 1.0,
        falloff: float = 8.0,
        min_scale: float | None = None,
        cell_volume: float | None = None,
    ) -> None:
        self._normalization = choice("EllipsoidField: normalization", normalization, ("none", "lattice", "threshold"))
        self._w0 = number("EllipsoidField: w0", w0)
        self._falloff = number("EllipsoidField: falloff", falloff)
        self._min_scale = optional_number("EllipsoidField: min_scale", min_scale)
        self._cell_volume = optional_number("EllipsoidField: cell_volume", cell_volume)
        self._ghosts = 0
        if values is None:
            raise _no_rows("values")
        places = _rows("centers", centers, "(N, 3) world positions", (3,))
        count = len(places)
        if isinstance(scales, int | float) and not isinstance(scales, bool):
            # One radius for all.
            scales = np.full(len(places), float(scales))
        sizes = _rows("scales", scales, "(N, 3) or (N,) semi-axes", (3,), ())
        turns = None
        if rotations is not None:
            wanted = "(N, 4) quaternions w, x, y, z or (N, 3, 3) matrices"
            turns = _rows("rotations", rotations, wanted, (4,), (3, 3))
        heights = _rows("values", values, "(N,) numbers", ())
        masses = None if weights is None else _rows("weights", weights, "(N,) numbers", ())
        _same_length(count, scales=sizes, rotations=turns, values=heights, weights=masses)
        # What is kept, and the smallest semi-axes for their median.
        doubles = 5 + (3 if sizes.ndim == 2 else 1) + (4 if turns is not None else 0) + (1 if masses is not None else 0)
        _memory.require(8 * doubles * count, f"a field of {count} ellipsoids", _FEWER)
        self.native = _sheetsplat.EllipsoidField(
            places,
            sizes,
            turns,
            heights,
            weights=masses,
            normalization=self._normalization,
            w0=self._w0,
            falloff=self._falloff,
            min_scale=self._min_scale,
            cell_volume=self._cell_volume,
        )

    @classmethod
    def from_covariances(
        cls,
        centers: ArrayLike,
        covariances: ArrayLike,
        values: ArrayLike,
        *,
        weights: ArrayLike | None = None,
        normalization: Normalization = "threshold",
        w0: float = 1.0,
        falloff: float = 8.0,
        min_scale: float | None = None,
        cell_volume: float | None = None,
    ) -> EllipsoidField:
        """Return a field of the Gaussians exp(−xᵀ C⁻¹ x / 2).

        Each C is factored once, in float64, into axes and standard deviations; the semi-axes of the supports are
        sqrt(2 k) standard deviations, 4 at the falloff 8, so that exp(−k r²) is exactly that Gaussian, cut off and
        lowered where it is exp(−k). Axes thinner than some 1e-7 of a kernel's longest one are lost in a covariance;
        frames, or scales and rotations, keep them.

        Parameters
        ----------
        centers
            (N, 3), world units.
        covariances
            (N, 3, 3), symmetric to within 1e-5 of their largest entry, and positive definite. What is flat, with a
            variance that is 0 within rounding, needs `min_scale`.
        values
            (N,), the scalars.
        weights, normalization, w0, falloff, cell_volume
            As for `EllipsoidField`.
        min_scale
            As for `EllipsoidField`: of semi-axes, not of standard deviations.

        Raises
        ------
        InvalidInput
            With the index, for covariances that are not symmetric or not positive definite; as for `EllipsoidField`.
        OutOfMemory
            Where the copies do not fit.
        """
        k = number("EllipsoidField: falloff", falloff)
        given = _rows("covariances", covariances, "(N, 3, 3) covariances", (3, 3))
        _memory.require(8 * 7 * len(given), f"the axes of {len(given)} covariances", _FEWER)
        scales, rotations = np.empty((len(given), 3)), np.empty((len(given), 4))
        for start in range(0, len(given), _BLOCK):
            part = slice(start, start + _BLOCK)
            variances, axes = _axes_of(given[part].astype(np.float64), start, flat=min_scale is not None)
            scales[part] = np.sqrt(variances) * math.sqrt(2.0 * max(k, 0.0))
            rotations[part] = _sheetsplat.nearest_rotations(axes)
        return cls(
            centers,
            scales,
            rotations,
            values,
            weights=weights,
            normalization=normalization,
            w0=w0,
            falloff=falloff,
            min_scale=min_scale,
            cell_volume=cell_volume,
        )

    @classmethod
    def from_frames(
        cls,
        centers: ArrayLike,
        frames: ArrayLike,
        values: ArrayLike,
        *,
        weights: ArrayLike | None = None,
        normalization: Normalization = "threshold",
        w0: float = 1.0,
        falloff: float = 8.0,
        min_scale: float | None = None,
        cell_volume: float | None = None,
    ) -> EllipsoidField:
        """Return a field of ellipsoids whose semi-axes are given as vectors.

        Parameters
        ----------
        centers
            (N, 3), world units.
        frames
            (N, 3, 3); the columns of each matrix are the three semi-axes of the support, world units, at right angles
            to each other (cosines of at most 1e-3; the nearest right angles are taken). The sign of a column does not
            matter. A column of length 0 needs `min_scale`.
        values
            (N,), the scalars.
        weights, normalization, w0, falloff, min_scale, cell_volume
            As for `EllipsoidField`.

        Raises
        ------
        InvalidInput
            With the index, for semi-axes that are not at right angles; as for `EllipsoidField`.
        OutOfMemory
            Where the copies do not fit.
        """
        given = _rows("frames", frames, "(N, 3, 3) frames", (3, 3))
        _memory.require(8 * 7 * len(given), f"the axes of {len(given)} frames", _FEWER)
        scales, rotations = np.empty((len(given), 3)), np.empty((len(given), 4))
        for start in range(0, len(given), _BLOCK):
            part = slice(start, start + _BLOCK)
            lengths, axes = _lengths_of(given[part].astype(np.float64), start, flat=min_scale is not None)
            scales[part] = lengths
            rotations[part] = _sheetsplat.nearest_rotations(axes)
        return cls(
            centers,
            scales,
            rotations,
            values,
            weights=weights,
            normalization=normalization,
            w0=w0,
            falloff=falloff,
            min_scale=min_scale,
            cell_volume=cell_volume,
        )

    @property
    def centers(self) -> NDArray[np.float64]:
        """Centres, (N, 3), world units; read-only, no copy."""
        return self.native.centers

    @property
    def scales(self) -> NDArray[np.float64]:
        """Semi-axes of the supports, world units: (N,) for spheres, else (N, 3); read-only, no copy."""
        return self.native.scales

    @property
    def rotations(self) -> NDArray[np.float64] | None:
        """Unit quaternions w, x, y, z, (N, 4), or None where no kernel is turned; a read-only copy."""
        return self.native.rotations

    @property
    def values(self) -> NDArray[np.float64]:
        """The scalars, (N,); read-only, no copy."""
        return self.native.values

    @property
    def weights(self) -> NDArray[np.float64] | None:
        """The weights, (N,), or None where each is 1; read-only, no copy."""
        return self.native.weights

    @property
    def min_scale(self) -> float | None:
        """What shorter semi-axes were raised to, world units, or None."""
        return self._min_scale

    @property
    def cell_volume(self) -> float | None:
        """For normalisation "lattice": the volume that one kernel stands for, or None."""
        return self._cell_volume

    @property
    def isotropic(self) -> bool:
        """Whether the kernels were given as spheres."""
        return self.native.isotropic

    @property
    def scale_range(self) -> tuple[float, float]:
        """Smallest and largest semi-axis, world units; 0, 0 without kernels."""
        low, high = self.native.scale_range
        return low, high

    @property
    def weight_range(self) -> tuple[float, float]:
        """Smallest and largest weight; 1, 1 without kernels."""
        low, high = self.native.weight_range
        return low, high

    @property
    def ghosts(self) -> int:
        """Number of ghost points, the last ones of the kernels."""
        return self._ghosts

    def at(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the field's scalar at points (M, 3) in the world, shape (M,); 0 where no kernel reaches.

        Raises
        ------
        InvalidInput
            For anything but M times three finite numbers.
        """
        sums = self._sums_at(points)
        divisor: Any = 1.0
        if self._normalization == "lattice":
            divisor = self.native.lattice_constant
        elif self._normalization == "threshold":
            divisor = np.maximum(self._w0, sums[:, 1])
        found: NDArray[np.float64] = sums[:, 0] / divisor
        return found

    def weight_at(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the sum W of weights at points (M, 3) in the world, shape (M,): where it is small the data are thin.

        Raises
        ------
        InvalidInput
            For anything but M times three finite numbers.
        """
        found: NDArray[np.float64] = self._sums_at(points)[:, 1]
        return found

    def _sums_at(self, points: ArrayLike) -> NDArray[np.float64]:
        places = _rows("points", points, "(M, 3) world positions", (3,))
        # The points and the tree that finds them.
        _memory.require(96 * len(places), f"{len(places)} points", "ask for fewer points at a time")
        if not np.isfinite(places).all():
            n = int(np.flatnonzero(~np.isfinite(places).all(axis=1))[0])
            raise complain("EllipsoidField: a point cannot be used", f"{places[n]}, point {n}", "three finite numbers")
        return self.native.sums_at(places)

    def with_ghost_points(self, *, distance: float = 1.0, weight: float = 1.0) -> EllipsoidField:
        """Return the field with ghost points around it: kernels of value 0 that end the data softly ([NM06] §4.1).

        At the border of scattered data the weights thin out, and D / W, which stays as high as the outermost values,
        ends abruptly. (With the threshold w0 = 1 it falls as soon as W does, and ghost points change little; they are
        for small w0.) Ghost points carry the weights on, so that the scalar falls to 0 within one support.

        Around each kernel 14 places are tried, along its semi-axes and the diagonals between them. A place becomes a
        ghost of that kernel's own shape, however flat or turned that is, unless a support reaches the place, or the
        ghost would reach the centre of a kernel: so the scalar at every centre stays what it was, and there are no
        ghosts in the inside of well covered data. Of places closer together than half of a kernel's smallest semi-axis
        one is kept; there are never more than 14 ghosts a kernel. Kernels of weight 0 have none.

        The ghosts are ordinary kernels, the last `ghosts` of the new field, and count for its bounds and for its
        default slice distance. Without normalisation "threshold" they do not change the scalar, only where the field
        is empty.

        Parameters
        ----------
        distance
            From a kernel's centre to its ghost's, in the kernel's semi-axes: 1, where the support ends, to 2, where
            the two supports just touch.
        weight
            Of each ghost, > 0. Take the mean weight of the data where that is far from 1.

        Raises
        ------
        InvalidInput
            For a distance or a weight without meaning, and for a field that has ghost points.
        OutOfMemory
            Where the ghosts do not fit.
        """
        away = number("EllipsoidField: distance of ghost points", distance)
        mass = number("EllipsoidField: weight of ghost points", weight)
        if not 1.0 <= away <= 2.0:
            raise complain("EllipsoidField: the distance of ghost points cannot be used", f"{away:g}", "from 1 to 2")
        if not 0.0 < mass <= 1e300:
            raise complain(
                "EllipsoidField: the weight of ghost points cannot be used", f"{mass:g}", "a finite number above 0"
            )
        if self._ghosts:
            raise complain(
                "EllipsoidField: ghost points cannot be added",
                f"a field with {self._ghosts} of them",
                "a field without",
                "call with_ghost_points on the field of the data alone",
            )
        # The tree of the centres.
        _memory.require(96 * self.size, f"the ghost points of {self.size} kernels", _FEWER)
        owners, places = self.native.ghost_points(away, (_memory.available() - 96 * self.size) // 256)
        count = len(owners)
        kept = 8 * sum(array[:1].size for array in (self.centers, self.scales, self.values)) + 48
        _memory.require(2 * kept * (self.size + count), f"a field with {count} ghost points", _FEWER)
        rotations, weights = self.rotations, self.weights
        if weights is None and mass != 1.0:
            weights = np.ones(self.size)
        field = EllipsoidField(
            np.concatenate((self.centers, places)),
            np.concatenate((self.scales, self.scales[owners])),
            None if rotations is None else np.concatenate((rotations, rotations[owners])),
            np.concatenate((self.values, np.zeros(count))),
            weights=None if weights is None else np.concatenate((weights, np.full(count, mass))),
            normalization=self._normalization,  # type: ignore[arg-type]
            w0=self._w0,
            falloff=self._falloff,
            cell_volume=self._cell_volume,
        )
        field._min_scale = self._min_scale
        field._ghosts = count
        return field

    def __repr__(self) -> str:
        """Return a short description."""
        low, high = self.value_range
        thin, long = self.scale_range
        kinds = "spheres" if self.isotropic else "ellipsoids"
        ghosts = f", {self._ghosts} of them ghost points" if self._ghosts else ""
        return (
            f"EllipsoidField({self.size} {kinds}{ghosts}, semi-axes {thin:g} to {long:g}, values {low:g} to {high:g}, "
            f"normalization {self._normalization!r})"
        )


def _first(bad: Any, start: int) -> int:
    """Return the index of the first kernel of a block that is bad."""
    return start + int(np.flatnonzero(bad)[0])


def _refuse_infinite(what: str, matrices: NDArray[np.float64], start: int) -> None:
    bad = ~(np.abs(matrices) <= 1e200).all(axis=(1, 2))
    if bad.any():
        n = _first(bad, start)
        raise complain(
            f"EllipsoidField: a {what} cannot be used",
            f"{shown(matrices[n - start].tolist())}, the {what} of kernel {n}",
            "finite numbers of at most 1e200",
        )


def _axes_of(
    covariances: NDArray[np.float64], start: int, *, flat: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return variances (N, 3), at least 0, and axes as columns (N, 3, 3); `flat` ones have variances of 0."""
    _refuse_infinite("covariance", covariances, start)
    largest = np.abs(covariances).max(axis=(1, 2))
    turned = covariances.transpose(0, 2, 1)
    lean = np.abs(covariances - turned).max(axis=(1, 2))
    bad = lean > _SYMMETRY * largest
    if bad.any():
        n = _first(bad, start)
        raise complain(
            "EllipsoidField: a covariance cannot be used",
            f"the matrix of kernel {n}, whose two halves differ by {lean[n - start]:g}",
            "symmetric matrices",
            "for semi-axes as columns use EllipsoidField.from_frames",
        )
    variances, axes = np.linalg.eigh(0.5 * (covariances + turned))
    # What rounding makes of a 0 is no variance; what is farther below 0 never was one.
    rounding = 4.0 * np.finfo(np.float64).eps * largest[:, np.newaxis]
    bad = ((variances < -_POSITIVE * largest[:, np.newaxis]) | ((variances <= rounding) & (not flat))).any(axis=1)
    if bad.any():
        n = _first(bad, start)
        least = float(variances[n - start].min())
        is_flat = least >= -_POSITIVE * largest[n - start]
        raise complain(
            "EllipsoidField: a covariance cannot be used",
            f"the matrix of kernel {n}, whose smallest variance is {least:g}",
            "positive definite matrices",
            "pass " + option_ref("min_scale", "...") + ", which gives flat kernels a thickness"
            if is_flat
            else "remove or correct that kernel",
        )
    return np.where(variances <= rounding, 0.0, variances), axes


def _lengths_of(
    frames: NDArray[np.float64], start: int, *, flat: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lengths of the columns (N, 3), and orthogonal matrices of their directions (N, 3, 3)."""
    _refuse_infinite("frame", frames, start)
    # By each column's own largest entry, so that no square over- or underflows.
    largest = np.abs(frames).max(axis=1)
    unit = frames / np.where(largest > 0.0, largest, 1.0)[:, np.newaxis, :]
    norms = np.linalg.norm(unit, axis=1)
    lengths: NDArray[np.float64] = largest * norms
    missing = lengths == 0.0
    if missing.any() and not flat:
        n = _first(missing.any(axis=1), start)
        raise complain(
            "EllipsoidField: a kernel has no thickness",
            f"a semi-axis of length 0 of kernel {n}",
            "semi-axes above 0",
            "pass " + option_ref("min_scale", "...") + ", to which shorter semi-axes are raised",
        )
    unit /= np.where(missing, 1.0, norms)[:, np.newaxis, :]
    cosines = np.abs(unit.transpose(0, 2, 1) @ unit) * (1.0 - np.eye(3))
    lean = cosines.max(axis=(1, 2))
    bad = lean > _ORTHOGONAL
    if bad.any():
        n = _first(bad, start)
        raise complain(
            "EllipsoidField: a frame cannot be used",
            f"columns of the frame of kernel {n} with a cosine of {lean[n - start]:g} between them",
            "columns at right angles, with cosines of at most 1e-3",
            "for frames that are not orthogonal use EllipsoidField.from_covariances with M Mᵀ / (2 falloff)",
        )
    some = missing.any(axis=1)
    if some.any():
        # Directions that are missing are any that complete the others.
        left, _, right = np.linalg.svd(unit[some])
        unit[some] = left @ right
    return lengths, unit


def as_fields(field: object, what: str) -> list[Field]:
    """Return one field or a sequence of fields as a list; InvalidInput for anything else and for none at all."""
    fields = [field] if isinstance(field, Field) else field
    if not isinstance(fields, list | tuple) or not all(isinstance(one, Field) for one in fields) or not fields:
        raise complain(
            f"{what} cannot be used",
            shown(field),
            "a RegularField, an EllipsoidField, or a sequence of them",
            "make one with sheetsplat.RegularField(values), sheetsplat.EllipsoidField or sheetsplat.open(path)",
        )
    return list(fields)


def joined_bounds(boxes: list[Bounds]) -> Bounds:
    """Return the smallest box around all boxes."""
    # A field without a kernel has a box whose lower corner is the upper one.
    there = [box for box in boxes if all(low <= high for low, high in zip(*box, strict=True))] or boxes
    lower = np.min([box[0] for box in there], axis=0)
    upper = np.max([box[1] for box in there], axis=0)
    return triple("bounds", lower), triple("bounds", upper)
