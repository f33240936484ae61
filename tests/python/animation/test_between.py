"""Frames between snapshots of particles: paths, masses, units of time, and what is refused."""

import h5py
import numpy as np
import pytest
from command_line import run

import sheetsplat as ss
from sheetsplat.io.particle_motion import age, read_motion
from sheetsplat.quantity import time_of, time_text

COUNT = 150
CAMERA = ss.Camera.orthographic((0, 0, 50), (0, 0, 0), height=7)
LOOK = {"mode": "xray", "size": 48, "backend": "cpu", "camera": CAMERA, "clim": (0, 4), "slice_spacing": 0.05}


def orbits(time, rng):
    """Return places and velocities of particles on inclined circles, at a time; half a turn takes about 3."""
    radius, phase, tilt = rng.uniform(1.0, 2.5, COUNT), rng.uniform(0, 7, COUNT), rng.uniform(-0.4, 0.4, COUNT)
    speed = radius**-0.5
    angle = phase + speed / radius * time
    turned = np.column_stack([np.cos(angle), np.sin(angle) * np.cos(tilt), np.sin(angle) * np.sin(tilt)])
    ahead = np.column_stack([-np.sin(angle), np.cos(angle) * np.cos(tilt), np.cos(angle) * np.sin(tilt)])
    return radius[:, None] * turned, speed[:, None] * ahead


def snapshot(time):
    places, velocities = orbits(time, np.random.default_rng(5))
    # Sizes and densities of equal masses breathe.
    sizes = 0.35 * (1 + 0.2 * np.sin(time + np.arange(COUNT)))
    field = ss.EllipsoidField(places, sizes, values=sizes**-3, normalization="none")
    return ss.Snapshot(field, np.arange(COUNT) + 100, velocities, time)


def decibels(image, true):
    return 10 * np.log10(np.ptp(true.scalar) ** 2 / np.mean((image.scalar - true.scalar) ** 2))


def mass(field):
    weights = 1.0 if field.weights is None else field.weights
    return float((weights * field.values * field.scales**3).sum())


def test_a_left_out_snapshot_of_orbits():
    first, middle, last = (snapshot(time) for time in (0.0, 0.8, 1.6))
    true = ss.render(middle.field, **LOOK)
    film = ss.animate([first, last], between=1, **LOOK)
    assert len(film) == 3
    ends = [ss.render(one.field, **LOOK).scalar for one in (first, last)]
    # The ends are the snapshots.
    assert all(np.allclose(film[n].scalar, one, atol=1e-5) for n, one in zip((0, 2), ends, strict=True))
    faded = 10 * np.log10(np.ptp(true.scalar) ** 2 / np.mean((0.5 * (ends[0] + ends[1]) - true.scalar) ** 2))
    assert decibels(film[1], true) > faded + 6.0
    places = first.towards(last, 0.5).centers
    straight = 0.5 * (first.field.centers + last.field.centers)
    off = [np.abs(one - middle.field.centers).max() for one in (places, straight)]
    assert off[0] < 0.02 and off[1] > 0.25


def test_mass_stays():
    first, last = snapshot(0.0), snapshot(1.0)
    found = [mass(first.towards(last, share)) for share in np.linspace(0, 1, 9)]
    assert np.allclose(found, COUNT, rtol=1e-6)
    film = ss.animate([first, last], between=3, **LOOK)
    shown = [one.scalar.sum() for one in film]
    assert np.allclose(shown, shown[0], rtol=0.02)


def test_particles_that_appear_and_vanish_fade():
    first, last = snapshot(0.0), snapshot(1.0)
    some = ss.Snapshot(last.field.part(np.arange(10, COUNT)), last.ids[10:], last.velocities[10:], last.time)
    half = first.towards(some, 0.25)
    assert half.size == COUNT and np.allclose(half.weights[-10:], 0.75)
    assert np.allclose(half.centers[-10:], first.field.centers[:10] + 0.25 * first.velocities[:10])
    back = some.towards(ss.Snapshot(first.field, first.ids, first.velocities, 2.0), 0.25)
    assert np.allclose(back.weights[-10:], 0.25)
    assert mass(some.towards(ss.Snapshot(first.field, first.ids, first.velocities, 2.0), 1.0)) == pytest.approx(COUNT)


def test_a_periodic_box():
    box = ((0, 0, 0), (10, 10, 10))
    one = ss.Snapshot(ss.EllipsoidField([(9.5, 5, 5)], 1.0, values=[1.0], periodic=box), [1], [(1, 0, 0)], 0.0)
    other = ss.Snapshot(ss.EllipsoidField([(0.5, 5, 5)], 1.0, values=[1.0], periodic=box), [1], [(1, 0, 0)], 1.0)
    assert np.allclose(one.towards(other, 0.25).centers, [(9.75, 5, 5)])
    assert np.allclose(one.towards(other, 0.75).centers, [(0.25, 5, 5)])


def test_numbers_beyond_those_of_float64_are_told_apart():
    one, other = snapshot(0.0), snapshot(1.0)
    large = ss.Snapshot(one.field, np.arange(COUNT, dtype=np.uint64) + np.uint64(2**63), one.velocities, 0.0)
    with pytest.raises(ss.InvalidInput, match="no particle in both"):
        large.towards(other, 0.5)
    # The same bits with a sign and without one.
    signed = ss.Snapshot(other.field, large.ids.astype(np.int64), other.velocities, 1.0)
    assert np.allclose(large.towards(signed, 0.3).centers, one.towards(other, 0.3).centers)


def test_weights_of_means_stay_with_their_particles():
    first, last = (
        ss.Snapshot(one.field.weighted_by(np.arange(COUNT) + 1.0), one.ids, one.velocities, one.time)
        for one in (snapshot(0.0), snapshot(1.0))
    )
    assert np.allclose(first.towards(last, 0.5).weighting, np.arange(COUNT) + 1.0)
    with pytest.raises(ss.InvalidInput, match="weights of means in one alone"):
        first.towards(snapshot(1.0), 0.5)


def test_values_far_apart_have_values_between():
    field = ss.EllipsoidField([(0, 0, 0)], 1.0, values=[1e-300])
    ends = [ss.Snapshot(field, [1], [(0, 0, 0)], 0.0),
            ss.Snapshot(ss.EllipsoidField([(0, 0, 0)], 1.0, values=[1e300]), [1], [(0, 0, 0)], 1.0)]  # fmt: skip
    assert ends[0].towards(ends[1], 0.5).values[0] == pytest.approx(1.0)
    assert [ends[0].towards(ends[1], share).values[0] for share in (0.0, 1.0)] == [1e-300, 1e300]


def test_particles_that_are_left_out_of_one_file_fade(tmp_path):
    paths = [tmp_path / f"{n}.hdf5" for n in range(2)]
    for n, path in enumerate(paths):
        write(path, float(n), *orbits(float(n), np.random.default_rng(5)), np.arange(COUNT))
    with h5py.File(paths[1], "r+") as file:
        file["PartType0/Coordinates"][0] = np.nan
        file["PartType0/Velocities"][1] = np.nan
        velocities = file["PartType0/Velocities"][...]
    with pytest.raises(ss.InvalidInput, match=r'velocity of particle 1; .* nan="skip"'):
        ss.Snapshot(ss.open(paths[0]), np.arange(COUNT), velocities, 1.0)
    with pytest.warns(ss.PictureWarning, match="1 of 150 rows"):
        last = ss.Snapshot.read(paths[1], nan="skip")
    assert last.ids.tolist() == list(range(9, COUNT + 7))
    between = ss.Snapshot.read(paths[0]).towards(last, 0.25)
    weights = np.sort(between.weights)
    assert between.size == COUNT and np.allclose(weights[:3] / weights[2], (0.75, 0.75, 1.0), rtol=1e-4)


def write(path, time, places, velocities, order, header=None, cosmology=None):
    with h5py.File(path, "w") as file:
        file.create_group("Header").attrs.update({"Time": time, **(header or {})})
        if cosmology:
            file.create_group("Parameters").attrs.update(cosmology)
        group = file.create_group("PartType0")
        group["Coordinates"], group["Velocities"] = places[order], velocities[order]
        group["ParticleIDs"] = (np.arange(len(places)) + 7)[order]
        group["SmoothingLength"] = np.full(len(places), 0.5)
        group["Density"], group["Masses"] = np.full(len(places), 2.0), np.full(len(places), 0.1)


def test_files_in_any_order_of_their_particles(tmp_path):
    rng = np.random.default_rng(5)
    paths = [tmp_path / f"{n}.hdf5" for n in range(3)]
    for n, path in enumerate(paths):
        write(path, 0.8 * n, *orbits(0.8 * n, np.random.default_rng(5)), rng.permutation(COUNT))
    look = {**LOOK, "clim": None}
    film = ss.animate([paths[0], paths[2]], between=1, **look)
    true, faded = ss.render(paths[1], **look), 0.5 * (film[0].scalar + film[2].scalar)
    best = 10 * np.log10(np.ptp(true.scalar) ** 2 / np.mean((faded - true.scalar) ** 2))
    assert decibels(film[1], true) > best + 6.0
    assert mass(ss.Snapshot.read(paths[0]).towards(ss.Snapshot.read(paths[2]), 0.4)) == pytest.approx(
        mass(ss.open(paths[0])), rel=1e-6
    )
    options = ("--mode", "xray", "--size", "24", "--backend", "cpu")
    run("animate", paths[0], paths[2], "--between", "1", "-o", tmp_path / "film", *options)
    assert len(list((tmp_path / "film").iterdir())) == 3


def test_the_time_of_cosmological_runs(tmp_path):
    # Without curvature and Λ the age is 2 / (3 H); of the usual universe today 0.964 / H.
    hubble = 0.7 * 1e7 / 3.0856775814913673e24
    assert age(0.25, 0.7, 1.0, 0.0) == pytest.approx(2 / 3 * 0.25**1.5 / hubble, rel=1e-9)
    assert age(1.0, 0.7, 0.3, 0.7) == pytest.approx(0.96410 / hubble, rel=1e-4)
    # A particle of 100 km/s √a at a = 0.25, in comoving kpc/h: dx/dt = u √a / a.
    units = {"UnitLength_in_cm": 3.0857e21, "UnitMass_in_g": 1.989e43, "UnitVelocity_in_cm_per_s": 1e5}
    header = {"Redshift": 3.0, "Omega0": 0.3, "OmegaLambda": 0.7, "HubbleParam": 0.7, "BoxSize": 1e4, **units}
    write(tmp_path / "a.hdf5", 0.25, np.full((1, 3), 500.0), np.full((1, 3), 100.0), [0], header)
    motion = read_motion(tmp_path / "a.hdf5")
    assert motion.velocities[0, 0] == pytest.approx(100e5 * 0.25**0.5 / (3.0857e21 * 0.25 / 0.7), rel=1e-6)
    assert motion.time == pytest.approx(age(0.25, 0.7, 0.3, 0.7)) and motion.unit == "s"


def test_figures_of_frames_tell_their_time(tmp_path):
    first, last = snapshot(0.0), snapshot(1.0)
    timed = [ss.Snapshot(one.field, one.ids, one.velocities, one.time, "Myr") for one in (first, last)]
    film = ss.animate(timed, between=3, **LOOK)
    times = [one.recipe.fields[0].quantity.time for one in film]
    assert times == ["t = 0 Myr", "t = 0.25 Myr", "t = 0.5 Myr", "t = 0.75 Myr", "t = 1 Myr"]
    assert first.towards(last, 0.5).quantity.time == "t = 0.5"
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    assert film[1].to_axes().get_title() == "t = 0.25 Myr"
    # Whoever gives a title has that.
    assert film[1].to_axes(title="$x$").get_title() == "$x$" and film[1].to_axes(title="").get_title() == ""
    assert film[1].annotated().size[1] > film[1].annotated(title="").size[1]
    # Files of the same.
    for n, path in enumerate((tmp_path / "0.hdf5", tmp_path / "1.hdf5")):
        write(path, 0.8 * n, *orbits(0.8 * n, np.random.default_rng(5)), np.arange(COUNT))
    film = ss.animate([tmp_path / "0.hdf5", tmp_path / "1.hdf5"], between=1, **LOOK)
    assert [one.recipe.fields[0].quantity.time for one in film] == ["t = 0", "t = 0.4", "t = 0.8"]
    film.save(tmp_path / "film")
    assert ss.Recipe.read(tmp_path / "film" / "frame_0001.png").fields[0].quantity.time == "t = 0.4"
    with pytest.raises(ss.InvalidInput, match="unit.*wanted a printable text"):
        ss.Snapshot(first.field, first.ids, first.velocities, 0.0, 3)


def test_times_as_texts():
    year = 365.25 * 86400
    assert time_text(0.1 + 0.2) == "t = 0.3" and time_text(12.0, "s") == "t = 12 s"
    assert time_text(13.8e9 * year, "s") == "t = 13.8 Gyr" and time_text(2.5e6 * year, "s") == "t = 2.5 Myr"
    assert time_text(13.8e9 * year, "days") == "t = 4.3549e+17 days"
    quantities = [ss.Quantity(time="t = 1"), ss.Quantity(), ss.Quantity(time="t = 1")]
    assert time_of(quantities) == "t = 1" and time_of([*quantities, ss.Quantity(time="t = 2")]) == ""
    with pytest.raises(ss.InvalidInput, match="Quantity: time"):
        ss.Quantity(time="a\nb")


def test_what_is_refused(tmp_path):
    first, last = snapshot(0.0), snapshot(1.0)
    for words, snapshots in {
        "rise": [last, first],
        "no particle in both": [first, ss.Snapshot(last.field, last.ids + 1000, last.velocities, 1.0)],
    }.items():
        with pytest.raises(ss.InvalidInput, match=words):
            _ = ss.animate(snapshots, between=1, **LOOK)[1]
    with pytest.raises(ss.InvalidInput, match="two particles of one number"):
        ss.Snapshot(first.field, np.zeros(COUNT, int), first.velocities, 0.0)
    with pytest.raises(ss.InvalidInput, match="at least two snapshots"):
        ss.animate([np.zeros((3, 3, 3))] * 2, between=1)
    with pytest.raises(ss.InvalidInput, match="frames as well"):
        ss.animate([first, last], 10, between=1)
    with h5py.File(tmp_path / "a.hdf5", "w") as file:
        file["PartType0/Coordinates"], file["PartType0/SmoothingLength"] = np.zeros((2, 3)), np.ones(2)
        file["PartType0/Masses"] = np.ones(2)
    with pytest.raises(ss.InvalidInput, match="ParticleIDs"):
        ss.Snapshot.read(tmp_path / "a.hdf5")
