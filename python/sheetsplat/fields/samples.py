"""What a look asks of samples, wherever they are: in an array, or in files and other processes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Samples of a volume that are looked at.
_MOST = 400_000


def grid_steps(shape: tuple[int, ...], lattice: str) -> list[int]:
    """Return of how many samples along each axis one is looked at."""
    step = max(1, math.ceil((math.prod(shape) / _MOST) ** (1 / 3)))
    steps = [min(step, size) for size in shape]
    if lattice == "bcc":
        # Every second layer is shifted.
        steps[0] |= 1
    return steps


class Samples(Protocol):
    """Samples of a field, [k, j, i] of a volume.

    Attributes
    ----------
    shape, dtype
        As those of an array.
    """

    @property
    def shape(self) -> tuple[int, ...]:
        """Number along each axis."""

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type in which the field keeps them."""

    @property
    def size(self) -> int:
        """Number of samples, NaN included."""

    @property
    def missing(self) -> int:
        """Number of NaN."""

    def every(self, stride: int) -> NDArray[Any]:
        """Return every n-th sample, counted along the last axis first, (N,)."""

    @property
    def steps(self) -> Sequence[int]:
        """Of how many samples along each axis one is looked at for what lies where."""

    def on_grid(self, steps: Sequence[int]) -> NDArray[Any]:
        """Return every n-th sample along each axis."""

    def beyond(self, limit: float, *, above: bool) -> NDArray[np.int64]:
        """Return the numbers, as `every` counts them, of the samples above a limit, or below it."""

    def within(self, most: float) -> tuple[int, float, float]:
        """Return number, smallest and largest of the samples whose magnitude is less than `most`."""

    def number(self, at: int) -> float:
        """Return one sample by its number."""

    def roughness(self, starts: Sequence[int], apart: int, values: tuple[float, float]) -> tuple[float, float]:
        """Return the mean square of second differences along all three axes at once, and the variance of the samples.

        Both in the same unit, and not for samples of which any is NaN.

        Parameters
        ----------
        starts
            Layers k: those at k, k + apart and k + 2 apart are differenced, and the variance is that of the middle one.
        apart
            Distance of neighbours along k.
        values
            The smallest and the largest sample.
        """


class ArraySamples:
    """The samples of an array."""

    __slots__ = ("lattice", "values")

    def __init__(self, values: NDArray[Any], lattice: str = "cartesian") -> None:
        self.values, self.lattice = values, lattice

    @property
    def shape(self) -> tuple[int, ...]:
        """Number along each axis."""
        return self.values.shape

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the array."""
        return self.values.dtype

    @property
    def size(self) -> int:
        """Number of samples."""
        return self.values.size

    @property
    def missing(self) -> int:
        """Number of NaN."""
        return int(np.isnan(self.values).sum()) if self.values.dtype.kind == "f" else 0

    def every(self, stride: int) -> NDArray[Any]:
        """Return every n-th sample."""
        if stride == 1 or self.values.flags.c_contiguous:
            return self.values.reshape(-1)[::stride]
        # Rows with gaps between them: without a copy of all.
        picked: NDArray[Any] = self.values.flat[::stride]
        return picked

    @property
    def steps(self) -> Sequence[int]:
        """Of how many samples along each axis one is looked at."""
        return grid_steps(self.shape, self.lattice)

    def on_grid(self, steps: Sequence[int]) -> NDArray[Any]:
        """Return every n-th sample along each axis."""
        return self.values[tuple(slice(None, None, step) for step in steps)]

    def beyond(self, limit: float, *, above: bool) -> NDArray[np.int64]:
        """Return the numbers of samples beyond a limit."""
        return np.flatnonzero(self.values > limit if above else self.values < limit)

    def within(self, most: float) -> tuple[int, float, float]:
        """Return number, smallest and largest of the samples of smaller magnitude."""
        usual = self.values[np.abs(self.values) < most]
        return usual.size, float(usual.min()), float(usual.max())

    def number(self, at: int) -> float:
        """Return one sample by its number."""
        return float(self.values[np.unravel_index(at, self.values.shape)])

    def roughness(self, starts: Sequence[int], apart: int, values: tuple[float, float]) -> tuple[float, float]:
        """Return the mean square of second differences, and the variance."""
        low, high = values
        # Differences of the largest numbers must not overflow, nor the squares of the smallest vanish.
        middle, width = 0.5 * low + 0.5 * high, 0.5 * high - 0.5 * low
        mixed_squares = squares = mean = 0.0
        for k in starts:
            around = [(self.values[k + n * apart].astype(np.float64) - middle) / width for n in range(3)]
            mixed_squares += float(np.mean(mixed_differences(around) ** 2)) / len(starts)
            squares += float(np.mean(around[1] ** 2)) / len(starts)
            mean += float(np.mean(around[1])) / len(starts)
        return mixed_squares, squares - mean**2


def mixed_differences(layers: Sequence[Floats]) -> Floats:
    """Return second differences along all three axes at once of three layers, (nj - 2, ni - 2)."""
    mixed = layers[0] - 2.0 * layers[1] + layers[2]
    mixed = mixed[:-2] - 2.0 * mixed[1:-1] + mixed[2:]
    return mixed[:, :-2] - 2.0 * mixed[:, 1:-1] + mixed[:, 2:]


def samples_of(samples: NDArray[Any] | Samples) -> Samples:
    """Return an array as samples; samples as they are."""
    return ArraySamples(samples) if isinstance(samples, np.ndarray) else samples
