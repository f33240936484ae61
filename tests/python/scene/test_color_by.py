"""Colours of another field, and volumes of colours: by plain arithmetic, all backends, options, bad input."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from command_line import run

import sheetsplat as ss
from sheetsplat.describe.recipe import Recipe

LIGHT = ss.Light((0.3, 0.5, 1.0))
SIZE = 16
K, J, ALONG = np.mgrid[0:SIZE, 0:SIZE, 0:SIZE] / (SIZE - 1.0) - 0.5
BALL = np.exp(-12 * (K**2 + J**2 + ALONG**2)).astype(np.float32)
WAVE = (ALONG + 0.3 * np.sin(9 * J)).astype(np.float32)
GREY = [(0, 0.5, 0.5, 0.5, 0), (0.2, 0.5, 0.5, 0.5, 0.0), (1, 1, 1, 1, 0.4)]
TURBO = ss.TransferFunction.from_colormap("turbo", clim=(-0.6, 0.6))


def kernels(seed):
    rng = np.random.default_rng(seed)
    return ss.EllipsoidField(rng.uniform(3, 13, (60, 3)), rng.uniform(1, 4, 60), values=rng.random(60))


def twins():
    """Two fields of the same kernels, turned ellipsoids with weights, one of them 0."""
    rng = np.random.default_rng(3)
    turns = rng.normal(size=(60, 4))
    shapes = {"scales": rng.uniform(1, 4, (60, 3)), "rotations": turns / np.linalg.norm(turns, axis=1)[:, None],
              "weights": np.append(0.0, rng.uniform(0.5, 2, 59))}  # fmt: skip
    places = rng.uniform(3, 13, (60, 3))
    return tuple(ss.EllipsoidField(places, values=values, **shapes) for values in rng.random((2, 60)) + [[0], [1e3]])


GIVERS = {
    "like it": lambda: (ss.RegularField(BALL), ss.RegularField(WAVE)),
    "prefiltered": lambda: (ss.RegularField(BALL, prefilter=True), ss.RegularField(WAVE, prefilter=True)),
    "ends elsewhere": lambda: (ss.RegularField(BALL), ss.RegularField(WAVE[:, :9], spacing=(0.9, 1.1, 1.0))),
    "kernels": lambda: (kernels(1), kernels(2)),
    "values of the same kernels": twins,
    "kernels in a volume": lambda: (ss.RegularField(BALL), kernels(2)),
    "two that add up": lambda: (ss.RegularField(BALL), [ss.RegularField(0.5 * WAVE), ss.RegularField(0.5 * WAVE)]),
}
WAYS = {
    "plain": {},
    "lit": {"lights": [LIGHT]},
    "surface": {"lights": [LIGHT], "mode": "isosurface", "iso_value": 0.4},
    "surfaces": {"mode": "isosurface", "iso_value": [(0.3, 0.4), (0.6, 0.5)]},
    "preintegrated": {"lights": [LIGHT], "preintegration": True},
    "slabs": {"sampling": "slab"},
    "slopes": {"lights": [LIGHT], "gradient": "analytic"},
    "filtered": {"lights": [LIGHT], "filter": "ewa"},
}


def view():
    return ss.Camera.fit(ss.RegularField(BALL), direction=(1, 0.6, 0.4), up=(0, 0, 1), fov_y=35)


@pytest.mark.parametrize("backend", ["cpu", "gl"])
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", GIVERS)
def test_backends_are_the_reference(name, way, backend):
    field, giver = GIVERS[name]()
    scene = ss.Scene(field, GREY, color_by=(giver, TURBO), **WAYS[way])
    expected = ss.Renderer("reference").render(scene, view(), (30, 26)).rgba
    assert np.abs(ss.Renderer(backend).render(scene, view(), (30, 26)).rgba - expected).max() < 2e-5
    # It gives colours, and nothing else.
    own = ss.Renderer("reference").render(scene.replace(color_by=None), view(), (30, 26)).rgba
    assert np.abs(own[..., :3] - expected[..., :3]).max() > 0.1 and np.array_equal(own[..., 3], expected[..., 3])


@pytest.mark.parametrize("way", ["lit", "surface", "preintegrated", "slabs"])
def test_kernels_that_differ_in_values_alone_are_drawn_once(way):
    """The processor draws as many sections as without colours; one that has moved by a bit draws those of both."""
    rng = np.random.default_rng(5)
    places, radii = rng.uniform(3, 13, (80, 3)), rng.uniform(1, 3, 80)
    field, giver = (ss.EllipsoidField(places, radii, values=rng.random(80)) for _ in range(2))
    moved = places.copy()
    moved[7, 1] = np.nextafter(moved[7, 1], 20.0)
    other = ss.EllipsoidField(moved, radii, values=giver.values)

    def drawn(colors):
        scene = ss.Scene(field, [(0, 1, 1, 1, 0.1), (1, 1, 1, 1, 0.4)], color_by=colors, **WAYS[way])
        return ss.Renderer("cpu").render(scene, view(), (30, 26))

    plain, once, twice = drawn(None), drawn((giver, TURBO)), drawn((other, TURBO))
    assert plain.stats["sections_drawn"] == once.stats["sections_drawn"]
    assert twice.stats["sections_drawn"] == 2 * plain.stats["sections_drawn"]
    assert np.array_equal(once.rgba[..., 3], plain.rgba[..., 3])
    assert np.abs(once.rgba - twice.rgba).max() < 1e-5 < np.abs(once.rgba - plain.rgba).max()


def test_views_of_kernels_drawn_once_follow_their_colours():
    """What was sorted for a picture is not taken for one that other kernels show in, or that is drawn otherwise."""
    field, giver = twins()
    low, high = ([(0, 1, 1, 1, 0), (start, 1, 1, 1, 0), (1, 1, 1, 1, 0.4)] for start in (0.2, 0.6))
    scenes = [ss.Scene(field, function, **options) for function in (low, high) for options in (
        {}, {"color_by": (giver, TURBO)}, {"color_by": (giver, TURBO), **WAYS["slopes"]},
        {"color_by": (giver, TURBO), **WAYS["filtered"]})]  # fmt: skip
    renderer = ss.Renderer("cpu")
    for scene in scenes + scenes[::-1]:
        assert np.array_equal(
            renderer.render(scene, view(), (30, 26)).rgba, ss.Renderer("cpu").render(scene, view(), (30, 26)).rgba
        )


def test_the_law_by_plain_arithmetic():
    """Constant data and colours along one ray, and the field's own colours where the other one ends."""
    ones = ss.RegularField(np.ones((6, 6, 6)), base=0.0)
    giver = ss.RegularField(np.full((6, 3, 6), 0.5), base=0.0)
    function = ss.TransferFunction([(0, 0, 0, 0, 0), (1, 0.2, 0.4, 0.6, 0.3)])
    colors = ss.TransferFunction([(0, 0, 0, 0, 0.7), (1, 1.0, 0.5, 0.0, 0.1)])
    camera = ss.Camera.orthographic((2.5, 2.5, 20.0), (2.5, 2.5, 2.5), up=(0, 1, 0), height=6.0)
    for options in ({}, {"preintegration": True}):
        scene = ss.Scene(ones, function, color_by=(giver, colors), slice_spacing=0.5, reference_length=0.5,
                         opacity_stop=1.0, **options)  # fmt: skip
        for backend in ("reference", "cpu", "gl"):
            rgba = ss.Renderer(backend).render(scene, camera, (6, 6)).rgba
            alpha = rgba[..., 3]
            assert alpha.min() > 0.9
            # Rows go downwards, y upwards: the other field is in the lower half.
            assert np.allclose(rgba[3:, :, :3] / alpha[3:, :, None], (0.5, 0.25, 0.0), atol=2e-3)
            assert np.allclose(rgba[:3, :, :3] / alpha[:3, :, None], (0.2, 0.4, 0.6), atol=2e-3)


def test_volumes_of_colours():
    rng = np.random.default_rng(3)
    rgb = np.clip(
        0.2 * rng.random((SIZE, SIZE, SIZE, 3)) + 0.7 * BALL[..., None] * np.stack([K, J, ALONG], -1) + 0.3, 0, 1
    )
    for samples in (rgb, (255 * rgb).astype(np.uint8), (65535 * rgb).astype(np.uint16)):
        field = ss.RegularField(samples)
        assert field.colored and not field.has_values
        assert np.allclose(field.values, rgb @ (0.2126, 0.7152, 0.0722), atol=5e-3)
        # The same as colours of a field with three others, each by its ramp.
        scene = ss.Scene(field, [(0, 0, 0, 0, 0), (1, 1, 1, 1, 0.5)], lights=[LIGHT])
        pictures = {one: ss.Renderer(one).render(scene, view(), (30, 26)).rgba for one in ("reference", "cpu", "gl")}
        assert np.abs(pictures["cpu"] - pictures["reference"]).max() < 2e-5
        assert np.abs(pictures["gl"] - pictures["reference"]).max() < 2e-5
    opaque = np.concatenate([np.broadcast_to((0.9, 0.1, 0.4), rgb.shape), np.ones(rgb.shape[:3])[..., None]], axis=-1)
    rgba = ss.render(opaque, size=20, shading=False, backend="cpu").rgba
    full = rgba[rgba[..., 3] > 0.99]
    assert len(full) > 20 and np.allclose(full[:, :3] / full[:, 3:], (0.9, 0.1, 0.4), atol=1e-2)
    assert np.nanmax(ss.render(opaque, mode="mip", size=20).scalar) == pytest.approx(1.0, rel=0.02)


def test_what_render_takes(tmp_path):
    points = kernels(1)
    by_field = ss.render(points, color_by=kernels(2).values, size=40, backend="cpu")
    assert not np.allclose(by_field.rgba, ss.render(points, size=40, backend="cpu").rgba)
    named = {"x": [0, 1, 2.0], "y": [0, 1, 0.5], "z": [0, 0, 1.0], "radius": [0.7] * 3, "value": [1, 2, 3.0],
             "speed": [9, 5, 7.0]}  # fmt: skip
    colored = ss.render(named, color_by="speed", color_map="magma", size=40, backend="cpu")
    assert not np.allclose(colored.rgba, ss.render(named, size=40, backend="cpu").rgba)
    rows = np.stack([np.asarray(one, float) for one in named.values()], axis=1)
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header=",".join(named), comments="")
    from_file = ss.render(tmp_path / "a.csv", color_by="speed", color_map="magma", size=40, backend="cpu")
    assert np.allclose(from_file.rgba, colored.rgba, atol=1e-6)
    np.save(tmp_path / "b.npy", WAVE)
    for given in (WAVE, tmp_path / "b.npy", ss.RegularField(WAVE), (ss.RegularField(WAVE), TURBO)):
        image = ss.render(BALL, color_by=given, mode="isosurface", iso_value=0.5, size=40, backend="cpu")
        assert np.ptp(image.rgba[..., 0][image.rgba[..., 3] == 1]) > 0.3
    image.save(tmp_path / "c.png")
    recipe = Recipe.read(tmp_path / "c.png")
    again = recipe.scene([ss.RegularField(BALL), ss.RegularField(WAVE)])
    assert np.array_equal(ss.Renderer("cpu").render(again, recipe.camera, recipe.size).rgba, image.rgba)


def test_scenes_are_pickled_with_their_colours():
    scene = ss.Scene([ss.RegularField(BALL), kernels(1)], [GREY, GREY], color_by=[(ss.RegularField(WAVE), TURBO), None])
    again = pickle.loads(pickle.dumps(scene))
    assert again == scene != scene.replace(color_by=None)
    same = [ss.Renderer("cpu").render(one, view(), 20).rgba for one in (scene, again)]
    assert np.array_equal(*same)


def test_the_command_line_takes_arrays_and_files(tmp_path):
    np.save(tmp_path / "ball.npy", BALL)
    np.save(tmp_path / "wave.npy", WAVE)
    np.savetxt(tmp_path / "a.csv", np.random.default_rng(1).random((20, 5)), delimiter=",", header="x,y,z,value,speed",
               comments="")  # fmt: skip
    for name, given in (("ball.npy", tmp_path / "wave.npy"), ("a.csv", "speed")):
        made = tmp_path / "made.png"
        asked = "--color-by", str(given), "--color-map", "magma", "--size", "20", "--backend", "cpu"
        run("render", str(tmp_path / name), "-o", str(made), *asked)
        image = ss.render(tmp_path / name, color_by=given, color_map="magma", size=20, backend="cpu")
        recipe = Recipe.read(made)
        assert recipe.transfer_functions == image.recipe.transfer_functions and recipe.colors == image.recipe.colors
        assert recipe.colors != ()
    run("render", tmp_path / "ball.npy", "-o", made, "--color-by", tmp_path / "wave.npy", "--color-map", "0:red,1:blue")
    (_, colors), *_ = Recipe.read(made).colors
    np.testing.assert_allclose(colors.at([0.0, 0.5, 1.0])[:, :3], [(1, 0, 0), (0.5, 0, 0.5), (0, 0, 1)], atol=0.01)


def test_files_of_several_channels_are_refused(tmp_path):
    np.save(tmp_path / "two.npy", np.stack([BALL, WAVE]))
    with pytest.raises(ss.InvalidInput, match="2 fields .*name="):
        ss.render(BALL, color_by=tmp_path / "two.npy", size=8)


def test_labels_are_shown_as_values_of_other_numbers():
    labels = ss.RegularField(np.ones((3, 3, 3)), labels=True)
    with pytest.raises(ss.InvalidInput, match="labels=False"):
        ss.render(labels, color_by=np.full((3, 3, 3), 0.5), size=8)


BAD = {
    "name": (lambda: ss.render(BALL, color_by="density"), "no file, for data whose arrays have no names"),
    "shape": (lambda: ss.render(BALL, color_by=np.zeros(3)), "shape"),
    "for several": (lambda: ss.render([BALL, WAVE], color_by=WAVE), r"of shape \(16, 16, 16\) for 2 fields"),
    "missing": (lambda: ss.render(BALL, color_by=np.where(BALL > 0.9, np.nan, 1)), 'color_by .*NaN at .*nan="skip"'),
    "infinite": (lambda: ss.render(kernels(1), color_by=np.full(60, np.inf)), r"color_by .*infinity at \[0\]"),
    "a channel of labels": (
        lambda: ss.RegularField(np.ones((3, 3, 3)), labels=True).with_color("red"),
        "labels.*with_label_colors",
    ),
    "colours with gaps": (lambda: ss.RegularField(np.full((3, 3, 3, 3), np.nan)), "some of them not finite"),
    "a channel of colours": (lambda: ss.RegularField(np.ones((3, 3, 3, 3))).with_color("red"), "leave it out"),
    "number": (lambda: ss.Scene(ss.RegularField(BALL), GREY, color_by=3), "color_by"),
    "two for one": (lambda: ss.Scene(ss.RegularField(BALL), GREY, color_by=[None, None]), "1 groups"),
    "bricks": (lambda: ss.render(ss.open_bricks(BALL, brick=8), color_by=ss.RegularField(WAVE)), "in memory"),
    "giver in bricks": (lambda: ss.render(BALL, color_by=ss.open_bricks(WAVE, brick=8)), "in memory"),
    "labels": (
        lambda: ss.Scene(
            ss.RegularField(np.ones((3, 3, 3)), labels=True),
            ss.LabelColors({1: "red"}),
            color_by=(ss.RegularField(BALL), TURBO),
        ),
        "colours or labels",
    ),
    "beyond": (lambda: ss.RegularField(np.full((3, 3, 3, 3), 2.0)), "0 to 1"),
    "signed": (lambda: ss.RegularField(np.zeros((3, 3, 3, 4), np.int16)), "uint8"),
    "two components": (lambda: ss.RegularField(np.zeros((3, 3, 3, 2))), "three axes"),
    "surface of colours": (lambda: ss.render(np.full((4, 4, 4, 3), 0.5), mode="isosurface", size=8), "composite"),
}


@pytest.mark.parametrize("kind", BAD)
def test_bad_colours_are_refused(kind):
    make, words = BAD[kind]
    with pytest.raises(ss.Error, match=words):
        make()
    with pytest.warns(ss.PictureWarning, match="color_by"):
        ss.render(BALL, color_by=WAVE, mode="mip", size=8)
    with pytest.warns(ss.PictureWarning, match="color_map changes nothing"):
        ss.render(BALL, color_map="magma", size=8)
    with pytest.warns(ss.PictureWarning, match="color_map changes nothing: the field of color_by has its own colours"):
        ss.render(BALL, color_by=(ss.RegularField(WAVE), TURBO), color_map="magma", size=8)
    with pytest.warns(ss.PictureWarning, match="cmap, clim change nothing in a picture of colours"):
        ss.render(np.stack([BALL] * 3, -1), cmap="magma", clim=(0, 1), size=8)


def test_components_of_colours_are_summed_in_sheets_and_one_field_at_points():
    """Fog shows at nearly all points: three sums at each of them took 5 to 9 times as long as their sheets."""
    options = {"size": 40, "backend": "cpu", "quality": "draft", "shading": False}
    camera = ss.Camera.fit(ss.RegularField(BALL), direction=(1, 0.7, 0.4))
    plain, colored, volume = (
        ss.render(data, camera=camera, **options, **more).stats["sections_drawn"]
        for data, more in ((BALL, {}), (BALL, {"color_by": WAVE}), (np.stack([BALL] * 3, -1).astype(np.float32), {}))
    )
    assert colored == plain and volume > 3 * plain


def test_what_lies_beside_the_data_is_told():
    away = ss.RegularField(WAVE, origin=(100, 0, 0))
    with pytest.warns(ss.PictureWarning, match="color_by lies beside the data"):
        ss.render(ss.RegularField(BALL), color_by=away, size=8)
    with pytest.warns(ss.PictureWarning, match="offset is 1000"):
        ss.render(ss.RegularField(BALL), slice_planes=ss.SlicePlane((0, 0, 1), 1000), size=8)
