"""One look for all steps of a time series, and one backend for all frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import api
from sheetsplat._checks import choice, is_auto
from sheetsplat.animation.sources import SharedLook
from sheetsplat.animation.steps import Steps
from sheetsplat.bricks.needs import bricked_field, one_backend
from sheetsplat.camera import Camera
from sheetsplat.choose.asked import Asked
from sheetsplat.choose.kernels import with_kernel
from sheetsplat.fields import Field, RegularField
from sheetsplat.framing import compose_camera, fitting_depth_cue
from sheetsplat.look.automatic import choose
from sheetsplat.look.decades import in_decades, with_log_scale
from sheetsplat.look.histogram import stride_of
from sheetsplat.look.strays import without_strays
from sheetsplat.notices import muted
from sheetsplat.options.camera import CameraOptions
from sheetsplat.options.core import COMPOSITE, MODES, definitions, pick, pick_given
from sheetsplat.options.data import OpenOptions
from sheetsplat.options.look import DEFAULT_CMAP
from sheetsplat.options.picture import LookOptions
from sheetsplat.renderer import Renderer
from sheetsplat.scene import Scene

#: How many steps are looked at.
LOOKED_AT = 8
Limits = tuple[float, float]
# Percentiles of a step's samples, its background and nearly its highest; a background that drifts by this share of the
# usual distance between them is followed.
_LEVELS = (10.0, 99.9)
_FAR = 0.25
_KERNEL = ("radius", "falloff", "prefilter")


def settled(picture: api.Prepared) -> tuple[Scene, Renderer]:
    """Return the scene and the renderer of all frames of a film: what the renderer chooses, it has chosen once."""
    scene, renderer = picture.scene, picture.renderer
    settings = dict(renderer.settings)
    if renderer.max_error is not None or renderer.max_seconds is not None:
        image = renderer.render(scene, picture.camera, size=picture.size)
        settings |= {**image.recipe.renderer, "max_error": None, "max_seconds": None}
        options = image.recipe.options
        changes = {name: one for name, one in options.items() if one != scene.options[name]}
        scene = scene.replace(**changes).with_quality(scene.quality)
    elif bricked_field(scene) is not None:
        settings = one_backend(settings)
    elif settings["backend"] == "auto":
        settings["backend"] = renderer.plan(scene, picture.camera, picture.size).backend
    same = settings == dict(renderer.settings)
    return scene, renderer if same else Renderer(**settings)


def _numbers(count: int) -> list[int]:
    return sorted({round(n) for n in np.linspace(0, count - 1, min(count, LOOKED_AT))})


def _alike(fields: Sequence[Field]) -> list[RegularField] | None:
    """Return volumes on one lattice, None where there is anything else."""
    volumes = [one for one in fields if isinstance(one, RegularField)]
    places = {(one.shape, one.spacing, one.axes, one.origin, one.lattice) for one in volumes}
    return volumes if len(volumes) == len(fields) and len(places) == 1 else None


def _mixed(volumes: Sequence[RegularField]) -> RegularField:
    """Return a volume each of whose samples is of another step in turn: its histogram is that of all of them."""
    k, j, i = np.ogrid[tuple(slice(size) for size in volumes[0].shape)]
    turn = (k + j + i) % len(volumes)
    kind = np.result_type(*(one.values.dtype for one in volumes))
    mixed: NDArray[Any] = np.empty(volumes[0].shape, kind)
    for number, one in enumerate(volumes):
        np.copyto(mixed, one.values, where=turn == number, casting="unsafe")
    return volumes[0].replace(mixed)


def _largest(volumes: Sequence[RegularField]) -> RegularField:
    """Return the largest sample of all steps at each place, which is where anything is seen."""
    peak = np.array(volumes[0].values)
    for one in volumes[1:]:
        peak = np.fmax(peak, one.values)
    return volumes[0].replace(peak)


def _drift(volumes: Sequence[RegularField], look: Mapping[str, Any], floor: float | None) -> tuple[Any, Limits] | None:
    """Return a colormap and limits for all steps where opacities have to follow their backgrounds, else None.

    Where the background drifts so far that what is an object in one step is background in another, no opacity suits
    both. Who gives limits or opacities has chosen.
    """
    chosen = any(look.get(name) is not None for name in ("clim", "opacity", "transfer_function"))
    if chosen or floor is not None or look.get("mode", MODES[0]) not in COMPOSITE:
        return None
    levels = []
    for one in volumes:
        picked = one.samples.every(stride_of(one.size)).astype(np.float64)
        known = picked[~np.isnan(picked)]
        if known.size:
            levels.append(np.percentile(known, _LEVELS))
    if not levels:
        return None
    lows, highs = np.transpose(levels)
    if not float(np.ptp(lows)) > _FAR * float(np.median(highs - lows)):
        return None
    looks = [choose([one]) for one in volumes]
    limits = min(one.clim[0] for one in looks), max(one.clim[1] for one in looks)
    cmap = look.get("cmap") or looks[len(looks) // 2].cmap or DEFAULT_CMAP
    return cmap, limits


def one_look(
    steps: Steps, options: dict[str, Any], camera: Camera | None
) -> tuple[SharedLook, Camera, tuple[int, int], Renderer]:
    """Return what all steps share, the camera, the size and the renderer.

    Volumes on one lattice are looked at together: range and opacity by the samples of all of them, the camera by the
    largest sample at each place. Where their background drifts opacities are those of each step. Of other data the
    range is that of the step with the widest one, and the camera shows all steps that are looked at.
    """
    of_data = {name: one for name, one in options.items() if name in definitions(OpenOptions) and name != "quality"}
    rest = {name: one for name, one in options.items() if name not in of_data}
    placed: dict[str, Any] = {} if camera is None else {"camera": camera}
    numbers = _numbers(len(steps))
    looked = [steps[number] for number in numbers]
    middle = looked[len(looked) // 2]
    if isinstance(middle, Scene):
        # The caller chose the look; the camera is that of the middle.
        picture = api.prepare(middle, **rest, **placed)
        scene, renderer = settled(picture)
        return SharedLook(scene, {}), picture.camera, picture.size, renderer
    look: Mapping[str, Any] = pick_given(LookOptions, options)
    made = [isinstance(one, Field) for one in looked]
    with muted():
        fields = [
            api.Opened.of(one, {**of_data, **steps.options(number)}).fields
            for number, one in zip(numbers, looked, strict=True)
        ]
    if look.get("mode") is not None:
        choice("animate: mode", look["mode"], MODES)
    log = options.get("log")
    if any(len(one) > 1 for one in fields):
        several = fields[len(fields) // 2]
        shown = in_decades(several, look, log or False)
        picture = api.prepare(shown, **{**rest, **with_log_scale(several, look, log), **placed})
        scene, renderer = settled(picture)
        return SharedLook(scene, of_data, log=log or False), picture.camera, picture.size, renderer
    alone = [one[0] for one in fields]
    volumes = _alike(alone)
    shared = _mixed(volumes) if volumes is not None else max(alone, key=_width)
    look = with_log_scale([shared], look, log)
    shared = in_decades([shared], look, log)[0]
    floor = shared.quantity.floor if shared.quantity.floor != alone[0].quantity.floor else None
    shared = without_strays([shared], look, framed=False)[0]
    kernel = _kernel(shared, alone[len(alone) // 2], options, made=made[len(made) // 2])
    if kernel is not None and isinstance(shared, RegularField):
        shared = shared.replace(**kernel)
    picture = api.prepare(shared, **{**rest, **look, **placed, "log": False})
    colors = None if volumes is None else _drift(volumes, look, floor)
    scene = picture.scene
    seen = picture.camera
    if camera is None:
        opened = SharedLook(scene, {}, kernel, floor or False, look, colors)
        with muted():
            everything = [_largest(volumes)] if volumes is not None else alone
            of_steps = [opened.of(one).fields[0] for one in everything]
            seen = compose_camera(scene.replace(field=of_steps), picture.size, **pick(CameraOptions, options))
        if is_auto(options.get("depth_cue")):
            scene = scene.replace(depth_cue=fitting_depth_cue(scene, seen)).with_quality(scene.quality)
    scene, renderer = settled(api.Prepared(scene, seen, picture.size, picture.renderer))
    return SharedLook(scene, of_data, kernel, floor or False, look, colors), seen, picture.size, renderer


def _width(field: Field) -> float:
    low, high = field.value_range
    return high - low


def _kernel(shared: Field, step: Field, options: dict[str, Any], *, made: bool) -> dict[str, Any] | None:
    """Return the kernels of all volumes, as the quality finds them for one step; None: as they are."""
    if not isinstance(shared, RegularField) or not isinstance(step, RegularField) or (made and step.settled):
        return None
    asked = Asked.of("render", {name: one for name, one in options.items() if name != "filter"})
    found = with_kernel(step, asked, made=made)[0]
    return {name: getattr(found, name) for name in _KERNEL} | (
        {} if found.prefilter else {"normalization": found.normalization}
    )
