"""Samples that are read by their positions: every part of every layout, and files that change meanwhile."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat.io.stored import StoredSamples

SHAPE = (9, 7, 11)


def _written_raw(path: Path, values: Any) -> dict[str, Any]:
    path.write_bytes(values.tobytes())
    return {"shape": values.shape, "dtype": values.dtype.str}


def _written_npy(path: Path, values: Any) -> dict[str, Any]:
    np.save(path, values)
    return {}


def _written_fortran(path: Path, values: Any) -> dict[str, Any]:
    np.save(path, np.asfortranarray(values))
    return {}


def _written_nrrd(path: Path, values: Any) -> dict[str, Any]:
    # The second axis of the file falls along x, the fastest runs along y.
    nk, nj, ni = values.shape
    header = "NRRD0004\ntype: float\ndimension: 3\nencoding: raw\nendian: little\nspace dimension: 3\n"
    header += f"sizes: {nj} {ni} {nk}\nspace directions: (0,1,0) (-1,0,0) (0,0,1)\n\n"
    path.write_bytes(header.encode() + np.ascontiguousarray(values[:, :, ::-1].transpose(0, 2, 1)).tobytes())
    return {}


def _written_metaimage(path: Path, values: Any) -> dict[str, Any]:
    sizes = " ".join(map(str, values.shape[::-1]))
    header = f"NDims = 3\nDimSize = {sizes}\nElementType = MET_FLOAT\nElementDataFile = {path.stem}.samples\n"
    path.write_text(header)
    path.with_suffix(".samples").write_bytes(values.tobytes())
    return {}


def _written_netcdf(path: Path, values: Any) -> dict[str, Any]:
    # Two variables with records, which lie in turn in the file.
    scipy_io = pytest.importorskip("scipy.io")
    pytest.importorskip("xarray")
    with scipy_io.netcdf_file(path, "w") as file:
        file.createDimension("z", None)
        file.createDimension("y", values.shape[1])
        file.createDimension("x", values.shape[2])
        for name, factor in (("a", 1), ("b", -1)):
            file.createVariable(name, "f4", ("z", "y", "x"))[:] = factor * values
    return {"name": "a"}


WRITERS: dict[str, Callable[[Path, Any], dict[str, Any]]] = {
    "v.raw": _written_raw,
    "v.npy": _written_npy,
    "fortran.npy": _written_fortran,
    "v.nrrd": _written_nrrd,
    "v.mha": _written_metaimage,
    "v.nc": _written_netcdf,
}


def _values(seed: int = 5) -> Any:
    return np.random.default_rng(seed).random(SHAPE, dtype=np.float32)


@pytest.mark.parametrize("dtype", ["u1", ">i2", "<f8"])
@pytest.mark.parametrize("call", [1, 40, 1 << 15])
def test_each_part_of_each_layout_is_what_numpy_has(dtype: str, call: int, tmp_path: Path) -> None:
    random = np.random.default_rng(call)
    values = random.integers(0, 250, SHAPE).astype(dtype)
    content = b"abc" + values.tobytes()
    samples = StoredSamples.dense(tmp_path, values.dtype, values.shape, 3)
    for _ in range(60):
        calls: list[int] = []

        def fetch(position: int, count: int, calls: list[int] = calls) -> bytes:
            assert 3 <= position and position + count <= len(content)
            calls.append(count)
            return content[position : position + count]

        axes = tuple(random.permutation(3))
        ends = [sorted(random.integers(0, size + 1, 2)) for size in np.array(SHAPE)[list(axes)]]
        cuts = tuple(slice(a, b) for a, b in ends)
        turned = tuple(slice(None, None, random.choice([-1, 1, 2])) for _ in range(3))
        expected = values.transpose(axes)[cuts][turned]
        found = samples.transpose(axes)[cuts][turned].read(fetch, call)
        assert found.dtype == values.dtype
        np.testing.assert_array_equal(found, expected)
        # No plan reads more than whole samples would, and none more than the whole part at once.
        if calls:
            assert sum(calls) + call * len(calls) <= expected.size * (call + values.dtype.itemsize)


@pytest.mark.parametrize("name", WRITERS)
def test_bricks_of_a_file_have_its_samples(name: str, tmp_path: Path) -> None:
    path, values = tmp_path / name, _values()
    field = ss.open_bricks(path, brick=4, **WRITERS[name](path, values))
    for box in [((0, 9), (0, 7), (0, 11)), ((2, 5), (1, 7), (0, 1)), ((8, 9), (3, 4), (5, 9))]:
        np.testing.assert_array_equal(field.source.reader(box), values[tuple(slice(*cut) for cut in box)])


# Opens a file in bricks, and cuts it as soon as its size and its time of change were found to be as before.
_CUT = """
import os, sys
import sheetsplat as ss
from sheetsplat.bricks import readers
path, samples, options = sys.argv[1], sys.argv[2], eval(sys.argv[3])
field = ss.open_bricks(path, brick=4, **options)
reader = field.source.reader
check, left = readers.Stamp.check, len(reader.args[0])

def check_and_cut(self):
    global left
    check(self)
    left -= 1
    if not left:
        os.truncate(samples, 200)

readers.Stamp.check = check_and_cut
try:
    reader(((0, 20), (0, 24), (0, 28)))
except ss.InvalidInput as error:
    print(error)
"""


@pytest.mark.parametrize("name", WRITERS)
def test_a_file_that_is_cut_while_it_is_read_is_an_error(name: str, tmp_path: Path) -> None:
    """A process that maps it ends with SIGBUS: the pages behind the file's end are gone."""
    path = tmp_path / name
    # More than a page, so that pages are gone.
    values = np.random.default_rng(7).random((20, 24, 28), dtype=np.float32)
    options = WRITERS[name](path, values)
    samples = path.with_suffix(".samples") if name == "v.mha" else path
    command = [sys.executable, "-c", _CUT, str(path), str(samples), repr(options)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert "found a file that was changed" in done.stdout, done.stdout + done.stderr


@pytest.mark.parametrize("name", WRITERS)
def test_a_file_that_was_written_again_is_an_error(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    field = ss.open_bricks(path, brick=4, **WRITERS[name](path, _values()))
    WRITERS[name](path, np.concatenate([_values(6), _values(7)]))
    with pytest.raises(ss.InvalidInput, match="a file that was changed"):
        field.source.reader(((0, 9), (0, 7), (0, 11)))


def test_a_file_that_is_written_between_two_reads_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "v.npy"
    field = ss.open_bricks(path, brick=4, **_written_npy(path, _values()))
    read = StoredSamples.read

    def read_and_write(self: StoredSamples, *arguments: Any) -> Any:
        found = read(self, *arguments)
        _written_npy(path, np.concatenate([_values(6), _values(7)]))
        return found

    monkeypatch.setattr(StoredSamples, "read", read_and_write)
    with pytest.raises(ss.InvalidInput, match="a file that was changed"):
        field.source.reader(((0, 9), (0, 7), (0, 11)))
