"""Every option of `sheetsplat.render`, and the rules about which mode uses which."""

from collections.abc import Iterable
from functools import cache
from typing import Annotated, TypedDict

from numpy.typing import ArrayLike

from sheetsplat.camera import Camera
from sheetsplat.options.bricks import ClusterOptions
from sheetsplat.options.camera import CameraOptions
from sheetsplat.options.core import COLORED, MODES, CommandLine, Option, definitions
from sheetsplat.options.data import OpenOptions
from sheetsplat.options.look import TransferOptions
from sheetsplat.options.renderer import Output, Progress, RendererOptions
from sheetsplat.options.scene import SceneOptions
from sheetsplat.options.values import Numbers
from sheetsplat.renderer import Renderer

_OUTPUT_MODES = {"coverage": MODES, "depth": COLORED}


class SizeOptions(TypedDict, total=False):
    """The size of the picture."""

    size: Annotated[
        tuple[int, int] | int,
        Option(
            "Width and height in pixels; one number: square.",
            default=(400, 400),
            accepts="two int, or one",
            cli=(
                CommandLine(
                    value=Numbers("WxH", 2, whole=True, square=True),
                    help="Width and height in pixels; one number: square.",
                    default="400x400",
                ),
            ),
        ),
    ]


class PictureOptions(SizeOptions, total=False):
    """The picture itself."""

    outputs: Annotated[
        Iterable[Output],
        Option(
            'Arrays beside the picture: "coverage", the line integral of the kernels\' weights; "depth", the depth at '
            "which the opacity first reaches one half.",
            default=(),
            accepts="sequence of str",
            cli=(),
        ),
    ]
    depth_limit: Annotated[
        ArrayLike | None,
        Option(
            "Depths of a surface that was drawn elsewhere with the same camera, which hides what lies behind it: an "
            "array (h, w), world units from the eye along the view direction, infinite where there is no surface.",
            accepts="array (h, w), or float",
            cli=(),
        ),
    ]
    progress: Annotated[
        Progress | None,
        Option(
            "Called with the finished share, from 0 to 1; where it returns False, the rendering stops.",
            accepts="function",
            cli=(),
        ),
    ]


class ObjectOptions(TypedDict, total=False):
    """Objects that replace groups of options."""

    camera: Annotated[Camera | None, Option("Replaces all options of the camera.", accepts="Camera", cli=())]
    renderer: Annotated[Renderer | None, Option("Replaces all options of the renderer.", accepts="Renderer", cli=())]


class LookOptions(TransferOptions, SceneOptions, total=False):
    """Every option of a scene: what `Scene` takes, and what chooses a transfer function and light."""


class RenderOptions(
    PictureOptions,
    LookOptions,
    ObjectOptions,
    ClusterOptions,
    CameraOptions,
    RendererOptions,
    OpenOptions,
    total=False,
):
    """Every keyword argument of `sheetsplat.render`."""


@cache
def _modes() -> dict[str, tuple[str, ...]]:
    """Return the modes that use an option or an output, by its names in Python and on the command line."""
    found = dict(_OUTPUT_MODES)
    for name, defined in definitions(RenderOptions).items():
        for known in (name, *(one.parameter for one in defined.spellings if one.parameter)):
            found[known] = defined.modes
    return found


def unused(mode: str, given: Iterable[str]) -> list[str]:
    """Return those of the options and outputs that were given which a mode does not use."""
    return [name for name in given if mode not in _modes().get(name, MODES)]
