"""VTK's files beside .vtu, .vtp and .vti: what VTK writes is read as its own objects are; what lies is refused."""

from __future__ import annotations

import gzip
import os

import h5py
import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat.io import read_scattered, read_volume

SCALAR = "pressure of air"
VALUES = np.random.default_rng(21).random((4, 5, 6))


def pyvista():
    return pytest.importorskip("pyvista", reason="pyvista is not installed")


def with_data(grid, seed=1):
    """Return a data set with scalars, vectors and bytes of its points and numbers of its cells."""
    rng = np.random.default_rng(seed)
    grid[SCALAR] = rng.random(grid.n_points)
    grid["flow"] = rng.random((grid.n_points, 3)).astype(np.float32)
    grid["mask"] = rng.integers(0, 255, grid.n_points).astype(np.uint8)
    grid.cell_data["load"] = rng.integers(-9, 9, grid.n_cells)
    grid.set_active_scalars(SCALAR)
    return grid


def data_sets():
    pv = pyvista()
    x, y, z = np.arange(6.0), np.arange(5.0) * 2, np.arange(4.0) * 3
    k, j, i = np.meshgrid(z, y, x, indexing="ij")
    curved = pv.StructuredGrid()
    curved.points = np.stack([(i + 0.1 * j * j).ravel(), j.ravel(), (k + 0.1 * i).ravel()], axis=1)
    curved.dimensions = (6, 5, 4)
    mixed = pv.Line((0, 0, 5), (0, 0, 6)).append_polydata(pv.Sphere(theta_resolution=6, phi_resolution=6))
    return {
        "image": pv.ImageData(dimensions=(6, 5, 4), spacing=(1, 2, 3), origin=(7, 8, 9)),
        "rectilinear": pv.RectilinearGrid(x, y, z),
        "structured": curved,
        "unstructured": pv.PolyData(np.random.default_rng(2).random((60, 3))).delaunay_3d(),
        "surface": mixed,
    }


def same(path, grid, scalar=None):
    """Compare a file with VTK's own object."""
    options = {} if isinstance(ss.open(path), ss.RegularField) else {"fit": "nearest"}
    found, expected = ss.open(path, scalar=scalar, **options), ss.open(grid, scalar=scalar, **options)
    assert type(found) is type(expected) and np.array_equal(found.values, expected.values)
    assert found.quantity == expected.quantity
    if isinstance(found, ss.RegularField):
        assert found.spacing == expected.spacing and found.origin == expected.origin
    else:
        assert np.array_equal(found.centers, expected.centers)
        if scalar == SCALAR:
            # The cells are those of the object: so are their ellipsoids.
            assert ss.open(path, scalar=scalar) == ss.open(grid, scalar=scalar)


SUFFIXES = {
    "image": ["vti", "vtk", "vtkhdf"],
    "rectilinear": ["vtr", "vtk"],
    "structured": ["vts", "vtk"],
    "unstructured": ["vtu", "vtk", "vtkhdf"],
    "surface": ["vtp", "vtk", "vtkhdf"],
}
FILES = [
    (name, suffix, binary)
    for name, suffixes in SUFFIXES.items()
    for suffix in suffixes
    for binary in ((True,) if suffix == "vtkhdf" else (True, False))
]


@pytest.mark.parametrize(("name", "suffix", "binary"), FILES)
def test_what_vtk_writes(tmp_path, name, suffix, binary):
    grid = with_data(data_sets()[name])
    if name == "surface" and suffix == "vtkhdf":
        # VTK orders lines and vertices of its object otherwise than the file's lists.
        grid = with_data(pyvista().Sphere(theta_resolution=6, phi_resolution=6))
    path = tmp_path / f"a.{suffix}"
    if suffix == "vtkhdf":
        from vtkmodules.vtkIOHDF import vtkHDFWriter

        writer = vtkHDFWriter()
        writer.SetFileName(str(path))
        writer.SetInputData(grid)
        writer.Write()
    else:
        grid.save(path, binary=binary)
    if not binary:
        # Numbers as texts have fewer digits.
        grid = pyvista().read(path)
    # VTKHDF does not say which scalars are active.
    for scalar in (*([] if suffix == "vtkhdf" else [None]), SCALAR, "flow", "flow_y", "mask", "load"):
        same(path, grid, scalar)
    if suffix == "vtk":
        packed = tmp_path / "a.vtk.gz"
        packed.write_bytes(gzip.compress(path.read_bytes()))
        same(packed, grid)
    with pytest.raises(ss.InvalidInput, match=r"'none'.*pressure of air"):
        ss.open(path, scalar="none")


def test_uneven_coordinates(tmp_path):
    pv = pyvista()
    uneven = with_data(pv.RectilinearGrid(np.arange(6.0), np.arange(5.0), np.arange(4.0) ** 2))
    for name in ("a.vtr", "a.vtk"):
        uneven.save(tmp_path / name)
        with pytest.raises(ss.InvalidInput, match="uneven coordinates along z.*resample=True"):
            ss.open(tmp_path / name)
        assert ss.open(tmp_path / name, resample=True).shape[0] == 10


def test_images_that_are_turned(tmp_path):
    grid = pyvista().ImageData(dimensions=(6, 5, 4), direction_matrix=[[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    with_data(grid).save(tmp_path / "a.vti")
    same(tmp_path / "a.vti", grid)


LEGACY = """# vtk DataFile Version 3.0
made by hand
ASCII
DATASET STRUCTURED_POINTS
DIMENSIONS 2 2 2
ASPECT_RATIO 1 2 3
ORIGIN 0 0 1

CELL_DATA 1
FIELD more 1
c 1 1 int
7
POINT_DATA 8
COLOR_SCALARS shade 1
0 0.5 1 0 0 0 0 1
LOOKUP_TABLE colours 2
0 0 0 1
1 1 1 1
SCALARS a%20b int 1
LOOKUP_TABLE default
0 1 2 3 4
5 6 7
METADATA
INFORMATION 0

VECTORS v float
""" + " ".join(["1 2 2"] * 8)


def test_legacy_files_of_other_programs(tmp_path):
    path = tmp_path / "a.vtk"
    for text in (LEGACY, LEGACY.replace("\n", "\r\n"), LEGACY.lower().replace("# vtk datafile v", "# vtk DataFile V")):
        path.write_bytes(text.encode())
        volume = read_volume(path)
        assert np.array_equal(volume.values.ravel(), np.arange(8)) and volume.details["content"] == "a b"
        assert volume.spacing == (1, 2, 3) and volume.origin == (0, 0, 1)
        assert np.array_equal(read_volume(path, name="v").values, np.full((2, 2, 2), 3))
        assert read_volume(path, name="shade").values.ravel()[1] == 0.5
        assert read_volume(path, name="c").values.item() == 7
    old = """# vtk DataFile Version 2.0
cells
ASCII
DATASET UNSTRUCTURED_GRID
POINTS 5 float
0 0 0  1 0 0  0 1 0  0 0 1  1 1 1
CELLS 3 12
4 0 1 2 3 4 1 2 3 4 1 0
CELL_TYPES 3
10 10 1
POINT_DATA 5
SCALARS a float
0 1 2 3 4
"""
    path.write_text(old)
    mesh = read_scattered(path)
    assert np.array_equal(mesh.cells[0], [[0, 1, 2, 3], [1, 2, 3, 4]]) and np.array_equal(mesh.values, np.arange(5))
    for change, text in (
        (("POINTS 5", "POINTS 1000000000000000000"), "numbers of an array|10\\^18|number that is"),
        (("POINTS 5", "POINTS 4"), "section"),
        (("CELLS 3 12", "CELLS 2 12"), "numbers of CELLS"),
        (("4 1 2 3 4", "4 1 2 3 9"), "points 0 to 9"),
        (("4 1 2 3 4", "-4 1 2 3 4"), "outside its list"),
        (("10 10 1\n", "10 10 10\n"), "4 points"),
        (("SCALARS a float", "SCALARS a doublefloat"), "of type 'doublefloat'"),
        (("POINT_DATA 5", "POINT_DATA 4"), "section"),
        (("0 1 2 3 4\n", "0 1 2 3\n"), "4 numbers"),
        (("0 1 2 3 4\n", "0 1 x 3 4\n"), "cannot be read"),
        (("ASCII", "ASCI"), "ASCII or BINARY"),
        (("UNSTRUCTURED_GRID", "FIELD"), "of type 'FIELD'"),
    ):
        path.write_text(old.replace(*change))
        with pytest.raises(ss.InvalidInput, match=text):
            read_scattered(path)


def test_several_pieces_of_structured_files(tmp_path):
    """Written by hand: VTK writes pieces only in parallel."""
    from scattered_files import VtkWriter

    writer = VtkWriter("ascii")
    k, j, i = np.mgrid[0:4, 0:5, 0:6].astype(float)
    points = np.stack([i + 0.1 * j, j, k], axis=-1)

    def pieces(kind):
        text = ""
        for a, b in ((0, 2), (2, 5)):
            part = np.s_[:, :, a : b + 1]
            place = f"<Points>{writer.array('Points', points[part].reshape(-1, 3))}</Points>"
            if kind == "RectilinearGrid":
                along = (np.arange(a, b + 1.0), np.arange(5.0), np.arange(4.0))
                place = f"<Coordinates>{''.join(writer.array('c', one) for one in along)}</Coordinates>"
            data = f"<PointData>{writer.array('a', VALUES[part].ravel())}</PointData>"
            text += f'<Piece Extent="{a} {b} 0 4 0 3">{data}{place}</Piece>'
        return writer.file(kind, f'<{kind} WholeExtent="0 5 0 4 0 3">{text}</{kind}>')

    (tmp_path / "a.vtr").write_bytes(pieces("RectilinearGrid"))
    assert np.array_equal(read_volume(tmp_path / "a.vtr").values, VALUES)
    (tmp_path / "a.vts").write_bytes(pieces("StructuredGrid"))
    mesh = read_scattered(tmp_path / "a.vts")
    assert np.array_equal(mesh.points, points.reshape(-1, 3)) and np.array_equal(mesh.values, VALUES.ravel())
    assert mesh.cells[0].shape == (3 * 4 * 5, 8)


# ------------------------------------------------------------------------------------------------------------- blocks


def test_blocks(tmp_path):
    pv = pyvista()
    sets = data_sets()
    image, mesh = with_data(sets["image"]), with_data(sets["unstructured"])
    pv.MultiBlock({"only": image}).save(tmp_path / "one.vtm")
    same(tmp_path / "one.vtm", image)
    pv.MultiBlock({"box": image, "rest": pv.MultiBlock({"mesh": mesh})}).save(tmp_path / "two.vtm")
    with pytest.raises(ss.InvalidInput, match=r"2 blocks; blocks: box, rest/mesh.*two.vtm:/box"):
        ss.open(tmp_path / "two.vtm")
    same(f"{tmp_path}/two.vtm:/box", image)
    assert ss.open(f"{tmp_path}/two.vtm:/rest/mesh", scalar="load", fit="nearest").size == mesh.n_cells
    with pytest.raises(ss.InvalidInput, match="0 blocks called 'none'"):
        ss.open(f"{tmp_path}/two.vtm:/none")


def test_blocks_stay_in_their_folder(tmp_path):
    """A pipe stands in for the other file: opening it would wait for ever."""
    os.mkfifo(tmp_path / "secret.vti")
    folder = tmp_path / "inner"
    folder.mkdir()
    (folder / "link.vti").symlink_to(tmp_path / "secret.vti")
    path = folder / "a.vtm"
    for name in ("../secret.vti", str(tmp_path / "secret.vti"), "link.vti", "", ".", "a.vtm", "&#x2e;./secret.vti"):
        path.write_text(
            f'<VTKFile type="vtkMultiBlockDataSet"><vtkMultiBlockDataSet><DataSet index="0" file="{name}"/>'
            "</vtkMultiBlockDataSet></VTKFile>"
        )
        with pytest.raises(ss.InvalidInput):
            ss.open(path)
    path.write_text('<!DOCTYPE a [<!ENTITY b SYSTEM "../secret.vti">]>' + path.read_text())
    with pytest.raises(ss.InvalidInput, match="document type"):
        ss.open(path)


# ------------------------------------------------------------------------------------------------------------- VTKHDF


def vtkhdf(path, kind="UnstructuredGrid", **change):
    """Write two partitions of tetrahedra, or an image; `change` replaces datasets and attributes."""
    points = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], float)
    data = {
        "Points": np.concatenate([points, points + 2]),
        "NumberOfPoints": np.array([4, 4]),
        "NumberOfCells": np.array([1, 1]),
        "NumberOfConnectivityIds": np.array([4, 4]),
        "Connectivity": np.array([0, 1, 2, 3, 0, 1, 2, 3]),
        "Offsets": np.array([0, 4, 0, 4]),
        "Types": np.array([10, 10], np.uint8),
        "PointData/a": np.arange(8.0),
        "CellData/b": np.arange(2.0),
    }
    attributes = {"Version": [2, 0], "Type": np.bytes_(kind)}
    if kind == "ImageData":
        data = {"PointData/a": VALUES, "CellData/b": VALUES[1:, 1:, 1:]}
        attributes |= {"WholeExtent": [0, 5, 0, 4, 0, 3], "Spacing": [1.0, 2, 3], "Origin": [0.0, 0, 1]}
    with h5py.File(path, "w") as file:
        group = file.create_group("VTKHDF")
        for name, values in (attributes | {one: change[one] for one in change if one in attributes}).items():
            if values is not None:
                group.attrs[name] = values
        for name, values in (data | {one: change[one] for one in change if one not in attributes}).items():
            if values is not None:
                group[name] = values
    return path


def test_vtkhdf_by_hand(tmp_path):
    mesh = read_scattered(vtkhdf(tmp_path / "a.vtkhdf"))
    assert np.array_equal(mesh.cells[0], [[0, 1, 2, 3]]) and np.array_equal(mesh.cells[1], [[4, 5, 6, 7]])
    assert np.array_equal(mesh.values, np.arange(8)) and mesh.scalars == ("a", "b")
    assert np.allclose(read_scattered(tmp_path / "a.vtkhdf", scalar="b").points, [(0.25,) * 3, (2.25,) * 3])
    volume = read_volume(vtkhdf(tmp_path / "i.hdf5", "ImageData"))
    assert np.array_equal(volume.values, VALUES) and volume.spacing == (1, 2, 3) and volume.origin == (0, 0, 1)
    assert read_volume(tmp_path / "i.hdf5", name="b").origin == (0.5, 1, 2.5)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"NumberOfPoints": [4, 5]}, "8 rows of Points"),
        ({"NumberOfPoints": [4, -4]}, "negative"),
        ({"NumberOfPoints": [4]}, "2 partitions in NumberOfCells"),
        ({"NumberOfCells": [10**18, 1]}, "Offsets"),
        ({"Connectivity": [0, 1, 2, 3, 0, 1, 2, 7]}, "points 0 to 7"),
        ({"Offsets": [0, 4, 0, 3]}, "4 points of"),
        ({"Offsets": [0, 4, 4, -4]}, "do not rise"),
        ({"Points": np.zeros((8, 2))}, r"\(N, 3\)"),
        ({"PointData/a": np.arange(7.0)}, "7 rows of a"),
        ({"Points": None}, "no numbers in Points"),
        ({"Points": h5py.ExternalLink("other.h5", "/Points")}, "link to another file"),
        ({"PointData/a": h5py.ExternalLink("other.h5", "/a")}, "link to another file"),
        ({"Type": np.bytes_("OverlappingAMR")}, "OverlappingAMR.*ImageData"),
        ({"Type": None}, "ImageData"),
        ({"Type": np.bytes_("ImageData")}, "WholeExtent|no array"),
    ],
)
def test_vtkhdf_that_lies(tmp_path, change, text):
    with pytest.raises(ss.InvalidInput, match=text):
        ss.open(vtkhdf(tmp_path / "a.vtkhdf", **change))


@pytest.mark.parametrize("kind", ["vti", "vtkhdf"])
def test_series_of_vtk(tmp_path, kind):
    """A .pvd names a file for each time."""
    for step in range(3):
        values = VALUES + step
        vtkhdf(tmp_path / f"a{step}.vtkhdf", "ImageData", **{"PointData/a": values, "CellData/b": None})
        body = " ".join(map(repr, values.ravel().tolist()))
        (tmp_path / f"a{step}.vti").write_text(
            '<VTKFile type="ImageData"><ImageData WholeExtent="0 5 0 4 0 3" Spacing="1 2 3" Origin="0 0 1">'
            '<Piece Extent="0 5 0 4 0 3"><PointData Scalars="a"><DataArray type="Float64" Name="a" format="ascii">'
            f"{body}</DataArray></PointData></Piece></ImageData></VTKFile>"
        )
    path = tmp_path / "run.pvd"

    def write(rows):
        sets = "".join(
            f'<DataSet timestep="{time}" group="" part="{part}" file="{file}"/>' for time, part, file in rows
        )
        path.write_text(f'<VTKFile type="Collection" version="0.1"><Collection>{sets}</Collection></VTKFile>')

    write([(0.5 * step, 0, f"a{step}.vti") for step in range(3)])
    if kind == "vtkhdf":
        write([(0.5 * step, 0, f"a{step}.{kind}") for step in range(3)])
        with pytest.raises(ss.InvalidInput, match="a block of format vtkhdf image"):
            ss.open(path, step=1)
        return
    assert np.array_equal(ss.open(path, step=1).values, VALUES + 1)
    options = {"size": 16, "backend": "reference", "opacity": 0.5}
    film = ss.animate(path, **options)
    wanted = ss.animate([tmp_path / f"a{step}.vti" for step in range(3)], **options)
    assert len(film) == 3 and all(np.array_equal(a.pixels, b.pixels) for a, b in zip(film, wanted, strict=True))
    for options, text in (({}, "3 time steps; wanted one; pass step=0"), ({"step": 3}, "no step 3 of 3")):
        with pytest.raises(ss.InvalidInput, match=text):
            ss.open(path, **options)
    for rows, text in (
        ([(0, 0, "a0.vti"), (0, 1, "a1.vti")], "2 parts at time"),
        ([(0, 0, "../a0.vti")], "a0.vti"),
        ([], "no step 0 of 0|0 blocks"),
        ([(0, 0, "gone.vti")], "gone.vti"),
    ):
        write(rows)
        with pytest.raises(ss.Error, match=text):
            ss.open(path)
    write([(0, 0, "a2.vti")])
    assert np.array_equal(ss.open(path).values, VALUES + 2)
