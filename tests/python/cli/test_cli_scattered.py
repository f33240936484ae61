"""Scattered data on the command line."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_line import run

import sheetsplat as ss
from sheetsplat.io import save_npz

h5py = pytest.importorskip("h5py")

REFERENCE = ("--backend", "reference", "--size", "12x12", "-q")


@pytest.fixture
def table(tmp_path):
    """Return a table of a few spheres whose values span decades."""
    rng = np.random.default_rng(4)
    rows = np.column_stack([rng.uniform(0, 4, (60, 3)), 10.0 ** rng.uniform(0, 4, 60), rng.uniform(1, 1.5, 60)])
    path = tmp_path / "t.csv"
    np.savetxt(path, rows, delimiter=",", header="x,y,z,heat,radius", comments="", fmt="%.17g")
    return path, rows


@pytest.fixture
def solution(tmp_path):
    """Return a small PLOT3D solution and its grid."""
    ni, nj, nk = 5, 4, 6
    k, j, i = np.mgrid[0:nk, 0:nj, 0:ni].reshape(3, -1).astype(">f4")
    header = np.array([ni, nj, nk], ">i4").tobytes()
    flow = np.stack([1 + 0.1 * i, 0.3 * j, 0 * i, 0 * i, 4 + 0 * i]).astype(">f4")
    (tmp_path / "xyz.bin").write_bytes(header + np.stack([i * (1 + 0.1 * k), j, k]).astype(">f4").tobytes())
    (tmp_path / "q.bin").write_bytes(header + bytes(16) + flow.tobytes())
    return tmp_path / "q.bin", tmp_path / "xyz.bin"


def picture(tmp_path, *arguments):
    path = tmp_path / "picture.npy"
    run("render", *arguments, "-o", path, *REFERENCE)
    return np.load(path)


def test_render_gives_what_python_gives(tmp_path, table):
    path, rows = table
    field = ss.EllipsoidField(rows[:, :3], rows[:, 4], None, rows[:, 3])
    wanted = ss.render(field, size=(12, 12), backend="reference").pixels
    assert wanted.max() > 0.1
    np.testing.assert_array_equal(picture(tmp_path, path), wanted)
    np.testing.assert_array_equal(ss.render(path, size=(12, 12), backend="reference").pixels, wanted)
    decades = ss.EllipsoidField(rows[:, :3], rows[:, 4], None, np.log10(rows[:, 3] / rows[:, 3].min()))
    # The look knows that they are decades.
    decades = decades.with_quantity(floor=rows[:, 3].min())
    logarithmic = ss.render(decades, size=(12, 12), backend="reference").pixels
    np.testing.assert_allclose(picture(tmp_path, path, "--log"), logarithmic, atol=1e-6)
    assert np.abs(logarithmic - picture(tmp_path, path, "--no-log")).max() > 0.05


@pytest.mark.parametrize(
    "options",
    [
        ("--normalization", "none", "--falloff", "5"),
        ("--w0", "0.5", "--min-scale", "1.2"),
        ("--fit", "delaunay"),
        ("--fit", "nearest"),
        ("--neighbors", "6", "--falloff", "6"),
        ("--log",),
        ("--log-floor", "10"),
        ("--log", "--log-floor", "10"),
        ("--log-floor", "10", "--log"),
        ("--scalar", "heat", "--filter", "ewa"),
        ("--mode", "xray"),
    ],
)
def test_options_reach_the_field(tmp_path, table, options):
    path, _ = table
    changed = picture(tmp_path, path, *options)
    assert changed.max() > 0
    plain = picture(tmp_path, path, *(("--mode", "xray", "--zoom", "0.9") if "xray" in options else ()))
    if "--filter" not in options:
        assert np.abs(changed - plain).max() > 1e-4
    else:
        assert np.abs(changed - plain).max() > 0


def test_a_floor_wins_over_a_plain_logarithm_in_any_order(tmp_path, table):
    path, _ = table
    first = picture(tmp_path, path, "--log-floor", "10", "--log")
    np.testing.assert_array_equal(picture(tmp_path, path, "--log", "--log-floor", "10"), first)
    np.testing.assert_array_equal(picture(tmp_path, path, "--log-floor", "10"), first)
    assert np.abs(picture(tmp_path, path, "--log") - first).max() > 1e-3


def test_plot3d(tmp_path, solution):
    q, xyz = solution
    density = picture(tmp_path, q, "--grid", xyz)
    assert density.max() > 0
    np.testing.assert_array_equal(picture(tmp_path, q, "--grid", xyz, "--scalar", "density"), density)
    assert np.abs(picture(tmp_path, q, "--grid", xyz, "--scalar", "mach") - density).max() > 1e-3
    report = json.loads(run("info", q, "--grid", xyz, "--scalar", "energy", "--json").output)
    assert (report["format"], report["points"], report["scalar"]) == ("plot3d", 120, "energy")
    assert report["minimum"] == report["maximum"] == 4
    text = run("info", q, "--grid", xyz).output
    assert "5 x 4 x 6" in text
    assert "momentum_x" in text
    assert "reference" in run("plan", q, "--grid", xyz, "--size", "12x12", "--backend", "reference").output


def test_an_output_may_not_be_the_grid(tmp_path, solution):
    q, xyz = solution
    grid = tmp_path / "grid.npy"
    grid.write_bytes(xyz.read_bytes())
    run("render", q, "--grid", grid, "-o", grid, code=2)
    assert grid.read_bytes() == xyz.read_bytes()


def test_particles(tmp_path):
    rng = np.random.default_rng(6)
    path = tmp_path / "s.h5"
    with h5py.File(path, "w") as file:
        for name in ("PartType0", "PartType1"):
            file[f"{name}/Coordinates"] = rng.uniform(0, 3, (50, 3))
            file[f"{name}/Masses"] = rng.uniform(1, 2, 50)
        file["PartType0/SmoothingLength"] = np.full(50, 0.7)
    assert picture(tmp_path, path, "--support", "2").max() > 0
    result = run("render", path, "--particles", "PartType1", "-o", tmp_path / "a.png", *REFERENCE, code=1)
    assert "pass --neighbors 32" in result.output
    assert picture(tmp_path, path, "--particles", "PartType1", "--neighbors", "8").max() > 0


def test_coverage_is_written(tmp_path, table):
    path, _ = table
    run("render", path, "-o", tmp_path / "a.png", "--coverage", tmp_path / "w.npy", *REFERENCE)
    assert np.load(tmp_path / "w.npy").max() > 1


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--scalar", "cold"), "pass --scalar"),
        (("--radius", "2"), "radius for scattered data"),
        (("--grid", "nowhere.bin"), "nowhere.bin"),
        (("--particles", "PartType0"), "only for HDF5"),
    ],
)
def test_failures_are_one_message(tmp_path, table, arguments, text):
    path, _ = table
    result = run("render", path, *arguments, "-o", tmp_path / "a.png", *REFERENCE, code=1)
    assert text in result.output
    assert "..." not in result.output
    assert not (tmp_path / "a.png").exists()


@pytest.mark.parametrize(
    "arguments",
    [
        ("--fit", "delaunay", "--neighbors", "3"),
        ("--fit", "best"),
        ("--neighbors", "0"),
        ("--log-floor", "0"),
        ("--min-scale", "-1"),
        ("--filter", "x"),
    ],
)
def test_wrong_usage_is_code_2(tmp_path, table, arguments):
    run("render", table[0], *arguments, "-o", tmp_path / "a.png", code=2)


def test_a_field_that_is_saved_is_opened_as_it_was(tmp_path):
    rng = np.random.default_rng(8)
    centers, scales, values = rng.normal(size=(20, 3)), rng.uniform(0.5, 1, (20, 3)), rng.normal(size=20)
    turns = rng.normal(size=(20, 4))
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    path = tmp_path / "f.npz"
    weights = rng.uniform(0.5, 2, 20)
    for field in (
        ss.EllipsoidField(centers, scales, turns, values, weights=weights, normalization="none", w0=0.5, falloff=6),
        ss.EllipsoidField(centers, scales[:, 0], None, values),
        ss.EllipsoidField(centers, np.full(20, 2.0), None, values, normalization="lattice", cell_volume=0.3),
    ):
        save_npz(field, path)
        again = ss.open(path)
        for name in ("centers", "scales", "rotations", "values", "weights"):
            first, second = getattr(field, name), getattr(again, name)
            assert (first is None) == (second is None)
            if first is not None:
                # Quaternions are normalised again.
                np.testing.assert_allclose(second, first, rtol=0, atol=1e-15 if name == "rotations" else 0)
        for name in ("normalization", "w0", "falloff", "cell_volume"):
            assert getattr(again, name) == getattr(field, name)
    with pytest.raises(ss.InvalidInput, match=r"\.npz"):
        save_npz(field, tmp_path / "f.npy")
    with pytest.raises(ss.InvalidInput, match="EllipsoidField"):
        save_npz(np.ones(3), path)
    with pytest.raises(ss.Error):
        save_npz(field, tmp_path / "none" / "f.npz")


def test_gaussians_are_drawn_to_four_deviations(tmp_path):
    names = ["x", "y", "z", "opacity", *(f"scale_{n}" for n in range(3)), *(f"rot_{n}" for n in range(4))]
    header = "ply\nformat ascii 1.0\nelement vertex 1\n" + "".join(f"property float {name}\n" for name in names)
    path = tmp_path / "g.ply"
    path.write_text(header + "end_header\n0 0 0 0 0 -1 -2 2 0 0 0\n")
    field = ss.open(path)
    np.testing.assert_allclose(field.scales, [4 * np.exp([0, -1, -2])], rtol=1e-6)
    np.testing.assert_array_equal(field.rotations, [[1, 0, 0, 0]])
    assert field.values.tolist() == [0.5]
    np.testing.assert_allclose(ss.open(path, falloff=2.0).scales, [2 * np.exp([0, -1, -2])], rtol=1e-6)


def test_sph_particles_have_the_gaussian_nearest_to_their_kernel(tmp_path):
    path = tmp_path / "s.h5"
    rng = np.random.default_rng(6)
    with h5py.File(path, "w") as file:
        file["PartType0/Coordinates"] = rng.uniform(0, 3, (50, 3))
        file["PartType0/Temperature"] = rng.uniform(1, 2, 50)
        file["PartType0/SmoothingLength"] = np.full(50, 0.7)
    kernel = ss.fit.SPH_KERNELS["cubic_spline"]
    field = ss.open(path, scalar="Temperature")
    assert field.falloff == kernel.falloff
    np.testing.assert_allclose(field.scales, 0.35 * kernel.radius)
    with pytest.raises(ss.InvalidInput, match="falloff"):
        ss.open(path, scalar="Temperature", falloff=8.0)


GUITAR = ("3dgs_guitar.ply.gz", "--up", "-y", "--azimuth", "250", "--clim", "0,1", "--opacity", "0,0.5")
MEASURED = [
    ("bluntfinq.bin.gz", "--grid", "bluntfinxyz.bin.gz"),
    ("combq.bin.gz", "--grid", "combxyz.bin.gz", "--scalar", "momentum"),
    ("fire_ug.vtu.gz", "--scalar", "t"),
    ("sph_gas_nchilada12M.h5", "--log"),
    GUITAR,
]


@pytest.mark.gl
@pytest.mark.data
@pytest.mark.parametrize("arguments", MEASURED, ids=[one[0] for one in MEASURED])
def test_measured_data_by_one_command(tmp_path, data_dir, arguments):
    size = ("--size", "100", "--margin", "2" if "fire" in arguments[0] else "1.3")
    named = [data_dir / word if (data_dir / word).is_file() else word for word in arguments]
    run("render", *named, "-o", tmp_path / "a.npy", *size, "--slice-spacing", SPACING[arguments[0]], "-q")
    alpha = np.load(tmp_path / "a.npy")[..., 3]
    assert 0.005 < (alpha > 0.5).mean() < 0.9
    # Nothing but the thing itself: the corners are empty, which the faintest parts need the margin for.
    assert not alpha[[0, 0, -1, -1], [0, -1, 0, -1]].any()


# Coarse, so that a picture takes seconds at most.
SPACING = {
    "bluntfinq.bin.gz": 0.2,
    "combq.bin.gz": 0.4,
    "fire_ug.vtu.gz": 0.15,
    "sph_gas_nchilada12M.h5": 20,
    "3dgs_guitar.ply.gz": 0.02,
}
