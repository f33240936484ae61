"""What is seen at a pixel: the place along its ray, and the field there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import Triple, number, shown, triple
from sheetsplat.errors import complain, unusable
from sheetsplat.fields import EllipsoidField, Field, RegularField
from sheetsplat.options.core import SCALAR

if TYPE_CHECKING:
    from sheetsplat.image import Image
    from sheetsplat.scene import Scene

Floats = NDArray[np.float64]
# A crossing is looked for in so many parts of an interval, and in as many of the part that has it.
_PARTS = 64


@dataclass(frozen=True)
class Pick:
    """What is seen at a pixel.

    Attributes
    ----------
    position
        World position. Mode "composite": on the slice where the opacity of the pixel first reaches ½, as `Image.depth`
        has it; where it stays below ½, on the slice that contributes most. "isosurface": where the ray first crosses
        the value. "xray", "mip", "average": on the slice with the largest scalar; "minimum": with the smallest.
    depth
        Its depth: world units from the eye along the view direction.
    value
        The scalar there, of all fields together: the field itself in float64, whatever the picture was drawn with.
    gradient
        Its derivatives along x, y, z, per world unit.
    opacity
        Opacity per reference length there; 1 on an isosurface; None in scalar modes.
    field
        Number of the field with the nearest kernel, in the scene.
    kernel
        Number of the kernel in that field whose centre is nearest among those that reach the position; of volumes the
        number of the sample in ``values.ravel()``.
    sample
        (k, j, i) of that sample; None for scattered kernels.
    """

    position: Triple
    depth: float
    value: float
    gradient: Triple
    opacity: float | None
    field: int
    kernel: int
    sample: tuple[int, int, int] | None = None


@dataclass(frozen=True)
class _Ray:
    """The ray of a pixel: world positions at depths."""

    eye: Floats
    # World units for each unit of depth, and at depth 0.
    along: Floats
    beside: Floats
    # Length of the ray in each unit of depth.
    stretch: float

    def at(self, depths: Floats) -> Floats:
        """Return the positions at depths, (M, 3)."""
        return self.eye + self.beside + depths[:, None] * self.along


def _ray(image: Image, column: int, row: int) -> _Ray:
    """Return the ray of a pixel's centre. Conventions, section 1 (Coordinates)."""
    camera, (width, height) = image.camera, image.size
    right, up, back = (np.asarray(axis) for axis in camera.world_axes())
    x = (2.0 * (column + 0.5) / width - 1.0) * width / height
    y = 1.0 - 2.0 * (row + 0.5) / height
    eye = np.asarray(camera.eye)
    if camera.kind == "orthographic":
        return _Ray(eye, -back, 0.5 * camera.height * (x * right + y * up), 1.0)
    slope = math.tan(math.radians(camera.fov_y) / 2.0)
    along = slope * (x * right + y * up) - back
    return _Ray(eye, along, np.zeros(3), float(np.linalg.norm(along)))


def _number(what: str, value: object, count: int) -> int:
    found = number(f"Image.pick: {what}", value)
    if not (math.isfinite(found) and 0 <= found < count):
        raise complain(
            unusable(f"Image.pick: {what}"), shown(value), f"from 0 to below {count}, a place in the picture"
        )
    return int(found)


def _sums(fields: tuple[Field, ...], points: Floats) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Return the scalar of all fields, its gradient, and whether any kernel reaches, at points."""
    values, slopes, reached = np.zeros(len(points)), np.zeros((len(points), 3)), np.zeros(len(points), bool)
    for field in fields:
        value, slope, nearest = field.probe(points)
        values, slopes, reached = values + value, slopes + slope, reached | (nearest >= 0)
    return values, slopes, reached


def _kept(scene: Scene, points: Floats) -> NDArray[np.bool_]:
    """Return whether clipping keeps points."""
    clip = scene.options["clip"]
    kept = np.ones(len(points), bool)
    for normal, offset in clip.planes:
        kept &= points @ np.asarray(normal) >= offset
    if clip.box is not None:
        kept &= ((points >= clip.box[0]) & (points <= clip.box[1])).all(axis=1)
    return kept


def pick(image: Image, scene: Scene, x: object, y: object) -> Pick | None:
    """Return what is seen at a pixel of a picture of a scene; see `Image.pick`."""
    width, height = image.size
    ray = _ray(image, _number("x", x, width), _number("y", y, height))
    depths = _depths(image, scene)
    if not depths.size:
        return None
    points = ray.at(depths)
    values, slopes, reached = _sums(scene.fields, points)
    shown_here = reached & _kept(scene, points)
    if scene.mode == "isosurface":
        depth = _crossing(scene, ray, depths, values, _kept(scene, points), image.plan.slice_spacing)
        return None if depth is None else _pick_at(scene, ray, depth, 1.0)
    if scene.mode in SCALAR:
        if not shown_here.any():
            return None
        sign = -1.0 if scene.mode == "minimum" else 1.0
        return _pick_at(scene, ray, float(depths[np.where(shown_here, sign * values, -np.inf).argmax()]), None)
    opacity = _opacities(scene, values, slopes, shown_here)
    lengths = image.plan.slice_spacing * ray.stretch / scene.reference_length
    with np.errstate(divide="ignore"):
        alpha = -np.expm1(lengths * np.log1p(-opacity))
    n = _seen_slice(alpha, float(image.recipe.options["opacity_stop"]))
    return None if n is None else _pick_at(scene, ray, float(depths[n]), float(opacity[n]))


def _depths(image: Image, scene: Scene) -> Floats:
    """Return the depths of the picture's slices. Conventions, section 3 (Slices)."""
    plan, camera = image.plan, image.camera
    lower, upper = scene.native.centres
    middle = -camera.native.to_eye(triple("centre", 0.5 * (np.asarray(lower) + np.asarray(upper))))[2]
    depths = middle + (plan.first_slice + np.arange(plan.slices, dtype=np.float64) + 0.5) * plan.slice_spacing
    return depths[depths > camera.near] if camera.kind == "perspective" else depths


def _opacities(scene: Scene, values: Floats, slopes: Floats, there: NDArray[np.bool_]) -> Floats:
    """Return opacities per reference length; 0 where nothing is shown."""
    opacity: Floats = np.where(there, scene.transfer_function.at(values)[:, 3], 0.0)
    steep = scene.options["gradient_opacity"]
    if steep is not None:
        opacity *= np.minimum(1.0, np.sqrt((slopes * slopes).sum(axis=1)) / steep)
    return opacity


def _seen_slice(alpha: Floats, stop: float) -> int | None:
    """Return the slice where the opacity first reaches ½, else the one that contributes most; None without opacity."""
    left = np.concatenate([[1.0], np.cumprod(1.0 - alpha)])
    # A pixel is finished after the slice with which it reaches the stop.
    contributions = np.where(1.0 - left[:-1] < stop, left[:-1] * alpha, 0.0)
    total = np.cumsum(contributions)
    if not total[-1] > 0:
        return None
    half = np.flatnonzero(total >= 0.5)
    return int(half[0] if half.size else contributions.argmax())


def _crossing(
    scene: Scene, ray: _Ray, depths: Floats, values: Floats, kept: NDArray[np.bool_], spacing: float
) -> float | None:
    """Return the depth of the first crossing of the iso value, or None."""
    iso: Any = scene.iso_value
    # Outside of all slices the scalar is 0.
    depths = np.concatenate([[depths[0] - spacing], depths, [depths[-1] + spacing]])
    below = np.concatenate([[0.0], values, [0.0]]) < iso
    both = np.concatenate([[True], kept, [True]])
    found = np.flatnonzero((below[1:] != below[:-1]) & both[1:] & both[:-1])
    if not found.size:
        return None
    n = int(found[0])
    start, end = float(depths[n]), float(depths[n + 1])
    for _ in range(2):
        inside = np.linspace(start, end, _PARTS + 1)
        scalars = _sums(scene.fields, ray.at(inside))[0]
        # The ends are on their sides, whatever the field is beyond the last slice.
        sides = scalars < iso
        sides[0], sides[-1] = below[n], not below[n]
        m = int(np.flatnonzero(sides[1:] != sides[:-1])[0])
        start, end = float(inside[m]), float(inside[m + 1])
        here, there = float(scalars[m]), float(scalars[m + 1])
    share = (iso - here) / (there - here) if there != here else 0.5
    return start + min(max(share, 0.0), 1.0) * (end - start)


def _pick_at(scene: Scene, ray: _Ray, depth: float, opacity: float | None) -> Pick:
    """Return what the fields are at a depth of a ray."""
    point = ray.at(np.asarray([depth]))
    probes = [field.probe(point) for field in scene.fields]
    nearest = [int(numbers[0]) for _, _, numbers in probes]
    distances = [_distance(field, n, point[0]) for field, n in zip(scene.fields, nearest, strict=True)]
    which = int(np.argmin(distances))
    field, kernel = scene.fields[which], nearest[which]
    sample = _sample(field, kernel) if isinstance(field, RegularField) and kernel >= 0 else None
    value = sum(float(values[0]) for values, _, _ in probes)
    gradient = triple("gradient", sum(slopes[0] for _, slopes, _ in probes))
    return Pick(triple("position", point[0]), depth, value, gradient, opacity, which, kernel, sample)


def _sample(field: RegularField, kernel: int) -> tuple[int, int, int]:
    """Return (k, j, i) of a sample by its number."""
    k, j, i = (int(part) for part in np.unravel_index(kernel, field.shape))
    return k, j, i


def _distance(field: Field, kernel: int, point: Floats) -> float:
    """Return the distance of a kernel's centre from a point; infinite for -1, no kernel."""
    if kernel < 0:
        return math.inf
    if isinstance(field, RegularField):
        k, j, i = _sample(field, kernel)
        centre: Any = field.native.position(i, j, k)
    else:
        assert isinstance(field, EllipsoidField)
        centre = field.centers[kernel]
    return float(np.linalg.norm(point - np.asarray(centre)))
