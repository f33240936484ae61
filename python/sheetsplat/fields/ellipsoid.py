"""Scattered Gaussians: kernels of any place, size and direction."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any, Self, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat import _memory, _sheetsplat
from sheetsplat._checks import Bounds, Triple, choice, number, numbers, optional_number, triple
from sheetsplat._properties import Forwarded
from sheetsplat._rows import usable_rows
from sheetsplat.errors import Error, Words, complain, option_ref, unusable
from sheetsplat.fields.axes import axes_of_covariances, axes_of_frames
from sheetsplat.fields.base import NOT_OPENED, Field, NanPolicy, Normalization
from sheetsplat.fields.code import Bound, Code
from sheetsplat.fields.trim import Trim
from sheetsplat.fields.wrapping import Periodic, periodic_box
from sheetsplat.quantity import Quantity

_FEWER = "use fewer kernels at a time"
_FALLOFF = 8.0
# What weights of 0 are drawn as (least_drawn_weight of the engine).
_LEAST_WEIGHT = 1e-30
# All that a field is made of: arrays of the native field, and the rest.
_ARRAYS = ("centers", "scales", "rotations", "values", "weights")
_OPTIONS = (
    *("normalization", "w0", "falloff", "min_scale", "cell_volume", "base", "periodic"),
    *("ends", "slice_spacing"),
)
_PARTS = (*(f"_{name}" for name in _OPTIONS), "_ghosts", "_ghost_options", "_keeps_mass", "_code")


# What the rows of each array are, and their shapes.
_NUMBERS: tuple[Any, ...] = ("(N,) numbers", ())
_ROWS: dict[str, tuple[Any, ...]] = {
    "centers": ("(N, 3) world positions", (3,)),
    "scales": ("(N, 3) or (N,) semi-axes", (3,), ()),
    "rotations": ("(N, 4) quaternions w, x, y, z or (N, 3, 3) matrices", (4,), (3, 3)),
    "covariances": ("(N, 3, 3) covariances", (3, 3)),
    "frames": ("(N, 3, 3) frames", (3, 3)),
    "values": _NUMBERS,
    "weights": _NUMBERS,
}


def _rows(what: str, array: object) -> NDArray[Any]:
    """Return an array of N rows, each of one of its shapes; InvalidInput otherwise. N = 0 has any shape."""
    wanted, *shapes = _ROWS[what]
    found = numbers(f"EllipsoidField: {what}", array, wanted)
    if found.ndim == 1 and found.size == 0 and () not in shapes:
        return found.reshape(0, *shapes[0])
    if found.ndim == 0 or found.shape[1:] not in shapes:
        then: str | Words = ""
        if what == "rotations" and found.ndim == 1:
            then = "pass the values by name, " + option_ref("values", "...")
        raise complain(unusable(f"EllipsoidField: {what}"), f"an array of shape {found.shape}", wanted, then)
    return found


def _kernels(nan: str, centers: object, **others: object) -> list[Any]:
    """Return checked arrays with as many rows each, None for those that are None; `nan` as for `EllipsoidField`."""
    if others["values"] is None:
        raise complain(
            unusable("EllipsoidField: values"), "None", "one number for each kernel",
            "pass " + option_ref("values", "..."),
        )  # fmt: skip
    arrays: dict[str, NDArray[Any] | None] = {"centers": (places := _rows("centers", centers))}
    for name, one in others.items():
        if name == "scales" and isinstance(one, int | float) and not isinstance(one, bool):
            # One radius for all.
            one = np.full(len(places), number("EllipsoidField: scales", one))
        found = None if one is None and name in ("rotations", "weights") else _rows(name, one)
        if found is not None and len(found) != len(places):
            raise complain(
                "EllipsoidField: the arrays do not fit together",
                f"{len(places)} centers and {len(found)} {name}",
                "as many of each",
                "give one entry for each kernel",
            )
        arrays[name] = found
    # The arrays that the field keeps, and the smallest semi-axes for their median.
    size = 8 * (sum(one.size for one in arrays.values() if one is not None) + len(places))
    _memory.require(size, f"the {', '.join(arrays)} of a field of {len(places)} ellipsoids", _FEWER)
    told = {name.removesuffix("s"): one for name, one in arrays.items()}
    kept = usable_rows("EllipsoidField", told, nan, row="kernel")
    return [one if one is None or kept is None else one[kept] for one in arrays.values()]


#: A box, and the rows of the matrix that brings the world to it.
Ends = tuple[Triple, Triple, tuple[Triple, Triple, Triple]]


class KernelOptions(TypedDict, total=False):
    """Keyword arguments of `EllipsoidField` that its constructors share."""

    weights: ArrayLike | None
    normalization: Normalization
    w0: float
    falloff: float
    min_scale: float | None
    cell_volume: float | None
    base: float
    nan: NanPolicy
    periodic: Periodic


class EllipsoidField(Field):
    """Scattered Gaussians of any position, size and orientation ([NM06]). Immutable.

    Kernel i is the ellipsoid around ``centers[i]`` whose semi-axes are ``scales[i]`` long and turned by
    ``rotations[i]``; within it lies the profile (exp(−k r²) − exp(−k)) / (1 − exp(−k)), r the distance from the centre
    in semi-axes, times ``weights[i]``, and times ``values[i]`` where values are summed. Conventions, section 2
    (Fields).

    All arrays are copied, anything that NumPy can read, and kept as float64: 40 bytes a kernel for spheres, 56 for
    ellipsoids, 32 more where they are turned, 8 more with weights. A field may have no kernels at all; its picture is
    empty. Two kernels may be at the same position.

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
        How sums become the scalar, offset by `base`: "threshold" (D / max(w0, W), [NM06] eq. 20), "none" (D), or
        "lattice" (D/C) for kernels of equal volume.
    w0
        Threshold of "threshold", > 0. Where the sum of weights is smaller, the scalar falls to `base`.
    falloff
        k of the profile, > 0.
    min_scale
        World units; shorter semi-axes, also those of 0, are set to it.
    cell_volume
        For "lattice": the volume that belongs to one kernel.
    base
        The value that all values are offset by: the scalar where no kernel reaches.
    periodic
        A box ((x0, y0, z0), (x1, y1, z1)), world units, in which kernels wrap: what leaves it by a face comes in by the
        opposite one. Centres are moved into the box, kernels whose supports cross a face have images, which count in
        every sum, and the field ends at the faces (`domain`): pictures are empty outside. An axis whose two ends are
        equal, or of which one is infinite, does not wrap. A kernel may have up to 1000 images.
    nan
        What a kernel is that has a number which is not finite in any of the arrays: "error", or "skip", which leaves it
        out. One `PictureWarning` says how many are left out, and for which arrays.

    Raises
    ------
    InvalidInput
        With the index of the first offending kernel: for numbers that are not finite, semi-axes that are not positive,
        invalid rotations, negative weights. For arrays of other shapes or unequal length, and for invalid options.
    OutOfMemory
        Where the copies do not fit.

    Examples
    --------
    >>> field = ss.EllipsoidField([(0, 0, 0), (3, 0, 0)], [(2, 1, 1), (1, 1, 1)], values=[0.5, 1.0], w0=0.1)
    >>> field.size, round(float(field.at([(0, 0, 0)])[0]), 3)
    (2, 0.5)
    """

    __slots__ = (
        *("_base", "_cell_volume", "_code", "_ends", "_ghost_options", "_ghosts", "_keeps_mass", "_min_scale"),
        *("_periodic", "_slice_spacing"),
    )
    native: _sheetsplat.EllipsoidField
    _code: Code | None
    _ends: Ends | None
    _ghost_options: tuple[float, float] | None
    _slice_spacing: float | None
    _keeps_mass: bool
    _periodic: Bounds | None

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
        falloff: float = _FALLOFF,
        min_scale: float | None = None,
        cell_volume: float | None = None,
        base: float = 0.0,
        periodic: Periodic = None,
        nan: NanPolicy = "error",
    ) -> None:
        self._normalization = choice("EllipsoidField: normalization", normalization, ("none", "lattice", "threshold"))
        self._w0 = number("EllipsoidField: w0", w0)
        self._falloff = number("EllipsoidField: falloff", falloff)
        self._min_scale = optional_number("EllipsoidField: min_scale", min_scale)
        self._cell_volume = optional_number("EllipsoidField: cell_volume", cell_volume)
        self._base = number("EllipsoidField: base", base)
        self._periodic = periodic_box("EllipsoidField", periodic)
        self._quantity, self._opened, self._orientation, self._trim = Quantity(), NOT_OPENED, None, Trim()
        self._ghosts, self._ghost_options, self._weighting, self._keeps_mass = 0, None, None, False
        self._ends, self._slice_spacing, self._code = None, None, None
        rest = {"scales": scales, "rotations": rotations, "values": values, "weights": weights}
        places, sizes, turns, heights, masses = _kernels(nan, centers, **rest)
        self.native = self._made(places, sizes, turns, heights, masses)

    def _made(
        self,
        centers: NDArray[Any],
        scales: NDArray[Any],
        rotations: NDArray[Any] | None,
        values: NDArray[Any],
        weights: NDArray[Any] | None,
        *,
        unit_rotations: bool = False,
        **of_part: Any,
    ) -> _sheetsplat.EllipsoidField:
        return _sheetsplat.EllipsoidField(
            centers,
            scales,
            rotations,
            values,
            weights=weights,
            **{**{name: getattr(self, f"_{name}") for name in _OPTIONS}, **of_part},
            unit_rotations=unit_rotations,
        )

    def _lies_as(self, other: Field) -> bool:
        """Return whether another field has kernels with the same centres and semi-axes."""
        if not isinstance(other, EllipsoidField):
            return False
        return np.array_equal(self.centers, other.centers) and np.array_equal(self.scales, other.scales)

    def _parts(self) -> dict[str, Any]:
        arrays = {name: getattr(self.native, name) for name in _ARRAYS}
        return {name: getattr(self, name) for name in _PARTS} | arrays

    def _restore(self, parts: dict[str, Any]) -> None:
        for name in _PARTS:
            setattr(self, name, parts[name])
        self.native = self._made(*(parts[name] for name in _ARRAYS), unit_rotations=True)

    def part(
        self, chosen: NDArray[np.bool_] | NDArray[np.int64], value_range: tuple[float, float] | None = None
    ) -> EllipsoidField:
        """Return the field of some of the kernels, for pictures in bricks.

        Parameters
        ----------
        chosen
            Which kernels.
        value_range
            Range of the values of the whole field, by which pictures scale their numbers; that of this field unless
            given.
        """
        arrays = (getattr(self.native, name) for name in _ARRAYS)
        kept: list[Any] = [None if array is None else array[chosen] for array in arrays]
        own = self if self._weighting is None else self._with(_weighting=self._weighting[chosen])
        return own.with_rows(*kept, value_range=value_range or self.value_range)

    def with_rows(
        self,
        centers: NDArray[Any],
        scales: NDArray[Any],
        rotations: NDArray[Any] | None,
        values: NDArray[Any],
        weights: NDArray[Any] | None,
        *,
        value_range: tuple[float, float] | None = None,
        **changes: Any,
    ) -> Self:
        """Return the field of other kernels with the same options, but for those that are given.

        Parameters
        ----------
        centers, scales, rotations, values, weights
            Rows of the arrays of a field of this package: quaternions have unit length to the last digit.
        value_range
            As for `part`; that of the values unless given.
        changes
            Other options of a field.
        """
        if weights is not None and not weights.any():
            # A field needs a weight above 0; those of 0 are drawn as this.
            weights = np.full_like(weights, _LEAST_WEIGHT)
        # The native range is offset by the base.
        counted = None if value_range is None else tuple(value - self._base for value in value_range)
        rows = centers, scales, rotations, values, weights
        native = self._made(*rows, unit_rotations=True, value_range=counted, **changes)
        changed: dict[str, Any] = {f"_{name}": one for name, one in changes.items()} | {"_code": None}
        return self._with(native=native, _weighting=self._weighting_of((len(values),)), **changed)

    @property
    def bound(self) -> Bound | None:
        """How far it is from the data that it was encoded from (`sheetsplat.fit.encode`); None for other fields."""
        return None if self._code is None else self._code.bound

    @property
    def code(self) -> Code:
        """The bytes of the file that it is stored as; InvalidInput for fields that are not encoded."""
        if self._code is None:
            raise complain(
                "EllipsoidField: the field cannot be saved",
                "kernels that are not encoded",
                "a field of sheetsplat.fit.encode",
                "encode it first",
            )
        return self._code

    def encoded_as(self, code: Code) -> Self:
        """Return the same field with the bytes of the file that it is stored as."""
        return self._with(_code=code)

    def standing_for(self, ends: Ends | None, slice_spacing: float | None) -> Self:
        """Return the same kernels as a field that ends where another does, with its default distance of slices.

        Parameters
        ----------
        ends
            A box, its lower and its upper corner, and the rows of the matrix that brings the world to it.
        slice_spacing
            World units; None: that of the kernels.
        """
        rows = (getattr(self.native, name) for name in _ARRAYS)
        return self.with_rows(*rows, ends=ends, slice_spacing=slice_spacing)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an encoded field to a .ssk file, which `sheetsplat.open` reads.

        Raises
        ------
        InvalidInput
            For fields that are not encoded, and for paths with another ending.
        Error
            Where the file cannot be written.
        """
        data = self.code.data
        target = Path(path)
        if target.suffix != ".ssk":
            raise complain("EllipsoidField: the field cannot be saved", f"{target.name}", "a name that ends with .ssk")
        try:
            target.write_bytes(data)
        except OSError as error:
            raise complain(f"{target} cannot be written", str(error), "a place to write to", kind=Error) from error

    keeps_mass = Forwarded[bool](
        "_keeps_mass", "Whether kernels' integrals are volumes of particles and nobody chose how sums are divided."
    )

    def of_particles(self) -> Self:
        """Return the same field, whose x-rays are plain sums: its kernels' integrals are the volumes of particles."""
        return self._with(_keeps_mass=True)

    def summed(self) -> Self:
        """Return the field of the plain sums D, as x-rays show it, where it keeps the mass; any other as it is."""
        if not self._keeps_mass or self._normalization == "none":
            return self
        rows = (getattr(self.native, name) for name in _ARRAYS)
        return self.with_rows(*rows, value_range=self.value_range, normalization="none")

    @classmethod
    def from_covariances(
        cls,
        centers: ArrayLike,
        covariances: ArrayLike,
        values: ArrayLike,
        **options: Unpack[KernelOptions],
    ) -> EllipsoidField:
        """Return a field of the Gaussians exp(−xᵀ C⁻¹ x / 2).

        Each C is factored once, in float64, into axes and standard deviations; the semi-axes of the supports are
        sqrt(2 k) standard deviations, 4 at the falloff 8, so that exp(−k r²) is exactly that Gaussian, cut off and
        lowered where it is exp(−k). Axes thinner than some 1e-7 of a kernel's longest one are lost in a covariance;
        frames, or scales and rotations, keep them.

        Parameters
        ----------
        centers, values
            As for `EllipsoidField`.
        covariances
            (N, 3, 3), symmetric to within 1e-5 of their largest entry, and positive definite. Flat
            ones, with a variance of 0 within rounding, need `min_scale`.
        weights, normalization, w0, falloff, cell_volume, base, periodic, nan
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
        k = number("EllipsoidField: falloff", options.get("falloff", _FALLOFF))
        rest = {"covariances": covariances, "values": values, "weights": options.get("weights")}
        centers, given, values, options["weights"] = _kernels(options.pop("nan", "error"), centers, **rest)
        deviations, rotations = axes_of_covariances(given, flat=options.get("min_scale") is not None)
        scales = deviations * math.sqrt(2.0 * max(k, 0.0))
        return cls(centers, scales, rotations, values, **options)

    @classmethod
    def from_frames(
        cls,
        centers: ArrayLike,
        frames: ArrayLike,
        values: ArrayLike,
        **options: Unpack[KernelOptions],
    ) -> EllipsoidField:
        """Return a field of ellipsoids whose semi-axes are given as vectors.

        Parameters
        ----------
        centers, values
            As for `EllipsoidField`.
        frames
            (N, 3, 3); the columns of each matrix are the three semi-axes of the support, world units, at right angles
            to each other (cosines of at most 1e-3; the nearest right angles are taken). The sign of a column does not
            matter. A column of length 0 needs `min_scale`.
        weights, normalization, w0, falloff, min_scale, cell_volume, base, periodic, nan
            As for `EllipsoidField`.

        Raises
        ------
        InvalidInput
            With the index, for semi-axes that are not at right angles; as for `EllipsoidField`.
        OutOfMemory
            Where the copies do not fit.
        """
        rest = {"frames": frames, "values": values, "weights": options.get("weights")}
        centers, given, values, options["weights"] = _kernels(options.pop("nan", "error"), centers, **rest)
        scales, rotations = axes_of_frames(given, flat=options.get("min_scale") is not None)
        return cls(centers, scales, rotations, values, **options)

    centers = Forwarded[NDArray[np.float64]]("native.centers", "Centres, (N, 3), world units; read-only, no copy.")
    scales = Forwarded[NDArray[np.float64]](
        "native.scales", "Semi-axes of the supports, world units: (N,) for spheres, else (N, 3); read-only, no copy."
    )
    rotations = Forwarded[NDArray[np.float64] | None](
        "native.rotations", "Unit quaternions w, x, y, z, (N, 4), or None where no kernel is turned; a read-only copy."
    )
    values = Forwarded[NDArray[np.float64]]("native.values", "The scalars, (N,); read-only, no copy.")
    weights = Forwarded[NDArray[np.float64] | None](
        "native.weights", "The weights, (N,), or None where each is 1; read-only, no copy."
    )
    min_scale = Forwarded[float | None]("_min_scale", "What shorter semi-axes were raised to, world units, or None.")
    cell_volume = Forwarded[float | None](
        "_cell_volume", 'For normalisation "lattice": the volume that one kernel stands for, or None.'
    )
    periodic = Forwarded[Bounds | None](
        "_periodic", "The box in which kernels wrap, with ends of 0 along axes that do not wrap; None: no axis wraps."
    )
    images = Forwarded[int]("native.images", "Number of images of kernels in a periodic box, which `size` leaves out.")
    isotropic = Forwarded[bool]("native.isotropic", "Whether the kernels were given as spheres.")
    scale_range = Forwarded[tuple[float, float]](
        "native.scale_range", "Smallest and largest semi-axis, world units; 0, 0 without kernels.", tuple
    )
    weight_range = Forwarded[tuple[float, float]](
        "native.weight_range", "Smallest and largest weight; 1, 1 without kernels.", tuple
    )
    ghosts = Forwarded[int]("_ghosts", "Number of ghost points, the last ones of the kernels.")
    ghost_options = Forwarded[tuple[float, float] | None](
        "_ghost_options", "Distance and weight of its ghost points, or None without them."
    )

    @property
    def bounds(self) -> Bounds:  # type: ignore[override]
        """World-aligned box around all supports, within the field's domain: its lower and its upper corner."""
        box: Bounds = self.native.supports
        if self.domain is None or not self.size:
            return box
        ends = np.clip(box, *self.domain)
        return triple("bounds", ends[0]), triple("bounds", ends[1])

    def without_end(self) -> EllipsoidField:
        """Return the kernels without a periodic box, in which images of them would count."""
        made = self._with(_periodic=None, _ends=None)
        return self if self.domain is None else made.with_rows(*(getattr(self.native, name) for name in _ARRAYS))

    def with_images(self) -> EllipsoidField:
        """Return the kernels and their images in a periodic box, all as kernels of a field that does not end."""
        return self._with(_periodic=None, _ends=None, native=self.native.with_images())

    def weight_at(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the sum W of weights at points (M, 3) in the world, shape (M,): it is small where the data are sparse.

        Raises
        ------
        InvalidInput
            For anything but M times three finite numbers.
        """
        found: NDArray[np.float64] = self._sums_at(points)[0][:, 1]
        return found

    def with_ghost_points(self, *, distance: float = 1.0, weight: float = 1.0) -> EllipsoidField:
        """Return the field with ghost points around the data, for a smooth border ([NM06] §4.1).

        They are kernels whose value is the field's base.

        At the border of scattered data the weights fall to 0, and D / W, which stays as high as the outermost values,
        ends abruptly. (With the threshold w0 = 1 it falls as soon as W does, and ghost points change little; they are
        for small w0.) Ghost points carry the weights on, so that the scalar falls to the base within one
        support.

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
            For an invalid distance or weight, and for a field that has ghost points.
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
        if self._periodic is not None:
            raise complain(
                "EllipsoidField: ghost points cannot be added",
                "a periodic box",
                "a field with a border",
                "leave out " + option_ref("periodic"),
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
        field = self.with_rows(
            np.concatenate((self.centers, places)),
            np.concatenate((self.scales, self.scales[owners])),
            None if rotations is None else np.concatenate((rotations, rotations[owners])),
            np.concatenate((self.values, np.full(count, self._base))),
            None if weights is None else np.concatenate((weights, np.full(count, mass))),
        )
        weighting = None if self._weighting is None else np.concatenate((self._weighting, np.zeros(count)))
        return self._with(native=field.native, _ghosts=count, _ghost_options=(away, mass), _weighting=weighting)

    def __repr__(self) -> str:
        """Return a short description."""
        low, high = self.value_range
        thin, long = self.scale_range
        kinds = "spheres" if self.isotropic else "ellipsoids"
        ghosts = f", {self._ghosts} of them ghost points" if self._ghosts else ""
        base = f", base {self._base:g}" if self._base else ""
        box = f", periodic in {self._periodic}" if self._periodic else ""
        return (
            f"EllipsoidField({self.size} {kinds}{ghosts}, semi-axes {thin:g} to {long:g}, values {low:g} to {high:g}"
            f"{base}{box}, normalization {self._normalization!r}{self._up_text})"
        )
