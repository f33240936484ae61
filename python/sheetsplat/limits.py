"""Depth limits: where a surface that was drawn elsewhere hides what lies behind it. Conventions, section 10."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat._checks import numbers
from sheetsplat.errors import complain, unusable

if TYPE_CHECKING:
    from sheetsplat.camera import Camera

Depths = NDArray[np.float64]
# Points so many slice distances in front of a surface are at it.
_AT_THE_SURFACE = 1e-6


def checked_depths(depths: ArrayLike | None, camera: Camera, size: tuple[int, int]) -> Depths | None:
    """Return the depths of a surface as float64 (h, w), or None without one.

    Parameters
    ----------
    depths
        One for each pixel, row 0 at the top: world units from the eye along the view direction; infinite, or masked,
        where there is no surface. One number counts for all pixels.
    camera, size
        Of the picture.

    Raises
    ------
    InvalidInput
        For another shape, NaN, minus infinity, and for depths behind the eye of a perspective camera.
    """
    if depths is None:
        return None
    width, height = size
    wanted = f"depths of shape ({height}, {width}), one for each pixel of the picture"
    given: Any = depths
    if isinstance(given, np.ma.MaskedArray) and given.dtype.kind in "iuf":
        given = np.ma.filled(given.astype(np.float64), np.inf)
    found = numbers("Renderer: depth_limit", given, wanted)
    failed = unusable("Renderer: depth_limit")
    if found.ndim == 0:
        found = np.broadcast_to(found, (height, width))
    if found.shape != (height, width):
        advice = "size is (width, height), and arrays are (height, width)" if found.shape == (width, height) else ""
        raise complain(failed, f"an array of shape {found.shape}", wanted, advice, option="depth_limit")
    missing = int(np.isnan(found).sum())
    if missing:
        raise complain(
            failed,
            f"NaN at {missing} pixels",
            wanted,
            "pass infinity where there is no surface: numpy.nan_to_num(depths, nan=numpy.inf)",
            option="depth_limit",
        )
    nearest = float(found.min())
    if nearest == -np.inf or (nearest < 0 and camera.kind == "perspective"):
        raise complain(
            failed,
            f"the depth {nearest:g}",
            "world units from the eye along the view direction, at least 0 with a perspective camera",
            "where depths are counted as negative z, pass -depths",
            option="depth_limit",
        )
    result = np.array(found, dtype=np.float64, order="C")
    result.setflags(write=False)
    return result


def in_front(surface: float, slices: Depths, spacing: float) -> NDArray[np.bool_]:
    """Return which of the slices of a pixel, given by their depths, lie in front of a surface, given by its depth."""
    kept: NDArray[np.bool_] = slices < surface - _AT_THE_SURFACE * spacing
    return kept
