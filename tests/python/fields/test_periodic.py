"""Periodic boxes: kernels that leave by a face come in by the opposite one, and the field ends at the faces."""

import copy
import itertools
import pickle

import numpy as np
import pytest
from command_line import run
from scattered_files import write_particles

import sheetsplat as ss
from sheetsplat.fit._kernels import unit_mass

SIDE = 8.0
BOX = ((0.0, 0.0, 0.0), (SIDE, SIDE, SIDE))
CAMERA = ss.Camera.orthographic((4, 4, 100), (4, 4, 4), (0, 1, 0), height=SIDE)
ASKEW = ss.Camera.perspective((20, 14, 30), (4, 4, 4), fov_y=25)
LOOK = [(0, 0, 0, 0.5, 0.0), (0.5, 0.9, 0.3, 0.1, 0.3), (1.5, 1, 1, 0.8, 0.9)]


@pytest.fixture
def soup():
    """Return centres, some outside of the box, semi-axes, quaternions, values and weights."""
    rng = np.random.default_rng(3)
    turns = rng.normal(size=(25, 4))
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    centers = rng.uniform(-3, 12, (25, 3))
    # The outermost centres in the box, by which slices are anchored: in the middle of all images too.
    centers[:2] = (0, 0, 0), (SIDE - 1e-9, SIDE - 1e-9, SIDE - 1e-9)
    return centers, rng.uniform(0.6, 2.5, (25, 3)), turns, rng.uniform(0.2, 1.2, 25), rng.random(25)


def field_of(soup, **options):
    centers, scales, turns, values, weights = soup
    return ss.EllipsoidField(centers, scales, turns, values, weights=weights, **{"w0": 0.2, "periodic": BOX, **options})


def by_hand(soup, **options):
    """Return the kernels and all images around the box as kernels of a field that ends nowhere."""
    centers, scales, turns, values, weights = soup
    steps = SIDE * np.array(list(itertools.product((-2, -1, 0, 1, 2), repeat=3)))
    many = len(steps)
    return ss.EllipsoidField(
        (np.mod(centers, SIDE) + steps[:, None]).reshape(-1, 3), np.tile(scales, (many, 1)), np.tile(turns, (many, 1)),
        np.tile(values, many), weights=np.tile(weights, many), **{"w0": 0.2, **options},
    )  # fmt: skip


def test_sums_are_those_of_all_images(soup):
    field, wanted = field_of(soup), by_hand(soup)
    points = np.random.default_rng(1).uniform(0, SIDE, (200, 3))
    values, slopes = field.evaluate(points)
    expected, gradients = wanted.evaluate(points)
    assert np.allclose(values, expected, atol=1e-13) and np.allclose(slopes, gradients, atol=1e-12)
    assert np.array_equal(field.nearest_kernel(points), np.where(expected == 0, -1, wanted.nearest_kernel(points) % 25))
    faces = points.copy()
    faces[:, 0] = 0
    other = faces + (SIDE, 0, 0)
    assert np.allclose(field.evaluate(faces)[1], field.evaluate(other)[1], atol=1e-12)


def test_positions_of_another_unit_are_refused():
    # Positions in cm and a box in Mpc: float64 does not say where in the box they lie.
    with pytest.raises(ss.InvalidInput, match=r"float64 does not say .* units"):
        ss.EllipsoidField([(3e24, 1, 1)], 1.0, values=[1], periodic=BOX)
    with pytest.raises(ss.InvalidInput, match=r"float64 does not say .* units"):
        ss.fit.delaunay(np.full((9, 3), 3e24), np.ones(9), periodic=BOX)
    assert np.allclose(ss.EllipsoidField([(8e9 + 3, 1, 1)], 1.0, values=[1], periodic=BOX).centers, (3, 1, 1))
    with pytest.raises(ss.InvalidInput, match=r"pass periodic=\.\.\. with a larger box"):
        ss.EllipsoidField([(1, 1, 1)], 1e3, values=[1], periodic=BOX)


def test_images_are_no_kernels_of_the_data(soup):
    field, alone = field_of(soup), field_of(soup, periodic=None)
    assert (field.size, alone.images) == (25, 0) and field.images > 25
    assert np.allclose(field.centers, np.mod(soup[0], SIDE)) and field.domain == BOX and field.periodic == BOX
    assert [len(one) for one in (field.scales, field.rotations, field.values, field.weights)] == [25] * 4
    inside = ss.EllipsoidField(field.centers, soup[1], soup[2], soup[3], weights=soup[4], w0=0.2)
    assert field.default_slice_spacing == inside.default_slice_spacing
    assert field.centre_bounds == inside.centre_bounds and np.allclose(field.bounds, BOX)
    # What lies in the box stays what it is, a centre on the upper face lies on the lower one.
    assert ss.EllipsoidField([(0.1, 8, 3)], 1.0, values=[1], periodic=BOX).centers.tolist() == [[0.1, 0, 3]]


@pytest.mark.parametrize("backend", ["cpu", "gl", "reference"])
def test_x_rays_keep_all_mass_of_a_particle_on_a_face(backend):
    for center in ((0, 4, 4), (4, 4, 0), (8, 8, 8)):
        field = ss.EllipsoidField([center], 1.5, values=[2.0], normalization="none", periodic=BOX)
        scene = ss.Scene(field, LOOK, mode="xray", slice_spacing=SIDE / 128)
        with pytest.warns(ss.PictureWarning, match="supersampling"):
            image = ss.Renderer(backend=backend).render(scene, CAMERA, (64, 64))
        mass = image.scalar.sum(dtype=np.float64) * (SIDE / 64) ** 2
        assert abs(mass / (unit_mass(8.0) * 1.5**3) - 2) < 1e-6


@pytest.mark.parametrize("backend", ["cpu", "gl", "reference"])
@pytest.mark.parametrize("mode", ["composite", "isosurface", "mip"])
def test_pictures_are_those_of_all_images_within_the_box(soup, backend, mode):
    options = {"mode": mode, "slice_spacing": 0.25} | ({"iso_value": 0.5} if mode == "isosurface" else {})
    renderer = ss.Renderer(backend=backend)
    image = renderer.render(ss.Scene(field_of(soup), LOOK, **options), ASKEW, (40, 40))
    # Modes of numbers count what lies in the box, and a clip the same points.
    wanted = renderer.render(ss.Scene(by_hand(soup), LOOK, clip=ss.Clip(box=BOX), **options), ASKEW, (40, 40))
    if mode == "isosurface":
        # Surfaces end at a clip where they would go on, and at the ends of a field too.
        assert np.abs(image.rgba - wanted.rgba).max() < 1e-4 and image.rgba[..., 3].max() > 0.5
    elif mode == "mip":
        # A clip leaves nothing out of pixels whose ray meets no kernel; a domain is empty there.
        both = np.isfinite(image.scalar) & np.isfinite(wanted.scalar)
        assert both.sum() > 300 and np.abs(image.scalar - wanted.scalar)[both].max() < 1e-5
    else:
        assert np.abs(image.rgba - wanted.rgba).max() < 1e-4 and image.rgba[..., 3].max() > 0.5


def test_a_pick_names_the_kernel_of_an_image():
    field = ss.EllipsoidField([(4, 4, 1), (0.5, 4, 4)], 1.5, values=[0.1, 1.0], w0=0.05, periodic=BOX)
    image = ss.render(field, camera=CAMERA, size=(64, 64), opacity=[(0, 0), (0.3, 0), (1, 1)], clim=(0, 1))
    found = image.pick(63, 32)
    assert found is not None and (found.kernel, found.field) == (1, 0) and found.position[0] > 7.5


def test_axes_that_do_not_wrap():
    centers = [(0.2, 0.2, 0.2)]
    for box in (((0, 0, 0), (8, 8, 0)), ((0, 0, -np.inf), (8, 8, np.inf)), ((0, 0, 3), (8, 8, 3))):
        field = ss.EllipsoidField(centers, 1.0, values=[1], periodic=box)
        assert field.periodic == ((0, 0, 0), (8, 8, 0)) and field.images == 3
        assert field.domain == ((0, 0, -np.inf), (8, 8, np.inf)) and field.bounds[0][2] == pytest.approx(-0.8)
        assert field.at([(7.9, 0, -0.1)])[0] > 0
    assert ss.EllipsoidField(centers, 1.0, values=[1], periodic=((1, 1, 1), (1, 1, 1))).periodic is None


@pytest.mark.parametrize(
    ("box", "text"),
    [
        (((0, 0, 0), (8, 8)), "two corners"),
        (((0, 0, 0), (8, -8, 8)), "lower one first"),
        (((0, 0, 0), (8, np.nan, 8)), "lower one first"),
        (8.0, "two corners"),
        (((0, 0, 0), (0.15, 0.15, 8)), r"images of kernel 0.*at most 1000"),
    ],
)
def test_boxes_without_meaning_are_refused(box, text):
    with pytest.raises(ss.InvalidInput, match=f"periodic.*{text}"):
        ss.EllipsoidField([(1, 1, 1)], 3.0, values=[1], periodic=box)


def test_a_box_has_no_border_for_ghost_points(soup):
    with pytest.raises(ss.InvalidInput, match="periodic"):
        field_of(soup).with_ghost_points()


def test_beside_a_field_that_ends_elsewhere_nothing_wraps(soup):
    other = ss.EllipsoidField([(4, 4, 4)], 2.0, values=[1.0], w0=0.2)
    scenes = [
        ss.Scene([one, other], LOOK, slice_spacing=0.25) for one in (field_of(soup), field_of(soup).without_end())
    ]
    for backend in ("cpu", "reference"):
        first, second = (ss.Renderer(backend=backend).render(one, ASKEW, (32, 32)).rgba for one in scenes)
        assert np.abs(first - second).max() < 1e-6


def test_copies_files_and_recipes(soup, tmp_path):
    field = field_of(soup)
    assert pickle.loads(pickle.dumps(field)) == field == copy.deepcopy(field) != field_of(soup, periodic=None)
    some = field.part(np.arange(5))
    assert some.periodic == BOX and some.size == 5 and some.images > 0
    ss.io.save_npz(field, tmp_path / "f.npz")
    read = ss.open(tmp_path / "f.npz")
    assert read.periodic == BOX and read.images == field.images and np.array_equal(read.centers, field.centers)
    image = ss.render(field, size=(24, 24))
    again = image.recipe.fields[0].open(tmp_path / "f.npz")
    assert image.recipe.fields[0].options["periodic"] == BOX and again.periodic == BOX
    image.save(tmp_path / "p.png")
    assert ss.Recipe.read(tmp_path / "p.png").fields[0].options["periodic"] == BOX


def test_bricks_are_the_same_picture(soup):
    field = field_of(soup)
    bricked = ss.open_bricks(field, brick_kernels=6)
    assert bricked.kernels == 25 and bricked.domain == BOX and np.allclose(bricked.bounds, BOX)
    options = {"camera": ASKEW, "size": (40, 40), "slice_spacing": 0.25, "filter": "off"}
    one, other = (
        ss.render(data, transfer_function=ss.TransferFunction(LOOK), **options).rgba for data in (field, bricked)
    )
    assert np.abs(one - other).max() < 1e-4 and one[..., 3].max() > 0.5
    one, other = (ss.render(data, mode="xray", supersampling=1, **options).scalar for data in (field, bricked))
    assert np.allclose(one, other, atol=1e-4) and one.max() > 1


@pytest.mark.parametrize("fit", ["nearest", "delaunay"])
def test_fits_count_neighbours_across_faces(fit):
    points, shift = np.random.default_rng(5).uniform(0, SIDE, (300, 3)), np.array([3.0, 4.5, 7.0])
    make = getattr(ss.fit, fit)
    kernels, moved = (make(at, np.arange(300.0), periodic=BOX) for at in (points, np.mod(points + shift, SIDE)))
    # Nothing is special about where the faces are.
    assert np.allclose(np.sort(kernels.scales.ravel()), np.sort(moved.scales.ravel()), rtol=1e-6)
    assert len(kernels) == 300 and kernels.field().periodic == BOX
    faces = np.random.default_rng(6).uniform(0, SIDE, (100, 3)) * (0, 1, 1)
    assert np.allclose(kernels.sums(faces)[1], kernels.sums(faces + (SIDE, 0, 0))[1], atol=1e-9)
    if fit == "delaunay":
        assert np.median(kernels.sums(faces)[1]) > 1.1


def test_the_box_of_a_file(tmp_path):
    rng = np.random.default_rng(7)
    count = 400
    points, lengths = rng.uniform(0, 10, (count, 3)), np.full(count, 1.4)
    offsets = points[:, None] - points
    offsets -= 10 * np.round(offsets / 10)
    kernel = (
        8 * ss.fit.SPH_KERNELS["cubic_spline"](np.linalg.norm(offsets, axis=2) / lengths[0]) / (2 * lengths[0]) ** 3
    )
    rows = {"Coordinates": points, "SmoothingLength": lengths, "Density": kernel.sum(axis=1), "Masses": np.ones(count)}
    path, _ = write_particles(tmp_path / "a.h5", count, header={"BoxSize": 10.0}, **rows)
    field = ss.open(path)
    data = ss.io.read_scattered(path)
    # By the densities of neighbours across the faces.
    told = data.details["support"]
    assert told.startswith("2 smoothing lengths") and float(told.split()[-2]) < 1e-9
    assert data.details["box"] == "10 x 10 x 10, periodic" and field.periodic == ((0, 0, 0), (10, 10, 10))
    assert f"(0, 0, 0) to (10, 10, 10), with {field.images} images of kernels" in run("info", path).stdout
    assert ss.open(path, periodic=((0, 0, 0), (0, 0, 0))).periodic is None
    assert ss.open_bricks(path).periodic == field.periodic
    out = tmp_path / "a.png"
    run("render", path, "--periodic", "0,0,0,10,10,0", "--size", "16x16", "-o", out)
    assert ss.Recipe.read(out).fields[0].opened["periodic"] == ((0, 0, 0), (10, 10, 0))
    points[0, 1] = -0.5
    path, _ = write_particles(tmp_path / "b.h5", count, header={"BoxSize": (10.0, 10.0, 10.0)}, **rows)
    assert ss.open(path).periodic is None and "lie outside" in ss.io.read_scattered(path).details["box"]
    with pytest.raises(ss.InvalidInput, match="periodic for a"):
        np.save(tmp_path / "v.npy", np.zeros((3, 3, 3)))
        ss.open(tmp_path / "v.npy", periodic=BOX)
