"""Scenes and cameras: what they take and what they refuse."""

from __future__ import annotations

import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat.framing import compose_camera

GRAY = ss.TransferFunction([(0, 0, 0, 0, 0), (1, 1, 1, 1, 1)])


@pytest.fixture
def field(ball):
    return ss.RegularField(ball, spacing=(1, 2, 3))


@pytest.mark.parametrize(
    "options",
    [
        {"slice_spacing": 0},
        {"slice_spacing": -1},
        {"slice_spacing": np.nan},
        {"slice_spacing": "1"},
        {"sampling": "line"},
        {"reference_length": 0},
        {"reference_length": np.inf},
        {"mode": "minip"},
        {"mode": "isosurface"},
        {"mode": "isosurface", "iso_value": np.nan},
        {"mode": "isosurface", "iso_value": ()},
        {"mode": "isosurface", "iso_value": "skin"},
        {"mode": "isosurface", "iso_value": (0.2, 0.5)},
        {"mode": "isosurface", "iso_value": [(0.2, 0.5, 1)]},
        {"mode": "isosurface", "iso_value": [(0.2, 1.5)]},
        {"mode": "isosurface", "iso_value": [(0.2, -0.1)]},
        {"mode": "isosurface", "iso_value": [(0.2, 1), (np.inf, 1)]},
        {"mode": "isosurface", "iso_value": [(0.2, np.nan)]},
        {"mode": "isosurface", "iso_value": ((n, 1) for n in itertools.count())},
        {"opacity_stop": 0},
        {"opacity_stop": 1.5},
        {"opacity_stop": np.nan},
        {"lights": ["head"]},
        {"material": "shiny"},
        {"background": (1, 1)},
        {"background": (1, np.nan, 1)},
        {"background": "no colour"},
        {"preintegration": "third_order"},
        {"preintegration": 2},
        {"gradient": "exact"},
        {"gradient_opacity": 0},
        {"gradient_opacity": "steep"},
        {"clip": ((0, 0, 1), 0)},
        {"depth_cue": (0, 1)},
        {"shadows": "yes"},
        {"ambient_occlusion": -3},
        {"ambient_occlusion": "near"},
    ],
)
def test_scene_options_without_meaning_are_refused(field, options):
    with pytest.raises(ss.InvalidInput, match="wanted"):
        ss.Scene(field, GRAY, **options)


@pytest.mark.parametrize(
    ("options", "sides"),
    [
        ({"mode": "xray", "shadows": True}, ("shadows", "xray")),
        ({"mode": "mip", "ambient_occlusion": ss.AmbientOcclusion(1)}, ("ambient_occlusion", "mip")),
        ({"mode": "mip", "depth_cue": ss.DepthCue(0, 1)}, ("depth_cue", "mip")),
        ({"mode": "xray", "gradient_opacity": 3}, ("gradient_opacity=3", "xray")),
        ({"mode": "isosurface", "iso_value": 1, "gradient_opacity": 3}, ("gradient_opacity=3", "isosurface")),
        ({"mode": "xray", "preintegration": "second_order"}, ("preintegration", "xray")),
        ({"shadows": True, "gradient_opacity": 3}, ("shadows", "gradient_opacity=3")),
        (
            {"ambient_occlusion": ss.AmbientOcclusion(1), "gradient_opacity": 3},
            ("ambient_occlusion", "gradient_opacity=3"),
        ),
    ],
)
def test_effects_that_contradict_name_both_sides(field, options, sides):
    with pytest.raises(ss.InvalidInput) as error:
        ss.Scene(field, GRAY, **options)
    assert all(side in str(error.value) for side in sides)


@pytest.mark.parametrize(
    "make",
    [
        lambda: ss.Clip(planes=[((0, 0, 0), 1)]),
        lambda: ss.Clip(planes=[((0, 0, 1), math.nan)]),
        lambda: ss.Clip(planes=[(0, 0, 1, 1)]),
        lambda: ss.Clip(planes=[((0, 1), 1)]),
        lambda: ss.Clip(planes="xyz"),
        lambda: ss.Clip(planes=(((0, 0, 1), n) for n in range(10**9))),
        lambda: ss.Clip(box=((1, 0, 0), (0, 1, 1))),
        lambda: ss.Clip(box=((0, 0, 0), (1, 1, math.inf))),
        lambda: ss.Clip(box=(0, 1)),
        lambda: ss.DepthCue(1, 1),
        lambda: ss.DepthCue(0, math.inf),
        lambda: ss.DepthCue(0, 1, strength=1.5),
        lambda: ss.DepthCue(0, 1, color="dark"),
        lambda: ss.DepthCue(0, 1, color=(0, 0, math.nan)),
        lambda: ss.AmbientOcclusion(0),
        lambda: ss.AmbientOcclusion(math.inf),
        lambda: ss.AmbientOcclusion(1, math.nan),
        lambda: ss.AmbientOcclusion("wide"),
    ],
)
def test_effects_without_meaning_are_refused(make):
    with pytest.raises(ss.InvalidInput, match="Clip|DepthCue|AmbientOcclusion"):
        make()


def test_effects_are_values(field):
    assert ss.Clip(planes=[((0, 0, 2), 1)]) == ss.Clip(planes=(((0.0, 0.0, 2.0), 1.0),))
    assert ss.Clip(box=((0, 0, 0), (1, 1, 1))) != ss.Clip()
    assert ss.DepthCue(0, 1) == ss.DepthCue(0.0, 1.0, (0, 0, 0), 1.0)
    assert hash(ss.AmbientOcclusion(2)) == hash(ss.AmbientOcclusion(2.0, 1.0))
    assert "radius=2.0" in repr(ss.AmbientOcclusion(2))


def test_scenes_are_replaced_by_others(field):
    scene = ss.Scene(field, GRAY, lights=iter([ss.Light()]), slice_spacing=0.5)
    other = scene.replace(mode="mip", lights=())
    assert (other.mode, other.lights, other.slice_spacing) == ("mip", (), 0.5)
    assert (scene.mode, scene.replace().lights) == ("composite", (ss.Light(),))
    with pytest.raises(ss.InvalidInput, match="colour"):
        scene.replace(colour=1)


RED = [(0, 1, 0, 0, 0), (1, 1, 0, 0, 1)]


def test_groups_have_transfer_functions_of_their_own(field):
    other = ss.RegularField(np.ones((2, 2, 2)))
    scene = ss.Scene([field, other], [GRAY, RED])
    assert scene.groups == ((field,), (other,)) and scene.fields == (field, other)
    assert scene.transfer_functions[0] is GRAY and scene.transfer_function is GRAY
    assert scene.transfer_functions[1].points[:, 1].tolist() == [1, 1]
    nested = ss.Scene([[field, other], field], (RED, GRAY), mode="isosurface", iso_value=[(0.2, 0.3), (0.6, 1)])
    assert nested.groups == ((field, other), (field,)) and nested.fields == (field, other, field)
    assert nested.iso_value == nested.surfaces == ((0.2, 0.3), (0.6, 1.0))
    changed = nested.replace(mode="composite", iso_value=0.5)
    assert changed.groups == nested.groups and changed.transfer_functions == nested.transfer_functions
    assert changed.surfaces == ((0.5, 1.0),)
    assert scene.replace(transfer_function=GRAY).groups == ((field, other),)
    assert ss.Scene(field, [GRAY]).groups == ((field,),)
    assert ss.Scene([[field, other]], RED).groups == ((field, other),)
    assert ss.Scene([field, other], np.asarray(RED)).groups == ((field, other),)


@pytest.mark.parametrize(
    ("groups", "functions", "parts"),
    [
        (2, [GRAY], ("groups of fields: 2, transfer functions: 1", "Scene([a, b], tf)")),
        (1, [GRAY, RED], ("groups of fields: 1, transfer functions: 2",)),
        (3, [GRAY, RED], ("groups of fields: 3, transfer functions: 2",)),
    ],
)
def test_groups_and_transfer_functions_fit_together(field, groups, functions, parts):
    with pytest.raises(ss.InvalidInput) as error:
        ss.Scene([field] * groups, functions)
    assert all(part in str(error.value) for part in parts)


def test_groups_need_fields(field):
    with pytest.raises(ss.InvalidInput, match="group 1 of field"):
        ss.Scene([[field], []], [GRAY, RED])
    with pytest.raises(ss.InvalidInput, match="group 0 of field"):
        ss.Scene([[field, None], field], [GRAY, RED])
    with pytest.raises(ss.InvalidInput, match="groups of fields: 2, transfer functions: 1"):
        ss.Scene([[field], field], GRAY)
    with pytest.raises(ss.InvalidInput, match="2 transfer functions"):
        ss.Scene([field, field], [GRAY, RED], preintegration="second_order")


@pytest.mark.gl
def test_packing_paper_has_sheets_of_one_group(field):
    scene = ss.Scene([field, field], [GRAY, RED])
    camera = ss.Camera.fit(field)
    paper = ss.Renderer("gl", packing="paper")
    with pytest.raises(ss.Unsupported) as error:
        paper.render(scene, camera, size=(8, 8))
    assert "packing paper for 2 transfer functions" in str(error.value) and 'packing="wide"' in str(error.value)
    assert ss.Renderer("gl").plan(scene, camera, size=(8, 8)).packing == "wide"
    assert paper.plan(scene.replace(mode="average"), camera, size=(8, 8)).packing == "paper"


def test_scalars_of_groups_add_up(field):
    camera = ss.Camera.fit(field)
    together = ss.Scene([field, field], GRAY, mode="xray")
    apart = together.replace(transfer_function=[GRAY, RED])
    for backend in ("cpu", "reference"):
        pictures = [ss.Renderer(backend).render(scene, camera, size=(9, 8)).scalar for scene in (together, apart)]
        assert pictures[0].max() > 0
        np.testing.assert_array_equal(*pictures)


@pytest.mark.parametrize("field", [None, [], "bonsai.nrrd", np.zeros((2, 2, 2)), [None]])
def test_scenes_need_fields(field):
    with pytest.raises(ss.InvalidInput, match="field"):
        ss.Scene(field, GRAY)


def test_scene_knows_what_it_will_use(field):
    scene = ss.Scene([field, field], [(0, 0, 0, 0, 0), (1, 1, 1, 1, 1)], lights=ss.Light())
    assert scene.slice_spacing == scene.reference_length == 1
    assert scene.fields == (field, field) and scene.lights == (ss.Light(),)
    assert scene.bounds == field.bounds
    assert scene.mode == "composite" and scene.background is None
    assert "composite" in repr(scene)
    assert ss.Scene(field, GRAY, slice_spacing=0.5, reference_length=2).slice_spacing == 0.5


@pytest.mark.parametrize(
    "arguments",
    [
        {"direction": (0, 0, 0)},
        {"direction": (0, 0)},
        {"direction": (0, 0, "z")},
        {"color": None},
        {"space": "camera"},
    ],
)
def test_lights_without_meaning_are_refused(arguments):
    with pytest.raises(ss.InvalidInput, match="Light"):
        ss.Light(**arguments)


def test_materials_without_meaning_are_refused(field):
    with pytest.raises(ss.InvalidInput, match="Material"):
        ss.Material(ambient="a")
    for bad in (math.nan, math.inf):
        with pytest.raises(ss.InvalidInput, match="wanted"):
            ss.Scene(field, GRAY, material=ss.Material(diffuse=bad), lights=[ss.Light()])


def test_lights_and_materials_are_values():
    assert ss.Light((0, 0, 1)) == ss.Light(np.array([0, 0, 1]))
    assert ss.Material() != ss.Material(specular=0.5)
    assert "specular=0.5" in repr(ss.Material(specular=0.5))
    with pytest.raises(AttributeError):
        ss.Material().ambient = 1


@pytest.mark.parametrize(
    "make",
    [
        lambda: ss.Camera.orthographic((0, 0, 0), (0, 0, 0), height=1),
        lambda: ss.Camera.orthographic((0, 0, 5), (0, 0, 0), (0, 0, 1), height=1),
        lambda: ss.Camera.orthographic((0, 0, 5), (0, 0, 0), (0, 0, 0), height=1),
        lambda: ss.Camera.orthographic((0, 0, 5), (0, 0, 0), height=0),
        lambda: ss.Camera.orthographic((0, 0, 5), (0, 0, 0), height=-1),
        lambda: ss.Camera.orthographic((0, 0, 5), (0, 0, 0), height=np.nan),
        lambda: ss.Camera.orthographic((0, np.inf, 5), (0, 0, 0), height=1),
        lambda: ss.Camera.orthographic((0, 0), (0, 0, 0), height=1),
        lambda: ss.Camera.perspective((0, 0, 0), (0, 0, 0), fov_y=30),
        lambda: ss.Camera.perspective((0, 0, 5), (0, 0, 0), (0, 0, -2), fov_y=30),
        lambda: ss.Camera.perspective((0, 0, 5), (0, 0, 0), fov_y=0),
        lambda: ss.Camera.perspective((0, 0, 5), (0, 0, 0), fov_y=180),
        lambda: ss.Camera.perspective((0, 0, 5), (0, 0, 0), fov_y=30, near=0),
        lambda: ss.Camera.perspective((0, 0, 5), (0, 0, 0), fov_y=30, near=-1),
        lambda: ss.Camera.fit([]),
        lambda: ss.Camera.fit(None),
        lambda: ss.Camera.fit(SimpleNamespace(bounds=((0, 0, 0), (1, 1, -1)))),
        lambda: ss.Camera.fit(SimpleNamespace(bounds=((0, 0, 0), (1, 1, np.nan)))),
        lambda: ss.Camera.fit(SimpleNamespace(bounds="abc")),
        lambda: ss.Camera.fit(SimpleNamespace(bounds=((0, 0, 0), (1, 1, 1))), (0, 0, 0)),
        lambda: ss.Camera.fit(SimpleNamespace(bounds=((0, 0, 0), (1, 1, 1))), (0, 1, 0)),
        lambda: ss.Camera.fit(SimpleNamespace(bounds=((0, 0, 0), (1, 1, 1))), kind="fisheye"),
        lambda: ss.Camera.fit(SimpleNamespace(bounds=((0, 0, 0), (1, 1, 1))), margin=0),
    ],
)
def test_cameras_without_meaning_are_refused(make):
    with pytest.raises(ss.InvalidInput, match="Camera"):
        make()


def test_cameras_know_what_they_are():
    camera = ss.Camera.perspective((0, 0, 4), (0, 0, 0), fov_y=40)
    assert (camera.kind, camera.eye, camera.fov_y) == ("perspective", (0, 0, 4), 40)
    assert math.isclose(camera.near, 4e-3)
    assert "fov_y=40" in repr(camera)
    camera = ss.Camera.orthographic((0, 0, 4), (0, 0, 0), height=3)
    assert (camera.kind, camera.height, camera.up) == ("orthographic", 3, (0, 1, 0))
    with pytest.raises(TypeError):
        ss.Camera()


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
def test_fit_shows_all_corners(field, kind):
    camera = ss.Camera.fit(field, (1, -0.5, -0.7), kind=kind)
    half = camera.height / 2 if kind == "orthographic" else math.tan(math.radians(camera.fov_y / 2))
    corners = np.array(np.meshgrid(*np.transpose(field.bounds))).reshape(3, -1).T
    for corner in corners:
        x, y, z = camera.native.to_eye(tuple(corner))
        reach = half if kind == "orthographic" else -z * half
        assert z < 0 and abs(x) <= reach and abs(y) <= reach


def test_fit_takes_anything_with_bounds(field):
    box = SimpleNamespace(bounds=field.bounds)
    scene = ss.Scene(field, GRAY)
    eyes = [
        ss.Camera.fit(one).eye
        for one in (field, [field], (field, box), box, scene, SimpleNamespace(bounds=lambda: field.bounds))
    ]
    assert len(set(eyes)) == 1


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
@pytest.mark.parametrize("size", [(40, 40), (80, 20), (20, 80)])
def test_pictures_of_any_shape_show_all(field, size, projection):
    camera = compose_camera(field, size, azimuth=40, elevation=-30, projection=projection)
    half = camera.height / 2 if projection == "orthographic" else math.tan(math.radians(camera.fov_y / 2))
    across = half * size[0] / size[1]
    reach_x = reach_y = 0.0
    for corner in np.array(np.meshgrid(*np.transpose(field.bounds))).reshape(3, -1).T:
        x, y, z = camera.native.to_eye(tuple(corner))
        depth = 1.0 if projection == "orthographic" else -z
        reach_x, reach_y = max(reach_x, abs(x) / depth / across), max(reach_y, abs(y) / depth / half)
    assert max(reach_x, reach_y) <= 1
    # And not much smaller than it could be.
    assert max(reach_x, reach_y) > (0.95 if projection == "orthographic" else 0.5)


def test_azimuth_and_elevation_turn_the_eye(field):
    def view(**options):
        camera = compose_camera(field, (40, 40), **options)
        offset = np.subtract(camera.eye, camera.target)
        return offset / np.linalg.norm(offset)

    # z is up unless something else is stated, and the first view the isometric one of PyVista and ParaView.
    assert np.allclose(view(), np.full(3, math.sqrt(1 / 3)))
    assert np.allclose(view(azimuth=0, elevation=0), (1, 0, 0))
    assert np.allclose(view(azimuth=90, elevation=0), (0, 1, 0))
    assert np.allclose(view(azimuth=0, elevation=30), (math.sqrt(0.75), 0, 0.5))
    assert np.allclose(view(up="y"), np.full(3, math.sqrt(1 / 3)))
    assert np.allclose(view(up="y", azimuth=0, elevation=0), (0, 0, 1))
    assert np.allclose(view(up="-y", azimuth=0, elevation=0), (0, 0, -1))
    assert np.allclose(view(azimuth=-90, elevation=0, up=(0, 0, 1), direction=(0, 1, 0)), (-1, 0, 0))
    assert np.allclose(view(direction=(1, 0, 0)), (-1, 0, 0))
    assert compose_camera(field, (40, 40), direction="-z").up == (0, 1, 0)


def test_zoom_enlarges(field):
    near, far = (compose_camera(field, (40, 40), zoom=zoom) for zoom in (2, 1))
    assert math.isclose(near.height * 2, far.height)
    near, far = (compose_camera(field, (40, 40), zoom=zoom, projection="perspective") for zoom in (2, 1))
    assert math.isclose(2 * math.tan(math.radians(near.fov_y / 2)), math.tan(math.radians(far.fov_y / 2)))
    for bad in (0, -1, math.nan, "2"):
        with pytest.raises(ss.InvalidInput, match="zoom"):
            compose_camera(field, (40, 40), zoom=bad)
    with pytest.raises(ss.InvalidInput, match="azimuth"):
        compose_camera(field, (40, 40), azimuth=math.inf)
    with pytest.raises(ss.InvalidInput, match="Camera"):
        compose_camera(field, (40, 40), direction="-z", up=(0, 0, 1))


def test_a_field_without_kernels_cannot_be_looked_at():
    empty = ss.RegularField(np.full((2, 2, 2), np.nan), nan="skip")
    with pytest.raises(ss.InvalidInput, match="nothing to look at: found no kernels in RegularField"):
        ss.Camera.fit(empty)
