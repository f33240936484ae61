"""MRC volumes of electron microscopy (MRC2014).

mrcfile knows the header. Samples are read here, because mrcfile decompresses without a bound.
"""

from __future__ import annotations

import math

import numpy as np

from sheetsplat._checks import triple
from sheetsplat.io.axes import along_the_world
from sheetsplat.io.checks import checked_shape, floats, printable, unreadable
from sheetsplat.io.records import Volume
from sheetsplat.io.source import Source
from sheetsplat.quantity import Quantity

_STACKS = 401
_HEADER = 1024


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
    steps = lengths / samples if known else np.ones(3)
    axes = [int(header[name]) - 1 for name in ("mapc", "mapr", "maps")]
    if axes == [-1, -1, -1]:
        axes = [0, 1, 2]
    if sorted(axes) != [0, 1, 2]:
        raise unreadable(path, f"axes {[axis + 1 for axis in axes]} of columns, rows, sections", "1, 2, 3 in any order")
    starts = np.array([header[name] for name in ("nxstart", "nystart", "nzstart")], dtype=np.float64)
    origin = np.array(floats(path, "origin", [header["origin"][axis] for axis in "xyz"], 3))
    if not origin.any():
        # Older files place the first sample by its number.
        origin[axes] = starts * steps[axes]
    turned, spacing, first = along_the_world(
        path, "mapc, mapr, maps", np.eye(3)[axes] * steps[axes][:, None], origin, values
    )
    label = printable(bytes(header["label"][0]).rstrip(b"\0 ")) if int(header["nlabl"]) > 0 else ""
    return Volume(
        turned,
        spacing,
        triple("origin", first),
        "mrc",
        {"content": label} if label else {},
        Quantity("density", "", "Å" if known else ""),
    )
