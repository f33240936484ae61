"""Arrays of dask, Zarr and h5py, and columns of DataFrames and dicts."""

from __future__ import annotations

import numpy as np
import pytest

import sheetsplat as ss

VALUES = np.random.default_rng(14).random((4, 5, 6)).astype(np.float32)


def columns(count=12):
    numbers = np.random.default_rng(3)
    return {
        **{axis: numbers.random(count) for axis in "xyz"},
        "temperature": numbers.random(count),
        "radius": np.full(count, 0.4),
    }


def test_dask_arrays_are_computed_if_they_fit():
    da = pytest.importorskip("dask.array", reason="dask is not installed")
    assert np.array_equal(ss.open(da.from_array(VALUES, chunks=2)).values, VALUES)
    assert ss.render(da.from_array(VALUES), size=16, backend="reference").rgba.any()
    with pytest.raises(ss.OutOfMemory, match="the dask array"):
        ss.open(da.zeros((10**6, 10**6, 10**6), chunks=10**5))
    with pytest.raises(ss.InvalidInput, match="2 axes"):
        ss.open(da.zeros((10**9, 10**9)))
    unknown = da.from_array(VALUES)[da.from_array(VALUES[:, 0, 0]) > 0.5]
    with pytest.raises(ss.InvalidInput, match="compute_chunk_sizes"):
        ss.open(unknown)

    def fail(block):
        raise OSError("a worker is gone")

    with pytest.raises(ss.InvalidInput, match="the dask array cannot be used: found OSError: a worker is gone"):
        ss.open(da.from_array(VALUES).map_blocks(fail, dtype=np.float32, meta=np.empty((0, 0, 0), np.float32)))


def test_zarr_arrays():
    zarr = pytest.importorskip("zarr", reason="zarr is not installed")
    stored = zarr.create_array(store=zarr.storage.MemoryStore(), name="density", data=VALUES, chunks=(2, 3, 3))
    field = ss.open(stored, spacing=(1, 1, 2))
    assert np.array_equal(field.values, VALUES) and field.quantity.name == "density"
    with pytest.raises(ss.InvalidInput, match="4 axes.*choose one channel"):
        ss.open(zarr.create_array(store=zarr.storage.MemoryStore(), data=VALUES[None]))


def test_hdf5_datasets(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["group/density"] = VALUES
        file.create_dataset("huge", (10**6, 10**6, 10**5), np.float64, chunks=(10, 10, 10))
        file["words"] = np.full((2, 2, 2), b"text")
        field = ss.open(file["group/density"])
        assert np.array_equal(field.values, VALUES) and field.quantity.name == "density"
        with pytest.raises(ss.OutOfMemory):
            ss.open(file["huge"])
        with pytest.raises(ss.InvalidInput, match="values of type"):
            ss.open(file["words"])


def test_columns_of_a_dict():
    data = columns()
    field = ss.open(data)
    assert (
        field.isotropic and np.array_equal(field.values, data["temperature"]) and field.quantity.name == "temperature"
    )
    assert np.array_equal(field.centers, np.stack([data[axis] for axis in "xyz"], axis=1))
    assert np.array_equal(ss.open({**data, "value": data["x"]}).values, data["x"])
    assert np.array_equal(ss.open(data | {"density": data["x"] + 1}, scalar="density").values, data["x"] + 1)
    assert ss.render(data, size=16, backend="reference").rgba.any()


def test_arrays_of_positions_and_of_vectors():
    data = columns()
    positions = np.stack([data.pop(axis) for axis in "xyz"], axis=1)
    velocity = np.random.default_rng(5).random((12, 3))
    field = ss.open({"positions": positions, "velocity": velocity, **data}, scalar="velocity")
    np.testing.assert_allclose(field.values, np.linalg.norm(velocity, axis=1))
    assert np.array_equal(field.centers, positions)
    field = ss.open({"positions": positions, "velocity": velocity, **data}, scalar="velocity_y")
    assert np.array_equal(field.values, velocity[:, 1])


def test_points_without_radii_are_fitted():
    data = columns(60)
    del data["radius"]
    assert ss.open(data).size > 0
    assert ss.open(data, fit="nearest", neighbors=5).isotropic


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_data_frames(library):
    frames = pytest.importorskip(library, reason=f"{library} is not installed")
    data = columns()
    told = frames.DataFrame({"name": ["a"] * 12, **data})
    assert ss.open(told) == ss.open(data)
    with pytest.raises(ss.InvalidInput, match="'name' cannot be taken from the DataFrame: found these: temperature"):
        ss.open(told, scalar="name")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"z": [1.0]}, "'z' of shape"),
        ({"z": np.full(12, np.nan)}, "position of row 0; numbers of 12 of 12 rows are not finite"),
        ({"temperature": np.full(12, np.inf)}, "not finite"),
        ({"radius": np.zeros(12)}, "semi-axis|radius|scales"),
        ({"z": ["a"] * 12}, "also z"),
        ({"x": np.zeros((12, 2))}, "'x' of shape"),
    ],
)
def test_columns_that_are_wrong(change, message):
    with pytest.raises(ss.InvalidInput, match=message):
        ss.open({**columns(), **change})


def test_nothing_to_show():
    data = columns()
    del data["temperature"]
    with pytest.raises(ss.InvalidInput, match="one more, value"):
        ss.open(data)
    with pytest.raises(ss.InvalidInput, match="found spacing for scattered data"):
        ss.open(columns(), spacing=(1, 1, 1))
