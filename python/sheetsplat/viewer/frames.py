"""Pictures as the page takes them: opaque red, green, blue of 8 bits, compressed."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

from sheetsplat._checks import Triple
from sheetsplat.image import Image

# Stages that are soon replaced are compressed with losses, which takes a fourth of the time; the last one is exact.
_JPEG_QUALITY = 88
_FAST = 1
# Pillow's formats are loaded now: a frame must not need a file to be opened.
Pillow.preinit()


def levels(image: Image, background: Triple) -> NDArray[np.uint8]:
    """Return red, green, blue, uint8 (h, w, 3), of a picture over a background."""
    behind = np.asarray(background, np.float32)
    if image.is_scalar:
        colors = image.recipe.options["scalar_colors"]
        table = np.clip(colors.table, 0.0, 1.0)
        rows = (table[:, :3] * table[:, 3:] + behind * (1.0 - table[:, 3:])) * 255.0 + 0.5
        shares = colors.shares(image.scalar, image.clim)
        found: NDArray[np.uint8] = rows.astype(np.uint8)[np.rint(shares * (len(rows) - 1)).astype(np.intp)]
        found[np.isnan(image.scalar)] = (np.clip(behind, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
        return found
    rgba = image.rgba
    # In place: half the time of whole expressions.
    shown = 1.0 - rgba[..., 3:]
    rgb = behind * shown
    rgb += rgba[..., :3]
    np.clip(rgb, 0.0, 1.0, out=rgb)
    rgb *= 255.0
    rgb += 0.5
    return rgb.astype(np.uint8)


def encoded(picture: NDArray[np.uint8], *, exact: bool) -> tuple[str, bytes]:
    """Return the kind, "png" or "jpeg", and the bytes of a compressed picture."""
    stream = io.BytesIO()
    made = Pillow.fromarray(picture)
    if exact:
        made.save(stream, "PNG", compress_level=_FAST)
    else:
        made.save(stream, "JPEG", quality=_JPEG_QUALITY)
    return ("png" if exact else "jpeg"), stream.getvalue()


def error_map(errors: NDArray[np.float32]) -> tuple[bytes, float]:
    """Return a PNG of the errors of pixels, from 0 to the largest, and that one."""
    from sheetsplat.transfer import color_rows

    largest = float(np.nan_to_num(errors).max(initial=0.0)) or 1.0
    table = (color_rows("inferno")[:, :3] * 255.0 + 0.5).astype(np.uint8)
    numbers = np.clip(np.nan_to_num(errors) / largest, 0.0, 1.0) * (len(table) - 1)
    return encoded(table[np.rint(numbers).astype(np.intp)], exact=True)[1], largest
