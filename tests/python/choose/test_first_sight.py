"""What a picture is when nothing but data was given: outliers, gases, surfaces, meshes, every measured set."""

from __future__ import annotations

import logging
import re

import numpy as np
import pytest
from command_line import run

import sheetsplat as ss
from bench.first_sight import SETS
from sheetsplat.choose.look import compose_scene
from sheetsplat.cli import info
from sheetsplat.color_bar import color_bars
from sheetsplat.io.opening import read_scattered
from sheetsplat.io.triangle_meshes import without_holes
from sheetsplat.look import automatic, histogram
from sheetsplat.look.empty import why_one_color
from sheetsplat.look.measure import coarse_picture
from sheetsplat.look.surface import surface_color, surface_limits
from sheetsplat.look.transparency import DEPTH, median_depth, see_through

SMALL = {"size": (48, 48), "backend": "cpu"}


def fuzzy_ball(rng, size=36):
    """Return a ball that fades outwards, in a little noise."""
    away = np.sqrt(sum((part - 0.5 * (size - 1)) ** 2 for part in np.indices((size, size, size))))
    return (np.clip(1.2 - away / (0.33 * size), 0, 1) + 0.02 * rng.random(away.shape)).astype(np.float32)


def cloud(rng, count=2000):
    """Return centres and values of kernels that are densest in the middle."""
    centers = rng.normal(size=(count, 3))
    return centers, np.exp(-np.linalg.norm(centers, axis=1))


def shown(image):
    return float((image.rgba[..., 3] > 0.1).mean())


# Outliers ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [1e6, -1e6, 1e9])
def test_one_hot_sample_does_not_rule_the_range(rng, value):
    values = fuzzy_ball(rng)
    hot = values.copy()
    hot[3, 4, 5] = value
    plain, found = (automatic.choose([ss.RegularField(one)]) for one in (values, hot))
    assert np.allclose(found.clim, plain.clim, atol=0.02) and found.surface == pytest.approx(plain.surface, abs=0.02)
    pictures = [ss.render(one, camera=ss.Camera.fit(ss.RegularField(values)), **SMALL) for one in (values, hot)]
    assert shown(pictures[0]) > 0.1 and shown(pictures[1]) == pytest.approx(shown(pictures[0]), abs=0.05)
    # Alone it would be all that is seen.
    assert (histogram._choose(hot.ravel().astype(float), even=False, extremes=False).clim[1] > 1e4) == (value > 0)


@pytest.mark.parametrize("value", [1e30, -9.97e36])
def test_samples_beyond_all_pictures_are_told(rng, value):
    # Far from 0, so that they are not shown as logarithms.
    values = 1 + fuzzy_ball(rng, 16)
    values[3, 4, 5] = value
    with pytest.warns(ss.PictureWarning, match=f'1 sample, {re.escape(f"{value:g}")} at.*nan="skip"'):
        ss.render(values, **SMALL)
    values[3, 4, 5] = np.nan
    assert shown(ss.render(values, nan="skip", **SMALL)) > 0.1


def test_one_hot_particle_does_not_rule_the_range(rng):
    centers, values = cloud(rng)
    hot = values.copy()
    hot[np.argmax(np.linalg.norm(centers, axis=1))] = 1e6
    fields = [ss.EllipsoidField(centers, 0.6, values=one) for one in (values, hot)]
    plain, found = (automatic.choose([one]) for one in fields)
    assert np.allclose(found.clim, plain.clim, atol=0.02)
    pictures = [ss.render(one, camera=ss.Camera.fit(fields[0]), **SMALL) for one in fields]
    assert shown(pictures[0]) > 0.03 and shown(pictures[1]) == pytest.approx(shown(pictures[0]), abs=0.05)


def test_a_small_bright_object_is_no_outlier(rng):
    values = rng.random((48, 48, 48)).astype(np.float32)
    values[20:22, 30:32, 10:12] = 1000
    assert automatic.choose([ss.RegularField(values)]).surface > 1
    # Eight such samples apart from each other are outliers.
    values = rng.random((48, 48, 48)).astype(np.float32)
    values[::24, ::24, 5:45:20] = 1000
    assert automatic.choose([ss.RegularField(values)]).clim[1] <= 1


def test_what_is_everywhere_the_same_but_in_one_place_is_shown():
    values = np.zeros((24, 24, 24))
    values[11:14, 11:14, 11:14] = 1e6
    assert shown(ss.render(values, **SMALL)) > 0.1


def test_the_whole_range_is_shown_where_that_costs_little():
    background = np.zeros(30_000)
    wide, far = (np.concatenate((background, np.linspace(50, 100, 3000), np.full(20, top))) for top in (140, 1000))
    tops = [histogram.choose_for(one, extremes=whole).clim[1] for one in (wide, far) for whole in (True, False)]
    assert tops[0] == 140 and max(tops[1:]) < 105 and min(tops) > 95


def test_limits_of_scalar_pictures_leave_out_hot_pixels(rng):
    numbers = rng.random((60, 60)).astype(np.float32)
    colors = ss.ScalarColors()
    assert colors.limits(numbers) == (0, pytest.approx(1, abs=0.01))
    numbers[5, 5] = 1e6
    assert colors.limits(numbers) == (0, pytest.approx(1, abs=0.01))
    numbers[6, 6] = -1e6
    assert colors.limits(numbers) == (pytest.approx(0, abs=0.01), pytest.approx(1, abs=0.01))
    # A tenth of the numbers is no outlier, and neither is all that is not 0.
    numbers[:6] = 1000
    assert colors.limits(numbers)[1] == 1e6 or colors.limits(numbers)[1] == 1000
    lone = np.zeros((60, 60), np.float32)
    lone[3, 3] = 7
    assert colors.limits(lone) == (0, 7) and colors.limits(np.zeros((4, 4), np.float32)) == (0, 1)


# Gases and solids ----------------------------------------------------------------------------------------------------


def test_slices_do_not_show_on_solids(rng):
    """Where all kernels have one value, opacity rises within a fraction of a kernel: usual slices leave contours."""
    places = rng.uniform(-1, 1, (3000, 3))
    ball = places[np.linalg.norm(places, axis=1) < 1]
    solid = ss.EllipsoidField(ball, 0.3, values=np.full(len(ball), 5.0), w0=0.5)
    images = {
        more: ss.render(solid, slice_spacing=more and 0.15 / more, size=96, backend="cpu") for more in (2, None, 64)
    }
    assert images[None].plan.slice_spacing == pytest.approx(0.15 / 8)
    off = {more: np.sqrt(np.mean((image.rgba - images[64].rgba) ** 2)) for more, image in images.items()}
    assert off[None] < 0.35 * off[2]


def plume_in_a_layer(rng, scale=1.0):
    """Return a thick hot layer under a ceiling, and a hotter plume that ends in it."""
    room = rng.uniform((0, 0, 0), (6, 6, 4), (9000, 3))
    values = np.where(room[:, 2] > 1.5, 560.0, 300.0) + rng.normal(size=len(room))
    plume = np.hypot(room[:, 0] - 1, room[:, 1] - 1) < 0.7
    return ss.EllipsoidField(scale * room, 0.6 * scale, values=np.where(plume, 690.0, values))


@pytest.mark.parametrize("scale", [1.0, 1e-6])
def test_rays_go_through_gases(rng, scale):
    field = plume_in_a_layer(rng, scale)
    look = automatic.choose([field])
    length = field.default_slice_spacing
    assert median_depth(look, field, length, 9000) == pytest.approx(DEPTH, rel=0.1)
    # From any opacities to the same ones.
    for factor in (0.2, 4.0):
        other = histogram.scaled_opacity(look, factor)
        assert not 0.5 * DEPTH < median_depth(other, field, length, 9000) < 2 * DEPTH
        assert see_through(other, field, length, 9000).top_opacity == pytest.approx(look.top_opacity, rel=0.1)


def test_measured_depths_are_those_of_the_picture(rng):
    field = plume_in_a_layer(rng)
    look = automatic.choose([field])
    scene = compose_scene([field], shading=False, opacity_stop=1.0)
    images = [ss.Renderer("cpu").render(scene, ss.Camera.fit(field, axis, "z" if axis != "z" else "y"), (48, 48))
              for axis in "xyz"]  # fmt: skip
    alpha = np.concatenate([one.rgba[..., 3].ravel() for one in images])
    depths = -np.log1p(-np.minimum(alpha[alpha > 0.05], 1 - 1e-6))
    # Of rays through the soft rim few are measured.
    assert 0.5 < np.median(depths) / median_depth(look, field, field.default_slice_spacing, 9000) < 2


def test_the_plume_is_seen_through_the_layer(rng):
    field = plume_in_a_layer(rng)
    # Along y from far behind: the layer is in front of the plume everywhere.
    camera = ss.Camera.orthographic((3, 30, 2.7), (3, 0, 2.7), (0, 0, 1), height=2)
    colors = [np.asarray(ss.render(field, camera=camera, shading=False, **SMALL, **more)) for more in ({}, OPAQUE)]
    # The plume is to the right, where x is 1; beside it the layer is alone.
    apart = [np.abs(one[:, 44, :3].mean(axis=0) - one[:, 5, :3].mean(axis=0)).max() for one in colors]
    camera_x = ss.Camera.orthographic((1, 30, 2.7), (1, 0, 2.7), (0, 0, 1), height=2)
    middle = [np.asarray(ss.render(field, camera=camera_x, shading=False, **SMALL, **m)) for m in ({}, OPAQUE)]
    apart = [np.abs(one[:, 20:28, :3].mean(axis=(0, 1)) - one[:, :3, :3].mean(axis=(0, 1))).max() for one in middle]
    assert apart[0] > 0.05 and apart[1] < 0.5 * apart[0]


OPAQUE = {"opacity": [(400, 0), (500, 0.5), (700, 0.5)], "clim": (400, 700)}


def test_kernels_of_one_value_keep_their_surface(rng):
    field = ss.EllipsoidField(rng.uniform(-1, 1, (4000, 3)), 0.25, values=np.full(4000, 7.0))
    look = automatic.choose([field])
    assert median_depth(look, field, field.default_slice_spacing, 9000) > 3 * DEPTH


def test_coarse_pictures_keep_sums():
    places = np.array([(0.0, 0.0), (4.0, 2.0), (4.0, 2.0)])
    picture, cells = coarse_picture(places, np.array([1.0, 2.0, 3.0]))
    assert picture[tuple(cells[0])] * 5 == pytest.approx(picture[tuple(cells[1])]) and picture.shape == (12, 6)
    area = 4.0 * 2.0 / picture.size
    assert picture.sum() * area == pytest.approx(6)


# Limits and colour bars ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("iso", [0, 1, 3, 34, 128, 200, 250, 254, 255])
def test_limits_of_a_surface_are_values_of_the_data(iso):
    field = ss.RegularField(np.arange(256, dtype=np.uint8).reshape(4, 8, 8))
    low, high = surface_limits([field], iso)
    if 0 < iso < 255:
        assert 0 <= low < iso < high <= 255 and high - low >= 0.05 * 255
    if 10 < iso < 250:
        scene = compose_scene([field], mode="isosurface", iso_value=iso, cmap="gray")
        assert surface_color(scene, iso) == pytest.approx((0.7, 0.7, 0.7), abs=0.01)


def two_groups(rng, limits=(0.0, 1.0)):
    fields = [ss.RegularField(rng.random((6, 6, 6)) + n).with_quantity(f"field {n}") for n in range(2)]
    functions = [[(limits[0], 1, 0, 0, 0.3), (limits[1], 1, 1, 0, 0.5)], [(1.0, 0, 0, 1, 0.3), (2.0, 0, 1, 1, 0.5)]]
    return ss.Scene(fields, functions)


def test_colour_bars_stand_close(rng):
    pytest.importorskip("matplotlib")
    scene = two_groups(rng)
    image = ss.Renderer("reference").render(scene, ss.Camera.fit(scene), size=(40, 120))
    assert len(color_bars(image)) == 2
    drawn = np.asarray(image.annotated(axes=False, scale_bar=False))
    empty = (drawn == 255).all(axis=(0, 2))
    inked = np.flatnonzero(~empty)
    gaps = np.diff(inked)
    # A gap is at most as wide as the largest letters, some fifteen pixels.
    assert gaps.max() < 20


def test_one_colour_is_told_for_groups_and_sums(rng):
    scene = two_groups(rng, (5.0, 9.0))
    camera = ss.Camera.fit(scene)
    with pytest.warns(ss.PictureWarning, match="one colour.*of group 0, .* lie below the range 5 to 9"):
        ss.Renderer("reference").render(scene, camera, size=(8, 8))
    centers = rng.normal(size=(60, 3))
    sums = ss.EllipsoidField(centers, 1.0, values=np.full(60, 0.5), normalization="none")
    with pytest.warns(ss.PictureWarning, match="one colour.* lie below the range 90 to 95"):
        ss.render(sums, clim=(90, 95), opacity=0.5, **SMALL)
    # They reach 2, although each alone is 0.5.
    scene = ss.Scene(sums, [(1.0, 1, 0, 0, 0.5), (2.0, 1, 1, 1, 0.5)])
    assert why_one_color(ss.Renderer("cpu").render(scene, ss.Camera.fit(scene), (8, 8)), scene) == ""


def test_info_tells_the_logarithm(rng, tmp_path):
    values = np.concatenate([10 ** rng.uniform(0, 1, 50), 10 ** rng.uniform(6, 7, 50)])
    field = ss.EllipsoidField(rng.normal(size=(100, 3)), 1.0, values=values)
    path = tmp_path / "a.npz"
    ss.io.save_npz(field, path)
    text = run("info", path).stdout
    line = next(one for one in text.splitlines() if one.startswith("shown"))
    image = ss.render(path, **SMALL)
    floor, clim = image.recipe.fields[0].quantity.floor, image.clim
    assert f"log10(values / {floor:g}) from {clim[0]:g} to {clim[1]:g}" in line
    assert f"that is {floor * 10 ** clim[0]:g} to {floor * 10 ** clim[1]:g}" in line
    # Where the logarithm is declined, the values themselves.
    assert "log10" not in run("info", path, "--no-log").stdout
    assert info.describe(ss.EllipsoidField(field.centers, 1.0, values=np.linspace(1, 2, 100)), 4).get("log") is None
    wide = np.exp(6 * rng.normal(size=(20, 20, 20))).astype(np.float32)
    np.save(tmp_path / "v.npy", wide)
    shown_as = run("info", tmp_path / "v.npy").stdout
    assert ("log10(value / " in shown_as) == bool(ss.render(tmp_path / "v.npy", **SMALL).plan.notes)


# Meshes --------------------------------------------------------------------------------------------------------------

CORNERS = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
QUADS = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]


def box_obj(faces):
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS]
    return "\n".join([*lines, *(f"f {' '.join(str(n + 1) for n in face)}" for face in faces)]) + "\n"


def box_ply(faces):
    header = f"ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"  # noqa: F541
    header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [f"{x} {y} {z}" for x, y, z in CORNERS] + [f"4 {' '.join(map(str, face))}" for face in faces]
    return header + "\n".join(rows) + "\n"


@pytest.mark.parametrize("suffix", [".obj", ".ply"])
@pytest.mark.parametrize("count", [6, 5])
def test_meshes_are_filled(tmp_path, suffix, count, caplog):
    caplog.set_level(logging.INFO, "sheetsplat")
    path = tmp_path / f"box{suffix}"
    path.write_text((box_obj if suffix == ".obj" else box_ply)(QUADS[:count]))
    data = read_scattered(path)
    assert data.format == "mesh" and ("holes" in data.details) == (count == 5) == ("holes" in caplog.text)
    field = ss.open(path)
    assert field.orientation == (ss.Orientation("y") if suffix == ".obj" else None)
    assert np.allclose(np.array(field.centre_bounds), [(0, 0, 0), (1, 1, 1)], atol=0.06)
    image = ss.render(path, **SMALL)
    assert image.rgba[20:28, 20:28, 3].min() > 0.9 and shown(image) > 0.3


def test_holes_are_closed_and_other_edges_stay():
    points = np.array(CORNERS, float)
    faces = np.array([(a, b, c) for a, b, c, _ in QUADS] + [(a, c, d) for a, _, c, d in QUADS])
    assert without_holes(points, faces)[2] == 0
    vertices, triangles, holes = without_holes(points, np.delete(faces, [5, 11], axis=0))
    assert holes == 1 and len(vertices) == 9 and np.allclose(vertices[8], (1, 0.5, 0.5)) and len(triangles) == 14
    assert ss.fit.solid(vertices, triangles, kernels=500).report["mesh_volume"] == pytest.approx(1)
    # Triangles that disagree about their direction, and edges that form no chain, are left to the fit's message.
    turned = np.delete(faces, [5, 11], axis=0)
    turned[0] = turned[0][::-1]
    with pytest.raises(ss.InvalidInput, match="boundary edges"):
        ss.fit.solid(*without_holes(points, turned)[:2])


# Measured sets -------------------------------------------------------------------------------------------------------


@pytest.mark.data
@pytest.mark.parametrize("name", SETS)
def test_every_measured_set_is_seen_and_framed(name, data_dir):
    one = SETS[name]
    path = data_dir / one.file
    if not path.exists():
        pytest.skip(f"{path} is not there")
    more = {} if one.grid is None else {"grid": data_dir / one.grid}
    # What quality sets changes neither colours nor framing.
    image = ss.render(path, size=(60, 60), backend="cpu", quality="draft", **more)
    alpha = image.rgba[..., 3] > 0.1
    rows, columns = np.flatnonzero(alpha.any(axis=1)), np.flatnonzero(alpha.any(axis=0))
    assert 0.02 < alpha.mean() < 0.9
    assert max(np.ptp(rows), np.ptp(columns)) + 1 >= 0.8 * 60
    # Nothing that can be seen well lies at the edges of the picture.
    edges = np.concatenate([image.rgba[side, :, 3] for side in (0, -1)] + [image.rgba[:, side, 3] for side in (0, -1)])
    assert (edges > 0.3).mean() < 0.03
    # More than one colour, unless all values are one.
    colors = np.asarray(image)[alpha][:, :3]
    assert np.ptp(colors, axis=0).max() > 0.2
