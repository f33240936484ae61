"""Scattered data from files: what the readers find in files that the tests write, and what they refuse."""

from __future__ import annotations

import base64
import gzip
import io
import itertools
import math
import struct
import tracemalloc
import zipfile
import zlib

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat.io import read_scattered, read_volume
from sheetsplat.io.kernels import logarithm
from sheetsplat.io.sph_hdf5 import _cubic_spline

h5py = pytest.importorskip("h5py")


def stored(path, data: bytes, gz: bool = False):
    path.write_bytes(gzip.compress(data) if gz else data)
    return path


# PLOT3D


def marked(data: bytes, order: str, records: bool) -> bytes:
    mark = struct.pack(f"{order}i", len(data))
    return mark + data + mark if records else data


def plot3d_files(blocks, *, order=">", itemsize=4, iblank=False, records=False, several=False, surplus=0, seed=1):
    """Return grid and solution as bytes, and what they hold: points, the five arrays, and iblank."""
    rng = np.random.default_rng(seed)
    real, whole = f"{order}f{itemsize}", f"{order}i4"
    sizes = marked(np.array(blocks, whole).tobytes(), order, records)
    header = (marked(np.array([len(blocks)], whole).tobytes(), order, records) if several else b"") + sizes
    grid, solution = header, header
    all_points, all_flow, all_blank = [], [], []
    for ni, nj, nk in blocks:
        count = ni * nj * nk
        k, j, i = np.mgrid[0:nk, 0:nj, 0:ni].reshape(3, -1)
        points = np.stack([i, j, k]) + rng.uniform(-0.2, 0.2, (3, count))
        flow = rng.uniform(0.5, 1.5, (5, count)) + np.array([0, 0, 0, 0, 5.0])[:, None]
        blank = rng.choice([-1, 0, 1, 2], count, p=[0.1, 0.2, 0.6, 0.1])
        data = points.astype(real).tobytes() + (blank.astype(whole).tobytes() if iblank else b"")
        grid += marked(data, order, records)
        solution += marked(np.array([2.5, 0, 1e6, 0], real).tobytes(), order, records)
        solution += marked(flow.astype(real).tobytes(), order, records)
        all_points.append(points.astype(real).astype(float).T)
        all_flow.append(flow.astype(real).astype(float))
        all_blank.append(blank)
    flow = np.concatenate(all_flow, axis=1)
    return grid, solution + bytes(surplus), np.concatenate(all_points), flow, np.concatenate(all_blank)


LAYOUTS = list(itertools.product("<>", (4, 8), (False, True), (False, True), (False, True)))


@pytest.mark.parametrize(("order", "itemsize", "iblank", "records", "several"), LAYOUTS)
def test_plot3d_in_every_layout(tmp_path, order, itemsize, iblank, records, several):
    blocks = [(4, 3, 2), (2, 5, 3)] if several else [(4, 3, 2)]
    grid, solution, points, flow, blank = plot3d_files(
        blocks, order=order, itemsize=itemsize, iblank=iblank, records=records, several=several
    )
    xyz = stored(tmp_path / "xyz.bin", grid, gz=records)
    q = stored(tmp_path / "q.bin", solution, gz=not records)
    shown = blank != 0 if iblank else np.ones(len(blank), bool)
    for name, values in (("density", flow[0]), ("energy", flow[4]), ("momentum_y", flow[2])):
        read = read_scattered(q, grid=xyz, scalar=name)
        np.testing.assert_array_equal(read.points, points[shown])
        np.testing.assert_array_equal(read.values, values[shown])
    number = np.cumsum(shown) - 1
    cells, first = set(), 0
    for ni, nj, nk in blocks:
        for k, j, i in itertools.product(range(nk - 1), range(nj - 1), range(ni - 1)):
            square = [(j, i), (j, i + 1), (j + 1, i + 1), (j + 1, i)]
            corner = [first + ((k + up) * nj + b) * ni + a for up in (0, 1) for b, a in square]
            if shown[corner].all():
                cells.add(tuple(number[corner].tolist()))
        first += ni * nj * nk
    assert {tuple(cell) for block in read.cells or () for cell in block.tolist()} == cells


def test_plot3d_grid_and_solution_may_be_written_differently(tmp_path):
    grid, *_ = plot3d_files([(4, 3, 2)], order="<", itemsize=8)
    _, solution, points, flow, _ = plot3d_files([(4, 3, 2)], order=">", itemsize=4, records=True)
    read = read_scattered(stored(tmp_path / "q", solution), grid=stored(tmp_path / "g", grid))
    np.testing.assert_allclose(read.points, points, rtol=1e-6)
    np.testing.assert_array_equal(read.values, flow[0])


def test_plot3d_scalars_are_what_their_formulas_say(tmp_path):
    grid, solution, _, flow, _ = plot3d_files([(4, 3, 2)], itemsize=8)
    xyz, q = stored(tmp_path / "g", grid), stored(tmp_path / "q", solution)
    r, u, v, w, e = flow[0], *(flow[1:4] / flow[0]), flow[4]
    p = 0.4 * (e - 0.5 * r * (u**2 + v**2 + w**2))
    c = np.sqrt(1.4 * p / r)
    speed = np.sqrt(u**2 + v**2 + w**2)
    wanted = {
        "momentum": r * speed,
        "velocity": speed,
        "velocity_x": u,
        "pressure": p,
        "temperature": 1.4 * p / r,
        "enthalpy": (e + p) / r - 0.5 * speed**2,
        "kinetic_energy": 0.5 * r * speed**2,
        "sound_speed": c,
        "mach": speed / c,
        "entropy": 2.5 * np.log(1.4 * p / r**1.4),
    }
    for name, values in wanted.items():
        np.testing.assert_allclose(read_scattered(q, grid=xyz, scalar=name).values, values, rtol=1e-12)
    with pytest.raises(ss.InvalidInput, match="vorticity.*density, momentum"):
        read_scattered(q, grid=xyz, scalar="vorticity")


def test_plot3d_bytes_at_the_end_of_a_solution_belong_to_nothing(tmp_path):
    grid, solution, _, flow, _ = plot3d_files([(8, 6, 5)], surplus=484)
    read = read_scattered(stored(tmp_path / "q", solution), grid=stored(tmp_path / "g", grid))
    np.testing.assert_array_equal(read.values, flow[0])
    assert "484 unused bytes" in read.details["solution"]


@pytest.mark.parametrize("gz", [False, True])
@pytest.mark.parametrize("part", ["grid", "solution"])
@pytest.mark.parametrize("cut", [1, 100, 480])
def test_plot3d_that_is_cut_off_is_refused(tmp_path, gz, part, cut):
    grid, solution, *_ = plot3d_files([(5, 4, 3)])
    files = {"grid": grid, "solution": solution}
    files[part] = files[part][:-cut]
    q, xyz = stored(tmp_path / "q", files["solution"], gz), stored(tmp_path / "g", files["grid"], gz)
    with pytest.raises(ss.InvalidInput, match=rf"{len(files[part])} bytes.*5 x 4 x 3"):
        read_scattered(q, grid=xyz)


def test_plot3d_of_mixed_byte_order_is_refused(tmp_path):
    grid, solution, *_ = plot3d_files([(5, 4, 3)], order=">")
    other_grid, other_solution, *_ = plot3d_files([(5, 4, 3)], order="<")
    for xyz, q in ((grid[:12] + other_grid[12:], solution), (grid, solution[:12] + other_solution[12:])):
        with pytest.raises(ss.InvalidInput, match="sizes that are big-endian beside numbers that are little-endian"):
            read_scattered(stored(tmp_path / "q", q), grid=stored(tmp_path / "g", xyz))


def test_plot3d_that_makes_no_sense_is_refused(tmp_path):
    grid, solution, *_ = plot3d_files([(5, 4, 3)])
    other, *_ = plot3d_files([(3, 4, 5)])
    xyz, q = stored(tmp_path / "g", grid), stored(tmp_path / "q", solution)
    with pytest.raises(ss.InvalidInput, match="5 x 4 x 3.*3 x 4 x 5, as the grid"):
        read_scattered(q, grid=stored(tmp_path / "other", other))
    with pytest.raises(ss.InvalidInput, match="no such file"):
        read_scattered(q, grid=tmp_path / "none")
    with pytest.raises(ss.InvalidInput, match="first numbers"):
        read_scattered(stored(tmp_path / "text", b"  5 4 3\n 1.0 2.0 3.0\n"), grid=xyz)
    records, *_ = plot3d_files([(5, 4, 3)], records=True)
    broken = bytearray(records)
    broken[-1] ^= 1
    with pytest.raises(ss.InvalidInput, match="a record that says"):
        read_scattered(q, grid=stored(tmp_path / "records", bytes(broken)))


@pytest.mark.parametrize("gz", [False, True])
@pytest.mark.parametrize("sizes", [(10000, 10000, 10000), (1 << 24, 1 << 24, 1 << 24)])
def test_plot3d_that_promises_too_much_takes_no_memory(tmp_path, gz, sizes):
    hostile = stored(tmp_path / "h", np.array(sizes, ">i4").tobytes() + bytes(1000), gz)
    grid, *_ = plot3d_files([(5, 4, 3)])
    with pytest.raises(ss.InvalidInput, match="1012 bytes"):
        read_scattered(hostile, grid=hostile)
    with pytest.raises(ss.InvalidInput, match="1012 bytes"):
        read_scattered(hostile, grid=stored(tmp_path / "g", grid))


def test_plot3d_values_that_are_not_finite_are_named(tmp_path):
    grid, solution, _, flow, _ = plot3d_files([(5, 4, 3)])
    count = flow.shape[1]
    zero = bytearray(solution)
    zero[-4 * count :] = bytes(4 * count)
    xyz, q = stored(tmp_path / "g", grid), stored(tmp_path / "q", bytes(zero))
    assert read_scattered(q, grid=xyz, scalar="momentum").values.size == count
    for name in ("mach", "pressure", "entropy"):
        with pytest.raises(ss.InvalidInput, match="energy field of this file is all 0"):
            read_scattered(q, grid=xyz, scalar=name)
    wrong = bytearray(grid)
    wrong[12 + 4 * 7 : 16 + 4 * 7] = struct.pack(">f", math.nan)
    with pytest.raises(ss.InvalidInput, match=r"1 positions that are not finite, the first at 7"):
        read_scattered(q, grid=stored(tmp_path / "nan", bytes(wrong)))


# VTK XML


# What VTK writes into arrays beside their numbers.
KEY = """<InformationKey name="L2_NORM_RANGE" location="vtkDataArray" length="2">
<Value index="0">0.5</Value><Value index="1">0.5000000001</Value></InformationKey>
"""


class VtkWriter:
    """Writes DataArrays in one of the ways that the format has."""

    def __init__(self, way, *, order="<", packing="", wide=False):
        self.way, self.order, self.packing, self.wide = way, order, packing, wide
        self.appended = b""

    def packed(self, data: bytes) -> list[bytes]:
        number = f"{self.order}u{8 if self.wide else 4}"
        if not self.packing:
            return [np.array([len(data)], number).tobytes() + data]
        size = 96
        blocks = [data[at : at + size] for at in range(0, len(data), size)]
        if self.packing == "vtkZLibDataCompressor":
            packed = [zlib.compress(block) for block in blocks]
        else:
            import lzma

            packed = [lzma.compress(block) for block in blocks]
        last = len(blocks[-1]) % size if blocks else 0
        header = np.array([len(blocks), size, last, *map(len, packed)], number).tobytes()
        return [header, b"".join(packed)]

    def array(self, name, values, **more) -> str:
        values = np.asarray(values)
        kind = {"f": "Float", "i": "Int", "u": "UInt"}[values.dtype.kind] + str(8 * values.dtype.itemsize)
        components = values.shape[1] if values.ndim == 2 else 1
        told = f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{components}"'
        if self.way == "ascii":
            text = " ".join(repr(part) for part in values.ravel().tolist())
            return f'{told} format="ascii">\n{text}\n{KEY}</DataArray>'
        parts = self.packed(values.astype(values.dtype.newbyteorder(self.order)).tobytes())
        if self.way == "binary":
            text = b"".join(base64.b64encode(part) for part in parts).decode()
            return f'{told} format="binary">\n  {KEY}{text}\n</DataArray>'
        told = f'{told} format="appended" offset="{len(self.appended)}">{KEY}</DataArray>'
        self.appended += b"".join(base64.b64encode(part) if self.way == "base64" else part for part in parts)
        return told

    def file(self, kind: str, body: str) -> bytes:
        order = "LittleEndian" if self.order == "<" else "BigEndian"
        header = f' header_type="UInt{64 if self.wide else 32}"' if self.wide else ""
        packing = f' compressor="{self.packing}"' if self.packing else ""
        told = f'type="{kind}" version="1.0" byte_order="{order}"{header}{packing}'
        text = f'<?xml version="1.0"?>\n<VTKFile {told}>\n{body}'
        if self.way in ("raw", "base64"):
            appended = f'<AppendedData encoding="{self.way}">\n  _'.encode()
            return text.encode() + appended + self.appended + b"\n</AppendedData></VTKFile>\n"
        return (text + "</VTKFile>\n").encode()


def vtu_body(writer, seed=3):
    """Return two hexahedra, a voxel, a tetrahedron and a triangle, and what they hold."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (20, 3)).astype(np.float32)
    heat = rng.uniform(300, 400, 20).astype(np.float64)
    flow = rng.uniform(-1, 1, (20, 3)).astype(np.float32)
    cells = [list(range(8)), list(range(4, 12)), list(range(8, 16)), [16, 17, 18, 19], [0, 5, 9]]
    types = np.array([12, 12, 11, 10, 5], np.uint8)
    load = rng.uniform(0, 1, 5).astype(np.float32)
    body = f"""<UnstructuredGrid><Piece NumberOfPoints="20" NumberOfCells="5">
    <PointData Scalars="heat">{writer.array("flow", flow)}{writer.array("heat", heat)}</PointData>
    <CellData>{writer.array("load", load)}</CellData>
    <Points>{writer.array("Points", points)}</Points>
    <Cells>{writer.array("connectivity", np.concatenate(cells).astype(np.int64))}
    {writer.array("offsets", np.cumsum([len(cell) for cell in cells]).astype(np.int32))}
    {writer.array("types", types)}</Cells></Piece></UnstructuredGrid>"""
    return body, points, heat, flow, cells, load


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


# HDF5


def write_particles(path, count=40, *, group="PartType0", leave_out=(), order="<", seed=5, **more):
    rng = np.random.default_rng(seed)
    data = {
        "Coordinates": rng.uniform(0, 10, (count, 3)),
        "SmoothingLength": rng.uniform(1, 2, count).astype(np.float32),
        "Density": 10.0 ** rng.uniform(-4, 3, count),
        "Masses": rng.uniform(1, 2, count),
        "Velocities": rng.normal(size=(count, 3)).astype(np.float32),
        "ParticleIDs": np.arange(count, dtype=np.uint64),
        **more,
    }
    with h5py.File(path, "w") as file:
        for name, values in data.items():
            if name not in leave_out:
                file[f"{group}/{name}"] = np.asarray(values).astype(np.asarray(values).dtype.newbyteorder(order))
    return path, data


@pytest.mark.parametrize("gz", [False, True])
@pytest.mark.parametrize("order", ["<", ">"])
def test_particles(tmp_path, gz, order):
    path, data = write_particles(tmp_path / "s.hdf5", order=order)
    if gz:
        path = stored(tmp_path / "s.hdf5.gz", path.read_bytes(), gz=True)
    read = read_scattered(path)
    assert read.scalar == "Density"
    assert set(read.scalars) >= {"Density", "Masses", "Velocities", "Velocities_x", "ParticleIDs"}
    np.testing.assert_array_equal(read.points, data["Coordinates"])
    np.testing.assert_array_equal(read.values, data["Density"])
    np.testing.assert_array_equal(read.masses, data["Masses"])
    np.testing.assert_array_equal(read.densities, data["Density"])
    # Random densities agree with no kernel: then it is what Gadget means.
    np.testing.assert_array_equal(read.supports, data["SmoothingLength"])
    np.testing.assert_array_equal(read_scattered(path, support=2).supports, 2 * data["SmoothingLength"].astype(float))
    np.testing.assert_array_equal(read_scattered(path, scalar="Velocities_y").values, data["Velocities"][:, 1])
    speed = np.linalg.norm(data["Velocities"], axis=1)
    np.testing.assert_allclose(read_scattered(path, scalar="Velocities").values, speed, rtol=1e-6)


@pytest.mark.parametrize("factor", [1.0, 1.825742, 2.0])
def test_the_support_of_particles_is_found_by_their_densities(tmp_path, factor):
    rng = np.random.default_rng(1)
    points, lengths, masses = rng.uniform(0, 4, (300, 3)), rng.uniform(0.5, 0.8, 300), rng.uniform(1, 2, 300)
    reach = factor * lengths
    distance = np.linalg.norm(points[:, None] - points[None], axis=2) / reach[:, None]
    densities = (masses * _cubic_spline(distance)).sum(axis=1) / reach**3
    more = {"Coordinates": points, "SmoothingLength": lengths, "Masses": masses, "Density": densities}
    path, _ = write_particles(tmp_path / "s.h5", **more)
    np.testing.assert_allclose(read_scattered(path).supports, reach, rtol=1e-12)
    # Half the densities are explained by none of the three.
    path, _ = write_particles(tmp_path / "t.h5", **{**more, "Density": 0.5 * densities})
    np.testing.assert_allclose(read_scattered(path).supports, lengths, rtol=1e-12)


def test_other_groups_of_particles(tmp_path):
    path, data = write_particles(
        tmp_path / "s.h5", group="PartType4", leave_out=("SmoothingLength", "Density", "Masses")
    )
    with h5py.File(path, "a") as file:
        file.create_group("Header").attrs["MassTable"] = [0, 0, 0, 0, 2.5, 0]
    with pytest.raises(ss.InvalidInput, match="'PartType0', but PartType4.*particles"):
        read_scattered(path)
    read = read_scattered(path, particles="PartType4", scalar="Velocities")
    assert read.supports is None
    np.testing.assert_array_equal(read.masses, np.full(40, 2.5))
    for name in ("Header", "PartType4/Coordinates", "", "/", ".."):
        with pytest.raises(ss.InvalidInput):
            read_scattered(path, particles=name)


def test_particles_without_smoothing_lengths_need_neighbors(tmp_path):
    path, _ = write_particles(tmp_path / "s.h5", leave_out=("SmoothingLength",))
    with pytest.raises(ss.InvalidInput, match=r"no smoothing lengths.*neighbors=32"):
        ss.open(path)


def test_particles_that_lie_are_refused(tmp_path):
    path, _ = write_particles(tmp_path / "a.h5", Density=np.ones(39))
    with pytest.raises(ss.InvalidInput, match="Density"):
        read_scattered(path, scalar="Density")
    with pytest.raises(ss.InvalidInput, match="39 rows"):
        read_scattered(path, scalar="Masses")
    path, _ = write_particles(tmp_path / "b.h5", leave_out=("Coordinates",))
    with pytest.raises(ss.InvalidInput, match="Coordinates"):
        read_scattered(path)
    path, _ = write_particles(tmp_path / "c.h5", Density=[math.nan, *np.ones(39)])
    with pytest.raises(ss.InvalidInput, match="1 of 40 values not finite, the first at 0"):
        read_scattered(path)
    for data in (path.read_bytes()[:1000], path.read_bytes()[:-600], b"\x89HDF\r\n\x1a\n" + bytes(100)):
        with pytest.raises(ss.Error):
            read_scattered(stored(tmp_path / "d.h5", data))
        with pytest.raises(ss.Error):
            read_scattered(stored(tmp_path / "d.h5.gz", data, gz=True))


def test_particles_that_were_never_written_take_no_memory(tmp_path):
    path = tmp_path / "s.h5"
    with h5py.File(path, "w") as file:
        group = file.create_group("PartType0")
        group.create_dataset("Coordinates", (10**12, 3), "f4", chunks=(1024, 3))
        group.create_dataset("Density", (10**12,), "f4", chunks=(1024,))
    with pytest.raises((ss.InvalidInput, ss.OutOfMemory)):
        read_scattered(path)
    with h5py.File(path, "w") as file:
        group = file.create_group("PartType0")
        group.create_dataset("Coordinates", (10**5, 3), "f4", chunks=(1024, 3), fillvalue=3.0)
        group.create_dataset("Density", (10**5,), "f4", chunks=(1024,))
    with pytest.raises(ss.InvalidInput, match="0 stored bytes"):
        read_scattered(path)


def test_particles_do_not_reach_for_other_files(tmp_path):
    secret = stored(tmp_path / "secret", bytes(40 * 8))
    other, _ = write_particles(tmp_path / "other.h5")
    path, _ = write_particles(tmp_path / "s.h5", leave_out=("Density",))
    with h5py.File(path, "a") as file:
        file["PartType0"].create_dataset("Raw", (40,), "f8", external=[(str(secret), 0, 320)])
        layout = h5py.VirtualLayout((40,), "f8")
        layout[:] = h5py.VirtualSource(str(other), "PartType0/Density", (40,))
        file["PartType0"].create_virtual_dataset("Virtual", layout)
        file["PartType0/Density"] = h5py.ExternalLink(str(other), "PartType0/Density")
        file["PartType1"] = h5py.ExternalLink(str(other), "PartType0")
    for name in ("Raw", "Virtual"):
        with pytest.raises(ss.InvalidInput, match="in another file"):
            read_scattered(path, scalar=name)
    with pytest.raises(ss.InvalidInput, match="'Density'"):
        read_scattered(path, scalar="Density")
    with pytest.raises(ss.InvalidInput, match="PartType1"):
        read_scattered(path, particles="PartType1")


# PLY


PLY = [
    "x",
    "y",
    "z",
    "f_dc_0",
    "f_dc_1",
    "f_dc_2",
    "opacity",
    *(f"scale_{n}" for n in range(3)),
    *(f"rot_{n}" for n in range(4)),
]
PLY_FORMATS = {"<": "binary_little_endian", ">": "binary_big_endian", "text": "ascii"}


def ply_bytes(order="<", names=PLY, count=30, kind="float", claimed=None, seed=7, before=""):
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(count, len(names))).astype(np.float32)
    header = f"ply\nformat {PLY_FORMATS[order]} 1.0\ncomment made by a test\n{before}"
    header += f"element vertex {count if claimed is None else claimed}\n"
    header += "".join(f"property {kind} {name}\n" for name in names) + "end_header\n"
    if order == "text":
        data = "".join(" ".join(map(repr, row)) + "\n" for row in rows.tolist()).encode()
    else:
        data = rows.astype(f"{order}f{8 if kind == 'double' else 4}").tobytes()
    return header.encode(), data, {name: rows[:, column].astype(float) for column, name in enumerate(names)}


@pytest.mark.parametrize("gz", [False, True])
@pytest.mark.parametrize("kind", ["float", "double"])
@pytest.mark.parametrize("order", list(PLY_FORMATS))
def test_gaussians(tmp_path, order, kind, gz):
    header, data, wanted = ply_bytes(order, kind=kind)
    path = stored(tmp_path / "g.ply", header + data, gz)
    read = read_scattered(path)
    assert (read.scalar, read.scalars[0], len(read.points)) == ("opacity", "opacity", 30)
    np.testing.assert_array_equal(read.points, np.stack([wanted[axis] for axis in "xyz"], axis=1))
    np.testing.assert_allclose(read.values, 1 / (1 + np.exp(-wanted["opacity"])), rtol=1e-12)
    np.testing.assert_allclose(read.deviations[:, 1], np.exp(wanted["scale_1"]), rtol=1e-12)
    turns = np.stack([wanted[f"rot_{n}"] for n in range(4)], axis=1)
    np.testing.assert_allclose(read.rotations, turns / np.linalg.norm(turns, axis=1)[:, None], rtol=1e-12)
    np.testing.assert_array_equal(read_scattered(path, scalar="f_dc_1").values, wanted["f_dc_1"])
    red = read_scattered(path, scalar="red").values
    np.testing.assert_allclose(red, 0.5 + wanted["f_dc_0"] / (2 * math.sqrt(math.pi)), rtol=1e-12)
    with pytest.raises(ss.InvalidInput, match="'purple'.*opacity"):
        read_scattered(path, scalar="purple")


def test_gaussians_behind_other_elements(tmp_path):
    header, data, wanted = ply_bytes(before="element camera 2\nproperty uchar a\nproperty short b\n")
    read = read_scattered(stored(tmp_path / "g.ply", header + bytes(6) + data))
    np.testing.assert_array_equal(read.points[:, 0], wanted["x"])
    header, data, wanted = ply_bytes("text", before="element camera 2\nproperty uchar a\nproperty short b\n")
    read = read_scattered(stored(tmp_path / "t.ply", header + b"1 2\n3 4\n" + data))
    np.testing.assert_array_equal(read.points[:, 0], wanted["x"])
    header, data, _ = ply_bytes(before="element face 2\nproperty list uchar int a\n")
    with pytest.raises(ss.InvalidInput, match="lists in face"):
        read_scattered(stored(tmp_path / "g.ply", header + data))


@pytest.mark.parametrize("missing", ["x", "scale_2", "rot_3", "opacity"])
def test_gaussians_with_missing_properties_are_refused(tmp_path, missing):
    header, data, _ = ply_bytes(names=[name for name in PLY if name != missing])
    with pytest.raises(ss.InvalidInput, match=f"without {missing}"):
        read_scattered(stored(tmp_path / "g.ply", header + data))


@pytest.mark.parametrize("gz", [False, True])
@pytest.mark.parametrize("order", list(PLY_FORMATS))
@pytest.mark.parametrize("claimed", [31, 10**12, 10**30])
def test_gaussians_that_are_not_there_are_refused(tmp_path, order, claimed, gz):
    header, data, _ = ply_bytes(order, claimed=claimed)
    with pytest.raises((ss.InvalidInput, ss.OutOfMemory), match=r"g\.ply"):
        read_scattered(stored(tmp_path / "g.ply", header + data, gz))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"1.0\n", b"2.0\n"),
        (b"binary_little_endian", b"binary_middle_endian"),
        (b"float x", b"quaternion x"),
        (b"float y", b"float x"),
        (b"end_header\n", b"end\n"),
        (b"element vertex 30", b"element vertex -30"),
        (b"element vertex 30", b"element points 30"),
        (b"format", b"farmat"),
    ],
)
def test_ply_headers_that_are_damaged_are_refused(tmp_path, old, new):
    header, data, _ = ply_bytes()
    assert old in header
    with pytest.raises(ss.InvalidInput, match=r"g\.ply"):
        read_scattered(stored(tmp_path / "g.ply", header.replace(old, new) + data))


@pytest.mark.parametrize(
    ("column", "value", "text"),
    [
        ("x", math.nan, "positions"),
        ("scale_1", 1000.0, "scale_0"),
        ("scale_1", -2000.0, "scale_0"),
        ("f_dc_0", math.inf, ""),
    ],
)
def test_gaussians_with_impossible_numbers_are_refused(tmp_path, column, value, text):
    header, data, _ = ply_bytes(kind="double")
    rows = np.frombuffer(data, "<f8").reshape(30, -1).copy()
    rows[12, PLY.index(column)] = value
    path = stored(tmp_path / "g.ply", header + rows.tobytes())
    with pytest.raises(ss.InvalidInput, match=f"{text}.*12"):
        read_scattered(path, scalar="f_dc_0")
    rows = np.frombuffer(data, "<f8").reshape(30, -1).copy()
    rows[3, PLY.index("rot_0") :] = 0
    with pytest.raises(ss.InvalidInput, match="quaternion.*3"):
        read_scattered(stored(path, header + rows.tobytes()))


def test_an_infinite_logit_is_an_opacity_of_one_or_nothing(tmp_path):
    header, data, _ = ply_bytes()
    rows = np.frombuffer(data, "<f4").reshape(30, -1).copy()
    rows[:2, PLY.index("opacity")] = [math.inf, -math.inf]
    assert read_scattered(stored(tmp_path / "g.ply", header + rows.tobytes())).values[:2].tolist() == [1.0, 0.0]


# Tables


def test_npz_of_ellipsoids(tmp_path):
    rng = np.random.default_rng(2)
    centers, scales, values = rng.normal(size=(9, 3)), rng.uniform(1, 2, (9, 3)), rng.normal(size=9)
    turns = np.tile([1.0, 0, 0, 0], (9, 1))
    heat, flow = rng.normal(size=9), rng.normal(size=(9, 3))
    path = tmp_path / "e.npz"
    np.savez(
        path, centers=centers, scales=scales, rotations=turns, values=values, weights=heat**2, heat=heat, flow=flow
    )
    read = read_scattered(path)
    assert (read.scalar, set(read.scalars)) == ("values", {"values", "heat", "flow", "flow_x", "flow_y", "flow_z"})
    for name, wanted in (
        ("points", centers),
        ("scales", scales),
        ("rotations", turns),
        ("weights", heat**2),
        ("values", values),
    ):
        np.testing.assert_array_equal(getattr(read, name), wanted)
    np.testing.assert_array_equal(read_scattered(path, scalar="flow_y").values, flow[:, 1])
    np.savez(path, centers=centers.astype(np.float32), radii=scales[:, 0], values=np.arange(9))
    np.testing.assert_array_equal(read_scattered(path).scales, scales[:, 0])
    np.savez(path, centers=centers, values=values)
    assert not read_scattered(path).has_kernels


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"centers": np.ones((9, 2))}, "centers of shape"),
        ({"scales": np.ones((8, 3))}, "scales of shape"),
        ({"rotations": np.ones((9, 3))}, "rotations of shape"),
        ({"values": np.ones(8)}, "values of shape"),
        ({"radii": np.ones(9)}, "scales and radii"),
        ({"w0": np.ones(2)}, "w0 of shape"),
        ({"values": np.array([math.nan] + [0] * 8)}, "first at 0"),
        ({"centers": np.full((9, 3), math.inf)}, "positions"),
        ({"more": np.array(["text"] * 9)}, "more"),
        ({"more": np.ones(9, complex)}, "complex"),
    ],
)
def test_npz_of_ellipsoids_that_lies_is_refused(tmp_path, change, text):
    path = tmp_path / "e.npz"
    np.savez(path, **{"centers": np.ones((9, 3)), "scales": np.ones((9, 3)), "values": np.ones(9), **change})
    with pytest.raises(ss.InvalidInput, match=text):
        read_scattered(path)


def test_npz_of_ellipsoids_is_neither_unpickled_nor_believed(tmp_path):
    path = tmp_path / "e.npz"
    np.savez(path, centers=np.ones((9, 3)), values=np.array([print] * 9, dtype=object))
    with pytest.raises(ss.InvalidInput, match="Python objects"):
        read_scattered(path)
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": (10**12, 3)})
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("centers.npy", stream.getvalue() + bytes(96))
    with pytest.raises(ss.InvalidInput, match="bytes of samples"):
        read_scattered(path)


def test_an_npz_with_a_volume_is_a_volume(tmp_path):
    path = tmp_path / "v.npz"
    np.savez(path, centers=np.ones((9, 3)), values=np.ones(9), volume=np.zeros((2, 3, 4)))
    assert ss.open(path, name="volume").shape == (2, 3, 4)
    np.savez(path, volume=np.zeros((2, 3, 4)))
    assert ss.open(path).shape == (2, 3, 4)


CSV = {
    "commas": "x,y,z,value,radius\n1,2,3,4,5\n1.5,2.5,3.5,-4.5e1,5\n",
    "semicolons": "\ufeffX;Y;Z;Value;Radius\r\n1;2;3;4;5\r\n1.5;2.5;3.5;-4.5e1;5",
    "blanks": "# x y z value r\n1 2 3 4 5\n\n# more\n1.5  2.5 3.5 -45 5\n",
    "tabs": "z\tvalue\tradius\ty\tx\n3\t4\t5\t2\t1\n3.5\t-45\t5\t2.5\t1.5\n",
}


@pytest.mark.parametrize("gz", [False, True])
@pytest.mark.parametrize("kind", CSV)
def test_csv(tmp_path, kind, gz):
    read = read_scattered(stored(tmp_path / ("t.csv" + ".gz" * gz), CSV[kind].encode(), gz))
    np.testing.assert_array_equal(read.points, [[1, 2, 3], [1.5, 2.5, 3.5]])
    np.testing.assert_array_equal(read.values, [4, -45])
    np.testing.assert_array_equal(read.scales, [5, 5])


def test_csv_of_ellipsoids(tmp_path):
    text = "x,y,z,sx,sy,sz,qw,qx,qy,qz,weight,heat,cold\n0,0,0,1,2,3,1,0,0,0,0.5,7,8\n"
    path = stored(tmp_path / "t.csv", text.encode())
    read = read_scattered(path)
    assert (read.scalar, read.scalars, read.values.tolist()) == ("heat", ("heat", "cold"), [7.0])
    assert (read.scales.tolist(), read.rotations.tolist(), read.weights.tolist()) == (
        [[1, 2, 3]],
        [[1, 0, 0, 0]],
        [0.5],
    )
    assert read_scattered(path, scalar="cold").values.tolist() == [8.0]


def test_csv_of_many_pieces(tmp_path, monkeypatch):
    from sheetsplat.io import tables

    rows = np.arange(4000.0).reshape(-1, 4)
    text = "x,y,z,v\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows.tolist())
    path = stored(tmp_path / "t.csv", text.encode())
    for size in (50, 997, 1 << 22):
        monkeypatch.setattr(tables, "_CHUNK", size)
        read = read_scattered(path)
        np.testing.assert_array_equal(np.column_stack([read.points, read.values]), rows)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("x,y,value\n1,2,3\n", "also z"),
        ("x,y,z\n1,2,3\n", "one more, value"),
        ("x,y,z,value,sx\n1,2,3,4,5\n", "also sy, sz"),
        ("x,y,z,value,qw,qx,qy,qz\n1,2,3,4,1,0,0,0\n", "quaternion without"),
        ("x,y,z,value,radius,sx,sy,sz\n1,2,3,4,1,1,1,1\n", "radius and sx"),
        ("x,y,z,value,value\n1,2,3,4,5\n", "names that differ"),
        ("x,y,z,value\n1,2,3\n", "3 numbers in row 0"),
        ("x,y,z,value\n1,2,3,4\n1,2,3\n", "row 0"),
        ("x,y,z,value\n1,2,3,four\n", "four"),
        ("x,y,z,value\n1,2,3,\n", "row 0"),
        ("x,y,z,value\n1,2,3,nan\n", "not finite"),
        ("x,y,z,value\n1,inf,3,4\n", "not finite"),
    ],
)
def test_csv_that_is_wrong_is_refused(tmp_path, text, found):
    with pytest.raises(ss.InvalidInput, match=found):
        read_scattered(stored(tmp_path / "t.csv", text.encode()))


# What all of them share


def test_decades_begin_at_zero():
    values = np.array([1e-5, 1.0, 1e3])
    np.testing.assert_allclose(logarithm(values, "v", True), [0, 5, 8], atol=1e-12)
    np.testing.assert_allclose(logarithm(values, "v", 0.01), [0, 2, 5], atol=1e-12)
    np.testing.assert_allclose(logarithm(np.array([-1.0, 0.0, 10.0]), "v", 1.0), [0, 0, 1], atol=1e-12)
    with pytest.raises(ss.InvalidInput, match="2 of 3 values.*above 0 is 10"):
        logarithm(np.array([-1.0, 0.0, 10.0]), "v", True)
    for floor in (-1.0, 0.0, math.nan, math.inf):
        with pytest.raises(ss.InvalidInput, match="floor"):
            logarithm(values, "v", floor)


def test_log_of_a_volume(tmp_path):
    path = tmp_path / "v.npy"
    np.save(path, np.logspace(-3, 3, 24, dtype=np.float32).reshape(2, 3, 4))
    field = ss.open(path, log=True)
    assert field.value_range == pytest.approx((0, 6), abs=1e-6)
    assert field.values.dtype == np.float32
    assert ss.open(path, log=1.0).value_range == pytest.approx((0, 3), abs=1e-6)
    np.save(path, np.zeros((2, 3, 4), np.uint8))
    with pytest.raises(ss.InvalidInput, match="24 of 24 values"):
        ss.open(path, log=True)


def test_options_that_mean_nothing_for_a_file_are_refused(tmp_path):
    csv = stored(tmp_path / "t.csv", CSV["commas"].encode())
    npy = tmp_path / "v.npy"
    np.save(npy, np.zeros((2, 3, 4)))
    for options in ({"radius": 2.0}, {"lattice": "bcc"}, {"spacing": (1, 1, 1)}, {"nan": "skip"}, {"name": "a"}):
        with pytest.raises(ss.InvalidInput, match=f"{next(iter(options))} for scattered data"):
            ss.open(csv, **options)
    for options in ({"particles": "PartType0"}, {"support": 2.0}):
        with pytest.raises(ss.InvalidInput, match="only for HDF5"):
            ss.open(csv, **options)
    for options in ({"fit": "nearest"}, {"neighbors": 3}, {"min_scale": 1.0}, {"particles": "P"}, {"scalar": "a"}):
        with pytest.raises(ss.InvalidInput, match=f"{next(iter(options))} for a"):
            ss.open(npy, **options)
    with pytest.raises(ss.InvalidInput, match="scattered data"):
        read_volume(csv)
    with pytest.raises(ss.InvalidInput, match="neighbors"):
        ss.open(csv, fit="delaunay", neighbors=3)
    with pytest.raises(ss.InvalidInput, match="fit cannot be used"):
        ss.open(csv, fit="best")


@pytest.mark.parametrize("name", ["s.bin", "s.raw"])
def test_a_solution_without_its_grid_says_so(tmp_path, name):
    with pytest.raises(ss.InvalidInput, match="PLOT3D.*grid"):
        ss.open(stored(tmp_path / name, bytes(100)))


MEASURED = [
    ("bluntfinq.bin.gz", {"grid": "bluntfinxyz.bin.gz"}, 40 * 32 * 32, (0.1926, 4.9775), 39 * 31 * 31),
    ("combq.bin.gz", {"grid": "combxyz.bin.gz"}, 57 * 33 * 25, (0.1978, 0.7104), 56 * 32 * 24),
    ("fire_ug.vtu.gz", {"scalar": "t"}, 12323, (298.381, 692.240), 10462),
    ("sph_gas_nchilada12M.h5", {}, 91048, (1.063e-5, 2690.43), 0),
    ("3dgs_guitar.ply.gz", {}, 90854, (0.0039, 1.0), 0),
]


@pytest.mark.data
@pytest.mark.parametrize(("name", "options", "count", "limits", "cells"), MEASURED)
def test_measured_data(data_dir, name, options, count, limits, cells):
    given = {**options, **({"grid": data_dir / options["grid"]} if "grid" in options else {})}
    read = read_scattered(data_dir / name, **given)
    assert len(read.points) == len(read.values) == count
    assert (read.values.min(), read.values.max()) == pytest.approx(limits, rel=1e-3, abs=1e-4)
    assert sum(len(block) for block in read.cells or ()) == cells


@pytest.mark.data
def test_measured_particles_have_the_support_that_gives_their_densities(data_dir):
    with h5py.File(data_dir / "sph_gas_nchilada12M.h5") as file:
        lengths = file["PartType0/SmoothingLength"][()]
    read = read_scattered(data_dir / "sph_gas_nchilada12M.h5")
    np.testing.assert_array_equal(read.supports, 2.0 * lengths.astype(float))
    assert read.supports.shape == read.masses.shape == read.densities.shape == (91048,)
