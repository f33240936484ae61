"""Scattered ellipsoids: every path of the OpenGL backend gives the picture of the reference (section 9)."""

from __future__ import annotations

import copy
import itertools
import os
import subprocess
import sys
from functools import cache, lru_cache
from typing import Any

import numpy as np
import oracle
import pytest
import scattered_scenes as scattered
import scene_parts
from image_checks import (
    FLOAT16,
    FLOAT32,
    FLOAT32_HARD,
    MOST_AMBIGUOUS,
    assert_close,
    handed_over,
    log,
    off_by,
    within,
)
from numpy.typing import NDArray
from oracle.kernels import turned as rotations_of
from random_scenes import random_ellipsoid_scene
from reference_pictures import ambiguous_pixels, by_reference, may_jump
from scene_parts import Parts

import sheetsplat as ss

pytestmark = pytest.mark.gl

PATHS = list(itertools.product(("wide", "paper"), ("tiles", "depth_equal", "off")))
RANDOM = range(120)
# Scenes that OpenGL leaves to the processor, and why.
HANDED_OVER = {
    "values_with_offset": "the transfer function distinguishes",
    "38": "a lit close-up",
    "40": "a lit close-up",
}
Bounds = tuple[float, float]


@cache
def named(name: str) -> Parts:
    """Return a scene by its name, or by the number of a random one."""
    return random_ellipsoid_scene(int(name)) if name.isdigit() else scattered.named(name)


@lru_cache(maxsize=32)
def renderer(**options: Any) -> ss.Renderer:
    """Return a renderer of its own for each set of options."""
    effects = dict(options.pop("effects", ()))
    return ss.Renderer(options.pop("backend", "gl"), effects=effects, **options)


@cache
def reference(name: str) -> ss.Image:
    """Return the reference's picture of a scene."""
    return by_reference(named(name), ("coverage", "depth"))


@cache
def bounds_of(name: str) -> Bounds:
    """Return the bounds of section 9 that hold for 32-bit numbers."""
    return FLOAT32 if oracle.is_gentle(*scene_parts.build(oracle, named(name))) else FLOAT32_HARD


@cache
def ambiguous(name: str) -> NDArray[np.bool_] | None:
    """Return the pixels whose reference jumps under the nudges of section 9, or None where nothing can jump."""
    return ambiguous_pixels(named(name), reference(name).rgba) if may_jump(named(name)) else None


def compare(name: str, actual: ss.Image, bounds: Bounds, text: str) -> None:
    """Fail where a picture is farther from the scene's reference than the bounds allow.

    Ambiguous pixels are looked for, counted and left out only where the picture is farther with them.
    """
    found = off_by(actual, reference(name))
    if within(found, bounds):
        log.info(
            f"{text}: RMSE {found['rmse']:.3g} (at most {bounds[0]:.3g}), P99.9 {found['p99_9']:.3g} (at most "
            f"{bounds[1]:.3g}), maximum {found['maximum']:.3g}"
        )
        return
    jumping = ambiguous(name)
    pixels = np.array(actual.pixels)
    if jumping is not None and jumping.size * MOST_AMBIGUOUS < 1 and jumping.sum() == 1:
        # Of a picture this small one pixel is more than the share that is allowed.
        log.info(f"{text}: one ambiguous pixel of {jumping.size}")
        pixels[jumping] = reference(name).pixels[jumping]
        jumping = None
    assert_close(pixels, reference(name).pixels, bounds, text, jumping)


def check(name: str, **options: Any) -> ss.Image:
    """Compare the picture of a renderer with these options with the reference."""
    scene, camera, size = scene_parts.build(ss, named(name))
    backend = options.get("backend", "gl")
    reason = HANDED_OVER.get(name, "") if backend == "gl" else ""
    if reason and options:
        with pytest.raises(ss.Unsupported, match=reason):
            renderer(**options).render(scene, camera, size=size)
        options = {}
    image = renderer(**options).render(scene, camera, size=size)
    assert image.plan.backend == ("cpu" if reason else backend) and reason in handed_over(image)
    bounds = FLOAT16 if image.plan.precision == "float16" else bounds_of(name)
    text = f"{image.plan.backend} {name} {' '.join(f'{option}={value}' for option, value in options.items())}"
    compare(name, image, bounds, text)
    return image


@pytest.mark.parametrize(("number", "name"), list(enumerate(scattered.SCENES)), ids=lambda part: str(part))
def test_every_scene(number: int, name: str) -> None:
    """Every scene takes the path that auto chooses and one of the others in turn."""
    check(name)
    packing, tagging = PATHS[number % len(PATHS)]
    check(name, packing=packing, tagging=tagging)


@pytest.mark.parametrize("seed", RANDOM)
def test_random_scenes(seed: int) -> None:
    """Everything mixed, in small pictures."""
    packing, tagging = PATHS[seed % len(PATHS)]
    check(str(seed), packing=packing, tagging=tagging)


EVERYWHERE = [
    "count_1000_parallel",
    "aspect_1000_central",
    "sizes_over_decades_central",
    "weights_of_zero_seen",
    "near_plane_cuts",
    "mixed_lattices_and_ellipsoids",
    "several_thresholds",
    "isosurface_central",
    "opaque_parallel",
    "opaque_central",
    "preintegration_slab_central",
    "step_parallel",
    "xray_slab_central",
    "mip_parallel",
    "ewa_central",
]


@pytest.mark.parametrize(("packing", "tagging"), PATHS)
@pytest.mark.parametrize("name", EVERYWHERE)
def test_every_path(name: str, packing: str, tagging: str) -> None:
    check(name, packing=packing, tagging=tagging)


@pytest.mark.parametrize(("packing", "tagging"), [("wide", "tiles"), ("paper", "depth_equal")])
@pytest.mark.parametrize("name", EVERYWHERE)
def test_small_tiles_leave_no_seam(name: str, packing: str, tagging: str) -> None:
    check(name, packing=packing, tagging=tagging, tile_size=25, tags_per_clear=3)


@pytest.mark.parametrize("packing", ["wide", "paper"])
@pytest.mark.parametrize("name", ["opaque_parallel", "opaque_central", "isosurface_parallel"])
def test_keeping_what_cannot_be_seen_changes_nothing(name: str, packing: str) -> None:
    check(name, packing=packing, effects=(("elimination", False), ("culling", False)))


ALONE = """
import test_scattered_against_reference as tests
for name in {names}:
    for packing in ("wide", "paper"):
        image = tests.check(name, packing=packing, tagging={tagging!r})
        assert {driver!r} in image.plan.device and image.plan.tagging == {tagging!r}, image.plan
print("done")
"""


def check_alone(names: list[str], driver: str, tagging: str, **variables: str) -> None:
    """Check scenes in a process with these environment variables."""
    environment = {**os.environ, **variables, "PYTHONPATH": os.pathsep.join(sys.path)}
    code = ALONE.format(names=names, driver=driver, tagging=tagging)
    result = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert result.returncode == 0 and result.stdout.strip() == "done", result.stdout + result.stderr


@pytest.mark.slow
def test_depth_bounds_on_a_rasteriser_that_has_them() -> None:
    """Mesa's softpipe has the depth bounds test, which llvmpipe lacks."""
    probe = "import sheetsplat as ss; print([d.description for d in ss.devices()])"
    environment = {**os.environ, "GALLIUM_DRIVER": "softpipe", "PYTHONPATH": os.pathsep.join(sys.path)}
    found = subprocess.run([sys.executable, "-c", probe], env=environment, capture_output=True, text=True)
    if "softpipe" not in found.stdout:
        pytest.skip(f"no softpipe here: {found.stdout}")
    names = ["count_10_parallel", "size_7x33", "12", "24", "67"]
    check_alone(names, "softpipe", "depth_bounds", GALLIUM_DRIVER="softpipe")


@pytest.mark.slow
def test_drivers_report_nothing_of_programs_they_have_not_kept() -> None:
    """A driver that finds a program in its cache does not compile it again, and so reports nothing."""
    names = ["slab_parallel", "preintegration_slab_central", "mixed_slabs", "opaque_central", "aspect_1000_central"]
    check_alone(names, "", "tiles", MESA_SHADER_CACHE_DISABLE="true", MESA_GLSL_CACHE_DISABLE="true")


@pytest.mark.parametrize("packing", ["wide", "paper"])
@pytest.mark.parametrize(
    "name", ["weights_over_decades", "opaque_central", "mixed_slabs", "isosurface_parallel", "ewa_slab_central"]
)
def test_coverage_and_depth(name: str, packing: str) -> None:
    scene, camera, size = scene_parts.build(ss, named(name))
    expected = reference(name)
    image = renderer(packing=packing, tagging="tiles").render(scene, camera, size=size, outputs=("coverage", "depth"))
    assert_close(image.coverage, expected.coverage, bounds_of(name), f"coverage {name} {packing}")
    compare(name, image, bounds_of(name), f"beside coverage {name} {packing}")
    finite = np.isfinite(image.depth)
    both = finite & np.isfinite(expected.depth)
    assert (finite != np.isfinite(expected.depth)).mean() <= MOST_AMBIGUOUS
    # A pixel at which opacity just reaches one half may take the slice before or after.
    assert (np.abs(image.depth[both] - expected.depth[both]) > 1e-3).mean() <= MOST_AMBIGUOUS


# Changes that leave the picture as it is


def in_another_order(parts: Parts, rng: np.random.Generator) -> None:
    """Shuffle the kernels."""
    for field in parts["fields"]:
        order = rng.permutation(len(field["centers"]))
        for name in ("centers", "scales", "rotations", "values"):
            field[name] = field[name][order]


def in_halves(parts: Parts, rng: np.random.Generator) -> None:
    """Lay two kernels of half the weight in the place of one."""
    for field in parts["fields"]:
        weights = np.full(len(field["centers"]), 0.5)
        for name in ("centers", "scales", "rotations", "values"):
            field[name] = np.concatenate([field[name]] * 2)
        field["weights"] = np.concatenate([weights] * 2)


def elsewhere(parts: Parts, rng: np.random.Generator) -> None:
    """Move the world by what float64 holds exactly."""
    move = np.array([1024.0, -4096.0, 2048.0])
    for field in parts["fields"]:
        field["centers"] = field["centers"] + move
    for name in ("eye", "target"):
        parts["camera"][name] = tuple((np.asarray(parts["camera"][name]) + move).tolist())


def larger(parts: Parts, rng: np.random.Generator) -> None:
    """Scale the world by a power of two."""
    by = 2.0**20
    for field in parts["fields"]:
        field["centers"] = field["centers"] * by
        field["scales"] = field["scales"] * by
    for name in ("eye", "target"):
        parts["camera"][name] = tuple((np.asarray(parts["camera"][name]) * by).tolist())
    if "height" in parts["camera"]:
        parts["camera"]["height"] *= by
    parts["scene"]["slice_spacing"] *= by


def other_axes(parts: Parts, rng: np.random.Generator) -> None:
    """Give a kernel's axes in another order and handedness: the ellipsoid is the same."""
    for field in parts["fields"]:
        frames = rotations_of(field["rotations"])
        frames = np.stack([frames[:, :, 2], frames[:, :, 1], -frames[:, :, 0]], -1)
        field["rotations"], field["scales"] = frames, field["scales"][:, ::-1]


SAME = {change.__name__: change for change in (in_another_order, in_halves, elsewhere, larger, other_axes)}


@pytest.mark.parametrize("change", SAME)
@pytest.mark.parametrize("name", ["aspect_20_parallel", "count_1000_central"])
def test_what_changes_nothing(name: str, change: str) -> None:
    parts = copy.deepcopy(named(name))
    SAME[change](parts, np.random.default_rng(5))
    scene, camera, size = scene_parts.build(ss, parts)
    for packing in ("wide", "paper"):
        image = renderer(packing=packing, tagging="tiles").render(scene, camera, size=size)
        compare(name, image, bounds_of(name), f"{name} {change} {packing}")


# Negative controls


def turned_a_little(parts: Parts) -> None:
    parts["fields"][0]["rotations"] = scene_parts.unit(parts["fields"][0]["rotations"] + 2e-3)


def wider(parts: Parts) -> None:
    parts["fields"][0]["scales"] = 1.001 * parts["fields"][0]["scales"]


def shifted(parts: Parts) -> None:
    parts["fields"][0]["centers"] = parts["fields"][0]["centers"] + 1e-3


def one_left_out(parts: Parts) -> None:
    for name in ("centers", "scales", "rotations", "values"):
        parts["fields"][0][name] = parts["fields"][0][name][1:]
    # The anchor of the slices stays where it was, so that nothing but the kernel is missing.
    assert not (np.ptp(parts["fields"][0]["centers"], axis=0) < 1).any()


def of_another_threshold(parts: Parts) -> None:
    parts["fields"][0]["w0"] = 1.005 * parts["fields"][0].get("w0", 1.0)


def of_another_falloff(parts: Parts) -> None:
    parts["fields"][0]["falloff"] = 8.02


def brighter(parts: Parts) -> None:
    parts["fields"][0]["values"] = 1.001 * parts["fields"][0]["values"]


def in_slabs(parts: Parts) -> None:
    parts["scene"]["sampling"] = "slab"


def filtered(parts: Parts) -> None:
    parts["scene"]["filter"] = "ewa"


def finer(parts: Parts) -> None:
    parts["scene"] |= {"slice_spacing": 0.99 / 12, "reference_length": None}


def unlit(parts: Parts) -> None:
    parts["lights"] = []


WRONG = {
    change.__name__: change
    for change in (
        turned_a_little,
        wider,
        shifted,
        one_left_out,
        of_another_threshold,
        of_another_falloff,
        brighter,
        in_slabs,
        filtered,
        finer,
        unlit,
    )
}


@pytest.mark.parametrize("change", WRONG)
def test_pictures_that_are_wrong_by_a_little_fail(change: str) -> None:
    """The bounds tell scenes apart that differ by a thousandth: negative control of every test above."""
    name = "aspect_20_parallel"
    parts = copy.deepcopy(named(name))
    WRONG[change](parts)
    scene, camera, size = scene_parts.build(ss, parts)
    image = renderer().render(scene, camera, size=size)
    found = off_by(image, reference(name))
    assert not within(found, bounds_of(name)), found


@pytest.mark.slow
def test_scenes_are_gentle_where_they_should_be_and_show_something() -> None:
    """Most scenes are held to the tighter bound, and all but two have something in their picture."""
    names = list(scattered.SCENES)
    assert np.mean([bounds_of(name) == FLOAT32 for name in names]) > 0.7
    empty = {name for name in names if np.ptp(reference(name).pixels.reshape(-1)) < 1e-3}
    assert empty - {"size_1x1"} == {"behind_the_eye"}


def test_a_scene_is_the_same_at_every_call() -> None:
    for name in ("count_100_parallel", "ewa_central"):
        once, again = scattered.named(name), scattered.named(name)
        for one, other in zip(once["fields"], again["fields"], strict=True):
            assert one.keys() == other.keys()
            assert all(np.array_equal(one[key], other[key]) for key in one)
