"""Files that are wrong in any way: a field or a clear error, and never another exception, a wait, or much memory.

Small valid files of every kind that can be read are spoiled as `./run fuzz files` does, a few of each kind.
"""

from __future__ import annotations

import contextlib
import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
import test_io
from readable_files import KINDS, MEMORY, SECONDS, Files, npz, of_meshio, picture, read, vtu, write

import sheetsplat as ss
from fuzz.child import judged
from fuzz.files import SpoiledFiles
from fuzz.limits import memory_limit, time_limit

SEEDS = range(25)


@pytest.mark.parametrize("kind", KINDS)
def test_valid_files_are_read(kind: str, tmp_path: Path) -> None:
    """Else spoiling them would prove nothing."""
    files = KINDS[kind](tmp_path)
    write(tmp_path, files)
    with memory_limit(MEMORY), time_limit(SECONDS):
        read(kind, tmp_path / next(iter(files)))


@pytest.mark.parametrize("kind", KINDS)
def test_spoiled_files(kind: str, tmp_path: Path) -> None:
    part = SpoiledFiles([kind])
    part.prepare(tmp_path)
    found: Counter[str] = Counter()
    for seed in SEEDS:
        outcome = judged(part, part.case(kind, seed), tmp_path / "case")
        assert not outcome.is_wrong, f"seed {seed}: {outcome.what}\n{outcome.text}"
        found[outcome.verdict] += 1
    assert found["right"] < len(SEEDS) - 5


@pytest.mark.filterwarnings("ignore")
def test_files_under_other_names(tmp_path: Path) -> None:
    """A name says nothing: content under any suffix, and nothing at all, is a field or an error of the package."""
    suffixes = (
        ".nii",
        ".dcm",
        ".tif",
        ".mrc",
        ".nc",
        ".h5",
        ".vti",
        ".vtk",
        ".vtm",
        ".vtkhdf",
        ".nrrd",
        ".csv",
        ".obj",
    )
    contents = [b"", b"\0" * 300, *(next(iter(KINDS[kind](tmp_path).values())) for kind in KINDS if "zarr" not in kind)]
    for number, content in enumerate(contents):
        for suffix in suffixes[number % 6 :: 6]:
            folder = tmp_path / f"{number}{suffix}"
            folder.mkdir()
            (folder / f"a{suffix}").write_bytes(content)
            with contextlib.suppress(ss.Error):
                ss.open(folder / f"a{suffix}")
                assert content.strip(b"\0")


# What was found


def _with_columns(data: bytes, count: int) -> bytes:
    return data.replace(b'NumberOfComponents="3"', b'NumberOfComponents="%d"' % count)


def _said_utf8(data: bytes) -> bytes:
    central = re.compile(rb"(PK\x01\x02.{4})..", re.S)
    return central.sub(lambda found: found[1] + b"\x00\x08", data).replace(b"abcdefgh", b"abc\x80\x80fgh")


def _many_tags(folder: Path, name: str) -> Files:
    files = of_meshio(name)(folder)
    return {name: re.sub(rb"(\$NodeData\n1\n[^\n]*\n)1\n", rb"\g<1>4294967297\n", files[name])}


FOUND: dict[str, Callable[[Path], Files]] = {
    "meshio gmsh of endless tags": lambda folder: _many_tags(folder, "b.msh"),
    "meshio gmsh 2 of endless tags": lambda folder: _many_tags(folder, "a.msh"),
    "npy of two headers": lambda _: {
        "a.npy": test_io.npy_bytes(test_io.VALUES).replace(b" " * 30, b"}order', 'shape': (2, 3, 4), }")
    },
    "npz that says its name is UTF-8": lambda _: {"a.npz": _said_utf8(npz(abcdefgh=test_io.VALUES))},
    "vtu of two thousand million columns": lambda _: {"a.vtu": _with_columns(vtu("raw"), 2**31)},
    "hdf5 of thirteen bytes": lambda _: {"a.h5": b"\x89HDF\r\n\x1a\n\0\0\0\0\0"},
    "picture png with a chunk of 2 GB": lambda folder: {
        "p.png": re.sub(rb"....IDAT", b"\x7f\xff\xff\xffIDAT", picture(".png", folder)["p.png"], flags=re.S)
    },
}


@pytest.mark.parametrize("kind", FOUND)
def test_what_fuzzing_found(kind: str, tmp_path: Path) -> None:
    files = FOUND[kind](tmp_path)
    write(tmp_path, files)
    with pytest.raises(ss.Error), memory_limit(MEMORY), time_limit(SECONDS):
        read(kind, tmp_path / next(iter(files)))
