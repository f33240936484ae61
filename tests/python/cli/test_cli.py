"""The command line: results on stdout, everything else on stderr, exit codes 0, 1 and 2."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from command_line import run

import sheetsplat as ss
from sheetsplat.device import Device
from sheetsplat.io.pictures import read_picture

BACKEND = ["--backend", "reference"]


def test_render_writes_a_picture_and_nothing_to_stdout(tmp_path, volume):
    result = run("render", volume, "-o", tmp_path / "a.png", "--size", "30x20", *BACKEND)
    assert result.stdout == "" and "a.png: 30 x 20 pixels by reference" in result.stderr
    assert read_picture(tmp_path / "a.png").shape == (20, 30, 4)
    assert run("render", volume, "-o", tmp_path / "b.png", "--size", "8x8", "-q", *BACKEND).stderr == ""
    assert "rendered 8 x 8" in run("render", volume, "-o", tmp_path / "b.png", "--size", "8x8", "-v", *BACKEND).stderr
    assert "opacity_stop" in run("render", volume, "-o", tmp_path / "b.png", "--size", "8x8", "-vv", *BACKEND).stderr


def test_render_gives_what_python_gives(tmp_path, volume, ball):
    options = [
        *("--size", "24x16", "--cmap", "magma", "--opacity", "20:0,150:0.4", "--clim", "10,180", "--azimuth", 40),
        *("--elevation", -10, "--zoom", 1.5, "--no-shading", "--background", "#ff8000", "--slice-spacing", 0.5),
        *(
            "--sampling",
            "slab",
            "--projection",
            "perspective",
            "--fov",
            40,
            "--opacity-stop",
            1,
            "--reference-length",
            2,
        ),
        *("--spacing", "1,2,1", "--radius", 1.8, "--falloff", 4, "--normalization", "threshold", "--margin", 1.2),
    ]
    run("render", volume, "-o", tmp_path / "a.npy", *options, *BACKEND)
    expected = ss.render(
        (ball * 200).astype(np.uint8),
        size=(24, 16),
        cmap="magma",
        opacity=[(20, 0), (150, 0.4)],
        clim=(10, 180),
        azimuth=40,
        elevation=-10,
        zoom=1.5,
        shading=False,
        background=(1, 128 / 255, 0),
        slice_spacing=0.5,
        sampling="slab",
        projection="perspective",
        fov_y=40,
        opacity_stop=1,
        reference_length=2,
        spacing=(1, 2, 1),
        radius=1.8,
        falloff=4,
        normalization="threshold",
        margin=1.2,
        backend="reference",
    )
    assert np.array_equal(read_picture(tmp_path / "a.npy"), expected.rgba)


@pytest.mark.parametrize(
    "options",
    [
        ["--mode", "xray"],
        ["--mode", "mip"],
        ["--mode", "isosurface"],
        ["--mode", "isosurface", "--iso", 90],
        ["--mode", "isosurface", "--iso", "60:0.3,90:1"],
        ["--mode", "average"],
        ["--direction", "-y", "--up", "z"],
        ["--direction", "1,2,-3"],
        ["--preintegration"],
        ["--second-order"],
        ["--gradient", "analytic"],
        ["--clip-plane", "0,0,1,3", "--clip-plane", "-1,0,0,-9"],
        ["--clip-box", "2,2,2,12,12,12"],
        ["--gradient-opacity", 5],
        ["--depth-cue", "auto", "--depth-cue-color", "white"],
        ["--shadows", "--ambient-occlusion", "3,0.5"],
        ["--opacity", 0.1],
        ["--opacity", "0,0.1,0.3"],
        ["--background", "white"],
        ["--background", "0.1,0.2,0.3"],
        ["--lattice", "bcc"],
        ["--effect", "culling=on"],
        ["--nan", "skip"],
        ["--origin", "5,5,5"],
    ],
)
def test_render_options_work(tmp_path, volume, options):
    run("render", volume, "-o", tmp_path / "a.npy", "--size", "12x12", *options, *BACKEND)
    assert read_picture(tmp_path / "a.npy").any()


def test_render_more_outputs_and_json(tmp_path, volume):
    extra = ["--depth", tmp_path / "d.exr", "--coverage", tmp_path / "c.npy"]
    result = run("render", volume, "-o", tmp_path / "a.exr", "--size", "12x12", *extra, "--json", *BACKEND)
    report = json.loads(result.stdout)
    assert report["output"].endswith("a.exr") and report["plan"]["size"] == [12, 12] and report["stats"]["slices"] > 0
    assert np.isinf(read_picture(tmp_path / "d.exr")[0, 0]) and read_picture(tmp_path / "c.npy").max() > 0


def test_raw_samples_have_their_shape_as_x_y_z(tmp_path):
    values = np.zeros((2, 3, 40), np.uint16)
    values[..., 20] = 500
    (tmp_path / "a.raw").write_bytes(b"12345" + values.astype(">u2").tobytes())
    raw = ["--shape", "40,3,2", "--dtype", ">u2", "--offset", 5]
    report = json.loads(run("info", tmp_path / "a.raw", "--json", *raw).stdout)
    assert report["samples"] == [40, 3, 2] and report["maximum"] == 500 and report["format"] == "raw"
    assert "40 x 3 x 2" in run("info", tmp_path / "a.raw", *raw).stdout
    run("render", tmp_path / "a.raw", "-o", tmp_path / "a.npy", "--size", "9x9", *raw, *BACKEND)
    assert "shape and dtype" in run("info", tmp_path / "a.raw", code=1).stderr


def test_plan_lists_effects_with_reasons(volume):
    result = run("plan", volume, "--size", "30x20", "--no-shading", *BACKEND)
    assert "reference" in result.stdout and "there are no lights" in result.stdout and result.stderr == ""
    report = json.loads(run("plan", volume, "--json", "--effect", "weight=on", "--backend", "cpu").stdout)
    assert next(effect for effect in report["effects"] if effect["name"] == "weight")["forced"]


def test_info_tells_what_is_there(tmp_path, volume, ball):
    result = run("info", volume)
    assert "18 x 16 x 14" in result.stdout and "uint8" in result.stdout and result.stderr == ""
    report = json.loads(run("info", volume, "--json", "--bins", 8).stdout)
    assert report["memory_bytes"] == ball.size and sum(report["histogram"]["counts"]) == ball.size
    assert len(report["histogram"]["counts"]) == 8
    holed = np.array(ball)
    holed[0, 0, 0], holed[0, 0, 1] = np.nan, np.inf
    np.save(tmp_path / "b.npy", holed)
    report = json.loads(run("info", tmp_path / "b.npy", "--json").stdout)
    assert (report["nan"], report["infinite"]) == (1, 1)
    assert "1 NaN, 1 infinite" in run("info", tmp_path / "b.npy").stdout
    np.save(tmp_path / "c.npy", np.full((2, 2, 2), np.nan))
    assert "8 NaN" in run("info", tmp_path / "c.npy").stdout
    sheared = run("info", volume, "--axes", "2,0,0,1,1,0,0,0,3").stdout
    assert "2, 1.41421, 3" in sheared and "45.0, 90.0, 90.0 degrees between i and j" in sheared


def test_devices():
    assert "reference" in run("devices").stdout
    assert {"reference", "gl"} <= {device["backend"] for device in json.loads(run("devices", "--json").stdout)}


def test_devices_tell_of_a_backend_that_is_not_there(monkeypatch):
    for fine in ("", "auto", "reference"):
        monkeypatch.setenv("SHEETSPLAT_BACKEND", fine)
        assert "SHEETSPLAT_BACKEND" not in run("devices").stderr
    monkeypatch.setenv("SHEETSPLAT_BACKEND", "warp")
    result = run("devices", "--json")
    assert "SHEETSPLAT_BACKEND is 'warp'" in result.stderr and json.loads(result.stdout)
    monkeypatch.setenv("SHEETSPLAT_BACKEND", "gl")
    monkeypatch.setattr("sheetsplat.cli.devices.devices", lambda: [Device("gl", "egl", False, "no library", (), ())])
    assert "not available here" in run("devices").stderr


def test_compare_and_its_bounds(tmp_path):
    picture = np.random.default_rng(0).random((20, 30, 4)).astype(np.float32)
    np.save(tmp_path / "a.npy", picture)
    np.save(tmp_path / "b.npy", picture + np.float32(0.01))
    report = json.loads(run("compare", tmp_path / "a.npy", tmp_path / "b.npy", "--json").stdout)
    assert np.isclose(report["rmse"], 0.01, rtol=1e-3) and np.isclose(report["maximum"], 0.01, rtol=1e-3)
    assert report["flip"] > 0
    for option in ("--max-rmse", "--max-p999", "--max"):
        run("compare", tmp_path / "a.npy", tmp_path / "b.npy", option, 0.011)
        result = run("compare", tmp_path / "a.npy", tmp_path / "b.npy", option, 0.009, code=1)
        assert "above" in result.stdout and "more than allowed" in result.stderr
    run("compare", tmp_path / "a.npy", tmp_path / "b.npy", "--max-flip", 0, code=1)
    run("compare", tmp_path / "a.npy", tmp_path / "a.npy", "--max", 0, "--max-flip", 0)
    run("compare", tmp_path / "a.npy", tmp_path / "b.npy", "--difference", tmp_path / "d.png")
    assert (tmp_path / "d.png").exists()
    np.save(tmp_path / "c.npy", picture[:10])
    assert "shape" in run("compare", tmp_path / "a.npy", tmp_path / "c.npy", code=1).stderr
    np.save(tmp_path / "n.npy", np.where(picture > 0.999, np.nan, picture).astype(np.float32))
    run("compare", tmp_path / "n.npy", tmp_path / "a.npy", "--max", 1, code=1)
    assert "no such file" in run("compare", tmp_path / "a.npy", tmp_path / "gone.npy", code=1).stderr


def test_compare_of_scalars_is_relative_to_the_largest(tmp_path):
    reference = np.linspace(0, 50, 400, dtype=np.float32).reshape(20, 20)
    np.save(tmp_path / "a.npy", reference + 1)
    np.save(tmp_path / "b.npy", reference)
    report = json.loads(run("compare", tmp_path / "a.npy", tmp_path / "b.npy", "--json").stdout)
    assert np.isclose(report["rmse"], 1 / 50, rtol=1e-3)


def test_demo_says_where_the_picture_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run("demo", "--size", "24x24", "--dataset", "marschner_lobb", *BACKEND)
    assert result.stdout.strip() == str(tmp_path / "sheetsplat-demo.png")
    assert read_picture(tmp_path / "sheetsplat-demo.png").any()


def test_demo_renders_in_a_quality(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    pictures = {}
    for quality, wanted in ((), "good"), (("--quality", "draft"), "draft"):
        report = json.loads(run("demo", "--size", "24x24", *quality, *BACKEND, "--json").stdout)
        assert report["plan"]["quality"]["name"] == wanted
        pictures[wanted] = read_picture(tmp_path / "sheetsplat-demo.png")
    assert (pictures["good"] != pictures["draft"]).any()


def test_demo_has_a_colour_bar_where_matplotlib_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for dataset in ("marschner_lobb", "noisy_ball", "tubes"):
        run("demo", "--size", "60x50", "--quality", "draft", "--dataset", dataset, "--backend", "cpu", "-o", "a.png")
        height, width, _ = read_picture(tmp_path / "a.png").shape
        assert width > 80 and height >= 50 and ss.Recipe.read("a.png").size == (60, 50)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    stderr = run("demo", "--size", "60x50", "--quality", "draft", "--backend", "cpu", "-o", "b.png").stderr
    assert "no colour bar: pip install" in stderr and read_picture(tmp_path / "b.png").shape == (50, 60, 4)


def test_figures_beside_pictures(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.save("a.npy", np.random.default_rng(1).random((6, 7, 8)).astype(np.float32))
    command = ["render", "a.npy", "-o", "a.png", "--size", "60x50", "--quality", "draft", *BACKEND]
    look = ["--title", "A title", "--label", "of it", "--font", "DejaVu Serif", "--font-size", "7", "--no-figure-axes"]
    report = json.loads(run(*command, "--figure", "a.svg", *look, "--json").stdout)
    text = Path("a.svg").read_text(encoding="utf-8")
    assert report["figure"] == "a.svg" and ">A title<" in text and ">of it<" in text and "world units" not in text
    assert read_picture(Path("a.png")).shape == (50, 60, 4)
    run("demo", "--size", "60x50", "--quality", "draft", "--dataset", "marschner_lobb", *BACKEND, "-o", "b.pdf")
    assert Path("b.pdf").read_bytes()[:5] == b"%PDF-"
    for wrong, told in (
        (["--font-size", "7"], "--font-size is of --figure, which is missing"),
        (["--no-figure-axes"], "--figure-axes is of --figure"),
        (["--figure", "c.eps"], "ends with"),
        (["--figure", "a.png"], "named twice"),
    ):
        assert told in run(*command, *wrong, code=2).stderr, wrong
    for wrong in (["--font", "no such"], ["--label", "a", "--label", "b"], ["--title", "$\\frac{$"]):
        assert f"{wrong[0]} cannot be used" in run(*command, "--figure", "c.pdf", *wrong, code=1).stderr
    assert not Path("c.pdf").exists()
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert "sheetsplat[plot]" in run(*command, "--figure", "c.pdf", code=1).stderr


def test_demo_looks_at_the_backend_before_it_makes_data(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    small = ["--size", "16x16", "--dataset", "marschner_lobb"]
    report = json.loads(run("demo", *small, "--backend", "cpu", "--threads", 1, "--json").stdout)
    assert "1 thread" in report["plan"]["device"]
    monkeypatch.setenv("SHEETSPLAT_BACKEND", "warp")
    stderr = run("demo", *small, code=1).stderr
    assert "SHEETSPLAT_BACKEND" in stderr and "making" not in stderr


@pytest.mark.parametrize(
    "arguments",
    [
        ["nothing"],
        ["render"],
        ["render", "VOLUME"],
        ["render", "VOLUME", "-o", "a.gif"],
        ["render", "VOLUME", "-o", "a.png", "--nothing"],
        ["render", "VOLUME", "-o", "a.png", "--size", "10,10,10"],
        ["render", "VOLUME", "-o", "a.png", "--size", "10x10x10"],
        ["render", "VOLUME", "-o", "a.png", "--size", "axb"],
        ["render", "VOLUME", "-o", "a.png", "--mode", "minip"],
        ["render", "VOLUME", "-o", "a.png", "--backend", "warp"],
        ["render", "VOLUME", "-o", "a.png", "--opacity", "a"],
        ["render", "VOLUME", "-o", "a.png", "--opacity", "1:2:3"],
        ["render", "VOLUME", "-o", "a.png", "--background", "colour"],
        ["render", "VOLUME", "-o", "a.png", "--background", "1,2"],
        ["render", "VOLUME", "-o", "a.png", "--direction", "w"],
        ["render", "VOLUME", "-o", "a.png", "--effect", "culling"],
        ["render", "VOLUME", "-o", "a.png", "--effect", "culling=perhaps"],
        ["render", "VOLUME", "-o", "a.png", "--size", "0x10"],
        ["render", "VOLUME", "-o", "a.png", "--clim", "5,1"],
        ["render", "VOLUME", "-o", "a.png", "--slice-spacing", "0"],
        ["render", "VOLUME", "-o", "a.png", "--spacing", "0,1,1"],
        ["render", "VOLUME", "-o", "a.png", "--zoom", "0"],
        ["render", "VOLUME", "-o", "a.png", "--effect", "bloom=on"],
        ["render", "VOLUME", "-o", "a.png", "--cmap", "nothing"],
        ["render", "VOLUME", "-o", "a.png", "--up", "z", "--direction", "z"],
        ["render", "VOLUME", "-o", "a.png", "--clip-plane", "0,0,0,1"],
        ["render", "VOLUME", "-o", "a.png", "--clip-box", "5,5,5,1,1,1"],
        ["render", "VOLUME", "-o", "a.png", "--shadows", "--gradient-opacity", "0.1"],
        ["plan", "VOLUME", "--shadows", "--gradient-opacity", "0.1"],
        ["render", "VOLUME", "-o", "a.png", "--mode", "xray", "--log-scale", "--clim", "0,1"],
        ["plan"],
        ["info"],
        ["compare", "a.png"],
        ["demo", "--dataset", "teapot"],
    ],
)
def test_wrong_usage_is_code_2(tmp_path, monkeypatch, volume, arguments):
    monkeypatch.chdir(tmp_path)
    result = run(*(str(volume) if argument == "VOLUME" else argument for argument in arguments), code=2)
    assert "Usage" in result.stderr and result.stdout == ""
    assert not (tmp_path / "a.png").exists()


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["render", "gone.npy", "-o", "a.png"], "no such file"),
        (["render", "VOLUME", "-o", "gone/a.png"], "no folder"),
        (["render", "VOLUME", "-o", "a.png", "--size", "100000x100000"], "memory"),
        (["render", "VOLUME", "-o", "a.png", "--slice-spacing", "1e-9"], "slices"),
        (["render", "VOLUME", "-o", "a.png", "--shape", "1,2,3"], "raw"),
        (["info", "gone.npy"], "no such file"),
        (["plan", "gone.npy"], "no such file"),
    ],
)
def test_failures_are_code_1_with_one_message(tmp_path, monkeypatch, volume, arguments, text):
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.iterdir())
    arguments = [str(volume) if argument == "VOLUME" else argument for argument in arguments]
    result = run(*arguments, *(BACKEND if arguments[0] == "render" else []), code=1)
    lines = result.stderr.splitlines()
    assert result.stdout == "" and len(lines) == 1 and lines[0].startswith("sheetsplat: ")
    import re

    assert re.search(text, lines[0])
    assert sorted(tmp_path.iterdir()) == before


def test_as_a_program(tmp_path, volume):
    command = [sys.executable, "-m", "sheetsplat"]
    helped = subprocess.run([*command, "--help"], capture_output=True, text=True)
    assert helped.returncode == 0 and "compare" in helped.stdout and helped.stderr == ""
    assert ss.__version__ in subprocess.run([*command, "--version"], capture_output=True, text=True).stdout
    made = subprocess.run(
        [*command, "render", volume, "-o", "a.png", "--size", "8x8", *BACKEND],
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert made.returncode == 0 and made.stdout == "" and "a.png" in made.stderr and (tmp_path / "a.png").exists()
    failed = subprocess.run([*command, "info", "gone"], capture_output=True, text=True, cwd=tmp_path)
    assert failed.returncode == 1 and failed.stdout == "" and failed.stderr.count("\n") == 1
    assert "Traceback" not in failed.stderr


def test_a_bar_only_on_a_terminal(tmp_path, volume):
    command = [sys.executable, "-m", "sheetsplat", "render", str(volume), "-o", "a.png", "--slice-spacing", "0.05"]
    command += ["--size", "40x40", *BACKEND]
    plain = subprocess.run(command, capture_output=True, cwd=tmp_path)
    assert b"\x1b[" not in plain.stderr
    controller, terminal = pty.openpty()
    with subprocess.Popen(command, stderr=terminal, stdout=subprocess.PIPE, cwd=tmp_path) as process:
        os.close(terminal)
        seen = b""
        try:
            while piece := os.read(controller, 4096):
                seen += piece
        except OSError:
            pass
        out = process.stdout.read()
    os.close(controller)
    assert process.returncode == 0 and out == b"" and b"\x1b[" in seen and b"ball.npy" in seen


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_leaves_nothing_half_written(tmp_path, volume):
    command = [sys.executable, "-m", "sheetsplat", "render", str(volume), "-o", "a.png", "-v", "--size", "600x600"]
    command += ["--slice-spacing", "0.001", "--mode", "isosurface", *BACKEND]
    with subprocess.Popen(command, stderr=subprocess.PIPE, cwd=tmp_path) as process:
        try:
            assert process.stderr is not None
            process.stderr.readline()  # what surface is shown: said right before drawing begins
            time.sleep(0.5)
            assert process.poll() is None
            process.send_signal(signal.SIGINT)
            process.wait(timeout=60)
        finally:
            process.kill()
    assert process.returncode == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ball.npy"]
