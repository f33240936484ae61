"""Flows from a solver, in place of the simulations of [NM05]: vortex, turbulence and jet."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.generators.cache import cached
from bench.generators.spectral import Flow, Real, wave_numbers
from sheetsplat.datasets import Dataset
from sheetsplat.datasets._dataset import Vector, require_samples
from sheetsplat.datasets.random_stream import Stream
from sheetsplat.errors import complain

# Increase this with every change of a flow's values; cached results of other versions are not used.
_VERSION = 1


def _magnitude(components: Real) -> NDArray[np.float32]:
    return np.asarray(np.sqrt(np.einsum("cijk,cijk->ijk", components, components)), dtype=np.float32)


def taylor_green(n: int, viscosity: float, dtype: Any = np.float32) -> Flow:
    """Return the Taylor-Green vortex at time 0: (sin x cos y cos z, -cos x sin y cos z, 0)."""
    x = (np.arange(n) * (2.0 * np.pi / n)).astype(np.float64)
    sine, cosine = np.sin(x), np.cos(x)
    velocity = np.zeros((3, n, n, n), dtype)
    velocity[0] = cosine[:, None, None] * cosine[None, :, None] * sine[None, None, :]
    velocity[1] = -cosine[:, None, None] * sine[None, :, None] * cosine[None, None, :]
    return Flow(velocity, viscosity)


def isotropic(n: int, viscosity: float, seed: int, peak: float = 3.0, dtype: Any = np.float32) -> Flow:
    """Return a random isotropic flow with energy spectrum k^4 exp(-2 (k / peak)^2) and a mean of u^2 / 2 of 1.5.

    The random numbers belong to the wave numbers, not to the points, so that the flow is the same at every resolution.
    """
    # Waves up to twice the peak have 99.9 % of the energy; every resolution has them.
    reach = int(np.ceil(2.0 * peak)) + 1
    kx, ky, kz = wave_numbers(n, np.dtype(np.float64))
    stream = Stream(seed)
    spectrum = np.zeros((3, n, n, n // 2 + 1), np.complex128)
    shape = (3, 2 * reach + 1, 2 * reach + 1, reach + 1)
    around = np.arange(-reach, reach + 1)
    spectrum[:, around[:, None], around, : reach + 1] = stream.normal(*shape) + 1j * stream.normal(*shape)
    k = np.sqrt(kx * kx + ky * ky + kz * kz)
    # The energy in a shell is proportional to k^2 times the square of the amplitude.
    spectrum *= k * np.exp(-((k / peak) ** 2)) * (k <= reach)
    velocity = np.stack([np.fft.irfftn(c, s=(n, n, n), axes=(0, 1, 2)) for c in spectrum])
    flow = Flow(velocity, viscosity)
    scale = np.sqrt(1.5 / flow.energy())
    return Flow((flow.velocity() * scale).astype(dtype), viscosity)


def round_jet(n: int, viscosity: float, seed: int, dtype: Any = np.float32) -> Flow:
    """Return a round jet along x that starts smooth, with small disturbances; the scalar is 1 in the jet and 0 outside.

    The layer between jet and outside rolls up into rings, which break up. The box is periodic, so the jet grows in time
    and not along x.
    """
    radius, layer = 0.7, 0.09
    x = (np.arange(n) * (2.0 * np.pi / n) - np.pi).astype(np.float64)
    z, y = x[:, None, None], x[None, :, None]
    along = x[None, None, :]
    distance, angle = np.hypot(y, z), np.arctan2(z, y)
    stream = Stream(seed)
    rim = np.exp(-(((distance - radius) / (3.0 * layer)) ** 2))
    # Waves along the jet with 0 to 2 periods around it, the modes that grow first.
    push = np.zeros((n, n, n))
    for turns in range(3):
        for wave in range(2, 9):
            phase, size = stream.uniform(2)
            push += (0.3 + size) * np.cos(wave * along + turns * angle + 2.0 * np.pi * phase)
    push *= rim * (0.03 / np.sqrt(np.mean(push**2)))
    profile = 0.5 * (1.0 + np.tanh((radius - distance) / (2.0 * layer))) * np.ones_like(along)
    safe = np.maximum(distance, 1e-9)
    velocity = np.stack([profile + push, push * y / safe, push * z / safe])
    return Flow(velocity.astype(dtype), viscosity, scalar=profile.astype(dtype), diffusivity=viscosity)


def vortex(n: int = 128, *, resolution: int | None = None, time: float = 7.0, cache: bool = True) -> Dataset:
    """Return the vorticity magnitude of a Taylor-Green vortex after its breakdown.

    Navier-Stokes at Reynolds number 250, pseudo-spectral; computed on ``resolution`` cubed points and refined to n^3 by
    exact trigonometric interpolation of the vorticity's components.

    Parameters
    ----------
    n
        Samples along each axis, at least 8; they cover one period.
    resolution
        Points of the computation along each axis, even, at most n; 64 (or n, where that is less) unless given.
    time
        Time at which the flow is shown; a vortex is one unit wide and turns at speed 1.
    cache
        Whether the result is kept in the user's cache folder and taken from there.
    """
    require_samples("vortex", n, 8)
    resolution = _resolution(resolution, n)

    def compute() -> NDArray[np.float32]:
        flow = taylor_green(resolution, 1.0 / 250.0)
        flow.run(time)
        return _magnitude(flow.vorticity(n))

    parameters = {"n": n, "resolution": resolution, "time": time}
    values = cached("vortex", _VERSION, parameters, (n, n, n), np.dtype(np.float32), compute, use=cache)
    lower, upper = (float(np.quantile(values, part)) for part in (0.77, 0.999))
    return Dataset(
        "vortex",
        values,
        description=f"Vorticity magnitude of a Taylor-Green vortex at time {time:g}, Reynolds number 250, computed on "
        f"{resolution}^3 points by a pseudo-spectral method.",
        stand_in_for="Vortex, 128^3, of the 2005 paper (a pseudo-spectral simulation of coherent vortices)",
        suggested=_ramp(lower, upper, (0.15, 0.35, 0.95), (1.0, 0.85, 0.3), 0.35),
    )


def turbulence(
    shape: tuple[int, int, int] = (129, 129, 104),
    *,
    seed: int = 2005,
    resolution: int | None = None,
    time: float = 0.9,
    cache: bool = True,
) -> Dataset:
    """Return the vorticity magnitude of decaying isotropic turbulence, 104 x 129 x 129 samples (x, y, z).

    Pseudo-spectral Navier-Stokes from random initial waves; computed on ``resolution`` cubed points and refined. The
    samples lie as close as the longest axis needs to span one period with both its ends; shorter axes show a part.

    Parameters
    ----------
    shape
        Samples along k, j, i (z, y, x); the largest is at least 17.
    seed
        Seed of the initial waves.
    resolution
        Points of the computation along each axis, even, from 16 to the longest axis less one; 64, or as many as fit,
        unless given.
    time
        Time at which the flow is shown, in turns of a large eddy of unit size and speed.
    cache
        Whether the result is kept in the user's cache folder and taken from there.
    """
    if len(shape) != 3 or min(shape) < 1 or max(shape) < 17:
        raise complain(
            "the data set turbulence cannot be made", f"shape {shape}", "three numbers, the largest at least 17"
        )
    period = max(shape) - 1
    resolution = _resolution(resolution, period, least=16)

    def compute() -> NDArray[np.float32]:
        flow = isotropic(resolution, 1.0 / 90.0, seed)
        flow.run(time)
        fine = _magnitude(flow.vorticity(period))
        wrapped = [np.arange(size) % period for size in shape]
        return np.ascontiguousarray(fine[np.ix_(*wrapped)])

    parameters = {"shape": tuple(shape), "seed": seed, "resolution": resolution, "time": time}
    values = cached("turbulence", _VERSION, parameters, tuple(shape), np.dtype(np.float32), compute, use=cache)
    lower, upper = (float(np.quantile(values, part)) for part in (0.945, 0.9995))
    return Dataset(
        "turbulence",
        values,
        description=f"Vorticity magnitude of decaying isotropic turbulence, computed on {resolution}^3 points by a "
        "pseudo-spectral method.",
        stand_in_for="Turbulence, 104 x 129 x 129, of the 2005 paper",
        suggested=_ramp(lower, upper, (0.9, 0.3, 0.1), (1.0, 0.95, 0.7), 0.5),
    )


def jet(
    n: int = 256, *, seed: int = 2005, resolution: int | None = None, time: float = 12.5, cache: bool = True
) -> Dataset:
    """Return a passive scalar in a round jet that breaks up, 8 bits.

    Pseudo-spectral Navier-Stokes with a passive scalar, in a periodic box; computed on ``resolution`` cubed points and
    refined to n^3. The jet runs along x.

    Parameters
    ----------
    n
        Samples along each axis, at least 8.
    seed
        Seed of the disturbances.
    resolution
        Points of the computation along each axis, even, at most n; 64 (or n, where that is less) unless given.
    time
        Time at which the jet is shown; it is 1.4 wide and runs at speed 1.
    cache
        Whether the result is kept in the user's cache folder and taken from there.
    """
    require_samples("jet", n, 8)
    resolution = _resolution(resolution, n)

    def compute() -> NDArray[np.uint8]:
        flow = round_jet(resolution, 1.0 / 700.0, seed)
        flow.run(time)
        return np.asarray(np.rint(np.clip(flow.scalar(n), 0.0, 1.0) * 255.0), dtype=np.uint8)

    parameters = {"n": n, "seed": seed, "resolution": resolution, "time": time}
    values = cached("jet", _VERSION, parameters, (n, n, n), np.dtype(np.uint8), compute, use=cache)
    return Dataset(
        "jet",
        values,
        description=f"Dye in a round jet that breaks up, computed on {resolution}^3 points, pseudo-spectral.",
        stand_in_for="Jet simulation, 256^3, of the 2005 paper",
        suggested=_ramp(100.0, 230.0, (0.2, 0.5, 0.9), (1.0, 0.7, 0.25), 0.3),
    )


def _resolution(resolution: int | None, n: int, least: int = 8) -> int:
    chosen = min(64, n - n % 2) if resolution is None else resolution
    if chosen % 2 or not least <= chosen <= n:
        raise complain("the flow cannot be computed", f"resolution {chosen}", f"an even number from {least} to {n}")
    return chosen


def _ramp(lower: float, upper: float, first: Vector, last: Vector, opacity: float) -> dict[str, Any]:
    points = [(lower, *first, 0.0), (0.5 * (lower + upper), *first, 0.3 * opacity), (upper, *last, opacity)]
    return {"clim": (lower, upper), "points": points}
