"""What pages ask to be measured: the error of the picture, and what each effect costs."""

from __future__ import annotations

from typing import Any

from sheetsplat.camera import Camera
from sheetsplat.errors import Unsupported, complain
from sheetsplat.fields import any_in_bricks
from sheetsplat.image import Image
from sheetsplat.options.renderer import Progress
from sheetsplat.renderer import Renderer
from sheetsplat.scene import Scene
from sheetsplat.viewer import frames

# Pixels of the pictures that measure what effects cost.
_MEASURED = 240 * 180


def error_of(image: Image, progress: Progress) -> tuple[dict[str, Any], bytes]:
    """Return the message with the error of a picture, and a map of it."""
    found = image.estimate_error(progress)
    payload, largest = frames.error_map(found.map)
    return {"type": "error_map", "rmse": found.rmse, "budget": found.budget, "largest": largest}, payload


def measured_effects(
    renderer: Renderer, scene: Scene, camera: Camera, size: tuple[int, int], progress: Progress
) -> dict[str, Any]:
    """Return the message with what each effect costs, measured in a small picture of the shape of one of a size."""
    share = min(1.0, (_MEASURED / (size[0] * size[1])) ** 0.5)
    small = max(16, int(size[0] * share)), max(16, int(size[1] * share))
    if any_in_bricks(scene.fields):
        found = "data in bricks, which are drawn elsewhere"
        raise complain("effects cannot be measured", found, "data in memory", kind=Unsupported)
    plan = renderer.measure_effects(scene, camera, small, repeats=1, progress=progress)
    costs = {one.name: one.cost_ms for one in plan.effects}
    return {"type": "costs", "size": small, "picture": plan.picture_ms, "costs": costs}
