"""What a picture of a scene needs of the bricks of its field."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache, singledispatch
from typing import Any

import numpy as np

from sheetsplat.backends import EXACT
from sheetsplat.bricks.kernel_source import KernelSource, supports_of
from sheetsplat.bricks.lattice import Box, LatticeSpec
from sheetsplat.bricks.level_choice import level_of
from sheetsplat.bricks.levels import lattices_of
from sheetsplat.bricks.partition import EVERYWHERE, Partition, partition_lattice
from sheetsplat.bricks.resident import renderer_of, residents
from sheetsplat.bricks.sources import BrickSource
from sheetsplat.bricks.view import BrickView
from sheetsplat.bricks.whole import Whole
from sheetsplat.camera import Camera
from sheetsplat.choose.asked import allowed_error
from sheetsplat.errors import Unsupported, complain
from sheetsplat.fields import Bricked, BrickedField, BrickedKernels, Field, RegularField
from sheetsplat.limits import Depths
from sheetsplat.modes import TRAITS
from sheetsplat.plan import RenderPlan
from sheetsplat.scene import Scene
from sheetsplat.supersampling import fine_size

# Coefficients of a prefilter exceed the samples at most so many times more than its condition says.
_LARGER = 1.05


def bricked_field(scene: Scene) -> Bricked | None:
    """Return the field of a scene where it is in bricks, None for other scenes; Unsupported where there are others."""
    found = [one for one in scene.fields if isinstance(one, Bricked)]
    if not found:
        return None
    if len(scene.fields) > 1:
        raise complain(
            "a picture cannot be drawn in bricks",
            f"{len(scene.fields)} fields",
            "one field",
            "open them with sheetsplat.open where they fit into memory, else write their sum as one volume",
            kind=Unsupported,
        )
    return found[0]


@lru_cache(maxsize=16)
def partition_of(lattice: LatticeSpec, brick: int) -> Partition:
    """Return a lattice cut into bricks of an edge."""
    return partition_lattice(lattice, brick)


def one_backend(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings of a renderer with one backend for all processes, whatever devices they have."""
    backend = EXACT if settings["backend"] == "auto" else settings["backend"]
    return {**settings, "backend": backend}


def view_of(
    field: Bricked,
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    outputs: tuple[str, ...],
    depth_limit: Depths | None,
    settings: Mapping[str, Any],
) -> BrickView:
    """Return what a picture needs of each brick of the field of a scene: a pixel for each of its samples.

    depth_limit: of each sample.

    Raises
    ------
    Unsupported
        For effects that cannot be drawn in bricks, before anything is read.
    """
    if isinstance(field, BrickedField):
        lattice = LatticeSpec.of(field)
        if field.labels and _needs_all_labels(scene):
            lattice = lattice.replace(all_labels=field.labels_found)
        partition = partition_of(lattice, field.brick)
        whole = Whole.of_lattice(lattice, _factors(field, field.value_range), field.centre_bounds)
    else:
        source = _kernels(field.source)
        partition = source.partition
        whole = Whole.of_bricks(field, supports_of(source.segments, len(partition)), source.longest)
    view = BrickView.of(
        partition,
        whole,
        scene.transfer_function,
        scene.options,
        camera,
        fine_size(size, scene.supersampling),
        outputs,
        depth_limit,
        one_backend(settings),
    )
    if whole.lattice is None or not isinstance(field.source, BrickSource) or not field.source.coarser:
        return view
    quality = "good" if scene.quality is None else scene.quality.name
    return view.replace(
        levels=tuple(lattices_of(field.source, whole.lattice)),
        allowed=allowed_error(quality),
        largest_sample=max(map(abs, field.value_range)),
    )


def _needs_all_labels(scene: Scene) -> bool:
    """Return whether each brick needs a group of every label, as light has a grid of each, whatever is in a brick."""
    dims = bool(scene.options["shadows"]) or scene.options["ambient_occlusion"] is not None
    return dims and TRAITS[scene.mode].shows_surfaces


def _kernels(source: Any) -> KernelSource:
    assert isinstance(source, KernelSource)
    return source


def _factors(field: BrickedField, values: tuple[float, float]) -> tuple[float, float]:
    """Return bounds of the factors of kernels, offset by the base, by those of the samples."""
    low, high = values[0] - field.base, values[1] - field.base
    amplified = field.prefilter_condition
    if amplified is None or low == high:
        return low, high
    middle, half = 0.5 * low + 0.5 * high, _LARGER * amplified * (0.5 * high - 0.5 * low)
    return middle - half, middle + half


def source_key(field: Bricked) -> Any:
    """Return what is the same for the same samples or kernels."""
    return (field.source if isinstance(field.source, BrickSource) else _kernels(field.source)).key


def may_show(field: Bricked, view: BrickView, number: int) -> bool:
    """Return whether a brick can add anything to a picture, by the ranges of all samples that it depends on."""
    if view.footprint(number) is None:
        return False
    if isinstance(field, BrickedField) and field.labels:
        return view.may_show_labels(_labels_of(field, view, number))
    found = _range_of(field, view, number)
    return found is not None and view.may_show(found)


def shown_bricks(field: Bricked, view: BrickView) -> list[int]:
    """Return the bricks that can add anything to a picture, from front to back."""
    return [number for number in view.order() if may_show(field, view, number)]


def dimming_bricks(field: Bricked, view: BrickView) -> list[int]:
    """Return the bricks that can dim light in a picture; none where none of it is dimmed."""
    if view.light is None:
        return []
    if isinstance(field, BrickedField) and field.labels:
        return [n for n in range(len(view.partition)) if view.may_dim_labels(_labels_of(field, view, n))]
    ranges = ((number, _range_of(field, view, number)) for number in range(len(view.partition)))
    return [number for number, found in ranges if found is not None and view.may_dim(found)]


def _labels_of(field: BrickedField, view: BrickView, number: int) -> tuple[int, ...]:
    """Return the labels of all samples that a brick depends on, and perhaps some more."""
    assert view.lattice is not None
    return field.survey.labels_in(view.lattice.to_read(view.samples(number)))


def _range_of(field: Bricked, view: BrickView, number: int) -> tuple[float, float] | None:
    """Return bounds of the factors of all kernels that reach a brick; None: there are none."""
    if isinstance(field, BrickedKernels):
        found = _kernels(field.source).value_range(number, view.margin(number))
        return None if found is None else (found[0] - field.base, found[1] - field.base)
    assert view.lattice is not None
    return factors_in(field, view.lattice.to_read(view.samples(number)))


def factors_in(field: BrickedField, samples: Box) -> tuple[float, float]:
    """Return bounds of the factors of the kernels that depend on no samples but those of a box.

    Offset by the base; the box is one of samples of the volume, as `LatticeSpec.to_read` gives it.
    """
    ranges = field.survey.ranges[field.survey.near(samples)]
    if np.isnan(ranges).all():
        return 0.0, 0.0
    return _factors(field, (float(np.nanmin(ranges[:, 0])), float(np.nanmax(ranges[:, 1]))))


@singledispatch
def field_of(source: Any, view: BrickView, number: int) -> Field:
    """Return the field of a brick for a picture; what it is made of stays in this process while it fits."""
    residents().begin(view)
    level = level_of(view, number, source.key, lambda level: _field_at(source, view, number, level))
    residents().counts.coarse += level > 0
    return _field_at(source, view, number, level)


@field_of.register
def _(source: KernelSource, view: BrickView, number: int) -> Field:
    residents().begin(view)
    low, high = view.whole.value_range
    return residents().kernels(source, number, view.margin(number), (low + view.whole.base, high + view.whole.base))


def _field_at(source: BrickSource, view: BrickView, number: int, level: int) -> RegularField:
    """Return the field of a brick at a level."""
    lattice, core = view.lattice_at(level), view.partition.bricks[number].samples
    assert core is not None
    box, values = view.samples(number, level), view.whole.value_range
    return residents().made(
        source.at_level(level), core, lattice.to_read(box), (lattice, box, values),
        lambda samples: lattice.field(samples, box, values),
    )  # fmt: skip


def planned(scene: Scene, view: BrickView) -> tuple[BrickView, RenderPlan]:
    """Return the plan of every brick's picture, and the view with what it says for all bricks.

    Effects, slices, backend and precision are those of the whole; memory and device are one brick's. Where the whole
    needs float64 so do all bricks; else a brick may need it for itself.
    """
    native = scene.native
    if view.depth_limit is not None:
        native = native.with_depth_limit(view.depth_limit)
    native = view.part(native, EVERYWHERE, view.whole.depths(view.camera), supports=view.supports)
    also = {name: name in view.outputs for name in ("coverage", "depth")}
    plan = renderer_of(view.settings, "wholes").plan(scene=native, camera=view.camera.native, size=view.size, **also)
    if plan.precision == "float64":
        view = view.replace(settings={**view.settings, "precision": "float64"})
    return view, RenderPlan.of_native(plan, scene.notes, scene.quality, scene.supersampling)
