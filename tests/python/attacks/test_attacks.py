"""Invalid input is refused with clear messages: truncated files, meaningless numbers, failures half way."""

from __future__ import annotations

import gzip
import itertools
import json
import os
import subprocess
import sys
import warnings

import numpy as np
import pytest
from command_line import run

import sheetsplat as ss
from sheetsplat import _checks
from sheetsplat.cli import info
from sheetsplat.compare import compare
from sheetsplat.framing import compose_camera
from sheetsplat.io import pictures
from sheetsplat.look import histogram

SMALL = {"size": (8, 8), "backend": "reference", "quality": "draft"}
POINTS = [(0, 1, 1, 1, 0), (1, 1, 1, 1, 1)]


@pytest.fixture
def field(ball):
    return ss.RegularField(ball)


def nrrd(sizes="2 2 2", data=""):
    return f"NRRD0004\ntype: uint8\ndimension: 3\nsizes: {sizes}\nencoding: raw\n{data}\n".encode()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes with names")
@pytest.mark.timeout(20)
def test_pipes_and_devices_are_refused_at_once(tmp_path):
    pipe = tmp_path / "pipe.raw"
    os.mkfifo(pipe)
    with pytest.raises(ss.InvalidInput, match="pipe"):
        ss.open(pipe, shape=(2, 2, 2), dtype="uint8")
    (tmp_path / "a.nhdr").write_bytes(nrrd(data="data file: pipe.raw\n"))
    with pytest.raises(ss.InvalidInput, match="pipe"):
        ss.open(tmp_path / "a.nhdr")
    with pytest.raises(ss.InvalidInput, match="regular"):
        ss.open("/dev/zero", shape=(2, 2, 2), dtype="uint8")
    os.mkfifo(tmp_path / "pipe.png")
    with pytest.raises(ss.InvalidInput):
        pictures.read_picture(tmp_path / "pipe.png")
    (tmp_path / "b.raw").write_bytes(bytes(8))
    assert ss.open(tmp_path / "b.raw", shape=(2, 2, 2), dtype="uint8").size == 8


@pytest.mark.parametrize("sizes", ["2.5 2 2", "1e0 2 2", "2 2 2x"])
def test_sizes_of_nrrd_are_whole(tmp_path, sizes):
    (tmp_path / "a.nrrd").write_bytes(nrrd(sizes) + bytes(64))
    with pytest.raises(ss.InvalidInput, match="whole"):
        ss.open(tmp_path / "a.nrrd")


def test_messages_stay_short(tmp_path, field):
    digits = 10**6000
    for call in (
        lambda: ss.Renderer(tile_size=digits),
        lambda: ss.render(field, size=(digits, 1)),
        lambda: _checks.triple("three", [digits, "a" * 10**6, 1]),
        lambda: ss.Renderer(effects={"a" * 10**6: 1}),
    ):
        with pytest.raises(ss.InvalidInput) as caught:
            call()
        assert len(str(caught.value)) < 3000
    names = {f"array{number}": np.zeros((1, 1, 1)) for number in range(2000)}
    np.savez(tmp_path / "many.npz", **names)
    with pytest.raises(ss.InvalidInput) as caught:
        ss.open(tmp_path / "many.npz")
    assert 200 < len(str(caught.value)) < 3000


def test_libraries_do_not_warn(tmp_path):
    header = nrrd().replace(b"encoding", b"strange field: 1\nencoding: raw\nencoding")
    (tmp_path / "a.nrrd").write_bytes(header + bytes(8))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with np.errstate(all="warn"), pytest.raises(ss.InvalidInput):
            ss.open(tmp_path / "a.nrrd")


@pytest.mark.parametrize(
    "values",
    [
        np.linspace(-1, 1, 27) * np.finfo(np.float64).max,
        np.linspace(0, 1, 27) * np.finfo(np.float64).max,
        np.repeat([1e16, 1e16 + 2, 1e16 + 4], 9),
        np.full(27, 1e300),
        np.full(27, -np.finfo(np.float64).max),
        np.linspace(0, 27, 27) * 5e-324,
        np.zeros(27),
    ],
)
def test_info_copes_with_any_finite_range(tmp_path, values):
    np.save(tmp_path / "a.npy", values.reshape(3, 3, 3))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        report = json.loads(run("info", tmp_path / "a.npy", "--json").stdout)
        assert run("info", tmp_path / "a.npy").stderr == ""
        look = histogram.choose_for(values.reshape(3, 3, 3))
    assert sum(report["histogram"]["counts"]) == 27
    assert report["minimum"] == values.min() and report["maximum"] == values.max()
    assert all(part is not None for part in (report["mean"], report["deviation"], *report["percentiles"].values()))
    assert look.clim[0] < look.clim[1] or abs(values).max() < 1e-300


def test_info_says_what_numpy_says(monkeypatch):
    monkeypatch.setattr(info, "_BLOCK", 1000)
    values = np.random.default_rng(1).normal(3, 2, 12345)
    report = info._statistics(values, 16)
    counts, edges = np.histogram(values, 16)
    assert report["histogram"]["counts"] == counts.tolist()
    assert np.allclose(report["histogram"]["edges"], edges, rtol=1e-14)
    assert report["mean"] == pytest.approx(values.mean(), rel=1e-13)
    assert report["deviation"] == pytest.approx(values.std(), rel=1e-13)
    assert list(report["percentiles"].values()) == np.percentile(values, [1, 5, 25, 50, 75, 95, 99]).tolist()
    bytes_ = np.random.default_rng(1).integers(0, 256, 5000).astype(np.uint8)
    assert info._statistics(bytes_, 7)["histogram"]["counts"] == np.histogram(bytes_, 7)[0].tolist()
    # Of every third sample only, and so a little off.
    monkeypatch.setattr(info, "_ENOUGH", 5000)
    found = np.array(info._percentiles(values))
    assert 0 < np.abs(found - np.percentile(values, info._PERCENTILES)).max() < 0.3


def test_info_needs_no_copies_of_the_volume(tmp_path):
    import tracemalloc

    np.save(tmp_path / "a.npy", np.zeros((256, 128, 128), np.float32))
    tracemalloc.start()
    try:
        run("info", tmp_path / "a.npy")
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    # The volume has 16.8 MB; the sample for percentiles, 4 M values of 8 bytes, and blocks come on top.
    assert peak < 150e6


def test_stray_errors_are_one_line(monkeypatch, volume):
    def fail(*_, **__):
        raise KeyError("lost\nand gone")

    monkeypatch.setattr(info, "survey", fail)
    stderr = run("info", volume, code=1).stderr
    assert stderr.count("\n") == 1 and "lost" in stderr and "Traceback" not in stderr
    assert "Traceback" in run("info", volume, "-vv", code=1).stderr


def interrupted_import(folder, where, *command):
    """Run a command with Ctrl-C at the import of a module."""
    (folder / "sitecustomize.py").write_text(
        "import sys\n"
        "class Finder:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        f"        if name == {where!r}: raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Finder())\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    return subprocess.run([sys.executable, *command], env=environment, capture_output=True, text=True)


@pytest.mark.parametrize("where", ["logging", "click", "numpy", "sheetsplat.cli.main", "sheetsplat.scene"])
def test_ctrl_c_while_modules_are_read(tmp_path, where):
    done = interrupted_import(tmp_path, where, "-m", "sheetsplat", "info", "none.npy")
    # Once click runs, it ends the line of ^C first.
    assert done.returncode in (1, 130, -2) and done.stderr.lstrip("\n") == "Aborted!\n", done.stderr


def test_a_program_of_the_same_name_keeps_its_traceback(tmp_path):
    """Only the installed command answers Ctrl-C during the import."""
    program = tmp_path / "sheetsplat"
    program.write_text("import sheetsplat\nsheetsplat.Scene\n")
    done = interrupted_import(tmp_path, "numpy", str(program))
    assert done.stderr.startswith("Traceback") and "Aborted" not in done.stderr, done.stderr


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
def test_fields_without_a_kernel_give_empty_pictures(tmp_path, projection):
    holes = np.full((3, 3, 3), np.nan)
    with pytest.warns(ss.PictureWarning, match="nothing can be seen"):
        picture = ss.render(holes, nan="skip", projection=projection, **SMALL)
    assert not picture.rgba.any()
    nothing = ss.RegularField(holes, nan="skip")
    assert not ss.render([nothing, nothing], mode="xray", **SMALL).scalar.any()
    np.save(tmp_path / "a.npy", holes)
    options = ["--nan", "skip", "--backend", "reference", "--size", "8", "--projection", projection]
    stderr = run("render", tmp_path / "a.npy", "-o", tmp_path / "a.png", *options).stderr
    assert "nothing can be seen" in stderr
    assert not pictures.read_picture(tmp_path / "a.png").any()
    assert "size" in run("plan", tmp_path / "a.npy", *options).stdout
    # A single kernel has a bounding box.
    far = ss.RegularField(np.ones((1, 1, 1)), origin=(100, 0, 0))
    assert ss.Scene([nothing, far], POINTS).bounds == far.bounds
    assert compose_camera([nothing, far], (8, 8)).target[0] == pytest.approx(100)


def test_a_late_failure_leaves_no_file(tmp_path, volume, monkeypatch):
    def fail(*_):
        raise ss.Error("no space left")

    options = ["-o", tmp_path / "a.png", "--coverage", tmp_path / "c.npy", "--backend", "reference", "--size", "8"]
    monkeypatch.setattr(pictures, "save_channel", fail)
    assert "no space" in run("render", volume, *options, code=1).stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ball.npy"]
    monkeypatch.undo()
    run("render", volume, *options)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "ball.npy", "c.npy"]


def test_outputs_do_not_take_each_others_place(tmp_path, volume):
    before = volume.read_bytes()
    run("render", volume, "-o", volume, code=2)
    run("render", volume, "-o", tmp_path / "a.npy", "--coverage", tmp_path / "." / "a.npy", code=2)
    (tmp_path / "link.npy").symlink_to(volume)
    run("render", volume, "-o", tmp_path / "link.npy", code=2)
    np.save(tmp_path / "p.npy", np.zeros((8, 8)))
    run("compare", tmp_path / "p.npy", tmp_path / "p.npy", "--difference", tmp_path / "p.npy", code=2)
    assert volume.read_bytes() == before and not (tmp_path / "a.npy").exists()


@pytest.mark.parametrize(
    "options",
    [
        "--size 0x0",
        "--size 99999999999",
        "--size 1x-1",
        "--zoom 0",
        "--zoom nan",
        "--opacity-stop 2",
        "--opacity-stop 0",
        "--opacity 2",
        "--opacity 1:2",
        "--clim 5,1",
        "--clim nan,1",
        "--spacing 0,1,1",
        "--origin inf,0,0",
        "--radius -1",
        "--falloff 0",
        "--fov 180",
        "--margin 0",
        "--azimuth inf",
        "--direction 0,0,0",
        "--device -1",
        "--effect nope=on",
        "--effect weight=on --effect weight=off",
    ],
)
def test_options_out_of_range_are_wrong_usage(tmp_path, volume, options):
    picture = tmp_path / "a.png"
    backend = [] if "--size" in options else ["--size", "8"]
    stderr = run("render", volume, "-o", picture, "--backend", "reference", *backend, *options.split(), code=2).stderr
    assert "Usage" in stderr and not picture.exists()


def test_edges_of_ranges_are_allowed(tmp_path, volume):
    options = "--backend reference --size 4 --opacity-stop 1 --zoom 0.5 --effect weight=on --effect weight=on"
    run("render", volume, "-o", tmp_path / "a.png", *options.split())


@pytest.mark.timeout(20)
def test_iterators_without_an_end(field):
    for call in (
        lambda: _checks.triple("three", itertools.count()),
        lambda: ss.render(field, size=itertools.count(1)),
        lambda: ss.Scene(field, POINTS, lights=itertools.repeat(ss.Light())),
        lambda: ss.render(field, outputs=itertools.repeat("depth"), **SMALL),
        lambda: ss.open("a.raw", shape=itertools.count(1), dtype="uint8"),
    ):
        with pytest.raises(ss.InvalidInput):
            call()
    assert _checks.triple("three", iter((1, 2, 3))) == (1.0, 2.0, 3.0)


def test_arguments_of_other_types(tmp_path, field):
    picture = ss.render(field, **SMALL)
    flat = np.zeros((8, 8))
    renderer = ss.Renderer("reference")
    scene, camera = ss.Scene(field, POINTS), ss.Camera.fit(field)
    for call in (
        lambda: ss.Scene(field, POINTS, lights=None),
        lambda: ss.Scene(field, POINTS, preintegration="off"),
        lambda: ss.render(field, outputs=3, **SMALL),
        lambda: ss.render(field, outputs=None, **SMALL),
        lambda: renderer.render(scene, camera, (8, 8), outputs=None),
        lambda: renderer.plan(scene, camera, (8, 8), outputs=3),
        lambda: renderer.render(scene, camera, (True, True)),
        lambda: ss.Renderer(tile_size=-1),
        lambda: ss.Renderer(tags_per_clear=-1),
        lambda: ss.Renderer(tile_size=True),
        lambda: ss.Renderer(effects={"weight": "off"}),
        lambda: ss.Material(two_sided="no"),
        lambda: picture.save(None),
        lambda: picture.save(3),
        lambda: picture.save("a\0.png"),
        lambda: ss.open("a\0.npy"),
        lambda: compare("ab", "ab"),
        lambda: compare([[1.0], [1.0, 2.0]], [[1.0], [1.0, 2.0]]),
        lambda: compare(flat + 1j, flat + 1j),
        lambda: compare(None, flat),
    ):
        with pytest.raises(ss.InvalidInput):
            call()
    assert not renderer.render(scene, camera, (8, 8), outputs=("depth", "depth")).depth.shape[2:]


@pytest.mark.parametrize("direction", [(np.nan, 0, 1), (np.inf, 0, 1), (1e200, 0, 0), (0, 1e-200, 0), (0, 0, 0)])
def test_directions_without_a_length(field, direction):
    with pytest.raises(ss.InvalidInput):
        ss.Light(direction=direction)
    with pytest.raises(ss.InvalidInput):
        ss.render(field, direction=direction, **SMALL)
    with pytest.raises(ss.InvalidInput):
        ss.Camera.fit(field, up=direction)
    with pytest.raises(ss.InvalidInput):
        ss.Camera.orthographic((0, 0, 5), (0, 0, 0), up=direction, height=3)
    assert ss.Light(direction=(1e-100, 0, 1e100)).direction == (1e-100, 0, 1e100)


@pytest.mark.parametrize("strong", [2e30, -2e30, 1e300])
def test_strengths_beyond_float32(field, strong):
    for call in (
        lambda: ss.Light(color=(1, strong, 1)),
        lambda: ss.Material(ambient=strong),
        lambda: ss.Material(specular=strong),
        lambda: ss.Scene(field, POINTS, background=(strong, 0, 0)),
        lambda: ss.TransferFunction([(0, 1, 1, strong, 0.5)]),
    ):
        with pytest.raises(ss.InvalidInput, match="magnitude"):
            call()
    assert ss.TransferFunction([(abs(strong), 1, 1, 1e30, 0.5)]).v_min == abs(strong)


def test_flip_of_numbers_that_are_none(tmp_path):
    black, holed = np.zeros((8, 8, 4), np.float32), np.zeros((8, 8, 4), np.float32)
    holed[3, 3] = np.nan
    assert compare(holed, black)["flip"] == np.inf and compare(black, holed)["flip"] == np.inf
    assert compare(holed, holed)["flip"] == 0 and compare(black, black)["flip"] == 0
    bright = np.ones((8, 8, 4), np.float32)
    infinite = np.where(np.arange(8)[:, None, None] == 2, np.inf, bright).astype(np.float32)
    assert compare(infinite, bright)["flip"] == np.inf
    np.save(tmp_path / "a.npy", holed)
    np.save(tmp_path / "b.npy", black)
    assert "flip" in run("compare", tmp_path / "a.npy", tmp_path / "b.npy", "--max-flip", 1e9, code=1).stderr


def test_a_gzipped_file_is_still_read(tmp_path):
    (tmp_path / "a.raw.gz").write_bytes(gzip.compress(bytes(8)))
    assert ss.open(tmp_path / "a.raw.gz", shape=(2, 2, 2), dtype="uint8").size == 8
