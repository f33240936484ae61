"""Pictures of the reference for scenes given as parts (scattered_scenes), their ambiguous pixels, and distances."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np
import oracle
import scene_parts
from numpy.typing import NDArray
from scene_parts import Parts

import sheetsplat as ss

Mask = NDArray[np.bool_]
# Section 9: a pixel is ambiguous where a nudge of the scene changes the reference by more than this.
JUMP = 1e-3


def by_reference(parts: Parts, outputs: Iterable[str] = ()) -> ss.Image:
    """Return the reference's picture."""
    scene, camera, size = scene_parts.build(ss, parts)
    return ss.Renderer("reference").render(scene, camera, size=size, outputs=tuple(outputs))  # type: ignore[arg-type]


def may_jump(parts: Parts) -> bool:
    """Return whether the picture may jump: where it does not, no pixel is ambiguous (section 9)."""
    scene, points = parts["scene"], np.asarray(parts["transfer"])
    if scene.get("mode", "composite") in ("xray", "mip"):
        return False
    steps = np.abs(np.diff(points[:, 1:], axis=0))[np.diff(points[:, 0]) == 0]
    (base,) = scene_parts.build(oracle, parts)[0].bases()
    seen_at_base = oracle.TransferFunction(parts["transfer"])(np.array(base))[3] > 0
    stops = scene.get("opacity_stop", 0.98) < 1
    return scene.get("mode") == "isosurface" or stops or bool(steps.any()) or bool(seen_at_base)


def nudges(parts: Parts, spacing: float, length: float) -> Iterator[Parts]:
    """Yield the scene as each nudge of section 9 moves it. `spacing`, `length`: what its slices keep."""
    scene = parts["scene"]
    span = parts["transfer"][-1][0] - parts["transfer"][0][0]
    stops = scene.get("opacity_stop", 0.98) < 1 and scene.get("mode", "composite") == "composite"
    for by in (-1e-5, 1e-5):
        yield scene_parts.nudged(parts, spacing, length, rho=by * span)
        yield scene_parts.nudged(parts, spacing, length, support=by)
        if stops:
            yield scene_parts.nudged(parts, spacing, length, stop=by)


def changed_pixels(
    here: NDArray[np.float32], others: Iterable[Parts], draw: Callable[[Parts], ss.Image] = by_reference
) -> Mask:
    """Return the pixels at which any of the other scenes' pictures jumps away from `here`."""
    found = np.zeros(here.shape[:2], bool)
    for other in others:
        found |= np.abs(draw(other).rgba - here).max(-1) > JUMP
    return found


def ambiguous_pixels(parts: Parts, here: NDArray[np.float32]) -> Mask | None:
    """Return the pixels that jump under the nudges of section 9, or None where nothing can jump."""
    if not may_jump(parts):
        return None
    scene = scene_parts.build(ss, parts)[0]
    return changed_pixels(here, nudges(parts, scene.slice_spacing, scene.reference_length))
