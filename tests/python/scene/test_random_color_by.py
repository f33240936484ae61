"""Random scenes whose colours are those of other fields: the processor and OpenGL against the reference."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from image_checks import check_random_scenes

import sheetsplat as ss


def random_samples(rng: np.random.Generator) -> np.ndarray:
    """Return a bump over noise, in one of the units and types of ordinary data."""
    shape = tuple(int(size) for size in rng.integers(1, 14, 3))
    axes = [np.linspace(-1, 1, size) if size > 1 else np.zeros(1) for size in shape]
    bump = np.exp(-3 * sum(along**2 for along in np.meshgrid(*axes, indexing="ij"))) + 0.1 * rng.random(shape)
    kinds = (
        lambda: (bump * 230).astype(np.uint8),
        lambda: (bump * 3000 - 1024).astype(np.int16),
        lambda: (bump * 55_000).astype(np.uint16),
        lambda: bump.astype(np.float32),
        lambda: bump + 1e6,
        lambda: (bump * 300 + 273.15).astype(np.float32),
        lambda: bump.astype(np.float32) - np.float32(0.5),
    )
    return np.asarray(kinds[int(rng.integers(len(kinds)))]())


def random_field(rng: np.random.Generator) -> ss.RegularField | ss.EllipsoidField:
    if rng.random() < 0.2:
        count = int(rng.integers(1, 60))
        return ss.EllipsoidField(
            rng.uniform(-6, 6, (count, 3)), rng.uniform(1, 4, count), values=rng.random(count) + 0.2
        )
    samples = random_samples(rng)
    options: dict[str, Any] = {}
    for name, value, likely in (
        ("boundary", "zero", 0.4),
        ("spacing", tuple(rng.uniform(0.4, 2, 3)), 0.3),
        ("radius", float(rng.uniform(1.3, 3.4)), 0.3),
        ("origin", tuple(rng.uniform(-4, 4, 3)), 0.2),
        ("normalization", str(rng.choice(["none", "lattice", "threshold"])), 0.3),
    ):
        if rng.random() < likely:
            options[name] = value
    if (kind := rng.random()) < 0.1:
        options = {"lattice": "bcc"}
    elif kind < 0.2:
        options.pop("spacing", None)
        options["axes"] = np.eye(3) * rng.uniform(0.5, 1.5, 3) + 0.3 * rng.normal(size=(3, 3))
    elif kind < 0.3 and samples.dtype.kind == "f":
        samples = np.where(rng.random(samples.shape) < 0.05, np.nan, samples)
        options["nan"] = "skip"
        options.pop("radius", None)
    return ss.RegularField(samples, **options)


def function_over(field: Any, rng: np.random.Generator, opacity: float | None = None) -> ss.TransferFunction:
    """Return a transfer function over all values: opacities that rise from 0, or one."""
    low, high = (float(value) for value in field.value_range)
    high = max(high, low + 1e-6 * max(1.0, abs(low)))
    opacities = (0.0, rng.uniform(0.02, 0.5), rng.uniform(0.1, 1)) if opacity is None else (opacity,) * 3
    values = (low, (low + high) / 2, high)
    return ss.TransferFunction([(value, *rng.random(3), a) for value, a in zip(values, opacities, strict=True)])


def random_scene(seed: int) -> tuple[ss.Scene, ss.Camera, tuple[int, int]]:
    rng = np.random.default_rng([78, seed])
    field, other = random_field(rng), random_field(rng)
    if rng.random() < 0.3 and isinstance(field, ss.RegularField):
        other = ss.RegularField(rng.random(field.shape).astype(np.float32))
    if isinstance(field, ss.EllipsoidField) and rng.random() < 0.6:
        other = ss.EllipsoidField(field.centers, field.scales, values=rng.random(len(field.values)) - 0.3)
    mode = str(rng.choice(["composite", "isosurface"]))
    options: dict[str, Any] = {"mode": mode}
    low, high = field.value_range
    if mode == "isosurface":
        options["iso_value"] = float(low + (high - low) * rng.uniform(0.2, 0.8))
    for name, value, likely in (
        ("lights", [ss.Light(tuple(rng.normal(size=3)))], 0.6),
        ("sampling", "slab", 0.2),
        ("preintegration", True, 0.4 if mode == "composite" else 0.0),
        ("gradient", "analytic", 0.2),
        ("filter", "ewa", 0.1),
        ("clip", ss.Clip(planes=[(tuple(rng.normal(size=3)), float(rng.normal()))]), 0.2),
    ):
        if rng.random() < likely:
            options[name] = value
    view: dict[str, Any] = {"fov_y": float(rng.uniform(20, 60)), "kind": "perspective"} if rng.random() < 0.4 else {}
    camera = ss.Camera.fit(field, direction=tuple(rng.normal(size=3)), **view)
    scene = ss.Scene(field, function_over(field, rng), color_by=(other, function_over(other, rng, 1.0)), **options)
    return scene, camera, tuple(int(size) for size in rng.integers(5, 40, 2))  # type: ignore[return-value]


@pytest.mark.filterwarnings("ignore::sheetsplat.PictureWarning")
@pytest.mark.parametrize("backend", ["cpu", "gl"])
def test_random_scenes_in_colors_of_others(backend: str) -> None:
    check_random_scenes(random_scene, backend, 60 if backend == "cpu" else 16)
