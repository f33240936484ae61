"""Fields of ellipsoids: what they take, what they keep, what is refused, and that scenes and pictures accept them."""

from __future__ import annotations

import json
import logging

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat.cli import info
from sheetsplat.look import automatic
from sheetsplat.look.compose import compose_scene
from sheetsplat.look.empty import why_empty

SMALL = {"size": (32, 32), "backend": "reference"}


def random_rotations(rng, count):
    """Return rotation matrices, of determinant 1."""
    matrices = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    return matrices * np.linalg.det(matrices)[:, np.newaxis, np.newaxis]


def matrices_of(quaternions):
    """Return rotation matrices of unit quaternions w, x, y, z, by turning the axes (not the field's own way)."""
    w, v = quaternions[:, :1], quaternions[:, 1:]
    columns = []
    for axis in np.eye(3):
        twice = 2.0 * np.cross(v, axis)
        columns.append(axis + w * twice + np.cross(v, twice))
    return np.stack(columns, axis=2)


def sums(points, centers, shapes, values, weights, k=8.0):
    """Return D and W at points, kernel by kernel, by the inverse of M."""
    density, coverage = np.zeros(len(points)), np.zeros(len(points))
    for center, shape, value, weight in zip(centers, shapes, values, weights, strict=True):
        r2 = (np.linalg.solve(shape, (points - center).T) ** 2).sum(axis=0)
        g = np.where(r2 < 1, (np.exp(-k * r2) - np.exp(-k)) / (1 - np.exp(-k)), 0)
        density += weight * value * g
        coverage += weight * g
    return density, coverage


@pytest.fixture
def soup(rng):
    """Return centres, semi-axes, rotation matrices, values and weights of 40 ellipsoids."""
    n = 40
    return (
        rng.normal(size=(n, 3)),
        rng.uniform(0.1, 1.5, (n, 3)),
        random_rotations(rng, n),
        rng.normal(size=n),
        rng.uniform(0.2, 2.0, n),
    )


@pytest.fixture
def block():
    """Return the positions of 9 x 9 x 9 samples, 1 apart."""
    return np.mgrid[0:9, 0:9, 0:9].reshape(3, -1).T.astype(float)


def ball_of_kernels(rng, count=400):
    """Return a field that is 2 in the middle of a ball and 1 at its rim."""
    centers = rng.normal(size=(count, 3))
    centers *= (rng.random(count) ** (1 / 3) / np.linalg.norm(centers, axis=1))[:, np.newaxis]
    return ss.EllipsoidField(centers, np.full(count, 0.4), values=2 - np.linalg.norm(centers, axis=1))


# What a field keeps, and what it is at points.


def test_the_scalar_is_the_sum_of_the_kernels(soup, rng):
    centers, scales, matrices, values, weights = soup
    points = rng.normal(size=(300, 3))
    density, coverage = sums(points, centers, matrices * scales[:, np.newaxis], values, weights)
    assert (coverage > 0).mean() > 0.3 and coverage.max() > 1
    common = {"weights": weights, "w0": 0.7}
    field = ss.EllipsoidField(centers, scales, matrices, values, **common)
    assert np.allclose(field.at(points), density / np.maximum(0.7, coverage), rtol=1e-12, atol=1e-13)
    assert np.allclose(field.weight_at(points), coverage, rtol=1e-12, atol=1e-13)
    field = ss.EllipsoidField(centers, scales, matrices, values, normalization="none", **common)
    assert np.allclose(field.at(points), density, rtol=1e-12, atol=1e-13)
    # The transposed matrices are other rotations.
    turned = ss.EllipsoidField(centers, scales, matrices.transpose(0, 2, 1), values, **common)
    assert not np.allclose(turned.weight_at(points), coverage, atol=1e-2)


def test_quaternions_and_matrices_are_the_same_rotations(soup, rng):
    centers, scales, _, values, _ = soup
    quaternions = rng.normal(size=(len(centers), 4))
    quaternions /= np.linalg.norm(quaternions, axis=1)[:, np.newaxis]
    by_matrix = ss.EllipsoidField(centers, scales, matrices_of(quaternions), values)
    # q and -q are the same rotation.
    signs = np.sign((by_matrix.rotations * quaternions).sum(axis=1))[:, np.newaxis]
    assert np.allclose(by_matrix.rotations * signs, quaternions, atol=1e-14)
    by_quaternion = ss.EllipsoidField(centers, scales, quaternions, values)
    assert np.allclose(by_quaternion.rotations, quaternions, atol=1e-15)
    assert np.allclose(by_matrix.bounds, by_quaternion.bounds, atol=1e-13)


def test_half_turns_are_found_from_matrices():
    turns = np.array([np.diag(d) for d in ((1, -1, -1), (-1, 1, -1), (-1, -1, 1), (1, 1, 1))], float)
    field = ss.EllipsoidField(np.zeros((4, 3)), np.ones((4, 3)) * (1, 2, 3), turns, np.ones(4))
    assert np.allclose(matrices_of(field.rotations), turns, atol=1e-15)


def test_slightly_wrong_rotations_become_the_nearest_ones(soup, rng):
    centers, scales, matrices, values, _ = soup
    noise = rng.uniform(-3e-4, 3e-4, matrices.shape)
    field = ss.EllipsoidField(centers, scales, matrices + noise, values)
    left, _, right = np.linalg.svd(matrices + noise)
    assert np.allclose(matrices_of(field.rotations), left @ right, atol=1e-13)
    long = np.tile((1.0005, 0, 0, 0), (len(centers), 1))
    assert np.array_equal(
        ss.EllipsoidField(centers, scales, long, values).rotations, np.tile((1, 0, 0, 0), (len(centers), 1))
    )


def test_a_reflection_spans_the_same_ellipsoid(soup, rng):
    centers, scales, matrices, values, _ = soup
    points = rng.normal(size=(200, 3))
    plain = ss.EllipsoidField(centers, scales, matrices, values)
    for mirror in (np.diag((1.0, -1, 1)), -np.eye(3)):
        field = ss.EllipsoidField(centers, scales, matrices @ mirror, values)
        assert np.allclose(field.at(points), plain.at(points), atol=1e-12)
        assert np.allclose(np.linalg.det(matrices_of(field.rotations)), 1)


def test_arrays_are_kept_as_read_only_views(soup):
    centers, scales, matrices, values, weights = soup
    field = ss.EllipsoidField(centers, scales, matrices, values, weights=weights)
    for name, given in (("centers", centers), ("scales", scales), ("values", values), ("weights", weights)):
        view = getattr(field, name)
        assert np.array_equal(view, given) and view.dtype == np.float64
        with pytest.raises(ValueError, match="read-only"):
            view[0] = 0
    with pytest.raises(ValueError, match="read-only"):
        field.rotations[0] = 0
    kept = field.centers
    before = centers.copy()
    centers[:] = 0
    del field
    assert np.array_equal(kept, before)


def test_properties():
    field = ss.EllipsoidField(
        [(0, 0, 0), (2, 0, 0)], [(1, 2, 3), (0.5, 0.5, 4)], values=[3, -1], weights=[1, 5], w0=0.5, falloff=6
    )
    assert field.size == 2 and field.value_range == (-1, 3) and field.weight_range == (1, 5)
    assert field.scale_range == (0.5, 4) and not field.isotropic and field.rotations is None
    assert field.bounds == ((-1, -2, -4), (2.5, 2, 4)) and field.centre_bounds == ((0, 0, 0), (2, 0, 0))
    # Half the median of 1 and 0.5.
    assert field.default_slice_spacing == 0.375
    assert (field.normalization, field.w0, field.falloff, field.min_scale) == ("threshold", 0.5, 6, None)
    assert field.cell_volume is None and field.ghosts == 0
    assert "2 ellipsoids" in repr(field) and "0.5 to 4" in repr(field)
    spheres = ss.EllipsoidField([(0, 0, 0)], [2], [(0.6, 0.8, 0, 0)], [3])
    assert spheres.isotropic and spheres.scales.shape == (1,) and spheres.rotations is None and spheres.weights is None
    with pytest.raises(TypeError):
        type(field).__mro__[1]()


@pytest.mark.parametrize(
    "dtype", [np.float32, ">f4", ">f8", np.int16, ">i4", np.uint64, np.float16, np.longdouble, bool]
)
def test_numbers_of_any_type(dtype):
    given = np.array([(1, 0, 1), (0, 1, 1), (1, 1, 0)]).astype(dtype)
    field = ss.EllipsoidField(given, np.ones(3, dtype), values=np.ones(3, dtype), weights=np.ones(3, dtype))
    assert np.array_equal(field.centers, given.astype(float)) and (field.weights == 1).all()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_arrays_of_any_layout(rng, dtype):
    centers = np.asfortranarray(rng.normal(size=(20, 3)).astype(dtype))
    table = rng.uniform(1, 2, (40, 5)).astype(dtype)
    scales = table[::-2, 1:4][:, ::-1]
    matrices = random_rotations(rng, 20).astype(dtype).transpose(2, 1, 0).copy().transpose(2, 1, 0)
    values = table[:20, 4]
    raw = np.zeros(20 * np.dtype(dtype).itemsize + 1, np.uint8)
    weights = raw[1:].view(dtype)
    weights[:] = np.arange(1, 21)
    field = ss.EllipsoidField(centers, scales, matrices, values, weights=weights)
    assert np.array_equal(field.centers, centers) and np.array_equal(field.scales, scales)
    assert np.array_equal(field.values, values) and np.array_equal(field.weights, np.arange(1, 21))
    assert np.allclose(matrices_of(field.rotations), matrices, atol=1e-6)
    same = ss.EllipsoidField(centers.tolist(), scales.tolist(), matrices.tolist(), values.tolist())
    assert np.array_equal(same.scales, field.scales) and np.allclose(same.rotations, field.rotations, atol=1e-7)
    assert ss.EllipsoidField(np.broadcast_to((1, 2, 3), (4, 3)), np.ones(4), values=range(4)).centers[3, 2] == 3


@pytest.mark.parametrize("scales", [np.empty(0), np.empty((0, 3)), []])
def test_a_field_may_have_no_kernels(scales):
    empty = ss.EllipsoidField(np.empty((0, 3)), scales, values=[])
    assert empty.size == 0 and empty.value_range == (0, 0) and empty.scale_range == (0, 0)
    assert empty.centers.shape == (0, 3) and empty.default_slice_spacing == 0
    assert np.array_equal(empty.at([(0, 0, 0)]), [0])
    assert empty.with_ghost_points().size == 0
    assert ss.EllipsoidField([], [], values=[]).size == 0
    assert not ss.render(empty, **SMALL).rgba.any()
    scene = ss.Scene(empty, [(0, 0, 0, 0, 0), (1, 1, 1, 1, 1)])
    assert why_empty(scene) == "the field has no kernels" and scene.slice_spacing == 1
    with pytest.raises(ss.InvalidInput, match=r"Camera\.fit"):
        ss.Camera.fit(empty)


def test_points_may_be_duplicates_and_values_equal():
    one = ss.EllipsoidField([(0, 0, 0)], [1], values=[3], normalization="none")
    two = ss.EllipsoidField([(0, 0, 0)] * 2, [1, 1], values=[1.5, 1.5], normalization="none")
    points = np.linspace((-1, 0, 0), (1, 0.1, 0), 21)
    assert np.allclose(one.at(points), two.at(points), atol=1e-15) and one.at([(0, 0, 0)])[0] == pytest.approx(3)
    assert ss.render(two, **SMALL).rgba[..., 3].max() > 0.05
    assert two.with_ghost_points().ghosts == 14


def test_lattice_normalization_divides_by_the_mass(block):
    # Kernels of the regular fields' own shape on the same lattice reproduce a constant as they do.
    field = ss.EllipsoidField(
        block,
        np.full(len(block), 2.0),
        values=np.full(len(block), 7.0),
        normalization="lattice",
        falloff=5,
        cell_volume=1,
    )
    assert np.allclose(field.at([(4, 4, 4), (4.5, 4.5, 4.5), (4.3, 4, 3.8)]), 7, rtol=0.008)
    with pytest.raises(ss.InvalidInput, match="cell_volume"):
        ss.EllipsoidField(block, np.ones(len(block)), values=np.ones(len(block)), normalization="lattice")
    with pytest.raises(ss.InvalidInput, match="one volume"):
        ss.EllipsoidField(block[:2], [1, 1.1], values=[1, 1], normalization="lattice", cell_volume=1)


def test_short_axes_are_raised():
    field = ss.EllipsoidField(np.zeros((2, 3)), [(0, 1, 2), (0.2, 0, 0)], values=[1, 1], min_scale=0.5)
    assert np.array_equal(field.scales, [(0.5, 1, 2), (0.5, 0.5, 0.5)]) and field.min_scale == 0.5
    field = ss.EllipsoidField(np.zeros((2, 3)), [0, 1], values=[1, 1], min_scale=0.5)
    assert np.array_equal(field.scales, [0.5, 1])


# What is refused.

GOOD = {"centers": np.zeros((5, 3)), "scales": np.ones((5, 3)), "values": np.ones(5)}


def changed(name, index, number):
    """Return arguments with one number of one array changed."""
    arrays = {
        **GOOD,
        "rotations": np.tile((1.0, 0, 0, 0), (5, 1)),
        "weights": np.ones(5),
        "matrices": np.tile(np.eye(3), (5, 1, 1)),
        "radii": np.ones(5),
    }
    array = arrays[name].astype(float)
    array[index] = number
    return {**GOOD, {"matrices": "rotations", "radii": "scales"}.get(name, name): array}


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(
    ("name", "index"),
    [
        ("centers", (3, 1)),
        ("scales", (3, 2)),
        ("radii", 3),
        ("values", 3),
        ("weights", 3),
        ("rotations", (3, 0)),
        ("matrices", (3, 1, 2)),
        ("matrices", (3, 0, 0)),
    ],
)
def test_numbers_that_are_not_finite_are_refused_with_their_index(name, index, number):
    with pytest.raises(ss.InvalidInput, match="kernel 3"):
        ss.EllipsoidField(**changed(name, index, number))


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (changed("scales", (2, 1), 0), r"kernel 2.*min_scale"),
        (changed("radii", 2, 0), r"kernel 2.*min_scale"),
        (changed("scales", (4, 0), -1), r"kernel 4.*length"),
        ({**changed("radii", 1, -1e-9), "min_scale": 1}, r"kernel 1.*length"),
        (changed("scales", (4, 0), 1e-120), r"kernel 4.*1e-100"),
        (changed("scales", (4, 0), 1e120), r"kernel 4.*1e100"),
        (changed("centers", (4, 0), -1e120), r"kernel 4.*1e100"),
        (changed("values", 2, 1e301), r"kernel 2.*1e300"),
        ({**changed("weights", 2, 1e200), "values": np.full(5, 1e200)}, r"kernel 2.*product"),
        (changed("weights", 1, -1), r"kernel 1.*at least 0"),
        ({**GOOD, "weights": np.zeros(5)}, "all 0"),
        (changed("rotations", 4, 0), "length 0 of kernel 4"),
        (changed("rotations", (4, 0), 1.002), r"length 1\.002 of kernel 4"),
        (changed("rotations", (4, 0), 0.998), r"length 0\.998 of kernel 4"),
        (changed("matrices", (2, 0, 1), 0.002), r"kernel 2.*orthogonal.*from_frames.*from_covariances"),
        (changed("matrices", (2, 1, 1), 1.002), r"kernel 2.*orthogonal"),
        (changed("matrices", (2, 1, 1), 0), r"kernel 2.*orthogonal"),
        ({**GOOD, "values": np.ones(4)}, "5 centers and 4 values"),
        ({**GOOD, "scales": np.ones(6)}, "5 centers and 6 scales"),
        ({**GOOD, "weights": np.ones(1)}, "5 centers and 1 weights"),
        ({**GOOD, "rotations": np.ones((4, 4))}, "5 centers and 4 rotations"),
        ({**GOOD, "values": []}, "5 centers and 0 values"),
        ({**GOOD, "centers": np.zeros((5, 2))}, r"shape \(5, 2\).*\(N, 3\)"),
        ({**GOOD, "centers": np.zeros(3)}, r"shape \(3,\)"),
        ({**GOOD, "scales": True}, r"scales"),
        ({**GOOD, "scales": np.ones((5, 1))}, r"shape \(5, 1\)"),
        ({**GOOD, "values": np.ones((5, 1))}, r"shape \(5, 1\)"),
        ({**GOOD, "rotations": np.ones((5, 9))}, r"shape \(5, 9\).*quaternions"),
        ({**GOOD, "rotations": np.ones(5)}, r"values=\.\.\."),
        ({**GOOD, "centers": np.zeros((5, 3), complex)}, "complex"),
        ({**GOOD, "values": list("abcde")}, "values of type"),
        ({**GOOD, "values": [None] * 5}, "values of type object"),
        ({**GOOD, "values": "text"}, "text"),
        ({**GOOD, "values": None}, "values"),
        ({**GOOD, "centers": [(0, 0, 0), (1, 2)]}, "centers"),
        ({**GOOD, "values": np.ma.masked_array(np.arange(5), [0, 0, 1, 0, 0])}, "NaN.*kernel 2"),
        ({**GOOD, "normalization": "sum"}, "normalization"),
        ({**GOOD, "w0": 0}, "w0"),
        ({**GOOD, "falloff": 0}, "falloff"),
        ({**GOOD, "falloff": np.nan}, "falloff"),
        ({**GOOD, "falloff": "8"}, "falloff"),
        ({**GOOD, "min_scale": 0}, "min_scale"),
        ({**GOOD, "min_scale": np.inf}, "min_scale"),
        ({**GOOD, "cell_volume": -1}, "cell_volume"),
    ],
)
def test_arguments_without_meaning_are_refused(arguments, text):
    with pytest.raises(ss.InvalidInput, match=f"(?s)EllipsoidField.*{text}"):
        ss.EllipsoidField(**arguments)


def test_the_good_arguments_are_good():
    assert ss.EllipsoidField(**GOOD).size == 5
    assert ss.EllipsoidField(**changed("rotations", (4, 0), 1.0009)).size == 5
    assert ss.EllipsoidField(**changed("matrices", (2, 0, 1), 0.0009)).size == 5
    assert ss.EllipsoidField(**changed("weights", 1, 0)).weight_range == (0, 1)
    assert ss.EllipsoidField(**{**GOOD, "values": np.ma.masked_array(np.ones(5), np.zeros(5, bool))}).size == 5


def test_fields_larger_than_memory_are_refused():
    many = 10**12
    points, ones = np.broadcast_to(np.float64(1), (many, 3)), np.broadcast_to(np.float64(1), many)
    with pytest.raises(ss.OutOfMemory, match="ellipsoids"):
        ss.EllipsoidField(points, ones, values=ones)
    with pytest.raises(ss.OutOfMemory, match="centers"):
        ss.EllipsoidField(np.broadcast_to(np.int8(1), (many, 3)), ones, values=ones)
    with pytest.raises(ss.OutOfMemory, match="covariances"):
        ss.EllipsoidField.from_covariances(points, np.broadcast_to(np.eye(3), (many, 3, 3)), ones)


def test_spheres_take_forty_bytes_each(rng):
    count = 100_000
    field = ss.EllipsoidField(rng.random((count, 3), np.float32), np.ones(count, np.float32), values=np.ones(count))
    assert 40 * count <= field.memory <= 40 * count + 1000
    turned = ss.EllipsoidField(field.centers, np.ones((count, 3)), np.tile((1, 0, 0, 0), (count, 1)), field.values)
    assert 88 * count <= turned.memory <= 88 * count + 1000


# Covariances and frames.


def test_covariances_are_exactly_their_gaussians(rng, soup):
    centers, scales, matrices, values, _ = soup
    deviations = scales / 4
    shapes = matrices * deviations[:, np.newaxis]
    covariances = shapes @ shapes.transpose(0, 2, 1)
    for k in (8.0, 5.0):
        field = ss.EllipsoidField.from_covariances(centers, covariances, values, falloff=k)
        assert np.allclose(np.sort(field.scales), np.sort(np.sqrt(2 * k) * deviations), rtol=1e-9)
        offsets = rng.normal(size=(50, 3)) * 0.1
        for n in range(5):
            alone = ss.EllipsoidField.from_covariances(
                centers[n : n + 1], covariances[n : n + 1], [1], falloff=k, normalization="none"
            )
            gaussian = np.exp(-0.5 * np.einsum("mi,ij,mj->m", offsets, np.linalg.inv(covariances[n]), offsets))
            lowered = np.maximum(0, (gaussian - np.exp(-k)) / (1 - np.exp(-k)))
            assert np.allclose(alone.at(centers[n] + offsets), lowered, rtol=1e-9, atol=1e-12) and lowered.max() > 0.1
    same = ss.EllipsoidField(centers, scales, matrices, values)
    points = rng.normal(size=(200, 3))
    by_covariance = ss.EllipsoidField.from_covariances(centers, covariances.astype(np.float32), values)
    assert np.allclose(by_covariance.at(points), same.at(points), atol=1e-4)
    assert not np.allclose(
        ss.EllipsoidField.from_covariances(centers, 1.1 * covariances, values).at(points), same.at(points), atol=1e-3
    )


def test_many_covariances_are_factored_block_by_block(rng, monkeypatch):
    monkeypatch.setattr(ss.fields, "_BLOCK", 7)
    matrices, scales = random_rotations(rng, 20), rng.uniform(0.5, 2, (20, 3))
    shapes = matrices * scales[:, np.newaxis]
    centers, values = rng.normal(size=(20, 3)), np.arange(20.0)
    plain = ss.EllipsoidField(centers, scales, matrices, values)
    points = rng.normal(size=(100, 3))
    field = ss.EllipsoidField.from_covariances(centers, shapes @ shapes.transpose(0, 2, 1) / 16, values)
    assert np.allclose(field.at(points), plain.at(points), atol=1e-12)
    assert np.allclose(ss.EllipsoidField.from_frames(centers, shapes, values).at(points), plain.at(points), atol=1e-12)
    bad = shapes @ shapes.transpose(0, 2, 1)
    bad[17, 0, 1] += 1
    with pytest.raises(ss.InvalidInput, match="kernel 17"):
        ss.EllipsoidField.from_covariances(centers, bad, values)
    shapes[16, :, 0] = shapes[16, :, 1]
    with pytest.raises(ss.InvalidInput, match="kernel 16"):
        ss.EllipsoidField.from_frames(centers, shapes, values)


def covariances_with(matrix):
    """Return five covariances, the third one given."""
    found = np.tile(np.eye(3), (5, 1, 1))
    found[2] = matrix
    return found


@pytest.mark.parametrize(
    ("matrix", "text"),
    [
        ([(1, 0.1, 0), (0, 1, 0), (0, 0, 1)], "kernel 2.*symmetric"),
        ([(1, 2, 0), (2, 1, 0), (0, 0, 1)], "kernel 2.*positive definite"),
        (-np.eye(3), "kernel 2.*positive definite"),
        (np.zeros((3, 3)), "kernel 2.*min_scale"),
        (np.diag((1, 1, 0)), "kernel 2.*min_scale"),
        (np.full((3, 3), np.nan), "kernel 2.*finite"),
        (np.diag((1, np.inf, 1)), "kernel 2.*finite"),
    ],
)
def test_what_is_no_covariance_is_refused_with_its_index(matrix, text):
    with pytest.raises(ss.InvalidInput, match=f"(?s){text}"):
        ss.EllipsoidField.from_covariances(np.zeros((5, 3)), covariances_with(matrix), np.ones(5))


def test_flat_covariances_get_a_thickness(rng):
    matrix = random_rotations(rng, 1)[0]
    flat = matrix @ np.diag((1, 4, 0)) @ matrix.T
    field = ss.EllipsoidField.from_covariances([(0, 0, 0)], [flat], [1], min_scale=0.01)
    assert np.allclose(np.sort(field.scales[0]), (0.01, 4, 8))
    assert np.allclose(np.abs(matrices_of(field.rotations)[0].T @ matrix).max(axis=0), 1)
    with pytest.raises(ss.InvalidInput, match="positive definite"):
        ss.EllipsoidField.from_covariances([(0, 0, 0)], [np.diag((1, 1, -0.1))], [1], min_scale=0.01)


def test_frames_are_semi_axes_as_columns(soup, rng):
    centers, scales, matrices, values, weights = soup
    points = rng.normal(size=(200, 3))
    plain = ss.EllipsoidField(centers, scales, matrices, values, weights=weights)
    signs = rng.choice((-1.0, 1.0), (len(centers), 1, 3))
    field = ss.EllipsoidField.from_frames(centers, matrices * scales[:, np.newaxis] * signs, values, weights=weights)
    assert np.allclose(field.at(points), plain.at(points), atol=1e-12)
    assert np.allclose(field.scales, scales)
    huge = ss.EllipsoidField.from_frames([(0, 0, 0)], [np.diag((1e-90, 1, 1e90))], [1])
    assert np.allclose(huge.scales, (1e-90, 1, 1e90), rtol=1e-12)


def test_frames_need_right_angles():
    frames = np.tile(np.diag((1.0, 2, 3)), (4, 1, 1))
    frames[3, 0, 1] = 0.0018
    assert ss.EllipsoidField.from_frames(np.zeros((4, 3)), frames, np.ones(4)).size == 4
    frames[3, 0, 1] = 0.0022
    with pytest.raises(ss.InvalidInput, match=r"(?s)kernel 3.*from_covariances"):
        ss.EllipsoidField.from_frames(np.zeros((4, 3)), frames, np.ones(4))
    frames[1, 0, 0] = np.nan
    with pytest.raises(ss.InvalidInput, match="kernel 1"):
        ss.EllipsoidField.from_frames(np.zeros((4, 3)), frames, np.ones(4))
    flat = np.diag((1.0, 2, 0))[np.newaxis]
    with pytest.raises(ss.InvalidInput, match=r"(?s)kernel 0.*min_scale"):
        ss.EllipsoidField.from_frames(np.zeros((1, 3)), flat, [1])
    field = ss.EllipsoidField.from_frames(np.zeros((1, 3)), flat, [1], min_scale=0.1)
    assert np.allclose(field.scales, (1, 2, 0.1)) and np.allclose(np.abs(matrices_of(field.rotations)), np.eye(3))
    for other in (np.zeros((1, 3)), np.zeros((1, 4)), np.zeros((1, 2, 3)), "text", None):
        with pytest.raises(ss.InvalidInput, match="EllipsoidField"):
            ss.EllipsoidField.from_frames(np.zeros((1, 3)), other, [1])


# Ghost points.


def check_ghosts(field, ghosts, distance=1.0):
    """Every ghost is of value 0, outside all supports, and reaches no centre; the scalar at centres is as it was."""
    known = field.size
    assert ghosts.size == known + ghosts.ghosts and (ghosts.values[known:] == 0).all()
    assert np.array_equal(ghosts.centers[:known], field.centers)
    shapes = ghosts.native.shapes(np.arange(ghosts.size))
    places = ghosts.centers[known:]
    for n in range(known):
        offsets = np.linalg.solve(shapes[n], (places - field.centers[n]).T)
        assert ((offsets**2).sum(axis=0) >= 1 - 1e-8).all()
    for n in range(known, ghosts.size):
        offsets = np.linalg.solve(shapes[n], (field.centers - ghosts.centers[n]).T)
        assert ((offsets**2).sum(axis=0) >= 1 - 1e-8).all()
    assert np.allclose(ghosts.at(field.centers), field.at(field.centers), rtol=1e-9, atol=1e-12)
    assert np.allclose(ghosts.weight_at(field.centers), field.weight_at(field.centers), rtol=1e-9)


def test_ghosts_keep_the_inside(soup, rng, block):
    centers, scales, matrices, values, weights = soup
    for field in (
        ss.EllipsoidField(centers, scales, matrices, values, weights=weights),
        ss.EllipsoidField(centers, scales[:, 0], values=values),
        ss.EllipsoidField(centers, scales * (1, 0.05, 0.01), matrices, values),
        ball_of_kernels(rng, 200),
    ):
        for distance in (1.0, 1.5):
            ghosts = field.with_ghost_points(distance=distance)
            assert 0 < ghosts.ghosts <= 14 * field.size
            check_ghosts(field, ghosts)
        assert ghosts.isotropic == field.isotropic and "ghost points" in repr(ghosts)
    dense = ss.EllipsoidField(block, np.full(len(block), 2.2), values=np.ones(len(block)))
    ghosts = dense.with_ghost_points()
    check_ghosts(dense, ghosts)
    # All lie outside the block, on each of its sides, fewer than twice as many as there are samples on its surface.
    outside = ((ghosts.centers[dense.size :] < 0) | (ghosts.centers[dense.size :] > 8)).any(axis=1)
    assert outside.all() and ghosts.ghosts < 2 * (9**3 - 7**3)
    assert (ghosts.centers.min(axis=0) < -2).all() and (ghosts.centers.max(axis=0) > 10).all()


def test_ghosts_make_borders_soft(block):
    abrupt = ss.EllipsoidField(block, np.full(len(block), 2.2), values=np.full(len(block), 5.0), w0=1e-3)
    soft = abrupt.with_ghost_points()
    line = np.linspace((4.3, 4.6, 4.5), (4.3, 4.6, 12.0), 400)
    steps = {name: np.abs(np.diff(field.at(line))).max() for name, field in (("abrupt", abrupt), ("soft", soft))}
    assert steps["soft"] < 0.2 * steps["abrupt"]
    along = soft.at(line)
    assert along[0] == pytest.approx(5) and along[-1] == 0 and (np.diff(along) < 1e-3).all()
    # In the inside, a semi-axis and more away from the border, nothing changed.
    inner = np.random.default_rng(1).uniform(2.2, 5.8, (200, 3))
    assert np.array_equal(soft.at(inner), abrupt.at(inner))


def test_ghosts_of_mixed_sizes_are_few_and_quick(rng):
    count = 2000
    centers = rng.random((count, 3))
    centers[: count // 2] *= 1e-6
    radii = np.where(np.arange(count) < count // 2, 1e-7, 0.2)
    field = ss.EllipsoidField(centers, radii, values=np.ones(count))
    ghosts = field.with_ghost_points()
    check_ghosts(field, ghosts)
    assert 0 < ghosts.ghosts < count


def test_kernels_without_weight_have_no_ghosts():
    field = ss.EllipsoidField([(0, 0, 0), (10, 0, 0)], [1, 1], values=[1, 1], weights=[1, 0])
    ghosts = field.with_ghost_points(weight=0.25)
    assert ghosts.ghosts == 14 and ghosts.bounds[1][0] < 10.5 + 1 and (ghosts.weights[2:] == 0.25).all()
    assert (ghosts.centers[2:, 0] < 2).all()
    plain = ss.EllipsoidField([(0, 0, 0)], [1], values=[1])
    assert plain.with_ghost_points().weights is None
    assert np.array_equal(plain.with_ghost_points(weight=2).weights, [1] + 14 * [2])


@pytest.mark.parametrize(
    "options",
    [{"distance": 0.9}, {"distance": 2.1}, {"distance": np.nan}, {"weight": 0}, {"weight": np.inf}, {"weight": "1"}],
)
def test_ghosts_without_meaning_are_refused(options):
    field = ss.EllipsoidField([(0, 0, 0)], [1], values=[1])
    with pytest.raises(ss.InvalidInput, match="ghost points"):
        field.with_ghost_points(**options)
    with pytest.raises(ss.InvalidInput, match="14 of them"):
        field.with_ghost_points().with_ghost_points()


@pytest.mark.parametrize("points", [(0, 0, 0), [(0, 0)], [(0, np.nan, 0)], None, "abc"])
def test_points_without_meaning_are_refused(points):
    field = ss.EllipsoidField([(0, 0, 0)], [1], values=[1])
    with pytest.raises(ss.InvalidInput, match="point"):
        field.at(points)


# Scenes, cameras, the automatic look, advice and info.


def test_scenes_take_fields_of_any_kind(ball, rng):
    scattered, regular = ball_of_kernels(rng), ss.RegularField(ball)
    function = [(0, 0, 0, 0, 0), (2, 1, 1, 1, 1)]
    scene = ss.Scene([regular, scattered], function, filter="ewa")
    assert scene.fields == (regular, scattered) and scene.filter == "ewa"
    assert scene.slice_spacing == min(regular.default_slice_spacing, scattered.default_slice_spacing)
    assert scene.bounds[0] == tuple(np.minimum(regular.bounds[0], scattered.bounds[0]))
    assert ss.Scene(scattered, function).filter is None and "EllipsoidField" in repr(scene)
    for bad in ("EWA", "none", True, 1):
        with pytest.raises(ss.InvalidInput, match="filter"):
            ss.Scene(scattered, function, filter=bad)
    with pytest.raises(ss.InvalidInput, match="EllipsoidField"):
        ss.Scene([scattered, None], function)


def test_cameras_fit_what_the_supports_reach(rng):
    field = ball_of_kernels(rng)
    camera = ss.Camera.fit(field, (1, 0.3, -0.5))
    for corner in np.array(np.meshgrid(*np.transpose(field.bounds))).reshape(3, -1).T:
        x, y, _ = camera.native.to_eye(tuple(corner))
        assert max(abs(x), abs(y)) <= camera.height / 2
    assert ss.Camera.fit([field]).eye == ss.Camera.fit(ss.Scene(field, [(0, 0, 0, 0, 0), (1, 1, 1, 1, 1)])).eye


def test_places_lie_where_the_volumes_are():
    # Of two kernels one has 64 times the volume of the other.
    field = ss.EllipsoidField([(0, 0, 0), (100, 0, 0)], [1, 4], values=[1, 2])
    places = automatic.places_in(field, 2700)
    far = places[:, 0] > 50
    assert abs(far.sum() - 2700 * 64 / 65) < 1 and np.linalg.norm(places[~far], axis=1).max() <= 0.5
    assert np.array_equal(places, automatic.places_in(field, 2700))
    # Neither ghosts nor kernels without weight count.
    assert (automatic.places_in(field.with_ghost_points(), 100)[:, 0] > -0.6).all()
    weighted = ss.EllipsoidField([(0, 0, 0), (100, 0, 0)], [1, 3], values=[1, 2], weights=[1, 0])
    assert automatic.places_in(weighted, 100)[:, 0].max() < 1


def test_the_look_follows_values_and_units(rng):
    centers = rng.normal(size=(800, 3))
    values = np.where(np.linalg.norm(centers, axis=1) < 1, rng.normal(100, 5, 800), rng.normal(10, 3, 800))
    look = automatic.choose([ss.EllipsoidField(centers, np.full(800, 0.8), values=values)])
    assert 20 < look.surface < 80 and 85 < look.clim[1] < 115
    larger = automatic.choose([ss.EllipsoidField(1e6 * centers, np.full(800, 0.8e6), values=1e-3 * values)])
    assert np.allclose(np.array(larger.clim) * 1e3, look.clim) and np.isclose(larger.top_opacity, look.top_opacity)


def test_a_few_large_values_do_not_make_the_look_impossible(rng, caplog):
    # A thousand kernels of next to nothing, and three small ones with 10,000 times that.
    centers = rng.normal(size=(1003, 3))
    values = np.append(rng.uniform(0.1, 0.3, 1000), [3000.0] * 3)
    field = ss.EllipsoidField(centers, np.append(np.full(1000, 0.8), [0.05] * 3), values=values)
    # The command line turns the logger down where it runs in the same process.
    with caplog.at_level(logging.WARNING, "sheetsplat"):
        look = automatic.choose([field])
    assert look.clim[0] < 0.3 and 3000 / (look.clim[1] - look.clim[0]) == pytest.approx(20)
    assert look.opacity[0][0] == look.clim[0] and look.opacity[-1][0] == pytest.approx(look.clim[1])
    assert "log=True" in caplog.text


def test_thin_slices_get_less_opacity(rng):
    thick = ball_of_kernels(rng)
    thin = ss.EllipsoidField(thick.centers, thick.scales[:, np.newaxis] * (1, 1, 1e-2), values=thick.values)
    looks = [automatic.choose([field]) for field in (thick, thin)]
    assert looks[0].top_opacity == pytest.approx(automatic.TOP_OPACITY)
    # The same opacity over the same length.
    length = thick.default_slice_spacing
    per_length = 1 - (1 - looks[1].top_opacity) ** (length / thin.default_slice_spacing)
    assert looks[1].top_opacity < 0.3 and per_length > 0.9
    assert looks[1].opacity[-1][1] == pytest.approx(looks[1].top_opacity)
    scene = compose_scene([thin], clim=(1, 2))
    assert scene.transfer_function.max_opacity == pytest.approx(looks[1].top_opacity)


def test_sums_far_from_the_values_are_found(block):
    # Sums of some three kernels everywhere, and weights of a millionth.
    sums_up = ss.EllipsoidField(block, np.full(len(block), 2.2), values=np.ones(len(block)), normalization="none")
    assert 1.5 < automatic.choose([sums_up]).clim[1] < 3.5
    light = ss.EllipsoidField(
        block, np.full(len(block), 2.2), values=np.ones(len(block)), weights=np.full(len(block), 1e-6)
    )
    assert 1e-6 < automatic.choose([light]).clim[1] < 4e-6


@pytest.mark.parametrize("mode", ["composite", "isosurface", "xray", "mip"])
def test_every_mode_shows_something(rng, mode):
    picture = np.asarray(ss.render(ball_of_kernels(rng), mode=mode, **SMALL))
    assert picture.max() > 0.3 and (picture.reshape(32, 32, -1)[0, 0] == 0).all()


@pytest.mark.parametrize("kind", ["one", "equal", "flat", "heavy"])
def test_odd_fields_show_something(rng, kind):
    centers = rng.normal(size=(50, 3))
    field = {
        "one": lambda: ss.EllipsoidField([(0, 0, 0)], [1], values=[-5]),
        "equal": lambda: ss.EllipsoidField(centers, np.full(50, 1.0), values=np.full(50, 7.5)),
        "flat": lambda: ss.EllipsoidField(centers, np.tile((1, 1, 1e-3), (50, 1)), values=rng.random(50)),
        "heavy": lambda: ss.EllipsoidField(centers, np.full(50, 1.0), values=np.full(50, 1e280)),
    }[kind]()
    picture = ss.render(field, **SMALL).rgba if kind != "heavy" else None
    if picture is not None:
        assert np.isfinite(picture).all() and picture[..., 3].max() > 0.05
    assert np.isfinite(automatic.choose([field]).clim).all()


def test_a_lattice_of_ellipsoids_is_a_regular_field(block):
    values = np.linalg.norm(block - 4, axis=1)
    regular = ss.RegularField(values.reshape(9, 9, 9).transpose(2, 1, 0))
    scattered = ss.EllipsoidField(
        block, np.full(len(block), 2.0), values=values, normalization="lattice", falloff=5, cell_volume=1
    )
    camera = ss.Camera.fit(regular, (0.3, -0.4, -1))
    function = ss.TransferFunction([(0, 0, 0, 1, 0.1), (4, 1, 0, 0, 0), (7, 0, 1, 0, 0.3)])
    renderer = ss.Renderer("reference")
    pictures = [
        renderer.render(ss.Scene(field, function, lights=[ss.Light()], slice_spacing=1), camera, size=(24, 24)).rgba
        for field in (regular, scattered)
    ]
    assert pictures[0][..., 3].max() > 0.3 and np.allclose(*pictures, atol=2e-6)
    other = ss.EllipsoidField(
        block, np.full(len(block), 2.02), values=values, normalization="lattice", falloff=5, cell_volume=1
    )
    moved = renderer.render(ss.Scene(other, function, lights=[ss.Light()], slice_spacing=1), camera, size=(24, 24)).rgba
    assert not np.allclose(pictures[0], moved, atol=1e-4)


def test_fields_add_up(rng, block):
    field = ball_of_kernels(rng)
    half = ss.EllipsoidField(field.centers, field.scales, values=field.values / 2)
    expected = ss.render(field, clim=(0, 2), **SMALL).rgba
    assert expected[..., 3].max() > 0.5
    assert np.allclose(ss.render([half, half], clim=(0, 2), **SMALL).rgba, expected, atol=1e-5)
    assert not np.allclose(ss.render(half, clim=(0, 2), **SMALL).rgba, expected, atol=0.05)


def test_advice_tells_what_the_scalars_are(rng):
    field = ball_of_kernels(rng)
    scene = ss.Scene(field, [(10, 0, 0, 0, 0), (20, 1, 1, 1, 1)])
    assert "the opacity is 0 for all of the values" in why_empty(scene)
    summed = ss.EllipsoidField(field.centers, field.scales, values=-field.values, normalization="none")
    scene = ss.Scene(summed, [(0, 0, 0, 0, 0), (1, 1, 1, 1, 1)], mode="mip")
    assert "shows nothing below 0" in why_empty(scene)


def test_info_describes_fields(rng, soup):
    centers, scales, matrices, values, weights = soup
    field = ss.EllipsoidField(centers, scales, matrices, values, weights=weights)
    report = info.describe(field, 8)
    assert report["kernels"] == 40 and report["kind"] == "ellipsoids" and report["memory_bytes"] == field.memory
    assert report["minimum"] == values.min() and sum(report["histogram"]["counts"]) == 40
    aspects = scales.max(axis=1) / scales.min(axis=1)
    assert report["aspect"]["largest"] == aspects.max() and report["aspect"]["median"] == np.median(aspects)
    json.dumps(report)
    told = {"file": "f", "format": "ellipsoids", "points": 40, "scalar": "a", "scalars": ["a"], "details": {}}
    text = info._table({**told, **report})
    for part in ("40 ellipsoids", "semi-axes", "aspect", "weights", "threshold", "histogram", "shown"):
        assert part in text
    spheres = info.describe(ball_of_kernels(rng).with_ghost_points(), 8)
    assert spheres["kind"] == "spheres" and spheres["aspect"]["largest"] == 1
    assert sum(spheres["histogram"]["counts"]) == 400
    nothing = info.describe(ss.EllipsoidField([], [], values=[]), 8)
    assert nothing["kernels"] == 0 and "0 spheres" in info._table({**told, **nothing})
