"""Opacities of scattered data so that rays go through them: by measured optical depths."""

from __future__ import annotations

import numpy as np

from sheetsplat.fields import EllipsoidField
from sheetsplat.look.histogram import Look, scaled_opacity
from sheetsplat.look.measure import coarse_picture, measure_kernels

# Median optical depth of rays: more than a third of what is behind an object shows through it.
DEPTH = 1.0
# Faint data are made more opaque by this factor at most.
_MOST = 100.0
# Rays that show less than this opacity are background.
_SEEN = 0.05
# Share of the positions on each side that may lie outside the coarse pictures, in percent.
_STRAYS = 0.5


def median_depth(look: Look, field: EllipsoidField, reference_length: float, places: int) -> float:
    """Return the median optical depth of the rays along x, y and z on which something can be seen; 0 if there is none.

    Parameters
    ----------
    look
        Its opacities are measured, those of the field's default reference length unless it has its own.
    field
        What is shown.
    reference_length
        The default, world units.
    places
        About so many positions in the field are looked at.
    """
    one = measure_kernels(field, places)
    values, opacities = np.transpose(look.opacity)
    opacity = np.minimum(np.interp(one.values, values, opacities), 1.0 - 1e-9)
    # Optical depth per length times volume.
    weights = -np.log1p(-opacity) * (one.volumes / (look.reference_length or reference_length))
    shown = (weights > 0) & np.isfinite(weights)
    points, weights = one.points[shown], weights[shown]
    if len(points) < 2:
        return 0.0
    low, high = np.percentile(points, (_STRAYS, 100.0 - _STRAYS), axis=0)
    inside = np.all((points >= low) & (points <= high), axis=1)
    points, weights = points[inside], weights[inside]
    if len(points) < 2:
        return 0.0
    pictures = [coarse_picture(np.delete(points, axis, axis=1), weights)[0].ravel() for axis in range(3)]
    depths = np.concatenate(pictures)
    seen = depths[-np.expm1(-depths) > _SEEN]
    return float(np.median(seen)) if seen.size else 0.0


def see_through(look: Look, field: EllipsoidField, reference_length: float, places: int) -> Look:
    """Return a look whose opacities are such that the median optical depth of rays is `DEPTH`.

    Scattered data are mostly of gases and fluids, whose values have no surfaces: with the opacities that suit the
    surfaces in measured volumes their outermost layer would hide all that is inside, and thin sheets would hardly be
    seen. In kernels of one value there is nothing to see but the surface; they stay as they are.
    """
    known = field.values[: field.size - field.ghosts]
    if not known.size or known.min() == known.max():
        return look
    depth = median_depth(look, field, reference_length, places)
    return scaled_opacity(look, min(DEPTH / depth, _MOST)) if depth > 0 else look
