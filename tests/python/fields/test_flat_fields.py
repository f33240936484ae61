"""Lit scattered fields whose values hardly change: the gradients of their quotients are next to nothing."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scene_parts
from image_checks import FLOAT32, FLOAT32_HARD, assert_close, handed_over, off_by, within
from reference_pictures import by_reference
from scene_parts import Parts, cloud
from sweep_scenes import fault

import sheetsplat as ss

# Values round a middle, with the width of their range over the transfer function's.
SPREADS = [0.0, 1e-5, 1e-2]
# RMSE of pictures on whose plateaus OpenGL adds no light of rounding; with it these were 6e-6 to 2.3e-5 off.
NOT_LIT = 2e-6
PERSPECTIVE = {"eye": (2.5, 1.0, 2.0), "target": (0.0, 0.0, 0.0), "up": (0.0, 1.0, 0.0), "fov_y": 40.0}
TRANSFER = [(0.1, 0.9, 0.3, 0.2, 0.0), (0.4, 0.3, 0.8, 0.5, 0.1), (0.7, 0.2, 0.6, 0.9, 0.3)]


def flat(spread: float, fields: int = 1, **scene: object) -> Parts:
    """Return a cloud of 200 spheres that overlap much, w0 far below their weights."""
    rng = np.random.default_rng(38)
    made = []
    for _ in range(fields):
        one = cloud(rng, 200, 6.0, 2.0, w0=0.1)
        one["centers"] = 0.6 * one["centers"]
        one["values"] = 1.0 / fields + spread * 0.6 * (rng.random(200) - 0.5)
        made.append(one)
    return scene_parts.parts(
        made, transfer=TRANSFER, size=(24, 20), **{"reference_length": 0.8, "gradient": "analytic"} | scene
    )


def plateaus(low: float, high: float, **scene: object) -> Parts:
    """Return the cloud with one value on one side and another on the other."""
    parts = flat(0.0, **scene)
    one = parts["fields"][0]
    one["values"] = np.where(one["centers"][:, 0] < 0, low, high)
    return parts


def drawn(parts: Parts, backend: str, **options: object) -> ss.Image:
    """Return the picture of a backend."""
    scene, camera, size = scene_parts.build(ss, parts)
    return ss.Renderer(backend, **options).render(scene, camera, size=size)  # type: ignore[arg-type]


@pytest.mark.parametrize("fields", [1, 2])
@pytest.mark.parametrize("sampling", ["point", "slab"])
@pytest.mark.parametrize("spread", SPREADS)
def test_values_alike_keep_float32_and_its_bound(spread: float, sampling: str, fields: int) -> None:
    parts = flat(spread, fields, sampling=sampling)
    expected = by_reference(parts)
    image = drawn(parts, "cpu")
    assert image.plan.precision == "float32"
    assert_close(image, expected.rgba, FLOAT32, f"flat {spread} {sampling} {fields}")
    # The light of these gradients is seen.
    unlit = by_reference(parts | {"lights": [], "scene": parts["scene"]})
    assert not within(off_by(unlit, expected), FLOAT32)


def test_lattices_of_one_value_keep_float32() -> None:
    one = {"values": np.full((5, 6, 7), 0.8), "spacing": (0.3, 0.4, 0.3), "origin": (-1.0, -1.0, -0.6)}
    for camera in (scene_parts.parallel(), scene_parts.central()):
        for more in ({}, {"filter": "ewa"}):
            parts = flat(0.0) | {"fields": [one | {"normalization": "threshold", "w0": 0.3}], "camera": camera}
            parts["scene"] = parts["scene"] | more
            image = drawn(parts, "cpu")
            assert image.plan.precision == "float32"
            assert_close(image, by_reference(parts).rgba, FLOAT32, f"lattice of one value {more}")


@pytest.mark.parametrize("sampling", ["point", "slab"])
@pytest.mark.parametrize(("low", "high"), [(0.3, 1.0), (0.3, 2.5)])
def test_plateaus_keep_float32_and_its_bound(low: float, high: float, sampling: str) -> None:
    """Where values are alike around each point but not everywhere, sums of whole values would show their rounding."""
    parts = plateaus(low, high, sampling=sampling)
    image = drawn(parts, "cpu")
    assert image.plan.precision == "float32"
    assert_close(image, by_reference(parts), FLOAT32, f"plateaus {low} {high} {sampling}")


def test_values_alike_far_from_their_middle_take_float64() -> None:
    """What differs in the last digits of float32 alone is lit."""
    parts = flat(1e-5)
    one = parts["fields"][0]
    one["values"] = np.where(one["centers"][:, 0] < -0.45, 0.0, 60.0 + one["values"])
    parts["transfer"] = [(60.0 + at, *look) for at, *look in TRANSFER]
    expected = by_reference(parts)
    image = drawn(parts, "cpu")
    assert image.stats["tiles_in_float64"] > 0
    assert_close(image, expected.rgba, FLOAT32, "far from the middle")
    inexact = drawn(parts, "cpu", precision="float32", allow_inexact=True)
    assert not within(off_by(inexact, expected), FLOAT32)


@pytest.mark.parametrize("sampling", ["point", "slab"])
@pytest.mark.parametrize(("low", "high", "length"), [(3.0, 3.3, 0.15), (3.0, 3.3, 0.25), (0.3, 1.0, 0.6)])
def test_differences_on_plateaus_keep_the_bound_in_float32(
    low: float, high: float, length: float, sampling: str
) -> None:
    """A quotient of two sums would show the rounding of both: 4e-5, and 4e-4 at the worst pixels.

    The precision is given: plans are made for values that change slowly instead, as below.
    """
    parts = plateaus(low, high, gradient="sheets", reference_length=length, sampling=sampling)
    image = drawn(parts, "cpu", precision="float32", allow_inexact=True)
    assert_close(image, by_reference(parts), FLOAT32, f"plateaus {low} {high} {length} {sampling}")


@pytest.mark.parametrize("kind", ["scattered", "edge", "zero"])
def test_close_ups_of_quotients_that_change_slowly_take_float64(kind: str) -> None:
    """What their differences have in float32 is the rounding of the quotients."""
    parts = flat(0.0, gradient="sheets", reference_length=0.4, slice_spacing=0.05)
    if kind == "scattered":
        field = parts["fields"][0]
        field["values"] = 3.0 + 3e-4 * field["centers"][:, 0]
    else:
        values = np.broadcast_to(3.0 + 3e-4 * np.linspace(-1, 1, 10), (10, 10, 10))
        parts["fields"] = [
            {"values": values, "spacing": (2 / 9,) * 3, "origin": (-1,) * 3, "normalization": "threshold", "w0": 0.3}
            # Counted from a base of their own they would be exact.
            | {"boundary": kind, "base": 0.0}
        ]
    parts["transfer"] = [(at + 2.6, *look) for at, *look in TRANSFER]
    parts["camera"] = parts["camera"] | {"height": 0.3}
    expected = by_reference(parts)
    image = drawn(parts, "cpu")
    assert image.stats["tiles_in_float64"] > 0
    assert_close(image, expected, FLOAT32, f"slow change {kind}")
    inexact = drawn(parts, "cpu", precision="float32", allow_inexact=True)
    assert not within(off_by(inexact, expected), FLOAT32)


@pytest.mark.gl
@pytest.mark.parametrize("sampling", ["point", "slab"])
@pytest.mark.parametrize(("spread", "length"), [(0.0, 8.0), (1e-2, 8.0), (0.0, 40.0)])
def test_opengl_draws_close_ups_of_alike_values(spread: float, length: float, sampling: str) -> None:
    """Splatted differences of both sums are as large as the values: unless these are counted from their middle."""
    parts = flat(spread, gradient="sheets", reference_length=length, sampling=sampling)
    parts["fields"][0]["values"] += 2.0
    image = drawn(parts, "gl")
    assert image.plan.has("fine_gradient")
    assert_close(image, by_reference(parts), FLOAT32_HARD, f"close-up {spread} {length} {sampling}")


@pytest.mark.gl
@pytest.mark.parametrize(("low", "high"), [(0.3, 1.0), (0.0, 0.7)])
@pytest.mark.parametrize("length", [0.8, 2.0, 8.0])
def test_opengl_counts_plateaus_from_the_middle_of_their_values(low: float, high: float, length: float) -> None:
    """Counted from 0 they were seen 5.7e-5 and 3.9e-4 (P99.9) off: their largest value was thrice as large."""
    values = np.full((8, 8, 8), low)
    values[:, :, 4:] = high
    field = {"values": values, "spacing": (0.3,) * 3, "origin": (-1.05,) * 3, "normalization": "threshold", "w0": 0.3}
    parts = flat(0.0, gradient="sheets", reference_length=length) | {"fields": [field]}
    image = drawn(parts, "gl")
    assert image.plan.has("fine_gradient")
    assert_close(image, by_reference(parts), FLOAT32, f"plateaus of a lattice {low} {high} {length}")


@pytest.mark.parametrize("backend", ["cpu", pytest.param("gl", marks=pytest.mark.gl)])
@pytest.mark.parametrize("gradient", ["analytic", "sheets"])
@pytest.mark.parametrize(("low", "high"), [(0.37, 0.37), (0.23, 0.61)])
def test_no_backend_lights_rounding_under_a_transfer_function_of_one_value(
    low: float, high: float, gradient: str, backend: str
) -> None:
    """Every gradient is lit at full strength there, the reference's own rounding as well."""
    parts = plateaus(low, high, gradient=gradient, slice_spacing=0.1)
    parts["transfer"] = [(0.2, 0.9, 0.3, 0.2, 0.0), (0.2, 0.3, 0.8, 0.5, 0.3)]
    one = parts["fields"][0]
    if low != high:
        # Apart from one another: where they met gradients would be real.
        one["centers"] = one["centers"] + np.sign(one["centers"][:, :1]) * (1.2, 0.0, 0.0)
        parts["camera"] = scene_parts.parallel(height=5.0)
    expected = by_reference(parts)
    assert np.count_nonzero(expected.rgba[..., 3]) > 60
    image = drawn(parts, backend)
    assert image.plan.backend == backend and (low == high or image.stats["tiles_in_float64"] > 0)
    assert_close(image, expected, FLOAT32, f"one value {low} {high} {gradient} {backend}")


@pytest.mark.gl
@pytest.mark.parametrize(("slope", "pixel"), [(4e-7, 0.5), (2.2e-7, 1.0), (3e-7, 1.0)])
def test_opengl_keeps_weak_gradients_that_are_real(slope: float, pixel: float) -> None:
    """What counts as rounding must be no more than that: values that rise by a few roundings from sample to sample."""
    values = 1 - slope * np.broadcast_to(np.arange(12.0), (12, 12, 12))
    values = values.copy()
    values[0, 0, 0] = 0
    field = ss.RegularField(values, normalization="threshold", w0=0.05)
    scene = ss.Scene(field, [(0, 0.9, 0.3, 0.2, 0), (1, 0.3, 0.8, 0.5, 0.5)], lights=[ss.Light((1, 0.2, 0.3))])
    camera = ss.Camera.orthographic((5.5, 5.5, 30), (5.5, 5.5, 5.5), (0, 1, 0), height=16 * pixel)
    images = [ss.Renderer(backend).render(scene, camera, size=(16, 16)) for backend in ("reference", "gl")]
    assert_close(images[1], images[0], FLOAT32, f"weak gradients {slope} {pixel}")


@pytest.mark.gl
def test_opengl_keeps_weak_gradients_beside_quotients() -> None:
    """Groups that are no quotients have no rounding to be left out."""
    large = ss.EllipsoidField([[0, 0, 0]], 200.0, values=np.ones(1), normalization="none", falloff=2.0)
    images = {}
    for normalization in ("none", "threshold"):
        small = ss.EllipsoidField([[0, 0, 0]], 1.0, values=np.ones(1), normalization=normalization)
        transfer = [(0, 0.9, 0.3, 0.2, 0), (1, 0.3, 0.8, 0.5, 0.1)]
        scene = ss.Scene(
            [[large], [small]],
            [transfer, transfer],
            lights=[ss.Light((1, 0.2, 0.3))],
            slice_spacing=0.4,
            reference_length=0.4,
        )
        camera = ss.Camera.orthographic((0, 0, 600), (0, 0, 0), (0, 1, 0), height=0.8)
        drawn_by = [ss.Renderer(backend).render(scene, camera, size=(16, 16)) for backend in ("reference", "gl")]
        images[normalization] = off_by(drawn_by[1], drawn_by[0])["rmse"]
    assert images["threshold"] <= 1.1 * images["none"]


@pytest.mark.parametrize("w0", [1e-200, 1e-30, 0.3])
def test_weights_of_0_have_the_value_0_under_a_transfer_function_of_one_value(w0: float) -> None:
    """Counted from the middle of the values they must not have it where no other kernel is.

    Light shows the rounding of what they leave of W there: opacity alone is compared.
    """
    parts = flat(0.0)
    one = parts["fields"][0]
    one |= {"centers": 1.7 * one["centers"], "weights": np.zeros(200), "w0": w0}
    one["weights"][0] = 1.0
    # Where points of 0 are seen: kernels of weight 0 tell them from empty ones.
    parts["transfer"] = [(0.5, 0.9, 0.3, 0.2, 0.3), (0.5, 0.3, 0.8, 0.5, 0.0)]
    image, expected = drawn(parts, "cpu", allow_inexact=True), by_reference(parts)
    assert np.count_nonzero(expected.rgba[..., 3]) > 100
    np.testing.assert_allclose(image.pixels[..., 3], expected.rgba[..., 3], atol=1e-6)


@pytest.mark.gl
@pytest.mark.parametrize(
    ("scene", "resident"),
    [
        ({}, False),
        ({}, True),
        ({"filter": "ewa"}, False),
        ({"gradient": "sheets", "reference_length": 2.0}, False),
        ({"gradient": "sheets", "reference_length": 2.0}, True),
    ],
)
@pytest.mark.parametrize(("low", "high"), [(0.61, 0.61), (0.17, 0.93)])
def test_opengl_does_not_light_plateaus_of_the_ends_of_the_range(
    low: float, high: float, scene: dict[str, object], resident: bool
) -> None:
    """D and W are the same numbers there, however they are rounded; in the units of plateaus' values they are not."""
    parts = plateaus(low, high, **scene)
    for camera in (parts["camera"], PERSPECTIVE):
        here = parts | {"camera": camera}
        image = drawn(here, "gl", effects={"resident_sections": resident})
        assert off_by(image.pixels, by_reference(here).rgba)["rmse"] < NOT_LIT
        # Next to the ends they are divided as all others are.
        here["fields"] = [parts["fields"][0] | {"values": parts["fields"][0]["values"] + np.eye(200)[0] * 0.4321}]
        image = drawn(here, "gl", effects={"resident_sections": resident})
        assert_close(image, by_reference(here).rgba, FLOAT32, f"{low} {high} {scene} {resident}")


@pytest.mark.gl
def test_tiles_whose_light_cancels_in_float32_are_drawn_by_the_processor() -> None:
    parts = flat(0.0)
    one = parts["fields"][0]
    one["scales"] = np.array([1.0, 1.0, 0.01]) * one["scales"]
    one["values"] = np.linspace(0.1, 1.0, len(one["values"]))
    expected = by_reference(parts)
    for backend in ("gl", "cpu"):
        image = drawn(parts, backend)
        assert image.plan.backend == backend and image.stats["tiles_in_float64"] > 0
        assert_close(image, expected.rgba, FLOAT32, f"flakes {backend}")


def outlier(value: float, weight: float) -> Any:
    """Return a field in which one of 30 kernels has a far larger value, and next to no weight."""
    field = scene_parts.cloud(np.random.default_rng(1), 30, 8.0, 2.0, w0=1.0)
    field["weights"] = np.ones(30)
    field["weights"][3], field["values"][3] = weight, value
    return field


SURFACE = {"mode": "isosurface", "iso_value": 0.3}
FAR = [(outlier(1e6, 0.0), (0.0, 1.0), SURFACE, ""), (outlier(-9999.0, 0.0), (0.0, 1.0), SURFACE, "")]
FAR += [(outlier(1e6, 0.0), (0.4, 20.0), {}, ""), (outlier(1e6, 0.0), (0.1, 5.0), {}, "")]
FAR += [(outlier(1e6, 0.0), (0.0, 1.0), SURFACE | {"gradient": "analytic"}, "an iso value near the end")]


@pytest.mark.gl
@pytest.mark.parametrize(("field", "window", "scene", "reason"), FAR)
def test_opengl_with_values_that_do_not_show(field: Any, window: Any, scene: Any, reason: str) -> None:
    """The middle of all values is far from those that show: counted from it they lost all digits."""
    low, high = window
    points = [(low, 0.1, 0.2, 0.6, 0.0), ((low + high) / 2, 0.2, 0.6, 0.4, 0.1), (high, 1.0, 0.9, 0.8, 0.3)]
    parts = scene_parts.parts([field], transfer=points, size=(20, 16), **scene)
    image = drawn(parts, "gl")
    assert image.plan.backend == ("cpu" if reason else "gl") and reason in handed_over(image)
    assert not fault(parts, "gl")
    assert not fault(parts, "cpu")
