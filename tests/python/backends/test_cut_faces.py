"""Faces of cuts are lit by the normal of the cut: what that shows, what it leaves alone, and who decides on it."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from image_checks import FLOAT32

import sheetsplat as ss

SIZE = (40, 40)
NORMAL = (1.0, -0.7, 0.5)
LIGHT = ss.Light((-0.3, 0.4, 1.0))
OPAQUE = [(0.3, 1, 0.8, 0.6, 0), (0.5, 1, 0.8, 0.6, 1)]
BACKENDS = ["reference", "cpu", pytest.param("gl", marks=pytest.mark.gl)]


@cache
def block(seed: int = 3) -> ss.RegularField:
    """Return noise about 0.8."""
    values = 0.8 + 0.05 * np.random.default_rng(seed).standard_normal((20, 20, 20))
    return ss.RegularField(values.astype(np.float32))


def scene(field: Any = None, function: Any = OPAQUE, **options: Any) -> ss.Scene:
    """Return a lit block that an oblique plane cuts."""
    given = {"lights": [LIGHT], "clip": ss.Clip(planes=[(NORMAL, 8.0)]), "cut_faces": True}
    return ss.Scene(block() if field is None else field, function, **{**given, **options})


def camera(field: ss.Field, kind: str = "orthographic") -> ss.Camera:
    """Return one that looks at the cut."""
    return ss.Camera.fit(field, direction=NORMAL, kind=kind)


def picture(made: ss.Scene, backend: str = "reference", kind: str = "orthographic") -> ss.Image:
    return ss.Renderer(backend).render(made, camera(made.fields[0], kind), size=SIZE)


def axes(seen: ss.Camera) -> np.ndarray:
    """Return right, up and back of a camera as rows."""
    back = np.subtract(seen.eye, seen.target)
    right = np.cross(seen.up, back)
    rows = np.array([right, np.cross(back, right), back])
    return np.asarray(rows / np.linalg.norm(rows, axis=1)[:, None])


def middle(image: ss.Image) -> np.ndarray:
    """Return the colours of the face alone."""
    return image.pixels[14:26, 14:26, :3].astype(float)


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
@pytest.mark.parametrize("backend", BACKENDS)
def test_the_face_of_a_homogeneous_block_is_even(backend: str, kind: str) -> None:
    made = scene(material=ss.Material(ambient=0.2, diffuse=0.8))
    assert middle(picture(made.replace(cut_faces=False), backend, kind)).std(axis=(0, 1)).max() > 0.1
    face = middle(picture(made, backend, kind))
    assert face.std(axis=(0, 1)).max() <= 1e-6
    # Lambert's law for the plane's normal.
    seen = camera(block(), kind)
    outward = -np.array(NORMAL) / np.linalg.norm(NORMAL)
    towards = np.array(LIGHT.direction) / np.linalg.norm(LIGHT.direction)
    lit = 0.2 + 0.8 * float(axes(seen) @ outward @ towards)
    assert np.allclose(face[0, 0], lit * np.array([1, 0.8, 0.6]), atol=1e-6)


@pytest.mark.parametrize("spacing", [0.25, 2.0])
def test_other_distances_of_slices_show_the_same_face(spacing: float) -> None:
    half = [(0.3, 1, 0.8, 0.6, 0), (0.5, 1, 0.8, 0.6, 0.5)]
    wanted = middle(picture(scene(function=half)))
    rough = middle(picture(scene(function=half, cut_faces=False)))
    assert wanted.std(axis=(0, 1)).max() < 0.5 * rough.std(axis=(0, 1)).max()
    found = middle(picture(scene(function=half, slice_spacing=spacing)))
    assert np.abs(found.mean(axis=(0, 1)) - wanted.mean(axis=(0, 1))).max() < 0.1


@pytest.mark.parametrize("backend", BACKENDS)
def test_off_and_where_nothing_is_cut_no_pixel_changes(backend: str) -> None:
    field = block().replace(boundary="zero")
    for changes in ({"clip": None}, {"lights": ()}, {"mode": "isosurface", "iso_value": 0.5}, {"mode": "mip"}):
        made = scene(field, **changes)
        image = picture(made, backend)
        assert not image.plan.has("cut_faces"), changes
        before = picture(made.replace(cut_faces=False), backend)
        assert np.array_equal(image.pixels, before.pixels, equal_nan=True), changes


def test_surfaces_behind_a_gap_keep_their_own_normals() -> None:
    """Three layers behind the cut matter begins: its surface is no face of the cut."""
    values = np.zeros((20, 20, 20), np.float32)
    values[:12] = 1.0
    field = ss.RegularField(values)
    cut = ss.Clip(planes=[((0.0, 0.3, -1.0), -12.5)])
    seen = ss.Camera.fit(field, direction=(0, 0, -1), up=(0, 1, 0))
    made = scene(field, clip=cut)
    with_faces, without = (
        ss.Renderer("reference").render(one, seen, size=SIZE).pixels for one in (made, made.replace(cut_faces=False))
    )
    moved = np.abs(with_faces - without).max(axis=(1, 2))
    # The plane lies at z = 12.5 + 0.3 y: in matter for small y, farther and farther in front of it for others.
    assert moved.max() > 0.01 and moved.min() < 1e-4


def test_spheres_are_round() -> None:
    """Normals on the polyhedron that stands for a sphere follow the sphere."""
    made = scene(clip=ss.Clip(sphere=((9.5, 9.5, 9.5), 8.0)), material=ss.Material(ambient=0.0, diffuse=1.0))
    seen = camera(block())
    image = ss.Renderer("reference").render(made, seen, size=SIZE, outputs=("depth",))
    j, i = np.nonzero(image.pixels[..., 3] > 0.99)
    at = (np.stack([i + 0.5, SIZE[1] - j - 0.5], -1) / SIZE[1] - 0.5) * seen.height
    centre = axes(seen) @ (np.full(3, 9.5) - seen.eye)
    radial = at - centre[:2]
    inner = (radial**2).sum(-1) < 5.0**2
    outward = np.concatenate([radial, np.sqrt(np.maximum(64 - (radial**2).sum(-1), 0))[:, None]], -1)[inner] / 8
    towards = np.array(LIGHT.direction) / np.linalg.norm(LIGHT.direction)
    found = image.pixels[j, i, 0][inner]
    assert np.abs(found - np.maximum(outward @ towards, 0)).max() < 0.05


@pytest.mark.parametrize("backend", BACKENDS[1:])
@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
def test_groups_that_end_in_different_places_and_labels(backend: str, kind: str) -> None:
    labels = np.zeros((20, 20, 20), np.uint8)
    labels[3:17, 3:17, 2:11], labels[5:15, 4:18, 11:] = 1, 2
    named = ss.RegularField(labels, labels=True)
    colors = ss.LabelColors({1: (1, 0.5, 0.2, 1), 2: (0.2, 0.5, 1, 0.5)})
    other = block(5).replace(spacing=(0.6, 0.6, 0.6), origin=(2.0, 4.0, 3.0))
    half = [(0.3, 1, 0.8, 0.6, 0), (0.5, 1, 0.8, 0.6, 0.4), (0.9, 0.2, 0.3, 1, 0.8)]
    made = [
        scene(named, colors),
        scene([named, other], [colors, half], clip=None),
        scene([block(), other], [half, half], preintegration=True),
    ]
    for one in made:
        wanted = picture(one, "reference", kind)
        image = picture(one, backend, kind)
        assert image.plan.has("cut_faces")
        assert np.sqrt(np.mean((image.pixels - wanted.pixels) ** 2)) <= FLOAT32[0]
        assert np.abs(picture(one.replace(cut_faces=False), "reference", kind).pixels - wanted.pixels).max() > 0.05


def test_render_decides_on_faces_by_what_is_cut_and_lit() -> None:
    field = block().replace(boundary="zero")
    clip = ss.Clip(planes=[(NORMAL, 8.0)])

    def on(shown: Any = field, **options: Any) -> bool:
        return bool(ss.render(shown, size=(24, 24), opacity=0.9, clim=(0.3, 0.5), **options).plan.has("cut_faces"))

    assert on(clip=clip) and on(block())
    assert not on() and not on(clip=clip, lights=[LIGHT]) and not on(clip=clip, material=ss.Material())
    assert not on(clip=clip, shading=False) and not on(clip=clip, cut_faces=False)
    assert on(clip=clip, lights=[LIGHT], cut_faces=True)


def test_the_plan_says_why() -> None:
    made = scene(block().replace(boundary="zero"))
    renderer = ss.Renderer("cpu")

    def reason(one: ss.Scene) -> str:
        plan = renderer.plan(one, camera(block()), size=SIZE)
        return next(effect.reason for effect in plan.effects if effect.name == "cut_faces")

    assert "normals are those of the cut" in reason(made)
    assert reason(made.replace(cut_faces=False)) == "not asked for"
    assert "no lights" in reason(made.replace(lights=()))
    assert "nothing is cut off" in reason(made.replace(clip=None))
    with pytest.raises(ss.Unsupported, match="cut_faces"):
        ss.Renderer("cpu", effects={"cut_faces": False}).plan(made, camera(block()), size=SIZE)
    forced = ss.Renderer("cpu", effects={"cut_faces": False}, allow_inexact=True)
    off = ss.Renderer("cpu").render(made.replace(cut_faces=False), camera(block()), size=SIZE)
    assert np.array_equal(forced.render(made, camera(block()), size=SIZE).pixels, off.pixels)


def test_shadows_fall_on_faces() -> None:
    """The error that is stated for the light of faces holds."""
    made = scene(shadows=True, lights=[ss.Light((1.0, 0.2, 0.4))], function=[(0.3, 1, 1, 1, 0), (0.5, 1, 1, 1, 0.3)])
    image, wanted = picture(made, "cpu"), picture(made, "reference")
    stated = np.sqrt(sum(rmse**2 for rmse in image.plan.error_budget.values()))
    assert np.sqrt(np.mean((image.pixels - wanted.pixels) ** 2)) <= 2 * stated
