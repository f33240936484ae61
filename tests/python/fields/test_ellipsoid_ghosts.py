"""Ghost points of fields of ellipsoids."""

from __future__ import annotations

import numpy as np
import pytest
from test_ellipsoid_scenes import ball_of_kernels

import sheetsplat as ss


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
