"""A small pseudo-spectral solver of the incompressible Navier-Stokes equations in a periodic cube.

    du/dt = P(u x w) - nu k^2 u        w = curl u, P the projection on fields without divergence
    ds/dt = -div(u s) - kappa k^2 s    a passive scalar

Products are formed in space and truncated at two thirds of the largest wave number (Orszag 1971), time is advanced by
the classical fourth-order Runge-Kutta method. The cube is [0, 2 pi)^3. Arrays are indexed ``[k, j, i]`` (z, y, x);
vectors have their components x, y, z first. One solver serves the vortex, the turbulence and the jet.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.floating[Any]]
Complex = NDArray[np.complexfloating[Any, Any]]


def wave_numbers(n: int, dtype: np.dtype[Any]) -> tuple[Real, Real, Real]:
    """Return the wave numbers x, y, z of the half spectrum of an n^3 cube, shaped to broadcast against it."""
    whole = np.fft.fftfreq(n, 1.0 / n).astype(dtype)
    half = np.fft.rfftfreq(n, 1.0 / n).astype(dtype)
    return half[None, None, :], whole[None, :, None], whole[:, None, None]


class Flow:
    """A velocity field and, where given, a passive scalar, at one moment.

    Parameters
    ----------
    velocity
        (3, n, n, n), components x, y, z; made free of divergence and truncated. Its type (float32 or float64) is that
        of the computation.
    viscosity
        nu, at least 0.
    scalar
        (n, n, n) or None.
    diffusivity
        kappa of the scalar, at least 0.

    Attributes
    ----------
    time
        Since the start.
    """

    def __init__(
        self, velocity: Real, viscosity: float, *, scalar: Real | None = None, diffusivity: float = 0.0
    ) -> None:
        dtype = np.result_type(velocity, np.float32)
        self.n = velocity.shape[1]
        self.viscosity = viscosity
        self.diffusivity = diffusivity
        self.time = 0.0
        self._k = wave_numbers(self.n, dtype)
        kx, ky, kz = self._k
        self._k_squared = kx * kx + ky * ky + kz * kz
        self._inverse = 1.0 / np.maximum(self._k_squared, 1.0)
        limit = self.n / 3.0
        self._keep = (np.abs(kx) < limit) & (np.abs(ky) < limit) & (np.abs(kz) < limit)
        # Velocity and scalar share one array, so that a time step is one sum.
        fields = [*velocity] if scalar is None else [*velocity, scalar]
        state = self._forward(np.stack(fields, dtype=dtype)) * self._keep
        state[:3] = self._project(state[:3])
        self._state: Complex = state

    def _forward(self, fields: Real) -> Complex:
        from scipy import fft  # type: ignore[import-untyped]

        return np.asarray(fft.rfftn(fields, axes=(-3, -2, -1)))

    def _back(self, spectrum: Complex) -> Real:
        from scipy import fft

        return np.asarray(fft.irfftn(spectrum, s=(self.n,) * 3, axes=(-3, -2, -1)))

    def _project(self, vector: Complex) -> Complex:
        kx, ky, kz = self._k
        along = (kx * vector[0] + ky * vector[1] + kz * vector[2]) * self._inverse
        return np.stack([vector[0] - kx * along, vector[1] - ky * along, vector[2] - kz * along])

    def _curl(self, vector: Complex) -> Complex:
        kx, ky, kz = self._k
        x, y, z = vector
        curl = 1j * np.stack([ky * z - kz * y, kz * x - kx * z, kx * y - ky * x])
        return curl.astype(vector.dtype, copy=False)

    def _rate(self, state: Complex) -> Complex:
        fields = self._back(state)
        u, w = fields[:3], self._back(self._curl(state[:3]))
        rate = np.empty_like(state)
        rate[:3] = self._project(self._forward(np.cross(u, w, axis=0)) * self._keep)
        rate[:3] -= self.viscosity * self._k_squared * state[:3]
        if len(state) == 4:
            kx, ky, kz = self._k
            flux = self._forward(u * fields[3])
            rate[3] = -1j * (kx * flux[0] + ky * flux[1] + kz * flux[2]) * self._keep
            rate[3] -= self.diffusivity * self._k_squared * state[3]
        return rate

    def step(self, dt: float) -> None:
        """One Runge-Kutta step."""
        start = self._state
        rate = self._rate(start)
        change = rate.copy()
        for share, weight in ((0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
            rate = self._rate(start + share * dt * rate)
            change += weight * rate
        self._state = start + dt / 6.0 * change
        self.time += dt

    def stable_step(self) -> float:
        """Return a step at which Runge-Kutta is stable.

        The method's limits are 2.83 for waves that travel and 2.78 for those that fade; 2 leaves room for both.
        """
        largest = self.n / 3.0
        speed = float(np.abs(self.velocity()).sum(axis=0).max())
        loss = max(self.viscosity, self.diffusivity) * 3.0 * largest * largest
        return float(min(2.0 / max(largest * speed, 1e-9), 2.0 / max(loss, 1e-9)))

    def run(self, until: float, largest_step: float = 0.25) -> None:
        """Advance to the time `until`, with steps that follow the speed of the flow."""
        while self.time < until - 1e-9:
            rest = until - self.time
            step = min(largest_step, self.stable_step())
            # The last two steps have the same length, so that none is tiny.
            self.step(rest if rest <= step else min(step, 0.5 * rest if rest < 2.0 * step else step))

    def velocity(self) -> Real:
        """Return the velocity (3, n, n, n)."""
        return self._back(self._state[:3])

    def vorticity(self, n: int | None = None) -> Real:
        """Return the vorticity (3, n, n, n), refined spectrally where `n` is larger than the computation's own."""
        spectrum = self._curl(self._state[:3])
        return self._back(spectrum) if n is None else np.stack([refine(c, n) for c in spectrum])

    def scalar(self, n: int | None = None) -> Real:
        """Return the scalar (n, n, n), refined spectrally where `n` is larger than the computation's own."""
        return np.asarray(self._back(self._state[3:])[0]) if n is None else refine(self._state[3], n)

    def energy(self) -> float:
        """Return the mean of u^2 / 2."""
        return 0.5 * float(np.mean(np.sum(self.velocity().astype(np.float64) ** 2, axis=0)))


def refine(spectrum: Complex, n: int) -> Real:
    """Return the field of a half spectrum (m, m, m // 2 + 1) on n^3 points, n >= m.

    Interpolation is exact, by zero padding. The largest wave number m/2 must hold nothing, as it does after truncation.
    """
    from scipy import fft

    m = spectrum.shape[0]
    if n < m:
        raise ValueError(f"cannot refine {m} points to {n}; wanted at least as many")
    half = m // 2
    wide = np.zeros((n, n, n // 2 + 1), spectrum.dtype)
    kept = np.ix_(np.r_[:half, -half:0], np.r_[:half, -half:0], np.r_[:half])
    wide[kept] = spectrum[kept]
    wide *= (n / m) ** 3
    return np.asarray(fft.irfftn(wide, s=(n, n, n), overwrite_x=True))
