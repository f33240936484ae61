"""Times and errors of pictures."""

from __future__ import annotations

import math
import os
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sheetsplat as ss
from sheetsplat import _sheetsplat
from sheetsplat.bench._report import Options
from sheetsplat.errors import complain

# Sizes at which the reference is tried, as a share of the timed picture.
_SHARES = (0.125, 0.25, 0.5, 1.0)


@dataclass(frozen=True)
class Timing:
    """Medians over several frames.

    Attributes
    ----------
    wall, cpu
        Seconds of a frame by the clock, and by the processors of this process together.
    stats
        Medians of what the pictures' ``stats`` say.
    picture
        The last picture.
    """

    wall: float
    cpu: float
    stats: dict[str, float]
    picture: ss.Image


def orbit(field: Any, views: int, elevation: float = 20.0) -> list[ss.Camera]:
    """Return cameras around a field (or whatever :meth:`Camera.fit` takes), evenly spaced and none along an axis."""
    cameras = []
    rise = math.radians(elevation)
    for view in range(views):
        turn = 2.0 * math.pi * (view + 0.1) / views
        direction = (-math.sin(turn) * math.cos(rise), -math.sin(rise), -math.cos(turn) * math.cos(rise))
        cameras.append(ss.Camera.fit(field, direction=direction))
    return cameras


def time_frames(renderer: ss.Renderer, scene: ss.Scene, cameras: Sequence[ss.Camera], size: tuple[int, int]) -> Timing:
    """Render every view once, after one frame that is not counted: it makes the index and compiles the shaders."""
    picture = renderer.render(scene, cameras[-1], size=size)
    walls, cpus, stats = [], [], []
    for camera in cameras:
        wall, cpu = time.perf_counter(), time.process_time()
        picture = renderer.render(scene, camera, size=size)
        cpus.append(time.process_time() - cpu)
        walls.append(time.perf_counter() - wall)
        stats.append(picture.stats)
    medians = {name: statistics.median(one.get(name, 0.0) for one in stats) for name in stats[-1]}
    return Timing(statistics.median(walls), statistics.median(cpus), medians, picture)


def _array(picture: ss.Image) -> tuple[NDArray[np.float32], int]:
    return (picture.scalar, 1) if picture.is_scalar else (picture.rgba, 4)


def difference(picture: ss.Image, reference: ss.Image) -> dict[str, float]:
    """Return ``rmse``, ``p99_9`` and ``maximum`` as the conventions, section 8, define them."""
    (values, channels), (expected, _) = _array(picture), _array(reference)
    return dict(_sheetsplat.compare(np.ascontiguousarray(values), np.ascontiguousarray(expected), channels))


class Judge:
    """Pictures of the reference backend, each made once, as large as the time allows.

    Parameters
    ----------
    size
        The largest size.
    seconds
        How long one picture may take, about, on a processor of its own.
    """

    def __init__(self, size: tuple[int, int], seconds: float) -> None:
        self._size = size
        self._seconds = seconds
        self._renderer = ss.Renderer(backend="reference")
        self._made: dict[tuple[int, int], tuple[ss.Scene, ss.Camera, ss.Image]] = {}

    def reference(self, scene: ss.Scene, camera: ss.Camera) -> ss.Image:
        """Return the reference picture of a view."""
        # Scene and camera are kept with the picture, so that their ids stay theirs.
        key = (id(scene), id(camera))
        if key not in self._made:
            picture: ss.Image | None = None
            spent, before = 0.0, math.inf
            for share in _SHARES:
                # Four times the pixels cost four times as much at most, and about as much more as the last step did.
                if 1.3 * spent * min(4.0, max(1.0, spent / before)) > self._seconds:
                    break
                size = (max(1, round(share * self._size[0])), max(1, round(share * self._size[1])))
                began = time.process_time()
                picture = self._renderer.render(scene, camera, size=size)
                before, spent = spent or math.inf, time.process_time() - began
            assert picture is not None
            self._made[key] = (scene, camera, picture)
        return self._made[key][2]

    def error(
        self, renderer: ss.Renderer, scene: ss.Scene, camera: ss.Camera, shown: ss.Scene | None = None
    ) -> dict[str, Any]:
        """Return the error of a renderer's picture: rmse, p99_9, maximum and the size at which it was measured.

        `shown`, where given, is what the renderer draws of what the reference knows as `scene`.
        """
        expected = self.reference(scene, camera)
        picture = renderer.render(scene if shown is None else shown, camera, size=expected.size)
        width, height = expected.size
        return {**difference(picture, expected), "error_size": f"{width}x{height}"}


def renderer_of_papers(options: Options, **settings: Any) -> ss.Renderer:
    """Return a renderer for what is measured beside the papers, whose ways of drawing are OpenGL's unless told."""
    return renderer_for(replace(options, backend="gl") if options.backend == "auto" else options, **settings)


def renderer_for(options: Options, **settings: Any) -> ss.Renderer:
    """Return a renderer of the backend that is measured."""
    arguments: dict[str, Any] = {"backend": options.backend, **settings}
    return ss.Renderer(**arguments)


def require(
    renderer: ss.Renderer, scene: ss.Scene, camera: ss.Camera, size: tuple[int, int], settings: Mapping[str, Any]
) -> None:
    """Raise Unsupported where the backend has no part of what the settings of a renderer choose between."""
    plan = renderer.plan(scene, camera, size=size)
    known = {effect.name for effect in plan.effects}
    missing = [name for name in settings.get("effects", {}) if name not in known]
    if plan.backend != "gl":
        missing += [name for name in ("tagging", "packing") if settings.get(name, "auto") != "auto"]
    if missing:
        raise complain(
            "this row is OpenGL's",
            f"{', '.join(missing)} on backend {plan.backend}",
            "backend gl",
            kind=ss.Unsupported,
        )


def device_of(renderer: ss.Renderer) -> str:
    """Return the device of a renderer, in words."""
    field = ss.RegularField(np.ones((2, 2, 2), np.uint8))
    scene = ss.Scene(field, [(0.0, 1.0, 1.0, 1.0, 0.0), (1.0, 1.0, 1.0, 1.0, 1.0)])
    return renderer.plan(scene, ss.Camera.fit(field), size=(8, 8)).device


def data_folder(options: Options) -> Path:
    """Return the folder of the measured volumes; it need not exist."""
    if options.data is not None:
        return options.data
    return Path(os.environ.get("SHEETSPLAT_DATA") or "../shared/data")


def load(options: Options, name: str) -> tuple[NDArray[Any], tuple[float, float, float]]:
    """Return samples and spacing of a measured volume. FileNotFoundError where it is not at hand."""
    path = data_folder(options) / name
    if not path.is_file():
        raise FileNotFoundError(f"{name} is not in the data folder; set SHEETSPLAT_DATA")
    from sheetsplat.io import read_volume

    volume = read_volume(path)
    return volume.values, volume.spacing


def attempt(run: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Return what `run` gives, or the reason why it could not, as the row's remark."""
    try:
        return run()
    except FileNotFoundError as error:
        return {"remark": f"skipped: {error}"}
    except (ss.Unsupported, ss.DeviceUnavailable, ss.OutOfMemory) as error:
        return {"remark": "not run: " + " ".join(str(error).split())}
