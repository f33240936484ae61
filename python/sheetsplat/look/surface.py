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
# Places of the lowest and the highest of several surfaces: no end of a map, which may be black or white. Near the ends
# of the range the lowest gives way down to the second number.
_SEVERAL = (0.3, 0.95)
_LEAST_SHARE = 0.15
# Surfaces that are told one by one.
_TOLD = 4
# Least width of such limits as a share of the range of values: narrower ones cannot be told apart on a colour bar.
_NARROWEST = 0.05


def surface_limits(fields: Sequence[Field], iso_value: IsoValue) -> tuple[float, float] | None:
    """Return limits inside the range of the values that give a surface a colour from the upper part of a map.

    They are the widest with the surface at `SURFACE_SHARE` of the map, so that one of them is an end of the range. Near
    the ends of the range, where these would be very narrow, the surface's colour gives way. Of several surfaces the
    lowest is at 3/10 of the map, the highest at 19/20, or somewhat lower where the range ends there.
    """
    if isinstance(iso_value, Sequence):
        values = [value for value, _ in iso_value]
        if min(values) < max(values):
            return _limits_of_several(fields, min(values), max(values))
        iso_value = values[0]
    if not math.isfinite(iso_value):
        return None
    low, high = range_of(fields)
    if not low < iso_value < high:
        # Where no kernel reaches the scalar is the base.
        base = sum(one.base for one in fields)
        low, high = min(low, base), max(high, base)
    width = high - low
    if low < iso_value < high and width > 1e-6 * abs(iso_value):
        below, above = iso_value - low, high - iso_value
        if below * (1.0 - SURFACE_SHARE) < above * SURFACE_SHARE:
            limits = low, low + max(below / SURFACE_SHARE, _NARROWEST * width)
        else:
            limits = high - max(above / (1.0 - SURFACE_SHARE), _NARROWEST * width), high
    else:
        # No such surface, or values that differ by rounding alone.
        width = max(width if width > 1e-6 * abs(iso_value) else 0.0, max(abs(iso_value), 1.0) * 1e-3)
        limits = iso_value - SURFACE_SHARE * width, iso_value + (1.0 - SURFACE_SHARE) * width
    return limits if math.isfinite(limits[1] - limits[0]) else None


def range_of(fields: Sequence[Field]) -> tuple[float, float]:
    """Return the sums of the least and of the largest values of some fields."""
    ranges = [one.value_range for one in fields if one.size]
    return sum(first for first, _ in ranges), sum(last for _, last in ranges)


def _limits_of_several(fields: Sequence[Field], lowest: float, highest: float) -> tuple[float, float] | None:
    low, high = range_of(fields)
    first, last = _SEVERAL
    width = (highest - lowest) / (last - first)
    end = max(min(highest + (1.0 - last) * width, high), highest)
    start = max(lowest - first * width, min(low, lowest))
    # The lowest surface is at least at this share of the map.
    start = min(start, (lowest - _LEAST_SHARE * end) / (1.0 - _LEAST_SHARE))
    return (start, end) if math.isfinite(end - start) else None


def surface_text(scene: Scene) -> str:
    """Return in words which iso value and which colour a scene's surface has."""
    surfaces = []
    for value, opacity in scene.surfaces[:_TOLD]:
        red, green, blue = (round(255 * min(max(part, 0.0), 1.0)) for part in surface_color(scene, value))
        faint = f", opacity {opacity:g}" if opacity < 1.0 else ""
        surfaces.append(f"isosurface at {value:g}, colour #{red:02x}{green:02x}{blue:02x}{faint}")
    if len(scene.surfaces) > _TOLD:
        values = [value for value, _ in scene.surfaces]
        surfaces.append(f"and {len(values) - _TOLD} more, all between {min(values):g} and {max(values):g}")
    return "; ".join(surfaces)


def surface_color(scene: Scene, value: float) -> Triple:
    """Return red, green, blue of a surface of a scene's first fields before it is lit."""
    return triple("colour", scene.transfer_function.at(value)[:3])
