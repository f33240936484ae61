"""Pictures of numbers as FITS: float32, with their unit and linear coordinates in the plane of the camera's target."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sheetsplat.errors import complain, missing_package
from sheetsplat.io.pictures import whole_file

if TYPE_CHECKING:
    from sheetsplat.image import Image

_DIGITS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺", "0123456789-+")
# How FITS writes what units of data have beside letters.
_WORDS = {"·": " ", "×": " ", "☉": "sun", "µ": "u", "μ": "u", "Å": "Angstrom", "°": "deg"}
_POWER_OF_TEN = re.compile(r"\b10([⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺]+)")


def unit_text(unit: str) -> str:
    """Return a unit in the letters of FITS: "10**10 Msun", "g cm-3"."""
    text = _POWER_OF_TEN.sub(r"10**\1", unit).translate(_DIGITS)
    for letter, word in _WORDS.items():
        text = text.replace(letter, word)
    return _ascii(text)


def _ascii(text: str) -> str:
    return text.encode("ascii", "replace").decode()


def _product(unit: str, length: str) -> str:
    """Return the unit of an integral along rays."""
    parts = [f"({one})" if "/" in one else one for one in map(unit_text, (unit, length)) if one]
    return "*".join(parts) if any("/" in one for one in parts) else " ".join(parts)


def cards_of(image: Image) -> dict[str, tuple[Any, str]]:
    """Return the entries of a header, with comments: what the numbers are, and where each pixel lies.

    Pixel (1, 1) is the lower left one; the axes are those of `figure.picture_plane`.
    """
    from sheetsplat.color_bar import common_quantity
    from sheetsplat.figure import picture_plane
    from sheetsplat.modes import TRAITS

    mode, quantity, plane = TRAITS[image.mode], common_quantity(image.recipe.fields), picture_plane(image)
    unit = "" if quantity.floor is not None else quantity.unit
    name = quantity.note or quantity.name or "value"
    cards: dict[str, tuple[Any, str]] = {
        "BTYPE": (_ascii(f"{mode.of_values or 'integral of'} {name}"), "what a pixel is"),
        "BUNIT": (_product(unit, quantity.length_unit) if mode.integrates else unit_text(unit), "unit of a pixel"),
    }
    left, right, bottom, top = plane.extent
    edges = (left, right, image.size[0]), (bottom, top, image.size[1])
    for number, (axis, (first, last, count)) in enumerate(zip(plane.axes, edges, strict=True), 1):
        # Hyphens, from the fifth letter on, would name a projection.
        kind = re.sub(r"\W+", "_", _ascii(axis.name)).upper() or "X"
        cards |= {
            f"CTYPE{number}": (kind, "linear"),
            f"CRPIX{number}": (0.5 * (count + 1), "the middle of the picture"),
            f"CRVAL{number}": (0.5 * (first + last), "coordinate there"),
            f"CDELT{number}": ((last - first) / count, "step of a pixel"),
        }
        if axis.unit:
            cards[f"CUNIT{number}"] = (unit_text(axis.unit), "unit of the coordinate")
    return cards


def save_fits(image: Image, path: Path) -> None:
    """Write the numbers of a picture, its lowest row first; whole or not at all.

    Raises
    ------
    InvalidInput
        For pictures of colours, and where a coordinate is not finite.
    Unsupported
        Where astropy is not installed; it comes with ``pip install "sheetsplat[astro]"``.
    """
    if not image.is_scalar:
        found, wanted = f"mode {image.mode}, which shows colours", "one number a pixel"
        raise complain(f"{path} cannot be written", found, wanted, "take mode xray or another one of numbers, or .png")
    try:
        from astropy.io import fits  # type: ignore[import-not-found, import-untyped, unused-ignore]
    except ImportError as error:
        raise missing_package(f"{path} cannot be written", error) from error
    cards = cards_of(image)
    if not all(math.isfinite(value) for value, _ in cards.values() if isinstance(value, float)):
        raise complain(f"{path} cannot be written", "coordinates that are not finite", "a camera with finite ones")
    table = fits.PrimaryHDU(image.scalar[::-1])
    for name, card in cards.items():
        table.header[name] = card
    if image.camera.kind == "perspective":
        table.header["COMMENT"] = "Coordinates hold at the depth of the camera's target (perspective)."
    with whole_file(path) as made:
        table.writeto(made, overwrite=True)
