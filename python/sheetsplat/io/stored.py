"""Samples of a file that are read when they are asked for, by their positions.

Not through a memory map: when another program shortens a mapped file, the next access ends the process (SIGBUS).
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from sheetsplat.errors import Error, complain

# Returns so many bytes of a file from a position on: fetch(position, count).
Fetch = Callable[[int, int], bytes]
# Most bytes that are fetched at once.
_MOST_BYTES = 1 << 26
# How many bytes can be read in the time that one more call of a local file takes.
_LOCAL_CALL = 1 << 15


def changed(path: Path | str) -> Error:
    """Return the error for a file that is not as it was when it was opened."""
    return complain(f"{path} cannot be read", "a file that was changed", "the file as it was opened", "open it again")


def fetch_of(file: int, path: Path) -> Fetch:
    """Return what fetches the bytes of an open file; InvalidInput where the file ends before them."""

    def fetch(position: int, count: int) -> bytes:
        pieces = []
        while count > 0:
            piece = os.pread(file, count, position)
            if not piece:
                raise changed(path)
            pieces.append(piece)
            position, count = position + len(piece), count - len(piece)
        return b"".join(pieces)

    return fetch


@dataclass(frozen=True)
class StoredSamples:
    """Where the samples of an array lie in a file. It is turned and cut like an array, and then read.

    Attributes
    ----------
    path
        The file.
    dtype, shape
        Of the array.
    first
        Position of the sample with index 0 along all axes, in bytes.
    strides
        Bytes from one sample to the next along each axis; below 0 where an axis is turned round.
    """

    path: Path
    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    first: int
    strides: tuple[int, ...]

    @classmethod
    def dense(cls, path: Path, dtype: np.dtype[Any], shape: Sequence[int], first: int = 0) -> StoredSamples:
        """Return samples that lie one after the other, the last axis the fastest."""
        strides = tuple(dtype.itemsize * math.prod(shape[axis + 1 :]) for axis in range(len(shape)))
        return cls(path, dtype, tuple(shape), first, strides)

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return len(self.shape)

    @property
    def size(self) -> int:
        """Number of samples."""
        return math.prod(self.shape)

    def reshape(self, shape: Sequence[int]) -> StoredSamples:
        """Return samples that lie one after the other as an array of another shape."""
        return self.dense(self.path, self.dtype, shape, self.first)

    def transpose(self, axes: Sequence[int]) -> StoredSamples:
        """Return the array with its axes in another order."""
        return replace(self, shape=tuple(self.shape[a] for a in axes), strides=tuple(self.strides[a] for a in axes))

    def __getitem__(self, cuts: tuple[slice, ...]) -> StoredSamples:
        """Return a part, one slice an axis; steps may be below 0."""
        ranges = [range(size)[cut] for size, cut in zip(self.shape, cuts, strict=True)]
        first = self.first + sum(r.start * stride for r, stride in zip(ranges, self.strides, strict=True) if len(r))
        strides = tuple(r.step * stride for r, stride in zip(ranges, self.strides, strict=True))
        return replace(self, shape=tuple(map(len, ranges)), first=first, strides=strides)

    def read(self, fetch: Fetch, call: int = _LOCAL_CALL) -> NDArray[Any]:
        """Return the samples; `call`: how many bytes can be read in the time that one more call of `fetch` takes."""
        found = np.empty(self.shape, self.dtype)
        if not found.size:
            return found
        # From here on no axis is turned round, and the slowest comes first.
        turned = tuple(slice(None, None, -1 if stride < 0 else 1) for stride in self.strides)
        order = sorted(range(self.ndim), key=lambda axis: -abs(self.strides[axis]))
        _Plan(self[turned].transpose(order), fetch, call).fill(found[turned].transpose(order))
        return found


@dataclass(frozen=True)
class LazySamples:
    """Samples of an array that something else reads by an index. It is turned and cut like an array, and then read.

    Attributes
    ----------
    fetch
        Returns a part of the array by an index: a number, or a slice with the step 1, for each of its dimensions.
    dtype
        Of the array.
    index
        For each of its dimensions a number, or which places are read, in steps of 1 or -1.
    order
        Which dimension runs along each axis of the samples; none stands for a number.
    """

    fetch: Callable[[tuple[int | slice, ...]], Any]
    dtype: np.dtype[Any]
    index: tuple[int | range, ...]
    order: tuple[int, ...]

    @classmethod
    def of(cls, fetch: Callable[[tuple[int | slice, ...]], Any], dtype: Any, shape: Sequence[int]) -> LazySamples:
        """Return all samples of an array."""
        return cls(fetch, np.dtype(dtype), tuple(range(int(size)) for size in shape), tuple(range(len(shape))))

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the samples."""
        return tuple(len(self._range(axis)) for axis in range(self.ndim))

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return len(self.order)

    @property
    def size(self) -> int:
        """Number of samples."""
        return math.prod(self.shape)

    def _range(self, axis: int) -> range:
        found = self.index[self.order[axis]]
        assert isinstance(found, range)
        return found

    def transpose(self, axes: Sequence[int]) -> LazySamples:
        """Return the array with its axes in another order."""
        return replace(self, order=tuple(self.order[axis] for axis in axes))

    def __getitem__(self, cuts: tuple[slice, ...]) -> LazySamples:
        """Return a part, one slice an axis, with the step 1 or -1."""
        index = list(self.index)
        for axis, cut in enumerate(cuts):
            index[self.order[axis]] = self._range(axis)[cut]
        return replace(self, index=tuple(index))

    def read(self) -> NDArray[Any]:
        """Return the samples."""
        cuts = tuple(
            one if isinstance(one, int) else slice(min(one), max(one) + 1) if one else slice(0, 0) for one in self.index
        )
        kept = [number for number, one in enumerate(self.index) if not isinstance(one, int)]
        found = np.asarray(self.fetch(cuts)).transpose([kept.index(number) for number in self.order])
        turned: NDArray[Any] = np.flip(found, tuple(axis for axis in range(self.ndim) if self._range(axis).step < 0))
        return turned


class _Plan:
    """Which parts of an array are fetched at once: those that take the least time."""

    def __init__(self, samples: StoredSamples, fetch: Fetch, call: int) -> None:
        self._samples, self._fetch = samples, fetch
        # Of each axis, how many of its steps are fetched at once; 0: the axes after it decide for each step.
        self._steps: list[int] = []
        # Bytes from the first to behind the last sample of the axes that follow, and the time that these take.
        span, time = samples.dtype.itemsize, call + samples.dtype.itemsize
        for count, stride in zip(reversed(samples.shape), reversed(samples.strides), strict=True):
            steps = max(1, min(count, (_MOST_BYTES - span) // max(stride, 1) + 1))
            together = math.ceil(count / steps) * (call + span) + count * stride
            apart = count * time
            # A single sample is fetched as a part of the last axis.
            self._steps.insert(0, steps if together <= apart else 0 if self._steps else 1)
            span, time = span + (count - 1) * stride, min(together, apart)

    def fill(self, found: NDArray[Any]) -> None:
        """Read all samples into an array."""
        self._fill(found, self._samples.first, 0)

    def _fill(self, found: NDArray[Any], position: int, axis: int) -> None:
        samples = self._samples
        stride, steps = samples.strides[axis], self._steps[axis]
        for step in range(0, samples.shape[axis], max(steps, 1)):
            if not steps:
                self._fill(found[step], position + step * stride, axis + 1)
                continue
            part = found[step : step + steps]
            strides = samples.strides[axis:]
            span = samples.dtype.itemsize + sum((n - 1) * s for n, s in zip(part.shape, strides, strict=True))
            sample = np.frombuffer(self._fetch(position + step * stride, span), samples.dtype, 1)
            part[...] = as_strided(sample, part.shape, strides, writeable=False)
