"""Where the samples of bricks come from: volumes that any process with the same files reads box by box.

Nothing of a volume is read before a box of it is asked for. What the readers of whole files check (links out of the
file, sizes, codecs that run code) is checked here by the same functions.
"""

from __future__ import annotations

import hashlib
import math
import os
import pkgutil
import uuid
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import Triple, shown, triple
from sheetsplat._objects import kind_of_object
from sheetsplat.bricks import readers
from sheetsplat.bricks.lattice import Box
from sheetsplat.bricks.readers import Reader, Shape, Stamp, check_options, check_plain, is_url, placed_errors, refused
from sheetsplat.errors import Unsupported, complain, option_ref
from sheetsplat.fields.regular import as_samples, kept_type
from sheetsplat.io.axes import placed
from sheetsplat.io.checks import check_volume
from sheetsplat.io.kernels import logarithm
from sheetsplat.io.records import Packing, Volume
from sheetsplat.io.source import Folder, Source, opened
from sheetsplat.io.stored import StoredSamples
from sheetsplat.labels import LabelColors
from sheetsplat.orientation import Orientation
from sheetsplat.quantity import Quantity

#: Formats of files of which a part can be read.
FORMATS = (
    "raw samples (with shape and dtype), .npy, raw NRRD and MetaImage, HDF5, NetCDF, Zarr and OME-Zarr; particles in "
    "HDF5, and Parquet"
)


def box_text(box: Box) -> str:
    """Return a box for messages: "[0:64, 0:64, 64:128]", the indices of the array [k, j, i]."""
    return "[" + ", ".join(f"{first}:{last}" for first, last in box) + "]"


@dataclass(frozen=True, eq=False)
class BrickSource:
    """A volume whose samples stay where they are until a box of them is read.

    Attributes
    ----------
    name
        The file or the array, for messages.
    token
        The same for the same data; another one after a file was changed.
    shape
        (nk, nj, ni).
    stored
        Type of the samples as the reader returns them, in this machine's byte order.
    reader
        Reads them.
    spacing, origin
        World units along x, y, z.
    axes
        Steps of i, j and k in the world, in place of the spacing; None: along the world.
    quantity, orientation
        As those of a field.
    kept
        Type in which fields keep the samples; None: it follows from the range of all of them (wide integers).
    floor
        The samples are log10(value / floor), 0 for smaller values; None: as they are.
    limits
        Samples beyond these are moved to them; None: as they are.
    coarser
        Coarser levels of the same volume, the finest first.
    carried
        Bytes that go along where it is pickled.
    holey
        Whether NaN is what the data say is missing.
    labels
        Whether the data state that samples are labels; their names and colours where they state these.
    label
        Samples are 1 where they are this label, and 0 elsewhere; None: as they are.
    """

    name: str
    token: str
    shape: Shape
    stored: np.dtype[Any]
    reader: Reader
    spacing: Triple = (1.0, 1.0, 1.0)
    origin: Triple = (0.0, 0.0, 0.0)
    axes: tuple[Triple, ...] | None = None
    quantity: Quantity = Quantity()
    orientation: Orientation | None = None
    kept: np.dtype[Any] | None = None
    floor: float | None = None
    limits: tuple[float, float] | None = None
    coarser: tuple[Level, ...] = ()
    carried: int = 0
    holey: bool = False
    labels: LabelColors | bool = False
    label: int | None = None

    @property
    def key(self) -> tuple[Any, ...]:
        """What `read` depends on: equal for the same samples shown in the same way."""
        return self.token, self.kept, self.floor, self.limits, self.label

    def __eq__(self, other: object) -> bool:
        """Return whether the samples are the same, shown and placed in the same way."""
        if not isinstance(other, BrickSource):
            return NotImplemented
        mine, others = (
            (*one.key, one.spacing, one.origin, one.axes, one.quantity, one.orientation) for one in (self, other)
        )
        return mine == others

    def __hash__(self) -> int:
        """Return a hash of `key`."""
        return hash(self.key)

    def __repr__(self) -> str:
        """Return a text that is the same for the same samples."""
        coarser = "".join(f", {one.source.token}" for one in self.coarser)
        return f"BrickSource({self.key!r}, {self.shape}, {self.stored}{coarser})"

    @property
    def size(self) -> int:
        """Number of samples."""
        return math.prod(self.shape)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the samples that `read` returns."""
        kind = self.stored if self.kept is None else self.kept
        if self.label is not None:
            return np.dtype(np.uint8)
        if self.floor is not None:
            return np.dtype(np.float32 if kind.itemsize <= 4 else np.float64)
        return kind

    @property
    def owner(self) -> object:
        """What exists as long as anything shows these samples, in whatever way."""
        return self.reader

    def bytes_of(self, box: Box) -> int:
        """Return how much memory a box takes while it is read."""
        count = math.prod(last - first for first, last in box)
        wide = 2 * np.dtype(np.float64).itemsize if self.floor is not None else 0
        return count * (self.stored.itemsize + self.dtype.itemsize + wide)

    def read(self, box: Box) -> NDArray[Any]:
        """Return the samples of a box, a contiguous array [k, j, i].

        Raises
        ------
        InvalidInput
            For a box outside of the volume, damaged data, and data of another type or size than when it was opened.
        OutOfMemory
            Where the box does not fit.
        Error
            Where the data cannot be read any more.
        """
        inside = all(0 <= first < last <= size for (first, last), size in zip(box, self.shape, strict=True))
        what = f"samples {box_text(box)} of {self.name} cannot be read"
        if not inside:
            raise complain(what, box_text(box), f"a box inside of {' x '.join(map(str, self.shape))} samples [k, j, i]")
        _memory.require(self.bytes_of(box), f"samples {box_text(box)} of {self.name}", "use smaller bricks")
        with placed_errors(what), np.errstate(all="ignore"):
            found = np.asarray(self.reader(box))
            wanted = tuple(last - first for first, last in box)
            if found.shape != wanted:
                raise complain(what, f"an array of shape {found.shape}", f"shape {wanted}, as the volume says")
            if found.dtype.newbyteorder("=") != self.stored:
                raise complain(what, f"samples of type {found.dtype}", f"{self.stored}, as when it was opened")
        return self._as_shown(found)

    def _as_shown(self, found: NDArray[Any]) -> NDArray[Any]:
        values = np.ascontiguousarray(found, dtype=self.stored if self.kept is None else self.kept)
        if self.label is not None:
            values = np.asarray(values == self.label, np.uint8)
            return values
        if self.floor is not None:
            decades = logarithm(values.astype(np.float64), self.name, self.floor)
            values = np.where(np.isnan(values), np.nan, decades).astype(self.dtype)
        if self.limits is not None:
            values = np.clip(values, *self.limits).astype(values.dtype)
        return values

    def shown_as(self, numbers: NDArray[Any]) -> NDArray[Any]:
        """Return samples as they are stored, of any shape, in the way in which `read` returns them."""
        return self._as_shown(np.atleast_1d(numbers))

    def replace(self, **changes: Any) -> BrickSource:
        """Return the same samples placed or shown in another way."""
        return replace(self, **changes)

    def at_level(self, level: int) -> BrickSource:
        """Return a coarser level, shown in the same way; 0: itself."""
        return self if not level else self.coarser[level - 1].source.replace(floor=self.floor, limits=self.limits)


@dataclass(frozen=True)
class Level:
    """A coarser level of a volume.

    Attributes
    ----------
    source
        Its samples.
    steps
        Steps of the volume's own indices from one of its samples to the next, along x, y, z.
    start
        Place of its first sample in the volume's own indices, along x, y, z.
    """

    source: BrickSource
    steps: Triple
    start: Triple


def open_source(data: Any, options: Mapping[str, Any]) -> BrickSource:
    """Return the source of a file, a URL, or an array; nothing but headers is read.

    Parameters
    ----------
    data
        A path, a URL that fsspec knows, a NumPy, dask, Zarr or h5py array, or a DataArray of xarray.
    options
        Options of reading that were given: shape, dtype, offset, name, scalar, step.

    Raises
    ------
    InvalidInput
        As `sheetsplat.open`, and for formats of which no part can be read.
    """
    if isinstance(data, BrickSource):
        return data
    if isinstance(data, str | os.PathLike):
        text = os.fspath(data)
        if is_url(text):
            return _remote(text, options)
        return _file(text, options)
    if reading := sorted(options):
        raise complain(
            "open_bricks: these options cannot be used",
            ", ".join(reading) + " for an array",
            "them only for files",
            option=reading[0] if len(reading) == 1 else None,
        )
    kind = kind_of_object(data)
    if kind is None:
        return _of_numpy(data)
    with placed_errors(f"{kind.name} cannot be opened in bricks"):
        return _of_object(data, kind.name)


def _source(name: str, token: str, volume: Volume, reader: Callable[[Any], Reader]) -> BrickSource:
    """Return the source of a volume; `reader` makes what reads boxes of its values as they are placed."""
    volume = placed(name, volume)
    packing, read = volume.packing, reader(volume.values)
    kind = packing.kind(volume.values.dtype.newbyteorder("="))
    if packing != Packing():
        read = partial(readers.unpacked, read, packing, name)
    check_volume(name, volume.values.shape, kind)
    nk, nj, ni = volume.values.shape
    if not volume.values.size:
        raise refused(name, f"no samples, shape {(nk, nj, ni)}", "at least one")
    if kind.kind == "f" and kind.itemsize > 8:
        wanted = "at most float64"
        raise refused(name, f"samples of type {kind}", wanted, "convert them")
    return BrickSource(
        name,
        _digest(token.encode()),
        (nk, nj, ni),
        kind,
        read,
        volume.spacing,
        volume.origin,
        None if volume.axes is None else tuple(triple("axes", row) for row in volume.axes),
        volume.quantity,
        volume.orientation,
        kept_type(kind),
        holey=bool(packing.missing),
        labels=volume.labels,
    )


def _opened_anew() -> str:
    """Return a token of data that may change without a sign of it: each time that they are opened another."""
    return uuid.uuid4().hex


def _digest(data: bytes | memoryview) -> str:
    return hashlib.blake2b(data, digest_size=12).hexdigest()


def _of_numpy(data: Any) -> BrickSource:
    values = as_samples(data)
    token = _digest(values.data if values.size else b"")
    token = f"{token}{values.dtype.str}{values.shape}"
    made = _source("the array", token, Volume(values), lambda samples: partial(readers.of_array, samples))
    return made.replace(carried=values.nbytes)


def _of_object(data: Any, name: str) -> BrickSource:
    module = type(data).__module__.partition(".")[0]
    if module == "h5py":
        if not Path(str(data.file.filename)).is_file():
            raise refused(name, "a file in memory", "a file that all workers can read")
        return _file(f"{data.file.filename}:{data.name}", {})
    if module == "zarr":
        root = getattr(data.store, "root", None)
        if root is not None:
            return _file(str(Path(root) / data.path), {})
    if module in ("zarr", "dask") or type(data).__name__ == "DataArray":
        from sheetsplat.io.lazy_arrays import part_of

        # Tasks of a worker draw bricks; further tasks of its scheduler would wait for them.
        named = pkgutil.resolve_name(f"sheetsplat.io.{'xarray_data' if module == 'xarray' else 'lazy_arrays'}:named")
        one = named(data, name)
        one = replace(one, samples=replace(one.samples, fetch=partial(part_of, data, scheduler="synchronous")))
        return _source(name, _opened_anew(), one.volume(module), _lazily())
    raise refused(
        name,
        f"{type(data).__name__}, which is read as a whole",
        "a path, or an array of NumPy, dask, Zarr, h5py or xarray",
        "open it with sheetsplat.open",
        kind=Unsupported,
    )


def _file(text: str, options: Mapping[str, Any]) -> BrickSource:
    from sheetsplat.io.formats import format_of

    with opened(text) as source:
        found = format_of(source, raw_options="shape" in options or "dtype" in options)
        if found.scattered or found.name not in _LOCATED:
            raise refused(
                text,
                f"a file of format {found.name}, which is read as a whole",
                FORMATS,
                "convert it, or open it with sheetsplat.open",
                kind=Unsupported,
            )
        check_plain(source, text)
        locate, allowed = _LOCATED[found.name]
        check_options(text, options, allowed, f"a file of format {found.name}")
        made: BrickSource = locate(source, text, options)
        return made


def _chosen_name(options: Mapping[str, Any]) -> str | None:
    name = options.get("name", options.get("scalar"))
    return None if name is None else str(name)


def _stored(text: str, volume: Volume, *headers: Path) -> BrickSource:
    """Return the source of a volume whose values are `StoredSamples`; `headers`: the files that say where they are."""
    samples: Any = volume.values
    stamps = tuple(map(Stamp.of, dict.fromkeys((*headers, samples.path))))
    samples = replace(samples, path=stamps[-1].path)
    token = f"{stamps}{samples}"
    return _source(
        text, token, replace(volume, values=samples), lambda turned: partial(readers.of_file, stamps, turned)
    )


def _lazily(*stamps: Stamp) -> Callable[[Any], Reader]:
    """Return what makes the reader of `LazySamples`; `stamps`: the files that have them."""
    return lambda samples: partial(readers.of_lazy, stamps, samples)


def _by_reader(reader: str) -> Callable[..., BrickSource]:
    """Return what locates the arrays of a file by a function of `sheetsplat.io`."""

    def locate(source: Source, text: str, options: Mapping[str, Any]) -> BrickSource:
        stamp, name, step = Stamp.of(source.path), _chosen_name(options), options.get("step")
        volume = pkgutil.resolve_name("sheetsplat.io." + reader)(source, name, step)
        return _source(text, f"{stamp}{source.inner}{name}{step}", volume, _lazily(stamp))

    return locate


def _zarr(source: Folder, text: str, options: Mapping[str, Any]) -> BrickSource:
    from sheetsplat.io.zarr_folders import locate, locate_coarser

    source = Folder(Path(os.path.abspath(source.path)), source.inner)
    located = locate(source, _chosen_name(options), options.get("step"))
    made = _source(text, _zarr_token(located), located.volume, _lazily())
    others = locate_coarser(source, _chosen_name(options), options.get("step"))
    levels = [_source(f"{text}, {one.path.name}", _zarr_token(one), one.volume, _lazily()) for one in others]
    return made.replace(coarser=tuple(_level(made, one) for one in levels if _is_coarser(one, made)))


def _zarr_token(located: Any) -> str:
    """Return what tells a scale from all others, and from itself before any of its chunks was written again."""
    what = repr((str(located.path), located.volume.values.index))
    digest = hashlib.blake2b(what.encode(), digest_size=12)
    for folder, folders, files in os.walk(located.path):
        folders.sort()
        for name in sorted(files):
            found = os.stat(os.path.join(folder, name), follow_symlinks=False)
            digest.update(f"{folder}/{name} {found.st_size} {found.st_mtime_ns}\n".encode(errors="surrogateescape"))
    return digest.hexdigest()


def _is_coarser(one: BrickSource, source: BrickSource) -> bool:
    """Return whether a scale has wider steps, along no axis narrower ones, and samples at all."""
    wider = [a / b for a, b in zip(one.spacing, source.spacing, strict=True)]
    return bool(min(wider) >= 1.0 and max(wider) > 1.0 and one.size > 0)


def _level(source: BrickSource, coarse: BrickSource) -> Level:
    x, y, z = (a / b for a, b in zip(coarse.spacing, source.spacing, strict=True))
    places = zip(coarse.origin, source.origin, source.spacing, strict=True)
    i, j, k = ((a - b) / step for a, b, step in places)
    return Level(coarse, (x, y, z), (i, j, k))


def _raw(reader: str, *, behind_header: bool = False) -> Callable[..., BrickSource]:
    """Return what locates raw samples by a function of `sheetsplat.io`."""

    def locate(source: Source, text: str, options: Mapping[str, Any]) -> BrickSource:
        read = pkgutil.resolve_name("sheetsplat.io." + reader)
        if behind_header:
            return _stored(text, read(source), source.path)
        return _stored(text, read(source, **options))

    return locate


# What locates samples in files of a format, and the options of reading that these have.
_LOCATED: Mapping[str, tuple[Callable[..., BrickSource], tuple[str, ...]]] = {
    "raw": (_raw("raw:locate"), ("shape", "dtype", "offset")),
    "npy": (_raw("numpy_files:locate"), ()),
    "nrrd": (_raw("nrrd_files:locate", behind_header=True), ()),
    "metaimage": (_raw("metaimage:locate", behind_header=True), ()),
    "hdf5 volume": (_by_reader("hdf5_volumes:locate"), ("name", "scalar", "step")),
    "zarr": (_zarr, ("name", "scalar", "step")),
    "netcdf": (_by_reader("netcdf:locate"), ("name", "scalar", "step")),
}


def _remote(url: str, options: Mapping[str, Any]) -> BrickSource:
    """Return the source of raw samples at a URL."""
    from sheetsplat.io import raw

    what = f"{url} cannot be opened in bricks"
    with placed_errors(what):
        import fsspec  # type: ignore[import-not-found, import-untyped, unused-ignore]

        if "shape" not in options or "dtype" not in options:
            advice = "pass " + option_ref("shape", "...") + " and " + option_ref("dtype", "...")
            advice = advice + "; open other formats with their own library, and pass its dask or Zarr array"
            raise complain(what, "a URL without the shape and the type of its samples", "both", advice)
        shape, kind = raw.checked_samples(url, options.get("shape"), options.get("dtype"))
        offset = int(options.get("offset", 0))
        with fsspec.open(url, "rb") as file:
            length = int(file.seek(0, os.SEEK_END))
        needed = math.prod(shape) * kind.itemsize
        if offset < 0 or length - offset != needed:
            found = f"{length} bytes, {offset} of them before the samples"
            raise complain(what, found, f"{needed} bytes of samples, {shown(shape)} of {kind}")
    samples: Any = StoredSamples.dense(Path(url), kind, shape, offset)
    return _source(url, _opened_anew(), Volume(samples), lambda turned: partial(readers.of_url, url, turned))
