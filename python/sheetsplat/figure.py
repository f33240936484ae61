"""Figures of pictures: axes in units of the data, labels, colour bars. Needs matplotlib."""

from __future__ import annotations

import contextlib
import importlib
import io
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sheetsplat import pixels
from sheetsplat._checks import shown
from sheetsplat._matplotlib import module_of, require_matplotlib, wrapped
from sheetsplat.color_bar import WORLD, ColorBar, color_bars, draw_bar
from sheetsplat.errors import complain, option_ref, unusable
from sheetsplat.notices import warn
from sheetsplat.options.core import checked
from sheetsplat.options.figure import AxesOptions, FigureOptions
from sheetsplat.quantity import Axis, time_of

if TYPE_CHECKING:
    from PIL.Image import Image as PillowImage

    from sheetsplat.image import Image

_INK = "#222222"
# Colours of x, y and z that most colour-blind readers can tell apart (after Okabe and Ito).
_AXES = (("x", "#D55E00"), ("y", "#009E73"), ("z", "#0072B2"))
# A view direction closer to an axis than this is along it.
_ALONG = 1e-6
# Share of the picture's width that a scale bar has at most.
_BAR_SHARE = 0.3
# Letters in the picture: at most so much of its shorter side, and pixels that can still be read.
_INSIDE, _LEAST_LETTER = 1.0 / 15.0, 7.0
# Letters of an axis's name beside its direction.
_LONGEST_NAME = 12
# Width of a colour bar in heights of letters.
_BAR = 1.6
# Characters in the height of two letters, the usual ratio; lines of a label have at least so many.
_WIDTH_OF_LETTER = 0.55
_SHORTEST_LINE = 12
# Names of labels: letters in a line and in all, and the height of a line in that of letters.
_NAME_LINE, _NAME_LETTERS = 24, 240
_LINE = 1.25
# Names from files are no TeX.
_AS_IT_IS = {"parse_math": False, "usetex": False}


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


def _length_unit(image: Image) -> str:
    units = {one.quantity.length_unit for one in image.recipe.fields}
    return units.pop() if len(units) == 1 else ""


def _axes_of(image: Image) -> tuple[Axis, ...]:
    """Return the coordinates along x, y and z: those of the data where all fields agree, else those of the world."""
    own = {one.quantity.axes for one in image.recipe.fields}
    axes = own.pop() if len(own) == 1 else ()
    world = (Axis(name, _length_unit(image) or WORLD) for name, _ in _AXES)
    return tuple(one if one.name else other for one, other in zip(axes or [Axis()] * 3, world, strict=True))


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
            axis = Axis(f"distance {word} from the middle", _length_unit(image) or WORLD)
            middle, sign = beside, 1.0
        edges += [axis.coordinate(middle - 0.5 * sign * length), axis.coordinate(middle + 0.5 * sign * length)]
        shown.append(axis)
    labels = [one.label for one in shown]
    if camera.kind == "perspective":
        labels[0] += ", at the depth of the target"
    if text := plane_text(image):
        labels[0] += f"\n{text}"
    left, to_right, bottom, top = edges
    across, upwards = (one._replace(unit="") if one.unit == WORLD else one for one in shown)
    oblique = all("distance" in one for one in labels)
    return PicturePlane((left, to_right, bottom, top), (labels[0], labels[1]), (across, upwards), oblique)


def plane_text(image: Image) -> str:
    """Return where the slice planes at right angles to the axes are, in their coordinates; "" without any."""
    if image.is_scalar:
        return ""
    axes, places = _axes_of(image), []
    for plane in image.recipe.options["slice_planes"]:
        along = np.flatnonzero(plane.normal)
        if len(along) == 1:
            axis = axes[along[0]]
            unit = f" {axis.unit}" if axis.unit not in ("", WORLD) else ""
            places.append(f"{axis.name} = {axis.coordinate(plane.offset / plane.normal[along[0]]):.4g}{unit}")
    return f"plane{'s' * (len(places) > 1)} at {', '.join(places)}" if places else ""


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


def _labelled(image: Image, asked: Mapping[str, Any], options: Mapping[str, Any]) -> list[tuple[ColorBar, str, bool]]:
    """Return the colour bars of a picture that are wanted, with their labels, and whether these may hold TeX."""
    if not options["colorbar"]:
        return []
    bars, given = color_bars(image), options["label"]
    if not bars and asked.get("colorbar"):
        warn(option_ref("colorbar", "true") + " changes nothing: the samples are colours, of which there is no bar")
    if given is None:
        return [(bar, bar.label, False) for bar in bars]
    if len(given) != len(bars):
        wanted = f"{len(bars)}, one for each colour bar"
        raise complain(unusable("label"), f"{len(given)} texts", wanted, option="label")
    return [(bar, label, True) for bar, label in zip(bars, given, strict=True)]


def _title(image: Image, options: Mapping[str, Any]) -> str:
    """Return the text above a picture: the one that was given, else the time of its data; "" for none."""
    given: str | None = options["title"]
    return time_of(one.quantity for one in image.recipe.fields) if given is None else given


def to_axes(image: Image, ax: Any, given: Mapping[str, Any]) -> Any:
    """Show a picture in axes; see `Image.to_axes`."""
    require_matplotlib()
    options = checked("Image.to_axes", given, AxesOptions)
    if ax is not None and not isinstance(ax, module_of("axes").Axes):
        wanted = "axes of matplotlib, or None for a new figure"
        raise complain(unusable("Image.to_axes: ax"), f"{type(ax).__name__}, {shown(ax)}", wanted)
    bars = _labelled(image, given, options)
    own = ax is None
    if own:
        _, ax = module_of("pyplot").subplots(layout="constrained")
    plane = picture_plane(image)
    left, right, bottom, top = plane.extent
    width, height = image.size
    # Pixels are squares, also where a step along one axis is as long as another one along the other.
    square = "equal" if plane.oblique else abs((right - left) / width / ((top - bottom) / height))
    ax.imshow(np.asarray(image), extent=plane.extent, aspect=square)
    place = ax.get_position(original=True).transformed(ax.figure.transSubfigure)
    across, upwards = (72.0 * length / ax.figure.dpi for length in (place.width, place.height))
    ax.set_xlabel(plane.labels[0])
    ax.set_ylabel(plane.labels[1])
    _letter(ax.xaxis.label, across, options)
    _letter(ax.yaxis.label, upwards, options)
    _letter_numbers(ax, options)
    if title := _title(image, options):
        _letter(ax.set_title(title), across, options, math=options["title"] is not None)
    drawn = []
    for bar, label, may_be_math in bars:
        made = draw_bar(ax, bar)
        drawn.append((made, bar))
        made.set_label(label)
        _letter(made.ax.yaxis.label, upwards, options, math=may_be_math)
        _letter_numbers(made.ax, options)
        _letter_names(made, bar, min(upwards, across * height / width))
    if own:
        # Of axes whose pixels are squares, the layout finds its places in steps, one at each drawing.
        ax.figure.draw_without_rendering()
        for made, bar in drawn:
            _letter_names(made, bar, 72.0 * made.ax.get_window_extent().height / ax.figure.dpi)
    return ax


def _letter(text: Any, most: float, options: Mapping[str, Any], *, math: bool = False) -> None:
    """Give a text its font, and lines of at most so many points; with `math` parts of it may be TeX."""
    if options["font"] is not None:
        text.set_fontfamily(options["font"])
    if options["font_size"] is not None:
        text.set_fontsize(options["font_size"])
    font = text.get_fontproperties()
    shortest = _SHORTEST_LINE * _WIDTH_OF_LETTER * font.get_size_in_points()
    text.set_text(wrapped(text.get_text(), max(most, shortest), font, math=math))
    if not math:
        text.set(**_AS_IT_IS)


def _letter_numbers(axes: Any, options: Mapping[str, Any]) -> None:
    """Give the numbers at axes their font."""
    known = {"labelfontfamily": options["font"], "labelsize": options["font_size"]}
    axes.tick_params(which="both", **{name: value for name, value in known.items() if value is not None})
    for axis in (axes.xaxis, axes.yaxis):
        _letter(axis.get_offset_text(), math.inf, options, math=True)


def _letter_names(made: Any, bar: ColorBar, most: float) -> None:
    """Put names of labels beside a bar of so many points: as many as have room, from the top, in lines."""
    if not bar.names:
        return
    font = made.ax.yaxis.get_major_ticks()[0].label2.get_fontproperties()
    size = font.get_size_in_points()
    step = math.ceil(len(bar.names) * _LINE * size / most)
    lines = max(int(step * most / len(bar.names) / (_LINE * size)), 1)
    named = []
    for place, name in bar.names[::-1][::step]:
        text = wrapped(name[:_NAME_LETTERS], _NAME_LINE * _WIDTH_OF_LETTER * size, font, math=False)
        parts = [one for one in text.split("\n") if one]
        cut = len(parts) > lines or len(name) > _NAME_LETTERS
        named.append((place, "\n".join(parts[:lines]) + ("…" if cut else "")))
    named.reverse()
    made.set_ticks([place for place, _ in named], labels=[name for _, name in named])
    made.ax.tick_params(length=0.0)
    for tick in made.ax.yaxis.get_major_ticks():
        tick.label2.set(**_AS_IT_IS)


def annotated(image: Image, given: Mapping[str, Any]) -> PillowImage:
    """Return a figure of a picture; see `Image.annotated`."""
    from PIL import Image as Pillow

    stream = io.BytesIO()
    with _figure("Image.annotated", image, given) as save:
        save(stream, format="png")
    with Pillow.open(stream) as drawn:
        return drawn.convert("RGB")


def save_figure(image: Image, path: Path, given: Mapping[str, Any]) -> None:
    """Write a figure of a picture; see `Image.save_figure`."""
    import sheetsplat.io.pictures as pictures

    suffix = pictures.check_suffix(path, pictures.FIGURES)
    with _figure("Image.save_figure", image, given) as save, pictures.whole_file(path) as made:
        if suffix in pictures.VECTORS:
            # Equal figures are equal files.
            save(made, format=suffix[1:], metadata={"CreationDate" if suffix == ".pdf" else "Date": None})
            return
        stream = io.BytesIO()
        save(stream, format="png")
        from PIL import Image as Pillow

        with Pillow.open(stream) as drawn:
            dpi = drawn.info["dpi"]
            pictures.save_raster(np.asarray(drawn.convert("RGB")), made, dpi=dpi)


@contextlib.contextmanager
def _figure(function: str, image: Image, given: Mapping[str, Any]) -> Iterator[Any]:
    """Yield a function that saves a figure of a picture, cut to what is drawn; its arguments are those of `savefig`."""
    require_matplotlib()
    options = checked(function, given, FigureOptions)
    bars = _labelled(image, given, options)
    width, height = image.size
    dpi = options["dpi"]
    # Pixels that letters are high: about a thirtieth of the picture, as long as it can be read.
    pixel = min(max(height / 36.0, 11.0), 40.0) if options["font_size"] is None else options["font_size"] * dpi / 72.0
    inside = min(pixel, max(_INSIDE * min(width, height), _LEAST_LETTER))
    point = 72.0 / dpi
    style = {"font.size": pixel * point, "text.color": _INK, "axes.labelcolor": _INK, "svg.hashsalt": "sheetsplat"}
    # Text of files of vectors stays text.
    style |= {"svg.fonttype": "none", "pdf.fonttype": 42}
    if options["font"] is not None:
        style["font.family"] = options["font"]
    # Not pyplot, which would change the global state of a program with windows of its own.
    figure = module_of("figure").Figure([edge / dpi for edge in image.size], dpi=dpi, facecolor="white", layout="none")
    canvas = module_of("backends.backend_agg").FigureCanvasAgg(figure)
    with importlib.import_module("matplotlib").rc_context(style):
        frame = _axes_at(figure, 0, 0, width, height)
        shown = pixels.over(np.asarray(image, np.uint8), pixels.WHITE)
        plane = picture_plane(image)
        frame.imshow(shown, extent=plane.extent, aspect="auto", interpolation="nearest")
        if options["axes"]:
            _letter(frame.set_xlabel(plane.labels[0]), width * point, options)
            _letter(frame.set_ylabel(plane.labels[1]), height * point, options)
            # Few numbers, where more would run into each other.
            frame.locator_params(axis="x", nbins=_ticks(width, pixel))
            frame.locator_params(axis="y", nbins=_ticks(height, pixel))
        else:
            frame.set_axis_off()
        left = width + pixel
        for bar, label, may_be_math in bars:
            made = draw_bar(
                frame, bar, into=_axes_at(figure, left, 0, _BAR * pixel, height), most=_ticks(height, pixel)
            )
            made.set_label(label)
            _letter(made.ax.yaxis.label, height * point, options, math=may_be_math)
            _letter_names(made, bar, height * point)
            # The next one follows the numbers and the label, whose widths depend on the data.
            left = made.ax.get_tightbbox(canvas.get_renderer()).x1 + pixel
        if title := _title(image, options):
            _letter(frame.set_title(title), left * point, options, math=options["title"] is not None)
        over = _axes_at(figure, 0, 0, width, height)
        over.set_axis_off()
        over.set(xlim=(0, width), ylim=(0, height))
        if options["axes"] and plane.oblique:
            _draw_directions(over, image, inside)
        if options["scale_bar"]:
            _draw_scale_bar(over, image, inside)
        canvas.draw()
        box = figure.get_tightbbox(canvas.get_renderer())
        # Whole pixels, so that those of the picture are not scaled.
        ends = [math.floor(end * dpi - 0.5 * pixel) for end in (box.x0, box.y0)]
        ends += [math.ceil(end * dpi + 0.5 * pixel) for end in (box.x1, box.y1)]
        cut = module_of("transforms").Bbox.from_extents(*(end / dpi for end in ends))
        yield lambda stream, **how: figure.savefig(stream, dpi=dpi, bbox_inches=cut, **how)


def _ticks(length: float, pixel: float) -> int:
    """Return how many numbers may stand at a side of so many pixels."""
    return min(max(int(length / (4.0 * pixel)), 2), 9)


def _axes_at(figure: Any, left: float, bottom: float, width: float, height: float) -> Any:
    """Return axes at a place in pixels."""
    wide, high = figure.get_size_inches() * figure.dpi
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
            linewidth=thick * pixel * 72.0 / axes.figure.dpi,
            solid_capstyle="butt",
        )
    text = f"{length:g} {_length_unit(image) or WORLD}"
    # A text that is longer than the bar ends where the bar does.
    middle = max(right - 0.5 * max(across, _WIDTH_OF_LETTER * pixel * len(text)), 0.0)
    made = axes.text(
        middle,
        bottom + 0.5 * pixel,
        text,
        ha="center",
        va="bottom",
        color=_INK,
        fontsize=pixel * 72.0 / axes.figure.dpi,
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
                linewidth=thick * pixel * 72.0 / axes.figure.dpi,
                solid_capstyle="round",
            )
        label = axes.text(
            middle + places[n], start + 1.35 * y, names[n], ha="center", va="center", color=color, **_AS_IT_IS
        )
        label.set(fontweight="bold", fontsize=pixel * 72.0 / axes.figure.dpi)
        _outlined(label, pixel)
