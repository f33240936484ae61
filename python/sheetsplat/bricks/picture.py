"""Pictures of scenes whose field is in bricks: drawn in this process, or by the workers of a client."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat._waiting import asking, part
from sheetsplat.bricks.draw import render_bricks
from sheetsplat.bricks.error import Draw, estimate_error
from sheetsplat.bricks.light import light_of, planned_light
from sheetsplat.bricks.light_error import Measure, measured_light
from sheetsplat.bricks.needs import bricked_field, dimming_bricks, planned, shown_bricks, source_key, view_of
from sheetsplat.bricks.partial import Finished
from sheetsplat.bricks.resident import residents
from sheetsplat.bricks.tasks import Tasks
from sheetsplat.bricks.view import BrickView, figures
from sheetsplat.camera import Camera
from sheetsplat.fields import BrickedField, BrickedKernels
from sheetsplat.image import ErrorEstimate, Image, image_of
from sheetsplat.limits import Depths, checked_depths
from sheetsplat.look.empty import warn_of_unseen
from sheetsplat.options.renderer import Progress
from sheetsplat.plan import RenderPlan
from sheetsplat.quality.lost import keeping, warn_of_lost, with_lost
from sheetsplat.recipe import Recipe
from sheetsplat.scene import Scene
from sheetsplat.supersampling import averaged, fine_depths, fine_size

_log = logging.getLogger("sheetsplat")


class Begun:
    """A picture in bricks that the workers of a client have begun, or that this process draws when it is asked for.

    Raises
    ------
    Unsupported
        For several fields, effects that cannot be drawn in bricks, and workers with another version of this package.
    """

    def __init__(
        self,
        client: Any,
        settings: Mapping[str, Any],
        scene: Scene,
        camera: Camera,
        size: tuple[int, int],
        outputs: tuple[str, ...] = (),
        depth_limit: Depths | None = None,
    ) -> None:
        self._began, self._scene = time.perf_counter(), scene
        field = bricked_field(scene)
        assert field is not None
        view = view_of(field, scene, camera, size, outputs, depth_limit, settings)
        self._view, self._plan = planned(scene, view)
        begin, measure = _HERE
        if client is not None:
            from sheetsplat.bricks import cluster

            begin, measure = partial(cluster.begin, client), partial(cluster.begin_measure, client)
        self._pending = begin(field, self._view)

        def drawn(other: BrickView, progress: Progress | None) -> Finished:
            with asking(progress):
                found: Finished = begin(field, other).result(progress)[0]
            return found

        def measured(opacity: NDArray[np.float32], progress: Progress | None) -> tuple[float, float]:
            with asking(progress):
                found: tuple[float, float] = measure(field, self._view, opacity).result(progress)
            return found

        self._draw: Draw = drawn
        self._measure: Measure = measured

    def result(self, progress: Progress | None = None) -> Image:
        """Return the picture; raises what reading and drawing a brick raises."""
        finished, stats = self._pending.result(progress)
        stats |= {"total": time.perf_counter() - self._began}
        return finished_image(self._scene, self._view, self._plan, finished, stats, self._draw, self._measure)

    def cancel(self) -> None:
        """Give it up."""
        self._pending.cancel()


def draw(
    settings: Mapping[str, Any],
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    outputs: Sequence[str] = (),
    progress: Progress | None = None,
    *,
    depth_limit: ArrayLike | None = None,
    client: Any = None,
) -> Image:
    """Return the picture of a scene whose field is in bricks.

    Parameters
    ----------
    settings
        Options of the renderer.
    scene, camera, size, outputs, progress, depth_limit
        As for `Renderer.render`.
    client
        Its workers draw; None: this process draws brick after brick.

    Raises
    ------
    Unsupported
        For several fields, effects that cannot be drawn in bricks, and workers with another version of this package.
    Cancelled
        Where `progress` returned False.
    Error
        What reading and drawing a brick raises.
    """
    limit = checked_depths(depth_limit, camera, size)
    with asking(progress):
        image = Begun(client, settings, scene, camera, size, tuple(outputs), limit).result(progress)
    warn_of_unseen(image, scene)
    warn_of_lost(scene, camera, size)
    return image


class _Later:
    """What this process does when its result is asked for: as `cluster.Pending`."""

    def __init__(self, function: Callable[..., Any], *given: Any) -> None:
        self._made = partial(function, *given)

    def result(self, progress: Progress | None = None) -> Any:
        """Return the result; raises what the function does."""
        with asking(progress):
            return self._made()

    def cancel(self) -> None:
        """Nothing was begun."""


def _draw_here(field: BrickedField | BrickedKernels, view: BrickView) -> tuple[Finished, dict[str, float]]:
    before = residents().counts.of_picture()
    view = planned_light(view, field)
    with part(0.0, 0.0):
        # Nothing is drawn yet.
        light, of_light = light_of(Tasks(field.source, view), view, source_key(field), dimming_bricks(field, view))
    finished = render_bricks(view, field.source, light, shown_bricks(field, view))
    return finished, figures(view, residents().counts.of_picture() - before, of_light)


def _measure_here(
    field: BrickedField | BrickedKernels, view: BrickView, opacity: NDArray[np.float32]
) -> tuple[float, float]:
    view = planned_light(view, field)
    # The share that is done is not known of bricks.
    with part(0.0, 0.0):
        found: tuple[float, float] = measured_light(Tasks(field.source, view), view, field, opacity)
    return found


_HERE: tuple[Callable[..., Any], Callable[..., Any]] = (partial(_Later, _draw_here), partial(_Later, _measure_here))


def finished_image(
    scene: Scene,
    view: BrickView,
    plan: RenderPlan,
    finished: Finished,
    stats: dict[str, float],
    draw: Draw,
    measure: Measure,
) -> Image:
    """Return a picture that was drawn in bricks, with how it was made; `draw` and `measure` are for its error."""
    samples = scene.supersampling
    width, height = view.size[0] // samples, view.size[1] // samples
    limit = None if view.depth_limit is None else view.depth_limit[::samples, ::samples]
    arrays = averaged(finished, samples)
    _log.info(
        "rendered %d x %d in %.0f of %.0f bricks, %.0f read", width, height, stats["bricks_drawn"], stats["bricks"],
        stats["bricks_read"],
    )  # fmt: skip

    def estimate(progress: Progress | None) -> ErrorEstimate:
        found = estimate_error(
            view, plan, arrays, lambda other, told: averaged(draw(other, told), samples), measure, progress
        )
        better = keeping(scene, view.camera, (width, height))
        if better is None or arrays.scalar is None:
            return found
        count = better.supersampling
        other = view.replace(
            options={**view.options, "filter": better.filter},
            size=fine_size((width, height), count),
            depth_limit=fine_depths(limit, count),
            outputs=(),
            allowed=None,
        )
        whole = averaged(draw(other, progress), count)
        return found if whole.scalar is None else with_lost(found, arrays.scalar, whole.scalar)

    recipe = Recipe.of(scene, view.camera, (width, height), view.settings)
    return image_of(
        recipe,
        plan,
        stats,
        rgba=arrays.rgba,
        scalar=arrays.scalar,
        coverage=arrays.coverage,
        depth=arrays.depth,
        depth_limit=limit,
        scene=scene,
        estimate=estimate,
    )
