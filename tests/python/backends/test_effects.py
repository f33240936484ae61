"""Plans turn on only the effects that a scene needs: forcing others changes nothing; plans state each one's error."""

from __future__ import annotations

import json
import logging
import math
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from image_checks import FLOAT32, FLOAT32_HARD, distance

import sheetsplat as ss
from sheetsplat import _sheetsplat as native
from sheetsplat.cli.main import main as command_line

SIZE = (44, 36)
BACKENDS = [pytest.param("gl", marks=pytest.mark.gl), "cpu"]


def forcible(backend: str) -> list[str]:
    """Return the names that a backend says it can force."""
    return [name for name, _, _, _, forced_by in native.known_effects() if backend in forced_by]


def test_the_table_of_effects_in_the_docs_is_the_engines() -> None:
    """Each effect, once, with its backends and its meaning; forcible ones have a star."""
    shown = {"gl": "gl", "cpu": "cpu"}
    rows = []
    for name, meaning, _, listed, forced_by in native.known_effects():
        backends = ", ".join(shown[b] + (" *" if b in forced_by else "") for b in listed if b in shown)
        rows.append(f"| `{name}` | {backends} | {meaning} |")
    text = (Path(__file__).parents[3] / "python" / "docs" / "effects.md").read_text(encoding="utf-8")
    table = text[text.index("| effect | backends | on means |") :].split("\n\n")[0].splitlines()[2:]
    assert table == rows, "\n".join(rows)


def some_field(rng: np.random.Generator, kind: int, boundary: str = "edge") -> ss.RegularField | ss.EllipsoidField:
    """Return a lattice, spheres or ellipsoids, values mostly between 0 and 1."""
    if kind == 0:
        values = rng.random((7, 8, 9), dtype=np.float32)
        return ss.RegularField(values, normalization=str(rng.choice(["lattice", "threshold"])), boundary=boundary)
    centers = rng.normal(size=(40, 3))
    values = rng.random(40)
    if kind == 1:
        return ss.EllipsoidField(centers, rng.uniform(0.3, 0.9, 40), values=values)
    rotations = rng.normal(size=(40, 4))
    rotations /= np.linalg.norm(rotations, axis=1, keepdims=True)
    return ss.EllipsoidField(centers, rng.uniform(0.2, 1.0, (40, 3)), rotations, values)


def some_scene(seed: int, boundary: str = "edge") -> tuple[ss.Scene, ss.Camera]:
    """Return a scene of which each effect is called for by some seeds and not by others."""
    rng = np.random.default_rng(seed)
    fields: list[ss.RegularField | ss.EllipsoidField] = [some_field(rng, seed % 3, boundary)]
    if rng.random() < 0.3:
        fields.append(some_field(rng, int(rng.integers(3)), boundary))
    # Without steps and with opacity 0 at 0, only the opacity stop makes ambiguous pixels.
    points = [(0.0, *rng.random(3), 0.0), (0.4, *rng.random(3), 0.1 * rng.random()), (1.0, *rng.random(3), 0.4)]
    lit = rng.random() < 0.6
    scene = ss.Scene(
        fields,
        points,
        lights=[ss.Light(rng.normal(size=3), space=str(rng.choice(["eye", "world"])))] if lit else (),  # type: ignore[arg-type]
        material=ss.Material(specular=float(rng.choice([0.0, 0.4])), two_sided=bool(rng.random() < 0.5)),
        mode=str(rng.choice(["composite", "composite", "composite", "xray", "mip"])),  # type: ignore[arg-type]
        opacity_stop=1.0 if rng.random() < 0.5 else 0.98,
        background=(0.1, 0.2, 0.3) if rng.random() < 0.3 else None,
    )
    direction = rng.normal(size=3)
    kind = "perspective" if rng.random() < 0.4 else "orthographic"
    return scene, ss.Camera.fit(scene.fields, direction=direction, kind=kind)


def idle_scene(seed: int) -> tuple[ss.Scene, ss.Camera]:
    """Return a scene that asks for effects by numbers that change nothing, which the plan finds out."""
    scene, camera = some_scene(seed)
    low, high = scene.bounds
    wide = [(np.subtract(low, 9.0)).tolist(), (np.add(high, 9.0)).tolist()]
    scene = scene.replace(
        mode="composite",
        clip=ss.Clip(planes=[((1.0, 0.0, 0.0), float(low[0]) - 5.0)], box=wide),
        depth_cue=ss.DepthCue(0.0, 1.0, (1.0, 0.0, 0.0), 0.0),
        ambient_occlusion=ss.AmbientOcclusion(1.0, 0.0),
    )
    return scene, camera


def forcing(backend: str, name: str = "", on: bool = True, allow_inexact: bool = False) -> ss.Renderer:
    """Return a renderer that forces an effect on or off, or none."""
    return ss.Renderer(backend, effects={name: on} if name else {}, allow_inexact=allow_inexact)  # type: ignore[arg-type]


def row(plan: ss.RenderPlan, name: str) -> ss.Effect:
    """Return an effect of a plan."""
    return next(effect for effect in plan.effects if effect.name == name)


def check_forced_on(backend: str, names: list[str], scenes: list[tuple[ss.Scene, ss.Camera]]) -> set[str]:
    """Force each effect on where the plan leaves it out. Returns those that were drawn so at least once."""
    drawn: set[str] = set()
    chosen = forcing(backend)
    plains = [chosen.render(scene, camera, size=SIZE) for scene, camera in scenes]
    for name in names:
        # One at a time: each keeps the programs that OpenGL has compiled for it.
        forced = forcing(backend, name)
        for number, ((scene, camera), plain) in enumerate(zip(scenes, plains, strict=True)):
            if name not in {effect.name for effect in plain.plan.effects if not effect.on}:
                continue
            try:
                picture = forced.render(scene, camera, size=SIZE)
            except (ss.Unsupported, ss.InvalidInput):
                # What does not fit the scene at all is refused, not drawn wrong: no gradient in scalar modes, no
                # elimination on a backend without it.
                continue
            if not row(picture.plan, name).on:
                continue
            drawn.add(name)
            found = distance(picture.pixels, plain.pixels)
            assert found.within(FLOAT32), f"{name} forced on, scene {number}: {found}\n{row(picture.plan, name)}"
    return drawn


@pytest.mark.parametrize("backend", [pytest.param("gl", marks=[pytest.mark.gl, pytest.mark.slow]), "cpu"])
def test_what_the_plan_left_out_changes_nothing_when_forced_on(backend: str) -> None:
    """In random scenes, and in scenes whose options request effects with parameters that have no effect."""
    names = forcible(backend)
    # Shaders are compiled for each scene and effect.
    count = 4 if backend == "gl" else 10
    scenes = [some_scene(seed) for seed in range(count)] + [idle_scene(20)]
    drawn = check_forced_on(backend, names, scenes)
    everywhere = {"weight", "gradient", "empty_test", "opacity_correction", "opacity_stop"}
    assert everywhere | {"clip", "depth_cue", "ambient_occlusion"} <= drawn, drawn
    if backend == "gl":
        # Effects that are on wherever they can be cannot be forced on: culling.
        assert {"fine_gradient", "compensation", "opacity_buffer", "precise_sections"} <= drawn


@pytest.mark.slow
@pytest.mark.parametrize("backend", BACKENDS)
def test_what_the_plan_left_out_changes_nothing_on_measured_data(backend: str, data_dir: Path) -> None:
    """The same over the measured volumes, reduced to one sample in eight along each axis."""
    files = sorted(data_dir.glob("*.nrrd")) + sorted(data_dir.glob("*.npy")) + sorted(data_dir.glob("**/*.nrrd"))
    scenes = []
    for file in dict.fromkeys(files):
        try:
            field = ss.open(file)
        except ss.Error:
            continue
        if not isinstance(field, ss.RegularField) or field.size > 40e6:
            continue
        step = max(1, round((field.size / 30e3) ** (1 / 3)))
        values = np.asarray(field.values)[::step, ::step, ::step].astype(np.float32)
        low, high = float(values.min()), float(values.max())
        if high <= low or min(values.shape) < 2:
            continue
        reduced = ss.RegularField(values)
        points = [(low, 1, 1, 1, 0.0), (low + 0.3 * (high - low), 1, 0.5, 0.2, 0.0), (high, 1, 1, 1, 0.5)]
        lights = [ss.Light((1, 1, 1))] if len(scenes) % 2 else []
        scenes.append((ss.Scene(reduced, points, lights=lights), ss.Camera.fit(reduced, direction=(1, 0.4, -0.8))))
        if len(scenes) == 3:
            break
    if not scenes:
        pytest.skip(f"no volume that can be read in {data_dir}")
    names = [name for name in forcible(backend) if name not in ("fine_gradient", "paper_slicing")]
    assert "weight" in check_forced_on(backend, names, scenes)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("boundary", ["edge", "zero"])
def test_what_the_scene_calls_for_matters(boundary: str, backend: str) -> None:
    """Negative control: leaving out a needed effect changes the picture."""
    scene, camera = some_scene(0, boundary)
    low, high = scene.bounds
    middle = 0.5 * (float(low[0]) + float(high[0]))
    scene = scene.replace(
        mode="composite",
        lights=[ss.Light((1.0, 1.0, 1.0))],
        material=ss.Material(specular=0.5),
        clip=ss.Clip(planes=[((1.0, 0.0, 0.0), middle)]),
        depth_cue=ss.DepthCue(0.0, 30.0, (0.0, 0.0, 1.0)),
        # Where volumes do not fall to 0, gradients are weaker.
        gradient_opacity=5.0 if boundary == "zero" else 0.5,
        slice_spacing=0.7,
        opacity_stop=1.0,
    )
    plain = forcing(backend).render(scene, camera, size=SIZE)
    for name in ("gradient", "specular", "opacity_correction", "clip", "depth_cue", "gradient_opacity"):
        assert row(plain.plan, name).on, name
        with pytest.raises(ss.Unsupported, match=name):
            forcing(backend, name, on=False).render(scene, camera, size=SIZE)
        without = forcing(backend, name, on=False, allow_inexact=True).render(scene, camera, size=SIZE)
        found = distance(without.pixels, plain.pixels)
        assert not found.within(FLOAT32_HARD), f"{name}: {found}"


@pytest.mark.parametrize("backend", [*BACKENDS, "reference"])
def test_every_backend_lists_every_effect(backend: str) -> None:
    """Each with a reason, once; and the same answer to what follows from the scene."""
    scene, camera = some_scene(1)
    plan = ss.Renderer(backend).plan(scene, camera, size=SIZE)  # type: ignore[arg-type]
    names = [effect.name for effect in plan.effects]
    assert len(names) == len(set(names))
    wanted = """normalization weight gradient eye_lights world_lights specular two_sided clip preintegration
        second_order opacity_stop elimination tagging opacity_buffer ewa_filter perspective slab_sampling
        several_fields isosurface ambient_only background coverage depth gradient_opacity shadows
        ambient_occlusion depth_cue analytic_gradient separate_normalization culling empty_test
        opacity_correction classification sums""".split()
    assert not set(wanted) - set(names)
    assert all(len(effect.reason) > 10 for effect in plan.effects)
    of_scene = set(wanted) - {"elimination", "tagging", "opacity_buffer", "culling"}
    other = ss.Renderer("reference").plan(scene, camera, size=SIZE)
    assert {n for n in of_scene if plan.has(n)} == {n for n in of_scene if other.has(n)}


def test_ambient_light_alone_needs_no_gradient() -> None:
    """Where materials reflect ambient light alone, both backends draw the reference's picture without normals."""
    scene, camera = some_scene(0)
    scene = scene.replace(mode="composite", lights=[ss.Light((1, 0, 1))], material=ss.Material(0.3, 0.0, 0.0))
    expected = ss.Renderer("reference").render(scene, camera, size=SIZE)
    assert expected.plan.has("ambient_only")
    bright = ss.Renderer("cpu").render(scene.replace(lights=()), camera, size=SIZE)
    for backend in ("gl", "cpu"):
        try:
            picture = ss.Renderer(backend).render(scene, camera, size=SIZE)  # type: ignore[arg-type]
        except ss.DeviceUnavailable:
            continue
        assert picture.plan.has("ambient_only") and not picture.plan.has("gradient")
        assert distance(picture.pixels, expected.pixels).within(FLOAT32)
        assert not distance(picture.pixels, bright.pixels).within(FLOAT32_HARD)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("ambient_only", [False, True])
def test_light_from_volumes_keeps_the_error_that_it_owes(backend: str, ambient_only: bool) -> None:
    """The error of shadows and occlusion is at most what the plan states, and less than their effect."""
    for seed in (0, 6):
        scene, camera = some_scene(seed)
        material = ss.Material(0.4, 0.0) if ambient_only else ss.Material(0.2, 0.8)
        scene = scene.replace(mode="composite", lights=[ss.Light((1, 0.6, 0.4))], material=material, opacity_stop=1.0)
        for options in ({"shadows": True}, {"ambient_occlusion": ss.AmbientOcclusion(2.0)}):
            name = next(iter(options))
            expected = ss.Renderer("reference").render(scene.replace(**options), camera, size=SIZE)
            image = ss.Renderer(backend).render(scene.replace(**options), camera, size=SIZE)  # type: ignore[arg-type]
            assert row(image.plan, name).on == (name != "shadows" or not ambient_only)
            found = distance(image.pixels, expected.pixels).rmse
            assert found <= image.plan.expected_error, f"{name}: {found}\n{image.plan}"
            assert not image.plan.has("gradient") or not ambient_only
            if row(image.plan, name).on:
                plain = ss.Renderer("reference").render(scene, camera, size=SIZE)
                assert row(image.plan, name).error > 0
                assert 3 * found < distance(plain.pixels, expected.pixels).rmse


@pytest.mark.parametrize("backend", [*BACKENDS, "reference"])
def test_a_clip_that_leaves_nothing_gives_an_empty_picture(backend: str) -> None:
    """Whatever else is asked for."""
    scene, camera = some_scene(0)
    scene = scene.replace(mode="composite", clip=ss.Clip(box=((90, 90, 90), (91, 91, 91))), background=(0.1, 0.2, 0.3))
    image = ss.Renderer(backend).render(scene, camera, size=SIZE, outputs=("coverage", "depth"))  # type: ignore[arg-type]
    assert image.plan.has("clip") and "cuts off all" in row(image.plan, "clip").reason
    assert np.allclose(image.rgba, [0.1, 0.2, 0.3, 1.0])
    assert not image.coverage.any() and np.isinf(image.depth).all()  # type: ignore[union-attr]


@pytest.mark.parametrize("backend", [*BACKENDS, "reference"])
def test_values_that_do_not_occur_call_for_nothing(backend: str) -> None:
    """A transfer function that shows only what the data does not have leaves light and the stop out."""
    rng = np.random.default_rng(5)
    field = ss.RegularField(rng.random((8, 8, 8), dtype=np.float32))
    scene = ss.Scene(field, [(1.1, 1, 1, 1, 0), (2, 1, 1, 1, 1)], lights=[ss.Light((0, 0, 1))])
    image = ss.Renderer(backend).render(scene, ss.Camera.fit(field), size=SIZE)  # type: ignore[arg-type]
    assert not any(image.plan.has(name) for name in ("gradient", "specular", "eye_lights", "opacity_stop"))
    assert "opacity is 0 over all values that can occur" in row(image.plan, "gradient").reason
    assert not image.pixels.any()


def test_a_renderer_lets_go_of_fields_that_it_drew() -> None:
    """Facts about a field that a renderer keeps do not keep the field alive, on any backend."""
    for backend in ("reference", "cpu"):
        renderer = ss.Renderer(backend)  # type: ignore[arg-type]
        before = resident()
        for seed in range(12):
            field = ss.RegularField(np.random.default_rng(seed).random((100, 100, 100), dtype=np.float32))
            scene = ss.Scene(field, [(0, 1, 1, 1, 0), (1, 1, 1, 1, 0.5)])
            renderer.plan(scene, ss.Camera.fit(field), size=(8, 8))
            del field, scene
        # Two at a time are 8 MB; all twelve are 48.
        assert resident() - before < 30e6


def resident() -> int:
    """Return the bytes of memory that this process has."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) * 1024
    pytest.skip("no /proc/self/status here")


@pytest.mark.gl
def test_programs_are_compiled_only_to_be_used() -> None:
    """As many shader variants as are used; a second picture adds none, another light's colour neither."""
    renderer = ss.Renderer("gl")
    compiled = []
    scene, camera = some_scene(0)
    scene = scene.replace(mode="composite", lights=(), gradient_opacity=None)
    lit = scene.replace(lights=[ss.Light((0, 0, 1))])
    red = scene.replace(lights=[ss.Light((0, 1, 1), (1, 0, 0))])
    for drawn in (scene, scene, lit, lit, red, scene):
        stats = renderer.render(drawn, camera, size=SIZE).stats
        assert stats["programs"] == stats["programs_used"] > 0
        compiled.append(stats["programs"])
    assert compiled[0] == compiled[1] < compiled[2] == compiled[3] == compiled[4] == compiled[5]


def test_unknown_effects_are_told_by_backend() -> None:
    """The names are those of the backend that draws; what cannot be forced says what decides it."""
    scene, camera = some_scene(0)
    for backend, has, lacks in (
        ("cpu", "culling", "opacity_buffer"),
        ("reference", "draws what the scene says", "culling"),
    ):
        with pytest.raises(ss.InvalidInput, match=has) as caught:
            ss.Renderer(backend, effects={"nonsense": True}).plan(scene, camera, size=SIZE)  # type: ignore[arg-type]
        assert lacks not in str(caught.value)
    for backend, wrong, near in (
        ("cpu", "opacity_corection", "did you mean opacity_correction"),
        ("gl", "Elimination", "did you mean elimination"),
        ("auto", "compensate", "did you mean compensation"),
        ("auto", "stop", "did you mean opacity_stop"),
        ("cpu", "zzz", "correct the name in effects"),
    ):
        with pytest.raises(ss.InvalidInput, match=near) as caught:
            ss.Renderer(backend, effects={"culling": True, wrong: False})  # type: ignore[arg-type]
        assert caught.value.option == "effects" and wrong in str(caught.value.found)
    with pytest.raises(ss.InvalidInput, match=r"float64.*precision"):
        ss.Renderer("cpu", effects={"float64": True}).plan(scene, camera, size=SIZE)
    with pytest.raises(ss.InvalidInput, match=r"perspective.*camera"):
        ss.Renderer("cpu", effects={"perspective": True}).plan(scene, camera, size=SIZE)


def test_the_reference_says_that_nothing_can_be_forced(caplog: pytest.LogCaptureFixture) -> None:
    """The reference draws the scene as defined; a warning says that it ignores forced effects."""
    scene, camera = some_scene(0)
    with caplog.at_level(logging.WARNING, logger="sheetsplat"):
        plan = ss.Renderer("reference", effects={"weight": True}).plan(scene, camera, size=SIZE)
    assert "weight" in caplog.text
    assert not any(effect.forced for effect in plan.effects)


@pytest.mark.parametrize("backend", [*BACKENDS, "reference"])
def test_what_effects_owe_is_the_budget(backend: str) -> None:
    """The squares of the effects' errors add up to that of all causes."""
    for seed in (0, 1, 4):
        scene, camera = some_scene(seed)
        plan = ss.Renderer(backend).plan(scene, camera, size=SIZE)  # type: ignore[arg-type]
        owed = math.hypot(*(effect.error for effect in plan.effects))
        assert owed == pytest.approx(plan.expected_error, rel=1e-9)
        assert plan.expected_error == pytest.approx(math.hypot(*plan.error_budget.values()), rel=1e-9)
        assert (plan.expected_error > 0) == (backend != "reference")
        assert all(effect.on for effect in plan.effects if effect.error > 0)


@pytest.mark.slow
def test_costs_are_measured() -> None:
    """Each effect that can be turned the other way has milliseconds; what the scene needs costs something."""
    values = np.random.default_rng(3).random((24, 24, 24), dtype=np.float32)
    field = ss.RegularField(values)
    scene = ss.Scene(
        field,
        [(0, 1, 1, 1, 0), (1, 1, 1, 1, 0.1)],
        lights=[ss.Light((0, 0, 1))],
        gradient="analytic",
        opacity_stop=1.0,
    )
    plan = ss.Renderer("cpu").measure_effects(scene, ss.Camera.fit(field), size=(90, 90), repeats=5)
    assert plan.picture_ms is not None and plan.picture_ms > 0
    cost = {effect.name: effect.cost_ms for effect in plan.effects}
    for name in ("gradient", "analytic_gradient", "weight", "specular", "culling", "coverage"):
        assert cost[name] is not None, name
    for name in ("perspective", "classification", "sums", "clip", "ewa_filter"):
        assert cost[name] is None, name
    assert not any(effect.forced for effect in plan.effects)
    # Three sums more for each that there is: about half of the picture. Noise is some per cent.
    assert cost["analytic_gradient"] > 0.1 * plan.picture_ms  # type: ignore[operator]
    text = str(plan)
    assert f"{cost['gradient']:.2f}" in text and f"({cost['weight']:.2f})" in text
    with pytest.raises(ss.InvalidInput, match="repeats"):
        ss.Renderer("cpu").measure_effects(scene, ss.Camera.fit(field), repeats=0)


def test_the_command_line_shows_and_measures(tmp_path: Path) -> None:
    """A table of effects with the error owed; with --measure milliseconds too; both as JSON."""
    np.save(tmp_path / "a.npy", np.random.default_rng(3).random((8, 8, 8), dtype=np.float32))
    arguments = ["plan", str(tmp_path / "a.npy"), "--backend", "cpu", "--size", "32x32"]
    shown = CliRunner().invoke(command_line, arguments)
    assert shown.exit_code == 0 and re.search(r"effect +error +why", shown.output), shown.output
    assert re.search(r"^sums +on +\d\.\de-\d+ ", shown.output, re.MULTILINE)
    result = CliRunner().invoke(command_line, [*arguments, "--measure", "--repeats", "1", "--json"])
    assert result.exit_code == 0, result.output
    plan = json.loads(result.output[result.output.index("{") :])
    costs = {effect["name"]: effect["cost_ms"] for effect in plan["effects"]}
    assert plan["picture_ms"] > 0 and isinstance(costs["weight"], float) and costs["perspective"] is None
    assert {"error", "on", "reason"} <= set(plan["effects"][0])
    table = CliRunner().invoke(command_line, [*arguments, "--measure", "--repeats", "1"])
    assert re.search(r"effect +error +ms +why", table.output), table.output


@pytest.mark.parametrize("radius", [1e10, 1e30, 1e300])
def test_occlusion_looks_no_further_than_the_data(radius):
    """However far it looks, beyond the data nothing is in the way."""
    field = ss.RegularField(np.random.default_rng(0).random((7, 7, 7)).astype(np.float32))

    def drawn(distance):
        scene = ss.Scene(
            field, [(0, 1, 1, 1, 0), (1, 1, 1, 1, 0.5)], ambient_occlusion=ss.AmbientOcclusion(distance, 0.7)
        )
        return ss.Renderer("cpu").render(scene, ss.Camera.fit(field), size=(16, 16)).rgba

    np.testing.assert_array_equal(drawn(radius), drawn(1e5))
