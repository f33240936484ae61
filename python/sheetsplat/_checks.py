"""Conversions of arguments, each with an error that names the argument."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from sheetsplat.errors import complain

Triple = tuple[float, float, float]
Bounds = tuple[Triple, Triple]
# Vectors are sequences of three numbers; arrays of NumPy are no Sequence for the type checker.
Vector = Sequence[float] | np.ndarray[Any, Any]


def shown(value: object) -> str:
    """Return a short text for a message."""
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "..."


def number(what: str, value: object) -> float:
    """Return a float, or InvalidInput. Whether its size makes sense is for the caller to say."""
    if isinstance(value, str | bytes | bool | np.bool_ | complex | np.complexfloating):
        raise complain(f"{what} cannot be used", shown(value), "a number")
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        raise complain(f"{what} cannot be used", shown(value), "a number") from None


def optional_number(what: str, value: object) -> float | None:
    """Return a float, None for None, or InvalidInput."""
    return None if value is None else number(what, value)


def triple(what: str, value: object) -> Triple:
    """Return three floats, or InvalidInput."""
    if isinstance(value, str | bytes) or not isinstance(value, Iterable):
        raise complain(f"{what} cannot be used", shown(value), "three numbers")
    parts = list(value)
    if len(parts) != 3:
        raise complain(f"{what} cannot be used", f"{len(parts)} entries, {shown(value)}", "three numbers")
    return number(what, parts[0]), number(what, parts[1]), number(what, parts[2])


def image_size(value: object) -> tuple[int, int]:
    """Return (width, height) in pixels, or InvalidInput."""
    wanted = "two whole numbers of pixels, (width, height), each at least 1"
    try:
        width, height = (operator.index(part) for part in value)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise complain("the size of the picture cannot be used", shown(value), wanted) from None
    if not (1 <= width < 2**31 and 1 <= height < 2**31):
        raise complain("the size of the picture cannot be used", f"{width} x {height}", wanted)
    return width, height


def choice(what: str, value: object, names: Sequence[str]) -> str:
    """Return one of `names`, or InvalidInput."""
    if not isinstance(value, str) or value not in names:
        raise complain(f"{what} cannot be used", shown(value), "one of: " + ", ".join(names))
    return value


def whole(what: str, value: object) -> int:
    """Return an int that fits 32 bits, or InvalidInput."""
    try:
        result = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        raise complain(f"{what} cannot be used", shown(value), "a whole number") from None
    if not -(2**31) <= result < 2**31:
        raise complain(f"{what} cannot be used", str(result), "a whole number of 32 bits")
    return result


def instance(what: str, value: object, kind: type) -> None:
    """Raise InvalidInput unless `value` is a `kind`."""
    if not isinstance(value, kind):
        raise complain(
            f"{what} cannot be used", f"{type(value).__name__}, {shown(value)}", f"sheetsplat.{kind.__name__}"
        )
