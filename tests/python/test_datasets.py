"""Generated data sets: counts, formulas, the flow solver against closed forms, the cache."""

from __future__ import annotations

import hashlib
import os
import zlib
from pathlib import Path

import numpy as np
import pytest

from sheetsplat import datasets
from sheetsplat.datasets import _flows, _spectral
from sheetsplat.datasets._spectral import Flow
from sheetsplat.datasets.random_stream import Stream


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


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
        lambda: datasets.vortex(4),
        lambda: datasets.vortex(32, resolution=33),
        lambda: datasets.vortex(32, resolution=64),
        lambda: datasets.turbulence((8, 8, 8)),
        lambda: datasets.turbulence((0, 64, 64)),
        lambda: datasets.jet(4),
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


def test_stand_ins_are_called_so() -> None:
    small = (
        datasets.vortex(16, time=0.2, cache=False),
        datasets.turbulence((17, 16, 9), time=0.05, cache=False),
        datasets.jet(16, time=0.2, cache=False),
    )
    for volume in small:
        assert volume.stand_in_for is not None and "2005 paper" in volume.stand_in_for
    assert small[1].values.shape == (17, 16, 9)
    assert small[2].values.dtype == np.uint8


# The solver


def _plane_vortex(n: int, t: float, viscosity: float) -> np.ndarray:
    x = np.arange(n) * (2.0 * np.pi / n)
    fade = np.exp(-2.0 * viscosity * t)
    velocity = np.zeros((3, n, n, n))
    velocity[0] = np.cos(x)[None, None, :] * np.sin(x)[None, :, None] * fade
    velocity[1] = -np.sin(x)[None, None, :] * np.cos(x)[None, :, None] * fade
    return velocity


def _divergence(flow: Flow) -> np.ndarray:
    waves = _spectral.wave_numbers(flow.n, np.dtype(np.float64))
    spectra = np.fft.rfftn(flow.velocity(), axes=(-3, -2, -1))
    return np.fft.irfftn(sum(1j * k * u for k, u in zip(waves, spectra, strict=True)), s=(flow.n,) * 3, axes=(0, 1, 2))


def _enstrophy(flow: Flow) -> float:
    """Return the mean of w^2 / 2; energy falls at the rate 2 nu times this."""
    return 0.5 * float(np.mean(np.sum(flow.vorticity().astype(np.float64) ** 2, axis=0)))


def test_solver_follows_the_exact_plane_vortex() -> None:
    # Taylor's plane vortex solves the full equations: its own transport is a gradient, so it only fades.
    flow = Flow(_plane_vortex(16, 0.0, 0.1), 0.1)
    flow.run(1.0)
    assert flow.time == pytest.approx(1.0)
    assert np.abs(flow.velocity() - _plane_vortex(16, 1.0, 0.1)).max() < 1e-5
    assert np.abs(flow.velocity() - _plane_vortex(16, 1.01, 0.1)).max() > 1e-4
    assert flow.energy() == pytest.approx(0.25 * np.exp(-0.4), rel=1e-5)


def test_solver_keeps_energy_without_viscosity_and_has_no_divergence() -> None:
    flow = _flows.taylor_green(16, 0.0, np.float64)
    start = flow.energy()
    assert start == pytest.approx(0.125, rel=1e-12)
    for _ in range(20):
        flow.step(0.05)
    assert flow.energy() == pytest.approx(start, rel=1e-6)
    assert np.abs(_divergence(flow)).max() < 1e-13 < 1e-3 * np.abs(flow.vorticity()).max()


def test_solver_loses_the_energy_that_viscosity_takes() -> None:
    # dE/dt = -2 nu times the enstrophy, by Simpson's rule over a stretch in which the enstrophy changes.
    viscosity, step = 0.01, 0.05
    flow = _flows.taylor_green(24, viscosity, np.float64)
    energies, losses = [flow.energy()], [2.0 * viscosity * _enstrophy(flow)]
    for _ in range(40):
        flow.step(step)
        energies.append(flow.energy())
        losses.append(2.0 * viscosity * _enstrophy(flow))
    weights = np.ones(41)
    weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
    lost = float(np.dot(weights, losses)) * step / 3.0
    assert energies[0] - energies[-1] == pytest.approx(lost, rel=1e-5)
    # The loss changes on the way, so that the agreement says something.
    assert abs(2.0 * losses[0] - lost) > 1e-2 * lost


def test_solver_is_of_fourth_order_in_time() -> None:
    def after(steps: int) -> np.ndarray:
        flow = _flows.taylor_green(16, 0.05, np.float64)
        for _ in range(steps):
            flow.step(2.0 / steps)
        return flow.velocity()

    best = after(128)
    errors = [float(np.abs(after(steps) - best).max()) for steps in (8, 16, 32)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all((orders > 3.7) & (orders < 4.4)), orders


def test_solver_agrees_across_resolutions() -> None:
    # The waves are those of the seed, whatever the resolution.
    coarse, fine = (_flows.isotropic(n, 0.05, 1, peak=2.0, dtype=np.float64) for n in (24, 32))
    assert np.abs(coarse.velocity()[:, ::3, ::3, ::3] - fine.velocity()[:, ::4, ::4, ::4]).max() < 1e-9
    for flow in (coarse, fine):
        flow.run(0.25)
    error = np.abs(coarse.velocity()[:, ::3, ::3, ::3] - fine.velocity()[:, ::4, ::4, ::4]).max()
    assert error < 0.03 * np.abs(fine.velocity()).max()


def test_solver_carries_a_scalar() -> None:
    # A uniform wind carries a wave along and diffusion fades it: sin(x - u t) exp(-kappa t).
    n, kappa = 16, 0.03
    x = np.arange(n) * (2.0 * np.pi / n)
    velocity = np.zeros((3, n, n, n))
    velocity[0] = 1.0
    wave = np.broadcast_to(np.sin(x), (n, n, n))
    flow = Flow(velocity, 0.1, scalar=wave, diffusivity=kappa)
    flow.run(1.5, largest_step=0.05)
    expected = np.broadcast_to(np.sin(x - 1.5) * np.exp(-kappa * 1.5), (n, n, n))
    assert np.abs(flow.scalar() - expected).max() < 1e-5
    assert np.abs(flow.velocity() - velocity).max() < 1e-12


def test_jet_keeps_its_dye() -> None:
    flow = _flows.round_jet(24, 1.0 / 50.0, 1, np.float64)
    before = float(flow.scalar().mean())
    flow.run(1.0)
    assert float(flow.scalar().mean()) == pytest.approx(before, rel=1e-12)
    assert np.abs(_divergence(flow)).max() < 1e-12


def test_refinement_is_exact() -> None:
    rng = np.random.default_rng(1)
    waves = rng.integers(-5, 6, (6, 3))
    phases = rng.random(6)

    def field(n: int) -> np.ndarray:
        x = np.arange(n) * (2.0 * np.pi / n)
        z, y, x = np.meshgrid(x, x, x, indexing="ij")
        return sum(np.cos(w[0] * x + w[1] * y + w[2] * z + p) for w, p in zip(waves, phases, strict=True))

    spectrum = np.fft.rfftn(field(16))
    for n in (16, 20, 33):
        assert np.abs(_spectral.refine(spectrum, n) - field(n)).max() < 1e-12
    assert np.abs(_spectral.refine(spectrum, 20) - field(20)[::-1]).max() > 0.1
    with pytest.raises(ValueError, match="cannot refine"):
        _spectral.refine(spectrum, 12)


def test_flows_are_deterministic() -> None:
    for make in (
        lambda seed: datasets.turbulence((33, 33, 20), seed=seed, time=0.1, cache=False),
        lambda seed: datasets.jet(32, seed=seed, resolution=24, time=0.5, cache=False),
    ):
        first, again, other = make(1), make(1), make(2)
        assert np.array_equal(first.values, again.values)
        assert not np.array_equal(first.values, other.values)


def test_vortex_is_symmetric_and_known() -> None:
    values = datasets.vortex(32, resolution=32, time=2.0, cache=False).values.astype(np.float64)
    # The flow stays unchanged under mirroring at every wall of its cells.
    mirrored = np.roll(values[:, :, ::-1], 1, axis=2)
    assert np.abs(values - mirrored).max() < 1e-3 * values.max()
    start = datasets.vortex(32, resolution=32, time=0.0, cache=False).values.astype(np.float64)
    # The mean square of the vorticity starts at 3/4, by the formula; stretching makes it grow.
    assert np.mean(start**2) == pytest.approx(0.75, rel=1e-5)
    assert np.mean(values**2) > 1.1 * 0.75


# The cache


def _cached_file(folder: Path) -> Path:
    files = list((folder / "sheetsplat").iterdir())
    assert len(files) == 1
    return files[0]


def _small(**options: object) -> np.ndarray:
    return datasets.vortex(16, time=0.2, **options).values  # type: ignore[arg-type]


def test_cache_is_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = _small()
    file = _cached_file(tmp_path)
    # The file is a plain .npy one.
    assert np.array_equal(np.load(file, allow_pickle=False), first)

    def refuse(*_: object) -> None:
        raise AssertionError("the flow was computed again")

    monkeypatch.setattr(_flows, "taylor_green", refuse)
    assert np.array_equal(_small(), first)
    with pytest.raises(AssertionError, match="again"):
        _small(cache=False)
    with pytest.raises(AssertionError, match="again"):
        datasets.vortex(16, time=0.21)
    monkeypatch.setattr(_flows, "_VERSION", _flows._VERSION + 1)
    with pytest.raises(AssertionError, match="again"):
        _small()


@pytest.mark.parametrize("damage", ["cut", "flip", "empty", "garbage", "other shape", "pickle", "huge header"])
def test_damaged_cache_files_are_computed_again(tmp_path: Path, damage: str) -> None:
    first = _small()
    file = _cached_file(tmp_path)
    whole = file.read_bytes()

    def signed(content: bytes) -> bytes:
        return content + hashlib.blake2b(content, digest_size=32).digest()

    if damage == "cut":
        file.write_bytes(whole[: len(whole) // 2])
    elif damage == "flip":
        file.write_bytes(whole[:5000] + bytes([whole[5000] ^ 1]) + whole[5001:])
    elif damage == "empty":
        file.write_bytes(b"")
    elif damage == "garbage":
        file.write_bytes(signed(os.urandom(len(whole) - 32)))
    elif damage == "other shape":
        file.write_bytes(signed(whole[:-32].replace(b"(16, 16, 16)", b"(16, 8, 32)")))
    elif damage == "pickle":
        body = whole[:-32].replace(b"'<f4'", b"'|O' ")
        assert body != whole[:-32]
        file.write_bytes(signed(body))
    else:
        file.write_bytes(signed(whole[:-32].replace(b"(16, 16, 16)", b"(99999, 9999, 9)"[:12])))
    assert file.read_bytes() != whole
    assert np.array_equal(_small(), first)
    assert file.read_bytes() == whole


def test_cache_leaves_nothing_half_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(os, "replace", full)
    expected = _small()
    assert list((tmp_path / "sheetsplat").iterdir()) == []
    monkeypatch.undo()
    assert np.array_equal(_small(cache=False), expected)


def test_cache_folder_that_cannot_be_made_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("a file where a folder is wanted")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    assert _small().shape == (16, 16, 16)


def test_cache_folder_follows_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert datasets.cache_folder() == tmp_path / "sheetsplat"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative/path")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert datasets.cache_folder() == tmp_path / "home" / ".cache" / "sheetsplat"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert datasets.cache_folder() == tmp_path / "home" / ".cache" / "sheetsplat"
