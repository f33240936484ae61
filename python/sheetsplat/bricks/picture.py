"""Pictures of scenes whose field is in bricks: drawn in this process, or by the workers of a client."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat._sheetsplat import LightVolumes
from sheetsplat._waiting import asking
from sheetsplat.bricks.draw import render_bricks, renderer_of
from sheetsplat.bricks.error import Draw, estimate_error
from sheetsplat.bricks.light import light_key, light_of, planned_light
from sheetsplat.bricks.light_error import (
    Measure,
    Probes,
    chosen_spots,
    errors_of,
    lines_of,
    merged_spots,
    spots_of,
)
from sheetsplat.bricks.needs import bricked_field, field_of, may_dim, may_show, planned, source_key, view_of
from sheetsplat.bricks.partial import Finished
from sheetsplat.bricks.resident import residents
from sheetsplat.bricks.view import BrickView
from sheetsplat.camera import Camera
from sheetsplat.describe.recipe import Recipe
from sheetsplat.fields import BrickedField, BrickedKernels, Field
from sheetsplat.image import ErrorEstimate, Image, image_of
from sheetsplat.limits import Depths, checked_depths
from sheetsplat.look.empty import warn_of_unseen
from sheetsplat.options.renderer import Progress
from sheetsplat.plan import RenderPlan
from sheetsplat.quality.lost import keeping, warn_of_lost, with_lost
from sheetsplat.renderer import Renderer
from sheetsplat.scene import Scene
from sheetsplat.supersampling import averaged, fine_depths, fine_size

_log = logging.getLogger("sheetsplat")


class Begun:
    """A picture in bricks that the workers of a client have begun.

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
        from sheetsplat.bricks.cluster import begin, begin_measure

        self._began, self._scene = time.perf_counter(), scene
        field = bricked_field(scene)
        assert field is not None
        view = view_of(field, scene, camera, size, outputs, depth_limit, settings)
        self._view, self._plan = planned(scene, view)
        self._pending = begin(client, field, self._view)

        def drawn(other: BrickView, progress: Progress | None) -> Finished:
            with asking(progress):
                found: Finished = begin(client, field, other).result(progress)[0]
            return found

        def measured(opacity: NDArray[np.float32], progress: Progress | None) -> tuple[float, float]:
            with asking(progress):
                found: tuple[float, float] = begin_measure(client, field, self._view, opacity).result(progress)
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
    if client is not None:
        with asking(progress):
            image = Begun(client, settings, scene, camera, size, tuple(outputs), limit).result(progress)
    else:
        began = time.perf_counter()
        field = bricked_field(scene)
        assert field is not None
        view = view_of(field, scene, camera, size, tuple(outputs), limit, settings)
        view, plan = planned(scene, view)
        finished, stats = _draw_here(field, view, progress)
        stats |= {"total": time.perf_counter() - began}
        image = finished_image(
            scene, view, plan, finished, stats,
            lambda other, progress: _draw_here(field, other, progress)[0],
            lambda opacity, progress: _measure_here(field, view, opacity, progress),
        )  # fmt: skip
    warn_of_unseen(image, scene)
    warn_of_lost(scene, camera, size)
    return image


def _draw_here(
    field: BrickedField | BrickedKernels, view: BrickView, progress: Progress | None
) -> tuple[Finished, dict[str, float]]:
    before = residents().counts
    reads, bytes_read, coarse = before.reads, before.bytes_read, before.coarse
    view, renderer = planned_light(view, field), renderer_of(view.settings)
    drawn: set[int] = set()

    def read(number: int) -> Field:
        return field_of(field.source, view, number)  # type: ignore[arg-type]

    def made(number: int) -> Field:
        drawn.add(number)
        return read(number)

    light, dimming = _light_here(field, view, read, renderer, progress)
    shown = [number for number in view.order() if may_show(field, view, number)]
    finished = render_bricks(view, made, renderer, progress, light, shown)
    counts = residents().counts
    return finished, {
        "bricks": float(len(view.partition)),
        "bricks_drawn": float(len(drawn)),
        "bricks_read": float(counts.reads - reads),
        "bytes_read": float(counts.bytes_read - bytes_read),
        "bricks_coarse": float(counts.coarse - coarse),
        "bricks_of_light": float(dimming),
    }


def _measure_here(
    field: BrickedField | BrickedKernels, view: BrickView, opacity: NDArray[np.float32], progress: Progress | None
) -> tuple[float, float]:
    """Return the errors of light in a picture with some opacities: see `Measure`."""
    view, renderer = planned_light(view, field), renderer_of(view.settings)

    def read(number: int) -> Field:
        return field_of(field.source, view, number)  # type: ignore[arg-type]

    light, _ = _light_here(field, view, read, renderer, progress)
    probes = Probes.of(view, opacity)
    shown = [number for number in view.order() if may_show(field, view, number)]
    dimming = [number for number in range(len(view.partition)) if may_dim(field, view, number)]
    if light is None:
        return 0.0, 0.0
    # The share that is done is not known of bricks.
    told = None if progress is None else lambda _: progress(0.0)
    chosen = chosen_spots(
        view, probes, merged_spots(spots_of(view, one, read(one), renderer, light, probes, told) for one in shown)
    )
    asked = sorted({*shown, *dimming})
    lines = (lines_of(view, one, read(one), renderer, light, chosen, told) for one in asked)
    return errors_of(probes, chosen, lines)


# The light volumes of the last picture of this process, by what they depend on.
_last_light: list[tuple[bytes, LightVolumes | None]] = []


def _light_here(
    field: BrickedField | BrickedKernels,
    view: BrickView,
    read: Callable[[int], Field],
    renderer: Renderer,
    progress: Progress | None,
) -> tuple[LightVolumes | None, int]:
    """Return the light volumes of a picture, and of how many bricks they were made now."""
    if view.light is None:
        return None, 0
    key = light_key(view, source_key(field))
    for known, light in tuple(_last_light):
        if known == key:
            return light, 0
    dimming = [number for number in range(len(view.partition)) if may_dim(field, view, number)]
    # Nothing is drawn yet.
    told = None if progress is None else lambda _: progress(0.0)
    light = light_of(view, dimming, read, renderer, told)
    _last_light[:] = [(key, light)]
    return light, len(dimming)


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
