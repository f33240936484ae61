"""Colours of scalar pictures. Conventions, section 7 (Modes)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import truth
from sheetsplat.transfer import Colormap, color_limits, color_rows

# Limits leave out numbers beyond these percentiles of those other than 0 where they widen the range so many times: a
# few hot samples.
_OUTLIERS = 0.5
_APART = 100.0
# Limits of a logarithmic scale leave out this share of the positive numbers, and go over so many decades at most.
_FAINT_PERCENTILE = 1.0
_DECADES = 6.0


@dataclass(frozen=True)
class ScalarColors:
    """How the numbers of a scalar picture become colours: a colormap over limits. Conventions, section 7 (Modes).

    Where there is no number (NaN), as outside of the data, the picture is transparent.

    Parameters
    ----------
    cmap
        As for `TransferFunction.from_colormap`; kept as a name, or as a tuple of rows r, g, b, opacity.
    clim
        The two numbers at which the colormap begins and ends; by the picture unless given: from its smallest number to
        its largest, and to 0 where that is nearer to them than they are wide or the mode integrates, without outliers:
        at most 1/200 of the numbers on a side, a hundred times as far away as the others.
    log
        Spread the colours over the logarithm. Numbers of 0 and below have the first colour. Unless given, `clim` then
        goes from the first percentile of the positive numbers to the largest, over six decades at most.

    Raises
    ------
    InvalidInput
        For unknown colormaps, and for limits that do not rise, or are not above 0 for a logarithm.

    Examples
    --------
    >>> colors = ss.ScalarColors("inferno", (0, 4))
    >>> ss.render(values, mode="xray", scalar_colors=colors, size=(32, 32)).clim
    (0.0, 4.0)
    """

    cmap: Colormap = "gray"
    clim: Sequence[float] | None = None
    log: bool = False

    def __post_init__(self) -> None:
        """Check and convert."""
        rows = color_rows(self.cmap)
        if not isinstance(self.cmap, str):
            object.__setattr__(self, "cmap", tuple(map(tuple, rows.tolist())))
        object.__setattr__(self, "log", truth("ScalarColors: log", self.log))
        if self.clim is not None:
            object.__setattr__(self, "clim", color_limits(self.clim, positive=self.log))

    @property
    def table(self) -> NDArray[np.float64]:
        """The colours at equal distances over the limits, rows r, g, b, opacity."""
        return color_rows(self.cmap)

    @property
    def is_gray(self) -> bool:
        """Whether every colour is opaque and gray, black where it begins and white where it ends, linear between."""
        rows = self.table
        ramp = np.linspace(0.0, 1.0, len(rows))[:, None]
        return bool((rows[:, 3] == 1).all() and np.abs(rows[:, :3] - ramp).max() < 1e-6)

    def limits(self, scalar: NDArray[np.floating[Any]], *, from_zero: bool = False) -> tuple[float, float]:
        """Return `clim`, or the limits that the numbers of a picture give; `from_zero`: with 0 among them."""
        if self.clim is not None:
            return float(self.clim[0]), float(self.clim[1])
        known = scalar[np.isfinite(scalar)]
        if not self.log:
            if not known.any():
                return 0.0, 1.0
            low, high = float(known.min()), float(known.max())
            first, last = np.percentile(known[known != 0], (_OUTLIERS, 100.0 - _OUTLIERS)).tolist()
            width = last - first or high - low
            if from_zero or not width or low <= 0.0 <= high or min(abs(first), abs(last)) <= width:
                low, high, first, last = min(low, 0.0), max(high, 0.0), min(first, 0.0), max(last, 0.0)
            width = last - first
            if width > 0.0:
                low = first if first - low > _APART * width else low
                high = last if high - last > _APART * width else high
            return low, high
        known = known[known > 0]
        if not known.size:
            return 0.1, 1.0
        high = float(known.max())
        low = max(float(np.percentile(known, _FAINT_PERCENTILE)), high * 10.0**-_DECADES)
        return (low, high) if low < high else (0.5 * high, high)

    def shares(self, scalar: NDArray[np.floating[Any]], limits: tuple[float, float]) -> NDArray[np.float64]:
        """Return where numbers lie between limits, 0 to 1; 0 for NaN."""
        low, high = limits
        known = np.nan_to_num(scalar.astype(np.float64), nan=low, posinf=high, neginf=low)
        if not self.log:
            return np.clip((known - low) / (high - low), 0.0, 1.0)
        raised = np.log(np.maximum(known, low)) - math.log(low)
        return np.clip(raised / (math.log(high) - math.log(low)), 0.0, 1.0)

    def colors(self, scalar: NDArray[np.floating[Any]], limits: tuple[float, float]) -> NDArray[np.float64]:
        """Return straight r, g, b, opacity of numbers, one more axis of 4; all 0 for NaN."""
        rows = self.table
        at = np.linspace(0.0, 1.0, len(rows))
        shares = self.shares(scalar, limits)
        found = np.stack([np.interp(shares, at, column) for column in rows.T], axis=-1)
        found[np.isnan(scalar)] = 0.0
        return found
