"""Generated data sets: counts and formulas."""

from __future__ import annotations

import zlib

import numpy as np
import pytest

from sheetsplat import datasets
from sheetsplat.datasets.random_stream import Stream

# Random numbers


def test_random_numbers_are_those_of_splitmix64() -> None:
    # SplitMix64 in plain whole numbers, one at a time.
    mask = 2**64 - 1

    def mix(state: int) -> int:
        state = (state ^ (state >> 30)) * 0xBF58476D1CE4E5B9 & mask
        state = (state ^ (state >> 27)) * 0x94D049BB133111EB & mask
        return state ^ (state >> 31)

    golden = 0x9E3779B97F4A7C15
    start = mix((7 + golden) & mask)
    expected = [(mix((start + n * golden) & mask) >> 11) * 2.0**-53 for n in range(1, 6)]
    stream = Stream(7)
    drawn = np.concatenate([stream.uniform(2), stream.uniform(3)])
    assert drawn.tolist() == expected


def test_random_numbers_look_random() -> None:
    stream = Stream(1)
    uniform = stream.uniform(200_000)
    assert 0.0 <= uniform.min() and uniform.max() < 1.0
    counts = np.histogram(uniform, 100, (0.0, 1.0))[0]
    # Chi squared of 99 degrees of freedom: mean 99, deviation 14.
    assert 40.0 < np.sum((counts - 2000.0) ** 2 / 2000.0) < 180.0
    normal = stream.normal(200_000)
    assert abs(normal.mean()) < 0.01 and abs(normal.std() - 1.0) < 0.01
    assert abs(np.corrcoef(Stream(1).uniform(100_000), Stream(2).uniform(100_000))[0, 1]) < 0.02


# Formulas


def test_noisy_ball_has_its_count_and_is_the_same_everywhere() -> None:
    ball = datasets.noisy_ball()
    assert ball.values.shape == (128, 128, 128) and ball.values.dtype == np.uint8
    assert abs(np.count_nonzero(ball.values) - 480_000) <= 0.05 * 480_000
    assert zlib.crc32(ball.values.tobytes()) == 2307912506
    assert np.array_equal(ball.values, datasets.noisy_ball().values)
    assert not np.array_equal(ball.values, datasets.noisy_ball(seed=1).values)


def test_noisy_ball_is_a_ball() -> None:
    values = datasets.noisy_ball(48).values
    k, j, i = np.nonzero(values)
    radius = np.sqrt((k - 23.5) ** 2 + (j - 23.5) ** 2 + (i - 23.5) ** 2)
    outside = np.argwhere(values == 0)
    assert radius.max() < np.sqrt(((outside - 23.5) ** 2).sum(axis=1)).min()


@pytest.mark.parametrize("seed", [2005, 1, 2])
def test_tubes_have_their_count_and_are_thin_and_connected(seed: int) -> None:
    from scipy import ndimage

    values = datasets.tubes(seed=seed).values
    assert values.dtype == np.uint8
    count = np.count_nonzero(values)
    assert abs(count - 17_000) <= 1_700
    pieces, number = ndimage.label(values > 0, structure=np.ones((3, 3, 3)))
    assert np.bincount(pieces.ravel())[1:].max() > 0.95 * count, f"{number} pieces"
    # Half of the samples lie within two of the outside; in a ball of 17,000 it would be a third.
    assert np.median(ndimage.distance_transform_edt(values > 0)[values > 0]) <= 2.0
    # Nothing reaches the border, where a kernel would be cut.
    assert not values[[0, -1]].any() and not values[:, [0, -1]].any() and not values[:, :, [0, -1]].any()


def test_tubes_are_deterministic() -> None:
    first, again = datasets.tubes(64), datasets.tubes(64)
    assert np.array_equal(first.values, again.values)
    assert np.count_nonzero(first.values != datasets.tubes(64, seed=3).values) > 1000


def test_marschner_lobb_is_the_formula_at_its_points() -> None:
    volume = datasets.marschner_lobb(41, dtype=np.float64)
    assert volume.values.shape == (41, 41, 41)
    k, j, i = 7, 30, 12
    x, y, z = (volume.origin[c] + index * volume.spacing[c] for c, index in enumerate((i, j, k)))
    wave = np.cos(2 * np.pi * 6 * np.cos(np.pi * np.hypot(x, y) / 2))
    expected = (1 - np.sin(np.pi * z / 2) + 0.25 * (1 + wave)) / 2.5
    assert volume.values[k, j, i] == pytest.approx(expected, abs=1e-14)
    assert volume.values.min() >= 0.0 and volume.values.max() <= 1.0
    assert volume.origin[0] + 40 * volume.spacing[0] == pytest.approx(1.0)


def test_marschner_lobb_gradient_is_the_derivative() -> None:
    points = 2.0 * np.random.default_rng(1).random((3, 200)) - 1.0
    points[:, 0] = 0.0  # the axis, where x / radius has no value
    gradient = datasets.marschner_lobb_gradient(*points)
    assert gradient.shape == (200, 3)

    def worst(step: float) -> float:
        found = np.empty_like(gradient)
        for axis in range(3):
            move = step * np.eye(3)[axis][:, None]
            ahead, behind = (datasets.marschner_lobb_value(*(points + sign * move)) for sign in (1, -1))
            found[:, axis] = (ahead - behind) / (2.0 * step)
        return float(np.abs(found - gradient).max())

    errors = [worst(step) for step in (4e-3, 2e-3, 1e-3)]
    # Central differences err with the square of the step; an error of the formula itself would not shrink.
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.1)
    assert errors[2] < 0.01 < np.abs(gradient).max()


def test_marschner_lobb_on_the_bcc_lattice() -> None:
    volume = datasets.marschner_lobb(64, lattice="bcc", dtype=np.float64)
    assert volume.lattice == "bcc" and volume.values.shape == (90, 45, 45)
    a = volume.spacing[0]
    for i, j, k in ((0, 0, 0), (3, 4, 7), (44, 44, 89)):
        half = 0.5 * (k % 2)
        x, y, z = (
            volume.origin[0] + (i + half) * a,
            volume.origin[1] + (j + half) * a,
            volume.origin[2] + 0.5 * k * a,
        )
        assert volume.values[k, j, i] == pytest.approx(float(datasets.marschner_lobb_value(x, y, z)), abs=1e-12)


def test_bad_arguments_have_clear_errors() -> None:
    from sheetsplat.errors import InvalidInput

    for make in (
        lambda: datasets.marschner_lobb(1),
        lambda: datasets.marschner_lobb(8, lattice="hexagonal"),
        lambda: datasets.noisy_ball(0),
        lambda: datasets.tubes(8),
    ):
        with pytest.raises(InvalidInput, match="wanted|at least"):
            make()


# The nouns


def test_datasets_do_not_change_and_say_what_they_are() -> None:
    for name in ("marschner_lobb", "noisy_ball", "tubes"):
        volume = datasets.DATASETS[name](32)
        assert volume.name == name and volume.description
        with pytest.raises(ValueError, match="read-only"):
            volume.values[0, 0, 0] = 1
        points = np.array(volume.suggested["points"])
        assert points.shape[1] == 5 and np.all(np.diff(points[:, 0]) >= 0.0)
        assert volume.clim[0] < volume.clim[1]
        # Empty space stays empty under the suggested transfer function.
        assert points[0, 4] == 0.0
