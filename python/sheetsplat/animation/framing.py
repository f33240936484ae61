"""One camera that shows all that is seen from any side while it turns."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from sheetsplat.animation.path import turned
from sheetsplat.camera import Camera, bounds_of
from sheetsplat.look.measure import Floats
from sheetsplat.look.visible import camera_axes, corners_of, visible_points
from sheetsplat.options.camera import CameraOptions
from sheetsplat.options.core import filled
from sheetsplat.scene import Scene

# Views from which it is found what can be seen, and views for which the picture is made large enough.
_LOOKS = 4
_VIEWS = 36
_MOST_POINTS = 20_000


def _seen_points(scene: Scene, camera: Camera, axis: Floats, degrees: float) -> tuple[Floats, float]:
    """Return the points that can be seen from anywhere on the way, and how far they reach."""
    found, beyond = [], 0.0
    for look in range(_LOOKS):
        seen = visible_points(scene, turned(camera, axis, degrees * look / _LOOKS))
        if seen is None:
            return np.ascontiguousarray(corners_of(bounds_of(scene))), 0.0
        points, reach = seen
        found.append(points[:: max(1, len(points) // _MOST_POINTS)])
        beyond = max(beyond, reach)
    return np.concatenate(found), beyond


def turning_camera(
    scene: Scene, camera: Camera, axis: Floats, degrees: float, size: tuple[int, int], options: dict[str, Any]
) -> Camera:
    """Return a camera that looks along the given one, at a point about which it can turn with nothing cut off.

    Parameters
    ----------
    scene
        What is shown; an empty one leaves the camera as it is.
    camera
        Fitted to the first picture, with the options.
    axis, degrees
        The turn.
    size
        (width, height) in pixels.
    options
        Those of the camera.
    """
    given: dict[str, Any] = filled(CameraOptions, options)
    if given["target"] is not None or not any(one.size for one in scene.fields):
        return camera
    points, beyond = _seen_points(scene, camera, axis, degrees)
    middle = _pivot(points, axis)
    margin, aspect = float(given["margin"]), size[1] / size[0]
    slope = math.tan(math.radians(float(given["fov_y"])) / 2)
    needed = 0.0
    for view in range(_VIEWS):
        axes = camera_axes(turned(camera, axis, degrees * view / _VIEWS))
        offsets = np.abs((points - middle) @ axes[:2].T)
        sides = np.maximum(offsets[:, 0] * aspect, offsets[:, 1]) + beyond
        if camera.kind == "orthographic":
            needed = max(needed, 2.0 * float(sides.max()) * margin)
        else:
            nearness = (points - middle) @ axes[2] + beyond
            needed = max(needed, float((nearness + margin / slope * sides).max()))
    if not (needed > 0.0 and math.isfinite(needed)):
        return camera
    back = np.asarray(camera.eye) - np.asarray(camera.target)
    if camera.kind == "orthographic":
        # The eye lies outside of the data from every side.
        distance = max(float(np.linalg.norm(back)), float(np.linalg.norm(points - middle, axis=1).max()) + beyond)
        eye = middle + back / np.linalg.norm(back) * distance
        return Camera.orthographic(eye, middle, camera.up, height=needed / float(given["zoom"]))
    return Camera.perspective(middle + back / np.linalg.norm(back) * needed, middle, camera.up, fov_y=camera.fov_y)


def _pivot(points: Floats, axis: Floats) -> Floats:
    """Return the middle of the box around points that has an edge along the axis."""
    along = axis / np.linalg.norm(axis)
    side = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    side /= np.linalg.norm(side)
    frame = np.array([along, side, np.cross(along, side)])
    places = points @ frame.T
    middle: Floats = 0.5 * (places.min(axis=0) + places.max(axis=0)) @ frame
    return middle
