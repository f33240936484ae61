"""File formats: how each is recognized, and which reader reads it."""

from __future__ import annotations

import os
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sheetsplat.errors import complain
from sheetsplat.io.source import Source

_RAW_SUFFIXES = (".raw", ".bin", ".dat", ".img", ".vol")
_META_SUFFIXES = (".mhd", ".mha")
_TABLE_SUFFIXES = (".csv", ".tsv", ".txt")
_HDF5 = b"\x89HDF\r\n\x1a\n"
_ZIP = (b"PK\x03\x04", b"PK\x05\x06")
_XML = (b"<?xml", b"<VTKFile", b"<!--", b"<!DOCTYPE")
# Bytes by which a format is recognized.
_HEAD = 256
# Bytes in which the root element of an XML file, or the elements of a PLY file, are looked for.
_LONG_HEAD = 1 << 14


@dataclass(frozen=True)
class Format:
    """A file format and its reader.

    Attributes
    ----------
    name
        Short name.
    reader
        "module:function", imported when a file is read. The function takes a `Source` and `options`, and returns a
        `Volume`, or `Scattered` for scattered data.
    recognizes
        Whether a file is of this format, by its first bytes or its suffix.
    options
        Keyword arguments that the reader takes.
    scattered
        Whether it holds scattered data instead of a regular volume.
    beats_raw
        Whether it is recognized although the caller gives shape and dtype of raw samples.
    shown
        How lists of formats name it.
    """

    name: str
    reader: str
    recognizes: Callable[[Source], bool] = lambda _: False
    options: tuple[str, ...] = ()
    scattered: bool = False
    beats_raw: bool = False
    shown: str = ""

    def read(self, source: Source, **options: Any) -> Any:
        """Return what the reader makes of a file."""
        return pkgutil.resolve_name(self.reader)(source, **options)


def _begins(*signatures: bytes) -> Callable[[Source], bool]:
    return lambda source: source.head(_HEAD).startswith(signatures)


def _is_metaimage(source: Source) -> bool:
    key, equals, _ = source.head(_HEAD).split(b"\n", 1)[0].partition(b"=")
    return source.suffix in _META_SUFFIXES or (bool(equals) and key.strip() in (b"ObjectType", b"NDims"))


def _is_table(source: Source) -> bool:
    return source.suffix in _TABLE_SUFFIXES and b"\0" not in source.head(_HEAD) and bool(source.head(_HEAD).strip())


def _is_vtk_xml(source: Source) -> bool:
    first = source.head(_HEAD).lstrip(b"\xef\xbb\xbf \t\r\n")
    return first.startswith(_XML) and b"<VTKFile" in source.head(_LONG_HEAD)


def _is_vtk_image(source: Source) -> bool:
    head = source.head(_LONG_HEAD) if _is_vtk_xml(source) else b""
    return b'"ImageData"' in head or b"'ImageData'" in head


def _is_mesh(source: Source) -> bool:
    head = source.head(_LONG_HEAD)
    if head.startswith((b"ply\n", b"ply\r")):
        header = head.partition(b"end_header")[0]
        return b"element face" in header and b" scale_0" not in header
    return source.suffix == ".obj" and b"\0" not in head and bool(head.strip())


_IO = "sheetsplat.io."
# The first format that recognizes a file is used.
FORMATS: tuple[Format, ...] = (
    Format("npy", _IO + "numpy_files:read_npy", _begins(b"\x93NUMPY"), beats_raw=True, shown=".npy"),
    Format("npz", _IO + "numpy_files:read_npz", _begins(*_ZIP), ("name",), beats_raw=True, shown=".npz"),
    Format("nrrd", _IO + "nrrd_files:read", _begins(b"NRRD"), beats_raw=True, shown="NRRD"),
    Format("metaimage", _IO + "metaimage:read", _is_metaimage, beats_raw=True, shown="MetaImage (.mhd, .mha)"),
    Format(
        "hdf5",
        _IO + "sph_hdf5:read",
        _begins(_HDF5),
        ("scalar", "particles", "support"),
        scattered=True,
        shown="HDF5 with particles",
    ),
    Format("mesh", _IO + "triangle_meshes:read", _is_mesh, scattered=True, shown=".obj and .ply of closed meshes"),
    Format(
        "ply",
        _IO + "gaussian_ply:read",
        _begins(b"ply\n", b"ply\r"),
        ("scalar",),
        scattered=True,
        shown=".ply of 3D Gaussian Splatting",
    ),
    Format("vti", _IO + "vtk_xml.images:read", _is_vtk_image, ("name",), shown=".vti"),
    Format("vtk", _IO + "vtk_xml.meshes:read", _is_vtk_xml, ("scalar",), scattered=True, shown=".vtu, .vtp"),
    Format("csv", _IO + "tables:read_csv", _is_table, ("scalar",), scattered=True, shown=".csv"),
    Format(
        "raw",
        _IO + "raw:read",
        lambda source: source.suffix in _RAW_SUFFIXES,
        ("shape", "dtype", "offset"),
        shown="raw samples",
    ),
    # Recognized only by `find_format`: by the arrays of an .npz, and by the grid of the caller.
    Format(
        "ellipsoids",
        _IO + "tables:read_npz",
        options=("scalar",),
        scattered=True,
        shown=".npz with an array centers",
    ),
    Format(
        "plot3d", _IO + "plot3d:read", options=("grid", "scalar"), scattered=True, shown="PLOT3D solutions with a grid"
    ),
)
#: All formats by their names.
BY_NAME = {one.name: one for one in FORMATS}
#: Formats of files that hold points instead of a regular volume.
SCATTERED = tuple(one.name for one in FORMATS if one.scattered)
#: What formats of regular volumes, and those of scattered data, are called in messages.
LISTED_REGULAR = ", ".join(one.shown for one in FORMATS if not one.scattered)
LISTED_SCATTERED = ", ".join(one.shown for one in FORMATS if one.scattered)


def format_of(source: Source, *, raw_options: bool = False) -> Format:
    """Return the format of a file by its content, then by its suffix; InvalidInput where there is none."""
    if raw_options and source.suffix in _RAW_SUFFIXES:
        return BY_NAME["raw"]
    for one in FORMATS:
        if (one.beats_raw or not raw_options) and one.recognizes(source):
            return one
    if raw_options:
        return BY_NAME["raw"]
    raise complain(
        f"{source.path} cannot be read",
        "an empty file" if not source.head(_HEAD) else "a format that is not known",
        f"{LISTED_REGULAR}; scattered data as {LISTED_SCATTERED}; each also gzipped",
        "for raw samples give their shape and their type, for a PLOT3D solution its grid",
    )


def find_format(path: str | os.PathLike[str], *, raw_options: bool, name: str | None, grid: bool = False) -> str:
    """Return the format of a file by its content, then by its suffix; one of `SCATTERED` for scattered data.

    `raw_options` says whether the caller describes raw samples, `grid` whether a PLOT3D grid is given. An .npz file
    with an array "centers" holds ellipsoids unless the caller gives the `name` of an array.
    """
    if grid:
        return "plot3d"
    with Source(Path(path)) as source:
        found = format_of(source, raw_options=raw_options).name
        if found == "npz" and name is None:
            from sheetsplat.io import tables

            return "ellipsoids" if tables.holds_ellipsoids(source) else found
        return found
