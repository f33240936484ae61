"""Which backend draws a scene that another refuses: `auto` takes it, and errors of a named backend name it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

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
def test_a_refusal_of_gl_names_cpu() -> None:
    with pytest.raises(ss.Unsupported, match='backend="cpu", which draws it') as error:
        ss.Renderer("gl").render(with_lights(80), CAMERA, size=SIZE)
    assert str(error.value).count("backend=") == 1
    image = ss.Renderer("cpu").render(with_lights(80), CAMERA, size=SIZE)
    assert image.plan.backend == "cpu"


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
