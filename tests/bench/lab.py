"""Comparators that no picture of the product needs: bare fills, counters, and other ways to draw (cpp/lab)."""

from __future__ import annotations

from typing import Any

import sheetsplat as ss
from bench.measure import Timing, need_gl, renderer_for
from bench.report import Options

try:
    import _sheetsplat_lab
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        "the comparators' module _sheetsplat_lab was not found; build it and put build/lab on Python's path, as "
        "./run bench and ./run test do"
    ) from error


def fill_test(kernels: int, pixels: float, size: tuple[int, int], targets: int, repeats: int) -> Timing:
    """Time the blending of as many square points of one colour, `pixels` wide, into targets of four floats."""
    timing = Timing()
    timing.add(*_sheetsplat_lab.fill_test(kernels, pixels, *size, targets, repeats))
    return timing


class LabRenderer(ss.Renderer):
    """Draws by comparators of backend gl (the names: `_sheetsplat_lab.COMPARATORS`); plans and draws, nothing else."""

    __slots__ = ()

    def __init__(self, comparators: tuple[str, ...], **settings: Any) -> None:
        super().__init__("gl", **settings)
        native: Any = _sheetsplat_lab.Renderer(comparators, **settings)
        self.native = native


def lab_renderer(options: Options, *comparators: str, **settings: Any) -> ss.Renderer:
    """Return a renderer that draws by comparators; by none, one of the backend that is measured."""
    settings = {"allow_inexact": True, **settings}
    usual = renderer_for(options, **settings)
    if not comparators:
        return usual
    if options.backend not in ("auto", "gl"):
        field = ss.RegularField([[[0.0, 1.0]] * 2] * 2)
        scene = ss.Scene(field, [(0.0, 1.0, 1.0, 1.0, 0.0), (1.0, 1.0, 1.0, 1.0, 1.0)])
        need_gl(usual.plan(scene, ss.Camera.fit(field), size=(8, 8)), ", ".join(comparators))
    return LabRenderer(comparators, **settings)
