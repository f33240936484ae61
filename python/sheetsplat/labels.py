"""Colours of labels: whole numbers that name things. Conventions, section 4 (Labels)."""

from __future__ import annotations

import colorsys
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from sheetsplat import _sheetsplat
from sheetsplat._checks import color, instance, number, parts, shown, whole
from sheetsplat.errors import complain, unusable
from sheetsplat.fields import RegularField
from sheetsplat.fields.stated import NamedColors
from sheetsplat.transfer import TransferFunction

# Of numbers of labels, which float64 holds with what lies half a number beside them.
_BITS = 41
# Half the distance of labels: where the table of one ends.
_BESIDE = 0.5
# Steps around the circle of hues: of neighbouring labels far apart, and of any number of them all different.
_GOLDEN = 0.61803398875


class LabelColors(TransferFunction):
    """Colours and opacities of labels, in the place of a transfer function. Immutable.

    As a transfer function it is a table of steps, each from half a number below a label to half a number above it.

    Parameters
    ----------
    colors
        For each label that is shown its red, green and blue, not multiplied by opacity, or the name of a colour; with a
        fourth number its opacity per reference length, in [0, 1], 1 unless given. Labels without a colour are not
        shown; labels that are not in the data change nothing.
    names
        What labels are called, in legends and by `pick`.
    background
        The label of what is no thing.

    Raises
    ------
    InvalidInput
        For labels that are no whole numbers, and colours that are none.

    Examples
    --------
    >>> colors = ss.LabelColors({1: (1, 0.3, 0.2), 2: ("skyblue", 0.1)}, names={1: "liver", 2: "lung"})
    >>> sorted(colors.colors), colors.names[2], colors.at(1).tolist()
    ([1, 2], 'lung', [1.0, 0.3, 0.2, 1.0])
    """

    __slots__ = ("_background", "_colors", "_names")
    _colors: Mapping[int, tuple[float, float, float, float]]
    _names: Mapping[int, str]

    def __init__(
        self,
        colors: Mapping[int, Sequence[float] | str | tuple[str, float]],
        names: Mapping[int, str] | None = None,
        background: int = 0,
    ) -> None:
        instance("LabelColors: colors", colors, Mapping)
        if names is not None:
            instance("LabelColors: names", names, Mapping)
        made = {_label(one): _color(given) for one, given in colors.items()}
        self._colors = MappingProxyType(dict(sorted(made.items())))
        self._names = MappingProxyType({_label(one): _name(given) for one, given in (names or {}).items()})
        self._background = _label(background)
        super().__init__(_steps(self._colors))

    @classmethod
    def distinct(
        cls,
        labels: Iterable[int],
        names: Mapping[int, str] | None = None,
        background: int = 0,
        opacity: float = 1.0,
    ) -> LabelColors:
        """Return colours that are easily told apart, the same for a label whatever the others are.

        Parameters
        ----------
        labels
            Those that are shown; the background among them is not.
        names, background
            As for `LabelColors`.
        opacity
            Of each, per reference length.
        """
        known = sorted({_label(one) for one in labels} - {_label(background)})
        return cls({one: (*_hue(one), opacity) for one in known}, names, background)

    @classmethod
    def of(cls, function: TransferFunction, labels: Iterable[int]) -> LabelColors:
        """Return what a transfer function says of labels, those of opacity 0 left out; label colours stay."""
        if isinstance(function, LabelColors):
            return function
        known = sorted(labels)
        rows = function.at(np.asarray(known, dtype=np.float64).reshape(-1)).tolist()
        return cls({one: tuple(row) for one, row in zip(known, rows, strict=True) if row[3] > 0.0})

    @classmethod
    def completed(cls, stated: NamedColors | None, labels: Iterable[int]) -> LabelColors:
        """Return the colours and names that are stated, by a file or the caller, and distinct colours for all others.

        Parameters
        ----------
        stated
            What is stated; None: nothing.
        labels
            Those of the data.
        """
        distinct = cls.distinct(labels)
        if stated is None:
            return distinct
        return cls({**distinct.colors, **stated.colors}, stated.names, stated.background)

    @property
    def colors(self) -> Mapping[int, tuple[float, float, float, float]]:
        """Red, green, blue and opacity of each label that is shown."""
        return self._colors

    @property
    def names(self) -> Mapping[int, str]:
        """What labels are called."""
        return self._names

    @property
    def background(self) -> int:
        """The label of what is no thing."""
        return self._background

    @property
    def arguments(self) -> tuple[dict[int, tuple[float, float, float, float]], dict[int, str], int]:
        """Colours, names and background, as they are given."""
        return dict(self._colors), dict(self._names), self._background

    def name_of(self, label: int) -> str:
        """Return what a label is called, "label 3" unless it has a name."""
        return self._names.get(label, f"label {label}")

    def __reduce__(self) -> tuple[type[LabelColors], tuple[Any, ...]]:
        """Pickle and copy by colours and names."""
        return type(self), self.arguments

    def __eq__(self, other: object) -> bool:
        """Return whether colours, names and background are the same."""
        if not isinstance(other, LabelColors):
            return NotImplemented
        return self.arguments == other.arguments

    def __hash__(self) -> int:
        """Return a hash of labels and background."""
        return hash((tuple(self._colors), self._background))

    def __repr__(self) -> str:
        """Return a short description."""
        told = [self._names.get(one, str(one)) for one in list(self._colors)[:8]] + ["…"] * (len(self._colors) > 8)
        count = f"{len(self._colors)} label{'s' * (len(self._colors) != 1)}"
        return f"LabelColors({count}{': ' * bool(told)}{', '.join(told)})"


def _label(value: Any) -> int:
    return whole(
        "LabelColors: a label", value, bits=_BITS, advice="number them anew, by numpy.unique with return_inverse"
    )


def _name(given: Any) -> str:
    if not isinstance(given, str):
        raise complain(unusable("LabelColors: a name"), shown(given), "a text")
    return str(given)


def _color(given: Any) -> tuple[float, float, float, float]:
    what, wanted = "LabelColors: a colour", "the name of a colour, or red, green, blue and if wanted opacity"
    found = [given] if isinstance(given, str) else parts(what, given, wanted, 4)
    named = bool(found) and isinstance(found[0], str)
    if len(found) not in ((1, 2) if named else (3, 4)):
        raise complain(unusable(what), shown(given), wanted)
    red, green, blue = color(what, found[0] if named else tuple(found[:3]))
    if not all(0.0 <= one <= 1.0 for one in (red, green, blue)):
        raise complain(unusable(what), shown(given), "red, green and blue from 0 to 1", "divide by the largest")
    opacity = number(what, found[-1]) if len(found) in ((2,) if named else (4,)) else 1.0
    if not 0.0 <= opacity <= 1.0:
        raise complain(unusable(what), f"an opacity of {opacity:g}", "a number from 0 to 1")
    return red, green, blue, opacity


def _steps(colors: Mapping[int, tuple[float, float, float, float]]) -> list[tuple[float, ...]]:
    rows: list[tuple[float, ...]] = [
        (label + side, *rgba[:3], opacity)
        for label, rgba in colors.items()
        for side, opacity in (
            (-_BESIDE, 0.0),
            (-_BESIDE, rgba[3]),
            (_BESIDE, rgba[3]),
            (_BESIDE, 0.0),
        )
    ]
    return rows or [(0.0, 0.0, 0.0, 0.0, 0.0)]


def _hue(label: int) -> tuple[float, float, float]:
    # Three lightnesses in turn, so that neighbouring hues differ in that, too.
    strong = ((0.75, 0.95), (0.5, 0.85), (0.85, 0.7))[label % 3]
    return colorsys.hsv_to_rgb((0.02 + label * _GOLDEN) % 1.0, *strong)


def groups_of(field: RegularField, function: TransferFunction) -> list[tuple[Any, Any, str]]:
    """Return the native groups that draw a field of labels: fields, transfer function and role of each.

    Raises
    ------
    InvalidInput
        For more labels than are told apart.
    OutOfMemory
        Where a volume for each label does not fit.
    """
    known = field.labels_found
    colors = LabelColors.of(function, known).colors
    groups = []
    for label in known:
        red, green, blue, opacity = colors.get(label, (0.0, 0.0, 0.0, 0.0))
        role = "label" if opacity > 0.0 else "compared"
        step = _sheetsplat.TransferFunction(
            np.array([(0.0, red, green, blue, 0.0), (0.0, red, green, blue, opacity), (1.0, red, green, blue, opacity)])
        )
        groups.append(([field.part_of_label(label)], step, role))
    # Those that are shown come in the order in which they were given; what is compared comes last.
    order = {label: place for place, label in enumerate(colors)}
    return [one for _, one in sorted(zip(known, groups, strict=True), key=lambda pair: order.get(pair[0], len(order)))]
