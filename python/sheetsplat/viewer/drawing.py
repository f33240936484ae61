"""What draws a state: its renderer, and the pictures of it, each finer than the one before."""

from __future__ import annotations

from collections.abc import Iterable

from sheetsplat.bricks.picture import draw as draw_in_bricks
from sheetsplat.fields import any_in_bricks
from sheetsplat.image import Image
from sheetsplat.options.renderer import Progress
from sheetsplat.renderer import Renderer
from sheetsplat.scene import Scene
from sheetsplat.viewer.data import Shown
from sheetsplat.viewer.state import State


def renderer_of(shown: Shown, state: State) -> Renderer:
    """Return a renderer with the settings of a state."""
    if not state.settings:
        return shown.base(0, 0).renderer
    return Renderer(**{**shown.renderer_options(), **state.settings})


def pictures_of(
    shown: Shown,
    renderer: Renderer,
    scene: Scene,
    state: State,
    size: tuple[int, int],
    progress: Progress,
    first_seconds: float,
) -> Iterable[Image]:
    """Return the pictures of a scene as they are drawn; of data in bricks there is one. Raises what drawing raises.

    first_seconds: as for `Renderer.progressive`.
    """
    if any_in_bricks(scene.fields):
        return [draw_in_bricks(renderer.settings, scene, state.camera, size, (), progress, client=shown.client)]
    return renderer.progressive(scene, state.camera, size=size, progress=progress, first_seconds=first_seconds)
