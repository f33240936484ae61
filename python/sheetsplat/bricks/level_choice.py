"""Which level of a volume a brick is drawn with: the coarsest one whose error the quality allows.

The error of a level is that of light along lines through the brick in all directions: what its samples show against
what those of the volume show, at the slice distance of the picture, whatever is in front. It does not depend on the
camera, so that a picture does not depend on those before it.
"""

from __future__ import annotations

import hashlib
import math
import pickle
from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.bricks.view import BrickView
from sheetsplat.fields import RegularField
from sheetsplat.modes import TRAITS
from sheetsplat.options.scene import surfaces_of
from sheetsplat.quality.slicing import composited, phong, weakest_gradient

Floats = NDArray[np.float64]

# Lines through a brick, and the share of the error that a quality allows that they may show: they are few.
_LINES = 128
_SAFETY = 0.7
# Sums of a brick below this share of the largest that it could have count as that.
_FAINT = 0.01
# Samples of all lines at once.
_AT_ONCE = 1 << 16
# Levels of bricks and looks that are known, at most.
_KNOWN = 1 << 16
_known: OrderedDict[Any, int] = OrderedDict()


def level_of(view: BrickView, number: int, key: Any, field_at: Any) -> int:
    """Return the level that a brick is drawn with, 0: the volume itself.

    Parameters
    ----------
    view
        The picture, with the error that levels may have.
    number
        Of the brick.
    key
        The same for the same samples.
    field_at
        Makes the field of the brick at a level.
    """
    if view.allowed is None or not view.levels:
        return 0
    known = (key, number, _look(view))
    if known not in _known:
        _known[known] = _coarsest(view, number, field_at)
        while len(_known) > _KNOWN:
            _known.popitem(last=False)
    _known.move_to_end(known)
    return _known[known]


def _look(view: BrickView) -> bytes:
    """Return what the error of a level depends on, beside the samples."""
    names = ("mode", "iso_value", "lights", "material", "slice_spacing", "reference_length")
    parts = [view.options[name] for name in names]
    told = pickle.dumps((parts, view.transfer_function.points, view.lattice, view.allowed, len(view.partition)), 5)
    return hashlib.blake2b(told, digest_size=16).digest()


def _coarsest(view: BrickView, number: int, field_at: Any) -> int:
    assert view.allowed is not None
    most = _SAFETY * view.allowed
    if not view.is_scalar:
        # Errors of the bricks that a ray passes add up as if by chance; of sums and extrema they are shares of these.
        most /= max(1.0, len(view.partition) ** (1.0 / 6.0))
    lines = _Lines.of(view, number)
    wanted = _seen(view, field_at(0), lines)
    found, largest = 0, _largest(view, wanted, lines)
    for level in range(1, len(view.levels) + 1):
        if _error(view, wanted, _seen(view, field_at(level), lines)) > most * largest:
            break
        found = level
    return found


def _error(view: BrickView, wanted: Floats, found: Floats) -> float:
    """Return the error of lines: root mean square over those that show anything, of extrema the largest."""
    apart = found - wanted
    if TRAITS[view.mode].is_extreme:
        # A ray of a picture shows the best of all that it passes.
        return float(np.abs(apart).max(initial=0.0))
    shown = (found != 0.0).any(axis=1) | (wanted != 0.0).any(axis=1)
    return math.sqrt(float(np.square(apart[shown]).mean())) if shown.any() else 0.0


@dataclass(frozen=True, eq=False)
class _Lines:
    """Lines through a brick, the same ones at every call: points are starts + distances along directions."""

    starts: Floats
    along: Floats
    distances: Floats
    inside: NDArray[np.bool_]

    @classmethod
    def of(cls, view: BrickView, number: int) -> _Lines:
        """Return lines with a point at every slice distance within the brick."""
        lower, upper = _box_of(view, number)
        rows = view.partition.to_box
        to_box = np.eye(3) if rows is None else np.asarray(rows)
        to_world = np.linalg.inv(to_box)
        generator = np.random.default_rng(number)
        points = (lower + generator.random((_LINES, 3)) * (upper - lower)) @ to_world.T
        along = generator.normal(size=(_LINES, 3))
        along /= np.linalg.norm(along, axis=1)[:, None]
        step = view.slice_spacing
        sides = np.linalg.norm(to_world, axis=0) * (upper - lower)
        half = math.ceil(float(np.linalg.norm(sides) if rows is None else sides.sum()) / step)
        distances: Floats = step * np.arange(-half, half + 1, dtype=np.float64)
        places = points[:, None, :] + distances[None, :, None] * along[:, None, :]
        own = places if rows is None else places @ to_box.T
        inside: NDArray[np.bool_] = np.all((own >= lower) & (own <= upper), axis=2)
        return cls(points, along, distances, inside)


def _box_of(view: BrickView, number: int) -> tuple[Floats, Floats]:
    """Return what kernels reach of the cell of a brick, in the coordinates of cells."""
    cell = np.asarray(view.partition.bricks[number].cell)
    lower, upper = np.asarray(view.whole.domain or view.own_supports)
    return np.maximum(cell[0], lower), np.minimum(cell[1], upper)


def _seen(view: BrickView, field: RegularField, lines: _Lines) -> Floats:
    """Return what lines show, (N, 4) premultiplied, or (N, 1) of scalar modes."""
    shape = lines.inside.shape
    line, at = np.nonzero(lines.inside)
    scalars, gradients, shown = np.zeros(len(line)), np.zeros((len(line), 3)), np.zeros(len(line), bool)
    lit = bool(view.options["lights"]) and not view.is_scalar
    for first in range(0, len(line), _AT_ONCE):
        part = slice(first, first + _AT_ONCE)
        points = lines.starts[line[part]] + lines.distances[at[part], None] * lines.along[line[part]]
        if lit:
            scalars[part], gradients[part], nearest = field.probe(points)
            shown[part] = nearest >= 0
        else:
            scalars[part], shown[part] = field.scalars_and_shown(points)
    if view.is_scalar:
        return _scalar(view, lines, line[shown], scalars[shown])
    if TRAITS[view.mode].shows_surfaces:
        return _surfaces(view, lines, scalars, gradients)
    known = view.transfer_function.at(scalars)
    opacity = np.minimum(known[:, 3], 1.0 - 2.0**-24)
    thickness = np.zeros(shape)
    share = view.slice_spacing / float(view.options["reference_length"])
    thickness[lines.inside] = np.where(shown, -np.log1p(-opacity) * share, 0.0)
    colors = np.zeros((*shape, 3))
    colors[lines.inside] = _light(view, lines, line, known[:, :3], gradients)
    return composited(colors, thickness)


def _light(view: BrickView, lines: _Lines, line: Any, colors: Floats, gradients: Floats) -> Floats:
    """Return colours, (M, 3), in the light of a picture that looks along the lines."""
    lights = view.options["lights"]
    if not lights:
        return colors
    along = lines.along[line]
    # Any axes of a camera that looks along a line.
    aside = np.where(np.abs(along[:, :1]) < 0.7, np.eye(3)[0], np.eye(3)[1])
    right = np.cross(along, aside)
    right /= np.linalg.norm(right, axis=1)[:, None]
    up = np.cross(right, along)
    directions = []
    for one in lights:
        towards = np.asarray(one.direction, np.float64)
        x, y, z = towards
        directions.append(x * right + y * up - z * along if one.space == "eye" else towards)
    weak = weakest_gradient(view.transfer_function, [view.whole.value_range], float(view.options["reference_length"]))
    normals = -gradients / np.maximum(np.linalg.norm(gradients, axis=1), weak or 1.0)[:, None]
    return phong(view.options["material"], lights, directions, colors, normals, -along)


def _surfaces(view: BrickView, lines: _Lines, scalars: Floats, gradients: Floats) -> Floats:
    """Return colours of the surfaces that lines cross, from front to back."""
    values, slopes = np.zeros(lines.inside.shape), np.zeros((*lines.inside.shape, 3))
    values[lines.inside], slopes[lines.inside] = scalars, gradients
    colors, thickness = np.zeros(slopes.shape), np.zeros(values.shape)
    for value, opacity in surfaces_of(view.options["iso_value"]):
        below, above = values[:, :-1], values[:, 1:]
        both = lines.inside[:, :-1] & lines.inside[:, 1:]
        line, at = np.nonzero(both & ((below >= value) != (above >= value)))
        apart = above[line, at] - below[line, at]
        share = ((value - below[line, at]) / np.where(apart == 0.0, 1.0, apart))[:, None]
        normal = (1.0 - share) * slopes[line, at] + share * slopes[line, at + 1]
        base = np.broadcast_to(view.transfer_function.at([value])[:, :3], (len(line), 3))
        colors[line, at] = _light(view, lines, line, base, normal)
        thickness[line, at] = -math.log1p(-min(opacity, 1.0 - 2.0**-24))
    return composited(colors, thickness)


def _scalar(view: BrickView, lines: _Lines, line: Any, scalars: Floats) -> Floats:
    """Return sums or extrema of lines, (N, 1)."""
    found = np.zeros(len(lines.inside))
    reduce = TRAITS[view.mode].reduce
    first, at = np.unique(line, return_index=True)
    found[first] = scalars[at]
    rest = np.delete(np.arange(len(line)), at)
    reduce.at(found, line[rest], scalars[rest])
    result: Floats = found[:, None]
    return result


def _largest(view: BrickView, wanted: Floats, lines: _Lines) -> float:
    """Return what errors are measured by: 1 of colours, else the largest number of the picture, or less."""
    if not view.is_scalar:
        return 1.0
    largest = view.largest_sample
    if TRAITS[view.mode].adds:
        # That of the brick; a ray that sees more passes others, with errors and sums of their own.
        most = largest * float(lines.inside.sum(axis=1).max(initial=1))
        largest = max(float(np.abs(wanted).max(initial=0.0)), _FAINT * most)
    return largest or 1.0
