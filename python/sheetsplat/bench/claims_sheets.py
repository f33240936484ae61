"""Contact sheets: pictures of a benchmark side by side, small enough for a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Bytes of a sheet; the pictures on it become smaller where it would be larger.
_MOST = 100_000
_EDGES = (200, 170, 140, 120)
_GAP = 4


def file_name(*names: str) -> str:
    """Return the name of a picture's file, as `Options.keep` has it."""
    return "-".join("".join(c if c.isalnum() else "_" for c in part) for part in names) + ".png"


def on_white(picture: NDArray[Any]) -> NDArray[np.uint8]:
    """Return premultiplied colours (h, w, 4) on white, 8 bits."""
    shown = picture[..., :3] + (1.0 - picture[..., 3:])
    return np.asarray(np.rint(255.0 * shown.clip(0.0, 1.0)), dtype=np.uint8)


def make_sheet(folder: Path | None, name: str, rows: Sequence[Sequence[Sequence[str]]]) -> None:
    """Write one picture of several in rows; pictures that are not there stay white.

    Parameters
    ----------
    folder
        Where the pictures are, and the sheet will be; None: nowhere.
    name
        Of the sheet's file, without its suffix.
    rows
        Names of pictures, each of several parts.
    """
    if folder is None:
        return
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.png"
    for edge in _EDGES:
        _write(folder, path, rows, edge)
        if path.stat().st_size < _MOST:
            return


def _write(folder: Path, path: Path, rows: Sequence[Sequence[Sequence[str]]], edge: int) -> None:
    """Write the sheet with each picture scaled to `edge` pixels wide and high."""
    from PIL import Image

    step = edge + _GAP
    sheet = Image.new("RGB", (step * max(map(len, rows)) - _GAP, step * len(rows) - _GAP), "white")
    for down, row in enumerate(rows):
        for along, parts in enumerate(row):
            picture = folder / file_name(*parts)
            if not picture.is_file():
                continue
            with Image.open(picture) as opened:
                one = opened.convert("RGBA").resize((edge, edge), Image.Resampling.BICUBIC)
            sheet.paste(one, (along * step, down * step), one)
    sheet.save(path, optimize=True)
