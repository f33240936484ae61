"""Pictures of scenes whose field is in bricks: drawn in this process, or by the workers of a client."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat._waiting import FIRST_OF_TWO, asking, part, portion
from sheetsplat.bricks.draw import render_bricks
from sheetsplat.bricks.error import estimate_error
from sheetsplat.bricks.light import light_of, planned_light
from sheetsplat.bricks.light_error import measured_light
from sheetsplat.bricks.needs import bricked_field, dimming_bricks, planned, shown_bricks, source_key, view_of
from sheetsplat.bricks.partial import Finished
from sheetsplat.bricks.resident import residents
from sheetsplat.bricks.tasks import Tasks
from sheetsplat.bricks.view import BrickView, figures
from sheetsplat.camera import Camera
from sheetsplat.describe.recipe import Recipe
from sheetsplat.fields import Bricked
from sheetsplat.image import ErrorEstimate, Image, image_of
from sheetsplat.limits import Depths, checked_depths
from sheetsplat.look.empty import warn_of_unseen
from sheetsplat.options.renderer import Progress
from sheetsplat.planes_in_view import PlanesInView
from sheetsplat.quality.lost import keeping, warn_of_lost, with_lost
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
        self._began, self._scene, self._size, self._limit = time.perf_counter(), scene, size, depth_limit
        field = bricked_field(scene)
        assert field is not None
        self._planes = planes = PlanesInView.of(scene, camera, size, depth_limit)
        limit, other = fine_depths(depth_limit, scene.supersampling), None
        if planes is not None:
            scene, limit, other = planes.in_front, planes.limit(depth_limit), planes.other_limit(depth_limit)
        view = view_of(field, scene, camera, size, outputs, limit, settings)
        self._view, self._plan = planned(scene, view)
        self._begin, self._begin_measure = _HERE
        if client is not None:
            from sheetsplat.bricks import cluster

            self._begin, self._begin_measure = partial(cluster.begin, client), partial(cluster.begin_measure, client)
        self._field, self._pending = field, self._begin(field, self._view)
        # Of pixels in which planes end or cross.
        self._second = None if other is None else self._begin(field, self._view.replace(depth_limit=other, outputs=()))

    def result(self, progress: Progress | None = None) -> Image:
        """Return the picture; raises what reading and drawing a brick raises."""
        first = 1.0 if self._second is None else FIRST_OF_TWO
        finished, stats = self._pending.result(portion(progress, 0.0, first))
        second = None if self._second is None else self._second.result(portion(progress, first, 1.0))[0]
        stats |= {"total": time.perf_counter() - self._began}
        scene, view, samples = self._scene, self._view, self._scene.supersampling
        drawn = averaged(finished, samples)
        arrays, chosen = drawn, {}
        if self._planes is not None:
            arrays, chosen = self._planes.behind(finished, second), {"slice_planes": self._planes.planes}
        _log.info(
            "rendered %d x %d in %.0f of %.0f bricks, %.0f read", *self._size, stats["bricks_drawn"], stats["bricks"],
            stats["bricks_read"],
        )  # fmt: skip
        return image_of(
            Recipe.of(scene, view.camera, self._size, view.settings, **chosen),
            self._plan,
            stats,
            rgba=arrays.rgba,
            scalar=arrays.scalar,
            coverage=arrays.coverage,
            depth=arrays.depth,
            depth_limit=self._limit,
            scene=scene,
            estimate=partial(self._estimate, drawn),
        )

    def _estimate(self, arrays: Finished, progress: Progress | None) -> ErrorEstimate:
        scene, view = self._scene, self._view

        def draw(other: BrickView, told: Progress | None, samples: int = scene.supersampling) -> Finished:
            with asking(told):
                found: Finished = averaged(self._begin(self._field, other).result(told)[0], samples)
            return found

        def measure(opacity: NDArray[np.float32], told: Progress | None) -> tuple[float, float]:
            with asking(told):
                found: tuple[float, float] = self._begin_measure(self._field, view, opacity).result(told)
            return found

        found = estimate_error(view, self._plan, arrays, draw, measure, progress)
        better = keeping(scene, view.camera, self._size)
        if better is None or arrays.scalar is None:
            return found
        count = better.supersampling
        other = view.replace(
            options={**view.options, "filter": better.filter},
            size=fine_size(self._size, count),
            depth_limit=fine_depths(self._limit, count),
            outputs=(),
            allowed=None,
        )
        whole = draw(other, progress, count)
        return found if whole.scalar is None else with_lost(found, arrays.scalar, whole.scalar)

    def cancel(self) -> None:
        """Give it up."""
        self._pending.cancel()
        if self._second is not None:
            self._second.cancel()


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


def _draw_here(field: Bricked, view: BrickView) -> tuple[Finished, dict[str, float]]:
    before = residents().counts.of_picture()
    view = planned_light(view, field)
    with part(0.0, 0.0):
        # Nothing is drawn yet.
        light, of_light = light_of(Tasks(field.source, view), view, source_key(field), dimming_bricks(field, view))
    finished = render_bricks(view, field.source, light, shown_bricks(field, view))
    return finished, figures(view, residents().counts.of_picture() - before, of_light)


def _measure_here(field: Bricked, view: BrickView, opacity: NDArray[np.float32]) -> tuple[float, float]:
    view = planned_light(view, field)
    # The share that is done is not known of bricks.
    with part(0.0, 0.0):
        found: tuple[float, float] = measured_light(Tasks(field.source, view), view, field, opacity)
    return found


_HERE: tuple[Callable[..., Any], Callable[..., Any]] = (partial(_Later, _draw_here), partial(_Later, _measure_here))
