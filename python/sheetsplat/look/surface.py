"""Isosurfaces without limits of their own: their colours."""

from __future__ import annotations

import math
from collections.abc import Sequence

from sheetsplat._checks import Triple, triple
from sheetsplat.fields import Field
from sheetsplat.scene import Scene

# Place in the colormap of a surface without given limits: bright enough also in maps that begin dark.
SURFACE_SHARE = 0.7


def surface_limits(fields: Sequence[Field], iso_value: float) -> tuple[float, float] | None:
    """Return limits as wide as the values that give a surface a colour from the upper part of a map."""
    ranges = [one.value_range for one in fields if one.size]
    width = sum(high - low for low, high in ranges)
    if not math.isfinite(iso_value):
        return None
    if not width > 1e-6 * abs(iso_value):
        width = max(abs(iso_value), 1.0) * 1e-3
    limits = iso_value - SURFACE_SHARE * width, iso_value + (1.0 - SURFACE_SHARE) * width
    return limits if math.isfinite(limits[1] - limits[0]) else None


def surface_text(scene: Scene) -> str:
    """Return in words which iso value and which colour a scene's surface has."""
    assert scene.iso_value is not None
    red, green, blue = (round(255 * min(max(part, 0.0), 1.0)) for part in surface_color(scene))
    return f"isosurface at {scene.iso_value:g}, colour #{red:02x}{green:02x}{blue:02x}"


def surface_color(scene: Scene) -> Triple:
    """Return red, green, blue of a scene's surface before it is lit."""
    return triple("colour", scene.transfer_function.at(scene.iso_value or 0.0)[:3])
