"""Names of the arrays of a file: listed without a sample, the same as those of the error message and of `name=`."""

from __future__ import annotations

import json
import zipfile

import numpy as np
import pytest
from command_line import run

import sheetsplat as ss
from sheetsplat.color_bar import color_bars

# More samples than any memory has: whoever reads one of them fails.
HUGE = (60_000, 60_000, 60_000)


def hdf5(path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name in ("density", "flow/speed"):
            file.create_dataset(name, HUGE, "f4", chunks=(10, 10, 10))
        file["scale"] = np.arange(3.0)
    return path


def netcdf(path):
    netcdf4 = pytest.importorskip("h5netcdf")
    with netcdf4.File(path, "w") as file:
        file.dimensions = dict(zip("zyx", HUGE, strict=True))
        for name in ("density", "speed"):
            file.create_variable(name, tuple("zyx"), "f4", chunks=(10, 10, 10))
    return path


def zarr(path):
    for name in ("density", "speed"):
        (path / name).mkdir(parents=True)
        told = {"zarr_format": 2, "shape": HUGE, "chunks": [10, 10, 10], "dtype": "<f4", "order": "C"}
        (path / name / ".zarray").write_text(json.dumps({**told, "compressor": None, "fill_value": 0, "filters": None}))
    (path / ".zgroup").write_text('{"zarr_format": 2}')
    return path


def npz(path):
    header = np.lib.format
    with zipfile.ZipFile(path, "w") as archive:
        for name in ("density", "speed"):
            with archive.open(name + ".npy", "w") as stream:
                header.write_array_header_1_0(stream, {"descr": "<f4", "fortran_order": False, "shape": HUGE})
    return path


def vti(path):
    arrays = "".join(
        f'<DataArray type="Float32" Name="{name}" format="appended" offset="{number}"/>'
        for number, name in enumerate(("speed", "density"))
    )
    extent = " ".join(f"0 {size - 1}" for size in HUGE)
    path.write_text(
        f'<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian"><ImageData WholeExtent="{extent}">'
        f'<Piece Extent="{extent}"><PointData Scalars="density">{arrays}</PointData></Piece></ImageData>'
        '<AppendedData encoding="raw">_</AppendedData></VTKFile>'
    )
    return path


def csv(path):
    path.write_text("x,y,z,value,speed\n0,0,0,no number,\n")
    return path


FILES = {
    "a.h5": (hdf5, ("/density", "/flow/speed"), None),
    "a.nc": (netcdf, ("density", "speed"), None),
    "a.zarr": (zarr, ("density", "speed"), None),
    "a.npz": (npz, ("density", "speed"), None),
    "a.vti": (vti, ("density", "speed"), "density"),
    "a.csv": (csv, ("value", "speed"), "value"),
}


@pytest.mark.parametrize("name", FILES)
def test_names_are_listed_without_a_sample(tmp_path, name):
    make, names, shown = FILES[name]
    path = make(tmp_path / name)
    found = ss.io.arrays(path)
    assert (found.names, found.shown) == (names, shown)
    with pytest.raises(ss.Error) as error:
        ss.open(path)
    if shown is None:
        # The message has the same names.
        assert all(one in str(error.value) for one in names)
        told = run("info", path)
        assert told.exit_code == 0 and f"{', '.join(names)}; choose with --name" in told.output


def test_each_name_opens_its_array(tmp_path):
    path = tmp_path / "a.npz"
    given = {name: np.full((4, 5, 6), at, np.float32) for at, name in enumerate(("b", "a", "c"))}
    np.savez(path, **given, scale=np.arange(3))
    names = ss.io.arrays(path).names
    assert names == ("a", "b", "c")
    for one in names:
        np.testing.assert_array_equal(ss.open(path, name=one).values, given[one])
    np.save(tmp_path / "one.npy", given["a"])
    assert ss.io.arrays(tmp_path / "one.npy") == ss.io.Names()


def test_arrays_of_numpy_are_called_by_their_names(tmp_path):
    values = np.random.default_rng(1).random((8, 9, 10))
    np.savez(tmp_path / "two.npz", density=values, speed=values)
    np.savez(tmp_path / "one.npz", values)
    assert ss.open(tmp_path / "two.npz", name="speed").name == "speed"
    (bar,) = color_bars(ss.render(tmp_path / "two.npz", name="speed", size=8))
    assert bar.label == "speed"
    # A number that nobody gave is no name.
    assert ss.open(tmp_path / "one.npz").name == ""
    np.save(tmp_path / "x.npy", values)
    with zipfile.ZipFile(tmp_path / "odd.npz", "w") as archive:
        archive.writestr("a\x1b[31mb.npy", (tmp_path / "x.npy").read_bytes())
    assert "\x1b" not in ss.open(tmp_path / "odd.npz").name


def test_images_of_a_group_are_chosen_by_name(tmp_path):
    for at, name in enumerate(("left", "right")):
        place = tmp_path / "a.zarr" / name
        (place / "0").mkdir(parents=True)
        scale = [{"type": "scale", "scale": [1, 1, 1]}]
        image = {"version": "0.4", "axes": [{"name": axis} for axis in "zyx"],
                 "datasets": [{"path": "0", "coordinateTransformations": scale}]}  # fmt: skip
        (place / ".zattrs").write_text(json.dumps({"multiscales": [image]}))
        (place / ".zgroup").write_text('{"zarr_format": 2}')
        told = {"zarr_format": 2, "shape": [4, 4, 4], "chunks": [4, 4, 4], "dtype": "<f4", "order": "C"}
        told |= {"compressor": None, "fill_value": at, "filters": None}
        (place / "0" / ".zarray").write_text(json.dumps(told))
    (tmp_path / "a.zarr" / ".zgroup").write_text('{"zarr_format": 2}')
    assert ss.io.arrays(tmp_path / "a.zarr").names == ("left", "right")
    assert ss.open(tmp_path / "a.zarr", name="right").values.max() == 1


def test_arrays_of_series_are_listed(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name in ("density", "speed"):
            file[name] = np.zeros((2, 4, 4, 4), np.float32)
            for axis, label in enumerate(("time", "z", "y", "x")):
                file[name].dims[axis].label = label
    assert ss.io.arrays(tmp_path / "a.h5").names == ("/density", "/speed")
