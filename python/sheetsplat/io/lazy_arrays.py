"""Arrays that other libraries read when they are asked for: those of dask, Zarr and h5py."""

from __future__ import annotations

import math
from pathlib import PurePosixPath
from typing import Any

import numpy as np

from sheetsplat import _memory
from sheetsplat.io.checks import printable, unreadable
from sheetsplat.io.records import Volume
from sheetsplat.quantity import Quantity


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


def read(data: Any, where: str) -> Volume:
    """Return an array with three axes, [k, j, i], as a volume; what the array is called becomes the quantity's name."""
    require_volume(where, data.shape, data.dtype)
    values = data.compute() if hasattr(data, "compute") else data[()]
    # Names that dask makes up say nothing.
    name = PurePosixPath(str(getattr(data, "name", None) or "")).name if not hasattr(data, "compute") else ""
    quantity = Quantity(printable(name))
    return Volume(np.asarray(values), format=type(data).__module__.partition(".")[0], quantity=quantity)
