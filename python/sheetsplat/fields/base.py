"""What all fields have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat import _memory, _sheetsplat
from sheetsplat._checks import Bounds, instance, numbers, shown, triple
from sheetsplat._properties import Forwarded
from sheetsplat.errors import complain, unusable
from sheetsplat.fields.trim import Trim
from sheetsplat.orientation import Orientation
from sheetsplat.quantity import Quantity

Normalization = Literal["none", "lattice", "threshold"]
NanPolicy = Literal["error", "skip"]
NOT_OPENED: Mapping[str, Any] = MappingProxyType({})


def _same(first: Any, second: Any) -> bool:
    """Return whether two parts of fields are equal; NaN is equal to NaN."""
    if isinstance(first, np.ndarray) and isinstance(second, np.ndarray):
        return first.dtype == second.dtype and np.array_equal(first, second, equal_nan=first.dtype.kind == "f")
    return type(first) is type(second) and bool(first == second)


def _restored(kind: type[Field], parts: dict[str, Any]) -> Field:
    """Return a field of what `Field.__reduce_ex__` gave."""
    field = object.__new__(kind)
    field._quantity = parts.pop("quantity")
    field._opened = MappingProxyType(parts.pop("opened"))
    field._orientation = parts.pop("orientation")
    field._trim = parts.pop("trim")
    field._weighting = parts.pop("weighting")
    field._restore(parts)
    return field


class Field(ABC):
    """What all fields have in common: a set of kernels whose weighted sums are the scalar. Conventions, section 2.

    Made by `RegularField` and `EllipsoidField`.
    """

    __slots__ = (
        *("_falloff", "native", "_normalization", "_opened", "_orientation", "_quantity", "_trim", "_w0"),
        "_weighting",
    )
    _falloff: float
    native: _sheetsplat.RegularField | _sheetsplat.EllipsoidField
    _normalization: str
    _opened: Mapping[str, Any]
    _orientation: Orientation | None
    _quantity: Quantity
    _trim: Trim
    _w0: float
    _weighting: NDArray[np.float64] | None

    def __init__(self) -> None:
        raise TypeError("a field is made by RegularField or EllipsoidField")

    falloff = Forwarded[float]("_falloff", "The k of the kernel's profile.")
    normalization = Forwarded[str]("_normalization", 'One of "none", "lattice" and "threshold".')
    w0 = Forwarded[float]("_w0", 'Threshold of the weight sum, for normalisation "threshold".')
    base = Forwarded[float](
        "native.base", "The offset of values: the scalar where no kernel reaches. Conventions, section 2."
    )
    size = Forwarded[int]("native.size", "Number of kernels, skipped samples excluded.")
    bounds = Forwarded[Bounds](
        "native.supports", "World-aligned box around all supports: its lower and its upper corner."
    )
    centre_bounds = Forwarded[Bounds](
        "native.centres", "World-aligned box around all kernel centres: its lower and its upper corner."
    )
    default_slice_spacing = Forwarded[float](
        "native.default_slice_spacing", "Default distance of slices in scenes, world units. Conventions, section 3."
    )
    quantity = Forwarded[Quantity]("_quantity", "What scalar and lengths are, for figures.")
    name = Forwarded[str]("_quantity.name", "What the scalar is called, that of `quantity`; of a channel its label.")
    opened = Forwarded[Mapping[str, Any]](
        "_opened", "The options of `sheetsplat.open` that made it, without paths; empty for fields of arrays."
    )

    @abstractmethod
    def _parts(self) -> dict[str, Any]:
        """Return what the field is made of, arrays and plain values by name: what `_restore` takes, and equality."""

    @abstractmethod
    def _restore(self, parts: dict[str, Any]) -> None:
        """Become the field of these parts, to the bit."""

    def __reduce_ex__(self, protocol: Any) -> tuple[Any, ...]:
        """Pickle by arrays, which protocol 5 hands over as buffers."""
        told = {
            "quantity": self._quantity,
            "opened": dict(self._opened),
            "orientation": self._orientation,
            "trim": self._trim,
            "weighting": self._weighting,
        }
        parts = {
            name: np.ascontiguousarray(one) if isinstance(one, np.ndarray) else one
            for name, one in self._parts().items()
        }
        return _restored, (type(self), {**parts, **told})

    def __copy__(self) -> Self:
        """Return itself: it is immutable."""
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        """Return itself: it is immutable."""
        return self

    def __eq__(self, other: object) -> bool:
        """Return whether the other field has the same kernels, options, quantity and orientation."""
        if self is other:
            return True
        if not isinstance(other, Field) or type(self) is not type(other):
            return NotImplemented
        if hash(self) != hash(other) or self._quantity != other._quantity or self._orientation != other._orientation:
            return False
        mine, others = self._parts(), other._parts()
        alike = all(_same(part, others[name]) for name, part in mine.items())
        return alike and _same(self._weighting, other._weighting)

    def __hash__(self) -> int:
        """Return a hash of the options and of the range of values."""
        return hash((type(self), self.size, self.value_range, self._falloff, self._normalization, self._w0))

    weighting = Forwarded[NDArray[np.float64] | None](
        "_weighting", "Weights of means along rays, by `weighted_by`, as many as there are values; None: without."
    )

    def weighted_by(self, weight: ArrayLike | Field | None) -> Self:
        """Return the same field, whose pictures of mode average are weighted means. Conventions, section 7.

        Parameters
        ----------
        weight
            A field on the same lattice, or of the same kernels, whose values count, or an array of the shape of
            `values`; none below 0, and not all 0. None: no weights.

        Raises
        ------
        InvalidInput
            For other lattices and kernels, other shapes, and such numbers.
        Unsupported
            For data in bricks.

        Examples
        --------
        >>> temperature, density = ss.RegularField(values), ss.RegularField(1 + values)
        >>> ss.render(temperature.weighted_by(density), mode="average", size=(32, 32)).is_scalar
        True
        """
        if weight is None:
            return self._with(_weighting=None)
        what = f"{type(self).__name__}: weights of means"
        own: Any = self
        if isinstance(weight, Field):
            other: Any = weight
            if not self._lies_as(weight):
                raise complain(
                    unusable(what), repr(weight), f"a field that lies as {self!r} does", "resample one to the other"
                )
            weight = other.values
        weights = numbers(what, weight, f"an array of shape {own.values.shape}")
        if weights.shape != own.values.shape:
            raise complain(
                unusable(what), f"an array of shape {weights.shape}", f"shape {own.values.shape}, as the values have"
            )
        known = weights[~np.isnan(own.values)]
        if not np.isfinite(known).all() or (known < 0.0).any() or not (known > 0.0).any():
            wrong = known[~(known >= 0.0) | np.isinf(known)]
            found = f"{wrong[0]:g}, and {wrong.size} such numbers" if wrong.size else "no number above 0"
            raise complain(
                unusable(what), found, "finite numbers of at least 0, not all 0", "set weights that are missing to 0"
            )
        kept = np.array(weights, dtype=np.float64)
        kept.flags.writeable = False
        return self._with(_weighting=kept)

    def _weighting_of(self, shape: tuple[int, ...]) -> NDArray[np.float64] | None:
        """Return the weights of means for values of a shape; None for others than its own."""
        return self._weighting if self._weighting is not None and self._weighting.shape == shape else None

    def _lies_as(self, other: Field) -> bool:
        """Return whether another field has values at the same places, for the same kernels."""
        return False

    def with_quantity(
        self,
        name: str | None = None,
        unit: str | None = None,
        length_unit: str | None = None,
        floor: float | None = None,
        axes: Sequence[tuple[Any, ...]] | None = None,
        time: str | None = None,
    ) -> Self:
        """Return the same field, without a copy of its arrays, with names and units for figures; see `Quantity`.

        What is not given stays.
        """
        given = {"name": name, "unit": unit, "length_unit": length_unit, "floor": floor, "axes": axes, "time": time}
        changes: dict[str, Any] = {key: one for key, one in given.items() if one is not None}
        return self.of_quantity(replace(self._quantity, **changes))

    def of_quantity(self, quantity: Quantity) -> Self:
        """Return the same field, without a copy of its arrays, with another quantity."""
        return self._with(_quantity=quantity)

    def opened_with(self, options: Mapping[str, Any]) -> Self:
        """Return the same field with the options of `sheetsplat.open` that made it, for the pictures of it."""
        return self._with(_opened=MappingProxyType(dict(options)))

    trim = Forwarded[Trim]("_trim", "What `sheetsplat.render` left out of the data; most fields are whole.")

    def with_trim(self, trim: Trim) -> Self:
        """Return the same field with what was left out of the data it was made of."""
        return self._with(_trim=trim)

    def _with(self, **changes: Any) -> Self:
        made = object.__new__(type(self))
        for kind in type(self).__mro__[:-1]:
            for name in getattr(kind, "__slots__", ()):
                setattr(made, name, changes.get(name, getattr(self, name)))
        return made

    orientation = Forwarded[Orientation | None](
        "_orientation", "Which way up it is, for the first view; None where it is not known."
    )

    def with_orientation(self, orientation: Orientation | None) -> Self:
        """Return the same field, without a copy of its arrays, with another orientation; None: not known."""
        if orientation is not None:
            instance("Field: orientation", orientation, Orientation)
        return self._with(_orientation=orientation)

    @property
    def _up_text(self) -> str:
        """What the description of a field says about its orientation."""
        return "" if self._orientation is None else f", up {self._orientation.up}"

    def at(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the field's scalar at points (M, 3) in the world, shape (M,); the base where no kernel reaches.

        Raises
        ------
        InvalidInput
            For anything but M times three finite numbers.
        """
        return self.evaluate(points)[0]

    def evaluate(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the field's scalar and its gradient at points (M, 3) in the world, in float64.

        Returns
        -------
        tuple
            Scalars, shape (M,), and their derivatives along x, y, z, shape (M, 3), scalar per world unit: the base and
            0 where no kernel reaches. Outside of the domain of a field, where pictures are empty, they are what the
            sums give. With normalisation "threshold" the gradient jumps where W is w0; the side of the larger W holds
            there. Derivatives beyond float64 are not finite.

        Raises
        ------
        InvalidInput
            For anything but M times three finite numbers.
        """
        values, gradients, _ = self.probe(points)
        return values, gradients

    def nearest_kernel(self, points: ArrayLike) -> NDArray[np.int64]:
        """Return the number of the kernel whose centre is nearest among those that reach a point, -1 where it is empty.

        Kernels of volumes are numbered as the samples of ``values.ravel()``; mirrored ones have the number of their
        sample, and images in a periodic box that of their kernel.

        Raises
        ------
        InvalidInput
            For anything but M times three finite numbers.
        """
        return self._sums_at(points)[1]

    def probe(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
        """Return what `evaluate` and `nearest_kernel` return, in the time of one of them."""
        sums, nearest = self._sums_at(points)
        weight, slope, weight_slope = sums[:, 1], sums[:, 2:5], sums[:, 5:]
        counted, least = self._counted(sums), self._least_divisor
        values = self.base + counted
        if least is not None:
            divisor = np.maximum(least, weight)
            falling = np.where((weight >= least)[:, None], counted[:, None] * weight_slope, 0.0)
            return values, (slope - falling) / divisor[:, None], nearest
        if self._normalization == "none":
            return values, slope.copy(), nearest
        return values, slope / self.native.lattice_constant, nearest

    def scalars_and_weights(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the scalar and the sum W of weights at points (M, 3), each (M,), in the time of one of them."""
        sums, _ = self._sums_at(points)
        return self._scalars(sums), sums[:, 1].copy()

    def scalars_and_shown(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return the scalar at points (M, 3), and where the field is not empty, each (M,)."""
        places = self._places(points)
        sums, nearest = self._emptied(places, *self._found(places, 2))
        return self._scalars(sums), nearest >= 0

    def _scalars(self, sums: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.base + self._counted(sums)

    def _counted(self, sums: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return scalars, offset by the base, of sums D, W."""
        total, weight, least = sums[:, 0], sums[:, 1], self._least_divisor
        if least is not None:
            return np.asarray(total / np.maximum(least, weight))
        return total if self._normalization == "none" else np.asarray(total / self.native.lattice_constant)

    @property
    def _least_weight(self) -> float:
        """Points where W is smaller are empty, although kernels reach them."""
        return self.native.least_weight

    @property
    def _least_divisor(self) -> float | None:
        """What D is divided by at least where it is divided by W, which is larger elsewhere; None: it is not."""
        return self._w0 if self._normalization == "threshold" else None

    @property
    def domain(self) -> Bounds | None:
        """World-aligned box where the field ends: its lower and its upper corner; None where it ends nowhere.

        Infinite along axes along which it does not end.
        """
        lower, upper = self.native.domain
        return (lower, upper) if all(a <= b for a, b in zip(lower, upper, strict=True)) else None

    def inside(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which points (M, 3) lie in the field's domain, (M,); a field that ends nowhere has all."""
        box = self.domain
        if box is None:
            return np.ones(len(points), bool)
        found: NDArray[np.bool_] = np.all((points >= box[0]) & (points <= box[1]), axis=1)
        return found

    def _sums_at(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return D, W and their derivatives, (M, 8), and the numbers of the nearest kernels, (M,), -1 where empty."""
        places = self._places(points)
        return self._emptied(places, *self._found(places, 8))

    def _found(self, places: NDArray[np.float64], columns: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return the first of D, W and their derivatives, (M, columns), and the numbers of the nearest kernels."""
        return self.native.sums_at(places)

    def _emptied(
        self, places: NDArray[np.float64], sums: NDArray[np.float64], nearest: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        nearest = np.where(self.inside(places), nearest, -1)
        if self._least_weight > 0.0:
            nearest = np.where(sums[:, 1] >= self._least_weight, nearest, -1)
        return sums, nearest

    def _places(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return checked points, (M, 3)."""
        what = f"{type(self).__name__}: points"
        places = numbers(what, points, "(M, 3) world positions")
        places = places.reshape(0, 3) if places.shape == (0,) else places
        if places.ndim != 2 or places.shape[1] != 3:
            raise complain(unusable(what), f"an array of shape {places.shape}", "(M, 3) world positions")
        # The points, the tree that finds them, and what is found.
        _memory.require(320 * len(places), f"{len(places)} points", "ask for fewer points at a time")
        if not np.isfinite(places).all():
            n = int(np.flatnonzero(~np.isfinite(places).all(axis=1))[0])
            failed = f"{type(self).__name__}: a point cannot be used"
            raise complain(failed, f"{places[n]}, point {n}", "three finite numbers")
        return places

    # Regular fields have their own of these two.
    @property
    def value_range(self) -> tuple[float, float]:
        """Smallest and largest value of a kernel; 0, 0 without kernels."""
        low, high = self.native.value_range
        return (low + self.base, high + self.base) if self.size else (0.0, 0.0)

    @property
    def memory(self) -> int:
        """Bytes that the field keeps."""
        return self.native.memory


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
    # The box of a field without kernels has its lower corner above its upper one.
    there = [box for box in boxes if all(low <= high for low, high in zip(*box, strict=True))] or boxes
    lower = np.min([box[0] for box in there], axis=0)
    upper = np.max([box[1] for box in there], axis=0)
    return triple("bounds", lower), triple("bounds", upper)


def default_spacing(fields: Iterable[Field]) -> float:
    """Return the smallest distance of slices that fields suggest, world units; 1 without a kernel."""
    return min((one.default_slice_spacing for one in fields if one.size), default=1.0)
