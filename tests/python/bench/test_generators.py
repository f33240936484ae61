"""Stand-ins for the papers' data: the flow solver against closed forms, its cache, and solids filled with kernels."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bench.generators import cache, flows, solids, spectral, train
from bench.generators.spectral import Flow
from sheetsplat import fit
from sheetsplat.errors import InvalidInput
from sheetsplat.fit._mesh import close


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


def test_bad_arguments_have_clear_errors() -> None:
    for make in (
        lambda: flows.vortex(4),
        lambda: flows.vortex(32, resolution=33),
        lambda: flows.vortex(32, resolution=64),
        lambda: flows.turbulence((8, 8, 8)),
        lambda: flows.turbulence((0, 64, 64)),
        lambda: flows.jet(4),
    ):
        with pytest.raises(InvalidInput, match="wanted|at least"):
            make()


def test_stand_ins_are_called_so() -> None:
    small = (
        flows.vortex(16, time=0.2, cache=False),
        flows.turbulence((17, 16, 9), time=0.05, cache=False),
        flows.jet(16, time=0.2, cache=False),
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
    waves = spectral.wave_numbers(flow.n, np.dtype(np.float64))
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
    flow = flows.taylor_green(16, 0.0, np.float64)
    start = flow.energy()
    assert start == pytest.approx(0.125, rel=1e-12)
    for _ in range(20):
        flow.step(0.05)
    assert flow.energy() == pytest.approx(start, rel=1e-6)
    assert np.abs(_divergence(flow)).max() < 1e-13 < 1e-3 * np.abs(flow.vorticity()).max()


def test_solver_loses_the_energy_that_viscosity_takes() -> None:
    # dE/dt = -2 nu times the enstrophy, by Simpson's rule over a stretch in which the enstrophy changes.
    viscosity, step = 0.01, 0.05
    flow = flows.taylor_green(24, viscosity, np.float64)
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
        flow = flows.taylor_green(16, 0.05, np.float64)
        for _ in range(steps):
            flow.step(2.0 / steps)
        return flow.velocity()

    best = after(128)
    errors = [float(np.abs(after(steps) - best).max()) for steps in (8, 16, 32)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all((orders > 3.7) & (orders < 4.4)), orders


def test_solver_agrees_across_resolutions() -> None:
    # The waves are those of the seed, whatever the resolution.
    coarse, fine = (flows.isotropic(n, 0.05, 1, peak=2.0, dtype=np.float64) for n in (24, 32))
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
    flow = flows.round_jet(24, 1.0 / 50.0, 1, np.float64)
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
        assert np.abs(spectral.refine(spectrum, n) - field(n)).max() < 1e-12
    assert np.abs(spectral.refine(spectrum, 20) - field(20)[::-1]).max() > 0.1
    with pytest.raises(ValueError, match="cannot refine"):
        spectral.refine(spectrum, 12)


def testflows_are_deterministic() -> None:
    for make in (
        lambda seed: flows.turbulence((33, 33, 20), seed=seed, time=0.1, cache=False),
        lambda seed: flows.jet(32, seed=seed, resolution=24, time=0.5, cache=False),
    ):
        first, again, other = make(1), make(1), make(2)
        assert np.array_equal(first.values, again.values)
        assert not np.array_equal(first.values, other.values)


def test_vortex_is_symmetric_and_known() -> None:
    values = flows.vortex(32, resolution=32, time=2.0, cache=False).values.astype(np.float64)
    # The flow stays unchanged under mirroring at every wall of its cells.
    mirrored = np.roll(values[:, :, ::-1], 1, axis=2)
    assert np.abs(values - mirrored).max() < 1e-3 * values.max()
    start = flows.vortex(32, resolution=32, time=0.0, cache=False).values.astype(np.float64)
    # The mean square of the vorticity starts at 3/4, by the formula; stretching makes it grow.
    assert np.mean(start**2) == pytest.approx(0.75, rel=1e-5)
    assert np.mean(values**2) > 1.1 * 0.75


# The cache


def _cached_file(folder: Path) -> Path:
    files = list((folder / "sheetsplat").iterdir())
    assert len(files) == 1
    return files[0]


def _small(**options: object) -> np.ndarray:
    return flows.vortex(16, time=0.2, **options).values  # type: ignore[arg-type]


def test_cache_is_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = _small()
    file = _cached_file(tmp_path)
    # The file is a plain .npy one.
    assert np.array_equal(np.load(file, allow_pickle=False), first)

    def refuse(*_: object) -> None:
        raise AssertionError("the flow was computed again")

    monkeypatch.setattr(flows, "taylor_green", refuse)
    assert np.array_equal(_small(), first)
    with pytest.raises(AssertionError, match="again"):
        _small(cache=False)
    with pytest.raises(AssertionError, match="again"):
        flows.vortex(16, time=0.21)
    monkeypatch.setattr(flows, "_VERSION", flows._VERSION + 1)
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
    assert cache.cache_folder() == tmp_path / "sheetsplat"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative/path")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert cache.cache_folder() == tmp_path / "home" / ".cache" / "sheetsplat"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache.cache_folder() == tmp_path / "home" / ".cache" / "sheetsplat"


# The stand-ins


def _check(made: solids.Solid, count: int) -> None:
    kernels = made.kernels
    assert len(kernels) == pytest.approx(count, rel=0.02)
    assert np.array_equal(np.unique(kernels.values), [1.0])
    # Sizes differ over the levels, and shapes by the bending.
    longest, shortest = kernels.scales.max(axis=1), kernels.scales.min(axis=1)
    assert 3.9 < longest.max() / longest.min() < 12
    assert 1.1 < (longest / shortest).max() < 4
    some = np.random.default_rng(10).integers(len(kernels), size=500)
    assert kernels.sums(kernels.centers[some])[1].min() > 0.98
    assert np.array(made.points).shape == (4, 5)


@pytest.mark.slow
def test_the_toy_train() -> None:
    _check(solids.toy_train(), 199_000)
    few, again = solids.toy_train(20_000), solids.toy_train(20_000)
    assert np.array_equal(few.kernels.centers, again.kernels.centers)
    assert np.array_equal(few.kernels.scales, again.kernels.scales)
    # It is longer than wide and high, has nothing below its wheels, and its volume is that of its parts' union.
    straight = solids.toy_train(20_000, deformed=False).kernels
    lower, upper = straight.centers.min(axis=0), straight.centers.max(axis=0)
    assert (upper - lower)[0] > 4 * (upper - lower)[1] > 4
    assert straight.scales.ndim == 1 and lower[1] > 0
    at = lower + (upper - lower) * np.random.default_rng(11).random((1500, 3))
    mesh = train.train_mesh()
    share = np.mean(fit.winding_numbers(at, *mesh) > 0.5) * np.prod(upper - lower)
    assert straight.report["cell_volume"] == pytest.approx(share, rel=0.12)


def test_every_part_of_the_train_is_closed_and_looks_outward() -> None:
    parts = [*train._locomotive(0), *train._tender(0), *train._coach(0), *train._wagon(0)]
    assert len(parts) > 100
    for part in parts:
        closed = close("the part", *part)
        assert closed.turned == 0 and closed.shells == 1 and closed.volume > 0


@pytest.mark.slow
@pytest.mark.data
@pytest.mark.parametrize(
    ("make", "count", "file"),
    [
        (solids.chess_piece, 84_000, "mesh_chess_knight.obj"),
        (solids.monster, 91_000, "mesh_spot.obj"),
        (solids.toy_car, 173_000, "mesh_toy_cannon.obj"),
    ],
)
def test_stand_ins_of_meshes(data_dir: Path, make: Callable[..., solids.Solid], count: int, file: str) -> None:
    if not (data_dir / file).is_file():
        pytest.skip(f"{data_dir / file} is not there")
    _check(make(data_dir / file), count)
    spheres = make(data_dir / file, 5000, deformed=False).kernels
    assert spheres.report["cell_volume"] == pytest.approx(spheres.report["mesh_volume"], rel=0.03)
