"""Films, the command line and the viewer of data in bricks."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from bricked_volumes import ROUNDING, rmse

import sheetsplat as ss
from sheetsplat import api
from sheetsplat.bricks.resident import residents


@pytest.mark.slow
def test_a_film_is_drawn_by_all_workers(cluster, samples, tmp_path):
    bricked = ss.open_bricks(samples, brick=24, client=cluster, quality="draft")
    film = ss.turntable(bricked, frames=3, size=(40, 30), quality="draft", client=cluster)
    film.save(tmp_path / "film")
    names = sorted(one.name for one in (tmp_path / "film").iterdir())
    assert names == ["frame_0000.png", "frame_0001.png", "frame_0002.png"]
    before = {name: (tmp_path / "film" / name).read_bytes() for name in names}
    (tmp_path / "film" / names[1]).unlink()
    film.save(tmp_path / "film")
    assert {name: (tmp_path / "film" / name).read_bytes() for name in names} == before
    alone = ss.turntable(ss.RegularField(samples), frames=3, size=(40, 30), quality="draft", backend="cpu")
    assert rmse(film[1], alone[1]) <= ROUNDING


@pytest.mark.slow
def test_processes_draw_frames_of_data_in_bricks(samples, tmp_path):
    film = ss.turntable(ss.open_bricks(samples, brick=24, quality="draft"), frames=2, size=(40, 30), quality="draft")
    film.save(tmp_path / "here")
    film.save(tmp_path / "there", workers=2)
    for one in sorted((tmp_path / "here").iterdir()):
        assert one.read_bytes() == (tmp_path / "there" / one.name).read_bytes()


def bricks_read():
    """Return how many bricks a worker has read."""

    return residents().counts.reads


@pytest.mark.slow
def test_workers_that_keep_all_of_the_data_draw_frames_of_their_own(cluster, samples, tmp_path, monkeypatch):
    from sheetsplat.bricks import cluster as module

    # No other test has read these.
    bricked = ss.open_bricks(samples[::-1].copy(), brick=16, client=cluster, quality="draft")
    film = ss.turntable(bricked, frames=4, size=(40, 30), quality="draft", client=cluster)
    assert module.frames_side_by_side(cluster, bricked) == 2
    before = cluster.run(bricks_read)
    film.save(tmp_path / "alone")
    # Both workers drew frames, and read the bricks that the other had.
    assert all(count > before[worker] for worker, count in cluster.run(bricks_read).items())
    # Where a worker has too little memory all draw each frame, and the pictures are the same.
    monkeypatch.setattr(module, "_ALL_OF_IT", 1e-9)
    assert module.frames_side_by_side(cluster, bricked) == 0
    film.save(tmp_path / "together")
    for one in sorted((tmp_path / "alone").iterdir()):
        assert one.read_bytes() == (tmp_path / "together" / one.name).read_bytes()


@pytest.mark.slow
def test_a_task_draws_several_frames_that_take_little_time(cluster, samples, tmp_path):
    bricked = ss.open_bricks(samples, brick=64, client=cluster, quality="draft")
    film = ss.turntable(bricked, frames=60, size=(40, 30), quality="draft", client=cluster)
    keys, shares = set(), []

    def look(share):
        shares.append(share)
        keys.update(cluster.futures)

    film.save(tmp_path / "film", progress=look)
    tasks = {str(key) for key in keys if str(key).startswith("render-frames-")}
    # Alone at first, until it is known what they take, and at the end, where all workers shall end together.
    assert 8 <= len(tasks) <= 40
    assert shares == sorted(shares) and shares[-1] == 1.0
    film.save(tmp_path / "here", workers=1)
    for one in sorted((tmp_path / "here").iterdir()):
        assert one.read_bytes() == (tmp_path / "film" / one.name).read_bytes()


@pytest.mark.slow
def test_a_film_that_is_given_up_leaves_the_workers_idle(cluster, samples, tmp_path):
    bricked = ss.open_bricks(samples, brick=64, client=cluster, quality="draft")
    # Each frame takes some 0.1 s, and a task has many.
    film = ss.turntable(bricked, frames=400, size=(300, 300), quality="good", client=cluster, threads=1)

    def seconds_until_idle(folder):
        began = time.monotonic()
        # In the midst of a task.
        with pytest.raises(ss.Cancelled):
            film.save(folder, progress=lambda share: time.monotonic() - began < 1.5)
        stopped = time.monotonic()
        while any(cluster.processing().values()) or any(cluster.run(busy).values()):
            assert time.monotonic() - stopped < 20.0
            time.sleep(0.02)
        return time.monotonic() - began - 1.5

    # A busy machine may take longer now and then.
    assert any(seconds_until_idle(tmp_path / f"film{turn}") < 1.0 for turn in range(3))


def busy(dask_worker):
    """Return how many tasks a worker runs."""
    return dask_worker.state.executing_count


def test_frames_before_one_that_cannot_be_drawn_are_handed_over(samples):
    from sheetsplat.animation.drawing import Task, draw_elsewhere, settings_of
    from sheetsplat.animation.sources import OneScene

    made = api.prepare(samples, size=(6, 4), quality="draft", backend="cpu")
    settings = settings_of(made.renderer)
    sizes = [(6, 4), (6, 4), (0, 4), (6, 4)]
    tasks = [Task(number, made.camera, size, settings, "rgb") for number, size in enumerate(sizes)]
    frames = draw_elsewhere(OneScene(made.scene), tasks).drawn()
    assert [len(next(frames).content) for _ in range(2)] == [72, 72]
    with pytest.raises(ss.InvalidInput):
        next(frames)


@pytest.mark.slow
def test_the_command_line_draws_in_bricks(samples, tmp_path):
    from click.testing import CliRunner

    from sheetsplat.cli.main import main

    np.save(tmp_path / "v.npy", samples)
    for name, options in (("whole", []), ("bricks", ["--brick", "16"])):
        command = ["render", str(tmp_path / "v.npy"), "-o", str(tmp_path / f"{name}.npy"), "--size", "60", *options]
        command += ["--slice-spacing", "0.5"]
        result = CliRunner().invoke(main, command)
        assert result.exit_code == 0, result.output
    one, other = np.load(tmp_path / "whole.npy"), np.load(tmp_path / "bricks.npy")
    assert np.sqrt(np.mean((one.astype(np.float64) - other) ** 2)) <= ROUNDING
    both = ["--workers", "2", "--scheduler", "tcp://127.0.0.1:9"]
    refused = CliRunner().invoke(main, ["render", str(tmp_path / "v.npy"), "-o", str(tmp_path / "x.png"), *both])
    assert refused.exit_code == 2 and "leave out one" in refused.output


@pytest.mark.slow
def test_the_command_line_films_in_bricks(samples, tmp_path, cluster):
    from click.testing import CliRunner

    from sheetsplat.cli.main import main

    np.save(tmp_path / "v.npy", samples)
    (tmp_path / "v.raw").write_bytes(samples.tobytes())
    turn = ["turntable", str(tmp_path / "v.raw"), "--shape", "41,46,37", "--dtype", "uint8", "--frames", "2"]
    turn += ["--size", "40x30", "--quality", "draft", "--backend", "cpu"]
    address = ["--scheduler", cluster.scheduler.address]
    for name, options in (("whole", []), ("here", ["--brick", "24"]), ("cluster", ["--brick", "24", *address])):
        result = CliRunner().invoke(main, [*turn, "-o", str(tmp_path / name), *options])
        assert result.exit_code == 0, result.output
    pictures = {name: read_frame(tmp_path / name / "frame_0001.png") for name in ("whole", "here", "cluster")}
    np.testing.assert_allclose(pictures["here"], pictures["whole"], atol=1)
    np.testing.assert_array_equal(pictures["here"], pictures["cluster"])
    key = str(tmp_path / "whole" / "frame_0001.png")
    flight = ["animate", str(tmp_path / "v.npy"), "-o", str(tmp_path / "flight"), "--frames", "1", "--key", key]
    flight += ["--brick", "24", "--size", "40x30", "--quality", "draft", *address]
    result = CliRunner().invoke(main, flight)
    assert result.exit_code == 0, result.output
    np.testing.assert_allclose(read_frame(tmp_path / "flight" / "frame_0000.png"), pictures["whole"], atol=1)


@pytest.mark.slow
def test_a_command_says_of_damaged_data_one_line(samples, tmp_path):
    pytest.importorskip("distributed")
    zarr = pytest.importorskip("zarr")
    array = zarr.create_array(tmp_path / "v.zarr", shape=samples.shape, chunks=(16, 16, 16), dtype=samples.dtype)
    array[:] = samples
    (tmp_path / "v.zarr" / "c" / "1" / "1" / "1").write_bytes(b"nothing")
    command = [sys.executable, "-m", "sheetsplat", "render", str(tmp_path / "v.zarr"), "-o", str(tmp_path / "x.png")]
    command += ["--workers", "1", "--brick", "16"]
    told = [subprocess.run([*command, *more], capture_output=True, text=True, timeout=120) for more in ([], ["-v"])]
    assert [one.returncode for one in told] == [1, 1]
    (line,) = told[0].stderr.splitlines()
    assert line.startswith("sheetsplat: brick ") and "c/1/1/1" in line
    # What the processes say themselves.
    assert len(told[1].stderr.splitlines()) > 5


@pytest.mark.slow
@pytest.mark.usefixtures("ctrl_c")
def test_a_viewer_with_workers_ends_quietly(samples, tmp_path):
    pytest.importorskip("distributed")
    np.save(tmp_path / "v.npy", samples)
    command = [sys.executable, "-m", "sheetsplat", "view", str(tmp_path / "v.npy"), "--brick", "24", "--workers", "2"]
    with subprocess.Popen(
        [*command, "--no-browser"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as viewer:
        try:
            assert viewer.stdout is not None and viewer.stdout.readline().startswith("http://127.0.0.1:")
            assert viewer.stderr is not None and "Ctrl-C" in viewer.stderr.readline()
            # It is told just before the viewer waits. A terminal sends it to the workers, too.
            time.sleep(0.5)
            os.killpg(viewer.pid, signal.SIGINT)
            _, told = viewer.communicate(timeout=60)
        finally:
            if viewer.poll() is None:
                os.killpg(viewer.pid, signal.SIGKILL)
    assert viewer.returncode == 0 and "Traceback" not in told, told


def profiling():
    """Return whether a process looks where its threads are."""
    import dask

    return dask.config.get("distributed.worker.profile.enabled", True)


@pytest.mark.slow
def test_processes_of_a_command_look_after_themselves_less(cluster):
    from sheetsplat.cli.cluster import started

    before = profiling()
    with started(1) as own:
        assert list(own.run(profiling).values()) == [False]
        # Those of others are as they were set.
        assert set(cluster.run(profiling).values()) == {before}
    assert profiling() == before is True


def read_frame(path):
    """Return the numbers of a picture, int (h, w, 4)."""
    from PIL import Image

    return np.asarray(Image.open(path)).astype(int)


def test_films_in_bricks_refuse_what_they_cannot_be(samples, tmp_path):
    from click.testing import CliRunner

    from sheetsplat.cli.main import main

    np.save(tmp_path / "v.npy", samples)
    (tmp_path / "scene.toml").write_text("")
    volume, film = str(tmp_path / "v.npy"), ["-o", str(tmp_path / "film"), "--brick", "16"]
    for command, words in (
        (["animate", volume, volume, *film], "time series"),
        (["animate", volume, *film], "give --frames"),
        (["turntable", volume, *film, "--workers", "2", "--scheduler", "tcp://127.0.0.1:9"], "leave out one"),
        (["turntable", str(tmp_path / "scene.toml"), *film], "files of data"),
        (["turntable", volume, *film, "--brick", "2"], "--brick"),
    ):
        refused = CliRunner().invoke(main, command)
        assert refused.exit_code == 2 and words in refused.output, refused.output


def test_films_tell_how_long_they_go_on(samples, tmp_path, caplog):
    with caplog.at_level("INFO", "sheetsplat"):
        ss.turntable(samples, frames=2, size=16, quality="draft").save(tmp_path / "film")
    told = [one.getMessage() for one in caplog.records if "frames" in one.getMessage()]
    assert len(told) == 2 and told[0].startswith("1 of 2 frames, ") and told[1] == "2 of 2 frames, 0:00 left"
