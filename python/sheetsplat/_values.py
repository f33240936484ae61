"""What objects that are made of their arguments have in common."""

from __future__ import annotations

from dataclasses import fields
from typing import Any


class OfArguments:
    """Frozen dataclasses that keep a native object beside their arguments: pickled and copied by the arguments."""

    __slots__ = ()

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the class and the arguments."""
        return type(self), tuple(arguments_of(self).values())


def arguments_of(instance: Any) -> dict[str, Any]:
    """Return the arguments of a dataclass by name."""
    return {one.name: getattr(instance, one.name) for one in fields(instance) if one.init}
