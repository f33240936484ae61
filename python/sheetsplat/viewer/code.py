"""The Python that makes the picture which a viewer shows."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from sheetsplat.describe.python import Expression, call, rows_text, text_of
from sheetsplat.fields import Field, RegularField
from sheetsplat.modes import TRAITS
from sheetsplat.options.camera import CameraOptions
from sheetsplat.options.core import MODES, definitions
from sheetsplat.options.picture import unused
from sheetsplat.scene import Scene
from sheetsplat.slice_planes import OF_PLANES
from sheetsplat.transfer import TransferFunction
from sheetsplat.viewer import compose
from sheetsplat.viewer.data import DEFAULT_QUALITY, Shown
from sheetsplat.viewer.label_look import LabelLook
from sheetsplat.viewer.state import Curves, State

# Options that a transfer function of its own replaces, and those of the camera.
_OF_COLORS = ("cmap", "opacity", "clim", "transfer_function")
_OF_CAMERA = ("camera", *definitions(CameraOptions))
_SAVED = 'image.save("picture.png")'


def python_code(shown: Shown, state: State, size: tuple[int, int]) -> str:
    """Return Python that makes the picture of a state; what was no plain value stays a name that a comment explains."""
    data = shown.data(state.choice, state.time)
    scene = compose.drawn_scene(shown, state, size)
    if isinstance(data, Scene):
        lines = _of_scene(shown, state, scene, size)
    else:
        path = repr(os.fsdecode(data)) if isinstance(data, str | os.PathLike) else None
        options = _with_curves(state, scene, arguments(shown, state, scene, size))
        drawn, unknown = call("image = ss.render", [path or "data"], options)
        given = ["# data: what was shown"] if path is None else []
        lines = [*given, *(f"# {name}: what the viewer was given" for name in unknown), *drawn]
    return "\n".join(["import sheetsplat as ss", "", *lines, _SAVED, ""])


def _of_scene(shown: Shown, state: State, scene: Scene, size: tuple[int, int]) -> list[str]:
    """Return the code for a scene that was given."""
    changes = _with_curves(state, scene, _changes(state, scene))
    if state.mode != shown.base(state.choice, state.time).scene.mode:
        changes = {"mode": state.mode, "iso_value": scene.iso_value, **changes}
    replaced = call("scene = scene.replace", [], changes)[0] if changes else []
    renderer = ", ".join(f"{name}={text_of(value)}" for name, value in _settings(shown, state).items())
    drawn = f"image = ss.Renderer({renderer}).render(scene, camera, size={size})"
    return ["# scene: what was shown", *replaced, f"camera = {text_of(state.camera)}", drawn]


def _settings(shown: Shown, state: State) -> dict[str, Any]:
    found = {**shown.renderer_options(), **state.settings}
    return {name: value for name, value in found.items() if value not in (None, {})}


def arguments(shown: Shown, state: State, scene: Scene, size: tuple[int, int]) -> dict[str, Any]:
    """Return the keyword arguments of `render` that make the picture of a state from its data."""
    coloring = compose.coloring_of(shown, state)
    given = {**shown.options_at(state.choice, state.time), **coloring}
    given = {name: value for name, value in given.items() if name not in coloring or value is not None}
    options = {name: value for name, value in given.items() if name not in (*_OF_CAMERA, "size", "depth_cue")}
    options = {name: value for name, value in options.items() if not unused(state.mode, [name])}
    if not scene.options["slice_planes"]:
        options = {name: value for name, value in options.items() if name not in OF_PLANES}
    options |= {"mode": state.mode, "quality": state.quality, **_settings(shown, state)}
    options = {name: value for name, value in options.items() if (name, value) not in _DEFAULTS}
    if isinstance(shown.options.get("depth_cue"), str) or "depth_cue" in state.changes:
        options["depth_cue"] = scene.options["depth_cue"]
    elif "depth_cue" in shown.options and not unused(state.mode, ["depth_cue"]):
        options["depth_cue"] = shown.options["depth_cue"]
    changes = _changes(state, scene)
    if {"clip", "lights", "material"} & changes.keys() and TRAITS[scene.mode].is_composited:
        # What render would choose by them.
        options["cut_faces"] = scene.options["cut_faces"]
    if "transfer_function" in changes:
        for name in _OF_COLORS:
            options.pop(name, None)
        # What render would choose by colours and opacities that it does not choose now.
        floors = {one.quantity.floor for one in scene.fields} - {None}
        made = isinstance(shown.data(state.choice, state.time), Field)
        if len(floors) == 1 and "log" not in options and not made:
            options["log"] = floors.pop()
        lengths = {"slice_spacing": scene.slice_spacing, "reference_length": scene.reference_length}
        options |= {name: value for name, value in lengths.items() if not unused(scene.mode, [name])}
        if scene.supersampling > 1:
            # With slices that are given a quality leaves one.
            options["supersampling"] = scene.supersampling
    if not all(isinstance(one, RegularField) for one in scene.fields):
        options["filter"] = scene.filter or "off"
    return {**options, **changes, "camera": state.camera, "size": size}


_DEFAULTS = (("mode", MODES[0]), ("quality", DEFAULT_QUALITY))


def _changes(state: State, scene: Scene) -> dict[str, Any]:
    """Return what was changed in the viewer, as the scene has it now."""
    found = {
        name: scene.options[name]
        for name in state.changes
        if name in scene.options and name != "depth_cue" and not unused(scene.mode, [name])
    }
    # Later times have the look of the first one.
    later = state.time > 0
    if ("surfaces" in state.changes or later) and TRAITS[scene.mode].shows_surfaces:
        found["iso_value"] = scene.iso_value
        found["transfer_function"] = _functions_of(scene)
    if (state.curves or later) and compose.has_looks(scene):
        found["transfer_function"] = _functions_of(scene)
    if later and TRAITS[scene.mode].is_scalar:
        found |= {"scalar_colors": scene.options["scalar_colors"], "slice_spacing": scene.slice_spacing}
    return found


def _functions_of(scene: Scene) -> TransferFunction | list[TransferFunction]:
    functions = list(scene.transfer_functions)
    return functions if len(functions) > 1 else functions[0]


def _with_curves(state: State, scene: Scene, options: dict[str, Any]) -> dict[str, Any]:
    """Return options with transfer functions as Python that makes them of their curves."""
    if "transfer_function" not in options:
        return options
    curves = {n: one for n, one in state.curves.items() if compose.has_look(scene, n)}
    return {**options, "transfer_function": _functions(scene.transfer_functions, curves)}


def _functions(functions: tuple[TransferFunction, ...], curves: Mapping[int, Curves | LabelLook]) -> Expression:
    texts = [_function(one, curves.get(n)) for n, one in enumerate(functions)]
    return Expression(texts[0] if len(texts) == 1 else f"[{', '.join(texts)}]")


def _function(function: TransferFunction, curves: Curves | LabelLook | None) -> str:
    if not isinstance(curves, Curves):
        return text_of(function)
    if curves.cmap:
        # Beyond its limits a colormap has one colour.
        inside = np.flatnonzero(np.any(np.diff(curves.colors[:, 1:], axis=0) != 0, axis=1))
        ends = (inside[0], inside[-1] + 1) if inside.size else (0, -1)
        low, high = (float(curves.colors[n, 0]) for n in ends)
        if low < high and TransferFunction.from_colormap(curves.cmap, curves.seen, (low, high)) == function:
            opacities = rows_text(curves.seen)
            return f"ss.TransferFunction.from_colormap({curves.cmap!r}, {opacities}, ({low!r}, {high!r}))"
    return f"ss.TransferFunction.from_curves({rows_text(curves.colors)}, {rows_text(curves.seen)})"
