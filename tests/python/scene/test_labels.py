"""Labels: the law by plain sums in NumPy, all backends, colours that are there alone, borders, picks, bad input."""

from __future__ import annotations

import math
import pickle
import warnings

import numpy as np
import pytest
from labelled_volumes import COLORS, LIGHT, OPAQUE, things, view

import sheetsplat as ss
from sheetsplat.color_bar import color_bars
from sheetsplat.describe.recipe import Recipe
from sheetsplat.fields.labelled import look_like_labels


def weights(values, label, points, radius=2.0, falloff=5.0):
    """Return W of a label at points (M, 3): its samples, mirrored at the outermost ones, by brute force."""
    folded = np.pad(values, 4, mode="reflect")
    at = np.argwhere(folded == label)[:, ::-1] - 4.0
    total = np.zeros(len(points))
    edge = math.exp(-falloff)
    for place in at:
        r2 = ((points - place) ** 2).sum(axis=1) / radius**2
        total += np.where(r2 < 1.0, (np.exp(-falloff * r2) - edge) / (1.0 - edge), 0.0)
    # The kernel's mass for each sample's volume, by shells.
    r = (np.arange(200_000) + 0.5) / 200_000
    mass = np.sum(4 * np.pi * r**2 * (np.exp(-falloff * r**2) - edge) / (1.0 - edge)) / 200_000 * radius**3
    return total / mass


def test_the_law_by_plain_sums():
    values = things()
    width, height, spacing, pixel = 9, 7, 0.7, 1.7
    camera = ss.Camera.orthographic((8.0, 7.0, 40.0), (8.0, 7.0, 6.0), up=(0, 1, 0), height=pixel * height)
    scene = ss.Scene(ss.RegularField(values, labels=True), COLORS, slice_spacing=spacing, reference_length=1.3,
                     opacity_stop=1.0)  # fmt: skip
    image = ss.Renderer(backend="reference").render(scene, camera, (width, height))
    x, y = 8.0 + pixel * (np.arange(width) + 0.5 - width / 2), 7.0 - pixel * (np.arange(height) + 0.5 - height / 2)
    expected = np.zeros((height, width, 4))
    shift, stretch = image.plan.first_depth, spacing / 1.3
    for n in range(image.plan.slices):
        z = 40.0 - (shift + n * spacing)
        points = np.stack(np.broadcast_arrays(x[None, :], y[:, None], z), axis=-1).reshape(-1, 3)
        inside = np.all((points >= -0.5) & (points <= np.array(values.shape[::-1]) - 0.5), axis=1)
        known = {label: weights(values, label, points) for label in (0, 1, 2, 3)}
        absorbed, color, tau = np.zeros(len(points)), np.zeros((len(points), 3)), np.zeros(len(points))
        for label, (*rgb, opacity) in COLORS.colors.items():
            others = np.max([one for other, one in known.items() if other != label], axis=0)
            shown = (known[label] - others >= 0.0) & inside
            own = -math.log1p(-opacity) * shown
            absorbed, tau = absorbed + stretch * own, tau + own
            color += own[:, None] * np.array(rgb)
        alpha = -np.expm1(-absorbed)
        color /= np.where(tau > 0, tau, 1.0)[:, None]
        left = (1.0 - expected[..., 3]) * alpha.reshape(height, width)
        expected[..., :3] += left[..., None] * color.reshape(height, width, 3)
        expected[..., 3] += left
    assert expected[..., 3].max() > 0.8 and np.ptp(expected[..., 1]) > 0.1
    assert np.abs(image.rgba - expected).max() < 1e-6


WAYS = {
    "plain": {},
    "lit": {"lights": [LIGHT]},
    "surfaces": {"mode": "isosurface"},
    "opaque surfaces": {"mode": "isosurface", "lights": [LIGHT], "colors": OPAQUE},
    "preintegrated": {"preintegration": True, "lights": [LIGHT]},
    "slabs": {"sampling": "slab", "lights": [LIGHT]},
    "analytic": {"gradient": "analytic", "lights": [LIGHT]},
    "zero": {"boundary": "zero"},
    "clipped": {"clip": ss.Clip(planes=[((1, 1, 0), 12.0)]), "lights": [LIGHT], "mode": "isosurface"},
    "bcc": {"lattice": "bcc", "lights": [LIGHT]},
    "depth": {"outputs": ("depth", "coverage"), "colors": OPAQUE},
}


@pytest.mark.parametrize("backend", ["cpu", "gl"])
@pytest.mark.parametrize("way", WAYS)
def test_backends_are_the_reference(way, backend):
    options = dict(WAYS[way])
    lattice = {name: options.pop(name) for name in ("boundary", "lattice") if name in options}
    colors, outputs = options.pop("colors", COLORS), options.pop("outputs", ())
    scene = ss.Scene(ss.RegularField(things(), labels=True, **lattice), colors, slice_spacing=0.43, **options)
    images = [ss.Renderer(one).render(scene, view(fov_y=30), (40, 34), outputs) for one in ("reference", backend)]
    expected, found = (image.rgba.astype(float) for image in images)
    assert expected[..., 3].mean() > 0.05
    assert np.sqrt(np.mean((found - expected) ** 2)) < 1e-4
    if outputs:
        known = np.isfinite(images[0].depth)
        assert np.array_equal(known, np.isfinite(images[1].depth)) and known.any()
        assert np.allclose(images[0].depth[known], images[1].depth[known], atol=1e-3)
        assert np.allclose(images[0].coverage, images[1].coverage, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("options", [{"shadows": True}, {"ambient_occlusion": ss.AmbientOcclusion(3.0)}])
@pytest.mark.parametrize("mode", ["composite", "isosurface"])
def test_light_of_labels(mode, options):
    scene = ss.Scene(
        ss.RegularField(things(), labels=True), COLORS, mode=mode, lights=[LIGHT], slice_spacing=0.4, **options
    )
    pictures = {one: ss.Renderer(one).render(scene, view(), (36, 30)) for one in ("reference", "cpu", "gl")}
    dark = np.abs(pictures["reference"].rgba - ss.Renderer("reference").render(
        scene.replace(shadows=False, ambient_occlusion=None), view(), (36, 30)).rgba).max()  # fmt: skip
    assert dark > 0.01
    for one in ("cpu", "gl"):
        effects = {effect.name: effect.error for effect in pictures[one].plan.effects if effect.on}
        stated = effects["shadows" if "shadows" in options else "ambient_occlusion"]
        assert stated < 6e-3
        assert np.sqrt(np.mean((pictures[one].rgba - pictures["reference"].rgba) ** 2)) <= stated


@pytest.mark.parametrize("mode", ["composite", "isosurface"])
def test_no_pixel_has_the_colour_of_a_label_that_is_not_there(mode):
    """Between 1 and 3 lies 2 as a number, and nothing as a thing."""
    values = np.where(things() == 2, 0, things())
    colors = ss.LabelColors({1: (1, 0, 0), 2: (0, 1, 0), 3: (0, 0, 1)})
    image = ss.render(
        ss.RegularField(values, labels=True), transfer_function=colors, mode=mode, shading=False, size=120
    )
    assert image.rgba[..., 1].max() == 0.0
    assert (image.rgba[..., 0] > 0.9).sum() > 100 and (image.rgba[..., 2] > 0.9).sum() > 100
    # As values they are summed: on the way to 3 lie all others, and 1 hides it.
    function = ss.TransferFunction(colors.points)
    summed = ss.render(values, transfer_function=function, mode="composite", shading=False, size=120)
    assert summed.rgba[..., 2].max() == 0.0


def test_borders_lie_where_they_are():
    """Within half a voxel of the analytic one, for 95 of 100 pixels."""
    k, j, i = np.mgrid[0:32, 0:32, 0:32]
    radius = 11.4
    values = ((k - 15.5) ** 2 + (j - 15.5) ** 2 + (i - 15.5) ** 2 < radius**2).astype(np.uint8) * 5
    field = ss.RegularField(values, labels=True)
    camera = ss.Camera.orthographic((15.5, 15.5, 60.0), (15.5, 15.5, 15.5), up=(0, 1, 0), height=28.0)
    scene = ss.Scene(field, ss.LabelColors({5: "red"}), mode="isosurface", slice_spacing=0.5)
    image = ss.Renderer(backend="cpu").render(scene, camera, (80, 80), ("depth",))
    x = 28.0 * (np.arange(80) + 0.5 - 40) / 80
    r2 = x[None, :] ** 2 + x[:, None] ** 2
    seen = r2 < (radius - 1.5) ** 2
    true = 60.0 - (15.5 + np.sqrt(np.where(seen, radius**2 - r2, 0.0)))
    # Along the normal of the sphere.
    off = np.abs(image.depth - true)[seen] * np.sqrt(1.0 - r2[seen] / radius**2)
    assert np.percentile(off, 95) < 0.5


def test_labels_in_a_volume():
    """Labels are a group of their own beside a volume, and a label that is not shown hides nothing."""
    labels = ss.RegularField(things(), labels=True)
    volume = ss.RegularField(np.random.default_rng(1).random(things().shape) * 0.1)
    both = ss.render([volume, labels], size=60)
    assert len(both.recipe.groups) == 2 and not np.allclose(both.rgba, ss.render(volume, size=60).rgba)
    nothing = ss.Scene(labels, ss.LabelColors({}))
    assert not ss.Renderer(backend="cpu").render(nothing, view(), (30, 30)).rgba.any()
    alone = ss.Scene(labels, ss.LabelColors({7: "red"}))
    assert not ss.Renderer(backend="cpu").render(alone, view(), (30, 30)).rgba.any()


@pytest.mark.parametrize("mode", ["composite", "isosurface"])
def test_picks_tell_label_and_name(mode):
    names = {1: "left", 3: "right"}
    colors = ss.LabelColors({1: "red", 2: "green", 3: "blue"}, names=names)
    image = ss.render(ss.RegularField(things(), labels=True), transfer_function=colors, mode=mode, size=90,
                      shading=False)  # fmt: skip
    seen = {}
    for label, channel in ((1, 0), (2, 1), (3, 2)):
        strong = image.rgba[..., channel] * (image.rgba[..., 3] > 0.99)
        row, column = np.unravel_index(strong.argmax(), strong.shape)
        found = image.pick(int(column), int(row))
        assert found is not None and found.label == label and found.value == label
        seen[label] = found.name
        k, j, i = (round(one) for one in found.position[::-1])
        assert label in things()[max(k - 1, 0) : k + 2, max(j - 1, 0) : j + 2, max(i - 1, 0) : i + 2]
    assert seen == {1: "left", 2: "label 2", 3: "right"}
    assert image.pick(0, 0) is None


def test_labels_are_found_where_they_look_like_that(tmp_path):
    assert look_like_labels(things()) and look_like_labels(things().astype(np.float32))
    k, j, i = np.mgrid[0:40, 0:40, 0:40]
    r = np.sqrt((k - 20.0) ** 2 + (j - 20.0) ** 2 + (i - 20.0) ** 2)
    rng = np.random.default_rng(2)
    for other in (
        things() > 0,
        np.round(r / 4),
        rng.poisson(3.0, r.shape),
        r,
        np.round(100 * r),
        np.full((4, 4, 4), 3),
    ):
        assert not look_like_labels(np.asarray(other).astype(np.float32))
    np.save(tmp_path / "a.npy", things())
    for data in (things(), tmp_path / "a.npy"):
        image = ss.render(data, size=40)
        assert image.recipe.fields[0].options["labels"] is True
        assert "samples name things" in image.plan.quality.of("labels").reason
    assert ss.open(tmp_path / "a.npy").labels and not ss.open(tmp_path / "a.npy", labels=False).labels
    # Whoever asks for values has them.
    for asked in ({"labels": False}, {"mode": "mip"}, {"cmap": "magma"}, {"clim": (0, 3)}, {"iso_value": 0.5}):
        shown = ss.render(things(), size=20, **{**asked, **({"mode": "isosurface"} if "iso_value" in asked else {})})
        assert not shown.recipe.fields[0].options["labels"]
    assert not ss.RegularField(things()).labels
    for options, words in (
        ({"cmap": "magma"}, "cmap changes"),
        ({"cmap": "magma", "opacity": 0.1}, "cmap, opacity change"),
    ):
        with pytest.warns(ss.PictureWarning, match=words + " nothing in a picture of labels"):
            ss.render(ss.RegularField(things(), labels=True), size=10, **options)


def test_label_colors():
    colors = ss.LabelColors({3: "red", np.int16(-1): ((0.0, 1.0, 0.0)[0], 1, 0, 0.25)}, names={3: "a"}, background=2)
    assert list(colors.colors) == [-1, 3] and colors.colors[3] == (1.0, 0.0, 0.0, 1.0)
    assert colors.at([-1, -0.5, 3]).tolist() == [[0, 1, 0, 0.25], [0, 1, 0, 0], [1, 0, 0, 1]]
    assert pickle.loads(pickle.dumps(colors)) == colors and colors != ss.LabelColors({3: "red"})
    assert colors.name_of(3) == "a" and colors.name_of(9) == "label 9" and "a" in repr(colors)
    assert repr(ss.LabelColors({3: "red"}, {3: "a"})) == "LabelColors(1 label: a)"
    assert repr(ss.LabelColors({})) == "LabelColors(0 labels)"
    many = ss.LabelColors.distinct(range(40))
    assert 0 not in many.colors and len({rgba[:3] for rgba in many.colors.values()}) == 39
    assert many.colors[7] == ss.LabelColors.distinct([7]).colors[7]
    assert ss.LabelColors.of(ss.TransferFunction([(0, 1, 1, 1, 0), (1.5, 1, 0, 0, 0.6)]), [0, 1, 2]).colors.keys() == {
        1,
        2,
    }
    assert ss.LabelColors.of(colors, [5]) is colors
    large = ss.LabelColors({2**40 - 1: "red", -(2**40): "blue"})
    assert large.at([2**40 - 1, 2**40 - 2])[:, 3].tolist() == [1, 0]


BAD = {
    "half labels": (lambda: ss.RegularField(np.full((3, 3, 3), 0.5), labels=True), "whole numbers"),
    "prefilter": (lambda: ss.RegularField(things(), labels=True, prefilter=True), "prefilter=True;"),
    "normalization": (lambda: ss.RegularField(things(), labels=True, normalization="none"), "normalization"),
    "base": (lambda: ss.RegularField(things(), labels=True, base=3.0), "base"),
    "mip": (lambda: ss.render(ss.RegularField(things(), labels=True), mode="mip", size=8), "mode"),
    "sum": (lambda: ss.Scene([ss.RegularField(things(), labels=True)] * 2, COLORS), "group of its own"),
    "thousands": (lambda: ss.render(ss.RegularField(np.arange(1000).reshape(10, 10, 10), labels=True), size=8), "256"),
    "no colour": (lambda: ss.LabelColors({1: (1, 2)}), "red, green, blue"),
    "opacity": (lambda: ss.LabelColors({1: (1, 1, 1, 2)}), "0 to 1"),
    "no label": (lambda: ss.LabelColors({1.5: "red"}), "label"),
    "no text": (lambda: ss.LabelColors({1: "red"}, names={1: 5}), "a name cannot be used: found 5; wanted a text"),
    "no mapping": (lambda: ss.LabelColors([1, 2]), "a mapping such as a dict"),
    "colours to 255": (lambda: ss.LabelColors({1: (255, 0, 0)}), "from 0 to 1"),
    "beyond 41 bits": (lambda: ss.LabelColors({2**40: "red"}), "number them anew"),
    "labels of colours": (lambda: ss.RegularField(np.zeros((3, 3, 3, 3), np.uint8), labels=True), "three axes"),
}


@pytest.mark.parametrize("kind", BAD)
def test_bad_labels_are_refused(kind):
    make, words = BAD[kind]
    with pytest.raises(ss.Error, match=words):
        make()


def test_labels_of_any_kind():
    """Negative ones, large ones, missing ones, one layer, one sample, all the same."""
    for values in (
        np.where(things() > 0, things().astype(np.int16) - 300, 0),
        np.where(things() > 0, things().astype(np.int64) + 2**30, 0),
        np.where(things() == 1, np.nan, things()),
        things()[5:6],
        things()[5:6, 5:6, 5:6],
        np.full((3, 3, 3), 4, np.uint8),
    ):
        field = ss.RegularField(values, labels=True, nan="skip")
        image = ss.render(field, size=30, backend="cpu")
        assert np.isfinite(image.rgba).all() and image.rgba.any()
        assert pickle.loads(pickle.dumps(field)) == field
    turned = ss.RegularField(things(), labels=True, axes=[(0.8, 0.6, 0), (-0.6, 0.8, 0), (0, 0, 1)])
    assert ss.render(turned, size=30).rgba.any()


def test_pictures_say_how_they_were_made(tmp_path):
    colors = ss.LabelColors({1: "red", 2: (0, 1, 0, 0.5), 3: "blue"}, names={2: "box"}, background=0)
    image = ss.render(ss.RegularField(things(), labels=True), transfer_function=colors, size=30, backend="cpu")
    image.save(tmp_path / "a.png")
    recipe = Recipe.read(tmp_path / "a.png")
    assert recipe.transfer_functions == (colors,) and recipe.fields[0].options["labels"] is True
    # Of plain samples, which a file has.
    scene = recipe.scene([ss.RegularField(things())])
    assert np.array_equal(ss.Renderer("cpu").render(scene, recipe.camera, recipe.size).rgba, image.rgba)
    for wrong in ('{"1":[1,1]}', '{"x":[1,1,1,1]}', "[1]"):
        text = recipe.to_json().replace('{"1":[1.0,0.0,0.0,1.0],"2":[0.0,1.0,0.0,0.5],"3":[0.0,0.0,1.0,1.0]}', wrong)
        with pytest.raises(ss.InvalidInput, match="transfer_functions"):
            Recipe.from_json(text)


def test_figures_have_a_legend_of_labels():
    colors = ss.LabelColors({1: "tomato", 2: "seagreen", 3: "royalblue"}, names={1: "left lung", 2: "heart"})
    image = ss.render(ss.RegularField(things(), labels=True), transfer_function=colors, size=60)
    (bar,) = color_bars(image)
    assert [name for _, name in bar.names] == ["label 3", "heart", "left lung"]
    for (place, _), label in zip(bar.names, (3, 2, 1), strict=True):
        assert np.allclose(bar.colors[int(place / bar.high * 256), :3], colors.colors[label][:3])
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    texts = [one.get_text() for one in image.to_axes().figure.axes[-1].get_yticklabels()]
    assert texts == ["label 3", "heart", "left lung"]
    many = ss.LabelColors.distinct(range(1, 120))
    shown = ss.render(ss.RegularField(things(), labels=True), transfer_function=many, size=20)
    assert 20 < len(color_bars(shown)[0].names) <= 40


def test_corners_of_a_cell_outweigh_all_other_kernels():
    """So that a label shows in no cell whose corners are all of another one, and the background is drawn no farther."""
    at = np.stack(np.meshgrid(*3 * [np.linspace(0, 1, 21)], indexing="ij"), axis=-1)
    offsets = np.stack(np.meshgrid(*3 * [np.arange(-2, 4)], indexing="ij"), axis=-1).reshape(-1, 3)
    weights = [np.maximum(0, np.exp(-1.25 * ((at - one) ** 2).sum(axis=-1)) - np.exp(-5)) for one in offsets]
    corners = sum(one for one, offset in zip(weights, offsets, strict=True) if set(offset) <= {0, 1})
    assert ((2 * corners - sum(weights)) / sum(weights)).min() > 0.1


def test_the_background_is_drawn_around_cells_of_labels():
    size, radius = 24, 5
    places = np.stack(np.meshgrid(*3 * [np.arange(size)], indexing="ij"), axis=-1)
    ball = ((places - size // 2) ** 2).sum(axis=-1) <= radius**2
    near = np.zeros(ball.shape, bool)
    for offset in np.stack(np.meshgrid(*3 * [np.arange(-4, 5)], indexing="ij"), axis=-1).reshape(-1, 3):
        # From the box of all cells around a sample of the label on.
        if (np.maximum(np.abs(offset) - 1, 0) ** 2).sum() < 4:
            near |= np.roll(ball, tuple(offset), axis=(0, 1, 2))
    field = ss.RegularField(ball.astype(np.uint8), labels=True)
    scene = ss.Scene(field, ss.LabelColors({1: (1, 0, 0)}), slice_spacing=1.0)
    camera = ss.Camera.fit(field, direction=(1, 0.7, 0.3))
    pictures = [ss.Renderer(one).render(scene, camera, (40, 40)) for one in ("reference", "cpu")]
    assert pictures[1].stats["kernels_visible"] == near.sum()
    assert np.abs(pictures[0].rgba - pictures[1].rgba).max() < 2e-5 < pictures[0].rgba.max()
    # Where a third label is no more shown than the background, two of them may share a cell's corners.
    parted = np.where(ball, 1, np.where(places[..., 0] < size // 2, 0, 2)).astype(np.uint8)
    two = ss.Scene(ss.RegularField(parted, labels=True), ss.LabelColors({1: (1, 0, 0)}), slice_spacing=1.0)
    pictures = [ss.Renderer(one).render(two, camera, (40, 40)) for one in ("reference", "cpu")]
    assert pictures[1].stats["kernels_visible"] > near.sum()
    assert np.abs(pictures[0].rgba - pictures[1].rgba).max() < 2e-5


@pytest.mark.parametrize("count", [3, 40, 90])
@pytest.mark.parametrize("how", ["annotated", "axes"])
def test_names_of_labels_in_figures_are_text_that_fits(count, how, monkeypatch):
    """As many as have room, from the top, in lines; what looks like TeX stays as it is, also what no TeX can be."""
    drawing = pytest.importorskip("matplotlib.figure")
    pyplot = pytest.importorskip("matplotlib.pyplot")
    values = np.zeros((3, 3, 3 * count), np.uint8)
    for label in range(1, count + 1):
        values[:, :, 3 * label - 3 : 3 * label] = label
    names = {1: r"$\foo$ of $x$", 2: "a long name of a thing " * 20, 3: "w" * 400}
    field = ss.RegularField(values, labels=True).with_label_colors(ss.LabelColors({}, names))
    image = ss.render(field, size=(200, 150), backend="cpu")
    if how == "axes":
        figure = image.to_axes().figure
        figure.canvas.draw()
    else:
        figures, make = [], drawing.Figure
        monkeypatch.setattr(drawing, "Figure", lambda *one, **more: figures.append(make(*one, **more)) or figures[0])
        assert image.annotated().width < 500
        figure = figures[0]
    bar = figure.axes[1]
    texts = [tick.label2 for tick in bar.yaxis.get_major_ticks()][::-1]
    boxes = [text.get_window_extent() for text in texts]
    assert texts[0].get_text() == r"$\foo$ of $x$"
    assert len(texts) == count if count == 3 else 5 <= len(texts) < count
    for upper, lower in zip(boxes, boxes[1:], strict=False):
        assert lower.y1 <= upper.y0 + 1
    assert max(one.width for one in boxes) < 30 * texts[0].get_fontsize() * figure.dpi / 72
    pyplot.close("all")


@pytest.mark.parametrize("function", [None, COLORS, ss.TransferFunction([(0.5, 1, 1, 1, 0), (1.5, 1, 1, 1, 1)])])
def test_the_camera_frames_surfaces_of_labels_as_it_does_their_volumes(function):
    """Where nothing is outside of labels, the picture has the same place in both modes; the volume is far larger."""
    values = np.zeros((40, 40, 40), np.uint8)
    values[16:24, 16:24, 14:24], values[16:24, 16:24, 24:28] = 1, 2
    field = ss.RegularField(values, labels=True)
    volume, surfaces = (
        ss.render(field, transfer_function=function, mode=mode, size=40, backend="cpu").camera
        for mode in ("composite", "isosurface")
    )
    assert surfaces.height == pytest.approx(volume.height, rel=0.02)
    assert surfaces.target == pytest.approx(volume.target, abs=0.5) and volume.height < 25


def thin():
    """Return a block, 1, a cross, 2, a plate, 3, a line, 4, a sample, 5, and a line at the volume's edge, 6."""
    values = np.zeros((20, 20, 20), np.uint8)
    values[2:6, 2:6, 2:6], values[10, 12:18, 2:8], values[15, 15, 4:16], values[5, 15, 15], values[0, 0, 8:18] = (
        1, 3, 4, 5, 6,
    )  # fmt: skip
    for axis in range(3):
        values[tuple(slice(9, 12) if one == axis else 10 for one in range(3))] = 2
    return values


@pytest.mark.parametrize(("kind", "missing"), [("u1", 0), ("i8", 0), ("f4", np.nan)])
@pytest.mark.parametrize("mode", ["composite", "isosurface"])
def test_labels_too_thin_to_be_seen_are_told(kind, missing, mode):
    """Those that are told are those of which a picture from near, of each alone, has nothing."""
    values = thin().astype(kind)
    values[values == 0] = missing
    field = ss.RegularField(values, labels=True, nan="skip").with_label_colors(ss.LabelColors({}, {4: "nerve"}))
    told = field.labels_unseen(range(1, 9))
    for label in range(1, 7):
        alone = ss.Scene(field, ss.LabelColors({label: "red"}), mode=mode, slice_spacing=0.3)
        camera = ss.Camera.fit(field, direction=(0.3, 1, 0.4))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ss.PictureWarning)
            seen = ss.Renderer("cpu").render(alone, camera, (160, 160)).rgba.any()
        assert seen == (label not in told), label
    if missing == 0:
        assert told == (4, 5, 6)
        with pytest.warns(ss.PictureWarning, match="labels are not seen: nerve, label 5, label 6: single samples"):
            ss.render(field, mode=mode, size=16)


def test_labels_that_were_too_thin_are_seen_where_samples_are_repeated():
    repeated = thin().repeat(2, 0).repeat(2, 1).repeat(2, 2)
    assert ss.RegularField(repeated, labels=True).labels_unseen(range(1, 7)) == ()


def test_why_a_picture_of_labels_is_empty_is_told():
    values = np.zeros((9, 9, 9), np.uint8)
    values[4, 4, 4] = 7
    away = ss.Clip(planes=[((0, 0, 1), 90)])
    for data, options, words in (
        (values, {}, "picture: label 7: single samples"),
        (things(), {"transfer_function": ss.LabelColors({8: "red"})}, "no label of the data has a colour"),
        (things(), {"clip": away}, "the clip cuts off"),
    ):
        for mode in ("composite", "isosurface"):
            with pytest.warns(ss.PictureWarning, match=words):
                ss.render(ss.RegularField(data, labels=True), mode=mode, size=16, **options)
