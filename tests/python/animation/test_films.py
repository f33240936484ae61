"""Films: one look for all frames, whole files or none, folders that go on where they stopped."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from PIL import Image as PillowImage
from PIL import ImageSequence

import sheetsplat as ss

SMALL = {"size": (16, 12), "backend": "reference"}
TINY = {"size": 8, "backend": "reference", "shading": False, "quality": "draft"}


def png_bytes(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


# ---------------------------------------------------------------------------------------------------------- turntables


def test_a_turntable_turns_about_the_data_and_cuts_nothing_off(ball):
    film = ss.turntable(ball, frames=8, **SMALL)
    assert len(film) == 8 and film.size == (16, 12)
    first = film.cameras[0]
    for n, camera in enumerate(film.cameras):
        assert camera.target == first.target and camera.height == first.height
        angle = np.subtract(camera.eye, camera.target) @ np.subtract(first.eye, first.target)
        rise = np.subtract(first.eye, first.target)[2]
        radius = math.hypot(*np.subtract(first.eye, first.target)[:2])
        assert angle == pytest.approx(rise**2 + radius**2 * math.cos(2 * math.pi * n / 8))
    shown = np.array([np.asarray(image)[..., 3] for image in film])
    assert shown[:, 6, 8].min() > 0.3
    # Nothing is at the border, and much of the height is filled.
    assert max(shown[:, (0, -1)].max(), shown[..., (0, -1)].max()) < 0.25 * shown.max()
    assert (shown.max(axis=(0, 2)) > 0.05).sum() >= 9


def test_a_turn_is_to_the_right_as_azimuth_is(ball):
    camera = ss.Camera.orthographic((30, 8, 6), (9, 8, 6), (0, 0, 1), height=20)
    film = ss.turntable(ball, frames=4, camera=camera, **SMALL)
    assert film.cameras[0] == camera
    assert np.allclose(film.cameras[1].eye, (9, 29, 6))
    half = ss.turntable(ball, frames=3, degrees=-90, axis="x", camera=camera, **SMALL)
    assert np.allclose(half.cameras[2].up, (0, 1, 0))
    assert np.allclose(half.cameras[2].eye, camera.eye)


def test_perspective_and_zoom(ball):
    options = {"frames": 2, "projection": "perspective", **SMALL}
    plain, near = (ss.turntable(ball, zoom=zoom, **options) for zoom in (1.0, 2.0))
    assert plain.cameras[0].eye == near.cameras[0].eye
    assert near.cameras[0].fov_y < plain.cameras[0].fov_y == 30.0


def test_what_a_renderer_chooses_is_chosen_once(ball):
    film = ss.turntable(ball, frames=2, size=8, max_error=0.05, backend="cpu")
    assert film.renderer.max_error is None and film.renderer.settings["backend"] == "cpu"
    assert {image.recipe.options["slice_spacing"] for image in film} == {film[0].recipe.options["slice_spacing"]}
    assert film[0].settings is None


# ---------------------------------------------------------------------------------------------------------- key frames


def test_a_path_around_one_target_keeps_its_distance():
    keys = [ss.Camera.orthographic(eye, (0, 0, 0), (0, 0, 1), height=2) for eye in ((9, 0, 0), (0, 9, 0), (-9, 0, 0))]
    path = ss.CameraPath([*keys, ss.Camera.orthographic((0, -9, 0), (0, 0, 0), (0, 0, 1), height=2)], closed=True)
    cameras = path.cameras(16)
    assert [cameras[n] for n in (0, 4, 8)] == keys
    for n, camera in enumerate(cameras):
        angle = 2 * math.pi * n / 16
        assert np.allclose(camera.eye, (9 * math.cos(angle), 9 * math.sin(angle), 0), atol=0.02)
        assert camera.target == (0, 0, 0) and camera.height == pytest.approx(2)


def test_paths_are_smooth_in_position_and_direction():
    rng = np.random.default_rng(5)
    eyes = np.cumsum(rng.normal(size=(5, 3)), axis=0)
    keys = [
        ss.Camera.perspective(eye, eye + rng.normal(size=3), (0, 0, 1), fov_y=20 + 8 * n) for n, eye in enumerate(eyes)
    ]
    path = ss.CameraPath(keys, times=[0, 1, 3, 4, 6])
    fine = path.cameras(601)
    assert fine[0] == keys[0] and fine[-1] == keys[-1] and fine[100] == keys[1]
    for values in (
        np.array([one.eye for one in fine]),
        np.array([one.world_axes()[2] for one in fine]),
        np.array([one.world_axes()[1] for one in fine]),
    ):
        speed = np.diff(values, axis=0)
        # Without jumps of position or of speed, at keys too: a polyline through the keys fails the second.
        assert np.abs(speed).max() < 0.06
        assert np.abs(np.diff(speed, axis=0)).max() < 0.002
    corner = np.diff(np.diff(np.interp(np.linspace(0, 6, 601), [0, 1, 3, 4, 6], eyes[:, 0])))
    assert np.abs(corner).max() > 0.002
    assert all(20 - 1e-9 <= one.fov_y <= 52 + 1e-9 for one in fine)


def test_paths_that_cannot_be():
    one = ss.Camera.orthographic((1, 0, 0), (0, 0, 0), (0, 0, 1), height=1)
    other = ss.Camera.perspective((1, 0, 0), (0, 0, 0), (0, 0, 1), fov_y=30)
    for keys, options in (
        ([one], {}),
        ([], {}),
        ([one, other], {}),
        ([one, "x"], {}),
        (one, {}),
        ([one, one], {"times": [1, 1]}),
        ([one, one], {"times": [0, math.nan]}),
        ([one, one], {"times": [0, 1], "closed": True}),
    ):
        with pytest.raises(ss.InvalidInput):
            ss.CameraPath(keys, **options)
    path = ss.CameraPath([one, one])
    assert path.at(0.3).eye == pytest.approx(one.eye)
    with pytest.raises(ss.InvalidInput):
        path.at(1.1)


# --------------------------------------------------------------------------------------------------------- time series


def growing(ball, count=4):
    return [(ball * (n + 1) / count).astype(np.float32) for n in range(count)]


def test_a_series_has_one_look(ball, tmp_path):
    steps = growing(ball)
    film = ss.animate(steps, **SMALL)
    images = list(film)
    assert len(images) == 4
    assert len({image.clim for image in images}) == len({image.camera for image in images}) == 1
    assert len({image.recipe.options["slice_spacing"] for image in images}) == 1
    # Brighter from step to step, which looks of their own would not show.
    opacities = [float(np.asarray(image)[..., 3].sum()) for image in images]
    assert all(a < b for a, b in zip(opacities, opacities[1:], strict=False))
    alone = [float(np.asarray(ss.render(one, **SMALL))[..., 3].sum()) for one in steps]
    assert max(alone) < 1.2 * min(alone) and opacities[-1] > 2 * opacities[0]
    # The same from files and from an array with a time axis.
    paths = [tmp_path / f"step{n}.npy" for n in range(4)]
    for path, step in zip(paths, steps, strict=True):
        np.save(path, step)
    for other in (ss.animate(paths, **SMALL), ss.animate(np.array(steps), **SMALL)):
        assert all(np.array_equal(a.pixels, b.pixels) for a, b in zip(images, other, strict=True))


def test_the_time_axis_of_xarray(ball):
    xarray = pytest.importorskip("xarray")
    data = xarray.DataArray(np.array(growing(ball)), dims=("time", "z", "y", "x"), name="density")
    film = ss.animate(data.transpose("z", "time", "y", "x"), **SMALL)
    assert len(film) == 4
    wanted = ss.animate(growing(ball), **SMALL)
    assert np.array_equal(film[2].pixels, wanted[2].pixels)
    assert len(ss.animate(data.to_dataset(), 8, **SMALL)) == 8
    renamed = xarray.DataArray(np.zeros((2, 2, 2, 2, 2)))
    with pytest.raises(ss.InvalidInput, match="time"):
        ss.animate(renamed, **SMALL)


@pytest.mark.parametrize("engine", ["scipy", "h5netcdf"])
def test_the_time_axis_of_a_netcdf_file(ball, tmp_path, engine):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip(engine)
    data = xarray.DataArray(np.array(growing(ball)), dims=("time", "z", "y", "x"), name="density")
    path = tmp_path / "a.nc"
    data.transpose("z", "time", "y", "x").to_netcdf(path, engine=engine)
    film, wanted = ss.animate(path, **SMALL), ss.animate(growing(ball), **SMALL)
    assert len(film) == 4
    assert all(np.array_equal(a.pixels, b.pixels) for a, b in zip(film, wanted, strict=True))
    assert len(ss.animate(f"{path}:/density", 8, **SMALL)) == 8
    # A step by itself, and files without steps.
    assert np.array_equal(ss.open(path, step=2).values, growing(ball)[2])
    assert len(ss.animate(path, 5, step=1, **SMALL)) == 5
    for options, text in (({}, "4 time steps; wanted one; pass step=0"), ({"step": 4}, "no step 4 of 4")):
        with pytest.raises(ss.InvalidInput, match=text) as found:
            ss.open(path, **options)
        assert found.value.option == "step"
    np.save(tmp_path / "a.npy", ball)
    with pytest.raises(ss.InvalidInput, match="step for a file of format npy"):
        ss.open(tmp_path / "a.npy", step=0)
    # Frames in a folder say of which step they are.
    film.save(tmp_path / "film")
    made = {one.name: one.stat().st_mtime_ns for one in (tmp_path / "film").iterdir()}
    ss.animate(path, **SMALL).save(tmp_path / "film")
    assert made == {one.name: one.stat().st_mtime_ns for one in (tmp_path / "film").iterdir()}


def test_steps_are_spread_over_the_frames_while_the_camera_moves(ball):
    keys = [ss.Camera.orthographic(eye, (9, 8, 6), (0, 0, 1), height=20) for eye in ((40, 8, 6), (9, 40, 6))]
    steps = growing(ball, 2)
    film = ss.animate(steps, 6, camera=keys, **SMALL)
    assert film.cameras[0] == keys[0] and film.cameras[5] == keys[1]
    assert [image.recipe.transfer_functions for image in film] == [film[0].recipe.transfer_functions] * 6
    fixed = ss.animate(steps, camera=keys[0], **SMALL)
    assert np.array_equal(film[0].pixels, fixed[0].pixels)
    still = ss.animate(ball, 3, camera=keys, **SMALL)
    assert len(still) == 3 and len(still[1:]) == 2


def test_scattered_steps_and_decades(rng):
    steps = [
        ss.EllipsoidField(rng.normal(n, 1, (60, 3)), 0.4 + 0.1 * rng.random(60), values=rng.random(60))
        for n in range(3)
    ]
    film = ss.animate(steps, **SMALL)
    assert len({image.clim for image in film}) == 1
    assert all(np.asarray(image)[..., 3].max() > 0.05 for image in film)
    wide = [np.exp(rng.normal(0, 4, (6, 6, 6))) * 10.0**n for n in range(2)]
    floors = {image.recipe.fields[0].quantity.floor for image in ss.animate(wide, **SMALL)}
    assert len(floors) == 1


def test_functions_return_data_scenes_or_pictures(ball):
    steps = growing(ball)
    by_function = ss.animate(lambda n: steps[n], 4, **SMALL)
    assert np.array_equal(by_function[3].pixels, ss.animate(steps, **SMALL)[3].pixels)
    pictures = ss.animate(lambda n: ss.render(ball, azimuth=90 * n, **SMALL), 4, fps=5)
    assert pictures[2] == ss.render(ball, azimuth=180, **SMALL)
    field = ss.RegularField(ball)
    scenes = ss.animate(lambda n: ss.Scene(field, [(0, 1, 1, 1, 0), (1 + n, 1, 1, 1, 1)]), 2, **SMALL)
    assert scenes[0].clim == (0, 1) and scenes[1].clim == (0, 2)
    with pytest.raises(ss.InvalidInput, match="cmap"):
        ss.animate(lambda n: ss.render(ball, **SMALL), 2, cmap="gray")


# --------------------------------------------------------------------------------------------------------------- files


def decoded(path: Path) -> np.ndarray:
    """Return the frames of a video, one after the other."""
    if path.suffix == ".gif":
        with PillowImage.open(path) as film:
            return np.array([np.asarray(one.convert("RGB")) for one in ImageSequence.Iterator(film)])
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    command = [ffmpeg, "-loglevel", "error", "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run(command, capture_output=True, check=True, timeout=60)
    return np.frombuffer(done.stdout, np.uint8)


@pytest.mark.parametrize("suffix", [".mp4", ".webm", ".gif"])
def test_videos_show_the_frames(ball, tmp_path, suffix):
    pytest.importorskip("imageio_ffmpeg")
    film = ss.turntable(ball, frames=3, size=(33, 31), background="#204060", backend="reference", cmap="magma")
    path = tmp_path / f"film{suffix}"
    shares: list[float] = []
    film.save(path, progress=shares.append)
    assert list(tmp_path.iterdir()) == [path] and path.stat().st_mode & 0o777 == 0o666 & ~umask()
    assert shares == sorted(shares) and shares[-1] == 1.0
    # H.264 and VP9 have even numbers of pixels.
    height, width = (31, 33) if suffix == ".gif" else (32, 34)
    shown = decoded(path).reshape(-1, height, width, 3)[:, :31, :33].astype(float)
    wanted = np.array([np.asarray(image, dtype=np.uint8)[..., :3] for image in film], float)
    assert len(shown) == 3
    assert np.abs(shown[:, :4, :4] - (32, 64, 96)).max() < 12
    assert np.sqrt(np.mean((shown - wanted) ** 2)) < 14
    before = path.read_bytes()
    film.save(path)
    assert path.read_bytes() == before


def umask() -> int:
    found = os.umask(0)
    os.umask(found)
    return found


def test_a_folder_goes_on_where_it_stopped(ball, tmp_path):
    whole, parted = tmp_path / "whole", tmp_path / "parted"
    ss.turntable(ball, frames=4, **SMALL).save(whole)
    assert list(png_bytes(whole)) == [f"frame_000{n}.png" for n in range(4)]
    film = ss.turntable(ball, frames=4, **SMALL)
    seen: list[float] = []
    with pytest.raises(ss.Cancelled):
        film.save(parted, progress=lambda share: not (seen.append(share) or share >= 0.5))
    assert 1 <= len(png_bytes(parted)) <= 2
    (parted / ".0123456789abcdef.png").write_bytes(b"left by a film that was killed")
    kept = {name: (parted / name).stat().st_mtime_ns for name in png_bytes(parted) if name.startswith("frame")}
    film.save(parted)
    assert png_bytes(parted) == png_bytes(whole)
    assert {name: (parted / name).stat().st_mtime_ns for name in kept} == kept
    assert ss.Recipe.read(parted / "frame_0002.png").camera == film.cameras[2]


def test_other_films_and_foreign_files_are_not_touched(ball, tmp_path):
    folder = tmp_path / "film"
    film = ss.turntable(ball, frames=2, **TINY)
    film.save(folder)
    before = png_bytes(folder)
    others = [
        ss.turntable(ball, frames=3, **TINY),
        ss.turntable(ball, frames=1, **TINY),
        ss.turntable(ball * 0.9, frames=2, clim=(0, 1), opacity=0.3, **TINY),
        ss.turntable(ball, frames=2, cmap="gray", **TINY),
    ]
    for other in others:
        with pytest.raises(ss.InvalidInput, match="another film"):
            other.save(folder)
        assert png_bytes(folder) == before
    # The same options and another array: only the data tell.
    first, second = (
        ss.turntable(data, frames=1, clim=(0, 1), opacity=0.5, zoom=1, **TINY) for data in (ball, ball + 0)
    )
    camera = first.cameras[0]
    same = {"frames": 1, "clim": (0, 1), "opacity": 0.5, "camera": camera, **TINY}
    one, two = tmp_path / "one", tmp_path / "two"
    ss.turntable(ball, **same).save(one)
    changed = ball.copy()
    changed[7, 7, 7] *= 0.5
    with pytest.raises(ss.InvalidInput, match="another film"):
        ss.turntable(changed, **same).save(one)
    ss.turntable(changed, **same).save(one, overwrite=True)
    ss.turntable(changed, **same).save(two)
    assert png_bytes(one) == png_bytes(two)
    assert second.cameras == first.cameras
    others[1].save(folder, overwrite=True)
    assert list(png_bytes(folder)) == ["frame_0000.png"]
    for name, make in (
        ("notes.txt", lambda path: path.write_text("mine")),
        ("frame_0001.png", lambda path: path.symlink_to(tmp_path / "two" / "frame_0000.png")),
        ("frame_0001.png", lambda path: path.mkdir()),
        ("frame_0000.png", lambda path: path.write_bytes(before["frame_0000.png"][:-20])),
        ("frame_0000.png", lambda path: path.write_bytes(b"")),
    ):
        foreign = tmp_path / f"foreign{len(list(tmp_path.iterdir()))}"
        foreign.mkdir()
        make(foreign / name)
        there = sorted(foreign.iterdir())
        with pytest.raises(ss.InvalidInput, match=name):
            film.save(foreign)
        assert sorted(foreign.iterdir()) == there


@pytest.mark.slow
def test_processes_and_executors_draw_the_same_frames(ball, tmp_path):
    film = ss.turntable(ball, frames=3, **SMALL)
    film.save(tmp_path / "here")
    film.save(tmp_path / "workers", workers=2)
    with ThreadPoolExecutor(2) as pool:
        film.save(tmp_path / "pool", client=pool)
    assert png_bytes(tmp_path / "here") == png_bytes(tmp_path / "workers") == png_bytes(tmp_path / "pool")


@pytest.mark.slow
def test_workers_read_files_and_hand_over_errors_and_warnings(ball, tmp_path):
    paths = [tmp_path / f"step{n}.npy" for n in range(3)]
    for path, step in zip(paths, growing(ball, 3), strict=True):
        np.save(path, step)
    film = ss.animate(paths, clim=(2, 3), opacity=0.5, **TINY)
    with pytest.warns(ss.PictureWarning, match="one colour|nothing can be seen"):
        film.save(tmp_path / "film", workers=2)
    paths[2].write_bytes(b"no array")
    with pytest.raises(ss.InvalidInput), pytest.warns(ss.PictureWarning):
        film.save(tmp_path / "other", workers=2)
    paths[2].unlink()
    with pytest.raises(ss.Error, match="step2"), pytest.warns(ss.PictureWarning):
        film.save(tmp_path / "third", workers=2)


FILM = """
import sys, numpy as np, sheetsplat as ss
k = np.mgrid[0:12, 0:12, 0:12]
ball = np.clip(1 - np.sqrt(((k - 5.5) ** 2).sum(axis=0)) / 6, 0, 1)
film = ss.turntable(ball, frames=40, size=24, backend="reference", quality="draft")
"""
SAVE = """
print("begun", flush=True)
film.save(sys.argv[1])
"""


@pytest.mark.slow
def test_a_film_that_is_killed_leaves_nothing_half_written(tmp_path):
    """At a moment that differs from run to run."""
    folder = tmp_path / "frames"
    rng = np.random.default_rng()
    for output, number in ((folder, signal.SIGKILL), (tmp_path / "film.mp4", signal.SIGKILL), (folder, signal.SIGTERM)):
        process = subprocess.Popen([sys.executable, "-c", FILM + SAVE, str(output)], stdout=subprocess.PIPE)
        assert process.stdout is not None and process.stdout.readline() == b"begun\n"
        time.sleep(float(rng.uniform(0.02, 0.4)))
        process.send_signal(number)
        process.wait(timeout=60)
        process.stdout.close()
    done = not (tmp_path / "film.mp4").exists() or len(decoded(tmp_path / "film.mp4")) == 40 * 24 * 24 * 3
    assert done and not [path for path in tmp_path.iterdir() if path.name not in ("frames", "film.mp4")]
    frames = {name: content for name, content in png_bytes(folder).items() if not name.startswith(".")}
    for name in frames:
        with PillowImage.open(folder / name) as picture:
            picture.load()
    names = {}
    exec(FILM, names)
    for output in (folder, tmp_path / "again"):
        names["film"].save(output)
    assert png_bytes(folder) == png_bytes(tmp_path / "again")
    assert frames.items() <= png_bytes(folder).items()


def test_what_cannot_be_written(ball, tmp_path, monkeypatch):
    film = ss.turntable(ball, frames=1, **TINY)
    for path, kind in (
        ("film.avi", ss.InvalidInput),
        ("", ss.InvalidInput),
        (3, ss.InvalidInput),
        ("a\0b", ss.InvalidInput),
        (tmp_path / "no" / "film.mp4", ss.Error),
        (tmp_path / "no" / "folder", ss.Error),
    ):
        with pytest.raises(kind):
            film.save(path)
    for options in ({"fps": 0}, {"fps": "x"}, {"workers": 0}, {"client": 3}, {"progress": 3}, {"overwrite": 1}):
        with pytest.raises(ss.InvalidInput):
            film.save(tmp_path / "film", **options)
    for options in ({"frames": 0}, {"frames": 1.5}, {"frames": 10**6}, {"axis": (0, 0, 0)}, {"degrees": math.inf}):
        with pytest.raises(ss.InvalidInput) as caught:
            ss.turntable(ball, **{**TINY, **options})
        assert caught.value.option in options
    for data, frames in (
        ([], None),
        (ball, None),
        (lambda n: ball, None),
        (3.5, 2),
        ([ball, [ss.RegularField(ball)] * 2], 2),
    ):
        with pytest.raises(ss.InvalidInput):
            list(ss.animate(data, frames, **TINY))
    with pytest.raises(ss.InvalidInput, match="did you mean frames"):
        ss.turntable(ball, frame=3)
    with pytest.raises(ss.InvalidInput, match="no frames"):
        film[0:0].save(tmp_path / "film.gif")
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(ss.Unsupported, match=r"sheetsplat\[video\]"):
        film.save(tmp_path / "film.mp4")
    assert "data:image/webp" in film._repr_html_()
    assert not list(tmp_path.iterdir())


def test_notebooks_show_a_video(ball):
    pytest.importorskip("imageio_ffmpeg")
    page = ss.turntable(ball, frames=2, **TINY)._repr_html_()
    assert page.startswith("<video controls") and "data:video/mp4;base64," in page


# -------------------------------------------------------------------------------------------------------- command line


def test_command_line(volume, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    small = ["--size", "8", "--backend", "reference", "--quality", "draft"]
    done = run("turntable", volume, "-o", "film", "--frames", "3", "--json", "--cmap", "magma", *small)
    report = json.loads(done.stdout)
    assert report["frames"] == 3 and report["size"] == [8, 8] and len(png_bytes(tmp_path / "film")) == 3
    (tmp_path / "scene.toml").write_text(f'format = 1\n[data]\nfile = "{volume.name}"\n[look]\ncmap = "magma"\n')
    run("turntable", "scene.toml", "-o", "again", "--frames", "3", *small)
    same = [ss.Recipe.read(tmp_path / name / "frame_0001.png") for name in ("film", "again")]
    assert same[0] == same[1]
    np.save("second.npy", np.load(volume) // 2)
    run("animate", volume, "second.npy", "-o", "series", *small)
    assert len(png_bytes(tmp_path / "series")) == 2
    keys = [part for number in (0, 2) for part in ("--key", f"film/frame_000{number}.png")]
    run("animate", volume, "-o", "flight", "--frames", "3", *keys, *small)
    first = ss.Recipe.read(tmp_path / "flight" / "frame_0000.png").camera
    assert first == ss.Recipe.read(tmp_path / "film" / "frame_0000.png").camera
    assert "--frames" in run("animate", volume, "-o", "x", code=2).output
    assert "another film" in run("turntable", volume, "-o", "film", "--frames", "2", *small, code=1).output
    assert "suffix" in run("turntable", volume, "-o", "film.avi", *small, code=1).output
    both = ["--scheduler", "tcp://127.0.0.1:1", "--workers", "2"]
    assert "--workers" in run("turntable", volume, "-o", "x", *both, *small, code=2).output
    monkeypatch.setitem(sys.modules, "distributed", None)
    wanted = "sheetsplat[distributed]"
    assert wanted in run("turntable", volume, "-o", "x", *both[:2], *small, code=1).output
