"""The compute path of backend gl (path="compute"): the reference's pictures, the same bits in every run, no seams."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from image_checks import FLOAT32_HARD, off_by, within

import sheetsplat as ss

pytestmark = pytest.mark.gl

SIZE = (41, 35)
RAMP = [(0.0, 0.1, 0.2, 0.9, 0.0), (0.35, 0.2, 0.9, 0.3, 0.0), (0.7, 1.0, 0.6, 0.1, 0.3), (1.0, 1.0, 1.0, 1.0, 0.6)]
# Of thin kernels, whose means over slabs and pixels are small.
FAINT = [(0.0, 0.1, 0.2, 0.9, 0.0), (0.01, 0.2, 0.9, 0.3, 0.2), (1.0, 1.0, 1.0, 1.0, 0.6)]
LIT: dict[str, Any] = {"lights": [ss.Light((0.3, 0.5, 1.0)), ss.Light((-1.0, 0.2, 0.4), color=(0.2, 0.3, 0.5))]}


def _wave(shape: tuple[int, int, int]) -> np.ndarray[Any, Any]:
    """Return samples between 0 and 1 that differ along every axis."""
    k, j, i = np.meshgrid(*(np.linspace(-1.0, 1.0, count) for count in shape), indexing="ij")
    return 0.5 + 0.5 * np.cos(5.0 * i + 1.0) * np.cos(3.0 * j) * np.cos(4.0 * k - 0.5)


def _holed() -> np.ndarray[Any, Any]:
    samples = _wave((9, 10, 11))
    samples[3:5, 4:6, 2:7] = np.nan
    return samples


def _scattered(count: int = 150, aspect: float = 6.0, **options: Any) -> ss.EllipsoidField:
    rng = np.random.default_rng(7)
    scales = 0.12 * rng.uniform(1.0, aspect, (count, 3)) ** rng.choice([0.0, 1.0], (count, 3))
    rotations = rng.normal(size=(count, 4))
    return ss.EllipsoidField(
        rng.uniform(-1.0, 1.0, (count, 3)),
        scales=scales,
        rotations=rotations / np.linalg.norm(rotations, axis=1, keepdims=True),
        values=rng.uniform(0.0, 1.0, count),
        **options,
    )


def _needles() -> ss.EllipsoidField:
    rng = np.random.default_rng(8)
    rotations = rng.normal(size=(40, 4))
    return ss.EllipsoidField(
        rng.uniform(-0.05, 0.05, (40, 3)),
        scales=np.tile([4.0, 0.0039, 0.0035], (40, 1)),
        rotations=rotations / np.linalg.norm(rotations, axis=1, keepdims=True),
        values=np.ones(40),
        normalization="threshold",
    )


FIELDS: dict[str, Any] = {
    "bytes": lambda: ss.RegularField((_wave((9, 12, 14)) * 255).astype(np.uint8) / np.float32(255)),
    "kelvin": lambda: ss.RegularField(_wave((8, 9, 10)).astype(np.float64)),
    "uneven": lambda: ss.RegularField(_wave((6, 9, 14)), spacing=(1.0, 1.6, 0.7)),
    "leaning": lambda: ss.RegularField(_wave((8, 9, 10)), axes=[[1.0, 0.1, 0.0], [0.3, 1.0, 0.0], [0.0, 0.2, 0.8]]),
    "holed": lambda: ss.RegularField(_holed(), nan="skip"),
    "bcc": lambda: ss.RegularField(_wave((14, 8, 9)), lattice="bcc"),
    "wide kernels": lambda: ss.RegularField(_wave((8, 9, 10)), radius=3.0, falloff=8.0, boundary="zero"),
    "scattered": _scattered,
    "sums": lambda: _scattered(normalization="none"),
    "needles": _needles,
}
EFFECTS: dict[str, dict[str, Any]] = {
    "unlit": {},
    "lit": LIT,
    "slab": {**LIT, "sampling": "slab"},
    "analytic": {**LIT, "gradient": "analytic"},
    "close": {**LIT, "slice_spacing": 0.05},
    "preintegrated": {**LIT, "preintegration": True},
    "surface": {**LIT, "mode": "isosurface", "iso_value": 0.6},
    "filtered": {**LIT, "filter": "ewa"},
    "x-ray": {"mode": "xray"},
    "mip": {"mode": "mip"},
    "average": {"mode": "average"},
    "clipped": {**LIT, "clip": ss.Clip([((0.3, 0.4, -1.0), -0.1)])},
}


def _picture(scene: ss.Scene, camera: ss.Camera, backend: str = "gl", **settings: Any) -> ss.Image:
    return ss.Renderer(backend, **settings).render(scene, camera, size=SIZE)


def _camera(field: ss.Field, projection: Any) -> ss.Camera:
    if field.bounds[1][0] - field.bounds[0][0] > 4.0 and isinstance(field, ss.EllipsoidField):
        # Needles far longer than what is looked at.
        eye, target = (3.0, 1.8, 4.2), (0.0, 0.0, 0.0)
        if projection == "perspective":
            return ss.Camera.perspective(eye, target, fov_y=3.0)
        return ss.Camera.orthographic(eye, target, height=0.3)
    return ss.Camera.fit(field, direction=(-1.0, -0.6, -1.4), kind=projection)


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
@pytest.mark.parametrize("effect", EFFECTS)
@pytest.mark.parametrize("name", FIELDS)
def test_pictures_are_the_references(name: str, effect: str, projection: str) -> None:
    field = FIELDS[name]()
    options = {"slice_spacing": 0.05, "reference_length": 0.05} if name == "needles" else {}
    scene = ss.Scene(field, FAINT if name == "needles" else RAMP, **(options | EFFECTS[effect]))
    camera = _camera(field, projection)
    image = _picture(scene, camera, path="compute")
    assert image.plan.path == "compute"
    expected = _picture(scene, camera, "reference")
    assert np.nanmax(np.abs(expected.pixels)) > 1e-3
    assert within(off_by(image, expected), FLOAT32_HARD), f"{off_by(image, expected)}"


@pytest.mark.parametrize("name", ["leaning", "scattered"])
def test_a_shifted_picture_fails(name: str) -> None:
    """The control of the test above: a picture from a camera that is a tenth of a degree off."""
    field = FIELDS[name]()
    scene = ss.Scene(field, RAMP, **LIT)
    beside = ss.Camera.fit(field, direction=(-1.0017, -0.6, -1.4))
    image = _picture(scene, beside, path="compute")
    expected = _picture(scene, _camera(field, "orthographic"), "reference")
    assert not within(off_by(image, expected), FLOAT32_HARD)


def test_several_fields_and_groups_are_drawn() -> None:
    fields = [FIELDS["uneven"](), FIELDS["bytes"](), _scattered(), FIELDS["sums"]()]
    camera = ss.Camera.fit(fields[0], direction=(-1.0, -0.6, -1.4))
    for scene in (
        ss.Scene(fields[:2], RAMP, **LIT),
        ss.Scene(fields, RAMP, **LIT),
        ss.Scene([fields[0], fields[2]], [RAMP, RAMP[:2] + RAMP[3:]], **LIT),
    ):
        image = _picture(scene, camera, path="compute")
        assert image.plan.path == "compute"
        expected = _picture(scene, camera, "reference")
        assert within(off_by(image, expected), FLOAT32_HARD)


@pytest.mark.parametrize("name", ["kelvin", "scattered", "needles"])
def test_runs_give_the_same_bits(name: str) -> None:
    field = FIELDS[name]()
    spacing = 0.05 if name == "needles" else None
    scene, camera = ss.Scene(field, RAMP, **LIT, slice_spacing=spacing), _camera(field, "perspective")
    first = _picture(scene, camera, path="compute")
    renderer = ss.Renderer("gl", path="compute")
    for _ in range(2):
        again = renderer.render(scene, camera, size=SIZE)
        assert np.array_equal(first.pixels, again.pixels)


@pytest.mark.parametrize("name", ["kelvin", "scattered"])
@pytest.mark.parametrize("edge", [1, 7, 16])
def test_tiles_leave_no_seam(name: str, edge: int) -> None:
    """Tiles of work groups and of pictures: their borders move, the picture does not."""
    field = FIELDS[name]()
    scene, camera = ss.Scene(field, RAMP, **LIT), _camera(field, "orthographic")
    whole = _picture(scene, camera, path="compute")
    tiled = _picture(scene, camera, path="compute", tile_size=edge)
    assert within(off_by(tiled, whole), (1e-6, 1e-5))


def test_a_new_transfer_function_and_new_samples_are_seen() -> None:
    """What stays on the device is uploaded again where other samples or kernels are drawn."""
    renderer = ss.Renderer("gl", path="compute")
    fields = [FIELDS["kelvin"](), FIELDS["leaning"](), _scattered(60), _scattered(90)]
    narrow = [(0.0, 1.0, 1.0, 1.0, 0.0), (0.8, 1.0, 1.0, 1.0, 0.0), (0.9, 1.0, 0.2, 0.1, 0.7)]
    for field in [*fields, *fields[::-1]]:
        for function in (narrow, RAMP, narrow):
            scene, camera = ss.Scene(field, function), _camera(field, "orthographic")
            image = renderer.render(scene, camera, size=(16, 16))
            expected = ss.Renderer("reference").render(scene, camera, size=(16, 16))
            assert within(off_by(image, expected), FLOAT32_HARD)


def test_a_long_stack_of_slices_is_drawn_in_several_calls() -> None:
    """The first call of a device takes a few steps: what one call leaves, the next goes on with."""
    field = _scattered(40)
    scene = ss.Scene(field, RAMP, **LIT, slice_spacing=0.01, reference_length=0.1)
    camera = _camera(field, "orthographic")
    image = _picture(scene, camera, path="compute")
    assert image.stats["slices"] > 200
    assert within(off_by(image, _picture(scene, camera, "reference")), FLOAT32_HARD)


def test_the_plan_says_which_path_and_why(monkeypatch: pytest.MonkeyPatch) -> None:
    field = FIELDS["kelvin"]()
    scene, camera = ss.Scene(field, RAMP), _camera(field, "orthographic")

    def plan(**settings: Any) -> ss.RenderPlan:
        return ss.Renderer("gl", **settings).plan(scene, camera, size=SIZE)

    assert plan(path="compute").path == "compute"
    assert plan(path="raster").path == "raster"
    monkeypatch.setenv("SHEETSPLAT_GL_PATH", "compute")
    assert plan().path == "compute"
    assert plan(packing="paper").path == "raster"
    reasons = {effect.name: effect.reason for effect in plan(packing="paper").effects}
    assert "papers" in reasons["computed_tiles"]
    with pytest.raises(ss.Unsupported, match="papers"):
        plan(path="compute", packing="paper")
    monkeypatch.setenv("SHEETSPLAT_GL_PATH", "vulkan")
    with pytest.raises(ss.InvalidInput, match="vulkan"):
        plan()


def test_a_device_without_compute_programs_draws_by_raster(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SHEETSPLAT_GL_DISABLE", "compute")
    field = FIELDS["kelvin"]()
    scene, camera = ss.Scene(field, RAMP), _camera(field, "orthographic")
    monkeypatch.setenv("SHEETSPLAT_GL_PATH", "compute")
    assert ss.Renderer("gl").plan(scene, camera, size=SIZE).path == "raster"
    with pytest.raises(ss.Unsupported, match="compute"):
        ss.Renderer("gl", path="compute").plan(scene, camera, size=SIZE)


_AUTO = """
import sys
import numpy as np
import sheetsplat as ss

field = ss.RegularField(np.linspace(0.0, 1.0, 6**3).reshape(6, 6, 6))
scene = ss.Scene(field, [(0.0, 1.0, 1.0, 1.0, 0.0), (1.0, 1.0, 1.0, 1.0, 0.5)])
plan = ss.Renderer(sys.argv[1]).plan(scene, ss.Camera.fit(field), size=(8, 8))
print(plan.backend, plan.path, plan.device, *[e.reason for e in plan.effects if e.name == "computed_tiles"])
"""


def test_auto_measures_a_device_once(tmp_path: Path) -> None:
    """A device that counts as hardware is measured, and the file of the cache is believed later, if it can be read."""
    environment = dict(os.environ, SHEETSPLAT_GL_DISABLE="software", XDG_CACHE_HOME=str(tmp_path))
    environment.pop("SHEETSPLAT_BACKEND", None)
    environment.pop("SHEETSPLAT_GL_PATH", None)
    file = tmp_path / "sheetsplat" / "device-rates.txt"

    def said(backend: str) -> str:
        command = [sys.executable, "-c", _AUTO, backend]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True, timeout=300)
        return done.stdout

    assert "measured" in said("gl")
    name, _, _ = file.read_text(encoding="utf-8").partition("\t")
    # Compute fastest, then the processor, then raster; and one that failed.
    for numbers, backend, path in (
        ("2e-2 1e-3 5e-3 1 1 1", "gl", "compute"),
        ("2e-2 never 5e-3 1 1 1", "cpu", "raster"),
        ("1e-3 never 5e-3 1 1 1", "gl", "raster"),
    ):
        file.write_text(f"{name}\t{numbers}\n", encoding="utf-8")
        assert said("auto").startswith(f"{backend} {path} ")
    file.write_text(f"{name}\tnan -3 many\n\x00\t", encoding="utf-8")
    assert "measured" in said("gl") + said("auto")
    lines = dict(line.split("\t") for line in file.read_text(encoding="utf-8").splitlines())
    assert len(lines[name].split()) == 6
