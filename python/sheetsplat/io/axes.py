"""Where the samples of volumes lie: turned to the axes of the world where theirs are along these, and made even."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import permutations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat import _memory, notices
from sheetsplat._checks import Triple, shown, triple
from sheetsplat.errors import InvalidInput, option_ref
from sheetsplat.io.checks import Where, unreadable
from sheetsplat.io.records import Floats, Packing, Volume
from sheetsplat.orientation import Orientation
from sheetsplat.quantity import Axis, Quantity

# Largest distance of an even coordinate from its place, in steps: that of float32 degrees to a tenth.
_UNEVEN = 2e-3
# Axes are along the world where no sample moves by more than this share of the least step when they are put there.
_TURNED = 0.01
# Smallest volume between three directions of unit length.
_FLAT_CELL = 1e-6
# Axes of different units are told where one is this many times as long as another.
_FLAT = 20.0
# Resampled axes have at most this many times as many samples.
_FINER = 4
# Metres of units of length, and how these are spelled in files.
_METRES = {"km": 1e3, "m": 1.0, "cm": 1e-2, "mm": 1e-3, "µm": 1e-6, "nm": 1e-9, "Å": 1e-10, "pm": 1e-12,
           "inch": 0.0254, "ft": 0.3048}  # fmt: skip
_SPELLINGS = {
    "µm": ("um", "μm", "\\u00b5m", "micron", "microns", "micrometer", "micrometers", "micrometre", "micrometres"),
    "Å": ("a", "ang", "angstrom", "angstroms", "ångström", "Å", "\\u00c5"),
    "inch": ("in", "inches"),
    "ft": ("foot", "feet"),
    **{
        unit: tuple(name + end for name in names for end in ("er", "ers", "re", "res"))
        for unit, names in {
            **{"km": ("kilomet",), "m": ("met",), "cm": ("centimet",), "mm": ("millimet",)},
            **{"nm": ("nanomet",), "pm": ("picomet",)},
        }.items()
    },
}
# By the first letters of sides of a body.
_OTHER_SIDE = {"r": "left", "l": "right", "a": "posterior", "p": "anterior", "s": "inferior", "i": "superior"}
_UNIT_OF = {name: unit for unit, names in _SPELLINGS.items() for name in (unit, *names)}

_log = logging.getLogger("sheetsplat")


def unit_of(name: str) -> str:
    """Return the sign of a unit of length by one of its names; the name itself where it is of another kind."""
    return _UNIT_OF.get(name, _UNIT_OF.get(name.lower(), name))


def settled(where: Where, volume: Volume) -> Volume:
    """Return a volume as it is shown: `placed`, with its samples unpacked."""
    volume = placed(where, volume)
    values = volume.packing.unpacked(volume.values, where)
    # That NaN stands for missing samples is still known.
    left = Packing(missing=(math.nan,)) if volume.packing.missing else Packing()
    return replace(volume, values=values, packing=left)


def placed(where: Where, volume: Volume) -> Volume:
    """Return a volume with its lengths in one unit, and along the axes of the world where its own are along these.

    Samples are not read, copied or interpolated. Axes that are turned or sheared stay as they are, in `axes`.

    Parameters
    ----------
    where
        The data, for messages.
    volume
        Its values may be anything that is transposed and cut like an array.

    Raises
    ------
    InvalidInput
        For directions that are not finite or lie in one plane.
    """
    volume = _in_one_unit(volume)
    if volume.axes is None:
        return volume
    if not np.all(np.isfinite(volume.origin)):
        raise unreadable(where, f"the first sample at {shown(list(volume.origin))}", "three finite numbers")
    steps, counts = np.asarray(volume.axes, dtype=np.float64), np.asarray(volume.values.shape[2::-1])
    # (Without squares, which leave the range of numbers.)
    lengths = np.hypot.reduce(steps, axis=1) if steps.shape == (3, 3) else np.zeros(3)
    usable = bool(np.all(np.isfinite(lengths)) and np.all(lengths > 0))
    units = steps / lengths[:, None] if usable else np.zeros((3, 3))
    if not abs(np.linalg.det(units)) > _FLAT_CELL:
        wanted = "three directions that are finite and do not lie in one plane"
        advice = "correct the header, or pass the samples as an array with " + option_ref("axes", "...")
        raise unreadable(where, f"the directions of axes {shown(steps.tolist())}", wanted, advice)
    order, signs = _nearest(units)
    plain = signs * lengths[:, None]
    if (np.abs(steps - plain).T @ (counts - 1)).max() > _TURNED * lengths.min():
        _log.info("%s: %s", where, directions(steps))
        return replace(volume, axes=steps, spacing=triple("spacing", lengths))
    axis_of = np.argsort(order)
    order_of = [2 - axis_of[2], 2 - axis_of[1], 2 - axis_of[0], *range(3, volume.values.ndim)]
    values = volume.values.transpose(order_of)
    first, spacing = np.array(volume.origin), np.ones(3)
    for axis in range(3):
        step = plain[axis_of[axis], axis]
        if step < 0:
            values = np.flip(values, 2 - axis)
            first[axis] += step * (values.shape[2 - axis] - 1)
        spacing[axis] = abs(step)
    return replace(volume, values=values, axes=None, spacing=triple("spacing", spacing), origin=triple("origin", first))


def placement(found: Any, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a field that say where its samples lie: those that were given, else what the data state.

    A spacing that was given is that along the directions which the data state.

    Parameters
    ----------
    found
        What has `spacing`, `origin` and `axes`: a volume that is `placed`, or a source of bricks.
    given
        Options of `sheetsplat.open`.
    """
    spacing, origin = given.get("spacing"), given.get("origin", found.origin)
    if given.get("axes") is not None:
        return {"axes": given["axes"], "spacing": spacing, "origin": origin}
    if found.axes is None:
        return {"spacing": found.spacing if spacing is None else spacing, "origin": origin}
    rows = np.asarray(found.axes)
    if spacing is not None:
        rows = rows * (np.asarray(triple("RegularField: spacing", spacing)) / found.spacing)[:, None]
    return {"axes": rows, "origin": origin}


def in_body(volume: Volume, sides: Sequence[str]) -> Volume:
    """Return a volume of a body in a space whose axes x, y and z run towards these sides of it.

    x of a left-handed space is negated, as the body would be seen in a mirror; what is no such space states nothing.
    """
    try:
        found = Orientation.anatomical(*sides)
        left = [{"l": 1.0, "r": -1.0}.get(one[:1].lower(), 0.0) for one in sides]
        if np.cross(found.up, found.front or ()) @ left > 0:
            return replace(volume, orientation=found)
        mirrored = Orientation.anatomical(_OTHER_SIDE[sides[0][:1].lower()], *sides[1:])
    except InvalidInput:
        return volume
    mirror = np.array([-1.0, 1.0, 1.0])
    steps = np.diag(volume.spacing) if volume.axes is None else np.asarray(volume.axes)
    told = {"mirrored": f"x is negated: the axes of the file, {'-'.join(sides)}, are left-handed"}
    return replace(
        volume,
        axes=steps * mirror,
        origin=triple("origin", np.asarray(volume.origin) * mirror),
        orientation=mirrored,
        details=volume.details | told,
    )


def _nearest(units: Floats) -> tuple[tuple[int, ...], Floats]:
    """Return the axes of the world that three directions are nearest to, and the unit vectors along these as rows."""
    # The order of axes with the largest sum of cosines.
    order = max(permutations(range(3)), key=lambda one: sum(abs(units[row, one[row]]) for row in range(3)))
    plain = np.zeros((3, 3))
    plain[range(3), order] = np.sign(units[range(3), order])
    return order, plain


def directions(axes: ArrayLike) -> str:
    """Return how far three steps are off the axes of the world, and the angles between them where not right."""
    steps = np.asarray(axes, dtype=np.float64)
    units = steps / np.linalg.norm(steps, axis=1)[:, None]
    plain = _nearest(units)[1]
    off = math.degrees(math.acos(min(1.0, float((units * plain).sum(axis=1).min()))))
    between = [
        math.degrees(math.acos(max(-1.0, min(1.0, float(units[a] @ units[b]))))) for a, b in ((0, 1), (0, 2), (1, 2))
    ]
    text = f"{off:.1f} degrees off those of the world"
    if max(abs(angle - 90.0) for angle in between) > 0.05:
        text += ", " + ", ".join(f"{angle:.1f}" for angle in between) + " degrees between i and j, i and k, j and k"
    return text


def _in_one_unit(volume: Volume) -> Volume:
    """Return a volume whose lengths along x, y and z have one unit, that of x, where all are known."""
    if not volume.units:
        return volume
    units, quantity = [unit_of(one) for one in volume.units], volume.quantity
    if len(set(units)) == 1:
        return replace(volume, units=(), quantity=replace(quantity, length_unit=units[0]))
    if not all(one in _METRES for one in units):
        # Axes with names of their own are told where their lengths differ much.
        if all(units) and not quantity.axes:
            sides = ", ".join(f"{axis} {one}" for axis, one in zip("xyz", units, strict=True))
            notices.warn(f"the axes have units that are not all lengths ({sides}), which are shown as they are; pass "
                         + option_ref("spacing", "...") + " to choose their lengths in the picture")  # fmt: skip
        return replace(volume, units=())
    factors = np.array([_METRES[one] / _METRES[units[0]] for one in units])
    told = ", ".join(f"{axis} from {one}" for axis, one in zip("xyz", units, strict=True) if one != units[0])
    axes = tuple(one._replace(factor=one.factor / by) for one, by in zip(quantity.axes, factors, strict=False))
    return replace(
        volume,
        units=(),
        axes=None if volume.axes is None else np.asarray(volume.axes) * factors,
        spacing=triple("spacing", np.asarray(volume.spacing) * factors),
        origin=triple("origin", np.asarray(volume.origin) * factors),
        quantity=replace(quantity, length_unit=units[0], axes=axes),
        details=volume.details | {"converted": f"{told} to {units[0]}"},
    )


@dataclass(frozen=True)
class Placed:
    """Samples [k, j, i] on even axes along those of the world, and what was done to them, as texts."""

    values: NDArray[Any]
    spacing: Triple
    origin: Triple
    details: dict[str, str] = field(default_factory=dict)


def on_even_axes(
    where: Where,
    names: Sequence[str],
    positions: Sequence[Floats | None],
    values: NDArray[Any],
    *,
    resample: bool = False,
) -> Placed:
    """Return samples on even axes from coordinates, which may fall.

    Parameters
    ----------
    where, names
        The data and their axes x, y, z, for messages.
    positions
        Coordinates along x, y, z; None: 0, 1, 2 …
    values
        Samples [k, j, i], as many along each axis as it has coordinates.
    resample
        Interpolate linearly between samples at uneven coordinates: to their least distance, with at most four times as
        many samples.

    Raises
    ------
    InvalidInput
        For coordinates that are not finite, do not all rise or all fall, or are uneven, unless `resample` is true.
    OutOfMemory
        Where the resampled volume does not fit.
    """
    spacing, origin, details = [1.0, 1.0, 1.0], [0.0, 0.0, 0.0], {}
    for axis, (name, places) in enumerate(zip(names, positions, strict=True)):
        if places is None or not places.size:
            continue
        along = 2 - axis
        gaps = np.diff(places)
        if not np.all(np.isfinite(places)) or not (np.all(gaps > 0) or np.all(gaps < 0)):
            found = f"coordinates along {name} that are not finite, repeat, or turn back"
            raise unreadable(
                where, found, "finite numbers that rise or fall", f"sort them, and leave out doubles ({name})"
            )
        if gaps.size and gaps[0] < 0:
            places, gaps, values = places[::-1], -gaps[::-1], np.flip(values, along)
        origin[axis] = float(places[0])
        if not gaps.size:
            continue
        step = float(places[-1] - places[0]) / gaps.size
        ideal = places[0] + step * np.arange(places.size)
        if np.abs(places - ideal).max() > _UNEVEN * step:
            if not resample:
                raise unreadable(
                    where,
                    f"uneven coordinates along {name}, {gaps.min():g} to {gaps.max():g} apart",
                    "even ones",
                    "pass " + option_ref("resample", "true") + " to interpolate to even ones",
                    option="resample",
                )
            count = min(math.ceil((places[-1] - places[0]) / gaps.min() * (1 - 1e-9)) + 1, _FINER * places.size)
            values = _interpolated(where, values, along, places, np.linspace(places[0], places[-1], count))
            step = float(places[-1] - places[0]) / (count - 1)
            details[f"resampled along {name}"] = f"{places.size} samples to {count}"
            _log.info("%s: resampled along %s from %d samples to %d", where, name, places.size, count)
        spacing[axis] = step
    return Placed(values, triple("spacing", spacing), triple("origin", origin), details)


def _interpolated(where: Where, values: NDArray[Any], along: int, old: Floats, new: Floats) -> NDArray[Any]:
    """Return the samples at other coordinates along an axis, linear between the nearest two."""
    kind = np.dtype(np.float32 if values.dtype.kind != "f" and values.dtype.itemsize <= 2 else np.float64)
    kind = np.dtype(np.float32) if values.dtype in (np.float16, np.float32) else kind
    count = values.size // values.shape[along] * new.size
    _memory.require(3 * count * kind.itemsize, f"the resampled samples of {where}")
    lower = np.clip(np.searchsorted(old, new, side="right") - 1, 0, old.size - 2)
    shape = [1, 1, 1]
    shape[along] = new.size
    share = ((new - old[lower]) / (old[lower + 1] - old[lower])).astype(kind).reshape(shape)
    result: NDArray[Any] = values.take(lower, axis=along).astype(kind)
    result *= 1 - share
    result += share * values.take(lower + 1, axis=along)
    return result


def tell_units(quantity: Quantity, shape: Sequence[int], spacing: Triple) -> None:
    """Warn of axes x, y, z of different units whose lengths nobody has chosen; the shape begins with nk, nj, ni."""
    if quantity.length_unit:
        return
    axes: Sequence[Axis] = quantity.axes
    lengths = [max(count - 1, 1) * step for count, step in zip(shape[2::-1], spacing, strict=True)]
    if len({one.unit for one in axes if one.unit}) > 1 and max(lengths) > _FLAT * min(lengths):
        sides = ", ".join(f"{one.name} {side:g} {one.unit}" for one, side in zip(axes, lengths, strict=True))
        notices.warn(f"the axes have different units ({sides}); pass " + option_ref("spacing", "...")
                     + " to choose their lengths in the picture")  # fmt: skip
