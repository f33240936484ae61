"""Shapes and sizes of kernels, their places and units of length."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from scene_parts import VIEW, Parts, central, cloud, frame, parallel, parts, quaternions, unit

import sheetsplat as ss

from .cases import SIZE, Refused, add, case, chance, lattice, upright

THIN = {"needles": lambda aspect: (1, 1 / aspect, 1 / aspect), "disks": lambda aspect: (1, 1, 1 / aspect)}


def side_by_side(aspect: int, shape: str) -> Parts:
    """Return 1,000 kernels that do not overlap."""
    rng = chance(f"side by side {aspect} {shape}")
    x, y = np.meshgrid(np.arange(40) - 19.5, np.arange(25) - 12.0)
    # On centres of pixels and in planes of slices, where the thinnest show too.
    z = np.where(np.arange(1_000) % 2 == 0, 0.06, -0.06)
    one = {
        "centers": np.stack([x.ravel(), y.ravel(), z], -1),
        "scales": 0.48 * np.tile(THIN[shape](aspect), (1_000, 1)),
        "rotations": quaternions(rng, 1_000),
        "values": rng.uniform(0.5, 1, 1_000),
        "w0": 0.05,
    }
    return parts([one], upright(25.0), size=(200, 125), slice_spacing=0.12)


def crossing(aspect: int, shape: str) -> Parts:
    """Return 1,000 kernels that overlap, whose thin axes are a pixel or so."""
    rng = chance(f"crossing {aspect} {shape}")
    spacing = max(1 / 12, 0.06 * aspect / 50)
    z = spacing * (rng.integers(-1, 1, 1_000) + 0.5)
    one = {
        "centers": np.column_stack([rng.uniform(-1, 1, (1_000, 2)), z]),
        "scales": 0.06 * aspect * np.tile(THIN[shape](aspect), (1_000, 1)),
        "rotations": quaternions(rng, 1_000),
        "values": rng.uniform(0.2, 1, 1_000),
        "w0": 0.3,
    }
    return parts([one], upright(), size=SIZE, slice_spacing=spacing, reference_length=2 * spacing)


def pointing(shape: str, axis: Any, deep: bool) -> Parts:
    """Return 60 kernels of 1:100,000 whose axis is turned to `axis`; `deep`: they extend along the view."""
    rng = chance(f"pointing {shape}")
    spacing = 200.0 if deep else 0.2
    thin = (1, 1e-5, 1e-5) if shape == "needles" else (1e-5, 1, 1)
    at = rng.uniform(-1, 1, (60, 3))
    if deep:
        # Slices lie far apart, and through the centres.
        view = unit(VIEW)
        at += (spacing * (rng.integers(-1, 1, 60) + 0.5) - at @ view)[:, None] * view
    one = {
        "centers": at,
        "scales": 1e4 * np.tile(thin, (60, 1)) * rng.uniform(0.5, 1, (60, 1)),
        # Off by some ten millionths.
        "rotations": np.stack([frame(unit(axis) + 1e-5 * rng.normal(size=3)) for _ in range(60)]),
        "values": rng.random(60),
        "w0": 0.3,
    }
    return parts([one], size=SIZE, slice_spacing=spacing)


for _aspect in (1, 10, 1_000, 100_000):
    for _shape in ("needles", "disks") if _aspect > 1 else ("needles",):
        _what = "spheres" if _aspect == 1 else f"{_shape} of 1:{_aspect:,}"
        add(
            f"{_shape}_{_aspect}_apart",
            "shape",
            f"1,000 {_what} of random orientations that do not overlap",
            partial(side_by_side, _aspect, _shape),
        )
        add(
            f"{_shape}_{_aspect}_crossing",
            "shape",
            f"1,000 {_what} of random orientations, one pixel thin, that intersect",
            partial(crossing, _aspect, _shape),
        )
for _shape in ("needles", "disks"):
    for _way, _axis in (("along", VIEW), ("across", np.cross(VIEW, (0.3, 1.0, 0.1)))):
        add(
            f"{_shape}_100000_{_way}_view",
            "shape",
            f"{_shape} of 1:100,000 {_way} the view",
            # Needles along the view and disks across it are deep.
            partial(pointing, _shape, _axis, (_shape == "needles") == (_way == "along")),
        )


@case(
    "shape",
    "1,000 disks of 1:100,000 of random orientations, one pixel thin, lit: a reference length is 2,880 pixels",
)
def disks_100000_askew() -> Parts:
    rng = np.random.default_rng(1)
    one = {
        "centers": rng.uniform(-1, 1, (1_000, 3)),
        "scales": 6_000.0 * np.tile((1, 1, 1e-5), (1_000, 1)),
        "rotations": quaternions(rng, 1_000),
        "values": rng.uniform(0.2, 1, 1_000),
        "w0": 0.3,
    }
    return parts([one], size=SIZE, slice_spacing=60.0, reference_length=240.0)


def scales_16_decades(height: float) -> Parts:
    """Return kernels of 1e-8 to 1e8 in a picture of this height."""
    rng = chance("scales")
    spacing = 1e6
    sizes = 10.0 ** rng.uniform(-8, 8, 300)
    # In the planes of the two slices in the middle, so that small ones are not missed between slices.
    z = np.where(np.arange(300) % 2 == 0, 0.5, -0.5) * spacing
    one = {
        "centers": np.column_stack([rng.uniform(-0.3, 0.3, (300, 2)) * np.minimum(1, height), z]),
        "scales": sizes[:, None] * rng.uniform(0.4, 1, (300, 3)),
        "rotations": quaternions(rng, 300),
        "values": rng.random(300),
        "w0": 0.3,
    }
    return parts([one], upright(height), size=(24, 20), slice_spacing=spacing)


_large = Refused(ss.Unsupported, r"kernels of a radius of 5\.\d+e\+15 pixels; wanted at most 1e\+12")
for _height in (3.0, 3e-7, 3e8):
    add(
        f"scales_16_decades_{_height:g}",
        "shape",
        f"semi-axes from 1e-8 to 1e8 in one field, a picture {_height:g} tall",
        partial(scales_16_decades, _height),
        but={"gl": _large, "cpu": _large} if _height < 1 else {},
    )


def place(
    name: str, at: Any = (0, 0, 0), unit_of_length: float = 1.0, perspective: bool = False, regular: bool = False
) -> Parts:
    """Return a scene about `at`, all lengths in another unit."""
    rng = chance(name)
    at = np.asarray(at, float)
    if regular:
        one = lattice(name)
        one["spacing"] = tuple(np.asarray(one["spacing"]) * unit_of_length)
        one["origin"] = tuple(np.asarray(one["origin"]) * unit_of_length + at)
    else:
        one = cloud(rng, 60, 2.0, w0=0.5)
        # Whole 256ths, which float64 holds exactly around 1e9 too, so that the move itself loses nothing.
        one["centers"] = np.round(one["centers"] * 256) / 256 * unit_of_length + at
        one["scales"] = one["scales"] * unit_of_length
    camera = dict(central() if perspective else parallel())
    for end in ("eye", "target"):
        camera[end] = tuple(np.round(np.asarray(camera[end]) * 256) / 256 * unit_of_length + at)
    if "height" in camera:
        camera["height"] *= unit_of_length
    return parts([one], camera, size=SIZE, slice_spacing=unit_of_length / 8)


for _perspective in (False, True):
    _kind = "perspective" if _perspective else "orthographic"
    add(
        f"far_{_kind}",
        "place",
        f"centres around 1e9, {_kind}: same picture as around the origin",
        partial(place, "far", (1e9, -1e9, 1e9), perspective=_perspective),
        like=partial(place, "far", perspective=_perspective),
    )
    for _scale in (1e-6, 1e6):
        for _regular in (False, True):
            add(
                f"world_{_scale:g}_{'lattice' if _regular else 'ellipsoids'}_{_kind}",
                "place",
                f"{'a lattice' if _regular else 'ellipsoids'} in a world {_scale:g} times as large, {_kind}: "
                "same picture as in the original world",
                partial(place, "scaled", unit_of_length=_scale, perspective=_perspective, regular=_regular),
                like=partial(place, "scaled", perspective=_perspective, regular=_regular),
            )
