"""Pictures that show nothing, or one value only, or ends that are none: whether they do, and why."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.fields import BrickedField, EllipsoidField, Field, RegularField
from sheetsplat.labels import LabelColors
from sheetsplat.look import automatic
from sheetsplat.look.histogram import stride_of
from sheetsplat.modes import TRAITS
from sheetsplat.notices import is_muted, warn
from sheetsplat.quality.thin import may_be_thin

if TYPE_CHECKING:
    from sheetsplat.camera import Camera
    from sheetsplat.image import Image
    from sheetsplat.scene import Scene
    from sheetsplat.transfer import TransferFunction


# Share of the values that are few, and how many are classified at once.
_FEW = 1e-3
# Names of labels in a warning.
_TOLD = 4
_AT_ONCE = 1_000_000
# How far sums leave the range of the samples at most, as a share of it: such as pass through them, next to steps and
# borders, and others by their ripple.
_OVERSHOOT, _RIPPLE = 0.4, 0.02


def is_empty(image: Image, scene: Scene) -> bool:
    """Return whether nothing can be seen: opacity 0 everywhere, or the background alone, or only zeros."""
    if image.is_scalar:
        return not np.nan_to_num(image.scalar).any()
    if scene.background is None:
        return not image.rgba[..., 3].any()
    behind = np.asarray((*scene.background, 1.0), dtype=np.float32)
    return bool(np.array_equal(image.rgba, np.broadcast_to(behind, image.rgba.shape)))


def _range_of(field: Field) -> tuple[float, float]:
    """Return the smallest and the largest scalar of a field; of scattered fields approximately."""
    if not isinstance(field, EllipsoidField):
        return field.value_range
    # Sums of scattered kernels may be much larger or smaller than their values.
    found = automatic.scalars_in(field)
    return float(found.min(initial=math.inf)), float(found.max(initial=-math.inf))


def warn_of_unseen(image: Image, scene: Scene) -> None:
    """Warn of a picture in which nothing can be seen, or in which all values have one colour."""
    if is_muted():
        return
    if is_empty(image, scene):
        why = why_empty(scene, image.camera, image.size, hidden=image.plan.has("depth_limit"))
        warn("nothing can be seen in the picture: " + why)
        return
    if thin := _thin_labels(scene):
        warn("labels are not seen: " + _told_thin(thin))
    if outside := why_one_color(image, scene):
        warn("all values have one colour in the picture: " + outside)
    if absent := _absent_surfaces(scene):
        warn("a part of the surfaces is missing: " + absent)


def why_empty(
    scene: Scene, camera: Camera | None = None, size: tuple[int, int] | None = None, *, hidden: bool = False
) -> str:
    """Return the probable reason why the picture of a scene shows nothing.

    Parameters
    ----------
    scene
        The scene.
    camera, size
        Of the picture, where known.
    hidden
        Whether a surface drawn elsewhere hides a part of the scene.
    """
    known = [one for one in scene.fields if one.size]
    if not known:
        return "the field has no kernels" if isinstance(scene.fields[0], EllipsoidField) else "all samples are NaN"
    if all(isinstance(one, RegularField) and one.labels for one in known):
        return _why_no_label(scene, hidden=hidden)
    ranges = [_range_of(one) for one in known]
    low, high = sum(low for low, _ in ranges), sum(high for _, high in ranges)
    values = f"the values {low:g} to {high:g}"
    if low == high == 0 and not TRAITS[scene.mode].is_composited:
        return "all values are 0"
    if TRAITS[scene.mode].shows_surfaces:
        outside = _outside(scene, low, high, sum(one.base for one in known))
        if len(outside) == len(scene.surfaces):
            return _told_outside(outside, values)
        if not any(opacity for iso, opacity in scene.surfaces if iso not in outside):
            return "the opacity of the surfaces is 0"
    elif TRAITS[scene.mode].is_composited and all(function.max_opacity == 0 for function in scene.transfer_functions):
        return "the opacity is 0 everywhere"
    elif TRAITS[scene.mode].is_composited and len(scene.transfer_functions) == 1:
        function = scene.transfer_functions[0]
        inside = [value for value in function.points[:, 0].tolist() if low <= value <= high]
        if not function.at([low, *inside, high])[..., 3].any():
            return (
                f"the opacity is 0 for all of {values}; "
                f"the transfer function goes from {function.v_min:g} to {function.v_max:g}"
            )
    if why := _why_hidden(scene, hidden=hidden):
        return why
    if scene.options["filter"] == "ewa":
        return "perhaps the filter lowers all values to where the opacity is 0, or the camera looks past the field"
    if camera is not None and size is not None and may_be_thin(scene, camera, size):
        return "perhaps kernels fall between pixels or slices, as they are narrower, or the camera looks past the field"
    if seen := _few_seen(scene, known):
        return seen
    return "perhaps the camera looks past the field"


def _why_hidden(scene: Scene, *, hidden: bool) -> str:
    if hidden:
        return "perhaps the surface whose depths were given as depth_limit hides all that there is"
    if scene.options["clip"].planes or scene.options["clip"].region is not None:
        return "perhaps the clip cuts off all that there is, or the camera looks past the field"
    return ""


def _shown_labels(scene: Scene) -> Iterator[tuple[RegularField, LabelColors, list[int]]]:
    """Yield the fields of labels, their colours, and which of their labels have one."""
    for group, function in zip(scene.groups, scene.transfer_functions, strict=True):
        field = group[0]
        if isinstance(field, RegularField) and field.labels and field.size:
            colors = LabelColors.of(function, field.labels_found)
            yield field, colors, [one for one in field.labels_found if colors.colors.get(one, (0.0,))[-1] > 0.0]


def _thin_labels(scene: Scene) -> list[str]:
    """Return what labels are called that have a colour, and are too thin to be seen anywhere."""
    return [
        colors.name_of(label) for field, colors, labels in _shown_labels(scene) for label in field.labels_unseen(labels)
    ]


def _told_thin(names: Sequence[str]) -> str:
    told = ", ".join(names[:_TOLD]) + f" and {len(names) - _TOLD} more" * (len(names) > _TOLD)
    return (
        f"{told}: single samples, and lines one sample wide, weigh less than what is around them; "
        "repeat samples along each axis to show them"
    )


def _why_no_label(scene: Scene, *, hidden: bool) -> str:
    """Return the probable reason why the picture of a scene of labels alone shows nothing."""
    shown, thin = sum(len(labels) for _, _, labels in _shown_labels(scene)), _thin_labels(scene)
    if not shown:
        return "no label of the data has a colour and an opacity"
    if len(thin) == shown:
        return _told_thin(thin)
    return _why_hidden(scene, hidden=hidden) or "perhaps the camera looks past the field"


def _outside(scene: Scene, low: float, high: float, base: float) -> list[float]:
    """Return the iso values that no scalar between two numbers reaches; where no kernel reaches it is the base."""
    return [iso for iso, _ in scene.surfaces if not min(low, base) <= iso <= max(high, base)]


def _told_outside(outside: Sequence[float], values: str) -> str:
    told = ", ".join(f"{iso:g}" for iso in outside)
    return f"the iso value{'s' * (len(outside) > 1)} {told} lie{'s' * (len(outside) == 1)} outside {values}"


def _absent_surfaces(scene: Scene) -> str:
    """Return in words which iso values of a scene that shows others lie outside its values, or ""."""
    known = [one for one in scene.fields if one.size]
    if not TRAITS[scene.mode].shows_surfaces or len(scene.surfaces) < 2 or not known:
        return ""
    ranges = [_range_of(one) for one in known]
    # Of each group where it is alone, and of sums.
    bases = [one.base for one in known]
    low = sum(min(low, base) for (low, _), base in zip(ranges, bases, strict=True))
    high = sum(max(high, base) for (_, high), base in zip(ranges, bases, strict=True))
    interpolated = any(isinstance(one, RegularField) and one.prefilter for one in known)
    beyond = (_OVERSHOOT if interpolated else _RIPPLE) * (high - low)
    outside = _outside(scene, low - beyond, high + beyond, sum(bases))
    return _told_outside(outside, f"the values {low:g} to {high:g}") if outside else ""


def _few_seen(scene: Scene, fields: Sequence[Field]) -> str:
    """Return in words that hardly any value of a single field has an opacity, or ""."""
    if len(fields) > 1 or not TRAITS[scene.mode].is_composited:
        return ""
    values = _values_of(fields[0])
    values = values[~np.isnan(values)] if values.dtype.kind == "f" else values
    count = sum(
        int((scene.transfer_function.at(part)[..., 3] > 0).sum())
        for part in np.array_split(values, max(1, values.size // _AT_ONCE))
    )
    if count > _FEW * values.size:
        return ""
    low, high = np.percentile(values, (100.0 * _FEW, 100.0 - 100.0 * _FEW)).tolist()
    return f"only {count} of {values.size} values have an opacity; nearly all lie between {low:g} and {high:g}"


def _values_of(field: Field) -> NDArray[Any]:
    """Return the values of a field, (N,), of a volume in bricks some of them."""
    if isinstance(field, BrickedField):
        return field.samples.every(stride_of(field.samples.size))
    return field.values.reshape(-1) if isinstance(field, EllipsoidField | RegularField) else np.empty(0)


def why_one_color(image: Image, scene: Scene) -> str:
    """Return why all values of a picture have one colour, where they lie beyond the range of the colours; else ""."""
    if image.is_scalar:
        colors = scene.scalar_colors
        if not np.ptp(colors.table, axis=0).any():
            return "its colormap has one colour; give it another at each end, such as black and that one"
        if colors.log and not (image.scalar > 0).any():
            return "none of its numbers is above 0, as their logarithms need"
        if colors.clim is None:
            return ""
        numbers = image.scalar[~np.isnan(image.scalar)]
        return _beyond((float(numbers.min()), float(numbers.max())), image.clim) if numbers.size else ""
    if not TRAITS[scene.mode].is_composited:
        return ""
    for number, (group, function) in enumerate(zip(scene.groups, scene.transfer_functions, strict=True)):
        limits = function.v_min, function.v_max
        known = [one for one in group if one.size]
        if not known or limits[0] == limits[1]:
            continue
        values = _bounds_of_group(known, function)
        if values is not None and (found := _beyond(values, limits)):
            return found if len(scene.groups) == 1 else f"of group {number}, {found}"
    return ""


def _beyond(values: tuple[float, float], limits: tuple[float, float]) -> str:
    """Return in words that a range of values lies beyond limits, or ""."""
    side = "above" if values[0] > limits[1] else "below" if values[1] < limits[0] else ""
    return f"{values[0]:g} to {values[1]:g} lie {side} the range {limits[0]:g} to {limits[1]:g}" if side else ""


def _bounds_of_group(fields: Sequence[Field], function: TransferFunction) -> tuple[float, float] | None:
    """Return bounds of the scalar of fields that add up; None where they are not known and need not be."""
    bounds = []
    for one in fields:
        low, high = one.value_range
        if isinstance(one, EllipsoidField) and one.normalization == "none":
            # Sums begin at 0, and only samples tell how far they reach. These take time, and are needed only where one
            # value alone does not reach the limits and the values below them are visible.
            heaviest = one.weight_range[1]
            reached = function.v_min <= max(high, high * heaviest) or function.v_min <= 0.0
            if reached or len(fields) > 1 or not function.points[0, 4] > 0:
                return None
            low, high = _range_of(one)
        if isinstance(one, EllipsoidField):
            # Where few kernels overlap, the scalar falls to the base.
            low, high = min(low, one.base), max(high, one.base)
        elif one.normalization == "none" and not (isinstance(one, RegularField) and one.prefilter):
            return None
        bounds.append((low, high))
    lows, highs = zip(*bounds, strict=True)
    # Where fields overlap their scalars add up; elsewhere there is one alone.
    below, above = [value for value in lows if value < 0], [value for value in highs if value > 0]
    return sum(below) if below else min(lows), sum(above) if above else max(highs)


def warn_of_ends(scene: Scene) -> None:
    """Warn of volumes in one group that are drawn as if they fell to 0, where its fields end in different places."""
    for group in scene.groups:
        ends = [one.domain for one in group]
        volumes = [one for one, end in zip(group, ends, strict=True) if end is not None and one.size]
        if len(set(ends)) > 1 and any(one.base != 0.0 or not isinstance(one, RegularField) for one in volumes):
            warn(
                "fields that add up end in different places, and fall to 0 there; give each a transfer function of its "
                "own, or join them into one array"
            )
            return
