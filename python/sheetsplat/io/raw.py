"""Raw samples without a header."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from sheetsplat.errors import complain, option_ref
from sheetsplat.io.source import Source, checked_shape
from sheetsplat.io.volume import Volume


def read(source: Source, shape: tuple[int, int, int] | None, dtype: np.dtype[Any] | None, offset: int) -> Volume:
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
        f"{count * dtype.itemsize} bytes, {' x '.join(map(str, sizes[::-1]))} samples of {dtype}",
        "check " + option_ref("shape") + " and " + option_ref("dtype") + ", or fetch the whole file",
    )
    payload.skip(offset)
    values = payload.array(dtype, count)
    if payload.surplus():
        more = "more" if source.packed else f"{source.path.stat().st_size - offset} bytes"
        raise complain(
            f"{source.path} cannot be read",
            f"{more} after the first {offset} bytes" if offset else f"{more} in the file",
            f"{count * dtype.itemsize} bytes, {' x '.join(map(str, sizes[::-1]))} samples of {dtype}",
            "check "
            + option_ref("shape")
            + " and "
            + option_ref("dtype")
            + "; for a file with a header, pass its length as "
            + option_ref("offset", "..."),
        )
    return Volume(values.reshape(sizes), format="raw")
