"""A small valid file of every kind that can be read, and how it is read: what tests and the command `fuzz` spoil."""

from __future__ import annotations

import bz2
import gzip
import io
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import OpenEXR
import scattered_files as scattered
import test_amr
import test_data_formats as others
import test_first_sight
import test_io
import test_mesh_files
import test_ply_variants
import test_volume_variants as variants
import test_vtk_files as vtk
import test_vtk_parts as parts
from PIL import Image as PillowImage

import sheetsplat as ss
from sheetsplat.io.pictures import read_picture

# The files have some kilobytes, of which one byte of a packed one stands for a thousand.
MEMORY = 256 << 20
SECONDS = 20
Files = dict[str, bytes]


def npz(**options: Any) -> bytes:
    made = io.BytesIO()
    (np.savez_compressed if options.pop("packed", False) else np.savez)(made, **options)
    return made.getvalue()


def _ellipsoids(folder: Path) -> Files:
    rng = np.random.default_rng(1)
    field = ss.EllipsoidField(rng.random((9, 3)), rng.random((9, 3)), values=rng.random(9), weights=rng.random(9))
    ss.io.save_npz(field, folder / "e.npz")
    return {"e.npz": (folder / "e.npz").read_bytes()}


def _particles(folder: Path) -> Files:
    path, _ = scattered.write_particles(folder / "s.hdf5", 20)
    return {"s.hdf5": path.read_bytes()}


def _particles_in_a_box(folder: Path) -> Files:
    header = {"BoxSize": 10.0, "MassTable": np.ones(6), "HubbleParam": 0.7, "Time": 0.5, "Redshift": 1.0}
    path, _ = scattered.write_particles(folder / "b.h5", 20, leave_out=("Masses", "SmoothingLength"), header=header)
    return {"b.h5": path.read_bytes()}


def _packed_particles(folder: Path) -> Files:
    rng = np.random.default_rng(2)
    with h5py.File(folder / "p.h5", "w", libver="latest") as file:
        group = file.create_group("PartType0")
        for name, values in {"Coordinates": rng.random((40, 3)), "SmoothingLength": rng.random(40) + 1}.items():
            group.create_dataset(name, data=values, chunks=True, compression="gzip", shuffle=True)
        group["Density"] = rng.random(40) + 1
    return {"p.h5": (folder / "p.h5").read_bytes()}


def vtu(way: str, **options: Any) -> bytes:
    writer = scattered.VtkWriter(way, **options)
    body = scattered.vtu_body(writer)[0]
    return writer.file("UnstructuredGrid", body)


def _vtp() -> bytes:
    writer = scattered.VtkWriter("binary")
    rng = np.random.default_rng(3)
    body = f"""<PolyData><Piece NumberOfPoints="6" NumberOfVerts="1" NumberOfPolys="1">
    <PointData>{writer.array("value", rng.normal(size=6))}</PointData><CellData></CellData>
    <Points>{writer.array("Points", rng.normal(size=(6, 3)))}</Points>
    <Verts>{writer.array("connectivity", np.array([5]))}{writer.array("offsets", np.array([1]))}</Verts>
    <Polys>{writer.array("connectivity", np.array([0, 1, 2, 3]))}{writer.array("offsets", np.array([4]))}</Polys>
    </Piece></PolyData>"""
    return writer.file("PolyData", body)


def _vti(way: str, **options: Any) -> bytes:
    writer = scattered.VtkWriter(way, **options)
    values = np.arange(24, dtype=np.int16)
    body = f"""<ImageData WholeExtent="2 5 0 2 -1 0" Origin="1 2 3" Spacing="0.5 1 2"><Piece Extent="2 5 0 2 -1 0">
    <PointData Scalars="a">{writer.array("b", values + 1)}{writer.array("a", values)}</PointData></Piece></ImageData>"""
    return writer.file("ImageData", body)


def _plot3d(**options: Any) -> Files:
    grid, solution, *_ = scattered.plot3d_files([(4, 3, 2)], **options)
    return {"a.q": solution, "a.xyz": grid}


def _csv() -> bytes:
    rng = np.random.default_rng(4)
    rows = "\n".join(",".join(f"{number:.6g}" for number in row) for row in rng.random((12, 5)))
    return ("x,y,z,radius,value\n" + rows + "\n").encode()


def picture(suffix: str, folder: Path) -> Files:
    path = folder / f"p{suffix}"
    pixels = np.random.default_rng(5).random((6, 5, 4)).astype(np.float32)
    if suffix == ".png":
        PillowImage.fromarray((pixels * 255).astype(np.uint8)).save(path)
    elif suffix == ".exr":
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, {"RGBA": pixels}).write(str(path))
    else:
        np.save(path, pixels)
    return {path.name: path.read_bytes()}


SAMPLES = test_io.VALUES.astype("<i2").tobytes()


def _nrrd(data: bytes, name: str = "a.nrrd", **fields: Any) -> Files:
    return {name: test_io.nrrd_header(**fields).encode() + data}


def _meta(data: bytes, **fields: Any) -> Files:
    return {"a.mha": test_io.meta_header(**fields).encode() + data}


def _made(make: Callable[..., Any], name: str, **options: Any) -> Callable[[Path], Files]:
    """Return what writes a file by a maker of another test."""

    def files(folder: Path) -> Files:
        make(folder / name, **options)
        return {name: (folder / name).read_bytes()}

    return files


def _folder(make: Callable[..., Any], name: str, **options: Any) -> Callable[[Path], Files]:
    """Return what writes a folder by a maker of another test."""

    def files(folder: Path) -> Files:
        make(folder / name, **options)
        found = sorted(one for one in (folder / name).rglob("*") if one.is_file())
        return {str(one.relative_to(folder)): one.read_bytes() for one in found}

    return files


def of_meshio(name: str) -> Callable[[Path], Files]:
    """Return what writes a mesh of tetrahedra, and the file beside it that it names."""

    def files(folder: Path) -> Files:
        import test_meshio_files as meshes  # skips the test without meshio

        meshes.write(folder / name, cells=meshes.CELLS[:1])
        found = [folder / name, *([folder / "a.h5"] if name == "a.xdmf" else [])]
        return {one.name: one.read_bytes() for one in found}

    return files


def _netcdf(path: Path, engine: str) -> None:
    others.needed(engine)
    others.dataset().isel(lev=slice(0, 2)).to_netcdf(path, engine=engine)


def _structured(kind: str, way: str) -> bytes:
    """Return a grid of 3 x 2 x 2 points: .vts or .vtr."""
    writer = scattered.VtkWriter(way)
    k, j, i = np.mgrid[0:2, 0:2, 0:3].reshape(3, -1).astype(float)
    place = f"<Points>{writer.array('Points', np.stack([i, j, k], axis=1))}</Points>"
    if kind == "RectilinearGrid":
        along = "".join(writer.array("c", np.arange(float(count))) for count in (3, 2, 2))
        place = f"<Coordinates>{along}</Coordinates>"
    data = f"<PointData>{writer.array('a', i + j * k)}</PointData>"
    body = f'<{kind} WholeExtent="0 2 0 1 0 1"><Piece Extent="0 2 0 1 0 1">{data}{place}</Piece></{kind}>'
    return writer.file(kind, body)


def _legacy_binary() -> bytes:
    points = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)], ">f4").tobytes()
    return (
        b"# vtk DataFile Version 5.1\nmade by a test\nBINARY\nDATASET UNSTRUCTURED_GRID\n"
        b"FIELD FieldData 1\ns 1 2 string\n"
        b"\xc4ab c\xc0\nPOINTS 5 float\n" + points + b"\nCELLS 3 8\nOFFSETS vtktypeint64\n"
        + np.array([0, 4, 8], ">i8").tobytes() + b"\nCONNECTIVITY vtktypeint64\n"
        + np.array([0, 1, 2, 3, 1, 2, 3, 4], ">i8").tobytes() + b"\nCELL_TYPES 2\n"
        + np.array([10, 10], ">i4").tobytes() + b"\nPOINT_DATA 5\nSCALARS a double 1\nLOOKUP_TABLE default\n"
        + np.arange(5, dtype=">f8").tobytes() + b"\nFIELD FieldData 1\nb 2 5 short\n"
        + np.arange(10, dtype=">i2").tobytes() + b"\n"
    )  # fmt: skip


def _blocks() -> Files:
    text = '<VTKFile type="vtkMultiBlockDataSet"><vtkMultiBlockDataSet><DataSet index="0" name="a" file="a.vti"/>'
    return {"a.vtm": (text + "</vtkMultiBlockDataSet></VTKFile>").encode(), "a.vti": _vti("ascii")}


def _levels(folder: Path) -> Files:
    first = test_amr.files(folder)
    images = {str(one.relative_to(folder)): one.read_bytes() for one in sorted((folder / "amr").iterdir())}
    return {first.name: first.read_bytes(), **images}


def _series() -> Files:
    text = '<VTKFile type="Collection"><Collection><DataSet timestep="0.5" group="" part="0" file="a.vti"/>'
    return {"a.pvd": (text + "</Collection></VTKFile>").encode(), "a.vti": _vti("ascii")}


# What is read is the first file of each, or the folder that it is in; the others lie beside it.
KINDS: dict[str, Callable[[Path], Files]] = {
    "npy": lambda _: {"a.npy": test_io.npy_bytes(test_io.VALUES)},
    "npy in Fortran's order": lambda _: {"a.npy": test_io.npy_bytes(np.asfortranarray(test_io.VALUES.astype(">f8")))},
    "npz": lambda _: {"a.npz": npz(a=test_io.VALUES, b=np.arange(3))},
    "npz packed": lambda _: {"a.npz": npz(packed=True, a=test_io.VALUES)},
    "npz of ellipsoids": _ellipsoids,
    "nrrd": lambda _: _nrrd(SAMPLES),
    "nrrd gzip": lambda _: _nrrd(gzip.compress(SAMPLES), encoding="gzip"),
    "nrrd bzip2": lambda _: _nrrd(bz2.compress(SAMPLES), encoding="bzip2", spacings="1 2 3"),
    "nrrd text": lambda _: _nrrd(b" ".join(b"%d" % value for value in test_io.VALUES.ravel()), encoding="ascii"),
    "nrrd in space": lambda _: _nrrd(
        SAMPLES, space_dimension=3, space_directions="(1,0,0) (0,2,0) (0,0,3)", space_origin="(4,5,6)"
    ),
    "nrrd detached": lambda _: _nrrd(b"", "a.nhdr", data_file="a.raw", byte_skip=0) | {"a.raw": SAMPLES},
    "mha": lambda _: _meta(SAMPLES),
    "mha packed": lambda _: _meta(zlib.compress(SAMPLES), CompressedData="True"),
    "mhd": lambda _: {"a.mhd": test_io.meta_header(ElementDataFile="a.zraw").encode(), "a.zraw": SAMPLES},
    "vti text": lambda _: {"a.vti": _vti("ascii")},
    "vti packed": lambda _: {"a.vti": _vti("binary", packing="vtkZLibDataCompressor")},
    "vtu text": lambda _: {"a.vtu": vtu("ascii")},
    "vtu binary": lambda _: {"a.vtu": vtu("binary")},
    "vtu appended": lambda _: {"a.vtu": vtu("raw", wide=True)},
    "vtu appended packed": lambda _: {"a.vtu": vtu("base64", packing="vtkZLibDataCompressor")},
    "vtu lzma": lambda _: {"a.vtu": vtu("raw", packing="vtkLZMADataCompressor")},
    "vtp": lambda _: {"a.vtp": _vtp()},
    "hdf5": _particles,
    "hdf5 packed": _packed_particles,
    "ply": lambda _: {"a.ply": b"".join(scattered.ply_bytes(count=6)[:2])},
    "ply packed": lambda _: {"a.ply": test_ply_variants.small_packed()},
    "ply of volumes": lambda _: {"a.ply": test_ply_variants.file_of({"vertex": test_ply_variants.volume_gaussians(6)})},
    "hdf5 in a box": _particles_in_a_box,
    "vthb": _levels,
    "ply text": lambda _: {"a.ply": b"".join(scattered.ply_bytes("text", count=6)[:2])},
    "mesh obj": lambda _: {"a.obj": test_first_sight.box_obj(test_first_sight.QUADS).encode()},
    "mesh ply": lambda _: {"a.ply": test_first_sight.box_ply(test_first_sight.QUADS).encode()},
    "mesh ply binary": lambda _: {"a.ply": test_mesh_files.binary_ply()},
    "csv": lambda _: {"a.csv": _csv()},
    "plot3d": lambda _: _plot3d(),
    "plot3d records": lambda _: _plot3d(records=True, iblank=True, order="<"),
    "raw": lambda _: {"a.raw": SAMPLES},
    "nii": _made(others.nifti, "a.nii"),
    "nii of version 2": _made(others.nifti, "a.nii", kind="Nifti2Image"),
    "dicom": _folder(others.dicom, "ct"),
    "tiff": _made(others.tiff, "a.tif"),
    "tiff packed": _made(others.tiff, "a.tif", compression="zlib"),
    "tiff tiled": _made(others.tiff, "a.tif", tile=(16, 16), bigtiff=True),
    "tiff of imagej": _made(others.tiff, "a.tif", imagej=True, metadata={"axes": "ZYX", "spacing": 1.5, "unit": "um"}),
    "mrc": _made(others.mrc, "a.mrc"),
    "netcdf": _made(_netcdf, "a.nc", engine="scipy"),
    "netcdf 4": _made(_netcdf, "a.nc", engine="h5netcdf"),
    "hdf5 volume": _made(others.volumes, "a.h5"),
    "zarr": _folder(others.zarr_array, "a.zarr"),
    "zarr 3": _folder(others.zarr_array, "a.zarr", version=3),
    "ome-zarr": _folder(others.picture, "a.zarr", version=2, channels=("only",)),
    "nii turned and scaled": _made(
        others.nifti,
        "a.nii",
        affine=np.array([[1, 1, 0, 3], [-1, 1, 0, 4], [0, 1, 2, 5], [0, 0, 0, 1]]),
        values=np.stack([others.VALUES] * 2),
        scale=(0.5, 2.0),
    ),
    "mha turned": lambda _: _meta(SAMPLES, TransformMatrix="0.6 0.8 0 -0.8 0.6 0 0 0 1", CenterOfRotation="0 0 0"),
    "nrrd of ends": lambda _: _nrrd(SAMPLES, axis_mins="1 2 3", axis_maxs="4 5 nan", centers="cell node ???"),
    "mrc of a cell": _made(others.mrc, "b.mrc", cellb=(90, 90, 120), mapc=2, mapr=1),
    "dicom of doses": _folder(variants.dose, "dose"),
    "dicom of groups": _folder(others.frames, "frames"),
    "dicom without its first bytes": _folder(variants.bare_dicom, "bare"),
    "tiff of steps": _made(variants.stacked, "a.tif", imagej=True),
    "tiff of ome": _made(variants.stacked, "a.ome.tif"),
    "netcdf packed": _made(variants.write_packed, "a.nc", kind="scipy"),
    "hdf5 volume packed": _made(variants.write_packed, "a.h5", kind="hdf5"),
    "hdf5 volume behind a block": _made(variants.behind_block, "a.mat", block=512),
    "zarr packed": _folder(variants.write_packed, "a.zarr", kind="zarr 2"),
    "zarr 3 packed": _folder(variants.write_packed, "a.zarr", kind="zarr 3"),
    "zarr of shards": _folder(variants.shards, "a.zarr"),
    "ome-zarr in a root": _folder(variants.root_of_images, "a.zarr"),
    "vts": lambda _: {"a.vts": _structured("StructuredGrid", "raw")},
    "vtr": lambda _: {"a.vtr": _structured("RectilinearGrid", "ascii")},
    "vtm": lambda _: _blocks(),
    "pvd": lambda _: _series(),
    "pvti": _folder(parts.structured, "run"),
    "pvtu": _folder(parts.meshes, "run"),
    "vtk": lambda _: {"a.vtk": vtk.LEGACY.encode()},
    "vtk binary": lambda _: {"a.vtk": _legacy_binary()},
    "meshio gmsh": of_meshio("b.msh"),
    "meshio gmsh 2": of_meshio("a.msh"),
    "meshio med": of_meshio("a.med"),
    "meshio xdmf": of_meshio("a.xdmf"),
    "meshio xdmf text": of_meshio("b.xdmf"),
    "vtkhdf": _made(vtk.vtkhdf, "a.vtkhdf"),
    "vtkhdf image": _made(vtk.vtkhdf, "a.vtkhdf", kind="ImageData"),
    "vtkhdf of steps": _made(parts.timed, "a.vtkhdf", steps=1, **parts.steps_of(1, **{"Steps/NumberOfParts": [2]})),
    "vtkhdf image of steps": _made(parts.timed_image, "a.vtkhdf", count=1),
    "picture png": lambda folder: picture(".png", folder),
    "picture exr": lambda folder: picture(".exr", folder),
    "picture npy": lambda folder: picture(".npy", folder),
}

OF_LIBRARIES = tuple(
    kind
    for kind in KINDS
    if kind.startswith(("tiff", "meshio", "nii", "dicom", "netcdf", "zarr", "ome-zarr", "mrc", "hdf5 volume packed"))
)


def read(kind: str, path: Path) -> None:
    """Read a file as its kind is read, and look at what came of it."""
    if kind.startswith("picture"):
        assert read_picture(path).ndim in (2, 3)
        return
    options: dict[str, Any] = {}
    if kind.startswith("plot3d"):
        options = {"grid": path.with_name("a.xyz")}
    elif kind == "raw":
        options = {"shape": (4, 3, 2), "dtype": "<i2"}
    elif kind.startswith("tiff of") and kind != "tiff of imagej":
        options = {"step": 2, "name": "1"}
    elif kind == "nii turned and scaled":
        options = {"step": 1}
    if kind.startswith("dicom"):
        path = path.parent
    elif "zarr" in kind:
        path = next(one for one in path.parents if one.suffix == ".zarr")
    field = ss.open(path, **options)
    assert np.isfinite(field.value_range).all() and field.size >= 0
    assert field.size == 0 or np.isfinite(field.bounds).all()


def write(folder: Path, files: Files) -> None:
    """Write files, also in folders of that folder."""
    for name, data in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
