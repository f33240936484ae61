"""Kernels of scattered data: a field of ellipsoids from what a file holds."""

from __future__ import annotations

import logging
import math
from typing import Any

import numpy as np

from sheetsplat._checks import choice, number
from sheetsplat.errors import complain, option_ref
from sheetsplat.fields import EllipsoidField
from sheetsplat.io.checks import listed
from sheetsplat.io.records import Floats, Scattered
from sheetsplat.options.data import FITS

_log = logging.getLogger("sheetsplat")

# The default of EllipsoidField.
_DEFAULT_FALLOFF = 8.0


def logarithm(values: Floats, what: str, floor: bool | float) -> Floats:
    """Return decades above the smallest value, log10(v / smallest), or above `floor`, to which smaller ones are raised.

    The smallest value becomes 0, because a field falls to 0 where its kernels end: a logarithm below 0 would rise
    towards the border and draw a shell around the data. InvalidInput for values of 0 and below without a
    floor.
    """
    if not values.size:
        return values
    if floor is True:
        wrong = ~(values > 0)
        if wrong.any():
            above = values[~wrong]
            smallest = f"; the smallest one above 0 is {above.min():g}" if above.size else ""
            raise complain(
                f"the logarithm of {what} cannot be taken",
                f"{int(wrong.sum())} of {values.size} values that are not above 0{smallest}",
                "values above 0",
                "pass " + option_ref("log", "...") + ", a floor to which all smaller values are raised",
                option="log",
            )
        base = float(values.min())
    else:
        base = float(floor)
        if not (math.isfinite(base) and base > 0):
            raise complain("log cannot be used", f"a floor of {base:g}", "True, or a floor above 0")
    _log.info("log10(%s / %g) is shown", what, base)
    result: Floats = np.log10(np.maximum(values, base)) - math.log10(base)
    return np.maximum(result, 0.0)


def field_of(
    data: Scattered,
    *,
    fit: str | None = None,
    neighbors: int | None = None,
    normalization: str | None = None,
    w0: float | None = None,
    falloff: float | None = None,
    min_scale: float | None = None,
    logarithmic: bool | float = False,
) -> EllipsoidField:
    """Return a field of ellipsoids.

    Parameters
    ----------
    data
        The data of a file.
    fit
        How points become ellipsoids: "delaunay" (by the neighbours in the mesh, or of the Delaunay tetrahedra), or
        "nearest" (spheres by the nearest neighbours). Unless given: the kernels that the file itself has, else the mesh
        or the Delaunay tetrahedra; particles without smoothing lengths must have it, or `neighbors`.
    neighbors
        Of "nearest".
    normalization, w0, falloff, min_scale
        As for `EllipsoidField`; from the file unless given.
    logarithmic
        Show log10 (`logarithm`): True, or a floor.

    Notes
    -----
    A Gaussian of standard deviation σ is drawn with a support of √(2 falloff) σ, 4 σ at the falloff of 8, where the
    kernel is exp(−r²/(2σ²)) lowered by 3·10⁻⁴.
    """
    values = data.values
    if logarithmic is not False:
        values = logarithm(values, data.scalar, logarithmic)
    how = _way(data, fit, neighbors)
    given = {
        "normalization": data.normalization if normalization is None else normalization,
        "w0": data.w0 if w0 is None else w0,
        "min_scale": min_scale,
    }
    options: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    k = data.falloff if falloff is None else number("falloff", falloff)
    if how == "own" and data.supports is None:
        if k is not None:
            options["falloff"] = k
        scales = data.scales
        if data.deviations is not None:
            scales = math.sqrt(2.0 * max(_DEFAULT_FALLOFF if k is None else k, 0.0)) * data.deviations
        if data.cell_volume is not None:
            options["cell_volume"] = data.cell_volume
        assert scales is not None
        return EllipsoidField(data.points, scales, data.rotations, values, weights=data.weights, **options)
    from sheetsplat import fit as fits

    more: dict[str, Any] = {} if k is None else {"falloff": k}
    if how == "own":
        assert data.supports is not None
        if k is not None:
            wanted = "that of the Gaussian that is closest to their kernel"
            raise complain(
                option_ref("falloff") + " cannot be used", f"{k:g} for SPH particles", wanted, "leave it out"
            )
        both = data.masses is not None and data.densities is not None
        kernels = fits.sph(
            data.points,
            values,
            data.supports,
            support=1.0,
            masses=data.masses if both else None,
            densities=data.densities if both else None,
        )
    elif how == "nearest":
        if neighbors is not None:
            more["neighbors"] = neighbors
        kernels = fits.nearest(data.points, values, **more)
    else:
        kernels = fits.delaunay(data.points, values, cells=data.cells, **more)
    _log.info("%s: %s", data.format, kernels)
    return kernels.field(**options)


def _way(data: Scattered, fit: str | None, neighbors: int | None) -> str:
    """Return "own", "delaunay" or "nearest"."""
    if fit is not None:
        choice("fit", fit, FITS)
    if neighbors is not None and fit == "delaunay":
        raise complain(
            option_ref("neighbors") + " cannot be used",
            option_ref("fit", "delaunay"),
            "it only for " + option_ref("fit", "nearest"),
        )
    if neighbors is not None:
        return "nearest"
    if fit is not None:
        return fit
    if data.has_kernels:
        return "own"
    if data.format.startswith("hdf5"):
        raise complain(
            "the particles cannot be made kernels",
            f"no smoothing lengths beside {listed(data.scalars)}",
            "a dataset SmoothingLength, or a number of neighbours to take the sizes from",
            "pass " + option_ref("neighbors", "32") + ", which makes spheres by the nearest neighbours",
        )
    return "delaunay"
