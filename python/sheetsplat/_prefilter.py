"""Coefficients of kernels whose sum passes through the samples of a lattice: the interpolating prefilter.

A lattice of samples f_n at x_n gets the coefficients c_n with sum_m c_m g(x_n - x_m) = f_n at every sample; beyond the
box there is no kernel. The matrix of g(x_n - x_m) is a block of the infinite lattice's convolution, so its eigenvalues
lie between the smallest and the largest value of that convolution's spectrum (Cauchy's interlacing theorem): where the
spectrum is above 0 the coefficients exist, are unique, and lose no more digits than the ratio of the spectrum's ends.

They are found by conjugate gradients. A product with the matrix is a convolution by Fourier transform with zeros around
the volume; the preconditioner divides by the spectrum in the same way, which is exact but for a thin layer at the
border (T. Chan, An optimal circulant preconditioner for Toeplitz systems, 1988). Steps are float32, residuals float64
(iterative refinement), so that memory and time are those of float32 and the digits those of float64.
"""

from __future__ import annotations

import logging
import math
import os
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat.errors import Error, complain, option_ref

Floats = NDArray[np.float64]

#: Kernels of a larger condition number are refused: sums in float32 would lose too many digits.
WORST_CONDITION = 2e3
#: Largest accepted distance of the sums from a sample, relative to the largest sample.
WORST_RESIDUAL = 1e-6
# Residual to reach, relative to the largest sample, before the coefficients are rounded to their type.
_WANTED = {4: 2e-8, 8: 1e-12}
# Largest radius of a support in sample distances; wider kernels need large tables and are of no use.
_WIDEST = 16.0
# One solution in float32: the reduction of the residual, and the most steps.
_REDUCTION = 1e-4
_STEPS = 200
_ROUNDS = 8
# Frequencies along an axis at which the spectrum is evaluated, from 0 to the lattice's highest.
_FREQUENCIES = 65
# Most bytes for each sample of the volume with its border: the coefficients in float64, and their transform or the
# arrays of the float32 steps.
_BYTES = 60
# The limit of fields, so that their sums stay finite.
_LARGEST_SAMPLE = 1e300

_FAILED = "RegularField: the samples cannot be prefiltered"
_FAILED_KERNEL = "RegularField: " + option_ref("prefilter", "true") + " cannot be used with this kernel"
_log = logging.getLogger("sheetsplat")


def unit_radius(radius: float, lattice: str) -> float:
    """Return a support's radius in the unit in which all samples lie at whole numbers: for BCC a/2."""
    return radius * math.sqrt(2.0) if lattice == "bcc" else radius


def profile(squares: Any, falloff: float) -> Any:
    """Return g of squared distances in radii. Conventions, section 2."""
    return np.maximum(0.0, (np.exp(-falloff * squares) - math.exp(-falloff)) / -math.expm1(-falloff))


@lru_cache(maxsize=16)
def taps(radius: float, falloff: float, lattice: str) -> Floats:
    """Return g at the lattice's samples around one of them, [|z|, |y|, |x|], in the unit of `unit_radius`; g is even.

    In that unit samples of a BCC lattice have three even or three odd coordinates; elsewhere the entry is 0.
    """
    reach = unit_radius(radius, lattice)
    # A sample at the very edge has g = 0.
    steps = np.arange(max(1, math.ceil(reach)))
    squares = (steps[:, None, None] ** 2 + steps[:, None] ** 2 + steps**2) / reach**2
    found: Floats = profile(squares, falloff)
    if lattice == "bcc":
        odd = steps % 2
        found = found * ((odd[:, None, None] == odd[:, None]) & (odd[:, None] == odd))
    found.flags.writeable = False
    return found


def _cosines(angles: Floats, count: int) -> Floats:
    """Return [angle, n]: what a pair of even taps at -n and n adds to a spectrum."""
    table = 2.0 * np.cos(angles[:, None] * np.arange(count))
    table[:, 0] = 1.0
    return table


@lru_cache(maxsize=64)
def spectrum_range(radius: float, falloff: float, lattice: str) -> tuple[float, float]:
    """Return the smallest and the largest value of the spectrum of the lattice's sums of kernels."""
    found = taps(radius, falloff, lattice)
    table = _cosines(np.linspace(0.0, math.pi, _FREQUENCIES), len(found))
    spectrum = np.einsum("kjn,in->kji", np.einsum("kmn,jm->kjn", np.einsum("lmn,kl->kmn", found, table), table), table)
    return float(spectrum.min()), float(spectrum.max())


def condition(radius: float, falloff: float, lattice: str) -> float:
    """Return the largest condition number of the equations for the coefficients; infinite where there may be none."""
    low, high = spectrum_range(radius, falloff, lattice)
    return high / low if low > 0.0 else math.inf


@dataclass(frozen=True)
class Coefficients:
    """What `solve` found.

    Attributes
    ----------
    values
        The coefficients, [k, j, i]: float32, or float64 where the samples are, or where float32 has too few digits.
    residual
        Largest distance of their sum from a sample, of the largest sample.
    condition
        Upper bound of the condition number of the equations.
    steps
        Of conjugate gradients.
    """

    values: NDArray[Any]
    residual: float
    condition: float
    steps: int


def _padded(shape: tuple[int, int, int], count: int, lattice: str) -> tuple[int, int, int]:
    """Return the size of a transform of a volume (BCC: of its even layers) for so many taps along half an axis."""
    from scipy import fft  # type: ignore[import-untyped]

    # As far as kernels reach in indices, so that none reaches round the border.
    border = count // 2 + 1 if lattice == "bcc" else count - 1
    layers = (shape[0] + 1) // 2 if lattice == "bcc" else shape[0]
    nk, nj, ni = (fft.next_fast_len(n + border, real=True) for n in (layers, *shape[1:]))
    return nk, nj, ni


class _Convolution:
    """Products with the matrix of kernels at samples, and with an approximate inverse."""

    def __init__(self, shape: tuple[int, int, int], radius: float, falloff: float, lattice: str) -> None:
        from scipy import fft

        self._fft = fft
        self._shape = shape
        self._bcc = lattice == "bcc"
        self._taps = taps(radius, falloff, lattice)
        count = len(self._taps)
        self._size = _padded(shape, count, lattice)
        nk, nj, ni = self._size
        # Angles for one step of the taps' unit, which is half an index for BCC.
        share = 0.5 if self._bcc else 1.0
        self._angles = [share * 2.0 * math.pi * np.arange(n) / of for n, of in ((nk, nk), (nj, nj), (ni // 2 + 1, ni))]
        tables = [_cosines(angles, count) for angles in self._angles]
        self._depth = tables[0]
        self._planes = np.einsum("lmn,jm,in->lji", self._taps, tables[1], tables[2])
        self._workers = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1

    def __call__(self, values: NDArray[Any], *, inverse: bool = False) -> NDArray[Any]:
        """Return the sums at the samples, or approximate coefficients of these sums; in the type of `values`."""
        if not self._bcc:
            spectrum = self._forward(values)
            for k, depth in enumerate(self._depth):
                plane = _mixed(depth, self._planes).astype(values.dtype)
                (np.divide if inverse else np.multiply)(spectrum[k], plane, out=spectrum[k])
            return self._back(spectrum, self._shape)
        even, odd = self._forward(values[0::2]), self._forward(values[1::2])
        # Odd layers lie half an index further along all axes.
        across = np.exp(-1j * (self._angles[1][:, None] + self._angles[2]))
        for k, depth in enumerate(self._depth):
            # Taps between layers of one kind, and between those of two.
            same, other = _mixed(depth[0::2], self._planes[0::2]), _mixed(depth[1::2], self._planes[1::2])
            if inverse:
                whole = same**2 - other**2
                same, other = same / whole, -other / whole
            same = same.astype(values.dtype)
            turn = np.exp(-1j * self._angles[0][k]) * across
            there = (other * turn).astype(even.dtype)
            first = even[k].copy()
            even[k] = same * first + there * odd[k]
            odd[k] = same * odd[k] + np.conj(there) * first
        made = np.empty(self._shape, values.dtype)
        made[0::2] = self._back(even, made[0::2].shape)
        made[1::2] = self._back(odd, made[1::2].shape)
        return made

    def _forward(self, values: NDArray[Any]) -> NDArray[Any]:
        if not len(values):
            kind = np.complex64 if values.dtype.itemsize == 4 else np.complex128
            return np.zeros((*self._size[:2], self._size[2] // 2 + 1), kind)
        found: NDArray[Any] = self._fft.rfftn(values, s=self._size, workers=self._workers)
        return found

    def _back(self, spectrum: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
        whole = self._fft.irfftn(spectrum, s=self._size, overwrite_x=True, workers=self._workers)
        part: NDArray[Any] = whole[: shape[0], : shape[1], : shape[2]]
        return part


def _mixed(weights: Floats, planes: Floats) -> Floats:
    """Return the weighted sum of planes, of which there may be none."""
    made = np.zeros(planes.shape[1:])
    for weight, plane in zip(weights, planes, strict=True):
        made += weight * plane
    return made


def _dot(first: NDArray[Any], second: NDArray[Any]) -> float:
    """Return the inner product; layers are added up in float64."""
    return math.fsum(float(np.vdot(a, b)) for a, b in zip(first, second, strict=True))


def _descend(matrix: _Convolution, residual: NDArray[np.float32]) -> tuple[NDArray[np.float32], int]:
    """Return an approximate solution for a right-hand side, which is overwritten, and the steps taken."""
    found = np.zeros_like(residual)
    enough = _REDUCTION**2 * _dot(residual, residual)
    nearer = matrix(residual, inverse=True)
    direction = np.array(nearer)
    slope = _dot(residual, nearer)
    del nearer
    for step in range(1, _STEPS + 1):
        image = matrix(direction)
        bend = _dot(direction, image)
        if not bend > 0.0:
            return found, step
        length = np.float32(slope / bend)
        for k in range(len(found)):
            found[k] += length * direction[k]
            residual[k] -= length * image[k]
        del image
        if _dot(residual, residual) <= enough:
            return found, step
        nearer = matrix(residual, inverse=True)
        steeper = _dot(residual, nearer)
        direction *= np.float32(steeper / slope)
        direction += nearer
        slope = steeper
        del nearer
    return found, _STEPS


def require_kernel(radius: float, falloff: float, lattice: str) -> float:
    """Return the condition number for kernels that can be prefiltered; InvalidInput for others."""
    if radius > _WIDEST:
        raise complain(
            _FAILED_KERNEL,
            f"radius {radius:g}",
            f"at most {_WIDEST:g} sample distances",
            "use (radius, falloff) = (2, 5), (2.5, 7) or (3, 8)",
        )
    low, high = spectrum_range(radius, falloff, lattice)
    worst = condition(radius, falloff, lattice)
    if worst <= WORST_CONDITION:
        return worst
    found = f"radius {radius:g} with falloff {falloff:g} on a {lattice} lattice, "
    if low > 0.0:
        found += f"whose equations have the condition number {worst:.3g}"
    else:
        found += f"whose spectrum goes from {low:.3g} to {high:.3g}, so that not all samples can be passed through"
    raise complain(
        _FAILED_KERNEL,
        found,
        f"a spectrum above 0 and a condition number of at most {WORST_CONDITION:g}",
        "use a larger "
        + option_ref("falloff")
        + " or a smaller "
        + option_ref("radius")
        + ": radius 2 with falloff 5, 2.5 with 7 and 3 with 8 can be used",
    )


def _largest(values: NDArray[Any]) -> float:
    """Return the largest magnitude; whole numbers do not overflow, and there is no copy of the whole."""
    return max(max(float(layer.max()), -float(layer.min())) for layer in values)


def _unmet(matrix: _Convolution, found: Floats, samples: NDArray[Any], unit: float) -> tuple[Floats, float]:
    """Return samples in units minus the sums of coefficients in units, float64, and the largest of them."""
    sums = matrix(found)
    largest = 0.0
    for wanted, layer in zip(samples, sums, strict=True):
        np.subtract(wanted / unit, layer, out=layer)
        largest = max(largest, float(np.abs(layer).max()))
    return sums, largest


def require_memory(shape: tuple[int, int, int], radius: float, falloff: float, lattice: str) -> None:
    """Raise OutOfMemory where the coefficients of a volume cannot be found."""
    sizes = _padded(shape, len(taps(radius, falloff, lattice)), lattice)
    padded = math.prod(sizes) * (2 if lattice == "bcc" else 1)
    _memory.require(
        _BYTES * padded,
        f"the prefilter of {' x '.join(map(str, shape))} samples",
        "use a smaller volume, or leave out " + option_ref("prefilter"),
    )


def solve(samples: NDArray[Any], radius: float, falloff: float, lattice: str) -> Coefficients:
    """Return the coefficients whose sum passes through all samples.

    Parameters
    ----------
    samples
        [k, j, i], at least one, finite.
    radius, falloff, lattice
        Of the kernels, as for `RegularField`.

    Raises
    ------
    InvalidInput
        For kernels whose equations have no solution, or one that loses too many digits.
    OutOfMemory
        Where what is needed on the way, about 60 bytes a sample, does not fit.
    Error
        Where the sums stay farther from the samples than `WORST_RESIDUAL`.
    """
    worst = require_kernel(radius, falloff, lattice)
    largest = _largest(samples)
    # Far from 1, float32 has no digits left for the small coefficients, or no numbers for the large ones.
    narrow = samples.dtype.itemsize <= 4 and (1e-25 < largest < 1e25 or not largest)
    if not largest:
        return Coefficients(np.zeros(samples.shape, np.float32 if narrow else np.float64), 0.0, worst, 0)
    nk, nj, ni = samples.shape
    require_memory((nk, nj, ni), radius, falloff, lattice)
    matrix = _Convolution((nk, nj, ni), radius, falloff, lattice)
    found = _solve_as(np.float32, samples, largest, matrix, worst) if narrow else None
    if found is None or not found.residual <= WORST_RESIDUAL:
        # Reached in float32 only for rough samples and kernels close to the worst condition number.
        found = _solve_as(np.float64, samples, largest, matrix, worst)
    _log.info("prefilter: %d steps, largest residual %.1e of the largest sample", found.steps, found.residual)
    if not found.residual <= WORST_RESIDUAL:
        raise complain(
            _FAILED,
            f"sums that are {found.residual:.1e} of the largest sample away from the samples after {found.steps} steps",
            f"at most {WORST_RESIDUAL:g}",
            "use a larger "
            + option_ref("falloff")
            + " or a smaller "
            + option_ref("radius")
            + ", or scale the values towards 1",
            kind=Error,
        )
    return found


def _solve_as(
    kind: type[np.floating[Any]], samples: NDArray[Any], largest: float, matrix: _Convolution, worst: float
) -> Coefficients:
    """Return the coefficients of samples up to `largest`, kept as floating-point numbers of a kind."""
    # A power of two costs no digits.
    unit = math.ldexp(1.0, math.frexp(largest)[1] - 1)
    share = largest / unit
    found = np.zeros(samples.shape)
    steps, left = 0, math.inf
    for _ in range(_ROUNDS):
        unmet, now = _unmet(matrix, found, samples, unit)
        if now <= _WANTED[np.dtype(kind).itemsize] * share or not now < 0.5 * left:
            del unmet
            break
        left = now
        step = np.empty(samples.shape, np.float32)
        for layer, more in zip(unmet, step, strict=True):
            np.divide(layer, now, out=more, casting="same_kind")
        del unmet
        step, taken = _descend(matrix, step)
        steps += taken
        for layer, more in zip(found, step, strict=True):
            layer += now * more.astype(np.float64)
        del step
    top = _largest(found) * unit
    if top > _LARGEST_SAMPLE:
        raise complain(_FAILED, f"coefficients up to {top:g}", f"at most {_LARGEST_SAMPLE:g}", "scale the values")
    coefficients = np.empty(samples.shape, kind)
    for layer, rounded in zip(found, coefficients, strict=True):
        np.multiply(layer, unit, out=rounded, casting="same_kind")
        np.divide(rounded, unit, out=layer)
    return Coefficients(coefficients, _unmet(matrix, found, samples, unit)[1] / share, worst, steps)
