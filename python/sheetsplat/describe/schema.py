"""Plain values of scenes: texts, truths, numbers, and lists and mappings of them; what options and objects they make.

Which values an option may have follows from its definition (`sheetsplat.options`). PNGs and pages have them as JSON,
scene files as TOML: lists for vectors and arrays, mappings with the arguments of their class for objects (`Clip` …).
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin

import numpy as np

from sheetsplat._checks import nearest_names, shown
from sheetsplat._values import arguments_of
from sheetsplat.camera import Camera
from sheetsplat.errors import Error, complain, unusable
from sheetsplat.labels import LabelColors
from sheetsplat.options.core import Option, UnknownOption, choices_of
from sheetsplat.options.values import Numbers, Real, Whole
from sheetsplat.transfer import TransferFunction

#: Most characters that are read or written, and how deep arrays and tables nest at most; scenes nest six deep.
LONGEST, DEEPEST = 1 << 20, 32
#: The arguments of cameras by what makes them.
CAMERAS = {
    "orthographic": ("eye", "target", "up", "height"),
    "perspective": ("eye", "target", "up", "fov_y", "near", "shift"),
    "fit": ("lower", "upper", "direction", "up", "kind", "margin", "fov_y"),
}
_MOST_OBJECTS = 4096
_LABELS = ("colors", "names", "background")
# Options that take a transfer function.
_FUNCTIONS = ("transfer_function", "color_map")
_ROWS = Sequence[tuple[float, float, float, float, float]]
# Texts of numbers may have any number of digits.
_LARGEST = sys.float_info.max


def tuples(value: Any) -> Any:
    """Return lists as tuples, at any depth."""
    return tuple(map(tuples, value)) if isinstance(value, list) else value


def class_of(kind: Any) -> tuple[type | None, bool]:
    """Return the class of the objects of an option's type, and whether it takes several; None: no objects."""
    if isinstance(kind, type) and is_dataclass(kind):
        return kind, False
    origin = get_origin(kind)
    several = isinstance(origin, type) and issubclass(origin, Iterable)
    found = map(class_of, get_args(kind))
    return next(((one, several or inner) for one, inner in found if one is not None), (None, False))


# ------------------------------------------------------------------------------------------------------------- reading


def check_keys(given: Iterable[str], known: Iterable[str], owner: str) -> None:
    """Raise UnknownOption for the first key that is not known."""
    names = list(known)
    for name in given:
        if name not in names:
            advice = nearest_names(name, names) or "it has " + ", ".join(names)
            raise complain(f"{owner} has no key of this name", name, "", advice, option=name, kind=UnknownOption)


def check_object(value: Any, known: Sequence[str] | None = None, needed: Sequence[str] = ()) -> None:
    """Raise for what is no object of JSON, for a key that is not known, and for one that is not there."""
    if not isinstance(value, dict):
        raise complain("", shown(value), "an object {name: value}")
    check_keys(value, value if known is None else known, "it")
    for name in needed:
        if name not in value:
            raise complain("", f"no key {name!r}", "all of: " + ", ".join(needed))


def function_of(value: Any) -> TransferFunction:
    """Return a transfer function of its rows, or colours of labels of an object; InvalidInput for anything else."""
    if isinstance(value, dict):
        check_object(value, _LABELS, _LABELS)
        colors, names, background = (value[name] for name in _LABELS)
        check_object(colors)
        check_object(names)
        known = fits(list(colors.values()), Sequence[tuple[float, float, float, float]])
        if not known or not fits(list(names.values()), Sequence[str]) or not fits(background, int):
            raise complain("", shown(value), "colours of four numbers, names, and a background, by label")
        told, called = ({_label_of(key): one for key, one in part.items()} for part in (colors, names))
        return LabelColors(told, called, background)
    if not fits(value, _ROWS):
        raise complain("", shown(value), "rows of five numbers")
    return TransferFunction(value)


def _label_of(key: str) -> int:
    if re.fullmatch(r"-?\d{1,13}", key, re.ASCII) is None:
        raise complain("", shown(key), "a whole number")
    return int(key)


def object_of(kind: type, given: Mapping[str, Any]) -> Any:
    """Return the object of a dataclass that plain values make: UnknownOption or InvalidInput where none."""
    known = {one.name: one for one in fields(kind) if one.init}
    check_keys(given, known, kind.__name__)
    for name, one in known.items():
        if name not in given and one.default is MISSING and one.default_factory is MISSING:
            raise complain(f"{kind.__name__} is not complete", f"no {name}", ", ".join(known), option=name)
    return kind(**{name: tuples(part) for name, part in given.items()})


def camera_of(given: Mapping[str, Any], word: str, optional: Sequence[str] = ("up", "near", "shift")) -> Camera:
    """Return the camera of its arguments, and of what makes it under a key `word`; InvalidInput for other keys."""
    arguments = dict(given)
    maker = arguments.pop(word, None)
    names = CAMERAS.get(maker) if isinstance(maker, str) else None
    if names is None:
        raise complain(unusable(word), shown(maker), "one of: " + ", ".join(CAMERAS), option=word)
    check_keys(arguments, names, f"a camera with an eye and {word} {maker}")
    for name in names:
        if name not in arguments and name not in optional:
            what = f"a camera with {word} {maker} is not complete"
            raise complain(what, f"no {name}", ", ".join(names), option=names[0])
    return Camera.of_arguments(str(maker), arguments)


def value_of(option: Option, value: Any) -> Any:
    """Return what an option takes for a plain value: objects of mappings, other values as they are.

    Raises InvalidInput where the value has no meaning for this option, whatever the others are.
    """
    if option.name in _FUNCTIONS and isinstance(value, dict | list) and value:
        # One function, or several; rows of five numbers are no colormap, whose rows have three or four.
        alone = isinstance(value, dict) or (option.name == "color_map" and fits(value, _ROWS))
        tables = [value] if alone else value
        if alone or any(isinstance(one, dict) for one in tables):
            try:
                functions = [function_of(one) for one in tables]
            except Error as error:
                raise _wrong(option, value, error.complaint.wanted.text()) from None
            return functions[0] if alone else functions
    kind, several = class_of(option.type)
    if kind is not None and (isinstance(value, dict) or several) and value not in choices_of(option.type):
        tables = value if isinstance(value, list) else [value]
        if not all(isinstance(one, dict) for one in tables) or isinstance(value, dict) == several:
            raise _wrong(option, value, f"{'an array of tables' if several else 'a table'} of a {kind.__name__}")
        if len(tables) > _MOST_OBJECTS:
            raise _wrong(option, value, f"at most {_MOST_OBJECTS}")
        made = tuple(object_of(kind, one) for one in tables)
        return made if several else made[0]
    if not fits(value, option.type):
        raise _wrong(option, value, _wanted(option), nearest_names(value, choices_of(option.type)))
    limits = option.spellings[0].value if option.spellings else None
    if isinstance(limits, Real) and fits(value, float) and not limits.holds(value):
        raise _wrong(option, value, limits.wanted)
    if isinstance(limits, Whole) and value is not None and not fits(value, limits):
        raise _wrong(option, value, f"a whole number from {limits.least or 0} to {limits.most or 'any'}")
    if isinstance(limits, Numbers) and (limits.positive or limits.whole) and isinstance(value, list):
        if not all(fits(part, float) and part > 0 for part in value):
            raise _wrong(option, value, "numbers above 0")
    return value


def _wrong(option: Option, value: Any, wanted: str, advice: str = "") -> Error:
    return complain(unusable(option.name), shown(value), wanted, advice, option=option.name)


def _wanted(option: Option) -> str:
    words = option.type_text.replace("True, False", "true, false").replace("str", "text").replace("bool", "true, false")
    return words if class_of(option.type)[0] is None else f"{words}: a table with its arguments"


def fits(value: Any, kind: Any) -> bool:
    """Return whether a plain value is of a type of Python's options, or within the limits of numbers."""
    if isinstance(kind, Whole):
        return fits(value, int) and (kind.least or 0) <= value <= (kind.most or math.inf)
    if isinstance(kind, Real):
        return fits(value, float) and kind.holds(value)
    if kind is float:
        return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _LARGEST
    if kind in (bool, int, str):
        return isinstance(value, kind) and isinstance(value, bool) == (kind is bool)
    if isinstance(kind, type) and is_dataclass(kind):
        return isinstance(value, dict)
    if kind is type(None) or kind is object:
        return value is None or kind is object
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Literal:
        return any(type(value) is type(one) and value == one for one in parts)
    if origin in (Union, UnionType):
        return any(fits(value, part) for part in parts)
    if not isinstance(origin, type):
        return False
    if issubclass(origin, Mapping):
        return isinstance(value, dict) and all(fits(one, parts[1]) for one in value.values())
    if not isinstance(value, list):
        return False
    if origin.__module__.partition(".")[0] == "numpy":
        # Arrays, and what NumPy makes arrays of.
        return all(fits(one, float) or fits(one, kind) for one in value)
    if issubclass(origin, tuple) and Ellipsis not in parts:
        return len(value) == len(parts) and all(map(fits, value, parts))
    return issubclass(origin, Iterable) and all(fits(one, parts[0]) for one in value)


# ------------------------------------------------------------------------------------------------------------- writing


def plain(value: Any, name: str = "") -> Any:
    """Return a value, at any depth, as plain values; InvalidInput, naming the option, for functions and other objects.

    Paths are none of them: a picture does not say where its data were.
    """
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if value is None or isinstance(value, str | int | float):
        return value
    if isinstance(value, np.dtype) or (isinstance(value, type) and issubclass(value, np.generic | bool | int | float)):
        return np.dtype(value).str
    if isinstance(value, LabelColors):
        parts = {"colors": value.colors, "names": value.names, "background": value.background}
        return {key: plain(one, name) for key, one in parts.items()}
    if isinstance(value, TransferFunction):
        return value.points.tolist()
    if is_dataclass(value) and type(value).__module__.startswith("sheetsplat."):
        value = arguments_of(value)
    if isinstance(value, Mapping):
        return {str(key): plain(one, name) for key, one in value.items()}
    if isinstance(value, Sequence):
        return [plain(one, name) for one in value]
    found = f"{type(value).__name__}, {shown(value)}"
    raise complain(unusable(name or "a value"), found, "a value that a file can hold", option=name or None)


def eye_parts(camera: Camera) -> dict[str, Any]:
    """Return the arguments that place a camera where it is, however it was made; a shift only where it has one."""
    names = [one for one in CAMERAS[camera.kind] if one != "shift" or any(camera.shift)]
    return {name: getattr(camera, name) for name in names}
