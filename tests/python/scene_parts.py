"""Scenes as plain numbers and arrays.

`build(module, parts)` makes a scene of the classes of any module that has the names of the package, so that the package
and the oracle are given the same one.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# fields, transfer, scene, lights, material, camera, size; "groups": the numbers of each group's fields,
# where `transfer` has one function for each.
Parts = dict[str, Any]


def build(module: ModuleType, parts: Parts) -> tuple[Any, Any, tuple[int, int]]:
    """Return scene, camera and size made of a module's classes."""
    fields = [(module.EllipsoidField if "centers" in f else module.RegularField)(**f) for f in parts["fields"]]
    groups = parts.get("groups")
    if groups is None:
        shown, transfer = fields[0] if len(fields) == 1 else fields, module.TransferFunction(parts["transfer"])
    else:
        shown = [[fields[number] for number in group] for group in groups]
        transfer = [module.TransferFunction(points) for points in parts["transfer"]]
    scene = module.Scene(
        shown,
        transfer,
        lights=[module.Light(**light) for light in parts.get("lights", ())],
        material=module.Material(**parts.get("material", {})),
        **parts["scene"],
    )
    kind = module.Camera.orthographic if "height" in parts["camera"] else module.Camera.perspective
    return scene, kind(**parts["camera"]), parts["size"]


def nudged(
    parts: Parts, spacing: float, length: float, *, rho: float = 0, support: float = 0, stop: float = 0
) -> Parts:
    """Return the scene with ρ, the supports' radius (relative) or A_stop moved, as section 9 looks for ambiguity.

    The distance of slices and the reference length stay at what they are, though both may follow from the supports.
    """
    moved = copy.deepcopy(parts)
    moved["scene"] |= {"slice_spacing": spacing, "reference_length": length}
    moved["transfer"] = [(point[0] - rho, *point[1:]) for point in parts["transfer"]]
    if "iso_value" in parts["scene"]:
        moved["scene"]["iso_value"] -= rho
    if stop:
        moved["scene"]["opacity_stop"] = min(1.0, parts["scene"].get("opacity_stop", 0.98) + stop)
    for field in moved["fields"] if support else ():
        if "centers" in field:
            field["scales"] = np.asarray(field["scales"]) * (1 + support)
            if "min_scale" in field:
                field["min_scale"] *= 1 + support
            if "cell_volume" in field:
                field["cell_volume"] *= (1 + support) ** 3
        else:
            field["radius"] = field.get("radius", 2.0) * (1 + support)
    return moved


def counted_from_0(field: dict[str, Any]) -> bool:
    """Return whether the base of a field is 0 unless one is given."""
    if "centers" in field or field.get("boundary") == "zero" or field.get("normalization") == "none":
        return True
    return field.get("lattice") == "bcc" and len(field["values"]) < 2


def lift(parts: Parts, by: float, from_0: Callable[[dict[str, Any]], bool] = counted_from_0) -> None:
    """Add a constant to the values of each group's first field, its base, and what they are compared with.

    Pictures stay what they are, and scalars rise by the constant. from_0: of which fields the base is 0 unless given.
    """
    groups = parts.get("groups")
    for number in [0] if groups is None else [group[0] for group in groups]:
        field = parts["fields"][number]
        field["values"] = np.asarray(field["values"], float) + by
        if "base" in field or from_0(field):
            field["base"] = field.get("base", 0.0) + by
    _compare(parts, lambda points: [(point[0] + by, *point[1:]) for point in points])


def negate(parts: Parts) -> None:
    """Turn the sign of all values, and of what they are compared with. Modes `mip` and `minimum` change places."""
    for field in parts["fields"]:
        field["values"] = -np.asarray(field["values"], float)
        if "base" in field:
            field["base"] = -field["base"]
    _compare(parts, lambda points: [(-point[0], *point[1:]) for point in points[::-1]])
    exchanged = {"mip": "minimum", "minimum": "mip"}
    parts["scene"]["mode"] = exchanged.get(parts["scene"].get("mode"), parts["scene"].get("mode", "composite"))


def _compare(parts: Parts, changed: Callable[[Any], Any]) -> None:
    """Change the points of transfer functions, and iso values."""
    transfer, scene = parts["transfer"], parts["scene"]
    parts["transfer"] = changed(transfer) if parts.get("groups") is None else [changed(points) for points in transfer]
    if "iso_value" in scene:
        values = scene["iso_value"]
        scene["iso_value"] = changed(values) if isinstance(values, list) else changed([(values,)])[0][0]


def unit(vector: Any) -> Array:
    """Return the vector divided by its length."""
    found = np.asarray(vector, float)
    return np.asarray(found / np.linalg.norm(found, axis=-1, keepdims=True))


def pick(rng: np.random.Generator, *choices: Any) -> Any:
    """Return one of the choices."""
    return choices[rng.integers(len(choices))]


def quaternions(rng: np.random.Generator, count: int) -> Array:
    """Return random unit quaternions w, x, y, z."""
    return unit(rng.normal(size=(count, 4)))


def frame(axis: Any) -> Array:
    """Return a rotation matrix whose first column is the axis."""
    first = unit(axis)
    second = unit(np.cross(first, np.eye(3)[np.argmin(np.abs(first))]))
    return np.stack([first, second, np.cross(first, second)], -1)


def cloud(
    rng: np.random.Generator, count: int, overlap: float = 8.0, aspect: float = 3.0, **options: Any
) -> dict[str, Any]:
    """Return a field of `count` kernels in the cube of edge 2 round 0, every point in about `overlap` supports.

    The axes of a kernel are the longest, one aspect shorter, and one between them; their product is the same for all.
    """
    between = aspect ** -rng.random(count)
    axes = np.stack([np.ones(count), between, np.full(count, 1 / aspect)], -1)
    volume = 8 * overlap / (count * 4 / 3 * np.pi)
    axes *= np.cbrt(volume / axes.prod(1))[:, None]
    return {
        "centers": rng.uniform(-1, 1, (count, 3)),
        "scales": axes,
        "rotations": quaternions(rng, count),
        "values": rng.random(count),
    } | options


# Opacity per reference length and colours, no steeper than the tighter bound of section 9 asks for.
GENTLE = [(0.02, 0.1, 0.2, 0.6, 0.0), (0.35, 0.2, 0.6, 0.4, 0.05), (0.7, 0.9, 0.6, 0.2, 0.2), (1.0, 1.0, 0.9, 0.8, 0.3)]
OPAQUE = [(0.05, 0.1, 0.2, 0.6, 0.0), (0.5, 0.2, 0.6, 0.4, 0.4), (1.0, 1.0, 0.9, 0.8, 0.9)]
STEP = [(0.1, 0.1, 0.2, 0.6, 0.0), (0.4, 0.2, 0.6, 0.4, 0.1), (0.4, 0.9, 0.2, 0.1, 0.5), (1.0, 1.0, 0.9, 0.8, 0.5)]
ZERO_SEEN = [(0.0, 0.1, 0.2, 0.6, 0.05), (0.5, 0.9, 0.6, 0.2, 0.2), (1.0, 1.0, 0.9, 0.8, 0.3)]
LIGHTS = [
    {"direction": (0.4, 0.6, 1.0), "color": (1.0, 0.9, 0.8)},
    {"direction": (-1.0, 0.2, 0.3), "color": (0.2, 0.2, 0.4), "space": "world"},
]
MATERIAL = {"ambient": 0.2, "diffuse": 0.7, "specular": 0.3, "shininess": 12.0, "two_sided": True}
VIEW = (-0.5, -0.4, -0.8)
UP = (0.1, 1.0, 0.2)
SIZE = (56, 48)


def parallel(direction: Any = VIEW, height: float = 3.0, at: Any = (0.0, 0.0, 0.0), up: Any = UP) -> dict[str, Any]:
    """Return an orthographic camera."""
    target = np.asarray(at, float)
    eye = target - 4 * unit(direction)
    return {"eye": tuple(eye.tolist()), "target": tuple(target.tolist()), "up": up, "height": height}


def central(
    direction: Any = VIEW, distance: float = 4.0, fov_y: float = 40.0, at: Any = (0.0, 0.0, 0.0), up: Any = UP
) -> dict[str, Any]:
    """Return a perspective camera."""
    target = np.asarray(at, float)
    eye = target - distance * unit(direction)
    return {"eye": tuple(eye.tolist()), "target": tuple(target.tolist()), "up": up, "fov_y": fov_y}


def parts(
    fields: list[dict[str, Any]],
    camera: dict[str, Any] | None = None,
    *,
    transfer: Any = GENTLE,
    lit: bool = True,
    size: tuple[int, int] = SIZE,
    **scene: Any,
) -> Parts:
    """Return a scene; the distance of slices is 1/12 unless given."""
    scene = {"slice_spacing": 1 / 12, "opacity_stop": 1.0} | scene
    return {
        "fields": fields,
        "transfer": transfer,
        "scene": {name: value for name, value in scene.items() if value is not None},
        "lights": LIGHTS if lit else [],
        "material": MATERIAL,
        "camera": parallel() if camera is None else camera,
        "size": size,
    }


def random_camera(rng: np.random.Generator, edge: float, at: Any = (0.0, 0.0, 0.0)) -> dict[str, Any]:
    """Return a camera somewhere round, or in, a thing of that edge at that place."""
    kind = pick(rng, "parallel", "parallel", "outside", "inside", "cut")
    target = at + rng.uniform(-0.1, 0.1, 3) * edge
    away = unit(rng.normal(size=3))
    distance = (
        edge
        * {
            "parallel": rng.uniform(0.1, 1),
            "outside": rng.uniform(1.2, 2.5),
            "inside": rng.uniform(0.02, 0.4),
            "cut": rng.uniform(0.6, 1.2),
        }[kind]
    )
    camera: dict[str, Any] = {
        "eye": tuple((target + away * distance).tolist()),
        "target": tuple(target.tolist()),
        "up": tuple(unit(rng.normal(size=3)).tolist()),
    }
    if kind == "parallel":
        return camera | {"height": float(edge * rng.uniform(0.3, 1.5))}
    camera["fov_y"] = float(rng.uniform(15, 90))
    if kind == "cut":
        camera["near"] = float(distance * rng.uniform(0.5, 1))
    return camera
