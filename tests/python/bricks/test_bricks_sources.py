"""Volumes in bricks: what is read of files and arrays, and what is refused."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from bricked_volumes import SHAPE, SIZE, stored

import sheetsplat as ss
from sheetsplat.bricks.resident import residents
from sheetsplat.bricks.sources import open_source

KINDS = (
    "npy", "fortran", "raw", "nrrd", "metaimage", "hdf5", "zarr", "ome-zarr", "netcdf", "netcdf classic",
    "xarray", "dask",
)  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_boxes_of_a_source_are_those_of_the_opened_volume(kind, samples, tmp_path):
    data, options = stored(kind, samples, tmp_path)
    whole = ss.open(data, quality="draft", **options)
    source = open_source(data, options)
    assert source.shape == whole.shape and source.spacing == whole.spacing and source.origin == whole.origin
    assert source.quantity == whole.quantity and source.orientation == whole.orientation
    for box in (((0, 37), (0, 46), (0, 41)), ((3, 12), (45, 46), (7, 33)), ((36, 37), (0, 5), (40, 41))):
        cut = tuple(slice(*part) for part in box)
        np.testing.assert_array_equal(source.read(box), whole.values[cut])
    again = pickle.loads(pickle.dumps(source))
    assert again == source and again.token == source.token


def test_remote_raw_samples_are_read_by_ranges(samples, tmp_path):
    pytest.importorskip("fsspec")
    (tmp_path / "v.raw").write_bytes(samples.tobytes())
    source = open_source(f"file://{tmp_path / 'v.raw'}", {"shape": SHAPE, "dtype": "uint8"})
    np.testing.assert_array_equal(source.read(((5, 9), (3, 40), (2, 41))), samples[5:9, 3:40, 2:41])
    with pytest.raises(ss.InvalidInput, match="bytes of samples"):
        open_source(f"file://{tmp_path / 'v.raw'}", {"shape": SHAPE, "dtype": "uint16"})


def test_arrays_of_any_strides_and_types_are_read(samples):
    turned = samples[::-1, :, ::-2]
    assert ss.open_bricks(turned, brick=16, quality="draft").value_range == (0.0, float(samples.max()))
    np.testing.assert_array_equal(open_source(turned, {}).read(((0, 3), (1, 2), (0, 21))), turned[:3, 1:2])
    wide = ss.open_bricks(samples.astype(np.int64) - 3, brick=16, quality="draft")
    assert wide.samples.dtype == np.int16
    assert ss.RegularField(samples.astype(np.int64) - 3).values.dtype == np.int16


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (np.zeros((3, 4)), "2 axes"),
        (np.zeros((0, 4, 4)), "no samples"),
        (np.zeros((4, 4, 4), complex), "complex128"),
        (np.full((5, 5, 5), np.nan), "NaN"),
        (np.full((5, 5, 5), np.inf), "infinite sample at \\[0, 0, 0\\], in brick 0"),
    ],
)
def test_bad_arrays_are_refused(data, words):
    with pytest.raises(ss.InvalidInput, match=words):
        ss.open_bricks(data, brick=4)


def test_bad_options_are_refused(samples, tmp_path):
    for brick in (0, 3, 4096, "x", 1.5):
        with pytest.raises(ss.InvalidInput, match="brick"):
            ss.open_bricks(samples, brick=brick)
    with pytest.raises(ss.InvalidInput, match="client"):
        ss.open_bricks(samples, client="tcp://nowhere")
    with pytest.raises(ss.InvalidInput, match="resample"):
        ss.open_bricks(samples, resample=True)
    with pytest.raises(ss.InvalidInput, match="open_bricks"):
        ss.render(samples, client=Pretender())
    path = tmp_path / "mesh.vtk"
    path.write_text("# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\nPOINTS 0 float\n")
    with pytest.raises(ss.Error):
        ss.open_bricks(path)
    with pytest.raises(ss.Unsupported, match="values at points"):
        pickle.loads(pickle.dumps(ss.open_bricks(samples, brick=16))).at([[1, 2, 3]])
    with pytest.raises(ss.Unsupported, match="all samples"):
        np.asarray(ss.open_bricks(samples, brick=16).values)


class Pretender:
    def submit(self):
        """Have the name that a client has."""

    def scheduler_info(self):
        """Have the name that a client has."""


def test_blocks_that_disagree_with_their_array_are_named(samples):
    dask = pytest.importorskip("dask.array")
    lying = dask.from_array(samples, chunks=20).map_blocks(lambda part: part.astype(np.float64), dtype=np.uint8)
    with pytest.raises(ss.InvalidInput, match="samples of type float64.*uint8, as when it was opened"):
        ss.open_bricks(lying, brick=20)


def test_a_file_that_changed_is_not_mixed_with_what_was_read(samples, tmp_path):
    path = tmp_path / "v.npy"
    np.save(path, samples)
    bricked = ss.open_bricks(path, brick=16, quality="draft")
    residents().clear()
    np.save(path, samples[:, :, :40])
    with pytest.raises(ss.InvalidInput, match="changed"):
        ss.render(bricked, size=SIZE)


def test_zarr_chunks_are_checked_when_their_brick_is_read(samples, tmp_path):
    zarr = pytest.importorskip("zarr")
    path = tmp_path / "v.zarr"
    array = zarr.create_array(path, shape=SHAPE, chunks=(16, 16, 16), dtype=samples.dtype, fill_value=7)
    array[:] = samples
    source = open_source(path, {})
    chunk = path / "c" / "1" / "1" / "1"
    chunk.unlink()
    # A chunk that was never written holds the fill value.
    assert (source.read(((16, 32), (16, 32), (16, 32))) == 7).all()
    chunk.symlink_to("/etc/passwd")
    with pytest.raises(ss.InvalidInput, match="a link"):
        source.read(((20, 21), (20, 21), (20, 21)))
    np.testing.assert_array_equal(source.read(((0, 16), (0, 16), (0, 16))), samples[:16, :16, :16])


@pytest.mark.parametrize("kind", ["2.", "2/", "3/", "memory", "url", "dask", "xarray"])
def test_data_that_were_written_again_are_read_again(kind, samples, tmp_path):
    """Nothing that is resident of what was there before is shown: neither samples nor what was surveyed of them."""
    part, options = np.ascontiguousarray(samples[:20, :20, :20]), {}
    if kind == "url":
        pytest.importorskip("fsspec")
        data, options = f"file://{tmp_path / 'v.raw'}", {"shape": part.shape, "dtype": "uint8"}
    elif kind == "xarray":
        held = part.copy()
        data = pytest.importorskip("xarray").DataArray(held, dims=("z", "y", "x"))
    else:
        zarr = pytest.importorskip("zarr")
        store = zarr.storage.MemoryStore() if kind == "memory" else str(tmp_path / "v.zarr")
        keys = {"name": "v2", "separator": kind[1]} if kind in ("2.", "2/") else None
        form = 3 if keys is None else 2
        array = zarr.create_array(
            store, shape=part.shape, chunks=(8,) * 3, dtype="u1", zarr_format=form, chunk_key_encoding=keys
        )
        data = array if kind == "memory" else store
        if kind == "dask":
            data = pytest.importorskip("dask.array").from_zarr(store)

    def write(values):
        if kind == "url":
            (tmp_path / "v.raw").write_bytes(values.tobytes())
        elif kind == "xarray":
            held[:] = values
        else:
            array[:] = values

    pictures = []
    for values in (part, 255 - part):
        write(values)
        bricked = ss.open_bricks(data, brick=12, quality="draft", **options)
        assert bricked.value_range == (float(values.min()), float(values.max()))
        pictures.append(ss.render(bricked, size=SIZE, mode="xray").scalar)
        whole = ss.RegularField(values)
        expected = ss.render(whole, size=SIZE, mode="xray", slice_spacing=bricked.default_slice_spacing)
        place = [(4.0, 5.0, 6.0)]
        np.testing.assert_allclose(bricked.at(place), whole.at(place), rtol=1e-5)
        np.testing.assert_allclose(pictures[-1], expected.scalar, rtol=1e-4, atol=1e-4 * expected.scalar.max())
    assert not np.allclose(pictures[0], pictures[1], rtol=0.01)


@pytest.mark.parametrize("version", [2, 3])
def test_a_damaged_zarr_chunk_is_named(version, samples, tmp_path):
    zarr = pytest.importorskip("zarr")
    path = tmp_path / "v.zarr"
    array = zarr.create_array(path, shape=SHAPE, chunks=(16, 16, 16), dtype=samples.dtype, zarr_format=version)
    array[:] = samples
    chunk = path / ("1.2.1" if version == 2 else "c/1/2/1")
    for content in (b"nothing", bytes(50_000)):
        chunk.write_bytes(content)
        for read in (ss.open_bricks, ss.open):
            with pytest.raises(ss.InvalidInput) as told:
                read(path)
            assert str(chunk) in told.value.found
        # Others are read as they were.
        np.testing.assert_array_equal(open_source(path, {}).read(((0, 37), (0, 32), (0, 41))), samples[:, :32])


def test_zarr_in_shards(samples, tmp_path):
    zarr = pytest.importorskip("zarr")
    path = tmp_path / "v.zarr"
    array = zarr.create_array(path, shape=SHAPE, chunks=(8, 8, 8), shards=(32, 32, 32), dtype=samples.dtype)
    array[:] = samples
    for data in (path, array):
        source = open_source(data, {})
        np.testing.assert_array_equal(source.read(((0, 37), (3, 40), (30, 41))), samples[:, 3:40, 30:])
