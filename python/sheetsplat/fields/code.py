"""What a field of ellipsoids is stored as, and how far it is from the data that it stands for."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple


class Bound(NamedTuple):
    """Distances of a field from the data that it was encoded from.

    Attributes
    ----------
    max
        Bound of |scalar - data| at every sample, units of the data.
    rms
        Root mean square of that over all samples.
    percentiles
        |scalar - data| that 50, 90, 99 and 99.9 % of the samples do not exceed; empty for a coarser field that was
        read from the first bytes of a file.
    value_range
        The least and the largest of the data.

    Examples
    --------
    >>> ss.fit.encode(np.random.default_rng(1).random((8, 8, 8)), max_error=0.2).bound.max <= 0.2
    True
    """

    max: float
    rms: float
    percentiles: tuple[float, ...] = ()
    value_range: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Code:
    """The bytes of a .ssk file, and the bound that they state."""

    data: bytes
    # (Files state it in float32.)
    bound: Bound = field(compare=False)
