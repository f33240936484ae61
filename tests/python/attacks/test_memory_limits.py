"""Processes with a limit on their address space: the right picture or an error, never the end of the process."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

SCRIPT = """
import resource, sys, zlib
import numpy as np
import sheetsplat as ss
backend, first, room = sys.argv[1], sys.argv[2] == "first", float(sys.argv[3])
field = ss.RegularField(np.random.default_rng(0).random((40, 40, 40), np.float32))
scene = ss.Scene(field, ss.TransferFunction([(0, 1, 1, 1, 0), (1, 1, 1, 1, 0.1)]), lights=[ss.Light()])
camera = ss.Camera.fit(field)
renderer = ss.Renderer(backend)
if first:
    renderer.render(scene, camera, size=(64, 64))
if room:
    used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + int(room * 2**20), resource.RLIM_INFINITY))
found = []
for size in (64, 300):
    for renderer in (renderer, ss.Renderer(backend, threads=8)):
        try:
            found.append(zlib.crc32(renderer.render(scene, camera, size=(size, size)).rgba))
        except (ss.OutOfMemory, ss.DeviceUnavailable) as error:
            assert "found" in str(error), error
            found.append("refused")
print(*found)
"""


def limited(backend: str, first: bool, room: float) -> list[str]:
    """Return the checksums of four pictures, or "refused", in a process that may take so many MiB more; 0: no limit."""
    environment = {**os.environ, "SHEETSPLAT_GL": "osmesa"}
    arguments = [sys.executable, "-c", SCRIPT, backend, "first" if first else "at once", str(room)]
    done = subprocess.run(arguments, env=environment, capture_output=True, text=True, timeout=300)
    # Python itself may find no memory for its own objects; no signal ends the process.
    assert done.returncode == 0 or "MemoryError" in done.stderr, (room, done.returncode, done.stderr[-1000:])
    return done.stdout.split()


def check(backend: str, first: bool, rooms: tuple[float, ...]) -> None:
    """Check that the least of these MiB refuse something, the most nothing, and that all pictures are right."""
    right = limited(backend, first, 0)
    if set(right) == {"refused"}:
        pytest.skip("no OSMesa here")
    assert len(right) == 4 and "refused" not in right
    found = [limited(backend, first, room) for room in rooms]
    assert "refused" in found[0] or not found[0]
    assert found[-1] == right
    for room, one in zip(rooms, found, strict=True):
        assert all(got in (wanted, "refused") for got, wanted in zip(one, right, strict=False)), (room, one, right)


@pytest.mark.slow
@pytest.mark.parametrize("first", [True, False])
def test_the_processor_with_little_memory(first: bool) -> None:
    # 40: threads took the memory of the first picture's data of their own, and ended the process.
    check("cpu", first, (0.5, 1, 4, 12, 40, 130, 137, 400))


@pytest.mark.slow
def test_the_reference_with_little_memory() -> None:
    check("reference", True, (0.5, 2, 20, 400))


@pytest.mark.slow
@pytest.mark.gl
@pytest.mark.parametrize("first", [True, False])
def test_opengl_in_software_with_little_memory(first: bool) -> None:
    check("gl", first, (100, 257, 600, 1025, 1300, 3000))
