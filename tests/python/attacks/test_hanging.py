"""Workers that hang: others draw their bricks, or an error names them; and whoever waits is asked meanwhile."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import sheetsplat as ss

SMALL = {"size": (48, 40), "quality": "draft"}


@contextmanager
def cluster_of(count):
    """Yield a client of some processes, and their ids by address."""
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=count, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
        ) as made,
        distributed.Client(made, set_as_default=False) as client,
    ):
        yield client, client.run(os.getpid)


@contextmanager
def stopped(pid):
    """Let a process hang meanwhile."""
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)


def give_up_after(seconds):
    """Return a callback that gives up, and a list of when it did."""
    began, ended = time.monotonic(), []

    def progress(_share):
        if time.monotonic() - began > seconds:
            ended.append(time.monotonic())
            return False
        return None

    return progress, ended


def seconds_to_give_up(function):
    """Return how long a function goes on after its callback has returned False."""
    progress, ended = give_up_after(0.5)
    with pytest.raises(ss.Cancelled):
        function(progress)
    return time.monotonic() - ended[0]


def test_bricks_of_a_worker_that_hangs_are_drawn_by_another(samples):
    alone = ss.render(ss.open_bricks(samples, brick=16, quality="draft"), **SMALL)
    with cluster_of(2) as (client, pids):
        bricked = ss.open_bricks(samples, brick=16, client=client, quality="draft")
        with stopped(min(pids.values())):
            # All that waits for it gives up at once where that is wanted.
            assert seconds_to_give_up(lambda told: ss.render(bricked, client=client, progress=told, **SMALL)) < 2.0
            began = time.monotonic()
            drawn = ss.render(bricked, client=client, worker_timeout=3.0, **SMALL)
            assert time.monotonic() - began < 10.0
            np.testing.assert_array_equal(drawn.pixels, alone.pixels)
            # It is not waited for any more.
            began = time.monotonic()
            ss.render(bricked, client=client, **SMALL)
            ss.open_bricks(samples[:20], brick=16, client=client, quality="draft")
            assert time.monotonic() - began < 5.0
            # Another process takes its place.
            client.wait_for_workers(2, timeout=30)
            assert len(set(client.run(os.getpid).values()) - set(pids.values())) == 1


def test_the_only_worker_that_hangs_is_named(samples, tmp_path):
    large = np.tile(samples, (4, 4, 4))
    with cluster_of(1) as (client, pids):
        ((address, pid),) = pids.items()
        bricked = ss.open_bricks(samples, brick=16, client=client, quality="draft")
        with stopped(pid):
            places = np.full((4, 3), 9.0)
            for call in (
                lambda told: ss.open_bricks(samples[:20], brick=16, client=client, levels=1, progress=told),
                # (More than the connection takes at once is sent first.)
                lambda told: ss.open_bricks(large, brick=64, client=client, progress=told),
                lambda told: ss.render(bricked, client=client, progress=told, **SMALL),
                lambda told: ss.turntable(bricked, client=client, frames=2, **SMALL).save(
                    tmp_path / "film", progress=told
                ),
            ):
                assert seconds_to_give_up(call) < 2.0
            began = time.monotonic()
            with pytest.raises(ss.Error) as told:
                ss.render(bricked, client=client, worker_timeout=3.0, **SMALL)
            assert address in told.value.found and "3 s" in told.value.found and "worker_timeout" in told.value.advice
            with pytest.raises(ss.Error, match="no sign of life"):
                bricked.at(places)
            assert time.monotonic() - began < 8.0
        # One that goes on is used again, once the scheduler has heard of it.
        until = time.monotonic() + 30.0
        while True:
            try:
                drawn = ss.render(bricked, client=client, **SMALL).pixels
                break
            except ss.Error:
                assert time.monotonic() < until
                time.sleep(0.2)
        np.testing.assert_array_equal(drawn, ss.render(bricked, **SMALL).pixels)


def test_frames_of_a_worker_that_hangs_are_drawn_by_another(samples, tmp_path):
    with cluster_of(2) as (client, pids):
        bricked = ss.open_bricks(samples, brick=64, client=client, quality="draft")
        film = ss.turntable(bricked, client=client, frames=150, size=40, quality="draft", backend="cpu")
        hung = []

        def progress(share):
            if share > 0.05 and not hung:
                hung.append(min(pids.values()))
                os.kill(hung[0], signal.SIGSTOP)

        film.save(tmp_path / "film", worker_timeout=3.0, progress=progress)
        assert hung[0] not in client.run(os.getpid).values()
        film[149:].save(tmp_path / "last")
    one, other = (tmp_path / name for name in ("last/frame_0000.png", "film/frame_0149.png"))
    np.testing.assert_array_equal(np.asarray(Image.open(one)), np.asarray(Image.open(other)))


def test_workers_that_do_not_come_are_given_up(samples):
    with cluster_of(0) as (client, _):
        assert seconds_to_give_up(lambda told: ss.open_bricks(samples, client=client, progress=told)) < 2.0


def test_opening_tells_its_share(cluster, samples):
    kernels = ss.EllipsoidField(np.random.default_rng(1).random((400, 3)), 0.1, values=np.arange(400.0))
    for data, given in ((samples, {"levels": 1}), (samples, {}), (kernels, {"brick_kernels": 50})):
        for client in (None, cluster):
            shares: list[float] = []
            ss.open_bricks(data, client=client, progress=shares.append, **({"brick": 16} | given))
            assert shares == sorted(shares) and shares[-1] == 1.0
            # Who waits for a cluster asks now and then.
            assert client is not None or shares[0] < 1.0
            with pytest.raises(ss.Cancelled, match="the opening was given up"):
                ss.open_bricks(data, client=client, progress=lambda _: False, **({"brick": 16} | given))


def slowly(block):
    """Take longer to be read than a worker may be silent."""
    time.sleep(3.5)
    return block


def test_a_worker_that_is_slow_is_waited_for(samples):
    dask = pytest.importorskip("dask.array")
    lazily = dask.from_array(samples, chunks=64).map_blocks(slowly, dtype=samples.dtype)
    with cluster_of(1) as (client, pids):
        bricked = ss.open_bricks(lazily, brick=64, client=client, quality="draft", worker_timeout=3.0)
        assert bricked.shape == samples.shape and client.run(os.getpid) == pids


def test_a_scheduler_that_hangs_is_told(samples):
    distributed = pytest.importorskip("distributed")
    command = "from distributed import LocalCluster\nif __name__ == '__main__':\n"
    command += (
        "    made = LocalCluster(n_workers=1, dashboard_address=None)\n    print(made.scheduler_address, flush=True)\n"
    )
    command += "    input()\n"
    with subprocess.Popen(
        [sys.executable, "-c", command], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        client = distributed.Client(other.stdout.readline().strip(), set_as_default=False)
        bricked = ss.open_bricks(samples, brick=24, client=client, quality="draft")
        with stopped(other.pid):
            assert seconds_to_give_up(lambda told: ss.render(bricked, client=client, progress=told, **SMALL)) < 2.0
            with pytest.raises(ss.Error, match="the scheduler .* cannot be used: found no sign of life"):
                ss.render(bricked, client=client, worker_timeout=2.0, **SMALL)
        ss.render(bricked, client=client, **SMALL)
        client.close()
        other.communicate("\n", timeout=30)


def children(of, name):
    """Return the processes that a process has started and that run a module."""
    found = []
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
                if parent == of and name in (folder / "cmdline").read_text():
                    found.append(int(folder.name))
            except OSError:
                continue
    return found


@pytest.mark.parametrize("suffix", ["", ".mp4"])
def test_a_process_of_a_film_that_hangs_is_named(samples, tmp_path, suffix):
    if suffix:
        pytest.importorskip("imageio_ffmpeg")
    film = ss.turntable(samples, frames=3000, size=120, quality="draft", backend="cpu")
    hung = []

    def hang():
        while not hung:
            hung.extend(children(os.getpid(), "sheetsplat.animation.worker"))
        time.sleep(1.0)
        for pid in hung:
            os.kill(pid, signal.SIGSTOP)

    for given, kind in (({}, ss.Cancelled), ({"worker_timeout": 2.0}, ss.Error)):
        hung.clear()
        thread = threading.Thread(target=hang)
        thread.start()
        progress, ended = give_up_after(3.0 if kind is ss.Cancelled else 60.0)
        with pytest.raises(kind) as told:
            film.save(tmp_path / f"film{suffix}", workers=2, progress=progress, **given)
        thread.join()
        if kind is ss.Cancelled:
            assert time.monotonic() - ended[0] < 2.0
        else:
            assert "no sign of life from process" in told.value.found
        assert not children(os.getpid(), "sheetsplat.animation.worker")


def test_an_encoder_that_hangs_is_given_up(samples, tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    film = ss.turntable(samples, frames=40, size=160, quality="draft", backend="cpu")

    def hang():
        # Not the program that only tells its version.
        while not (found := children(os.getpid(), "rawvideo")):
            time.sleep(0.01)
        os.kill(found[0], signal.SIGSTOP)

    thread = threading.Thread(target=hang)
    thread.start()
    assert seconds_to_give_up(lambda told: film.save(tmp_path / "film.mp4", progress=told)) < 2.0
    thread.join()
    assert not (tmp_path / "film.mp4").exists()


@pytest.mark.parametrize("value", [0, 1.5, float("nan"), "x", 1e9])
def test_timeouts_that_mean_nothing_are_refused(samples, value):
    for call in (
        lambda: ss.render(samples, worker_timeout=value),
        lambda: ss.open_bricks(samples, worker_timeout=value),
        lambda: ss.turntable(samples, frames=1, size=8, worker_timeout=value),
    ):
        with pytest.raises(ss.InvalidInput, match="worker_timeout"):
            call()
