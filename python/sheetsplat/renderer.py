"""The renderer: scene, camera and size become a picture."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Unpack

from numpy.typing import ArrayLike

from sheetsplat import _sheetsplat
from sheetsplat._checks import check_progress, number, whole
from sheetsplat._view import View
from sheetsplat._waiting import FIRST_OF_TWO, portion
from sheetsplat.backends import BACKEND_TRAITS, DEFINING, Backend
from sheetsplat.camera import Camera
from sheetsplat.describe.recipe import Recipe
from sheetsplat.effect_names import check_effects
from sheetsplat.errors import Unsupported, complain, option_ref, unusable
from sheetsplat.expected_time import ExpectedTime, expected_time, may_be_long, warn_of_time
from sheetsplat.image import ErrorEstimate, Image, image_of
from sheetsplat.look import empty
from sheetsplat.look.channel_light import channels_of, light_of
from sheetsplat.look.weighted import mean_of
from sheetsplat.notices import is_muted, muted, warn
from sheetsplat.options.core import checked, definitions, documented, filled
from sheetsplat.options.renderer import Output, Progress, RendererClassOptions, RendererKeywords, check_backend
from sheetsplat.plan import RenderPlan
from sheetsplat.quality.encoded import moved_scenes, with_encoding
from sheetsplat.quality.lost import keeping, warn_of_lost, with_lost
from sheetsplat.quality.thin import LEAST_UNMET, may_be_flat, unmet_kernels
from sheetsplat.scene import Scene
from sheetsplat.supersampling import averaged, counting_samples

_log = logging.getLogger("sheetsplat")

# Effects that look light up on grids, and the root mean square error of a picture from which on a warning says so.
_LIGHT = {"shadows": "shadows", "ambient_occlusion": "values of ambient occlusion"}
_LARGE_LIGHT_ERROR = 0.05


def _chosen_backend(backend: str) -> str:
    """Return a backend, in place of "auto" the one that the environment names."""
    if backend != "auto":
        return backend
    wanted = os.environ.get("SHEETSPLAT_BACKEND", "") or "auto"
    return check_backend("the environment variable SHEETSPLAT_BACKEND", wanted)


def _native(settings: Mapping[str, Any]) -> _sheetsplat.Renderer:
    """Return the native renderer of checked settings."""
    native = dict(settings)
    for name in ("threads", "tile_size", "tags_per_clear"):
        native[name] = native[name] or 0
    return _sheetsplat.Renderer(**native)


def _unused(settings: Mapping[str, Any], plan: RenderPlan) -> list[str]:
    """Return which of the given settings the backend of a plan does not use."""
    users = {name: defined.backends for name, defined in definitions(RendererClassOptions).items()}
    found = [
        name for name, known in users.items() if known and settings[name] is not None and plan.backend not in known
    ]
    if BACKEND_TRAITS[plan.backend].defines:
        # Values that name what it does anyway need no warning.
        ways = {"tagging": plan.tagging, "packing": plan.packing, "path": plan.path}
        found += [name for name, way in ways.items() if settings[name] not in ("auto", way)]
    known = {effect.name for effect in plan.effects if effect.forced}
    return found + [f"the effect {name}" for name, on in settings["effects"].items() if on and name not in known]


@documented(RendererClassOptions)
class Renderer:
    """Makes plans and pictures; keeps the device, and data prepared on it, from one picture to the next.

    Threads may share a renderer, which draws for one at a time. Several renderers may be used at once. The device is
    opened at the first plan or picture; a warning in the log then names the settings that the chosen backend does not
    use.

    With `max_error` or `max_seconds` the renderer tries settings on a few pixels before the first picture of a scene.
    It changes only options of the scene that have their default values, and float64. Where these do not allow the
    error, InvalidInput says so; an error below that of shadows or ambient occlusion from volumes is Unsupported. Where
    the time cannot be kept, the fastest settings are taken, with a PictureWarning.

    Parameters
    ----------
    **options
        Those of RendererClassOptions.

    Raises
    ------
    InvalidInput
        For unknown names, also in SHEETSPLAT_BACKEND.

    Examples
    --------
    >>> renderer = ss.Renderer("cpu", threads=2)
    >>> image = renderer.render(scene, camera, size=(32, 32))
    >>> image.plan.backend
    'cpu'
    """

    __slots__ = ("_settings", "_warned", "native")

    def __init__(self, backend: Backend = "auto", **options: Unpack[RendererKeywords]) -> None:
        self._settings = checked("Renderer", {"backend": backend, **options}, RendererClassOptions)
        self._settings["backend"] = _chosen_backend(self._settings["backend"])
        check_effects(self._settings["backend"], self._settings["effects"])
        self.native = _native(self._settings)
        self._warned: frozenset[str] = frozenset()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy by the settings; the device and what was prepared on it are made anew."""
        return _made, (self._settings,)

    def __eq__(self, other: object) -> bool:
        """Return whether the settings are the same."""
        return self._settings == other._settings if isinstance(other, Renderer) else NotImplemented

    def __hash__(self) -> int:
        """Return a hash of the settings."""
        return hash(tuple(value for name, value in self._settings.items() if name != "effects"))

    def __repr__(self) -> str:
        """Return the settings that differ from their defaults."""
        defaults = filled(RendererClassOptions, {})
        changed = [
            f"{name}={value!r}"
            for name, value in self._settings.items()
            if value not in (defaults[name], {}) and name != "backend"
        ]
        return f"Renderer({', '.join([repr(self._settings['backend']), *changed])})"

    @property
    def settings(self) -> Mapping[str, Any]:
        """Every option of `Renderer` by its name, as it was given or by default."""
        return MappingProxyType(self._settings)

    @property
    def max_error(self) -> float | None:
        """Root mean square distance from the converged picture that pictures may have, or None."""
        goal: float | None = self._settings["max_error"]
        return goal

    @property
    def max_seconds(self) -> float | None:
        """How long a picture may take, or None."""
        goal: float | None = self._settings["max_seconds"]
        return goal

    def plan(
        self,
        scene: Scene,
        camera: Camera,
        size: tuple[int, int] = (400, 400),
        outputs: Iterable[Output] = (),
        *,
        depth_limit: ArrayLike | None = None,
    ) -> RenderPlan:
        """Return the plan of a picture. Raises what `render` would raise before it draws.

        Parameters
        ----------
        scene, camera
            The scene, and the camera that shows it.
        size
            (width, height) in pixels.
        outputs
            Arrays to render in addition to the picture: "coverage", "depth".
        depth_limit
            As for `render`.

        Raises
        ------
        DeviceUnavailable
            Where the backend has no device here; the message lists every attempt.
        InvalidInput, Unsupported, OutOfMemory
            As `render` would.
        """
        view = View.of(scene, camera, size, outputs, depth_limit)
        if scene.sums is not None:
            view = view._replace(scene=scene.sums[1])
        with counting_samples(view.samples):
            native = self.native.plan(**view.native())
        plan = RenderPlan.of_native(native, scene.notes, scene.quality, view.samples)
        expected = self._expected_time(view, plan)
        self._warn_of_unused(plan)
        return replace(plan, expected_seconds=None if expected is None else expected.seconds)

    def measure_effects(
        self,
        scene: Scene,
        camera: Camera,
        size: tuple[int, int] = (400, 400),
        outputs: Iterable[Output] = (),
        *,
        repeats: int = 3,
        progress: Progress | None = None,
        depth_limit: ArrayLike | None = None,
    ) -> RenderPlan:
        """Return the plan with the milliseconds that each effect costs, by drawing the picture with and without it.

        About two dozen effects can be switched, so that this takes about a hundred pictures. Effects that are off are
        timed as well: what they would cost. Costs are medians of differences of consecutive pictures, with a noise of
        some per cent of ``picture_ms``, more on a busy machine. They do not add up, because effects share work.

        Parameters
        ----------
        scene, camera, size, outputs, depth_limit
            As for `render`.
        repeats
            Number of timed pictures of each kind, at least 1.
        progress
            As for `render`, for each picture anew: its share starts at 0 again.

        Raises
        ------
        DeviceUnavailable, InvalidInput, Unsupported, OutOfMemory, Cancelled
            As `render`.
        """
        from sheetsplat.effects_cost import measured_plan

        check_progress("Renderer", progress)
        count = whole("Renderer: repeats", repeats)
        if count < 1:
            raise complain(unusable("Renderer: repeats"), str(count), "a whole number of at least 1")
        view = View.of(scene, camera, size, outputs, depth_limit)
        plan = self.plan(scene, camera, size, outputs, depth_limit=view.depth_limit)
        settings = self._settings | {"backend": plan.backend}
        others: dict[str, _sheetsplat.Renderer] = {}

        def draw(drawn: Scene, asked: tuple[str, ...], effects: dict[str, bool]) -> RenderPlan:
            native = self.native
            if effects:
                key = repr(effects)
                if key not in others:
                    # One additional renderer at a time: each has buffers of its own.
                    others.clear()
                    forced = settings["effects"] | effects
                    others[key] = _native(settings | {"effects": forced, "allow_inexact": True})
                native = others[key]
            image = native.render(**view._replace(scene=drawn, outputs=asked).native(), progress=progress)
            return RenderPlan.of_native(image.plan)

        return measured_plan(plan, scene, view.outputs, draw, count)

    def render(
        self,
        scene: Scene,
        camera: Camera,
        size: tuple[int, int] = (400, 400),
        outputs: Iterable[Output] = (),
        progress: Progress | None = None,
        *,
        depth_limit: ArrayLike | None = None,
    ) -> Image:
        """Return the picture. It releases the GIL while it renders; Ctrl-C stops it within a slice.

        Parameters
        ----------
        scene, camera
            The scene, and the camera that shows it.
        size
            (width, height) in pixels.
        outputs
            Arrays to render in addition to the picture: "coverage", "depth".
        progress
            Called between slices, at most fifty times a second, with the finished share, 0 to 1. Where it returns
            False, the rendering stops; an error that it raises is raised here.
        depth_limit
            Depths of a surface that was drawn elsewhere with the same camera, which hides what lies behind it: (h, w),
            row 0 at the top, world units from the eye along the view direction; infinite, or masked, where there is no
            surface. One number counts for all pixels.

        Raises
        ------
        DeviceUnavailable
            Where the backend has no device here; the message lists every attempt.
        InvalidInput
            For an invalid size, output or depth limit, an unknown effect, and for more than 10⁷ slices.
        Unsupported
            Where the backend does not have a setting, or the error bound cannot be kept.
        OutOfMemory
            Where the picture or its buffers do not fit into memory.
        Cancelled
            Where `progress` returned False.
        """
        view = View.of(scene, camera, size, outputs, depth_limit)
        check_progress("Renderer", progress)
        began = time.perf_counter()
        if (whole := self._of_several(view, progress, began)) is not None:
            return whole
        second = view.second() is not None
        with counting_samples(view.samples):
            self._warn_of_time(view)
            native = self.native.render(
                **view.native(), progress=portion(progress, 0.0, FIRST_OF_TWO if second else 1.0)
            )
        return self._finished(native, view, began, portion(progress, FIRST_OF_TWO, 1.0))

    def progressive(
        self,
        scene: Scene,
        camera: Camera,
        size: tuple[int, int] = (400, 400),
        outputs: Iterable[Output] = (),
        progress: Progress | None = None,
        *,
        first_seconds: float = 0.05,
        depth_limit: ArrayLike | None = None,
    ) -> Iterator[Image]:
        """Return an iterator over stages of the picture, from coarse to fine, each at least twice as fine as the last.

        Coarse stages have fewer pixels, which are interpolated to the full size, and larger slice distances. The last
        stage is what `render` returns. In the ``stats`` of each stage, ``estimated_rmse`` is the estimated distance
        from the last one (for the last one: what its plan expects), and ``stage`` counts from 1 to ``stages``. Nothing
        more is drawn when the iterator is closed or dropped.

        Parameters
        ----------
        scene, camera, size, outputs, depth_limit
            As for `render`.
        progress
            As for `render`, for each stage anew: its share starts at 0 again.
        first_seconds
            Target time of the first stage. Where the whole picture is expected to take no longer, it is the only stage.

        Raises
        ------
        InvalidInput
            Also where `first_seconds` is not above 0.
        DeviceUnavailable, Unsupported, OutOfMemory, Cancelled
            As `render`.
        """
        view = View.of(scene, camera, size, outputs, depth_limit)
        check_progress("Renderer", progress)
        seconds = number("Renderer: first_seconds", first_seconds)
        if scene.sums is not None or channels_of(scene):
            return self._one_stage(view, progress)
        with counting_samples(view.samples):
            stages = self.native.begin_stages(**view.native(), first_seconds=seconds)
        return self._stages(stages, view, progress)

    def _stages(self, stages: _sheetsplat.Stages, view: View, progress: Progress | None) -> Iterator[Image]:
        while not stages.done:
            began = time.perf_counter()
            with counting_samples(view.samples):
                native = self.native.next_stage(stages, progress=progress)
            yield self._finished(native, view, began, portion(progress, 1.0, 1.0))

    def _one_stage(self, view: View, progress: Progress | None) -> Iterator[Image]:
        found = self._of_several(view, progress, time.perf_counter())
        assert found is not None
        yield found

    def _of_several(self, view: View, progress: Progress | None, began: float) -> Image | None:
        """Return a picture that is made of several: a weighted mean, or the light of channels; None for all others."""
        sums, channels = view.scene.sums, channels_of(view.scene)
        scenes = sums or channels
        if not scenes:
            return None
        what = "a weighted mean" if sums else "the light of channels"
        for goal in ("max_error", "max_seconds"):
            if self._settings[goal] is not None:
                found, wanted = f"{what}, which is made of several pictures", "a quality"
                raise complain(unusable(f"Renderer: {goal}"), found, wanted, option=goal, kind=Unsupported)

        def part(number: int) -> Progress | None:
            return None if progress is None else lambda share: progress((number + share) / len(scenes))

        views = [view._replace(scene=one) for one in scenes]
        with counting_samples(view.samples):
            self._warn_of_time(views[1])
            drawn = [self.native.render(**one.native(), progress=part(n)) for n, one in enumerate(views)]
            arrays = [averaged(one, view.samples) for one in drawn]

        def estimate(progress: Progress | None) -> ErrorEstimate:
            failed = f"the error of {what} cannot be estimated"
            raise complain(failed, "several pictures in one", "a picture of one sum", kind=Unsupported)

        scene, native, (first, second) = view.scene, drawn[1], arrays[:2]
        plan = RenderPlan.of_native(native.plan, scene.notes, scene.quality, view.samples)
        expected = {"stage": 1.0, "stages": 1.0, "estimated_rmse": plan.expected_error}
        scalars: Any = [one.scalar for one in arrays]
        coverages = [one.coverage for one in arrays if one.coverage is not None]
        image = image_of(
            self._recipe(native, view),
            plan,
            {**native.stats, **expected, "seconds_total": time.perf_counter() - began},
            rgba=None if sums else light_of(channels, scalars),
            scalar=mean_of(first.scalar, second.scalar, scene.fields[0].value_range) if sums else None,
            coverage=second.coverage if sums or not coverages else sum(coverages[1:], coverages[0]),
            depth_limit=view.depth_limit,
            scene=scene,
            estimate=estimate,
        )
        empty.warn_of_unseen(image, scene)
        if sums:
            warn_of_lost(views[1].scene, view.camera, view.size)
        return image

    def _second(self, native: _sheetsplat.Image, view: View, progress: Progress | None) -> _sheetsplat.Image | None:
        """Return the second picture of a view with slice planes, with the settings of the first one; None: it has none.

        Coarse stages have none.
        """
        arguments = view.second()
        if arguments is None or native.stats.get("stage") != native.stats.get("stages"):
            return None
        renderer, chosen = self.native, native.settings or {}
        if chosen:
            recipe = self._recipe(native, view)
            options = {name: recipe.options[name] for name in chosen if name in recipe.options}
            goals = {"max_error": None, "max_seconds": None, "precision": recipe.renderer["precision"]}
            arguments, renderer = view.second(**options) or arguments, _native(self._settings | goals)
        return renderer.render(**arguments, progress=progress)

    def _finished(self, native: _sheetsplat.Image, view: View, began: float, progress: Progress | None = None) -> Image:
        scene, camera = view.scene, view.camera

        # The picture of many samples a pixel is drawn again for its error, in place of being kept. Settings that a goal
        # chose may differ at the next time.
        goals = [goal for goal in ("max_error", "max_seconds") if self._settings[goal] is not None]
        kept = native if view.samples == 1 or goals else None

        def estimate(progress: Progress | None) -> ErrorEstimate:
            drawn = self.native.render(**view.native(), progress=progress) if kept is None else kept
            found = self.native.estimate_error(drawn, view.native_scene, camera.native, progress=progress)
            estimated = ErrorEstimate.of_native(found, view.samples)
            moved = moved_scenes(view.scene)
            if moved:
                others = [view._replace(scene=one) for one in moved]
                with muted():
                    pictures = [self.native.render(**one.native(), progress=progress) for one in others]
                pictures = [averaged(one, view.samples) for one in pictures]
                estimated = with_encoding(estimated, averaged(drawn, view.samples), pictures)
            better = keeping(view.scene, camera, view.size)
            if better is None:
                return estimated
            other = view._replace(scene=better)
            with muted():
                whole = averaged(self.native.render(**other.native(), progress=progress), other.samples)
            return with_lost(estimated, averaged(drawn, view.samples).scalar, whole.scalar)

        second = self._second(native, view, progress)
        image = Image(native, self._recipe(native, view), estimate, scene, view.depth_limit, view.planes, second)
        width, height = image.size
        plan = image.plan
        self._warn_of_unused(plan)
        stage = ""
        if "stage" in image.stats:
            stage = f"stage {image.stats['stage']:.0f} of {image.stats['stages']:.0f}, "
        seconds = time.perf_counter() - began
        _log.info("rendered %s%d x %d on %s in %.3f s", stage, width, height, plan.backend, seconds)
        settings = "settings for " + " and ".join(goals)
        for goal in goals:
            if image.stats.get(f"{goal}_kept") == 0:
                reason = next(effect.reason for effect in plan.effects if effect.name == settings)
                warn(option_ref(goal) + f" is not kept: {reason}")
        # A coarse stage may miss what the last one shows.
        if image.stats.get("stage") == image.stats.get("stages"):
            empty.warn_of_unseen(image, scene)
            empty.warn_of_ends(scene)
            self._warn_of_unmet(image, scene)
            warn_of_lost(scene, camera, view.size)
            self._warn_of_light(image)
        if _log.isEnabledFor(logging.DEBUG):
            _log.debug("plan\n%s", plan)
            _log.debug("stats %s", image.stats)
        return image

    @staticmethod
    def _expected_time(view: View, plan: RenderPlan | _sheetsplat.RenderPlan) -> ExpectedTime | None:
        drawn = view.scene, view.camera, view.size
        return expected_time(*drawn, plan.backend, plan.device, slices=plan.slices, spacing=plan.slice_spacing)

    def _warn_of_time(self, view: View) -> None:
        """Warn of a picture that is going to take long, unless a goal bounds its time."""
        if is_muted() or self.max_seconds or not may_be_long(*view[:3], self._settings["backend"]):
            return
        warn_of_time(self._expected_time(view, self.native.plan(**view.native())))

    def _recipe(self, native: _sheetsplat.Image, view: View) -> Recipe:
        """Return how a picture was made, with what a goal chose in place of what was given."""
        chosen = dict(native.settings or {})
        settings = {**self._settings, "backend": native.plan.backend}
        if chosen:
            settings["precision"] = chosen.pop("precision")
            second_order = chosen.pop("second_order")
            chosen["preintegration"] = "second_order" if second_order else chosen["preintegration"]
        if view.planes is not None:
            chosen["slice_planes"] = view.planes.planes
        return Recipe.of(view.scene, view.camera, view.size, settings, **chosen)

    @staticmethod
    def _warn_of_unmet(image: Image, scene: Scene) -> None:
        """Warn of kernels that would show and that no slice meets."""
        settings = image.settings or {}
        shown = scene.sketch(slice_spacing=settings["slice_spacing"]) if "slice_spacing" in settings else scene
        point = settings.get("sampling", scene.options["sampling"]) == "point"
        if is_muted() or not point or scene.filter is not None or not may_be_flat(shown):
            return
        unmet = unmet_kernels(shown, image.camera, image.size)
        if unmet.share < LEAST_UNMET:
            return
        warn(
            f"{unmet.count} kernels, {100.0 * unmet.share:.3g} % of what shows, lie between slices and are not seen: "
            f"their length is {unmet.thinnest:.3g}, the slice distance {shown.slice_spacing:.3g}; "
            + option_ref("filter", "ewa")
            + " spreads them, "
            + option_ref("slice_spacing", f"{unmet.thinnest:.3g}")
            + " meets them"
        )

    @staticmethod
    def _warn_of_light(image: Image) -> None:
        """Warn of shadows or ambient occlusion that the backend draws far from their definition."""
        plan = image.plan
        measured = image.stats.get("light_measured")
        for effect in plan.effects:
            if effect.name in _LIGHT and effect.error > _LARGE_LIGHT_ERROR:
                differ = (
                    f"differ from their definition by {effect.error:.2g} (root mean square over the picture): "
                    if measured
                    else f"may differ from their definition by up to {effect.error:.2g} (root mean square over the "
                    "picture, estimated): Image.error measures by how much, "
                )
                warn(
                    f"{_LIGHT[effect.name]} of backend {plan.backend} {differ}"
                    + option_ref("backend", DEFINING)
                    + " draws them as defined"
                )

    def _warn_of_unused(self, plan: RenderPlan) -> None:
        """Warn of settings that the backend does not use; of each once."""
        unused = [name for name in _unused(self._settings, plan) if name not in self._warned]
        if unused:
            self._warned |= frozenset(unused)
            _log.warning("backend %s does not use %s", plan.backend, ", ".join(unused))


def _made(settings: dict[str, Any]) -> Renderer:
    """Return the renderer of what `Renderer.__reduce__` gave."""
    return Renderer(**settings)
