"""Every set of the data folder in one line: time, error, and how it fills the picture, beside PyVista's default."""

from __future__ import annotations

import html
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import sheetsplat as ss
from bench.measure import clock, data_file, in_new_process, measured_rows
from bench.pictures import file_name, keep, make_labelled_sheet
from bench.pyvista_default import draw, is_installed
from bench.report import Options, Report, Row, columns
from sheetsplat.options.quality import QUALITIES

# A pixel shows something where its opacity is above this.
_SHOWS = 0.1


@dataclass(frozen=True)
class _Set:
    """A set of data: its file, the grid of a PLOT3D solution, and what a reader should see."""

    file: str
    subject: str
    grid: str | None = None

    def options(self, options: Options) -> dict[str, Any]:
        """Return the options without which the file cannot be read."""
        return {} if self.grid is None else {"grid": data_file(options, self.grid)}


#: The sets by the names of their rows.
SETS: Mapping[str, _Set] = {
    "aneurism": _Set("aneurism_256x256x256_uint8.nrrd", "arteries of a head, with an aneurysm"),
    "aneurism 128": _Set("aneurism_128x128x128_uint8.nrrd", "the same, half the samples along each axis"),
    "bonsai": _Set("bonsai_256x256x256_uint8.nrrd", "a tree in a pot"),
    "cthead": _Set("cthead_256x256x113_uint8.nrrd", "a head"),
    "cthead 128": _Set("cthead_128x128x113_uint8.nrrd", "the same, with cubes as voxels"),
    "engine": _Set("engine_256x256x128_uint8.nrrd", "an engine block with two cylinders"),
    "hydrogen": _Set("hydrogen_64x64x64_float32.nrrd", "an orbital: two lobes and a ring"),
    "lcdm": _Set("lcdm_128x128x128_uint8.nrrd", "filaments and knots of a cosmological density"),
    "lobster": _Set("lobster_120x120x34_uint8.nrrd", "a lobster"),
    "mrbrain": _Set("mrbrain_128x128x84_uint8.nrrd", "a head with the brain laid open"),
    "nucleon": _Set("nucleon_41x41x41_uint8.nrrd", "shells of a distribution"),
    "silicium": _Set("silicium_98x34x34_uint8.nrrd", "a lattice of atoms"),
    "stent": _Set("stent_128x128x256_int16.nrrd", "a wire mesh beside a spine"),
    "tooth": _Set("tooth_103x94x161_uint8.nrrd", "a tooth"),
    "turbulent combustion": _Set("turbulent_combustion_128x256x32_uint8.nrrd", "a plane jet"),
    "vismale": _Set("vismale_128x256x256_uint8.nrrd", "a head"),
    "blunt fin": _Set("bluntfinq.bin.gz", "a shock in front of a fin", "bluntfinxyz.bin.gz"),
    "combustor": _Set("combq.bin.gz", "dense jets that enter a chamber", "combxyz.bin.gz"),
    "fire": _Set("fire_ug.vtu.gz", "a plume and the hot layer that it feeds"),
    "galaxy": _Set("sph_gas_nchilada12M.h5", "a disk of gas"),
    "guitar": _Set("3dgs_guitar.ply.gz", "a guitar"),
    "knight": _Set("mesh_chess_knight.obj", "a knight of a game of chess"),
    "cannon": _Set("mesh_toy_cannon.obj", "a toy cannon"),
    "cow": _Set("mesh_spot.obj", "a cow"),
    "bunny": _Set("mesh_bunny.ply.gz", "a bunny"),
}

#: Names of the sets that can be shown alone.
ROWS = tuple(SETS)


def _seen(picture: ss.Image) -> Row:
    """Return the share of pixels that show something, and how far their box fills the shorter side."""
    alpha = picture.rgba[..., 3] > _SHOWS
    rows, across = np.flatnonzero(alpha.any(axis=1)), np.flatnonzero(alpha.any(axis=0))
    if not rows.size:
        return {"shown": 0.0, "filled": 0.0}
    reach = max(np.ptp(rows), np.ptp(across)) + 1
    return {"shown": float(alpha.mean()), "filled": float(reach / min(alpha.shape))}


def _row(options: Options, name: str, one: _Set) -> Row:
    """Show a set in each quality; reading, choosing the look and drawing count, as they do in the one line."""
    path, given = data_file(options, one.file), one.options(options)
    row: Row = {"subject": one.subject}
    for quality in QUALITIES:
        options.say(f"{name}: {quality}")
        settings: Any = {"size": options.size, "backend": options.backend, "quality": quality, **given}
        picture, wall, _ = clock(partial(ss.render, path, **settings))
        keep(options, picture, "first_sight", name, quality)
        row[f"{quality}_s"] = wall
        row[f"{quality}_error"] = picture.error.rmse
        if quality == "good":
            row |= _seen(picture)
    return row | _beside(options, name, one)


def _beside(options: Options, name: str, one: _Set) -> Row:
    """Show a set by PyVista, in a process of its own."""
    if not is_installed():
        return {"pyvista": "not installed"}
    options.say(f"{name}: PyVista")
    grid = None if one.grid is None else str(data_file(options, one.grid))
    with TemporaryDirectory() as folder:
        picture = (options.pictures or Path(folder)) / file_name("first_sight", name, "pyvista")
        picture.parent.mkdir(parents=True, exist_ok=True)
        try:
            found = in_new_process(
                draw,
                path=str(data_file(options, one.file)),
                grid=grid,
                size=list(options.size),
                output=str(picture.resolve()),
            )
        except ss.Error as error:
            return {"pyvista": "failed", "remark": f"PyVista: {str(error).strip().splitlines()[-1]}"}
    return {"pyvista": found["seconds"] if "seconds" in found else found["reason"]}


def run(options: Options) -> Report:
    """Show the sets that are wanted."""
    rows = measured_rows(options, SETS, partial(_row, options))
    report = Report(
        name="first_sight",
        title=f"Every set in one line, {options.size[0]}x{options.size[1]}",
        columns=columns(
            "row=set, subject=what is seen, "
            + ", ".join(f"{quality}_s={quality}: s, {quality}_error=error" for quality in QUALITIES)
            + ", shown, filled, pyvista=PyVista: s, remark"
        ),
        rows=rows,
        notes=[
            "s: seconds of ss.render(path, quality=...) in the same process, reading included. error: rmse of "
            "image.error. shown: share of the pixels whose opacity is above a tenth; filled: their box's longer side "
            "over the picture's shorter side; both of the quality good.",
            "PyVista: its reader, then add_volume for images and add_mesh for all else, without options, in a new "
            "process; seconds from before the reader to the screenshot. Gzipped files are decompressed before.",
        ],
    )
    make_labelled_sheet(
        options,
        "first_sight",
        [(name, [("first_sight", name, "good"), ("first_sight", name, "pyvista")]) for name in SETS],
    )
    _write_page(options, report)
    return report


def _write_page(options: Options, report: Report) -> None:
    """Write a page of the pictures, one set a line, beside them."""
    if options.pictures is None:
        return
    columns = (*QUALITIES, "pyvista")
    lines = []
    for row in report.rows:
        cells = [f"<td><b>{html.escape(row['row'])}</b><br>{html.escape(SETS[row['row']].subject)}</td>"]
        for quality in columns:
            file = file_name("first_sight", row["row"], quality)
            found = (options.pictures / file).is_file()
            seconds, error = row.get(f"{quality}_s", row.get(quality)), row.get(f"{quality}_error")
            told = f"{seconds:.2f} s" if isinstance(seconds, float) else str(seconds or row.get("remark", ""))
            told += f", error {error:.1e}" if error is not None else ""
            cells.append(f"<td>{f'<img src={file!r}>' if found else ''}<br>{html.escape(told)}</td>")
        lines.append("<tr>" + "".join(cells) + "</tr>")
    head = "".join(f"<th>{name}</th>" for name in ("", *columns))
    title = html.escape(report.title)
    page = f"<!doctype html><meta charset=utf-8><title>{title}</title><h1>{title}</h1>"
    page += f"<table><tr>{head}</tr>{''.join(lines)}</table>"
    options.pictures.mkdir(parents=True, exist_ok=True)
    (options.pictures / "first_sight.html").write_text(page, encoding="utf-8")
