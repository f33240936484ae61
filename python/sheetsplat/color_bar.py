"""Colour bars of pictures, in units of the data: what they show, and how matplotlib draws them."""

from __future__ import annotations

import collections
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._matplotlib import module_of
from sheetsplat.describe.recipe import FieldRecipe
from sheetsplat.labels import LabelColors
from sheetsplat.modes import TRAITS
from sheetsplat.options.scene import surfaces_of
from sheetsplat.quantity import Quantity
from sheetsplat.scalar_colors import ScalarColors
from sheetsplat.transfer import TransferFunction

if TYPE_CHECKING:
    from sheetsplat.image import Image

_COLORS = 256
# Names beside the legend of labels.
_MOST_NAMES = 40
#: The unit of lengths that have none.
WORLD = "world units"
# The data's least value begins a bar where its colours then still have a fifth of it.
_FARTHEST = 4.0
# Gray levels of the squares of a checkerboard, two beside each other on the right half of a bar.
_CHECKER = (1.0, 0.75)
# Bars over a smaller factor have the round numbers of linear ones, over a smaller one 1, 2 and 5 times powers of ten.
_DECADE, _FEW_DECADES = 10.0, 1000.0


@dataclass(frozen=True)
class ColorBar:
    """Colours, evenly spaced between two values of the data, or between their logarithms.

    Attributes
    ----------
    colors
        Red, green, blue and 1, float64 (256, 4).
    low, high
        The values at the ends.
    log
        Whether the logarithms are evenly spaced.
    label
        Name and unit.
    marks
        Values of surfaces.
    opacities
        Opacity of each colour as a share of the largest one, float64 (256,); None where colours have none.
    names
        Of labels the place of each on the bar and what it is called, in place of numbers.
    """

    colors: NDArray[np.float64]
    low: float
    high: float
    log: bool
    label: str
    marks: tuple[float, ...] = ()
    opacities: NDArray[np.float64] | None = None
    names: tuple[tuple[float, str], ...] = ()


def color_bars(image: Image) -> list[ColorBar]:
    """Return the colour bars of a picture, one for each of its transfer functions and for the colours of planes.

    Volumes of colours have none.
    """
    if image.is_scalar:
        return [_bar_of_numbers(image)]
    surfaces = surfaces_of(image.recipe.options["iso_value"]) if TRAITS[image.mode].shows_surfaces else ()
    recipe, first, bars = image.recipe, 0, []
    giver = sum(recipe.groups)
    colors = recipe.colors or (None,) * len(recipe.groups)
    for function, count, coloring in zip(recipe.transfer_functions, recipe.groups, colors, strict=True):
        fields = recipe.fields[first : first + count]
        places, first = range(first, first + count), first + count
        if fields[0].colored:
            continue
        quantity = common_quantity(fields)
        if isinstance(function, LabelColors):
            bar = _bar_of_labels(function, quantity)
        elif coloring is not None:
            quantity = common_quantity(recipe.fields[giver : giver + coloring[0]])
            giver += coloring[0]
            bar = _bar_of(coloring[1], quantity, (), has_opacity=False)
        else:
            bar = _bar_of(function, quantity, surfaces, has_opacity=TRAITS[image.mode].is_composited)
        bars.append((bar, f"{bar.label} of field{'s' * (count > 1)} {' and '.join(map(str, places))}"))
    bars += [(bar, bar.label) for bar in _bars_of_planes(image)]
    alike = collections.Counter(bar.label for bar, _ in bars)
    return [replace(bar, label=longer) if alike[bar.label] > 1 else bar for bar, longer in bars]


def _bars_of_planes(image: Image) -> list[ColorBar]:
    """Return the bars of slice planes, one for each colormap and its limits; labels have none."""
    recipe, quantity = image.recipe, common_quantity(image.recipe.fields)
    if any(one.options.get("labels") for one in recipe.fields):
        return []
    found = dict.fromkeys((one.cmap, one.clim) for one in recipe.options["slice_planes"])
    bars = []
    for cmap, (low, high) in found:
        if quantity.floor is not None:
            low = max(low, quantity.floor)
            high = high if low < high else 10.0 * low
        table = ScalarColors(cmap).colors(np.linspace(0.0, 1.0, _COLORS), (0.0, 1.0))
        table[:, 3] = 1.0
        bars.append(ColorBar(table, low, high, quantity.floor is not None, f"{quantity.label} on planes"))
    return bars


def _bar_of_numbers(image: Image) -> ColorBar:
    """Return the bar of a scalar picture; where it has no limits of its own, it begins at the least number."""
    quantity, mode = common_quantity(image.recipe.fields), TRAITS[image.mode]
    colors = image.recipe.options["scalar_colors"]
    low, high = image.clim
    known = image.scalar[np.isfinite(image.scalar)]
    if colors.clim is None and not colors.log and low < (least := float(known.min(initial=high))) < high:
        low = least
    values = np.geomspace(low, high, _COLORS) if colors.log else np.linspace(low, high, _COLORS)
    table = colors.colors(values, image.clim)
    table[:, 3] = 1.0
    if mode.integrates:
        return ColorBar(table, low, high, colors.log, _integral_label(quantity))
    label = f"{mode.of_values} {quantity.label}"
    if mode.mean and (weight := image.recipe.fields[0].opened.get("weight")):
        label += f", weighted by {weight}"
    if quantity.floor is not None and not colors.log:
        return ColorBar(table, quantity.scalar(low), quantity.scalar(high), True, label)
    return ColorBar(table, low, high, colors.log, label)


def _bar_of_labels(function: LabelColors, quantity: Quantity) -> ColorBar:
    """Return the legend of labels: as many equal parts as there are, the first one at the top."""
    rows = list(function.colors.items())[::-1] or [(0, (0.0, 0.0, 0.0, 0.0))]
    part = np.arange(_COLORS) * len(rows) // _COLORS
    table = np.array([[*rgba[:3], 1.0] for _, rgba in rows])[part]
    step = -(-len(rows) // _MOST_NAMES)
    # From the top, as the page and figures leave out more of them where there is no room.
    names = tuple((n + 0.5, function.name_of(rows[n][0])) for n in range(len(rows) - 1, -1, -step))[::-1]
    return ColorBar(table, 0.0, float(len(rows)), False, quantity.name or "labels", names=names)


def _bar_of(
    function: TransferFunction, quantity: Quantity, surfaces: Sequence[tuple[float, float]], *, has_opacity: bool
) -> ColorBar:
    low, high = function.v_min, function.v_max
    if not low < high:
        # One point: one colour everywhere.
        half = max(abs(low), 1.0) * 1e-3
        low, high = low - half, high + half
    elif (least := function.least) is not None:
        least = min(least, *(value for value, _ in surfaces), high)
        low = least if least < high and low - least <= _FARTHEST * (high - low) else low
    table = function.at(np.linspace(low, high, _COLORS))
    # The opacity is per length; a bar shows what share of the largest one it is.
    largest = float(table[:, 3].max()) if has_opacity else 0.0
    opacities = table[:, 3] / largest if largest > 0.0 else None
    table[:, 3] = 1.0
    marks = tuple(quantity.scalar(value) for value, _ in surfaces if low <= value <= high)
    ends = quantity.scalar(low), quantity.scalar(high)
    return ColorBar(np.clip(table, 0.0, 1.0), *ends, quantity.floor is not None, quantity.label, marks, opacities)


def common_quantity(fields: Sequence[FieldRecipe]) -> Quantity:
    """Return what the scalar of fields that add up is: that of each where they agree."""
    known = {one.quantity for one in fields}
    return known.pop() if len(known) == 1 else Quantity()


def _integral_label(quantity: Quantity) -> str:
    length = quantity.length_unit or WORLD
    unit = f"{quantity.unit} · {length}" if quantity.unit else f"value · {length}" if not quantity.name else length
    return f"integral of {quantity.name or 'the value'} along the ray [{unit}]"


def draw_bar(picture: Any, bar: ColorBar, *, into: Any = None, most: int = 9) -> Any:
    """Draw a bar beside the axes of a picture, or into axes of its own, with at most so many numbers; return it.

    Names of labels are left to the figure, which knows how much room they have.
    """
    colors = module_of("colors")
    norm = (colors.LogNorm if bar.log else colors.Normalize)(bar.low, bar.high)
    mappable = module_of("cm").ScalarMappable(norm, colors.ListedColormap(bar.colors))
    made = picture.figure.colorbar(mappable, ax=None if into else picture, cax=into)
    if into is None:
        made.ax.set_axes_locator(partial(_beside, picture))
    if not bar.names:
        _set_numbers(made, bar, most)
    if bar.opacities is not None:
        _draw_opacities(made.ax, bar, bar.opacities)
    for value in bar.marks:
        made.ax.axhline(value, color="black", linewidth=3.0)
        made.ax.axhline(value, color="white", linewidth=1.2)
    return made


def _beside(picture: Any, bar: Any, _: Any) -> Any:
    """Return the place of a bar: as high as the picture and as near to it as to the axes, which it may not fill."""
    place, axes, filled = bar.get_position(original=True), picture.get_position(original=True), picture.get_position()
    nearer = axes.x1 - filled.x1
    return module_of("transforms").Bbox.from_extents(place.x0 - nearer, filled.y0, place.x1 - nearer, filled.y1)


def _set_numbers(made: Any, bar: ColorBar, most: int) -> None:
    """Set the numbers beside a bar: at least three, also on a logarithmic one that has no power of ten."""
    ticker = module_of("ticker")
    if bar.log and bar.high < _FEW_DECADES * bar.low:
        if bar.high < _DECADE * bar.low:
            made.locator = ticker.MaxNLocator(most, steps=[1, 2, 2.5, 5, 10], min_n_ticks=3)
            made.formatter = ticker.ScalarFormatter()
        else:
            made.locator = ticker.LogLocator(subs=(1.0, 2.0, 5.0))
            made.formatter = ticker.LogFormatterSciNotation(minor_thresholds=(np.inf, np.inf))
        made.minorlocator, made.minorformatter = ticker.NullLocator(), ticker.NullFormatter()
    elif not bar.log:
        made.locator = ticker.MaxNLocator(most, steps=[1, 2, 2.5, 5, 10], min_n_ticks=3)


def _draw_opacities(axes: Any, bar: ColorBar, opacities: NDArray[np.float64]) -> None:
    """Draw the right half of a bar over a checkerboard, which shows where its colours are faint."""
    place = axes.get_position(original=True).transformed(axes.figure.transSubfigure)
    count = min(max(4.0 * place.height / place.width, 2.0), 0.5 * _COLORS)
    squares = (np.arange(_COLORS) * count // _COLORS).astype(int)[:, None] + np.arange(2)
    behind = np.choose(squares % 2, _CHECKER)[..., None]
    share = opacities[:, None, None]
    shown = share * bar.colors[:, None, :3] + (1.0 - share) * behind
    edges = (np.geomspace if bar.log else np.linspace)(bar.low, bar.high, _COLORS + 1)
    # As the colours of matplotlib's own bars, which have no lines between them then.
    axes.pcolormesh([0.5, 0.75, 1.0], edges, shown, rasterized=True, zorder=1)
