"""Pictures of the rows, kept in the folder that ``--pictures`` names, and contact sheets of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

import sheetsplat as ss
from bench.report import Options

# Largest size of a contact sheet, bytes; its pictures are made smaller until it fits.
_MOST = 100_000
_EDGES = (200, 170, 140, 120)
_GAP = 4
# Of labelled sheets.
_ACROSS = 9
_SMALL_EDGE = 128
_LABEL = 14


def file_name(*names: str) -> str:
    """Return the name of the file of a picture whose name has several parts."""
    return "-".join("".join(c if c.isalnum() else "_" for c in part) for part in names) + ".png"


def keep(options: Options, picture: ss.Image | NDArray[Any], *names: str) -> None:
    """Save a picture where pictures are wanted; arrays of premultiplied colours (h, w, 4) are put on white."""
    if options.pictures is None:
        return
    options.pictures.mkdir(parents=True, exist_ok=True)
    path = options.pictures / file_name(*names)
    if isinstance(picture, ss.Image):
        picture.save(path)
    else:
        shown = picture[..., :3] + (1.0 - picture[..., 3:])
        Image.fromarray(np.rint(255.0 * shown.clip(0.0, 1.0)).astype(np.uint8)).save(path)


def keep_columns(options: Options, columns: Sequence[Sequence[NDArray[Any]]], *names: str) -> None:
    """Save pictures of one size on black: each sequence from top to bottom, the sequences from left to right."""
    rows = np.concatenate([np.concatenate(column) for column in columns], axis=1)
    rows[..., 3] = 1.0
    keep(options, rows, *names)


def make_sheet(options: Options, name: str, rows: Sequence[Sequence[Sequence[str]]]) -> None:
    """Write a contact sheet NAME.png of saved pictures, given as rows of names; missing pictures stay white."""
    if options.pictures is None:
        return
    options.pictures.mkdir(parents=True, exist_ok=True)
    path = options.pictures / f"{name}.png"
    for edge in _EDGES:
        _write(options.pictures, path, rows, edge)
        if path.stat().st_size < _MOST:
            return


def _write(folder: Path, path: Path, rows: Sequence[Sequence[Sequence[str]]], edge: int) -> None:
    """Write the contact sheet with each picture scaled to `edge` pixels in width and height."""
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


def make_labelled_sheet(options: Options, name: str, columns: Sequence[tuple[str, Sequence[Sequence[str]]]]) -> None:
    """Write a contact sheet NAME.jpg of saved pictures: each column has a label, then its pictures on white.

    A picture is given by the parts of its name; missing ones stay white. Columns continue below where a line is full.
    """
    if options.pictures is None:
        return
    high = max(len(pictures) for _, pictures in columns)
    step = _SMALL_EDGE + _GAP
    block = _LABEL + high * step + _GAP
    lines = -(-len(columns) // _ACROSS)
    sheet = Image.new("RGB", (step * min(len(columns), _ACROSS) - _GAP, block * lines - _GAP), "white")
    pen = ImageDraw.Draw(sheet)
    for number, (label, pictures) in enumerate(columns):
        left, top = step * (number % _ACROSS), block * (number // _ACROSS)
        pen.text((left + 2, top), label, fill="black")
        for down, parts in enumerate(pictures):
            picture = options.pictures / file_name(*parts)
            if picture.is_file():
                with Image.open(picture) as opened:
                    one = opened.convert("RGBA").resize((_SMALL_EDGE, _SMALL_EDGE), Image.Resampling.BICUBIC)
                sheet.paste(one, (left, top + _LABEL + down * step), one)
    options.pictures.mkdir(parents=True, exist_ok=True)
    sheet.save(options.pictures / f"{name}.jpg", quality=85)
