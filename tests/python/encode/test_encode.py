"""Volumes as few kernels: the bound is kept, sizes are kept, files are read again, and nothing depends on the world."""

import functools
import importlib.util
import struct
import warnings
import zlib
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import sheetsplat as ss
from sheetsplat.encode.container import MAGIC, chunks_in

_DECODER = Path(__file__).parents[3] / "python" / "docs" / "ssk_decoder.py"
pytest.importorskip("constriction")


def _smooth(shape=(20, 22, 24), seed=0, width=1.5):
    values = gaussian_filter(np.random.default_rng(seed).standard_normal(shape), width)
    return values / np.abs(values).max()


def _places(field):
    """Return where the samples are in the world, by conventions, section 2, in the order of the values."""
    nk, nj, ni = field.shape
    k, j, i = np.mgrid[:nk, :nj, :ni].astype(float)
    if field.lattice == "bcc":
        half = 0.5 * (k % 2)
        index = np.stack((i + half, j + half, 0.5 * k), axis=-1) * field.spacing[0]
        return (index + field.origin).reshape(-1, 3)
    return (np.stack((i, j, k), axis=-1) @ field.steps + field.origin).reshape(-1, 3)


def _random_field(seed):
    """Return a volume of any kind of values and place."""
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(1, 17, 3))
    values = gaussian_filter(rng.standard_normal(shape), rng.choice([0.0, 0.7, 2.0]))
    kind = rng.integers(6)
    if kind == 0:
        values = np.clip(128 + 60 * values, 0, 255).astype(np.uint8)
    elif kind == 1:
        values = (1000 * values).astype(np.int16)
    elif kind == 2:
        values = 101_300 + 300 * values
    elif kind == 3:
        values = (values > 0.5).astype(np.float32)
    elif kind == 4:
        values = values * 1e-20
    options = {"spacing": tuple(rng.uniform(0.2, 3.0, 3)), "origin": tuple(rng.uniform(-9, 9, 3))}
    if rng.random() < 0.25:
        options |= {"spacing": (float(rng.uniform(0.2, 3.0)),) * 3, "lattice": "bcc"}
    elif rng.random() < 0.3:
        options = {"axes": rng.standard_normal((3, 3)) + 2.0 * np.eye(3), "origin": options["origin"]}
    if rng.random() < 0.3 and values.dtype.kind == "f" and values.size > 4:
        values.ravel()[rng.integers(0, values.size, values.size // 5)] = np.nan
        options["nan"] = "skip"
    return ss.RegularField(values, boundary=str(rng.choice(["edge", "zero"])), labels=False, **options), rng


def off(encoded, field):
    """Return |scalar - sample| at the samples that are known."""
    values = np.asarray(field.values, float).ravel()
    known = ~np.isnan(values)
    return np.abs(encoded.at(_places(field)[known]) - values[known])


@pytest.mark.parametrize("seed", range(40))
def test_a_bound_is_kept_at_every_sample(seed):
    field, rng = _random_field(seed)
    low, high = field.value_range
    bound = (high - low or 1.0) * 10.0 ** rng.uniform(-4, -0.5)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ss.PictureWarning)
        encoded = ss.fit.encode(field, max_error=bound)
    found = off(encoded, field)
    assert found.max() <= bound
    assert found.max() <= encoded.bound.max <= bound
    assert encoded.bound.rms == pytest.approx(
        np.sqrt(np.mean(found**2)), rel=1e-6, abs=1e-12 * max(abs(low), abs(high))
    )


@pytest.mark.parametrize("most", [700, 1800, 6000])
def test_a_size_is_kept_and_used(most, tmp_path):
    values = _smooth((32, 32, 32), 3)
    encoded = ss.fit.encode(values, bytes=most)
    encoded.save(tmp_path / "x.ssk")
    size = (tmp_path / "x.ssk").stat().st_size
    assert 0.9 * most <= size <= most


def test_more_bytes_are_closer():
    values = _smooth((32, 32, 32), 3)
    errors = [ss.fit.encode(values, bytes=most).bound.rms for most in (1600, 3200, 6400)]
    assert all(later < 0.8 * earlier for earlier, later in zip(errors, errors[1:], strict=False))


@pytest.mark.parametrize("most", [250, 1000])
def test_a_number_of_kernels_is_kept(most):
    encoded = ss.fit.encode(_smooth((32, 32, 32), 4), kernels=most)
    assert 0.8 * most <= encoded.size <= most


def test_a_file_is_the_same_field(tmp_path):
    field = ss.RegularField(_smooth(), spacing=(1, 2, 0.5), origin=(3, -4, 5)).with_quantity("speed", "m/s", "km")
    encoded = ss.fit.encode(field, bytes=1700)
    encoded.save(tmp_path / "x.ssk")
    again = ss.open(tmp_path / "x.ssk")
    assert again == encoded
    assert (again.quantity.name, again.quantity.unit, again.quantity.length_unit) == ("speed", "m/s", "km")
    assert again.bound.max >= encoded.bound.max and again.bound.max == pytest.approx(encoded.bound.max)
    assert again.domain == field.domain
    assert again.default_slice_spacing == field.default_slice_spacing


def test_the_same_data_give_the_same_bytes():
    first, second = (ss.fit.encode(_smooth(), bytes=1700).code.data for _ in range(2))
    assert first == second


def test_another_world_and_unit_change_nothing_else():
    values = np.rint(1000 * _smooth())
    plain = ss.fit.encode(ss.RegularField(values), bytes=2600)
    moved = ss.RegularField(8.0 * values + 4096.0, spacing=(2, 2, 2), origin=(16, 32, -8))
    other = ss.fit.encode(moved, bytes=2600 + 96)
    assert np.array_equal(other.centers, 2.0 * plain.centers + (16, 32, -8))
    assert np.allclose(other.values - other.base, 8.0 * (plain.values - plain.base), rtol=1e-9)


def test_turned_data_are_as_close():
    values = _smooth((24, 24, 24), 7)
    errors = [ss.fit.encode(np.transpose(values, axes), bytes=1700).bound.rms for axes in ((0, 1, 2), (2, 0, 1))]
    assert errors[1] == pytest.approx(errors[0], rel=0.1)


@pytest.mark.parametrize("values", [np.full((5, 6, 7), 3.5), np.zeros((1, 1, 1)), np.full((1, 4, 1), 7, np.uint8)])
def test_a_constant_is_exact_and_shown(values):
    field = ss.RegularField(values)
    encoded = ss.fit.encode(field, bytes=400)
    assert off(encoded, field).max() == 0.0
    assert encoded.scalars_and_shown(_places(field))[1].all()


def test_the_reader_of_the_docs_reads_the_same_kernels():
    spec = importlib.util.spec_from_file_location("ssk_decoder", _DECODER)
    decoder = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(decoder)
    for field in (
        ss.RegularField(_smooth((17, 20, 23), 5), origin=(1, 2, 3)),
        ss.RegularField(_smooth((16, 9, 9), 6), lattice="bcc"),
        ss.RegularField(np.random.default_rng(0).standard_normal((6, 7, 8)), spacing=(2, 2, 2)),
    ):
        encoded = ss.fit.encode(field, max_error=0.05)
        places, radii, heights, base, falloff = decoder.kernels_of(encoded.code.data)
        assert np.allclose(places, encoded.centers, atol=1e-12)
        assert np.allclose(radii * field.spacing[0], encoded.scales)
        assert np.allclose(heights + base, encoded.values, rtol=1e-12, atol=1e-12)
        assert falloff == encoded.falloff
    assert len(_DECODER.read_text().splitlines()) < 200


def test_the_first_bytes_are_a_coarser_field(tmp_path):
    field = ss.RegularField(_smooth((32, 32, 32), 3, 1.0))
    data = ss.fit.encode(field, bytes=4000).code.data
    path, bounds = tmp_path / "x.ssk", []
    for cut in range(len(data) + 1):
        path.write_bytes(data[:cut])
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            try:
                coarser = ss.open(path)
            except ss.InvalidInput:
                assert not bounds
                continue
        assert cut == len(data) or "ends early" in str(told[0].message)
        if not bounds or coarser.bound.max != bounds[-1]:
            bounds.append(coarser.bound.max)
            assert off(coarser, field).max() <= coarser.bound.max
    assert len(bounds) >= 2
    assert bounds == sorted(bounds, reverse=True)


def test_flipped_bytes_are_told(tmp_path):
    data = _bytes_of_small()
    rng, path = np.random.default_rng(1), tmp_path / "x.ssk"
    for at in range(len(data)):
        broken = bytearray(data)
        broken[at] ^= 1 << rng.integers(8)
        path.write_bytes(broken)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ss.PictureWarning)
            try:
                ss.open(path)
            except ss.Error:
                pass


@functools.cache
def _bytes_of_small():
    return ss.fit.encode(_smooth(), bytes=1700).code.data


def _with_header(data, at, kind, number):
    """Return the bytes of a file with another number in its chunk G, whose checksum is right."""
    (header, *rest), _ = chunks_in(data, "x")
    changed = bytearray(header.data)
    struct.pack_into(kind, changed, at, number)
    made = MAGIC
    for letter, inside in [(header.kind, bytes(changed)), *((one.kind, one.data) for one in rest)]:
        made += struct.pack("<cIH", letter, len(inside), zlib.crc32(inside, zlib.crc32(letter)) & 0xFFFF) + inside
    return made


@pytest.mark.parametrize("at", range(54))
def test_numbers_that_no_encoder_writes_are_told(at, tmp_path):
    data, path = _bytes_of_small(), tmp_path / "x.ssk"
    for number in (0, 1, 255, 127):
        path.write_bytes(_with_header(data, at, "<B", number))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ss.PictureWarning)
            try:
                assert np.isfinite(ss.open(path).centers).all()
            except ss.Error:
                pass


def test_a_header_does_not_take_memory(tmp_path):
    path = tmp_path / "x.ssk"
    path.write_bytes(_with_header(_bytes_of_small(), 6, "<I", 2**31))
    with pytest.raises(ss.InvalidInput, match="lattices"):
        ss.open(path)


@pytest.mark.parametrize(
    "options", [{}, {"bytes": 1700, "kernels": 5}, {"bytes": 0}, {"bytes": -1}, {"bytes": 20}, {"max_error": 0},
                {"max_error": float("nan")}, {"max_error": 1e-12}, {"kernels": 0}, {"kernels": 2}]
)  # fmt: skip
def test_what_cannot_be_kept_is_told(options):
    with pytest.raises(ss.InvalidInput):
        ss.fit.encode(_smooth(), **options)


@pytest.mark.parametrize(
    "data",
    [
        ss.RegularField(np.ones((4, 4, 4), np.uint8), labels=True),
        ss.RegularField(np.zeros((4, 4, 4, 3), np.uint8)),
        np.full((4, 4, 4), np.nan),
        np.zeros((0, 4, 4)),
        "no such file.nrrd",
    ],
)
def test_what_is_no_volume_of_values_is_told(data):
    with pytest.raises(ss.Error):
        ss.fit.encode(data, bytes=1700)


def test_kernels_that_are_not_encoded_are_not_saved(tmp_path):
    with pytest.raises(ss.InvalidInput, match="encode it first"):
        ss.EllipsoidField([(0, 0, 0)], [1.0], values=[1.0]).save(tmp_path / "x.ssk")


def test_other_endings_are_told(tmp_path):
    with pytest.raises(ss.InvalidInput, match=".ssk"):
        ss.fit.encode(_smooth(), bytes=1700).save(tmp_path / "x.npz")


def test_a_picture_states_the_error_of_the_encoding():
    field = ss.RegularField(_smooth((24, 24, 24), 2))
    encoded = ss.fit.encode(field, bytes=1700)
    scene = ss.Scene(field, ss.TransferFunction.from_colormap("viridis", clim=(-1, 1)))
    camera, renderer = ss.Camera.fit(field), ss.Renderer("cpu")
    whole = renderer.render(scene, camera, size=(64, 64))
    few = renderer.render(scene.replace(field=encoded), camera, size=(64, 64))
    stated = few.error.budget["the encoded field"]
    true = float(np.sqrt(np.mean((whole.rgba - few.rgba) ** 2)))
    assert "the encoded field" not in whole.error.budget
    assert 0.5 * true < stated < 10.0 * true
    assert few.error.rmse >= stated


def test_progress_is_told_and_stops():
    shares = []
    ss.fit.encode(_smooth(), bytes=1700, progress=lambda share: shares.append(share) or True)
    assert shares == sorted(shares) and shares[-1] == 1.0 and len(shares) > 3
    with pytest.raises(ss.Cancelled):
        ss.fit.encode(_smooth(), bytes=1700, progress=lambda share: False)
