"""Every path of the OpenGL backend gives the picture of the reference within section 9 of image formation."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import Any

import numpy as np
import pytest
from image_checks import FLOAT16, FLOAT32, FLOAT32_HARD, MOST_AMBIGUOUS, assert_close, distance

import sheetsplat as ss

pytestmark = pytest.mark.gl

SIZE = (36, 30)
LIGHTS = (ss.Light((0.4, 0.6, 1.0), (1.0, 0.9, 0.8)), ss.Light((-1.0, 0.2, 0.3), (0.2, 0.2, 0.4), "world"))
MATERIAL = ss.Material(ambient=0.2, diffuse=0.7, specular=0.3, shininess=12, two_sided=True)


@dataclass(frozen=True)
class Case:
    """A scene, its camera and its outputs."""

    mode: str = "composite"
    sampling: str = "point"
    normalization: str = "lattice"
    projection: str = "orthographic"
    lattice: str = "cartesian"
    opacity_stop: float = 1.0
    preintegration: bool = False
    lit: bool = True
    opaque: bool = False
    visible_zero: bool = False
    holes: bool = False
    fields: int = 1
    spacing: float | None = None
    nudge_value: float = 0.0
    nudge_radius: float = 0.0

    @property
    def stops(self) -> bool:
        """Whether pixels stop changing at some opacity."""
        return self.mode == "isosurface" or self.opacity_stop < 1

    def __str__(self) -> str:
        return "-".join(
            [self.mode, self.sampling, self.normalization, self.projection, self.lattice]
            + [name for name in ("preintegration", "opaque", "visible_zero", "holes") if getattr(self, name)]
            + ([f"stop{self.opacity_stop}"] if self.opacity_stop < 1 else [])
            + ([] if self.lit else ["unlit"])
            + ([f"{self.fields}fields"] if self.fields > 1 else [])
            + ([f"ds{self.spacing}"] if self.spacing else [])
        )


@cache
def samples(lattice: str) -> np.ndarray:
    """Return a bumpy thing in empty space, 0 to 1, float32 [k, j, i]."""
    shape = (12, 11, 10) if lattice == "cartesian" else (17, 8, 8)
    at = np.stack(np.meshgrid(*(np.linspace(-1, 1, count) for count in shape), indexing="ij"))
    distance_ = np.sqrt((at**2).sum(0))
    bumps = 0.15 * np.sin(5 * at[0]) * np.cos(4 * at[1] + 1) * np.sin(3 * at[2] + 2)
    return np.clip(1.15 - 1.2 * distance_ + bumps, 0, 1).astype(np.float32)


def make(case: Case) -> tuple[ss.Scene, ss.Camera]:
    """Return the scene and the camera of a case."""
    values = samples(case.lattice)
    cartesian = case.lattice == "cartesian"
    options: dict[str, Any] = {
        "spacing": (1.0, 1.1, 0.9) if cartesian else (1.4, 1.4, 1.4),
        "origin": (3.0, -2.0, 5.0),
        "lattice": case.lattice,
        "normalization": case.normalization,
        "radius": 2.0 * (1 + case.nudge_radius),
    }
    if case.normalization == "none":
        # Sums are larger by the kernel's mass; dividing the values by it keeps one transfer function for all.
        values = values / np.float32(ss.RegularField(values, **options).native.lattice_constant)
    if case.holes:
        values = np.where(np.indices(values.shape).sum(0) % 7 == 0, np.nan, values).astype(np.float32)
        options["nan"] = "skip"
    fields = [ss.RegularField(values / np.float32(case.fields), **options) for _ in range(case.fields)]
    top = 0.95 if case.opaque else 0.35
    low = 0.05 if case.visible_zero else 0.0
    points = np.array(
        [(0, 0.1, 0.2, 0.6, low), (0.3, 0.2, 0.5, 0.4, low), (0.7, 0.9, 0.6, 0.2, top / 2), (1, 1, 0.9, 0.8, top)]
    )
    points[:, 0] -= case.nudge_value
    scene = ss.Scene(
        fields,
        points,
        mode=case.mode,
        sampling=case.sampling,
        iso_value=0.5 - case.nudge_value if case.mode == "isosurface" else None,
        lights=LIGHTS if case.lit else (),
        material=MATERIAL,
        opacity_stop=case.opacity_stop,
        preintegration=case.preintegration,
        slice_spacing=case.spacing,
    )
    upright = replace(case, nudge_radius=0.0)
    anchor = scene if case.nudge_radius == 0 else make(upright)[0]
    return scene, ss.Camera.fit(anchor, (-0.5, -0.4, -0.8), kind=case.projection, margin=1.0)


@cache
def reference(case: Case) -> ss.Image:
    """Return the reference's picture."""
    scene, camera = make(case)
    return ss.Renderer("reference").render(scene, camera, size=SIZE, outputs=("coverage", "depth"))


@cache
def ambiguous(case: Case) -> np.ndarray | None:
    """Return the pixels whose reference jumps under the nudges of section 9, or None where nothing jumps."""
    if not (case.mode == "isosurface" or case.opacity_stop < 1 or case.visible_zero):
        return None
    nudged = [replace(case, nudge_value=sign * 1e-5) for sign in (-1, 1)]
    nudged += [replace(case, nudge_radius=sign * 1e-5) for sign in (-1, 1)]
    if case.opacity_stop < 1:
        nudged += [replace(case, opacity_stop=case.opacity_stop + sign * 1e-5) for sign in (-1, 1)]
    expected = reference(case).pixels
    moved = [np.abs(reference(other).pixels - expected) for other in nudged]
    return np.max([change.reshape(*change.shape[:2], -1).max(2) for change in moved], axis=0) > 1e-3


@lru_cache(maxsize=32)
def renderer(**options: Any) -> ss.Renderer:
    """Return a renderer of its own for each set of options."""
    effects = dict(options.pop("effects", ()))
    return ss.Renderer(options.pop("backend", "gl"), effects=effects, **options)


def check(case: Case, bounds: tuple[float, float] = FLOAT32, **options: Any) -> ss.Image:
    """Compare the picture of a renderer with these options with the reference."""
    scene, camera = make(case)
    image = renderer(**options).render(scene, camera, size=SIZE)
    assert image.plan.backend == options.get("backend", "gl")
    name = f"{image.plan.backend} {case} {' '.join(f'{name}={value}' for name, value in options.items())}"
    assert_close(image.pixels, reference(case).pixels, bounds, name, ambiguous(case))
    return image


MODES = ("composite", "isosurface", "xray", "mip")
SAMPLINGS = ("point", "slab")
NORMALIZATIONS = ("none", "lattice", "threshold")
PROJECTIONS = ("orthographic", "perspective")
LATTICES = ("cartesian", "bcc")
SCENES = [Case(*parts) for parts in itertools.product(MODES, SAMPLINGS, NORMALIZATIONS, PROJECTIONS, LATTICES)]
PATHS = list(itertools.product(("wide", "paper"), ("tiles", "depth_equal", "off")))


# Every pair of choices, of which one may be the path; the C++ tests draw every scene in either packing.
PAIRS = [
    (
        Case(
            mode,
            SAMPLINGS[(m + p) % 2],
            NORMALIZATIONS[(m + p) % 3],
            PROJECTIONS[(m // 2 + p // 3) % 2],
            LATTICES[(m // 2 + p) % 2],
        ),
        *path,
    )
    for m, mode in enumerate(MODES)
    for p, path in enumerate(PATHS)
]


@pytest.mark.parametrize(("case", "packing", "tagging"), PAIRS, ids=str)
def test_every_pair(case, packing, tagging):
    """Each scene takes the path that auto chooses and one of the others."""
    check(case)
    check(case, packing=packing, tagging=tagging)


def test_pairs_are_all_that_there_are():
    rows = [(c.mode, c.sampling, c.normalization, c.projection, c.lattice, path) for c, *path in PAIRS]
    choices = (MODES, SAMPLINGS, NORMALIZATIONS, PROJECTIONS, LATTICES, [list(path) for path in PATHS])
    for one, other in itertools.combinations(range(len(choices)), 2):
        found = {(str(row[one]), str(row[other])) for row in rows}
        assert len(found) == len(choices[one]) * len(choices[other])


HARD = [
    Case(),
    Case(opaque=True, opacity_stop=0.95),
    Case(opaque=True, opacity_stop=0.95, projection="perspective", lattice="bcc", sampling="slab"),
    Case(visible_zero=True),
    Case(mode="isosurface"),
    Case(mode="isosurface", projection="perspective", normalization="threshold"),
    Case(mode="xray", sampling="slab"),
    Case(preintegration=True, lattice="bcc"),
    Case(fields=2, lit=False),
    Case(holes=True, normalization="threshold"),
    Case(spacing=0.37, opaque=True),
]


OPAQUE = [case for case in HARD if case.stops]
# Every case on every path; with elimination and without by turns, so that either meets every case and every path.
ELIMINATION = [
    (case, *path, (c + p // 3 + p) % 2 == 0) for c, case in enumerate(OPAQUE) for p, path in enumerate(PATHS)
]


@pytest.mark.parametrize(("case", "packing", "tagging", "elimination"), ELIMINATION, ids=str)
def test_every_path_of_scenes_that_become_opaque(case, packing, tagging, elimination):
    check(case, FLOAT32_HARD, packing=packing, tagging=tagging, effects=(("elimination", elimination),))


@pytest.mark.parametrize(("packing", "tagging"), PATHS)
@pytest.mark.parametrize("case", [case for case in HARD if not case.stops], ids=str)
def test_every_path_of_other_scenes(case, packing, tagging):
    check(case, FLOAT32_HARD, packing=packing, tagging=tagging)


SOFTPIPE = """
import test_gl_against_reference as tests
for number in range({count}):
    case = tests.HARD[number]
    for packing in ("wide", "paper"):
        image = tests.check(case, tests.FLOAT32_HARD, packing=packing, tagging="depth_bounds")
        assert "softpipe" in image.plan.device and image.plan.tagging == "depth_bounds", image.plan
print("done")
"""


@pytest.mark.slow
def test_depth_bounds_on_a_rasteriser_that_has_them():
    """Mesa's softpipe has the depth bounds test, which llvmpipe lacks."""
    environment = {**os.environ, "GALLIUM_DRIVER": "softpipe", "PYTHONPATH": os.pathsep.join(sys.path)}
    probe = "import sheetsplat as ss; print([d.description for d in ss.devices()])"
    found = subprocess.run([sys.executable, "-c", probe], env=environment, capture_output=True, text=True)
    if "softpipe" not in found.stdout:
        pytest.skip(f"no softpipe here: {found.stdout}")
    code = SOFTPIPE.format(count=len(HARD))
    result = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert result.returncode == 0 and result.stdout.strip() == "done", result.stdout + result.stderr


FORCED = (
    "opacity_buffer",
    "culling",
    "weight",
    "empty_test",
    "general_sections",
)
ALWAYS_RIGHT = [(name, True) for name in (*FORCED, "gradient", "specular", "two_sided", "opacity_correction")]
ALWAYS_RIGHT += [(name, False) for name in ("culling", "opacity_buffer", "elimination")]


@pytest.mark.parametrize("packing", ["wide", "paper"])
@pytest.mark.parametrize("effect", ALWAYS_RIGHT, ids=lambda effect: f"{effect[0]}-{'on' if effect[1] else 'off'}")
def test_an_effect_that_was_left_out_changes_nothing_when_forced(effect, packing):
    for case in (Case(lit=False), Case(opaque=True, opacity_stop=0.95)):
        check(case, FLOAT32_HARD, packing=packing, effects=(effect,))


@pytest.mark.parametrize("packing", ["wide", "paper"])
@pytest.mark.parametrize("tagging", ["tiles", "depth_equal", "off"])
def test_tiles_and_restarted_tags_leave_no_seam(packing, tagging):
    for case in (Case(opaque=True, opacity_stop=0.95), Case(projection="perspective", mode="isosurface")):
        whole = check(case, FLOAT32_HARD, packing=packing, tagging=tagging)
        for options in ({"tile_size": 13}, {"tile_size": 16, "tags_per_clear": 3}):
            pieces = check(case, FLOAT32_HARD, packing=packing, tagging=tagging, **options)
            assert_close(pieces.rgba, whole.rgba, FLOAT32, f"pieces {options} {packing} {tagging}", ambiguous(case))


@pytest.mark.parametrize(
    "case", [Case(opacity_stop=0.9), Case(projection="perspective", lattice="bcc"), Case(mode="isosurface")], ids=str
)
def test_coverage_and_depth(case):
    scene, camera = make(case)
    expected = reference(case)
    for packing in ("wide", "paper"):
        image = renderer(packing=packing).render(scene, camera, size=SIZE, outputs=("coverage", "depth"))
        assert_close(image.coverage, expected.coverage, FLOAT32, f"coverage {case} {packing}")
        assert_close(image.pixels, expected.pixels, FLOAT32, f"beside coverage {case} {packing}", ambiguous(case))
        finite = np.isfinite(image.depth)
        both = finite & np.isfinite(expected.depth)
        assert both.any() and (finite != np.isfinite(expected.depth)).mean() <= MOST_AMBIGUOUS
        # A pixel at which opacity just reaches one half may take the slice before or after.
        apart = np.abs(image.depth[both] - expected.depth[both]) > 1e-3
        assert apart.mean() <= MOST_AMBIGUOUS


SIXTEEN = [Case(lit=False), Case(mode="xray"), Case(mode="mip"), Case(normalization="threshold", lit=False)]


@pytest.mark.parametrize("packing", ["wide", "paper"])
@pytest.mark.parametrize("case", [*SIXTEEN, Case(), Case(mode="isosurface")], ids=str)
def test_sixteen_bits_keep_their_bound_or_are_refused(case, packing):
    scene, camera = make(case)
    try:
        renderer(precision="float16", packing=packing).plan(scene, camera, size=SIZE)
    except ss.Unsupported as error:
        assert error.option == "precision"
        image = renderer(precision="float16", packing=packing, allow_inexact=True).render(scene, camera, size=SIZE)
        assert image.plan.precision == "float16" and image.pixels.any()
        return
    check(case, FLOAT16, precision="float16", packing=packing)


@pytest.mark.parametrize(
    "wrong",
    [
        Case(spacing=0.97),
        Case(nudge_radius=1e-3),
        Case(nudge_value=1e-3),
        Case(opacity_stop=0.5),
        Case(sampling="slab"),
        Case(normalization="threshold"),
        Case(lit=False),
    ],
    ids=str,
)
def test_pictures_that_are_wrong_by_a_little_fail(wrong):
    """The bounds tell scenes apart that differ by a thousandth: negative control of every test above."""
    right = reference(Case())
    scene, camera = make(wrong)
    found = distance(renderer().render(scene, make(Case())[1], size=SIZE).rgba, right.rgba)
    assert not found.within(FLOAT32), found


def test_the_ambiguous_are_few_and_looked_for_well():
    """A step's own pixels are found: shifting the value by what the nudge shifts moves nothing outside of them."""
    case = Case(mode="isosurface")
    mask = ambiguous(case)
    assert mask is not None and mask.mean() <= MOST_AMBIGUOUS
    moved = np.abs(reference(replace(case, nudge_value=1e-5)).rgba - reference(case).rgba).max(2)
    assert (moved[~mask] <= 1e-3).all()
