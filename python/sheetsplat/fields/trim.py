"""What a picture leaves out of the data, so that everything else can be seen."""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass

from sheetsplat._checks import pair, shown
from sheetsplat.errors import complain, unusable


@dataclass(frozen=True)
class Trim:
    """What `sheetsplat.render` left out of a field.

    Attributes
    ----------
    kernels
        Numbers of scattered kernels that are left out, in rising order: those of the data.
    limits
        Values beyond these two are drawn as these two; None: every value is drawn as it is.
    """

    kernels: tuple[int, ...] = ()
    limits: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Check: numbers that rise from 0 on, and limits that do not fall, or InvalidInput."""
        at = self.kernels if isinstance(self.kernels, tuple) else (None,)
        if not all(type(one) is int for one in at) or not all(map(operator.lt, (-1, *at), at)):
            raise complain(unusable("Trim: kernels"), shown(self.kernels), "whole numbers that rise")
        if self.limits is not None:
            low, high = pair("Trim: limits", self.limits)
            if not -math.inf < low <= high < math.inf:
                raise complain(unusable("Trim: limits"), shown(self.limits), "two numbers that do not fall, or None")
            object.__setattr__(self, "limits", (low, high))

    def __bool__(self) -> bool:
        """Return whether anything is left out."""
        return bool(self.kernels) or self.limits is not None

    def number_in_data(self, kernel: int) -> int:
        """Return the number that a kernel of the trimmed field has in the data; negative ones, no kernel, stay."""
        if kernel >= 0:
            for left_out in self.kernels:
                if left_out > kernel:
                    break
                kernel += 1
        return kernel
