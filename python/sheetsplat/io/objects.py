"""Data in memory that other libraries hold, to fields."""

from __future__ import annotations

import contextlib
import pkgutil
import warnings
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from sheetsplat._objects import ObjectKind
from sheetsplat.errors import Error, OutOfMemory, complain, missing_package, option_refs
from sheetsplat.fields import EllipsoidField, RegularField
from sheetsplat.io.kernels import given
from sheetsplat.io.names import Names, Told, names_in
from sheetsplat.io.opening import READING, field_of_record, refused_for, weighted
from sheetsplat.io.records import Scattered, Volume


@contextlib.contextmanager
def _reading(name: str) -> Iterator[None]:
    """Turn errors of other libraries into errors of this package."""
    try:
        yield
    except (Error, Told):
        raise
    except MemoryError as error:
        what = f"there is not enough memory for {name}"
        raise complain(what, "its size", "data that fit", kind=OutOfMemory) from error
    except ImportError as error:
        raise missing_package(f"{name} cannot be used", error) from error
    except Exception as error:
        reason = (str(error).strip().splitlines() or [""])[0]
        raise complain(
            f"{name} cannot be used", f"{type(error).__name__}: {reason}", "data that can be read"
        ) from error


def read_object(data: object, kind: ObjectKind, options: Mapping[str, Any]) -> Volume | Scattered:
    """Return what an object holds; InvalidInput for options of reading that its kind does not use."""
    reading = {name: value for name, value in options.items() if name in READING}
    wrong = [name for name in reading if name not in kind.options]
    if wrong:
        raise complain(
            f"{kind.name} cannot be used with these options",
            option_refs(wrong),
            "only " + option_refs(kind.options) + " to say how it is read" if kind.options else "them only for files",
            "leave them out",
            option=wrong[0] if len(wrong) == 1 else None,
        )
    with _reading(kind.name), np.errstate(all="ignore"):
        found: Volume | Scattered = pkgutil.resolve_name(kind.reader)(data, kind.name, **given(**reading))
    return found


def arrays_of_object(data: object, kind: ObjectKind) -> Names:
    """Return the names of the arrays of an object among which ``scalar=`` chooses, without reading any.

    Raises
    ------
    InvalidInput
        As reading it.
    """
    if "scalar" not in kind.options:
        return Names()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return names_in(lambda: read_object(data, kind, {}))


def field_of_object(data: object, kind: ObjectKind, options: Mapping[str, Any]) -> RegularField | EllipsoidField:
    """Return the field of an object; `options` are those of `sheetsplat.open` that the caller gave."""

    def read(chosen: Mapping[str, Any]) -> tuple[Volume | Scattered, RegularField | EllipsoidField]:
        record = read_object(data, kind, chosen)
        refused_for(kind.name, record, chosen)
        if isinstance(record, Scattered):
            record = record.usable(kind.name, chosen.get("nan", "error"))
        return record, field_of_record(record, chosen, kind.name)

    return weighted(read, options)
