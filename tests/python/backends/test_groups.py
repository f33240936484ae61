"""Groups with transfer functions of their own, several isosurfaces, modes minimum and average, by each backend."""

from __future__ import annotations

import itertools
from functools import cache
from typing import Any

import numpy as np
import oracle
import pytest
import scene_parts
from image_checks import FLOAT32, FLOAT32_HARD, assert_close, distance, log, off_by, within
from numpy.typing import NDArray
from scene_parts import GENTLE, OPAQUE, STEP, ZERO_SEEN, Parts, central, cloud, parallel
from test_cpu_against_reference import assert_same_depths
from test_oracle import build_effects
from test_oracle_groups import group_scene

import sheetsplat as ss

BACKENDS = ["cpu", pytest.param("gl", marks=pytest.mark.gl)]
SIZE = (30, 26)


def cases(*names: Any, rounds: int = 1, few_by: Any = ("gl",)) -> list[Any]:
    """Return what a test is run with: by the processor all combinations, by OpenGL, which compiles for long, a few.

    In each round every name occurs, and names of different lists meet others.
    """
    few = {
        tuple(one[(n + turn * place) % len(one)] for place, one in enumerate(names))
        for turn in range(rounds)
        for n in range(max(map(len, names)))
    }
    every = list(itertools.product(*names))
    return [pytest.param(*one, "cpu") for one in every] + [
        pytest.param(*one, backend, marks=[pytest.mark.gl] if backend == "gl" else [])
        for backend in few_by
        for one in every
        if one in few
    ]


OUTPUTS = ("coverage", "depth")
Mask = NDArray[np.bool_]

WARM = [(0.05, 0.9, 0.3, 0.1, 0.0), (0.5, 0.8, 0.5, 0.1, 0.12), (1.0, 1.0, 0.8, 0.2, 0.3)]
# Values in thousands.
LARGE = [(50.0, 0.1, 0.7, 0.2, 0.0), (400.0, 0.2, 0.9, 0.4, 0.1), (900.0, 0.6, 1.0, 0.7, 0.25)]
# More points than a vector has lanes.
MANY = [(0.03 + 0.05 * n, *np.abs(np.sin([n, 2 + n, 4 + 2 * n])).tolist(), 0.02 * (n % 7)) for n in range(20)]


def lattice(rng: np.random.Generator, scale: float = 1.0, **options: Any) -> dict[str, Any]:
    """Return a lattice of noise in the cube of edge 2 round 0."""
    values = (scale * rng.random((7, 6, 6))).astype(np.float32)
    return {"values": values, "spacing": (0.4, 0.38, 0.35), "origin": (-1.0, -0.9, -1.0)} | options


@cache
def fields_of(name: str) -> dict[str, Any]:
    """Return fields, groups, and their transfer functions."""
    rng = np.random.default_rng([8, len(name)])
    if name == "one end":
        # A BCC lattice and the Cartesian one of all its layers end in one place.
        place = {"spacing": (0.25, 0.25, 0.25), "origin": (-0.8, -0.7, -0.8)}
        fields = [place | {"values": rng.random((7, 6, 6)).astype(np.float32)}, lattice(rng)]
        fields[1] |= place | {"values": rng.random((7, 3, 3)), "lattice": "bcc", "spacing": (0.5, 0.5, 0.5)}
        return {"fields": fields, "groups": [[0], [1]], "transfer": [GENTLE, WARM]}
    if name in ("lattices", "two ends"):
        # By OpenGL, and in scalar modes, volumes that end in different places are not drawn together.
        end = {"boundary": "zero"} if name == "lattices" else {}
        bcc = lattice(rng, lattice="bcc", spacing=(0.5, 0.5, 0.5), normalization="threshold", **end)
        return {"fields": [lattice(rng, **end), bcc], "groups": [[0], [1]], "transfer": [GENTLE, WARM]}
    if name == "clouds":
        fields = [cloud(rng, 24, 5.0, 2.0, w0=0.3), cloud(rng, 24, 4.0, 3.0, normalization="none")]
        return {"fields": fields, "groups": [[0], [1]], "transfer": [WARM, GENTLE]}
    fields = [
        cloud(rng, 20, 4.0, 2.0, w0=0.3),
        lattice(rng, 0.5, boundary="zero"),
        cloud(rng, 20, 4.0, 2.0, normalization="none"),
        lattice(rng, 1000.0, normalization="threshold", boundary="zero"),
    ]
    return {"fields": fields, "groups": [[0, 1], [2], [3]], "transfer": [GENTLE, WARM, LARGE]}


FIELDS = ["lattices", "clouds", "three", "one end"]
EFFECTS: dict[str, dict[str, Any]] = {
    "plain": {},
    "unlit": {"lit": False},
    "stopped": {"transfer": OPAQUE, "opacity_stop": 0.9},
    "slab": {"sampling": "slab"},
    "central": {"camera": central()},
    "near": {"camera": central() | {"near": 3.7}},
    "ewa": {"filter": "ewa", "slice_spacing": 0.2, "camera": central()},
    "clip": {"clip": {"planes": [((1.0, 0.3, 0.2), -0.2)], "box": ((-0.8, -0.8, -0.9), (0.9, 0.7, 0.8))}},
    "cue": {"depth_cue": {"start": 3.0, "end": 4.8, "color": (0.9, 0.95, 1.0), "strength": 0.8}},
    "analytic": {"gradient": "analytic"},
}
COMPOSITES: dict[str, dict[str, Any]] = EFFECTS | {
    "intervals": {"preintegration": True},
    "intervals-clip-central": {"preintegration": True, **EFFECTS["clip"], "camera": central()},
    "faded": {"gradient_opacity": 0.8},
    "faded-intervals-analytic": {"gradient_opacity": 0.8, "preintegration": True, "gradient": "analytic"},
    "zero-seen": {"transfer": ZERO_SEEN},
    "zero-seen-intervals": {"transfer": ZERO_SEEN, "preintegration": True},
    "many-points": {"transfer": MANY},
    "many-points-intervals": {"transfer": MANY, "preintegration": True},
    "opaque-steps": {"transfer": STEP[:-1] + [(1.0, 1.0, 0.9, 0.8, 1.0)], "opacity_stop": 1.0},
}
SURFACES: dict[str, list[tuple[float, float]]] = {
    "opaque": [(0.45, 1.0)],
    "one": [(0.4, 0.35)],
    "three": [(0.55, 1.0), (0.2, 0.3), (0.4, 0.5)],
    "hidden": [(0.3, 0.0), (0.45, 1.0)],
    "twice": [(0.35, 0.5), (0.35, 0.25), (9.0, 0.5)],
}


def scene_of(fields: str, *, transfer: Any = None, first: bool = False, **scene: Any) -> Parts:
    """Return the parts of a scene. transfer: in the place of the first group's; first: without other groups."""
    found = fields_of(fields)
    if transfer is not None:
        found = found | {"transfer": [transfer, *found["transfer"][1:]]}
    if first:
        count = len(found["groups"][0])
        found = {"fields": found["fields"][:count], "groups": None, "transfer": found["transfer"][0]}
    scene = {"slice_spacing": 0.11, "reference_length": 0.13} | scene
    parts = scene_parts.parts(found["fields"], size=SIZE, **scene)
    return parts | {name: found[name] for name in ("groups", "transfer")}


def draw(parts: Parts, backend: str, outputs: Any = OUTPUTS, **options: Any) -> ss.Image:
    """Return the picture of a backend."""
    scene, camera, size = build_effects(ss, parts)
    image = ss.Renderer(backend, **options).render(scene, camera, size=size, outputs=outputs)
    assert image.plan.backend == backend
    return image


def jumping(parts: Parts) -> Mask:
    """Return the pixels that jump under the nudges of section 9; of scalars, where slices begin or end to count."""
    built = build_effects(oracle, parts)
    here = oracle.render(*built)
    if here.rgba is not None:
        return oracle.ambiguous(*built, here)
    moved = [oracle.render(*built, oracle.picture.Nudge(support=1 + by)).scalar for by in (-1e-5, 1e-5)]
    begun = np.any([np.isnan(other) != np.isnan(here.scalar) for other in moved], axis=0)
    off = np.max([np.nan_to_num(np.abs(other - here.scalar)) for other in moved], axis=0)
    return np.asarray(begun | (off > 1e-3 * max(1.0, np.nanmax(here.scalar, initial=0.0))))


def or_zero(image: ss.Image) -> NDArray[np.float32]:
    """Return the pixels of any mode, 0 where no slice counts."""
    return np.nan_to_num(image.pixels, nan=0.0)


def assert_right(parts: Parts, image: ss.Image, expected: ss.Image, text: str) -> None:
    """Fail where a picture is farther from the reference's than section 9 allows. Few pixels may jump."""
    gentle = oracle.is_gentle(*build_effects(oracle, parts))
    bounds = FLOAT32 if gentle else FLOAT32_HARD
    found = off_by(image, expected)
    if within(found, bounds):
        log.info(f"{text}: RMSE {found['rmse']:.3g}, P99.9 {found['p99_9']:.3g}, maximum {found['maximum']:.3g}")
    else:
        pixels = np.array(image.pixels)
        left_out = jumping(parts)
        if left_out.sum() == 1:
            # Of a picture this small one pixel is more than the share that is allowed.
            pixels[left_out] = expected.pixels[left_out]
            left_out = None
        assert_close(pixels, expected.pixels, bounds, text, left_out)
    assert_close(image.coverage, expected.coverage, FLOAT32_HARD, f"{text} coverage")
    assert_same_depths(image.depth, expected.depth)


@cache
def reference(kind: str, fields: str, look: str) -> ss.Image:
    return draw(parts_of(kind, fields, look), "reference")


def parts_of(kind: str, fields: str, look: str) -> Parts:
    """Return a scene by names: mode or surfaces, fields, and effects."""
    if kind in SURFACES:
        return scene_of(fields, mode="isosurface", iso_value=SURFACES[kind], **EFFECTS[look])
    if kind == "composite":
        return scene_of(fields, **COMPOSITES[look])
    parts = scene_of(fields, mode=kind, lit=False, **{"slice_spacing": 0.2} | EFFECTS[look])
    # Quotients that do not fall to 0 where kernels end.
    divided = [one.get("normalization", "threshold" if "centers" in one else "") for one in parts["fields"]]
    made = [one | {"w0": 1e-3} if by == "threshold" else one for one, by in zip(parts["fields"], divided, strict=True)]
    return parts | {"fields": made}


def check(kind: str, fields: str, look: str, backend: str, **options: Any) -> ss.Image:
    expected = reference(kind, fields, look)
    image = draw(parts_of(kind, fields, look), backend, **options)
    assert np.nanmax(np.abs(expected.pixels)) > 0.05
    assert_right(parts_of(kind, fields, look), image, expected, f"{backend} {kind} {fields} {look} {options}")
    return image


@pytest.mark.parametrize(("fields", "look", "backend"), cases(FIELDS, list(COMPOSITES)))
def test_groups_are_mixed(fields: str, look: str, backend: str) -> None:
    check("composite", fields, look, backend)


@pytest.mark.parametrize(("surfaces", "number", "backend"), cases(list(SURFACES), range(len(EFFECTS))))
def test_surfaces_of_groups(surfaces: str, number: int, backend: str) -> None:
    check(surfaces, FIELDS[number % len(FIELDS)], list(EFFECTS)[number], backend)


@pytest.mark.parametrize("kind", ["composite", "three"])
@pytest.mark.parametrize("look", EFFECTS)
def test_volumes_that_end_in_different_places(look: str, kind: str) -> None:
    check(kind, "two ends", look, "cpu")


@pytest.mark.parametrize(("surfaces", "look", "backend"), cases(list(SURFACES), ["plain", "central", "clip"]))
def test_surfaces_of_one_group(surfaces: str, look: str, backend: str) -> None:
    for stop in (1.0, 0.6):
        parts = scene_of("three", first=True, mode="isosurface", iso_value=SURFACES[surfaces], **EFFECTS[look])
        parts["scene"]["opacity_stop"] = stop
        parts |= {"groups": [[0, 1]], "transfer": [parts["transfer"]]}
        text = f"{backend} {surfaces} of one group {look} stop {stop}"
        assert_right(parts, draw(parts, backend), draw(parts, "reference"), text)


SCALAR_LOOKS = ["plain", "slab", "central", "near", "ewa", "clip"]


@pytest.mark.parametrize(
    ("look", "fields", "mode", "backend"), cases(SCALAR_LOOKS, FIELDS, ["minimum", "average"], rounds=2)
)
def test_slices_that_count(mode: str, fields: str, look: str, backend: str) -> None:
    image = check(mode, fields, look, backend)
    empty = image.coverage == 0
    assert empty.any() or look == "ewa" or (fields != "clouds" and look != "clip")
    assert np.array_equal(np.isnan(image.scalar), empty)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("culling", [True, False])
@pytest.mark.parametrize("mode", ["minimum", "average"])
def test_kernels_without_weight_do_not_count(mode: str, culling: bool, backend: str) -> None:
    field = cloud(np.random.default_rng(3), 30, 3.0, 2.0, w0=1e-3)
    field["weights"] = (np.arange(30) % 3 > 0).astype(float)
    parts = scene_parts.parts([field], size=SIZE, mode=mode, lit=False)
    image = draw(parts, backend, effects={"culling": culling})
    parts |= {"groups": [[0]], "transfer": [parts["transfer"]]}
    assert_right(parts, image, draw(parts, "reference"), f"{backend} {mode} without weights")
    counted = draw(parts | {"fields": [field | {"weights": np.ones(30)}]}, backend)
    assert off_by(or_zero(image), or_zero(counted))["rmse"] > 1e-3


def random_parts(seed: int) -> Parts:
    """Return a random scene of groups. Light volumes have errors of their own: no light is lost on its way."""
    parts = group_scene(seed)
    for name in ("shadows", "ambient_occlusion"):
        parts["scene"].pop(name, None)
    return parts


# (OpenGL refuses some others: lit quotients of weights that differ much, close-ups.)
@pytest.mark.parametrize(
    ("seed", "backend"),
    [(seed, "cpu") for seed in range(60, 120)]
    + [pytest.param(seed, "gl", marks=pytest.mark.gl) for seed in range(61, 120, 4)],
)
def test_random_groups(seed: int, backend: str) -> None:
    parts = random_parts(seed)
    assert_right(parts, draw(parts, backend), draw(parts, "reference"), f"{backend} random {seed}")


KINDS = [("composite", "three", "faded-intervals-analytic"), ("three", "three", "clip"), ("average", "three", "clip")]
KINDS += [("composite", "three", "stopped"), ("minimum", "clouds", "central")]


@pytest.mark.parametrize(("kind", "fields", "look"), KINDS)
def test_threads_and_tiles_change_nothing(kind: str, fields: str, look: str) -> None:
    whole = check(kind, fields, look, "cpu", threads=1)
    again = check(kind, fields, look, "cpu", threads=3)
    for name in ("pixels", "coverage", "depth"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(again, name))
    for tile_size in (8, 13):
        pieces = check(kind, fields, look, "cpu", tile_size=tile_size)
        assert_close(pieces.pixels, whole.pixels, FLOAT32, f"pieces of {tile_size} {kind} {look}")
    exact = check(kind, fields, look, "cpu", precision="float64")
    wanted = reference(kind, fields, look).pixels
    assert np.array_equal(np.isnan(exact.pixels), np.isnan(wanted))
    assert np.nanmax(np.abs(exact.pixels - wanted)) < 2e-6 * max(1, np.nanmax(exact.pixels))


WAYS: list[tuple[str, str, dict[str, Any]]] = [
    ("three", "first", {"packing": "paper"}),
    ("minimum", "clip", {"packing": "paper"}),
    ("average", "central", {"packing": "paper"}),
    ("three", "stopped", {"effects": {"elimination": True}, "tagging": "depth_equal"}),
    ("composite", "stopped", {"effects": {"elimination": True, "compensation": True}, "tagging": "off"}),
    ("composite", "plain", {"effects": {"resident_sections": True}, "tile_size": 13}),
    ("composite", "analytic", {"effects": {"culling": False, "weight": True}}),
]


@pytest.mark.gl
@pytest.mark.parametrize("number", range(len(WAYS)))
def test_ways_of_opengl(number: int) -> None:
    kind, look, options = WAYS[number]
    if look == "first":
        parts = scene_of("three", first=True, mode="isosurface", iso_value=SURFACES[kind])
        parts |= {"groups": [[0, 1]], "transfer": [parts["transfer"]]}
    elif kind == "three":
        parts = parts_of(kind, "three", "plain")
        parts["scene"]["opacity_stop"] = 0.6
    else:
        parts = parts_of(kind, "clouds", look)
    image = draw(parts, "gl", **options)
    assert_right(parts, image, draw(parts, "reference"), f"gl {kind} {look} {options}")


# Scenes that are wrong by a little: by what the scene's parts are changed.
WRONG: dict[str, tuple[tuple[str, str, str], dict[str, Any]]] = {
    "a little more opacity of the last group": (
        ("composite", "three", "plain"),
        {"transfer": [GENTLE, WARM, [*LARGE[:-1], (900.0, 0.6, 1.0, 0.7, 0.26)]]},
    ),
    "groups in other groups' colours": (("composite", "clouds", "unlit"), {"transfer": [GENTLE, WARM]}),
    "one group instead of two": (("composite", "three", "intervals"), {"groups": [[0], [1, 2], [3]]}),
    "a surface's opacity": (("three", "three", "plain"), {"iso_value": [(0.55, 1.0), (0.2, 0.31), (0.4, 0.5)]}),
    "a surface's place": (("three", "lattices", "plain"), {"iso_value": [(0.55, 1.0), (0.2, 0.3), (0.401, 0.5)]}),
    "the stop": (("three", "clouds", "central"), {"opacity_stop": 0.7}),
    "the least of fewer slices": (("minimum", "lattices", "plain"), {"slice_spacing": 0.21}),
    "the mean of points outside of the clip": (("average", "three", "clip"), {"clip": None}),
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_wrong_by_a_little_is_seen(wrong: str, backend: str) -> None:
    names, change = WRONG[wrong]
    parts = parts_of(*names)
    scene = parts["scene"] | {name: value for name, value in change.items() if name not in parts}
    parts |= {name: value for name, value in change.items() if name in parts}
    parts["scene"] = {name: value for name, value in scene.items() if value is not None}
    found = distance(or_zero(draw(parts, backend)), or_zero(reference(*names)))
    assert not found.within(FLOAT32_HARD), found


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("look", ["plain", "intervals"])
def test_groups_that_do_not_meet_are_one(look: str, backend: str) -> None:
    rng = np.random.default_rng(5)
    fields = [cloud(rng, 8, 1.0, 2.0, w0=0.3) for _ in range(2)]
    for field, side in zip(fields, (-1, 1), strict=True):
        # Farther apart than two pixels and two slices.
        field["centers"] = 0.3 * field["centers"] + [side * 1.6, 0, side * 1.6]
        field["scales"] = 0.3 * field["scales"]
    camera = parallel((0, 0, -1), 6.0, up=(0, 1, 0))
    parts = scene_parts.parts(fields, camera, size=(40, 30), slice_spacing=0.1, **COMPOSITES[look])
    one = draw(parts, backend)
    two = draw(parts | {"groups": [[0], [1]], "transfer": [GENTLE] * 2}, backend)
    assert one.pixels.max() > 0.1
    assert np.abs(one.pixels - two.pixels).max() < 1e-6
    assert_same_depths(two.depth, one.depth)


# Each group alone ends at an opacity of 0.79, both at 0.96, in steps of 0.2 of what is left.
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("look", [{}, {"preintegration": True}, {"mode": "isosurface", "iso_value": [(0.5, 0.55)]}])
@pytest.mark.parametrize("stop", [0.7, 0.85, 0.9])
def test_groups_stop_together(stop: float, look: dict[str, Any], backend: str) -> None:
    ball = {"centers": np.zeros((1, 3)), "scales": np.ones((1, 3)), "values": np.ones(1), "normalization": "none"}
    other = ball | {"centers": np.full((1, 3), 0.01)}
    parts = scene_parts.parts([ball, other], parallel(height=0.3), size=(3, 3)) | {
        "groups": [[0], [1]],
        "transfer": [[(0.0, 1.0, 0.0, 0.0, 0.1), (1.0, 0.0, 1.0, 0.0, 0.11)]] * 2,
        "scene": {"slice_spacing": 0.15, "reference_length": 0.15, "opacity_stop": stop, **look},
    }
    scene, camera, size = scene_parts.build(ss, parts)
    expected = ss.Renderer("reference").render(scene, camera, size=size)
    assert stop <= expected.pixels[..., 3].min() and expected.pixels[..., 3].max() < 0.96
    assert_close(ss.Renderer(backend).render(scene, camera, size=size), expected, FLOAT32, "both groups")


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_field_in_two_groups(backend: str) -> None:
    """The index of a field is kept for each place in which the scene has it."""
    field = ss.RegularField(np.random.default_rng(2).random((7, 7, 7), np.float32), spacing=(0.3, 0.3, 0.3))
    low, high = [(0.2, 1, 0, 0, 0), (0.35, 1, 0, 0, 0.4), (0.5, 1, 0, 0, 0)], [(0.5, 0, 1, 0, 0), (0.7, 0, 1, 0, 0.5)]
    scattered = ss.EllipsoidField(*ellipsoids_of(4), w0=0.3)
    for shown in (field, scattered):
        scene = ss.Scene([shown, shown], [low, high], lights=[ss.Light((0, 0, 1))])
        camera = ss.Camera.fit(scene, (-0.5, -0.4, -0.8))
        image = ss.Renderer(backend).render(scene, camera, size=SIZE)
        expected = ss.Renderer("reference").render(scene, camera, size=SIZE)
        assert expected.pixels[..., 0].max() > 0.05
        assert expected.pixels[..., 1].max() > 0.05
        assert_close(image.pixels, expected.pixels, FLOAT32_HARD, f"{backend} a field in two groups")
        alone = ss.Renderer(backend).render(ss.Scene(shown, low, lights=[ss.Light((0, 0, 1))]), camera, size=SIZE)
        assert 0 < alone.stats["kernels_visible"] <= image.stats["kernels_visible"]


def ellipsoids_of(seed: int) -> tuple[Any, ...]:
    """Return centres, scales, rotations and values."""
    made = cloud(np.random.default_rng(seed), 24, 4.0, 2.0)
    return made["centers"], made["scales"], made["rotations"], made["values"]


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("boundary", ["edge", "zero"])
def test_kernels_are_culled_by_their_own_group(boundary: str, backend: str) -> None:
    """What one transfer function hides is drawn where another one's field needs it, and nowhere else."""
    rng = np.random.default_rng(6)
    options: dict[str, Any] = {"spacing": (0.3,) * 3, "boundary": boundary}
    fields = [ss.RegularField(rng.random((9, 9, 9), np.float32) * scale, **options) for scale in (1, 100)]
    hidden = [(200.0, 1, 1, 1, 0.0), (300.0, 1, 1, 1, 1.0)]
    scene = ss.Scene(fields, [WARM, hidden])
    camera = ss.Camera.fit(scene, (-0.5, -0.4, -0.8))
    image = ss.Renderer(backend).render(scene, camera, size=SIZE)
    alone = ss.Renderer(backend).render(ss.Scene(fields[0], WARM), camera, size=SIZE)
    # Mirrored samples are kernels, too.
    assert image.stats["kernels_visible"] == alone.stats["kernels_visible"]
    assert alone.stats["kernels_visible"] <= (9**3 if boundary == "zero" else 13**3)
    # (The slices of both scenes are the same: so are the boxes of all centres.)
    assert np.abs(image.pixels - alone.pixels).max() < 1e-6


@pytest.mark.parametrize("backend", BACKENDS)
def test_groups_shade_each_other(backend: str) -> None:
    """Shadows and ambient occlusion count the opacities of all groups, as far as volumes resolve them."""
    parts = scene_of("clouds", transfer=OPAQUE)
    light = {"shadows": True, "ambient_occlusion": {"radius": 0.4, "strength": 0.8}}
    shaded = parts | {"scene": parts["scene"] | light}
    image, expected = draw(shaded, backend), draw(shaded, "reference")
    found = off_by(image, expected)["rmse"]
    plain = off_by(draw(parts, backend), expected)["rmse"]
    assert found < 0.1 * plain
    assert found <= image.plan.expected_error
    # One group's shadows alone are too few.
    lighter = shaded | {"transfer": [shaded["transfer"][0], [(*point[:4], 1e-3 * point[4]) for point in GENTLE]]}
    assert off_by(draw(lighter, backend), expected)["rmse"] > 2 * found


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("kind", ["composite", "three", "average", "minimum"])
def test_stages_and_estimates(kind: str, backend: str) -> None:
    parts = parts_of(kind, "clouds", "plain")
    scene, camera, _ = build_effects(ss, parts)
    renderer = ss.Renderer(backend)
    size = (72, 60)
    stages = list(renderer.progressive(scene, camera, size=size, first_seconds=1e-4))
    assert len(stages) > 1
    last = stages[-1]
    np.testing.assert_array_equal(last.pixels, renderer.render(scene, camera, size=size).pixels)
    coarse = off_by(or_zero(stages[0]), or_zero(last))["rmse"]
    assert 0.2 * coarse < stages[0].stats["estimated_rmse"] < 5 * coarse
    finer = scene.replace(slice_spacing=scene.slice_spacing / 16, opacity_stop=1.0, reference_length=0.13)
    limit = ss.Renderer("cpu", precision="float64").render(finer, camera, size=size)
    error = off_by(or_zero(last), or_zero(limit))["rmse"]
    estimated = last.error.rmse
    assert 0.4 * error < estimated < 2.5 * error
