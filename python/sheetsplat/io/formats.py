"""File formats: how each is recognized, and which reader reads it."""

from __future__ import annotations

import functools
import importlib.metadata
import logging
import os
import pkgutil
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from sheetsplat.errors import complain
from sheetsplat.io.source import Folder, Source, hdf5_start, opened

_RAW_SUFFIXES = (".raw", ".bin", ".dat", ".img", ".vol")
_META_SUFFIXES = (".mhd", ".mha")
_TABLE_SUFFIXES = (".csv", ".tsv", ".txt")
_MESHIO = (".msh", ".med", ".xdmf", ".xmf")
_NETCDF = (b"CDF\x01", b"CDF\x02", b"CDF\x05")
# Files of a folder by which its format is recognized: where all must be of it, and where others may lie beside them.
_FEW, _MANY = 3, 200
_ZIP = (b"PK\x03\x04", b"PK\x05\x06")
_XML = (b"<?xml", b"<VTKFile", b"<!--", b"<!DOCTYPE")
_VTK_TYPE = re.compile(rb"<VTKFile[^>]*\stype\s*=\s*[\"']([A-Za-z]{1,40})[\"']")
# Types of DICOM's elements whose lengths have four bytes, behind two that are not used.
_LONG_VALUES = (b"OB", b"OW", b"SQ", b"UN", b"UT")
#: Names of what is read in bricks alone.
PARQUET = (".parquet", ".pq")
_IN_BRICKS = "Parquet is read in bricks: by sheetsplat.open_bricks, on the command line with --brick or --workers"
#: Entry points by which other packages add formats.
ENTRY_POINTS = "sheetsplat.readers"
# Bytes by which a format is recognized.
_HEAD = 256
# Bytes in which the root element of an XML file, or the elements of a PLY file, are looked for.
_LONG_HEAD = 1 << 14

_log = logging.getLogger("sheetsplat")


@dataclass(frozen=True)
class Format:
    """A file format and its reader.

    Attributes
    ----------
    name
        Short name.
    reader
        "module:function", imported when a file is read. The function takes a `Source`, or a `Folder`, and `options`,
        and returns a `Volume`, a list of these, its channels, or `Scattered` for scattered data.
    recognizes
        Whether a file is of this format, by its first bytes or its suffix.
    recognizes_folder
        Whether a folder is.
    options
        Keyword arguments that the reader takes.
    scattered
        Whether it holds scattered data instead of a regular volume.
    beats_raw
        Whether it is recognized although the caller gives shape and dtype of raw samples.
    shown
        How lists of formats name it.
    parts
        Whether FILE:/part stands for one part of a file.
    names
        From what its reader knows the arrays among which it chooses (`names.tell_names`): the "header", or all "data";
        empty where files have no choice.
    steps
        "module:function", which takes a `Source`, or a `Folder`, and `name`, and returns the number of time steps, of
        which the option ``step`` chooses one, or the file of each; empty where files have one.
    """

    name: str
    reader: str
    recognizes: Callable[[Source], bool] = lambda _: False
    options: tuple[str, ...] = ()
    scattered: bool = False
    beats_raw: bool = False
    shown: str = ""
    recognizes_folder: Callable[[Folder], bool] = lambda _: False
    parts: bool = False
    steps: str = ""
    names: Literal["", "header", "data"] = ""

    def read(self, source: Source | Folder, **options: Any) -> Any:
        """Return what the reader makes of a file or a folder."""
        if source.inner and not self.parts:
            found = f"{source.path}:{source.inner}, a part of a file of format {self.name}"
            raise complain("the part cannot be read", found, "a file that is a whole, or HDF5, NetCDF, Zarr or .vtm")
        return pkgutil.resolve_name(self.reader)(source, **options)


def _is_of_meshio(source: Source) -> bool:
    return source.suffix in _MESHIO and bool(source.head(1))


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


def _vtk_kind(source: Source) -> str:
    """Return the type that the root element of VTK's XML states, "" for anything else."""
    found = _VTK_TYPE.search(source.head(_LONG_HEAD)) if _is_vtk_xml(source) else None
    return found[1].decode("ascii") if found else ""


def _is_vtk_image(source: Source) -> bool:
    # A parallel file, whose type begins with P, names files of the same kind.
    return _vtk_kind(source).removeprefix("P") in ("ImageData", "RectilinearGrid")


def _is_amr(source: Source) -> bool:
    return _vtk_kind(source) == "vtkOverlappingAMR"


def names_blocks(source: Source) -> bool:
    """Return whether a file is one of blocks or a time series of VTK."""
    return _vtk_kind(source) in ("vtkMultiBlockDataSet", "Collection")


def _is_of_blocks(*, scattered: bool) -> Callable[[Source], bool]:
    """Return whether a file names others, of which the shown one is a volume, or scattered data."""

    def recognizes(source: Source) -> bool:
        if not names_blocks(source):
            return False
        kind: str = pkgutil.resolve_name(_IO + "vtk_xml.blocks:kind_of")(source)
        return (kind in SCATTERED) == scattered

    return recognizes


def _is_legacy(kind: str) -> Callable[[Source], bool]:
    return lambda source: bool(pkgutil.resolve_name(_IO + "vtk_legacy:kind_of")(source) == kind)


def _is_mesh(source: Source) -> bool:
    head = source.head(_LONG_HEAD)
    if head.startswith((b"ply\n", b"ply\r")):
        header = head.partition(b"end_header")[0]
        return b"element face" in header and b" scale_0" not in header
    return source.suffix == ".obj" and b"\0" not in head and bool(head.strip())


def _is_nifti(source: Source) -> bool:
    head = source.head(_LONG_HEAD)
    return head[344:348] in (b"n+1\0", b"ni1\0") or head[4:8] in (b"n+2\0", b"ni2\0")


def is_dicom(source: Source) -> bool:
    """Return whether a file is one of DICOM, also without the 132 bytes before its first element."""
    head = source.head(_HEAD)
    return head[128:132] == b"DICM" or (head[:2] in (b"\2\0", b"\b\0") and _has_elements(head))


def _has_elements(head: bytes) -> bool:
    """Return whether bytes begin with three elements of DICOM (PS3.5, section 7.1): rising tags, even lengths."""
    at, last = 0, (0, 0)
    for _ in range(3):
        if len(head) < at + 12:
            return False
        tag = struct.unpack_from("<HH", head, at)
        kind = head[at + 4 : at + 6]
        if kind.isalpha() and kind.isupper():
            is_long = kind in _LONG_VALUES
            length, begin = (
                struct.unpack_from("<I" if is_long else "<H", head, at + (8 if is_long else 6))[0],
                8 + 4 * is_long,
            )
        else:
            length, begin = struct.unpack_from("<I", head, at + 4)[0], 8
        if not (last < tag and 2 <= tag[0] <= 0x10) or length % 2:
            return False
        at, last = at + begin + length, tag
    return True


def _is_mrc(source: Source) -> bool:
    return source.head(_HEAD)[208:212] == b"MAP "


def _hdf5_kind(source: Source) -> str:
    """Return what an HDF5 file holds, as `hdf5_volumes.kind_of` does, "" for other files, and for meshes of MED."""
    if source.suffix in _MESHIO or not _is_any_hdf5(source):
        return ""
    kind: str = pkgutil.resolve_name(_IO + "hdf5_volumes:kind_of")(source)
    return kind


def _is_any_hdf5(source: Source) -> bool:
    return hdf5_start(source) is not None


def _is_hdf5(kind: str) -> Callable[[Source], bool]:
    return lambda source: _hdf5_kind(source) == kind


def _never(_: Source) -> bool:
    return False


def _is_netcdf(source: Source) -> bool:
    return source.head(_HEAD).startswith(_NETCDF) or _hdf5_kind(source) == "netcdf"


def _every(is_one: Callable[[Source], bool]) -> Callable[[Folder], bool]:
    """Return whether a folder has files, and the first ones are of a kind."""

    def recognizes(folder: Folder) -> bool:
        found = folder.files()
        for path in found[:_FEW]:
            with Source(path) as source:
                if not is_one(source):
                    return False
        return bool(found)

    return recognizes


def _some(is_one: Callable[[Source], bool]) -> Callable[[Folder], bool]:
    """Return whether a folder has a file of a kind among its first ones."""

    def recognizes(folder: Folder) -> bool:
        for path in folder.files()[:_MANY]:
            with Source(path) as source:
                if is_one(source):
                    return True
        return False

    return recognizes


def _is_zarr(folder: Folder) -> bool:
    return any((folder.path / name).is_file() for name in (".zarray", ".zgroup", ".zattrs", "zarr.json"))


_is_tiff = _begins(b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_IO = "sheetsplat.io."


def _volume(
    name: str, reader: str, shown: str, recognizes: Callable[[Source], bool], *options: str, **rest: Any
) -> Format:
    """Return a format of regular volumes whose reader, and what counts its time steps, are in this folder."""
    steps = _IO + rest.pop("steps") if "steps" in rest else ""
    return Format(name, _IO + reader, recognizes, options, shown=shown, steps=steps, **rest)


_scattered = functools.partial(_volume, scattered=True)
# The first format that recognizes a file is used.
FORMATS: tuple[Format, ...] = (
    _scattered("ssk", "encoded:read", ".ssk of encoded fields", _begins(b"SSK\x01"), beats_raw=True),
    _volume("npy", "numpy_files:read_npy", ".npy", _begins(b"\x93NUMPY"), "name", beats_raw=True),
    _volume("npz", "numpy_files:read_npz", ".npz", _begins(*_ZIP), "name", beats_raw=True, names="header"),
    _volume("nrrd", "nrrd_files:read", "NRRD", _begins(b"NRRD"), "name", beats_raw=True),
    _volume("metaimage", "metaimage:read", "MetaImage (.mhd, .mha)", _is_metaimage, "name", beats_raw=True),
    _volume("nifti", "nifti:read", "NIfTI (.nii, .hdr)", _is_nifti, "name", "step",
            beats_raw=True, steps="nifti:count_steps"),
    _volume("dicom", "dicom:read", "DICOM series (a folder, or one of its files)", is_dicom, "name", "step",
            beats_raw=True, recognizes_folder=_some(is_dicom), steps="dicom:count_steps", names="header"),
    _volume("tiff", "tiff:read", "TIFF stacks (a file, or a folder of slices)", _is_tiff, "name", "step",
            beats_raw=True, recognizes_folder=_every(_is_tiff), steps="tiff:count_steps"),
    _volume("mrc", "mrc:read", "MRC", _is_mrc, beats_raw=True),
    _volume("openvdb", "vdb:read", "OpenVDB", _begins(b" BDV\0\0\0\0"), "name", beats_raw=True, names="header"),
    _volume("netcdf", "netcdf:read", "NetCDF", _is_netcdf, "name", "resample", "step",
            parts=True, steps="netcdf:count_steps", names="header"),
    _volume("vtkhdf image", "vtk_hdf:read_image", "VTKHDF images", _is_hdf5("vtkhdf image"), "name", "step",
            steps="vtk_hdf:count_steps", names="header"),
    _scattered("vtkhdf", "vtk_hdf:read", "VTKHDF meshes", _is_hdf5("vtkhdf"), "scalar", "step",
               steps="vtk_hdf:count_steps", names="header"),
    _volume("hdf5 volume", "hdf5_volumes:read", "HDF5 with volumes (FILE:/dataset)", _is_hdf5("volume"), "name",
            "step", "resample", parts=True, steps="hdf5_volumes:count_steps", names="header"),
    _volume("zarr", "zarr_folders:read", "Zarr and OME-Zarr (FOLDER:/array)", _never, "name", "step",
            "resample", recognizes_folder=_is_zarr, parts=True, steps="zarr_folders:count_steps", names="header"),
    _scattered("meshio", "meshio_files:read", "Gmsh (.msh), MED, XDMF", _is_of_meshio, "scalar", names="data"),
    _scattered("hdf5", "sph_hdf5:read", "HDF5 with particles", _is_any_hdf5, "scalar", "particles", "support",
               names="header"),
    _scattered("mesh", "triangle_meshes:read", ".obj and .ply of closed meshes", _is_mesh),
    _scattered("ply", "gaussian_ply:read", ".ply of 3D Gaussian Splatting", _begins(b"ply\n", b"ply\r"), "scalar",
               names="data"),
    _volume("vti", "vtk_xml.images:read", ".vti, .vtr, .pvti, .pvtr", _is_vtk_image, "name", "resample",
            names="header"),
    _volume("vtm image", "vtk_xml.blocks:read", ".vtm and .pvd of images", _is_of_blocks(scattered=False),
            "name", "resample", "step", parts=True, steps="vtk_xml.blocks:steps", names="header"),
    _scattered("vtm", "vtk_xml.blocks:read", ".vtm and .pvd of meshes (FILE.vtm:/block)", _is_of_blocks(scattered=True),
               "scalar", "step", parts=True, steps="vtk_xml.blocks:steps", names="header"),
    _scattered("vtk amr", "vtk_xml.amr:read", ".vthb", _is_amr, "scalar", names="header"),
    _scattered("vtk", "vtk_xml.meshes:read", ".vtu, .vts, .vtp, .pvtu, .pvts, .pvtp", _is_vtk_xml, "scalar",
               names="header"),
    _volume("vtk legacy image", "vtk_legacy:read_volume", ".vtk of images and rectilinear grids", _is_legacy("volume"),
            "name", "resample", names="header"),
    _scattered("vtk legacy", "vtk_legacy:read_mesh", ".vtk", _is_legacy("mesh"), "scalar", names="header"),
    _scattered("csv", "tables:read_csv", ".csv", _is_table, "scalar", names="header"),
    _volume("raw", "raw:read", "raw samples", lambda source: source.suffix in _RAW_SUFFIXES,
            "shape", "dtype", "offset"),
    # Recognized only by `find_format`: by the arrays of an .npz, and by the grid of the caller.
    _scattered("ellipsoids", "tables:read_npz", ".npz with an array centers", _never, "scalar", names="data"),
    _scattered("plot3d", "plot3d:read", "PLOT3D solutions with a grid", _never, "grid", "scalar", names="header"),
)  # fmt: skip
#: All formats by their names.
BY_NAME = {one.name: one for one in FORMATS}
#: Formats of files that hold points instead of a regular volume.
SCATTERED = tuple(one.name for one in FORMATS if one.scattered)
#: Formats of what a .vtm names.
OF_BLOCKS = ("vti", "vtk")
#: What formats of regular volumes, and those of scattered data, are called in messages.
LISTED_REGULAR = ", ".join(one.shown for one in FORMATS if not one.scattered)
LISTED_SCATTERED = ", ".join(one.shown for one in FORMATS if one.scattered)


@functools.cache
def of_others() -> tuple[Format, ...]:
    """Return the formats of other packages: `Format` objects behind entry points of the group sheetsplat.readers."""
    found = []
    points: Any = importlib.metadata.entry_points(group=ENTRY_POINTS)
    for point in points:
        try:
            one: Any = point.load()
        except Exception as error:
            _log.warning("the reader %s cannot be loaded: %s", point.value, error)
            continue
        if isinstance(one, Format):
            found.append(one)
        else:
            _log.warning("the reader %s is a %s, not a sheetsplat.io.Format", point.value, type(one).__name__)
    return tuple(found)


def _recognized(source: Source | Folder, *, raw_options: bool) -> Format | None:
    def is_of(one: Format) -> bool:
        if isinstance(source, Folder):
            return one.recognizes_folder(source)
        return (one.beats_raw or not raw_options) and one.recognizes(source)

    # Entry points are looked up only where no own format fits.
    return next(filter(is_of, FORMATS), None) or next(filter(is_of, of_others()), None)


def format_of(source: Source | Folder, *, raw_options: bool = False) -> Format:
    """Return the format of a file by its content, then by its suffix; InvalidInput where there is none."""
    if raw_options and source.suffix in _RAW_SUFFIXES and isinstance(source, Source):
        return BY_NAME["raw"]
    found = _recognized(source, raw_options=raw_options)
    if found is not None:
        return found
    if isinstance(source, Folder):
        raise complain(
            f"{source.path} cannot be read",
            "a folder",
            "a regular file, or a folder of a DICOM series, of TIFF slices, or of a Zarr array",
            _IN_BRICKS if any(one.suffix.lower() in PARQUET for one in source.files()) else "",
        )
    if raw_options:
        return BY_NAME["raw"]
    advice = "for raw samples give their shape and their type, for a PLOT3D solution its grid"
    raise complain(
        f"{source.path} cannot be read",
        "an empty file" if not source.head(_HEAD) else "a format that is not known",
        f"{LISTED_REGULAR}; scattered data as {LISTED_SCATTERED}; each also gzipped",
        _IN_BRICKS if source.path.suffix.lower() in PARQUET else advice,
    )


def find_format(path: str | os.PathLike[str], *, raw_options: bool, name: str | None, grid: bool = False) -> Format:
    """Return the format of a file by its content, then by its suffix.

    `raw_options` says whether the caller describes raw samples, `grid` whether a PLOT3D grid is given. An .npz file
    with an array "centers" holds ellipsoids unless the caller gives the `name` of an array.
    """
    if grid:
        return BY_NAME["plot3d"]
    with opened(path) as source:
        found = format_of(source, raw_options=raw_options)
        if found.name == "npz" and name is None and isinstance(source, Source):
            from sheetsplat.io import tables

            return BY_NAME["ellipsoids"] if tables.holds_ellipsoids(source) else found
        return found
