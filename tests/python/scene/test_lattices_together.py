"""Lattices whose kernels differ in their values alone: one walk over all samples makes the picture of separate ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import sheetsplat as ss

SHAPE = (15, 17, 19)
SIZE = (57, 49)
LIGHT = [ss.Light((0.4, 0.3, 1))]
FUNCTIONS = [
    ss.TransferFunction([(0, *color, 0), (0.3, *color, 0), (1, *color, 0.4)])
    for color in ((1, 0.2, 0.1), (0.1, 0.9, 0.3), (0.2, 0.3, 1), (0.9, 0.8, 0.1), (0.5, 0.5, 0.5))
]


def blobs(number: int, *, dtype: Any = np.float64) -> np.ndarray:
    """Return three balls of smooth values, others for each number, that overlap those of other numbers."""
    rng = np.random.default_rng(number)
    at = np.moveaxis(np.indices(SHAPE), 0, -1).astype(float)
    middle = (np.array(SHAPE) - 1) / 2
    values = sum(np.exp(-((at - middle - rng.uniform(-4, 4, 3)) ** 2).sum(-1) / rng.uniform(6, 14)) for _ in range(3))
    values = np.where(values < 0.02, 0.0, np.minimum(values, 1.0))
    return (values * 255).astype(np.uint8) if dtype == np.uint8 else values.astype(dtype)


def channels(count: int, **lattice: Any) -> list[ss.RegularField]:
    return [ss.RegularField(blobs(number), base=0.0, **lattice) for number in range(count)]


LEANING = [[1.0, 0.1, 0.0], [0.2, 0.9, 0.1], [0.0, -0.2, 1.2]]
CASES: dict[str, tuple[int, dict[str, Any], dict[str, Any]]] = {
    "two": (2, {}, {}),
    "four": (4, {}, {}),
    "five": (5, {}, {}),
    "surfaces": (3, {}, {"mode": "isosurface", "iso_value": [(0.4, 0.5), (0.7, 0.8)]}),
    "pre-integrated": (3, {}, {"preintegration": True}),
    "no light": (3, {}, {"lights": []}),
    "thin slices": (3, {}, {"slice_spacing": 0.09}),
    "boundary zero": (3, {"boundary": "zero"}, {}),
    "spacing": (3, {"spacing": (0.7, 1.3, 1.0)}, {}),
    "leaning axes": (3, {"axes": LEANING}, {}),
    "bcc": (3, {"lattice": "bcc"}, {}),
    "clip": (3, {}, {"clip": ss.Clip(planes=[((0.5, 0.7, 0.2), 9.0)])}),
    # Kinds of kernels that have no walk of several, and ways in which they are drawn one by one.
    "slabs": (3, {}, {"sampling": "slab"}),
    "analytic": (3, {}, {"gradient": "analytic"}),
    "filter": (3, {}, {"filter": "ewa"}),
}
WALKED_ALONE = ("slabs", "analytic", "filter")


def both(scene: ss.Scene, view: dict[str, Any], size: tuple[int, int] = SIZE) -> tuple[ss.Image, ss.Image]:
    """Return the picture and that of separate walks: coverage sums weights, for which there is no walk of several."""
    camera = ss.Camera.fit(scene.fields[0], direction=(0.7, -0.45, 0.55), up=(0.1, 0.2, 1), **view)
    renderer = ss.Renderer(backend="cpu", precision="float64")
    image, alone = renderer.render(scene, camera, size), renderer.render(scene, camera, size, outputs=["coverage"])
    assert image.rgba[..., 3].max() > 0.2
    np.testing.assert_allclose(image.rgba, alone.rgba, atol=1e-6)
    return image, alone


def are_sorted_once(scene: ss.Scene, functions: list[ss.TransferFunction], view: dict[str, Any],
                    **options: Any) -> bool:  # fmt: skip
    """Return whether rows are sorted by tiles once for all fields, and not once for each."""
    camera = ss.Camera.fit(scene.fields[0], direction=(0.7, -0.45, 0.55), up=(0.1, 0.2, 1), **view)
    options.setdefault("slice_spacing", 1.0)

    def sorted_bytes(fields: Any, function: Any) -> float:
        # (One renderer keeps the index of the last scene's fields.)
        drawn = ss.Scene(fields, function, lights=LIGHT, **options)
        return ss.Renderer(backend="cpu").render(drawn, camera, SIZE).stats["bytes_view"]

    each = [sorted_bytes(field, function) for field, function in zip(scene.fields, functions, strict=True)]
    return sorted_bytes(list(scene.fields), functions) < 0.99 * sum(each)


@pytest.mark.parametrize("view", [{}, {"kind": "perspective", "fov_y": 50}], ids=["orthographic", "perspective"])
@pytest.mark.parametrize("name", CASES)
def test_one_walk_makes_the_picture_of_several(name: str, view: dict[str, Any]) -> None:
    count, lattice, options = CASES[name]
    scene = ss.Scene(channels(count, **lattice), FUNCTIONS[:count], **{"lights": LIGHT, **options})
    both(scene, view)
    if "mode" not in options and "lights" not in options:
        assert are_sorted_once(scene, FUNCTIONS[:count], view, **options) == (name not in WALKED_ALONE)


@pytest.mark.parametrize("view", [{}, {"kind": "perspective", "fov_y": 50}], ids=["orthographic", "perspective"])
def test_kernels_of_many_pixels(view: dict[str, Any]) -> None:
    scene = ss.Scene(channels(3), FUNCTIONS[:3], lights=LIGHT)
    both(scene, view, (420, 400))


def test_samples_of_other_types_and_scales() -> None:
    fields = [ss.RegularField(blobs(0, dtype=np.uint8), base=0.0), ss.RegularField(blobs(1), base=0.0),
              ss.RegularField(1000 * blobs(2, dtype=np.float32), base=0.0)]  # fmt: skip
    functions = [ss.TransferFunction([(0, *color, 0), (0.2 * top, *color, 0), (top, *color, 0.5)])
                 for color, top in (((1, 0, 0), 255), ((0, 1, 0), 1), ((0, 0, 1), 1000))]  # fmt: skip
    scene = ss.Scene(fields, functions, lights=LIGHT)
    both(scene, {})
    assert are_sorted_once(scene, functions, {})


def test_lattices_that_lie_elsewhere_are_walked_by_themselves() -> None:
    moved = ss.RegularField(blobs(3), base=0.0, origin=(0.5, 0, 0))
    fine = ss.RegularField(blobs(4), base=0.0, radius=2.5, falloff=7.0)
    fields = [moved, *channels(2), fine]
    scene = ss.Scene(fields, FUNCTIONS[:4], lights=LIGHT)
    both(scene, {})
    assert are_sorted_once(scene, FUNCTIONS[:4], {})
    apart = ss.Scene([moved, fields[1], fine], FUNCTIONS[:3], lights=LIGHT)
    assert not are_sorted_once(apart, FUNCTIONS[:3], {})


def test_lattices_with_few_samples_in_common_are_walked_by_themselves() -> None:
    values = np.zeros((2, *SHAPE))
    values[0, :, :, :6] = values[1, :, :, -6:] = 1.0
    fields = [ss.RegularField(one, base=0.0, boundary="zero") for one in values]
    scene = ss.Scene(fields, FUNCTIONS[:2], lights=LIGHT)
    both(scene, {})
    assert not are_sorted_once(scene, FUNCTIONS[:2], {})


def test_missing_samples() -> None:
    values = [blobs(number) for number in range(3)]
    values[1][5:8, 5:8, 5:9] = np.nan
    fields = [ss.RegularField(one, base=0.0, nan="skip") for one in values]
    both(ss.Scene(fields, FUNCTIONS[:3], lights=LIGHT), {})


def test_volumes_of_colours() -> None:
    values = blobs(0)
    field = ss.RegularField(np.stack([values, values**2, 1 - values], axis=-1))
    opacity = [(0, 1, 1, 1, 0), (0.2, 1, 1, 1, 0), (1, 1, 1, 1, 0.4)]
    scene = ss.Scene(field, opacity, lights=LIGHT)
    camera = ss.Camera.fit(field, direction=(0.7, -0.45, 0.55), up=(0.1, 0.2, 1))
    image = ss.Renderer(backend="cpu").render(scene, camera, SIZE)
    reference = ss.Renderer(backend="reference").render(scene, camera, SIZE)
    assert np.sqrt(np.mean((image.rgba - reference.rgba) ** 2)) < 2e-6


def test_shadows_of_channels() -> None:
    """Light is drawn of single groups, whose lattices are walked by themselves."""
    both(ss.Scene(channels(3), FUNCTIONS[:3], lights=LIGHT, shadows=True, mode="isosurface",
                  iso_value=[(0.4, 0.7)]), {})  # fmt: skip


def test_a_lattice_twice_in_float32() -> None:
    """What a lattice adds does not depend on those that are walked with it: one that hardly shows changes nothing."""
    fields = channels(3)
    shown, hidden = FUNCTIONS[0], ss.TransferFunction([(0, 0, 0, 0, 0), (0.3, 0, 0, 0, 0), (1, 0, 0, 0, 1e-30)])
    camera = ss.Camera.fit(fields[0], direction=(0.7, -0.45, 0.55), up=(0.1, 0.2, 1))
    renderer = ss.Renderer(backend="cpu", precision="float32")
    several = renderer.render(ss.Scene([fields[0], fields[0]], [shown, hidden], lights=LIGHT), camera, SIZE)
    alone = renderer.render(ss.Scene([fields[0]], [shown], lights=LIGHT), camera, SIZE)
    np.testing.assert_allclose(several.rgba, alone.rgba, atol=1e-6)
