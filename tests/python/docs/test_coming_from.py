"""Every line of the page for those who come from other programs is run: its right columns, and its commands."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import run

import sheetsplat as ss

PAGE = (Path(__file__).parents[3] / "python/docs/coming-from.md").read_text()
MARK = "# sheetsplat"
# Small pictures of short films: what is tested is that the words are those of the package.
SMALL: dict[str, Any] = {"size": (40, 32)}


def blocks() -> dict[str, str]:
    """Return the right column of each block of two columns as a program, by the left one's heading."""
    found: dict[str, str] = {}
    for block in re.findall(r"(?:^ {4}.*\n)+", PAGE, re.MULTILINE):
        lines = block.splitlines()
        at = lines[0].find(MARK)
        if at < 0:
            continue
        name = lines[0][:at].strip(" #")
        assert all(line[at - 2 : at].strip() == "" for line in lines[1:] if len(line) > at), name
        found[f"{name} {len(found)}"] = "\n".join(line[at:] for line in lines[1:]) + "\n"
    return found


def commands() -> list[str]:
    """Return the commands of the table, and the options in it as commands."""
    found = []
    for row in re.findall(r"^\| (.*) \|$", PAGE, re.MULTILINE):
        for code in re.findall(r"`([^`]+)`", row.rpartition("|")[2] if "sheetsplat |" not in row else ""):
            if code.startswith("--"):
                found.append(f"sheetsplat render FILE -o x.png {code}")
            elif code.startswith("sheetsplat ") and not code.startswith("sheetsplat view"):
                found.append(code)
    return found


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Change to a folder with the files of the page, and return its names."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    k, j, i = np.indices((9, 9, 9))
    ball = 220 * np.exp(-((k - 4) ** 2 + (j - 4) ** 2 + (i - 4) ** 2) / 12)
    names: dict[str, Any] = {"ss": ss, "Path": Path, "np": np, "x0": 3.0, "c": (4.0, 4.0, 4.0)}
    names |= {name: rng.uniform(0, 8, 30) for name in "xyz"} | {"r": np.full(30, 1.5), "v": rng.random(30)}
    names |= {
        "stack": (4 * ball).astype(np.uint16),
        "a": ball,
        "b": ball[::-1],
        "affine": np.diag((2.0, 0.5, 0.5, 1.0)),
    }
    names |= {"eye": (20.0, 4.0, 4.0), "target": (4.0, 4.0, 4.0), "up": (0.0, 0.0, 1.0)}
    for name, color in (("green", (0, 1, 0)), ("magenta", (1, 0, 1))):
        names[name] = ss.TransferFunction([(20, *color, 0), (220, *color, 0.5)])
    names["front"] = ss.Camera.orthographic((4, -20, 4), (4, 4, 4), (0, 0, 1), height=12)
    names["side"] = ss.Camera.orthographic((20, 4, 4), (4, 4, 4), (0, 0, 1), height=12)
    write_files(tmp_path, ball)
    return names


def write_files(folder: Path, ball: Any) -> None:
    """Write the files that the page names."""
    pytest.importorskip("pyvista")
    import h5py
    import nibabel
    import pyvista as pv

    grid = pv.ImageData(dimensions=(9, 9, 9))
    grid["density"] = ball.ravel()
    grid.save(folder / "head.vti")
    (folder / "run").mkdir()
    for n in range(2):
        grid["density"] = ball.ravel() * (n + 1)
        grid.save(folder / "run" / f"{n}.vti")
    header = (
        "ObjectType = Image\nNDims = 3\nDimSize = 9 9 9\nElementType = MET_DOUBLE\n"
        "TransformMatrix = 0.8 0.6 0 -0.6 0.8 0 0 0 1\nBinaryDataByteOrderMSB = False\nElementDataFile = LOCAL\n"
    )
    (folder / "ct.mha").write_bytes(header.encode() + ball.astype("<f8").tobytes())
    nibabel.save(nibabel.Nifti1Image(ball.T.astype(np.float32), np.diag((1.0, 1, 1, 1))), folder / "mr.nii.gz")
    series = np.repeat(ball.T.astype(np.float32)[..., None], 5, axis=3)
    nibabel.save(nibabel.Nifti1Image(series, np.diag((1.0, 1, 1, 1))), folder / "fmri.nii")
    rng = np.random.default_rng(2)
    for name in ("snapshot.hdf5", "snap_0.hdf5", "snap_1.hdf5"):
        with h5py.File(folder / name, "w") as file:
            file.create_group("Header").attrs["Time"] = 0.0
            gas = file.create_group("PartType0")
            gas["Coordinates"] = rng.uniform(0, 8, (60, 3))
            gas["Density"] = 10 ** rng.uniform(0, 4, 60)
            gas["Masses"], gas["SmoothingLength"] = np.full(60, 1.0), np.full(60, 1.2)
            gas["Temperature"] = rng.uniform(1e3, 1e5, 60)


@pytest.mark.filterwarnings("ignore::sheetsplat.PictureWarning")
@pytest.mark.parametrize("name", blocks())
def test_right_columns_run(name: str, here: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[Any] = []
    for function in ("render", "turntable", "animate"):
        whole = getattr(ss, function)

        def small(*data: Any, whole: Any = whole, **options: Any) -> Any:
            if "frames" in options:
                options["frames"] = 3
            if len(data) == 2 and isinstance(data[1], int):
                data = (data[0], 3)
            return whole(*data, **{**SMALL, **options})

        monkeypatch.setattr(ss, function, small)
    # A page in the browser is for a reader: the options are checked, and nothing is served.
    monkeypatch.setattr(ss, "view", lambda data, **options: shown.append((data, options)))
    program = blocks()[name]
    if ".fits" in program:
        pytest.importorskip("astropy", reason="astropy is not installed")
    exec(compile(program, f"{name} of the page", "exec"), here)
    assert len(re.findall(r"ss\.view\(stack\)", program)) == len(shown)


def test_every_program_has_a_block() -> None:
    assert [name.rpartition(" ")[0] for name in blocks()] == [
        "PyVista",
        "yt",
        "ITK, Slicer, nibabel",
        "napari",
        "napari",
    ]
    assert len(commands()) >= 10


@pytest.mark.parametrize("command", commands())
def test_commands_of_the_table_run(command: str, here: dict[str, Any], tmp_path: Path) -> None:
    del here
    files = {"FILE": "head.vti", "DATA": "head.vti", "run/*.vti": "run/0.vti run/1.vti"}
    for name, path in files.items():
        command = command.replace(name, path)
    words = command.split()[1:]
    for name in ("x.png", "a.png", "b.png"):
        if name in words and words[max(0, words.index(name) - 1)] != "-o":
            run("render", "head.vti", "-o", name, "--size", "24")
    if words[0] != "render":
        words = [word for word in words if word not in ("--frames", "120")]
        words += ["--frames", "3"] if words[0] == "turntable" or "--key" in words else []
    result = run(*words, "--size", "24") if "x.png" not in words[:2] else run(*words)
    assert getattr(result, "exit_code", 0) == 0
    assert any(tmp_path.glob("*.png")) or any(tmp_path.glob("*.mp4"))
