"""The types of values on the command line: what `sheetsplat.options.values` describes, as click parses it."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from sheetsplat._checks import color, nearest_names
from sheetsplat.errors import InvalidInput
from sheetsplat.opacity_words import opacities_of
from sheetsplat.options import values
from sheetsplat.options.values import Special

# Generic for type checkers from click 8.4 on, and never at run time before.
if TYPE_CHECKING:
    ParamType = click.ParamType[Any]
    Choice = click.Choice[str]
else:
    ParamType = click.ParamType
    Choice = click.Choice

# Rows of a table made of colours at values.
_TABLE = 1025
# Characters of advice that a message about a value has room for.
_LONGEST_ADVICE = 60


class _Wanted(ValueError):
    """What a value should have been, where its parser says it more exactly than its type."""


class Parsed(ParamType):
    """A value that a function reads from a text; it raises ValueError or InvalidInput for other texts.

    Parameters
    ----------
    name
        How the help shows the value.
    wanted
        What the text should be, for the message.
    read
        The function.
    """

    def __init__(self, name: str, wanted: str, read: Callable[[str], Any]) -> None:
        self.name = name
        self.wanted = wanted
        self.read = read

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the value of a text; defaults, which are no texts, as they are."""
        if not isinstance(value, str):
            return value
        try:
            return self.read(value)
        except (ValueError, InvalidInput) as error:
            text = repr(value)
            wanted = error if isinstance(error, _Wanted) else self.wanted
            advice = error.advice if isinstance(error, InvalidInput) and len(error.advice) <= _LONGEST_ADVICE else ""
            more = f"; {advice}" if advice else ""
            self.fail(f"{text if len(text) <= 80 else text[:77] + '...'}: wanted {wanted}{more}", param, ctx)


class Word(Choice):
    """One of some words; a message about another one has the nearest."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the word."""
        try:
            return super().convert(value, param, ctx)
        except click.BadParameter as error:
            near = nearest_names(value, [str(one) for one in self.choices])
            self.fail(error.message.rstrip(".") + f"; {near}" if near else error.message, param, ctx)


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError
    return number


def _share(text: str) -> float:
    number = float(text)
    if not 0.0 <= number <= 1.0:
        raise ValueError
    return number


def _rises(numbers: Sequence[float]) -> bool:
    return all(low < high for low, high in itertools.pairwise(numbers))


def _real(limits: values.Real) -> Parsed:
    def read(text: str) -> float:
        number = float(text)
        if not limits.holds(number):
            raise ValueError
        return number

    return Parsed("float", limits.wanted, read)


def _numbers(wanted: values.Numbers) -> Parsed:
    def read(text: str) -> tuple[float, ...]:
        parts = re.split(r"[,x]" if wanted.whole else r",", text.strip().lower())
        numbers = tuple((int if wanted.whole else float)(part) for part in parts)
        if wanted.square and len(numbers) == 1:
            numbers *= 2
        if len(numbers) != wanted.count:
            raise ValueError
        if not wanted.whole and not all(map(math.isfinite, numbers)):
            raise _Wanted("finite numbers")
        if wanted.whole and not all(abs(number) < 2**31 for number in numbers):
            raise _Wanted(f"numbers below {2**31:,}")
        if (wanted.positive or wanted.whole) and min(numbers) <= 0:
            raise _Wanted("numbers above 0")
        if wanted.rising and not _rises(numbers):
            raise _Wanted("the lower number first")
        return numbers

    return Parsed(wanted.metavar, f"{wanted.metavar}, {wanted.count} numbers", read)


_VECTOR = _numbers(values.Numbers("X,Y,Z", 3))


def _direction(text: str) -> tuple[float, ...]:
    """Return three numbers, or those of an axis: x, -x, y, -y, z, -z."""
    named = re.fullmatch(r"([+-]?)([xyz])", text.strip().lower())
    if named is not None:
        return tuple((-1.0 if named[1] == "-" else 1.0) * (axis == named[2]) for axis in "xyz")
    numbers: tuple[float, ...] = _VECTOR.read(text)
    if not any(numbers):
        raise _Wanted("a direction, not a point")
    return numbers


def _opacity(text: str) -> Any:
    """Return what TransferFunction.from_colormap takes: a word, one number, several spread over clim, or pairs."""
    if text.strip()[:1].isalpha() and text.strip().lower() not in ("nan", "inf"):
        opacities_of(text.strip(), 0.0, 1.0)
        return text.strip()
    if ":" in text:
        pairs = [part.split(":") for part in text.split(",")]
        points = [(_finite(at), _share(opacity)) for at, opacity in pairs]
        if any(later[0] < earlier[0] for earlier, later in itertools.pairwise(points)):
            raise ValueError
        return points
    numbers = [_share(part) for part in text.split(",")]
    return numbers[0] if len(numbers) == 1 else numbers


@dataclass(frozen=True)
class ColorPairs:
    """Colours at values, linear between."""

    values: tuple[float, ...]
    colors: tuple[tuple[float, float, float], ...]

    def table(self, clim: tuple[float, ...] | None) -> tuple[Any, tuple[float, ...]]:
        """Return rows of colours, and the limits that they spread over."""
        limits = (self.values[0], self.values[-1]) if clim is None else clim
        at = np.linspace(limits[0], limits[1], _TABLE)
        columns = np.asarray(self.colors).T
        return np.column_stack([np.interp(at, self.values, column) for column in columns]), limits


def _colormap(text: str) -> Any:
    """Return what TransferFunction.from_colormap takes, a name or colours, or ColorPairs."""
    if "," not in text:
        return text
    parts = [part.strip() for part in text.split(",")]
    if ":" not in text:
        return [color("colour", part) for part in parts]
    pairs = [part.split(":") for part in parts]
    at = tuple(_finite(value) for value, _ in pairs)
    if not _rises(at):
        raise ValueError
    return ColorPairs(at, tuple(color("colour", name) for _, name in pairs))


def _depth_cue(text: str) -> Any:
    """Return "auto", or start, end and strength."""
    if text.strip().lower() == "auto":
        return "auto"
    numbers = [_finite(part) for part in text.split(",")]
    start, end, strength = numbers if len(numbers) == 3 else (*numbers, 1.0)
    if not (start < end and 0.0 <= strength <= 1.0):
        raise ValueError
    return start, end, strength


def _occlusion(text: str) -> Any:
    """Return True for "auto", else radius and strength."""
    if text.strip().lower() == "auto":
        return True
    numbers = [_finite(part) for part in text.split(",")]
    radius, strength = numbers if len(numbers) == 2 else (*numbers, 1.0)
    if not (radius > 0.0 and 0.0 <= strength <= 1.0):
        raise ValueError
    return radius, strength


def _surfaces(text: str) -> Any:
    """Return a number, or pairs of values and opacities."""
    if ":" not in text:
        return _finite(text)
    pairs = [part.split(":") for part in text.split(",")]
    return [(_finite(at), _share(opacity)) for at, opacity in pairs]


def _color(text: str) -> tuple[float, ...]:
    """Return red, green, blue."""
    if "," not in text:
        return color("colour", text)
    red, green, blue = map(_finite, text.split(","))
    return red, green, blue


_SPECIAL: dict[Special, ParamType] = {
    Special.COLOR: Parsed("COLOR", "r,g,b in 0 to 1, #rrggbb, or the name of a colour", _color),
    Special.COLORMAP: Parsed(
        "NAME | COLOR,COLOR,… | V:COLOR,V:COLOR,…",
        "black,orange,white, or 0:black,90:#ff8000,200:white with values that rise",
        _colormap,
    ),
    Special.DEPTH_CUE: Parsed(
        "auto | START,END[,STRENGTH]",
        "auto, or 3,8, or 3,8,0.7: start below end, strength 0 to 1",
        _depth_cue,
    ),
    Special.DIRECTION: Parsed("X,Y,Z", _VECTOR.wanted, _direction),
    Special.INPUT_FILE: click.Path(path_type=Path),
    Special.OCCLUSION: Parsed(
        "auto | RADIUS[,STRENGTH]", "auto, or 5, or 5,0.7: a radius above 0, strength 0 to 1", _occlusion
    ),
    Special.OPACITY: Parsed(
        "A | A,A,… | V:A,V:A,… | WORD",
        "0.5, or 0,0.1,0.9, or 40:0,90:0.1,200:0.9, or sigmoid_5, isolayers:4 …",
        _opacity,
    ),
    Special.SURFACES: Parsed("V | V:A,V:A,…", "80, or 80:0.3,120:1: values with opacities from 0 to 1", _surfaces),
    Special.TEXT: click.STRING,
}


def param_type(value: values.Value) -> ParamType:
    """Return what parses a value."""
    if isinstance(value, values.Real):
        return _real(value)
    if isinstance(value, values.Whole):
        return click.IntRange(value.least, value.most)
    if isinstance(value, values.Numbers):
        return _numbers(value)
    return _SPECIAL[value]
