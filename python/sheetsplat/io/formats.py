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
_ZIP = (b"PK\x03\x04", b"PK\x05\x06")
_XML = (b"<?xml", b"<VTKFile", b"<!--", b"<!DOCTYPE")
# Bytes in which the root element of an XML file is looked for.
_XML_HEAD = 1 << 14


@dataclass(frozen=True)
class Start:
    """What a format is recognized by.

    Attributes
    ----------
    source
        The file, gzipped ones unpacked.
    head
        Its first 256 bytes.
    suffix
        Of its name, in small letters; .gz does not count.
    """

    source: Source
    head: bytes
    suffix: str

    @staticmethod
    def of(source: Source) -> Start:
        """Return the start of a file."""
        path = source.path
        suffix = Path(path.stem).suffix if path.suffix.lower() == ".gz" else path.suffix
        return Start(source, source.head(256), suffix.lower())


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
        Whether a file is of this format, by its start.
    options
        Keyword arguments that the reader takes.
    scattered
        Whether it holds scattered data instead of a regular volume.
    beats_raw
        Whether it is recognized even where the caller describes raw samples by shape and dtype.
    """

    name: str
    reader: str
    recognizes: Callable[[Start], bool] = lambda _: False
    options: tuple[str, ...] = ()
    scattered: bool = False
    beats_raw: bool = False

    def read(self, source: Source, **options: Any) -> Any:
        """Return what the reader makes of a file."""
        return pkgutil.resolve_name(self.reader)(source, **options)


def _begins(*signatures: bytes) -> Callable[[Start], bool]:
    return lambda start: start.head.startswith(signatures)


def _is_metaimage(start: Start) -> bool:
    key, equals, _ = start.head.split(b"\n", 1)[0].partition(b"=")
    return start.suffix in _META_SUFFIXES or (bool(equals) and key.strip() in (b"ObjectType", b"NDims"))


def _is_table(start: Start) -> bool:
    return start.suffix in _TABLE_SUFFIXES and b"\0" not in start.head and bool(start.head.strip())


def _is_vtk_xml(start: Start) -> bool:
    first = start.head.lstrip(b"\xef\xbb\xbf \t\r\n")
    return first.startswith(_XML) and b"<VTKFile" in start.source.head(_XML_HEAD)


def _is_vtk_image(start: Start) -> bool:
    head = start.source.head(_XML_HEAD) if _is_vtk_xml(start) else b""
    return b'"ImageData"' in head or b"'ImageData'" in head


_IO = "sheetsplat.io."
# The first that recognizes a file reads it.
FORMATS: tuple[Format, ...] = (
    Format("npy", _IO + "numpy_files:read_npy", _begins(b"\x93NUMPY"), beats_raw=True),
    Format("npz", _IO + "numpy_files:read_npz", _begins(*_ZIP), ("name",), beats_raw=True),
    Format("nrrd", _IO + "nrrd_files:read", _begins(b"NRRD"), beats_raw=True),
    Format("metaimage", _IO + "metaimage:read", _is_metaimage, beats_raw=True),
    Format(
        "hdf5",
        _IO + "sph_hdf5:read",
        _begins(b"\x89HDF\r\n\x1a\n"),
        ("scalar", "particles", "support"),
        scattered=True,
    ),
    Format("ply", _IO + "gaussian_ply:read", _begins(b"ply\n", b"ply\r"), ("scalar",), scattered=True),
    Format("vti", _IO + "vtk_xml.images:read", _is_vtk_image, ("name",)),
    Format("vtk", _IO + "vtk_xml.meshes:read", _is_vtk_xml, ("scalar",), scattered=True),
    Format("csv", _IO + "tables:read_csv", _is_table, ("scalar",), scattered=True),
    Format("raw", _IO + "raw:read", lambda start: start.suffix in _RAW_SUFFIXES, ("shape", "dtype", "offset")),
    # Recognized by `find_format` alone: by the arrays of an .npz, and by the grid that the caller gives.
    Format("ellipsoids", _IO + "tables:read_npz", options=("scalar",), scattered=True),
    Format("plot3d", _IO + "plot3d:read", options=("grid", "scalar"), scattered=True),
)
_BY_NAME = {one.name: one for one in FORMATS}
#: Formats of files that hold points instead of a regular volume.
SCATTERED = tuple(one.name for one in FORMATS if one.scattered)


def format_of(source: Source, *, raw_options: bool = False) -> Format:
    """Return the format of a file by its content, then by its suffix; InvalidInput where there is none."""
    start = Start.of(source)
    if raw_options and start.suffix in _RAW_SUFFIXES:
        return _BY_NAME["raw"]
    for one in FORMATS:
        if (one.beats_raw or not raw_options) and one.recognizes(start):
            return one
    if raw_options:
        return _BY_NAME["raw"]
    raise complain(
        f"{source.path} cannot be read",
        "an empty file" if not start.head else "a format that is not known",
        ".npy, .npz, NRRD, MetaImage (.mhd, .mha), .vti, or raw samples; scattered data as .vtu, .vtp, HDF5, .ply, "
        ".csv or PLOT3D; each also gzipped",
        "for raw samples give their shape and their type, for a PLOT3D solution its grid",
    )


def find_format(path: str | os.PathLike[str], *, raw_options: bool, name: str | None, grid: bool = False) -> str:
    """Return the format of a file by its content, then by its suffix; one of `SCATTERED` for scattered data.

    Parameters
    ----------
    path
        The file.
    raw_options
        Whether the caller describes raw samples.
    name
        The array of an .npz file that the caller asks for. Without one, a file with an array "centers" holds
        ellipsoids.
    grid
        Whether the caller gives a PLOT3D grid.
    """
    if grid:
        return "plot3d"
    with Source(Path(path)) as source:
        found = format_of(source, raw_options=raw_options).name
        if found == "npz" and name is None:
            from sheetsplat.io import tables

            return "ellipsoids" if tables.holds_ellipsoids(source) else found
        return found


def format_named(name: str) -> Format:
    """Return the format of a name."""
    return _BY_NAME[name]
