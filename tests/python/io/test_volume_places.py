"""Where samples lie: volumes whose axes are turned or sheared lie where their headers say, in every format alike."""

from __future__ import annotations

import numpy as np
import pytest
import test_io
from test_data_formats import VALUES, dicom, mrc, needed, nifti

import sheetsplat as ss
from sheetsplat import io
from sheetsplat.api import to_fields
from sheetsplat.io.axes import placed

# The same object for all: an ellipsoid of a Gaussian, in mm to the left, the back and the head of a patient.
MIDDLE = np.array([11.0, -7.0, 23.0])
WIDTHS = np.array([3.0, 4.0, 5.0])
COUNTS = (20, 22, 24)
# NIfTI's world runs to the right and the front.
TO_RAS = np.diag([-1.0, -1.0, 1.0])


def turn(*angles):
    """Return a rotation by angles about z, y and x, degrees."""
    return needed("scipy.spatial.transform").Rotation.from_euler("zyx", angles, degrees=True).as_matrix()


def lattice(directions, steps, counts=COUNTS):
    """Return the steps of i, j, k as rows and the first place of a lattice about the middle of the object."""
    rows = np.asarray(directions) * np.asarray(steps)[:, None]
    return rows, MIDDLE + (0.4, -0.3, 0.2) - (np.array(counts) - 1) / 2 @ rows


def samples(rows, first, counts=COUNTS):
    """Return the object at the places of a lattice, [k, j, i]."""
    i, j, k = (np.arange(count) for count in counts)
    index = np.stack(np.meshgrid(k, j, i, indexing="ij")[::-1], axis=-1)
    away = (first + index @ rows - MIDDLE) / WIDTHS
    return (1000 * np.exp(-0.5 * (away**2).sum(axis=-1))).astype(np.int16)


def text(numbers):
    """Return numbers for a header."""
    return " ".join(f"{number:.9g}" for number in np.ravel(numbers))


def write_nifti(folder, rows, first):
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = (rows @ TO_RAS).T, first @ TO_RAS
    path = nifti(folder / "a.nii", values=samples(rows, first))
    data = bytearray(path.read_bytes())
    # The affine itself, which may be sheared: qform_code 0, sform_code 1, srow.
    data[252:256] = np.array([0, 1], "<i2").tobytes()
    data[280:328] = affine[:3].astype("<f4").tobytes()
    path.write_bytes(data)
    return path


def write_mha(folder, rows, first):
    lengths = np.linalg.norm(rows, axis=1)
    fields = {"DimSize": "20 22 24", "ElementSpacing": text(lengths), "Offset": text(first), "ElementType": "MET_SHORT"}
    header = test_io.meta_header(**fields, TransformMatrix=text(rows / lengths[:, None]), AnatomicalOrientation="RAI")
    (folder / "a.mha").write_bytes(header.encode() + samples(rows, first).astype("<i2").tobytes())
    return folder / "a.mha"


def write_header(rows, first, space="left-posterior-superior"):
    """Return a header of NRRD."""

    def vector(numbers):
        return "(" + ",".join(f"{number:.12g}" for number in numbers) + ")"

    return (
        "NRRD0004\ntype: short\ndimension: 3\nsizes: 20 22 24\nencoding: raw\nendian: little\n"
        f"space: {space}\nspace directions: {' '.join(map(vector, rows))}\nspace origin: {vector(first)}\n\n"
    )


def write_nrrd(folder, rows, first):
    (folder / "a.nrrd").write_bytes(write_header(rows, first).encode() + samples(rows, first).astype("<i2").tobytes())
    return folder / "a.nrrd"


def write_dicom(folder, rows, first):
    values, lengths = samples(rows, first), np.linalg.norm(rows, axis=1)

    def change(data, z):
        data.Columns, data.Rows, _ = COUNTS
        data.ImagePositionPatient = [f"{number:.8f}" for number in first + z * rows[2]]
        data.ImageOrientationPatient = [f"{number:.10f}" for number in np.ravel(rows[:2] / lengths[:2, None])]
        data.PixelSpacing = [lengths[1], lengths[0]]
        data.RescaleIntercept = 0
        data.PixelData = values[z].tobytes()
        # Other tests name files by numbers up to eleven.
        data.SeriesDescription = "turned"

    return dicom(folder / "series", count=COUNTS[2], change=change, names=101)


def write_vti(folder, rows, first):
    pyvista = needed("pyvista")
    lengths = np.linalg.norm(rows, axis=1)
    image = pyvista.ImageData(dimensions=COUNTS, spacing=lengths, origin=first)
    image.direction_matrix = (rows / lengths[:, None]).T
    image.point_data["a"] = samples(rows, first).ravel()
    image.save(folder / "a.vti")
    return folder / "a.vti"


def middle_of(volume):
    """Return the middle of the samples' mass in the world."""
    values = np.asarray(volume.values, np.float64)
    steps = np.diag(volume.spacing) if volume.axes is None else np.asarray(volume.axes)
    along = [np.arange(size) @ values.sum(axis=tuple({0, 1, 2} - {2 - axis})) / values.sum()
             for axis, size in enumerate(values.shape[::-1])]  # fmt: skip
    return np.asarray(volume.origin) + np.array(along) @ steps


SHEAR = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.2, -0.3, 0.93]])
# Writer, directions and steps: each format has axes of its own; those of the last two are sheared.
TURNED = {
    "nifti": (write_nifti, (35, -20, 15), np.eye(3), (1.4, 1.5, 1.6)),
    "mha": (write_mha, (-50, 10, 5), np.eye(3), (1.5, 1.4, 1.6)),
    "nrrd": (write_nrrd, (120, 40, -70), np.eye(3), (1.6, 1.5, 1.4)),
    "vti": (write_vti, (15, 25, -35), np.eye(3), (1.5, 1.5, 1.5)),
    "dicom of a tilted gantry": (write_dicom, (0, 0, 18), SHEAR, (1.3, 1.4, 1.7)),
    "nifti sheared": (write_nifti, (12, 0, 30), SHEAR, (1.4, 1.5, 1.6)),
    "nrrd sheared": (write_nrrd, (5, -8, 20), SHEAR[[2, 0, 1]], (1.4, 1.5, 1.6)),
}


def written(folder, kind):
    """Return the path of the object as a format has it."""
    write, angles, shear, steps = TURNED[kind]
    return write(folder, *lattice(shear @ turn(*angles).T, steps))


@pytest.mark.parametrize("kind", TURNED)
def test_turned_volumes_lie_where_their_headers_say(tmp_path, kind):
    volume = io.read_volume(written(tmp_path, kind))
    _, angles, shear, steps = TURNED[kind]
    rows, first = lattice(shear @ turn(*angles).T, steps)
    to_world = TO_RAS if kind.startswith("nifti") else np.eye(3)
    np.testing.assert_allclose(volume.axes, rows @ to_world, atol=1e-5)
    np.testing.assert_allclose(volume.origin, first @ to_world, atol=1e-4)
    assert volume.spacing == pytest.approx(np.linalg.norm(rows, axis=1), rel=1e-5)
    assert "degrees off those of the world" in io.axes.directions(volume.axes)
    assert ("between i and j" in io.axes.directions(volume.axes)) == (
        shear is not np.eye(3) and "sheared" in kind or "tilted" in kind
    )
    # A tenth of a voxel.
    assert np.abs(middle_of(volume) - MIDDLE @ to_world).max() < 0.13


def middle_of_field(field, about):
    """Return the middle of a field's mass by its values at points around a place of the world."""
    along = np.arange(-16.0, 17.0, 2.0)
    points = about + np.stack(np.meshgrid(along, along, along, indexing="ij"), axis=-1).reshape(-1, 3)
    values = np.maximum(field.at(points), 0)
    return values @ points / values.sum()


@pytest.mark.parametrize("kind", TURNED)
def test_fields_of_turned_volumes_lie_there_too(tmp_path, kind):
    path = written(tmp_path, kind)
    field, about = ss.open(path), MIDDLE @ (TO_RAS if kind.startswith("nifti") else np.eye(3))
    assert np.abs(middle_of_field(field, about) - about).max() < 0.13
    assert field.at([about])[0] == pytest.approx(1000, rel=0.05)
    np.testing.assert_allclose(field.axes, io.read_volume(path).axes)
    # A spacing that is given is that along the directions of the file.
    wider = ss.open(path, spacing=(2, 2, 2))
    assert wider.spacing == pytest.approx((2, 2, 2)) and np.cross(wider.axes[0], field.axes[0]) == pytest.approx(0)


def test_turned_volumes_in_bricks_and_from_their_pictures(tmp_path):
    path = written(tmp_path, "mha")
    whole, options = ss.open(path), {"size": 24, "backend": "reference", "quality": "draft"}
    bricked = ss.open_bricks(path, brick=12, quality="draft")
    assert bricked.axes == whole.axes and bricked.source.at_level(0).axes == whole.axes
    image = ss.render(path, **options)
    np.testing.assert_allclose(ss.render(bricked, **options).rgba, image.rgba, atol=1e-5)
    again = ss.Recipe.from_json(image.recipe.to_json()).fields[0].options
    assert np.array_equal(again["axes"], whole.axes) and "spacing" not in again


def test_modalities_of_one_body_coincide_in_a_picture(tmp_path):
    """NIfTI, MetaImage, NRRD and DICOM, each in directions and in a world of its own, within a tenth of a voxel."""
    names = ("mha", "nifti", "nrrd", "dicom of a tilted gantry", "nifti sheared")
    paths = []
    for name in names:
        (tmp_path / name).mkdir()
        paths.append(written(tmp_path / name, name))
    for first, world in ((0, np.eye(3)), (1, TO_RAS)):
        fields = to_fields([*paths[first:], *paths[:first]])
        middles = [middle_of_field(field, MIDDLE @ world) for field in fields]
        assert np.abs(np.array(middles) - MIDDLE @ world).max() < 0.13
        assert len({field.orientation for field in fields}) == 1
    # Fields that are made already are turned in the same way.
    assert to_fields([ss.open(path) for path in paths[:2]])[1].axes == to_fields(paths[:2])[1].axes
    options = {"mode": "mip", "size": 64, "backend": "reference", "direction": "-z", "up": "y", "clim": (0, 1000)}
    camera = ss.render(paths[0], **options).camera
    peaks = []
    for data in (paths[0], paths[:2]):
        seen = np.nan_to_num(ss.render(data, camera=camera, **{**options, "direction": None, "up": None}).scalar)
        rows, columns = np.mgrid[: seen.shape[0], : seen.shape[1]]
        weight = np.maximum(seen - 0.5 * seen.max(), 0)
        peaks.append(np.array([(rows * weight).sum(), (columns * weight).sum()]) / weight.sum())
    # A pixel is more than half a millimetre.
    assert np.abs(peaks[0] - peaks[1]).max() < 0.2


def test_bodies_in_left_handed_spaces_are_not_mirrored(tmp_path):
    rows, first = lattice(turn(120, 40, -70).T, (1.6, 1.5, 1.4))
    mirror = np.diag([1.0, -1.0, 1.0])
    path = write_nrrd(tmp_path, rows, first)
    _, data = path.read_bytes().split(b"\n\n", 1)
    other = write_header(rows @ mirror, first @ mirror, "left-anterior-superior")
    path.write_bytes(other.encode() + data)
    volume = io.read_volume(path)
    assert volume.orientation == ss.Orientation.anatomical("right", "anterior", "superior")
    assert np.abs(middle_of(volume) - MIDDLE @ TO_RAS).max() < 0.13 and "left-handed" in volume.details["mirrored"]


def test_axes_along_the_world_are_turned_without_a_copy():
    values = np.arange(24.0).reshape(2, 3, 4)
    # i runs along -z, j along x, k along y.
    rows = np.array([[0, 0, -3.0], [1.0, 0, 0], [0, 2.0, 0]])
    found = io.axes.settled("x", io.Volume(values, origin=(5.0, 6.0, 7.0), axes=rows))
    assert found.axes is None and found.spacing == (1, 2, 3) and found.origin == (5, 6, -2)
    assert np.shares_memory(found.values, values) and found.values.shape == (4, 2, 3)
    assert found.values[3, 0, 0] == values[0, 0, 0] and found.values[0, 1, 2] == values[1, 2, 3]
    # Rounding does not make axes oblique: no sample moves by a hundredth of a step.
    assert io.axes.settled("x", io.Volume(values, axes=rows + 1e-3)).axes is None
    assert io.axes.settled("x", io.Volume(values, axes=rows + 1e-2)).axes is not None


def test_cells_of_mrc_have_angles(tmp_path):
    """Half a cell along a, along b and along both of a hexagonal one of 36 Å is 18.00 Å, in every direction."""
    path = mrc(tmp_path / "a.mrc", values=np.zeros((4, 24, 24), np.int16), cella=(36, 36, 6), cellb=(90, 90, 120))
    volume = io.read_volume(path)
    at_0, along_a, along_b = (
        np.array(volume.origin) + index @ volume.axes for index in ((0, 0, 0), (12, 0, 0), (0, 12, 0))
    )
    assert np.linalg.norm(along_a - at_0) == pytest.approx(18) == np.linalg.norm(along_b - at_0)
    assert np.linalg.norm(along_a + along_b - 2 * at_0) == pytest.approx(18)
    # Columns and rows in the other order, and the first sample by its number.
    turned = io.read_volume(mrc(tmp_path / "b.mrc", np.zeros((4, 24, 24), np.int16), cella=(36, 36, 6),
                                cellb=(90, 90, 120), mapc=2, mapr=1, nxstart=4))  # fmt: skip
    np.testing.assert_allclose(turned.axes, volume.axes[[1, 0, 2]], atol=1e-6)
    np.testing.assert_allclose(turned.origin, 4 * volume.axes[1], atol=1e-5)
    # a, b and c of any angles: their lengths and the angles between them.
    rows = io.read_volume(mrc(tmp_path / "c.mrc", VALUES, cellb=(80, 95, 110))).axes
    units = rows / np.linalg.norm(rows, axis=1)[:, None]
    cosines = [units[1] @ units[2], units[0] @ units[2], units[0] @ units[1]]
    np.testing.assert_allclose(np.degrees(np.arccos(cosines)), (80, 95, 110), atol=1e-4)
    for number, angles in enumerate(((90, 90, 180), (10, 10, 90), (-90, 90, 90), (270, 90, 90))):
        with pytest.raises(ss.InvalidInput, match="angles .* of a cell"):
            ss.open(mrc(tmp_path / f"{number}.mrc", VALUES, cellb=angles))


def test_numbers_of_first_samples_beside_an_origin_are_told(tmp_path):
    path = mrc(tmp_path / "a.mrc", VALUES, origin=(10, 20, 30), nystart=4)
    with pytest.warns(ss.PictureWarning, match=r"NZSTART = \[0.0, 4.0, 0.0\] are not used beside ORIGIN"):
        assert ss.open(path).origin == (10, 20, 30)


def test_slices_beside_their_line_are_refused(tmp_path):
    def beside(data, z):
        data.ImagePositionPatient = [10 + (z == 2), 20, 30 + 2.5 * z]

    with pytest.raises(ss.InvalidInput, match="mm beside the line of the others"):
        ss.open(dicom(tmp_path / "a", change=beside))


@pytest.mark.parametrize("sides", [(2, 0, 0, 0, 2, 0), (1, 0, 0, 0.7, 0.7, 0), (0,) * 6])
def test_rows_and_columns_of_slices_are_at_right_angles(tmp_path, sides):
    def change(data, z):
        data.ImageOrientationPatient = list(sides)

    with pytest.raises(ss.InvalidInput, match="of length 1 and at right angles"):
        ss.open(dicom(tmp_path / "series", change=change))


def test_places_that_are_none_are_told():
    for origin, axes, told in (
        ((np.nan, 0, 0), np.eye(3), "the first sample at"),
        ((0, 0, 0), np.ones((3, 3)), "in one plane; correct the header"),
    ):
        with pytest.raises(ss.InvalidInput, match=told):
            placed("a file", io.Volume(VALUES, origin=origin, axes=axes))
    # Lengths whose squares are no numbers.
    for size in (1e-200, 1e200):
        assert placed("a file", io.Volume(VALUES, axes=size * np.eye(3))).spacing == (size,) * 3


def test_centres_of_rotation_are_told(tmp_path):
    header = test_io.meta_header(CenterOfRotation="1 2 3").encode()
    (tmp_path / "a.mha").write_bytes(header + test_io.VALUES.tobytes())
    with pytest.warns(ss.PictureWarning, match="CenterOfRotation = 1 2 3 is not used"):
        ss.open(tmp_path / "a.mha")
