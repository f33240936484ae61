"""Fewer kernels for the same field: what is kept exactly, what nearly, and that pictures stay what they were."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sheetsplat as ss
from sheetsplat.compare import compare
from sheetsplat.encode.merging import merged, unit_moments
from sheetsplat.encode.pairs import Clusters, Measure, costs
from sheetsplat.fields.axes import frames
from sheetsplat.look.decades import floor_of, logarithmic

DATA = Path(os.environ.get("SHEETSPLAT_DATA", "data"))


def axes_of(field):
    return np.broadcast_to(field.scales[:, None] if field.scales.ndim == 1 else field.scales, (field.size, 3))


def weights_of(field):
    return np.ones(field.size) if field.weights is None else field.weights


def masses(field):
    return unit_moments(field.falloff)[0] * axes_of(field).prod(axis=1) * weights_of(field)


def covariances(field):
    turned = np.eye(3)[None] if field.rotations is None else frames(field.rotations)
    spread = np.einsum("nij,nj,nkj->nik", turned, np.square(axes_of(field)), turned)
    return unit_moments(field.falloff)[1] * spread


def moments(field):
    """Return mass, integral of values, mean place and covariance of a whole field."""
    mass, spread = masses(field), covariances(field)
    total = mass.sum()
    mean = mass @ field.centers / total
    apart = field.centers - mean
    both = np.einsum("n,nij->ij", mass, spread + apart[:, :, None] * apart[:, None, :]) / total
    return total, mass @ (field.values - field.base), mean, both


def random_field(count=600, *, kind="turned", seed=3, **options):
    random = np.random.default_rng(seed)
    centers = random.normal(size=(count, 3)) * [3.0, 2.0, 1.0]
    scales = 0.3 + 0.4 * random.random((count, 3))
    turns = random.normal(size=(count, 4))
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    return ss.EllipsoidField(
        centers,
        scales[:, 0] if kind == "spheres" else scales,
        turns if kind == "turned" else None,
        np.cos(centers[:, 0]) + 2.0,
        weights=0.2 + random.random(count),
        **options,
    )


def planted(**options):
    """Return a field of 40 far groups of 8 kernels, near each other, and the group of each kernel."""
    random = np.random.default_rng(8)
    middles = np.stack(np.meshgrid(np.arange(5), np.arange(4), np.arange(2)), axis=-1).reshape(-1, 3) * 30.0
    group = np.repeat(np.arange(40), 8)
    shuffled = random.permutation(320)
    turns = random.normal(size=(320, 4))
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    arrays = (
        middles[group] + random.normal(size=(320, 3)),
        0.5 + random.random((320, 3)),
        turns,
        1.0 + 0.01 * group + 0.1 * random.random(320),
    )
    weights = 0.1 + random.random(320)
    return ss.EllipsoidField(*(one[shuffled] for one in arrays), weights=weights[shuffled], **options), group[shuffled]


# ---- moments


@pytest.mark.parametrize("falloff", [1e-6, 0.5, 4.13, 8.0, 300.0])
def test_moments_of_the_profile(falloff):
    radius = np.linspace(0.0, min(1.0, 8.0 / np.sqrt(falloff)), 400_001)
    profile = (np.expm1(-falloff * radius**2) - np.expm1(-falloff)) / -np.expm1(-falloff)
    second, fourth = np.trapezoid(profile * radius**2, radius), np.trapezoid(profile * radius**4, radius)
    mass, variance = unit_moments(falloff)
    assert mass == pytest.approx(4.0 * np.pi * second, rel=1e-8)
    assert variance == pytest.approx(fourth / (3.0 * second), rel=1e-8)


@pytest.mark.parametrize("options", [{}, {"base": -7.0}, {"normalization": "none"}], ids=str)
def test_planted_clusters_are_found_with_their_moments(options):
    field, group = planted(**options)
    found = merged(field, 40)
    assert found.size == 40
    for kernel in range(40):
        one = found.part(np.array([kernel]))
        near = np.linalg.norm(field.centers - one.centers, axis=1).argmin()
        wanted = moments(field.part(group == group[near]))
        for mine, theirs in zip(moments(one), wanted, strict=True):
            np.testing.assert_allclose(mine, theirs, rtol=1e-10, atol=1e-10 * np.abs(theirs).max())


@pytest.mark.parametrize("kind", ["spheres", "straight", "turned"])
@pytest.mark.parametrize("count", [1, 30, 599])
def test_the_whole_keeps_its_moments(kind, count):
    field = random_field(kind=kind, base=0.5)
    found = merged(field, count)
    assert found.size == count
    for mine, theirs in zip(moments(found), moments(field), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-10, atol=1e-10)


def test_kernels_that_are_alone_stay_as_they_are():
    field, _ = planted()
    found = merged(field, 319)
    same = [(np.abs(found.centers - center).max(axis=1) == 0).any() for center in field.centers]
    assert sum(same) == 318
    kept = np.array([np.abs(found.centers - center).max(axis=1).argmin() for center in field.centers])[same]
    np.testing.assert_array_equal(found.scales[kept], field.scales[same])
    np.testing.assert_array_equal(found.values[kept], field.values[same])
    np.testing.assert_array_equal(found.weights[kept], field.weights[same])


def test_coincident_kernels_are_merged_first_and_change_nothing():
    # (So few that the ends of the box are not held.)
    field = random_field(90)
    twice = [np.concatenate((array, array)) for array in (field.centers, field.scales, field.rotations, field.values)]
    double = ss.EllipsoidField(*twice, weights=np.concatenate((field.weights, field.weights)))
    found = merged(double, 90)
    points = np.random.default_rng(1).normal(size=(2000, 3)) * 2.0
    np.testing.assert_allclose(found.at(points), double.at(points), rtol=1e-9, atol=1e-9)


def test_the_box_of_centres_stays():
    """Pictures anchor their slices by it."""
    field = random_field(2000)
    found = merged(field, 200)
    np.testing.assert_array_equal(np.ptp(found.centers, axis=0), np.ptp(field.centers, axis=0))
    np.testing.assert_array_equal(found.centers.min(axis=0), field.centers.min(axis=0))


def test_more_kernels_are_a_closer_field():
    field = random_field(3000, kind="spheres", w0=0.1)
    points = field.centers[::3]
    exact = field.at(points)
    errors = [np.sqrt(np.mean(np.square(merged(field, count).at(points) - exact))) for count in (100, 300, 1000)]
    print("RMSE of a field of 1.0 to 3.0 by kernels", errors)
    assert errors == sorted(errors, reverse=True) and errors[2] < 0.5 * errors[0]


def test_kernels_go_where_the_field_has_details():
    """One half has one value, in the other each kernel has its own: most kernels are kept there."""
    random = np.random.default_rng(6)
    centers = random.random((4000, 3)) * 10.0
    rough = centers[:, 0] > 5.0
    values = np.where(rough, 1.0 + random.random(4000), 1.5)
    found = merged(ss.EllipsoidField(centers, np.full(4000, 0.8), values=values), 800)
    assert (found.centers[:, 0] > 5.0).sum() > 500


# ---- what is kept of the field


def test_options_of_the_field_are_kept():
    field = random_field(w0=0.3, falloff=5.0, base=0.25).with_quantity("density", "kg", "m").of_particles()
    found = merged(field, 50)
    for name in ("normalization", "w0", "falloff", "base", "keeps_mass", "quantity", "orientation", "periodic"):
        assert getattr(found, name) == getattr(field, name), name
    assert found.keeps_mass and found.quantity.name == "density"


def test_x_rays_of_particles_keep_their_mass():
    random = np.random.default_rng(2)
    points = random.normal(size=(3000, 3))
    lengths = 0.2 + 0.2 * random.random(3000)
    kernels = ss.fit.sph(points, 1.0 + random.random(3000), lengths, masses=np.ones(3000), densities=np.ones(3000))
    field = kernels.field()
    found = merged(field, 300)

    camera = ss.Camera.orthographic(eye=(0, 0, 50), target=(0, 0, 0), up=(0, 1, 0), height=16.0)

    def mass(one):
        scene = ss.Scene([one.summed()], ss.TransferFunction.from_colormap("gray"), mode="xray", slice_spacing=0.05)
        picture = ss.Renderer(backend="cpu").render(scene, camera, size=(200, 200))
        return float(picture.scalar.astype(np.float64).sum() * (16.0 / 200.0) ** 2)

    assert mass(field) == pytest.approx(masses(field) @ field.values, rel=1e-4)
    assert mass(found) == pytest.approx(mass(field), rel=1e-4)
    assert masses(found) @ found.values == pytest.approx(masses(field) @ field.values, rel=1e-12)


@pytest.mark.parametrize("axes", [(True, True, True), (False, True, False)])
def test_kernels_merge_across_the_faces_of_a_periodic_box(axes):
    box = ((0.0, 0.0, 0.0), tuple(10.0 if wraps else 0.0 for wraps in axes))
    random = np.random.default_rng(4)
    centers = np.concatenate((random.normal(size=(50, 3)) * 0.3 + [5.0, 0.0, 5.0], [(5.0, 5.0, 5.0)]))
    centers = np.where(axes, np.mod(centers, 10.0), centers)
    field = ss.EllipsoidField(centers, np.ones(51), values=np.arange(51.0), periodic=box)
    found = merged(field, 2)
    assert found.periodic == field.periodic and found.size == 2
    cluster = found.part(np.array([found.weights.argmax()]))
    assert min(cluster.centers[0, 1], 10.0 - cluster.centers[0, 1]) < 0.2
    assert cluster.scales.max() < 2.0
    assert masses(found).sum() == pytest.approx(masses(field).sum(), rel=1e-12)


# ---- invariances


def test_the_same_field_has_the_same_kernels():
    for name in ("centers", "scales", "rotations", "values", "weights"):
        first, second = (getattr(merged(random_field(), 60), name) for _ in range(2))
        np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("change", ["moved", "scaled", "turned", "base", "values", "weights"])
def test_worlds_that_are_moved_have_fields_that_are_moved(change):
    field = random_field(kind="spheres")
    turn = Rotation.from_rotvec([0.3, -0.7, 0.2])
    centers, scales = np.array(field.centers), np.array(field.scales)
    values, weights = np.array(field.values), np.array(field.weights)

    def to(points):
        if change == "turned":
            return turn.apply(np.array(points))
        return points * (1000.0 if change == "scaled" else 1.0) + (7.0 if change == "moved" else 0.0)

    scales = scales * (1000.0 if change == "scaled" else 1.0)
    base = 5.0 if change == "base" else 0.0
    values = values * (1e6 if change == "values" else 1.0)
    factor = 0.125 if change == "weights" else 1.0
    other = ss.EllipsoidField(to(centers), scales, values=values + base, weights=factor * weights, base=base)
    # (Below the count that keeps the ends of the box, which turns with the axes.)
    count = 90
    first, second = merged(field, count), merged(other, count)
    order = np.array([np.linalg.norm(second.centers - at, axis=1).argmin() for at in to(first.centers)])
    assert sorted(order) == list(range(count))
    second = second.part(order)
    size = 1000.0 if change == "scaled" else 1.0
    np.testing.assert_allclose(second.centers, to(first.centers), atol=1e-8 * size)
    np.testing.assert_allclose(second.scales, first.scales * size, rtol=1e-8)
    scale = 1e6 if change == "values" else 1.0
    np.testing.assert_allclose(second.values, first.values * scale + base, rtol=1e-8)
    np.testing.assert_allclose(second.weights, first.weights * factor, rtol=1e-8)


# ---- costs


def test_the_cost_of_a_pair_is_the_integral_of_the_squared_difference():
    random = np.random.default_rng(12)
    covariances = np.array([[0.5, 0.4, 0.6, 0.1, 0.05, -0.1], [0.3, 0.7, 0.5, -0.1, 0.1, 0.0]]).T
    centers = np.array([[0.0, 0.0, 0.0], [0.7, -0.3, 0.4]]).T
    clusters = Clusters(np.array([1.0, 2.0]), centers, covariances, np.array([[3.0, 1.0]]), np.arange(2))
    apart = centers[:, 1:] - centers[:, :1]
    measures = [Measure(0, 0.0)]
    found = float(costs(clusters, np.array([0]), np.array([1]), apart, measures)[0])

    def matrix(six):
        xx, yy, zz, xy, xz, yz = six
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    def density(at, center, six, amount):
        inverse, apart = np.linalg.inv(matrix(six)), at - center
        square = np.einsum("ni,ij,nj->n", apart, inverse, apart)
        return amount * np.exp(-0.5 * square) / np.sqrt(np.linalg.det(matrix(six)))

    points = random.uniform(-5.0, 5.0, (2_000_000, 3)) + 0.3
    before = sum(density(points, centers[:, n], covariances[:, n], (3.0, 1.0)[n]) for n in range(2))
    clusters.joined(np.array([0]), np.array([1]), apart)
    after = density(points, clusters.centers[:, 0], clusters.covariances[:, 0], 4.0)
    # Densities here lack (2 pi)^(-3/2), the costs that of a product of two.
    wanted = 1000.0 * np.mean(np.square(before - after)) / (2.0 * np.pi) ** 1.5
    assert found == pytest.approx(wanted, rel=0.02)


# ---- bad input


@pytest.mark.parametrize("count", [0, -1, 2.5, "many", None])
def test_impossible_counts_are_refused(count):
    with pytest.raises(ss.InvalidInput, match="count"):
        merged(random_field(50), count)


def test_ghost_points_are_refused():
    with pytest.raises(ss.InvalidInput, match="ghost"):
        merged(random_field(50).with_ghost_points(), 10)


def test_fields_that_are_small_enough_stay():
    field = random_field(50)
    assert merged(field, 50) is field and merged(field, 1000) is field


def test_odd_fields_are_merged():
    """Weights of 0, one value, values of the base alone, kernels in a plane and of extreme shapes."""
    field = random_field(200)
    weights = np.where(np.arange(200) % 2, 0.0, field.weights)
    assert merged(field.with_rows(field.centers, field.scales, field.rotations, field.values, weights), 20).size == 20
    for value in (0.0, 3.0):
        same = field.with_rows(field.centers, field.scales, field.rotations, np.full(200, value), field.weights)
        found = merged(same, 20)
        np.testing.assert_allclose(found.values, value, rtol=1e-12)
    needles = ss.EllipsoidField(
        field.centers * [1.0, 1.0, 0.0], np.tile([1.0, 1e-9, 1e-6], (200, 1)), field.rotations, field.values
    )
    found = merged(needles, 20)
    assert masses(found).sum() == pytest.approx(masses(needles).sum(), rel=1e-9)
    same = ss.EllipsoidField(np.zeros((200, 3)), np.ones(200), values=np.ones(200))
    np.testing.assert_allclose(merged(same, 3).scales, 1.0, rtol=1e-9)


# ---- pictures of measured particles


def test_a_tenth_of_the_particles_makes_the_same_pictures():
    """91,048 particles of gas to 9,105 kernels: the x-ray and the default composite, RMSE below 5e-3."""
    path = DATA / "sph_gas_nchilada12M.h5"
    if not path.exists():
        pytest.skip(f"{path.name} is measured data; set SHEETSPLAT_DATA to their folder")
    field = ss.open(path)
    found = merged(field, 9105)
    assert masses(found) @ found.values == pytest.approx(masses(field) @ field.values, rel=1e-12)
    floor = floor_of(field)
    shown = {"xray": lambda one: one.summed(), "composite": lambda one: logarithmic(one, floor)}
    every = field.part(np.arange(0, field.size, 10))
    for mode, form in shown.items():
        wanted = ss.render(field, mode=mode, size=(400, 400), backend="cpu")
        recipe = wanted.recipe

        def distance(one, form=form, recipe=recipe, wanted=wanted):
            picture = ss.Renderer(backend="cpu").render(recipe.scene([form(one)]), recipe.camera, size=recipe.size)
            scale = float(np.abs(wanted.pixels).max()) if wanted.is_scalar else 1.0
            return compare(picture.pixels / scale, wanted.pixels / scale)["rmse"]

        reached = distance(found)
        print(f"{mode}: RMSE {reached:.5f}")
        assert reached <= 5e-3
        # Every tenth particle is far from it.
        assert distance(every) > 0.02
