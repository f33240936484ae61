"""Pictures as arrays, images of Pillow, axes and figures: colours, units, colour bars."""

from __future__ import annotations

import io
import pickle
import sys
import types

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import LogNorm
from PIL import Image as PillowImage
from PIL import ImageShow

import sheetsplat as ss
from sheetsplat.color_bar import color_bars
from sheetsplat.figure import picture_plane, round_length

matplotlib.use("Agg")

SMALL = {"size": (40, 30), "backend": "reference", "quality": "draft"}


@pytest.fixture(scope="module")
def field(ball):
    return ss.RegularField(ball, spacing=(2, 2, 2)).with_quantity("density", "g/cm³", "mm")


@pytest.fixture(scope="module")
def image(field):
    return ss.render(field, **SMALL)


@pytest.fixture(scope="module")
def xray(field):
    return ss.render(field, mode="xray", cmap="magma", clim=(1, 10), **SMALL)


def straight(rgba):
    alpha = rgba[..., 3:].astype(float)
    colors = np.divide(rgba[..., :3], alpha, out=np.zeros(rgba[..., :3].shape), where=alpha > 0)
    return np.concatenate([colors, alpha], axis=2).clip(0, 1)


def test_an_array_is_what_a_screen_shows(image):
    array = np.asarray(image)
    assert array.shape == (30, 40, 4) and array.dtype == np.float32
    assert np.abs(array - straight(image.rgba)).max() < 1e-6
    # Negative control: premultiplied colours are darker.
    assert np.abs(array - image.rgba).max() > 0.1
    assert array.min() >= 0 and array.max() <= 1
    # Changing it changes nothing in the image.
    before = image.rgba.copy()
    array[:] = 0
    assert np.array_equal(image.rgba, before)


def test_arrays_of_other_types(image):
    straight_colors = np.asarray(image)
    levels = np.asarray(image, dtype=np.uint8)
    assert levels.dtype == np.uint8 and np.abs(levels - straight_colors * 255.0).max() <= 0.5001
    deep = np.asarray(image, np.uint16)
    assert deep.dtype == np.uint16 and np.abs(deep - straight_colors * 65535.0).max() < 0.51
    assert np.asarray(image, dtype=np.float64).dtype == np.float64
    assert np.array_equal(np.asarray(image.to_pil()), levels)
    for kind in (int, bool, np.int8, complex, "U3"):
        with pytest.raises(ss.InvalidInput, match="uint8 or uint16"):
            np.asarray(image, dtype=kind)
    with pytest.raises(ValueError, match="copy"):
        image.__array__(copy=False)


def test_colours_beyond_what_a_screen_has_are_clamped(ball):
    scene = ss.Scene(ss.RegularField(ball), [(0, 5, -1, 0, 0), (1, 5, -1, 0, 1)])
    picture = ss.render(scene, **SMALL)
    assert picture.rgba.max() > 1 and np.asarray(picture)[15, 20, :3].tolist() == [1, 0, 0]


def test_scalars_go_through_their_colormap(xray):
    share = ((xray.scalar - 1) / 9).clip(0, 1)
    expected = ss.TransferFunction.from_colormap("magma", 1.0).at(share)
    assert np.abs(np.asarray(xray)[..., :3] - expected[..., :3]).max() < 1e-3
    assert (np.asarray(xray)[..., 3] == 1).all() and xray.clim == (1, 10)
    assert np.array_equal(xray.pixels, xray.scalar)


@pytest.mark.parametrize("mode", ["xray", "mip"])
def test_scalars_are_gray_unless_asked(ball, mode):
    picture = ss.render(ball, mode=mode, **SMALL)
    array = np.asarray(picture)
    there = ~np.isnan(picture.scalar)
    shares = np.where(there, picture.scalar / np.nanmax(picture.scalar), 0.0)
    assert (array[..., 3] == there).all() and np.abs(array[..., 0] - shares).max() < 1e-6
    assert (array[..., 0] == array[..., 1]).all() and picture.clim == (0, np.nanmax(picture.scalar))


def test_a_logarithmic_scale_spreads_decades(ball):
    picture = ss.render(ball, mode="xray", log_scale=True, clim=(0.01, 10), **SMALL)
    expected = (np.log10(np.maximum(picture.scalar, 0.01)) + 2) / 3
    assert np.abs(np.asarray(picture)[..., 0] - expected.clip(0, 1)).max() < 1e-6
    free = ss.render(ball, mode="xray", log_scale=True, **SMALL)
    low, high = free.clim
    assert 0 < low < high == free.scalar.max() and high / low <= 1e6


@pytest.mark.parametrize("values", ["zero", "negative", "constant"])
@pytest.mark.parametrize("log", [False, True])
def test_scalars_without_a_range_are_pictures(values, log):
    data = {"zero": 0.0, "negative": -3.0, "constant": 7.0}[values] * np.ones((4, 4, 4))
    scene = ss.Scene(ss.RegularField(data), [(0, 1, 1, 1, 0), (1, 1, 1, 1, 1)], mode="xray")
    picture = ss.render(scene.replace(scalar_colors=ss.ScalarColors(log=log)), **SMALL)
    array = np.asarray(picture)
    assert np.isfinite(array).all() and picture.clim[0] < picture.clim[1]


@pytest.mark.parametrize(
    ("options", "option"),
    [
        ({"cmap": "no such map"}, "cmap"),
        ({"clim": (1, 1)}, "clim"),
        ({"clim": (0, 1), "log": True}, "clim"),
        ({"clim": (1, np.nan)}, "clim"),
        ({"log": 1}, "log"),
        ({"cmap": [[0.5, 2.0, 0.1]]}, "cmap"),
    ],
)
def test_unusable_scalar_colors(options, option):
    with pytest.raises(ss.InvalidInput, match=option):
        ss.ScalarColors(**options)


def test_scalar_colors_are_given_once(ball):
    colors = ss.ScalarColors("viridis", (0, 5))
    picture = ss.render(ball, mode="xray", scalar_colors=colors, **SMALL)
    assert picture.clim == (0, 5)
    with pytest.raises(ss.InvalidInput, match="scalar_colors, cmap"):
        ss.render(ball, mode="xray", scalar_colors=colors, cmap="gray", **SMALL)
    one = ss.ScalarColors([[1, 0, 0]])
    assert one == ss.ScalarColors(np.array([[1.0, 0, 0, 1]])) and (one.table == [1, 0, 0, 1]).all()


def letters(figure, column, row, width, height):
    """Return how many pixels of a part of a figure are not white."""
    part = np.asarray(figure.convert("L"), float)[row : row + height, column : column + width]
    return int((part < 250).sum())


@pytest.mark.parametrize("size", [60, 100, 160])
def test_labels_of_small_pictures_do_not_leave_the_figure(field, size):
    picture = ss.render(field, size=size, backend="cpu", quality="draft", background="white")
    figure = picture.annotated(title="A title that is longer than this picture is wide", scale_bar=True)
    width, height = figure.size
    for edge in ((0, 0, width, 2), (0, height - 2, width, 2), (0, 0, 2, height), (width - 2, 0, 2, height)):
        assert letters(figure, *edge) == 0
    # The labels below and on the left have lines of their own: between them the corner is empty.
    assert letters(figure, 0, height - 2 * 11, 2 * 11, 2 * 11) == 0
    assert letters(figure, 0, 0, width, height) > 500


def test_colour_bars_of_one_name_say_whose_they_are(field, ball):
    two = [ss.TransferFunction.from_colormap("gray", 0.5, (0, 1)), ss.TransferFunction.from_colormap("magma", 0.5)]
    plain = ss.RegularField(ball)
    labels = [bar.label for bar in color_bars(ss.render([plain, plain], transfer_function=two, **SMALL))]
    assert labels == ["value of field 0", "value of field 1"]
    labels = [bar.label for bar in color_bars(ss.render([plain, field], transfer_function=two, **SMALL))]
    assert labels == ["value", "density [g/cm³]"]
    scene = ss.Scene([[plain, plain], plain], two)
    assert color_bars(ss.render(scene, **SMALL))[0].label == "value of fields 0 and 1"


def test_volumes_of_colours_have_no_bar(field):
    colors = np.random.default_rng(1).integers(0, 255, (6, 6, 6, 3), np.uint8)
    image = ss.render(colors, size=30)
    assert color_bars(pickle.loads(pickle.dumps(image))) == []
    plain = image.annotated(colorbar=False).size
    with pytest.warns(ss.PictureWarning, match="colorbar=True changes nothing"):
        assert image.annotated(colorbar=True).size == image.annotated().size == plain
    beside = ss.render([field, ss.RegularField(colors)], size=30)
    assert [one.label for one in color_bars(beside)] == [one.label for one in color_bars(ss.render(field, size=30))]
    assert len(color_bars(ss.render(colors, mode="mip", size=30))) == 1


def test_titles_and_axes_that_cannot_be_used(image, field):
    for title in ("$\\frac{$", "$", 5, ["a"]):
        for function in (image.annotated, image.to_axes):
            if title == "$":
                function(title=title)
                continue
            with pytest.raises(ss.InvalidInput, match="title") as told:
                function(title=title)
            assert told.value.option == "title"
    with pytest.raises(ss.InvalidInput, match="axes of matplotlib"):
        image.to_axes(5)
    # Units from a file may hold dollar signs.
    odd = ss.render(field.with_quantity("$\\frac{$", "$", "$\\alpha"), **SMALL)
    assert odd.annotated(scale_bar=True).size > (40, 30)
    odd.to_axes().figure.canvas.draw()
    assert image.annotated(title="$\\alpha^2$").size > (40, 30)


def test_names_are_no_mathematics(field, monkeypatch):
    def parse(*_):
        raise AssertionError("a name was taken for TeX")

    odd = ss.render(field.with_quantity("$\\alpha$", "$x$", "$y$"), **SMALL)
    monkeypatch.setattr("matplotlib.mathtext.MathTextParser.parse", parse)
    assert odd.annotated(scale_bar=True).size > (40, 30)
    axes = odd.to_axes()
    axes.figure.canvas.draw()
    assert "[$y$]" in axes.get_xlabel()


def test_several_surfaces_have_colours_that_are_seen(ball):
    picture = ss.render(ball, mode="isosurface", iso_value=[(0.3, 0.5), (0.8, 1.0)], cmap="gray", **SMALL)
    low, high = picture.clim
    assert 0.15 <= (0.3 - low) / (high - low) <= 0.31 and 0.8 <= (0.8 - low) / (high - low) < 1.0
    # Near the lower end of the range: still no black.
    low, high = ss.render(ball, mode="isosurface", iso_value=[(0.01, 0.5), (0.9, 1.0)], **SMALL).clim
    assert (0.01 - low) / (high - low) == pytest.approx(0.15) and high <= 1.01


def test_files_of_every_format_hold_the_picture(tmp_path, image, xray):
    levels = np.asarray(image, np.uint8)
    for suffix in (".png", ".tif", ".tiff", ".webp", ".TIF"):
        image.save(tmp_path / f"a{suffix}")
        with PillowImage.open(tmp_path / f"a{suffix}") as found:
            assert found.mode == "RGBA" and np.array_equal(np.asarray(found), levels)
    over_white = straight(image.rgba)[..., :3] * image.rgba[..., 3:] + 1 - image.rgba[..., 3:]
    for suffix in (".jpg", ".jpeg"):
        image.save(tmp_path / f"a{suffix}")
        with PillowImage.open(tmp_path / f"a{suffix}") as found:
            assert found.mode == "RGB" and np.abs(np.asarray(found) / 255 - over_white).mean() < 0.02
    xray.save(tmp_path / "x.tif")
    with PillowImage.open(tmp_path / "x.tif") as found:
        assert found.mode == "F" and np.array_equal(np.asarray(found), xray.scalar)
    xray.save(tmp_path / "x.png")
    with PillowImage.open(tmp_path / "x.png") as found:
        assert np.array_equal(np.asarray(found), np.asarray(xray, np.uint8))
    assert not list(tmp_path.glob(".*"))


def test_formats_with_too_few_pixels_leave_nothing(tmp_path):
    wide = ss.render(np.ones((2, 2, 2)), size=(20_000, 1), backend="cpu")
    with pytest.raises(ss.Error, match="cannot be written"):
        wide.save(tmp_path / "a.webp")
    assert list(tmp_path.iterdir()) == []


def test_notebooks_get_what_a_screen_shows(image):
    with PillowImage.open(io.BytesIO(image._repr_png_())) as found:
        assert np.array_equal(np.asarray(found), np.asarray(image, np.uint8))


def test_pictures_are_shown(image, monkeypatch, capfd):
    class Program(ImageShow.Viewer):
        def show_image(self, shown, **options):
            seen.append((np.asarray(shown), options["title"]))
            return 1

    seen: list[object] = []
    monkeypatch.setattr(ImageShow, "_viewers", [Program()])
    monkeypatch.setenv("DISPLAY", ":0")
    assert image.show() is None
    ((shown, title),) = seen
    assert np.array_equal(shown, np.asarray(image, np.uint8)) and title == "sheetsplat"
    monkeypatch.setattr(ImageShow, "_viewers", [])
    with pytest.raises(ss.Unsupported, match="cannot be shown.*save it"):
        image.show()
    monkeypatch.setattr(ImageShow, "_viewers", [Program()])
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(ss.Unsupported, match="no display"):
        image.show()
    # In a notebook, below the cell.
    below: list[object] = []
    notebook = types.SimpleNamespace(
        get_ipython=lambda: types.SimpleNamespace(kernel=1), display=types.SimpleNamespace(display=below.append)
    )
    monkeypatch.setitem(sys.modules, "IPython", notebook)
    image.show()
    assert below == [image] and len(seen) == 1 and capfd.readouterr() == ("", "")


def test_axes_have_units_and_a_colour_bar(image):
    axes = image.to_axes(title="A ball")
    assert axes.get_title() == "A ball" and "[mm]" in axes.get_xlabel() and "[mm]" in axes.get_ylabel()
    left, right, bottom, top = axes.images[0].get_extent()
    assert top - bottom == pytest.approx(image.camera.height)
    assert right - left == pytest.approx(image.camera.height * 40 / 30)
    assert np.array_equal(axes.images[0].get_array(), np.asarray(image))
    (bar,) = [one for one in axes.figure.axes if one is not axes]
    low, high = bar.get_ylim()
    assert (
        bar.get_ylabel() == "density [g/cm³]"
        and high == image.clim[1]
        and low == image.recipe.transfer_functions[0].least
    )
    own = matplotlib.figure.Figure().add_subplot()
    assert image.to_axes(own, colorbar=False) is own and len(own.figure.axes) == 1


@pytest.mark.parametrize("size", [(6, 3), (3, 6)])
@pytest.mark.parametrize("layout", [None, "constrained"])
def test_colour_bars_are_as_high_as_the_picture_and_beside_it(image, size, layout):
    figure = matplotlib.figure.Figure(figsize=size, layout=layout)
    axes = image.to_axes(figure.add_subplot())
    axes.set_aspect(2.0 if size == (3, 6) else 0.5)
    figure.canvas.draw()
    picture, bar = (one.get_window_extent() for one in figure.axes)
    assert bar.y0 == pytest.approx(picture.y0, abs=0.01) and bar.y1 == pytest.approx(picture.y1, abs=0.01)
    assert 0 < bar.x0 - picture.x1 < 0.1 * figure.bbox.width
    # The copy of a figure draws the same.
    assert pickle.loads(pickle.dumps(figure)).axes[1].get_ylabel() == "density [g/cm³]"


def test_colour_bars_are_in_units_of_the_data(field, xray):
    values = 10.0 ** np.random.default_rng(3).uniform(-2, 3, (8, 8, 8))
    logged = ss.RegularField(np.log10(values / 0.01)).with_quantity("pressure", floor=0.01)
    picture = ss.render(logged, clim=(0, 5), **SMALL)
    (bar,) = color_bars(picture)
    assert bar.log and (bar.low, bar.high) == (pytest.approx(0.01), pytest.approx(1000)) and bar.label == "pressure"
    drawn = picture.to_axes().figure.axes[1]
    assert drawn.get_yscale() == "log" and drawn.get_ylim() == pytest.approx((0.01, 1000))
    (bar,) = color_bars(xray)
    assert not bar.log and (bar.low, bar.high) == (1, 10) and bar.label.endswith("[g/cm³ · mm]")
    (bar,) = color_bars(ss.render(field, mode="mip", log_scale=True, clim=(0.1, 1), **SMALL))
    assert bar.log and bar.label == "largest density [g/cm³]"
    drawn = ss.render(field, mode="mip", log_scale=True, **SMALL).to_axes()
    assert isinstance(drawn.figure.axes[1]._colorbar.norm, LogNorm)


def test_a_surface_is_marked_on_the_bar(field):
    picture = ss.render(field, mode="isosurface", iso_value=0.4, cmap="viridis", clim=(0, 1), **SMALL)
    (bar,) = color_bars(picture)
    assert bar.marks == (0.4,)
    lines = picture.to_axes().figure.axes[1].lines
    assert lines and all(list(line.get_ydata()) == [0.4, 0.4] for line in lines)


def test_axes_along_the_world_have_its_coordinates(field):
    front = ss.render(field, direction="-z", up="y", **SMALL)
    plane = picture_plane(front)
    assert plane.labels == ("x [mm]", "y [mm]") and not plane.oblique
    # The middle of the picture is the camera's target, and x grows to the right.
    assert plane.extent[0] + plane.extent[1] == pytest.approx(2 * front.camera.target[0])
    assert plane.extent[0] < plane.extent[1]
    back = picture_plane(ss.render(field, direction="z", up="y", **SMALL))
    assert back.labels[0] == "x [mm]" and back.extent[0] > back.extent[1]
    side = picture_plane(ss.render(field, direction="-x", up="z", **SMALL))
    assert side.labels == ("y [mm]", "z [mm]")
    oblique = picture_plane(ss.render(field, projection="perspective", **SMALL))
    assert oblique.oblique and "at the depth of the target" in oblique.labels[0]


def test_a_bright_spot_is_where_the_axes_say():
    """A kernel at a place is seen at its coordinates, in either projection and direction."""
    place = (1.3, -0.7, 0.4)
    field = ss.EllipsoidField([place], 0.3, values=[1.0])
    far = ss.EllipsoidField([(-4, -4, -4), (4, 4, 4)], 0.01, values=[0.0, 0.0])
    for direction, up, axes in (("-z", "y", (0, 1)), ("z", "y", (0, 1)), ("x", "z", (1, 2)), ("-y", "x", (2, 0))):
        scene = ss.Scene([field, far], [(0, 0, 0, 0, 0), (0.05, 1, 1, 1, 1)], slice_spacing=0.1)
        camera = ss.Camera.fit(scene, direction, up)
        picture = ss.render(scene, camera=camera, size=(90, 90), backend="reference")
        rows, columns = np.nonzero(picture.rgba[..., 3] > 0.1)
        left, right, bottom, top = picture_plane(picture).extent
        x = left + (columns.mean() + 0.5) / 90 * (right - left)
        y = top + (rows.mean() + 0.5) / 90 * (bottom - top)
        assert (x, y) == pytest.approx((place[axes[0]], place[axes[1]]), abs=0.1), direction


@pytest.mark.parametrize("size", [(300, 200), (64, 400)])
def test_a_figure_holds_every_pixel(field, size):
    image = ss.render(field, size=size, backend="cpu")
    figure = image.annotated(scale_bar=False, title="A ball")
    assert figure.mode == "RGB" and figure.width > size[0] and figure.height > size[1]
    # Without axes and bar, and over white: the picture itself is found in the figure, pixel by pixel.
    bare = np.asarray(image.annotated(colorbar=False, axes=False))
    levels = np.asarray(image, np.uint8).astype(float)
    expected = levels[..., :3] * levels[..., 3:] / 255 + 255 - levels[..., 3:]
    windows = np.lib.stride_tricks.sliding_window_view(bare, (size[1], size[0], 3))[:, :, 0]
    least = min(np.abs(window - expected).max() for row in windows for window in row)
    assert least <= 0.51


def test_what_a_figure_adds_can_be_left_out(image):
    bare = image.annotated(colorbar=False, axes=False)
    sizes = {
        "bar": image.annotated(colorbar=True, axes=False).width - bare.width,
        "axes": image.annotated(colorbar=False, axes=True).height - bare.height,
        "title": image.annotated(colorbar=False, axes=False, title="A").height - bare.height,
    }
    assert all(more > 10 for more in sizes.values()), sizes


def test_a_scale_bar_has_its_length(field):
    image = ss.render(field, size=(300, 200), backend="cpu")
    with_bar = np.asarray(image.annotated(colorbar=False, axes=False, scale_bar=True), int)
    without = np.asarray(image.annotated(colorbar=False, axes=False), int)
    assert with_bar.shape == without.shape
    rows = np.nonzero((with_bar != without).any(axis=2))[0]
    columns = [
        np.ptp(np.nonzero((with_bar[row] < 60).all(axis=1))[0]) + 1
        for row in np.unique(rows)
        if (with_bar[row] < 60).all(axis=1).sum() > 20
    ]
    pixel = image.camera.height / 200
    assert max(columns) * pixel == pytest.approx(round_length(0.3 * 300 * pixel), rel=0.05)


@pytest.mark.parametrize(("most", "length"), [(1, 1), (1.99, 1), (2, 2), (4.99, 2), (7, 5), (0.03, 0.02), (9e9, 5e9)])
def test_round_lengths(most, length):
    assert round_length(most) == pytest.approx(length)


def test_without_matplotlib_the_package_says_what_to_install(image, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    for draw in (image.to_axes, image.annotated):
        with pytest.raises(ss.Unsupported, match=r"pip install \"sheetsplat\[plot\]\""):
            draw()


@pytest.mark.parametrize(
    "given",
    [
        *({"name": 3}, {"unit": "m\n"}, {"name": "x" * 201}, {"floor": 0}, {"floor": "1"}, {"length_unit": None}),
        *({"axes": 3}, {"axes": [("x", "m")]}, {"axes": ["xm"] * 3}, {"axes": [("x",)] * 3}, {"axes": [("x", 1)] * 3}),
        *({"axes": [("x", "m", 0)] * 3}, {"axes": [("x", "m", 1, float("inf"))] * 3}),
    ],
)
def test_unusable_quantities(given):
    with pytest.raises(ss.InvalidInput, match=next(iter(given))):
        ss.Quantity(**given)


def test_quantities_leave_the_field_as_it_is(ball):
    field = ss.RegularField(ball)
    named = field.with_quantity("density")
    assert named.native is field.native and named.quantity == ss.Quantity("density") and field.quantity == ss.Quantity()
    assert named.with_quantity(unit="kg").quantity == ss.Quantity("density", "kg")
