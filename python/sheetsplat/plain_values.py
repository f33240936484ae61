"""Objects of scenes as plain values, and back: what a picture says about itself, and what a scene file holds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any, get_args, get_origin

from sheetsplat._checks import nearest_names
from sheetsplat.errors import complain
from sheetsplat.options.core import Option, UnknownOption


def tuples(value: Any) -> Any:
    """Return lists as tuples, at any depth."""
    return tuple(map(tuples, value)) if isinstance(value, list) else value


def class_of(option: Option) -> tuple[type | None, bool]:
    """Return the class of the objects that an option takes, and whether it takes several; None: no objects."""
    return _class_of(option.type)


def _class_of(kind: Any) -> tuple[type | None, bool]:
    if isinstance(kind, type) and is_dataclass(kind):
        return kind, False
    origin = get_origin(kind)
    several = isinstance(origin, type) and issubclass(origin, Iterable)
    found = (_class_of(part) for part in get_args(kind))
    return next(((one, several or inner) for one, inner in found if one is not None), (None, False))


def object_of(kind: type, arguments: Mapping[str, Any]) -> Any:
    """Return the object of a dataclass that plain values make: UnknownOption, InvalidInput or TypeError where none."""
    names = [one.name for one in fields(kind) if one.init]
    for name in arguments:
        if name not in names:
            advice = nearest_names(name, names) or "it has " + ", ".join(names)
            what = f"{kind.__name__}: there is no option of this name"
            raise complain(what, str(name), "", advice, option=str(name), kind=UnknownOption)
    return kind(**{name: tuples(part) for name, part in arguments.items()})
