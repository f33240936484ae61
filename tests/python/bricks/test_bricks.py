"""Pictures that are drawn in bricks are the pictures of the whole."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bricks_in_memory import (
    BOUND,
    LIT,
    Bricked,
    Fields,
    camera_of,
    differences,
    field_named,
    needles,
    one_precision,
    whole_picture,
)

import sheetsplat as ss
from sheetsplat.bricks.draw import draw_brick, render_bricks
from sheetsplat.bricks.lattice import LatticeSpec
from sheetsplat.bricks.partial import Finished, Partial, finish, merge
from sheetsplat.bricks.partition import partition_lattice, partition_points
from sheetsplat.bricks.view import BrickView

# In front of the cut lie bricks that show nothing; what lies behind depends on what is in front of it.
CUT = {"clip": ss.Clip(box=((4, 4, 4), (13, 13, 13))), "cut_faces": True, "opacity_stop": 1.0}
# name of the field, brick size or number, camera, outputs, options
SCENES: dict[str, tuple[str, Any, str, tuple[str, ...], dict[str, Any]]] = {
    "lit": ("cartesian", 9, "orthographic", ("depth", "coverage"), LIT),
    "lit in perspective": ("cartesian", (7, 24, 5), "perspective", ("depth",), LIT),
    "eye inside": ("cartesian", 8, "inside", (), LIT),
    "plain": ("cartesian", 8, "perspective", (), {}),
    "analytic": ("cartesian", 9, "perspective", (), {**LIT, "gradient": "analytic"}),
    "slabs": ("cartesian", 9, "perspective", (), {**LIT, "sampling": "slab"}),
    "fine slices": ("cartesian", 11, "orthographic", (), {**LIT, "slice_spacing": 0.4, "background": (1.0, 0.9, 0.8)}),
    "intervals": ("cartesian", 9, "perspective", ("depth",), {**LIT, "preintegration": True}),
    "second order": ("cartesian", 9, "orthographic", (), {**LIT, "preintegration": "second_order"}),
    "clip": (
        "cartesian",
        9,
        "perspective",
        ("depth",),
        {**LIT, "preintegration": True, "clip": ss.Clip(planes=[((1.0, 0.5, -0.3), 9.0)])},
    ),
    "cut faces": ("cartesian", 9, "perspective", (), {**LIT, **CUT}),
    "cut faces of intervals": ("oblique", 9, "orthographic", ("depth",), {**LIT, **CUT, "preintegration": True}),
    "gradient opacity": ("cartesian", 9, "orthographic", (), {"gradient_opacity": 0.1}),
    "cue": ("cartesian", 9, "orthographic", (), {**LIT, "depth_cue": ss.DepthCue(20.0, 60.0, (1.0, 1.0, 1.0))}),
    "filter": ("cartesian", 9, "perspective", (), {**LIT, "filter": "ewa"}),
    "surface": ("cartesian", 9, "perspective", ("depth",), {**LIT, "mode": "isosurface", "iso_value": 0.4}),
    "surfaces": (
        "cartesian",
        9,
        "orthographic",
        ("depth",),
        {**LIT, "mode": "isosurface", "iso_value": [(0.2, 0.3), (0.5, 0.6), (0.8, 1.0)]},
    ),
    "xray": ("cartesian", 9, "perspective", ("coverage",), {"mode": "xray"}),
    "mip": ("cartesian", 9, "orthographic", (), {"mode": "mip"}),
    "minimum": ("cartesian", 9, "perspective", (), {"mode": "minimum"}),
    "minimum of one brick": ("cartesian", 64, "orthographic", (), {"mode": "minimum"}),
    "average": ("cartesian", 9, "orthographic", (), {"mode": "average"}),
    "uneven": ("uneven", 9, "orthographic", ("depth",), LIT),
    "uneven surface": ("uneven", 9, "perspective", (), {**LIT, "mode": "isosurface", "iso_value": 0.4}),
    "oblique": ("oblique", 9, "orthographic", ("depth", "coverage"), LIT),
    "oblique surface": ("oblique", 9, "perspective", (), {**LIT, "mode": "isosurface", "iso_value": 0.4}),
    "oblique intervals": ("oblique", 9, "perspective", ("depth",), {**LIT, "preintegration": True}),
    "oblique xray": ("oblique", 9, "orthographic", (), {"mode": "xray"}),
    "oblique mip": ("oblique", 64, "perspective", (), {"mode": "mip"}),
    "oblique filter": ("oblique", 9, "orthographic", (), {**LIT, "filter": "ewa"}),
    "prefiltered": ("prefiltered", 10, "orthographic", (), LIT),
    "long": ("long", (12, 12, 10), "perspective", (), LIT),
    "holes": ("holes", 9, "orthographic", ("coverage",), LIT),
    "threshold": ("threshold", 9, "perspective", (), LIT),
    "bcc": ("bcc", 9, "perspective", ("depth",), LIT),
    "bcc intervals": ("bcc", 8, "orthographic", (), {**LIT, "preintegration": True}),
    "bcc average": ("bcc", 9, "orthographic", (), {"mode": "average"}),
    "needles": ("needles", 7, "orthographic", (), {**LIT, "slice_spacing": 0.04}),
    "needles in perspective": ("needles", 30, "perspective", ("coverage",), {**LIT, "slice_spacing": 0.04}),
    "needles xray": ("needles", 9, "perspective", (), {"mode": "xray", "sampling": "slab", "slice_spacing": 0.04}),
    "needles mip": ("needles", 2, "orthographic", (), {"mode": "mip", "slice_spacing": 0.04}),
    "needles surface": (
        "needles",
        9,
        "perspective",
        (),
        {**LIT, "mode": "isosurface", "iso_value": 0.3, "slice_spacing": 0.04},
    ),
    "needles minimum": ("needles", 9, "orthographic", (), {"mode": "minimum", "slice_spacing": 0.04}),
}


def drawn(bricked: Bricked, view: BrickView, field_of: Any = None) -> Finished:
    """Return a picture in bricks, of fields of their own or those that a function makes."""
    return render_bricks(view, bricked.field_of(view) if field_of is None else Fields(field_of))


@pytest.mark.parametrize("name", SCENES)
def test_bricks_are_the_picture_of_one_process(name: str) -> None:
    which, brick, kind, outputs, options = SCENES[name]
    field = field_named(which)
    camera = camera_of(field, kind)
    # Bricks of their own decide by themselves which tiles need float64: here none does.
    settings = {"backend": "cpu", "allow_inexact": True}
    wanted, precision = whole_picture(field, camera, outputs, {**settings, "precision": "float32"}, **options)
    bricked = Bricked(field, brick)
    view = bricked.view(camera, outputs, {**settings, "precision": precision}, **options)
    found = drawn(bricked, view)
    seen = differences(found, wanted)
    print(name, len(view.partition), precision, seen)
    assert seen.pop("depth", 0.0) < 1e-3 * view.options["slice_spacing"]
    assert max(seen.values()) <= BOUND


MODES: tuple[dict[str, Any], ...] = (
    LIT,
    {**LIT, "preintegration": True, "opacity_stop": 1.0},
    {**LIT, "mode": "isosurface", "iso_value": [(0.3, 0.4), (0.6, 0.8)], "gradient": "analytic"},
    {"mode": "xray", "sampling": "slab"},
    {"mode": "mip"},
    {"mode": "average"},
    {"mode": "minimum"},
)


@pytest.mark.parametrize("radius", [1.5, 2.5])
def test_kernels_that_end_where_the_domain_does_are_none(radius):
    """Squares of their distances are exact: 4.5 and 12.5 layers of a BCC lattice."""
    values = np.random.default_rng(0).random((10, 9, 12))
    options = {"lattice": "bcc", "radius": radius, "falloff": 4.0}
    whole, parts = ss.RegularField(values, **options), ss.open_bricks(values, brick=8, **options)
    points = np.random.default_rng(1).uniform(-1, 12, (2000, 3))
    assert np.abs(whole.at(points) - parts.at(points)).max() < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2, 7, 64])
@pytest.mark.parametrize("which", ["cartesian", "uneven", "oblique", "bcc", "needles"])
def test_any_number_of_bricks_in_any_view(which: str, count: int) -> None:
    random = np.random.default_rng([count, len(which)])
    field = field_named(which)
    lower, upper = np.asarray(field.bounds)
    for number, options in enumerate(MODES):
        kind = ("orthographic", "perspective", "inside")[(number + count) % 3]
        direction = tuple(random.normal(size=3)) if number % 3 else (0.0, 0.0, -1.0)
        camera = camera_of(field, kind)
        if kind != "inside":
            camera = ss.Camera.fit(field, direction=direction, up=(0.1, 1.0, 0.2), kind=kind, margin=0.8)
        spacing = 0.03 if which == "needles" else float(random.uniform(0.4, 1.1))
        options = {**options, "slice_spacing": spacing}
        settings, precision = one_precision(field, camera, **options)
        wanted, _ = whole_picture(field, camera, (), settings, **options)
        cuts = {1: 64, 2: (64, 64, 15), 7: (64, 64, 4), 64: (5, 6, 7)}[count] if which != "needles" else count
        bricked = Bricked(field, cuts)
        view = bricked.view(camera, (), settings, **options)
        seen = differences(drawn(bricked, view), wanted)
        print(which, len(view.partition), kind, options.get("mode"), precision, seen)
        assert max(seen.values()) <= BOUND


@pytest.mark.parametrize("fault", ["margin", "anchor", "order"])
def test_bricks_that_miss_something_are_seen(fault: str) -> None:
    which, brick, kind, outputs, options = SCENES["lit in perspective"]
    field = field_named(which)
    camera = camera_of(field, kind)
    wanted, _ = whole_picture(field, camera, (), {"backend": "cpu"}, **options)
    bricked = Bricked(field, brick)
    view = bricked.view(camera, (), {"backend": "cpu"}, **options)
    field_of: Any = None
    if fault == "margin":
        lattice = view.lattice
        assert lattice is not None

        def field_of(number: int) -> ss.RegularField:
            # Without what gradients look at.
            box = lattice.around(view.partition.bricks[number].cell, -0.5)
            values = np.ascontiguousarray(bricked.field.values[tuple(slice(*ends) for ends in lattice.to_read(box))])
            return lattice.field(values, box, bricked.whole.value_range)

    elif fault == "anchor":
        (x, y, z), upper = view.whole.centres
        view = view.replace(whole=replace(view.whole, centres=((x, y, z + 0.5), upper)))
    else:
        tree: Any = view.partition.tree
        view = view.replace(partition=replace(view.partition, tree=replace(tree, below=tree.above, above=tree.below)))
    off = max(differences(drawn(bricked, view, field_of), wanted).values())
    print(fault, off)
    assert off > 10 * BOUND


def parts_alone(name: str, **changes: Any) -> tuple[BrickView, dict[int, Partial], Finished]:
    """Return a scene's view, its bricks drawn alone, and the picture of one process."""
    which, brick, kind, outputs, options = SCENES[name]
    options = {**options, **changes}
    field = field_named(which)
    camera = camera_of(field, kind)
    settings = {"backend": "cpu"}
    bricked = Bricked(field, brick)
    view = bricked.view(camera, outputs, settings, **options)
    field_of = bricked.field_of(view)
    parts = {number: draw_brick(view, number, field_of(number)) for number in view.order()}
    return view, parts, whole_picture(field, camera, outputs, settings, **options)[0]


def merged(nested: Any, parts: dict[int, Partial]) -> Partial:
    """Return parts merged in pairs of pairs."""
    return parts[nested] if isinstance(nested, int) else merge(None, merged(nested[0], parts), merged(nested[1], parts))


@pytest.mark.parametrize("name", ["lit in perspective", "surfaces", "xray", "mip", "minimum", "average"])
def test_parts_that_are_drawn_alone_merge_in_any_tree(name: str) -> None:
    view, parts, wanted = parts_alone(name, **({} if "lit" not in name else {"opacity_stop": 1.0}))
    tree = merged(view.nested(), parts)
    random = np.random.default_rng(8)
    row = [parts[number] for number in view.order()]
    while len(row) > 1:
        at = int(random.integers(len(row) - 1))
        row[at : at + 2] = [merge(None, row[at], row[at + 1])]
    first, second = finish(view, tree), finish(view, row[0])
    one = first.scalar if wanted.scalar is not None else first.rgba
    other = second.scalar if wanted.scalar is not None else second.rgba
    assert one is not None and other is not None
    assert (np.isnan(one) == np.isnan(other)).all()
    one, other = np.nan_to_num(one), np.nan_to_num(other)
    assert float(np.abs(one - other).max()) <= 1e-6 * max(1.0, float(np.abs(one).max()))
    assert float(np.sqrt(np.mean((one.astype(float) - other) ** 2))) <= 1e-7
    # Depths do not follow from parts that were drawn alone.
    seen = differences(first, replace(wanted, depth=None))
    print(name, seen)
    assert max(seen.values()) <= BOUND


def test_hidden_and_unseen_bricks_are_not_asked_for() -> None:
    field = field_named("cartesian")
    bricked = Bricked(field, 7)
    camera = camera_of(field, "orthographic")
    opaque = {"mode": "isosurface", "iso_value": 0.1}
    view = bricked.view(camera, (), {"backend": "cpu"}, **opaque)
    drawn(bricked, view)
    assert len(set(bricked.asked)) == len(bricked.asked) < len(view.partition)
    away = ss.Camera.orthographic((200, 0, 100), (200, 0, 0), height=20.0)
    bricked.asked.clear()
    view = bricked.view(away, (), {"backend": "cpu"}, **opaque)
    assert not drawn(bricked, view).rgba.any()
    assert bricked.asked == []


@pytest.mark.parametrize("kind", ["orthographic", "perspective", "inside"])
def test_outlines_hold_all_that_bricks_change(kind: str) -> None:
    field = field_named("cartesian")
    bricked = Bricked(field, 11)
    view = bricked.view(camera_of(field, kind), ("coverage",), {"backend": "cpu"}, mode="xray")
    field_of = bricked.field_of(view)
    left = 0
    for number in view.order():
        part, outline = draw_brick(view, number, field_of(number)), view.outline(number)
        assert part.coverage is not None
        assert part.coverage.shape == outline.shape or not outline.size
        assert not part.coverage[~outline].any()
        left += int((~outline).sum())
    assert left > 0


def test_a_range_of_values_says_what_may_show() -> None:
    field = field_named("cartesian")
    bricked = Bricked(field, 9)
    camera = camera_of(field, "orthographic")

    def may(value_range: tuple[float, float], outputs: tuple[str, ...] = (), **options: Any) -> bool:
        return bricked.view(camera, outputs, **options).may_show(value_range)

    assert not may((0.0, 0.0)) and may((0.0, 0.01)) and may((0.0, 0.0), ("coverage",))
    surface = {"mode": "isosurface", "iso_value": 0.5}
    assert may((0.0, 0.6), **surface) and not may((0.0, 0.4), **surface)
    assert may((0.1, 0.2), mode="xray") and not may((0.0, 0.0), mode="xray")
    assert may((-1.0, 0.0), mode="mip") and may((0.0, 0.0), mode="minimum")


def test_cells_fill_space_and_follow_one_another() -> None:
    random = np.random.default_rng(2)
    lattice = LatticeSpec((21, 9, 30), spacing=(1.0, 0.5, 2.0))
    partition = partition_lattice(lattice, (8, 9, 7))
    assert len(partition) == 3 * 5
    samples = np.zeros(lattice.shape, int)
    for brick in partition.bricks:
        assert brick.samples is not None
        samples[tuple(slice(*ends) for ends in brick.samples)] += 1
    assert (samples == 1).all()
    points = random.uniform(-20, 80, (500, 3))
    # Some lie on faces.
    points[:200, 0] = [brick.cell[0][0] if np.isfinite(brick.cell[0][0]) else 1.0 for brick in partition.bricks][3]
    cells = np.asarray([brick.cell for brick in partition.bricks])[:, :, None]
    inside = ((points >= cells[:, 0]) & (points < cells[:, 1])).all(axis=2)
    assert (inside.sum(axis=0) == 1).all()
    assert (inside.argmax(axis=0) == partition.brick_of(points)).all()
    for kind in ("orthographic", "perspective"):
        for _ in range(20):
            eye, target = random.uniform(-5, 60, 3), random.uniform(-5, 60, 3)
            maker = getattr(ss.Camera, kind)
            camera = maker(tuple(eye), tuple(target), **({"height": 9.0} if kind == "orthographic" else {"fov_y": 50}))
            place = {number: at for at, number in enumerate(partition.order(camera))}
            direction = random.uniform(-1, 1, 3) if kind == "perspective" else target - eye
            start = eye if kind == "perspective" else random.uniform(-5, 60, 3)
            way = start + np.linspace(0 if kind == "perspective" else -50, 50, 400)[:, None] * direction
            met = [place[number] for number in partition.brick_of(way).tolist()]
            assert met == sorted(met)


def test_points_are_divided_evenly() -> None:
    points = np.random.default_rng(4).normal(size=(1000, 3))
    counts = np.bincount(partition_points(points, 13).brick_of(points))
    assert len(counts) == 13 and counts.min() > 60 and counts.max() < 95
    # Points in one place cannot be divided.
    assert len(partition_points(np.ones((10, 3)), 4)) == 1


def test_what_a_brick_does_not_have_is_refused() -> None:
    bricked = Bricked(field_named("cartesian"), 9)
    camera = camera_of(bricked.field, "orthographic")
    for goal in ("max_error", "max_seconds"):
        with pytest.raises(ss.Unsupported, match=goal):
            bricked.view(camera, settings={goal: 0.01})
    with pytest.raises(ss.InvalidInput, match="brick=0"):
        partition_lattice(LatticeSpec((4, 4, 4)), 0)


def test_views_can_be_pickled() -> None:
    view = Bricked(field_named("bcc"), 9).view(camera_of(field_named("bcc"), "perspective"), **LIT)
    again = pickle.loads(pickle.dumps(view))
    assert again.order() == view.order() and again.footprint(3) == view.footprint(3)
    assert again.samples(2) == view.samples(2)


@pytest.mark.parametrize("backend", ["reference", "gl"])
@pytest.mark.parametrize("name", ["lit in perspective", "surfaces", "intervals", "average", "minimum"])
def test_other_backends_draw_bricks(backend: str, name: str) -> None:
    which, _, kind, outputs, options = SCENES[name]
    field = field_named(which)
    camera = camera_of(field, kind)
    settings = {"backend": backend}
    try:
        wanted, precision = whole_picture(field, camera, outputs, settings, **options)
    except ss.DeviceUnavailable as error:
        pytest.skip(str(error))
    bricked = Bricked(field, 15)
    view = bricked.view(camera, outputs, {**settings, "precision": precision}, **options)
    found = drawn(bricked, view)
    seen = differences(found, wanted)
    print(backend, name, len(view.partition), seen)
    assert seen.pop("depth", 0.0) < 1e-3 * view.options["slice_spacing"]
    assert max(seen.values()) <= BOUND


def test_parts_of_scattered_kernels() -> None:
    field = needles()
    part = field.part(np.arange(field.size) < 5)
    assert part.size == 5 and part.value_range == field.value_range
    assert (np.asarray(part.centers) == np.asarray(field.centers)[:5]).all()
    assert field.part(np.zeros(field.size, bool)).size == 0
    weighted = ss.EllipsoidField([(0, 0, 0), (1, 0, 0)], [1.0, 1.0], values=[1.0, 2.0], weights=[0.0, 1.0])
    assert weighted.part(np.array([0])).at([(0.0, 0.0, 0.0)])[0] < 1e-20
