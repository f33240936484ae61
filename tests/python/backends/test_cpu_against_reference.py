"""The processor's pictures of every regular and scattered scene are the reference's, within section 9."""

from __future__ import annotations

import numpy as np
import pytest
import scattered_scenes
import scene_parts
import test_gl_against_reference as regular
import test_scattered_against_reference as scattered
from image_checks import FLOAT32, FLOAT32_HARD, MOST_AMBIGUOUS, assert_close

import sheetsplat as ss


@pytest.mark.parametrize("case", regular.SCENES, ids=str)
def test_every_regular_scene(case):
    regular.check(case, backend="cpu")


@pytest.mark.parametrize("precision", ["auto", "float64"])
@pytest.mark.parametrize("case", regular.HARD, ids=str)
def test_hard_regular_scenes(case, precision):
    regular.check(case, FLOAT32_HARD, backend="cpu", precision=precision)


@pytest.mark.parametrize("case", [regular.Case(), regular.Case(mode="xray", sampling="slab")], ids=str)
def test_float64_is_the_reference_to_the_last_digits(case):
    scene, camera = regular.make(case)
    image = ss.Renderer("cpu", precision="float64").render(scene, camera, size=regular.SIZE)
    expected = regular.reference(case).pixels
    assert np.abs(image.pixels - expected).max() <= 2e-6 * max(1.0, np.abs(expected).max())


CHANGES = [("culling", False), ("weight", True), ("empty_test", True), ("general_sections", True), ("gradient", True)]
CHANGES += [("specular", True), ("two_sided", True), ("opacity_correction", True)]


@pytest.mark.parametrize("effect", CHANGES, ids=lambda effect: f"{effect[0]}-{'on' if effect[1] else 'off'}")
def test_an_effect_that_was_left_out_changes_nothing_when_forced(effect):
    for case in (regular.Case(lit=False), regular.Case(opaque=True, opacity_stop=0.95)):
        regular.check(case, FLOAT32_HARD, backend="cpu", effects=(effect,))


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("mode", ["minimum", "average"])
def test_slabs_beside_a_kernel_are_empty(mode, precision):
    """Rays that pass a kernel count no slab of it."""
    values = np.random.default_rng(3).random((6, 7, 8)).astype(np.float32)
    scene = ss.Scene(
        [ss.RegularField(values)], ss.TransferFunction([(0, 0, 0, 0, 0), (1, 1, 1, 1, 1)]), mode=mode, sampling="slab"
    )
    camera = ss.Camera.fit(scene, direction=(0.3, 0.5, -1))
    expected = ss.Renderer("reference").render(scene, camera, size=(60, 50))
    image = ss.Renderer("cpu", precision=precision).render(scene, camera, size=(60, 50))
    assert_close(image.scalar, expected.scalar, FLOAT32, f"cpu slab {mode} {precision}")


def test_second_order_shows_what_only_its_cubic_reaches():
    """Between slices in a plateau and beyond its steep ends the cubic rises a quarter above all samples."""
    values = np.full((14, 9, 9), -1.0, np.float32)
    values[4:10] = 1.0
    function = ss.TransferFunction([(1.05, 1, 0.5, 0, 0), (1.1, 1, 0.5, 0, 0.4), (2, 0, 1, 0, 0.4)])
    scene = ss.Scene([ss.RegularField(values)], function, preintegration="second_order", slice_spacing=3.0, lights=())
    camera = ss.Camera.fit(scene, direction=(0, 0, -1))
    expected = ss.Renderer("reference").render(scene, camera, size=(24, 24))
    assert expected.rgba.max() > 0.1
    image = ss.Renderer("cpu").render(scene, camera, size=(24, 24))
    assert_close(image.pixels, expected.pixels, FLOAT32_HARD, "cpu second order above all samples")
    first_order = scene.replace(preintegration=True)
    assert ss.Renderer("reference").render(first_order, camera, size=(24, 24)).rgba.max() == 0.0


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
@pytest.mark.parametrize("boundary", ["edge", "zero"])
def test_second_order_leaves_out_what_no_cubic_can_show(boundary, projection):
    """Signed samples: outer slices count against their sign."""
    values = np.random.default_rng(8).normal(0.0, 0.1, (40, 15, 14)).astype(np.float32)
    values[5:7, 6:9, 5:8] = 1.0
    values[10:12, 3:6, 8:11] = -1.0
    function = ss.TransferFunction([(0.8, 1, 0.5, 0, 0), (0.9, 1, 0.5, 0, 0.6), (2, 0, 1, 0, 0.6)])
    scene = ss.Scene([ss.RegularField(values, boundary=boundary)], function, preintegration="second_order")
    camera = ss.Camera.fit(scene, direction=(0.3, -0.2, -1), kind=projection)
    expected = ss.Renderer("reference").render(scene, camera, size=(40, 40))
    image = ss.Renderer("cpu").render(scene, camera, size=(40, 40))
    assert_close(image.pixels, expected.pixels, FLOAT32_HARD, f"cpu second order {projection}")
    # Mirrored samples are kernels, too.
    kernels = np.prod(np.add(values.shape, 4)) if boundary == "edge" else values.size
    assert image.stats["kernels_drawn"] < kernels / 2


@pytest.mark.parametrize("tile_size", [8, 13, 16])
@pytest.mark.parametrize("case", regular.HARD, ids=str)
def test_tiles_leave_no_seam(case, tile_size):
    whole = regular.check(case, FLOAT32_HARD, backend="cpu")
    pieces = regular.check(case, FLOAT32_HARD, backend="cpu", tile_size=tile_size)
    text = f"cpu pieces of {tile_size} {case}"
    assert_close(pieces.pixels, whole.pixels, FLOAT32, text, regular.ambiguous(case))


def assert_same_depths(depth, expected):
    """Few pixels differ in depth: one at which opacity just reaches one half may take the slice before or after."""
    finite = np.isfinite(depth)
    both = finite & np.isfinite(expected)
    assert (finite != np.isfinite(expected)).mean() <= MOST_AMBIGUOUS
    assert (np.abs(depth[both] - expected[both]) > 1e-3).sum() <= MOST_AMBIGUOUS * both.sum()


@pytest.mark.parametrize(
    "case",
    [
        regular.Case(opacity_stop=0.9),
        regular.Case(projection="perspective", lattice="bcc"),
        regular.Case(mode="isosurface"),
    ],
    ids=str,
)
def test_coverage_and_depth(case):
    scene, camera = regular.make(case)
    expected = regular.reference(case)
    image = ss.Renderer("cpu").render(scene, camera, size=regular.SIZE, outputs=("coverage", "depth"))
    assert_close(image.coverage, expected.coverage, FLOAT32, f"cpu coverage {case}")
    ambiguous = regular.ambiguous(case)
    assert_close(image.pixels, expected.pixels, FLOAT32, f"cpu beside coverage {case}", ambiguous)
    assert np.isfinite(image.depth).any()
    assert_same_depths(image.depth, expected.depth)


@pytest.mark.parametrize("name", scattered_scenes.SCENES)
def test_every_scattered_scene(name):
    scattered.check(name, backend="cpu")


@pytest.mark.parametrize("seed", scattered.RANDOM)
def test_random_scattered_scenes(seed):
    scattered.check(str(seed), backend="cpu")


@pytest.mark.parametrize("options", [{"tile_size": 17}, {"tile_size": 8}, {"precision": "float64"}], ids=str)
@pytest.mark.parametrize("name", scattered.EVERYWHERE)
def test_scattered_scenes_in_tiles_and_float64(name, options):
    scattered.check(name, backend="cpu", **options)


@pytest.mark.parametrize(
    "name", ["weights_over_decades", "opaque_central", "mixed_slabs", "isosurface_parallel", "ewa_slab_central"]
)
def test_coverage_and_depth_of_scattered_scenes(name):
    scene, camera, size = scene_parts.build(ss, scattered.named(name))
    expected = scattered.reference(name)
    image = ss.Renderer("cpu").render(scene, camera, size=size, outputs=("coverage", "depth"))
    assert_close(image.coverage, expected.coverage, scattered.bounds_of(name), f"cpu coverage {name}")
    scattered.compare(name, image, scattered.bounds_of(name), f"cpu beside coverage {name}")
    assert_same_depths(image.depth, expected.depth)


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("pixels_thick", [0.3, 0.2, 0.15, 0.12, 0.1, 0.06, 0.045, 0.03, 0.015])
def test_thin_discs_between_pixels(pixels_thick, precision):
    """The Gaussian of a thin disc falls from row to row by more powers of two than a number has."""
    pixel = 1.6 / 48
    turn = np.array([-0.782, 0.004, -0.303, 0.545])
    axes = [(1.333, 1.333, pixels_thick * pixel)]
    centers, values = [(0.717, 0.276, 0.134)], [0.52]
    field = ss.EllipsoidField(centers, axes, [turn / np.linalg.norm(turn)], values, normalization="none")
    scene = ss.Scene(field, [(0, 0.1, 0.2, 0.9, 0), (1, 1, 0.8, 0.2, 0.8)], slice_spacing=0.03, mode="xray")
    camera = ss.Camera.orthographic((2.0, 1.55, 2.9), (0.5, 0.5, 0.5), height=1.6)
    expected = ss.Renderer("reference").render(scene, camera, size=(56, 48)).scalar
    assert (expected > 1e-4).sum() > 10
    image = ss.Renderer("cpu", precision=precision, allow_inexact=True).render(scene, camera, size=(56, 48))
    assert np.abs(image.scalar - expected).max() < 1e-5
