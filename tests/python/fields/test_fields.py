"""Fields: types, shapes, options, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import sheetsplat as ss

CUBE = np.arange(24).reshape(2, 3, 4)


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        (CUBE.astype(bool), "uint8"),
        (CUBE.astype(np.int8) - 12, "int16"),
        (CUBE.astype(np.uint8), "uint8"),
        (CUBE.astype(np.int16), "int16"),
        (CUBE.astype(np.uint16), "uint16"),
        (CUBE.astype(np.int32), "uint8"),
        (CUBE.astype(np.int64) - 5, "int16"),
        (CUBE.astype(np.int64) + 60000, "uint16"),
        (CUBE.astype(np.int64) + 100000, "float32"),
        (CUBE.astype(np.int64) + 2**24, "float64"),
        (CUBE.astype(np.uint64) + np.uint64(2**50), "float64"),
        (CUBE.astype(np.float16), "float32"),
        (CUBE.astype(np.float32), "float32"),
        (CUBE.astype(np.float64), "float64"),
        (CUBE.astype(np.longdouble), "float64"),
        (CUBE.astype(">i2"), "int16"),
        (CUBE.astype(">f4"), "float32"),
        (CUBE.astype(">u8"), "uint8"),
        (CUBE.tolist(), "uint8"),
        (CUBE.astype(np.float32).transpose(2, 0, 1), "float32"),
        (CUBE.astype(np.float32)[:, ::-1, ::2], "float32"),
        (np.broadcast_to(np.uint8(3), (2, 3, 4)), "uint8"),
    ],
)
def test_types_are_kept_or_widened_without_loss(given, kept):
    field = ss.RegularField(given)
    assert field.values.dtype == np.dtype(kept)
    assert field.values.dtype.isnative and field.values.strides[2] == field.values.itemsize
    assert np.array_equal(field.values, np.asarray(given))
    assert field.shape == np.shape(given)


def test_unaligned_samples_are_copied():
    raw = np.zeros(8 * 27 + 1, np.uint8)
    view = raw[1:].view(np.float64).reshape(3, 3, 3)
    view[...] = np.arange(27).reshape(3, 3, 3)
    assert np.array_equal(ss.RegularField(view).values, view)


@pytest.mark.parametrize(
    "given",
    [
        CUBE.astype(complex),
        CUBE.astype(object),
        CUBE.astype(str),
        CUBE.astype("datetime64[s]"),
        np.zeros((2, 2, 2), [("a", float)]),
        CUBE.astype(np.int64) + 2**53 + 1,
        CUBE.astype(np.longdouble) / 3,
        [[["a"]]],
        [[[1], [2, 3]]],
        None,
        "text",
    ],
)
def test_other_types_are_refused(given):
    with pytest.raises(ss.InvalidInput, match="RegularField"):
        ss.RegularField(given)


@pytest.mark.parametrize("shape", [(), (4,), (4, 4), (2, 3, 4, 1)])
def test_other_than_three_axes_are_refused(shape):
    with pytest.raises(ss.InvalidInput, match="three axes"):
        ss.RegularField(np.zeros(shape))


@pytest.mark.parametrize("shape", [(0, 3, 3), (3, 0, 3), (3, 3, 0)])
@pytest.mark.parametrize("dtype", [np.float32, np.int64, bool])
def test_empty_arrays_are_refused(shape, dtype):
    with pytest.raises(ss.InvalidInput, match="empty|shape"):
        ss.RegularField(np.zeros(shape, dtype))


def test_a_volume_larger_than_memory_is_refused():
    huge = np.broadcast_to(np.uint8(1), (60000, 60000, 60000))
    with pytest.raises(ss.OutOfMemory, match="MB"):
        ss.RegularField(huge)


@pytest.mark.parametrize("bad", [np.inf, -np.inf])
@pytest.mark.parametrize("nan", ["error", "skip"])
def test_infinite_samples_are_refused(bad, nan):
    values = np.zeros((3, 3, 3))
    values[1, 2, 0] = bad
    with pytest.raises(ss.InvalidInput, match="inf"):
        ss.RegularField(values, nan=nan)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64, ">f4"])
def test_nan_is_an_error_unless_skipped(dtype):
    values = np.zeros((3, 3, 3), dtype)
    values[1, 2, 0] = np.nan
    with pytest.raises(ss.InvalidInput, match=r"(?i)nan"):
        ss.RegularField(values)
    field = ss.RegularField(values, nan="skip")
    assert field.size == 26
    assert np.isnan(field.values[1, 2, 0])


def test_masked_samples_are_nan():
    values = np.ma.masked_array(CUBE.astype(np.int16), CUBE == 5)
    with pytest.raises(ss.InvalidInput, match=r"(?i)nan"):
        ss.RegularField(values)
    field = ss.RegularField(values, nan="skip")
    assert field.size == 23 and field.values.dtype == np.float32
    assert ss.RegularField(np.ma.masked_array(CUBE)).size == 24


@pytest.mark.parametrize(
    "options",
    [
        {"spacing": (0, 1, 1)},
        {"spacing": (1, -1, 1)},
        {"spacing": (1, 1, np.nan)},
        {"spacing": (1, 1, np.inf)},
        {"spacing": (1, 1)},
        {"spacing": 1},
        {"spacing": "abc"},
        {"spacing": ("a", "b", "c")},
        {"spacing": (1, 1, None)},
        {"spacing": (1, 1, 1j)},
        {"origin": (0, 0, np.inf)},
        {"origin": None},
        {"radius": 0},
        {"radius": -1},
        {"radius": "2"},
        {"falloff": 0},
        {"falloff": np.nan},
        {"normalization": "sum"},
        {"normalization": None},
        {"normalization": "threshold", "w0": 0},
        {"lattice": "fcc"},
        {"nan": "ignore"},
    ],
)
def test_options_without_meaning_are_refused(options):
    with pytest.raises(ss.InvalidInput, match="RegularField|wanted"):
        ss.RegularField(CUBE, **options)


def test_geometry():
    field = ss.RegularField(CUBE, spacing=(1, 2, 3), origin=(10, 20, 30))
    assert field.centre_bounds == ((10, 20, 30), (13, 24, 33))
    assert np.allclose(field.bounds, ((8, 16, 24), (15, 28, 39)))
    assert field.default_slice_spacing == 1
    assert field.value_range == (0, 23)
    assert field.size == 24
    assert "4 x 3 x 2" in repr(field)
    bcc = ss.RegularField(CUBE, spacing=(2, 2, 2), lattice="bcc")
    assert bcc.default_slice_spacing == 1
    assert bcc.centre_bounds == ((0, 0, 0), (7, 5, 1))


def test_values_are_a_copy_and_read_only():
    values = CUBE.astype(np.float32)
    field = ss.RegularField(values)
    values[:] = 0
    assert field.values[1, 2, 3] == 23
    with pytest.raises(ValueError, match="read-only"):
        field.values[0, 0, 0] = 1
    kept = field.values
    del field
    assert kept[1, 2, 3] == 23
