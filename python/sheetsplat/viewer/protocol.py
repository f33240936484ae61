"""Messages between a session and its pages: what may be said, and how it becomes bytes.

A message is an object of JSON with a key "type"; some have bytes beside it. Whatever a page sends that is not known
here is dropped.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from sheetsplat.camera import Kind
from sheetsplat.describe.schema import fits
from sheetsplat.options.values import Real, Whole

#: Most bytes of a message from a page. Transfer functions of a thousand points fit.
LONGEST = 1 << 17
#: Kinds of films, and what browsers call them.
FILMS = {"mp4": "video/mp4", "webm": "video/webm", "gif": "image/gif"}
_MOST_CHANGES, _MOST_FRAMES = 32, 2000
_MOST_PIXELS, _WIDEST = 1 << 25, 8192


@dataclass(frozen=True)
class Message:
    """What a page asks for."""

    type: str
    parts: dict[str, Any]


_LENGTH, _NUMBER, _VECTOR = Whole(1, _WIDEST), Whole(0, (1 << 53) - 1), tuple[float, float, float] | None
_RATE = Real(above=math.nextafter(1.0, 0.0), most=120.0)
# The messages of a page: the keys that each has, and of which type, or within which limits, their values are.
_KNOWN: dict[str, dict[str, Any]] = {
    "hello": {"width": _LENGTH, "height": _LENGTH},
    "size": {"width": _LENGTH, "height": _LENGTH},
    "set": {"changes": Mapping[str, object]},
    "drawn": {"number": _NUMBER},
    "undo": {},
    "redo": {},
    # To tell what is under the pointer, to turn about it, or to measure from it.
    "pick": {"x": float, "y": float, "purpose": Literal["tell", "centre", "measure"]},
    "look": {"direction": _VECTOR, "up": _VECTOR, "kind": Kind | None},
    "reset": {},
    # As it is shown, with what the page draws over it, or alone.
    "save": {"width": _LENGTH, "height": _LENGTH, "shown": bool},
    "film": {
        **{"what": Literal["turn", "times"], "frames": Whole(2, _MOST_FRAMES), "fps": _RATE},
        **{"kind": Literal["mp4", "webm", "gif"], "width": _LENGTH, "height": _LENGTH},
    },
    "film_stop": {},
    "scene": {},
    "code": {},
    "measure": {"what": Literal["effects", "error"]},
    "stop": {},
}


def parse(text: str | bytes) -> Message | None:
    """Return the message of a page, or None where it is too long, unknown, or has other keys or values."""
    if len(text) > LONGEST:
        return None
    try:
        parts = json.loads(text, parse_constant=_refused)
    except (ValueError, RecursionError):
        return None
    kind = parts.pop("type", "") if isinstance(parts, dict) else ""
    known = _KNOWN.get(kind) if isinstance(kind, str) else None
    if known is None or parts.keys() != known.keys() or not all(fits(parts[name], known[name]) for name in known):
        return None
    if (
        not 0 < len(parts.get("changes", "-")) <= _MOST_CHANGES
        or parts.get("width", 1) * parts.get("height", 1) > _MOST_PIXELS
    ):
        return None
    return Message(kind, parts)


def _refused(name: str) -> float:
    raise ValueError(f"the number {name}")


def packed(message: dict[str, Any], payload: bytes) -> bytes:
    """Return a message with bytes beside it as one: the length of the JSON (4 bytes, little-endian), JSON, bytes."""
    head = json.dumps(message, allow_nan=False).encode()
    return struct.pack("<I", len(head)) + head + payload
