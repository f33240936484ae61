"""NIfTI images, .nii and pairs .hdr and .img, of version 1 and 2.

nibabel reads the header. Samples are read here, because nibabel decompresses without a bound.
"""

from __future__ import annotations

import io
import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import triple
from sheetsplat.io.channels import chosen_channels
from sheetsplat.io.checks import beside, checked_shape, chosen_step, printable, sides, unreadable
from sheetsplat.io.records import Packing, Volume
from sheetsplat.io.source import Source
from sheetsplat.orientation import Orientation
from sheetsplat.quantity import Quantity

_UNITS = {1: "m", 2: "mm", 3: "µm"}
_HEADERS = 540
# Types of samples RGB24 and RGBA32, and the intent of labels.
_COLORS = (128, 2304)
_LABELS = 1002


def _header(source: Source) -> tuple[Any, bool]:
    """Return the header, and whether the samples are in another file."""
    from nibabel import nifti1, nifti2  # type: ignore[import-not-found, import-untyped, unused-ignore]

    head = source.head(_HEADERS)
    kind: Any = nifti1.Nifti1Header if head[344:347] in (b"n+1", b"ni1") else nifti2.Nifti2Header
    apart = b"ni1\0" in head[344:348] or b"ni2\0" in head[4:8]
    return kind.from_fileobj(io.BytesIO(head), check=False), apart


def _packing(source: Source, header: Any) -> Packing:
    """Return how the header scales samples; a slope of 0, or none, means not at all."""
    slope, inter = float(header["scl_slope"]), float(header["scl_inter"])
    if not math.isfinite(slope) or slope == 0:
        return Packing()
    if not math.isfinite(inter):
        raise unreadable(source.path, f"scl_inter = {inter}", "a finite number")
    return Packing(slope, inter)


def _sizes(source: Source, header: Any) -> tuple[list[int], int, int]:
    """Return the three sizes of a volume, the number of time steps, and that of components."""
    sizes = checked_shape(source.path, header["dim"][1 : 1 + min(max(int(header["dim"][0]), 0), 7)], "dim")
    if len(sizes) < 3 or any(size > 1 for size in sizes[5:]):
        advice = "choose one component, for example with nibabel: image.slicer[..., 0]" if sizes[3:] else ""
        wanted = "three axes, and at most one of time and one of components"
        raise unreadable(source.path, f"{len(sizes)} axes, sizes {sides(sizes)}", wanted, advice)
    steps, components = (*sizes[3:5], 1, 1)[:2]
    return list(sizes[:3]), steps, components


def count_steps(source: Source, name: str | None = None) -> int:
    """Return the number of time steps."""
    return _sizes(source, _header(source)[0])[1]


def read(source: Source, name: str | None = None, step: int | None = None) -> list[Volume]:
    """Read the channels of an image, or the one of a number; its samples are scaled as its header says.

    A fourth axis is that of time, of which `step` takes one, a fifth that of channels. Colours (RGB24, RGBA32) are one
    volume. World axes run to the right, the front and the head of a body.

    Raises InvalidInput for other numbers of axes, several time steps without `step`, and samples that are neither real
    numbers nor colours.
    """
    path = source.path
    header, apart = _header(source)
    shape, steps, components = _sizes(source, header)
    number = chosen_step(path, steps, step)
    try:
        dtype = np.dtype(header.get_data_dtype())
    except Exception as error:
        raise unreadable(path, f"samples of type {int(header['datatype'])}", "real numbers") from error
    colored = int(header["datatype"]) in _COLORS
    if not colored and (dtype.kind not in "iuf" or dtype.itemsize > 8):
        raise unreadable(path, f"samples of type {dtype}", "integers or real floating-point numbers")
    parts = dtype.itemsize if colored else 1
    dtype = np.dtype(np.uint8) if colored else dtype
    count = math.prod(shape) * parts
    start = float(header["vox_offset"])
    if not 0 <= start <= 2**40 and not apart:
        raise unreadable(path, f"vox_offset = {start}", "a number of bytes")
    channels = chosen_channels(path, components, (), name)
    found = []
    for one in channels:
        before = (one * steps + number) * count * dtype.itemsize
        if apart:
            found.append(_apart(source, dtype, count, before))
        else:
            found.append(source.samples(dtype, count, 0, skip=int(start) + before))
    affine = np.asarray(header.get_best_affine(), dtype=np.float64)
    known = int(header["sform_code"]) > 0 or int(header["qform_code"]) > 0
    text = printable(bytes(header["descrip"]).split(b"\0")[0])
    volume = Volume(
        np.empty(0),
        origin=triple("origin", affine[:3, 3]),
        format="nifti",
        details={"content": text} if text else {},
        quantity=Quantity(length_unit=_UNITS.get(int(header["xyzt_units"]) & 7, "")),
        orientation=Orientation.anatomical("right", "anterior", "superior") if known else None,
        axes=affine[:3, :3].T,
        packing=Packing() if colored else _packing(source, header),
        labels=int(header["intent_code"]) == _LABELS,
    )
    sizes = (*shape[::-1], *((parts,) if colored else ()))
    return [
        replace(volume, values=flat.reshape(sizes), channel=channel)
        for flat, channel in zip(found, channels.values(), strict=True)
    ]


def _apart(source: Source, dtype: np.dtype[Any], count: int, skip: int) -> NDArray[Any]:
    """Return the samples of the .img file beside a .hdr file, which may be gzipped."""
    name = source.path.name.removesuffix(".gz")
    stem = name[: -len(".hdr")] if name.lower().endswith(".hdr") else name
    plain, packed = (beside(source.path, stem + suffix) for suffix in (".img", ".img.gz"))
    with Source(packed if packed.exists() and not plain.exists() else plain) as samples:
        found: NDArray[Any] = samples.samples(dtype, count, 0, skip=skip)
        return found
