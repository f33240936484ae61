"""The options of fields, and of the files from which they are read."""

import os
from collections.abc import Sequence
from typing import Annotated, Literal, TypedDict, get_args

from numpy.typing import ArrayLike, DTypeLike

from sheetsplat._checks import Vector
from sheetsplat.fields import Boundary, EllipsoidField, Field, Lattice, NanPolicy, Normalization, RegularField
from sheetsplat.options.core import MEANS, CommandLine, Option, defaults_of, value_text
from sheetsplat.options.quality import QualityOptions
from sheetsplat.options.values import NUMBER, POSITIVE, Numbers, Special, Whole

Fit = Literal["delaunay", "nearest"]
FITS: tuple[str, ...] = get_args(Fit)
_VOLUME, _SCATTERED = defaults_of(RegularField), defaults_of(EllipsoidField)


class PlacementOptions(TypedDict, total=False):
    """Where the samples of a volume lie."""

    spacing: Annotated[
        Vector | None,
        Option(
            "World units between samples along x, y, z; of a BCC lattice, x is the edge of its cube.",
            unset="what the file says, else 1",
            accepts="three numbers",
            value=Numbers("DX,DY,DZ", 3, positive=True),
        ),
    ]
    origin: Annotated[
        Vector | None,
        Option(
            "World position of the first sample.",
            unset="what the file says, else 0",
            accepts="three numbers",
            value=Numbers("X,Y,Z", 3),
        ),
    ]
    axes: Annotated[
        Sequence[Vector] | Vector | None,
        Option(
            "Steps of i, j and k in the world, row by row, in place of the spacing: of oblique and sheared volumes.",
            unset="what the file says, else those of the spacing",
            accepts="(3, 3) numbers",
            value=Numbers("IX,IY,IZ,JX,JY,JZ,KX,KY,KZ", 9),
        ),
    ]
    lattice: Annotated[Lattice | None, Option("Lattice of the samples.", unset=value_text(_VOLUME["lattice"]))]


class KernelOptions(TypedDict, total=False):
    """The kernels of samples or points."""

    radius: Annotated[
        float | None,
        Option(
            "Volumes: radius of the kernels' supports in sample distances.",
            unset=f"{_VOLUME['radius']:g}, or as {{quality}} says",
            value=POSITIVE,
        ),
    ]
    falloff: Annotated[
        float | None,
        Option(
            "Exponent of the Gaussian at the border of a support.",
            unset=f"{_VOLUME['falloff']:g} for volumes, or as {{quality}} says; "
            f"{_SCATTERED['falloff']:g} for scattered data",
            value=POSITIVE,
        ),
    ]
    normalization: Annotated[
        Normalization | None,
        Option(
            "How sums of kernels become values.",
            unset=f"{value_text(_VOLUME['normalization'])} for volumes; for scattered data what the file says, else "
            + value_text(_SCATTERED["normalization"]),
        ),
    ]
    w0: Annotated[
        float | None,
        Option(
            'Sum of weights below which normalization "threshold" does not divide.',
            unset=f"{_VOLUME['w0']:g}",
            value=POSITIVE,
        ),
    ]
    prefilter: Annotated[
        bool | None,
        Option(
            "Volumes: let the sum of the kernels interpolate the samples, which is sharper. Best with {radius} 2.5 and "
            "{falloff} 7.",
            unset="as {quality} says",
            cli=(
                CommandLine(
                    "--prefilter/--no-prefilter",
                    help="Volumes: let the sum of the kernels interpolate the samples, which is sharper.",
                    default="as {quality} says",
                ),
            ),
        ),
    ]
    nan: Annotated[
        NanPolicy | None,
        Option(
            'What to do with NaN samples, and with scattered data whose numbers are not finite; "skip" leaves their '
            "kernels out.",
            unset=value_text(_VOLUME["nan"]),
        ),
    ]
    labels: Annotated[
        bool | None,
        Option(
            "Volumes: the samples are whole numbers that name things, which are not mixed; each label has a colour.",
            unset="where the file says so, or samples look like it: few whole numbers between which there is nothing",
            cli=(
                CommandLine(
                    "--labels/--no-labels",
                    help="Volumes: the samples are whole numbers that name things, which are not mixed.",
                    default="where they look like that",
                ),
            ),
        ),
    ]
    boundary: Annotated[
        Boundary | None,
        Option(
            'Volumes: what lies beyond the outermost samples; "edge": the data end half a sample farther out; "zero": '
            "they fall to {base} within a kernel's radius.",
            unset=value_text(_VOLUME["boundary"]),
        ),
    ]
    base: Annotated[
        float | None,
        Option(
            "The offset of values: the value where no kernel reaches.",
            unset='0 for scattered data, {boundary} "zero" and {normalization} "none"; else the value of the first '
            "sample or the median, by the data",
            value=NUMBER,
        ),
    ]


class FieldOptions(PlacementOptions, KernelOptions, total=False):
    """The field that is made of an array or a file; as for `RegularField` and `EllipsoidField`."""


class FileOptions(TypedDict, total=False):
    """How a file is read."""

    shape: Annotated[
        tuple[int, int, int] | None,
        Option(
            "Raw samples: (nk, nj, ni), the shape of the array [k, j, i] with i, along x, the fastest.",
            accepts="three int",
            cli=(
                CommandLine(
                    value=Numbers("X,Y,Z", 3, whole=True),
                    help="Raw samples: their numbers along x, y and z, with x the fastest.",
                ),
            ),
        ),
    ]
    dtype: Annotated[
        DTypeLike | None,
        Option(
            'Raw samples: their type as NumPy names it: uint8, int16, ">i2" (big-endian), float32 …',
            accepts="str or numpy.dtype",
            value=Special.TEXT,
        ),
    ]
    offset: Annotated[int, Option("Raw samples: number of bytes before the first one.", default=0, value=Whole(0))]
    name: Annotated[
        str | None,
        Option(
            "The array to take of a file with several volumes; of DICOM the series; a channel, by its label or number.",
            unset="the only one; of channels all",
            called=("channel", "series", "variable", "array", "dataset"),
        ),
    ]
    step: Annotated[
        int | None,
        Option(
            "The time step to take of a file with several, from 0 on: NetCDF, Zarr, HDF5, TIFF, NIfTI, DICOM, .vtkhdf, "
            ".pvd.",
            unset="the only one",
            called=("time", "timestep", "time_step", "t"),
            value=Whole(0),
        ),
    ]
    scalar: Annotated[
        str | None,
        Option(
            "Scattered data and .vti: the array to show, by its name in the file; NAME_x is one component of a vector, "
            "NAME its length. PLOT3D: density, momentum, energy, velocity, pressure, temperature, mach …"
        ),
    ]
    weight: Annotated[
        str | os.PathLike[str] | ArrayLike | Field | None,
        Option(
            "Mode average: the mean along each ray is weighted, as temperature by density. The name of another array "
            "in the file, a path of another file, a field on the same lattice or of the same kernels, or their "
            "numbers; none below 0.",
            unset="all slices weigh the same",
            modes=MEANS,
            accepts="str, path, array or Field",
            cli=(
                CommandLine(
                    value=Special.TEXT,
                    metavar="NAME",
                    help="Mode average: weights of the mean along each ray; the name of another array in the file, or "
                    "another file.",
                ),
            ),
        ),
    ]
    resample: Annotated[
        bool,
        Option(
            "Volumes: interpolate samples at uneven coordinates to even ones, instead of refusing them.",
            default=False,
            switch=True,
        ),
    ]
    log: Annotated[
        bool | float | None,
        Option(
            "Show log10(value / smallest value), in decades; or, where it is a number, log10(value / number), with "
            "smaller values raised to that number. Modes xray and average are of the values themselves: there it "
            "stands for {log_scale}.",
            unset="False; in a picture by the histogram",
            accepts="bool or float",
            cli=(
                CommandLine(
                    "--log/--no-log",
                    help="Show log10(value / smallest value), in decades.",
                    default="by the histogram",
                ),
                CommandLine(
                    "--log-floor",
                    "log_floor",
                    POSITIVE,
                    "Show log10(value / FLOOR); values below FLOOR are raised to it.",
                ),
            ),
        ),
    ]
    grid: Annotated[
        str | os.PathLike[str] | None,
        Option(
            "PLOT3D: the file of the grid; the other file is the solution.", accepts="path", value=Special.INPUT_FILE
        ),
    ]
    particles: Annotated[
        str | None,
        Option("HDF5: the group of the particles.", unset='"PartType0"', cli=(CommandLine(metavar="GROUP"),)),
    ]
    support: Annotated[
        float | None,
        Option("HDF5: radius of a kernel in smoothing lengths.", unset="by the densities in the file", value=POSITIVE),
    ]
    fit: Annotated[
        Fit | None,
        Option(
            "Scattered data: how points become ellipsoids: by their neighbours in the mesh, or in the Delaunay "
            "tetrahedra of the points; or by their nearest neighbours.",
            unset='the kernels of the file, else "delaunay"',
        ),
    ]
    neighbors: Annotated[
        int | None, Option('Scattered data: number of neighbours of fit "nearest".', value=Whole(1, 256))
    ]
    min_scale: Annotated[
        float | None, Option("Scattered data: raise smaller semi-axes to this length, world units.", value=POSITIVE)
    ]
    periodic: Annotated[
        tuple[Vector, Vector] | None,
        Option(
            "Scattered data: the box in which kernels wrap, outside of which nothing is. An axis with two equal ends "
            "does not wrap.",
            unset="the box of the file, if it has one and all its particles lie in it",
            accepts="two corners",
            value=Numbers("X0,Y0,Z0,X1,Y1,Z1", 6),
        ),
    ]


class OpenOptions(FieldOptions, FileOptions, QualityOptions, total=False):
    """Every keyword argument of `open`."""
