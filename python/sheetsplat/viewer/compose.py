"""From the state of a viewer to the scene that it shows, and back to what the page shows of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sheetsplat._checks import Triple, triple
from sheetsplat.api import Prepared
from sheetsplat.camera import Camera
from sheetsplat.choose.asked import GOALS, Asked
from sheetsplat.choose.look import is_channel, is_labelled
from sheetsplat.choose.picture import fitted
from sheetsplat.describe.schema import plain
from sheetsplat.fields import RegularField, joined_bounds
from sheetsplat.framing import fitting_depth_cue
from sheetsplat.labels import LabelColors
from sheetsplat.look.channel_light import is_light
from sheetsplat.look.surface import surface_color, surface_limits
from sheetsplat.modes import TRAITS
from sheetsplat.opacity_words import PRESETS, WORDS
from sheetsplat.options.core import MODES
from sheetsplat.options.look import DEFAULT_CMAP
from sheetsplat.options.picture import unused
from sheetsplat.scene import Scene
from sheetsplat.slice_planes import PLANE_CMAP, with_colors
from sheetsplat.transfer import TransferFunction, color_rows
from sheetsplat.viewer.data import Histogram, Shown
from sheetsplat.viewer.label_look import LabelLook
from sheetsplat.viewer.state import (
    OF_COLORING,
    OF_SCENES,
    SHOWS,
    Cue,
    Curves,
    State,
    Surface,
    camera_parts,
    color_handles,
    opacity_handles,
)

#: Colormaps that the page offers, besides the one that was given.
COLORMAPS = (
    *("viridis", "plasma", "inferno", "magma", "cividis", "turbo", "gray", "gray_r", "matlab:bone", "matlab:hot"),
    *("matlab:copper", "matplotlib:coolwarm", "colorbrewer:RdBu_r", "cmocean:ice", "cmocean:thermal", "crameri:batlow"),
)
_RAMP = 48
# Who gives one of them decides on the light of cut faces.
_LIGHTS = {"lights", "material", "cut_faces"}


def base_of(shown: Shown, state: State) -> Prepared:
    """Return the scene and the camera of a state before anything was changed."""
    return shown.base(state.choice, state.time, state.mode, state.quality, coloring_of(shown, state))


def scene_of(shown: Shown, state: State) -> Scene:
    """Return the scene that a state shows. Raises what the data and `Scene` raise."""
    base = base_of(shown, state).scene
    changes = dict(state.drawn.changes)
    cue: Cue | None = changes.pop("depth_cue", None)
    surfaces: tuple[Surface, ...] | None = changes.pop("surfaces", None)
    for name in ("backdrop", *OF_COLORING):
        changes.pop(name, None)
    if "slice_planes" in changes:
        own = shown.options.get("slice_cmap", PLANE_CMAP), shown.options.get("slice_clim")
        changes["slice_planes"] = with_colors(changes["slice_planes"], *own)
    # They come back with a mode that uses them.
    for name in unused(base.mode, list(changes)):
        del changes[name]
    functions = list(base.transfer_functions)
    for n in [n for n in state.curves if n < len(functions) and has_look(base, n)]:
        functions[n] = state.curves[n].function
    if surfaces is not None and TRAITS[base.mode].shows_surfaces:
        changes["iso_value"] = tuple((one.value, one.opacity) for one in surfaces)
        functions = _functions_of(shown, base, functions, surfaces)
    if tuple(functions) != tuple(base.transfer_functions) or "iso_value" in changes:
        changes["transfer_function"] = functions if len(functions) > 1 else functions[0]
    if "depth_cue" in state.changes and not unused(base.mode, ["depth_cue"]):
        changes["depth_cue"] = None if cue is None else fitting_depth_cue(base, state.camera, cue.color, cue.strength)
    if changes.get("clip") and base.lights and _faces_follow(shown, state):
        # As `render` decides on a clip that is given; lights that are moved stay those of the viewer.
        changes.setdefault("cut_faces", True)
    if not changes:
        return base
    return base.replace(**changes).with_quality(base.quality)


def _faces_follow(shown: Shown, state: State) -> bool:
    """Return whether faces of cuts are lit as such where the page cuts, as nobody gave a light or the faces."""
    return not _LIGHTS & shown.options.keys() and not _is_scene(shown, state)


def _is_scene(shown: Shown, state: State) -> bool:
    """Return whether the caller made the scene."""
    return isinstance(shown.data(state.choice, state.time), Scene)


def drawn_scene(shown: Shown, state: State, size: tuple[int, int]) -> Scene:
    """Return the scene that a state shows in pictures of a size."""
    return fitted_scene(shown, state, scene_of(shown, state), size)


def fitted_scene(shown: Shown, state: State, scene: Scene, size: tuple[int, int]) -> Scene:
    """Return a scene of a state as pictures of a size have it."""
    if _is_scene(shown, state):
        return scene
    given: dict[str, Any] = {**shown.options_at(state.choice, state.time), "quality": state.quality}
    # A goal decides when the picture is drawn.
    asked = Asked.of("quality", {name: value for name, value in given.items() if name not in GOALS})
    return fitted(scene, asked, state.camera, size)


def other_camera(shown: Shown, state: State, scene: Scene, size: tuple[int, int], *, unmoved: bool) -> Camera:
    """Return the camera for other data than the state's was made for; data in the same place keep it.

    `unmoved`: nobody has turned the first view, so that the other data have their own.
    """
    camera = state.camera
    if scene.bounds == base_of(shown, replace(state, choice=state.camera_of)).scene.bounds:
        return camera
    if unmoved:
        return shown.camera(scene, size)
    direction = np.subtract(camera.target, camera.eye).tolist()
    return camera_towards(shown, state, size, direction, camera.world_axes()[1], camera.kind)


def camera_towards(
    shown: Shown,
    state: State,
    size: tuple[int, int],
    direction: Sequence[float] | None = None,
    up: Sequence[float] | None = None,
    kind: str | None = None,
) -> Camera:
    """Return the first camera of a state's data, but for a direction of view, one upwards and a kind of projection."""
    changes: dict[str, Any] = {}
    if kind:
        changes["projection"] = kind
    if direction:
        changes |= {"direction": direction, "azimuth": 0.0, "elevation": 0.0, "zoom": 1.0}
    if up:
        changes["up"] = up
    return shown.camera(scene_of(shown, state), size, **changes)


def _functions_of(
    shown: Shown, scene: Scene, known: Sequence[TransferFunction], surfaces: tuple[Surface, ...]
) -> list[TransferFunction]:
    """Return transfer functions that give each surface its colour; labels keep theirs."""
    functions: list[TransferFunction] = []
    for n, own in enumerate(known):
        if isinstance(own, LabelColors):
            functions.append(own)
            continue
        automatic = _surface_function(shown, scene, surfaces) if n == 0 and _is_automatic(shown) else own
        rows: dict[float, Triple] = {}
        for one in surfaces:
            rows[one.value] = triple("", automatic.at([one.value])[0, :3]) if one.color is None else one.color
        functions.append(TransferFunction([(value, *color, 1.0) for value, color in rows.items()]))
    return functions


def _is_automatic(shown: Shown) -> bool:
    """Return whether colours of surfaces follow from their values."""
    return not {"transfer_function", "clim"} & shown.options.keys() and not isinstance(shown.data(0, 0), Scene)


def _surface_function(shown: Shown, scene: Scene, surfaces: tuple[Surface, ...]) -> TransferFunction:
    limits = surface_limits(scene.fields, tuple((one.value, one.opacity) for one in surfaces))
    if limits is None:
        return scene.transfer_function
    return TransferFunction.from_colormap(shown.options.get("cmap", DEFAULT_CMAP), 1.0, limits)


def has_look(scene: Scene, group: int) -> bool:
    """Return whether a scene shows the transfer function of a group: of surfaces those of labels alone."""
    labels = isinstance(scene.transfer_functions[group], LabelColors)
    return TRAITS[scene.mode].is_composited or is_light(scene) or (labels and TRAITS[scene.mode].shows_surfaces)


def has_looks(scene: Scene) -> bool:
    """Return whether a scene shows the transfer function of any of its groups."""
    return any(has_look(scene, n) for n in range(len(scene.groups)))


def coloring_of(shown: Shown, state: State) -> dict[str, Any]:
    """Return the options of `render` that say which other array gives the colours, as far as they were changed."""
    changed = {name: state.changes[name] for name in OF_COLORING if name in state.changes}
    given = {**dict.fromkeys(OF_COLORING), **shown.options_at(state.choice, state.time), **changed}
    # The choice comes back with data that have such an array.
    known = "color_by" not in changed or changed["color_by"] in shown.names_of_arrays(state.choice)
    if known and given["color_by"] is not None:
        return {name: given[name] for name in OF_COLORING} if changed else {}
    return dict.fromkeys(OF_COLORING) if changed else {}


def curves_of(shown: Shown, state: State, group: int) -> Curves | LabelLook:
    """Return the curves of a group's transfer function, or the look of labels: changed, or the data's own."""
    if group in state.curves:
        return state.curves[group]
    scene = shown.base(state.choice, state.time, MODES[0], state.quality).scene
    function, field = scene.transfer_functions[group], scene.groups[group][0]
    if isinstance(field, RegularField) and field.labels:
        return LabelLook.of(function, field.labels_found)
    given = shown.options.get("cmap", DEFAULT_CMAP)
    is_map = isinstance(given, str) and "," not in given and "transfer_function" not in shown.options
    is_map = is_map and not is_channel(field)
    return Curves.of(function, given if is_map and not isinstance(shown.data(0, 0), Scene) else "")


def hexadecimal(color: Any) -> str:
    """Return "#rrggbb" of red, green and blue from 0 to 1."""
    return "#" + "".join(f"{int(min(max(float(part), 0.0), 1.0) * 255 + 0.5):02x}" for part in color[:3])


def _ramp(function: TransferFunction, low: float, high: float) -> list[str]:
    return [hexadecimal(row) for row in function.at(np.linspace(low, high, _RAMP))]


def _look(curves: Curves | LabelLook) -> dict[str, Any]:
    if isinstance(curves, LabelLook):
        told = [
            [label, curves.first.name_of(label), hexadecimal(rgba), rgba[3], label not in curves.hidden]
            for label, rgba in curves.colors.items()
        ]
        return {"labels": told, "shown": curves.shown, "color": None}
    low, high = curves.limits
    return {
        "labels": None,
        "shown": curves.shown,
        "color": hexadecimal(curves.colors[-1, 1:]),
        "range": [low, high],
        "cmap": curves.cmap,
        "ramp": _ramp(curves.function, low, high),
        "colors": [[row[0], hexadecimal(row[1:])] for row in color_handles(curves).tolist()],
        "opacity": opacity_handles(curves).tolist(),
    }


def _named(given: object) -> str | None:
    """Return a name, "given in Python" for what has none, None for nothing."""
    return given if given is None or isinstance(given, str) else "given in Python"


def state_parts(shown: Shown, state: State, scene: Scene) -> dict[str, Any]:
    """Return what the page shows of a state in its panels."""
    options: Mapping[str, Any] = scene.options
    colors = options["scalar_colors"]
    cue = state.changes["depth_cue"] if "depth_cue" in state.changes else options["depth_cue"]
    coloring = {**shown.options_at(state.choice, state.time), **coloring_of(shown, state)}
    own = {one.value: one.color for one in state.changes.get("surfaces", ())}
    return {
        "mode": state.mode,
        "fold": TRAITS[state.mode].fold,
        "quality": state.quality,
        "choice": state.choice,
        "time": state.time,
        "camera": camera_parts(state.camera),
        # None: surfaces in place of a transfer function.
        "looks": [_look(curves_of(shown, state, n)) if has_look(scene, n) else None for n in range(len(scene.groups))]
        if has_looks(scene)
        else [],
        "surfaces": [
            {
                "value": value,
                "opacity": opacity,
                "color": hexadecimal(surface_color(scene, value)),
                "automatic": own.get(value) is None,
            }
            for value, opacity in scene.surfaces
        ],
        **{name: plain(options[name]) for name in OF_SCENES},
        "faces_follow": _faces_follow(shown, state),
        "color_by": _named(coloring.get("color_by")),
        "color_map": _named(coloring.get("color_map", DEFAULT_CMAP) or DEFAULT_CMAP),
        "scalar_colors": {**plain(colors), "cmap": colors.cmap if isinstance(colors.cmap, str) else ""},
        "depth_cue": None if cue is None else {"strength": cue.strength, "color": hexadecimal(cue.color)},
        "background": None if scene.background is None else hexadecimal(scene.background),
        "backdrop": hexadecimal(state.changes.get("backdrop", (0.0, 0.0, 0.0))),
        "shows": state.changes.get("shows", SHOWS),
        "measures": state.changes.get("measures", ()),
        "max_error": state.settings.get("max_error", shown.options.get("max_error")),
        "max_seconds": state.settings.get("max_seconds", shown.options.get("max_seconds")),
        "effects": state.settings.get("effects", shown.options.get("effects") or {}),
        "changed": sorted({*state.changes, *state.settings, *(["look"] if state.curves else [])}),
    }


def data_parts(shown: Shown, state: State, scene: Scene) -> dict[str, Any]:
    """Return what the page needs to know of the data."""
    found: list[Histogram] = shown.histograms(state.choice, state.time)
    groups = []
    for fields, histogram in zip(scene.groups, found, strict=True):
        quantity = fields[0].quantity
        label = quantity.label if quantity.name or not is_labelled(fields[0]) else "labels"
        parts = {"label": label, "floor": quantity.floor, "unit": quantity.unit}
        groups.append({**parts, "low": histogram.low, "high": histogram.high, "counts": histogram.counts})
    lower, upper = scene.bounds
    # The box around the data themselves, where it has an extent.
    boxes = [one.centre_bounds for one in scene.fields if one.size]
    inner = joined_bounds(boxes) if boxes else scene.bounds
    box = inner if all(low < high for low, high in zip(*inner, strict=True)) else scene.bounds
    return {
        "title": shown.title(state.choice, state.time),
        "names": shown.names,
        "color_names": shown.names_of_arrays(state.choice),
        "times": shown.times,
        "bounds": [lower, upper],
        "box": box,
        "length_unit": scene.fields[0].quantity.length_unit,
        "groups": groups,
        "diagonal": float(np.linalg.norm(np.subtract(upper, lower))),
        "fixed_quality": isinstance(shown.data(state.choice, state.time), Scene),
    }


def offered() -> dict[str, Any]:
    """Return the names that the page offers for modes, colours and opacities."""
    ramps = {}
    for name in COLORMAPS:
        rows = color_rows(name)
        ramps[name] = [hexadecimal(row) for row in rows[np.linspace(0, len(rows) - 1, 12).astype(int)]]
    words = [word for word in WORDS if not word.startswith("sigmoid_") or word in ("sigmoid_5", "sigmoid_10")]
    modes = [[mode.name, mode.label] for mode in TRAITS.values()]
    return {
        "modes": modes,
        "colormaps": ramps,
        "words": [*words, "isolayers:4", "isolayers:8"],
        "presets": list(PRESETS),
    }
