"""Cases as JSON: plain values, bytes, arrays and tuples come back as they were."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np

Case = dict[str, Any]


def plain(value: Any) -> Any:
    """Return a value as JSON knows it; `restored` is the way back."""
    if isinstance(value, bytes):
        return {"base64": base64.b64encode(value).decode()}
    if isinstance(value, np.ndarray):
        return {"array": value.tolist(), "dtype": value.dtype.str}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, tuple):
        return {"tuple": [plain(part) for part in value]}
    if isinstance(value, list):
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
        case ["base64"]:
            return base64.b64decode(value["base64"])
        case ["array", "dtype"]:
            return np.array(value["array"], value["dtype"])
        case ["tuple"]:
            return tuple(restored(part) for part in value["tuple"])
    return {name: restored(part) for name, part in value.items()}


def save(path: Path, content: dict[str, Any]) -> None:
    """Write a failure: its case, and what was found."""
    part = path.with_name(path.name + ".part")
    part.write_text(json.dumps(plain(content), indent=1) + "\n", encoding="utf-8")
    part.replace(path)


def load(path: Path) -> dict[str, Any]:
    """Return a failure that `save` wrote."""
    found: dict[str, Any] = restored(json.loads(path.read_text(encoding="utf-8")))
    return found
