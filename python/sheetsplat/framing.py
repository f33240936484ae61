"""Cameras that show all of a field or a scene, and depth cues over the depths that they see."""

from __future__ import annotations

import math
from typing import Any, Unpack

import numpy as np

from sheetsplat._checks import Bounds, Triple, Vector, choice, number, triple
from sheetsplat._checks import direction as axis_or_vector
from sheetsplat.camera import Camera, Kind, bounds_of
from sheetsplat.effects import DepthCue
from sheetsplat.errors import InvalidInput, complain, unusable
from sheetsplat.fields import Field
from sheetsplat.look.measure import Floats
from sheetsplat.look.visible import camera_axes, corners_of, visible_points
from sheetsplat.options.camera import CameraOptions
from sheetsplat.options.core import check_names, filled
from sheetsplat.orientation import BY_Y, Z_UP, Orientation
from sheetsplat.scene import Scene

# Digits of positions that a picture needs at least, in slice distances: with fewer, kernels are not where they were.
_COARSEST = 0.5


def fitting_depth_cue(scene: Scene, camera: Camera, color: Vector = (0.0, 0.0, 0.0), strength: float = 0.8) -> DepthCue:
    """Return a depth cue from the nearest to the farthest corner of the fields' box, as far as the camera sees it."""
    depths = [-camera.native.to_eye((float(x), float(y), float(z)))[2] for x, y, z in corners_of(bounds_of(scene))]
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
    """Return a camera that shows all of a field or a scene in a picture of any shape, turned, zoomed and centred.

    Of a scene it shows what can be seen under the transfer function, of anything else the box around the supports.
    """
    check_names("render", options, CameraOptions)
    if isinstance(thing, Scene):
        _check_digits(thing)
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


def _check_digits(scene: Scene) -> None:
    """Raise InvalidInput where data lie so far from 0 that their positions have no digits left for slices."""
    farthest = float(np.abs(np.asarray(bounds_of(scene))).max()) if not _is_empty(scene) else 0.0
    if np.spacing(farthest) > _COARSEST * scene.slice_spacing:
        raise complain(
            "the data cannot be drawn there",
            f"positions up to {farthest:g}, which float64 resolves to {np.spacing(farthest):.3g}",
            f"less than the slice distance, {scene.slice_spacing:.3g}",
            "subtract a common offset from all positions",
        )


def orientation_of(thing: object) -> Orientation:
    """Return the orientation of the first field that has one, else that of what states nothing."""
    fields = thing.fields if isinstance(thing, Scene) else thing if isinstance(thing, list | tuple) else [thing]
    stated = (one.orientation for one in fields if isinstance(one, Field) and one.orientation is not None)
    return next(stated, Z_UP)


def _view(
    direction: Any, up: Any, azimuth: float | None, elevation: float | None, orientation: Orientation
) -> tuple[Triple, Triple]:
    """Return the direction of view and the up direction, turned by the two angles."""
    upward = axis_or_vector("render: up", orientation.up if up is None else up)
    usable = any(upward) and bool(np.all(np.isfinite(upward)))
    if direction is None and usable:
        x, y, z = orientation.horizontal_front(upward)
        view = -x, -y, -z
    else:
        view = axis_or_vector("render: direction", (0.0, 0.0, -1.0) if direction is None else direction)
    # A direction that is given is not turned further.
    turns = orientation.angles if direction is None else (0.0, 0.0)
    turn = number("render: azimuth", turns[0] if azimuth is None else azimuth)
    rise = number("render: elevation", turns[1] if elevation is None else elevation)
    if not (math.isfinite(turn) and math.isfinite(rise)):
        raise complain("render: azimuth or elevation cannot be used", f"{turn:g}, {rise:g}", "finite angles, degrees")
    if any(view) and usable and np.all(np.isfinite(view)):
        if up is None and _parallel(view, upward):
            upward = _up_from_above(view, orientation)
        level = _turned(view, upward, turn, 0.0)
        view = _turned(view, upward, turn, rise)
        if _parallel(view, upward) and not _parallel(level, upward):
            # Straight from above or below: up is the horizontal direction of view before the eye rose, or its opposite.
            ahead = np.asarray(level) - np.asarray(view) * np.dot(level, view)
            upward = triple("up", ahead if np.dot(view, upward) < 0 else -ahead)
    return view, upward


def _up_from_above(view: Triple, orientation: Orientation) -> Triple:
    """Return the up direction of a view along the orientation's own: y where nothing is stated."""
    if orientation == Z_UP:
        return 0.0, 1.0, 0.0
    # The one that rising to this view from the front would give.
    sign = math.copysign(1.0, np.dot(view, orientation.up))
    return triple("up", sign * np.asarray(orientation.horizontal_front()))


def _framing_all(
    thing: object,
    size: tuple[int, int],
    *,
    direction: Any,
    up: Any,
    y: object,
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
    stated = orientation_of(thing) if y is None else BY_Y[choice("render: y", y, tuple(BY_Y))]
    view, upward = _view(direction, up, azimuth, elevation, stated)
    nearer = number("render: zoom", zoom)
    if not (math.isfinite(nearer) and nearer > 0):
        raise complain(unusable("render: zoom"), f"{nearer:g}", "a finite number above 0")
    width, height = size
    aspect = height / width
    reach = number("render: margin", margin)
    camera = Camera.fit(_Box(bounds), view, upward, projection, reach, fov_y=fov_y)
    seen = visible_points(thing, camera) if isinstance(thing, Scene) and not _is_empty(thing) else None
    points, beyond = (np.ascontiguousarray(corners_of(bounds)), 0.0) if seen is None else seen
    if projection == "perspective":
        camera = _nearest(camera, points, beyond, aspect, reach)
        if nearer == 1.0:
            return camera
        # Moving nearer would end inside the object; a narrower angle enlarges it from where the eye is.
        angle = 2 * math.degrees(math.atan(math.tan(math.radians(camera.fov_y) / 2) / nearer))
        return Camera.perspective(camera.eye, camera.target, camera.up, fov_y=angle, near=camera.near)
    return _closest(camera, points, beyond, aspect, reach / nearer)


def _closest(camera: Camera, points: Floats, beyond: float, aspect: float, margin: float) -> Camera:
    """Return an orthographic camera, moved sideways, whose picture is as small as some points allow."""
    axes = camera_axes(camera)
    places = (points - np.asarray(camera.target)) @ axes.T
    low, high = places.min(axis=0), places.max(axis=0)
    across, upwards, _ = high - low + 2.0 * beyond
    full = max(upwards, across * aspect) * margin
    if not (full > 0 and math.isfinite(full)):
        # A single point: as large as the camera had it.
        return camera
    target = np.asarray(camera.target) + (0.5 * (low + high)) @ axes
    eye = target + (np.asarray(camera.eye) - np.asarray(camera.target))
    try:
        return Camera.orthographic(eye, target, camera.up, height=full)
    except InvalidInput:
        # So far from 0 that no digits are left for the distance of the eye.
        return camera


def _is_empty(thing: object) -> bool:
    """Return True for a field or a scene without a single kernel."""
    fields = thing.fields if isinstance(thing, Scene) else thing
    several = fields if isinstance(fields, list | tuple) else [fields]
    return bool(several) and all(isinstance(one, Field) and one.size == 0 for one in several)


def _parallel(first: Triple, second: Triple) -> bool:
    a, b = np.asarray(first), np.asarray(second)
    return float(np.linalg.norm(np.cross(a / np.linalg.norm(a), b / np.linalg.norm(b)))) < 1e-6


# Steps of moving the eye of a perspective camera sideways until what it sees is in the middle.
_CENTRING = 4


def _nearest(camera: Camera, points: Floats, beyond: float, aspect: float, margin: float) -> Camera:
    """Return a perspective camera moved as near and as central as some points allow; aspect is height over width."""
    slope = math.tan(math.radians(camera.fov_y) / 2)
    axes = camera_axes(camera)
    places = (points - np.asarray(camera.target)) @ axes.T
    middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
    for step in range(_CENTRING + 1):
        offsets = places - middle
        sides = np.maximum(np.abs(offsets[:, 0]) * aspect, np.abs(offsets[:, 1])) + beyond
        distance = float((offsets[:, 2] + beyond + margin / slope * sides).max())
        depths = distance - offsets[:, 2]
        if step == _CENTRING or not (distance > 0 and np.all(depths > 0)):
            break
        tangents = offsets[:, :2] / depths[:, np.newaxis]
        middle[:2] += 0.5 * (tangents.min(axis=0) + tangents.max(axis=0)) * distance
    target = np.asarray(camera.target) + middle @ axes
    # Points at one place, or so far from 0 that no digits are left for them: keep the fitted camera.
    if not distance > 1e-9 * max(1.0, float(np.abs(target).max())) or not math.isfinite(distance):
        return camera
    return Camera.perspective(target + axes[2] * distance, target, camera.up, fov_y=camera.fov_y)


class _Box:
    """Something with bounds."""

    def __init__(self, bounds: Bounds) -> None:
        self.bounds = bounds
