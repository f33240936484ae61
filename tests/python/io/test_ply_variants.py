"""Variants of PLY: packed Gaussians, volume encoding Gaussians, points, and elements in any order."""

import math
import time

import numpy as np
import pytest
from scattered_files import PLY, ply_bytes, stored
from scipy.spatial.transform import Rotation

import sheetsplat as ss
from sheetsplat.io import read_scattered

RANGES = [f"{end}_{of}{axis}" for of in ("", "scale_") for end in ("min", "max") for axis in "xyz"]
COLORS = [f"{end}_{color}" for end in ("min", "max") for color in "rgb"]


def file_of(elements, order="<"):
    """Return a binary PLY of elements: a name, names of properties, and a structured array."""
    kinds = {"f4": "float", "u4": "uint", "u1": "uchar"}
    lines = ["ply", f"format binary_{'little' if order == '<' else 'big'}_endian 1.0"]
    data = b""
    for name, table in elements.items():
        lines.append(f"element {name} {len(table)}")
        lines += [f"property {kinds[table.dtype[one].str[1:]]} {one}" for one in table.dtype.names]
        rows = table_of(table.dtype[0], **{one: table[one] for one in table.dtype.names})
        data += rows.astype(rows.dtype.newbyteorder(order)).tobytes()
    return ("\n".join([*lines, "end_header"]) + "\n").encode() + data


def table_of(kind, **columns):
    table = np.empty(len(next(iter(columns.values()))), [(name, kind) for name in columns])
    for name, one in columns.items():
        table[name] = one
    return table


def packed(low, high, values, bits):
    """Return three shares of a range in one whole number: the first in the highest bits."""
    shares = (values - low) / (high - low)
    whole = [np.round(shares[:, n] * (2**count - 1)).astype(np.uint32) for n, count in enumerate(bits)]
    return whole[0] << np.uint32(bits[1] + bits[2]) | whole[1] << np.uint32(bits[2]) | whole[2]


def packed_gaussians(count, *, with_colors, seed=2):
    """Return chunks and packed vertices, and what they hold: positions, logarithms of sizes, w x y z, rgb, opacity."""
    rng = np.random.default_rng(seed)
    points, sizes = rng.normal(size=(count, 3)), rng.uniform(-5, -2, (count, 3))
    turns, colors, opacity = rng.normal(size=(count, 4)), rng.random((count, 3)), rng.integers(0, 256, count) / 255
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    numbers = {name: np.empty(count, np.uint32) for name in ("position", "rotation", "scale", "color")}
    rows = []
    for first in range(0, count, 256):
        at = slice(first, first + 256)
        ends = [points[at].min(0), points[at].max(0), sizes[at].min(0), sizes[at].max(0)]
        numbers["position"][at] = packed(ends[0], ends[1], points[at], (11, 10, 11))
        numbers["scale"][at] = packed(ends[2], ends[3], sizes[at], (11, 10, 11))
        low, high = (colors[at].min(0), colors[at].max(0)) if with_colors else (np.zeros(3), np.ones(3))
        numbers["color"][at] = packed(low, high, colors[at], (8, 8, 8)) << np.uint32(8)
        rows.append([*ends[0], *ends[1], *ends[2], *ends[3], *((*low, *high) if with_colors else ())])
    numbers["color"] |= np.round(opacity * 255).astype(np.uint32)
    largest = np.abs(turns).argmax(axis=1)
    turns *= np.sign(turns[np.arange(count), largest])[:, None]
    for n in range(count):
        others = np.delete(turns[n], largest[n]) / math.sqrt(2) + 0.5
        a, b, c = (int(round(part * 1023)) for part in others)
        numbers["rotation"][n] = int(largest[n]) << 30 | a << 20 | b << 10 | c
    names = RANGES + (COLORS if with_colors else [])
    chunk = table_of("f4", **dict(zip(names, np.array(rows).T, strict=True)))
    vertex = table_of("u4", **{f"packed_{name}": one for name, one in numbers.items()})
    return chunk, vertex, (points, sizes, turns, colors, opacity)


def small_packed():
    """Return a small file of packed Gaussians."""
    chunk, vertex, _ = packed_gaussians(6, with_colors=True)
    return file_of({"chunk": chunk, "vertex": vertex})


@pytest.mark.parametrize("with_colors", [False, True])
def test_packed_gaussians(tmp_path, with_colors):
    chunk, vertex, (points, sizes, turns, colors, opacity) = packed_gaussians(600, with_colors=with_colors)
    elements = {"chunk": chunk, "vertex": vertex, "sh": table_of("u1", f_rest_0=np.zeros(600))}
    path = stored(tmp_path / "a.compressed.ply", file_of(elements))
    data = read_scattered(path)
    extent = np.ptp(points, axis=0).max()
    assert np.abs(data.points - points).max() < extent / 1000 and data.details["encoding"].endswith("packed")
    assert np.abs(np.log(data.deviations) - sizes).max() < 3 / 1000 and np.allclose(data.values, opacity, atol=1e-12)
    assert data.rotations is not None and np.abs(data.rotations - turns).max() < 2e-3
    assert np.abs(read_scattered(path, scalar="green").values - colors[:, 1]).max() < 1 / 400
    # Vertices before the chunks, in the other byte order.
    other = stored(tmp_path / "b.ply", file_of({"vertex": vertex, "chunk": chunk}, ">"))
    assert np.array_equal(read_scattered(other).points, data.points)
    assert ss.open(path).size == 600


@pytest.mark.parametrize("fault", ["chunks", "missing", "type"])
def test_packed_gaussians_that_lie_are_refused(tmp_path, fault):
    chunk, vertex, _ = packed_gaussians(300, with_colors=False)
    if fault == "chunks":
        chunk = chunk[:1]
    elif fault == "missing":
        vertex = vertex[["packed_position", "packed_rotation", "packed_scale"]].copy()
    else:
        vertex = table_of("f4", **{name: vertex[name] for name in vertex.dtype.names})
    text = {"chunks": "1 chunks.*2, one for 256", "missing": "without packed_color", "type": "type float32"}[fault]
    with pytest.raises(ss.InvalidInput, match=text):
        read_scattered(stored(tmp_path / "a.ply", file_of({"vertex": vertex, "chunk": chunk})))


def volume_gaussians(count=40, weighted=True):
    rng = np.random.default_rng(8)
    names = ["x", "y", "z", "value", *(["weight"] if weighted else []), "scale_0", "scale_1", "scale_2", *PLY[-4:]]
    columns = {name: rng.uniform(0, 0.1, count) for name in "xyz"} | {"value": rng.normal(size=count)}
    columns |= {"weight": rng.normal(size=count)} | {f"scale_{n}": rng.uniform(-5, -3.5, count) for n in range(3)}
    columns |= {f"rot_{n}": rng.normal(size=count) for n in range(4)}
    return table_of("f4", **{name: columns[name] for name in names})


@pytest.mark.parametrize("weighted", [False, True])
def test_volume_encoding_gaussians(tmp_path, weighted):
    table = volume_gaussians(weighted=weighted)
    # Properties in another order are known by their names.
    path = stored(tmp_path / "a.ply", file_of({"vertex": table[list(table.dtype.names[::-1])].copy()}))
    field = ss.open(path)
    told = {name: table[name].astype(float) for name in table.dtype.names}
    values = 1 / (1 + np.exp(-told["value"]))
    weights = 1 / (1 + np.exp(-told["weight"])) if weighted else np.ones(40)
    sizes = np.exp(np.stack([told[f"scale_{n}"] for n in range(3)], 1))
    if weighted:
        length = np.linalg.norm(sizes, axis=1)[:, None]
        sizes *= 0.02 * np.tanh(length / 0.02) / length
    axes = Rotation.from_quat(np.stack([told[f"rot_{n}"] for n in (1, 2, 3, 0)], 1)).as_matrix()
    centers = np.stack([told[axis] for axis in "xyz"], 1)
    points = np.random.default_rng(9).uniform(0, 0.1, (200, 3))
    apart = np.einsum("knm,pkn->pkm", axes, points[:, None] - centers) / sizes
    shares = np.exp(-0.5 * (apart**2).sum(axis=2)) * weights
    wanted, there = shares @ values / shares.sum(axis=1), shares.sum(axis=1) > 0.2 * weights.mean()
    # What a support cuts off is 3e-4 of each kernel.
    assert there.sum() > 100 and np.abs(field.at(points) - wanted)[there].max() < 5e-3
    assert read_scattered(path).format == "veg" and np.allclose(field.values, values, rtol=1e-6)


def test_lists_before_the_vertices_are_passed_over(tmp_path):
    header, data, wanted = ply_bytes(before="element face 2\nproperty list uchar int a\nproperty float b\n")
    faces = b"".join(bytes([n]) + np.arange(n, dtype="<i4").tobytes() + b"\0\0\0\0" for n in (3, 5))
    read = read_scattered(stored(tmp_path / "g.ply", header + faces + data))
    np.testing.assert_array_equal(read.points[:, 0], wanted["x"])
    header, data, wanted = ply_bytes("text", before="element face 2\nproperty list uchar int a\n")
    read = read_scattered(stored(tmp_path / "t.ply", header + b"3 0 1 2\n5 0 1 2 3 4\n" + data))
    np.testing.assert_array_equal(read.points[:, 0], wanted["x"])
    header, data, _ = ply_bytes(before="element face 2\nproperty list uchar int a\n")
    with pytest.raises(ss.InvalidInput, match="cut off"):
        read_scattered(stored(tmp_path / "c.ply", header + b"\xff" + data[:100]))


@pytest.mark.parametrize("order", ["binary_big_endian", "ascii"])
def test_many_rows_before_the_vertices(tmp_path, order):
    """Of a file of kilobytes: each row takes a microsecond, and there is a largest number of them."""

    def path_of(count, rows):
        head = f"ply\nformat {order} 1.0\nelement edge {count}\nproperty list ushort int ends\nelement vertex 1\n"
        head += "".join(f"property float {name}\n" for name in ("x", "y", "z", "value")) + "end_header\n"
        body = b"\n" * rows + b"0 0 0 2\n" if order == "ascii" else bytes(2 * rows) + np.float32(2).tobytes() * 4
        return stored(tmp_path / f"{count}.ply", head.encode() + body, gz=True)

    started = time.perf_counter()
    assert read_scattered(path_of(200_000, 200_000)).points.shape == (1, 3)
    assert time.perf_counter() - started < 3.0
    with pytest.raises(ss.InvalidInput, match="write the vertices first"):
        read_scattered(path_of(10**9, 10))


def test_points_without_sizes(tmp_path):
    rng = np.random.default_rng(4)
    points, heat = rng.random((30, 3)).astype("f4"), rng.random(30).astype("f4")
    table = table_of("f4", **dict(zip("xyz", points.T, strict=True)), nx=np.zeros(30), heat=heat)
    data = read_scattered(stored(tmp_path / "a.ply", file_of({"vertex": table})))
    assert data.scalar == "heat" and np.array_equal(data.points, points) and np.array_equal(data.values, heat)
    assert not data.has_kernels and ss.open(tmp_path / "a.ply").size == 30
    more = table_of("f4", **{name: table[name] for name in table.dtype.names}, cold=heat)
    path = stored(tmp_path / "b.ply", file_of({"vertex": more}))
    with pytest.raises(ss.InvalidInput, match="heat, cold beside") as caught:
        read_scattered(path)
    assert caught.value.option == "scalar" and read_scattered(path, scalar="cold").scalar == "cold"
