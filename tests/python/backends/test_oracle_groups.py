"""The reference against the oracle: transfer functions of groups, several isosurfaces, modes minimum and average."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import oracle
import oracle.picture
import pytest
import scene_parts
from random_scenes import random_ellipsoids, random_light, random_regular, random_transfer
from scene_parts import central, cloud, parallel, pick, random_camera
from test_oracle import build_effects, make_wrong, reference_excess, share_seen, with_effects

import sheetsplat as ss

SEEDS = range(60)
MODES = ("composite", "isosurface", "minimum", "composite", "isosurface", "average")


def random_groups(rng: np.random.Generator, count: int) -> list[list[int]]:
    """Return the numbers 0 ... count - 1 cut into groups."""
    cuts = np.flatnonzero(rng.random(count - 1) < 0.6) + 1
    return [part.tolist() for part in np.split(np.arange(count), cuts)]


def group_scene(seed: int) -> dict[str, Any]:
    """Return the parts of a scene of several fields; modes are counted through, the rest is drawn."""
    rng = np.random.default_rng([12, seed])
    fields = [random_ellipsoids(rng)]
    fields += [pick(rng, random_ellipsoids, random_regular)(rng) for _ in range(rng.integers(0, 3))]
    for field in fields:
        if "centers" not in field:
            # Groups that end in different places are those of test_oracle_ends.py.
            field["boundary"] = "zero"
    groups = random_groups(rng, len(fields))
    mode = MODES[seed % 6]
    scene: dict[str, Any] = {
        "mode": mode,
        "sampling": ("point", "slab")[seed // 6 % 2],
        "opacity_stop": float(pick(rng, 0.98, 1.0, rng.uniform(0.3, 1))),
        "preintegration": seed % 6 == 3,
        "slice_spacing": float(2 / rng.uniform(3, 16)),
        "reference_length": float(rng.uniform(0.1, 0.6)),
    }
    if rng.random() < 0.3:
        scene["filter"] = "ewa"
    if mode == "isosurface":
        # Values of some surfaces are the same: ties.
        values = pick(rng, *[rng.uniform(0.05, 0.9, n) for n in (1, 2, 3, 4)])
        values[rng.random(len(values)) < 0.2] = values[0]
        scene["iso_value"] = [(float(v), float(pick(rng, 1.0, 0.5 * rng.random(), rng.random()))) for v in values]
    parts = {
        "fields": fields,
        "groups": groups,
        "transfer": [random_transfer(rng) for _ in groups],
        "scene": scene,
        **random_light(rng),
        "camera": random_camera(rng, 2.0),
        "size": tuple(int(n) for n in rng.integers(4, 16, 2)),
    }
    with_effects(parts, seed)
    if scene["preintegration"] and len(groups) > 1:
        scene["preintegration"] = True
    return parts


@pytest.mark.parametrize("seed", SEEDS)
def test_reference_is_the_oracle_of_groups(seed: int, reference_renderer: ss.Renderer) -> None:
    assert reference_excess(group_scene(seed), reference_renderer, build_effects) <= 1


def test_random_groups_show_something(reference_renderer: ss.Renderer) -> None:
    parts = [group_scene(seed) for seed in SEEDS]
    assert sum(len(one["groups"]) > 1 for one in parts) > len(parts) / 3
    assert sum("shadows" in one["scene"] and one["scene"]["mode"] == "isosurface" for one in parts) >= 3
    assert sum("ambient_occlusion" in one["scene"] and one["scene"]["mode"] == "isosurface" for one in parts) >= 1
    assert share_seen(parts, reference_renderer) > 0.6


def thicker(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return means of extinction that are half as large again."""
    return lambda tf, first, last: tuple(part * np.array(1.5) for part in original(tf, first, last))


def the_last_alone(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return the composite of the last group alone."""
    return lambda scene, slices, groups, *rest: original(scene, slices, groups[-1:], *rest)


def in_order_of_the_list(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return crossings composited in the order of groups and values instead of their places."""

    def drawn(scene: Any, slices: Any, groups: Any, *rest: Any) -> None:
        order = np.argsort
        try:
            np.argsort = lambda place, **_: np.broadcast_to(  # type: ignore[assignment]
                np.arange(len(place))[:, None, None], place.shape
            )
            original(scene, slices, groups, *rest)
        finally:
            np.argsort = order  # type: ignore[assignment]

    return drawn


def closed_at_the_near_plane(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return surfaces that are closed where the near plane cuts them."""

    def drawn(scene: Any, slices: Any, *rest: Any) -> None:
        slices.cut = False
        original(scene, slices, *rest)

    return drawn


def of_all_points(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return scalar pictures over all slices, touched or not."""
    return lambda mode, rho, weights, *rest: original(mode, rho, np.ones_like(weights), *rest)


SURFACES = [(0.1, 0.3), (0.25, 0.5), (0.4, 0.2)]
WRONG: dict[str, tuple[str, Callable[..., Any], dict[str, Any]]] = {
    "extinction": ("ramp_means", thicker, {"preintegration": True}),
    "groups": ("_composite", the_last_alone, {}),
    "order": ("_isosurface", in_order_of_the_list, {"mode": "isosurface", "iso_value": SURFACES}),
    "near plane": ("_isosurface", closed_at_the_near_plane, {"mode": "isosurface", "iso_value": SURFACES}),
    "minimum": ("_scalar", of_all_points, {"mode": "minimum"}),
    "average": ("_scalar", of_all_points, {"mode": "average"}),
}


def two_clouds(**scene: Any) -> dict[str, Any]:
    """Return two clouds in each other, each with its transfer function, of which a near plane cuts off a part."""
    rng = np.random.default_rng(21)
    # Slices so far apart that several surfaces lie between two.
    parts = scene_parts.parts(
        [cloud(rng, 12, 2.0, 2.0, w0=0.3) for _ in range(2)],
        central() | {"near": 3.6},
        size=(14, 12),
        slice_spacing=0.2,
        **scene,
    )
    return parts | {"groups": [[0], [1]], "transfer": [scene_parts.GENTLE, scene_parts.OPAQUE]}


@pytest.mark.parametrize("formula", WRONG)
def test_a_wrong_formula_of_groups_is_seen(
    formula: str, monkeypatch: pytest.MonkeyPatch, reference_renderer: ss.Renderer
) -> None:
    name, wrong, scene = WRONG[formula]
    parts = two_clouds(**scene)
    assert reference_excess(parts, reference_renderer, build_effects) <= 1
    make_wrong(monkeypatch, oracle.picture, name, wrong)
    assert reference_excess(parts, reference_renderer, build_effects) > 1000


def picture_of(parts: dict[str, Any], renderer: ss.Renderer) -> ss.Image:
    """Return the picture with coverage and depth."""
    scene, camera, size = build_effects(ss, parts)
    return renderer.render(scene, camera, size=size, outputs=("coverage", "depth"))


LOOKS: dict[str, dict[str, Any]] = {
    "slices": {},
    "intervals": {"preintegration": True},
    "surfaces": {"mode": "isosurface", "iso_value": SURFACES},
    "average": {"mode": "average"},
}


@pytest.mark.parametrize("look", LOOKS)
def test_order_of_groups_does_not_matter(look: str, reference_renderer: ss.Renderer) -> None:
    parts = two_clouds(**LOOKS[look])
    turned = {name: parts[name][::-1] for name in ("fields", "transfer")}
    first, second = picture_of(parts, reference_renderer), picture_of(parts | turned, reference_renderer)
    assert np.abs(np.asarray(first)).max() > 0.1
    np.testing.assert_allclose(np.asarray(first), np.asarray(second), rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(first.coverage, second.coverage, rtol=1e-6)
    np.testing.assert_allclose(first.depth, second.depth, rtol=1e-6)
    other = picture_of(parts | {"transfer": parts["transfer"][::-1]}, reference_renderer)
    assert look == "average" or np.abs(np.asarray(first) - np.asarray(other)).max() > 0.01


@pytest.mark.parametrize("look", LOOKS)
@pytest.mark.parametrize("filtered", [None, "ewa"])
def test_groups_that_do_not_meet_are_one(look: str, filtered: str | None, reference_renderer: ss.Renderer) -> None:
    rng = np.random.default_rng(5)
    fields = [cloud(rng, 6, 1.0, 2.0, w0=0.3) for _ in range(2)]
    for field, side in zip(fields, (-1, 1), strict=True):
        # Farther apart than two pixels, two slices and the filter.
        field["centers"] = 0.3 * field["centers"] + [side * 1.6, 0, side * 1.6]
        field["scales"] = 0.3 * field["scales"]
    scene = {"filter": filtered, "slice_spacing": 0.1} | LOOKS[look]
    parts = scene_parts.parts(fields, parallel((0, 0, -1), 6.0, up=(0, 1, 0)), size=(40, 30), **scene)
    one = picture_of(parts, reference_renderer)
    two = picture_of(parts | {"groups": [[0], [1]], "transfer": [scene_parts.GENTLE] * 2}, reference_renderer)
    assert np.abs(np.asarray(one)).max() > 0.1
    np.testing.assert_array_equal(np.asarray(one), np.asarray(two))
    np.testing.assert_array_equal(one.coverage, two.coverage)
    np.testing.assert_array_equal(one.depth, two.depth)


def test_one_opaque_surface_is_a_number(reference_renderer: ss.Renderer) -> None:
    parts = two_clouds(mode="isosurface", iso_value=0.3)
    number = picture_of(parts, reference_renderer)
    for surfaces in ([(0.3, 1)], [(0.3, 1), (0.3, 0.5)], [(5.0, 1), (0.3, 1)], [(0.2, 0), (0.3, 1)]):
        parts["scene"]["iso_value"] = surfaces
        np.testing.assert_array_equal(picture_of(parts, reference_renderer).rgba, number.rgba)
    assert number.rgba[..., 3].max() == 1


def test_minimum_average_and_maximum_are_in_order(reference_renderer: ss.Renderer) -> None:
    field = scene_parts.cloud(np.random.default_rng(3), 60, 6.0, 1.5, w0=1e-3)
    least, mean, most = (
        picture_of(scene_parts.parts([field], size=(20, 18), mode=mode), reference_renderer)
        for mode in ("minimum", "average", "mip")
    )
    touched = least.coverage > 0
    assert touched.mean() > 0.5
    assert all(np.isnan(picture.scalar[~touched]).all() for picture in (least, mean, most))
    assert (least.scalar <= mean.scalar)[touched].all() and (mean.scalar <= most.scalar)[touched].all()
    assert (least.scalar < 0.9 * mean.scalar)[touched].any() and (mean.scalar < 0.9 * most.scalar)[touched].any()
