"""Pictures in stages, threads and what a renderer re-uses, on the processor."""

from __future__ import annotations

import logging
import signal
import threading
import time

import numpy as np
import pytest

import sheetsplat as ss

LIGHT = ss.Light((0.3, 0.5, 1.0))
POINTS = [(0.1, 0.1, 0.2, 0.9, 0.0), (0.5, 0.2, 0.9, 0.3, 0.15), (1.0, 1.0, 0.8, 0.2, 0.5)]


@pytest.fixture(scope="module")
def field() -> ss.EllipsoidField:
    rng = np.random.default_rng(4)
    count = 3000
    return ss.EllipsoidField(rng.random((count, 3)), rng.uniform(0.03, 0.08, count), None, rng.random(count))


@pytest.fixture(scope="module")
def scene(field: ss.EllipsoidField) -> ss.Scene:
    return ss.Scene(field, POINTS, lights=(LIGHT,))


@pytest.fixture(scope="module")
def camera(field: ss.EllipsoidField) -> ss.Camera:
    return ss.Camera.fit(field, (-0.5, -0.4, -0.8))


def off_by(image: ss.Image, expected: ss.Image) -> float:
    return float(np.sqrt(((np.asarray(image.pixels, np.float64) - expected.pixels) ** 2).mean()))


@pytest.mark.parametrize("backend", ["cpu", pytest.param("gl", marks=pytest.mark.gl), "reference"])
def test_stages_lead_to_the_picture(backend, scene, camera):
    size = (40, 30) if backend == "reference" else (120, 90)
    renderer = ss.Renderer(backend)
    expected = renderer.render(scene, camera, size=size, outputs=("depth",))
    stages = list(renderer.progressive(scene, camera, size=size, outputs=("depth",), first_seconds=1e-6))
    assert len(stages) > 1
    for number, image in enumerate(stages, 1):
        assert image.size == size and image.rgba.shape == (size[1], size[0], 4)
        assert image.depth.shape == (size[1], size[0])
        assert image.stats["stage"] == number and image.stats["stages"] == len(stages)
    for image in stages[:-1]:
        ratio = image.stats["estimated_rmse"] / off_by(image, expected)
        assert 1 / 3 < ratio < 3, ratio
    assert np.array_equal(stages[-1].rgba, expected.rgba)
    assert np.array_equal(stages[-1].depth, expected.depth)
    assert stages[-1].stats["estimated_rmse"] < 1e-4


def test_leaving_early_draws_no_more(scene, camera):
    renderer = ss.Renderer("cpu")
    drawn = []
    stages = renderer.progressive(scene, camera, progress=drawn.append, first_seconds=1e-6)
    first = next(stages)
    assert first.stats["stage"] == 1
    told = len(drawn)
    stages.close()
    with pytest.raises(StopIteration):
        next(stages)
    assert len(drawn) == told
    assert renderer.render(scene, camera, size=(20, 20)).rgba.any()


def test_false_ends_a_stage_and_the_next_call_begins_it_anew(scene, camera):
    renderer = ss.Renderer("cpu")
    with pytest.raises(ss.Cancelled):
        next(renderer.progressive(scene, camera, progress=lambda share: False))

    def fail(share: float) -> None:
        raise ZeroDivisionError(share)

    with pytest.raises(ZeroDivisionError):
        next(renderer.progressive(scene, camera, progress=fail))
    assert renderer.render(scene, camera, size=(20, 20)).rgba.any()


@pytest.mark.alone
@pytest.mark.timeout(60)
@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_ends_a_stage(field, camera):
    scene = ss.Scene(field, POINTS, lights=(LIGHT,), slice_spacing=1e-4, reference_length=0.03)
    renderer = ss.Renderer("cpu", precision="float64", threads=1)
    began = []

    def interrupt(share: float) -> None:
        if not began:
            began.append(time.perf_counter())
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        for _ in renderer.progressive(scene, camera, size=(800, 800), progress=interrupt):
            pass
    assert time.perf_counter() - began[0] < 1.0


@pytest.mark.alone
def test_a_picture_is_cancelled_soon(field, camera):
    """Within 20 ms of the callback's answer on an idle machine; 100 ms are allowed here."""
    scene = ss.Scene(field, POINTS, lights=(LIGHT,), slice_spacing=2e-3, reference_length=0.03)
    renderer = ss.Renderer("cpu")
    renderer.render(scene, camera, size=(16, 16))
    answered = []

    def stop(share: float) -> bool:
        if share > 0.05:
            answered.append(time.perf_counter())
            return False
        return True

    with pytest.raises(ss.Cancelled):
        renderer.render(scene, camera, size=(1000, 1000), progress=stop)
    assert time.perf_counter() - answered[0] < 0.1


def test_the_log_tells_stages_apart(scene, camera, caplog):
    caplog.set_level(logging.INFO, logger="sheetsplat")
    renderer = ss.Renderer("cpu")
    stages = list(renderer.progressive(scene, camera, size=(64, 48), first_seconds=1e-6))
    renderer.render(scene, camera, size=(64, 48))
    lines = [message for message in caplog.messages if message.startswith("rendered")]
    *staged, whole = lines
    assert len(staged) == len(stages) > 1 and "stage" not in whole
    assert [f"stage {number} of {len(stages)}" in line for number, line in enumerate(staged, 1)] == [True] * len(stages)


@pytest.mark.parametrize("value", [0, -1, float("nan"), "soon", None])
def test_strange_times_are_refused(value, scene, camera):
    with pytest.raises(ss.InvalidInput):
        ss.Renderer("cpu").progressive(scene, camera, first_seconds=value)


@pytest.mark.parametrize("threads", [0, -1, 1025, 1.5, "two", True])
def test_strange_threads_are_refused(threads):
    with pytest.raises(ss.InvalidInput, match="threads.*from 1 to 1024, or None"):
        ss.Renderer("cpu", threads=threads)


def test_threads_are_told_and_change_nothing(scene, camera):
    pictures = []
    for threads in (1, 2, 5):
        image = ss.Renderer("cpu", threads=threads).render(scene, camera, size=(90, 70))
        assert f"{threads} thread" in image.plan.device
        pictures.append(image.rgba)
    assert all(np.array_equal(pictures[0], picture) for picture in pictures[1:])


@pytest.mark.alone
def test_what_a_change_leaves_is_used_again(field, camera):
    renderer = ss.Renderer("cpu")

    def draw(points, light, view=camera):
        return renderer.render(ss.Scene(field, points, lights=(light,)), view, size=(64, 64))

    assert draw(POINTS, LIGHT).stats["buckets_reused"] == 0
    assert draw(POINTS, ss.Light((-1, 0, 0.5))).stats["buckets_reused"] == 1
    other = [(0.1, 0.9, 0.2, 0.1, 0.0), (0.5, 0.2, 0.3, 0.9, 0.4), (1.0, 0.1, 0.8, 0.2, 0.1)]
    assert draw(other, LIGHT).stats["buckets_reused"] == 1
    turned = draw(other, LIGHT, ss.Camera.fit(field, (-0.4, -0.4, -0.8)))
    assert turned.stats["buckets_reused"] == 0 and turned.stats["seconds_index"] < 0.002


def test_threads_of_python_may_share_a_renderer_in_stages(scene, camera):
    renderer = ss.Renderer("cpu")
    expected = renderer.render(scene, camera, size=(100, 80)).rgba
    found: list[np.ndarray] = []

    def draw() -> None:
        *_, last = renderer.progressive(scene, camera, size=(100, 80), first_seconds=1e-6)
        found.append(last.rgba)

    workers = [threading.Thread(target=draw) for _ in range(3)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert len(found) == 3 and all(np.array_equal(picture, expected) for picture in found)


def test_devices_list_the_processor():
    (device,) = [device for device in ss.devices() if device.backend == "cpu"]
    assert device.available and "thread" in device.description and device.extensions
