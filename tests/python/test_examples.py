"""The example programs run as they are, in an empty folder, and each picture that they write shows something."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from sheetsplat.io.pictures import read_picture

EXAMPLES = Path(__file__).resolve().parents[2] / "python" / "examples"
PICTURES = {
    "ellipsoids.py": {"spiral.png"},
    "first_picture.py": {"torus.png", "torus-perspective.png"},
    "how_exact.py": set(),
    "lattices.py": {"signal-cartesian.png", "signal-bcc.png"},
    "mesh_and_particles.py": {"ring.png", "ring-mach.png", "cloud.png"},
    "mixed_scene.py": {"mixed.png"},
    "turntable.py": {"frame000.png", "frame001.png"},
}
ARGUMENTS = {"turntable.py": ["2", "."]}


def test_every_example_is_run():
    assert {path.name for path in EXAMPLES.glob("*.py")} == set(PICTURES)


@pytest.mark.gl
@pytest.mark.parametrize("name", sorted(PICTURES))
def test_example(name, tmp_path):
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / name), *ARGUMENTS.get(name, [])],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    assert {path.name for path in tmp_path.glob("*.png")} == PICTURES[name]
    for picture in tmp_path.glob("*.png"):
        pixels = read_picture(picture)
        # Neither empty nor of one colour.
        assert pixels.std() > 1e-3, picture.name
