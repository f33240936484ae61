"""Rows of scattered data whose numbers are not finite: refused, or left out and counted in one warning."""

import math

import numpy as np
import pytest
from command_line import run
from scattered_files import PLY, VtkWriter, ply_bytes, stored, vtu_body, write_particles

import sheetsplat as ss

COUNT = 40


def same_kernels(one, other):
    names = ("centers", "scales", "rotations", "values", "weights")
    return all(
        np.array_equal(getattr(one, name), getattr(other, name)) for name in names if getattr(one, name) is not None
    )


def test_particles(tmp_path):
    wrong = {("Coordinates", 3): math.nan, ("SmoothingLength", 7): math.inf, ("Density", 9): math.nan}
    path = tmp_path / "a.h5"
    rng = np.random.default_rng(1)
    rows = {"Coordinates": rng.random((COUNT, 3)), "SmoothingLength": rng.uniform(0.2, 0.3, COUNT),
            "Density": rng.uniform(1, 2, COUNT), "Masses": np.ones(COUNT)}  # fmt: skip
    kept = np.delete(np.arange(COUNT), [3, 7, 9])
    whole = write_particles(tmp_path / "b.h5", 37, **{name: one[kept] for name, one in rows.items()})[0]
    for (name, row), value in wrong.items():
        rows[name][row] = value
    write_particles(path, COUNT, **rows)
    with pytest.raises(ss.InvalidInput, match=r'position of row 3; numbers of 3 of 40 rows.*nan="skip"') as caught:
        ss.open(path)
    assert caught.value.option == "nan"
    with pytest.warns(ss.PictureWarning, match=r"3 of 40 rows of .*a\.h5 are left out.*position in 1, .*Density in 1"):
        field = ss.open(path, nan="skip", support=1.0)
    assert same_kernels(field, ss.open(whole, support=1.0)) and field.opened["nan"] == "skip"
    with pytest.warns(ss.PictureWarning, match=r"3 of 40 rows of .*a\.h5 are left out"):
        bricked = ss.open_bricks(path, nan="skip", support=1.0)
    assert bricked.kernels == 37 and same_kernels(bricked.sample, ss.open(whole, support=1.0))


def test_the_support_is_found_without_them(tmp_path):
    rng = np.random.default_rng(2)
    points, count = rng.random((300, 3)), 300
    lengths = np.full(count, 0.15)
    apart = np.linalg.norm(points[:, None] - points, axis=2) / (2 * lengths[0])
    kernel = 8 * ss.fit.SPH_KERNELS["cubic_spline"](2 * apart) / (2 * lengths[0]) ** 3
    density = kernel.sum(axis=1)
    masses = np.ones(count)
    points[5, 1], density[6], masses[7] = math.nan, math.nan, math.nan
    rows = {"Coordinates": points, "SmoothingLength": lengths, "Density": density, "Masses": masses}
    path, _ = write_particles(tmp_path / "a.h5", count, **rows)
    with pytest.warns(ss.PictureWarning, match="3 of 300 rows"):
        data = ss.io.read_scattered(path, nan="skip")
    assert len(data.points) == 297 and data.details["support"].startswith("2 smoothing lengths")


def test_gaussians(tmp_path):
    header, data, _ = ply_bytes(kind="double")
    rows = np.frombuffer(data, "<f8").reshape(30, -1).copy()
    whole = stored(
        tmp_path / "b.ply", header.replace(b"vertex 30", b"vertex 28") + np.delete(rows, (2, 5), 0).tobytes()
    )
    rows[2, PLY.index("opacity")] = math.nan
    rows[5, PLY.index("rot_0") :] = 0
    path = stored(tmp_path / "a.ply", header + rows.tobytes())
    with pytest.warns(ss.PictureWarning, match="2 of 30 rows.*scalar opacity in 1, rotation in 1"):
        field = ss.open(path, nan="skip")
    assert same_kernels(field, ss.open(whole))
    rows[:, PLY.index("scale_1")] = -2000
    path = stored(tmp_path / "flat.ply", header + rows.tobytes())
    with pytest.raises(ss.InvalidInput, match="no thickness.*min_scale"), pytest.warns(ss.PictureWarning):
        ss.open(path, nan="skip")
    with pytest.warns(ss.PictureWarning):
        assert (ss.open(path, nan="skip", min_scale=0.01).scales.min(axis=1) == 0.01).all()


def test_meshes_lose_the_cells_of_a_point(tmp_path):
    writer = VtkWriter("ascii")
    body, points, heat, *_ = vtu_body(writer)
    text = writer.file("UnstructuredGrid", body).decode()
    path = stored(tmp_path / "a.vtu", text.replace(repr(float(heat[17])), "nan", 1).encode())
    with pytest.warns(ss.PictureWarning, match="1 of 20 rows.*scalar heat in 1"):
        data = ss.io.read_scattered(path, nan="skip")
    kept = np.delete(np.arange(20), 17)
    assert np.allclose(data.points, points[kept]) and np.array_equal(data.values, heat[kept])
    # The tetrahedron of the points 16 to 19 is gone, and what is left has the numbers that it had.
    assert data.cells is not None and [block.shape[1] for block in data.cells] == [8, 8]
    assert max(int(block.max()) for block in data.cells) == 15
    # A missing corner of a cell takes the cell.
    with pytest.warns(ss.PictureWarning, match="1 of 20 rows.*position in 1"):
        corner = stored(tmp_path / "b.vtu", text.replace(repr(float(points[0, 0])), "nan", 1).encode())
        data = ss.io.read_scattered(corner, nan="skip")
    assert data.cells is not None and sum(map(len, data.cells)) == 3 and min(int(b.min()) for b in data.cells) == 3


def test_tables_by_every_front_end(tmp_path):
    path = stored(tmp_path / "a.csv", b"x,y,z,value,radius\n0,0,0,1,1\n1,0,0,nan,1\n2,0,0,2,1\n3,0,0,1,inf\n")
    with pytest.warns(ss.PictureWarning, match="2 of 4 rows"):
        field = ss.open(path, nan="skip")
    assert field.centers[:, 0].tolist() == [0, 2] and field.values.tolist() == [1, 2]
    with pytest.warns(ss.PictureWarning, match="2 of 4 rows"):
        assert ss.render(path, nan="skip", size=(32, 32)).rgba.any()
    assert "--nan skip" in run("info", path, code=1).stderr
    told = run("info", path, "--nan", "skip")
    assert "2 of 4 rows" in told.stderr and "2 spheres" in told.stdout
    columns = {"x": [0, 1.0], "y": [0, 1], "z": [0, 1], "value": [math.nan, 1], "radius": [1, 1]}
    with pytest.warns(ss.PictureWarning, match="1 of 2 rows of the dict"):
        assert ss.open(columns, nan="skip").values.tolist() == [1]


def test_fields_and_fits_of_arrays():
    rng = np.random.default_rng(3)
    points, values = rng.random((60, 3)), rng.random(60)
    kept = np.delete(np.arange(60), [4, 50])
    bad, wrong = points.copy(), values.copy()
    bad[4, 2], wrong[50] = math.nan, -math.inf
    fits = [lambda p, v, **o: ss.fit.nearest(p, v, neighbors=8, **o), ss.fit.delaunay,
            lambda p, v, **o: ss.fit.sph(p, v, np.full(len(p), 0.2), **o)]  # fmt: skip
    for fit in fits:
        with pytest.raises(ss.InvalidInput, match='the point of point 4; numbers of 2 of 60 points.*nan="skip"'):
            fit(bad, wrong)
        with pytest.warns(ss.PictureWarning, match="2 of 60 points of fit"):
            assert same_kernels(fit(bad, wrong, nan="skip"), fit(points[kept], values[kept]))
    with pytest.warns(
        ss.PictureWarning, match="2 of 60 kernels of EllipsoidField are left out.*center in 1, value in 1"
    ):
        field = ss.EllipsoidField(bad, 0.1, values=wrong, nan="skip")
    assert same_kernels(field, ss.EllipsoidField(points[kept], 0.1, values=values[kept]))
    covariances = np.tile(0.01 * np.eye(3), (60, 1, 1))
    covariances[7, 0, 1] = math.nan
    with pytest.warns(ss.PictureWarning, match="3 of 60 kernels.*covariance in 1"):
        field = ss.EllipsoidField.from_covariances(bad, covariances, wrong, nan="skip")
    assert np.array_equal(field.centers, np.delete(points, [4, 7, 50], 0))


def test_lengths_of_zero_are_raised_before_weights_follow_from_them(tmp_path):
    rows = {
        "Coordinates": [(0.0, 0, 0), (5, 0, 0)],
        "SmoothingLength": [0.0, 1.0],
        "Density": [2.0, 3],
        "Masses": [4.0, 6],
    }
    path, _ = write_particles(tmp_path / "a.h5", 2, leave_out=("Velocities", "ParticleIDs"), **rows)
    with pytest.raises(ss.InvalidInput, match=r"smoothing_lengths.*entry 0.*min_scale=\.\.\."):
        ss.open(path, support=1.0)
    field = ss.open(path, support=1.0, min_scale=0.25)
    # A kernel's integral is the particle's volume, m / density = 2, whatever its radius.
    unit = ss.EllipsoidField([(0, 0, 0)], 1.0, values=[1], normalization="none", falloff=field.falloff)
    r = (np.arange(20000) + 0.5) / 20000
    mass = 4 * math.pi * (r**2 * unit.at(np.stack([r, 0 * r, 0 * r], 1))).mean()
    assert np.allclose(field.weights * field.scales**3 * mass, 2, rtol=1e-6) and field.scales[0] == 0.25
    with pytest.raises(ss.InvalidInput, match="numbers of at least 0"):
        ss.fit.sph([(0, 0, 0)], [1], [-1.0], min_scale=0.25)
