"""xarray's DataArrays and Datasets: dimensions, coordinates, names and units."""

from __future__ import annotations

import importlib.util
import sys
import warnings

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat.figure import picture_plane

xr = pytest.importorskip("xarray", reason="xarray is not installed")

VALUES = np.random.default_rng(14).random((5, 6, 7)).astype(np.float32)


def array(dims=("z", "y", "x"), values=VALUES, **options):
    coordinates = {name: np.arange(size) * 0.5 + 3.0 for name, size in zip(dims, values.shape, strict=True)}
    return xr.DataArray(values, dims=dims, coords=coordinates, **options)


def test_dimensions_and_coordinates_become_axes():
    field = ss.open(array())
    assert np.array_equal(field.values, VALUES)
    assert field.spacing == (0.5, 0.5, 0.5) and field.origin == (3.0, 3.0, 3.0)


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0), (0, 2, 1)])
@pytest.mark.parametrize("names", [("z", "y", "x"), ("height", "latitude", "lon"), ("time", "lat", "lon")])
def test_named_dimensions_are_those_of_the_world_in_any_order(order, names):
    turned = array(dims=names).transpose(*(names[at] for at in order))
    assert np.array_equal(ss.open(turned).values, VALUES)


def test_other_names_keep_the_order_of_the_array():
    assert np.array_equal(ss.open(array(dims=("a", "b", "c"))).values, VALUES)
    assert np.array_equal(ss.open(array(dims=("x", "a", "b"))).values, VALUES)
    stated = array(dims=("a", "b", "c"))
    for name, axis in zip("abc", "XYZ", strict=True):
        stated.coords[name].attrs["axis"] = axis
    assert np.array_equal(ss.open(stated).values, VALUES.transpose(2, 1, 0))


def test_falling_coordinates_are_turned():
    falling = array().assign_coords(y=[10.0, 8.0, 6.0, 4.0, 2.0, 0.0])
    field = ss.open(falling)
    assert np.array_equal(field.values, VALUES[:, ::-1]) and field.origin[1] == 0 and field.spacing[1] == 2
    # A value stays at its place in the world.
    place = [(3.5, 8.0, 4.0)]
    rising = falling.sortby("y")
    assert np.array_equal(ss.open(rising).at(place), field.at(place))


def test_coordinates_of_float32_are_even():
    degrees = (np.arange(7) * 0.1 + 300).astype(np.float32)
    assert ss.open(array().assign_coords(x=degrees)).spacing[0] == pytest.approx(0.1, rel=1e-3)


def test_uneven_coordinates_are_refused_or_resampled():
    z = np.array([0.0, 1.0, 2.0, 4.0, 8.0])
    # Linear in z, so that linear interpolation is exact.
    uneven = array(values=(VALUES[:1] + z[:, None, None]).astype(np.float32)).assign_coords(z=z)
    with pytest.raises(ss.InvalidInput, match="uneven coordinates along z, 1 to 4 apart.*resample=True") as found:
        ss.open(uneven)
    assert found.value.option == "resample"
    field = ss.open(uneven, resample=True)
    assert field.shape == (9, 6, 7) and field.spacing[2] == 1.0
    np.testing.assert_allclose(field.values, VALUES[:1] + np.arange(9)[:, None, None], rtol=1e-6)
    assert np.array_equal(ss.open(array(), resample=True).values, VALUES)


@pytest.mark.parametrize(
    "places", [[0, 1, 1, 2, 3], [0, 2, 1, 3, 4], [0, 1, np.nan, 3, 4], [0, 1, 2, 3, np.inf], list("abcde")]
)
def test_coordinates_that_are_no_axis(places):
    with pytest.raises(ss.InvalidInput, match="along z"):
        ss.open(array().assign_coords(z=places), resample=True)


def test_dates_are_no_axis():
    dates = np.arange("2020-01", "2020-06", dtype="datetime64[M]").astype("datetime64[ns]")
    with pytest.raises(ss.InvalidInput, match=r"isel\(time=0\)"):
        ss.open(array(dims=("time", "y", "x")).assign_coords(time=dates))
    one = array(dims=("time", "y", "x")).assign_coords(time=dates).isel(time=[0])
    assert ss.open(one).shape == (1, 6, 7)


STEPS = {
    "dates": (
        np.array(["2020-01-31T06:00", "2020-02-01T00:00:30"], "datetime64[ns]"),
        {},
        "2020-01-31 06:00",
        "2020-02-01 00:00:30",
    ),
    "hours": ([6.0, 24.5], {"units": "hours since 2000-02-28 12:00:00"}, "2000-02-28 18:00", "2000-02-29 12:30"),
    "days": (
        [0, 366],
        {"units": "days since 1999-12-31", "calendar": "standard"},
        "1999-12-31 00:00",
        "2000-12-31 00:00",
    ),
    "other calendars": (
        [3, 4],
        {"units": "days since 2000-01-01", "calendar": "360_day"},
        "time = 3 days",
        "time = 4 days",
    ),
    "seconds": ([0.5, 2.0], {"units": "s"}, "time = 0.5 s", "time = 2 s"),
    "plain": ([1, 2], {}, "time = 1", "time = 2"),
    "nonsense": ([1, 2], {"units": "hours since 2000-99-01"}, "time = 1 hours", "time = 2 hours"),
    "texts": (["a", "b"], {}, "", ""),
}


@pytest.mark.parametrize("kind", STEPS)
def test_frames_tell_their_time(kind, tmp_path):
    places, told, *expected = STEPS[kind]
    both = xr.concat([array(), 2 * array()], xr.Variable("time", places, told))
    both["time"].attrs.update(told)
    film = ss.animate(both, size=16, backend="cpu")
    assert [one.recipe.fields[0].quantity.time for one in film] == expected
    if kind in ("hours", "seconds") and importlib.util.find_spec("h5netcdf"):
        both.rename("air").to_netcdf(tmp_path / "air.nc", engine="h5netcdf")
        film = ss.animate(tmp_path / "air.nc", size=16, backend="cpu")
        assert [one.recipe.fields[0].quantity.time for one in film] == expected


def test_numbers_of_dimensions():
    assert ss.open(array().expand_dims(t=1)).shape == (5, 6, 7)
    with pytest.raises(ss.InvalidInput, match=r"4 dimensions: t 2, z 5, y 6, x 7; wanted three.*isel\(t=0\)"):
        ss.open(array().expand_dims(t=2))
    with pytest.raises(ss.InvalidInput, match="2 dimensions: y 6, x 7"):
        ss.open(array().isel(z=0))
    with pytest.raises(ss.InvalidInput, match="type complex64"):
        ss.open(array(values=VALUES.astype(np.complex64)))


def test_names_and_units_reach_the_colour_bar():
    plain = array(name="t", attrs={"units": "K", "long_name": "air temperature"})
    for name in "xyz":
        plain.coords[name].attrs["units"] = "km"
    quantity = ss.open(plain).quantity
    assert (quantity.label, quantity.length_unit) == ("air temperature [K]", "km")
    assert ss.open(array(name="t")).quantity.label == "t"
    assert ss.open(array(name="t", attrs={"units": 3, "long_name": "a\nb"})).quantity.label == "a b"
    pytest.importorskip("matplotlib")
    bar = ss.render(plain, size=(20, 20), backend="reference").to_axes().figure.axes[1]
    assert "air temperature [K]" in (bar.get_ylabel(), bar.get_xlabel())


def earth(**options):
    """Return an array on the globe, half a kilometre and two degrees a step, with the units of its coordinates."""
    made = array(dims=("height", "lat", "lon"), **options)
    made = made.assign_coords(height=2 + 0.5 * np.arange(5), lat=60 - 2.0 * np.arange(6), lon=10 + 2.0 * np.arange(7))
    for name, unit in (("height", "km"), ("lat", "degrees_north")):
        made.coords[name].attrs["units"] = unit
    return made


def test_figures_have_the_coordinates_of_the_data():
    field = ss.open(earth())
    assert [one.label for one in field.quantity.axes] == ["lon", "lat [degrees_north]", "height [km]"]
    along = {"size": (50, 50), "backend": "reference", "quality": "draft", "direction": "-y", "up": "z"}
    world = picture_plane(ss.render(field, **along))
    assert world.labels == ("lon", "height [km]")
    # Drawn thrice as high: the picture has other shapes, and the axes the same coordinates at the same samples.
    image = ss.render(earth(), spacing=(1, 1, 3), origin=(-4, 0, 100), **along)
    plane = picture_plane(image)
    assert plane.labels == world.labels
    left, right, bottom, top = plane.extent
    middle = image.camera.target
    assert (left + right) / 2 == pytest.approx(10 + 2 * (middle[0] + 4))
    assert (bottom + top) / 2 == pytest.approx(2 + 0.5 * (middle[2] - 100) / 3)
    assert abs((right - left) / (top - bottom)) == pytest.approx(2 / (0.5 / 3))
    # Lengths of both axes together have no unit, and data without coordinates have those of the world.
    assert "[world units]" in picture_plane(ss.render(earth(), **{**along, "direction": (1, 1, 1)})).labels[0]
    assert picture_plane(ss.render(earth().drop_vars(["lon", "height"]), **along)).labels[0] == "x [world units]"
    assert not ss.open(xr.DataArray(VALUES, dims=("height", "lat", "lon"))).quantity.axes
    # Of another lattice the planes do not lie where the coordinates say.
    assert not ss.open(earth(), lattice="bcc").quantity.axes


def test_lengths_have_the_unit_that_all_coordinates_have():
    plain = array()
    for name in "xyz":
        plain.coords[name].attrs["units"] = "km"
    assert ss.open(plain).quantity.length_unit == "km"
    assert ss.open(plain, spacing=(1, 1, 2)).quantity.length_unit == ""
    assert ss.open(plain).replace(spacing=(1, 1, 2)).quantity == ss.open(plain, spacing=(1, 1, 2)).quantity


def test_the_same_coordinates_in_bricks_logarithms_and_files():
    whole = ss.open(earth(), spacing=(1, 1, 3))
    assert ss.open_bricks(earth(), spacing=(1, 1, 3), brick=4).quantity == whole.quantity
    assert ss.open(earth(), spacing=(1, 1, 3), log=0.01).quantity.axes == whole.quantity.axes
    picture = ss.render(whole, size=(20, 20), backend="reference")
    assert ss.Recipe.from_json(picture.recipe.to_json()).fields[0].quantity == whole.quantity


def test_pixels_of_figures_are_squares():
    pytest.importorskip("matplotlib")
    picture = ss.render(earth(), spacing=(1, 1, 3), size=(60, 40), backend="reference", direction="-y", up="z")
    axes = picture.to_axes(colorbar=False)
    axes.figure.canvas.draw()
    box = axes.get_window_extent()
    assert box.width / box.height == pytest.approx(60 / 40, rel=0.02)
    # The arrows of another view bear the names.
    oblique = ss.render(earth(), spacing=(1, 1, 3), size=(200, 160), backend="reference", quality="draft")
    assert oblique.annotated().width > 200


def test_depths_count_downwards():
    deep = array(dims=("depth", "y", "x")).assign_coords(depth=np.arange(5) * 10.0)
    level = ss.open(deep)
    assert level.origin[2] == 0 and level.quantity.axes[2].coordinate(30.0) == 30
    deep.coords["depth"].attrs["positive"] = "down"
    field = ss.open(deep)
    assert np.array_equal(field.values, VALUES[::-1]) and field.origin[2] == -40 and field.orientation is None
    assert [field.quantity.axes[2].coordinate(z) for z in (-40.0, 0.0)] == [40, 0]
    drawn = ss.open(deep, spacing=(1, 1, 1))
    assert [drawn.quantity.axes[2].coordinate(drawn.origin[2] + k) for k in (0, 4)] == [40, 0]
    assert np.array_equal(ss.open(deep.isel(depth=slice(None, None, -1))).values, field.values)
    source = ss.open_bricks(deep, brick=4)
    assert source.origin == field.origin and source.quantity == field.quantity
    pressure = array(dims=("plev", "lat", "lon")).assign_coords(plev=[1000, 800, 600, 400, 200])
    pressure.coords["plev"].attrs["units"] = "hPa"
    assert np.array_equal(ss.open(pressure).values, VALUES) and ss.open(pressure).origin[2] == -1000


def test_the_ocean_is_not_mirrored():
    """Seen towards the north, east is on the right and the surface of the sea above."""
    values = np.zeros((6, 6, 6), np.float32)
    values[0, :, 5] = 1.0
    named = {"depth": np.arange(6) * 1.0, "lat": np.arange(6) * 1.0, "lon": np.arange(6) * 1.0}
    sea = xr.DataArray(values, dims=tuple(named), coords=named)
    sea.coords["depth"].attrs["positive"] = "down"
    seen = ss.render(sea, direction="y", mode="mip", size=(40, 40), backend="reference").scalar
    row, column = np.unravel_index(np.nanargmax(seen), seen.shape)
    assert row < 15 and column > 25


def test_axes_of_different_units_are_told():
    earth = array(dims=("height", "lat", "lon")).assign_coords(height=np.arange(5) * 1000.0)
    for name, unit in (("height", "m"), ("lat", "degrees_north"), ("lon", "degrees_east")):
        earth.coords[name].attrs["units"] = unit
    with pytest.warns(ss.PictureWarning, match="different units .*height 5000 m|different units .*height 4000 m"):
        ss.open(earth)
    with pytest.warns(ss.PictureWarning, match="different units"):
        ss.open_bricks(earth, brick=4)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ss.open(earth, spacing=(1, 1, 1))
        ss.open_bricks(earth, brick=4, spacing=(1, 1, 1))
    assert ss.open(array()).quantity.length_unit == ""


def test_variables_of_sets():
    data = xr.Dataset({"a": array(), "b": array() + 1, "flat": ("x", np.arange(7.0))})
    with pytest.raises(ss.InvalidInput, match="these variables with three dimensions: a, b.*scalar="):
        ss.open(data)
    assert np.array_equal(ss.open(data, scalar="b").values, VALUES + 1)
    assert np.array_equal(ss.open(data[["a", "flat"]]).values, VALUES)
    with pytest.raises(ss.InvalidInput, match="'flat' cannot be taken"):
        ss.open(data, scalar="flat")
    with pytest.raises(ss.InvalidInput, match="no variable of three dimensions"):
        ss.open(data[["flat"]])


def test_samples_that_are_missing():
    holes = array(values=np.where(VALUES < 0.1, np.nan, VALUES))
    with pytest.raises(ss.InvalidInput, match='nan="skip"'):
        ss.open(holes)
    assert ss.open(holes, nan="skip").size == int((VALUES >= 0.1).sum())


def test_options_that_do_not_belong():
    with pytest.raises(ss.InvalidInput, match="the DataArray cannot be used with these options: found scalar"):
        ss.open(array(), scalar="a")
    with pytest.raises(ss.InvalidInput, match="found fit for a regular volume"):
        ss.open(array(), fit="nearest")
    assert ss.open(array(), spacing=(1, 2, 3), log=0.5).spacing == (1, 2, 3)


def test_what_dask_holds_is_computed_if_it_fits():
    pytest.importorskip("dask", reason="dask is not installed")
    assert np.array_equal(ss.open(array().chunk({"z": 2})).values, VALUES)
    import dask.array as da

    huge = xr.DataArray(da.zeros((10**6, 10**6, 10**6), chunks=10**5), dims=("z", "y", "x"))
    with pytest.raises(ss.OutOfMemory):
        ss.open(huge)


def test_the_accessor():
    import sheetsplat.integrations.xarray as integration

    assert isinstance(array().sheetsplat, integration.Accessor)
    picture = array().sheetsplat.render(size=(16, 12), backend="reference")
    assert np.array_equal(picture.rgba, ss.render(array(), size=(16, 12), backend="reference").rgba)
    assert array().to_dataset(name="a").sheetsplat.field(radius=3) == ss.open(array(name="a"), radius=3)
    with pytest.raises(TypeError, match="there is no option"):
        array().sheetsplat.render(sise=(3, 3))


def test_nothing_is_imported_for_other_data():
    """Kinds are recognized by the names of classes: objects of classes with the same names are not taken for them."""

    class DataArray:
        __module__ = "elsewhere"

    with pytest.raises(ss.Error):
        ss.render(DataArray())
    assert "elsewhere" not in sys.modules
