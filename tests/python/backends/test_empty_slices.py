"""Runs of slices that no kernel meets: OpenGL leaves them out, and the picture stays what it is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scene_parts
from image_checks import FLOAT32_HARD, assert_close
from reference_pictures import by_reference
from scene_parts import Parts, cloud

import sheetsplat as ss

pytestmark = pytest.mark.gl

FAR = scene_parts.parallel(direction=(0.1, 0.2, -1.0), height=2.4)


def clusters(fields: int = 1, far_off: float = 0.0, **scene: Any) -> Parts:
    """Return small clouds in front of one another, with some 2,000 empty slices between each and the next."""
    rng = np.random.default_rng(12)
    made = []
    for _ in range(fields):
        one = cloud(rng, 60, 6.0, 2.0, w0=0.3)
        one["centers"] = one["centers"] * (1.0, 1.0, 0.02) + rng.choice([-20.0, 0.0, 20.0], 60)[:, None] * (0, 0, 1)
        one["scales"] = one["scales"] * 0.5
        one["values"] = one["values"] / fields + far_off
        made.append(one)
    transfer = [(fields * far_off + point[0], *point[1:]) for point in scene_parts.GENTLE]
    return scene_parts.parts(made, FAR, transfer=transfer, size=(24, 20), slice_spacing=0.01) | {
        "scene": {
            "slice_spacing": 0.01,
            "opacity_stop": 1.0,
            "reference_length": 0.05,
            **scene,
        }
    }


@pytest.mark.parametrize(
    ("options", "parts"),
    [
        pytest.param({}, clusters(), id="lit"),
        pytest.param({"packing": "paper"}, clusters(), id="paper"),
        pytest.param({}, clusters(preintegration=True), id="preintegration"),
        pytest.param({}, clusters(2, 10.0, gradient="analytic"), id="counted from pivots"),
        pytest.param({"packing": "paper"}, clusters(2, 10.0, gradient="analytic"), id="pivots and paper"),
        pytest.param({}, clusters(mode="isosurface", iso_value=0.3), id="isosurface"),
        pytest.param({}, clusters(mode="average"), id="average"),
    ],
)
def test_empty_slices_are_left_out(options: dict[str, Any], parts: Parts) -> None:
    scene, camera, size = scene_parts.build(ss, parts)
    image = ss.Renderer("gl", **options).render(scene, camera, size=size)
    slabs = 1 if options else 4
    assert image.stats["slices"] > 3000
    assert image.stats["passes_shaded"] < 0.2 * image.stats["slices"] / slabs
    assert_close(image, by_reference(parts), FLOAT32_HARD, "clusters")
