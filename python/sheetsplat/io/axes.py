"""Volumes whose axes a file states: turned so that they are the axes of the world, and made even."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import permutations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory, notices
from sheetsplat._checks import Triple, shown, triple
from sheetsplat.errors import option_ref
from sheetsplat.io.checks import Where, unreadable
from sheetsplat.io.records import Floats
from sheetsplat.orientation import Orientation
from sheetsplat.quantity import Axis

_ADVICE = "resample the volume to such axes"
# Largest distance of an even coordinate from its place, in steps: that of float32 degrees to a tenth.
_UNEVEN = 2e-3
# Largest cosine between axes at right angles, and entry by which axes differ from those of the world (0.06 degrees).
_SKEWED = 1e-3
_TURNED = 1e-3
# Axes of different units are told where one is this many times as long as another.
_FLAT = 20.0
# Resampled axes have at most this many times as many samples.
_FINER = 4

_log = logging.getLogger("sheetsplat")


def along_the_world(
    path: Where, what: str, steps: Floats, origin: Floats, values: NDArray[Any]
) -> tuple[NDArray[Any], Triple, Triple]:
    """Return a volume turned so that its axes are z, y, x of the world, with spacing and origin.

    Parameters
    ----------
    path, what
        The file and the entry of its header, for messages.
    steps
        (3, 3): each row is the step in the world along an axis of the file, the fastest first. InvalidInput unless
        each is along an axis of the world.
    origin
        World position of the file's first sample.
    values
        Samples, the axes in the opposite order of the steps.
    """
    wanted = "three directions along the axes of the world"
    if steps.shape != (3, 3) or not np.all(np.isfinite(steps)):
        raise unreadable(path, f"{what} {shown(steps.tolist())}", wanted)
    along = steps != 0
    if not (np.all(along.sum(axis=0) == 1) and np.all(along.sum(axis=1) == 1)):
        raise unreadable(path, f"{what} {shown(steps.tolist())}", wanted, _ADVICE)
    world = along.argmax(axis=1)
    lengths = steps[np.arange(3), world]
    file_axis = np.argsort(world)
    values = values.transpose([2 - file_axis[2], 2 - file_axis[1], 2 - file_axis[0]])
    first, spacing = origin.copy(), np.ones(3)
    for axis in range(3):
        step = lengths[file_axis[axis]]
        if step < 0:
            values = np.flip(values, 2 - axis)
            first[axis] += step * (values.shape[2 - axis] - 1)
        spacing[axis] = abs(step)
    return values, triple("spacing", spacing), triple("origin", first)


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


@dataclass(frozen=True)
class Turned(Placed):
    """Samples as in `Placed`, and the orientation of a body in them."""

    orientation: Orientation | None = None


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


def nearest_the_world(
    path: Where,
    what: str,
    steps: Floats,
    origin: Floats,
    values: NDArray[Any],
    orientation: Orientation | None,
) -> Turned:
    """Return a volume whose axes are turned against those of the world, with its own axes in the nearest order.

    Where they are not turned, this is `along_the_world`. Otherwise the volume keeps its right-angled axes, each drawn
    along the axis of the world nearest to it about the middle of the volume, and the orientation is turned instead:
    nothing is interpolated.

    Parameters
    ----------
    path, what, steps, origin, values
        As for `along_the_world`; axes within 0.06 degrees of those of the world are taken for these.
    orientation
        Of the world; None: not known.

    Raises
    ------
    InvalidInput
        For axes that are not at right angles.
    """
    lengths = np.linalg.norm(steps, axis=1) if steps.shape == (3, 3) else np.zeros(3)
    if not (np.all(np.isfinite(lengths)) and np.all(lengths > 0) and np.all(np.isfinite(origin))):
        raise unreadable(path, f"{what} {shown(steps.tolist())}", "three directions")
    units = steps / lengths[:, None]
    if np.abs(units @ units.T - np.eye(3)).max() > _SKEWED:
        raise unreadable(path, f"{what} {shown(steps.tolist())}", "directions at right angles", _ADVICE)
    # The order and signs of axes with the largest sum of cosines.
    order = max(permutations(range(3)), key=lambda one: sum(abs(units[row, one[row]]) for row in range(3)))
    signs = np.sign(units[range(3), order])
    plain = np.zeros((3, 3))
    plain[range(3), order] = signs * lengths
    # Rows: axes of the world, nearly, in their order; columns: the world.
    frame = np.zeros((3, 3))
    frame[order, :] = units * signs[:, None]
    if np.abs(frame - np.eye(3)).max() <= _TURNED:
        return Turned(*along_the_world(path, what, plain, origin, values), {}, orientation)
    half = (np.array(values.shape[::-1]) - 1) / 2.0
    middle = origin + half @ steps
    placed = along_the_world(path, what, plain, middle - half @ plain, values)
    angle = math.degrees(math.acos(min(1.0, max(-1.0, (float(np.trace(frame)) - 1.0) / 2.0))))
    details = {"turned": f"drawn along its own axes, {angle:.1f} degrees off those of the world"}
    _log.info("%s: %s", path, details["turned"])
    if orientation is not None:
        up = triple("up", frame @ np.asarray(orientation.up))
        front = None if orientation.front is None else triple("front", frame @ np.asarray(orientation.front))
        orientation = Orientation(up, front)
    return Turned(*placed, details, orientation)


def tell_units(axes: Sequence[Axis], shape: Sequence[int], spacing: Triple) -> None:
    """Warn of axes x, y, z of different units whose lengths in the picture nobody has chosen; shape is (nk, nj, ni)."""
    lengths = [max(count - 1, 1) * step for count, step in zip(reversed(shape), spacing, strict=True)]
    if len({one.unit for one in axes if one.unit}) > 1 and max(lengths) > _FLAT * min(lengths):
        sides = ", ".join(f"{one.name} {side:g} {one.unit}" for one, side in zip(axes, lengths, strict=True))
        notices.warn(f"the axes have different units ({sides}); pass " + option_ref("spacing", "...")
                     + " to choose their lengths in the picture")  # fmt: skip
