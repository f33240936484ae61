"""Backend cpu under extreme and invalid input: the right picture or a clear error, and usable afterwards."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scene_parts
from image_checks import FLOAT32_HARD, MOST_AMBIGUOUS, off_by, within
from reference_pictures import by_reference, changed_pixels

import sheetsplat as ss

SIZE = (30, 24)
Parts = dict[str, Any]


def cloud(seed: int, count: int = 40, overlap: float = 2.0, aspect: float = 3.0, **options: Any) -> Parts:
    return scene_parts.cloud(np.random.default_rng(seed), count, overlap, aspect, **{"w0": 0.5, **options})


def parts(field: Parts | list[Parts], camera: Parts | None = None, **options: Any) -> Parts:
    fields = field if isinstance(field, list) else [field]
    return scene_parts.parts(fields, camera, **{"size": SIZE, "slice_spacing": 1 / 6, **options})


def assert_right(scene: Parts, *, precision: str | None = None, may_jump: bool = False, **options: Any) -> ss.Image:
    """Compare a picture and its coverage with the reference.

    Where it may jump, ambiguous pixels are looked for and left out if it is farther off with them.
    """
    built, camera, size = scene_parts.build(ss, scene)
    image = ss.Renderer("cpu", **options).render(built, camera, size=size, outputs=("coverage", "depth"))
    expected = by_reference(scene, ("coverage", "depth"))
    pixels = np.array(image.pixels)
    assert np.isfinite(pixels).all()
    assert precision is None or image.plan.precision == precision or image.stats["tiles_in_float64"] > 0
    if may_jump and not within(off_by(pixels, expected), FLOAT32_HARD):
        span = scene["transfer"][-1][0] - scene["transfer"][0][0]
        moves = [{"rho": 1e-5 * span}, {"rho": -1e-5 * span}, {"support": 1e-5}, {"support": -1e-5}]
        spacing, length = built.slice_spacing, built.reference_length
        jumping = changed_pixels(expected.rgba, [scene_parts.nudged(scene, spacing, length, **move) for move in moves])
        assert jumping.sum() <= max(1, MOST_AMBIGUOUS * jumping.size)
        pixels[jumping] = expected.pixels[jumping]
    for output, (found, wanted) in {
        "image": (pixels, expected),
        "coverage": (image.coverage, expected.coverage),
    }.items():
        assert within(off_by(found, wanted), FLOAT32_HARD), (output, off_by(found, wanted))
    return image


# Beyond the range or precision of float32 or float64


@pytest.mark.parametrize("lit", [False, True])
@pytest.mark.parametrize("sampling", ["point", "slab"])
@pytest.mark.parametrize("aspect", [1e5, 1e8, 1e12])
def test_needles_and_disks(aspect: float, sampling: str, lit: bool) -> None:
    for shape in ((1, 1 / aspect, 1 / aspect), (1, 1, 1 / aspect)):
        for scale in (1.0, min(0.05 * aspect, 1e6)):
            field = cloud(3, 30, w0=0.3) | {"scales": np.tile(shape, (30, 1)) * scale}
            for camera in (scene_parts.parallel(height=2.5), scene_parts.central()):
                assert_right(parts(field, camera, lit=lit, sampling=sampling, slice_spacing=max(1 / 6, scale / 20)))


FALLOFFS = [0.05, 5.0, 20.0, 50.0, 90.0, 300.0, 600.0]


@pytest.mark.parametrize("falloff", FALLOFFS)
@pytest.mark.parametrize("sampling", ["point", "slab"])
@pytest.mark.parametrize("normalization", ["threshold", "none"])
def test_supports_end_where_they_end(falloff: float, sampling: str, normalization: str) -> None:
    """A steep profile is nearly 0 long before its support ends, but opacity at 0 shows where the support ends."""
    field = cloud(4, falloff=falloff, normalization=normalization)
    for lit in (False, True):
        scene = parts(field, scene_parts.central(), transfer=scene_parts.ZERO_SEEN, sampling=sampling, lit=lit)
        assert_right(scene, precision="float64" if falloff > 20 else None, may_jump=True)
    weights = np.where(np.arange(40) % 2 == 0, 1.0, 0.0)
    scene = parts(field | {"weights": weights}, transfer=scene_parts.ZERO_SEEN, sampling=sampling, lit=False)
    assert_right(scene, may_jump=True)


def test_a_profile_too_steep_to_tell_its_end_is_refused_where_it_matters() -> None:
    steep = cloud(4, falloff=700.0)
    built, camera, size = scene_parts.build(ss, parts(steep, transfer=scene_parts.ZERO_SEEN))
    with pytest.raises(ss.Unsupported, match="falloff of 700.*at most 600.*an opacity of 0 at 0"):
        ss.Renderer("cpu").render(built, camera, size=size)
    assert_right(parts(steep))


@pytest.mark.parametrize("w0", [1e-200, 1e-30, 1.0, 1e30, 1e200])
@pytest.mark.parametrize("weight", [0.0, 1e-20, 1e20])
def test_thresholds_beyond_float32(weight: float, w0: float) -> None:
    weights = np.where(np.arange(40) % 2 == 0, 1.0, weight)
    for transfer in (scene_parts.GENTLE, scene_parts.ZERO_SEEN):
        assert_right(parts(cloud(5, weights=weights, w0=w0), transfer=transfer), may_jump=True)
        two = [cloud(5, weights=weights, w0=w0), cloud(6)]
        assert_right(parts(two, transfer=transfer, lit=False), may_jump=True)


@pytest.mark.parametrize("radius_px", [1e-9, 1e-7, 1e-3, 0.3, 1e7, 1e10])
@pytest.mark.parametrize("sampling", ["point", "slab"])
def test_kernels_of_any_size_on_centres_and_borders(radius_px: float, sampling: str) -> None:
    rng = np.random.default_rng(5)
    width, height = SIZE
    camera = scene_parts.parallel(direction=(0, 0, -1), up=(0, 1, 0), height=float(height))
    for half in (0.5, 0.0):
        x, y = rng.integers(0, width, 40) + half - width / 2, height / 2 - rng.integers(0, height, 40) - half
        at = np.stack([x, y, np.where(rng.random(40) < 0.5, 0.5, -0.5)], -1)
        if radius_px < 1:
            at[:, :2] += rng.uniform(-0.4, 0.4, (40, 2)) * radius_px
        scales = radius_px * np.tile((1.0, 0.8, 0.9), (40, 1))
        field = {"centers": at, "scales": scales, "rotations": scene_parts.quaternions(rng, 40)}
        field |= {"values": rng.uniform(0.5, 1, 40), "w0": 0.3}
        for lit in (False, True):
            assert_right(parts(field, camera, lit=lit, sampling=sampling, slice_spacing=max(1.0, radius_px / 5)))


def test_gradients_that_float64_loses_are_refused() -> None:
    """On the flat tops of kernels of 1e12 pixels lights would show rounding (3e-3 of the picture)."""
    rng = np.random.default_rng(5)
    field = {"centers": rng.uniform(-10, 10, (40, 3)), "scales": np.full(40, 1e12), "values": rng.random(40)}
    camera = scene_parts.parallel(direction=(0, 0, -1), up=(0, 1, 0), height=24.0)
    scene = parts(field, camera, slice_spacing=2e11)
    with pytest.raises(ss.Unsupported, match="gradients as weak as rounding.*reference_length.*leave out the lights"):
        assert_right(scene)
    assert_right(scene | {"lights": []})


@pytest.mark.parametrize("same_values", [True, False])
@pytest.mark.parametrize("lit", [False, True])
@pytest.mark.parametrize("count", [10, 100, 300, 999, 100_000])
def test_crowds_at_one_spot(count: int, lit: bool, same_values: bool) -> None:
    """Equal summands round alike: the error of the sum grows with their number, and with what lights magnify."""
    values = np.full(count, 0.7) if same_values else np.random.default_rng(3).random(count)
    field = {"centers": np.full((count, 3), 0.1), "scales": np.full(count, 0.5), "values": values}
    assert_right(parts(field, lit=lit, slice_spacing=0.5))
    if lit and count < 1000:
        for length in (0.3, 0.042):
            close = parts(field, scene_parts.parallel(height=1.0), slice_spacing=0.042, reference_length=length)
            assert_right(close)


@pytest.mark.parametrize("offset", [0.0, 10.0])
@pytest.mark.parametrize(("count", "spread"), [(40, 0.05), (300, 0.005), (999, 0.05)])
def test_lit_quotients_that_hardly_change(count: int, spread: float, offset: float) -> None:
    """Where all values are equal, the gradient is rounding error alone, which lights must not show."""
    places = 0.1 + spread * np.random.default_rng(3).normal(size=(count, 3))
    field = {"centers": places, "scales": np.full(count, 0.5), "values": np.full(count, 0.7 + offset)}
    window = [(value + offset, *rest) for value, *rest in scene_parts.GENTLE]
    looks: Parts = {"slice_spacing": 0.043, "reference_length": 0.3, "transfer": window}
    assert_right(parts(field, scene_parts.parallel(height=1.0), **looks))


@pytest.mark.parametrize("unit", [1e-45, 1e-20, 1e20, 1e38, 1e100])
@pytest.mark.parametrize("sampling", ["point", "slab"])
@pytest.mark.parametrize("boundary", ["edge", "zero"])
def test_the_unit_of_length_does_not_matter(boundary: str, unit: float, sampling: str) -> None:
    """In perspective, lengths are relative to depth, whose magnitude differs from theirs."""
    field = cloud(8)
    field |= {"centers": unit * field["centers"], "scales": unit * field["scales"]}
    lattice = {
        "values": np.random.default_rng(1).random((5, 6, 7)),
        "origin": (-unit,) * 3,
        "spacing": (0.4 * unit,) * 3,
        "boundary": boundary,
    }
    for distance in (4 * unit, 0.3 * unit):
        scene = parts(field, scene_parts.central(distance=distance), sampling=sampling, slice_spacing=unit / 6)
        built, camera, size = scene_parts.build(ss, scene)
        image = ss.Renderer("cpu").render(built, camera, size=size)
        found = off_by(image, by_reference(scene))
        assert within(found, FLOAT32_HARD), found
    scene = parts(lattice, scene_parts.central(distance=4 * unit), sampling=sampling, slice_spacing=unit / 6)
    built, camera, size = scene_parts.build(ss, scene)
    image = ss.Renderer("cpu").render(built, camera, size=size)
    assert off_by(image, by_reference(scene))["p99_9"] <= FLOAT32_HARD[1]
    if boundary == "zero":
        assert image.stats["kernels_drawn"] == lattice["values"].size


@pytest.mark.parametrize("mode", ["xray", "mip"])
@pytest.mark.parametrize("unit", [1e39, 1e200])
def test_numbers_that_no_float32_picture_holds_are_refused(unit: float, mode: str) -> None:
    field = cloud(8)
    scene = parts(field | {"values": unit * field["values"]}, mode=mode)
    built, camera, size = scene_parts.build(ss, scene)
    with pytest.raises(ss.Unsupported, match="cannot be represented in float32"):
        ss.Renderer("cpu").render(built, camera, size=size)


@pytest.mark.parametrize("fov_y", [1.0, 90.0, 170.0, 179.0])
@pytest.mark.parametrize("sampling", ["point", "slab"])
def test_the_eye_anywhere(fov_y: float, sampling: str) -> None:
    lattice = {"values": np.random.default_rng(1).random((5, 6, 7)), "origin": (-1, -1, -1), "spacing": (0.4,) * 3}
    for distance in (1e-9, 0.3, 2.0):
        for near in (None, 1e-6, 0.5):
            camera = scene_parts.central(distance=distance, fov_y=fov_y) | ({} if near is None else {"near": near})
            for field in (cloud(10), lattice):
                assert_right(parts(field, camera, sampling=sampling))


@pytest.mark.parametrize("height", [1e-3, 1e-7, 1e-10])
@pytest.mark.parametrize("mode", ["composite", "isosurface"])
def test_magnification(height: float, mode: str) -> None:
    looks = {"iso_value": 0.3} if mode == "isosurface" else {}
    for sampling in ("point", "slab"):
        camera = scene_parts.parallel(height=height, at=(0.1, 0.12, 0.15))
        scene = parts(cloud(11), camera, sampling=sampling, reference_length=0.1, mode=mode, **looks)
        assert_right(scene, may_jump=mode == "isosurface")


# Threads and processes


@cache
def busy() -> tuple[Any, Any, Any]:
    return scene_parts.build(ss, parts(cloud(12, 300, 4.0), size=(90, 70), sampling="slab"))


@pytest.mark.parametrize("size", [(1, 1), (30, 24), (64, 64), (70, 66), (200, 130)])
@pytest.mark.parametrize("sampling", ["point", "slab"])
def test_threads_change_no_bit(size: tuple[int, int], sampling: str) -> None:
    """Also where few tiles would leave many threads idle."""
    built, camera, _ = scene_parts.build(ss, parts(cloud(13, 200, 4.0), sampling=sampling))
    pictures = [
        np.array(ss.Renderer("cpu", threads=threads).render(built, camera, size=size).pixels)
        for threads in (1, 2, 3, 16, 500)
    ]
    assert all(np.array_equal(pictures[0], picture) for picture in pictures[1:])


def test_threads_are_a_number_from_1_to_1024() -> None:
    for wrong in (0, -1, 1025, 10_000, 1.5, "2", True, float("nan"), 2**70):
        with pytest.raises(ss.InvalidInput, match="threads"):
            ss.Renderer("cpu", threads=wrong)  # type: ignore[arg-type]


IN_CHILD = """
import os, signal, sys
import numpy as np
import test_attacks_cpu as attacks
import sheetsplat as ss
scene, camera, size = attacks.busy()
renderer = ss.Renderer("cpu", threads=2)
expected = np.array(renderer.render(scene, camera, size=size))
for way in range(4):
    child = os.fork()
    if child == 0:
        signal.alarm(20)
        if way in (0, 3):
            assert np.array_equal(np.asarray(renderer.render(scene, camera, size=size)), expected)
        if way == 1:
            del renderer
            assert np.array_equal(np.asarray(ss.Renderer("cpu").render(scene, camera, size=size)), expected)
        if way == 3:
            os._exit(0)
        sys.exit(0)
    assert os.waitpid(child, 0)[1] == 0, way
assert np.array_equal(np.asarray(renderer.render(scene, camera, size=size)), expected)
print("done")
"""


def test_forked_processes_draw_and_end() -> None:
    """A forked process has no copies of the threads: it must neither wait for them nor end them."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[1]), *sys.path])}
    result = subprocess.run(
        [sys.executable, "-c", IN_CHILD], env=environment, capture_output=True, text=True, timeout=100
    )
    assert result.returncode == 0 and result.stdout.strip() == "done", result.stdout + result.stderr


@pytest.mark.parametrize("shared", [False, True])
def test_pictures_of_many_threads_at_once(shared: bool) -> None:
    scenes = [
        scene_parts.build(ss, parts(cloud(seed, 300, 4.0), camera, size=(60, 50)))
        for seed, camera in enumerate((scene_parts.parallel(), scene_parts.central()))
    ]
    expected = [np.array(ss.Renderer("cpu").render(scene, camera, size=size).pixels) for scene, camera, size in scenes]
    one = ss.Renderer("cpu")
    wrong: list[Any] = []

    def work(number: int) -> None:
        renderer = one if shared else ss.Renderer("cpu")
        for turn in range(6):
            which = (number + turn) % 2
            scene, camera, size = scenes[which]
            if not np.array_equal(renderer.render(scene, camera, size=size).pixels, expected[which]):
                wrong.append((number, turn))

    threads = [threading.Thread(target=work, args=(number,)) for number in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_renderers_leave_no_threads() -> None:
    scene, camera, size = busy()
    before = len(os.listdir("/proc/self/task"))
    for _ in range(20):
        ss.Renderer("cpu", threads=8).render(scene, camera, size=(20, 20))
    assert len(os.listdir("/proc/self/task")) <= before


def test_one_processor_means_one_thread() -> None:
    scene, camera, size = busy()
    expected = np.array(ss.Renderer("cpu").render(scene, camera, size=size).pixels)
    allowed = os.sched_getaffinity(0)
    try:
        os.sched_setaffinity(0, {min(allowed)})
        image = ss.Renderer("cpu").render(scene, camera, size=size)
    finally:
        os.sched_setaffinity(0, allowed)
    assert image.stats["threads"] == 1 and image.plan.device.endswith("1 thread")
    assert np.array_equal(image.pixels, expected)


# Time and memory


def heap() -> dict[str, Any]:
    rng = np.random.default_rng(0)
    return {
        "centers": 1e-3 * rng.uniform(-1, 1, (150_000, 3)),
        "scales": np.ones(150_000),
        "values": rng.random(150_000),
    }


# Scenes that take seconds: many pixels, many slices, or all kernels in one slice.
LONG = {
    "pixels": lambda: parts(cloud(1, 20_000, 30.0), size=(2400, 2400), slice_spacing=1 / 24),
    "slices": lambda: parts(cloud(1, 50), size=(300, 300), slice_spacing=3e-6, lit=False),
    "one slice": lambda: parts(heap(), size=(600, 600), slice_spacing=1.0),
}


@pytest.mark.alone
@pytest.mark.timeout(60)
@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.parametrize("name", LONG)
def test_rendering_stops_at_once(name: str) -> None:
    """By Ctrl-C and by a callback; the renderer draws again afterwards."""
    scene, camera, size = scene_parts.build(ss, LONG[name]())
    small, eye, small_size = busy()
    expected = np.array(ss.Renderer("cpu").render(small, eye, size=small_size).pixels)
    renderer = ss.Renderer("cpu", threads=2)
    pressed: list[float] = []

    def press() -> None:
        pressed.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(0.2, press)
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            renderer.render(scene, camera, size=size)
    finally:
        timer.cancel()
    # 20 ms on an idle machine.
    assert time.monotonic() - pressed[0] < 0.3
    assert np.array_equal(renderer.render(small, eye, size=small_size).pixels, expected)
    began = time.monotonic()
    with pytest.raises(ss.Cancelled):
        renderer.render(scene, camera, size=size, progress=lambda share: time.monotonic() - began < 0.2)
    assert time.monotonic() - began < 0.5
    assert np.array_equal(renderer.render(small, eye, size=small_size).pixels, expected)


STARVED = """
import ctypes, resource
import numpy as np
import scene_parts
import test_attacks_cpu as attacks
import sheetsplat as ss
scene, camera, size = scene_parts.build(ss, attacks.parts(attacks.cloud(1, 200_000, 30.0), size=(300, 300)))
small, eye, small_size = attacks.busy()
expected = np.array(ss.Renderer("cpu", threads=2).render(scene, camera, size=size))
expected_small = np.array(ss.Renderer("cpu").render(small, eye, size=small_size))
trim = ctypes.CDLL(None).malloc_trim
refused = 0
for room in range(0, 60, 6):
    renderer = ss.Renderer("cpu", threads=2)
    trim(0)
    used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + room * 2**20, resource.RLIM_INFINITY))
    try:
        renderer.render(scene, camera, size=size)
    except ss.OutOfMemory as error:
        refused += 1
        message = str(error)
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY,) * 2)
    assert refused == 0 or "found" in message
    assert np.array_equal(np.asarray(renderer.render(scene, camera, size=size)), expected)
    assert np.array_equal(np.asarray(renderer.render(small, eye, size=small_size)), expected_small)
assert refused >= 2, refused
print("done")
"""


@pytest.mark.slow
def test_memory_that_runs_out_is_an_error_and_no_end() -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[1]), *sys.path])}
    result = subprocess.run(
        [sys.executable, "-c", STARVED], env=environment, capture_output=True, text=True, timeout=300
    )
    assert result.returncode == 0 and result.stdout.strip() == "done", result.stdout + result.stderr


# State kept between pictures


def kept_fields() -> list[ss.Field]:
    def lattice(seed: int, **options: Any) -> ss.RegularField:
        rng = np.random.default_rng(seed)
        values = (rng.random((6, 7, 8)) * (rng.random((6, 7, 8)) > 0.5)).astype(np.float32)
        return ss.RegularField(values, **{"origin": (-1, -1, -1), "spacing": (0.3, 0.3, 0.3), **options})

    return [
        ss.EllipsoidField(**cloud(1)),
        ss.EllipsoidField(**cloud(2)),
        ss.EllipsoidField(**cloud(3, normalization="none")),
        ss.EllipsoidField(np.zeros((0, 3)), np.zeros((0, 3)), values=[]),
        lattice(1),
        lattice(2),
        lattice(1, radius=1.5),
        lattice(1, falloff=3.0),
        lattice(1, spacing=(0.3, 0.25, 0.3)),
        lattice(4, lattice="bcc"),
    ]


CHOICES: dict[str, Callable[[random.Random], Any]] = {
    "fields": lambda chance: chance.choice(
        [[0], [1], [4], [5], [6], [7], [8], [9], [0, 4], [4, 0], [5, 4], [3], [1, 1], [4, 2, 9]]
    ),
    "transfer": lambda chance: chance.choice(
        [
            scene_parts.GENTLE,
            scene_parts.OPAQUE,
            scene_parts.ZERO_SEEN,
            [(0.6, 0, 0, 0, 0), (0.8, 1, 1, 0, 0.5), (1, 1, 1, 1, 0)],
        ]
    ),
    "camera": lambda chance: chance.choice(
        [
            scene_parts.parallel(),
            scene_parts.parallel(height=1.0),
            scene_parts.central(),
            scene_parts.central(distance=0.5),
        ]
    ),
    "lights": lambda chance: chance.choice([[], scene_parts.LIGHTS, scene_parts.LIGHTS[:1]]),
    "size": lambda chance: chance.choice([(70, 66), (66, 70), (20, 130)]),
    "sampling": lambda chance: chance.choice(["point", "slab"]),
    "mode": lambda chance: chance.choice(
        [{}, {"mode": "xray"}, {"mode": "isosurface", "iso_value": 0.3}, {"preintegration": True}]
    ),
    "slice_spacing": lambda chance: chance.choice([1 / 6, 1 / 3]),
    "filter": lambda chance: chance.choice([None, "ewa"]),
    "outputs": lambda chance: chance.choice([(), ("coverage",), ("depth",)]),
}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_frames_do_not_depend_on_those_before(seed: int) -> None:
    """After any change, and after a cancelled frame, pictures equal those of a new renderer to the bit."""
    chance = random.Random(seed)
    fields = kept_fields()
    renderer = ss.Renderer("cpu")
    now = {name: choose(random.Random(0)) for name, choose in CHOICES.items()}
    reused = 0.0
    for _ in range(60):
        for name in chance.sample(list(CHOICES), chance.choice([1, 1, 2])):
            now[name] = CHOICES[name](chance)
        scene = ss.Scene(
            [fields[number] for number in now["fields"]],
            ss.TransferFunction(now["transfer"]),
            lights=[ss.Light(**light) for light in now["lights"]],
            sampling=now["sampling"],
            slice_spacing=now["slice_spacing"],
            filter=now["filter"],
            **now["mode"],
        )
        camera = (ss.Camera.orthographic if "height" in now["camera"] else ss.Camera.perspective)(**now["camera"])
        if chance.random() < 0.1:
            with pytest.raises(ss.Cancelled):
                renderer.render(scene, camera, size=now["size"], progress=lambda share: False)
            continue
        image = renderer.render(scene, camera, size=now["size"], outputs=now["outputs"])
        fresh = ss.Renderer("cpu").render(scene, camera, size=now["size"], outputs=now["outputs"])
        assert np.array_equal(image.pixels, fresh.pixels), now
        assert all(np.array_equal(getattr(image, name), getattr(fresh, name)) for name in now["outputs"])
        reused += image.stats["buckets_reused"]
    assert reused > 5


# Options of other backends


@pytest.mark.parametrize(
    "options",
    [{"precision": name, "allow_inexact": True} for name in ("float16", "uint8")]
    + [{"tagging": "depth_equal"}, {"packing": "paper"}]
    + [{"effects": {name: True}} for name in ("paper_slicing", "fine_gradient", "compensation", "opacity_buffer")],
    ids=str,
)
def test_what_it_has_not_is_refused_and_taken_elsewhere(options: Any) -> None:
    scene, camera, _ = busy()
    with pytest.raises(ss.Unsupported, match="with backend cpu; wanted .*; "):
        ss.Renderer("cpu", **options).plan(scene, camera, size=SIZE)


def test_auto_takes_the_processor_where_there_is_no_graphics_hardware(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, camera, _ = busy()
    monkeypatch.delenv("SHEETSPLAT_BACKEND", raising=False)
    devices = [device for device in ss.devices() if device.backend == "gl" and device.available]
    if all("llvmpipe" in device.description or "softpipe" in device.description for device in devices):
        assert ss.Renderer().plan(scene, camera, size=SIZE).backend == "cpu"
    monkeypatch.setenv("SHEETSPLAT_BACKEND", "cpu")
    assert ss.Renderer().render(scene, camera, size=SIZE).plan.backend == "cpu"
    assert ss.Renderer("reference").plan(scene, camera, size=SIZE).backend == "reference"
    monkeypatch.setenv("SHEETSPLAT_BACKEND", "simd")
    with pytest.raises(ss.InvalidInput, match="SHEETSPLAT_BACKEND.*auto, gl, cpu, reference"):
        ss.Renderer()
