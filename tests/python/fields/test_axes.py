"""Lattices whose axes are not the world's (conventions, section 2): turned ones against upright ones, leaning ones
against what the page says."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import numpy as np
import oracle
import pytest
from image_checks import off_by

import sheetsplat as ss

SPACING = np.array((0.5, 0.7, 1.1))
ORIGIN = np.array((1.0, -2.0, 3.0))
TRANSFER = [(0.3, 0, 0, 1, 0), (0.6, 1, 1, 0, 0.3), (1, 1, 0, 0, 0.9)]
# Step k leans over j, and j over i, as in a triclinic cell.
LEANING = np.array(((0.6, 0.0, 0.0), (-0.25, 0.7, 0.0), (0.2, -0.3, 0.9)))
LIGHT = {"lights": ((1.0, 1.0, 1.0),)}
LOOKS: dict[str, dict[str, Any]] = {
    "lit": LIGHT,
    "surface": {"mode": "isosurface", "iso_value": 0.6, **LIGHT},
    "x-ray": {"mode": "xray"},
    "maximum": {"mode": "mip"},
    "average": {"mode": "average"},
    "slabs": {"sampling": "slab"},
    "filter": {"filter": "ewa"},
    "second order": {"preintegration": True, "gradient": "analytic", **LIGHT},
}


def turn() -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return a rotation that is along no axis."""
    return np.linalg.qr(np.array(((0.8, -0.3, 0.4), (0.2, 0.9, -0.3), (-0.5, 0.3, 0.7))))[0]


def samples(seed: int = 3, shape: tuple[int, int, int] = (6, 7, 8)) -> np.ndarray[Any, np.dtype[np.float32]]:
    """Return noise."""
    return np.random.default_rng(seed).random(shape).astype(np.float32)


def scene(package: Any, field: Any, look: dict[str, Any]) -> Any:
    """Return a scene of the package or of the oracle."""
    made = {**look, "lights": [package.Light(one) for one in look.get("lights", ())]}
    return package.Scene(field, package.TransferFunction(TRANSFER), **made)


def camera(package: Any, middle: Any, kind: str, matrix: Any = None) -> Any:
    """Return a camera that looks at a point along no axis, turned by a matrix about the world's origin."""
    matrix = np.eye(3) if matrix is None else matrix
    direction, up = np.array((0.3, -0.5, -0.8)), np.array((0.1, 1.0, 0.2))
    eye, target = matrix @ (middle - 16 * direction), matrix @ middle
    if kind == "orthographic":
        return package.Camera.orthographic(eye, target, matrix @ up, height=9)
    return package.Camera.perspective(eye, target, matrix @ up, fov_y=35)


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
@pytest.mark.parametrize("look", LOOKS)
@pytest.mark.parametrize("backend", ["cpu", "gl", "reference"])
def test_a_turned_volume_looks_as_the_upright_one_does_to_a_turned_camera(backend: Any, look: str, kind: str) -> None:
    upright = ss.RegularField(samples(), spacing=SPACING, origin=ORIGIN)
    matrix = turn()
    turned = ss.RegularField(samples(), axes=np.diag(SPACING) @ matrix.T, origin=matrix @ ORIGIN)
    middle = np.mean(upright.centre_bounds, axis=0)
    draw = ss.Renderer(backend, threads=1).render
    here = draw(scene(ss, upright, LOOKS[look]), camera(ss, middle, kind), size=(32, 28)).pixels
    there = draw(scene(ss, turned, LOOKS[look]), camera(ss, middle, kind, matrix), size=(32, 28)).pixels
    assert np.nanmax(here) > 0.1
    assert off_by(there, here)["maximum"] < 1e-5


@pytest.mark.parametrize("boundary", ["edge", "zero"])
@pytest.mark.parametrize("look", ["lit", "surface", "x-ray", "maximum", "slabs", "filter"])
def test_leaning_volumes_are_drawn_as_the_page_says(look: str, boundary: Any) -> None:
    values = samples(shape=(4, 5, 4))
    arguments = {"axes": LEANING, "origin": ORIGIN, "boundary": boundary}
    middle = ORIGIN + np.array((1.5, 2.0, 1.5)) @ LEANING
    given = {"axes": LEANING.tolist(), "origin": ORIGIN.tolist(), "boundary": boundary}
    wanted = oracle.render(
        scene(oracle, oracle.RegularField(values, **given), LOOKS[look]),
        camera(oracle, middle, "perspective"),
        (14, 12),
    )
    expected = wanted.rgba if wanted.scalar is None else wanted.scalar
    for backend in ("reference", "cpu", "gl"):
        drawn = ss.Renderer(backend, threads=1).render(
            scene(ss, ss.RegularField(values, **arguments), LOOKS[look]),
            camera(ss, middle, "perspective"),
            size=(14, 12),
        )
        assert off_by(drawn.pixels, expected)["rmse"] < 2e-5


def test_samples_are_where_their_steps_lead() -> None:
    values = samples()
    field = ss.RegularField(values, axes=LEANING, origin=ORIGIN, prefilter=True, radius=2.5, falloff=7)
    k, j, i = np.indices(values.shape).reshape(3, -1)
    places = ORIGIN + np.stack((i, j, k), axis=1) @ LEANING
    assert np.abs(field.at(places) - values.ravel()).max() < 1e-5
    assert np.allclose(field.centre_bounds, (places.min(axis=0), places.max(axis=0)))
    assert np.allclose(field.spacing, np.linalg.norm(LEANING, axis=1))
    # A sample is half a step from the end along every axis, and no farther.
    beyond = places + 0.51 * LEANING[0]
    assert np.array_equal(field.inside(beyond), i < values.shape[2] - 1)


def test_gradients_are_those_of_the_world() -> None:
    field = ss.RegularField(samples(), axes=LEANING, origin=ORIGIN, prefilter=True, radius=3, falloff=8)
    place = ORIGIN + np.array((3.37, 2.81, 2.56)) @ LEANING
    step = 1e-5 * np.eye(3)
    differences = (field.at(place + step) - field.at(place - step)) / 2e-5
    assert np.abs(differences).max() > 0.1
    assert np.allclose(field.evaluate(place[None])[1], differences, atol=1e-5)


def test_the_default_slice_distance_is_the_least_height_of_a_cell() -> None:
    field = ss.RegularField(samples(), axes=LEANING)
    volume = abs(np.linalg.det(LEANING))
    faces = [np.linalg.norm(np.cross(LEANING[a], LEANING[b])) for a, b in ((0, 1), (1, 2), (2, 0))]
    assert ss.Scene(field, ss.TransferFunction(TRANSFER)).slice_spacing == pytest.approx(volume / max(faces))


def test_the_mass_of_an_x_ray_is_that_of_the_samples() -> None:
    values = np.zeros((9, 9, 9), np.float32)
    values[3:6, 3:6, 3:6] = samples(shape=(3, 3, 3))
    field = ss.RegularField(values, axes=LEANING, origin=ORIGIN)
    middle = ORIGIN + np.array((4, 4, 4)) @ LEANING
    height, size = 12.0, 240
    view = ss.Camera.orthographic(middle + (0, 0, 30), middle, height=height)
    picture = ss.Renderer("cpu").render(
        ss.Scene(field, ss.TransferFunction(TRANSFER), mode="xray", slice_spacing=0.1), view, size=(size, size)
    )
    mass = float(np.sum(picture.scalar, dtype=np.float64)) * (height / size) ** 2
    assert mass == pytest.approx(float(values.sum()) * abs(np.linalg.det(LEANING)), rel=1e-3)


def test_picks_name_the_sample_that_was_pointed_at() -> None:
    values = np.zeros((5, 5, 5), np.float32)
    values[1, 3, 2] = 1.0
    field = ss.RegularField(values, axes=LEANING, origin=ORIGIN)
    place = ORIGIN + np.array((2, 3, 1)) @ LEANING
    view = ss.Camera.orthographic(place + (0, 0, 20), place, height=6)
    picture = ss.render(field, camera=view, size=(65, 65), shading=False)
    found = picture.pick(32, 32)
    assert found is not None
    assert np.linalg.norm(np.asarray(found.position) - place) < 1.5
    assert found.sample == (1, 3, 2)


def test_fields_with_axes_are_copied_compared_and_described() -> None:
    field = ss.RegularField(samples(), axes=LEANING, origin=ORIGIN)
    for other in (copy.deepcopy(field), pickle.loads(pickle.dumps(field)), field.replace()):
        assert other == field
        assert other.axes == field.axes
    assert field.replace(spacing=(1, 1, 1)).axes is None
    assert field.replace(spacing=(1, 1, 1)).replace(axes=LEANING) == field
    assert field != ss.RegularField(samples(), axes=2 * LEANING, origin=ORIGIN)
    picture = ss.render(field, size=(24, 24))
    assert picture.recipe.fields[0].options["axes"] == field.axes
    again = ss.Recipe.from_json(picture.recipe.to_json())
    made = ss.RegularField(field.values, **again.fields[0].options)
    assert made.axes == field.axes


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"axes": np.ones((3, 3))}, "coplanar"),
        ({"axes": np.zeros((3, 3))}, "coplanar"),
        ({"axes": np.full((3, 3), np.nan)}, "finite"),
        ({"axes": np.eye(2)}, r"\(3, 3\)"),
        ({"axes": np.eye(3), "spacing": (1, 1, 1)}, "spacing beside axes"),
        ({"axes": np.eye(3), "lattice": "bcc"}, "Cartesian"),
        ({"axes": 1e-13 * np.eye(3), "origin": (1e3, 0, 0)}, "fall on one float64 number"),
        ({"axes": 1e151 * np.eye(3)}, "1e150"),
    ],
)
def test_axes_that_cannot_be_used_are_refused(given: dict[str, Any], said: str) -> None:
    with pytest.raises(ss.InvalidInput, match=said):
        ss.RegularField(samples(), **given)


def test_a_cell_of_a_millionth_of_a_step_is_drawn() -> None:
    # Steps i and j nearly parallel: needles that the reference draws too.
    axes = np.array(((1.0, 0.0, 0.0), (1.0, 1e-3, 0.0), (0.0, 0.0, 1.0)))
    field = ss.RegularField(samples(shape=(4, 4, 4)), axes=axes)
    look = {**LIGHT, "slice_spacing": 0.05, "reference_length": 1.0}
    view = camera(ss, np.array((1.5, 1.5, 1.5)) @ axes, "orthographic")
    wanted = ss.Renderer("reference").render(scene(ss, field, look), view, size=(16, 16))
    drawn = ss.Renderer("cpu").render(scene(ss, field, look), view, size=(16, 16))
    assert off_by(drawn.pixels, wanted.pixels)["rmse"] < 1e-4
