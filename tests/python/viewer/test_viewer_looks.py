"""Labels, channels, colours by another array and slice planes: what a page changes is drawn, undone and told again."""

from __future__ import annotations

import numpy as np
import pytest
from viewer_pages import SIZE, Page, made_by, opened_sessions, picture_of, volume

import sheetsplat as ss


@pytest.fixture
def opened():
    with opened_sessions() as make:
        yield make


def labelled():
    values = np.zeros((14, 14, 14), np.uint8)
    for label in (1, 2, 3):
        values[3:11, 3:11, 4 * label - 3 : 4 * label] = label
    colors = ss.LabelColors({1: "red", 2: ("lime", 0.5), 9: "white"}, {1: "liver", 2: "lung"})
    return ss.RegularField(values, labels=True).with_label_colors(colors)


def settled(page):
    """Return the pixels of the complete picture, signed, and the newest state that the page was told."""
    page.wait("about")
    with page.news:
        newest = {message["type"]: (message, payload) for message, payload in page.messages}
    told = newest.get("state")
    return picture_of(*newest["frame"]).astype(int), None if told is None else told[0]["state"]


def drawn(page, **changes):
    """Return what `settled` does after changes, or after what is undone."""
    if changes:
        page.set(**changes)
    else:
        page.clear()
        page.say(type="undo")
    return settled(page)


def test_labels_have_colors_opacities_and_switches(opened):
    session = opened(labelled())
    page = Page(session)
    first, state = settled(page)
    (look,) = state["looks"]
    assert [row[:2] for row in look["labels"]] == [[1, "liver"], [2, "lung"], [3, "label 3"]]
    assert look["labels"][1][2:] == ["#00ff00", 0.5, True]
    given = {"1": {"shown": False}, "2": {"color": "#0000ff", "opacity": 0.25}, "77": {"shown": True}, "x": {}}
    picture, state = drawn(page, look={"labels": given})
    assert not np.array_equal(picture, first)
    assert [row[2:] for row in state["looks"][0]["labels"][:2]] == [["#ff0000", 1.0, False], ["#0000ff", 0.25, True]]
    # What is not in the data stays, for files and Python.
    colors = session.scene().transfer_function
    assert set(colors.colors) == {2, 3, 9} and colors.names == {1: "liver", 2: "lung"}
    image = made_by(session.code(), labelled())
    assert np.array_equal(image.rgba, session.picture().rgba)
    assert image.recipe.transfer_functions[0] == colors
    assert session.scene_file().prepare(labelled()).scene.transfer_function == colors
    assert np.array_equal(drawn(page)[0], first)
    picture, state = drawn(page, look={"shown": False})
    assert not session.scene().transfer_function.colors and not picture.any()
    picture, state = drawn(page, mode="isosurface", look={"shown": True, "labels": {"1": {"shown": False}}})
    assert picture.any() and not state["looks"][0]["labels"][0][4]


@pytest.mark.parametrize(
    "given", [{"labels": 3}, {"labels": {"1": 2}}, {"labels": {"1": {"opacity": 2}}}, {"shown": "yes"}]
)
def test_unusable_looks_of_labels_change_nothing(opened, given):
    session = opened(labelled())
    page = Page(session)
    settled(page)
    before = session.scene().transfer_function
    page.set(look=given)
    page.wait("error")
    assert session.scene().transfer_function == before


@pytest.mark.parametrize("mode", ["composite", "mip"])
def test_channels_are_switched_and_colored(opened, mode):
    fields = [ss.RegularField(volume(shift)).with_color(color) for shift, color in ((0.3, "red"), (-0.3, "lime"))]
    session = opened(fields, mode=mode)
    page = Page(session)
    settled(page)
    picture, state = drawn(page, look={"group": 1, "shown": False})
    assert [one["shown"] for one in state["looks"]] == [True, False] and state["looks"][0]["color"] == "#ff0000"
    # (Highlights are white.)
    assert picture[..., 0].max() > 5 * picture[..., 1].max()
    picture, _ = drawn(page, look={"group": 0, "color": "#0000ff"})
    assert picture[..., 2].max() > 5 * picture[..., :2].max()
    assert np.array_equal(made_by(session.code(), fields).rgba, session.picture().rgba)
    drawn(page, look={"group": 1, "shown": True})
    assert session.scene().transfer_functions[1].points[:, 4].any()


def test_another_array_gives_the_colors(opened, tmp_path):
    path = tmp_path / "two.npz"
    np.savez(path, density=volume(), heat=np.ascontiguousarray(volume(0.4).T))
    session = opened(path)
    page = Page(session)
    told = page.wait("state")[0]
    assert told["data"]["color_names"] == ["density", "heat"] and told["state"]["color_by"] is None
    first, _ = settled(page)
    picture, state = drawn(page, color_by="heat", color_map="magma")
    assert not np.array_equal(picture, first) and (state["color_by"], state["color_map"]) == ("heat", "magma")
    expected = made_by(session.code(), None)
    assert np.array_equal(expected.rgba, session.picture().rgba)
    file = tmp_path / "scene.toml"
    file.write_text(session.scene_file().to_toml())
    again = ss.SceneFile.read(file).prepare()
    assert any(again.scene.color_by) and again.camera == session.state.camera
    # Modes without it leave it out, and have it again.
    drawn(page, mode="mip")
    assert not any(session.scene().color_by)
    picture_again, _ = drawn(page, mode="composite")
    assert np.array_equal(picture, picture_again)
    drawn(page, choice=1)
    assert any(session.scene().color_by)
    drawn(page, choice=0)
    assert np.array_equal(drawn(page, color_by=None)[0], first)
    page.set(color_by="nothing")
    page.wait("state")
    assert not any(session.scene().color_by)


def data_set(heat, density):
    xarray = pytest.importorskip("xarray", reason="xarray is not installed")
    axes = {name: np.arange(14.0) for name in "zyx"}
    arrays = {"density": (tuple("zyx"), density), "heat": (tuple("zyx"), heat), "times": (("z",), np.arange(14.0))}
    return xarray.Dataset(arrays, coords=axes)


def image_of_vtk(heat, density):
    pyvista = pytest.importorskip("pyvista", reason="PyVista is not installed")
    made = pyvista.ImageData(dimensions=(14, 14, 14))
    made["heat"], made["density"] = heat.ravel(), density.ravel()
    made.set_active_scalars("density")
    return made


def points_of_vtk(heat, density):
    pyvista = pytest.importorskip("pyvista", reason="PyVista is not installed")
    made = pyvista.PolyData(np.random.default_rng(1).random((80, 3)))
    made["density"], made["heat"] = density.ravel()[1000:1080], heat.ravel()[:80]
    made.set_active_scalars("density")
    return made


def table(heat, density):
    columns = dict(zip("xyz", np.random.default_rng(1).random((3, 80)), strict=True))
    return {**columns, "density": density.ravel()[1000:1080], "heat": heat.ravel()[:80], "radius": np.full(80, 0.2)}


@pytest.mark.parametrize("make", [data_set, image_of_vtk, points_of_vtk, table])
def test_arrays_of_other_libraries_are_chosen_and_give_the_colors(opened, make):
    density, heat = volume(n=14), np.ascontiguousarray(volume(0.4, n=14).T)
    data = make(heat, density)
    session = opened(data)
    page = Page(session)
    told = page.wait("state")[0]
    assert told["data"]["names"][:2] == told["data"]["color_names"][:2] == ["density", "heat"]
    assert "times" not in told["data"]["names"] and told["state"]["color_by"] is None
    first, _ = settled(page)
    alone = session.scene()
    assert alone.fields[0].quantity.name == "density"
    picture, state = drawn(page, color_by="heat")
    assert not np.array_equal(picture, first) and state["color_by"] == "heat"
    assert session.scene().color_by[0][0][0].quantity.name == "heat"
    assert np.array_equal(made_by(session.code(), data, size=SIZE).rgba, session.picture().rgba)
    other, _ = drawn(page, choice=1)
    assert session.scene().fields[0].quantity.name == "heat" and not np.array_equal(other, picture)
    assert np.array_equal(made_by(session.code(), data, size=SIZE).rgba, session.picture().rgba)


def test_slice_planes_are_shown_and_undone(opened):
    session = opened()
    page = Page(session)
    first, _ = settled(page)
    planes = [{"normal": [0, 0, 1], "offset": 6.5, "cmap": "magma"}, {"normal": [1, 1, 0], "offset": None}]
    assert not np.array_equal(drawn(page, slice_planes=planes)[0], first)
    assert session.scene().options["slice_planes"] == (
        ss.SlicePlane((0, 0, 1), 6.5, cmap="magma"),
        ss.SlicePlane((1, 1, 0), cmap="gray"),
    )
    assert np.array_equal(made_by(session.code(), volume(), size=SIZE).rgba, session.picture().rgba)
    assert np.array_equal(drawn(page)[0], first)
    page.set(slice_planes=[{"normal": [0, 0, 0]}])
    assert "a finite normal" in page.wait("error")[0]["text"]


def test_labels_beside_a_surface_have_their_list(opened):
    fields = [ss.RegularField(volume(n=14)), labelled()]
    session = opened(fields, mode="isosurface")
    page = Page(session)
    first, state = settled(page)
    assert state["looks"][0] is None and [row[0] for row in state["looks"][1]["labels"]] == [1, 2, 3]
    hidden, state = drawn(page, look={"group": 1, "labels": {"1": {"shown": False}}})
    assert not np.array_equal(hidden, first) and state["looks"][1]["labels"][0][4] is False
    surfaces = [{"value": 0.4, "opacity": 0.5, "color": "#ff0000"}]
    both, state = drawn(page, surfaces=surfaces)
    assert not np.array_equal(both, hidden) and state["surfaces"][0]["value"] == 0.4
    of_labels = session.scene().transfer_functions[1]
    assert isinstance(of_labels, ss.LabelColors) and 1 not in of_labels.colors and 2 in of_labels.colors
    image = made_by(session.code(), fields, size=SIZE)
    assert np.array_equal(image.rgba, session.picture().rgba)
    # What was changed of the volume in another mode comes back with that.
    drawn(page, look={"group": 0, "cmap": "gray"})
    assert np.array_equal(drawn(page)[0], both)


def test_cut_faces_are_switched(opened):
    session = opened(shading=True)
    page = Page(session)
    first, state = settled(page)
    assert state["cut_faces"] is True
    without, _ = drawn(page, cut_faces=False)
    assert session.scene().options["cut_faces"] is False and not np.array_equal(without, first)
    # Whoever switched them off keeps that where the data are cut.
    clip = {"planes": [[[0, 0, 1], 6.0]], "box": None}
    drawn(page, clip=clip)
    assert session.scene().options["cut_faces"] is False
    assert np.array_equal(made_by(session.code(), volume(), size=SIZE).rgba, session.picture().rgba)
    centres = np.random.default_rng(2).uniform(0, 9, (40, 3))
    session = opened(ss.EllipsoidField(centres, np.full(40, 3.0), values=np.arange(40.0)))
    page = Page(session)
    assert settled(page)[1]["cut_faces"] is False
    # A first cut lights its faces.
    drawn(page, clip={"planes": [[[0, 0, 1], 4.0]], "box": None})
    assert session.scene().options["cut_faces"] is True and state["faces_follow"] is True


def test_new_slice_planes_have_the_colours_that_the_viewer_was_given(opened):
    session = opened(slice_cmap="inferno", slice_clim=(0, 0.5))
    page = Page(session)
    settled(page)
    drawn(page, slice_planes=[{"normal": [0, 0, 1], "offset": 6.5, "cmap": None, "clim": None}])
    assert session.scene().options["slice_planes"] == (ss.SlicePlane((0, 0, 1), 6.5, cmap="inferno", clim=(0, 0.5)),)
    assert np.array_equal(made_by(session.code(), volume(), size=SIZE).rgba, session.picture().rgba)
    drawn(page)
    assert "slice_cmap" not in session.code()
    page.clear()
    page.say(type="redo")
    assert settled(page)[1]["slice_planes"][0]["cmap"] == "inferno"


def test_arrays_and_times_of_a_file_are_chosen_together(opened, tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        for name, shift in (("density", 0.0), ("speed", 0.5)):
            file[name] = np.stack([volume(shift), volume(-shift)])
            for axis, label in enumerate(("time", "z", "y", "x")):
                file[name].dims[axis].label = label
    session = opened(path)
    page = Page(session)
    told = page.wait("state")[0]["data"]
    assert told["names"] == ["/density", "/speed"] and len(told["times"]) == 2
    page.set(choice=1)
    page.wait("frame", last=True, choice=1)
    page.set(time=1)
    page.wait("frame", last=True, time=1, choice=1)
    np.testing.assert_array_equal(session.scene().fields[0].values, volume(-0.5))
    assert "scalar='/speed'" in session.code() and "step=1" in session.code()
