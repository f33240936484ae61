"""Scattered ellipsoids under bad and extreme input: the right picture or a clear error, and nothing left over."""

from __future__ import annotations

import gc
import gzip
import random
import time
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scattered_scenes as scattered
from image_checks import FLOAT32, FLOAT32_HARD

import sheetsplat as ss
from sheetsplat import _sheetsplat, automatic

SIZE = (30, 24)
Image = ss.Image


def off_by(actual: Image, expected: Image) -> tuple[float, float]:
    """Return RMSE and P99.9 of section 8."""
    one, other = np.ascontiguousarray(actual), np.ascontiguousarray(expected)
    found = _sheetsplat.compare(one, other, 1 if one.ndim == 2 else 4)
    return found["rmse"], found["p99_9"]


def assert_like_reference(
    renderer: ss.Renderer, scene: ss.Scene, camera: ss.Camera, bounds: tuple[float, float] = FLOAT32, **options: Any
) -> None:
    """Compare a renderer's picture with the reference's."""
    image = renderer.render(scene, camera, size=SIZE, **options)
    expected = ss.Renderer("reference").render(scene, camera, size=SIZE, **options)
    assert np.isfinite(np.asarray(image)).all()
    rmse, p99_9 = off_by(image, expected)
    assert rmse <= bounds[0] and p99_9 <= bounds[1], (rmse, p99_9)


def camera_of(arguments: dict[str, Any]) -> ss.Camera:
    return (ss.Camera.orthographic if "height" in arguments else ss.Camera.perspective)(**arguments)


def field_of(
    seed: int, count: int = 60, overlap: float = 2.0, aspect: float = 4.0, **options: Any
) -> ss.EllipsoidField:
    return ss.EllipsoidField(**scattered.cloud(np.random.default_rng(seed), count, overlap, aspect, **options))


def scene_of(fields: Any, **options: Any) -> ss.Scene:
    """Return a lit scene whose picture does not jump."""
    lit = options.pop("lit", True)
    points = options.pop("points", scattered.GENTLE)
    lights = [ss.Light(**light) for light in scattered.LIGHTS] if lit else []
    material = ss.Material(**scattered.MATERIAL)
    return ss.Scene(
        fields,
        ss.TransferFunction(points),
        lights=lights,
        material=material,
        **({"slice_spacing": 1 / 6, "opacity_stop": 1.0} | options),
    )


# What is kept between pictures


WAYS = [
    {},
    {"packing": "paper"},
    {"effects": {"resident_sections": True}},
    {"effects": {"paper_slicing": True}},
    {"effects": {"gather": True}},
    {"effects": {"opacity_buffer": True}},
]


@pytest.mark.gl
@pytest.mark.parametrize("way", WAYS, ids=str)
def test_a_field_that_takes_the_place_of_another_is_a_new_one(way: dict[str, Any]) -> None:
    """Fields that are made where others were freed, of the same number of kernels, have pictures of their own."""
    renderer = ss.Renderer("gl", **way)
    before = None
    for seed in range(6):
        scene = scene_of(field_of(seed, w0=0.5))
        camera = camera_of(scattered.parallel(np.random.default_rng(seed).normal(size=3)))
        assert_like_reference(renderer, scene, camera)
        image = np.array(renderer.render(scene, camera, size=SIZE))
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
        {"lit": False, "points": scattered.ZERO_SEEN},
        {"mode": "mip", "slice_spacing": 1 / 3},
        {"preintegration": True},
        {},
    ]
    rng = np.random.default_rng(3)
    for turn in range(2):
        for number, look in enumerate(looks):
            camera = camera_of((scattered.parallel, scattered.central)[(number + turn) % 2](rng.normal(size=3)))
            outputs = ("coverage",) if number % 3 == turn else ()
            bounds = FLOAT32_HARD if "points" in look else FLOAT32
            assert_like_reference(
                renderer, scene_of(fields[(number + turn) % 2], **look), camera, bounds, outputs=outputs
            )


# Forced effects


EFFECTS = (
    "weight gradient specular two_sided opacity_correction opacity_stop elimination culling opacity_buffer points "
    "vertex_arrays four_channels general_sections empty_test compensation count_fragments resident_sections "
    "precise_sections paper_slicing gather"
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
        {"points": scattered.ZERO_SEEN},
        {"filter": "ewa"},
    ]
    look = chance.choice(looks)
    camera = camera_of(chance.choice([scattered.parallel(), scattered.central()]))
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
    "camera", [scattered.parallel(), scattered.central(distance=0.01, fov_y=75)], ids=["out", "in"]
)
def test_sizes_of_eleven_decades(sampling: Any, filter_: Any, camera: dict[str, Any]) -> None:
    rng = np.random.default_rng(8)
    sizes = 10.0 ** rng.uniform(-8, 3, (300, 1)) * rng.uniform(0.3, 1, (300, 3))
    field = field_of(8, 300, w0=0.3)
    field = ss.EllipsoidField(field.centers, sizes, field.rotations, field.values, w0=0.3)
    scene = scene_of(field, sampling=sampling, filter=filter_, slice_spacing=100.0)
    assert_like_reference(ss.Renderer("gl"), scene, camera_of(camera))


@pytest.mark.gl
@pytest.mark.parametrize("weight", [1e-30, 1e-20, 1e30, 1e37, 1e40])
@pytest.mark.parametrize("w0", [1e-30, 1e-3, 1.0, 1e30])
def test_weights_of_seventy_decades(weight: float, w0: float) -> None:
    """Beside weights of 1; what float32 cannot tell apart is refused."""
    weights = np.ones(60)
    weights[::2] = weight
    scene = scene_of(field_of(9, weights=weights, w0=w0))
    try:
        assert_like_reference(ss.Renderer("gl"), scene, camera_of(scattered.parallel()))
    except ss.Unsupported as error:
        assert weight > 1e30 or (weight == 1e-30 and w0 == 1e-30), error
        assert "weights" in str(error)


@pytest.mark.gl
@pytest.mark.parametrize("unit", [1e-140, 1e-38, 1e30, 1e140])
@pytest.mark.parametrize("normalization", ["threshold", "none"])
def test_the_unit_of_values_does_not_matter(unit: float, normalization: str) -> None:
    values = np.random.default_rng(10).random(60)
    points = [(value * unit, *rest) for value, *rest in scattered.GENTLE]
    field = field_of(10, values=values * unit, normalization=normalization, w0=0.5)
    scene = scene_of(field, points=points)
    assert_like_reference(ss.Renderer("gl"), scene, camera_of(scattered.parallel()))


@pytest.mark.gl
@pytest.mark.parametrize("falloff", [0.05, 1.0, 50.0, 1e4])
@pytest.mark.parametrize("filter_", [None, "ewa"])
@pytest.mark.parametrize("sampling", ["point", "slab"])
def test_falloffs(falloff: float, filter_: Any, sampling: Any) -> None:
    scene = scene_of(field_of(11, falloff=falloff, w0=0.5), filter=filter_, sampling=sampling)
    assert_like_reference(ss.Renderer("gl"), scene, camera_of(scattered.central()))


def test_a_crowd_at_one_spot_is_looked_at_in_time() -> None:
    """Places and kernels would be 1.6e9 pairs."""
    count = 100_000
    crowd = ss.EllipsoidField(np.full((count, 3), 0.1), np.full(count, 0.5), values=np.arange(count) / count)
    began = time.process_time()
    low, high = automatic.choose([crowd]).clim
    assert time.process_time() - began < 15
    assert 0.4 < low < 0.5 < high < 0.6
    sparse = field_of(12, 2_000, 8.0)
    assert automatic._affordable(sparse) == automatic._PLACES > 10 * automatic._affordable(crowd)


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
    """Whatever is wrong with the bytes, nothing but the package's own errors comes out, without a warning, at once."""
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
