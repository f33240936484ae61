"""The three qualities beside VTK: error against a formula, time of a frame, weave on flat faces, `image.error`."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage  # type: ignore[import-untyped]

import sheetsplat as ss
from bench.measure import (
    Floats,
    Timing,
    attempt,
    data_folder,
    decibels,
    device_of,
    quotient,
    renderer_for,
    rms,
)
from bench.pictures import keep
from bench.prefilter import POINTS, flat_picture, view
from bench.report import Goal, Options, Report, Row, columns, environment
from bench.vtk_casters import CASTERS, Look, Volume, Vtk, VtkMissing
from sheetsplat import datasets
from sheetsplat.choose.asked import Asked
from sheetsplat.choose.picture import choose
from sheetsplat.fields import default_spacing
from sheetsplat.options.quality import QUALITIES

#: What is to be reached at the full size: decibels, frame time over the plain frame, weave over that of the finest
#: picture, and `image.error`.
WANTED_DB = {"draft": 34.0, "good": 42.0, "best": 62.0}
WANTED_TIME = {"draft": 1.0, "good": 2.0, "best": 6.0}
WANTED_WEAVE = {"good": 1.5, "best": 1.1}
WANTED_ERROR = {"good": 6e-3, "best": 2e-3}
_EDGE = 128
# Slices of the formula's picture to a sample, and the depth that they cover on each side of the middle.
_FORMULA = 8
_DEPTH = 1.0
_FACES = ("engine", "bonsai", "cthead_256", "stent")
_VOLUMES = (
    *("aneurism_256", "bonsai", "cthead_256", "engine", "lobster", "mrbrain", "nucleon", "stent", "tooth", "vismale"),
    # Beyond the ten.
    *("hydrogen", "lcdm", "silicium", "turbulent"),
)
# Of the finest picture: slices to one of the default distance, and samples of a pixel along each axis.
_SLICES, _SAMPLES = 16, 4
# Part of the picture, along each axis, in which faces are looked for, and the part of its pixels that are the flattest.
_TILE, _FLATTEST = 0.25, 0.3
# Finer than this, pixels, is weave; a face is flat where light changes little over so many.
_FINE, _FLAT = 2.0, 4.0

#: Parts that can be run alone, and volumes that can be measured alone: `--row errors --row bonsai` is one of each.
PARTS = ("signal", "frames", "faces", "errors")
ROWS = (*PARTS, *_VOLUMES)
# What measures one of them.
Part = Callable[[Options, list[Goal]], list[Row]]


def composed(
    field: ss.RegularField, name: str, size: tuple[int, int], camera: ss.Camera | None = None, **look: Any
) -> tuple[ss.Scene, ss.Camera]:
    """Return scene and camera of a picture of a quality, as `sheetsplat.render` makes them of an array."""
    asked = Asked.of("render", {"quality": name})
    made = choose([field], {**look, "log": False, "camera": camera}, asked, size)
    return made.scene, made.camera


def measured(options: Options, name: str) -> ss.RegularField:
    """Return a measured volume with plain kernels. FileNotFoundError where it is missing."""
    found = sorted(data_folder(options).glob(f"{name}*.nrrd"))
    if not found:
        raise FileNotFoundError(f"{name} is not in the data folder; set SHEETSPLAT_DATA")
    volume = ss.io.read_volume(found[0])
    return ss.RegularField(volume.values, spacing=volume.spacing, origin=volume.origin)


def weave(picture: NDArray[Any], flat: NDArray[np.bool_]) -> float:
    """Return the RMS of what is finer than two pixels in the brightness of a picture, over some of its pixels."""
    light = picture[..., :3].astype(np.float64).mean(axis=2)
    return rms((light - ndimage.gaussian_filter(light, _FINE))[flat])


def flat_faces(picture: NDArray[Any]) -> NDArray[np.bool_]:
    """Return which pixels of a picture show flat faces: opaque ones where light changes least over some pixels."""
    light = picture[..., :3].astype(np.float64).mean(axis=2)
    change = ndimage.gaussian_gradient_magnitude(light, _FLAT)
    inside = ndimage.binary_erosion(picture[..., 3] > 0.9, iterations=round(2 * _FINE))
    if not inside.any():
        return np.zeros(light.shape, bool)
    found: NDArray[np.bool_] = np.asarray(inside & (change <= np.quantile(change[inside], _FLATTEST)), bool)
    return found


def finest(scene: ss.Scene, camera: ss.Camera, size: tuple[int, int], renderer: ss.Renderer) -> Floats:
    """Return the picture of a scene with 16 slices to one of the default and the mean of 4 x 4 samples a pixel."""
    spacing = default_spacing(scene.fields) / _SLICES
    fine = scene.replace(slice_spacing=spacing, reference_length=scene.reference_length, supersampling=_SAMPLES)
    return np.asarray(renderer.render(fine, camera, size=size).rgba, np.float64)


def tile_of(camera: ss.Camera, share: float, right: float, up: float) -> ss.Camera:
    """Return an orthographic camera that sees a part of a square picture, whose middle is given in its heights."""
    forward = np.subtract(camera.target, camera.eye)
    across = np.cross(forward, camera.up)
    across /= np.linalg.norm(across)
    above = np.cross(across, forward)
    above /= np.linalg.norm(above)
    move = camera.height * (right * across + up * above)
    return ss.Camera.orthographic(camera.eye + move, camera.target + move, camera.up, height=share * camera.height)


def flattest_tile(scene: ss.Scene, camera: ss.Camera, renderer: ss.Renderer, edge: int) -> ss.Camera:
    """Return the camera of the tile of a picture that shows most of flat faces."""
    picture = renderer.render(scene, camera, size=(edge, edge)).rgba
    flat = flat_faces(picture).astype(np.float64)
    width = max(2, round(_TILE * edge))
    counts = ndimage.uniform_filter(flat, width, mode="constant")
    margin = width // 2
    counts = counts[margin : edge - margin, margin : edge - margin]
    row, column = np.unravel_index(int(np.argmax(counts)), counts.shape)
    return tile_of(camera, _TILE, (column + margin + 0.5) / edge - 0.5, 0.5 - (row + margin + 0.5) / edge)


# -------------------------------------------------------------------------------------------------------------- rows


def _signal(options: Options, goals: list[Goal]) -> list[Row]:
    """Return the distance of flat pictures of Marschner and Lobb's signal from that of its formula."""
    volume = datasets.marschner_lobb(options.edge(_EDGE))
    spacing, size, camera = volume.spacing[0], (min(options.size),) * 2, view()
    options.say("signal: formula")
    middle = float(np.linalg.norm(camera.eye))
    expected = flat_picture(
        lambda at: datasets.marschner_lobb_value(at[..., 0], at[..., 1], at[..., 2]),
        POINTS,
        camera,
        size,
        middle=middle,
        half=_DEPTH,
        spacing=spacing / _FORMULA,
        length=spacing,
    )
    rows: list[Row] = []
    renderer = renderer_for(options)
    function = ss.TransferFunction(list(POINTS))
    for name in QUALITIES:
        options.say(f"signal: {name}")
        scene, _ = composed(volume.field(), name, size, camera, transfer_function=function, shading=False)
        picture = renderer.render(scene, camera, size=size)
        keep(options, picture, "quality", "signal", name)
        level = decibels(rms(picture.rgba - expected))
        rows.append({"row": "signal", "quality": name, "db": level})
        if options.scale == 1.0:
            goals.append(Goal(f"signal, {name}", level, WANTED_DB[name], "dB", least=True))
    return rows + _casters(options, volume, camera, size, expected)


def _casters(
    options: Options, volume: datasets.Dataset, camera: ss.Camera, size: tuple[int, int], expected: Floats
) -> list[Row]:
    """Return the distance of VTK's pictures, with samples a sample apart and half of that."""
    rows: list[Row] = []
    spacing = volume.spacing[0]
    try:
        with Vtk() as vtk:
            samples = Volume(volume.values, volume.spacing, volume.origin)
            for caster in CASTERS:
                for distance in (1.0, 0.5):
                    options.say(f"signal: VTK, {caster}, {distance:g}")
                    look = Look(POINTS, spacing, distance * spacing, None, size, 2)
                    row: Row = {"row": "signal", "quality": f"VTK {caster}, {distance:g}"}
                    try:
                        vtk.show(caster, samples, look)
                        shots = [vtk.frame(caster, camera, picture=True) for _ in range(max(2, options.views))]
                        assert shots[-1].rgba is not None
                        row["db"] = decibels(rms(shots[-1].rgba - expected))
                        row["ms"] = 1000.0 * statistics.median(shot.wall for shot in shots[1:])
                    except VtkMissing as error:
                        row["remark"] = str(error)
                    rows.append(row)
    except VtkMissing as error:
        rows.append({"row": "signal", "quality": "VTK", "remark": str(error)})
    return rows


def _timed(
    options: Options, what: str, scenes: Sequence[tuple[ss.Scene, ss.Camera]], goals: list[Goal] | None
) -> list[Row]:
    """Return the times of frames of the three qualities, drawn in turn."""
    renderers = [renderer_for(options) for _ in scenes]
    timings = [Timing() for _ in scenes]
    for renderer, (scene, camera) in zip(renderers, scenes, strict=True):
        renderer.render(scene, camera, size=options.size)
    for _ in range(options.views):
        for renderer, timing, (scene, camera) in zip(renderers, timings, scenes, strict=True):
            timing.frame(renderer, scene, camera, options.size)
    rows: list[Row] = []
    for name, timing in zip(QUALITIES, timings, strict=True):
        times = quotient(timing, timings[0], cpu=True)
        rows.append({"row": what, "quality": name, "ms": 1000.0 * timing.wall, "times": times})
        if goals is not None and options.scale == 1.0:
            goals.append(Goal(f"frame, {what}, {name}", times, WANTED_TIME[name], "plain frames"))
    return rows


def _frames(options: Options, goals: list[Goal]) -> list[Row]:
    """Return times of the signal, flat, and of measured volumes, lit."""
    lit = _each("frames", _FACES, _lit_frames)
    if set(options.rows) & set(_VOLUMES):
        return lit(options, goals)
    volume = datasets.marschner_lobb(options.edge(_EDGE))
    function = ss.TransferFunction(list(POINTS))
    camera = view()
    options.say("frames: signal")
    flat = [
        composed(volume.field(), name, options.size, camera, transfer_function=function, shading=False)
        for name in QUALITIES
    ]
    rows = _timed(options, "signal, flat", flat, goals)
    return rows + lit(options, goals)


def _lit_frames(options: Options, name: str, goals: list[Goal]) -> list[Row]:
    field = measured(options, name)
    return _timed(options, f"{name}, lit", [composed(field, one, options.size) for one in QUALITIES], goals)


def _attempted(run: Any, name: str) -> list[Row]:
    """Return rows, or one with the reason why there are none."""
    found: list[Row] = []

    def once() -> Row:
        found.extend(run())
        return {}

    failed = attempt(once)
    return found or [{"row": name, **failed}]


def _asked(options: Options, names: Sequence[str]) -> Sequence[str]:
    """Return those of some volumes that are to be measured: all where no volume was named."""
    return [name for name in names if name in options.rows] if set(options.rows) & set(_VOLUMES) else names


def _each(kind: str, names: Sequence[str], measure: Callable[[Options, str, list[Goal]], list[Row]]) -> Part:
    """Return the part that measures one volume after another."""

    def rows(options: Options, goals: list[Goal]) -> list[Row]:
        found: list[Row] = []
        for name in _asked(options, names):
            options.say(f"{kind}: {name}")
            found += _attempted(partial(measure, options, name, goals), name)
        return found

    return rows


def _face(options: Options, name: str, goals: list[Goal]) -> list[Row]:
    """Return the weave on flat faces of a volume beside that of the finest picture."""
    edge = min(options.size)
    size = (round(_TILE * edge),) * 2
    renderer = renderer_for(options)
    field = measured(options, name)
    whole, camera = composed(field, "good", (edge, edge))
    tile = flattest_tile(whole, camera, renderer, edge)
    rows: list[Row] = []
    for one in QUALITIES:
        scene, _ = composed(field, one, (edge, edge), tile)
        fine = finest(scene, tile, size, renderer)
        flat = flat_faces(fine)
        picture = renderer.render(scene, tile, size=size)
        keep(options, picture, "quality", "faces", name, one)
        keep(options, fine, "quality", "faces", name, one, "finest")
        found, least = weave(picture.rgba, flat), weave(fine, flat)
        rows.append({"row": f"{name}, flat faces", "quality": one, "weave": found, "finest": least})
        rows[-1]["ratio"] = found / least
        if one in WANTED_WEAVE and options.size >= (400, 400):
            goals.append(Goal(f"weave, {name}, {one}", found / least, WANTED_WEAVE[one], "of the finest"))
    return rows


def _error(options: Options, name: str, goals: list[Goal]) -> list[Row]:
    """Return `image.error` of a volume."""
    renderer = renderer_for(options)
    field = measured(options, name)
    rows: list[Row] = []
    for one in QUALITIES:
        scene, camera = composed(field, one, options.size)
        picture = renderer.render(scene, camera, size=options.size)
        keep(options, picture, "quality", "errors", name, one)
        error = picture.error
        row: Row = {"row": name, "quality": one, "error": error.rmse, "slicing": error.budget["slice distance"]}
        assert scene.quality is not None
        row["through"] = bool(scene.quality.of("prefilter").value)
        rows.append(row)
        if one in WANTED_ERROR:
            goals.append(Goal(f"error, {name}, {one}", error.rmse, WANTED_ERROR[one]))
    return rows


_PARTS: dict[str, Part] = {
    "signal": _signal,
    "frames": _frames,
    "faces": _each("faces", _FACES, _face),
    "errors": _each("errors", _VOLUMES, _error),
}


def run(options: Options) -> Report:
    """Measure the rows that are wanted."""
    options = options.preferring("cpu")
    rows: list[Row] = []
    goals: list[Goal] = []
    for name in [name for name in PARTS if name in options.rows] or PARTS:
        rows += _PARTS[name](options, goals)
    return Report(
        name="quality",
        title=f"The three qualities at {options.size[0]}x{options.size[1]}",
        columns=columns(
            "row=what, quality, db=dB, ms, times=over draft, weave, finest=weave of the finest, ratio, error, slicing, "
            "through=through the samples, remark"
        ),
        rows=rows,
        goals=goals,
        notes=[
            f"signal: Marschner-Lobb {options.edge(_EDGE)}^3, unlit, against its formula with {_FORMULA} slices to a "
            "sample; VTK with samples a sample and half a sample apart.",
            f"times: processor time of frames that are drawn in turn, median of {options.views}, over that of draft, "
            "the plain frame.",
            "weave: RMS of what is finer than two pixels in the light on flat faces of the default lit picture, beside "
            f"the same kernels with {_SLICES} slices to one of the default, {_SAMPLES} x {_SAMPLES} samples a pixel.",
            "error: image.error, root mean square; slicing: the part of the slice distance.",
        ],
        environment=environment(device_of(renderer_for(options))),
    )
