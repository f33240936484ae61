"""Which backend draws a scene that another refuses: `auto` takes it, gl hands it over, or the error names it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from image_checks import FLOAT32, assert_close, handed_over

import sheetsplat as ss

CAMERA = ss.Camera.orthographic(eye=(0, 0, 3), target=(0, 0, 0), height=2.4)
SIZE = (16, 12)
LOOK = [(0.0, 0.1, 0.2, 0.6, 0.0), (1.0, 1.0, 0.9, 0.8, 0.5)]


def kernels(**options: Any) -> ss.EllipsoidField:
    """Return three kernels."""
    return ss.EllipsoidField(
        centers=[(0, 0, 0), (0.3, 0, 0.2), (0, 0.4, -0.3)], scales=np.full(3, 0.6), values=[0.5, 0.9, 0.7], **options
    )


def with_lights(count: int) -> ss.Scene:
    """Return a scene with more lights than shaders have room for."""
    return ss.Scene(kernels(), LOOK, lights=[ss.Light(direction=(0, 0, 1))] * count)


def without_falloff() -> ss.Scene:
    """Return a scene whose kernels neither float32 nor float64 resolves as differences of exponentials."""
    return ss.Scene(kernels(falloff=1e-9, normalization="threshold"), LOOK)


@pytest.mark.gl
def test_what_gl_cannot_draw_is_drawn_by_the_processor() -> None:
    image = ss.Renderer("gl").render(with_lights(80), CAMERA, size=SIZE)
    assert "80 lights" in handed_over(image)
    expected = ss.Renderer("reference").render(with_lights(80), CAMERA, size=SIZE)
    assert_close(image, expected, FLOAT32, "80 lights")


@pytest.mark.gl
@pytest.mark.parametrize(
    "forced", [{"precision": "float32"}, {"packing": "paper"}, {"tagging": "tiles"}, {"effects": {"elimination": True}}]
)
def test_forced_ways_of_gl_are_refused(forced: dict[str, Any]) -> None:
    """With the name of the processor where that has such a way."""
    with pytest.raises(ss.Unsupported, match="found 80 lights; wanted at most 64") as error:
        ss.Renderer("gl", **forced).render(with_lights(80), CAMERA, size=SIZE)
    by_processor = 'backend="cpu", which draws it'
    assert str(error.value).count("backend=") == str(error.value).count(by_processor)
    assert (by_processor in str(error.value)) == ("precision" in forced or "tagging" in forced)


@pytest.mark.parametrize("backend", ["cpu", pytest.param("gl", marks=pytest.mark.gl)])
def test_what_only_the_reference_draws(backend: str) -> None:
    scene = without_falloff()
    with pytest.raises(ss.Unsupported, match='backend="reference", which draws it'):
        ss.Renderer(backend).render(scene, CAMERA, size=SIZE)
    image = ss.Renderer().render(scene, CAMERA, size=SIZE)
    assert image.plan.backend == "reference"
    assert "auto: backend" in image.plan.device
    np.testing.assert_array_equal(image.rgba, ss.Renderer("reference").render(scene, CAMERA, size=SIZE).rgba)


def test_a_way_of_drawing_is_no_matter_of_the_reference() -> None:
    """Where packing is asked for, a backend that has none is not taken silently."""
    with pytest.raises(ss.Unsupported, match="no backend can draw this scene"):
        ss.Renderer(packing="paper").render(without_falloff(), CAMERA, size=SIZE)


def test_float16_is_drawn_by_gl_alone() -> None:
    with pytest.raises(ss.Unsupported) as error:
        ss.Renderer("cpu", precision="float16").render(ss.Scene(kernels(), LOOK), CAMERA, size=SIZE)
    try:
        ss.Renderer("gl", precision="float16").render(ss.Scene(kernels(), LOOK), CAMERA, size=SIZE)
    except (ss.Unsupported, ss.DeviceUnavailable):
        assert "which draws it" not in str(error.value)
    else:
        assert 'backend="gl", which draws it' in str(error.value)
