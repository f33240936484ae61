"""The viewer without a browser: what a session draws, what its pages are told, and the code of its pictures."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Pillow
from viewer_pages import CHANGES, PATIENCE, SIZE, Page, made_by, picture_of, volume

import sheetsplat as ss
from sheetsplat import datasets
from sheetsplat.viewer import compose, frames, protocol
from sheetsplat.viewer.client import Client
from sheetsplat.viewer.state import Curves, handles


def test_a_page_gets_offer_state_picture_and_plan(opened):
    session = opened()
    page = Page(session)
    offered = page.wait("hello")[0]
    assert "viridis" in offered["colormaps"] and "ct_bone" in offered["presets"]
    told = page.wait("state")[0]
    assert told["state"]["mode"] == "composite" and len(told["state"]["looks"]) == 1
    assert sum(told["data"]["groups"][0]["counts"]) == 14**3
    about = page.wait("about")[0]
    names = [one["name"] for one in about["plan"]["effects"]]
    assert "opacity_correction" in names and all(one["why"] for one in about["plan"]["effects"])
    message, payload = page.wait("frame", last=True)
    assert message["bars"][0]["low"] < message["bars"][0]["high"]
    exact = session.picture(SIZE)
    assert np.array_equal(picture_of(message, payload), frames.levels(exact, (0.0, 0.0, 0.0)))


def test_levels_are_the_picture_over_its_background():
    image = ss.render(volume(), size=SIZE, backend="cpu")
    behind = np.array([0.2, 0.4, 0.6])
    expected = image.rgba[..., :3] + (1 - image.rgba[..., 3:]) * behind
    assert np.abs(frames.levels(image, tuple(behind)) / 255 - np.clip(expected, 0, 1)).max() <= 0.51 / 255
    scalar = ss.render(volume(), mode="mip", cmap="magma", size=SIZE, backend="cpu")
    shown = np.asarray(scalar)[..., :3]
    assert np.abs(frames.levels(scalar, (0, 0, 0)) / 255 - shown).max() <= 4 / 255


def test_cuts_of_the_viewer_have_faces_and_so_has_their_code(opened):
    """Data that end nowhere: nothing is cut before."""
    rng = np.random.default_rng(2)
    data = ss.EllipsoidField(rng.uniform(0, 6, (60, 3)), np.full(60, 1.5), values=rng.uniform(0.5, 1, 60))
    session = opened(data)
    page = Page(session)
    page.wait("about")
    assert not session.scene().options["cut_faces"]
    page.set(clip={"box": [[0, 0, 0], [3, 6, 6]]})
    page.wait("frame", last=True)
    assert session.scene().options["cut_faces"]
    after = session.picture()
    assert after.plan.has("cut_faces")
    assert np.array_equal(made_by(session.code(), data, threads=1).rgba, after.rgba)


@pytest.mark.parametrize("name", [*CHANGES, "all"])
def test_each_change_changes_the_picture_and_its_code_makes_it_again(opened, name):
    data = volume()
    session = opened(data)
    before = session.picture()
    page = Page(session)
    page.wait("about")
    # Shadows and gradient opacity exclude each other.
    together = {one: value for one, value in CHANGES.items() if one != "gradient_opacity"}
    page.set(**(together if name == "all" else {name: CHANGES[name]}))
    page.wait("frame", last=True)
    after = session.picture()
    assert [message["text"] for message, _ in page.messages if message["type"] == "error"] == []
    assert not np.array_equal(before.rgba, after.rgba)
    assert np.array_equal(made_by(session.code(), data, threads=1).rgba, after.rgba)


def test_pictures_and_code_fit_a_size_before_it_is_drawn(opened):
    data = volume()
    session = opened(data)
    page = Page(session)
    page.wait("frame", last=True)
    before = session.picture().camera
    for size, ask in (((20, 90), session.picture), ((20, 60), lambda: made_by(session.code(), data))):
        page.say(type="size", width=size[0], height=size[1])
        camera = ask().camera
        assert camera == session.shown.camera(session.scene(), size) != before


@pytest.mark.parametrize("mode", ["composite", "isosurface", "xray", "mip", "minimum", "average"])
def test_modes(opened, mode):
    data = volume()
    session = opened(data)
    page = Page(session)
    page.wait("about")
    page.set(mode=mode)
    page.wait("frame", last=True)
    # One of before may have been on its way when the page asked.
    told = [message["state"] for message, _ in page.messages if message["type"] == "state"][-1]
    assert told["mode"] == mode
    expected = ss.render(data, mode=mode, size=SIZE, camera=session.state.camera, backend="cpu", threads=1)
    assert np.array_equal(session.picture().pixels, expected.pixels)
    assert np.array_equal(made_by(session.code(), data).pixels, expected.pixels)


def test_surfaces_have_values_opacities_and_colors(opened):
    data = volume()
    session = opened(data, mode="isosurface")
    page = Page(session)
    own = page.wait("state")[0]["state"]["surfaces"]
    assert len(own) == 1 and own[0]["automatic"]
    page.set(surfaces=[{"value": 70, "opacity": 1, "color": "#ff0000"}, {"value": 30, "opacity": 0.3, "color": None}])
    told = page.wait("state")[0]["state"]["surfaces"]
    assert [one["value"] for one in told] == [30, 70]
    assert told[1]["color"] == "#ff0000" and not told[1]["automatic"] and told[0]["automatic"]
    assert session.scene().surfaces == ((30.0, 0.3), (70.0, 1.0))
    assert np.array_equal(made_by(session.code(), data).rgba, session.picture().rgba)


def test_looks(opened):
    session = opened()
    page = Page(session)
    first = page.wait("state")[0]["state"]["looks"][0]
    page.set(look={"group": 0, "cmap": "magma"})
    magma = page.wait("state")[0]["state"]["looks"][0]
    assert magma["cmap"] == "magma" and magma["ramp"] != first["ramp"] and magma["range"] == first["range"]
    page.set(look={"group": 0, "range": [20, 80]})
    assert page.wait("state")[0]["state"]["looks"][0]["range"] == [20, 80]
    page.set(look={"group": 0, "word": "sigmoid_5"})
    assert page.wait("state")[0]["state"]["looks"][0]["opacity"][-1][1] > 0.9
    page.set(look={"group": 0, "preset": "ct_bone"})
    assert page.wait("state")[0]["state"]["looks"][0]["range"] == [150, 1200]
    page.set(look={"group": 0, "automatic": True})
    assert page.wait("state")[0]["state"]["looks"][0] == first


def test_several_groups_have_looks_of_their_own(opened):
    fields = [ss.RegularField(volume()), ss.RegularField(volume(0.4))]
    functions = [ss.TransferFunction.from_colormap(name, (0, 0.4), (20, 100)) for name in ("gray", "hot")]
    session = opened(ss.Scene(fields, functions))
    page = Page(session)
    assert len(page.wait("state")[0]["state"]["looks"]) == 2
    page.set(look={"group": 1, "opacity": [[0, 0], [100, 0.9]]})
    page.wait("frame", last=True)
    changed = session.scene().transfer_functions
    assert changed[0] == functions[0] and changed[1].max_opacity == 0.9
    names = {"scene": ss.Scene(fields, functions)}
    exec(session.code().replace('image.save("picture.png")', ""), names)
    assert np.array_equal(names["image"].rgba, session.picture().rgba)


def test_choices_and_times(opened, tmp_path):
    np.save(tmp_path / "b.npy", volume(0.3))
    session = opened(choices={"a": volume(), "b": tmp_path / "b.npy"})
    page = Page(session)
    assert page.wait("state")[0]["data"]["names"] == ["a", "b"]
    page.set(choice=1)
    assert page.wait("state")[0]["state"]["choice"] == 1
    assert np.array_equal(session.scene().fields[0].values, volume(0.3))
    page.set(choice=2)
    assert "below 2" in page.wait("error")[0]["text"]

    series = opened(times=[volume(), 0.5 * volume(0.3)])
    page = Page(series)
    assert len(page.wait("state")[0]["data"]["times"]) == 2
    page.set(time=1)
    page.wait("frame", last=True)
    # One look for all.
    assert series.scene().transfer_function == opened(volume()).scene().transfer_function
    assert np.array_equal(series.scene().fields[0].values, 0.5 * volume(0.3))


def test_a_file_that_vanished_leaves_what_was_shown(opened, tmp_path):
    path = tmp_path / "gone.npy"
    np.save(path, volume())
    session = opened(choices={"a": volume(), "b": path})
    page = Page(session)
    page.wait("about")
    path.unlink()
    page.set(choice=1)
    assert "gone.npy" in page.wait("error")[0]["text"]
    page.wait("state")
    page.wait("frame", last=True)
    assert session.state.choice == 0


def test_bad_values_are_told_and_change_nothing(opened):
    session = opened()
    page = Page(session)
    page.wait("about")
    before = session.state
    for changes in (
        {"camera": {"kind": "orthographic", "eye": [0, 0, 0], "target": [0, 0, 0], "up": [0, 0, 1], "height": 1}},
        {"mode": "volume"},
        {"look": {"group": 0, "opacity": [[0, "a"]]}},
        {"look": {"group": 0, "cmap": "nothing"}},
        {"lights": [{"direction": [0, 0, 0]}]},
        {"clip": {"box": [[1, 1, 1], [0, 0, 0]]}},
        {"max_error": -1},
        {"time": 1},
        {"__class__": 1},
    ):
        page.set(**changes)
        assert page.wait("error")[0]["text"]
        assert session.state == before


def test_an_unknown_effect_is_told_and_taken_back(opened):
    session = opened()
    page = Page(session)
    page.wait("about")
    page.set(effects={"no_such_effect": True})
    assert "no_such_effect" in page.wait("error")[0]["text"]
    page.set(mode="mip")
    page.wait("frame", last=True)
    assert session.state.settings == {}


def test_frames_rise_and_old_ones_wait_for_the_page(opened):
    session = opened()
    page = Page(session)
    page.wait("frame", last=True)
    page.draws = False
    page.clear()
    for n in range(12):
        camera = {"kind": "orthographic", "eye": [30 + n, 7, 7], "target": [7, 7, 7], "up": [0, 0, 1], "height": 20}
        page.say(type="set", changes={"camera": camera})
        time.sleep(0.03)
    time.sleep(0.5)
    numbers = [message["number"] for message, _ in page.messages if message["type"] == "frame"]
    assert 1 <= len(numbers) <= 3 and numbers == sorted(set(numbers))
    page.draws = True
    for number in numbers:
        page.say(type="drawn", number=number)
    up = (-0.0, 0.0, 1.0)
    page.wait("frame", last=True, camera={**camera, "eye": [41.0, 7.0, 7.0], "up": list(up), "height": 20.0})


def test_a_page_that_does_not_answer_is_sent_frames_again():
    sent = []
    client = Client(lambda message, payload: sent.append(message["number"]))
    for number in range(1, 5):
        client.show({"number": number}, b"")
    assert sent == [1, 2]
    client.drew()
    assert sent == [1, 2, 4]
    client._sent -= 10.0
    client.show({"number": 5}, b"")
    assert sent == [1, 2, 4, 5]


def test_an_error_of_what_was_asked_for_keeps_the_page(opened):
    session = opened()
    page = Page(session)
    page.wait("about")
    page.say(type="look", direction=[0, 0, 0], up=None, kind=None)
    assert "direction" in page.wait("error")[0]["text"]
    page.say(type="code")
    page.wait("code")
    # A page that cannot be reached is forgotten; others stay.
    lost = session.connect(lambda message, payload: 1 / 0)
    session.receive(lost, {"type": "code"})
    page.set(mode="mip")
    page.wait("frame", last=True)
    assert session._clients == [page.client]


def test_two_pages_show_the_same(opened):
    session = opened()
    one, other = Page(session), Page(session, (60, 30))
    one.wait("about")
    other.wait("about")
    other.clear()
    one.set(background="#ff0000")
    assert other.wait("state")[0]["state"]["background"] == "#ff0000"
    message, payload = other.wait("frame", last=True)
    assert tuple(picture_of(message, payload)[0, 0]) == (255, 0, 0)
    session.disconnect(one.client)
    other.set(shadows=True)
    other.wait("frame", last=True)


def test_pick_save_view_code_and_measures(opened, tmp_path):
    data = volume()
    session = opened(data)
    page = Page(session)
    page.wait("about")
    page.say(type="pick", x=0.5, y=0.5, purpose="tell")
    picked = page.wait("picked")[0]
    expected = session.picture().pick(SIZE[0] / 2, SIZE[1] / 2)
    assert picked["value"] == expected.value and picked["position"] == list(expected.position)
    page.say(type="pick", x=0.0, y=0.0, purpose="tell")
    page.wait("picked", value=None)
    page.say(type="save", width=30, height=20, shown=False)
    message, payload = page.wait("file")
    assert message["name"].endswith(".png")
    path = tmp_path / "x.png"
    path.write_bytes(payload)
    assert ss.Recipe.read(path).size == (30, 20)
    page.say(type="look", direction=[0, 0, -1], up=[0, 1, 0], kind="perspective")
    camera = page.wait("camera")[0]["camera"]
    assert camera["kind"] == "perspective" and np.allclose(camera["up"], [0, 1, 0])
    page.say(type="code")
    assert "ss.render" in page.wait("code")[0]["text"]
    page.say(type="measure", what="error")
    found, payload = page.wait("error_map")
    assert found["rmse"] == pytest.approx(session.picture().error.rmse) and payload[:4] == b"\x89PNG"


@pytest.mark.slow
def test_costs_of_effects_are_measured_and_stopped(opened):
    session = opened()
    page = Page(session)
    page.wait("about")
    page.say(type="measure", what="effects")
    page.wait("measuring")
    page.set(shadows=True)
    assert page.wait("measured")[0]["stopped"]
    page.say(type="measure", what="effects")
    costs = page.wait("costs")[0]["costs"]
    assert any(cost is not None for cost in costs.values())


def test_curves_of_a_function_are_the_function():
    rows = [(0, 1, 0, 0, 0), (10, 1, 0, 0, 0.5), (10, 0, 1, 0, 0.1), (30, 0, 0, 1, 0.9)]
    function = ss.TransferFunction(rows)
    at = np.linspace(-5, 40, 91)
    assert np.allclose(Curves.of(function).function.at(at), function.at(at))
    line = np.column_stack([np.linspace(0, 1, 50), np.linspace(0, 2, 50)])
    assert len(handles(line, 0.01)) == 2
    bent = np.column_stack([np.linspace(0, 1, 101), np.abs(np.linspace(-1, 1, 101))])
    assert np.allclose(handles(bent, 0.01), [[0, 1], [0.5, 0], [1, 1]])
    assert len(handles(line[:1], 0.01)) == 1


def test_from_curves_joins_colors_and_opacities():
    function = ss.TransferFunction.from_curves([(0, 1, 0, 0), (4, 0, 0, 1)], [(1, 0.0), (2, 0.5), (2, 0.1)])
    assert np.allclose(function.at([0, 1, 1.5, 2, 4])[:, 3], [0, 0, 0.25, 0.1, 0.1])
    assert np.allclose(function.at([1])[0, :3], [0.75, 0, 0.25])
    for colors, opacities in (([(0, 1, 0)], [(0, 1)]), ([(0, 1, 0, 0)], [(1, 0), (0, 0)]), ([], [(0, 1)])):
        with pytest.raises(ss.InvalidInput):
            ss.TransferFunction.from_curves(colors, opacities)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{",
        "nan",
        '{"type": "quit"}',
        '{"type": ["set"]}',
        '{"type": "set"}',
        '{"type": "set", "changes": {}}',
        '{"type": "set", "changes": {"mode": NaN}}',
        '{"type": "set", "changes": {"mode": "mip"}, "more": 1}',
        '{"type": "size", "width": 0, "height": 5}',
        '{"type": "size", "width": 8192, "height": 8192}',
        '{"type": "size", "width": 100000, "height": 1}',
        '{"type": "size", "width": true, "height": 5}',
        '{"type": "pick", "x": "0", "y": 0}',
        '{"type": "look", "direction": [1, 2], "up": null, "kind": null}',
        '{"type": "measure", "what": "everything"}',
        "[" * 50_000,
        '{"type": "code"' + " " * protocol.LONGEST + "}",
    ],
)
def test_messages_that_are_not_known_are_dropped(text):
    assert protocol.parse(text) is None


def test_known_messages_are_taken():
    assert protocol.parse('{"type": "code"}') == protocol.Message("code", {})
    assert protocol.parse(b'{"type": "size", "width": 5, "height": 6}').parts == {"width": 5, "height": 6}


def test_names_that_pages_offer_are_known():
    offered = compose.offered()
    curves = Curves.of(datasets.DATASETS["marschner_lobb"]().transfer_function())
    for word in offered["words"]:
        assert curves.changed({"word": word}).opacities[:, 1].max() > 0
    for name in offered["colormaps"]:
        assert curves.changed({"cmap": name}).cmap == name


def test_a_viewer_in_python(tmp_path):
    with ss.view(volume(), browser=False, backend="cpu") as viewer:
        assert viewer.camera == ss.render(volume(), size=(800, 600), backend="cpu").camera
        viewer.camera = ss.Camera.orthographic((30, 7, 7), (7, 7, 7), (0, 0, 1), height=20)
        viewer.save(tmp_path / "x.png", size=SIZE)
        expected = ss.render(volume(), camera=viewer.camera, size=SIZE, backend="cpu")
        assert np.array_equal(np.asarray(Pillow.open(tmp_path / "x.png")), np.asarray(expected, np.uint8))
        assert viewer.scene.mode == "composite" and "open" in repr(viewer)
        with pytest.raises(ss.InvalidInput):
            viewer.camera = "x"
    assert "closed" in repr(viewer)
    with pytest.raises(ss.Error, match="closed"):
        assert viewer.url


def test_the_widget_carries_messages(monkeypatch):
    widget_of = pytest.importorskip("anywidget", reason="anywidget is not installed")
    assert widget_of
    with ss.view(volume(), browser=False, backend="cpu") as viewer:
        widget = viewer.widget
        assert "export default" in widget._esm and ".sheetsplat-viewer" in widget._css
        sent = []
        came = threading.Event()

        def send(content, buffers=None):
            sent.append((content, buffers))
            if content["type"] == "frame" and content["last"]:
                came.set()

        monkeypatch.setattr(widget, "send", send)
        handle = widget._handle_custom_msg
        handle({"type": "hello", "width": 40, "height": 30, "place": "a"}, [])
        assert came.wait(PATIENCE)
        assert all(content["place"] == "a" for content, _ in sent)
        frame = next(one for one in sent if one[0]["type"] == "frame")
        assert frame[1][0][:3] in (b"\xff\xd8\xff", b"\x89PN")
        for bad in ("text", {"type": "hello"}, {"type": "hello", "width": 1, "height": 1, "place": 5}, None):
            handle(bad, [])
        handle({"type": "bye", "place": "a"}, [])
        assert viewer._session._clients == []


def test_packages_that_are_missing_are_named(monkeypatch):
    import sys

    with ss.view(volume(), browser=False, backend="cpu") as viewer:
        monkeypatch.setitem(sys.modules, "aiohttp", None)
        with pytest.raises(ss.Unsupported, match=r"sheetsplat\[view\]"):
            assert viewer.url
        monkeypatch.setitem(sys.modules, "anywidget", None)
        with pytest.raises(ss.Unsupported, match=r"sheetsplat\[jupyter\]"):
            assert viewer.widget


def test_the_page_asks_for_nothing_from_elsewhere():
    folder = Path(ss.__file__).parent / "viewer" / "page"
    for path in folder.glob("*.*"):
        if path.suffix in (".js", ".css", ".html"):
            text = path.read_text(encoding="utf-8")
            assert "http://" not in text and "https://" not in text and "innerHTML" not in text, path


def test_a_measurement_without_a_picture_ends(opened):
    session = opened()
    page = Page(session)
    page.wait("about")
    session._image = None
    page.say(type="measure", what="error")
    assert page.wait("measured")[0] == {"type": "measured", "what": "error", "stopped": False}
