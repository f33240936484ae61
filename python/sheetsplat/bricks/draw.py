"""Draws single bricks, and whole pictures brick after brick in one process."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._waiting import asked
from sheetsplat._waiting import part as part_of
from sheetsplat.bricks.needs import field_of
from sheetsplat.bricks.partial import Finished, Partial, empty, finish, merge
from sheetsplat.bricks.partition import Grouped, grouped
from sheetsplat.bricks.resident import renderer_of, residents
from sheetsplat.bricks.view import BrickView
from sheetsplat.fields import Field
from sheetsplat.modes import TRAITS
from sheetsplat.options.renderer import OUTPUTS
from sheetsplat.scene import Scene
from sheetsplat.tiles import window


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
    native = Scene.of_checked([((field,), view.transfer_function)], options).native
    return view.part(native, view.cell(number), depths, in_front=in_front, light=light)


def draw_brick(
    view: BrickView, number: int, field: Field, in_front: NDArray[np.float32] | None = None, light: Any = None
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
    in_front
        Opacity in front of it, float32 (h, w) of its footprint: then it is drawn behind that, and stop and depth are
        exact. Alone unless given: then no stop ends a pixel.
    light
        Light volumes of all bricks (`bricks.light`), where the picture has shadows or ambient occlusion.

    Raises
    ------
    InvalidInput, Unsupported, OutOfMemory, Cancelled
        As `Renderer.render`.
    """
    rect = view.footprint(number)
    if rect is None:
        return empty(view)
    left, top, right, bottom = rect
    size = right - left, bottom - top
    camera = window(view.camera, view.size, (left, top), size)
    scene = native_part(view, number, field, view.depths_of(number), in_front, light)
    if view.depth_limit is not None:
        scene = scene.with_depth_limit(np.ascontiguousarray(view.depth_limit[top:bottom, left:right]))
    also = {name: name in view.outputs for name in OUTPUTS}
    image = renderer_of(view.settings).render(scene=scene, camera=camera.native, size=size, **also, progress=asked())
    residents().counts.drawn += 1

    def of(array: NDArray[np.float32] | None, dtype: type = np.float32) -> NDArray[np.floating] | None:
        # Without a copy where the type is right: the array keeps the picture that it belongs to.
        return None if array is None else np.asarray(array, dtype)

    scalar = of(image.scalar, np.float64 if TRAITS[view.mode].adds else np.float32)
    counts = of(image.counts)
    if TRAITS[view.mode].mean and scalar is not None and counts is not None:
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


def _render(view: BrickView, source: Any, number: int, light: Any, in_front: NDArray[np.float32] | None) -> Partial:
    """Return what a brick adds behind some opacity in its footprint; a hidden one is not asked for."""
    rect = view.footprint(number)
    assert rect is not None
    if in_front is None or not is_hidden(view, number, in_front):
        return draw_brick(view, number, field_of(source, view, number), in_front, light)
    # Nothing but the opacity in front of it.
    rgba = np.zeros((*in_front.shape, 4), np.float32)
    rgba[..., 3] = in_front
    depth = np.full(in_front.shape, np.inf, np.float32) if "depth" in view.outputs else None
    return Partial(view.mode, rect, rgba=rgba, depth=depth, is_behind=True)


def render_brick(view: BrickView, source: Any, number: int, light: Any, *before: Partial) -> Partial:
    """Return what a brick adds behind others that cover some of its pixels; raises what `draw_brick` does."""
    if view.any_order:
        return _render(view, source, number, light, None)
    x0, y0, x1, y1 = rect = view.footprint(number) or (0, 0, 0, 0)
    in_front = np.zeros((y1 - y0, x1 - x0), np.float32)
    for part in before:
        # Where several cover a pixel the last has the most.
        in_front = np.maximum(in_front, part.opacity(rect))
    return _render(view, source, number, light, in_front)


def render_bricks(view: BrickView, source: Any, light: Any = None, shown: Collection[int] | None = None) -> Finished:
    """Return a picture that is drawn brick after brick, from front to back, in this process.

    It is the picture of the whole field within the rounding of float32, stop and depth included. Bricks outside of the
    view and behind opaque ones are not asked for.

    Parameters
    ----------
    view
        The picture.
    source
        What `field_of` makes the fields of bricks of.
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
    in_front = None if view.any_order else np.zeros((height, width), np.float32)
    asked_of = [n for n in (range(len(view.partition)) if shown is None else shown) if view.footprint(n) is not None]
    done = 0

    def merged(group: Grouped) -> Partial:
        """Draw and merge in the order in which a cluster does."""
        nonlocal done
        if not isinstance(group, int):
            return merge(view, *map(merged, group))
        x0, y0, x1, y1 = view.footprint(group) or (0, 0, 0, 0)
        before = None if in_front is None else in_front[y0:y1, x0:x1]
        with part_of(done / len(asked_of), (done + 1) / len(asked_of)):
            part = _render(view, source, group, light, before)
        if before is not None and part.rgba is not None:
            before[:] = part.rgba[..., 3]
        done += 1
        return part

    tree = grouped(view.nested(), asked_of)
    return finish(view, empty(view) if tree is None else merged(tree))
