"""Zarr and OME-Zarr in folders: an array with three axes, or the scale of a picture that fits into memory.

What is read of them is checked by `zarr_chunks`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sheetsplat import _memory
from sheetsplat._checks import shown, triple
from sheetsplat.errors import InvalidInput, option_ref
from sheetsplat.io.cf import READ, Coordinate, NamedArray, dimension_names
from sheetsplat.io.channels import chosen_channels, color_of, label_colors, only, window_of
from sheetsplat.io.checks import chosen_step, floats, listed, printable, unreadable
from sheetsplat.io.names import tell_names
from sheetsplat.io.records import Channel, Volume
from sheetsplat.io.source import Folder
from sheetsplat.io.stored import LazySamples
from sheetsplat.io.zarr_chunks import Grid, attributes_of, below, is_array, metadata_of, read_array
from sheetsplat.labels import LabelColors

# Of the memory that is available, the share that the samples of a picture may take: they are copied and prefiltered.
_SHARE = 0.2
# Folders of a group that are looked at, and how deep: wells of plates have rows, columns and fields.
_MOST_FOLDERS = 10_000
_DEEPEST = 4
# Labels beyond it are none that float64 tells apart.
_LARGEST_LABEL = 2**40


@dataclass(frozen=True)
class Located:
    """An array of a Zarr folder as a volume, of which nothing is read yet.

    Attributes
    ----------
    path
        The folder of the array.
    volume
        Its values are `LazySamples`.
    """

    path: Path
    volume: Volume

    @property
    def bytes(self) -> int:
        """Bytes of all samples."""
        samples = self.volume.values
        return int(samples.size) * samples.dtype.itemsize


def _named(path: Path) -> NamedArray:
    """Return an array with the names of its dimensions, and the coordinates that lie beside it in its group."""
    grid, told = Grid.of(path), attributes_of(path)
    attributes = {name: told[name] for name in READ if name in told}
    older = metadata_of(path, ".zarray")
    names = told.get("_ARRAY_DIMENSIONS") if older else metadata_of(path, "zarr.json").get("dimension_names")
    if not (isinstance(names, list) and len(names) == len(grid.shape)):
        names = [None] * len(grid.shape)
    elif older and older.get("fill_value") is not None:
        # Where dimensions are named, what chunks are filled with is the fill value of the conventions.
        attributes.setdefault("_FillValue", older["fill_value"])
    dimensions = dimension_names(names)
    samples = LazySamples.of(partial(read_array, path), grid.dtype, grid.shape)
    title = "" if path.suffix == ".zarr" else path.name
    return placed_beside(path, NamedArray(path, title, dimensions, samples, attributes))


def placed_beside(path: Path, one: NamedArray) -> NamedArray:
    """Return an array with the coordinates that lie beside it in its group, by the folder of the array."""
    group = path.parent
    if not _is_group(group):
        return one
    places = zip(one.dimensions, one.samples.shape, strict=True)
    found = {name: _coordinate(group, str(name), size) for name, size in places}
    others = str(one.attributes.get("coordinates", "")).split()
    curved = tuple(name for name in others if _dimensions_of(group, name) > 1)
    return replace(one, coordinates={name: there for name, there in found.items() if there is not None}, curved=curved)


def _is_group(path: Path) -> bool:
    return (path / ".zgroup").is_file() or metadata_of(path, "zarr.json").get("node_type") == "group"


def _dimensions_of(group: Path, name: str) -> int:
    """Return how many dimensions an array of numbers beside others has; 0 where there is none."""
    try:
        path = below(group, name)
        return len(Grid.of(path).shape) if is_array(path) and not path.is_symlink() else 0
    except InvalidInput:
        return 0


def _coordinate(group: Path, name: str, size: int) -> Coordinate | None:
    if _dimensions_of(group, name) != 1 or Grid.of(below(group, name)).shape != (size,):
        return None
    told = attributes_of(below(group, name))
    numbers = read_array(below(group, name), (slice(None),))
    return Coordinate(numbers, {key: told[key] for key in READ if key in told})


def _array(path: Path) -> NamedArray:
    """Return an array; InvalidInput unless there is one."""
    if not is_array(path):
        raise unreadable(path, "no array of Zarr", "one")
    return _named(path)


def _below(root: Path) -> Iterator[tuple[Path, bool]]:
    """Yield the arrays in a group and in its groups, and the images, with whether they are images."""
    left, count = [(root, 0)], 0
    while left:
        here, depth = left.pop(0)
        for one in sorted(here.iterdir()):
            count += 1
            if count > _MOST_FOLDERS:
                raise unreadable(root, f"more than {_MOST_FOLDERS} files and folders in a group", "fewer", "choose one")
            if not one.is_dir() or one.is_symlink():
                continue
            if is_array(one):
                yield one, False
            elif _told_of(one):
                yield one, True
            elif depth < _DEEPEST and _is_group(one):
                left.append((one, depth + 1))


def _told_of(root: Path) -> Mapping[str, Any]:
    """Return the attributes of an OME-Zarr image, {} for anything else."""
    told = {} if is_array(root) else attributes_of(root)
    told = told.get("ome", told)
    is_image = isinstance(told, dict) and isinstance(told.get("multiscales"), list) and told["multiscales"]
    return told if is_image else {}


def _chosen(source: Folder, name: str | None) -> tuple[Path, str | None]:
    """Return the array or the image that is shown, and the name that chooses a channel of an image.

    Where neither FOLDER:/path nor a name chooses one of a group, it is the only image, or the only array with three
    dimensions or more.
    """
    root = below(source.path, source.inner) if source.inner else source.path
    if not root.is_dir():
        held = sorted(one.name for one in root.parent.iterdir() if one.is_dir()) if root.parent.is_dir() else []
        raise unreadable(source.path, f"nothing at {source.inner}", "one of: " + (listed(held) or "(none)"))
    if is_array(root) or _told_of(root):
        tell_names([])
        return root, name
    if name is not None and is_array(below(root, name)):
        return below(root, name), None
    known = list(_below(root))
    images = [path for path, is_image in known if is_image]
    sizes = {path: _shape(path) for path, is_image in known if not is_image}
    arrays = [path for path in sizes if len(sizes[path]) >= 3] if not images else []
    found = images or arrays
    names = tell_names(one.relative_to(root).as_posix() for one in found)
    if len(found) == 1:
        return found[0], name
    if name in names:
        return found[names.index(name)], None
    # The one with the most dimensions is meant more often than the first one.
    best = max(
        found or list(sizes), key=lambda path: (len(sizes.get(path, ())), math.prod(sizes.get(path, ()))), default=None
    )
    advice = f"choose one, {source.path}:/{best.relative_to(source.path).as_posix()}" if best is not None else ""
    if images:
        what = f"{len(images)} images: {listed(names)}"
    else:
        sized = [f"{one.relative_to(root).as_posix()} {sizes[one]}" for one in sizes]
        what = f"{len(found)} arrays with three dimensions" + (f": {listed(sized)}" if sized else "")
    raise unreadable(root, what, "one of them", advice)


def _shape(path: Path) -> tuple[int, ...]:
    try:
        return Grid.of(path).shape
    except InvalidInput:
        return ()


def _axes(image: Any) -> list[str]:
    return [str(one["name"] if isinstance(one, dict) else one).lower() for one in image["axes"]]


def count_steps(source: Folder, name: str | None = None) -> int:
    """Return the number of time steps of an OME-Zarr image, or of an array with a dimension of that name."""
    path, _ = _chosen(source, name)
    told = _told_of(path)
    if not told:
        return _array(path).steps
    image = told["multiscales"][0]
    shape = Grid.of(below(path, image["datasets"][0]["path"])).shape
    times = [count for axis, count in zip(_axes(image), shape, strict=False) if axis not in ("x", "y", "z", "c")]
    return times[0] if times else 1


def _multiscale(path: Path, told: Any, name: str | None, step: int | None, limit: float) -> list[Located]:
    """Return the channels of the finest scale of an OME-Zarr image whose samples take `limit` bytes.

    Specification 0.4 and 0.5.
    """
    count = len(told["multiscales"][0]["datasets"])
    for number in range(count):
        found = _scale(path, told, name, step, number)
        if sum(one.bytes for one in found) <= limit or number == count - 1:
            return found
    raise unreadable(path, "no scale", "at least one")


def _channels(told: Any) -> list[Channel]:
    """Return what is stated of the channels of an image, as OMERO shows them."""
    entries = (told.get("omero") or {}).get("channels") or []
    found = []
    for one in entries:
        about = one if isinstance(one, dict) else {}
        stated: Any = about.get("window")
        window = stated if isinstance(stated, dict) else {}
        limits = window_of(window.get("start"), window.get("end"))
        found.append(Channel(printable(about.get("label")), color_of(about.get("color")), limits))
    return found


def _labels(path: Path, told: Any) -> LabelColors | bool:
    """Return names and colours of the labels of an image whose samples are labels, True where none are stated."""
    about = told.get("image-label")
    if not isinstance(about, dict):
        return False

    def entries(key: str) -> Iterator[tuple[int, Any]]:
        listed_ = about.get(key)
        for one in listed_ if isinstance(listed_, list) else []:
            label = one.get("label-value") if isinstance(one, dict) else None
            if isinstance(label, int) and abs(label) <= _LARGEST_LABEL:
                yield label, one

    colors = []
    for label, one in entries("colors"):
        rgba = one.get("rgba")
        if isinstance(rgba, list) and all(isinstance(part, int | float) for part in rgba):
            colors.append((label, [part / 255.0 for part in rgba]))
    names = {label: printable(one.get("name") or one.get("label")) for label, one in entries("properties")}
    return label_colors(path, colors, names) or True


def _scale(path: Path, told: Any, name: str | None, step: int | None, number: int) -> list[Located]:
    """Return the channels of a scale of an OME-Zarr image."""
    image = told["multiscales"][0]
    axes, levels = _axes(image), image["datasets"]
    units = [printable(one.get("unit")) if isinstance(one, dict) else "" for one in image["axes"]]
    if sorted(axes)[-3:] != ["x", "y", "z"] or len(axes) > 5 or len(set(axes)) != len(axes):
        raise unreadable(path, f"axes {', '.join(axes)}", "x, y and z, and at most a time and a channel")
    level = levels[number]
    place = below(path, level["path"])
    grid = Grid.of(place)
    if len(grid.shape) != len(axes):
        raise unreadable(place, f"shape {grid.shape}", f"{len(axes)} axes, {', '.join(axes)}")
    counts = dict(zip(axes, grid.shape, strict=True))
    known = chosen_channels(path, counts.get("c", 1), _channels(told), name)
    steps, start = _transforms(path, axes, level, image)
    volume = Volume(
        np.empty(0),
        triple("scale", [steps[axis] for axis in "xyz"]),
        triple("translation", [start[axis] for axis in "xyz"]),
        "ome-zarr",
        {"scale": f"{number} of 0 to {len(levels) - 1}, {place.name}"},
        units=tuple(units[axes.index(axis)] for axis in "xyz"),
        labels=_labels(path, told),
    )
    found = []
    for at, channel in known.items():
        index: list[int | range] = []
        for axis, count in counts.items():
            whole: int | range = (
                range(count) if axis in "xyz" else at if axis == "c" else chosen_step(path, count, step)
            )
            index.append(whole)
        samples: Any = LazySamples(partial(read_array, place), grid.dtype, tuple(index), tuple(map(axes.index, "zyx")))
        found.append(Located(place, replace(volume, values=samples, channel=channel)))
    return found


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


def read(
    source: Folder, name: str | None = None, step: int | None = None, resample: bool = False
) -> Volume | list[Volume]:
    """Read an array of a Zarr folder, or an OME-Zarr image: the finest scale whose samples take a fifth of the memory.

    FOLDER:/array chooses an array or an image of a group. Of an image `name` chooses the channel, by label or number;
    all are read unless it is given. `step` is one of several times, from 0 on, of images and of arrays that have a
    dimension of that name. Arrays whose dimensions have names are read as those of NetCDF (`cf.NamedArray`).

    Raises
    ------
    InvalidInput
        For groups with several arrays, other than three axes, several times without `step`, uneven coordinates unless
        `resample` is true, links, and chunks that unpack to more than their size.
    Unsupported
        For codecs that run code, or unpack without a bound.
    """
    path, name = _chosen(source, name)
    if not _told_of(path):
        return _at_step(path, name, step).read("zarr", resample=resample)
    volumes = [one.volume for one in _multiscale(path, _told_of(path), name, step, _SHARE * _memory.available())]
    samples: Any = [one.values for one in volumes]
    return [replace(one, values=lazy.read()) for one, lazy in zip(volumes, samples, strict=True)]


def _at_step(path: Path, name: str | None, step: int | None) -> NamedArray:
    """Return an array at a time step; InvalidInput for options that an array does not have."""
    one = _array(path)
    if step is not None and one.time_axis() is None:
        wanted = "it for images (OME-Zarr), and for arrays with a dimension of time"
        raise unreadable(path, option_ref("step") + " for an array", wanted, option="step")
    if name is not None:
        raise unreadable(path, option_ref("name") + " for a single array", "it for groups and images", option="name")
    return one.at_step(step)


def locate(source: Folder, name: str | None = None, step: int | None = None, limit: float = math.inf) -> Located:
    """Return what `read` reads without its samples; of an OME-Zarr image the finest scale of at most `limit` bytes."""
    path, name = _chosen(source, name)
    told = _told_of(path)
    if told:
        return _only(_multiscale(path, told, name, step, limit))
    return Located(path, _at_step(path, name, step).volume("zarr"))


def locate_coarser(source: Folder, name: str | None = None, step: int | None = None) -> list[Located]:
    """Return all scales of an OME-Zarr image but the finest; none of arrays."""
    path, name = _chosen(source, name)
    told = _told_of(path)
    count = len(told["multiscales"][0]["datasets"]) if told else 0
    return [_only(_scale(path, told, name, step, number)) for number in range(1, count)]


def _only(found: list[Located]) -> Located:
    only(found[0].path, [one.volume for one in found])
    return found[0]
