"""Precision: predictions bound the error, and bounds that no precision keeps are refused."""

from __future__ import annotations

import re
from statistics import median

import numpy as np
import pytest
from image_checks import FLOAT16, FLOAT32_HARD, distance, handed_over

import sheetsplat as ss

SIZE = (40, 32)
GL = pytest.param("gl", marks=pytest.mark.gl)
# Share of a picture whose weights all round to 0.
MOST_LOST = {"float16": 0.005, "uint8": 0.04}


def some_field(rng: np.random.Generator, kind: int) -> ss.RegularField | ss.EllipsoidField:
    """Return noise on a lattice of some kernel, a smooth ball, spheres or ellipsoids; few or many, of either sign."""
    if kind == 0:
        radius, falloff = ((2.0, 5.0), (2.5, 7.0), (3.0, 7.0))[rng.integers(3)]
        normalization = ("lattice", "threshold", "none")[rng.integers(3)]
        values = rng.random((8, 9, 10)).astype(np.float32)
        return ss.RegularField(values, radius=radius, falloff=falloff, normalization=normalization)  # type: ignore[arg-type]
    if kind == 1:
        k, j, i = np.mgrid[0:12, 0:12, 0:12]
        ball = np.clip(1.2 - np.sqrt((k - 5.5) ** 2 + (j - 5.5) ** 2 + (i - 5.5) ** 2) / 5, 0, 1)
        return ss.RegularField(ball.astype(np.float32))
    count = (5, 60, 600)[rng.integers(3)]
    centers = 2 * rng.normal(size=(count, 3))
    values = rng.random(count) * (1 if rng.random() < 0.7 else -1) + (rng.random(count) < 0.3)
    normalization = ("threshold", "none")[rng.integers(2)]
    if kind == 2:
        return ss.EllipsoidField(
            centers,
            rng.uniform(0.4, 1.2, count),
            values=values,
            normalization=normalization,  # type: ignore[arg-type]
        )
    rotations = rng.normal(size=(count, 4))
    rotations /= np.linalg.norm(rotations, axis=1, keepdims=True)
    return ss.EllipsoidField(
        centers,
        rng.uniform(0.3, 1.3, (count, 3)),
        rotations,
        values,
        normalization=normalization,  # type: ignore[arg-type]
    )


def some_scene(seed: int) -> tuple[ss.Scene, ss.Camera]:
    """Return a random scene without steps."""
    rng = np.random.default_rng(seed)
    field = some_field(rng, seed % 4)
    low, high = field.value_range
    high = max(high * (5.0 if field.normalization == "none" else 1.0), low + 0.1)
    middle = low + (high - low) * rng.uniform(0.05, 0.8)
    points = [(low, *rng.random(3), 0.0), (middle, *rng.random(3), 0.6 * rng.random()), (high, *rng.random(4))]
    scene = ss.Scene(
        field,
        points,
        lights=[ss.Light((1, 1, 1))] if rng.random() < 0.5 else (),
        material=ss.Material(specular=float(rng.choice([0.0, 0.5]))),
        mode=str(rng.choice(["composite", "composite", "composite", "xray", "mip"])),  # type: ignore[arg-type]
        opacity_stop=1.0,
    )
    return scene, ss.Camera.fit(field, direction=rng.normal(size=3))


@pytest.fixture(scope="module")
def references() -> list[tuple[ss.Scene, ss.Camera, np.ndarray]]:
    """Return sixteen scenes and their pictures by the reference."""
    renderer = ss.Renderer("reference")
    scenes = [some_scene(seed) for seed in range(100, 116)]
    return [(scene, camera, renderer.render(scene, camera, size=SIZE).pixels) for scene, camera in scenes]


@pytest.mark.parametrize(
    ("backend", "precision"), [pytest.param("gl", "float32", marks=pytest.mark.gl), ("cpu", "float32")]
)
def test_predictions_bound_the_error_and_are_not_far_above_it(
    backend: str, precision: str, references: list[tuple[ss.Scene, ss.Camera, np.ndarray]]
) -> None:
    """For every accepted scene; half of the predictions are within a factor of 20."""
    renderer = ss.Renderer(backend, precision=precision)  # type: ignore[arg-type]
    times = []
    for scene, camera, expected in references:
        try:
            image = renderer.render(scene, camera, size=SIZE)
        except ss.Unsupported:
            continue
        found = distance(image.pixels, expected).rmse
        assert found <= image.plan.expected_error, f"{scene}: {found:.2g}\n{image.plan}"
        times.append(image.plan.expected_error / max(found, 1e-12))
    assert len(times) >= 10
    assert median(times) <= 20


@pytest.mark.gl
@pytest.mark.parametrize("precision", ["float16", "uint8"])
def test_predictions_bound_what_few_bits_lose(
    precision: str, references: list[tuple[ss.Scene, ss.Camera, np.ndarray]]
) -> None:
    """With allow_inexact. Without it they are refused with the same figure, or they keep their bound."""
    inexact = ss.Renderer("gl", precision=precision, allow_inexact=True)  # type: ignore[arg-type]
    strict = ss.Renderer("gl", precision=precision)  # type: ignore[arg-type]
    refused = 0
    for scene, camera, expected in references:
        image = inexact.render(scene, camera, size=SIZE)
        # Weights that few bits round to 0 do not count: their pixels have no value, and had little. None gets one.
        empty = np.isnan(image.pixels)
        assert empty[np.isnan(expected)].all()
        lost = empty & ~np.isnan(expected)
        assert lost.mean() <= MOST_LOST[precision]
        assert np.abs(expected[lost]).max(initial=0.0) <= 0.01 * np.nanmax(np.abs(expected))
        found = distance(np.where(empty, 0.0, image.pixels), np.where(np.isnan(expected), 0.0, expected))
        assert found.rmse <= image.plan.expected_error, f"{scene}: {found}\n{image.plan}"
        try:
            strict.plan(scene, camera, size=SIZE)
        except ss.Unsupported as error:
            if error.option == "precision":
                figure = re.search(r"an expected error of ([-.\de+]+),", error.found)
                assert figure and float(figure.group(1)) == pytest.approx(image.plan.expected_error, rel=1e-3)
                assert "allow_inexact" in error.advice
                refused += 1
        else:
            assert precision == "float16" and found.within(FLOAT16), f"{scene}: {found}"
    assert refused >= 8


def cancelling(scale: float) -> tuple[ss.Scene, ss.Camera]:
    """Return pairs of kernels at one place, of opposite values that all but cancel, over a window of 1."""
    rng = np.random.default_rng(8)
    centers = np.repeat(rng.normal(size=(30, 3)), 2, axis=0)
    values = np.tile([scale, 1.0 - scale], 30)
    field = ss.EllipsoidField(centers, np.full(60, 0.8), values=values, normalization="none")
    scene = ss.Scene(field, [(0, 1, 0, 0, 0), (1, 0, 1, 1, 0.5)], opacity_stop=1.0)
    return scene, ss.Camera.fit(field)


def test_cancellation_takes_float64_and_says_so() -> None:
    """Sums of 10⁷ that cancel to 1 are beyond float32; backend cpu uses float64."""
    scene, camera = cancelling(1e7)
    expected = ss.Renderer("reference").render(scene, camera, size=SIZE).pixels
    image = ss.Renderer("cpu").render(scene, camera, size=SIZE)
    assert image.plan.precision == "float64"
    reason = next(effect.reason for effect in image.plan.effects if effect.name == "float64")
    assert "the transfer function distinguishes" in reason
    assert distance(image.pixels, expected).within(FLOAT32_HARD)
    assert distance(image.pixels, expected).rmse <= image.plan.expected_error
    # The same in float32 would be wrong, and is refused.
    with pytest.raises(ss.Unsupported, match="float64"):
        ss.Renderer("cpu", precision="float32").render(scene, camera, size=SIZE)
    wrong = ss.Renderer("cpu", precision="float32", allow_inexact=True).render(scene, camera, size=SIZE)
    assert not distance(wrong.pixels, expected).within(FLOAT32_HARD)
    assert distance(wrong.pixels, expected).rmse <= wrong.plan.expected_error
    mild, camera = cancelling(3.0)
    assert ss.Renderer("cpu").plan(mild, camera, size=SIZE).precision == "float32"


def test_beyond_float64_there_is_the_reference_alone() -> None:
    """Where float64 sums lose the bound as well, a clear error names it."""
    scene, camera = cancelling(1e17)
    with pytest.raises(ss.Unsupported, match='backend="reference"'):
        ss.Renderer("cpu").render(scene, camera, size=SIZE)


@pytest.mark.gl
def test_where_opengl_would_lose_the_bound_the_processor_draws() -> None:
    """OpenGL sums in 32 bits at most: the plans of "gl" and "auto" say why; precision="float32" is refused."""
    scene, camera = cancelling(1e7)
    image = ss.Renderer("gl").render(scene, camera, size=SIZE)
    assert image.plan.precision == "float64" and "the transfer function distinguishes" in handed_over(image)
    assert distance(image, ss.Renderer("reference").render(scene, camera, size=SIZE)).within(FLOAT32_HARD)
    with pytest.raises(ss.Unsupported, match="the transfer function distinguishes"):
        ss.Renderer("gl", precision="float32").render(scene, camera, size=SIZE)
    plan = ss.Renderer("auto").plan(scene, camera, size=SIZE)
    assert (plan.backend, plan.precision) == ("cpu", "float64")
    assert "auto: " in plan.device


@pytest.mark.gl
def test_sixteen_bits_are_taken_only_where_the_device_gains() -> None:
    """A software rasteriser never chooses half floats, and the plan says so."""
    scene, camera = some_scene(100)
    plan = ss.Renderer("gl").plan(scene.replace(mode="composite", lights=()), camera, size=SIZE)
    effect = next(effect for effect in plan.effects if effect.name == "float16")
    software = "llvmpipe" in plan.device or "softpipe" in plan.device
    assert effect.on == (plan.precision == "float16")
    if software:
        assert not effect.on and "gains nothing" in effect.reason
    else:
        assert len(effect.reason) > 10
