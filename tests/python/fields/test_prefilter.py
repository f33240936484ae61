"""Coefficients that interpolate, and the ripple of sums on a lattice."""

from __future__ import annotations

import itertools
import math
import resource
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import sheetsplat as ss
from sheetsplat import _sheetsplat
from sheetsplat.cli import main
from sheetsplat.look import automatic
from sheetsplat.ripple import lattice_constant, lattice_ripple

GOOD = ((2.0, 5.0), (2.5, 7.0), (3.0, 8.0))
LATTICES = ("cartesian", "bcc")
SHAPE = (9, 11, 10)


def places(shape: tuple[int, ...], lattice: str) -> np.ndarray:
    """Return the samples' places, (N, 3) x, y, z, in index space (BCC: in units of a)."""
    k, j, i = np.meshgrid(*(np.arange(n, dtype=float) for n in shape), indexing="ij")
    if lattice == "bcc":
        half = (k % 2) / 2
        return np.stack([i + half, j + half, k / 2], -1).reshape(-1, 3)
    return np.stack([i, j, k], -1).reshape(-1, 3)


def literal(values: object, **options: object) -> ss.RegularField:
    """Return a volume beyond whose samples there are none: its sums are those of its own kernels."""
    return ss.RegularField(values, **{"boundary": "zero", **options})  # type: ignore[arg-type]


def sums_at(field: ss.RegularField, points: np.ndarray) -> np.ndarray:
    """Return the sum of kernels at points of index space, by the definition, without the package's own taps."""
    radius = field.radius / math.sqrt(2.0) if field.lattice == "bcc" else field.radius
    centres, values = places(field.shape, field.lattice), field.coefficients.astype(float).ravel()
    made = np.empty(len(points))
    edge = math.exp(-field.falloff)
    for start in range(0, len(points), 256):
        part = points[start : start + 256]
        squares = ((part[:, None] - centres) ** 2).sum(-1) / radius**2
        made[start : start + 256] = (np.maximum(0.0, np.exp(-field.falloff * squares) - edge) / (1 - edge)) @ values
    return made


def spectrum_range(radius: float, falloff: float, lattice: str) -> tuple[float, float]:
    """Return the smallest and the largest value of the spectrum of an endless lattice's kernels, by the definition."""
    reach = radius * math.sqrt(2.0) if lattice == "bcc" else radius
    steps = np.arange(math.ceil(reach))
    k, j, i = np.meshgrid(steps, steps, steps, indexing="ij")
    taps = np.maximum(0, np.exp(-falloff * (k**2 + j**2 + i**2) / reach**2) - math.exp(-falloff)) / -math.expm1(
        -falloff
    )
    if lattice == "bcc":
        taps = taps * ((k % 2 == j % 2) & (j % 2 == i % 2))
    table = np.cos(np.linspace(0.0, math.pi, 65)[:, None] * steps) * np.where(steps > 0, 2.0, 1.0)
    spectrum = np.einsum("lmn,kl,jm,in->kji", taps, table, table, table, optimize=True)
    return float(spectrum.min()), float(spectrum.max())


def refused(function: Callable[[], object], *words: str) -> str:
    with pytest.raises(ss.InvalidInput) as caught:
        function()
    text = str(caught.value)
    assert all(word in text for word in ("found", "wanted", *words)), text
    return text


@pytest.mark.parametrize("lattice", LATTICES)
@pytest.mark.parametrize(("radius", "falloff"), GOOD)
@pytest.mark.parametrize("shape", [SHAPE, (2, 3, 64), (64, 1, 2), (3, 2, 1)])
@pytest.mark.parametrize(
    ("offset", "kind"), [(0.0, "float32"), (101300.0, "float32"), (280.0, "float64"), (0.0, "uint8")]
)
def test_volumes_that_end_pass_through_all_samples(
    lattice: str, radius: float, falloff: float, shape: tuple[int, ...], offset: float, kind: str,
    rng: np.random.Generator,
) -> None:  # fmt: skip
    values = (offset + rng.random(shape) * (200 if kind == "uint8" else 20)).astype(kind)
    field = ss.RegularField(values, lattice=lattice, radius=radius, falloff=falloff, prefilter=True)  # type: ignore[arg-type]
    away = np.abs(field.at(places(shape, lattice)) - values.ravel().astype(float)).max()
    assert away <= 1e-6 * float(np.ptp(values.astype(float)))
    # Where the volume ends its values go on.
    assert field.boundary == "edge" and field.domain is not None


@pytest.mark.parametrize("lattice", LATTICES)
@pytest.mark.parametrize(("radius", "falloff"), GOOD)
@pytest.mark.parametrize("kind", ["float32", "float64", "uint8", "int16"])
def test_the_sum_passes_through_the_samples(
    lattice: str, radius: float, falloff: float, kind: str, rng: np.random.Generator
) -> None:
    values = (rng.normal(size=SHAPE) * 50 + 100).clip(0, 255).astype(kind)
    options = {"lattice": lattice, "radius": radius, "falloff": falloff}
    field = literal(values, spacing=(0.3,) * 3, prefilter=True, **options)  # type: ignore[arg-type]
    away = np.abs(sums_at(field, places(SHAPE, lattice)) - values.ravel()).max() / np.abs(values).max()
    assert away < (1e-11 if kind == "float64" else 1e-6)
    assert field.prefilter_residual is not None and away == pytest.approx(field.prefilter_residual, abs=1e-12)
    # The control: without the prefilter the sum over C does not.
    plain = literal(values, **options)  # type: ignore[arg-type]
    sums = sums_at(plain, places(SHAPE, lattice)) / lattice_constant(radius, falloff, lattice)  # type: ignore[arg-type]
    assert np.abs(sums - values.ravel()).max() / np.abs(values).max() > 1e-2


def test_unequal_spacing_is_a_sphere_in_index_space(rng: np.random.Generator) -> None:
    values = rng.normal(size=(6, 7, 8))
    equal = literal(values, prefilter=True)
    unequal = literal(values, spacing=(0.1, 3.0, 1.0), origin=(5, -2, 1), prefilter=True)
    assert np.array_equal(equal.coefficients, unequal.coefficients)


@pytest.mark.parametrize("lattice", LATTICES)
def test_coefficients_are_those_of_the_full_matrix(lattice: str, rng: np.random.Generator) -> None:
    shape = (5, 4, 6)
    at = places(shape, lattice)
    squares = ((at[:, None] - at) ** 2).sum(-1) / (6.25 / (2.0 if lattice == "bcc" else 1.0))
    matrix = np.maximum(0.0, np.exp(-7 * squares) - math.exp(-7)) / -math.expm1(-7)
    values = rng.normal(size=shape)
    field = literal(values, lattice=lattice, radius=2.5, falloff=7, prefilter=True)  # type: ignore[arg-type]
    expected = np.linalg.solve(matrix, values.ravel())
    assert np.abs(field.coefficients.ravel() - expected).max() < 1e-10 * np.abs(expected).max()
    # The bound of the condition number holds for this block of the endless matrix, and is not far too large.
    true = np.linalg.cond(matrix)
    assert field.prefilter_condition is not None and 1.0 <= field.prefilter_condition / true < 10.0


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 1, 7), (1, 6, 1), (2, 1, 1), (3, 1, 2), (2, 2, 2)])
@pytest.mark.parametrize("lattice", LATTICES)
def test_thin_volumes(shape: tuple[int, int, int], lattice: str, rng: np.random.Generator) -> None:
    values = rng.normal(size=shape)
    field = literal(values, lattice=lattice, prefilter=True)  # type: ignore[arg-type]
    assert np.allclose(sums_at(field, places(shape, lattice)), values.ravel(), rtol=0, atol=1e-11)


@pytest.mark.parametrize("lattice", LATTICES)
def test_constant_fields_have_constant_coefficients_inside(lattice: str) -> None:
    field = literal(np.full((30, 30, 30), 7.0), lattice=lattice, prefilter=True)  # type: ignore[arg-type]
    inner = field.coefficients[13:17, 13:17, 13:17]
    total = sums_at(literal(np.ones((9, 9, 9)), lattice=lattice), places((9, 9, 9), lattice))  # type: ignore[arg-type]
    middle = total.reshape(9, 9, 9)[4, 4, 4]
    assert np.allclose(inner, 7.0 / middle, rtol=1e-4)
    # At the border there are no neighbours to share with.
    assert field.coefficients[0, 0, 0] > 1.5 * inner.max()
    assert not literal(np.zeros((4, 4, 4)), prefilter=True).coefficients.any()


def test_coefficients_are_linear_in_the_samples(rng: np.random.Generator) -> None:
    first, second = rng.normal(size=(2, *SHAPE))

    def of(values: np.ndarray) -> np.ndarray:
        return np.asarray(literal(values, prefilter=True).coefficients)

    together = of(2.0 * first - 3.0 * second)
    assert np.allclose(together, 2.0 * of(first) - 3.0 * of(second), rtol=0, atol=1e-9)
    # Powers of two are exact, whatever the size of the numbers.
    for exponent in (-900, -300, 40, 600):
        assert np.array_equal(of(np.ldexp(first, exponent)), np.ldexp(of(first), exponent))
    turned = of(first[::-1, :, ::-1])
    assert np.allclose(turned, of(first)[::-1, :, ::-1], rtol=0, atol=1e-9)


def test_the_field_keeps_the_samples_and_shows_their_range(rng: np.random.Generator) -> None:
    values = rng.random((12, 12, 12)).astype(np.float32)
    given = values.copy()
    field = literal(given, prefilter=True)
    given[:] = -1.0
    assert np.array_equal(field.values, values) and not field.values.flags.writeable
    assert field.value_range == (values.min(), values.max())
    assert field.normalization == "none" and field.prefilter
    assert field.coefficients.min() < values.min() and field.coefficients.max() > values.max()
    assert field.coefficients.dtype == np.float32 and not field.coefficients.flags.writeable
    assert field.memory >= 2 * values.nbytes and "prefiltered" in repr(field)
    plain = literal(values)
    assert automatic.choose([field]) == automatic.choose([plain])
    assert not plain.prefilter and plain.prefilter_residual is None and plain.prefilter_condition is None
    assert plain.coefficients is not None and np.array_equal(plain.coefficients, values)
    assert literal(values.astype(np.uint8), prefilter=True).coefficients.dtype == np.float32


@pytest.mark.parametrize("scale", [1e-300, 1e-40, 1e30, 1e290])
def test_very_small_and_very_large_samples(scale: float, rng: np.random.Generator) -> None:
    values = rng.normal(size=(5, 5, 5)) * scale
    field = literal(values, prefilter=True)
    assert np.abs(sums_at(field, places((5, 5, 5), "cartesian")) - values.ravel()).max() < 1e-11 * scale
    if 1e-38 < scale < 1e38:
        # What float32 cannot hold with all digits is kept wider.
        assert literal(values.astype(np.float32), prefilter=True).coefficients.dtype == np.float64


def test_contradictions_have_clear_errors() -> None:
    one = np.ones((4, 4, 4))
    refused(lambda: literal(one, prefilter=True, normalization="threshold"), "prefilter=True", '"threshold"')
    hole = one.copy()
    hole[1, 2, 3] = np.nan
    refused(lambda: literal(hole, prefilter=True, nan="skip"), "prefilter=True", 'nan="skip"', "[1, 2, 3]")
    refused(lambda: literal(hole, prefilter=True), "NaN", "[1, 2, 3]")
    hole[1, 2, 3] = np.inf
    refused(lambda: literal(hole, prefilter=True), "inf")
    refused(lambda: literal(one, prefilter="yes"), "prefilter")  # type: ignore[arg-type]
    refused(lambda: literal(one, prefilter=True, spacing=(0, 1, 1)), "spacing")
    refused(lambda: literal(one[:0], prefilter=True), "empty")
    signs = np.where(np.indices((4, 4, 4)).sum(axis=0) % 2, 9e299, -9e299)
    refused(lambda: literal(signs, prefilter=True), "1e+300")
    refused(lambda: ss.render(literal(one), prefilter=True, size=(8, 8)), "prefilter")
    # Allowed: "skip" where nothing is to be skipped, and the two normalisations that become "none".
    for options in ({"nan": "skip"}, {"normalization": "none"}, {"normalization": "lattice"}):
        assert literal(one, prefilter=True, **options).normalization == "none"  # type: ignore[arg-type]


@pytest.mark.parametrize("lattice", LATTICES)
def test_kernels_that_lose_the_samples_are_refused(lattice: str) -> None:
    values = np.ones((4, 4, 4))
    text = refused(
        lambda: literal(values, radius=3, falloff=1, lattice=lattice, prefilter=True),  # type: ignore[arg-type]
        "radius 3 with falloff 1",
        "spectrum",
    )
    assert "condition number" in text
    wide = {"cartesian": (3.5, 8.0), "bcc": (4.0, 8.0)}[lattice]
    low, high = spectrum_range(*wide, lattice)
    assert 0.0 < 2e3 * low < high
    refused(
        lambda: literal(values, radius=wide[0], falloff=wide[1], lattice=lattice, prefilter=True),  # type: ignore[arg-type]
        f"{high / low:.3g}",
    )
    refused(lambda: literal(values, radius=1e9, falloff=5, prefilter=True), "1e+09")
    for radius, falloff in GOOD:
        low, high = spectrum_range(radius, falloff, lattice)
        assert _sheetsplat.prefilter_condition(radius, falloff, lattice) == pytest.approx(high / low, rel=1e-12)


def test_what_does_not_fit_is_refused_before_it_is_tried() -> None:
    values = np.ones((256, 256, 256), np.float32)
    before = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    # Enough for the field's copy, too little for coefficients and remainders.
    resource.setrlimit(resource.RLIMIT_AS, (used + 2 * values.nbytes, before[1]))
    try:
        with pytest.raises(ss.OutOfMemory, match="prefilter of 256 x 256 x 256 samples"):
            literal(values, prefilter=True)
        literal(values)
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.mark.parametrize("lattice", LATTICES)
def test_large_volumes_pass_through_the_samples(lattice: str, rng: np.random.Generator) -> None:
    # Borders that have filters of their own, and samples far from them; noise is the hardest.
    shape = (70, 68, 150)
    values = rng.normal(size=shape).astype(np.float32)
    field = literal(values, radius=2.5, falloff=7, lattice=lattice, prefilter=True)  # type: ignore[arg-type]
    chosen = rng.integers(0, values.size, 1000)
    chosen[:4] = (0, 149, values.size - 1, values.size - 150)
    k, j, i = np.unravel_index(chosen, shape)
    half = k % 2 / 2 if lattice == "bcc" else np.zeros(len(k))
    at = np.stack([k / 2 if lattice == "bcc" else k, j + half, i + half], -1)
    size = 2.5 / math.sqrt(2.0) if lattice == "bcc" else 2.5
    sums = np.zeros(len(k))
    for step in itertools.product(range(-4, 5), range(-3, 4), range(-3, 4)):
        other = np.stack([k, j, i], -1) + step
        inside = ((other >= 0) & (other < shape)).all(-1)
        ko, jo, io = other.clip(0, np.array(shape) - 1).T
        shift = ko % 2 / 2 if lattice == "bcc" else np.zeros(len(k))
        there = np.stack([ko / 2 if lattice == "bcc" else ko, jo + shift, io + shift], -1)
        squares = ((there - at) ** 2).sum(-1) / size**2
        kernel = np.maximum(0.0, (np.exp(-7 * squares) - math.exp(-7)) / -math.expm1(-7))
        sums += inside * kernel * field.coefficients[ko, jo, io]
    largest = np.abs(values).max()
    assert np.abs(sums - values[k, j, i]).max() < 1e-6 * largest
    assert field.prefilter_residual is not None and field.prefilter_residual < 1e-6
    assert np.abs(field.coefficients[k, j, i] - values[k, j, i]).max() > 0.1 * largest


def test_linear_data_stay_linear_in_the_middle() -> None:
    # Far from the border the coefficients of a ramp are a ramp, over the sum of the kernels.
    k, j, i = np.indices((48, 48, 48), dtype=float)
    values = 2.0 + 0.5 * i - 0.25 * j + 0.125 * k
    field = literal(values, radius=2.5, falloff=7, prefilter=True)
    middle = np.s_[22:26, 22:26, 22:26]
    unit = values[middle] / field.coefficients[middle]
    assert unit.max() / unit.min() - 1 < 1e-6
    # The control: not so at the border.
    assert np.ptp(values[:2] / field.coefficients[:2]) > 0.1


def test_the_one_line_the_file_and_the_command_line(tmp_path: Path, rng: np.random.Generator) -> None:
    values = rng.random((8, 8, 8)).astype(np.float32)
    path = tmp_path / "v.npy"
    np.save(path, values)
    opened = ss.open(path, prefilter=True, radius=2.5, falloff=7)
    assert isinstance(opened, ss.RegularField) and opened.prefilter
    look = {"size": (24, 24), "backend": "reference", "clim": (0.0, 1.0), "radius": 2.5, "falloff": 7.0}
    filtered = ss.render(values, prefilter=True, **look).rgba  # type: ignore[arg-type]
    assert np.array_equal(filtered, ss.render(path, prefilter=True, **look).rgba)  # type: ignore[arg-type]
    assert np.abs(filtered - ss.render(values, **look).rgba).max() > 0.01  # type: ignore[arg-type]
    options = ["--size", "24", "--backend", "reference", "--clim", "0,1", "--radius", "2.5", "--falloff", "7", "-q"]
    out = tmp_path / "v.png"
    result = CliRunner().invoke(main, ["render", str(path), "-o", str(out), "--prefilter", "--no-metadata", *options])
    assert result.exit_code == 0, result.output
    ss.render(values, prefilter=True, **look).save(tmp_path / "w.png", metadata=False)  # type: ignore[arg-type]
    assert out.read_bytes() == (tmp_path / "w.png").read_bytes()
    wrong = CliRunner().invoke(
        main, ["render", str(path), "-o", str(out), "--prefilter", "--normalization", "threshold", *options]
    )
    assert wrong.exit_code == 2 and "--prefilter" in wrong.output and "--normalization threshold" in wrong.output


@pytest.mark.parametrize("backend", ["cpu", "gl"])
def test_backends_show_coefficients_as_the_reference_does(backend: str, request: pytest.FixtureRequest) -> None:
    if backend == "gl":
        request.getfixturevalue("_gl_reason") and pytest.skip(request.getfixturevalue("_gl_reason"))
    volume = ss.datasets.marschner_lobb(20)
    scene = ss.Scene(
        volume.field(prefilter=True, radius=2.5, falloff=7),
        [(0.2, 0, 0.2, 1, 0), (0.6, 1, 0.6, 0, 0.1), (1, 1, 1, 1, 0.3)],
        lights=[ss.Light((1, 2, 3))],
    )
    camera = ss.Camera.fit(scene.fields[0], (0.3, -0.4, -1))
    made, exact = (ss.Renderer(b).render(scene, camera, size=(40, 40)).rgba for b in (backend, "reference"))
    assert math.sqrt(float(np.mean((made - exact) ** 2))) < 2e-5
    plain = ss.Renderer("reference").render(
        ss.Scene(volume.field(radius=2.5, falloff=7), scene.transfer_function, lights=scene.lights),
        camera,
        size=(40, 40),
    )
    assert math.sqrt(float(np.mean((plain.rgba - exact) ** 2))) > 1e-3


# How the error falls with the spacing


def bump(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    return np.asarray(np.exp(-(x * x + y * y + z * z) / 0.045) * (1 + 0.5 * np.sin(6 * x + 4 * y)))


def error_at(count: int, radius: float, falloff: float, *, prefilter: bool, constant: float | None = None) -> float:
    """Return the RMS difference from the formula, at places that are the same for every spacing."""
    spacing = 2.0 / count
    x = -1 + spacing * (np.arange(count) + 0.5)
    field = literal(bump(x, x[:, None], x[:, None, None]), radius=radius, falloff=falloff, prefilter=prefilter)
    points = np.random.default_rng(1).normal(size=(1500, 3)) * 0.18
    at = (points - x[0]) / spacing
    first = np.floor(at).astype(int)
    total = np.zeros(len(points))
    reach = math.ceil(radius)
    for step in itertools.product(range(-reach, reach + 2), repeat=3):
        n = first + step
        inside = ((n >= 0) & (n < count)).all(axis=1)
        i, j, k = n.clip(0, count - 1).T
        squares = ((at - n) ** 2).sum(-1) / radius**2
        kernel = np.maximum(0.0, (np.exp(-falloff * squares) - math.exp(-falloff)) / -math.expm1(-falloff))
        total += inside * kernel * field.coefficients[k, j, i]
    if not prefilter:
        total /= lattice_constant(radius, falloff) if constant is None else constant
    return math.sqrt(float(np.mean((total - bump(*points.T)) ** 2)))


def slope_of(errors: list[float], counts: list[int]) -> float:
    return -float(np.polyfit(np.log(counts), np.log(errors), 1)[0])


@pytest.mark.slow
def test_order_in_lattice_spacing() -> None:
    halvings = [8, 16, 32, 64, 128]
    plain = [error_at(n, 2.5, 7.0, prefilter=False) for n in halvings]
    # A sum of Gaussians smooths: second order.
    assert slope_of(plain[1:], halvings[1:]) >= 1.7 and slope_of(plain, halvings) >= 1.7 - 0.1
    # The control: a constant that is wrong by 2 % ends the fall.
    wrong = [error_at(n, 2.5, 7.0, prefilter=False, constant=1.02 * lattice_constant(2.5, 7.0)) for n in halvings[1:]]
    assert slope_of(wrong, halvings[1:]) < 1.7
    # Interpolation falls by fourth order or quicker until the ripple is left, which does not depend on the spacing.
    filtered = [error_at(n, 2.5, 7.0, prefilter=True) for n in halvings]
    assert slope_of(filtered[:3], halvings[:3]) >= 3.7
    assert slope_of(filtered, halvings) >= 1.7
    assert all(with_it < without for with_it, without in zip(filtered, plain, strict=True))
    assert filtered[-1] < 1.5 * lattice_ripple(2.5, 7.0, prefilter=True).rms


# Ripple


@pytest.mark.parametrize(
    ("radius", "falloff", "peak"), [(2, 5, 0.008), (2, 8, 0.045), (2.5, 7, 0.0006), (3, 8, 0.0005)]
)
def test_ripple_is_what_the_conventions_say(radius: float, falloff: float, peak: float) -> None:
    found = lattice_ripple(radius, falloff)
    digit = 10.0 ** math.floor(math.log10(peak))
    assert abs(found.peak - peak) <= 0.5 * digit * (0.1 if peak == 0.045 else 1.0) + 1e-9
    if (radius, falloff) == (2, 5):
        assert round(100 * found.rms, 2) == 0.23


@pytest.mark.parametrize("lattice", LATTICES)
def test_ripple_is_that_of_rendered_sums(lattice: str, rng: np.random.Generator) -> None:
    shape = (14, 14, 14)
    ones = np.ones(shape)
    for prefilter in (False, True):
        endless = lattice_ripple(2.0, 5.0, lattice=lattice, prefilter=prefilter)  # type: ignore[arg-type]
        at = places(shape, lattice)
        middle = at[np.ravel_multi_index((7, 7, 7), shape)]
        points = middle + rng.uniform(-0.5, 0.5, (2500, 3))
        field = literal(ones, lattice=lattice)  # type: ignore[arg-type]
        sums = sums_at(field, points)
        sums /= sums_at(field, middle[None])[0] if prefilter else lattice_constant(2.0, 5.0, lattice)  # type: ignore[arg-type]
        assert np.abs(sums - 1).max() == pytest.approx(endless.peak, rel=0.1)
        assert math.sqrt(float(np.mean((sums - 1) ** 2))) == pytest.approx(endless.rms, rel=0.06)
    # The mean of sums over C is 1 by the meaning of C.
    plain = sums_at(field, points) / lattice_constant(2.0, 5.0, lattice)  # type: ignore[arg-type]
    assert abs(plain.mean() - 1) < 5e-4


def test_division_by_weights_leaves_no_ripple_where_the_weights_reach(reference_renderer: ss.Renderer) -> None:
    assert lattice_ripple(2, 5, normalization="threshold").peak < 1e-14
    assert lattice_ripple(2, 5, normalization="threshold", w0=1e-6).slope < 1e-12
    # Beyond all weights it divides by a constant.
    high = lattice_ripple(2, 5, normalization="threshold", w0=1e3)
    assert high.peak > 0.9
    # And pictures of regular fields are that: an x-ray slab of ones.
    pictures = {}
    for name, options in (("lattice", {}), ("threshold", {"w0": 1e-3})):
        field = literal(np.ones((9, 16, 16)), normalization=name, **options)  # type: ignore[arg-type]
        scene = ss.Scene(
            field, [(0.9, 0, 0, 0, 0.0), (1.1, 1, 1, 1, 1.0)], slice_spacing=0.25, opacity_stop=1.0, mode="mip"
        )
        camera = ss.Camera.orthographic((7.5, 7.5, 30), (7.5, 7.5, 4), height=4)
        pictures[name] = reference_renderer.render(scene, camera, size=(32, 32)).scalar
    assert np.abs(pictures["threshold"] - 1).max() < 1e-6
    assert 0.004 < np.abs(pictures["lattice"] - 1).max() < 0.01


def test_wider_kernels_ripple_less_and_bad_ones_are_refused() -> None:
    peaks = [lattice_ripple(*pair).peak for pair in ((2, 8), (2, 5), (2.5, 7), (3, 8))]
    assert peaks == sorted(peaks, reverse=True)
    slopes = [lattice_ripple(*pair, prefilter=True).slope for pair in GOOD]
    assert slopes == sorted(slopes, reverse=True)
    for bad in (
        {"radius": 0.0},
        {"radius": 0.4},
        {"radius": math.nan},
        {"falloff": -1.0},
        {"w0": 0.0},
        {"lattice": "hexagonal"},
        {"normalization": "mean"},
        {"radius": 1e6},
        {"prefilter": True, "radius": 3.0, "falloff": 1.0},
        {"prefilter": True, "normalization": "threshold"},
    ):
        refused(lambda bad=bad: lattice_ripple(**bad))  # type: ignore[misc]
