"""The options of a camera that shows all of the data."""

from typing import Annotated, Literal, TypedDict

from sheetsplat._checks import Vector
from sheetsplat.camera import Camera, Kind
from sheetsplat.options.core import Option, defaults_of
from sheetsplat.options.values import POSITIVE, Numbers, Real, Special
from sheetsplat.orientation import ISOMETRIC

_FIT = defaults_of(Camera.fit)


class CameraOptions(TypedDict, total=False):
    """Where the picture is taken from."""

    direction: Annotated[
        Vector | str | None,
        Option(
            'World direction of the view: three numbers, or an axis such as "x" or "-z".',
            unset="by the field's orientation: from its front, or where that is not known from (1, 1, 1)",
            accepts="three numbers or str",
            value=Special.DIRECTION,
        ),
    ]
    up: Annotated[
        Vector | str | None,
        Option(
            "World direction that points up in the picture: three numbers, or an axis.",
            unset="what the file says, else z",
            accepts="three numbers or str",
            value=Special.DIRECTION,
        ),
    ]
    y: Annotated[
        Literal["up", "down"] | None,
        Option(
            'Where y points where {up} and {direction} do not say: "down" shows stacks as programs for microscopes do, '
            'the first row at the top and the first slice nearest, with figures\' axes downwards; "up" from the last '
            "slice, with the first row at the bottom.",
            unset="by the field's orientation",
        ),
    ]
    azimuth: Annotated[
        float | None,
        Option(
            "Angle in degrees by which the eye moves around {up}, to the right: from {direction}, else from the front, "
            "which is x unless the file says.",
            unset="45, or 0 with {direction} or a front",
            value=Real(),
        ),
    ]
    elevation: Annotated[
        float | None,
        Option(
            "Angle in degrees by which the eye then moves towards {up}.",
            unset=f"{ISOMETRIC[1]:.2f}, or 0 with {{direction}} or a front",
            value=Real(),
        ),
    ]
    zoom: Annotated[float, Option("Enlargement.", default=1.0, value=POSITIVE)]
    target: Annotated[
        Vector | None,
        Option(
            "World point in the middle of the picture.",
            unset="the middle of what is seen",
            accepts="three numbers",
            value=Numbers("X,Y,Z", 3),
        ),
    ]
    projection: Annotated[Kind, Option("Kind of projection.", default=_FIT["kind"])]
    fov_y: Annotated[
        float,
        Option(
            "Vertical angle of view of a perspective projection, degrees.",
            default=_FIT["fov_y"],
            flag="--fov",
            value=Real(above=0.0, below=180.0),
        ),
    ]
    margin: Annotated[
        float, Option("How much larger than what is seen the picture is.", default=_FIT["margin"], value=POSITIVE)
    ]
