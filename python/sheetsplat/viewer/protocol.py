"""Messages between a session and its pages: what may be said, and how it becomes bytes.

A message is an object of JSON with a key "type"; some have bytes beside it. Whatever a page sends that is not known
here is dropped.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

#: Most bytes of a message from a page. Transfer functions of a thousand points fit.
LONGEST = 1 << 17
#: Kinds of films, and what browsers call them.
FILMS = {"mp4": "video/mp4", "webm": "video/webm", "gif": "image/gif"}
_MOST_FRAMES, _FASTEST = 2000, 120
_MOST_PIXELS, _WIDEST = 1 << 25, 8192


@dataclass(frozen=True)
class Message:
    """What a page asks for."""

    type: str
    parts: dict[str, Any]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 1 << 53


def _is_length(value: Any) -> bool:
    return _is_whole(value) and 0 < value <= _WIDEST


def _is_vector(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 3 and all(map(_is_number, value))


def _is_mapping(value: Any) -> bool:
    return isinstance(value, dict) and 0 < len(value) <= 32


def _one_of(*names: str) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, str) and value in names


def _or_none(check: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: value is None or check(value)


# The messages of a page: the keys that each has, and what their values are.
_KNOWN: dict[str, dict[str, Callable[[Any], bool]]] = {
    "hello": {"width": _is_length, "height": _is_length},
    "size": {"width": _is_length, "height": _is_length},
    "set": {"changes": _is_mapping},
    "drawn": {"number": _is_whole},
    "pick": {"x": _is_number, "y": _is_number},
    "look": {
        "direction": _or_none(_is_vector),
        "up": _or_none(_is_vector),
        "kind": _or_none(_one_of("orthographic", "perspective")),
    },
    "reset": {},
    "save": {"width": _is_length, "height": _is_length},
    "film": {
        "what": _one_of("turn", "times"),
        "frames": lambda value: _is_whole(value) and 2 <= value <= _MOST_FRAMES,
        "fps": lambda value: _is_number(value) and 1 <= value <= _FASTEST,
        "kind": _one_of(*FILMS),
        "width": _is_length,
        "height": _is_length,
    },
    "film_stop": {},
    "scene": {},
    "code": {},
    "measure": {"what": _one_of("effects", "error")},
    "stop": {},
}


def parse(text: str | bytes) -> Message | None:
    """Return the message of a page, or None where it is too long, unknown, or has other keys or values."""
    if len(text) > LONGEST:
        return None
    try:
        given = json.loads(text, parse_constant=_refused)
    except (ValueError, RecursionError):
        return None
    if not isinstance(given, dict) or not isinstance(given.get("type"), str):
        return None
    parts = {name: value for name, value in given.items() if name != "type"}
    known = _KNOWN.get(given["type"])
    if known is None or parts.keys() != known.keys():
        return None
    try:
        good = all(check(parts[name]) for name, check in known.items())
    except (OverflowError, RecursionError):
        return None
    if not good or parts.get("width", 1) * parts.get("height", 1) > _MOST_PIXELS:
        return None
    return Message(given["type"], parts)


def _refused(name: str) -> float:
    raise ValueError(f"the number {name}")


def packed(message: dict[str, Any], payload: bytes) -> bytes:
    """Return a message with bytes beside it as one: the length of the JSON (4 bytes, little-endian), JSON, bytes."""
    head = json.dumps(message, allow_nan=False).encode()
    return struct.pack("<I", len(head)) + head + payload
