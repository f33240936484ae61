"""Cases as JSON: plain values, bytes, arrays and tuples come back as they were."""

from __future__ import annotations

import base64
import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np

Case = dict[str, Any]


def plain(value: Any) -> Any:
    """Return a value as JSON knows it; `restored` is the way back."""
    if isinstance(value, bytes):
        # Compressed where that is shorter.
        small = zlib.compress(value, 9)
        name, shortest = ("zlib", small) if len(small) < len(value) else ("base85", value)
        return {name: base64.b85encode(shortest).decode()}
    if isinstance(value, np.ndarray):
        return {"array": [value.dtype.str, list(value.shape), plain(value.tobytes())]}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, tuple):
        return {"tuple": [plain(part) for part in value]}
    if isinstance(value, list):
        lengths = {len(part) if isinstance(part, tuple) and {*map(type, part)} == {float} else 0 for part in value}
        if len(value) > 1 and len(lengths) == 1 and 0 not in lengths:
            return {"tuples": plain(np.array(value))}
        return [plain(part) for part in value]
    if isinstance(value, dict):
        return {str(name): plain(part) for name, part in value.items()}
    return value


def restored(value: Any) -> Any:
    """Return what `plain` was given."""
    if isinstance(value, list):
        return [restored(part) for part in value]
    if not isinstance(value, dict):
        return value
    match sorted(value):
        case ["base85"]:
            return base64.b85decode(value["base85"])
        case ["zlib"]:
            return zlib.decompress(base64.b85decode(value["zlib"]))
        case ["array"]:
            kind, shape, content = value["array"]
            return np.frombuffer(bytearray(restored(content)), kind).reshape(shape)
        case ["tuple"]:
            return tuple(restored(part) for part in value["tuple"])
        case ["tuples"]:
            return list(map(tuple, restored(value["tuples"]).tolist()))
    return {name: restored(part) for name, part in value.items()}


def _lines(value: Any, levels: int) -> str:
    """Return JSON with a line for each name of the outer mappings."""
    if not levels or not isinstance(value, dict):
        return json.dumps(value, separators=(",", ":"))
    named = (f"{json.dumps(name)}: {_lines(one, levels - 1)}" for name, one in value.items())
    return "{\n" + ",\n".join(named) + "\n}"


def save(path: Path, content: dict[str, Any]) -> None:
    """Write a failure: its case, and what was found."""
    part = path.with_name(path.name + ".part")
    part.write_text(_lines(plain(content), 3) + "\n", encoding="utf-8")
    part.replace(path)


def load(path: Path) -> dict[str, Any]:
    """Return a failure that `save` wrote."""
    found: dict[str, Any] = restored(json.loads(path.read_text(encoding="utf-8")))
    return found
