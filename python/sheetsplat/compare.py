"""Distances between pictures. Conventions, section 8 (Distances between pictures), and FLIP."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sheetsplat import _sheetsplat
from sheetsplat._checks import as_array
from sheetsplat.errors import complain
from sheetsplat.image import Image, pixels_of

Floats = NDArray[np.float32]
_WANTED = "real numbers, (h, w, 4), or (h, w) for scalars"


def _picture(array: Image | ArrayLike, what: str) -> Floats:
    failed = f"compare: the {what} cannot be used"
    found = as_array(failed, pixels_of(array), _WANTED)
    if found.dtype.kind not in "biuf":
        raise complain(failed, f"values of type {found.dtype}", _WANTED)
    with np.errstate(over="ignore"):
        picture = np.ascontiguousarray(found, dtype=np.float32)
    if picture.size == 0 or not (picture.ndim == 2 or (picture.ndim == 3 and picture.shape[2] == 4)):
        raise complain(failed, f"shape {picture.shape}", "(h, w, 4), or (h, w) for scalars")
    return picture


def _displayed(picture: Floats, reference: Floats) -> Floats:
    """Return the picture as a screen shows it over black: (h, w, 3) in [0, 1]."""
    if picture.ndim == 2:
        finite = reference[np.isfinite(reference)]
        low, high = float(finite.min(initial=0.0)), float(finite.max(initial=0.0))
        shares = (picture - low) / (high - low) if low < high else picture
        picture = np.repeat(shares[..., None], 3, axis=2)
    return np.clip(np.nan_to_num(picture[..., :3]), 0.0, 1.0).astype(np.float32)


def compare(picture: Image | ArrayLike, reference: Image | ArrayLike) -> dict[str, float]:
    """Return the distances of a picture from a reference.

    Parameters
    ----------
    picture, reference
        Two pictures of one shape: images, or arrays of premultiplied RGBA (h, w, 4), or of scalars (h, w).

    Returns
    -------
    dict
        "rmse", "p99_9" (99.9th percentile of the largest channel difference of a pixel) and "maximum" as the
        conventions, section 8 (Distances between pictures), define them; "flip", the mean of FLIP (Andersson et al.
        2020) over black. A NaN in only one of the pictures makes the distance infinite.

    Raises
    ------
    InvalidInput
        Where the shapes differ or are not those of pictures.

    Examples
    --------
    >>> from sheetsplat.compare import compare
    >>> image = ss.render(values, size=(32, 32))
    >>> compare(image, image)["rmse"]
    0.0
    """
    first, second = _picture(picture, "picture"), _picture(reference, "reference")
    if first.shape != second.shape:
        raise complain(
            "compare: the pictures cannot be compared",
            f"shapes {first.shape} and {second.shape}",
            "one and the same shape",
        )
    distances = _sheetsplat.compare(first, second, 1 if first.ndim == 2 else 4)
    if _infinitely_far(first, second):
        return {**distances, "flip": math.inf}
    import flip_evaluator  # type: ignore[import-untyped]

    seen, expected = _displayed(first, second), _displayed(second, second)
    _, flip, _ = flip_evaluator.evaluate(expected, seen, "LDR", inputsRGB=True, applyMagma=False)
    return {**distances, "flip": float(flip)}


def _infinitely_far(picture: Floats, reference: Floats) -> bool:
    """Return True where only one of the pictures has a NaN or infinity at some place, which FLIP would not count."""
    odd = ~(np.isfinite(picture) & np.isfinite(reference))
    first, second = picture[odd], reference[odd]
    return bool(np.any((first != second) & ~(np.isnan(first) & np.isnan(second))))
