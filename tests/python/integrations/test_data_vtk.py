"""Data sets of VTK and PyVista."""

from __future__ import annotations

import numpy as np
import pytest

import sheetsplat as ss

pv = pytest.importorskip("pyvista", reason="pyvista is not installed")

VALUES = np.random.default_rng(14).random((4, 5, 6))


def image(cells=False, values=VALUES, **options):
    counts = np.array(values.shape[::-1]) + cells
    grid = pv.ImageData(dimensions=counts, spacing=(1, 2, 3), origin=(7, 8, 9), **options)
    (grid.cell_data if cells else grid.point_data)["pressure"] = values.ravel()
    return grid


def test_images():
    field = ss.open(image())
    assert np.array_equal(field.values, VALUES) and field.quantity.name == "pressure"
    assert field.spacing == (1, 2, 3) and field.origin == (7, 8, 9)
    of_cells = ss.open(image(cells=True))
    assert np.array_equal(of_cells.values, VALUES) and of_cells.origin == (7.5, 9, 10.5)
    part = image()
    part.offset = (10, 0, 0)
    assert ss.open(part).origin == (17, 8, 9)


def test_images_that_are_turned():
    """A quarter turn is exact: the world does not change."""
    turned = image(direction_matrix=[[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    field = ss.open(turned)
    for number in (0, 17, 63, 119):
        # The sample at a point of the image is that of the field there.
        at = np.rint((np.array(turned.points[number]) - field.origin) / field.spacing).astype(int)
        assert field.values[tuple(at[::-1])] == turned["pressure"][number]


def test_the_scalar_is_chosen():
    grid = image()
    grid.cell_data["load"] = np.arange(grid.n_cells, dtype=np.uint8)
    grid["velocity"] = np.random.default_rng(1).random((grid.n_points, 3))
    assert np.array_equal(ss.open(grid, scalar="load").values.ravel(), np.arange(60))
    np.testing.assert_allclose(
        ss.open(grid, scalar="velocity").values.ravel(), np.linalg.norm(grid["velocity"], axis=1)
    )
    assert np.array_equal(ss.open(grid, scalar="velocity_z").values.ravel(), grid["velocity"][:, 2])
    grid.set_active_scalars("load")
    assert ss.open(grid).quantity.name in ("pressure", "load")
    with pytest.raises(ss.InvalidInput, match="'none' cannot be taken from the image: found these: pressure, velocity"):
        ss.open(grid, scalar="none")
    with pytest.raises(ss.InvalidInput, match="no array of numbers"):
        ss.open(pv.ImageData(dimensions=(3, 3, 3)))
    with pytest.raises(ss.InvalidInput, match="found particles"):
        ss.open(grid, particles="a")


def test_rectilinear_grids():
    x, y, z = np.arange(6.0), np.arange(5.0) * 2, np.arange(4.0) * 3
    even = pv.RectilinearGrid(x, y, z)
    even["pressure"] = VALUES.ravel()
    field = ss.open(even)
    assert np.array_equal(field.values, VALUES) and field.spacing == (1, 2, 3)
    uneven = pv.RectilinearGrid(x, y, z**2)
    uneven["pressure"] = VALUES.ravel()
    with pytest.raises(ss.InvalidInput, match="uneven coordinates along z.*resample=True"):
        ss.open(uneven)
    assert ss.open(uneven, resample=True).shape[0] == 10
    cells = pv.RectilinearGrid(x, y, z)
    cells.cell_data["load"] = np.arange(60.0)
    assert ss.open(cells).origin == (0.5, 1, 1.5)


def test_structured_grids():
    k, j, i = np.meshgrid(np.arange(4.0), np.arange(5.0), np.arange(6.0), indexing="ij")
    grid = pv.StructuredGrid()
    grid.points = np.stack([(i + 0.1 * j * j).ravel(), j.ravel(), (k + 0.1 * i).ravel()], axis=1)
    grid.dimensions = (6, 5, 4)
    grid["pressure"] = VALUES.ravel()
    field = ss.open(grid)
    expected = ss.fit.delaunay(np.asarray(grid.points, float), VALUES.ravel(), shape=(4, 5, 6)).field()
    assert field.size == expected.size and np.array_equal(field.values, expected.values)
    np.testing.assert_allclose(field.scales, expected.scales)
    grid.cell_data["load"] = np.arange(60.0)
    field = ss.open(grid, scalar="load", fit="nearest")
    np.testing.assert_allclose(field.centers, grid.cell_centers().points, atol=1e-6)


def tetrahedra(count=80):
    numbers = np.random.default_rng(2)
    cloud = pv.PolyData(numbers.random((count, 3)).astype(np.float64))
    grid = cloud.delaunay_3d()
    grid["density"] = grid.points[:, 0] + 1
    return grid


def test_unstructured_grids(tmp_path):
    grid = tetrahedra()
    field = ss.open(grid)
    grid.save(tmp_path / "a.vtu")
    stored = ss.open(tmp_path / "a.vtu")
    assert np.array_equal(field.centers, stored.centers) and np.array_equal(field.values, stored.values)
    np.testing.assert_allclose(field.scales, stored.scales)
    grid.cell_data["load"] = np.arange(float(grid.n_cells))
    field = ss.open(grid, scalar="load", neighbors=5)
    np.testing.assert_allclose(field.centers, grid.cell_centers().points, atol=1e-12)


def test_surfaces():
    ball = pv.Sphere(theta_resolution=8, phi_resolution=8)
    ball["height"] = ball.points[:, 2]
    field = ss.open(ball, fit="nearest")
    assert field.size == ball.n_points
    ball.cell_data["load"] = np.arange(float(ball.n_cells))
    field = ss.open(ball, scalar="load", neighbors=4)
    np.testing.assert_allclose(field.centers, ball.cell_centers().points, atol=1e-6)
    mixed = pv.Line((0, 0, 5), (0, 0, 6)).append_polydata(ball)
    mixed.cell_data["load"] = np.arange(float(mixed.n_cells))
    field = ss.open(mixed, scalar="load", neighbors=4)
    np.testing.assert_allclose(field.centers, mixed.cell_centers().points, atol=1e-6)


def test_data_sets_of_vtk_alone():
    vtk = pytest.importorskip("vtkmodules.vtkCommonDataModel")
    from vtkmodules.util.numpy_support import numpy_to_vtk

    plain = vtk.vtkImageData()
    plain.SetDimensions(6, 5, 4)
    array = numpy_to_vtk(VALUES.ravel(), deep=True)
    array.SetName("pressure")
    plain.GetPointData().SetScalars(array)
    assert np.array_equal(ss.open(plain).values, VALUES)
    assert ss.render(plain, size=16, backend="reference").rgba.any()
    # What has no points is no data.
    for empty in (vtk.vtkUnstructuredGrid(), vtk.vtkPolyData(), vtk.vtkImageData(), vtk.vtkStructuredGrid()):
        with pytest.raises(ss.InvalidInput):
            ss.open(empty)


def test_blocks():
    assert ss.open(pv.MultiBlock([image()])) == ss.open(image())
    with pytest.raises(ss.InvalidInput, match="2 blocks.*combine"):
        ss.open(pv.MultiBlock([image(), image()]))


def test_the_accessor():
    import sheetsplat.integrations.pyvista as integration

    assert isinstance(image().sheetsplat, integration.Accessor)
    picture = image().sheetsplat.render(size=(16, 12), backend="reference")
    assert np.array_equal(picture.rgba, ss.render(image(), size=(16, 12), backend="reference").rgba)
    assert tetrahedra().sheetsplat.field(w0=0.5) == ss.open(tetrahedra(), w0=0.5)
    assert pv.MultiBlock([image()]).sheetsplat.field() == ss.open(image())
