"""Isosurfaces without limits of their own: their colours."""

from __future__ import annotations

import math
from collections.abc import Sequence

from sheetsplat._checks import Triple, triple
from sheetsplat.fields import Field
from sheetsplat.options.scene import IsoValue
from sheetsplat.scene import Scene

# Place in the colormap of a surface without given limits: bright enough also in maps that begin dark.
SURFACE_SHARE = 0.7


def surface_limits(fields: Sequence[Field], iso_value: IsoValue) -> tuple[float, float] | None:
    """Return limits as wide as the values that give a surface a colour from the upper part of a map.

    Of several surfaces the outermost two have the colours of the ends.
    """
    if isinstance(iso_value, Sequence):
        values = [value for value, _ in iso_value]
        if min(values) < max(values):
            return min(values), max(values)
        iso_value = values[0]
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
    surfaces = []
    for value, opacity in scene.surfaces:
        red, green, blue = (round(255 * min(max(part, 0.0), 1.0)) for part in surface_color(scene, value))
        faint = f", opacity {opacity:g}" if opacity < 1.0 else ""
        surfaces.append(f"isosurface at {value:g}, colour #{red:02x}{green:02x}{blue:02x}{faint}")
    return "; ".join(surfaces)


def surface_color(scene: Scene, value: float) -> Triple:
    """Return red, green, blue of a surface of a scene's first fields before it is lit."""
    return triple("colour", scene.transfer_function.at(value)[:3])
