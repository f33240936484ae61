"""Random scenes (fields, cameras, transfer functions, settings), judged by invariants.

A backend draws a scene as it is, with its kernels in another order, each split into two, in another unit of length, at
another place, or with tiles of its own; all of it must be the reference's picture of the scene within section 9, or a
clear error. SHEETSPLAT_FUZZ is the number of scenes, 40 unless set; with it they are drawn anew at each run.
"""

from __future__ import annotations

import copy
import os
from collections.abc import Callable
from typing import Any

import numpy as np
import oracle
import pytest
import scene_parts
from hypothesis import HealthCheck, Phase, event, given, note, settings
from hypothesis import strategies as st
from image_checks import FLOAT32, FLOAT32_HARD, MOST_AMBIGUOUS, off_by, within
from numpy.typing import NDArray
from reference_pictures import changed_pixels, may_jump, nudges
from scene_parts import Parts

import sheetsplat as ss

AMOUNT = os.environ.get("SHEETSPLAT_FUZZ", "")
FUZZ = settings(
    max_examples=int(AMOUNT or 40),
    deadline=None,
    derandomize=not AMOUNT,
    database=None,
    phases=(Phase.explicit, Phase.generate) if not AMOUNT else (Phase.explicit, Phase.generate, Phase.shrink),
    suppress_health_check=list(HealthCheck),
    print_blob=bool(AMOUNT),
)
BACKENDS = [pytest.param("gl", marks=pytest.mark.gl), "cpu"]
# Keeps the reference fast.
MOST_SLICES = 60

share = st.floats(0, 1, allow_subnormal=False)
seeds = st.integers(0, 2**16)


def decades(low: float, high: float) -> st.SearchStrategy[float]:
    """Return numbers whose logarithms are spread evenly."""
    return st.floats(low, high).map(lambda exponent: float(10.0**exponent))


def seldom(draw: st.DrawFn, often: Any, otherwise: st.SearchStrategy[Any], one_in: int = 5) -> Any:
    """Return what is usual, or once in so many times something else."""
    return draw(otherwise) if draw(st.integers(1, one_in)) == one_in else often


# By itself, or given.
bases = st.one_of(
    st.just({}), st.just({}), st.fixed_dictionaries({"base": st.sampled_from([-0.5, 0.0, 0.3, 1.0, 1.5])})
)


@st.composite
def ellipsoids(draw: st.DrawFn) -> Parts:
    rng = np.random.default_rng(draw(seeds))
    count = draw(st.integers(1, 24))
    aspect = seldom(draw, 3.0, decades(0, 5))
    size = seldom(draw, 0.5, decades(-3, 2))
    centres = rng.uniform(-1, 1, (count, 3))
    if draw(st.integers(1, 6)) == 1:
        centres = 0.2 * centres[rng.integers(count, size=count)]
    one: Parts = {
        "centers": centres,
        "scales": size * rng.uniform(0.5, 1, (count, 1)) * aspect ** -rng.random((count, 3)),
        "rotations": scene_parts.quaternions(rng, count),
        "values": rng.random(count),
        "normalization": draw(st.sampled_from(["threshold", "threshold", "none"])),
        "falloff": seldom(draw, 8.0, decades(-1, 1.3)),
    }
    if one["normalization"] == "threshold":
        one["w0"] = seldom(draw, 0.5, decades(-4, 1))
    match draw(st.sampled_from(["plain", "plain", "signed", "offset", "equal"])):
        case "signed":
            one["values"] = 2 * one["values"] - 1
        case "offset":
            one["values"] = one["values"] + draw(decades(0, 3))
        case "equal":
            one["values"] = np.full(count, 0.7)
    match draw(st.sampled_from(["plain", "plain", "decades", "zeros"])):
        case "decades":
            one["weights"] = 10.0 ** rng.uniform(-3, 1, count)
        case "zeros":
            one["weights"] = np.where(rng.random(count) < 0.3, 0.0, 1.0)
    return one | draw(bases)


@st.composite
def lattices(draw: st.DrawFn) -> Parts:
    rng = np.random.default_rng(draw(seeds))
    shape = tuple(draw(st.integers(1, 6)) for _ in range(3))
    kind = draw(st.sampled_from(["cartesian", "cartesian", "bcc"]))
    edge = draw(st.floats(0.3, 0.7))
    spacing = (edge, edge, edge) if kind == "bcc" or draw(st.booleans()) else tuple(rng.uniform(0.25, 0.7, 3).tolist())
    one: Parts = {
        "values": rng.random(shape).astype(np.float32),
        "spacing": spacing,
        "origin": tuple(rng.uniform(-1.5, 0, 3).tolist()),
        "lattice": kind,
        "normalization": draw(st.sampled_from(["lattice", "lattice", "threshold", "none"])),
        "falloff": seldom(draw, 5.0, st.floats(1.0, 10.0)),
    }
    radius = seldom(draw, 2.0, st.floats(1.2, 3.0))
    if radius != 2.0:
        one["radius"] = radius
    if draw(st.integers(1, 5)) == 1:
        one["values"][rng.random(shape) < 0.3] = np.nan
        one["nan"] = "skip"
    return one | draw(st.sampled_from([{}, {"boundary": "edge"}, {"boundary": "zero"}])) | draw(bases)


@st.composite
def transfers(draw: st.DrawFn, low: float, high: float) -> list[tuple[float, ...]]:
    """Return points over about the values that occur; many are 0 where nothing is."""
    rng = np.random.default_rng(draw(seeds))
    count = draw(st.integers(1, 6))
    start = draw(st.sampled_from([0.0, 0.0, 0.2, -0.1]))
    values = np.sort(low + (high - low) * (start + (1 - start) * rng.random(count)))
    opacity = rng.random(count) * draw(st.sampled_from([0.1, 0.5, 1.0]))
    if draw(st.integers(1, 4)) > 1 and values[0] <= 0:
        values = values - values[0] + 0.01 * (high - low)
        opacity[0] = 0
    elif values[0] > 0:
        opacity[0] = 0
    if count > 2 and draw(st.integers(1, 4)) == 1:
        values[count // 2] = values[count // 2 - 1]
    if draw(st.integers(1, 6)) == 1:
        opacity[-1] = 1.0
    return [(float(v), *rng.random(3).tolist(), float(a)) for v, a in zip(values, opacity, strict=True)]


@st.composite
def effects(draw: st.DrawFn, span: float) -> Parts:
    """Return effects of section 10 as plain numbers; most scenes have none."""
    rng = np.random.default_rng(draw(seeds))
    found: Parts = {}
    if draw(st.integers(1, 4)) == 1:
        found["planes"] = [(rng.normal(size=3), rng.uniform(-0.5, 0.5)) for _ in range(draw(st.integers(1, 3)))]
    if draw(st.integers(1, 6)) == 1:
        found["box"] = np.sort(rng.uniform(-1.2, 1.2, (2, 3)), axis=0)
    if {"planes", "box"} & found.keys():
        found["cut_faces"] = draw(st.booleans())
    if draw(st.integers(1, 3)) == 1:
        found["gradient"] = "analytic"
    if draw(st.integers(1, 6)) == 1:
        found["gradient_opacity"] = span * draw(decades(-1, 1))
    if draw(st.integers(1, 6)) == 1:
        start = rng.uniform(0, 2)
        found["cue"] = (start, start + rng.uniform(0.1, 2), rng.random(3), rng.random())
    return found


def built(made: Parts) -> tuple[ss.Scene, ss.Camera, tuple[int, int]]:
    """Return scene, camera and size with the effects that scattered_scenes does not know."""
    wanted: Parts = made.get("effects", {})
    more = {name: wanted[name] for name in ("gradient", "gradient_opacity", "cut_faces") if name in wanted}
    if "planes" in wanted or "box" in wanted:
        box = wanted.get("box")
        more["clip"] = ss.Clip(planes=wanted.get("planes", ()), box=None if box is None else tuple(box))
    if "cue" in wanted:
        more["depth_cue"] = ss.DepthCue(*wanted["cue"])
    return scene_parts.build(ss, made | {"scene": made["scene"] | more})


def by_reference(made: Parts) -> ss.Image:
    """Return the reference's picture."""
    scene, camera, size = built(made)
    return ss.Renderer("reference").render(scene, camera, size=size)


@st.composite
def scenes(draw: st.DrawFn) -> Parts:
    """Return a scene that the reference draws quickly."""
    fields = [draw(st.one_of(ellipsoids(), lattices()))]
    if draw(st.integers(1, 4)) == 1:
        fields.append(draw(st.one_of(ellipsoids(), lattices())))
    everything = np.concatenate([np.ravel(one["values"]) for one in fields])
    known = everything[np.isfinite(everything)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    high = high if high > low else low + 1.0
    mode = draw(st.sampled_from(["composite"] * 5 + ["isosurface", "xray", "mip"]))
    knobs: Parts = {
        "mode": mode,
        "sampling": draw(st.sampled_from(["point", "slab"])),
        "opacity_stop": draw(st.sampled_from([1.0, 1.0, 0.98, 0.5])),
        "preintegration": mode == "composite" and draw(st.booleans()),
    }
    if mode == "isosurface":
        knobs["iso_value"] = low + (high - low) * draw(st.floats(0.1, 0.9))
    if draw(st.integers(1, 5)) == 1:
        knobs["filter"] = "ewa"
    if mode in ("composite", "isosurface") and draw(st.integers(1, 5)) == 1:
        knobs["background"] = (0.2, 0.5, 0.8)
    rng = np.random.default_rng(draw(seeds))
    camera = scene_parts.random_camera(rng, 2.0, np.zeros(3))
    if "fov_y" in camera:
        camera["fov_y"] = seldom(draw, camera["fov_y"], st.sampled_from([0.01, 1.0, 120.0, 170.0]))
    made: Parts = {
        "fields": fields,
        "transfer": draw(transfers(low, high)),
        "scene": knobs,
        "lights": [
            {
                "direction": tuple(scene_parts.unit(rng.normal(size=3)).tolist()),
                "color": tuple(rng.random(3).tolist()),
                "space": space,
            }
            for space in draw(st.lists(st.sampled_from(["eye", "world"]), max_size=2))
        ],
        "material": {
            "ambient": draw(share),
            "diffuse": draw(share),
            "specular": seldom(draw, 0.0, share, 2),
            "shininess": seldom(draw, 16.0, decades(0, 4)),
            "two_sided": draw(st.booleans()),
        },
        "camera": camera,
        "size": (draw(st.integers(1, 18)), draw(st.integers(1, 16))),
        "effects": draw(effects(high - low)) if mode in ("composite", "isosurface") else {},
    }
    if draw(st.integers(1, 4)) == 1 and knobs["preintegration"]:
        knobs["preintegration"] = "second_order"
    deepest = _depth(made)
    knobs["slice_spacing"] = max(deepest / draw(st.integers(2, MOST_SLICES)), 1e-3)
    if draw(st.booleans()):
        knobs["reference_length"] = knobs["slice_spacing"] * draw(decades(-1, 2))
    if offset := draw(st.sampled_from([0.0, 0.0, 0.0, 7.0, -300.0, 5000.0])):
        scene_parts.lift(made, offset)
    return made


def _depth(made: Parts) -> float:
    """Return how deep the supports reach, at most."""
    reach = [2.0]
    for one in made["fields"]:
        if "centers" in one:
            reach.append(2 * (float(np.abs(one["centers"]).max()) * 1.8 + float(one["scales"].max())))
        else:
            shape = np.array(one["values"].shape[::-1]) + 2 * one.get("radius", 2.0)
            reach.append(float(np.linalg.norm(shape * np.array(one["spacing"]))) + 3.0)
    return max(reach)


# Changes that leave the picture as it is


def as_it_is(made: Parts, rng: np.random.Generator) -> Parts:
    """Return the scene."""
    return made


def reordered(made: Parts, rng: np.random.Generator) -> Parts:
    """Return the scene with its kernels, and its fields, in another order."""
    for one in made["fields"]:
        if "centers" in one:
            order = rng.permutation(len(one["centers"]))
            for name, values in one.items():
                if isinstance(values, np.ndarray) and len(values) == len(order):
                    one[name] = values[order]
    made["fields"] = made["fields"][::-1]
    return made


def halved(made: Parts, rng: np.random.Generator) -> Parts:
    """Return the scene with each scattered kernel split into two, of shares of its weight."""
    for one in made["fields"]:
        if "centers" in one:
            count = len(one["centers"])
            weights = one.get("weights", np.ones(count))
            part = 0.25 * rng.integers(1, 4, count)
            for name, values in one.items():
                if isinstance(values, np.ndarray) and len(values) == count:
                    one[name] = np.concatenate([values, values])
            one["weights"] = np.concatenate([part * weights, (1 - part) * weights])
    return made


def rescaled(made: Parts, rng: np.random.Generator) -> Parts:
    """Return the scene in another unit of length; powers of two, so that numbers keep their digits."""
    unit = float(2.0 ** rng.integers(-20, 21))
    for one in made["fields"]:
        for name in ("centers", "scales", "spacing", "origin"):
            if name in one:
                one[name] = np.asarray(one[name]) * unit
    for name in ("eye", "target", "height", "near"):
        if name in made["camera"]:
            made["camera"][name] = np.asarray(made["camera"][name]) * unit
    for name in ("slice_spacing", "reference_length"):
        made["scene"][name] = made["scene"][name] * unit
    found = made["effects"]
    if "planes" in found:
        found["planes"] = [(normal, offset * unit) for normal, offset in found["planes"]]
    if "box" in found:
        found["box"] = found["box"] * unit
    if "gradient_opacity" in found:
        found["gradient_opacity"] /= unit
    if "cue" in found:
        start, end, *rest = found["cue"]
        found["cue"] = (start * unit, end * unit, *rest)
    return made


def moved(made: Parts, rng: np.random.Generator) -> Parts:
    """Return the scene at another place, by as much as costs eleven binary digits."""
    by = 1024.0 * rng.integers(-2, 3, 3)
    for one in made["fields"]:
        name = "centers" if "centers" in one else "origin"
        one[name] = np.asarray(one[name]) + by
    for name in ("eye", "target"):
        made["camera"][name] = tuple((np.asarray(made["camera"][name]) + by).tolist())
    found = made["effects"]
    if "planes" in found:
        found["planes"] = [(normal, offset + float(normal @ by)) for normal, offset in found["planes"]]
    if "box" in found:
        found["box"] = found["box"] + by
    return made


def cut_elsewhere(made: Parts, by: float) -> Parts:
    """Return the scene with its clipping planes and boxes moved."""
    made = copy.deepcopy(made)
    found = made["effects"]
    if "planes" in found:
        found["planes"] = [(normal, offset + by) for normal, offset in found["planes"]]
    if "box" in found:
        found["box"] = found["box"] + by * np.array([[-1.0], [1.0]])
    return made


def in_tiles(made: Parts, rng: np.random.Generator) -> Parts:
    """Return the scene; it is drawn in tiles of another size."""
    return made


CHANGES: list[Callable[[Parts, np.random.Generator], Parts]] = [as_it_is, reordered, halved, rescaled, moved, in_tiles]


def ambiguous(made: Parts, here: NDArray[np.float32], spacing: float, length: float) -> NDArray[np.bool_]:
    """Return the pixels that jump under the nudges of section 9, and where cuts are moved by as little."""
    others = list(nudges(made, spacing, length)) if may_jump(made) else []
    if "planes" in made["effects"] or "box" in made["effects"]:
        others += [cut_elsewhere(made, by) for by in (-1e-5, 1e-5)]
    return changed_pixels(here, others, by_reference)


def far_off(actual: ss.Image, made: Parts, expected: ss.Image, bounds: tuple[float, float], scene: ss.Scene) -> str:
    """Return how far a picture is from what it must be, or an empty text."""
    pixels, wanted = np.array(actual.pixels), expected.pixels
    if np.isinf(pixels).any():
        return "not finite"
    found = off_by(pixels, wanted)
    if within(found, bounds):
        return ""
    if pixels.ndim == 3:
        jumping = ambiguous(made, expected.rgba, scene.slice_spacing, scene.reference_length)
        # Where most of a small picture is ambiguous, the reference does not determine it.
        if jumping.sum() > max(1, MOST_AMBIGUOUS * jumping.size):
            event("too much of the picture is ambiguous")
            return ""
        pixels[jumping] = wanted[jumping]
        found = off_by(pixels, wanted)
    return "" if within(found, bounds) else f"{found}, at most {bounds}"


def check(backend: str, made: Parts, change: Callable[[Parts, np.random.Generator], Parts], seed: int) -> None:
    """Compare the picture of a changed scene with the reference's picture of the unchanged one."""
    try:
        scene, camera, size = built(made)
        expected = ss.Renderer("reference").render(scene, camera, size=size)
    except ss.InvalidInput as error:
        assert str(error).count(";") >= 1, error
        event("no scene")
        return
    made = copy.deepcopy(made)
    made["scene"]["slice_spacing"], made["scene"]["reference_length"] = scene.slice_spacing, scene.reference_length
    gentle = not made["effects"] and oracle.is_gentle(*scene_parts.build(oracle, made))
    changed, camera, size = built(change(copy.deepcopy(made), np.random.default_rng(seed)))
    options = {"tile_size": 1 + seed % 9} if change is in_tiles else {}
    if made["scene"]["mode"] == "xray" and change is rescaled:
        # A line integral scales with the unit of length.
        options = {}
        changed, camera, size = built(made)
    try:
        image = ss.Renderer(backend, **options).render(changed, camera, size=size)  # type: ignore[arg-type]
    except ss.Unsupported as error:
        assert str(error).count(";") >= 2, error
        event(f"refused: {str(error).split('; wanted')[0][-60:]}")
        return
    wrong = far_off(image, made, expected, FLOAT32 if gentle else FLOAT32_HARD, scene)
    assert not wrong, f"{backend} {change.__name__}: {wrong}; {image.plan.precision}"


@pytest.mark.slow
@pytest.mark.parametrize("backend", BACKENDS)
def test_any_scene(backend: str) -> None:
    @FUZZ
    @given(made=scenes(), change=st.sampled_from(CHANGES), seed=seeds)
    def any_scene(made: Parts, change: Callable[[Parts, np.random.Generator], Parts], seed: int) -> None:
        note(repr(made))
        check(backend, made, change, seed)

    any_scene()


@pytest.mark.slow
def test_the_reference_itself_keeps_the_invariants() -> None:
    @FUZZ
    @given(made=scenes(), change=st.sampled_from([reordered, halved, rescaled, moved]), seed=seeds)
    def any_scene(made: Parts, change: Callable[[Parts, np.random.Generator], Parts], seed: int) -> None:
        note(repr(made))
        check("reference", made, change, seed)

    any_scene()


# Extreme scenes


def harsh(seed: int) -> Parts:
    """Return a scene of sizes, values, weights and magnifications over many decades."""
    rng = np.random.default_rng([77, seed])

    def pick(*choices: Any) -> Any:
        return choices[rng.integers(len(choices))]

    def decade(low: float, high: float) -> float:
        return float(10.0 ** rng.uniform(low, high))

    count = pick(1, 3, 20, 200)
    size = decade(-9, 6) if rng.random() < 0.3 else decade(-2, 0.5)
    aspect = decade(0, 7) if rng.random() < 0.3 else decade(0, 1)
    spread = 10 ** rng.uniform(-4, 0, (count, 1)) if rng.random() < 0.2 else np.ones((count, 1))
    one: Parts = {
        "centers": rng.uniform(-1, 1, (count, 3)),
        "scales": size * spread * rng.uniform(0.5, 1, (count, 1)) * aspect ** -rng.random((count, 3)),
        "rotations": scene_parts.quaternions(rng, count),
        "values": rng.random(count),
        "normalization": pick("threshold", "threshold", "none"),
        "falloff": 8.0 if rng.random() < 0.7 else decade(-2, 2),
    }
    if rng.random() < 0.2:
        one["centers"] = 0.1 * one["centers"][rng.integers(count, size=count)]
    if one["normalization"] == "threshold":
        one["w0"] = decade(-12, 3) if rng.random() < 0.4 else 0.5
    if rng.random() < 0.3:
        one["weights"] = 10.0 ** (rng.uniform(-12, 12, count) if rng.random() < 0.5 else rng.uniform(-2, 2, count))
    offset = decade(0, 9) if rng.random() < 0.25 else 0.0
    unit = decade(-200, 200) if rng.random() < 0.2 else 1.0
    if rng.random() < 0.2:
        one["values"] = 2 * one["values"] - 1
    one["values"] = (one["values"] + offset) * unit
    points = pick(2, 3, 5)
    values, opacity = np.sort(rng.random(points)), rng.random(points) * pick(0.01, 0.3, 1.0)
    opacity[0] = 0
    values = values - values[0] + 0.01 if offset == 0 else values
    camera = scene_parts.random_camera(rng, 2.0, 0.5 * one["centers"][0])
    if "height" in camera and rng.random() < 0.3:
        camera["height"] = decade(-8, 4)
    if "fov_y" in camera and rng.random() < 0.3:
        camera["fov_y"] = pick(0.001, 1.0, 150.0, 179.0)
    spacing = 2 * (2 + float(one["scales"].max())) / pick(2, 5, 12, 40)
    mode = pick("composite", "composite", "composite", "xray", "mip", "isosurface")
    return {
        "fields": [one],
        "transfer": [
            (float((v + offset) * unit), *rng.random(3).tolist(), float(a))
            for v, a in zip(values, opacity, strict=True)
        ],
        "scene": {
            "mode": mode,
            "sampling": pick("point", "slab"),
            "opacity_stop": pick(1.0, 1.0, 0.98),
            "slice_spacing": spacing,
            "reference_length": spacing * (decade(-6, 6) if rng.random() < 0.2 else decade(-1, 1)),
            "preintegration": pick(False, True, "second_order") if mode == "composite" else False,
            **({"iso_value": (offset + 0.4) * unit} if mode == "isosurface" else {}),
            **({"filter": "ewa"} if rng.random() < 0.15 else {}),
        },
        "lights": scene_parts.LIGHTS[: int(rng.integers(0, 3))],
        "material": scene_parts.MATERIAL,
        "camera": camera,
        "size": (int(rng.integers(1, 18)), int(rng.integers(1, 16))),
        "effects": {"gradient": "analytic"} if rng.random() < 0.2 else {},
    }


# OpenGL compiles the shader variants of each scene, so it draws fewer.
HARSH = {"cpu": int(AMOUNT or 150), "gl": int(AMOUNT or 30)}


@pytest.mark.slow
@pytest.mark.parametrize("backend", BACKENDS)
def test_harsh_scenes_are_right_or_refused(backend: str) -> None:
    wrong, drawn = [], 0
    for seed in range(HARSH[backend]):
        made = harsh(seed)
        try:
            scene, camera, size = built(made)
            expected = ss.Renderer("reference").render(scene, camera, size=size)
            image = ss.Renderer(backend).render(scene, camera, size=size)  # type: ignore[arg-type]
        except (ss.InvalidInput, ss.Unsupported) as error:
            assert str(error).count(";") >= 1, error
            continue
        drawn += 1
        how = far_off(image, made, expected, FLOAT32_HARD, scene)
        if how:
            wrong.append(f"{seed}: {how}; {image.plan.precision}")
    assert not wrong, wrong
    assert drawn > HARSH[backend] / 2


@pytest.mark.slow
def test_a_scene_that_is_a_little_wrong_is_seen() -> None:
    """Negative control: a scene that shows anything and whose opacities are off by a hundredth fails."""
    seen, missed = 0, 0

    # Few of the scenes are neither empty nor full: as many are drawn as it takes to see five.
    @settings(FUZZ, max_examples=10 * FUZZ.max_examples)
    @given(made=scenes())
    def any_scene(made: Parts) -> None:
        nonlocal seen, missed
        if seen == 5:
            return
        made["scene"] |= {"mode": "composite", "opacity_stop": 1.0}
        made["scene"].pop("iso_value", None)
        dimmer = copy.deepcopy(made)
        dimmer["transfer"] = [(*point[:4], 0.99 * point[4]) for point in made["transfer"]]
        try:
            one, other = by_reference(made), by_reference(dimmer)
        except ss.InvalidInput:
            return
        if one.rgba[..., 3].mean() > 0.05 and one.rgba[..., 3].mean() < 0.95:
            seen += 1
            missed += off_by(one, other)["rmse"] <= FLOAT32_HARD[0]

    any_scene()
    assert seen == 5 and missed == 0
