"""The renderer: scene, camera and size become a picture."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Literal

from sheetsplat import _sheetsplat, advice
from sheetsplat._checks import choice, image_size, instance, names, number, shown, truth, whole
from sheetsplat.camera import Camera
from sheetsplat.effects_cost import measured_plan
from sheetsplat.errors import complain
from sheetsplat.image import ErrorEstimate, Image
from sheetsplat.plan import RenderPlan
from sheetsplat.scene import Scene

Backend = Literal["auto", "gl", "cpu", "reference"]
Precision = Literal["auto", "uint8", "float16", "float32", "float64"]
Tagging = Literal["auto", "depth_bounds", "depth_equal", "tiles", "off"]
Packing = Literal["auto", "paper", "wide"]
Output = Literal["coverage", "depth"]
# Told the share that is done, from 0 to 1; False stops the rendering, anything else does not.
Progress = Callable[[float], object]

_log = logging.getLogger("sheetsplat")
BACKENDS = ("auto", "gl", "cpu", "reference")
PRECISIONS = ("auto", "uint8", "float16", "float32", "float64")
TAGGINGS = ("auto", "depth_bounds", "depth_equal", "tiles", "off")
PACKINGS = ("auto", "paper", "wide")
OUTPUTS = ("coverage", "depth")
MOST_THREADS = 1024


def _chosen_backend(backend: str) -> str:
    choice("Renderer: backend", backend, BACKENDS)
    if backend == "auto":
        wanted = os.environ.get("SHEETSPLAT_BACKEND", "") or "auto"
        return choice("the environment variable SHEETSPLAT_BACKEND", wanted, BACKENDS)
    return backend


def _outputs(outputs: object) -> tuple[str, ...]:
    return names("Renderer: outputs", outputs, OUTPUTS)


def _count(what: str, value: object) -> int:
    result = whole(what, value)
    if result < 0:
        raise complain(f"{what} cannot be used", str(result), "a whole number of at least 1", "leave it out")
    return result


def _goal(what: str, value: object) -> float:
    result = number(what, value)
    if not result > 0:
        raise complain(f"{what} cannot be used", str(result), "a number above 0", "leave it out")
    return result


def _threads(threads: object) -> int:
    wanted = f"a whole number from 1 to {MOST_THREADS}, or None for as many as the process may run on"
    result = whole("Renderer: threads", threads, wanted)
    if not 1 <= result <= MOST_THREADS:
        raise complain("Renderer: threads cannot be used", str(result), wanted)
    return result


def _idle(given: Mapping[str, object], forced: Mapping[str, bool], plan: RenderPlan) -> list[str]:
    """Return which of the settings that were given say nothing to the backend of a plan."""
    users = {"device": ("gl",), "tags_per_clear": ("gl",), "threads": ("cpu",), "tile_size": ("gl", "cpu")}
    idle = [name for name, backends in users.items() if name in given and plan.backend not in backends]
    if plan.backend == "reference":
        # What it does anyway may be asked for.
        ways = {"tagging": plan.tagging, "packing": plan.packing}
        idle += [name for name, way in ways.items() if given.get(name, "auto") not in ("auto", way)]
    known = {effect.name for effect in plan.effects if effect.forced}
    return idle + [f"the effect {name}" for name, on in forced.items() if on and name not in known]


class Renderer:
    """Keeps a device and what it prepared between pictures.

    Threads may share a renderer: they take turns. Several renderers may live side by side.

    Parameters
    ----------
    backend
        "auto", "gl" (OpenGL), "cpu" (vector instructions of the processor) or "reference". "auto" is what the
        environment variable SHEETSPLAT_BACKEND says, else "gl" on graphics hardware and "cpu" where there is none;
        what the one does not support, the other is tried for.
    device
        Number of the EGL device; the environment variable SHEETSPLAT_EGL_DEVICE, else the first that works, unless
        given.
    precision
        Numbers of the sheet buffers: "auto", "uint8", "float16", "float32" or "float64", of what the backend has
        ("gl": up to 32 bits; "cpu": 32 or 64).
    tagging
        How empty space is skipped: "auto", "depth_bounds", "depth_equal", "tiles" or "off".
    packing
        How slices lie in buffers: "auto", "paper" (four in one, one shaded a pass) or "wide" (several shaded a pass).
    effects
        Forces single effects on or off, by name; ``plan().effects`` lists the names.
    allow_inexact
        Lets settings through that cannot keep the error bound.
    tile_size
        Largest edge of an image tile in pixels; what the device can do unless given.
    tags_per_clear
        Depth tags before the depth buffer is cleared; what its resolution allows unless given.
    threads
        Of backend "cpu"; as many as the process may run on at once unless given. Pictures do not depend on them.
    max_error
        Root mean square distance from the converged picture (`Image.error`) that pictures may have, at least 6e-8. The
        renderer takes the cheapest settings that keep it, and tries them with few pixels before the first picture of a
        scene. What the scene has at its default is chosen: slice_spacing, sampling, preintegration, opacity_stop. What
        differs from the default stays as it is; where that does not allow the error, InvalidInput says so. The unit is
        that of `ErrorEstimate.rmse`: of colours and opacity, 0 to 1; in the modes "xray" and "mip" of scalars over the
        largest one, where that is above 1. An error below what shadows or ambient occlusion from volumes are expected
        to have is out of reach (Unsupported); backend "reference" has no volumes.
    max_seconds
        How long a picture may take once the renderer knows the scene, an aim: settings of the smallest error are taken
        that are expected to keep it, or the fastest ones where none are, with a warning in the log. Together with
        `max_error`, the time is kept where both cannot be, with a warning.

    The device itself is looked for at the first plan or picture. Settings that say nothing to the backend which is
    taken are told in the log then, as a warning.

    Raises
    ------
    InvalidInput
        For unknown names, also in SHEETSPLAT_BACKEND.
    """

    __slots__ = ("_backend", "_forced", "_given", "native", "_native_settings", "_told_idle")

    def __init__(
        self,
        backend: Backend = "auto",
        *,
        device: int | None = None,
        precision: Precision = "auto",
        tagging: Tagging = "auto",
        packing: Packing = "auto",
        effects: Mapping[str, bool] | None = None,
        allow_inexact: bool = False,
        tile_size: int | None = None,
        tags_per_clear: int | None = None,
        threads: int | None = None,
        max_error: float | None = None,
        max_seconds: float | None = None,
    ) -> None:
        forced: dict[str, bool] = {}
        if effects is not None:
            if not isinstance(effects, Mapping) or not all(isinstance(name, str) for name in effects):
                raise complain("Renderer: effects cannot be used", shown(effects), "{name: True or False}")
            forced = {name: truth(f"Renderer: the effect {shown(name)}", on) for name, on in effects.items()}
        self._backend = _chosen_backend(backend)
        self._native_settings: dict[str, Any] = {
            "backend": self._backend,
            "device": None if device is None else whole("Renderer: device", device),
            "precision": choice("Renderer: precision", precision, PRECISIONS),
            "tagging": choice("Renderer: tagging", tagging, TAGGINGS),
            "packing": choice("Renderer: packing", packing, PACKINGS),
            "effects": forced,
            "allow_inexact": truth("Renderer: allow_inexact", allow_inexact),
            "tile_size": 0 if tile_size is None else _count("Renderer: tile_size", tile_size),
            "tags_per_clear": 0 if tags_per_clear is None else _count("Renderer: tags_per_clear", tags_per_clear),
            "threads": 0 if threads is None else _threads(threads),
        }
        goals = {"max_error": max_error, "max_seconds": max_seconds}
        self._native_settings |= {
            name: _goal(f"Renderer: {name}", value) for name, value in goals.items() if value is not None
        }
        self.native = _sheetsplat.Renderer(**self._native_settings)
        settings = {"device": device, "tagging": tagging, "packing": packing, "threads": threads}
        # 0 is what they are unless given.
        settings |= {"tile_size": tile_size or None, "tags_per_clear": tags_per_clear or None}
        self._given = {name: value for name, value in settings.items() if value is not None}
        self._forced = forced
        self._told_idle: frozenset[str] = frozenset()

    def __repr__(self) -> str:
        """Return a short description."""
        return f"Renderer({self._backend!r})"

    @property
    def max_error(self) -> float | None:
        """Root mean square distance from the converged picture that pictures may have, or None."""
        return self._native_settings.get("max_error")

    @property
    def max_seconds(self) -> float | None:
        """How long a picture may take, or None."""
        return self._native_settings.get("max_seconds")

    def plan(
        self,
        scene: Scene,
        camera: Camera,
        size: tuple[int, int] = (400, 400),
        outputs: Iterable[Output] = (),
    ) -> RenderPlan:
        """Return what would run, and why. Raises what `render` would raise before it draws.

        Parameters
        ----------
        scene, camera
            What is seen, and from where.
        size
            (width, height) in pixels.
        outputs
            "coverage" and "depth", where wanted beside the picture.

        Raises
        ------
        DeviceUnavailable
            Where the backend has no device here; the message lists every try.
        InvalidInput, Unsupported, OutOfMemory
            As `render` would.
        """
        instance("Renderer: scene", scene, Scene)
        instance("Renderer: camera", camera, Camera)
        wanted = _outputs(outputs)
        native = self.native.plan(
            scene.native,
            camera.native,
            size=image_size(size),
            coverage="coverage" in wanted,
            depth="depth" in wanted,
        )
        plan = RenderPlan._of(native)
        self._tell_idle(plan)
        return plan

    def measure_effects(
        self,
        scene: Scene,
        camera: Camera,
        size: tuple[int, int] = (400, 400),
        outputs: Iterable[Output] = (),
        *,
        repeats: int = 3,
    ) -> RenderPlan:
        """Return the plan with the milliseconds that each effect costs, by drawing the picture with and without it.

        Some two dozen effects can be turned the other way, so this takes some hundred pictures. Effects that are off
        are timed as well: what it would cost to leave them in. Costs are medians of differences between neighbours:
        they carry noise of some per cent of ``picture_ms``, more on a busy machine, and do not add up, since effects
        share work.

        Parameters
        ----------
        scene, camera, size, outputs
            As for `render`.
        repeats
            Pictures of each kind that are timed, at least 1.

        Raises
        ------
        DeviceUnavailable, InvalidInput, Unsupported, OutOfMemory
            As `render`.
        """
        count = whole("Renderer: repeats", repeats)
        if count < 1:
            raise complain("Renderer: repeats cannot be used", str(count), "a whole number of at least 1")
        wanted = self._asked(scene, camera, outputs, None)
        pixels = image_size(size)
        plan = self.plan(scene, camera, size, outputs)
        settings = self._native_settings | {"backend": plan.backend}
        others: dict[str, _sheetsplat.Renderer] = {}

        def draw(drawn: Scene, asked: tuple[str, ...], effects: dict[str, bool]) -> RenderPlan:
            native = self.native
            if effects:
                key = repr(effects)
                if key not in others:
                    # One at a time beside this one: each keeps buffers of its own.
                    others.clear()
                    forced = settings["effects"] | effects
                    others[key] = _sheetsplat.Renderer(**settings | {"effects": forced, "allow_inexact": True})
                native = others[key]
            image = native.render(
                drawn.native,
                camera.native,
                size=pixels,
                coverage="coverage" in asked,
                depth="depth" in asked,
                progress=None,
            )
            return RenderPlan._of(image.plan)

        return measured_plan(plan, scene, wanted, draw, count)

    def render(
        self,
        scene: Scene,
        camera: Camera,
        size: tuple[int, int] = (400, 400),
        outputs: Iterable[Output] = (),
        progress: Progress | None = None,
    ) -> Image:
        """Return the picture. Other threads of Python run meanwhile; Ctrl-C stops it within a slice.

        Parameters
        ----------
        scene, camera
            What is seen, and from where.
        size
            (width, height) in pixels.
        outputs
            "coverage" and "depth", where wanted beside the picture.
        progress
            Called between slices, at most fifty times a second, with the share that is done, 0 to 1. Where it returns
            False the rendering stops; where it raises, that error comes out of here.

        Raises
        ------
        DeviceUnavailable
            Where the backend has no device here; the message lists every try.
        InvalidInput
            For a size, an output or the name of an effect that has no meaning, and for more than 10⁷ slices.
        Unsupported
            Where the backend does not have a setting, or the picture cannot be made within its error bound.
        OutOfMemory
            Where it does not fit.
        Cancelled
            Where `progress` returned False.
        """
        wanted = self._asked(scene, camera, outputs, progress)
        began = time.perf_counter()
        native = self.native.render(
            scene.native,
            camera.native,
            size=image_size(size),
            coverage="coverage" in wanted,
            depth="depth" in wanted,
            progress=progress,
        )
        return self._told(native, scene, camera, began)

    def progressive(
        self,
        scene: Scene,
        camera: Camera,
        size: tuple[int, int] = (400, 400),
        outputs: Iterable[Output] = (),
        progress: Progress | None = None,
        *,
        first_seconds: float = 0.05,
    ) -> Iterator[Image]:
        """Return an iterator over stages of the picture: coarse ones first, each at least twice as fine.

        Coarse stages have fewer pixels, which are interpolated to the full size, and larger slice distances. The last
        stage is what `render` returns. Of the ``stats`` of each, ``estimated_rmse`` is its estimated distance from the
        last one (for the last one: what its plan expects), and ``stage`` counts from 1 to ``stages``. Where the
        iterator is closed, or just left, nothing more is drawn.

        Parameters
        ----------
        scene, camera, size, outputs
            As for `render`.
        progress
            As for `render`, for each stage: its share runs from 0 to 1 again.
        first_seconds
            How long the first stage may take: an aim. Where all of the picture is expected to take no longer, it is the
            only stage.

        Raises
        ------
        InvalidInput
            Also where `first_seconds` is not above 0.
        DeviceUnavailable, Unsupported, OutOfMemory, Cancelled
            As `render`.
        """
        wanted = self._asked(scene, camera, outputs, progress)
        seconds = number("Renderer: first_seconds", first_seconds)
        stages = self.native.begin_stages(
            scene.native,
            camera.native,
            size=image_size(size),
            coverage="coverage" in wanted,
            depth="depth" in wanted,
            first_seconds=seconds,
        )
        return self._stages(stages, scene, camera, progress)

    def _stages(
        self, stages: _sheetsplat.Stages, scene: Scene, camera: Camera, progress: Progress | None
    ) -> Iterator[Image]:
        while not stages.done:
            began = time.perf_counter()
            native = self.native.next_stage(stages, progress=progress)
            yield self._told(native, scene, camera, began)

    def _asked(self, scene: object, camera: object, outputs: object, progress: object) -> tuple[str, ...]:
        instance("Renderer: scene", scene, Scene)
        instance("Renderer: camera", camera, Camera)
        if progress is not None and not callable(progress):
            raise complain("Renderer: progress cannot be used", shown(progress), "a function of one number, or None")
        return _outputs(outputs)

    def _told(self, native: _sheetsplat.Image, scene: Scene, camera: Camera, began: float) -> Image:
        def estimate() -> ErrorEstimate:
            found = self.native.estimate_error(native, scene.native, camera.native, progress=None)
            return ErrorEstimate._of(found)

        image = Image._of(native, estimate)
        width, height = image.size
        plan = image.plan
        self._tell_idle(plan)
        stage = ""
        if "stage" in image.stats:
            stage = f"stage {image.stats['stage']:.0f} of {image.stats['stages']:.0f}, "
        seconds = time.perf_counter() - began
        _log.info("rendered %s%d x %d on %s in %.3f s", stage, width, height, plan.backend, seconds)
        for goal in ("max_error", "max_seconds"):
            if image.stats.get(f"{goal}_kept") == 0:
                _log.warning("%s is not kept: %s", goal, image.plan.effects[-1].reason)
        if advice.is_empty(image, scene):
            _log.warning("nothing can be seen in the picture: %s", advice.why_empty(scene))
        if _log.isEnabledFor(logging.DEBUG):
            _log.debug("plan\n%s", plan)
            _log.debug("stats %s", image.stats)
        return image

    def _tell_idle(self, plan: RenderPlan) -> None:
        """Warn of settings that say nothing to the backend; of each once."""
        idle = [name for name in _idle(self._given, self._forced, plan) if name not in self._told_idle]
        if idle:
            self._told_idle |= frozenset(idle)
            _log.warning("backend %s does not use %s", plan.backend, ", ".join(idle))
