"""Random scenes over all effects, modes, cameras and fields, by number: a backend against the reference.

A picture that breaks section 9 is wrong; its scene is made smaller (fewer kernels, fields, effects, pixels) as long as
it stays wrong. `./run fuzz scenes` draws many of them; test_sweep_scenes.py some of each kind, and those that once were
wrong.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import oracle
import scene_parts
from image_checks import FLOAT32, FLOAT32_HARD, off_by, within
from numpy.typing import NDArray
from oracle.picture import Nudge
from random_scenes import random_light
from scene_parts import Parts, cloud, lift, pick, random_camera
from test_fuzz_scenes import harsh
from test_oracle import build_effects, effect_scene
from test_oracle_ends import ends_scene
from test_oracle_groups import group_scene

import sheetsplat as ss

LIGHT = ("shadows", "ambient_occlusion")
# Share of a small picture beyond which its ambiguous pixels leave nothing to compare.
MOST_AMBIGUOUS = 0.005


def extreme_scene(seed: int) -> Parts:
    """Return a scene of sizes, values, weights and magnifications over many decades."""
    parts = harsh(seed)
    parts["scene"] |= parts.pop("effects")
    return parts


def alike_scene(seed: int) -> Parts:
    """Return a lit scattered field, divided by its weights, whose values are alike: everywhere, or on two plateaus."""
    rng = np.random.default_rng([14, seed])
    count = int(pick(rng, 1, 2, 5, 20, 60, 200))
    field = cloud(
        rng,
        count,
        float(rng.uniform(1, 9)),
        float(10 ** rng.uniform(0, pick(rng, 0.5, 1, 3))),
        w0=float(pick(rng, 1, 0.5, 0.1, 0.02)),
        falloff=float(pick(rng, 8, 8, 4, 2)),
    )
    if rng.random() < 0.3:
        field["rotations"] = np.repeat(field["rotations"][:1], count, 0)
    middle, width = float(pick(rng, 0.3, 0.5, 0.7, 1.0)), float(10 ** rng.uniform(-0.7, 0.3))
    spread = pick(rng, 0.0, 10 ** rng.uniform(-6, 0), rng.uniform(0.3, 1))
    share = rng.random(count) - 0.5
    field["values"] = middle + spread * (pick(rng, share, np.sign(field["centers"][:, 0]) / 2))
    if rng.random() < 0.2:
        field["weights"] = 10 ** rng.uniform(-1, 1, count)
    spacing, low, top = float(2 / rng.uniform(6, 30)), float(pick(rng, 0.01, 0.1)), float(pick(rng, 0.02, 0.2, 0.8))
    mode = pick(rng, "composite", "composite", "composite", "isosurface")
    scene: dict[str, Any] = {
        "mode": mode,
        "sampling": pick(rng, "point", "point", "slab"),
        "opacity_stop": 1.0,
        "slice_spacing": spacing,
        "reference_length": spacing * float(10 ** rng.uniform(-0.3, 1.3)),
        "preintegration": bool(mode == "composite" and rng.random() < 0.3),
        **({"gradient": "analytic"} if rng.random() < 0.7 else {}),
        **({"filter": "ewa"} if rng.random() < 0.1 else {}),
    }
    if mode == "isosurface":
        scene["iso_value"] = middle * float(rng.uniform(0.5, 0.95))
    light = random_light(rng)
    return {
        "fields": [field],
        "transfer": [
            (low + share * width, *rng.random(3).tolist(), opacity)
            for share, opacity in ((0.0, 0.0), (0.5, top / 2), (1.0, top))
        ],
        "scene": scene,
        **light,
        "lights": light["lights"] or scene_parts.LIGHTS,
        "camera": random_camera(rng, 2.0),
        "size": tuple(int(n) for n in rng.integers(8, 24, 2)),
    }


def plateau_scene(seed: int) -> Parts:
    """Return lit quotients of three values or of a few kernels, with far weaker gradients lit than elsewhere.

    Where a single kernel, or only kernels of one value, reach the gradient is 0, and what rounding makes of it is lit.
    """
    parts, rng = alike_scene(seed), np.random.default_rng([15, seed])
    scene, spread = parts["scene"], rng.uniform(0.02, 0.5)
    three = 0.5 + spread * (rng.random(3) - 0.5)
    length = 1.0
    if rng.random() < 0.4:
        count = int(rng.integers(6, 10))
        length = 2 / count
        places = np.stack(np.meshgrid(*[np.arange(count)] * 3, indexing="ij"), -1) - count / 2
        values = three[sum((places @ rng.normal(size=3) > 0).astype(int) for _ in range(2))]
        w0 = float(10 ** rng.uniform(-1, 0.7))
        parts["fields"] = [
            {
                "values": values.astype(np.float32),
                "spacing": (length,) * 3,
                "origin": (-1.0,) * 3,
                "normalization": "threshold",
                "w0": w0,
                "boundary": "zero",
            }
        ]
        scene["slice_spacing"] = float(length * rng.uniform(0.3, 1.2))
    else:
        count = int(pick(rng, 2, 4, 8, 40))
        field = cloud(rng, count, float(rng.uniform(1, 6)), float(10 ** rng.uniform(0, pick(rng, 0.5, 1, 3))))
        field |= {"w0": float(10 ** rng.uniform(-2.7, 0)), "falloff": float(pick(rng, 2, 4, 8))}
        field["values"] = pick(rng, rng.choice(three, count), 0.5 + spread * (rng.random(count) - 0.5))
        parts["fields"] = [field]
        length = float(np.min(field["scales"]))
    if rng.random() < 0.6:
        scene["reference_length"] = float(length * 10 ** rng.uniform(-0.5, 1.3))
    scene["gradient"] = pick(rng, "sheets", "analytic")
    if scene["mode"] == "isosurface":
        scene["iso_value"] = float(np.min(parts["fields"][0]["values"]) * rng.uniform(0.5, 0.98))
    narrow = float(pick(rng, 0.0, *(10 ** rng.uniform(-2, 0, 4))))
    low = parts["transfer"][0][0]
    parts["transfer"] = [(low + narrow * (point[0] - low), *point[1:]) for point in parts["transfer"]]
    return parts


def with_ends(parts: Parts, seed: int) -> Parts:
    """Return a scene with boundaries, bases and offsets of its own generator; what is not drawn is the default."""
    rng = np.random.default_rng([16, seed])
    size = 0.0
    for field in parts["fields"]:
        values = np.asarray(field["values"], float)
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        size = max(size, abs(low), abs(high))
        if "centers" not in field:
            field.pop("boundary", None)
            field |= pick(rng, {}, {"boundary": "edge"}, {"boundary": "zero"})
        if rng.random() < 0.35:
            field["base"] = float(
                pick(rng, 0.0, low, high, rng.uniform(1.5 * low - 0.5 * high, 1.5 * high - 0.5 * low))
            )
    if rng.random() < 0.4:
        lift(parts, size * float(pick(rng, 1.0, 7.0, -300.0, 5000.0)))
    return parts


def with_axes(parts: Parts, seed: int) -> Parts:
    """Return a scene whose Cartesian lattices have axes of any directions about the middle of where they were."""
    rng = np.random.default_rng([37, seed])
    for field in parts["fields"]:
        if "centers" in field or field.get("lattice", "cartesian") != "cartesian":
            continue
        spacing = np.asarray(field.pop("spacing", (1.0, 1.0, 1.0)), float)
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        lean = np.eye(3) + float(pick(rng, 0.0, 0.3, 0.7)) * rng.uniform(-1, 1, (3, 3)) * (1 - np.eye(3))
        axes = (spacing[:, None] * lean) @ turn
        half = (np.array(np.shape(field["values"])[::-1]) - 1) / 2
        field["axes"] = axes.tolist()
        field["origin"] = (np.asarray(field.get("origin", (0, 0, 0)), float) + half * spacing - half @ axes).tolist()
    return parts


KINDS: dict[str, Callable[[int], Parts]] = {
    "effects": effect_scene,
    "groups": group_scene,
    "extreme": extreme_scene,
    "alike": alike_scene,
}


# Numbers from here on are plateaus; below, the other kinds by turns.
PLATEAUS = 2_000_000
# Numbers from here on are fields with bases, boundaries and missing samples, alone and in groups.
ENDS = 3_000_000
# Numbers from here on are all other kinds by turns, with boundaries, bases and offsets drawn.
DRAWN_ENDS = 4_000_000
# Numbers from here on are those, with axes of lattices drawn.
DRAWN_AXES = 7_000_000


def scene_of(number: int) -> tuple[str, Parts]:
    """Return the kind and the parts of a numbered scene."""
    if number >= DRAWN_ENDS:
        kinds = KINDS | {"plateaus": plateau_scene}
        kind, seed = list(kinds)[number % len(kinds)], number // len(kinds)
        ended = with_ends(kinds[kind](seed), seed)
        return (f"{kind} with axes", with_axes(ended, seed)) if number >= DRAWN_AXES else (f"{kind} with ends", ended)
    if number >= ENDS:
        return "ends", ends_scene(number)
    if number >= PLATEAUS:
        return "plateaus", plateau_scene(number)
    kind = list(KINDS)[number % len(KINDS)]
    return kind, KINDS[kind](10_000 + number // len(KINDS))


def ambiguous(parts: Parts) -> NDArray[np.bool_]:
    """Return the pixels that jump under the nudges of section 9; of scalars, where slices begin or end to count."""
    built = build_effects(oracle, parts)
    here = oracle.render(*built)
    if here.scalar is None:
        return oracle.ambiguous(*built, here)
    moved = [oracle.render(*built, Nudge(support=1 + by)).scalar for by in (-1e-5, 1e-5)]
    far = 1e-3 * max(1.0, np.nanmax(np.abs(here.scalar), initial=0.0))
    changed = [~(np.abs(other - here.scalar) <= far) & ~(np.isnan(other) & np.isnan(here.scalar)) for other in moved]
    return np.any(changed, axis=0)


def stated(image: ss.Image, parts: Parts) -> float:
    """Return the error that a picture states for its light, which section 9 does not bound."""
    if not any(parts["scene"].get(name) for name in LIGHT):
        return 0.0
    return float(np.linalg.norm([effect.error for effect in image.plan.effects if effect.name in LIGHT]))


def draw(parts: Parts, backend: str, outputs: Any) -> ss.Image:
    """Return the picture of a backend."""
    scene, camera, size = build_effects(ss, parts)
    return ss.Renderer(backend, threads=1).render(scene, camera, size=size, outputs=outputs)  # type: ignore[arg-type]


def fault(parts: Parts, backend: str, outputs: tuple[str, ...] | None = None) -> str:
    """Return how a backend's picture breaks section 9, or "". Throws ss.Error where the scene is refused."""
    if outputs is None:
        # Coverage is compared on the processor; on OpenGL it has tests of its own.
        outputs = ("coverage",) if backend == "cpu" else ()
    expected, image = draw(parts, "reference", outputs), draw(parts, backend, outputs)
    found = np.array(image.pixels)
    # (NaN: no slice counts; a pixel where that is so in one picture alone is infinitely far off.)
    if np.isinf(found).any():
        return "not finite"
    rmse, p99_9 = FLOAT32 if oracle.is_gentle(*build_effects(oracle, parts)) else FLOAT32_HARD
    light = stated(image, parts)
    bounds = (float(np.hypot(rmse, 1.1 * light)), p99_9 if light == 0 else np.inf)
    if outputs and not within(off_by(image.coverage, expected.coverage), FLOAT32_HARD):
        return f"coverage: {off_by(image.coverage, expected.coverage)}"
    distance = off_by(found, expected)
    if within(distance, bounds):
        return ""
    jumping = ambiguous(parts)
    if jumping.sum() > max(1, MOST_AMBIGUOUS * jumping.size):
        return ""
    found[jumping] = expected.pixels[jumping]
    distance = off_by(found, expected)
    if within(distance, bounds):
        return ""
    return f"{image.plan.precision}: {distance}, at most {bounds}, {jumping.sum()} ambiguous"


def smaller(parts: Parts) -> Iterator[Parts]:
    """Yield simpler scenes: each lacks a part of this one."""
    for number, field in enumerate(parts["fields"]):
        count = len(field["centers"]) if "centers" in field else 0
        for kept in (slice(0, count // 2), slice(count // 2, count)) if count > 1 else ():
            less = copy.deepcopy(parts)
            one = less["fields"][number]
            for name, values in one.items():
                if isinstance(values, np.ndarray) and len(values) == count:
                    one[name] = values[kept]
            yield less
    if len(parts["fields"]) > 1 and parts.get("groups") is None:
        for number in range(len(parts["fields"])):
            yield {**parts, "fields": [one for place, one in enumerate(parts["fields"]) if place != number]}
    for number in range(len(parts["lights"])):
        yield {**parts, "lights": [one for place, one in enumerate(parts["lights"]) if place != number]}
    for name in (
        "cut_faces",
        "clip",
        "gradient",
        "depth_cue",
        *LIGHT,
        "gradient_opacity",
        "preintegration",
        "filter",
        "background",
    ):
        if parts["scene"].get(name):
            yield {**parts, "scene": {key: value for key, value in parts["scene"].items() if key != name}}
    if parts["scene"].get("sampling") == "slab":
        yield {**parts, "scene": {**parts["scene"], "sampling": "point"}}
    for axis in (0, 1):
        if parts["size"][axis] > 3:
            size = list(parts["size"])
            size[axis] = (size[axis] + 1) // 2
            yield {**parts, "size": tuple(size)}


def shrunk(parts: Parts, wrong: Callable[[Parts], bool]) -> Parts:
    """Return as small a scene as is found for which `wrong` is still true."""
    going = True
    while going:
        smallest = next((less for less in smaller(parts) if wrong(less)), None)
        going = smallest is not None
        parts = smallest or parts
    return parts
