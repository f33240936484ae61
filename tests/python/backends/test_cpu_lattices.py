"""Lattices on the processor in every way that their kernels are drawn, from smaller than a pixel to larger than a tile:
as products that are upright or lean, walked along columns, and filtered."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from image_checks import FLOAT32_HARD, assert_close

import sheetsplat as ss

SIZE = (70, 58)
SPACINGS = [(1.0, 1.0, 1.0), (1.0, 1.0, 2.0), (0.6, 1.7, 1.0), (1.0, 30.0, 1.0), (1.0, 1.0, 1000.0)]
# Of a sample distance.
PIXELS = [3.0, 0.5, 0.11, 0.02]
COLORS = [(0, 1, 0.2, 0.1, 0), (0.3, 0.2, 1, 0.3, 0.1), (1, 0.1, 0.3, 1, 0.6)]


def volume():
    z, y, x = np.indices((7, 8, 9))
    ball = np.exp(-((x - 4.2) ** 2 + (y - 3.3) ** 2 + (z - 3.1) ** 2) / 7.0)
    return ball + 0.1 * np.random.default_rng(3).random(ball.shape)


def shot(spacing, projection, pixel, **options):
    """A lattice seen askew, with pixels of `pixel` of its shortest sample distances where it is."""
    field = ss.RegularField(volume(), spacing=spacing)
    lit = ss.Light((0.3, 0.5, 1.0))
    # Of the longest kernels some hundred slices.
    slices = max(0.4 * min(spacing), 0.0133 * max(spacing))
    scene = ss.Scene(field, COLORS, lights=[lit], slice_spacing=slices, **options)
    middle = 0.5 * np.array([8.0, 7.0, 6.0]) * spacing
    to_eye = np.array([0.5, 0.35, 0.79])
    height = pixel * min(spacing) * SIZE[1]
    if projection == "orthographic":
        return scene, ss.Camera.orthographic(tuple(middle + 50.0 * to_eye), tuple(middle), height=height)
    # From inside where pixels are small, so that kernels next to the eye are drawn too.
    distance = max(height, 1.5 * min(spacing))
    angle = 2.0 * np.degrees(np.arctan(0.5 * height / distance))
    return scene, ss.Camera.perspective(
        tuple(middle + distance * to_eye), tuple(middle), fov_y=float(angle), near=0.05 * distance
    )


def check(scene, camera, text):
    expected = ss.Renderer("reference").render(scene, camera, size=SIZE).pixels
    image = ss.Renderer("cpu", threads=1).render(scene, camera, size=SIZE)
    assert_close(image.pixels, expected, FLOAT32_HARD, text)
    assert np.array_equal(ss.Renderer("cpu", threads=2).render(scene, camera, size=SIZE).pixels, image.pixels)
    return expected


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
@pytest.mark.parametrize("spacing", SPACINGS, ids=str)
def test_every_spacing_and_size(spacing, projection):
    seen = 0.0
    for pixel, filtered in product(PIXELS, ("off", "ewa")):
        scene, camera = shot(spacing, projection, pixel, filter=filtered)
        expected = check(scene, camera, f"cpu lattice of {spacing}, {projection}, pixels of {pixel}, filter {filtered}")
        seen = max(seen, float(expected.max()))
    assert seen > 0.1


@pytest.mark.parametrize("spacing", SPACINGS[:3], ids=str)
def test_what_a_filtered_lattice_does_not_show_is_left_out_and_nothing_else(spacing):
    # Samples around it that are not 0, too low to be seen, and some of them too far from what is.
    field = ss.RegularField(np.pad(volume(), 12, constant_values=0.3), spacing=spacing)
    middle = tuple(np.array([16.0, 15.5, 15.0]) * spacing)
    camera = ss.Camera.orthographic((9.0, 8.0, 12.0) + np.array(middle), middle, height=60.0)
    steps = [(0.0, 1, 1, 1, 0), (0.75, 1, 1, 1, 0), (0.75, 1, 0.5, 0.2, 0.8), (2.0, 0.2, 0.5, 1, 0.8)]
    scene = ss.Scene(field, steps, filter="ewa")
    culled = ss.Renderer("cpu").render(scene, camera, size=SIZE)
    all_drawn = ss.Renderer("cpu", effects={"culling": False}).render(scene, camera, size=SIZE)
    assert np.abs(culled.pixels - all_drawn.pixels).max() <= 1e-6
    assert culled.stats["kernels_culled"] > 0


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
def test_filtered_lattices_stay_lattices(projection):
    scene, camera = shot(SPACINGS[0], projection, 1.0, filter="ewa")
    effects = {effect.name: effect.on for effect in ss.Renderer("cpu").plan(scene, camera, size=SIZE).effects}
    assert effects["ewa_filter"]
    assert not effects["scattered_kernels"]


@pytest.mark.parametrize("level", [0.9, 1.02, 1.1, 1.25])
def test_filtered_lattices_in_perspective_lose_no_kernel_that_shows(level):
    """Widths grow with depth, so that sums of equal samples rise above them: what is left out shows nowhere."""
    field = ss.RegularField(np.ones((7, 8, 9)))
    scene = ss.Scene(field, COLORS, mode="isosurface", iso_value=level, filter="ewa", slice_spacing=0.4)
    camera = ss.Camera.perspective((4.1, 3.4, 9.0), (4.0, 3.5, 3.0), fov_y=100.0, near=0.1)
    pictures = [
        ss.Renderer("cpu", effects={"culling": on}).render(scene, camera, size=(24, 20)).pixels for on in (True, False)
    ]
    assert np.array_equal(*pictures)
