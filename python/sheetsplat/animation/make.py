"""`turntable` and `animate`: what each frame of a film shows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Unpack

import numpy as np

from sheetsplat import api
from sheetsplat._checks import direction as axis_or_vector
from sheetsplat._checks import number, shown, suffix_of
from sheetsplat.animation.between import Snapshot, sources_between
from sheetsplat.animation.film import Animation, Frame, PictureFrame, SceneFrame
from sheetsplat.animation.framing import turning_camera
from sheetsplat.animation.path import CameraPath, turns
from sheetsplat.animation.series import one_look, settled
from sheetsplat.animation.sources import FileStep, MemoryStep, OneScene, SharedLook, Source
from sheetsplat.animation.steps import Steps, steps_of
from sheetsplat.camera import Camera
from sheetsplat.describe.scene_file import SceneFile
from sheetsplat.errors import complain, unusable
from sheetsplat.image import Image
from sheetsplat.options.camera import CameraOptions
from sheetsplat.options.core import check_names, definitions, documented, filled, pick
from sheetsplat.options.data import OpenOptions
from sheetsplat.options.film import AnimateOptions, FilmOptions, TurnOptions, TurntableOptions, frames_of
from sheetsplat.renderer import Renderer

_SUFFIX = ".toml"


def _prepared(data: Any, options: dict[str, Any]) -> api.Prepared:
    """Return the first picture of data, or of a scene file."""
    if suffix_of(data) == _SUFFIX:
        data = SceneFile.read(data)
    return data.prepare(**options) if isinstance(data, SceneFile) else api.prepare(data, **options)


@documented(TurntableOptions, chooses=True)
def turntable(data: Any, **options: Unpack[TurntableOptions]) -> Animation:
    """Return a film in which the eye turns once about the data.

    Range, opacity, quality and backend are decided once. The camera is as near as it can be with nothing cut off from
    any side.

    >>> film = ss.turntable(values, frames=3, size=32)
    >>> len(film)
    3
    >>> film.save("frames")  # or "film.mp4"

    Parameters
    ----------
    data
        What `sheetsplat.render` takes, or a scene file (.toml).
    **options
        Those of TurntableOptions.

    Raises
    ------
    Error
        What `sheetsplat.render` raises.
    """
    check_names("turntable", options, TurntableOptions)
    given: dict[str, Any] = {name: one for name, one in options.items() if one is not None}
    count = frames_of("turntable: frames", given.get("frames", definitions(TurnOptions)["frames"].default))
    degrees = _angle(given.get("degrees", definitions(TurnOptions)["degrees"].default))
    own = {*definitions(TurnOptions), *definitions(FilmOptions)}
    picture = _prepared(data, {name: one for name, one in options.items() if name not in own})
    scene, renderer = settled(picture)
    camera = picture.camera
    up = camera.world_axes()[1] if "axis" not in given else axis_or_vector("turntable: axis", given["axis"])
    axis = np.asarray(camera.up if "axis" not in given else up, dtype=np.float64)
    if not any(axis) or not np.all(np.isfinite(axis)):
        raise complain(unusable("turntable: axis"), shown(given.get("axis")), "a direction that is not 0")
    fixed = given.get("camera") is not None or _has_eye(data)
    if not fixed:
        camera = turning_camera(scene, camera, axis, degrees, picture.size, pick(CameraOptions, options))
    source = OneScene(scene)
    frames = [SceneFrame(source, one) for one in turns(camera, axis, count, degrees)]
    return Animation(frames, picture.size, renderer, **_film(given))


def _has_eye(data: Any) -> bool:
    if suffix_of(data) == _SUFFIX:
        data = SceneFile.read(data)
    return isinstance(data, SceneFile) and data.camera is not None


def _angle(value: object) -> float:
    result = number("turntable: degrees", value)
    if not np.isfinite(result):
        raise complain(unusable("turntable: degrees"), f"{result:g}", "a finite number")
    return result


def _film(given: dict[str, Any]) -> dict[str, Any]:
    known = filled(FilmOptions, given)
    return {name: known[name] for name in definitions(FilmOptions)}


@documented(AnimateOptions, chooses=True)
def animate(function_or_sequence: Any, frames: int | None = None, **options: Unpack[AnimateOptions]) -> Animation:
    """Return a film of a time series, of a camera path, or of what a function makes of the number of each frame.

    A series has one look: range, opacity, quality, camera and backend are decided once, by up to eight of its steps
    from the first to the last, and hold for all.

    >>> series = ss.animate([values, 0.5 * values], clim=(0, 1), size=32)  # arrays, or the paths of files
    >>> front = ss.Camera.fit(scene, "-x", "z")
    >>> side = ss.Camera.fit(scene, "-y", "z")
    >>> flight = ss.animate(scene, 20, camera=[front, side], size=32)
    >>> widths = ss.animate(lambda n: ss.render(values, clim=(0, 1 + n), size=32), 2)
    >>> len(series), len(flight), len(widths)
    (2, 20, 2)

    Parameters
    ----------
    function_or_sequence
        A sequence of files, arrays, fields or scenes; a file or a DataArray with a time axis, or an array
        (t, k, j, i); snapshots of particles (`Snapshot`, or HDF5 files) with `between`; a function of the number of the
        frame that returns any of what `sheetsplat.render` takes, or the picture itself; or data that stay the same
        while the camera moves.
    frames
        Number of frames: the steps are spread evenly over them. Unless given, that of the steps; of data that stay the
        same and of functions it must be given.
    **options
        Those of AnimateOptions. A function that returns pictures takes those of the film alone.

    Raises
    ------
    InvalidInput
        For no frames, and steps that do not fit together.
    Error
        What `sheetsplat.render` raises.
    """
    check_names("animate", options, AnimateOptions)
    given: dict[str, Any] = {name: one for name, one in options.items() if one is not None}
    count = None if frames is None else frames_of("animate: frames", frames)
    if callable(function_or_sequence) and not hasattr(function_or_sequence, "field"):
        if count is None:
            raise complain(unusable("animate: frames"), "None with a function", "the number of frames", option="frames")
        first = function_or_sequence(0)
        if isinstance(first, Image):
            return _of_pictures(function_or_sequence, first, count, given)
        steps = Steps.of_function(function_or_sequence, first, count)
    else:
        steps = steps_of(function_or_sequence, pick(OpenOptions, options))
    if given.get("between") is not None:
        return _of_snapshots(steps, count, options, given)
    if count is None:
        if len(steps) == 1 and not steps.is_series:
            raise complain(
                unusable("animate: frames"),
                "None with data that stay the same",
                "a number",
                "for a film of several files pass them as a list: sorted(folder.glob(...))",
                option="frames",
            )
        count = frames_of("animate: frames", len(steps))
    return _of_steps(steps, count, options, given)


def _of_pictures(function: Callable[[int], Any], first: Image, count: int, given: dict[str, Any]) -> Animation:
    """Return the film of pictures that a function draws."""
    wrong = [name for name in given if name not in definitions(FilmOptions)]
    if wrong:
        found = f"{wrong[0]} for a function that returns pictures"
        raise complain(unusable(f"animate: {wrong[0]}"), found, "it in the function", option=wrong[0])

    def draw(number: int) -> Callable[[], Image]:
        def drawn() -> Image:
            image = first if number == 0 else function(number)
            if not isinstance(image, Image):
                found = f"{type(image).__name__} of frame {number}"
                raise complain("the film cannot be drawn", found, "a picture, as of frame 0")
            return image

        return drawn

    made: list[Frame] = [PictureFrame(draw(number)) for number in range(count)]
    return Animation(made, first.size, Renderer(), **_film(given))


def _of_steps(steps: Steps, count: int, options: Any, given: dict[str, Any]) -> Animation:
    """Return the film of data that `sheetsplat.render` takes."""
    own = {*definitions(FilmOptions), "camera", "between"}
    rest = {name: one for name, one in options.items() if name not in own}
    way = _way(given.get("camera"), count)
    if len(steps) == 1 and not steps.is_series:
        picture = _prepared(steps[0], rest | ({"camera": way[0]} if way is not None else {}))
        scene, renderer = settled(picture)
        sources: list[Source | MemoryStep] = [OneScene(scene)]
        camera = picture.camera
    else:
        look, camera, size, renderer = one_look(steps, rest, None if way is None else way[0])
        picture = api.Prepared(look.scene, camera, size, renderer)
        sources = [_source(steps, number, look) for number in range(len(steps))]
    cameras = [camera] * count if way is None else way
    made: list[Frame] = [
        SceneFrame(sources[number * len(sources) // count], cameras[number]) for number in range(count)
    ]
    return Animation(made, picture.size, renderer, **_film(given))


def _of_snapshots(steps: Steps, count: int | None, options: Any, given: dict[str, Any]) -> Animation:
    """Return the film of snapshots of particles with frames between them."""
    between = frames_of("animate: between", given["between"])
    what = unusable("animate: between")
    if count is not None:
        raise complain(what, "frames as well", "one of them", option="between")
    paths = [steps.path(number) for number in range(len(steps))]
    snapshots = [steps[number] for number in range(len(steps)) if paths[number] is None]
    if (
        len(steps) < 2
        or len(snapshots) not in (0, len(steps))
        or not all(isinstance(one, Snapshot) for one in snapshots)
    ):
        raise complain(what, "other data", "at least two snapshots: files, or sheetsplat.Snapshot", option="between")
    count = frames_of("animate: between", (len(steps) - 1) * (between + 1) + 1)
    own = {*definitions(FilmOptions), "camera", "between"}
    rest = {name: one for name, one in options.items() if name not in own}
    way = _way(given.get("camera"), count)
    shown = steps_of([one.field for one in snapshots], {}) if snapshots else steps
    look, camera, size, renderer = one_look(shown, rest, None if way is None else way[0])
    files = [FileStep(path, look, steps.options(number)) for number, path in enumerate(paths) if path is not None]
    sources = sources_between(snapshots or files, look, between)
    cameras = [camera] * count if way is None else way
    made: list[Frame] = [SceneFrame(source, one) for source, one in zip(sources, cameras, strict=True)]
    return Animation(made, size, renderer, **_film(given))


def _source(steps: Steps, number: int, look: SharedLook) -> Source | MemoryStep:
    path = steps.path(number)
    if path is not None:
        return FileStep(path, look, steps.options(number))
    return MemoryStep(lambda: steps[number], look)


def _way(camera: Any, count: int) -> list[Camera] | None:
    """Return the camera of each frame, or None where it is to be fitted."""
    if camera is None or isinstance(camera, Camera):
        return None if camera is None else [camera] * count
    if isinstance(camera, CameraPath):
        return camera.cameras(count)
    if isinstance(camera, Sequence) and not isinstance(camera, str | bytes) and camera:
        if len(camera) == 1:
            return _way(camera[0], count)
        return CameraPath(camera).cameras(count)
    wanted = "a Camera, a CameraPath, or a sequence of cameras"
    raise complain(unusable("animate: camera"), shown(camera), wanted, option="camera")
