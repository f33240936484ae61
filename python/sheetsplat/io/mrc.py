"""MRC volumes of electron microscopy (MRC2014).

mrcfile knows the header. Samples are read here, because mrcfile decompresses without a bound.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from sheetsplat import notices
from sheetsplat._checks import shown, triple
from sheetsplat.io.checks import checked_shape, floats, printable, unreadable
from sheetsplat.io.records import Floats, Volume
from sheetsplat.io.source import Source
from sheetsplat.quantity import Quantity

_STACKS = 401
_HEADER = 1024
_ANGLES = ("alpha", "beta", "gamma")


def read(source: Source) -> Volume:
    """Read a volume; columns, rows and sections are put along x, y and z as the header says. Lengths are in ångström.

    Raises InvalidInput for stacks of volumes, complex samples, and headers that do not fit the file.
    """
    import mrcfile.dtypes  # type: ignore[import-not-found, import-untyped, unused-ignore]
    import mrcfile.utils  # type: ignore[import-not-found, import-untyped, unused-ignore]

    path = source.path
    head = source.head(_HEADER)
    if len(head) < _HEADER:
        raise unreadable(path, f"{len(head)} bytes", f"a header of {_HEADER} bytes")
    order = mrcfile.utils.byte_order_from_machine_stamp(np.frombuffer(head[212:216], np.uint8))
    header = np.frombuffer(head, mrcfile.dtypes.HEADER_DTYPE.newbyteorder(order))[0]
    sizes = checked_shape(path, [header["nz"], header["ny"], header["nx"]], "sizes")
    if int(header["ispg"]) >= _STACKS and int(header["mz"]) not in (0, sizes[0]):
        advice = "choose one volume, for example with mrcfile: data[0]"
        raise unreadable(path, f"a stack of {sizes[0] // max(int(header['mz']), 1)} volumes", "one volume", advice)
    dtype = np.dtype(mrcfile.utils.dtype_from_mode(int(header["mode"]))).newbyteorder(order)
    if dtype.kind not in "iuf":
        raise unreadable(path, f"samples of type {dtype}", "integers or real floating-point numbers")
    skip = int(header["nsymbt"])
    if skip < 0:
        raise unreadable(path, f"an extended header of {skip} bytes", "a number that is not negative")
    values = source.samples(dtype, math.prod(sizes), 0, skip=_HEADER + skip).reshape(sizes)
    # By axes of the cell: x, y, z.
    lengths = np.array([header["cella"][axis] for axis in "xyz"], dtype=np.float64)
    samples = np.array([header[name] for name in ("mx", "my", "mz")], dtype=np.float64)
    known = bool(np.all(np.isfinite(lengths)) and np.all(lengths > 0) and np.all(samples > 0))
    steps = _cell(path, header, lengths) / samples[:, None] if known else np.eye(3)
    axes = [int(header[name]) - 1 for name in ("mapc", "mapr", "maps")]
    if axes == [-1, -1, -1]:
        axes = [0, 1, 2]
    if sorted(axes) != [0, 1, 2]:
        raise unreadable(path, f"axes {[axis + 1 for axis in axes]} of columns, rows, sections", "1, 2, 3 in any order")
    starts = np.array([header[name] for name in ("nxstart", "nystart", "nzstart")], dtype=np.float64)
    origin = np.array(floats(path, "origin", [header["origin"][axis] for axis in "xyz"], 3))
    if not origin.any():
        # Older files place the first sample by its number.
        origin = starts @ steps[axes]
    elif starts.any():
        # Of two that may add up or say the same the newer one counts.
        notices.warn(f"{path}: NXSTART, NYSTART, NZSTART = {shown(starts.tolist())} are not used beside ORIGIN")
    label = printable(bytes(header["label"][0]).rstrip(b"\0 ")) if int(header["nlabl"]) > 0 else ""
    return Volume(
        values,
        origin=triple("origin", origin),
        format="mrc",
        details={"content": label} if label else {},
        quantity=Quantity("density", "", "Å" if known else ""),
        axes=steps[axes],
    )


def _cell(path: Path, header: Any, lengths: Floats) -> Floats:
    """Return the edges a, b, c of the cell as rows: a along x, b in the plane of x and y; angles of 0 are not known."""
    angles = np.array(floats(path, "angles of the cell", [header["cellb"][name] for name in _ANGLES], 3))
    if not angles.any():
        angles[:] = 90.0
    # Sines and cosines of right angles are those of right angles.
    cosines = np.where(angles == 90.0, 0.0, np.cos(np.radians(angles)))
    (cos_a, cos_b, cos_c), sin_c = cosines, math.sqrt(max(0.0, 1.0 - cosines[2] ** 2))
    y = (cos_a - cos_b * cos_c) / sin_c if sin_c > 0 else math.inf
    height = 1.0 - cos_b**2 - y**2
    if not (np.all((angles > 0) & (angles < 180)) and height > 0):
        raise unreadable(
            path, f"angles {shown(angles.tolist())} of a cell", "three angles that close a cell, in degrees"
        )
    found: Floats = np.array([[1.0, 0.0, 0.0], [cos_c, sin_c, 0.0], [cos_b, y, math.sqrt(height)]]) * lengths[:, None]
    return found
