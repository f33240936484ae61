"""The option that sets what other options leave open: what a picture is worth."""

from typing import Annotated, Literal, TypedDict, get_args

from sheetsplat.options.checks import one_of
from sheetsplat.options.core import Option

QualityName = Literal["draft", "good", "best"]
QUALITIES: tuple[str, ...] = get_args(QualityName)


class QualityOptions(TypedDict, total=False):
    """What a picture is worth."""

    quality: Annotated[
        QualityName,
        Option(
            "What a picture is worth. It sets what is not given of {radius}, {falloff}, {prefilter}, {slice_spacing}, "
            '{opacity_stop} and {filter}; the plan says what, and why. "draft": the fastest; "good": through the '
            'samples, without steps; "best": near the limit of all of these.',
            default="good",
            check=one_of(QualityName),
        ),
    ]
