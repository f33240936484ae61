"""Volumes whose samples are in files or other processes, and are read in bricks when a picture is drawn."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NoReturn, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat import _sheetsplat
from sheetsplat._checks import Bounds, Triple, choice, number, optional_number, triple, truth
from sheetsplat.errors import Unsupported, complain
from sheetsplat.fields import ending, labelled
from sheetsplat.fields.base import NOT_OPENED, Field
from sheetsplat.fields.regular import BOUNDARIES, PARTS, RegularField, one_place
from sheetsplat.fields.samples import Samples
from sheetsplat.fields.stated import Stated
from sheetsplat.fields.trim import Trim
from sheetsplat.orientation import Orientation
from sheetsplat.quantity import Quantity
from sheetsplat.transfer import TransferFunction

#: What to do where data in bricks have no weights of means.
INSTEAD_OF_WEIGHTS = "open it with sheetsplat.open, or divide the x-ray of products by that of the weights"
# Samples at which kernels are tried: more than the prefilter of any usable kernel reaches.
_TRIED = (8, 8, 8)


class Source(Protocol):
    """Where the samples are: `sheetsplat.bricks.sources.BrickSource`."""

    @property
    def name(self) -> str:
        """How messages call it."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of samples along k, j, i."""

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the samples."""

    @property
    def quantity(self) -> Quantity:
        """What the samples are."""

    @property
    def orientation(self) -> Orientation | None:
        """Which way up the volume is."""

    def read(self, box: Any) -> NDArray[Any]:
        """Return the samples of a box."""

    def replace(self, **changes: Any) -> Source:
        """Return the same samples shown in another way."""


class Survey(Samples, Protocol):
    """What is known of all samples: `sheetsplat.bricks.statistics.Survey`."""

    @property
    def ranges(self) -> NDArray[np.float64]:
        """Smallest and largest sample of each brick, (N, 2); NaN where it has none."""

    @property
    def cores(self) -> NDArray[np.int64]:
        """Boxes of the bricks, first and last index along k, j, i, (N, 3, 2)."""

    @property
    def value_range(self) -> tuple[float, float]:
        """Smallest and largest sample."""

    @property
    def base(self) -> float:
        """The offset of values unless it is given."""

    def centres(self, lattice: str) -> tuple[tuple[int, int, int], tuple[int, int, int]]:
        """Return the first and the last step of lattice planes with samples along x, y, z."""

    def near(self, samples: Any) -> NDArray[np.bool_]:
        """Return which bricks have samples of a box of the volume."""

    def labels_in(self, samples: Any = None) -> tuple[int, ...]:
        """Return the labels of the bricks that have samples of a box, of all unless given; none of values."""

    def shown_by(self, source: Any) -> Survey:
        """Return what is known of the same samples shown in another way."""


class Prober(Protocol):
    """Reads bricks for values at points: `sheetsplat.bricks.prober.BrickProber`."""

    def sums(
        self, field: BrickedField, places: NDArray[np.float64], columns: int
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return the first of D, W and their derivatives, (M, columns), and numbers of the nearest kernels, (M,)."""

    def where_seen(self, function: TransferFunction) -> Prober:
        """Return one that reads no bricks in which a transfer function shows nothing; sums are 0 there."""


class BrickedField(RegularField):
    """A volume whose samples are read in bricks when a picture is drawn. Made by `sheetsplat.open_bricks`. Immutable.

    It has the options, the bounds and the range of values of a `RegularField`, and pictures of it are drawn by
    `sheetsplat.render`, brick by brick: of the samples no more is in memory than the bricks that are drawn. Values at
    points (`at`, `evaluate`) are those of the bricks that the points lie in. Whatever needs all samples at once
    (`values`) raises Unsupported.

    Attributes
    ----------
    source
        Where the samples are.
    survey
        What is known of all of them.
    brick
        Edge of a brick in samples.

    Examples
    --------
    >>> bricked = ss.open_bricks(values, brick=16)
    >>> bricked.shape == values.shape
    True
    """

    __slots__ = ("_condition", "_prefilter", "_prober", "brick", "source", "survey")

    def __init__(
        self,
        source: Source,
        survey: Survey,
        brick: int,
        *,
        spacing: Any = None,
        origin: Any = (0.0, 0.0, 0.0),
        lattice: str = "cartesian",
        radius: float = 2.0,
        falloff: float = 5.0,
        normalization: str = "lattice",
        w0: float = 1.0,
        prefilter: bool | None = None,
        nan: str = "error",
        boundary: str = "edge",
        base: float | None = None,
        axes: Any = None,
        labels: bool = False,
    ) -> None:
        self._quantity, self._opened, self._orientation = source.quantity, NOT_OPENED, source.orientation
        self._trim, self._prober, self._weighting, self._stated = Trim(), None, None, Stated()
        self._labels, self._colors, self._parts_made = truth("open_bricks: labels", labels), None, {}
        self._place(axes, spacing)
        self._origin = triple("open_bricks: origin", origin)
        self._lattice = choice("open_bricks: lattice", lattice, ("cartesian", "bcc"))
        self._radius = number("open_bricks: radius", radius)
        self._falloff = number("open_bricks: falloff", falloff)
        kinds = ("none", "lattice", "threshold")
        self._normalization = choice("open_bricks: normalization", normalization, kinds)
        self._w0 = number("open_bricks: w0", w0)
        self._nan = choice("open_bricks: nan", nan, ("error", "skip"))
        self._boundary = choice("open_bricks: boundary", boundary, BOUNDARIES)
        self._base = optional_number("open_bricks: base", base)
        self._settled = prefilter is not None
        self._prefilter = prefilter is not None and truth("open_bricks: prefilter", prefilter)
        if self._prefilter and self._normalization == "none":
            self._normalization = "lattice"
        if self._labels:
            mixing: Any = {"prefilter": (self._prefilter, False), "normalization": (self._normalization, "lattice")}
            labelled.require_labels(np.zeros(0, np.uint8), **mixing, base=(self._base or 0.0, 0.0))
        self._set(source, survey, brick)
        self._condition = None
        if self._prefilter:
            # The same errors as those of a volume in memory: of kernels that lose the samples, and of NaN.
            tried = np.zeros(_TRIED, np.float32)
            tried[0, 0, 0] = np.nan if survey.missing else 0.0
            figures = self._made(tried, prefilter=True).prefilter_figures
            self._condition = None if figures is None else figures["condition"]
            self._normalization = "none"

    def _set(self, source: Source, survey: Survey, brick: int) -> None:
        """Set the samples, and a native field of two of them, for what scenes ask a field for."""
        self.source, self.survey, self.brick = source, survey, brick
        self.native = self._stand_in(source, survey)

    def _stand_in(self, source: Source, survey: Survey) -> _sheetsplat.RegularField:
        # With the base of all samples, and no end of its own.
        base = 0.0 if self._labels else self._base
        if base is None:
            chosen = self._boundary == "edge" and (self._prefilter or self._normalization != "none")
            base = survey.base if chosen else 0.0
        return self._made(np.asarray([[survey.value_range]], dtype=source.dtype), base=base, boundary="zero")

    def _parts(self) -> dict[str, Any]:
        own = ("source", "survey", "brick", "_prefilter", "_condition")
        return {name: getattr(self, name) for name in (*PARTS, *own, "_stated")}

    def _restore(self, parts: dict[str, Any]) -> None:
        # What reads bricks for values at points belongs to the process that opened them.
        self._prober, self._parts_made = None, {}
        for name in (*PARTS, "_prefilter", "_condition", "_stated"):
            setattr(self, name, parts[name])
        self._set(parts["source"], parts["survey"], parts["brick"])

    def replace(self, values: ArrayLike | None = None, **changes: Any) -> BrickedField:
        """Return a field of the same samples with some options changed; other samples are refused."""
        if values is not None:
            self._refuse("other samples")
        options = {name.removeprefix("_"): getattr(self, name) for name in PARTS if name != "_colors"}
        options["prefilter"] = self.prefilter if options.pop("settled") else None
        if self.prefilter:
            # The one that it set itself.
            del options["normalization"]
        made = BrickedField(self.source, self.survey, self.brick, **one_place({**options, **changes}, changes))
        return made.told_by(self).probed_by(self._prober)

    def probed_by(self, prober: Prober | None) -> BrickedField:
        """Return the same field with what reads bricks for values at points."""
        return self._with(_prober=prober)

    def where_seen(self, function: TransferFunction) -> BrickedField:
        """Return the same field; bricks in which a transfer function shows nothing are not read for values at points.

        They are 0 there.
        """
        return self if self._prober is None else self._with(_prober=self._prober.where_seen(function))

    @property
    def can_be_probed(self) -> bool:
        """Whether it has values at points: in the process that opened it."""
        return self._prober is not None

    def _shown(self, **changes: Any) -> BrickedField:
        source = self.source.replace(**changes)
        survey = self.survey.shown_by(source)
        return self._with(source=source, survey=survey, native=self._stand_in(source, survey))

    def logarithmic(self, floor: float | None) -> BrickedField:
        """Return a field of log10(value / floor), 0 for smaller values; without a floor one of the values."""
        return self._shown(floor=floor)

    def clipped(self, limits: tuple[float, float]) -> BrickedField:
        """Return a field whose samples are clamped to the limits."""
        return self._shown(limits=limits)

    def _refuse(self, what: str, advice: str = "open it with sheetsplat.open") -> NoReturn:
        raise complain(
            f"{what} of a volume in bricks cannot be had",
            f"{self.source.name}, whose samples are not in memory",
            "a volume in memory",
            advice,
            kind=Unsupported,
        )

    def weighted_by(self, weight: ArrayLike | Field | None) -> BrickedField:
        """Raise Unsupported for weights: samples are not in memory."""
        if weight is not None:
            self._refuse("weighted means", INSTEAD_OF_WEIGHTS)
        return self

    @property
    def values(self) -> NDArray[Any]:  # type: ignore[override]
        """Raise Unsupported: the samples are not in memory."""
        self._refuse("all samples")

    @property
    def coefficients(self) -> NDArray[Any]:  # type: ignore[override]
        """Raise Unsupported: the samples are not in memory."""
        self._refuse("all coefficients")

    def at(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the scalar at points (M, 3) in the world, shape (M,); the bricks that they lie in are read.

        Raises
        ------
        InvalidInput
            For anything but M times three finite numbers.
        Error
            What reading a brick raises.
        """
        return self._scalars(self._found(self._places(points), 2)[0])

    def _found(self, places: NDArray[np.float64], columns: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        if self._prober is None:
            self._refuse("values at points")
        return self._prober.sums(self, places, columns)

    @property
    def labels_found(self) -> tuple[int, ...]:
        """The labels among the samples, from the least one on. InvalidInput for more than are told apart."""
        return labelled.told_apart(self.survey.labels_in())

    def labels_unseen(self, shown: Iterable[int]) -> tuple[int, ...]:
        """Return nothing: the samples of bricks are not looked at twice."""
        return ()

    def part_of_label(self, label: int) -> _sheetsplat.RegularField:
        """Return a native field of two samples, 0 and 1, for what scenes ask the field of a label for."""
        if label not in self._parts_made:
            self._parts_made[label] = self._made(np.array([[[0, 1]]], np.uint8), base=0.0, boundary="zero")
        made: _sheetsplat.RegularField = self._parts_made[label]
        return made

    def field_of_label(self, label: int) -> BrickedField:
        """Return the field that is 1 at the samples of a label and 0 elsewhere; its bricks are read anew."""
        source = self.source.replace(label=label)
        native, survey = self.part_of_label(label), self.survey.shown_by(source)
        return self._with(native=native, source=source, survey=survey, _labels=False, _base=0.0, _parts_made={})

    @property
    def samples(self) -> Samples:
        """Statistics of the samples from which colours and opacity are chosen."""
        return self.survey

    @property
    def value_range(self) -> tuple[float, float]:
        """Smallest and largest sample, which coefficients may exceed."""
        return self.survey.value_range

    @property
    def domain(self) -> Bounds | None:
        """World-aligned box around where the volume ends, its lower and its upper corner; None: it ends nowhere."""
        return ending.domain(self.shape, self._lattice, self._boundary, self._spacing, self._origin, self._axes)

    @property
    def _least_weight(self) -> float:
        divided = self._normalization == "lattice" and not self._prefilter
        if not (divided and self.survey.missing and ending.ends(self.shape, self._lattice, self._boundary)):
            return 0.0
        return ending.least_weight(self._radius, self._falloff, self._lattice)

    @property
    def prefilter(self) -> bool:
        """Whether the kernels' sum passes through the samples."""
        return self._prefilter

    @property
    def prefilter_residual(self) -> float | None:
        """Not known of a volume in bricks: None."""
        return None

    @property
    def prefilter_condition(self) -> float | None:
        """Largest amplification of errors from samples to coefficients; None unless prefiltered."""
        return self._condition

    @property
    def shape(self) -> tuple[int, int, int]:
        """Samples along k, j, i."""
        return self.source.shape

    @property
    def size(self) -> int:  # type: ignore[override]
        """Number of kernels, skipped samples excluded."""
        return self.survey.size - self.survey.missing

    @property
    def centre_bounds(self) -> Bounds:  # type: ignore[override]
        """World-aligned box around all kernel centres: its lower and its upper corner."""
        first, last = self.survey.centres(self._lattice)
        if self._axes is not None:
            ends = np.array((first, last))[:, :, None] * self._axes
            low, high = ends.min(axis=0).sum(axis=0), ends.max(axis=0).sum(axis=0)
            return triple("bounds", self._origin + low), triple("bounds", self._origin + high)
        half = 0.5 * self._spacing[0]
        steps = (half, half, half) if self._lattice == "bcc" else self._spacing

        def at(numbers: tuple[int, int, int]) -> Triple:
            return triple("bounds", [o + d * n for o, d, n in zip(self._origin, steps, numbers, strict=True)])

        return at(first), at(last)

    @property
    def bounds(self) -> Bounds:  # type: ignore[override]
        """World-aligned box around all supports: its lower and its upper corner."""
        lower, upper = self.centre_bounds
        if self._axes is not None:
            extent = self._radius * np.linalg.norm(self._axes, axis=0)
            return triple("bounds", np.asarray(lower) - extent), triple("bounds", np.asarray(upper) + extent)
        length = self._spacing[0] / np.sqrt(2.0)
        steps = (length, length, length) if self._lattice == "bcc" else self._spacing
        reach = np.asarray(steps) * self._radius
        return triple("bounds", np.asarray(lower) - reach), triple("bounds", np.asarray(upper) + reach)
