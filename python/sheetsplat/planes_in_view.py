"""Slice planes in a picture: where pixels meet them, what colour they have, and what is in front of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import Bounds, triple
from sheetsplat.camera import Camera, Rays
from sheetsplat.errors import Unsupported, complain
from sheetsplat.fields import Field, RegularField, has_values_at_points, joined_bounds
from sheetsplat.fields.summed import as_summed, sum_at
from sheetsplat.labels import LabelColors
from sheetsplat.limits import Depths
from sheetsplat.look.surface import range_of
from sheetsplat.modes import TRAITS
from sheetsplat.scalar_colors import ScalarColors
from sheetsplat.slice_planes import SlicePlane
from sheetsplat.supersampling import Arrays

if TYPE_CHECKING:
    from sheetsplat.scene import Scene

Floats = NDArray[np.float64]
# Pixels, or points, that are looked at together.
_AT_ONCE = 1 << 17
# Share of the data's diagonal by which rounding may take a plane at the end of the data out of them.
_ROUNDING = 1e-9


def planes_of(scene: Scene) -> tuple[SlicePlane, ...]:
    """Return the slice planes that a scene shows, with the offsets and limits that nobody gave.

    Raises
    ------
    Unsupported
        For several groups of fields, volumes of colours, and data that have no values at points.
    """
    planes: tuple[SlicePlane, ...] = scene.options["slice_planes"]
    if not planes or TRAITS[scene.mode].is_scalar:
        return ()
    found = ""
    if len(scene.groups) > 1:
        found = f"{len(scene.groups)} groups of fields, each with a transfer function"
    elif any(isinstance(one, RegularField) and one.colored for one in scene.fields):
        found = "a volume of colours"
    elif not all(map(has_values_at_points, scene.fields)):
        found = "data in bricks without values at points"
    if found:
        wanted = "fields that add up, whose values at points are known"
        raise complain("slice planes cannot be drawn", found, wanted, option="slice_planes", kind=Unsupported)
    if not any(one.size for one in scene.fields):
        return ()
    middle = 0.5 * np.sum(_box_of(scene.fields), axis=0)
    limits = _limits(scene.fields)
    return tuple(
        replace(
            one,
            offset=float(np.dot(one.normal, middle)) if one.offset is None else one.offset,
            clim=limits if one.clim is None else one.clim,
        )
        for one in planes
    )


def _box_of(fields: tuple[Field, ...]) -> Bounds:
    """Return the box around the domains of fields; where one does not end, around its centres."""

    def box(field: Field) -> Bounds:
        ends = zip(field.domain or field.centre_bounds, field.centre_bounds, strict=True)
        low, high = (triple("bounds", np.where(np.isfinite(end), end, centre)) for end, centre in ends)
        return low, high

    return joined_bounds([box(one) for one in as_summed(fields) if one.size])


def _limits(fields: tuple[Field, ...]) -> tuple[float, float]:
    """Return the least and the largest value of the data; around them where they are equal."""
    low, high = map(fields[0].quantity.scalar, range_of(fields))
    half = 0.0 if low < high else max(abs(low), 1.0) * 1e-3
    return low - half, high + half


@dataclass(frozen=True, eq=False)
class PlanesInView:
    """The slice planes of a picture, one sample a pixel.

    Attributes
    ----------
    planes
        All of them, with offsets and limits.
    scene, camera, size
        Of the picture.
    depths
        Of the nearest plane at each pixel, float64 (h, w): world units from the eye along the view direction; infinite
        where there is none, or behind the depth limit that was given.
    which
        Its number, (h, w).
    """

    planes: tuple[SlicePlane, ...]
    scene: Scene
    camera: Camera
    size: tuple[int, int]
    depths: Depths
    which: NDArray[np.int64]

    @classmethod
    def of(cls, scene: Scene, camera: Camera, size: tuple[int, int], limit: Depths | None) -> PlanesInView | None:
        """Return the slice planes of a scene, None without any; raises what `planes_of` does.

        limit: depths behind which nothing is drawn, or None.
        """
        planes = planes_of(scene)
        if not planes:
            return None
        width, height = size
        depths, which = np.full((height, width), np.inf), np.zeros((height, width), np.int64)
        step = max(1, _AT_ONCE // width)
        for top in range(0, height, step):
            rows = slice(top, top + step)
            places = np.arange(height)[rows, None], np.arange(width)[None, :]
            depths[rows], which[rows] = nearest(planes, scene, camera, Rays.of(camera, size, *places[::-1]))
        if limit is not None:
            depths[limit < depths] = np.inf
        return cls(planes, scene, camera, size, depths, which)

    @cached_property
    def in_front(self) -> Scene:
        """The scene of what is in front of the planes: without a background, which is behind them."""
        return self.scene.replace(slice_planes=(), background=None) if self.scene.background else self.scene

    def limit(self, given: Depths | None) -> Depths:
        """Return the depths behind which nothing is drawn: of the planes and of the limit that was given."""
        return self.depths if given is None else np.minimum(self.depths, given)

    @cached_property
    def rgb(self) -> NDArray[np.float32]:
        """Red, green, blue of the planes, (h, w, 3); 0 where there is none."""
        made = np.zeros((*self.depths.shape, 3), np.float32)
        for number, plane in enumerate(self.planes):
            rows, columns = np.nonzero(np.isfinite(self.depths) & (self.which == number))
            for start in range(0, len(rows), _AT_ONCE):
                at = rows[start : start + _AT_ONCE], columns[start : start + _AT_ONCE]
                rays = Rays.of(self.camera, self.size, *at[::-1])
                made[at] = colors_at(plane, self.scene, rays.at(self.depths[at]))
        return made

    def behind(self, drawn: Any) -> Arrays:
        """Return the arrays of a picture without a background, with the planes and then the background behind it.

        `drawn` has the attributes of `Arrays`.
        """
        rgba = drawn.rgba.copy()
        rgba[..., :3] += (1.0 - rgba[..., 3:]) * self.rgb
        there = np.isfinite(self.depths)
        rgba[there, 3] = 1.0
        background = self.scene.background
        if background is not None:
            rgba[..., :3] += (1.0 - rgba[..., 3:]) * np.asarray(background, np.float32)
            rgba[..., 3] = 1.0
        depth = drawn.depth
        if depth is not None:
            depth = np.where(np.isinf(depth), self.depths, depth).astype(np.float32)
        return Arrays(rgba, drawn.scalar, drawn.coverage, depth)


def nearest(
    planes: tuple[SlicePlane, ...], scene: Scene, camera: Camera, rays: Rays
) -> tuple[Floats, NDArray[np.int64]]:
    """Return the depth of the nearest plane on each of some rays, infinite where there is none, and its number."""
    box = np.asarray(_box_of(scene.fields))
    beside = _ROUNDING * float(np.linalg.norm(box[1] - box[0]))
    # Nothing lies before the near plane of a perspective camera.
    least = camera.near if camera.kind == "perspective" else -np.inf
    found = np.full((len(planes), *rays.along.shape[:-1]), np.inf)
    for number, plane in enumerate(planes):
        normal = np.asarray(plane.normal)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            depths = (float(plane.offset or 0.0) - rays.start @ normal) / (rays.along @ normal)
        depths = np.where(np.isfinite(depths) & (depths >= least), depths, np.inf)
        met = np.isfinite(depths)
        points = rays.at(np.where(met, depths, 0.0))
        met &= ((points >= box[0] - beside) & (points <= box[1] + beside)).all(axis=-1)
        met &= scene.options["clip"].keeps(points.reshape(-1, 3)).reshape(met.shape)
        found[number] = np.where(met, depths, np.inf)
    which = found.argmin(axis=0)
    return np.take_along_axis(found, which[None], axis=0)[0], which


def colors_at(plane: SlicePlane, scene: Scene, points: Floats) -> Floats:
    """Return red, green, blue, (M, 3), that a plane has at points (M, 3) of the world."""
    colors, field = ScalarColors(plane.cmap, plane.clim), scene.fields[0]
    if isinstance(field, RegularField) and field.labels:
        return _of_labels(field, LabelColors.of(scene.transfer_function, field.labels_found), colors, points)
    values, floor = sum_at(as_summed(scene.fields), points), field.quantity.floor
    low, high = colors.limits(values)
    if floor is not None:
        # Smaller values than the floor have its logarithm.
        low, high = (math.log10(max(one, floor) / floor) for one in (low, high))
    return colors.colors(values, (low, high if low < high else low + 1.0))[:, :3]


def _of_labels(field: RegularField, colors: LabelColors, others: ScalarColors, points: Floats) -> Floats:
    """Return the colour of the label with the largest weight at each point."""
    largest = np.zeros(len(points))
    made = np.tile(others.table[0, :3], (len(points), 1))
    for label in field.labels_found:
        weights = field.field_of_label(label).at(points)
        made[weights > largest] = colors.colors.get(label, others.table[0])[:3]
        largest = np.maximum(largest, weights)
    return made
