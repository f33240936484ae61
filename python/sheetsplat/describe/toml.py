"""TOML beside `tomllib`: its text, which is read again to the last digit; how deep it nests; and the lines of keys."""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Mapping
from typing import Any

#: The way to a value: keys of tables and numbers in arrays.
Place = tuple[str | int, ...]

_BARE = re.compile(r"[A-Za-z0-9_-]+")
# Arrays that would be longer than this have one entry a line.
_COLUMNS = 100
# Words, among them strings: basic and literal, of several lines and of one. The last quotes of a long one belong to it,
# and what has no end takes the rest of the text, so that each character is looked at once. Beside words comments, and
# what opens, closes and parts keys and values.
_TOKEN = re.compile(
    r'(?P<word>"""(?:[^"\\]|\\.?|"{1,2}(?!"))*+(?:"{3,5}|\Z)|"(?:[^"\\]|\\.?)*+(?:"|\Z)|'
    r"'''(?:[^']|'{1,2}(?!'))*+(?:'{3,5}|\Z)|'[^']*+(?:'|\Z)|[A-Za-z0-9_-]+)|#[^\n]*|[\[\]{}.,=\n]",
    re.DOTALL,
)


def document(tables: Mapping[str, Any]) -> str:
    """Return the text of a document: plain values first, then a table for each mapping and each list of mappings.

    Values are texts, truths, numbers, and lists and mappings of them. Raises TypeError for anything else, and
    ValueError for texts that UTF-8 does not have.
    """
    lines = _pairs({name: value for name, value in tables.items() if not _is_table(value)})
    for name, value in tables.items():
        if isinstance(value, Mapping):
            lines += ["", f"[{_key(name)}]", *_pairs(value)]
        elif _is_table(value):
            for one in value:
                lines += ["", f"[[{_key(name)}]]", *_pairs(one)]
    return "\n".join(lines).lstrip("\n") + "\n"


def _is_table(value: Any) -> bool:
    parts = value if isinstance(value, list | tuple) and value else [value]
    return all(isinstance(one, Mapping) for one in parts)


def _pairs(table: Mapping[str, Any]) -> list[str]:
    return [f"{_key(name)} = {_value(value)}" for name, value in table.items()]


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else _value(name)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        value.encode()
        # JSON escapes what TOML does, but for one character.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, int | float):
        return repr(value) if isinstance(value, int) or math.isfinite(value) else f"{value:g}"
    if isinstance(value, Mapping):
        return "{" + ", ".join(_pairs(value)) + "}"
    if isinstance(value, list | tuple):
        parts = [_value(one) for one in value]
        line = f"[{', '.join(parts)}]"
        nested = any(isinstance(one, Mapping | list | tuple) for one in value)
        return line if len(line) <= _COLUMNS or not nested else "[\n    " + ",\n    ".join(parts) + ",\n]"
    raise TypeError(f"{type(value).__name__} in a scene file")


def depth(text: str) -> int:
    """Return how deep a document nests arrays and tables, or how many parts its longest key has, whichever is more.

    Known before anything is parsed: parsers take memory as the square of either, and recurse. JSON is read as well.
    """
    deepest = level = parts = 0
    for found in _TOKEN.finditer(text):
        sign = found[0]
        level += (sign in "[{") - (sign in "]}")
        parts = parts + 1 if sign == "." else parts if found["word"] else 0
        deepest = max(deepest, level, parts + 1)
    return deepest


def lines_of_keys(text: str) -> dict[Place, int]:
    """Return the line, counted from 1, of every key of a document that `tomllib` has read without an error.

    The entries of arrays have lines too, by their numbers, where they are tables or arrays.
    """
    lines: dict[Place, int] = {}
    # Entries that the arrays of tables have so far; the arrays, with the number of the entry, and the tables, with
    # None, that are open; the parts of the key that is being read, and of how many brackets its header has.
    entries: dict[Place, int] = {}
    inside: list[tuple[Place, int | None]] = []
    table: Place = ()
    place: Place = ()
    keys: list[str] | None = []
    brackets, line = 0, 1
    for found in _TOKEN.finditer(text):
        sign = found[0]
        if sign == "\n" and not inside:
            keys, brackets = [], 0
        elif keys is not None and found["word"]:
            keys.append(next(iter(tomllib.loads(f"{sign} = 0"))) if sign[0] in "\"'" else sign)
        elif keys is not None and sign == "[":
            brackets += 1
        elif keys is not None and sign in ("=", "]"):
            place = () if brackets else inside[-1][0] if inside else table
            for number, key in enumerate(keys, 1):
                place = (*place, key)
                lines.setdefault(place, line)
                if brackets == 2 and number == len(keys):
                    entries[place] = entries.get(place, -1) + 1
                if brackets and place in entries:
                    place = (*place, entries[place])
                    lines.setdefault(place, line)
            table, keys = place if brackets else table, None
        elif sign in ("[", "{"):
            if inside and inside[-1][1] is not None:
                place = (*inside[-1][0], inside[-1][1])
                lines.setdefault(place, line)
            inside.append((place, 0 if sign == "[" else None))
            keys = None if sign == "[" else []
        elif sign in ("]", "}") and inside:
            inside.pop()
            keys = None
        elif sign == "," and inside:
            outer, entry = inside[-1]
            inside[-1] = (outer, None if entry is None else entry + 1)
            keys = [] if entry is None else None
        line += sign.count("\n")
    return lines
