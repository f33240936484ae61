"""Times and errors of pictures, and what benchmarks need for them: cameras, renderers, files, new processes."""

from __future__ import annotations

import json
import math
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

import sheetsplat as ss
from bench.pictures import keep
from bench.report import Options, Row
from sheetsplat.compare import compare
from sheetsplat.errors import complain

T = TypeVar("T")
Floats = NDArray[np.float64]

# Sizes at which the reference is tried, as a share of the timed picture.
_SHARES = (0.125, 0.25, 0.5, 1.0)


# ------------------------------------------------------------------------------------------------------------- times


def clock(call: Callable[[], T]) -> tuple[T, float, float]:
    """Return what a call returns, the seconds that it takes, and those of all threads of this process together."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = call()
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    return result, wall, cpu


@dataclass(frozen=True)
class _Shot:
    view: int
    wall: float
    cpu: float
    stats: Mapping[str, float]


@dataclass
class Timing:
    """Timed frames, of one view or of several in turn; all times in seconds."""

    shots: list[_Shot] = field(default_factory=list)

    def add(self, wall: float, cpu: float, stats: Mapping[str, float] | None = None, view: int = 0) -> None:
        """Add a frame."""
        self.shots.append(_Shot(view, wall, cpu, stats or {}))

    def frame(
        self, renderer: ss.Renderer, scene: ss.Scene, camera: ss.Camera, size: tuple[int, int], view: int = 0
    ) -> ss.Image:
        """Render a picture and add it; the time ends when its pixels are there."""

        def draw() -> ss.Image:
            return renderer.render(scene, camera, size=size)

        picture, wall, cpu = clock(draw)
        self.add(wall, cpu, picture.stats, view)
        return picture

    def round(
        self, renderer: ss.Renderer, scene: ss.Scene, cameras: Sequence[ss.Camera], size: tuple[int, int]
    ) -> list[ss.Image]:
        """Render every view once."""
        return [self.frame(renderer, scene, camera, size, view) for view, camera in enumerate(cameras)]

    def _by_view(self, figure: Callable[[_Shot], float], of: Callable[[list[float]], float]) -> float:
        views: dict[int, list[float]] = {}
        for shot in self.shots:
            views.setdefault(shot.view, []).append(figure(shot))
        return statistics.fmean(map(of, views.values()))

    @property
    def wall(self) -> float:
        """Median elapsed time of all frames."""
        return statistics.median(shot.wall for shot in self.shots)

    @property
    def cpu(self) -> float:
        """Median time of all threads of the process together."""
        return statistics.median(shot.cpu for shot in self.shots)

    @property
    def least(self) -> float:
        """Least elapsed time of each view, averaged over the views."""
        return self._by_view(lambda shot: shot.wall, min)

    @property
    def least_cpu(self) -> float:
        """As `least`, of all threads of the process together."""
        return self._by_view(lambda shot: shot.cpu, min)

    @property
    def median(self) -> float:
        """Median elapsed time of each view, averaged over the views."""
        return self._by_view(lambda shot: shot.wall, statistics.median)

    def stat(self, name: str) -> float:
        """Return the median of what the pictures' ``stats`` say; 0 where they say nothing."""
        return statistics.median(shot.stats.get(name, 0.0) for shot in self.shots)

    @property
    def splats(self) -> int:
        """Median number of splats: pairs of a kernel and a buffer that it is drawn into."""
        return round(self.stat("splats") or self.stat("kernels_drawn"))

    def times(self) -> Row:
        """Return medians in milliseconds."""
        return {"wall_ms": 1000.0 * self.wall, "cpu_ms": 1000.0 * self.cpu}

    def row(self, *parts: str) -> Row:
        """Return what most tables show of frames; `parts` name stats seconds_PART that become PART_ms."""
        counts = {name: round(self.stat(name)) for name in ("kernels_drawn", "slices")}
        return counts | self.times() | {f"{part}_ms": 1000.0 * self.stat(f"seconds_{part}") for part in parts}


def time_frames(
    renderer: ss.Renderer, scene: ss.Scene, cameras: Sequence[ss.Camera], size: tuple[int, int], rounds: int = 1
) -> tuple[Timing, ss.Image]:
    """Time every view once a round and return the last picture too.

    A first frame, which makes the index and compiles the shaders, does not count.
    """
    renderer.render(scene, cameras[-1], size=size)
    timing = Timing()
    for _ in range(rounds):
        picture = timing.round(renderer, scene, cameras, size)[-1]
    return timing, picture


def quotient(these: Timing, those: Timing, *, cpu: bool = False) -> float:
    """Return the median quotient of frames that were drawn in turn, so that both met the same load."""
    pairs = zip(these.shots, those.shots, strict=True)
    return statistics.median(
        (one.cpu / max(other.cpu, 1e-9)) if cpu else (one.wall / max(other.wall, 1e-9)) for one, other in pairs
    )


def exponent(rows: Sequence[Row], of: str, figure: str = "cpu_ms") -> float:
    """Return p of figure = c * of^p: a straight line through the rows in logarithms; NaN for fewer than two rows."""
    if len(rows) < 2:
        return math.nan
    numbers, figures = (np.log([row[name] for row in rows]) for name in (of, figure))
    return float(np.polyfit(numbers, figures, 1)[0])


# ------------------------------------------------------------------------------------------------------------ errors


def difference(picture: ss.Image, reference: ss.Image) -> dict[str, float]:
    """Return ``rmse``, ``p99_9`` and ``maximum`` as the conventions, section 8, define them."""
    distances = compare(picture, reference)
    return {name: distances[name] for name in ("rmse", "p99_9", "maximum")}


def rms(values: NDArray[Any]) -> float:
    """Return the root of the mean square, in float64."""
    return math.sqrt(float(np.mean(np.square(values, dtype=np.float64))))


def decibels(rmse: float) -> float:
    """Return a distance of pictures in [0, 1] as a peak signal-to-noise ratio."""
    return math.inf if rmse == 0.0 else -20.0 * math.log10(rmse)


class Judge:
    """Pictures of the reference backend, each made once, at the largest size that the time allows.

    Parameters
    ----------
    size
        The largest size.
    seconds
        Approximate processor time allowed for one picture.
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
                # Four times the pixels cost at most four times as much, and grow about as the last step did.
                if 1.3 * spent * min(4.0, max(1.0, spent / before)) > self._seconds:
                    break
                size = (max(1, round(share * self._size[0])), max(1, round(share * self._size[1])))
                before = spent or math.inf
                picture, _, spent = clock(lambda size=size: self._renderer.render(scene, camera, size=size))  # type: ignore[misc]
            assert picture is not None
            self._made[key] = (scene, camera, picture)
        return self._made[key][2]

    def error(self, renderer: ss.Renderer, scene: ss.Scene, camera: ss.Camera) -> Row:
        """Return rmse, p99_9 and maximum of a renderer's picture, and the size at which they were measured."""
        expected = self.reference(scene, camera)
        width, height = expected.size
        picture = renderer.render(scene, camera, size=expected.size)
        return {**difference(picture, expected), "error_size": f"{width}x{height}"}


def frames_and_error(
    options: Options,
    judge: Judge,
    renderer: ss.Renderer,
    scene: ss.Scene,
    cameras: Sequence[ss.Camera],
    *names: str,
) -> tuple[Row, Timing, ss.Image]:
    """Return the figures of frames with the error of the first view, and keep the last picture under `names`."""
    timing, picture = time_frames(renderer, scene, cameras, options.size)
    keep(options, picture, *names)
    options.say(f"{', '.join(names)}: error against the reference")
    row = timing.row() | {"splats": timing.splats, "fps": 1.0 / timing.wall}
    return row | judge.error(renderer, scene, cameras[0]), timing, picture


# ----------------------------------------------------------------------------------------------------------- cameras


def away(turn: float, rise: float) -> Floats:
    """Return the unit vector towards a camera that is turned about y from z and raised, radians."""
    return np.array([math.sin(turn) * math.cos(rise), math.sin(rise), math.cos(turn) * math.cos(rise)])


def orthographic(centre: Any, towards: Any, distance: float, height: float) -> ss.Camera:
    """Return a camera at a distance from the centre, in the direction `towards`, that sees `height` world units."""
    eye = np.asarray(centre) + distance * np.asarray(towards)
    return ss.Camera.orthographic(tuple(eye.tolist()), tuple(np.asarray(centre).tolist()), height=height)


def orbit_angles(views: int) -> list[float]:
    """Return evenly spaced turns about y, radians, none of them along an axis."""
    return [2.0 * math.pi * (view + 0.1) / views for view in range(views)]


def orbit(seen: Any, views: int, elevation: float = 20.0) -> list[ss.Camera]:
    """Return cameras around what :meth:`Camera.fit` takes."""
    rise = math.radians(elevation)
    return [ss.Camera.fit(seen, direction=tuple((-away(turn, rise)).tolist())) for turn in orbit_angles(views)]


def rays(camera: ss.Camera, size: tuple[int, int]) -> tuple[Floats, Floats]:
    """Return where the rays of an orthographic camera's pixels start, (h, w, 3), and their unit direction."""
    width, height = size
    eye, target, above = (np.asarray(part, dtype=np.float64) for part in (camera.eye, camera.target, camera.up))
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, above)
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead)
    x = (2.0 * (np.arange(width) + 0.5) / width - 1.0) * camera.height / 2.0 * width / height
    y = (1.0 - 2.0 * (np.arange(height) + 0.5) / height) * camera.height / 2.0
    return eye + x[None, :, None] * right + y[:, None, None] * up, ahead


def composited(layers: Iterable[tuple[Floats, float]], shape: tuple[int, ...]) -> Floats:
    """Return layers of a picture (h, w, 4), composited front to back and premultiplied.

    Each layer is its classified colours (h, w, 4), with the length in reference lengths for opacity correction.
    """
    picture = np.zeros((*shape, 4))
    for color, length in layers:
        opacity = -np.expm1(length * np.log1p(-np.minimum(color[..., 3], 1.0 - 1e-12)))
        through = (1.0 - picture[..., 3]) * opacity
        picture[..., :3] += through[..., None] * color[..., :3]
        picture[..., 3] += through
    return picture


# --------------------------------------------------------------------------------------------------------- renderers


def renderer_for(options: Options, **settings: Any) -> ss.Renderer:
    """Return a renderer of the backend that is measured."""
    return ss.Renderer(**{"backend": options.backend, **settings})


def need_gl(plan: ss.RenderPlan, what: str) -> None:
    """Raise Unsupported where another backend than OpenGL draws."""
    if plan.backend != "gl":
        failed = "this row needs OpenGL"
        raise complain(failed, f"{what} on backend {plan.backend}", "backend gl", kind=ss.Unsupported)


def require(plan: ss.RenderPlan, settings: Mapping[str, Any]) -> None:
    """Raise Unsupported where the backend does not have what the settings of a renderer choose between."""
    known = {effect.name for effect in plan.effects}
    for name in settings.get("effects", {}):
        if name not in known:
            need_gl(plan, name)
    for name in ("tagging", "packing"):
        if settings.get(name, "auto") != "auto":
            need_gl(plan, name)


def device_of(renderer: ss.Renderer) -> str:
    """Return the device of a renderer, in words."""
    field = ss.RegularField(np.ones((2, 2, 2), np.uint8))
    scene = ss.Scene(field, [(0.0, 1.0, 1.0, 1.0, 0.0), (1.0, 1.0, 1.0, 1.0, 1.0)])
    return renderer.plan(scene, ss.Camera.fit(field), size=(8, 8)).device


def usable_processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def attempt(run: Callable[[], Row]) -> Row:
    """Return what `run` gives, or the reason why it could not, as the row's remark."""
    try:
        return run()
    except FileNotFoundError as error:
        return {"remark": f"skipped: {error}"}
    except (ss.Unsupported, ss.DeviceUnavailable, ss.OutOfMemory) as error:
        return {"remark": "not run: " + " ".join(str(error).split())}


def measured_rows(options: Options, rows: Mapping[str, T], measure: Callable[[str, T], Row]) -> list[Row]:
    """Return the figures of every row that is wanted, or the reason why there are none."""
    found = []
    for name, row in rows.items():
        if options.wants(name):
            options.say(name)
            found.append({"row": name} | attempt(partial(measure, name, row)))
    return found


# ---------------------------------------------------------------------------------------------- files and processes


def data_folder(options: Options) -> Path:
    """Return the folder of the measured volumes, which need not exist."""
    return options.data or Path(os.environ.get("SHEETSPLAT_DATA") or "../shared/data")


def data_file(options: Options, name: str) -> Path:
    """Return the path of a measured volume. FileNotFoundError where it is missing."""
    path = data_folder(options) / name
    if not path.is_file():
        raise FileNotFoundError(f"{name} is not in the data folder; set SHEETSPLAT_DATA")
    return path


def run_script(script: str, *arguments: str) -> Any:
    """Run a script in a new interpreter with this process's import path; return the last line that it prints, JSON."""
    prelude = f"import sys; sys.path[:] = {sys.path!r}\n"
    done = subprocess.run(
        [sys.executable, "-c", prelude + script, *arguments], capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        raise ss.Error(f"the benchmark's process failed with code {done.returncode}: {done.stderr.strip()[-2000:]}")
    return json.loads(done.stdout.strip().splitlines()[-1])


def in_new_process(function: Callable[..., dict[str, Any]], **arguments: Any) -> dict[str, Any]:
    """Return what a function of a module gives in a new process; arguments and figures pass as JSON."""
    module, name = function.__module__, function.__name__
    script = f"import json; import {module}; print(json.dumps({module}.{name}(**json.loads(sys.argv[1]))))"
    found: dict[str, Any] = run_script(script, json.dumps(arguments))
    return found


def resident(name: str = "VmRSS", process: int | str = "self") -> int:
    """Return bytes of a process in memory: VmRSS now, or VmHWM, their peak.

    The peak of getrusage would begin with the size of the parent process.
    """
    with open(f"/proc/{process}/status", encoding="ascii") as status:
        return 1024 * next(int(line.split()[1]) for line in status if line.startswith(f"{name}:"))


def forget_peak(process: int | str = "self") -> None:
    """Let VmHWM of a process count from here on, where the system allows it."""
    try:
        with open(f"/proc/{process}/clear_refs", "w", encoding="ascii") as mark:
            mark.write("5")
    except OSError:
        pass
