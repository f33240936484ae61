"""Scenes of scattered ellipsoids, made from fixed seeds, for holding renderers against each other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scene_parts import (
    GENTLE,
    OPAQUE,
    SIZE,
    STEP,
    VIEW,
    ZERO_SEEN,
    Parts,
    central,
    cloud,
    frame,
    parallel,
    parts,
    pick,
    random_camera,
    unit,
)

SCENES: dict[str, Callable[[np.random.Generator], Parts]] = {}


def scene(maker: Callable[[np.random.Generator], Parts]) -> Callable[[np.random.Generator], Parts]:
    """List a scene under its function's name."""
    SCENES[maker.__name__] = maker
    return maker


def named(name: str) -> Parts:
    """Return a listed scene, the same at every call."""
    return SCENES[name](np.random.default_rng([2006, *name.encode()]))


def _counts() -> None:
    for count in (1, 2, 10, 100, 1_000, 10_000, 100_000):
        for kind, camera in (("parallel", parallel()), ("central", central())):
            if count == 100_000 and kind == "central":
                continue

            def maker(rng: np.random.Generator, count: int = count, camera: dict[str, Any] = camera) -> Parts:
                # A few kernels as large as the cube would be one blur: their supports do not meet everywhere.
                overlap = min(8.0, 0.15 * count)
                normal = {"w0": 0.5} if count < 100 else {}
                large = count >= 10_000
                return parts(
                    [cloud(rng, count, overlap, 3.0 if count < 100_000 else 2.0, **normal)],
                    camera,
                    slice_spacing=1 / 9 if large else 1 / 12,
                    size=(44, 40) if large else SIZE,
                )

            maker.__name__ = f"count_{count}_{kind}"
            scene(maker)


def _aspects() -> None:
    for aspect in (1, 20, 100, 1_000):
        for kind, camera in (("parallel", parallel()), ("central", central())):

            def maker(rng: np.random.Generator, aspect: int = aspect, camera: dict[str, Any] = camera) -> Parts:
                return parts([cloud(rng, 60, 1.0, float(aspect), w0=0.5)], camera)

            maker.__name__ = f"aspect_{aspect}_{kind}"
            scene(maker)


def _pointing() -> None:
    shapes = {"needles": (0.9, 0.02, 0.015), "disks": (0.01, 0.6, 0.5)}
    # The first axis: a needle's length, a disk's normal.
    axes = {"along": VIEW, "across": tuple(np.cross(VIEW, (0.3, 1.0, 0.1)).tolist())}
    for shape, scales in shapes.items():
        for way, axis in axes.items():
            for kind, camera in (("parallel", parallel()), ("central", central())):

                def maker(
                    rng: np.random.Generator,
                    scales: tuple[float, float, float] = scales,
                    axis: tuple[float, float, float] = axis,
                    camera: dict[str, Any] = camera,
                ) -> Parts:
                    count = 60
                    field = {
                        "centers": rng.uniform(-0.8, 0.8, (count, 3)),
                        "scales": np.tile(scales, (count, 1)),
                        "rotations": np.tile(frame(axis), (count, 1, 1)),
                        "values": rng.random(count),
                        "w0": 0.5,
                    }
                    return parts([field], camera)

                maker.__name__ = f"{shape}_{way}_{kind}"
                scene(maker)


_counts()
_aspects()
_pointing()


@scene
def sizes_over_decades(rng: np.random.Generator) -> Parts:
    """Semi-axes from 1e-4 to 1."""
    field = cloud(rng, 400, w0=0.3)
    field["scales"] = 10.0 ** rng.uniform(-4, 0, (400, 1)) * rng.uniform(0.3, 1, (400, 3))
    return parts([field])


@scene
def sizes_over_decades_central(rng: np.random.Generator) -> Parts:
    """Semi-axes from 1e-4 to 1, with the eye among them."""
    field = cloud(rng, 400, w0=0.3)
    field["scales"] = 10.0 ** rng.uniform(-4, 0, (400, 1)) * rng.uniform(0.3, 1, (400, 3))
    return parts([field], central(distance=0.9, fov_y=60))


@scene
def tiny_ones_in_one_place(rng: np.random.Generator) -> Parts:
    """Hundreds of kernels of 1e-6 in one point of a large one."""
    field = cloud(rng, 301)
    field["scales"] = np.full(301, 1e-6)
    field["scales"][0] = 1.0
    field["centers"][1:] = 0.1 + 1e-6 * rng.normal(size=(300, 3))
    return parts([field])


@scene
def clusters(rng: np.random.Generator) -> Parts:
    """Dense heaps with nothing between them, hundreds of supports deep."""
    middle = rng.uniform(-0.9, 0.9, (5, 3))
    field = cloud(rng, 2_000)
    field["centers"] = middle[rng.integers(5, size=2_000)] + 0.05 * rng.normal(size=(2_000, 3))
    field["scales"] = rng.uniform(0.05, 0.2, (2_000, 3))
    return parts([field])


@scene
def duplicates(rng: np.random.Generator) -> Parts:
    """The same kernel many times over, beside others."""
    field = cloud(rng, 40)
    for name in ("centers", "scales", "rotations", "values"):
        field[name][10:30] = field[name][10]
    return parts([field])


@scene
def weights_over_decades(rng: np.random.Generator) -> Parts:
    """Weights from 1e-3 to 10, and some that are 0: a kernel of weight 0 fills its support with ρ = 0."""
    weights = 10.0 ** rng.uniform(-3, 1, 300)
    weights[::7] = 0
    return parts([cloud(rng, 300, weights=weights, w0=0.4)])


@scene
def weights_of_zero_seen(rng: np.random.Generator) -> Parts:
    """Opacity above 0 at ρ = 0, where a kernel of weight 0 is no empty space."""
    weights = rng.uniform(0, 1, 60)
    weights[::3] = 0
    return parts([cloud(rng, 60, 1.0, weights=weights, w0=0.5)], transfer=ZERO_SEEN)


@scene
def negative_values(rng: np.random.Generator) -> Parts:
    """Values from -1 to 1, negative ones shown too."""
    field = cloud(rng, 300, normalization="none", overlap=4.0)
    field["values"] = rng.uniform(-1, 1, 300)
    transfer = [
        (-1.0, 0.1, 0.3, 0.9, 0.3),
        (-0.1, 0.2, 0.4, 0.8, 0.0),
        (0.1, 0.8, 0.5, 0.1, 0.0),
        (1.0, 1, 0.8, 0.2, 0.3),
    ]
    return parts([field], transfer=transfer)


@scene
def values_with_offset(rng: np.random.Generator) -> Parts:
    """A window of 1 at 1,000 on a field that is about 1,000 everywhere."""
    field = cloud(rng, 1_500, 12.0, 1.5, w0=1e-3)
    field["values"] = 1_000 + rng.random(1_500)
    transfer = [(1_000 + point[0], *point[1:]) for point in GENTLE]
    return parts([field], transfer=transfer)


@scene
def values_with_small_offset(rng: np.random.Generator) -> Parts:
    """A window of 1 at 10 on a field that is about 10 everywhere."""
    field = cloud(rng, 1_500, 12.0, 1.5, w0=1e-2)
    field["values"] = 10 + rng.random(1_500)
    return parts([field], transfer=[(10 + point[0], *point[1:]) for point in GENTLE])


@scene
def large_and_small_units(rng: np.random.Generator) -> Parts:
    """Values of 1e6 in a world of 1e-5."""
    field = cloud(rng, 100)
    field["centers"] *= 1e-5
    field["scales"] *= 1e-5
    field["values"] *= 1e6
    camera = parallel(height=3e-5)
    camera["eye"] = tuple(-3e-5 * unit(VIEW))
    return parts([field], camera, transfer=[(1e6 * p[0], *p[1:]) for p in GENTLE], slice_spacing=1e-6)


@scene
def normalization_none(rng: np.random.Generator) -> Parts:
    return parts([cloud(rng, 300, 4.0, normalization="none")], central())


@scene
def normalization_lattice(rng: np.random.Generator) -> Parts:
    return parts([cloud(rng, 1_000, 12.0, 2.0, normalization="lattice", cell_volume=8 / 1_000)])


@scene
def small_threshold(rng: np.random.Generator) -> Parts:
    """Divided by hardly any weight at the supports' edges."""
    return parts([cloud(rng, 100, w0=1e-2)], central())


@scene
def one_larger_than_the_picture(rng: np.random.Generator) -> Parts:
    """One kernel that covers everything, with small ones inside it."""
    field = cloud(rng, 200, 2.0)
    field["scales"][0] = (9, 7, 6)
    return parts([field], parallel(height=2.0), slice_spacing=0.3)


@scene
def all_larger_than_the_picture(rng: np.random.Generator) -> Parts:
    """The camera looks at a thousandth of the kernels."""
    return parts([cloud(rng, 30, w0=0.5)], central(distance=2.0, fov_y=0.3), slice_spacing=0.1)


@scene
def eye_among_them(rng: np.random.Generator) -> Parts:
    """Kernels behind, beside and around a perspective camera."""
    return parts([cloud(rng, 500)], central(distance=0.05, fov_y=75.0))


@scene
def near_plane_cuts(rng: np.random.Generator) -> Parts:
    """The near plane lies in the middle."""
    return parts([cloud(rng, 500)], central(distance=2.0) | {"near": 1.9})


@scene
def eye_in_a_needle(rng: np.random.Generator) -> Parts:
    """Long needles pass through the eye and out of the picture."""
    field = cloud(rng, 40, w0=0.5)
    field["scales"] = np.tile((3.0, 0.1, 0.05), (40, 1))
    return parts([field], central(distance=0.3, fov_y=60.0))


@scene
def behind_the_eye(rng: np.random.Generator) -> Parts:
    """Nothing is seen: everything lies behind."""
    return parts([cloud(rng, 50)], central(direction=(0, 0, -1), at=(0, 0, -6), distance=1.0))


@scene
def beside_the_picture(rng: np.random.Generator) -> Parts:
    """Most supports lie outside, some of them reach in by one pixel: a gradient needs them."""
    return parts([cloud(rng, 500)], parallel(height=0.7, at=(0.9, 0.7, 0.1)))


def _smaller(normalization: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    field = cloud(rng, 500) | normalization
    field["scales"] = rng.uniform(0.004, 0.02, (500, 3))
    return field


@scene
def smaller_than_a_pixel(rng: np.random.Generator) -> Parts:
    """Supports of a tenth of a pixel to a third of one: most are missed, few are hit."""
    return parts([_smaller({"w0": 0.5}, rng)], slice_spacing=0.01)


@scene
def thinner_than_a_slab(rng: np.random.Generator) -> Parts:
    """Flat kernels that most slices miss."""
    field = cloud(rng, 200, 2.0, w0=0.5)
    field["scales"] = np.tile((0.3, 0.3, 0.01), (200, 1))
    field["rotations"] = np.tile(frame(VIEW)[:, [1, 2, 0]], (200, 1, 1))
    return parts([field])


@scene
def thinner_than_a_slab_averaged(rng: np.random.Generator) -> Parts:
    """Flat kernels in slabs, which miss none."""
    return thinner_than_a_slab(rng) | {"camera": central()} | _also(thinner_than_a_slab(rng), sampling="slab")


def _also(found: Parts, **scene: Any) -> Parts:
    return {"scene": found["scene"] | scene}


@scene
def far_from_the_origin(rng: np.random.Generator) -> Parts:
    """The cube lies 1e9 from the origin."""
    at = np.array([1.0e9, -2.0e9, 0.5e9])
    field = cloud(rng, 300)
    field["centers"] += at
    return parts([field], parallel(at=at))


@scene
def far_from_the_origin_central(rng: np.random.Generator) -> Parts:
    """The cube lies 1e9 from the origin, and so does the eye."""
    at = np.array([-1.0e9, 1.0e9, 1.5e9])
    field = cloud(rng, 300)
    field["centers"] += at
    return parts([field], central(at=at))


@scene
def far_outlier(rng: np.random.Generator) -> Parts:
    """One kernel lies 1e5 away and holds the anchor of the slices."""
    field = cloud(rng, 200)
    field["centers"][0] = (1e5, 0, 0)
    return parts([field], parallel(direction=(0.0, 0.3, -1.0), up=(0, 1, 0)), slice_spacing=0.1)


def _ball(shape: tuple[int, int, int]) -> NDArray[np.float32]:
    at = np.stack(np.meshgrid(*(np.linspace(-1, 1, count) for count in shape), indexing="ij"))
    return np.asarray(np.clip(1.1 - np.sqrt((at**2).sum(0)), 0, 1), np.float32)


def _cartesian() -> dict[str, Any]:
    return {"values": 0.6 * _ball((8, 9, 7)), "spacing": (0.2, 0.22, 0.18), "origin": (-0.9, -0.8, -0.2)}


def _bcc() -> dict[str, Any]:
    return {"values": 0.6 * _ball((12, 6, 6)), "spacing": (0.25,) * 3, "origin": (-0.3, -0.2, -1.0), "lattice": "bcc"}


@scene
def mixed_lattices_and_ellipsoids(rng: np.random.Generator) -> Parts:
    """Cartesian, BCC and ellipsoids that overlap, none of them with a threshold."""
    return parts([_cartesian(), _bcc(), cloud(rng, 200, 2.0, normalization="none")])


@scene
def mixed_with_threshold(rng: np.random.Generator) -> Parts:
    """Cartesian, BCC and ellipsoids with a threshold."""
    return parts([_cartesian(), _bcc(), cloud(rng, 200, w0=0.7)], central())


@scene
def mixed_slabs(rng: np.random.Generator) -> Parts:
    """Cartesian, BCC and ellipsoids in slabs, perspective."""
    return parts([_cartesian(), _bcc(), cloud(rng, 200, 2.0, normalization="none")], central(), sampling="slab")


@scene
def several_thresholds(rng: np.random.Generator) -> Parts:
    """Three fields, each divided by a weight of its own."""
    fields = [cloud(rng, 80, 3.0, w0=w0) for w0 in (0.3, 0.8, 1.0)]
    for field in fields:
        field["values"] *= 0.5
    return parts(fields)


@scene
def several_fields_of_different_falloff(rng: np.random.Generator) -> Parts:
    """Two sums that add up, of different profiles and counts."""
    one = cloud(rng, 150, 3.0, normalization="none", falloff=8.0)
    other = cloud(rng, 10, 1.0, normalization="none", falloff=2.0)
    return parts([one, other])


@scene
def field_without_kernels(rng: np.random.Generator) -> Parts:
    """An empty field beside a full one."""
    nothing = {"centers": np.zeros((0, 3)), "scales": np.zeros((0, 3)), "values": np.zeros(0), "normalization": "none"}
    return parts([nothing, cloud(rng, 100, 3.0, normalization="none")])


@scene
def nothing_at_all(rng: np.random.Generator) -> Parts:
    """One field without a kernel before a background."""
    nothing = {"centers": np.zeros((0, 3)), "scales": np.zeros((0, 3)), "values": np.zeros(0)}
    return parts([nothing], background=(0.2, 0.4, 0.6))


def _surfaces() -> None:
    """List the modes, samplings and options over one dense field, both cameras."""
    options: dict[str, dict[str, Any]] = {
        "unlit": {"lit": False},
        "slab": {"sampling": "slab"},
        "isosurface": {"mode": "isosurface", "iso_value": 0.5},
        "isosurface_slab": {"mode": "isosurface", "iso_value": 0.5, "sampling": "slab"},
        "xray": {"mode": "xray"},
        "xray_slab": {"mode": "xray", "sampling": "slab"},
        "mip": {"mode": "mip"},
        "mip_slab": {"mode": "mip", "sampling": "slab"},
        "preintegration": {"preintegration": True},
        "preintegration_slab": {"preintegration": True, "sampling": "slab"},
        "opaque": {"transfer": OPAQUE, "opacity_stop": 0.95},
        "step": {"transfer": STEP},
        "zero_seen": {"transfer": ZERO_SEEN},
        "background": {"background": (0.3, 0.5, 0.7)},
        "fine": {"slice_spacing": 1 / 60, "reference_length": 1 / 12},
        "coarse": {"slice_spacing": 0.5, "reference_length": 0.5},
        "default_spacing": {"slice_spacing": None},
    }
    for name, chosen in options.items():
        for kind, camera in (("parallel", parallel()), ("central", central())):

            def maker(
                rng: np.random.Generator, chosen: dict[str, Any] = chosen, camera: dict[str, Any] = camera
            ) -> Parts:
                return parts([cloud(rng, 250, 10.0, 2.5)], camera, **chosen)

            maker.__name__ = f"{name}_{kind}"
            scene(maker)


_surfaces()


def _filtered() -> None:
    for name, change in (
        ("ewa", {}),
        ("ewa_slab", {"sampling": "slab"}),
        ("ewa_xray", {"mode": "xray"}),
        ("ewa_isosurface", {"mode": "isosurface", "iso_value": 0.3}),
    ):
        for kind, camera in (("parallel", parallel()), ("central", central(fov_y=55.0, distance=2.2))):

            def maker(
                rng: np.random.Generator, change: dict[str, Any] = change, camera: dict[str, Any] = camera
            ) -> Parts:
                field = cloud(rng, 400, 6.0, 6.0, w0=0.3)
                tiny = rng.random(400) < 0.5
                field["scales"][tiny] *= 10.0 ** rng.uniform(-2, 0, (int(tiny.sum()), 1))
                # Such small kernels keep their mass, so they carry more of it.
                field["weights"] = np.where(tiny, 5.0, 1.0)
                return parts([field], camera, filter="ewa", **change)

            maker.__name__ = f"{name}_{kind}"
            scene(maker)


_filtered()


@scene
def ewa_aspects(rng: np.random.Generator) -> Parts:
    """Needles and disks of 1:1,000 under the filter."""
    return parts([cloud(rng, 100, 1.0, 1_000.0, w0=0.1)], central(), filter="ewa")


@scene
def ewa_of_points(rng: np.random.Generator) -> Parts:
    """Kernels of 1e-6, seen by the filter alone."""
    field = cloud(rng, 60, normalization="none")
    field["scales"] = np.full(60, 1e-6)
    # The mass of a kernel as large as the filter.
    field["weights"] = np.full(60, 0.5 * 0.0625**2 * (1 / 12) / 1e-18)
    return parts([field], filter="ewa")


def _ends() -> None:
    for sampling in ("point", "slab"):

        def maker(rng: np.random.Generator, sampling: str = sampling) -> Parts:
            """Two kernels that the filter alone brings into the slices before the first and after the last."""
            field = {
                "centers": np.array([(0.02, 0.05, 0.98), (0.1, -0.03, -0.98)]),
                "scales": np.full(2, 0.01),
                "values": np.array([0.9, 0.6]),
                "weights": np.full(2, 800.0),
                "w0": 0.1,
            }
            camera = parallel(direction=(0, 0, -1), height=2.0, up=(0, 1, 0))
            return parts([field], camera, filter="ewa", sampling=sampling, slice_spacing=0.5)

        maker.__name__ = f"ewa_at_the_ends_{sampling}"
        scene(maker)


_ends()


@scene
def falloffs(rng: np.random.Generator) -> Parts:
    """A profile that hardly falls, with a corner at its edge."""
    return parts([cloud(rng, 200, falloff=0.5)])


@scene
def steep_falloff(rng: np.random.Generator) -> Parts:
    """A profile that falls at once."""
    return parts([cloud(rng, 600, 20.0, falloff=30.0, w0=0.3)], central())


@scene
def spheres(rng: np.random.Generator) -> Parts:
    """Isotropic radii, (N,)."""
    return parts(
        [{"centers": rng.uniform(-1, 1, (500, 3)), "scales": rng.uniform(0.05, 0.3, 500), "values": rng.random(500)}],
        central(),
    )


@scene
def matrices_and_least_scale(rng: np.random.Generator) -> Parts:
    """Rotations as matrices, axes raised to a least one."""
    field = cloud(rng, 100, aspect=40.0)
    field["rotations"] = np.stack([frame(rng.normal(size=3)) for _ in range(100)])
    return parts([field | {"min_scale": 0.05, "w0": 0.5}])


def _sizes() -> None:
    for width, height in ((1, 1), (7, 33), (33, 7), (65, 3)):

        def maker(rng: np.random.Generator, width: int = width, height: int = height) -> Parts:
            camera = pick(rng, parallel(), central())
            return parts([cloud(rng, 150)], camera, size=(width, height))

        maker.__name__ = f"size_{width}x{height}"
        scene(maker)


_sizes()


def _random_cameras() -> None:
    for number in range(6):

        def maker(rng: np.random.Generator) -> Parts:
            return parts([cloud(rng, 300, 6.0, 10.0, w0=0.5)], random_camera(rng, 2.0))

        maker.__name__ = f"random_camera_{number}"
        scene(maker)


_random_cameras()
