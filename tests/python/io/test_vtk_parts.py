"""Data sets of VTK in several files (.pvti, .pvtu …) and in several time steps of one file (.vtkhdf)."""

from __future__ import annotations

import os

import h5py
import numpy as np
import pytest
from scattered_files import VtkWriter
from test_vtk_files import VALUES, pyvista, vtkhdf, with_data

import sheetsplat as ss
from sheetsplat.io import read_scattered, read_volume

# ------------------------------------------------------------------------------------------------------ parallel files

EXTENT = "0 5 0 4 0 3"
DECLARED = {
    "P": '<PPointData Scalars="a"><PDataArray type="Float64" Name="a"/></PPointData>',
    "C": '<PCellData Scalars="a"><PDataArray type="Float64" Name="a"/></PCellData>',
}


def structured(folder, kind="ImageData", parts=((0, 2), (2, 5)), *, way="raw", of="P", names="part{}.xml"):
    """Write a grid of VALUES whose pieces along x are files; return the path of the file that names them."""
    folder.mkdir(exist_ok=True)
    k, j, i = np.mgrid[0:4, 0:5, 0:6].astype(float)
    points = np.stack([i + 0.1 * j, 2 * j, k], axis=-1)
    text = ""
    for number, (a, b) in enumerate(parts):
        writer = VtkWriter(way)
        part = np.s_[:, :, a : b + 1]
        place = ""
        if kind == "StructuredGrid":
            place = f"<Points>{writer.array('Points', points[part].reshape(-1, 3))}</Points>"
        if kind == "RectilinearGrid":
            along = (np.arange(a, b + 1.0), 2 * np.arange(5.0), np.arange(4.0))
            place = f"<Coordinates>{''.join(writer.array('c', one) for one in along)}</Coordinates>"
        values = VALUES[part] if of == "P" else VALUES[1:, 1:, a + 1 : b + 1]
        data = f"<{'Point' if of == 'P' else 'Cell'}Data>{writer.array('a', values.ravel())}"
        data += f"</{'Point' if of == 'P' else 'Cell'}Data>"
        extent = f"{a} {b} 0 4 0 3"
        body = f'<{kind} WholeExtent="{EXTENT}"><Piece Extent="{extent}">{data}{place}</Piece></{kind}>'
        (folder / names.format(number)).write_bytes(writer.file(kind, body))
        text += f'<Piece Extent="{extent}" Source="{names.format(number)}"/>'
    path = folder / "a.pvti"
    told = f'WholeExtent="{EXTENT}" GhostLevel="0" Origin="7 0 0" Spacing="1 2 3"'
    path.write_text(f'<VTKFile type="P{kind}"><P{kind} {told}>{DECLARED[of]}{text}</P{kind}></VTKFile>')
    return path


@pytest.mark.parametrize("way", ["raw", "ascii"])
@pytest.mark.parametrize("parts", [((0, 2), (2, 5)), ((0, 3), (1, 5)), ((0, 5),)], ids=["two", "overlapping", "one"])
def test_images_in_several_files(tmp_path, way, parts):
    volume = read_volume(structured(tmp_path, parts=parts, way=way))
    assert np.array_equal(volume.values, VALUES) and volume.spacing == (1, 2, 3) and volume.origin == (7, 0, 0)
    cells = read_volume(structured(tmp_path, parts=parts, way=way, of="C"))
    assert np.array_equal(cells.values, VALUES[1:, 1:, 1:]) and cells.origin == (7.5, 1, 1.5)


def test_grids_in_several_files(tmp_path):
    even = read_volume(structured(tmp_path, "RectilinearGrid"))
    assert np.array_equal(even.values, VALUES) and even.spacing == (1, 2, 1)
    curved = read_scattered(structured(tmp_path, "StructuredGrid"))
    assert np.array_equal(curved.values, VALUES.ravel()) and curved.cells[0].shape == (3 * 4 * 5, 8)


def meshes(folder, ghosts=True):
    """Write two tetrahedra of five points as two pieces; the second has the first's cell as a ghost."""
    points = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)], float)
    pieces = [([0, 1, 2, 3], [[0, 1, 2, 3]], [0]), ([0, 1, 2, 3, 4], [[0, 1, 2, 3], [1, 2, 3, 4]], [1, 0])]
    folder.mkdir(exist_ok=True)
    for number, (own, cells, marks) in enumerate(pieces):
        writer = VtkWriter("binary")
        values = np.array([1.0, 2.0])[-len(cells) :] if number else np.array([1.0])
        ghost = writer.array("vtkGhostType", np.array(marks, np.uint8)) if ghosts else ""
        body = f"""<UnstructuredGrid><Piece NumberOfPoints="{len(own)}" NumberOfCells="{len(cells)}">
        <PointData>{writer.array("a", np.array(own, float))}</PointData>
        <CellData>{ghost}{writer.array("b", values)}</CellData>
        <Points>{writer.array("Points", points[own])}</Points><Cells>
        {writer.array("connectivity", np.array(cells).ravel())}
        {writer.array("offsets", 4 * np.arange(1, len(cells) + 1))}
        {writer.array("types", np.full(len(cells), 10, np.uint8))}</Cells></Piece></UnstructuredGrid>"""
        (folder / f"m{number}.vtu").write_bytes(writer.file("UnstructuredGrid", body))
    arrays = "<PPointData>{}</PPointData><PCellData>{}{}</PCellData>".format(
        '<PDataArray type="Float64" Name="a"/>',
        '<PDataArray type="UInt8" Name="vtkGhostType"/>' if ghosts else "",
        '<PDataArray type="Float64" Name="b"/>',
    )
    text = '<Piece Source="m0.vtu"/><Piece Source="m1.vtu"/>'
    path = folder / "a.pvtu"
    kind = "PUnstructuredGrid"
    path.write_text(f'<VTKFile type="{kind}"><{kind} GhostLevel="1">{arrays}{text}</{kind}></VTKFile>')
    return path


def test_meshes_in_several_files(tmp_path):
    mesh = read_scattered(meshes(tmp_path))
    # Cells that another piece has are left out; points of both pieces are there twice.
    assert np.array_equal(mesh.values, [0, 1, 2, 3, 0, 1, 2, 3, 4]) and mesh.scalars == ("a", "b")
    assert [one.tolist() for one in mesh.cells] == [[[0, 1, 2, 3]], [[5, 6, 7, 8]]]
    assert np.array_equal(read_scattered(tmp_path / "a.pvtu", scalar="b").values, [1, 2])
    assert ss.open(tmp_path / "a.pvtu").size == 5
    assert read_scattered(meshes(tmp_path, ghosts=False), scalar="b").values.tolist() == [1, 1, 2]


@pytest.mark.parametrize("kind", ["image", "unstructured", "surface"])
def test_what_vtk_writes_in_parts(tmp_path, kind):
    """Three pieces with a layer of ghosts: all cells, each of them once."""
    pv = pyvista()
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersParallel import vtkExtractPolyDataPiece, vtkExtractUnstructuredGridPiece
    from vtkmodules.vtkImagingCore import vtkRTAnalyticSource
    from vtkmodules.vtkIOParallelXML import vtkXMLPImageDataWriter, vtkXMLPPolyDataWriter, vtkXMLPUnstructuredGridWriter

    cut, writer = {
        "image": (vtkRTAnalyticSource(), vtkXMLPImageDataWriter()),
        "unstructured": (vtkExtractUnstructuredGridPiece(), vtkXMLPUnstructuredGridWriter()),
        "surface": (vtkExtractPolyDataPiece(), vtkXMLPPolyDataWriter()),
    }[kind]
    if kind == "image":
        cut.SetWholeExtent(-2, 5, 0, 4, -3, 3)
    else:
        points = pv.PolyData(np.random.default_rng(2).random((60, 3)))
        grid = with_data(points.delaunay_3d() if kind == "unstructured" else pv.Sphere(theta_resolution=9))
        cut.SetInputData(grid)
    path = tmp_path / f"a.p{kind}"
    writer.SetFileName(str(path))
    writer.SetInputConnection(cut.GetOutputPort())
    writer.SetGhostLevel(1)
    writer.SetNumberOfPieces(3)
    writer.SetStartPiece(0)
    writer.SetEndPiece(2)
    writer.Write()
    assert len(list(tmp_path.iterdir())) == 4
    if kind == "image":
        found = read_volume(path)
        assert found.values.shape == (7, 5, 8) and found.origin == (-2, 0, -3)
        cut.UpdateWholeExtent()
        assert np.array_equal(found.values.ravel(), vtk_to_numpy(cut.GetOutput().GetPointData().GetScalars()))
    else:
        loads = read_scattered(path, scalar="load").values
        assert np.array_equal(np.sort(loads), np.sort(grid.cell_data["load"]))


def test_parts_stay_in_their_folder(tmp_path):
    """A pipe stands in for the other file: opening it would wait for ever."""
    os.mkfifo(tmp_path / "secret.vti")
    path = structured(tmp_path / "inner", names="p{}.vti")
    (path.parent / "link.vti").symlink_to(tmp_path / "secret.vti")
    good = path.read_text()
    for name in ("../secret.vti", str(tmp_path / "secret.vti"), "link.vti", "", ".", "a.pvti", "&#x2e;./secret.vti"):
        path.write_text(good.replace("p1.vti", name))
        with pytest.raises(ss.InvalidInput):
            ss.open(path)
    path.write_text('<!DOCTYPE a [<!ENTITY b SYSTEM "../secret.vti">]>' + good)
    with pytest.raises(ss.InvalidInput, match="document type"):
        ss.open(path)
    inner = path.parent / "below"
    inner.mkdir()
    (path.parent / "p1.vti").rename(inner / "p1.vti")
    path.write_text(good.replace("p1.vti", "below/p1.vti"))
    assert np.array_equal(ss.open(path).values, VALUES)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (("p1.vti", "p0.vti"), "two pieces in 'p0.vti'"),
        (("p1.vti", "a.pvti"), "PImageData"),
        (("p1.vti", "none.vti"), "no such file"),
        (('<Piece Extent="2 5 0 4 0 3" Source="p1.vti"/>', ""), "60 samples"),
        ((f'WholeExtent="{EXTENT}"', 'WholeExtent="0 999999999 0 999999999 0 9"'), "memory|63 bits"),
        ((f'WholeExtent="{EXTENT}"', 'WholeExtent="0 4 0 4 0 3"'), "one inside of"),
        (('Name="a"', 'Name="b"'), "no array 'b'"),
        (('type="Float64"', 'type="Float64" NumberOfComponents="3"'), "1 components"),
        (('type="Float64"', 'type="Float64" NumberOfComponents="999999999999"'), "components|memory"),
        (("PImageData", "PPImageData"), "of type 'PPImageData'"),
        (("PImageData", "PRectilinearGrid"), "ImageData; wanted RectilinearGrid"),
        (("<Piece", "<Part"), "no Piece"),
    ],
)
def test_parts_that_lie(tmp_path, change, text):
    path = structured(tmp_path, names="p{}.vti")
    good = path.read_text()
    assert change[0] in good
    path.write_text(good.replace(*change))
    with pytest.raises(ss.Error, match=text):
        ss.open(path)


def test_parts_that_are_damaged(tmp_path):
    """A piece that is cut off, of other types, or that leaves a part of the extent empty though it counts enough."""
    path = structured(tmp_path, names="p{}.vti")
    whole = (tmp_path / "p1.vti").read_bytes()
    for size in (0, 10, len(whole) // 2, len(whole) - 60):
        (tmp_path / "p1.vti").write_bytes(whole[:size])
        with pytest.raises(ss.Error, match="p1.vti"):
            ss.open(path)
    (tmp_path / "p1.vti").write_bytes(whole.replace(b"Float64", b"Int64"))
    with pytest.raises(ss.InvalidInput, match="types float64 and int64"):
        ss.open(path)
    gaps = structured(tmp_path, parts=((0, 3), (0, 4), (1, 3)))
    with pytest.raises(ss.InvalidInput, match="found pieces with 100 samples; wanted 120"):
        ss.open(gaps)


def test_series_of_files_in_parts(tmp_path):
    """What ParaView saves of a parallel run: a .pvd of .pvtu files; and a .vtm with one."""
    for step in range(2):
        structured(tmp_path / f"s{step}")
        if step:
            file = tmp_path / "s1" / "part1.xml"
            file.write_bytes(file.read_bytes().replace(VALUES[:, :, 2:].tobytes(), (VALUES[:, :, 2:] + 1).tobytes()))
    rows = "".join(f'<DataSet timestep="{step}" file="s{step}/a.pvti"/>' for step in range(2))
    (tmp_path / "a.pvd").write_text(f'<VTKFile type="Collection"><Collection>{rows}</Collection></VTKFile>')
    found = ss.open(tmp_path / "a.pvd", step=1).values
    assert np.array_equal(found[:, :, 2:], VALUES[:, :, 2:] + 1) and np.array_equal(found[:, :, :2], VALUES[:, :, :2])
    assert len(ss.animate(tmp_path / "a.pvd", size=16, backend="reference")) == 2
    kind = "vtkMultiBlockDataSet"
    block = '<DataSet index="0" name="a" file="s0/a.pvti"/>'
    (tmp_path / "a.vtm").write_text(f'<VTKFile type="{kind}"><{kind}>{block}</{kind}></VTKFile>')
    assert np.array_equal(ss.open(tmp_path / "a.vtm").values, VALUES)
    # Files that name one another.
    for name in ("a.vtm", "b.vtm"):
        (tmp_path / "a.vtm").write_text(f'<VTKFile type="{kind}"><{kind}><DataSet file="{name}"/></{kind}></VTKFile>')
        (tmp_path / "b.vtm").write_text(f'<VTKFile type="{kind}"><{kind}><DataSet file="a.vtm"/></{kind}></VTKFile>')
        with pytest.raises(ss.InvalidInput, match=f"{name}, which names files itself"):
            ss.open(tmp_path / "a.vtm")


# ---------------------------------------------------------------------------------------------------- steps of VTKHDF


def steps_of(count=3, **change):
    """Return what a file of meshes with time steps has beside `vtkhdf`: its partitions are steps; `change` as there."""
    data = {
        "Steps/Values": np.arange(float(count)),
        "Steps/PartOffsets": np.arange(count),
        "Steps/NumberOfParts": np.ones(count, int),
        "Steps/PointOffsets": 4 * np.arange(count),
        "Steps/CellOffsets": np.arange(count)[:, None],
        "Steps/ConnectivityIdOffsets": 4 * np.arange(count)[:, None],
        "Steps/PointDataOffsets/a": 4 * np.arange(count),
        "Steps/CellDataOffsets/b": np.arange(count),
    }
    return data | change


def timed(path, kind="UnstructuredGrid", steps=2, **change):
    vtkhdf(path, kind, **change)
    with h5py.File(path, "a") as file:
        group = file["VTKHDF"].require_group("Steps")
        if steps is not None:
            group.attrs["NSteps"] = steps
    return path


def timed_image(path, count=3, **change):
    data = {"PointData/a": VALUES + np.arange(count)[:, None, None, None], "CellData/b": None}
    return timed(path, "ImageData", count, **data, **{"Steps/Values": np.arange(float(count))} | change)


def test_time_steps_of_vtkhdf(tmp_path):
    path = timed(tmp_path / "a.vtkhdf", **steps_of(2))
    second = read_scattered(path, step=1)
    assert np.array_equal(second.points[0], (2, 2, 2)) and second.values.tolist() == [4, 5, 6, 7]
    assert second.cells[0].tolist() == [[0, 1, 2, 3]]
    assert read_scattered(path, scalar="b", step=1).values.tolist() == [1]
    with pytest.raises(ss.InvalidInput, match="2 time steps; wanted one; pass step=0"):
        ss.open(path)
    with pytest.raises(ss.InvalidInput, match="no step 2 of 2"):
        ss.open(path, step=2)
    # One geometry, whose values change.
    still = dict.fromkeys(("Steps/PartOffsets", "Steps/PointOffsets"), np.zeros(2, int))
    still |= dict.fromkeys(("Steps/CellOffsets", "Steps/ConnectivityIdOffsets"), np.zeros((2, 1), int))
    path = timed(tmp_path / "b.vtkhdf", **steps_of(2, **still))
    assert np.array_equal(read_scattered(path, step=1).points[0], (0, 0, 0))
    assert read_scattered(path, step=1).values.tolist() == [4, 5, 6, 7]


def test_time_steps_of_vtkhdf_images(tmp_path):
    path = timed_image(tmp_path / "a.vtkhdf")
    assert np.array_equal(ss.open(path, step=2).values, VALUES + 2)
    options = {"size": 16, "backend": "reference", "opacity": 0.5, "clim": (0, 3)}
    wanted = ss.animate([ss.open(path, step=step) for step in range(3)], **options)
    assert all(np.array_equal(a.pixels, b.pixels) for a, b in zip(ss.animate(path, **options), wanted, strict=True))
    # Steps may share their values.
    shared = timed_image(tmp_path / "b.vtkhdf", **{"Steps/PointDataOffsets/a": [0, 2, 0]})
    assert np.array_equal(ss.open(shared, step=1).values, VALUES + 2)
    assert np.array_equal(ss.open(shared, step=2).values, VALUES)
    assert np.array_equal(ss.open(timed_image(tmp_path / "c.vtkhdf", 1)).values, VALUES)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"steps": 10**18}, "1000000000000000000 time steps with 2 times"),
        ({"steps": 0}, "0 time steps"),
        ({"steps": None}, "0 time steps"),
        ({"Steps/Values": None}, "2 time steps with 0 times"),
        ({"Steps/PartOffsets": [0, 10**18]}, "2 rows of NumberOfPoints"),
        ({"Steps/PartOffsets": [0, -1]}, "-1 in Steps/PartOffsets"),
        ({"Steps/PartOffsets": [0.0, 1.0]}, "no whole numbers in Steps/PartOffsets"),
        ({"Steps/PartOffsets": [0]}, "1 rows of Steps/PartOffsets"),
        ({"Steps/NumberOfParts": [1, 10**18]}, "1000000000000000000 partitions"),
        ({"Steps/PointOffsets": [0, 10**18]}, "8 rows of Points"),
        ({"Steps/PointOffsets": [0, 5]}, "8 rows of Points"),
        ({"Steps/CellOffsets": [[0], [7]]}, "rows of Offsets"),
        ({"Steps/CellOffsets": np.zeros((2, 0), int)}, "no whole numbers in Steps/CellOffsets"),
        ({"Steps/ConnectivityIdOffsets": [[0], [5]]}, "8 rows of Connectivity"),
        ({"Steps/PointDataOffsets/a": [0, 5]}, "8 rows of a"),
        ({"Steps/PointOffsets": h5py.ExternalLink("other.h5", "/Points")}, "link to another file"),
        ({"Steps": h5py.ExternalLink("other.h5", "/Steps")}, "link to another file"),
    ],
)
def test_time_steps_of_vtkhdf_that_lie(tmp_path, change, text):
    change = dict(change)
    steps = {"steps": change.pop("steps")} if "steps" in change else {}
    if "Steps" in change:
        path = vtkhdf(tmp_path / "a.vtkhdf", **change)
    else:
        path = timed(tmp_path / "a.vtkhdf", **steps, **steps_of(2, **change))
    with pytest.raises(ss.InvalidInput, match=text):
        ss.open(path, step=1)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"Steps/PointDataOffsets/a": [0, 3, 0]}, "3 rows of a"),
        ({"PointData/a": VALUES}, "no array of numbers"),
        ({"PointData/a": VALUES[None, 1:]}, "WholeExtent says"),
    ],
)
def test_time_steps_of_vtkhdf_images_that_lie(tmp_path, change, text):
    path = timed_image(tmp_path / "a.vtkhdf")
    with h5py.File(path, "a") as file:
        for name, values in change.items():
            file["VTKHDF"].pop(name, None)
            file["VTKHDF"][name] = values
    with pytest.raises(ss.InvalidInput, match=text):
        ss.open(path, step=1)


def test_more_steps_than_a_film_can_have_are_refused(tmp_path):
    """Compressed zeros: a small file, whose steps would fill the memory as a list."""
    path = vtkhdf(tmp_path / "a.vtkhdf", "ImageData")
    with h5py.File(path, "a") as file:
        steps = file["VTKHDF"].create_group("Steps")
        steps.attrs["NSteps"] = 1_000_000
        steps.create_dataset("Values", data=np.zeros(1_000_000), chunks=True, compression="gzip")
    with pytest.raises(ss.InvalidInput, match="1000000 time steps; wanted at most 100000"):
        ss.animate(path)


@pytest.mark.parametrize("grows", [False, True])
def test_time_steps_that_vtk_writes(tmp_path, grows):
    """A mesh that moves, and grows by cells, in several times."""
    pyvista()
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersGeneral import vtkTimeSourceExample
    from vtkmodules.vtkIOHDF import vtkHDFWriter

    source = vtkTimeSourceExample()
    source.SetXAmplitude(2.0)
    source.SetGrowing(grows)
    writer = vtkHDFWriter()
    writer.SetFileName(str(tmp_path / "a.vtkhdf"))
    writer.SetInputConnection(source.GetOutputPort())
    writer.SetWriteAllTimeSteps(True)
    assert writer.Write()
    with h5py.File(tmp_path / "a.vtkhdf") as file:
        times = file["VTKHDF/Steps/Values"][:]
    assert len(times) > 5
    for step in (0, 3, len(times) - 1):
        source.UpdateTimeStep(times[step])
        made = source.GetOutput()
        for name, data in (("Point X", made.GetPointData()), ("Cell X", made.GetCellData())):
            found = read_scattered(tmp_path / "a.vtkhdf", scalar=name, step=step)
            assert np.allclose(found.values, vtk_to_numpy(data.GetArray(name)))
        points = read_scattered(tmp_path / "a.vtkhdf", scalar="Point X", step=step)
        assert np.allclose(points.points, vtk_to_numpy(made.GetPoints().GetData()))
        assert sum(len(one) for one in points.cells) == made.GetNumberOfCells()
