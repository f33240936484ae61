"""Sums along rays keep the mass of what they show: scattered kernels and volumes, at any size, and in bricks."""

from __future__ import annotations

import warnings

import h5py
import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat.fit._kernels import unit_mass
from sheetsplat.quality.lost import CAUSE

SIZES = (16, 20, 80, 400)


def clump(rng, falloff=4.133):
    """Return particles of one mass whose distances and sizes go over two decades, with their mass."""
    count = 2000
    away = rng.normal(size=(count, 3))
    radii = 10 ** rng.uniform(-1.5, 0.5, count)
    centers = away / np.linalg.norm(away, axis=1)[:, None] * radii[:, None]
    sizes = 0.3 * radii
    values = 1.0 / (unit_mass(falloff) * sizes**3)
    return ss.EllipsoidField(centers, sizes, values=values, normalization="none", falloff=falloff), float(count)


def particles(rng):
    """Return particles by `fit.sph`, as sums, with their mass."""
    count = 1500
    centers, lengths = rng.normal(size=(count, 3)), 10 ** rng.uniform(-2, -0.5, count)
    fitted = ss.fit.sph(centers, np.ones(count), lengths, masses=np.ones(count), densities=np.ones(count))
    weights = np.asarray(fitted.weights)
    field = ss.EllipsoidField(
        centers, fitted.scales, values=weights, normalization="none", falloff=fitted.falloff, base=0.0
    )
    return field, float(count)


def ellipsoids(rng):
    count, falloff = 600, 8.0
    scales, masses = 10 ** rng.uniform(-2.5, -0.5, (count, 3)), rng.uniform(0.5, 1.5, count)
    turns = rng.normal(size=(count, 4))
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    values = masses / (unit_mass(falloff) * scales.prod(axis=1))
    field = ss.EllipsoidField(rng.uniform(-2, 2, (count, 3)), scales, turns, values, normalization="none")
    return field, float(masses.sum())


SCENES = {"clump": clump, "particles": particles, "ellipsoids": ellipsoids}


def ahead(height):
    return ss.Camera.orthographic((0.3, -0.2, 50), (0.3, -0.2, 0), height=height)


def shown(image):
    """Return the mass in a picture."""
    return float(image.scalar.sum(dtype=np.float64)) * (image.camera.height / image.size[1]) ** 2


@pytest.mark.parametrize("in_bricks", [False, True])
@pytest.mark.parametrize("name", SCENES)
def test_kernels_keep_their_mass(name, in_bricks):
    field, mass = SCENES[name](np.random.default_rng(4))
    data = ss.open_bricks(field, brick_kernels=300) if in_bricks else field
    for size in SIZES:
        image = ss.render(data, mode="xray", size=size, camera=ahead(12), backend="cpu")
        assert shown(image) == pytest.approx(mass, rel=0.01)
        assert image.plan.quality.of("filter").value == "ewa"


@pytest.mark.parametrize("in_bricks", [False, True])
def test_without_the_filter_it_is_lost_and_told(in_bricks):
    """The control of the test above."""
    field, mass = clump(np.random.default_rng(4))
    data = ss.open_bricks(field, brick_kernels=300) if in_bricks else field
    for options in ({"filter": "off"}, {"quality": "draft"}):
        for size in (16, 20, 80):
            with pytest.warns(ss.PictureWarning, match="% of the mass of its kernels"):
                image = ss.render(data, mode="xray", size=size, camera=ahead(12), backend="cpu", **options)
            lost = 1 - shown(image) / mass
            assert abs(lost) > 0.01
            error = image.error
            assert error.budget[CAUSE] >= 0.5 * abs(lost)
            assert error.rmse == pytest.approx(np.hypot.reduce(list(error.budget.values())), rel=1e-6)
            assert error.rmse == pytest.approx(np.sqrt(np.mean(error.map.astype(float) ** 2)), rel=1e-4)


def test_what_keeps_its_mass_is_not_told_of():
    field, _ = clump(np.random.default_rng(4))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        image = ss.render(field, mode="xray", size=20, camera=ahead(12), backend="cpu")
        assert CAUSE not in image.error.budget
        # Kernels of many pixels and slices need no filter.
        wide = ss.EllipsoidField(np.zeros((200, 3)), np.full(200, 2.0), values=np.ones(200), normalization="none")
        image = ss.render(wide, mode="xray", size=80, camera=ahead(8), slice_spacing=0.2, backend="cpu", filter="off")
        assert CAUSE not in image.error.budget
        image = ss.render(wide, mode="xray", size=80, camera=ahead(8), slice_spacing=0.2, backend="cpu")
        assert image.plan.quality.of("filter").value == "off"


@pytest.mark.parametrize("kind", ["whole", "bricks"])
def test_averages_take_the_filter_as_sums_do(kind):
    field, _ = clump(np.random.default_rng(4))
    data = field if kind == "whole" else ss.open_bricks(field, brick_kernels=300)
    image = ss.render(data, mode="average", size=20, camera=ahead(12), backend="cpu")
    assert image.plan.quality.of("filter").value == "ewa"


def lattice():
    n = 64
    z, y, x = np.mgrid[-1 : 1 : n * 1j, -1 : 1 : n * 1j, -1 : 1 : n * 1j]
    noise = np.random.default_rng(2).random((n, n, n))
    return np.maximum(noise * np.exp(-8 * (x * x + y * y + z * z)) - 0.001, 0).astype(np.float32)


@pytest.mark.parametrize("in_bricks", [False, True])
def test_volumes_seen_from_afar_keep_their_mass(in_bricks):
    values = lattice()
    data = ss.open_bricks(values, brick=32) if in_bricks else values
    camera = ss.Camera.orthographic((31.5, 31.5, 300), (31.5, 31.5, 31.5), height=100)
    for size in SIZES:
        image = ss.render(data, mode="xray", size=size, camera=camera, backend="cpu")
        assert shown(image) == pytest.approx(values.sum(dtype=float), rel=0.01)
        assert image.plan.quality.of("filter").value == ("ewa" if size < 100 else "off")
    with pytest.warns(ss.PictureWarning, match="samples of a volume wide"):
        image = ss.render(data, mode="xray", size=16, camera=camera, backend="cpu", filter="off")
    assert image.error.budget[CAUSE] >= 0.5 * abs(1 - shown(image) / values.sum(dtype=float))


def volume(kind):
    """Return samples that do not fall to 0 at the faces, or whose range has a middle that is far from most of them."""
    n = 48
    z, y, x = np.mgrid[-1 : 1 : n * 1j, -1 : 1 : n * 1j, -1 : 1 : n * 1j]
    r2 = x * x + y * y + z * z
    noise = np.random.default_rng(0).normal(size=r2.shape)
    return {
        "blob": np.exp(-12 * r2),
        "noisy": np.exp(-12 * r2) + 1e-3 * noise,
        "offset": 5 + np.exp(-6 * r2),
        "bytes": np.rint(200 * np.exp(-6 * r2)).astype(np.uint8),
        "signed": np.sin(3 * x) * np.exp(-3 * r2) + 0.2,
    }[kind]


@pytest.mark.parametrize(
    ("kind", "in_bricks"),
    [(kind, False) for kind in ("blob", "noisy", "offset", "bytes", "signed")] + [("blob", True), ("offset", True)],
)
def test_volumes_keep_their_mass_wherever_they_end_and_whatever_their_background(kind, in_bricks):
    values = volume(kind)
    data = ss.open_bricks(values, brick=32) if in_bricks else values
    for direction in ((0, 0, -1), (0.5, 0.3, -1)):
        camera = ss.Camera.fit(ss.RegularField(values), direction=direction)
        for size in (16, 24, 48, 160):
            image = ss.render(data, mode="xray", size=size, camera=camera, backend="cpu")
            assert shown(image) == pytest.approx(values.sum(dtype=float), rel=0.01)
    if kind == "offset":
        with pytest.warns(ss.PictureWarning, match="volumes that end are few samples wide"):
            rough = ss.render(
                data, mode="xray", size=16, camera=ss.Camera.fit(ss.RegularField(values)), quality="draft"
            )
        lost = abs(1 - shown(rough) / values.sum(dtype=float))
        assert lost > 0.02 and rough.error.budget[CAUSE] >= 0.5 * lost


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
@pytest.mark.parametrize("layers", [1, 2, 3, 5, 8, 33])
def test_a_few_layers_have_their_mass_seen_along_an_axis(layers, kind):
    values = np.full((layers, 40, 40), 100.0) + np.random.default_rng(0).random((layers, 40, 40))
    camera = ss.Camera.fit(ss.RegularField(values), direction=(0, 0, -1), kind=kind)
    image = ss.render(values, mode="xray", size=100, camera=camera, backend="cpu")
    assert image.scalar[50, 50] == pytest.approx(values[:, 18:22, 18:22].mean(axis=(1, 2)).sum(), rel=5e-3)
    # The control: the default distance of slices has them on both faces of an odd number of layers.
    plain = ss.render(values, mode="xray", size=100, camera=camera, backend="cpu", slice_spacing=1.0)
    assert plain.scalar[50, 50] / image.scalar[50, 50] == pytest.approx(1 + layers % 2 / layers, rel=5e-3)


def test_means_are_as_wide_as_their_kernels():
    """The filter would widen them: there are more samples a pixel."""
    rng = np.random.default_rng(3)
    field = ss.EllipsoidField(
        rng.uniform(-2, 2, (400, 3)), 10 ** rng.uniform(-2, -0.5, 400), values=np.ones(400), w0=0.05
    )
    true = shown(ss.render(field, mode="xray", size=800, camera=ahead(6), backend="cpu", filter="off", supersampling=2))
    for size in SIZES:
        image = ss.render(field, mode="xray", size=size, camera=ahead(6), backend="cpu")
        assert shown(image) == pytest.approx(true, rel=0.01)
        assert image.plan.quality.of("filter").value == "off"
        assert (image.plan.quality.of("supersampling").value > 1) == (size < 80)
    with pytest.warns(ss.PictureWarning):
        spread = ss.render(field, mode="xray", size=16, camera=ahead(6), backend="cpu", filter="off")
    assert spread.error.budget[CAUSE] >= 0.5 * abs(1 - shown(spread) / true)


@pytest.mark.parametrize("thin", [(0.05, 0.05), (0.01, 1.0)])
@pytest.mark.parametrize("turned", [False, True])
def test_needles_and_plates_narrower_than_a_pixel_keep_their_mass(thin, turned):
    """Their values at the faces are 0: the filter spreads them beyond the end, which cuts it off."""
    values = np.pad(np.ones((10, 10, 10), np.float32), 5)
    axes = np.diag([1.0, *thin])
    if turned:
        axes = axes @ np.linalg.qr(np.array(((0.8, -0.3, 0.4), (0.2, 0.9, -0.3), (-0.5, 0.3, 0.7))))[0]
    field = ss.RegularField(values, axes=axes)
    image = ss.render(field, mode="xray", size=(60, 48), camera=ss.Camera.fit(field), backend="cpu")
    assert shown(image) == pytest.approx(1000 * abs(np.linalg.det(axes)), rel=0.01)


def overlapping(rng, path):
    """Write particles whose kernels add up to more than 1 in places, as SPH's; return their mass."""
    count = 400
    centers, lengths = rng.uniform(-1, 1, (count, 3)), rng.uniform(0.3, 0.6, count)
    masses = rng.uniform(0.5, 1.5, count)
    densities = 0.7 * masses * count / 8.0
    fitted = ss.fit.sph(centers, densities, lengths, support=1.0, masses=masses, densities=densities)
    assert (fitted.sums(centers)[1] > 1.2).mean() > 0.5
    with h5py.File(path, "w") as file:
        group = file.create_group("PartType0")
        group["Coordinates"], group["Masses"], group["Density"] = centers, masses, densities
        group["SmoothingLength"] = lengths
    return fitted, float(masses.sum())


@pytest.mark.parametrize("way", ["render", "open", "fit", "log", "bricks", "film"])
def test_column_densities_of_particles_keep_their_mass(way, tmp_path):
    fitted, mass = overlapping(np.random.default_rng(5), tmp_path / "s.hdf5")
    path, camera = tmp_path / "s.hdf5", ahead(5)
    own = {"support": 1.0}
    options = {"mode": "xray", "size": 60, "camera": camera, "backend": "cpu"}
    if way == "render":
        image = ss.render(path, **own, **options)
    elif way == "bricks":
        image = ss.render(ss.open_bricks(path, brick_kernels=100, **own), **options)
    elif way == "film":
        image = ss.animate([path, path], **own, **options)[1]
        assert image.scalar.tolist() == ss.render(path, **own, **options).scalar.tolist()
    elif way == "log":
        image = ss.render(ss.open(path, log=True, **own), **options)
    else:
        image = ss.render(ss.open(path, **own) if way == "open" else fitted, **options)
    assert shown(image) == pytest.approx(mass, rel=2e-3)
    if way != "film":
        assert "masses are kept" in image.plan.quality.of("normalization").reason
    # A picture says how it was made.
    if way != "fit":
        again = image.recipe.scene([image.recipe.fields[0].open(path)])
        whole = ss.Renderer(backend="cpu").render(again, camera, (60, 60)).scalar
        assert (
            np.allclose(whole, image.scalar, atol=1e-6 * whole.max())
            if way == "bricks"
            else np.array_equal(whole, image.scalar)
        )


def test_means_of_particles_stay_where_they_were_asked_for(tmp_path):
    """The control of the test above."""
    _, mass = overlapping(np.random.default_rng(5), tmp_path / "s.hdf5")
    options = {"mode": "xray", "size": 60, "camera": ahead(5), "backend": "cpu"}
    for own in ({"normalization": "threshold"}, {"w0": 1.0}):
        image = ss.render(tmp_path / "s.hdf5", support=1.0, **own, **options)
        assert shown(image) < 0.9 * mass and "masses" not in str(image.plan)
    # Values at places are means, in every other mode.
    field = ss.open(tmp_path / "s.hdf5", support=1.0)
    assert field.normalization == "threshold" and field.summed().normalization == "none"
    assert "masses" not in str(ss.render(field, **{**options, "mode": "mip"}).plan)
