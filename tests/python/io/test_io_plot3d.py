"""PLOT3D grids and solutions: what the reader finds in files that the tests write, and what it refuses."""

from __future__ import annotations

import itertools
import math
import struct

import numpy as np
import pytest
from scattered_files import plot3d_files, stored

import sheetsplat as ss
from sheetsplat.io import read_scattered

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
    with pytest.raises(ss.InvalidInput, match="a record with the lengths"):
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
    with pytest.raises(ss.InvalidInput, match=r"position of row 7; numbers of 1 of 60 rows are not finite; wanted"):
        read_scattered(q, grid=stored(tmp_path / "nan", bytes(wrong)))
