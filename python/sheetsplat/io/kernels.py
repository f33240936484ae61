"""Fields of ellipsoids from the scattered data of files."""

from __future__ import annotations

import logging
import math
import pkgutil
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sheetsplat._checks import choice, number
from sheetsplat.errors import complain, option_ref
from sheetsplat.fields import EllipsoidField, Periodic
from sheetsplat.io.checks import listed
from sheetsplat.io.records import Floats, Scattered
from sheetsplat.options.data import FITS

_log = logging.getLogger("sheetsplat")

# The default of EllipsoidField.
_DEFAULT_FALLOFF = 8.0


def logarithm(values: Floats, what: str, floor: bool | float) -> Floats:
    """Return log10(v / smallest value), or log10(max(v, floor) / floor) unless `floor` is True; 0 is the least result.

    Negative logarithms would rise towards the border of the data, where fields fall to 0. InvalidInput for values of 0
    and below without a floor.
    """
    if not values.size:
        return values
    base = log_base(values, what, floor)
    return np.asarray(np.maximum(np.log10(np.maximum(values, base)) - math.log10(base), 0.0))


def log_base(values: NDArray[Any], what: str, floor: bool | float) -> float:
    """Return the value that `logarithm` counts decades from: the smallest, or `floor`. Raises what that raises."""
    if floor is True:
        above, missing = values[values > 0], int(np.isnan(values).sum()) if values.dtype.kind == "f" else 0
        if above.size + missing < values.size or not above.size:
            smallest = f"; the smallest one above 0 is {above.min():g}" if above.size else ""
            raise complain(
                f"the logarithm of {what} cannot be taken",
                f"{values.size - above.size - missing} of {values.size} values that are not above 0{smallest}",
                "values above 0",
                "pass " + option_ref("log", "...") + ", to which smaller values are raised",
                option="log",
            )
        return float(above.min())
    base = number("log", floor)
    if not (math.isfinite(base) and base > 0):
        raise complain("log cannot be used", f"a floor of {base:g}", "True, or a floor above 0")
    return base


def field_of(
    data: Scattered,
    *,
    fit: str | None = None,
    neighbors: int | None = None,
    normalization: str | None = None,
    w0: float | None = None,
    falloff: float | None = None,
    min_scale: float | None = None,
    base: float | None = None,
    periodic: Periodic = None,
    logarithmic: bool | float = False,
) -> EllipsoidField:
    """Return a field of ellipsoids.

    Parameters
    ----------
    data
        The data of a file.
    fit
        "delaunay" (ellipsoids by the neighbours in the mesh or in the Delaunay tetrahedra) or "nearest" (spheres by the
        nearest neighbours). Unless given: the file's own kernels, else "delaunay"; particles without smoothing lengths
        need `fit` or `neighbors`.
    neighbors
        Of "nearest".
    normalization, w0, falloff, min_scale, base, periodic
        As for `EllipsoidField`; from the file unless given.
    logarithmic
        True or a floor: show the `logarithm`.

    Notes
    -----
    A Gaussian of standard deviation σ is drawn with a support of √(2 falloff) σ, 4 σ at the falloff of 8, where the
    kernel is exp(−r²/(2σ²)) lowered by 3·10⁻⁴.
    """
    # (Fits encode, and encoding looks at decades, which come back here.)
    fits: Any = pkgutil.resolve_name("sheetsplat.fit")

    values = data.values if logarithmic is False else logarithm(data.values, data.scalar, logarithmic)
    how = _way(data, fit, neighbors)
    k = data.falloff if falloff is None else number("falloff", falloff)
    decay = given(falloff=k)
    options = given(
        normalization=data.normalization if normalization is None else normalization,
        w0=data.w0 if w0 is None else w0,
        min_scale=min_scale,
        base=data.base if base is None else base,
        periodic=data.periodic if periodic is None else periodic,
    )
    box = given(periodic=options.get("periodic"))
    if how == "own" and data.supports is None:
        scales = data.scales
        if data.deviations is not None:
            scales = math.sqrt(2.0 * max(_DEFAULT_FALLOFF if k is None else k, 0.0)) * data.deviations
        assert scales is not None
        options |= decay | given(cell_volume=data.cell_volume)
        field = EllipsoidField(data.points, scales, data.rotations, values, weights=data.weights, **options)
        return field.with_orientation(data.orientation)
    if how == "own":
        assert data.supports is not None
        if k is not None:
            found, wanted = f"{k:g} for SPH particles", "that of the Gaussian that is closest to their kernel"
            raise complain(option_ref("falloff") + " cannot be used", found, wanted, "leave it out")
        both = data.masses is not None and data.densities is not None
        volumes: dict[str, Any] = {"masses": data.masses, "densities": data.densities} if both else {}
        kernels = fits.sph(data.points, values, data.supports, support=1.0, min_scale=min_scale, **volumes, **box)
    elif how == "nearest":
        kernels = fits.nearest(data.points, values, **decay, **box, **given(neighbors=neighbors))
    else:
        # The neighbours in a mesh are those that it says.
        around = box if data.cells is None else {}
        kernels = fits.delaunay(data.points, values, cells=data.cells, **decay, **around)
    _log.info("%s: %s", data.format, kernels)
    made: EllipsoidField = kernels.field(**options).with_orientation(data.orientation)
    return made


def given(**options: Any) -> dict[str, Any]:
    """Return the options that are not None."""
    return {name: value for name, value in options.items() if value is not None}


def _way(data: Scattered, fit: str | None, neighbors: int | None) -> str:
    """Return "own", "delaunay" or "nearest"."""
    if fit is not None:
        choice("fit", fit, FITS)
    if neighbors is not None:
        if fit == "delaunay":
            wanted = "it only for " + option_ref("fit", "nearest")
            raise complain(option_ref("neighbors") + " cannot be used", option_ref("fit", "delaunay"), wanted)
        return "nearest"
    if fit is not None:
        return fit
    if data.has_kernels:
        return "own"
    if data.particles:
        raise complain(
            "the particles cannot be converted to kernels",
            f"no smoothing lengths beside {listed(data.scalars)}",
            "a dataset SmoothingLength, or a number of neighbours",
            "pass " + option_ref("neighbors", "32") + " for spheres by the nearest neighbours",
        )
    return "delaunay"
