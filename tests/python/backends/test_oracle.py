"""The backends against the oracle, an independent renderer written from the conventions alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np
import oracle
import oracle.kernels
import oracle.picture
import oracle.samples
import pytest
import scene_parts
from random_scenes import direction, random_ellipsoid_scene, random_lattice_scene
from scene_parts import build, central, cloud, pick, quaternions

import sheetsplat as ss

SCENES = range(60)
SCATTERED = range(200)
# Images are float32: half a unit in the last place is 6e-8 of a value. The rest is for float64 sums in another order.
ROUNDING, ARITHMETIC = 7e-8, 1e-9
# Conventions, section 8: RMSE and P99.9.
GENTLE, HARD, SIXTEEN_BITS = (2e-5, 2e-4), (1e-4, 1e-3), (1 / 510, 1 / 85)
MOST_AMBIGUOUS = 0.005
OUTPUTS = ("coverage", "depth")


def pixels(image: ss.Image) -> np.ndarray:
    """Return the picture of any mode in float64."""
    return np.asarray(image.pixels, np.float64)


def expected(picture: oracle.Picture) -> np.ndarray:
    """Return the oracle's picture of any mode."""
    found = picture.scalar if picture.rgba is None else picture.rgba
    assert found is not None
    return found


def excess(actual: np.ndarray, wanted: np.ndarray) -> float:
    """Return the largest distance in units of what a float32 picture of float64 sums may be off by."""
    finite = np.isfinite(wanted)
    if not np.array_equal(finite, np.isfinite(actual)):
        return np.inf
    if not finite.any():
        return 0.0
    scale = np.abs(wanted[finite]).max()
    allowed = ROUNDING * np.abs(wanted[finite]) + ARITHMETIC * scale + 1e-40
    return float((np.abs(actual[finite] - wanted[finite]) / allowed).max())


def reference_excess(
    parts: dict[str, Any],
    renderer: ss.Renderer,
    make: Callable[[ModuleType, dict[str, Any]], Any] = build,
    picture: oracle.Picture | None = None,
) -> float:
    """Return how far the reference is from the oracle, in units of what is allowed: picture, coverage and depth.

    `picture` is the oracle's, if it has been drawn.
    """
    scene, camera, size = make(ss, parts)
    image = renderer.render(scene, camera, size=size, outputs=OUTPUTS)
    picture = picture or oracle.render(*make(oracle, parts))
    return max(
        excess(pixels(image), expected(picture)),
        excess(np.asarray(image.coverage, np.float64), picture.coverage),
        excess(np.asarray(image.depth, np.float64), picture.depth),
    )


def distances(actual: np.ndarray, wanted: np.ndarray, left_out: np.ndarray) -> tuple[float, float]:
    """Return RMSE and P99.9 (section 8) of the pixels that are compared; what is no number has to be none in both."""
    nothing = np.isnan(wanted)
    off = np.where(nothing & np.isnan(actual), 0.0, np.abs(actual - wanted))
    off = np.where(np.isnan(off), np.inf, off)
    if off.ndim == 2:
        off = (off / max(1.0, float(np.abs(wanted[~nothing]).max(initial=0.0))))[..., None]
    off = np.where(left_out[..., None], 0, off)
    return float(np.sqrt(np.mean(off**2))), float(np.percentile(off.max(-1), 99.9))


def within(found: tuple[float, float], bounds: tuple[float, float]) -> bool:
    """Return whether both bounds are kept."""
    return found[0] <= bounds[0] and found[1] <= bounds[1]


@cache
def lattice_picture(seed: int) -> oracle.Picture:
    """Return the oracle's picture of a random scene of lattices."""
    return oracle.render(*build(oracle, random_lattice_scene(seed)))


@pytest.mark.parametrize("seed", SCENES)
def test_reference_is_the_oracle(seed: int, reference_renderer: ss.Renderer) -> None:
    assert reference_excess(random_lattice_scene(seed), reference_renderer, picture=lattice_picture(seed)) <= 1


@pytest.mark.gl
@pytest.mark.parametrize("seed", SCENES)
def test_opengl_keeps_the_bounds(seed: int, gl_renderer: ss.Renderer) -> None:
    parts = random_lattice_scene(seed)
    scene, camera, size = build(ss, parts)
    outputs = ((), OUTPUTS)[seed % 2]
    try:
        image = gl_renderer.render(scene, camera, size=size, outputs=outputs)
    except ss.Unsupported as error:
        several = len(parts["fields"]) > 1 and any(f["normalization"] == "threshold" for f in parts["fields"])
        assert several and parts["lights"], f"refused: {error}"
        pytest.skip("a lit close-up of several fields, one normalised by threshold: only the reference draws it")
    o_scene, o_camera, _ = build(oracle, parts)
    picture = lattice_picture(seed)
    wanted = expected(picture)
    gentle = oracle.is_gentle(o_scene, o_camera, size)
    bounds = SIXTEEN_BITS if image.plan.precision == "float16" else GENTLE if gentle else HARD
    left_out = np.zeros(wanted.shape[:2], bool)
    if not within(distances(pixels(image), wanted, left_out), bounds):
        left_out = oracle.ambiguous(o_scene, o_camera, size, picture)
        # One pixel is more than that share of a small picture.
        assert left_out.sum() <= max(1, MOST_AMBIGUOUS * left_out.size)
    assert within(distances(pixels(image), wanted, left_out), bounds)
    if outputs:
        assert within(
            distances(np.asarray(image.coverage, np.float64), picture.coverage, np.zeros_like(left_out)), bounds
        )


def without_lowering(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return the kernel with its support, not lowered by its value at the edge."""
    return lambda r2, k: np.where(r2 < 1, np.exp(-k * r2), 0.0)


def half_a_slice_off(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return slices anchored on the centre instead of half a spacing beside it."""
    return lambda n, centre, spacing: centre + n * spacing


def no_turn(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return gradients whose component towards the viewer has the wrong sign."""
    return lambda *arguments: original(*arguments) * np.array([1, 1, -1])


def linear_opacity(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return opacity scaled by the exponent instead of raised to it."""
    return lambda a, exponent: a * exponent


# The module that looks the formula up, its name there, and the wrong one.
WRONG = {
    "kernel": (oracle.samples, "kernel", without_lowering),
    "slice_depth": (oracle.samples, "slice_depth", half_a_slice_off),
    "gradients": (oracle.picture, "gradients", no_turn),
    "slice_opacity": (oracle.picture, "slice_opacity", linear_opacity),
}


def make_wrong(monkeypatch: pytest.MonkeyPatch, owner: Any, name: str, wrong: Callable[..., Any]) -> None:
    """Put a wrong formula into the oracle."""
    monkeypatch.setattr(owner, name, wrong(getattr(owner, name)))


def telling_scene() -> dict[str, Any]:
    """Return a lit scene that every formula in WRONG takes part in."""
    parts = random_lattice_scene(0)
    parts["fields"] = parts["fields"][:1]
    parts["fields"][0].update(values=np.linspace(0, 1, 60, dtype=np.float32).reshape(3, 4, 5), radius=2.0, falloff=5.0)
    parts["transfer"] = [(0.05, 0.1, 0.2, 0.9, 0.0), (1.0, 0.9, 0.7, 0.1, 0.7)]
    parts["scene"] = {"mode": "composite", "reference_length": 0.9}
    parts["lights"] = [{"direction": (0.4, 0.5, 1.0)}]
    return parts


@pytest.mark.parametrize("formula", WRONG)
def test_a_wrong_formula_is_seen(
    formula: str, monkeypatch: pytest.MonkeyPatch, reference_renderer: ss.Renderer
) -> None:
    parts = telling_scene()
    assert reference_excess(parts, reference_renderer) <= 1
    make_wrong(monkeypatch, *WRONG[formula])
    assert reference_excess(parts, reference_renderer) > 1000


@pytest.mark.gl
@pytest.mark.parametrize("formula", WRONG)
def test_a_wrong_formula_breaks_the_bounds(
    formula: str, monkeypatch: pytest.MonkeyPatch, gl_renderer: ss.Renderer
) -> None:
    parts = telling_scene()
    scene, camera, size = build(ss, parts)
    actual = pixels(gl_renderer.render(scene, camera, size=size))
    everything = np.zeros(actual.shape[:2], bool)
    assert within(distances(actual, expected(oracle.render(*build(oracle, parts))), everything), HARD)
    make_wrong(monkeypatch, *WRONG[formula])
    assert not within(distances(actual, expected(oracle.render(*build(oracle, parts))), everything), HARD)


# Scattered ellipsoids


@pytest.mark.parametrize("seed", SCATTERED)
def test_reference_is_the_oracle_of_ellipsoids(seed: int, reference_renderer: ss.Renderer) -> None:
    assert reference_excess(random_ellipsoid_scene(seed), reference_renderer) <= 1


def share_seen(scenes: Iterable[dict[str, Any]], renderer: ss.Renderer) -> float:
    """Return in which share of scenes the reference shows something: it draws what the oracle draws, sooner."""
    made = (build_effects(ss, one) for one in scenes)
    pictures = [renderer.render(scene, camera, size=size).pixels for scene, camera, size in made]
    return float(np.mean([np.nanmax(np.abs(picture), initial=0.0) > 1e-3 for picture in pictures]))


@pytest.mark.slow
def test_random_scenes_of_ellipsoids_show_something(reference_renderer: ss.Renderer) -> None:
    assert share_seen(map(random_ellipsoid_scene, SCATTERED), reference_renderer) > 0.8


def upright_quaternions(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return rotations the other way round."""
    return lambda quaternions: np.swapaxes(original(quaternions), 1, 2)


def filter_without_mass(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return filtered kernels whose amplitude is what it was."""
    return lambda self, *arguments: replace(original(self, *arguments), weights=self.weights)


def filter_of_a_larger_pixel(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return kernels filtered for pixels a thousandth larger."""
    return lambda self, pixel, *rest: original(self, 1.001 * pixel, *rest)


def no_weights(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return kernels that all weigh 1."""
    return lambda self, *arguments: replace(original(self, *arguments), weights=None)


WRONG_SCATTERED: dict[str, tuple[Any, str, Callable[..., Any]]] = {
    "kernel": (oracle.samples, "kernel", without_lowering),
    "slices": (oracle.samples, "slice_depth", half_a_slice_off),
    "rotation": (oracle.kernels, "turned", upright_quaternions),
    "mass": (oracle.Kernels, "filtered", filter_without_mass),
    "pixel": (oracle.Kernels, "filtered", filter_of_a_larger_pixel),
    "weights": (oracle.EllipsoidField, "placed", no_weights),
}


@pytest.mark.parametrize("formula", WRONG_SCATTERED)
def test_a_wrong_formula_of_ellipsoids_is_seen(
    formula: str, monkeypatch: pytest.MonkeyPatch, reference_renderer: ss.Renderer
) -> None:
    rng = np.random.default_rng(17)
    field = cloud(rng, 20, 2.0, 6.0, weights=rng.random(20), w0=0.3)
    parts = scene_parts.parts([field], central(), size=(14, 12), filter="ewa")
    assert reference_excess(parts, reference_renderer) <= 1
    make_wrong(monkeypatch, *WRONG_SCATTERED[formula])
    assert reference_excess(parts, reference_renderer) > 1000


# Effects beyond the papers

EFFECTS = range(90)
MADE_OF_CLASSES = {"clip": "Clip", "depth_cue": "DepthCue", "ambient_occlusion": "AmbientOcclusion"}


def with_effects(parts: dict[str, Any], seed: int) -> dict[str, Any]:
    """Return a scene with effects in it, as the mode allows."""
    rng = np.random.default_rng([10, seed])
    scene = parts["scene"]
    eye, target = np.array(parts["camera"]["eye"]), np.array(parts["camera"]["target"])
    away = float(np.linalg.norm(target - eye))
    if rng.random() < 0.6:
        planes = []
        for _ in range(rng.integers(0, 3)):
            normal = rng.uniform(0.2, 3) * np.array(pick(rng, direction(rng), (0.0, 0.0, 1.0)))
            planes.append((tuple(normal.tolist()), float(normal @ target + rng.normal() * 0.3)))
        scene["clip"] = {"planes": planes}
        if rng.random() < 0.5:
            low, high = target - rng.uniform(0.1, 3, 3), target + rng.uniform(0.1, 3, 3)
            scene["clip"]["box"] = (tuple(low.tolist()), tuple(high.tolist()))
    if rng.random() < 0.5:
        scene["gradient"] = "analytic"
    if scene["preintegration"] and rng.random() < 0.6:
        scene["preintegration"] = "second_order"
    if scene["mode"] not in ("composite", "isosurface"):
        return parts
    if rng.random() < 0.4:
        start = away + rng.normal() * 0.3
        scene["depth_cue"] = {
            "start": float(start),
            "end": float(start + rng.uniform(0.1, 2)),
            "color": tuple(rng.random(3).tolist()),
            "strength": float(rng.random()),
        }
    around = rng.random()
    if around < 0.25:
        scene["shadows"] = True
    elif around < 0.4:
        scene["ambient_occlusion"] = {"radius": float(rng.uniform(0.05, 1)), "strength": float(rng.random())}
    elif around < 0.7 and scene["mode"] == "composite":
        scene["gradient_opacity"] = float(rng.uniform(0.05, 1.5))
    if around < 0.4:
        parts["size"] = tuple(min(n, 6) for n in parts["size"])
    if rng.random() < 0.6:
        scene["cut_faces"] = True
    return parts


def effect_scene(seed: int) -> dict[str, Any]:
    """Return the parts of a scene with effects: lattices and scattered kernels by turns."""
    return with_effects((random_lattice_scene, random_ellipsoid_scene)[seed % 2](300 + seed), seed)


def build_effects(module: ModuleType, parts: dict[str, Any]) -> Any:
    """Return scene, camera and size made of a module's classes, effects included."""
    made = {
        name: getattr(module, MADE_OF_CLASSES[name])(**value) if name in MADE_OF_CLASSES else value
        for name, value in parts["scene"].items()
    }
    return build(module, {**parts, "scene": made})


@pytest.mark.parametrize("seed", EFFECTS)
def test_reference_is_the_oracle_of_effects(seed: int, reference_renderer: ss.Renderer) -> None:
    assert reference_excess(effect_scene(seed), reference_renderer, build_effects) <= 1


def test_random_effects_show_something(reference_renderer: ss.Renderer) -> None:
    parts = [effect_scene(seed) for seed in EFFECTS]
    for name in ("clip", "depth_cue", "shadows", "ambient_occlusion", "gradient_opacity", "cut_faces"):
        assert sum(name in one["scene"] for one in parts) >= 5, name
    assert share_seen(parts, reference_renderer) > 0.6


def steeper(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return gradients of kernels that are a thousandth too steep."""
    return lambda *arguments: 1.001 * original(*arguments)


def without_romberg(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return intervals of first order."""
    return lambda tf, rho, lengths: oracle.first_order(tf, rho[1], rho[2], lengths)


def farther_planes(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return what is kept where planes are a tenth of a slice distance farther."""
    return lambda self, points, camera, spacing: original(
        self, points - 0.1 * spacing * (camera.turn() @ [0.6, 0.0, 0.8]), camera, spacing
    )


def from_here(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return what is left of light where the first point is the lit one itself."""

    def left(self: Any, points: Any, towards: Any, most: float = math.inf) -> Any:
        return original(self, points - self.scene.spacing() * towards, towards, most)

    return left


def opacity_of_alpha(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return shares of gradient opacity that are squared."""
    return lambda *arguments: original(*arguments) ** 2


WRONG_EFFECTS: dict[str, tuple[Any, str, Callable[..., Any], dict[str, Any]]] = {
    "gradient": (oracle.samples, "kernel_slopes", steeper, {"gradient": "analytic", "gradient_opacity": 3.0}),
    "quotient": (oracle.samples, "normalised_slope", steeper, {"gradient": "analytic", "gradient_opacity": 3.0}),
    "second order": (oracle.picture, "second_order", without_romberg, {"preintegration": "second_order"}),
    "clip": (oracle.Clip, "keeps", farther_planes, {"clip": {"planes": [((0.6, 0.0, 0.8), 0.05)]}}),
    "cut faces": (
        oracle.picture,
        "face_share",
        opacity_of_alpha,
        {"clip": {"planes": [((0.6, 0.0, -0.8), -0.1)]}, "cut_faces": True},
    ),
    "shadows": (oracle.Around, "left", from_here, {"shadows": True}),
    "occlusion": (oracle.Around, "left", from_here, {"ambient_occlusion": {"radius": 0.5}}),
    "opacity": (oracle.picture, "gradient_share", opacity_of_alpha, {"gradient_opacity": 3.0}),
}


@pytest.mark.parametrize("formula", WRONG_EFFECTS)
def test_a_wrong_formula_of_effects_is_seen(
    formula: str, monkeypatch: pytest.MonkeyPatch, reference_renderer: ss.Renderer
) -> None:
    owner, name, wrong, effects = WRONG_EFFECTS[formula]
    field = cloud(np.random.default_rng(17), 20, 2.0, 6.0, w0=0.3)
    parts = scene_parts.parts([field], central(), size=(6, 5), **effects)
    assert reference_excess(parts, reference_renderer, build_effects) <= 1
    make_wrong(monkeypatch, owner, name, wrong)
    assert reference_excess(parts, reference_renderer, build_effects) > 1000


def one_kernel(**scene: Any) -> dict[str, Any]:
    """Return an x-ray of one ellipsoid that is not divided by anything."""
    field = {
        "centers": [(0.1, -0.2, 0.3)],
        "scales": [(0.9, 0.5, 0.3)],
        "rotations": quaternions(np.random.default_rng(3), 1),
        "values": [0.8],
        "weights": [0.7],
        "normalization": "none",
    }
    return scene_parts.parts([field], size=(33, 31), mode="xray", **scene)


def test_the_oracle_of_slabs_is_the_line_integral() -> None:
    """The sum over all slabs is the integral along the whole chord: a Gaussian, less the lowered edge."""
    scene, camera, size = build(oracle, one_kernel(sampling="slab"))
    field, turn = scene.field, camera.turn()
    inverse = np.linalg.inv(turn @ field.frames()[0] @ np.diag(field.semi_axes()[0]))
    centre = turn @ (np.asarray(field.centers)[0] - camera.eye)
    height = camera.height
    wanted = np.zeros((size[1], size[0]))
    k = field.falloff
    for j in range(size[1]):
        for i in range(size[0]):
            x = ((i + 0.5) / size[0] - 0.5) * height * size[0] / size[1]
            y = (0.5 - (j + 0.5) / size[1]) * height
            along = inverse @ np.array([0.0, 0.0, 1.0])
            away = inverse @ (np.array([x, y, centre[2]]) - centre)
            away = away - (away @ along) / (along @ along) * along
            if away @ away >= 1:
                continue
            half = math.sqrt(1 - away @ away)
            gauss = math.exp(-k * (away @ away)) * math.sqrt(math.pi / k) * math.erf(math.sqrt(k) * half)
            wanted[j, i] = (gauss - 2 * half * math.exp(-k)) / (1 - math.exp(-k)) / np.linalg.norm(along)
    assert wanted.max() > 0.1
    np.testing.assert_allclose(oracle.render(scene, camera, size).scalar, 0.8 * 0.7 * wanted, atol=1e-13)


@pytest.mark.parametrize("smaller", [1.0, 1e-2, 1e-5])
def test_the_oracle_of_the_filter_keeps_the_mass(smaller: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """The sum over the picture is the kernel's integral, also for kernels far smaller than a pixel."""
    parts = one_kernel(filter="ewa", sampling="slab", slice_spacing=0.3)
    parts["fields"][0]["scales"] = smaller * np.array(parts["fields"][0]["scales"])
    scene, camera, size = build(oracle, parts)
    pixel = camera.height / size[1]
    mass = 0.8 * 0.7 * oracle.ball_integral(8.0) * float(np.prod(scene.field.semi_axes()))

    def seen() -> float:
        """Return the mean over places between the pixels' centres, a quarter of a pixel apart."""
        right, up = camera.turn()[:2] * pixel / 4
        total = 0.0
        for across, along in np.ndindex(4, 4):
            shift = across * right + along * up
            there = oracle.Camera.orthographic(
                camera.eye + shift, camera.target + shift, camera.up, height=camera.height
            )
            total += float(oracle.render(scene, there, size).scalar.sum()) * pixel**2 / 16
        return total

    assert seen() == pytest.approx(mass, rel=1e-4)
    monkeypatch.setattr(oracle.Kernels, "filtered", filter_without_mass(oracle.Kernels.filtered))
    assert seen() > 1.02 * mass
