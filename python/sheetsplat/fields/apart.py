"""What volumes of labels and of colours are drawn by: a native field for each label, or each component."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory, _sheetsplat
from sheetsplat._checks import Bounds
from sheetsplat._properties import Forwarded
from sheetsplat.fields import labelled


class Apart:
    """What volumes have in common whose samples are drawn by several native fields, each of which is made once."""

    __slots__ = ()
    _colors: NDArray[Any] | None
    # By labels, by ("color", component), "found": which labels there are, and ("unseen", labels): which of these hide.
    _parts_made: dict[Any, Any]
    radius: Forwarded[float]
    falloff: Forwarded[float]

    if TYPE_CHECKING:

        @property
        def values(self) -> NDArray[Any]:
            """The samples."""

        @property
        def prefilter(self) -> bool:
            """Whether the kernels' sum passes through the samples."""

        @property
        def lattice(self) -> str:
            """The lattice of the samples."""

        @property
        def domain(self) -> Bounds | None:
            """Where the volume ends."""

        def _made(self, samples: NDArray[Any], **options: Any) -> _sheetsplat.RegularField: ...

        def _with(self, **changes: Any) -> Self: ...

    @property
    def labels_found(self) -> tuple[int, ...]:
        """The labels among the samples, from the least one on. InvalidInput for more than are told apart."""
        if "found" not in self._parts_made:
            self._parts_made["found"] = labelled.labels_in(self.values)
        found: tuple[int, ...] = self._parts_made["found"]
        return found

    def labels_unseen(self, shown: Iterable[int]) -> tuple[int, ...]:
        """Return which labels of those that are shown are nowhere the largest, and so not seen.

        Of a BCC lattice, and of a volume in bricks, none are told.
        """
        if self.lattice != "cartesian" or self.values.size == 0:
            return ()
        wanted = tuple(sorted(set(shown) & set(self.labels_found)))
        key = "unseen", wanted
        if key not in self._parts_made:
            mirrored = self.domain is not None
            self._parts_made[key] = labelled.nowhere_largest(
                self.values, wanted, self.radius, self.falloff, mirrored=mirrored
            )
        found: tuple[int, ...] = self._parts_made[key]
        return found

    def part_of_label(self, label: int) -> _sheetsplat.RegularField:
        """Return the native field that is 1 at the samples of a label and 0 elsewhere, made once.

        Raises
        ------
        OutOfMemory
            Where it does not fit.
        """
        if label not in self._parts_made:
            _memory.require(2 * self.values.size, f"the volume of label {label}")
            samples = (self.values == label).astype(np.uint8)
            # A part of a volume may have none of the two.
            self._parts_made[label] = self._made(samples, base=0.0, value_range=(0.0, 1.0))
        made: _sheetsplat.RegularField = self._parts_made[label]
        return made

    def field_of_label(self, label: int) -> Self:
        """Return the field that is 1 at the samples of a label and 0 elsewhere. OutOfMemory where it does not fit."""
        return self._with(native=self.part_of_label(label), _labels=False, _base=0.0, _parts_made={})

    @property
    def colored(self) -> bool:
        """Whether samples are colours: `values` are then how opaque they are."""
        return self._colors is not None

    @property
    def full_color(self) -> float:
        """What full red, green and blue are in `part_of_color`."""
        assert self._colors is not None
        return 1.0 if self._colors.dtype.kind == "f" else float(np.iinfo(self._colors.dtype).max)

    def part_of_color(self, channel: int) -> _sheetsplat.RegularField:
        """Return the native field of red, green or blue, 0 to 2, made once. OutOfMemory where it does not fit."""
        assert self._colors is not None
        key = "color", channel
        if key not in self._parts_made:
            samples = np.ascontiguousarray(self._colors[..., channel])
            self._parts_made[key] = self._made(samples, prefilter=self.prefilter, base=0.0)
        made: _sheetsplat.RegularField = self._parts_made[key]
        return made

    @property
    def memory_of_parts(self) -> int:
        """Bytes that these native fields keep, as far as they were made."""
        return sum(one.memory for one in self._parts_made.values() if isinstance(one, _sheetsplat.RegularField))
