"""Figures of pictures: axes and colour bars in units of the data. Needs matplotlib."""

from __future__ import annotations

import collections
import importlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import pixels
from sheetsplat._checks import shown, truth
from sheetsplat._matplotlib import module_of, require_matplotlib
from sheetsplat.describe.recipe import FieldRecipe
from sheetsplat.errors import complain, unusable
from sheetsplat.modes import TRAITS
from sheetsplat.options.scene import surfaces_of
from sheetsplat.quantity import Axis, Quantity
from sheetsplat.transfer import TransferFunction

if TYPE_CHECKING:
    from PIL.Image import Image as PillowImage

    from sheetsplat.image import Image

_COLORS = 256
_DPI = 100
_INK = "#222222"
# Colours of x, y and z that most colour-blind readers can tell apart (after Okabe and Ito).
_AXES = (("x", "#D55E00"), ("y", "#009E73"), ("z", "#0072B2"))
# The unit of lengths that have none.
_WORLD = "world units"
# A view direction closer to an axis than this is along it.
_ALONG = 1e-6
# Share of the picture's width that a scale bar has at most.
_BAR_SHARE = 0.3
# Letters in the picture: at most so much of its shorter side, and pixels that can still be read.
_INSIDE, _LEAST_LETTER = 1.0 / 15.0, 7.0
# Letters of an axis's name beside its direction.
_LONGEST_NAME = 12
# Characters in the height of two letters, the usual ratio; lines of a label have at least so many.
_WIDTH_OF_LETTER = 0.55
_SHORTEST_LINE = 12
# Names from files are no TeX.
_AS_IT_IS = {"parse_math": False, "usetex": False}


@dataclass(frozen=True)
class ColorBar:
    """Colours, evenly spaced between two values of the data, or between their logarithms."""

    colors: NDArray[np.float64]
    low: float
    high: float
    log: bool
    label: str
    marks: tuple[float, ...] = ()


@dataclass(frozen=True)
class PicturePlane:
    """The plane through the camera's target in which a figure measures.

    Attributes
    ----------
    extent
        Coordinates of the left, right, bottom and top edge along the labelled axes.
    labels
        What lies to the right and upwards, with units.
    axes
        The same, without a unit where lengths of the world have none.
    oblique
        Whether neither of them is an axis of the world.
    """

    extent: tuple[float, float, float, float]
    labels: tuple[str, str]
    axes: tuple[Axis, Axis]
    oblique: bool


def color_bars(image: Image) -> list[ColorBar]:
    """Return the colour bars of a picture, one for each of its transfer functions."""
    quantity = common_quantity(image.recipe.fields)
    options = image.recipe.options
    if image.is_scalar:
        colors = options["scalar_colors"]
        low, high = image.clim
        at = np.linspace(0.0, 1.0, _COLORS)
        rows = colors.table
        table = np.column_stack([np.interp(at, np.linspace(0.0, 1.0, len(rows)), column) for column in rows.T])
        mode = TRAITS[image.mode]
        if mode.integrates:
            return [ColorBar(table, low, high, colors.log, _integral_label(quantity))]
        label = f"{mode.of_values} {quantity.label}"
        if mode.mean and (weight := image.recipe.fields[0].opened.get("weight")):
            label += f", weighted by {weight}"
        if quantity.floor is not None and not colors.log:
            return [ColorBar(table, quantity.scalar(low), quantity.scalar(high), True, label)]
        return [ColorBar(table, low, high, colors.log, label)]
    surfaces = surfaces_of(options["iso_value"]) if TRAITS[image.mode].shows_surfaces else ()
    recipe, first, bars = image.recipe, 0, []
    for function, count in zip(recipe.transfer_functions, recipe.groups, strict=True):
        bar = _bar_of(function, common_quantity(recipe.fields[first : first + count]), surfaces)
        fields = " and ".join(map(str, range(first, first + count)))
        bars.append((bar, f"{bar.label} of field{'s' * (count > 1)} {fields}"))
        first += count
    alike = collections.Counter(bar.label for bar, _ in bars)
    return [replace(bar, label=longer) if alike[bar.label] > 1 else bar for bar, longer in bars]


def _bar_of(function: TransferFunction, quantity: Quantity, surfaces: Sequence[tuple[float, float]]) -> ColorBar:
    low, high = function.v_min, function.v_max
    if not low < high:
        # One point: one colour everywhere.
        half = max(abs(low), 1.0) * 1e-3
        low, high = low - half, high + half
    table = np.clip(function.at(np.linspace(low, high, _COLORS)), 0.0, 1.0)
    # The opacity is per length; a bar shows the colours alone.
    table[:, 3] = 1.0
    marks = tuple(quantity.scalar(value) for value, _ in surfaces if low <= value <= high)
    return ColorBar(
        table, quantity.scalar(low), quantity.scalar(high), quantity.floor is not None, quantity.label, marks
    )


def common_quantity(fields: Sequence[FieldRecipe]) -> Quantity:
    """Return what the scalar of fields that add up is: that of each where they agree."""
    known = {one.quantity for one in fields}
    return known.pop() if len(known) == 1 else Quantity()


def _length_unit(image: Image) -> str:
    units = {one.quantity.length_unit for one in image.recipe.fields}
    return units.pop() if len(units) == 1 else ""


def _axes_of(image: Image) -> tuple[Axis, ...]:
    """Return the coordinates along x, y and z: those of the data where all fields agree, else those of the world."""
    own = {one.quantity.axes for one in image.recipe.fields}
    axes = own.pop() if len(own) == 1 else ()
    world = (Axis(name, _length_unit(image) or _WORLD) for name, _ in _AXES)
    return tuple(one if one.name else other for one, other in zip(axes or [Axis()] * 3, world, strict=True))


def _integral_label(quantity: Quantity) -> str:
    length = quantity.length_unit or _WORLD
    unit = f"{quantity.unit} · {length}" if quantity.unit else f"value · {length}" if not quantity.name else length
    return f"integral of {quantity.name or 'the value'} along the ray [{unit}]"


def picture_plane(image: Image) -> PicturePlane:
    """Return where the edges of a picture lie in the plane through the camera's target."""
    camera, (width, height) = image.camera, image.size
    high = world_height(image)
    wide = high * width / height
    axes = _axes_of(image)
    right, up, _ = camera.world_axes()
    edges: list[float] = []
    shown = []
    moved = high * camera.shift[0], high * camera.shift[1]
    for direction, length, word, beside in ((right, wide, "across", moved[0]), (up, high, "up", moved[1])):
        along = int(np.argmax(np.abs(direction)))
        if 1.0 - abs(direction[along]) < _ALONG:
            axis, sign = axes[along], math.copysign(1.0, direction[along])
            middle = camera.target[along] + sign * beside
        else:
            axis = Axis(f"distance {word} from the middle", _length_unit(image) or _WORLD)
            middle, sign = beside, 1.0
        edges += [axis.coordinate(middle - 0.5 * sign * length), axis.coordinate(middle + 0.5 * sign * length)]
        shown.append(axis)
    labels = [one.label for one in shown]
    if camera.kind == "perspective":
        labels[0] += ", at the depth of the target"
    left, to_right, bottom, top = edges
    across, upwards = (one._replace(unit="") if one.unit == _WORLD else one for one in shown)
    oblique = all("distance" in one for one in labels)
    return PicturePlane((left, to_right, bottom, top), (labels[0], labels[1]), (across, upwards), oblique)


def world_height(image: Image) -> float:
    """Return the height of a picture in world units, at the depth of the camera's target."""
    camera = image.camera
    if camera.kind == "orthographic":
        return camera.height
    return 2.0 * math.dist(camera.eye, camera.target) * math.tan(math.radians(camera.fov_y) / 2.0)


def round_length(most: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that is at most `most`."""
    power = 10.0 ** math.floor(math.log10(most))
    return next((step * power for step in (5.0, 2.0) if step * power <= most), power)


def _is_mathematics(text: str) -> bool:
    """Return whether matplotlib can draw a text, whose parts between pairs of dollar signs it takes for TeX."""
    if not module_of("cbook").is_math_text(text):
        return True
    try:
        module_of("mathtext").MathTextParser("path").parse(text)
    except ValueError:
        return False
    return True


def _check_title(function: str, title: object) -> None:
    if title is not None and not isinstance(title, str):
        raise complain(unusable(f"{function}: title"), shown(title), "a text, or None")
    if title is not None and any("\ud800" <= letter <= "\udfff" for letter in title):
        raise complain(unusable(f"{function}: title"), shown(title), "a text of letters")
    if title is not None and not _is_mathematics(title):
        wanted = "a text whose parts between dollar signs are TeX"
        raise complain(unusable(f"{function}: title"), shown(title), wanted, r"write \$ for a dollar sign")


def to_axes(image: Image, ax: Any, *, colorbar: bool, title: str | None) -> Any:
    """Show a picture in axes; see `Image.to_axes`."""
    require_matplotlib()
    _check_title("Image.to_axes", title)
    truth("Image.to_axes: colorbar", colorbar)
    if ax is not None and not isinstance(ax, module_of("axes").Axes):
        wanted = "axes of matplotlib, or None for a new figure"
        raise complain(unusable("Image.to_axes: ax"), f"{type(ax).__name__}, {shown(ax)}", wanted)
    if ax is None:
        _, ax = module_of("pyplot").subplots()
    plane = picture_plane(image)
    left, right, bottom, top = plane.extent
    width, height = image.size
    # Pixels are squares, also where a step along one axis is as long as another one along the other.
    square = "equal" if plane.oblique else abs((right - left) / width / ((top - bottom) / height))
    ax.imshow(np.asarray(image), extent=plane.extent, aspect=square)
    ax.set_xlabel(plane.labels[0], **_AS_IT_IS)
    ax.set_ylabel(plane.labels[1], **_AS_IT_IS)
    if title is not None:
        ax.set_title(title)
    for bar in color_bars(image) if colorbar else ():
        made = ax.figure.colorbar(_mappable(bar), ax=ax)
        made.set_label(bar.label, **_AS_IT_IS)
        made.ax.set_axes_locator(partial(_beside, ax))
        _mark(made.ax, bar)
    return ax


def _beside(picture: Any, bar: Any, _: Any) -> Any:
    """Return the place of a bar: as high as the picture and as near to it as to the axes, which it may not fill."""
    place, axes, filled = bar.get_position(original=True), picture.get_position(original=True), picture.get_position()
    nearer = axes.x1 - filled.x1
    return module_of("transforms").Bbox.from_extents(place.x0 - nearer, filled.y0, place.x1 - nearer, filled.y1)


def _mappable(bar: ColorBar) -> Any:
    colors = module_of("colors")
    norm = (colors.LogNorm if bar.log else colors.Normalize)(bar.low, bar.high)
    return module_of("cm").ScalarMappable(norm, colors.ListedColormap(bar.colors))


def _mark(axes: Any, bar: ColorBar) -> None:
    for value in bar.marks:
        axes.axhline(value, color="black", linewidth=3.0)
        axes.axhline(value, color="white", linewidth=1.2)


def annotated(image: Image, *, colorbar: bool, axes: bool, scale_bar: bool, title: str | None) -> PillowImage:
    """Return a figure of a picture; see `Image.annotated`."""
    require_matplotlib()
    _check_title("Image.annotated", title)
    for name, given in (("colorbar", colorbar), ("axes", axes), ("scale_bar", scale_bar)):
        truth(f"Image.annotated: {name}", given)
    from PIL import Image as Pillow

    width, height = image.size
    # Points of 1/72 inch: about a thirtieth of the picture, as long as it can be read.
    font = min(max(height / 36.0, 11.0), 40.0) * 72.0 / _DPI
    pixel = font * _DPI / 72.0
    inside = min(pixel, max(_INSIDE * min(width, height), _LEAST_LETTER))
    bars = color_bars(image) if colorbar else []
    pad = math.ceil(12 * pixel)
    room = pad + math.ceil(len(bars) * 12 * pixel)
    canvas_size = (width + pad + room, height + 2 * pad)
    # Not pyplot, which would change the global state of a program with windows of its own.
    figure = module_of("figure").Figure([edge / _DPI for edge in canvas_size], dpi=_DPI, facecolor="white")
    canvas = module_of("backends.backend_agg").FigureCanvasAgg(figure)
    style = {"font.size": font, "text.color": _INK, "axes.labelcolor": _INK}
    with importlib.import_module("matplotlib").rc_context(style):
        frame = _axes_at(figure, pad, pad, width, height)
        shown = pixels.over(np.asarray(image, np.uint8), pixels.WHITE)
        plane = picture_plane(image)
        frame.imshow(shown, extent=plane.extent, aspect="auto", interpolation="nearest")
        if axes:
            frame.set_xlabel(_lines(plane.labels[0], width, pixel), **_AS_IT_IS)
            frame.set_ylabel(_lines(plane.labels[1], height, pixel), **_AS_IT_IS)
            # Few numbers, where more would run into each other.
            frame.locator_params(axis="x", nbins=_ticks(width, pixel))
            frame.locator_params(axis="y", nbins=_ticks(height, pixel))
        else:
            frame.set_axis_off()
        if title is not None:
            frame.set_title(title if "$" in title else _lines(title, width + room, pixel))
        left = pad + width + pixel
        for bar in bars:
            beside = _axes_at(figure, left, pad, 1.2 * pixel, height)
            figure.colorbar(_mappable(bar), cax=beside).set_label(_lines(bar.label, height, pixel), **_AS_IT_IS)
            _mark(beside, bar)
            # The next one follows the numbers and the label, whose widths depend on the data.
            left = beside.get_tightbbox(canvas.get_renderer()).x1 + pixel
        over = _axes_at(figure, pad, pad, width, height)
        over.set_axis_off()
        over.set(xlim=(0, width), ylim=(0, height))
        if axes and plane.oblique:
            _draw_directions(over, image, inside)
        if scale_bar:
            _draw_scale_bar(over, image, inside)
        canvas.draw()
        box = figure.get_tightbbox(canvas.get_renderer())
    drawn = np.asarray(canvas.buffer_rgba())[..., :3]
    margin = 0.5 * pixel
    left, right = (round(box.x0 * _DPI - margin), round(box.x1 * _DPI + margin))
    top, bottom = (round(canvas_size[1] - box.y1 * _DPI - margin), round(canvas_size[1] - box.y0 * _DPI + margin))
    return Pillow.fromarray(np.ascontiguousarray(drawn[max(top, 0) : bottom, max(left, 0) : right]))


def _lines(text: str, length: float, pixel: float) -> str:
    """Return a text in as many lines as fit beside a side of so many pixels."""
    import textwrap

    most = max(int(length / (_WIDTH_OF_LETTER * pixel)), _SHORTEST_LINE)
    return "\n".join(textwrap.wrap(text, most, break_long_words=False)) or text


def _ticks(length: float, pixel: float) -> int:
    """Return how many numbers may stand at a side of so many pixels."""
    return min(max(int(length / (4.0 * pixel)), 2), 9)


def _axes_at(figure: Any, left: float, bottom: float, width: float, height: float) -> Any:
    """Return axes at a place in pixels."""
    wide, high = figure.get_size_inches() * _DPI
    return figure.add_axes([left / wide, bottom / high, width / wide, height / high])


def _outlined(text: Any, pixel: float) -> None:
    effects = module_of("patheffects")
    text.set_path_effects([effects.withStroke(linewidth=0.25 * pixel, foreground="white")])


def _draw_scale_bar(axes: Any, image: Image, pixel: float) -> None:
    """Draw a bar of a round length into the lower right corner; axes in pixels."""
    width, height = image.size
    scale = world_height(image) / height
    length = round_length(_BAR_SHARE * width * scale)
    right, bottom, across = width - pixel, pixel, length / scale
    for color, thick in (("white", 0.6), (_INK, 0.3)):
        edge = 0.15 * pixel if color == "white" else 0.0
        axes.plot(
            [right - across - edge, right + edge],
            [bottom, bottom],
            color=color,
            linewidth=thick * pixel * 72.0 / _DPI,
            solid_capstyle="butt",
        )
    text = f"{length:g} {_length_unit(image) or _WORLD}"
    # A text that is longer than the bar ends where the bar does.
    middle = max(right - 0.5 * max(across, _WIDTH_OF_LETTER * pixel * len(text)), 0.0)
    made = axes.text(
        middle,
        bottom + 0.5 * pixel,
        text,
        ha="center",
        va="bottom",
        color=_INK,
        fontsize=pixel * 72.0 / _DPI,
        **_AS_IT_IS,
    )
    _outlined(made, pixel)


def _draw_directions(axes: Any, image: Image, pixel: float) -> None:
    """Draw the directions of x, y and z into the lower left corner, those that point away first; axes in pixels."""
    reach = 2.6 * pixel
    right, up, back = image.camera.world_axes()
    names = [name if len(name) <= _LONGEST_NAME else f"{name[: _LONGEST_NAME - 1]}…"
             for name in (one.name for one in _axes_of(image))]  # fmt: skip
    halves = [0.5 * _WIDTH_OF_LETTER * pixel * len(name) for name in names]
    start = 4.2 * pixel
    # Where names are centred, to the right of the common beginning: longer ones farther away.
    places = [right[n] * (1.35 * reach + halves[n] - min(halves[n], 0.3 * pixel)) for n in range(3)]
    middle = max(start, *(half - place + 0.5 * pixel for half, place in zip(halves, places, strict=True)))
    for n in sorted(range(3), key=lambda axis: back[axis]):
        color = _AXES[n][1]
        x, y = right[n] * reach, up[n] * reach
        for edge, thick in (("white", 0.5), (color, 0.22)):
            axes.plot(
                [middle, middle + x],
                [start, start + y],
                color=edge,
                linewidth=thick * pixel * 72.0 / _DPI,
                solid_capstyle="round",
            )
        label = axes.text(
            middle + places[n], start + 1.35 * y, names[n], ha="center", va="center", color=color, **_AS_IT_IS
        )
        label.set(fontweight="bold", fontsize=pixel * 72.0 / _DPI)
        _outlined(label, pixel)
