"""Fields without kernels, with one, with NaN or infinite values; lights and materials."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from scene_parts import LIGHTS, MATERIAL, Parts, central, cloud, parallel, parts

import sheetsplat as ss

from .cases import SIZE, TRANSPARENT, Refused, add, case, chance, lattice


@case("field", "a field without a kernel", outcome=TRANSPARENT)
def empty_field() -> Parts:
    return parts([{"centers": np.zeros((0, 3)), "scales": np.zeros((0, 3)), "values": np.zeros(0)}], size=SIZE)


@case("field", "one kernel")
def one_kernel() -> Parts:
    return parts([cloud(chance("one"), 1, 0.1, w0=0.5)], size=SIZE)


@case("field", "a lattice of one sample")
def one_sample() -> Parts:
    return parts([{"values": np.ones((1, 1, 1)), "spacing": (0.4, 0.4, 0.4), "normalization": "none"}], size=SIZE)


@case("field", "values that the transfer function does not show", outcome=TRANSPARENT)
def all_invisible() -> Parts:
    return parts([cloud(chance("invisible"), 60)], transfer=[(1.5, 1, 0.5, 0.2, 0.0), (2, 1, 1, 1, 0.5)], size=SIZE)


@case("field", "all kernels outside the picture", outcome=TRANSPARENT)
def all_outside() -> Parts:
    return parts([cloud(chance("outside"), 60)], parallel(at=(50, 60, 70)), size=SIZE)


@case("field", "all kernels behind the eye", outcome=TRANSPARENT)
def all_behind() -> Parts:
    camera = central()
    eye, target = np.asarray(camera["eye"]), np.asarray(camera["target"])
    return parts([cloud(chance("behind"), 60)], camera | {"target": tuple(2 * eye - target)}, size=SIZE)


@case("field", "a lattice of NaN, skipped", outcome=TRANSPARENT)
def all_nan() -> Parts:
    return parts([{"values": np.full((4, 5, 6), np.nan), "nan": "skip"}], size=SIZE, slice_spacing=1.0)


@case("field", "a lattice of NaN, not skipped", outcome=Refused(ss.InvalidInput, "NaN"))
def nan_not_skipped() -> Parts:
    return parts([{"values": np.full((4, 5, 6), np.nan)}], size=SIZE)


@case("field", "half of a lattice's samples NaN, skipped, divided by the weights of the others")
def half_nan() -> Parts:
    one = lattice("nan", nan="skip", normalization="threshold", w0=0.1)
    one["values"][chance("half").random(one["values"].shape) < 0.5] = np.nan
    return parts([one], size=SIZE)


@case("field", "infinite values", outcome=Refused(ss.InvalidInput, "finite|inf"))
def infinite_values() -> Parts:
    return parts([cloud(chance("infinite"), 5, values=np.full(5, np.inf))], size=SIZE)


@case("field", "a semi-axis of 0", outcome=Refused(ss.InvalidInput, "a kernel has no thickness"))
def flat_kernel() -> Parts:
    one = cloud(chance("flat"), 5)
    one["scales"][2, 1] = 0
    return parts([one], size=SIZE)


# Light


def lit(name: str, lights: list[Parts], regular: bool = False, **material: Any) -> Parts:
    """Return a scene under these lights."""
    one = lattice(name) if regular else cloud(chance(name), 60, 3.0, w0=0.5)
    return parts([one], size=SIZE) | {"lights": lights, "material": MATERIAL | material}


def directions(*found: tuple[float, float, float]) -> list[Parts]:
    """Return white lights from these directions."""
    return [{"direction": direction} for direction in found]


for _regular in (False, True):
    _what = "lattice" if _regular else "ellipsoids"
    for _sides in (False, True):
        add(
            f"opposite_{_sides + 1}_{_what}",
            "light",
            f"two lights opposite each other, {'two' if _sides else 'one'}-sided, {_what}",
            partial(lit, "opposite", directions((0.4, 0.6, 1.0), (-0.4, -0.6, -1.0)), _regular, two_sided=_sides),
        )
    for _way, _z in (("along", -1.0), ("against", 1.0)):
        add(
            f"light_{_way}_{_what}",
            "light",
            f"light {_way} the view, {_what}",
            partial(lit, "along", directions((0.0, 0.0, _z)), _regular),
        )
    add(
        f"shininess_{_what}",
        "light",
        f"specular exponent 10⁴, {_what}",
        partial(lit, "shininess", LIGHTS, _regular, specular=1.0, shininess=1e4),
    )
    add(
        f"light_lengths_{_what}",
        "light",
        f"directions of lights of lengths 1e-130 and 1e130, {_what}",
        partial(lit, "lengths", directions((1e-130, 2e-130, 1e-130), (1e130, -1e130, 1e130)), _regular),
    )
add(
    "light_too_short",
    "light",
    "a direction of length 1e-200",
    partial(lit, "lengths", directions((1e-200, 2e-200, 1e-200))),
    outcome=Refused(ss.InvalidInput, "a direction whose length is between 1e-140 and 1e150"),
)
