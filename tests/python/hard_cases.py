"""Hard cases: what they are, what must come of them, and the table of what was measured.

    python tests/python/hard_cases.py --table     writes python/docs/hard-cases.md
    python tests/python/hard_cases.py NAME...     prints the figures of cases whose names contain one of these

A case is a scene, and its written outcome: a picture within a bound of section 9, a picture that is transparent to the
last bit, or an error of a kind that says why. It holds for every backend, unless a backend is named beside it.
"""

from __future__ import annotations

import copy
import re
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import oracle
import scattered_scenes as scattered
from image_checks import FLOAT32, FLOAT32_HARD, MOST_AMBIGUOUS
from numpy.typing import NDArray
from scattered_scenes import Parts, build, cloud, frame, nudged, parallel, parts, quaternions, unit
from test_scattered_against_reference import jumps

import sheetsplat as ss
from sheetsplat import _sheetsplat

PAGE = Path(__file__).resolve().parents[2] / "python" / "docs" / "hard-cases.md"
BACKENDS = ("gl", "cpu")
SIZE = (44, 36)


@dataclass(frozen=True)
class Refused:
    """An error of this kind, whose message matches."""

    kind: type[ss.Error]
    match: str

    def __str__(self) -> str:
        return f"{self.kind.__name__}: {self.match}"


WITHIN = "within section 9"
TRANSPARENT = "transparent, exactly"
Outcome = str | Refused


@dataclass(frozen=True)
class Case:
    """A scene that is hard to draw. `like`: the scene whose reference it must equal, its own unless given."""

    name: str
    group: str
    words: str
    make: Callable[[], Parts]
    outcome: Outcome = WITHIN
    like: Callable[[], Parts] | None = None
    # Of a backend that cannot draw it within its bound and says so.
    but: dict[str, Refused] = field(default_factory=dict)
    slow: bool = False

    def outcome_on(self, backend: str) -> Outcome:
        """Return what must come of it."""
        return self.but.get(backend, self.outcome)


CASES: dict[str, Case] = {}


def case(
    group: str, words: str, name: str = "", **options: Any
) -> Callable[[Callable[[], Parts]], Callable[[], Parts]]:
    """List a scene."""

    def listed(make: Callable[[], Parts]) -> Callable[[], Parts]:
        one = Case(name or make.__name__, group, words, make, **options)
        assert one.name not in CASES, one.name
        CASES[one.name] = one
        return make

    return listed


def chance(name: str) -> np.random.Generator:
    """Return a generator with a seed of its own for each name."""
    return np.random.default_rng([2005, *name.encode()])


def upright(height: float = 3.0, at: Any = (0.0, 0.0, 0.0)) -> Parts:
    """Return an orthographic camera that looks along -z."""
    return parallel((0, 0, -1), height, at, (0, 1, 0))


def shifted(points: Any, offset: float = 0.0, scale: float = 1.0) -> list[tuple[float, ...]]:
    """Return a transfer function over offset … offset + scale."""
    return [(offset + scale * point[0], *point[1:]) for point in points]


def lattice(name: str, shape: tuple[int, int, int] = (7, 8, 9), **options: Any) -> Parts:
    """Return smooth noise on a lattice about 0, of edge 2 at most; values fade to 0 at its borders."""
    values = chance(name).random(shape)
    for axis in range(3):
        values = (np.roll(values, 1, axis) + values + np.roll(values, -1, axis)) / 3
        window = np.sin(np.pi * (np.arange(shape[axis]) + 0.5) / shape[axis])
        values = values * window.reshape([-1 if a == axis else 1 for a in range(3)])
    step = 2.0 / max(shape)
    origin = tuple(-0.5 * step * (count - 1) for count in shape[::-1])
    return {"values": values / values.max(), "spacing": (step, step, step), "origin": origin} | options


# Shapes


MAGNIFIED = Refused(ss.Unsupported, r"a reference length is 29\d+ pixels or semi-axes")


def _aspects() -> None:
    count = 1_000
    for aspect in (1, 10, 1_000, 100_000):
        for shape in ("needles", "disks"):
            if aspect == 1 and shape == "disks":
                continue
            thin = (1, 1 / aspect, 1 / aspect) if shape == "needles" else (1, 1, 1 / aspect)
            what = "spheres" if aspect == 1 else f"{shape} of 1:{aspect:,}"

            def side_by_side(aspect: int = aspect, shape: str = shape, thin: Any = thin) -> Parts:
                rng = chance(f"side by side {aspect} {shape}")
                x, y = np.meshgrid(np.arange(40) - 19.5, np.arange(25) - 12.0)
                # On centres of pixels and in planes of slices, where the thinnest show too.
                z = np.where(np.arange(count) % 2 == 0, 0.06, -0.06)
                one = {
                    "centers": np.stack([x.ravel(), y.ravel(), z], -1),
                    "scales": 0.48 * np.tile(thin, (count, 1)),
                    "rotations": quaternions(rng, count),
                    "values": rng.uniform(0.5, 1, count),
                    "w0": 0.05,
                }
                return parts([one], upright(25.0), size=(200, 125), slice_spacing=0.12)

            def crossing(aspect: int = aspect, shape: str = shape, thin: Any = thin) -> Parts:
                rng = chance(f"crossing {aspect} {shape}")
                spacing = max(1 / 12, 0.06 * aspect / 50)
                z = spacing * (rng.integers(-1, 1, count) + 0.5)
                one = {
                    "centers": np.column_stack([rng.uniform(-1, 1, (count, 2)), z]),
                    # The thin axes are a pixel or so.
                    "scales": 0.06 * aspect * np.tile(thin, (count, 1)),
                    "rotations": quaternions(rng, count),
                    "values": rng.uniform(0.2, 1, count),
                    "w0": 0.3,
                }
                return parts([one], upright(), size=SIZE, slice_spacing=spacing, reference_length=2 * spacing)

            words = f"1,000 {what} of random orientations, each in a place of its own"
            case("shape", words, f"{shape}_{aspect}_apart")(side_by_side)
            case(
                "shape",
                f"1,000 {what} of random orientations, a pixel thin, through one another",
                f"{shape}_{aspect}_crossing",
                but={"gl": MAGNIFIED} if aspect == 100_000 else {},
            )(crossing)
    for shape, thin in (("needles", (1, 1e-5, 1e-5)), ("disks", (1e-5, 1, 1))):
        for way, axis in (("along", scattered.VIEW), ("across", np.cross(scattered.VIEW, (0.3, 1.0, 0.1)))):
            # Needles along the view and disks across it are deep: slices lie far apart, and through the centres.
            deep = (shape == "needles") == (way == "along")

            def pointing(shape: str = shape, thin: Any = thin, axis: Any = axis, deep: bool = deep) -> Parts:
                rng = chance(f"pointing {shape}")
                spacing = 200.0 if deep else 0.2
                at = rng.uniform(-1, 1, (60, 3))
                if deep:
                    view = unit(scattered.VIEW)
                    at += (spacing * (rng.integers(-1, 1, 60) + 0.5) - at @ view)[:, None] * view
                one = {
                    "centers": at,
                    "scales": 1e4 * np.tile(thin, (60, 1)) * rng.uniform(0.5, 1, (60, 1)),
                    # Not quite: off by some ten millionths.
                    "rotations": np.stack([frame(unit(axis) + 1e-5 * rng.normal(size=3)) for _ in range(60)]),
                    "values": rng.random(60),
                    "w0": 0.3,
                }
                return parts([one], size=SIZE, slice_spacing=spacing)

            words = f"{shape} of 1:100,000 {way} the view"
            case("shape", words, f"{shape}_100000_{way}_view")(pointing)


_aspects()


@case(
    "shape",
    "1,000 disks of 1:100,000, a pixel thin, lit, askew to the view: 2,880 pixels are a reference length",
    but={"gl": MAGNIFIED},
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


def _scales() -> None:
    spacing = 1e6
    for height in (3.0, 3e-7, 3e8):

        def seen(height: float = height) -> Parts:
            rng = chance("scales")
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

        large = Refused(ss.Unsupported, r"(ellipsoids|kernels) of 5\.\d+e\+15 pixels; wanted at most 1e\+12")
        but = {"gl": large, "cpu": large} if height < 1 else {}
        words = f"semi-axes from 1e-8 to 1e8 in one field, a picture {height:g} tall"
        case("shape", words, f"scales_16_decades_{height:g}", but=but)(seen)


_scales()


# Places


def place(
    name: str, at: Any = (0, 0, 0), unit_of_length: float = 1.0, central: bool = False, regular: bool = False
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
        # Whole 256ths: what a float64 can say as well a thousand million away, so that the move itself loses nothing.
        one["centers"] = np.round(one["centers"] * 256) / 256 * unit_of_length + at
        one["scales"] = one["scales"] * unit_of_length
    camera = (scattered.central() if central else parallel()) | {}
    for end in ("eye", "target"):
        camera[end] = tuple(np.round(np.asarray(camera[end]) * 256) / 256 * unit_of_length + at)
    if "height" in camera:
        camera["height"] *= unit_of_length
    return parts([one], camera, size=SIZE, slice_spacing=unit_of_length / 8)


def _places() -> None:
    for central in (False, True):
        kind = "perspective" if central else "orthographic"

        def far(central: bool = central) -> Parts:
            return place("far", (1e9, -1e9, 1e9), central=central)

        def near(central: bool = central) -> Parts:
            return place("far", central=central)

        case("place", f"centres around 1e9, {kind}: the picture of the same about 0", f"far_{kind}", like=near)(far)
        for scale in (1e-6, 1e6):
            for regular in (False, True):

                def scaled(scale: float = scale, central: bool = central, regular: bool = regular) -> Parts:
                    return place("scaled", unit_of_length=scale, central=central, regular=regular)

                def plain(central: bool = central, regular: bool = regular) -> Parts:
                    return place("scaled", central=central, regular=regular)

                what = "a lattice" if regular else "ellipsoids"
                name = f"world_{scale:g}_{'lattice' if regular else 'ellipsoids'}_{kind}"
                case(
                    "place",
                    f"{what} in a world {scale:g} times as large, {kind}: an unchanged picture",
                    name,
                    like=plain,
                )(scaled)


_places()


# Sums


CROWDED = "ellipsoids (of one size at one place|at a point)"


def _crowds() -> None:
    for count in (1, 100, 10_000, 100_000):
        for lit in (True, False):

            def spot(count: int = count, lit: bool = lit) -> Parts:
                one = {
                    "centers": np.full((count, 3), 0.1),
                    "scales": np.full(count, 0.5),
                    "values": chance("spot").random(count),
                }
                return parts([one], size=(24, 20), lit=lit, slice_spacing=0.2)

            look = "lit" if lit else "unlit"
            but = {}
            if (lit and count >= 10_000) or count >= 100_000:
                but["gl"] = Refused(ss.Unsupported, CROWDED)
            case("sums", f"{count:,} kernels on one spot, {look}", f"spot_{count}_{look}", but=but)(spot)
        if count == 1:
            continue

        def signs(count: int = count) -> Parts:
            one = {
                "centers": np.full((count, 3), 0.1),
                "scales": np.full(count, 0.5),
                # What is left of them all is one.
                "values": np.where(np.arange(count) % 2 == 0, 1.0, -1.0) + 1.0 / count,
                "normalization": "none",
            }
            return parts([one], size=(24, 20), slice_spacing=0.2)

        but = {"gl": Refused(ss.Unsupported, CROWDED)} if count > 10_000 else {}
        case(
            "sums",
            f"{count:,} kernels of alternating signs on one spot, which add up to one",
            f"signs_{count}",
            but=but,
        )(signs)

        def cancelled(count: int = count) -> Parts:
            rng = chance("cancelled")
            at = np.repeat(rng.uniform(-0.1, 0.1, (count // 2, 3)), 2, 0)
            one = {
                "centers": at,
                "scales": np.full(count, 0.5),
                "values": np.where(np.arange(count) % 2 == 0, 1.0, -1.0),
                "normalization": "none",
            }
            return parts([one], size=(24, 20), slice_spacing=0.2)

        case(
            "sums",
            f"{count:,} kernels in pairs that cancel: nothing",
            f"cancelled_{count}",
        )(cancelled)


_crowds()


def _windows() -> None:
    for offset in (300.0, 1e9):
        for lit in (True, False):

            def window(offset: float = offset, lit: bool = lit) -> Parts:
                one = cloud(chance("window"), 1_000, 12.0, 1.5, w0=1e-3)
                one["values"] = offset + one["values"]
                return parts([one], transfer=shifted(scattered.GENTLE, offset), size=SIZE, lit=lit, slice_spacing=0.15)

            look = "lit" if lit else "unlit"
            case(
                "sums",
                f"a transfer function over {offset:g} … {offset:g} + 1, {look}",
                f"window_{offset:g}_{look}",
                but={"gl": Refused(ss.Unsupported, "values up to")} if offset > 1e3 else {},
            )(window)


_windows()


@case("sums", "the same value everywhere, a light from behind: no gradient but rounding")
def equal_values_lit_from_behind() -> Parts:
    one = cloud(chance("equal"), 600, 12.0, 1.5, w0=1e-3)
    one["values"] = np.ones(600)
    made = parts([one], size=SIZE, transfer=[(0, 0.2, 0.3, 0.4, 0), (2, 1, 0.9, 0.8, 0.4)], slice_spacing=0.15)
    return made | {"lights": [{"direction": (0.0, 0.0, -1.0)}], "material": scattered.MATERIAL | {"two_sided": False}}


@case("sums", "the same value on a whole lattice, a light from behind")
def equal_lattice_lit_from_behind() -> Parts:
    one = lattice("equal", normalization="threshold", w0=1e-3)
    one["values"] = np.ones_like(one["values"])
    made = parts([one], size=SIZE, transfer=[(0, 0.2, 0.3, 0.4, 0), (2, 1, 0.9, 0.8, 0.4)], slice_spacing=0.15)
    return made | {"lights": [{"direction": (0.0, 0.0, -1.0)}], "material": scattered.MATERIAL | {"two_sided": False}}


@case(
    "sums",
    "one value and one weight on one spot, two-sided: gradient zero everywhere",
    but={"gl": Refused(ss.Unsupported, r"weights of up to 1e\+06 times w0")},
)
def gradient_zero() -> Parts:
    one = {"centers": np.zeros((1, 3)), "scales": np.full(1, 50.0), "values": np.ones(1), "w0": 1e-6}
    made = parts(
        [one],
        parallel(height=2.0),
        size=SIZE,
        transfer=[(0, 0.2, 0.3, 0.4, 0), (2, 1, 0.9, 0.8, 0.4)],
        slice_spacing=8.0,
    )
    return made


def _magnitudes() -> None:
    for size in (1e-30, 1e30):
        for what in ("ellipsoids", "lattice"):

            def tall(size: float = size, what: str = what) -> Parts:
                one = cloud(chance("tall"), 60, 2.0, w0=0.5) if what == "ellipsoids" else lattice("tall")
                one["values"] = one["values"] * size
                return parts([one], transfer=shifted(scattered.GENTLE, 0, size), size=SIZE)

            def plain(what: str = what) -> Parts:
                one = cloud(chance("tall"), 60, 2.0, w0=0.5) if what == "ellipsoids" else lattice("tall")
                return parts([one], size=SIZE)

            case(
                "sums", f"values of {size:g}, {what}: the picture of values of 1", f"values_{size:g}_{what}", like=plain
            )(tall)


_magnitudes()


@case("sums", "values of 1e-310, denormal, in a window of 1e-310")
def denormal_values() -> Parts:
    one = cloud(chance("denormal"), 60, 2.0, w0=0.5)
    one["values"] = one["values"] * 1e-310
    return parts([one], transfer=shifted(scattered.GENTLE, 0, 1e-310), size=SIZE)


@case("sums", "some values and weights denormal, beside ordinary ones")
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


@case("sums", "weights over 12 orders of magnitude")
def weights_12_orders() -> Parts:
    one = cloud(chance("weights"), 300, 6.0, w0=0.3)
    one["weights"] = 10.0 ** chance("orders").uniform(-6, 6, 300)
    return parts([one], size=SIZE)


@case("sums", "weights over 12 orders of magnitude, a threshold below all of them")
def weights_12_orders_divided() -> Parts:
    one = cloud(chance("weights"), 300, 6.0, w0=1e-9)
    one["weights"] = 10.0 ** chance("orders").uniform(-6, 6, 300)
    return parts([one], size=SIZE, lit=False)


@case("sums", "weights over 12 orders of magnitude, a threshold below all of them, lit")
def weights_12_orders_divided_lit() -> Parts:
    one = cloud(chance("weights"), 300, 6.0, w0=1e-9)
    one["weights"] = 10.0 ** chance("orders").uniform(-6, 6, 300)
    return parts([one], size=SIZE)


def _borders() -> None:
    for w0 in (1e-3, 1e-9, 1e-30):
        for what in ("ellipsoids", "lattice"):

            def border(w0: float = w0, what: str = what) -> Parts:
                if what == "ellipsoids":
                    one = cloud(chance("border"), 30, 1.0, w0=w0)
                    one["values"] = 0.3 + 0.7 * one["values"]
                else:
                    one = lattice("border", (4, 4, 5), normalization="threshold", w0=w0)
                    one["values"] = 0.3 + 0.7 * one["values"]
                return parts([one], size=SIZE)

            case("sums", f"divided by weights that fall to 0 at borders, w₀ = {w0:g}, {what}", f"border_{w0:g}_{what}")(
                border
            )


_borders()


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


def _thin() -> None:
    for sampling in ("point", "slab"):
        for filter_ in (None, "ewa"):

            def thin(sampling: str = sampling, filter_: str | None = filter_) -> Parts:
                rng = chance("thin")
                one = cloud(rng, 300, w0=1e-3)
                # Upright disks, flat against the slices, some of them on one.
                one["rotations"] = np.tile(np.eye(3), (300, 1, 1))
                one["scales"] = np.column_stack([rng.uniform(0.1, 0.4, (300, 2)), np.full(300, 0.005)])
                one["centers"][::2, 2] = (np.round(one["centers"][::2, 2]) + 0.5) * 1.0
                one["centers"][:2, 2] = (-1.5, 1.5)
                return parts([one], upright(), size=SIZE, slice_spacing=1.0, sampling=sampling, filter=filter_)

            name = f"thin_{sampling}{'_ewa' if filter_ else ''}"
            words = f"kernels of 0.005 Δs, {sampling}{', filter ewa' if filter_ else ''}"
            case("size", words, name)(thin)


_thin()


def _inside() -> None:
    def large(regular: bool) -> Parts:
        if regular:
            return lattice("inside")
        one = cloud(chance("inside"), 80, w0=0.5)
        one["scales"][:5] = (9.0, 7.0, 6.0)
        return one

    for regular in (False, True):
        what = "lattice" if regular else "ellipsoids"
        for fov in (0.01, 60.0, 170.0):

            def eye(regular: bool = regular, fov: float = fov) -> Parts:
                return parts([large(regular)], scattered.central(distance=0.05, fov_y=fov), size=SIZE)

            case("camera", f"the eye inside the field, {fov:g} degrees, {what}", f"inside_{fov:g}_{what}")(eye)

            def outside(regular: bool = regular, fov: float = fov) -> Parts:
                away = min(6.0, 1.2 / np.tan(np.radians(fov) / 2)) if fov > 1 else 1.2 / np.tan(np.radians(fov) / 2)
                one = large(regular)
                if not regular:
                    one["scales"][:5] = 0.4
                return parts([one], scattered.central(distance=float(max(away, 1.8)), fov_y=fov), size=SIZE)

            case("camera", f"{fov:g} degrees from outside, {what}", f"outside_{fov:g}_{what}")(outside)

        def cut(regular: bool = regular) -> Parts:
            return parts([large(regular)], scattered.central(distance=2.0) | {"near": 1.9}, size=SIZE)

        case("camera", f"a near plane through kernels, {what}", f"near_plane_{what}")(cut)

    @case("camera", "kernels larger than the picture, orthographic")
    def larger_than_the_picture() -> Parts:
        return parts([large(False)], parallel(height=0.01), size=SIZE)

    @case("camera", "kernels 1e5 times as large as the picture that contain the eye")
    def around_the_eye() -> Parts:
        rng = chance("around")
        one = cloud(rng, 20, w0=0.5)
        one["scales"] = rng.uniform(50, 100, (20, 3))
        return parts([one], scattered.central(distance=1e-3, fov_y=30.0), size=SIZE, slice_spacing=5.0)


_inside()


def _planes() -> None:
    for kind in ("cartesian", "bcc"):
        for count in (8, 9):
            for off in (0.0, 1e-7):

                def plane(kind: str = kind, count: int = count, off: float = off) -> Parts:
                    one = lattice("plane", (count, count, count), lattice=kind)
                    if kind == "bcc":
                        one["values"] = np.repeat(one["values"], 2, 0)[: 2 * count]
                    camera = parallel((np.sin(off), 0.3 * np.sin(off), -np.cos(off)), 2.5, (0, 0, 0), (0, 1, 0))
                    step = 2.0 / count
                    return parts([one], camera, size=SIZE, slice_spacing=step / (2 if kind == "bcc" else 1))

                turned = "1e-7 rad off it" if off else "exactly"
                layers = "in" if count % 2 == 0 else "between"
                words = f"view along an axis of {kind} {count}³, {turned}: slices {layers} its layers"
                case("camera", words, f"axis_{kind}_{count}_{'off' if off else 'on'}")(plane)


_planes()


# Opacity and transfer functions


def _opacities() -> None:
    for what in ("ellipsoids", "lattice"):

        def one_of(what: str = what) -> Parts:
            return cloud(chance("opacity"), 60, 3.0, w0=0.5) if what == "ellipsoids" else lattice("opacity")

        def full(what: str = what, one_of: Any = one_of) -> Parts:
            transfer = [(0.1, 0.2, 0.4, 0.8, 0.0), (0.6, 0.9, 0.5, 0.2, 1.0), (1.0, 1, 1, 1, 1.0)]
            return parts([one_of(what)], transfer=transfer, size=SIZE)

        case("opacity", f"opacity 1 in one slice, {what}", f"opaque_{what}")(full)

        def full_stop(what: str = what, one_of: Any = one_of) -> Parts:
            transfer = [(0.1, 0.2, 0.4, 0.8, 0.0), (0.6, 0.9, 0.5, 0.2, 1.0), (1.0, 1, 1, 1, 1.0)]
            return parts([one_of(what)], transfer=transfer, size=SIZE, opacity_stop=0.98, preintegration=True)

        case("opacity", f"opacity 1, pre-integrated, A_stop 0.98, {what}", f"opaque_preintegrated_{what}")(full_stop)

        def nothing(what: str = what, one_of: Any = one_of) -> Parts:
            return parts([one_of(what)], transfer=[(0, 1, 0.5, 0.2, 0.0), (1, 1, 1, 1, 0.0)], size=SIZE)

        case("opacity", f"opacity exactly 0, {what}", f"opacity_0_{what}", outcome=TRANSPARENT)(nothing)

        def stepped(what: str = what, one_of: Any = one_of) -> Parts:
            return parts([one_of(what)], transfer=scattered.STEP, size=SIZE)

        case("opacity", f"a transfer function with a step, {what}", f"step_{what}")(stepped)

        def spike(what: str = what, one_of: Any = one_of) -> Parts:
            middle = 0.4137
            transfer = [
                (0.1, 0.2, 0.4, 0.8, 0.0),
                (middle - 5e-5, 0.2, 0.4, 0.8, 0.0),
                (middle, 1.0, 0.9, 0.3, 0.9),
                (middle + 5e-5, 0.2, 0.4, 0.8, 0.0),
                (1.0, 1.0, 1.0, 1.0, 0.02),
            ]
            return parts([one_of(what)], transfer=transfer, size=SIZE, lit=False)

        case("opacity", f"a spike a ten thousandth wide, narrower than 1/4096, {what}", f"spike_{what}")(spike)

        def spike_preintegrated(what: str = what, spike: Any = spike) -> Parts:
            made = copy.deepcopy(spike(what))
            made["scene"]["preintegration"] = True
            return made

        case("opacity", f"the same spike, pre-integrated, {what}", f"spike_preintegrated_{what}")(spike_preintegrated)

        def constant(what: str = what, one_of: Any = one_of) -> Parts:
            return parts([one_of(what)], transfer=[(0.0, 0.7, 0.5, 0.3, 0.1), (1.0, 0.7, 0.5, 0.3, 0.1)], size=SIZE)

        case("opacity", f"a constant transfer function: emptiness alone is transparent, {what}", f"constant_{what}")(
            constant
        )

        def point(what: str = what, one_of: Any = one_of) -> Parts:
            return parts([one_of(what)], transfer=[(0.5, 0.7, 0.5, 0.3, 0.1)], size=SIZE, lit=False)

        case("opacity", f"a transfer function of one point, {what}", f"one_point_{what}")(point)

    def faint(count: int, opacity: float, size: tuple[int, int], lit: bool) -> Parts:
        one = {
            "centers": np.array([(0.0, 0.0, -1.0), (0.3, 0.1, 1.0), (-0.2, -0.1, 0.2)]),
            "scales": np.array([(1.2, 1.0, 1.5), (0.9, 0.9, 1.0), (0.8, 1.0, 1.4)]),
            "values": np.array([0.9, 0.7, 1.0]),
            "w0": 0.3,
        }
        spacing = 4.5 / count
        transfer = [(0.0, 0.2, 0.4, 0.9, 0.0), (1.0, 1.0, 0.8, 0.4, opacity)]
        return parts(
            [one], upright(2.4), transfer=transfer, size=size, slice_spacing=spacing, reference_length=spacing, lit=lit
        )

    case("opacity", "opacity 1e-8 over 10,000 slices", "faint_10000")(lambda: faint(10_000, 1e-8, (24, 20), False))
    # What adds up to half, of as little.
    case("opacity", "opacity 1e-4 over 10,000 slices", "many_10000")(lambda: faint(10_000, 1e-4, (24, 20), False))

    def thick(count: int, size: tuple[int, int]) -> Parts:
        made = faint(count, 0.5, size, False)
        made["scene"]["reference_length"] = 0.5
        return made

    case("slices", "20,000 slices, more than 16,384", "slices_20000")(lambda: thick(20_000, (12, 10)))
    case("slices", "1,100,000 slices, more than 2²⁰", "slices_1100000", slow=True)(lambda: thick(1_100_000, (4, 3)))
    case(
        "slices",
        "more than 10⁷ slices",
        "slices_too_many",
        outcome=Refused(ss.InvalidInput, "at most 10,000,000 slices"),
    )(lambda: thick(12_000_000, (4, 3)))


_opacities()


# Pictures


def _pictures() -> None:
    for width, height in ((1, 1), (1, 4096), (4096, 1)):
        for central in (False, True):

            def sized(width: int = width, height: int = height, central: bool = central) -> Parts:
                tall = height > 1 or width == 1
                camera = (
                    scattered.central(fov_y=40.0 if tall else 0.02)
                    if central
                    else parallel(height=3.0 if tall else 1e-3)
                )
                return parts([cloud(chance("sized"), 100, 3.0)], camera, size=(width, height), slice_spacing=0.25)

            kind = "perspective" if central else "orthographic"
            case("picture", f"a picture of {width} × {height}, {kind}", f"picture_{width}x{height}_{kind}")(sized)


_pictures()


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


@case("field", "all of it beside the picture", outcome=TRANSPARENT)
def all_outside() -> Parts:
    return parts([cloud(chance("outside"), 60)], parallel(at=(50, 60, 70)), size=SIZE)


@case("field", "all of it behind the eye", outcome=TRANSPARENT)
def all_behind() -> Parts:
    camera = scattered.central()
    eye, target = np.asarray(camera["eye"]), np.asarray(camera["target"])
    return parts([cloud(chance("behind"), 60)], camera | {"target": tuple(2 * eye - target)}, size=SIZE)


@case("field", "a lattice of NaN, skipped", outcome=TRANSPARENT)
def all_nan() -> Parts:
    return parts([{"values": np.full((4, 5, 6), np.nan), "nan": "skip"}], size=SIZE, slice_spacing=1.0)


@case("field", "a lattice of NaN, not skipped", outcome=Refused(ss.InvalidInput, "NaN"))
def nan_not_skipped() -> Parts:
    return parts([{"values": np.full((4, 5, 6), np.nan)}], size=SIZE)


@case("field", "half of a lattice's samples NaN, skipped, divided by what is left")
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
    return parts([one], size=SIZE) | {"lights": lights, "material": scattered.MATERIAL | material}


def _lights() -> None:
    opposite: list[Parts] = [{"direction": (0.4, 0.6, 1.0)}, {"direction": (-0.4, -0.6, -1.0)}]
    for regular in (False, True):
        what = "lattice" if regular else "ellipsoids"
        for sides in (False, True):
            case(
                "light",
                f"two lights opposite each other, {'two' if sides else 'one'}-sided, {what}",
                f"opposite_{sides + 1}_{what}",
            )(lambda sides=sides, regular=regular: lit("opposite", opposite, regular, two_sided=sides))
        for way, z in (("along", -1.0), ("against", 1.0)):
            case("light", f"light {way} the view, {what}", f"light_{way}_{what}")(
                lambda z=z, regular=regular: lit("along", [{"direction": (0.0, 0.0, z)}], regular)
            )
        case("light", f"specular exponent 10⁴, {what}", f"shininess_{what}")(
            lambda regular=regular: lit("shininess", scattered.LIGHTS, regular, specular=1.0, shininess=1e4)
        )
        case("light", f"directions of lights of lengths 1e-130 and 1e130, {what}", f"light_lengths_{what}")(
            lambda regular=regular: lit(
                "lengths", [{"direction": (1e-130, 2e-130, 1e-130)}, {"direction": (1e130, -1e130, 1e130)}], regular
            )
        )

    case(
        "light",
        "a direction of length 1e-200",
        "light_too_short",
        outcome=Refused(ss.InvalidInput, "a direction whose length is between 1e-140 and 1e150"),
    )(lambda: lit("lengths", [{"direction": (1e-200, 2e-200, 1e-200)}]))


_lights()


# Judgement


@dataclass(frozen=True)
class Measured:
    """What came of a case on a backend."""

    refusal: ss.Error | None = None
    rmse: float = 0.0
    p99_9: float = 0.0
    maximum: float = 0.0
    ambiguous: int = 0
    pixels: int = 1
    precision: str = ""
    bounds: tuple[float, float] = FLOAT32_HARD
    transparent: bool = False
    finite: bool = True

    def kept(self) -> bool:
        """Return whether section 9 is kept; one pixel may be ambiguous in the smallest of pictures."""
        few = self.ambiguous <= max(1, MOST_AMBIGUOUS * self.pixels)
        return self.finite and self.rmse <= self.bounds[0] and self.p99_9 <= self.bounds[1] and few

    def __str__(self) -> str:
        if self.refusal is not None:
            return f"{type(self.refusal).__name__}"
        if self.transparent:
            return "0"
        left = f", {self.ambiguous} px ambiguous" if self.ambiguous else ""
        wide = ", float64" if self.precision == "float64" else ""
        return f"{self.rmse:.1e} / {self.maximum:.1e}{wide}{left}"


@cache
def scene_of(name: str) -> Parts:
    """Return the scene of a case."""
    return CASES[name].make()


def by_reference(parts_: Parts) -> ss.Image:
    """Return the reference's picture."""
    scene, camera, size = build(ss, parts_)
    return ss.Renderer("reference").render(scene, camera, size=size)


@cache
def expected_of(name: str) -> ss.Image:
    """Return the picture that a case must give."""
    like = CASES[name].like
    return by_reference(like() if like is not None else scene_of(name))


@cache
def renderer_of(backend: str) -> ss.Renderer:
    """Return one renderer for all cases."""
    return ss.Renderer(backend)  # type: ignore[arg-type]


@cache
def ambiguous_of(name: str) -> NDArray[np.bool_] | None:
    """Return the pixels that jump under the nudges of section 9; None where nothing can jump."""
    made = scene_of(name)
    if not jumps(made):
        return None
    scene = build(ss, made)[0]
    span = made["transfer"][-1][0] - made["transfer"][0][0]
    moves: list[dict[str, float]] = []
    for sign in (-1, 1):
        moves += [{"rho": sign * 1e-5 * span}, {"support": sign * 1e-5}]
        if made["scene"].get("opacity_stop", 0.98) < 1:
            moves.append({"stop": sign * 1e-5})
    found = np.zeros(made["size"][::-1], bool)
    here = by_reference(made).rgba
    for move in moves:
        moved = by_reference(nudged(made, scene.slice_spacing, scene.reference_length, **move))
        found |= np.abs(moved.rgba - here).max(-1) > 1e-3
    return found


def distance(actual: Any, expected: Any) -> dict[str, float]:
    """Return rmse, p99_9 and maximum of section 8."""
    one, other = np.ascontiguousarray(actual), np.ascontiguousarray(expected)
    return _sheetsplat.compare(one, other, 1 if one.ndim == 2 else 4)


def is_gentle(made: Parts) -> bool:
    """Return whether the tighter bound of section 9 holds."""
    if sum(len(one.get("centers", ())) for one in made["fields"]) == 0 and "centers" in made["fields"][0]:
        return True
    with np.errstate(over="ignore"):
        return oracle.is_gentle(*build(oracle, made))


def measure(name: str, backend: str) -> Measured:
    """Return what comes of a case on a backend."""
    try:
        scene, camera, size = build(ss, scene_of(name))
        image = renderer_of(backend).render(scene, camera, size=size)
    except ss.Error as error:
        return Measured(refusal=error)
    pixels = np.array(np.asarray(image))
    facts: dict[str, Any] = {
        "pixels": size[0] * size[1],
        "precision": image.plan.precision,
        "transparent": not pixels.any(),
        "finite": bool(np.isfinite(pixels).all()),
    }
    expected = np.asarray(expected_of(name))
    bounds = FLOAT32 if is_gentle(scene_of(name)) else FLOAT32_HARD
    found = distance(pixels, expected)
    count = 0
    if found["rmse"] > bounds[0] or found["p99_9"] > bounds[1]:
        jumping = ambiguous_of(name)
        if jumping is not None:
            pixels[jumping] = expected[jumping]
            found = distance(pixels, expected)
            count = int(jumping.sum())
    return Measured(
        rmse=found["rmse"], p99_9=found["p99_9"], maximum=found["maximum"], ambiguous=count, bounds=bounds, **facts
    )


def fault(outcome: Outcome, found: Measured) -> str:
    """Return how far what was found is from what was written, or an empty text."""
    if isinstance(outcome, Refused):
        if found.refusal is None:
            return f"drawn ({found}) where an error was written: {outcome}"
        if type(found.refusal) is not outcome.kind or not re.search(outcome.match, str(found.refusal)):
            return f"another error than {outcome}: {found.refusal!r}"
        return "" if str(found.refusal).count(";") >= 1 else f"an error that does not say enough: {found.refusal}"
    if found.refusal is not None:
        return f"refused: {found.refusal}"
    if outcome == TRANSPARENT:
        return "" if found.transparent else f"not transparent: {found}"
    limits = f"at most {found.bounds[0]:.0e}, P99.9 {found.p99_9:.2e} at most {found.bounds[1]:.0e}"
    return "" if found.kept() else f"RMSE {found.rmse:.2e} {limits}: {found}"


@dataclass(frozen=True)
class Property:
    """What must hold beside single pictures. `check` returns the figure, and what is wrong or an empty text."""

    name: str
    words: str
    outcome: str
    check: Callable[[str], tuple[str, str]]


PROPERTIES: dict[str, Property] = {}


def promised(
    words: str, outcome: str
) -> Callable[[Callable[[str], tuple[str, str]]], Callable[[str], tuple[str, str]]]:
    """List a property."""

    def listed(check: Callable[[str], tuple[str, str]]) -> Callable[[str], tuple[str, str]]:
        PROPERTIES[check.__name__] = Property(check.__name__, words, outcome, check)
        return check

    return listed


# Of each kind one: both fields and all of them together, both cameras, both samplings, quotients, slender kernels.
DIVERSE = (
    "needles_10_crossing",
    "far_perspective",
    "world_1e+06_lattice_perspective",
    "thin_slab",
    "half_nan",
    "weights_12_orders",
    "spot_10000_unlit",
    "opaque_preintegrated_ellipsoids",
    "axis_bcc_9_off",
)


def picture(name: str, renderer: ss.Renderer) -> NDArray[np.float32]:
    """Return the pixels of a case."""
    scene, camera, size = build(ss, scene_of(name))
    return np.array(np.asarray(renderer.render(scene, camera, size=size)))


@promised(
    "the same picture again, by the same renderer between other pictures, and by another one", "every bit the same"
)
def repeated_frames(backend: str) -> tuple[str, str]:
    one, other = ss.Renderer(backend), ss.Renderer(backend)  # type: ignore[arg-type]
    first = {name: picture(name, one) for name in DIVERSE}
    changed = 0
    for name in reversed(DIVERSE):
        changed += not np.array_equal(first[name], picture(name, one))
        changed += not np.array_equal(first[name], picture(name, other))
    return f"{changed} of {2 * len(DIVERSE)} pictures changed", "" if changed == 0 else "some changed"


@promised("kernels in any order", WITHIN)
def any_order(backend: str) -> tuple[str, str]:
    worst, wrong = 0.0, ""
    for name in DIVERSE:
        made = copy.deepcopy(scene_of(name))
        if "centers" not in made["fields"][0]:
            continue
        one = made["fields"][0]
        count = len(one["centers"])
        for seed in range(2):
            order = np.random.default_rng(seed).permutation(count) if seed else np.arange(count)[::-1]
            turned = copy.deepcopy(made)
            turned["fields"][0] = {
                key: value[order] if isinstance(value, np.ndarray) and len(value) == count else value
                for key, value in one.items()
            }
            scene, camera, size = build(ss, turned)
            image = renderer_of(backend).render(scene, camera, size=size)
            found = distance(image, expected_of(name))
            worst = max(worst, found["rmse"])
            if found["rmse"] > FLOAT32_HARD[0] or found["p99_9"] > FLOAT32_HARD[1]:
                wrong = f"{name}: {found}"
    return f"{worst:.1e}", wrong


@promised("one kernel laid as two of half its weight", WITHIN)
def halves(backend: str) -> tuple[str, str]:
    worst, wrong = 0.0, ""
    for name in DIVERSE:
        made = copy.deepcopy(scene_of(name))
        if "centers" not in made["fields"][0]:
            continue
        one = made["fields"][0]
        count = len(one["centers"])
        one["weights"] = 0.5 * np.asarray(one.get("weights", np.ones(count)))
        made["fields"][0] = {
            key: np.concatenate([value, value]) if isinstance(value, np.ndarray) and len(value) == count else value
            for key, value in one.items()
        }
        scene, camera, size = build(ss, made)
        found = distance(renderer_of(backend).render(scene, camera, size=size), expected_of(name))
        worst = max(worst, found["rmse"])
        if found["rmse"] > FLOAT32_HARD[0] or found["p99_9"] > FLOAT32_HARD[1]:
            wrong = f"{name}: {found}"
    return f"{worst:.1e}", wrong


def open_files() -> int:
    """Return how many files and sockets this process holds."""
    return len(list(Path("/proc/self/fd").iterdir())) if Path("/proc/self/fd").exists() else 0


def made_and_dropped(backend: str, count: int) -> tuple[str, str]:
    """Draw with many renderers, one after another, and look at what is left of them."""
    name = "one_kernel"
    first = picture(name, ss.Renderer(backend))  # type: ignore[arg-type]
    picture(name, ss.Renderer(backend))  # type: ignore[arg-type]
    files = open_files()
    changed = sum(
        not np.array_equal(first, picture(name, ss.Renderer(backend)))  # type: ignore[arg-type]
        for _ in range(count)
    )
    more = open_files() - files
    text = f"{changed} pictures changed, {more} files left"
    return text, "" if changed == 0 and more <= 0 else text


@promised(
    "40 renderers made and dropped, each with a context of its own (1,000 in `test_lifetime`)",
    "nothing is left of them",
)
def contexts(backend: str) -> tuple[str, str]:
    return made_and_dropped(backend, 40)


@promised("8 threads, with one renderer for all and with one for each", "every bit the same")
def eight_threads(backend: str) -> tuple[str, str]:
    names = ("needles_10_crossing", "half_nan", "thin_slab")
    shared = ss.Renderer(backend)  # type: ignore[arg-type]
    expected = {name: picture(name, shared) for name in names}
    wrong: list[str] = []

    def work(number: int) -> None:
        renderer = shared if number % 2 else ss.Renderer(backend)  # type: ignore[arg-type]
        for turn in range(3):
            name = names[(number + turn) % 3]
            try:
                if not np.array_equal(picture(name, renderer), expected[name]):
                    wrong.append(name)
            except Exception as error:  # a thread's error is a fault of the case
                wrong.append(repr(error))

    threads = [threading.Thread(target=work, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return f"{len(wrong)} of 24 pictures changed", "; ".join(wrong)


def _row(*cells: str) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _outcome_text(one: Case) -> str:
    texts = []
    for backend in BACKENDS:
        outcome = one.outcome_on(backend)
        texts.append(f"`{outcome.kind.__name__}`" if isinstance(outcome, Refused) else outcome)
    return texts[0] if texts[0] == texts[1] else "; ".join(f"{b}: {t}" for b, t in zip(BACKENDS, texts, strict=True))


def table() -> str:
    """Measure everything and return the page."""
    lines = [INTRODUCTION]
    devices = {}
    for backend in BACKENDS:
        scene, camera, size = build(ss, scene_of("one_kernel"))
        devices[backend] = renderer_of(backend).plan(scene, camera, size=size).device
    lines.append(f"Measured on: gl {devices['gl']}; cpu {devices['cpu']}.\n")
    for group in dict.fromkeys(one.group for one in CASES.values()):
        lines += [f"## {TITLES[group]}\n", _row("case", "what it is", "outcome", "gl", "cpu"), "|---|---|---|---|---|"]
        for name, one in CASES.items():
            if one.group != group:
                continue
            figures = []
            for backend in BACKENDS:
                found = measure(name, backend)
                wrong = fault(one.outcome_on(backend), found)
                if wrong:
                    print(f"{name} on {backend}: {wrong}", file=sys.stderr)
                figures.append(f"**{found}**" if wrong else str(found))
            lines.append(_row(f"`{name}`", one.words, _outcome_text(one), *figures))
        lines.append("")
    lines += [
        "## Beside single pictures\n",
        _row("case", "what it is", "outcome", "gl", "cpu"),
        "|---|---|---|---|---|",
    ]
    for name, promise in PROPERTIES.items():
        figures = []
        for backend in BACKENDS:
            text, wrong = promise.check(backend)
            if wrong:
                print(f"{name} on {backend}: {wrong}", file=sys.stderr)
            figures.append(f"**{text}**" if wrong else text)
        lines.append(_row(f"`{name}`", promise.words, promise.outcome, *figures))
    lines += ["", PROMISE, _row("field", "way", *BACKENDS), "|---|---|---|---|"]
    import test_frame_to_frame as turning

    for kind, way in turning.SCENES:
        figures = [f"{turning.beyond(backend, kind, way):.1e}" for backend in BACKENDS]
        lines.append(_row(kind, way, *figures))
    return "\n".join(lines) + "\n" + CLOSING


TITLES = {
    "shape": "Shapes and sizes",
    "place": "Places and units of length",
    "sums": "Sums, values and weights",
    "size": "Smaller than pixels and slices",
    "camera": "Cameras",
    "opacity": "Opacity and transfer functions",
    "slices": "Many slices",
    "picture": "Pictures",
    "field": "Fields",
    "light": "Light",
}

INTRODUCTION = """# Hard cases

Every case has its outcome written down beside its scene, in `tests/python/hard_cases.py`, and
`tests/python/test_hard_cases.py` holds each backend to it. This page is made by
`python tests/python/hard_cases.py --table`.

Figures are RMSE / largest difference from the float64 reference, premultiplied RGBA, over all pixels that are not
ambiguous ([conventions](conventions.md), section 9; where pixels were left out, their number stands beside). "within
section 9": RMSE at most 2·10⁻⁵ and P99.9 at most 2·10⁻⁴ for gentle scenes, 10⁻⁴ and 10⁻³ for all others. An outcome
that names an error is a clear refusal, which says what was found, what was wanted and what to do. float64: the plan
chose it by itself, as float32 would not keep the bound. `auto` takes the first backend that draws the case. 0: nothing
can be seen, and every number is exactly 0. A figure in bold would be a fault: the bound missed without an
error.
"""

PROMISE = """## From frame to frame

With A_stop = 1, a transfer function without steps whose opacity at 0 is 0, and no near plane among kernels, the picture
of the definition is a continuous function of the view: slices, sections and supports end at 0. So it has a derivative
by the angle (but for kinks), and this is promised of every backend:

> When the view is turned by δ = 0.01°, no pixel changes by more than δ times the largest analytic derivative on the
> way, once, plus 2·10⁻⁴.

What is kept is sharper: the change of every pixel is the reference's change between the same two views, within
2·10⁻⁴ (section 9's P99.9 for gentle scenes; here it holds for all pixels). So nothing pops where samples change their
buckets or their order, where slices begin and end, where kernels are culled or the plan changes.
`tests/python/test_frame_to_frame.py` turns seven fields through views along an axis, along the diagonals of a face and
of the body, half a step off an axis, and others; a second test makes the angle twenty times smaller and sees the
reference's own change shrink along, which a jump would not. Largest difference of the two changes:
"""

CLOSING = """
Pictures jump, and so may be off at single pixels, where the transfer function has steps, in mode isosurface, where
opacity at 0 is above 0, and where A_stop is below 1.

## A picture of 20,000 × 20,000

`sheetsplat.tiles.render_tiles` draws a picture of an orthographic camera tile by tile into an .npy file; every tile has
the slices of the whole picture. `./run bench huge` draws 20,000 × 20,000 pixels (6.4 GB) and
compares 64 windows with the reference, 32 of them across borders of tiles and 16 of these at their corners. On two
shared cores: 67 s, a peak of 195 MB, RMSE at most 7.0·10⁻⁷, largest difference 3.0·10⁻⁶. A perspective picture cannot
be drawn in parts, as its parts are seen askew: that is an error.

## Found by chance

`tests/python/test_fuzz_scenes.py` draws scenes by hypothesis (fields, cameras, transfer functions, effects, knobs) and
holds backends against the reference as they are, with kernels reordered or laid as two, in another unit of length, at
another place and in tiles of any size. `tests/python/test_fuzz_readers.py` spoils valid files of 33 kinds, and lets a
reader answer with a field or an error of the package, without more than 256 MB or 20 s. `SHEETSPLAT_FUZZ=2000` draws
more, anew each time. `tests/python/fuzz_readers.py` follows the readers' branches (atheris).
"""


def main(arguments: list[str]) -> None:
    """Print figures, or write the table."""
    if "--table" in arguments:
        PAGE.write_text(table(), encoding="utf-8")
        return
    wanted = [one for one in arguments if not one.startswith("-")]
    for name, one in CASES.items():
        if wanted and not any(part in name for part in wanted):
            continue
        texts = []
        for backend in BACKENDS:
            began = time.perf_counter()
            found = measure(name, backend)
            wrong = fault(one.outcome_on(backend), found)
            seconds = time.perf_counter() - began
            texts.append(f"{backend} {found} {seconds:.1f}s" + (f"  WRONG {wrong}" if wrong else ""))
        print(name, "|", " | ".join(texts), flush=True)
    for name, promise in PROPERTIES.items():
        if wanted and not any(part in name for part in wanted):
            continue
        for backend in BACKENDS:
            began = time.perf_counter()
            print(name, "|", backend, *promise.check(backend), f"{time.perf_counter() - began:.1f}s", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
