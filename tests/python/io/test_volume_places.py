"""Where samples lie: volumes whose axes are turned or sheared lie where their headers say, in every format alike."""

from __future__ import annotations

import numpy as np
import pytest
import test_io
from test_data_formats import VALUES, dicom, mrc, needed, nifti

import sheetsplat as ss
from sheetsplat import io

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


def write_nrrd(folder, rows, first):
    def vector(numbers):
        return "(" + ",".join(f"{number:.12g}" for number in numbers) + ")"

    header = (
        "NRRD0004\ntype: short\ndimension: 3\nsizes: 20 22 24\nencoding: raw\nendian: little\n"
        f"space: left-posterior-superior\nspace directions: {' '.join(map(vector, rows))}\n"
        f"space origin: {vector(first)}\n\n"
    )
    (folder / "a.nrrd").write_bytes(header.encode() + samples(rows, first).astype("<i2").tobytes())
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
    assert "degrees off those of the world" in volume.details["axes"]
    assert ("between i and j" in volume.details["axes"]) == (
        shear is not np.eye(3) and "sheared" in kind or "tilted" in kind
    )
    # A tenth of a voxel.
    assert np.abs(middle_of(volume) - MIDDLE @ to_world).max() < 0.13


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
    for number, angles in enumerate(((90, 90, 180), (10, 10, 90), (-90, 90, 90))):
        with pytest.raises(ss.InvalidInput, match="angles .* of a cell"):
            ss.open(mrc(tmp_path / f"{number}.mrc", VALUES, cellb=angles))


def test_slices_beside_their_line_are_refused(tmp_path):
    def beside(data, z):
        data.ImagePositionPatient = [10 + (z == 2), 20, 30 + 2.5 * z]

    with pytest.raises(ss.InvalidInput, match="mm beside the line of the others"):
        ss.open(dicom(tmp_path / "a", change=beside))


def test_centres_of_rotation_are_told(tmp_path):
    header = test_io.meta_header(CenterOfRotation="1 2 3").encode()
    (tmp_path / "a.mha").write_bytes(header + test_io.VALUES.tobytes())
    with pytest.warns(ss.PictureWarning, match="CenterOfRotation = 1 2 3 is not used"):
        ss.open(tmp_path / "a.mha")
