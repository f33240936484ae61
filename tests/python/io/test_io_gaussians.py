"""3D Gaussian Splatting scenes in PLY: what the reader finds in files that the tests write, and what it refuses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scattered_files import PLY, PLY_FORMATS, ply_bytes, stored

import sheetsplat as ss
from sheetsplat.io import read_scattered


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
        ("x", math.nan, "position of row"),
        ("scale_1", 1000.0, "size of row"),
        ("f_dc_0", math.inf, "scalar f_dc_0 of row"),
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
    with pytest.raises(ss.InvalidInput, match='rotation of row 3.*nan="skip"'):
        read_scattered(stored(path, header + rows.tobytes()))


def test_an_infinite_logit_is_an_opacity_of_one_or_nothing(tmp_path):
    header, data, _ = ply_bytes()
    rows = np.frombuffer(data, "<f4").reshape(30, -1).copy()
    rows[:2, PLY.index("opacity")] = [math.inf, -math.inf]
    assert read_scattered(stored(tmp_path / "g.ply", header + rows.tobytes())).values[:2].tolist() == [1.0, 0.0]
