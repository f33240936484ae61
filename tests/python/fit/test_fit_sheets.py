"""Points on curves and surfaces, the work that they take, and interrupts of fits."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np
import pytest

from sheetsplat import OutOfMemory, fit
from sheetsplat.fit import _apart, _cells, _delaunay, _sheets

Array = np.ndarray


def on_sphere(count: int, seed: int = 1) -> Array:
    """Return random points on the unit sphere, (N, 3)."""
    places = np.random.default_rng(seed).normal(size=(count, 3))
    return places / np.linalg.norm(places, axis=1)[:, None]


def helix(count: int) -> Array:
    """Return points along five turns, (N, 3)."""
    turn = np.linspace(0, 10 * np.pi, count)
    return np.stack([np.cos(turn), np.sin(turn), turn / 10], axis=1)


def wells(count: int) -> Array:
    """Return points along two lines that are nearly straight, half of their length apart, (N, 3)."""
    depth = np.linspace(0, 1, count // 2)
    lines = [np.stack([x + np.sin(3 * depth) / 100, np.cos(2 * depth) / 100, depth], axis=1) for x in (0.0, 0.5)]
    return np.concatenate(lines)


def torus(count: int) -> Array:
    """Return random points on a torus, (N, 3)."""
    u, v = 2 * np.pi * np.random.default_rng(2).random((2, count))
    return np.stack([(1 + 0.3 * np.cos(u)) * np.cos(v), (1 + 0.3 * np.cos(u)) * np.sin(v), 0.3 * np.sin(u)], axis=1)


def cylinder(count: int) -> Array:
    """Return random points on a cylinder, (N, 3)."""
    u, z = np.random.default_rng(3).random((2, count))
    return np.stack([np.cos(2 * np.pi * u), np.sin(2 * np.pi * u), 3 * z], axis=1)


def off(kernels: fit.Kernels, at: Array, values: Array) -> Array:
    """Return the error of the mean at places, over the range of the values."""
    data, weight = kernels.sums(at)
    return np.abs(data / np.maximum(1, weight) - values) / np.ptp(values)


@pytest.mark.parametrize("make", [on_sphere, helix, wells, torus, cylinder])
def test_points_on_curves_and_surfaces_are_joined_along_them(make: Callable[[int], Array]) -> None:
    points = make(3000)
    values = points @ [1.0, 0.5, 2.0]
    kernels = fit.delaunay(points, values)
    assert kernels.report["flat"] == 3000 and kernels.report["cells"] == 0 == kernels.report["thin"]
    # As close to the values as in a volume.
    assert np.sqrt(np.mean(off(kernels, points, values) ** 2)) < 0.005
    # The work is that of a few neighbours.
    edges = _sheets.edges_along(points, np.ones(3000, dtype=bool))
    assert len(edges) < 8 * 3000 and len(_sheets.triangles_of(edges, points)) < 40 * 3000
    middles = points[edges].mean(axis=1)
    assert kernels.sums(middles)[1].min() >= 1.0
    # Nothing reaches far from them.
    assert np.median(kernels.scales.max(axis=1)) < 0.3


def test_surfaces_are_covered_and_closed_ones_are_hollow() -> None:
    points = on_sphere(3000)
    kernels = fit.delaunay(points, points[:, 0])
    between = on_sphere(20_000, seed=9)
    assert kernels.report["lowest"] >= 1.1 and np.quantile(kernels.sums(between)[1], 0.001) > 1.0
    assert off(kernels, between, between[:, 0]).max() < 0.05
    assert kernels.sums(0.7 * between)[1].max() == 0.0
    # Flat along the surface.
    thick = np.sort(kernels.scales, axis=1)
    assert np.median(thick[:, 1] / thick[:, 0]) > 2.0


@pytest.mark.parametrize("far", [0.0, 1e4])
def test_curves_keep_their_resolution_and_can_be_seen(far: float) -> None:
    points = wells(6000) + np.repeat([[0, 0, 0], [far, 0, 0]], 3000, axis=0)
    kernels = fit.delaunay(points, points[:, 2])
    axes = np.sort(kernels.scales, axis=1)
    assert np.median(axes[:, 0]) == pytest.approx(2 / 2999, rel=0.01)
    assert axes[:, 1:] == pytest.approx(np.full((6000, 2), 1 / 64), rel=0.01)
    # As precise as the spacing.
    assert off(kernels, points, points[:, 2])[100:-100].max() < 3e-4


def test_a_surface_beside_a_volume_leaves_the_volume_as_it_is() -> None:
    rng = np.random.default_rng(4)
    ball = on_sphere(1500) * 0.5 * rng.random((1500, 1)) ** (1 / 3)
    both = fit.delaunay(np.concatenate([ball, on_sphere(1500, seed=5)]), np.ones(3000))
    assert both.report["flat"] == 1500
    alone = fit.delaunay(ball, np.ones(1500))
    assert np.allclose(both.scales[:1500], alone.scales, rtol=1e-6)


def test_strays_do_not_stretch_a_surface() -> None:
    strays = np.concatenate([on_sphere(3000), 5 * on_sphere(6, seed=6)])
    kernels = fit.delaunay(strays, strays[:, 0])
    alone = fit.delaunay(strays[:3000], strays[:3000, 0])
    assert kernels.report["flat"] == 3006
    assert np.allclose(kernels.scales[:3000], alone.scales, rtol=0.05)


@pytest.mark.parametrize("kind", ["lattice", "sheets", "columns", "stations", "cloud", "noisy sheet"])
def test_volumes_are_no_surfaces_whatever_their_units(kind: str) -> None:
    rng = np.random.default_rng(7)
    lattice = np.argwhere(np.ones((18, 18, 18))).astype(float)
    stations = rng.random((400, 2))
    points = {
        "lattice": lattice,
        "sheets": lattice * [1000, 1, 1],
        "columns": lattice * [1, 1, 1e-3],
        "stations": np.concatenate([np.c_[1000 * stations, np.full(400, height)] for height in range(10)]),
        "cloud": rng.random((3000, 3)) * [1, 1, 1e-3],
        "noisy sheet": np.c_[rng.random((3000, 2)), 1e-3 * rng.normal(size=3000)],
    }[kind]
    assert not fit.delaunay(points, points[:, 0], lowest=1e-3).report["flat"]


def test_grids_of_long_cells_are_no_surfaces() -> None:
    # Layers that grow from 1/300 to 3 cells: most points have near neighbours in their row alone.
    axes = np.arange(24.0), np.arange(24.0), 0.003 * 1.25 ** np.arange(32)
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    assert not _sheets.flat_parts(points, 1e-12).any()
    row = points[:32] + 40.0
    assert not _sheets.flat_parts(np.concatenate([points, row]), 1e-12).any()


@pytest.mark.parametrize(("make", "noise"), [(on_sphere, 1e-3), (helix, 3e-4), (wells, 1e-6)])
def test_noise_far_below_the_spacing_does_not_matter(make: Callable[[int], Array], noise: float) -> None:
    points = make(3000)
    points = points + noise * np.random.default_rng(12).normal(size=points.shape)
    assert fit.delaunay(points, points[:, 0]).report["flat"] == 3000


@pytest.mark.parametrize("count", [5, 30, 900])
@pytest.mark.parametrize("kind", ["plane", "line", "lattice", "circle"])
def test_points_in_a_plane_and_on_a_line_have_kernels(kind: str, count: int) -> None:
    t = np.linspace(0, 1, count)
    points = {
        "plane": np.random.default_rng(10).random((count, 2)) @ [[0.3, 0.5, 0.1], [-0.7, 0.2, 0.9]],
        "line": t[:, None] * [1.0, 2.0, 3.0],
        "lattice": np.stack([np.arange(count) // 5, np.arange(count) % 5, np.zeros(count)], axis=1),
        "circle": np.stack([np.cos(5 * t), np.sin(5 * t), np.full(count, 0.3)], axis=1),
    }[kind]
    kernels = fit.delaunay(points, points[:, 1])
    assert kernels.report["flat"] == count and kernels.report["lowest"] >= 1.1
    assert np.isfinite(kernels.scales).all() and kernels.scales.min() > 1e-4
    assert kernels.sums(points)[1].min() > 1.0


def test_clusters_far_apart_are_as_good_as_one() -> None:
    rng = np.random.default_rng(11)
    far = np.concatenate([rng.random((500, 3)), rng.random((500, 3)) + [1e8, 0, 0]])
    kernels = fit.delaunay(far, far[:, 1])
    # Coordinates near 1e8 are 1.5e-8 apart, squares of the distances are lost.
    near = fit.delaunay(far - np.repeat([[0, 0, 0], [1e8 - 100, 0, 0]], 500, axis=0), far[:, 1])
    assert kernels.report["flat"] == 0 and kernels.report["cells"] > 0.9 * near.report["cells"]
    assert np.median(kernels.scales / near.scales) == pytest.approx(1, abs=1e-3)
    assert np.sqrt(np.mean(off(kernels, far, far[:, 1]) ** 2)) < 0.03


def test_too_many_tetrahedra_become_edges(monkeypatch: pytest.MonkeyPatch) -> None:
    points = np.random.default_rng(8).random((300, 3))
    assert fit.delaunay(points, points[:, 0]).report["flat"] == 0
    monkeypatch.setattr(_delaunay, "_MOST_CELLS", 2)
    kernels = fit.delaunay(points, points[:, 0])
    assert kernels.report["flat"] == 300 and kernels.report["cells"] == 0
    assert kernels.report["lowest"] >= 1.1


# Processes and interrupts


def test_a_process_of_its_own_computes_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    points = np.random.default_rng(9).random((300, 3))
    here = fit.delaunay(points, points[:, 0])
    monkeypatch.setattr(_delaunay, "_SHORT_POINTS", 100)
    called = []
    monkeypatch.setattr(
        _delaunay, "computed_apart", lambda *given: called.append(given[0]) or _apart.computed_apart(*given)
    )
    there = fit.delaunay(points, points[:, 0])
    assert called == ["fit.delaunay"]
    assert np.array_equal(here.scales, there.scales) and np.array_equal(here.rotations, there.rotations)
    assert here.report == there.report
    # Meshes too, and where no process can be started.
    monkeypatch.setattr(_delaunay, "_SHORT_CELLS", 10)
    cells = _cells.grid_cells((5, 6, 10))
    apart = fit.delaunay(points, points[:, 0], cells=cells)
    monkeypatch.setattr(sys, "executable", "")
    assert np.array_equal(apart.scales, fit.delaunay(points, points[:, 0], cells=cells).scales)


def _killed(module: str, name: str) -> subprocess.Popen[bytes]:
    program = "import os, sys; sys.stdin.buffer.read(); os.kill(os.getpid(), 9)"
    return subprocess.Popen([sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE)


def test_errors_of_a_process_are_its_own_and_a_killed_one_is_told_of(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(KeyError, match="points"):
        _apart.computed_apart("fit.delaunay", _delaunay._shapes, {"trim": np.array(True)})
    monkeypatch.setattr(_apart, "_started", _killed)
    with pytest.raises(OutOfMemory, match="signal 9"):
        _apart.computed_apart("fit.delaunay", _delaunay._shapes, {"trim": np.array(True)})


_PROGRAM = """
import os, time
import numpy as np
from sheetsplat import fit
points = np.random.default_rng(1).random((400_000, 3))
print("ready", flush=True)
try:
    fit.delaunay(points, points[:, 0])
except KeyboardInterrupt:
    print("interrupted", time.time(), flush=True)
try:
    os.waitpid(-1, os.WNOHANG)
    print("a process is left")
except ChildProcessError:
    pass
"""


@pytest.mark.skipif(os.name != "posix", reason="signals are POSIX's")
@pytest.mark.usefixtures("ctrl_c")
def test_an_interrupt_ends_a_long_fit_at_once() -> None:
    with subprocess.Popen([sys.executable, "-c", _PROGRAM], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.5)
        sent = time.time()
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=60)
    word, when = out.split()
    assert word == "interrupted" and process.returncode == 0
    # Half of the time of 400,000 points would be far more.
    assert float(when) - sent < 5.0
