"""The bricks that a process keeps: what was read once stays while it fits.

Pictures use the same bricks one after the other. Where they do not all fit, dropping the one that was used longest ago
would drop each just before it is used again; so what the last picture used stays, and what does not fit is read again.
"""

from __future__ import annotations

import threading
import weakref
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat.bricks.kernel_source import KernelSource
from sheetsplat.bricks.lattice import Box, holds, slices
from sheetsplat.bricks.sources import BrickSource
from sheetsplat.fields import EllipsoidField, RegularField
from sheetsplat.renderer import Renderer

# Of the memory of a process, the share that bricks take; drawing them takes about as much again.
_SHARE = 0.4
# Kernels are read so many times as far around a brick as a picture needs.
_WIDER = 1.25


@dataclass
class Counts:
    """What a process did with bricks since it began.

    Attributes
    ----------
    reads, bytes_read
        How often samples were read from where they are, and how much.
    drawn, coarse
        How many pictures of bricks were drawn, and how many of them with a coarser level.
    hits
        How often they were here.
    dropped
        How many bricks had to go.
    """

    reads: int = 0
    bytes_read: int = 0
    drawn: int = 0
    coarse: int = 0
    hits: int = 0
    dropped: int = 0

    def of_picture(self) -> NDArray[np.int64]:
        """Return what pictures tell of: reads, bytes read, drawn, coarse."""
        return np.array([self.reads, self.bytes_read, self.drawn, self.coarse])


@dataclass
class _Entry:
    """Samples around a brick, and the field of them; or, without samples, the kernels closer to it than `outer`.

    A field without coefficients keeps samples of its own: where memory is short these are the entry's then.
    """

    outer: Any
    values: NDArray[Any]
    made: Any = None
    wanted: Box | None = None
    key: Any = None
    is_shared: bool = False
    picture: int = 0

    @property
    def size(self) -> int:
        made = 0 if self.made is None else int(self.made.memory + getattr(self.made, "memory_of_parts", 0))
        return made + (0 if self.is_shared else self.values.nbytes)

    def shrink(self) -> None:
        """Keep no more samples than the field has, where it has all that it was made of, and no mirrored ones."""
        if self.made is None or self.wanted is None or self.made.prefilter:
            return
        if self.made.shape == tuple(last - first for first, last in self.wanted):
            self.outer, self.values, self.is_shared = self.wanted, self.made.values, True


class Residents:
    """Samples or kernels of bricks, and the fields made of them, within a budget of memory.

    Threads may share it: one reads at a time.

    Parameters
    ----------
    budget
        Bytes. A brick that is larger is not kept.
    """

    def __init__(self, budget: int) -> None:
        self.budget = budget
        self.counts = Counts()
        # The least recently used first.
        self._entries: OrderedDict[Any, _Entry] = OrderedDict()
        self._picture: weakref.ref[Any] = weakref.ref(self)
        self._number = 0
        self._lock = threading.RLock()

    def begin(self, picture: Any) -> None:
        """Tell for which picture, an object of its own, bricks are asked from now on."""
        with self._lock:
            if self._picture() is not picture:
                self._picture, self._number = weakref.ref(picture), self._number + 1

    @property
    def size(self) -> int:
        """Bytes that are kept."""
        with self._lock:
            return sum(one.size for one in self._entries.values())

    def samples(self, source: BrickSource, core: Box, wanted: Box) -> NDArray[Any]:
        """Return samples of a box around a brick; they are read where they are not here.

        Parameters
        ----------
        source
            The volume.
        core
            The brick.
        wanted
            The box, which holds the brick.

        Raises
        ------
        Error
            What `BrickSource.read` raises.
        """
        with self._lock:
            return _cut(self._entry(source, core, wanted), wanted)

    def made(
        self, source: BrickSource, core: Box, wanted: Box, key: Any, make: Callable[[NDArray[Any]], RegularField]
    ) -> RegularField:
        """Return the field that a function makes of the samples of a box: once with the same key, while it fits."""
        with self._lock:
            entry = self._entry(source, core, wanted)
            found: RegularField | None = entry.made
            if found is None or (entry.wanted, entry.key) != (wanted, key):
                entry.made = None
                found = make(_cut(entry, wanted))
                entry.made, entry.wanted, entry.key, entry.is_shared = found, wanted, key, False
                if wanted == entry.outer:
                    entry.shrink()
                self._fit()
            return found

    def kept(self, source: BrickSource, core: Box, holds: Callable[[Any], bool]) -> RegularField | None:
        """Return the field that was made last of a brick, where its key is good enough; None: there is none."""
        with self._lock:
            key = (source.key, core)
            entry = self._entries.get(key)
            if entry is None or entry.made is None or not holds(entry.key):
                return None
            self._use(key, entry)
            found: RegularField = entry.made
            return found

    def kernels(
        self, source: KernelSource, number: int, margin: float, value_range: tuple[float, float]
    ) -> EllipsoidField:
        """Return the field of the kernels that reach closer to a brick than `margin`; they are read where not here.

        Raises
        ------
        Error
            What `KernelSource.read` raises.
        """
        with self._lock:
            key = (source.key, number)
            entry = self._entries.get(key)
            if entry is not None and entry.outer >= margin and entry.key == value_range:
                self._use(key, entry)
                found: EllipsoidField = entry.made
                return found
            self._entries.pop(key, None)
            # Other views need a little more.
            wider = _WIDER * margin
            made, count = source.read(number, wider, value_range)
            self.counts.reads += 1
            self.counts.bytes_read += count
            self._entries[key] = _Entry(wider, np.empty(0), made, key=value_range, picture=self._number)
            self._fit()
            return made

    def _entry(self, source: BrickSource, core: Box, wanted: Box) -> _Entry:
        key = (source.key, core)
        entry = self._entries.get(key)
        if entry is not None and holds(entry.outer, wanted):
            self._use(key, entry)
            return entry
        outer = wanted if entry is None else _around(entry.outer, wanted)
        self._entries.pop(key, None)
        entry = _Entry(outer, source.read(outer), picture=self._number)
        self.counts.reads += 1
        self.counts.bytes_read += entry.values.nbytes
        self._entries[key] = entry
        self._fit()
        return entry

    def _use(self, key: Any, entry: _Entry) -> None:
        self._entries.move_to_end(key)
        entry.picture = self._number
        self.counts.hits += 1

    def _fit(self) -> None:
        """Make all fit: drop what only other views would need, then bricks.

        First the least used of those that neither this picture nor the last one used, then what was used last.
        """
        size = sum(one.size for one in self._entries.values())
        for one in self._entries.values():
            if size <= self.budget:
                return
            size -= one.size
            one.shrink()
            size += one.size
        while self._entries and size > self.budget:
            # The least used is the first one.
            oldest = next(iter(self._entries.values()))
            _, gone = self._entries.popitem(last=oldest.picture >= self._number - 1)
            size -= gone.size
            self.counts.dropped += 1

    def clear(self) -> None:
        """Drop everything."""
        with self._lock:
            self._entries.clear()


def _around(first: Box, second: Box) -> Box:
    k, j, i = ((min(a, c), max(b, d)) for (a, b), (c, d) in zip(first, second, strict=True))
    return k, j, i


def _cut(entry: _Entry, wanted: Box) -> NDArray[Any]:
    if wanted == entry.outer:
        return entry.values
    return np.ascontiguousarray(entry.values[slices(wanted, entry.outer)])


_here: list[Residents] = []


def residents() -> Residents:
    """Return the bricks of this process, made at the first call with a share of the memory that is left."""
    if not _here:
        _here.append(Residents(int(_SHARE * memory_limit())))
    return _here[0]


@lru_cache(maxsize=8)
def _renderer(settings: tuple[tuple[str, Any], ...], _: str) -> Renderer:
    plain: dict[str, Any] = {name: dict(value) if name == "effects" else value for name, value in settings}
    return Renderer(**plain)


def renderer_of(settings: Mapping[str, Any], of: str = "bricks") -> Any:
    """Return the native renderer of this process with some settings.

    It keeps what it found of bricks, or of wholes, for the next picture of the same field.
    """
    pairs = tuple(
        (name, tuple(sorted(value.items())) if isinstance(value, Mapping) else value)
        for name, value in settings.items()
    )
    return _renderer(pairs, of).native


def forget_renderers() -> None:
    """Forget the renderers of this process, and what they found; tasks that draw keep theirs to their end."""
    _renderer.cache_clear()


def memory_limit() -> int:
    """Return how much more memory this process may take: as a worker of dask of what it was given."""
    there = _memory.available()
    try:
        from distributed import get_worker  # type: ignore[import-not-found, import-untyped, unused-ignore]

        worker = get_worker()
        limit = worker.memory_manager.memory_limit
        return min(max(int(limit) - worker.monitor.get_process_memory(), 0), there) if limit else there
    except (ImportError, ValueError, AttributeError):
        return there
