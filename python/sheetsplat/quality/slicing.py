"""How far slices of a lit scene are from ones ever closer together: along some rays of its picture, by its fields."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import Bounds
from sheetsplat.camera import Camera
from sheetsplat.fields import BrickedField, EllipsoidField, Field, RegularField, default_spacing, joined_bounds
from sheetsplat.light import Light, Material
from sheetsplat.look.visible import camera_axes, corners_of, depths_of
from sheetsplat.modes import TRAITS
from sheetsplat.scene import Scene
from sheetsplat.transfer import TransferFunction

Floats = NDArray[np.float64]

#: Slices to one of the default distance whose error is estimated.
SLICES = 2
# Samples of a ray to a slice distance of the default, and rays along each axis of a picture.
_SAMPLES = 4
_RAYS = 18
# Rays end where a thousandth of the light is left.
_OPAQUE = -math.log(1e-3)
# Samples along a ray that are looked at together: those of all rays take some 64 MiB.
_BLOCK = 512
# Samples of all rays, a slice distance apart, beyond which there are fewer rays: some seconds.
_MOST_SAMPLES = 1 << 21
# Kernels that are summed at all of them: some seconds too.
_MOST_SUMMED = 1 << 28
# As in the engine (cpp/src/facts/frame.cpp).
_MOST_SLICES = 1e7
# What pictures of twelve measured volumes estimate, over what the rays do (docs/quality.md): the finest samples of the
# rays are not converged, and gradients of pictures are differences, not derivatives.
_TRUE = 1.0 / 0.76


@dataclass(frozen=True)
class _Rays:
    """Some rays of a picture: points are `starts` + depth times `along`.

    Attributes
    ----------
    starts, along
        (N, 3), world units; along is a unit of depth long in depth.
    near
        Depth before which nothing is seen.
    """

    starts: Floats
    along: Floats
    near: float

    def __getitem__(self, kept: Any) -> _Rays:
        """Return some of them."""
        return _Rays(self.starts[kept], self.along[kept], self.near)

    def inside(self, box: Bounds) -> tuple[Floats, Floats]:
        """Return depths between which rays are in a box, (N,) each; the second is smaller where one is nowhere."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = (np.asarray(box)[:, None] - self.starts) / self.along
        # Of a ray along a face of the box: 0 / 0.
        first, last = np.nan_to_num(np.sort(ends, axis=0), nan=math.inf, posinf=math.inf, neginf=-math.inf)
        return np.maximum(first.max(axis=1), self.near), last.min(axis=1)

    def at(self, rays: NDArray[np.int64], depths: Floats) -> Floats:
        """Return points (M, 3) at depths of rays, both (M,)."""
        return np.asarray(self.starts[rays] + depths[:, None] * self.along[rays])


def can_be_estimated(scene: Scene) -> bool:
    """Return whether the error of a scene's slices is that of the light in a volume."""
    volumes = all(isinstance(one, RegularField) and one.size and not one.labels for one in scene.fields)
    lit = TRAITS[scene.mode].is_composited and len(scene.groups) == 1 and bool(scene.lights)
    return volumes and lit and all(not isinstance(one, BrickedField) or one.can_be_probed for one in scene.fields)


def shows_scattered_alone(scene: Scene) -> bool:
    """Return whether a scene has scattered kernels in every field."""
    return all(isinstance(one, EllipsoidField) and one.size for one in scene.fields)


def has_lit_kernels(scene: Scene) -> bool:
    """Return whether a scene shows scattered kernels alone, lit, whose slices can be estimated at any distance."""
    lit = TRAITS[scene.mode].is_composited and len(scene.groups) == 1 and bool(scene.lights)
    return lit and shows_scattered_alone(scene)


def depth_extent(scene: Scene, camera: Camera) -> float:
    """Return how long the box around a scene's supports is along the view, world units."""
    first, last = _depth_range(joined_bounds([one.bounds for one in scene.fields]), camera)
    return max(0.0, last - first)


def slicing_error(scene: Scene, camera: Camera, size: tuple[int, int], distance: float | None = None) -> float:
    """Return the estimated RMSE of a picture with `SLICES` slices to a distance, of None to the default one.

    Normals in homogeneous material change from sample to sample, by the noise of the samples: light is then as rough as
    its steps are short, and the error falls with the distance of slices, not with its square. How rough it is depends
    on data and transfer function. The picture is composited from every second sample of 324 rays (of fewer through
    thousands of slices) and from all of them, without a stop. Conventions, sections 4 to 6, with derivatives for
    differences; clips, shadows and ambient occlusion are left out.
    """
    fields = [one.where_seen(scene.transfer_function) if isinstance(one, BrickedField) else one for one in scene.fields]
    distance = default_spacing(scene.fields) if distance is None else distance
    boxes = [one.bounds for one in fields]
    rays = _rays(camera, size)
    lengths = sum(np.maximum(last - first, 0.0).sum() for first, last in map(rays.inside, boxes))
    # What has large kernels is smooth.
    kernels = sum(one.kernels_at_a_point if isinstance(one, RegularField) else 0.0 for one in fields)
    most = min(_MOST_SAMPLES, _MOST_SUMMED / max(kernels, 1.0))
    rays = rays[:: max(1, math.ceil(lengths / (distance * most)))]
    intervals = [rays.inside(box) for box in boxes]
    nearest, farthest = _depth_range(joined_bounds(boxes), camera)
    nearest = max(nearest, rays.near)
    # Scenes of more slices are refused when they are drawn.
    count = max(0, math.ceil(min((farthest - nearest) / distance, _MOST_SLICES)))
    pictures = [_Composited(len(rays.starts)) for _ in range(1 + _SAMPLES // SLICES)]
    # Optical depths in front of the samples of a block.
    before = np.zeros(len(rays.starts))
    for start in range(0, count, _BLOCK):
        # One more sample on each side: what is beside one that shows something is looked at too.
        depths = np.asarray(nearest + distance * (0.5 + np.arange(max(0, start - 1), min(count, start + _BLOCK + 1))))
        own = slice(min(start, 1), min(start, 1) + min(count - start, _BLOCK))
        low, high = depths[0] - distance, depths[-1] + distance
        near = np.any([(first < high) & (last > low) for first, last in intervals], axis=0) & (before < _OPAQUE)
        if not near.any():
            continue
        part = rays[near]
        # Where anything can be seen, by a sample a slice distance.
        scalars, reached = _scalars(fields, part, depths, _in_boxes(part, depths, boxes))
        shown = np.where(reached, _optical_depths(scene, scalars, distance), 0.0)
        left = before[near] - shown[:, : own.start].sum(axis=1)
        seen = (shown > 0.0) & (np.cumsum(shown, axis=1) - shown + left[:, None] < _OPAQUE)
        seen[:, 1:] |= seen[:, :-1].copy()
        seen[:, :-1] |= seen[:, 1:].copy()
        before[near] += shown[:, own].sum(axis=1)
        step = distance / _SAMPLES
        fine = (depths[own, None] + step * (np.arange(_SAMPLES) - 0.5 * (_SAMPLES - 1))).ravel()
        picked = np.repeat(seen[:, own], _SAMPLES, axis=1) & _in_boxes(part, fine, boxes)
        if not picked.any():
            continue
        colors, thickness = _lit(scene, fields, camera, part, fine, picked, step)
        pictures[0].add(near, colors, thickness)
        every = _SAMPLES // SLICES
        for first, picture in enumerate(pictures[1:]):
            picture.add(near, colors[:, first::every], every * thickness[:, first::every])
    squares = [np.mean(np.square(one.colors - pictures[0].colors)) for one in pictures[1:]]
    return _TRUE * math.sqrt(float(np.mean(squares)))


class _Composited:
    """What some rays show, from the front to where they are: premultiplied colours and opacities, (N, 4)."""

    def __init__(self, count: int) -> None:
        self.colors = np.zeros((count, 4))
        self._depths = np.zeros(count)

    def add(self, rays: NDArray[np.bool_], colors: Floats, thickness: Floats) -> None:
        """Go on by what the rays of a mask show behind: see `composited`."""
        self.colors[rays] += np.exp(-self._depths[rays])[:, None] * composited(colors, thickness)
        self._depths[rays] += thickness.sum(axis=1)


def _rays(camera: Camera, size: tuple[int, int]) -> _Rays:
    """Return rays all over a picture, one at a random place of each of equal parts, the same in every call."""
    right, up, back = camera_axes(camera)
    generator = np.random.default_rng(2005)
    places = (np.indices((_RAYS, _RAYS)).reshape(2, -1) + generator.random((2, _RAYS * _RAYS))) / _RAYS - 0.5
    across, above = places[0] * size[0] / size[1], places[1]
    eye = np.asarray(camera.eye, dtype=np.float64)
    if camera.kind == "orthographic":
        shifts = camera.height * (across[:, None] * right + above[:, None] * up)
        return _Rays(eye + shifts, np.tile(-back, (len(across), 1)), -math.inf)
    height = 2.0 * math.tan(0.5 * math.radians(camera.fov_y))
    across, above = across + camera.shift[0], above + camera.shift[1]
    along = height * (across[:, None] * right + above[:, None] * up) - back
    return _Rays(np.tile(eye, (len(across), 1)), along, camera.near)


def _depth_range(bounds: Bounds, camera: Camera) -> tuple[float, float]:
    """Return the depths of the nearest and the farthest corner of a box."""
    found = depths_of(corners_of(bounds), camera)
    return float(found.min()), float(found.max())


def _in_boxes(rays: _Rays, depths: Floats, boxes: Sequence[Bounds]) -> NDArray[np.bool_]:
    """Return which points at all depths of all rays lie in any box, (N, D)."""
    places = [rays.starts[:, axis, None] + depths * rays.along[:, axis, None] for axis in range(3)]
    found = np.zeros(places[0].shape, dtype=bool)
    for box in boxes:
        inside = ~found
        for at, low, high in zip(places, *box, strict=True):
            inside &= (at > low) & (at < high)
        found |= inside
    return found


def _scalars(
    fields: Sequence[Field], rays: _Rays, depths: Floats, picked: NDArray[np.bool_]
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the sum of fields at picked points, 0 elsewhere, and where any is not empty, each (N, D)."""
    ray, number = np.nonzero(picked)
    points = rays.at(ray, depths[number])
    found, reached = np.zeros(picked.shape), np.zeros(picked.shape, bool)
    for one in fields:
        scalars, there = one.scalars_and_shown(points)
        found[picked] += scalars
        reached[picked] |= there
    return found, reached


def _optical_depths(scene: Scene, scalars: Floats, distance: float) -> Floats:
    opacity = np.minimum(scene.transfer_function.at(scalars)[..., 3], 1.0 - 2.0**-24)
    return np.asarray(-np.log1p(-opacity) * (distance / scene.reference_length))


def _lit(
    scene: Scene,
    fields: Sequence[Field],
    camera: Camera,
    rays: _Rays,
    depths: Floats,
    picked: NDArray[np.bool_],
    step: float,
) -> tuple[Floats, Floats]:
    """Return shaded colours, (N, D, 3), and optical depths, (N, D), of picked points; nothing elsewhere."""
    ray, number = np.nonzero(picked)
    points = rays.at(ray, depths[number])
    scalars, gradients = np.zeros(len(points)), np.zeros((len(points), 3))
    reached = np.zeros(len(points), bool)
    for one in fields:
        own_scalars, own_gradients, nearest = one.probe(points)
        scalars += own_scalars
        gradients += own_gradients
        reached |= nearest >= 0
    lengths = np.linalg.norm(rays.along, axis=1)
    weak = weakest_gradient(scene.transfer_function, [one.value_range for one in fields], scene.reference_length)
    normals = _normals(gradients, weak or 1.0)
    views = -(rays.along / lengths[:, None])[ray]
    shaded = _phong(scene, camera, scene.transfer_function.at(scalars)[:, :3], normals, views)
    colors, thickness = np.zeros((*picked.shape, 3)), np.zeros(picked.shape)
    colors[picked] = shaded
    thickness[picked] = np.where(reached, _optical_depths(scene, scalars, step) * lengths[ray], 0.0)
    return colors, thickness


def weakest_gradient(
    function: TransferFunction, ranges: Sequence[tuple[float, float]], reference_length: float
) -> float:
    """Return the gradient below which light fades. Conventions, section 5; `ranges`: of the values of fields."""
    points = function.points[:, 0]
    width = max((high - low for low, high in ranges), default=0.0)
    return 1e-3 * max(float(points[-1] - points[0]), width / 4096.0) / reference_length


def _normals(gradients: Floats, weak: float) -> Floats:
    """Return normals, (M, 3), shorter than 1 where gradients are weaker than `weak`. Conventions, section 5.

    Values and lengths of any size are estimated: where gradients leave float64 there is ambient light alone.
    """
    known = np.where(np.isfinite(gradients).all(axis=1, keepdims=True), gradients, 0.0)
    # Squares of components would leave float64 earlier than these.
    largest = np.abs(known).max(axis=1, keepdims=True)
    known = known / np.where(largest > 0.0, largest, 1.0)
    lengths = np.linalg.norm(known, axis=1, keepdims=True)
    with np.errstate(over="ignore"):
        strength = np.minimum(lengths * (largest / weak), 1.0)
    return np.asarray(-known / np.where(lengths > 0.0, lengths, 1.0) * strength)


def _phong(scene: Scene, camera: Camera, colors: Floats, normals: Floats, views: Floats) -> Floats:
    """Return colours in the light of a scene; all (M, 3)."""
    axes = camera_axes(camera)
    towards = [np.asarray(one.direction) @ (axes if one.space == "eye" else np.eye(3)) for one in scene.lights]
    return phong(scene.material, scene.lights, towards, colors, normals, views)


def phong(
    material: Material,
    lights: Sequence[Light],
    directions: Sequence[Floats],
    colors: Floats,
    normals: Floats,
    views: Floats,
) -> Floats:
    """Return colours in some lights, (M, 3). Conventions, section 6.

    Parameters
    ----------
    material, lights
        Of a scene.
    directions
        Towards each light in the world, (3,) or (M, 3).
    colors, normals, views
        Without light; unit normals; unit directions towards the eye; (M, 3).
    """
    found = material.ambient * colors
    for light, direction in zip(lights, directions, strict=True):
        towards = np.broadcast_to(np.asarray(direction, dtype=np.float64), normals.shape)
        towards = towards / np.linalg.norm(towards, axis=1)[:, None]
        facing = np.einsum("ij,ij->i", normals, towards)
        sign = np.where(facing < 0.0, -1.0, 1.0) if material.two_sided else np.ones(len(facing))
        facing = np.maximum(sign * facing, 0.0)
        mirrored = 2.0 * (sign * facing)[:, None] * normals - towards
        gleam = np.where(facing > 0.0, np.maximum(np.einsum("ij,ij->i", mirrored, views), 0.0), 0.0)
        diffuse = (material.diffuse * facing)[:, None] * colors
        found = found + np.asarray(light.color) * (diffuse + (material.specular * gleam**material.shininess)[:, None])
    return found


def composited(colors: Floats, thickness: Floats) -> Floats:
    """Return premultiplied colours and opacities of rays, (N, 4)."""
    behind = np.exp(thickness - np.cumsum(thickness, axis=1))
    weights = -np.expm1(-thickness) * behind
    return np.concatenate((np.einsum("nd,ndc->nc", weights, colors), weights.sum(axis=1)[:, None]), axis=1)
