"""What one picture needs of each brick: the kernels around it, the pixels that it can reach, and how it is drawn."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import Bounds
from sheetsplat.bricks.lattice import Box, LatticeSpec
from sheetsplat.bricks.partition import Nested, Partition
from sheetsplat.bricks.whole import Whole, corners
from sheetsplat.camera import Camera
from sheetsplat.errors import Unsupported, complain, option_ref
from sheetsplat.limits import Depths
from sheetsplat.options.core import SCALAR, checked
from sheetsplat.options.renderer import RendererClassOptions
from sheetsplat.options.scene import SceneOptions, surfaces_of
from sheetsplat.tiles import window as window_of
from sheetsplat.transfer import TransferFunction

Floats = NDArray[np.float64]
#: First column, first row, the column and the row behind the last ones.
Rect = tuple[int, int, int, int]

# Distances are enlarged by this, so that rounding does not leave out a kernel that just reaches.
_ROUNDING = 1.001
# Pixels by which rays that pass a cell may meet it, by rounding.
_NEAR = 1e-6
# Standard deviation of the EWA filter in pixels and slice distances.
_FILTER = 0.5
# Slice distances around surfaces in which light looks at the field.
_AROUND_SURFACES = 3.0
# Slices around a brick that are there for gradients, intervals and slabs at its border; more than these look at.
_AROUND = 4.0
# Slice distances by which all faces between bricks are moved. Faces lie midway between samples, where slices of views
# along an axis lie too: whether a slice is before such a face would depend on rounding, which cameras differ in.
_MOVED = 1e-4


@dataclass(frozen=True)
class BrickView:
    """One picture of a field in bricks: everything but the data. Immutable; it can be pickled.

    Made by `of`, which checks the options.

    Attributes
    ----------
    partition, whole
        The bricks, and what they share.
    lattice
        The lattice that the samples of bricks belong to; None for scattered kernels.
    levels
        The lattices of coarser levels of the volume, the finest first.
    allowed
        Error that a picture may have by levels, a share of the largest number of a scalar picture; None: all bricks are
        drawn with the volume's own samples.
    largest_sample
        Largest magnitude of the samples of the volume.
    transfer_function
        Scalar to colour and opacity.
    options
        All options of `Scene`, slice distance and reference length included.
    camera, size, outputs, depth_limit
        As for `Renderer.render`.
    settings
        All options of `Renderer`.
    light
        How the light volumes of all bricks are made (`bricks.light`); None: there are none.
    """

    partition: Partition
    whole: Whole
    transfer_function: TransferFunction
    options: Mapping[str, Any]
    camera: Camera
    size: tuple[int, int]
    outputs: tuple[str, ...] = ()
    depth_limit: Depths | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    lattice: LatticeSpec | None = None
    levels: tuple[LatticeSpec, ...] = ()
    allowed: float | None = None
    largest_sample: float = 1.0
    light: Any = None

    @classmethod
    def of(
        cls,
        partition: Partition,
        whole: Whole,
        transfer_function: TransferFunction,
        options: Mapping[str, Any],
        camera: Camera,
        size: tuple[int, int],
        outputs: tuple[str, ...] = (),
        depth_limit: Depths | None = None,
        settings: Mapping[str, Any] | None = None,
        lattice: LatticeSpec | None = None,
    ) -> BrickView:
        """Return the view of checked or unchecked options of `Scene` and `Renderer`; what is not given is as there.

        Raises
        ------
        Unsupported
            For max_error and max_seconds: a brick does not have what they need.
        InvalidInput
            As `Scene` and `Renderer`.
        """
        given = checked("Scene", dict(options), SceneOptions)
        for length in ("slice_spacing", "reference_length"):
            if given[length] is None:
                given[length] = whole.default_slice_spacing
        renderer = checked("Renderer", {"backend": "auto", **(settings or {})}, RendererClassOptions)
        _refuse(renderer)
        return cls(partition, whole, transfer_function, given, camera, size, outputs, depth_limit, renderer, lattice)

    def replace(self, **changes: Any) -> BrickView:
        """Return the same view with some attributes changed."""
        return replace(self, **changes)

    @property
    def mode(self) -> str:
        """One of "composite", "isosurface", "xray", "mip", "minimum" and "average"."""
        mode: str = self.options["mode"]
        return mode

    @property
    def is_scalar(self) -> bool:
        """Whether the picture is one of numbers, without colours."""
        return self.mode in SCALAR

    @property
    def is_dimmed(self) -> bool:
        """Whether matter dims light: shadows or ambient occlusion were asked for."""
        asked = bool(self.options["shadows"]) or self.options["ambient_occlusion"] is not None
        return asked and not self.is_scalar

    @property
    def any_order(self) -> bool:
        """Whether bricks can be drawn alone, in any order: where no pixel is finished before its last brick."""
        without_stop = self.mode == "composite" and self.opacity_stop >= 1.0 and "depth" not in self.outputs
        return self.is_scalar or without_stop

    @property
    def opacity_stop(self) -> float:
        """Opacity at which a pixel is finished; 1: never."""
        stop: float = self.options["opacity_stop"]
        surfaces = surfaces_of(self.options["iso_value"])
        opaque = self.mode == "isosurface" and all(opacity == 1 for _, opacity in surfaces)
        return 0.5 if opaque else stop

    @property
    def slice_spacing(self) -> float:
        """Distance of slices in world units."""
        spacing: float = self.options["slice_spacing"]
        return spacing

    def nested(self) -> Nested:
        """Return the numbers of all bricks in pairs (in front, behind): see `Partition.nested`."""
        return self.partition.nested(self.camera)

    def order(self) -> tuple[int, ...]:
        """Return the numbers of all bricks from front to back."""
        return self.partition.order(self.camera)

    def _unit_pixel(self) -> float:
        """Width of a pixel: world units, or per unit of depth in perspective."""
        if self.camera.kind == "orthographic":
            return self.camera.height / self.size[1]
        return 2.0 * math.tan(math.radians(self.camera.fov_y) / 2.0) / self.size[1]

    def _pixel(self, depth: float) -> float:
        """Width of a pixel at a depth, world units."""
        unit = self._unit_pixel()
        return unit if self.camera.kind == "orthographic" else unit * max(depth, self.camera.near)

    def _slant(self) -> float:
        """Longest way of a ray through a unit of depth."""
        if self.camera.kind == "orthographic":
            return 1.0
        width, height = self.size
        x, y = 0.5 * width / height + abs(self.camera.shift[0]), 0.5 + abs(self.camera.shift[1])
        return math.hypot(1.0, self._unit_pixel() * height * math.hypot(x, y))

    def _region(self, number: int) -> Bounds | None:
        """Return the box of the points of a brick that can be seen, or None."""
        lower, upper = np.asarray(self.cell(number))
        supports = np.asarray(self.whole.supports)
        # An interval begins one slice before what is in it.
        beyond = self._slant() * self.slice_spacing * 1.5 + self._widening(self._farthest())
        lower = np.maximum(lower, supports[:, 0].min(axis=0) - beyond)
        upper = np.minimum(upper, supports[:, 1].max(axis=0) + beyond)
        if not (lower < upper).all():
            return None
        return tuple(lower.tolist()), tuple(upper.tolist())

    def depths(self) -> tuple[float, float]:
        """Return the nearest and the farthest depth that kernels of the whole reach."""
        return self._depths

    @cached_property
    def _depths(self) -> tuple[float, float]:
        longer = 0.0
        if self.options["filter"] is not None:
            longer = _FILTER * math.sqrt(2.0 * self.whole.falloff) * self.slice_spacing
        return self.whole.depths(self.camera, longer)

    def cell(self, number: int) -> Bounds:
        """Return the points that are drawn of a brick, lower <= x < upper."""
        by = _MOVED * self.slice_spacing
        lower, upper = ((x + by, y + by, z + by) for x, y, z in self.partition.bricks[number].cell)
        return lower, upper

    def depths_of(self, number: int) -> tuple[float, float]:
        """Return the nearest and the farthest depth at which a brick is sliced, within those of the whole."""
        near, far = self.depths()
        region = self._region(number)
        if region is None:
            return near, far
        found = -((corners(region) - np.asarray(self.camera.eye)) @ np.asarray(self.camera.world_axes()[2]))
        more = _AROUND * self.slice_spacing
        return max(near, float(found.min()) - more), min(far, float(found.max()) + more)

    def _farthest(self) -> float:
        return max(self.depths()[1], 0.0)

    def _widening(self, depth: float) -> float:
        """By how much the filter widens supports, at most."""
        if self.options["filter"] is None:
            return 0.0
        deviation = _FILTER * math.sqrt(2.0 * self.whole.falloff)
        step = 0.0 if self.light is None else self.light.step
        return deviation * max(self._pixel(depth), self.slice_spacing, step)

    @property
    def _gradients(self) -> bool:
        """Whether light or opacity depends on differences of neighbouring pixels and slices."""
        called = bool(self.options["lights"]) or self.options["gradient_opacity"] is not None
        return called and not self.is_scalar and self.options["gradient"] == "sheets"

    def margin(self, number: int) -> float:
        """Return how far beyond the cell of a brick the picture looks at the field, world units.

        Gradients look at neighbouring pixels and slices, intervals and crossings at the next slice, slabs half a slice
        distance around; the filter widens kernels.
        """
        region = self._region(number)
        if region is None:
            return 0.0
        depth = self._farthest()
        if self.camera.kind == "perspective":
            away = corners(region) - np.asarray(self.camera.eye)
            depth = max(float((-(away @ np.asarray(self.camera.world_axes()[2]))).max()), 0.0)
        intervals = self.mode == "isosurface" or bool(self.options["preintegration"])
        steps = float(intervals) + float(self._gradients)
        if self.options["preintegration"] == "second_order":
            steps = 2.0
        if self.options["sampling"] == "slab":
            steps += 0.5
        if self.is_dimmed and self.mode == "isosurface":
            steps = max(steps, _AROUND_SURFACES)
        sideways = self._pixel(depth) if self._gradients else 0.0
        along = (steps + _MOVED) * self.slice_spacing * self._slant()
        return _ROUNDING * (along + sideways + self._widening(depth)) + 1e-9 * self.whole.largest_reach

    def lattice_at(self, level: int) -> LatticeSpec:
        """Return the lattice of a level, 0: that of the volume."""
        if self.lattice is None:
            raise ValueError("scattered kernels have no lattice")
        return self.levels[level - 1] if level else self.lattice

    def samples(self, number: int, level: int = 0) -> Box:
        """Return the samples of a level whose kernels a brick needs: its own and its ghosts, [k, j, i]."""
        brick = self.partition.bricks[number]
        return self.lattice_at(level).around(brick.cell, self.margin(number))

    def _projected(self, number: int) -> tuple[Floats, Floats] | None:
        """Return columns and rows of the corners of what can be seen of a brick, in pixels.

        None where there is nothing; none of them where it is all around the eye.
        """
        region = self._region(number)
        if region is None:
            return None
        width, height = self.size
        right, up, back = (np.asarray(axis) for axis in self.camera.world_axes())
        away = corners(region) - np.asarray(self.camera.eye)
        x, y, depth = away @ right, away @ up, -(away @ back)
        if self.camera.kind == "perspective":
            if depth.max() <= self.camera.near:
                return None
            if depth.min() <= self.camera.near:
                return np.empty(0), np.empty(0)
            x, y = x / depth, y / depth
        pixel = self._unit_pixel()
        to_right, above = (height * one for one in self.camera.shift)
        return x / pixel + 0.5 * width - to_right, 0.5 * height - y / pixel + above

    def footprint(self, number: int) -> Rect | None:
        """Return the rectangle of pixels that a brick can change, or None where there are none."""
        found = self._projected(number)
        if found is None:
            return None
        width, height = self.size
        columns, rows = found
        if not columns.size:
            return 0, 0, width, height
        x0, y0 = max(math.floor(columns.min()) - 1, 0), max(math.floor(rows.min()) - 1, 0)
        x1, y1 = min(math.ceil(columns.max()) + 1, width), min(math.ceil(rows.max()) + 1, height)
        return (x0, y0, x1, y1) if x0 < x1 and y0 < y1 else None

    def window(self, number: int) -> tuple[Rect, Camera] | None:
        """Return the pixels of a brick's footprint and their camera; None where it changes none."""
        rect = self.footprint(number)
        if rect is None:
            return None
        x0, y0, x1, y1 = rect
        return rect, window_of(self.camera, self.size, (x0, y0), (x1 - x0, y1 - y0))

    def outline(self, number: int) -> NDArray[np.bool_]:
        """Return which pixels of its footprint a brick can change, (h, w): those whose rays meet its cell."""
        found, rect = self._projected(number), self.footprint(number)
        if found is None or rect is None:
            return np.zeros((0, 0), bool)
        x0, y0, x1, y1 = rect
        if not found[0].size:
            return np.ones((y1 - y0, x1 - x0), bool)
        columns, rows = found
        # Every line between two corners lies within the outline, and some of them are its border.
        first, second = np.triu_indices(len(columns), 1)
        low, high = np.minimum(rows[first], rows[second]), np.maximum(rows[first], rows[second])
        steep = np.where(high > low, rows[second] - rows[first], 1.0)
        centres = np.arange(y0, y1)[:, None] + 0.5
        above, below = centres - _NEAR, centres + _NEAR
        ends = []
        for edge in (above, below):
            share = (np.clip(edge, low, high) - rows[first]) / steep
            share = np.where(high > low, share, 0.0)
            ends.append(columns[first] + share * (columns[second] - columns[first]))
        level = (high == low) & (low >= above) & (low <= below)
        ends.append(np.where(level, columns[second], ends[0]))
        touched = (high >= above) & (low <= below)
        left = np.where(touched, np.minimum.reduce(ends), np.inf).min(axis=1) - _NEAR
        right = np.where(touched, np.maximum.reduce(ends), -np.inf).max(axis=1) + _NEAR
        pixels = np.arange(x0, x1) + 0.5
        inside: NDArray[np.bool_] = (pixels >= left[:, None]) & (pixels <= right[:, None])
        return inside

    def may_show(self, value_range: tuple[float, float]) -> bool:
        """Return whether kernels with factors in a range, all that reach a brick, can show anything at all."""
        if "coverage" in self.outputs or self.mode in ("minimum", "average"):
            return True
        low, high = self._scalars(value_range)
        if math.isinf(high):
            return True
        if self.mode == "xray":
            return low < 0.0 or high > 0.0
        if self.mode == "mip":
            return high > 0.0
        low, high = self._widened(low, high)
        if self.mode == "isosurface":
            return any(low < value <= high for value, _ in surfaces_of(self.options["iso_value"]))
        return shows(self.transfer_function, low, high)

    def may_dim(self, value_range: tuple[float, float]) -> bool:
        """Return whether kernels with factors in a range, all that reach a brick, can dim light that passes it."""
        low, high = self._scalars(value_range)
        if math.isinf(high):
            return True
        if self.mode == "isosurface":
            # Where it is below all surfaces the scalar says where between two bricks one is.
            return low < 0.0 or high > 0.0
        return shows(self.transfer_function, *self._widened(low, high))

    def _scalars(self, value_range: tuple[float, float]) -> tuple[float, float]:
        """Return bounds of the scalar, 0 included, where the factors of kernels are in a range."""
        factor = self._largest_sum
        if not math.isfinite(factor):
            return -math.inf, math.inf
        return factor * min(value_range[0], 0.0), factor * max(value_range[1], 0.0)

    def _widened(self, low: float, high: float) -> tuple[float, float]:
        """Return bounds of what is looked up of scalars within bounds."""
        # The cubic through four slices leaves the range of the two in its middle by an eighth of the spread at most.
        bent = self.options["preintegration"] == "second_order"
        more = (high - low) * (0.125 if bent else 1e-5)
        return (low - more if bent or low < 0.0 else 0.0), (high + more if bent or high > 0.0 else 0.0)

    @property
    def _largest_sum(self) -> float:
        """Largest scalar that kernels of factor 1 add up to."""
        if self.options["filter"] is not None or (self.lattice is None and not self.whole.is_mean):
            return math.inf
        return 1.0 if self.lattice is None else self.lattice.largest_sum


def shows(function: TransferFunction, low: float, high: float) -> bool:
    """Return whether a transfer function gives any opacity to a value in a range."""
    points = function.points
    ends = function.at([low, high])[:, 3]
    inside = points[(points[:, 0] >= low) & (points[:, 0] <= high), 4]
    return bool(max(ends.max(), inside.max(initial=0.0)) > 0.0)


def _refuse(settings: Mapping[str, Any]) -> None:
    for name in ("max_error", "max_seconds"):
        if settings[name] is not None:
            raise complain(
                "a picture cannot be drawn in bricks",
                option_ref(name),
                "a picture without it: settings are chosen by trial pictures of the whole field",
                "leave it out, or draw the field in one piece",
                kind=Unsupported,
                option=name,
            )
