"""Fewest items that still fail: delta debugging (Zeller and Hildebrandt 2002), by leaving out parts."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

Items = TypeVar("Items", bytes, list[str], list[int])


def fewest(items: Items, wrong: Callable[[Items], bool]) -> Items:
    """Return as few of the items as are found for which `wrong` is still true; parts of them are left out in turn."""
    size = max(1, len(items) // 2)
    while items:
        at = 0
        while at < len(items):
            less = items[:at] + items[at + size :]
            if wrong(less):
                items = less
            else:
                at += size
        if size == 1:
            break
        size = max(1, min(size // 2, len(items) // 2))
    return items
