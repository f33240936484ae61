"""Free ellipsoids fitted to samples: planted ones are found again, from any place, direction and unit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sheetsplat as ss
from sheetsplat import _sheetsplat
from sheetsplat.encode import refining
from sheetsplat.encode.free import COLUMNS, Ellipsoids, Samples
from sheetsplat.encode.refining import greedy, prune, refine

SIDE = 48


def planted(count, seed, side=SIDE, *, separate, shape=None):
    """Return random ellipsoids of aspects to 1:8 whose centres lie in a cube; `separate`: supports do not meet."""
    random = np.random.default_rng(seed)
    centers, shapes, reach = [], [], []
    while len(centers) < count:
        axes = random.uniform(2.0, 3.0 if separate else 5.0) * 8.0 ** np.array([0.0, *random.random(2)])
        axes = np.minimum(axes, 16.0) if separate else axes
        center = random.uniform(4.0, side - 5.0, 3)
        if separate and any(
            np.linalg.norm(center - c) < 0.75 * (axes.max() + a) for c, a in zip(centers, reach, strict=True)
        ):
            continue
        centers.append(center)
        reach.append(axes.max())
        shapes.append(Rotation.random(random_state=random).as_matrix() * axes)
    values = random.uniform(0.3, 1.0, count) * random.choice([-1.0, 1.0], count)
    return Ellipsoids.of_shapes(centers, shapes, values)


def sampled(kernels, shape=(SIDE,) * 3, points=None):
    """Return the sum of kernels at the places of a lattice, or at points."""
    data = np.zeros(shape if points is None else len(points))
    fit = _sheetsplat.EllipsoidFit(data, points=points, falloff=kernels.falloff)
    return fit.sums(kernels.rows).reshape(data.shape) + kernels.base


def relative(kernels, data):
    """Return the root mean square of what is left, over that of the data."""
    return float(np.sqrt(np.mean((sampled(kernels, data.shape) - data) ** 2)) / np.std(data))


def assert_same(found, wanted, tolerance=1e-6):
    """Compare kernels in any order by their centres, shapes and values."""
    assert len(found) == len(wanted)
    away = np.linalg.norm(found.centers[:, None] - wanted.centers, axis=2)
    order = away.argmin(axis=0)
    assert sorted(order) == list(range(len(wanted)))
    np.testing.assert_allclose(found.centers[order], wanted.centers, atol=tolerance * 10)
    np.testing.assert_allclose(found.shapes()[order], wanted.shapes(), atol=tolerance * 10)
    np.testing.assert_allclose(found.values[order], wanted.values, rtol=tolerance)


def test_the_sum_is_that_of_the_field():
    kernels = planted(6, 3, separate=False)
    kernels = Ellipsoids(kernels.rows, base=2.5)
    points = np.random.default_rng(1).uniform(0.0, SIDE, (500, 3))
    sums = kernels.base + np.asarray(kernels.field().native.sums_at(points)[0][:, 0])
    np.testing.assert_allclose(sampled(kernels, points=points), sums, atol=1e-12)
    assert kernels.semi_axes().min() >= 2.0 - 1e-9


def test_derivatives_are_those_of_differences():
    kernels = planted(5, 1, separate=False)
    data = np.random.default_rng(0).random((12, 14, 16))
    rows = kernels.rows.copy()
    rows[:, :3] *= 0.3
    fit = _sheetsplat.EllipsoidFit(data)
    _, slope = fit.objective(rows)
    step = 1e-5
    for column in range(COLUMNS):
        for row in range(len(rows)):
            change = np.zeros_like(rows)

            def at(by, change=change, row=row, column=column):
                change[row, column] = by
                return fit.objective(_sheetsplat.changed_ellipsoids(rows, change))[0]

            difference = (8 * (at(step) - at(-step)) - (at(2 * step) - at(-2 * step))) / (12 * step)
            assert slope[row, column] == pytest.approx(difference, rel=1e-6, abs=1e-6 * np.abs(slope[:, column]).max())


@pytest.mark.parametrize("seed", range(3))
def test_separate_kernels_are_found_exactly(seed):
    wanted = planted(8, seed, separate=True)
    data = sampled(wanted)
    found = greedy(data, 8)
    assert relative(found, data) < 1e-9
    assert_same(found, wanted)
    assert found.error == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("seed", range(2))
def test_overlapping_kernels_are_found_exactly(seed):
    wanted = planted(8, 10 + seed, separate=False)
    data = sampled(wanted)
    assert relative(greedy(data, 8), data) < 1e-6


@pytest.mark.slow
def test_forty_overlapping_kernels_are_found_exactly():
    """So it is with four of the seeds 0 to 5; of the others two hundredths are left."""
    data = sampled(planted(40, 0, separate=False))
    assert relative(greedy(data, 40), data) < 1e-6


def test_refining_recovers_what_was_disturbed():
    wanted = planted(40, 5, separate=False)
    data = sampled(wanted)
    random = np.random.default_rng(2)
    change = 0.02 * random.normal(size=wanted.rows.shape)
    disturbed = Ellipsoids(_sheetsplat.changed_ellipsoids(wanted.rows, change))
    assert relative(disturbed, data) > 0.01
    found = refine(data, disturbed)
    assert relative(found, data) < 1e-9
    assert_same(found, wanted, 1e-5)


def test_moved_turned_and_scaled_data_have_moved_turned_and_scaled_kernels():
    wanted = planted(4, 2, side=32, separate=True)
    data = sampled(wanted, (32,) * 3)
    # Axes in another order, one of them reversed: x' = z, y' = x, z' = 31 - y.
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    turned = np.ascontiguousarray(np.transpose(data, (1, 2, 0))[::-1])
    expected = Ellipsoids.of_shapes(wanted.centers @ turn.T + [0.0, 0.0, 31.0], turn @ wanted.shapes(), wanted.values)
    np.testing.assert_allclose(sampled(expected, turned.shape), turned, atol=1e-12)
    assert_same(greedy(turned, 4), expected)
    moved = np.pad(data, ((5, 0), (3, 0), (2, 0)))
    expected = Ellipsoids.of_shapes(wanted.centers + [2.0, 3.0, 5.0], wanted.shapes(), wanted.values)
    cut = Samples.of(np.where(np.pad(np.ones_like(data), ((5, 0), (3, 0), (2, 0))) > 0, moved, np.nan))
    assert_same(greedy(cut, 4), expected)
    for factor, base in ((1e-20, 0.0), (-3e15, 0.0), (2.0, 7.0)):
        found = greedy(data * factor + base, 4)
        assert found.base == pytest.approx(base, abs=1e-12)
        assert_same(Ellipsoids(found.rows / ([1.0] * 9 + [factor])), wanted)


def test_float32_is_enough():
    wanted = planted(4, 6, side=32, separate=True)
    data = sampled(wanted, (32,) * 3)
    found = greedy(data.astype(np.float32), 4)
    assert_same(found, wanted, 1e-5)
    assert relative(found, data) < 1e-6


def test_missing_samples_do_not_count():
    wanted = planted(4, 7, side=32, separate=True)
    data = sampled(wanted, (32,) * 3)
    gone = np.random.default_rng(3).random(data.shape) < 0.3
    gone[:, :, 20:23] = True
    found = greedy(np.where(gone, np.nan, data), 4)
    assert relative(found, data) < 1e-6
    nothing = greedy(np.full((4, 5, 6), np.nan), 3)
    assert len(nothing) == 0 and nothing.error == 0.0


def test_points_are_fitted_as_lattices_are():
    wanted = planted(4, 8, side=32, separate=True)
    points = np.random.default_rng(4).uniform(0.0, 31.0, (20000, 3))
    data = sampled(wanted, points=points)
    found = greedy(Samples.of(data, points=points), 4)
    assert_same(found, wanted)
    # In another unit of length.
    found = greedy(Samples.of(data, points=points * 1e3 + 5e4), 4)
    assert_same(Ellipsoids.of_shapes((found.centers - 5e4) / 1e3, found.shapes() / 1e3, found.values), wanted)


def test_constant_data_have_no_kernels():
    for data in (np.full((6, 7, 8), 3.25), np.zeros((1, 1, 1))):
        found = greedy(data, 5)
        assert len(found) == 0 and found.base == data.flat[0] and found.error == 0.0
        assert found.field().size == 0


def test_one_sample_that_differs():
    data = np.zeros((9, 9, 9))
    data[4, 5, 3] = 2.0
    found = greedy(data, 1)
    assert len(found) == 1
    np.testing.assert_allclose(found.centers[0], [3.0, 5.0, 4.0], atol=0.6)
    # (A support is at least as wide as the distance of two samples, and its edge is at the neighbours.)
    others = sampled(found, data.shape)
    assert others[4, 5, 3] == pytest.approx(2.0, rel=1e-3)
    others[4, 5, 3] = 0.0
    assert np.abs(others).max() < 0.02
    single = greedy(Samples.of(np.full((1, 1, 1), 4.0), base=1.0), 2)
    assert single.error < 1e-9


def test_one_layer():
    wanted = planted(3, 9, side=40, separate=True)
    rows = wanted.rows.copy()
    rows[:, 2] = 0.0
    data = sampled(Ellipsoids(rows), (1, 40, 40))
    found = greedy(data, 3)
    assert relative(found, data) < 1e-6


def test_large_lattices_are_thinned(monkeypatch):
    monkeypatch.setattr(refining, "_FEW", 1 << 9)
    monkeypatch.setattr(refining, "_MOST", 1 << 12)
    axes = np.eye(3) * np.array([[[9.0, 12.0, 15.0]], [[14.0, 9.0, 10.0]]])
    wanted = Ellipsoids.of_shapes([[14.0, 16.0, 18.0], [33.0, 31.0, 28.0]], axes, [1.0, -0.5])
    data = sampled(wanted)
    assert [refining._thinning(Samples.of(data), n) for n in (1 << 9, 1 << 12, 1 << 18)] == [6, 3, 1]
    assert_same(greedy(data, 2), wanted)
    found = greedy(data, max_error=1e-3)
    assert len(found) == 2 and found.error < 1e-9


def test_two_kernels_at_one_place():
    wanted = Ellipsoids.of_shapes(
        [[16.0, 15.0, 14.0]] * 2, [np.diag([12.0, 9.0, 10.0]), np.diag([4.0, 5.0, 3.0])], [1.0, 0.7]
    )
    data = sampled(wanted, (32,) * 3)
    found = greedy(data, 2)
    assert relative(found, data) < 1e-6
    # Two that are the same stay usable.
    twice = Ellipsoids(np.concatenate((wanted.rows[:1], wanted.rows[:1])))
    assert relative(refine(sampled(Ellipsoids(wanted.rows[:1]), (32,) * 3), twice), data) < 1.0


def test_values_do_not_grow_against_each_other(monkeypatch):
    ramp = np.indices((16, 20, 24))[2] / 23.0
    found = greedy(ramp, 12)
    assert np.abs(found.values).max() < 1.5 and found.error < 0.002
    # Nothing but what large values cost holds them.
    monkeypatch.setattr(refining, "_RIDGE", 0.0)
    assert np.abs(greedy(ramp, 12).values).max() > 3.0


def test_an_error_ends_the_search():
    data = sampled(planted(8, 0, separate=True))
    loose, tight = (greedy(data, max_error=bound) for bound in (0.03, 0.01))
    assert loose.error <= 0.03 and tight.error <= 0.01
    assert len(loose) < len(tight) <= 10


def test_kernels_that_cost_nothing_are_removed():
    wanted = planted(4, 2, side=32, separate=True)
    data = sampled(wanted, (32,) * 3)
    rows = np.concatenate((wanted.rows, wanted.rows[:2]))
    rows[-2:, 9] *= 1e-6
    found = prune(data, Ellipsoids(rows), 1e-6)
    assert len(found) == 4 and relative(found, data) < 1e-5
    assert len(prune(data, wanted, 1e9)) == 0


def test_the_same_seed_gives_the_same_bits():
    data = sampled(planted(12, 1, separate=False))[::2, ::2, ::2]
    first, again = greedy(data, 6, seed=3), greedy(data, 6, seed=3)
    np.testing.assert_array_equal(first.rows, again.rows)


def test_a_fit_can_be_given_up():
    data = sampled(planted(6, 1, separate=False))
    shares = []

    def until(share):
        shares.append(share)
        return len(shares) < 5

    with pytest.raises(ss.Cancelled):
        greedy(data, 6, progress=until)
    assert len(shares) == 5 and shares == sorted(shares)


@pytest.mark.parametrize(
    ("values", "options"),
    [
        (np.zeros((3, 3)), {"count": 1}),
        (np.full((3, 3, 3), np.inf), {"count": 1}),
        (np.array([-1.7e308, 0.0, 1.7e308]).reshape(1, 1, 3), {"count": 1}),
        (np.zeros((3, 3, 3)), {}),
    ],
)
def test_what_cannot_be_fitted_is_refused(values, options):
    with pytest.raises(ss.InvalidInput):
        greedy(values, **options)


def test_points_and_weights_that_do_not_fit_are_refused():
    for options in (
        {"points": np.zeros((4, 3))},
        {"points": np.full((3, 3), np.nan)},
        {"points": np.zeros((3, 3)), "weights": [1.0, -1.0, 1.0]},
    ):
        with pytest.raises(ss.InvalidInput):
            Samples.of(np.zeros(3), **options)
