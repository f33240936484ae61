"""Shadows and ambient occlusion of fields in bricks are those of the whole."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from bricked_volumes import ROUNDING, rmse
from bricked_volumes import SIZE as PICTURE
from bricks_in_memory import (
    BOUND,
    LIT,
    Bricked,
    camera_of,
    differences,
    field_named,
    light_in_bricks,
    one_precision,
    whole_picture,
)

import sheetsplat as ss
from sheetsplat.bricks import light_error
from sheetsplat.bricks.draw import render_bricks
from sheetsplat.bricks.light import merged_pieces, pieces_of, planned_light
from sheetsplat.bricks.resident import residents

# LIT has a light of the camera and one of the world.
SHADOWS: dict[str, Any] = {**LIT, "shadows": True}
OPEN: dict[str, Any] = {**LIT, "ambient_occlusion": ss.AmbientOcclusion(6.0, 0.8)}
BOTH: dict[str, Any] = {**SHADOWS, **OPEN}
SURFACE: dict[str, Any] = {"mode": "isosurface", "iso_value": [(0.3, 0.4), (0.6, 1.0)]}
NEAR: dict[str, Any] = {"slice_spacing": 0.05, "ambient_occlusion": ss.AmbientOcclusion(0.4)}
# name of the field, brick size or number, camera, options
SCENES: dict[str, tuple[str, Any, str, dict[str, Any]]] = {
    "shadows": ("cartesian", 9, "orthographic", SHADOWS),
    "shadows in perspective": ("cartesian", (7, 24, 5), "perspective", SHADOWS),
    "eye inside": ("cartesian", 8, "inside", BOTH),
    "open": ("cartesian", 9, "orthographic", OPEN),
    "open without lights": ("cartesian", 9, "perspective", {"ambient_occlusion": ss.AmbientOcclusion(9.0)}),
    "both of one brick": ("cartesian", 64, "perspective", BOTH),
    # Planes of several slices, which several bricks fill.
    "fine slices": ("cartesian", (5, 7, 9), "orthographic", {**BOTH, "slice_spacing": 0.25}),
    "intervals": ("cartesian", 9, "perspective", {**BOTH, "preintegration": True}),
    "opaque at 0": ("threshold", 9, "orthographic", {**SHADOWS, "opacity_stop": 1.0}),
    "clip": ("cartesian", 9, "perspective", {**BOTH, "clip": ss.Clip(planes=[((1.0, 0.5, -0.3), 9.0)])}),
    "filter": ("cartesian", 9, "perspective", {**SHADOWS, "filter": "ewa"}),
    "surfaces": ("cartesian", 9, "perspective", {**BOTH, **SURFACE}),
    "surface of the world": ("uneven", 9, "orthographic", {**SHADOWS, "mode": "isosurface", "iso_value": 0.4}),
    "uneven": ("uneven", 9, "orthographic", BOTH),
    "oblique": ("oblique", 9, "perspective", BOTH),
    "oblique surface": ("oblique", 9, "orthographic", {**BOTH, **SURFACE}),
    "prefiltered": ("prefiltered", 10, "orthographic", SHADOWS),
    "holes": ("holes", 9, "orthographic", SHADOWS),
    "bcc": ("bcc", 9, "perspective", BOTH),
    "bcc surface": ("bcc", 8, "orthographic", {**BOTH, **SURFACE}),
    "needles": ("needles", 7, "orthographic", {**SHADOWS, **NEAR}),
    "needles open": ("needles", 9, "perspective", {**LIT, **NEAR}),
    "needles surface": ("needles", 9, "perspective", {**SHADOWS, **NEAR, "mode": "isosurface", "iso_value": 0.3}),
}


def drawn(bricked: Bricked, camera: ss.Camera, settings: dict[str, Any], **options: Any) -> Any:
    """Return a picture in bricks, and its view."""
    view, light = light_in_bricks(bricked, bricked.view(camera, (), settings, **options))
    return render_bricks(view, bricked.field_of(view), light), view


@pytest.mark.parametrize("name", SCENES)
def test_light_in_bricks_is_that_of_one_process(name: str) -> None:
    which, brick, kind, options = SCENES[name]
    field = field_named(which)
    camera = camera_of(field, kind)
    settings = {"backend": "cpu", "precision": "float32", "allow_inexact": True}
    wanted, precision = whole_picture(field, camera, (), settings, **options)
    found, view = drawn(Bricked(field, brick), camera, settings, **options)
    plain = {name: value for name, value in options.items() if name not in ("shadows", "ambient_occlusion")}
    undimmed, _ = whole_picture(field, camera, (), {"backend": "cpu"}, **plain)
    apart, dimmed = differences(found, wanted)["rgba"], differences(undimmed, wanted)["rgba"]
    print(name, len(view.partition), precision, view.light.shapes, apart, dimmed)
    assert apart <= BOUND
    assert dimmed > 1e2 * BOUND


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2, 7, 64])
@pytest.mark.parametrize("which", ["cartesian", "uneven", "oblique", "bcc", "needles"])
def test_any_number_of_bricks_in_any_light(which: str, count: int) -> None:
    random = np.random.default_rng([count, len(which)])
    field = field_named(which)
    spacing = 0.05 if which == "needles" else float(random.uniform(0.4, 1.1))
    around = ss.AmbientOcclusion(float(random.uniform(3.0, 12.0)) * spacing)
    for number, options in enumerate((SHADOWS, {**OPEN, "opacity_stop": 1.0}, {**BOTH, **SURFACE})):
        kind = ("orthographic", "perspective")[(number + count) % 2]
        camera = ss.Camera.fit(field, direction=tuple(random.normal(size=3)), up=(0.1, 1.0, 0.2), kind=kind)
        options = {**options, "slice_spacing": spacing}
        if "ambient_occlusion" in options:
            options["ambient_occlusion"] = around
        settings, precision = one_precision(field, camera, **options)
        wanted, _ = whole_picture(field, camera, (), settings, **options)
        cuts = {1: 64, 2: (64, 64, 15), 7: (64, 64, 4), 64: (5, 6, 7)}[count] if which != "needles" else count
        found, view = drawn(Bricked(field, cuts), camera, settings, **options)
        apart = differences(found, wanted)["rgba"]
        print(which, len(view.partition), kind, options.get("mode"), precision, apart)
        assert apart <= BOUND


def test_light_that_misses_a_brick_is_seen() -> None:
    which, brick, kind, options = SCENES["shadows"]
    field = field_named(which)
    camera = camera_of(field, kind)
    wanted, _ = whole_picture(field, camera, (), {"backend": "cpu"}, **options)
    bricked = Bricked(field, brick)
    view = bricked.view(camera, (), {"backend": "cpu"}, **options)
    middle = int(bricked.partition.brick_of(np.mean(np.asarray(field.bounds), axis=0)[None])[0])
    numbers = [number for number in range(len(view.partition)) if number != middle]
    view, light = light_in_bricks(bricked, view, None, numbers)
    off = differences(render_bricks(view, bricked.field_of(view), light), wanted)["rgba"]
    print(off)
    assert off > 10 * BOUND


@pytest.mark.parametrize("name", ["shadows", "fine slices", "surfaces", "needles"])
def test_pieces_of_bricks_fill_the_grid(name: str) -> None:
    which, brick, kind, options = SCENES[name]
    field = field_named(which)
    bricked, whole = Bricked(field, brick), Bricked(field, 1 if which == "needles" else 64)
    camera = camera_of(field, kind)
    view = planned_light(bricked.view(camera, (), {"backend": "cpu"}, **options), field)
    alone = planned_light(whole.view(camera, (), {"backend": "cpu"}, **options), field)
    parts = [pieces_of(view, bricked.field_of(view), n) for n in range(len(view.partition))]
    # In any order: elements of no more than two bricks have a part in each.
    joined = merged_pieces(view, merged_pieces(view, *parts[3:]), merged_pieces(view, *parts[:3]))
    wanted = pieces_of(alone, whole.field_of(alone), 0)
    assert joined.keys() == wanted.keys() and wanted
    for grid, piece in wanted.items():
        found, all_of_it = (np.zeros(view.light.shapes[grid], np.float32) for _ in range(2))
        joined[grid].add_to(found, (0, 0, 0))
        piece.add_to(all_of_it, (0, 0, 0))
        np.testing.assert_allclose(found, all_of_it, rtol=2e-5, atol=2e-6 * float(all_of_it.max()))


def test_light_travels_between_processes() -> None:
    which, brick, kind, options = SCENES["eye inside"]
    field = field_named(which)
    bricked = Bricked(field, brick)
    view, light = light_in_bricks(bricked, bricked.view(camera_of(field, kind), (), {"backend": "cpu"}, **options))
    again, other = pickle.loads(pickle.dumps((view, light)))
    assert other.nbytes == light.nbytes > 0 and pickle.dumps(again.light) == pickle.dumps(view.light)
    source = bricked.field_of(view)
    pictures = [render_bricks(view, source, one).rgba for one in (light, other)]
    np.testing.assert_array_equal(*pictures)
    with pytest.raises(ss.Unsupported, match="no light volumes of the whole"):
        render_bricks(view, source)


LOOKS: tuple[dict[str, Any], ...] = (
    {"shadows": True},
    {"ambient_occlusion": True, "quality": "best", "slice_spacing": 0.5},
    {"mode": "isosurface", "shadows": True, "ambient_occlusion": True},
    # What is left has no sample of the first ones.
    {"shadows": True, "ambient_occlusion": True, "clip": ss.Clip(planes=[((0.3, 0.2, 1.0), 25.0)])},
    {
        "mode": "isosurface",
        "shadows": True,
        "clip": ss.Clip(box=((18.0, 0.0, 0.0), (60.0, 60.0, 60.0))),
        "background": (1.0, 0.4, 0.2),
    },
)


@pytest.mark.parametrize("options", LOOKS)
def test_opened_bricks_cast_the_shadows_of_the_volume(samples: Any, options: dict[str, Any]) -> None:
    options = {"size": PICTURE, "azimuth": 35, "elevation": 20, "slice_spacing": 0.5, "backend": "cpu", **options}
    one = ss.render(ss.RegularField(samples), **options)
    bricked = ss.open_bricks(samples, brick=16)
    other = ss.render(bricked, **options)
    assert rmse(one, other) <= ROUNDING
    # Seen from elsewhere, light that stands still is the same.
    assert other.stats["bricks_of_light"] > 0
    world = tuple(ss.Light(light.direction, light.color, "world") for light in one.recipe.options["lights"])
    turned = [ss.render(bricked, **{**options, "azimuth": azimuth, "lights": world}) for azimuth in (35, 100)]
    assert turned[1].stats["bricks_of_light"] == 0
    assert (
        rmse(turned[1], ss.render(ss.RegularField(samples), **{**options, "azimuth": 100, "lights": world})) <= ROUNDING
    )


@pytest.mark.parametrize("options", LOOKS)
def test_the_error_of_light_in_bricks_is_stated(samples: Any, options: dict[str, Any]) -> None:
    options = {"size": (36, 30), "azimuth": 35, "backend": "cpu", "quality": "draft", **options}
    image = ss.render(ss.open_bricks(samples, brick=24, quality="draft"), **options)
    stated = image.error.budget
    names = {"shadows from a volume": "shadows", "occlusion from a volume": "ambient_occlusion"}
    asked = {cause for cause, name in names.items() if name in options}
    assert asked == {cause for cause in names if stated.get(cause, 0.0) > 0.0}
    assert np.sqrt(sum(part**2 for part in stated.values())) == pytest.approx(image.error.rmse, rel=1e-6)
    # Of the whole at the same slices by the definition of light.
    exact = ss.Renderer("reference").render(
        image.recipe.scene([ss.RegularField(samples, prefilter=image.recipe.fields[0].options["prefilter"])]),
        image.camera,
        (36, 30),
    )
    off = rmse(image, exact)
    print(options, off, stated)
    assert off <= image.error.rmse


OF_LIGHT = ("shadows from a volume", "occlusion from a volume")
# Beside `LOOKS`: what is looked at in other ways.
MEASURED: tuple[dict[str, Any], ...] = (
    *LOOKS,
    {"shadows": True, "preintegration": True, "projection": "perspective"},
    {"shadows": True, "ambient_occlusion": True, "sampling": "slab", "opacity_stop": 1.0},
    {"shadows": True, "filter": "ewa", "supersampling": 2},
    {
        "shadows": True,
        "depth_cue": ss.DepthCue(start=0.0, end=200.0),
        "clip": ss.Clip(planes=[((0.3, 0.2, 1.0), 25.0)]),
        "background": (1.0, 0.5, 0.2),
    },
    {"mode": "isosurface", "iso_value": [(60, 0.3), (120, 0.6)], "ambient_occlusion": True, "shadows": True},
)


def _stated(image: ss.Image) -> list[float]:
    return [image.error.budget.get(name, 0.0) for name in OF_LIGHT]


@pytest.mark.parametrize("options", MEASURED)
def test_light_is_measured_in_bricks_as_in_one_process(samples: Any, options: dict[str, Any]) -> None:
    options = {"size": (90, 80), "azimuth": 35, "backend": "cpu", "quality": "draft", **options}
    image = ss.render(ss.open_bricks(samples, brick=16, quality="draft"), **options)
    whole = ss.RegularField(samples, prefilter=image.recipe.fields[0].options["prefilter"])
    found, wanted = _stated(image), _stated(ss.render(whole, **options))
    assert max(wanted) > 0.0
    # Points lie in other slices where rounding decides.
    np.testing.assert_allclose(found, wanted, rtol=0.02)


@pytest.mark.parametrize("options", MEASURED[:2])
def test_few_points_of_each_brick_stand_for_all(
    samples: Any, options: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    options = {"size": (90, 80), "azimuth": 35, "backend": "cpu", "quality": "draft", **options}
    wanted, kept = [], []
    for most in (10**9, 8):
        monkeypatch.setattr(light_error, "_MOST", most)
        thinned = light_error.thinned

        def counted(table: Any, points: int, thinned: Any = thinned) -> Any:
            found = thinned(table, points)
            kept.append(len(found) / max(1, len(table)))
            return found

        with monkeypatch.context() as patch:
            patch.setattr(light_error, "thinned", counted)
            wanted.append(_stated(ss.render(ss.open_bricks(samples, brick=24, quality="draft"), **options)))
    assert min(kept) < 0.8 and max(kept) == 1.0
    np.testing.assert_allclose(wanted[1], wanted[0], rtol=0.25)


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
def test_light_among_scattered_kernels_is_measured_in_bricks(rng: np.random.Generator, projection: str) -> None:
    centers = rng.uniform(-1.0, 1.0, (400, 3))
    field = ss.EllipsoidField(centers, np.full(400, 0.3), values=rng.uniform(0.0, 1.0, 400), w0=0.1)
    options = {"size": (50, 40), "azimuth": 35, "backend": "cpu", "shadows": True, "ambient_occlusion": True}
    options["projection"] = projection
    bricked = ss.open_bricks(field, brick_kernels=60)
    image = ss.render(bricked, **options, slice_spacing=0.08)
    assert image.stats["bricks"] > 4
    whole = ss.render(field, **options, slice_spacing=image.plan.slice_spacing)
    assert rmse(image, whole) <= ROUNDING
    wanted = _stated(whole)
    assert min(wanted) > 0.0
    np.testing.assert_allclose(_stated(image), wanted, rtol=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("options", LOOKS)
def test_a_cluster_measures_light(cluster: Any, samples: Any, options: dict[str, Any]) -> None:
    options = {"size": (50, 40), "azimuth": 35, "quality": "draft", **options}
    image = ss.render(ss.open_bricks(samples, brick=16, client=cluster, quality="draft"), client=cluster, **options)
    alone = ss.render(ss.open_bricks(samples, brick=16, quality="draft"), **options)
    assert max(_stated(alone)) > 0.0
    np.testing.assert_allclose(_stated(image), _stated(alone), rtol=1e-9)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:nothing can be seen")
def test_a_picture_that_shows_nothing_has_no_error_of_light(cluster: Any, samples: Any) -> None:
    table = [(0.0, 1.0, 1.0, 1.0, 0.0), (255.0, 1.0, 1.0, 1.0, 0.0)]
    options = {"size": (20, 16), "backend": "cpu", "shadows": True, "transfer_function": table}
    for client in (None, cluster):
        image = ss.render(ss.open_bricks(samples, brick=16, client=client, quality="draft"), client=client, **options)
        assert max(_stated(image)) == image.error.rmse == 0.0


def _reads(*, forget: bool) -> int:
    """Return how often this process read bricks; `forget`: it has to read them again."""
    if forget:
        residents().clear()
    return residents().counts.reads


@pytest.mark.slow
def test_reads_for_light_are_counted(cluster: Any, samples: Any) -> None:
    options = {
        "size": PICTURE,
        "quality": "draft",
        "shadows": True,
        "lights": (ss.Light((1.0, 2.0, 1.0), space="world"),),
    }
    bricked = ss.open_bricks(samples, brick=16, client=cluster, quality="draft")
    before = sum(cluster.run(_reads, forget=True).values())
    first, second = (ss.render(bricked, client=cluster, **options) for _ in range(2))
    assert first.stats["bricks_read"] == sum(cluster.run(_reads, forget=False).values()) - before
    assert first.stats["bricks_read"] >= first.stats["bricks_of_light"] > 0 and first.stats["bytes_read"] > 0
    assert second.stats["bricks_read"] == second.stats["bytes_read"] == 0


@pytest.mark.slow
def test_a_cluster_makes_light_once(cluster: Any, samples: Any) -> None:
    world = (ss.Light((1.0, 2.0, 1.0), space="world"),)
    options = {"size": PICTURE, "quality": "draft", "lights": world, "shadows": True, "ambient_occlusion": True}
    bricked = ss.open_bricks(samples, brick=16, client=cluster, quality="draft")
    drawn = [ss.render(bricked, client=cluster, azimuth=azimuth, **options) for azimuth in (35, 80)]
    assert drawn[0].stats["bricks_of_light"] > 0 and drawn[1].stats["bricks_of_light"] == 0
    for image, azimuth in zip(drawn, (35, 80), strict=True):
        alone = ss.render(ss.open_bricks(samples, brick=16, quality="draft"), azimuth=azimuth, **options)
        np.testing.assert_array_equal(image.pixels, alone.pixels)
    # Lights of the camera turn.
    assert ss.render(bricked, client=cluster, **{**options, "lights": None}).stats["bricks_of_light"] > 0
