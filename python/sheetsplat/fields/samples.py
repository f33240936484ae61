"""What a look asks of samples, wherever they are: in an array, or in files and other processes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


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

    __slots__ = ("values",)

    def __init__(self, values: NDArray[Any]) -> None:
        self.values = values

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
        return self.values.reshape(-1)[::stride]

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
        return float(self.values.reshape(-1)[at])

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
