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
