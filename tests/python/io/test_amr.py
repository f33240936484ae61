"""Overlapping AMR, as files and as objects of VTK: the cells that no finer level covers."""

import numpy as np
import pytest
from scattered_files import VtkWriter, stored

import sheetsplat as ss
from sheetsplat.io import read_scattered

# Level 0: 8 x 8 x 6 cells of 1; level 1: two blocks of cells of 1/2, from (2, 2, 1) to (5, 5, 4) and beside it.
BLOCKS = [
    [((0.0, 0.0, 0.0), 1.0, (8, 8, 6))],
    [((2.0, 2.0, 1.0), 0.5, (6, 6, 6)), ((5.0, 2.0, 1.0), 0.5, (2, 6, 6))],
    [((3.0, 3.0, 2.0), 0.25, (4, 4, 4))],
]


def middles(origin, edge, counts):
    """Return the middles of the cells of a block, x the fastest."""
    k, j, i = np.mgrid[0 : counts[2], 0 : counts[1], 0 : counts[0]].reshape(3, -1)
    return np.asarray(origin) + (np.stack((i, j, k), 1) + 0.5) * edge


def heat(points):
    return 1 + 0.5 * points[:, 0] - 0.25 * points[:, 1] + 0.125 * points[:, 2]


def wanted():
    """Return middles, values and edges of the cells that count, the finest first."""
    found = []
    for level in (2, 1, 0):
        for block in BLOCKS[level]:
            at = middles(*block)
            covered = np.zeros(len(at), bool)
            for finer in BLOCKS[level + 1 :]:
                for origin, edge, counts in finer:
                    low, high = np.asarray(origin), np.asarray(origin) + np.asarray(counts) * edge
                    covered |= ((at > low) & (at < high)).all(axis=1)
            found.append((at[~covered], np.full((~covered).sum(), block[1])))
    points = np.concatenate([one[0] for one in found])
    return points, heat(points), np.concatenate([one[1] for one in found])


def files(folder, of_points=False):
    """Write a .vthb and the images of its blocks."""
    lines = ['<VTKFile type="vtkOverlappingAMR" version="1.1" byte_order="LittleEndian">']
    lines.append('<vtkOverlappingAMR origin="0 0 0" grid_description="XYZ">')
    (folder / "amr").mkdir()
    for level, blocks in enumerate(BLOCKS):
        lines.append(f'<Block level="{level}" spacing="{blocks[0][1]} {blocks[0][1]} {blocks[0][1]}">')
        for number, (origin, edge, counts) in enumerate(blocks):
            name = f"amr/amr_{level}_{number}.vti"
            lines.append(f'<DataSet index="{number}" amr_box="0 1 0 1 0 1" file="{name}"/>')
            writer = VtkWriter("binary")
            values = heat(middles(origin, edge, counts))
            if of_points:
                values, counts = values, [count - 1 for count in counts]
            whole = " ".join(f"0 {count}" for count in counts)
            data = f"{'Point' if of_points else 'Cell'}Data"
            told = f'WholeExtent="{whole}" Origin="{" ".join(map(str, origin))}" Spacing="{edge} {edge} {edge}"'
            body = f'<ImageData {told}><Piece Extent="{whole}"><{data}>{writer.array("heat", values)}</{data}></Piece>'
            stored(folder / name, writer.file("ImageData", body + "</ImageData>"))
        lines.append("</Block>")
    return stored(folder / "a.vthb", "\n".join([*lines, "</vtkOverlappingAMR></VTKFile>"]).encode())


def check(data):
    points, values, edges = wanted()
    assert data.points.shape == points.shape and np.allclose(data.points, points) and np.allclose(data.values, values)
    assert np.allclose(data.scales, 2 * edges) and data.scalar == "heat"


def test_files_of_amr(tmp_path):
    path = files(tmp_path)
    data = read_scattered(path)
    check(data)
    assert data.details["cells"] == "64 of level 2, 280 of level 1, 348 of level 0"
    field = ss.open(path)
    # Also across the borders of levels, to within an eighth of a coarse cell.
    places = np.random.default_rng(1).uniform((1.6, 1.6, 1.6), (6.4, 6.4, 4.4), (500, 3))
    errors = np.abs(field.at(places) - heat(places))
    assert errors.max() < 0.12 * np.linalg.norm((0.5, 0.25, 0.125)) and np.median(errors) < 0.02
    fine = np.random.default_rng(2).uniform((3.4, 3.4, 2.4), (3.6, 3.6, 2.6), (50, 3))
    assert np.abs(field.at(fine) - heat(fine)).max() < 0.02


def test_values_hold_up_to_the_faces_of_the_data(tmp_path):
    field = ss.open(files(tmp_path))
    at = np.array([(0.02, 4.4, 0.9), (7.98, 4.4, 0.9), (4.1, 0.02, 0.9)])
    # There a mean has cells on one side alone, and is off by less than the value changes in three quarters of a cell.
    assert np.abs(field.at(at) - heat(at)).max() < 0.75 * 0.5 and (field.weight_at(at) > 0.98 * field.w0).all()
    # (A flat field is what it is, in all levels and between them.)
    flat = ss.EllipsoidField(
        field.centers, field.scales, values=np.ones(field.size), weights=field.weights, w0=field.w0
    )
    assert np.allclose(flat.at(np.random.default_rng(3).uniform((0, 0.5, 0.5), (8, 7.5, 5.5), (500, 3))), 1)


def test_objects_of_amr():
    core = pytest.importorskip("vtkmodules.vtkCommonDataModel")
    from vtkmodules.util.numpy_support import numpy_to_vtk

    amr = core.vtkOverlappingAMR()
    amr.Initialize([len(blocks) for blocks in BLOCKS])
    for level, blocks in enumerate(BLOCKS):
        for number, (origin, edge, counts) in enumerate(blocks):
            image = core.vtkUniformGrid()
            image.SetOrigin(origin)
            image.SetSpacing(edge, edge, edge)
            image.SetDimensions([count + 1 for count in counts])
            array = numpy_to_vtk(heat(middles(origin, edge, counts)), deep=True)
            array.SetName("heat")
            image.GetCellData().AddArray(array)
            amr.SetDataSet(level, number, image)
    field = ss.open(amr, scalar="heat")
    points, values, _ = wanted()
    assert np.allclose(field.centers, points) and np.allclose(field.values, values)
    with pytest.raises(ss.InvalidInput, match="cold"):
        ss.open(amr, scalar="cold")


def test_amr_that_lies_is_refused(tmp_path):
    path = files(tmp_path)
    text = path.read_text()
    for old, new, told in (
        ("amr/amr_1_0.vti", "../amr_1_0.vti", "own folder"),
        ("amr/amr_1_0.vti", "amr/none.vti", "none.vti"),
        ('level="1"', 'level="1000000"', "level 1000000"),
        ("<DataSet", "<Data", "no blocks"),
        ('type="vtkOverlappingAMR"', 'type="vtkNonOverlappingAMR"', "vtkNonOverlappingAMR"),
    ):
        with pytest.raises(ss.Error, match=told):
            read_scattered(stored(tmp_path / "b.vthb", text.replace(old, new).encode()))


def test_amr_of_points_is_refused(tmp_path):
    with pytest.raises(ss.InvalidInput, match="values of points"):
        read_scattered(files(tmp_path, of_points=True))


def test_meshes_of_meshio():
    meshio = pytest.importorskip("meshio")
    rng = np.random.default_rng(4)
    points = np.array([(x, y, z) for z in (0, 1, 2) for y in (0, 1, 2) for x in (0, 1, 2)], float)
    corners = [[c, c + 1, c + 4, c + 3, c + 9, c + 10, c + 13, c + 12] for c in (0, 1, 3, 4, 9, 10, 12, 13)]
    values, load = rng.random(27), rng.random(8)
    mesh = meshio.Mesh(points, [("hexahedron", corners)], {"heat": values}, {"load": [load]})
    field = ss.open(mesh)
    assert np.array_equal(field.centers, points) and np.array_equal(field.values, values)
    assert np.array_equal(field.scales, ss.fit.delaunay(points, values, cells=[np.array(corners)]).scales)
    middles_of_cells = ss.open(mesh, scalar="load")
    assert np.allclose(middles_of_cells.centers, points[corners].mean(axis=1)) and np.array_equal(
        middles_of_cells.values, load
    )
    assert ss.render(mesh, size=(24, 24)).rgba.any()
    with pytest.raises(ss.InvalidInput, match="cold"):
        ss.open(mesh, scalar="cold")
