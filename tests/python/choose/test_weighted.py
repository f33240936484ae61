"""Weighted means along rays: what they are of volumes and of kernels, by name, and what is refused."""

import h5py
import numpy as np
import pytest
from command_line import run

import sheetsplat as ss
from sheetsplat.fit._kernels import profile

N = 24
Z, Y, X = np.mgrid[-1 : 1 : N * 1j, -1 : 1 : N * 1j, -1 : 1 : N * 1j]
# Density and temperature of a cloud.
RHO = np.exp(-3.0 * (X**2 + Y**2 + Z**2))
T = 300.0 + 50.0 * np.cos(3.0 * Z) * np.cos(X) + 40.0 * Y
#: Each pixel's centre is a column of samples, row 0 at the largest y.
ALONG = ss.Camera.orthographic((N / 2 - 0.5, N / 2 - 0.5, 99), (N / 2 - 0.5, N / 2 - 0.5, 0), height=N)
LOOK = {"mode": "average", "size": N, "backend": "cpu", "camera": ALONG}
ONE_OF_A_PIXEL = {"supersampling": 1}


def of_samples(q, w):
    return ((w * q).sum(0) / w.sum(0))[::-1]


def test_a_volume_has_the_mean_of_its_columns():
    exact = of_samples(T, RHO)
    plain = ss.render(T, **LOOK).scalar
    weighted = ss.render(T, weight=RHO, **ONE_OF_A_PIXEL, **LOOK).scalar
    assert np.abs(plain - exact).max() > 1.0
    assert np.abs(weighted - exact).max() < 1e-4 * np.ptp(T)
    # Densities in g/cm³, and weights whose sums would fall below 0 between samples.
    assert np.allclose(ss.render(T, weight=1e-27 * RHO, **ONE_OF_A_PIXEL, **LOOK).scalar, weighted, rtol=1e-6)
    steep = 1e-6 + np.where(RHO > 0.6, RHO, 0.0)
    found = ss.render(T, weight=steep, **ONE_OF_A_PIXEL, **LOOK).scalar
    assert np.isfinite(found).all() and found.min() >= T.min() and found.max() <= T.max()
    # Plain sums, at points of three columns: over the cloud, at its rim and beside it.
    for row, column in ((12, 12), (12, 18), (3, 3)):
        depths = (np.arange(240) + 0.5) / 10 - 0.5
        points = np.column_stack([np.full(240, column), np.full(240, N - 1 - row), depths])
        product, weight = (ss.RegularField(one, base=0.0).at(points).sum() for one in (steep * T, steep))
        assert found[row, column] == pytest.approx(product / weight, rel=1e-3)


@pytest.mark.parametrize("backend", ["cpu", "reference"])
def test_the_mean_of_a_constant_is_the_constant(backend, rng):
    field = ss.RegularField(np.full((8, 8, 8), 7.25)).weighted_by(10 ** rng.uniform(-4, 4, (8, 8, 8)))
    image = ss.render(field, mode="average", size=16, backend=backend, clim=(0, 10))
    known = image.scalar[~np.isnan(image.scalar)]
    assert known.size and np.allclose(known, 7.25, rtol=1e-6) and np.isnan(image.scalar).any()


def test_kernels_have_the_mean_of_their_line_integrals(rng):
    centers, radii = rng.normal(size=(40, 3)), rng.uniform(0.6, 1.2, 40)
    values, weights, density = rng.uniform(10, 20, 40), rng.uniform(0.5, 2, 40), 10 ** rng.uniform(-2, 2, 40)
    field = ss.EllipsoidField(centers, radii, values=values, weights=weights)
    camera = ss.Camera.orthographic((0, 0, 50), (0, 0, 0), height=8)
    image = ss.render(
        field, weight=ss.EllipsoidField(centers, radii, values=density), mode="average", size=33, camera=camera,
        backend="cpu", filter="off", supersampling=1, slice_spacing=0.02,
    )  # fmt: skip
    # The line integral of each kernel through the middle of each pixel, by the midpoint rule.
    at = (np.arange(33) + 0.5) / 33 * 8 - 4
    px, py = np.meshgrid(at, -at)
    depth = (np.arange(2000) + 0.5) / 1000 - 1
    sums = np.zeros((2, 33, 33))
    for (x, y, _), radius, q, m, w in zip(centers, radii, values, weights, density, strict=True):
        aside = ((px - x) ** 2 + (py - y) ** 2)[..., None] / radius**2
        integral = radius * profile(np.minimum(aside + depth**2, 1.0), 8.0).mean(axis=-1)
        sums += integral * np.array([m * w * q, m * w])[:, None, None]
    there = sums[1] > 1e-4 * sums[1].max()
    assert there.sum() > 200
    assert np.abs(image.scalar[there] - sums[0][there] / sums[1][there]).max() < 1e-3 * 10
    assert np.isnan(image.scalar[sums[1] == 0]).all() and (sums[1] == 0).any()


def test_weights_lie_where_the_values_do():
    turned = np.linalg.qr(np.array(((0.8, -0.3, 0.4), (0.2, 0.9, -0.3), (-0.5, 0.3, 0.7))))[0]
    field = ss.RegularField(T, origin=(5e6, 0, 0))
    # Of the same spacing, turned, and two samples beside it.
    for place in ({"axes": turned, "origin": (5e6, 0, 0)}, {"origin": (5e6 + 2, 0, 0)}):
        with pytest.raises(ss.InvalidInput, match="lies as"):
            field.weighted_by(ss.RegularField(RHO, **place))
    assert field.weighted_by(ss.RegularField(RHO, axes=np.eye(3), origin=(5e6, 0, 1e-9))).weighting is not None


def test_names_of_weights_that_are_none_are_told_as_weights(tmp_path, rng):
    snapshot(tmp_path / "a.hdf5", rng)
    with pytest.raises(ss.InvalidInput, match=r"pass weight=\.\.\.") as caught:
        ss.open(tmp_path / "a.hdf5", scalar="Temperature", weight="Nope")
    assert "scalar=" not in str(caught.value)


def test_weights_go_with_the_values_that_they_are_of():
    field = ss.RegularField(T).weighted_by(RHO)
    assert field.replace(T + 1.0).weighting is not None and field.replace(T[:5]).weighting is None
    kernels = ss.EllipsoidField(np.eye(3), 1.0, values=[1, 2, 3]).weighted_by([3.0, 0.0, 5.0])
    assert kernels.part(np.array([2, 0])).weighting.tolist() == [5.0, 3.0]
    assert kernels.with_rows(np.eye(2, 3), np.ones(2), None, np.ones(2), None).weighting is None


def test_rows_without_a_weight_add_nothing(tmp_path, rng):
    energy = rng.uniform(1, 2, 300)
    look = {"mode": "average", "size": 24, "backend": "cpu", "weight": "InternalEnergy", "scalar": "Temperature"}
    energy[:20] = 0.0
    snapshot(tmp_path / "b.hdf5", np.random.default_rng(7), InternalEnergy=energy)
    energy[:20] = np.nan
    snapshot(tmp_path / "c.hdf5", np.random.default_rng(7), InternalEnergy=energy)
    wanted = ss.render(tmp_path / "b.hdf5", **look)
    with pytest.warns(ss.PictureWarning, match="20 of 300 rows"):
        found = ss.render(tmp_path / "c.hdf5", nan="skip", **look)
    assert np.array_equal(found.scalar, wanted.scalar, equal_nan=True)


def snapshot(path, rng, count=300, **more):
    """Write a snapshot of gas whose density falls outwards and whose temperature rises."""
    places = rng.normal(size=(count, 3))
    distance = np.linalg.norm(places, axis=1)
    with h5py.File(path, "w") as file:
        group = file.create_group("PartType0")
        group["Coordinates"], group["SmoothingLength"] = places, 0.3 + 0.2 * distance
        group["Density"], group["Masses"] = 10 ** (-distance), np.full(count, 1.0)
        group["Temperature"] = 1e4 * (1 + distance)
        for name, values in more.items():
            group[name] = values


def test_weights_by_their_name(rng, tmp_path):
    snapshot(tmp_path / "a.hdf5", rng)
    look = {"mode": "average", "size": 32, "backend": "cpu"}
    # In any case where one alone is meant.
    image = ss.render(tmp_path / "a.hdf5", scalar="Temperature", weight="density", **look)
    inner, plain = image.scalar[16, 16], ss.render(tmp_path / "a.hdf5", scalar="Temperature", **look).scalar[16, 16]
    assert 1e4 < inner < plain
    opened = ss.open(tmp_path / "a.hdf5", scalar="Temperature", weight="Density")
    assert np.array_equal(ss.render(opened, **look).scalar, image.scalar, equal_nan=True)
    # The picture says how it was made, and the command makes the same.
    image.save(tmp_path / "a.png")
    run("render", tmp_path / "a.png", tmp_path / "a.hdf5", "-o", tmp_path / "b.png")
    options = ("--mode", "average", "--scalar", "Temperature", "--weight", "Density", "--size", "32")
    run("render", tmp_path / "a.hdf5", *options, "--backend", "cpu", "-o", tmp_path / "c.npy")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert np.array_equal(np.load(tmp_path / "c.npy"), image.scalar, equal_nan=True)
    film = ss.animate([tmp_path / "a.hdf5"] * 2, scalar="Temperature", weight="density", **look)
    assert np.nanmax(np.abs(film[1].scalar / film[0].scalar - 1)) == 0 and film[0].scalar.min() != plain
    table = {"x": X.ravel(), "y": Y.ravel(), "z": Z.ravel(), "radius": np.full(X.size, 0.2), "t": T.ravel()}
    named = ss.render({**table, "rho": RHO.ravel()}, scalar="t", weight="rho", **look).scalar
    assert np.nanmin(named) >= T.min() and np.nanmax(named) <= T.max()


def test_weights_of_another_file(tmp_path):
    np.save(tmp_path / "t.npy", T)
    np.save(tmp_path / "rho.npy", RHO)
    image = ss.render(tmp_path / "t.npy", weight=tmp_path / "rho.npy", **ONE_OF_A_PIXEL, **LOOK)
    assert np.abs(image.scalar - of_samples(T, RHO)).max() < 1e-4 * np.ptp(T)
    with pytest.warns(ss.PictureWarning, match="weights"):
        image.save(tmp_path / "a.png")
    with pytest.raises(ss.InvalidInput):
        ss.Recipe.read(tmp_path / "a.png")
    options = ("--mode", "average", "--weight", tmp_path / "rho.npy", "--size", "24", "--direction", "-z", "--up", "y")
    run("render", tmp_path / "t.npy", *options, "-o", tmp_path / "x.npy")
    assert np.nanmean(np.load(tmp_path / "x.npy")) == pytest.approx(image.scalar.mean(), rel=0.01)


def test_what_weights_cannot_be(rng):
    field = ss.RegularField(T)
    wrong = {
        "lies as": ss.RegularField(RHO, spacing=(1, 1, 2)),
        "shape": RHO[1:],
        "at least 0": RHO - 0.5,
        "not all 0": 0 * RHO,
        "finite": np.where(RHO > 0.9, np.inf, RHO),
    }
    for words, weight in wrong.items():
        with pytest.raises(ss.InvalidInput, match=words):
            field.weighted_by(weight)
    kernels = ss.EllipsoidField(rng.normal(size=(5, 3)), 1.0, values=np.ones(5))
    with pytest.raises(ss.InvalidInput, match="lies as"):
        kernels.weighted_by(ss.EllipsoidField(rng.normal(size=(5, 3)), 1.0, values=np.ones(5)))
    with pytest.raises(ss.Unsupported, match="max_error"):
        ss.render(T, weight=RHO, max_error=1e-2, **LOOK)
    with pytest.raises(ss.Unsupported, match="cannot be estimated"):
        _ = ss.render(T, weight=RHO, **LOOK).error
    with pytest.raises(ss.Unsupported, match="2 fields"):
        ss.render([field.weighted_by(RHO), field], **LOOK)
    with pytest.warns(ss.PictureWarning, match="weight"):
        ss.render(T, weight=RHO, size=16, backend="cpu")
    assert field.weighted_by(RHO) != field and field.weighted_by(RHO).weighted_by(None) == field
