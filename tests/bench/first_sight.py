"""Every measured set and kind of data in one line: time, error, how it fills the picture, beside PyVista's default."""

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
from bench.kinds import KINDS, Kind, off_interpolation
from bench.measure import clock, data_file, in_new_process, measured_rows
from bench.pictures import file_name, keep, make_labelled_sheet
from bench.pyvista_default import draw, is_installed
from bench.report import Options, Report, Row, columns
from sheetsplat.api import prepare
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

#: Names of the sets and kinds that can be shown alone.
ROWS = (*SETS, *KINDS)

# Samples along an edge of generated data.
_EDGE = 64


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


def _kind_row(options: Options, name: str, one: Kind) -> Row:
    """Show a kind of data in each quality, a time series by its last step; its command line is in the row."""
    edge = options.edge(_EDGE)
    steps = [one.make(edge, step) for step in range(one.steps)] if one.steps > 1 else [one.make(edge)]
    row: Row = {"subject": one.subject, "line": one.line(name), "command": one.command(name)}
    for quality in QUALITIES:
        options.say(f"{name}: {quality}")
        settings: Any = {"size": options.size, "backend": options.backend, "quality": quality, **one.options}

        def show(settings: Any = settings) -> ss.Image:
            return ss.animate(steps, **settings)[one.steps - 1] if one.steps > 1 else ss.render(steps[0], **settings)

        picture, wall, _ = clock(show)
        keep(options, picture, "first_sight", name, quality)
        row[f"{quality}_s"] = wall
        row[f"{quality}_error"] = picture.error.rmse
        if quality == "good":
            row |= _seen(picture)
            row["low"], row["high"] = picture.clim
    plain: Any = prepare(steps[-1], quality="good", log=False, size=8, **one.options).scene.fields[0]
    row["off"] = off_interpolation(steps[-1], plain)
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.npy"
        np.save(path, steps[-1])
        return row | _by_pyvista(options, name, path, None)


def _beside(options: Options, name: str, one: _Set) -> Row:
    """Show a set by PyVista."""
    grid = None if one.grid is None else data_file(options, one.grid)
    return _by_pyvista(options, name, data_file(options, one.file), grid)


def _by_pyvista(options: Options, name: str, path: Path, grid: Path | None) -> Row:
    """Show a file by PyVista, in a process of its own."""
    if not is_installed():
        return {"pyvista": "not installed"}
    options.say(f"{name}: PyVista")
    with TemporaryDirectory() as folder:
        picture = (options.pictures or Path(folder)) / file_name("first_sight", name, "pyvista")
        picture.parent.mkdir(parents=True, exist_ok=True)
        try:
            found = in_new_process(
                draw,
                path=str(path),
                grid=None if grid is None else str(grid),
                size=list(options.size),
                output=str(picture.resolve()),
            )
        except ss.Error as error:
            return {"pyvista": "failed", "remark": f"PyVista: {str(error).strip().splitlines()[-1]}"}
    return {"pyvista": found["seconds"] if "seconds" in found else found["reason"]}


def run(options: Options) -> Report:
    """Show the sets and kinds that are wanted."""
    rows = measured_rows(options, SETS, partial(_row, options))
    rows += measured_rows(options, KINDS, partial(_kind_row, options))
    report = Report(
        name="first_sight",
        title=f"Every set and kind of data in one line, {options.size[0]}x{options.size[1]}",
        columns=columns(
            "row=set, subject=what is seen, "
            + ", ".join(f"{quality}_s={quality}: s, {quality}_error=error" for quality in QUALITIES)
            + ", shown, filled, low, high, off, pyvista=PyVista: s, remark"
        ),
        rows=rows,
        notes=[
            "s: seconds of ss.render(path, quality=...) in the same process, reading included. error: rmse of "
            "image.error. shown: share of the pixels whose opacity is above a tenth; filled: their box's longer side "
            "over the picture's shorter side; both of the quality good.",
            f"Kinds of data are generated, {_EDGE} samples along an edge. low, high: limits of the colours. off: rmse "
            "between the field of the quality good and the cubic spline through its samples at 10,000 random places, "
            "as a share of the samples' range.",
            "PyVista: its reader, then add_volume for images and add_mesh for all else, without options, in a new "
            "process; seconds from before the reader to the screenshot. Gzipped files are decompressed before.",
        ],
    )
    for sheet, names in (("first_sight", SETS), ("kinds_of_data", KINDS)):
        pictures = [(name, [("first_sight", name, which) for which in ("good", "pyvista")]) for name in names]
        make_labelled_sheet(options, sheet, pictures)
    _write_page(options, report)
    return report


def _write_page(options: Options, report: Report) -> None:
    """Write a page of the pictures, one set or kind a line, beside them."""
    if options.pictures is None:
        return
    columns = (*QUALITIES, "pyvista")
    lines = []
    for row in report.rows:
        name = row["row"]
        told = [(SETS.get(name) or KINDS[name]).subject]
        told += [KINDS[name].line(name), KINDS[name].command(name)] if name in KINDS else []
        cells = [f"<td><b>{html.escape(name)}</b><br>{'<br>'.join(map(html.escape, told))}</td>"]
        for quality in columns:
            file = file_name("first_sight", row["row"], quality)
            found = (options.pictures / file).is_file()
            seconds, error = row.get(f"{quality}_s", row.get(quality)), row.get(f"{quality}_error")
            figures = f"{seconds:.2f} s" if isinstance(seconds, float) else str(seconds or row.get("remark", ""))
            figures += f", error {error:.1e}" if error is not None else ""
            cells.append(f"<td>{f'<img src={file!r}>' if found else ''}<br>{html.escape(figures)}</td>")
        lines.append("<tr>" + "".join(cells) + "</tr>")
    head = "".join(f"<th>{name}</th>" for name in ("", *columns))
    title = html.escape(report.title)
    page = f"<!doctype html><meta charset=utf-8><title>{title}</title><h1>{title}</h1>"
    page += f"<table><tr>{head}</tr>{''.join(lines)}</table>"
    options.pictures.mkdir(parents=True, exist_ok=True)
    (options.pictures / "first_sight.html").write_text(page, encoding="utf-8")
