"""Several samples a pixel: the mean of the picture of n times the size, wherever a picture is drawn."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from command_line import run
from error_scenes import OUTLINE, converged, difference, exact_renderer, random_case, rmse

import sheetsplat as ss
from sheetsplat.tiles import render_tiles

SIZE = (20, 16)
POINTS = [(0.1, 0.1, 0.2, 0.9, 0.0), (0.5, 0.2, 0.9, 0.3, 0.15), (1.0, 1.0, 0.8, 0.2, 0.5)]
BACKENDS = ["cpu", pytest.param("gl", marks=pytest.mark.gl), "reference"]
LIT: dict[str, Any] = {"lights": (ss.Light((0.3, 0.5, 1.0)),)}
WAYS: dict[str, dict[str, Any]] = {
    "lit": {**LIT, "background": (0.1, 0.2, 0.3)},
    "filter": {**LIT, "filter": "ewa"},
    "isosurface": {**LIT, "mode": "isosurface", "iso_value": ((0.3, 0.5), (0.6, 1.0))},
    "preintegration": {"preintegration": True},
    "xray": {"mode": "xray"},
    "mip": {"mode": "mip"},
    "minimum": {"mode": "minimum"},
    "average": {"mode": "average"},
}


def volume() -> ss.RegularField:
    """Return a shell with noise, which has detail finer than a pixel."""
    rng = np.random.default_rng(5)
    k, j, i = np.mgrid[-1:1:14j, -1:1:15j, -1:1:16j]
    shell = np.exp(-12 * (np.sqrt(k**2 + j**2 + i**2) - 0.55) ** 2)
    return ss.RegularField((0.85 * shell + 0.15 * rng.random(shell.shape)).astype(np.float32))


def scene_of(way: str, **changes: Any) -> tuple[ss.Scene, ss.Camera]:
    """Return a scene, and a camera that sees it askew in perspective."""
    field = volume()
    camera = ss.Camera.fit(field, direction=(0.45, -0.35, -1.0), kind="perspective")
    return ss.Scene(field, POINTS, **{**WAYS[way], **changes}), camera


def mean_of(fine: np.ndarray, n: int) -> np.ndarray:
    """Return the mean over the numbers in blocks of n x n pixels; NaN where there are none."""
    height, width = fine.shape[0] // n, fine.shape[1] // n
    blocks = fine.astype(np.float64).reshape(height, n, width, n, *fine.shape[2:])
    with np.errstate(invalid="ignore"):
        return (np.nansum(blocks, axis=(1, 3)) / (~np.isnan(blocks)).sum(axis=(1, 3))).astype(np.float32)


def larger(n: int) -> tuple[int, int]:
    """Return the size of the picture with a pixel for each sample."""
    return n * SIZE[0], n * SIZE[1]


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("way", WAYS)
def test_a_picture_is_the_mean_of_one_of_n_times_its_size(backend: str, way: str) -> None:
    outputs: Any = ("coverage", "depth") if "mode" not in WAYS[way] else ("coverage",)
    renderer = ss.Renderer(backend)
    scene, camera = scene_of(way)
    for n in (2, 3) if backend == "reference" else (2, 3, 4):
        image = renderer.render(scene.replace(supersampling=n), camera, SIZE, outputs)
        fine = renderer.render(scene, camera, larger(n), outputs)
        assert image.size == image.plan.size == image.recipe.size == SIZE
        assert image.plan.supersampling == n and f"{n} x {n} samples each" in str(image.plan)
        expected = mean_of(fine.pixels, n)
        assert np.array_equal(image.pixels, expected, equal_nan=True) and image.pixels.dtype == np.float32
        assert np.array_equal(image.coverage, mean_of(fine.coverage, n))
        if "depth" in outputs:
            nearest = fine.depth.reshape(SIZE[1], n, SIZE[0], n).min(axis=(1, 3))
            assert np.array_equal(image.depth, nearest)


def test_one_sample_is_the_default_and_changes_nothing() -> None:
    renderer = ss.Renderer("cpu")
    scene, camera = scene_of("lit")
    one = renderer.render(scene.replace(supersampling=1), camera, SIZE)
    assert scene.supersampling == 1 and one == renderer.render(scene, camera, SIZE)
    assert one.plan.supersampling == 1 and "samples each" not in str(one.plan)
    assert one != renderer.render(scene.replace(supersampling=2), camera, SIZE)


@pytest.mark.parametrize("value", [0, 17, -1, 2.5, True, "2", np.nan, 10**12, [2]])
def test_other_numbers_are_refused(value: Any) -> None:
    with pytest.raises(ss.InvalidInput, match=r"supersampling.*a whole number") as caught:
        ss.render(np.ones((3, 3, 3)), supersampling=value, size=SIZE)
    assert caught.value.option == "supersampling"


def test_the_command_line_has_it(tmp_path: Any, volume: Any) -> None:
    picture, again = tmp_path / "a.png", tmp_path / "b.png"
    small = ("--size", "20x16", "--backend", "cpu")
    run("render", volume, "-o", picture, "--supersampling", "2", *small)
    run("render", picture, volume, "-o", again)
    assert picture.read_bytes() == again.read_bytes()
    assert ss.Recipe.read(picture).options["supersampling"] == 2
    expected = ss.render(volume, supersampling=2, size=SIZE, backend="cpu")
    expected.save(tmp_path / "c.png", metadata=False)
    run("compare", picture, tmp_path / "c.png")
    assert "2 x 2 samples each" in run("plan", volume, "--supersampling", "2", *small).stdout
    for wrong in ("0", "17", "2.5", "two"):
        told = run("render", volume, "-o", again, "--supersampling", wrong, *small, code=2)
        assert "--supersampling" in told.stderr


def test_a_surface_elsewhere_hides_all_samples_of_its_pixels() -> None:
    renderer = ss.Renderer("cpu")
    scene, camera = scene_of("lit", supersampling=3)
    plan = renderer.plan(scene, camera, SIZE)
    depths = plan.first_depth + np.random.default_rng(2).uniform(0, plan.slices, SIZE[::-1]) * plan.slice_spacing
    image = renderer.render(scene, camera, SIZE, depth_limit=depths)
    every = np.kron(depths, np.ones((3, 3)))
    fine = renderer.render(scene.replace(supersampling=1), camera, larger(3), depth_limit=every)
    assert np.array_equal(image.rgba, mean_of(fine.rgba, 3))
    assert np.array_equal(image.depth_limit, depths)


def test_tiles_are_the_picture(tmp_path: Any) -> None:
    scene, _ = scene_of("lit", supersampling=2)
    camera = ss.Camera.fit(scene.fields[0], direction=(0.45, -0.35, -1.0))
    renderer = ss.Renderer("cpu")
    drawn = render_tiles(scene, camera, SIZE, tmp_path / "p.npy", renderer=renderer, tile=14)
    expected = renderer.render(scene, camera, SIZE).rgba
    assert drawn.shape == expected.shape and float(np.abs(drawn - expected).max()) <= 3e-6


def test_pictures_in_bricks_are_means_too() -> None:
    values = np.asarray(volume().values)
    options: dict[str, Any] = {"size": SIZE, "backend": "cpu", "supersampling": 2, "outputs": ("coverage", "depth")}
    surface = {"depth_limit": np.where(np.arange(SIZE[0]) < 10, 20.0, np.inf) * np.ones(SIZE[::-1])}
    bricked = ss.open_bricks(values, brick=8)
    look: dict[str, Any] = {"clim": (0, 1), "camera": ss.Camera.fit(volume()), "slice_spacing": 0.5, "prefilter": False}
    for more in ({}, surface):
        whole = ss.render(values, **options, **look, **more)
        parts = ss.render(bricked, **options, **{k: v for k, v in look.items() if k != "prefilter"}, **more)
        assert parts.size == parts.plan.size == SIZE and parts.plan.supersampling == 2
        assert float(np.abs(parts.rgba - whole.rgba).max()) < 2e-6
        assert np.allclose(parts.coverage, whole.coverage, rtol=1e-5)
        assert np.array_equal(np.isinf(parts.depth), np.isinf(whole.depth))
        if more:
            assert np.array_equal(parts.depth_limit, surface["depth_limit"])


def test_stages_end_with_the_picture() -> None:
    renderer = ss.Renderer("cpu")
    scene, camera = scene_of("lit", supersampling=2)
    shares: list[float] = []
    expected = renderer.render(scene, camera, SIZE, progress=shares.append)
    assert shares and 0 <= min(shares) and max(shares) <= 1
    stages = list(renderer.progressive(scene, camera, SIZE, first_seconds=1e-6))
    assert len(stages) > 1 and all(image.size == SIZE for image in stages)
    assert stages[-1] == expected
    with pytest.raises(ss.Cancelled):
        renderer.render(scene, camera, SIZE, progress=lambda _: False)


def test_pick_counts_pixels() -> None:
    renderer = ss.Renderer("cpu")
    scene, camera = scene_of("lit")
    one = renderer.render(scene, camera, SIZE)
    several = renderer.render(scene.replace(supersampling=4), camera, SIZE)
    for x, y in ((10, 8), (4.5, 12.9), (19, 15)):
        assert several.pick(x, y) == one.pick(x, y)
    with pytest.raises(ss.InvalidInput, match="below 20"):
        several.pick(20, 3)


def test_films_have_it() -> None:
    film = ss.turntable(volume(), frames=2, size=SIZE, supersampling=2, backend="cpu")
    assert film[1].plan.supersampling == 2 and film[1].size == SIZE


def test_copies_and_recipes_keep_it() -> None:
    scene, camera = scene_of("lit", supersampling=3)
    image = ss.Renderer("cpu").render(scene, camera, SIZE)
    copied = pickle.loads(pickle.dumps(scene))
    assert copied == scene != scene.replace(supersampling=2) and copied.supersampling == 3
    assert pickle.loads(pickle.dumps(image)) == image
    recipe = ss.Recipe.from_json(image.recipe.to_json())
    again = ss.Renderer(**recipe.renderer).render(recipe.scene(scene.fields), recipe.camera, recipe.size)
    assert again == image
    # Pictures of earlier versions say nothing of it, and have one.
    plain = image.recipe.to_json().replace('"supersampling":3,', "")
    assert "supersampling" not in plain and ss.Recipe.from_json(plain).options["supersampling"] == 1


def test_what_does_not_fit_is_refused_before_it_is_drawn() -> None:
    scene, camera = scene_of("lit", supersampling=4)
    renderer = ss.Renderer("cpu")
    with pytest.raises(ss.OutOfMemory, match="4 x 4 samples a pixel.*supersampling=1") as caught:
        renderer.render(scene, camera, size=(400_000, 400_000))
    assert caught.value.advice
    with pytest.raises(ss.InvalidInput, match="samples along an edge"):
        renderer.plan(scene, camera, size=(2**30, 1))
    # A quarter of the samples needs less.
    small, large = (renderer.plan(scene.replace(supersampling=n), camera, (300, 300)).memory for n in (1, 4))
    assert large > 4 * small


def test_a_goal_counts_all_samples() -> None:
    scene, camera = scene_of("lit", supersampling=2)
    image = ss.Renderer("cpu", max_error=5e-3).render(scene, camera, SIZE)
    assert image.size == SIZE and image.settings is not None and image.error.rmse <= 5e-3


@pytest.mark.parametrize("seed", [3002, 3005, 3011])
def test_the_error_is_that_of_the_mean(seed: int) -> None:
    case = random_case(seed)
    scene = case.drawn().replace(supersampling=2)
    image = ss.Renderer("cpu").render(scene, case.camera, (24, 24))
    exact = converged(exact_renderer(), case, (48, 48))
    off = difference(image.pixels, mean_of(exact.pixels, 2), OUTLINE)
    true = float(np.sqrt(np.square(off).mean()))
    found = image.error
    assert found.map.shape == (24, 24) and found.map.dtype == np.float32
    assert np.sqrt(np.square(found.map, dtype=np.float64).mean()) == pytest.approx(found.rmse, rel=1e-4)
    assert np.hypot.reduce(list(found.budget.values())) == pytest.approx(found.rmse, rel=1e-4)
    assert true <= 1.1 * found.rmse
    fine = ss.Renderer("cpu").render(case.drawn(), case.camera, (48, 48))
    assert found.rmse <= 1.0001 * fine.error.rmse and rmse(fine, exact) > 0


def test_best_takes_it_where_light_calls_for_few_slices() -> None:
    # Noise: sums are plain.
    values = volume().values
    options: dict[str, Any] = {"size": SIZE, "backend": "cpu", "clim": (0, 1)}
    translucent = {"opacity": [(0.3, 0.0), (1.0, 0.05)]}
    best = ss.render(values, quality="best", **options, **translucent)
    told = best.plan.quality.of("supersampling")
    assert told.value == best.plan.supersampling == 2 and not told.given
    assert "2 x 2 samples a pixel" in told.reason and "as long" in told.reason
    assert best.plan.slice_spacing == pytest.approx(1 / 3)
    steep = ss.render(values, quality="best", opacity=[(0.5, 0.0), (0.51, 1.0)], **options)
    told = steep.plan.quality.of("supersampling")
    assert told.value == steep.plan.supersampling == 1 and "too long" in told.reason
    for more in ({"shading": False}, {"mode": "mip"}, {"quality": "good"}, {"quality": "draft"}, {"prefilter": True}):
        image = ss.render(values, **{"quality": "best", **options, **({} if "mode" in more else translucent), **more})
        assert image.plan.supersampling == 1 and image.plan.quality.of("supersampling").value == 1
    for n in (1, 3):
        image = ss.render(values, quality="best", supersampling=n, **options, **translucent)
        told = image.plan.quality.of("supersampling")
        assert image.plan.supersampling == n and told.given and told.value == n
        assert image.plan.slice_spacing <= 1 / 4
    assert ss.render(values, quality="best", max_error=5e-3, **options, **translucent).plan.supersampling == 1
    assert "supersampling=2" in str(best.plan)
