"""What the numbers of a field mean: names and units for figures."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from sheetsplat._checks import optional_number, shown
from sheetsplat.errors import complain, unusable

_LONGEST = 200


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

    Raises
    ------
    InvalidInput
        For anything but texts of at most 200 printable characters, and for a floor that is not above 0.

    Examples
    --------
    >>> field = ss.RegularField(values).with_quantity(name="density", unit="g/cm³", length_unit="mm")
    >>> field.quantity.name, field.quantity.unit
    ('density', 'g/cm³')
    """

    name: str = ""
    unit: str = ""
    length_unit: str = ""
    floor: float | None = None

    def __post_init__(self) -> None:
        """Check and convert."""
        for part in ("name", "unit", "length_unit"):
            text = getattr(self, part)
            if not isinstance(text, str) or len(text) > _LONGEST or not text.isprintable():
                wanted = f"a text of at most {_LONGEST} printable characters"
                raise complain(unusable(f"Quantity: {part}"), shown(text), wanted)
        floor = optional_number("Quantity: floor", self.floor)
        if floor is not None and not 0.0 < floor < math.inf:
            raise complain(unusable("Quantity: floor"), f"{floor:g}", "a finite number above 0")
        object.__setattr__(self, "floor", floor)

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


def notes_of(quantities: Iterable[Quantity]) -> tuple[str, ...]:
    """Return the notes of several quantities, each once."""
    return tuple(dict.fromkeys(one.note for one in quantities if one.note))
