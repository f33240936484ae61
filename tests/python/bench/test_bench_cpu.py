"""The benchmark beside VTK counts right, grids exactly, and goes on without VTK."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path

import numpy as np
import pytest

import sheetsplat as ss
from bench import BENCHES, Goal, Options, Report
from bench.cpu import judged, steepness
from bench.scenes import CASES, SCATTERED, Case, axes_of, ellipsoids, gridded, sections, spheres
from bench.vtk_casters import Look, Vtk, VtkMissing

TINY = Options(scale=0.15)


def _field(normalization: str) -> ss.EllipsoidField:
    return ellipsoids(40, 24.0, normalization=normalization)


@pytest.mark.parametrize("normalization", ["none", "threshold"])
def test_the_grid_holds_the_field(normalization: str) -> None:
    field = _field(normalization)
    volume = gridded(field, 24.0, 25)
    k, j, i = np.meshgrid(*(np.arange(25),) * 3, indexing="ij")
    expected = field.at(np.stack([i, j, k], axis=-1).reshape(-1, 3).astype(float)).reshape(25, 25, 25)
    assert np.abs(volume.values - expected).max() < 2e-6
    assert np.abs(volume.values.T - expected).max() > 1e-2


def test_spheres_lie_in_their_cube() -> None:
    field = spheres(500, 32.0)
    lower, upper = (np.array(corner) for corner in field.bounds)
    assert lower.min() >= 0.0 and upper.max() <= 32.0
    assert 2.0 <= field.scale_range[0] and field.scale_range[1] <= 4.0


def test_sections_are_those_that_planes_cut() -> None:
    field = _field("none")
    camera = ss.Camera.orthographic((40.0, 30.0, 50.0), (12.0, 12.0, 12.0), height=24.0)
    ahead = np.array(camera.target) - np.array(camera.eye)
    ahead /= np.linalg.norm(ahead)
    # Points all over each kernel's surface say how far it reaches along the view.
    turns = np.random.default_rng(3).standard_normal((20000, 3))
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    lower, upper = (np.array(corner) for corner in field.centre_bounds)
    planes = 0.5 * (lower + upper) @ ahead + (np.arange(-60, 60) + 0.5) * 0.7
    counted = 0
    for center, axes in zip(field.centers, axes_of(field), strict=True):
        depths = (center + turns @ axes.T) @ ahead
        counted += int(((planes >= depths.min()) & (planes <= depths.max())).sum())
    assert sections(field, camera, 0.7) == pytest.approx(counted, abs=4)
    assert sections(field, camera, 0.35) > 1.8 * counted


@pytest.mark.parametrize("name", list(CASES))
def test_cases_show_something_in_every_view(name: str) -> None:
    case = CASES[name](TINY)
    cameras = case.cameras()
    assert len(cameras) == 6 and len({camera.eye for camera in cameras}) == 6
    pictures = [
        ss.Renderer(backend="reference").render(case.scene(), camera, size=(24, 24)).rgba for camera in cameras[:2]
    ]
    assert all(0.003 < picture[..., 3].mean() < 0.9 for picture in pictures)
    assert np.abs(pictures[0] - pictures[1]).max() > 1e-2
    assert (case.volume is None) == (name in SCATTERED)
    # A transfer function as gentle as this one has the narrower bounds.
    assert 0.0 < steepness(case) <= 10.0


def test_goals_may_be_floors() -> None:
    assert Goal("x", 51.0, 50.0, "dB", least=True).reached and not Goal("x", 49.0, 50.0, "dB", least=True).reached
    assert not Goal("x", math.nan, 1.0).reached and not Goal("x", math.nan, 1.0, least=True).reached
    goals: list[Goal] = []
    row = judged({"row": "r"}, goals, Options(), Goal("x", 3.0, 2.0, "s"))
    assert row["verdict"] == "MISS" and row["quotient"] == 1.5 and len(goals) == 1
    assert "verdict" not in judged({"row": "r"}, goals, TINY, Goal("x", 3.0, 2.0, "s")) and len(goals) == 1
    table = Report("n", "t", {"row": "what"}, [], goals=[Goal("x", 49.0, 50.0, "dB", least=True)]).table()
    assert "MISSED: x 49, at least 50 dB" in table


def _small(**others: object) -> Options:
    settings: dict[str, object] = {"size": (32, 32), "views": 1, "scale": 0.15, "backend": "reference"}
    return Options(**{**settings, **others})  # type: ignore[arg-type]


def test_without_vtk_ours_is_measured_all_the_same(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    there = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "vtk" else there(name))
    with pytest.raises(VtkMissing, match="not installed"):
        Vtk()
    report = BENCHES["cpu"].run(_small(rows=("tubes", "spheres", "camera"), pictures=tmp_path))
    rows = {row["row"].split(",")[0]: row for row in report.rows}
    assert rows["thin tubes"]["ms"] > 0.0 and "vtk_cpu_ms" not in rows["thin tubes"]
    assert len(report.rows) == 4 and not report.goals
    assert any("not installed" in note for note in report.notes)
    assert (tmp_path / "cpu-tubes-shaded.png").is_file()
    json_text = report.to_json()
    assert '"least"' not in json_text and "opacity" in json_text


def test_rows_that_a_backend_lacks_say_so() -> None:
    report = BENCHES["cpu"].run(_small(rows=("float64", "errors")))
    assert all(row.get("remark") for row in report.rows)
    errors = [row for row in report.rows if row["row"].startswith("error")]
    # The reference has no distance from itself.
    assert len(errors) == 6 and all(row["measured"] == 0.0 for row in errors)


@pytest.mark.slow
def test_vtk_shows_the_same_scene() -> None:
    pytest.importorskip("vtk")
    # Nothing in it is symmetric.
    case: Case = CASES["spheres"](Options(scale=0.2))
    assert isinstance(case.field, ss.EllipsoidField)
    volume = gridded(case.field, case.edge, 64)
    camera, size = case.cameras()[0], (64, 48)
    ours = ss.Renderer(backend="reference").render(case.scene(), camera, size=size).rgba
    other = ss.Renderer(backend="reference").render(case.scene(), case.cameras()[3], size=size).rgba
    try:
        with Vtk() as vtk:
            look = Look(case.points, case.unit, case.distance, case.scene().material, size, 1)
            for caster in ("cpu", "gpu"):
                vtk.show(caster, volume, look)  # type: ignore[arg-type]
                shot = vtk.frame(caster, camera, picture=True)  # type: ignore[arg-type]
                assert shot.rgba is not None and shot.wall > 0.0
                assert shot.rgba.shape == ours.shape
                apart = float(np.sqrt(np.square(shot.rgba - ours).mean()))
                assert shot.rgba[..., 3].mean() == pytest.approx(ours[..., 3].mean(), rel=0.05)
                assert apart < 0.03
                # Upside down, mirrored or from elsewhere it is further away.
                for wrong in (ours[::-1], ours[:, ::-1], other):
                    assert apart < 0.5 * float(np.sqrt(np.square(shot.rgba - wrong).mean()))
    except VtkMissing as error:
        pytest.skip(f"VTK cannot draw here: {error}")
