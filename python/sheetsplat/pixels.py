"""From what was rendered to what a screen shows: straight alpha, 0 to 1 or 0 to 255."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat.scalar_colors import ScalarColors

#: Behind pictures without a background, where a format or a figure has no transparency.
WHITE = (1.0, 1.0, 1.0)
# Rows are converted in float64, as many at a time as have so many numbers: few enough for the nearest cache.
_AT_ONCE = 1 << 14


def straight(picture: NDArray[np.float32], colors: ScalarColors, limits: tuple[float, float]) -> NDArray[np.float32]:
    """Return straight r, g, b, alpha, 0 to 1, float32 (h, w, 4), of premultiplied colours or of scalars."""
    made = np.empty((*picture.shape[:2], 4), np.float32)
    for rows, part in _parts(picture, colors, limits):
        made[rows] = part
    return made


def levels(picture: NDArray[np.float32], colors: ScalarColors, limits: tuple[float, float], most: int) -> NDArray[Any]:
    """Return the same as whole numbers from 0 to `most`, 255 or 65535, halves upwards."""
    made = np.empty((*picture.shape[:2], 4), np.uint8 if most == 255 else np.uint16)
    for rows, part in _parts(picture, colors, limits):
        part *= most
        part += 0.5
        # What is no less than 0 is cut off as `floor` does.
        made[rows] = part
    return made


def gray_levels(scalar: NDArray[np.float32], colors: ScalarColors, limits: tuple[float, float]) -> NDArray[np.uint8]:
    """Return scalars as levels of gray, uint8 (h, w), black and white at the limits."""
    return np.floor(colors.shares(scalar, limits) * 255 + 0.5).astype(np.uint8)


def over(levels: NDArray[np.uint8], background: tuple[float, float, float]) -> NDArray[np.uint8]:
    """Return r, g, b, uint8 (h, w, 3), of straight colours over an opaque background."""
    alpha = levels[..., 3:].astype(np.float32) / 255
    behind = np.clip(np.asarray(background, np.float32), 0, 1) * 255
    return np.floor(levels[..., :3] * alpha + behind * (1 - alpha) + 0.5).astype(np.uint8)


def _parts(
    picture: NDArray[np.float32], colors: ScalarColors, limits: tuple[float, float]
) -> Iterator[tuple[slice, NDArray[np.float64]]]:
    step = max(1, _AT_ONCE // (4 * picture.shape[1]))
    for start in range(0, picture.shape[0], step):
        rows = slice(start, start + step)
        part = picture[rows]
        yield rows, colors.colors(part, limits) if part.ndim == 2 else _straight_colors(part)


def _straight_colors(part: NDArray[np.float32]) -> NDArray[np.float64]:
    found = part.astype(np.float64)
    alpha = found[..., 3]
    # Where there is no opacity there is no colour: anything finite becomes 0, anything else NaN.
    divisor = np.where(alpha > 0, alpha, np.inf)
    with np.errstate(invalid="ignore"):
        for channel in range(3):
            found[..., channel] /= divisor
    # NaN becomes 0.
    np.fmax(found, 0.0, out=found)
    return np.minimum(found, 1.0, out=found)
