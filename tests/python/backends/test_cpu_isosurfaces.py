"""Many isosurfaces on the processor: crossings are found by a search through the sorted values."""

from __future__ import annotations

import numpy as np
import pytest
from image_checks import FLOAT32, FLOAT32_HARD, assert_close, distance

import sheetsplat as ss

SIZE = (56, 48)
COLORS = [(0.0, 0.1, 0.3, 0.9, 0.0), (0.5, 0.9, 0.2, 0.1, 0.3), (1.0, 0.2, 0.9, 0.4, 0.6)]


def waves():
    k, j, i = np.mgrid[-1:1:12j, -1:1:14j, -1:1:13j]
    return (0.5 + 0.4 * np.sin(5 * k) * np.cos(4 * j) * np.cos(3 * i)).astype(np.float32)


def values_of(kind, count):
    rng = np.random.default_rng(count)
    if kind == "even":
        values = np.linspace(0.2, 0.81, count)  # none so near the base, 0.5, that float32 is refused
    elif kind == "crowded":  # most of them in one cell of the table
        values = np.concatenate([0.4 + 1e-3 * rng.random(count - 2), [0.3, 1e6]])
    else:  # with twins, and such as nothing reaches
        values = np.append(rng.choice(np.linspace(-0.3963, 1.4, count), count - 1), 0.4)
    return list(rng.permutation(values))


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("kind", ["even", "crowded", "any"])
@pytest.mark.parametrize("count", [2, 17, 64])
@pytest.mark.parametrize("boundary", ["edge", "zero"])
def test_many_surfaces(boundary, count, kind, precision):
    rng = np.random.default_rng(7)
    surfaces = [(float(value), float(rng.uniform(0.02, 0.3))) for value in values_of(kind, count)]
    scene = ss.Scene(
        ss.RegularField(waves(), boundary=boundary),
        COLORS,
        mode="isosurface",
        iso_value=surfaces,
        lights=[ss.Light((0.3, 0.5, 1.0))],
    )
    camera = ss.Camera.fit(scene, direction=(0.4, 0.7, -1.0))
    image = ss.Renderer("cpu", precision=precision, threads=1).render(scene, camera, size=SIZE)
    again = ss.Renderer("cpu", precision=precision, threads=3).render(scene, camera, size=SIZE)
    assert np.array_equal(image.rgba, again.rgba)
    expected = ss.Renderer("reference").render(scene, camera, size=SIZE).rgba
    text = f"cpu {count} {kind} surfaces {precision} {boundary}"
    # Jumps where a ray just touches a surface, or leaves it (section 9).
    jumps = np.zeros(SIZE[::-1], bool)
    for by in (-1e-5, 1e-5):
        moved = scene.replace(iso_value=[(value + by, opacity) for value, opacity in surfaces])
        jumps |= np.abs(ss.Renderer("reference").render(moved, camera, size=SIZE).rgba - expected).max(-1) > 1e-3
    assert jumps.mean() < 0.2
    assert_close(image.rgba, expected, FLOAT32_HARD, text, jumps)
    assert expected[..., 3].max() > 0.02
    thicker = [(value, 1.05 * opacity) for value, opacity in surfaces]
    wrong = ss.Renderer("cpu").render(scene.replace(iso_value=thicker), camera, size=SIZE).rgba
    assert not distance(wrong, expected, jumps).within(FLOAT32_HARD)


def test_opaque_surfaces_show_the_first_one():
    """Of opaque ones the rest is hidden: those that a ray meets first decide."""
    field = ss.RegularField(waves(), boundary="zero")
    values = [float(value) for value in values_of("even", 40)]
    scene = ss.Scene(field, COLORS, mode="isosurface", iso_value=[(value, 1.0) for value in values])
    camera = ss.Camera.fit(scene, direction=(0.4, 0.7, -1.0), kind="perspective")
    image = ss.Renderer("cpu").render(scene, camera, size=SIZE, outputs=("depth",))
    expected = ss.Renderer("reference").render(scene, camera, size=SIZE, outputs=("depth",))
    assert_close(image.rgba, expected.rgba, FLOAT32, "cpu 40 opaque surfaces")
    # Rays come from outside, where rho is 0: they meet the least value first.
    least = ss.Renderer("cpu").render(scene.replace(iso_value=min(values)), camera, size=SIZE, outputs=("depth",))
    assert np.array_equal(np.isfinite(image.depth), np.isfinite(least.depth))
    there = np.isfinite(image.depth)
    assert np.allclose(image.depth[there], least.depth[there], atol=1e-5)
