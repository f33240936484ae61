"""Groups that end in different places, and fields with holes, on the processor and by OpenGL, against the reference."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest
from image_checks import handed_over
from test_oracle import build_effects
from test_oracle_ends import ends_scene

import sheetsplat as ss

BACKENDS = ("cpu", pytest.param("gl", marks=pytest.mark.gl))
MODES = ("composite", "isosurface", "xray", "mip", "minimum", "average")
LOOKS = [(mode, look) for mode in MODES for look in ({}, {"lights": [ss.Light((1, 1, 2))]}, {"sampling": "slab"})]
LOOKS += [("composite", {"preintegration": True})]
#: What shadows and occlusion differ by belongs to the picture's stated error.
LIGHT = ("shadows", "ambient_occlusion")


def ends_of(parts: dict[str, Any]) -> list[str]:
    """Return a text for where the first field of each group ends."""
    first = [parts["fields"][group[0]] for group in parts["groups"]]
    return [str((f["values"].shape, f["spacing"], f["origin"])) if f.get("boundary") == "edge" else "" for f in first]


@functools.cache
def scenes(mode: str) -> list[dict[str, Any]]:
    """Return scenes of a mode whose groups end in different places."""
    found: list[dict[str, Any]] = []
    for seed in range(1000, 1800):
        parts = ends_scene(seed)
        if parts["scene"]["mode"] == mode and len(set(ends_of(parts))) > 1:
            parts["scene"] = {name: value for name, value in parts["scene"].items() if name not in LIGHT}
            found.append(parts)
        if len(found) == 8:
            break
    return found


def distance(one: Any, other: Any) -> float:
    """Return the root mean square difference of two scalar or coloured pictures, over their largest value above 1."""
    a, b = (np.asarray(image, float) for image in (one, other))
    assert np.array_equal(np.isnan(a), np.isnan(b))
    largest = max(1.0, float(np.abs(np.nan_to_num(a)).max(initial=0.0)))
    return float(np.sqrt(np.mean(np.nan_to_num(a - b) ** 2)) / largest)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("mode", MODES)
def test_random_groups_with_several_ends(mode: str, backend: str, reference_renderer: ss.Renderer) -> None:
    renderer, drawn, shown = ss.Renderer(backend=backend), 0, 0
    for parts in scenes(mode):
        scene, camera, size = build_effects(ss, parts)
        outputs = ("coverage",)
        expected = reference_renderer.render(scene, camera, size=size, outputs=outputs)
        image = renderer.render(scene, camera, size=size, outputs=outputs)
        # Values that are far from what a transfer function resolves, and quotients of sums that are lit.
        reason = handed_over(image)
        assert not reason or any(one in reason for one in ("error bound", "close-up", "coverage of fields"))
        drawn += image.plan.backend == backend
        shown += bool(np.nan_to_num(expected.pixels).any())
        assert distance(expected.pixels, image.pixels) < 1e-4
        assert distance(expected.coverage, image.coverage) < 1e-5
    assert drawn >= (4 if backend == "cpu" else 2) and shown >= 2


def two_volumes(mode: str, **options: Any) -> ss.Scene:
    """Return two volumes far from 0, one of which sticks out of the other, and a cloud between their values."""
    rng = np.random.default_rng(5)
    z, y, x = np.mgrid[-1:1:8j, -1:1:8j, -1:1:8j]
    air = ss.RegularField(280 + 3 * np.sin(3 * x) * np.cos(2 * y) + z, spacing=(0.25,) * 3, origin=(-0.875,) * 3)
    sea = ss.RegularField(1e5 + 100 * y + 50 * x * z, spacing=(0.2,) * 3, origin=(-0.1, -0.5, -0.3))
    rain = ss.EllipsoidField(rng.uniform(-1, 1, (20, 3)), np.full(20, 0.4), values=rng.uniform(4, 6, 20), base=2.0)
    ramps = [
        ss.TransferFunction([(low, 0.2, 0.3, 1.0, 0.0), (high, 1.0, 0.8, 0.1, 0.6)])
        for low, high in ((278, 284), (99_900, 100_100), (2, 6))
    ]
    iso = {"iso_value": [(281.0, 0.5), (100_020.0, 0.4), (4.0, 0.7)]} if mode == "isosurface" else {}
    return ss.Scene([air, sea, rain], ramps, mode=mode, **iso, **options)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("mode", "look"), LOOKS)
def test_volumes_that_stick_out(mode: str, look: dict[str, Any], backend: str, reference_renderer: ss.Renderer) -> None:
    scene = two_volumes(mode, **look)
    camera = ss.Camera.perspective((1.5, 1.2, 4.0), (0.2, 0.0, 0.2), fov_y=40)
    expected = reference_renderer.render(scene, camera, size=(24, 20))
    image = ss.Renderer(backend=backend).render(scene, camera, size=(24, 20))
    assert distance(expected.pixels, image.pixels) < 2e-6
    # Each volume ends where it does: not as if it fell to 0, and not as if both ended together.
    zero = scene.replace(
        field=[
            one.replace(boundary="zero", base=one.base) if isinstance(one, ss.RegularField) else one
            for one in scene.fields
        ]
    )
    other = reference_renderer.render(zero, camera, size=(24, 20))
    assert np.abs(np.nan_to_num(expected.pixels) - np.nan_to_num(other.pixels)).max() > 1e-2


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("mode", ["composite", "isosurface"])
def test_volumes_that_stick_out_shade_each_other(mode: str, backend: str, reference_renderer: ss.Renderer) -> None:
    light = ss.Light((1, 1, 2), space="world")
    scene = two_volumes(mode, lights=[light], shadows=True, ambient_occlusion=ss.AmbientOcclusion(0.5, 0.8))
    camera = ss.Camera.perspective((1.5, 1.2, 4.0), (0.2, 0.0, 0.2), fov_y=40)
    expected = reference_renderer.render(scene, camera, size=(24, 20))
    image = ss.Renderer(backend=backend).render(scene, camera, size=(24, 20))
    owed = np.hypot(*(part for cause, part in image.error.budget.items() if "shadows" in cause or "occlusion" in cause))
    assert distance(expected.pixels, image.pixels) < max(1e-4, 2 * owed)
    bright = reference_renderer.render(scene.replace(shadows=False), camera, size=(24, 20))
    assert distance(expected.pixels, bright.pixels) > 5e-3
    assert mode == "composite" or distance(expected.pixels, image.pixels) < 1e-3


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("apart", [False, True])
def test_coverage_counts_the_weights_beside_holes(apart: bool, backend: str, reference_renderer: ss.Renderer) -> None:
    rng = np.random.default_rng(0)
    samples = rng.random((8, 8, 8))
    samples[2:5, 2:5, 2:6] = np.nan
    place: dict[str, Any] = {"spacing": (0.2,) * 3, "origin": (-0.8,) * 3}
    holes = ss.RegularField(samples, nan="skip", **place)
    whole = ss.RegularField(rng.random((8, 8, 8)), **place)
    ramp = ss.TransferFunction([(0, 1, 0, 0, 0.1), (1, 0, 1, 0, 0.5)])
    scene = ss.Scene([holes, whole], [ramp, ramp] if apart else ramp)
    camera = ss.Camera.fit(holes)
    expected = reference_renderer.render(scene, camera, size=(12, 12), outputs=("coverage",))
    image = ss.Renderer(backend=backend).render(scene, camera, size=(12, 12), outputs=("coverage",))
    # One sum of weights cannot tell that each of the fields is empty.
    summed = backend == "gl" and not apart
    assert ("coverage of fields that add up" in handed_over(image)) == summed
    assert image.plan.backend == ("cpu" if summed else backend)
    assert distance(expected.coverage, image.coverage) < 1e-6
    assert distance(expected.pixels, image.pixels) < 1e-6


@pytest.mark.parametrize("backend", BACKENDS)
def test_xrays_pass_over_points_beside_missing_samples(backend: str, reference_renderer: ss.Renderer) -> None:
    rng = np.random.default_rng(0)
    samples = rng.uniform(1, 2, (6, 6, 6))
    samples[rng.random(samples.shape) < 0.6] = np.nan
    samples[0, 0, :] = 0
    field = ss.RegularField(samples, nan="skip")
    assert field.base == 0
    scene = ss.Scene(field, ss.TransferFunction([(0, 0, 0, 0, 0), (1, 1, 1, 1, 1)]), mode="xray")
    camera = ss.Camera.fit(field, direction=(1, 1, 1), margin=1.1)
    expected = reference_renderer.render(scene, camera, size=(40, 40))
    assert distance(expected.pixels, ss.Renderer(backend=backend).render(scene, camera, size=(40, 40)).pixels) < 1e-6
    # Sums of kernels alone would be twice as much.
    plain = scene.replace(field=field.replace(normalization="none"))
    assert reference_renderer.render(plain, camera, size=(40, 40)).scalar.sum() > 1.5 * expected.scalar.sum()
