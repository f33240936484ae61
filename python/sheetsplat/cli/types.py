"""The types of values on the command line: what `sheetsplat.options.values` describes, as click parses it."""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sheetsplat.options import values
from sheetsplat.options.values import Special

# Generic for type checkers from click 8.4 on, and never at run time before.
if TYPE_CHECKING:
    ParamType = click.ParamType[Any]
else:
    ParamType = click.ParamType

# Rows of a table made of colours at values.
_TABLE = 1025


class Real(ParamType):
    """A finite number within limits."""

    name = "float"

    def __init__(self, limits: values.Real) -> None:
        self._limits = limits

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number."""
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        above, below, most = self._limits.above, self._limits.below, self._limits.most
        if above < number < below and number <= most:
            return number
        limits = (("above", above), ("below", below), ("at most", most))
        wanted = " and ".join(f"{word} {limit:g}" for word, limit in limits if math.isfinite(limit))
        self.fail(f"{_short(value)}: wanted a finite number{' ' if wanted else ''}{wanted}", param, ctx)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "..."


class Numbers(ParamType):
    """Several numbers, separated by commas, or by "x" where they are whole."""

    def __init__(self, wanted: values.Numbers) -> None:
        self.name = wanted.metavar
        self._wanted = wanted

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """Return the numbers."""
        if not isinstance(value, str):
            return tuple(value)
        parts = re.split(r"[,x]" if self._wanted.whole else r",", value.strip().lower())
        try:
            numbers = tuple((int if self._wanted.whole else float)(part) for part in parts)
        except ValueError:
            numbers = ()
        if self._wanted.square and len(numbers) == 1:
            numbers *= 2
        if len(numbers) != self._wanted.count:
            self.fail(f"{_short(value)}: wanted {self.name}, {self._wanted.count} numbers", param, ctx)
        if not self._wanted.whole and not all(map(math.isfinite, numbers)):
            self.fail(f"{_short(value)}: wanted finite numbers", param, ctx)
        if self._wanted.whole and not all(abs(number) < 2**31 for number in numbers):
            self.fail(f"{_short(value)}: wanted numbers that are not so large", param, ctx)
        if (self._wanted.positive or self._wanted.whole) and min(numbers) <= 0:
            self.fail(f"{_short(value)}: wanted numbers above 0", param, ctx)
        if self._wanted.rising and not all(low < high for low, high in itertools.pairwise(numbers)):
            self.fail(f"{_short(value)}: wanted the lower number first", param, ctx)
        return numbers


class Direction(Numbers):
    """Three numbers, or the name of an axis: x, -x, y, -y, z, -z."""

    def __init__(self) -> None:
        super().__init__(values.Numbers("X,Y,Z", 3))

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """Return the direction."""
        named = re.fullmatch(r"([+-]?)([xyz])", value.strip().lower()) if isinstance(value, str) else None
        if named is None:
            numbers = super().convert(value, param, ctx)
            if not any(numbers):
                self.fail(f"{_short(value)}: wanted a direction, not a point", param, ctx)
            return numbers
        return tuple((-1.0 if named[1] == "-" else 1.0) * (axis == named[2]) for axis in "xyz")


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


class OpacityType(ParamType):
    """One number, several spread over clim, or pairs value:opacity."""

    name = "A | A,A,… | V:A,V:A,…"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return what TransferFunction.from_colormap takes."""
        if not isinstance(value, str):
            return value
        try:
            if ":" in value:
                pairs = [part.split(":") for part in value.split(",")]
                points = [(_finite(at), _share(opacity)) for at, opacity in pairs]
                if any(later[0] < earlier[0] for earlier, later in itertools.pairwise(points)):
                    raise ValueError
                return points
            numbers = [_share(part) for part in value.split(",")]
        except ValueError:
            self.fail(f"{value!r}: wanted 0.5, or 0,0.1,0.9, or 40:0,90:0.1,200:0.9", param, ctx)
        return numbers[0] if len(numbers) == 1 else numbers


@dataclass(frozen=True)
class ColorPairs:
    """Colours at values, linear between."""

    values: tuple[float, ...]
    colors: tuple[tuple[float, float, float], ...]

    def table(self, clim: tuple[float, ...] | None) -> tuple[Any, tuple[float, ...]]:
        """Return rows of colours, and the limits that they spread over."""
        import numpy as np

        limits = (self.values[0], self.values[-1]) if clim is None else clim
        at = np.linspace(limits[0], limits[1], _TABLE)
        columns = np.asarray(self.colors).T
        return np.column_stack([np.interp(at, self.values, column) for column in columns]), limits


class ColormapType(ParamType):
    """A name of the cmap package, colours with commas between them, or pairs value:colour."""

    name = "NAME | COLOR,COLOR,… | V:COLOR,V:COLOR,…"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return what TransferFunction.from_colormap takes, or ColorPairs."""
        if not isinstance(value, str) or "," not in value:
            return value
        from sheetsplat._checks import color
        from sheetsplat.errors import InvalidInput

        wanted = "wanted black,orange,white, or 0:black,90:#ff8000,200:white with values that rise"
        parts = [part.strip() for part in value.split(",")]
        try:
            if ":" not in value:
                return [color("colour", part) for part in parts]
            pairs = [part.split(":") for part in parts]
            values = tuple(float(at) for at, _ in pairs)
            colors = tuple(color("colour", name) for _, name in pairs)
        except (ValueError, InvalidInput):
            self.fail(f"{value!r}: {wanted}", param, ctx)
        if not all(low < high for low, high in itertools.pairwise(values)) or not all(map(math.isfinite, values)):
            self.fail(f"{value!r}: {wanted}", param, ctx)
        return ColorPairs(values, colors)


class CueType(ParamType):
    """Auto, or the two depths between which colours fade, perhaps with a strength."""

    name = "auto | START,END[,STRENGTH]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return "auto", or the numbers."""
        if not isinstance(value, str) or value.strip().lower() == "auto":
            return value if not isinstance(value, str) else "auto"
        try:
            numbers = [_finite(part) for part in value.split(",")]
            if len(numbers) == 2:
                numbers.append(1.0)
            start, end, strength = numbers
        except ValueError:
            start = end = strength = math.nan
        if not (start < end and 0.0 <= strength <= 1.0):
            self.fail(f"{_short(value)}: wanted auto, or 3,8, or 3,8,0.7: start below end, strength 0 to 1", param, ctx)
        return start, end, strength


class OcclusionType(ParamType):
    """A radius, perhaps with a strength."""

    name = "RADIUS[,STRENGTH]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return radius and strength."""
        if not isinstance(value, str):
            return value
        try:
            numbers = [_finite(part) for part in value.split(",")]
            radius, strength = numbers if len(numbers) == 2 else (*numbers, 1.0)
        except ValueError:
            radius = strength = math.nan
        if not (radius > 0.0 and 0.0 <= strength <= 1.0):
            self.fail(f"{_short(value)}: wanted 5, or 5,0.7: a radius above 0, strength 0 to 1", param, ctx)
        return radius, strength


class ColorType(ParamType):
    """R,G,B in [0, 1], #rrggbb, or a name."""

    name = "COLOR"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """Return red, green, blue."""
        if not isinstance(value, str):
            return tuple(value)
        from sheetsplat._checks import color
        from sheetsplat.errors import InvalidInput

        try:
            if "," in value:
                numbers = tuple(float(part) for part in value.split(","))
                if len(numbers) == 3 and all(math.isfinite(number) for number in numbers):
                    return numbers
                raise ValueError
            return color("colour", value)
        except (ValueError, InvalidInput):
            self.fail(f"{value!r}: wanted r,g,b in 0 to 1, #rrggbb, or the name of a colour", param, ctx)


_SPECIAL: dict[Special, ParamType] = {
    Special.COLOR: ColorType(),
    Special.COLORMAP: ColormapType(),
    Special.DEPTH_CUE: CueType(),
    Special.DIRECTION: Direction(),
    Special.INPUT_FILE: click.Path(path_type=Path),
    Special.OCCLUSION: OcclusionType(),
    Special.OPACITY: OpacityType(),
    Special.TEXT: click.STRING,
}


def param_type(value: values.Value) -> ParamType:
    """Return what parses a value."""
    if isinstance(value, values.Real):
        return Real(value)
    if isinstance(value, values.Whole):
        return click.IntRange(value.least, value.most)
    if isinstance(value, values.Numbers):
        return Numbers(value)
    return _SPECIAL[value]
