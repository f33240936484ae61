"""Depth limits: a surface drawn elsewhere hides what lies behind it. Conventions, section 10."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import oracle
import pytest
from image_checks import FLOAT32, FLOAT32_HARD, assert_close, distance
from test_gl_effects import CUBE, SIZE, TILTED, Case, ambiguous, make
from test_oracle import build_effects, effect_scene, excess, expected, pixels

import sheetsplat as ss

# Some pictures are hidden altogether.
pytestmark = pytest.mark.filterwarnings("ignore:nothing can be seen", "ignore:all values have one colour")

WIDTH, HEIGHT = SIZE
SPACING = 0.2
OUTPUTS: Any = ("coverage", "depth")
# The options of a scene for each kind of loop over slices that there is.
WAYS: dict[str, dict[str, Any]] = {
    "composite": {},
    "stop": {"opacity_stop": 0.9},
    "clip": {"clip": ss.Clip(TILTED)},
    "slab": {"sampling": "slab"},
    "analytic": {"gradient": "analytic"},
    "preintegration": {"preintegration": True},
    "second_order": {"preintegration": "second_order"},
    "isosurface": {"mode": "isosurface", "iso_value": 0.45},
    "surfaces": {"mode": "isosurface", "iso_value": ((0.2, 0.4), (0.45, 0.7), (0.7, 1.0))},
    "xray": {"mode": "xray"},
    "mip": {"mode": "mip"},
    "minimum": {"mode": "minimum", "clip": ss.Clip(box=CUBE)},
    "average": {"mode": "average"},
}
BACKENDS = ["cpu", pytest.param("gl", marks=pytest.mark.gl)]


def case_of(way: str, projection: str = "orthographic", field: str = "cartesian", **more: Any) -> Case:
    """Return a scene; unlit in scalar modes, which show no light."""
    scalar = WAYS[way].get("mode") in ("xray", "mip", "minimum", "average")
    normalization = "threshold" if field == "ellipsoids" else "lattice"
    return Case(field, normalization, projection, lit=not scalar, **more).with_(**WAYS[way])


def surface(case: Case, seed: int = 7) -> np.ndarray:
    """Return depths of steps inside the field, some in front of it, some behind, some infinite."""
    scene, camera = make(case)
    plan = ss.Renderer("reference").plan(scene, camera, size=SIZE)
    rng = np.random.default_rng(seed)
    steps = rng.uniform(-2, plan.slices + 2, (6, 7)).repeat(6, axis=0).repeat(7, axis=1)[:HEIGHT, :WIDTH]
    depths = plan.first_depth + (steps + 0.05 * rng.random(steps.shape)) * plan.slice_spacing
    depths[:, -5:] = np.inf
    return np.asarray(depths)


def drawn(case: Case, depths: Any, backend: str = "reference", **options: Any) -> ss.Image:
    """Return a picture, with coverage and, where there is one, depth."""
    scene, camera = make(case)
    outputs = OUTPUTS if case.lit else ("coverage",)
    return ss.Renderer(backend, **options).render(scene, camera, size=SIZE, outputs=outputs, depth_limit=depths)  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", range(0, 90, 5))
def test_reference_is_the_oracle(seed: int, reference_renderer: ss.Renderer) -> None:
    """In random scenes with all other effects."""
    parts = effect_scene(seed)
    scene, camera, size = build_effects(ss, parts)
    plan = reference_renderer.plan(scene, camera, size=size)
    steps = np.random.default_rng(seed).uniform(-1, plan.slices + 1, size[::-1])
    depths = plan.first_depth + steps * plan.slice_spacing
    if camera.kind == "perspective":
        depths = np.maximum(depths, 0.0)
    image = reference_renderer.render(scene, camera, size=size, outputs=("coverage",), depth_limit=depths)
    wanted = oracle.render(*build_effects(oracle, parts), depth_limit=depths)
    assert excess(pixels(image), expected(wanted)) <= 1
    assert excess(image.coverage, wanted.coverage) <= 1


@pytest.mark.parametrize("way", [way for way in WAYS if "clip" not in WAYS[way]])
def test_a_plane_across_the_view_is_a_clip(way: str) -> None:
    """With every camera: a plane of one depth cuts off what a clip behind it does."""
    for projection in ("orthographic", "perspective"):
        case = case_of(way, projection)
        scene, camera = make(case)
        plan = ss.Renderer("reference").plan(scene, camera, size=SIZE)
        depth = plan.first_depth + (0.42 * plan.slices // 1 + 0.3) * plan.slice_spacing
        back = np.array(camera.world_axes()[2])
        clip = ss.Clip(planes=[(tuple(back.tolist()), float(back @ np.array(camera.eye) - depth))])
        for backend in ("reference", "cpu"):
            limited = drawn(case, depth, backend)
            clipped = drawn(case.with_(clip=clip), None, backend)
            # (The planes' places are rounded.)
            assert np.array_equal(limited.pixels, clipped.pixels, equal_nan=True)
            assert np.array_equal(limited.coverage, clipped.coverage)
            nearer = drawn(case, depth - plan.slice_spacing, backend)
            assert not np.array_equal(limited.pixels, nearer.pixels), "a plane a slice distance off must be seen"


@pytest.mark.parametrize("way", WAYS)
def test_each_pixel_is_that_of_a_picture_with_its_depth_everywhere(way: str) -> None:
    for projection in ("orthographic", "perspective"):
        case = case_of(way, projection)
        scene, camera = make(case)
        plan = ss.Renderer("reference").plan(scene, camera, size=SIZE)
        levels = plan.first_depth + (np.array([0.3, 0.5, 0.7, 2.0]) * plan.slices + 0.21) * plan.slice_spacing
        which = np.random.default_rng(2).integers(0, len(levels), (HEIGHT, WIDTH))
        mixed = drawn(case, levels[which])
        for number, depth in enumerate(levels):
            whole = drawn(case, depth)
            there = which == number
            assert np.array_equal(mixed.pixels[there], whole.pixels[there], equal_nan=True)
            assert np.array_equal(mixed.coverage[there], whole.coverage[there])
        assert not np.array_equal(mixed.pixels, whole.pixels)


def test_slices_add_up_one_by_one(reference_renderer: ss.Renderer) -> None:
    """An X-ray gains a slice's own scalar, times the slice distance, as the limit passes the slice, and only there."""
    case = case_of("xray")
    scene, camera = make(case)
    plan = reference_renderer.plan(scene, camera, size=SIZE)
    number = plan.slices // 2
    depth = plan.first_depth + number * plan.slice_spacing
    at, past = drawn(case, depth).scalar, drawn(case, depth + 1e-5 * plan.slice_spacing).scalar
    # "At" includes a millionth of the slice distance.
    assert np.array_equal(at, drawn(case, depth + 0.5e-6 * plan.slice_spacing).scalar)
    assert np.array_equal(at, drawn(case, depth - 0.99 * plan.slice_spacing).scalar)
    slope = 2.0 * camera.height / HEIGHT
    right, up, back = map(np.array, camera.world_axes())
    row, column = HEIGHT // 2 - 3, WIDTH // 2 + 2
    x = (column + 0.5 - WIDTH / 2) * 0.5 * slope
    y = (HEIGHT / 2 - row - 0.5) * 0.5 * slope
    point = np.array(camera.eye) + x * right + y * up - depth * back
    rho = scene.fields[0].probe(point[None])[0][0]
    assert rho > 0.1
    assert past[row, column] - at[row, column] == pytest.approx(rho * plan.slice_spacing, abs=1e-6)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("way", WAYS)
def test_backends_draw_what_the_reference_draws(way: str, backend: str) -> None:
    for projection, field in (("orthographic", "ellipsoids"), ("perspective", "cartesian")):
        case = case_of(way, projection, field, visible_zero=way in ("composite", "preintegration"))
        depths = surface(case)
        wanted, found = drawn(case, depths), drawn(case, depths, backend)
        assert found.plan.has("depth_limit") and wanted.plan.has("depth_limit")
        name = f"depth limit {backend} {case}"
        assert_close(found.pixels, wanted.pixels, FLOAT32_HARD, name, ambiguous(case))
        assert np.allclose(found.coverage, wanted.coverage, rtol=2e-5, atol=2e-5)
        nearer = drawn(case, depths - 0.9 * SPACING)
        assert distance(nearer.pixels, wanted.pixels).rmse > 10 * FLOAT32_HARD[0], "a slice too few must be seen"
        if case.lit:
            both = np.isfinite(found.depth) & np.isfinite(wanted.depth)
            assert np.mean(np.isfinite(found.depth) != np.isfinite(wanted.depth)) < 0.005
            assert np.quantile(np.abs(found.depth[both] - wanted.depth[both]), 0.99) < 1e-4


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("boundary", ["edge", "zero"])
def test_groups_with_transfer_functions_of_their_own(boundary: str, backend: str) -> None:
    for options in ({}, {"preintegration": True}, {"mode": "isosurface", "iso_value": ((0.3, 0.5), (0.6, 1.0))}):
        case = Case("cartesian", lit=True).with_(**options)
        scene, camera = make(case)
        cube = scene.fields[0].replace(boundary=boundary)
        block = ss.RegularField(np.ones((5, 5, 5), np.float32), spacing=(0.3, 0.3, 0.3), boundary=boundary)
        if boundary == "edge":
            # It ends where the other volume does: OpenGL draws no others together.
            block = cube.replace(values=np.full_like(cube.values, 0.7), base=0.5)
        both = ss.Scene(
            [[cube], [block]],
            [scene.transfer_function, ss.TransferFunction([(0, 1, 0, 0, 0), (1, 0, 1, 0, 0.3)])],
            lights=scene.options["lights"],
            slice_spacing=SPACING,
            opacity_stop=1.0,
            **options,
        )
        depths = surface(case)
        pictures = [
            ss.Renderer(name).render(both, camera, size=SIZE, depth_limit=depths)
            for name in ("reference", backend)  # type: ignore[arg-type]
        ]
        assert_close(pictures[1].pixels, pictures[0].pixels, FLOAT32_HARD, f"groups {backend} {options}")
        whole = ss.Renderer("cpu").render(both, camera, size=SIZE)
        assert distance(whole.pixels, pictures[0].pixels).rmse > 0.01


def test_tiles_and_precision_change_nothing_of_the_cut() -> None:
    """On the processor: tiles are limited each by its own part of the depths, and end with them."""
    case = case_of("composite", field="ellipsoids")
    depths = surface(case)
    wanted = drawn(case, depths)
    for options in ({"tile_size": 8}, {"tile_size": 120}, {"threads": 1}, {"precision": "float64"}):
        found = drawn(case, depths, "cpu", **options)
        assert_close(found.pixels, wanted.pixels, FLOAT32, f"depth limit {options}")


def test_pixels_end_at_the_surface() -> None:
    """A surface in front of most of a volume spares the work behind it, which coverage counts only up to there."""
    field = ss.RegularField(np.random.default_rng(1).random((60, 60, 60), dtype=np.float32))
    scene = ss.Scene(field, [(0, 1, 1, 1, 0), (1, 1, 1, 1, 0.01)], opacity_stop=1.0)
    camera = ss.Camera.fit(field)
    renderer = ss.Renderer("cpu")
    whole = renderer.render(scene, camera, size=(200, 200))
    plan = whole.plan
    early = renderer.render(
        scene, camera, size=(200, 200), depth_limit=plan.first_depth + 0.2 * plan.slices * plan.slice_spacing
    )
    assert early.stats["sections_drawn"] < 0.35 * whole.stats["sections_drawn"]


@pytest.mark.parametrize("backend", [*BACKENDS, "reference"])
def test_plans_say_what_the_surface_does(backend: str) -> None:
    case = case_of("composite")
    scene, camera = make(case)
    renderer = ss.Renderer(backend)  # type: ignore[arg-type]

    def row(depths: Any) -> ss.Effect:
        plan = renderer.plan(scene, camera, size=SIZE, depth_limit=depths)
        return next(effect for effect in plan.effects if effect.name == "depth_limit")

    plan = renderer.plan(scene, camera, size=SIZE)
    last = plan.first_depth + plan.slices * plan.slice_spacing
    assert not row(None).on and "no depths" in row(None).reason
    assert not row(np.inf).on and not row(last + 3 * SPACING).on
    assert row(0.5 * (plan.first_depth + last)).on
    assert "the picture is empty" in row(plan.first_depth - SPACING).reason
    far = renderer.render(scene, camera, size=SIZE, depth_limit=last + 3 * SPACING)
    assert np.array_equal(far.pixels, renderer.render(scene, camera, size=SIZE).pixels)
    with pytest.warns(ss.PictureWarning, match="depth_limit hides all"):
        empty = renderer.render(scene, camera, size=SIZE, outputs=OUTPUTS, depth_limit=plan.first_depth - SPACING)
    assert not empty.pixels.any() and not empty.coverage.any() and np.isinf(empty.depth).all()


def test_stages_lead_to_the_limited_picture() -> None:
    """Coarse stages see the surface through their own pixels."""
    rng = np.random.default_rng(4)
    field = ss.RegularField(rng.random((48, 48, 48), dtype=np.float32))
    scene = ss.Scene(field, [(0, 1, 0.5, 0, 0), (1, 0, 0.5, 1, 0.2)])
    for kind in ("orthographic", "perspective"):
        camera = ss.Camera.fit(field, kind=kind)  # type: ignore[arg-type]
        renderer = ss.Renderer("cpu")
        size = (161, 120)
        plan = renderer.plan(scene, camera, size=size)
        depths = np.full((120, 161), plan.first_depth + 0.02 * plan.slices * plan.slice_spacing)
        depths[:, 80:] = np.inf
        stages = list(renderer.progressive(scene, camera, size=size, first_seconds=1e-4, depth_limit=depths))
        assert len(stages) > 2
        last = renderer.render(scene, camera, size=size, depth_limit=depths).pixels
        assert np.array_equal(stages[-1].pixels, last)
        whole = renderer.render(scene, camera, size=size).pixels
        for stage in stages[1:]:
            assert distance(stage.pixels, last).rmse < 0.5 * distance(whole, last).rmse


def test_parts_of_large_pictures_have_their_parts_of_the_depths(tmp_path: Any) -> None:
    case = case_of("composite")
    scene, camera = make(case)
    depths = surface(case)
    renderer = ss.Renderer("cpu")
    from sheetsplat.tiles import render_tiles

    parts = render_tiles(scene, camera, SIZE, tmp_path / "x.npy", renderer=renderer, tile=17, depth_limit=depths)
    wanted = renderer.render(scene, camera, size=SIZE, depth_limit=depths).pixels
    assert distance(parts, wanted).within(FLOAT32)
    assert not distance(parts, renderer.render(scene, camera, size=SIZE).pixels).within(FLOAT32_HARD)


@pytest.mark.parametrize("way", ["composite", "isosurface", "mip"])
def test_pick_looks_in_front_of_the_surface(way: str) -> None:
    case = case_of(way)
    scene, camera = make(case)
    renderer = ss.Renderer("reference")
    whole = renderer.render(scene, camera, size=SIZE)
    x, y = WIDTH // 2, HEIGHT // 2
    seen = whole.pick(x, y)
    assert seen is not None
    depths = np.full((HEIGHT, WIDTH), np.inf)
    depths[y, x] = seen.depth - 0.01 * SPACING
    image = renderer.render(scene, camera, size=SIZE, depth_limit=depths)
    nearer = image.pick(x, y)
    assert nearer is None or nearer.depth < depths[y, x]
    assert image.pick(x + 1, y) == whole.pick(x + 1, y)


def test_the_error_is_that_of_the_limited_picture() -> None:
    """What lies behind the surface has no part in it."""
    case = case_of("composite").with_(opacity_stop=0.98)
    scene, camera = make(case)
    renderer = ss.Renderer("cpu")
    plan = renderer.plan(scene, camera, size=SIZE)
    depths = np.full((HEIGHT, WIDTH), np.inf)
    depths[:, : WIDTH // 2] = plan.first_depth - SPACING
    error = renderer.render(scene, camera, size=SIZE, depth_limit=depths).error
    whole = renderer.render(scene, camera, size=SIZE).error
    assert not error.map[:, : WIDTH // 2].max() > 1e-6 and whole.map[:, : WIDTH // 2].max() > 1e-3
    # Up to how fast errors fall in each of the pictures, which is one number for all pixels.
    seen, known = error.map[:, WIDTH // 2 :], whole.map[:, WIDTH // 2 :]
    factor = float(seen.sum() / known.sum())
    assert 0.9 < factor < 1.1
    assert np.allclose(seen, factor * known, rtol=1e-3, atol=1e-6)


def test_settings_for_an_error_serve_other_depths() -> None:
    """The picture has the depths of its own call, whenever the settings were chosen."""
    case = case_of("composite")
    scene, camera = make(case)
    scene = scene.replace(slice_spacing=None, opacity_stop=0.98)
    renderer = ss.Renderer("cpu", max_error=0.02)
    first, second = (renderer.render(scene, camera, size=SIZE, depth_limit=depth) for depth in (3.1, 2.6))
    assert first.settings == second.settings
    assert not np.array_equal(first.pixels, second.pixels)
    assert np.array_equal(renderer.render(scene, camera, size=SIZE, depth_limit=3.1).pixels, first.pixels)
    assert np.array_equal(renderer.render(scene, camera, size=SIZE).pixels.shape, first.pixels.shape)


@pytest.mark.parametrize("boundary", ["edge", "zero"])
def test_light_passes_behind_the_surface(boundary: str) -> None:
    """What a surface hides still casts shadows: a depth limit is one of the camera's rays, not of the light's."""
    # A slope, which light shows up to its ends.
    values = np.broadcast_to(np.linspace(0.6, 1, 24, dtype=np.float32)[:, None, None], (24, 24, 24))
    field = ss.RegularField(values, boundary=boundary)
    scene = ss.Scene(
        field, [(0, 1, 1, 1, 0), (0.5, 1, 1, 1, 0.3)], lights=[ss.Light((0, 0, -1))], shadows=True, opacity_stop=1.0,
        material=ss.Material(0.1, 0.9, two_sided=True),
    )  # fmt: skip
    camera = ss.Camera.fit(field)
    for backend in ("reference", "cpu"):
        renderer = ss.Renderer(backend)  # type: ignore[arg-type]
        plan = renderer.plan(scene, camera, size=(12, 12))
        depth = plan.first_depth + 6.5 * plan.slice_spacing
        limited = renderer.render(scene, camera, size=(12, 12), depth_limit=depth)
        clip = ss.Clip(planes=[((0, 0, 1), float(np.array(camera.eye)[2] - depth))])
        clipped = renderer.render(scene.replace(clip=clip), camera, size=(12, 12))
        assert limited.rgba[6, 6, 3] == pytest.approx(clipped.rgba[6, 6, 3], abs=1e-6)
        assert limited.rgba[6, 6, 0] < 0.9 * clipped.rgba[6, 6, 0]


BAD: list[tuple[Any, str]] = [
    (np.ones((WIDTH, HEIGHT)), r"shape \(44, 36\)"),
    (np.ones((HEIGHT, WIDTH, 1)), "shape"),
    (np.ones(3), "shape"),
    ([], "shape"),
    (np.full((HEIGHT, WIDTH), np.nan), "NaN at 1584 pixels.*nan_to_num"),
    (-np.inf, "the depth -inf"),
    ("near", "depths"),
    (np.full((HEIGHT, WIDTH), 1j), "complex"),
    (object(), "depths"),
]


@pytest.mark.parametrize(("depths", "message"), BAD)
def test_unusable_depths_are_refused(depths: Any, message: str) -> None:
    scene, camera = make(case_of("xray"))
    renderer = ss.Renderer("cpu")
    calls: list[Callable[..., Any]] = [renderer.render, renderer.plan, renderer.progressive, ss.render]
    for call in calls[:3]:
        with pytest.raises(ss.InvalidInput, match=message) as error:
            call(scene, camera, size=SIZE, depth_limit=depths)
        assert error.value.option == "depth_limit"
    with pytest.raises(ss.InvalidInput, match=message):
        ss.render(scene, camera=camera, size=SIZE, depth_limit=depths)


def test_depths_of_any_type_and_sign_of_the_eye() -> None:
    """Integers, lists, masks and float32; behind the eye only where cameras see what is there."""
    case = case_of("xray")
    scene, camera = make(case)
    renderer = ss.Renderer("cpu")
    wanted = renderer.render(scene, camera, size=SIZE, depth_limit=3.0).pixels
    threes = np.full((HEIGHT, WIDTH), 3)
    same: list[Any] = [threes, threes.astype(np.float32).tolist(), threes.astype(">f4")]
    for depths in same:
        assert np.array_equal(renderer.render(scene, camera, size=SIZE, depth_limit=depths).pixels, wanted)
    masked = np.ma.masked_array(np.full((HEIGHT, WIDTH), 3.0), mask=np.eye(HEIGHT, WIDTH, dtype=bool))
    found = renderer.render(scene, camera, size=SIZE, depth_limit=masked)
    assert np.isinf(found.depth_limit[3, 3]) and found.depth_limit[3, 4] == 3.0  # type: ignore[index]
    with pytest.raises(ss.InvalidInput, match="negative z, pass -depths"):
        renderer.render(*make(replace(case, projection="perspective")), size=SIZE, depth_limit=-3.0)
    middle, away = np.array(camera.target), np.subtract(camera.eye, camera.target)
    behind = ss.Camera.orthographic(middle, middle - away, camera.up, height=camera.height)
    image = renderer.render(scene, behind, size=SIZE, depth_limit=-0.1)
    assert image.pixels.any() and not np.array_equal(image.pixels, renderer.render(scene, behind, size=SIZE).pixels)


def test_pictures_remember_their_depths(tmp_path: Any) -> None:
    import copy
    import pickle

    case = case_of("composite")
    scene, camera = make(case)
    renderer = ss.Renderer("cpu")
    one = renderer.render(scene, camera, size=SIZE, depth_limit=3.0)
    assert one == copy.deepcopy(one) == pickle.loads(pickle.dumps(one))
    assert one != renderer.render(scene, camera, size=SIZE)
    with pytest.raises(ValueError, match="read-only"):
        one.depth_limit[0, 0] = 1.0  # type: ignore[index]
    one.save(tmp_path / "x.png")
    with pytest.raises(ss.InvalidInput, match="does not say how it was made"):
        ss.Recipe.read(tmp_path / "x.png")
