"""Values of scenes as Python that makes them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import is_dataclass
from typing import Any

import numpy as np

from sheetsplat._checks import shown
from sheetsplat._values import arguments_of
from sheetsplat.camera import Camera
from sheetsplat.describe.schema import eye_parts
from sheetsplat.errors import InvalidInput, complain
from sheetsplat.labels import LabelColors
from sheetsplat.transfer import TransferFunction

_COLUMNS = 100


class Expression(str):
    """Python that makes a value."""

    __slots__ = ()


def text_of(value: Any) -> str:
    """Return Python that makes a value; InvalidInput for functions, arrays and other objects, which have none."""
    if isinstance(value, Expression):
        return str(value)
    if isinstance(value, np.generic):
        return repr(value.item())
    if value is None or isinstance(value, str | int | float | os.PathLike):
        return repr(os.fspath(value) if isinstance(value, os.PathLike) else value)
    if isinstance(value, LabelColors):
        return f"ss.LabelColors({', '.join(map(text_of, value.arguments))})"
    if isinstance(value, TransferFunction):
        return f"ss.TransferFunction({rows_text(value.points)})"
    if isinstance(value, Camera):
        # Where the camera is comes by position.
        parts = list(eye_parts(value).items())
        return f"ss.Camera.{value.kind}({', '.join([*(str(one) for _, one in parts[:3]), *_named(dict(parts[3:]))])})"
    if isinstance(value, tuple):
        return f"({', '.join(map(text_of, value))}{',' * (len(value) == 1)})"
    if isinstance(value, list):
        return f"[{', '.join(map(text_of, value))}]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key!r}: {text_of(one)}" for key, one in value.items()) + "}"
    if is_dataclass(value) and type(value).__module__.startswith("sheetsplat"):
        return f"ss.{type(value).__name__}({', '.join(_named(arguments_of(value)))})"
    raise complain("there is no Python for this", f"{type(value).__name__}, {shown(value)}", "a plain value")


def _named(arguments: Mapping[str, Any]) -> list[str]:
    return [f"{name}={text_of(one)}" for name, one in arguments.items()]


def rows_text(rows: Any) -> str:
    """Return an array of rows as a list of tuples."""
    return f"[{', '.join(str(tuple(row)) for row in rows.tolist())}]"


def call(function: str, first: list[str], arguments: Mapping[str, Any]) -> tuple[list[str], list[str]]:
    """Return the lines of a call, and the names of arguments that have no Python: they stay names.

    Where one line is too long, each argument has one.
    """
    texts, unknown = list(first), []
    for name, value in arguments.items():
        try:
            texts.append(f"{name}={text_of(value)}")
        except InvalidInput:
            texts.append(f"{name}={name}")
            unknown.append(name)
    joined = f"{function}({', '.join(texts)})"
    if len(joined) <= _COLUMNS:
        return [joined], unknown
    return [f"{function}(", *(f"    {one}," for one in texts), ")"], unknown
