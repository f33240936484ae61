"""Kernels from meshes, points and particles: covering, linear fields, closed forms, bad input."""

from __future__ import annotations

import gzip
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial import Delaunay

import sheetsplat as ss
from sheetsplat import fit
from sheetsplat.errors import InvalidInput
from sheetsplat.fit import _delaunay
from sheetsplat.fit._cells import grid_cells

Array = np.ndarray

# Trilinear corners of a hexahedron, in the order of VTK.
_UNIT = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)])


def lattice(n: int, axes: Array | None = None) -> Array:
    """Return the points of a lattice [k, j, i] with i fastest, (n^3, 3), in the axes given as rows."""
    k, j, i = np.mgrid[0:n, 0:n, 0:n].reshape(3, -1)
    return np.stack([i, j, k], axis=1) @ (np.eye(3) if axes is None else axes)


def places_in(cells: Array, points: Array, rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Return random places in random cells, and the diameters of these cells."""
    chosen = cells[rng.integers(len(cells), size=count)]
    if chosen.shape[1] == 8:
        u = rng.random((count, 1, 3))
        weights = np.where(_UNIT[None] == 1, u, 1 - u).prod(axis=2)
    else:
        weights = rng.dirichlet(np.ones(chosen.shape[1]), count)
    corners = points[chosen]
    size = np.sqrt(((corners[:, :, None] - corners[:, None]) ** 2).sum(axis=-1)).max(axis=(1, 2))
    return np.einsum("nc,ncd->nd", weights, corners), size


def linear_error(kernels: fit.Kernels, at: Array, size: Array) -> tuple[Array, Array]:
    """Return W, and the error of the worst of three linear fields over the size given, both at places."""
    middle = kernels.centers.mean(axis=0)
    worst = np.zeros(len(at))
    weight = worst
    for axis in range(3):
        data, weight = replace(kernels, values=(kernels.centers - middle)[:, axis]).sums(at)
        worst = np.maximum(worst, np.abs(data / np.maximum(1, weight) - (at - middle)[:, axis]) / size)
    return weight, worst


def kept_tetrahedra(points: Array) -> Array:
    """Return the Delaunay tetrahedra that a fit of bare points covers."""
    middle = points.mean(axis=0)
    found = Delaunay((points - middle) / np.abs(points - middle).max())
    return found.simplices[_delaunay._trimmed(found.points, found.simplices, found.neighbors)]


def plot3d(folder: Path, name: str) -> tuple[Array, Array, tuple[int, int, int]]:
    """Return points, density and shape of one of NASA's data sets."""
    grid = folder / f"{name}xyz.bin.gz"
    if not grid.is_file():
        pytest.skip(f"{grid} is not there")
    raw = gzip.decompress(grid.read_bytes())
    ni, nj, nk = (int(n) for n in np.frombuffer(raw, ">i4", 3))
    count = ni * nj * nk
    points = np.frombuffer(raw, ">f4", 3 * count, 12).reshape(3, count).T.astype(float)
    raw = gzip.decompress((folder / f"{name}q.bin.gz").read_bytes())
    return points, np.frombuffer(raw, ">f4", count, 28).astype(float), (nk, nj, ni)


# Sums


def test_sums_are_those_of_every_kernel_at_every_point(rng: np.random.Generator) -> None:
    count = 60
    turned = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    kernels = fit.Kernels(
        centers=rng.random((count, 3)),
        scales=0.05 + 0.4 * rng.random((count, 3)),
        values=rng.normal(size=count),
        rotations=fit._kernels.quaternions(turned),
        weights=rng.random(count),
        falloff=5.0,
    )
    at = rng.random((200, 3))
    data, weight = kernels.sums(at)
    expected_data, expected_weight = np.zeros(200), np.zeros(200)
    for n in range(count):
        # An axis has no sign, so that mirrored frames are the same ellipsoid.
        unit = (at - kernels.centers[n]) @ turned[n] / kernels.scales[n]
        g = np.maximum(0, (np.exp(-5 * (unit**2).sum(axis=1)) - np.exp(-5)) / (1 - np.exp(-5)))
        expected_weight += kernels.weights[n] * g
        expected_data += kernels.weights[n] * kernels.values[n] * g
    assert np.abs(weight - expected_weight).max() < 1e-12 < np.abs(weight).max()
    assert np.abs(data - expected_data).max() < 1e-12
    assert weight.max() > 0.5


def test_masses_are_integrals_of_kernels() -> None:
    kernels = fit.Kernels(np.zeros((2, 3)), np.array([2.0, 1.0]), np.ones(2), weights=np.array([3.0, 1.0]), falloff=4.0)
    shell = quad(lambda r: 4 * np.pi * r**2 * (np.exp(-4 * r**2) - np.exp(-4)) / (1 - np.exp(-4)), 0, 1)[0]
    assert kernels.masses() == pytest.approx([3 * 8 * shell, shell], rel=1e-9)


def test_kernels_are_drawn(rng: np.random.Generator) -> None:
    kernels = fit.delaunay(rng.random((60, 3)), rng.random(60))
    field = kernels.field()
    assert isinstance(field, ss.EllipsoidField)
    assert field.size == 60 and field.normalization == "threshold"
    assert kernels.field(normalization="none").normalization == "none"
    image = ss.render(kernels, size=(20, 20), backend="reference")
    assert image.pixels[..., 3].max() > 0.0
    with pytest.raises(ValueError, match="read-only"):
        kernels.centers[0] = 0.0


# Delaunay: what it is for lattices


@pytest.mark.parametrize(
    "axes",
    [np.eye(3), np.diag([1, 1, 1e-3]), np.array([[1.0, 0.2, 0], [0.7, 1.1, -0.3], [0.1, -0.8, 0.9]])],
    ids=["cubic", "1:1000", "sheared"],
)
def test_lattices_have_the_cubic_lattices_spheres_mapped(axes: Array) -> None:
    points = lattice(9, axes)
    kernels = fit.delaunay(points, points[:, 0], shape=(9, 9, 9))
    shapes = kernels.shapes()
    # M and M O are one ellipsoid, so that M M^T is compared; each row of axes is an edge of the cells.
    expected = 4.0 * axes.T @ axes
    scale = np.sqrt(np.diag(expected))
    error = np.abs(shapes @ shapes.transpose(0, 2, 1) - expected) / np.outer(scale, scale)
    assert error.max() < 1e-9
    assert kernels.report["raised"] == kernels.report["thin"] == kernels.report["trimmed"] == 0
    # The bounds in python/docs/data.md.
    rng = np.random.default_rng(1)
    weight, off = linear_error(kernels, *places_in(grid_cells((9, 9, 9)), points, rng, 4000))
    assert 1.4 < weight.min() and weight.max() < 2.05
    assert off.max() < 0.09 and np.sqrt(np.mean(off**2)) < 0.025
    steps = (points @ np.linalg.inv(axes)).round()
    inner = grid_cells((9, 9, 9))
    inner = inner[((steps[inner] >= 2) & (steps[inner] <= 6)).all(axis=(1, 2))]
    weight, off = linear_error(kernels, *places_in(inner, points, rng, 2000))
    assert 1.85 < weight.min() and weight.max() < 2.05
    assert off.max() < 0.025
    # Smaller kernels leave the bounds.
    narrow = replace(kernels, scales=0.7 * kernels.scales)
    assert narrow.sums(points[inner].mean(axis=1))[1].min() < 0.9


def test_constant_fields_are_constant_inside(rng: np.random.Generator) -> None:
    points = rng.random((400, 3))
    kernels = fit.delaunay(points, np.full(400, 7.5))
    at, _ = places_in(kept_tetrahedra(points), points, rng, 2000)
    data, weight = kernels.sums(at)
    assert weight.min() > 1.0
    assert np.abs(data / np.maximum(1, weight) - 7.5).max() < 1e-12


def test_more_overlap_is_smoother() -> None:
    points = lattice(10)
    inner = grid_cells((10, 10, 10))
    inner = inner[((points[inner] >= 3) & (points[inner] <= 6)).all(axis=(1, 2))]
    errors = []
    for overlap in (1.75, 2.0, 2.5):
        kernels = fit.delaunay(points, points[:, 0], shape=(10, 10, 10), overlap=overlap)
        at, size = places_in(inner, points, np.random.default_rng(2), 1000)
        errors.append(linear_error(kernels, at, size)[1].max())
    assert errors[0] > 2 * errors[1] > 6 * errors[2]


# Delaunay: covering


@pytest.mark.slow
def test_random_points_are_covered_without_gaps() -> None:
    rng = np.random.default_rng(5)
    points = rng.random((1500, 3))
    kernels = fit.delaunay(points, points[:, 0])
    at, size = places_in(kept_tetrahedra(points), points, rng, 4000)
    weight, off = linear_error(kernels, at, size)
    assert 1.0 < weight.min() and weight.max() < 7.0
    assert np.sqrt(np.mean(off**2)) < 0.11 and off.max() < 0.7
    assert kernels.report["lowest"] >= 1.1 and kernels.report["thin"] == 0 < kernels.report["raised"]
    # What is told of the middles is a lower bound of what they have.
    tetrahedra = kept_tetrahedra(points)
    middles = points[tetrahedra].mean(axis=1)
    edges = points[np.concatenate([tetrahedra[:, pair] for pair in ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))])]
    assert kernels.sums(np.concatenate([middles, edges.mean(axis=1)]))[1].min() >= kernels.report["lowest"] - 1e-9
    # Without the raising there are gaps.
    bare = fit.delaunay(points, points[:, 0], lowest=1e-6)
    assert bare.report["raised"] == 0 and bare.sums(middles)[1].min() < 0.9


def test_no_needles_at_the_hull() -> None:
    rng = np.random.default_rng(6)
    # Faces that are flat but for noise have slivers that reach across them.
    points = np.concatenate([rng.random((1500, 3)), rng.random((700, 3)) * [1, 1, 1e-9], rng.random((700, 3))])
    points[-700:, 0] = 1.0
    kernels = fit.delaunay(points, points[:, 0])
    spacing = len(points) ** (-1 / 3)
    assert kernels.report["trimmed"] > 50
    assert kernels.scales.max() < 9 * spacing
    untrimmed = fit.delaunay(points, points[:, 0], trim=False)
    assert untrimmed.report["trimmed"] == 0
    assert untrimmed.scales.max() > 1.3 * kernels.scales.max()


def test_gaps_that_only_the_hull_spans_stay_empty() -> None:
    rng = np.random.default_rng(7)
    angle, height, radius = 4.6 * rng.random(4000), rng.random(4000), 1 + 0.3 * rng.random(4000)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
    kernels = fit.delaunay(points, angle)
    assert kernels.sums(np.array([[0.0, 0.0, 0.5], [0.4, -0.4, 0.5]]))[1].tolist() == [0.0, 0.0]
    assert fit.delaunay(points, angle, trim=False).sums(np.array([[0.0, 0.0, 0.5]]))[1][0] > 0.5


@pytest.mark.slow
def test_walls_of_flat_cells_are_covered() -> None:
    # A curved wall: cells of 1:1000 at it, each layer a quarter thicker than the one before.
    r = 1 + np.cumsum(np.concatenate([[0], 1e-4 * 1.25 ** np.arange(31)]))
    step = 1.5 / 24
    z, turn, radius = np.meshgrid(0.105 * np.arange(6), step * np.arange(25), r, indexing="ij")
    grid = np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=-1)
    kernels = fit.delaunay(grid, turn)
    points = grid.reshape(-1, 3)
    weight, off = linear_error(kernels, *places_in(grid_cells((6, 25, 32)), points, np.random.default_rng(8), 3000))
    assert 1.4 < weight.min() and weight.max() < 12.5
    assert np.sqrt(np.mean(off**2)) < 0.05 and off.max() < 0.25
    # At the wall a kernel is as long as its cells, and as thick as its neighbours along the curve lie off its plane.
    wall = np.sort(kernels.scales.reshape(6, 25, 32, 3)[3, 12, 0])
    assert wall[2] == pytest.approx(2 * 0.105, rel=1e-6)
    assert wall[0] == pytest.approx(2 * np.hypot(1e-4, 1 - np.cos(step)), rel=1e-6)
    # A flat wall has no such thickness.
    flat = np.stack([radius, turn, z], axis=-1)
    wall = np.sort(fit.delaunay(flat, turn).scales.reshape(6, 25, 32, 3)[3, 12, 0])
    assert wall == pytest.approx([2e-4, 2 * step, 2 * 0.105], rel=1e-6)


@pytest.mark.parametrize("factor", [1e-60, 1e60])
def test_any_unit_of_length(factor: float) -> None:
    points = np.random.default_rng(9).random((300, 3))
    here, there = fit.delaunay(points, points[:, 0]), fit.delaunay(points * factor, points[:, 0])
    assert np.allclose(there.scales / factor, here.scales, rtol=1e-9)
    sphere = fit.nearest(points * factor, points[:, 0])
    assert np.allclose(sphere.scales / factor, fit.nearest(points, points[:, 0]).scales, rtol=1e-9)


def test_far_from_the_origin_nothing_changes() -> None:
    points = np.random.default_rng(9).integers(0, 1 << 20, (300, 3)) * 2.0**-20
    here, there = fit.delaunay(points, points[:, 0]), fit.delaunay(points + 1024.0, points[:, 0])
    assert np.allclose(there.scales, here.scales, rtol=1e-9)


# Delaunay: meshes


def _hexahedra_and_their_parts() -> dict[str, list[Array]]:
    cells = grid_cells((5, 5, 5))
    wedges = np.concatenate([cells[:, [0, 1, 2, 4, 5, 6]], cells[:, [0, 2, 3, 4, 6, 7]]])
    six = [(0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6)]
    tetrahedra = np.concatenate([cells[:, list(one)] for one in six])
    pyramids = np.concatenate([cells[:, [0, 1, 2, 3, 6]], cells[:, [0, 3, 7, 4, 6]], cells[:, [0, 4, 5, 1, 6]]])
    half = len(cells) // 2
    mixed = [cells[:half], wedges[half : half + 64 - half], wedges[64 + half :]]
    return {
        "hexahedra": [cells],
        "wedges": [wedges],
        "tetrahedra": [tetrahedra],
        "pyramids": [pyramids],
        "mixed": mixed,
    }


@pytest.mark.parametrize("kind", ["hexahedra", "wedges", "tetrahedra", "pyramids", "mixed"])
def test_meshes_of_every_cell_are_covered(kind: str) -> None:
    blocks = _hexahedra_and_their_parts()[kind]
    points = lattice(5)
    kernels = fit.delaunay(points, points[:, 0], cells=blocks)
    at = 4 * np.random.default_rng(10).random((3000, 3))
    weight, off = linear_error(kernels, at, np.full(3000, np.sqrt(3)))
    assert weight.min() > 1.1
    assert off.max() < 0.16
    assert kernels.report["cells"] == sum(len(block) for block in blocks)


def test_cells_come_in_many_forms() -> None:
    points = lattice(4)
    cells = grid_cells((4, 4, 4))
    by_shape = fit.delaunay(points, points[:, 0], shape=(4, 4, 4))
    stream = SimpleNamespace(connectivity=cells.reshape(-1), ends=8 * np.arange(1, len(cells) + 1))
    blocks = [SimpleNamespace(type="triangle", data=cells[:, :3]), SimpleNamespace(type="hexahedron", data=cells)]
    for given in (cells, [cells[:10], cells[10:]], {"hexahedron": cells}, blocks, stream, cells.astype(np.uint16)):
        same = fit.delaunay(points, points[:, 0], cells=given)
        assert np.allclose(same.scales, by_shape.scales, rtol=1e-12)
    grid = fit.delaunay(points.reshape(4, 4, 4, 3), points[:, 0].reshape(4, 4, 4))
    assert np.array_equal(grid.scales, by_shape.scales)
    # Another mesh over the same points is another field.
    assert not np.allclose(fit.delaunay(points, points[:, 0]).scales, by_shape.scales)


def test_points_without_a_cell_and_masked_ones_are_left_out() -> None:
    points = lattice(4)
    values = points[:, 0].copy()
    kept = fit.delaunay(points, values, cells=grid_cells((4, 4, 4))[points[grid_cells((4, 4, 4))].max(axis=(1, 2)) < 3])
    assert len(kept) == 27 and kept.report["left_out"] == 37
    mask = points[:, 2] < 2.5
    hidden = np.where(mask[:, None], points, np.nan)
    masked = fit.delaunay(hidden, np.where(mask, values, np.inf), shape=(4, 4, 4), mask=mask)
    assert len(masked) == 48 and masked.report["left_out"] == 16 and masked.report["cells"] == 18
    assert np.array_equal(masked.centers, points[mask])


def test_seams_of_grids_are_sewn_together() -> None:
    turn = np.linspace(0, 2 * np.pi, 13)
    z, angle, radius = np.meshgrid(np.arange(4.0), turn, 1 + np.arange(4.0), indexing="ij")
    grid = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=-1)
    grid[:, -1] = grid[:, 0]
    kernels = fit.delaunay(grid, z)
    assert kernels.report["merged"] == 16 and len(kernels) == 4 * 12 * 4
    # All twelve sectors are alike, also the one at the seam.
    scales = np.sort(kernels.scales.reshape(4, 12, 4, 3), axis=-1)
    assert np.ptp(scales, axis=1).max() < 1e-9


def test_points_at_one_place_become_one() -> None:
    points = np.random.default_rng(11).random((200, 3))
    twice = np.concatenate([points, points[:7], points[:2]])
    values = np.concatenate([np.full(200, 1.0), np.full(7, 3.0), np.full(2, 5.0)])
    for make in (fit.delaunay, fit.nearest):
        kernels = make(twice, values)
        assert len(kernels) == 200 and kernels.report["merged"] == 9
        assert np.array_equal(kernels.centers, points)
        assert kernels.values[:8] == pytest.approx([3, 3, 2, 2, 2, 2, 2, 1])
        assert np.allclose(kernels.scales, make(points, np.ones(200)).scales, rtol=1e-9)


# Delaunay: bad input

CLOUD = np.random.default_rng(12).random((30, 3))


def _with(entry: int, value: float) -> Array:
    changed = CLOUD.copy()
    changed[entry, 1] = value
    return changed


_MESH = np.arange(28).reshape(7, 4)
_PLANE = CLOUD[:, :2] @ np.array([[0.3, 0.5, 0.1], [-0.7, 0.2, 0.9]])


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: fit.delaunay(_PLANE, CLOUD[:, 0], cells=[_MESH]), "in one plane"),
        (lambda: fit.delaunay(_PLANE.astype(np.float32) + np.float32(3), CLOUD[:, 0], cells=[_MESH]), "in one plane"),
        (lambda: fit.delaunay(CLOUD[:, :1] * [1, 2, 3], CLOUD[:, 0], cells=[_MESH]), "on one line"),
        (lambda: fit.delaunay(np.ones((30, 3)), CLOUD[:, 0]), "1 different positions"),
        (lambda: fit.delaunay(CLOUD[:4], np.ones(4)), "4 different positions of 4 points.*at least 5"),
        (lambda: fit.delaunay(np.empty((0, 3)), []), "0 different positions"),
        (lambda: fit.delaunay(np.repeat(CLOUD[:4], 5, axis=0), np.ones(20)), "4 different positions of 20"),
        (lambda: fit.delaunay(_with(17, np.nan), np.ones(30)), "point 17"),
        (lambda: fit.delaunay(_with(3, np.inf), np.ones(30)), "point 3"),
        (lambda: fit.delaunay(_with(3, 1e200), np.ones(30)), "entry 3"),
        (lambda: fit.delaunay(CLOUD, [*range(29), np.nan]), "NaN, the value of point 29"),
        (lambda: fit.delaunay(CLOUD, np.ones(29)), "30 points and 29 values"),
        (lambda: fit.delaunay(CLOUD, np.ma.masked_equal(np.arange(30), 3)), "masked"),
        (lambda: fit.delaunay(CLOUD, ["a"] * 30), "type"),
        (lambda: fit.delaunay(CLOUD * 1j, np.ones(30)), "type complex"),
        (lambda: fit.delaunay(CLOUD[:, :2], np.ones(30)), r"shape \(30, 2\)"),
        (lambda: fit.delaunay([[1, 2], [3]], np.ones(2)), "an array"),
        (lambda: fit.delaunay(CLOUD, np.ones(30), overlap=0), "overlap"),
        (lambda: fit.delaunay(CLOUD, np.ones(30), falloff=-1), "falloff"),
        (lambda: fit.delaunay(CLOUD, np.ones(30), lowest=np.nan), "lowest"),
        (lambda: fit.delaunay(CLOUD, np.ones(30), shape=(2, 3, 4)), "2 x 3 x 4 = 24"),
        (lambda: fit.delaunay(CLOUD, np.ones(30), shape=(1, 5, 6)), "at least 2"),
        (lambda: fit.delaunay(CLOUD, np.ones(30), shape="abc"), "shape"),
        (lambda: fit.delaunay(CLOUD, np.ones(30), shape=(2, 3.0, 5)), "shape"),
        (lambda: fit.delaunay(CLOUD, np.ones(30), shape=(2, 3, 5), cells=np.zeros((1, 8), int)), "both"),
        (lambda: fit.delaunay(CLOUD, np.ones(30), shape=(2, 3, 5), mask=np.zeros(30, int)), "masked"),
        (lambda: fit.delaunay(CLOUD, np.ones(30), mask=np.ones(7)), "mask"),
        (lambda: fit.delaunay(CLOUD, np.ones(30), cells=np.array([[0, 1, 2, 30]])), "point numbers from 0 to 30"),
        (lambda: fit.delaunay(CLOUD, np.ones(30), cells=np.array([[0, 1, 2, -1]])), "point numbers from -1"),
        (lambda: fit.delaunay(CLOUD, np.ones(30), cells=np.array([[0, 1, 2]])), "3 corners"),
        (lambda: fit.delaunay(CLOUD, np.ones(30), cells={"hexahedron20": np.zeros((1, 20), int)}), "hexahedron20"),
        (lambda: fit.delaunay(CLOUD, np.ones(30), cells=[]), "no cell"),
        (lambda: fit.delaunay(CLOUD, np.ones(30), cells=5), "cells"),
        (lambda: fit.delaunay(CLOUD, np.ones(30), cells=np.array([[0.0, 1, 2, 3]])), "float64"),
        (
            lambda: fit.delaunay(
                CLOUD, np.ones(30), cells=SimpleNamespace(connectivity=np.arange(8), ends=np.array([4, 9]))
            ),
            "ends",
        ),
        (
            lambda: fit.delaunay(
                np.concatenate([CLOUD, CLOUD[:1]]),
                np.ones(31),
                cells=[[[0, 30, 0, 30]], [[1, 2, 3, 4], [5, 6, 7, 8]]],
            ),
            "where all their neighbours are",
        ),
        (lambda: fit.nearest(CLOUD[:12], np.ones(12)), "12 different positions.*more than neighbors = 12"),
        (lambda: fit.nearest(CLOUD[:1], [1], neighbors=1), "1 different positions"),
        (lambda: fit.nearest(CLOUD, np.ones(30), neighbors=0), "neighbors"),
        (lambda: fit.nearest(CLOUD, np.ones(30), neighbors=2.5), "neighbors"),
        (lambda: fit.nearest(_with(2, np.nan), np.ones(30)), "point 2"),
    ],
)
def test_bad_points_have_clear_errors(make, told) -> None:
    with pytest.raises(InvalidInput, match=told) as caught:
        make()
    text = str(caught.value)
    assert text.startswith("fit.") and "found" in text and len(text) < 900


def test_thin_data_are_no_plane() -> None:
    # A millionth as thick as wide, and well above the rounding of the coordinates.
    points = lattice(5) * [1, 1, 1e-6]
    kernels = fit.delaunay(points, points[:, 0], shape=(5, 5, 5))
    assert kernels.scales.min() == pytest.approx(2e-6, rel=1e-6)


def test_values_that_are_all_equal_are_fine() -> None:
    assert np.ptp(fit.delaunay(CLOUD, np.ones(30)).values) == 0.0


# Measured data


@pytest.mark.slow
@pytest.mark.data
@pytest.mark.parametrize(("name", "most", "largest"), [("comb", 0.022, 0.14), ("bluntfin", 0.12, 0.35)])
def test_nasa_grids_are_covered(data_dir: Path, name: str, most: float, largest: float) -> None:
    points, density, shape = plot3d(data_dir, name)
    kernels = fit.delaunay(points, density, shape=shape)
    rng = np.random.default_rng(17)
    weight, off = linear_error(kernels, *places_in(grid_cells(shape), points, rng, 1000))
    assert 1.3 < weight.min() and weight.max() < 3.6
    assert np.sqrt(np.mean(off**2)) < most and off.max() < largest
    assert kernels.report["thin"] == 0


@pytest.mark.data
@pytest.mark.slow
def test_the_combustors_bare_points_are_covered(data_dir: Path) -> None:
    points, density, _ = plot3d(data_dir, "comb")
    kernels = fit.delaunay(points, density)
    assert len(kernels) == 47_025 and kernels.report["thin"] == 0 and kernels.report["lowest"] >= 1.1
    # No kernel spans the combustor, which a sliver on its hull would make.
    assert kernels.scales.max() < 0.15 * np.ptp(points, axis=0).max()
