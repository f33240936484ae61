"""Fields of ellipsoids: what they take, what they keep, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import random_rotations

import sheetsplat as ss
from sheetsplat.fields import axes
from sheetsplat.look.empty import why_empty

SMALL = {"size": (32, 32), "backend": "reference", "quality": "draft"}


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
    monkeypatch.setattr(axes, "_BLOCK", 7)
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
    with pytest.raises(ss.InvalidInput, match="frame 16"):
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
    with pytest.raises(ss.InvalidInput, match=r"(?s)frame 3.*from_covariances"):
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
