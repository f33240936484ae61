"""Coarse copies of large volumes, for pictures while the view moves.

However few pixels a picture has, all samples that show are walked through: the first stage of 256³ samples takes half a
second of processor time. Blocks of samples become one sample, their mean; the picture of those takes a sixth of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from sheetsplat.fields import BrickedField, BrickedKernels, Field, RegularField
from sheetsplat.fields.regular import Boundary, Lattice
from sheetsplat.fields.samples import grid_steps
from sheetsplat.scene import Scene

# Samples that are drawn soon enough, and how many more are worth a copy.
_FEW, _MANY = 700_000, 1_500_000
# Rows of blocks whose means are made at once, in samples.
_AT_ONCE = 1 << 23


def coarse_fields(fields: Sequence[Field]) -> tuple[Field, ...] | None:
    """Return fields with coarse copies in place of large volumes and of data in bricks; None where there are none."""
    made = [_coarse(one) for one in fields]
    if all(one is None for one in made):
        return None
    return tuple(own if one is None else one for own, one in zip(fields, made, strict=True))


def _coarse(field: Field) -> Field | None:
    if isinstance(field, BrickedKernels):
        return field.sample
    if isinstance(field, BrickedField):
        return _grid_of(field)
    if not isinstance(field, RegularField) or field.lattice != "cartesian" or field.values.size <= _MANY:
        return None
    if field.colored:
        # A mean of what is seen would be one of colours by their opacities.
        return None
    width = 2
    while field.values.size > _FEW * width**3:
        width += 1
    if min(field.shape) < 4 * width:
        return None
    if field.labels:
        return _every(field, (width, width, width), field.values[::width, ::width, ::width])
    counts = [count // width for count in field.shape]
    whole = field.values[tuple(slice(count * width) for count in counts)]
    means = np.empty(counts, np.float32)
    rows = max(1, _AT_ONCE // (width * whole[0].size))
    for start in range(0, counts[0], rows):
        part = whole[start * width : (start + rows) * width]
        blocks = part.reshape(-1, width, counts[1], width, counts[2], width)
        means[start : start + rows] = blocks.mean(axis=(1, 3, 5), dtype=np.float64 if width > 8 else np.float32)
    shift = 0.5 * (width - 1)
    return RegularField(
        means,
        origin=field.origin + shift * field.steps.sum(axis=0),
        **_wider(field, (width, width, width)),
        nan="skip",
        boundary=cast(Boundary, field.boundary),
        base=field.base,
    )


def _wider(field: RegularField, widths: Sequence[int]) -> dict[str, Any]:
    """Return where samples lie of which each stands for so many of a field along i, j, k."""
    if field.axes is not None:
        return {"axes": np.asarray(widths)[:, None] * field.steps}
    return {"spacing": [width * step for width, step in zip(widths, field.spacing, strict=True)]}


def _grid_of(field: BrickedField) -> RegularField | None:
    """Return the samples of a volume in bricks that are known since it was opened; nothing is read."""
    steps = grid_steps(field.shape, field.lattice)
    if field.lattice == "bcc" and (len(set(steps)) > 1 or not steps[0] % 2):
        # Samples that are no such lattice.
        return None
    return _every(field, steps[::-1], field.samples.on_grid(steps))


def _every(field: RegularField, widths: Sequence[int], samples: NDArray[Any]) -> RegularField:
    """Return a field of some samples of another one, of which each stands for so many along i, j, k."""
    return RegularField(
        samples,
        **_wider(field, widths),
        origin=field.origin,
        lattice=cast(Lattice, field.lattice),
        nan="skip",
        prefilter=False,
        boundary=cast(Boundary, field.boundary),
        base=field.base if field.has_values else None,
        labels=field.labels,
    )


def coarse_scene(scene: Scene, fields: Sequence[Field], *, plain_light: bool) -> Scene:
    """Return a scene with other fields in place of its own, and with slices as they call for.

    Parameters
    ----------
    scene
        What is shown.
    fields
        As many as the scene has.
    plain_light
        Leave shadows and ambient occlusion out.
    """
    rest = iter(fields)
    groups = [[next(rest) for _ in group] for group in scene.groups]
    changes = {"shadows": False, "ambient_occlusion": None} if plain_light else {}
    return scene.replace(
        field=groups if len(groups) > 1 else groups[0],
        slice_spacing=None,
        supersampling=1,
        reference_length=scene.reference_length,
        **changes,
    )
