"""Descriptions of the values that options accept on the command line.

`sheetsplat.cli.types` has the parser of each.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum, auto


@dataclass(eq=False)
class Real:
    """A finite number: greater than `above`, less than `below`, at most `most`."""

    above: float = -math.inf
    below: float = math.inf
    most: float = math.inf

    @property
    def wanted(self) -> str:
        """What is accepted, for messages: "a finite number above 0"."""
        words = (("above", self.above), ("below", self.below), ("at most", self.most))
        within = " and ".join(f"{word} {limit:g}" for word, limit in words if math.isfinite(limit))
        return f"a finite number {within}".rstrip()

    def holds(self, number: float) -> bool:
        """Return whether a number is accepted."""
        return self.above < number < self.below and number <= self.most


@dataclass(eq=False)
class Whole:
    """An integer from `least` to `most`."""

    least: int | None = None
    most: int | None = None


@dataclass(eq=False)
class Numbers:
    """`count` numbers, separated by commas.

    Attributes
    ----------
    metavar
        How the help shows them, for example "X,Y,Z".
    count
        How many there must be.
    whole
        Positive integers, which may also be separated by "x": 256x256x128.
    square
        A single number stands for two equal ones.
    positive, rising
        All greater than 0; each greater than the one before it.
    """

    metavar: str
    count: int
    whole: bool = False
    square: bool = False
    positive: bool = False
    rising: bool = False


class Special(Enum):
    """Values with a syntax of their own."""

    COLOR = auto()
    COLORMAP = auto()
    DEPTH_CUE = auto()
    DIRECTION = auto()
    OCCLUSION = auto()
    OPACITY = auto()
    INPUT_FILE = auto()
    SURFACES = auto()
    TEXT = auto()


Value = Real | Whole | Numbers | Special
NUMBER = Real()
POSITIVE = Real(above=0.0)
