"""What is made of a volume and kept as long as it is there: by the volume itself, or by others that were made of it.

Pictures show volumes that are made of the one that was given: with another base, as logarithms, within limits. These
are made for each picture, in little time. What takes long, the coefficients of a prefilter, is kept with the volume
that was given, under the steps by which the others were made of it.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any, TypeVar

from sheetsplat.fields.base import Field
from sheetsplat.fields.regular import RegularField

Made = TypeVar("Made", bound=Field)

# By native fields, which stand for samples and options. What a volume was made of is not held by it.
_origins: weakref.WeakKeyDictionary[Any, tuple[weakref.ref[Any], tuple[Any, ...]]] = weakref.WeakKeyDictionary()
_kept: weakref.WeakKeyDictionary[Any, tuple[tuple[Any, ...], RegularField]] = weakref.WeakKeyDictionary()


def derived(made: Made, of: Field, *step: Any) -> Made:
    """Return a field that was made of another one, and remember by which step; equal steps make equal samples."""
    root, steps = _root(of)
    _origins[made.native] = weakref.ref(root), (*steps, step)
    return made


def kept(field: RegularField, *key: Any) -> RegularField | None:
    """Return what was kept of a volume under a key, with what is told of this one; None: there is nothing."""
    root, steps = _root(field)
    known, made = _kept.get(root, (None, None))
    return made.told_by(field) if made is not None and known == (*steps, key) else None


def keep(field: RegularField, make: Callable[[], RegularField], *key: Any) -> RegularField:
    """Return what is made of a volume, and keep it under a key in place of what was kept before."""
    root, steps = _root(field)
    _kept.pop(root, None)
    made = make()
    _kept[root] = (*steps, key), made
    return made


def _root(field: Field) -> tuple[Any, tuple[Any, ...]]:
    """Return the native field that a field was first made of, itself unless that is there, and the steps from it."""
    found = _origins.get(field.native)
    root = None if found is None else found[0]()
    return (field.native, ()) if found is None or root is None else (root, found[1])
