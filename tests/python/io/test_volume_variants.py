"""What files state of their samples: packed numbers, coordinates, units, shards, user blocks, steps and channels."""

from __future__ import annotations

import gzip
import json
import time

import numpy as np
import pytest
from test_data_formats import VALUES, dicom, item, needed, nifti, picture, tiff, zarr_array

import sheetsplat as ss
from sheetsplat import io

# Of 0.01 K: 100 to 390 K at 20 levels, rows from north to south.
PACKED = np.arange(4 * 5 * 6, dtype=np.int16).reshape(4, 5, 6)
SCALE, OFFSET, FILL = 0.01, 250.0, -32768
EXPECTED = (PACKED * SCALE + OFFSET)[:, ::-1]


def packed_set():
    """Return a Dataset that is packed where it is written: `EXPECTED` without the first sample, and its coordinates."""
    xr = needed("xarray")
    values = PACKED * SCALE + OFFSET
    values[0, 0, 0] = np.nan
    places = {"lev": np.arange(4) * 10.0, "lat": np.arange(5)[::-1] * 2.0, "lon": np.arange(6) * 3.0}
    data = xr.Dataset({"t": (("lev", "lat", "lon"), values, {"units": "K"})}, coords=places)
    data["t"].encoding = {"scale_factor": SCALE, "add_offset": OFFSET, "_FillValue": FILL, "dtype": "int16"}
    return data


def write_packed(path, kind):
    """Write the packed set as NetCDF, Zarr or HDF5, and return how it is opened."""
    if kind == "hdf5":
        with needed("h5py").File(path, "w") as file:
            file["t"] = np.where(PACKED == 0, FILL, PACKED).astype(np.int16)
            file["t"].attrs.update({"scale_factor": SCALE, "add_offset": OFFSET, "_FillValue": FILL, "units": "K"})
            for number, (name, places) in enumerate(packed_set().coords.items()):
                file[name] = places.values
                file[name].make_scale(name)
                file["t"].dims[number].attach_scale(file[name])
    elif kind.startswith("zarr"):
        needed("zarr")
        packed_set().to_zarr(path, zarr_format=int(kind[-1]), consolidated=False)
    else:
        needed(kind)
        packed_set().to_netcdf(path, engine=kind)
    return path


@pytest.mark.parametrize("kind", ["scipy", "h5netcdf", "zarr 2", "zarr 3", "hdf5", "DataArray"])
def test_packed_numbers_are_unpacked_and_placed_alike(tmp_path, kind):
    names = {"scipy": "a.nc", "h5netcdf": "a.nc", "hdf5": "a.h5"}
    path = tmp_path / names.get(kind, "a.zarr")
    data = write_packed(path, kind) if kind != "DataArray" else packed_set()["t"]
    for field in (ss.open(data), ss.open_bricks(data, brick=4)):
        assert field.spacing == (3, 2, 10) and field.origin == (0, 0, 0) and field.shape == (4, 5, 6)
        assert field.quantity.label == "t [K]" and field.quantity.axes[1].name == "lat"
        assert field.nan == "skip"
    field = ss.open(data)
    # The first sample of the file is the north-west corner.
    assert np.isnan(field.values[0, -1, 0]) and np.isnan(field.values).sum() == 1
    np.testing.assert_allclose(np.nan_to_num(field.values, nan=EXPECTED[0, -1, 0]), EXPECTED, atol=1e-4)
    if kind.startswith("zarr"):
        assert ss.open(needed("zarr").open_array(str(path / "t"), mode="r")).spacing == (3, 2, 10)
    source = ss.open_bricks(data, brick=4).source
    np.testing.assert_array_equal(source.read(((1, 3), (0, 5), (2, 6))), field.values[1:3, :, 2:6])


def test_packed_numbers_have_the_narrowest_type_that_holds_them():
    packing = io.Packing
    for stored, packed, wanted in (
        ("i2", packing(1.0, -1024.0), "i4"),
        ("i2", packing(0.01, 250.0), "f4"),
        ("i2", packing(1e-6, 250.0), "f8"),
        ("i4", packing(0.01, 0.0), "f8"),
        ("u1", packing(missing=(255,)), "f4"),
        ("f4", packing(0.5, 1e9), "f4"),
        ("f8", packing(missing=(np.nan,)), "f8"),
        ("i2", packing(unsigned=True), "u2"),
    ):
        assert packed.kind(np.dtype(stored)) == wanted, (stored, packed)
        assert packed.unpacked(np.array([1, 2], stored), "x").dtype == wanted
    values = packing(2.0, 1.0, (255.0,), unsigned=True).unpacked(np.array([-1, -2, 3], "i1"), "x")
    assert np.isnan(values[0]) and values[1:].tolist() == [509, 7]
    assert np.isnan(packing(missing=(float(np.float64(1e20)),)).unpacked(np.array([1e20], "f4"), "x"))[0]


@pytest.mark.parametrize("scale", [1e-300, 1e-42, 1e36])
def test_scales_beyond_float32_keep_the_samples(scale):
    packing, stored = ss.io.Packing(scale, missing=(-1,)), np.array([-1, 1, 999], "i2")
    found = packing.unpacked(stored, "a file")
    assert found.dtype == packing.kind(stored.dtype) == np.float64
    assert np.allclose(found[1:] / scale, stored[1:], rtol=1e-12)


def test_packing_that_is_wrong(tmp_path):
    for name, told in (("scale_factor", 0), ("scale_factor", "x"), ("add_offset", "1e999"), ("_FillValue", {})):
        path = zarr_array(tmp_path / f"{name}{told}.zarr")
        (path / ".zattrs").write_text(json.dumps({name: told}))
        with pytest.raises(ss.InvalidInput, match=name):
            ss.open(path)


def test_lengths_of_different_units_become_one(tmp_path):
    about = {
        "axes": "ZYX",
        "PhysicalSizeX": 0.5,
        "PhysicalSizeY": 0.25,
        "PhysicalSizeZ": 2000,
        "PhysicalSizeZUnit": "nm",
    }
    field = ss.open(tiff(tmp_path / "a.ome.tif", metadata=about))
    assert field.spacing == pytest.approx((0.5, 0.25, 2)) and field.quantity.length_unit == "µm"
    about["PhysicalSizeZUnit"] = "pixel"
    with pytest.warns(ss.PictureWarning, match="not all lengths .x µm, y µm, z pixel"):
        assert ss.open(tiff(tmp_path / "b.ome.tif", metadata=about)).spacing == (0.5, 0.25, 2000)
    xr = needed("xarray")
    places = {name: (name, np.arange(size) * 2.0, {"units": unit})
              for name, size, unit in (("z", 4, "m"), ("y", 5, "km"), ("x", 6, "km"))}  # fmt: skip
    field = ss.open(xr.DataArray(VALUES, dims=("z", "y", "x"), coords=places))
    assert field.spacing == pytest.approx((2, 2, 0.002)) and field.quantity.length_unit == "km"
    # Figures have the coordinates of the data.
    assert field.quantity.axes[2].coordinate(0.004) == pytest.approx(4) and field.quantity.axes[2].unit == "m"


def test_imagej_states_spacing_without_a_unit_and_with_two(tmp_path):
    plain = {"axes": "ZYX", "spacing": 1.5}
    field = ss.open(tiff(tmp_path / "a.tif", imagej=True, resolution=(4, 2), metadata=plain))
    assert field.spacing == pytest.approx((0.25, 0.5, 1.5)) and field.quantity.length_unit == ""
    alone = tiff(tmp_path / "c.tif", imagej=True, metadata=plain)
    assert ss.open(alone).spacing == pytest.approx((1, 1, 1.5))
    both = {**plain, "unit": "micron", "zunit": "nm", "spacing": 1500.0, "zorigin": 2.0}
    field = ss.open(tiff(tmp_path / "b.tif", imagej=True, resolution=(4, 2), metadata=both))
    assert field.spacing == pytest.approx((0.25, 0.5, 1.5)) and field.quantity.length_unit == "µm"
    assert field.origin == pytest.approx((0, 0, -3))


def test_places_of_geotiff_are_told(tmp_path):
    tags = [(33550, "d", 3, (30.0, 30.0, 0.0), True)]
    path = tiff(tmp_path / "a.tif", extratags=tags)
    with pytest.warns(ss.PictureWarning, match=r"ModelPixelScaleTag = \(30.0, 30.0, 0.0\)"):
        ss.open(path)


def test_curvilinear_coordinates_are_told(tmp_path):
    xr = needed("xarray")
    data = xr.Dataset({"t": (("z", "y", "x"), VALUES.astype(np.float32))})
    for name in ("lon", "lat"):
        data.coords[name] = (("y", "x"), np.arange(30.0).reshape(5, 6))
    data.to_netcdf(tmp_path / "a.nc", engine="scipy")
    data.to_zarr(tmp_path / "a.zarr", zarr_format=2, consolidated=False)
    for one in (data, tmp_path / "a.nc", tmp_path / "a.zarr"):
        with pytest.warns(ss.PictureWarning, match="the coordinates (lon, lat|lat, lon) follow several dimensions"):
            ss.open(one)


def stacked(path, imagej=False):
    """Write a stack of three times and two channels."""
    stack = np.stack([np.stack([VALUES + 10 * time + channel for channel in range(2)], axis=1) for time in range(3)])
    about = {"axes": "TZCYX"} if imagej else {"axes": "TZCYX", "Channel": {"Name": ["DAPI", "GFP"]}}
    return tiff(path, stack, imagej=imagej, metadata=about)


def test_steps_and_channels_of_tiff(tmp_path):
    for name in ("a.tif", "a.ome.tif"):
        path = stacked(tmp_path / name, imagej=name == "a.tif")
        chosen = ss.open(path, name="1", step=2)
        assert np.array_equal(chosen.values, VALUES + 21)
        with pytest.raises(ss.InvalidInput, match="3 time steps; wanted one; pass step=0"):
            ss.open(path, name="0")
        assert ss.open(path, step=2)[1] == chosen.opened_with({})
        assert len(ss.animate(path, size=16, backend="reference", name="0")) == 3
    assert np.array_equal(ss.open(path, name="GFP", step=0).values, VALUES + 1)
    flat = tiff(tmp_path / "b.ome.tif", VALUES, metadata={"axes": "TYX"})
    with pytest.raises(ss.InvalidInput, match="4 of axis T.*one slice each.*tifffile.imread"):
        ss.open(flat)


def test_steps_of_dicom_and_nifti(tmp_path):
    folder = dicom(dicom(tmp_path / "mr", number=1), order=range(4), number=1, first=4)
    assert len(list(folder.iterdir())) == 8
    later = ss.open(folder, step=1)
    assert np.array_equal(later.values, ss.open(folder, step=0).values)
    with pytest.raises(ss.InvalidInput, match="2 time steps"):
        ss.open(folder)
    path = nifti(tmp_path / "a.nii.gz", values=np.stack([VALUES, VALUES + 1]))
    assert np.array_equal(ss.open(path, step=1).values, VALUES + 1)
    assert len(ss.animate(path, size=16, backend="reference")) == 2


def dose(folder):
    """Write a dose: frames of which each lies 3 mm beyond the one before."""

    def change(data, _):
        data.NumberOfFrames, data.PixelData, data.Modality = 4, VALUES.tobytes(), "RTDOSE"
        data.GridFrameOffsetVector, data.DoseGridScaling, data.DoseUnits = [0, 3, 6, 9], 0.5, "GY"
        del data.RescaleSlope, data.RescaleIntercept

    return dicom(folder, order=[0], change=change)


def test_doses_and_frames_at_even_distances(tmp_path):
    def spaced(data, _):
        data.NumberOfFrames, data.PixelData, data.SpacingBetweenSlices = 4, VALUES.tobytes(), 3

    def neither(data, _):
        data.NumberOfFrames, data.PixelData = 4, VALUES.tobytes()

    field = ss.open(dose(tmp_path / "dose"))
    np.testing.assert_array_equal(field.values, VALUES * np.float32(0.5))
    assert field.spacing == (0.5, 0.75, 3) and field.origin == (10, 20, 30) and field.quantity.label == "dose [Gy]"
    assert ss.open(dicom(tmp_path / "frames", order=[0], change=spaced)).spacing == (0.5, 0.75, 3)
    with pytest.raises(ss.InvalidInput, match="GridFrameOffsetVector or SpacingBetweenSlices"):
        ss.open(dicom(tmp_path / "none", order=[0], change=neither))


def test_frames_that_are_not_there_are_refused_soon(tmp_path):
    """100,000 frames of a file of 2 KB took 18 s, as each was looked up by itself."""

    def many(data, _):
        data.NumberOfFrames, data.SpacingBetweenSlices = 10**5, 1

    def few_groups(data, _):
        data.NumberOfFrames, data.PixelData = 4, VALUES.tobytes()
        data.PerFrameFunctionalGroupsSequence = [item(PlanePositionSequence=[item(ImagePositionPatient=[0, 0, 0])])] * 3

    started = time.process_time()
    for number, (change, text) in enumerate(((many, "pixel data is less"), (few_groups, "4 frames with 3 groups"))):
        with pytest.raises(ss.InvalidInput, match=text):
            ss.open(dicom(tmp_path / str(number), order=[0], change=change))
    assert time.process_time() - started < 12


def bare_dicom(folder, older=False):
    """Write a series without the bytes before the first element; `older`: without what says how it is written."""
    for one in dicom(folder).iterdir():
        data = one.read_bytes()
        # The data set begins with SOPClassUID, (0008,0016).
        one.write_bytes(data[data.index(b"\x08\x00\x16\x00UI") if older else 132 :])
    return folder


def test_dicom_without_its_first_bytes(tmp_path):
    whole = ss.open(dicom(tmp_path / "a"))
    assert ss.open(bare_dicom(tmp_path / "b")) == whole == ss.open(bare_dicom(tmp_path / "c", older=True))
    # Numbers are no elements.
    for values in ([8, 22, 0, 0, 8, 24, 0, 0, 8, 3], [2, 0, 4, 0, 0, 0, 2, 1, 3, 0], [8] * 99, range(8, 99)):
        (tmp_path / "x.data").write_bytes(np.array(values, "<i2").tobytes())
        with pytest.raises(ss.InvalidInput, match="a format that is not known"):
            ss.open(tmp_path / "x.data")


def behind_block(path, block):
    """Write a volume as MATLAB does, behind so many bytes."""
    with needed("h5py").File(path, "w", userblock_size=block) as file:
        file["a"] = VALUES
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file")
    return path


@pytest.mark.parametrize("block", [512, 1024, 2048])
def test_hdf5_behind_a_user_block(tmp_path, block):
    path = behind_block(tmp_path / "a.mat", block)
    assert np.array_equal(ss.open(path).values, VALUES)
    assert ss.open_bricks(path, brick=4).shape == (4, 5, 6)
    (tmp_path / "a.mat.gz").write_bytes(gzip.compress(path.read_bytes()))
    assert np.array_equal(ss.open(tmp_path / "a.mat.gz").values, VALUES)


def root_of_images(root, version=2):
    """Write a group with an image, as bioformats2raw does."""
    group = needed("zarr").create_group(str(root), zarr_format=version)
    group.attrs["bioformats2raw.layout"] = 3
    picture(root / "0", version, ("only",))
    return root


@pytest.mark.parametrize("version", [2, 3])
def test_images_in_a_root(tmp_path, version):
    root = root_of_images(tmp_path / "a.zarr", version)
    assert np.array_equal(ss.open(root).values, VALUES)
    with pytest.raises(ss.InvalidInput, match="found nothing at /7; wanted one of: 0"):
        ss.open(f"{root}:/7")
    picture(root / "1", version, ("only",))
    with pytest.raises(ss.InvalidInput, match=r"2 images: 0, 1; wanted one of them; choose one, .*a.zarr:/0"):
        ss.open(root)
    assert ss.open(f"{root}:/1").spacing == (0.5, 0.5, 2) == ss.open_bricks(f"{root}:/1", brick=4).spacing


def test_steps_of_arrays_without_names(tmp_path):
    several = np.stack([VALUES, VALUES + 1])
    with needed("h5py").File(tmp_path / "a.h5", "w") as file:
        file["a"] = several
    assert np.array_equal(ss.open(tmp_path / "a.h5", step=1).values, VALUES + 1)
    assert len(ss.animate(tmp_path / "a.h5", size=16, backend="reference")) == 2
    np.save(tmp_path / "a.npy", several)
    with pytest.raises(ss.InvalidInput, match=r"4 axes.*numpy.load\(path\)\[0\]"):
        ss.open(tmp_path / "a.npy")
    for name, own in (("channel", "name"), ("time", "step")):
        with pytest.raises(TypeError, match=f"did you mean {own}"):
            ss.open(tmp_path / "a.h5", **{name: 0})


def test_stores_of_several_arrays_advise_the_largest(tmp_path):
    zarr, h5py = needed("zarr"), needed("h5py")
    group = zarr.create_group(str(tmp_path / "a.zarr"), zarr_format=3)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, values in (("a", VALUES), ("b", np.stack([VALUES, VALUES])), ("c", VALUES[0])):
            group.create_array(name, data=values)
            file[name] = values
    for path in (tmp_path / "a.zarr", tmp_path / "a.h5"):
        with pytest.raises(ss.InvalidInput, match=f"choose one, .*{path.name}:/b"):
            ss.open(path)
    # Coordinates are no volumes.
    del group["b"]
    assert np.array_equal(ss.open(tmp_path / "a.zarr").values, VALUES)


def shards(path):
    """Write an array whose chunks lie in one file."""
    needed("zarr").create_array(path, data=VALUES, chunks=(2, 5, 3), shards=(4, 5, 6), compressors=None)
    return path


def test_shards_that_lie_are_refused(tmp_path):
    path = shards(tmp_path / "a.zarr")
    assert np.array_equal(ss.open(path).values, VALUES)
    shard = next(one for one in path.rglob("*") if one.is_file() and one.name != "zarr.json")
    whole = shard.read_bytes()
    for change in (whole[:-40], whole[:-68] + np.array([10**9, 60], "<u8").tobytes() + whole[-52:], whole[-20:]):
        shard.write_bytes(change)
        with pytest.raises(ss.InvalidInput):
            ss.open(path)
    shard.write_bytes(whole)
    told = json.loads((path / "zarr.json").read_text())
    told["codecs"][0]["configuration"]["codecs"].append({"name": "pickle"})
    (path / "zarr.json").write_text(json.dumps(told))
    with pytest.raises(ss.Unsupported, match="the codec 'pickle'"):
        ss.open(path)


def test_arrays_and_lists_as_they_come(tmp_path):
    assert ss.open(VALUES, spacing=(1, 2, 3)).spacing == (1, 2, 3)
    assert np.array_equal(ss.open(VALUES.tolist()).values, VALUES)
    np.save(tmp_path / "a.npy", VALUES)
    np.save(tmp_path / "b.npy", VALUES + 1)
    both = [tmp_path / "a.npy", str(tmp_path / "b.npy")]
    options = {"size": 16, "backend": "reference", "clim": (0, 1000)}
    assert ss.render(both, **options) == ss.render([VALUES, VALUES + 1], **options)
    for several in (both, [VALUES, VALUES], [tmp_path / "a.npy", VALUES]):
        with pytest.raises(ss.InvalidInput, match=r"a list of 2; wanted one file or array.*sheetsplat.render"):
            ss.open(several)
    with pytest.raises(ss.InvalidInput, match="name only for files"):
        ss.open(VALUES, name="a")


def test_axis_mins_of_nrrd_place_samples(tmp_path):
    for centers, first, step in (
        ("cell cell cell", (2.5, 2.5, 2.5), (1, 1, 1)),
        ("node node node", (2, 2, 2), (2, 1.5, 1.2)),
    ):
        header = "NRRD0004\ntype: short\ndimension: 3\nsizes: 4 5 6\nencoding: raw\nendian: little\n"
        header += f"axis mins: 2 2 2\naxis maxs: {'6 7 8' if first[0] == 2.5 else '8 8 8'}\ncenters: {centers}\n\n"
        (tmp_path / "a.nrrd").write_bytes(header.encode() + VALUES.astype("<i2").tobytes())
        field = ss.open(tmp_path / "a.nrrd")
        assert field.origin == pytest.approx(first) and field.spacing == pytest.approx(step)
