"""Texts of figures: labels in lines, fonts and sizes, files whose letters are letters; numbers beside colour bars."""

from __future__ import annotations

import re
import zlib

import matplotlib
import numpy as np
import pytest
from PIL import Image as PillowImage

import sheetsplat as ss
from sheetsplat.color_bar import ColorBar, color_bars, draw_bar

matplotlib.use("Agg")
plt = pytest.importorskip("matplotlib.pyplot")

SMALL = {"size": (120, 90), "backend": "reference", "quality": "draft"}
LONG = (
    "mean number density of all neutral hydrogen in the interstellar medium of the solar neighbourhood, smoothed " * 2
)
UNBROKEN = "a_name_that_a_program_made_of_many_parts_" * 4


@pytest.fixture(scope="module")
def field(ball):
    return ss.RegularField(ball, spacing=(2, 2, 2)).with_quantity("density", "g/cm³", "mm")


@pytest.fixture(scope="module")
def image(field):
    return ss.render(field, **SMALL)


@pytest.fixture(autouse=True)
def no_figure_stays():
    yield
    plt.close("all")


def texts_of(figure):
    """Return the texts of a figure that are drawn, with their boxes in pixels."""
    figure.canvas.draw()
    found = [one for one in figure.findobj(matplotlib.text.Text) if one.get_visible() and one.get_text()]
    return [(one.get_text(), one.get_window_extent()) for one in found]


# Colour bars ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("offset", [0.0, 3.0, -40.0])
def test_bars_begin_at_the_least_value(ball, offset):
    field = ss.RegularField(ball + np.float32(offset))
    least = field.value_range[0]
    picture = ss.render(field, **SMALL)
    (bar,) = color_bars(picture)
    assert bar.low == least < picture.clim[0] and bar.high == picture.clim[1]
    # What is below the limits is not seen, and its colour is the first one.
    below = np.linspace(bar.low, bar.high, len(bar.colors)) < picture.clim[0]
    assert below.any() and not bar.opacities[below].any() and bar.opacities.max() == 1
    assert np.ptp(bar.colors[below], axis=0).max() == 0
    (surface,) = color_bars(
        ss.render(field, mode="isosurface", iso_value=[(offset + 0.01, 0.5), (offset + 0.8, 1)], **SMALL)
    )
    assert surface.low == pytest.approx(least) and surface.opacities is None and len(surface.marks) == 2
    # Limits that were given are those of the bar.
    (given,) = color_bars(ss.render(field, clim=(offset + 0.2, offset + 0.9), **SMALL))
    assert (given.low, given.high) == (offset + 0.2, offset + 0.9)
    assert picture.recipe.transfer_functions[0] == ss.TransferFunction(picture.recipe.transfer_functions[0].points)


def test_bars_of_numbers_begin_at_the_least_one(ball):
    picture = ss.render(ss.RegularField(ball + 0.5), mode="mip", cmap="viridis", **SMALL)
    (bar,) = color_bars(picture)
    assert picture.clim[0] == 0 < bar.low == np.nanmin(picture.scalar) and bar.high == picture.clim[1]
    # The colours beside the values are those of the picture.
    row, column = np.unravel_index(np.nanargmin(picture.scalar), picture.scalar.shape)
    assert np.asarray(picture)[row, column, :3] == pytest.approx(bar.colors[0, :3], abs=1e-6)


def test_values_far_below_all_others_do_not_begin_a_bar(ball):
    look = ss.render(ball, **SMALL).recipe.transfer_functions[0]
    (first, last), scene = (look.v_min, look.v_max), ss.Scene(ss.RegularField(ball), look.with_least(-1000.0))
    (bar,) = color_bars(ss.Renderer("reference").render(scene, ss.Camera.fit(scene), (8, 8)))
    assert (bar.low, bar.high) == (first, last)


def test_transparent_colours_stand_over_a_checkerboard(image):
    axes = image.to_axes()
    (halves,) = [one for one in axes.figure.axes[1].collections if np.ndim(one.get_array()) == 3]
    shown, (bar,) = halves.get_array(), color_bars(image)
    assert set(np.unique(shown[bar.opacities == 0])) == {0.75, 1.0}
    assert np.allclose(shown[-1], bar.colors[-1, :3])
    drawn = np.asarray(image.annotated(axes=False), int)
    assert ((drawn == 191).all(axis=2).sum(axis=0) > 3).any()


@pytest.mark.parametrize(
    "ends", [(3.1, 3.9), (20, 80), (2, 150), (1.0001, 1.0002), (0.013, 0.021), (1, 10), (7e-9, 6e-8), (1, 1e6)]
)
def test_logarithmic_bars_have_numbers(ends):
    figure, axes = plt.subplots(layout="constrained")
    axes.imshow(np.zeros((4, 4)))
    made = draw_bar(axes, ColorBar(np.ones((256, 4)), *ends, True, "x"))
    figure.canvas.draw()
    ticks = [*made.ax.yaxis.get_major_ticks(), *made.ax.yaxis.get_minor_ticks()]
    named = [one.get_loc() for one in ticks if one.label2.get_text() and ends[0] <= one.get_loc() <= ends[1] * 1.0001]
    assert 3 <= len(named) <= 10 and made.ax.get_yscale() == "log"
    boxes = sorted(one.label2.get_window_extent().bounds[1] for one in ticks if one.get_loc() in named)
    assert np.diff(boxes).min() > 8


# Lines ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [LONG[:200], UNBROKEN, "density"])
@pytest.mark.parametrize("unit", ["g/cm³", "erg s⁻¹ cm⁻² Å⁻¹ arcsec⁻² " * 7])
def test_labels_stay_in_the_figure(field, name, unit):
    picture = ss.render(field.with_quantity(name, unit, unit), projection="perspective", **SMALL)
    axes = picture.to_axes(title=LONG)
    (width, height), found = axes.figure.canvas.get_width_height(), texts_of(axes.figure)
    assert len(found) > 8
    for text, box in found:
        assert 0 <= box.x0 < box.x1 <= width and 0 <= box.y0 < box.y1 <= height, text
    figure = np.asarray(picture.annotated(title=LONG).convert("L"))
    edges = (figure[:2], figure[-2:], figure[:, :2], figure[:, -2:])
    assert all((edge == 255).all() for edge in edges)
    # Every letter is drawn, in lines.
    assert "".join(axes.figure.axes[1].get_ylabel().split()) == "".join(f"{name}[{unit}]".split())


def test_one_word_more_begins_a_line(image):
    axes = image.to_axes(title="$\\alpha + \\frac{1}{2}$ of a ball " * 6)
    lines = axes.get_title().split("\n")
    assert len(lines) > 1 and all(line.count("$") % 2 == 0 for line in lines)
    axes.figure.canvas.draw()
    assert image.to_axes(title="one\ntwo").get_title() == "one\ntwo"


# Fonts and sizes -----------------------------------------------------------------------------------------------------


def test_labels_fonts_and_sizes_in_axes(image):
    axes = image.to_axes(title="A", label="$\\rho$ of it", font="dejavu serif", font_size=7)
    bar = axes.figure.axes[1]
    bar.figure.canvas.draw()
    texts = [axes.title, axes.xaxis.label, axes.yaxis.label, bar.yaxis.label]
    texts += [tick.label1 for tick in axes.get_xticklabels() and axes.xaxis.get_major_ticks()]
    texts += [tick.label2 for tick in bar.yaxis.get_major_ticks()]
    assert all(one.get_fontfamily() == ["DejaVu Serif"] and one.get_fontsize() == 7 for one in texts)
    assert bar.get_ylabel() == "$\\rho$ of it"


def test_sizes_of_figures_are_in_points(image):
    heights = []
    for size, dpi in ((6, 100), (12, 100), (6, 200)):
        figure = image.annotated(colorbar=False, axes=False, title="H" * 4, font_size=size, dpi=dpi)
        # The letters are dark, and above all that is coloured.
        dark = (np.asarray(figure.convert("L"))[:-90] < 128).any(axis=1)
        heights.append(int(dark.sum()))
    assert heights[1] == pytest.approx(2 * heights[0], abs=2) == pytest.approx(heights[2], abs=4)
    serif, sans = (
        np.asarray(image.annotated(font=font).convert("L"), float) for font in ("DejaVu Serif", "DejaVu Sans")
    )
    assert serif.shape != sans.shape or np.abs(serif - sans).max() > 100


@pytest.mark.parametrize(
    "given",
    [
        *({"font": "no such font"}, {"font": 3}, {"font_size": 0}, {"font_size": "big"}, {"font_size": 1e9}),
        *(
            {"label": 3},
            {"label": ["a", "b"]},
            {"label": "$\\frac{$"},
            {"title": "a" * 1001},
            {"dpi": -1},
            {"dpi": np.nan},
        ),
        *({"colorbar": 2}, {"axes": "no"}),
    ],
)
def test_unusable_options_of_figures(image, tmp_path, given):
    (name,) = given
    functions = [image.annotated, lambda **options: image.save_figure(tmp_path / "a.pdf", **options)]
    for function in functions + [image.to_axes] * (name not in ("dpi", "axes")):
        with pytest.raises(ss.InvalidInput) as told:
            function(**given)
        assert told.value.option == name
    with pytest.raises(TypeError, match="font_size"):
        image.annotated(fontsize=3)
    assert not list(tmp_path.iterdir())


# Files ---------------------------------------------------------------------------------------------------------------


def pdf_text(data):
    """Return the letters that a PDF draws: those between brackets in its streams."""
    parts = []
    for stream in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", data, re.DOTALL):
        try:
            parts += re.findall(rb"\(((?:\\.|[^()\\])*)\)", zlib.decompress(stream))
        except zlib.error:
            continue
    return b"".join(parts).replace(b"\0", b"").decode("latin-1")


def test_letters_of_files_are_letters(tmp_path, field, image):
    for path in (tmp_path / "a.svg", tmp_path / "a.pdf", tmp_path / "b.svg", tmp_path / "b.pdf"):
        image.save_figure(path, title="A ball", font="DejaVu Serif", font_size=8, dpi=300)
    svg, pdf = (tmp_path / "a.svg").read_text(encoding="utf-8"), (tmp_path / "a.pdf").read_bytes()
    assert ">A ball<" in svg and ">[g/cm³]<" in svg and "DejaVu Serif" in svg and "<image" in svg
    assert "A ball" in pdf_text(pdf) and "[g/cm" in pdf_text(pdf)
    assert b"/FontFile2" in pdf and b"/Type3" not in pdf
    assert (tmp_path / "b.svg").read_bytes() == svg.encode() and (tmp_path / "b.pdf").read_bytes() == pdf
    # The size on paper: 120 pixels at 300 in an inch are 28.8 points, with half a letter on either side.
    image.save_figure(tmp_path / "c.svg", axes=False, colorbar=False, font_size=8, dpi=300)
    width = float(re.search(r'width="([\d.]+)pt"', (tmp_path / "c.svg").read_text(encoding="utf-8"))[1])
    assert width == pytest.approx(28.8 + 8, abs=0.5)


def test_figures_in_pixels_are_files(tmp_path, image):
    drawn = image.annotated(title="A", dpi=200)
    for suffix in (".png", ".tif", ".webp"):
        image.save_figure(tmp_path / f"a{suffix}", title="A", dpi=200)
        with PillowImage.open(tmp_path / f"a{suffix}") as found:
            assert np.array_equal(np.asarray(found.convert("RGB")), np.asarray(drawn))
            assert suffix == ".webp" or found.info["dpi"] == pytest.approx((200, 200), abs=0.1)
    with pytest.raises(ss.InvalidInput, match=r"\.svg"):
        image.save_figure(tmp_path / "a.eps")
    with pytest.raises(ss.InvalidInput, match="figure cannot be saved"):
        image.save_figure(3)
    assert sorted(one.suffix for one in tmp_path.iterdir()) == [".png", ".tif", ".webp"]
