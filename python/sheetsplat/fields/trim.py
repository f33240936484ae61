"""What a picture leaves out of the data, so that everything else can be seen."""

from __future__ import annotations

from dataclasses import dataclass


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
