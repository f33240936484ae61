"""What a PNG says about how it was made: making it again, and metadata that was tampered with."""

from __future__ import annotations

import getpass
import json
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import run
from PIL import Image as PillowImage

import sheetsplat as ss
from sheetsplat.describe.recipe import Recipe
from sheetsplat.describe.schema import LONGEST
from sheetsplat.io.png_text import read_text

SMALL = {"size": (20, 16), "backend": "reference"}


def levels(path: Path) -> np.ndarray:
    with PillowImage.open(path) as found:
        return np.asarray(found)


@pytest.fixture(scope="module")
def kernels(tmp_path_factory) -> Path:
    """Return a file of turned ellipsoids."""
    rng = np.random.default_rng(12)
    path = tmp_path_factory.mktemp("kernels") / "kernels.npz"
    turns = rng.normal(size=(30, 4))
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    field = ss.EllipsoidField(rng.normal(size=(30, 3)), rng.uniform(0.5, 1.5, (30, 3)), turns, values=rng.random(30))
    ss.io.save_npz(field, path)
    return path


LOOKS = {
    "composite": {},
    "clipped": {"clip": ss.Clip(planes=[((1, 0, 0), 5.0)]), "depth_cue": "auto", "background": "white"},
    "lit": {"lights": [ss.Light((1, 2, 3), space="world")], "material": ss.Material(specular=0.5), "shadows": True},
    "occluded": {"ambient_occlusion": ss.AmbientOcclusion(3.0, 0.5), "gradient": "analytic"},
    "isosurface": {"mode": "isosurface", "iso_value": 90, "projection": "perspective"},
    "isosurfaces": {"mode": "isosurface", "iso_value": [(50, 0.3), (120, 1.0)]},
    "average": {"mode": "average"},
    "second order": {"preintegration": "second_order", "opacity_stop": 1.0, "cmap": "magma", "clim": (20, 180)},
    "xray": {"mode": "xray", "cmap": ["black", "red", "white"], "log_scale": True},
    "mip": {"mode": "mip", "clim": (10, 150)},
    "kernel": {"radius": 2.5, "falloff": 7.0, "prefilter": True, "spacing": (1, 2, 1), "origin": (3, 0.1, 0)},
    "logarithm": {"log": 0.5},
    "given error": {"max_error": 0.05, "backend": "cpu"},
}


@pytest.mark.parametrize("name", LOOKS)
def test_a_picture_is_made_again(tmp_path, volume, name):
    first, again = tmp_path / "first.png", tmp_path / "again.png"
    image = ss.render(volume, **{**SMALL, **LOOKS[name]})
    image.save(first)
    assert Recipe.read(first) == image.recipe
    run("render", first, volume, "-o", again)
    assert np.array_equal(levels(first), levels(again))
    assert first.read_bytes() == again.read_bytes()


def test_scattered_kernels_are_made_again(tmp_path, kernels):
    first, again = tmp_path / "first.png", tmp_path / "again.png"
    field = ss.open(kernels, w0=0.1).with_ghost_points()
    ss.render(field, **SMALL).save(first)
    run("render", first, kernels, "-o", again)
    assert first.read_bytes() == again.read_bytes()


def test_several_fields_take_several_files(tmp_path, volume, kernels):
    first, again = tmp_path / "first.png", tmp_path / "again.png"
    ss.render([ss.open(volume), ss.open(kernels)], **SMALL).save(first)
    run("render", first, volume, kernels, "-o", again)
    assert np.array_equal(levels(first), levels(again))
    assert "made of 2 files" in run("render", first, volume, "-o", again, code=2).stderr
    assert "is no data for this picture" in run("render", first, kernels, volume, "-o", again, code=1).stderr


def test_groups_with_transfer_functions_of_their_own_are_made_again(tmp_path, volume, kernels):
    first, again = tmp_path / "first.png", tmp_path / "again.png"
    fields = [ss.open(volume), ss.open(kernels), ss.open(volume)]
    scene = ss.Scene(
        [fields[:2], fields[2]], [[(0, 0, 0, 1, 0), (200, 1, 1, 0, 0.5)], [(0, 1, 0, 0, 0), (90, 1, 0, 0, 1)]]
    )
    image = ss.render(scene, **SMALL)
    image.save(first)
    assert Recipe.read(first).scene(fields) == scene
    run("render", first, volume, kernels, volume, "-o", again)
    assert first.read_bytes() == again.read_bytes()


def test_sizes_and_backends_may_change_and_looks_may_not(tmp_path, volume):
    first, again = tmp_path / "first.png", tmp_path / "again.png"
    run("render", volume, "-o", first, "--size", "20", "--backend", "reference")
    run("render", first, volume, "-o", again, "--size", "30x20", "--backend", "cpu")
    assert levels(again).shape == (20, 30, 4)
    assert "its own --cmap" in run("render", first, volume, "-o", again, "--cmap", "gray", code=2).stderr
    assert "name the data" in run("render", first, "-o", again, code=2).stderr
    assert "is no picture" in run("render", volume, first, "-o", again, code=2).stderr


def test_nothing_personal_is_written(tmp_path, volume):
    path = tmp_path / "a.png"
    ss.render(volume, **SMALL).save(path)
    text = read_text(path, LONGEST)
    assert text is not None
    for private in (str(tmp_path), tmp_path.name, volume.name, getpass.getuser() + "/", "/home", "/root", "/tmp"):
        assert private not in text
    plain = json.loads(text)
    assert plain["version"] == ss.__version__ and plain["size"] == [20, 16] and "device" not in plain["renderer"]


def test_it_can_be_left_out(tmp_path, volume):
    image = ss.render(volume, **SMALL)
    image.save(tmp_path / "a.png", metadata=False)
    with pytest.raises(ss.InvalidInput, match="does not say how it was made"):
        Recipe.read(tmp_path / "a.png")
    run("render", volume, "-o", tmp_path / "b.png", "--no-metadata", "--size", "8", "--backend", "reference")
    assert "does not say" in run("render", tmp_path / "b.png", volume, "-o", tmp_path / "c.png", code=1).stderr
    with PillowImage.open(tmp_path / "a.png") as found:
        assert "sheetsplat" not in found.info
    assert not (tmp_path / "c.png").exists()


# Metadata that was changed. Each case changes the parsed JSON, and the message names the key.
def change(*keys, value):
    def changed(plain):
        inner = plain
        for key in keys[:-1]:
            inner = inner[key]
        inner[keys[-1]] = value
        return plain

    return changed


def drop(*keys):
    def dropped(plain):
        inner = plain
        for key in keys[:-1]:
            inner = inner[key]
        del inner[keys[-1]]
        return plain

    return dropped


LEVEL = {"maker": "orthographic", "eye": [0, 0, 1], "target": [0, 0, 0], "up": [0, 1, 0], "height": 9}
CHANGES = {
    "no object": (lambda plain: [plain], "description"),
    "unknown key": (change("command", value="rm -rf /"), "'command'"),
    "missing key": (drop("camera"), "'camera'"),
    "newer format": (change("format", value=2), "format"),
    "format as text": (change("format", value="1"), "format"),
    "format as truth": (change("format", value=True), "format"),
    "newer version": (change("version", value="99.0.0"), "version"),
    "strange version": (change("version", value="latest"), "version"),
    "version as number": (change("version", value=0.1), "version"),
    "size 0": (change("size", value=[0, 5]), "found size: (0, 5)"),
    "size as text": (change("size", value="20x16"), "size"),
    "three sizes": (change("size", value=[1, 2, 3]), "size"),
    "camera as list": (change("camera", value=[1]), "camera"),
    "camera maker": (change("camera", "maker", value="by hand"), "maker"),
    "camera maker dunder": (change("camera", "maker", value="__init__"), "maker"),
    "camera of another maker": (change("camera", "maker", value="perspective"), "camera"),
    "camera key": (change("camera", "near", value=3), "near"),
    "camera box": (change("camera", "lower", value=[1, 2]), "camera"),
    "camera box of text": (change("camera", "lower", value="low"), "camera"),
    "camera direction": (change("camera", "direction", value=[0, 0, 0]), "camera"),
    "camera up": (change("camera", "up", value={"x": 1}), "camera"),
    "camera margin": (change("camera", "margin", value="wide"), "margin"),
    "camera margin below 0": (change("camera", "margin", value=-1), "camera"),
    "camera height": (
        change(
            "camera",
            value={"maker": "orthographic", "eye": [0, 0, 1], "target": [0, 0, 0], "up": [0, 1, 0], "height": "9"},
        ),
        "height",
    ),
    "camera eye": (
        change(
            "camera", value={"maker": "orthographic", "eye": [0, 1], "target": [0, 0, 0], "up": [0, 1, 0], "height": 9}
        ),
        "eye",
    ),
    "no points": (change("transfer_functions", value=[]), "transfer_functions"),
    "points as text": (change("transfer_functions", value="viridis"), "transfer_functions"),
    "short point": (change("transfer_functions", 0, 0, value=[1, 2]), "transfer_functions"),
    "opacity": (change("transfer_functions", 0, 0, value=[1, 0, 0, 0, 7]), "transfer_functions"),
    "point of text": (change("transfer_functions", 0, 0, value=["0", "0", "0", "0", "0"]), "transfer_functions"),
    "scene key": (change("scene", "exec", value=1), "'exec'"),
    "mode": (change("scene", "mode", value="best"), "mode"),
    "mode as list": (change("scene", "mode", value=["xray"]), "mode"),
    "shadows as number": (change("scene", "shadows", value=1), "shadows"),
    "spacing": (change("scene", "slice_spacing", value="1"), "slice_spacing"),
    "spacing as object": (change("scene", "slice_spacing", value={}), "slice_spacing"),
    "lights": (change("scene", "lights", value=[{"direction": [0, 0, 0]}]), "lights"),
    "light key": (change("scene", "lights", value=[{"power": 1}]), "'power'"),
    "light space": (change("scene", "lights", value=[{"space": "outer"}]), "space"),
    "material": (change("scene", "material", value={"ambient": "much"}), "ambient"),
    "material as number": (change("scene", "material", value=3), "material"),
    "clip": (change("scene", "clip", value={"planes": [[1, 2]]}), "clip"),
    "clip box": (change("scene", "clip", value={"box": [[1, 1, 1], [0, 0, 0]]}), "box"),
    "cue without end": (change("scene", "depth_cue", value={"start": 1}), "depth_cue"),
    "cue as text": (change("scene", "depth_cue", value="auto"), "depth_cue"),
    "occlusion": (change("scene", "ambient_occlusion", value={"radius": -1}), "radius"),
    "colors": (change("scene", "scalar_colors", value={"cmap": "no such"}), "cmap"),
    "colors limits": (change("scene", "scalar_colors", value={"clim": [2, 1]}), "clim"),
    "groups": (change("groups", value=[2]), "groups"),
    "groups of truth": (change("groups", value=[True]), "groups"),
    "no groups": (change("groups", value=[]), "groups"),
    "no fields": (change("fields", value=[]), "fields"),
    "field kind": (change("fields", 0, "kind", value="str"), "kind"),
    "field key": (change("fields", 0, "path", value="/etc/passwd"), "'path'"),
    "field option": (change("fields", 0, "options", value={"values": 1}), "'values'"),
    "nested option": (change("fields", 0, "options", value={"radius": [[1]]}), "radius"),
    "grid": (change("fields", 0, "opened", value={"grid": "/etc/passwd"}), "'grid'"),
    "unit": (change("fields", 0, "quantity", value={"unit": "m\n"}), "unit"),
    "floor": (change("fields", 0, "quantity", value={"floor": 0}), "floor"),
    "ghosts": (change("fields", 0, "ghost_points", value=[1]), "ghost_points"),
    "ghosts of a volume": (change("fields", 0, "ghost_points", value=[1.0, 1.0]), "ghost_points"),
    "w0": (change("fields", 0, "options", "w0", value=-1), "options: w0: -1"),
    "w0 of a file": (change("fields", 0, "opened", value={"w0": -1}), "opened: w0: -1"),
    "radius": (change("fields", 0, "options", "radius", value=0), "radius"),
    "spacing 0": (change("fields", 0, "options", "spacing", value=[1, 0, 1]), "options: spacing"),
    "normalization": (change("fields", 0, "options", "normalization", value="x"), "normalization"),
    "nan": (change("fields", 0, "options", "nan", value="ignore"), "nan"),
    "trim": (change("fields", 0, "trim", value={"kernels": [3]}), "trim: kernels"),
    "limits": (change("fields", 0, "trim", value={"limits": [3, 1]}), "trim: limits"),
    "trim that falls": (change("fields", 0, "trim", value={"kernels": [3, 3]}), "trim: kernels"),
    "stop": (change("scene", "opacity_stop", value=2), "scene: opacity_stop"),
    "trim of nothing": (change("fields", 0, "trim", value={"samples": [3]}), "'samples'"),
    "backend": (change("renderer", "backend", value="gpu"), "backend"),
    "renderer key": (change("renderer", "device", value=1), "'device'"),
    "effects": (change("renderer", "effects", value=["x"]), "effects"),
}


@pytest.fixture(scope="module")
def drawn(ball, tmp_path_factory) -> bytes:
    """Return a PNG of the file of the fixture `volume`."""
    folder = tmp_path_factory.mktemp("drawn")
    np.save(folder / "ball.npy", (ball * 200).astype(np.uint8))
    ss.render(folder / "ball.npy", **SMALL).save(folder / "a.png")
    return (folder / "a.png").read_bytes()


@pytest.fixture
def picture(tmp_path, drawn) -> tuple[Path, dict]:
    path = tmp_path / "a.png"
    path.write_bytes(drawn)
    text = read_text(path, LONGEST)
    assert text is not None
    return path, json.loads(text)


def rewrite(path: Path, text: bytes, *, check: bytes | None = None, times: int = 1) -> None:
    """Put a text into a PNG in place of the one that it has."""
    whole = path.read_bytes()
    made, at = whole[:8], 8
    while at < len(whole):
        length = struct.unpack(">I", whole[at : at + 4])[0]
        chunk = whole[at : at + 12 + length]
        if chunk[4:8] != b"tEXt":
            made += chunk
        at += 12 + length
        if chunk[4:8] == b"IHDR":
            body = b"tEXt" + b"sheetsplat\0" + text
            crc = struct.pack(">I", zlib.crc32(body)) if check is None else check
            made += (struct.pack(">I", len(body) - 4) + body + crc) * times
    path.write_bytes(made)


@pytest.mark.parametrize("name", CHANGES)
def test_changed_metadata_is_refused_by_its_key(picture, volume, tmp_path, name):
    path, plain = picture
    changed, key = CHANGES[name]
    rewrite(path, json.dumps(changed(plain)).encode())
    with pytest.raises(ss.InvalidInput) as caught:
        Recipe.read(path)
    assert key in str(caught.value) and "description in the picture" in str(caught.value)
    assert len(str(caught.value)) < 1000
    if name in ("mode", "size 0", "unknown key"):
        run("render", path, volume, "-o", tmp_path / "out.png", code=1)
        assert not (tmp_path / "out.png").exists()


TEXTS = {
    "empty": b"",
    "no JSON": b"{'format': 1}",
    "cut off": b'{"format": 1, "vers',
    "deep": b"[" * 100_000,
    "nested": b'{"format": ' + b"[" * 40 + b"]" * 40 + b"}",
    "NaN": b'{"format": NaN}',
    "infinity": b'{"format": 1e999}',
    "many digits": b'{"format": ' + b"9" * 100_000 + b"}",
    "twice": b'{"format": 1, "format": 1}',
    "a number": b"17",
    "bytes": bytes(range(128, 256)),
    "code": b"__import__('os').system('true')",
}


@pytest.mark.parametrize("name", TEXTS)
def test_other_texts_are_refused(picture, name):
    rewrite(picture[0], TEXTS[name])
    with pytest.raises(ss.InvalidInput, match="description in the picture cannot be used"):
        Recipe.read(picture[0])


def test_unchanged_metadata_is_taken(picture):
    """The control of the tests above."""
    path, plain = picture
    rewrite(path, json.dumps(plain).encode())
    assert Recipe.read(path).size == (20, 16)


def test_pictures_of_earlier_versions_are_read(picture):
    """Before fields had a boundary, a base and a trim, and cameras a shift."""
    path, plain = picture
    field = plain["fields"][0]
    del field["trim"], field["options"]["boundary"], field["options"]["base"]
    view = {"maker": "perspective", "eye": [0, 0, 9], "target": [0, 0, 0], "up": [0, 1, 0], "fov_y": 30, "near": 0.1}
    rewrite(path, json.dumps({**plain, "camera": view}).encode())
    found = Recipe.read(path)
    assert found.fields[0].options["boundary"] == "zero" and found.fields[0].options["base"] == 0.0
    assert not found.fields[0].trim and found.camera.shift == (0.0, 0.0)


def test_damaged_files_are_refused(picture, tmp_path):
    path, plain = picture
    text = json.dumps(plain).encode()
    whole = path.read_bytes()
    for count in (10, 30, 45, 200, len(whole) // 2, len(whole) - 5):
        (tmp_path / "cut.png").write_bytes(whole[:count])
        with pytest.raises(ss.InvalidInput):
            Recipe.read(tmp_path / "cut.png")
    rewrite(path, text, check=b"abcd")
    with pytest.raises(ss.InvalidInput, match="checksum"):
        Recipe.read(path)
    rewrite(path, text, times=2)
    with pytest.raises(ss.InvalidInput, match="two texts"):
        Recipe.read(path)
    rewrite(path, b" " * (LONGEST + 1))
    with pytest.raises(ss.InvalidInput, match=f"at most {LONGEST}"):
        Recipe.read(path)
    # A length that is far beyond the file is refused without memory for it.
    path.write_bytes(whole[:33] + struct.pack(">I", 2**31 - 1) + b"tEXtsheetsplat\0")
    with pytest.raises(ss.InvalidInput, match="at most"):
        Recipe.read(path)
    np.save(tmp_path / "a.npy", np.zeros(3))
    (tmp_path / "a.npy").rename(tmp_path / "b.png")
    with pytest.raises(ss.InvalidInput, match="another format"):
        Recipe.read(tmp_path / "b.png")


@pytest.mark.parametrize("text", [None, 5, b"{}", ["{}"]])
def test_a_recipe_of_no_text(text: Any) -> None:
    with pytest.raises(ss.InvalidInput, match="the description in the picture cannot be used"):
        ss.Recipe.from_json(text)


def test_one_file_stands_for_all_its_channels_and_arrays(tmp_path):
    rng = np.random.default_rng(2)
    channels, table = tmp_path / "channels.npy", tmp_path / "table.csv"
    np.save(channels, rng.integers(0, 200, (2, 8, 9, 10), np.uint8))
    np.savetxt(table, rng.random((20, 5)), delimiter=",", header="x,y,z,value,speed", comments="")
    for data, options in ((channels, {}), (table, {"color_by": "speed"})):
        image = ss.render(data, size=20, backend="cpu", **options)
        picture, again = tmp_path / "picture.png", tmp_path / "again.png"
        image.save(picture)
        run("render", picture, data, "-o", again)
        assert again.read_bytes() == picture.read_bytes()
    image = ss.render(channels, size=20, backend="cpu")
    assert np.array_equal(ss.SceneFile.of(image, channels).render().rgba, image.rgba)
    # Of two files neither stands for the other.
    ss.render([ss.open(table), ss.open(table)], size=20).save(picture)
    run("render", picture, table, "-o", again, code=2)
