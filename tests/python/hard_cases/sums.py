"""Sums of many kernels, values and weights of any magnitude."""

from __future__ import annotations

from functools import partial

import numpy as np
from scene_parts import GENTLE, MATERIAL, Parts, cloud, parallel, parts

from .cases import SIZE, add, case, chance, lattice, shifted

RISING = [(0, 0.2, 0.3, 0.4, 0), (2, 1, 0.9, 0.8, 0.4)]


def spot(count: int, lit: bool) -> Parts:
    """Return kernels of random values at one point."""
    one = {"centers": np.full((count, 3), 0.1), "scales": np.full(count, 0.5), "values": chance("spot").random(count)}
    return parts([one], size=(24, 20), lit=lit, slice_spacing=0.2)


def signs(count: int) -> Parts:
    """Return kernels of alternating signs at one point, whose values add up to 1."""
    one = {
        "centers": np.full((count, 3), 0.1),
        "scales": np.full(count, 0.5),
        "values": np.where(np.arange(count) % 2 == 0, 1.0, -1.0) + 1.0 / count,
        "normalization": "none",
    }
    return parts([one], size=(24, 20), slice_spacing=0.2)


def cancelled(count: int) -> Parts:
    """Return pairs of kernels of opposite values."""
    one = {
        "centers": np.repeat(chance("cancelled").uniform(-0.1, 0.1, (count // 2, 3)), 2, 0),
        "scales": np.full(count, 0.5),
        "values": np.where(np.arange(count) % 2 == 0, 1.0, -1.0),
        "normalization": "none",
    }
    return parts([one], size=(24, 20), slice_spacing=0.2)


for _count in (1, 100, 10_000, 100_000):
    for _lit in (True, False):
        _look = "lit" if _lit else "unlit"
        add(
            f"spot_{_count}_{_look}",
            "sums",
            f"{_count:,} kernel{'s' if _count > 1 else ''} at one point, {_look}",
            partial(spot, _count, _lit),
        )
    if _count > 1:
        add(
            f"signs_{_count}",
            "sums",
            f"{_count:,} kernels of alternating signs at one point, whose values add up to 1",
            partial(signs, _count),
        )
        add(
            f"cancelled_{_count}",
            "sums",
            f"{_count:,} kernels in pairs whose sums are 0",
            partial(cancelled, _count),
        )


def window(offset: float, lit: bool) -> Parts:
    """Return values from `offset` to `offset` + 1 and a transfer function over them."""
    one = cloud(chance("window"), 1_000, 12.0, 1.5, w0=1e-3)
    one["values"] = offset + one["values"]
    return parts([one], transfer=shifted(GENTLE, offset), size=SIZE, lit=lit, slice_spacing=0.15)


for _offset in (300.0, 1e9):
    for _lit in (True, False):
        _look = "lit" if _lit else "unlit"
        add(
            f"window_{_offset:g}_{_look}",
            "sums",
            f"values and transfer function from {_offset:g} to {_offset:g} + 1, {_look}",
            partial(window, _offset, _lit),
        )


def lit_from_behind(one: Parts) -> Parts:
    """Return a field of one value, lit from behind."""
    one["values"] = np.ones_like(one["values"])
    made = parts([one], size=SIZE, transfer=RISING, slice_spacing=0.15)
    return made | {"lights": [{"direction": (0.0, 0.0, -1.0)}], "material": MATERIAL | {"two_sided": False}}


@case("sums", "the same value everywhere, a light from behind: gradients are rounding errors alone")
def equal_values_lit_from_behind() -> Parts:
    return lit_from_behind(cloud(chance("equal"), 600, 12.0, 1.5, w0=1e-3))


@case("sums", "the same value on a whole lattice, a light from behind")
def equal_lattice_lit_from_behind() -> Parts:
    return lit_from_behind(lattice("equal", normalization="threshold", w0=1e-3))


@case(
    "sums",
    "one kernel, two-sided light: the gradient is 0 everywhere",
)
def gradient_zero() -> Parts:
    one = {"centers": np.zeros((1, 3)), "scales": np.full(1, 50.0), "values": np.ones(1), "w0": 1e-6}
    return parts([one], parallel(height=2.0), size=SIZE, transfer=RISING, slice_spacing=8.0)


def magnitude(size: float, what: str) -> Parts:
    """Return values of this magnitude."""
    one = cloud(chance("tall"), 60, 2.0, w0=0.5) if what == "ellipsoids" else lattice("tall")
    one["values"] = one["values"] * size
    return parts([one], transfer=shifted(GENTLE, 0, size), size=SIZE)


for _size in (1e-30, 1e30):
    for _what in ("ellipsoids", "lattice"):
        add(
            f"values_{_size:g}_{_what}",
            "sums",
            f"values of {_size:g}, {_what}: same picture as with values of 1",
            partial(magnitude, _size, _what),
            like=partial(magnitude, 1.0, _what),
        )


@case("sums", "values of 1e-310, denormal; transfer function of width 1e-310")
def denormal_values() -> Parts:
    one = cloud(chance("denormal"), 60, 2.0, w0=0.5)
    one["values"] = one["values"] * 1e-310
    return parts([one], transfer=shifted(GENTLE, 0, 1e-310), size=SIZE)


@case("sums", "some values and weights denormal, the others of ordinary size")
def denormals_among_others() -> Parts:
    one = cloud(chance("denormals"), 60, 2.0, w0=0.5)
    one["values"][::2] = 5e-324
    one["weights"] = np.where(np.arange(60) % 3 == 0, 5e-324, 1.0)
    return parts([one], size=SIZE)


@case("sums", "a lattice of which every other value is denormal")
def denormal_lattice() -> Parts:
    one = lattice("denormal")
    one["values"].reshape(-1)[::2] = 5e-324
    return parts([one], size=SIZE)


def weights_of_12_orders(w0: float, lit: bool) -> Parts:
    """Return weights from 1e-6 to 1e6."""
    one = cloud(chance("weights"), 300, 6.0, w0=w0)
    one["weights"] = 10.0 ** chance("orders").uniform(-6, 6, 300)
    return parts([one], size=SIZE, lit=lit)


_words = "weights over 12 orders of magnitude"
add("weights_12_orders", "sums", _words, partial(weights_of_12_orders, 0.3, True))
_words += ", w₀ below all of them"
add("weights_12_orders_divided", "sums", _words, partial(weights_of_12_orders, 1e-9, False))
add("weights_12_orders_divided_lit", "sums", f"{_words}, lit", partial(weights_of_12_orders, 1e-9, True))


def border(w0: float, what: str) -> Parts:
    """Return a field divided by weights that fall to 0."""
    if what == "ellipsoids":
        one = cloud(chance("border"), 30, 1.0, w0=w0)
    else:
        one = lattice("border", (4, 4, 5), normalization="threshold", w0=w0)
    one["values"] = 0.3 + 0.7 * one["values"]
    return parts([one], size=SIZE)


for _w0 in (1e-3, 1e-9, 1e-30):
    for _what in ("ellipsoids", "lattice"):
        add(
            f"border_{_w0:g}_{_what}",
            "sums",
            f"divided by sums of weights that fall to 0 at borders, w₀ = {_w0:g}, {_what}",
            partial(border, _w0, _what),
        )
