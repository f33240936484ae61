"""Equality, copies, pickles and representations of the public types; pickles between processes."""

from __future__ import annotations

import copy
import multiprocessing
import pickle
import time

import numpy as np
import pytest

import sheetsplat as ss

RAMP = [(0, 0, 0, 1, 0), (1, 1, 1, 0, 0.5)]
SMALL = (24, 20)


def turned(rng, count=50):
    turns = rng.normal(size=(count, 4))
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    return ss.EllipsoidField(
        rng.normal(size=(count, 3)),
        rng.uniform(0.3, 1.0, (count, 3)),
        turns,
        values=rng.random(count),
        weights=rng.uniform(0.5, 2, count),
        w0=0.2,
        min_scale=0.35,
    )


def make(name):
    rng = np.random.default_rng(7)
    volume = rng.random((6, 7, 8))
    makers = {
        "bytes": lambda: ss.RegularField((volume * 255).astype(np.uint8), spacing=(1, 2, 3), origin=(4, 5, 6)),
        "holes": lambda: ss.RegularField(np.where(volume < 0.3, np.nan, volume), nan="skip", radius=2.5, falloff=7),
        "bcc": lambda: ss.RegularField(volume.astype(np.float32), lattice="bcc", normalization="threshold", w0=0.5),
        "prefiltered": lambda: ss.RegularField(volume, prefilter=True, radius=2.5, falloff=7),
        "named": lambda: ss.RegularField(volume).with_quantity("density", "kg", "m", 0.1).opened_with({"log": 0.1}),
        "spheres": lambda: ss.EllipsoidField(rng.normal(size=(40, 3)), 0.7, values=rng.random(40)),
        "ellipsoids": lambda: turned(rng),
        "ghosts": lambda: turned(rng).with_ghost_points(distance=1.5, weight=0.5),
        "lattice": lambda: ss.EllipsoidField(
            rng.normal(size=(9, 3)), 1.0, values=rng.random(9), normalization="lattice", cell_volume=2.0
        ),
        "no kernels": lambda: ss.EllipsoidField(np.empty((0, 3)), np.empty(0), values=np.empty(0)),
        "orthographic": lambda: ss.Camera.orthographic((1, 2, 3), (0, 0, 0.1), (0, 1, 0.3), height=3.3),
        "perspective": lambda: ss.Camera.perspective((1, 2, 3), (0, 0, 0.1), fov_y=33, near=0.01),
        "fitted": lambda: ss.Camera.fit(ss.RegularField(volume), "x", "z", "perspective"),
        "transfer function": lambda: ss.TransferFunction.from_colormap("magma", (0, 0.3), (2, 5)),
        "light": lambda: ss.Light([1, 2, 3], np.array([0.5, 1, 1]), space="world"),
        "material": lambda: ss.Material(0.2, 0.7, 0.1, 12, True),
        "clip": lambda: ss.Clip([((1, 0, 0), 2)], ((0, 0, 0), (1, 1, 1))),
        "cue": lambda: ss.DepthCue(1, 2, (0.1, 0, 0), 0.5),
        "occlusion": lambda: ss.AmbientOcclusion(2, 0.5),
        "colors": lambda: ss.ScalarColors([[1, 0, 0], [0, 0, 1]], (1, 2), log=True),
        "quantity": lambda: ss.Quantity("density", "kg"),
        "scene": lambda: ss.Scene(
            [ss.RegularField(volume), turned(rng)], RAMP, lights=[ss.Light((1, 1, 1))], clip=ss.Clip([((0, 1, 0), 1)])
        ),
        "renderer": lambda: ss.Renderer("cpu", threads=2, effects={"elimination": False}, max_error=0.1),
    }
    return makers[name]()


NAMES = [
    *("bytes", "holes", "bcc", "prefiltered", "named", "spheres", "ellipsoids", "ghosts", "lattice", "no kernels"),
    *("orthographic", "perspective", "fitted", "transfer function", "light", "material", "clip", "cue", "occlusion"),
    *("colors", "quantity", "scene", "renderer"),
]
FIELDS = NAMES[:10]


@pytest.mark.parametrize("name", NAMES)
def test_copies_are_equal(name):
    first, second = make(name), make(name)
    assert first == second and not first != second and hash(first) == hash(second)
    assert first != 3 and first != make("light" if name != "light" else "material")
    for protocol in range(2, pickle.HIGHEST_PROTOCOL + 1):
        again = pickle.loads(pickle.dumps(first, protocol))
        assert type(again) is type(first) and again == first and repr(again) == repr(first)
    assert copy.copy(first) == first and copy.deepcopy(first) == first


@pytest.mark.parametrize("name", NAMES)
def test_representations_tell_types_apart(name):
    text = repr(make(name))
    assert text.startswith("Camera." if "camera" in str(type(make(name))) else type(make(name)).__name__ + "(")
    assert " at 0x" not in text and len(text) < 700


DIFFERENT = {
    "values": lambda v: ss.RegularField(v + (np.arange(v.size).reshape(v.shape) == 3)),
    "type": lambda v: ss.RegularField(v.astype(np.float32)),
    "spacing": lambda v: ss.RegularField(v, spacing=(1, 1, 1.5)),
    "origin": lambda v: ss.RegularField(v, origin=(0, 0, 1)),
    "radius": lambda v: ss.RegularField(v, radius=2.1),
    "normalization": lambda v: ss.RegularField(v, normalization="none"),
    "quantity": lambda v: ss.RegularField(v).with_quantity("density"),
    "shape": lambda v: ss.RegularField(v.reshape(6, 8, 7)),
    "nan": lambda v: ss.RegularField(v, nan="skip"),
    "prefilter": lambda v: ss.RegularField(v, prefilter=True, radius=2, falloff=5),
}


@pytest.mark.parametrize("name", DIFFERENT)
def test_fields_that_differ_are_not_equal(name):
    values = np.random.default_rng(1).random((6, 7, 8))
    assert ss.RegularField(values) != DIFFERENT[name](values)


def test_kernels_that_differ_are_not_equal():
    rng = np.random.default_rng(5)
    centers, turns = rng.normal(size=(9, 3)), rng.normal(size=(9, 4))
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    given = {"centers": centers, "scales": rng.uniform(1, 2, (9, 3)), "rotations": turns, "values": rng.random(9)}
    field = ss.EllipsoidField(**given)
    changes = [
        {"centers": centers + 1e-9},
        {"scales": given["scales"] * 2},
        {"rotations": -turns[::-1]},
        {"rotations": None},
        {"values": given["values"][::-1]},
        {"weights": np.ones(9)},
        {"w0": 0.5},
        {"falloff": 7.0},
        {"min_scale": 0.1},
    ]
    for change in changes:
        assert field != ss.EllipsoidField(**{**given, **change}), change
    assert field == ss.EllipsoidField(**given)


def test_scenes_cameras_and_images_that_differ_are_not_equal(ball):
    scene = ss.Scene(ss.RegularField(ball), RAMP)
    for change in ({"mode": "mip"}, {"opacity_stop": 1.0}, {"lights": [ss.Light()]}, {"background": "white"}):
        assert scene != scene.replace(**change)
    assert scene != scene.replace(transfer_function=[(0, 0, 0, 1, 0), (1, 1, 1, 0, 0.4)])
    assert scene == scene.replace(mode="composite")
    camera = ss.Camera.fit(scene)
    assert camera != ss.Camera.fit(scene, margin=1.1) and camera != ss.Camera.fit(scene, kind="perspective")
    renderer = ss.Renderer("reference")
    image = renderer.render(scene, camera, SMALL)
    assert image == renderer.render(scene, camera, SMALL)
    assert image != renderer.render(scene, camera, SMALL, outputs=("depth",))
    assert image != renderer.render(scene.replace(background="white"), camera, SMALL)
    with pytest.raises(TypeError):
        hash(image)


def test_arrays_of_restored_fields_cannot_be_written(ball):
    field = pickle.loads(pickle.dumps(ss.RegularField(ball, prefilter=True)))
    for array in (field.values, field.coefficients):
        with pytest.raises(ValueError):
            array[0, 0, 0] = 1


@pytest.mark.parametrize("name", ["bytes", "prefiltered", "ellipsoids"])
def test_protocol_5_hands_over_buffers(name):
    field = make(name)
    buffers = []
    head = pickle.dumps(field, 5, buffer_callback=buffers.append)
    arrays = [field.centers, field.scales, field.values] if name == "ellipsoids" else [field.values]
    if name == "prefiltered":
        arrays.append(field.coefficients)
    assert len(head) < 2000 and sum(buffer.raw().nbytes for buffer in buffers) >= sum(one.nbytes for one in arrays)
    # The buffers are the field's own memory, not copies.
    owned = [np.frombuffer(buffer.raw(), np.uint8) for buffer in buffers]
    # (Rows with gaps between them are copied.)
    assert all(not one.flags.c_contiguous or any(np.shares_memory(part, one) for part in owned) for one in arrays)
    assert pickle.loads(head, buffers=buffers) == field
    assert pickle.loads(head, buffers=[bytes(buffer.raw()) for buffer in buffers]) == field


@pytest.mark.alone
def test_a_million_kernels_pickle_in_little_time():
    rng = np.random.default_rng(2)
    count = 1_000_000
    field = ss.EllipsoidField(rng.random((count, 3)), rng.uniform(0.001, 0.01, (count, 3)), values=rng.random(count))
    began = time.perf_counter()
    buffers = []
    head = pickle.dumps(field, 5, buffer_callback=buffers.append)
    assert time.perf_counter() - began < 0.5 and len(head) < 2000
    text = pickle.dumps(field, 5)
    assert len(text) < count * 7 * 8 + 4000
    began = time.perf_counter()
    assert pickle.loads(head, buffers=buffers).size == count
    # Restoring takes the time of the constructor; lists of Python numbers would take tens of seconds.
    assert time.perf_counter() - began < 10


def drawn(parts):
    """Draw a scene in another process, and return what came and what was drawn."""
    scene, camera, renderer = parts
    return scene, camera, renderer.render(scene, camera, SMALL, outputs=("depth",))


@pytest.mark.parametrize("backend", ["cpu", "reference"])
def test_other_processes_draw_the_same_bits(backend):
    renderer = ss.Renderer(backend)
    parts = []
    for name in FIELDS[:-1]:
        field = make(name)
        scene = ss.Scene(field, RAMP, lights=[ss.Light((0.3, 0.5, 1))], material=ss.Material(specular=0.3))
        parts.append((scene, ss.Camera.fit(scene, (-1, -2, -3)), renderer))
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        answers = pool.map(drawn, parts)
    for (scene, camera, _), (scene_there, camera_there, image) in zip(parts, answers, strict=True):
        assert scene_there == scene and camera_there == camera
        here = renderer.render(scene, camera, SMALL, outputs=("depth",))
        assert image == here and here.rgba.any()
        assert np.array_equal(image.rgba, here.rgba) and np.array_equal(image.depth, here.depth)


def test_restored_images_have_all_but_the_unknown_error(ball):
    image = ss.render(ball, size=SMALL, backend="cpu", outputs=("coverage",))
    again = pickle.loads(pickle.dumps(image))
    assert again == image and again.plan == image.plan and again.stats == image.stats and again.size == SMALL
    assert np.array_equal(again.coverage, image.coverage) and repr(again) == repr(image)
    with pytest.raises(ss.InvalidInput, match="error of this picture cannot be estimated"):
        _ = again.error
    assert image.error == pickle.loads(pickle.dumps(image)).error
    deep = copy.deepcopy(image)
    deep.rgba[:] = 0
    assert image.rgba.any()


def test_copies_of_renderers_are_renderers_of_their_own(ball):
    renderer = ss.Renderer("cpu", threads=1)
    scene = ss.Scene(ss.RegularField(ball), RAMP)
    camera = ss.Camera.fit(scene)
    expected = renderer.render(scene, camera, SMALL)
    for other in (copy.copy(renderer), copy.deepcopy(renderer), pickle.loads(pickle.dumps(renderer))):
        assert other is not renderer and other == renderer and other.settings == renderer.settings
        assert np.array_equal(other.render(scene, camera, SMALL).rgba, expected.rgba)
    assert repr(renderer) == "Renderer('cpu', threads=1)" and ss.Renderer("cpu") != renderer


def test_films_and_measurements_are_equal_in_other_processes():
    values = np.random.default_rng(3).random((6, 7, 8))
    film = ss.turntable(values, frames=2, size=16)
    scene, camera = ss.Scene(ss.RegularField(values), RAMP), ss.Camera.fit(ss.RegularField(values))
    report = ss.accuracy(scene, camera, size=(16, 16), knobs="opacity_stop", repeats=1, reference_seconds=0)
    assert any(np.isnan(row.arithmetic_rmse) for row in report.rows)
    for one in (film, report, report.rows[0]):
        again = pickle.loads(pickle.dumps(one))
        assert again == one and hash(again) == hash(one) and copy.deepcopy(one) == one and one != 3
    assert film != ss.turntable(values, frames=3, size=16) and film != ss.turntable(values + 1, frames=2, size=16)
    assert report.rows[0] != report.rows[1]
