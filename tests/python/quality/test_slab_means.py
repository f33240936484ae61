"""Means over slabs on backend `cpu`: slabs from far thinner than the kernels to far thicker, in every kind of view."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from image_checks import off_by, within

import sheetsplat as ss

# Slice distances over the radius of a kernel: slabs are a series, a difference of integrals, or all of a ray's chord.
THICKNESSES = (0.004, 0.03, 0.08, 0.1, 0.2, 0.5, 1.1, 4.0)
# Polynomials stand for the integral up to 8.
FALLOFFS = (0.5, 5.0, 8.0, 30.0)
RADIUS = 0.25
# A twentieth of what section 9 allows, and at the worst pixels a tenth: such scenes have next to nothing but the
# rounding of means, and of quotients whose light shows it.
ROUNDING = (1e-6, 2e-5)
VIEWS = ("orthographic", "perspective", "near")


def _camera(view: str) -> ss.Camera:
    if view == "orthographic":
        return ss.Camera.orthographic((0.5, 0.4, 1.0), (0, 0, 0), height=1.8)
    distance = 3.0 if view == "perspective" else 0.9
    return ss.Camera.perspective((0.5 * distance, 0.3 * distance, 0.8 * distance), (0, 0, 0), fov_y=40.0)


def _field(aspect: float, falloff: float, normalization: Any) -> ss.EllipsoidField:
    rng = np.random.default_rng(7)
    count = 5
    turns = rng.normal(size=(count, 4))
    scales = np.tile([RADIUS, RADIUS * aspect**-0.5, RADIUS / aspect], (count, 1))
    return ss.EllipsoidField(
        rng.uniform(-0.3, 0.3, (count, 3)),
        scales[:, 0] if aspect == 1 else scales,
        None if aspect == 1 else turns / np.linalg.norm(turns, axis=1, keepdims=True),
        values=rng.uniform(0.3, 1.0, count),
        normalization=normalization,
        falloff=falloff,
        w0=0.3,
    )


def _scene(field: ss.EllipsoidField, thickness: float, **options: Any) -> ss.Scene:
    # Of few slices, so that float32 is enough for gradients; the picture stays as transparent.
    reference = min(0.5, 6 * thickness)
    some, most = (1 - (1 - opacity) ** (2 * reference) for opacity in (0.1, 0.3))
    function = ss.TransferFunction([(0, 0.1, 0.3, 0.9, 0), (0.4, 0.2, 0.8, 0.3, some), (1, 1, 0.4, 0.2, most)])
    return ss.Scene(
        field,
        function,
        sampling="slab",
        slice_spacing=thickness * RADIUS,
        reference_length=reference * RADIUS,
        lights=[ss.Light()],
        opacity_stop=1.0,
        **options,
    )


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("gradient", ["sheets", "analytic"])
@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("thickness", THICKNESSES)
def test_slabs_of_any_thickness_are_the_references(thickness: float, view: str, gradient: str, precision: Any) -> None:
    renderers = ss.Renderer("reference"), ss.Renderer("cpu", precision=precision, allow_inexact=True)
    wrong = {}
    for aspect, falloff in ((1.0, 5.0), (6.0, 8.0), (2.0, FALLOFFS[int(1000 * thickness) % 4])):
        for normalization in ("none", "threshold"):
            scene = _scene(_field(aspect, falloff, normalization), thickness, gradient=gradient)
            expected, found = (renderer.render(scene, _camera(view), size=(26, 22)) for renderer in renderers)
            assert np.array(expected.pixels)[..., 3].max() > 0.02
            distance = off_by(found, expected)
            if not within(distance, ROUNDING):
                wrong[aspect, falloff, normalization] = distance
    assert not wrong, wrong


@pytest.mark.parametrize("backend", ["cpu", pytest.param("gl", marks=pytest.mark.gl)])
@pytest.mark.parametrize("weight", [0.0, 1e-25])
@pytest.mark.parametrize("slabs", [2, 6, 40])
@pytest.mark.parametrize("past", [1e-4, 1e-3])
def test_a_slab_that_a_support_only_just_meets_is_not_empty(
    past: float, slabs: int, weight: float, backend: Any
) -> None:
    """Opacity above 0 at 0 shows it, whatever the kernel weighs: weights times means are not rounded to 0."""
    field = ss.EllipsoidField([[0, 0, 0], [9, 0, 0]], 1.0, values=np.ones(2), weights=np.array([weight, 1.0]))
    function = ss.TransferFunction([(0, 0.2, 0.3, 0.9, 0.1), (1, 0.2, 0.3, 0.9, 0.1)])
    spacing = (1.0 - past) / slabs
    scene = ss.Scene(
        field, function, sampling="slab", slice_spacing=spacing, reference_length=spacing, opacity_stop=1.0
    )
    camera = ss.Camera.orthographic((0, 0, 3), (0, 0, 0), height=1e-3)
    expected, found = (ss.Renderer(name).render(scene, camera, size=(3, 3)) for name in ("reference", backend))
    # One slab at each end that the support leaves after `past`.
    np.testing.assert_allclose(expected.pixels[..., 3], 1 - 0.9 ** (2 * slabs + 2), rtol=1e-6)
    np.testing.assert_allclose(found.pixels, expected.pixels, atol=1e-6)


@pytest.mark.parametrize("backend", ["reference", "cpu"])
@pytest.mark.parametrize("falloff", [8.0, 40.0, 78.0])
def test_slabs_that_meet_the_tail_of_a_kernel_alone_count(falloff: float, backend: Any) -> None:
    """Of six slabs the outermost weigh as little as exp(-0.64 k)."""
    field = ss.EllipsoidField([(0.0, 0.0, 0.0)], 1.0, values=[2.0], falloff=falloff, normalization="none", base=2.0)
    scene = ss.Scene(field, [(0, 0, 0, 0, 0), (1, 1, 1, 1, 1)], mode="xray", sampling="slab", slice_spacing=0.4)
    image = ss.Renderer(backend).render(scene, ss.Camera.orthographic((0, 0, 5), (0, 0, 0), height=1e-3), size=(2, 2))
    np.testing.assert_allclose(image.scalar, 6 * 0.4 * 2.0, rtol=1e-6)
