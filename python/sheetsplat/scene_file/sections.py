"""The sections of a scene file, made of the definitions of options, and the check of their values.

A section is a table whose keys are options of `sheetsplat.render`. Values are TOML's: lists for vectors and arrays,
tables with the arguments of their class for objects (`Clip`, `Light` …).
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import is_dataclass
from functools import cache
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin

from sheetsplat._checks import nearest_names, shown
from sheetsplat.camera import Camera
from sheetsplat.errors import complain, unusable
from sheetsplat.options.camera import CameraOptions
from sheetsplat.options.core import Option, UnknownOption, choices_of, definitions
from sheetsplat.options.data import OpenOptions
from sheetsplat.options.look import TransferOptions
from sheetsplat.options.picture import SizeOptions
from sheetsplat.options.quality import QualityOptions
from sheetsplat.options.renderer import RendererClassOptions
from sheetsplat.options.scene import EffectOptions, LightOptions, ModeOptions, SamplingOptions
from sheetsplat.options.values import Real, Whole
from sheetsplat.plain_values import class_of, object_of

#: The groups of options of each section, in the order of a file.
SECTIONS: dict[str, tuple[type, ...]] = {
    "picture": (QualityOptions, SizeOptions),
    "data": (OpenOptions,),
    "look": (ModeOptions, TransferOptions, SamplingOptions, EffectOptions),
    "light": (LightOptions,),
    "camera": (CameraOptions,),
    "renderer": (RendererClassOptions,),
}
# A number of TOML may have any number of digits.
_LARGEST = 1e308


@cache
def options_of(section: str) -> dict[str, Option]:
    """Return the options of a section by name."""
    found: dict[str, Option] = {}
    for group in SECTIONS[section]:
        found |= definitions(group)
    if section == "data":
        # One for all of a picture.
        del found["quality"]
    return found


@cache
def camera_arguments() -> dict[str, tuple[str, ...]]:
    """Return the arguments of cameras that are not fitted to the data, by the kind of projection."""
    kinds = ("orthographic", "perspective")
    return {kind: tuple(inspect.signature(getattr(Camera, kind)).parameters) for kind in kinds}


def camera_of(table: Mapping[str, Any]) -> Camera:
    """Return the camera of a table that has an eye: InvalidInput for keys that its projection does not have."""
    given = dict(table)
    projection = given.pop("projection", "orthographic")
    names = camera_arguments().get(projection)
    if names is None:
        wanted = " or ".join(camera_arguments())
        raise complain(unusable("projection"), shown(projection), wanted, option="projection")
    check_keys(given, names, f"a camera with an eye and projection {projection}")
    for name in ("eye", "target", "height" if projection == "orthographic" else "fov_y"):
        if name not in given:
            what = f"a camera with an eye and projection {projection} is not complete"
            raise complain(what, f"no {name}", ", ".join(names), option="eye")
    made: Camera = getattr(Camera, projection)(**given)
    return made


def check_keys(table: Iterable[str], known: Iterable[str], owner: str) -> None:
    """Raise UnknownOption for the first key that is not known."""
    names = list(known)
    for name in table:
        if name not in names:
            advice = nearest_names(name, names) or "it has " + ", ".join(names)
            raise complain(f"{owner} has no key of this name", name, "", advice, option=name, kind=UnknownOption)


def value_of(option: Option, value: Any) -> Any:
    """Return what `sheetsplat.render` takes for a value of TOML: objects of tables, lists as tuples.

    Raises InvalidInput where the value has no meaning for this option, whatever the others are.
    """
    kind, several = class_of(option)
    if kind is not None and (isinstance(value, dict) or several):
        tables = value if isinstance(value, list) else [value]
        if not all(isinstance(one, dict) for one in tables) or isinstance(value, dict) == several:
            raise _wrong(option, value, f"{'an array of tables' if several else 'a table'} of a {kind.__name__}")
        made = [object_of(kind, one) for one in tables]
        return tuple(made) if several else made[0]
    if not _fits(value, option.type):
        words = choices_of(option.type)
        advice = nearest_names(value, words)
        raise _wrong(option, value, _wanted(option), advice)
    limits = option.value
    if isinstance(value, int | float) and not isinstance(value, bool):
        if isinstance(limits, Real) and not limits.holds(value):
            raise _wrong(option, value, limits.wanted)
        if isinstance(limits, Whole) and not (limits.least or 0) <= value <= (limits.most or math.inf):
            raise _wrong(option, value, f"a whole number from {limits.least or 0} to {limits.most or 'any'}")
    return value


def _wrong(option: Option, value: Any, wanted: str, advice: str = "") -> Exception:
    return complain(unusable(option.name), shown(value), wanted, advice, option=option.name)


def _wanted(option: Option) -> str:
    kind, several = class_of(option)
    words = option.type_text.replace("True, False", "true, false").replace("str", "text").replace("bool", "true, false")
    return words if kind is None or several else f"{words}: a table with its arguments"


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and not abs(value) > _LARGEST


def _is_array(value: Any) -> bool:
    return isinstance(value, list) and all(_is_number(one) or _is_array(one) for one in value)


_PLAIN: dict[Any, Callable[[Any], bool]] = {
    bool: lambda value: isinstance(value, bool),
    int: lambda value: isinstance(value, int) and not isinstance(value, bool),
    float: _is_number,
    str: lambda value: isinstance(value, str),
}


def _fits(value: Any, kind: Any) -> bool:
    """Return whether a value of TOML is of a type of Python's options."""
    if isinstance(kind, type) and kind in _PLAIN:
        return _PLAIN[kind](value)
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Literal:
        return any(type(value) is type(one) and value == one for one in parts)
    if origin in (Union, UnionType):
        return any(_fits(value, part) for part in parts)
    if isinstance(kind, type) and is_dataclass(kind):
        return isinstance(value, dict)
    if not isinstance(origin, type):
        return False
    if origin.__module__.partition(".")[0] == "numpy":
        # Arrays, and what NumPy makes arrays of.
        return _is_array(value)
    if issubclass(origin, Mapping):
        return isinstance(value, dict) and all(_fits(one, parts[1]) for one in value.values())
    if issubclass(origin, tuple) and Ellipsis not in parts:
        return isinstance(value, list) and len(value) == len(parts) and all(map(_fits, value, parts))
    if issubclass(origin, Iterable):
        return isinstance(value, list) and all(_fits(one, parts[0]) for one in value)
    return False
