"""What a viewer shows, beside the data: everything that its page can change, checked when it changes."""

from __future__ import annotations

import bisect
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import Triple, choice, color, convert, number, share, shown, triple, truth, whole
from sheetsplat.camera import Camera
from sheetsplat.describe.schema import CAMERAS, camera_of, eye_parts, fits, tuples, value_of
from sheetsplat.errors import complain, unusable
from sheetsplat.opacity_words import opacities_of
from sheetsplat.options.checks import optional
from sheetsplat.options.core import MODES, Option, definitions
from sheetsplat.options.quality import QUALITIES
from sheetsplat.options.renderer import RendererClassOptions
from sheetsplat.options.scene import SceneOptions
from sheetsplat.transfer import TransferFunction, color_limits, color_rows
from sheetsplat.viewer.label_look import LabelLook

Floats = NDArray[np.float64]
# Most rows of a curve, and most lights, planes and surfaces that a page may set.
MOST_ROWS = 1024
MOST_THINGS = 16
# Colours and opacities that differ less than this are one line in the editor.
_COLOR_STEP, _OPACITY_STEP = 0.03, 0.004
_MOST_HANDLES = 24


@dataclass(frozen=True, eq=False)
class Curves:
    """Colours and opacities of a transfer function, each linear between points of its own.

    Attributes
    ----------
    colors
        Rows (value, r, g, b), (N, 4).
    opacities
        Rows (value, opacity), (M, 2).
    cmap
        Name of the colormap that the colours are, or empty.
    shown
        Whether anything is shown; if not, all opacities are 0.
    """

    colors: Floats
    opacities: Floats
    cmap: str = ""
    shown: bool = True

    @classmethod
    def of(cls, function: TransferFunction, cmap: str = "") -> Curves:
        """Return the curves of a transfer function."""
        points = function.points
        return cls(points[:, :4], points[:, [0, 4]], cmap)

    def __eq__(self, other: object) -> bool:
        """Return whether all points and the name are the same."""
        if not isinstance(other, Curves):
            return NotImplemented
        same = np.array_equal(self.colors, other.colors) and np.array_equal(self.opacities, other.opacities)
        return same and (self.cmap, self.shown) == (other.cmap, other.shown)

    __hash__ = None  # type: ignore[assignment]

    @property
    def function(self) -> TransferFunction:
        """The transfer function."""
        return TransferFunction.from_curves(self.colors, self.seen)

    @property
    def seen(self) -> Floats:
        """Rows (value, opacity) of what is shown."""
        return self.opacities * (1.0, float(self.shown))

    @property
    def limits(self) -> tuple[float, float]:
        """Values of the first and the last colour."""
        return float(self.colors[0, 0]), float(self.colors[-1, 0])

    def changed(self, given: Mapping[str, Any]) -> Curves:
        """Return curves after the changes that a page asks for. InvalidInput where they have no meaning.

        Parameters
        ----------
        given
            Any of, done in this order: preset (name of a transfer function), range (two values to which colours and
            opacities are stretched), cmap (name), color (of the highest value; black is that of the lowest one), colors
            (rows), word (of opacities), opacity (rows), shown.
        """
        made = self
        if "preset" in given:
            made = Curves.of(TransferFunction.preset(given["preset"]))
        if "range" in given:
            made = made.stretched(*color_limits(given["range"]))
        if "cmap" in given:
            rows, (low, high) = color_rows(_cmap("view: cmap", given["cmap"])), made.limits
            made = replace(made, colors=_spread(rows[:, :3], low, high), cmap=given["cmap"])
        if "color" in given:
            ends = np.array([(0.0, 0.0, 0.0), _color("view: color", given["color"])])
            made = replace(made, colors=_spread(ends, *made.limits), cmap="")
        if "colors" in given:
            made = replace(made, colors=_rows("colors", given["colors"], 4), cmap="")
        if "word" in given:
            made = replace(made, opacities=opacities_of(_text("view: word", given["word"]), *made.limits))
        if "opacity" in given:
            made = replace(made, opacities=_rows("opacity", given["opacity"], 2))
        if "shown" in given:
            made = replace(made, shown=truth("view: shown", given["shown"]))
        return made

    def stretched(self, low: float, high: float) -> Curves:
        """Return curves whose colours begin and end at two values; the opacities move along."""
        start, end = self.limits
        factor = (high - low) / (end - start) if end > start else 1.0

        def moved(rows: Floats) -> Floats:
            return np.column_stack([low + (rows[:, 0] - start) * factor, rows[:, 1:]])

        return replace(self, colors=moved(self.colors), opacities=moved(self.opacities))


def _finite(what: str, value: object) -> float:
    found = number(what, value)
    if not math.isfinite(found):
        raise complain(unusable(what), f"{found:g}", "a finite number")
    return found


def _spread(rows: Floats, low: float, high: float) -> Floats:
    return np.column_stack([np.linspace(low, high, len(rows)), rows])


def _rows(what: str, given: object, columns: int) -> Floats:
    rows = given if fits(given, Sequence[Sequence[float]]) and isinstance(given, list) else []
    if not 0 < len(rows) <= MOST_ROWS or {*map(len, rows)} != {columns}:
        raise complain(unusable(f"view: {what}"), shown(given), f"at most {MOST_ROWS} rows of {columns} numbers")
    found = np.array(rows, np.float64)
    return found[np.argsort(found[:, 0], kind="stable")]


def _text(what: str, given: object) -> str:
    if not isinstance(given, str) or len(given) > 100:
        raise complain(unusable(what), shown(given), "a short text")
    return given


def _cmap(what: str, given: object) -> str:
    name = _text(what, given)
    color_rows(name)
    return name


def handles(rows: Floats, step: float) -> Floats:
    """Return the fewest of a curve's points between which it is linear up to `step`; at most a few dozen."""
    kept = [0, len(rows) - 1] if len(rows) > 1 else [0]
    while len(kept) < min(_MOST_HANDLES, len(rows)):
        worst, most = 0, step
        for first, last in itertools.pairwise(kept):
            there = _between(rows, first, last)
            away = np.abs(there - rows[first : last + 1, 1:]).max(axis=1)
            if away.max() > most:
                worst, most = first + int(away.argmax()), float(away.max())
        if not worst:
            break
        bisect.insort(kept, worst)
    return rows[kept]


def _between(rows: Floats, first: int, last: int) -> Floats:
    """Return what is on the straight line between two rows, at the values of all rows from one to the other."""
    values = rows[first : last + 1, 0]
    width = values[-1] - values[0]
    shares = (values - values[0]) / width if width > 0 else np.linspace(0.0, 1.0, len(values))
    start, end = rows[first, 1:], rows[last, 1:]
    found: Floats = start + shares[:, np.newaxis] * (end - start)
    return found


def color_handles(curves: Curves) -> Floats:
    """Return the points of the colours that the editor shows."""
    return handles(curves.colors, _COLOR_STEP)


def opacity_handles(curves: Curves) -> Floats:
    """Return the points of the opacities that the editor shows."""
    return handles(curves.opacities, _OPACITY_STEP)


def _surfaces(what: str, found: tuple[Surface, ...]) -> tuple[Surface, ...]:
    if not found:
        raise complain(unusable(what), "none", "at least one")
    return tuple(sorted(found, key=lambda one: one.value))


def _color(what: str, value: object) -> Triple:
    return triple(what, [min(max(part, 0.0), 1.0) for part in color(what, value)])


def _shows(what: str, found: Mapping[str, bool]) -> Mapping[str, bool]:
    if not found.keys() <= SHOWS.keys():
        raise complain(unusable(what), shown(found), "only: " + ", ".join(SHOWS))
    return {**SHOWS, **found}


def _measures(what: str, found: tuple[tuple[Triple, ...], ...]) -> tuple[tuple[Triple, ...], ...]:
    if not all(len(points) in (2, 3) for points in found):
        raise complain(unusable(what), shown(found), "two points each, of a distance, or three, of an angle")
    return found


@dataclass(frozen=True)
class Surface:
    """An isosurface: value, opacity, and its colour, or None for the automatic one."""

    value: float
    opacity: float = 1.0
    color: Triple | None = None

    def __post_init__(self) -> None:
        """Check and convert."""
        convert(self, value=_finite, opacity=share, color=optional(_color))


@dataclass(frozen=True)
class Cue:
    """A depth cue over the depths that the camera sees: how strong, and to which colour colours fade."""

    strength: float = 0.8
    color: Triple = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        """Check and convert."""
        convert(self, strength=share, color=_color)


@dataclass(frozen=True)
class State:
    """What is shown.

    Attributes
    ----------
    camera
        Where from.
    mode, quality
        The options of `render` of these names.
    choice, time
        Numbers of the data among those that the viewer was given.
    camera_of
        The choice whose data the camera was made for.
    changes
        What was changed of the scene that follows from data, mode and quality, by name; see `checked_changes`.
    curves
        Transfer functions, and colours of labels, that were changed, by number of the group.
    settings
        Options of the renderer that were changed: max_error, max_seconds, effects.
    """

    camera: Camera
    mode: str = MODES[0]
    quality: str = "good"
    choice: int = 0
    time: int = 0
    changes: Mapping[str, Any] = field(default_factory=dict)
    curves: Mapping[int, Curves | LabelLook] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    camera_of: int = 0

    def changed(self, name: str, value: object) -> State:
        """Return the state with one thing changed. InvalidInput where the name is unknown or the value no use."""
        if name == "camera":
            return replace(self, camera=_camera(value), camera_of=self.choice)
        if name in ("mode", "quality"):
            found = choice(f"view: {name}", value, MODES if name == "mode" else QUALITIES)
            return replace(self, mode=found) if name == "mode" else replace(self, quality=found)
        if name in _SETTINGS:
            return replace(self, settings={**self.settings, name: _read(_SETTINGS[name], value)})
        if name in _CHANGES:
            return replace(self, changes={**self.changes, name: _read(_CHANGES[name], value)})
        raise complain("view: there is no such setting", shown(name))

    def numbered(self, name: str, value: object, count: int) -> State:
        """Return the state with another number of the data, below a count."""
        number_of = whole(f"view: {name}", value)
        if not 0 <= number_of < count:
            raise complain(unusable(f"view: {name}"), str(number_of), f"from 0 to below {count}")
        if name == "time":
            return replace(self, time=number_of)
        return self if number_of == self.choice else replace(self, choice=number_of, time=0, curves={})

    @property
    def drawn(self) -> State:
        """The state without what the page draws over the picture: states that are the same so have one picture."""
        return replace(self, changes={name: one for name, one in self.changes.items() if name not in OF_PAGES})

    def with_curves(self, group: int, curves: Curves | LabelLook | None) -> State:
        """Return the state with the curves of a group changed; None: as they were at first."""
        others = {n: one for n, one in self.curves.items() if n != group}
        return replace(self, curves=others if curves is None else {**others, group: curves})


def _camera(value: object) -> Camera:
    names = {"kind", *CAMERAS["orthographic"], *CAMERAS["perspective"]}
    if not isinstance(value, dict) or not value.keys() <= names:
        raise complain(unusable("view: camera"), shown(value), "only: " + ", ".join(sorted(names)))
    kind = choice("view: camera", value.get("kind"), ("orthographic", "perspective"))
    return camera_of({name: value[name] for name in ("kind", *CAMERAS[kind]) if value.get(name) is not None}, "kind")


def camera_parts(camera: Camera) -> dict[str, Any]:
    """Return a camera as the page knows it: with the upward axis of the picture, without a near plane."""
    parts = {"kind": camera.kind, **eye_parts(camera), "up": camera.world_axes()[1]}
    if parts.pop("near", None) is not None:
        parts["shift"] = camera.shift
    return parts


_COLOR, _OPEN_COLOR = Sequence[float] | str, Sequence[float] | str | None
#: Options of `Scene` that a page changes as they are.
OF_SCENES = (
    *("scalar_colors", "lights", "material", "shadows", "ambient_occlusion", "gradient_opacity", "clip"),
    *("slice_planes", "cut_faces"),
)
#: What the page draws over the picture, and whether it does unless that was changed.
SHOWS = {"box": False, "directions": True, "bars": True, "scale": False}
#: Changes that are no part of the picture.
OF_PAGES = ("shows", "measures")
#: Options of `render` by which another array of the data gives the colours: its name, and its colormap.
OF_COLORING = ("color_by", "color_map")
_CHANGES = {
    **{name: definitions(SceneOptions)[name] for name in OF_SCENES},
    "color_by": Option("", name="color_by", type=str | None, check=optional(_text)),
    "color_map": Option("", name="color_map", type=str, check=_cmap),
    "surfaces": Option("", name="surfaces", type=Sequence[Surface], check=_surfaces),
    "depth_cue": Option("", name="depth_cue", type=Cue | None),
    "background": Option("", name="background", type=_OPEN_COLOR, check=optional(_color)),
    # What the page shows behind transparent pixels; no part of the picture.
    "backdrop": Option("", name="backdrop", type=_COLOR, check=_color),
    "shows": Option("", name="shows", type=Mapping[str, bool], check=_shows),
    "measures": Option("", name="measures", type=Sequence[Sequence[tuple[float, float, float]]], check=_measures),
}
_SETTINGS = {name: definitions(RendererClassOptions)[name] for name in ("max_error", "max_seconds", "effects")}


def _read(option: Option, value: Any) -> Any:
    """Return the value of an option that a page sends."""
    for part in (value, *value.values()) if isinstance(value, dict) else (value,):
        if isinstance(part, list) and len(part) > MOST_THINGS:
            raise complain(unusable(f"view: {option.name}"), shown(value), f"lists of at most {MOST_THINGS}")
    found = tuples(value_of(option, value))
    return found if option.check is None else option.check(f"view: {option.name}", found)
