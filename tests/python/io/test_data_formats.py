"""Formats that other libraries know: NIfTI, DICOM, TIFF, MRC, NetCDF, HDF5, Zarr; and readers of other packages."""

from __future__ import annotations

import gzip
import importlib.metadata
import json
import logging
import os
import struct
import sys
import zlib

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat import io
from sheetsplat.io import formats

VALUES = np.random.default_rng(14).integers(0, 1000, (4, 5, 6)).astype(np.int16)


def needed(name):
    return pytest.importorskip(name, reason=f"{name} is not installed")


# ------------------------------------------------------------------------------------------------------------- NIfTI


def nifti(path, affine=None, values=VALUES, unit="mm", kind="Nifti1Image", scale=None, **header):
    nib = needed("nibabel")
    affine = np.diag([2.0, 3.0, 4.0, 1.0]) if affine is None else affine
    image = getattr(nib, kind)(values.T, affine)
    image.header.set_xyzt_units(unit)
    for name, value in header.items():
        image.header[name] = value
    nib.save(image, path)
    if scale is not None:
        data = bytearray(path.read_bytes())
        data[112:120] = struct.pack("<ff", *scale)
        path.write_bytes(data)
    return path


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("a.nii", "Nifti1Image"),
        ("a.nii.gz", "Nifti1Image"),
        ("b.nii", "Nifti2Image"),
        ("c.hdr", "Nifti1Pair"),
        ("c.img.gz", "Nifti2Pair"),
    ],
)
def test_nifti(tmp_path, name, kind):
    nifti(tmp_path / name, kind=kind)
    path = tmp_path / name.replace(".img.gz", ".hdr.gz")
    field = ss.open(path)
    assert np.array_equal(field.values, VALUES) and field.values.dtype == np.int16
    assert field.spacing == (2, 3, 4) and field.quantity.length_unit == "mm"
    assert field.orientation.up == (0, 0, 1) and field.orientation.front == (0, 1, 0)


def test_nifti_axes_are_those_of_the_body(tmp_path):
    """Samples along the axes of the world in any order and direction: the same field."""
    expected = ss.open(nifti(tmp_path / "a.nii"))
    turned = VALUES.transpose(1, 2, 0)[:, ::-1]
    affine = np.zeros((4, 4))
    # The fastest axis of the file runs along z, the second from right to left, the slowest along y.
    affine[2, 0], affine[0, 1], affine[1, 2], affine[3, 3] = 4, -2, 3, 1
    affine[0, 3] = 2.0 * (VALUES.shape[2] - 1)
    assert ss.open(nifti(tmp_path / "b.nii", affine, turned)) == expected


def test_nifti_samples_are_scaled(tmp_path):
    path = nifti(tmp_path / "a.nii", scale=(0.5, -10))
    np.testing.assert_allclose(ss.open(path).values, VALUES * np.float32(0.5) - 10)


def test_nifti_that_cannot_be_read(tmp_path):
    several = np.stack([VALUES, VALUES])
    with pytest.raises(ss.InvalidInput, match="2 time steps; wanted one; pass step=0"):
        ss.open(nifti(tmp_path / "t.nii", values=several))
    assert np.array_equal(ss.open(tmp_path / "t.nii", step=1).values, VALUES)
    pair = nifti(tmp_path / "p.hdr", kind="Nifti1Pair")
    (tmp_path / "p.img").unlink()
    with pytest.raises(ss.InvalidInput, match="p.img cannot be read: found no such file"):
        ss.open(pair)


# ------------------------------------------------------------------------------------------------------------- DICOM


def item(**values):
    """Return an item of a sequence of DICOM."""
    made = needed("pydicom").dataset.Dataset()
    for name, value in values.items():
        setattr(made, name, value)
    return made


def dicom(folder, count=4, order=None, change=None, series="1.2.3", number=1, first=0, names=11):
    pydicom = needed("pydicom")
    from pydicom.dataset import FileDataset, FileMetaDataset
    from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian

    folder.mkdir(exist_ok=True)
    for z in order or range(count):
        meta = FileMetaDataset()
        meta.MediaStorageSOPClassUID = CTImageStorage
        meta.MediaStorageSOPInstanceUID = f"{series}.{z + 1}"
        meta.TransferSyntaxUID = ExplicitVRLittleEndian
        data = FileDataset(None, {}, file_meta=meta, preamble=b"\0" * 128)
        data.SOPClassUID, data.SOPInstanceUID = CTImageStorage, meta.MediaStorageSOPInstanceUID
        data.SeriesInstanceUID, data.SeriesNumber, data.SeriesDescription = series, number, f"head {number}"
        data.Modality = "CT"
        data.Rows, data.Columns, data.SamplesPerPixel = 5, 6, 1
        data.PhotometricInterpretation = "MONOCHROME2"
        data.BitsAllocated = data.BitsStored = 16
        data.HighBit, data.PixelRepresentation = 15, 1
        data.ImagePositionPatient = [10, 20, 30 + 2.5 * z]
        data.ImageOrientationPatient = [1, 0, 0, 0, 1, 0]
        data.PixelSpacing = [0.75, 0.5]
        data.RescaleSlope, data.RescaleIntercept = 1, -1024
        data.PixelData = VALUES[z % len(VALUES)].tobytes()
        if change is not None:
            change(data, z)
        data.InstanceNumber = first + z
        # Names do not tell the order.
        pydicom.dcmwrite(folder / f"im{series}{((first + z) * 7) % names}.dcm", data, enforce_file_format=True)
    return folder


def test_dicom_series(tmp_path):
    folder = dicom(tmp_path / "ct", order=[2, 0, 3, 1])
    field = ss.open(folder)
    assert np.array_equal(field.values, VALUES - 1024)
    assert field.spacing == (0.5, 0.75, 2.5) and field.origin == (10, 20, 30)
    assert field.quantity.label == "CT number [HU]" and field.quantity.length_unit == "mm"
    # Patients' axes run to the left, the back and the head: seen from the front.
    assert field.orientation.up == (0, 0, 1) and field.orientation.front == (0, -1, 0)
    assert ss.open(next(folder.iterdir())) == field
    assert ss.render(folder, size=16, backend="reference").rgba.shape == (16, 16, 4)


def test_dicom_missing_and_doubled_slices(tmp_path):
    with pytest.raises(ss.InvalidInput, match="2.5 apart, but 5 after .*at 30: 1 slices are missing"):
        ss.open(dicom(tmp_path / "gap", order=[3, 0, 2, 4]))
    folder = dicom(tmp_path / "twice", order=[0, 1, 2, 3])

    def same_place(data, _):
        data.ImagePositionPatient = [10, 20, 30]

    dicom(folder, order=[5], change=same_place)
    with pytest.raises(ss.InvalidInput, match="two slices at 30"):
        ss.open(folder)
    with pytest.raises(ss.InvalidInput, match="one slice"):
        ss.open(dicom(tmp_path / "one", order=[0]))


def test_dicom_series_are_chosen(tmp_path):
    folder = dicom(dicom(tmp_path / "two"), series="4.5.6", number=7)
    with pytest.raises(ss.InvalidInput, match=r"2 series: .*head 1, 4 files.*name="):
        ss.open(folder)
    field = ss.open(folder, name="7")
    assert field == ss.open(folder, name="head 7") == ss.open(folder, name="4.5.6")
    assert field == ss.open(folder / "im4.5.60.dcm")


def test_dicom_slices_that_do_not_fit(tmp_path):
    def turned(data, z):
        data.ImageOrientationPatient = [1, 0, 0, 0, 1, 0] if z else [0, 1, 0, 1, 0, 0]

    def wide(data, z):
        data.Columns = 6 if z else 10**4

    def no_place(data, z):
        del data.ImagePositionPatient

    def words(data, z):
        data.RescaleSlope = "1E400"

    for number, change in enumerate((turned, wide, no_place, words)):
        with pytest.raises(ss.InvalidInput):
            ss.open(dicom(tmp_path / str(number), change=change))


def frames(folder):
    """Write a series as the frames of one file."""

    def several(data, _):
        data.NumberOfFrames = 4
        data.PixelData = VALUES.tobytes()
        for name in ("ImagePositionPatient", "ImageOrientationPatient", "PixelSpacing"):
            delattr(data, name)
        plane = item(ImageOrientationPatient=[1, 0, 0, 0, 1, 0])
        measures = item(PixelSpacing=[0.75, 0.5])
        data.SharedFunctionalGroupsSequence = [item(PlaneOrientationSequence=[plane], PixelMeasuresSequence=[measures])]
        data.PerFrameFunctionalGroupsSequence = [
            item(PlanePositionSequence=[item(ImagePositionPatient=[10, 20, 30 + 2.5 * z])]) for z in range(4)
        ]

    return dicom(folder, order=[0], change=several)


def test_dicom_frames_of_one_file(tmp_path):
    field = ss.open(next(frames(tmp_path / "frames").iterdir()))
    assert np.array_equal(field.values, VALUES - 1024) and field.spacing == (0.5, 0.75, 2.5)


# -------------------------------------------------------------------------------------------------------------- TIFF


def tiff(path, values=VALUES, **options):
    needed("tifffile").imwrite(path, values, **{"photometric": "minisblack", **options})
    return path


@pytest.mark.parametrize(
    "options", [{}, {"compression": "zlib"}, {"byteorder": ">"}, {"tile": (16, 16)}, {"bigtiff": True}]
)
def test_tiff_stacks(tmp_path, options):
    field = ss.open(tiff(tmp_path / "a.tif", photometric="minisblack", **options))
    assert np.array_equal(field.values, VALUES) and field.spacing == (1, 1, 1)


def test_tiff_spacing(tmp_path):
    about = {"axes": "ZYX", "spacing": 1.5, "unit": "um"}
    field = ss.open(tiff(tmp_path / "a.tif", imagej=True, resolution=(4, 2), metadata=about))
    assert field.spacing == pytest.approx((0.25, 0.5, 1.5)) and field.quantity.length_unit in ("um", "µm")
    about = {"axes": "ZYX", "PhysicalSizeX": 0.5, "PhysicalSizeY": 0.25, "PhysicalSizeZ": 2}
    field = ss.open(tiff(tmp_path / "a.ome.tif", metadata=about))
    assert field.spacing == (0.5, 0.25, 2) and field.quantity.length_unit == "µm"


def test_tiff_folders_are_sorted_by_numbers(tmp_path):
    for number in range(12):
        tiff(tmp_path / f"s{number}.tif", VALUES[0] + number)
    assert np.array_equal(ss.open(tmp_path).values[:, 0, 0], VALUES[0, 0, 0] + np.arange(12))
    tiff(tmp_path / "s3.tif", VALUES[0, 1:])
    with pytest.raises(ss.InvalidInput, match="s3.tif with 1 pages"):
        ss.open(tmp_path)


def test_tiff_pages_that_do_not_fit(tmp_path):
    with needed("tifffile").TiffWriter(tmp_path / "a.tif") as writer:
        writer.write(VALUES[0])
        writer.write(VALUES[0, 1:])
    with pytest.raises(ss.InvalidInput, match="page 1"):
        ss.open(tmp_path / "a.tif")
    with pytest.raises(ss.InvalidInput, match="one page .* pass the folder"):
        ss.open(tiff(tmp_path / "b.tif", np.zeros((4, 5, 3), np.uint8), photometric="rgb"))
    with pytest.raises(ss.InvalidInput, match="one page .* pass the folder"):
        ss.open(tiff(tmp_path / "c.tif", VALUES[0]))
    (tmp_path / "series").mkdir()
    tiff(tmp_path / "series" / "a.tif", VALUES)
    with pytest.raises(ss.InvalidInput, match="a file is a slice of the volume; .* to sheetsplat.animate"):
        ss.open(tmp_path / "series")
    with pytest.raises(ss.InvalidInput, match="pass them as a list"):
        ss.animate(tmp_path / "series")
    with pytest.raises(ss.InvalidInput, match="2 channels: channel 0, channel 1; wanted one of them; pass name="):
        io.read_volume(tiff(tmp_path / "d.ome.tif", np.stack([VALUES, VALUES]), metadata={"axes": "CZYX"}))


def test_tiff_parts_are_counted(tmp_path):
    """Each part that is missing would be filled by itself: 1.7 million of them took ten seconds."""
    path = tiff(tmp_path / "a.tif", compression="zlib")
    data = bytearray(path.read_bytes())
    with needed("tifffile").TiffFile(path) as file:
        tags = file.pages.first.tags
        places = {name: tags[name].offset for name in ("ImageLength", "StripByteCounts", "StripOffsets")}
    # Another number instead of 279 leaves the sizes of the strips out.
    struct.pack_into("<H", data, places["StripByteCounts"], 60000)
    struct.pack_into("<HHII", data, places["ImageLength"], 257, 4, 1, 10**6)
    path.write_bytes(data)
    with pytest.raises(ss.InvalidInput, match="parts of page 0|stored bytes"):
        ss.open(path)


def test_tiff_bombs_end(tmp_path, monkeypatch):
    path = tiff(tmp_path / "a.tif", np.zeros((2, 64, 64), np.uint8), compression="zlib")
    data = path.read_bytes()
    page = needed("tifffile").TiffFile(path).pages[1]
    offset, count = page.dataoffsets[0], page.databytecounts[0]
    assert offset + count <= len(data)
    bomb = zlib.compress(bytes(1 << 20), 9)
    bomb += bytes(max(0, count - len(bomb)))
    # The second page's strip is now at the end of the file.
    entry = struct.pack("<I", offset)
    assert data.count(entry) >= 1
    data = data.replace(entry, struct.pack("<I", len(data))).replace(
        struct.pack("<HHII", 279, 3, 1, count), struct.pack("<HHII", 279, 4, 1, len(bomb))
    ).replace(struct.pack("<HHII", 279, 4, 1, count), struct.pack("<HHII", 279, 4, 1, len(bomb)))  # fmt: skip
    path.write_bytes(data + bomb)
    monkeypatch.setattr("sheetsplat._memory.available", lambda: 1 << 20)
    with pytest.raises(ss.InvalidInput, match="in a part of a page"):
        ss.open(path)


# --------------------------------------------------------------------------------------------------------------- MRC


def mrc(path, values=VALUES, **fields):
    with needed("mrcfile").new(path) as file:
        file.set_data(values)
        file.voxel_size = (1.5, 2, 2.5)
        for name, value in fields.items():
            file.header[name] = value
    return path


def test_mrc(tmp_path):
    field = ss.open(mrc(tmp_path / "a.mrc", nxstart=2))
    assert np.array_equal(field.values, VALUES) and field.spacing == pytest.approx((1.5, 2, 2.5))
    assert field.origin == pytest.approx((3, 0, 0)) and field.quantity.length_unit == "Å"
    (tmp_path / "a.mrc.gz").write_bytes(gzip.compress((tmp_path / "a.mrc").read_bytes()))
    assert ss.open(tmp_path / "a.mrc.gz") == field
    # Columns along z, rows along x, sections along y.
    turned = ss.open(mrc(tmp_path / "b.mrc", mapc=3, mapr=1, maps=2))
    assert np.array_equal(turned.values, VALUES.transpose(2, 0, 1))


@pytest.mark.parametrize(
    "fields", [{"nz": 10**9}, {"nx": -1}, {"mode": 4}, {"nsymbt": -5}, {"mapc": 7}, {"ispg": 401, "mz": 2}]
)
def test_mrc_that_lies(tmp_path, fields):
    with pytest.raises(ss.InvalidInput):
        ss.open(mrc(tmp_path / "a.mrc", **fields))


# ---------------------------------------------------------------------------------------------------- NetCDF, HDF5


def dataset():
    xr = needed("xarray")
    values = VALUES.astype(np.float32)
    places = {"lon": np.arange(6) * 2.0, "lat": np.arange(5.0)[::-1], "lev": np.arange(4.0) ** 2}
    return xr.Dataset({"t": (("lev", "lat", "lon"), values, {"units": "K", "long_name": "air"})}, coords=places)


@pytest.mark.parametrize("engine", ["scipy", "h5netcdf"])
def test_netcdf(tmp_path, engine):
    needed(engine)
    dataset().to_netcdf(tmp_path / "a.nc", engine=engine)
    with pytest.raises(ss.InvalidInput, match="uneven coordinates along lev.*resample=True"):
        ss.open(tmp_path / "a.nc")
    field = ss.open(tmp_path / "a.nc", resample=True)
    assert field == ss.open(dataset(), resample=True).opened_with({"resample": True})
    assert field.quantity.label == "air [K]"
    assert ss.open(f"{tmp_path}/a.nc:/t", resample=True) == field == ss.open(tmp_path / "a.nc", resample=True, name="t")
    (tmp_path / "b.nc.gz").write_bytes(gzip.compress((tmp_path / "a.nc").read_bytes()))
    assert ss.open(tmp_path / "b.nc.gz", resample=True) == field
    with pytest.raises(ss.InvalidInput, match="these variables.*: t"):
        ss.open(tmp_path / "a.nc", scalar="u")


def test_netcdf_does_not_follow_links(tmp_path):
    needed("h5netcdf"), needed("xarray")
    h5py = needed("h5py")
    dataset().to_netcdf(tmp_path / "secret.nc", engine="h5netcdf")
    with h5py.File(tmp_path / "a.nc", "w") as file:
        file["t"] = h5py.ExternalLink(str(tmp_path / "secret.nc"), "/t")
    with pytest.raises(ss.InvalidInput, match="a link to another file"):
        ss.open(tmp_path / "a.nc")


def volumes(path, **more):
    with needed("h5py").File(path, "w") as file:
        file["group/a"] = VALUES
        file["group/a"].attrs.update({"element_size_um": (3.0, 2.0, 1.0), "units": "counts"})
        file["table"] = np.arange(5)
        for name, values in more.items():
            file[name] = values
    return path


def test_hdf5_volumes(tmp_path):
    path = volumes(tmp_path / "a.h5")
    field = ss.open(path)
    assert np.array_equal(field.values, VALUES) and field.spacing == (1, 2, 3)
    assert (field.quantity.label, field.quantity.length_unit) == ("a [counts]", "µm")
    assert ss.open(f"{path}:/group/a") == field == ss.open(path, name="group/a") == ss.open(path, scalar="/group/a")
    path = volumes(tmp_path / "b.h5", b=VALUES[None, :, None] + 1)
    with pytest.raises(ss.InvalidInput, match=r"2 datasets.*/b \(1, 4, 1, 5, 6\).*b.h5:/b"):
        ss.open(path)
    assert np.array_equal(ss.open(f"{path}:/b").values, VALUES + 1)
    for wrong in ("/table", "/none", "/group", "/../a", "//"):
        with pytest.raises(ss.InvalidInput):
            ss.open(f"{path}:{wrong}")


def test_hdf5_links_and_sizes(tmp_path):
    h5py = needed("h5py")
    volumes(tmp_path / "secret.h5")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["a"] = VALUES
        file["away"] = h5py.ExternalLink("secret.h5", "/group/a")
        file["loop"] = file["/"]
        file.create_dataset("huge", (10**6,) * 3, np.float64, chunks=(9, 9, 9))
        file.create_dataset("outside", (4, 5, 6), np.uint8, external=[(str(tmp_path / "secret.h5"), 0, 120)])
    for name in ("away", "huge", "outside", "loop"):
        with pytest.raises(ss.InvalidInput):
            ss.open(tmp_path / "a.h5", name=name)
    assert np.array_equal(ss.open(tmp_path / "a.h5", name="a").values, VALUES)
    for there in ({}, {"a": VALUES}):
        with h5py.File(tmp_path / "b.h5", "w") as file:
            for name, values in there.items():
                file[name] = values
            file["away"] = h5py.ExternalLink("secret.h5", "/group/a")
        with pytest.raises(ss.InvalidInput, match="a link to another file at '/away'"):
            ss.open(tmp_path / "b.h5")
    assert np.array_equal(ss.open(tmp_path / "b.h5", name="a").values, VALUES)


def heaps(data):
    """Return the places of the objects in the heaps of an HDF5 file: their texts, and what is free in them."""
    found, start = [], -1
    while (start := data.find(b"GCOL\x01", start + 1)) >= 0:
        at, end = start + 16, start + int.from_bytes(data[start + 8 : start + 16], "little")
        while at + 16 <= end:
            found.append(at)
            size = int.from_bytes(data[at + 8 : at + 16], "little")
            at += 16 + -(-size // 8) * 8 if any(data[at : at + 2]) else size
    return found


@pytest.mark.parametrize(
    ("number", "size"), [(0, 0), (0, 8), (0, 2**64 - 16), (0, 1 << 20), (1, 2**64 - 16), (1, 2**64 - 1), (1, 1 << 20)]
)
def test_hdf5_heaps_that_lead_back_are_refused(tmp_path, number, size):
    """The library goes from object to object by their sizes, for ever where one leads back; no signal ends it."""
    whole = volumes(tmp_path / "a.h5").read_bytes()
    places = heaps(whole)
    assert len(places) == 2
    for at in places:
        data = bytearray(whole)
        data[at : at + 2] = number.to_bytes(2, "little")
        data[at + 8 : at + 16] = size.to_bytes(8, "little")
        for name, content in (("b.h5", bytes(data)), ("b.h5.gz", gzip.compress(data))):
            (tmp_path / name).write_bytes(content)
            with pytest.raises(ss.InvalidInput, match="in a heap"):
                ss.open(tmp_path / name)


def test_parts_of_files_that_are_wholes(tmp_path):
    np.save(tmp_path / "a.npy", VALUES)
    with pytest.raises(ss.InvalidInput, match="the part cannot be read"):
        ss.open(f"{tmp_path}/a.npy:/x")


# -------------------------------------------------------------------------------------------------------------- Zarr


def zarr_array(path, version=2, values=VALUES, **options):
    needed("zarr").create_array(store=str(path), data=values, chunks=(2, 3, 3), zarr_format=version, **options)
    return path


def picture(path, version, channels=("DAPI", "GFP")):
    group = needed("zarr").create_group(str(path), zarr_format=version)
    stack = np.stack([VALUES + at for at in range(len(channels))])
    for level in range(2):
        thin = stack[:, :, :: 1 + level, :: 1 + level]
        group.create_array(str(level), data=thin, chunks=(1, 2, 3, 3))
    axes = [{"name": "c", "type": "channel"}, *({"name": one, "unit": "micrometer"} for one in "zyx")]
    scales = [[1, 2, 0.5 * (1 + level), 0.5 * (1 + level)] for level in range(2)]
    sets = [
        {"path": str(at), "coordinateTransformations": [{"type": "scale", "scale": one}]}
        for at, one in enumerate(scales)
    ]
    told = {
        "multiscales": [{"axes": axes, "datasets": sets}],
        "omero": {"channels": [{"label": name} for name in channels]},
    }
    group.attrs.update(told if version == 2 else {"ome": {"version": "0.5", **told}})
    return path


@pytest.mark.parametrize("version", [2, 3])
def test_time_steps_of_ome_zarr(tmp_path, version):
    path = tmp_path / "a.zarr"
    group = needed("zarr").create_group(str(path), zarr_format=version)
    stack = np.stack([VALUES, VALUES + 1, VALUES + 2])
    group.create_array("0", data=stack, chunks=(1, 2, 3, 3))
    axes = [{"name": "t", "type": "time"}, *({"name": one} for one in "zyx")]
    scale = [{"type": "scale", "scale": [1.0, 1.0, 1.0, 1.0]}]
    told = {"multiscales": [{"axes": axes, "datasets": [{"path": "0", "coordinateTransformations": scale}]}]}
    group.attrs.update(told if version == 2 else {"ome": {"version": "0.5", **told}})
    for step in range(3):
        assert np.array_equal(ss.open(path, step=step).values, stack[step])
    assert len(ss.animate(path, size=16, backend="reference")) == 3
    for options, text in (
        ({}, "3 time steps; wanted one; pass step=0"),
        ({"step": 3}, "no step 3 of 3"),
        ({"step": "1"}, "wanted a whole number"),
    ):
        with pytest.raises(ss.InvalidInput, match=text):
            ss.open(path, **options)
    # The first of four dimensions without names is that of time.
    assert np.array_equal(ss.open(f"{path}:/0", step=2).values, stack[2])
    with pytest.raises(ss.InvalidInput, match="step for an array"):
        ss.open(zarr_array(tmp_path / "b.zarr", version), step=0)


@pytest.mark.parametrize("version", [2, 3])
def test_zarr(tmp_path, version):
    path = zarr_array(tmp_path / "a.zarr", version)
    assert np.array_equal(ss.open(path).values, VALUES)
    zarr_array(tmp_path / "g" / "b", version, VALUES + 1)
    needed("zarr").create_group(str(tmp_path / "g"), zarr_format=version)
    field = ss.open(tmp_path / "g")
    assert np.array_equal(field.values, VALUES + 1) and field.quantity.name == "b"
    assert ss.open(f"{tmp_path}/g:/b") == field == ss.open(tmp_path / "g", name="b")
    for wrong in ("/c", "/../a.zarr", "/b/..", "//"):
        with pytest.raises(ss.Error):
            ss.open(f"{tmp_path}/g:{wrong}")


@pytest.mark.parametrize("version", [2, 3])
def test_ome_zarr(tmp_path, version, monkeypatch):
    path = picture(tmp_path / "a.zarr", version)
    with pytest.raises(ss.InvalidInput, match="2 channels: DAPI, GFP"):
        io.read_volume(path)
    field = ss.open(path, name="GFP")
    assert np.array_equal(field.values, VALUES + 1) and field.spacing == (0.5, 0.5, 2)
    assert field.quantity.length_unit == "µm" and ss.open(path, name="1") == field
    monkeypatch.setattr("sheetsplat._memory.available", lambda: 5 * VALUES.nbytes - 5)
    volume = io.read_volume(picture(tmp_path / "one.zarr", version, ("only",)))
    assert volume.spacing == (1, 1, 2) and np.array_equal(volume.values, VALUES[:, ::2, ::2])


def test_zarr_runs_no_code_and_opens_nothing_else(tmp_path):
    path = zarr_array(tmp_path / "a.zarr")
    told = json.loads((path / ".zarray").read_text())
    chunk = next(one for one in path.rglob("*") if one.is_file() and not one.name.startswith(".z"))
    for change in (
        {"filters": [{"id": "pickle"}]},
        {"compressor": {"id": "bz2", "level": 1}},
        {"dtype": "|O"},
        {"dtype": "<U4"},
        {"shape": [10**6] * 3, "chunks": [10**6] * 3},
        {"shape": [10**18, 1, 1]},
        {"chunks": [0, 1, 1]},
        {"shape": "abc"},
    ):
        (path / ".zarray").write_text(json.dumps({**told, **change}))
        with pytest.raises(ss.Error):
            ss.open(path)
    (path / ".zarray").write_text(json.dumps(told))
    data = chunk.read_bytes()
    chunk.write_bytes(data + bytes(1 << 20))
    with pytest.raises(ss.InvalidInput, match="a chunk of"):
        ss.open(path)
    chunk.unlink()
    os.symlink("/etc/hostname", chunk)
    with pytest.raises(ss.InvalidInput, match="a link"):
        ss.open(path)


@pytest.mark.parametrize("codec", ["blosc", "lz4", "zstd", "zlib"])
def test_zarr_bombs_end(tmp_path, codec, monkeypatch):
    codecs = needed("numcodecs")
    made = {"blosc": codecs.Blosc, "lz4": codecs.LZ4, "zstd": codecs.Zstd, "zlib": codecs.Zlib}[codec]()
    path = zarr_array(tmp_path / "a.zarr", compressors=made)
    assert np.array_equal(ss.open(path).values, VALUES)
    chunk = next(one for one in path.rglob("*") if one.is_file() and not one.name.startswith(".z"))
    chunk.write_bytes(made.encode(bytes(1 << 16)))
    monkeypatch.setattr("sheetsplat._memory.available", lambda: 1 << 16)
    with pytest.raises(ss.InvalidInput, match="unpacks to"):
        ss.open(path)


# ----------------------------------------------------------------------------------------------------- missing packages


def test_missing_packages_are_named(tmp_path, monkeypatch):
    path = nifti(tmp_path / "a.nii")
    monkeypatch.setitem(sys.modules, "nibabel", None)
    with pytest.raises(ss.Unsupported, match=r"no package nibabel.*pip install 'sheetsplat\[medical\]'"):
        ss.open(path)


# ------------------------------------------------------------------------------------------ readers of other packages


@pytest.fixture
def readers(tmp_path, monkeypatch):
    """A package with an entry point, as pip would install it."""
    site = tmp_path / "site"
    (site / "dots_reader").mkdir(parents=True)
    (site / "dots_reader" / "__init__.py").write_text(
        "import numpy as np\n"
        "from sheetsplat.io import Format, Volume\n"
        "\n"
        "DOTS = Format('dots', 'dots_reader:read', lambda source: source.head(4) == b'DOTS', ('name',), shown='dots')\n"
        "\n"
        "def read(source, name=None):\n"
        "    source.stream.seek(4)\n"
        "    values = source.payload('raw').array(np.dtype('uint8'), 8).reshape(2, 2, 2)\n"
        "    return Volume(values, (1, 2, 3), format='dots', details={'content': name or ''})\n"
    )
    about = site / "dots_reader-1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: dots-reader\nVersion: 1\n")
    points = "dots = dots_reader:DOTS\nbroken = dots_reader:NONE\nother = dots_reader:read\n"
    (about / "entry_points.txt").write_text(f"[{formats.ENTRY_POINTS}]\n{points}")
    monkeypatch.syspath_prepend(str(site))
    importlib.invalidate_caches()
    formats.of_others.cache_clear()
    yield
    formats.of_others.cache_clear()


def test_readers_of_other_packages(readers, tmp_path, caplog):
    (tmp_path / "a.dots").write_bytes(b"DOTS" + bytes(range(8)))
    with caplog.at_level(logging.WARNING, "sheetsplat"):
        field = ss.open(tmp_path / "a.dots", name="n")
    assert field.values.ravel().tolist() == list(range(8)) and field.spacing == (1, 2, 3)
    texts = [record.getMessage() for record in caplog.records]
    assert any("dots_reader:NONE cannot be loaded" in text for text in texts)
    assert any("dots_reader:read is a function" in text for text in texts)
    (tmp_path / "a.dots").write_bytes(b"DOTS" + bytes(3))
    with pytest.raises(ss.InvalidInput, match="3 bytes of samples"):
        ss.open(tmp_path / "a.dots")
    with pytest.raises(ss.InvalidInput, match="found fit for a regular volume"):
        ss.open(tmp_path / "a.dots", fit="nearest")
