"""Checks that the definitions of options are made of: each takes the name of the option, for messages, and a value."""

from __future__ import annotations

from typing import Any, get_args

from sheetsplat._checks import choice, instance
from sheetsplat.options.core import Check


def one_of(literal: Any) -> Check:
    """Return a check for the names of a Literal."""
    return lambda what, value: choice(what, value, get_args(literal))


def optional(check: Check) -> Check:
    """Return a check that lets None through."""
    return lambda what, value: None if value is None else check(what, value)


def instance_of(kind: type) -> Check:
    """Return a check for instances of a class."""

    def check(what: str, value: object) -> object:
        instance(what, value, kind)
        return value

    return check


def or_default(kind: type) -> Check:
    """Return a check for instances of a class; None becomes the one that the class makes without arguments."""
    check = instance_of(kind)
    return lambda what, value: kind() if value is None else check(what, value)
