"""Scattered ellipsoids under invalid and extreme input: the right picture or a clear error, and no leaks."""

from __future__ import annotations

import gc
import gzip
import random
import re
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scattered_scenes as scattered
import scene_parts
from image_checks import FLOAT32, FLOAT32_HARD, handed_over, off_by, within

import sheetsplat as ss
from sheetsplat.look import automatic

SIZE = (30, 24)


@cache
def renderer() -> ss.Renderer:
    """Return a renderer by OpenGL for all scenes, which keeps its context and its shaders."""
    return ss.Renderer("gl")


def assert_like_reference(
    drawn_by: ss.Renderer,
    scene: ss.Scene,
    camera: ss.Camera,
    bounds: tuple[float, float] = FLOAT32,
    *,
    reason: str = "",
    **options: Any,
) -> ss.Image:
    """Compare a renderer's picture with the reference's, and return it.

    reason: for which backend gl hands the whole picture over to the processor; "": it does not.
    """
    image = drawn_by.render(scene, camera, size=SIZE, **options)
    expected = ss.Renderer("reference").render(scene, camera, size=SIZE, **options)
    assert reason in handed_over(image) and bool(reason) == bool(handed_over(image)), image.plan.device
    # NaN is where no slice counts.
    shown, wanted = image.pixels, expected.pixels
    if scene.mode == "mip":
        shown, wanted = np.nan_to_num(shown, posinf=np.inf), np.nan_to_num(wanted)
    assert np.isfinite(shown).all()
    found = off_by(shown, wanted)
    assert within(found, bounds), found
    return image


def camera_of(arguments: dict[str, Any]) -> ss.Camera:
    return (ss.Camera.orthographic if "height" in arguments else ss.Camera.perspective)(**arguments)


def field_of(
    seed: int, count: int = 60, overlap: float = 2.0, aspect: float = 4.0, **options: Any
) -> ss.EllipsoidField:
    return ss.EllipsoidField(**scene_parts.cloud(np.random.default_rng(seed), count, overlap, aspect, **options))


def scene_of(fields: Any, **options: Any) -> ss.Scene:
    """Return a lit scene whose picture does not jump."""
    lit = options.pop("lit", True)
    points = options.pop("points", scene_parts.GENTLE)
    lights = [ss.Light(**light) for light in scene_parts.LIGHTS] if lit else []
    material = ss.Material(**scene_parts.MATERIAL)
    return ss.Scene(
        fields,
        ss.TransferFunction(points),
        lights=lights,
        material=material,
        **({"slice_spacing": 1 / 6, "opacity_stop": 1.0} | options),
    )


# State kept between pictures


WAYS = [
    {},
    {"packing": "paper"},
    {"effects": {"resident_sections": True}},
    {"effects": {"paper_slicing": True}},
    {"effects": {"opacity_buffer": True}},
]


@pytest.mark.gl
@pytest.mark.parametrize("way", WAYS, ids=str)
def test_a_field_that_takes_the_place_of_another_is_a_new_one(way: dict[str, Any]) -> None:
    """A field at the address of a freed one of the same size gets its own picture."""
    renderer = ss.Renderer("gl", **way)
    before = None
    for seed in range(6):
        scene = scene_of(field_of(seed, w0=0.5))
        camera = camera_of(scene_parts.parallel(np.random.default_rng(seed).normal(size=3)))
        assert_like_reference(renderer, scene, camera)
        image = np.array(renderer.render(scene, camera, size=SIZE).pixels)
        assert before is None or np.abs(image - before).max() > 0.1
        before = image
        del scene
        gc.collect()


@pytest.mark.gl
@pytest.mark.parametrize("resident", [False, True])
def test_one_field_under_changing_looks(resident: bool) -> None:
    """Nothing stays of the last transfer function, mode, light, camera, distance of slices and outputs."""
    renderer = ss.Renderer("gl", effects={"resident_sections": resident})
    fields = [field_of(1, w0=0.5), field_of(2, normalization="none")]
    looks: list[dict[str, Any]] = [
        {},
        {"points": [(0.6, 0, 0, 0, 0), (0.8, 1, 1, 0, 0.5), (1, 1, 1, 1, 0)]},
        {"mode": "xray"},
        {"lit": False, "points": scene_parts.ZERO_SEEN},
        {"mode": "mip", "slice_spacing": 1 / 3},
        {"preintegration": True},
        {},
    ]
    rng = np.random.default_rng(3)
    for turn in range(2):
        for number, look in enumerate(looks):
            camera = camera_of((scene_parts.parallel, scene_parts.central)[(number + turn) % 2](rng.normal(size=3)))
            outputs = ("coverage",) if number % 3 == turn else ()
            bounds = FLOAT32_HARD if "points" in look else FLOAT32
            assert_like_reference(
                renderer, scene_of(fields[(number + turn) % 2], **look), camera, bounds, outputs=outputs
            )


# Forced effects


EFFECTS = (
    "weight gradient specular two_sided opacity_correction opacity_stop elimination culling opacity_buffer "
    "general_sections empty_test compensation resident_sections precise_sections paper_slicing"
).split()


@cache
def forced_fields() -> dict[str, list[ss.Field]]:
    ball = scattered.SCENES["mixed_lattices_and_ellipsoids"](np.random.default_rng(0))["fields"]
    lattices: list[ss.Field] = [ss.RegularField(**field) for field in ball if "centers" not in field]
    empty = ss.EllipsoidField([], [], values=[])
    spheres = ss.EllipsoidField(np.random.default_rng(5).uniform(-1, 1, (80, 3)), np.full(80, 0.3), values=np.ones(80))
    return {
        "ellipsoids": [field_of(1, w0=0.5)],
        "spheres": [spheres],
        "slender": [field_of(2, 30, 1.0, 8_000.0, w0=0.3)],
        "empty": [empty],
        "empty beside others": [empty, field_of(3)],
        "thresholds": [field_of(4, w0=0.3), spheres, field_of(5, w0=0.8)],
        "lattices": [*lattices, field_of(6, w0=0.5)],
        "sums": [lattices[0], field_of(7, normalization="none", falloff=4.0)],
    }


@pytest.mark.gl
@pytest.mark.parametrize("seed", range(40))
def test_forced_effects_give_the_picture_or_refuse(seed: int) -> None:
    chance = random.Random(seed)
    names = list(forced_fields())
    fields = forced_fields()[names[seed % len(names)]]
    looks: list[dict[str, Any]] = [
        {},
        {"sampling": "slab"},
        {"mode": "xray"},
        {"mode": "mip"},
        {"preintegration": True},
        {"points": scene_parts.ZERO_SEEN},
        {"filter": "ewa"},
    ]
    look = chance.choice(looks)
    camera = camera_of(chance.choice([scene_parts.parallel(), scene_parts.central()]))
    options: dict[str, Any] = {"tile_size": chance.choice([0, 7, 16])} if chance.random() < 0.3 else {}
    options |= {"packing": chance.choice(["wide", "paper"])} if chance.random() < 0.4 else {}
    options |= {"tagging": chance.choice(["tiles", "depth_equal", "off"])} if chance.random() < 0.4 else {}
    effects = {name: chance.random() < 0.5 for name in chance.sample(EFFECTS, chance.choice([1, 2, 3, 5]))}
    try:
        assert_like_reference(ss.Renderer("gl", effects=effects, **options), scene_of(fields, **look), camera)
    except (ss.Unsupported, ss.InvalidInput) as error:
        assert str(error).count(";") >= 2


# Sizes and amounts


@pytest.mark.gl
@pytest.mark.parametrize("sampling", ["point", "slab"])
@pytest.mark.parametrize("filter_", [None, "ewa"])
@pytest.mark.parametrize(
    "camera", [scene_parts.parallel(), scene_parts.central(distance=0.01, fov_y=75)], ids=["out", "in"]
)
def test_sizes_of_eleven_decades(sampling: Any, filter_: Any, camera: dict[str, Any]) -> None:
    rng = np.random.default_rng(8)
    sizes = 10.0 ** rng.uniform(-8, 3, (300, 1)) * rng.uniform(0.3, 1, (300, 3))
    field = field_of(8, 300, w0=0.3)
    field = ss.EllipsoidField(field.centers, sizes, field.rotations, field.values, w0=0.3)
    scene = scene_of(field, sampling=sampling, filter=filter_, slice_spacing=100.0)
    assert_like_reference(renderer(), scene, camera_of(camera))


@pytest.mark.gl
@pytest.mark.parametrize("weight", [1e-30, 1e-20, 1e30, 1e37, 1e40])
@pytest.mark.parametrize("w0", [1e-30, 1e-3, 1.0, 1e30])
def test_weights_of_seventy_decades(weight: float, w0: float) -> None:
    """Beside weights of 1; what float32 cannot resolve is drawn by the processor, or by the reference alone."""
    weights = np.ones(60)
    weights[::2] = weight
    scene = scene_of(field_of(9, weights=weights, w0=w0))
    camera = camera_of(scene_parts.parallel())
    if weight == w0 == 1e-30:
        with pytest.raises(ss.Unsupported, match='weights and a w0.*at least 1e-22.*="reference", which draws it'):
            renderer().render(scene, camera, size=SIZE)
    else:
        assert_like_reference(renderer(), scene, camera, reason="weights" if weight > 1e30 else "")


@pytest.mark.gl
@pytest.mark.parametrize("unit", [1e-140, 1e-38, 1e30, 1e140])
@pytest.mark.parametrize("normalization", ["threshold", "none"])
def test_the_unit_of_values_does_not_matter(unit: float, normalization: str) -> None:
    values = np.random.default_rng(10).random(60)
    points = [(value * unit, *rest) for value, *rest in scene_parts.GENTLE]
    field = field_of(10, values=values * unit, normalization=normalization, w0=0.5)
    scene = scene_of(field, points=points)
    assert_like_reference(renderer(), scene, camera_of(scene_parts.parallel()))


@pytest.mark.gl
@pytest.mark.parametrize("falloff", [0.05, 1.0, 50.0, pytest.param(1e4, marks=pytest.mark.slow)])
@pytest.mark.parametrize("filter_", [None, "ewa"])
@pytest.mark.parametrize("sampling", ["point", "slab"])
def test_falloffs(falloff: float, filter_: Any, sampling: Any) -> None:
    scene = scene_of(field_of(11, falloff=falloff, w0=0.5), filter=filter_, sampling=sampling)
    assert_like_reference(renderer(), scene, camera_of(scene_parts.central()))


def test_a_crowd_at_one_spot_is_looked_at_from_fewer_places() -> None:
    """At all places, 3.3e8 pairs of places and kernels would be looked at."""
    count = 20_000
    crowd = ss.EllipsoidField(np.full((count, 3), 0.1), np.full(count, 0.5), values=np.arange(count) / count)
    low, high = automatic.choose([crowd]).clim
    assert 0.4 < low < 0.5 < high < 0.6
    sparse = field_of(12, 2_000, 8.0)
    (_, few), (_, many) = automatic._looked_at(crowd), automatic._looked_at(sparse)
    assert many == automatic._PLACES > 10 * few


def test_sph_weights_beyond_float64_are_an_error_without_warnings() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(ss.InvalidInput, match="entry 1, whose weight is beyond float64"):
            ss.fit.sph(np.eye(3), [1, 2, 3], [1, 1e-110, 1], masses=[1, 1, 1], densities=[1, 1, 1])


# Files


def _csv(path: Path, rng: np.random.Generator) -> None:
    rows = "\n".join(",".join(f"{number:.6g}" for number in row) for row in rng.random((20, 5)))
    path.write_text("x,y,z,radius,value\n" + rows + "\n")


def _ply(path: Path, rng: np.random.Generator) -> None:
    names = "x y z opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 f_dc_0 f_dc_1 f_dc_2".split()
    header = "ply\nformat binary_little_endian 1.0\nelement vertex 20\n"
    header += "".join(f"property float {name}\n" for name in names) + "end_header\n"
    path.write_bytes(header.encode() + rng.normal(size=(20, len(names))).astype("<f4").tobytes())


def _npz(path: Path, rng: np.random.Generator) -> None:
    ss.io.save_npz(field_of(13, 20, weights=rng.random(20)), path)


def _hdf5(path: Path, rng: np.random.Generator) -> None:
    with h5py.File(path, "w") as file:
        group = file.create_group("PartType0")
        group["Coordinates"] = rng.random((50, 3))
        group["SmoothingLength"] = np.full(50, 0.3)
        group["Density"] = rng.random(50) + 1
        group["Masses"] = np.full(50, 0.02)


def _plot3d(path: Path, rng: np.random.Generator) -> None:
    """Write a solution of big-endian Fortran records, and its grid beside it."""

    def record(*parts: bytes) -> bytes:
        whole = b"".join(parts)
        mark = np.array([len(whole)], ">i4").tobytes()
        return mark + whole + mark

    shape = record(np.array([4, 3, 5], ">i4").tobytes())
    places = np.stack(np.meshgrid(np.arange(5), np.arange(3), np.arange(4), indexing="ij"))[::-1].astype(">f4")
    path.with_suffix(".xyz").write_bytes(shape + record(places.tobytes()))
    free = np.array([0.5, 0, 1e5, 1], ">f4").tobytes()
    path.write_bytes(shape + record(free) + record((rng.random((5, 60)) + 1).astype(">f4").tobytes()))


WRITERS: dict[str, Callable[[Path, np.random.Generator], None]] = {
    "a.csv": _csv,
    "a.ply": _ply,
    "a.npz": _npz,
    "a.h5": _hdf5,
    "a.q": _plot3d,
}


def _spoiled(data: bytes, chance: random.Random) -> bytes:
    spoiled = bytearray(data)
    at = chance.randrange(min(len(spoiled), chance.choice([64, 400, len(spoiled)])))
    match chance.choice(["flip", "cut", "blank", "insert", "double"]):
        case "flip":
            spoiled[at] ^= 1 << chance.randrange(8)
        case "cut":
            del spoiled[at:]
        case "blank":
            spoiled[at : at + 4] = chance.choice([b"\xff", b"\0"]) * len(spoiled[at : at + 4])
        case "insert":
            spoiled[at:at] = chance.randbytes(chance.choice([1, 4, 50]))
        case "double":
            spoiled = spoiled[:at] + spoiled[at // 2 :]
    return bytes(spoiled)


@pytest.mark.parametrize("name", WRITERS)
def test_spoiled_files_are_fields_or_clear_errors(name: str, tmp_path: Path) -> None:
    """Corrupt bytes give errors of the package alone, soon and without warnings."""
    WRITERS[name](tmp_path / name, np.random.default_rng(14))
    chance = random.Random(name)
    grid = tmp_path / "a.xyz"
    options = {"grid": grid} if grid.exists() else {}
    assert ss.open(tmp_path / name, **options).size >= 20
    data = (tmp_path / name).read_bytes()
    refused = 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for _ in range(150):
            bad = tmp_path / ("bad_" + name)
            spoiled = _spoiled(data, chance)
            if chance.random() < 0.2:
                bad = bad.with_suffix(bad.suffix + ".gz")
                spoiled = gzip.compress(spoiled)
                spoiled = _spoiled(spoiled, chance) if chance.random() < 0.5 else spoiled
            bad.write_bytes(spoiled)
            try:
                field = ss.open(bad, **options)
            except ss.Error as error:
                assert str(error)
                refused += 1
            else:
                assert np.isfinite(field.bounds).all()
    assert refused > 20


PIXELS = ss.Camera.orthographic((0, 0, 5), (0, 0, 0), (0, 1, 0), height=SIZE[1])


@pytest.mark.gl
@pytest.mark.parametrize("length_px", [1e8, 1e10, 1e12])
@pytest.mark.parametrize("sampling", ["point", "slab"])
def test_lit_needles_of_any_length(length_px: float, sampling: Any) -> None:
    """The rounding of their centres in float32 is a hundred pixels and more."""
    rng = np.random.default_rng(17)
    length, width, turns = length_px, length_px / 5_000, rng.uniform(0, 2 * np.pi, 6)
    along = np.stack([np.cos(turns), np.sin(turns), np.zeros(6)], -1)
    across = np.stack([-np.sin(turns), np.cos(turns), np.zeros(6)], -1)
    places = -along * length * rng.uniform(0.1, 0.8, (6, 1)) + across * rng.uniform(-100, 100, (6, 1))
    turned = np.stack([np.cos(turns / 2), np.zeros(6), np.zeros(6), np.sin(turns / 2)], -1)
    field = ss.EllipsoidField(places, np.tile((length, width, width), (6, 1)), turned, rng.random(6), w0=0.3)
    scene = scene_of(field, sampling=sampling, slice_spacing=width / 3)
    camera = ss.Camera.orthographic((0, 0, 5), (0, 0, 0), (0, 1, 0), height=30)
    image = renderer().render(scene, camera, size=(1000, 30))
    found = off_by(image, ss.Renderer("reference").render(scene, camera, size=(1000, 30)))
    assert within(found, FLOAT32), found


@pytest.mark.gl
@pytest.mark.parametrize("radius_px", [1e16, 1e20, 1e60])
@pytest.mark.parametrize("camera", [PIXELS, ss.Camera.perspective((0, 0, 24), (0, 0, 0), (0, 1, 0), fov_y=53)])
def test_absurd_sizes_are_drawn_by_the_processor_in_perspective_alone(radius_px: float, camera: ss.Camera) -> None:
    """In parallel projection float64 loses them as well: the reference alone draws them."""
    field = ss.EllipsoidField(np.zeros((2, 3)), np.full((2, 3), 2 * radius_px), values=[0.1, 0.2])
    scene = scene_of(field, slice_spacing=radius_px)
    if camera is PIXELS:
        with pytest.raises(ss.Unsupported, match='pixels.*; wanted at most 1e.*backend="reference"'):
            renderer().render(scene, camera, size=SIZE)
    else:
        assert_like_reference(renderer(), scene, camera, reason="pixels at a distance of one unit of length")


@pytest.mark.gl
def test_paper_slicing_has_a_largest_size() -> None:
    for radius in (1e6, 1e9):
        rng = np.random.default_rng(18)
        places = radius * rng.uniform(-0.5, 0.5, (10, 3))
        axes = np.tile((radius, radius / 2, radius / 1.5), (10, 1))
        field = ss.EllipsoidField(places, axes, scene_parts.quaternions(rng, 10), rng.random(10), w0=0.5)
        renderer = ss.Renderer("gl", effects={"paper_slicing": True})
        scene = scene_of(field, lit=False, slice_spacing=radius / 5)
        if radius == 1e6:
            assert_like_reference(renderer, scene, PIXELS, FLOAT32_HARD)
        else:
            with pytest.raises(ss.Unsupported, match=r"radius of 1e\+09 pixels; wanted at most 1e\+07 pixels"):
                renderer.render(scene, PIXELS, size=SIZE)


def crowd(count: int, spread: float = 0.0, **options: Any) -> ss.EllipsoidField:
    rng = np.random.default_rng(19)
    places = 0.1 + spread * rng.normal(size=(count, 3))
    return ss.EllipsoidField(places, np.full(count, 0.5), values=rng.random(count), **options)


@pytest.mark.gl
@pytest.mark.parametrize("lit", [False, True])
@pytest.mark.parametrize("count", [100, 400, 3_000, 150_000])
def test_crowds_of_equal_kernels(lit: bool, count: int) -> None:
    """Sums of equal numbers drift in float32, and lights show it: the processor draws what is lit, or all of it."""
    scene = scene_of(crowd(count), lit=lit, slice_spacing=0.25)
    reason = "ellipsoids of one size at one place" if count > 100_000 else ""
    camera = camera_of(scene_parts.parallel())
    image = assert_like_reference(renderer(), scene, camera, FLOAT32_HARD, reason=reason)
    assert not (lit and count > 400) or image.stats["tiles_in_float64"] > 0


@pytest.mark.gl
def test_crowds_of_different_kernels() -> None:
    """As many kernels as above and more, which are not alike: their errors cancel, but for those of the light."""
    for count in (10_000, 400_000):
        scene = scene_of(crowd(count, 0.01), slice_spacing=0.25)
        image = assert_like_reference(renderer(), scene, camera_of(scene_parts.parallel()), FLOAT32_HARD)
        assert image.stats["tiles_in_float64"] > 0


@pytest.mark.gl
@pytest.mark.parametrize(
    "camera", [scene_parts.parallel(), scene_parts.central(distance=40, fov_y=5)], ids=["out", "deep"]
)
@pytest.mark.parametrize("thickness", [1e2, 1e4, 1e8])
def test_slabs_far_thicker_than_kernels(camera: dict[str, Any], thickness: float) -> None:
    """Float32 loses where in them a leaning kernel lies, and the processor draws it; a sphere does not lean."""
    leaning = field_of(20, w0=0.5)
    scene = scene_of(leaning, sampling="slab", mode="xray", slice_spacing=thickness)
    reason = "float32 loses the place of ellipsoids" if thickness > 1e3 else ""
    assert_like_reference(renderer(), scene, camera_of(camera), reason=reason)
    if "height" in camera:
        round_ = ss.EllipsoidField(leaning.centers, np.full(60, 0.3), values=leaning.values, w0=0.5)
        scene = scene_of(round_, sampling="slab", mode="xray", slice_spacing=thickness)
        assert_like_reference(renderer(), scene, camera_of(camera))


@pytest.mark.gl
@pytest.mark.parametrize("share", [1e-3, 1e-5])
def test_heavy_kernels_far_thinner_than_slabs(share: float) -> None:
    """On the centres of pixels, and of weights that make up for what a slab's mean leaves of them."""
    rng = np.random.default_rng(21)
    size = share * 0.25
    places = np.stack([rng.integers(0, 30, 40) - 14.5, rng.integers(0, 24, 40) - 11.5, rng.uniform(-4, 4, 40)], -1) / 6
    places[:, :2] += rng.uniform(-0.3, 0.3, (40, 2)) * size
    axes = np.tile((size, size / 2, size / 1.4), (40, 1))
    turns = scene_parts.quaternions(rng, 40)
    field = ss.EllipsoidField(places, axes, turns, rng.random(40), weights=np.full(40, 1 / share), w0=0.3)
    camera = ss.Camera.orthographic((0, 0, 5), (0, 0, 0), (0, 1, 0), height=4.0)
    scene = scene_of(field, lit=False, sampling="slab", slice_spacing=0.25)
    reason = "float32 loses the place of ellipsoids" if share < 1e-4 else ""
    assert_like_reference(renderer(), scene, camera, FLOAT32_HARD, reason=reason)


@pytest.mark.gl
def test_an_error_names_the_limit_that_applies() -> None:
    """Of two limits, the error names the smaller: a picture at the larger one would be refused again."""
    rng = np.random.default_rng(22)
    field = ss.EllipsoidField(rng.uniform(-1, 1, (60_000, 3)), np.full(60_000, 0.9), values=45 * rng.random(60_000))
    scene, camera = scene_of(field, reference_length=1 / 24), camera_of(scene_parts.parallel())
    assert_like_reference(renderer(), scene, camera, reason="values up to 4")
    with pytest.raises(ss.Unsupported, match="values up to 4.* an error of .* wanted at most") as found:
        ss.Renderer("gl", precision="float32").render(scene, camera, size=SIZE)
    # Errors grow as values do.
    assert 20 < 45 * 1e-4 / float(re.findall(r"error of ([\d.e-]+)", str(found.value))[0]) < 40


@pytest.mark.parametrize("unit", [1e-300, 1e-160, 1e160, 1e300])
def test_the_reference_shades_values_of_any_unit(unit: float) -> None:
    """Squares of such gradients overflow or underflow float64."""
    values = np.random.default_rng(10).random(60)
    pictures = []
    for factor in (1.0, unit):
        points = [(value * factor, *rest) for value, *rest in scene_parts.GENTLE]
        scene = scene_of(field_of(10, values=values * factor, w0=0.5), points=points)
        pictures.append(ss.Renderer("reference").render(scene, camera_of(scene_parts.parallel()), size=SIZE))
    assert off_by(*pictures)["rmse"] < 1e-9


@pytest.mark.gl
@pytest.mark.parametrize("radius_px", [1e-3, 1e-5, 1e-7, 1e-9])
@pytest.mark.parametrize("flat", [False, True])
def test_kernels_far_smaller_than_a_pixel_on_the_centres_of_pixels(radius_px: float, flat: bool) -> None:
    """As for samples on a lattice seen along an axis: float32 positions are coarser than such kernels."""
    rng = np.random.default_rng(15)
    width, height = SIZE
    pixel = 4.0 / height
    columns, rows = rng.integers(0, width, 40), rng.integers(0, height, 40)
    places = np.stack([columns + 0.5 - width / 2, height / 2 - rows - 0.5, np.zeros(40)], -1) * pixel
    places += rng.uniform(-0.4, 0.4, (40, 3)) * radius_px * pixel
    places[:, 2] = np.where(rng.random(40) < 0.5, 0.5, -0.5)
    sizes = np.full(40, radius_px * pixel)
    scales = np.stack([sizes, 0.8 * sizes, 0.9 * sizes], -1) if flat else sizes
    field = ss.EllipsoidField(places, scales, values=rng.uniform(0.5, 1, 40), w0=0.3)
    camera = ss.Camera.orthographic((0, 0, 5), (0, 0, 0), (0, 1, 0), height=4.0)
    scene = scene_of(field, lit=False, slice_spacing=1.0)
    assert ss.Renderer("reference").render(scene, camera, size=SIZE).pixels.max() > 0.2
    assert_like_reference(renderer(), scene, camera, FLOAT32_HARD)


@pytest.mark.gl
@pytest.mark.parametrize("radius_px", [1e7, 1e9, 1e12])
@pytest.mark.parametrize("sampling", ["point", "slab"])
def test_leaning_kernels_of_millions_of_pixels(radius_px: float, sampling: Any) -> None:
    """The centres of their sections lie beyond the range in which float32 resolves single pixels."""
    rng = np.random.default_rng(16)
    radius = radius_px * 4.0 / SIZE[1]
    turns = scene_parts.quaternions(rng, 10)
    field = ss.EllipsoidField(
        rng.uniform(-0.5, 0.5, (10, 3)), radius * np.tile((1, 0.5, 0.7), (10, 1)), turns, 0.3 * rng.random(10), w0=0.5
    )
    scene = scene_of(field, sampling=sampling, slice_spacing=radius / 5)
    camera = ss.Camera.orthographic((0, 0, 5), (0, 0, 0), (0, 1, 0), height=4.0)
    image = assert_like_reference(renderer(), scene, camera, FLOAT32_HARD)
    assert image.pixels.max() > 0.02


@pytest.mark.slow
@pytest.mark.gl
@pytest.mark.parametrize("camera", [scene_parts.parallel(), scene_parts.central()], ids=["parallel", "central"])
@pytest.mark.parametrize("forced", [False, True])
def test_gradients_of_slabs_where_neighbouring_rays_meet_different_kernels(
    camera: dict[str, Any], forced: bool
) -> None:
    """Flat kernels thinner than a pixel: of two neighbouring rays often one alone goes through."""
    length = 1 / 6 if forced else 1.0
    scene = scene_of(field_of(5, 50, 2.0, 300.0, w0=0.2), sampling="slab", reference_length=length)
    effects = {"fine_gradient": True} if forced else {}
    assert_like_reference(ss.Renderer("gl", effects=effects), scene, camera_of(camera))


def test_the_size_of_a_picture_has_a_largest_number() -> None:
    for size in ((2**31, 1), (1, 2**40)):
        with pytest.raises(ss.InvalidInput, match="each from 1 to 2147483647"):
            ss.Renderer("reference").render(scene_of(field_of(23)), camera_of(scene_parts.parallel()), size=size)
    with pytest.raises(ss.OutOfMemory, match="1000000 x 1000000 pixels"):
        ss.Renderer("reference").render(scene_of(field_of(23)), camera_of(scene_parts.parallel()), size=(10**6, 10**6))
