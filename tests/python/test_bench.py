"""Benchmarks run, count right and say what they could not do."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat.bench import BENCHES, Goal, Options, Report
from sheetsplat.bench._measure import Judge, difference, orbit, time_frames
from sheetsplat.bench.table2005 import _PICTURES, threshold_for
from sheetsplat.datasets import noisy_ball


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("SHEETSPLAT_DATA", raising=False)


def _options(tmp_path: Path, **others: object) -> Options:
    settings: dict[str, object] = {
        "size": (48, 48),
        "views": 1,
        "data": tmp_path,
        "scale": 0.2,
        "reference_seconds": 0.5,
        "backend": "reference",
    }
    return Options(**{**settings, **others})  # type: ignore[arg-type]


def test_reports_are_tables_and_json() -> None:
    report = Report(
        name="x",
        title="Title",
        columns={"row": "what", "time": "ms", "never": "absent", "remark": "remark"},
        rows=[
            {"row": "first", "time": 12.5},
            {"row": "second", "time": np.float64(1234.0), "remark": "skipped: no file"},
            {"row": "third", "time": math.inf},
        ],
        goals=[Goal("quick", 1.0, 2.0, "s"), Goal("small", 3.0, 2.0)],
        notes=["A note."],
    )
    table = report.table()
    assert "absent" not in table and "A note." in table
    assert "reached: quick 1, at most 2 s" in table and "MISSED: small 3, at most 2" in table
    assert not report.reached
    # Numbers end at one column.
    lines = [line for line in table.splitlines() if line.startswith(("first", "second"))]
    assert re.search(r"12\.5", lines[0]).end() == re.search(r"1,234", lines[1]).end()  # type: ignore[union-attr]
    read = json.loads(report.to_json())
    assert read["rows"][1]["time"] == 1234.0 and read["rows"][2]["time"] == "inf"
    assert [goal["reached"] for goal in read["goals"]] == [True, False]


def test_bad_options_have_clear_errors() -> None:
    for bad in ({"views": 0}, {"size": (0, 4)}, {"scale": 0.0}, {"scale": 2.0}):
        with pytest.raises(ss.InvalidInput, match="wanted"):
            Options(**bad)  # type: ignore[arg-type]


def test_thresholds_leave_the_share_that_is_asked_for() -> None:
    whole = np.random.default_rng(1).integers(0, 256, (20, 20, 20)).astype(np.uint8)
    real = np.random.default_rng(1).standard_normal((20, 20, 20))
    for values in (whole, whole.astype(np.int16) - 300, real):
        for share in (0.05, 0.3):
            assert np.mean(values > threshold_for(values, share)) == pytest.approx(share, abs=0.005)


def test_the_papers_table_is_whole() -> None:
    assert len(_PICTURES) == 15
    # Sums over the printed columns of table 1.
    assert sum(picture.paper_splats for picture in _PICTURES.values()) == 8_637_000
    assert sum(picture.paper_fps for picture in _PICTURES.values()) == pytest.approx(83.7)
    for picture in _PICTURES.values():
        assert not picture.bcc_of or picture.bcc_of in _PICTURES


def test_judge_keeps_to_its_time_and_to_the_scene() -> None:
    scene = noisy_ball(16).scene()
    cameras = orbit(scene.fields[0], 2)
    judge = Judge((64, 64), 60.0)
    reference = judge.reference(scene, cameras[0])
    assert reference.size == (64, 64)
    assert judge.reference(scene, cameras[0]) is reference
    assert judge.reference(scene, cameras[1]) is not reference
    assert Judge((64, 64), 0.0).reference(scene, cameras[0]).size == (8, 8)
    renderer = ss.Renderer(backend="reference")
    error = judge.error(renderer, scene, cameras[0])
    assert error["rmse"] == 0.0 and error["error_size"] == "64x64"
    # A picture from elsewhere is not taken for right.
    other = renderer.render(scene, cameras[1], size=(64, 64))
    assert difference(other, reference)["rmse"] > 1e-3


def test_timing_counts_every_view_once() -> None:
    scene = noisy_ball(16).scene()
    timing = time_frames(ss.Renderer(backend="reference"), scene, orbit(scene.fields[0], 3), (16, 16))
    assert timing.wall > 0.0 and timing.stats["kernels_drawn"] > 0
    assert timing.picture.size == (16, 16)


def test_table_skips_what_is_not_there(tmp_path: Path) -> None:
    report = BENCHES["table2005"].run(_options(tmp_path, rows=("Vortex", "Lobster"), pictures=tmp_path / "pictures"))
    vortex, lobster = report.rows
    assert vortex["rmse"] == 0.0 and vortex["fps"] > 0.0 and "stand-in" in vortex["source"]
    assert vortex["above"] == pytest.approx(479_000 / 128**3 * 32**3, rel=0.01)
    assert lobster["remark"].startswith("skipped") and "SHEETSPLAT_DATA" in lobster["remark"]
    assert lobster["paper_splats"] == 219_000
    assert [path.name for path in (tmp_path / "pictures").iterdir()] == ["Vortex.png"]
    assert "Lobster" in report.table()


def test_table_reads_files_and_resamples(tmp_path: Path) -> None:
    import nrrd

    values = noisy_ball(24).values
    nrrd.write(str(tmp_path / "bonsai_256x256x256_uint8.nrrd"), np.ascontiguousarray(values.T))
    report = BENCHES["table2005"].run(_options(tmp_path, rows=("Bonsai", "BonsaiBCC")))
    cartesian, bcc = report.rows
    assert cartesian["size"] == "24x24x24" and bcc["size"] == "17x17x34"
    assert cartesian["threshold"] == bcc["threshold"]
    assert bcc["above"] / cartesian["above"] == pytest.approx(math.sqrt(0.5), rel=0.1)


def test_ablation_names_what_this_backend_lacks(tmp_path: Path) -> None:
    report = BENCHES["ablation"].run(_options(tmp_path, rows=("buffers", "lattice")))
    by_name = {(row["row"], row["scene"]): row for row in report.rows}
    # The reference has one number format.
    assert by_name["8 bits", "ball"]["remark"].startswith("not run")
    assert by_name["Cartesian", "vortex"]["rmse"] == 0.0
    assert 0.0 < by_name["BCC", "vortex BCC"]["cartesian_rmse"] < 0.1
    assert by_name["Cartesian", "vortex"]["ratio"] == 1.0


def test_frame_and_scaling(tmp_path: Path) -> None:
    frame = BENCHES["frame"].run(_options(tmp_path))
    assert {row["row"] for row in frame.rows} == {
        "noisy ball",
        "bare fill test, one target",
        "bare fill test, two targets as packing wide has",
        "noisy ball, packing paper",
        "tubes",
    }
    scaling = BENCHES["scaling"].run(_options(tmp_path, size=(24, 24), scale=0.1))
    kernels = [row for row in scaling.rows if row["row"] == "kernels"]
    assert all(a["kernels_drawn"] < b["kernels_drawn"] for a, b in zip(kernels, kernels[1:], strict=False))


def test_import_and_memory_run_in_new_processes(tmp_path: Path) -> None:
    startup = BENCHES["import"].run(_options(tmp_path))
    assert 0.0 < startup.rows[0]["least"] <= startup.rows[0]["seconds"]
    memory = BENCHES["memory"].run(_options(tmp_path))
    assert memory.rows[0]["remark"].startswith("skipped")
    assert 10.0 < memory.rows[1]["before"] <= memory.rows[1]["resident"] < 2000.0
