"""What a caller asked for: the options that were given, and what their quality stands for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sheetsplat._checks import choice
from sheetsplat.modes import TRAITS
from sheetsplat.options.quality import QUALITIES
from sheetsplat.quality.slicing import SLICES

# Sums along rays need no more slices, and means few.
_TWICE = {name: 2 for name, mode in TRAITS.items() if not mode.adds}
_MEANS = {name: 2 for name, mode in TRAITS.items() if mode.mean}
_COMPOSITE = {name: 2 for name, mode in TRAITS.items() if mode.is_composited}
# What a draft may be wrong.
_ROUGH = 2e-2
#: Options that decide on the distance of slices where they are given.
GOALS = ("max_error", "max_seconds")


@dataclass(frozen=True)
class Level:
    """What a quality sets.

    Attributes
    ----------
    kernel
        Radius and falloff of volumes whose values pass through their samples; None: plain sums.
    volumes, plain_volumes, scattered
        How many slices there are to one of the default distance, by the mode; 1 in modes that are not named. "unlit" is
        mode composite without lights, where named. Volumes of plain sums alone have smaller kernels, or fewer that
        show, so that more slices take the same time.
    few
        Of lit scattered kernels, whose thinnest ones may set the distance of slices for all: an error, and how many
        slices are tried, and twice as many, where there would be over twice as many. Those that keep the error are
        taken.
    lit
        Error that the slices of lit volumes in mode composite may have, and the least and the most of them to one of
        the default distance; None: `volumes` holds.
    stop
        Opacity at which a pixel is finished; None: the default.
    filters
        Whether what is finer than pixels calls for the filter, or for several samples a pixel.
    samples
        Of lit volumes of plain sums in mode composite: samples a pixel along each axis, and the most slices to one of
        the default distance with which there are several, as more of both would take too long; None: one sample a
        pixel. Wider kernels leave little that is finer than a pixel, and take as long as they are wide.
    """

    kernel: tuple[float, float] | None
    volumes: Mapping[str, int]
    plain_volumes: Mapping[str, int]
    scattered: Mapping[str, int]
    few: tuple[float, int]
    lit: tuple[float, int, int] | None
    stop: float | None
    filters: bool
    samples: tuple[int, int] | None = None

    def slices_for(self, light: float) -> int:
        """Return how many slices light calls for by its error with `SLICES`: it falls at first order at least."""
        return 0 if self.lit is None else math.ceil(SLICES * light / self.lit[0])


# Found by measurement: docs/quality.md, "Accuracy and time of each quality", and ./run bench quality.
_LEVELS = {
    "draft": Level(None, {}, {}, {}, (1e-2, 128), None, None, False),
    "good": Level((2.0, 5.0), _TWICE, _TWICE, _COMPOSITE, (5e-3, 256), (5e-3, 2, 3), 0.995, True),
    "best": Level(
        (2.5, 7.0),
        {**dict.fromkeys(_TWICE, 4), "unlit": 3, **_MEANS},
        {**dict.fromkeys(_TWICE, 6), **_MEANS},
        {**_TWICE, **dict.fromkeys(_COMPOSITE, 4)},
        (1.7e-3, 512),
        (1.7e-3, 4, 8),
        0.999,
        True,
        (2, 3),
    ),
}


def allowed_error(quality: str) -> float:
    """Return the root mean square error that a picture of a quality may have by the coarseness of its data."""
    lit = _LEVELS[quality].lit
    return _ROUGH if lit is None else lit[0]


@dataclass(frozen=True)
class Asked:
    """What a caller asked for.

    Attributes
    ----------
    quality
        Its name.
    given
        The options that are not None, which stands for one that was left open; `filter` is "off" where it is None.
    free
        Whether `max_error` or `max_seconds` decides on the distance of slices.
    """

    quality: str
    given: Mapping[str, Any]
    free: bool = False

    @classmethod
    def of(cls, owner: str, options: Mapping[str, Any]) -> Asked:
        """Return what keyword arguments of a function ask for; `owner` names it in messages."""
        given = {name: value for name, value in options.items() if value is not None}
        if "filter" in options:
            given["filter"] = choice(f"{owner}: filter", given.get("filter", "off"), ("ewa", "off", "auto"))
        quality = choice(f"{owner}: quality", given.get("quality", "good"), QUALITIES)
        renderer = given.get("renderer")
        goals = (given.get(name) if renderer is None else getattr(renderer, name) for name in GOALS)
        return cls(quality, given, any(goal is not None for goal in goals))

    @property
    def level(self) -> Level:
        """What the quality sets."""
        return _LEVELS[self.quality]

    def __contains__(self, option: str) -> bool:
        """Return whether an option was given."""
        return option in self.given
