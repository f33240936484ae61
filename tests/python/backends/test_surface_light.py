"""Shadows and ambient occlusion in mode isosurface, and what pictures state about the error of theirs."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from image_checks import FLOAT32, distance
from scene_parts import cloud
from test_gl_effects import CUBE, SIZE, TILTED, Case, ambiguous, make, moved_by, reference

import sheetsplat as ss

BACKENDS = ["cpu", pytest.param("gl", marks=pytest.mark.gl)]
OCCLUSION = ss.AmbientOcclusion(1.0, 1.0)
LIGHTS = (ss.Light((1.0, 0.25, 0.15), (0.9, 0.8, 0.7)), ss.Light((-0.3, 1.0, 0.4), (0.3, 0.4, 0.5), "world"))
MATERIAL = ss.Material(ambient=0.5, diffuse=0.5, specular=0.2, two_sided=True)
# Root mean square error next to the reference that no picture below may have, whatever it states.
LIMIT = 0.02


def surface(
    field: str = "cartesian", normalization: str = "lattice", projection: str = "orthographic", **more: Any
) -> Case:
    """Return an isosurface with shadows and ambient occlusion unless `more` says something else."""
    options = {"mode": "isosurface", "iso_value": 0.45, "shadows": True, "ambient_occlusion": OCCLUSION}
    options |= {"lights": LIGHTS, "material": MATERIAL}
    return Case(field, normalization, projection).with_(**options | more)


def stated(image: ss.Image) -> float:
    """Return the error that a picture states for its light."""
    return float(
        np.hypot(*(effect.error for effect in image.plan.effects if effect.name in ("shadows", "ambient_occlusion")))
    )


SURFACES = {
    "shadows": surface(ambient_occlusion=None),
    "occlusion": surface("ellipsoids", "threshold", shadows=False),
    "occlusion without lights": Case("uneven", "threshold", lit=False).with_(
        mode="isosurface", iso_value=0.45, ambient_occlusion=OCCLUSION
    ),
    "both": surface("ellipsoids", "threshold"),
    "perspective": surface("uneven", "threshold", "perspective"),
    "bcc, analytic": surface("bcc", "none", gradient="analytic"),
    "clip": surface(clip=ss.Clip(TILTED)),
    "box": surface("ellipsoids", "threshold", "perspective", clip=ss.Clip(box=CUBE)),
    "two fields": surface("uneven+ellipsoids", "threshold"),
    "slab": surface(sampling="slab"),
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", SURFACES)
def test_surfaces_take_light_as_in_the_reference(name: str, backend: str) -> None:
    case = SURFACES[name]
    scene, camera = make(case)
    image = ss.Renderer(backend).render(scene, camera, size=SIZE)  # type: ignore[arg-type]
    found = distance(image.pixels, reference(case).pixels, ambiguous(case)).rmse
    print(f"{backend} {name}: {found:.2e}, stated {stated(image):.2e}")
    bound = min(LIMIT, max(2 * stated(image), 1e-3))
    assert found <= bound
    # Left out, they would be seen.
    for option, nothing in (("shadows", False), ("ambient_occlusion", None)):
        if case.scene.get(option):
            assert moved_by(case, case.with_(**{option: nothing})) > bound, option


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("groups", [False, True], ids=["two opacities", "groups"])
@pytest.mark.parametrize("boundary", ["edge", "zero"])
def test_translucent_surfaces_and_groups_cast_their_own_shadows(boundary: str, groups: bool, backend: str) -> None:
    """Each iso value takes light by its opacity, in the scalar of each group of fields."""
    cube, camera = make(Case("uneven", "threshold"))
    # Fields that end in one place, and are counted from one base.
    ends = {"boundary": boundary, "base": 0.0}
    cubes = tuple(one.replace(**ends) for one in cube.fields)
    if boundary == "zero":
        other = ss.RegularField(
            np.full((5, 5, 5), 0.8), spacing=(0.1, 0.1, 0.1), origin=(0.7, -0.1, 0.3), normalization="threshold",
            w0=0.1, **ends,
        )  # fmt: skip
    else:
        values = np.zeros_like(cubes[0].values)
        values[5:8, 4:6, 6:9] = 0.8
        other = cubes[0].replace(values=values)
    points = [(0.0, 0.1, 0.2, 0.6, 0.0), (1.0, 1.0, 0.9, 0.8, 0.5)]
    fields = (*cubes, other)
    scene = ss.Scene(
        fields if groups else cubes,
        [points, [(0.0, 0.9, 0.4, 0.1, 0.0), (1.0, 0.9, 0.4, 0.1, 1.0)]] if groups else points,
        mode="isosurface",
        iso_value=((0.25, 0.3), (0.5, 0.9)),
        lights=LIGHTS,
        material=MATERIAL,
        slice_spacing=0.2,
        shadows=True,
        ambient_occlusion=OCCLUSION,
        opacity_stop=1.0,
    )
    image = ss.Renderer(backend).render(scene, camera, size=SIZE)  # type: ignore[arg-type]
    exact = ss.Renderer("reference")
    expected = exact.render(scene, camera, size=SIZE).pixels
    found = distance(image.pixels, expected).rmse
    print(f"{backend}: {found:.2e}, stated {stated(image):.2e}")
    bound = min(LIMIT, max(2 * stated(image), 1e-3))
    assert found <= bound
    for wrong in ({"shadows": False}, {"ambient_occlusion": None}, {"iso_value": ((0.25, 0.9), (0.5, 0.9))}):
        assert distance(exact.render(scene.replace(**wrong), camera, size=SIZE).pixels, expected).rmse > bound


@pytest.mark.gl
@pytest.mark.parametrize("name", ["both", "box"])
def test_both_backends_follow_the_same_lines(name: str) -> None:
    case = SURFACES[name]
    scene, camera = make(case)
    pictures = [ss.Renderer(backend).render(scene, camera, size=SIZE).pixels for backend in ("cpu", "gl")]  # type: ignore[arg-type]
    # At a few pixels a line passes an edge so closely that rounding decides.
    far = np.abs(pictures[0] - pictures[1]).max(axis=2) > FLOAT32[1]
    assert far.mean() < 0.01


def ball_over_floor(**options: Any) -> tuple[ss.Scene, ss.Camera]:
    """Return a ball whose shadow falls on a floor, seen from above."""
    z, y, x = np.mgrid[0:20, 0:28, 0:28].astype(float)
    values = np.maximum(
        np.clip(4.5 - z, 0, 1), np.clip(6.0 - np.sqrt((x - 13.5) ** 2 + (y - 13.5) ** 2 + (z - 13) ** 2), 0, 1)
    )
    scene = ss.Scene(
        ss.RegularField(values),
        [(0, 1, 1, 1, 0), (1, 1, 1, 1, 1)],
        mode="isosurface",
        iso_value=0.5,
        lights=[ss.Light((0.7, 0.2, 1), space="world")],
        material=ss.Material(ambient=0.2, diffuse=0.8),
        **options,
    )
    return scene, ss.Camera.orthographic((0, 13.5, 40), (13.5, 13.5, 5), (0, 1, 0), height=34)


@pytest.mark.parametrize("backend", BACKENDS)
def test_no_acne_no_leaks(backend: str) -> None:
    """A floor is lit or in full shadow: nothing between but a line of pixels, and no spots."""
    scene, camera = ball_over_floor(shadows=True)
    renderer = ss.Renderer(backend)  # type: ignore[arg-type]
    size = (120, 100)
    plain = renderer.render(scene.replace(shadows=False), camera, size=size).pixels
    shadowed = renderer.render(scene, camera, size=size).pixels
    ratio = shadowed[..., 0] / np.maximum(plain[..., 0], 1e-6)
    facing = plain[..., 0] > 0.5
    lit, dark = facing & (ratio > 0.999), facing & (ratio < 0.5)
    assert (facing & ~lit & ~dark).sum() == 0, "an opaque surface takes all light or none"
    assert 0.05 < dark.sum() / facing.sum() < 0.5
    # Spots: pixels unlike all four of their neighbours.
    inner = dark[1:-1, 1:-1]
    same = [dark[1:-1, :-2], dark[1:-1, 2:], dark[:-2, 1:-1], dark[2:, 1:-1]]
    near = facing[1:-1, 1:-1] & np.logical_and.reduce(
        [facing[1:-1, :-2], facing[1:-1, 2:], facing[:-2, 1:-1], facing[2:, 1:-1]]
    )
    alone = near & np.logical_and.reduce([inner != neighbour for neighbour in same])
    assert alone.sum() == 0


def test_views_of_one_scene_share_the_grid() -> None:
    scene, camera = ball_over_floor(shadows=True, ambient_occlusion=ss.AmbientOcclusion(4))
    other = ss.Camera.orthographic((30, -10, 40), (13.5, 13.5, 5), (0, 1, 0), height=34)
    own = ss.Renderer("cpu")
    first = own.render(scene, camera, size=SIZE)
    turned = own.render(scene, other, size=SIZE)
    assert turned.stats["seconds_light"] < 0.2 * first.stats["seconds_light"]
    assert np.array_equal(turned.pixels, ss.Renderer("cpu").render(scene, other, size=SIZE).pixels)
    # Another value, another clip, another light: as if they were the first.
    for changed in (
        scene.replace(iso_value=0.3),
        scene.replace(clip=ss.Clip(planes=[((-1, 0, 0), -14)])),
        scene.replace(lights=[ss.Light((-0.7, 0.2, 1))]),
    ):
        assert np.array_equal(
            own.render(changed, other, size=SIZE).pixels, ss.Renderer("cpu").render(changed, other, size=SIZE).pixels
        )
    assert np.array_equal(ss.Renderer("cpu", threads=3).render(scene, other, size=SIZE).pixels, turned.pixels)


def random_scene(seed: int) -> tuple[ss.Scene, ss.Camera]:
    """Return a scene in which shadows, ambient occlusion or both are seen."""
    for attempt in range(50):
        scene, camera = some_scene(seed, np.random.default_rng(1000 * attempt + seed))
        plain = scene.replace(shadows=False, ambient_occlusion=None)
        pictures = [ss.Renderer("cpu").render(one, camera, size=(24, 20)).pixels for one in (scene, plain)]
        if distance(*pictures).rmse > 5e-3:
            return scene, camera
    raise AssertionError("nothing is seen of any shadow")


def some_scene(seed: int, rng: np.random.Generator) -> tuple[ss.Scene, ss.Camera]:
    """Return a scene of a kind that follows from the seed."""
    if seed % 3 == 2:
        made = cloud(rng, int(rng.integers(20, 60)), aspect=2.0)
        field: ss.Field = ss.EllipsoidField(
            made["centers"], made["scales"], made["rotations"], made["values"], normalization="threshold", w0=0.3
        )
        unit = 0.2
    else:
        shape = tuple(int(n) for n in rng.integers(12, 18, 3))
        spread = sum(
            (axis - rng.uniform(0.35, 0.65)) ** 2
            for axis in np.meshgrid(*(np.linspace(0, 1, n) for n in shape), indexing="ij")
        )
        values = np.clip(1.1 - 2.6 * np.sqrt(spread) + 0.35 * rng.random(shape), 0, 1)
        field, unit = ss.RegularField(values.astype(np.float32), spacing=(0.15, 0.15, 0.15)), 0.15
    options: dict[str, Any] = {}
    if seed % 2 == 0:
        options |= {"mode": "isosurface", "iso_value": float(rng.uniform(0.3, 0.6))}
    if seed % 5 in (1, 3):
        middle = np.mean(field.centre_bounds, axis=0)
        normal = rng.normal(size=3)
        options["clip"] = ss.Clip(planes=[(tuple(normal), float(normal @ middle) - 0.1)])
    lights = [
        ss.Light(tuple(rng.normal(size=3) + (0, 0, 0.7)), tuple(rng.uniform(0.3, 0.9, 3)), space)
        for space in (("eye",), ("world",), ("eye", "world"))[int(rng.integers(3))]
    ]
    which = int(rng.integers(3))
    if which != 1:
        options["shadows"] = True
    if which != 0:
        options["ambient_occlusion"] = ss.AmbientOcclusion(float(rng.uniform(2, 6)) * unit, float(rng.uniform(0.5, 1)))
    top = float(rng.uniform(0.2, 0.95))
    scene = ss.Scene(
        field,
        [(0, 0.2, 0.3, 0.9, 0), (0.25, 0.4, 0.5, 0.6, 0.02), (0.7, 0.9, 0.6, 0.3, top / 2), (1, 1, 0.9, 0.8, top)],
        lights=lights,
        material=ss.Material(
            ambient=0.3, diffuse=0.7, specular=float(rng.choice([0, 0.3])), two_sided=bool(rng.integers(2))
        ),
        opacity_stop=1.0,
        preintegration=seed % 2 == 1 and bool(rng.integers(2)),
        **options,
    )
    kind: Any = ("orthographic", "perspective")[int(rng.integers(2))]
    return scene, ss.Camera.fit(field, direction=tuple(rng.normal(size=3)), kind=kind)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(36))
def test_the_stated_error_is_the_true_one_within_a_factor_of_2(seed: int) -> None:
    scene, camera = random_scene(seed)
    size = (48, 40)
    image = ss.Renderer("cpu", precision="float64").render(scene, camera, size=size)
    true = distance(image.pixels, ss.Renderer("reference").render(scene, camera, size=size).pixels).rmse
    print(f"{seed}: true {true:.2e}, stated {stated(image):.2e}")
    # What a single pixel of a thousand changes by is not foreseen.
    assert true / 2 - 1e-4 <= stated(image) <= 2 * true + 1e-4
    shares = [part for cause, part in image.error.budget.items() if "from a volume" in cause]
    assert np.linalg.norm(shares) == pytest.approx(stated(image), rel=1e-6)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
def test_what_a_filter_adds_beyond_the_grid_is_in_the_error(projection: Any, backend: Any) -> None:
    """Pixels as large as the kernels widen them, and where their surfaces are, far beyond what light is kept for."""
    field = ss.EllipsoidField([[0, 0, 0], [1.2, 0.2, -0.3]], 0.25, values=np.ones(2), w0=0.004)
    scene = ss.Scene(
        field,
        [(0, 0.9, 0.6, 0.4, 0.5), (1, 0.9, 0.6, 0.4, 0.5)],
        mode="isosurface",
        iso_value=0.5,
        filter="ewa",
        slice_spacing=0.08,
        ambient_occlusion=ss.AmbientOcclusion(0.8, 0.6),
    )
    camera = ss.Camera.fit(field, direction=(-0.3, -0.2, -1.0), kind=projection)
    size = (7, 7)
    with pytest.warns(ss.PictureWarning, match=f"ambient occlusion of backend {backend}"):
        image = ss.Renderer(backend).render(scene, camera, size=size)
    true = distance(image.pixels, ss.Renderer("reference").render(scene, camera, size=size).pixels).rmse
    assert true > 0.01
    assert true <= stated(image) <= 1.3 * true


def test_large_errors_are_seen() -> None:
    """A light that passes many thin steps through steep opacities on a coarse grid: the picture says that it is off."""
    rng = np.random.default_rng(5)
    field = ss.EllipsoidField(rng.uniform(-1, 1, (400, 3)), 0.06, values=np.ones(400), normalization="none")
    scene = ss.Scene(
        field,
        [(0, 1, 1, 1, 0), (0.3, 1, 1, 1, 0), (0.3, 1, 1, 1, 0.99), (2, 1, 1, 1, 0.99)],
        slice_spacing=0.06,
        lights=[ss.Light((1, 0.4, 0.5), (3, 3, 3))],
        material=ss.Material(ambient=0.0, diffuse=1.0),
        shadows=True,
    )
    camera = ss.Camera.orthographic((0, 0, 5), (0, 0, 0), (0, 1, 0), height=2)
    with pytest.warns(ss.PictureWarning, match="shadows of backend cpu differ from their definition by 0"):
        image = ss.Renderer("cpu").render(scene, camera, size=(40, 40))
    assert stated(image) > 0.05
    assert distance(image.pixels, ss.Renderer("reference").render(scene, camera, size=(40, 40)).pixels).rmse > 0.025


def test_large_errors_that_are_not_measured_are_told() -> None:
    """Of very many scattered kernels the plan's estimate stands; where it is large, the picture says so."""
    rng = np.random.default_rng(7)
    field = ss.EllipsoidField(rng.uniform(-1, 1, (200_001, 3)), 0.004, values=np.ones(200_001), normalization="none")
    scene = ss.Scene(
        field,
        [(0, 1, 1, 1, 0), (0.3, 1, 1, 1, 0), (0.3, 1, 1, 1, 0.99), (2, 1, 1, 1, 0.99)],
        slice_spacing=0.1,
        lights=[ss.Light((1, 0.4, 0.5), (3, 3, 3))],
        material=ss.Material(ambient=0.0, diffuse=1.0),
        shadows=True,
    )
    camera = ss.Camera.orthographic((0, 0, 5), (0, 0, 0), (0, 1, 0), height=2)
    with pytest.warns(ss.PictureWarning, match="shadows of backend cpu may differ from their definition by up to 0"):
        image = ss.Renderer("cpu").render(scene, camera, size=(16, 16))
    assert image.stats["light_measured"] == 0
    assert stated(image) > 0.05
    with warnings.catch_warnings(record=True) as issued:
        warnings.simplefilter("always")
        ss.Renderer("cpu").render(scene.replace(shadows=False), camera, size=(16, 16))
    assert not any("definition" in str(warning.message) for warning in issued)


def test_plans_state_what_pictures_state() -> None:
    scene, camera = make(SURFACES["shadows"])
    renderer = ss.Renderer("cpu")
    plan = renderer.plan(scene, camera, size=SIZE)
    image = renderer.render(scene, camera, size=SIZE)
    assert plan.error_budget == image.plan.error_budget
    assert "shadows from a volume" in plan.error_budget
    assert plan.error_budget["shadows from a volume"] == pytest.approx(stated(image))
    # A black light owes nothing; that of lights behind everything is measured, not guessed.
    behind = scene.replace(lights=[ss.Light((0, 0, -1))], material=ss.Material(0.3, 0.7), gradient="analytic")
    assert stated(ss.Renderer("cpu").render(behind, camera, size=SIZE)) < 1e-3


@pytest.mark.slow
@pytest.mark.data
def test_cthead_is_near_the_reference(data_dir: Path) -> None:
    """Skin and bone of a head, in few pixels."""
    field = ss.open(data_dir / "cthead_128x128x113_uint8.nrrd")
    camera = ss.Camera.fit(field, direction=(0.4, 1.0, 0.25), up=(0, 0, -1))
    for iso in (40.0, 95.0):
        scene = ss.Scene(
            field,
            [(0, 0.9, 0.8, 0.7, 0), (255, 1, 1, 0.9, 1)],
            mode="isosurface",
            iso_value=iso,
            lights=[ss.Light((0.6, 0.9, 1.0))],
            material=ss.Material(ambient=0.35, diffuse=0.65),
            shadows=True,
            ambient_occlusion=ss.AmbientOcclusion(16.0, 0.9),
        )
        image = ss.Renderer("cpu").render(scene, camera, size=(36, 36))
        expected = ss.Renderer("reference").render(scene, camera, size=(36, 36))
        found = distance(image.pixels, expected.pixels).rmse
        print(f"iso value {iso}: {found:.2e}, stated {stated(image):.2e}")
        assert found / 2 <= stated(image) <= 2 * found
        assert found <= 0.03
        # Lines that pass an edge closely: few pixels.
        off = np.abs(image.pixels - expected.pixels).max(axis=2) > 0.05
        assert off.sum() < 0.03 * (expected.pixels[..., 3] > 0).sum()
        plain = ss.Renderer("cpu").render(scene.replace(shadows=False, ambient_occlusion=None), camera, size=(36, 36))
        assert distance(plain.pixels, expected.pixels).rmse > 0.045
