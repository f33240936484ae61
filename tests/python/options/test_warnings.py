"""Warnings about pictures: that they are seen, where they point, and what does not warn."""

from __future__ import annotations

import pickle
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import run

import sheetsplat as ss
from sheetsplat.describe.recipe import Recipe
from sheetsplat.tiles import render_tiles

SMALL = {"size": (20, 16), "backend": "reference"}
RAMP = [(0, 0, 0, 1, 0), (1, 1, 1, 0, 0.5)]
AWAY = ss.Camera.orthographic((900, 900, 9), (900, 900, 0), height=5)


def caught(action) -> list[warnings.WarningMessage]:
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        action()
    return found


def test_the_class_is_a_user_warning():
    assert issubclass(ss.PictureWarning, UserWarning) and ss.PictureWarning.__module__ == "sheetsplat"
    with pytest.warns(ss.PictureWarning) as found:
        ss.render(np.zeros((4, 4, 4)), mode="mip", **SMALL)
    again = pickle.loads(pickle.dumps(found[0].message))
    assert str(again) == str(found[0].message) and again.words == found[0].message.words


def test_every_way_of_rendering_points_at_the_callers_line(ball):
    field = ss.RegularField(ball)
    scene = ss.Scene(field, RAMP)
    renderer = ss.Renderer("reference")
    ways = [
        lambda: ss.render(ball, camera=AWAY, **SMALL),
        lambda: ss.render(scene, camera=AWAY, **SMALL),
        lambda: renderer.render(scene, AWAY, size=(8, 8)),
        lambda: list(renderer.progressive(scene, AWAY, size=(8, 8))),
    ]
    for way in ways:
        (found,) = caught(way)
        assert found.category is ss.PictureWarning and found.filename == __file__
        assert found.lineno == way.__code__.co_firstlineno
        assert "nothing can be seen in the picture" in str(found.message)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"clim": (5, 9), "opacity": 0.5}, "0 to 0.876282 lie below the range 5 to 9"),
        ({"clim": (-9, -5), "opacity": 0.5}, "0 to 0.876282 lie above the range -9 to -5"),
        ({"transfer_function": ss.TransferFunction([(2, 1, 1, 1, 0.5), (3, 0, 0, 0, 0.5)])}, "below the range 2 to 3"),
        ({"mode": "mip", "clim": (5, 9)}, "lie below the range 5 to 9"),
        ({"mode": "xray", "clim": (-9, -1)}, "lie above the range -9 to -1"),
        ({"mode": "xray", "opacity": 0.5}, "mode xray does not use these options: opacity"),
        ({"shadows": True, "shading": False}, "shadows=True changes nothing"),
        ({"max_seconds": 1e-9, "backend": "cpu"}, "max_seconds is not kept"),
    ],
)
def test_what_warns(ball, options, words):
    (found,) = caught(lambda: ss.render(ball, **{**SMALL, **options}))
    assert found.category is ss.PictureWarning and words in str(found.message)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"clim": (0.8, 5), "opacity": 0.5},
        {"clim": (-5, 0.1), "opacity": 0.5},
        {"mode": "mip", "clim": (0.5, 9)},
        {"mode": "xray", "cmap": "magma", "log_scale": True},
        {"mode": "isosurface", "iso_value": 0.5, "clim": (3, 4)},
        {"shadows": True},
    ],
)
def test_what_does_not_warn(ball, options):
    assert caught(lambda: ss.render(ball, **SMALL, **options)) == []


@pytest.mark.parametrize("value", [0, 7, -2.5, 1e30])
@pytest.mark.parametrize("mode", ["composite", "isosurface", "mip", "minimum", "average", "xray"])
def test_equal_samples_are_told_once(value, mode):
    image, told = told_of(lambda: ss.render(np.full((5, 6, 7), value, np.float32), mode=mode, **SMALL))
    # Beside the block there are no numbers.
    beside = np.isnan(image.pixels)
    assert beside.any() == (mode in ("mip", "minimum", "average")) and np.isfinite(image.pixels[~beside]).all()
    if mode == "xray" and value:
        # How thick the volume is.
        assert told == [] and image.scalar.any()
        return
    (one,) = told
    if value == 0 and mode != "composite":
        assert one == "nothing can be seen in the picture: all values are 0"
    elif mode == "isosurface":
        # Where the volume ends its values do not fall.
        assert one.startswith("nothing can be seen in the picture: the iso value") and "lies outside the values" in one
    else:
        assert f"all samples are {np.float32(value):g}: there is nothing in the volume to tell apart" in one


@pytest.mark.parametrize("options", [{"clim": (0, 9), "opacity": 0.3}, {"mode": "isosurface", "iso_value": 3}])
def test_equal_samples_that_were_asked_for_are_not_told(options):
    image, told = told_of(lambda: ss.render(np.full((5, 6, 7), 7.0), boundary="zero", **options, **SMALL))
    assert told == [] and image.rgba[..., 3].max() > 0.2
    # Nor such as another volume tells apart.
    fields = [ss.RegularField(np.full((5, 6, 7), value)) for value in (7.0, 3.0)]
    assert told_of(lambda: ss.render(fields, **SMALL))[1] == []


def test_missing_samples_are_told():
    values = np.full((5, 6, 7), np.nan)
    with pytest.raises(ss.InvalidInput, match='nan="skip"'):
        ss.render(values, **SMALL)
    image, told = told_of(lambda: ss.render(values, nan="skip", **SMALL))
    assert told == ["nothing can be seen in the picture: all samples are NaN"] and not image.rgba.any()


def test_scattered_data_are_judged_by_what_they_can_reach(rng):
    centers, values = rng.normal(size=(40, 3)), np.full(40, 3.0)
    mean = ss.EllipsoidField(centers, 1.0, values=values)
    (found,) = caught(lambda: ss.render(mean, clim=(4, 5), opacity=0.5, **SMALL))
    assert "0 to 3 lie below the range 4 to 5" in str(found.message)
    # Sums have no range that their values tell.
    sums = ss.EllipsoidField(centers, 1.0, values=values, normalization="none")
    assert caught(lambda: ss.render(sums, clim=(4, 5), opacity=0.5, **SMALL)) == []


def test_coarse_stages_do_not_warn(ball):
    stages = ss.Renderer("cpu").progressive(ss.Scene(ss.RegularField(ball), RAMP), AWAY, (96, 96), first_seconds=1e-9)
    found = caught(lambda: list(stages))
    assert len(found) == 1


def test_warnings_become_errors_where_they_should(ball, volume):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(ss.PictureWarning, match="nothing can be seen"):
            ss.render(ball, camera=AWAY, **SMALL)
    code = f"import sheetsplat as ss; ss.render({str(volume)!r}, clim=(900, 901), size=(8, 8), backend='reference')"
    strict = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True)
    assert strict.returncode == 1 and "sheetsplat.PictureWarning: nothing can be seen" in strict.stderr
    seen = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert seen.returncode == 0 and "<string>:1: PictureWarning: nothing can be seen" in seen.stderr


def test_the_command_line_has_one_line_for_each(tmp_path, volume):
    options = ["render", volume, "-o", tmp_path / "a.png", "--size", "8", "--backend", "reference"]
    lines = run(*options, "--clim", "900,901").stderr.splitlines()
    assert len(lines) == 2 and lines[0].startswith("warning: nothing") and "warning" not in lines[1]
    # Options are spelled as on the command line, and no line of code is shown.
    stderr = run(*options, "--shadows", "--no-shading").stderr
    assert "warning: --shadows changes nothing" in stderr and ".py" not in stderr
    assert run(*options, "--clim", "900,901", "-q").stderr == ""
    # The filters of the process are as they were.
    with pytest.warns(ss.PictureWarning):
        ss.render(volume, clim=(900, 901), **SMALL)


def test_parts_of_pictures_do_not_warn(ball, tmp_path):
    scene = ss.Scene(ss.RegularField(ball), RAMP)
    camera = ss.Camera.fit(scene, margin=4.0)
    renderer = ss.Renderer("reference")
    assert caught(lambda: render_tiles(scene, camera, (40, 40), tmp_path / "a.npy", renderer=renderer, tile=10)) == []
    # Only these pictures: the next one warns again.
    assert len(caught(lambda: renderer.render(scene, AWAY, (8, 8)))) == 1


STRAY: dict[str, Any] = {"size": 32, "backend": "cpu"}


def cloud(*strays: tuple[int, float]) -> ss.EllipsoidField:
    """Return a cloud of 200 kernels, and strays inserted at their numbers, at their x."""
    rng = np.random.default_rng(0)
    centers, values = rng.normal(size=(200, 3)), 1.0 + rng.random(200)
    for number, x in strays:
        centers, values = np.insert(centers, number, [[x, 0, 0]], axis=0), np.insert(values, number, 1.5)
    return ss.EllipsoidField(centers, np.full(len(centers), 0.5), values=values)


def told_of(action: Any) -> tuple[Any, list[str]]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = action()
    return result, [str(one.message) for one in caught]


@pytest.mark.parametrize("far", [1e4, -1e7, 1e30])
def test_a_kernel_far_from_all_others_is_left_out(far: float) -> None:
    """Slices are at least a share of the extent apart: with it the others would fall between them."""
    plain, none = told_of(lambda: ss.render(cloud(), **STRAY))
    assert none == []
    found, told = told_of(lambda: ss.render(cloud((77, far)), **STRAY))
    assert len(told) == 1 and "1 of 201 kernels, number 77 at" in told[0] and "slice_spacing=" in told[0]
    assert np.array_equal(found.rgba, plain.rgba) and found.plan.slice_spacing == plain.plan.slice_spacing
    # Numbers of kernels stay those of the data.
    one, other = found.pick(16, 16), plain.pick(16, 16)
    assert one.kernel == other.kernel + (other.kernel >= 77)
    assert found.recipe.fields[0].trim.kernels == (77,) and Recipe.from_json(found.recipe.to_json()) == found.recipe
    assert pickle.loads(pickle.dumps(found)) == found


def test_strays_stay_where_they_are_asked_for() -> None:
    for options in ({"slice_spacing": 5.0}, {"target": (1e4, 0, 0)}, {"camera": ss.Camera.fit(cloud((77, 1e4)))}):
        assert ss.render(cloud((77, 1e4)), **options, **STRAY).recipe.fields[0].trim.kernels == ()
    # A few are strays, more of them are a part of the data.
    few = ss.render(cloud((3, 1e4), (77, -1e4), (202, 1e6)), **STRAY)
    assert few.recipe.fields[0].trim.kernels == (3, 77, 202)
    many = ss.render(cloud(*((n, 1e4) for n in range(4))), **STRAY)
    assert many.recipe.fields[0].trim.kernels == ()


def test_strays_of_several_fields_are_left_out() -> None:
    first, second = cloud((77, 1e4)), cloud((5, -1e4))
    image, told = told_of(lambda: ss.render([first, second], **STRAY))
    assert [one.trim.kernels for one in image.recipe.fields] == [(77,), (5,)]
    assert len(told) == 2 and all("left out" in one for one in told)
    assert image.plan.slice_spacing == ss.render([cloud(), cloud()], **STRAY).plan.slice_spacing
    # A kernel that lies among those of another field is a part of the data.
    other = ss.EllipsoidField(cloud().centers + (1e4, 0, 0), np.full(200, 0.5), values=np.ones(200))
    image, _ = told_of(lambda: ss.render([first, other], **STRAY))
    assert [one.trim.kernels for one in image.recipe.fields] == [(), ()]
    # Beside a volume that has slices close together anyway nothing is hidden.
    volume = ss.RegularField(np.ones((4, 4, 4)), spacing=(0.2, 0.2, 0.2))
    image, told = told_of(lambda: ss.render([first, volume], **STRAY))
    assert image.recipe.fields[0].trim.kernels == () and not [one for one in told if "left out" in one]


def test_a_picture_without_strays_is_made_again(tmp_path: Path) -> None:
    data, first, again = tmp_path / "a.npz", tmp_path / "a.png", tmp_path / "b.png"
    ss.io.save_npz(cloud((77, 1e5)), data)
    stderr = run("render", data, "-o", first, "--size", "32", "--backend", "reference").stderr
    assert "left out" in stderr and "--slice-spacing" in stderr
    run("render", first, data, "-o", again)
    assert first.read_bytes() == again.read_bytes()
    ss.io.save_npz(ss.EllipsoidField([[0, 0, 0]], [1.0], values=[1.0]), data)
    assert "more than 77 of them" in run("render", first, data, "-o", again, code=1).stderr


@pytest.mark.parametrize("value", [1e10, 1e20, -1e30])
def test_a_sample_beyond_all_pictures_is_told_and_hides_nothing(value: float) -> None:
    z, y, x = np.mgrid[0:24, 0:24, 0:24] - 11.5
    samples = np.exp(-(x * x + y * y + z * z) / 40)
    plain = ss.render(samples, **STRAY)
    samples[2, 3, 4] = value
    image, told = told_of(lambda: ss.render(samples, **STRAY))
    assert len(told) == 1 and f"{value:g} at [2, 3, 4]" in told[0] and "clim" in told[0]
    assert not [note for note in image.plan.notes if "log" in note]
    assert np.abs(image.rgba - plain.rgba).max() < 0.1 and image.clim == pytest.approx(plain.clim, rel=0.05)
    assert image.recipe.fields[0].trim.limits == pytest.approx((samples.min() if value > 0 else 0, 1), abs=0.02)
    assert Recipe.from_json(image.recipe.to_json()) == image.recipe
    # Limits that reach so far show it.
    _, told = told_of(lambda: ss.render(samples, clim=sorted((0.0, value)), **STRAY))
    assert not [one for one in told if "no picture shows" in one]


def test_an_empty_picture_of_few_values_says_so() -> None:
    values = np.zeros((20, 20, 20))
    values[3, 3, 3] = 1e12
    scene = ss.Scene(ss.RegularField(values), [(1e11, 0, 0, 0, 0), (1e12, 1, 1, 1, 1e-30)])
    with pytest.warns(ss.PictureWarning, match="only 1 of 8000 values have an opacity; nearly all lie between 0 and 0"):
        ss.Renderer("reference").render(scene, ss.Camera.fit(scene, margin=100.0), (8, 8))


def test_data_that_lie_too_far_from_0_are_told_what_to_do() -> None:
    rng = np.random.default_rng(1)
    field = ss.EllipsoidField(rng.random((10, 3)) + 4e30, np.ones(10), values=np.ones(10))
    with pytest.raises(ss.InvalidInput, match="subtract a common offset"):
        ss.render(field, **STRAY)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"mode": "isosurface", "iso_value": [(0.3, 0.5), (7, 1)]}, "part of the surfaces is missing: the iso value 7"),
        ({"mode": "isosurface", "iso_value": [(0.3, 0)]}, "nothing can be seen in the picture: the opacity of the sur"),
        ({"mode": "xray", "cmap": ["red"]}, "all values have one colour in the picture: its colormap has one colour"),
        ({"mode": "average", "log_scale": True, "falling": True}, "none of its numbers is above 0"),
        ({"fov_y": 20}, 'fov_y changes nothing without projection="perspective"'),
        ({"camera": ss.Camera.orthographic((4, 4, 30), (4, 4, 4), height=12), "azimuth": 30}, "camera replaces"),
        ({"renderer": ss.Renderer("reference")}, "renderer replaces these options: backend"),
    ],
)
def test_what_contradicts_or_shows_nothing_is_told(ball, options, words):
    options = dict(options)
    values = -ball if options.pop("falling", False) else ball
    (found,) = caught(lambda: ss.render(values, **{**SMALL, **options}))
    assert found.category is ss.PictureWarning and words in str(found.message)


def test_surfaces_that_interpolants_reach_are_not_told():
    values = np.zeros((12, 12, 12))
    values[:, :, 6:] = 1.0
    surfaces = {"mode": "isosurface", "iso_value": [(0.5, 0.5), (1.1, 1)]}
    assert caught(lambda: ss.render(values, prefilter=True, **surfaces, **SMALL)) == []
    (found,) = caught(lambda: ss.render(values, prefilter=False, **surfaces, **SMALL))
    assert "the iso value 1.1 lies outside the values 0 to 1" in str(found.message)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--fov", 20), "--fov is of --projection perspective"),
        (("--prefilter", "--normalization", "threshold"), "--prefilter cannot be used: found --normalization"),
    ],
)
def test_options_that_contradict_each_other_are_wrong_usage(tmp_path, volume, options, words):
    told = run("render", volume, "-o", tmp_path / "a.png", *options, code=2).stderr
    assert words in " ".join(told.split()) and not (tmp_path / "a.png").exists()
