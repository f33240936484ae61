"""The error of a picture, estimated without a reference, against the error that it has."""

from __future__ import annotations

import sys
from pathlib import Path

import error_scenes
import numpy as np
import pytest
from click.testing import CliRunner

import sheetsplat as ss

SIZE = (48, 48)
# Never used to tune the estimate; bench error_estimate draws more of them.
SEEDS = range(3000, 3024)


@pytest.fixture(scope="module")
def exact() -> ss.Renderer:
    """Return a renderer for converged pictures."""
    return error_scenes.exact_renderer()


@pytest.mark.slow
def test_estimates_are_calibrated(exact: ss.Renderer, cpu_renderer: ss.Renderer) -> None:
    """Nine of ten true errors lie within a factor of 2 of the estimate, and none is above 4 of it."""
    ratios, halves = [], []
    for seed in SEEDS:
        case = error_scenes.random_case(seed)
        image = cpu_renderer.render(case.drawn(), case.camera, SIZE)
        true = max(error_scenes.rmse(image, error_scenes.converged(exact, case, SIZE)), 3e-8)
        ratios.append(true / max(image.error.rmse, 3e-8))
        # Negative control: an estimate that is wrong by a factor of 3.
        halves.append(true / max(image.error.rmse / 3, 3e-8))
    away = np.maximum(ratios, 1 / np.array(ratios))
    assert np.mean(away <= 2) >= 0.9, np.round(ratios, 2)
    assert max(ratios) <= 4
    assert np.mean(np.array(halves) <= 2) < 0.5


def test_estimates_of_measured_volumes(data_dir: Path, exact: ss.Renderer, cpu_renderer: ss.Renderer) -> None:
    """The same for measured data, which the estimate was not tuned on either."""
    cases = error_scenes.measured_cases(data_dir, 4)[:6]
    assert cases
    for case in cases:
        image = cpu_renderer.render(case.drawn(), case.camera, SIZE)
        true = error_scenes.rmse(image, error_scenes.converged(exact, case, SIZE))
        assert 0.5 <= true / image.error.rmse <= 2, case.name


def test_the_map_shows_where(exact: ss.Renderer, cpu_renderer: ss.Renderer) -> None:
    """Where the estimate is large, the error is: the tenth of pixels with the largest estimates has most of it."""
    case = error_scenes.random_case(3001)
    image = cpu_renderer.render(case.drawn(), case.camera, SIZE)
    reference = error_scenes.converged(exact, case, SIZE)
    true = np.square(np.asarray(image.pixels, float) - np.asarray(reference.pixels, float)).reshape(*SIZE, -1).mean(-1)
    found = image.error.map
    assert found.shape == (SIZE[1], SIZE[0])
    assert found.dtype == np.float32
    largest = found >= np.quantile(found, 0.9)
    assert true[largest].sum() > 0.3 * true.sum()
    assert true[largest].mean() > 3 * true.mean()


@pytest.mark.parametrize("seed", range(3030, 3036))
def test_the_budget_adds_up(seed: int, cpu_renderer: ss.Renderer) -> None:
    """Squares of causes, and of pixels, add up to the square of the whole."""
    case = error_scenes.random_case(seed)
    error = cpu_renderer.render(case.drawn(), case.camera, SIZE).error
    assert np.sqrt(sum(part**2 for part in error.budget.values())) == pytest.approx(error.rmse, rel=1e-6)
    assert np.sqrt(np.mean(np.square(error.map, dtype=np.float64))) == pytest.approx(error.rmse, rel=1e-5)
    assert "slice distance" in error.budget


def test_it_is_made_once_and_when_asked_for(cpu_renderer: ss.Renderer) -> None:
    """The scene is kept for it until then; for `pick` as long as the image."""
    case = error_scenes.random_case(3002)
    scene = case.drawn()
    count = sys.getrefcount(scene)
    image = ss.Renderer("cpu").render(scene, case.camera, SIZE)
    before = np.array(image.pixels)
    assert sys.getrefcount(scene) == count + 2
    first = image.error
    assert sys.getrefcount(scene) == count + 1
    assert image.error is first
    assert np.array_equal(before, np.array(image.pixels))


def test_stages(cpu_renderer: ss.Renderer) -> None:
    """Coarse stages have none; the last one has that of the picture."""
    case = error_scenes.random_case(3003)
    stages = list(cpu_renderer.progressive(case.drawn(), case.camera, (200, 200), first_seconds=1e-6))
    assert len(stages) > 1
    with pytest.raises(ss.InvalidInput, match="a coarse stage of a picture"):
        _ = stages[0].error
    at_once = cpu_renderer.render(case.drawn(), case.camera, (200, 200))
    assert stages[-1].error.rmse == pytest.approx(at_once.error.rmse, rel=1e-6)


@pytest.mark.parametrize("backend", ["reference", "cpu", "gl"])
def test_every_backend(backend: str, request: pytest.FixtureRequest) -> None:
    """The error of arithmetic is measured against float64; that of the slice distance is the same on all backends."""
    if backend == "gl":
        reason = request.getfixturevalue("_gl_reason")
        if reason:
            pytest.skip(reason)
    case = error_scenes.random_case(3004)
    size = (24, 24)
    error = ss.Renderer(backend).render(case.drawn(), case.camera, size).error
    other = ss.Renderer("cpu", precision="float64").render(case.drawn(), case.camera, size).error
    assert error.budget["slice distance"] == pytest.approx(other.budget["slice distance"], rel=1e-5)
    assert error.rmse == pytest.approx(other.rmse, rel=0.05)


def test_coarse_numbers_show(request: pytest.FixtureRequest) -> None:
    """Sheets of 8 bits are wrong by what the estimate says."""
    reason = request.getfixturevalue("_gl_reason")
    if reason:
        pytest.skip(reason)
    values = np.clip(1.2 - np.linalg.norm(np.stack(np.meshgrid(*[np.linspace(-1, 1, 12)] * 3)), axis=0), 0, 1)
    scene = ss.Scene(ss.RegularField(values), ss.TransferFunction([(0.05, 1, 0.5, 0.2, 0), (1, 1, 1, 1, 0.3)]))
    camera = ss.Camera.fit(scene.fields[0], direction=(-0.5, -0.4, -0.8))
    image = ss.Renderer("gl", precision="uint8", allow_inexact=True).render(scene, camera, SIZE)
    exact = error_scenes.exact_renderer().render(scene, camera, SIZE)
    arithmetic = error_scenes.rmse(image, exact)
    parts = [part for cause, part in image.error.budget.items() if cause not in ("slice distance", "opacity stop")]
    assert arithmetic > 1e-3
    assert np.sqrt(np.sum(np.square(parts))) == pytest.approx(arithmetic, rel=1e-3)


def test_shadows_count_as_the_plan_has_them(cpu_renderer: ss.Renderer) -> None:
    """All compared pictures use shadow volumes, so the error of the volumes comes from the plan."""
    values = np.clip(1.2 - np.linalg.norm(np.stack(np.meshgrid(*[np.linspace(-1, 1, 12)] * 3)), axis=0), 0, 1)
    transfer = ss.TransferFunction([(0.05, 1, 0.5, 0.2, 0), (1, 1, 1, 1, 0.3)])
    light = ss.Light((0.4, 0.6, 1.0))
    scene = ss.Scene(ss.RegularField(values), transfer, lights=[light], shadows=True)
    camera = ss.Camera.fit(scene.fields[0], direction=(-0.5, -0.4, -0.8))
    image = cpu_renderer.render(scene, camera, SIZE)
    true = error_scenes.rmse(image, ss.Renderer("reference").render(scene, camera, SIZE))
    cause = "shadows from a volume"
    assert image.error.budget[cause] == pytest.approx(image.plan.error_budget[cause])
    assert 1e-5 < true < image.error.rmse
    assert np.hypot(*(image.error.budget[part] for part in (cause, "slice distance"))) <= image.error.rmse * (1 + 1e-6)
    unlit = cpu_renderer.render(scene.replace(shadows=False), camera, SIZE)
    assert cause not in unlit.error.budget


@pytest.mark.slow
def test_command_line(tmp_path: Path) -> None:
    """--max-error and --max-seconds reach the plan and the picture; contradictions name both options."""
    from sheetsplat.cli.main import main

    volume, picture = tmp_path / "v.npy", tmp_path / "v.png"
    # Zeros around it: where a volume ends at once, the error falls with the slice distance only slowly.
    np.save(volume, np.pad(error_scenes.smooth_noise(np.random.default_rng(1), (12, 12, 12), 1.5), 2))
    few = ["--size", "24", "--backend", "cpu"]
    run = CliRunner()
    slices = []
    for error in ("1e-2", "1e-4"):
        result = run.invoke(main, ["render", str(volume), "-o", str(picture), *few, "--max-error", error, "--json"])
        assert result.exit_code == 0, result.output
        slices.append(float(result.output.split('"slices":')[1].split(",")[0]))
    assert slices[1] > 2 * slices[0]
    result = run.invoke(main, ["plan", str(volume), *few, "--max-error", "1e-3"])
    assert "settings for max_error" in result.output
    result = run.invoke(main, ["plan", str(volume), *few, "--max-seconds", "100"])
    assert "settings for max_seconds" in result.output
    contradiction = ["--max-error", "1e-5", "--slice-spacing", "5"]
    result = run.invoke(main, ["plan", str(volume), *few, *contradiction])
    assert result.exit_code == 1
    assert "--max-error 1e-05" in result.stderr
    assert "leave out --slice-spacing" in result.stderr
    assert run.invoke(main, ["plan", str(volume), *few, "--max-error", "0"]).exit_code == 2
    result = run.invoke(main, ["plan", str(volume), *few, "--shadows", "--max-error", "1e-5"])
    assert result.exit_code == 1
    assert "shadows" in result.stderr
    assert "use --backend reference" in result.stderr
