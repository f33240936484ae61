"""The options of a renderer."""

from collections.abc import Callable, Mapping
from typing import Annotated, Literal, TypedDict, get_args

from sheetsplat._checks import choice, number, shown, truth, whole
from sheetsplat.backends import BACKEND_TRAITS, Backend
from sheetsplat.errors import complain, unusable
from sheetsplat.options.checks import one_of, optional
from sheetsplat.options.core import CommandLine, Option, definitions
from sheetsplat.options.values import POSITIVE, Special, Whole

Precision = Literal["auto", "uint8", "float16", "float32", "float64"]
Tagging = Literal["auto", "depth_bounds", "depth_equal", "tiles", "off"]
Packing = Literal["auto", "paper", "wide"]
Path = Literal["auto", "raster", "compute"]
# Called with the finished share, from 0 to 1; False stops the rendering, any other result does not.
Progress = Callable[[float], object]
Output = Literal["coverage", "depth"]
BACKENDS: tuple[str, ...] = get_args(Backend)
OUTPUTS: tuple[str, ...] = get_args(Output)
MOST_THREADS = 1024


def _effects(what: str, effects: object) -> dict[str, bool]:
    if effects is None:
        return {}
    if not isinstance(effects, Mapping) or not all(isinstance(name, str) and name.isascii() for name in effects):
        raise complain(unusable(what), shown(effects), "{name: True or False}")
    owner = what.partition(":")[0]
    return {name: truth(f"{owner}: the effect {shown(name)}", on) for name, on in effects.items()}


def _count(what: str, value: object) -> int | None:
    """Return a number of at least 1; 0 stands for None, the limit of the device."""
    result = 0 if value is None else whole(what, value)
    if result < 0:
        raise complain(unusable(what), str(result), "a whole number of at least 1", "leave it out")
    return result or None


def _goal(what: str, value: object) -> float:
    result = number(what, value)
    if not result > 0:
        raise complain(unusable(what), str(result), "a number above 0", "leave it out")
    return result


def _threads(what: str, threads: object) -> int:
    wanted = f"a whole number from 1 to {MOST_THREADS}, or None for as many as the process may run on"
    result = whole(what, threads, wanted)
    if not 1 <= result <= MOST_THREADS:
        raise complain(unusable(what), str(result), wanted)
    return result


def check_backend(what: str, backend: object) -> str:
    """Return the name of a backend, or InvalidInput."""
    return choice(what, backend, BACKENDS)


class BackendOptions(TypedDict, total=False):
    """The backend."""

    backend: Annotated[
        Backend,
        Option(
            'Backend: "gl" (OpenGL), "cpu" (vector instructions of the processor) or "reference" (plain float64). '
            '"auto": the environment variable SHEETSPLAT_BACKEND, else gl on graphics hardware and cpu where there is '
            "none; where one does not support the scene, the other is tried, then reference.",
            default="auto",
            check=check_backend,
        ),
    ]


class RendererSettings(TypedDict, total=False):
    """How a renderer draws, without its backend."""

    device: Annotated[
        int | None,
        Option(
            "Number of the EGL device of backend gl.",
            backends=("gl",),
            unset="the environment variable SHEETSPLAT_EGL_DEVICE, else the first that works",
            check=optional(whole),
            value=Whole(0, 2**31 - 1),
        ),
    ]
    precision: Annotated[
        Precision,
        Option(
            "Number format of the sheet buffers; backend gl has up to 32 bits, backend cpu 32 and 64.",
            default="auto",
            check=one_of(Precision),
        ),
    ]
    tagging: Annotated[Tagging, Option("How empty pixels are skipped.", default="auto", check=one_of(Tagging))]
    packing: Annotated[
        Packing,
        Option(
            'How slices share buffers: "paper", four in one, one shaded in a pass; "wide", several shaded in a pass.',
            default="auto",
            check=one_of(Packing),
        ),
    ]
    path: Annotated[
        Path,
        Option(
            'How backend gl draws: "raster", passes of the rasteriser as in the papers; "compute", programs of OpenGL '
            '4.3 that draw tile by tile. "auto": the environment variable SHEETSPLAT_GL_PATH, else what was faster '
            "when the device was measured, and raster in software.",
            default="auto",
            check=one_of(Path),
        ),
    ]
    effects: Annotated[
        Mapping[str, bool] | None,
        Option(
            'Forces effects of the plan on or off, by name; "Reading a plan" in effects.md lists them.',
            accepts="dict of str to bool",
            check=_effects,
            cli=(
                CommandLine(
                    "--effect",
                    value=Special.TEXT,
                    metavar="NAME=on|off",
                    help='Force an effect of the plan, by name; may be repeated. "Reading a plan" in effects.md lists '
                    "them.",
                    multiple=True,
                ),
            ),
        ),
    ]
    allow_inexact: Annotated[
        bool, Option("Accept settings that cannot keep the error bound.", default=False, check=truth, switch=True)
    ]
    threads: Annotated[
        int | None,
        Option(
            "Number of threads of backend cpu. Pictures do not depend on it.",
            backends=("cpu",),
            unset="as many as the process may run on",
            check=optional(_threads),
            value=Whole(1, MOST_THREADS),
        ),
    ]
    max_error: Annotated[
        float | None,
        Option(
            "Largest root mean square distance from the converged picture, at least 6e-8: colours and opacity count "
            "from 0 to 1, scalars relative to the largest one where that is above 1. The renderer chooses the cheapest "
            "settings that keep it for {slice_spacing}, {sampling}, {preintegration} and {opacity_stop}, where these "
            "have their defaults.",
            check=optional(_goal),
            value=POSITIVE,
        ),
    ]
    max_seconds: Annotated[
        float | None,
        Option(
            "Longest time for a picture, approximately: the renderer chooses the settings of the smallest error that "
            "are expected to keep it. It takes precedence over {max_error}. The first picture takes longer, because "
            "settings are tried.",
            check=optional(_goal),
            value=POSITIVE,
        ),
    ]


class RendererLimits(TypedDict, total=False):
    """Limits of a device that only `Renderer` itself takes."""

    tags_per_clear: Annotated[
        int | None,
        Option(
            "Number of depth tags before the depth buffer is cleared, of backend gl.",
            backends=("gl",),
            unset="what the resolution of the depth buffer allows",
            check=_count,
            cli=(),
        ),
    ]
    tile_size: Annotated[
        int | None,
        Option(
            "Largest edge of an image tile in pixels.",
            backends=("gl", "cpu"),
            unset="what the device can do",
            check=_count,
            cli=(),
        ),
    ]


class RendererKeywords(RendererSettings, RendererLimits, total=False):
    """Every keyword argument of `Renderer`; its backend may be given by position."""


class RendererClassOptions(BackendOptions, RendererKeywords, total=False):
    """Every argument of `Renderer`."""


class RendererOptions(BackendOptions, RendererSettings, total=False):
    """How a picture is drawn."""


def unused_by(backend: str) -> list[str]:
    """Return the names of options that a backend does not use."""
    named = definitions(RendererClassOptions).items()
    ways = [] if BACKEND_TRAITS[backend].ways else ["tagging", "packing", "path"]
    return ways + [name for name, option in named if option.backends and backend not in option.backends]
