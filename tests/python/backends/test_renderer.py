"""The renderer: outputs, sizes, progress, Ctrl-C, threads, plans."""

from __future__ import annotations

import ctypes
import dataclasses
import html
import json
import logging
import math
import os
import re
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import sheetsplat as ss

RAMP = ss.TransferFunction([(0, 0, 0, 0, 0), (1, 1, 0.5, 0.2, 0.6)])
BACKENDS = ["reference", pytest.param("gl", marks=pytest.mark.gl)]


@pytest.fixture(params=BACKENDS)
def renderer(request):
    return request.getfixturevalue(f"{request.param}_renderer")


@pytest.fixture
def field(ball):
    return ss.RegularField(ball)


@pytest.fixture
def scene(field):
    return ss.Scene(field, RAMP, lights=[ss.Light()])


@pytest.fixture
def camera(field):
    return ss.Camera.fit(field)


@pytest.fixture(scope="module")
def slow_scene():
    """A scene of many slices that takes the reference seconds."""
    values = np.random.default_rng(3).random((32, 32, 32), dtype=np.float32)
    return ss.Scene(ss.RegularField(values), RAMP, slice_spacing=0.1, reference_length=1)


@pytest.fixture(scope="module")
def slow_camera(slow_scene):
    return ss.Camera.fit(slow_scene)


def test_pictures_have_the_promised_shapes(renderer, scene, camera):
    image = renderer.render(scene, camera, size=(30, 20), outputs=("coverage", "depth"))
    assert image.rgba.shape == (20, 30, 4) and image.rgba.dtype == np.float32
    assert image.coverage.shape == image.depth.shape == (20, 30)
    assert image.coverage.dtype == image.depth.dtype == np.float32
    assert image.size == (30, 20) and not image.is_scalar
    assert image.pixels is image.rgba
    assert image.rgba[0, 0].tolist() == [0, 0, 0, 0] and math.isinf(image.depth[0, 0]) and image.coverage[0, 0] == 0
    middle = image.rgba[10, 15]
    assert 0 < middle[3] <= 1 and middle[0] > middle[1] > middle[2] > 0
    assert math.isfinite(image.depth[10, 15]) and image.coverage[10, 15] > 0
    assert image.stats["slices"] == image.plan.slices > 0
    assert "30 x 20" in repr(image)
    with pytest.raises(ss.InvalidInput, match="scalar"):
        _ = image.scalar


@pytest.mark.parametrize("mode", ["xray", "mip"])
def test_scalar_modes_have_scalars(renderer, field, camera, mode):
    image = renderer.render(ss.Scene(field, RAMP, mode=mode), camera, size=(30, 20))
    assert image.scalar.shape == (20, 30) and image.scalar.dtype == np.float32 and image.is_scalar
    assert image.pixels is image.scalar
    for name in ("rgba", "coverage", "depth"):
        with pytest.raises(ss.InvalidInput, match=name):
            getattr(image, name)
    if mode == "mip":
        assert np.nanmax(image.scalar) <= 1.05


def test_an_invisible_field_is_an_empty_picture(renderer, field, camera):
    nothing = ss.TransferFunction([(0, 1, 1, 1, 0), (1, 1, 1, 1, 0)])
    image = renderer.render(ss.Scene(field, nothing, lights=[ss.Light()]), camera, size=(8, 8))
    assert not image.rgba.any()
    beyond = ss.TransferFunction([(5, 1, 1, 1, 0), (6, 1, 1, 1, 1)])
    assert not renderer.render(ss.Scene(field, beyond), camera, size=(8, 8)).rgba.any()


def test_a_constant_field_is_a_picture(renderer):
    field = ss.RegularField(np.full((6, 6, 6), 0.5, np.float32))
    image = renderer.render(ss.Scene(field, RAMP), ss.Camera.fit(field), size=(16, 16))
    assert np.isfinite(image.rgba).all() and image.rgba[8, 8, 3] > 0.5


def test_a_single_sample_is_a_picture(renderer):
    field = ss.RegularField(np.ones((1, 1, 1), np.uint8), normalization="none", boundary="zero")
    image = renderer.render(ss.Scene(field, RAMP), ss.Camera.fit(field), size=(17, 17))
    assert image.rgba[8, 8, 3] > image.rgba[8, 12, 3] > 0


def test_nan_samples_are_no_samples(renderer, ball, camera):
    holed, zeroed = ball.copy(), ball.copy()
    holed[:, :, :9] = np.nan
    zeroed[:, :, :9] = 0
    pictures = [
        renderer.render(
            ss.Scene(ss.RegularField(values, nan="skip", boundary="zero"), RAMP), camera, size=(20, 20)
        ).rgba
        for values in (holed, zeroed, ball)
    ]
    assert np.allclose(pictures[0], pictures[1], atol=1e-5)
    assert not np.allclose(pictures[0], pictures[2], atol=1e-2)


def test_background_is_put_behind(renderer, field, camera):
    clear = renderer.render(ss.Scene(field, RAMP), camera, size=(16, 16)).rgba
    filled = renderer.render(ss.Scene(field, RAMP, background=(0.2, 0.4, 1)), camera, size=(16, 16)).rgba
    assert np.allclose(filled[..., :3], clear[..., :3] + (1 - clear[..., 3:]) * np.float32([0.2, 0.4, 1]), atol=1e-6)
    assert (filled[..., 3] == 1).all()


@pytest.mark.parametrize(
    "size", [(0, 10), (10, 0), (-1, 10), (10,), (10, 10, 10), (10.5, 10), "10x10", None, (2**31, 1), (2**70, 1)]
)
def test_sizes_without_meaning_are_refused(renderer, scene, camera, size):
    for call in (renderer.render, renderer.plan):
        with pytest.raises(ss.InvalidInput, match="size"):
            call(scene, camera, size=size)


def test_pictures_larger_than_memory_are_refused(renderer, scene, camera):
    for call in (renderer.render, renderer.plan):
        with pytest.raises(ss.OutOfMemory, match="100000 x 100000|memory"):
            call(scene, camera, size=(100_000, 100_000))


@pytest.mark.parametrize("spacing", [1e-6, 1e-300])
def test_too_many_slices_are_refused(renderer, field, camera, spacing):
    scene = ss.Scene(field, RAMP, slice_spacing=spacing, reference_length=1)
    with pytest.raises(ss.InvalidInput, match="slices"):
        renderer.render(scene, camera, size=(4, 4))


@pytest.mark.parametrize("outputs", [("albedo",), "normals", (None,)])
def test_unknown_outputs_are_refused(renderer, scene, camera, outputs):
    with pytest.raises(ss.InvalidInput, match="outputs"):
        renderer.render(scene, camera, size=(4, 4), outputs=outputs)


def test_one_output_may_be_a_text(renderer, scene, camera):
    assert renderer.render(scene, camera, size=(4, 4), outputs="depth").depth.shape == (4, 4)


@pytest.mark.parametrize("arguments", [(None, "camera"), ("scene", None), ("camera", "scene")])
def test_other_nouns_are_refused(renderer, scene, camera, arguments):
    nouns = {"scene": scene, "camera": camera, None: None}
    with pytest.raises(ss.InvalidInput, match="sheetsplat"):
        renderer.render(*(nouns[name] for name in arguments), size=(4, 4))


@pytest.mark.parametrize(
    "options",
    [
        {"backend": "cuda"},
        {"backend": None},
        {"precision": "int4"},
        {"tagging": "maybe"},
        {"packing": "tight"},
        {"effects": "culling"},
        {"effects": {1: True}},
        {"device": "first"},
        {"device": 2**40},
        {"tile_size": 1.5},
    ],
)
def test_renderer_options_without_meaning_are_refused(options):
    with pytest.raises(ss.InvalidInput, match="Renderer"):
        ss.Renderer(**options)


def test_unknown_effects_are_refused(scene, camera):
    with pytest.raises(ss.InvalidInput, match="bloom"):
        ss.Renderer("reference", effects={"bloom": True}).plan(scene, camera, size=(4, 4))


def test_what_a_backend_lacks_is_unsupported(scene, camera):
    with pytest.raises(ss.Unsupported, match="float64"):
        ss.Renderer("reference", precision="float16").render(scene, camera, size=(4, 4))


@pytest.mark.gl
def test_inexact_settings_need_a_word(scene, camera):
    with pytest.raises(ss.Unsupported, match="allow_inexact"):
        ss.Renderer("gl", precision="uint8").render(scene, camera, size=(4, 4))
    image = ss.Renderer("gl", precision="uint8", allow_inexact=True).render(scene, camera, size=(16, 16))
    assert image.plan.precision == "uint8" and image.rgba.any()


@pytest.mark.parametrize(
    ("backend", "settings", "words"),
    [
        ("reference", {"threads": 2}, "threads"),
        ("reference", {"effects": {"opacity_buffer": True}}, "the effect opacity_buffer"),
        # It draws what the scene says, so nothing is forced on.
        ("reference", {"effects": {"weight": True}}, "the effect weight"),
        ("reference", {"tagging": "tiles", "packing": "paper"}, "tagging, packing"),
        ("reference", {"tile_size": 64, "tags_per_clear": 8}, "tags_per_clear, tile_size"),
        ("cpu", {"device": 0}, "device"),
        ("cpu", {"tags_per_clear": 8}, "tags_per_clear"),
        pytest.param("gl", {"threads": 2}, "threads", marks=pytest.mark.gl),
    ],
)
def test_settings_that_say_nothing_are_told_once(backend, settings, words, scene, camera, caplog):
    caplog.set_level(logging.WARNING, logger="sheetsplat")
    renderer = ss.Renderer(backend, **settings)
    renderer.plan(scene, camera, size=(8, 8))
    assert caplog.messages == [f"backend {backend} does not use {words}"]
    assert caplog.records[0].levelname == "WARNING" and caplog.records[0].name == "sheetsplat"
    renderer.render(scene, camera, size=(8, 8))
    assert len(caplog.messages) == 1
    caplog.clear()
    ss.Renderer(backend, **settings).render(scene, camera, size=(8, 8))
    assert len(caplog.messages) == 1


@pytest.mark.parametrize(
    ("backend", "settings"),
    [
        ("reference", {"effects": {"opacity_buffer": False}, "tagging": "off", "packing": "auto"}),
        ("cpu", {"threads": 1, "tile_size": 64, "tagging": "tiles", "effects": {"culling": False}}),
        pytest.param("gl", {"device": 0, "tile_size": 64, "tagging": "tiles"}, marks=pytest.mark.gl),
    ],
)
def test_settings_that_say_something_are_not_told(backend, settings, scene, camera, caplog):
    caplog.set_level(logging.WARNING, logger="sheetsplat")
    if backend == "gl" and not any(device.platform == "egl" and device.available for device in ss.devices()):
        pytest.skip("no EGL device here")
    ss.Renderer(backend, **settings, allow_inexact=True).render(scene, camera, size=(8, 8))
    assert caplog.messages == []


def test_backend_from_the_environment(monkeypatch, scene, camera):
    monkeypatch.setenv("SHEETSPLAT_BACKEND", "reference")
    assert ss.Renderer().plan(scene, camera, size=(4, 4)).backend == "reference"
    monkeypatch.setenv("SHEETSPLAT_BACKEND", "")
    ss.Renderer()
    monkeypatch.setenv("SHEETSPLAT_BACKEND", "warp")
    with pytest.raises(ss.InvalidInput, match="SHEETSPLAT_BACKEND"):
        ss.Renderer()
    assert ss.Renderer("reference").plan(scene, camera, size=(4, 4)).backend == "reference"


NO_DEVICE = """
import numpy as np
import sheetsplat as ss
field = ss.RegularField(np.ones((3, 3, 3)))
scene, camera = ss.Scene(field, [(0, 1, 1, 1, 0), (1, 1, 1, 1, 1)]), ss.Camera.fit(field)
print(ss.Renderer("auto").render(scene, camera, size=(4, 4)).plan.backend)
try:
    ss.Renderer("gl").render(scene, camera, size=(4, 4))
except ss.DeviceUnavailable as error:
    print(error)
"""


def test_no_device_is_said_with_every_try():
    """Without a vendor library EGL finds no device; the package imports, renders on the processor, and states why."""
    nothing = {"SHEETSPLAT_GL": "egl", "__EGL_VENDOR_LIBRARY_FILENAMES": os.devnull, "SHEETSPLAT_BACKEND": "auto"}
    environment = {**os.environ, **nothing}
    result = subprocess.run([sys.executable, "-c", NO_DEVICE], capture_output=True, text=True, env=environment)
    assert result.returncode == 0, result.stderr
    backend, message = result.stdout.split("\n", 1)
    assert backend == "cpu"
    assert "EGL" in message or "egl" in message


def test_a_device_number_that_is_not_there_is_refused(monkeypatch, scene, camera):
    reports = [device for device in ss.devices() if device.platform == "egl"]
    if not any(device.available for device in reports):
        pytest.skip("no EGL device here")
    with pytest.raises(ss.InvalidInput, match="4711"):
        ss.Renderer("gl", device=4711).render(scene, camera, size=(4, 4))
    monkeypatch.setenv("SHEETSPLAT_EGL_DEVICE", "4711")
    with pytest.raises(ss.Error, match="4711"):
        ss.Renderer("gl").render(scene, camera, size=(4, 4))


def test_plan_is_readable(renderer, scene, camera):
    plan = renderer.plan(scene, camera, size=(30, 20))
    assert plan.size == (30, 20) and plan.slices > 0 and plan.slice_spacing == 1
    assert plan.backend in str(plan) and "30 x 20" in str(plan)
    for effect in plan.effects:
        assert effect.name in str(plan) and effect.reason in str(plan) and not effect.forced
        assert plan.has(effect.name) == effect.on
    assert not plan.has("no such effect")
    again = json.loads(json.dumps(plan.to_dict()))
    assert again["size"] == [30, 20] and again["effects"][0]["name"] == plan.effects[0].name
    assert plan == renderer.render(scene, camera, size=(30, 20)).plan


def test_plans_in_notebooks_are_short(scene, camera, ball):
    forced = ss.Renderer("cpu", effects={"culling": False}).plan(scene, camera, size=(30, 20))
    for plan in (forced, ss.render(ball, quality="best", size=(32, 32)).plan):
        short, whole = repr(plan), str(plan)
        assert (
            len(short.splitlines()) <= 12 and len(short) < 1000 < len(whole) and max(map(len, short.splitlines())) < 112
        )
        assert (
            plan.backend in short and f"{plan.slices}, {plan.slice_spacing:g} apart" in short and "print(plan)" in short
        )
        page = plan._repr_html_()
        assert page.count("<details>") == 1 and html.unescape(page).count(whole) == 1
        assert html.unescape(page.partition("<details>")[0]).count("\n") <= 11
    assert re.search(r"^off +culling \(forced\)$", repr(forced), re.MULTILINE)
    # Names of devices and notes are no HTML.
    odd = dataclasses.replace(forced, device="<b>", notes=("x" * 900,))
    assert "<b>" not in odd._repr_html_() and len(repr(odd)) < 1000 and "…" in repr(odd)


@pytest.mark.gl
def test_forced_effects_are_said(scene, camera):
    plan = ss.Renderer("gl", effects={"culling": False}).plan(scene, camera, size=(30, 20))
    culling = next(effect for effect in plan.effects if effect.name == "culling")
    assert culling.forced and not culling.on and "(forced)" in str(plan)


def test_progress_rises_from_start_to_end(renderer, slow_scene, slow_camera):
    shares: list[float] = []
    renderer.render(slow_scene, slow_camera, size=(40, 40), progress=shares.append)
    assert shares == sorted(shares) and 0 <= shares[0] < 0.5 and shares[-1] == 1


def test_progress_may_stop_it(renderer, slow_scene, slow_camera):
    calls: list[float] = []

    def stop(share: float) -> bool:
        calls.append(share)
        return len(calls) < 2

    with pytest.raises(ss.Cancelled):
        renderer.render(slow_scene, slow_camera, size=(40, 40), progress=stop)
    assert len(calls) == 2 and calls[-1] < 1
    # The renderer stays usable, and what is not False does not stop.
    assert renderer.render(slow_scene, slow_camera, size=(10, 10), progress=lambda share: None).rgba.any()


def test_errors_of_the_callback_come_out(renderer, slow_scene, slow_camera):
    def fail(share: float) -> None:
        raise LookupError("from the callback")

    with pytest.raises(LookupError, match="from the callback"):
        renderer.render(slow_scene, slow_camera, size=(40, 40), progress=fail)
    assert renderer.render(slow_scene, slow_camera, size=(10, 10)).rgba.any()


def test_a_callback_must_be_callable(renderer, scene, camera):
    with pytest.raises(ss.InvalidInput, match="progress"):
        renderer.render(scene, camera, size=(4, 4), progress=3)


def test_a_renderer_refuses_to_render_in_its_own_callback(renderer, scene, camera):
    with pytest.raises(ss.Unsupported, match="callback"):
        renderer.render(scene, camera, size=(8, 8), progress=lambda share: renderer.render(scene, camera, size=(8, 8)))
    assert renderer.render(scene, camera, size=(8, 8)).rgba.any()


@pytest.mark.alone
@pytest.mark.timeout(60)
@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_stops_it(renderer, slow_scene, slow_camera):
    began = time.perf_counter()
    renderer.render(slow_scene, slow_camera, size=(60, 60))
    whole = time.perf_counter() - began
    sent: list[float] = []

    def interrupt() -> None:
        sent.append(time.perf_counter())
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(0.15 * whole, interrupt)
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        renderer.render(slow_scene, slow_camera, size=(60, 60))
        time.sleep(whole)
    late = time.perf_counter() - sent[0]
    timer.join()
    # Ignoring the signal would take 0.85 of the whole time.
    assert late < 0.5 * whole, f"stopped {late:.3f} s after the signal; the whole picture takes {whole:.3f} s"
    assert renderer.render(slow_scene, slow_camera, size=(10, 10)).rgba.any()


def longest_pause(function) -> tuple[float, float]:
    """Return for how long this thread could not run while another ran `function`, and how long that took."""
    done = threading.Event()

    def work() -> None:
        try:
            function()
        finally:
            done.set()

    thread = threading.Thread(target=work)
    pauses, began = [], time.perf_counter()
    thread.start()
    last = began
    while not done.is_set():
        time.sleep(0.001)
        now = time.perf_counter()
        pauses.append(now - last)
        last = now
    thread.join()
    return max(pauses, default=last - began), last - began


@pytest.mark.alone
def test_rendering_lets_other_threads_run(renderer, slow_scene, slow_camera):
    pause, whole = longest_pause(lambda: renderer.render(slow_scene, slow_camera, size=(50, 50)))
    assert pause < 0.5 * whole
    # Negative control: a computation that holds the lock.
    number = 3**200_000
    pause, whole = longest_pause(lambda: pow(number, 2) % (number + 1))
    assert pause > 0.5 * whole


def test_threads_share_a_renderer(renderer, scene, camera):
    expected = renderer.render(scene, camera, size=(24, 24)).rgba
    found: list[np.ndarray] = []
    threads = [
        threading.Thread(target=lambda: found.append(renderer.render(scene, camera, size=(24, 24)).rgba))
        for _ in range(6)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 6 and all(np.array_equal(picture, expected) for picture in found)


def end_displays() -> None:
    """End the EGL displays of all devices, and with them all contexts on them, as VTK does when it closes a window."""
    egl = ctypes.CDLL("libEGL.so.1")
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    address = egl.eglGetProcAddress(b"eglGetPlatformDisplayEXT")
    display_of = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_uint, ctypes.c_void_p, ctypes.c_void_p)(address)
    address = egl.eglGetProcAddress(b"eglQueryDevicesEXT")
    devices = (ctypes.c_void_p * 16)()
    count = ctypes.c_int()
    ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)(address)(
        len(devices), devices, ctypes.byref(count)
    )
    device_platform, surfaceless = 0x313F, 0x31DD
    for display in [display_of(surfaceless, None, None)] + [
        display_of(device_platform, device, None) for device in devices[: count.value]
    ]:
        egl.eglTerminate(ctypes.c_void_p(display))


@pytest.mark.gl
def test_a_renderer_outlives_its_context(scene, camera):
    # Light volumes and tables stay on the device from picture to picture: they must be made anew too.
    scene = scene.replace(shadows=True)
    renderer = ss.Renderer("gl", effects={"shadows": True}, allow_inexact=True)
    platform = next(one.platform for one in ss.devices() if one.backend == "gl" and one.available)
    if platform == "osmesa":
        pytest.skip("OSMesa has no display that others could end")
    expected = renderer.render(scene, camera, size=(30, 20))
    assert expected.rgba.any()
    for _ in range(2):
        end_displays()
        again = renderer.render(scene, camera, size=(30, 20))
        assert np.array_equal(again.rgba, expected.rgba) and again.plan == expected.plan
    end_displays()
    del renderer


@pytest.mark.parametrize("backend", BACKENDS)
def test_renderers_live_side_by_side(backend, scene, camera):
    renderers = [ss.Renderer(backend), ss.Renderer(backend)]
    expected = renderers[0].render(scene, camera, size=(16, 16)).rgba
    renderers.append(ss.Renderer(backend))
    results: dict[int, np.ndarray] = {}

    def work(number: int) -> None:
        results[number] = renderers[number].render(scene, camera, size=(16, 16)).rgba

    threads = [threading.Thread(target=work, args=(number,)) for number in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(results) == 3 and all(np.array_equal(picture, expected) for picture in results.values())
    # A renderer that is deleted does not affect the others.
    del renderers[0]
    assert np.array_equal(renderers[0].render(scene, camera, size=(16, 16)).rgba, expected)


def test_devices_tell_what_is_there():
    found = ss.devices()
    assert {"reference", "gl"} <= {device.backend for device in found}
    assert all(device.description for device in found)
    assert next(device for device in found if device.backend == "reference").available
    json.dumps([device.to_dict() for device in found])
