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
    path, _ = write_particles(tmp_path / "s.h5", leave_out=("SmoothingLength", "Density"))
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
    with pytest.raises(ss.InvalidInput, match="scalar Density of row 0; numbers of 1 of 40 rows are not finite"):
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


def about(path, groups, **datasets):
    """Set attributes of groups and of datasets of PartType0."""
    with h5py.File(path, "a") as file:
        for name, values in groups.items():
            file.require_group(name).attrs.update(values)
        for name, values in datasets.items():
            file[f"PartType0/{name}"].attrs.update(values)
    return path


def swift(length, mass, time, a, factor):
    powers = {"U_L exponent": [length], "U_M exponent": [mass], "U_t exponent": [time], "U_T exponent": [0.0]}
    factors = {"Conversion factor to CGS (not including cosmological corrections)": [factor]}
    return {**powers, **factors, "a-scale exponent": [a], "h-scale exponent": [0.0]}


def arepo(length, mass, speed, a, h, to_cgs):
    scalings = {"length_scaling": length, "mass_scaling": mass, "velocity_scaling": speed}
    return {**scalings, "a_scaling": a, "h_scaling": h, "to_cgs": to_cgs}


COSMOLOGY = {"Time": 0.5, "Redshift": 1.0, "HubbleParam": 0.7, "BoxSize": 35000.0}
SIZES = {"UnitLength_In_CGS": 3.085678e21, "UnitMass_In_CGS": 1.989e43, "UnitVelocity_In_CGS": 1e5}
CODES = {
    "SWIFT": (
        {"Header": {"Scale-factor": [0.5], "Redshift": [1.0]}, "Cosmology": {"h": [0.7]}},
        {"Coordinates": swift(1, 0, 0, 1, 3.08567758e24), "Density": swift(-3, 1, 0, -3, 6.77e-31)},
        ("cMpc", "6.77e-31 g cm⁻³ a⁻³"),
    ),
    "AREPO": (
        {"Header": COSMOLOGY},
        {"Coordinates": arepo(1, 0, 0, 1, -1, 3.085678e21), "Density": arepo(-3, 1, 0, -3, 2, 6.77e-22)},
        ("ckpc/h", "6.77e-22 g cm⁻³ h² a⁻³"),
    ),
    "EAGLE": (
        {"Header": COSMOLOGY},
        {
            "Coordinates": {"CGSConversionFactor": 3.085678e24, "aexp-scale-exponent": 1.0, "h-scale-exponent": -1.0},
            "Density": {"CGSConversionFactor": 6.77e-31, "aexp-scale-exponent": -3.0, "h-scale-exponent": 2.0},
        },
        ("cMpc/h", "6.77e-31 g cm⁻³ h² a⁻³"),
    ),
    "GIZMO, comoving": ({"Header": {**COSMOLOGY, **SIZES}}, {}, ("ckpc/h", "6.77e-22 g cm⁻³ h² a⁻³")),
    "GIZMO, not comoving": ({"Header": {"Time": 3.0, "Redshift": 0.0, **SIZES}}, {}, ("kpc", "6.77e-22 g cm⁻³")),
    "Gadget-2": ({"Header": COSMOLOGY}, {}, ("", "")),
    "what is no unit": (
        {
            "Header": {
                "Redshift": "one",
                "UnitLength_In_CGS": math.inf,
                "UnitMass_In_CGS": -1.0,
                "HubbleParam": [0.7] * 9,
            }
        },
        {"Density": {"to_cgs": "much", "a_scaling": math.nan}},
        ("", ""),
    ),
}


@pytest.mark.parametrize("code", CODES)
def test_units_of_codes(tmp_path, code):
    groups, datasets, units = CODES[code]
    path, _ = write_particles(tmp_path / "s.hdf5")
    read = read_scattered(about(path, groups, **datasets))
    assert (read.length_unit, read.unit) == units
    if units[0]:
        quantity = ss.open(path).quantity
        assert quantity.length_unit == units[0] and quantity.label == f"Density [{units[1]}]"
    if code == "AREPO":
        assert (
            read.details
            | {"scale factor": "0.5", "h": "0.7", "redshift": "1", "box": "35000 x 35000 x 35000, periodic"}
            == read.details
        )
    if "GIZMO" in code:
        assert read_scattered(path, scalar="Velocities_x").unit.startswith("km/s")
        assert read_scattered(path, scalar="Masses").unit == ("10¹⁰ M☉" if "not" in code else "10¹⁰ M☉/h")
        assert read_scattered(path, scalar="ParticleIDs").unit == ""


def test_types_have_names(tmp_path):
    path, data = write_particles(tmp_path / "s.h5", group="PartType4")
    for name in ("stars", "Stars", "PartType4"):
        assert np.array_equal(read_scattered(path, particles=name).points, data["Coordinates"])
    with pytest.raises(ss.InvalidInput, match="no group .*PartType5.*but PartType4"):
        read_scattered(path, particles="black holes")


def test_cells_of_a_moving_mesh_have_kernels_of_their_volumes(tmp_path):
    path, data = write_particles(tmp_path / "s.h5", leave_out=("SmoothingLength",), CenterOfMass=np.zeros((40, 3)))
    radius = np.cbrt(0.75 / math.pi * data["Masses"] / data["Density"])
    np.testing.assert_allclose(read_scattered(path).supports, 2.5 * radius)
    np.testing.assert_allclose(read_scattered(path, support=3).supports, 3 * radius)
    assert ss.open(path).size == 40
    path, _ = write_particles(
        tmp_path / "t.h5", leave_out=("SmoothingLength",), Volume=np.ones(40), Density=np.zeros(40)
    )
    with pytest.raises(ss.InvalidInput, match="densities of 0"):
        read_scattered(path)


def test_a_part_of_a_snapshot_is_told(tmp_path, caplog):
    path, _ = write_particles(tmp_path / "s.0.hdf5")
    about(path, {"Header": {"NumFilesPerSnapshot": 8}})
    assert (
        read_scattered(path).details["part"] == "one file of 8 of a snapshot" and "others are not read" in caplog.text
    )


def test_cells_of_a_cutout_have_volumes_in_the_unit_of_length(tmp_path):
    path, data = write_particles(tmp_path / "cutout.hdf5", leave_out=("SmoothingLength",))
    about(
        path,
        {"Header": COSMOLOGY},
        Coordinates=arepo(1, 0, 0, 1, -1, 3.085678e21),
        Masses=arepo(0, 1, 0, 0, -1, 1.989e43),
        Density=arepo(-3, 1, 0, -3, 2, 1.989e43 / 3.085678e21**3),
    )
    radius = np.cbrt(0.75 / math.pi * data["Masses"] / data["Density"])
    np.testing.assert_allclose(read_scattered(path).supports, 2.5 * radius, rtol=1e-6)
    # Physical densities in g/cm³, masses in 10¹⁰ M☉/h, positions in ckpc/h: the volumes are what they were.
    factor = 1.989e43 / 3.085678e21**3 * 0.7**2 * 0.5**-3
    path, _ = write_particles(tmp_path / "b.hdf5", leave_out=("SmoothingLength",), Density=data["Density"] * factor)
    about(
        path,
        {"Header": COSMOLOGY},
        Coordinates=arepo(1, 0, 0, 1, -1, 3.085678e21),
        Masses=arepo(0, 1, 0, 0, -1, 1.989e43),
        Density=arepo(-3, 1, 0, 0, 0, 1.0),
    )
    np.testing.assert_allclose(read_scattered(path).supports, 2.5 * radius, rtol=1e-6)


def test_a_scalar_is_a_density_or_a_mass_or_asked_for(tmp_path):
    path, data = write_particles(tmp_path / "a.h5", leave_out=("Density",))
    assert read_scattered(path).scalar == "Masses"
    gone = ("Density", "Masses")
    path, _ = write_particles(tmp_path / "b.h5", leave_out=gone, group="PartType1", header={"MassTable": [0, 2.5, 0]})
    read = read_scattered(path, particles="dm")
    assert read.scalar == "Masses" and (read.values == 2.5).all() and "ParticleIDs" in read.scalars
    path, _ = write_particles(tmp_path / "c.h5", leave_out=gone, header={"MassTable": [0.0, 2.5]})
    with pytest.raises(
        ss.InvalidInput, match="no densities or masses in PartType0, but ParticleIDs, .*Velocities_x"
    ) as caught:
        read_scattered(path)
    assert caught.value.option == "scalar"
    assert np.array_equal(read_scattered(path, scalar="ParticleIDs").values, np.arange(40))


def test_particles_behind_a_user_block(tmp_path):
    data = {"Coordinates": np.random.default_rng(1).random((40, 3)), "Density": np.arange(40.0)}
    for size, version in ((512, "earliest"), (4096, "latest")):
        with h5py.File(tmp_path / "a.h5", "w", userblock_size=size, libver=version) as file:
            for name, values in (data | {"SmoothingLength": np.ones(40)}).items():
                file[f"PartType0/{name}"] = values
        read = read_scattered(tmp_path / "a.h5")
        assert np.array_equal(read.points, data["Coordinates"]) and np.array_equal(read.values, data["Density"])
        packed = stored(tmp_path / "a.h5.gz", (tmp_path / "a.h5").read_bytes(), gz=True)
        assert np.array_equal(read_scattered(packed).points, data["Coordinates"])
