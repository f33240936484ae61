"""Zarr and OME-Zarr in folders: an array with three axes, or the scale of a picture that fits into memory.

The metadata are read here before Zarr reads them: codecs that run code or unpack without a bound are refused, and so
are links out of the folder.
"""

from __future__ import annotations

import itertools
import json
import math
import os
import stat
import struct
import zlib
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sheetsplat import _memory
from sheetsplat._checks import Triple, shown, triple
from sheetsplat.errors import Error, InvalidInput, Unsupported, complain, option_ref
from sheetsplat.io.checks import checked_shape, chosen_step, floats, listed, printable, unreadable
from sheetsplat.io.records import Volume
from sheetsplat.io.source import DEFLATE_RATIO, Folder, guarded
from sheetsplat.quantity import Quantity

_LONGEST_METADATA = 1 << 20
_METADATA = (".zarray", ".zattrs", ".zgroup", ".zmetadata", "zarr.json")
_MOST_FILES = 1_000_000
_SLACK = 4096
# Filters that neither run code nor change sizes by much.
_PLAIN = ("bytes", "endian", "transpose", "crc32c", "crc32", "shuffle", "delta", "bitround", "fixedscaleoffset",
          "adler32", "fletcher32")  # fmt: skip
# Compressors whose data say how long they are unpacked, and those with a known ratio.
_PACKED = ("blosc", "zstd", "lz4", "zlib", "gzip")
# Several chunks in a file.
_SHARDS = "sharding_indexed"
_UNITS = {"micrometer": "µm", "nanometer": "nm", "millimeter": "mm", "meter": "m", "angstrom": "Å"}
# Of the memory that is available, the share that the samples of a picture may take: they are copied and prefiltered.
_SHARE = 0.2


@dataclass(frozen=True)
class Located:
    """An array of a Zarr folder as a volume, of which nothing is read yet.

    Attributes
    ----------
    path
        The folder of the array.
    index
        For each of its axes a number, or slice(None) along z, y and x.
    order
        Which of the axes with slice(None) runs along z, y, x.
    shape, dtype
        (nk, nj, ni), and the type of the samples as stored.
    spacing, origin, format, details, quantity
        Those of `Volume`.
    """

    path: Path
    index: tuple[Any, ...]
    order: tuple[int, ...]
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    spacing: Triple = (1.0, 1.0, 1.0)
    origin: Triple = (0.0, 0.0, 0.0)
    format: str = "zarr"
    details: dict[str, str] = field(default_factory=dict)
    quantity: Quantity = Quantity()

    def volume(self) -> Volume:
        """Return the volume with all its samples, after all checks."""
        values = _read_array(self.path, self.index).transpose(self.order)
        return Volume(values, self.spacing, self.origin, self.format, self.details, self.quantity)

    def part(self, box: tuple[tuple[int, int], ...]) -> Any:
        """Return the samples of a box, ((k0, k1), (j0, j1), (i0, i1)), after checks of the chunks that hold them."""
        cuts = [slice(None)] * 3
        for axis, (first, last) in zip(self.order, box, strict=True):
            cuts[axis] = slice(first, last)
        rest = iter(cuts)
        index = tuple(next(rest) if one == slice(None) else one for one in self.index)
        return _read_array(self.path, index).transpose(self.order)


def _metadata(path: Path, name: str) -> dict[str, Any]:
    file = path / name
    if not file.is_file() or file.is_symlink():
        return {}
    with file.open("rb") as stream:
        text = stream.read(_LONGEST_METADATA + 1)
    found = json.loads(text) if len(text) <= _LONGEST_METADATA else None
    if not isinstance(found, dict):
        raise unreadable(file, "metadata that are no object, or too long", "the metadata of a Zarr array or group")
    return found


def _attributes(path: Path) -> dict[str, Any]:
    newer = _metadata(path, "zarr.json").get("attributes")
    return newer if isinstance(newer, dict) else _metadata(path, ".zattrs")


def _is_array(path: Path) -> bool:
    return (path / ".zarray").is_file() or _metadata(path, "zarr.json").get("node_type") == "array"


def _below(root: Path, name: object) -> Path:
    """Return a folder inside of the root by its path; InvalidInput for others."""
    parts = str(name).strip("/").split("/")
    if not isinstance(name, str) or any(part in ("", ".", "..") or "\0" in part or "\\" in part for part in parts):
        raise unreadable(root, f"a path {shown(name)}", "the path of an array in this folder")
    return root.joinpath(*parts)


def _codecs(path: Path) -> list[tuple[str, Any]]:
    """Return the codecs of an array by name; InvalidInput for those that are not known."""
    older = _metadata(path, ".zarray")
    if older:
        listed_codecs = [*(older.get("filters") or []), *([older["compressor"]] if older.get("compressor") else [])]
        found = [(str(one.get("id", "")), one) for one in listed_codecs]
    else:
        found = [(str(one.get("name", "")), one) for one in _metadata(path, "zarr.json").get("codecs") or []]
    for name, _ in found:
        if name.removeprefix("numcodecs.") not in (*_PLAIN, *_PACKED):
            known = ", ".join((*_PACKED, *_PLAIN))
            advice = "open it with dask.array.from_zarr, and pass that array" if name == _SHARDS else ""
            what, wrong = f"{path} cannot be read", f"the codec {shown(name)}"
            raise complain(what, wrong, f"one of {known}", advice, kind=Unsupported)
    return found


def _unpacked_size(codec: str, stream: BinaryIO, most: int) -> int:
    """Return how long a chunk says that it unpacks to; of deflated ones how long it does, not beyond `most` + 1."""
    if codec in ("zlib", "gzip"):
        # Both headers are recognized.
        return len(zlib.decompressobj(47).decompress(stream.read(), most + 1))
    head = stream.read(18)
    if codec == "blosc":
        return int(struct.unpack_from("<I", head, 4)[0]) if len(head) >= 16 else 0
    if codec == "lz4":
        return int(struct.unpack_from("<I", head)[0]) if len(head) >= 4 else 0
    return _frame_size(head)


def _blosc_size(head: bytes) -> int:
    """Return how long a chunk of Blosc says that it is; its library reads so far, whatever there is."""
    return int(struct.unpack_from("<I", head, 12)[0]) if len(head) >= 16 else 16


def _frame_size(head: bytes) -> int:
    """Return the size that the header of a zstd frame states (RFC 8878, section 3.1.1.1); 2^62 where it does not."""
    if len(head) < 6 or head[:4] != b"\x28\xb5\x2f\xfd":
        return 0
    flags = head[4]
    single, width = flags & 0x20, (0, 2, 4, 8)[flags >> 6]
    if not width and single:
        width = 1
    at = 5 + (0 if single else 1) + (0, 1, 2, 4)[flags & 3]
    if not width or len(head) < at + width:
        return 2**62
    return int.from_bytes(head[at : at + width], "little") + (256 if width == 2 else 0)


@dataclass(frozen=True)
class _ChunkCheck:
    """What chunks of an array may hold: `most` bytes, packed by a codec or not."""

    path: Path
    packer: str
    most: int
    much: int

    @classmethod
    def of(cls, path: Path, chunk: int) -> _ChunkCheck:
        """Return the check of chunks of so many bytes; Unsupported for codecs that are not known."""
        packers = [name.removeprefix("numcodecs.") for name, _ in _codecs(path) if name not in _PLAIN]
        packer = packers[-1] if packers else ""
        most = 2 * chunk + _SLACK
        # What deflate may unpack to at most is looked at only where that would be much.
        return cls(path, packer, most, max(most, _memory.available() // 4))

    def check(self, where: str) -> None:
        """Raise InvalidInput for a file that unpacks to more than a chunk has."""
        size = self._regular(where)
        if size > self.most:
            raise self._wrong(where, f"of {size} bytes", f"at most {self.most}")
        if not self.packer or (self.packer in ("zlib", "gzip") and size * DEFLATE_RATIO <= self.much):
            return
        with open(where, "rb") as stream:
            if self.packer == "blosc" and (stated := _blosc_size(stream.read(16))) > size:
                raise self._wrong(where, f"of {size} bytes", f"{stated}, as its header says")
            stream.seek(0)
            found = _unpacked_size(self.packer, stream, self.most)
        if found > self.most:
            raise self._wrong(where, f"that unpacks to {found} bytes or more", f"at most {self.most}")

    def _regular(self, where: str) -> int:
        """Return the size of a file; InvalidInput for pipes and devices, which would be waited for."""
        found = os.stat(where)
        if not stat.S_ISREG(found.st_mode):
            raise unreadable(self.path, f"{where}, which is no regular file", "a file")
        return found.st_size

    def _wrong(self, where: str, found: str, wanted: str) -> Error:
        # Whoever reads a part of the array says what of it, not which file that is.
        return unreadable(self.path, f"a chunk {found}, {where}", wanted)

    def metadata(self) -> None:
        """Check what Zarr reads of the array beside its chunks."""
        for name in _METADATA:
            where = os.path.join(self.path, name)
            if os.path.lexists(where):
                self._regular(where)

    def all(self) -> None:
        """Check every file of the array; InvalidInput for links."""
        count = 0
        for folder, names, files in os.walk(self.path):
            for name in (*names, *files):
                count += 1
                if count > _MOST_FILES:
                    raise unreadable(self.path, f"more than {_MOST_FILES} files", "larger chunks")
                if os.path.islink(os.path.join(folder, name)):
                    raise self._link(name)
            for name in files:
                if name not in _METADATA:
                    self.check(os.path.join(folder, name))

    def these(self, keys: Iterable[str]) -> None:
        """Check the chunks of some keys, where they are there; InvalidInput for links."""
        root = os.path.realpath(self.path)
        for key in keys:
            where = os.path.join(root, *key.split("/"))
            if os.path.realpath(where) != where:
                raise self._link(key)
            if os.path.exists(where):
                self.check(where)

    def _link(self, name: str) -> Error:
        return unreadable(self.path, f"a link, {shown(name)}", "chunks in the folder itself")


def _chunk_keys(path: Path, ranges: Iterable[range]) -> Iterable[str]:
    """Return the keys of chunks by their numbers along each axis (specifications 2 and 3)."""
    older = _metadata(path, ".zarray")
    if older:
        start, between = "", older.get("dimension_separator", ".")
    else:
        stated = _metadata(path, "zarr.json").get("chunk_key_encoding") or {}
        is_default = stated.get("name", "default") == "default"
        start = "c" if is_default else ""
        between = (stated.get("configuration") or {}).get("separator", "/" if is_default else ".")
    if between not in (".", "/"):
        raise unreadable(path, f"the separator {shown(between)} of chunk keys", "a point or a slash")
    for numbers in itertools.product(*ranges):
        yield between.join(([start] if start else []) + [str(number) for number in numbers])


def _sizes(path: Path) -> tuple[tuple[int, ...], np.dtype[Any], tuple[int, ...]]:
    """Return shape, type and chunks of an array from its metadata."""
    older = _metadata(path, ".zarray")
    newer = _metadata(path, "zarr.json") if not older else {}
    if newer:
        kind, shape = newer.get("data_type"), newer.get("shape")
        grid = newer.get("chunk_grid") or {}
        chunks = (grid.get("configuration") or {}).get("chunk_shape")
    else:
        kind, shape, chunks = older.get("dtype"), older.get("shape"), older.get("chunks")
    try:
        dtype = np.dtype(kind) if isinstance(kind, str) else None
    except (TypeError, ValueError, SyntaxError):
        dtype = None
    if dtype is None or dtype.kind not in "biuf":
        raise unreadable(path, f"samples of type {shown(kind)}", "integers, booleans or real floating-point numbers")
    return checked_shape(path, shape, "shape"), dtype, checked_shape(path, chunks, "chunks")


def _read_array(path: Path, index: tuple[Any, ...]) -> Any:
    """Return a part of an array after all checks; of a part only those of the chunks that hold it."""
    import zarr  # type: ignore[import-not-found, unused-ignore]

    shape, dtype, chunks = _sizes(path)
    check = _ChunkCheck.of(path, math.prod(chunks) * dtype.itemsize)
    steps = [one.indices(size) if isinstance(one, slice) else (one, one + 1, 1)
             for one, size in zip(index, shape, strict=True)]  # fmt: skip
    # The chunks at the border of a part are read whole.
    _memory.require(
        2 * (math.prod(last - first for first, last, _ in steps) + math.prod(chunks)) * dtype.itemsize,
        f"the samples of {path}",
    )
    touched = [range(first // chunk, (last - 1) // chunk + 1)
               for (first, last, _), chunk in zip(steps, chunks, strict=True)]  # fmt: skip
    if any(isinstance(one, slice) and one != slice(None) for one in index):
        check.these(_chunk_keys(path, touched))
    else:
        check.all()
    check.metadata()
    store = zarr.storage.LocalStore(path, read_only=True)
    array = zarr.open_array(store=store, mode="r")
    try:
        return np.asarray(array[index])
    except (MemoryError, ImportError):
        raise
    except Exception:
        # Zarr does not say which one it was.
        for numbers, key in zip(itertools.product(*touched), _chunk_keys(path, touched), strict=True):
            places = zip(numbers, chunks, strict=True)
            try:
                with guarded(path):
                    array[tuple(slice(at * size, (at + 1) * size) for at, size in places)]
            except InvalidInput as error:
                raise unreadable(path, f"{error.found} in {path / key}", error.wanted, error.advice) from error
        raise


def _plain(path: Path) -> Located:
    """Return an array with three axes, those of size 1 aside."""
    shape, dtype, _ = _sizes(path)
    index = tuple(0 if size == 1 and number < len(shape) - 3 else slice(None) for number, size in enumerate(shape))
    axes = sum(one == slice(None) for one in index)
    if axes != 3:
        advice = "choose one channel or one time step" if axes > 3 else ""
        raise unreadable(path, f"{axes} axes, shape {shape}", "three axes, values[k, j, i]", advice)
    told = _attributes(path)
    label = printable(told.get("long_name")) or ("" if path.suffix == ".zarr" else printable(path.name))
    quantity = Quantity(label, printable(told.get("units")))
    sizes = tuple(size for size, one in zip(shape, index, strict=True) if one == slice(None))
    return Located(path, index, (0, 1, 2), sizes, dtype, details={"content": path.name}, quantity=quantity)


def _channel(path: Path, count: int, told: dict[str, Any], name: str | None) -> int:
    """Return the number of the channel that is asked for by label or number, else of the only one."""
    entries = (told.get("omero") or {}).get("channels") or []
    labels = [printable(one.get("label")) if isinstance(one, dict) else "" for one in entries]
    names = [labels[at] if at < len(labels) and labels[at] else str(at) for at in range(min(count, 1000))]
    if name is None and count == 1:
        return 0
    if name in names:
        return names.index(name)
    if name is not None and name.isascii() and name.isdigit() and len(name) < 9 and int(name) < count:
        return int(name)
    advice = "pass " + option_ref("name", "...") + ", its label or its number"
    found = f"{count} channels: {listed(names)}"
    raise unreadable(path, found, "one of them", advice, option="name")


def _image(source: Folder) -> tuple[Path, Any]:
    """Return a place, and its attributes where it is an OME-Zarr image, else {}."""
    root = _below(source.path, source.inner) if source.inner else source.path
    told = {} if _is_array(root) else _attributes(root)
    told = told.get("ome", told)
    is_image = isinstance(told, dict) and isinstance(told.get("multiscales"), list) and told["multiscales"]
    return root, told if is_image else {}


def count_steps(source: Folder, name: str | None = None) -> int:
    """Return the number of time steps of an OME-Zarr image, 1 for arrays."""
    root, told = _image(source)
    if not told:
        return 1
    image = told["multiscales"][0]
    axes = [str(one["name"] if isinstance(one, dict) else one).lower() for one in image["axes"]]
    shape, _, _ = _sizes(_below(root, image["datasets"][0]["path"]))
    times = [count for axis, count in zip(axes, shape, strict=False) if axis not in ("x", "y", "z", "c")]
    return times[0] if times else 1


def _multiscale(path: Path, told: dict[str, Any], name: str | None, step: int | None, limit: float) -> Located:
    """Return the finest scale of an OME-Zarr image whose samples take `limit` bytes (specification 0.4 and 0.5)."""
    count = len(told["multiscales"][0]["datasets"])
    for number in range(count):
        found = _scale(path, told, name, step, number)
        if found.dtype.itemsize * math.prod(found.shape) <= limit or number == count - 1:
            return found
    raise unreadable(path, "no scale", "at least one")


def _scale(path: Path, told: dict[str, Any], name: str | None, step: int | None, number: int) -> Located:
    """Return a scale of an OME-Zarr image."""
    image = told["multiscales"][0]
    axes = [str(one["name"] if isinstance(one, dict) else one).lower() for one in image["axes"]]
    units = [printable(one.get("unit")) if isinstance(one, dict) else "" for one in image["axes"]]
    levels = image["datasets"]
    if sorted(axes)[-3:] != ["x", "y", "z"] or len(axes) > 5 or len(set(axes)) != len(axes):
        raise unreadable(path, f"axes {', '.join(axes)}", "x, y and z, and at most a time and a channel")
    level = levels[number]
    place = _below(path, level["path"])
    shape, dtype, _ = _sizes(place)
    if len(shape) != len(axes):
        raise unreadable(place, f"shape {shape}", f"{len(axes)} axes, {', '.join(axes)}")
    index: list[Any] = []
    for axis, count in zip(axes, shape, strict=True):
        if axis in "xyz":
            index.append(slice(None))
        elif axis == "c":
            index.append(_channel(path, count, told, name))
        else:
            index.append(chosen_step(path, count, step))
    spatial = [axis for axis in axes if axis in "xyz"]
    steps, start = _transforms(path, axes, level, image)
    sizes = dict(zip(axes, shape, strict=True))
    same = {unit for axis, unit in zip(axes, units, strict=True) if axis in "xyz"}
    unit = same.pop() if len(same) == 1 else ""
    return Located(
        place,
        tuple(index),
        tuple(spatial.index(axis) for axis in "zyx"),
        tuple(sizes[axis] for axis in "zyx"),
        dtype,
        triple("scale", [steps[axis] for axis in "xyz"]),
        triple("translation", [start[axis] for axis in "xyz"]),
        "ome-zarr",
        {"scale": f"{number} of 0 to {len(levels) - 1}, {place.name}"},
        Quantity(length_unit=_UNITS.get(unit, unit)),
    )


def _transforms(path: Path, axes: list[str], level: Any, image: Any) -> tuple[dict[str, float], dict[str, float]]:
    steps, start = dict.fromkeys(axes, 1.0), dict.fromkeys(axes, 0.0)
    for one in (*(level.get("coordinateTransformations") or []), *(image.get("coordinateTransformations") or [])):
        kind = one.get("type")
        if kind not in ("scale", "translation"):
            continue
        numbers = floats(path, kind, one[kind], len(axes))
        if kind == "scale" and min(numbers) <= 0:
            raise unreadable(path, f"{kind} {shown(numbers)}", "numbers above 0")
        for axis, number in zip(axes, numbers, strict=True):
            if kind == "scale":
                steps[axis] *= number
                start[axis] *= number
            else:
                start[axis] += number
    return steps, start


def read(source: Folder, name: str | None = None, step: int | None = None) -> Volume:
    """Read an array of a Zarr folder, or an OME-Zarr image: the finest scale whose samples take a fifth of the memory.

    FOLDER:/array chooses an array of a group. Of an image `name` chooses the channel, by label or number, and `step`
    one of several times, from 0 on.

    Raises
    ------
    InvalidInput
        For groups with several arrays, other than three axes, several times without `step`, links, and chunks that
        unpack to more than their size.
    Unsupported
        For codecs that run code, or unpack without a bound.
    """
    return locate(source, name, step, _SHARE * _memory.available()).volume()


def locate(source: Folder, name: str | None = None, step: int | None = None, limit: float = math.inf) -> Located:
    """Return what `read` reads without its samples; of an OME-Zarr image the finest scale of at most `limit` bytes."""
    found = _located(source, name, step, limit)
    _codecs(found.path)
    return found


def _located(source: Folder, name: str | None, step: int | None, limit: float) -> Located:
    root, told = _image(source)
    if told:
        return _multiscale(root, told, name, step, limit)
    if step is not None:
        raise unreadable(root, option_ref("step") + " for an array", "it for images (OME-Zarr)", option="step")
    if _is_array(root):
        if name is not None:
            wanted = "it for groups and images"
            raise unreadable(root, option_ref("name") + " for a single array", wanted, option="name")
        return _plain(root)
    if name is not None:
        return _plain(_below(root, name))
    arrays = sorted(one.name for one in root.iterdir() if one.is_dir() and not one.is_symlink() and _is_array(one))
    if len(arrays) != 1:
        advice = f"choose one, {source.path}:/{arrays[0]}" if arrays else ""
        raise unreadable(root, f"{len(arrays)} arrays: {listed(arrays)}", "one of them", advice)
    return _plain(root / arrays[0])


def locate_coarser(source: Folder, name: str | None = None, step: int | None = None) -> list[Located]:
    """Return all scales of an OME-Zarr image but the finest; none of arrays."""
    root, told = _image(source)
    count = len(told["multiscales"][0]["datasets"]) if told else 0
    return [_scale(root, told, name, step, number) for number in range(1, count)]
