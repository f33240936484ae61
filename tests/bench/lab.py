"""Comparators that no picture of the product needs: bare fills, counters, and other ways to draw."""

from __future__ import annotations

from typing import Any

import sheetsplat as ss
from bench.measure import Timing, renderer_for
from bench.report import Options
from sheetsplat import _sheetsplat


def fill_test(kernels: int, pixels: float, size: tuple[int, int], targets: int, repeats: int) -> Timing:
    """Time the blending of as many square points of one colour, `pixels` wide, into targets of four floats."""
    timing = Timing()
    timing.add(*_sheetsplat.fill_test(kernels, pixels, *size, targets, repeats))
    return timing


def lab_renderer(options: Options, *comparators: str, **settings: Any) -> ss.Renderer:
    """Return a renderer that draws by comparators."""
    return renderer_for(options, effects=dict.fromkeys(comparators, True), allow_inexact=True, **settings)
