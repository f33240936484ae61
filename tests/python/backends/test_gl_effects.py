"""The effects beyond the papers, drawn by OpenGL, are the reference's within section 9 of image formation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from image_checks import FLOAT32, FLOAT32_HARD, assert_close, distance, handed_over
from scene_parts import cloud

import sheetsplat as ss

pytestmark = pytest.mark.gl

SIZE = (44, 36)
LIGHTS = (ss.Light((0.4, 0.6, 1.0), (1.0, 0.9, 0.8)), ss.Light((-1.0, 0.2, 0.3), (0.2, 0.2, 0.4), "world"))
MATERIAL = ss.Material(ambient=0.2, diffuse=0.7, specular=0.3, shininess=12, two_sided=True)
CUBE = ((-0.55, -0.6, -0.5), (0.5, 0.6, 0.65))
# Planes that the camera looks at, and a sphere.
FACING = (((-1.0, -0.9, -1.5), -0.3), ((-1.0, 0.2, 0.1), -0.2))
BALL = ss.Clip(sphere=((0.0, 0.1, -0.1), 0.6))
TILTED = (((1.0, 2.0, 0.5), -0.2), ((-3.0, 0.5, 1.0), -2.0))


@dataclass(frozen=True)
class Case:
    """A scene, its camera and its outputs. `options` are those of Scene."""

    field: str = "cartesian"
    normalization: str = "lattice"
    projection: str = "orthographic"
    options: tuple[tuple[str, Any], ...] = ()
    lit: bool = True
    visible_zero: bool = False
    opaque: bool = False
    outputs: tuple[str, ...] = ()
    nudge_value: float = 0.0
    nudge_radius: float = 0.0
    nudge_stop: float = 0.0

    @property
    def scene(self) -> dict[str, Any]:
        """Return the options of Scene."""
        return dict(self.options)

    def with_(self, **options: Any) -> Case:
        """Return the case with further options of Scene."""
        return replace(self, options=tuple((self.scene | options).items()))

    def __str__(self) -> str:
        flags = [name for name in ("visible_zero", "opaque") if getattr(self, name)] + ([] if self.lit else ["unlit"])
        options = [f"{name}={value}" for name, value in self.options if name not in ("clip", "depth_cue", "lights")]
        options += [name for name in ("clip", "depth_cue") if name in self.scene]
        return "-".join([self.field, self.normalization, self.projection, *flags, *options, *self.outputs])


@cache
def fields(field: str, normalization: str, radius: float = 1.0) -> tuple[ss.Field, ...]:
    """Return what is drawn, in the cube of edge 2 around 0."""
    if "+" in field:
        return tuple(one for part in field.split("+") for one in fields(part, normalization, radius))
    if field == "ellipsoids":
        made = cloud(np.random.default_rng(3), 40, aspect=2.5)
        norm = "threshold" if normalization == "lattice" else normalization
        values = made["values"] / 3 if norm == "none" else made["values"]
        return (
            ss.EllipsoidField(
                made["centers"], radius * made["scales"], made["rotations"], values, normalization=norm, w0=0.3
            ),
        )
    shape = (12, 11, 10) if field != "bcc" else (17, 8, 8)
    at = np.stack(np.meshgrid(*(np.linspace(-1, 1, count) for count in shape), indexing="ij"))
    bumps = 0.15 * np.sin(5 * at[0]) * np.cos(4 * at[1] + 1) * np.sin(3 * at[2] + 2)
    values = np.clip(1.15 - 1.2 * np.sqrt((at**2).sum(0)) + bumps, 0, 1).astype(np.float32)
    options: dict[str, Any] = {
        "spacing": (0.2, 0.2, 0.2) if field == "cartesian" else (0.2, 0.22, 0.18),
        "origin": (-0.9, -1.0, -1.05),
        "radius": 2.0 * radius,
        "normalization": normalization,
    }
    if field == "bcc":
        options |= {"lattice": "bcc", "spacing": (0.28, 0.28, 0.28)}
    if normalization == "none":
        values = values / np.float32(ss.RegularField(values, **(options | {"radius": 2.0})).native.lattice_constant)
    return (ss.RegularField(values, **options),)


def make(case: Case) -> tuple[ss.Scene, ss.Camera]:
    """Return the scene and the camera of a case."""
    top = 0.9 if case.opaque else 0.35
    low = 0.05 if case.visible_zero else 0.0
    points = np.array(
        [(0.0, 0.1, 0.2, 0.6, low), (0.3, 0.2, 0.5, 0.4, low), (0.7, 0.9, 0.6, 0.2, top / 2), (1, 1, 0.9, 0.8, top)]
    )
    points[:, 0] -= case.nudge_value
    options = {"lights": LIGHTS if case.lit else (), "material": MATERIAL, "slice_spacing": 0.2, "opacity_stop": 1.0}
    options |= case.scene
    if "iso_value" in options:
        given, moved = options["iso_value"], case.nudge_value
        options["iso_value"] = tuple((at - moved, o) for at, o in given) if isinstance(given, tuple) else given - moved
    if case.nudge_stop:
        options["opacity_stop"] += case.nudge_stop
    scene = ss.Scene(fields(case.field, case.normalization, 1 + case.nudge_radius), points, **options)
    eye, target, up = (1.5, 1.3, 2.6), (0.05, 0.0, -0.05), (0.1, 1.0, 0.2)
    if case.projection == "orthographic":
        return scene, ss.Camera.orthographic(eye, target, up, height=2.9)
    return scene, ss.Camera.perspective(eye, target, up, fov_y=48.0)


@cache
def reference(case: Case) -> ss.Image:
    """Return the reference's picture."""
    scene, camera = make(case)
    return ss.Renderer("reference").render(scene, camera, size=SIZE, outputs=case.outputs)


@cache
def ambiguous(case: Case) -> np.ndarray | None:
    """Return the pixels whose reference jumps under the nudges of section 9, or None where nothing jumps."""
    stop = case.scene.get("opacity_stop", 1.0)
    if not (case.scene.get("mode") == "isosurface" or stop < 1 or case.visible_zero):
        return None
    nudged = [replace(case, nudge_value=sign * 1e-5) for sign in (-1, 1)]
    nudged += [replace(case, nudge_radius=sign * 1e-5) for sign in (-1, 1)]
    if stop < 1:
        nudged += [replace(case, nudge_stop=sign * 1e-5) for sign in (-1, 1)]
    expected = reference(case).pixels
    moved = [np.abs(reference(other).pixels - expected) for other in nudged]
    return np.max([change.reshape(*change.shape[:2], -1).max(2) for change in moved], axis=0) > 1e-3


def draw(case: Case, **options: Any) -> ss.Image:
    """Return OpenGL's picture."""
    scene, camera = make(case)
    return renderer(**options).render(scene, camera, size=SIZE, outputs=case.outputs)


@cache
def renderer(effects: tuple[tuple[str, bool], ...] = (), **options: Any) -> ss.Renderer:
    """Return a renderer of its own for each set of options."""
    return ss.Renderer("gl", effects=dict(effects), **options)


def compare(case: Case, image: ss.Image, bounds: tuple[float, float], on: tuple[str, ...], name: str) -> ss.Image:
    """Compare a picture and its outputs with the reference's; `on` are effects that the plan must have called for."""
    called = {effect.name for effect in image.plan.effects if effect.on}
    assert called >= set(on), f"not on: {set(on) - called}"
    assert_close(image.pixels, reference(case).pixels, bounds, name, ambiguous(case))
    for output in case.outputs:
        found, expected = getattr(image, output), getattr(reference(case), output)
        assert np.array_equal(np.isinf(found), np.isinf(expected)), output
        shown = np.isfinite(expected)
        assert np.allclose(found[shown], expected[shown], rtol=2e-5, atol=2e-5), output
    return image


def check(case: Case, bounds: tuple[float, float] = FLOAT32, on: tuple[str, ...] = (), **options: Any) -> ss.Image:
    """Compare OpenGL's picture with the reference's."""
    return compare(case, draw(case, **options), bounds, on, f"effects {case} {options}")


def moved_by(case: Case, other: Case) -> float:
    """Return the RMSE between the reference's pictures of two cases."""
    return distance(reference(case).pixels, reference(other).pixels).rmse


CLIPS = {"planes": ss.Clip(planes=TILTED), "box": ss.Clip(box=CUBE)}
CUE = ss.DepthCue(2.2, 3.6, (0.9, 0.2, 0.1), 0.8)
FIELDS = ("cartesian", "ellipsoids")
PROJECTIONS = ("orthographic", "perspective")


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("field", FIELDS)
def test_clip(field, projection):
    base = Case(field, projection=projection)
    for clip in CLIPS.values():
        check(base.with_(clip=clip), on=("clip",))
    cut = base.with_(clip=CLIPS["planes"])
    assert moved_by(cut, base) > 100 * FLOAT32[0]
    shifted = base.with_(clip=ss.Clip(planes=[(normal, offset + 0.03) for normal, offset in TILTED]))
    assert moved_by(cut, shifted) > 10 * FLOAT32[0], "planes 0.03 off must be seen"


@pytest.mark.parametrize(
    "case",
    [
        Case(visible_zero=True, outputs=("coverage", "depth")),
        Case("ellipsoids", options=(("preintegration", True),), visible_zero=True),
        Case(options=(("mode", "isosurface"), ("iso_value", 0.45)), outputs=("depth",)),
        Case("bcc", options=(("mode", "xray"),), outputs=("coverage",)),
        Case("ellipsoids", options=(("mode", "mip"),)),
    ],
    ids=str,
)
def test_clip_in_every_mode(case):
    check(case.with_(clip=CLIPS["box"]), on=("clip",))
    assert moved_by(case.with_(clip=CLIPS["box"]), case) > 100 * FLOAT32[0]


@pytest.mark.parametrize("kept", [1, -1])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_points_on_a_plane_are_kept_whatever_their_rounding(axis, kept):
    """Planes that go through the centres of a row or column of pixels, or through a slice; pictures that jump there."""
    values = np.ones((10, 10, 10), np.float32)
    field = ss.RegularField(values, spacing=(0.1, 0.1, 0.1), origin=(-0.45 + 1e3, -0.45, -0.45))
    normal = np.zeros(3)
    # The slices next to the middle are half a slice distance from it; a row of an odd number of pixels goes through it.
    offset, normal[axis] = kept * (1e3 if axis == 0 else 0.05 if axis == 2 else 0.0), kept
    camera = ss.Camera.orthographic((1e3, 0, 5), (1e3, 0, 0), height=1.7)

    def picture(backend: str, cut: float) -> np.ndarray:
        clip = ss.Clip([(normal, offset + cut)])
        scene = ss.Scene(field, [(0, 1, 1, 1, 0), (1, 1, 1, 1, 0.4)], slice_spacing=0.1, clip=clip)
        return ss.Renderer(backend).render(scene, camera, size=(17, 17)).pixels

    assert np.abs(picture("gl", 0) - picture("reference", 0)).max() < FLOAT32[1]
    assert np.abs(picture("gl", 1e-4) - picture("reference", 1e-4)).max() < FLOAT32[1]
    assert np.abs(picture("gl", 1e-4) - picture("gl", 0)).max() > 100 * FLOAT32[1], "points on the plane were kept"


@pytest.mark.parametrize(
    "case",
    [
        Case(),
        Case("ellipsoids", projection="perspective", lit=False),
        Case("uneven", options=(("preintegration", True),)),
        Case("ellipsoids", options=(("gradient", "analytic"), ("preintegration", "second_order"))),
        # Slices so close that differences are splatted.
        Case(options=(("slice_spacing", 0.06), ("reference_length", 1.0), ("clip", CLIPS["planes"]))),
    ],
    ids=str,
)
def test_gradient_opacity(case):
    faded = case.with_(gradient_opacity=2.0)
    check(faded, on=("gradient_opacity", "gradient"))
    assert moved_by(faded, case) > 100 * FLOAT32[0]
    assert moved_by(faded, case.with_(gradient_opacity=2.02)) > 2 * FLOAT32[0], "a hundredth of g1 must be seen"


@pytest.mark.parametrize(
    "case",
    [
        Case(options=(("clip", ss.Clip(FACING)),)),
        Case("uneven", projection="perspective", options=(("clip", ss.Clip(FACING, CUBE)),), opaque=True),
        Case("bcc", options=(("clip", BALL), ("preintegration", True))),
        Case("cartesian", projection="perspective", options=(("clip", BALL), ("slice_spacing", 0.05))),
        Case("ellipsoids", "threshold", options=(("clip", ss.Clip(FACING)), ("preintegration", "second_order"))),
        Case("ellipsoids", "threshold", visible_zero=True, options=(("clip", ss.Clip(FACING)), ("opacity_stop", 0.9))),
        Case("cartesian+ellipsoids", options=(("clip", ss.Clip(FACING)), ("slice_spacing", 0.7))),
    ],
    ids=str,
)
def test_cut_faces(case):
    check(case.with_(cut_faces=True), FLOAT32_HARD, on=("cut_faces", "clip"))
    assert moved_by(case.with_(cut_faces=True), case) > 10 * FLOAT32_HARD[0]


@pytest.mark.parametrize(
    "case",
    [
        Case(),
        Case("ellipsoids", projection="perspective", lit=False),
        Case("ellipsoids", options=(("preintegration", True),)),
        Case(projection="perspective", options=(("mode", "isosurface"), ("iso_value", 0.45))),
    ],
    ids=str,
)
def test_depth_cue(case):
    cued = case.with_(depth_cue=CUE)
    check(cued, on=("depth_cue",))
    assert moved_by(cued, case) > 100 * FLOAT32[0]
    half_a_slice = ss.DepthCue(CUE.start + 0.1, CUE.end + 0.1, CUE.color, CUE.strength)
    assert moved_by(cued, case.with_(depth_cue=half_a_slice)) > 20 * FLOAT32[0]


def test_a_depth_cue_may_be_a_step():
    check(Case(lit=False).with_(depth_cue=ss.DepthCue(3.0, np.nextafter(3.0, 4.0), (1, 0, 0))), on=("depth_cue",))


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("field", ["cartesian", "ellipsoids"])
def test_second_order(field, projection):
    first = Case(field, projection=projection).with_(preintegration=True)
    second = first.with_(preintegration="second_order")
    check(second, on=("second_order",))
    assert moved_by(first, second) > 10 * FLOAT32[0]


# The projections by turns: either meets every field, normalization and sampling.
ANALYTIC = [
    Case(field, normalization, PROJECTIONS[(f + n + s) % 2], (("gradient", "analytic"), ("sampling", sampling)))
    for f, field in enumerate(("cartesian", "uneven", "bcc", "ellipsoids", "cartesian+ellipsoids"))
    for n, normalization in enumerate(("lattice", "none", "threshold"))
    for s, sampling in enumerate(("point", "slab"))
    if not (field == "ellipsoids" and normalization == "lattice")
]


@pytest.mark.parametrize("case", ANALYTIC, ids=str)
def test_analytic_gradients(case):
    check(case, on=("analytic_gradient",))
    assert moved_by(case, case.with_(gradient="sheets")) > 5 * FLOAT32[0], "differences give another picture"


@pytest.mark.parametrize(
    "case",
    [
        Case("ellipsoids", options=(("mode", "isosurface"), ("iso_value", 0.45))),
        Case("ellipsoids", projection="perspective", options=(("filter", "ewa"),), visible_zero=True),
        Case("cartesian", options=(("filter", "ewa"), ("sampling", "slab"))),
        Case("uneven", options=(("preintegration", True),), visible_zero=True, outputs=("coverage",)),
        Case("ellipsoids", options=(("slice_spacing", 0.5), ("sampling", "slab"))),
        Case("ellipsoids", options=(("slice_spacing", 0.02), ("sampling", "slab"))),
        Case(options=(("slice_spacing", 0.9), ("sampling", "slab"))),
    ],
    ids=str,
)
def test_analytic_gradients_with_other_effects(case):
    check(case.with_(gradient="analytic"), on=("analytic_gradient",))


TOGETHER = [
    Case(
        "cartesian+ellipsoids",
        options=(("gradient", "analytic"), ("clip", CLIPS["planes"]), ("cut_faces", True), ("depth_cue", CUE)),
        visible_zero=True,
        outputs=("coverage", "depth"),
    ),
    Case(
        "ellipsoids",
        projection="perspective",
        options=(
            ("preintegration", "second_order"),
            ("gradient_opacity", 2.0),
            ("clip", CLIPS["box"]),
            ("cut_faces", True),
            ("opacity_stop", 0.95),
        ),
        opaque=True,
    ),
]


@pytest.mark.parametrize("case", TOGETHER, ids=str)
@pytest.mark.parametrize(("packing", "tagging"), [(p, t) for p in ("wide", "paper") for t in ("tiles", "depth_equal")])
def test_every_path(case, packing, tagging):
    check(case, FLOAT32_HARD, packing=packing, tagging=tagging, effects=(("elimination", case.opaque),))
    if case.opaque:
        check(case, FLOAT32_HARD, packing=packing, tagging=tagging, effects=(("opacity_buffer", True),))


@pytest.mark.slow
def test_tiles_leave_no_seam():
    case = TOGETHER[0]
    whole, tiles = draw(case), draw(case, tile_size=17)
    assert tiles.stats["tiles"] == 9
    assert np.abs(whole.pixels - tiles.pixels).max() < FLOAT32[0]
    shadowed = Case(options=(("shadows", True),))
    assert np.abs(draw(shadowed).pixels - draw(shadowed, tile_size=17).pixels).max() < FLOAT32[0]


def test_a_renderer_forgets_the_effects_of_the_last_picture():
    plain = Case("cartesian")
    pictures = [
        draw(case).pixels.copy()
        for case in (plain, plain.with_(clip=CLIPS["box"], depth_cue=CUE), plain.with_(gradient="analytic"), plain)
    ]
    assert np.array_equal(pictures[0], pictures[-1])
    assert not np.array_equal(pictures[0], pictures[1])


OCCLUSION = ss.AmbientOcclusion(0.6, 0.8)


@pytest.mark.parametrize(
    "case",
    [
        Case(options=(("shadows", True),)),
        Case("ellipsoids", projection="perspective", options=(("shadows", True), ("gradient", "analytic"))),
        Case("ellipsoids", options=(("ambient_occlusion", OCCLUSION),)),
        Case(projection="perspective", options=(("ambient_occlusion", OCCLUSION),), lit=False),
        Case(
            "ellipsoids",
            options=(
                ("shadows", True),
                ("ambient_occlusion", OCCLUSION),
                ("preintegration", True),
                ("clip", CLIPS["planes"]),
            ),
        ),
    ],
    ids=str,
)
def test_light_is_dimmed_as_on_the_processor(case):
    """Both backends sample the same grids; the error of the grids is part of the picture's stated error."""
    image = draw(case)
    called = {effect.name for effect in image.plan.effects if effect.on}
    assert called >= {name for name in ("shadows", "ambient_occlusion") if case.scene.get(name)}
    scene, camera = make(case)
    processor = ss.Renderer("cpu").render(scene, camera, size=SIZE)
    assert_close(image.pixels, processor.pixels, FLOAT32, f"light volumes {case}", ambiguous(case))
    without = case.with_(shadows=False, ambient_occlusion=None)
    effect = moved_by(case, without)
    assert effect > 50 * FLOAT32[0]
    assert distance(image.pixels, reference(case).pixels).rmse < effect / 5


def test_forced_effects_that_cannot_be_are_refused():
    scene, camera = make(Case("ellipsoids").with_(gradient="analytic"))
    with pytest.raises(ss.Unsupported, match="analytic"):
        ss.Renderer("gl", effects={"paper_slicing": True}).plan(scene, camera, size=SIZE)


def test_more_lights_with_shadows_than_opengl_draws_are_drawn_by_the_processor():
    many = tuple(ss.Light((0.1 * n, 1, 1), (0.05, 0.05, 0.05)) for n in range(17))
    case = Case().with_(lights=many, shadows=True)
    image, (scene, camera) = draw(case), make(case)
    assert "17 lights with shadows" in handed_over(image)
    # Shadows come from a grid, whose error the picture states.
    effect = moved_by(case, case.with_(shadows=False))
    assert effect > 50 * FLOAT32[0]
    assert distance(image, reference(case)).rmse < effect / 5
    assert ss.Renderer("auto").plan(scene, camera, size=SIZE).backend == "cpu"
    scene, camera = make(Case().with_(lights=many[:16], shadows=True))
    assert ss.Renderer("gl").plan(scene, camera, size=SIZE).backend == "gl"


@pytest.mark.parametrize(
    ("fields_", "camera", "options", "packing"),
    [
        (("cartesian",), "orthographic", {"gradient": "analytic"}, "wide"),
        (("ellipsoids",), "perspective", {"gradient": "analytic", "sampling": "slab"}, "paper"),
        (("ellipsoids",), "orthographic", {}, "paper"),
        (("cartesian",), "perspective", {"sampling": "slab", "preintegration": True}, "wide"),
        (("cartesian", "ellipsoids"), "orthographic", {"preintegration": "second_order"}, "wide"),
        (("ellipsoids",), "orthographic", {"mode": "isosurface", "iso_value": 300.5}, "wide"),
    ],
)
def test_quotients_of_values_far_from_0_keep_their_gradients(fields_, camera, options, packing):
    """A window of width 1 around values of 300: values are taken relative to its middle."""
    parts = cloud(np.random.default_rng(3), 40, aspect=2.5)
    scattered = ss.EllipsoidField(parts["centers"], parts["scales"], parts["rotations"], parts["values"] + 300, w0=0.3)
    values = np.random.default_rng(4).random((8, 8, 8)) + 300
    lattice = ss.RegularField(values, spacing=(0.25,) * 3, origin=(-0.9,) * 3, normalization="threshold")
    made = [scattered if name == "ellipsoids" else lattice for name in fields_]
    # Opaque from the window's end on, so that sums of two fields show where both are.
    points = [(300.02, 0.1, 0.2, 0.6, 0), (300.5, 0.2, 0.6, 0.4, 0.1), (301, 1, 0.9, 0.8, 0.3)]
    scene = ss.Scene(made, points, lights=LIGHTS, material=MATERIAL, opacity_stop=1, **options)
    view = make(Case(projection=camera))[1]
    found = ss.Renderer("gl", packing=packing).render(scene, view, size=SIZE).pixels
    expected = ss.Renderer("reference").render(scene, view, size=SIZE).pixels
    moved = None
    if "iso_value" in options:
        nudged = [
            ss.Scene(
                made,
                points,
                lights=LIGHTS,
                material=MATERIAL,
                **(options | {"iso_value": options["iso_value"] + nudge}),
            )
            for nudge in (-1e-5, 1e-5)
        ]
        pictures = [ss.Renderer("reference").render(other, view, size=SIZE).pixels for other in nudged]
        moved = np.max([np.abs(picture - expected).max(2) for picture in pictures], axis=0) > 1e-3
    assert_close(found, expected, FLOAT32, f"values far from 0: {fields_}, {camera}, {options}, {packing}", moved)
    assert expected[..., 3].max() > 0.1


def test_a_gradient_opacity_below_what_float32_knows_is_drawn_by_the_processor():
    case = Case("ellipsoids").with_(gradient_opacity=1e-4, gradient="analytic")
    assert "gradient_opacity" in handed_over(check(case))
    scene, camera = make(case)
    assert ss.Renderer("gl", allow_inexact=True).plan(scene, camera, size=SIZE).backend == "gl"
