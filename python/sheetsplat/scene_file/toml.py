"""Writing TOML: tables of plain values as text that `tomllib` reads again, to the last digit."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

_BARE = re.compile(r"[A-Za-z0-9_-]+")
# Arrays that would be longer than this have one entry a line.
_COLUMNS = 100


def document(tables: Mapping[str, Any]) -> str:
    """Return the text of a document: plain values first, then a table for each mapping and each list of mappings.

    Values are texts, truths, numbers, and lists and mappings of them. Raises TypeError for anything else, and
    ValueError for texts that UTF-8 does not have.
    """
    lines = [f"{_key(name)} = {_value(value)}" for name, value in tables.items() if not _is_table(value)]
    for name, value in tables.items():
        if isinstance(value, Mapping):
            lines += ["", f"[{_key(name)}]", *_pairs(value)]
        elif _is_table(value):
            for one in value:
                lines += ["", f"[[{_key(name)}]]", *_pairs(one)]
    return "\n".join(lines).lstrip("\n") + "\n"


def _is_table(value: Any) -> bool:
    return isinstance(value, Mapping) or (
        isinstance(value, list | tuple) and bool(value) and all(isinstance(one, Mapping) for one in value)
    )


def _pairs(table: Mapping[str, Any]) -> list[str]:
    return [f"{_key(name)} = {_value(value)}" for name, value in table.items()]


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else _text(name)


def _text(text: str) -> str:
    text.encode()
    # JSON escapes what TOML does, but for one character.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else "nan" if math.isnan(value) else "inf" if value > 0 else "-inf"
    if isinstance(value, Mapping):
        return "{" + ", ".join(_pairs(value)) + "}"
    if isinstance(value, Sequence):
        parts = [_value(one) for one in value]
        line = f"[{', '.join(parts)}]"
        nested = any(isinstance(one, Mapping | list | tuple) for one in value)
        return line if len(line) <= _COLUMNS or not nested else "[\n    " + ",\n    ".join(parts) + ",\n]"
    raise TypeError(f"{type(value).__name__} in a scene file")
