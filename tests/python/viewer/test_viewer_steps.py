"""Undo and redo, what is told with a picture, other data, and pictures before a page is there."""

from __future__ import annotations

import time

import numpy as np
import pytest
from viewer_pages import CHANGES, PATIENCE, SIZE, Page, made_by, volume

import sheetsplat as ss
from sheetsplat._json import plain
from sheetsplat.viewer import history
from sheetsplat.viewer.about import bars_of
from sheetsplat.viewer.history import History
from sheetsplat.viewer.state import State

MEASURES = [[[0, 0, 0], [3, 4, 0]]]


@pytest.fixture
def apart(monkeypatch):
    """Let each change be one to undo, however soon it follows another."""
    monkeypatch.setattr(history, "_TOGETHER", -1.0)


def told(page, **parts):
    """Wait until a page is told a state with these parts."""
    with page.news:
        found = lambda: any(  # noqa: E731
            one["type"] == "state" and all(one["state"][name] == value for name, value in parts.items())
            for one, _ in page.messages
        )
        assert page.news.wait_for(found, PATIENCE), parts


def test_everything_is_undone_and_done_again(opened, apart):
    session = opened(choices={"a": volume(), "b": volume(0.3)})
    page = Page(session)
    page.wait("about")
    changes = [
        *CHANGES.items(),
        *(("mode", "mip"), ("quality", "draft"), ("choice", 1), ("backdrop", [1, 0, 0])),
        *(("shows", {"box": True}), ("measures", MEASURES), ("automatic", True)),
    ]
    # Shadows and gradient opacity exclude each other.
    states = [session.state]
    for name, value in changes:
        if name != "gradient_opacity":
            page.set(**{name: value})
            states.append(session.state)
    assert all(one != other for one, other in zip(states, states[1:], strict=False))
    for wanted in reversed(states[:-1]):
        page.say(type="undo")
        assert session.state == wanted
    page.say(type="undo")
    assert session.state == states[0]
    for wanted in states[1:]:
        page.say(type="redo")
        assert session.state == wanted
    page.say(type="undo")
    page.set(mode="minimum")
    page.say(type="redo")
    assert session.state.mode == "minimum"
    page.wait("about")
    message = [one for one, _ in page.messages if one["type"] == "frame"][-1]
    assert message["undo"] and not message["redo"]


def test_a_drag_is_one_step_and_what_came_to_and_fro_is_none(opened):
    session = opened()
    page = Page(session)
    page.wait("about")
    first = session.state
    for n in range(5):
        page.set(camera={**CHANGES["camera"], "eye": [40 + n, 7, 9]})
    page.set(shadows=True)
    page.say(type="undo")
    page.say(type="undo")
    assert session.state == first
    steps, one = History(), State(first.camera)
    steps.note(one, ["mode"])
    steps.note(State(first.camera, "mip"), ["mode"])
    assert steps.move(one, back=True) is None


def test_a_change_that_cannot_be_shown_is_no_step(opened, apart):
    session = opened()
    page = Page(session)
    page.wait("about")
    page.set(shadows=True)
    page.wait("frame", last=True)
    page.set(gradient_opacity=20.0)
    page.wait("error")
    told(page, gradient_opacity=None)
    page.say(type="undo")
    assert "shadows" not in session.state.changes


def test_what_lies_over_the_picture_draws_none(opened):
    session = opened()
    page = Page(session)
    page.wait("about")
    version = session._version
    page.set(shows={"bars": False}, measures=MEASURES)
    told(page, measures=MEASURES, shows={"box": False, "directions": True, "bars": False, "scale": False})
    assert session._version == version
    page.set(shows={"sun": True})
    assert "box" in page.wait("error")[0]["text"]
    page.set(measures=[[[0, 0, 0]]])
    assert "angle" in page.wait("error")[0]["text"]


def test_each_frame_has_its_own_bars(opened):
    session = opened()
    page = Page(session)
    page.wait("about")
    for number in range(1, 6):
        page.set(look={"group": 0, "range": [number, 90 + number]}, camera=CHANGES["camera"])
        last = page.wait("frame", last=True)[0]
        assert last["bars"][0]["low"] == pytest.approx(number)
    page.set(mode="mip")
    last = page.wait("frame", last=True)[0]
    assert last["bars"] == plain(bars_of(session.picture(SIZE))) and "largest" in last["bars"][0]["label"]
    assert "bars" not in page.wait("about")[0]


def test_other_data_are_framed_and_data_in_the_same_place_keep_their_view(opened, apart):
    far = ss.RegularField(volume(n=40), origin=(500, 0, 0))
    session = opened(choices={"a": volume(), "same": volume(0.3), "far": far})
    page = Page(session)
    page.wait("about")
    page.set(choice=2)
    page.wait("frame", last=True)
    assert session.state.camera == session.shown.camera(session.scene(), SIZE)
    page.set(choice=0)
    page.wait("frame", last=True)
    page.set(camera=CHANGES["camera"])
    page.wait("frame", last=True)
    turned = session.state.camera
    page.set(choice=1)
    page.wait("frame", last=True)
    assert session.state.camera == turned
    page.set(choice=2)
    page.wait("frame", last=True)
    camera = session.state.camera
    lower, upper = far.bounds
    assert np.all(np.greater(camera.target, lower)) and np.all(np.less(camera.target, upper))

    def direction(one):
        return np.subtract(one.target, one.eye) / np.linalg.norm(np.subtract(one.target, one.eye))

    assert np.allclose(direction(camera), direction(turned))
    page.say(type="undo")
    assert session.state.camera == turned and session.state.choice == 1


def test_presets_for_ct_say_what_data_they_are_for(opened):
    hounsfield = ss.RegularField(volume()).with_quantity("CT number", unit="HU")
    for data, says in ((volume(), True), (hounsfield, False)):
        page = Page(opened(data))
        page.wait("about")
        page.set(look={"group": 0, "preset": "ct_bone"})
        page.wait("frame", last=True)
        texts = [one["text"] for one, _ in page.messages if one["type"] == "warning"]
        assert any("Hounsfield" in text and "no unit" in text for text in texts) == says


def test_a_picture_is_there_before_the_page_and_pages_are_told_that_one_is_drawn(opened):
    session = opened()
    session.expect()
    end = time.monotonic() + PATIENCE
    while session._frame_sent is None:
        assert time.monotonic() < end
        time.sleep(0.01)
    page = Page(session, (60, 30))
    early = page.wait("frame")[0]
    assert early["size"] == list(SIZE) and not early["last"]
    assert page.wait("frame", last=True)[0]["size"] == [60, 30]
    page.set(mode="mip")
    page.wait("frame", last=True)
    kinds = [one["type"] for one, _ in page.messages]
    assert kinds.index("drawing") < kinds.index("frame")


def test_a_pick_is_answered_when_its_picture_is_complete(opened):
    session = opened(volume(n=40))
    page = Page(session)
    page.wait("about")
    page.set(mode="mip")
    page.say(type="pick", x=0.25, y=0.25, purpose="tell")
    page.say(type="pick", x=0.5, y=0.5, purpose="tell")
    page.say(type="pick", x=0.5, y=0.5, purpose="measure")
    found = page.wait("picked", purpose="measure")[0]
    kinds = [(one["type"], one.get("last")) for one, _ in page.messages]
    assert kinds.index(("frame", True)) < kinds.index(("picked", None)) and found["value"] > 50
    assert [one["x"] for one, _ in page.messages if one["type"] == "picked"] == [0.5, 0.5]


@pytest.mark.parametrize("name", ["shadows", "ambient_occlusion", "gradient_opacity", "depth_cue"])
@pytest.mark.parametrize("given", ["by the page", "as an option", "in a scene"])
def test_modes_without_light_leave_it_out_and_those_with_it_have_it_again(opened, name, given):
    value = CHANGES[name]
    made = {
        "shadows": True,
        "ambient_occlusion": ss.AmbientOcclusion(3.0, 0.7),
        "gradient_opacity": 20.0,
        "depth_cue": ss.DepthCue(5.0, 50.0),
    }[name]
    if given == "in a scene":
        scene = ss.Scene(ss.RegularField(volume()), [(0, 1, 1, 1, 0), (90, 1, 1, 1, 1)], **{name: made})
        session = opened(scene)
    else:
        session = opened(**({name: made} if given == "as an option" else {}))
    page = Page(session)
    page.wait("about")
    if given == "by the page":
        page.set(**{name: value})
    lit = session.picture()
    for mode in ("mip", "xray"):
        page.set(mode=mode)
        page.wait("about")
        assert session.state.mode == mode
        if given != "in a scene":
            made_again = made_by(session.code(), volume())
            assert np.array_equal(made_again.scalar, session.picture().scalar)
    page.set(mode="composite")
    page.wait("about")
    assert np.array_equal(session.picture().rgba, lit.rgba)
    assert not [one for one, _ in page.messages if one["type"] == "error"]
