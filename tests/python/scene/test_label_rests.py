"""Sets of labels whose background has no kernels of its own: pictures are those in which all labels are splatted."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import sheetsplat as ss

SHAPE = (20, 18, 22)
SIZE = (61, 47)


def regions(*, ends: bool = True) -> np.ndarray:
    """Return labels 1 to 3 around three places, in a background of 0; ends: up to edges and corners of the volume."""
    rng = np.random.default_rng(4)
    at = np.moveaxis(np.indices(SHAPE), 0, -1).astype(float)
    middle = (np.array(SHAPE) - 1) / 2
    places = middle + rng.uniform(-4, 4, (3, 3))
    away = np.stack([((at - place) ** 2).sum(axis=-1) for place in places])
    labels = 1 + np.argmin(away, axis=0).astype(np.uint8)
    labels[((at - middle) ** 2).sum(axis=-1) > 6.5**2] = 0
    if ends:
        labels[:3, :4, :3] = 1
        labels[-2:, :, -4:] = 2
        labels[7:12, -3:, 5:9] = 3
    return labels


def colors(opacity: float, *shown: int) -> ss.LabelColors:
    hues = {1: (1, 0.2, 0.1), 2: (0.1, 0.8, 0.3), 3: (0.2, 0.3, 1)}
    return ss.LabelColors({label: (*hues[label], opacity) for label in shown or hues})


LEANING = [[1.0, 0.1, 0.0], [0.2, 0.9, 0.1], [0.0, -0.2, 1.2]]
CASES: dict[str, tuple[dict[str, Any], dict[str, Any], ss.LabelColors]] = {
    "opaque": ({}, {}, colors(1.0)),
    "translucent": ({}, {}, colors(0.2)),
    "surfaces": ({}, {"mode": "isosurface"}, colors(1.0)),
    "translucent surfaces": ({}, {"mode": "isosurface"}, colors(0.4)),
    "one of three": ({}, {}, colors(1.0, 2)),
    "pre-integrated": ({}, {"preintegration": True}, colors(0.3)),
    "thin slices": ({}, {"slice_spacing": 0.23}, colors(0.5)),
    "slices far apart": ({}, {"slice_spacing": 2.6, "reference_length": 1.0}, colors(0.8)),
    "boundary zero": ({"boundary": "zero"}, {}, colors(0.6)),
    "spacing": ({"spacing": (0.7, 1.3, 1.0)}, {}, colors(0.7)),
    "leaning axes": ({"axes": LEANING}, {}, colors(0.7)),
    "wide kernels": ({"radius": 3.0, "falloff": 8.0}, {}, colors(0.7)),
    "narrow kernels": ({"radius": 1.4, "falloff": 4.0}, {}, colors(0.7)),
    "bcc": ({"lattice": "bcc", "boundary": "zero"}, {}, colors(0.7)),
    "clip": ({}, {"clip": ss.Clip(planes=[((0.5, 0.7, 0.2), 9.0)])}, colors(0.7)),
}


def field(lattice: dict[str, Any], *, ends: bool = True) -> ss.RegularField:
    return ss.RegularField(regions(ends=ends), labels=True, **lattice)


def both(volume: ss.RegularField, function: ss.LabelColors, options: dict[str, Any], view: dict[str, Any], **by: Any):
    scene = ss.Scene(volume, function, lights=[ss.Light((0.4, 0.3, 1))], **options)
    camera = ss.Camera.fit(volume, direction=(0.7, -0.45, 0.55), up=(0.1, 0.2, 1), **view)
    renderer = ss.Renderer(backend="cpu", **by)
    # Coverage counts the kernels of all labels, so that they are splatted.
    return renderer.render(scene, camera, SIZE), renderer.render(scene, camera, SIZE, outputs=["coverage"])


@pytest.mark.parametrize("view", [{}, {"kind": "perspective", "fov_y": 50}], ids=["orthographic", "perspective"])
@pytest.mark.parametrize("name", CASES)
def test_what_the_labels_leave_is_the_background(name: str, view: dict[str, Any]) -> None:
    lattice, options, function = CASES[name]
    image, splatted = both(field(lattice), function, options, view, precision="float64")
    assert image.rgba[..., 3].max() > 0.3
    assert image.stats["sections_drawn"] < 0.9 * splatted.stats["sections_drawn"]
    np.testing.assert_allclose(image.rgba, splatted.rgba, atol=2e-7)


def test_float32_and_tiles_of_any_size() -> None:
    image, splatted = both(field({}), colors(0.5), {}, {})
    assert np.sqrt(np.mean((image.rgba - splatted.rgba) ** 2)) < 5e-6
    volume = field({})
    scene = ss.Scene(volume, colors(0.5), lights=[ss.Light((0.4, 0.3, 1))])
    camera = ss.Camera.fit(volume, direction=(0.7, -0.45, 0.55), up=(0.1, 0.2, 1))
    for edge in (24, 126):
        other = ss.Renderer(backend="cpu", tile_size=edge).render(scene, camera, (150, 131))
        whole = ss.Renderer(backend="cpu", precision="float64").render(scene, camera, (150, 131))
        assert np.sqrt(np.mean((other.rgba - whole.rgba) ** 2)) < 5e-6


def test_few_layers_beyond_an_edge_are_told_apart() -> None:
    """A label that fills the volume's corner: gradients beyond it read sums that lack mirrored samples."""
    values = np.zeros((9, 9, 9), np.uint8)
    values[:4, :4, :4] = 1
    volume = ss.RegularField(values, labels=True)
    scene = ss.Scene(volume, colors(1.0, 1), lights=[ss.Light((0.4, 0.3, 1))], slice_spacing=0.8)
    camera = ss.Camera.orthographic((-9, -8, -7), (0, 0, 0), up=(0, 0, 1), height=9)
    size = (9, 9)  # pixels as wide as a sample, so that gradients reach beyond two faces
    plain = ss.Renderer(backend="cpu", precision="float64").render(scene, camera, size)
    reference = ss.Renderer(backend="reference").render(scene, camera, size)
    assert np.ptp(reference.rgba[..., 0][reference.rgba[..., 3] > 0]) > 0.05
    np.testing.assert_allclose(plain.rgba, reference.rgba, atol=1e-6)


def test_a_background_with_a_colour_is_splatted() -> None:
    every = ss.LabelColors({0: (1, 1, 1, 0.02), 1: (1, 0, 0, 0.5), 2: (0, 1, 0, 0.5), 3: (0, 0, 1, 0.5)})
    image, splatted = both(field({}, ends=False), every, {}, {}, precision="float64")
    assert image.stats["kernels_drawn"] == splatted.stats["kernels_drawn"]
    np.testing.assert_allclose(image.rgba, splatted.rgba, atol=2e-7)
