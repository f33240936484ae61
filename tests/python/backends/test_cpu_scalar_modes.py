"""Scalar modes on the processor: sums over slices that need no sheets, slices that count by the places of samples
alone, and maxima and minima that rays look up."""

from __future__ import annotations

import numpy as np
import pytest
from image_checks import FLOAT32, FLOAT32_HARD, assert_close, distance

import sheetsplat as ss

SIZE = (62, 50)
GRAY = [(0, 0, 0, 0, 0), (1, 1, 1, 1, 1)]
LATTICES = {
    "cubic": {},
    "unequal": {"spacing": (1.0, 0.6, 1.7)},
    "bcc": {"lattice": "bcc"},
    "small": {"radius": 0.8},  # between samples nothing is reached
}


def sparse(holes=False):
    """Mostly zeros, a few samples of either sign, some of them at the border."""
    rng = np.random.default_rng(5)
    values = np.zeros((11, 9, 10), np.float32)
    some = rng.random(values.shape) < 0.06
    values[some] = rng.normal(1.0, 1.0, int(some.sum()))
    values[0, 3:6, 4:8] = 1.5
    if holes:
        values[3:6, 2:5, 3:7] = np.nan
    return values


def view(scene, kind, direction, zoom=1.0):
    return ss.Camera.fit(scene, direction=direction, kind=kind, margin=1.05 / zoom)


def shots(scene, camera, **options):
    """The processor's picture, the same for any number of threads, and the reference's."""
    image = ss.Renderer("cpu", threads=1, **options).render(scene, camera, size=SIZE)
    again = ss.Renderer("cpu", threads=3, **options).render(scene, camera, size=SIZE)
    assert np.array_equal(again.scalar, image.scalar, equal_nan=True)
    return image, ss.Renderer("reference").render(scene, camera, size=SIZE).scalar


def weighs(scene, camera):
    effects = {effect.name: effect.on for effect in ss.Renderer("cpu").plan(scene, camera, size=SIZE).effects}
    return effects["weight"]


def moved(make, expected, camera):
    """Where the reference jumps when supports grow or shrink by 1e-5 (section 9)."""
    jumps = np.zeros(expected.shape, bool)
    for factor in (1 - 1e-5, 1 + 1e-5):
        other = ss.Renderer("reference").render(make(factor), camera, size=SIZE).scalar
        jumps |= np.abs(other - expected) > 1e-3
    return jumps


@pytest.mark.parametrize("direction", [(0.4, 0.7, -1.0), (0.03, 0.01, -1.0)], ids=["askew", "along faces"])
@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
@pytest.mark.parametrize("lattice", LATTICES)
@pytest.mark.parametrize("mode", ["minimum", "average"])
def test_slices_count_where_samples_of_any_value_reach(mode, lattice, kind, direction):
    values = sparse()
    options = LATTICES[lattice]
    radius = options.get("radius", 2.0)

    def make(factor):
        field = ss.RegularField(values, **{**options, "radius": radius * factor})
        return ss.Scene(field, GRAY, mode=mode, slice_spacing=0.7)

    scene = make(1.0)
    camera = view(scene, kind, direction)
    assert not weighs(scene, camera)
    # By sheets, and of the minimum by rays too.
    for rays in (False, True) if mode == "minimum" else (False,):
        image, expected = shots(scene, camera, effects={"ray_extremes": rays})
        assert ("points_looked_up" in image.stats) == (rays and lattice != "bcc")
        assert np.nanmax(np.abs(expected)) > 0.01
        jumps = moved(make, expected, camera)
        text = f"cpu {mode} of {lattice} {kind} {direction}, rays {rays}"
        assert_close(image.scalar, expected, FLOAT32_HARD, text, jumps)
    if mode == "average":
        wider = ss.Renderer("cpu").render(make(1.03), camera, size=SIZE).scalar
        assert not distance(wider, expected, jumps).within(FLOAT32_HARD)
    if radius == 2.0:
        assert image.stats["kernels_drawn"] < values.size / 2


@pytest.mark.parametrize("shape", [(7, 1, 5), (1, 9, 8), (2, 2, 2), (12, 11, 10)], ids=str)
@pytest.mark.parametrize("lattice", LATTICES)
@pytest.mark.parametrize("boundary", ["edge", "zero"])
def test_slices_count_in_lattices_of_few_pixels(boundary, lattice, shape):
    """Of neighbouring pixels some lie beside all samples, and rays pass few slices or many."""
    rng = np.random.default_rng(6)
    options = LATTICES[lattice]
    radius = options.get("radius", 2.0)
    values = rng.normal(1.0, 1.0, shape).astype(np.float32)
    shown = 0
    for spacing in (0.15, 0.9):

        def make(factor, spacing=spacing):
            # Slices may be farther apart than a layer is thick.
            field = ss.RegularField(values, **{**options, "radius": radius * factor, "boundary": boundary})
            return ss.Scene(field, GRAY, mode="average", slice_spacing=spacing)

        for turn in range(3):
            scene = make(1.0)
            camera = view(scene, "orthographic", tuple(rng.normal(size=3)), zoom=0.25 if turn else 1.0)
            image, expected = shots(scene, camera)
            shown += np.nanmax(np.abs(expected), initial=0) > 0.01
            jumps = moved(make, expected, camera)
            assert_close(image.scalar, expected, FLOAT32_HARD, f"{lattice} {shape} {spacing} {turn}", jumps)
    # (A volume that ends may lie between two slices.)
    assert shown >= (6 if boundary == "zero" else 5)


@pytest.mark.parametrize("mode", ["minimum", "average"])
@pytest.mark.parametrize("what", ["clip", "two fields", "holes", "ellipsoids", "weights", "float64", "tiles"])
def test_counted_slices_beside_everything_else(what, mode):
    fields = [ss.RegularField(sparse(what == "holes"), **({"nan": "skip"} if what == "holes" else {}))]
    if what == "two fields":
        fields.append(ss.RegularField(sparse()[:7], origin=(4.3, -5.2, 3.1), spacing=(0.7, 0.7, 0.7)))
    if what == "ellipsoids":
        fields.append(ss.EllipsoidField([(1.0, 2.0, -3.0), (12.0, 5.0, 4.0)], 2.5, values=[1.0, 2.0]))
    clip = {"clip": ss.Clip(planes=[((0.3, 0.2, 1.0), 3.3)])} if what == "clip" else {}
    scene = ss.Scene(fields, GRAY, mode=mode, slice_spacing=0.8, **clip)
    camera = view(scene, "orthographic", (0.4, 0.7, -1.0))
    assert weighs(scene, camera) == (what in ("holes", "ellipsoids"))
    options = {
        "weights": {"effects": {"weight": True}},
        "float64": {"precision": "float64"},
        "tiles": {"tile_size": 13},
    }.get(what, {})
    _, expected = shots(scene, camera)
    image = ss.Renderer("cpu", **options).render(scene, camera, size=SIZE)
    assert_close(image.scalar, expected, FLOAT32_HARD, f"cpu {mode} beside {what}")


@pytest.mark.parametrize("spacing", [0.15, 0.5, 1.0, 2.7], ids=lambda spacing: f"slices {spacing}")
@pytest.mark.parametrize("zoom", [0.2, 1.0, 3.5, 30.0], ids=lambda zoom: f"zoom {zoom}")
def test_sums_over_slices(zoom, spacing):
    """From kernels below a pixel to such as are larger than what is summed without sheets."""
    field = ss.RegularField(np.random.default_rng(3).random((9, 8, 10)).astype(np.float32) - 0.2)
    scene = ss.Scene(field, GRAY, mode="xray", slice_spacing=spacing)
    camera = view(scene, "orthographic", (0.4, 0.7, -1.0), zoom)
    _, expected = shots(scene, camera)
    for precision in ("float32", "float64"):
        text = f"cpu x-ray zoom {zoom} slices {spacing} {precision}"
        pictures = {
            tile: ss.Renderer("cpu", precision=precision, tile_size=tile).render(scene, camera, size=SIZE)
            for tile in (None, 8, 13)
        }
        for tile, image in pictures.items():
            assert_close(image.scalar, expected, FLOAT32, f"{text} tiles {tile}")
        # Where coverage is asked for, sheets are summed: another way to the same numbers, kernels and sections.
        sheets = ss.Renderer("cpu", precision=precision).render(scene, camera, size=SIZE, outputs=("coverage",))
        assert_close(pictures[None].scalar, sheets.scalar, (4e-6, 1e-5), text + " beside sheets")
        assert pictures[None].stats["kernels_drawn"] == sheets.stats["kernels_drawn"]
    finer = ss.Renderer("cpu").render(scene.replace(slice_spacing=spacing * 0.98), camera, size=SIZE).scalar
    assert not distance(finer, expected).within((2e-7, 1e-6))
    assert not distance(expected * 1.0005, expected).within(FLOAT32)


def test_sums_of_very_many_equal_kernels_do_not_drift():
    """Rays along rows: thousands of equal terms at each pixel, whose roundings all go one way."""
    field = ss.RegularField(np.full((6, 6, 3000), 0.7, np.float32))
    scene = ss.Scene(field, GRAY, mode="xray")
    camera = ss.Camera.orthographic((4000.0, 2.6, 2.4), (0.0, 2.6, 2.4), height=8.0)
    image, expected = (
        ss.Renderer(backend).render(scene, camera, size=(24, 20)).scalar for backend in ("cpu", "reference")
    )
    assert_close(image, expected, FLOAT32, "cpu x-ray along long rows")


def test_sums_of_several_fields():
    lattices = [
        ss.RegularField(sparse()),
        ss.RegularField(sparse()[:6], origin=(3.0, 1.0, 2.5), spacing=(0.7, 0.7, 0.7)),
    ]
    others = [
        ss.RegularField(sparse(), spacing=(1.0, 0.6, 1.7)),
        ss.RegularField(sparse(), normalization="threshold"),
        ss.EllipsoidField([(1.0, 2.0, 3.0), (8.0, 5.0, 4.0)], 2.5, values=[1.0, 2.0]),
    ]
    scene = ss.Scene([*lattices, *others], GRAY, mode="xray", slice_spacing=0.6)
    camera = view(scene, "orthographic", (0.4, 0.7, -1.0))
    image, expected = shots(scene, camera)
    assert_close(image.scalar, expected, FLOAT32, "cpu x-ray of several fields")


def hostile(kind, dtype=np.float32):
    """Volumes whose bounds by block say little, or nothing."""
    rng = np.random.default_rng(8)
    shape = (13, 17, 22)
    values = np.zeros(shape)
    if kind == "noise":
        values = rng.normal(0.2, 1.0, shape)
    elif kind == "bright voxels":
        values = rng.random(shape)
        values[tuple(rng.integers(0, shape, (12, 3)).T)] = 1000.0
        values[0, 0, 0] = values[12, 16, 21] = 1500.0
    elif kind == "negative":
        values = -1.0 - rng.random(shape)
    elif kind == "negative around bright":
        values = np.where(rng.random(shape) < 0.5, -3.0, 4.0)
    elif kind == "plateaus":
        values[2:7, 3:9, 4:12] = 1.0
        values[7:, 9:, 12:] = 1.0 + 1e-6
    elif kind == "holes":
        values = rng.random(shape)
        values[rng.random(shape) < 0.3] = np.nan
    elif kind == "tiny":
        values = 1e-30 * rng.random(shape)
        values[4, 5, 6] = 3.0
    return np.maximum(np.round(40 * values), 0).astype(dtype) if np.dtype(dtype).kind == "u" else values.astype(dtype)


BY_RAYS = {"effects": {"ray_extremes": True}}


def extremes(scene, camera, precision="float32", **options):
    return ss.Renderer("cpu", precision=precision, **BY_RAYS, **options).render(scene, camera, size=SIZE)


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
@pytest.mark.parametrize(
    "what",
    ["noise", "bright voxels", "negative", "negative around bright", "plateaus", "holes", "tiny"],
)
@pytest.mark.parametrize(
    "options",
    [{}, {"radius": 3.0, "falloff": 8.0}, {"spacing": (1.0, 0.4, 2.2)}, {"boundary": "edge", "base": 0.0}],
    ids=str,
)
@pytest.mark.parametrize("mode", ["mip", "minimum"])
def test_extremes(mode, options, what, kind):
    # Without mirrored samples kernels can be counted.
    options = {"boundary": "zero", **options, **({"nan": "skip"} if what == "holes" else {})}
    field = ss.RegularField(hostile(what), **options)
    scene = ss.Scene(field, GRAY, mode=mode, slice_spacing=0.6)
    camera = view(scene, kind, (0.4, 0.7, -1.0))
    image, expected = shots(scene, camera, **BY_RAYS)
    text = f"cpu {mode} {what} {kind} {options}"
    if what == "holes":
        # Samples that are missing leave slices out: weights are summed.
        assert "points_looked_up" not in image.stats
        return
    assert_close(image.scalar, expected, FLOAT32, text)
    # Where coverage is asked for, sheets are summed: another way to the same numbers.
    sheets = ss.Renderer("cpu").render(scene, camera, size=SIZE, outputs=("coverage",))
    assert "points_looked_up" in image.stats and "points_looked_up" not in sheets.stats
    assert_close(image.scalar, sheets.scalar, (2e-6, 2e-5), text + " beside sheets")
    if options["boundary"] == "zero":
        assert image.stats["kernels_drawn"] == np.count_nonzero(np.nan_to_num(hostile(what)))
    # Each pixel's number is its own, whatever tile it lies in and whichever rays were looked at before.
    for tile in (7, 40):
        assert np.array_equal(extremes(scene, camera, tile_size=tile).scalar, image.scalar, equal_nan=True)
    if (mode, what) == ("mip", "negative"):
        # The largest of numbers below 0.
        assert np.nanmax(image.scalar) <= 0.0
    elif mode == "mip" or "negative" in what or what == "noise":
        # A negative control: other slices have other extremes. (The least of what is above 0 lies where kernels end.)
        moved = scene.replace(slice_spacing=0.57)
        assert not distance(extremes(moved, camera).scalar, expected).within(FLOAT32)


@pytest.mark.parametrize("radius", [0.8, 1.7, 2.0, 2.6, 4.0])
@pytest.mark.parametrize("dtype", ["uint8", "int16", "uint16", "float32", "float64"])
@pytest.mark.parametrize("mode", ["mip", "minimum"])
def test_extremes_of_all_samples_and_kernels(mode, dtype, radius):
    values = hostile("noise", dtype) if dtype != "int16" else (50 * hostile("noise")).astype(dtype)
    field = ss.RegularField(values, radius=radius, falloff=1.3 * radius**2)
    scene = ss.Scene(field, GRAY, mode=mode, slice_spacing=0.45)
    for kind, zoom in (("orthographic", 1.0), ("perspective", 1.0), ("perspective", 3.0)):
        camera = view(scene, kind, (0.03, -0.2, -1.0), zoom)
        # What the plan chooses, and rays whatever it says.
        _, expected = shots(scene, camera)
        for precision in ("float32", "float64"):
            image = extremes(scene, camera, precision)
            assert "points_looked_up" in image.stats
            assert_close(image.scalar, expected, FLOAT32, f"cpu {mode} {dtype} radius {radius} {precision} {kind}")
            assert np.array_equal(extremes(scene, camera, precision, tile_size=9).scalar, image.scalar, equal_nan=True)


def test_minima_end_where_nothing_is_smaller():
    """Rays that meet an empty corner look at few points, and those that do not at what is beside the border."""
    values = np.random.default_rng(9).integers(0, 200, (60, 60, 60)).astype(np.uint8)
    values[:20, :, :] = 0
    values[20:40] = np.maximum(values[20:40], 90)
    scene = ss.Scene(ss.RegularField(values), GRAY, mode="minimum")
    camera = view(scene, "orthographic", (0.0, 0.3, -1.0))
    image, expected = shots(scene, camera, **BY_RAYS)
    assert_close(image.scalar, expected, FLOAT32, "cpu minimum of a volume with an empty end")
    points = SIZE[0] * SIZE[1] * image.stats["slices"]
    assert 0 < image.stats["points_looked_up"] < 0.1 * points


def test_maxima_skip_what_cannot_exceed_them():
    """Rays that meet the bright middle of a volume look at a small part of their points."""
    k, j, i = np.mgrid[-1:1:80j, -1:1:80j, -1:1:80j]
    values = np.exp(-6 * (k * k + j * j + i * i)).astype(np.float32)
    scene = ss.Scene(ss.RegularField(values), GRAY, mode="mip")
    camera = view(scene, "orthographic", (0.0, 0.0, -1.0))
    image, expected = shots(scene, camera)
    assert_close(image.scalar, expected, FLOAT32, "cpu mip of a ball")
    points = SIZE[0] * SIZE[1] * image.stats["slices"]
    assert 0 < image.stats["points_looked_up"] < 0.4 * points


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
def test_the_plan_says_whether_rays_look_up_maxima(kind):
    """Where bounds tell hardly any point apart sheets are summed, and the plan says why."""
    noise = ss.RegularField(np.random.default_rng(2).integers(0, 256, (14, 17, 19)).astype(np.uint8))
    k, j, i = np.mgrid[-1:1:40j, -1:1:44j, -1:1:48j]
    ball = ss.RegularField(np.exp(-6 * (k * k + j * j + i * i)).astype(np.float32))
    shares = {}
    for field, by_rays in ((noise, False), (ball, True)):
        scene = ss.Scene(field, GRAY, mode="mip")
        camera = view(scene, kind, (0.4, 0.7, -1.0), 1.0 if by_rays else 2.0)
        pictures = {}
        for effects in ({}, {"ray_extremes": by_rays}, {"ray_extremes": not by_rays}):
            renderer = ss.Renderer("cpu", effects=effects)
            (effect,) = (one for one in renderer.plan(scene, camera, size=SIZE).effects if one.name == "ray_extremes")
            image = renderer.render(scene, camera, size=SIZE)
            rays = effects.get("ray_extremes", by_rays)
            assert effect.on == rays == ("points_looked_up" in image.stats)
            assert ("summing sheets" in effect.reason) != by_rays
            shares[by_rays] = float(effect.reason.split("leave ")[1].split(" %")[0])
            pictures[rays] = image.scalar
        assert_close(pictures[True], pictures[False], (2e-6, 2e-5), f"cpu mip by rays and by sheets {kind}")
    assert shares[False] > 90 and shares[True] < 70
    # Nothing else is looked up.
    image = ss.Renderer("cpu", **BY_RAYS).render(scene.replace(mode="xray"), camera, size=SIZE)
    assert "points_looked_up" not in image.stats


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
@pytest.mark.parametrize("mode", ["mip", "minimum"])
def test_extremes_of_what_is_kept(mode, kind):
    """Rays leave out what a clip, or a surface in front, hides: on a plane through samples too."""
    field = ss.RegularField(hostile("noise"), spacing=(1.0, 0.4, 2.2))
    clips = [
        ss.Clip(planes=[((0.0, 0.0, 1.0), 4.4)]),
        ss.Clip(planes=[((0.3, -0.8, 0.5), 3.0), ((-1.0, 0.1, 0.0), -12.0)]),
        ss.Clip(box=((2.0, 1.0, 2.0), (11.0, 4.0, 17.0))),
        None,
    ]
    depths = np.random.default_rng(4).uniform(0.6, 1.4, SIZE[::-1])
    for clip in clips:
        for limit in (None, depths):
            if clip is None and limit is None:
                continue
            scene = ss.Scene(field, GRAY, mode=mode, slice_spacing=0.6, clip=clip)
            camera = view(scene, kind, (0.4, 0.7, -1.0))
            far = np.linalg.norm(np.subtract(camera.target, camera.eye))
            asked = {} if limit is None else {"depth_limit": (limit * far).astype(np.float32)}
            text = f"cpu {mode} {kind} of {clip}, {'limited' if asked else 'all'}"
            whole = extremes(scene.replace(clip=None), camera)
            pictures = [ss.Renderer("reference").render(scene, camera, size=SIZE, **asked).scalar]
            for effects in (True, False):
                renderer = ss.Renderer("cpu", effects={"ray_extremes": effects})
                image = renderer.render(scene, camera, size=SIZE, **asked)
                assert ("points_looked_up" in image.stats) == effects, text
                pictures.append(image.scalar)
                tiled = ss.Renderer("cpu", effects={"ray_extremes": effects}, tile_size=9)
                # (Sums are rounded by the corners of tiles.)
                again = tiled.render(scene, camera, size=SIZE, **asked).scalar
                same = np.array_equal(again, image.scalar, equal_nan=True)
                assert same or not effects
            assert_close(pictures[1], pictures[0], FLOAT32, text)
            assert_close(pictures[1], pictures[2], (2e-6, 2e-5), text + " beside sheets")
            # What is cut off is seen.
            assert not distance(whole.scalar, pictures[0]).within(FLOAT32)


def test_extremes_follow_the_field():
    """One renderer, several fields: bounds are those of the field and the mode that is drawn."""
    renderer = ss.Renderer("cpu", **BY_RAYS)
    fields = [ss.RegularField(hostile(what)) for what in ("noise", "bright voxels", "noise", "plateaus")]
    for field in fields:
        for mode in ("mip", "minimum"):
            scene = ss.Scene(field, GRAY, mode=mode)
            camera = view(scene, "orthographic", (0.4, 0.7, -1.0))
            expected = ss.Renderer("reference").render(scene, camera, size=SIZE).scalar
            assert_close(renderer.render(scene, camera, size=SIZE).scalar, expected, FLOAT32, f"cpu {mode} of another")
