"""Slice planes: values by plain arithmetic, depth order, all kinds of cameras, fields and options, bad input."""

from __future__ import annotations

import itertools
import json

import click.testing
import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat.cli.main import main
from sheetsplat.color_bar import color_bars
from sheetsplat.figure import plane_text
from sheetsplat.picking import Pick
from sheetsplat.planes_in_view import PlanesInView
from sheetsplat.tiles import window

SIDE, RADIUS, FALLOFF = 4.0, 7.0, 8.0
SIZE = (48, 40)
CLEAR = [(0, 0, 0, 0, 0), (1, 1, 1, 1, 0)]
RED = [(0.0, 1, 0, 0, 0), (0.7, 1, 0, 0, 0), (0.7, 1, 0, 0, 1), (1, 1, 0, 0, 1)]
GLASS = [(0.0, 1, 0, 0, 0.03), (1, 1, 0, 0, 0.03)]
ORTHOGRAPHIC = ss.Camera.orthographic((30, 8, 12), (0, 0, 0), (0, 0, 1), height=13)
PERSPECTIVE = ss.Camera.perspective((12, 5, 7), (0, 0, 0), (0, 0, 1), fov_y=50)
ALONG_Z = ss.Camera.orthographic((0, 0, 30), (0, 0, 0), (0, 1, 0), height=7)
TILTED = ss.SlicePlane((3, -1, 2), 0.9, clim=(0, 1))
CUBE = np.exp(-12 * sum(axis**2 for axis in np.mgrid[-0.5:0.5:12j, -0.5:0.5:12j, -0.5:0.5:12j])).astype(np.float32)


def one_kernel():
    """Return a kernel of height 1 in a box whose corners have kernels of height 0."""
    corners = list(itertools.product((-SIDE, SIDE), repeat=3))
    radii = [RADIUS, *[0.5] * 8]
    return ss.EllipsoidField([(0, 0, 0), *corners], radii, values=[1, *[0] * 8], normalization="none", falloff=FALLOFF)


def value_at(points):
    squared = (points**2).sum(axis=-1) / RADIUS**2
    return np.maximum(0, (np.exp(-FALLOFF * squared) - np.exp(-FALLOFF)) / (1 - np.exp(-FALLOFF)))


def rays(camera, columns=None, rows=None):
    """Return positions at depth 0, and what is added for each unit of depth, (h, w, 3), written down once more.

    Of the middles of pixels unless other places are given, whole numbers at the middles.
    """
    width, height = SIZE
    columns = np.arange(width) if columns is None else columns
    rows = np.arange(height) if rows is None else rows
    back = np.subtract(camera.eye, camera.target) / np.linalg.norm(np.subtract(camera.eye, camera.target))
    right = np.cross(camera.up, back) / np.linalg.norm(np.cross(camera.up, back))
    up = np.cross(back, right)
    x = (columns + 0.5 - width / 2)[None, :, None] / height
    y = -(rows + 0.5 - height / 2)[:, None, None] / height
    if camera.kind == "orthographic":
        start = np.asarray(camera.eye) + camera.height * (x * right + y * up)
        return start, np.broadcast_to(-back, start.shape)
    along = 2 * np.tan(np.radians(camera.fov_y) / 2) * (x * right + y * up) - back
    return np.broadcast_to(camera.eye, along.shape), along


def drawn(function, planes, camera=ALONG_Z, outputs=(), field=None, **options):
    scene = ss.Scene(field or one_kernel(), function, slice_planes=planes, **options)
    return ss.Renderer("cpu").render(scene, camera, SIZE, outputs)


@pytest.mark.parametrize("camera", [ORTHOGRAPHIC, PERSPECTIVE], ids=["orthographic", "perspective"])
def test_a_tilted_plane_shows_the_values_of_a_kernel(camera):
    image = drawn(CLEAR, TILTED, camera, ("depth",))

    def at(columns, rows):
        start, along = rays(camera, columns, rows)
        depths = (0.9 - start @ (3, -1, 2)) / (along @ (3, -1, 2))
        points = start + depths[..., None] * along
        inside = (np.abs(points) < SIDE).all(axis=-1)
        return points, np.where(inside, depths, np.inf), inside, np.where(inside, value_at(points), 0)

    columns, rows = np.arange(SIZE[0]), np.arange(SIZE[1])
    points, depths, inside, values = at(columns, rows)
    assert 300 < inside.sum() < 0.7 * inside.size
    quarters = [at(columns + a, rows + b)[2:] for a in (-0.25, 0.25) for b in (-0.25, 0.25)]
    beside = [at(columns + a, rows + b)[2:] for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    closer = sum((one != inside) | (np.abs(shown - values) > 1 / 16) for one, shown in beside) > 0
    assert 0.05 < closer.mean() < 0.5
    means = [sum(found) / 4 for found in zip(*quarters, strict=True)]
    expected = [np.where(closer, found, own) for own, found in zip((inside, values), means, strict=True)]
    assert (np.abs(expected[0] - inside) > 0.2).sum() > 20
    np.testing.assert_array_equal(image.rgba[..., 3], expected[0])
    np.testing.assert_allclose(image.rgba[..., 1], expected[1], atol=1e-3)
    np.testing.assert_allclose(image.depth, depths, rtol=1e-6)
    row, column = np.argwhere(inside)[200]
    found = image.pick(column, row)
    np.testing.assert_allclose(found.position, points[row, column], atol=1e-9)
    assert found.value == pytest.approx(value_at(points[row, column]), abs=1e-9) and found.opacity == 1.0


def test_planes_have_as_many_samples_as_the_picture():
    scene = ss.Scene(one_kernel(), CLEAR, slice_planes=TILTED, supersampling=2)
    image = ss.Renderer("cpu").render(scene, PERSPECTIVE, SIZE, ("depth",))
    columns, rows = np.arange(SIZE[0]), np.arange(SIZE[1])
    alpha, green = np.zeros(SIZE[::-1]), np.zeros(SIZE[::-1])
    for a, b in itertools.product((-0.25, 0.25), repeat=2):
        start, along = rays(PERSPECTIVE, columns + a, rows + b)
        points = start + ((0.9 - start @ (3, -1, 2)) / (along @ (3, -1, 2)))[..., None] * along
        inside = (np.abs(points) < SIDE).all(axis=-1)
        alpha, green = alpha + inside / 4, green + np.where(inside, value_at(points), 0) / 4
    assert ((alpha > 0) & (alpha < 1)).sum() > 30
    np.testing.assert_array_equal(image.rgba[..., 3], alpha)
    np.testing.assert_allclose(image.rgba[..., 1], green, atol=1e-3)


@pytest.mark.parametrize("backend", ["cpu", "gl"])
def test_ends_of_planes_in_a_volume_have_the_mean_of_their_pixel(backend, monkeypatch):
    """What is in front of a plane, and of what is behind its end, is drawn down to each."""
    planes = [ss.SlicePlane((1, 0, 0.2), 0.3, clim=(0, 1)), ss.SlicePlane((0.1, 1, 0), 1, clim=(0, 1))]
    scene = ss.Scene(one_kernel(), [(0.0, 1, 0, 0, 0.05), (1, 1, 0.5, 0, 0.3)], slice_planes=planes, background="white")
    renderer = ss.Renderer(backend)
    image = renderer.render(scene, PERSPECTIVE, SIZE)
    many = renderer.render(scene.replace(supersampling=8), PERSPECTIVE, SIZE)
    quarters = PlanesInView.of(scene, PERSPECTIVE, SIZE, None).quarters
    at = tuple(one[quarters.is_split] for one in quarters.at)
    assert 60 < len(at[0]) < 500
    error = np.sqrt(np.mean((image.rgba[at] - many.rgba[at]) ** 2))
    assert error < 0.04
    # One depth for all of such a pixel is farther off.
    monkeypatch.setattr(ss.Renderer, "_second", lambda *_: None)
    alone = renderer.render(scene, PERSPECTIVE, SIZE)
    assert np.sqrt(np.mean((alone.rgba[at] - many.rgba[at]) ** 2)) > 1.5 * error
    rest = np.ones(SIZE[::-1], bool)
    rest[at] = False
    np.testing.assert_array_equal(alone.rgba[rest], image.rgba[rest])


def test_planes_in_a_part_of_a_picture_are_those_of_the_whole():
    whole = drawn(GLASS, TILTED, PERSPECTIVE)
    scene = ss.Scene(one_kernel(), GLASS, slice_planes=TILTED)
    part = ss.Renderer("cpu").render(scene, window(PERSPECTIVE, SIZE, (11, 7), (20, 16)), (20, 16))
    np.testing.assert_allclose(part.rgba, whole.rgba[7:23, 11:31], atol=1e-6)


def test_a_goal_decides_for_both_pictures():
    scene = ss.Scene(one_kernel(), GLASS, slice_planes=TILTED)
    shares = []
    image = ss.Renderer("cpu", max_error=1e-3).render(scene, PERSPECTIVE, SIZE, progress=lambda one: shares.append(one))
    exact = ss.Renderer("cpu").render(scene.replace(slice_spacing=0.02, opacity_stop=1), PERSPECTIVE, SIZE)
    assert image.settings and np.sqrt(np.mean((image.rgba - exact.rgba) ** 2)) < 1e-3
    assert shares == sorted(shares) and shares[-1] == 1.0 and min(shares) < 0.5
    with pytest.raises(ss.Cancelled):
        ss.Renderer("cpu").render(scene, PERSPECTIVE, SIZE, progress=lambda share: share < 0.8)


@pytest.mark.parametrize("options", [{}, {"mode": "isosurface", "iso_value": 0.7}], ids=["composite", "isosurface"])
def test_an_opaque_ball_hides_the_plane_behind_it_and_is_hidden_by_the_one_before_it(options):
    row, column = SIZE[1] // 2, SIZE[0] // 2
    alone = drawn(RED, (), outputs=("depth",), opacity_stop=1, **options)
    behind = drawn(RED, ss.SlicePlane((0, 0, 1), -3, clim=(0, 1)), outputs=("depth",), opacity_stop=1, **options)
    np.testing.assert_array_equal(behind.rgba[row, column], alone.rgba[row, column])
    assert behind.depth[row, column] == alone.depth[row, column] < 30
    assert isinstance(found := alone.pick(column, row), Pick) and behind.pick(column, row) == found
    before = drawn(RED, ss.SlicePlane((0, 0, 1), 3, clim=(0, 1)), outputs=("depth",), opacity_stop=1, **options)
    np.testing.assert_allclose(before.rgba[row, column], [*[value_at(np.array([0, 0, 3.0]))] * 3, 1], atol=2e-3)
    assert before.depth[row, column] == 27 and before.pick(column, row).position[2] == pytest.approx(3)


@pytest.mark.parametrize("background", [None, (0.2, 0.4, 0.6)])
def test_half_transparent_volume_lies_before_the_plane_and_the_background_behind_it(background):
    plane, common = ss.SlicePlane((0, 0, 1), point=(9, 9, 0), clim=(0, 1)), {"opacity_stop": 1}
    image = drawn(GLASS, plane, background=background, **common)
    # What a depth limit leaves of the volume, and the plane's values behind it.
    scene = ss.Scene(one_kernel(), GLASS, **common)
    front = ss.Renderer("cpu").render(scene, ALONG_Z, SIZE, depth_limit=30.0).rgba
    start, _ = rays(ALONG_Z)
    points = start * (1, 1, 0)
    shown = front[..., :3] + (1 - front[..., 3:]) * value_at(points)[..., None]
    inside = (np.abs(points) < SIDE).all(axis=-1)
    assert 0.1 < front[SIZE[1] // 2, SIZE[0] // 2, 3] < 0.9
    np.testing.assert_allclose(image.rgba[inside, :3], shown[inside], atol=1e-3)
    assert (image.rgba[inside, 3] == 1).all()
    outside = ss.Renderer("cpu").render(scene.replace(background=background), ALONG_Z, SIZE).rgba
    np.testing.assert_allclose(image.rgba[~inside], outside[~inside], atol=1e-6)


@pytest.mark.parametrize(
    ("planes", "options"),
    [
        (ss.SlicePlane((0, 0, 1), 5), {}),
        (ss.SlicePlane((0, 0, 1), 0), {"clip": ss.Clip(planes=[((0, 0, 1), 1)])}),
        (ss.SlicePlane((1, 0, 0), 0.07), {}),
    ],
    ids=["outside of the data", "clipped", "seen along itself"],
)
def test_planes_that_nobody_sees_change_nothing(planes, options):
    image, plain = (drawn(GLASS, one, outputs=("depth",), **options) for one in (planes, ()))
    np.testing.assert_array_equal(image.rgba, plain.rgba)
    np.testing.assert_array_equal(image.depth, plain.depth)


def test_a_surface_that_was_drawn_elsewhere_hides_the_planes_behind_it():
    limit = np.full(SIZE[::-1], np.inf)
    limit[:, :24] = 28
    scene = ss.Scene(one_kernel(), CLEAR, slice_planes=ss.SlicePlane((0, 0, 1), clim=(0, 1)))
    image = ss.Renderer("cpu").render(scene, ALONG_Z, SIZE, depth_limit=limit)
    assert (image.rgba[:, :24] == 0).all() and (image.rgba[:, 24:40, 3] == 1).all()


def test_fields_that_add_up_are_summed_and_the_middle_is_that_of_all():
    along = np.mgrid[0:8, 0:8, 0:8][2]
    halves = [ss.RegularField(along / 4.0), ss.RegularField(along / 4.0)]
    camera = ss.Camera.orthographic((3.5, 3.5, 30), (3.5, 3.5, 0), (0, 1, 0), height=7)
    image = drawn(CLEAR, "orthogonal", camera, field=halves)
    planes = image.recipe.options["slice_planes"]
    assert [one.offset for one in planes] == [3.5] * 3 and planes[0].clim == (0, 3.5)
    middle = image.pick(24, 20)
    assert middle.position[2] == 3.5 and middle.value == pytest.approx(3.5 * image.rgba[20, 24, 0], abs=1e-5)
    assert middle.value == pytest.approx(middle.position[0] / 2, abs=0.05)


def test_labels_have_their_colours_on_a_plane():
    values = np.zeros((8, 8, 8), np.uint8)
    values[:, :, 4:] = 3
    colors = ss.LabelColors({3: (0.2, 0.9, 0.4, 0.0)}, names={3: "liver"})
    camera = ss.Camera.orthographic((3.5, 3.5, 30), (3.5, 3.5, 0), (0, 1, 0), height=6)
    plane = ss.SlicePlane((0, 0, 1), cmap=["blue", "white"])
    image = drawn(colors, plane, camera, field=ss.RegularField(values, labels=True))
    np.testing.assert_allclose(image.rgba[20, 30], (0.2, 0.9, 0.4, 1), atol=1e-6)
    np.testing.assert_allclose(image.rgba[20, 18], (0, 0, 1, 1), atol=1e-6)


def test_logarithms_have_limits_in_values_and_a_logarithmic_bar():
    values = 10.0 ** np.mgrid[0:8, 0:8, 0:8][2]
    planes = ss.SlicePlane((0, 0, 1), clim=(1, 1e7))
    image = ss.render(values, log=True, slice_planes=planes, opacity=0, direction=(0, 0, -1), up="y", size=SIZE)
    pick = image.pick(24, 20)
    assert image.rgba[20, 24, 1] == pytest.approx((pick.value + np.log10(image.recipe.fields[0].quantity.floor)) / 7)
    bar = color_bars(image)[-1]
    assert bar.log and (bar.low, bar.high) == (1, 1e7) and bar.label.endswith("on planes")


def test_volumes_in_bricks_have_planes(tmp_path):
    np.save(tmp_path / "cube.npy", CUBE)
    field = ss.open_bricks(tmp_path / "cube.npy", brick=8, quality="draft")
    whole = ss.open(tmp_path / "cube.npy", quality="draft")
    common = {"slice_planes": (ss.SlicePlane((1, 2, 3), cmap="viridis"),), "background": "white"}
    options = {"size": SIZE, "projection": "perspective", "backend": "cpu", **common}
    pictures = [ss.render(one, quality="draft", cmap="gray", clim=(0, 1), **options) for one in (field, whole)]
    np.testing.assert_allclose(pictures[0].rgba, pictures[1].rgba, atol=2e-3)
    assert isinstance(pictures[0].pick(24, 20), Pick)


def test_a_picture_says_its_planes_and_is_made_again(tmp_path):
    picture, again, data = tmp_path / "a.png", tmp_path / "b.png", tmp_path / "cube.npy"
    np.save(data, CUBE)
    given = ["--slice-plane", "1,0,0.5,6", "--slice-planes", "orthogonal", "--size", "40", "--backend", "cpu"]
    assert click.testing.CliRunner().invoke(main, ["render", str(data), *given, "-o", str(picture)]).exit_code == 0
    planes = ss.Recipe.read(picture).options["slice_planes"]
    assert [one.offset for one in planes] == [6, 5.5, 5.5, 5.5] and planes[0].normal == (1, 0, 0.5)
    done = click.testing.CliRunner().invoke(main, ["render", str(picture), str(data), "-o", str(again)])
    assert done.exit_code == 0 and again.read_bytes() == picture.read_bytes()
    scene = ss.SceneFile.of(ss.Recipe.read(picture), data)
    assert ss.SceneFile.parse(scene.to_toml()).render(CUBE, backend="cpu").recipe.options["slice_planes"] == planes
    word = ss.SceneFile.parse('format = 1\n[look]\nslice_planes = "orthogonal"\n')
    assert word.render(CUBE, size=16).recipe.options["slice_planes"][1].offset == 5.5
    assert json.loads(ss.Recipe.read(picture).to_json())["scene"]["slice_planes"][0]["offset"] == 6


def test_colours_of_planes_that_have_none_of_their_own(tmp_path):
    options = {"opacity": 0, "direction": (0, 0, -1), "up": "y", "size": SIZE}
    own = ss.SlicePlane((0, 0, 1), cmap="viridis", clim=(0, 0.5))
    expected = ss.render(CUBE, slice_planes=own, **options)
    given = ss.render(CUBE, slice_planes=ss.SlicePlane((0, 0, 1)), slice_cmap="viridis", slice_clim=(0, 0.5), **options)
    np.testing.assert_array_equal(given.rgba, expected.rgba)
    assert given.recipe.options["slice_planes"] == expected.recipe.options["slice_planes"]
    kept = ss.render(CUBE, slice_planes=own, slice_cmap="magma", slice_clim=(0, 9), **options)
    np.testing.assert_array_equal(kept.rgba, expected.rgba)
    gray = ss.render(CUBE, slice_planes=ss.SlicePlane((0, 0, 1)), **options).recipe.options["slice_planes"][0]
    assert gray.cmap == "gray" and gray.clim == pytest.approx((CUBE.min(), CUBE.max()))
    np.save(tmp_path / "cube.npy", CUBE)
    common = [str(tmp_path / "cube.npy"), "--size", "48x40", "--opacity", "0", "--slice-plane", "0,0,1,5.5"]
    colors = (
        (["--slice-cmap", "viridis", "--slice-clim", "0,0.5"], "viridis", (0, 0.5)),
        (["--slice-cmap", "0:black,0.5:red"], ((0, 0, 0), (1, 0, 0)), (0, 0.5)),
    )
    for flags, cmap, clim in colors:
        picture = tmp_path / "a.png"
        done = click.testing.CliRunner().invoke(main, ["render", *common, *flags, "-o", str(picture)])
        assert done.exit_code == 0, done.output
        (plane,) = ss.Recipe.read(picture).options["slice_planes"]
        assert plane.clim == clim and (plane.cmap == cmap or (plane.cmap[0][:3], plane.cmap[-1][:3]) == cmap)


def test_colours_of_planes_that_are_not_there_are_told():
    with pytest.warns(ss.PictureWarning, match="slice_cmap changes nothing without slice_planes="):
        ss.render(CUBE, slice_cmap="viridis", size=8)
    with pytest.raises(ss.InvalidInput, match="its colours cannot be used.*the lower one first"):
        ss.render(CUBE, slice_planes="orthogonal", slice_clim=(2, 1), size=8)


def test_a_figure_says_where_planes_are():
    field = ss.RegularField(CUBE, spacing=(0.5, 0.5, 2)).with_quantity(length_unit="mm")
    image = ss.render(field, slice_planes="orthogonal", size=32)
    assert plane_text(image) == "planes at x = 2.75 mm, y = 2.75 mm, z = 11 mm"
    assert color_bars(image)[-1].label == "value on planes"
    assert plane_text(ss.render(field, slice_planes=TILTED, size=32)) == ""


def test_a_scalar_mode_says_that_it_has_no_planes():
    with pytest.warns(ss.PictureWarning, match="mode mip does not use these options: slice_planes"):
        image = ss.render(CUBE, slice_planes="orthogonal", mode="mip", size=16)
    np.testing.assert_array_equal(image.scalar, ss.render(CUBE, mode="mip", size=16).scalar)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((0, 0, 0),), "normal.* wanted a finite normal"),
        (((np.nan, 0, 1),), "normal.* wanted a finite normal"),
        (((0, 0, 1), np.inf), "offset.* wanted a finite number"),
        (((0, 0, 1), None, (0, np.nan, 0)), "point.* wanted three finite numbers"),
        (((0, 0, 1), 1, (0, 0, 0)), "offset and point cannot be used together"),
        (((0, 0, 1), 1, None, "no such map"), "its colours cannot be used.*no such map"),
        (((0, 0, 1), 1, None, "gray", (2, 1)), "its colours cannot be used.*the lower one first"),
    ],
)
def test_planes_that_are_none(arguments, message):
    with pytest.raises(ss.InvalidInput, match=message):
        ss.SlicePlane(*arguments)


@pytest.mark.parametrize(
    ("planes", "message"),
    [
        ([ss.SlicePlane((0, 0, 1))] * 65, "more than 64 planes"),
        ("across", 'wanted a SlicePlane, a sequence of them, or "orthogonal"'),
        ([(0, 0, 1, 2)], "wanted a SlicePlane"),
    ],
)
def test_options_that_are_no_planes(planes, message):
    with pytest.raises(ss.InvalidInput, match=message):
        ss.Scene(one_kernel(), CLEAR, slice_planes=planes)


def test_groups_and_colours_have_no_planes():
    field = ss.RegularField(CUBE)
    scene = ss.Scene([field, field], [ss.TransferFunction(CLEAR)] * 2, slice_planes="orthogonal")
    with pytest.raises(ss.Unsupported, match="slice planes cannot be drawn: found 2 groups of fields"):
        ss.Renderer("cpu").render(scene, ALONG_Z, SIZE)
    with pytest.raises(ss.Unsupported, match="a volume of colours"):
        ss.render(np.stack([CUBE] * 3, axis=-1), slice_planes="orthogonal", size=16)
