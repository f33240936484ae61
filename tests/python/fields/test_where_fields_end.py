"""Where volumes end and what values are counted from: what must leave a picture as it is, on every backend."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scene_parts
from image_checks import FLOAT32, FLOAT32_HARD, distance, handed_over
from scene_parts import OPAQUE, Parts, cloud, lift, negate, unit
from test_groups import cases
from test_oracle import build_effects

import sheetsplat as ss

SIZE = (16, 14)
FEW_BY = ("reference", "gl")
SCALAR = ("xray", "mip", "minimum", "average")
# Multiples of these numbers and their sums lose nothing.
STEP = 1 / 1024


@pytest.fixture
def renderer(backend: str, request: pytest.FixtureRequest) -> ss.Renderer:
    """Return the renderer that a test's parameter names."""
    return request.getfixturevalue(f"{backend}_renderer")  # type: ignore[no-any-return]


def noise(seed: int, shape: tuple[int, ...]) -> np.ndarray:
    """Return random multiples of a step, from 0 to 1."""
    return np.round(np.random.default_rng(seed).random(shape) / STEP) * STEP


def drawn(renderer: ss.Renderer, parts: Parts, outputs: Any = ()) -> ss.Image:
    scene, camera, size = build_effects(ss, parts)
    return renderer.render(scene, camera, size=size, outputs=outputs)


def apart(one: np.ndarray, other: np.ndarray, scale: float = 1.0) -> float:
    """Return the largest difference of two pictures; infinite where a number stands in one of them alone."""
    if not np.array_equal(np.isnan(one), np.isnan(other)):
        return np.inf
    return float(np.nanmax(np.abs(one.astype(float) - other), initial=0.0)) / scale


# A volume cut in two

# Samples along the axis of the cut, and the last one in front of it.
ALONG, LAST = 11, 5
ACROSS = 7
WAYS: dict[str, dict[str, Any]] = {
    "composite": {},
    "stopped": {"transfer": OPAQUE, "opacity_stop": 0.7},
    "intervals": {"preintegration": True},
    "second order": {"preintegration": "second_order"},
    "slab": {"sampling": "slab"},
    "analytic": {"gradient": "analytic", "gradient_opacity": 1.0},
    "isosurface": {"mode": "isosurface", "iso_value": [(0.4, 0.6), (0.6, 1.0)]},
    **{mode: {"mode": mode} for mode in SCALAR},
}
# Pixels and slices are closer than half a sample: farther beyond its end a volume is not the mirror's.
VIEWS = {"parallel": scene_parts.parallel(height=1.4), "central": scene_parts.central(fov_y=17.0)}


def lattice(values: np.ndarray, first: int, **options: Any) -> Parts:
    """Return the arguments of a lattice in the cube of edge 2 round 0; first: the place of its first sample."""
    spacing = (2 / (ALONG - 1), 2 / (ACROSS - 1), 2 / (ACROSS - 1))
    origin = (-1 + first * spacing[0], -1.0, -1.0)
    return {"values": values, "spacing": spacing, "origin": origin, **options}


def scene(fields: list[Parts], way: str, view: str, *planes: Any) -> Parts:
    """Return the parts of a scene whose slices go on from one half of the cube to the other."""
    camera = VIEWS[view]
    back = -unit(np.subtract(camera["target"], camera["eye"]))
    # The middle of the first half is this far from the middle of the whole, along the view.
    between = abs(back[0]) * (ALONG - 1 - LAST) / (ALONG - 1)
    more = {"slice_spacing": between / 5, "reference_length": 0.1, "size": SIZE} | WAYS[way]
    # At the other ends, gradients of the halves look to where fewer mirrored samples reach.
    more["clip"] = {"planes": planes, "box": ((-9.0, -0.7, -0.7), (9.0, 0.7, 0.7))}
    return scene_parts.parts(fields, camera, lit=WAYS[way].get("mode") not in SCALAR, **more)


def plane(sample: float, side: float) -> Any:
    """Return the plane that keeps what lies on one side (-1, 1) of a place along the axis."""
    return (side, 0.0, 0.0), side * (-1 + sample * 2 / (ALONG - 1))


@pytest.mark.parametrize(("way", "view", "backend"), cases(list(WAYS), list(VIEWS), few_by=FEW_BY))
def test_a_volume_that_is_its_own_mirror_image_may_be_cut_or_clipped(
    way: str, view: str, renderer: ss.Renderer
) -> None:
    """Half a sample distance beyond the mirror: what lies there is what a volume that ends has there."""
    half = noise(1, (ACROSS, ACROSS, LAST + 1))
    whole = np.concatenate([half, half[..., -2::-1]], axis=-1)
    outputs: Any = ("coverage",) if way in SCALAR else ("coverage", "depth")
    clipped = drawn(renderer, scene([lattice(whole, 0)], way, view, plane(LAST + 0.5, -1)), outputs)
    cut = drawn(renderer, scene([lattice(half, 0)], way, view), outputs)
    for name in ("pixels", *outputs):
        one, other = getattr(cut, name), getattr(clipped, name)
        assert distance(np.where(np.isinf(one), -1, one), np.where(np.isinf(other), -1, other)).within(FLOAT32), name
    # Half a sample farther to either side it is another picture, as it is where the half falls to 0.
    for sample in (LAST, LAST + 1):
        other = drawn(renderer, scene([lattice(whole, 0)], way, view, plane(sample, -1)))
        assert not distance(other.pixels, cut.pixels).within(FLOAT32_HARD)
    zero = drawn(renderer, scene([lattice(half, 0, boundary="zero")], way, view))
    assert not distance(zero.pixels, cut.pixels).within(FLOAT32_HARD)


@pytest.mark.parametrize(("way", "side", "backend"), cases(list(WAYS), [-1, 1], few_by=FEW_BY))
def test_halves_are_the_whole_where_no_mirrored_sample_reaches(way: str, side: int, renderer: ss.Renderer) -> None:
    """Of any samples: a kernel's radius from the first one that is mirrored, and as far as gradients look beyond."""
    whole = noise(2, (ACROSS, ACROSS, ALONG))
    half = lattice(whole[..., : LAST + 1], 0, base=0.5) if side < 0 else lattice(whole[..., LAST:], LAST, base=0.5)
    away = plane(LAST + side * 1.6, side)
    expected = drawn(renderer, scene([lattice(whole, 0, base=0.5)], way, "parallel", away)).pixels
    found = drawn(renderer, scene([half], way, "parallel", away)).pixels
    assert distance(found, expected).within(FLOAT32)
    near = plane(LAST, side)
    expected = drawn(renderer, scene([lattice(whole, 0, base=0.5)], way, "parallel", near)).pixels
    found = drawn(renderer, scene([half], way, "parallel", near)).pixels
    assert not distance(found, expected).within(FLOAT32_HARD)


# (Intervals of two groups across the plane that parts them belong to both. Surfaces are open there: rays run along it.)
PARTED = ("composite", "stopped", "analytic", "isosurface")


@pytest.mark.parametrize(("way", "view", "backend"), cases((*PARTED, *SCALAR), list(VIEWS), few_by=FEW_BY))
def test_two_halves_are_the_whole(way: str, view: str, renderer: ss.Renderer) -> None:
    """Of samples that repeat every other layer, which are mirror images in each layer's plane: no gap, no overlap."""
    whole = noise(3, (ACROSS, ACROSS, 2))[..., np.arange(ALONG) % 2]
    parts = scene([lattice(whole, 0, base=0.5)], way, view)
    if way == "isosurface":
        parts["camera"] = scene_parts.parallel((0.0, -0.3, -1.0), 1.4, up=(0, 1, 0))
    halves = [lattice(whole[..., : LAST + 1], 0, base=0.5), lattice(whole[..., LAST + 1 :], LAST + 1, base=0.5)]
    both = parts | {"fields": halves, "groups": [[0], [1]], "transfer": [parts["transfer"]] * 2}
    expected = drawn(renderer, parts)
    assert distance(drawn(renderer, both).pixels, expected.pixels).within(FLOAT32)
    shifted = [halves[0], lattice(whole[..., LAST + 1 :], LAST + 1.2, base=0.5)]
    assert not distance(drawn(renderer, both | {"fields": shifted}).pixels, expected.pixels).within(FLOAT32_HARD)


@pytest.mark.parametrize("second", ["nothing", "lattice"])
def test_intervals_that_the_near_plane_opens_know_where_groups_end(
    second: str, cpu_renderer: ss.Renderer, reference_renderer: ss.Renderer
) -> None:
    """Inside of a volume, beside another group: its first interval shows only what the second end shows."""
    fields = [lattice(noise(10, (4, 4, 4)), 3, base=0.0), cloud(np.random.default_rng(11), 8, 4.0, 2.0, w0=0.3)]
    if second == "lattice":
        fields[1] = lattice(noise(11, (7, 7, 9)), 2)
    camera = {"eye": (-0.1, -0.5, -1.1), "target": (0.1, -0.6, -1.4), "up": (0, 1, 0), "fov_y": 100.0, "near": 0.02}
    looks: dict[str, Any] = {"preintegration": True, "slice_spacing": 0.25, "reference_length": 0.1}
    parts = scene_parts.parts(fields, camera, lit=False, size=SIZE, **looks)
    parts |= {"groups": [[0], [1]], "transfer": [OPAQUE, [(*point[:4], 0.0) for point in OPAQUE]]}
    expected = drawn(reference_renderer, parts).pixels
    assert expected[..., 3].max() > 0.3
    assert distance(drawn(cpu_renderer, parts).pixels, expected).within(FLOAT32)


@pytest.mark.gl
def test_what_opengl_cannot_draw_is_drawn_by_the_processor(
    gl_renderer: ss.Renderer, reference_renderer: ss.Renderer
) -> None:
    """Forced ways are refused, with each advice once."""
    values = noise(9, (4, 4, 4))
    holes = values.copy()
    holes[1:3, 1:3, 1:3] = np.nan
    parts = scene_parts.parts([lattice(holes, 0, nan="skip"), lattice(values, 0)], lit=False, size=(6, 5))
    image, expected = (drawn(one, parts, ("coverage",)) for one in (gl_renderer, reference_renderer))
    assert "coverage of fields that add up" in handed_over(image)
    assert distance(image, expected).within(FLOAT32) and distance(image.coverage, expected.coverage).within(FLOAT32)
    with pytest.raises(ss.Unsupported, match="coverage of fields that add up") as refusal:
        drawn(ss.Renderer("gl", precision="float32"), parts, ("coverage",))
    assert refusal.value.advice.count("backend=") == 1 and "which draws it" in refusal.value.advice


# Values counted from a base

OFFSETS = (7.0, -300.0, 5000.0)
FUNCTION = [(STEP * n, *color) for n, *color in ((32, 0.1, 0.2, 0.6, 0.0), (300, 0.2, 0.6, 0.4, 0.05),
            (640, 0.9, 0.6, 0.2, 0.2), (1024, 1.0, 1.0, 0.9, 0.4))]  # fmt: skip
SEEN = [(-2.0, 0.3, 0.2, 0.6, 0.1), *FUNCTION[1:]]
COUNTED: dict[str, dict[str, Any]] = WAYS | {
    "seen": {"transfer": SEEN},
    "seen intervals": {"transfer": SEEN, "preintegration": True},
    "isosurface": {"mode": "isosurface", "iso_value": [(400 * STEP + STEP / 3, 0.6), (650 * STEP + STEP / 3, 1.0)]},
    "ewa": {"filter": "ewa"},
    "stopped": {"opacity_stop": 0.7},
    "clip": {"clip": {"planes": [((1.0, 0.3, 0.2), -0.2)]}},
    "shadows": {"shadows": True},
    "groups": {},
}
KINDS: dict[str, dict[str, Any]] = {
    "edge": {},
    "base": {"base": 0.25},
    "zero": {"boundary": "zero"},
    "threshold": {"normalization": "threshold", "w0": 0.5},
    "none": {"normalization": "none"},
    "bcc": {"lattice": "bcc", "spacing": (0.5, 0.5, 0.5)},
    "holes": {"nan": "skip"},
    "ellipsoids": {},
}


def counted_scene(kind: str, way: str) -> Parts:
    """Return the parts of a small scene whose numbers are multiples of a step."""
    values = noise(4, (5, 6, 5))
    if kind == "holes":
        values[1:3, 2:5, 2:4] = np.nan
    elif kind == "none":
        # Sums of about as much.
        values /= 4
    field: Parts = {"values": values, "spacing": (0.45, 0.4, 0.5), "origin": (-0.9, -1.0, -1.0)} | KINDS[kind]
    scattered = cloud(np.random.default_rng(5), 20, 5.0, 2.0, w0=0.3) | {"values": noise(6, (20,))}
    fields = [scattered if kind == "ellipsoids" else field]
    options: dict[str, Any] = {"transfer": FUNCTION, "slice_spacing": 0.17, "size": (14, 12)} | COUNTED[way]
    parts = scene_parts.parts(fields, lit=options.get("mode") not in SCALAR, **options)
    if way == "groups":
        second = {"values": noise(7, (5, 6, 5)), **{name: field[name] for name in ("spacing", "origin")}}
        second |= {"boundary": "zero"} if kind in ("zero", "ellipsoids") else {}
        parts |= {"fields": [*fields, second], "groups": [[0], [1]], "transfer": [FUNCTION, FUNCTION[:2] + SEEN[2:]]}
    return parts


def drawn_twice(parts: Parts, other: Parts, renderer: ss.Renderer) -> tuple[np.ndarray, np.ndarray]:
    """Return both pictures. What OpenGL hands over it must hand over both times."""
    first, second = drawn(renderer, parts), drawn(renderer, other)
    assert bool(handed_over(first)) == bool(handed_over(second))
    return first.pixels, second.pixels


@pytest.mark.parametrize(("way", "kind", "backend"), cases(list(COUNTED), list(KINDS), few_by=FEW_BY))
def test_a_constant_changes_nothing(way: str, kind: str, renderer: ss.Renderer) -> None:
    """Added to values, bases, transfer functions and iso values; a scalar picture rises by it."""
    plain = counted_scene(kind, way)
    by = OFFSETS[(list(KINDS).index(kind) + list(COUNTED).index(way)) % len(OFFSETS)]
    lifted = counted_scene(kind, way)
    lift(lifted, by)
    one, other = drawn_twice(plain, lifted, renderer)
    scale = 1.0
    if way in SCALAR:
        rise = np.full_like(one, by)
        if way == "xray":
            # A field that is 1 everywhere, its base included, has the length of each ray that counts.
            length = counted_scene(kind, way)
            length["fields"][0] |= {"base": 1.0, "values": 0 * length["fields"][0]["values"] + 1.0}
            rise = by * drawn(renderer, length).pixels
        other = other.astype(float) - rise
        scale = max(1.0, abs(by), float(np.nanmax(np.abs(rise))))
    assert np.nanmax(one) > 0.01 or way == "minimum"
    assert apart(one, other, scale) <= 1e-6
    if way == "composite" and "base" in lifted["fields"][0]:
        lifted["fields"][0]["base"] -= by / 100
        assert not distance(drawn(renderer, lifted).pixels, one).within(FLOAT32_HARD)


@pytest.mark.parametrize(("way", "kind", "backend"), cases(list(COUNTED), list(KINDS), few_by=FEW_BY))
def test_the_sign_of_everything_changes_nothing(way: str, kind: str, renderer: ss.Renderer) -> None:
    """Where normals of both sides are lit; scalars have the other sign, and the largest is the least."""
    plain, negated = counted_scene(kind, way), counted_scene(kind, way)
    negate(negated)
    one, other = drawn_twice(plain, negated, renderer)
    assert apart(one, -other if way in SCALAR else other) <= 1e-6


# What data of 0 at their ends give, with and without mirrored samples

PAPERS = ("composite", "stopped", "intervals", "slab", "analytic", "isosurface", "xray")


def row_of(image: ss.Image) -> ss.Effect:
    """Return what a plan says of the boundary."""
    return next(effect for effect in image.plan.effects if effect.name == "boundary")


@pytest.mark.parametrize("zeros", [5, 17])
@pytest.mark.parametrize(("way", "kind", "backend"), cases(PAPERS, ["cartesian", "bcc"], few_by=FEW_BY))
def test_data_of_0_at_their_ends_are_drawn_as_in_the_papers(
    way: str, kind: str, zeros: int, renderer: ss.Renderer
) -> None:
    """Their fields fall to 0 by themselves: to the bit where the plan says so, and by the reference."""
    step = np.array([0.2, 0.2, 0.2] if kind == "cartesian" else [0.3, 0.3, 0.15])
    field: Parts = {"values": np.pad(noise(8, (6, 6, 6)), zeros), "lattice": kind, "spacing": (step[0],) * 3}
    field["origin"] = tuple((-step * (zeros + 2.5)).tolist())
    images = [
        drawn(renderer, scene_parts.parts([field | {"boundary": boundary}], size=SIZE, **WAYS[way]))
        for boundary in ("edge", "zero")
    ]
    mirrored, zero = (row_of(image) for image in images)
    assert np.abs(images[0].pixels).max() > 0.1
    # (Kernels within so many layers of the ends are looked at; what is not drawn otherwise has no other rounding.)
    assert mirrored.on == (zeros < 8)
    if not mirrored.on:
        assert mirrored.reason == "nothing shows at the volumes' boundary: what lies beyond makes no difference"
    rounding = {"reference": 0, "cpu": 1e-7, "gl": 2e-6}[images[0].plan.backend] if mirrored.on else 0
    assert apart(images[0].pixels, images[1].pixels) <= rounding
    assert not zero.on and "fall to their bases" in zero.reason


@pytest.mark.parametrize(("way", "backend"), cases(PAPERS, few_by=FEW_BY))
def test_data_that_are_not_0_at_their_ends_are_mirrored(way: str, renderer: ss.Renderer) -> None:
    field = {"values": 0.25 + noise(8, (6, 6, 6)), "spacing": (0.3, 0.3, 0.3), "origin": (-0.75, -0.75, -0.75)}
    mirrored, zero = (
        drawn(renderer, scene_parts.parts([field | {"boundary": boundary}], size=SIZE, **WAYS[way]))
        for boundary in ("edge", "zero")
    )
    row = row_of(mirrored)
    assert row.on
    counts = "the mode counts or sums what lies inside the volume"
    assert row.reason == (counts if way == "xray" else "something shows at the volume's boundary")
    assert not distance(mirrored.pixels, zero.pixels).within(FLOAT32_HARD)
