"""Pictures to files: what is in them, and that nothing is left where it fails."""

from __future__ import annotations

import io
import os

import numpy as np
import pytest
from PIL import Image as PillowImage

import sheetsplat as ss
from sheetsplat.io import pictures


@pytest.fixture(scope="module")
def image(ball):
    return ss.render(ball, size=(24, 16), backend="reference", outputs=("depth", "coverage"))


@pytest.fixture(scope="module")
def xray(ball):
    return ss.render(ball, size=(24, 16), backend="reference", mode="xray", quality="draft")


def test_png_is_straight_alpha_of_eight_bits(tmp_path, image):
    image.save(tmp_path / "a.png")
    with PillowImage.open(tmp_path / "a.png") as found:
        levels = np.asarray(found)
        assert found.mode == "RGBA" and "gamma" not in found.info
    alpha = image.rgba[..., 3:]
    straight = np.divide(image.rgba[..., :3], alpha, out=np.zeros_like(image.rgba[..., :3]), where=alpha > 0)
    expected = np.concatenate([straight, alpha], axis=2).clip(0, 1) * 255
    shown = alpha[..., 0] * 255 >= 0.5
    assert np.abs(levels - expected)[shown].max() <= 0.51
    assert levels.shape == (16, 24, 4) and shown.any() and not shown.all()


def test_png_of_scalars_is_scaled_to_the_largest(tmp_path, xray):
    xray.save(tmp_path / "a.png")
    with PillowImage.open(tmp_path / "a.png") as found:
        levels = np.asarray(found.convert("L"))
    assert levels.max() == 255
    assert np.abs(levels - xray.scalar / xray.scalar.max() * 255).max() <= 1


@pytest.mark.parametrize("suffix", [".exr", ".npy"])
def test_floats_come_back_as_they_were(tmp_path, image, xray, suffix):
    for name, picture in (("color", image), ("scalar", xray)):
        path = tmp_path / f"{name}{suffix}"
        picture.save(path)
        assert np.array_equal(pictures.read_picture(path), picture.pixels)
    pictures.save_channel(image.depth, tmp_path / f"depth{suffix}")
    assert np.array_equal(pictures.read_picture(tmp_path / f"depth{suffix}"), image.depth)


def test_png_comes_back_premultiplied(tmp_path, image):
    image.save(tmp_path / "a.png")
    found = pictures.read_picture(tmp_path / "a.png")
    assert np.abs(found - image.rgba.clip(0, 1)).max() < 1.1 / 255
    pictures.save_channel(image.depth, tmp_path / "d.png")
    assert pictures.read_picture(tmp_path / "d.png").shape == (16, 24)


def test_notebooks_get_a_png(image):
    with PillowImage.open(io.BytesIO(image._repr_png_())) as found:
        assert found.size == (24, 16)


@pytest.mark.parametrize("name", ["a.gif", "a", "a.PNGX", ".png"])
def test_other_suffixes_are_refused(tmp_path, image, name):
    with pytest.raises(ss.InvalidInput, match="suffix"):
        image.save(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [".png", ".exr", ".npy"])
def test_unwritable_places_leave_nothing(tmp_path, image, suffix):
    with pytest.raises(ss.Error, match="cannot be written"):
        image.save(tmp_path / "missing" / f"a{suffix}")
    folder = tmp_path / f"folder{suffix}"
    folder.mkdir()
    with pytest.raises(ss.Error, match="cannot be written"):
        image.save(folder)
    assert sorted(path.name for path in tmp_path.iterdir()) == [folder.name] and list(folder.iterdir()) == []
    if os.geteuid() != 0:
        locked = tmp_path / "locked"
        locked.mkdir(mode=0o500)
        with pytest.raises(ss.Error, match="cannot be written"):
            image.save(locked / f"a{suffix}")
        assert list(locked.iterdir()) == []


@pytest.mark.parametrize("suffix", [".png", ".exr", ".npy"])
def test_a_full_disk_leaves_the_old_file(tmp_path, suffix):
    """A limit on the size of files stands for the full disk; the writer runs in a process of its own."""
    import subprocess
    import sys

    path = tmp_path / f"a{suffix}"
    path.write_bytes(b"old")
    code = f"""
import resource, signal, sys
import numpy as np
import sheetsplat as ss
image = ss.render(np.random.default_rng(0).random((6, 6, 6)), size=(200, 200), backend="reference")
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
try:
    image.save({str(path)!r})
except ss.Error:
    sys.exit(7)
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == 7, result.stderr
    assert path.read_bytes() == b"old" and list(tmp_path.iterdir()) == [path]


def test_files_have_the_usual_rights(tmp_path, image):
    (tmp_path / "plain").write_bytes(b"")
    for suffix in (".png", ".exr", ".npy"):
        image.save(tmp_path / f"a{suffix}")
        assert (tmp_path / f"a{suffix}").stat().st_mode == (tmp_path / "plain").stat().st_mode


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.png", b""),
        ("a.png", b"\x89PNG\r\n\x1a\nrest"),
        ("a.exr", b"\x76\x2f\x31\x01rest"),
        ("a.exr", b""),
        ("a.npy", b"\x93NUMPY"),
        ("a.npy", b""),
        ("a.txt", b"text"),
    ],
)
def test_damaged_pictures_are_refused(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ss.InvalidInput, match="cannot be read"):
        pictures.read_picture(tmp_path / name)


def test_arrays_that_are_no_pictures_are_refused(tmp_path):
    for array in (np.zeros((3, 4, 5)), np.zeros(3), np.zeros((0, 4)), np.zeros((2, 2), complex)):
        np.save(tmp_path / "a.npy", array)
        with pytest.raises(ss.InvalidInput, match="cannot be read"):
            pictures.read_picture(tmp_path / "a.npy")
    np.save(tmp_path / "a.npy", np.full((2, 2), None), allow_pickle=True)
    with pytest.raises(ss.InvalidInput, match="cannot be read"):
        pictures.read_picture(tmp_path / "a.npy")
    with pytest.raises(ss.InvalidInput, match="no such file"):
        pictures.read_picture(tmp_path / "b.npy")
