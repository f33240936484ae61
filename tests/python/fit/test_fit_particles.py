"""Kernels of particles: by nearest neighbours, and by the smoothing lengths of SPH."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import minimize
from test_fit import CLOUD, lattice, linear_error

from sheetsplat import fit
from sheetsplat.errors import InvalidInput

Array = np.ndarray


# Nearest


def test_nearest_takes_the_distance_of_neighbours() -> None:
    points = lattice(9)
    inner = ((points > 1) & (points < 7)).all(axis=1)
    kernels = fit.nearest(points, points[:, 0], neighbors=6)
    # Six neighbours at distance 1 and the point fill a ball of root mean square radius 1.
    ball = np.sqrt(5 / 3)
    assert kernels.scales[inner] == pytest.approx(2 * ball * (4 * np.pi / 21) ** (1 / 3))
    assert kernels.rotations is None and kernels.scales.ndim == 1
    rng = np.random.default_rng(13)
    kernels = fit.nearest(points, points[:, 0])
    weight, off = linear_error(kernels, 8 * rng.random((3000, 3)), np.ones(3000))
    assert 2.0 < weight.min() and weight.max() < 3.3 and off.max() < 0.2
    weight, off = linear_error(kernels, 3 + 2 * rng.random((1000, 3)), np.ones(1000))
    assert off.max() < 0.013


def test_nearest_of_random_points_is_about_two_everywhere() -> None:
    rng = np.random.default_rng(14)
    points = rng.random((8000, 3))
    weight = fit.nearest(points, points[:, 0]).sums(0.1 + 0.8 * rng.random((4000, 3)))[1]
    assert np.median(weight) == pytest.approx(1.95, abs=0.1)
    assert np.mean(weight < 1) < 0.08


# SPH


def _difference(kernel: fit.SphKernel, falloff: float, radius: float) -> tuple[float, float]:
    """Return relative L2 and largest difference from the closest Gaussian of a mass, by a plain sum over radii."""
    r = (np.arange(40_000) + 0.5) * (max(kernel.support, radius) / 40_000)
    w = kernel(r)
    g = np.maximum(0, (np.exp(-falloff * (r / radius) ** 2) - np.exp(-falloff)) / (1 - np.exp(-falloff)))
    g *= np.sum(w * r**2) / np.sum(g * r**2)
    return float(np.sqrt(np.sum((w - g) ** 2 * r**2) / np.sum(w**2 * r**2))), float(np.abs(w - g).max() / kernel(0.0))


@pytest.mark.parametrize("name", list(fit.SPH_KERNELS))
def test_sph_kernels_and_their_closest_gaussians(name: str) -> None:
    kernel = fit.SPH_KERNELS[name]
    mass = quad(lambda r: 4 * np.pi * r**2 * float(kernel(r)), 0, kernel.support, points=[0.5, 1.0, 1.5], limit=200)[0]
    assert mass == pytest.approx(1, rel=1e-9)
    assert kernel(kernel.support) == 0.0 < kernel(0.98 * kernel.support)
    drawn = quad(lambda r: 4 * np.pi * r**2 * float(kernel.gaussian(r)), 0, kernel.radius)[0]
    assert drawn == pytest.approx(1, rel=1e-9)
    # The constants come out again.
    best = minimize(
        lambda p: _difference(kernel, np.exp(p[0]), np.exp(p[1]))[0] ** 2,
        np.log([5.0, 0.8 * kernel.support]),
        method="Nelder-Mead",
        options={"xatol": 1e-7, "fatol": 1e-15},
    )
    assert np.exp(best.x) == pytest.approx([kernel.falloff, kernel.radius], rel=2e-5)
    off, largest = _difference(kernel, kernel.falloff, kernel.radius)
    assert off == pytest.approx(kernel.l2_error, abs=6e-5)
    assert largest == pytest.approx(kernel.max_error, abs=6e-5)
    assert _difference(kernel, 1.05 * kernel.falloff, kernel.radius)[0] > 1.05 * off
    assert _difference(kernel, kernel.falloff, 1.02 * kernel.radius)[0] > 1.05 * off


@pytest.mark.parametrize("name", list(fit.SPH_KERNELS))
def test_particles_that_tile_space_have_a_weight_sum_of_one(name: str) -> None:
    points = 0.1 * lattice(15)
    kernel = fit.SPH_KERNELS[name]
    lengths = np.full(len(points), 0.26 / kernel.support)
    particles = fit.sph(
        points,
        points[:, 0],
        lengths,
        kernel=name,
        masses=np.full(len(points), 5.0),
        densities=np.full(len(points), 5e3),
    )
    at = 0.5 + 0.4 * np.random.default_rng(15).random((500, 3))
    data, weight = particles.sums(at)
    assert np.abs(weight - 1).max() < 0.03
    # Each interpolant is that of the SPH kernel itself, to within the mapping's error.
    distance = np.linalg.norm(at[:100, None] - points[None], axis=2) / lengths[0]
    exact = kernel(distance).sum(axis=1) * 1e-3 / lengths[0] ** 3
    assert np.abs(weight[:100] - exact).max() < 0.03
    assert np.abs(data - weight * at[:, 0]).max() < 2e-3
    # Supports' radii in the place of smoothing lengths are the same particles.
    same = fit.sph(
        points,
        points[:, 0],
        np.full(len(points), 0.26),
        kernel=name,
        support=1,
        masses=points[:, 0] + 1,
        densities=points[:, 0] + 1,
    )
    assert same.scales == pytest.approx(particles.scales)
    assert same.weights == pytest.approx(1e3 * particles.weights)


def test_particles_without_masses_weigh_one() -> None:
    particles = fit.sph(CLOUD, np.ones(30), np.full(30, 0.1))
    assert particles.weights is None and particles.scales == pytest.approx(0.1748606)
    assert len(fit.sph(np.ones((3, 3)), [1, 2, 3], [1, 1, 1])) == 3


@pytest.mark.data
def test_particles_of_the_galaxy_tile_space(data_dir: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(data_dir / "sph_gas_nchilada12M.h5") as file:
        gas = {name: file["PartType0"][name][:].astype(float) for name in file["PartType0"]}
    density = fit.sph(
        gas["Coordinates"], gas["Density"], gas["SmoothingLength"], masses=gas["Masses"], densities=gas["Density"]
    )
    some = np.random.default_rng(16).integers(len(density), size=400)
    data, weight = density.sums(gas["Coordinates"][some])
    assert np.median(weight) == pytest.approx(1, abs=0.03)
    assert np.median(data / gas["Density"][some]) == pytest.approx(1, abs=0.03)
    # Twice the smoothing lengths would be eight times as much.
    wrong = fit.sph(
        gas["Coordinates"],
        gas["Density"],
        gas["SmoothingLength"],
        support=1,
        masses=gas["Masses"],
        densities=gas["Density"],
    )
    assert np.median(wrong.sums(gas["Coordinates"][some])[1]) > 1.3


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"smoothing_lengths": [1.0] * 4 + [0.0] + [1.0] * 25}, "smoothing_lengths.*0, entry 4"),
        ({"smoothing_lengths": [1.0] * 4 + [-2.0] + [1.0] * 25}, "-2, entry 4"),
        ({"smoothing_lengths": [1.0] * 4 + [np.nan] + [1.0] * 25}, "NaN, the smoothing_length of point 4"),
        ({"smoothing_lengths": [1.0]}, "30 points and 1 smoothing_lengths"),
        ({"kernel": "gaussian"}, "cubic_spline"),
        ({"support": 0}, "support"),
        ({"masses": np.ones(30)}, "masses alone"),
        ({"densities": np.ones(30)}, "densities alone"),
        ({"masses": -np.ones(30), "densities": np.ones(30)}, "masses.*-1, entry 0"),
        ({"masses": np.zeros(30), "densities": np.ones(30)}, "all 0"),
        ({"masses": np.ones(30), "densities": np.zeros(30)}, "densities.*0, entry 0"),
        ({"masses": np.full(30, 1e300), "densities": np.full(30, 1e-300)}, "beyond float64"),
        ({"points": np.empty((0, 3)), "values": [], "smoothing_lengths": []}, "no particle"),
    ],
)
def test_bad_particles_have_clear_errors(change, told) -> None:
    given = {"points": CLOUD, "values": np.ones(30), "smoothing_lengths": np.ones(30), **change}
    with pytest.raises(InvalidInput, match=told):
        fit.sph(**given)
