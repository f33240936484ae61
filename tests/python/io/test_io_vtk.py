"""VTK's XML files: what the readers find in files that the tests write, and what they refuse."""

from __future__ import annotations

import gzip
import tracemalloc
import zlib

import numpy as np
import pytest
from scattered_files import VtkWriter, stored, vtu_body

import sheetsplat as ss
from sheetsplat.io import read_scattered, read_volume

WAYS = [
    ("ascii", {}),
    ("binary", {}),
    ("binary", {"packing": "vtkZLibDataCompressor", "wide": True}),
    ("base64", {"order": ">"}),
    ("base64", {"packing": "vtkZLibDataCompressor"}),
    ("raw", {"wide": True}),
    ("raw", {"order": ">", "packing": "vtkZLibDataCompressor"}),
    ("raw", {"packing": "vtkLZMADataCompressor"}),
]


@pytest.mark.parametrize("gz", [False, True])
@pytest.mark.parametrize(("way", "options"), WAYS)
def test_vtu(tmp_path, way, options, gz):
    writer = VtkWriter(way, **options)
    body, points, heat, flow, cells, load = vtu_body(writer)
    path = stored(tmp_path / "mesh.vtu", writer.file("UnstructuredGrid", body), gz)
    read = read_scattered(path)
    assert (read.scalar, read.scalars) == ("heat", ("flow", "flow_x", "flow_y", "flow_z", "heat", "load"))
    np.testing.assert_array_equal(read.points, points)
    np.testing.assert_array_equal(read.values, heat)
    tetra, voxel, hexahedra = read.cells
    np.testing.assert_array_equal(tetra, [cells[3]])
    np.testing.assert_array_equal(voxel, [np.array(cells[2])[[0, 1, 3, 2, 4, 5, 7, 6]]])
    np.testing.assert_array_equal(hexahedra, cells[:2])
    np.testing.assert_array_equal(read_scattered(path, scalar="flow_z").values, flow[:, 2])
    np.testing.assert_allclose(read_scattered(path, scalar="flow").values, np.linalg.norm(flow, axis=1), rtol=1e-6)
    of_cells = read_scattered(path, scalar="load")
    np.testing.assert_array_equal(of_cells.values, load)
    np.testing.assert_allclose(of_cells.points, [points[cell].astype(float).mean(axis=0) for cell in cells], rtol=1e-12)
    assert of_cells.cells is None
    with pytest.raises(ss.InvalidInput, match="'cold'.*flow, flow_x"):
        read_scattered(path, scalar="cold")


def test_vtu_in_pieces(tmp_path):
    writer = VtkWriter("ascii")
    body, points, heat, _, cells, _ = vtu_body(writer)
    piece = body[body.index("<Piece") : body.index("</UnstructuredGrid>")]
    both = f"<UnstructuredGrid>{piece}{piece}</UnstructuredGrid>"
    read = read_scattered(stored(tmp_path / "m.vtu", writer.file("UnstructuredGrid", both)))
    np.testing.assert_array_equal(read.points, np.concatenate([points, points]))
    np.testing.assert_array_equal(read.values, np.concatenate([heat, heat]))
    assert sum(len(block) for block in read.cells) == 8
    assert sorted(block.tolist() for block in read.cells if block.shape[1] == 4) == [
        [[16, 17, 18, 19]],
        [[36, 37, 38, 39]],
    ]


def test_vtp(tmp_path):
    writer = VtkWriter("raw", packing="vtkZLibDataCompressor")
    rng = np.random.default_rng(0)
    points, values, load = rng.normal(size=(6, 3)), rng.normal(size=6), rng.normal(size=3)

    def cells(connectivity, offsets):
        numbers = (("connectivity", connectivity), ("offsets", offsets))
        return "".join(writer.array(name, np.array(rows, np.int32)) for name, rows in numbers)

    body = f"""<PolyData><Piece NumberOfPoints="6" NumberOfVerts="1" NumberOfLines="0" NumberOfPolys="2">
    <PointData>{writer.array("value", values)}</PointData><CellData>{writer.array("load", load)}</CellData>
    <Points>{writer.array("Points", points)}</Points>
    <Lines>{cells([], [])}</Lines><Verts>{cells([5], [1])}</Verts><Polys>{cells([0, 1, 2, 1, 2, 3, 4], [3, 7])}</Polys>
    </Piece></PolyData>"""
    path = stored(tmp_path / "s.vtp", writer.file("PolyData", body))
    read = read_scattered(path)
    np.testing.assert_array_equal(read.points, points)
    np.testing.assert_array_equal(read.values, values)
    assert read.cells is None
    centres = read_scattered(path, scalar="load").points
    np.testing.assert_allclose(centres, [points[5], points[[0, 1, 2]].mean(0), points[[1, 2, 3, 4]].mean(0)])


@pytest.mark.parametrize(("way", "options"), WAYS)
def test_vti_is_a_volume(tmp_path, way, options):
    writer = VtkWriter(way, **options)
    values = np.arange(24, dtype=np.int16).reshape(2, 3, 4)
    load = np.arange(6, dtype=np.float32).reshape(1, 2, 3)
    body = f"""<ImageData WholeExtent="2 5 0 2 -1 0" Origin="1 2 3" Spacing="0.5 1 2"><Piece Extent="2 5 0 2 -1 0">
    <PointData Scalars="a">{writer.array("b", values.ravel() + 1)}{writer.array("a", values.ravel())}</PointData>
    <CellData>{writer.array("load", load.ravel())}</CellData></Piece></ImageData>"""
    path = stored(tmp_path / "i.vti", writer.file("ImageData", body), gz=way == "raw")
    volume = read_volume(path)
    np.testing.assert_array_equal(volume.values, values)
    assert (volume.spacing, volume.origin, volume.format) == ((0.5, 1, 2), (2, 2, 1), "vti")
    np.testing.assert_array_equal(read_volume(path, name="b").values, values + 1)
    of_cells = read_volume(path, name="load")
    np.testing.assert_array_equal(of_cells.values, load)
    assert of_cells.origin == (2.25, 2.5, 2.0)
    field = ss.open(path, scalar="b")
    assert isinstance(field, ss.RegularField)
    assert field.value_range == (1, 24)


def test_vti_in_pieces_is_put_together(tmp_path):
    writer = VtkWriter("ascii")
    values = np.arange(60, dtype=np.float32).reshape(3, 4, 5)

    def pieces(*extents):
        text = ""
        for a, b, c, d, e, f in extents:
            part = values[e : f + 1, c : d + 1, a : b + 1]
            data = f"<PointData>{writer.array('a', part.ravel())}</PointData>"
            text += f'<Piece Extent="{a} {b} {c} {d} {e} {f}">{data}</Piece>'
        return writer.file("ImageData", f'<ImageData WholeExtent="0 4 0 3 0 2">{text}</ImageData>')

    path = tmp_path / "i.vti"
    read = read_volume(stored(path, pieces((0, 2, 0, 3, 0, 2), (2, 4, 0, 1, 0, 2), (2, 4, 1, 3, 0, 2))))
    np.testing.assert_array_equal(read.values, values)
    for extents in [(0, 2, 0, 3, 0, 2), (2, 4, 0, 1, 0, 2)], [(0, 2, 0, 3, 0, 2), (2, 5, 0, 3, 0, 2)]:
        with pytest.raises(ss.InvalidInput, match="samples|inside"):
            read_volume(stored(path, pieces(*extents)))


def changed(way, change, **options):
    writer = VtkWriter(way, **options)
    body, *_ = vtu_body(writer)
    return change(writer.file("UnstructuredGrid", body))


HOSTILE = {
    "entities": lambda data: data.replace(
        b'<?xml version="1.0"?>', b'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "bbbb"><!ENTITY c "&b;&b;">]>'
    ),
    "a document type": lambda data: data.replace(b'"1.0"?>', b'"1.0"?><!DOCTYPE a SYSTEM "file:///etc/passwd">'),
    "many points": lambda data: data.replace(b'NumberOfPoints="20"', b'NumberOfPoints="1000000000000"'),
    "points that are no number": lambda data: data.replace(b'NumberOfPoints="20"', b'NumberOfPoints="-20"'),
    "fewer points": lambda data: data.replace(b'NumberOfPoints="20"', b'NumberOfPoints="19"'),
    "many cells": lambda data: data.replace(b'NumberOfCells="5"', b'NumberOfCells="1000000000000"'),
    "another type": lambda data: data.replace(b'type="UnstructuredGrid"', b'type="RectilinearGrid"'),
    "cut": lambda data: data[: len(data) // 2],
    "cut in the header": lambda data: data[:300],
}


@pytest.mark.parametrize("what", HOSTILE)
@pytest.mark.parametrize(("way", "options"), WAYS)
def test_vtu_that_lies_is_refused(tmp_path, what, way, options):
    path = stored(tmp_path / "m.vtu", changed(way, HOSTILE[what], **options))
    with pytest.raises((ss.InvalidInput, ss.OutOfMemory)) as error:
        read_scattered(path)
    assert "m.vtu" in str(error.value)


def test_vtu_that_lies_in_its_numbers_is_refused(tmp_path):
    path = tmp_path / "m.vtu"

    def vtu(connectivity, offsets, types, points=4):
        writer = VtkWriter("ascii")
        rows = np.arange(3.0 * points).reshape(-1, 3)
        cells = (("connectivity", connectivity), ("offsets", offsets), ("types", types))
        arrays = "".join(writer.array(name, np.asarray(values)) for name, values in cells)
        body = f"""<UnstructuredGrid><Piece NumberOfPoints="{points}" NumberOfCells="{len(offsets)}">
        <PointData>{writer.array("a", rows[:, 0])}</PointData><Points>{writer.array("P", rows)}</Points>
        <Cells>{arrays}</Cells></Piece></UnstructuredGrid>"""
        return stored(path, writer.file("UnstructuredGrid", body))

    assert len(read_scattered(vtu([0, 1, 2, 3], [4], [10])).cells[0]) == 1
    for connectivity, offsets, types, text in (
        ([0, 1, 2, 4], [4], [10], "points 0 to 4"),
        ([0, 1, 2, -1], [4], [10], "points -1 to 2"),
        ([0, 1, 2, 3], [3, 2], [5, 5], "rise"),
        ([0, 1, 2, 3], [5], [10], "numbers"),
        ([0, 1, 2], [3], [10], "4 points"),
        ([0, 1, 2, 3], [4], [10, 10], "numbers"),
    ):
        with pytest.raises(ss.InvalidInput, match=text):
            read_scattered(vtu(connectivity, offsets, types))
    # A cell of second order has no linear stand-in: the points are kept and joined anew.
    assert read_scattered(vtu([0, 1, 2, 3, 0, 1, 2, 3, 0, 1], [10], [24])).cells is None


def test_vtu_packed_blocks_yield_no_more_than_they_say(tmp_path):
    writer = VtkWriter("raw", packing="vtkZLibDataCompressor")
    bomb = zlib.compress(bytes(1 << 26))
    writer.packed = lambda data: [np.array([1, len(data), 0, len(bomb)], "<u4").tobytes(), bomb]
    body, *_ = vtu_body(writer)
    path = stored(tmp_path / "m.vtu", writer.file("UnstructuredGrid", body))
    # Zeros are what the block begins with: all points in one place, of no cell that rises.
    tracemalloc.start()
    with pytest.raises(ss.InvalidInput):
        read_scattered(path)
    assert tracemalloc.get_traced_memory()[1] < 1 << 24
    tracemalloc.stop()


def test_a_tag_without_an_end_is_given_up(tmp_path):
    """The parser starts again at the beginning of the tag with every chunk, so that its time would grow as a square."""
    path = tmp_path / "v.vti.gz"
    with gzip.open(path, "wb", 1) as file:
        file.write(b'<VTKFile type="ImageData" ')
        for _ in range(40):
            file.write(b" " * (1 << 20))
    with pytest.raises(ss.InvalidInput, match="a tag of more than 16 MiB"):
        read_volume(path)
