"""Errors carry fields, and each front end spells the options in them."""

from __future__ import annotations

import copy
import importlib
import os
import pickle
import signal
import stat
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import sheetsplat as ss
from sheetsplat.cli import main, wording
from sheetsplat.errors import OptionRef, Words, complain, option_ref, spelled_in_python

VALUES = np.linspace(0, 1, 27).reshape(3, 3, 3)
FIELD = ss.RegularField(VALUES)
RAMP = ss.TransferFunction([(0, 0, 0, 0, 0), (1, 1, 1, 1, 1)])
KINDS = (ss.Error, ss.InvalidInput, ss.DeviceUnavailable, ss.OutOfMemory, ss.Unsupported, ss.Cancelled)


@pytest.mark.parametrize(
    ("option", "spelled"),
    [
        (OptionRef("max_error"), "max_error"),
        (OptionRef("allow_inexact", "true"), "allow_inexact=True"),
        (OptionRef("prefilter", "false"), "prefilter=False"),
        (OptionRef("filter", "none"), "filter=None"),
        (OptionRef("nan", "skip"), 'nan="skip"'),
        (OptionRef("max_error", "1e-3"), "max_error=1e-3"),
        (OptionRef("neighbors", "32"), "neighbors=32"),
        (OptionRef("scalar", "..."), "scalar=..."),
    ],
)
def test_python_spells_options_as_keyword_arguments(option: OptionRef, spelled: str) -> None:
    assert spelled_in_python(option) == spelled


def test_words_are_joined_piece_by_piece() -> None:
    words = "use " + option_ref("nan", "skip") + " or " + option_ref("w0")
    assert words.text() == 'use nan="skip" or w0'
    assert words.text(lambda option: f"<{option.name}>") == "use <nan> or <w0>"
    assert not Words.of("")
    assert Words.of(words) is words


@pytest.mark.parametrize("kind", KINDS)
def test_fields_and_text(kind: type[ss.Error]) -> None:
    advice = "pass " + option_ref("nan", "skip")
    error = complain("it failed", "3", "4", advice, option="nan", kind=kind)
    assert type(error) is kind
    assert (error.what, error.found, error.wanted, error.advice) == ("it failed", "3", "4", 'pass nan="skip"')
    assert error.option == "nan"
    assert str(error) == 'it failed: found 3; wanted 4; pass nan="skip"'
    assert error.complaint.text(lambda option: f"--{option.name} {option.value}").endswith("; pass --nan skip")


def test_empty_fields_are_left_out() -> None:
    assert str(complain("it failed")) == "it failed"
    assert str(complain("it failed", wanted="4")) == "it failed: wanted 4"
    assert str(complain("", "3", "4")) == "found 3; wanted 4"
    assert complain("it failed").option is None


def test_option_is_the_only_one_that_failed() -> None:
    assert complain(option_ref("w0") + " cannot be used", advice=option_ref("nan")).option == "w0"
    assert complain(option_ref("w0") + " and " + option_ref("nan") + " do not go together").option is None


def test_texts_are_bounded() -> None:
    assert len(str(complain("it failed", "x" * 10**6))) < 2000


@pytest.mark.parametrize("kind", KINDS)
def test_errors_cross_processes(kind: type[ss.Error]) -> None:
    error = complain("it failed", "3", "4", "pass " + option_ref("nan", "skip"), option="nan", kind=kind)
    for other in (pickle.loads(pickle.dumps(error)), copy.deepcopy(error)):
        assert type(other) is kind
        assert other.complaint == error.complaint
        assert str(other) == str(error)


def test_errors_of_the_native_half_have_fields() -> None:
    with pytest.raises(ss.InvalidInput) as raised:
        ss.RegularField(np.full((2, 2, 2), np.nan))
    error = raised.value
    assert error.what == "RegularField: the samples cannot be used"
    assert error.found == "NaN at sample [0, 0, 0]"
    assert error.wanted == "finite numbers"
    assert pickle.loads(pickle.dumps(error)).complaint == error.complaint
    assert isinstance(error, ValueError)


# Calls that fail, and the option that each is about; None: no single one.
BAD_CALLS: list[tuple[Callable[[], object], str | None]] = [
    (lambda: ss.RegularField(np.zeros((2, 2))), None),
    (lambda: ss.RegularField(np.full((2, 2, 2), np.nan)), None),
    (lambda: ss.RegularField(VALUES, spacing=(1, 1)), "spacing"),
    (lambda: ss.RegularField(VALUES, spacing=(1, 1, 0)), "spacing"),
    (lambda: ss.RegularField(VALUES, origin="here"), "origin"),
    (lambda: ss.RegularField(VALUES, radius=-1), "radius"),
    (lambda: ss.RegularField(VALUES, falloff=np.inf), "falloff"),
    (lambda: ss.RegularField(VALUES, w0=0, normalization="threshold"), "w0"),
    (lambda: ss.RegularField(VALUES, nan="zero"), "nan"),
    (lambda: ss.RegularField(VALUES, prefilter=True, normalization="threshold"), "prefilter"),
    (lambda: ss.EllipsoidField([(0, 0, 0)], [1.0]), "values"),
    (lambda: ss.EllipsoidField([(0, 0, 0)], [1.0], values=[1.0, 2.0]), None),
    (lambda: ss.EllipsoidField([(0, 0, 0)], [1.0], values=[1.0], min_scale=-1), "min_scale"),
    (lambda: ss.EllipsoidField([(0, 0, 0)], [1.0], values=[1.0], normalization="lattice"), "normalization"),
    (lambda: ss.EllipsoidField([(0, 0, 0)], [0.0], values=[1.0]), None),
    (lambda: ss.TransferFunction([]), None),
    (lambda: ss.TransferFunction([(0, 0, 0, 0, 2)]), None),
    (lambda: ss.Light((0, 0, 0)), "direction"),
    (lambda: ss.Material(ambient="much"), "ambient"),
    (lambda: ss.Clip(box=((1, 1, 1), (0, 0, 0))), "box"),
    (lambda: ss.DepthCue(2, 1), None),
    (lambda: ss.Scene(FIELD, RAMP, slice_spacing=0), "slice_spacing"),
    (lambda: ss.Scene(FIELD, RAMP, mode="minip"), "mode"),
    (lambda: ss.Scene(FIELD, RAMP, mode="isosurface"), "mode"),
    (lambda: ss.Scene(FIELD, RAMP, opacity_stop=2), "opacity_stop"),
    (lambda: ss.Scene(FIELD, RAMP, mode="xray", shadows=True), None),
    (lambda: ss.Camera.orthographic((0, 0, 0), (0, 0, 0), height=1), None),
    (lambda: ss.Camera.orthographic((0, 0, 1), (0, 0, 0), height=0), "height"),
    (lambda: ss.Camera.perspective((0, 0, 1), (0, 0, 0), fov_y=180), "fov_y"),
    (lambda: ss.Camera.fit(FIELD, margin=0), "margin"),
    (lambda: ss.Renderer("warp"), "backend"),
    (lambda: ss.Renderer(threads=0), "threads"),
    (lambda: ss.Renderer(max_error=0), "max_error"),
    (lambda: ss.Renderer(max_seconds=-1), "max_seconds"),
    (lambda: ss.render(VALUES, size=(0, 4)), "size"),
    (lambda: ss.render(VALUES, zoom=0), "zoom"),
    (lambda: ss.render(VALUES, backend="cpu", effects={"bloom": True}, size=(4, 4)), "effects"),
    (lambda: ss.render(VALUES, backend="cpu", effects={"isosurface": True}, size=(4, 4)), "effects"),
    (lambda: ss.render(VALUES, backend="cpu", tagging="depth_equal", size=(4, 4)), "tagging"),
    (lambda: ss.render(VALUES, backend="cpu", packing="paper", size=(4, 4)), "packing"),
    (lambda: ss.render(VALUES, backend="cpu", precision="uint8", size=(4, 4)), "precision"),
    (lambda: ss.render(VALUES, backend="reference", precision="float32", size=(4, 4)), "precision"),
    (lambda: ss.render(VALUES, backend="reference", slice_spacing=1e-12, size=(4, 4)), "slice_spacing"),
    (lambda: ss.render(VALUES, backend="reference", max_error=1e-9, size=(4, 4)), "max_error"),
    (lambda: ss.open("/nowhere/at/all.npy"), None),
]


@pytest.mark.parametrize(("call", "option"), BAD_CALLS)
def test_every_error_has_fields(call: Callable[[], object], option: str | None) -> None:
    with pytest.raises(ss.Error) as raised:
        call()
    error = raised.value
    assert error.what
    assert error.found or error.wanted
    assert error.option == option, str(error)
    assert str(error) == error.complaint.text()
    assert pickle.loads(pickle.dumps(error)).complaint == error.complaint


def test_the_command_line_spells_its_own_options(tmp_path: Path) -> None:
    command = importlib.import_module("sheetsplat.cli.render").command

    def spelled(name: str, value: str = "") -> str:
        return wording.spelled(OptionRef(name, value), command)

    assert spelled("allow_inexact", "true") == "--allow-inexact"
    assert spelled("prefilter", "true") == "--prefilter"
    assert spelled("shading", "false") == "--no-shading"
    assert spelled("nan", "skip") == "--nan skip"
    assert spelled("max_error") == "--max-error"
    assert spelled("iso_value", "...").startswith("--iso ")
    assert spelled("effects") == "--effect"
    assert spelled("log", "...").startswith("--log-floor ")
    assert spelled("preintegration", "second_order") == "--second-order"
    # No option of this command.
    assert spelled("cell_volume", "2") == "cell_volume=2"
    assert wording.spelled(OptionRef("nan", "skip"), None) == 'nan="skip"'
    np.save(tmp_path / "holes.npy", np.full((2, 2, 2), np.nan))
    result = CliRunner().invoke(main, ["render", str(tmp_path / "holes.npy"), "-o", str(tmp_path / "a.png")])
    assert result.exit_code == 1
    assert "pass --nan skip to leave such samples out" in result.stderr


def process(code: str, *arguments: str) -> str:
    """Return what a process of Python prints."""
    return subprocess.run([sys.executable, "-c", code, *arguments], check=True, capture_output=True, text=True).stdout


@pytest.mark.parametrize("program", ["-c", "sheetsplat", "/usr/bin/sheetsplat"])
def test_importing_leaves_the_process_as_it_was(program: str) -> None:
    code = (
        "import importlib, os, pkgutil, signal, sys, locale, threading\n"
        f"sys.argv[0] = {program!r}\n"
        "def state():\n"
        "    mask = os.umask(0); os.umask(mask)\n"
        "    handlers = [signal.getsignal(one) for one in signal.valid_signals()]\n"
        "    return (sys.excepthook, threading.excepthook, mask, handlers, dict(os.environ), os.getcwd(),\n"
        "            locale.setlocale(locale.LC_ALL), sys.getrecursionlimit(), sys.getswitchinterval())\n"
        "before = state()\n"
        "import sheetsplat\n"
        "for one in pkgutil.walk_packages(sheetsplat.__path__, 'sheetsplat.'):\n"
        "    if not one.name.endswith('__main__') and '.integrations.' not in one.name:\n"
        "        importlib.import_module(one.name)\n"
        "after = state()\n"
        "print(before == after or [pair for pair in zip(before, after) if pair[0] != pair[1]])\n"
    )
    assert process(code) == "True\n"


def test_drawing_and_saving_leave_the_process_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> int:
        raise AssertionError("the process was changed")

    image = ss.render(VALUES, size=(4, 4), backend="reference")
    monkeypatch.setattr(os, "umask", refuse)
    monkeypatch.setattr(signal, "signal", refuse)
    before = dict(os.environ)
    ss.render(VALUES, size=(4, 4), backend="cpu")
    for suffix in (".png", ".npy", ".exr"):
        image.save(tmp_path / f"a{suffix}")
    assert dict(os.environ) == before


@pytest.mark.parametrize("mask", [0o022, 0o077, 0o002])
def test_files_have_the_rights_of_any_new_file(tmp_path: Path, mask: int) -> None:
    code = (
        "import os, sys, numpy, pathlib\n"
        "from sheetsplat.io import pictures\n"
        f"os.umask({mask})\n"
        "pictures.save_array(numpy.zeros((2, 2), 'f4'), pathlib.Path(sys.argv[1]) / 'a.npy')\n"
    )
    process(code, str(tmp_path))
    assert stat.S_IMODE((tmp_path / "a.npy").stat().st_mode) == 0o666 & ~mask
    assert [path.name for path in tmp_path.iterdir()] == ["a.npy"]


@pytest.mark.parametrize(("module", "package", "name"), [("nrrd", "pynrrd", "a.nrrd"), ("h5py", "h5py", "a.h5")])
def test_missing_packages_are_named(tmp_path, monkeypatch, module, package, name):
    """Not as a damaged file."""
    start = {"a.nrrd": b"NRRD0004\ntype: uint8\n", "a.h5": b"\x89HDF\r\n\x1a\n"}[name]
    (tmp_path / name).write_bytes(start + bytes(300))
    monkeypatch.setitem(sys.modules, module, None)
    for reader in [one for one in sys.modules if one.startswith("sheetsplat.io.") and "hdf5" in one]:
        monkeypatch.delitem(sys.modules, reader)
    with pytest.raises(ss.Unsupported, match=f"no package {package}.*pip install {package}"):
        ss.open(tmp_path / name)


def test_pictures_without_their_package(tmp_path, monkeypatch, ball):
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    with pytest.raises(ss.Unsupported, match="a.exr cannot be written: found no package OpenEXR"):
        ss.render(ball, size=(8, 8), backend="reference").save(tmp_path / "a.exr")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("shape", [(50, 3), (50, 4)])
def test_points_given_as_a_volume_are_told_about_fits(shape):
    with pytest.raises(ss.InvalidInput, match=r"sheetsplat\.fit\.nearest"):
        ss.render(np.zeros(shape))
    with pytest.raises(ss.InvalidInput) as caught:
        ss.render(np.zeros((50, 50)))
    assert "fit" not in str(caught.value)
