"""Pre-integration of transfer functions of many stretches, on the processor: the reference's intervals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from image_checks import FLOAT32_HARD, assert_close, distance

import sheetsplat as ss

SIZE = (44, 40)
CAMERA = ss.Camera.orthographic((40.0, 30.0, 60.0), (7.5, 7.5, 7.5), (0.1, 1.0, 0.0), height=22.0)


def volume() -> ss.RegularField:
    random = np.random.default_rng(4)
    waves = np.sin(np.mgrid[0:16, 0:16, 0:16] * 0.7).prod(axis=0)
    return ss.RegularField((0.5 + 0.4 * waves + 0.05 * random.uniform(size=waves.shape)).astype(np.float32))


def function(kind: str) -> ss.TransferFunction:
    """Return a transfer function of many points: of small changes, of teeth up to full opacity, or with steps."""
    random = np.random.default_rng(7)
    values = np.linspace(0.1, 0.9, 24)
    opacities = {
        "smooth": np.linspace(0.0, 0.9, 24) ** 2,
        "teeth": np.where(np.arange(24) % 6 == 3, 1.0, 0.02),
        "steps": np.repeat(random.uniform(0.0, 0.6, 12), 2),
    }[kind]
    if kind == "steps":
        values = np.concatenate([values[:1], np.repeat(values[2::2], 2), values[-1:]])
    colors = random.uniform(size=(24, 3))
    return ss.TransferFunction([(v, *c, a) for v, c, a in zip(values, colors, opacities, strict=True)])


def scene(kind: str, order: Any, **options: Any) -> ss.Scene:
    lights = [ss.Light((0.3, 0.4, 1.0))]
    return ss.Scene(volume(), function(kind), lights=lights, preintegration=order, slice_spacing=1.0, **options)


@pytest.mark.parametrize("kind", ["smooth", "teeth", "steps"])
@pytest.mark.parametrize("order", [True, "second_order"])
def test_intervals_are_the_references(order, kind):
    drawn = scene(kind, order)
    expected = ss.Renderer("reference").render(drawn, CAMERA, size=SIZE).pixels
    for precision, bounds in (("float32", FLOAT32_HARD), ("float64", (1e-7, 1e-6))):
        image = ss.Renderer("cpu", precision=precision, allow_inexact=True).render(drawn, CAMERA, size=SIZE)
        assert_close(image.pixels, expected, bounds, f"{kind} {order} {precision}")
    other = drawn.replace(preintegration=order is True and "second_order")
    assert distance(ss.Renderer("cpu").render(other, CAMERA, size=SIZE).pixels, expected).rmse > 1e-3


def test_values_at_and_beyond_the_last_point():
    """Of volumes that are nearly one value, at and around the values of points."""
    points = function("teeth")
    for value in (-1.0, 0.1, float(points.points[3][0]), 0.9, 7.0):
        flat = ss.RegularField(np.full((10, 10, 10), value, np.float32))
        drawn = ss.Scene(flat, points, lights=[], preintegration="second_order", slice_spacing=1.0)
        camera = ss.Camera.fit(drawn, direction=(-0.3, -0.4, -1.0))
        expected = ss.Renderer("reference").render(drawn, camera, size=SIZE).pixels
        assert_close(ss.Renderer("cpu").render(drawn, camera, size=SIZE).pixels, expected, FLOAT32_HARD, f"{value}")


def block(around: str, boundary: str) -> ss.RegularField:
    """Return a block of ones that ends in nothing, or in samples of 0 on all sides."""
    ones = np.ones((6, 6, 6), np.float32)
    if around == "nothing":
        return ss.RegularField(ones, origin=(5.0, 5.0, 5.0), boundary=boundary)
    return ss.RegularField(np.pad(ones, 4), origin=(1.0, 1.0, 1.0), boundary=boundary)


@pytest.mark.parametrize("order", [True, "second_order"])
@pytest.mark.parametrize("cut", ["clip", "depth limit"])
@pytest.mark.parametrize("boundary", ["edge", "zero"])
def test_ends_of_cut_intervals_are_empty_where_no_kernel_reaches(boundary, order, cut, reference_renderer):
    """An interval with one end cut off shows where a kernel reaches the other, if only one of value 0."""
    middle, view = np.full(3, 7.5), np.array([-0.6, -0.4, -0.9])
    view /= np.linalg.norm(view)
    camera = ss.Camera.orthographic(tuple(middle - 40 * view), tuple(middle), height=16.0)
    pictures = {}
    for around in ("nothing", "zeros"):
        options: dict[str, Any] = {"preintegration": order, "slice_spacing": 2.5, "reference_length": 1.0}
        limit: dict[str, Any] = {}
        if cut == "clip":
            normal = -view + [0.3, -0.2, 0.1]
            options["clip"] = ss.Clip(planes=[(tuple(normal), float(normal @ middle) + 2.5)])
        else:
            limit["depth_limit"] = 36.0 + 0.2 * np.add.outer(np.arange(SIZE[1]), np.arange(SIZE[0])) % 9.0
        drawn = ss.Scene(
            block(around, boundary),
            ss.TransferFunction([(0.2, 0.9, 0.5, 0.2, 0.0), (1.1, 0.3, 0.6, 0.9, 0.4)]),
            **options,
        )
        expected = reference_renderer.render(drawn, camera, size=SIZE, **limit)
        image = ss.Renderer("cpu").render(drawn, camera, size=SIZE, **limit)
        assert_close(image.pixels, expected.pixels, FLOAT32_HARD, f"{order} {cut} {around}")
        # Samples of 0 are not drawn for it; mirrored ones are.
        assert image.stats["kernels_drawn"] <= (10**3 if (around, boundary) == ("nothing", "edge") else 6**3)
        pictures[around] = expected.pixels
    assert distance(pictures["nothing"], pictures["zeros"]).rmse > 1e-3
