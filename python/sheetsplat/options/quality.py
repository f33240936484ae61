"""The option that sets what other options leave open: what a picture is worth."""

from typing import Annotated, Literal, TypedDict, get_args

from sheetsplat.options.checks import one_of
from sheetsplat.options.core import Option

QualityName = Literal["draft", "good", "best"]
QUALITIES: tuple[str, ...] = get_args(QualityName)


class QualityOptions(TypedDict, total=False):
    """The quality of a picture, which sets other options."""

    quality: Annotated[
        QualityName,
        Option(
            "Quality of the picture. Sets those of {radius}, {falloff}, {prefilter}, {slice_spacing}, {opacity_stop}, "
            '{supersampling} and {filter} that are not given; the plan says what, and why. "draft": the fastest; '
            '"good": values pass through the samples, without visible steps; "best": near the limit of finer settings.',
            default="good",
            check=one_of(QualityName),
        ),
    ]
