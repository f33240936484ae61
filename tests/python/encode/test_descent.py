"""Coordinate descent on lattices of kernels: the residual is the samples less the kernels, with any threads."""

import numpy as np
import pytest

from sheetsplat import _sheetsplat

_FALLOFF, _RADIUS = 8.0, 2.375
_LEVELS = [((0, 0, 0), (20, 17, 30), 1.0), ((-1, -1, -1), (12, 10, 17), 2.0), ((-1, -1, -1), (7, 6, 10), 4.0)]


def _samples(seed=0):
    return np.random.default_rng(seed).standard_normal((30, 17, 20))


def _kernel(squared):
    lowered = np.exp(-_FALLOFF)
    return np.maximum(0.0, (np.exp(-_FALLOFF * squared) - lowered) / (1.0 - lowered))


def _sum_at(places, descent):
    """Return the sum of all kernels at places (M, 3), by the formula."""
    total = np.zeros(len(places))
    for level, (first, _, spacing) in enumerate(_LEVELS):
        numbers = descent.coefficients(level).astype(float)
        for at in np.argwhere(numbers != 0.0):
            center = (at[::-1] + first) * spacing
            squared = ((places - center) ** 2).sum(axis=1) / (_RADIUS * spacing) ** 2
            total += numbers[tuple(at)] * _kernel(squared)
    return total


def _descended(made, threshold=1.5):
    for level in (2, 1, 0, 2, 1, 0):
        made.soften(level, threshold, False)
    return made


def _places(shape, offset=(0.0, 0.0, 0.0)):
    k, j, i = np.indices(shape).reshape(3, -1)
    return np.stack((i, j, k), axis=1) + np.asarray(offset)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_the_residual_is_what_kernels_leave(threads):
    values = _samples()
    made = _descended(_sheetsplat.LatticeDescent([((0, 0, 0), values)], _LEVELS, _FALLOFF, _RADIUS, threads))
    left = values.ravel() - _sum_at(_places(values.shape), made)
    assert 0 < sum(np.count_nonzero(made.coefficients(level)) for level in range(3)) < values.size
    assert np.allclose(made.residual(), left, atol=2e-5)
    squares, largest = made.misfit()
    assert squares == pytest.approx(float(left @ left), rel=1e-4)
    assert largest == pytest.approx(np.abs(left).max(), rel=1e-4)


def test_threads_change_no_bit():
    found = [
        _descended(
            _sheetsplat.LatticeDescent([((0, 0, 0), _samples())], _LEVELS, _FALLOFF, _RADIUS, threads)
        ).residual()
        for threads in (1, 2, 3)
    ]
    assert np.array_equal(found[0], found[1]) and np.array_equal(found[0], found[2])


def test_two_grids_and_halves():
    first, second = _samples(1)[:, :16, :19], _samples(2)[:29, :15, :18]
    grids = [((0, 0, 0), first), ((0.5, 0.5, 0.5), second)]
    made = _descended(_sheetsplat.LatticeDescent(grids, _LEVELS, _FALLOFF, _RADIUS, 2))
    places = np.concatenate((_places(first.shape), _places(second.shape, (0.5, 0.5, 0.5))))
    left = np.concatenate((first.ravel(), second.ravel())) - _sum_at(places, made)
    assert np.allclose(made.residual(), left, atol=2e-5)


def test_points_are_as_the_same_grid():
    values = _samples(3)
    grid = _descended(_sheetsplat.LatticeDescent([((0, 0, 0), values)], _LEVELS, _FALLOFF, _RADIUS, 1))
    points = _descended(
        _sheetsplat.LatticeDescent(_places(values.shape), values.ravel(), _LEVELS, _FALLOFF, _RADIUS, 1)
    )
    assert np.allclose(points.residual(), grid.residual(), atol=1e-4)


def test_missing_samples_are_left_out():
    values = _samples(4)
    holes = np.random.default_rng(5).random(values.shape) < 0.3
    values[holes] = np.nan
    made = _descended(_sheetsplat.LatticeDescent([((0, 0, 0), values)], _LEVELS, _FALLOFF, _RADIUS, 2))
    left = values.ravel() - _sum_at(_places(values.shape), made)
    assert np.array_equal(np.isnan(made.residual()), holes.ravel())
    assert np.allclose(made.residual(), left, atol=2e-5, equal_nan=True)


def test_exact_residuals_are_float64():
    values = _samples(6)
    rough = _descended(_sheetsplat.LatticeDescent([((0, 0, 0), values)], _LEVELS, _FALLOFF, _RADIUS, 1))
    exact = _sheetsplat.LatticeDescent([((0, 0, 0), values)], _LEVELS, _FALLOFF, _RADIUS, 1, True)
    for level in range(3):
        exact.set(level, rough.coefficients(level).astype(float))
    left = values.ravel() - _sum_at(_places(values.shape), exact)
    assert np.abs(exact.residual() - left).max() < 1e-12


def test_softening_lowers_the_convex_function():
    threshold = 1.0
    made = _sheetsplat.LatticeDescent([((0, 0, 0), _samples(7))], _LEVELS, _FALLOFF, _RADIUS, 2)

    def function():
        # (Norms of kernels at the border are smaller than those that `norm` gives.)
        places = _places((30, 17, 20))
        total = 0.5 * made.misfit()[0]
        for level, (first, _, spacing) in enumerate(_LEVELS):
            numbers = made.coefficients(level)
            for at in np.argwhere(numbers != 0.0):
                squared = ((places - (at[::-1] + first) * spacing) ** 2).sum(axis=1) / (_RADIUS * spacing) ** 2
                total += threshold * abs(float(numbers[tuple(at)])) * np.linalg.norm(_kernel(squared))
        return total

    before = function()
    for _ in range(4):
        for level in (2, 1, 0):
            made.soften(level, threshold, False)
        after = function()
        assert after < before * (1.0 + 1e-6)
        before = after
