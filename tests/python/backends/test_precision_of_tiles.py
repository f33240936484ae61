"""Lit tiles whose light would show the rounding of float32 are drawn in float64: by a bound that each tile carries."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scene_parts
import sweep_scenes
from image_checks import FLOAT32, FLOAT32_HARD, off_by, within
from reference_pictures import by_reference
from test_oracle import build_effects

import sheetsplat as ss

#: Numbered scenes of which float32 alone breaks section 9: by differences, by derivatives, on surfaces, of needles; of
#: mode mip, where what is shown is small beside the sums.
LOST = (4_000_989, 4_001_039, 4_001_154, 4_000_544, 4_105_658, 4_602_639, 5_307_592)
BACKENDS = ("cpu", pytest.param("gl", marks=pytest.mark.gl))


def in_float32(parts: dict[str, Any]) -> ss.Image:
    """Return the picture of float32 alone."""
    scene, camera, size = build_effects(ss, parts)
    return ss.Renderer("cpu", precision="float32", allow_inexact=True, threads=1).render(scene, camera, size=size)


@pytest.mark.parametrize("number", LOST)
def test_tiles_that_float32_would_lose_are_right(number: int) -> None:
    parts = sweep_scenes.scene_of(number)[1]
    assert not sweep_scenes.fault(parts, "cpu")
    image = sweep_scenes.draw(parts, "cpu", ())
    assert image.plan.precision == "float64" or image.stats["tiles_in_float64"] > 0
    # Negative control: in float32 they are not.
    assert not within(off_by(in_float32(parts), by_reference(parts)), FLOAT32)


def ball(offset: float = 0.0, normalization: Any = "lattice", **options: Any) -> tuple[ss.Scene, ss.Camera]:
    """Return a lit lattice of a ball, of one value in its middle."""
    grid = np.linspace(-1, 1, 24)
    z, y, x = np.meshgrid(grid, grid, grid, indexing="ij")
    values = np.clip(1.2 - np.sqrt(x * x + y * y + z * z), 0, 0.7) + offset
    field = ss.RegularField(
        values, spacing=(2 / 23,) * 3, origin=(-1, -1, -1), base=0.0, normalization=normalization, w0=0.05
    )
    colors = [(offset, 0.2, 0.3, 0.8, 0.0), (offset + 1, 0.9, 0.6, 0.3, 0.5)]
    scene = ss.Scene(field, colors, lights=[ss.Light((1, 1, 1))], **options)
    return scene, ss.Camera.orthographic((0, 0, 5), (0, 0, 0), (0, 1, 0), height=2.6)


@pytest.mark.parametrize("mode", ["composite", "isosurface"])
def test_plain_scenes_stay_in_float32(mode: str) -> None:
    scene, camera = ball(mode=mode, **({"iso_value": 0.4} if mode == "isosurface" else {}))
    image = ss.Renderer("cpu").render(scene, camera, size=(130, 130))
    assert image.plan.precision == "float32" and image.stats["tiles_in_float64"] == 0


@pytest.mark.parametrize("backend", BACKENDS)
def test_only_tiles_that_need_it_are_drawn_again(backend: Any) -> None:
    """Where values are one, what differs in quotients of sums is their rounding: there, and only there."""
    scene, camera = ball(40.0, "threshold", reference_length=1.0)
    image = ss.Renderer(backend).render(scene, camera, size=(260, 260))
    assert image.plan.backend == backend and image.plan.precision == "float32"
    assert 0 < image.stats["tiles_in_float64"] < 25
    expected = ss.Renderer("cpu", precision="float64").render(scene, camera, size=(260, 260))
    assert within(off_by(image, expected), FLOAT32)


def test_threads_and_tiles_leave_no_seam() -> None:
    scene, camera = ball(40.0, "threshold", reference_length=1.0)
    one, three = (ss.Renderer("cpu", threads=threads).render(scene, camera, size=(260, 260)).rgba for threads in (1, 3))
    assert np.array_equal(one, three)


def test_a_given_precision_is_kept_or_refused() -> None:
    """Of a lattice whose samples are nearly one value: no tile of float32 is within its bound."""
    parts = scene_parts.parts(
        [{"values": 3.0 + 3e-4 * np.random.default_rng(1).random((8, 8, 8)), "spacing": (0.3,) * 3,
          "origin": (-1.05,) * 3, "normalization": "threshold", "w0": 0.3, "boundary": "zero", "base": 0.0}],
        transfer=[(2.9, 0.9, 0.3, 0.2, 0.1), (3.1, 0.3, 0.8, 0.5, 0.4)], size=(24, 20), reference_length=3.0,
    )  # fmt: skip
    scene, camera, size = scene_parts.build(ss, parts)
    with pytest.raises(ss.Unsupported, match="gradients as weak as rounding, most in columns .* leave out precision"):
        ss.Renderer("cpu", precision="float32").render(scene, camera, size=size)
    image = ss.Renderer("cpu").render(scene, camera, size=size)
    assert image.stats["tiles_in_float64"] > 0
    assert within(off_by(image, by_reference(parts)), FLOAT32_HARD)
