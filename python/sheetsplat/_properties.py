"""Properties that only pass on an attribute."""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Generic, TypeVar

T = TypeVar("T")


class Forwarded(property, Generic[T]):
    """A read-only property: the attribute at `path`, for example "native.size", converted if a function is given."""

    def __init__(self, path: str, doc: str, convert: Callable[[Any], T] | None = None) -> None:
        get = attrgetter(path)
        super().__init__(get if convert is None else lambda owner: convert(get(owner)), doc=doc)
        # In Python 3.11 the docstring of a subclass of property hides the one that was passed.
        self.__doc__ = doc

    if TYPE_CHECKING:

        def __get__(self, instance: Any, owner: type | None = None, /) -> T: ...  # type: ignore[override]
