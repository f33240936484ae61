"""Fields of ellipsoids in scenes: cameras, the automatic look, advice and info."""

from __future__ import annotations

import json

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat.choose.look import compose_scene
from sheetsplat.cli import info
from sheetsplat.look import automatic
from sheetsplat.look.empty import why_empty
from sheetsplat.look.transparency import DEPTH, median_depth

SMALL = {"size": (32, 32), "backend": "reference", "quality": "draft"}


def ball_of_kernels(rng, count=400):
    """Return a field that is 2 in the middle of a ball and 1 at its rim."""
    centers = rng.normal(size=(count, 3))
    centers *= (rng.random(count) ** (1 / 3) / np.linalg.norm(centers, axis=1))[:, np.newaxis]
    return ss.EllipsoidField(centers, np.full(count, 0.4), values=2 - np.linalg.norm(centers, axis=1))


def test_scenes_take_fields_of_any_kind(ball, rng):
    scattered, regular = ball_of_kernels(rng), ss.RegularField(ball)
    function = [(0, 0, 0, 0, 0), (2, 1, 1, 1, 1)]
    scene = ss.Scene([regular, scattered], function, filter="ewa")
    assert scene.fields == (regular, scattered) and scene.filter == "ewa"
    assert scene.slice_spacing == min(regular.default_slice_spacing, scattered.default_slice_spacing)
    assert scene.bounds[0] == tuple(np.minimum(regular.bounds[0], scattered.bounds[0]))
    assert ss.Scene(scattered, function).filter is None and "EllipsoidField" in repr(scene)
    for bad in ("EWA", "none", True, 1):
        with pytest.raises(ss.InvalidInput, match="filter"):
            ss.Scene(scattered, function, filter=bad)
    with pytest.raises(ss.InvalidInput, match="EllipsoidField"):
        ss.Scene([scattered, None], function)


def test_cameras_fit_what_the_supports_reach(rng):
    field = ball_of_kernels(rng)
    camera = ss.Camera.fit(field, (1, 0.3, -0.5))
    for corner in np.array(np.meshgrid(*np.transpose(field.bounds))).reshape(3, -1).T:
        x, y, _ = camera.native.to_eye(tuple(corner))
        assert max(abs(x), abs(y)) <= camera.height / 2
    assert ss.Camera.fit([field]).eye == ss.Camera.fit(ss.Scene(field, [(0, 0, 0, 0, 0), (1, 1, 1, 1, 1)])).eye
    # Groups of fields are one level more; deeper there is nothing.
    assert ss.Camera.fit([[field], [field]]).eye == ss.Camera.fit(field).eye
    endless: list[object] = []
    endless.append(endless)
    for wrong in (endless, [[[field]]]):
        with pytest.raises(ss.InvalidInput, match="cannot be looked at"):
            ss.Camera.fit(wrong)


def test_places_lie_where_the_volumes_are():
    # Of two kernels one has 64 times the volume of the other.
    field = ss.EllipsoidField([(0, 0, 0), (100, 0, 0)], [1, 4], values=[1, 2])
    places = automatic.places_in(field, 2700)
    far = places[:, 0] > 50
    assert abs(far.sum() - 2700 * 64 / 65) < 1 and np.linalg.norm(places[~far], axis=1).max() <= 0.5
    assert np.array_equal(places, automatic.places_in(field, 2700))
    # Neither ghosts nor kernels without weight count.
    assert (automatic.places_in(field.with_ghost_points(), 100)[:, 0] > -0.6).all()
    weighted = ss.EllipsoidField([(0, 0, 0), (100, 0, 0)], [1, 3], values=[1, 2], weights=[1, 0])
    assert automatic.places_in(weighted, 100)[:, 0].max() < 1


def test_the_look_follows_values_and_units(rng):
    centers = rng.normal(size=(800, 3))
    values = np.where(np.linalg.norm(centers, axis=1) < 1, rng.normal(100, 5, 800), rng.normal(10, 3, 800))
    look = automatic.choose([ss.EllipsoidField(centers, np.full(800, 0.8), values=values)])
    assert 20 < look.surface < 80 and 85 < look.clim[1] < 115
    larger = automatic.choose([ss.EllipsoidField(1e6 * centers, np.full(800, 0.8e6), values=1e-3 * values)])
    assert np.allclose(np.array(larger.clim) * 1e3, look.clim) and np.isclose(larger.top_opacity, look.top_opacity)


def test_a_few_large_values_do_not_make_the_look_impossible(rng):
    # A thousand kernels of next to nothing, and three small ones with 10,000 times that.
    centers = rng.normal(size=(1003, 3))
    values = np.append(rng.uniform(0.1, 0.3, 1000), [3000.0] * 3)
    field = ss.EllipsoidField(centers, np.append(np.full(1000, 0.8), [0.05] * 3), values=values)
    with pytest.warns(ss.PictureWarning, match="log=True"):
        look = automatic.choose([field])
    assert look.clim[0] < 0.3 and 3000 / (look.clim[1] - look.clim[0]) == pytest.approx(20)
    assert look.opacity[0][0] == look.clim[0] and look.opacity[-1][0] == pytest.approx(look.clim[1])


def test_thin_slices_get_less_opacity(rng):
    thick = ball_of_kernels(rng)
    thin = ss.EllipsoidField(thick.centers, thick.scales[:, np.newaxis] * (1, 1, 1e-2), values=thick.values)
    looks = [automatic.choose([field]) for field in (thick, thin)]
    # Opacities refer to a length that is shorter, and rays have an optical depth of one, or near it where thin kernels
    # leave most of the room empty.
    assert thin.default_slice_spacing < 0.1 * thick.default_slice_spacing
    depths = [
        median_depth(look, field, field.default_slice_spacing, 9000)
        for field, look in zip((thick, thin), looks, strict=True)
    ]
    assert depths[0] == pytest.approx(DEPTH, rel=0.05) and 0.1 < depths[1] < DEPTH
    assert looks[1].opacity[-1][1] == pytest.approx(looks[1].top_opacity)
    scene = compose_scene([thin], clim=(1, 2))
    assert scene.transfer_function.max_opacity == pytest.approx(looks[1].top_opacity)


def test_sums_far_from_the_values_are_found(block):
    # Sums of some three kernels everywhere, and weights of a millionth.
    sums_up = ss.EllipsoidField(block, np.full(len(block), 2.2), values=np.ones(len(block)), normalization="none")
    assert 1.5 < automatic.choose([sums_up]).clim[1] < 3.5
    light = ss.EllipsoidField(
        block, np.full(len(block), 2.2), values=np.ones(len(block)), weights=np.full(len(block), 1e-6)
    )
    assert 1e-6 < automatic.choose([light]).clim[1] < 4e-6


@pytest.mark.parametrize("mode", ["composite", "isosurface", "xray", "mip"])
def test_every_mode_shows_something(rng, mode):
    picture = ss.render(ball_of_kernels(rng), mode=mode, **SMALL).pixels
    # No slice counts in the corner.
    corner = picture.reshape(32, 32, -1)[0, 0]
    assert np.nanmax(picture) > 0.3 and (np.isnan(corner) if mode == "mip" else corner == 0).all()


@pytest.mark.parametrize("kind", ["one", "equal", "flat", "heavy"])
def test_odd_fields_show_something(rng, kind):
    centers = rng.normal(size=(50, 3))
    field = {
        "one": lambda: ss.EllipsoidField([(0, 0, 0)], [1], values=[-5]),
        "equal": lambda: ss.EllipsoidField(centers, np.full(50, 1.0), values=np.full(50, 7.5)),
        "flat": lambda: ss.EllipsoidField(centers, np.tile((1, 1, 1e-3), (50, 1)), values=rng.random(50)),
        "heavy": lambda: ss.EllipsoidField(centers, np.full(50, 1.0), values=np.full(50, 1e280)),
    }[kind]()
    picture = ss.render(field, **SMALL).rgba if kind != "heavy" else None
    if picture is not None:
        assert np.isfinite(picture).all() and picture[..., 3].max() > 0.05
    assert np.isfinite(automatic.choose([field]).clim).all()


@pytest.mark.parametrize("boundary", ["edge", "zero"])
def test_a_lattice_of_ellipsoids_is_a_regular_field(boundary, block):
    """A lattice that ends is one of more kernels, the mirrored ones, that a clip cuts off."""
    values = np.linalg.norm(block - 4, axis=1)
    regular = ss.RegularField(values.reshape(9, 9, 9).transpose(2, 1, 0), boundary=boundary)
    clip = None
    if boundary == "edge":
        block = np.mgrid[-2:11, -2:11, -2:11].reshape(3, -1).T.astype(float)
        block = block[np.linalg.norm(np.maximum(np.abs(block - 4) - 4.5, 0), axis=1) < 2]
        values = np.linalg.norm(4 - np.abs(4 - np.abs(block - 4)), axis=1)
        clip = ss.Clip(box=regular.domain)
    more = {"normalization": "lattice", "falloff": 5, "cell_volume": 1, "base": regular.base}
    scattered = ss.EllipsoidField(block, np.full(len(block), 2.0), values=values, **more)
    camera = ss.Camera.fit(regular, (0.3, -0.4, -1))
    function = ss.TransferFunction([(0, 0, 0, 1, 0.1), (4, 1, 0, 0, 0), (7, 0, 1, 0, 0.3)])
    renderer = ss.Renderer("reference")

    def drawn(field, clip):
        options = {"lights": [ss.Light()], "slice_spacing": 1, "reference_length": 1, "clip": clip}
        return renderer.render(ss.Scene(field, function, **options), camera, size=(24, 24)).rgba

    pictures = [drawn(regular, None), drawn(scattered, clip)]
    assert pictures[0][..., 3].max() > 0.3 and np.allclose(*pictures, atol=2e-6)
    other = ss.EllipsoidField(block, np.full(len(block), 2.02), values=values, **more)
    moved = drawn(other, clip)
    assert not np.allclose(pictures[0], moved, atol=1e-4)


def test_fields_add_up(rng, block):
    field = ball_of_kernels(rng)
    half = ss.EllipsoidField(field.centers, field.scales, values=field.values / 2)
    # What can be seen of several fields, and so the framing, is estimated.
    options = {"clim": (0, 2), "camera": ss.Camera.fit(field, (1, 0.3, -0.5)), **SMALL}
    expected = ss.render(field, **options).rgba
    assert expected[..., 3].max() > 0.5
    assert np.allclose(ss.render([half, half], **options).rgba, expected, atol=1e-5)
    assert not np.allclose(ss.render(half, **options).rgba, expected, atol=0.05)


def test_advice_tells_what_the_scalars_are(rng):
    field = ball_of_kernels(rng)
    scene = ss.Scene(field, [(10, 0, 0, 0, 0), (20, 1, 1, 1, 1)])
    assert "the opacity is 0 for all of the values" in why_empty(scene)
    summed = ss.EllipsoidField(field.centers, field.scales, values=-field.values, normalization="none")
    # The largest of values below 0 is shown as any other: nothing is to be said about them.
    scene = ss.Scene(summed, [(0, 0, 0, 0, 0), (1, 1, 1, 1, 1)], mode="mip")
    assert "below 0" not in why_empty(scene)
    picture = ss.Renderer("reference").render(scene, ss.Camera.fit(field), size=(32, 32)).pixels
    assert np.nanmin(picture) < -0.1 and np.nanmax(picture) <= 0


def test_info_describes_fields(rng, soup):
    centers, scales, matrices, values, weights = soup
    field = ss.EllipsoidField(centers, scales, matrices, values, weights=weights)
    report = info.describe(field, 8)
    assert report["kernels"] == 40 and report["kind"] == "ellipsoids" and report["memory_bytes"] == field.memory
    assert report["minimum"] == values.min() and sum(report["histogram"]["counts"]) == 40
    aspects = scales.max(axis=1) / scales.min(axis=1)
    assert report["aspect"]["largest"] == aspects.max() and report["aspect"]["median"] == np.median(aspects)
    json.dumps(report)
    told = {"file": "f", "format": "ellipsoids", "points": 40, "scalar": "a", "scalars": ["a"], "details": {}}
    text = "\n".join(info._table({**told, **report}))
    for part in ("40 ellipsoids", "semi-axes", "aspect", "weights", "threshold", "histogram", "shown"):
        assert part in text
    spheres = info.describe(ball_of_kernels(rng).with_ghost_points(), 8)
    assert spheres["kind"] == "spheres" and spheres["aspect"]["largest"] == 1
    assert sum(spheres["histogram"]["counts"]) == 400
    nothing = info.describe(ss.EllipsoidField([], [], values=[]), 8)
    assert nothing["kernels"] == 0 and "0 spheres" in "\n".join(info._table({**told, **nothing}))
