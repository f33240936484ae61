"""Table 1 of Neophytou & Mueller 2006: six fields of scattered kernels and their frames a second."""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import sheetsplat as ss
from sheetsplat import datasets, fit
from sheetsplat.bench._measure import Judge, attempt, data_folder, device_of, orbit, renderer_of_papers, time_frames
from sheetsplat.bench._report import Goal, Options, Report, Row, environment

# Of the solids' suggested opacities, which hide what is inside.
_THINNER = 0.1
# The longest edge of the kernels' centres is this many slice distances, as in a volume of 128^3.
_UNITS = 128.0

_COLUMNS = {
    "row": "data set",
    "source": "shown by",
    "points": "points",
    "kernels_drawn": "drawn",
    "diagonals": "diagonals of 128",
    "slices": "slices",
    "wall_ms": "ms",
    "cpu_ms": "cpu ms",
    "fps": "fps",
    "fragments": "fragments",
    "fragments_a_second": "a second",
    "default_spacing": "own ds of 128",
    "default_slices": "own slices",
    "default_fps": "own fps",
    "fit_s": "read, fit s",
    "rmse": "rmse",
    "p99_9": "p99.9",
    "error_size": "error at",
    "paper_points": "paper: points",
    "paper_diagonals": "diagonals",
    "paper_fps": "fps ",
    "remark": "remark",
}


@dataclass(frozen=True)
class _Loaded:
    """Kernels, the colours that suit them, and what they are."""

    kernels: fit.Kernels
    points: Sequence[tuple[float, ...]]
    source: str
    direction: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class _Picture:
    """A row: how it is made, and what the paper reports for it."""

    load: Callable[[Options], _Loaded]
    paper_points: str
    paper_diagonals: str
    paper_fps: float


def _need(options: Options, *names: str) -> list[Path]:
    found = [data_folder(options) / name for name in names]
    for path in found:
        if not path.is_file():
            raise FileNotFoundError(f"{path.name} is not in the data folder; set SHEETSPLAT_DATA")
    return found


def _flow(grid: str, solution: str, source: str) -> Callable[[Options], _Loaded]:
    def loaded(options: Options) -> _Loaded:
        from sheetsplat.io.scattered import read_scattered

        mesh, flow = _need(options, grid, solution)
        data = read_scattered(flow, grid=mesh)
        kernels = fit.delaunay(data.points, data.values, cells=data.cells)
        low, high = float(data.values.min()), float(data.values.max())
        middle = 0.5 * (low + high)
        points = [(low, 0.2, 0.3, 0.9, 0.0), (middle, 0.9, 0.8, 0.3, 0.03), (high, 1.0, 0.3, 0.2, 0.2)]
        return _Loaded(kernels, points, source)

    return loaded


@contextmanager
def _data_at(folder: Path) -> Iterator[None]:
    """Let data sets look for their files in a folder."""
    before = os.environ.get("SHEETSPLAT_DATA")
    os.environ["SHEETSPLAT_DATA"] = str(folder)
    try:
        yield
    finally:
        if before is None:
            del os.environ["SHEETSPLAT_DATA"]
        else:
            os.environ["SHEETSPLAT_DATA"] = before


def _solid(make: Callable[..., Any], kernels: int, source: str, *files: str) -> Callable[[Options], _Loaded]:
    def loaded(options: Options) -> _Loaded:
        _need(options, *files)
        with _data_at(data_folder(options)):
            made = make(max(500, round(kernels * options.scale**3)))
        points = [(*point[:4], _THINNER * point[4]) for point in made.suggested["points"]]
        return _Loaded(made.kernels, points, source, made.suggested["direction"])

    return loaded


_PICTURES = {
    "Blunt Fin": _Picture(
        _flow("bluntfinxyz.bin.gz", "bluntfinq.bin.gz", "NASA Blunt Fin, density"), "34k (31k)", "0.9-120", 1.6
    ),
    "Combust.": _Picture(
        _flow("combxyz.bin.gz", "combq.bin.gz", "NASA Combustor, density"), "39k (35k)", "8.3-27.4", 1.9
    ),
    "Chess Pc.": _Picture(
        _solid(datasets.chess_piece, 84_000, "chess knight, bent (stand-in)", "mesh_chess_knight.obj"),
        "84k (63k)",
        "1.9-25",
        3.5,
    ),
    "Monster": _Picture(
        _solid(datasets.monster, 91_000, "cow Spot, bent (stand-in)", "mesh_spot.obj"), "91k (60k)", "2.5-3.0", 4.0
    ),
    "Toy Car": _Picture(
        _solid(datasets.toy_car, 173_000, "toy cannon, bent (stand-in)", "mesh_toy_cannon.obj"),
        "173k (117k)",
        "2.0-4.3",
        2.2,
    ),
    "Toy Train": _Picture(
        _solid(datasets.toy_train, 199_000, "generated train, bent (stand-in)"), "199k (139k)", "2.0-4.0", 2.1
    ),
}

#: Names of the rows.
ROWS = tuple(_PICTURES)


def diagonals(kernels: fit.Kernels) -> tuple[float, float]:
    """Return the smallest and largest diagonal of boxes around supports, in 1/128 of the longest edge of all centres.

    A box has its kernel's own axes; around a sphere it is the cube that the paper speaks of.
    """
    axes = kernels.scales
    lengths = 2.0 * (np.sqrt(3.0) * axes if axes.ndim == 1 else np.linalg.norm(axes, axis=1))
    unit = _unit(kernels)
    return float(lengths.min()) / unit, float(lengths.max()) / unit


def _unit(kernels: fit.Kernels) -> float:
    """Return 1/128 of the longest edge of the box around all centres."""
    return float(np.ptp(kernels.centers, axis=0).max()) / _UNITS


def _row(name: str, picture: _Picture, options: Options, renderer: ss.Renderer) -> Row:
    began = time.perf_counter()
    loaded = picture.load(options)
    took = time.perf_counter() - began
    kernels = loaded.kernels
    unit = _unit(kernels)
    field = kernels.field()

    lights = [ss.Light((0.3, 0.5, 1.0))]
    usual = ss.Scene(field, loaded.points, lights=lights, slice_spacing=unit)
    own = ss.Scene(field, loaded.points, lights=lights)
    cameras = orbit(field, options.views)
    if loaded.direction is not None:
        # The solids have a side that shows what they are.
        cameras[0] = ss.Camera.fit(field, direction=loaded.direction)
    least, most = diagonals(kernels)
    options.say(f"{name}: {len(kernels):,} kernels")
    timing = time_frames(renderer, usual, cameras, options.size)
    row: Row = {
        "source": loaded.source,
        "points": len(kernels),
        "diagonals": f"{least:.1f}-{most:.1f}",
        "fit_s": took,
        "kernels_drawn": round(timing.stats["kernels_drawn"]),
        "slices": round(timing.stats["slices"]),
        "wall_ms": 1000.0 * timing.wall,
        "cpu_ms": 1000.0 * timing.cpu,
        "fps": 1.0 / timing.wall,
    }
    if options.pictures is not None:
        for scene, what in ((usual, ""), (own, " at its own distance")):
            options.keep(renderer.render(scene, cameras[0], size=options.size), name + what)
    if timing.picture.plan.backend == "gl":
        counting = renderer_of_papers(options, effects={"count_fragments": True})
        counted = [counting.render(usual, camera, size=options.size).stats["fragments"] for camera in cameras]
        fragments = statistics.median(counted)
        row |= {"fragments": round(fragments), "fragments_a_second": fragments / timing.wall}
    further = time_frames(renderer, own, cameras[: min(3, options.views)], options.size)
    row |= {
        "default_spacing": own.slice_spacing / unit,
        "default_slices": round(further.stats["slices"]),
        "default_fps": 1.0 / further.wall,
    }
    options.say(f"{name}: error against the reference")
    judge = Judge(options.size, options.reference_seconds)
    return row | judge.error(renderer, usual, cameras[0])


def run(options: Options | None = None) -> Report:
    """Run the rows of the paper's Table 1."""
    options = options or Options()
    renderer = renderer_of_papers(options)
    rows: list[Row] = []
    goals: list[Goal] = []
    for name, picture in _PICTURES.items():
        if not options.wants(name):
            continue
        options.say(name)
        row: Row = {"row": name}
        row |= attempt(partial(_row, name, picture, options, renderer))
        row |= {
            "paper_points": picture.paper_points,
            "paper_diagonals": picture.paper_diagonals,
            "paper_fps": picture.paper_fps,
        }
        if name == "Combust." and "fit_s" in row:
            goals.append(Goal("reading and fit of the Combustor", row["fit_s"], 10.0, "s"))
        rows.append(row)
    return Report(
        name="table2006",
        title=f"Table 1 of Neophytou & Mueller 2006, at {options.size[0]}x{options.size[1]}, semi-transparent, shaded",
        columns=_COLUMNS,
        rows=rows,
        notes=[
            f"Times are medians over {options.views} views of an orbit, each drawn once after a frame that is not "
            "counted; by the clock, and by all processors together (cpu).",
            f"Unit of diagonals, and distance of slices: 1/{_UNITS:g} of the longest edge of the box around all "
            "centres. own ds, slices and fps: at the default distance, which follows the kernels' thinnest semi-axes, "
            "with opacities per that distance.",
            "fragments: those that the splat pass blends, counted by the device in a frame more; in packing wide one "
            "of them holds up to eight slices.",
            "Errors are of the first view against the float64 reference, at the largest size whose reference fits into "
            f"about {options.reference_seconds:g} s.",
            "The paper: Pentium 4 at 3 GHz, Quadro FX 3400 (GeForce 6800 GT), 400x400; in brackets, points that it did "
            "not cull. Its solids are not to be had; stand-ins are named.",
        ],
        goals=goals,
        environment=environment(device_of(renderer)),
    )
