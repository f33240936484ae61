"""Lattices of samples of which a part can be made into a field of its own."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import Bounds, Triple
from sheetsplat.errors import complain
from sheetsplat.fields import BrickedField, NanPolicy, Normalization, RegularField, ending
from sheetsplat.fields.ending import DOMAIN, lattice_constant
from sheetsplat.fields.regular import Boundary, Lattice
from sheetsplat.ripple import lattice_ripple

#: First and last index, the last one outside, along k, j, i.
Box = tuple[tuple[int, int], tuple[int, int], tuple[int, int]]
_Ends = tuple[float, float]

#: Coefficients are the same within 1e-8 of the largest sample this many samples away from where a volume was cut.
PREFILTER_MARGIN = 24
# The farthest that a point can be from the samples around it, in sample distances (BCC: in a/√2).
_FARTHEST = {"cartesian": 0.8660254037844387, "bcc": 0.7905694150420949}


def holds(outer: Box, inner: Box) -> bool:
    """Return whether a box lies in another one."""
    return all(a <= c and d <= b for (a, b), (c, d) in zip(outer, inner, strict=True))


def slices(box: Box, outer: Box | None = None) -> tuple[slice, ...]:
    """Return what cuts a box out of the samples of an outer one; of a whole volume unless given."""
    starts = (0, 0, 0) if outer is None else (first for first, _ in outer)
    return tuple(slice(first - start, last - start) for (first, last), start in zip(box, starts, strict=True))


def _mirrored(numbers: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Return which of so many samples are mirrored at the first and the last one, as often as it takes."""
    if count == 1:
        return np.zeros_like(numbers)
    at = numbers % (2 * (count - 1))
    return np.where(at < count, at, 2 * (count - 1) - at)


def _squares_outside(numbers: NDArray[Any], last: Any) -> NDArray[np.float64]:
    """Return the squares of how many layers some, of which the last is one, lie beyond the ends of the domain."""
    found: NDArray[np.float64] = np.maximum(0.0, np.maximum(-DOMAIN - numbers, numbers - last - DOMAIN)) ** 2
    return found


@dataclass(frozen=True)
class LatticeSpec:
    """Everything about a `RegularField` but its samples.

    Attributes
    ----------
    shape
        (nk, nj, ni) of the whole volume.
    spacing, origin, lattice, radius, falloff, normalization, w0, nan, prefilter, boundary
        As for `RegularField`.
    base
        The value that all are offset by.
    axes
        As for `RegularField`. Cells and the domain of such a lattice are boxes in its own coordinates, `to_box` times
        the world's, in which samples are 1 apart; of others in the world.
    has_holes
        Whether samples are missing (NaN).
    labels
        Whether samples are labels.
    all_labels
        The labels that fields of a part have native fields of; only those among its own samples unless given.

    Indices of samples may go beyond the volume: there are its mirrored samples, where it has some.
    """

    shape: tuple[int, int, int]
    spacing: Triple = (1.0, 1.0, 1.0)
    origin: Triple = (0.0, 0.0, 0.0)
    lattice: Lattice = "cartesian"
    radius: float = 2.0
    falloff: float = 5.0
    normalization: Normalization = "lattice"
    w0: float = 1.0
    nan: NanPolicy = "error"
    prefilter: bool = False
    boundary: Boundary = "edge"
    base: float = 0.0
    has_holes: bool = False
    axes: ending.Axes | None = None
    labels: bool = False
    all_labels: tuple[int, ...] = ()

    @classmethod
    def of(cls, field: RegularField) -> LatticeSpec:
        """Return what a field is made of, beside its samples."""
        found = ("has_holes", "all_labels")
        own = {one.name: getattr(field, one.name) for one in fields(cls) if one.name not in found}
        has_holes = field.survey.missing > 0 if isinstance(field, BrickedField) else field.native.has_holes
        return cls(**own, has_holes=has_holes)

    @property
    def to_box(self) -> NDArray[np.float64] | None:
        """What takes world positions to the lattice's own coordinates, (3, 3); None: these are the world's."""
        return None if self.axes is None else np.linalg.inv(np.transpose(self.axes))

    @property
    def steps(self) -> Triple:
        """Own units from one index to the next along x, y, z; in a layer of a BCC lattice."""
        if self.lattice == "bcc":
            edge = self.spacing[0]
            return edge, edge, 0.5 * edge
        return self.spacing if self.axes is None else (1.0, 1.0, 1.0)

    @property
    def first(self) -> Triple:
        """Position of sample (0, 0, 0) in the lattice's own coordinates."""
        if self.to_box is None:
            return self.origin
        x, y, z = (self.to_box @ self.origin).tolist()
        return x, y, z

    @property
    def semi_axes(self) -> Triple:
        """Semi-axes of every kernel's support along the lattice's axes, own units."""
        if self.lattice == "bcc":
            return (self.radius * self.spacing[0] / math.sqrt(2.0),) * 3
        x, y, z = (self.radius * step for step in self.steps)
        return x, y, z

    @property
    def longest(self) -> float:
        """The longest semi-axis of a support, world units."""
        return max(self.semi_axes) if self.axes is None else self.radius * float(np.linalg.norm(self.axes, 2))

    def half_extent(self, direction: NDArray[np.float64]) -> float:
        """Return how far a support reaches along a direction of unit length from its centre, world units."""
        own = direction if self.axes is None else np.asarray(self.axes) @ direction
        return float(np.linalg.norm(np.asarray(self.semi_axes) * own))

    @property
    def default_slice_spacing(self) -> float:
        """Distance of slices unless given, world units."""
        if self.lattice == "bcc":
            return 0.5 * self.spacing[0]
        return float(ending.heights(ending.steps(self.lattice, self.spacing, self.axes))[0].min())

    @property
    def largest_sum(self) -> float:
        """Largest scalar, offset by the base, that kernels of factor 1 add up to."""
        if self.normalization == "threshold" or self.least_weight > 0.0:
            return 1.0
        ripple = lattice_ripple(self.radius, self.falloff, lattice=self.lattice, normalization="none")
        plain = self.normalization == "none" or self.prefilter
        constant = lattice_constant(self.radius, self.falloff, self.lattice) if plain else 1.0
        return constant * (1.0 + 1.01 * ripple.peak + 1e-6)

    @property
    def ends(self) -> bool:
        """Whether the volume ends at its boundary, with mirrored samples beyond."""
        return ending.ends(self.shape, self.lattice, self.boundary)

    @property
    def least_weight(self) -> float:
        """Points where kernels add up to less are empty: beside missing samples."""
        divided = self.normalization == "lattice" and not self.prefilter
        if not (self.ends and self.has_holes and divided):
            return 0.0
        return ending.least_weight(self.radius, self.falloff, self.lattice)

    @property
    def fills(self) -> bool:
        """Whether kernels reach every point of the domain."""
        return self.ends and not self.has_holes and self.radius > _FARTHEST[self.lattice]

    @property
    def _layer(self) -> Triple:
        """World units from one layer of samples to the next along x, y, z: half an edge of a BCC lattice."""
        return ending.layer_spacing(self.lattice, self.spacing if self.axes is None else self.steps)

    @property
    def _layers(self) -> tuple[int, int, int]:
        """Number of layers of samples along x, y, z."""
        return ending.layer_counts(self.shape, self.lattice)

    @property
    def _radius_in_layers(self) -> float:
        return self.radius * math.sqrt(2.0) if self.lattice == "bcc" else self.radius

    @property
    def _squared_radius(self) -> float:
        """Square of the radius in layers, as the core rounds it: kernels may end just where the domain does."""
        return (2.0 if self.lattice == "bcc" else 1.0) * self.radius * self.radius

    @property
    def _beyond(self) -> int:
        """Layers of mirrored samples beyond each end whose supports reach into the domain."""
        return math.ceil(self._radius_in_layers + DOMAIN) - 1 if self.ends else 0

    @property
    def mirrored(self) -> tuple[int, int, int]:
        """Mirrored samples beyond each end along k, j, i."""
        layers = self._beyond
        if self.lattice == "bcc" and layers:
            # Whole edges of two layers, so that even layers stay even.
            return 2 * ((layers + 1) // 2), (layers + 2) // 2, (layers + 2) // 2
        return layers, layers, layers

    @property
    def domain(self) -> Bounds | None:
        """Where the volume ends, a box in its own coordinates; None: nowhere."""
        spacing = self.spacing if self.axes is None else self.steps
        return ending.domain(self.shape, self.lattice, self.boundary, spacing, self.first)

    def supports(self, centres: Bounds) -> Bounds:
        """Return the box around the supports of all kernels; `centres`: the box of those that are no mirrored ones."""
        lower, upper = [], []
        if self.axes is not None:
            zero = np.zeros(3)
            for direction in np.eye(3):
                least, most = self.reach_along(centres, zero, direction)
                half = self.half_extent(direction)
                lower.append(least - half)
                upper.append(most + half)
            return tuple(lower), tuple(upper)  # type: ignore[return-value]
        domain = self.domain
        for axis, (low, high) in enumerate(zip(*centres, strict=True)):
            reach = self.semi_axes[axis]
            if domain is not None:
                # A mirrored sample is as far from the outermost layer as its own sample.
                most, half = self._beyond * self._layer[axis], DOMAIN * self._layer[axis]
                first, last = domain[0][axis] + half, domain[1][axis] - half
                low = first - most if low <= first + most else low
                high = last + most if high >= last - most else high
            lower.append(low - reach)
            upper.append(high + reach)
        return tuple(lower), tuple(upper)  # type: ignore[return-value]

    def reach_along(self, centres: Bounds, eye: NDArray[np.float64], direction: NDArray[np.float64]) -> _Ends:
        """Return the least and the largest (x - eye) . direction of the places of all kernels, mirrored ones included.

        Exact where no samples are missing; else bounds. `centres`: as for `supports`.
        """
        beyond, layer, last = self._beyond, np.asarray(self._layer), np.asarray(self._layers) - 1
        if self.axes is None:
            first_known, last_known = (np.rint((np.asarray(end) - self.origin) / layer).astype(int) for end in centres)
            steps = np.diag(layer)
        else:
            first_known, last_known, steps = np.zeros(3, int), last, np.asarray(self.axes)
        below = np.where(first_known > beyond, first_known, -beyond)
        above = np.where(last_known < last - beyond, last_known, last + beyond)
        # Beside the outermost layer there are the next ones: a BCC lattice has no sample at some corners.
        low_end = np.minimum(above, np.maximum(first_known, 0) + 2)
        high_end = np.maximum(below, np.minimum(last_known, last) - 2)
        found = []
        for along in (-direction, direction):
            is_high = steps @ along > 0
            sides = zip(np.where(is_high, high_end, below), np.where(is_high, above, low_end) + 1, strict=True)
            layers = np.stack([one.ravel() for one in np.meshgrid(*(np.arange(*ends) for ends in sides))])
            there = np.ones(layers.shape[1], bool)
            if beyond:
                there = _squares_outside(layers, last[:, None]).sum(axis=0) < self._squared_radius
            if self.lattice == "bcc":
                there &= (layers % 2 == layers[0] % 2).all(axis=0)
            places = np.asarray(self.origin)[:, None] + steps.T @ layers - eye[:, None]
            x, y, z = places[:, there] * along[:, None]
            found.append(float((x + y + z).max(initial=-math.inf)))
        return -found[0], found[1]

    def face(self, axis: int, index: int) -> float:
        """Return the own coordinate of the plane midway between samples index - 1 and index along x, y or z."""
        middle = index - 0.25 if self.lattice == "bcc" and axis < 2 else index - 0.5
        return self.first[axis] + middle * self.steps[axis]

    def around(self, cell: Bounds, margin: float) -> Box:
        """Return the box of all samples whose kernels reach closer to a cell than `margin` world units, [k, j, i].

        The box has at least one sample. Layers of a BCC lattice begin with an even one.
        """
        found = []
        for axis in (2, 1, 0):
            count, step, first = self.shape[2 - axis], self.steps[axis], self.first[axis]
            reach = self.semi_axes[axis] + self.own_lengths(margin)[axis]
            low, high = (cell[0][axis] - reach - first) / step, (cell[1][axis] + reach - first) / step
            moved = 0.5 if self.lattice == "bcc" and axis < 2 else 0.0
            more = self.mirrored[2 - axis]
            least, most = -more, count + more
            begin = least if low <= least else min(math.floor(low - moved), most - 1)
            end = most if high >= most - 1 else max(math.ceil(high) + 1, begin + 1)
            if self.lattice == "bcc" and axis == 2:
                begin -= begin % 2
            found.append((max(begin, least), min(end, most)))
        return found[0], found[1], found[2]

    def own_lengths(self, length: float) -> Triple:
        """Return how far a world length reaches along x, y and z, at most, in the lattice's own coordinates."""
        if self.to_box is None:
            return length, length, length
        x, y, z = (length * np.linalg.norm(self.to_box, axis=1)).tolist()
        return x, y, z

    def to_read(self, box: Box) -> Box:
        """Return the samples of the volume that the kernels of a box depend on: with `prefilter` also others around."""
        found = []
        for array_axis, ((first, last), count) in enumerate(zip(box, self.shape, strict=True)):
            if 0 <= first and last <= count:
                least, most = first, last
            else:
                own = self.samples_of(array_axis, np.arange(first, last))
                least, most = int(own.min()), int(own.max()) + 1
            margin = PREFILTER_MARGIN if self.prefilter else 0
            least, most = max(least - margin, 0), min(most + margin, count)
            if self.lattice == "bcc" and array_axis == 0:
                least -= least % 2
                if self.ends:
                    # A lattice of one layer would have no end.
                    most = min(max(most, least + 2), count)
            found.append((least, most))
        k, j, i = found
        return k, j, i

    def samples_of(self, array_axis: int, numbers: NDArray[np.int64], odd: int | None = None) -> NDArray[np.int64]:
        """Return which samples along an axis of the array numbers of samples stand for, mirrored ones included.

        Along the last two axes of a BCC lattice they differ in even and odd layers; both unless `odd` says which.
        """
        count = self.shape[array_axis]
        if self.lattice != "bcc" or array_axis == 0:
            return _mirrored(numbers, count)
        both = [_mirrored(2 * numbers + n, 2 * count) // 2 for n in ((0, 1) if odd is None else (odd,))]
        return np.concatenate(both)

    def field(self, samples: NDArray[Any], box: Box, value_range: tuple[float, float] | None = None) -> RegularField:
        """Return the field of a box of the samples, in their place in the world.

        Parameters
        ----------
        samples
            Those of ``to_read(box)``, [k, j, i].
        box
            As `around` gives it.
        value_range
            Range of the factors of all kernels of the whole volume, offset by its base, by which the picture's
            numbers are scaled: of the samples, with `prefilter` of the coefficients.
        """
        read = self.to_read(box)
        wanted = tuple(last - first for first, last in read)
        if samples.shape != wanted:
            raise complain("a brick cannot be made", f"samples of shape {samples.shape}", f"shape {wanted}")
        names = (
            "lattice",
            "radius",
            "falloff",
            "w0",
            "nan",
            "base",
            "labels",
            "spacing" if self.axes is None else "axes",
        )
        options: dict[str, Any] = {name: getattr(self, name) for name in names}
        found = None
        if self.prefilter:
            # Where the volume is cut the boundary does not matter, as far away as it is.
            found = RegularField(samples, prefilter=True, boundary=self.boundary, **options)
            options["normalization"] = "none"
        elif self.least_weight > 0.0:
            options |= {"normalization": "threshold", "w0": self.least_weight, "least_weight": self.least_weight}
        else:
            options["normalization"] = self.normalization
        options["boundary"] = "zero"
        (k, _), (j, _), (i, _) = box
        steps = ending.steps(self.lattice, self.spacing, self.axes)
        origin = np.asarray(self.origin) + np.asarray((i, j, k)) @ steps
        if self._has_corners(box):
            options["nan"] = "skip"
        return RegularField.part(
            self._within(samples, box, read),
            coefficients=None if found is None else self._within(found.coefficients, box, read),
            figures=None if found is None else found.native.prefilter_figures,
            value_range=value_range,
            labels_found=self.all_labels,
            origin=origin,
            **options,
        )

    def _has_corners(self, box: Box) -> bool:
        """Return whether a box has mirrored samples without a kernel: beyond the volume along more than one axis.

        Of BCC lattices along any: whole edges are mirrored.
        """
        outside = [first < 0 or last > count for (first, last), count in zip(box, self.shape, strict=True)]
        return sum(outside) > (0 if self.lattice == "bcc" else 1)

    def _within(self, samples: NDArray[Any], box: Box, read: Box) -> NDArray[Any]:
        """Return the samples of a box, mirrored ones included, of those that were read."""
        if holds(read, box):
            return np.ascontiguousarray(samples[slices(box, read)])
        k, j, i = (np.arange(*ends) for ends in box)
        layers = self.samples_of(0, k) - read[0][0]
        if self.lattice == "bcc":
            found = np.empty((len(k), len(j), len(i)), samples.dtype)
            for odd in (0, 1):
                rows, columns = (self.samples_of(n, at, odd) - read[n][0] for n, at in ((1, j), (2, i)))
                found[odd::2] = samples[np.ix_(layers[odd::2], rows, columns)]
        else:
            rows, columns = (self.samples_of(n, at) - read[n][0] for n, at in ((1, j), (2, i)))
            found = samples[np.ix_(layers, rows, columns)]
        return self._without_corners(found, box) if self._has_corners(box) else found

    def _without_corners(self, samples: NDArray[Any], box: Box) -> NDArray[Any]:
        """Return samples with NaN where mirrored ones do not reach into the domain, and so have no kernel."""
        found = samples if samples.dtype.kind == "f" else samples.astype(np.float32)
        k, j, i = (np.arange(*ends, dtype=np.float64) for ends in box)
        nx, ny, nz = self._layers

        z = _squares_outside(k, nz - 1)
        for odd in (0, 1) if self.lattice == "bcc" else (0,):
            part = slice(odd, None, 2) if self.lattice == "bcc" else slice(None)
            x, y = (2.0 * i + odd, 2.0 * j + odd) if self.lattice == "bcc" else (i, j)
            away = z[part, None, None] + _squares_outside(y, ny - 1)[:, None] + _squares_outside(x, nx - 1)
            found[part][away >= self._squared_radius] = np.nan
        return found

    def replace(self, **changes: Any) -> LatticeSpec:
        """Return the same with some attributes changed."""
        return replace(self, **changes)


__all__ = ["PREFILTER_MARGIN", "Box", "LatticeSpec", "holds", "slices"]
