"""Foreign objects as arguments, in small: tests/attacks/arguments.py does it by the thousand."""

from __future__ import annotations

import itertools
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import sheetsplat as ss
from attacks import values

TESTS = Path(__file__).parents[2]
SAMPLES = np.random.default_rng(0).random((6, 6, 6))


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_foreign_arguments() -> None:
    """In a process of its own, whose memory is limited."""
    pytest.importorskip("xarray")
    command = [sys.executable, "-m", "attacks", "foreign_arguments", "--seed", "5", "--count", "400"]
    found = subprocess.run(command, cwd=TESTS, capture_output=True, text=True, timeout=280)
    assert found.returncode == 0, found.stdout[-5000:] + found.stderr[-2000:]
    assert "400 calls\n" in found.stdout


RAISES, TRUTHS = values.Raises, np.ones(3)
FIELD = ss.RegularField(SAMPLES)
WIDE = np.broadcast_to(np.float32(1), (10**4, 10**4, 10**4))
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
PICTURE = ss.render(SAMPLES, size=8, backend="cpu")
FOUND: dict[str, Callable[[], object]] = {
    "a vector that raises": lambda: ss.Camera.fit(FIELD, RAISES()),
    "a number that raises": lambda: ss.RegularField(SAMPLES, radius=RAISES()),
    "an array that raises": lambda: ss.TransferFunction(RAISES()),
    "a size that raises": lambda: ss.render(SAMPLES, size=RAISES()),
    "a path that raises": lambda: ss.open(RAISES()),
    "an array as fit": lambda: ss.render(SAMPLES, fit=TRUTHS),
    "an array as log": lambda: ss.render(SAMPLES, log=TRUTHS),
    "an array as shading": lambda: ss.render(SAMPLES, shading=TRUTHS),
    "an array as depth_cue": lambda: ss.render(SAMPLES, depth_cue=TRUTHS),
    "an array as filter": lambda: ss.render(SAMPLES, filter=TRUTHS),
    "an array as prefilter of bricks": lambda: ss.open_bricks(SAMPLES, prefilter=TRUTHS),
    "an array as metadata": lambda: PICTURE.save("a.png", metadata=TRUTHS),
    "texts that are a list": lambda: PICTURE.to_png(texts=[3]),
    "an array as colour bar": lambda: PICTURE.annotated(colorbar=TRUTHS),
    "a title of surrogates": lambda: PICTURE.annotated(title="\ud800"),
    "a number as camera of a turntable": lambda: ss.turntable(SAMPLES, camera=3),
    "bytes as a scene file": lambda: ss.SceneFile.read(b"x.toml"),
    "a scene file with a long name": lambda: ss.SceneFile.read("x" * 9000 + ".toml"),
    "a number as a mesh": lambda: ss.fit.read_mesh(3),
    "a film named by surrogates": lambda: ss.turntable(SAMPLES, frames=1, size=8).save("\ud800"),
    "dots saved to a number": lambda: ss.io.save_npz(ss.EllipsoidField(CORNERS, np.ones(4), values=1), 3),
    "triangles of texts": lambda: ss.fit.winding_numbers(CORNERS, CORNERS, "x"),
    "triangles beyond the vertices": lambda: ss.fit.winding_numbers(CORNERS, CORNERS, [(0, 1, 9)]),
    "shares that are an array": lambda: ss.fit.solid(
        CORNERS, [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)], shares=TRUTHS
    ),
    "a seed of half a number": lambda: ss.datasets.noisy_ball(4, seed=0.5),
    "a lattice with cells of 1e308": lambda: ss.resample_to_bcc(SAMPLES, a=1e308),
    "a method that is an array": lambda: ss.resample_to_bcc(SAMPLES, method=TRUTHS),
    "a type that is an array": lambda: ss.resample_to_bcc(SAMPLES, dtype=TRUTHS),
    "points of terabytes": lambda: ss.TransferFunction(WIDE),
    "colours of terabytes": lambda: ss.ScalarColors(WIDE),
    "curves of terabytes": lambda: ss.TransferFunction.from_curves(WIDE, [(0, 1)]),
    "a volume of terabytes": lambda: ss.resample_to_bcc(WIDE),
    "steps without an end": lambda: ss.animate(itertools.repeat(SAMPLES)),
    "a mode of a series that is an array": lambda: ss.animate([SAMPLES, SAMPLES], mode=TRUTHS),
    "a client that raises": lambda: ss.open_bricks(SAMPLES, client=values.RaisesOnEverything()),
    "a lattice of bricks that is an array": lambda: ss.open_bricks(SAMPLES, lattice=TRUTHS),
    "a shape without an end": lambda: ss.fit.delaunay(SAMPLES.reshape(-1, 3), np.ones(72), shape=range(10**18)),
    "a truth of 400 digits": lambda: ss.accuracy(
        ss.Scene(FIELD, [(0, 1, 1, 1, 0), (1, 1, 1, 1, 1)]), ss.Camera.fit(FIELD), size=(8, 8), truth=10**400
    ),
    "something to look at that raises": lambda: ss.Camera.fit(values.RaisesOnEverything()),
    "fields in a list in itself": lambda: ss.Camera.fit(values.FOREIGN["list in itself"]()),
    "samples that raise": lambda: ss.resample_to_bcc(values.RaisesOnEverything()),
    "a film of what raises": lambda: ss.turntable(values.RaisesOnEverything(), size=8),
    "a film's client that raises": lambda: ss.turntable(SAMPLES, client=values.RaisesOnEverything()),
    "an opacity that raises": lambda: ss.render(SAMPLES, opacity=values.RaisesOnEverything()),
    "a radius of 400 digits": lambda: ss.EllipsoidField(CORNERS, -(10**400), values=1),
    "a browser that is an array": lambda: ss.view(SAMPLES, browser=TRUTHS),
}


@pytest.mark.timeout(60)
@pytest.mark.parametrize("call", FOUND.values(), ids=list(FOUND))
def test_what_foreign_arguments_found(
    call: Callable[[], object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ss.Error) as caught:
        call()
    assert 0 < len(str(caught.value)) < 4000 and list(tmp_path.iterdir()) == []
