"""Small files of scattered data in every way that a format can be written, and what they hold."""

from __future__ import annotations

import base64
import gzip
import struct
import zlib

import h5py
import numpy as np


def stored(path, data: bytes, gz: bool = False):
    path.write_bytes(gzip.compress(data) if gz else data)
    return path


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


def write_particles(path, count=40, *, group="PartType0", leave_out=(), order="<", seed=5, header=None, **more):
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
        if header is not None:
            file.create_group("Header").attrs.update(header)
    return path, data


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


CSV = {
    "commas": "x,y,z,value,radius\n1,2,3,4,5\n1.5,2.5,3.5,-4.5e1,5\n",
    "semicolons": "\ufeffX;Y;Z;Value;Radius\r\n1;2;3;4;5\r\n1.5;2.5;3.5;-4.5e1;5",
    "blanks": "# x y z value r\n1 2 3 4 5\n\n# more\n1.5  2.5 3.5 -45 5\n",
    "tabs": "z\tvalue\tradius\ty\tx\n3\t4\t5\t2\t1\n3.5\t-45\t5\t2.5\t1.5\n",
}
