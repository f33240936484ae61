"""The one-line call: what it takes, and what it chooses when nothing is said."""

from __future__ import annotations

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat.look import automatic, histogram

SMALL = {"size": (24, 24), "backend": "reference", "quality": "draft"}


def test_data_may_be_an_array_a_path_a_field_or_fields(tmp_path, ball):
    np.save(tmp_path / "a.npy", ball)
    expected = ss.render(ball, **SMALL).rgba
    assert expected[..., 3].max() > 0.5
    for data in (
        tmp_path / "a.npy",
        str(tmp_path / "a.npy"),
        ss.RegularField(ball),
        [ss.RegularField(ball)],
        ball.tolist(),
    ):
        assert np.allclose(ss.render(data, **SMALL).rgba, expected, atol=1e-6)
    double = ss.render([ss.RegularField(ball / 2), ss.RegularField(ball / 2)], clim=(0, 1), **SMALL).rgba
    assert np.allclose(double, ss.render(ball, clim=(0, 1), **SMALL).rgba, atol=1e-6)
    assert np.array_equal(ss.render(ss.datasets.marschner_lobb(12), **SMALL).rgba.shape, (24, 24, 4))


def test_field_options_are_for_arrays_and_files(ball):
    assert not np.allclose(ss.render(ball, spacing=(1, 1, 3), **SMALL).rgba, ss.render(ball, **SMALL).rgba)
    with pytest.raises(ss.InvalidInput, match="spacing"):
        ss.render(ss.RegularField(ball), spacing=(1, 1, 3), **SMALL)
    with pytest.raises(ss.InvalidInput, match="only for files"):
        ss.render(ball, dtype="uint8", **SMALL)


def test_options_that_clash_are_refused(ball):
    function = ss.TransferFunction([(0, 0, 0, 0, 0), (1, 1, 1, 1, 1)])
    with pytest.raises(ss.InvalidInput, match="clim"):
        ss.render(ball, transfer_function=function, clim=(0, 1), **SMALL)


def test_given_nouns_take_the_place_of_options(ball):
    field = ss.RegularField(ball)
    camera, renderer = ss.Camera.fit(field, (1, 0, 0)), ss.Renderer("reference")
    function = ss.TransferFunction([(0, 0, 0, 0, 0), (1, 1, 1, 1, 1)])
    nouns = {"camera": camera, "renderer": renderer, "transfer_function": function}
    image = ss.render(field, **nouns, shading=False, size=(20, 20), quality="draft")
    expected = renderer.render(ss.Scene(field, function), camera, size=(20, 20))
    assert np.array_equal(image.rgba, expected.rgba)


def test_shading_and_lights(ball):
    plain = ss.render(ball, shading=False, **SMALL)
    assert not plain.plan.has("gradient") and ss.render(ball, **SMALL).plan.has("gradient")
    assert np.array_equal(ss.render(ball, lights=[], **SMALL).rgba, plain.rgba)


@pytest.mark.parametrize("mode", ["composite", "isosurface", "xray", "mip"])
def test_every_mode_shows_something(ball, mode):
    picture = ss.render(ball, mode=mode, **SMALL).pixels
    assert picture.max() > 0.3 and (picture.reshape(24, 24, -1)[0, 0] == 0).all()


def test_the_threshold_parts_things_from_background(rng):
    values = rng.normal(10, 3, (24, 24, 24)).clip(0)
    values[8:16, 8:16, 8:16] = rng.normal(100, 10, (8, 8, 8))
    look = automatic.choose([ss.RegularField(values)])
    assert 25 < look.surface < 75 and look.clim[0] == look.surface and 100 < look.clim[1] < 130
    assert look.opacity[0][1] == 0 and look.opacity[-1] == (pytest.approx(look.clim[1]), histogram.TOP_OPACITY)
    # The background is invisible, the thing is not.
    camera = ss.Camera.fit(ss.RegularField(values))
    picture = ss.render(values, size=(48, 48), camera=camera, backend="reference").rgba
    assert picture[3:6, 3:6, 3].max() < 0.02 and picture[22:26, 22:26, 3].min() > 0.9


@pytest.mark.parametrize("scale", [1e-30, 1, 1e30])
@pytest.mark.parametrize("shift", [0, -5])
def test_the_choice_follows_the_units(ball, scale, shift):
    plain = automatic.choose([ss.RegularField(ball.astype(np.float64))])
    moved = automatic.choose([ss.RegularField((ball.astype(np.float64) + shift) * scale)])
    assert np.allclose((np.array(moved.clim) / scale) - shift, plain.clim, rtol=1e-6)


@pytest.mark.parametrize("value", [0, 7.5, -3, 1e300])
def test_constant_fields_show(value):
    picture = ss.render(np.full((6, 6, 6), value, np.float64), **SMALL).rgba
    assert np.isfinite(picture).all()
    if value not in (0, 1e300):
        assert picture[12, 12, 3] > 0.1


def test_all_samples_may_be_missing():
    nothing = ss.RegularField(np.full((4, 4, 4), np.nan), nan="skip")
    camera = ss.Camera.orthographic((0, 0, 9), (0, 0, 0), height=5)
    assert nothing.size == 0
    assert not ss.render(nothing, camera=camera, **SMALL).rgba.any()
    assert not ss.render(nothing, **SMALL).rgba.any()
    with pytest.raises(ss.InvalidInput, match=r"Camera\.fit"):
        ss.Camera.fit(nothing)


@pytest.mark.gl
@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "least", "most"),
    [
        ("lobster_120x120x34_uint8", 0.05, 0.5),
        ("hydrogen_64x64x64_float32", 0.01, 0.5),
        ("turbulent_combustion_128x256x32_uint8", 0.02, 0.5),
    ],
)
def test_measured_volumes_show_something(data_dir, name, least, most):
    path = data_dir / f"{name}.nrrd"
    if not path.exists():
        pytest.skip(f"{path} is not there")
    alpha = ss.render(path, size=(80, 80), backend="gl").rgba[..., 3]
    assert least < (alpha > 0.2).mean() < most and alpha.max() > 0.9
