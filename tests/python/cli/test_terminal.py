"""What names of files, and names in files, do to the terminal: nothing."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import unicodedata
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scattered_files import VtkWriter, vtu_body

import sheetsplat as ss
from sheetsplat._escaping import escaped
from sheetsplat.cli import main, output
from sheetsplat.errors import complain, option_ref

# It sets the title of a terminal, rings, goes back to the first column, erases, turns writing around and ends a line.
EVIL = "\x1b]0;title\x07a\r\x9b2J\u202eb\u200bc\x7f\nerror: forged"
SHOWN = r"\x1b]0;title\x07a\r\x9b2J\u202eb\u200bc\x7f\nerror: forged"
VALUES = np.linspace(0, 1, 6 * 5 * 4, dtype=np.float32).reshape(4, 5, 6)
POINTS = np.random.default_rng(1).random((20, 3))
SMALL = ("--size", "8", "--backend", "cpu")


def harm(text: str) -> list[str]:
    """Return what a terminal would not show as a letter, and lines that a name has forged."""
    found = [one for one in text if unicodedata.category(one) in ("Cc", "Cf", "Cs", "Zl", "Zp") and one not in "\n\t"]
    return found + re.findall("^error: forged", text, re.MULTILINE)


def npz(path: Path, name: str) -> None:
    np.savez(path, **{name: VALUES})


def hdf5(path: Path, name: str) -> None:
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    with h5py.File(path, "w") as file:
        file[name] = VALUES
        file[name].attrs.update(units=name, long_name=name)


def netcdf(path: Path, name: str) -> None:
    xarray = pytest.importorskip("xarray", reason="xarray is not installed")
    pytest.importorskip("h5netcdf", reason="h5netcdf is not installed")
    array = xarray.DataArray(VALUES, dims=("z", "y", "x"), attrs={"units": name, "long_name": name})
    xarray.Dataset({name: array}).to_netcdf(path, engine="h5netcdf")


def nrrd(path: Path, name: str) -> None:
    text = name.replace("\n", "")
    head = f"NRRD0004\ntype: float\ndimension: 3\nsizes: 6 5 4\nencoding: raw\nendian: little\ncontent: {text}\n"
    head += f'space units: "{text}" "{text}" "{text}"\n{text}:={text}\n\n'
    path.write_bytes(head.encode() + VALUES.tobytes())


def metaimage(path: Path, name: str) -> None:
    text = name.replace("\n", "")
    head = f"ObjectType = Image\nNDims = 3\nDimSize = 6 5 4\nName = {text}\nElementType = MET_FLOAT"
    path.write_bytes((head + "\nElementDataFile = LOCAL\n").encode() + VALUES.tobytes())


def legacy_vtk(path: Path, name: str) -> None:
    word = name.translate(dict.fromkeys(b"\n\r \t", "_"))
    head = f"# vtk DataFile Version 3.0\n{word}\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS 6 5 4\nORIGIN 0 0 0\n"
    head += f"SPACING 1 1 1\nPOINT_DATA 120\nSCALARS {word} float 1\nLOOKUP_TABLE default\n"
    path.write_bytes(head.encode() + VALUES.astype(">f4").tobytes())


def vtu(path: Path, name: str) -> None:
    writer = VtkWriter("ascii")
    # XML has no escape character.
    words = "".join(one for one in name if one >= " ").replace("\x7f", "").replace("\x9b", "&#x9b;") + "&#10;&#13;"
    path.write_bytes(writer.file("UnstructuredGrid", vtu_body(writer)[0].replace("heat", words)))


def csv(path: Path, name: str) -> None:
    rows = "".join(f"{x},{y},{z},{x},{y}\n" for x, y, z in POINTS)
    column = name.translate(dict.fromkeys(b"\n\r"))
    path.write_text(f'x,y,z,"{column}",other\n{rows}', encoding="utf-8", newline="")


KINDS = {
    "npz": npz, "h5": hdf5, "nc": netcdf, "nrrd": nrrd, "mha": metaimage, "vtk": legacy_vtk, "vtu": vtu, "csv": csv
}  # fmt: skip


def run_anyhow(*arguments: object) -> str:
    """Return what a command prints, whatever its exit code."""
    return CliRunner().invoke(main, [str(argument) for argument in arguments]).output


def evil_path(folder: Path, suffix: str) -> Path:
    path = folder / f"{EVIL}{suffix}"
    try:
        path.touch()
    except OSError:
        pytest.skip("a file cannot have such a name here")
    return path


@pytest.mark.parametrize("kind", KINDS)
def test_no_name_of_a_file_or_in_one_reaches_the_terminal_as_it_is(tmp_path, kind):
    path = evil_path(tmp_path, f".{kind}")
    KINDS[kind](path, EVIL)
    picture = path.with_suffix(".png")
    told = ""
    for command in (["info"], ["info", "--json"], ["plan", *SMALL, "-vv"], ["render", "-o", picture, *SMALL, "-vv"]):
        for scalar in ([], ["--scalar", EVIL], ["--scalar", "none of these"]):
            found = run_anyhow(*command, path, *scalar)
            assert "internal error" not in found and harm(found) == [], (command, scalar, found)
            told += found
    assert SHOWN in told and picture.exists()
    # The name in the file: some formats cannot hold all of these characters.
    assert re.search(r"2J\\u202eb\\u200bc", told.replace(SHOWN + path.suffix, "")), told


def test_texts_of_scene_files_are_harmless(tmp_path):
    path = evil_path(tmp_path, ".toml")
    text = json.dumps(EVIL).replace("\x7f", "\\u007f")
    for line in (f"{text} = 1", f"mode = {text}", f"[[data]]\nfile = {text}", f"[render]\n{text} = {text}"):
        path.write_text(line, encoding="utf-8")
        told = run_anyhow("render", path, "-o", tmp_path / "a.png")
        assert harm(told) == [] and SHOWN in told, told


def test_options_are_harmless(tmp_path):
    ss.io.save_npz(ss.EllipsoidField(POINTS, 1.0, values=POINTS[:, 0]), tmp_path / "a.npz")
    for arguments in (
        [EVIL],
        ["render", tmp_path / "a.npz", "-o", f"{EVIL}.png", f"--{EVIL}"],
        ["info", f"{EVIL}.npz"],
    ):
        told = run_anyhow(*arguments)
        assert harm(told) == [] and r"\x1b]0;title\x07" in told, told


def test_words_are_one_line_however_they_are_spelled():
    words = "of " + option_ref("scalar", EVIL)
    error = complain(EVIL, EVIL, EVIL, words)
    assert harm(str(error)) == harm(error.complaint.text(repr)) == harm(error.advice) == []
    assert harm(str(ss.PictureWarning(words))) == [] and "\n" not in str(error)
    assert escaped("Δs – 1 °C") == "Δs – 1 °C"


def test_what_other_code_prints_is_harmless(capsys):
    with output.guarded():
        print(EVIL)
        print(EVIL, file=sys.stderr)
        assert not sys.stdout.isatty()
    print("\x1b")
    told = capsys.readouterr()
    assert told.out == SHOWN.replace("\\n", "\n") + "\n\x1b\n" and r"\x1b]0;title\x07" in told.err


@pytest.mark.skipif(os.name == "nt", reason="names are texts there")
@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_names_that_are_no_text_are_printed_in_any_encoding(tmp_path, encoding):
    path = os.fsencode(tmp_path / "Δ") + b"\xff.npy"
    try:
        with open(path, "wb") as file:
            np.save(file, VALUES)
    except OSError:
        pytest.skip("a file cannot have such a name here")
    env = {**os.environ, "PYTHONIOENCODING": encoding, "LANG": "C", "PYTHONUTF8": "1"}
    for command, code in (("info", 0), ("compare", 1)):
        arguments = [sys.executable, "-m", "sheetsplat", command, path, *([path] if code else [])]
        done = subprocess.run(arguments, capture_output=True, env=env, timeout=120)
        told = (done.stdout + done.stderr).decode(encoding)
        assert ("Δ" if encoding == "utf-8" else r"\u0394") + r"\udcff.npy" in told and "Traceback" not in told, told
    assert done.returncode == 1


@pytest.mark.skipif(os.name == "nt", reason="there is no pseudo-terminal")
def test_a_progress_bar_shows_a_name_as_it_is(tmp_path):
    import pty

    path = tmp_path / "[b]\x1b]0;title\x07.npy"
    np.save(path, VALUES)
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "sheetsplat", "render", path, "-o", tmp_path / "\x1b.png", *SMALL, "--clim", "5,6"]
    done = subprocess.run(command, stderr=theirs, env={**os.environ, "TERM": "xterm", "COLUMNS": "200"}, timeout=120)
    told = os.read(ours, 1 << 16).decode()
    os.close(theirs)
    os.close(ours)
    assert done.returncode == 0, told
    # The bar moves the cursor itself.
    assert r"[b]\x1b]0;title\x07" in told and "\x1b[" in told and "warning" in told and r"\x1b.png" in told
    assert "\x1b]" not in told and "\x07" not in told and "\x1b." not in told
