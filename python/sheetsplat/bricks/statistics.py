"""What looks and plans need to know of all samples of a volume, found brick by brick.

Each brick is surveyed by itself, and surveys are merged in the order of the bricks: the result has the same bits for
any number of processes. What it holds of the samples is what `sheetsplat.look` and `sheetsplat.quality` look at of a
volume in memory, no more than some millions of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.bricks.lattice import Box
from sheetsplat.bricks.partition import Partition
from sheetsplat.bricks.readers import Shape
from sheetsplat.bricks.resident import residents
from sheetsplat.bricks.sources import BrickSource, box_text
from sheetsplat.errors import complain, option_ref
from sheetsplat.fields.samples import grid_steps, mixed_differences
from sheetsplat.look import decades, histogram
from sheetsplat.quality import samples as through

# Samples that are read at once where the first one that is not missing is looked for.
_AT_ONCE = 1 << 22
# First and last index along i, j, k of the samples that are there.
_Extent = tuple[tuple[int, int, int], tuple[int, int, int]]


@dataclass(frozen=True)
class SurveyPlan:
    """What is asked of the samples of a volume.

    Attributes
    ----------
    shape, lattice
        Of the volume.
    strides
        Of every so many samples one is kept.
    steps
        One is kept of so many along k, j, i.
    starts, apart
        Layers at which noise is estimated, `quality.samples.rough_layers`.
    around
        Samples around a brick that its pictures will need, so that they are read now.
    first
        The first sample that is not missing, in the order of the array, as it is stored; None: there is none.
    """

    shape: Shape
    lattice: str
    strides: tuple[int, ...]
    steps: tuple[int, int, int]
    starts: tuple[int, ...]
    apart: int
    around: int = 0
    first: Any = None

    @classmethod
    def of(cls, shape: Shape, lattice: str, around: int = 0, first: Any = None) -> SurveyPlan:
        """Return what looks ask of a volume."""
        size = math.prod(shape)
        strides = sorted({histogram.stride_of(size), decades.stride_of(size), through.stride_of(size)})
        starts, apart = through.rough_layers(shape, lattice)
        k, j, i = grid_steps(shape, lattice)
        return cls(shape, lattice, tuple(strides), (k, j, i), tuple(starts), apart, around, first)

    def margin(self, core: Box) -> Box:
        """Return a box with the samples that differences at its layers need, and those around it."""
        more = (2 * self.apart, 2, 2) if self.starts else (0, 0, 0)
        # Layers of a BCC lattice are half as far apart.
        around = (self.apart * self.around, self.around, self.around)
        k, j, i = ((max(first - before, 0), min(last + max(beyond, before), size))
                   for (first, last), before, beyond, size
                   in zip(core, around, more, self.shape, strict=True))  # fmt: skip
        return k, j, i


@dataclass(frozen=True)
class _Rough:
    """Sums of squared second differences, and mean and squared deviations of the samples of middle layers."""

    mixed_count: int = 0
    mixed_squares: float = 0.0
    count: int = 0
    mean: float = 0.0
    deviations: float = 0.0

    def __add__(self, other: _Rough) -> _Rough:
        """Return both together (Chan, Golub and LeVeque 1983, equation 2.1)."""
        count = self.count + other.count
        if not count:
            return _Rough(self.mixed_count + other.mixed_count, self.mixed_squares + other.mixed_squares)
        apart = other.mean - self.mean
        return _Rough(
            self.mixed_count + other.mixed_count,
            self.mixed_squares + other.mixed_squares,
            count,
            self.mean + apart * (other.count / count),
            self.deviations + other.deviations + apart * apart * (self.count * (other.count / count)),
        )


@dataclass(frozen=True, eq=False)
class BrickSurvey:
    """What is known of the samples of some bricks.

    Attributes
    ----------
    ranges
        Smallest and largest sample of each brick by its number; NaN where a brick has none.
    missing
        Number of NaN.
    extents
        Of the samples that are there, in even and in odd layers; None: none.
    every
        For each stride the numbers of samples, and the samples, type as stored.
    grid
        Pieces of the samples on the grid of `steps`: the first place along k, j, i, and the samples.
    rough
        Sums for the estimate of noise.
    same
        Number of samples that are equal to the first one of the volume.
    """

    ranges: Mapping[int, tuple[float, float]]
    missing: int
    extents: tuple[_Extent | None, _Extent | None]
    every: Mapping[int, tuple[NDArray[np.int64], NDArray[Any]]]
    grid: tuple[tuple[tuple[int, int, int], NDArray[Any]], ...]
    rough: _Rough
    same: int = 0


def survey_brick(values: NDArray[Any], outer: Box, core: Box, number: int, plan: SurveyPlan, name: str) -> BrickSurvey:
    """Return what is known of a brick.

    Parameters
    ----------
    values, outer
        Samples [k, j, i] and where in the volume they are; at least `SurveyPlan.margin` of the brick.
    core
        The brick's own samples.
    number
        Of the brick.
    plan
        What is asked.
    name
        Of the volume, for messages.

    Raises
    ------
    InvalidInput
        For infinite samples.
    """
    own = values[tuple(slice(a - o, b - o) for (a, b), (o, _) in zip(core, outer, strict=True))]
    there = ~np.isnan(own) if own.dtype.kind == "f" else None
    missing = 0 if there is None else own.size - int(np.count_nonzero(there))
    if missing == own.size:
        low = high = math.nan
    elif own.dtype.kind == "f":
        low, high = float(np.nanmin(own)), float(np.nanmax(own))
    else:
        low, high = float(own.min()), float(own.max())
    if math.isinf(low) or math.isinf(high):
        first = np.argwhere(np.isinf(own))[0] + [first for first, _ in core]
        raise complain(
            f"{name} cannot be drawn",
            f"an infinite sample at {[int(part) for part in first]}, in brick {number} {box_text(core)}",
            "finite numbers",
            "make it NaN, with " + option_ref("nan", "skip"),
        )
    with np.errstate(all="ignore"):
        rough = _roughness(values, outer, core, plan) if plan.starts else _Rough()
    return BrickSurvey(
        {number: (low, high)},
        missing,
        (_extent(own, there if missing else None, core, 0), _extent(own, there if missing else None, core, 1)),
        {stride: _every(own, core, stride, plan.shape) for stride in plan.strides},
        tuple(_on_grid(own, core, plan.steps)),
        rough,
        0 if plan.first is None else int(np.count_nonzero(own == plan.first)),
    )


def _extent(own: NDArray[Any], there: NDArray[np.bool_] | None, core: Box, odd: int) -> _Extent | None:
    """Return the extent of the samples in even or odd layers."""
    (k0, k1), (j0, j1), (i0, i1) = core
    start = (odd - k0) % 2
    if start >= k1 - k0:
        return None
    if there is None:
        last = k0 + start + (k1 - 1 - k0 - start) // 2 * 2
        return (i0, j0, k0 + start), (i1 - 1, j1 - 1, last)
    part = there[start::2]
    if not part.any():
        return None
    k, j, i = (np.flatnonzero(part.any(axis=axes)) for axes in ((1, 2), (0, 2), (0, 1)))
    first = int(i[0]) + i0, int(j[0]) + j0, int(k[0]) * 2 + start + k0
    return first, (int(i[-1]) + i0, int(j[-1]) + j0, int(k[-1]) * 2 + start + k0)


def _every(own: NDArray[Any], core: Box, stride: int, shape: Shape) -> tuple[NDArray[np.int64], NDArray[Any]]:
    """Return the samples of a brick whose numbers in the volume are multiples of the stride, and these numbers."""
    _, nj, ni = shape
    (k0, k1), (j0, j1), (i0, i1) = core
    found, values = [], []
    # A layer at a time: numbers of a whole brick would take eight times its memory.
    for k in range(k0, k1):
        first = -(-(k * nj + j0) * ni // stride) * stride
        numbers = np.arange(first, (k * nj + j1) * ni, stride, dtype=np.int64)
        rows, i = np.divmod(numbers, ni)
        kept = (i >= i0) & (i < i1)
        found.append(numbers[kept])
        values.append(own[k - k0, rows[kept] - k * nj - j0, i[kept] - i0])
    return np.concatenate(found), np.concatenate(values)


def _on_grid(own: NDArray[Any], core: Box, steps: Sequence[int]) -> list[tuple[tuple[int, int, int], NDArray[Any]]]:
    """Return the samples of a brick on the grid, or none."""
    starts = [-first % step for (first, _), step in zip(core, steps, strict=True)]
    part = own[tuple(slice(start, None, step) for start, step in zip(starts, steps, strict=True))]
    if not part.size:
        return []
    k, j, i = ((first + start) // step for (first, _), start, step in zip(core, starts, steps, strict=True))
    return [((k, j, i), part.copy())]


def _roughness(values: NDArray[Any], outer: Box, core: Box, plan: SurveyPlan) -> _Rough:
    """Return sums over the brick's own samples of the layers at which noise is estimated."""
    (k0, k1), (j0, j1), (i0, i1) = core
    (o, _), (oj, _), (oi, _) = outer
    _, nj, ni = plan.shape
    total = _Rough()
    for k in plan.starts:
        if not k0 <= k < k1:
            continue
        around = [values[k + n * plan.apart - o, j0 - oj : min(j1 + 2, nj) - oj, i0 - oi : min(i1 + 2, ni) - oi]
                  for n in range(3)]  # fmt: skip
        layers = [one.astype(np.float64) for one in around]
        own = layers[1][: j1 - j0, : i1 - i0]
        mean = float(own.mean())
        total += _Rough(count=own.size, mean=mean, deviations=float(((own - mean) ** 2).sum()))
        if min(layers[0].shape) > 2:
            mixed = mixed_differences(layers)
            total += _Rough(mixed.size, float((mixed**2).sum()))
    return total


def survey_of(source: BrickSource, partition: Partition, number: int, plan: SurveyPlan) -> BrickSurvey:
    """Return what is known of one brick, whose samples stay in this process where they fit."""
    core = partition.bricks[number].samples
    assert core is not None
    outer = plan.margin(core)
    values = residents().samples(source, core, outer)
    return survey_brick(values, outer, core, number, plan, source.name)


def first_sample(source: BrickSource) -> Any:
    """Return the first sample that is not missing, in the order of the array, as it is stored; None: there is none."""
    nk, nj, ni = source.shape
    rows = max(1, _AT_ONCE // ni)
    corner = source.read(((0, 1), (0, 1), (0, 1)))[0, 0, 0]
    if not corner != corner:
        return corner
    for k in range(nk):
        for j in range(0, nj, rows):
            part = source.read(((k, k + 1), (j, min(j + rows, nj)), (0, ni))).reshape(-1)
            there = np.flatnonzero(~np.isnan(part))
            if there.size:
                return part[there[0]]
    return None


def merge_surveys(parts: Sequence[BrickSurvey]) -> BrickSurvey:
    """Return what is known of all bricks of several surveys, which are in the order of the bricks."""
    every = {}
    for stride in parts[0].every:
        numbers = np.concatenate([one.every[stride][0] for one in parts])
        values = np.concatenate([one.every[stride][1] for one in parts])
        order = np.argsort(numbers, kind="stable")
        every[stride] = (numbers[order], values[order])
    rough = _Rough()
    for one in parts:
        rough += one.rough
    return BrickSurvey(
        {number: found for one in parts for number, found in one.ranges.items()},
        sum(one.missing for one in parts),
        (_joined([one.extents[0] for one in parts]), _joined([one.extents[1] for one in parts])),
        every,
        tuple(piece for one in parts for piece in one.grid),
        rough,
        sum(one.same for one in parts),
    )


def _joined(extents: Sequence[_Extent | None]) -> _Extent | None:
    known = [one for one in extents if one is not None]
    if not known:
        return None
    low, high = (np.asarray([one[end] for one in known]) for end in (0, 1))
    (a, b, c), (d, e, f) = low.min(axis=0).tolist(), high.max(axis=0).tolist()
    return (a, b, c), (d, e, f)


@dataclass(frozen=True, eq=False)
class Survey:
    """What is known of all samples of a volume: what looks ask of `fields.samples.Samples`, and more.

    Attributes
    ----------
    source
        The volume.
    ranges
        Smallest and largest sample of each brick, (N, 2); NaN where it has none.
    missing
        Number of NaN.
    extents
        Of samples that are there, in even and in odd layers.
    cores
        Boxes of the bricks, (N, 3, 2).
    first
        The first sample that is not missing, as it is stored; None: there is none.
    same
        Number of samples that are shown as that one is, or about as many.
    """

    source: BrickSource
    ranges: NDArray[np.float64]
    missing: int
    extents: tuple[_Extent | None, _Extent | None]
    _every: Mapping[int, NDArray[Any]] = field(repr=False)
    _grid: tuple[tuple[int, ...], NDArray[Any]] = field(repr=False)
    _rough: _Rough
    cores: NDArray[np.int64] = field(repr=False)
    first: Any = None
    same: int = 0

    @classmethod
    def of(cls, source: BrickSource, found: BrickSurvey, cores: Sequence[Box], plan: SurveyPlan) -> Survey:
        """Return what was found of all bricks together."""
        places = tuple(-(-size // step) for size, step in zip(plan.shape, plan.steps, strict=True))
        grid = np.empty(places, found.grid[0][1].dtype)
        for (k, j, i), part in found.grid:
            grid[k : k + part.shape[0], j : j + part.shape[1], i : i + part.shape[2]] = part
        return cls(
            source,
            np.asarray([found.ranges[number] for number in range(len(cores))]),
            found.missing,
            found.extents,
            {stride: values for stride, (_, values) in found.every.items()},
            (plan.steps, grid),
            found.rough,
            np.asarray(cores, np.int64),
            plan.first,
            found.same,
        )

    def __eq__(self, other: object) -> bool:
        """Return whether it is of the same samples."""
        return self.source == other.source if isinstance(other, Survey) else NotImplemented

    def __hash__(self) -> int:
        """Return a hash of the samples' token."""
        return hash(self.source)

    def shown_by(self, source: BrickSource) -> Survey:
        """Return what is known of the same samples shown in another way; a source keeps their order."""
        known = ~np.isnan(self.ranges)
        ranges = self.ranges.copy()
        ranges[known] = source.shown_as(self.ranges[known].astype(source.stored))
        steps, grid = self._grid
        every = {stride: source.shown_as(values) for stride, values in self._every.items()}
        same = self.same
        shown_alike = (source.floor, source.limits) == (self.source.floor, self.source.limits)
        if self.first is not None and not shown_alike:
            # Others may be shown as the first one is: of many samples, by those that are kept.
            some = every[min(every)]
            same = round(float(np.mean(some == source.shown_as(self.first)[0])) * self.size)
        return replace(
            self, source=source, ranges=ranges, _every=every, _grid=(steps, source.shown_as(grid)), same=same
        )

    @property
    def base(self) -> float:
        """The offset of values unless it is given: see `RegularField`."""
        if self.first is None:
            return 0.0
        enough = -(-(self.size - self.missing) // 100)
        if self.same >= enough:
            return float(self.source.shown_as(self.first)[0])
        low, high = self.value_range
        return 0.5 * low + 0.5 * high

    @property
    def shape(self) -> Shape:
        """Number along k, j, i."""
        return self.source.shape

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type in which the field keeps them."""
        return self.source.dtype

    @property
    def size(self) -> int:
        """Number of samples, NaN included."""
        return self.source.size

    @property
    def value_range(self) -> tuple[float, float]:
        """Smallest and largest sample; 0, 0 without samples."""
        if self.missing == self.size:
            return 0.0, 0.0
        return float(np.nanmin(self.ranges[:, 0])), float(np.nanmax(self.ranges[:, 1]))

    def centres(self, lattice: str) -> tuple[tuple[int, int, int], tuple[int, int, int]]:
        """Return the first and the last step of lattice planes with samples along x, y, z.

        Steps of a BCC lattice are halves of the edge of its cube.
        """
        if lattice == "bcc":
            known = []
            for odd, one in enumerate(self.extents):
                if one is not None:
                    (a, b, c), (d, e, f) = one
                    known.append(((2 * a + odd, 2 * b + odd, c), (2 * d + odd, 2 * e + odd, f)))
            found = _joined(known)
        else:
            found = _joined(self.extents)
        return ((0, 0, 0), (0, 0, 0)) if found is None else found

    def every(self, stride: int) -> NDArray[Any]:
        """Return every n-th sample, counted along the last axis first."""
        return self._every[stride]

    @property
    def steps(self) -> tuple[int, ...]:
        """Of how many samples along each axis one is known."""
        return tuple(self._grid[0])

    def on_grid(self, steps: Sequence[int]) -> NDArray[Any]:
        """Return every n-th sample along each axis."""
        known, grid = self._grid
        assert tuple(steps) == tuple(known)
        return grid

    def number(self, at: int) -> float:
        """Return one sample by its number."""
        k, j, i = (int(part) for part in np.unravel_index(at, self.shape))
        return float(self.source.read(((k, k + 1), (j, j + 1), (i, i + 1)))[0, 0, 0])

    def _read_again(self, limit: float, *, above: bool) -> list[tuple[Box, NDArray[Any]]]:
        """Return the bricks that have samples beyond a limit."""
        beyond = self.ranges[:, 1] > limit if above else self.ranges[:, 0] < limit
        boxes = [self._box(number) for number in np.flatnonzero(beyond).tolist()]
        return [(box, self.source.read(box)) for box in boxes]

    def _box(self, number: int) -> Box:
        (a, b), (c, d), (e, f) = self.cores[number].tolist()
        return (a, b), (c, d), (e, f)

    def beyond(self, limit: float, *, above: bool) -> NDArray[np.int64]:
        """Return the numbers of samples beyond a limit; the bricks that have any are read once more."""
        found = []
        for core, values in self._read_again(limit, above=above):
            at = np.argwhere(values > limit if above else values < limit) + [first for first, _ in core]
            found.append(np.ravel_multi_index(tuple(at.T), self.shape))
        return np.sort(np.concatenate(found)).astype(np.int64) if found else np.empty(0, np.int64)

    def within(self, most: float) -> tuple[int, float, float]:
        """Return number, smallest and largest of the samples of smaller magnitude."""
        count, low, high = self.size - self.missing, math.inf, -math.inf
        for number, (least, largest) in enumerate(self.ranges.tolist()):
            if math.isnan(least):
                continue
            if max(abs(least), abs(largest)) >= most:
                values = self.source.read(self._box(number))
                usual = values[np.abs(values) < most]
                count -= values.size - int(np.isnan(values).sum()) - usual.size
                if not usual.size:
                    continue
                least, largest = usual.min(), usual.max()
            low, high = min(low, float(least)), max(high, float(largest))
        return count, low, high

    def roughness(self, starts: Sequence[int], apart: int, values: tuple[float, float]) -> tuple[float, float]:
        """Return the mean square of second differences, and the variance."""
        one = self._rough
        if not one.count or not one.mixed_count or not math.isfinite(one.mixed_squares + one.deviations):
            # Beyond 1e150 squares overflow: nothing but noise.
            return 1.0, 0.0 if not one.count else 1e-300
        return one.mixed_squares / one.mixed_count, one.deviations / one.count
