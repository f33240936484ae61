"""Warnings about pictures: the one place that issues them."""

from __future__ import annotations

import contextlib
import inspect
import os
import warnings
from collections.abc import Iterator
from contextvars import ContextVar

from sheetsplat.errors import Words

_PACKAGE = os.path.join(os.path.dirname(__file__), "")

_MUTED: ContextVar[bool] = ContextVar("sheetsplat_muted", default=False)
_TAKER: ContextVar[list[PictureWarning] | None] = ContextVar("sheetsplat_taker", default=None)


class PictureWarning(UserWarning):
    """A picture may not show what was intended.

    Nothing can be seen in it, its range contains no value, some data are hidden by others, an option has no effect on
    it, or a requested error or time is not kept.

    Attributes
    ----------
    words
        The message, with references to options that a front end can spell in its own way.

    Examples
    --------
    >>> import warnings
    >>> with warnings.catch_warnings(record=True) as found:
    ...     warnings.simplefilter("always")
    ...     image = ss.render(values, mode="isosurface", iso_value=7, size=(32, 32))
    >>> found[0].category.__name__
    'PictureWarning'
    """

    __module__ = "sheetsplat"

    def __init__(self, words: str | Words = "") -> None:
        self.words = Words.of(words)
        super().__init__(self.words.text())

    def __reduce__(self) -> tuple[type[PictureWarning], tuple[Words]]:
        """Keep the references to options."""
        return type(self), (self.words,)


def warn(words: str | Words) -> None:
    """Issue a PictureWarning at the line that called the package."""
    if _MUTED.get():
        return
    taker = _TAKER.get()
    if taker is not None:
        taker.append(PictureWarning(words))
        return
    # 1 is this function itself.
    level, frame = 1, inspect.currentframe()
    while frame is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        level, frame = level + 1, frame.f_back
    warnings.warn(PictureWarning(words), stacklevel=level)


def is_muted() -> bool:
    """Return whether warnings are not issued here, so that what is looked for need not be found."""
    return _MUTED.get()


@contextlib.contextmanager
def muted() -> Iterator[None]:
    """Issue no warnings: for pictures that nobody sees, and for parts of one."""
    token = _MUTED.set(True)
    try:
        yield
    finally:
        _MUTED.reset(token)


@contextlib.contextmanager
def taken() -> Iterator[list[PictureWarning]]:
    """Yield a list that gets the warnings in place of Python's filters, which all threads share."""
    found: list[PictureWarning] = []
    token = _TAKER.set(found)
    try:
        yield found
    finally:
        _TAKER.reset(token)
