"""TIFF stacks: the pages of a file, or one slice a file in a folder.

Pages are unpacked by tifffile after checks: by itself it read 81 of 240 damaged files that are refused here, some of
them as no pages. In a child 64 MB would take 0.15 s in place of 0.03 s.
"""

from __future__ import annotations

import html
import itertools
import math
import re
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory, notices
from sheetsplat._checks import shown, triple
from sheetsplat.errors import Unsupported, complain, option_ref
from sheetsplat.io.channels import chosen_channels, color_of, window_of
from sheetsplat.io.checks import (
    checked_shape,
    chosen_step,
    floats,
    natural,
    printable,
    sides,
    unreadable,
)
from sheetsplat.io.records import Channel, Volume
from sheetsplat.io.source import DEFLATE_RATIO, Folder, Source

_MOST_PAGES = 100_000
# Compressions of TIFF, and by how much each can shrink data: 4096 bytes to 12 bits, 128 bytes to two bytes.
_RATIOS = {1: 1, 5: 2731, 8: DEFLATE_RATIO, 32946: DEFLATE_RATIO, 32773: 64}
_DEFLATE = (8, 32946)
_SLACK = 4096
# Axes of a page: rows, columns, and samples of a pixel; the interpretation of these as colours.
_PAGES, _RGB = ("YX", "YXS", "SYX"), 2
# What a fourth sample is where it multiplies the others.
_ASSOCIATED = 1
# The first element Pixels of OME, one of its attributes, its channels, and the number of a colour.
_PIXELS = re.compile(r"<(?:\w{1,20}:)?Pixels\s([^>]{0,4000})>")
_ATTRIBUTE = re.compile(r"""(\w{1,40})\s?=\s?["']([^"']{0,60})["']""")
_CHANNEL = re.compile(r"<(?:\w{1,20}:)?Channel\s([^>]{0,1000})>")
_WHOLE = re.compile(r"-?\d{1,10}")
# Tags of GeoTIFF about places on the earth.
_GEO = {33550: "ModelPixelScaleTag", 33922: "ModelTiepointTag", 34264: "ModelTransformationTag"}


def _check_page(path: Path, number: int, page: Any) -> None:
    """Raise InvalidInput unless a page has real numbers, stored as its header says."""
    where = f"page {number} of {page.shape}, {page.dtype}"
    if page.axes not in _PAGES or page.dtype is None or page.dtype.kind not in "biuf":
        found = f"{where}, {page.samplesperpixel} samples a pixel"
        raise unreadable(path, found, "one real number a pixel, or several, of colours or channels")
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


def _pages(
    path: Path, stream: Any, name: str | None, step: int | None
) -> tuple[list[tuple[Channel, NDArray[Any]]], Any]:
    """Return the pages of each channel at one time step, and what was written about them.

    They are [page, row, column], of colours [page, row, column, component].
    """
    import tifffile  # type: ignore[import-not-found, unused-ignore]

    # OME-TIFF may name other files, which are not opened: its pages are those of this file.
    with tifffile.TiffFile(stream, name=path.name, is_ome=False, is_shaped=False) as file:
        count = len(file.pages)
        if not 0 < count <= _MOST_PAGES:
            raise unreadable(path, f"{count} pages", f"1 to {_MOST_PAGES}")
        first = file.pages.first
        _check_page(path, 0, first)
        told = _told(file)
        planes = told["imagej"].get("images", 1) if count == 1 else count
        chosen = _chosen_pages(path, told, planes if isinstance(planes, int) else 1, name, step)
        if isinstance(planes, int) and planes > count:
            # ImageJ writes one header for stacks of more than 4 GB.
            stacks = [(channel, _bare_stack(path, stream, first, pages)) for channel, pages in chosen]
        else:
            _memory.require(2 * sum(len(pages) for _, pages in chosen) * first.nbytes, f"the pages of {path}")
            stacks = [(channel, _stack(path, file, pages)) for channel, pages in chosen]
    if "S" not in first.axes:
        return stacks, told
    (alone,) = [np.moveaxis(values, first.axes.index("S") + 1, 3) for _, values in stacks]
    if told["colored"]:
        return [(stacks[0][0], _straight(path, alone) if told["associated"] else alone)], told
    channels = chosen_channels(path, alone.shape[3], told["channels"], name)
    return [(channel, alone[..., at]) for at, channel in channels.items()], told


def _straight(path: Path, values: NDArray[Any]) -> NDArray[Any]:
    """Return colours that are multiplied by their opacity without this factor."""
    _memory.require(5 * values.size, f"the colours of {path}")
    made, full = values.copy(), np.iinfo(values.dtype).max
    for page in made:
        opacity = np.maximum(page[..., 3:].astype(np.float32), 1.0)
        page[..., :3] = np.minimum(np.rint(page[..., :3] * (full / opacity)), full)
    return made


def _stack(path: Path, file: Any, numbers: list[int]) -> NDArray[Any]:
    """Return some pages of a file, all of the size and type of its first one."""
    first = file.pages.first
    values: NDArray[Any] = np.empty((len(numbers), *first.shape), first.dtype)
    for at, number in enumerate(numbers):
        page = file.pages[number].aspage() if number else first
        if (page.shape, page.dtype, page.axes) != (first.shape, first.dtype, first.axes):
            found = f"page {number} of {page.shape}, {page.dtype}"
            advice = "leave out pages such as previews, or other resolutions"
            raise unreadable(path, found, f"{first.shape}, {first.dtype}, as page 0 has", advice)
        _check_page(path, number, page)
        _check_segments(path, page, file.filehandle)
        values[at] = page.asarray()
    return values


def _told(file: Any) -> dict[str, Any]:
    """Return what a file says about its pages."""
    first = file.pages.first
    text = str(first.description or "")[:100_000]
    found = _PIXELS.search(text) if "<OME" in text else None
    imagej = dict(file.imagej_metadata or {})
    return {
        "imagej": imagej,
        "ome": _attributes(found[1]) if found else {},
        "channels": list(map(_ome_channel, _CHANNEL.findall(text))) if found else _imagej_channels(imagej),
        "samples": first.samplesperpixel,
        "colored": first.samplesperpixel in (3, 4) and int(first.photometric) == _RGB and first.dtype.kind == "u",
        "associated": first.samplesperpixel == 4 and _ASSOCIATED in tuple(map(int, first.extrasamples or ())),
        "resolution": [_ratio(first, name) for name in ("XResolution", "YResolution")],
        "unit": int(first.tags.valueof("ResolutionUnit", 1)),
        "geo": {name: first.tags.valueof(code) for code, name in _GEO.items() if code in first.tags},
    }


def _attributes(element: str) -> dict[str, str]:
    return {key: html.unescape(value) for key, value in _ATTRIBUTE.findall(element)}


def _ome_channel(element: str) -> Channel:
    """Return a channel of OME, whose colour is a signed number of red, green, blue and opacity."""
    told = _attributes(element)
    color = told.get("Color", "")
    digits = f"{int(color) & 0xFFFFFFFF:08x}"[:6] if _WHOLE.fullmatch(color) else None
    return Channel(printable(told.get("Name")), color_of(digits))


def _imagej_channels(imagej: Mapping[str, Any]) -> list[Channel]:
    """Return the channels of a stack of ImageJ: their colour is the last one of their table, unless all are grey."""
    tables, ranges = imagej.get("LUTs"), imagej.get("Ranges")
    tables = [] if imagej.get("mode") == "grayscale" or not isinstance(tables, list) else tables
    colors = [color_of((np.asarray(one)[:, -1] / 255.0).tolist()) for one in tables if np.ndim(one) == 2]
    limits = ranges if isinstance(ranges, tuple) else ()
    windows = [window_of(*limits[at : at + 2]) for at in range(0, len(limits) - 1, 2)]
    return [Channel("", color, window) for color, window in itertools.zip_longest(colors, windows)]


def _axes(path: Path, told: Any, pages: int) -> dict[str, int]:
    """Return the numbers of slices, channels and time steps as Z, C and T; that of the fastest among pages comes first.

    Stacks of ImageJ whose slices are called frames or channels are common: a single axis is that of slices.
    """
    ome, imagej = told["ome"], told["imagej"]
    stated = {"C": "channels", "Z": "slices", "T": "frames"}
    if ome:
        order = [axis for axis in ome.get("DimensionOrder", "XYZCT")[2:] if axis in "ZCT"]
        sizes = {axis: natural(path, f"Size{axis}", ome.get(f"Size{axis}", "1")) for axis in order}
        if told["samples"] > 1 and sizes.get("C", 1) % told["samples"] == 0:
            # Those of one pixel are counted as channels.
            sizes["C"] = sizes.get("C", 1) // told["samples"]
    else:
        sizes = {axis: imagej[name] if isinstance(imagej.get(name), int) else 1 for axis, name in stated.items()}
        if sum(count > 1 for count in sizes.values()) < 2:
            return {"Z": pages}
    if all(sizes.get(axis, 1) == 1 for axis in "CT"):
        return {"Z": pages}
    if math.prod(sizes.values()) != pages:
        found = " and ".join(f"{count} of axis {axis}" for axis, count in sizes.items())
        raise unreadable(path, f"{pages} pages for {found}", "as many pages as there are of all axes together",
                         "put all pages into one file")  # fmt: skip
    return sizes


def _chosen_pages(
    path: Path, told: Any, pages: int, name: str | None, step: int | None
) -> list[tuple[Channel, list[int]]]:
    """Return the numbers of the pages of one time step, of each channel."""
    sizes = _axes(path, told, pages)
    if sizes.get("Z", 1) == 1 and pages > 1:
        found = " and ".join(f"{count} of axis {axis}" for axis, count in sizes.items()) + ": one slice each"
        advice = "to show them as slices, pass tifffile.imread(path)"
        raise unreadable(path, found, "several slices, of a volume", advice)
    channels, mixed = sizes.get("C", 1), told["samples"] > 1
    if channels > 1 and mixed:
        found = f"{channels} channels of {told['samples']} samples a pixel"
        raise unreadable(path, found, "channels in pages, or in the samples of a pixel")
    at = chosen_step(path, sizes.get("T", 1), step)
    # Of samples of a pixel the channel is chosen after these are read.
    known = chosen_channels(path, channels, told["channels"], None if mixed and not told["colored"] else name)
    strides, stride = {}, 1
    for axis, count in sizes.items():
        strides[axis], stride = stride, stride * count
    first, between = at * strides.get("T", 0), strides.get("Z", 1)
    return [
        (channel, [first + one * strides.get("C", 0) + slice_ * between for slice_ in range(sizes.get("Z", 1))])
        for one, channel in known.items()
    ]


def _bare_stack(path: Path, stream: Any, page: Any, chosen: list[int]) -> NDArray[Any]:
    shape = checked_shape(path, (len(chosen), *page.shape), "the size of the stack")
    dtype = np.dtype(page.dtype).newbyteorder(page.parent.byteorder)
    if int(page.compression) != 1:
        raise unreadable(path, "a packed stack with one header", "one header a page")
    _memory.require(math.prod(shape) * dtype.itemsize, f"the pages of {path}")
    size = math.prod(page.shape) * dtype.itemsize
    pieces = []
    for number in chosen:
        stream.seek(page.dataoffsets[0] + number * size)
        pieces.append(stream.read(size))
        if len(pieces[-1]) < size:
            raise unreadable(path, f"{len(pieces[-1])} bytes of page {number}", f"{size}, as its header says")
    return np.frombuffer(b"".join(pieces), dtype).reshape(shape)


def _ratio(page: Any, name: str) -> float:
    value = page.tags.valueof(name)
    try:
        over, under = value
        return float(over) / float(under)
    except (TypeError, ValueError, ZeroDivisionError):
        return 0.0


def _placement(path: Path, told: Any) -> dict[str, Any]:
    """Return the fields of a volume that say where its samples lie, from what OME or ImageJ wrote."""
    ome, imagej = told["ome"], told["imagej"]
    if told["geo"]:
        text = "; ".join(f"{name} = {shown(value)}" for name, value in told["geo"].items())
        notices.warn(f"{path}: {text} do not place the pages; pass " + option_ref("spacing", "...")
                     + " and " + option_ref("origin", "..."))  # fmt: skip
    if ome:
        stated = [ome.get(f"PhysicalSize{axis}") for axis in "XYZ"]
        if stated[0] is None or stated[1] is None:
            return {}
        steps = floats(path, "PhysicalSize", [*stated[:2], stated[0] if stated[2] is None else stated[2]], 3)
        if min(steps) <= 0:
            raise unreadable(path, f"PhysicalSize {steps}", "numbers above 0")
        units = [printable(ome.get(f"PhysicalSize{axis}Unit", "µm")) for axis in "XYZ"]
        return {"spacing": triple("spacing", steps), "units": (*units[:2], units[0] if stated[2] is None else units[2])}
    if not imagej:
        # Resolutions of 72 dots an inch are no distance of samples.
        return {}
    x, y = (one if math.isfinite(one) and one > 0 else 1.0 for one in told["resolution"])
    unit = printable(imagej.get("unit")) or {2: "inch", 3: "cm"}.get(told["unit"], "")
    # What the places of coordinates are is said in samples.
    gap, *first = (_number(imagej.get(name)) for name in ("spacing", "xorigin", "yorigin", "zorigin"))
    steps = [1.0 / x, 1.0 / y, abs(gap) or 1.0 / x]
    return {
        "spacing": triple("spacing", steps),
        "origin": triple("origin", [0.0 - at * step for at, step in zip(first, steps, strict=True)]),
        "units": (unit, *(printable(imagej.get(name)) or unit for name in ("yunit", "zunit"))),
    }


def _number(told: object) -> float:
    """Return a finite number; 0 for anything else."""
    return float(told) if isinstance(told, int | float) and math.isfinite(told) else 0.0


def count_steps(source: Source | Folder, name: str | None = None) -> int:
    """Return the number of time steps."""
    import tifffile  # type: ignore[import-not-found, unused-ignore]

    if isinstance(source, Folder):
        return 1
    source.stream.seek(0)
    with tifffile.TiffFile(source.stream, name=source.path.name, is_ome=False, is_shaped=False) as file:
        told, count = _told(file), len(file.pages)
        planes = told["imagej"].get("images", 1) if count == 1 else count
        return _axes(source.path, told, planes if isinstance(planes, int) else 1).get("T", 1)


def read(source: Source | Folder, name: str | None = None, step: int | None = None) -> list[Volume]:
    """Read a stack: the pages are slices along z, the first row lies at the least y.

    Spacing and units are those that OME or ImageJ wrote. In a folder the files are taken by their names, slice2 before
    slice10, and each has one page.

    Parameters
    ----------
    source
    name
        The channel, by label or number; all are read unless it is given.
    step
        One of several time steps, from 0 on.

    Raises
    ------
    InvalidInput
        For pages of different sizes or types, several time steps of which none is chosen, and pages that unpack to more
        than their size says.
    Unsupported
        For compressions beside deflate, LZW and PackBits.
    """
    path = source.path
    if isinstance(source, Folder):
        stacks, told = _slices(source, name, step)
    else:
        source.stream.seek(0)
        stacks, told = _pages(path, source.stream, name, step)
        if stacks[0][1].shape[0] == 1:
            advice = "where each file is a slice, pass the folder"
            found = f"one page of {sides(stacks[0][1].shape[1:3])}"
            raise unreadable(path, found, "several: the slices of a volume", advice)
    place = _placement(path, told)
    return [Volume(values, format="tiff", channel=channel, **place) for channel, values in stacks]


def _slices(folder: Folder, name: str | None, step: int | None) -> tuple[list[tuple[Channel, NDArray[Any]]], Any]:
    files = [one for one in folder.files() if one.suffix.lower() in (".tif", ".tiff", ".gz")]
    stacks: list[tuple[Channel, NDArray[Any]]] = []
    told: Any = {}
    for number, file in enumerate(files):
        with Source(file) as source:
            source.stream.seek(0)
            pages, about = _pages(file, source.stream, name, step)
        if not stacks:
            told = about
            _memory.require(2 * len(files) * sum(page.nbytes for _, page in pages), f"the slices of {folder.path}")
            stacks = [(channel, np.empty((len(files), *page.shape[1:]), page.dtype)) for channel, page in pages]
        for (_, values), (_, page) in zip(stacks, pages if len(pages) == len(stacks) else [pages[0]], strict=False):
            if len(pages) != len(stacks) or page.shape != (1, *values.shape[1:]) or page.dtype != values.dtype:
                found = f"{file.name} with {page.shape[0]} pages of {page.shape[1:]}, {page.dtype}"
                wanted = f"one of {values.shape[1:]}, {values.dtype}: a file is a slice of the volume"
                advice = "of files that are volumes pass one, or all as a list to sheetsplat.animate"
                raise unreadable(folder.path, found, wanted, advice)
            values[number] = page[0]
    return stacks, told
