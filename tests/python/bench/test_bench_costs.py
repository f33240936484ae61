"""The benchmarks of what effects cost and of camera moves measure what they say."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from bench import BENCHES, Options
from bench.cliffs import copied, steepest, subject_of
from bench.cliffs_page import main as costs_page
from bench.effect_costs import EFFECTS, pairs
from bench.scenes import ellipsoids


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("SHEETSPLAT_DATA", raising=False)


def _options(tmp_path: Path, **others: object) -> Options:
    settings: dict[str, object] = {"size": (48, 48), "views": 1, "data": tmp_path, "scale": 0.2}
    return Options(**{**settings, "reference_seconds": 0.5, **others})  # type: ignore[arg-type]


def test_effects_are_timed_alone_and_in_pairs(tmp_path: Path) -> None:
    options = _options(
        tmp_path, backend="cpu", size=(24, 24), rows=("tubes", "combustor", "perspective", "xray", "clip")
    )
    report = BENCHES["cliffs"].run(options)
    skipped = report.rows.pop()
    assert skipped["field"] == "combustor" and skipped["remark"].startswith("skipped")
    names = ["perspective", "xray", "clip", "perspective + xray", "perspective + clip", "xray + clip"]
    assert [row["row"] for row in report.rows] == names
    by_name = {row["row"]: row for row in report.rows}
    for row in report.rows:
        assert row["ratio"] > 0.0 and row["first_ratio"] > 0.0 and row["ms"] > 0.0
    for first, second in ((names[0], names[1]), (names[0], names[2])):
        product = math.prod(max(1.0, by_name[name]["ratio"]) for name in (first, second))
        pair = by_name[f"{first} + {second}"]
        assert pair["expected"] == pytest.approx(product) and pair["over"] == pytest.approx(pair["ratio"] / product)
    assert by_name["perspective"]["over"] == pytest.approx(by_name["perspective"]["ratio"] / 1.3)
    assert len(steepest(report.rows, 2)) == 2
    farthest = max(report.rows, key=lambda row: row["over"])
    assert steepest(report.rows)[0].startswith(f"{farthest['row']} on tubes")


def test_effects_that_exclude_each_other_make_no_pair(tmp_path: Path) -> None:
    subject = subject_of(_options(tmp_path), "tubes")
    found = set(pairs(subject, list(EFFECTS)))
    assert ("perspective", "ewa") in found and ("shadows", "good") in found and ("isosurface", "shadows") in found
    for pair in (
        ("xray", "mip"),
        ("xray", "shadows"),
        ("mip", "depth cue"),
        ("isosurface", "threshold"),
        ("shadows", "threshold"),
        ("preintegration", "second order"),
    ):
        assert pair not in found, pair


def test_copies_of_a_field_lie_side_by_side() -> None:
    one = ellipsoids(50, 20.0)
    title, many = copied(one, 120)
    assert many.size == 150 and title.startswith("3 ")
    step = np.ptp(one.centers, axis=0)
    assert many.centers[50:100] == pytest.approx(one.centers + [step[0], 0.0, 0.0])
    assert many.centers[100:] == pytest.approx(one.centers + [0.0, step[1], 0.0])
    assert np.array_equal(many.values[100:], one.values) and np.array_equal(many.rotations[:50], one.rotations)


def test_both_cameras_show_the_middle_at_one_scale(tmp_path: Path) -> None:
    subject = subject_of(_options(tmp_path), "tubes")
    flat, deep = (subject.camera(2, perspective=perspective) for perspective in (False, True))
    distance = math.dist(deep.eye, deep.target)
    assert 2.0 * distance * math.tan(math.radians(0.5 * deep.fov_y)) == pytest.approx(flat.height)
    towards = [np.subtract(camera.eye, camera.target) for camera in (flat, deep)]
    assert towards[0] / np.linalg.norm(towards[0]) == pytest.approx(towards[1] / np.linalg.norm(towards[1]))


def test_times_after_camera_moves(tmp_path: Path) -> None:
    options = _options(tmp_path, backend="cpu", size=(16, 16), rows=("noisy ball", "bonsai"), scale=0.1)
    report = BENCHES["interactive"].run(options)
    ball, bonsai = report.rows
    assert bonsai["remark"].startswith("skipped") and "32x32" in report.title and "40 camera moves" in report.title
    for name in ("first", "whole"):
        assert 0.0 < ball[f"{name}_median"] <= ball[f"{name}_most"] <= ball[f"{name}_worst"]
    assert ball["first_worst"] <= ball["whole_worst"] and ball["stages"] >= 1 and not report.goals


def test_the_page_of_costs_is_made_of_the_figures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def row(names: list[str], ratio: float, first: float, over: float, **others: object) -> dict[str, object]:
        figures = {"ratio": ratio, "first_ratio": first, "over": over, "plain_ms": 5.0, "expected": ratio / over}
        return {"field": "tubes", "row": " + ".join(names), "effects": names, **figures, **others}

    rows = [
        row(["perspective"], 1.25, 1.3, 0.96),
        row(["occlusion"], 2.0, 9.5, 2.4),
        {"field": "tubes", "row": "minimum", "effects": ["minimum"], "remark": "not run: the picture is empty"},
        row(["perspective", "occlusion"], 7.5, 8.0, 3.0),
        row(["perspective", "clip"], 1.25, 8.0, 1.0),
    ]
    notes = ["tubes: thin tubes, 128^3", "of no field"]
    (tmp_path / "cliffs.json").write_text(
        json.dumps({"title": "The title", "rows": rows, "notes": notes, "environment": {"load": "3.0"}})
    )
    costs_page([str(tmp_path)])
    page = capsys.readouterr().out
    assert "| perspective | 1.3 | 1.25 |" in page and "| occlusion | 1.3 (4) | 2 (9.5) |" in page
    assert "| minimum | 1.5 | – |" in page and "- tubes: thin tubes, 128^3" in page and "of no field" not in page
    assert (
        "| tubes | perspective + occlusion | 7.5 | 3 |" in page and "perspective + clip" not in page.split("## The")[0]
    )
    assert "1. perspective + occlusion on tubes: 7.50 plain frames" in page and "load: 3.0" in page
    assert "Following the camera" not in page
    found = {
        "row": "bonsai",
        **{f"{n}_{part}": 12.0 for n in ("first", "whole") for part in ("median", "most", "worst")},
    }
    (tmp_path / "interactive.json").write_text(
        json.dumps({"title": "Moves", "rows": [found], "environment": {"load": "0.1"}})
    )
    costs_page([str(tmp_path)])
    assert "| bonsai | 12 | 12 | 12 | 12 | 12 | 12 |" in capsys.readouterr().out
