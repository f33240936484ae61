"""The data of a viewer: what can be chosen, opened when it is first shown, and the scenes that follow from it."""

from __future__ import annotations

import os
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from sheetsplat._checks import shown, suffix_of
from sheetsplat.api import Opened, Prepared, prepare, with_coloring
from sheetsplat.camera import Camera
from sheetsplat.describe.scene_file import SUFFIX, SceneFile
from sheetsplat.errors import complain, unusable
from sheetsplat.fields import BrickedField, BrickedKernels, EllipsoidField, Field, RegularField
from sheetsplat.fields.samples import ArraySamples
from sheetsplat.framing import compose_camera
from sheetsplat.io.names import Names
from sheetsplat.io.opening import time_steps
from sheetsplat.look.decades import itself
from sheetsplat.look.histogram import stride_of
from sheetsplat.modes import TRAITS
from sheetsplat.options.camera import CameraOptions
from sheetsplat.options.core import MODES, definitions, pick, pick_given
from sheetsplat.options.data import OpenOptions
from sheetsplat.options.look import IN_VALUES
from sheetsplat.options.picture import unused
from sheetsplat.options.quality import QualityOptions
from sheetsplat.options.renderer import RendererOptions
from sheetsplat.options.scene import SceneOptions
from sheetsplat.plan import PictureQuality
from sheetsplat.scene import Scene
from sheetsplat.slice_planes import OF_PLANES
from sheetsplat.viewer.arrays import arrays_of, has_arrays
from sheetsplat.viewer.coarse import coarse_fields

Made = TypeVar("Made")
# Data and scenes that are kept: what one goes back and forth between.
_KEPT_DATA, _KEPT_SCENES = 3, 8
_BINS = 256
# Samples that a histogram looks at.
_ENOUGH = 500_000
# Options of `render` that a viewer has in other ways, or that belong to one picture.
REFUSED = ("outputs", "progress", "renderer", "depth_limit")
MOST_DATA = 100_000
#: The quality of pictures where the options name none.
DEFAULT_QUALITY = str(definitions(QualityOptions)["quality"].default)


class _Recent:
    """The values that were used last. Threads that share a lock wait for the one that makes a value."""

    def __init__(self, most: int, lock: threading.RLock) -> None:
        self._most, self._lock = most, lock
        self._values: OrderedDict[Hashable, Any] = OrderedDict()

    def get(self, key: Hashable, make: Callable[[], Made]) -> Made:
        """Return the value of a key, made where it is not there."""
        with self._lock:
            if key not in self._values:
                # Room first: the largest data fit once.
                while len(self._values) >= self._most:
                    self._values.popitem(last=False)
                self._values[key] = make()
            self._values.move_to_end(key)
            found: Made = self._values[key]
            return found


@dataclass(frozen=True)
class Histogram:
    """How often values occur: counts of equal intervals between two values."""

    low: float
    high: float
    counts: tuple[int, ...]

    @classmethod
    def of(cls, fields: Sequence[Field]) -> Histogram:
        """Return the histogram of the kernels' values, of fields that add up by the one with the most kernels."""
        field = max(fields, key=lambda one: one.size)
        known = field.size - field.ghosts if isinstance(field, EllipsoidField) else None
        if isinstance(field, BrickedField):
            values: Any = field.samples.every(stride_of(field.survey.size))
        else:
            values = ArraySamples(field.values[:known])  # type: ignore[attr-defined]
        # An odd stride does not sample the same columns of every row.
        stride = max(1, -(-values.size // _ENOUGH)) | 1
        found = (values[::stride] if isinstance(values, np.ndarray) else values.every(stride)).astype(np.float64)
        found = found[np.isfinite(found)]
        low, high = (float(part) for part in field.value_range) if found.size else (0.0, 1.0)
        if not low < high:
            low, high = low - 0.5, high + 0.5
        return cls(low, high, tuple(np.histogram(found, _BINS, (low, high))[0].tolist()))


def name_of(data: object) -> str:
    """Return what data are called: the name of a file, else their kind."""
    if isinstance(data, str | os.PathLike):
        return Path(os.fsdecode(data)).name
    if isinstance(data, BrickedField | BrickedKernels):
        return Path(data.source.name).name
    if isinstance(data, Scene | Field):
        field = data.fields[0] if isinstance(data, Scene) else data
        return field.quantity.name or type(data).__name__
    return str(getattr(data, "name", None) or type(data).__name__)[:100]


def _named(what: str, given: object) -> tuple[tuple[str, Any], ...]:
    """Return names and data of a mapping or a sequence."""
    if isinstance(given, Mapping):
        pairs = [(str(name), one) for name, one in given.items()]
    elif isinstance(given, Sequence) and not isinstance(given, str | bytes):
        pairs = [(name_of(one), one) for one in given]
    else:
        raise complain(unusable(f"view: {what}"), shown(given), "a sequence of data, or a mapping of names to data")
    if not 0 < len(pairs) <= MOST_DATA:
        raise complain(unusable(f"view: {what}"), f"{len(pairs)} entries", f"from 1 to {MOST_DATA}")
    return tuple(pairs)


class Shown:
    """What a viewer shows: one of several data, one of several times, or one of the arrays of a file.

    Parameters
    ----------
    data
        As for `sheetsplat.render`; None where `choices` or `times` are given. A file with several time steps is a
        series.
    options
        Those of `sheetsplat.render`.
    choices
        Data by name, each with a look of its own.
    times
        Data of one time each, which share the look of the first.
    """

    def __init__(self, data: object, options: Mapping[str, Any], choices: object, times: object) -> None:
        given = [name for name, one in (("data", data), ("choices", choices), ("times", times)) if one is not None]
        if len(given) != 1:
            found = "nothing" if not given else " and ".join(given)
            raise complain("view: what is shown cannot be found out", found, "one of data, choices and times")
        for name in REFUSED:
            if options.get(name) is not None:
                raise complain(unusable(f"view: {name}"), shown(options[name]), "it only for sheetsplat.render")
        self.options = {name: value for name, value in options.items() if value is not None or name == "filter"}
        self._choices = _named("choices", choices) if choices is not None else ()
        self._times = _named("times", times) if times is not None else ()
        self._data, self._scene_file = data, _scene_file_of(data)
        # Options that choose a time of a file.
        self._steps: list[dict[str, Any]] = []
        # Options that choose an array of a file or an object.
        self._arrays: list[dict[str, Any]] = []
        if has_arrays(data) and self._scene_file is None:
            reading = pick_given(OpenOptions, self.options)
            arrays = Names() if {"scalar", "name"} & reading.keys() else arrays_of(data, reading)
            if arrays.names:
                self._choices = tuple((name, data) for name in arrays.names)
                # The first one is the one that is shown by itself.
                self._arrays = [{} if name == arrays.shown else {"scalar": name} for name in arrays.names]
            chosen = self._arrays[0] if self._arrays else {}
            steps = time_steps(data, {**reading, **chosen}) if isinstance(data, str | os.PathLike) else []
            if len(steps) > 1:
                self._times = tuple((f"step {number}", path) for number, (path, _) in enumerate(steps))
                self._steps = [options for _, options in steps]
        if self._scene_file is not None:
            made = self._scene_file.prepare(**self.options)
            self._data, self.options = (
                made.scene,
                {**pick(RendererOptions, made.renderer.settings), "camera": made.camera},
            )
        # One lock for all: the values of one are made of those of another.
        lock = threading.RLock()
        self._opened, self._scenes = _Recent(_KEPT_DATA, lock), _Recent(_KEPT_SCENES, lock)
        self._names, self._givers = _Recent(_KEPT_SCENES, lock), _Recent(_KEPT_DATA, lock)
        self._histograms, self._coarse = _Recent(_KEPT_DATA, lock), _Recent(_KEPT_SCENES, lock)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the data that can be chosen; none where there is no choice."""
        return tuple(name for name, _ in self._choices)

    @property
    def times(self) -> tuple[str, ...]:
        """Names of the times; none where there is one."""
        return tuple(name for name, _ in self._times)

    @property
    def client(self) -> Any:
        """Whose workers draw data in bricks; None: this process."""
        return self.options.get("client")

    def options_at(self, choice: int, time: int) -> dict[str, Any]:
        """Return the options of `render` for a choice and a time."""
        of_array = self._arrays[choice] if self._arrays else {}
        return {**self.options, **of_array, **(self._steps[time] if self._steps else {})}

    def data(self, choice: int, time: int) -> object:
        """Return data as they were given."""
        if self._times:
            return self._times[time][1]
        return self._choices[choice][1] if self._choices else self._data

    def files(self, choice: int, time: int) -> tuple[str, ...]:
        """Return the files that the data are of; none where they were given in another way."""
        if self._scene_file is not None:
            return tuple(map(os.fspath, self._scene_file.files))
        data = self.data(choice, time)
        return (os.path.abspath(os.fsdecode(data)),) if isinstance(data, str | os.PathLike) else ()

    def title(self, choice: int, time: int) -> str:
        """Return what is shown in a few words."""
        if files := self.files(choice, time):
            return name_of(files[0])
        return self._choices[choice][0] if self._choices else name_of(self.data(choice, time))

    def _open(self, choice: int, time: int) -> Opened:
        def make() -> Opened:
            return Opened.of(self.data(choice, time), self._with_log(choice, time))

        return self._opened.get((choice, time), make)

    def _with_log(self, choice: int, time: int) -> dict[str, Any]:
        """Return the options for a time: logarithms of all times are decades above one number."""
        options = self.options_at(choice, time)
        if not time or options.get("log") not in (None, True):
            return options
        floors = {one.quantity.floor for one in self.base(choice, 0).scene.fields} - {None}
        return {**options, "log": floors.pop()} if len(floors) == 1 else options

    def names_of_arrays(self, choice: int) -> tuple[str, ...]:
        """Return the names of the arrays of a choice; none where it has one, or none by name."""
        if self._scene_file is not None:
            return ()
        data = self.data(choice, 0)
        key: object = os.fspath(data) if isinstance(data, str | os.PathLike) else id(data)
        return self._names.get(key, lambda: arrays_of(data, pick_given(OpenOptions, self.options))).names

    def _colored(self, choice: int, time: int, mode: str, coloring: Mapping[str, Any]) -> dict[str, Any]:
        """Return the options for a time with the array that gives colours, opened once; without one in other modes."""
        options = {**self._with_log(choice, time), **coloring}
        name = options.get("color_by")
        if not isinstance(name, str) or name not in self.names_of_arrays(choice):
            return options
        if unused(mode, ["color_by"]):
            return {**options, "color_by": None, "color_map": None}
        opened = Opened(self.data(choice, time), self._open(choice, time).fields)

        def make() -> Any:
            return with_coloring(opened, options)["color_by"]

        return {**options, "color_by": self._givers.get((choice, time, name), make)}

    def base(
        self,
        choice: int,
        time: int = 0,
        mode: str | None = None,
        quality: str | None = None,
        coloring: Mapping[str, Any] | None = None,
    ) -> Prepared:
        """Return the scene and the camera that follow from data and options, before anything is changed.

        Parameters
        ----------
        choice, time
            Numbers of the data.
        mode, quality
            Those of `render`; as the options say unless given.
        coloring
            `color_by`, the name of an array of the file, and `color_map`, in place of the options.
        """
        # What follows from the options by themselves is made once.
        if mode == (self.options.get("mode") or MODES[0]) and not isinstance(self.data(choice, time), Scene):
            mode = None
        if quality == (self.options.get("quality") or DEFAULT_QUALITY):
            quality = None
        parts, colors = (choice, time, mode, quality), dict(coloring or {})
        key = *parts, tuple(sorted(colors.items()))
        return self._scenes.get(key, lambda: self._composed(*parts, colors))

    def _composed(
        self, choice: int, time: int, mode: str | None, quality: str | None, coloring: Mapping[str, Any]
    ) -> Prepared:
        if time:
            first = self.base(choice, 0, mode, quality, coloring)
            fields = self._made(choice, time, mode, quality, coloring).scene
            groups = fields.groups if len(fields.groups) > 1 else fields.fields
            spacing = {"slice_spacing": first.scene.slice_spacing, "reference_length": first.scene.reference_length}
            colors = tuple(
                None if mine is None or its is None else (its[0], mine[1])
                for mine, its in zip(first.scene.color_by, fields.color_by, strict=True)
            )
            made = first.scene.replace(field=groups, color_by=colors if any(colors) else None, **spacing)
            return _with_scene(first, made.with_quality(first.scene.quality))
        return self._made(choice, time, mode, quality, coloring)

    def _made(
        self, choice: int, time: int, mode: str | None, quality: str | None, coloring: Mapping[str, Any]
    ) -> Prepared:
        opened = self._open(choice, time)
        first = self.options.get("mode") or MODES[0]
        options = self._colored(choice, time, mode or first, coloring)
        if not options.get("slice_planes"):
            # They are of planes that the page may show.
            options = {name: one for name, one in options.items() if name not in OF_PLANES}
        if isinstance(opened.data, Scene):
            made = prepare(opened, **options)
            changed = made.scene if mode in (None, made.scene.mode) else _in_mode(made.scene, str(mode), options)
            return _with_scene(made, changed)
        if quality is not None:
            options["quality"] = quality
        if mode in (None, first):
            return prepare(opened, **options)
        # The kernels of volumes are those of the first mode, so that they are made once.
        own = self.base(choice, time, None, quality).scene
        options["mode"] = mode
        for name in (*_OF_ONE_MODE, *unused(mode, list(options))):
            options.pop(name, None)
        in_decades = any(one.quantity.floor is not None for one in own.fields)
        # What their logarithms were taken of is added up along rays, and particles may be sums in one of both modes.
        anew = in_decades and TRAITS[mode].adds or not all(isinstance(one, RegularField) for one in own.fields)
        made = prepare(opened if anew else Opened(list(own.fields), own.fields), **options)
        return _with_scene(made, made.scene.with_quality(_joined(own.quality, made.scene.quality)))

    def coarse(self, fields: tuple[Field, ...], key: tuple[int, int]) -> tuple[Field, ...] | None:
        """Return coarse copies of the fields of a choice and a time; None where they are small."""
        return self._coarse.get(key, lambda: coarse_fields(fields))

    def camera(self, scene: Scene, size: tuple[int, int], **changes: Any) -> Camera:
        """Return a camera that shows all of a scene, by the options but for some changes."""
        given: Camera | None = self.options.get("camera")
        if given is not None and not changes:
            return given
        return compose_camera(scene, size, **{**pick(CameraOptions, self.options), **changes})

    def renderer_options(self) -> dict[str, Any]:
        """Return the options of the renderer that were given."""
        return pick(RendererOptions, self.options)

    def histograms(self, choice: int, time: int) -> list[Histogram]:
        """Return a histogram for each group of fields."""
        groups = self.base(choice, time).scene.groups
        return self._histograms.get((choice, time), lambda: [Histogram.of(fields) for fields in groups])


def _scene_file_of(data: object) -> SceneFile | None:
    """Return the scene file that data are, or that they name."""
    if isinstance(data, SceneFile):
        return data
    return SceneFile.read(os.fsdecode(data)) if suffix_of(data) == SUFFIX else None  # type: ignore[arg-type]


# Options that are meant for the mode that was asked for.
_OF_ONE_MODE = ({*IN_VALUES} - {"transfer_function"}) | {"scalar_colors", "cmap", "opacity", "log_scale"}


# What a scene is refused with in modes that do not use it.
_LIT = {
    name: definitions(SceneOptions)[name] for name in ("shadows", "ambient_occlusion", "gradient_opacity", "depth_cue")
}


def _in_mode(scene: Scene, mode: str, options: Mapping[str, Any]) -> Scene:
    """Return a given scene in another mode."""
    changes: dict[str, Any] = {"mode": mode}
    if TRAITS[mode].shows_surfaces and scene.iso_value is None:
        low, high = scene.fields[0].value_range
        changes["iso_value"] = 0.5 * (low + high)
    changes |= {name: option.default for name, option in _LIT.items() if unused(mode, [name])}
    if TRAITS[mode].adds:
        groups = [[itself(one) for one in fields] for fields in scene.groups]
        changes["field"] = groups if len(groups) > 1 else groups[0]
    return scene.replace(**changes).with_quality(scene.quality)


def _with_scene(made: Prepared, scene: Scene) -> Prepared:
    """Return a picture with another scene, whose decisions are not known."""
    return replace(made, scene=scene, decisions=None)


def _joined(kernels: PictureQuality | None, others: PictureQuality | None) -> PictureQuality | None:
    """Return what a quality set of the kernels in one scene, and of the rest in another one."""
    if kernels is None or others is None:
        return others
    of_kernels = ("prefilter", "radius", "falloff")
    settings = [one for one in kernels.settings if one.option in of_kernels]
    return replace(others, settings=(*settings, *(one for one in others.settings if one.option not in of_kernels)))


def describe(scene: Scene) -> list[str]:
    """Return what fields are, a line each."""
    lines = []
    for one in scene.fields:
        if isinstance(one, RegularField):
            nk, nj, ni = one.shape
            lines.append(f"{ni} × {nj} × {nk} samples, {one.samples.dtype}")
        else:
            lines.append(f"{one.size:,} kernels")
    return lines
