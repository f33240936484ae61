"""Table 1 of Neophytou & Mueller 2006: six fields of scattered kernels, with the paper's frames a second."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

import sheetsplat as ss
from bench.generators import solids
from bench.generators.solids import Solid
from bench.lab import lab_renderer
from bench.measure import (
    Judge,
    clock,
    data_file,
    device_of,
    frames_and_error,
    measured_rows,
    orbit,
    renderer_for,
    time_frames,
)
from bench.pictures import keep
from bench.report import Goal, Options, Report, Row, columns, environment
from sheetsplat import fit
from sheetsplat.io import read_scattered

# Factor of the solids' suggested opacities, which would hide the interior.
_THINNER = 0.1
# The longest edge of the kernels' centres is this many slice distances, as in a volume of 128^3.
_UNITS = 128.0


@dataclass(frozen=True)
class _Loaded:
    """Kernels, the transfer function that suits them, and what they are."""

    kernels: fit.Kernels
    points: Sequence[tuple[float, ...]]
    source: str
    direction: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Picture:
    """A row: how its kernels are made, and what the paper reports for it."""

    load: Callable[[Options], _Loaded]
    paper_points: str
    paper_diagonals: str
    paper_fps: float


def _flow(grid: str, solution: str, source: str) -> Callable[[Options], _Loaded]:
    def loaded(options: Options) -> _Loaded:
        mesh, flow = (data_file(options, name) for name in (grid, solution))
        data = read_scattered(flow, grid=mesh)
        kernels = fit.delaunay(data.points, data.values, cells=data.cells)
        low, high = float(data.values.min()), float(data.values.max())
        middle = 0.5 * (low + high)
        points = [(low, 0.2, 0.3, 0.9, 0.0), (middle, 0.9, 0.8, 0.3, 0.03), (high, 1.0, 0.3, 0.2, 0.2)]
        return _Loaded(kernels, points, source)

    return loaded


def _solid(make: Callable[..., Solid], kernels: int, source: str, *files: str) -> Callable[[Options], _Loaded]:
    def loaded(options: Options) -> _Loaded:
        made = make(*(data_file(options, name) for name in files), kernels=options.count(kernels, 500))
        points = [(*point[:4], _THINNER * point[4]) for point in made.points]
        return _Loaded(made.kernels, points, source, made.direction)

    return loaded


PICTURES = {
    "Blunt Fin": Picture(
        _flow("bluntfinxyz.bin.gz", "bluntfinq.bin.gz", "NASA Blunt Fin, density"), "34k (31k)", "0.9-120", 1.6
    ),
    "Combust.": Picture(
        _flow("combxyz.bin.gz", "combq.bin.gz", "NASA Combustor, density"), "39k (35k)", "8.3-27.4", 1.9
    ),
    "Chess Pc.": Picture(
        _solid(solids.chess_piece, 84_000, "chess knight, bent (stand-in)", "mesh_chess_knight.obj"),
        "84k (63k)",
        "1.9-25",
        3.5,
    ),
    "Monster": Picture(
        _solid(solids.monster, 91_000, "cow Spot, bent (stand-in)", "mesh_spot.obj"), "91k (60k)", "2.5-3.0", 4.0
    ),
    "Toy Car": Picture(
        _solid(solids.toy_car, 173_000, "toy cannon, bent (stand-in)", "mesh_toy_cannon.obj"),
        "173k (117k)",
        "2.0-4.3",
        2.2,
    ),
    "Toy Train": Picture(
        _solid(solids.toy_train, 199_000, "generated train, bent (stand-in)"), "199k (139k)", "2.0-4.0", 2.1
    ),
}

#: Names of the rows.
ROWS = tuple(PICTURES)


def diagonals(kernels: fit.Kernels) -> tuple[float, float]:
    """Return the smallest and largest diagonal of boxes around supports, in 1/128 of the longest edge of all centres.

    A box is aligned with its kernel's axes; for a sphere it is the cube that the paper uses.
    """
    axes = kernels.scales
    lengths = 2.0 * (np.sqrt(3.0) * axes if axes.ndim == 1 else np.linalg.norm(axes, axis=1))
    unit = _unit(kernels)
    return float(lengths.min()) / unit, float(lengths.max()) / unit


def _unit(kernels: fit.Kernels) -> float:
    """Return 1/128 of the longest edge of the box around all centres."""
    return float(np.ptp(kernels.centers, axis=0).max()) / _UNITS


def run(options: Options) -> Report:
    """Draw and judge every row that is wanted."""
    options = options.preferring("gl")
    renderer = renderer_for(options)
    judge = Judge(options.size, options.reference_seconds)

    def measure(name: str, picture: Picture) -> Row:
        loaded, took, _ = clock(lambda: picture.load(options))
        kernels, unit, field = loaded.kernels, _unit(loaded.kernels), loaded.kernels.field()
        lights = [ss.Light((0.3, 0.5, 1.0))]
        scene = ss.Scene(field, loaded.points, lights=lights, slice_spacing=unit)
        own = ss.Scene(field, loaded.points, lights=lights)
        cameras = orbit(field, options.views)
        if loaded.direction is not None:
            # The solids are recognised from one side.
            cameras[0] = ss.Camera.fit(field, direction=loaded.direction)
        least, most = diagonals(kernels)
        row, timing, last = frames_and_error(options, judge, renderer, scene, cameras, name)
        if last.plan.backend == "gl":
            counting = lab_renderer(options, "count_fragments")
            counted = [counting.render(scene, camera, size=options.size).stats["fragments"] for camera in cameras]
            fragments = statistics.median(counted)
            row |= {"fragments": round(fragments), "fragments_a_second": fragments / timing.wall}
        further, picture_of_own = time_frames(renderer, own, cameras[: min(3, options.views)], options.size)
        keep(options, picture_of_own, f"{name} at its own distance")
        row |= {
            "source": loaded.source,
            "points": len(kernels),
            "diagonals": f"{least:.1f}-{most:.1f}",
            "fit_s": took,
            "default_spacing": own.slice_spacing / unit,
            "default_slices": round(further.stat("slices")),
            "default_fps": 1.0 / further.wall,
        }
        return row

    rows = measured_rows(options, PICTURES, measure)
    for row in rows:
        picture = PICTURES[row["row"]]
        row |= {name: getattr(picture, name) for name in ("paper_points", "paper_diagonals", "paper_fps")}
    return Report(
        name="table2006",
        title=f"Table 1 of Neophytou & Mueller 2006, at {options.size[0]}x{options.size[1]}, semi-transparent, shaded",
        columns=columns(
            "row=data set, source=shown by, points, kernels_drawn, diagonals=diagonals of 128, slices, wall_ms, "
            "cpu_ms, fps, fragments, fragments_a_second=fragments a second, default_spacing=own ds of 128, "
            "default_slices=own slices, default_fps=own fps, fit_s=read and fit s, rmse, p99_9, error_size, "
            "paper_points=paper: points, paper_diagonals=paper: diagonals, paper_fps=paper: fps, remark"
        ),
        rows=rows,
        notes=[
            options.views_note,
            f"Unit of diagonals and distance of slices: 1/{_UNITS:g} of the longest edge of the box around all "
            "centres. own ds, slices and fps: at the default distance, which follows the kernels' thinnest semi-axes, "
            "with opacities per that distance.",
            "fragments: those that the splat pass blends, counted by the device in another frame; in packing wide "
            "each holds up to eight slices.",
            options.error_note,
            "The paper: Pentium 4 at 3 GHz, Quadro FX 3400 (GeForce 6800 GT), 400x400; in brackets, points that it did "
            "not cull. Its solids are not available; the column 'shown by' names the stand-ins.",
        ],
        goals=[
            Goal("reading and fit of the Combustor", row["fit_s"], 10.0, "s")
            for row in rows
            if row["row"] == "Combust." and "fit_s" in row
        ],
        environment=environment(device_of(renderer)),
    )
