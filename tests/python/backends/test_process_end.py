"""Rendering while the process ends, and in a process that was forked in the middle of a picture."""

from __future__ import annotations

import subprocess
import sys

import pytest

SCENE = """
import os, sys, threading, time
import numpy as np
import sheetsplat as ss
field = ss.RegularField(np.random.default_rng(0).random((40, 40, 40)))
ramp = ss.TransferFunction([(0, 1, 1, 1, 0), (1, 1, 1, 1, 0.1)])
scene = ss.Scene(field, ramp, slice_spacing=SPACING, reference_length=1)
camera = ss.Camera.fit(field)
renderer = ss.Renderer("BACKEND")
"""

# Without Python's modules, which are gone by then.
DEL = """
class Late:
    def __init__(self): self.arguments = [renderer.native, scene.native, camera.native, os.write]
    def __del__(self):
        native, scene, camera, write = self.arguments
        picture = native.render(scene, camera, size=(20, 20), coverage=False, depth=False, progress=lambda share: True)
        write(1, b"drawn")
renderer.render(scene, camera, size=(20, 20))
late = Late()
late.itself = late
"""

DAEMONS = """
def work():
    own = ss.Renderer("BACKEND")
    while True:
        own.render(scene, camera, size=(80, 80))
def make():
    while True:
        ss.RegularField(np.ones((60, 60, 60)), prefilter=True)
for target in (work, work, make):
    threading.Thread(target=target, daemon=True).start()
renderer.render(scene, camera, size=(60, 60))
time.sleep(TIME)
"""

FORK = """
began = threading.Event()
def draw():
    renderer.render(scene, camera, size=(200, 200), progress=lambda share: began.set())
thread = threading.Thread(target=draw)
thread.start()
began.wait()
child = os.fork()
if child == 0:
    try:
        renderer.render(scene, camera, size=(20, 20))
    except ss.Unsupported as error:
        assert "forked while another thread drew" in str(error), error
    else:
        os._exit(3)
    own = ss.Renderer("BACKEND").render(scene, camera, size=(20, 20))
    os._exit(0 if own.rgba.any() else 4)
ended = os.waitpid(child, 0)[1]
assert ended == 0, ended
thread.join()
"""


def run(script: str, backend: str, spacing: float) -> str:
    """Run a script in a process of its own; it must end by itself, without an error and without a message."""
    whole = (SCENE + script).replace("BACKEND", backend).replace("SPACING", str(spacing))
    done = subprocess.run([sys.executable, "-c", whole], capture_output=True, text=True, timeout=100)
    assert (done.returncode, done.stderr) == (0, ""), (done.returncode, done.stderr[-2000:])
    return done.stdout


BACKENDS = ["cpu", pytest.param("gl", marks=pytest.mark.gl), "reference"]


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_picture_drawn_by_the_interpreter_as_it_ends(backend: str) -> None:
    assert run(DEL, backend, 0.5) == "drawn"


@pytest.mark.slow
@pytest.mark.parametrize("wait", [0.05, 0.3])
@pytest.mark.parametrize("backend", BACKENDS[:2])
def test_daemon_threads_end_quietly(backend: str, wait: float) -> None:
    run(DAEMONS.replace("TIME", str(wait)), backend, 0.5)


@pytest.mark.slow
def test_a_fork_in_the_middle_of_a_picture_is_refused_in_the_child() -> None:
    run(FORK, "cpu", 0.02)
