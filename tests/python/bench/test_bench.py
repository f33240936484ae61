"""Benchmarks run, count right and say what they could not do."""

from __future__ import annotations

import gzip
import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import sheetsplat as ss
from bench import BENCHES, Goal, Options, Report
from bench.__main__ import main
from bench.ellipsoids import WAYS, at_equal_time
from bench.error_estimate import summary
from bench.huge import corners
from bench.measure import Judge, Timing, decibels, difference, exponent, in_new_process, orbit, quotient, time_frames
from bench.pyvista_default import draw
from bench.report import columns
from bench.scenes import ellipsoids
from bench.simulation import Costs, Machine, Task, simulated
from bench.table2005 import PICTURES, threshold_for
from bench.table2006 import PICTURES as SCATTERED
from bench.table2006 import diagonals
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
        columns=columns("row=what, cpu_ms, never, remark"),
        rows=[
            {"row": "first", "cpu_ms": 12.5},
            {"row": "second", "cpu_ms": np.float64(1234.0), "remark": "skipped: [no file]"},
            {"row": "third", "cpu_ms": math.inf},
        ],
        goals=[Goal("quick", 1.0, 2.0, "s"), Goal("small", 3.0, 2.0)],
        notes=["A note."],
    )
    table = report.table()
    assert "never" not in table and "A note." in table and "[no file]" in table
    assert "reached: quick 1, at most 2 s" in table and "MISSED: small 3, at most 2" in table
    assert not report.reached
    # Numbers end at one column.
    lines = [line for line in table.splitlines() if line.split()[:1] in (["first"], ["second"])]
    assert re.search(r"12\.5", lines[0]).end() == re.search(r"1,234", lines[1]).end()  # type: ignore[union-attr]
    lines = report.markdown().splitlines()
    assert [cell.strip() for cell in lines[2].split("|")] == ["", "what", "cpu ms", "remark", ""]
    assert set(lines[3]) <= set("|-: ") and "second" in lines[5]
    read = json.loads(report.to_json())
    assert read["rows"][1]["cpu_ms"] == 1234.0 and read["rows"][2]["cpu_ms"] == "inf"
    assert [goal["reached"] for goal in read["goals"]] == [True, False]


def test_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert listed.keys() == BENCHES.keys() and "Engine BCC" in listed["table2005"]["rows"]
    assert main([]) == 0
    text = capsys.readouterr().out
    assert all(f"\n{name} " in f"\n{text}" for name in BENCHES) and "elimination" in text
    for bad, told in (
        (["nothing"], "wanted one of"),
        (["table2005", "--row", "nosuch"], "Engine BCC"),
        (["frame", "--row", "x"], "no rows"),
        (["frame", "--views", "0"], "at least 1"),
        (["frame", "--scale", "0"], "above 0"),
    ):
        with pytest.raises(SystemExit, match="2"):
            main(bad)
        assert told in capsys.readouterr().err
    quick = ["--scale", "0.3", "--backend", "reference", "-q", "--output", str(tmp_path / "out")]
    markdown = ["--markdown", "--columns", "row,rmse"]
    assert main(["claims", "--row", "borders", *quick, "--pictures", str(tmp_path), *markdown]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("## The papers' claims") and "ghost points" in printed and "kernels" not in printed
    assert len(list(tmp_path.glob("borders*.png"))) == 4
    assert len(json.loads((tmp_path / "out" / "claims.json").read_text())["rows"]) == 4


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
    assert len(PICTURES) == 15
    # Sums over the printed columns of table 1.
    assert sum(picture.paper_splats for picture in PICTURES.values()) == 8_637_000
    assert sum(picture.paper_fps for picture in PICTURES.values()) == pytest.approx(83.7)
    for picture in PICTURES.values():
        assert not picture.bcc_of or picture.bcc_of in PICTURES


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
    timing, picture = time_frames(ss.Renderer(backend="reference"), scene, orbit(scene.fields[0], 3), (16, 16))
    assert len(timing.shots) == 3 and timing.wall > 0.0 and timing.row("draw")["kernels_drawn"] > 0
    assert picture.size == (16, 16)


def test_times_of_rounds() -> None:
    rounds = Timing()
    for view, wall, cpu in ((0, 1.0, 2.0), (1, 5.0, 6.0), (0, 3.0, 1.0), (1, 4.0, 8.0)):
        rounds.add(wall, cpu, view=view)
    assert (rounds.least, rounds.median, rounds.least_cpu) == (2.5, 3.25, 3.5)
    assert (rounds.wall, rounds.cpu) == (3.5, 4.0)
    other = Timing()
    for wall in (2.0, 9.0, 1.0, 4.0):
        other.add(wall, wall)
    assert quotient(rounds, other) == pytest.approx((5.0 / 9.0 + 1.0) / 2)


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


def test_every_set_is_shown_or_skipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import nrrd

    monkeypatch.setattr("bench.first_sight.is_installed", lambda: False)
    nrrd.write(str(tmp_path / "nucleon_41x41x41_uint8.nrrd"), noisy_ball(24).values, index_order="C")
    options = _options(tmp_path, backend="cpu", rows=("nucleon", "fire"), pictures=tmp_path / "pictures")
    report = BENCHES["first_sight"].run(options)
    nucleon, fire = report.rows
    assert fire["remark"].startswith("skipped: fire_ug.vtu.gz")
    assert nucleon["draft_error"] > nucleon["good_error"] > nucleon["best_error"] > 0.0
    assert nucleon["good_s"] > 0.0 and nucleon["good_error"] < 0.2 and nucleon["pyvista"] == "not installed"
    assert nucleon["shown"] > 0.2 and 0.8 < nucleon["filled"] <= 1.0
    names = {path.name for path in (tmp_path / "pictures").iterdir()}
    assert {"first_sight-nucleon-good.png", "first_sight.jpg", "first_sight.html"} <= names
    page = (tmp_path / "pictures" / "first_sight.html").read_text(encoding="utf-8")
    assert "src='first_sight-nucleon-good.png'" in page and "skipped: fire_ug.vtu.gz" in page


def test_every_kind_of_data_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bench.first_sight.is_installed", lambda: False)
    options = _options(tmp_path, backend="cpu", rows=("ocean", "drifting"), pictures=tmp_path / "pictures")
    ocean, drifting = BENCHES["first_sight"].run(options).rows
    assert ocean["line"] == 'ss.render(ocean, nan="skip")' and ocean["low"] == -ocean["high"]
    assert math.isnan(ocean["off"]) and drifting["off"] < 0.005 and drifting["shown"] < 0.3
    page = (tmp_path / "pictures" / "first_sight.html").read_text(encoding="utf-8")
    assert "sheetsplat render ocean.npy --nan skip" in page and (tmp_path / "pictures" / "kinds_of_data.jpg").is_file()


def test_pyvista_shows_a_volume(tmp_path: Path) -> None:
    import nrrd

    pytest.importorskip("pyvista")
    nrrd.write(str(tmp_path / "a.nrrd"), noisy_ball(16).values, index_order="C")
    with (tmp_path / "b.nrrd.gz").open("wb") as packed:
        packed.write(gzip.compress((tmp_path / "a.nrrd").read_bytes()))
    for name in ("a.nrrd", "b.nrrd.gz"):
        output = tmp_path / f"{name}.png"
        found = in_new_process(draw, path=str(tmp_path / name), grid=None, size=[20, 16], output=str(output))
        assert found["seconds"] > 0.0 and Image.open(output).size == (20, 16)
    assert draw(str(tmp_path / "c.h5"), None, [8, 8], "") == {"reason": "no reader"}


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
        "bare fill test, two targets as in packing wide",
        "noisy ball, packing paper",
        "tubes",
    }
    by_name = {row["row"]: row for row in frame.rows}
    for name, row in by_name.items():
        own = "fill test" in name or "paper" in name
        assert ("not run" in row.get("remark", "")) == own and ("wall_ms" in row) != own
    scaling = BENCHES["scaling"].run(_options(tmp_path, size=(24, 24), scale=0.1))
    kernels = [row for row in scaling.rows if row["row"] == "kernels"]
    assert all(a["kernels_drawn"] < b["kernels_drawn"] for a, b in zip(kernels, kernels[1:], strict=False))


@pytest.mark.gl
def test_the_frame_is_opengls_unless_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SHEETSPLAT_BACKEND", raising=False)
    frame = BENCHES["frame"].run(_options(tmp_path, backend="auto"))
    assert "OpenGL" in frame.environment["device"]
    assert all("remark" not in row and row["wall_ms"] > 0.0 for row in frame.rows)
    options = _options(tmp_path, backend="auto", rows=("Toy Train",), size=(16, 16))
    (train,) = BENCHES["table2006"].run(options).rows
    assert train["fragments"] > 0 and train["rmse"] < 1e-4


@pytest.mark.slow
def test_what_only_opengl_has_is_not_run_elsewhere(tmp_path: Path) -> None:
    rows = BENCHES["ablation"].run(_options(tmp_path, backend="cpu", rows=("points", "packing", "lattice"))).rows
    for row in rows:
        assert ("not run" in row.get("remark", "")) == (row["group"] != "lattice"), row
    (train,) = BENCHES["table2006"].run(_options(tmp_path, backend="cpu", rows=("Toy Train",), size=(16, 16))).rows
    assert train["fps"] > 0.0 and "fragments" not in train and "remark" not in train
    ways = BENCHES["ellipsoids"].run(_options(tmp_path, backend="cpu", rows=("ways",), size=(16, 16), scale=0.1)).rows
    assert len(ways) == len(WAYS) and all(row["remark"].startswith("not run") for row in ways)


def test_summaries_of_error_estimates() -> None:
    text = summary("random", [0.5, 1.0, 1.0, 1.0, 8.0])
    assert "5 pictures" in text and "0.50 / 0.60 / 1.00 / 6.60 / 8.00" in text
    assert "factor of 2: 80.0%" in text and text.endswith("above 4 estimates: 1")


def test_windows_of_the_huge_picture_lie_across_tiles(rng: np.random.Generator) -> None:
    found = corners(2000, 600, rng)
    assert len(found) == 64 and all(0 <= low <= 2000 - 48 for place in found for low in place)

    def crosses(low: int) -> bool:
        return low // 600 != (low + 47) // 600

    assert all(crosses(column) and crosses(row) for column, row in found[:16])
    assert all(crosses(column) or crosses(row) for column, row in found[16:32])


@pytest.mark.slow
def test_import_and_memory_run_in_new_processes(tmp_path: Path) -> None:
    startup = BENCHES["startup"].run(_options(tmp_path))
    assert 0.0 < startup.rows[0]["least"] <= startup.rows[0]["seconds"]
    memory = BENCHES["memory"].run(_options(tmp_path))
    assert memory.rows[0]["remark"].startswith("skipped")
    assert 10.0 < memory.rows[1]["before"] <= memory.rows[1]["resident"] < 2000.0


def test_the_ellipsoids_are_what_the_benchmark_says() -> None:
    field = ellipsoids(4000, 64.0)
    axes = np.sort(field.scales, axis=1)
    volumes = 4.0 / 3.0 * math.pi * axes.prod(axis=1)
    assert volumes.sum() / 64.0**3 == pytest.approx(23.0, rel=1e-12)
    aspects = axes[:, 2] / axes[:, 0]
    assert aspects.max() <= 20.0 * (1 + 1e-12) and np.mean(aspects > 10.0) > 0.1 and np.mean(aspects < 2.0) > 0.1
    # Half are long, half flat.
    assert np.mean(axes[:, 1] > 0.9 * axes[:, 2]) == pytest.approx(0.5, abs=0.15)
    assert (field.centers >= 0.0).all() and (field.centers <= 64.0).all()
    # The same everywhere and every time.
    again = ellipsoids(4000, 64.0)
    assert np.array_equal(again.scales, field.scales) and np.array_equal(again.values, field.values)
    assert field.centers[0] == pytest.approx(ellipsoids(4000, 1.0).centers[0] * 64.0)
    assert not np.array_equal(ellipsoids(4000, 64.0, seed=1).scales, field.scales)
    assert ellipsoids(4000, 64.0, shrunk=0.5).scales == pytest.approx(0.5 * field.scales)


def test_the_supports_overlap_as_often_as_is_said() -> None:
    # Farther from the faces than the longest semi-axis, so that no kernel is missing; over enough of the cube that the
    # mean over the places there varies by some 3 %.
    points = np.random.default_rng(3).uniform(32.0, 96.0, (2000, 3))
    for shrunk, overlap in ((1.0, 23.0), (0.9, 23.0 * 0.9**3)):
        field = ellipsoids(shrunk=shrunk)
        # The profile is 1 - r^2 for so small a falloff, whose mean over a ball is 2/5: weights count supports.
        flat = ss.EllipsoidField(field.centers, field.scales, field.rotations, field.values, falloff=1e-9)
        assert flat.weight_at(points).mean() / 0.4 == pytest.approx(overlap, rel=0.1)


def test_figures_at_equal_time_and_exponents() -> None:
    # error = time^-2 is a straight line: found between the points, and beyond them.
    line = [(time, time**-2.0) for time in (1.0, 2.0, 4.0, 8.0)]
    for time in (1.0, 3.0, 8.0, 0.5, 20.0):
        assert at_equal_time(line[::-1], time) == pytest.approx(time**-2.0)
    assert at_equal_time([(1.0, 1.0), (2.0, 0.5), (4.0, 0.01)], 1.5) == pytest.approx(1.0 / 1.5)
    assert math.isnan(at_equal_time([(1.0, 0.0), (2.0, 0.0)], 1.5))
    assert math.isnan(at_equal_time(line[:1], 1.0))
    assert decibels(10.0**-2.5) == pytest.approx(50.0) and decibels(0.0) == math.inf
    rows = [{"row": count, "time": 1e-3 * count**0.8} for count in (100, 1000, 50000)]
    assert exponent(rows, "row", "time") == pytest.approx(0.8)
    assert math.isnan(exponent(rows[:1], "row", "time"))


def test_the_second_papers_table_is_whole() -> None:
    assert list(SCATTERED) == ["Blunt Fin", "Combust.", "Chess Pc.", "Monster", "Toy Car", "Toy Train"]
    assert sum(picture.paper_fps for picture in SCATTERED.values()) == pytest.approx(15.3)
    # Sums over the printed column of points, thousands: all, and those that were not culled.
    numbers = [re.findall(r"\d+", picture.paper_points) for picture in SCATTERED.values()]
    assert [sum(int(pair[n]) for pair in numbers) for n in (0, 1)] == [620, 445]


def test_diagonals_are_in_parts_of_the_longest_edge() -> None:
    from sheetsplat.fit import Kernels

    centers = np.array([[0.0, 0.0, 0.0], [256.0, 10.0, 3.0]])
    spheres = Kernels(centers, np.array([1.0, 4.0]), np.ones(2))
    assert diagonals(spheres) == pytest.approx((math.sqrt(3.0), 4.0 * math.sqrt(3.0)))
    boxes = Kernels(centers, np.array([[1.0, 2.0, 2.0], [2.0, 3.0, 6.0]]), np.ones(2))
    assert diagonals(boxes) == pytest.approx((3.0, 7.0))


def test_the_second_table_skips_what_is_not_there(tmp_path: Path) -> None:
    rows = ("Combust.", "Monster", "Toy Train")
    options = _options(tmp_path, rows=rows, size=(16, 16), pictures=tmp_path / "pictures")
    combustor, monster, train = BENCHES["table2006"].run(options).rows
    for missing, name in ((combustor, "combxyz.bin.gz"), (monster, "mesh_spot.obj")):
        assert missing["remark"].startswith("skipped") and name in missing["remark"]
        assert "SHEETSPLAT_DATA" in missing["remark"] and "fps" not in missing
        assert missing["paper_fps"] > 0.0
    assert train["rmse"] == 0.0 and train["fps"] > 0.0 and "stand-in" in train["source"]
    assert train["points"] >= train["kernels_drawn"] > 500
    # The longest edge is 128 slice distances, from whichever side it is seen.
    assert 10 < train["slices"] < 300
    # The reference counts no fragments.
    assert "fragments" not in train
    assert len(list((tmp_path / "pictures").iterdir())) == 2


def test_the_second_table_reads_plot3d(tmp_path: Path) -> None:
    # A block of 6 x 5 x 4 points, big-endian, without records; its density is x.
    sizes = np.array([6, 5, 4], ">i4").tobytes()
    places = np.stack(np.meshgrid(range(6), range(5), range(4), indexing="ij"), axis=-1)
    flat = places.transpose(2, 1, 0, 3).reshape(-1, 3).astype(">f4")
    flow = np.zeros((5, len(flat)), ">f4")
    flow[0] = 1.0 + flat[:, 0]
    (tmp_path / "combxyz.bin.gz").write_bytes(sizes + flat.T.tobytes())
    (tmp_path / "combq.bin.gz").write_bytes(sizes + np.array([1, 0, 1, 0], ">f4").tobytes() + flow.tobytes())
    report = BENCHES["table2006"].run(_options(tmp_path, rows=("Combust.",), size=(16, 16)))
    assert report.rows[0]["points"] == 120 and report.rows[0]["rmse"] == 0.0
    assert report.reached and "fit of the Combustor" in report.goals[0].name


def test_ellipsoids_without_a_device(tmp_path: Path) -> None:
    options = _options(tmp_path, size=(12, 12), scale=0.1, rows=("wide", "sampling"))
    report = BENCHES["ellipsoids"].run(options)
    by_name = {(row["row"], row.get("spacing")): row for row in report.rows}
    assert by_name["wide", 1.0]["rmse"] == 0.0 and by_name["wide", 1.0]["wall_ms"] > 0.0
    assert by_name["wide: bare fills", None]["remark"].startswith("not run")
    # Both samplings come closer to the converged picture by more than the order 1.
    for sampling in ("points", "slabs"):
        errors = [by_name[f"composite: {sampling}", spacing]["rmse"] for spacing in (4.0, 2.0, 1.0, 0.5)]
        assert errors[0] > 0.0 and errors[-1] < errors[0] / 16.0
    # The line integral is exact by slabs, and is not by points.
    for spacing in (4.0, 1.0):
        assert by_name["xray: slabs", spacing]["rmse"] < 1e-9 < 1e-6 < by_name["xray: points", spacing]["rmse"]
    # No figure to be reached is judged by fewer kernels than it is meant for.
    assert not report.goals


@pytest.mark.gl
def test_other_ways_stand_beside_the_usual_one(tmp_path: Path) -> None:
    options = _options(tmp_path, size=(32, 32), backend="gl", rows=("ways",))
    rows = BENCHES["ellipsoids"].run(options).rows
    assert {row["row"] for row in rows} == set(WAYS)
    for name in WAYS:
        small, larger = (row for row in rows if row["row"] == name)
        assert (small["size"], larger["size"]) == ("8x8", "16x16")
        for row in (small, larger):
            assert row["wall_ms"] > 0.0 and row["over_usual"] > 0.0 and 0.0 <= row["apart"] < 1e-4, name
        assert small["error_size"] == "8x8" and small["rmse"] < 1e-4


@pytest.mark.gl
def test_ellipsoids_against_bare_fills(tmp_path: Path) -> None:
    options = _options(tmp_path, size=(40, 40), backend="gl", rows=("wide", "paper"))
    rows = {row["row"]: row for row in BENCHES["ellipsoids"].run(options).rows}
    for packing in ("wide", "paper"):
        row = rows[packing]
        assert row["rmse"] < 1e-4 and row["over_bare"] > 0.0 and row["cpu_over_fill"] > 0.0
        bare, fill = (
            next(row for name, row in rows.items() if name.startswith(f"{packing}: {what}")) for what in ("own", "fill")
        )
        assert row["fragments"] == bare["fragments"] == fill["fragments"] > row["splats"] > 0
    # One fragment holds twice as many slices in packing wide.
    assert rows["paper"]["fragments"] > rows["wide"]["fragments"]


@pytest.mark.slow
def test_scattered_scaling_runs_in_new_processes(tmp_path: Path) -> None:
    report = BENCHES["scattered_scaling"].run(_options(tmp_path, size=(24, 24), scale=0.05))
    assert [row["row"] for row in report.rows] == [100, 125, 1250]
    for row in report.rows:
        # Six supports over every point of a cube of 128.
        assert row["row"] * 4.0 / 3.0 * math.pi * row["radius"] ** 3 / 128.0**3 == pytest.approx(6.0)
        assert row["per_kernel"] * row["row"] == pytest.approx(1e6 * row["resident"]) and row["cpu_ms"] > 0.0
    assert report.rows[0]["slices"] < report.rows[2]["slices"]
    assert not report.goals


def test_simulated_clusters() -> None:
    costs = Costs(0.0, 0.0, 0.0, 0.0, submit=1e-6, scheduler=1e-6)
    alone = [Task(1.0, 8e9, (), number) for number in range(8)]
    for workers, expected in ((1, 8.0), (4, 2.0), (16, 1.0)):
        machine = Machine(workers, bandwidth=1e9, latency=1e-6)
        assert simulated(alone, machine, costs).seconds == pytest.approx(expected, rel=1e-3)
    # More processes than cores share these.
    for workers, cores in ((2, 1.0), (4, 1.0), (4, 2.0)):
        shared = Machine(workers, cores=cores, latency=1e-6)
        assert simulated(alone, shared, costs).seconds == pytest.approx(8.0 / cores, rel=1e-3)
    # One that is alone at the end has a core for itself.
    long = [Task(1.0, 0.0, (), 0), Task(3.0, 0.0, (), 1)]
    assert simulated(long, Machine(2, cores=1.0, latency=1e-6), costs).seconds == pytest.approx(4.0, rel=1e-3)
    # One after the other, on different workers: what is moved takes time too.
    row = [Task(1.0, 8e9, (number - 1,) if number else (), number) for number in range(4)]
    run = simulated(row, Machine(2, bandwidth=8e9, latency=1e-6), costs)
    assert run.seconds == pytest.approx(7.0, rel=1e-3) and run.moved == 24e9
    assert run.chain == pytest.approx(4.0) and run.limit == "longest chain"
    busy = simulated(alone, Machine(8, speed=1e3), replace(costs, scheduler=1.0))
    assert busy.limit == "scheduler" and busy.seconds >= 8.0
    # Before any task begins the scheduler has all of them.
    told = simulated(alone, Machine(8, latency=1e-6), replace(costs, submit=1.0))
    assert told.seconds == pytest.approx(9.0, rel=1e-3)
    # What the client takes before and after, and what a worker takes between tasks, with a core and without.
    slow = replace(costs, client=3.0, result=2.0, overhead=0.5, pause=0.25)
    assert simulated(alone, Machine(1, latency=1e-6), slow).seconds == pytest.approx(8 * 1.75 + 5.0, rel=1e-3)
    # What a worker does beside drawing takes time from it where cores are few.
    beside = replace(costs, beside=0.5)
    one, two = (simulated(alone, Machine(1, cores=cores, latency=1e-6), beside).seconds for cores in (1.0, 2.0))
    assert one == pytest.approx(12.0, rel=1e-3) and two == pytest.approx(8.5, rel=1e-3)
    # A core that a worker shares with the scheduler is half as fast while this has messages.
    served = replace(costs, scheduler=1.0)
    row = [Task(0.0, 0.0, (), 0)] * 3 + [Task(10.0, 0.0, (), 1)]
    one, two = (simulated(row, Machine(2, cores=cores, latency=1e-6), served).seconds for cores in (1.0, 2.0))
    assert one == pytest.approx(two + 3.0, rel=1e-3)


@pytest.mark.slow
def test_pictures_on_clusters(tmp_path: Path) -> None:
    report = BENCHES["distributed"].run(_options(tmp_path, rows=("4096",), scale=0.15))
    assert [row["row"].rsplit(",")[-1] for row in report.rows][0] == " 10 workers"
    seconds = [row["simulated"] for row in report.rows]
    assert seconds == sorted(seconds, reverse=True) and seconds[-1] >= report.rows[-1]["chain"]
    assert all(row["memory"] > 0 for row in report.rows)
