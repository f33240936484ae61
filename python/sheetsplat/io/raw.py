"""Raw samples without a header."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from sheetsplat._checks import shown
from sheetsplat.errors import complain, option_ref
from sheetsplat.io.checks import checked_shape, sides, unreadable
from sheetsplat.io.records import Volume
from sheetsplat.io.source import Source


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
    if shape is None or dtype is None:
        missing = " and ".join(name for name, value in (("shape", shape), ("dtype", dtype)) if value is None)
        advice = "pass " + option_ref("shape", "...") + " and " + option_ref("dtype", "...")
        raise unreadable(
            source.path,
            f"raw samples without their {missing}",
            "both, for a file without a header",
            advice + "; for a PLOT3D solution, pass " + option_ref("grid", "..."),
        )
    kind = _dtype(dtype)
    sizes = checked_shape(source.path, shape, "shape")
    if len(sizes) != 3:
        raise unreadable(source.path, f"a shape of {len(sizes)} numbers", "three numbers", option="shape")
    if offset < 0:
        raise unreadable(source.path, f"an offset of {offset}", "at least 0 bytes", option="offset")
    count = math.prod(sizes)
    wanted = f"{count * kind.itemsize} bytes, {sides(sizes[::-1])} samples of {kind}"
    check = "check " + option_ref("shape") + " and " + option_ref("dtype")
    payload = source.payload("raw")
    payload.expect(wanted, check + ", or fetch the whole file")
    payload.skip(offset)
    values = payload.array(kind, count)
    if payload.surplus:
        more = "more" if source.packed else f"{source.path.stat().st_size - offset} bytes"
        found = f"{more} after the first {offset} bytes" if offset else f"{more} in the file"
        advice = check + "; for a file with a header, pass its length as " + option_ref("offset", "...")
        raise unreadable(source.path, found, wanted, advice)
    return Volume(values.reshape(sizes), format="raw")
