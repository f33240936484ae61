"""The options of films: `sheetsplat.turntable`, `sheetsplat.animate`, and how a film is written."""

from typing import Annotated, Any, TypedDict

from sheetsplat._checks import Vector, attribute, number, shown, whole
from sheetsplat.camera import Camera
from sheetsplat.errors import complain, unusable
from sheetsplat.options.camera import CameraOptions
from sheetsplat.options.core import CommandLine, Option
from sheetsplat.options.data import OpenOptions
from sheetsplat.options.picture import LookOptions, SizeOptions
from sheetsplat.options.renderer import RendererOptions
from sheetsplat.options.values import Real, Special, Whole
from sheetsplat.options.workers import WorkerOptions
from sheetsplat.renderer import Renderer

#: More pictures than this are no film.
MOST_FRAMES = 100_000
MOST_WORKERS = 256
_FASTEST = 240.0


def frames_of(what: str, value: object) -> int:
    """Return a number of frames, or InvalidInput."""
    wanted = f"a whole number from 1 to {MOST_FRAMES}"
    result = whole(what, value, wanted)
    if not 1 <= result <= MOST_FRAMES:
        raise complain(unusable(what), str(result), wanted)
    return result


def workers_of(what: str, value: object) -> int:
    """Return a number of processes, 1 for None, or InvalidInput."""
    wanted = f"a whole number from 1 to {MOST_WORKERS}"
    result = 1 if value is None else whole(what, value, wanted)
    if not 1 <= result <= MOST_WORKERS:
        raise complain(unusable(what), str(result), wanted)
    return result


def rate_of(what: str, value: object) -> float:
    """Return a number of pictures a second, or InvalidInput."""
    result = number(what, value)
    if not 0.0 < result <= _FASTEST:
        raise complain(unusable(what), f"{result:g}", f"a number above 0, at most {_FASTEST:g}")
    return result


def client_of(what: str, value: Any) -> Any:
    """Return what frames can be submitted to, or None; InvalidInput for anything else."""
    if value is not None and not callable(attribute(value, "submit")):
        wanted = "a client of dask.distributed, or an executor of concurrent.futures"
        raise complain(unusable(what), f"{type(value).__name__}, {shown(value)}", wanted)
    return value


class FilmOptions(WorkerOptions, total=False):
    """How frames are drawn and written."""

    fps: Annotated[
        float, Option("Pictures a second.", default=30.0, check=rate_of, value=Real(above=0.0, most=_FASTEST))
    ]
    workers: Annotated[
        int | None,
        Option(
            "Number of processes that draw frames, beside this one. Each uses its share of the cores. Pictures do not "
            "depend on it.",
            unset="frames are drawn one after the other in this process",
            check=workers_of,
            cli=(
                CommandLine(
                    value=Whole(1, MOST_WORKERS),
                    help="Number of processes of this machine that draw frames; with {brick} each frame by all of "
                    "them, in bricks. Pictures do not depend on it.",
                ),
            ),
        ),
    ]
    client: Annotated[
        Any,
        Option(
            "Draws the frames: a client of dask.distributed, or an executor of concurrent.futures.",
            unset="{workers} processes",
            accepts="Client or Executor",
            check=client_of,
            cli=(),
        ),
    ]


class TurnOptions(TypedDict, total=False):
    """How a turntable turns."""

    frames: Annotated[int, Option("Number of frames.", default=90, check=frames_of, value=Whole(1, MOST_FRAMES))]
    axis: Annotated[
        Vector | str | None,
        Option(
            "World direction of the axis about which the eye turns, counter-clockwise seen against it: three numbers, "
            'or an axis such as "z".',
            unset="up in the first picture",
            accepts="three numbers or str",
            value=Special.DIRECTION,
        ),
    ]
    degrees: Annotated[float, Option("Angle of the whole turn.", default=360.0, check=number, value=Real())]


class BetweenOptions(TypedDict, total=False):
    """Frames between the steps of a series."""

    between: Annotated[
        int | None,
        Option(
            "Snapshots of particles: number of frames between each two of them, in which every particle follows its "
            "path by its positions and velocities.",
            unset="the snapshots alone",
            check=frames_of,
            value=Whole(1, MOST_FRAMES),
        ),
    ]


class SharedOptions(SizeOptions, LookOptions, CameraOptions, RendererOptions, OpenOptions, total=False):
    """What the frames of a film share with pictures."""

    renderer: Annotated[Renderer | None, Option("Replaces all options of the renderer.", accepts="Renderer", cli=())]


class TurntableOptions(TurnOptions, FilmOptions, SharedOptions, total=False):
    """Every keyword argument of `sheetsplat.turntable`."""

    camera: Annotated[
        Camera | None,
        Option(
            "The first camera, which turns about its target; replaces all options of the camera.",
            accepts="Camera",
            cli=(),
        ),
    ]


class AnimateOptions(BetweenOptions, FilmOptions, SharedOptions, total=False):
    """Every keyword argument of `sheetsplat.animate` but the number of frames."""

    camera: Annotated[
        Any,
        Option(
            "One camera, a CameraPath, or key frames, a sequence of cameras through which a path leads; replaces all "
            "options of the camera.",
            accepts="Camera, CameraPath or sequence of Camera",
            cli=(),
        ),
    ]
