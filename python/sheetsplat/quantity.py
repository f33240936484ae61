"""What the numbers of a field mean: names and units for figures."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

from sheetsplat._checks import Triple, number, optional_number, shown
from sheetsplat.errors import complain, unusable

_LONGEST = 200
# Julian years, in seconds.
_YEAR = 365.25 * 86400.0


class Axis(NamedTuple):
    """The coordinate that figures show along an axis of the world.

    Attributes
    ----------
    name, unit
        "lat", "degrees_north"; without a name the axis is that of the world.
    factor, offset
        The coordinate is factor * position in the world + offset.
    """

    name: str = ""
    unit: str = ""
    factor: float = 1.0
    offset: float = 0.0

    @property
    def label(self) -> str:
        """Name and unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    def coordinate(self, position: float) -> float:
        """Return the coordinate at a position in the world."""
        return self.factor * position + self.offset

    def placed(self, spacing: tuple[float, float], origin: tuple[float, float]) -> Axis:
        """Return the axis of samples that are drawn at another spacing and origin: (the one before, the new one).

        Its samples keep their coordinates.
        """
        step = spacing[0] / spacing[1]
        factor = self.factor * step
        return Axis(self.name, self.unit, factor, self.coordinate(origin[0]) - factor * origin[1])


@dataclass(frozen=True)
class Quantity:
    """What the scalar and the lengths of a field are. It changes labels of figures, never a picture.

    Parameters
    ----------
    name
        Of the scalar: "density".
    unit
        Of the scalar: "g/cm³".
    length_unit
        Of world lengths: "mm".
    floor
        Where the field's values are decades above a value, log10(scalar / floor), that value: colour bars are then
        logarithmic, in the scalar itself. None: the values are the scalar.
    axes
        Coordinates along x, y and z: (name, unit), and a factor and an offset where the coordinate is factor *
        position in the world + offset. Empty: positions in the world, in `length_unit`.
    time
        When it is, of data of several times, as a text: "2020-01-01 06:00", "t = 3.5 s". Figures have it as their
        title.

    Raises
    ------
    InvalidInput
        For anything but texts of at most 200 printable characters, a floor that is not above 0, and anything but three
        axes or none, whose factors and offsets are finite, factors not 0.

    Examples
    --------
    >>> field = ss.RegularField(values).with_quantity(name="density", unit="g/cm³", length_unit="mm")
    >>> field.quantity.name, field.quantity.unit
    ('density', 'g/cm³')
    >>> ss.Quantity(axes=[("lon", "°E"), ("lat", "°N"), ("height", "km", 0.5)]).axes[2].factor
    0.5
    """

    name: str = ""
    unit: str = ""
    length_unit: str = ""
    floor: float | None = None
    axes: tuple[Axis, ...] = ()
    time: str = ""

    def __post_init__(self) -> None:
        """Check and convert."""
        for part in ("name", "unit", "length_unit", "time"):
            _check_text(part, getattr(self, part))
        floor = optional_number("Quantity: floor", self.floor)
        if floor is not None and not 0.0 < floor < math.inf:
            raise complain(unusable("Quantity: floor"), f"{floor:g}", "a finite number above 0")
        object.__setattr__(self, "floor", floor)
        object.__setattr__(self, "axes", _axes(self.axes))

    def placed(self, spacing: tuple[Triple, Triple], origin: tuple[Triple, Triple]) -> Quantity:
        """Return what samples are that are drawn at another spacing and origin: (those before, the new ones).

        Where they have axes of their own, these keep their coordinates, and lengths of the world have no unit any more.
        """
        if not self.axes or spacing[0] == spacing[1] and origin[0] == origin[1]:
            return self
        steps, firsts = zip(*spacing, strict=True), zip(*origin, strict=True)
        axes = tuple(map(Axis.placed, self.axes, steps, firsts))
        return replace(self, axes=axes, length_unit=self.length_unit if spacing[0] == spacing[1] else "")

    def scalar(self, value: float) -> float:
        """Return the scalar that a value of the field stands for."""
        return value if self.floor is None else self.floor * 10.0**value

    @property
    def note(self) -> str:
        """What is shown where that is not the scalar itself, else ""."""
        return "" if self.floor is None else f"log10({self.name or 'value'} / {self.floor:g}) is shown"

    @property
    def label(self) -> str:
        """Name and unit, for an axis."""
        return f"{self.name or 'value'} [{self.unit}]" if self.unit else self.name or "value"


def _check_text(part: str, text: object) -> None:
    if not isinstance(text, str) or len(text) > _LONGEST or not text.isprintable():
        raise complain(unusable(f"Quantity: {part}"), shown(text), f"a text of at most {_LONGEST} printable characters")


def _axes(given: object) -> tuple[Axis, ...]:
    if not isinstance(given, list | tuple) or len(given) not in (0, 3):
        raise complain(unusable("Quantity: axes"), shown(given), "three axes, for x, y and z, or none")
    made = []
    for one in given:
        if not isinstance(one, list | tuple) or not 2 <= len(one) <= 4:
            raise complain(unusable("Quantity: axes"), shown(one), "(name, unit), (name, unit, factor, offset)")
        for text in one[:2]:
            _check_text("axes", text)
        factor, offset = (number("Quantity: axes", part) for part in (*one[2:], *Axis()[len(one) :]))
        if not (math.isfinite(factor) and math.isfinite(offset) and factor):
            wanted = "a finite factor other than 0 and a finite offset"
            raise complain(unusable("Quantity: axes"), f"{factor:g}, {offset:g}", wanted)
        made.append(Axis(one[0], one[1], factor, offset))
    return tuple(made)


def time_text(time: float, unit: str = "", name: str = "t") -> str:
    """Return a time as figures tell it: "t = 3.5 s"; seconds in millions or thousands of millions of years if many."""
    for longer, seconds in (("Gyr", 1e9 * _YEAR), ("Myr", 1e6 * _YEAR)):
        if unit == "s" and abs(time) >= seconds:
            return f"{name} = {time / seconds:.5g} {longer}"
    return f"{name} = {time:.5g} {unit}".rstrip()


def time_of(quantities: Iterable[Quantity]) -> str:
    """Return the time of several quantities; "" where they state none, or several."""
    known = {one.time for one in quantities if one.time}
    return known.pop() if len(known) == 1 else ""


def notes_of(quantities: Iterable[Quantity]) -> tuple[str, ...]:
    """Return the notes of several quantities, each once."""
    return tuple(dict.fromkeys(one.note for one in quantities if one.note))
