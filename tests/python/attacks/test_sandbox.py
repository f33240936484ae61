"""Readers in child processes: what a file may take there, and that they end with the call."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest
import test_meshio_files as meshes

import sheetsplat as ss
from sheetsplat.io import read_scattered, sandbox
from sheetsplat.io.source import Source

pytestmark = pytest.mark.filterwarnings("ignore")


def instead(monkeypatch, tmp_path, code):
    """Let children run other code, in one second of a processor; return a file for them."""
    script = tmp_path / "reader.py"
    limits = "import os, resource, sys\nresource.setrlimit(resource.RLIMIT_CPU, (int(sys.argv[4]),) * 2)\n"
    script.write_text(limits + f"open({str(tmp_path / 'pid')!r}, 'w').write(str(os.getpid()))\n" + code)
    monkeypatch.setattr(sandbox, "_SCRIPT", script)
    monkeypatch.setattr(sandbox, "_SECONDS", 1)
    (tmp_path / "a.msh").write_bytes(b"$MeshFormat\n")
    return tmp_path / "a.msh"


def ended(tmp_path):
    """Return whether the child is gone, soon."""
    child = Path(f"/proc/{(tmp_path / 'pid').read_text()}")
    until = time.monotonic() + 10
    while child.exists() and time.monotonic() < until:
        time.sleep(0.05)
    return not child.exists()


def test_a_few_bytes_that_ask_for_all_memory(tmp_path):
    path = meshes.write(tmp_path / "b.msh", cells=meshes.CELLS[:1])
    data = path.read_bytes()
    asked = data.replace(b"\n6\n", b"\n999999999999\n")
    assert asked != data
    path.write_bytes(asked)
    with pytest.raises(ss.OutOfMemory, match=r"b\.msh"):
        read_scattered(path)


@pytest.mark.parametrize("code", ["while True: pass", "os.abort()", "bytes(1 << 60)"])
def test_children_that_break_down_are_errors(tmp_path, monkeypatch, code):
    path = instead(monkeypatch, tmp_path, code)
    with pytest.raises(ss.InvalidInput, match="gave up within 1 s"):
        read_scattered(path)
    assert ended(tmp_path)


def test_children_that_wait_are_ended(tmp_path, monkeypatch):
    path = instead(monkeypatch, tmp_path, "import time; time.sleep(600)")
    monkeypatch.setattr(sandbox, "_WAITED", 2)
    start = time.monotonic()
    with pytest.raises(ss.InvalidInput, match="gave up"):
        read_scattered(path)
    assert time.monotonic() - start < 60 and ended(tmp_path)


def test_ctrl_c_ends_the_child(tmp_path, monkeypatch):
    path = instead(monkeypatch, tmp_path, "os.kill(os.getppid(), 2); import time; time.sleep(600)")
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            read_scattered(path)
    finally:
        signal.signal(signal.SIGINT, before)
    assert ended(tmp_path)


def test_every_end_of_a_file_is_an_error_or_the_file(tmp_path):
    path = meshes.write(tmp_path / "b.msh", cells=meshes.CELLS[:1])
    data = path.read_bytes()
    for size in range(0, len(data), len(data) // 6):
        path.write_bytes(data[:size])
        with pytest.raises(ss.Error):
            read_scattered(path)
    path.write_bytes(data)
    opened = len(os.listdir("/proc/self/fd"))
    with Source(path) as source:
        arrays = dict(sandbox.read_apart(source, "gmsh"))
    assert np.array_equal(arrays["points",], meshes.POINTS) and arrays["cells", "tetra"].dtype.kind in "iu"
    del arrays
    assert len(os.listdir("/proc/self/fd")) == opened
