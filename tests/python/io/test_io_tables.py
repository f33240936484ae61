"""Ellipsoids and points in .npz and .csv: what the readers find in files that the tests write, and what they refuse."""

from __future__ import annotations

import io
import math
import zipfile

import numpy as np
import pytest
from scattered_files import CSV, stored

import sheetsplat as ss
from sheetsplat.io import read_scattered


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
        ({"values": np.array([math.nan] + [0] * 8)}, "scalar values of row 0"),
        ({"centers": np.full((9, 3), math.inf)}, "position of row 0"),
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


def test_cells_of_a_csv_that_hold_nothing_are_missing_numbers(tmp_path):
    rows = b"x,y,z,value,more\n1,2,3,4,5\r\n,,,,\n1,2,3,,5\n\n5, ,6,7,1\n3,2,1,8,\n9,2,3,9,5\n"
    path = stored(tmp_path / "t.csv", rows)
    with pytest.raises(ss.InvalidInput, match="the position of row 1; numbers of 3 of 6 rows"):
        read_scattered(path)
    with pytest.warns(ss.PictureWarning, match="3 of 6 rows .* position in 2, scalar value in 2"):
        assert read_scattered(path, nan="skip").values.tolist() == [4, 8, 9]


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
        ("x,y,z,value\n1,2,3,4\n1,2,3\n", "3 numbers in row 1"),
        ("x,y,z,value\n1,2,3,four\n", "four"),
        ("x,y,z,value\n1,2,3,\n", "row 0"),
        ("x,y,z,value\n1,2,3,nan\n", "not finite"),
        ("x,y,z,value\n1,inf,3,4\n", "not finite"),
    ],
)
def test_csv_that_is_wrong_is_refused(tmp_path, text, found):
    with pytest.raises(ss.InvalidInput, match=found):
        read_scattered(stored(tmp_path / "t.csv", text.encode()))
