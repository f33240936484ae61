"""Settings with a known order of convergence have it, over four halvings, on analytic scenes.

Etiene et al. 2013 and 2014 are the method: the slope of the logarithm of the error over that of the knob. Scenes are
three wide ellipsoids, whose scalar along a ray is known in closed form, flat, without an opacity stop; integrating it
densely in float64 gives the converged picture. Only errors above ten times the arithmetic floor count. Each test has a
control, a wrong weight that lowers the order, which must fall short of what is asked for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import sheetsplat as ss
from sheetsplat.accuracy.sweeps import cut_off, enlarge, table
from sheetsplat.ripple import lattice_ripple

Array = NDArray[np.float64]

CENTERS = np.array([[-0.5, 0.2, 0.3], [0.6, -0.3, -0.4], [0.1, 0.5, -0.9]])
SCALES = np.array([[2.6, 2.1, 3.0], [2.3, 2.8, 2.2], [3.1, 2.4, 2.0]])
# Unit quaternions w, x, y, z.
TURNS = np.array([[0.8, 0.4, -0.4, 0.2], [0.5, -0.5, 0.5, 0.5], [0.6, 0.0, 0.8, 0.0]])
VALUES = np.array([0.8, 0.6, 0.5])
# At the falloff of scattered fields, kernels end with a kink of the second order; at the other it is far below float32.
FALLOFF, SMOOTH = 8.0, 20.0
# Linear from 0 to above the largest scalar, so that it has no kinks.
TRANSFER = [(0.0, 0.1, 0.2, 0.9, 0.0), (1.7, 1.0, 0.8, 0.1, 0.99)]
LENGTH = 0.5
HEIGHT, FOV, DISTANCE = 3.0, 20.0, 10.0
SPACINGS = (0.8, 0.4, 0.2, 0.1, 0.05, 0.025)
# Of higher order, so the error reaches the rounding of float32 sooner.
COARSE = (1.2, 0.6, 0.3, 0.15, 0.075)
# How far a fitted order may be below the known one.
SLACK = 0.3
BACKENDS = ["reference", "cpu", pytest.param("gl", marks=pytest.mark.gl)]


@cache
def renderer(backend: str) -> ss.Renderer:
    return ss.Renderer(backend, precision="float64" if backend == "cpu" else "auto")  # type: ignore[arg-type]


@cache
def field(falloff: float = FALLOFF) -> ss.EllipsoidField:
    return ss.EllipsoidField(CENTERS, SCALES, TURNS, VALUES, normalization="none", falloff=falloff)


def matrix(turn: Array) -> Array:
    w, x, y, z = turn
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def scalar(points: Array, falloff: float) -> Array:
    """Return the field's scalar at points (..., 3), by its definition."""
    total = np.zeros(points.shape[:-1])
    lowered = math.exp(-falloff)
    for center, scale, turn, value in zip(CENTERS, SCALES, TURNS, VALUES, strict=True):
        square = (((points - center) @ matrix(turn) / scale) ** 2).sum(-1)
        total += value * np.maximum(0.0, (np.exp(-falloff * square) - lowered) / (1.0 - lowered))
    return total


def camera(kind: str) -> ss.Camera:
    eye = (0.0, 0.0, DISTANCE)
    if kind == "perspective":
        return ss.Camera.perspective(eye, (0, 0, 0), fov_y=FOV)
    return ss.Camera.orthographic(eye, (0, 0, 0), height=HEIGHT)


@cache
def converged(size: int, kind: str = "orthographic", falloff: float = FALLOFF) -> Array:
    """Return the picture of rays integrated densely: C = ∫ τ c exp(−∫ τ), A = 1 − exp(−∫ τ)."""
    ndc = (2.0 * np.arange(size) + 1.0) / size - 1.0
    x, y = np.meshgrid(ndc, -ndc)
    # Of each unit of depth: across, and along the ray.
    slope = math.tan(math.radians(FOV) / 2)
    stretch = np.sqrt(1.0 + slope**2 * (x**2 + y**2)) if kind == "perspective" else np.ones_like(x)
    values, rows = np.array([row[0] for row in TRANSFER]), np.array([row[1:] for row in TRANSFER])

    def integrated(steps: int) -> Array:
        depths = np.linspace(DISTANCE - 4.5, DISTANCE + 4.5, steps + 1)
        across = slope * depths if kind == "perspective" else np.full(len(depths), HEIGHT / 2)
        points = np.stack(
            [x[..., None] * across, y[..., None] * across, np.broadcast_to(DISTANCE - depths, (*x.shape, len(depths)))],
            axis=-1,
        )
        rho = scalar(points, falloff)
        color = np.stack([np.interp(rho, values, rows[:, channel]) for channel in range(3)], axis=-1)
        tau = -np.log1p(-np.interp(rho, values, rows[:, 3])) / LENGTH * stretch[..., None] * (depths[1] - depths[0])
        passed = np.exp(-np.cumsum(tau, axis=-1) + 0.5 * tau)
        return np.concatenate(
            [((tau * passed)[..., None] * color).sum(-2), 1.0 - np.exp(-tau.sum(-1, keepdims=True))], -1
        )

    coarse, fine = integrated(1500), integrated(3000)
    return fine + (fine - coarse) / 3.0


def picture(
    backend: str, fields: ss.RegularField | ss.EllipsoidField, view: ss.Camera, size: int, **options: Any
) -> Array:
    """Return a flat picture without an opacity stop; slices close together unless told otherwise."""
    given: dict[str, Any] = {"slice_spacing": 0.05, "reference_length": LENGTH, "opacity_stop": 1.0, **options}
    scene = ss.Scene(fields, given.pop("transfer", TRANSFER), **given)
    return np.asarray(renderer(backend).render(scene, view, size=(size, size)).pixels, dtype=np.float64)


def distance(first: Array, second: Array) -> float:
    return float(np.sqrt(((first - second) ** 2).mean()))


def floor(backend: str, truth: Array, *pictures: Array) -> float:
    """Return the arithmetic floor: rounding of a picture to float32, and a backend's distance from the reference."""
    rounding = float(np.sqrt((np.spacing(np.abs(truth).astype(np.float32)).astype(np.float64) ** 2 / 12).mean()))
    return rounding if backend != "gl" or not pictures else max(rounding, distance(pictures[0], pictures[1]))


def slope(knob: Sequence[float], errors: Sequence[float], least: float) -> float:
    """Return the fitted order over the errors that are above ten times the floor `least`; four halvings or more."""
    kept = [(math.log(x), math.log(e)) for x, e in zip(knob, errors, strict=True) if e > 10.0 * least]
    assert len(kept) >= 5, f"too few errors above ten times {least:.2g}: {errors}"
    reach = abs(kept[0][0] - kept[-1][0]) / math.log(2.0)
    assert reach > 3.99, f"{reach:.2f} halvings"
    return float(np.polyfit(*zip(*kept, strict=True), 1)[0])


def orders(backend: str, kind: str, falloff: float, spacings: Sequence[float] = SPACINGS, **options: Any) -> float:
    """Return the fitted order of the distance of slices."""
    view, size = camera(kind), 20
    truth = converged(size, kind, falloff)
    wrong = options.pop("exponent", 0.0)
    errors = []
    for spacing in spacings:
        # A wrong exponent of the opacity, by a part in ℓ that falls with the distance of slices.
        length = LENGTH * (1.0 + wrong * spacing / LENGTH)
        given = {**options, "slice_spacing": spacing, "reference_length": length}
        errors.append(distance(picture(backend, field(falloff), view, size, **given), truth))
    pair = []
    if backend == "gl":
        given = {**options, "slice_spacing": spacings[2]}
        pair = [picture(one, field(falloff), view, size, **given) for one in ("gl", "reference")]
    found = slope(spacings, errors, floor(backend, truth, *pair))
    print(f"{backend} {kind} {options}: order {found:.2f}, errors {', '.join(f'{e:.2g}' for e in errors)}")
    return found


def test_the_converged_picture_is_converged() -> None:
    for falloff in (FALLOFF, SMOOTH):
        coarse = converged(8, "perspective", falloff)
        # The reference's own pictures, extrapolated, come to the same; a slice distance of theirs alone does not.
        view = camera("perspective")
        ours = [picture("reference", field(falloff), view, 8, slice_spacing=ds) for ds in (0.025, 0.0125)]
        assert distance(ours[1] + (ours[1] - ours[0]) / 3.0, coarse) < 3e-8
        assert distance(picture("reference", field(falloff), view, 8, slice_spacing=0.2), coarse) > 3e-7


SECOND: dict[str, dict[str, Any]] = {
    "point": {"sampling": "point"},
    "slab": {"sampling": "slab"},
    "preintegration": {"preintegration": True},
}


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
@pytest.mark.parametrize("name", list(SECOND))
@pytest.mark.parametrize("backend", BACKENDS)
def test_distance_of_slices(backend: str, name: str, kind: str) -> None:
    assert orders(backend, kind, FALLOFF, **SECOND[name]) >= 2.0 - SLACK


@pytest.mark.parametrize("backend", BACKENDS)
def test_second_order_preintegration(backend: str) -> None:
    assert orders(backend, "orthographic", SMOOTH, COARSE, preintegration="second_order") >= 3.0 - SLACK


@pytest.mark.parametrize("name", list(SECOND))
@pytest.mark.parametrize("backend", BACKENDS)
def test_a_wrong_exponent_lowers_the_order(backend: str, name: str) -> None:
    found = orders(backend, "orthographic", FALLOFF, exponent=0.5, **SECOND[name])
    assert 0.6 < found < 2.0 - SLACK


def test_first_order_preintegration_is_not_of_third_order() -> None:
    assert orders("cpu", "orthographic", SMOOTH, COARSE, preintegration=True) < 3.0 - SLACK


def steps(preintegration: bool) -> float:
    """Return the order of slices across a step of the transfer function."""
    transfer = [(0.0, 0.1, 0.2, 0.9, 0.0), (0.4, 0.1, 0.2, 0.9, 0.0), (0.4, 1.0, 0.8, 0.1, 0.5), TRANSFER[1]]
    view = camera("orthographic")
    fine = picture("cpu", field(), view, 64, slice_spacing=1 / 512, preintegration=True, transfer=transfer)
    errors = [
        distance(
            picture("cpu", field(), view, 64, slice_spacing=ds, preintegration=preintegration, transfer=transfer), fine
        )
        for ds in SPACINGS[1:]
    ]
    return slope(SPACINGS[1:], errors, floor("cpu", fine))


def test_steps_of_the_transfer_function_are_of_first_order_and_of_second_in_intervals() -> None:
    point, intervals = steps(False), steps(True)
    assert point >= 1.0 - SLACK
    assert intervals >= 2.0 - SLACK
    # The control: points do not reach what intervals do.
    assert point < 2.0 - SLACK


@pytest.mark.parametrize("backend", ["cpu", pytest.param("gl", marks=pytest.mark.gl)])
def test_xray(backend: str) -> None:
    view, size = camera("orthographic"), 32
    spacings = (1.2, 0.6, 0.3, 0.15, 0.075)
    fine = picture("cpu", field(4.0), view, size, slice_spacing=1 / 512, mode="xray")
    points = [picture(backend, field(4.0), view, size, slice_spacing=ds, mode="xray") for ds in spacings]
    least = floor(
        backend, fine, points[0], picture("reference", field(4.0), view, size, slice_spacing=1.2, mode="xray")
    )
    assert slope(spacings, [distance(one, fine) for one in points], least) >= 2.0 - SLACK
    for spacing in spacings[:3]:
        slab = picture(backend, field(4.0), view, size, slice_spacing=spacing, mode="xray", sampling="slab")
        # Exact at any distance of slices; points are not.
        assert distance(slab, fine) < 1e-6
    assert distance(points[0], fine) > 1e-4


def scaled(enlarged: Callable[[Array, tuple[int, int]], Array], backend: str) -> float:
    """Return the order of pictures drawn smaller, away from the border, where nothing is known beyond it."""
    view, size = camera("orthographic"), 256
    full = picture(backend, field(), view, size, slice_spacing=0.1)
    inner = slice(32, -32)
    scales = (2, 4, 8, 16, 32)
    errors = []
    for scale in scales:
        small = picture(backend, field(), view, size // scale, slice_spacing=0.1)
        errors.append(distance(enlarged(small, (size, size))[inner, inner], full[inner, inner]))
    return slope(scales, errors, floor(backend, full))


def test_image_scale() -> None:
    assert scaled(lambda small, size: enlarge(small.astype(np.float32), size), "cpu") >= 2.0 - SLACK


def test_a_shift_by_a_share_of_a_pixel_lowers_the_order_of_the_image_scale() -> None:
    def shifted(small: Array, size: tuple[int, int]) -> Array:
        # As if the first pixel's centre were at the picture's corner.
        larger = enlarge(np.pad(small, ((1, 0), (1, 0), (0, 0)), mode="edge")[:-1, :-1].astype(np.float32), size)
        return 0.1 * larger + 0.9 * enlarge(small.astype(np.float32), size)

    assert 0.6 < scaled(shifted, "cpu") < 2.0 - SLACK


@pytest.mark.parametrize("backend", ["cpu", pytest.param("gl", marks=[pytest.mark.gl, pytest.mark.slow])])
def test_differences_of_sheets_in_the_size_of_a_pixel(backend: str) -> None:
    """Gradients by differences are of second order in the pixel and the slice distance, which shrink together here."""
    view = camera("orthographic")
    sizes = (8, 16, 32, 64, 128)

    @cache
    def lit(size: int, gradient: str, turn: float = 0.0) -> Array:
        light = ss.Light((0.3 + turn, 0.5, 1.0))
        options: dict[str, Any] = {"lights": [light], "slice_spacing": HEIGHT / size, "gradient": gradient}
        return picture(backend, field(SMOOTH), view, size, **options)

    ours = lit(8, "sheets")
    reference = picture(
        "reference", field(SMOOTH), view, 8, slice_spacing=HEIGHT / 8, lights=[ss.Light((0.3, 0.5, 1.0))]
    )
    least = floor(backend, ours, ours, reference)

    def order(turn: float) -> float:
        errors = [distance(lit(size, "sheets", turn / size), lit(size, "analytic")) for size in sizes]
        found = slope([1 / size for size in sizes], errors, least)
        print(f"{backend}: gradients, order {found:.2f}, errors {', '.join(f'{e:.2g}' for e in errors)}")
        return found

    assert order(0.0) >= 2.0 - SLACK
    # The control: a light that is turned by as much as a pixel is wide.
    assert 0.6 < order(2.0) < 2.0 - SLACK


def lattice(spacing: float, radius: float, falloff: float, shift: float = 0.0) -> ss.RegularField:
    """Return samples of the field on a Cartesian lattice, laid wrongly by a share of their distance."""
    count = round(7.2 / spacing)
    axis = (np.arange(count) - 0.5 * (count - 1) + 0.123) * spacing
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    values = scalar(np.stack([x, y, z], axis=-1), FALLOFF)
    return ss.RegularField(
        values, spacing=(spacing,) * 3, origin=(axis[0] + shift * spacing,) * 3, radius=radius, falloff=falloff
    )


@pytest.mark.parametrize("shift", [0.0, 0.3])
def test_lattice_spacing(shift: float) -> None:
    view, size = camera("orthographic"), 32
    fine = picture("cpu", field(), view, size)
    spacings = (0.8, 0.4, 0.2, 0.1, 0.05)
    errors = [distance(picture("cpu", lattice(h, 3.0, 8.0, shift), view, size), fine) for h in spacings]
    # The ripple of equal samples stays, however close they are; of this kernel it is below the least error.
    assert min(errors) > lattice_ripple(3.0, 8.0).rms
    found = slope(spacings, errors, floor("cpu", fine))
    print(f"lattice spacing, shift {shift:g}: order {found:.2f}, errors {errors}")
    if shift == 0.0:
        assert found >= 2.0 - SLACK
    else:
        # The control: samples that are not where the field has them.
        assert 0.6 < found < 2.0 - SLACK


def test_cut_off() -> None:
    """The error is proportional to exp(−k): its logarithm falls by 1 for each unit of the falloff that is kept."""
    view, size = camera("orthographic"), 32
    whole = picture("cpu", cut_off(field(), 1.7), view, size, slice_spacing=0.1)
    falloffs = (3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 12.0)

    def rate(cut: Callable[[float], ss.EllipsoidField]) -> float:
        errors = [
            distance(picture("cpu", cut(math.sqrt(k / FALLOFF)), view, size, slice_spacing=0.1), whole)
            for k in falloffs
        ]
        # exp(−9) is thirteen halvings.
        assert min(errors) > 10.0 * floor("cpu", whole)
        return -float(np.polyfit(falloffs, np.log(errors), 1)[0])

    assert rate(lambda cut: cut_off(field(), cut)) >= 1.0 - SLACK  # type: ignore[arg-type, return-value]

    def wider(cut: float) -> ss.EllipsoidField:
        # The control: a falloff that follows the support and not its square, so that the Gaussians change their width.
        return ss.EllipsoidField(CENTERS, SCALES * cut, TURNS, VALUES, normalization="none", falloff=FALLOFF * cut**1.9)

    assert rate(wider) < 1.0 - SLACK


@pytest.mark.parametrize("backend", ["cpu", pytest.param("gl", marks=pytest.mark.gl)])
def test_table_size(backend: str) -> None:
    values = np.linspace(0.0, 1.6, 4097)
    waves = [
        0.5 + 0.5 * np.sin(3 * values),
        0.5 + 0.5 * np.cos(4 * values),
        values / 2,
        0.5 - 0.5 * np.cos(2.5 * values),
    ]
    smooth = ss.TransferFunction(np.column_stack([values, *waves]))
    view, size = camera("orthographic"), 32
    fine = picture(backend, field(), view, size, transfer=smooth)
    counts = (4, 8, 16, 32, 64, 128)

    def order(make: Callable[[int], ss.TransferFunction]) -> float:
        errors = [distance(picture(backend, field(), view, size, transfer=make(count)), fine) for count in counts]
        return slope([1.0 / count for count in counts], errors, floor(backend, fine))

    def shifted(count: int) -> ss.TransferFunction:
        # The control: a table whose entries are read a fifth of an entry beside their place.
        points = table(smooth, count + 1).points.copy()
        points[:, 0] += 0.2 * 1.6 / count
        return ss.TransferFunction(points)

    assert order(lambda count: table(smooth, count + 1)) >= 2.0 - SLACK
    assert order(shifted) < 2.0 - SLACK


def test_opacity_stop() -> None:
    """What an opacity stop hides is at most what it lets through: the error is of first order in 1 − A_stop."""
    view, size = camera("orthographic"), 32
    options: dict[str, Any] = {"reference_length": 0.05, "slice_spacing": 0.00625}
    whole = picture("cpu", field(), view, size, **options)
    shares = (0.5, 0.25, 0.125, 0.0625, 0.03125)
    errors = [distance(picture("cpu", field(), view, size, opacity_stop=1 - s, **options), whole) for s in shares]
    print(errors)
    assert slope(shares, errors, floor("cpu", whole)) >= 1.0 - SLACK
    assert all(error <= share for error, share in zip(errors, shares, strict=True))
