"""Kinds of data, each made by a few lines: what a reader should see, and exact interpolations of the samples."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sheetsplat as ss

Array = NDArray[Any]
Floats = NDArray[np.float64]


def _axes(size: int) -> tuple[Floats, Floats, Floats, Floats]:
    """Return z, y, x between -1 and 1, and the distance from the middle."""
    z, y, x = np.mgrid[-1 : 1 : size * 1j, -1 : 1 : size * 1j, -1 : 1 : size * 1j]
    return z, y, x, np.sqrt(x * x + y * y + z * z)


def _noise(size: int, seed: int = 5) -> Floats:
    """Return a random field of unit variance, smooth over a tenth of the box, which goes on beyond all faces."""
    rng = np.random.default_rng(seed)
    wave = np.fft.fftfreq(2 * size) * 2 * size
    k2 = wave[:, None, None] ** 2 + wave[:, None] ** 2 + (wave[: size + 1] ** 2)[None, None]
    spectrum = np.fft.rfftn(rng.normal(size=(2 * size,) * 3)) * np.exp(-k2 / 120.0)
    found: Floats = np.fft.irfftn(spectrum)[:size, :size, :size]
    return np.asarray(found / found.std())


def kelvin(size: int) -> Array:
    """Return a hot spot of 300 K in air of 280 K."""
    _, y, x, r = _axes(size)
    return np.asarray((280 + 20 * np.exp(-6 * r * r) + 3 * np.sin(5 * x) * np.cos(4 * y)).clip(None, 300))


def pascals(size: int) -> Array:
    """Return sound, a few hundred pascals around that of air."""
    z, y, x, _ = _axes(size)
    return 101_300 + 300 * np.sin(4 * x) * np.cos(3 * y) * np.sin(3 * z)


def tomogram(size: int) -> Array:
    """Return a body with bone and air-filled lungs in Hounsfield units."""
    z, y, x, _ = _axes(size)
    rng = np.random.default_rng(3)
    found = np.full(x.shape, -1000.0)
    found[(x / 0.75) ** 2 + (y / 0.55) ** 2 + (z / 0.95) ** 2 < 1] = 40
    for side in (-0.35, 0.35):
        found[((x - side) / 0.25) ** 2 + (y / 0.35) ** 2 + (z / 0.6) ** 2 < 1] = -850
    found[(x**2 + (y - 0.38) ** 2 < 0.01) & (abs(z) < 0.8)] = 1400
    found[((x - 0.1) ** 2 + (y + 0.1) ** 2 + z**2) < 0.004] = 3000
    return np.rint(found + rng.normal(0, 12, x.shape)).astype(np.int16)


def padded_tomogram(size: int) -> Array:
    """Return the same with padding outside of the scanner's circle."""
    _, y, x, _ = _axes(size)
    return np.where(x * x + y * y < 1, tomogram(size), -3024).astype(np.int16)


def decibels(size: int) -> Array:
    """Return the beam of an antenna, cut off 80 dB below its peak."""
    z, y, x, _ = _axes(size)
    along = z + 1.1
    across = np.hypot(x, y) / np.hypot(np.hypot(x, y), along)
    beam = np.sinc(5 * across) ** 2 * np.exp(-((across / 0.2) ** 2)) / (1 + along**2)
    return np.asarray(np.maximum(10 * np.log10(np.maximum(beam, 1e-30)), -80.0).astype(np.float32))


def component(size: int) -> Array:
    """Return one component of the velocity around a vortex ring."""
    z, y, x, _ = _axes(size)
    away = (np.hypot(x, y) - 0.55) ** 2 + z * z
    return (12 * x * z / 0.1 * np.exp(-away / 0.05)).astype(np.float32)


def cut_everywhere(size: int) -> Array:
    """Return a random field around 0 that no face of the box ends."""
    return _noise(size).astype(np.float32)


def ocean(size: int) -> Array:
    """Return anomalies of temperature in a sea, NaN on land and below the ground."""
    found = 2.0 * _noise(size, 8)[: max(size // 3, 4)]
    k, j, i = np.indices(found.shape)
    ground = 0.35 + 0.3 * np.sin(5 * i / size) * np.cos(4 * j / size)
    return np.where(k / found.shape[0] < ground + 0.2 * (i > 0.8 * size), np.nan, found).astype(np.float32)


def microscopy(size: int) -> Array:
    """Return three layers of cells, counts above an offset of 100."""
    rng = np.random.default_rng(11)
    y, x = np.mgrid[: 4 * size, : 4 * size] / (4.0 * size)
    layers = np.full((3, *x.shape), 100.0)
    for cx, cy, wide in zip(rng.random(25), rng.random(25), 0.02 + 0.04 * rng.random(25), strict=True):
        for k in range(3):
            away = np.hypot(x - cx, y - cy) / (wide * (1 - 0.15 * abs(k - 1)))
            layers[k] += 3000 * np.exp(-((away - 0.7) ** 2) / 0.05) * rng.uniform(0.5, 1)
    return rng.poisson(layers).clip(0, 65535).astype(np.uint16)


def one_layer(size: int) -> Array:
    """Return the middle one of these layers."""
    return microscopy(size)[1:2]


def decades(size: int) -> Array:
    """Return densities of five decades: a halo with clumps."""
    *_, r = _axes(size)
    return (10 ** (_noise(size, 4) - 3.5 * r + 1)).astype(np.float32)


def counts(size: int) -> Array:
    """Return counts of events along two tracks, 95 % of them zero."""
    z, y, x, _ = _axes(size)
    one = np.hypot(x - 0.5 * z, y - 0.3 * z * z)
    two = np.hypot(y + 0.4 * x, z - 0.3 * np.sin(3 * x))
    rate = 6 * np.exp(-((one / 0.12) ** 2)) + 4 * np.exp(-((two / 0.1) ** 2))
    return np.asarray(np.random.default_rng(2).poisson(rate).astype(np.uint16))


def signed_distance(size: int) -> Array:
    """Return distances from the surface of a torus, negative inside."""
    z, y, x, _ = _axes(size)
    return (np.hypot(np.hypot(x, y) - 0.6, z) - 0.22).astype(np.float32)


def mask(size: int) -> Array:
    """Return which samples lie in two balls that touch."""
    z, y, x, _ = _axes(size)
    return (abs(x) - 0.4) ** 2 + y**2 + z**2 < 0.18


def drifting(size: int, step: int = 0) -> Array:
    """Return one step of a warm bubble that rises in air which gets warmer."""
    z, y, x, _ = _axes(size)
    away = x * x + y * y + (z + 0.5 - 0.3 * step) ** 2
    return (280 + 4 * step + (10 + 2 * step) * np.exp(-away / 0.1)).astype(np.float32)


@dataclass(frozen=True)
class Kind:
    """A kind of data.

    Attributes
    ----------
    make
        Returns samples [k, j, i]; its argument is the number of samples along an edge.
    subject
        What a reader should see.
    missing
        Some samples are NaN.
    steps
        Number of time steps; `make` takes theirs as a second argument.
    """

    make: Callable[..., Array]
    subject: str
    missing: bool = False
    steps: int = 1

    @property
    def options(self) -> dict[str, Any]:
        """Options without which the samples are refused."""
        return {"nan": "skip"} if self.missing else {}

    def line(self, name: str) -> str:
        """Return the line of Python."""
        if self.steps > 1:
            return f"ss.animate([{name}0, {name}1, …])"
        return f'ss.render({name}, nan="skip")' if self.missing else f"ss.render({name})"

    def command(self, name: str) -> str:
        """Return the command line."""
        if self.steps > 1:
            return f"sheetsplat animate {name}*.npy -o {name}.webp"
        return f"sheetsplat render {name}.npy {'--nan skip ' * self.missing}-o {name}.png"


#: The kinds by the names of their rows.
KINDS: Mapping[str, Kind] = {
    "kelvin": Kind(kelvin, "a hot spot of 300 K in air of 280 K"),
    "pascals": Kind(pascals, "crests of sound in air"),
    "tomogram": Kind(tomogram, "a body in air, its spine brighter"),
    "padded": Kind(padded_tomogram, "the same body; neither air nor padding"),
    "decibels": Kind(decibels, "main beam and side lobes of an antenna"),
    "component": Kind(component, "a vortex ring, inflow and outflow in two colours"),
    "cut": Kind(cut_everywhere, "blobs of both signs, cut by the box"),
    "ocean": Kind(ocean, "warm and cold water over a sea floor", missing=True),
    "microscopy": Kind(microscopy, "rings of cells in three layers"),
    "layer": Kind(one_layer, "rings of cells"),
    "decades": Kind(decades, "clumps of a halo, as logarithm"),
    "counts": Kind(counts, "two crossing tracks"),
    "distance": Kind(signed_distance, "a torus"),
    "mask": Kind(mask, "two balls that touch"),
    "drifting": Kind(drifting, "a bubble that rises while air gets warmer", steps=4),
}


def off_interpolation(samples: Array, field: ss.RegularField, count: int = 10_000) -> float:
    """Return the root of the mean square between a field and the cubic spline through its samples, in their range.

    The places are random ones between the samples, at least two of which lie along each axis; the spline is mirrored at
    the outermost samples. NaN where a sample is.
    """
    from scipy import ndimage  # type: ignore[import-untyped]

    values = samples.astype(np.float64)
    if not np.isfinite(values).all():
        return math.nan
    places = np.random.default_rng(17).uniform(0.0, 1.0, (count, 3)) * (np.array(values.shape) - 1)
    exact = ndimage.map_coordinates(values, places.T, order=3, mode="mirror")
    world = places[:, ::-1] * field.spacing + field.origin
    return float(np.sqrt(np.mean((field.at(world) - exact) ** 2)) / np.ptp(values))
