"""Random scenes of labels, alone and beside a volume: the processor and OpenGL against the reference."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from image_checks import check_random_scenes

import sheetsplat as ss


def random_labels(rng: np.random.Generator) -> np.ndarray:
    """Return regions around random places, with holes, whose numbers may be apart or negative."""
    shape = rng.integers(3, 12, 3)
    at = np.mgrid[tuple(slice(0, size) for size in shape)]
    places = rng.uniform(0, 1, (rng.integers(2, 6), 3)) * shape
    away = [((at - place[:, None, None, None]) ** 2).sum(axis=0) * rng.uniform(0.5, 2) for place in places]
    labels = np.argmin(away, axis=0).astype(np.int16)
    labels[rng.random(labels.shape) < 0.05] = 0
    return labels * np.int16(rng.choice([1, 1, 3, -7]))


def random_scene(seed: int) -> tuple[ss.Scene, ss.Camera, tuple[int, int]]:
    rng = np.random.default_rng([77, seed])
    labels = random_labels(rng)
    lattice: dict[str, Any] = {"spacing": tuple(rng.uniform(0.6, 1.6, 3))}
    if (kind := rng.random()) < 0.3:
        lattice = {"lattice": "bcc"}
    elif kind < 0.6:
        lattice = {"axes": np.eye(3) * rng.uniform(0.5, 1.5, 3) + 0.3 * rng.normal(size=(3, 3))}
    if rng.random() < 0.3:
        lattice["boundary"] = "zero"
    field = ss.RegularField(labels, labels=True, **lattice)
    opacities = rng.choice([1.0, 0.5, 0.1], 64)
    colors = {int(one): (*rng.random(3), float(opacities[n])) for n, one in enumerate(np.unique(labels))
              if rng.random() < 0.75}  # fmt: skip
    mode = str(rng.choice(["composite", "composite", "isosurface"]))
    options: dict[str, Any] = {"mode": mode, "slice_spacing": float(rng.uniform(0.2, 1.2)),
                               "opacity_stop": float(rng.choice([1.0, 0.98, 0.9]))}  # fmt: skip
    for name, value, likely in (
        ("lights", [ss.Light(tuple(rng.normal(size=3)))], 0.6),
        ("sampling", "slab", 0.3),
        ("preintegration", True, 0.3 if mode == "composite" else 0.0),
        ("gradient", "analytic", 0.2),
        ("filter", "ewa", 0.2),
        ("clip", ss.Clip(planes=[(tuple(rng.normal(size=3)), float(rng.normal()))]), 0.2),
    ):
        if rng.random() < likely:
            options[name] = value
    fields: list[Any] = [field]
    functions: list[Any] = [ss.LabelColors(colors)]
    if rng.random() < 0.3:
        fields.append(ss.RegularField(rng.random(labels.shape), **lattice))
        functions.append(ss.TransferFunction([(0, 0, 1, 0, 0), (1, 1, 1, 0, 0.3)]))
        if mode == "isosurface":
            options["iso_value"] = [(0.5, 0.5)]
    view: dict[str, Any] = {"fov_y": float(rng.uniform(20, 60)), "kind": "perspective"} if rng.random() < 0.5 else {}
    camera = ss.Camera.fit(field, direction=tuple(rng.normal(size=3)), **view)
    several = len(fields) > 1
    scene = ss.Scene(fields if several else field, functions if several else functions[0], **options)
    return scene, camera, tuple(int(size) for size in rng.integers(8, 30, 2))  # type: ignore[return-value]


@pytest.mark.filterwarnings("ignore::sheetsplat.PictureWarning")
@pytest.mark.parametrize("backend", ["cpu", "gl"])
def test_random_scenes_of_labels(backend: str) -> None:
    check_random_scenes(random_scene, backend, 40 if backend == "cpu" else 16)
