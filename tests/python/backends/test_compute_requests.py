"""What asks for the compute path, what its plans say, and files of measured devices that cannot be used."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from image_checks import FLOAT32_HARD, off_by, within

import sheetsplat as ss

pytestmark = pytest.mark.gl

SIZE = (24, 20)
RAMP = [(0.0, 0.1, 0.2, 0.9, 0.0), (0.35, 0.2, 0.9, 0.3, 0.0), (0.7, 1.0, 0.6, 0.1, 0.3), (1.0, 1.0, 1.0, 1.0, 0.6)]


def _lattice() -> ss.RegularField:
    return ss.RegularField(np.random.default_rng(3).random((7, 8, 9)))


def _ellipsoids() -> ss.EllipsoidField:
    rng = np.random.default_rng(4)
    return ss.EllipsoidField(rng.random((30, 3)), scales=rng.uniform(0.1, 0.3, (30, 3)), values=rng.random(30))


def _plan(field: ss.Field, backend: Any = "gl", options: dict[str, Any] | None = None, **settings: Any) -> Any:
    scene = ss.Scene(field, RAMP, **(options or {}))
    return ss.Renderer(backend, **settings).plan(scene, ss.Camera.fit(field), size=SIZE)


@pytest.mark.parametrize("path", ["compute", "raster"])
def test_a_path_is_a_way_of_backend_gl(path: Any) -> None:
    """As packing="paper": backend cpu refuses it, auto takes gl, and the reference says that it does not use it."""
    with pytest.raises(ss.Unsupported, match=f"path {path}") as caught:
        _plan(_lattice(), "cpu", path=path)
    assert caught.value.option == "path"
    assert 'backend="gl"' in str(caught.value)
    plan = _plan(_lattice(), "auto", path=path)
    assert (plan.backend, plan.path) == ("gl", path)
    assert "\npath " in str(plan)


def test_other_backends_name_no_path() -> None:
    assert "\npath " not in str(_plan(_lattice(), "cpu"))
    assert "\npath " not in str(_plan(_lattice(), "reference"))


@pytest.mark.parametrize("field", [_lattice, _ellipsoids])
@pytest.mark.parametrize(
    "options", [{}, {"mode": "isosurface", "iso_value": 0.5}, {"mode": "mip"}], ids=["composite", "surface", "mip"]
)
def test_effects_are_those_of_the_path(field: Callable[[], ss.Field], options: dict[str, Any]) -> None:
    """The rows that raster passes decide first say what compute programs do."""
    plan = _plan(field(), options=options, path="compute")
    effects = {effect.name: effect for effect in plan.effects}
    assert len(effects) == len(plan.effects)
    assert effects["computed_tiles"].on
    assert not effects["points"].on
    assert effects["tagging"].on and plan.tagging == "off" and "pass" not in effects["tagging"].reason
    assert effects["resident_sections"].on == (field is _ellipsoids)
    # Largest values are sought along whole rays.
    assert effects["elimination"].on == (options.get("mode") != "mip")


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"tagging": "tiles"}, "tagging tiles"),
        ({"effects": {"elimination": False}}, "elimination"),
        ({"effects": {"resident_sections": False}}, "resident_sections"),
    ],
    ids=["tagging", "elimination", "resident_sections"],
)
def test_what_raster_passes_alone_can_do_is_refused(
    settings: dict[str, Any], named: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ss.Unsupported, match=named):
        _plan(_ellipsoids(), path="compute", **settings)
    monkeypatch.setenv("SHEETSPLAT_GL_PATH", "compute")
    plan = _plan(_ellipsoids(), **settings)
    assert plan.path == "raster"
    assert named in next(effect.reason for effect in plan.effects if effect.name == "computed_tiles")


def test_more_kernels_than_a_driver_has_turns_are_drawn_by_raster_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mesa's llvmpipe ends loops after 65,535 turns: what that may cut off is no picture of the compute path."""
    rng = np.random.default_rng(5)
    field = ss.EllipsoidField(rng.random((25_000, 3)), scales=np.full((25_000, 3), 0.02), values=rng.random(25_000))
    scene, camera = ss.Scene(field, RAMP), ss.Camera.fit(field)
    if "llvmpipe" not in ss.Renderer("gl").plan(scene, camera, size=SIZE).device:
        pytest.skip("the device does not end loops early, as far as is known")
    with pytest.raises(ss.Unsupported, match="ends loops") as caught:
        ss.Renderer("gl", path="compute").render(scene, camera, size=SIZE)
    assert caught.value.option == "path"
    monkeypatch.setenv("SHEETSPLAT_GL_PATH", "compute")
    image = ss.Renderer("gl").render(scene, camera, size=SIZE)
    assert image.plan.path == "raster"
    assert "25000" in next(effect.reason for effect in image.plan.effects if effect.name == "computed_tiles")
    assert within(off_by(image, ss.Renderer("cpu").render(scene, camera, size=SIZE)), FLOAT32_HARD)


def test_float64_sections_can_be_forced() -> None:
    field = _ellipsoids()
    scene, camera = ss.Scene(field, RAMP, lights=[ss.Light((0.3, 0.5, 1.0))]), ss.Camera.fit(field)
    renderer = ss.Renderer("gl", path="compute", effects={"precise_sections": True})
    image = renderer.render(scene, camera, size=SIZE)
    assert next(effect.on for effect in image.plan.effects if effect.name == "precise_sections")
    assert within(off_by(image, ss.Renderer("reference").render(scene, camera, size=SIZE)), FLOAT32_HARD)


_PLANS = """
import numpy as np
import sheetsplat as ss

field = ss.RegularField(np.linspace(0.0, 1.0, 6**3).reshape(6, 6, 6))
scene = ss.Scene(field, [(0.0, 1.0, 1.0, 1.0, 0.0), (1.0, 1.0, 1.0, 1.0, 0.5)])
for backend in ("gl", "auto"):
    plan = ss.Renderer(backend).plan(scene, ss.Camera.fit(field), size=(8, 8))
    print(plan.backend, plan.path, *[e.reason for e in plan.effects if e.name == "computed_tiles"])
"""


_SHADERS = str(Path.home() / ".cache" / "mesa_shader_cache")


def _said(cache: Path | str, folder: Path) -> list[str]:
    """Return backend, path and reason of two plans by a process that takes OpenGL in software for hardware."""
    environment = dict(os.environ, SHEETSPLAT_GL_DISABLE="software", XDG_CACHE_HOME=str(cache))
    # Compiled shaders stay where they are.
    environment.setdefault("MESA_SHADER_CACHE_DIR", _SHADERS)
    for name in ("SHEETSPLAT_BACKEND", "SHEETSPLAT_GL_PATH"):
        environment.pop(name, None)
    command = [sys.executable, "-c", _PLANS]
    done = subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True, check=True, timeout=300)
    return done.stdout.splitlines()


@pytest.mark.slow
def test_files_of_rates_that_cannot_be_used_are_passed_over(tmp_path: Path) -> None:
    """Wrong numbers, a folder, a pipe, a file of 2 MiB: the device is measured again, and nothing stays behind."""
    file = tmp_path / "sheetsplat" / "device-rates.txt"
    assert "measured" in _said(tmp_path, tmp_path)[0]
    name, _, _ = file.read_text(encoding="utf-8").partition("\t")

    def measured_again() -> bool:
        return "123 ms" not in (said := _said(tmp_path, tmp_path)[0]) and "measured" in said

    good = "123e-3 456e-3 1e-3 123e-3 456e-3 1e-3"
    file.write_text(f"0 another version\t1 2\n{name}\t{good}", encoding="utf-8")
    assert not measured_again()
    for numbers in (
        f"{good} 7",
        good.replace("456e-3", "456e-3s"),
        good.replace("1e-3", "never"),
        "123e-3 1e300 1 1 1 1",
    ):
        file.write_text(f"{name}\t{numbers}\n", encoding="utf-8")
        assert measured_again(), numbers
    file.write_text(f"{name}\t{good}\n" + "x" * (2 << 20), encoding="utf-8")
    assert measured_again()
    assert sorted(path.name for path in file.parent.iterdir()) == [file.name]
    file.unlink()
    os.mkfifo(file)
    assert measured_again()
    file.unlink()
    file.mkdir()
    assert measured_again()
    assert sorted(path.name for path in file.parent.iterdir()) == [file.name]


@pytest.mark.slow
def test_a_device_whose_paths_both_failed_is_not_taken(tmp_path: Path) -> None:
    file = tmp_path / "sheetsplat" / "device-rates.txt"
    _said(tmp_path, tmp_path)
    name, _, _ = file.read_text(encoding="utf-8").partition("\t")
    file.write_text(f"{name}\tnever never 1e-3 never never 1e-3\n", encoding="utf-8")
    by_gl, by_auto = _said(tmp_path, tmp_path)
    assert by_gl.startswith("gl raster ")
    assert by_auto.startswith("cpu ")


@pytest.mark.slow
def test_a_relative_cache_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert "measured" in _said("beside", tmp_path)[0]
    assert not (tmp_path / "beside").exists()
    assert (tmp_path / "home" / ".cache" / "sheetsplat" / "device-rates.txt").is_file()
