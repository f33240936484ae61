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


def _format_of(source: Source, *, raw_options: bool) -> str:
    """Return "npy", "npz", "nrrd", "metaimage" or "raw"."""
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
    if raw_options or suffix in _RAW_SUFFIXES:
        return "raw"
    raise complain(
        f"{source.path} cannot be read",
        "an empty file" if not head else "a format that is not known",
        ".npy, .npz, NRRD, MetaImage (.mhd, .mha), or raw samples; each also gzipped",
        "for raw samples give their shape and their type",
    )


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
        .npy, .npz, NRRD (attached or detached data), MetaImage (.mhd, .mha) or raw samples.
    shape, dtype
        For raw samples: (nk, nj, ni), the order of the array, and their type, with its byte order (">i2").
    offset
        For raw samples: bytes before the first one.
    name
        For .npz: the array to take, where the file has several with three axes.

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
        if found != "npz" and name is not None:
            raise complain(f"{path} cannot be read with these options", "name for a single array", "it only for .npz")
        if found in ("npy", "npz"):
            from sheetsplat.io import numpy_files

            return numpy_files.read_npy(source) if found == "npy" else numpy_files.read_npz(source, name)
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
