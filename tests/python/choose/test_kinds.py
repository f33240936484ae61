"""Pictures of all kinds of data when nothing but the samples was given: no box, limits of the data, closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import sheetsplat as ss
from bench.kinds import KINDS, drifting, off_interpolation, tomogram
from sheetsplat.api import prepare
from sheetsplat.color_bar import color_bars
from sheetsplat.look.histogram import DIVERGING, choose_for

SMALL = {"size": 64, "backend": "cpu"}
EDGE = 32
# Along z what is at the corners of the box is background.
ENDING = ("tomogram", "padded", "component", "counts", "distance", "mask", "drifting")
# Without steps from one sample to the next.
SMOOTH = ("kelvin", "pascals", "component", "cut", "drifting", "decades")


def ball(size=EDGE):
    z, y, x = np.mgrid[-1 : 1 : size * 1j, -1 : 1 : size * 1j, -1 : 1 : size * 1j]
    return z, y, x, np.sqrt(x * x + y * y + z * z)


@pytest.mark.parametrize("name", KINDS)
def test_every_kind_shows_its_subject_with_limits_of_the_data(name):
    values = KINDS[name].make(EDGE)
    image = ss.render(values, **SMALL, **KINDS[name].options)
    alpha = image.rgba[..., 3]
    assert 0.005 < (alpha > 0.1).mean() < 0.75 and alpha.max() > 0.3
    low, high = (float(end(values)) for end in (np.nanmin, np.nanmax))
    (bar,) = color_bars(image)
    assert low <= bar.low < bar.high <= high
    # More than one colour.
    assert np.ptp(np.asarray(image)[alpha > 0.1][:, :3], axis=0).max() > 0.15


@pytest.mark.parametrize("name", ENDING)
def test_nothing_is_seen_of_the_box(name):
    field = ss.RegularField(KINDS[name].make(EDGE))
    middle = 0.5 * (EDGE - 1)
    camera = ss.Camera.orthographic((middle, middle, 3 * EDGE), (middle, middle, middle), (0, 1, 0), height=EDGE)
    alpha = ss.render(field, camera=camera, **SMALL).rgba[..., 3]
    corners = [alpha[rows, columns] for rows in (slice(6), slice(-6, None)) for columns in (slice(6), slice(-6, None))]
    assert max(map(np.max, corners)) < 0.02 and alpha.max() > 0.3


@pytest.mark.parametrize("name", SMOOTH)
def test_fields_are_near_an_exact_interpolation(name):
    pytest.importorskip("scipy")
    values = KINDS[name].make(48)
    field = prepare(values, quality="good", log=False, size=8).scene.fields[0]
    assert off_interpolation(values, field) <= 0.005


# Closed forms --------------------------------------------------------------------------------------------------------


def test_no_temperature_appears_that_is_not_in_the_data():
    _, y, x, r = ball(48)
    values = 280 + 20 * np.exp(-6 * r * r) + 3 * np.sin(5 * x) * np.cos(4 * y)
    slack = 0.005 * np.ptp(values)
    for mode in ("mip", "minimum", "average"):
        scalar = ss.render(values, mode=mode, **SMALL).scalar
        known = scalar[np.isfinite(scalar)]
        assert known.size > 500
        assert values.min() - slack <= known.min() and known.max() <= values.max() + slack


def test_a_ball_in_air_is_a_ball():
    values = np.where(ball(64)[3] < 0.7, 40.0, -1000.0)
    image = ss.render(values, mode="isosurface", iso_value=-300, size=128, backend="cpu")
    shown = (image.rgba[..., 3] > 0.5).sum() * (image.camera.height / 128) ** 2
    # Steps of the samples are a part of a sample away from the sphere.
    assert shown == pytest.approx(np.pi * (0.7 * 31.5) ** 2, rel=0.03)
    assert ss.render(values, **SMALL).rgba[[0, 0, -1, -1], [0, -1, 0, -1], 3].max() == 0.0


@pytest.mark.parametrize("quality", ["draft", "good"])
def test_drafts_of_pressure_are_no_grid_of_dots(quality):
    z, y, x, _ = ball(64)
    values = 101_300 + 300 * np.sin(4 * x) * np.cos(3 * y) * np.sin(3 * z)
    camera = ss.Camera.orthographic((31.5, 31.5, 200), (31.5, 31.5, 31.5), (0, 1, 0), height=50)
    image = ss.render(values, mode="average", quality=quality, camera=camera, **SMALL)
    # What is above the mean in the upper half is below it in the lower one.
    assert np.abs(image.scalar - 101_300).max() < 0.01 * 600
    depth = ss.render(values, mode="xray", quality=quality, camera=camera, **SMALL).scalar
    assert depth.std() < 1e-3 * depth.mean()


# Backgrounds ---------------------------------------------------------------------------------------------------------


def opacity(look, value):
    return float(np.interp(value, *np.transpose(look.opacity)))


def test_signed_values_are_shown_on_both_sides_of_zero():
    values = KINDS["component"].make(EDGE)
    look, turned = choose_for(values), choose_for(-values)
    assert look.cmap == DIVERGING and look.clim[0] == -look.clim[1]
    assert np.allclose(look.opacity, turned.opacity)
    assert opacity(look, 0) == 0 and opacity(look, look.clim[0]) == opacity(look, look.clim[1]) > 0.3
    image = ss.render(values, **SMALL)
    red, blue = (np.asarray(image)[..., at] for at in (0, 2))
    assert (red - blue).max() > 0.2 and (blue - red).max() > 0.2
    # Who names a map has it; unsigned values and those far from 0 have the usual one.
    assert ss.render(values, cmap="gray", **SMALL).recipe.transfer_functions[0].at(0)[0] == pytest.approx(0.5, abs=0.01)
    assert choose_for(np.abs(values)).cmap is None and choose_for(values + 100).cmap is None


def test_tomograms_are_not_signed():
    assert choose_for(tomogram(EDGE)).cmap is None


@pytest.mark.parametrize("padding", [-3024, -9999, 30_000])
def test_padding_does_not_change_a_look(padding):
    values = tomogram(EDGE).astype(float)
    _, y, x, _ = ball()
    plain, padded = choose_for(values), choose_for(np.where(x * x + y * y < 1, values, padding))
    assert np.allclose(padded.clim, plain.clim, atol=20) and padded.surface == pytest.approx(plain.surface, abs=20)


def test_a_background_of_one_value_is_no_padding():
    # A labelled object whose values begin far above 0, the number of all that is outside.
    *_, r = ball()
    values = np.where(r < 0.7, 600 + 400 * (r < 0.3), 0.0)
    look = choose_for(values)
    assert look.surface < 600 and opacity(look, 600) > 0.1


@pytest.mark.parametrize("classes", [(0, 1, 2), (0, 100, 200), (0, 1, 3), (0, 1, 2, 3), (0, 1, 2, 3, 4)])
def test_the_top_class_of_an_object_is_no_padding(classes, rng):
    *_, r = ball()
    values = np.zeros(r.shape)
    for number, value in enumerate(classes[1:]):
        values[r < 0.8 * (1 - number / (len(classes) - 1))] = value
    assert choose_for(values).clim[1] == classes[-1]
    # Nor is what saturates a detector inside of an object.
    body = tomogram(EDGE).astype(float)
    body[abs(r - 0.2) < 0.05] = 3071
    assert choose_for(body).clim[1] == pytest.approx(3071, rel=0.01)


@pytest.mark.parametrize("padding", [-3024, -9999])
def test_padding_is_no_base(padding):
    values = tomogram(EDGE)
    _, y, x, _ = ball()
    padded = np.where(x * x + y * y < 1, values, padding).astype(np.int16)
    image = ss.render(padded, **SMALL)
    assert ss.RegularField(padded).base == padding
    assert image.recipe.fields[0].options["base"] == pytest.approx(-1000, abs=30)
    assert ss.render(padded, base=-5.0, **SMALL).recipe.fields[0].options["base"] == -5


def test_volumes_are_counted_from_their_median():
    *_, r = ball()
    blob = np.exp(-9 * r * r)
    blob[0, 0, 0] = 1e-9
    image = ss.render(blob, **SMALL)
    base = image.recipe.fields[0].options["base"]
    assert base == pytest.approx(np.median(blob)) and ss.RegularField(blob).base > 0.4
    assert ss.render(blob, boundary="zero", **SMALL).recipe.fields[0].options["base"] is None
    # What nobody reconstructs is a sum from 0.
    image = ss.render(blob, normalization="none", **SMALL)
    assert image.recipe.fields[0].options["base"] is None
    # The value that many samples have is one.
    assert ss.render(np.where(r < 0.7, 40.0, -1000.0), **SMALL).recipe.fields[0].options["base"] is None


def test_limits_of_scattered_values_move_with_their_base(rng):
    centers = rng.uniform(-1, 1, (300, 3))
    values = 10 * np.exp(-((centers**2).sum(1)))
    clims = []
    for base in (0.0, 290.0):
        field = ss.EllipsoidField(centers, np.full(300, 0.3), values=base + values, base=base)
        clims.append(np.array(ss.render(field, **SMALL).clim) - base)
    assert np.allclose(*clims, atol=1e-6)
    with pytest.warns(ss.PictureWarning, match="fade to 0 where kernels end"):
        ss.render(ss.EllipsoidField(centers, np.full(300, 0.3), values=290 + values), **SMALL)


def test_volumes_that_add_up_and_end_in_different_places_are_told_of():
    *_, r = ball()
    values = 280 + 20 * np.exp(-6 * r * r)
    halves = [ss.RegularField(values[:, :, :16]), ss.RegularField(values[:, :, 16:], origin=(16, 0, 0))]
    with pytest.warns(ss.PictureWarning, match="end in different places"):
        ss.render(halves, **SMALL)


def test_dark_objects_in_a_bright_background_are_shown(rng):
    *_, r = ball()
    dark = 50 - 10 * np.exp(-9 * r * r) + 0.1 * rng.normal(size=r.shape)
    look, bright = choose_for(dark), choose_for(-dark)
    assert look.surface == -bright.surface and opacity(look, 41) > 0.3 and opacity(look, 50) == 0
    image = ss.render(dark, **SMALL)
    assert 0.05 < (image.rgba[..., 3] > 0.1).mean() < 0.75


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("spacing", [(1, 1, 1), (1, 1, 2)])
def test_distances_end_at_their_surface(sign, spacing):
    k, j, i = np.indices((16 if spacing[2] == 2 else 32, 32, 32))
    away = np.sqrt((i - 15.5) ** 2 + (j - 15.5) ** 2 + (spacing[2] * (k + 0.5) - 16) ** 2) - 10
    look = choose_for(sign * away, spacing=spacing)
    assert look.surface == 0 and opacity(look, 0) == 0
    assert opacity(look, -3 * sign) == pytest.approx(0.9) and opacity(look, 3 * sign) == 0
    # Squares of distances are none.
    assert choose_for(sign * np.sign(away) * away**2).surface != 0


# Time series ---------------------------------------------------------------------------------------------------------


def test_films_follow_a_background_that_drifts():
    film = ss.animate([drifting(EDGE, step) for step in range(4)], **SMALL)
    shown = [float((image.rgba[..., 3] > 0.1).mean()) for image in film]
    assert all(0.01 < share < 0.2 for share in shown) and len({image.clim for image in film}) == 1
    # Those of one background share their opacities too.
    still = [drifting(EDGE) + 0.1 * step for step in range(3)]
    functions = {image.recipe.transfer_functions[0] for image in ss.animate(still, **SMALL)}
    assert len(functions) == 1
