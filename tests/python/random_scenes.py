"""Small random scenes, all options mixed: of scattered ellipsoids (with lattices among them), and of lattices alone."""

from __future__ import annotations

from typing import Any

import numpy as np
from scene_parts import Parts, frame, pick, quaternions, random_camera, unit


def direction(rng: np.random.Generator) -> tuple[float, ...]:
    """Return a random vector of length 1."""
    return tuple(unit(rng.normal(size=3)).tolist())


def random_light(rng: np.random.Generator) -> dict[str, Any]:
    """Return up to two lights and a material."""
    return {
        "lights": [
            {"direction": direction(rng), "color": tuple(rng.random(3).tolist()), "space": pick(rng, "eye", "world")}
            for _ in range(rng.integers(0, 3))
        ],
        "material": {
            "ambient": float(rng.random()),
            "diffuse": float(rng.random()),
            "specular": float(pick(rng, 0.0, rng.random())),
            "shininess": float(rng.uniform(1, 60)),
            "two_sided": bool(rng.random() < 0.4),
        },
    }


def random_ellipsoids(rng: np.random.Generator) -> dict[str, Any]:
    """Return the arguments of a small field in the cube of edge 2 round 0."""
    count = int(pick(rng, 1, 2, *[rng.integers(3, 30)] * 6))
    aspect = float(10.0 ** (pick(rng, 0, 1, 1, 3) * rng.random()))
    size = rng.uniform(0.2, 1.0) * 10.0 ** (rng.uniform(-1, 0, (count, 1)) * (rng.random() < 0.3))
    centres = rng.uniform(-1, 1, (count, 3))
    if rng.random() < 0.2:
        centres = 0.7 * centres[rng.integers(count, size=count)] + 0.05 * rng.normal(size=(count, 3))
    values = rng.random(count)
    kind = pick(rng, "positive", "positive", "signed", "offset")
    if kind == "signed":
        values = 2 * values - 1
    elif kind == "offset":
        values = 0.9 + 0.1 * values
    field: dict[str, Any] = {
        "centers": centres,
        "scales": size * aspect ** -rng.random((count, 3)),
        "rotations": quaternions(rng, count),
        "values": values,
        "normalization": pick(rng, "threshold", "threshold", "none"),
        "falloff": float(pick(rng, 8.0, 8.0, rng.uniform(0.5, 12))),
    }
    if rng.random() < 0.2:
        field["rotations"] = np.stack([frame(rng.normal(size=3)) for _ in range(count)])
    if rng.random() < 0.15:
        field["scales"] = field["scales"][:, 0]
        del field["rotations"]
    elif rng.random() < 0.15:
        del field["rotations"]
    if rng.random() < 0.15:
        field["min_scale"] = float(np.median(field["scales"]))
    if rng.random() < 0.4:
        field["weights"] = 10.0 ** rng.uniform(-2, 1, count) * (rng.random(count) < 0.9)
        field["weights"][0] = 1
    if field["normalization"] == "threshold" and rng.random() < 0.7:
        field["w0"] = float(10.0 ** rng.uniform(-3, 0.3))
    if rng.random() < 0.1:
        field["normalization"] = "lattice"
        field["scales"] = np.repeat(field["scales"][:1], count, 0)
        field["cell_volume"] = float(rng.uniform(0.1, 1) * 4 * np.prod(np.broadcast_to(field["scales"][0], 3)))
    return field


def random_regular(rng: np.random.Generator) -> dict[str, Any]:
    """Return the arguments of a small lattice in the cube of edge 2 round 0."""
    shape = tuple(int(n) for n in rng.integers(2, 6, 3))
    lattice = pick(rng, "cartesian", "bcc")
    edge = float(rng.uniform(0.3, 0.6))
    return {
        "values": rng.random(shape).astype(np.float32),
        "spacing": (edge, edge, edge) if lattice == "bcc" else tuple(rng.uniform(0.3, 0.6, 3).tolist()),
        "origin": tuple(rng.uniform(-1, 0, 3).tolist()),
        "lattice": lattice,
        "normalization": pick(rng, "lattice", "lattice", "threshold", "none"),
    }


def random_transfer(rng: np.random.Generator) -> list[tuple[float, ...]]:
    """Return the points of a transfer function: opacity at 0, steps and opaque ends among them."""
    count = int(rng.integers(2, 6))
    values = np.sort(rng.uniform(-0.1, 1.0, count))
    opacity = rng.random(count) * pick(rng, 0.1, 0.5, 1.0)
    if rng.random() < 0.6:
        values = np.sort(np.maximum(values, 0.02 + 0.01 * np.arange(count)))
        opacity[0] = 0
    # A window without width has no weakest gradient: light would show the noise of rounding.
    if rng.random() < 0.3 and count > 2:
        values[count // 2] = values[count // 2 - 1]
    if rng.random() < 0.2:
        opacity[-1] = 1
    return [(float(v), *rng.random(3).tolist(), float(a)) for v, a in zip(values, opacity, strict=True)]


def random_ellipsoid_scene(seed: int) -> Parts:
    """Return a small scene with ellipsoids in it; modes and samplings are counted through, the rest is drawn."""
    rng = np.random.default_rng([2006, seed])
    fields = [random_ellipsoids(rng)]
    while rng.random() < 0.25:
        fields.append(pick(rng, random_ellipsoids, random_regular)(rng))
    mode = ("composite", "isosurface", "composite", "xray", "composite", "mip")[seed % 6]
    chosen: dict[str, Any] = {
        "mode": mode,
        "sampling": ("point", "slab")[seed // 6 % 2],
        "opacity_stop": float(pick(rng, 0.98, 1.0, rng.uniform(0.3, 1))),
        "preintegration": seed % 6 == 2 or (mode == "composite" and rng.random() < 0.2),
        # A default distance of slices would make thousands of slices of some of these.
        "slice_spacing": float(2 / rng.uniform(3, 25)),
    }
    if seed // 12 % 4 == 0:
        chosen["filter"] = "ewa"
    if mode == "isosurface":
        chosen["iso_value"] = float(rng.uniform(0.05, 0.7))
    if rng.random() < 0.6:
        chosen["reference_length"] = float(chosen["slice_spacing"] * rng.uniform(0.5, 3))
    if mode in ("composite", "isosurface") and rng.random() < 0.3:
        chosen["background"] = tuple(rng.random(3).tolist())
    camera = random_camera(rng, 2.0, 0.8 * fields[0]["centers"][0])
    if rng.random() < 0.1:
        # Whole multiples of what a float64 resolves out there, so that the move itself loses nothing.
        at = np.round(10.0 ** rng.uniform(6, 9) * unit(rng.normal(size=3)))
        for field in fields:
            name = "centers" if "centers" in field else "origin"
            field[name] = np.asarray(field[name]) + at
        for name in ("eye", "target"):
            camera[name] = tuple((np.asarray(camera[name]) + at).tolist())
    return {
        "fields": fields,
        "transfer": random_transfer(rng),
        "scene": chosen,
        **random_light(rng),
        "camera": camera,
        "size": tuple(int(n) for n in rng.integers(4, 20, 2)),
    }


# Lattices


def random_lattice(rng: np.random.Generator) -> dict[str, Any]:
    """Return the arguments of a field."""
    shape = tuple(int(n) for n in rng.integers(2, 8, 3))
    values = rng.random(shape)
    kind = pick(rng, "noise", "sparse", "signed", "ball")
    if kind == "sparse":
        values *= rng.random(shape) < 0.3
    elif kind == "signed":
        values = 2 * values - 1
    elif kind == "ball":
        grid = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
        values = np.clip(1.2 - np.sqrt(np.square(grid).sum(0)), 0, 1)
    values = values.astype(np.float32)
    edge = float(rng.uniform(0.5, 2))
    field: dict[str, Any] = {
        "lattice": pick(rng, "cartesian", "cartesian", "bcc"),
        "spacing": (edge, edge, edge),
        "origin": tuple(float(x) for x in rng.uniform(-3, 3, 3)),
        "radius": float(pick(rng, 2.0, 2.0, rng.uniform(0.8, 3))),
        "falloff": float(pick(rng, 5.0, 5.0, rng.uniform(1, 9))),
        "normalization": pick(rng, "lattice", "none", "threshold"),
    }
    if field["lattice"] == "cartesian" and rng.random() < 0.6:
        field["spacing"] = tuple(float(x) for x in rng.uniform(0.5, 2, 3))
    if field["normalization"] == "threshold":
        field["w0"] = float(rng.uniform(0.05, 2))
    if rng.random() < 0.25:
        values[rng.random(shape) < 0.2] = np.nan
        values.flat[0] = 1
        field["nan"] = "skip"
    field["values"] = values
    return field


def random_lattice_transfer(rng: np.random.Generator) -> list[tuple[float, ...]]:
    """Return the points of a transfer function: opacity at 0, steps and opaque ends among them."""
    count = int(rng.integers(2, 6))
    values = np.sort(rng.uniform(-0.1, 1.1, count))
    opacity = rng.random(count) * pick(rng, 0.1, 0.5, 1.0)
    if rng.random() < 0.6:
        values = np.sort(np.maximum(values, 0.05))
        opacity[0] = 0
    if rng.random() < 0.3:
        values[count // 2] = values[count // 2 - 1]
    if rng.random() < 0.2:
        opacity[-1] = 1
    return [(float(v), *rng.random(3).tolist(), float(a)) for v, a in zip(values, opacity, strict=True)]


def random_lattice_scene(seed: int) -> dict[str, Any]:
    """Return the arguments of a scene, its fields, its camera and the picture's size.

    What the modes and the cameras are is counted through, so that all pairs come up; the rest is drawn.
    """
    rng = np.random.default_rng([2005, seed])
    fields = [random_lattice(rng) for _ in range(pick(rng, 1, 1, 1, 2))]
    spacing = min(f["spacing"][0] / 2 if f["lattice"] == "bcc" else min(f["spacing"]) for f in fields)
    mode = ("composite", "isosurface", "composite", "xray", "composite", "mip")[seed % 6]
    scene: dict[str, Any] = {
        "mode": mode,
        "sampling": ("point", "slab")[seed // 6 % 2],
        "opacity_stop": float(pick(rng, 0.98, 1.0, rng.uniform(0.3, 1))),
        "preintegration": seed % 6 == 2 or (mode == "composite" and rng.random() < 0.2),
    }
    if mode == "isosurface":
        scene["iso_value"] = float(rng.uniform(0.1, 0.8))
    if rng.random() < 0.5:
        scene["slice_spacing"] = float(spacing * rng.uniform(0.3, 2))
    if rng.random() < 0.4:
        scene["reference_length"] = float(spacing * rng.uniform(0.3, 3))
    if mode in ("composite", "isosurface") and rng.random() < 0.3:
        scene["background"] = tuple(rng.random(3).tolist())
    low = np.min([f["origin"] for f in fields], 0)
    high = np.max([np.add(f["origin"], np.multiply(f["spacing"], f["values"].shape[::-1])) for f in fields], 0)
    middle, across = (low + high) / 2, float(np.linalg.norm(high - low))
    where = ("outside", "orthographic", "inside", "orthographic", "cut")[seed % 5]
    away = direction(rng)
    distance = (
        across
        * {
            "orthographic": rng.uniform(0, 1),
            "outside": rng.uniform(0.8, 2),
            "inside": rng.uniform(0.02, 0.3),
            "cut": rng.uniform(0.5, 1),
        }[where]
    )
    camera: dict[str, Any] = {
        "eye": tuple((middle + np.multiply(away, distance) + 1e-3).tolist()),
        "target": tuple((middle + rng.uniform(-0.01, 0.01, 3) * across).tolist()),
        "up": pick(rng, (0, 1, 0), direction(rng)),
    }
    if where == "orthographic":
        camera["height"] = float(across * rng.uniform(0.3, 1.5))
    else:
        camera["fov_y"] = float(rng.uniform(15, 90))
        if where == "cut":
            camera["near"] = float(distance * rng.uniform(0.5, 1))
    return {
        "fields": fields,
        "transfer": random_lattice_transfer(rng),
        "scene": scene,
        **random_light(rng),
        "camera": camera,
        "size": tuple(int(n) for n in rng.integers(5, 26, 2)),
    }
