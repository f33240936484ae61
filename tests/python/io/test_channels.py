"""Several channels, colours and labels that files state: values, names and colours, and pictures of them."""

from __future__ import annotations

import numpy as np
import pytest
from test_data_formats import dicom, item, needed, nifti, tiff

import sheetsplat as ss
from sheetsplat import io

RANDOM = np.random.default_rng(20)
# Two channels; colours; labels with a number that is left out.
STACK = RANDOM.integers(0, 1000, (2, 8, 9, 10)).astype(np.uint16)
COLORS = RANDOM.integers(0, 255, (8, 9, 10, 4)).astype(np.uint8)
LABELS = np.repeat(np.repeat(RANDOM.choice([0, 1, 2, 5], (4, 5, 5)), 2, axis=0), 2, axis=2).astype(np.uint8)
RED, GREEN, BLUE = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.4, 1.0)


def nrrd(path, values, **fields):
    needed("nrrd").write(str(path), values.T, {"encoding": "raw", **fields})
    return path


def metaimage(path, values, channels, kind):
    sizes = " ".join(map(str, values.shape[2::-1]))
    fields = {"NDims": 3, "DimSize": sizes, "ElementNumberOfChannels": channels, "ElementType": kind}
    lines = [f"{name} = {one}\n" for name, one in {"ObjectType": "Image", **fields, "ElementDataFile": "LOCAL"}.items()]
    path.write_bytes("".join(lines).encode() + values.tobytes())
    return path


def ome_zarr(path, values, axes, **told):
    group = needed("zarr").create_group(str(path), zarr_format=2)
    group.create_array("0", data=values, chunks=values.shape)
    scale = [{"type": "scale", "scale": [1.0] * values.ndim}]
    sets = [{"path": "0", "coordinateTransformations": scale}]
    group.attrs.update({"multiscales": [{"axes": [{"name": one} for one in axes], "datasets": sets}], **told})
    return path


def channels_of_ome_tiff(path, colors=(0xFF8000FF - 2**32, 0x0080FFFF), values=STACK):
    about = {"axes": "CZYX", "Channel": {"Name": ["DAPI", "GFP"], "Color": list(colors)}}
    return tiff(path, values, metadata=about)


def channels_of_imagej(path):
    tables = [np.outer(one, np.arange(256)).astype(np.uint8) for one in ((1, 0, 1), (0, 1, 0))]
    about = {"axes": "ZCYX", "LUTs": tables, "Ranges": (0.0, 500.0, 10.0, 900.0), "mode": "composite"}
    return tiff(path, STACK.swapaxes(0, 1), imagej=True, metadata=about)


def channels_of_ome_zarr(path):
    window = {"start": 5, "end": 800, "min": 0, "max": 1000}
    stated = [{"label": "DAPI", "color": "FF8000", "window": window}, {"label": "GFP", "color": "nothing"}]
    return ome_zarr(path, STACK, "czyx", omero={"channels": stated})


def interleaved(path):
    values = np.ascontiguousarray(np.moveaxis(STACK, 0, 3))
    return metaimage(path, values, 2, "MET_USHORT")


def npy(path, values):
    np.save(path, values)
    return path


ORANGE, SKY = (1.0, 128 / 255, 0.0), (0.0, 128 / 255, 1.0)
NUMBERED = [("channel 0", RED, None), ("channel 1", GREEN, None)]
FILES = {
    "a.ome.tif": (channels_of_ome_tiff, [("DAPI", ORANGE, None), ("GFP", SKY, None)]),
    "a.tif": (
        channels_of_imagej,
        [("channel 0", (1.0, 0.0, 1.0), (0, 500)), ("channel 1", GREEN, (10, 900))],
    ),
    "samples.tif": (lambda path: tiff(path, np.moveaxis(STACK, 0, 3), planarconfig="contig"), NUMBERED),
    "planes.tif": (lambda path: tiff(path, STACK.swapaxes(0, 1), planarconfig="separate"), NUMBERED),
    "a.zarr": (channels_of_ome_zarr, [("DAPI", ORANGE, (5, 800)), ("GFP", RED, None)]),
    "first.nrrd": (lambda path: nrrd(path, np.moveaxis(STACK, 0, 3), kinds=["vector", *["domain"] * 3]), NUMBERED),
    "last.nrrd": (lambda path: nrrd(path, STACK, kinds=[*["domain"] * 3, "list"]), NUMBERED),
    "a.mha": (interleaved, NUMBERED),
    "first.npy": (lambda path: npy(path, STACK), NUMBERED),
    "last.npy": (lambda path: npy(path, np.moveaxis(STACK, 0, 3)), NUMBERED),
    "a.nii": (lambda path: nifti(path, values=STACK[:, None]), NUMBERED),
}


@pytest.mark.parametrize("name", FILES)
def test_all_channels_are_opened(tmp_path, name):
    write, told = FILES[name]
    path = write(tmp_path / name)
    fields = ss.open(path)
    assert [one.name for one in fields] == [one for one, _, _ in told]
    for number, (field, (label, color, window)) in enumerate(zip(fields, told, strict=True)):
        np.testing.assert_array_equal(field.values, STACK[number])
        assert field.color == pytest.approx(color) and field.window == window
        for chosen in (label, str(number)):
            assert ss.open(path, name=chosen) == field
        assert field.opened["name"] == label and not field.labels
    with pytest.raises(
        ss.InvalidInput, match=rf"2 channels: {told[0][0]}, {told[1][0]}; wanted one of them; pass name="
    ):
        io.read_volume(path)
    with pytest.raises(ss.InvalidInput, match="2 channels: .*; wanted one of them; pass name="):
        ss.open(path, name="RFP")


def test_colors_of_channels(tmp_path):
    same = channels_of_ome_tiff(tmp_path / "a.ome.tif", colors=(-1, -1))
    assert [one.color for one in ss.open(same)] == [RED, GREEN]
    black = channels_of_ome_tiff(tmp_path / "b.ome.tif", colors=(255, 0xFF0000FF - 2**32))
    assert [one.color for one in ss.open(black)] == [GREEN, RED]
    many = ss.open(tiff(tmp_path / "c.ome.tif", np.stack([STACK[0]] * 12), metadata={"axes": "CZYX"}))
    assert len({one.color for one in many}) == 12
    far_more = tiff(tmp_path / "d.ome.tif", np.stack([STACK[0, :2]] * 65), metadata={"axes": "CZYX"})
    with pytest.raises(ss.InvalidInput, match="65 channels: channel 0, .* and 5 more; wanted one of them"):
        ss.open(far_more)
    assert ss.open(far_more, name="64").name == "channel 64"
    alike = {"axes": "CZYX", "Channel": {"Name": ["GFP", "GFP"]}}
    path = tiff(tmp_path / "e.ome.tif", STACK, metadata=alike)
    assert [one.name for one in ss.open(path)] == ["GFP 0", "GFP 1"] and ss.open(path, name="GFP 1").values[
        0, 0, 0
    ] == (STACK[1, 0, 0, 0])


def test_what_is_no_channel(tmp_path):
    for shape in ((3, 9, 10, 3), (9, 9, 10, 11), (2, 5, 9, 10)):
        with pytest.raises(ss.InvalidInput, match="4 axes"):
            ss.open(npy(tmp_path / "a.npy", np.zeros(shape, np.float32)))
    for kinds in (None, ["time", *["domain"] * 3], ["vector", "list", "domain", "domain"]):
        fields = {} if kinds is None else {"kinds": kinds}
        with pytest.raises(ss.InvalidInput, match="4 axes"):
            ss.open(nrrd(tmp_path / "a.nrrd", np.moveaxis(STACK, 0, 3), **fields))
    for wrong in (0, -3, "x", 10**30):
        path = metaimage(tmp_path / "a.mha", STACK[0], wrong, "MET_USHORT")
        with pytest.raises(ss.InvalidInput, match="ElementNumberOfChannels"):
            ss.open(path)
    with pytest.raises(ss.Unsupported, match="weights for 2 fields; wanted one field"):
        ss.open(npy(tmp_path / "b.npy", STACK), weight=STACK[0])
    with pytest.raises(ss.InvalidInput, match="2 channels, .* of volumes in bricks|2 channels"):
        ss.open_bricks(interleaved(tmp_path / "b.mha"), brick=8)


def test_channels_of_other_sizes_or_types(tmp_path):
    tifffile = needed("tifffile")
    for number, other in enumerate((STACK[1, 0, 1:], STACK[1, 0].astype(np.uint8))):
        path = tmp_path / f"{number}.tif"
        with tifffile.TiffWriter(path) as writer:
            for page in (*STACK[0], other):
                writer.write(page, photometric="minisblack")
        with pytest.raises(ss.InvalidInput, match="page 8 .*as page 0 has"):
            ss.open(path)
    with tifffile.TiffWriter(tmp_path / "a.tif") as writer:
        writer.write(COLORS[0, ..., :3], photometric="rgb")
        writer.write(COLORS[1], photometric="rgb")
    with pytest.raises(ss.InvalidInput, match="page 1 .*as page 0 has"):
        ss.open(tmp_path / "a.tif")


# ------------------------------------------------------------------------------------------------------------ colours


def nifti_of_colors(path, values):
    names = "RGBA"[: values.shape[3]]
    kind = np.dtype([(one, "u1") for one in names])
    return nifti(path, values=np.ascontiguousarray(values).view(kind)[..., 0])


RGB = np.ascontiguousarray(COLORS[..., :3])
COLORED = {
    "rgb.tif": (lambda path: tiff(path, RGB, photometric="rgb"), RGB),
    "rgba.tif": (lambda path: tiff(path, COLORS, photometric="rgb", extrasamples=["unassalpha"]), COLORS),
    "deep.tif": (lambda path: tiff(path, RGB.astype(np.uint16) * 256, photometric="rgb"), RGB.astype(np.uint16) * 256),
    "planes.tif": (
        lambda path: tiff(path, np.moveaxis(RGB, 3, 1), photometric="rgb", planarconfig="separate"),
        RGB,
    ),
    "a.ome.tif": (lambda path: tiff(path, RGB, photometric="rgb", metadata={"axes": "ZYXS"}), RGB),
    "rgb.nrrd": (lambda path: nrrd(path, RGB, kinds=["RGB-color", *["domain"] * 3]), RGB),
    "rgba.nrrd": (lambda path: nrrd(path, COLORS, kinds=["RGBA-color", *["domain"] * 3]), COLORS),
    "rgb.nii": (lambda path: nifti_of_colors(path, RGB), RGB),
    "rgba.nii.gz": (lambda path: nifti_of_colors(path, COLORS), COLORS),
    "rgb.npy": (lambda path: npy(path, RGB), RGB),
}


@pytest.mark.parametrize("name", COLORED)
def test_volumes_of_colors(tmp_path, name):
    write, values = COLORED[name]
    field = ss.open(write(tmp_path / name))
    expected = ss.RegularField(values)
    assert field.colored and field.shape == values.shape[:3]
    np.testing.assert_array_equal(field.values, expected.values)
    for channel in range(3):
        np.testing.assert_array_equal(
            field.part_of_color(channel).given_values, expected.part_of_color(channel).given_values
        )


def test_colors_that_are_multiplied_by_opacity(tmp_path):
    values = COLORS.copy()
    values[..., 3] = np.maximum(values[..., 3], 100)
    shares = values[..., 3:] / 255
    multiplied = np.concatenate([np.rint(values[..., :3] * shares).astype(np.uint8), values[..., 3:]], axis=3)
    field = ss.open(tiff(tmp_path / "a.tif", multiplied, photometric="rgb", extrasamples=["assocalpha"]))
    for channel in range(3):
        found = field.part_of_color(channel).given_values.astype(int)
        assert np.abs(found - values[..., channel]).max() <= 2


def test_places_of_colors(tmp_path):
    turned = np.array([[0, -2.0, 0, 1], [3.0, 0, 0, 2], [0, 0, 4.0, 3], [0, 0, 0, 1]])
    field = ss.open(nifti_of_colors(tmp_path / "a.nii", RGB))
    assert field.spacing == (2, 3, 4)
    image = needed("nibabel").load(tmp_path / "a.nii")
    image.set_sform(turned)
    needed("nibabel").save(image, tmp_path / "b.nii")
    found = ss.open(tmp_path / "b.nii")
    upright = ss.RegularField(np.flip(RGB.swapaxes(1, 2), 2))
    np.testing.assert_array_equal(found.values, upright.values)
    np.testing.assert_array_equal(found.part_of_color(0).given_values, upright.part_of_color(0).given_values)
    spaced = nrrd(tmp_path / "a.nrrd", RGB, kinds=["RGB-color", *["domain"] * 3], spacings=[np.nan, 2.0, 3.0, 4.0])
    assert ss.open(spaced).spacing == (2, 3, 4)
    directions = [[np.nan] * 3, [2.0, 0, 0], [0, 3.0, 0], [0, 0, 4.0]]
    fields = {"space directions": directions, "space origin": [1, 2, 3], "space": "left-posterior-superior"}
    placed = ss.open(nrrd(tmp_path / "b.nrrd", RGB, kinds=["RGB-color", *["domain"] * 3], **fields))
    assert placed.spacing == (2, 3, 4) and placed.origin == (1, 2, 3) and placed.colored


def test_folders_of_colored_slices(tmp_path):
    for number, page in enumerate(RGB):
        tiff(tmp_path / f"s{number}.tif", page, photometric="rgb")
    np.testing.assert_array_equal(ss.open(tmp_path).values, ss.RegularField(RGB).values)
    tiff(tmp_path / "s3.tif", RGB[0, ..., 0])
    with pytest.raises(ss.InvalidInput, match="s3.tif with 1 pages"):
        ss.open(tmp_path)


def test_colors_have_no_logarithm(tmp_path):
    with pytest.raises(ss.InvalidInput, match="decades.*colours.*log"):
        ss.open(tiff(tmp_path / "a.tif", RGB, photometric="rgb"), log=True)


# ------------------------------------------------------------------------------------------------------------- labels


def segmentation(path, values=LABELS, layers=1, **fields):
    told = {}
    for number, (label, name, color) in enumerate(((1, "liver", "1 0 0"), (5, "lung", "0 0.5 1"))):
        layer = min(number, layers - 1)
        about = {"LabelValue": label, "Name": name, "Color": color, "Layer": layer}
        told |= {f"Segment{number}_{key}": str(one) for key, one in about.items()}
    return nrrd(path, values, **told, **fields)


def label_image(path, values=LABELS, **changes):
    colors = [{"label-value": 1, "rgba": [255, 0, 0, 255]}, {"label-value": 5, "rgba": [0, 51, 255, 102]}]
    stated = {"colors": colors, "properties": [{"label-value": 1, "name": "liver"}], **changes}
    return ome_zarr(path, values, "zyx", **{"image-label": stated})


def test_labels_of_nifti(tmp_path):
    two = (LABELS == 1).astype(np.uint8)
    path = nifti(tmp_path / "a.nii", values=two, intent_code=1002)
    field = ss.open(path)
    assert field.labels and field.label_colors is None and field.labels_found == (0, 1)
    assert not ss.open(path, labels=False).labels and not ss.open(nifti(tmp_path / "b.nii", values=two)).labels
    with pytest.warns(ss.PictureWarning, match="states labels, but has numbers that are not whole"):
        assert not ss.open(nifti(tmp_path / "c.nii", values=two + np.float32(0.5), intent_code=1002)).labels


def test_labels_of_slicer(tmp_path):
    path = segmentation(tmp_path / "a.seg.nrrd")
    field = ss.open(path)
    assert field.labels and field.label_colors == ss.LabelColors({1: RED, 5: (0, 0.5, 1)}, {1: "liver", 5: "lung"})
    plain = ss.open(path, labels=False)
    assert not plain.labels and plain.label_colors is None
    layered = segmentation(
        tmp_path / "b.seg.nrrd", np.stack([LABELS, LABELS], axis=3), 2, kinds=["list", *["domain"] * 3]
    )
    first, second = ss.open(layered)
    assert dict(first.label_colors.names) == {1: "liver"} and dict(second.label_colors.names) == {5: "lung"}
    assert second == ss.open(layered, name="1") and first.color is None
    for key, wrong in (("LabelValue", "x"), ("Layer", "-1"), ("Color", "1 0")):
        bad = nrrd(tmp_path / "c.nrrd", LABELS, **{"Segment0_LabelValue": "1", f"Segment0_{key}": wrong})
        with pytest.raises(ss.InvalidInput, match=f"Segment0_{key}"):
            ss.open(bad)


def test_labels_of_ome_zarr(tmp_path):
    field = ss.open(label_image(tmp_path / "a.zarr"))
    assert field.labels and dict(field.label_colors.names) == {1: "liver"}
    assert field.label_colors.colors[5] == pytest.approx((0, 0.2, 1, 0.4)) and field.labels_found == (0, 1, 2, 5)
    wrong = [None, {"label-value": "x"}, {"label-value": 1, "rgba": [256, 0, 0]}, {"label-value": 2, "rgba": "red"}]
    assert ss.open(label_image(tmp_path / "b.zarr", colors=wrong, properties=3)).label_colors is None
    many = [{"label-value": one, "rgba": [1, 2, 3, 255]} for one in range(1, 5001)]
    with pytest.warns(ss.PictureWarning, match="colours of 5000 labels are not used"):
        field = ss.open(label_image(tmp_path / "c.zarr", colors=many))
    assert field.labels and field.label_colors is None


def dicom_segments(folder, kind="BINARY", order=((1, 0), (1, 1), (2, 1), (2, 3)), **changes):
    """Write a segmentation of two segments on four planes, the third of which has no frame."""
    masks = RANDOM.integers(0, 2, (len(order), 8, 8)).astype(np.uint8)

    def segmented(data, _):
        data.SOPClassUID = data.file_meta.MediaStorageSOPClassUID = "1.2.840.10008.5.1.4.1.1.66.4"
        data.Modality, data.SegmentationType, data.NumberOfFrames = "SEG", kind, len(order)
        data.Rows = data.Columns = 8
        data.BitsAllocated = data.BitsStored = 1
        data.HighBit = data.PixelRepresentation = 0
        if kind == "FRACTIONAL":
            data.BitsAllocated = data.BitsStored = 8
            data.HighBit, data.MaximumFractionalValue = 7, 200
        data.PixelData = (
            (masks * 150).tobytes() if kind == "FRACTIONAL" else np.packbits(masks.ravel(), bitorder="little").tobytes()
        )
        for name in (
            "ImagePositionPatient",
            "ImageOrientationPatient",
            "PixelSpacing",
            "RescaleSlope",
            "RescaleIntercept",
        ):
            delattr(data, name)
        plane = item(ImageOrientationPatient=[1, 0, 0, 0, 1, 0])
        measures = item(PixelSpacing=[0.75, 0.5])
        data.SharedFunctionalGroupsSequence = [item(PlaneOrientationSequence=[plane], PixelMeasuresSequence=[measures])]
        data.PerFrameFunctionalGroupsSequence = [
            item(
                PlanePositionSequence=[item(ImagePositionPatient=[10, 20, 30 + 2.5 * at])],
                SegmentIdentificationSequence=[item(ReferencedSegmentNumber=number)],
            )
            for number, at in order
        ]
        data.SegmentSequence = [
            item(SegmentNumber=1, SegmentLabel="liver", RecommendedDisplayCIELabValue=[65535, 32896, 32896]),
            item(SegmentNumber=2, SegmentLabel="lung", RecommendedDisplayCIELabValue=[34890, 53480, 50167]),
        ]
        for name, value in changes.items():
            setattr(data, name, value)

    return next(dicom(folder, order=[0], change=segmented).iterdir()), masks.astype(bool)


@pytest.mark.parametrize("kind", ["BINARY", "FRACTIONAL"])
def test_segmentations_of_dicom(tmp_path, kind):
    path, masks = dicom_segments(tmp_path / "a", kind)
    expected = np.zeros((4, 8, 8), np.uint16)
    with pytest.warns(ss.PictureWarning, match="segments overlap"):
        field = ss.open(path)
    for mask, (number, at) in zip(masks, ((1, 0), (1, 1), (2, 1), (2, 3)), strict=True):
        expected[at][mask] = number
    np.testing.assert_array_equal(field.values, expected)
    assert field.labels and field.spacing == (0.5, 0.75, 2.5) and field.origin == (10, 20, 30)
    assert dict(field.label_colors.names) == {1: "liver", 2: "lung"}
    assert field.label_colors.colors[1] == pytest.approx((1, 1, 1, 1), abs=0.01)
    assert field.label_colors.colors[2] == pytest.approx((1, 0, 0, 1), abs=0.01)


def test_segmentations_of_dicom_that_lie(tmp_path):
    for number, (options, text) in enumerate(
        (
            ({"order": ((1, 0), (2, 0))}, "one slice"),
            ({"order": ((1, 0), (1, 1), (2, 2.4))}, "others between them"),
            ({"order": ((0, 0), (1, 1))}, "frame 0 without the number of its segment"),
            ({"NumberOfFrames": 9}, "9 frames with 4 groups"),
        )
    ):
        path, _ = dicom_segments(tmp_path / str(number), **options)
        with pytest.raises(ss.InvalidInput, match=text):
            ss.open(path)


def test_thousands_of_labels(tmp_path):
    values = np.arange(4000, dtype=np.uint16).reshape(10, 20, 20)
    path = label_image(tmp_path / "a.zarr", values)
    assert ss.open(path).labels
    with pytest.raises(ss.InvalidInput, match="4000 labels; wanted at most 256; .*labels=False"):
        ss.render(path, size=16)
    assert ss.render(path, labels=False, size=16).rgba.any()


# ----------------------------------------------------------------------------------------------------------- pictures


def test_pictures_of_labels_have_the_stated_colors(tmp_path):
    made = ss.api.prepare(segmentation(tmp_path / "a.seg.nrrd"), size=16)
    (colors,) = made.scene.transfer_functions
    # Label 2, of which the file says nothing, has a colour of its own.
    assert colors.colors[1] == (*RED, 1.0) and colors.colors[5] == (0, 0.5, 1, 1) and 2 in colors.colors
    assert colors.names[5] == "lung" and 0 not in colors.colors


def blobs():
    """Return two channels with a ball each, left and right."""
    k, j, i = np.indices((16, 16, 24))
    balls = [100.0 * np.exp(-((i - at) ** 2 + (j - 8) ** 2 + (k - 8) ** 2) / 8.0) for at in (6, 17)]
    return np.stack(balls).astype(np.uint8)


def test_channels_are_groups_of_their_own(tmp_path):
    path = channels_of_ome_tiff(tmp_path / "a.ome.tif", (0xFF0000FF - 2**32, 0x00FF00FF), blobs())
    options = {"size": (48, 32), "backend": "reference", "azimuth": -90, "elevation": 0}
    fields = ss.open(path)
    made = ss.api.prepare(path, **options)
    assert [len(one) for one in made.scene.groups] == [1, 1]
    image = ss.render(path, **options)
    np.testing.assert_array_equal(ss.render(fields, **options).rgba, image.rgba)
    left, right = image.rgba[:, :24].sum(axis=(0, 1)), image.rgba[:, 24:].sum(axis=(0, 1))
    assert left[0] > 10 * left[1:3].max() and right[1] > 10 * right[[0, 2]].max()
    # A colormap is that of the sum, limits are those of each.
    assert len(ss.api.prepare(path, cmap="gray", **options).scene.groups) == 1
    for function in ss.api.prepare(fields, clim=(10, 20), **options).scene.transfer_functions:
        assert function.points[0, 0] == 10 and function.points[-1, 0] == 20
    windowed = [one.with_color(one.color, (3, 50)) for one in fields]
    assert ss.api.prepare(windowed, **options).scene.transfer_functions[0].points[-1, 0] == 50
    beside = ss.api.prepare([*fields, ss.RegularField(blobs()[0])], **options).scene
    assert [len(one) for one in beside.groups] == [1, 1, 1]
    surfaces = ss.render(path, mode="isosurface", iso_value=40, **options)
    assert surfaces.rgba[:, :24, 0].max() > 0.5 > surfaces.rgba[:, :24, 1].max()


def test_maxima_of_channels_are_added_as_light(tmp_path):
    path = channels_of_ome_tiff(tmp_path / "a.ome.tif", (0xFF0000FF - 2**32, 0xFF00FFFF - 2**32), blobs())
    options = {"size": (48, 32), "backend": "reference", "mode": "mip", "camera": ss.api.prepare(path).camera}
    fields = [one.with_color(one.color, (10, 90)) for one in ss.open(path)]
    image = ss.render(fields, **options)
    expected = np.zeros((32, 48, 3))
    for field in fields:
        alone = ss.render(field, **options)
        assert alone.is_scalar
        expected += np.outer(np.clip((np.nan_to_num(alone.scalar) - 10) / 80, 0, 1), field.color).reshape(32, 48, 3)
    # Slices are as far apart as those of all channels.
    np.testing.assert_allclose(image.rgba[..., :3], np.minimum(expected, 1), atol=0.02)
    assert not image.is_scalar and 0.9 < image.rgba[..., 0].max() <= 1 and set(np.unique(image.rgba[..., 3])) <= {0, 1}
    image.save(tmp_path / "a.png")
    recipe = ss.Recipe.read(tmp_path / "a.png")
    again = [made.kernels_of(one) for made, one in zip(recipe.fields, fields, strict=True)]
    assert ss.Renderer(backend="reference").render(recipe.scene(again), recipe.camera, size=recipe.size) == image
    (stage,) = ss.Renderer(backend="reference").progressive(recipe.scene(again), recipe.camera, size=recipe.size)
    assert stage == image
    # With a colormap it is the sum, and x-rays are the sum always.
    assert ss.render(fields, **options, cmap="gray").is_scalar
    assert ss.render(fields, **{**options, "mode": "xray"}).is_scalar
    with pytest.raises(ss.Unsupported, match="the light of channels, which is made of several pictures"):
        ss.render(fields, **options, max_error=0.1)
    with pytest.raises(ss.Unsupported, match="the error of the light of channels cannot be estimated"):
        _ = image.error


def test_colors_beside_channels_and_labels(tmp_path):
    colored = ss.RegularField(COLORS)
    labelled = ss.open(segmentation(tmp_path / "a.seg.nrrd"))
    channel = ss.RegularField(STACK[0]).with_color("red")
    scene = ss.api.prepare([colored, labelled, channel], size=16).scene
    assert [len(one) for one in scene.groups] == [1, 1, 1] and scene.fields[1].labels
    assert ss.render([colored, channel], size=16, backend="reference").rgba.any()


def test_bad_colors_of_fields():
    field = ss.RegularField(STACK[0])
    for wrong in ((1, 2), "nothing", (2, 0, 0), 3):
        with pytest.raises(ss.InvalidInput, match="color"):
            field.with_color(wrong)
    with pytest.raises(ss.InvalidInput, match="RegularField: window cannot be used"):
        field.with_color("red", (3, 2))
    with pytest.raises(ss.InvalidInput, match="label_colors .* a volume of values"):
        field.with_label_colors(ss.LabelColors({1: "red"}))
    with pytest.raises(ss.InvalidInput, match="label_colors .* dict"):
        ss.RegularField(LABELS, labels=True).with_label_colors({1: "red"})
