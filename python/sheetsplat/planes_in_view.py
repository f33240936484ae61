"""Slice planes in a picture: where pixels meet them, what colour they have, and what is in front of them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

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
from sheetsplat.slice_planes import PLANE_CMAP, SlicePlane, with_colors
from sheetsplat.supersampling import Arrays, averaged, fine_depths, fine_size

if TYPE_CHECKING:
    from sheetsplat.scene import Scene

Floats = NDArray[np.float64]
# Pixels, or points, that are looked at together.
_AT_ONCE = 1 << 17
# Between neighbours of larger differences of red, green or blue pixels are looked at more closely.
_STEP = 1.0 / 16.0
# Share of the data's diagonal by which rounding may take a plane at the end of the data out of them.
_ROUNDING = 1e-9


def planes_of(scene: Scene) -> tuple[SlicePlane, ...]:
    """Return the slice planes that a scene shows, with the offsets, colormaps and limits that nobody gave.

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
    placed = (
        replace(one, offset=float(np.dot(one.normal, middle)) if one.offset is None else one.offset) for one in planes
    )
    return with_colors(tuple(placed), PLANE_CMAP, limits)


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
class Quarters:
    """The pixels of a picture of one sample a pixel that are looked at through the middles of their four quarters.

    There planes end or cross, or their colours change.

    Attributes
    ----------
    at
        Their rows and columns, (M,) each.
    depths
        Of the nearest plane in each quarter, (M, 4); infinite where there is none.
    rgb
        Its red, green and blue, (M, 4, 3).
    own
        The depth in the middle of the pixel, (M,).
    other
        Where quarters meet other planes than the middle: of their depths the one farthest from that, else `own`, (M,).
    """

    at: tuple[NDArray[np.int64], NDArray[np.int64]]
    depths: Floats
    rgb: Floats
    own: Floats
    other: Floats

    @classmethod
    def of(
        cls, sampled: _Sampled, at: tuple[NDArray[np.int64], NDArray[np.int64]], met: Met, limit: Depths | None
    ) -> Quarters:
        """Return the quarters of pixels, whose middles met some planes; limit: depths behind which nothing is drawn."""
        rows, columns = at
        down, right = 0.5 * np.array(np.divmod(np.arange(4), 2)) - 0.25
        rays = sampled.rays(rows[:, None] + down, columns[:, None] + right)
        found = sampled.met(rays).hidden(None if limit is None else limit[at][:, None])
        own = met.depths[at]
        split = (found.numbers != met.numbers[at][:, None]).any(axis=1)
        farthest = _apart(found.depths, own).argmax(axis=1)
        other = np.where(split, np.take_along_axis(found.depths, farthest[:, None], axis=1)[:, 0], own)
        return cls(at, found.depths, sampled.colors(rays, found), own, other)

    @property
    def is_split(self) -> NDArray[np.bool_]:
        """In which pixels what is in front of the planes ends at two depths, (M,)."""
        found: NDArray[np.bool_] = self.other != self.own
        return found

    def over(self, front: NDArray[np.float32], other: NDArray[np.float32]) -> Floats:
        """Return the pixels, (M, 4): the means of the quarters' colours behind what is in front of them.

        front, other: pixels of what is in front of the middles' depths, and of the other ones, (M, 4).
        """
        is_other = _apart(self.depths, self.other) < _apart(self.depths, self.own)
        made = np.where(is_other[..., None], other[:, None], front[:, None]).astype(np.float64)
        made[..., :3] += (1.0 - made[..., 3:]) * self.rgb
        made[..., 3] = np.where(np.isfinite(self.depths), 1.0, made[..., 3])
        found: Floats = made.mean(axis=1)
        return found


@dataclass(frozen=True, eq=False)
class PlanesInView:
    """The slice planes of a picture. Conventions, section 10.

    Attributes
    ----------
    planes
        All of them, with offsets and limits.
    scene, camera
        Of the picture.
    depths
        Of the nearest plane at each sample, float64 (n h, n w) where a pixel has n x n: world units from the eye along
        the view direction; infinite where there is none, or behind the depth limit that was given.
    """

    planes: tuple[SlicePlane, ...]
    scene: Scene
    camera: Camera
    depths: Depths
    _sampled: _Sampled
    _met: Met
    _limit: Depths | None

    @classmethod
    def of(cls, scene: Scene, camera: Camera, size: tuple[int, int], limit: Depths | None) -> PlanesInView | None:
        """Return the slice planes of a scene, None without any; raises what `planes_of` does.

        limit: depths behind which nothing is drawn, or None.
        """
        planes = planes_of(scene)
        if not planes:
            return None
        # Pixels of one sample are compared with those around them, also around the picture.
        sampled = _Sampled(planes, scene, camera, fine_size(size, scene.supersampling), int(scene.supersampling == 1))
        met = sampled.everywhere()
        inner = sampled.inner(met).hidden(fine_depths(limit, scene.supersampling))
        return cls(planes, scene, camera, inner.depths, sampled, met, limit)

    @cached_property
    def _rgb(self) -> tuple[NDArray[np.float32], Quarters | None]:
        sampled, met = self._sampled, self._met
        rgb = sampled.colors_everywhere(met)
        inner = sampled.inner(met).hidden(fine_depths(self._limit, self.scene.supersampling))
        quarters = None
        if sampled.margin and (closer := _changes(met, rgb)).any():
            rows, columns = np.nonzero(closer)
            quarters = Quarters.of(sampled, (rows, columns), inner, self._limit)
        rgb = sampled.inner_of(rgb).copy()
        rgb[np.isinf(inner.depths)] = 0.0
        return rgb, quarters

    @property
    def rgb(self) -> NDArray[np.float32]:
        """Red, green, blue of the planes, (n h, n w, 3); 0 where there is none."""
        return self._rgb[0]

    @property
    def quarters(self) -> Quarters | None:
        """The pixels that are looked at more closely; None where there are none."""
        return self._rgb[1]

    @cached_property
    def in_front(self) -> Scene:
        """The scene of what is in front of the planes: without a background, which is behind them."""
        return self.scene.replace(slice_planes=(), background=None) if self.scene.background else self.scene

    def limit(self, given: Depths | None) -> Depths:
        """Return the depths behind which nothing is drawn, of each sample: of the planes and of the limit given."""
        given = fine_depths(given, self.scene.supersampling)
        return self.depths if given is None else np.minimum(self.depths, given)

    def other_limit(self, given: Depths | None) -> Depths | None:
        """Return the depths behind which nothing is drawn in a second picture: of pixels in which planes end or cross.

        All other pixels of it are empty. None where there are no such pixels.
        """
        if self.quarters is None or not (split := self.quarters.is_split).any():
            return None
        rows, columns = (part[split] for part in self.quarters.at)
        depths = np.full(self.depths.shape, self._before)
        depths[rows, columns] = self.quarters.other[split]
        return depths if given is None else np.minimum(depths, given)

    @property
    def _before(self) -> float:
        """A depth before everything."""
        if self.camera.kind == "perspective":
            return 0.0
        low, high = np.asarray(joined_bounds([one.bounds for one in self.scene.fields if one.size]))
        middle = 0.5 * (low + high)
        return -float(np.linalg.norm(middle - self.camera.eye) + np.linalg.norm(high - low))

    def behind(self, drawn: Any, other: Any = None) -> Any:
        """Return the arrays of a picture without a background, with the planes and then the background behind it.

        They are means over the samples of each pixel. `drawn`, and the second picture where one was drawn, have the
        attributes of `Arrays`, and a pixel for each sample.
        """
        rgba = drawn.rgba.copy()
        rgba[..., :3] += (1.0 - rgba[..., 3:]) * self.rgb
        rgba[np.isfinite(self.depths), 3] = 1.0
        if self.quarters is not None:
            front = drawn.rgba[self.quarters.at]
            rgba[self.quarters.at] = self.quarters.over(front, front if other is None else other.rgba[self.quarters.at])
        background = self.scene.background
        if background is not None:
            rgba[..., :3] += (1.0 - rgba[..., 3:]) * np.asarray(background, np.float32)
            rgba[..., 3] = 1.0
        depth = drawn.depth
        if depth is not None:
            depth = np.where(np.isinf(depth), self.depths, depth).astype(np.float32)
        return averaged(Arrays(rgba, drawn.scalar, drawn.coverage, depth), self.scene.supersampling)


class Met(NamedTuple):
    """What rays meet: the depths of the nearest planes, infinite where there is none, and their numbers, there -1."""

    depths: Floats
    numbers: NDArray[np.int64]

    def hidden(self, limit: Depths | None) -> Met:
        """Return it without what lies behind some depths."""
        if limit is None:
            return self
        behind = limit < self.depths
        return Met(np.where(behind, np.inf, self.depths), np.where(behind, -1, self.numbers))


@dataclass(frozen=True, eq=False)
class _Sampled:
    """Looks at planes through the samples of a picture, of a size, and through so many more around it."""

    planes: tuple[SlicePlane, ...]
    scene: Scene
    camera: Camera
    size: tuple[int, int]
    margin: int

    def rays(self, rows: Any, columns: Any) -> Rays:
        """Return the rays through places; whole numbers are the middles of samples."""
        return Rays.of(self.camera, self.size, columns, rows)

    def met(self, rays: Rays) -> Met:
        """Return what rays meet."""
        depths, numbers = nearest(self.planes, self.scene, self.camera, rays)
        return Met(depths, np.where(np.isinf(depths), -1, numbers))

    def colors(self, rays: Rays, met: Met) -> Floats:
        """Return red, green and blue of what rays meet, (..., 3); 0 where that is nothing."""
        made = np.zeros((*met.depths.shape, 3))
        for number, plane in enumerate(self.planes):
            at = np.nonzero(met.numbers == number)
            for start in range(0, len(at[0]), _AT_ONCE):
                part = tuple(one[start : start + _AT_ONCE] for one in at)
                some = Rays(rays.start[part], rays.along[part])
                made[part] = colors_at(plane, self.scene, some.at(met.depths[part]))
        return made

    def _strips(self) -> Iterator[tuple[slice, Rays]]:
        """Yield some rows of all samples at a time, and their rays."""
        height, width = self.shape
        step = max(1, _AT_ONCE // width)
        for top in range(0, height, step):
            rows = slice(top, top + step)
            yield rows, self.rays(np.arange(height)[rows, None] - self.margin, np.arange(width)[None, :] - self.margin)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of all samples."""
        return self.size[1] + 2 * self.margin, self.size[0] + 2 * self.margin

    def everywhere(self) -> Met:
        """Return what all samples meet."""
        found = Met(np.empty(self.shape), np.empty(self.shape, np.int64))
        for rows, rays in self._strips():
            found.depths[rows], found.numbers[rows] = self.met(rays)
        return found

    def colors_everywhere(self, met: Met) -> NDArray[np.float32]:
        """Return red, green and blue of what all samples meet, (h, w, 3)."""
        made = np.empty((*self.shape, 3), np.float32)
        for rows, rays in self._strips():
            made[rows] = self.colors(rays, Met(met.depths[rows], met.numbers[rows]))
        return made

    def inner(self, met: Met) -> Met:
        """Return what the samples of the picture meet."""
        return Met(self.inner_of(met.depths), self.inner_of(met.numbers))

    def inner_of(self, array: NDArray[Any]) -> NDArray[Any]:
        """Return the samples of the picture of an array."""
        height, width = self.shape
        return array[self.margin : height - self.margin, self.margin : width - self.margin]


def _changes(met: Met, rgb: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return which pixels have another plane beside them, or one of another colour; but for the outermost ones."""
    found = np.zeros((met.depths.shape[0] - 2, met.depths.shape[1] - 2), bool)
    middle = slice(1, -1), slice(1, -1)
    for down, right in ((0, 1), (2, 1), (1, 0), (1, 2)):
        beside = slice(down, down + found.shape[0]), slice(right, right + found.shape[1])
        found |= met.numbers[middle] != met.numbers[beside]
        found |= (np.abs(rgb[middle] - rgb[beside]) > _STEP).any(axis=-1)
    return found


def _apart(depths: Floats, others: Floats) -> Floats:
    """Return how far depths, (M, 4), are from others, (M,): infinitely where one alone is infinite."""
    with np.errstate(invalid="ignore"):
        return np.nan_to_num(np.abs(depths - others[:, None]), nan=0.0, posinf=np.inf)


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
    colors, field = plane.colors, scene.fields[0]
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
