"""Comparison of pictures: always logs its figures; writes actual, expected and difference where it fails."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from PIL import Image as PillowImage

from sheetsplat import _sheetsplat
from sheetsplat.compare import compare
from sheetsplat.image import Image, pixels_of
from sheetsplat.renderer import Renderer

OUT = Path(__file__).resolve().parents[2] / "out" / "python"
log = logging.getLogger("image_checks")

# Conventions, section 8: RMSE and P99.9.
FLOAT32 = (2e-5, 2e-4)
FLOAT32_HARD = (1e-4, 1e-3)
FLOAT16 = (1 / 510, 1 / 85)
# Of a picture; such pixels are counted and not compared.
MOST_AMBIGUOUS = 0.005


@dataclass(frozen=True)
class Distance:
    """What two pictures differ by."""

    rmse: float
    p99_9: float
    maximum: float
    ambiguous: float

    def within(self, bounds: tuple[float, float]) -> bool:
        """Return whether the bounds of RMSE and P99.9 are kept."""
        return self.rmse <= bounds[0] and self.p99_9 <= bounds[1] and self.ambiguous <= MOST_AMBIGUOUS


def handed_over(image: Image) -> str:
    """Return why the processor drew a whole picture for backend gl, which would lose its bound; "" where it did not."""
    return image.plan.device.partition("for backend gl: ")[2] if image.plan.backend == "cpu" else ""


def off_by(actual: ArrayLike, expected: ArrayLike) -> dict[str, float]:
    """Return rmse, p99_9 and maximum of section 8. FLIP takes longer than drawing such pictures: it is left out."""
    one, other = (np.ascontiguousarray(pixels_of(picture), np.float32) for picture in (actual, expected))
    assert one.shape == other.shape
    return _sheetsplat.compare(one, other, 1 if one.ndim == 2 else 4)


def within(found: dict[str, float], bounds: tuple[float, float]) -> bool:
    """Return whether the bounds of RMSE and P99.9 are kept."""
    return found["rmse"] <= bounds[0] and found["p99_9"] <= bounds[1]


def distance(actual: ArrayLike, expected: ArrayLike, ambiguous: NDArray[np.bool_] | None = None) -> Distance:
    """Return the distances over the pixels that are not ambiguous."""
    actual, expected = np.array(pixels_of(actual)), np.array(pixels_of(expected))
    share = 0.0
    if ambiguous is not None:
        share = float(ambiguous.mean())
        actual[ambiguous] = expected[ambiguous]
    found = off_by(actual, expected)
    return Distance(found["rmse"], found["p99_9"], found["maximum"], share)


def _write(array: NDArray[np.float32], path: Path, scale: float = 1.0) -> None:
    shown = np.nan_to_num(np.asarray(array[..., :3] if array.ndim == 3 else array), posinf=0, neginf=0) * scale
    PillowImage.fromarray(np.rint(np.clip(shown, 0, 1) * 255).astype(np.uint8)).save(path)


def assert_close(
    actual: NDArray[np.float32],
    expected: NDArray[np.float32],
    bounds: tuple[float, float],
    name: str,
    ambiguous: NDArray[np.bool_] | None = None,
) -> Distance:
    """Fail where two pictures differ by more than the bounds of RMSE and P99.9."""
    actual, expected = np.asarray(pixels_of(actual)), np.asarray(pixels_of(expected))
    found = distance(actual, expected, ambiguous)
    text = (
        f"{name}: RMSE {found.rmse:.3g} (at most {bounds[0]:.3g}), P99.9 {found.p99_9:.3g} (at most {bounds[1]:.3g}), "
        f"maximum {found.maximum:.3g}, ambiguous {found.ambiguous:.2%}"
    )
    log.info(text)
    if not found.within(bounds):
        folder = OUT / re.sub(r"[^A-Za-z0-9.]+", "-", name).strip("-")
        folder.mkdir(parents=True, exist_ok=True)
        _write(actual, folder / "actual.png")
        _write(expected, folder / "expected.png")
        difference = np.abs(actual - expected)
        top = float(np.nan_to_num(difference).max())
        _write(difference, folder / "difference.png", 1 / top if top > 0 else 1.0)
        pytest.fail(f"{text}, FLIP {compare(actual, expected)['flip']:.3g}; see {folder}")
    return found


def check_random_scenes(
    random_scene: Callable[[int], tuple[Any, Any, tuple[int, int]]], backend: str, count: int
) -> None:
    """Check scenes 0 ... count - 1 in one renderer, since what it keeps of one must not show in another."""
    reference, renderer = Renderer("reference"), Renderer(backend)
    shown = 0
    for seed in range(count):
        scene, camera, size = random_scene(seed)
        expected = reference.render(scene, camera, size).rgba.astype(float)
        off = np.abs(renderer.render(scene, camera, size).rgba - expected).max(axis=-1)
        # Where a ray touches the end of a support, rounding decides whether that is seen.
        assert (off > 1e-3).sum() <= 1, f"seed {seed}: {off.max():.2g} in {(off > 1e-3).sum()} pixels"
        shown += bool(expected.any())
    assert shown > 10
