"""Conversions of arguments, each with an error that names the argument."""

from __future__ import annotations

import itertools
import math
import operator
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sheetsplat import _memory
from sheetsplat.errors import OutOfMemory, Words, complain, unusable

Triple = tuple[float, float, float]
Bounds = tuple[Triple, Triple]
# Vectors are sequences of three numbers; arrays of NumPy are no Sequence for the type checker.
Vector = Sequence[float] | np.ndarray[Any, Any]


# Largest magnitude of colours and lights: sums and products of a few of them stay finite in float32.
STRONGEST = 1e30
_MOST_NAMES = 64
_FEWER = "use fewer of them at a time"


def shown(value: object) -> str:
    """Return a short text for a message."""
    try:
        text = repr(value)
    except Exception:
        # For example for integers of thousands of digits.
        text = f"a {type(value).__name__}"
    return text if len(text) <= 80 else text[:77] + "..."


def number(what: str, value: object) -> float:
    """Return a float of any size, or InvalidInput."""
    if isinstance(value, str | bytes | bool | np.bool_ | complex | np.complexfloating):
        raise complain(unusable(what), shown(value), "a number")
    try:
        return float(value)  # type: ignore[arg-type]
    except Exception:  # Objects of others raise whatever they like.
        raise complain(unusable(what), shown(value), "a number") from None


def strength(what: str, value: object) -> float:
    """Return a float of a colour or of light, or InvalidInput where it is too large for pictures of float32."""
    result = number(what, value)
    if math.isfinite(result) and abs(result) > STRONGEST:
        raise complain(unusable(what), f"{result:g}", f"a number of at most {STRONGEST:g} in magnitude")
    return result


def strengths(what: str, vector: Triple) -> Triple:
    """Return red, green, blue, or InvalidInput where one is too large for pictures of float32."""
    return strength(what, vector[0]), strength(what, vector[1]), strength(what, vector[2])


def truth(what: str, value: object) -> bool:
    """Return a bool, or InvalidInput: a word such as "off" would be true."""
    if not isinstance(value, bool | np.bool_):
        raise complain(unusable(what), shown(value), "True or False")
    return bool(value)


def is_off(value: object) -> bool:
    """Return whether an option that may be switched has the value None, False or 0."""
    return value is None or (isinstance(value, bool | np.bool_ | int | float) and not value)


def is_auto(value: object) -> bool:
    """Return whether an option is the word "auto"; arrays would compare each of their entries."""
    return isinstance(value, str) and value == "auto"


def names(what: str, value: object, known: Sequence[str]) -> tuple[str, ...]:
    """Return one name, or several, out of `known`, or InvalidInput."""
    if isinstance(value, str):
        return (choice(what, value, known),)
    wanted = "any of: " + ", ".join(known)
    found = tuple(choice(what, one, known) for one in parts(what, value, wanted, _MOST_NAMES))
    if len(found) > _MOST_NAMES:
        raise complain(unusable(what), f"more than {_MOST_NAMES} names", wanted)
    return tuple(dict.fromkeys(found))


def parts(what: str, value: object, wanted: str, most: int) -> list[Any]:
    """Return the parts of a sequence, `most` and one at most since iterators may have no end, or InvalidInput."""
    try:
        if not isinstance(value, str | bytes):
            return list(itertools.islice(value, most + 1))  # type: ignore[call-overload]
    except Exception:  # Objects of others raise whatever they like.
        pass
    raise complain(unusable(what), shown(value), wanted)


def optional_number(what: str, value: object) -> float | None:
    """Return a float, None for None, or InvalidInput."""
    return None if value is None else number(what, value)


def triple(what: str, value: object) -> Triple:
    """Return three floats, or InvalidInput."""
    found = parts(what, value, "three numbers", 3)
    if len(found) != 3:
        count = f"{'more than 3' if len(found) > 3 else len(found)} entries"
        raise complain(unusable(what), f"{count}, {shown(value)}", "three numbers")
    return number(what, found[0]), number(what, found[1]), number(what, found[2])


def pair(what: str, value: object) -> tuple[float, float]:
    """Return two floats, or InvalidInput."""
    found = parts(what, value, "two numbers", 2)
    if len(found) != 2:
        raise complain(unusable(what), shown(value), "two numbers")
    return number(what, found[0]), number(what, found[1])


def direction(what: str, value: object) -> Triple:
    """Return three floats of a direction or of the name of an axis ("x", "-z"), or InvalidInput."""
    if isinstance(value, str):
        name = value.strip().lower()
        sign, axis = (-1.0, name[1:]) if name.startswith("-") else (1.0, name.removeprefix("+"))
        if len(axis) != 1 or axis not in "xyz":
            raise complain(unusable(what), shown(value), 'three numbers, or an axis such as "x" or "-z"')
        x, y, z = (sign * (one == axis) for one in "xyz")
        return x, y, z
    return measurable(what, triple(what, value))


def measurable(
    what: str, vector: Triple, advice: str = "divide it by its length; only where it points counts"
) -> Triple:
    """Return a direction, or InvalidInput where its squared length over- or underflows. 0 and NaN pass."""
    x, y, z = vector
    squared = x * x + y * y + z * z
    if all(map(math.isfinite, vector)) and any(vector) and not 1e-280 < squared < math.inf:
        raise complain(
            unusable(what),
            f"({x:g}, {y:g}, {z:g})",
            "a direction whose length is between 1e-140 and 1e150",
            advice,
        )
    return vector


def as_array(failed: str | Words, value: object, wanted: str) -> np.ndarray[Any, Any]:
    """Return `numpy.asarray(value)`; InvalidInput for what is no array, OutOfMemory where it does not fit."""
    try:
        return np.asarray(value)
    except MemoryError:
        found = f"{shown(value)}, for which there is not enough memory"
        raise complain(failed, found, wanted, _FEWER, kind=OutOfMemory) from None
    except Exception as error:  # Objects of others raise whatever they like.
        raise complain(failed, f"{type(value).__name__}: {error}", wanted) from None


def numbers(what: str, value: object, wanted: str) -> np.ndarray[Any, Any]:
    """Return an array of real numbers, or InvalidInput that says what was wanted. Masked entries become NaN.

    Types other than float32 and float64 become float64, and so does what is not in this machine's byte order.
    """
    if isinstance(value, np.ma.MaskedArray):
        if np.ma.is_masked(value) and value.dtype.kind in "biuf":
            value = np.ma.filled(value.astype(np.float64), np.nan)
        else:
            value = value.data
    array = as_array(unusable(what), value, wanted)
    # A list without entries is float64 for NumPy; None and texts are objects and strings.
    if array.dtype.kind not in "biuf":
        found = shown(value) if value is None or array.ndim == 0 else f"values of type {array.dtype}"
        raise complain(unusable(what), found, f"{wanted}, integers or real floating-point numbers")
    native = array.dtype.newbyteorder("=")
    if native in (np.dtype(np.float32), np.dtype(np.float64)):
        if array.dtype.isnative:
            return array
    else:
        native = np.dtype(np.float64)
    _memory.require(array.size * native.itemsize, f"a copy of {what}", _FEWER)
    with np.errstate(over="ignore"):
        return array.astype(native)


def color(what: str, value: object) -> Triple:
    """Return red, green, blue of three numbers, a name such as "white", or "#rrggbb", or InvalidInput."""
    if isinstance(value, str):
        from PIL import ImageColor

        try:
            red, green, blue = ImageColor.getrgb(value.strip())[:3]
        except ValueError:
            wanted = 'three numbers, "#rrggbb", or a colour\'s name'
            raise complain(unusable(what), shown(value), wanted, nearest_names(value, ImageColor.colormap)) from None
        return red / 255, green / 255, blue / 255
    return strengths(what, triple(what, value))


def image_size(value: object) -> tuple[int, int]:
    """Return (width, height) in pixels, both equal where one number is given, or InvalidInput."""
    wanted = "one or two whole numbers of pixels, (width, height), each from 1 to 2147483647"
    if isinstance(value, int | np.integer) and not isinstance(value, bool | np.bool_):
        value = (value, value)
    try:
        parts = list(itertools.islice(value, 3))  # type: ignore[call-overload]
        if any(isinstance(part, bool | np.bool_) for part in parts):
            raise TypeError
        width, height = map(operator.index, parts)
    except Exception:  # Objects of others raise whatever they like.
        raise complain("the size of the picture cannot be used", shown(value), wanted, option="size") from None
    if not (1 <= width < 2**31 and 1 <= height < 2**31):
        raise complain("the size of the picture cannot be used", shown((width, height)), wanted, option="size")
    return width, height


def convert(owner: object, **checks: Callable[[str, Any], Any]) -> None:
    """Replace attributes of a frozen dataclass, in its __post_init__, by what their checks return."""
    for name, check in checks.items():
        object.__setattr__(owner, name, check(f"{type(owner).__name__}: {name}", getattr(owner, name)))


def share(what: str, value: object) -> float:
    """Return a float from 0 to 1, or InvalidInput."""
    result = number(what, value)
    if not 0.0 <= result <= 1.0:
        raise complain(unusable(what), f"{result:g}", "a number from 0 to 1")
    return result


def nearest_names(value: object, names: Iterable[str]) -> str:
    """Return the advice "did you mean …?" for a name that is nearly one of `names`, else ""."""
    import difflib

    known = list(names)
    word = value.lower() if isinstance(value, str) else ""
    near = difflib.get_close_matches(word, known)
    # A part of a longer name: "iso" of iso_value.
    near = near or [one for one in known if word and word in one.split("_")]
    # In words of few letters one of them is a larger share.
    near = near or difflib.get_close_matches(word, known, n=1, cutoff=0.55)
    return f"did you mean {' or '.join(near)}?" if near else ""


def choice(what: str, value: object, names: Sequence[str]) -> str:
    """Return one of `names`, or InvalidInput."""
    if not isinstance(value, str) or value not in names:
        raise complain(unusable(what), shown(value), "one of: " + ", ".join(names), nearest_names(value, names))
    return value


def whole(what: str, value: object, wanted: str = "a whole number", bits: int = 32, advice: str = "") -> int:
    """Return an int that fits so many bits, or InvalidInput that says what was wanted."""
    try:
        if isinstance(value, bool | np.bool_):
            raise TypeError
        result = operator.index(value)  # type: ignore[arg-type]
    except Exception:  # Objects of others raise whatever they like.
        raise complain(unusable(what), shown(value), wanted) from None
    if not -(2 ** (bits - 1)) <= result < 2 ** (bits - 1):
        raise complain(unusable(what), shown(result), f"a whole number of {bits} bits", advice)
    return result


def file_path(failed: str, value: object, wanted: str) -> Path:
    """Return a path, or InvalidInput for what names no file on this system."""
    try:
        if isinstance(value, str | os.PathLike):
            name: str = os.fsdecode(value)
            if name and b"\0" not in os.fsencode(name):
                return Path(name)
    except Exception:  # Objects of others raise whatever they like; and some texts are no names.
        pass
    raise complain(failed, shown(value), wanted)


def suffix_of(value: object) -> str:
    """Return the suffix of a path in small letters, "" for everything that is none."""
    try:
        return Path(os.fsdecode(value)).suffix.lower() if isinstance(value, str | os.PathLike) else ""
    except Exception:  # Objects of others raise whatever they like.
        return ""


def attribute(value: object, name: str) -> Any:
    """Return an attribute, None where there is none."""
    try:
        return getattr(value, name, None)
    except Exception:  # Objects of others raise whatever they like.
        return None


def instance(what: str, value: object, kind: type) -> None:
    """Raise InvalidInput unless `value` is a `kind`."""
    if not isinstance(value, kind):
        wanted = "a mapping such as a dict" if kind is Mapping else f"sheetsplat.{kind.__name__}"
        raise complain(unusable(what), f"{type(value).__name__}, {shown(value)}", wanted)


def check_progress(owner: str, progress: object) -> None:
    """Raise InvalidInput for what is neither a function of the finished share, nor None."""
    if progress is not None and not callable(progress):
        raise complain(unusable(f"{owner}: progress"), shown(progress), "a function of one number, or None")
