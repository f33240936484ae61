"""Volumes from files, by content and suffix."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from sheetsplat._checks import Triple
from sheetsplat.errors import complain
from sheetsplat.io.source import Source

_RAW_SUFFIXES = (".raw", ".bin", ".dat", ".img", ".vol")
_META_SUFFIXES = (".mhd", ".mha")
_TABLE_SUFFIXES = (".csv", ".tsv", ".txt")

# Formats of files that hold points instead of a regular volume.
SCATTERED = ("plot3d", "hdf5", "vtk", "ply", "csv", "ellipsoids")


@dataclass(frozen=True)
class Volume:
    """What a file holds.

    Attributes
    ----------
    values
        Array of shape (nk, nj, ni).
    spacing, origin
        World units along x, y, z.
    format
        Name of the file format.
    details
        What else the header says, as texts.
    """

    values: NDArray[Any]
    spacing: Triple = (1.0, 1.0, 1.0)
    origin: Triple = (0.0, 0.0, 0.0)
    format: str = ""
    details: dict[str, str] = field(default_factory=dict)


def _suffix(path: Path) -> str:
    return Path(path.stem).suffix.lower() if path.suffix.lower() == ".gz" else path.suffix.lower()


def scattered_format(source: Source, head: bytes, suffix: str) -> str:
    """Return "hdf5", "vtk", "ply" or "csv" for scattered data, "vti" for an image, "" for anything else."""
    if head.startswith(b"\x89HDF\r\n\x1a\n"):
        return "hdf5"
    if head.startswith((b"ply\n", b"ply\r")):
        return "ply"
    if head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith((b"<?xml", b"<VTKFile", b"<!--", b"<!DOCTYPE")):
        from sheetsplat.io import vtk_xml

        return vtk_xml.kind_of(source.head(1 << 14))
    return "csv" if suffix in _TABLE_SUFFIXES and b"\0" not in head and head.strip() else ""


def _format_of(source: Source, *, raw_options: bool) -> str:
    """Return "npy", "npz", "nrrd", "metaimage", "vti", "raw", or one of `SCATTERED`."""
    suffix = _suffix(source.path)
    if raw_options and suffix in _RAW_SUFFIXES:
        return "raw"
    head = source.head(256)
    if head.startswith(b"\x93NUMPY"):
        return "npy"
    if head[:4] in (b"PK\x03\x04", b"PK\x05\x06"):
        return "npz"
    if head.startswith(b"NRRD"):
        return "nrrd"
    first = head.split(b"\n", 1)[0].split(b"=", 1)
    if suffix in _META_SUFFIXES or (len(first) == 2 and first[0].strip() in (b"ObjectType", b"NDims")):
        return "metaimage"
    if raw_options:
        return "raw"
    known = scattered_format(source, head, suffix)
    if known:
        return known
    if suffix in _RAW_SUFFIXES:
        return "raw"
    raise complain(
        f"{source.path} cannot be read",
        "an empty file" if not head else "a format that is not known",
        ".npy, .npz, NRRD, MetaImage (.mhd, .mha), .vti, or raw samples; scattered data as .vtu, .vtp, HDF5, .ply, "
        ".csv or PLOT3D; each also gzipped",
        "for raw samples give their shape and their type, for a PLOT3D solution its grid",
    )


def find_format(path: str | os.PathLike[str], *, raw_options: bool, name: str | None) -> str:
    """Return the format of a file by its content, then by its suffix; one of `SCATTERED` for scattered data.

    An .npz file with an array "centers" holds ellipsoids, unless a `name` asks for one of its arrays.
    """
    with Source(Path(path)) as source:
        found = _format_of(source, raw_options=raw_options)
        if found == "npz" and name is None:
            from sheetsplat.io import tables

            return "ellipsoids" if tables.holds_ellipsoids(source) else found
        return found


def read_volume(
    path: str | os.PathLike[str],
    *,
    shape: tuple[int, int, int] | None = None,
    dtype: DTypeLike | None = None,
    offset: int = 0,
    name: str | None = None,
) -> Volume:
    """Read a volume; the format is found by content, then by suffix, and a gzipped file is unpacked on the way.

    Parameters
    ----------
    path
        .npy, .npz, NRRD (attached or detached data), MetaImage (.mhd, .mha), VTK's .vti or raw samples.
    shape, dtype
        For raw samples: (nk, nj, ni), the order of the array, and their type, with its byte order (">i2").
    offset
        For raw samples: bytes before the first one.
    name
        For .npz: the array to take, where the file has several with three axes. For .vti: the array, one column of one
        (NAME_x), or the length of a vector; the file's own scalars unless given.

    Raises
    ------
    InvalidInput
        For files that are damaged, lie about their size, or hold something else than a real volume with three axes.
    OutOfMemory
        Where the samples do not fit.
    Error
        Where the file cannot be read.
    """
    with Source(Path(path)) as source:
        found = _format_of(source, raw_options=shape is not None or dtype is not None)
        if found != "raw" and (shape is not None or dtype is not None or offset):
            raise complain(
                f"{path} cannot be read with these options",
                f"shape, dtype or offset for a file of format {found}",
                "them only for raw samples; this file says itself what it holds",
            )
        if found not in ("npz", "vti") and name is not None:
            wanted = "it only for .npz and .vti"
            raise complain(f"{path} cannot be read with these options", "name for a single array", wanted)
        if found in ("npy", "npz"):
            from sheetsplat.io import numpy_files

            return numpy_files.read_npy(source) if found == "npy" else numpy_files.read_npz(source, name)
        if found in SCATTERED:
            raise complain(
                f"{path} cannot be read as a volume",
                f"scattered data ({found})",
                "a regular volume",
                "open it with sheetsplat.open, which makes ellipsoids of it",
            )
        if found == "vti":
            from sheetsplat.io import vtk_xml

            return vtk_xml.read_image(source, name)
        if found == "nrrd":
            from sheetsplat.io import nrrd_files

            return nrrd_files.read(source)
        if found == "metaimage":
            from sheetsplat.io import metaimage

            return metaimage.read(source)
        from sheetsplat.io import raw

        return raw.read(source, shape, None if dtype is None else _dtype(dtype), offset)


def _dtype(value: DTypeLike) -> np.dtype[Any]:
    wanted = 'the name of a real type of NumPy: "uint8", "int16", ">i2", "float32" …'
    try:
        dtype = np.dtype(value)
    except TypeError:
        raise complain("the type of the samples cannot be used", repr(value), wanted) from None
    if dtype.kind not in "biuf":
        raise complain("the type of the samples cannot be used", str(dtype), wanted)
    return dtype
