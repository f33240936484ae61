"""The Python that makes the picture which a viewer shows."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from sheetsplat.camera import Camera
from sheetsplat.fields import Field, RegularField
from sheetsplat.options.camera import CameraOptions
from sheetsplat.options.core import definitions
from sheetsplat.scene import Scene
from sheetsplat.transfer import TransferFunction
from sheetsplat.viewer import compose
from sheetsplat.viewer.data import Shown
from sheetsplat.viewer.state import Curves, State

# Options that a transfer function of its own replaces, and those of the camera.
_OF_COLORS = ("cmap", "opacity", "clim", "transfer_function")
_OF_CAMERA = ("camera", *definitions(CameraOptions))
_COLUMNS = 100
_PLAIN = (str, int, float, bool, type(None))


class _Expression(str):
    """Python that makes a value."""


def python_code(shown: Shown, state: State, size: tuple[int, int]) -> str:
    """Return Python that makes the picture of a state; what was no plain value stays a name that a comment explains."""
    data = shown.data(state.choice, state.time)
    scene = compose.drawn_scene(shown, state, size)
    if isinstance(data, Scene):
        return _of_scene(shown, state, scene, size)
    options = dict(_arguments(shown, state, scene))
    options["camera"], options["size"] = _camera(state.camera), size
    given: list[str] = []
    path = os.fsdecode(data) if isinstance(data, str | os.PathLike) else None
    if path is None:
        given.append("data: what was shown")
    lines = [repr(path) if path is not None else "data"]
    for name, value in options.items():
        text = _text(value)
        if text is None:
            given.append(f"{name}: what the viewer was given")
            text = name
        lines.append(f"{name}={text}")
    head = ["import sheetsplat as ss", "", *(f"# {one}" for one in given)]
    return "\n".join([*head, *_call("image = ss.render", lines), 'image.save("picture.png")', ""])


def _of_scene(shown: Shown, state: State, scene: Scene, size: tuple[int, int]) -> str:
    """Return the code for a scene that was given."""
    changes = _changes(state, scene)
    if state.mode != shown.base(state.choice, state.time).scene.mode:
        changes = {"mode": state.mode, "iso_value": scene.iso_value, **changes}
    texts = [f"{name}={_text(value) or name}" for name, value in changes.items()]
    drawn = _call("scene = scene.replace", texts) if texts else []
    settings = [f"{name}={_text(value)}" for name, value in _settings(shown, state).items()]
    renderer = f"ss.Renderer({', '.join(settings)})"
    head = ["import sheetsplat as ss", "", "# scene: what was shown"]
    ends = [f"image = {renderer}.render(scene, camera, size={size})", 'image.save("picture.png")', ""]
    return "\n".join([*head, *drawn, f"camera = {_camera(state.camera)}", *ends])


def _settings(shown: Shown, state: State) -> dict[str, Any]:
    found = {**shown.renderer_options(), **state.settings}
    return {name: value for name, value in found.items() if value not in (None, {})}


def _arguments(shown: Shown, state: State, scene: Scene) -> Mapping[str, Any]:
    """Return the keyword arguments of `render`, without camera and size."""
    given = shown.options_at(state.time)
    options = {name: value for name, value in given.items() if name not in (*_OF_CAMERA, "size", "depth_cue")}
    options |= {"mode": state.mode, "quality": state.quality, **_settings(shown, state)}
    options = {name: value for name, value in options.items() if (name, value) not in _DEFAULTS}
    if isinstance(shown.options.get("depth_cue"), str) or "depth_cue" in state.changes:
        options["depth_cue"] = scene.options["depth_cue"]
    elif "depth_cue" in shown.options:
        options["depth_cue"] = shown.options["depth_cue"]
    changes = _changes(state, scene)
    if "transfer_function" in changes:
        for name in _OF_COLORS:
            options.pop(name, None)
        # What render would choose by colours and opacities that it does not choose now.
        floors = {one.quantity.floor for one in scene.fields} - {None}
        made = isinstance(shown.data(state.choice, state.time), Field)
        if len(floors) == 1 and "log" not in options and not made:
            options["log"] = floors.pop()
        options |= {"slice_spacing": scene.slice_spacing, "reference_length": scene.reference_length}
        if scene.supersampling > 1:
            # With slices that are given a quality leaves one.
            options["supersampling"] = scene.supersampling
    if not all(isinstance(one, RegularField) for one in scene.fields):
        options["filter"] = scene.filter or "off"
    return {**options, **changes}


_DEFAULTS = (("mode", "composite"), ("quality", "good"))


def _changes(state: State, scene: Scene) -> dict[str, Any]:
    """Return what was changed in the viewer, as the scene has it now."""
    found = {name: scene.options[name] for name in state.changes if name in scene.options and name != "depth_cue"}
    # Later times have the look of the first one.
    later = state.time > 0
    if ("surfaces" in state.changes or later) and scene.mode == "isosurface":
        found["iso_value"] = scene.iso_value
        found["transfer_function"] = _functions(scene.transfer_functions, {})
    if (state.curves or later) and scene.mode == "composite":
        found["transfer_function"] = _functions(scene.transfer_functions, state.curves)
    if later and scene.mode not in ("composite", "isosurface"):
        found |= {"scalar_colors": scene.options["scalar_colors"], "slice_spacing": scene.slice_spacing}
    return found


def _functions(functions: tuple[TransferFunction, ...], curves: Mapping[int, Curves]) -> _Expression:
    texts = [_function(one, curves.get(n)) for n, one in enumerate(functions)]
    return _Expression(texts[0] if len(texts) == 1 else f"[{', '.join(texts)}]")


def _function(function: TransferFunction, curves: Curves | None) -> str:
    if curves is None:
        return f"ss.TransferFunction({_rows(function.points)})"
    if curves.cmap:
        # Beyond its limits a colormap has one colour.
        inside = np.flatnonzero(np.any(np.diff(curves.colors[:, 1:], axis=0) != 0, axis=1))
        ends = (inside[0], inside[-1] + 1) if inside.size else (0, -1)
        low, high = (float(curves.colors[n, 0]) for n in ends)
        if low < high and TransferFunction.from_colormap(curves.cmap, curves.opacities, (low, high)) == function:
            return f"ss.TransferFunction.from_colormap({curves.cmap!r}, {_rows(curves.opacities)}, ({low!r}, {high!r}))"
    return f"ss.TransferFunction.from_curves({_rows(curves.colors)}, {_rows(curves.opacities)})"


def _rows(rows: Any) -> str:
    return "[" + ", ".join(str(tuple(row)) for row in rows.tolist()) + "]"


def _camera(camera: Camera) -> _Expression:
    first = f"ss.Camera.{camera.kind}({camera.eye}, {camera.target}, {camera.up}, "
    if camera.kind == "orthographic":
        return _Expression(f"{first}height={camera.height!r})")
    shift = f", shift={camera.shift!r}" if any(camera.shift) else ""
    return _Expression(f"{first}fov_y={camera.fov_y!r}, near={camera.near!r}{shift})")


def _text(value: Any) -> str | None:
    """Return Python that makes a value, or None where there is none."""
    if isinstance(value, _Expression):
        return str(value)
    if isinstance(value, _PLAIN):
        return repr(value)
    if isinstance(value, os.PathLike):
        return repr(os.fspath(value))
    if isinstance(value, np.generic):
        return repr(value.item())
    if isinstance(value, TransferFunction):
        return f"ss.TransferFunction({_rows(value.points)})"
    if isinstance(value, Camera):
        return str(_camera(value))
    if isinstance(value, list | tuple):
        parts = [_text(one) for one in value]
        if any(one is None for one in parts):
            return None
        inner = ", ".join(str(one) for one in parts)
        return f"({inner}{',' * (len(parts) == 1)})" if isinstance(value, tuple) else f"[{inner}]"
    if isinstance(value, dict):
        texts = {key: _text(one) for key, one in value.items()}
        return None if None in texts.values() else "{" + ", ".join(f"{k!r}: {v}" for k, v in texts.items()) + "}"
    if is_dataclass(value) and type(value).__module__.startswith("sheetsplat"):
        members = {one.name: _text(getattr(value, one.name)) for one in fields(value) if one.init}
        if None not in members.values():
            return f"ss.{type(value).__name__}({', '.join(f'{name}={text}' for name, text in members.items())})"
    return None


def _call(function: str, arguments: list[str]) -> list[str]:
    """Return the lines of a call, an argument each; a long argument is one line."""
    joined = f"{function}({', '.join(arguments)})"
    if len(joined) <= _COLUMNS:
        return [joined]
    return [f"{function}(", *(f"    {one}," for one in arguments), ")"]
