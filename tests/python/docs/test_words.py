"""Words in place of numbers: opacities, transfer functions for CT, sizes, ambient occlusion; nearest names."""

import numpy as np
import pytest
from command_line import run

import sheetsplat as ss
from sheetsplat.cli.types import param_type
from sheetsplat.options.values import Special

SMALL = {"size": (16, 16), "backend": "cpu"}


def opacity(word, values, clim=(10.0, 20.0)):
    return ss.TransferFunction.from_colormap("gray", word, clim).at(values)[..., 3]


def test_opacities_by_word_mean_what_pyvista_means():
    at = np.linspace(10, 20, 256)
    share = np.linspace(0, 1, 256)
    assert np.allclose(opacity("linear", at), share) and np.allclose(opacity("linear_r", at), 1 - share)
    assert np.allclose(opacity("geom", at), np.geomspace(1e-6, 255, 256) / 255)
    for word, width in (("sigmoid", 10), ("sigmoid_3", 3), ("sigmoid_20", 20)):
        expected = 1 / (1 + np.exp(-np.linspace(-width, width, 256)))
        assert np.allclose(opacity(word, at), expected, atol=1e-12)
        assert np.allclose(opacity(word + "_r", at), expected[::-1], atol=1e-12)
    assert np.array_equal(opacity("foreground", [9, 10, 10.03, 10.05, 15, 20, 21]), [0, 0, 0, 1, 1, 1, 1])


@pytest.mark.parametrize("prefilter", [False, True])
def test_foreground_hides_the_lowest_value(prefilter):
    values = np.zeros((12, 12, 12), np.uint8)
    values[4:8, 4:8, 4:8] = 200
    camera = ss.Camera.fit(ss.RegularField(values))
    look = {"opacity": "foreground", "clim": (0, 255), "prefilter": prefilter, "camera": camera}
    alpha = ss.render(values, **look, **SMALL).rgba[..., 3]
    assert 0.05 < (alpha > 0).mean() < 0.4 and alpha.max() == 1.0 and not alpha[:3].any()


@pytest.mark.parametrize("count", [1, 4, 7])
def test_isolayers_are_bumps(count):
    centers = 10 + 10 * (np.arange(count) + 0.5) / count
    assert np.allclose(opacity(f"isolayers:{count}", centers), 0.8, atol=0.01)
    between = 10 + 10 * np.arange(count + 1) / count
    assert not opacity(f"isolayers:{count}", between).any()
    assert np.array_equal(opacity("isolayers", centers), opacity("isolayers:4", centers))


@pytest.mark.parametrize(
    "word", ["sigmid", "sigmoid_2", "isolayers:0", "isolayers:33", "isolayers:x", "", "foreground_r"]
)
def test_other_words_are_refused(word):
    with pytest.raises(ss.InvalidInput, match="isolayers:N"):
        opacity(word, [10.0])


def test_names_that_are_nearly_right_are_proposed(tmp_path):
    values = np.random.default_rng(1).random((6, 6, 6))
    for options, name in (
        ({"opacity": "sigmod_5"}, "sigmoid_5"),
        ({"cmap": "virdis"}, "viridis"),
        ({"mode": "isosurfce"}, "isosurface"),
        ({"backend": "referense"}, "reference"),
        ({"transfer_function": "ct_bones"}, "ct_bone"),
        ({"iso": 3}, "iso_value"),
        ({"occlusion": True}, "ambient_occlusion"),
        ({"quality": "gud"}, "good"),
        ({"background": "whit"}, "white"),
        ({"background": "lightgren"}, "lightgreen"),
    ):
        with pytest.raises(ss.InvalidInput, match=f"did you mean .*{name}"):
            ss.render(values, **{**SMALL, **options})


def test_ct_presets_show_what_they_name():
    air, lung, muscle, bone = -1000, -700, 60, 700
    opacities = {
        name: ss.TransferFunction.preset(name).at([air, lung, muscle, bone])[:, 3]
        for name in ("ct_bone", "ct_muscle", "ct_lung")
    }
    assert (opacities["ct_bone"] > 0.01).tolist() == [False, False, False, True]
    assert (opacities["ct_muscle"] > 0.01).tolist() == [False, False, True, True]
    assert (opacities["ct_lung"] > 0.01).tolist() == [False, True, False, False]
    values = np.full((12, 12, 12), -1000, np.int16)
    values[4:8, 4:8, 4:8] = 700
    given = ss.render(values, transfer_function="ct_bone", **SMALL)
    assert given.rgba[..., 3].max() > 0.5
    with pytest.raises(ss.InvalidInput, match="clim"):
        ss.render(values, transfer_function="ct_bone", clim=(0, 1), **SMALL)


def test_one_number_is_a_square():
    values = np.random.default_rng(1).random((6, 6, 6))
    assert ss.render(values, size=12, backend="cpu").size == (12, 12)
    for bad in (0, -3, True, 2.5):
        with pytest.raises(ss.InvalidInput, match="size"):
            ss.render(values, size=bad)


def test_ambient_occlusion_finds_a_radius(tmp_path):
    values = np.random.default_rng(1).random((9, 9, 9))
    image = ss.render(values, ambient_occlusion=True, **SMALL)
    radius = image.recipe.options["ambient_occlusion"].radius
    assert radius == pytest.approx(0.04 * 8 * np.sqrt(3))
    assert ss.render(values, ambient_occlusion=False, **SMALL).recipe.options["ambient_occlusion"] is None
    np.save(tmp_path / "a.npy", values)
    options = ("--size", "16", "--backend", "cpu", "--ambient-occlusion", "auto", "--opacity", "sigmoid_5")
    run("render", tmp_path / "a.npy", "-o", tmp_path / "a.png", *options)
    assert (
        "sigmoid" in run("render", tmp_path / "a.npy", "-o", tmp_path / "b.png", "--opacity", "sigmid", code=2).stderr
    )
    assert param_type(Special.OPACITY).convert("isolayers:3", None, None) == "isolayers:3"


@pytest.mark.parametrize("gradient", ["sheets", "analytic"])
def test_a_number_is_a_radius(gradient):
    values = np.random.default_rng(1).random((9, 9, 9))
    image, again = (
        ss.render(values, ambient_occlusion=one, gradient=gradient, **SMALL) for one in (2.5, ss.AmbientOcclusion(2.5))
    )
    assert image == again and image.recipe.options["ambient_occlusion"] == ss.AmbientOcclusion(2.5)
    for bad in (0, -1, float("inf"), "5", (5, 0.5)):
        with pytest.raises(ss.InvalidInput, match="ambient_occlusion|radius"):
            ss.render(values, ambient_occlusion=bad, **SMALL)
    with pytest.raises(ss.InvalidInput, match="which knows the data"):
        ss.Scene(ss.RegularField(values), [(0, 1, 1, 1, 0), (1, 1, 1, 1, 1)], ambient_occlusion=True)


def test_the_command_line_takes_occlusion_with_and_without_a_number(tmp_path):
    data, picture = tmp_path / "a.npy", tmp_path / "a.png"
    np.save(data, np.random.default_rng(1).random((9, 9, 9)))
    chosen = 0.04 * 8 * np.sqrt(3)
    flag = "--ambient-occlusion"
    for command, expected in (
        ((flag, data, "-o", picture), (chosen, 1)),
        ((data, flag, "-o", picture), (chosen, 1)),
        ((data, "-o", picture, flag), (chosen, 1)),
        ((flag, "--", data), (chosen, 1)),
        ((flag, "auto", data, "-o", picture), (chosen, 1)),
        ((flag, "3", data, "-o", picture), (3, 1)),
        ((data, "-o", picture, f"{flag}=3,0.5"), (3, 0.5)),
    ):
        output = () if "-o" in command else ("-o", picture)
        run("render", *output, "--size", "12", "--backend", "cpu", *command)
        found = ss.Recipe.read(picture).options["ambient_occlusion"]
        assert (found.radius, found.strength) == pytest.approx(expected), command
    for bad in ("0", "3,2", "wide"):
        assert "a radius above 0" in run("render", data, "-o", picture, f"{flag}={bad}", code=2).stderr
    assert "found no such file" in run("render", flag, tmp_path / "missing.npy", "-o", picture, code=1).stderr


def test_the_command_line_knows_the_nearest_words(volume, tmp_path):
    for given, near in {
        "--quality=bst": "best",
        "--opacity=sigmod_5": "sigmoid_5",
        "--mode=isosurfce": "isosurface",
    }.items():
        assert f"did you mean {near}" in run("render", volume, "-o", tmp_path / "a.png", given, code=2).stderr
    assert "did you mean render?" in run("rendr", volume, code=2).stderr
