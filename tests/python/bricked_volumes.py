"""A small volume and the files that hold it, for tests of data in bricks."""

from __future__ import annotations

import numpy as np
import pytest

SIZE = (72, 60)
SHAPE = (37, 46, 41)
# Rounding of float32: what is drawn in bricks is the picture of the whole.
ROUNDING = 1e-6


def blob(shape=SHAPE, kind=np.uint8):
    """Return two soft balls, one of them behind the other in most views."""
    k, j, i = (np.arange(size, dtype=np.float64) / size for size in shape)
    k, j, i = k[:, None, None], j[None, :, None], i[None, None, :]
    first = np.exp(-((k - 0.4) ** 2 + (j - 0.5) ** 2 + (i - 0.45) ** 2) / 0.03)
    second = np.exp(-((k - 0.7) ** 2 + (j - 0.6) ** 2 + (i - 0.7) ** 2) / 0.008)
    values = 200 * np.maximum(first, 0.8 * second)
    return values.round().astype(kind) if np.dtype(kind).kind in "iu" else values.astype(kind)


def rmse(one, other):
    """Return the root mean square difference of two pictures whose pixels are NaN at the same places."""
    np.testing.assert_array_equal(np.isnan(one.pixels), np.isnan(other.pixels))
    return float(np.sqrt(np.nanmean((one.pixels.astype(np.float64) - other.pixels) ** 2)))


def stored(kind, samples, folder):
    """Return what `open_bricks` and `open` take for the samples in a format, with options."""
    if kind == "npy":
        np.save(folder / "v.npy", samples)
        return folder / "v.npy", {}
    if kind == "fortran":
        np.save(folder / "v.npy", np.asfortranarray(samples))
        return folder / "v.npy", {}
    if kind == "raw":
        (folder / "v.raw").write_bytes(b"head" + samples.astype(">i2").tobytes())
        return folder / "v.raw", {"shape": samples.shape, "dtype": ">i2", "offset": 4}
    if kind == "nrrd":
        header = f"NRRD0004\ntype: uchar\ndimension: 3\nsizes: {' '.join(map(str, samples.shape[::-1]))}\n"
        header += "encoding: raw\nspace dimension: 3\nspace directions: (-2,0,0) (0,1.5,0) (0,0,-1)\n"
        header += "space origin: (1,2,3)\ndata file: v.bin\n"
        (folder / "v.nhdr").write_text(header)
        (folder / "v.bin").write_bytes(samples.tobytes())
        return folder / "v.nhdr", {}
    if kind == "metaimage":
        header = f"NDims = 3\nDimSize = {' '.join(map(str, samples.shape[::-1]))}\nElementType = MET_UCHAR\n"
        (folder / "v.mha").write_bytes((header + "ElementDataFile = LOCAL\n").encode() + samples.tobytes())
        return folder / "v.mha", {}
    if kind == "hdf5":
        h5py = pytest.importorskip("h5py")
        with h5py.File(folder / "v.h5", "w") as file:
            file.create_dataset("a/b", data=samples[:, None], chunks=(8, 1, 9, 10), compression="gzip")
        return f"{folder / 'v.h5'}:/a/b", {}
    if kind in ("zarr", "ome-zarr"):
        zarr = pytest.importorskip("zarr")
        if kind == "zarr":
            array = zarr.create_array(folder / "v.zarr", shape=samples.shape, chunks=(9, 16, 8), dtype=samples.dtype)
            array[:] = samples
            return folder / "v.zarr", {}
        group = zarr.create_group(folder / "v.zarr", zarr_format=2)
        array = group.create_array("0", shape=(1, *samples.shape), chunks=(1, 16, 16, 16), dtype=samples.dtype)
        array[:] = samples[None]
        axes = [{"name": name, "type": "space" if name in "zyx" else "channel"} for name in "czyx"]
        level = {"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [1, 3.0, 2.0, 1.0]}]}
        group.attrs["multiscales"] = [{"version": "0.4", "axes": axes, "datasets": [level]}]
        return folder / "v.zarr", {}
    xarray = pytest.importorskip("xarray")
    coords = {"z": np.arange(samples.shape[0])[::-1] * 2.0, "y": np.arange(samples.shape[1]) * 1.0}
    array = xarray.DataArray(samples.astype(np.float32), dims=("z", "y", "x"), coords=coords, name="rho")
    if kind == "netcdf":
        pytest.importorskip("h5netcdf")
        array.to_netcdf(folder / "v.nc", engine="h5netcdf")
        return folder / "v.nc", {}
    if kind == "netcdf classic":
        array.to_netcdf(folder / "v.nc", engine="scipy")
        return folder / "v.nc", {}
    if kind == "xarray":
        return array, {}
    dask = pytest.importorskip("dask.array")
    return dask.from_array(samples, chunks=(10, 20, 30)), {}
