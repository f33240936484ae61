"""TIFF stacks: the pages of a file, or one slice a file in a folder.

Pages are unpacked by tifffile after checks: by itself it read 81 of 240 damaged files that are refused here, some of
them as no pages. In a child 64 MB would take 0.15 s in place of 0.03 s.
"""

from __future__ import annotations

import math
import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import Triple, triple
from sheetsplat.errors import Unsupported, complain
from sheetsplat.io.checks import checked_shape, printable, sides, unreadable
from sheetsplat.io.records import Volume
from sheetsplat.io.source import DEFLATE_RATIO, Folder, Source
from sheetsplat.quantity import Quantity

_MOST_PAGES = 100_000
# Compressions of TIFF, and by how much each can shrink data: 4096 bytes to 12 bits, 128 bytes to two bytes.
_RATIOS = {1: 1, 5: 2731, 8: DEFLATE_RATIO, 32946: DEFLATE_RATIO, 32773: 64}
_DEFLATE = (8, 32946)
_SLACK = 4096
_PHYSICAL = re.compile(r'PhysicalSize([XYZ])="([0-9.eE+-]{1,40})"')
_UNIT = re.compile(r'PhysicalSize[XYZ]Unit="([^"]{1,20})"')
_IMAGEJ = ("channels", "slices", "frames")
_SIZE = re.compile(r'Size([CT])="([0-9]{1,9})"')


def _check_page(path: Path, number: int, page: Any) -> None:
    """Raise InvalidInput unless a page has one sample a pixel, stored as its header says."""
    where = f"page {number} of {page.shape}, {page.dtype}"
    if page.samplesperpixel != 1 or len(page.shape) != 2 or page.dtype is None or page.dtype.kind not in "biuf":
        advice = "choose one channel, or convert colours to grey"
        raise unreadable(path, f"{where}, {page.samplesperpixel} samples a pixel", "one real number a pixel", advice)
    checked_shape(path, page.shape, f"the size of page {number}")
    if int(page.compression) not in _RATIOS:
        name = getattr(page.compression, "name", page.compression)
        found, wanted = f"page {number} packed by {name}", "none, deflate, LZW or PackBits"
        raise complain(f"{path} cannot be read", found, wanted, "write it again with one of these", kind=Unsupported)
    parts = math.prod(page.chunked)
    if int(page.compression) != 1 and parts > len(page.dataoffsets):
        # Each missing part would be filled by itself.
        raise unreadable(path, f"{len(page.dataoffsets)} parts of page {number}", f"{parts}, as its size says")
    stored = sum(page.databytecounts)
    needed = math.prod(page.shape) * page.dtype.itemsize
    if page.bitspersample < 8:
        needed = math.prod(page.shape) * page.bitspersample // 8
    if needed > stored * _RATIOS[int(page.compression)] + _SLACK:
        raise unreadable(path, f"{stored} stored bytes of page {number}", f"{needed} bytes, as its size says")


def _check_segments(path: Path, page: Any, handle: Any) -> None:
    """Raise InvalidInput for a part of a page that unpacks to more than the page has."""
    most = math.prod(page.shape) * page.dtype.itemsize + _SLACK
    if int(page.compression) not in _DEFLATE:
        _memory.require(sum(page.databytecounts) * _RATIOS[int(page.compression)], f"a page of {path}")
        return
    if page.is_tiled:
        most += math.prod(page.tile) * page.dtype.itemsize
    for offset, count in zip(page.dataoffsets, page.databytecounts, strict=True):
        # What deflate may unpack to at most is looked at only where that would be much.
        if count * DEFLATE_RATIO <= max(most, _memory.available() // 4):
            continue
        handle.seek(offset)
        unpack = zlib.decompressobj()
        if len(unpack.decompress(handle.read(count), most)) >= most:
            raise unreadable(path, f"more than {most} bytes in a part of a page", "at most as many as the page has")


def _pages(path: Path, stream: Any) -> tuple[NDArray[Any], Any]:
    """Return the pages of a file as [page, row, column], and what was written about them."""
    import tifffile  # type: ignore[import-not-found, unused-ignore]

    # OME-TIFF may name other files, which are not opened: its pages are those of this file.
    with tifffile.TiffFile(stream, name=path.name, is_ome=False, is_shaped=False) as file:
        count = len(file.pages)
        if not 0 < count <= _MOST_PAGES:
            raise unreadable(path, f"{count} pages", f"1 to {_MOST_PAGES}")
        first = file.pages.first
        _check_page(path, 0, first)
        told: dict[str, Any] = {
            "imagej": dict(file.imagej_metadata or {}),
            "description": str(first.description or "")[:100_000],
            "resolution": [_ratio(first, name) for name in ("XResolution", "YResolution")],
            "unit": int(first.tags.valueof("ResolutionUnit", 1)),
        }
        planes = int(told["imagej"].get("images", 1)) if count == 1 else 1
        if planes > 1:
            # ImageJ writes one header for stacks of more than 4 GB.
            return _bare_stack(path, stream, first, planes), told
        _memory.require(2 * count * first.nbytes, f"the pages of {path}")
        values: NDArray[Any] = np.empty((count, *first.shape), first.dtype)
        for number in range(count):
            page = file.pages[number].aspage() if number else first
            if page.shape != first.shape or page.dtype != first.dtype:
                found = f"page {number} of {page.shape}, {page.dtype}"
                advice = "leave out pages such as previews, or other resolutions"
                raise unreadable(path, found, f"{first.shape}, {first.dtype}, as page 0 has", advice)
            _check_page(path, number, page)
            _check_segments(path, page, file.filehandle)
            values[number] = page.asarray()
        return values, told


def _bare_stack(path: Path, stream: Any, page: Any, planes: int) -> NDArray[Any]:
    checked_shape(path, (planes, *page.shape), "the size of the stack")
    dtype = np.dtype(page.dtype).newbyteorder(page.parent.byteorder)
    count = planes * math.prod(page.shape)
    stream.seek(page.dataoffsets[0])
    if int(page.compression) != 1:
        raise unreadable(path, "a packed stack with one header", "one header a page")
    _memory.require(count * dtype.itemsize, f"the pages of {path}")
    data = stream.read(count * dtype.itemsize)
    if len(data) < count * dtype.itemsize:
        raise unreadable(path, f"{len(data)} bytes of pages", f"{count * dtype.itemsize}, as its header says")
    return np.frombuffer(data, dtype).reshape(planes, *page.shape)


def _ratio(page: Any, name: str) -> float:
    value = page.tags.valueof(name)
    try:
        over, under = value
        return float(over) / float(under)
    except (TypeError, ValueError, ZeroDivisionError):
        return 0.0


def _placement(path: Path, told: Any) -> tuple[Triple, str]:
    """Return spacing and its unit from what OME or ImageJ wrote, or from the resolution alone; 1 and "" without."""
    text = told["description"]
    if "<OME" in text:
        channels = {name: int(count) for name, count in _SIZE.findall(text)}
        if any(count > 1 for count in channels.values()):
            found = " and ".join(f"{count} of axis {name}" for name, count in channels.items() if count > 1)
            raise unreadable(path, found, "one channel and one time step", "choose one of them")
        found_sizes = {axis: float(size) for axis, size in _PHYSICAL.findall(text)}
        units = set(_UNIT.findall(text)) or {"µm"}
        if {"X", "Y"} <= found_sizes.keys() and len(units) == 1 and all(size > 0 for size in found_sizes.values()):
            steps = found_sizes["X"], found_sizes["Y"], found_sizes.get("Z", found_sizes["X"])
            return triple("PhysicalSize", steps), printable(units.pop())
        return (1.0, 1.0, 1.0), ""
    imagej = told["imagej"]
    # Stacks whose slices are called frames or channels are common.
    several = [f"{imagej[name]} {name}" for name in _IMAGEJ if isinstance(imagej.get(name), int) and imagej[name] > 1]
    if len(several) > 1:
        raise unreadable(path, " and ".join(several), "slices of one channel and one time step", "choose one of them")
    x, y = told["resolution"]
    unit = printable(imagej.get("unit")) or {2: "inch", 3: "cm"}.get(told["unit"], "")
    gap = imagej.get("spacing")
    if not (imagej and math.isfinite(x) and math.isfinite(y) and x > 0 and y > 0 and unit):
        # Resolutions of 72 dots an inch are no distance of samples.
        return (1.0, 1.0, 1.0), ""
    z = float(gap) if isinstance(gap, int | float) and math.isfinite(gap) and gap != 0 else 1.0 / x
    unit = "µm" if unit.lower() in ("micron", "um", "\\u00b5m") else unit
    return triple("resolution", (1.0 / x, 1.0 / y, abs(z))), unit


def read(source: Source | Folder) -> Volume:
    """Read a stack: the pages are slices along z, the first row lies at the least y.

    Spacing and unit are those that OME or ImageJ wrote. In a folder the files are taken by their names, slice2 before
    slice10, and each has one page.

    Raises
    ------
    InvalidInput
        For pages of different sizes or types, colours, several channels or time steps, and pages that unpack to more
        than their size says.
    Unsupported
        For compressions beside deflate, LZW and PackBits.
    """
    path = source.path
    if isinstance(source, Folder):
        values, told = _slices(source)
    else:
        stream = source.stream
        stream.seek(0)
        values, told = _pages(path, stream)
    if 1 in values.shape[:1] and isinstance(source, Source):
        raise unreadable(path, f"one page of {sides(values.shape[1:])}", "several: the slices of a volume")
    spacing, unit = _placement(path, told)
    return Volume(values, spacing, format="tiff", quantity=Quantity(length_unit=unit))


def _slices(folder: Folder) -> tuple[NDArray[Any], Any]:
    files = [one for one in folder.files() if one.suffix.lower() in (".tif", ".tiff", ".gz")]
    values: NDArray[Any] | None = None
    told: Any = {}
    for number, file in enumerate(files):
        with Source(file) as source:
            source.stream.seek(0)
            page, about = _pages(file, source.stream)
        if values is None:
            told = about
            _memory.require(2 * len(files) * page.nbytes, f"the slices of {folder.path}")
            values = np.empty((len(files), *page.shape[1:]), page.dtype)
        if page.shape != (1, *values.shape[1:]) or page.dtype != values.dtype:
            found = f"{file.name} with {page.shape[0]} pages of {page.shape[1:]}, {page.dtype}"
            wanted = f"one of {values.shape[1:]}, {values.dtype}, as {files[0].name} has"
            raise unreadable(folder.path, found, wanted)
        values[number] = page[0]
    assert values is not None
    return values, told
