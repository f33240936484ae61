"""Kernels smaller than a pixel or a slice distance: when the filter is taken, that nothing flickers, and what warns."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat.choose.look import compose_scene
from sheetsplat.framing import compose_camera
from sheetsplat.quality.thin import may_be_thin, small_kernels, unmet_kernels

SIZE = (48, 48)
LOOK = {"clim": (0, 1), "opacity": (0.0, 0.5), "shading": False}
OPAQUE = [(0.0, 1, 1, 1, 0.0), (1.0, 1, 1, 1, 0.6)]


def grains(least: float, most: float, count: int = 400, **options: object) -> ss.EllipsoidField:
    """Return spheres of diameters between two numbers of pixels in a cube that a picture of 48 pixels shows."""
    rng = np.random.default_rng(11)
    pixel = 3.1 / SIZE[1]
    radii = 0.5 * pixel * rng.uniform(least, most, count)
    return ss.EllipsoidField(rng.uniform(-1, 1, (count, 3)), radii, values=np.ones(count), **options)  # type: ignore[arg-type]


def moved(camera: ss.Camera, pixels: float) -> ss.Camera:
    """Return a camera that is moved to the side."""
    eye, target = np.asarray(camera.eye), np.asarray(camera.target)
    right = np.cross(target - eye, camera.up)
    step = right / np.linalg.norm(right) * pixels * camera.height / SIZE[1]
    return ss.Camera.orthographic(eye + step, target + step, camera.up, height=camera.height)


def largest_change(
    field: ss.RegularField | ss.EllipsoidField, zoom: float = 1.0, **options: object
) -> tuple[float, str]:
    """Return the largest change of the mean of a picture in steps of 0.1 pixels, over that mean, and its filter."""
    camera = ss.render(field, size=SIZE, zoom=zoom, backend="cpu", **LOOK, **options).camera
    pictures = [
        ss.render(field, size=SIZE, backend="cpu", camera=moved(camera, 0.1 * n), **LOOK, **options) for n in range(6)
    ]
    means = [float(image.rgba[..., 3].mean()) for image in pictures]
    assert min(means) > 0
    quality = pictures[0].plan.quality
    assert quality is not None
    return max(abs(b - a) for a, b in zip(means, means[1:], strict=False)) / np.mean(means), str(
        quality.of("filter").value
    )


@pytest.mark.parametrize("normalization", ["threshold", "none"])
@pytest.mark.parametrize("diameters", [(0.1, 2.0), (0.1, 0.1), (0.3, 0.3), (1.0, 1.0), (1.9, 1.9), (4.0, 4.0)])
def test_nothing_flickers(diameters, normalization):
    field = grains(*diameters, normalization=normalization)
    change, name = largest_change(field)
    assert change <= 0.02 and name == ("off" if min(diameters) > 2 else "ewa")


def test_without_the_filter_it_would():
    """The control of the test above."""
    for off in ({"filter": "off"}, {"filter": None}):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ss.PictureWarning)
            change, name = largest_change(grains(0.3, 0.3), **off)
        assert change > 0.05 and name == "off"


def test_the_filter_is_nearer_to_many_samples_a_pixel_where_it_is_taken():
    for diameters, better in (((0.1, 0.6), True), ((1.0, 2.0), True), ((6.0, 9.0), False)):
        scene = compose_scene([grains(*diameters)], **LOOK)
        camera = compose_camera(scene, SIZE)
        renderer = ss.Renderer("cpu")
        fine = renderer.render(scene, camera, size=(8 * SIZE[0], 8 * SIZE[1])).rgba
        fine = fine.reshape(SIZE[1], 8, SIZE[0], 8, 4).mean(axis=(1, 3))
        plain, spread = (renderer.render(scene.replace(filter=one), camera, size=SIZE).rgba for one in (None, "ewa"))
        nearer = np.mean((spread - fine) ** 2) < np.mean((plain - fine) ** 2)
        assert nearer == better and (small_kernels(scene, camera, SIZE).share > 0.2) == better


def filter_of(data: object, **options: object) -> ss.QualitySetting:
    image = ss.render(data, size=SIZE, backend="cpu", **{**LOOK, **options})  # type: ignore[arg-type]
    assert image.plan.quality is not None
    return image.plan.quality.of("filter")


def test_when_the_filter_is_taken(rng, ball):
    small = grains(0.1, 0.8)
    assert filter_of(small).value == filter_of(small, quality="best").value == "ewa"
    assert filter_of(small, quality="draft", filter="auto").value == "ewa"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ss.PictureWarning)
        assert filter_of(small, quality="draft").value == "off"
    # Few of many, hidden ones, and such as lie beside the picture change nothing.
    wide = grains(6, 9, 100)

    def both(values: float) -> ss.EllipsoidField:
        shown = np.concatenate([np.ones(100), np.full(small.size, values)])
        return ss.EllipsoidField(
            np.concatenate([wide.centers, small.centers]), np.concatenate([wide.scales, small.scales]), values=shown
        )

    assert (
        filter_of(both(1.0)).value == "off"
        and filter_of(both(1e-9), opacity=[(0, 0), (0.1, 0), (1, 0.5)]).value == "off"
    )
    camera = compose_camera(wide, SIZE)
    beside = ss.EllipsoidField(
        np.concatenate([wide.centers, small.centers + (900, -900, 0)]),
        np.concatenate([wide.scales, small.scales]),
        values=np.ones(100 + small.size),
    )
    assert filter_of(beside, camera=camera).value == "off"
    # Sums of many that overlap are smooth.
    crowd = ss.EllipsoidField(0.1 * rng.normal(size=(20_000, 3)), 0.06, values=np.ones(20_000))
    assert filter_of(crowd, camera=camera).value == "off"
    # Volumes are never drawn kernel by kernel.
    volume = ss.RegularField(ball)
    far = ss.Camera.orthographic((8, 8, 40), (8, 8, 8), height=2000)
    assert filter_of(volume, camera=far).value == "off" and "overlap" in filter_of(volume).reason
    assert filter_of([volume, small]).value == "off"


@pytest.mark.parametrize("zoom", [1.0, 0.4])
def test_volumes_of_many_samples_a_pixel_do_not_flicker_without_a_filter(zoom):
    """A thin rough shell of 96 samples across, 3 and 7 samples a pixel."""
    k, j, i = np.mgrid[-1:1:96j, -1:1:96j, -1:1:96j]
    noise = np.random.default_rng(3).normal(size=k.shape)
    shell = np.exp(-300 * (np.sqrt(k**2 + j**2 + i**2) - 0.8) ** 2) * (1 + 0.1 * noise)
    change, name = largest_change(ss.RegularField(shell.astype(np.float32)), zoom=zoom)
    assert change <= 0.02 and name == "off"


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
def test_sizes_are_those_in_the_picture(kind):
    field = ss.EllipsoidField([(0, 0, 0)], [(3, 1, 0.5)], values=[1])
    scene = ss.Scene(field, OPAQUE, slice_spacing=0.1)
    for direction, width in (((0, 0, -1), 1.0), ((1, 0, 0), 0.5), ((0, 1, 0), 0.5)):
        up = (0, 0, 1) if direction[2] == 0 else (0, 1, 0)
        for pixel, small in ((0.95 * width, 0.0), (1.05 * width, 1.0)):
            eye = -20.0 * np.asarray(direction)
            if kind == "orthographic":
                camera = ss.Camera.orthographic(eye, (0, 0, 0), up, height=10 * pixel)
            else:
                angle = float(np.degrees(2 * np.arctan(5 * pixel / 20)))
                camera = ss.Camera.perspective(eye, (0, 0, 0), up, fov_y=angle)
            assert small_kernels(scene, camera, (10, 10)).share == small
            assert small == 0.0 or may_be_thin(scene, camera, (10, 10))


def disks(thickness: float, spacing: float = 1.0) -> tuple[ss.EllipsoidField, ss.Camera]:
    """Return disks of such a half thickness on a plane between two slices, and a camera that looks at them."""
    at = np.mgrid[-4:5:2, -4:5:2].reshape(2, -1).T
    centers = np.column_stack([at, np.zeros(len(at))])
    field = ss.EllipsoidField(centers, np.tile((0.9, 0.9, thickness * spacing), (len(at), 1)), values=np.ones(len(at)))
    return field, ss.Camera.orthographic((0, 0, 20), (0, 0, 0), height=11)


def warned(action) -> list[str]:
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        action()
    return [str(one.message) for one in found if "between slices" in str(one.message)]


def test_kernels_between_slices_are_told():
    field, camera = disks(0.002)
    scene = ss.Scene(field, OPAQUE, slice_spacing=1.0)
    renderer = ss.Renderer("cpu")
    (told,) = warned(lambda: renderer.render(scene, camera, size=(32, 32)))
    assert "25 kernels, 100 % of what shows" in told and "0.002" in told and 'filter="ewa"' in told
    assert "slice_spacing=0.002" in told
    # What it advises helps, and what no slice misses does not warn.
    for better in (
        scene.replace(filter="ewa"),
        scene.replace(slice_spacing=0.002),
        scene.replace(sampling="slab"),
        ss.Scene(disks(0.51)[0], OPAQUE, slice_spacing=1.0),
        scene.replace(transfer_function=[(0, 1, 1, 1, 0), (1.5, 1, 1, 1, 0), (2, 1, 1, 1, 1)]),
    ):
        assert warned(lambda better=better: renderer.render(better, camera, size=(32, 32))) == []
    # Moved by half a slice distance every disk is met: the slices are anchored by the box of all centres.
    shifted = ss.EllipsoidField(
        np.concatenate([field.centers, [(0, 0, 1.0)]]),
        np.concatenate([field.scales, [(0.9, 0.9, 0.6)]]),
        values=np.ones(26),
    )
    assert warned(lambda: renderer.render(scene.replace(field=shifted), camera, size=(32, 32))) == []


def test_no_kernel_is_lost_without_a_word():
    """In a draft it is told; in better pictures it is caught by the filter."""
    field, camera = disks(0.002)
    look = {**LOOK, "slice_spacing": 1.0, "camera": camera, "size": (32, 32), "backend": "cpu"}
    assert len(warned(lambda: ss.render(field, quality="draft", **look))) == 1
    for name in ("good", "best"):
        assert warned(lambda name=name: ss.render(field, quality=name, **look)) == []
        image = ss.render(field, quality=name, mode="xray", **{**look, "opacity": None, "shading": None})
        assert image.scalar.max() > 0 and image.plan.has("ewa_filter")


def test_what_slices_miss_is_what_the_picture_misses(rng):
    """Of turned disks in any view, those that count as unseen are those that leave no trace."""
    turns = np.linalg.qr(rng.normal(size=(30, 3, 3)))[0]
    turns *= np.linalg.det(turns)[:, None, None]
    centers = np.column_stack([np.tile(np.arange(6) * 3.0, 5), np.repeat(np.arange(5) * 3.0, 6), rng.uniform(0, 3, 30)])
    field = ss.EllipsoidField(centers, np.tile((1.0, 0.8, 0.3), (30, 1)), turns, np.ones(30))
    scene = ss.Scene(field, OPAQUE, slice_spacing=1.6)
    camera = ss.Camera.orthographic((7.5, 6, 30), (7.5, 6, 0), height=18)
    picture = ss.Renderer("reference").render(scene, camera, size=(240, 240)).rgba[..., 3]
    # A pixel is 0.075 wide.
    seen = 0
    for x, y, _ in centers:
        column, row = int((x - 7.5) / 0.075 + 120), int(120 - (y - 6) / 0.075)
        seen += bool(picture[row - 14 : row + 15, column - 14 : column + 15].any())
    assert 0 < 30 - seen == unmet_kernels(scene, camera, (240, 240)).count


@pytest.mark.parametrize("w0", [1.0, 0.05])
@pytest.mark.parametrize("radius", [0.1, 0.25, 0.5])
def test_the_filter_does_not_hide_what_a_picture_without_it_shows(radius: float, w0: float) -> None:
    """It lowers the values of kernels that stand alone; limits and opacities are chosen for values without it."""
    rng = np.random.default_rng(0)
    field = ss.EllipsoidField(rng.uniform(0, 200, (2000, 3)), np.full(2000, radius), values=rng.random(2000), w0=w0)
    image = ss.render(field, size=200, backend="cpu")
    assert np.asarray(image)[..., 3].max() > 0
    assert image.plan.quality is not None
