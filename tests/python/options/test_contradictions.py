"""Options that do not go together, and effects that a mode or a backend cannot have: errors that name both sides."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import sheetsplat as ss

SIZE = (24, 20)
OCCLUSION = ss.AmbientOcclusion(1.0)
CUE = ss.DepthCue(0.0, 1.0)
ISO: dict[str, Any] = {"mode": "isosurface", "iso_value": 0.5}
LIGHT = ss.Light((0, 0, 1))


def volume() -> ss.RegularField:
    """Return a small volume of values between 0 and 1."""
    return ss.RegularField(np.random.default_rng(2).random((6, 6, 6), dtype=np.float32))


def ellipsoids() -> ss.EllipsoidField:
    """Return a few kernels that are no spheres."""
    rng = np.random.default_rng(2)
    return ss.EllipsoidField(rng.normal(size=(6, 3)), rng.uniform(0.4, 0.9, (6, 3)), values=rng.random(6))


def scene_of(field: Any = None, **options: Any) -> ss.Scene:
    """Return a scene."""
    return ss.Scene(volume() if field is None else field, [(0, 1, 1, 1, 0), (1, 1, 1, 1, 0.5)], **options)


def plan_of(scene: ss.Scene, backend: str, kind: str = "orthographic", **settings: Any) -> ss.RenderPlan:
    """Return the plan of a scene."""
    camera = ss.Camera.fit(scene.fields, kind=kind)
    return ss.Renderer(backend, **settings).plan(scene, camera, size=SIZE)  # type: ignore[arg-type]


def expect_parts(message: str, parts: tuple[str, ...]) -> None:
    """Expect all four parts of an error, and these words."""
    assert "found" in message and "wanted" in message
    for part in parts:
        assert part in message, message


@pytest.mark.parametrize("mode", ["isosurface", "xray", "mip"])
@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"preintegration": True}, "preintegration"),
        ({"preintegration": "second_order"}, "preintegration"),
        ({"gradient_opacity": 0.5}, "gradient_opacity"),
    ],
)
def test_what_only_opacities_have(mode: str, options: dict[str, Any], name: str) -> None:
    """Intervals and faded opacities are of mode composite alone."""
    with pytest.raises(ss.InvalidInput) as caught:
        plan_of(scene_of(mode=mode, iso_value=0.5, **options), "reference")
    expect_parts(str(caught.value), (name, f'mode="{mode}"', 'mode="composite"'))


@pytest.mark.parametrize("mode", ["xray", "mip"])
@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"depth_cue": CUE}, "depth_cue"),
        ({"shadows": True}, "shadows"),
        ({"ambient_occlusion": OCCLUSION}, "ambient_occlusion"),
    ],
)
def test_what_only_colours_have(mode: str, options: dict[str, Any], name: str) -> None:
    """Scalar modes show numbers, to which light and colours say nothing."""
    with pytest.raises(ss.InvalidInput) as caught:
        plan_of(scene_of(mode=mode, lights=[LIGHT], **options), "reference")
    expect_parts(str(caught.value), (name, f'mode="{mode}"'))


@pytest.mark.parametrize(
    ("options", "name"), [({"shadows": True}, "shadows"), ({"ambient_occlusion": OCCLUSION}, "ambient_occlusion")]
)
def test_what_lies_between_is_seen_without_gradients(options: dict[str, Any], name: str) -> None:
    """Shadows and occlusion do not go together with gradient opacity."""
    with pytest.raises(ss.InvalidInput) as caught:
        plan_of(scene_of(lights=[LIGHT], gradient_opacity=0.25, **options), "reference")
    expect_parts(str(caught.value), (name, "gradient_opacity=0.25"))


@pytest.mark.parametrize("backend", ["reference", "cpu", pytest.param("gl", marks=pytest.mark.gl)])
def test_what_goes_together(backend: str) -> None:
    """What is close to a contradiction and is none; what it leaves without work says so."""
    for options in (
        ISO | {"lights": [LIGHT], "depth_cue": CUE, "shadows": True, "ambient_occlusion": OCCLUSION},
        {"mode": "xray", "clip": ss.Clip(planes=[((1, 0, 0), 2.0)])},
        {"preintegration": "second_order", "lights": [LIGHT], "gradient_opacity": 0.5, "gradient": "analytic"},
        {"shadows": True},
        {"ambient_occlusion": OCCLUSION},
    ):
        plan = plan_of(scene_of(**options), backend)
        assert len(plan.effects) > 20
    shadows = next(effect for effect in plan_of(scene_of(shadows=True), backend).effects if effect.name == "shadows")
    assert not shadows.on and "there are no lights" in shadows.reason


@pytest.mark.parametrize("backend", ["cpu", pytest.param("gl", marks=pytest.mark.gl)])
def test_gradients_forced_on_in_scalar_modes(backend: str) -> None:
    """A scalar picture has no normals, whoever asks."""
    with pytest.raises(ss.InvalidInput) as caught:
        plan_of(scene_of(mode="xray"), backend, effects={"gradient": True})
    expect_parts(str(caught.value), ("gradient", "scalar mode", "composite"))


@pytest.mark.parametrize(
    ("backend", "settings", "parts"),
    [
        pytest.param("gl", {"precision": "float64"}, ("float64", "backend gl", 'backend="cpu"'), marks=pytest.mark.gl),
        ("cpu", {"precision": "float16", "allow_inexact": True}, ("float16", "backend cpu", 'backend="gl"')),
        ("cpu", {"precision": "uint8", "allow_inexact": True}, ("uint8", "backend cpu", 'backend="gl"')),
        ("reference", {"precision": "float32"}, ("float32", "backend reference", 'backend="cpu"')),
        ("cpu", {"packing": "paper"}, ("packing paper", "backend cpu", 'backend="gl"')),
        ("cpu", {"tagging": "depth_equal"}, ("tagging depth_equal", "backend cpu", 'backend="gl"')),
        ("cpu", {"tagging": "off"}, ("tagging off", "backend cpu", 'backend="gl"')),
        ("cpu", {"effects": {"fine_gradient": True}}, ("fine_gradient", "backend cpu", 'backend="gl"')),
        ("cpu", {"effects": {"opacity_buffer": True}}, ("opacity_buffer", "backend cpu", 'backend="gl"')),
    ],
)
def test_settings_that_a_backend_does_not_have(backend: str, settings: dict[str, Any], parts: tuple[str, ...]) -> None:
    """The error names the setting, the backend, and the one that has it."""
    with pytest.raises(ss.Unsupported) as caught:
        plan_of(scene_of(), backend, **settings)
    expect_parts(str(caught.value), parts)
    assert caught.value.option == next(iter(settings))


@pytest.mark.gl
@pytest.mark.parametrize(
    ("field", "kind", "options", "effects", "parts"),
    [
        (None, "orthographic", {}, {"paper_slicing": True}, ("paper_slicing", "without scattered ellipsoids")),
        (ellipsoids, "perspective", {}, {"paper_slicing": True}, ("paper_slicing", "perspective camera")),
        (ellipsoids, "orthographic", {"sampling": "slab"}, {"paper_slicing": True}, ("paper_slicing", "slab sampling")),
        (ellipsoids, "orthographic", {"filter": "ewa"}, {"paper_slicing": True}, ("paper_slicing", "a filter")),
        (
            ellipsoids,
            "orthographic",
            {},
            {"resident_sections": True, "paper_slicing": True},
            ("paper_slicing", "effect resident_sections"),
        ),
        (None, "orthographic", {"lights": [LIGHT]}, {"gradient": False}, ("gradient", "allow_inexact")),
    ],
)
def test_effects_that_do_not_go_together(
    field: Any, kind: str, options: dict[str, Any], effects: dict[str, bool], parts: tuple[str, ...]
) -> None:
    """Ways of drawing that are for comparison say what of the scene, or which other effect, they do not go with."""
    scene = scene_of(None if field is None else field(), **options)
    with pytest.raises(ss.Unsupported) as caught:
        plan_of(scene, "gl", kind, effects=effects)
    expect_parts(str(caught.value), parts)


@pytest.mark.gl
def test_paper_slicing_draws_effects_beyond_the_papers_or_refuses_them() -> None:
    """The 2006 paper has no clip, depth cue or gradient opacity."""
    low, high = ellipsoids().bounds
    middle = 0.5 * (float(low[0]) + float(high[0]))
    for options in (
        {"clip": ss.Clip(planes=[((1, 0, 0), middle)])},
        {"depth_cue": ss.DepthCue(0.0, 9.0, (1, 0, 0))},
        {"lights": [LIGHT], "gradient": "analytic"},
        {"gradient_opacity": 0.3},
    ):
        scene = scene_of(ellipsoids(), **options)
        camera = ss.Camera.fit(scene.fields)
        try:
            image = ss.Renderer("gl", effects={"paper_slicing": True}).render(scene, camera, size=SIZE)
        except ss.Unsupported as error:
            assert error.option == "effects"
            continue
        expected = ss.Renderer("reference").render(scene, camera, size=SIZE)
        assert np.abs(image.pixels - expected.pixels).max() < 1e-3, options


def test_isosurfaces_need_a_value_and_fields_go_together() -> None:
    """Mode isosurface without its value; the words name both."""
    with pytest.raises(ss.InvalidInput) as caught:
        plan_of(scene_of(mode="isosurface"), "reference")
    expect_parts(str(caught.value), ("iso_value", 'mode="isosurface"'))


@pytest.mark.parametrize("given", ["third_order", 2, "True", None])
def test_pre_integration_is_one_of_three(given: object) -> None:
    """True, False or "second_order"."""
    with pytest.raises(ss.InvalidInput, match="preintegration"):
        scene_of(preintegration=given)


@pytest.mark.parametrize("wrong", [np.array(1.0), 3, "xyz", [(1, 0, 0)], [((0, 0, 0), 1)], [((1, 0, 0), float("nan"))]])
def test_clips_of_no_planes_say_what_was_wanted(wrong):
    with pytest.raises(ss.InvalidInput, match="Clip"):
        ss.Clip(planes=wrong)


@pytest.mark.parametrize(
    "wrong", [np.array(1.0), 3, "ab", [(0, 0, 0)], ((1, 0, 0), (0, 1, 1)), ((0, 0, 0), (1, 1, np.inf))]
)
def test_clips_of_no_box_say_what_was_wanted(wrong):
    with pytest.raises(ss.InvalidInput, match="Clip: box"):
        ss.Clip(box=wrong)
