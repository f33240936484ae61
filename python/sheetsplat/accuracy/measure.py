"""Times, errors, and the pictures from which errors are measured."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _sheetsplat
from sheetsplat.accuracy.sweeps import enlarge, smaller
from sheetsplat.backends import DEFINING, EXACT
from sheetsplat.camera import Camera
from sheetsplat.errors import Cancelled, InvalidInput, Unsupported, complain
from sheetsplat.image import Image
from sheetsplat.modes import TRAITS
from sheetsplat.options.scene import calls_for_gradients
from sheetsplat.renderer import Renderer
from sheetsplat.scene import Scene

Floats = NDArray[np.float32]
# Called with the finished share of the current step; False stops the measurement.
Watch = Callable[[float], object] | None

# Divisors of the distance of slices: the finest picture is extrapolated, the others give the order of convergence.
_FINER = (2, 4, 8)
# Orders of convergence that count as second order.
_SECOND = (1.5, 2.6)
# Sizes at which the reference is tried, relative to the picture.
_SHARES = (0.125, 0.25, 0.5, 1.0)
_FAILED = "the measurement was stopped"


def array_of(picture: Image) -> Floats:
    """Return rgba or scalar, by the mode."""
    return picture.scalar if picture.is_scalar else picture.rgba


def difference(picture: NDArray[Any], expected: NDArray[Any]) -> dict[str, float]:
    """Return ``rmse``, ``p99_9`` and ``maximum``. Conventions, section 8 (Distances between pictures)."""
    first = np.ascontiguousarray(picture, dtype=np.float32)
    second = np.ascontiguousarray(expected, dtype=np.float32)
    return dict(_sheetsplat.compare(first, second, 4 if first.ndim == 3 else 1))


@dataclass(frozen=True)
class Truth:
    """A picture from which errors are measured.

    Attributes
    ----------
    values
        The picture, float64, (h, w, 4) or (h, w).
    uncertainty
        Root mean square distance from the limit that it stands for, estimated.
    order
        Order of convergence in the distance of slices; 2 was extrapolated (Richardson), NaN: not determined.
    text
        How it was made, in words.
    """

    values: NDArray[np.float64]
    uncertainty: float
    order: float
    text: str


def _finest(scene: Scene, factor: int) -> Scene:
    """Return a scene whose picture converges to the limit of fine slices."""
    changes: dict[str, Any] = {
        "slice_spacing": scene.slice_spacing / factor,
        "sampling": "point",
        "opacity_stop": 1.0,
        "filter": None,
        "preintegration": False,
    }
    steps = any(np.any(np.diff(function.points[:, 0]) == 0.0) for function in scene.transfer_functions)
    if TRAITS[scene.mode].is_composited and steps:
        # Steps of the transfer function are exact with pre-integration, and of first order without.
        changes["preintegration"] = True
    return scene.replace(**changes)


def _exactly(scene: Scene, camera: Camera, size: tuple[int, int], settings: dict[str, Any], watch: Watch) -> Image:
    """Return a picture in float64 by the exact backend, or by the reference where that does not support the scene."""
    try:
        exact = Renderer(EXACT, precision="float64", threads=settings.get("threads"))
        return exact.render(scene, camera, size=size, progress=watch)
    except Unsupported:
        return Renderer(DEFINING).render(scene, camera, size=size, progress=watch)


def limit(
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    settings: dict[str, Any],
    watch: Watch = None,
    *,
    analytic: bool = True,
) -> Truth:
    """Return the picture of infinitely fine slices, without an opacity stop or a filter.

    It comes from slices Δs/2, Δs/4 and Δs/8 apart in float64. Where these tend to their limit at second order, the
    last two are extrapolated (Richardson), else the finest is taken as it is. `analytic`: with true gradients, where
    the scene calls for any, which are the limit of small pixels as well.
    """
    words = "float64"
    if calls_for_gradients(scene.options):
        words = "float64, gradients by differences"
        try:
            true = scene.replace(gradient="analytic")
            if analytic or scene.options["gradient"] == "analytic":
                _exactly(_finest(true, 1), camera, (1, 1), settings, watch)
                scene, words = true, "float64, analytic gradients"
        except (Unsupported, InvalidInput):
            pass
    pictures = []
    for number, factor in enumerate(_FINER):
        share = _share(watch, sum(_FINER[:number]) / sum(_FINER), factor / sum(_FINER))
        pictures.append(array_of(_exactly(_finest(scene, factor), camera, size, settings, share)).astype(np.float64))
    coarse, middle, fine = pictures
    first, second = difference(coarse, middle)["rmse"], difference(middle, fine)["rmse"]
    order = math.log2(first / second) if first > 0.0 and second > 0.0 else math.inf
    steps = f"slices Δs/8 apart, {words}, no opacity stop"
    if _SECOND[0] <= order <= _SECOND[1]:
        better = fine + (fine - middle) / 3.0
        before = middle + (middle - coarse) / 3.0
        # The remaining error falls faster than second order; a third of the change is an upper estimate.
        return Truth(better, difference(better, before)["rmse"] / 3.0, order, f"{steps}, extrapolated at second order")
    # The rounding of float32 pictures ends the convergence.
    left = second / (2.0 ** max(order, 0.5) - 1.0) if math.isfinite(order) else 0.0
    return Truth(fine, left, order, f"{steps}, order {order:.1f}: not extrapolated")


def same_slices(
    scene: Scene, camera: Camera, size: tuple[int, int], settings: dict[str, Any], watch: Watch = None
) -> Truth:
    """Return the picture of a scene in float64 with its own slices, gradients and opacity stop."""
    values = array_of(_exactly(scene, camera, size, settings, watch)).astype(np.float64)
    return Truth(values, math.nan, math.nan, "at the same slices, float64")


def _share(watch: Watch, start: float, length: float) -> Watch:
    return None if watch is None else lambda done: watch(start + length * done)


@dataclass(frozen=True)
class Drawn:
    """A picture at its full size, with its times.

    Attributes
    ----------
    values
        (h, w, 4) or (h, w).
    walls, cpus
        Seconds of each frame by the clock, and by the processors of this process together.
    picture
        The image, before it is enlarged.
    """

    values: Floats
    walls: tuple[float, ...]
    cpus: tuple[float, ...]
    picture: Image


def draw(
    renderer: Renderer,
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    *,
    scale: int = 1,
    repeats: int,
    watch: Watch = None,
) -> Drawn:
    """Draw several timed frames, after one that builds the index and compiles the shaders."""
    drawn = smaller(size, scale) if scale > 1 else size
    picture = renderer.render(scene, camera, size=drawn, progress=_share(watch, 0.0, 1.0 / (repeats + 1)))
    walls, cpus = [], []
    values = array_of(picture)
    for number in range(repeats):
        if watch is not None and watch((number + 1) / (repeats + 1)) is False:
            raise complain(_FAILED, kind=Cancelled)
        # Without progress, so that the caller's function is not timed.
        wall, cpu = time.perf_counter(), time.process_time()
        picture = renderer.render(scene, camera, size=drawn)
        values = array_of(picture) if scale == 1 else enlarge(array_of(picture), size)
        cpus.append(time.process_time() - cpu)
        walls.append(time.perf_counter() - wall)
    return Drawn(values, tuple(walls), tuple(cpus), picture)


@dataclass(frozen=True)
class Arithmetic:
    """Distance from the reference at the same slices, and the size at which it was measured; or why it was not."""

    rmse: float = math.nan
    p99_9: float = math.nan
    size: tuple[int, int] | None = None
    reason: str = ""


class Judge:
    """Pictures of the reference backend, as large as the given time allows.

    The picture of the scene `shared`, with which several settings are compared, is made once; others are not kept,
    since each has a field of its own. The largest picture of a scene takes at most about `seconds`; 0: no arithmetic
    error is measured.
    """

    def __init__(self, shared: Scene, camera: Camera, size: tuple[int, int], seconds: float) -> None:
        self._shared = shared
        self._camera = camera
        self._size = size
        self._seconds = seconds
        self._renderer = Renderer(DEFINING)
        # By the factor by which the picture is smaller.
        self._made: dict[int, tuple[Image | None, str]] = {}

    def _picture(self, scene: Scene, scale: int, watch: Watch) -> tuple[Image | None, str]:
        if scene is not self._shared:
            return self._make(scene, scale, watch)
        if scale not in self._made:
            self._made[scale] = self._make(scene, scale, watch)
        return self._made[scale]

    def _make(self, scene: Scene, scale: int, watch: Watch) -> tuple[Image | None, str]:
        full = smaller(self._size, scale)
        picture: Image | None = None
        spent, before = 0.0, math.inf
        for share in _SHARES:
            # Four times the pixels cost four times as much at most, and about as much more as the last step did.
            if 1.3 * spent * min(4.0, max(1.0, spent / before)) > self._seconds:
                break
            size = (max(1, round(share * full[0])), max(1, round(share * full[1])))
            began = time.perf_counter()
            stopped = False

            def late(_: float, began: float = began) -> object:
                nonlocal stopped
                if watch is not None and watch(0.5) is False:
                    stopped = True
                    return False
                return time.perf_counter() - began < 2.0 * self._seconds

            try:
                picture = self._renderer.render(scene, self._camera, size=size, progress=late)
            except Cancelled:
                if stopped:
                    raise
                return picture, f"the reference would take longer than {self._seconds:g} s"
            before, spent = spent or math.inf, time.perf_counter() - began
        return picture, ""

    def judge(
        self, renderer: Renderer, scene: Scene, expected: Scene, drawn: Drawn, scale: int, watch: Watch = None
    ) -> Arithmetic:
        """Return the arithmetic error of a renderer's picture of a scene; the reference draws `expected`."""
        if not self._seconds > 0.0:
            return Arithmetic(reason="not asked for")
        reference, reason = self._picture(expected, scale, watch)
        if reference is None:
            return Arithmetic(reason=reason)
        picture = drawn.picture
        if picture.size != reference.size:
            picture = renderer.render(scene, self._camera, size=reference.size)
        found = difference(array_of(picture), array_of(reference))
        return Arithmetic(found["rmse"], found["p99_9"], reference.size)
