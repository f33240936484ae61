"""What all readers of scattered data share: logarithms, options, and measured data."""

from __future__ import annotations

import math

import h5py
import numpy as np
import pytest
from scattered_files import CSV, stored

import sheetsplat as ss
from sheetsplat.io import read_scattered, read_volume
from sheetsplat.io.kernels import logarithm


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


def test_saved_kernels_keep_their_base(tmp_path):
    centers = np.random.default_rng(1).random((20, 3))
    field = ss.EllipsoidField(centers, np.full(20, 0.2), values=290 + centers[:, 0], base=290.0)
    ss.io.save_npz(field, tmp_path / "a.npz")
    opened = ss.open(tmp_path / "a.npz")
    assert opened.base == 290 and np.array_equal(opened.at(centers), field.at(centers))
    assert ss.open(tmp_path / "a.npz", base=280.0).base == 280
    # A column of that name is a scalar as any other.
    np.savez(tmp_path / "b.npz", centers=centers, scales=np.full(20, 0.2), base=centers[:, 1])
    other = ss.open(tmp_path / "b.npz", scalar="base")
    assert other.base == 0 and np.array_equal(other.values, centers[:, 1])


def test_options_that_mean_nothing_for_a_file_are_refused(tmp_path):
    csv = stored(tmp_path / "t.csv", CSV["commas"].encode())
    npy = tmp_path / "v.npy"
    np.save(npy, np.zeros((2, 3, 4)))
    for options in ({"radius": 2.0}, {"lattice": "bcc"}, {"spacing": (1, 1, 1)}, {"name": "a"}):
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
