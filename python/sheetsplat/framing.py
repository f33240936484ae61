"""Cameras that show all of a field or a scene, and depth cues over the depths that they see."""

from __future__ import annotations

import math
from typing import Any, Unpack

import numpy as np

from sheetsplat._checks import Bounds, Triple, Vector, number, triple
from sheetsplat._checks import direction as axis_or_vector
from sheetsplat.camera import Camera, Kind, bounds_of
from sheetsplat.effects import DepthCue
from sheetsplat.errors import complain, unusable
from sheetsplat.fields import Field
from sheetsplat.options.camera import AZIMUTH, ELEVATION, CameraOptions
from sheetsplat.options.core import check_names, filled
from sheetsplat.scene import Scene


def fitting_depth_cue(scene: Scene, camera: Camera, color: Vector = (0.0, 0.0, 0.0), strength: float = 0.8) -> DepthCue:
    """Return a depth cue from the nearest to the farthest corner of the fields' box, as far as the camera sees it."""
    low, high = bounds_of(scene)
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    depths = [-camera.native.to_eye((float(x), float(y), float(z)))[2] for x, y, z in corners]
    start = max(min(depths), camera.near) if camera.kind == "perspective" else min(depths)
    # The box may have no extent along the view, or lie behind the eye.
    end = max(depths) if max(depths) > start else start + max(abs(start), 1.0)
    return DepthCue(start, end, color, strength)


def _turned(direction: Triple, up: Triple, azimuth: float, elevation: float) -> Triple:
    """Return the direction of view after the eye moved around `up` by azimuth and towards it by elevation, degrees."""
    view = np.asarray(direction) / np.linalg.norm(direction)
    axis = np.asarray(up) / np.linalg.norm(up)
    turned = _rotate(view, axis, math.radians(azimuth))
    right = np.cross(turned, axis)
    length = float(np.linalg.norm(right))
    if length < 1e-9:
        # From above or below elevation has no axis; the camera refuses such an up direction.
        return triple("direction", turned)
    return triple("direction", _rotate(turned, right / length, -math.radians(elevation)))


def _rotate(vector: Any, axis: Any, angle: float) -> Any:
    """Return a vector rotated about a unit axis, counter-clockwise seen against the axis (Rodrigues' formula)."""
    along = axis * np.dot(axis, vector)
    return along + math.cos(angle) * (vector - along) + math.sin(angle) * np.cross(axis, vector)


def compose_camera(thing: object, size: tuple[int, int], **options: Unpack[CameraOptions]) -> Camera:
    """Return a camera that shows all of a field or a scene in a picture of any shape, turned, zoomed and centred."""
    check_names("render", options, CameraOptions)
    given: dict[str, Any] = filled(CameraOptions, options)
    target = given.pop("target")
    if target is None:
        return _framing_all(thing, size, **given)
    middle = np.asarray(triple("render: target", target))
    if not np.all(np.isfinite(middle)):
        raise complain(unusable("render: target"), f"{tuple(middle.tolist())}", "three finite numbers")
    camera = _framing_all(thing, size, **given)
    eye = middle + (np.asarray(camera.eye) - np.asarray(camera.target))
    if camera.kind == "perspective":
        return Camera.perspective(eye, middle, camera.up, fov_y=camera.fov_y, near=camera.near)
    return Camera.orthographic(eye, middle, camera.up, height=camera.height)


def _view(direction: Any, up: Any, azimuth: float | None, elevation: float | None) -> tuple[Triple, Triple]:
    """Return the direction of view and the up direction, turned by the two angles."""
    view = axis_or_vector("render: direction", (0.0, 0.0, -1.0) if direction is None else direction)
    upward = axis_or_vector("render: up", (0.0, 1.0, 0.0) if up is None else up)
    # A direction that is given is not turned further.
    turn = number("render: azimuth", (AZIMUTH if direction is None else 0.0) if azimuth is None else azimuth)
    rise = number("render: elevation", (ELEVATION if direction is None else 0.0) if elevation is None else elevation)
    if not (math.isfinite(turn) and math.isfinite(rise)):
        raise complain("render: azimuth or elevation cannot be used", f"{turn:g}, {rise:g}", "finite angles, degrees")
    if any(view) and any(upward) and np.all(np.isfinite(view)) and np.all(np.isfinite(upward)):
        if up is None and _parallel(view, upward):
            # The up direction that rising to this view from the front would give.
            upward = (0.0, 0.0, math.copysign(1.0, view[1]))
        level = _turned(view, upward, turn, 0.0)
        view = _turned(view, upward, turn, rise)
        if _parallel(view, upward) and not _parallel(level, upward):
            # Straight from above or below: up is the horizontal direction of view before the eye rose, or its opposite.
            ahead = np.asarray(level) - np.asarray(view) * np.dot(level, view)
            upward = triple("up", ahead if np.dot(view, upward) < 0 else -ahead)
    return view, upward


def _framing_all(
    thing: object,
    size: tuple[int, int],
    *,
    direction: Any,
    up: Any,
    azimuth: float | None,
    elevation: float | None,
    zoom: float,
    projection: Kind,
    fov_y: float,
    margin: float,
) -> Camera:
    """Return a camera whose target is the middle of what it shows."""
    # Without a kernel there is no box, and the picture is empty from anywhere.
    bounds: Bounds = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)) if _is_empty(thing) else bounds_of(thing)
    view, upward = _view(direction, up, azimuth, elevation)
    nearer = number("render: zoom", zoom)
    if not (math.isfinite(nearer) and nearer > 0):
        raise complain(unusable("render: zoom"), f"{nearer:g}", "a finite number above 0")
    width, height = size
    reach = number("render: margin", margin)
    box = _Box(bounds)
    if projection == "perspective":
        camera = _nearest(Camera.fit(box, view, upward, projection, reach, fov_y=fov_y), bounds, height / width, reach)
        if nearer == 1.0:
            return camera
        # Moving nearer would end inside the object; a narrower angle enlarges it from where the eye is.
        angle = 2 * math.degrees(math.atan(math.tan(math.radians(camera.fov_y) / 2) / nearer))
        return Camera.perspective(camera.eye, camera.target, camera.up, fov_y=angle, near=camera.near)
    camera = Camera.fit(box, view, upward, projection, reach, fov_y=fov_y)
    # Width and height of the box as this camera sees it: the sums of the projections of its edges.
    edges = np.diag(np.subtract(bounds[1], bounds[0]))
    across, high, _ = np.abs([camera.native.direction_to_eye(triple("edge", edge)) for edge in edges]).sum(axis=0)
    if across > 0 and high > 0:
        reach *= max(high, across * height / width) / max(high, across)
    return Camera.fit(box, view, upward, projection, reach / nearer, fov_y=fov_y)


def _is_empty(thing: object) -> bool:
    """Return True for a field or a scene without a single kernel."""
    fields = thing.fields if isinstance(thing, Scene) else thing
    several = fields if isinstance(fields, list | tuple) else [fields]
    return bool(several) and all(isinstance(one, Field) and one.size == 0 for one in several)


def _parallel(first: Triple, second: Triple) -> bool:
    a, b = np.asarray(first), np.asarray(second)
    return float(np.linalg.norm(np.cross(a / np.linalg.norm(a), b / np.linalg.norm(b)))) < 1e-6


def _nearest(camera: Camera, bounds: Bounds, aspect: float, margin: float) -> Camera:
    """Return a perspective camera moved as near as the corners of a box allow; aspect is height over width."""
    half = 0.5 * np.subtract(bounds[1], bounds[0])
    slope = math.tan(math.radians(camera.fov_y) / 2)
    edges = [camera.native.direction_to_eye(triple("edge", edge)) for edge in np.diag(half)]
    signs = np.stack(np.meshgrid(*3 * [(-1.0, 1.0)]), axis=-1).reshape(8, 3)
    corners = np.abs(signs @ np.asarray(edges)[:, :2]), signs @ np.asarray(edges)[:, 2]
    distance = float((corners[1] + margin / slope * np.maximum(corners[0][:, 0] * aspect, corners[0][:, 1])).max())
    target = np.asarray(camera.target)
    back = np.asarray(camera.eye) - target
    length = float(np.linalg.norm(back))
    # A box without an extent, or one so far from 0 that no digits are left for it: keep the fitted camera.
    if not distance > 1e-9 * max(1.0, float(np.abs(target).max())) or not math.isfinite(distance):
        return camera
    return Camera.perspective(target + back * (distance / length), target, camera.up, fov_y=camera.fov_y)


class _Box:
    """Something with bounds."""

    def __init__(self, bounds: Bounds) -> None:
        self.bounds = bounds
