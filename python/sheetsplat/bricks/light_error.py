"""How far light in a picture in bricks is from its definition: measured at points that the picture shows.

The same measurement as that of one process (``cpp/src/engine/light_error.cpp``), in two rounds over the bricks: lines
from points to the lights leave the brick that the points are in. Each brick says what it shows at some pixels; from
these points are chosen; then each brick says what it leaves of light on its part of the lines from them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._sheetsplat import LightVolumes, probe_pixels
from sheetsplat._waiting import asked
from sheetsplat.bricks.draw import native_part
from sheetsplat.bricks.light import light_of
from sheetsplat.bricks.needs import dimming_bricks, field_of, shown_bricks, source_key
from sheetsplat.bricks.partition import MERGED
from sheetsplat.bricks.resident import renderer_of
from sheetsplat.bricks.tasks import Tasks
from sheetsplat.bricks.view import BrickView
from sheetsplat.fields import Bricked
from sheetsplat.modes import TRAITS
from sheetsplat.options.renderer import Progress

Floats = NDArray[np.float64]

#: Measures shadows and ambient occlusion, root mean square errors, of a picture with some opacities, (h, w).
Measure = Callable[[NDArray[np.float32], "Progress | None"], tuple[float, float]]

# Columns of tables of spots (`LightSpot` of the native part); after these the brick that each is in; and of those that
# were chosen what each stands for in its pixel, twice, by chances of their own.
_NUMBER, _SLICE, _BEHIND, _SHARE, _CHANCES, _OCCLUSION, _OWN, _COLUMNS = 0, 1, 2, 7, [8, 9], 10, 11, 12
_BRICK, _SHARES = 12, slice(13, 15)
# Red, green and blue that a light adds at most, and how much of it is shown.
_SHOWN = 4
# Points of a pixel in a brick that are handed on: of more, some stand for all.
_MOST = 128
# Of the squares of means, which have a share of chance, what is stated at least.
_LEAST = 0.25


@dataclass(frozen=True, eq=False)
class Probes:
    """The pixels that are looked at.

    Attributes
    ----------
    numbers
        Those that show something, in the order in which pixels are tried.
    tried
        How many were.
    every
        One of so many is looked at for occlusion.
    points
        Points of a pixel, on the average.
    reserve
        What is stated over what is measured.
    """

    numbers: tuple[int, ...]
    tried: int
    every: int
    points: float
    reserve: float

    @classmethod
    def of(cls, view: BrickView, opacity: NDArray[np.float32]) -> Probes:
        """Return the pixels of a view whose picture, perhaps of fewer pixels, has some opacities."""
        pixels, wanted, batch, every, points, reserve = probe_pixels(
            size=view.size, surfaces=TRAITS[view.mode].shows_surfaces
        )
        samples = max(1, view.size[0] // opacity.shape[1])
        seen = opacity[pixels[:, 1] // samples, pixels[:, 0] // samples] > 0.0
        enough = int(np.searchsorted(np.cumsum(seen), wanted)) + 1
        tried = min(len(pixels), math.ceil(enough / batch) * batch)
        return cls(tuple(np.flatnonzero(seen[:tried]).tolist()), tried, every, points, reserve)


@dataclass(frozen=True, eq=False)
class Lines:
    """What bricks leave of light on lines from points.

    Attributes
    ----------
    is_absorbed
        Whether `left` has sums, of which 2 ** -sum is left of light, in place of products.
    lights
        How many lights cast shadows.
    left
        Of each point, towards each light, and around it.
    shown
        Of each point, for each light and for what is open around it, the colour that all of it adds, and how much of it
        the picture shows.
    """

    is_absorbed: bool
    lights: int
    left: Floats
    shown: Floats


def measured_light(tasks: Tasks, view: BrickView, field: Bricked, opacity: NDArray[np.float32]) -> Any:
    """Return what measures light in a picture with some opacities: see `Measure`."""
    shown, dimming = shown_bricks(field, view), dimming_bricks(field, view)
    light, _ = light_of(tasks, view, source_key(field), dimming)
    probes = Probes.of(view, opacity)
    given = tasks.anywhere("plan", given_to_all, probes)
    spots = [tasks.place("light-spots", spots_of, number, light, given) for number in shown]
    some = tasks.merged("merge-spots", merged_spots, spots, MERGED)
    chosen = tasks.anywhere("choose-spots", chosen_spots, given, *some)
    lines = [tasks.place("light-lines", lines_of, number, light, chosen) for number in sorted({*shown, *dimming})]
    merged = tasks.merged("merge-lines", merged_lines, lines, MERGED)
    return tasks.anywhere("measure-light", errors_of, given, chosen, *merged)


def given_to_all(_: BrickView, value: Any) -> Any:
    """Return what many tasks take, which is sent once."""
    return value


def spots_of(view: BrickView, source: Any, number: int, light: LightVolumes, probes: Probes) -> Floats:
    """Return a table of what a brick shows at pixels; raises what `draw_brick` does."""
    native = native_part(view, number, field_of(source, view, number), view.depths, light=light)
    table = renderer_of(view.settings).light_spots(
        native, view.camera.native, size=view.size, numbers=list(probes.numbers), progress=asked()
    )
    table = _thinned(table)
    return np.column_stack((table, np.full(len(table), number)))


def _runs(numbers: NDArray[Any]) -> Iterator[tuple[int, int]]:
    """Yield the first of equal numbers in a row, and the one behind the last."""
    yield from itertools.pairwise(np.flatnonzero(np.diff(numbers, prepend=-1, append=-1)).tolist())


def _thinned(table: Floats) -> Floats:
    """Return the points of pixels with few; of others some, at equal steps of what they add, which add as much."""
    kept = []
    for first, last in _runs(table[:, _NUMBER]):
        part = table[first:last]
        if len(part) > _MOST:
            shares = part[:, _SHARE]
            taken = _steps_of(shares, shares.sum() / _MOST, part[0, _CHANCES[0]] + part[0, _CHANCES[1]])
            part = part[taken > 0.0]
            part[:, _SHARE] = taken[taken > 0.0] * (shares.sum() / taken.sum())
        kept.append(part)
    return np.concatenate(kept) if kept else table


def merged_spots(_: Any, *parts: Floats) -> Floats:
    """Return the points of several bricks."""
    return np.concatenate([np.zeros((0, _COLUMNS + 1)), *parts])


def chosen_spots(view: BrickView, probes: Probes, *parts: Floats) -> Floats:
    """Return points at equal steps of what they add to their pixels, of those of all bricks."""
    table = merged_spots(view, *parts)
    table = table[np.lexsort((table[:, _SLICE] + table[:, _BEHIND], table[:, _NUMBER]))]
    chosen = [np.zeros((0, _SHARES.stop))]
    for first, last in _runs(table[:, _NUMBER]):
        seen = _shares_of(table[first:last, _SHARE], table[first:last, _BRICK], float(view.options["opacity_stop"]))
        step = 2.0 * seen.sum() / probes.points
        taken = np.stack([_steps_of(seen, step, chance) for chance in table[first, _CHANCES].tolist()], axis=1)
        there = np.flatnonzero(taken.any(axis=1))
        chosen.append(np.concatenate((table[first + there], taken[there]), axis=1))
    return np.concatenate(chosen)


def _shares_of(shares: Floats, bricks: Floats, stop: float) -> Floats:
    """Return what points of a pixel, from front to back, add to it; those behind the stop add nothing."""
    found = shares.copy()
    left = 1.0
    for first, last in _runs(bricks):
        found[first:last] *= left
        left *= 1.0 - shares[first:last].sum()
    found[np.cumsum(found) - found >= stop] = 0.0
    return found


def _steps_of(shares: Floats, step: float, chance: float) -> Floats:
    """Return what points stand for: 0, a step, the first one of which is shorter by chance, or all of a longer one."""
    found = shares.copy()
    small = shares < step
    if small.any():
        passed = chance + np.cumsum(shares[small]) / step
        found[small] = np.where(np.floor(passed) > np.floor(passed - shares[small] / step), step, 0.0)
    return found


def lines_of(view: BrickView, source: Any, number: int, light: LightVolumes, chosen: Floats) -> Lines:
    """Return what a brick leaves of light on lines from points; raises what `draw_brick` does."""
    native = native_part(view, number, field_of(source, view, number), view.depths, light=light)
    table = chosen[:, :_COLUMNS].copy()
    table[:, _OWN] = chosen[:, _BRICK] == number
    return Lines(
        *renderer_of(view.settings).light_lines(
            native, view.camera.native, size=view.size, spots=table, progress=asked()
        )
    )


def merged_lines(_: Any, *parts: Lines) -> Lines:
    """Return what several bricks leave together."""
    first, *others = parts
    for one in others:
        left = first.left + one.left if first.is_absorbed else first.left * one.left
        first = replace(first, left=left, shown=first.shown + one.shown)
    return first


def errors_of(view: BrickView, probes: Probes, chosen: Floats, *parts: Lines) -> tuple[float, float]:
    """Return root mean square errors of shadows and of ambient occlusion over the picture, of what all bricks leave."""
    if not len(chosen):
        return 0.0, 0.0
    lines = merged_lines(view, *parts)
    left = 2.0**-lines.left if lines.is_absorbed else lines.left
    lights = lines.lights
    shown = lines.shown.reshape(len(left), -1, _SHOWN)
    bright = shown[:, :lights, :3] * (shown[:, :lights, 3] - left[:, :lights])[:, :, None]
    shadows = bright.sum(axis=1)
    numbers, pixel = np.unique(chosen[:, _NUMBER], return_inverse=True)
    occlusion = np.zeros_like(shadows)
    if shown.shape[1] > lights:
        asked = chosen[:, _OCCLUSION] > 0.0
        off = shown[:, lights, 3] - left[:, lights:].mean(axis=1)
        occlusion = np.where(asked[:, None], shown[:, lights, :3] * off[:, None], 0.0)

    def halves(colors: Floats) -> tuple[Floats, Floats]:
        one, other = np.zeros((2, len(numbers), 3))
        for made, share in zip((one, other), chosen[:, _SHARES].T, strict=True):
            np.add.at(made, pixel, share[:, None] * colors)
        return one, other

    beside = numbers % probes.every == 0
    darker, closer, both = halves(shadows), halves(occlusion), halves(shadows + occlusion)
    there = [_square_sum(*(half[beside] for half in one)) for one in (darker, closer, both)]
    # Where both are too bright at the same points their errors add up, and so must the squares of what is stated.
    apart = there[0] + there[1]
    more = max(1.0, math.sqrt(there[2] / apart)) if apart > 0.0 else 1.0
    # Of four channels, of which opacity is right.
    channels = 4.0 * probes.tried
    scale = probes.reserve * more / math.sqrt(channels)
    return scale * math.sqrt(_square_sum(*darker)), scale * math.sqrt(there[1] * probes.every)


def _square_sum(one: Floats, other: Floats) -> float:
    """Return the sum of squares of numbers that are known twice, independently: see `SquareSum` of the native part."""
    mean = 0.5 * (one + other)
    return max(float((one * other).sum()), _LEAST * float((mean * mean).sum()))
