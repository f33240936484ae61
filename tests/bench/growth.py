"""Growing numbers of scattered spheres, each number in a new process: times and memory."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

import sheetsplat as ss
from bench.measure import Timing, away, clock, forget_peak, in_new_process, orthographic, renderer_for, resident
from bench.report import Options, Row
from sheetsplat.datasets.random_stream import Stream
from sheetsplat.fields import Field

_SEED = 2006
# Numbers drawn at once.
_BLOCK = 1 << 16


@dataclass(frozen=True)
class Spheres:
    """Equal spheres spread evenly over a box, and how they are drawn.

    Attributes
    ----------
    count
        Number of spheres.
    box
        Edges of the box from (0, 0, 0) on, world units.
    radius
        Radius of the spheres, world units.
    few_radius
        Radius of the few spheres that a first picture shows, so that context and programs exist before the measurement.
    points
        Transfer function for values from 0 to 1.
    settings
        Further options of the scene.
    angles
        (turn, rise) of each view, radians; the first frame uses the first one.
    height
        World units that the camera sees.
    size
        (width, height) of the picture, pixels.
    backend
        Backend that draws.
    """

    count: int
    box: tuple[float, float, float]
    radius: float
    few_radius: float
    points: tuple[tuple[float, ...], ...]
    settings: dict[str, Any]
    angles: list[tuple[float, float]]
    height: float
    size: tuple[int, int]
    backend: str

    def measure(self) -> Row:
        """Return times and memory of drawing them in a new process; see :func:`draw`."""
        return in_new_process(draw, **asdict(self))


def draw(
    count: int,
    box: list[float],
    radius: float,
    few_radius: float,
    points: list[list[float]],
    settings: dict[str, Any],
    angles: list[list[float]],
    height: float,
    size: tuple[int, int],
    backend: str,
) -> Row:
    """Draw spheres and return times in ms and memory in bytes.

    Counts and parts of a frame (``view_ms`` ...) are medians over the views after the first; ``least_ms`` and
    ``least_cpu_ms`` are the least. ``peak_field`` is the peak of resident memory over that before the field was made,
    with the caller's arrays, the context and its programs present; ``peak_draw`` is that over the memory with the
    field; ``kept`` counts field, index and view, ``named`` index and view.
    """
    edges, size = np.array(box), (size[0], size[1])
    centers, values = np.empty((count, 3)), np.empty(count)
    radii = np.full(count, radius)
    random = Stream(_SEED)
    for first in range(0, count, _BLOCK):
        part = slice(first, min(first + _BLOCK, count))
        drawn = random.uniform(part.stop - part.start, 4)
        centers[part], values[part] = edges * drawn[:, :3], drawn[:, 3]

    def scene_of(field: Field) -> ss.Scene:
        return ss.Scene(field, points, **settings, lights=[ss.Light((0.3, 0.5, 1.0))])

    far = 3.0 * float(edges.max())
    cameras = [orthographic(0.5 * edges, away(turn, rise), far, height) for turn, rise in angles]
    renderer = renderer_for(Options(backend=backend))
    few = slice(0, min(count, 64))
    small = ss.EllipsoidField(centers[few], few_radius, None, values[few])
    renderer.render(scene_of(small), cameras[0], size=size)
    forget_peak()
    before = resident()
    field, made, _ = clock(lambda: ss.EllipsoidField(centers, radii, None, values))
    peak_of_field = resident("VmHWM")
    forget_peak()
    with_field = resident()
    scene = scene_of(field)
    first_frame, further = Timing(), Timing()
    first_frame.frame(renderer, scene, cameras[0], size)
    for view, camera in enumerate(cameras[1:]):
        picture = further.frame(renderer, scene, camera, size, view)
    opacity = float(picture.rgba[..., 3].mean())
    if not opacity > 1e-4:
        raise ss.Error("the picture is empty")
    peak = resident("VmHWM")
    named = sum(picture.stats.get(name, 0.0) for name in ("bytes_index", "bytes_view"))
    return {
        "slice_spacing": scene.slice_spacing,
        "field_ms": 1000.0 * made,
        "first_ms": 1000.0 * first_frame.wall,
        "index_ms": 1000.0 * first_frame.stat("seconds_index"),
        "splats": further.splats,
        **further.row("view", "bucket", "vertices"),
        "least_ms": 1000.0 * min(shot.wall for shot in further.shots),
        "least_cpu_ms": 1000.0 * min(shot.cpu for shot in further.shots),
        "peak_field": max(peak, peak_of_field) - before,
        "peak_draw": peak - with_field,
        "named": named,
        "kept": field.memory + named,
        "opacity": opacity,
    }


def radius_for(overlap: float, edge: float, count: int) -> float:
    """Return the radius of spheres that together fill a cube so many times."""
    return float((overlap * edge**3 / (4.0 / 3.0 * math.pi * count)) ** (1.0 / 3.0))
