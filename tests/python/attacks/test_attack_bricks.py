"""Bricks under attack, in small: tests/attacks has the programs that do it by the hundred."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import sheetsplat as ss

for name in ("distributed", "dask.array", "zarr", "h5py"):
    pytest.importorskip(name, reason=f"no {name}: pip install 'sheetsplat[distributed,science]'")

from attacks import bricks  # noqa: E402  # It needs them.


@pytest.mark.slow
def test_workers_that_are_killed() -> None:
    found = bricks.kills_of_workers(0, 2)
    assert not found.failures and found.done["workers killed"] >= 2, found


def test_damaged_files() -> None:
    found = bricks.damaged_chunks(0, 60)
    assert not found.failures and found.done["errors of the package"] > 20, found


def test_data_that_nobody_expects() -> None:
    found = bricks.hostile_arrays(0, 80)
    assert not found.failures and found.done["pictures"] > 10, found


@pytest.mark.slow
def test_full_disks_of_workers() -> None:
    found = bricks.full_disks_of_workers(0, 4)
    assert not found.failures and found.done["pictures afterwards"] == 1, found


@pytest.mark.slow
def test_schedulers_that_end() -> None:
    found = bricks.lost_schedulers(0, 2)
    assert not found.failures, found


@pytest.mark.slow
def test_a_long_run_does_not_grow() -> None:
    pytest.importorskip("aiohttp", reason="aiohttp is not installed")
    from attacks import long_runs

    found = long_runs.long_run(0, 120)
    assert not found.failures and found.done["frames by workers"] == 30 and found.done["pages that came"] > 2, found


@pytest.mark.timeout(60)
@pytest.mark.parametrize("which", ["0.0.0", ".zattrs"])
def test_a_pipe_in_a_zarr_folder_is_not_waited_for(tmp_path: Path, which: str) -> None:
    import zarr

    array = zarr.create_array(tmp_path / "v.zarr", shape=(8, 8, 8), chunks=(4, 4, 4), dtype="u1", zarr_format=2)
    array[:] = np.arange(512).reshape(8, 8, 8) % 251
    assert ss.open(tmp_path / "v.zarr").size == 512
    (tmp_path / "v.zarr" / which).unlink()
    os.mkfifo(tmp_path / "v.zarr" / which)
    for read in (ss.open, ss.open_bricks):
        with pytest.raises(ss.InvalidInput, match="regular file"):
            read(tmp_path / "v.zarr")
