"""Slab sampling of kernels that lean, on the processor: the reference's means, however thick the slabs are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from image_checks import FLOAT32, assert_close, distance

import sheetsplat as ss

SIZE = (44, 40)
CAMERA = ss.Camera.orthographic((3.0, 2.0, 6.0), (0.0, 0.0, 0.0), (0.1, 1.0, 0.0), height=3.4)
GENTLE = ss.TransferFunction([(0.0, 0.1, 0.2, 0.9, 0.0), (0.6, 0.8, 0.5, 0.1, 0.1), (1.2, 1.0, 0.9, 0.8, 0.3)])


def leaning(falloff: float, normalization: Any, longest: float = 0.9) -> ss.EllipsoidField:
    """Return ellipsoids of aspects to 1:8 in all directions, with values that change from place to place."""
    random = np.random.default_rng(44)
    count = 60
    scales = longest * 8.0 ** -random.uniform(0.0, 1.0, (count, 3))
    centers = random.uniform(-0.9, 0.9, (count, 3))
    values = 0.6 + 0.3 * np.sin(2.0 * centers[:, 0]) + 0.2 * random.uniform(size=count)
    turns = random.normal(size=(count, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    return ss.EllipsoidField(centers, scales, turns, values, normalization=normalization, falloff=falloff)


def scene(field: ss.EllipsoidField, spacing: float, **options: Any) -> ss.Scene:
    options = {"sampling": "slab", "lights": [ss.Light((0.3, 0.4, 1.0))], **options}
    return ss.Scene(field, GENTLE, slice_spacing=spacing, reference_length=0.25, **options)


@pytest.mark.parametrize("normalization", ["threshold", "none"])
@pytest.mark.parametrize("falloff", [3.0, 8.0, 11.0])
def test_means_are_the_references(falloff, normalization):
    field = leaning(falloff, normalization)
    for spacing in (0.03, 0.1, 0.3, 1.0):
        drawn = scene(field, spacing)
        expected = ss.Renderer("reference").render(drawn, CAMERA, size=SIZE).pixels
        for precision, bounds in (("float32", FLOAT32), ("float64", (1e-7, 1e-6))):
            image = ss.Renderer("cpu", precision=precision, allow_inexact=True).render(drawn, CAMERA, size=SIZE)
            assert_close(image.pixels, expected, bounds, f"slabs of {spacing}, falloff {falloff}, {precision}")
    points = ss.Renderer("cpu").render(drawn.replace(sampling="point"), CAMERA, size=SIZE).pixels
    assert distance(points, expected).rmse > 1e-3


def test_what_is_reached_is_not_empty():
    """Opacity above 0 at rho = 0 shows where supports end, in both precisions."""
    function = ss.TransferFunction([(0.0, 0.2, 0.3, 0.9, 0.05), (1.2, 1.0, 0.9, 0.8, 0.3)])
    for spacing in (0.1, 0.4):
        drawn = scene(leaning(8.0, "threshold", 0.5), spacing, lights=[]).replace(transfer_function=function)
        expected = ss.Renderer("reference").render(drawn, CAMERA, size=SIZE).pixels
        for precision in ("float32", "float64"):
            image = ss.Renderer("cpu", precision=precision, allow_inexact=True).render(drawn, CAMERA, size=SIZE)
            different = np.abs(image.pixels - expected).max(axis=2) > 1e-3
            # (Rays that touch a support are ambiguous.)
            assert np.count_nonzero(different) <= 0.005 * different.size
        assert np.count_nonzero(expected[..., 3] == 0.0) > 100


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_threads_and_tiles_change_nothing(precision):
    drawn = scene(leaning(8.0, "threshold"), 0.1)

    def draw(**options: Any) -> Any:
        renderer = ss.Renderer("cpu", precision=precision, allow_inexact=True, **options)
        return renderer.render(drawn, CAMERA, size=(90, 70)).pixels

    one = draw(threads=1)
    assert np.array_equal(one, draw(threads=3))
    for edge in (17, 33):
        assert_close(draw(tile_size=edge), one, FLOAT32, f"tiles of {edge}, {precision}")
