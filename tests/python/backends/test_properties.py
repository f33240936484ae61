"""What must leave a picture as it is, on every backend."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from image_checks import FLOAT32_HARD, assert_close, distance

import sheetsplat as ss

SIZE = (22, 20)
# Seeds are numbers without meaning: a smaller one explains nothing.
QUICK = settings(
    max_examples=6,
    deadline=None,
    derandomize=True,
    phases=(Phase.explicit, Phase.generate),
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
POINTS = np.array([(0, 0.1, 0.2, 0.6, 0), (0.3, 0.2, 0.5, 0.4, 0.02), (0.7, 0.9, 0.6, 0.2, 0.2), (1, 1, 0.9, 0.8, 0.5)])
LIGHT = np.array([0.4, 0.6, 1.0])
UPRIGHT = np.eye(3)
DIRECTION, UP = np.array([-0.5, -0.4, -0.8]), np.array([0.1, 1.0, 0.2])


@pytest.fixture(params=["reference", "cpu", pytest.param("gl", marks=pytest.mark.gl)])
def renderer(request):
    return request.getfixturevalue(f"{request.param}_renderer")


def samples(seed: int) -> np.ndarray:
    """Return smooth noise that fades to 0 at the borders, float64 (9, 8, 7)."""
    values = np.random.default_rng(seed).random((9, 8, 7))
    for axis in range(3):
        values = (np.roll(values, 1, axis) + values + np.roll(values, -1, axis)) / 3
    window = [np.sin(np.pi * (np.arange(count) + 0.5) / count) for count in values.shape]
    values *= window[0][:, None, None] * window[1][:, None] * window[2]
    return values / values.max()


def picture(
    renderer, values, *, spacing=(1, 1, 1), origin=(0, 0, 0), matrix=UPRIGHT, light=LIGHT, points=POINTS, **options
):
    """Return the picture of a volume by a camera that is turned and moved with it."""
    scale = options.pop("scale", 1.0)
    back = options.pop("back", 0.0)
    kind = options.pop("kind", "orthographic")
    fields = [
        ss.RegularField(part, spacing=spacing, origin=origin)
        for part in (values if isinstance(values, list) else [values])
    ]
    scene = ss.Scene(fields, points, lights=[ss.Light(light)], opacity_stop=1, **options)
    lower, upper = np.array(fields[0].bounds)
    centre = (lower + upper) / 2
    eye = centre - (30 + back) * scale * (matrix @ DIRECTION)
    if kind == "orthographic":
        camera = ss.Camera.orthographic(eye, centre, matrix @ UP, height=14 * scale)
    else:
        camera = ss.Camera.perspective(eye, centre, matrix @ UP, fov_y=25)
    return renderer.render(scene, camera, size=SIZE).pixels


SEEDS = st.integers(0, 2**31)
KINDS = st.sampled_from(["orthographic", "perspective"])
SIGNED = [np.array(axes)[:, None] == np.arange(3) for axes in itertools.permutations(range(3))]
TURNS = [rows * np.array(signs)[:, None] for rows in SIGNED for signs in itertools.product((1, -1), repeat=3)]


@QUICK
@given(seed=SEEDS, turn=st.integers(0, len(TURNS) - 1), kind=KINDS)
def test_the_order_of_samples_does_not_matter(renderer, seed, turn, kind):
    """Axes may be exchanged and turned round, where the camera goes with them; an odd change mirrors the picture."""
    values, matrix = samples(seed), TURNS[turn].astype(float)
    # Row a of the matrix says which old axis (x, y, z) the new axis a is, and its sign.
    old = np.abs(matrix).argmax(1)
    moved = values.transpose([2 - old[2], 2 - old[1], 2 - old[0]])
    for axis in range(3):
        if matrix[axis, old[axis]] < 0:
            moved = np.flip(moved, 2 - axis)
    odd = np.linalg.det(matrix) < 0
    expected = picture(renderer, values, kind=kind)
    actual = picture(renderer, moved, matrix=matrix, light=LIGHT * ((-1, 1, 1) if odd else 1), kind=kind)
    assert_close(actual[:, ::-1] if odd else actual, expected, FLOAT32_HARD, f"turned {turn} {kind}")
    # Negative control: the picture does know its handedness.
    assert not distance(actual if odd else actual[:, ::-1], expected).within(FLOAT32_HARD)


@QUICK
@given(
    seed=SEEDS,
    scale=st.floats(-6, 6).map(lambda exponent: 10.0**exponent),
    origin=st.tuples(*[st.floats(-1e3, 1e3)] * 3),
    kind=KINDS,
)
def test_the_unit_of_length_and_the_place_do_not_matter(renderer, seed, scale, origin, kind):
    values = samples(seed)
    expected = picture(renderer, values, kind=kind)
    moved = {"spacing": (scale,) * 3, "origin": np.array(origin) * scale, "scale": scale, "kind": kind}
    assert_close(picture(renderer, values, **moved), expected, FLOAT32_HARD, f"moved {scale:g} {kind}")
    # Negative control: a camera that is not moved along sees something else.
    assert not distance(picture(renderer, values, **{**moved, "scale": scale * 1.01}), expected).within(FLOAT32_HARD)


@QUICK
@given(seed=SEEDS, scale=st.floats(-20, 20).map(lambda exponent: 10.0**exponent), kind=KINDS)
def test_the_unit_of_values_does_not_matter(renderer, seed, scale, kind):
    values = samples(seed)
    points = POINTS * np.array([scale, 1, 1, 1, 1])
    expected = picture(renderer, values, kind=kind)
    assert_close(
        picture(renderer, values * scale, points=points, kind=kind), expected, FLOAT32_HARD, f"values times {scale:g}"
    )
    assert not distance(picture(renderer, values * scale * 1.01, points=points, kind=kind), expected).within(
        FLOAT32_HARD
    )


@QUICK
@given(seed=SEEDS, share=st.floats(-2, 3), kind=KINDS)
def test_a_field_may_be_split_in_two(renderer, seed, share, kind):
    values = samples(seed)
    expected = picture(renderer, values, kind=kind)
    parts = [values * share, values * (1 - share)]
    assert_close(picture(renderer, parts, kind=kind), expected, FLOAT32_HARD, f"split at {share:g}")
    assert not distance(picture(renderer, [*parts, values * 0.01], kind=kind), expected).within(FLOAT32_HARD)


@QUICK
@given(seed=SEEDS, back=st.floats(-20, 1000))
def test_slices_do_not_know_how_far_the_eye_is(renderer, seed, back):
    """Slices hang on the field: an orthographic camera may go to and fro along its view, by parts of a slice too."""
    values = samples(seed)
    expected = picture(renderer, values, slice_spacing=0.7)
    assert_close(picture(renderer, values, slice_spacing=0.7, back=back), expected, FLOAT32_HARD, f"back {back:g}")
    assert not distance(picture(renderer, values, slice_spacing=1.1, back=back), expected).within(FLOAT32_HARD)


@QUICK
@given(seed=SEEDS, mode=st.sampled_from(["xray", "mip"]), scale=st.floats(0.1, 10))
def test_scalar_modes_are_linear(renderer, seed, mode, scale):
    values = samples(seed)
    expected = picture(renderer, values, mode=mode)
    actual = picture(renderer, values * scale, mode=mode)
    assert_close(actual / scale, expected, FLOAT32_HARD, f"{mode} times {scale:g}")


@QUICK
@given(seed=SEEDS, pieces=st.integers(5, 30), per_clear=st.integers(1, 40))
@pytest.mark.gl
def test_the_edges_of_tiles_do_not_show(gl_renderer, seed, pieces, per_clear):
    values = samples(seed)
    expected = picture(gl_renderer, values)
    tiled = ss.Renderer("gl", tile_size=pieces, tags_per_clear=per_clear)
    assert_close(picture(tiled, values), expected, FLOAT32_HARD, f"tiles of {pieces}, {per_clear} tags")
