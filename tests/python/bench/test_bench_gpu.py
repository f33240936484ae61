"""The benchmark of graphics hardware runs on any OpenGL, and tells what it could not run."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

import sheetsplat as ss
from bench import BENCHES, Options
from bench import gpu as bench_gpu
from sheetsplat.errors import complain

TESTS = """
import pytest

def test_right(): pass
def test_right_too(): pass
def test_wrong(): assert False
@pytest.mark.skip(reason="no device")
def test_left_out(): pass
"""


@pytest.fixture
def options(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Options:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("SHEETSPLAT_DATA", raising=False)
    return Options(size=(24, 24), views=1, data=tmp_path, scale=0.1, rows=("full hd",))


def test_a_run_of_tests_is_counted(tmp_path: Path) -> None:
    (tmp_path / "test_some.py").write_text(TESTS)
    report = tmp_path / "report.xml"
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-c", "pytest.ini", f"--junit-xml={report}"]
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    row = bench_gpu.tested(command, report, 60.0, tmp_path)
    assert (row["passed"], row["failed"], row["skipped"]) == (2, 1, 1) and row["wall_ms"] > 0.0
    assert row["remark"] == "failed: test_some::test_wrong"


def test_what_does_not_run_is_told(tmp_path: Path) -> None:
    endless = [sys.executable, "-c", "import time; time.sleep(60)"]
    assert "timed out" in bench_gpu.tested(endless, tmp_path / "a.xml", 0.2, tmp_path)["remark"]
    missing = bench_gpu.tested(["no-such-program"], tmp_path / "b.xml", 5.0, tmp_path)
    assert "no-such-program" in missing["remark"]
    silent = bench_gpu.tested([sys.executable, "-c", ""], tmp_path / "c.xml", 30.0, tmp_path)
    assert silent["remark"] == "not run: the runner wrote no report"


@pytest.mark.gl
def test_frames_stand_beside_the_processors(options: Options) -> None:
    report = BENCHES["gpu"].run(options)
    assert [row["row"] for row in report.rows] == ["1,000 spheres at 24x24", "10,000 spheres at 24x24"]
    for row in report.rows:
        assert row["times"] == pytest.approx(row["cpu_wall_ms"] / row["wall_ms"])
        assert row["fps"] == pytest.approx(1000.0 / row["wall_ms"])
    assert "OpenGL" in report.environment["device"] and report.reached
    assert "1,000 spheres" in report.markdown()


def test_without_opengl_the_processor_stands_alone(options: Options, monkeypatch: pytest.MonkeyPatch) -> None:
    usual = bench_gpu.renderer_for

    def without(on: Options, **settings: Any) -> ss.Renderer:
        if on.backend == "gl":
            raise complain("no picture can be drawn", "no device", "OpenGL 3.3", kind=ss.DeviceUnavailable)
        return usual(on, **settings)

    monkeypatch.setattr(bench_gpu, "renderer_for", without)
    report = BENCHES["gpu"].run(options)
    assert all(row["remark"].startswith("not run: ") and "cpu_wall_ms" not in row for row in report.rows)
    assert report.environment["device"] == "no OpenGL"


def test_a_goal_for_every_figure() -> None:
    rows = [
        {"part": "tables", "row": "Bonsai", "over_paper": 99.0},
        {"part": "full hd", "row": "many", "fps": 61.0},
        {"part": "tests", "row": "Python tests", "failed": 1},
    ]
    assert [goal.reached for goal in bench_gpu._goals(rows)] == [False, True, False]


def test_what_does_not_fit_the_time_is_left_out(options: Options, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench_gpu, "_SECONDS", -1.0)
    (row,) = BENCHES["gpu"].run(options).rows
    assert row["part"] == "full hd" and row["remark"].startswith("left out")
