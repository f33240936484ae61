"""Plain values of scenes as the tables of a scene file."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

from sheetsplat._checks import shown
from sheetsplat._values import arguments_of
from sheetsplat.camera import Camera
from sheetsplat.errors import complain, unusable
from sheetsplat.options.core import Option
from sheetsplat.scene_file.sections import options_of, value_of
from sheetsplat.transfer import TransferFunction


def data_table(field: Mapping[str, Any], group: int | None) -> dict[str, Any]:
    """Return the table of a field's data, of what a PNG says about it."""
    known = options_of("data")
    # Kernels of scattered data that a reader made follow from what it was told.
    own = {} if field["kind"] == "EllipsoidField" and field["opened"] else field["options"]
    given = {name: one for name, one in {**own, **field["opened"]}.items() if name in known and one is not False}
    trim = {name: one for name, one in field["trim"].items() if one}
    return {"kind": field["kind"], "group": group, **given, "trim": trim or None, "ghost_points": field["ghost_points"]}


def camera_table(camera: Camera) -> dict[str, Any]:
    """Return the table of a camera with its eye."""
    ends = (
        ("height",) if camera.kind == "orthographic" else ("fov_y", "near", *(("shift",) if any(camera.shift) else ()))
    )
    vectors = {name: list(getattr(camera, name)) for name in ("eye", "target", "up")}
    return {"projection": camera.kind, **vectors, **{name: getattr(camera, name) for name in ends}}


def checked(option: Option, value: Any) -> Any:
    """Return what a class makes of the value of an option."""
    return value if option.check is None else option.check(option.name, value)


def changed(known: Mapping[str, Option], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return those of some plain values that are not the defaults of their options."""
    found = {}
    for name, value in values.items():
        option = known[name]
        if value is None or option.check is None or value == option.default:
            same = value is None or (
                value == option.default and isinstance(value, bool) == isinstance(option.default, bool)
            )
        else:
            same = bool(checked(option, value_of(option, value)) == checked(option, option.default))
        if not same:
            found[name] = value
    return found


def one_or_all(functions: list[Any]) -> Any:
    """Return the only transfer function, or all of them."""
    return functions[0] if len(functions) == 1 else functions


def plain(name: str, value: Any) -> Any:
    """Return a value of `sheetsplat.render` as one of TOML; InvalidInput for functions and other objects."""
    if isinstance(value, TransferFunction):
        return value.points.tolist()
    if isinstance(value, str | bool | int | float) or value is None:
        return value
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    if hasattr(value, "native") and hasattr(value, "__dataclass_fields__"):
        return {key: plain(name, one) for key, one in arguments_of(value).items() if one is not None}
    if isinstance(value, Mapping):
        return {str(key): plain(name, one) for key, one in value.items()}
    if isinstance(value, Sequence):
        return [plain(name, one) for one in value]
    raise complain(
        unusable(name), f"{type(value).__name__}, {shown(value)}", "a value that a file can hold", option=name
    )


def without_none(value: Any) -> Any:
    """Return plain values without the entries of tables that are None."""
    if isinstance(value, Mapping):
        return {name: without_none(one) for name, one in value.items() if one is not None}
    return [without_none(one) for one in value] if isinstance(value, list | tuple) else value
