"""SPH particles in HDF5: what the reader finds in files that the tests write, and what it refuses."""

from __future__ import annotations

import math
import os

import h5py
import numpy as np
import pytest
from scattered_files import stored, write_particles

import sheetsplat as ss
from sheetsplat.io import read_scattered


@pytest.mark.parametrize("gz", [False, True])
@pytest.mark.parametrize("order", ["<", ">"])
def test_particles(tmp_path, gz, order):
    path, data = write_particles(tmp_path / "s.hdf5", order=order)
    if gz:
        path = stored(tmp_path / "s.hdf5.gz", path.read_bytes(), gz=True)
    read = read_scattered(path)
    assert read.scalar == "Density"
    assert set(read.scalars) >= {"Density", "Masses", "Velocities", "Velocities_x", "ParticleIDs"}
    np.testing.assert_array_equal(read.points, data["Coordinates"])
    np.testing.assert_array_equal(read.values, data["Density"])
    np.testing.assert_array_equal(read.masses, data["Masses"])
    np.testing.assert_array_equal(read.densities, data["Density"])
    # Random densities agree with no kernel: then it is what Gadget means.
    np.testing.assert_array_equal(read.supports, data["SmoothingLength"])
    np.testing.assert_array_equal(read_scattered(path, support=2).supports, 2 * data["SmoothingLength"].astype(float))
    np.testing.assert_array_equal(read_scattered(path, scalar="Velocities_y").values, data["Velocities"][:, 1])
    speed = np.linalg.norm(data["Velocities"], axis=1)
    np.testing.assert_allclose(read_scattered(path, scalar="Velocities").values, speed, rtol=1e-6)


@pytest.mark.parametrize("factor", [1.0, 1.825742, 2.0])
def test_the_support_of_particles_is_found_by_their_densities(tmp_path, factor):
    rng = np.random.default_rng(1)
    points, lengths, masses = rng.uniform(0, 4, (300, 3)), rng.uniform(0.5, 0.8, 300), rng.uniform(1, 2, 300)
    reach = factor * lengths
    distance = np.linalg.norm(points[:, None] - points[None], axis=2) / reach[:, None]
    kernel = 8 * ss.fit.SPH_KERNELS["cubic_spline"](2 * distance)
    densities = (masses * kernel).sum(axis=1) / reach**3
    more = {"Coordinates": points, "SmoothingLength": lengths, "Masses": masses, "Density": densities}
    path, _ = write_particles(tmp_path / "s.h5", **more)
    np.testing.assert_allclose(read_scattered(path).supports, reach, rtol=1e-12)
    # Half the densities are explained by none of the three.
    path, _ = write_particles(tmp_path / "t.h5", **{**more, "Density": 0.5 * densities})
    np.testing.assert_allclose(read_scattered(path).supports, lengths, rtol=1e-12)


def test_other_groups_of_particles(tmp_path):
    path, data = write_particles(
        tmp_path / "s.h5", group="PartType4", leave_out=("SmoothingLength", "Density", "Masses")
    )
    with h5py.File(path, "a") as file:
        file.create_group("Header").attrs["MassTable"] = [0, 0, 0, 0, 2.5, 0]
    with pytest.raises(ss.InvalidInput, match="'PartType0', but PartType4.*particles"):
        read_scattered(path)
    read = read_scattered(path, particles="PartType4", scalar="Velocities")
    assert read.supports is None
    np.testing.assert_array_equal(read.masses, np.full(40, 2.5))
    for name in ("Header", "PartType4/Coordinates", "", "/", ".."):
        with pytest.raises(ss.InvalidInput):
            read_scattered(path, particles=name)


def test_particles_without_smoothing_lengths_need_neighbors(tmp_path):
    path, _ = write_particles(tmp_path / "s.h5", leave_out=("SmoothingLength",))
    with pytest.raises(ss.InvalidInput, match=r"no smoothing lengths.*neighbors=32"):
        ss.open(path)


def test_particles_that_lie_are_refused(tmp_path):
    path, _ = write_particles(tmp_path / "a.h5", Density=np.ones(39))
    with pytest.raises(ss.InvalidInput, match="Density"):
        read_scattered(path, scalar="Density")
    with pytest.raises(ss.InvalidInput, match="39 rows"):
        read_scattered(path, scalar="Masses")
    path, _ = write_particles(tmp_path / "b.h5", leave_out=("Coordinates",))
    with pytest.raises(ss.InvalidInput, match="Coordinates"):
        read_scattered(path)
    path, _ = write_particles(tmp_path / "c.h5", Density=[math.nan, *np.ones(39)])
    with pytest.raises(ss.InvalidInput, match="1 of 40 values not finite, the first at 0"):
        read_scattered(path)
    for data in (path.read_bytes()[:1000], path.read_bytes()[:-600], b"\x89HDF\r\n\x1a\n" + bytes(100)):
        with pytest.raises(ss.Error):
            read_scattered(stored(tmp_path / "d.h5", data))
        with pytest.raises(ss.Error):
            read_scattered(stored(tmp_path / "d.h5.gz", data, gz=True))


def test_particles_that_were_never_written_take_no_memory(tmp_path):
    path = tmp_path / "s.h5"
    with h5py.File(path, "w") as file:
        group = file.create_group("PartType0")
        group.create_dataset("Coordinates", (10**12, 3), "f4", chunks=(1024, 3))
        group.create_dataset("Density", (10**12,), "f4", chunks=(1024,))
    with pytest.raises((ss.InvalidInput, ss.OutOfMemory)):
        read_scattered(path)
    with h5py.File(path, "w") as file:
        group = file.create_group("PartType0")
        group.create_dataset("Coordinates", (10**5, 3), "f4", chunks=(1024, 3), fillvalue=3.0)
        group.create_dataset("Density", (10**5,), "f4", chunks=(1024,))
    with pytest.raises(ss.InvalidInput, match="0 stored bytes"):
        read_scattered(path)


@pytest.mark.parametrize("scalar", ["Raw", "Virtual"])
def test_datasets_stored_in_other_files(tmp_path, scalar):
    secret = stored(tmp_path / "secret", bytes(40 * 8))
    other, _ = write_particles(tmp_path / "other.h5")
    path, _ = write_particles(tmp_path / "s.h5", leave_out=("Density",))
    with h5py.File(path, "a") as file:
        file["PartType0"].create_dataset("Raw", (40,), "f8", external=[(str(secret), 0, 320)])
        layout = h5py.VirtualLayout((40,), "f8")
        layout[:] = h5py.VirtualSource(str(other), "PartType0/Density", (40,))
        file["PartType0"].create_virtual_dataset("Virtual", layout)
    with pytest.raises(ss.InvalidInput, match="in another file"):
        read_scattered(path, scalar=scalar)


OTHER_FILES = {
    "dataset": {"PartType0/Density": "external"},
    "soft link to a dataset": {"x": "file", "PartType0/Density": "/x/PartType0/Density"},
    "soft link to a group": {"x": "file", "PartType0": "/x/PartType0"},
    "two soft links": {"x": "file", "y": "x/PartType0", "PartType0": "y"},
    "group": {"PartType0": "external group"},
    "header": {"x": "file", "Header": "x/Header"},
    "soft link to itself": {"PartType0": "/PartType0"},
}


@pytest.mark.parametrize("links", OTHER_FILES.values(), ids=list(OTHER_FILES))
def test_links_do_not_reach_other_files(tmp_path, links):
    """A pipe stands in for the other file: opening it would wait for ever."""
    pipe = tmp_path / "other.h5"
    os.mkfifo(pipe)
    path, _ = write_particles(tmp_path / "s.h5", leave_out=("Density", "Masses"))
    targets = {
        "file": h5py.ExternalLink(str(pipe), "/"),
        "external": h5py.ExternalLink(str(pipe), "PartType0/Density"),
        "external group": h5py.ExternalLink(str(pipe), "PartType0"),
    }
    with h5py.File(path, "a") as file:
        for name, target in links.items():
            if name == "PartType0":
                del file[name]
            file[name] = targets.get(target) or h5py.SoftLink(target)
    for scalar in ("Velocities", "SmoothingLength"):
        with pytest.raises(ss.InvalidInput, match="link"):
            read_scattered(path, scalar=scalar)


def test_links_within_a_file_are_followed(tmp_path):
    path, _ = write_particles(tmp_path / "s.h5")
    expected = read_scattered(path)
    with h5py.File(path, "a") as file:
        file.move("PartType0", "gas")
        file["PartType0"] = h5py.SoftLink("gas")
        file.move("gas/Density", "rho")
        file["gas/Density"] = h5py.SoftLink("/rho")
    np.testing.assert_array_equal(read_scattered(path).values, expected.values)
