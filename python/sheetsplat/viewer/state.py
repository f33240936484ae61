"""What a viewer shows, beside the data: everything that its page can change, checked when it changes."""

from __future__ import annotations

import bisect
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import Triple, choice, color, number, share, shown, triple, truth, whole
from sheetsplat.camera import Camera
from sheetsplat.effects import AmbientOcclusion, Clip, DepthCue
from sheetsplat.errors import complain, unusable
from sheetsplat.light import Light, Material
from sheetsplat.opacity_words import opacities_of
from sheetsplat.options.core import MODES
from sheetsplat.options.quality import QUALITIES
from sheetsplat.scalar_colors import ScalarColors
from sheetsplat.transfer import TransferFunction, color_limits, color_rows

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
    """

    colors: Floats
    opacities: Floats
    cmap: str = ""

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
        return same and self.cmap == other.cmap

    __hash__ = None  # type: ignore[assignment]

    @property
    def function(self) -> TransferFunction:
        """The transfer function."""
        return TransferFunction.from_curves(self.colors, self.opacities)

    @property
    def limits(self) -> tuple[float, float]:
        """Values of the first and the last colour."""
        return float(self.colors[0, 0]), float(self.colors[-1, 0])

    def changed(self, given: Mapping[str, Any]) -> Curves:
        """Return curves after the changes that a page asks for. InvalidInput where they have no meaning.

        Parameters
        ----------
        given
            Any of: preset (name of a transfer function), cmap (name), range (two values to which colours and opacities
            are stretched), colors (rows), opacity (rows), word (of opacities).
        """
        made = self
        if "preset" in given:
            made = Curves.of(TransferFunction.preset(given["preset"]))
        if "cmap" in given:
            rows, (low, high) = color_rows(_text("cmap", given["cmap"])), made.limits
            made = replace(made, colors=_spread(rows[:, :3], low, high), cmap=given["cmap"])
        if "colors" in given:
            made = replace(made, colors=_rows("colors", given["colors"], 4), cmap="")
        if "word" in given:
            made = replace(made, opacities=opacities_of(_text("word", given["word"]), *made.limits))
        if "opacity" in given:
            made = replace(made, opacities=_rows("opacity", given["opacity"], 2))
        if "range" in given:
            made = made.stretched(*color_limits(given["range"]))
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
    wanted = f"at most {MOST_ROWS} rows of {columns} numbers"
    good = isinstance(given, list) and 0 < len(given) <= MOST_ROWS
    rows = given if isinstance(given, list) else []
    if not good or any(not isinstance(row, list) or len(row) != columns for row in rows):
        raise complain(unusable(f"view: {what}"), shown(given), wanted)
    found = np.array([[_finite(f"view: {what}", part) for part in row] for row in rows])
    return found[np.argsort(found[:, 0], kind="stable")]


def _text(what: str, given: object) -> str:
    if not isinstance(given, str) or len(given) > 100:
        raise complain(unusable(f"view: {what}"), shown(given), "a short text")
    return given


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


@dataclass(frozen=True)
class Surface:
    """An isosurface: value, opacity, and its colour, or None for the automatic one."""

    value: float
    opacity: float = 1.0
    color: Triple | None = None


@dataclass(frozen=True)
class Cue:
    """A depth cue over the depths that the camera sees: how strong, and to which colour colours fade."""

    strength: float = 0.8
    color: Triple = (0.0, 0.0, 0.0)

    @classmethod
    def of(cls, cue: DepthCue) -> Cue:
        """Return strength and colour of a depth cue."""
        return cls(cue.strength, triple("", cue.color))


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
    changes
        What was changed of the scene that follows from data, mode and quality, by name; see `checked_changes`.
    curves
        Transfer functions that were changed, by number of the group.
    settings
        Options of the renderer that were changed: max_error, max_seconds, effects.
    """

    camera: Camera
    mode: str = "composite"
    quality: str = "good"
    choice: int = 0
    time: int = 0
    changes: Mapping[str, Any] = field(default_factory=dict)
    curves: Mapping[int, Curves] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)

    def changed(self, name: str, value: object) -> State:
        """Return the state with one thing changed. InvalidInput where the name is unknown or the value no use."""
        if name == "camera":
            return replace(self, camera=_camera(value))
        if name == "mode":
            return replace(self, mode=choice("view: mode", value, MODES))
        if name == "quality":
            return replace(self, quality=choice("view: quality", value, QUALITIES))
        if name in _SETTINGS:
            return replace(self, settings={**self.settings, name: _SETTINGS[name](value)})
        if name in _CHANGES:
            return replace(self, changes={**self.changes, name: _CHANGES[name](value)})
        raise complain("view: there is no such setting", shown(name))

    def numbered(self, name: str, value: object, count: int) -> State:
        """Return the state with another number of the data, below a count."""
        number_of = whole(f"view: {name}", value)
        if not 0 <= number_of < count:
            raise complain(unusable(f"view: {name}"), str(number_of), f"from 0 to below {count}")
        if name == "time":
            return replace(self, time=number_of)
        return self if number_of == self.choice else replace(self, choice=number_of, time=0, curves={})

    def with_curves(self, group: int, curves: Curves | None) -> State:
        """Return the state with the curves of a group changed; None: as they were at first."""
        others = {n: one for n, one in self.curves.items() if n != group}
        return replace(self, curves=others if curves is None else {**others, group: curves})


def _mapping(what: str, value: object, names: Sequence[str], needed: Sequence[str] = ()) -> Mapping[str, Any]:
    if not isinstance(value, dict) or set(value) - set(names):
        raise complain(unusable(f"view: {what}"), shown(value), "only: " + ", ".join(names))
    if any(value.get(name) is None for name in needed):
        raise complain(unusable(f"view: {what}"), shown(value), "also: " + ", ".join(needed))
    return MappingProxyType(value)


def _list(what: str, value: object) -> list[Any]:
    if not isinstance(value, list) or len(value) > MOST_THINGS:
        raise complain(unusable(f"view: {what}"), shown(value), f"a list of at most {MOST_THINGS}")
    return value


def _camera(value: object) -> Camera:
    given = _mapping("camera", value, ("kind", "eye", "target", "up", "height", "fov_y", "near", "shift"))
    kind = choice("view: camera", given.get("kind"), ("orthographic", "perspective"))
    needed = ("eye", "target", "height" if kind == "orthographic" else "fov_y")
    _mapping("camera", value, tuple(given), needed)
    names = (*needed, "up", *(("near", "shift") if kind == "perspective" else ()))
    return Camera.of_arguments(kind, {name: given[name] for name in names if given.get(name) is not None})


def camera_parts(camera: Camera) -> dict[str, Any]:
    """Return a camera as the page knows it."""
    parts = {"kind": camera.kind, "eye": camera.eye, "target": camera.target, "up": camera.world_axes()[1]}
    if camera.kind == "orthographic":
        return {**parts, "height": camera.height}
    return {**parts, "fov_y": camera.fov_y, "shift": camera.shift}


def _optional(check: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda value: None if value is None else check(value)


def _positive(what: str) -> Callable[[Any], float]:
    def check(value: object) -> float:
        found = number(f"view: {what}", value)
        if not 0.0 < found < math.inf:
            raise complain(unusable(f"view: {what}"), f"{found:g}", "a finite number above 0")
        return found

    return check


def _surface(value: object) -> Surface:
    given = _mapping("surfaces", value, ("value", "opacity", "color"))
    own = given.get("color")
    place = _finite("view: surfaces", given.get("value"))
    return Surface(place, share("view: surfaces", given.get("opacity", 1.0)), None if own is None else _color(own))


def _surfaces(value: object) -> tuple[Surface, ...]:
    found = tuple(map(_surface, _list("surfaces", value)))
    if not found:
        raise complain(unusable("view: surfaces"), "none", "at least one")
    return tuple(sorted(found, key=lambda one: one.value))


def _color(value: object) -> Triple:
    found = color("view: a colour", value)
    return triple("view: a colour", [min(max(part, 0.0), 1.0) for part in found])


def _scalar_colors(value: object) -> ScalarColors:
    given = _mapping("scalar_colors", value, ("cmap", "clim", "log"))
    return ScalarColors(_text("cmap", given.get("cmap", "gray")), given.get("clim"), given.get("log", False))


def _light(value: object) -> Light:
    return Light(**_mapping("lights", value, ("direction", "color", "space")))


def _lights(value: object) -> tuple[Light, ...]:
    return tuple(map(_light, _list("lights", value)))


def _material(value: object) -> Material:
    given = _mapping("material", value, ("ambient", "diffuse", "specular", "shininess", "two_sided"))
    return Material(**given)


def _occlusion(value: object) -> AmbientOcclusion:
    return AmbientOcclusion(**_mapping("ambient_occlusion", value, ("radius", "strength"), ("radius",)))


def _cue(value: object) -> Cue:
    given = _mapping("depth_cue", value, ("strength", "color"))
    return Cue(share("view: depth_cue", given.get("strength", 0.8)), _color(given.get("color", (0, 0, 0))))


def _clip(value: object) -> Clip:
    given = _mapping("clip", value, ("planes", "box"))
    return Clip(_list("clip", given.get("planes") or []), given.get("box"))


def _effects(value: object) -> dict[str, bool]:
    if not isinstance(value, dict) or len(value) > 200:
        raise complain(unusable("view: effects"), shown(value), "names with true or false")
    return {_text("effects", name): truth("view: effects", on) for name, on in value.items()}


_CHANGES: dict[str, Callable[[Any], Any]] = {
    "surfaces": _surfaces,
    "scalar_colors": _scalar_colors,
    "lights": _lights,
    "material": _material,
    "shadows": lambda value: truth("view: shadows", value),
    "ambient_occlusion": _optional(_occlusion),
    "depth_cue": _optional(_cue),
    "gradient_opacity": _optional(_positive("gradient_opacity")),
    "clip": _clip,
    "background": _optional(_color),
    # What the page shows behind transparent pixels; no part of the picture.
    "backdrop": _color,
}
_SETTINGS: dict[str, Callable[[Any], Any]] = {
    "max_error": _optional(_positive("max_error")),
    "max_seconds": _optional(_positive("max_seconds")),
    "effects": _effects,
}
