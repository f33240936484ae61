"""Which way up pictures are: what files state, and how much of a picture is filled by what can be seen."""

import pickle

import numpy as np
import pytest
from scattered_files import ply_bytes, stored
from test_io import VALUES, meta_header, nrrd_header

import sheetsplat as ss
from sheetsplat.choose.look import compose_scene
from sheetsplat.framing import compose_camera

PATIENT = ss.Orientation((0, 0, 1), (0, -1, 0))
STEPS = "(1,0,0) (0,2,0) (0,0,3)"


def seen_from(field, **options):
    """Return the unit vector from the target to the eye, and the up direction."""
    camera = compose_camera(field, (40, 40), **options)
    offset = np.subtract(camera.eye, camera.target)
    return offset / np.linalg.norm(offset), camera.up


@pytest.mark.parametrize(
    ("space", "up", "front"),
    [
        ("left-posterior-superior", (0, 0, 1), (0, -1, 0)),
        ("right-anterior-superior", (0, 0, 1), (0, 1, 0)),
        ("left-anterior-superior", (0, 0, 1), (0, 1, 0)),
        ("right-anterior-superior-time", (0, 0, 1), (0, 1, 0)),
        ("RAS", (0, 0, 1), (0, 1, 0)),
        ("LPST", (0, 0, 1), (0, -1, 0)),
        ("RAX", None, None),
        ("scanner-xyz", None, None),
        ("3D-right-handed", None, None),
        ("left-right-superior", None, None),
    ],
)
def test_nrrd_spaces(tmp_path, space, up, front):
    header = nrrd_header(space=space, space_directions=STEPS, spacings=None)
    (tmp_path / "a.nrrd").write_bytes(header.encode() + VALUES.tobytes())
    field = ss.open(tmp_path / "a.nrrd")
    assert field.orientation == (None if up is None else ss.Orientation(up, front))
    if up is not None:
        # Head up, seen from the front.
        eye, picture_up = seen_from(field)
        assert np.allclose(eye, front) and picture_up == up


def test_an_nrrd_file_without_a_space_states_nothing(tmp_path):
    (tmp_path / "a.nrrd").write_bytes(nrrd_header().encode() + VALUES.tobytes())
    assert ss.open(tmp_path / "a.nrrd").orientation is None


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({}, None),
        ({"AnatomicalOrientation": "???"}, None),
        ({"AnatomicalOrientation": "RAI"}, PATIENT),
        ({"AnatomicalOrientation": "LPS"}, PATIENT),
        ({"AnatomicalOrientation": "RAS"}, ss.Orientation((0, 0, 1), (0, 1, 0))),
        ({"AnatomicalOrientation": "LIP"}, ss.Orientation((0, -1, 0), (0, 0, -1))),
        ({"TransformMatrix": "-1 0 0 0 1 0 0 0 1"}, PATIENT),
    ],
)
def test_metaimage_orientations(tmp_path, fields, expected):
    (tmp_path / "a.mha").write_bytes(meta_header(**fields).encode() + VALUES.tobytes())
    assert ss.open(tmp_path / "a.mha").orientation == expected


def test_metaimage_axes_are_put_along_those_of_the_world(tmp_path):
    # The file's first axis runs along y, its second along -x.
    header = meta_header(TransformMatrix="0 1 0 -1 0 0 0 0 1")
    (tmp_path / "a.mha").write_bytes(header.encode() + VALUES.tobytes())
    field = ss.open(tmp_path / "a.mha")
    turned = VALUES.transpose(0, 2, 1)[:, :, ::-1]
    assert np.array_equal(field.values, turned) and field.spacing == (2, 1, 3)
    assert field.origin == (5 - 2 * (VALUES.shape[1] - 1), 6, 7)


def test_gaussian_scenes_have_y_down(tmp_path):
    header, data, _ = ply_bytes()
    path = stored(tmp_path / "a.ply", header + data)
    assert ss.open(path).orientation == ss.Orientation("-y")
    eye, up = seen_from(ss.open(path))
    assert np.allclose(eye, np.array((1, -1, -1)) / np.sqrt(3)) and up == (0, -1, 0)


def test_what_is_given_comes_before_what_is_stated(rng):
    field = ss.RegularField(rng.random((5, 6, 7))).with_orientation(PATIENT)
    assert np.allclose(seen_from(field)[0], (0, -1, 0))
    assert np.allclose(seen_from(field, azimuth=90)[0], (1, 0, 0))
    assert np.allclose(seen_from(field, up="x", azimuth=0, elevation=0)[0], (0, -1, 0))
    eye, up = seen_from(field, direction="x")
    assert np.allclose(eye, (-1, 0, 0)) and up == (0, 0, 1)
    # Straight from above: the back is up, as when the eye rises from the front.
    eye, up = seen_from(field, direction="-z")
    assert np.allclose(eye, (0, 0, 1)) and np.allclose(up, (0, 1, 0))
    assert np.allclose(seen_from(field, elevation=90)[1], (0, 1, 0))
    # Of several fields the first that states something counts.
    assert np.allclose(seen_from([ss.RegularField(field.values), field])[0], (0, -1, 0))
    assert field.with_orientation(None).orientation is None
    again = pickle.loads(pickle.dumps(field))
    assert (
        again == field != field.with_orientation(None)
        and again.orientation == PATIENT
        and "up (0.0, 0.0" in repr(field)
    )
    ghosts = ss.EllipsoidField([(0, 0, 0)], [1], values=[1]).with_orientation(PATIENT).with_ghost_points()
    assert ghosts.orientation == PATIENT


def test_stacks_are_shown_as_in_programs_for_microscopes():
    from sheetsplat.figure import picture_plane

    stack = np.zeros((6, 40, 50), np.float32)
    # In the first slice, near the top and at the left, and farther down and behind it something else.
    stack[0, 4:8, 6:10], stack[5, 30:34, 40:44] = 1.0, 0.5
    look = {"y": "down", "mode": "mip", "size": (50, 40), "backend": "reference", "quality": "draft", "margin": 1.0}
    picture = ss.render(stack, target=(24.5, 19.5, 2.5), **look)
    numbers = np.nan_to_num(picture.scalar)
    rows, columns = np.nonzero(numbers > 0.8 * numbers.max())
    assert rows.mean() < 15 and columns.mean() < 20
    eye, up = seen_from(ss.RegularField(stack), y="down")
    assert np.allclose(eye, (0, 0, -1)) and up == (0, -1, 0)
    plane = picture_plane(picture)
    left, right, bottom, top = plane.extent
    assert plane.labels[0].startswith("x") and left < right and plane.labels[1].startswith("y") and top < bottom
    # The bright square is where the axes say.
    assert top + (rows.mean() + 0.5) / 40 * (bottom - top) == pytest.approx(5.5, abs=0.6)
    assert left + (columns.mean() + 0.5) / 50 * (right - left) == pytest.approx(7.5, abs=0.6)
    axes = picture.to_axes()
    assert axes.yaxis.get_inverted() and not axes.xaxis.get_inverted()
    # What is given comes before, and what a file states after it.
    field = ss.RegularField(stack).with_orientation(PATIENT)
    assert seen_from(field, y="down", up="x")[1] == (1, 0, 0) and np.allclose(seen_from(field, y="up")[0], (0, 0, 1))
    assert np.allclose(seen_from(field, y="down", azimuth=90)[0], (1, 0, 0))
    assert np.allclose(seen_from(field, y="down", direction="x")[0], (-1, 0, 0))
    with pytest.raises(ss.InvalidInput, match="up, down") as told:
        ss.render(stack, y="left", size=8)
    assert told.value.option == "y"


@pytest.mark.parametrize(
    ("up", "front"), [((0, 0, 0), None), ((0, 0, np.inf), None), ("up", None), ("z", (0, 0, 2)), ("z", (0, 0, 0))]
)
def test_orientations_that_are_none_are_refused(up, front):
    with pytest.raises(ss.InvalidInput, match="Orientation"):
        ss.Orientation(up, front)


@pytest.mark.parametrize("axes", [(), ("left",), ("left", "right", "superior"), ("L", "P", "x"), ("L", "P", "")])
def test_axes_that_are_no_space_are_refused(axes):
    with pytest.raises(ss.InvalidInput, match="axes"):
        ss.Orientation.anatomical(*axes)


def test_orientation_of_other_types_is_refused():
    with pytest.raises(ss.InvalidInput, match="Orientation"):
        ss.EllipsoidField([(0, 0, 0)], [1], values=[1]).with_orientation("z")


# What can be seen ----------------------------------------------------------------------------------------------------


def small_ball(size=48, radius=5.0, at=(10.0, 30.0, 24.0)):
    """Return a ball in a corner of a volume, as an array [k, j, i]."""
    k, j, i = np.indices((size, size, size), dtype=np.float32)
    away = np.sqrt((i - at[0]) ** 2 + (j - at[1]) ** 2 + (k - at[2]) ** 2)
    return np.clip(radius + 1 - away, 0, 1)


def filled(image):
    """Return how much of the shorter side of a picture what is seen takes, across and upwards, and what is cut off."""
    alpha = image.rgba[..., 3] > 0.1
    rows, columns = np.flatnonzero(alpha.any(axis=1)), np.flatnonzero(alpha.any(axis=0))
    cut = alpha[0].any() or alpha[-1].any() or alpha[:, 0].any() or alpha[:, -1].any()
    return (np.ptp(columns) + 1) / min(image.size), (np.ptp(rows) + 1) / min(image.size), cut


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
@pytest.mark.parametrize("size", [(60, 60), (90, 40), (40, 90)])
@pytest.mark.parametrize("kind", ["volume", "kernels", "isosurface"])
def test_what_can_be_seen_fills_the_picture(kind, size, projection, rng):
    data, options = small_ball(), {"mode": "isosurface"} if kind == "isosurface" else {}
    if kind == "kernels":
        # A ball of 600 kernels that show, in a cloud ten times as wide that does not.
        points = rng.normal(size=(1200, 3))
        points /= np.linalg.norm(points, axis=1)[:, np.newaxis] / rng.random((1200, 1)) ** (1 / 3)
        points[600:] *= 10
        shown = np.arange(1200) < 600
        data = ss.EllipsoidField(points, np.where(shown, 0.3, 2.0), values=np.where(shown, 1.0, 0.001))
        options = {"clim": (0.1, 1), "opacity": [(0.1, 0), (1, 0.5)]}
    image = ss.render(data, size=size, projection=projection, backend="cpu", **options)
    across, upwards, cut = filled(image)
    assert max(across, upwards) >= 0.8 and not cut


def test_framing_follows_the_transfer_function():
    # A dense ball in a thin larger one.
    data = np.maximum(small_ball(at=(24, 24, 24)), 0.2 * small_ball(at=(24, 24, 24), radius=20))
    both = compose_camera(
        compose_scene([ss.RegularField(data)], opacity=[(0.1, 0), (0.2, 0.3)], clim=(0.1, 1)), (40, 40)
    )
    function = ss.TransferFunction([(0.5, 1, 1, 1, 0), (0.9, 1, 1, 1, 0.5)])
    dense = compose_camera(ss.Scene(ss.RegularField(data), function), (40, 40))
    assert 0.2 < dense.height / both.height < 0.45
    # Where nothing can be seen, the box of the supports is.
    nothing = ss.Scene(ss.RegularField(data), [(0, 1, 1, 1, 0), (1, 1, 1, 1, 0)])
    assert compose_camera(nothing, (40, 40)).height == pytest.approx(compose_camera(nothing.fields, (40, 40)).height)


def test_a_few_stray_samples_do_not_count():
    data = small_ball(at=(24, 24, 24), radius=10)
    plain = compose_camera(compose_scene([ss.RegularField(data)], clim=(0.5, 1)), (40, 40))
    data[1, 1, 1] = data[46, 3, 40] = 1
    strays = compose_camera(compose_scene([ss.RegularField(data)], clim=(0.5, 1)), (40, 40))
    assert strays.height == pytest.approx(plain.height, rel=0.05)


def test_framing_keeps_its_meaning_where_a_camera_fits_a_box():
    field = ss.RegularField(small_ball())
    box = ss.Camera.fit(field, (-1, -1, -1), up=(0, 0, 1))
    assert box.height > 2 * compose_camera(compose_scene([field]), (40, 40)).height
    assert compose_camera(field, (40, 40)).height == pytest.approx(box.height)


@pytest.mark.parametrize("shift", [0.0, 1e6])
def test_framing_follows_the_clip_and_the_units(shift):
    data = np.maximum(small_ball(at=(10, 24, 24)), small_ball(at=(38, 24, 24)))
    field = ss.RegularField(data, origin=(shift, 0, 0))
    whole = compose_camera(compose_scene([field]), (40, 40))
    clip = ss.Clip(planes=[((1, 0, 0), shift + 24)])
    half = compose_camera(compose_scene([field], clip=clip), (40, 40))
    assert half.height < 0.6 * whole.height and half.target[0] == pytest.approx(shift + 38, abs=1.5)


@pytest.mark.parametrize("mode", ["mip", "average"])
def test_what_is_not_dark_fills_pictures_of_maxima_and_averages(mode):
    values = np.random.default_rng(1).uniform(0, 3, (40, 40, 40))
    values[12:20, 12:20, 12:20] = 200.0
    look = {"mode": mode, "size": (48, 48), "backend": "cpu"}

    def filled(values, **options):
        scalar = ss.render(values, **look, **options).scalar
        return float(np.ptp(np.nonzero(scalar > 0.1 * np.nanmax(scalar))[0]) + 1) / 48

    assert filled(values) >= 0.8
    # Limits say what is dark; a hot sample is no subject.
    assert filled(values, clim=(-10, 10)) < 0.5
    values[30, 30, 30] = 1e6
    camera = ss.render(values, **look).camera
    assert camera.height > 40
