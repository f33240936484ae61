"""Scattered data from files: points with values, and what makes ellipsoids of them."""

from __future__ import annotations

import logging
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _memory
from sheetsplat._checks import choice, number
from sheetsplat.errors import Error, Words, complain, option_ref
from sheetsplat.io.source import Source

if TYPE_CHECKING:
    from sheetsplat.fields import EllipsoidField

Floats = NDArray[np.float64]

log = logging.getLogger("sheetsplat")

Fit = Literal["delaunay", "nearest"]
FITS: tuple[Fit, ...] = ("delaunay", "nearest")
# As EllipsoidField has it.
DEFAULT_FALLOFF = 8.0

_MOST_NAMES = 60


@dataclass(frozen=True)
class Scattered:
    """What a file of scattered data holds. Rows of all arrays belong together; N is their number.

    Attributes
    ----------
    points
        World positions, (N, 3).
    values
        The scalar that was chosen, (N,); finite.
    scalar
        Its name.
    scalars
        Names that could have been chosen.
    format
        Name of the file format.
    cells
        Of a mesh over the points, where there is one: arrays of point numbers, (M, 4) tetrahedra, (M, 5) pyramids,
        (M, 6) wedges or (M, 8) hexahedra in the order of VTK.
    supports
        Radii of the supports of SPH kernels, (N,), world units.
    masses, densities
        Of SPH particles, (N,); their quotient is a particle's volume.
    deviations
        Standard deviations of Gaussians along their own axes, (N, 3), world units.
    scales
        Semi-axes of supports, (N, 3) or (N,), world units.
    rotations
        Quaternions w, x, y, z of kernels, (N, 4).
    weights
        Of kernels, (N,).
    normalization, w0, falloff, cell_volume
        What the file says, or what suits its format; None: the field's own default.
    details
        What else there is to tell, as texts.
    """

    points: Floats
    values: Floats
    scalar: str
    format: str
    scalars: tuple[str, ...] = ()
    cells: tuple[NDArray[np.int64], ...] | None = None
    supports: Floats | None = None
    masses: Floats | None = None
    densities: Floats | None = None
    deviations: Floats | None = None
    scales: Floats | None = None
    rotations: Floats | None = None
    weights: Floats | None = None
    normalization: str | None = None
    w0: float | None = None
    falloff: float | None = None
    cell_volume: float | None = None
    details: dict[str, str] = field(default_factory=dict)

    @property
    def has_kernels(self) -> bool:
        """True where the file itself says how large its kernels are."""
        return any(part is not None for part in (self.supports, self.deviations, self.scales))


def unreadable(path: Path, found: str, wanted: str, advice: str | Words = "") -> Error:
    """Return the InvalidInput for a file whose content is not right."""
    return complain(f"{path} cannot be read", found, wanted, advice)


def listed(names: Sequence[str]) -> str:
    """Return names for a message, not too many of them."""
    shown = ", ".join(names[:_MOST_NAMES])
    return shown + (f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else "")


def require_rows(path: Path, count: int, columns: int = 8) -> None:
    """Raise OutOfMemory unless `count` rows of that many float64 fit."""
    _memory.require(count * columns * 8, f"{count} points of {path}")


def finite_points(path: Path, points: Floats) -> Floats:
    """Return the points, or InvalidInput that names the first one that is not finite."""
    wrong = ~np.isfinite(points).all(axis=1)
    if wrong.any():
        first = int(np.argmax(wrong))
        where = ", ".join(f"{part:g}" for part in points[first])
        raise unreadable(
            path, f"{int(wrong.sum())} positions that are not finite, the first at {first}: ({where})", "finite numbers"
        )
    return points


def finite_values(path: Path, scalar: str, values: Floats, why: str = "", then: str = "") -> Floats:
    """Return the values, or InvalidInput that names the first one that is not finite."""
    wrong = ~np.isfinite(values)
    if wrong.any():
        first = int(np.argmax(wrong))
        found = f"{int(wrong.sum())} of {values.size} values not finite, the first at {first}: {values[first]:g}"
        raise complain(
            f"the scalar {scalar!r} of {path} cannot be used",
            found + (f" ({why})" if why else ""),
            "finite numbers",
            then or "choose another scalar",
        )
    return values


_PART = re.compile(r"(.+)_([xyz]|\d{1,3})")
# Columns of one array that have names: what a header says about their number is not trusted.
_MOST_COLUMNS = 1000


def choose_scalar(
    path: Path, wanted: str | None, preferred: Sequence[str], widths: Mapping[str, int]
) -> tuple[str, str, int | None]:
    """Return the name of a scalar, the array that it is made of, and the column; None: the length of its rows.

    Parameters
    ----------
    path
        For messages.
    wanted
        What the user asks for: an array, or one column of one, NAME_x, NAME_y, NAME_z or NAME_0, NAME_1 …
    preferred
        Arrays to take in this order where nobody asks; after them the first with one column, then the first.
    widths
        Columns of every array.
    """
    if not widths:
        raise unreadable(path, "no array of numbers that belongs to the points", "one, to be shown")
    if wanted is None:
        single = [name for name, width in widths.items() if width == 1]
        wanted = next((name for name in (*preferred, *single, *widths) if name in widths), "")
    if wanted in widths:
        return wanted, wanted, 0 if widths[wanted] == 1 else None
    match = _PART.fullmatch(wanted)
    if match is not None and widths.get(match[1], 1) > 1:
        column = "xyz".index(match[2]) if match[2] in "xyz" else int(match[2])
        if column < widths[match[1]]:
            return wanted, match[1], column
    raise complain(
        f"the scalar {wanted!r} cannot be taken from {path}",
        f"these: {listed(scalar_names(widths))}",
        "one of them",
        "pass " + option_ref("scalar", "..."),
        option="scalar",
    )


def scalar_names(widths: Mapping[str, int]) -> tuple[str, ...]:
    """Return every name that `choose_scalar` takes; an array of several columns stands for the length of its rows."""
    names: list[str] = []
    for name, width in widths.items():
        names.append(name)
        if 1 < width <= 3:
            names += [f"{name}_{axis}" for axis in "xyz"[:width]]
        elif width > 3:
            names += [f"{name}_{column}" for column in range(min(width, _MOST_COLUMNS))]
    return tuple(names)


def column_of(rows: NDArray[Any], column: int | None) -> Floats:
    """Return one column of rows as float64, or their lengths where the column is None."""
    if column is None:
        return np.asarray(np.sqrt(np.square(rows, dtype=np.float64).sum(axis=1)))
    picked = rows if rows.ndim == 1 else rows[:, column]
    return picked.astype(np.float64)


def logarithm(values: Floats, what: str, floor: bool | float) -> Floats:
    """Return decades above the smallest value, log10(v / smallest), or above `floor`, to which smaller ones are raised.

    The smallest value becomes 0, because 0 is also what a field falls to where its kernels end: a logarithm below 0
    would rise towards the border, and draw a shell around everything. InvalidInput for values of 0 and below without a
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
    log.info("log10(%s / %g) is shown", what, base)
    result: Floats = np.log10(np.maximum(values, base)) - math.log10(base)
    return np.maximum(result, 0.0)


def read_scattered(
    path: str | os.PathLike[str],
    *,
    grid: str | os.PathLike[str] | None = None,
    scalar: str | None = None,
    particles: str | None = None,
    support: float | None = None,
) -> Scattered:
    """Read scattered data; the format is found by content, then by suffix, and a gzipped file is unpacked on the way.

    Parameters
    ----------
    path
        A PLOT3D solution, where `grid` is given; VTK's .vtu or .vtp, HDF5 with particles, .ply of 3D Gaussian
        Splatting, .csv, or .npz with an array centers.
    grid
        The PLOT3D grid of the solution.
    scalar
        What is shown: a name that the format has; see the readers.
    particles
        For HDF5: the group, PartType0 unless given.
    support
        For HDF5: radius of the kernels' supports in smoothing lengths; found by the densities unless given.

    Raises
    ------
    InvalidInput
        For files that are damaged or hold something else, and options that do not belong to their format.
    OutOfMemory
        Where the numbers do not fit.
    Error
        Where a file cannot be read.
    """
    from sheetsplat.io.volume import SCATTERED, find_format

    found = "plot3d" if grid is not None else find_format(path, raw_options=False, name=None)
    if found not in SCATTERED:
        raise unreadable(Path(path), f"a file of format {found}", "scattered data: " + ", ".join(SCATTERED))
    for name, value in (("particles", particles), ("support", support)):
        if value is not None and found != "hdf5":
            raise complain(
                f"{path} cannot be read with these options", f"{name} for a file of format {found}", "it only for HDF5"
            )
    from sheetsplat.io import gaussian_ply, plot3d, sph_hdf5, tables, vtk_xml

    # Numbers that are none are found and named after they were read.
    with Source(Path(path)) as source, np.errstate(all="ignore"):
        if grid is not None:
            return plot3d.read(source, Path(grid), scalar)
        if found == "hdf5":
            return sph_hdf5.read(source, scalar, particles, support)
        readers = {
            "vtk": vtk_xml.read_points,
            "ply": gaussian_ply.read,
            "csv": tables.read_csv,
            "ellipsoids": tables.read_npz,
        }
        return readers[found](source, scalar)


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
        What was read.
    fit
        How points become ellipsoids: "delaunay" (by the neighbours in the mesh, or of the Delaunay tetrahedra), or
        "nearest" (spheres by the nearest neighbours). Unless given: the kernels that the file itself has, else the mesh
        or the Delaunay tetrahedra; particles without smoothing lengths must have it, or `neighbors`.
    neighbors
        Of "nearest".
    normalization, w0, falloff, min_scale
        As for `EllipsoidField`; what the file says unless given.
    logarithmic
        Show log10 (`logarithm`): True, or a floor.

    Notes
    -----
    A Gaussian of standard deviation σ is drawn with a support of √(2 falloff) σ, 4 σ at the falloff of 8, where the
    kernel is exp(−r²/(2σ²)) lowered by 3·10⁻⁴.
    """
    from sheetsplat.fields import EllipsoidField

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
            scales = math.sqrt(2.0 * max(DEFAULT_FALLOFF if k is None else k, 0.0)) * data.deviations
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
    log.info("%s: %s", data.format, kernels)
    return kernels.field(**options)


def _way(data: Scattered, fit: str | None, neighbors: int | None) -> str:
    """Return "own", "delaunay" or "nearest"."""
    if fit is not None:
        choice("fit", fit, FITS)
    if neighbors is not None and fit == "delaunay":
        raise complain("neighbors cannot be used", 'fit="delaunay"', 'it only for fit="nearest"')
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
