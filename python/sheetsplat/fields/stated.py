"""What is stated of how a volume is shown, by its file or by the caller: a colour, limits, colours of labels."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, Self, runtime_checkable

from sheetsplat._checks import Triple, color, shown
from sheetsplat._properties import Forwarded
from sheetsplat.errors import complain, unusable
from sheetsplat.transfer import color_limits


@runtime_checkable
class NamedColors(Protocol):
    """What a `LabelColors` has."""

    @property
    def colors(self) -> Mapping[int, tuple[float, float, float, float]]:
        """Red, green, blue and opacity of labels."""

    @property
    def names(self) -> Mapping[int, str]:
        """What labels are called."""

    @property
    def background(self) -> int:
        """The label of what is no thing."""


class Stated(NamedTuple):
    """What is stated; None for what is left to be chosen."""

    color: Triple | None = None
    window: tuple[float, float] | None = None
    label_colors: Any = None


class Stating:
    """What volumes have in common that something is stated of."""

    __slots__ = ()
    _labels: bool
    _stated: Stated

    if TYPE_CHECKING:

        @property
        def has_values(self) -> bool:
            """Whether samples are values, and neither labels nor colours."""

        def _with(self, **changes: Any) -> Self: ...

    color = Forwarded[Triple | None](
        "_stated.color",
        "Red, green and blue in which `sheetsplat.render` shows it beside other channels; None: as any volume.",
    )
    window = Forwarded[tuple[float, float] | None](
        "_stated.window", "The values at which its colour begins and is full; None: by the histogram."
    )

    def with_color(self, shade: Any, window: Any = None) -> Self:
        """Return the same volume, without a copy of its arrays, as a channel that is shown in a colour of its own.

        Parameters
        ----------
        shade
            Red, green and blue in [0, 1], or the name of a colour; None: as any volume.
        window
            The values at which the colour begins and is full; None: by the histogram.

        Raises
        ------
        InvalidInput
            For colours that are none, limits that are not two finite numbers, the lower one first, and volumes of
            labels or of colours, which have their own.
        """
        what = "RegularField: color"
        made = None if shade is None else color(what, shade)
        if made is not None and not self.has_values:
            found, advice = ("labels", "use with_label_colors") if self._labels else ("colours", "leave it out")
            raise complain(unusable(what), f"a volume of {found}", "a volume of values", advice)
        if made is not None and max(made) > 1.0:
            raise complain(unusable(what), shown(shade), "red, green and blue from 0 to 1")
        limits = None if window is None else color_limits(window, what="RegularField: window")
        return self._with(_stated=self._stated._replace(color=made, window=limits))

    @property
    def label_colors(self) -> NamedColors | None:
        """Names and colours of its labels, a `LabelColors`; None where nobody stated any, and for volumes of values."""
        found: NamedColors | None = self._stated.label_colors if self._labels else None
        return found

    def with_label_colors(self, colors: NamedColors | None) -> Self:
        """Return the same volume of labels, without a copy of its arrays, with names and colours of these.

        Labels that have none get those of `LabelColors.distinct`.

        Raises
        ------
        InvalidInput
            For volumes of values, and for anything but a `LabelColors`.
        """
        if colors is not None and not (self._labels and isinstance(colors, NamedColors)):
            found = "a volume of values" if not self._labels else type(colors).__name__
            wanted = "a LabelColors, for a volume of labels"
            raise complain(
                unusable("RegularField: label_colors"), found, wanted, "make it with RegularField(..., labels=True)"
            )
        return self._with(_stated=self._stated._replace(label_colors=colors))
