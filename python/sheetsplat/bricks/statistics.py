"""What looks and plans need to know of all samples of a volume, found brick by brick.

Each brick is surveyed by itself, and surveys are put together in the order of the bricks: the result has the same bits
for any number of processes. What it holds of the samples is what `sheetsplat.look` and `sheetsplat.quality` look at of
a volume in memory, no more than some millions of them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.bricks.lattice import Box, slices
from sheetsplat.bricks.partition import Partition
from sheetsplat.bricks.readers import Shape
from sheetsplat.bricks.resident import residents
from sheetsplat.bricks.sources import BrickSource, box_text
from sheetsplat.errors import complain, option_ref
from sheetsplat.fields.labelled import counts_of_labels
from sheetsplat.fields.samples import grid_steps, mixed_differences
from sheetsplat.look import decades, histogram
from sheetsplat.quality import samples as through

# Samples that are read at once where the first one that is not missing is looked for.
_AT_ONCE = 1 << 22


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
    labels
        Whether samples may be labels.
    """

    shape: Shape
    lattice: str
    strides: tuple[int, ...]
    steps: tuple[int, int, int]
    starts: tuple[int, ...]
    apart: int
    around: int = 0
    first: Any = None
    labels: bool = False

    @classmethod
    def of(cls, shape: Shape, lattice: str, around: int = 0, first: Any = None, labels: bool = False) -> SurveyPlan:
        """Return what looks ask of a volume."""
        size = math.prod(shape)
        strides = sorted({histogram.stride_of(size), decades.stride_of(size), through.stride_of(size)})
        starts, apart = through.rough_layers(shape, lattice)
        k, j, i = grid_steps(shape, lattice)
        return cls(shape, lattice, tuple(strides), (k, j, i), tuple(starts), apart, around, first, labels)

    def margin(self, core: Box) -> Box:
        """Return a box with the samples that differences at its layers need, and those around it."""
        more = (2 * self.apart, 2, 2) if self.starts else (0, 0, 0)
        # Layers of a BCC lattice are half as far apart.
        around = (self.apart * self.around, self.around, self.around)
        k, j, i = ((max(first - before, 0), min(last + max(beyond, before), size))
                   for (first, last), before, beyond, size
                   in zip(core, around, more, self.shape, strict=True))  # fmt: skip
        return k, j, i


@dataclass(frozen=True, eq=False)
class BrickSurvey:
    """What is known of the samples of a brick.

    Attributes
    ----------
    value_range
        Smallest and largest sample; NaN where there are none.
    missing
        Number of NaN.
    extents
        First and last index along i, j, k of the samples that are there, in even and in odd layers, (2, 2, 3): infinite
        where there are none.
    every
        For each stride the numbers of samples, and the samples, type as stored.
    place, grid
        Samples on the grid of `SurveyPlan.steps`, and the first place of these along k, j, i.
    rough
        For the estimate of noise a row a layer: how many second differences, the sum of their squares, how many
        samples, their mean, and the sum of their squared deviations from that.
    same
        Number of samples that are equal to the first one of the volume.
    labels
        The whole numbers among the samples, from the least on, where these may be labels; None: others are among them.
    """

    value_range: tuple[float, float]
    missing: int
    extents: NDArray[np.float64]
    every: tuple[tuple[NDArray[np.int64], NDArray[Any]], ...]
    place: tuple[int, ...]
    grid: NDArray[Any]
    rough: NDArray[np.float64]
    same: int = 0
    labels: tuple[int, ...] | None = None


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
    own = values[slices(core, outer)]
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
        rough = _roughness(values, outer, core, plan)
    starts = [-first % step for (first, _), step in zip(core, plan.steps, strict=True)]
    return BrickSurvey(
        (low, high),
        missing,
        np.array([_extent(own, there if missing else None, core, odd) for odd in (0, 1)]),
        tuple(_every(own, core, stride, plan.shape) for stride in plan.strides),
        tuple((first + start) // step for (first, _), start, step in zip(core, starts, plan.steps, strict=True)),
        own[tuple(slice(start, None, step) for start, step in zip(starts, plan.steps, strict=True))].copy(),
        rough,
        0 if plan.first is None else int(np.count_nonzero(own == plan.first)),
        _labels(own) if plan.labels else None,
    )


def _labels(own: NDArray[Any]) -> tuple[int, ...] | None:
    """Return the whole numbers among samples; None where there are others."""
    if own.dtype.kind == "f" and not np.array_equal(own, np.round(own), equal_nan=True):
        return None
    return tuple(counts_of_labels(own))


def _extent(own: NDArray[Any], there: NDArray[np.bool_] | None, core: Box, odd: int) -> NDArray[np.float64]:
    """Return the extent of the samples in even or odd layers, (2, 3)."""
    start = (odd - core[0][0]) % 2
    part = own[start::2]
    # Along k, j, i; all of them unless some are missing.
    found = [np.arange(size) for size in part.shape] if part.size else [np.arange(0)] * 3
    if there is not None:
        found = [np.flatnonzero(there[start::2].any(axis=axes)) for axes in ((1, 2), (0, 2), (0, 1))]
    if not all(one.size for one in found):
        return np.array([[np.inf] * 3, [-np.inf] * 3])
    k, j, i = (one[[0, -1]] + first for one, (first, _) in zip((2 * found[0] + start, *found[1:]), core, strict=True))
    return np.stack((i, j, k), axis=1).astype(np.float64)


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


def _roughness(values: NDArray[Any], outer: Box, core: Box, plan: SurveyPlan) -> NDArray[np.float64]:
    """Return sums over the brick's own samples of the layers at which noise is estimated: `BrickSurvey.rough`."""
    (k0, k1), (j0, j1), (i0, i1) = core
    (o, _), (oj, _), (oi, _) = outer
    _, nj, ni = plan.shape
    rows = []
    for k in plan.starts:
        if not k0 <= k < k1:
            continue
        around = [values[k + n * plan.apart - o, j0 - oj : min(j1 + 2, nj) - oj, i0 - oi : min(i1 + 2, ni) - oi]
                  for n in range(3)]  # fmt: skip
        layers = [one.astype(np.float64) for one in around]
        own = layers[1][: j1 - j0, : i1 - i0]
        mean = float(own.mean())
        mixed = mixed_differences(layers) if min(layers[0].shape) > 2 else np.zeros(0)
        rows.append([mixed.size, float((mixed**2).sum()), own.size, mean, float(((own - mean) ** 2).sum())])
    return np.asarray(rows, np.float64).reshape(-1, 5)


def survey_of(shared: tuple[Partition, SurveyPlan], source: BrickSource, number: int) -> tuple[BrickSurvey]:
    """Return what is known of one brick, alone in a tuple, whose samples stay in this process where they fit."""
    partition, plan = shared
    core = partition.bricks[number].samples
    assert core is not None
    outer = plan.margin(core)
    values = residents().samples(source, core, outer)
    return (survey_brick(values, outer, core, number, plan, source.name),)


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


def _of_all(labels: Sequence[tuple[int, ...] | None]) -> tuple[tuple[int, ...], ...] | None:
    known = [one for one in labels if one is not None]
    return tuple(known) if len(known) == len(labels) else None


def merge_surveys(_: Any, *parts: tuple[BrickSurvey, ...]) -> tuple[BrickSurvey, ...]:
    """Return the surveys of all groups of bricks, in their order."""
    return tuple(itertools.chain(*parts))


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
        Of samples that are there, in even and in odd layers, (2, 2, 3).
    cores
        Boxes of the bricks, (N, 3, 2).
    first
        The first sample that is not missing, as it is stored; None: there is none.
    same
        Number of samples that are shown as that one is, or about as many.
    labels
        The labels of each brick; None where samples are none, or were not looked at for that.
    """

    source: BrickSource
    ranges: NDArray[np.float64]
    missing: int
    extents: NDArray[np.float64]
    _every: Mapping[int, NDArray[Any]] = field(repr=False)
    _grid: tuple[tuple[int, ...], NDArray[Any]] = field(repr=False)
    _rough: NDArray[np.float64] = field(repr=False)
    cores: NDArray[np.int64] = field(repr=False)
    first: Any = None
    same: int = 0
    labels: tuple[tuple[int, ...], ...] | None = None

    @classmethod
    def of(cls, source: BrickSource, found: Sequence[BrickSurvey], cores: Sequence[Box], plan: SurveyPlan) -> Survey:
        """Return what was found of all bricks, which are in their order, together."""
        kind, every = found[0].grid.dtype, {}
        for at, stride in enumerate(plan.strides):
            every[stride] = np.empty(-(-math.prod(plan.shape) // stride), kind)
            for one in found:
                numbers, values = one.every[at]
                every[stride][numbers // stride] = values
        grid = np.empty([-(-size // step) for size, step in zip(plan.shape, plan.steps, strict=True)], kind)
        for one in found:
            grid[tuple(slice(at, at + size) for at, size in zip(one.place, one.grid.shape, strict=True))] = one.grid
        extents = np.stack([one.extents for one in found])
        return cls(
            source,
            np.asarray([one.value_range for one in found]),
            sum(one.missing for one in found),
            np.stack((extents[:, :, 0].min(axis=0), extents[:, :, 1].max(axis=0)), axis=1),
            every,
            (plan.steps, grid),
            np.concatenate([one.rough for one in found]),
            np.asarray(cores, np.int64),
            plan.first,
            sum(one.same for one in found),
            _of_all([one.labels for one in found]),
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
        if source.label is not None and self.labels is not None:
            ranges[:] = [(one == (source.label,), source.label in one) for one in self.labels]
        else:
            ranges[known] = source.shown_as(self.ranges[known].astype(source.stored))
        steps, grid = self._grid
        every = {stride: source.shown_as(values) for stride, values in self._every.items()}
        same = self.same
        shown_alike = source.key[2:] == self.source.key[2:]
        if self.first is not None and not shown_alike:
            # Others may be shown as the first one is: of many samples, by those that are kept.
            some = every[min(every)]
            same = round(float(np.mean(some == source.shown_as(self.first)[0])) * self.size)
        return replace(
            self, source=source, ranges=ranges, _every=every, _grid=(steps, source.shown_as(grid)), same=same
        )

    def near(self, samples: Box) -> NDArray[np.bool_]:
        """Return which bricks have samples of a box of the volume."""
        needed = np.asarray(samples)
        found: NDArray[np.bool_] = np.ones(len(self.cores), bool)
        for axis, (first, last) in enumerate(needed.tolist()):
            found &= (self.cores[:, axis, 0] < last) & (self.cores[:, axis, 1] > first)
        return found

    def labels_in(self, samples: Box | None = None) -> tuple[int, ...]:
        """Return the labels of the bricks that have samples of a box, of all unless given; none of values."""
        if self.labels is None:
            return ()
        numbers = range(len(self.labels)) if samples is None else np.flatnonzero(self.near(samples)).tolist()
        return tuple(sorted(set().union(*(self.labels[n] for n in numbers))))

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
        extents = self.extents
        if lattice == "bcc":
            # Odd layers are moved by half an edge along x and y.
            odd = np.arange(2)[:, None, None]
            extents = np.concatenate((2 * extents[:, :, :2] + odd, extents[:, :, 2:]), axis=2)
        low, high = extents[:, 0].min(axis=0), extents[:, 1].max(axis=0)
        if not np.isfinite(low).all():
            return (0, 0, 0), (0, 0, 0)
        (a, b, c), (d, e, f) = low.astype(int).tolist(), high.astype(int).tolist()
        return (a, b, c), (d, e, f)

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
        if not len(self._rough):
            return 1.0, 0.0
        mixed, squares, counts, means, deviations = self._rough.T
        with np.errstate(all="ignore"):
            mean = (means * (counts / counts.sum())).sum()
            # Of parts together (Chan, Golub and LeVeque 1983).
            total = deviations.sum() + (counts * (means - mean) ** 2).sum()
        if not mixed.sum() or not math.isfinite(squares.sum() + total):
            # Beyond 1e150 squares overflow: nothing but noise.
            return 1.0, 1e-300
        return float(squares.sum() / mixed.sum()), float(total / counts.sum())
