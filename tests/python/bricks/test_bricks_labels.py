"""Labels in bricks: the pictures of the whole, and what they show at a pixel; bad input, and what to do instead."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from labelled_volumes import COLORS, LIGHT, OPAQUE, things, view

import sheetsplat as ss
from sheetsplat.viewer.coarse import coarse_fields

SIZE = (44, 36)
# Sums of float32 in another order: root mean square, and at a pixel whose normal turns by them.
BOUND, LARGEST = 3e-6, 3e-4
LIT = {"lights": [LIGHT]}
WAYS = {
    "plain": {},
    "lit": LIT,
    "alone": {**LIT, "opacity_stop": 1.0},
    "surfaces": {"mode": "isosurface"},
    "opaque surfaces": {"mode": "isosurface", **LIT, "transfer_function": OPAQUE},
    "intervals": {"preintegration": True, **LIT},
    "slabs": {"sampling": "slab", **LIT},
    "analytic": {"gradient": "analytic", **LIT},
    "shadows": {"shadows": True, **LIT},
    "occlusion": {"ambient_occlusion": ss.AmbientOcclusion(3.0), **LIT},
    "shadows of surfaces": {"shadows": True, "mode": "isosurface", **LIT},
    # What is open around a surface has steps of 1/256; at other distances rounding decides between two at a pixel.
    "occlusion of surfaces": {"ambient_occlusion": True, "mode": "isosurface", "slice_spacing": 0.41, **LIT},
    "clipped": {"clip": ss.Clip(planes=[((1, 1, 0), 12.0)]), "cut_faces": True, **LIT},
    "depth": {"outputs": ("depth", "coverage"), "transfer_function": OPAQUE},
    "planes": {"slice_planes": "orthogonal", "background": "white"},
}
LATTICES = {
    "cartesian": {},
    "zero": {"boundary": "zero"},
    "bcc": {"lattice": "bcc"},
    "oblique": {"axes": [(0.8, 0.6, 0), (-0.6, 0.8, 0), (0.1, 0, 1.3)]},
    "uneven": {"spacing": (1.0, 1.5, 0.7), "origin": (1, 2, 3)},
}


def pair(brick=6, **options):
    """Return labels in memory, and in bricks."""
    return ss.RegularField(things(), labels=True, **options), ss.open_bricks(
        things(), labels=True, brick=brick, **options
    )


def pictures(fields, **options):
    common = {"transfer_function": COLORS, "camera": view(fov_y=30), "size": SIZE, "slice_spacing": 0.43}
    return [ss.render(one, **{**common, "shading": False, **options}) for one in fields]


def check(found, expected):
    apart = np.abs(found.rgba.astype(float) - expected.rgba)
    rmse = np.sqrt(np.mean(apart**2))
    print(f"RMSE {rmse:.2g}, P99.9 {np.percentile(apart, 99.9):.2g}, maximum {apart.max():.2g}")
    assert rmse < BOUND and apart.max() < LARGEST


@pytest.mark.parametrize("backend", ["cpu", "gl"])
@pytest.mark.parametrize("way", WAYS)
def test_pictures_are_those_of_the_whole(way, backend):
    whole, bricked = pictures(pair(), backend=backend, **WAYS[way])
    assert bricked.stats["bricks"] == 27 and whole.rgba[..., 3].mean() > 0.05
    check(bricked, whole)
    if "outputs" in WAYS[way]:
        np.testing.assert_array_equal(np.isfinite(bricked.depth), np.isfinite(whole.depth))
        known = np.isfinite(whole.depth)
        assert known.any() and np.abs(bricked.depth[known] - whole.depth[known]).max() < 1e-4
        np.testing.assert_allclose(bricked.coverage, whole.coverage, rtol=1e-4, atol=1e-4)
    # As values they are far off.
    if way == "plain":
        (values,) = pictures([ss.open_bricks(things(), labels=False, brick=6)], backend=backend)
        assert np.abs(values.rgba - whole.rgba).max() > 0.1


@pytest.mark.parametrize("brick", [4, 64])
@pytest.mark.parametrize("lattice", LATTICES)
def test_lattices_and_ends(lattice, brick):
    whole, bricked = pair(brick, **LATTICES[lattice])
    camera = ss.Camera.fit(whole, direction=(1, 0.6, 0.4), up=(0, 0, 1))
    whole, bricked = pictures((whole, bricked), backend="cpu", camera=camera, **LIT)
    assert whole.rgba[..., 3].mean() > 0.05
    check(bricked, whole)


def test_bricks_without_a_label_that_shows_are_not_drawn():
    field = ss.open_bricks(things(), labels=True, brick=4)
    assert field.labels_found == (0, 1, 2, 3)
    box = ss.LabelColors({2: "lime"})
    whole, found = pictures([ss.RegularField(things(), labels=True), field], transfer_function=box)
    assert 0 < found.stats["bricks_drawn"] < 0.4 * found.stats["bricks"]
    check(found, whole)
    with pytest.warns(ss.PictureWarning, match="nothing can be seen"):
        (nothing,) = pictures([field], transfer_function=ss.LabelColors({7: "red"}))
    assert not nothing.rgba.any() and nothing.stats["bricks_drawn"] == 0


@pytest.mark.parametrize("mode", ["composite", "isosurface"])
def test_picks_and_errors_are_those_of_the_whole(mode):
    whole, bricked = pictures(pair(), mode=mode, transfer_function=OPAQUE, backend="cpu")
    seen = set()
    for x in range(2, SIZE[0], 5):
        for y in range(2, SIZE[1], 5):
            one, other = whole.pick(x, y), bricked.pick(x, y)
            assert (one is None) == (other is None)
            if one is not None:
                assert (one.label, one.name, one.kernel) == (other.label, other.name, other.kernel)
                assert one.position == pytest.approx(other.position, abs=1e-5)
                assert one.gradient == pytest.approx(other.gradient, abs=1e-6)
                seen.add(one.label)
    assert seen == {1, 2, 3}
    assert bricked.error.rmse == pytest.approx(whole.error.rmse, rel=0.02)


def test_fields_of_labels_in_bricks():
    whole, bricked = pair()
    points = np.random.default_rng(4).uniform(-2, 16, (60, 3))
    for label in (0, 2, 3):
        known, found = (one.field_of_label(label) for one in (whole, bricked))
        np.testing.assert_allclose(found.at(points), known.at(points), atol=1e-12)
        assert found.value_range == (0, 1) and not found.labels
    named = bricked.with_label_colors(COLORS)
    assert named.label_colors == COLORS and pickle.loads(pickle.dumps(named)) == named != bricked
    assert not bricked.replace(labels=False).labels and bricked.replace(radius=2.5, falloff=7.0).labels
    # A viewer shows some of the samples, which are labels still.
    (coarse,) = coarse_fields([ss.open_bricks(np.repeat(things(), 9, axis=0), labels=True, brick=32)])
    assert coarse.labels and set(np.unique(coarse.values)) <= {0, 1, 2, 3}


def with_hole():
    values = things().astype(np.float32)
    values[3, 4, 5] = np.nan
    return values


BAD = {
    "halves": (
        lambda: ss.open_bricks(things() + 0.5, labels=True),
        "not whole; wanted whole numbers; pass labels=False",
    ),
    "missing": (
        lambda: ss.open_bricks(with_hole(), labels=True, nan="skip"),
        "1 of 3315 samples are NaN.*sheetsplat.open",
    ),
    "levels": (lambda: ss.open_bricks(things(), labels=True, brick=8, levels=1), "levels.*neither means.*leave it out"),
    "log": (lambda: ss.open_bricks(things(), labels=True, log=1.0), "log.*neither means nor logarithms"),
    "prefilter": (lambda: ss.open_bricks(things(), labels=True, prefilter=True), "prefilter"),
    "base": (lambda: ss.open_bricks(things(), labels=True, base=3.0), "base"),
    "no truth": (lambda: ss.open_bricks(things(), labels=3), "labels"),
    "mode": (lambda: ss.render(ss.open_bricks(things(), labels=True), mode="mip", size=8), "labels with mode"),
    "thousands": (
        lambda: ss.render(ss.open_bricks(np.arange(1000).reshape(10, 10, 10), labels=True), size=8),
        "1000 labels; wanted at most 256",
    ),
    "kernels": (
        lambda: ss.open_bricks({**dict.fromkeys(("x", "y", "z", "value"), [1.0]), "radius": [1.0]}, labels=True),
        "labels",
    ),
    "two fields": (
        lambda: ss.render([ss.open_bricks(things(), labels=True), ss.RegularField(things())], size=8),
        "found 2 fields; wanted one field; open them with sheetsplat.open where they fit",
    ),
}


@pytest.mark.parametrize("kind", BAD)
def test_what_cannot_be_drawn_says_what_to_do(kind):
    make, words = BAD[kind]
    with pytest.raises(ss.Error, match=words):
        make()


def test_goals_and_weights_say_what_to_do_instead():
    field = ss.open_bricks(things().astype(np.float32), brick=8, labels=False)
    for goal in ("max_error", "max_seconds"):
        with pytest.raises(ss.Unsupported, match=f'found {goal}; wanted a quality.*; pass quality="best"; image.error'):
            ss.render(field, size=8, **{goal: 0.1})
    with pytest.raises(ss.Unsupported, match="weighted means of a volume in bricks.*divide the x-ray of products by"):
        ss.render(field, mode="average", weight=things(), size=8)
    with pytest.raises(ss.Unsupported, match="weighted means of a volume in bricks"):
        field.weighted_by(field)
    assert field.weighted_by(None) is field


@pytest.mark.slow
def test_a_cluster_draws_the_picture_of_one_process(cluster):
    options = {"labels": True, "brick": 6}
    fields = ss.open_bricks(things(), **options), ss.open_bricks(things(), client=cluster, **options)
    common = {
        **LIT,
        "ambient_occlusion": True,
        "slice_planes": ss.SlicePlane((1, 2, 3)),
        "size": SIZE,
        "backend": "cpu",
    }
    here, there = (
        ss.render(one, **common, **more) for one, more in zip(fields, ({}, {"client": cluster}), strict=True)
    )
    np.testing.assert_array_equal(there.rgba, here.rgba)
    assert there.pick(20, 18) == here.pick(20, 18)
    film = ss.turntable(fields[1], frames=2, client=cluster, size=SIZE, backend="cpu")
    np.testing.assert_array_equal(film[0].rgba, ss.turntable(fields[0], frames=2, size=SIZE, backend="cpu")[0].rgba)
