"""Solids filled with kernels: inside and outside, closed meshes, deformation, the stand-ins of the 2006 paper."""

from __future__ import annotations

import gzip
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.generators.train import train_mesh
from sheetsplat import PictureWarning, fit
from sheetsplat.errors import InvalidInput, OutOfMemory
from sheetsplat.fit import _solid
from sheetsplat.fit._mesh import close, winding_on_grid

Array = np.ndarray
Mesh = tuple[Array, Array]


def box(lower: tuple[float, ...] = (0, 0, 0), upper: tuple[float, ...] = (1, 1, 1)) -> Mesh:
    """Return a box of twelve triangles, counter-clockwise as seen from outside."""
    corners = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    triangles = [(a, b, c) for a, b, c, _ in quads] + [(a, c, d) for a, _, c, d in quads]
    low, high = np.array(lower), np.array(upper)
    return low + corners * (high - low), np.array(triangles)


def ball(n: int = 24) -> Mesh:
    """Return a ball of radius 1 by circles of latitude."""
    turn, rise = 2 * np.pi * np.arange(2 * n) / (2 * n), np.pi * np.arange(1, n) / n
    rows = np.stack(
        [np.outer(np.sin(rise), np.cos(turn)), np.outer(np.sin(rise), np.sin(turn)), np.outer(np.cos(rise), turn**0)],
        axis=-1,
    )
    vertices = np.concatenate([rows.reshape(-1, 3), [(0, 0, 1), (0, 0, -1)]])
    i, j = np.meshgrid(np.arange(n - 2), np.arange(2 * n), indexing="ij")
    a, b = 2 * n * i + j, 2 * n * i + (j + 1) % (2 * n)
    sides = np.stack([np.stack([a, a + 2 * n, b + 2 * n], -1), np.stack([a, b + 2 * n, b], -1)]).reshape(-1, 3)
    j = np.arange(2 * n)
    k = (j + 1) % (2 * n)
    top, foot = len(vertices) - 2, len(vertices) - 1
    last = 2 * n * (n - 2)
    caps = [np.stack([j * 0 + top, j, k], -1), np.stack([j * 0 + foot, last + k, last + j], -1)]
    return vertices, np.concatenate([sides, *caps])


def joined(*parts: Mesh) -> Mesh:
    """Return several meshes as one."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    return (
        np.concatenate([vertices for vertices, _ in parts]),
        np.concatenate([triangles + start for (_, triangles), start in zip(parts, starts[:-1], strict=True)]),
    )


def turned(mesh: Mesh) -> Mesh:
    """Return the mesh inside out."""
    return mesh[0], mesh[1][:, ::-1]


def rotated(mesh: Mesh, seed: int) -> Mesh:
    axes = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return mesh[0] @ (axes * np.sign(np.linalg.det(axes))), mesh[1]


def mesh_file(folder: Path, name: str) -> Path:
    if not (folder / name).is_file():
        pytest.skip(f"{folder / name} is not there")
    return folder / name


# Inside and outside


@pytest.mark.parametrize("name", ["ball", "boxes", "hollow", "overlap", "train"])
def test_winding_on_a_grid_is_that_by_solid_angles(name: str) -> None:
    mesh = {
        "ball": rotated(ball(8), 1),
        "boxes": joined(rotated(box(), 2), rotated(box((3, 0, 0), (4, 2, 1)), 3)),
        "hollow": joined(rotated(box((-2, -2, -2), (2, 2, 2)), 4), turned(rotated(ball(8), 5))),
        "overlap": joined(rotated(box(), 6), rotated(box((0.3, 0.2, 0.1), (1.5, 1.4, 1.6)), 6)),
        "train": train_mesh(),
    }[name]
    closed = close("the mesh", *mesh)
    lower, upper = mesh[0].min(axis=0), mesh[0].max(axis=0)
    edge = float((upper - lower).max()) / (14 if name != "train" else 26)
    shape = tuple(int(n) + 2 for n in np.ceil((upper - lower) / edge))
    origin = lower - 0.6137 * edge
    found = winding_on_grid(closed, origin, edge, shape)
    middles = (
        origin + (np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 3) + 0.5) * edge
    )
    expected = fit.winding_numbers(middles, closed.vertices, closed.triangles).reshape(shape)
    assert np.abs(found - expected).max() < 1e-6
    assert found.min() == 0 < found.max()
    if name in ("overlap", "train"):
        assert found.max() >= 2


def test_middles_on_edges_and_corners_leave_no_gaps() -> None:
    # Every edge and every corner of the box lies right on a line through middles of cells.
    vertices, triangles = box((0.5, 0.5, 0.5), (4.5, 4.5, 4.5))
    found = winding_on_grid(close("the mesh", vertices, triangles), np.zeros(3), 1.0, (6, 6, 6))
    assert set(np.unique(found)) == {0, 1}
    assert found.sum() == 4**3


def test_a_large_mesh_of_many_slivers_leaves_no_gaps() -> None:
    # Random places on a ball, many of its triangles long and thin.
    scipy_spatial = pytest.importorskip("scipy.spatial")
    rng = np.random.default_rng(3)
    points = rng.normal(size=(3000, 3))
    points[:1500, 2] *= 1e-3
    points /= np.linalg.norm(points, axis=1)[:, None]
    hull = scipy_spatial.ConvexHull(points)
    closed = close("the mesh", points, hull.simplices)
    found = winding_on_grid(closed, np.full(3, -1.1), 2.2 / 60, (60, 60, 60))
    assert set(np.unique(found)) == {0, 1}
    assert found.sum() * (2.2 / 60) ** 3 == pytest.approx(closed.volume, rel=0.01)
    assert closed.volume == pytest.approx(hull.volume, rel=1e-9)


# Filling


@pytest.mark.parametrize("name", ["ball", "box", "two", "hollow", "long"])
@pytest.mark.parametrize("levels", [1, 3])
def test_cells_have_the_meshes_volume(name: str, levels: int) -> None:
    mesh, volume = {
        "ball": (ball(), close("x", *ball()).volume),
        "box": (rotated(box(), 1), 1.0),
        "two": (joined(rotated(box(), 1), rotated(box((3, 0, 0), (4, 2, 1)), 1)), 3.0),
        "hollow": (rotated(joined(box((-2, -2, -2), (2, 2, 2)), turned(ball())), 3), 64 - close("x", *ball()).volume),
        "long": (rotated(box((0, 0, 0), (20, 1, 0.5)), 2), 10.0),
    }[name]
    kernels = fit.solid(*mesh, kernels=6000, levels=levels)
    edges = kernels.scales / 1.85
    assert np.sum(edges**3) == pytest.approx(kernels.report["cell_volume"], rel=1e-12)
    assert kernels.report["mesh_volume"] == pytest.approx(volume, rel=1e-9)
    assert np.sum(edges**3) == pytest.approx(volume, rel=0.03)
    sizes = np.unique((edges / edges.min()).round(6))
    assert sizes.tolist() in ([1.0], [1.0, 2.0], [1.0, 2.0, 4.0])
    assert (len(sizes) > 1) == (levels > 1 and name != "long")
    # The mesh's middle is that of the cells.
    middle = (kernels.centers * edges[:, None] ** 3).sum(axis=0) / np.sum(edges**3)
    if name != "two":
        expected = {"ball": mesh[0][:0].sum(axis=0), "hollow": np.zeros(3)}.get(name, mesh[0].mean(axis=0))
        assert np.abs(middle - expected).max() < 2.5 * edges.min()


@pytest.mark.parametrize("size", [0.93, 1.0, 1.04, 1.09])
def test_boxes_along_the_axes_are_off_by_half_a_cell_at_most(size: float) -> None:
    kernels = fit.solid(*box((0, 0, 0), (size, 2 * size, 0.5)), spacing=0.1, levels=2)
    cells = [round(extent / 0.1) for extent in (size, 2 * size, 0.5)]
    assert kernels.report["cell_volume"] == pytest.approx(np.prod(cells) * 1e-3)


def test_cells_do_not_overlap_and_neighbours_differ_by_a_factor_of_two() -> None:
    kernels = fit.solid(*rotated(ball(), 1), spacing=0.06, levels=4)
    edges = (kernels.scales / (1.85 * 0.06)).round().astype(int)
    assert set(edges) == {1, 2, 4, 8} or set(edges) == {1, 2, 4}
    lower = ((kernels.centers / 0.06) - 0.5 * edges[:, None]).round(6)
    corner = np.round(lower - lower.min(axis=0)).astype(int)
    grid = np.zeros(corner.max(axis=0) + 10, dtype=int)
    for at, edge in zip(corner, edges, strict=True):
        block = grid[tuple(slice(c, c + edge) for c in at)]
        assert not block.any()
        block[...] = edge
    for axis in range(3):
        a, b = np.moveaxis(grid, axis, 0)[:-1], np.moveaxis(grid, axis, 0)[1:]
        both = (a > 0) & (b > 0)
        assert np.maximum(a, b)[both].max() > 1
        assert (np.maximum(a, b)[both] <= 2 * np.minimum(a, b)[both]).all()
        # Larger cells keep away from the surface.
        assert set(np.unique(np.maximum(a, b)[both ^ ((a > 0) | (b > 0))])) == {1}


def depth_in_box(at: Array, lower: tuple[float, ...], upper: tuple[float, ...]) -> Array:
    """Return how deep places lie in a box; negative outside, there the distance along an axis."""
    return np.minimum(at - np.array(lower), np.array(upper) - at).min(axis=1)


@pytest.mark.parametrize("name", ["ball", "box", "two"])
def test_solids_are_dense_inside_and_empty_outside(name: str) -> None:
    first, second = ((0, 0, 0), (1, 1, 1)), ((1.5, 0, 0), (2.5, 1, 1))
    axes = rotated((np.eye(3), np.empty((0, 3), int)), 4)[0]
    if name == "ball":
        mesh, depth = ball(), lambda at: 1 - np.linalg.norm(at, axis=1)
    elif name == "box":
        mesh, depth = rotated(box(), 4), lambda at: depth_in_box(at @ axes.T, *first)
    else:
        mesh = rotated(joined(box(), box(*second)), 4)
        depth = lambda at: np.maximum(depth_in_box(at @ axes.T, *first), depth_in_box(at @ axes.T, *second))  # noqa: E731
    kernels = fit.solid(*mesh, kernels=4000)
    edge = kernels.report["spacing"]
    rng = np.random.default_rng(5)
    lower, upper = mesh[0].min(axis=0) - 2 * edge, mesh[0].max(axis=0) + 2 * edge
    at = lower + (upper - lower) * rng.random((12_000, 3))
    data, weight = kernels.sums(at)
    density = data / np.maximum(1, weight)
    deep, away = depth(at) > edge, depth(at) < -1.9 * edge
    assert deep.sum() > 500 and away.sum() > 500
    assert weight[deep].min() > 1.0 and np.abs(density[deep] - 1).max() < 1e-12
    assert weight.max() < 2.4
    assert density[away].max() == 0.0 < density[~away & (depth(at) < -0.5 * edge)].max()
    # The density reaches out of the mesh by about a quarter of the smallest cells' edge.
    area = {"ball": 4 * np.pi, "box": 6, "two": 12}[name]
    excess = density.mean() * np.prod(upper - lower) - kernels.report["mesh_volume"]
    assert 0.1 < excess / (area * edge) < 0.35
    assert replace(kernels, scales=0.8 * kernels.scales).sums(at[deep])[1].min() < 0.8


def test_shares_of_cells_place_a_surface_between_them() -> None:
    # A slope across the axes: without shares it is a staircase.
    mesh = rotated(box((-1, -1, -1), (1, 1, 1)), 11)
    axes = rotated((np.eye(3), np.empty((0, 3), int)), 11)[0]
    rng = np.random.default_rng(8)
    face = np.column_stack([rng.uniform(-0.6, 0.6, (2000, 2)), np.ones(2000)]) @ axes
    spread = {}
    for shares in (False, True):
        kernels = fit.solid(*mesh, spacing=0.1, overlap=2.5, shares=shares)
        weight = kernels.sums(face)[1]
        spread[shares] = weight.std() / weight.mean()
        assert (kernels.weights is None) != shares
    assert spread[True] < 0.25 * spread[False]
    assert kernels.weights is not None and 0.0 < kernels.weights.min() < 0.1 and kernels.weights.max() == 1.0
    # The cells that are inside in part make up what cells by their centres miss or add.
    assert kernels.report["cell_volume"] == pytest.approx(8.0, rel=0.003)
    kernels = fit.solid(*box((0, 0, 0), (0.93, 0.4, 0.5)), spacing=0.1, shares=True)
    assert kernels.report["cell_volume"] == pytest.approx(0.93 * 0.4 * 0.5, rel=0.05)


def test_shares_do_not_depend_on_how_many_samples_are_held_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = rotated(ball(8), 3)
    expected = fit.solid(*mesh, spacing=0.15, shares=True)
    monkeypatch.setattr(_solid, "_MOST_SAMPLES", 5000)
    found = fit.solid(*mesh, spacing=0.15, shares=True)
    assert np.array_equal(found.centers, expected.centers)
    assert found.weights is not None and expected.weights is not None
    assert np.abs(found.weights - expected.weights).max() < 1e-12 or (found.weights != expected.weights).mean() < 0.01


@pytest.mark.parametrize("wanted", [500, 5000, 40_000])
def test_the_count_is_about_that_wanted(wanted: int) -> None:
    mesh = joined(rotated(ball(), 1), rotated(box((1.5, 0, 0), (3, 1, 0.4)), 7))
    assert len(fit.solid(*mesh, kernels=wanted)) == pytest.approx(wanted, rel=0.02)


def test_thin_walls_have_no_gaps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a hollow ball whose wall is thinner than a cell of the usual number of kernels."""
    monkeypatch.setattr(_solid, "_USUAL", 1000)
    shell, hollow = ball(), ball()
    mesh = joined(shell, turned((0.96 * hollow[0], hollow[1])))
    kernels = fit.solid(*mesh)
    assert kernels.report["spacing"] < 0.04 and len(kernels.values) > 5000
    field = kernels.field()
    inner = np.cos(np.pi / 24) * 0.98
    towards = np.random.default_rng(4).normal(size=(500, 3))
    towards *= inner / np.linalg.norm(towards, axis=1, keepdims=True)
    weights = field.scalars_and_weights(towards)[1]
    coarse = fit.solid(*mesh, kernels=1000).field()
    assert weights.min() > 1.0 and coarse.scalars_and_weights(towards)[1].min() < 0.5


def test_walls_too_thin_to_fill_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_solid, "_USUAL", 500)
    monkeypatch.setattr(_solid, "_MOST_UNASKED", 2000)
    hollow = ball()
    with pytest.warns(PictureWarning, match="gaps in walls of the mesh: they are 0.009.* thick"):
        kernels = fit.solid(*joined(ball(), turned((0.99 * hollow[0], hollow[1]))))
    assert 1000 < len(kernels.values) < 4000


def test_values_are_numbers_or_functions_of_places() -> None:
    assert set(fit.solid(*box(), kernels=200, values=2.5).values) == {2.5}
    kernels = fit.solid(*box(), kernels=200, values=lambda at: at[:, 0] ** 2)
    assert np.array_equal(kernels.values, kernels.centers[:, 0] ** 2)
    with pytest.raises(InvalidInput, match="nan"):
        fit.solid(*box(), kernels=200, values=lambda at: np.full(len(at), np.nan))
    with pytest.raises(InvalidInput, match="values"):
        fit.solid(*box(), kernels=200, values=lambda at: [1.0])


# Meshes that are not right


def test_orientation_is_mended() -> None:
    good = joined(rotated(box(), 1), rotated(ball(8), 2))
    expected = fit.solid(*good, kernels=2000)
    rng = np.random.default_rng(6)
    mixed = good[1].copy()
    flips = rng.random(len(mixed)) < 0.3
    mixed[flips] = mixed[flips][:, ::-1]
    one = good[1].copy()
    one[:12] = one[:12, ::-1]
    for triangles, count in ((mixed, int(flips.sum())), (one, 12), (good[1][:, ::-1], len(mixed))):
        kernels = fit.solid(good[0], triangles, kernels=2000)
        assert np.array_equal(kernels.centers, expected.centers)
        assert kernels.report["turned"] == count
    # A hollow stays one, also where everything is inside out.
    hollow = joined(box((-2, -2, -2), (2, 2, 2)), turned(ball(8)))
    for mesh in (hollow, turned(hollow)):
        assert fit.solid(*mesh, kernels=2000).sums(np.zeros((1, 3)))[1][0] == 0.0
    filled = joined(box((-2, -2, -2), (2, 2, 2)), ball(8))
    assert fit.solid(*filled, kernels=2000).sums(np.zeros((1, 3)))[1][0] > 1.0


@pytest.mark.parametrize("seed", [None, 3])
def test_shells_in_shells_are_walls_and_cavities_by_turns(seed: int | None) -> None:
    """Of 300 boxes of one middle every other one is inside out: walls, and none of them is turned."""
    sizes = np.arange(300, 0, -1) / 300
    boxes = [box((-size,) * 3, (size,) * 3) for size in sizes]
    boxes = [turned(one) if n % 2 else one for n, one in enumerate(boxes)]
    vertices, triangles = joined(*boxes)
    if seed is not None:
        vertices = rotated((vertices, triangles), seed)[0]
    start = time.process_time()
    closed = close("x", vertices, triangles)
    assert time.process_time() - start < 5.0
    assert closed.turned == 0 and closed.shells == 300
    assert closed.volume == pytest.approx(8.0 * (sizes**3 * (1 - 2 * (np.arange(300) % 2))).sum())
    # Small ones inside out that are in no other are turned, among many triangles or large ones.
    apart = [turned(box((x, 0, 0), (x + 0.01, 0.01, 0.01))) for x in np.arange(2, 4, 0.02)]
    closed = close("x", *joined((vertices, triangles), *apart, box((-3, -3, -3), (5, 5, -2)), turned(ball(8))))
    assert closed.turned == 12 * 100


def test_triangles_without_area_and_points_that_are_there_twice_do_no_harm() -> None:
    vertices, triangles = rotated(box(), 1)
    expected = fit.solid(vertices, triangles, kernels=1000)
    soup = vertices[triangles].reshape(-1, 3)
    separate = fit.solid(soup, np.arange(len(soup)).reshape(-1, 3), kernels=1000)
    assert np.array_equal(separate.centers, expected.centers) and separate.report["merged"] == 28
    thin = np.concatenate([triangles, [[0, 0, 1], [3, 3, 3]]])
    kernels = fit.solid(vertices, thin, kernels=1000)
    assert np.array_equal(kernels.centers, expected.centers) and kernels.report["degenerate"] == 2


def _again(mesh: Mesh, *more: int) -> Mesh:
    """Return a mesh with some of its triangles once more, in the other direction where their number is negative."""
    return mesh[0], np.concatenate([mesh[1], *(mesh[1][[abs(n)]][:, :: 1 if n > 0 else -1] for n in more)])


OUTER = box((-2, -2, -2), (2, 2, 2))


@pytest.mark.parametrize(
    ("mesh", "once", "shells"),
    [
        (joined(ball(8), ball(8)), ball(8), 1),
        (joined(ball(8), turned(ball(8))), ball(8), 1),
        (joined(*[ball(8)] * 5, turned(ball(8))), ball(8), 1),
        (_again(box(), 3), box(), 1),
        (_again(box(), 3, 3), box(), 1),
        (_again(box(), 3, -3), box(), 1),
        (joined(*[OUTER, turned(ball(8))] * 2), joined(OUTER, turned(ball(8))), 2),
        (joined(box(), box((1, 0, 0), (2, 1, 1))), box((0, 0, 0), (2, 1, 1)), 1),
    ],
    ids=["twice", "two sides", "six", "a face twice", "a face thrice", "a face of two sides", "hollow twice", "a wall"],
)
def test_triangles_that_are_there_many_times_count_once(mesh: Mesh, once: Mesh, shells: int) -> None:
    found, expected = close("x", *mesh), close("x", *once)
    assert found.volume == pytest.approx(expected.volume, rel=1e-12) and found.shells == shells
    assert found.repeated == len(mesh[1]) - len(found.triangles) > 0 == found.degenerate
    assert np.abs(fit.solid(*mesh, kernels=500).centers - fit.solid(*once, kernels=500).centers).max() < 1e-9


def test_a_mesh_of_a_hundred_thousand_equal_triangles_is_filled_in_a_moment() -> None:
    """It took minutes: each was taken for a shell, and tested for being inside all others."""
    mesh = (box()[0], np.repeat(box()[1], 9000, axis=0))
    mesh[1][1::3] = mesh[1][1::3, ::-1]
    start = time.process_time()
    kernels = fit.solid(*mesh, kernels=500)
    assert time.process_time() - start < 5.0
    assert kernels.report["mesh_volume"] == pytest.approx(1.0) and kernels.report["repeated"] == 107_988


def test_a_wall_alone_is_no_surface() -> None:
    with pytest.raises(InvalidInput, match="pairs of triangles of the same corners"):
        fit.solid(box()[0], [(0, 2, 3), (3, 2, 0)])


def test_open_meshes_are_refused_with_the_place() -> None:
    vertices, triangles = box()
    with pytest.raises(
        InvalidInput, match=r"not closed: found 3 boundary edges, the first from vertex (\d) to vertex"
    ) as caught:
        fit.solid(vertices, np.delete(triangles, 0, axis=0))
    # Triangle 0 was (0, 2, 3); the first edge that is left alone is one of its own.
    text = str(caught.value)
    assert "(0.5, 1, 0)" in text or "(0, 0.5, 0)" in text or "(0.5, 0.5, 0)" in text
    with pytest.raises(InvalidInput, match="3 boundary edges"):
        fit.solid(vertices, np.concatenate([triangles, [[0, 5, 7]]]))


def test_surfaces_with_one_side_are_refused() -> None:
    # A Klein bottle: a torus of squares that is sewn together the wrong way round.
    n = 8
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")

    def number(a: Array, b: Array) -> Array:
        wrap = a // n
        return (a % n) * n + np.where(wrap == 1, -b, b) % n

    a, b, c, d = number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)
    triangles = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    with pytest.raises(InvalidInput, match="one side only"):
        fit.solid(np.random.default_rng(7).random((n * n, 3)), triangles)


def _nan_vertex() -> Mesh:
    vertices, triangles = box()
    vertices[5, 2] = np.nan
    return vertices, triangles


@pytest.mark.parametrize(
    ("mesh", "options", "told"),
    [
        (_nan_vertex(), {}, "vertices.*entry 5"),
        ((box()[0], np.array([[0, 1, 8]])), {}, "triangle 0.*8 vertices"),
        ((box()[0], np.array([[0, 1, -1]])), {}, "triangle 0"),
        ((box()[0], np.array([[0, 1, 2, 3]])), {}, "triangles"),
        ((box()[0], box()[1].astype(float)), {}, "whole numbers"),
        ((box()[0], np.empty((0, 3), int)), {}, "no triangle"),
        ((box()[0], np.array([[0, 0, 1]])), {}, "without any area"),
        ((np.empty((0, 3)), np.empty((0, 3), int)), {}, "no triangle"),
        (box((0, 0, 0), (1, 1, 0)), {}, "triangles|volume"),
        (box((0, 0, 0), (1, 1, 1e-14)), {}, "a volume of"),
        (box(), {"kernels": 0}, "kernels"),
        (box(), {"kernels": 10, "spacing": 0.1}, "both"),
        (box(), {"spacing": -1}, "spacing"),
        (rotated(box(), 1), {"spacing": 9.0}, "no cell"),
        (box(), {"levels": 0}, "levels"),
        (box(), {"levels": 9}, "levels"),
        (box(), {"overlap": 0}, "overlap"),
        (box(), {"values": np.nan}, "nan"),
    ],
)
def test_bad_solids_have_clear_errors(mesh: Mesh, options: dict[str, object], told: str) -> None:
    options = options if "spacing" in options else {"kernels": 100, **options}
    if told == "no cell":
        # A corner of this tetrahedron is all that the only cell could hold.
        mesh = (
            np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], float),
            np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]),
        )
    with pytest.raises(InvalidInput, match=told):
        fit.solid(*mesh, **options)


def test_too_many_cells_are_refused_before_memory_is_taken() -> None:
    with pytest.raises(OutOfMemory, match="cells"):
        fit.solid(*box(), spacing=1e-5)


# Files


def test_meshes_are_read(tmp_path: Path) -> None:
    vertices, triangles = box()
    text = "".join(f"v {x:g} {y:g} {z:g}\n" for x, y, z in vertices)
    text += "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in triangles)
    ply = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
    ply += "element face 12\n"
    ply += "property list uchar int vertex_indices\nend_header\n"
    ply += "".join(f"{x:g} {y:g} {z:g}\n" for x, y, z in vertices)
    ply += "".join(f"3 {a} {b} {c}\n" for a, b, c in triangles)
    for name, content in (("a.obj", text), ("b.ply", ply)):
        (tmp_path / name).write_text(content)
        (tmp_path / f"{name}.gz").write_bytes(gzip.compress(content.encode()))
        for path in (tmp_path / name, str(tmp_path / f"{name}.gz")):
            found = fit.read_mesh(path)
            assert close("the mesh", *found).volume == pytest.approx(1)
            assert np.array_equal(found[0], vertices) and np.array_equal(found[1], triangles)
    # Quadrangles become triangles.
    quads = text.split("f ")[0] + "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n"
    (tmp_path / "c.obj").write_text(quads)
    assert close("the mesh", *fit.read_mesh(tmp_path / "c.obj")).volume == pytest.approx(1)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.stl", b"solid"),
        ("a.obj", b""),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nf 1 2 9\n"),
        ("a.obj", b"v 0 0\nf 1 1 1\n"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nend_header\n1\n2\n"),
        (
            "a.ply",
            b"ply\nformat binary_little_endian 1.0\nelement vertex 999999999999\nproperty float x\nend_header\n\0\0",
        ),
        ("a.ply", b"ply\n" + bytes(range(256))),
        ("a.obj.gz", gzip.compress(b"v 0 0 0\n" * 100, mtime=0)[:-20]),
    ],
)
def test_bad_files_have_clear_errors(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InvalidInput, match="a\\.(stl|obj|ply)"):
        vertices, triangles = fit.read_mesh(tmp_path / name)
        fit.solid(vertices, triangles)
        raise InvalidInput(f"{name} was read")
    with pytest.raises(InvalidInput, match="no such file"):
        fit.read_mesh(tmp_path / "none.obj")


@pytest.mark.data
def test_the_bunny_is_open(data_dir: Path) -> None:
    mesh = fit.read_mesh(mesh_file(data_dir, "mesh_bunny.ply.gz"))
    assert mesh[0].shape == (35947, 3) and mesh[1].shape == (69451, 3)
    with pytest.raises(InvalidInput, match="223 boundary edges, the first from vertex"):
        fit.solid(*mesh)


# Deformation


@pytest.mark.parametrize("degree", [None, 1, 2, 3])
def test_the_lattice_at_rest_changes_nothing(degree: int | None) -> None:
    kernels = fit.solid(*rotated(box(), 1), kernels=800)
    lower, upper = kernels.centers.min(axis=0), kernels.centers.max(axis=0)
    same = fit.free_form_deformation(
        kernels, fit.control_lattice((lower, upper), (4, 5, 6), degree=degree), degree=degree
    )
    assert np.abs(same.centers - kernels.centers).max() < 1e-12
    assert np.abs(same.scales - kernels.scales[:, None]).max() < 1e-12
    assert np.array_equal(same.values, kernels.values) and same.report == kernels.report
    # Another degree's lattice is not at rest.
    other = fit.control_lattice((lower, upper), (4, 5, 6), degree=2 if degree != 2 else 3)
    moved = fit.free_form_deformation(kernels, other, degree=degree)
    assert (np.abs(moved.centers - kernels.centers).max() > 1e-3) == (degree is not None or True)


@pytest.mark.parametrize("degree", [None, 2])
def test_linear_maps_are_exact(degree: int | None) -> None:
    rng = np.random.default_rng(8)
    points = rng.random((300, 3))
    kernels = fit.delaunay(points, points[:, 0])
    linear, shift = rng.normal(size=(3, 3)), rng.normal(size=3)
    linear *= np.sign(np.linalg.det(linear))
    lattice = fit.control_lattice(((0, 0, 0), (1, 1, 1)), (3, 4, 3), degree=degree)
    moved = fit.free_form_deformation(kernels, lattice @ linear.T + shift, box=((0, 0, 0), (1, 1, 1)), degree=degree)
    assert np.abs(moved.centers - (points @ linear.T + shift)).max() < 1e-12
    expected = linear @ kernels.shapes()
    shapes = moved.shapes()
    square = expected @ expected.transpose(0, 2, 1)
    assert np.abs(shapes @ shapes.transpose(0, 2, 1) - square).max() < 1e-10 * np.abs(square).max()
    # A field goes along with its space.
    at = 0.2 + 0.6 * rng.random((100, 3))
    assert np.allclose(moved.sums(at @ linear.T + shift)[1], kernels.sums(at)[1], rtol=1e-9)
    assert np.linalg.norm(moved.rotations, axis=1) == pytest.approx(1)


@pytest.mark.parametrize("degree", [None, 3])
def test_shapes_follow_the_derivative_of_the_map(degree: int | None) -> None:
    rng = np.random.default_rng(9)
    room = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
    control = fit.control_lattice(room, (4, 5, 4), degree=degree)
    control = control + 0.12 * rng.normal(size=control.shape)
    points = 1.6 * rng.random((40, 3)) - 0.8

    def mapped(at: Array) -> Array:
        return fit.free_form_deformation(
            fit.Kernels(at, np.ones(len(at)), np.ones(len(at))), control, box=room, degree=degree
        ).centers

    jacobian = np.stack([(mapped(points + step) - mapped(points - step)) / 2e-5 for step in 1e-5 * np.eye(3)], axis=-1)
    moved = fit.free_form_deformation(
        fit.Kernels(points, np.full(40, 0.1), np.ones(40)), control, box=room, degree=degree
    )
    shapes = moved.shapes()
    expected = 0.01 * jacobian @ jacobian.transpose(0, 2, 1)
    assert np.abs(shapes @ shapes.transpose(0, 2, 1) - expected).max() < 1e-8
    assert (moved.scales.max(axis=1) / moved.scales.min(axis=1)).max() > 1.2


def test_bad_deformations_have_clear_errors() -> None:
    kernels = fit.solid(*box(), kernels=200)
    rest = fit.control_lattice(((0, 0, 0), (1, 1, 1)), (3, 3, 3))
    folded = rest.copy()
    folded[..., 0] *= -1
    broken = rest.copy()
    broken[1, 2, 0, 1] = np.nan
    for control, options, told in (
        (folded, {}, "folds space over at"),
        (broken, {}, r"nan at \(1, 2, 0, 1\)"),
        (rest[0], {}, "shape"),
        (rest[:1], {}, "shape"),
        (np.zeros((65, 2, 2, 3)), {}, "shape"),
        (rest, {"box": ((0, 0, 0), (0.5, 1, 1))}, "centres outside"),
        (rest, {"box": ((0, 0, 0), (0, 1, 1))}, "box"),
        (rest, {"box": 3}, "box"),
        (rest, {"degree": 0}, "degree"),
        ("abc", {}, "type"),
    ):
        with pytest.raises(InvalidInput, match=told):
            fit.free_form_deformation(kernels, control, **options)
    with pytest.raises(InvalidInput, match="Kernels"):
        fit.free_form_deformation(kernels.centers, rest)
    with pytest.raises(InvalidInput, match="shape"):
        fit.control_lattice(((0, 0, 0), (1, 1, 1)), (3, 1, 3))
    with pytest.raises(InvalidInput, match="shape"):
        fit.control_lattice(((0, 0, 0), (1, 1, 1)), 3)
