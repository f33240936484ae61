"""Values of many decades: when a picture shows their logarithm, how it says so, and who decides."""

import logging

import numpy as np
import pytest
from command_line import run

import sheetsplat as ss
from sheetsplat.choose.look import compose_scene
from sheetsplat.fit._kernels import unit_mass
from sheetsplat.look.decades import floor_of, in_decades, itself, logarithmic

SMALL = {"size": (32, 32), "backend": "cpu"}


def galaxy(rng, count=3000):
    """Return a disk of dense small kernels in a halo of thin large ones, seven decades apart."""
    disk = rng.normal(size=(count, 3)) * (3, 3, 0.3)
    halo = rng.normal(size=(count, 3)) * 100
    values = np.concatenate([10 ** rng.uniform(6, 7, count), 10 ** rng.uniform(0, 2, count)])
    return ss.EllipsoidField(np.concatenate([disk, halo]), np.repeat((0.8, 40.0), count), values=values)


def lognormal(rng, sigma=5.0, size=24):
    """Return a smooth volume whose logarithms are spread normally."""
    spectrum = np.fft.rfftn(rng.normal(size=(size, size, size)))
    waves = np.meshgrid(np.fft.fftfreq(size), np.fft.fftfreq(size), np.fft.rfftfreq(size), indexing="ij")
    smooth = np.fft.irfftn(spectrum * np.exp(-40 * sum(wave**2 for wave in waves)))
    return np.exp(sigma * smooth / smooth.std()).astype(np.float32)


def test_densities_of_many_decades_are_shown_as_logarithms(rng, caplog):
    field = galaxy(rng)
    caplog.set_level(logging.INFO, "sheetsplat")
    image = ss.render(field.with_quantity("density", "kg"), **SMALL)
    floor = image.recipe.fields[0].quantity.floor
    assert floor == pytest.approx(1.0, rel=0.5)
    note = f"log10(density / {floor:g}) is shown"
    assert image.plan.notes == (note,) and note in str(image.plan) and note in caplog.text
    assert image.plan.to_dict()["notes"] == [note]
    # Colours are over the disk, which fills the picture.
    low, high = image.clim
    assert 2 < low < 6.5 and 6.5 < high <= 7.5
    alpha = image.rgba[..., 3] > 0.1
    assert alpha.mean() > 0.03 and image.camera.height < 60
    # As when the logarithm is asked for.
    asked = in_decades([field], {}, None)[0]
    assert np.allclose(asked.values, np.log10(np.maximum(field.values / floor, 1)))
    assert asked.opened["log"] == floor


def test_volumes_of_many_decades(rng):
    values = lognormal(rng, sigma=8.0)
    assert floor_of(ss.RegularField(values)) == pytest.approx(np.percentile(values, 0.1), rel=0.01)
    shown = in_decades([ss.RegularField(values, spacing=(1, 2, 3), radius=2.5, falloff=7, prefilter=True)], {}, None)[0]
    assert shown.prefilter and shown.spacing == (1, 2, 3) and shown.values.dtype == np.float32
    assert shown.values.max() == pytest.approx(np.log10(values.max() / shown.quantity.floor), rel=1e-5)
    skipped = np.where(values > np.percentile(values, 98), np.nan, values)
    kept = in_decades([ss.RegularField(skipped, nan="skip")], {}, None)[0]
    assert np.array_equal(np.isnan(kept.values), np.isnan(skipped))


@pytest.mark.parametrize("kind", ["narrow", "outliers", "integers", "negative", "zeros", "sums", "constant", "empty"])
def test_what_is_not_spread_over_decades_stays(rng, kind):
    values = lognormal(rng)
    if kind == "narrow":
        values = lognormal(rng, sigma=0.5)
    elif kind == "outliers":
        values = lognormal(rng, sigma=0.5)
        values[3, 4, 5] = 1e9
    elif kind == "integers":
        values = np.minimum(values, 60000).astype(np.uint16)
    elif kind == "negative":
        values = values - 1
    elif kind == "zeros":
        values = np.where(rng.random(values.shape) < 0.6, 0, values)
    elif kind == "constant":
        values = np.full((4, 4, 4), 3.0)
    elif kind == "empty":
        values = np.full((4, 4, 4), np.nan)
    more = {"normalization": "none"} if kind == "sums" else {"nan": "skip"}
    field = ss.RegularField(values, **more)
    assert in_decades([field], {}, None) == [field]


def test_what_was_given_wins(rng):
    field = galaxy(rng)
    function = ss.TransferFunction([(1e5, 0, 0, 0, 0), (1e7, 1, 1, 1, 0.5)])
    for look in (
        {"clim": (1e5, 1e7)},
        {"transfer_function": function},
        {"mode": "isosurface", "iso_value": 1e6},
        {"opacity": [(1e5, 0), (1e7, 0.5)]},
        {"mode": "mip"},
    ):
        assert in_decades([field], look, None) == [field]
    assert in_decades([field], {}, False) == [field] and in_decades([field, field], {}, None) == [field, field]
    assert in_decades([field], {"opacity": 0.5}, None) != [field]


def test_no_logarithm_on_request(rng, tmp_path):
    field = galaxy(rng, 500)
    path = tmp_path / "g.npz"
    ss.io.save_npz(field, path)
    assert ss.render(path, **SMALL).plan.notes
    with pytest.warns(ss.PictureWarning, match="log"):
        assert not ss.render(path, log=False, **SMALL).plan.notes
    assert np.array_equal(ss.open(path).values, field.values)
    assert ss.render(path, log=10.0, **SMALL).recipe.fields[0].quantity.floor == 10.0


def test_the_command_says_so(rng, tmp_path):
    path = tmp_path / "g.npz"
    ss.io.save_npz(galaxy(rng, 300), path)
    options = ("render", path, "--size", "24", "--backend", "cpu", "-o")
    assert "log10(values / " in run(*options, tmp_path / "a.png").stderr
    assert "log10" not in run(*options, tmp_path / "b.png", "--no-log").stderr.replace("log=", "")
    # A picture says how it was made, and is made again alike.
    run("render", tmp_path / "a.png", path, "-o", tmp_path / "c.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "c.png").read_bytes()


@pytest.mark.data
def test_the_galaxy_shows_its_disk(data_dir):
    path = data_dir / "sph_gas_nchilada12M.h5"
    if not path.exists():
        pytest.skip(f"{path} is not there")
    field = in_decades([ss.open(path)], {}, None)[0]
    scene = compose_scene([field])
    camera = ss.render(scene, size=(48, 48), backend="cpu").camera
    # The disk has a radius of about 10, the box of 1,900.
    assert scene.transfer_function.v_min > 4 and camera.height < 80


@pytest.mark.parametrize("mode", ["xray", "mip", "average"])
def test_small_dense_kernels_set_the_slices_of_pictures_of_numbers(rng, mode):
    # As SPH has them: most kernels are large and faint, and a few small ones make what is seen.
    halo, disk = rng.normal(size=(900, 3)) * 40, rng.normal(size=(300, 3)) * (3, 3, 0.3)
    scales = np.concatenate([np.full(900, 20.0), np.full(300, 0.4)])
    values = np.concatenate([np.full(900, 1e-3), np.full(300, 100.0)])
    field = ss.EllipsoidField(np.concatenate([halo, disk]), scales, values=values)
    camera = ss.Camera.orthographic((150, 120, 180), (0, 0, 0), height=38)
    look = {"mode": mode, "size": (48, 48), "backend": "cpu", "camera": camera}
    image = ss.render(field, **look)
    assert image.plan.slice_spacing == pytest.approx(0.2) and field.default_slice_spacing == 10
    finest = ss.render(field, slice_spacing=0.02, **look).scalar
    usual = ss.render(field, slice_spacing=10, **look)
    assert usual.plan.slice_spacing == 10
    near, far = (float(np.sqrt(np.mean((one.scalar - finest) ** 2))) for one in (image, usual))
    assert near < 0.03 * finest.max() and near < 0.2 * far
    # Kernels of one size keep the default.
    even = ss.EllipsoidField(halo, 20.0, values=rng.random(900))
    assert ss.render(even, **look).plan.slice_spacing == even.default_slice_spacing


def test_the_logarithm_of_an_array_is_drawn(rng):
    values = 10.0 ** rng.uniform(-2, 3, (9, 8, 7))
    image = ss.render(values, log=True, size=(16, 12))
    (made,) = image.recipe.fields
    assert made.quantity.floor == values.min() and made.opened["log"] == values.min()
    assert ss.render(values, log=0.5, size=(16, 12)).recipe.fields[0].quantity.floor == 0.5
    values[2, 3, 4] = np.nan
    assert ss.render(values, log=True, nan="skip", size=(16, 12)).rgba.any()
    with pytest.raises(ss.InvalidInput, match="not above 0"):
        ss.render(values - 1.0, log=True, nan="skip", size=(16, 12))


def blobs(rng, size=24):
    """Return a volume of three decades that ends in its lowest value, and the mass in it."""
    z, y, x = np.mgrid[-1 : 1 : size * 1j, -1 : 1 : size * 1j, -1 : 1 : size * 1j]
    values = (1e-2 + 20.0 * np.exp(-12.0 * (x**2 + 1.5 * y**2 + z**2))).astype(np.float32)
    return values, float(values.sum(dtype=np.float64))


def particles(rng, count=60):
    """Return kernels of masses that go over decades, and their sum."""
    sizes = rng.uniform(0.2, 0.4, count)
    masses = 10 ** rng.uniform(0, 3, count)
    values = masses / (unit_mass(8.0) * sizes**3)
    return ss.EllipsoidField(rng.normal(size=(count, 3)), sizes, values=values, normalization="none"), masses.sum()


def shown_mass(image):
    width, height = image.size
    return float(image.scalar.sum(dtype=np.float64)) * (image.camera.height / height) ** 2


def test_sums_along_rays_are_of_the_values_and_never_of_their_logarithms(rng, tmp_path):
    volume, volume_mass = blobs(rng)
    kernels, kernel_mass = particles(rng)
    np.save(tmp_path / "v.npy", volume)
    ss.io.save_npz(kernels, tmp_path / "k.npz")
    look = {"mode": "xray", "size": 160, "backend": "cpu", "quality": "best"}
    for path, mass in ((tmp_path / "v.npy", volume_mass), (tmp_path / "k.npz", kernel_mass)):
        look["camera"] = ss.Camera.fit(ss.open(path), "-x", "z")
        # As an option of the picture, with a number or without, and as one of the field.
        for data, log in ((path, True), (path, 5.0), (ss.open(path, log=True, quality="best"), None)):
            image = ss.render(data, **look, **({} if log is None else {"log": log}))
            assert shown_mass(image) == pytest.approx(mass, rel=1e-3)
            assert image.recipe.options["scalar_colors"].log and not image.plan.notes
    # Without logarithms the colours are those of the sums; a scale that was given stays.
    assert not ss.render(tmp_path / "v.npy", **look).recipe.options["scalar_colors"].log
    assert not ss.render(tmp_path / "v.npy", log=True, log_scale=False, **look).recipe.options["scalar_colors"].log


def test_means_along_rays_are_of_the_values(rng):
    values = np.full((6, 8, 8), 1.0)
    values[:3] = 100.0
    image = ss.render(values, log=True, mode="average", direction="-z", size=24, backend="cpu", quality="best")
    assert image.scalar[12, 12] == pytest.approx(50.5, rel=1e-3)


def test_raised_values_cannot_be_taken_back(rng):
    kernels, _ = particles(rng)
    raised = logarithmic(ss.RegularField(blobs(rng)[0]), 1.0)
    with pytest.raises(ss.InvalidInput, match="raised to 1"):
        ss.render(raised, mode="xray", size=8)
    low = logarithmic(kernels, float(kernels.values.min()) / 2)
    assert np.allclose(itself(low).values, kernels.values, rtol=1e-12)
    with pytest.raises(ss.InvalidInput, match="log_scale"):
        ss.Scene(low, [(0, 0, 0, 0, 0), (1, 1, 1, 1, 1)], mode="xray")


def test_films_add_up_values(rng):
    values, mass = blobs(rng)
    camera = ss.Camera.fit(ss.RegularField(values), "-x", "z")
    film = ss.animate(
        [values, 2 * values], mode="xray", log=True, camera=camera, size=96, backend="cpu", quality="best"
    )
    first, second = film[0], film[1]
    assert shown_mass(first) == pytest.approx(mass, rel=1e-3)
    assert shown_mass(second) == pytest.approx(2 * mass, rel=1e-3)
    assert first.recipe.options["scalar_colors"].log
