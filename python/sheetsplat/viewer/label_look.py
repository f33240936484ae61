"""What a viewer shows of labels: the colour of each, and which are shown."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from sheetsplat._checks import color, share, shown, truth
from sheetsplat.errors import complain, unusable
from sheetsplat.fields.labelled import MOST_LABELS
from sheetsplat.labels import LabelColors
from sheetsplat.transfer import TransferFunction

Rgba = tuple[float, float, float, float]


@dataclass(frozen=True)
class LabelLook:
    """Colours of labels, and which are shown.

    Attributes
    ----------
    first
        The colours before anything was changed, of other labels than those of the data, too.
    colors
        Red, green, blue and opacity of each label of the data, but for the background where it has no colour.
    hidden
        Labels that are not shown.
    shown
        Whether any is.
    """

    first: LabelColors
    colors: Mapping[int, Rgba]
    hidden: frozenset[int] = frozenset()
    shown: bool = True

    @classmethod
    def of(cls, function: TransferFunction, found: Iterable[int]) -> LabelLook:
        """Return the look of labels that are in the data; those that a function does not show are hidden."""
        known = sorted(found)
        first = LabelColors.of(function, known)
        every = {**LabelColors.distinct(known, background=first.background).colors, **first.colors}
        colors = {label: every[label] for label in known if label in every}
        return cls(first, colors, frozenset(colors) - first.colors.keys())

    @property
    def function(self) -> LabelColors:
        """The colours of what is shown."""
        every = {**self.first.colors, **self.colors}
        seen = {label: rgba for label, rgba in every.items() if self.shown and label not in self.hidden}
        return LabelColors(seen, self.first.names, self.first.background)

    def changed(self, given: Mapping[str, Any]) -> LabelLook:
        """Return the look after the changes that a page asks for. InvalidInput where they have no meaning.

        Parameters
        ----------
        given
            `labels`: for each label, as a text, any of color, opacity and shown; labels that are not there change
            nothing. `shown`: whether any is shown.
        """
        seen = truth("view: shown", given.get("shown", self.shown))
        parts = given.get("labels", {})
        if (
            not isinstance(parts, dict)
            or len(parts) > MOST_LABELS
            or not all(isinstance(a, dict) for a in parts.values())
        ):
            raise complain(unusable("view: labels"), shown(parts), "an object with a label's changes by its number")
        colors, hidden = dict(self.colors), set(self.hidden)
        for label in self.colors:
            told = parts.get(str(label), {})
            if "color" in told:
                colors[label] = (*color("view: labels", told["color"]), colors[label][3])
            if "opacity" in told:
                colors[label] = (*colors[label][:3], share("view: labels", told["opacity"]))
            if "shown" in told:
                (hidden.discard if told["shown"] else hidden.add)(label)
        return replace(self, colors=colors, hidden=frozenset(hidden), shown=seen)
