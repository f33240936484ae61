"""The stated error of shadows and occlusion from volumes, where few pixels or thin sheets show what is off."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from error_scenes import smooth_noise
from scene_parts import cloud, pick, unit

import sheetsplat as ss

pytestmark = pytest.mark.filterwarnings("ignore::sheetsplat.PictureWarning")

SIZE = (48, 40)
# Below, single pixels of float32 pictures count.
LEAST = 2e-5


def field_of(rng: np.random.Generator) -> ss.RegularField | ss.EllipsoidField:
    """Return a small field of values from 0 to 1."""
    if rng.random() < 0.3:
        return ss.EllipsoidField(**cloud(rng, int(rng.integers(30, 200)), 8.0, 2.0))
    shape = tuple(int(n) for n in rng.integers(10, 20, 3))
    edge = 2 / max(shape)
    return ss.RegularField(
        smooth_noise(rng, shape, float(rng.uniform(0.5, 2.5))).astype(np.float32),
        spacing=(edge, edge, edge),
        origin=(-1, -1, -1),
        lattice=pick(rng, "cartesian", "cartesian", "bcc"),
    )


def narrow(rng: np.random.Generator) -> tuple[list[tuple[float, ...]], dict[str, Any]]:
    """Return a transfer function that shows 0.1 to 1 % of the values, and options."""
    middle, half = float(rng.uniform(0.2, 0.8)), float(rng.uniform(0.0005, 0.005))
    look = [(middle - half, 0.2, 0.5, 0.9, 0.0), (middle, 0.9, 0.6, 0.2, float(rng.uniform(0.3, 1)))]
    return [*look, (middle + half, 1.0, 0.9, 0.8, 0.0)], {"preintegration": bool(rng.random() < 0.4)}


def cut(rng: np.random.Generator) -> tuple[list[tuple[float, ...]], dict[str, Any]]:
    """Return a transfer function, and a clip of pre-integrated intervals."""
    start = float(rng.uniform(0.1, 0.5))
    look = [(start, 0.2, 0.5, 0.9, 0.0), (start + 0.2, 0.9, 0.6, 0.2, 0.5), (1.0, 1.0, 0.9, 0.8, 0.7)]
    normal = tuple(unit(rng.normal(size=3)).tolist())
    return look, {"clip": ss.Clip([(normal, float(rng.uniform(-0.3, 0.3)))]), "preintegration": True}


def ratios(kind: Any, seeds: range) -> dict[int, float]:
    """Return true error over stated one of scenes with shadows, of some with occlusion, by seed."""
    renderer, reference = ss.Renderer("cpu"), ss.Renderer("reference")
    found = {}
    for seed in seeds:
        rng = np.random.default_rng([37, seed])
        field = field_of(rng)
        look, options = kind(rng)
        if rng.random() < 0.3:
            options["ambient_occlusion"] = ss.AmbientOcclusion(radius=0.3)
        light = ss.Light(direction=tuple(unit(rng.normal(size=3) + (0, 0, 1)).tolist()))
        spacing = float(rng.uniform(0.05, 0.15))
        scene = ss.Scene(field, look, lights=[light], shadows=True, opacity_stop=1.0, slice_spacing=spacing, **options)
        eye = tuple((3 * unit(rng.normal(size=3))).tolist())
        camera = ss.Camera.orthographic(eye=eye, target=(0, 0, 0), height=2.6)
        image = renderer.render(scene, camera, size=SIZE)
        true = float(np.sqrt(np.square(image.rgba - reference.render(scene, camera, size=SIZE).rgba).mean()))
        stated = np.sqrt(sum(e**2 for cause, e in image.error.budget.items() if "from a volume" in cause))
        if true > LEAST:
            found[seed] = true / max(float(stated), 1e-12)
    return found


def test_functions_that_show_little() -> None:
    """Probes that did not know where something shows stated 0 where one or two pixels were off."""
    found = ratios(narrow, range(80))
    assert len(found) > 50
    assert {seed: ratio for seed, ratio in found.items() if not 0.3 < ratio < 2} == {}


def test_clipped_intervals() -> None:
    found = ratios(cut, range(60))
    assert len(found) > 50
    assert {seed: ratio for seed, ratio in found.items() if not 0.5 < ratio < 1.2} == {}
