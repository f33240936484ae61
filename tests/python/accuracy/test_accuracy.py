"""What accuracy costs: rows, truths, front, plot, and the command."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import FrozenInstanceError, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image as PillowImage
from scipy import ndimage  # type: ignore[import-untyped]

import sheetsplat as ss
from sheetsplat.accuracy import accuracy
from sheetsplat.accuracy.knobs import INTERPOLATED, KNOBS
from sheetsplat.accuracy.measure import limit
from sheetsplat.accuracy.report import AccuracyReport, AccuracyRow, front
from sheetsplat.accuracy.sweeps import cut_off, enlarge, smaller, table
from sheetsplat.cli import main

TRANSFER = [(0.05, 0.1, 0.2, 0.6, 0.0), (0.5, 0.3, 0.6, 0.4, 0.1), (1.0, 1.0, 0.9, 0.8, 0.5)]
SIZE = (32, 24)


def smooth(count: int = 14) -> np.ndarray:
    """Return samples of a hill that is 0 at the border, float64 [k, j, i]."""
    wave = np.sin(np.linspace(0, np.pi, count)) ** 2
    return np.asarray(wave[:, None, None] * wave[:, None] * wave)


@pytest.fixture(scope="module")
def scene() -> ss.Scene:
    return ss.Scene(ss.RegularField(smooth()), TRANSFER, lights=[ss.Light((0.3, 0.5, 1.0))])


@pytest.fixture(scope="module")
def camera(scene: ss.Scene) -> ss.Camera:
    return ss.Camera.fit(scene, direction=(-0.5, -0.4, -0.8))


@pytest.fixture(scope="module")
def report(scene: ss.Scene, camera: ss.Camera) -> AccuracyReport:
    return ss.accuracy(scene, camera, size=SIZE, backend="cpu", repeats=2, reference_seconds=5.0)


def cloud(count: int = 60) -> ss.EllipsoidField:
    rng = np.random.default_rng(7)
    turns = rng.normal(size=(count, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    return ss.EllipsoidField(
        rng.uniform(-1, 1, (count, 3)), rng.uniform(0.3, 0.8, (count, 3)), turns, rng.random(count), w0=0.5
    )


@pytest.mark.slow
def test_every_knob_has_rows_and_the_package_exports_it(report: AccuracyReport) -> None:
    assert ss.accuracy is accuracy
    assert [row.knob for row in report.rows] == sorted(
        (row.knob for row in report.rows), key=lambda knob: list(KNOBS).index(knob)
    )
    for knob in KNOBS:
        rows = report.of(knob)
        assert rows
        # Each is measured, or says why not.
        assert all(row.measured != bool(row.reason) for row in rows)
        assert sum(row.current for row in rows) <= 1
        for row in rows:
            if not row.measured:
                continue
            assert row.seconds > 0 and row.fastest <= row.seconds <= row.slowest
            assert 0 <= row.rmse <= row.maximum
            assert row.p99_9 <= row.maximum
            assert math.isnan(row.arithmetic_rmse) == bool(row.arithmetic_reason)
    with pytest.raises(FrozenInstanceError):
        report.rows[0].seconds = 0.0  # type: ignore[misc]
    with pytest.raises(ss.InvalidInput, match="no such knob"):
        report.of("weather")


def test_errors_are_ordered_as_they_must_be(report: AccuracyReport) -> None:
    spacing = [row.rmse for row in report.of("slice_spacing")]
    assert spacing[0] > spacing[1] > spacing[2]
    scale = [row.rmse for row in report.of("image_scale")]
    assert scale[0] < scale[1] < scale[2]
    cuts = [row.arithmetic_rmse for row in report.of("cut_off")]
    assert cuts == sorted(cuts)
    assert cuts[0] < 1e-5 < 1e-3 < cuts[-1]
    tables = [row.arithmetic_rmse for row in report.of("table_size")]
    # As given, then 16, 64, … points.
    assert tables[0] < 1e-5 < tables[1]
    stops = [row.rmse for row in report.of("opacity_stop")]
    assert stops[0] > stops[-1]


def test_flat_pictures_converge_and_lit_ones_as_far_as_their_gradients(
    scene: ss.Scene, camera: ss.Camera, report: AccuracyReport
) -> None:
    flat = accuracy(
        scene.replace(lights=()),
        camera,
        size=SIZE,
        backend="cpu",
        knobs="slice_spacing",
        repeats=1,
        reference_seconds=0,
    )
    errors = [row.rmse for row in flat.rows]
    assert errors == sorted(errors, reverse=True) and errors[-1] < errors[0] / 64
    assert [row.slicing_rmse for row in flat.rows] == errors
    # Held against the limit of pictures whose gradients are differences, lit ones converge to it as well.
    slicing = [row.slicing_rmse for row in report.of("slice_spacing")]
    assert slicing == sorted(slicing, reverse=True) and slicing[-1] < slicing[0] / 64
    assert slicing[-1] < 0.2 * report.of("slice_spacing")[-1].rmse
    assert all(math.isnan(row.slicing_rmse) for row in report.of("kernel"))
    # Differences of pixels stay what they are, however close slices are; the kernels' own derivatives have none.
    sheets = next(row for row in report.of("slice_spacing") if row.setting == "Δs / 2")
    analytic = next(row for row in report.of("gradient") if row.setting == "analytic, Δs / 2")
    assert analytic.rmse < 0.8 * sheets.rmse


def test_arithmetic_is_that_of_the_precision(report: AccuracyReport) -> None:
    found = {row.setting: row for row in report.of("precision") if row.measured}
    assert found["cpu float32"].arithmetic_rmse < 2e-5
    assert found["cpu float64"].arithmetic_rmse <= 1e-8
    assert found["cpu float32"].current
    assert found["cpu float32"].arithmetic_size == SIZE
    if "gl uint8" in found:
        # The control: 8 bits are far off, and no setting hides it.
        assert found["gl uint8"].arithmetic_rmse > 1e-3


def test_lattices_are_measured_against_the_field_through_the_samples(report: AccuracyReport) -> None:
    plain = next(row for row in report.of("kernel") if row.setting == "(2, 5)")
    assert plain.current and plain.truth == INTERPOLATED
    sharp = next(row for row in report.of("prefilter") if row.setting == "(2.5, 7), prefiltered")
    assert sharp.measured
    # Which is the field through the samples itself, but for float32; plain kernels smooth the hill.
    assert sharp.rmse < 1e-5 < 1e-3 < plain.rmse
    assert {truth.name for truth in report.truths} == {"best", "converged", "slices", INTERPOLATED}
    assert 0.007 < plain.ripple_maximum < 0.008
    assert next(row for row in report.of("kernel") if "weights" in row.setting).ripple_maximum == 0.0
    assert any(row.setting.startswith("BCC") and row.measured for row in report.of("lattice"))


def test_the_scene_as_it_is_is_measured_once(report: AccuracyReport) -> None:
    now = report.current
    assert now is not None and now.truth == "converged"
    here = [row for row in report.rows if row.current and row.truth == "converged"]
    assert len(here) >= 8
    assert {(row.seconds, row.rmse) for row in here} == {(now.seconds, now.rmse)}


def test_the_front(report: AccuracyReport) -> None:
    assert report.pareto
    for row in report.rows:
        if not row.measured or row.is_truth:
            assert not row.pareto
            continue
        beaten = any(
            other.measured
            and not other.is_truth
            and other.truth == row.truth
            and other.seconds <= row.seconds
            and other.rmse <= row.rmse
            and (other.seconds, other.rmse) != (row.seconds, row.rmse)
            for other in report.rows
        )
        assert row.pareto is not beaten
    errors = [row.rmse for row in report.pareto]
    assert errors == sorted(errors, reverse=True)


def test_the_front_by_hand() -> None:
    def row(seconds: float, rmse: float, **more: Any) -> AccuracyRow:
        return AccuracyRow("slice_spacing", "x", seconds=seconds, cpu_seconds=1.0 / seconds, rmse=rmse, **more)

    rows = (row(1, 1), row(2, 0.5), row(3, 0.7), row(4, 0.1), row(5, 0.01, reason="no"), row(9, 9, truth=INTERPOLATED))
    assert [one.pareto for one in front(rows, "wall")] == [True, True, False, True, False, True]
    # By the other clock, which these rows have the other way round, the last one is all that is left of the first four.
    assert [one.pareto for one in front(rows, "cpu")] == [False, False, False, True, False, True]


def test_json_and_text(report: AccuracyReport) -> None:
    found = json.loads(report.to_json())
    assert found["backend"] == "cpu" and len(found["rows"]) == len(report.rows)
    assert found["current"]["rmse"] == pytest.approx(report.current.rmse)  # type: ignore[union-attr]
    assert "NaN" not in report.to_json() and "Infinity" not in report.to_json()
    # A number that is none is null, not absent.
    assert found["rows"][0]["ripple_rms"] is None
    text = str(report)
    for knob in KNOBS:
        assert knob in text
    assert "now" in text and "front" in text and "extrapolated" in text
    assert "rows measured" in repr(report)


@pytest.mark.slow
def test_the_plot(report: AccuracyReport, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    path = tmp_path / "accuracy.png"
    report.plot(path)
    with PillowImage.open(path) as picture:
        assert picture.width > 1000 and picture.height > 500
        seen = np.asarray(picture.convert("RGB"))
    # White, with ink on it in many colours.
    assert (seen == 255).all(axis=2).mean() > 0.7
    assert len(np.unique(seen.astype(np.uint32) @ (1 << 16, 1 << 8, 1))) > 100
    assert path.stat().st_size < 150_000
    # Few rows: finding places for labels takes most of the time.
    replace(report, rows=tuple(report.of("slice_spacing"))).plot(str(tmp_path / "accuracy.svg"))
    assert (tmp_path / "accuracy.svg").read_text().lstrip().startswith("<?xml")
    for name, message in (("accuracy.jpg", r"\.png"), ("missing/accuracy.png", "missing")):
        with pytest.raises(ss.Error, match=message):
            report.plot(tmp_path / name)
    nothing = replace(report, rows=tuple(row for row in report.rows if not row.measured))
    with pytest.raises(ss.InvalidInput, match="no row"):
        nothing.plot(path)


def test_the_plot_without_matplotlib(report: AccuracyReport, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ss.Unsupported, match=r"no package matplotlib.*sheetsplat\[plot\]"):
        report.plot(tmp_path / "accuracy.png")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("mode", ["xray", "mip", "isosurface"])
def test_modes_say_what_they_do_not_use(scene: ss.Scene, camera: ss.Camera, mode: str) -> None:
    changed = scene.replace(mode=mode, iso_value=0.4 if mode == "isosurface" else None)
    knobs = ("slice_spacing", "classification", "gradient", "opacity_stop", "table_size")
    found = accuracy(changed, camera, size=SIZE, backend="cpu", knobs=knobs, repeats=1, reference_seconds=0)
    assert found.of("slice_spacing")[0].measured
    for knob in ("opacity_stop", "table_size"):
        assert [row.reason for row in found.of(knob)] == [f"not used in mode {mode}"]
    refused = [row.setting for row in found.of("classification") if not row.measured]
    assert refused == ["pre-integrated", "second order"]
    assert all(row.arithmetic_reason == "not asked for" for row in found.rows if row.measured)
    assert found.of("gradient")[0].measured is (mode == "isosurface")


def test_scattered_fields() -> None:
    field = cloud()
    scene = ss.Scene(field, TRANSFER)
    view = ss.Camera.fit(field, direction=(-0.5, -0.4, -0.8))
    knobs = ("slice_spacing", "cut_off", "gradient", "filter", "lattice", "kernel", "prefilter")
    found = accuracy(scene, view, size=SIZE, backend="cpu", knobs=knobs, repeats=1, reference_seconds=5)
    assert {row.knob for row in found.rows if not row.measured} == {"gradient", "lattice", "kernel", "prefilter"}
    assert found.of("gradient")[0].reason == "nothing in the scene uses gradients"
    cuts = [row.arithmetic_rmse for row in found.of("cut_off")]
    assert cuts == sorted(cuts) and cuts[-1] > 1e-3


def test_a_setting_that_is_not_available_has_a_reason(camera: ss.Camera) -> None:
    holed = smooth()
    holed[5, 5, 5] = np.nan
    scene = ss.Scene(ss.RegularField(holed, nan="skip"), TRANSFER)
    found = accuracy(scene, camera, size=SIZE, backend="cpu", knobs=("lattice", "prefilter"), repeats=1)
    # Without a field through its samples there is nothing to measure lattices against.
    assert not any(row.measured for row in found.rows)
    assert all("NaN" in row.reason or "nan" in row.reason for row in found.rows)
    assert found.current is None and "nan" in str(found)


def test_a_missing_device_is_a_reason(scene: ss.Scene, camera: ss.Camera, monkeypatch: pytest.MonkeyPatch) -> None:
    def render(self: ss.Renderer, *arguments: Any, **options: Any) -> Any:
        if "gl" in repr(self):
            raise ss.DeviceUnavailable("no OpenGL here: " + "tried this and that, " * 40)
        return drawn(self, *arguments, **options)

    drawn = ss.Renderer.render
    monkeypatch.setattr(ss.Renderer, "render", render)
    found = accuracy(scene, camera, size=SIZE, backend="cpu", knobs="precision", repeats=1, reference_seconds=0)
    missing = [row for row in found.rows if not row.measured]
    assert [row.setting for row in missing] == ["gl uint8", "gl float16", "gl float32"]
    assert all(row.reason.count("tried") == 40 for row in missing)
    # The table has the beginning of it.
    assert "no OpenGL here" in str(found) and str(found).count("tried") < 40


def test_the_converged_picture_of_a_known_field() -> None:
    """That of slices, extrapolated, is that of rays that are integrated densely."""
    import test_orders as known

    truth = known.converged(12)
    scene = ss.Scene(known.field(), known.TRANSFER, slice_spacing=0.2, reference_length=known.LENGTH)
    found = limit(scene, known.camera("orthographic"), (12, 12), {})
    assert known.distance(found.values, truth) < 1e-6
    assert known.distance(found.values, truth) < 5 * found.uncertainty + 2e-8
    assert 1.8 < found.order < 2.2
    assert "extrapolated at second order" in found.text
    # The control: the finest slices themselves are farther off.
    finest = known.picture("cpu", known.field(), known.camera("orthographic"), 12, slice_spacing=0.025)
    assert known.distance(finest, truth) > 3 * known.distance(found.values, truth)


def test_a_truth_that_is_given(scene: ss.Scene, camera: ss.Camera) -> None:
    renderer = ss.Renderer("cpu")
    picture = renderer.render(scene, camera, size=SIZE)
    found = accuracy(
        scene, camera, size=SIZE, backend="cpu", knobs="slice_spacing", repeats=1, reference_seconds=0, truth=picture
    )
    assert [truth.name for truth in found.truths] == ["given"]
    assert found.current is not None and found.current.rmse == 0.0 and found.current.pareto
    assert all(row.rmse > 1e-4 for row in found.rows if not row.current)
    for bad in (np.zeros((3, 3)), np.full((*SIZE[::-1], 4), np.nan), "nothing"):
        with pytest.raises(ss.InvalidInput, match="truth"):
            accuracy(scene, camera, size=SIZE, knobs="slice_spacing", truth=bad)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"knobs": "weather"}, "slice_spacing"),
        ({"knobs": ()}, "at least one"),
        ({"repeats": 0}, "repeats"),
        ({"repeats": 1.5}, "repeats"),
        ({"reference_seconds": -1}, "reference_seconds"),
        ({"reference_seconds": math.nan}, "reference_seconds"),
        ({"clock": "sun"}, "clock"),
        ({"progress": 3}, "progress"),
        ({"size": (0, 4)}, "size"),
        ({"backend": "cpu", "precision": "uint8"}, "uint8"),
        ({"max_error": 1e-3}, "max_error"),
    ],
)
def test_wrong_arguments(scene: ss.Scene, camera: ss.Camera, options: dict[str, Any], message: str) -> None:
    with pytest.raises(ss.Error, match=message):
        accuracy(scene, camera, **options)


def test_it_can_be_stopped(scene: ss.Scene, camera: ss.Camera) -> None:
    shares: list[float] = []

    def count(share: float) -> object:
        shares.append(share)
        return len(shares) < 20

    with pytest.raises(ss.Cancelled):
        accuracy(scene, camera, size=SIZE, backend="cpu", progress=count)
    assert len(shares) == 20

    def interrupt(_: float) -> object:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        accuracy(scene, camera, size=SIZE, backend="cpu", progress=interrupt)
    shares.clear()
    accuracy(scene, camera, size=SIZE, backend="cpu", knobs="filter", repeats=1, progress=shares.append)
    assert shares == sorted(shares) and shares[-1] == 1.0 and shares[0] < 0.5


def test_a_scene_with_other_options(scene: ss.Scene) -> None:
    other = scene.replace(slice_spacing=0.25, lights=())
    assert other.slice_spacing == 0.25 and other.lights == () and other.fields == scene.fields
    assert other.reference_length == scene.reference_length
    # Lights that could be gone through once only are still there.
    once = ss.Scene(scene.fields[0], TRANSFER, lights=iter([ss.Light()]))
    assert len(once.replace(mode="isosurface", iso_value=0.5).lights) == 1
    with pytest.raises(ss.InvalidInput, match="weather"):
        scene.replace(weather="fine")


def test_enlarging() -> None:
    y, x = np.mgrid[0:6, 0:9].astype(np.float32)
    ramp = 2 * x + 3 * y
    assert np.array_equal(enlarge(ramp, (9, 6)), ramp)
    larger = enlarge(ramp, (18, 12))
    v, u = (np.mgrid[0:12, 0:18] + 0.5) / 2 - 0.5
    # Exact for a ramp between the outermost centres, and constant beyond them.
    assert np.allclose(larger[1:-1, 1:-1], (2 * u + 3 * v)[1:-1, 1:-1], atol=1e-5)
    assert larger[0, 0] == ramp[0, 0] and larger[-1, -1] == ramp[-1, -1]
    assert enlarge(np.ones((1, 1, 4), np.float32), (5, 3)).shape == (3, 5, 4)
    assert smaller((101, 3), 4) == (25, 1)


def test_what_the_knobs_change(scene: ss.Scene) -> None:
    field = cloud()
    cut = cut_off(field, 0.5)
    assert isinstance(cut, ss.EllipsoidField)
    assert np.allclose(cut.scales, 0.5 * field.scales) and cut.falloff == field.falloff / 4
    # The same Gaussians: near a centre only the lowering by the value at the edge differs.
    g, h = math.exp(-field.falloff), math.exp(-cut.falloff)
    alone = ss.EllipsoidField([(0, 0, 0)], 1.0, values=[1.0], normalization="none")
    near = [(0.2, 0.0, 0.0)]
    bell = math.exp(-8.0 * 0.04)
    assert alone.at(near)[0] == pytest.approx((bell - g) / (1 - g))
    assert cut_off(alone, 0.5).at(near)[0] == pytest.approx((bell - h) / (1 - h))  # type: ignore[attr-defined]
    lattice = scene.fields[0]
    assert isinstance(lattice, ss.RegularField)
    same = lattice.replace()
    assert (same.radius, same.falloff, same.spacing) == (lattice.radius, lattice.falloff, lattice.spacing)
    sharp = lattice.replace(prefilter=True)
    assert sharp.replace().prefilter and np.array_equal(sharp.replace().values, lattice.values)
    assert sharp.replace(prefilter=False) == lattice.replace(prefilter=False)
    coarse = table(scene.transfer_function, 4)
    assert len(coarse.points) == 4 and coarse.v_max == scene.transfer_function.v_max
    with pytest.raises(ss.InvalidInput, match="table"):
        table(ss.TransferFunction([(1.0, 1, 1, 1, 0.5)]), 4)


@pytest.fixture(scope="module")
def volume(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("accuracy") / "hill.npy"
    np.save(path, smooth(12))
    return path


def run(*arguments: object) -> Any:
    return CliRunner().invoke(main, ["accuracy", *map(str, arguments)])


def test_the_command(volume: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    plot = tmp_path / "plot.png"
    options = ("--size", "24x16", "--backend", "cpu", "--repeats", 1, "--knobs", "slice_spacing,filter")
    found = run(volume, *options, "-o", plot, "--json", "-q", "--clock", "cpu")
    assert found.exit_code == 0, found.stderr
    report = json.loads(found.stdout)
    assert report["size"] == [24, 16] and report["clock"] == "cpu"
    assert {row["knob"] for row in report["rows"]} == {"slice_spacing", "filter"}
    assert found.stderr == ""
    with PillowImage.open(plot) as picture:
        assert picture.width > 500
    found = run(volume, *options, "--mode", "xray", "--reference-seconds", 0)
    assert found.exit_code == 0 and "slice_spacing" in found.stdout and "converged" not in found.stderr


def test_wrong_usage_of_the_command(volume: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for options in (("--knobs", "weather"), ("-o", "plot.jpg"), ("--repeats", 0), ("--clock", "sun"), ("-o", volume)):
        assert run(volume, *options).exit_code == 2
    assert run(volume, "-o", tmp_path / "missing" / "plot.png").exit_code == 1
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    # Before anything takes its time: there is no such file.
    found = run(tmp_path / "none.npy", "-o", tmp_path / "plot.png")
    assert found.exit_code == 1 and "matplotlib" in found.stderr


def test_the_three_qualities(scene: ss.Scene, camera: ss.Camera) -> None:
    """Errors fall from draft to best, and each is drawn as `render` draws it; a scene of one of them says so."""
    (field,) = scene.fields
    assert isinstance(field, ss.RegularField)
    given = {"clim": (0.1, 1.0), "opacity": 0.3, "camera": camera, "size": SIZE, "backend": "cpu"}
    values = ndimage.gaussian_filter(field.values.astype(np.float32), 1.0)
    image = ss.render(values, spacing=field.spacing, origin=field.origin, **given)  # type: ignore[arg-type]
    assert image.plan.quality is not None and image.plan.quality.of("prefilter").value is True
    shown = image.recipe.scene([ss.RegularField(values, spacing=field.spacing, origin=field.origin, prefilter=True)])
    found = accuracy(
        shown.with_quality(image.plan.quality), camera, size=SIZE, backend="cpu", knobs="quality", repeats=1
    )
    draft, good, best = found.of("quality")
    assert draft.rmse > good.rmse > best.rmse > 0 and 1.5 * draft.slices < good.slices < best.slices
    assert (draft.current, good.current, best.current) == (False, True, False) and found.current == good
    assert {row.truth for row in found.rows} == {"best"} and "the field of quality best" in str(found)
    assert found.pareto == () and best.how == "render(quality='best')"
    # A scene that was made by hand is none of them.
    assert not any(
        row.current
        for row in accuracy(shown, camera, size=SIZE, backend="cpu", knobs="quality", repeats=1).of("quality")
    )
