"""The options from which the transfer function and the light are made."""

import os
from collections.abc import Sequence
from typing import Annotated, Any, TypedDict

from numpy.typing import ArrayLike

from sheetsplat.fields import Field
from sheetsplat.options.core import COLORED, COMPOSITE, SCALAR, CommandLine, Option, definitions
from sheetsplat.options.scene import SceneOptions
from sheetsplat.options.values import Numbers, Special
from sheetsplat.transfer import Colormap, Opacity, TransferFunction

DEFAULT_CMAP = "viridis"


class TransferOptions(TypedDict, total=False):
    """Colours and opacity."""

    cmap: Annotated[
        Colormap | None,
        Option(
            "Colormap: a name of the package cmap (viridis, gray, matlab:jet …), or names of colours, spread evenly "
            "over {clim}.",
            unset=f'"{DEFAULT_CMAP}", "coolwarm" for values on both sides of 0, and "gray" in scalar modes',
            accepts="str, sequence of str, array (N, 3) or (N, 4), or function",
            cli=(
                CommandLine(
                    value=Special.COLORMAP,
                    help="Colormap: a name of the package cmap (viridis, gray, matlab:jet …), colours spread evenly "
                    "over {clim}, or colours at values.",
                    default=f"{DEFAULT_CMAP}, coolwarm for values on both sides of 0, and gray in scalar modes",
                ),
            ),
        ),
    ]
    opacity: Annotated[
        Opacity | None,
        Option(
            "Opacity per reference length: one number, several spread evenly over {clim}, pairs (value, opacity), or a "
            "word: linear, geom, sigmoid, sigmoid_3 … sigmoid_20, each also falling with _r; foreground; isolayers:N.",
            unset="by the histogram",
            accepts="float, sequence of float, pairs, or str",
            modes=COMPOSITE,
            value=Special.OPACITY,
        ),
    ]
    clim: Annotated[
        Sequence[float] | None,
        Option(
            "Values at which the colormap begins and ends.",
            unset="by the histogram; for an isosurface limits that give it a colour from the upper part of the map; in "
            "scalar modes by the picture",
            accepts="two numbers",
            in_values=True,
            value=Numbers("LOW,HIGH", 2, rising=True),
        ),
    ]
    color_by: Annotated[
        str | os.PathLike[str] | ArrayLike | Field | Any | None,
        Option(
            "Another field gives the colours, by {color_map}; opacities, surfaces and light stay those of the data. "
            "The name of another array in the file, a path, a field, numbers of the data's shape, or a pair (field, "
            "transfer function).",
            unset="the data themselves",
            accepts="str, path, array, Field or pair",
            modes=COLORED,
            cli=(
                CommandLine(
                    value=Special.TEXT,
                    metavar="NAME",
                    help="Another array of the file, or another file, gives the colours, by {color_map}.",
                ),
            ),
        ),
    ]
    color_map: Annotated[
        Colormap | TransferFunction | None,
        Option(
            "Colours of {color_by}: a colormap over the values that it shows most of, or a transfer function.",
            unset=f'"{DEFAULT_CMAP}"',
            accepts="str, sequence of str, array, function or TransferFunction",
            modes=COLORED,
            cli=(CommandLine(value=Special.COLORMAP, help="Colormap of {color_by}.", default=DEFAULT_CMAP),),
        ),
    ]
    slice_cmap: Annotated[
        Colormap | None,
        Option(
            "Colormap of {slice_planes} that have none of their own.",
            unset='"gray"',
            accepts="str, sequence of str, array (N, 3) or (N, 4), or function",
            modes=COLORED,
            cli=(CommandLine(value=Special.COLORMAP, help="Colormap of slice planes.", default="gray"),),
        ),
    ]
    slice_clim: Annotated[
        Sequence[float] | None,
        Option(
            "Values at which the colormap of {slice_planes} begins and ends, of those that have no limits of their "
            "own; also where logarithms are shown.",
            unset="the least and the largest value",
            accepts="two numbers",
            modes=COLORED,
            value=Numbers("LOW,HIGH", 2, rising=True),
        ),
    ]
    log_scale: Annotated[
        bool,
        Option(
            "Spread the colormap over the logarithm of the numbers.",
            default=False,
            modes=SCALAR,
            switch=True,
        ),
    ]
    transfer_function: Annotated[
        TransferFunction | str | ArrayLike | Sequence[TransferFunction] | None,
        Option(
            "Replaces {cmap}, {opacity} and {clim}: a TransferFunction, its points (value, r, g, b, opacity), or one "
            "of the names ct_bone, ct_muscle and ct_lung, for CT in Hounsfield units. A list has one for each of "
            "several fields, which are then classified each by itself.",
            accepts="TransferFunction, str, array (N, 5), or sequence of TransferFunction",
            in_values=True,
            cli=(
                CommandLine(
                    value=Special.TEXT,
                    help="Replaces {cmap}, {opacity} and {clim}: ct_bone, ct_muscle or ct_lung, for CT in Hounsfield "
                    "units.",
                ),
            ),
            modes=COLORED,
        ),
    ]
    shading: Annotated[
        bool,
        Option(
            "One light over the viewer's left shoulder, unless {lights} are given.",
            default=True,
            modes=COLORED,
            cli=(CommandLine("--shading/--no-shading", help="One light over the viewer's left shoulder."),),
            harmless=True,
        ),
    ]


#: Options that are given in values of the field as it is.
IN_VALUES = tuple(
    name for group in (TransferOptions, SceneOptions) for name, one in definitions(group).items() if one.in_values
)
