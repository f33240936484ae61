"""Kernels against pixels and slices, cameras, opacity, numbers of slices, shapes of pictures."""

from __future__ import annotations

from functools import partial

import numpy as np
from scene_parts import STEP, Parts, central, cloud, parallel, parts, quaternions

import sheetsplat as ss

from .cases import SIZE, TRANSPARENT, Refused, add, case, chance, lattice, upright

# Sizes against pixels and slices


@case("size", "kernels of 0.005 px, some on the centres of pixels")
def kernels_below_a_pixel() -> Parts:
    rng = chance("below")
    width, height = SIZE
    x, y = rng.integers(0, width, 200) + 0.5 - width / 2, height / 2 - rng.integers(0, height, 200) - 0.5
    at = np.stack([x, y, np.where(rng.random(200) < 0.5, 0.5, -0.5)], -1)
    at[:, :2] += rng.uniform(-0.5, 0.5, (200, 2)) * 0.005
    one = {"centers": at, "scales": 0.005 * np.tile((1.0, 0.8, 0.9), (200, 1)), "rotations": quaternions(rng, 200)}
    one |= {"values": rng.uniform(0.5, 1, 200), "w0": 0.3}
    return parts([one], upright(float(height)), size=SIZE, slice_spacing=1.0)


def thin(sampling: str, kernel_filter: str | None) -> Parts:
    """Return upright disks, flat against the slices, some of them on one."""
    rng = chance("thin")
    one = cloud(rng, 300, w0=1e-3)
    one["rotations"] = np.tile(np.eye(3), (300, 1, 1))
    one["scales"] = np.column_stack([rng.uniform(0.1, 0.4, (300, 2)), np.full(300, 0.005)])
    one["centers"][::2, 2] = (np.round(one["centers"][::2, 2]) + 0.5) * 1.0
    one["centers"][:2, 2] = (-1.5, 1.5)
    return parts([one], upright(), size=SIZE, slice_spacing=1.0, sampling=sampling, filter=kernel_filter)


for _sampling in ("point", "slab"):
    for _filter in (None, "ewa"):
        add(
            f"thin_{_sampling}{'_ewa' if _filter else ''}",
            "size",
            f"kernels of 0.005 Δs, {_sampling}{', filter ewa' if _filter else ''}",
            partial(thin, _sampling, _filter),
        )

# Cameras


def around_the_target(regular: bool, large: bool = True) -> Parts:
    """Return a lattice, or ellipsoids of which some are large."""
    if regular:
        return lattice("inside")
    one = cloud(chance("inside"), 80, w0=0.5)
    one["scales"][:5] = (9.0, 7.0, 6.0) if large else 0.4
    return one


def inside(regular: bool, fov: float) -> Parts:
    """Return a view from inside the field."""
    return parts([around_the_target(regular)], central(distance=0.05, fov_y=fov), size=SIZE)


def outside(regular: bool, fov: float) -> Parts:
    """Return a view of the whole field."""
    away = 1.2 / np.tan(np.radians(fov) / 2)
    away = float(max(min(6.0, away) if fov > 1 else away, 1.8))
    return parts([around_the_target(regular, large=False)], central(distance=away, fov_y=fov), size=SIZE)


def cut(regular: bool) -> Parts:
    """Return a view whose near plane lies among kernels."""
    return parts([around_the_target(regular)], central(distance=2.0) | {"near": 1.9}, size=SIZE)


for _regular in (False, True):
    _what = "lattice" if _regular else "ellipsoids"
    for _fov in (0.01, 60.0, 170.0):
        add(
            f"inside_{_fov:g}_{_what}",
            "camera",
            f"the eye inside the field, {_fov:g} degrees, {_what}",
            partial(inside, _regular, _fov),
        )
        add(
            f"outside_{_fov:g}_{_what}",
            "camera",
            f"{_fov:g} degrees, the eye outside the field, {_what}",
            partial(outside, _regular, _fov),
        )
    add(f"near_plane_{_what}", "camera", f"a near plane that cuts kernels, {_what}", partial(cut, _regular))


@case("camera", "kernels larger than the picture, orthographic")
def larger_than_the_picture() -> Parts:
    return parts([around_the_target(False)], parallel(height=0.01), size=SIZE)


@case("camera", "kernels 1e5 times as large as the picture, which contain the eye")
def around_the_eye() -> Parts:
    rng = chance("around")
    one = cloud(rng, 20, w0=0.5)
    one["scales"] = rng.uniform(50, 100, (20, 3))
    return parts([one], central(distance=1e-3, fov_y=30.0), size=SIZE, slice_spacing=5.0)


def plane(kind: str, count: int, off: float) -> Parts:
    """Return a view along an axis of a lattice, turned off it by `off` radians."""
    one = lattice("plane", (count, count, count), lattice=kind)
    if kind == "bcc":
        one["values"] = np.repeat(one["values"], 2, 0)[: 2 * count]
    camera = parallel((np.sin(off), 0.3 * np.sin(off), -np.cos(off)), 2.5, (0, 0, 0), (0, 1, 0))
    step = 2.0 / count
    return parts([one], camera, size=SIZE, slice_spacing=step / (2 if kind == "bcc" else 1))


for _kind in ("cartesian", "bcc"):
    for _count in (8, 9):
        for _off in (0.0, 1e-7):
            _turned = "1e-7 rad off it" if _off else "exactly"
            _layers = "in" if _count % 2 == 0 else "between"
            add(
                f"axis_{_kind}_{_count}_{'off' if _off else 'on'}",
                "camera",
                f"view along an axis of {_kind} {_count}³, {_turned}: slices {_layers} its layers",
                partial(plane, _kind, _count, _off),
            )

# Opacity and transfer functions

FULL = [(0.1, 0.2, 0.4, 0.8, 0.0), (0.6, 0.9, 0.5, 0.2, 1.0), (1.0, 1, 1, 1, 1.0)]
SPIKE = [
    (0.1, 0.2, 0.4, 0.8, 0.0),
    (0.4137 - 5e-5, 0.2, 0.4, 0.8, 0.0),
    (0.4137, 1.0, 0.9, 0.3, 0.9),
    (0.4137 + 5e-5, 0.2, 0.4, 0.8, 0.0),
    (1.0, 1.0, 1.0, 1.0, 0.02),
]
# Name, what it is, its transfer function, options of the scene.
LOOKS = [
    ("opaque", "opacity 1 in one slice", FULL, {}),
    (
        "opaque_preintegrated",
        "opacity 1, pre-integrated, A_stop 0.98",
        FULL,
        {"opacity_stop": 0.98, "preintegration": True},
    ),
    ("opacity_0", "opacity exactly 0", [(0, 1, 0.5, 0.2, 0.0), (1, 1, 1, 1, 0.0)], {}),
    ("step", "a transfer function with a step", STEP, {}),
    ("spike", "a spike a ten thousandth wide, narrower than 1/4096", SPIKE, {"lit": False}),
    ("spike_preintegrated", "the same spike, pre-integrated", SPIKE, {"lit": False, "preintegration": True}),
    (
        "constant",
        "a constant transfer function: only empty points are transparent",
        [(0.0, 0.7, 0.5, 0.3, 0.1), (1.0, 0.7, 0.5, 0.3, 0.1)],
        {},
    ),
    ("one_point", "a transfer function of one point", [(0.5, 0.7, 0.5, 0.3, 0.1)], {"lit": False}),
]


def look(what: str, transfer: list[tuple[float, ...]], options: Parts) -> Parts:
    """Return a field under a transfer function."""
    one = cloud(chance("opacity"), 60, 3.0, w0=0.5) if what == "ellipsoids" else lattice("opacity")
    return parts([one], transfer=transfer, size=SIZE, **options)


for _what in ("ellipsoids", "lattice"):
    for _name, _words, _transfer, _options in LOOKS:
        add(
            f"{_name}_{_what}",
            "opacity",
            f"{_words}, {_what}",
            partial(look, _what, _transfer, _options),
            **({"outcome": TRANSPARENT} if _name == "opacity_0" else {}),
        )


def slices(count: int, opacity: float, size: tuple[int, int], reference_length: float | None = None) -> Parts:
    """Return three ellipsoids in `count` slices."""
    one = {
        "centers": np.array([(0.0, 0.0, -1.0), (0.3, 0.1, 1.0), (-0.2, -0.1, 0.2)]),
        "scales": np.array([(1.2, 1.0, 1.5), (0.9, 0.9, 1.0), (0.8, 1.0, 1.4)]),
        "values": np.array([0.9, 0.7, 1.0]),
        "w0": 0.3,
    }
    spacing = 4.5 / count
    return parts(
        [one],
        upright(2.4),
        transfer=[(0.0, 0.2, 0.4, 0.9, 0.0), (1.0, 1.0, 0.8, 0.4, opacity)],
        size=size,
        slice_spacing=spacing,
        reference_length=reference_length or spacing,
        lit=False,
    )


add("faint_10000", "opacity", "opacity 1e-8 over 10,000 slices", partial(slices, 10_000, 1e-8, (24, 20)))
# What adds up to half, of as little.
add("many_10000", "opacity", "opacity 1e-4 over 10,000 slices", partial(slices, 10_000, 1e-4, (24, 20)))
add("slices_20000", "slices", "20,000 slices, more than 16,384", partial(slices, 20_000, 0.5, (12, 10), 0.5))
add(
    "slices_1100000",
    "slices",
    "1,100,000 slices, more than 2²⁰",
    partial(slices, 1_100_000, 0.5, (4, 3), 0.5),
    slow=True,
)
add(
    "slices_too_many",
    "slices",
    "more than 10⁷ slices",
    partial(slices, 12_000_000, 0.5, (4, 3), 0.5),
    outcome=Refused(ss.InvalidInput, "at most 10,000,000 slices"),
)

# Pictures


def picture_of(width: int, height: int, perspective: bool) -> Parts:
    """Return a picture of this size; those of one row show a thin strip."""
    tall = height > 1 or width == 1
    if perspective:
        camera = central(fov_y=40.0 if tall else 0.02)
    else:
        camera = parallel(height=3.0 if tall else 1e-3)
    return parts([cloud(chance("sized"), 100, 3.0)], camera, size=(width, height), slice_spacing=0.25)


for _width, _height in ((1, 1), (1, 4096), (4096, 1)):
    for _perspective in (False, True):
        _kind = "perspective" if _perspective else "orthographic"
        add(
            f"picture_{_width}x{_height}_{_kind}",
            "picture",
            f"a picture of {_width} × {_height}, {_kind}",
            partial(picture_of, _width, _height, _perspective),
        )
