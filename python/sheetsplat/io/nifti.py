"""NIfTI images, .nii and pairs .hdr and .img, of version 1 and 2.

nibabel reads the header. Samples are read here, because nibabel decompresses without a bound.
"""

from __future__ import annotations

import io
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat.io.axes import nearest_the_world
from sheetsplat.io.checks import beside, checked_shape, printable, sides, unreadable
from sheetsplat.io.records import Volume
from sheetsplat.io.source import Source
from sheetsplat.orientation import Orientation
from sheetsplat.quantity import Quantity

_UNITS = {1: "m", 2: "mm", 3: "µm"}
_HEADERS = 540


def _header(source: Source) -> tuple[Any, bool]:
    """Return the header, and whether the samples are in another file."""
    from nibabel import nifti1, nifti2  # type: ignore[import-not-found, import-untyped, unused-ignore]

    head = source.head(_HEADERS)
    kind: Any = nifti1.Nifti1Header if head[344:347] in (b"n+1", b"ni1") else nifti2.Nifti2Header
    apart = b"ni1\0" in head[344:348] or b"ni2\0" in head[4:8]
    return kind.from_fileobj(io.BytesIO(head), check=False), apart


def _scaled(source: Source, values: NDArray[Any], slope: float, inter: float) -> NDArray[Any]:
    """Return the samples as the header scales them; as they are where it does not."""
    if not math.isfinite(slope) or slope == 0 or (slope, inter) == (1, 0):
        return values
    if not math.isfinite(inter):
        raise unreadable(source.path, f"scl_inter = {inter}", "a finite number")
    kind = np.float32 if values.dtype.itemsize <= 2 or values.dtype == np.float32 else np.float64
    _memory.require(values.size * np.dtype(kind).itemsize, f"the scaled samples of {source.path}")
    scaled: NDArray[Any] = values.astype(kind)
    np.multiply(scaled, kind(slope), out=scaled)
    np.add(scaled, kind(inter), out=scaled)
    return scaled


def read(source: Source) -> Volume:
    """Read an image with three axes, those of size 1 aside; its samples are scaled as its header says.

    World axes run to the right, the front and the head of a body. An image that is turned against them keeps its own
    axes, those nearest to them, and the orientation says where the head is.

    Raises InvalidInput for other numbers of axes, samples that are no real numbers, and axes that are not at right
    angles.
    """
    path = source.path
    header, apart = _header(source)
    sizes = checked_shape(path, header["dim"][1 : 1 + min(max(int(header["dim"][0]), 0), 7)], "dim")
    shape = [*(size for size in sizes[:3]), *(size for size in sizes[3:] if size > 1)]
    if len(shape) != 3:
        advice = "choose one time step or channel, for example with nibabel: image.slicer[..., 0]"
        raise unreadable(path, f"{len(shape)} axes, sizes {sides(sizes)}", "three axes", advice if shape[3:] else "")
    try:
        dtype = np.dtype(header.get_data_dtype())
    except Exception as error:
        raise unreadable(path, f"samples of type {int(header['datatype'])}", "real numbers") from error
    if dtype.kind not in "iuf" or dtype.itemsize > 8:
        raise unreadable(path, f"samples of type {dtype}", "integers or real floating-point numbers")
    start = 0 if apart else float(header["vox_offset"])
    if not 0 <= start <= 2**40:
        raise unreadable(path, f"vox_offset = {start}", "a number of bytes")
    if apart:
        flat = _apart(source, dtype, math.prod(shape))
    else:
        flat = source.samples(dtype, math.prod(shape), 0, skip=int(start))
    values = _scaled(source, flat, float(header["scl_slope"]), float(header["scl_inter"]))
    affine = np.asarray(header.get_best_affine(), dtype=np.float64)
    known = int(header["sform_code"]) > 0 or int(header["qform_code"]) > 0
    body = Orientation.anatomical("right", "anterior", "superior") if known else None
    placed = nearest_the_world(path, "the affine", affine[:3, :3].T, affine[:3, 3], values.reshape(shape[::-1]), body)
    units = _UNITS.get(int(header["xyzt_units"]) & 7, "")
    text = printable(bytes(header["descrip"]).split(b"\0")[0])
    details = ({"content": text} if text else {}) | placed.details
    return Volume(
        placed.values, placed.spacing, placed.origin, "nifti", details, Quantity(length_unit=units), placed.orientation
    )


def _apart(source: Source, dtype: np.dtype[Any], count: int) -> NDArray[Any]:
    """Return the samples of the .img file beside a .hdr file, which may be gzipped."""
    name = source.path.name.removesuffix(".gz")
    stem = name[: -len(".hdr")] if name.lower().endswith(".hdr") else name
    plain, packed = (beside(source.path, stem + suffix) for suffix in (".img", ".img.gz"))
    with Source(packed if packed.exists() and not plain.exists() else plain) as samples:
        return samples.payload("raw").array(dtype, count)
