"""Raw samples without a header."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from sheetsplat._checks import shown
from sheetsplat.errors import Error, complain, option_ref
from sheetsplat.io.checks import Where, checked_shape, sides, unreadable
from sheetsplat.io.records import Volume
from sheetsplat.io.source import Source
from sheetsplat.io.stored import StoredSamples

_CHECK = "check " + option_ref("shape") + " and " + option_ref("dtype")


def _dtype(value: DTypeLike) -> np.dtype[Any]:
    wanted = 'the name of a real type of NumPy: "uint8", "int16", ">i2", "float32" …'
    try:
        dtype = np.dtype(value)
    except (TypeError, ValueError, SyntaxError):
        # NumPy evaluates lists of fields such as ",,,".
        raise complain("the type of the samples cannot be used", shown(value), wanted) from None
    if dtype.kind not in "biuf":
        raise complain("the type of the samples cannot be used", str(dtype), wanted)
    return dtype


def read(
    source: Source, shape: tuple[int, int, int] | None = None, dtype: DTypeLike | None = None, offset: int = 0
) -> Volume:
    """Read samples of a given shape (nk, nj, ni) and type; the file must hold exactly these after `offset` bytes."""
    sizes, kind = checked(source, shape, dtype, offset)
    count = math.prod(sizes)
    payload = source.payload("raw")
    payload.expect(_wanted(sizes, kind), _CHECK + ", or fetch the whole file")
    payload.skip(offset)
    values = payload.array(kind, count)
    if payload.surplus:
        more = "more" if source.packed else f"{source.path.stat().st_size - offset} bytes"
        raise _surplus(source, more, offset, sizes, kind)
    return Volume(values.reshape(sizes), format="raw")


def locate(
    source: Source, shape: tuple[int, int, int] | None = None, dtype: DTypeLike | None = None, offset: int = 0
) -> Volume:
    """Return what `read` reads with `StoredSamples` as its values, after its checks, for a file that is not packed."""
    sizes, kind = checked(source, shape, dtype, offset)
    needed, there = math.prod(sizes) * kind.itemsize, source.at_most() - offset
    if there < needed:
        raise unreadable(source.path, f"{max(there, 0)} bytes of samples", _wanted(sizes, kind), _CHECK)
    if there > needed:
        raise _surplus(source, f"{there} bytes", offset, sizes, kind)
    samples: Any = StoredSamples.dense(source.path, kind, sizes, offset)
    return Volume(samples, format="raw")


def checked(
    source: Source, shape: tuple[int, int, int] | None, dtype: DTypeLike | None, offset: int
) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Return shape and type of raw samples; InvalidInput for those that have no meaning."""
    sizes, kind = checked_samples(source.path, shape, dtype)
    if offset < 0:
        raise unreadable(source.path, f"an offset of {offset}", "at least 0 bytes", option="offset")
    return sizes, kind


def checked_samples(where: Where, shape: object, dtype: DTypeLike | None) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Return shape and type as `checked` does."""
    if shape is None or dtype is None:
        missing = " and ".join(name for name, value in (("shape", shape), ("dtype", dtype)) if value is None)
        advice = "pass " + option_ref("shape", "...") + " and " + option_ref("dtype", "...")
        raise unreadable(
            where,
            f"raw samples without their {missing}",
            "both, for a file without a header",
            advice + "; for a PLOT3D solution, pass " + option_ref("grid", "..."),
        )
    kind = _dtype(dtype)
    sizes = checked_shape(where, shape, "shape")
    if len(sizes) != 3:
        raise unreadable(where, f"a shape of {len(sizes)} numbers", "three numbers", option="shape")
    return sizes, kind


def _wanted(sizes: tuple[int, ...], kind: np.dtype[Any]) -> str:
    return f"{math.prod(sizes) * kind.itemsize} bytes, {sides(sizes[::-1])} samples of {kind}"


def _surplus(source: Source, more: str, offset: int, sizes: tuple[int, ...], kind: np.dtype[Any]) -> Error:
    found = f"{more} after the first {offset} bytes" if offset else f"{more} in the file"
    advice = _CHECK + "; for a file with a header, pass its length as " + option_ref("offset", "...")
    return unreadable(source.path, found, _wanted(sizes, kind), advice)
