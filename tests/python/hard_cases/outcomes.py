"""What comes of a case on a backend, and whether that is the written outcome."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import oracle
from image_checks import FLOAT32, FLOAT32_HARD, MOST_AMBIGUOUS, off_by, within
from numpy.typing import NDArray
from reference_pictures import ambiguous_pixels, by_reference, may_jump
from scene_parts import Parts, build

import sheetsplat as ss

from .cases import CASES, TRANSPARENT, Outcome, Refused


@dataclass(frozen=True)
class Measured:
    """What came of a case on a backend."""

    refusal: ss.Error | None = None
    rmse: float = 0.0
    p99_9: float = 0.0
    maximum: float = 0.0
    ambiguous: int = 0
    pixels: int = 1
    precision: str = ""
    bounds: tuple[float, float] = FLOAT32_HARD
    transparent: bool = False
    finite: bool = True

    def kept(self) -> bool:
        """Return whether section 9 is kept; one pixel may be ambiguous in the smallest of pictures."""
        few = self.ambiguous <= max(1, MOST_AMBIGUOUS * self.pixels)
        return self.finite and self.rmse <= self.bounds[0] and self.p99_9 <= self.bounds[1] and few

    def __str__(self) -> str:
        if self.refusal is not None:
            return f"{type(self.refusal).__name__}"
        if self.transparent:
            return "0"
        left = f", {self.ambiguous} px ambiguous" if self.ambiguous else ""
        wide = ", float64" if self.precision == "float64" else ""
        return f"{self.rmse:.1e} / {self.maximum:.1e}{wide}{left}"


@cache
def scene_of(name: str) -> Parts:
    """Return the scene of a case."""
    return CASES[name].make()


@cache
def expected_of(name: str) -> ss.Image:
    """Return the picture that a case must give."""
    like = CASES[name].like
    return by_reference(like() if like is not None else scene_of(name))


@cache
def renderer_of(backend: str) -> ss.Renderer:
    """Return one renderer for all cases."""
    return ss.Renderer(backend)  # type: ignore[arg-type]


@cache
def ambiguous_of(name: str) -> NDArray[np.bool_] | None:
    """Return the pixels of a case that are ambiguous; None where nothing can jump."""
    made = scene_of(name)
    return ambiguous_pixels(made, by_reference(made).rgba) if may_jump(made) else None


def is_gentle(made: Parts) -> bool:
    """Return whether the tighter bound of section 9 holds."""
    if sum(len(one.get("centers", ())) for one in made["fields"]) == 0 and "centers" in made["fields"][0]:
        return True
    with np.errstate(over="ignore"):
        return oracle.is_gentle(*build(oracle, made))


def measure(name: str, backend: str) -> Measured:
    """Return what comes of a case on a backend."""
    try:
        scene, camera, size = build(ss, scene_of(name))
        image = renderer_of(backend).render(scene, camera, size=size)
    except ss.Error as error:
        return Measured(refusal=error)
    pixels = np.array(image.pixels)
    facts: dict[str, Any] = {
        "pixels": size[0] * size[1],
        "precision": image.plan.precision,
        "transparent": not pixels.any(),
        "finite": bool(np.isfinite(pixels).all()),
    }
    expected = expected_of(name).pixels
    bounds = FLOAT32 if is_gentle(scene_of(name)) else FLOAT32_HARD
    found = off_by(pixels, expected)
    count = 0
    if not within(found, bounds):
        jumping = ambiguous_of(name)
        if jumping is not None:
            pixels[jumping] = expected[jumping]
            found = off_by(pixels, expected)
            count = int(jumping.sum())
    return Measured(
        rmse=found["rmse"], p99_9=found["p99_9"], maximum=found["maximum"], ambiguous=count, bounds=bounds, **facts
    )


def fault(outcome: Outcome, found: Measured) -> str:
    """Return how far what was found is from what was written, or an empty text."""
    if isinstance(outcome, Refused):
        if found.refusal is None:
            return f"drawn ({found}) where an error was written: {outcome}"
        if type(found.refusal) is not outcome.kind or not re.search(outcome.match, str(found.refusal)):
            return f"another error than {outcome}: {found.refusal!r}"
        told = found.refusal.found and (found.refusal.wanted or found.refusal.advice)
        return "" if told else f"an error that does not say enough: {found.refusal}"
    if found.refusal is not None:
        return f"refused: {found.refusal}"
    if outcome == TRANSPARENT:
        return "" if found.transparent else f"not transparent: {found}"
    limits = f"at most {found.bounds[0]:.0e}, P99.9 {found.p99_9:.2e} at most {found.bounds[1]:.0e}"
    return "" if found.kept() else f"RMSE {found.rmse:.2e} {limits}: {found}"
