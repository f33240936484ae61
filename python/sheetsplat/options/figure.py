"""The options of figures: `Image.to_axes`, `Image.annotated` and `Image.save_figure`."""

from collections.abc import Sequence
from typing import Annotated, Any, TypedDict

from sheetsplat._checks import nearest_names, number, shown, truth
from sheetsplat._matplotlib import fonts, is_mathematics
from sheetsplat.errors import complain, unusable
from sheetsplat.options.checks import optional
from sheetsplat.options.core import CommandLine, Option
from sheetsplat.options.values import Real

_LONGEST = 1000
_LARGEST_FONT, _FINEST = 1000.0, 10_000.0


def _text(what: str, value: object) -> str:
    """Return a text that matplotlib can draw, or InvalidInput."""
    wanted = f"a text of at most {_LONGEST} letters"
    if not isinstance(value, str) or len(value) > _LONGEST or any("\ud800" <= letter <= "\udfff" for letter in value):
        raise complain(unusable(what), shown(value), wanted)
    if not is_mathematics(value):
        wanted = "a text whose parts between dollar signs are TeX"
        raise complain(unusable(what), shown(value), wanted, r"write \$ for a dollar sign")
    return value


def _labels(what: str, value: Any) -> tuple[str, ...]:
    """Return one text, or one for each bar, or InvalidInput."""
    return tuple(_text(what, one) for one in (value if isinstance(value, list | tuple) else [value]))


def _font(what: str, value: object) -> str:
    """Return the name of a font that matplotlib finds, or InvalidInput."""
    known = fonts()
    if not isinstance(value, str) or value.lower() not in known:
        advice = nearest_names(value, known) or 'such as "DejaVu Sans" or "serif"'
        raise complain(unusable(what), shown(value), "a font of this machine", advice)
    return known[value.lower()]


def _at_most(most: float) -> Any:
    def check(what: str, value: object) -> float:
        result = number(what, value)
        if not 0.0 < result <= most:
            raise complain(unusable(what), f"{result:g}", f"a number above 0, at most {most:g}")
        return result

    return check


class AxesOptions(TypedDict, total=False):
    """What stands beside a picture in axes of matplotlib."""

    colorbar: Annotated[
        bool,
        Option(
            "A colour bar in units of the data, logarithmic where the colours are, with a line at each iso value. "
            "Where opacities count, its right half is as transparent as they are beside the largest one.",
            default=True,
            check=truth,
            flag="--colorbar/--no-colorbar",
        ),
    ]
    title: Annotated[
        str | None,
        Option(
            'Text above, which may hold TeX between dollar signs; "": none.',
            unset="the time, of data of several times",
            check=optional(_text),
        ),
    ]
    label: Annotated[
        str | Sequence[str] | None,
        Option(
            "Text beside the colour bar, which may hold TeX; of several bars one for each.",
            unset="name and unit of the data",
            accepts="str or sequence of str",
            check=optional(_labels),
            cli=(
                CommandLine(
                    help="Text beside the colour bar, which may hold TeX; repeated for several bars.", multiple=True
                ),
            ),
        ),
    ]
    font: Annotated[
        str | None,
        Option('Name of a font, such as "DejaVu Serif" or "serif".', unset="matplotlib's", check=optional(_font)),
    ]
    font_size: Annotated[
        float | None,
        Option(
            "Size of letters in points, 1/72 inch.",
            unset="matplotlib's in axes, else 1/36 of the picture's height, 11 to 40 pixels",
            check=optional(_at_most(_LARGEST_FONT)),
            value=Real(above=0.0, most=_LARGEST_FONT),
        ),
    ]


class FigureOptions(AxesOptions, total=False):
    """What a figure of a picture has."""

    axes: Annotated[
        bool,
        Option(
            "Axes in the plane through the camera's target, in coordinates of the data where these have some, else in "
            "world units, and the directions of x, y and z where the view is not along one of them.",
            default=True,
            check=truth,
            # The axes of data have the shorter spelling.
            cli=(CommandLine("--figure-axes/--no-figure-axes", "axes_of_figure", default="--figure-axes"),),
        ),
    ]
    scale_bar: Annotated[
        bool, Option("A bar of a round length in the picture.", default=False, check=truth, switch=True)
    ]
    dpi: Annotated[
        float,
        Option(
            "Pixels of the picture in an inch: how large {font_size} is beside it.",
            default=100.0,
            check=_at_most(_FINEST),
            value=Real(above=0.0, most=_FINEST),
        ),
    ]
