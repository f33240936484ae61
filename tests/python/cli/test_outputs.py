"""Where pictures go, and standard streams that are closed or full: what is written is whole, or there is an error."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat.io import pictures

COMMAND = [sys.executable, "-m", "sheetsplat", "render", "v.npy", "-o", "a.png", "--size", "16", "--backend", "cpu"]


@pytest.fixture(autouse=True)
def _in_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("v.npy", np.random.default_rng(3).random((6, 6, 6)))


@pytest.fixture(scope="module")
def image() -> ss.Image:
    return ss.render(np.random.default_rng(4).random((6, 6, 6)), size=16, backend="cpu")


def shell(redirected: str, command: list[str] = COMMAND) -> subprocess.CompletedProcess[str]:
    words = ["sh", "-c", f'exec "$@" {redirected}', "sh", *command]
    return subprocess.run(words, capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.parametrize("redirected", ["2>&-", "2>/dev/full", ">&-", "<&- >&- 2>&-"])
def test_messages_that_cannot_be_written_cost_no_picture(redirected: str) -> None:
    assert shell(redirected).returncode == 0
    assert pictures.read_picture(Path("a.png")).shape == (16, 16, 4)


@pytest.mark.parametrize("arguments", [["render", "--help"], ["--help"], ["info", "v.npy"], [*COMMAND[3:], "--json"]])
def test_reports_that_cannot_be_written_are_an_error(arguments: list[str]) -> None:
    done = shell(">/dev/full", [*COMMAND[:3], *arguments])
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert last == "sheetsplat: stdout cannot be written: No space left on device"
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_terminated_command_leaves_no_file(number: signal.Signals) -> None:
    # Jobs in the background may ignore SIGHUP, and so would theirs.
    command = [
        "env",
        "--default-signal=HUP",
        *COMMAND,
        "--size",
        "900",
        "--slice-spacing",
        "0.001",
        "--mode",
        "isosurface",
    ]
    with subprocess.Popen(command, stderr=subprocess.PIPE) as process:
        assert process.stderr is not None
        process.stderr.readline()  # what surface is shown: said right before drawing begins
        time.sleep(0.3)
        process.send_signal(number)
        process.wait(timeout=60)
    assert process.returncode == 128 + number
    assert os.listdir() == ["v.npy"]


@pytest.mark.parametrize("suffix", pictures.SUFFIXES)
@pytest.mark.parametrize("stem", [b"\xff", b"n" * 250, "µ Ω".encode()], ids=["not UTF-8", "long", "UTF-8"])
def test_every_name_that_the_system_takes(image: ss.Image, stem: bytes, suffix: str) -> None:
    name = os.fsdecode(stem[: 255 - len(suffix)]) + suffix
    try:
        Path(name).touch()
        Path(name).unlink()
    except OSError as error:
        pytest.skip(f"this system takes no such name: {error.strerror}")
    if suffix == ".exr":
        pytest.importorskip("OpenEXR")
    if suffix == ".fits":
        # Of numbers alone.
        pytest.importorskip("astropy", reason="astropy is not installed")
        image = ss.render(np.ones((4, 4, 4)), mode="xray", size=(8, 6), backend="cpu")
    image.save(name)
    assert sorted(os.listdir()) == sorted([name, "v.npy"])
    if suffix in (".png", ".exr", ".npy"):
        np.testing.assert_allclose(pictures.read_picture(Path(name)), image.rgba, atol=0.02)
    with pytest.raises(ss.InvalidInput, match="no such file"):
        ss.open(name[:240] + "missing.npy")


def test_a_symbolic_link_stays(image: ss.Image, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    Path("a.png").symlink_to("folder/real.png")
    image.save("a.png")
    image.save("a.png")
    assert Path("a.png").is_symlink()
    assert sorted(os.listdir("folder")) == ["real.png"]
    Path("loop.png").symlink_to("loop.png")
    with pytest.raises(ss.Error, match=r"loop\.png cannot be written"):
        image.save("loop.png")


@pytest.mark.parametrize("suffix", [".png", ".npy"])
def test_only_files_are_replaced(image: ss.Image, suffix: str) -> None:
    os.mkfifo("pipe" + suffix)
    Path("device" + suffix).symlink_to("/dev/null")
    Path("folder" + suffix).mkdir()
    for name in ("pipe", "device", "folder"):
        with pytest.raises(ss.Error, match=f"{name}{suffix} cannot be written: found a"):
            image.save(name + suffix)
    assert Path("pipe" + suffix).is_fifo()
    assert len(os.listdir()) == 4
