"""The lines at which the keys of a TOML document are, which `tomllib` does not tell."""

from __future__ import annotations

import re

#: The way to a value: keys of tables and numbers in arrays.
Place = tuple[str | int, ...]

_BARE = re.compile(r"[A-Za-z0-9_-]+")
_BLANK = re.compile(r"[ \t]*")
_SPACE = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
# Strings: basic and literal, of one line and of several. The last quotes of a long one belong to it.
_STRING = re.compile(
    r'"""(?:[^\\]|\\.)*?"""(?:"{0,2}(?!"))|' + r"'''.*?'''(?:'{0,2}(?!'))|" + r'"(?:[^"\\]|\\.)*"|' + r"'[^']*'",
    re.DOTALL,
)
_OTHER = re.compile(r"[^\s,\]}#]+(?: [^\s,\]}#]+)?")
# What opens and closes tables and arrays, and what parts keys; strings and comments hide it.
_STRUCTURE = re.compile(rf"{_STRING.pattern}|#[^\n]*|[\[\]{{}}.,=\n]", re.DOTALL)


def depth(text: str) -> int:
    """Return how deep a document nests arrays and tables, or how many parts its longest key has, whichever is more.

    Known before anything is parsed: parsers take memory as the square of either, and recurse.
    """
    deepest = level = parts = 0
    for found in _STRUCTURE.finditer(text):
        sign = found[0]
        level += (sign in "[{") - (sign in "]}")
        parts = parts + 1 if sign == "." else parts if found[0][0] in "\"'" else 0
        deepest = max(deepest, level, parts + 1)
    return deepest


def lines_of_keys(text: str) -> dict[Place, int]:
    """Return the line, counted from 1, of every key of a document that `tomllib` has read without an error.

    The entries of arrays have lines too, by their numbers, where they are tables.
    """
    return _Scanner(text).lines


class _Scanner:
    """Follows the structure of a valid document, without its values."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.lines: dict[Place, int] = {}
        self._counted = (0, 1)
        self._arrays: dict[Place, int] = {}
        table: Place = ()
        self._skip(_SPACE)
        while self.at < len(text):
            if text[self.at] == "[":
                table = self._header()
            else:
                self._pair(table)
            self._skip(_SPACE)

    def _skip(self, pattern: re.Pattern[str]) -> str:
        found = pattern.match(self.text, self.at)
        if found is None:
            # Nothing of a valid document; what follows is not looked at.
            found_text, self.at = self.text[self.at :], len(self.text)
            return found_text
        self.at = found.end()
        return found[0]

    def _line(self) -> int:
        """Return the line of the current place; places do not fall."""
        start, line = self._counted
        line += self.text.count("\n", start, self.at)
        self._counted = (self.at, line)
        return line

    def _note(self, place: Place) -> None:
        self.lines.setdefault(place, self._line())

    def _key(self) -> list[str]:
        """Return the parts of a dotted key."""
        parts = []
        while True:
            self._skip(_BLANK)
            quoted = self.text[self.at : self.at + 1] in ('"', "'")
            word = self._skip(_STRING if quoted else _BARE)
            parts.append(_unquoted(word) if quoted else word)
            self._skip(_BLANK)
            if self.text[self.at : self.at + 1] != ".":
                return parts
            self.at += 1

    def _inside(self, place: Place, key: str) -> Place:
        """Return the place of a key, in the last table of an array where `place` is one."""
        there = (*place, key)
        return (*there, self._arrays[there]) if there in self._arrays else there

    def _header(self) -> Place:
        array = self.text.startswith("[[", self.at)
        self.at += 2 if array else 1
        *outer, last = self._key()
        place: Place = ()
        for key in outer:
            place = self._inside(place, key)
            self._note(place)
        there = (*place, last)
        self._note(there)
        if array:
            self._arrays[there] = self._arrays.get(there, -1) + 1
            there = (*there, self._arrays[there])
            self._note(there)
        self.at += 2 if array else 1
        return there

    def _pair(self, table: Place) -> None:
        place = table
        for key in self._key():
            place = (*place, key)
            self._note(place)
        self.at += 1
        self._skip(_BLANK)
        self._value(place)

    def _value(self, place: Place) -> None:
        first = self.text[self.at : self.at + 1]
        if first == "[":
            self._array(place)
        elif first == "{":
            self._table(place)
        else:
            self._skip(_STRING if first in ('"', "'") else _OTHER)

    def _array(self, place: Place) -> None:
        self.at += 1
        self._skip(_SPACE)
        number = 0
        while self.at < len(self.text) and self.text[self.at] != "]":
            there = (*place, number)
            if self.text[self.at] in "[{":
                self._note(there)
            self._value(there)
            number += 1
            self._skip(_SPACE)
            if self.text[self.at : self.at + 1] == ",":
                self.at += 1
                self._skip(_SPACE)
        self.at += 1

    def _table(self, place: Place) -> None:
        self.at += 1
        self._skip(_SPACE)
        while self.at < len(self.text) and self.text[self.at] != "}":
            self._pair(place)
            self._skip(_SPACE)
            if self.text[self.at : self.at + 1] == ",":
                self.at += 1
                self._skip(_SPACE)
        self.at += 1


def _unquoted(word: str) -> str:
    import tomllib

    (key,) = tomllib.loads(f"{word} = 0")
    return key
