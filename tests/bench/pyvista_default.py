"""What PyVista shows of a file without any option, in a process of its own that keeps its context and faults apart."""

from __future__ import annotations

import gzip
import importlib
import importlib.util
import os
import shutil
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np


def is_installed() -> bool:
    """Return whether the package pyvista is there."""
    return importlib.util.find_spec("pyvista") is not None


def draw(path: str, grid: str | None, size: list[int], output: str) -> dict[str, Any]:
    """Save PyVista's picture of a file; return the seconds that it took, or the reason why there is none.

    Images are shown as volumes, all else by `add_mesh`. Files are decompressed before the clock starts.
    """
    if not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    pyvista: Any = importlib.import_module("pyvista")
    with TemporaryDirectory() as folder:
        plain = _plain(Path(path), Path(folder))
        if plain.suffix == ".h5":
            return {"reason": "no reader"}
        points = None if grid is None else _plain(Path(grid), Path(folder))
        began = time.perf_counter()
        if plain.suffix == ".npy":
            values = np.load(plain)
            mesh = pyvista.ImageData(dimensions=values.shape[::-1])
            mesh["values"] = (values.astype(np.uint8) if values.dtype == bool else values).ravel()
        elif points is None:
            mesh = pyvista.read(plain)
        else:
            reader = pyvista.MultiBlockPlot3DReader(points)
            reader.auto_detect_format = True
            reader.add_q_files(str(plain))
            mesh = reader.read()[0]
        plotter = pyvista.Plotter(off_screen=True, window_size=size)
        if isinstance(mesh, pyvista.ImageData):
            plotter.add_volume(mesh)
        else:
            plotter.add_mesh(mesh)
        plotter.screenshot(output)
        return {"seconds": time.perf_counter() - began}


def _plain(path: Path, folder: Path) -> Path:
    """Return a file that is not gzipped: itself, or a copy in a folder."""
    if path.suffix != ".gz":
        return path
    plain = folder / path.stem
    with gzip.open(path) as packed, plain.open("wb") as out:
        shutil.copyfileobj(packed, out)
    return plain
