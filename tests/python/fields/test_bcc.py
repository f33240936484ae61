"""Resampling to the BCC lattice: geometry, error against the analytic signal, what the lattice cannot hold, types."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sheetsplat.bcc import METHODS, BccLattice, resample_to_bcc
from sheetsplat.datasets import marschner_lobb
from sheetsplat.errors import InvalidInput


def _positions(lattice: BccLattice) -> np.ndarray:
    """(nk, nj, ni, 3), by the definition of the lattice and not by the code under test."""
    k, j, i = np.indices(lattice.shape)
    half = 0.5 * (k % 2)
    return np.stack([(i + half) * lattice.a, (j + half) * lattice.a, 0.5 * k * lattice.a], axis=-1) + lattice.origin


# Geometry


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        # Sizes of the 2005 paper's table 1, here as k, j, i.
        ((256, 256, 256), (362, 181, 181)),
        ((128, 128, 128), (182, 91, 91)),
        ((128, 256, 256), (182, 181, 181)),
    ],
)
def test_sizes_are_those_of_the_paper(shape: tuple[int, int, int], expected: tuple[int, int, int]) -> None:
    lattice = BccLattice.matching(shape, (1.0, 1.0, 1.0))
    assert lattice.shape == expected
    assert lattice.a == pytest.approx(math.sqrt(2.0))
    assert math.prod(lattice.shape) == pytest.approx(math.prod(shape) / math.sqrt(2.0), rel=0.02)


@pytest.mark.parametrize("n", [1, 2, 3, 7, 30, 41, 100])
def test_lattice_lies_in_the_middle_and_within_the_samples_boxes(n: int) -> None:
    shape, spacing, origin = (n, 2 * n, n + 3), (0.5, 1.25, 2.0), (-3.0, 4.0, 10.0)
    lattice = BccLattice.matching(shape, spacing, origin)
    points = _positions(lattice).reshape(-1, 3)
    lower = np.array(origin)
    upper = lower + (np.array(shape[::-1]) - 1) * spacing
    assert points.min(axis=0) + points.max(axis=0) == pytest.approx(lower + upper)
    if n >= 7:
        # Never more than a distance and a half of the samples (in the coarser lattice) beyond or short of the centres.
        reach = np.maximum(0.5 * np.array(spacing), 0.5 * lattice.a)
        assert np.all(points.min(axis=0) > lower - reach) and np.all(points.min(axis=0) < lower + reach)


def test_layers_are_where_the_definition_says() -> None:
    lattice = BccLattice.matching((9, 12, 10), (1.0, 2.0, 1.5), (1.0, 2.0, 3.0))
    points = _positions(lattice)
    for k in range(lattice.shape[0]):
        x, y, z = lattice.layer(k)
        assert points[k, 0, :, 0] == pytest.approx(x)
        assert points[k, :, 0, 1] == pytest.approx(y)
        assert np.all(np.abs(points[k, :, :, 2] - z) < 1e-12)


# Values


@pytest.mark.parametrize("method", METHODS)
def test_constants_stay(method: str) -> None:
    values = np.full((9, 11, 8), 17.25, np.float32)
    result = resample_to_bcc(values, (1.0, 2.0, 1.5), method=method)
    assert np.all(result.values == np.float32(17.25))


@pytest.mark.parametrize("method", ["quintic", "cubic", "linear"])
def test_linear_fields_stay_linear(method: str) -> None:
    z, y, x = np.indices((32, 30, 34), dtype=np.float64)
    values = 2.0 * x - 3.0 * y + z
    result = resample_to_bcc(values, method=method, band_limit=False)
    points = _positions(result.lattice)
    expected = 2.0 * points[..., 0] - 3.0 * points[..., 1] + points[..., 2]
    inside = np.all((points > 9.0) & (points < np.array([24.0, 20.0, 22.0])), axis=-1)
    bound = 2e-4 if method != "quintic" else 6e-3
    assert np.abs(result.values - expected)[inside].max() < bound
    moved = 2.0 * (points[..., 0] + 0.01) - 3.0 * points[..., 1] + points[..., 2]
    assert np.abs(result.values - moved)[inside].min() > 0.02 - bound


def _error(n: int, method: str, band_limit: bool = True) -> float:
    """RMSE against the formula, at least a tenth of the volume away from its border."""
    given, exact = marschner_lobb(n, 3.0), marschner_lobb(n, 3.0, lattice="bcc")
    result = resample_to_bcc(given.values, given.spacing, given.origin, method=method, band_limit=band_limit)
    assert result.values.shape == exact.values.shape
    assert result.spacing == pytest.approx(exact.spacing) and result.origin == pytest.approx(exact.origin)
    points = _positions(result.lattice)
    inside = np.all(np.abs(points) < 0.8, axis=-1)
    return float(np.sqrt(np.mean((result.values - exact.values)[inside] ** 2)))


def test_error_on_marschner_lobb_falls_at_the_known_order() -> None:
    sizes = (48, 64, 96)
    expected = {"quintic": 6.0, "cubic": 4.0, "linear": 2.0, "nearest": 1.0}
    errors = {method: [_error(n, method, band_limit=False) for n in sizes] for method in expected}
    for method, order in expected.items():
        slope = np.polyfit(np.log(1.0 / (np.array(sizes) - 1.0)), np.log(errors[method]), 1)[0]
        # Before the limit splines gain a little more than their order.
        assert order - 0.3 < slope < order + 1.6, (method, slope, errors[method])


def test_error_on_marschner_lobb_is_small_and_nearest_fails() -> None:
    # The negative control: what the filter must keep, taking the nearest sample misses by a hundred times.
    bound = 1e-4
    assert _error(48, "quintic") < bound
    assert _error(48, "cubic") < 5.0 * bound
    assert _error(48, "linear") > 20.0 * bound
    assert _error(48, "nearest") > 100.0 * bound


def test_band_limit_costs_nothing_where_the_signal_fits() -> None:
    assert _error(64, "quintic", True) < 1.1 * _error(64, "quintic", False) + 1e-7


def test_a_lattice_shifted_by_a_little_is_another() -> None:
    given = marschner_lobb(48, 3.0)
    right = resample_to_bcc(given.values, given.spacing, given.origin)
    wrong = resample_to_bcc(given.values[:, :, ::-1], given.spacing, given.origin)
    # The signal is even in x; its resampling must be so too, and must not be along z.
    odd = right.values[1::2]
    assert np.abs(right.values - wrong.values).max() < 1e-5
    assert np.abs(odd[:, :, 0] - odd[::-1, :, 0]).max() > 0.1


def _wave(n: int, waves: tuple[float, float, float]) -> np.ndarray:
    """Cosines with these shares of the largest wave number along x, y, z, even about the borders of the boxes."""
    z, y, x = np.indices((n, n, n), dtype=np.float64)
    return np.prod(
        [np.cos(np.pi * round(w * n) / n * (c + 0.5)) for w, c in zip(waves, (x, y, z), strict=True)], axis=0
    )


def test_waves_that_the_lattice_holds_pass() -> None:
    # Along an axis every wave of the old lattice is held, and along a face's diagonal up to 1 / sqrt(2).
    for waves in ((0.8, 0.0, 0.0), (0.0, 0.8, 0.0), (0.0, 0.0, 0.8), (0.6, 0.6, 0.0), (0.6, 0.0, 0.6), (0.5, 0.5, 0.5)):
        result = resample_to_bcc(_wave(32, waves), method="fourier")
        points = _positions(result.lattice)
        numbers = np.array([round(w * 32) for w in waves])
        expected = np.prod(np.cos(np.pi * numbers / 32 * (points + 0.5)), axis=-1)
        assert np.abs(result.values - expected).max() < 1e-4, waves


def test_waves_that_the_lattice_cannot_hold_are_taken_out() -> None:
    for waves in ((0.9, 0.9, 0.0), (0.0, 0.9, 0.9), (0.9, 0.9, 0.9)):
        values = _wave(32, waves)
        assert np.abs(resample_to_bcc(values, band_limit=True).values).max() < 1e-4, waves
        # Without the filter they come back, as false waves of full strength.
        assert np.abs(resample_to_bcc(values, band_limit=False).values).max() > 0.2, waves


def test_noise_keeps_the_share_that_fits() -> None:
    # White noise has equal strength everywhere in the cube; the dodecahedron holds 1 / sqrt(2) of its volume, and the
    # filter's smooth edge, inside and outside of it, takes up to a sixth of that.
    noise = np.random.default_rng(1).standard_normal((48, 48, 48))
    kept = resample_to_bcc(noise, method="fourier").values.std() ** 2
    assert 0.83 * math.sqrt(0.5) < kept < math.sqrt(0.5)
    folded = resample_to_bcc(noise, method="fourier", band_limit=False).values.std() ** 2
    assert folded == pytest.approx(1.0, rel=0.06)


def test_fourier_and_spline_agree_on_smooth_signals() -> None:
    given = marschner_lobb(64, 2.0)
    spline = resample_to_bcc(given.values, method="quintic").values[20:-20, 10:-10, 10:-10]
    waves = resample_to_bcc(given.values, method="fourier").values[20:-20, 10:-10, 10:-10]
    assert np.abs(spline - waves).max() < 1e-3
    assert np.abs(spline - waves[::-1]).max() > 1e-2


def test_unequal_spacing_becomes_isotropic() -> None:
    # A smooth blob, given on samples that are coarser along z.
    def blob(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        return np.exp(-((x - 15.0) ** 2 + (y - 16.0) ** 2 + (z - 17.0) ** 2) / 30.0)

    spacing, shape = (1.0, 0.8, 1.6), (22, 40, 32)
    z, y, x = np.indices(shape) * np.array(spacing[::-1])[:, None, None, None]
    result = resample_to_bcc(blob(x, y, z), spacing)
    assert math.prod(result.lattice.shape) == pytest.approx(math.prod(shape) / math.sqrt(2.0), rel=0.1)
    points = _positions(result.lattice)
    expected = blob(*np.moveaxis(points, -1, 0))
    assert np.abs(result.values - expected).max() < 2e-3
    nearest = resample_to_bcc(blob(x, y, z), spacing, method="nearest")
    assert np.abs(nearest.values - expected).max() > 0.05


def test_a_coarser_lattice_averages() -> None:
    noise = np.random.default_rng(2).standard_normal((40, 40, 40))
    coarse = resample_to_bcc(noise, a=4.0 * math.sqrt(2.0))
    # Only a 64th of the waves' volume is left.
    assert coarse.values.std() < 0.2
    assert coarse.lattice.shape == (14, 7, 7)


def test_chunks_make_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    from sheetsplat import bcc

    values = np.random.default_rng(3).random((20, 21, 22), dtype=np.float32)
    for method in ("quintic", "fourier", "nearest"):
        whole = resample_to_bcc(values, method=method).values
        with monkeypatch.context() as patch:
            patch.setattr(bcc, "_CHUNK_BYTES", 1)
            assert np.abs(resample_to_bcc(values, method=method).values - whole).max() < 1e-5


def test_the_splines_are_scipys() -> None:
    # An independent evaluation of the same interpolant.
    from scipy import ndimage

    values = np.random.default_rng(4).random((16, 17, 18))
    for method, degree in (("quintic", 5), ("cubic", 3)):
        result = resample_to_bcc(values, method=method, band_limit=False)
        points = _positions(result.lattice)
        expected = ndimage.map_coordinates(values, np.moveaxis(points[..., ::-1], -1, 0), order=degree, mode="reflect")
        assert np.abs(result.values - expected).max() < 2e-5


# Types


def test_whole_numbers_are_rounded_and_kept_in_range() -> None:
    # A sharp edge between the type's limits: splines overshoot there.
    for dtype in (np.uint8, np.int16, np.uint16, np.int32):
        limits = np.iinfo(dtype)
        values = np.full((24, 24, 24), limits.min, dtype)
        values[:, :, 12:] = limits.max
        result = resample_to_bcc(values)
        assert result.values.dtype == dtype
        assert result.values.min() == limits.min and result.values.max() == limits.max
        # Values that ran over would have come round to the other end.
        assert np.all(result.values[:, :, :6].astype(float) < 0.1 * limits.max + 0.9 * limits.min)
    sharp = (np.arange(24) >= 12) * np.ones((24, 24, 24))
    assert resample_to_bcc(sharp).values.max() > 1.02


def test_type_of_the_result() -> None:
    values = np.arange(216, dtype=np.uint8).reshape(6, 6, 6)
    assert resample_to_bcc(values).values.dtype == np.uint8
    assert resample_to_bcc(values, dtype=np.float32).values.dtype == np.float32
    assert resample_to_bcc(values > 100).values.dtype == np.uint8
    assert resample_to_bcc(values.astype(">f8")).values.dtype == np.dtype(">f8")


def test_large_offsets_lose_nothing() -> None:
    given = marschner_lobb(32, 2.0, dtype=np.float64)
    plain = resample_to_bcc(given.values).values
    lifted = resample_to_bcc(given.values + 1e7).values
    assert np.abs(lifted - 1e7 - plain).max() < 1e-6
    assert np.abs((given.values + 1e7).astype(np.float32) - 1e7 - given.values).max() > 0.1


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 8, 8), (2, 1, 5), (3, 3, 3)])
def test_thin_volumes(shape: tuple[int, int, int]) -> None:
    for method in METHODS:
        result = resample_to_bcc(np.random.default_rng(5).random(shape), method=method)
        assert np.isfinite(result.values).all() and result.values.size > 0


def test_bad_input_has_clear_errors() -> None:
    good = np.zeros((4, 4, 4))
    bad_values = np.where(np.arange(64).reshape(4, 4, 4) == 5, np.nan, good)
    for call in (
        lambda: resample_to_bcc(np.zeros((4, 4))),
        lambda: resample_to_bcc(np.zeros((0, 4, 4))),
        lambda: resample_to_bcc(good.astype(complex)),
        lambda: resample_to_bcc(bad_values),
        lambda: resample_to_bcc(np.full((4, 4, 4), 1e300) * np.arange(4)),
        lambda: resample_to_bcc(good, (1.0, -1.0, 1.0)),
        lambda: resample_to_bcc(good, (1.0, 0.0, 1.0)),
        lambda: resample_to_bcc(good, (1.0, float("nan"), 1.0)),
        lambda: resample_to_bcc(good, (1.0, 1.0)),
        lambda: resample_to_bcc(good, origin=(0.0, float("inf"), 0.0)),
        lambda: resample_to_bcc(good, a=0.0),
        lambda: resample_to_bcc(good, a=1e-9),
        lambda: resample_to_bcc(good, method="sinc"),
        lambda: resample_to_bcc(good, dtype=complex),
    ):
        with pytest.raises(InvalidInput, match="wanted"):
            call()
