"""The mass of what lies in a box or a sphere: kernels on its edge count by their part."""

import numpy as np
import pytest
from command_line import run

import sheetsplat as ss
from sheetsplat.fit._kernels import profile

BALL = ((0.2, -0.1, 0.3), 1.5)
BOX = ((-0.9, -1.1, -0.6), (1.2, 0.8, 1.0))


def cloud(rng, count=40):
    """Return kernels whose centres lie inside and outside of the regions, as sums."""
    centers, radii = rng.normal(size=(count, 3)) * 1.2, rng.uniform(0.5, 1.1, count)
    return ss.EllipsoidField(centers, radii, values=rng.uniform(1, 3, count), normalization="none")


def mass_in_ball(field, center, radius):
    """Return the integral over a ball: of each shell of a kernel the part inside is known."""
    total = 0.0
    for place, size, value in zip(field.centers, field.scales, field.values, strict=True):
        away = np.linalg.norm(place - np.asarray(center))
        shell = (np.arange(4000) + 0.5) / 4000 * size
        part = np.clip((radius**2 - (away - shell) ** 2) / (4 * away * shell), 0, 1)
        part = np.where(shell + away <= radius, 1.0, part)
        total += value * (4 * np.pi * shell**2 * profile((shell / size) ** 2, 8.0) * part).sum() * size / 4000
    return total


def mass_in_box(field, lower, upper):
    """Return the integral over a box, by the midpoint rule on the part of it that each kernel reaches."""
    total = 0.0
    for place, size, value in zip(field.centers, field.scales, field.values, strict=True):
        low, high = np.maximum(lower, place - size), np.minimum(upper, place + size)
        if (low < high).all():
            x, y, z = ((np.arange(60) + 0.5) / 60 * (b - a) + a - c for a, b, c in zip(low, high, place, strict=True))
            away = x[:, None, None] ** 2 + y[:, None] ** 2 + z**2
            total += value * profile(np.minimum(away / size**2, 1.0), 8.0).mean() * np.prod(high - low)
    return total


def shown_mass(image):
    width, height = image.size
    return float(image.scalar.sum(dtype=np.float64)) * (image.camera.height / height) ** 2


@pytest.mark.parametrize("direction", ["-z", (1, 2, -3)])
def test_the_mass_of_particles_in_a_region(rng, direction):
    field = cloud(rng)
    look = {"mode": "xray", "size": 200, "backend": "cpu", "direction": direction}
    for clip, mass in (
        (ss.Clip(sphere=BALL), mass_in_ball(field, *BALL)),
        (ss.Clip(box=BOX), mass_in_box(field, *BOX)),
    ):
        # Not that of the kernels whose centres lie inside.
        inside = clip.keeps(field.centers)
        whole = sum(mass_in_ball(field.part(np.flatnonzero([n == m for m in range(field.size)])), BALL[0], 99.0)
                    for n in np.flatnonzero(inside))  # fmt: skip
        assert abs(whole / mass - 1) > 0.02
        assert shown_mass(ss.render(field, clip=clip, **look)) == pytest.approx(mass, rel=1e-3)


def test_xrays_show_all_of_a_region_and_of_a_periodic_box_however_faint(rng):
    """One kernel has nearly all of the mass, and does not decide what the picture shows."""
    centers = np.vstack([[(2, 1, 0)], rng.uniform(-4, 4, (60, 3))])
    made = {"values": [1e4] + [1.0] * 60, "normalization": "none"}
    field, ends = ss.EllipsoidField(centers, np.full(61, 0.8), **made), ((-4.0,) * 3, (4.0,) * 3)
    look = {"size": 16, "backend": "cpu", "direction": "-z", "up": "y"}
    for one, clip, middle, high in (
        (field, ss.Clip(sphere=((1, 0, -1), 2.5)), (1, 0), 5),
        (field, ss.Clip(box=((-2, -3, -99), (2, 2, 99))), (0, -0.5), 5),
        (ss.EllipsoidField(centers, np.full(61, 0.8), periodic=ends, **made), ss.Clip(), (0, 0), 8),
    ):
        camera = ss.render(one, clip=clip, mode="xray", **look).camera
        np.testing.assert_allclose(camera.target[:2], middle, atol=1e-9)
        assert high <= camera.height < 1.1 * high
        # Where colours are shown, what is too faint to be seen is left out as before.
        seen = ss.render(one, clip=clip, mode="composite", clim=(0, 1e4), opacity=[(1e3, 0), (1e4, 1)], **look)
        assert seen.camera.height < 0.5 * high


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
@pytest.mark.parametrize("mode", ["composite", "xray", "mip", "average"])
@pytest.mark.parametrize("backend", ["cpu", pytest.param("gl", marks=pytest.mark.gl)])
def test_backends_agree_on_a_sphere(rng, kind, mode, backend):
    field = cloud(rng)
    scene = ss.Scene(field, [(0, 0, 0, 0, 0), (4, 1, 0.5, 0.2, 0.5)], mode=mode, clip=ss.Clip(sphere=BALL))
    camera = ss.Camera.fit(field, (1, 2, -3), kind=kind)
    pictures = [ss.Renderer(name).render(scene, camera, (40, 30)) for name in (backend, "reference")]
    cut, exact = (one.pixels for one in pictures)
    np.testing.assert_allclose(cut, exact, atol=2e-4 * max(1.0, float(np.nanmax(np.abs(exact)))))
    whole = ss.Renderer("cpu").render(scene.replace(clip=ss.Clip()), camera, (40, 30)).pixels
    assert not np.allclose(np.nan_to_num(cut), np.nan_to_num(whole), atol=1e-2)


def test_a_sphere_that_keeps_all_and_one_that_keeps_nothing(rng):
    field = cloud(rng)
    look = {"mode": "xray", "size": 24, "backend": "cpu", "camera": ss.Camera.fit(field)}
    whole = ss.render(field, **look)
    around = ss.render(field, clip=ss.Clip(sphere=((0, 0, 0), 50)), **look)
    assert np.array_equal(around.scalar, whole.scalar)
    with pytest.warns(ss.PictureWarning, match="clip"):
        assert not ss.render(field, clip=ss.Clip(sphere=((90, 0, 0), 1)), **look).scalar.any()


def test_descriptions_and_commands_keep_a_sphere(rng, tmp_path):
    field = cloud(rng)
    ss.io.save_npz(field, tmp_path / "a.npz")
    sphere = "0.2,-0.1,0.3,1.5"
    options = ("--clip-sphere", sphere, "--mode", "xray", "--size", "32", "--backend", "cpu")
    run("render", tmp_path / "a.npz", *options, "-o", tmp_path / "a.png")
    assert ss.Recipe.read(tmp_path / "a.png").options["clip"] == ss.Clip(sphere=BALL)
    run("render", tmp_path / "a.png", tmp_path / "a.npz", "-o", tmp_path / "b.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    run("render", tmp_path / "a.npz", *options, "-o", tmp_path / "a.toml")
    assert "sphere" in (tmp_path / "a.toml").read_text()
    for wrong in (((0, 0, 0), 0), ((0, 0, np.inf), 1), ((0, 0), 1), 3):
        with pytest.raises(ss.InvalidInput, match="sphere"):
            ss.Clip(sphere=wrong)
    with pytest.raises(ss.InvalidInput, match="shadows"):
        ss.render(field, clip=ss.Clip(sphere=BALL), shadows=True, size=16)


def test_spheres_too_large_for_their_faces_are_told(recwarn):
    values = np.ones((24, 24, 24), np.float32)
    options = {"mode": "xray", "size": (24, 24), "backend": "cpu"}
    for radius in (8.0, 1e4):
        # All of the data lie in it, or a face cuts them where it may.
        ss.render(values, clip=ss.Clip(sphere=((12, 12, 12), radius)), **options)
    assert not [one for one in recwarn if "flat faces" in str(one.message)]
    with pytest.warns(ss.PictureWarning, match="flat faces up to 9[0-9.]+ aside, .* pass clip="):
        ss.render(values, clip=ss.Clip(sphere=((12, 12, 12 - 1e4), 1e4)), **options)
