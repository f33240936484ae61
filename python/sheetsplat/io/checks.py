"""Checks that readers share: names, sizes and numbers of files that are not trusted."""

from __future__ import annotations

import math
import operator
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import shown, whole
from sheetsplat.errors import Error, Words, complain, option_ref
from sheetsplat.io import names

#: A file, or the name of data in memory, for messages.
Where = Path | str
_MOST_NAMES = 60
_LONGEST_TEXT = 200


def unreadable(
    path: Where, found: str | Words, wanted: str, advice: str | Words = "", option: str | None = None
) -> Error:
    """Return the InvalidInput for a file, or data in memory, with invalid content."""
    return complain(f"{path} cannot be read", found, wanted, advice, option=option)


def chosen_step(path: Where, count: int, step: int | None) -> int:
    """Return the number of a time step: `step`, else that of the only one; InvalidInput where there is no such."""
    if step is not None:
        whole("open: step", step)
    if step is None and count > 1 and not names.are_asked_for():
        raise unreadable(path, f"{count} time steps", "one", "pass " + option_ref("step", "0"), option="step")
    if not 0 <= (step or 0) < count:
        raise unreadable(
            path, f"no step {step or 0} of {count}", f"from 0 to {count - 1}" if count else "one or more", option="step"
        )
    return step or 0


def sides(shape: Sequence[int]) -> str:
    """Return sizes for a message."""
    return " x ".join(map(str, shape))


def floats(path: Where, what: str, told: Any, count: int) -> list[float]:
    """Return the numbers of a header, or those in its text, or InvalidInput unless there are `count`, all finite."""
    try:
        numbers = [float(one) for one in (told.split() if isinstance(told, str) else np.asarray(told).reshape(-1))]
    except (TypeError, ValueError):
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        found = np.asarray(told).tolist() if isinstance(told, list) else told
        wanted = "a finite number" if count == 1 else f"{count} finite numbers"
        raise unreadable(path, f"{what} = {shown(found)}", wanted)
    return numbers


def numbers_in_text(text: bytes, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return the numbers in a text, blanks between them, in this type; a ValueError or Warning for anything else."""
    with warnings.catch_warnings(), np.errstate(over="ignore"):
        warnings.simplefilter("error", DeprecationWarning)
        kind = np.dtype(np.float64) if dtype.kind == "f" else np.dtype(np.int64)
        return np.fromstring(text.decode("ascii"), dtype=kind, sep=" ").astype(dtype.newbyteorder("="))


def natural(path: Path, what: str, text: str) -> int:
    """Return the whole number in a text of a header, or InvalidInput unless it is from 0 to 10^18."""
    if not (text.isascii() and text.isdigit() and len(text) <= 18):
        raise unreadable(path, f"{what} = {shown(text)}", "a number that is not negative")
    return int(text)


def printable(text: object) -> str:
    """Return a text of a header as figures show it: one line of at most 200 characters; "" for anything else."""
    if isinstance(text, bytes):
        text = text.decode("utf-8", "replace")
    words = " ".join(text.split())[:_LONGEST_TEXT] if isinstance(text, str) else ""
    return words if words.isprintable() else ""


def listed(names: Sequence[str]) -> str:
    """Return names for a message, at most 60 of them."""
    text = ", ".join(names[:_MOST_NAMES])
    return text + (f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else "")


def require_rows(path: Where, count: int, columns: int = 8) -> None:
    """Raise OutOfMemory unless `count` rows of that many float64 fit."""
    _memory.require(count * columns * 8, f"{count} points of {path}")


def checked_shape(path: Where, sizes: object, what: str) -> tuple[int, ...]:
    """Return `sizes` as positive ints whose product fits 63 bits, or InvalidInput."""
    wanted = "positive whole numbers whose product fits 63 bits"
    try:
        # Strings are words of a header. Numbers that are not whole are refused, not rounded.
        shape = tuple(
            int(part) if isinstance(part, str) else operator.index(part)
            for part in sizes  # type: ignore[attr-defined]
        )
    except (TypeError, ValueError, OverflowError):
        raise unreadable(path, f"{what} {shown(sizes)}", wanted) from None
    if any(part < 1 for part in shape) or math.prod(shape) >= 2**59:
        raise unreadable(path, f"{what} {shown(shape)}", wanted)
    return shape


def beside(header: Path, name: str) -> Path:
    """Return the path of the one data file that a header names. InvalidInput unless it is in the header's folder."""
    if name.upper().startswith("LIST") or "%" in name:
        raise unreadable(header, f"several data files ({name})", "one data file", "join the files into one")
    folder = header.resolve().parent
    path = (folder / name).resolve() if name and "\0" not in name else folder
    if Path(name).is_absolute() or path == folder or folder not in path.parents:
        raise unreadable(
            header,
            f"a data file {name!r}",
            "the name of a file in the header's own folder",
            "put both files into one folder and name the data file without a path",
        )
    return path


def require_volume(where: str, shape: Any, dtype: Any) -> None:
    """Raise InvalidInput unless an array has three axes and real numbers, OutOfMemory where it does not fit."""
    check_volume(where, shape, dtype)
    # The array, and the copy that the field keeps.
    _memory.require(2 * math.prod(map(int, shape)) * np.dtype(dtype).itemsize, where)


def check_volume(where: str, shape: Any, dtype: Any) -> None:
    """Raise InvalidInput unless an array has three axes of known sizes and real numbers."""
    if len(shape) != 3:
        advice = "choose one channel or one time step" if len(shape) > 3 else ""
        raise unreadable(where, f"{len(shape)} axes, shape {tuple(shape)}", "three axes, values[k, j, i]", advice)
    if np.dtype(dtype).kind not in "biuf":
        raise unreadable(where, f"values of type {dtype}", "integers, booleans or real floating-point numbers")
    if not all(math.isfinite(size) for size in shape):
        advice = "compute the sizes first: compute_chunk_sizes()"
        raise unreadable(where, f"shape {tuple(shape)}, which is not known yet", "known sizes", advice)
