"""Random numbers that are the same on every machine and with every version of NumPy.

NumPy promises the stream of its generators only within a version; a data set that is to be exact needs more. Each
number here is a hash of a seed and a counter: SplitMix64's finaliser (Steele, Lea & Flood 2014), in whole-number
arithmetic.
"""

from __future__ import annotations

import operator

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import shown
from sheetsplat.errors import complain

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST = np.uint64(0xBF58476D1CE4E5B9)
_SECOND = np.uint64(0x94D049BB133111EB)


def _mix(state: NDArray[np.uint64]) -> NDArray[np.uint64]:
    state = (state ^ (state >> np.uint64(30))) * _FIRST
    state = (state ^ (state >> np.uint64(27))) * _SECOND
    return state ^ (state >> np.uint64(31))


class Stream:
    """Uniform and normal numbers, counted from a seed.

    Parameters
    ----------
    seed
        Any whole number; its lowest 64 bits count.
    """

    def __init__(self, seed: int) -> None:
        # The seed is hashed first, so that neighbouring seeds give unrelated numbers.
        try:
            lowest = operator.index(seed) & 0xFFFFFFFFFFFFFFFF
        except Exception:  # Objects of others raise whatever they like.
            raise complain("the seed cannot be used", shown(seed), "a whole number") from None
        start = np.array([lowest], dtype=np.uint64)
        self._state = _mix(start + _GOLDEN)
        self._drawn = 0

    def uniform(self, *shape: int) -> NDArray[np.float64]:
        """Numbers in [0, 1), multiples of 2**-53."""
        count = int(np.prod(shape, dtype=np.int64))
        counter = np.arange(self._drawn + 1, self._drawn + count + 1, dtype=np.uint64)
        self._drawn += count
        bits = _mix(self._state + counter * _GOLDEN)
        return ((bits >> np.uint64(11)).astype(np.float64) * 2.0**-53).reshape(shape)

    def normal(self, *shape: int) -> NDArray[np.float64]:
        """Numbers of mean 0 and variance 1 (Box & Muller 1958)."""
        radius = np.sqrt(-2.0 * np.log1p(-self.uniform(*shape)))
        return np.asarray(radius * np.cos(2.0 * np.pi * self.uniform(*shape)))
