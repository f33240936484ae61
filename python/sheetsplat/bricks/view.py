"""What one picture needs of each brick: the kernels around it, the pixels that it can reach, and how it is drawn."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import Bounds, Triple
from sheetsplat.bricks.lattice import Box, LatticeSpec
from sheetsplat.bricks.partition import Nested, Partition
from sheetsplat.bricks.places import Places, Rect, unit_pixel
from sheetsplat.bricks.whole import Whole
from sheetsplat.camera import Camera
from sheetsplat.errors import Unsupported, complain, option_ref
from sheetsplat.labels import LabelColors
from sheetsplat.limits import Depths
from sheetsplat.look.visible import corners_of
from sheetsplat.modes import TRAITS
from sheetsplat.options.core import checked
from sheetsplat.options.renderer import RendererClassOptions
from sheetsplat.options.scene import SceneOptions, calls_for_gradients, surfaces_of
from sheetsplat.transfer import TransferFunction

# What labels without a colour show.
_HIDDEN = (0.0, 0.0, 0.0, 0.0)
# Distances are enlarged by this, so that rounding does not leave out a kernel that just reaches.
_ROUNDING = 1.001
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
        return cls(partition, whole, transfer_function, given, camera, size, outputs, depth_limit, renderer)

    def replace(self, **changes: Any) -> BrickView:
        """Return the same view with some attributes changed."""
        return replace(self, **changes)

    @property
    def lattice(self) -> LatticeSpec | None:
        """The lattice that the samples of bricks belong to; None for scattered kernels."""
        return self.whole.lattice

    @property
    def mode(self) -> str:
        """The mode: a name of `sheetsplat.modes`."""
        mode: str = self.options["mode"]
        return mode

    @property
    def is_scalar(self) -> bool:
        """Whether the picture is one of numbers, without colours."""
        return TRAITS[self.mode].is_scalar

    @property
    def is_dimmed(self) -> bool:
        """Whether matter dims light: shadows or ambient occlusion were asked for."""
        asked = bool(self.options["shadows"]) or self.options["ambient_occlusion"] is not None
        return asked and not self.is_scalar

    @property
    def any_order(self) -> bool:
        """Whether bricks can be drawn alone, in any order: where what is in front of them changes nothing in them."""
        without_stop = TRAITS[self.mode].is_composited and self.opacity_stop >= 1.0 and "depth" not in self.outputs
        without_stop = without_stop and not self.options["cut_faces"]
        return TRAITS[self.mode].any_order or without_stop

    @property
    def opacity_stop(self) -> float:
        """Opacity at which a pixel is finished; 1: never."""
        stop: float = self.options["opacity_stop"]
        opacities = [opacity for _, opacity in surfaces_of(self.options["iso_value"])]
        if isinstance(self.transfer_function, LabelColors):
            opacities = [rgba[3] for rgba in self.transfer_function.colors.values()]
        opaque = TRAITS[self.mode].shows_surfaces and all(opacity == 1 for opacity in opacities)
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

    def _pixel(self, depth: float) -> float:
        """Width of a pixel at a depth, world units."""
        unit = unit_pixel(self.camera, self.size)
        return unit if self.camera.kind == "orthographic" else unit * max(depth, self.camera.near)

    def _slant(self) -> float:
        """Longest way of a ray through a unit of depth."""
        if self.camera.kind == "orthographic":
            return 1.0
        width, height = self.size
        x, y = 0.5 * width / height + abs(self.camera.shift[0]), 0.5 + abs(self.camera.shift[1])
        return math.hypot(1.0, unit_pixel(self.camera, self.size) * height * math.hypot(x, y))

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what is computed when it is asked for."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    @cached_property
    def places(self) -> Places:
        """Where all bricks lie in the picture."""
        # An interval begins one slice before what is in it.
        beyond = self._slant() * self.slice_spacing * 1.5 + self._widening(self._farthest())
        lower, upper = np.asarray(self.own_supports)
        more = np.asarray(self._own_lengths(beyond))
        rows = self.partition.to_box
        to_world = None if rows is None else np.linalg.inv(np.asarray(rows, np.float64))
        return Places.of(self._cells, (lower - more, upper + more), self._axes, self.camera, self.size, to_world)

    @cached_property
    def _axes(self) -> tuple[NDArray[np.float64], ...]:
        return tuple(np.asarray(axis) for axis in self.camera.world_axes())

    @cached_property
    def _cells(self) -> NDArray[np.float64]:
        """The points that are drawn of all bricks, (N, 2, 3)."""
        return np.asarray([brick.cell for brick in self.partition.bricks]) + self._own_lengths(
            _MOVED * self.slice_spacing
        )

    def _own_lengths(self, length: float) -> Triple:
        """Return how far a world length reaches along the axes of cells, at most."""
        return (length, length, length) if self.lattice is None else self.lattice.own_lengths(length)

    @cached_property
    def supports(self) -> Bounds:
        """The box of all supports of the whole."""
        boxes = np.asarray(self.whole.supports)
        return tuple(boxes[:, 0].min(axis=0).tolist()), tuple(boxes[:, 1].max(axis=0).tolist())

    @cached_property
    def own_supports(self) -> Bounds:
        """The box of all supports in the coordinates of cells."""
        if self.partition.to_box is None:
            return self.supports
        corners = corners_of(self.supports) @ np.transpose(self.partition.to_box)
        return tuple(corners.min(axis=0).tolist()), tuple(corners.max(axis=0).tolist())

    @cached_property
    def depths(self) -> tuple[float, float]:
        """The nearest and the farthest depth that kernels of the whole reach."""
        longer = 0.0
        if self.options["filter"] is not None:
            longer = _FILTER * math.sqrt(2.0 * self.whole.falloff) * self.slice_spacing
        return self.whole.depths(self.camera, longer)

    def part(self, native: Any, cell: Bounds, depths: tuple[float, float], **more: Any) -> Any:
        """Return a native scene as one of what is in a cell, sliced between two depths of the whole."""
        whole = self.whole
        given = {"in_front": None, **more}
        return native.with_part(
            cell=cell,
            centres=whole.centres,
            depths=depths,
            domain=whole.domain,
            filled=whole.is_filled,
            to_box=self.partition.to_box,
            **given,
        )

    def cell(self, number: int) -> Bounds:
        """Return the points that are drawn of a brick, lower <= x < upper."""
        lower, upper = self._cells[number].tolist()
        return tuple(lower), tuple(upper)

    def depths_of(self, number: int) -> tuple[float, float]:
        """Return the nearest and the farthest depth at which a brick is sliced, within those of the whole."""
        near, far = self.depths
        if not self.places.seen[number]:
            return near, far
        first, last = self.places.depths[number].tolist()
        more = _AROUND * self.slice_spacing
        return max(near, first - more), min(far, last + more)

    def _farthest(self) -> float:
        return max(self.depths[1], 0.0)

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
        return calls_for_gradients(self.options) and self.options["gradient"] == "sheets"

    def margin(self, number: int) -> float:
        """Return how far beyond the cell of a brick the picture looks at the field, world units.

        Gradients look at neighbouring pixels and slices, intervals and crossings at the next slice, slabs half a slice
        distance around; the filter widens kernels.
        """
        if not self.places.seen[number]:
            return 0.0
        depth = self._farthest()
        if self.camera.kind == "perspective":
            depth = max(float(self.places.depths[number, 1]), 0.0)
        intervals = TRAITS[self.mode].shows_surfaces or bool(self.options["preintegration"])
        steps = float(intervals) + float(self._gradients)
        if self.options["preintegration"] == "second_order":
            steps = 2.0
        if self.options["sampling"] == "slab":
            steps += 0.5
        if self.is_dimmed and TRAITS[self.mode].shows_surfaces:
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

    def footprint(self, number: int) -> Rect | None:
        """Return the rectangle of pixels that a brick can change, or None where there are none."""
        return self.places.footprint(number)

    def outline(self, number: int) -> NDArray[np.bool_]:
        """Return which pixels of its footprint a brick can change, (h, w): those whose rays meet its cell."""
        return self.places.outline(number)

    def may_show(self, value_range: tuple[float, float]) -> bool:
        """Return whether kernels with factors in a range, all that reach a brick, can show anything at all."""
        # An extremum or a mean is that of the points that count, whatever their values.
        if "coverage" in self.outputs or TRAITS[self.mode].counts:
            return True
        low, high = self._scalars(value_range)
        if math.isinf(high):
            return True
        base = self.whole.base
        if TRAITS[self.mode].adds:
            return base != 0.0 or low < 0.0 or high > 0.0
        low, high = self._widened(low, high)
        if TRAITS[self.mode].shows_surfaces:
            return any(low < value - base <= high for value, _ in surfaces_of(self.options["iso_value"]))
        return shows(self.transfer_function, low + base, high + base)

    def may_show_labels(self, labels: Iterable[int]) -> bool:
        """Return whether samples of some labels, all that reach a brick, can show anything at all."""
        shown = LabelColors.of(self.transfer_function, labels).colors
        return "coverage" in self.outputs or any(shown.get(one, _HIDDEN)[3] > 0.0 for one in labels)

    def may_dim_labels(self, labels: Iterable[int]) -> bool:
        """Return whether samples of some labels, all that reach a brick, can dim light that passes it."""
        # Between labels a scalar of 0 is a surface, so that each has to be known everywhere.
        return TRAITS[self.mode].shows_surfaces or self.may_show_labels(labels)

    def may_dim(self, value_range: tuple[float, float]) -> bool:
        """Return whether kernels with factors in a range, all that reach a brick, can dim light that passes it."""
        low, high = self._scalars(value_range)
        if math.isinf(high):
            return True
        if TRAITS[self.mode].shows_surfaces:
            # Where it is below all surfaces the scalar says where between two bricks one is.
            return low < 0.0 or high > 0.0
        low, high = self._widened(low, high)
        return shows(self.transfer_function, low + self.whole.base, high + self.whole.base)

    def _scalars(self, value_range: tuple[float, float]) -> tuple[float, float]:
        """Return bounds of the scalar offset by the base, 0 included, by those of the factors of kernels."""
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


def figures(view: BrickView, counts: NDArray[np.int64], of_light: int) -> dict[str, float]:
    """Return the figures of a picture; `counts`: `Counts.of_picture`, `of_light`: how many bricks made its light."""
    reads, count, drawn, coarse = counts.tolist()
    return {
        "bricks": float(len(view.partition)),
        "bricks_drawn": float(drawn),
        "bricks_read": float(reads),
        "bytes_read": float(count),
        "bricks_coarse": float(coarse),
        "bricks_of_light": float(of_light),
    }


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
                "a quality: goals need pictures of the whole",
                "pass " + option_ref("quality", "best") + "; image.error estimates its error",
                kind=Unsupported,
                option=name,
            )
