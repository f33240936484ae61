"""Draws single bricks, and whole pictures brick after brick in one process."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.bricks.partial import Finished, Partial, empty, finish, merge
from sheetsplat.bricks.partition import Grouped, grouped
from sheetsplat.bricks.view import BrickView
from sheetsplat.fields import Field
from sheetsplat.options.renderer import OUTPUTS, Progress
from sheetsplat.renderer import Renderer
from sheetsplat.scene import Scene

#: What makes the field of a brick: for lattices that of `BrickView.samples`, of scattered kernels those that
#: `Brick.reached` names. None: nothing of it can show.
FieldOf = Callable[[int], Field | None]


@lru_cache(maxsize=8)
def _renderer(settings: tuple[tuple[str, Any], ...], _: str) -> Renderer:
    plain: dict[str, Any] = {name: dict(value) if name == "effects" else value for name, value in settings}
    return Renderer(**plain)


def renderer_of(settings: Mapping[str, Any], of: str = "bricks") -> Renderer:
    """Return the renderer of this process with some settings, which keeps what it found of bricks, or of wholes."""
    pairs = tuple(
        (name, tuple(sorted(value.items())) if isinstance(value, Mapping) else value)
        for name, value in settings.items()
    )
    return _renderer(pairs, of)


def forget_renderers() -> None:
    """Forget the renderers of this process, and what they found; tasks that draw keep theirs to their end."""
    _renderer.cache_clear()


def native_part(
    view: BrickView,
    number: int,
    field: Field,
    depths: tuple[float, float],
    in_front: NDArray[np.float32] | None = None,
    light: Any = None,
) -> Any:
    """Return the native scene of one brick, sliced between two depths, without its depth limit."""
    options = dict(view.options)
    options["background"] = None
    if in_front is None:
        options["opacity_stop"] = 1.0
    native = Scene.of_checked(field, view.transfer_function, options).native
    return native.with_part(
        cell=view.cell(number),
        centres=view.whole.centres,
        depths=depths,
        in_front=in_front,
        domain=view.whole.domain,
        filled=view.whole.is_filled,
        light=light,
    )


def _also(view: BrickView) -> dict[str, bool]:
    return {name: name in view.outputs for name in OUTPUTS}


def draw_brick(
    view: BrickView,
    number: int,
    field: Field,
    renderer: Renderer,
    in_front: NDArray[np.float32] | None = None,
    progress: Progress | None = None,
    light: Any = None,
) -> Partial:
    """Return what one brick adds to a picture.

    Parameters
    ----------
    view
        The picture.
    number
        Of the brick.
    field
        Its kernels and ghosts.
    renderer
        Draws it; made from ``view.settings``. It keeps what it found of a field for the next picture of the same one.
    in_front
        Opacity in front of it, float32 (h, w) of its footprint: then it is drawn behind that, and stop and depth are
        exact. Alone unless given: then no stop ends a pixel.
    progress
        As for `Renderer.render`.
    light
        Light volumes of all bricks (`bricks.light`), where the picture has shadows or ambient occlusion.

    Raises
    ------
    InvalidInput, Unsupported, OutOfMemory, Cancelled
        As `Renderer.render`.
    """
    drawn = view.window(number)
    if drawn is None:
        return empty(view)
    rect, camera = drawn
    left, top, right, bottom = rect
    scene = native_part(view, number, field, view.depths_of(number), in_front, light)
    if view.depth_limit is not None:
        scene = scene.with_depth_limit(np.ascontiguousarray(view.depth_limit[top:bottom, left:right]))
    size = (right - left, bottom - top)
    image = renderer.native.render(scene=scene, camera=camera.native, size=size, **_also(view), progress=progress)

    def of(array: NDArray[np.float32] | None, dtype: type = np.float32) -> NDArray[np.floating] | None:
        # Without a copy where the type is right: the array keeps the picture that it belongs to.
        return None if array is None else np.asarray(array, dtype)

    scalar = of(image.scalar, np.float64 if view.mode in ("xray", "average") else np.float32)
    counts = of(image.counts)
    if view.mode == "average" and scalar is not None and counts is not None:
        scalar = np.where(counts > 0, scalar, 0.0) * counts
    return Partial(
        view.mode,
        rect,
        rgba=of(image.rgba),
        scalar=scalar,
        counts=counts,
        coverage=of(image.coverage, np.float64),
        depth=of(image.depth),
        is_behind=in_front is not None,
    )


def is_hidden(view: BrickView, number: int, in_front: NDArray[np.float32]) -> bool:
    """Return whether all pixels that a brick can change are finished by what is in front: (h, w) of its footprint."""
    if view.is_scalar or "coverage" in view.outputs:
        return False
    middle = view.places.middle(number)
    if middle is not None and in_front[middle[1], middle[0]] < view.opacity_stop:
        return False
    return bool((in_front[view.outline(number)] >= view.opacity_stop).all())


def render_bricks(
    view: BrickView,
    field_of: FieldOf,
    renderer: Renderer,
    progress: Progress | None = None,
    light: Any = None,
    shown: Collection[int] | None = None,
) -> Finished:
    """Return a picture that is drawn brick after brick, from front to back, in this process.

    It is the picture of the whole field within the rounding of float32, stop and depth included. Bricks outside of the
    view and behind opaque ones are not asked for.

    Parameters
    ----------
    view
        The picture.
    field_of
        Makes the field of a brick, by its number.
    renderer
        Draws it; made from ``view.settings``.
    progress
        Called with the share of bricks that are done; False stops.
    light
        As for `draw_brick`.
    shown
        The bricks that may show; all unless given.

    Raises
    ------
    InvalidInput, Unsupported, OutOfMemory, Cancelled
        As `Renderer.render`.
    """
    width, height = view.size
    in_front = None if view.is_scalar or view.any_order else np.zeros((height, width), np.float32)
    shown = range(len(view.partition)) if shown is None else shown
    count, done = len(shown), 0

    def part_of(number: int) -> Partial:
        rect = view.footprint(number)
        if rect is None:
            return empty(view)
        x0, y0, x1, y1 = rect
        before = None if in_front is None else in_front[y0:y1, x0:x1]
        if before is not None and is_hidden(view, number, before):
            return empty(view)
        field = field_of(number)
        if field is None:
            return empty(view)

        def told(share: float) -> object:
            return progress is None or progress((done + share) / count)

        part = draw_brick(view, number, field, renderer, before, told, light)
        if before is not None and part.rgba is not None:
            before[:] = part.rgba[..., 3]
        return part

    def merged(group: Grouped) -> Partial:
        """Draw and merge in the order in which a cluster does."""
        nonlocal done
        if not isinstance(group, int):
            return merge(*map(merged, group))
        part = part_of(group)
        done += 1
        return part

    tree = grouped(view.nested(), shown)
    return finish(view, empty(view) if tree is None else merged(tree))
