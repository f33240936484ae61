"""OpenVDB's files, where OpenVDB's own module is installed, which PyPI does not have."""

from __future__ import annotations

import gzip
import importlib
import importlib.util
import sys

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat.io import read_volume

NAME = next((name for name in ("openvdb", "pyopenvdb") if importlib.util.find_spec(name)), "")
needed = pytest.mark.skipif(not NAME, reason="no module of OpenVDB")
VALUES = np.random.default_rng(3).random((4, 5, 6)).astype(np.float32) + 0.5


def written(path, *, at=(3, -2, 7), size=0.5, names=("density",)):
    """Write VALUES[k, j, i] with their first sample at voxel `at` into grids; the background is 0.25."""
    vdb = importlib.import_module(NAME)
    grids = []
    for name in names:
        grid = vdb.FloatGrid(0.25)
        grid.copyFromArray(np.ascontiguousarray(VALUES.T), ijk=at)
        grid.transform = vdb.createLinearTransform(voxelSize=size)
        grid.name = name
        grids.append(grid)
    vdb.write(str(path), grids=grids)
    return path


def test_without_its_module_the_error_says_where_it_is(tmp_path, monkeypatch):
    (tmp_path / "a.vdb").write_bytes(b" BDV\0\0\0\0" + bytes(100))
    for name in ("openvdb", "pyopenvdb"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ss.Unsupported, match="OpenVDB.*conda install -c conda-forge openvdb, or apt-get install"):
        ss.open(tmp_path / "a.vdb")


@needed
def test_grids(tmp_path):
    volume = read_volume(written(tmp_path / "a.vdb"))
    assert np.array_equal(volume.values, VALUES) and volume.spacing == (0.5,) * 3
    assert np.allclose(volume.origin, (1.5, -1, 3.5)) and volume.quantity.name == "density"
    written(tmp_path / "b.vdb", names=("density", "heat"))
    assert np.array_equal(ss.open(tmp_path / "b.vdb", name="heat").values, VALUES)
    with pytest.raises(ss.InvalidInput, match="2 grids of numbers; grids: density, heat"):
        ss.open(tmp_path / "b.vdb")
    with pytest.raises(ss.InvalidInput, match="no grid of numbers 'none'"):
        ss.open(tmp_path / "b.vdb", name="none")


@needed
def test_grids_that_cannot_be_shown(tmp_path):
    vdb = importlib.import_module(NAME)
    whole = written(tmp_path / "a.vdb").read_bytes()
    for size in (8, 20, 60, len(whole) // 2, len(whole) - 9):
        (tmp_path / "cut.vdb").write_bytes(whole[:size])
        with pytest.raises(ss.Error, match="cut.vdb"):
            ss.open(tmp_path / "cut.vdb")
    (tmp_path / "a.vdb.gz").write_bytes(gzip.compress(whole))
    with pytest.raises(ss.InvalidInput, match="gzipped"):
        ss.open(tmp_path / "a.vdb.gz")
    empty = vdb.FloatGrid()
    empty.name = "empty"
    vdb.write(str(tmp_path / "e.vdb"), grids=[empty])
    with pytest.raises(ss.InvalidInput, match="without active voxels"):
        ss.open(tmp_path / "e.vdb")
    # Two voxels, and between them more than any memory holds.
    far = vdb.FloatGrid()
    far.name = "far"
    for one in (-(2**30), 2**30):
        far.getAccessor().setValueOn((one, one, one), 1.0)
    vdb.write(str(tmp_path / "f.vdb"), grids=[far])
    with pytest.raises(ss.Error, match="63 bits|memory"):
        ss.open(tmp_path / "f.vdb")
