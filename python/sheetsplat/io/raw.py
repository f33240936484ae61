"""Raw samples without a header."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from sheetsplat.errors import complain, option_ref
from sheetsplat.io.checks import checked_shape
from sheetsplat.io.records import Volume
from sheetsplat.io.source import Source


def _dtype(value: DTypeLike) -> np.dtype[Any]:
    wanted = 'the name of a real type of NumPy: "uint8", "int16", ">i2", "float32" …'
    try:
        dtype = np.dtype(value)
    except TypeError:
        raise complain("the type of the samples cannot be used", repr(value), wanted) from None
    if dtype.kind not in "biuf":
        raise complain("the type of the samples cannot be used", str(dtype), wanted)
    return dtype


def read(
    source: Source, shape: tuple[int, int, int] | None = None, dtype: DTypeLike | None = None, offset: int = 0
) -> Volume:
    """Read samples of a given shape (nk, nj, ni) and type; the file must hold exactly these after `offset` bytes."""
    if shape is None or dtype is None:
        missing = " and ".join(name for name, value in (("shape", shape), ("dtype", dtype)) if value is None)
        raise complain(
            f"{source.path} cannot be read",
            f"raw samples without their {missing}",
            "both, for a file without a header",
            "pass "
            + option_ref("shape", "...")
            + " and "
            + option_ref("dtype", "...")
            + "; for a PLOT3D solution, pass "
            + option_ref("grid", "..."),
        )
    kind = _dtype(dtype)
    sizes = checked_shape(source.path, shape, "shape")
    if len(sizes) != 3:
        raise complain(
            f"{source.path} cannot be read", f"a shape of {len(sizes)} numbers", "three numbers", option="shape"
        )
    if offset < 0:
        raise complain(f"{source.path} cannot be read", f"an offset of {offset}", "at least 0 bytes", option="offset")
    count = math.prod(sizes)
    payload = source.payload("raw")
    payload.expect(
        f"{count * kind.itemsize} bytes, {' x '.join(map(str, sizes[::-1]))} samples of {kind}",
        "check " + option_ref("shape") + " and " + option_ref("dtype") + ", or fetch the whole file",
    )
    payload.skip(offset)
    values = payload.array(kind, count)
    if payload.surplus():
        more = "more" if source.packed else f"{source.path.stat().st_size - offset} bytes"
        raise complain(
            f"{source.path} cannot be read",
            f"{more} after the first {offset} bytes" if offset else f"{more} in the file",
            f"{count * kind.itemsize} bytes, {' x '.join(map(str, sizes[::-1]))} samples of {kind}",
            "check "
            + option_ref("shape")
            + " and "
            + option_ref("dtype")
            + "; for a file with a header, pass its length as "
            + option_ref("offset", "..."),
        )
    return Volume(values.reshape(sizes), format="raw")
