"""Scattered kernels in few bytes, and volumes as free ellipsoids: bounds are kept and files are read again."""

import os
import warnings
from pathlib import Path

import numpy as np
import pytest

import sheetsplat as ss

pytest.importorskip("constriction")
_DATA = Path(os.environ.get("SHEETSPLAT_DATA") or "../shared/data")


def _ellipsoids(count=400, seed=0, **options):
    rng = np.random.default_rng(seed)
    turns = rng.standard_normal((count, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    values = rng.uniform(0, 1, count) + options.get("base", 0.0)
    rows = rng.uniform(-1, 1, (count, 3)), rng.uniform(0.2, 0.6, (count, 3)), turns, values
    return ss.EllipsoidField(*rows, **{"weights": rng.uniform(0.5, 2, count), **options})


@pytest.mark.parametrize(
    "options",
    [{}, {"normalization": "none"}, {"weights": None, "base": 101_325.0}, {"periodic": ((-1, -1, -1), (1, 1, 1))},
     {"w0": 0.2}],
)  # fmt: skip
def test_the_same_kernels_in_few_bytes(options, tmp_path):
    field = _ellipsoids(**options)
    encoded = ss.fit.encode(field)
    off = np.abs(encoded.at(field.centers) - field.at(field.centers))
    assert encoded.size == field.size
    assert off.max() <= encoded.bound.max
    assert 20 * np.log10(np.ptp(field.at(field.centers)) / encoded.bound.rms) > 60
    assert len(encoded.code.data) < 20 * field.size
    encoded.save(tmp_path / "x.ssk")
    again = ss.open(tmp_path / "x.ssk")
    assert again == encoded
    assert (again.base, again.w0, again.periodic) == (field.base, field.w0, field.periodic)


@pytest.mark.parametrize("bound", [1e-2, 1e-4])
def test_a_bound_of_kernels_is_kept(bound):
    field = _ellipsoids()
    encoded = ss.fit.encode(field, max_error=bound)
    assert np.abs(encoded.at(field.centers) - field.at(field.centers)).max() <= encoded.bound.max <= bound


def test_fewer_kernels_and_bytes():
    field = _ellipsoids(1500)
    assert ss.fit.encode(field, kernels=300).size == 300
    small = ss.fit.encode(field, bytes=4000)
    assert len(small.code.data) <= 4000
    assert small.size < field.size


def test_a_volume_of_few_ellipsoids_is_found(tmp_path):
    planted = ss.EllipsoidField(
        [(9, 12, 10), (20, 14, 17), (14, 22, 8)], [(7, 5, 4), (9, 4, 6), (5, 8, 5)], values=[1.0, -0.6, 0.8],
        normalization="none",
    )  # fmt: skip
    k, j, i = np.indices((28, 30, 32)).reshape(3, -1)
    values = planted.at(np.stack((i, j, k), axis=1).astype(float)).reshape(28, 30, 32)
    field = ss.RegularField(values, base=0.0)
    encoded = ss.fit.encode(field, bytes=250)
    assert not encoded.isotropic
    assert len(encoded.code.data) <= 250
    assert encoded.bound.rms < 2e-2
    assert encoded.scalars_and_shown(np.stack((i, j, k), axis=1).astype(float))[1].all()
    off = np.abs(encoded.at(np.stack((i, j, k), axis=1).astype(float)) - values.ravel())
    assert off.max() <= encoded.bound.max
    assert encoded.domain == field.domain
    encoded.save(tmp_path / "x.ssk")
    assert ss.open(tmp_path / "x.ssk") == encoded


def test_damaged_kernels_are_told(tmp_path):
    data, path = ss.fit.encode(_ellipsoids(60)).code.data, tmp_path / "x.ssk"
    rng = np.random.default_rng(3)
    for at in range(0, len(data), 3):
        broken = bytearray(data[: rng.integers(len(data))] if rng.random() < 0.3 else data)
        if at < len(broken):
            broken[at] ^= 1 << rng.integers(8)
        path.write_bytes(broken)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ss.PictureWarning)
            try:
                ss.open(path)
            except ss.Error:
                pass


def test_kernels_of_equal_volume_are_refused():
    lattice = ss.EllipsoidField([(0, 0, 0)], [1.0], values=[1.0], normalization="lattice", cell_volume=1.0)
    with pytest.raises(ss.InvalidInput, match="normalization"):
        ss.fit.encode(lattice)


@pytest.mark.data
def test_published_kernels_take_ten_bytes_each():
    path = _DATA / "wveg_mito_1024.ply"
    if not path.is_file():
        pytest.skip(f"{path.name} is not there; set SHEETSPLAT_DATA")
    field = ss.open(path)
    encoded = ss.fit.encode(field)
    assert len(encoded.code.data) <= 10 * field.size
    assert 20 * np.log10(np.ptp(field.at(field.centers)) / encoded.bound.rms) >= 70
