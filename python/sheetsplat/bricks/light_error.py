"""How far light in a picture in bricks is from its definition: measured at points that the picture shows.

The measurement of one process (``cpp/src/light/light_error.cpp``), in two rounds over the bricks: lines from points to
the lights leave the brick that the points are in. Each brick says what it shows at some pixels; from these points are
chosen; then each brick says what it leaves of light on its part of the lines from them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._sheetsplat import LightVolumes, choose_spots, light_errors, probe_pixels, spot_columns, thinned
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

# Of tables of spots (`LightSpot` of the native part), the column of the brick that each is in.
_BRICK = 10
# Points of a pixel in a brick that are handed on: of more, some stand for all.
_MOST = 128


@dataclass(frozen=True, eq=False)
class Probes:
    """The pixels that are looked at.

    Attributes
    ----------
    numbers
        Those that show something, in the order in which pixels are tried.
    tried
        How many were.
    """

    numbers: tuple[int, ...]
    tried: int

    @classmethod
    def of(cls, view: BrickView, opacity: NDArray[np.float32]) -> Probes:
        """Return the pixels of a view whose picture, perhaps of fewer pixels, has some opacities."""
        pixels, wanted, batch = probe_pixels(size=view.size, surfaces=TRAITS[view.mode].shows_surfaces)
        samples = max(1, view.size[0] // opacity.shape[1])
        seen = opacity[pixels[:, 1] // samples, pixels[:, 0] // samples] > 0.0
        enough = int(np.searchsorted(np.cumsum(seen), wanted)) + 1
        tried = min(len(pixels), math.ceil(enough / batch) * batch)
        return cls(tuple(np.flatnonzero(seen[:tried]).tolist()), tried)


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
    table[:, _BRICK] = number
    return thinned(table, _MOST)


def merged_spots(_: Any, *parts: Floats) -> Floats:
    """Return the points of several bricks."""
    return np.concatenate([np.zeros((0, spot_columns)), *parts])


def chosen_spots(view: BrickView, probes: Probes, *parts: Floats) -> Floats:
    """Return points at equal steps of what they add to their pixels, of those of all bricks."""
    surfaces, stop = TRAITS[view.mode].shows_surfaces, float(view.options["opacity_stop"])
    table = merged_spots(view, *parts)
    return choose_spots(table, size=view.size, surfaces=surfaces, stop=stop, seen=len(probes.numbers))


def lines_of(view: BrickView, source: Any, number: int, light: LightVolumes, chosen: Floats) -> Lines:
    """Return what a brick leaves of light on lines from points; raises what `draw_brick` does."""
    native = native_part(view, number, field_of(source, view, number), view.depths, light=light)
    return Lines(
        *renderer_of(view.settings).light_lines(
            native, view.camera.native, size=view.size, spots=chosen, number=number, progress=asked()
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
    return light_errors(
        chosen,
        lines.is_absorbed,
        lines.lights,
        lines.left,
        lines.shown,
        size=view.size,
        surfaces=TRAITS[view.mode].shows_surfaces,
        tried=probes.tried,
        seen=len(probes.numbers),
    )
