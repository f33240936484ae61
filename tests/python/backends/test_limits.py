"""Each limit of cpp/src/plan/limits.cpp, with a picture on each side of it.

Just within, the way of drawing that it is a limit of draws the picture; just beyond, another one does, with the limit
as its reason, or the scene is refused. Every picture that is drawn is within section 9 of backend reference.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sweep_scenes
from image_checks import FLOAT32, handed_over, off_by, within
from reference_pictures import by_reference
from scene_parts import GENTLE, ZERO_SEEN, Parts, central, parallel, parts, quaternions
from test_oracle import build_effects

import sheetsplat as ss

SIZE = (20, 16)
WAYS = ("float32", "float64", "sheets", "old_sheets", "papers")
TABLE = (Path(__file__).resolve().parents[3] / "cpp/src/plan/limits.cpp").read_text(encoding="utf-8")


def rows() -> dict[str, tuple[set[str], str]]:
    """Return of each limit the ways of drawing that it ends, and what it says."""
    found = re.findall(r'\{"(\w+)",\s*(?:most|least),\s*\{(.*?)\},\s*"([^"]*)"', TABLE, re.DOTALL)
    return {
        name: ({way for way, end in zip(WAYS, ends.split(", "), strict=True) if end.strip() != "none"}, noun)
        for name, ends, noun in found
    }


def kernels(*shapes: Any, **options: Any) -> dict[str, Any]:
    """Return a field of kernels side by side, of these semi-axes."""
    scales = np.array([np.broadcast_to(shape, 3) for shape in shapes], float)
    centers = np.zeros_like(scales)
    centers[:, 0] = np.linspace(-0.4, 0.4, len(scales)) if len(scales) > 1 else 0.0
    return {"centers": centers, "scales": scales, "values": np.linspace(0.9, 0.4, len(scales))} | options


def lattice(**options: Any) -> dict[str, Any]:
    """Return a lattice of 6 x 6 x 6 samples over the cube of edge 2, 0 round it."""
    values = np.random.default_rng(7).random((6, 6, 6))
    return {"values": values, "spacing": (0.4,) * 3, "origin": (-1.0,) * 3, "boundary": "zero", "base": 0.0} | options


def plain(*fields: dict[str, Any], camera: dict[str, Any] | None = None, **options: Any) -> Parts:
    """Return an unlit scene."""
    return parts(list(fields), camera, size=SIZE, **({"lit": False, "slice_spacing": 0.2} | options))


def dust(px: float) -> dict[str, Any]:
    """Return a kernel on each pixel of a view along z of a height of 1.6, of so small a semi-axis."""
    rng = np.random.default_rng(1)
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(20) - 9.5, np.arange(16) - 7.5))
    size = 0.1 * px
    centers = np.stack([0.1 * x, 0.1 * y, 0.0 * x], -1)
    centers[:, :2] += rng.uniform(-size, size, (320, 2))
    return {
        "centers": centers,
        "scales": np.full((320, 3), (size, 1.3 * size, 0.3)),
        "values": rng.uniform(0.3, 1, 320),
    }


def coincident(count: float, value: float) -> dict[str, Any]:
    """Return kernels of one size at one place, whose values add up to `value`."""
    many = round(count)
    return {
        "centers": np.zeros((many, 3)),
        "scales": np.full((many, 3), 0.5),
        "values": np.full(many, value / many),
        "normalization": "none",
    }


def heavy(weight: float, **options: Any) -> dict[str, Any]:
    """Return kernels over the picture whose weights are `weight` times w0."""
    rng = np.random.default_rng(3)
    count = 40
    return {
        "centers": rng.uniform(-1, 1, (count, 3)),
        "scales": np.full((count, 3), 0.6),
        "values": rng.random(count),
        "weights": np.full(count, weight),
        "normalization": "threshold",
        "w0": 1.0,
    } | options


def lights(count: float, **scene: Any) -> Parts:
    """Return a scene of so many faint lights."""
    one = plain(lattice(), lit=True, **scene)
    one["lights"] = [{"direction": (0.1 * n, 1.0, 1.0), "color": (0.02,) * 3} for n in range(round(count))]
    return one


def groups(fields: list[dict[str, Any]]) -> Parts:
    """Return a scene of a transfer function for each field."""
    one = plain(*fields)
    return one | {"transfer": [GENTLE] * len(fields), "groups": [[n] for n in range(len(fields))]}


def thin_in_slabs(thickness: float) -> dict[str, Any]:
    """Return leaning kernels of whose half-depths a slab of 1/4 has so many, with weights that make up for it."""
    rng = np.random.default_rng(21)
    size = 0.25 / thickness
    places = np.stack([rng.integers(0, 20, 40) - 9.5, rng.integers(0, 16, 40) - 7.5, rng.uniform(-4, 4, 40)], -1) / 6
    return {
        "centers": places,
        "scales": np.tile((size, size / 2, size / 1.4), (40, 1)),
        "rotations": quaternions(rng, 40),
        "values": rng.random(40),
        "weights": np.full(40, thickness),
        "w0": 0.3,
    }


@dataclass(frozen=True)
class Case:
    """A limit, a way of drawing, numbers on either side of where that ends, and the scene of such a number."""

    limit: str
    way: str
    within: float
    beyond: float
    make: Callable[[float], Parts]
    effects: dict[str, bool] | None = None

    @property
    def backend(self) -> str:
        """Return the backend that draws in this way."""
        return "cpu" if self.way in ("float32", "float64") else "gl"

    def __str__(self) -> str:
        return f"{self.limit}-{self.way}"


ALONG = parallel((0, 0, -1), 1.6, up=(0, 1, 0))
CLOSE = parallel(height=0.2)
PAPERS = {"paper_slicing": True}
CASES = [
    Case("groups", "sheets", 16, 17, lambda x: groups([lattice()] * round(x))),
    Case("surfaces", "sheets", 32, 33, lambda x: plain(
        lattice(), mode="isosurface", iso_value=[(0.9 * n / x + 0.05, 0.1) for n in range(round(x))])),
    Case("groups", "papers", 1, 2, lambda x: groups([kernels(0.6), kernels(0.5)][: round(x)]), PAPERS),
    Case("lights", "sheets", 64, 65, lights),
    Case("shadowing_lights", "sheets", 16, 17, lambda x: lights(x, shadows=True)),
    Case("slices", "float32", 16300, 16500, lambda x: plain(kernels(0.3), slice_spacing=0.6 / x)),
    Case("aspect", "float32", 510, 514, lambda x: plain(kernels((0.9, 0.4, 0.9 / x)), camera=CLOSE)),
    Case("smallest_px", "float32", 1.01, 0.99, lambda x: plain(dust(0.05 * x), camera=ALONG)),
    Case("placed_px", "float64", 0.9e12, 1.1e12, lambda x: plain(
        kernels(1.0), camera=parallel((0, 0, -1), 16 / x, (0.3, 0.2, 0.0)), slice_spacing=0.1)),
    Case("placed_px", "sheets", 0.9e12, 1.1e12, lambda x: plain(
        kernels(1.0), camera=parallel((0, 0, -1), 16 / x, (0.3, 0.2, 0.0)), slice_spacing=0.1)),
    Case("placed_px", "papers", 0.9e7, 1.1e7, lambda x: plain(
        kernels(1.0), camera=parallel((0, 0, -1), 16 / x, (0.3, 0.2, 0.0)), slice_spacing=0.1), PAPERS),
    Case("deep_px", "float32", 0.9e15, 1.1e15, lambda x: plain(
        kernels(x / 22), camera=central(distance=x / 5), slice_spacing=x / 60)),
    Case("deep_px", "sheets", 0.9e15, 1.1e15, lambda x: plain(
        kernels(x / 22), camera=central(distance=x / 5), slice_spacing=x / 60)),
    Case("place", "sheets", 1.1, 0.9, lambda x: plain(
        lattice(values=np.ones((2, 2, 16384)), spacing=(1.0,) * 3, origin=(-8192.0, 0.0, 0.0)),
        camera=parallel((0, 0, -1), 26667 / x), slice_spacing=1.0, transfer=ZERO_SEEN)),
    Case("unit", "float32", 0.9e15, 1.1e15, lambda x: plain(
        kernels(4 / x), camera=central(distance=20 / x), slice_spacing=1 / x)),
    Case("falloff", "float32", 0.0505, 0.0495, lambda x: plain(kernels(0.6, 0.5, falloff=x))),
    Case("falloff", "float64", 1.01e-8, 0.99e-8, lambda x: plain(kernels(0.6, 0.5, falloff=x))),
    Case("falloff", "sheets", 0.0505, 0.0495, lambda x: plain(kernels(0.6, 0.5, falloff=x))),
    Case("steepest_falloff", "float32", 19.8, 20.2, lambda x: plain(lattice(falloff=x), transfer=ZERO_SEEN)),
    Case("steepest_falloff", "float64", 594, 606, lambda x: plain(lattice(falloff=x), transfer=ZERO_SEEN)),
    Case("steepest_falloff", "sheets", 79, 81, lambda x: plain(kernels(0.6, 0.5, falloff=x), mode="average")),
    Case("paper_falloff", "papers", 31.5, 32.5, lambda x: plain(kernels(0.6, 0.5, falloff=x)), PAPERS),
    Case("aspect", "papers", 1010, 1040, lambda x: plain(kernels((0.9, 0.9, 0.9 / x)), camera=CLOSE), PAPERS),
    Case("smallest_px", "papers", 1.05, 0.95, lambda x: plain(kernels((0.9 * x, 0.01 * x * 3 / 16, 0.1))), PAPERS),
    Case("extent", "papers", 2000, 2100, lambda x: plain(kernels(0.4 / x, 0.5, 0.4), camera=CLOSE), PAPERS),
    Case("thickest_slab", "float32", 95, 105, lambda x: plain(
        kernels((0.6, 0.6, 0.25), (0.5, 0.6, 0.25)), sampling="slab", mode="xray", slice_spacing=0.25 * x)),
    Case("lost_in_slabs", "sheets", 1000, 2200, lambda x: plain(
        thin_in_slabs(x), camera=parallel((0, 0, -1), 16 / 6, up=(0, 1, 0)), sampling="slab", slice_spacing=0.25)),
    Case("slant", "sheets", 88, 98, lambda x: plain(
        kernels(0.3, 0.3), camera=central(fov_y=2 * np.degrees(np.arctan(x))), sampling="slab", mode="xray")),
    Case("sum", "float32", 0.9e30, 1.1e30, lambda x: plain(heavy(x / 33.5), mode="mip")),
    Case("sum", "float64", 0.9e250, 1.1e250, lambda x: plain(heavy(x / 33.5), mode="mip")),
    Case("sum", "sheets", 0.9e36, 1.1e36, lambda x: plain(heavy(x / 33.5), mode="mip")),
    Case("divisor", "float64", 1.01e-22, 0.99e-22, lambda x: plain(heavy(x, w0=x))),
    Case("divisor", "sheets", 1.01e-22, 0.99e-22, lambda x: plain(heavy(x, w0=x))),
    Case("ratio", "float32", 1100, 1200, lambda x: plain(
        lattice(values=np.full((6, 6, 6), x)), transfer=[(0, 0, 0, 0, 0), (1, 1, 1, 1, 0.01)])),
    Case("ratio", "float64", 5.7e11, 5.82e11, lambda x: plain(
        lattice(values=np.full((6, 6, 6), x)), transfer=[(0, 0, 0, 0, 0), (1, 1, 1, 1, 0.01)])),
    Case("ratio", "sheets", 1100, 1200, lambda x: plain(
        lattice(values=np.full((6, 6, 6), x)), transfer=[(0, 0, 0, 0, 0), (1, 1, 1, 1, 0.01)])),
    Case("gradient_opacity", "float32", 1.05, 0.95, lambda x: plain(lattice(), gradient_opacity=1.084e-3 * x)),
    Case("gradient_opacity", "float64", 1.05, 0.95, lambda x: plain(lattice(), gradient_opacity=2.169e-12 * x)),
    Case("gradient_opacity", "sheets", 1.05, 0.95, lambda x: plain(lattice(), gradient_opacity=1.084e-3 * x)),
    Case("nearest_end", "float32", 0.9e6, 1.1e6, lambda x: plain(
        lattice(), mode="isosurface", iso_value=1 / x)),
    Case("nearest_end", "sheets", 0.9e6, 1.1e6, lambda x: plain(
        lattice(), mode="isosurface", iso_value=1 / x)),
    Case("alike", "float32", 9800, 10200, lambda x: plain(coincident(x, 0.5))),
    Case("alike", "sheets", 9800, 10200, lambda x: plain(coincident(x, 0.5))),
    Case("weights_in_slabs", "float32", 290, 298, lambda x: plain(heavy(x), sampling="slab")),
    Case("weights_in_slabs", "float64", 0.97e15, 0.99e15, lambda x: plain(heavy(x), sampling="slab")),
    Case("crowded_weights_in_slabs", "sheets", 2.3e4, 2.6e4, lambda x: plain(heavy(x), sampling="slab")),
]  # fmt: skip


def reason_of(case: Case, number: float) -> str:
    """Return why another way draws a scene, or why it is refused; "" where the case's own way draws it."""
    one = case.make(number)
    scene, camera, size = build_effects(ss, one)
    try:
        if case.backend == "cpu":
            plan = ss.Renderer("cpu").plan(scene, camera, size)
            reason = next(effect.reason for effect in plan.effects if effect.name == "float64")
            return reason if case.way == "float32" and plan.precision == "float64" else ""
        image = ss.Renderer("gl", effects=case.effects or {}).render(scene, camera, size=size)
        return handed_over(image)
    except ss.Unsupported as refused:
        return str(refused)


def fault_of(case: Case, number: float) -> str:
    """Return how the picture of a scene breaks section 9, or ""; of a refused scene "refused"."""
    one = case.make(number)
    try:
        if not case.effects:
            return sweep_scenes.fault(one, case.backend, ())
        scene, camera, size = build_effects(ss, one)
        found = off_by(ss.Renderer("gl", effects=case.effects).render(scene, camera, size=size), by_reference(one))
        return "" if within(found, FLOAT32) else str(found)
    except ss.Unsupported:
        return "refused"


@pytest.mark.filterwarnings("ignore::sheetsplat.PictureWarning")
@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=[pytest.mark.gl] if case.backend == "gl" else []) for case in CASES], ids=str
)
def test_pictures_on_both_sides_are_right(case: Case) -> None:
    assert reason_of(case, case.within) == ""
    noun = re.escape(rows()[case.limit][1])
    for place in ("{}", "{largest}", "{resolved}"):
        noun = noun.replace(re.escape(place), r"[\d.e+-]+")
    assert re.search(noun, reason_of(case, case.beyond))
    assert fault_of(case, case.within) == ""
    # Nothing else draws what float64 does not, and what the effect was forced on for.
    refused = case.way in ("float64", "papers") or (case.way == "sheets" and case.limit in ("placed_px", "divisor"))
    assert fault_of(case, case.beyond) == ("refused" if refused else "")


LOST = {"smallest_px": 0.1, "falloff": 5e-6, "steepest_falloff": 200, "weights_in_slabs": 3e6, "thickest_slab": 1e5}


@pytest.mark.parametrize("case", [case for case in CASES if case.way == "float32" and case.limit in LOST], ids=str)
def test_far_beyond_float32_is_lost(case: Case) -> None:
    """Limits are not there for nothing: what they leave out is wrong where it is drawn all the same."""
    one = case.make(LOST[case.limit])
    scene, camera, size = build_effects(ss, one)
    image = ss.Renderer("cpu", precision="float32", allow_inexact=True).render(scene, camera, size=size)
    assert not within(off_by(image, by_reference(one)), FLOAT32)


#: By devices and sizes that a test does not have: tests/cpp/plan/test_plan.cpp makes the plans alone.
PLANS_ALONE = {
    ("light_elements", "sheets"),
    ("resident_kernels", "papers"),
    ("slices", "old_sheets"),
    ("aspect", "old_sheets"),
    ("smallest_px", "old_sheets"),
}


def test_every_limit_has_a_case() -> None:
    table = {(name, way) for name, (ends, _) in rows().items() for way in ends}
    assert len(table) > 40
    assert table == {(case.limit, case.way) for case in CASES} | PLANS_ALONE
