"""The viewer's page in a real browser: hands, panels, two pages at once, a line that is lost, a window that changes."""

from __future__ import annotations

import io
import random
import time

import numpy as np
import pytest
from browser_pages import (
    IN_BROWSER,
    LAST,
    SIZE,
    camera_of,
    complete_after,
    middle_of,
    pixels,
    press,
    saved,
    shown,
    tick,
    values,
)
from PIL import Image as Pillow

import sheetsplat as ss
from sheetsplat.viewer.page import files

pytestmark = IN_BROWSER


def test_the_first_picture_is_that_of_render(paged):
    viewer, page = paged(values())
    found = pixels(page)
    expected = np.asarray(viewer.render(found.shape[1::-1]).rgba[..., :3])
    assert np.abs(found / 255 - np.clip(expected, 0, 1)).max() <= 0.51 / 255


def test_hands_turn_move_enlarge_and_roll(paged):
    viewer, page = paged(values())
    at = middle_of(page, ".stage")
    to = (at[0] + 80, at[1] + 30)
    first = camera_of(page)

    def moved(action):
        before, number = camera_of(page), shown(page)
        action()
        page.wait("!document.querySelector('.lost')")
        complete_after(page, number)
        # The newer picture may be the finer one of the action before.
        end = time.monotonic() + 20
        while not np.allclose(camera_of(page)["eye"], viewer.camera.eye):
            assert time.monotonic() < end
            time.sleep(0.01)
        after = camera_of(page)
        assert after != before
        return before, after

    def distance(camera):
        return np.linalg.norm(np.subtract(camera["eye"], camera["target"]))

    before, after = moved(lambda: page.drag(at, to))
    assert after["target"] == before["target"] and distance(after) == pytest.approx(distance(before))
    before, after = moved(lambda: page.drag(at, to, modifiers=8))
    assert after["target"] != before["target"]
    # What was moved right lies right of where it was.
    right = np.cross(before["up"], np.subtract(before["eye"], before["target"]))
    assert np.dot(right, np.subtract(after["target"], before["target"])) < 0
    before, after = moved(lambda: page.drag((at[0] + 90, at[1]), (at[0], at[1] - 90), modifiers=2))
    assert after["eye"] == before["eye"] and after["up"] != before["up"]
    before, after = moved(lambda: page.mouse("mouseWheel", at, deltaX=0, deltaY=-200))
    assert after["height"] < before["height"]
    before, after = moved(lambda: page.key("ArrowLeft"))
    assert after["eye"] != before["eye"]
    before, after = moved(lambda: page.key("-"))
    assert after["height"] > before["height"]
    _, after = moved(lambda: page.key("p"))
    assert after["kind"] == "perspective"
    moved(lambda: page.key("p"))
    page.key("z")
    page.wait("Math.abs(window.sheetsplat.view.camera.up[1] - 1) < 1e-6 && " + LAST)
    page.key("r")
    wanted = first["eye"][0]
    page.wait(f"Math.abs(window.sheetsplat.view.camera.eye[0] - {wanted}) < 1e-6 && {LAST}")


def test_two_fingers_enlarge(paged):
    _, page = paged(values())
    x, y = middle_of(page, ".stage")
    before, number = camera_of(page), shown(page)
    spread = [[{"x": x - d, "y": y, "id": 1}, {"x": x + d, "y": y, "id": 2}] for d in (40, 60, 90)]
    page.command("Input.dispatchTouchEvent", type="touchStart", touchPoints=spread[0])
    for points in spread[1:]:
        page.command("Input.dispatchTouchEvent", type="touchMove", touchPoints=points)
    page.command("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    complete_after(page, number)
    assert camera_of(page)["height"] < 0.7 * before["height"]


def test_the_transfer_function_is_edited(paged):
    viewer, page = paged(values(24))
    before = viewer.scene.transfer_function
    start = page.evaluate("window.sheetsplat.view.editor.point('opacity', 1)")
    number = shown(page)
    page.drag(start, (start[0] + 10, start[1] - 60))
    complete_after(page, number)
    assert viewer.scene.transfer_function != before
    count = page.evaluate("window.sheetsplat.view.state.looks[0].opacity.length")
    box = page.evaluate(
        "(() => { const b = document.querySelector('.editor').getBoundingClientRect();"
        " return [b.left, b.top, b.width] })()"
    )
    number = shown(page)
    page.click((box[0] + 0.12 * box[2], box[1] + 30), count=2)
    complete_after(page, number)
    opacities = viewer.scene.transfer_function.at([12.0])[0, 3]
    assert opacities > 0.3, count
    number = shown(page)
    page.key("Delete")
    complete_after(page, number)
    assert viewer.scene.transfer_function.at([12.0])[0, 3] < opacities
    number = shown(page)
    page.evaluate(
        "(s => { s.value = 'magma'; s.dispatchEvent(new Event('change')) })"
        "(document.querySelector('select[title=Colours]'))"
    )
    complete_after(page, number)
    assert np.allclose(viewer.scene.transfer_function.at([1e3])[0, :3], [0.987, 0.991, 0.75], atol=0.01)
    number = shown(page)
    press(page, "Automatic")
    complete_after(page, number)
    assert viewer.scene.transfer_function == before


def test_modes_and_panels(paged):
    viewer, page = paged(values())
    page.evaluate("document.querySelectorAll('details').forEach(d => { d.open = true })")
    for key, mode in (("2", "isosurface"), ("3", "mip"), ("6", "xray"), ("1", "composite")):
        number = shown(page)
        page.evaluate("document.querySelector('.stage').focus()")
        page.key(key)
        complete_after(page, number)
        page.wait(f"window.sheetsplat.view.state.mode === '{mode}'")
        assert viewer.scene.mode == mode
    for text, name in (
        ("Shadows", "shadows"),
        ("Ambient occlusion", "ambient_occlusion"),
        ("Fade with depth", "depth_cue"),
    ):
        number = shown(page)
        tick(page, text)
        complete_after(page, number)
        assert viewer.scene.options[name]
    number = shown(page)
    tick(page, "Box")
    press(page, "Plane across x")
    complete_after(page, number)
    assert viewer.scene.options["clip"].box is not None and len(viewer.scene.options["clip"].planes) == 1
    page.wait("window.sheetsplat.view.handles.length === 8")
    corner = page.evaluate(
        "(() => { const b = document.querySelector('.stage').getBoundingClientRect(); return [b.left, b.top] })()"
    )
    handle = page.evaluate("window.sheetsplat.view.handles[6]")
    start = (corner[0] + handle[0], corner[1] + handle[1])
    number, before = shown(page), viewer.scene.options["clip"].planes
    page.drag(start, (start[0] + 25, start[1] + 25))
    complete_after(page, number)
    assert viewer.scene.options["clip"].planes != before
    number = shown(page)
    press(page, "As at first")
    complete_after(page, number)
    assert viewer.scene.options["clip"].box is None and not viewer.scene.options["shadows"]


def test_hover_tells_the_value_and_the_plan_its_reasons(paged):
    viewer, page = paged(values())
    x, y = middle_of(page, ".stage")
    text = ""
    for _ in range(100):
        # A browser that lays out its page at that moment tells it of no movement.
        page.mouse("mouseMoved", (x + 4, y))
        page.mouse("mouseMoved", (x, y))
        time.sleep(0.3)
        if text := page.evaluate("document.querySelector('.hover').textContent"):
            break
    picked = viewer.render(tuple(page.evaluate("window.sheetsplat.view.drawn.size")))
    found = picked.pick(picked.size[0] / 2, picked.size[1] / 2)
    assert f"{found.value:.4g}"[:4] in text and "opacity" in text
    rows = page.evaluate("window.sheetsplat.view.about.plan.effects")
    assert {one["name"]: one["on"] for one in rows} == {one.name: one.on for one in picked.plan.effects}


def test_times_play(paged):
    viewer, page = paged(None, times=[values(), values(shift=0.3), values(shift=-0.3)])
    number = shown(page)
    page.evaluate("(s => { s.value = 1; s.dispatchEvent(new Event('input')) })(document.querySelector('.times input'))")
    complete_after(page, number)
    assert np.array_equal(viewer.scene.fields[0].values, values(shift=0.3))
    press(page, "▶")
    page.wait("window.sheetsplat.view.state.time === 0")
    page.wait("window.sheetsplat.view.state.time === 1")
    press(page, "⏸")


def test_the_picture_is_saved(paged, browser, tmp_path):
    viewer, page = paged(values())
    page.command("Page.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
    page.evaluate("document.querySelector('.stage').focus()")
    page.key("s")
    path = tmp_path / "ndarray.png"
    saved(path)
    recipe = ss.Recipe.read(path)
    expected = recipe.scene([ss.RegularField(values())])
    assert recipe.camera == viewer.camera and expected.mode == "composite"


def test_a_film_is_saved_while_the_page_goes_on(paged, tmp_path):
    pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed")
    viewer, page = paged(values())
    page.command("Page.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))

    def order(frames):
        press(page, "⤓ Film")
        page.wait("document.querySelector('dialog[open] .number') !== null")
        page.evaluate("document.querySelector('dialog[open] .number').value = " + str(frames))
        page.evaluate("document.querySelector('dialog[open] select[title=\"Kind of file\"]').value = 'gif'")
        press(page, "Make the film")
        page.wait("!document.querySelector('.filming').hidden")

    order(4)
    number = shown(page)
    page.evaluate("window.sheetsplat.set({mode: 'mip'})")
    complete_after(page, number)
    film = Pillow.open(io.BytesIO(saved(tmp_path / "ndarray.gif")))
    assert film.n_frames == 4
    page.wait("document.querySelector('.filming').hidden")
    order(2000)
    press(page, "Stop")
    page.wait("document.querySelector('.filming').hidden")


def test_the_picture_follows_the_window(paged):
    viewer, page = paged(values())
    number = shown(page)
    page.resize((800, 500))
    complete_after(page, number)
    width, height = page.evaluate("(s => [s.clientWidth, s.clientHeight])(document.querySelector('.stage'))")
    page.wait(f"window.sheetsplat.view.drawn.size.join() === '{width},{height}' && {LAST}")
    assert width < 500 and height < 500


def test_a_page_that_is_loaded_again_shows_the_same(paged):
    viewer, page = paged(values())
    number = shown(page)
    page.evaluate("window.sheetsplat.set({mode: 'mip'})")
    # The server has the change when its picture is there.
    complete_after(page, number)
    page.go(viewer.url)
    page.wait(LAST)
    assert page.evaluate("window.sheetsplat.view.state.mode") == "mip"


def test_two_pages_show_the_same(paged):
    viewer, one = paged(values())
    _, other = paged(viewer=viewer)
    number = shown(other)
    # A tab that is not seen draws nothing.
    one.command("Page.bringToFront")
    one.evaluate("window.sheetsplat.set({background: '#ff0000'})")
    other.wait("window.sheetsplat.view.state.background === '#ff0000'")
    complete_after(other, number)
    assert tuple(pixels(other)[0, 0]) == (255, 0, 0)
    at = middle_of(other, ".stage")
    other.command("Page.bringToFront")
    other.drag(at, (at[0] + 50, at[1]))
    wanted = camera_of(other)["eye"][0]
    one.wait(f"Math.abs(window.sheetsplat.view.camera.eye[0] - {wanted}) < 1e-6")


def test_a_lost_line_comes_back(paged):
    viewer, page = paged(values())
    page.evaluate("window.sheetsplat.drop()")
    page.wait("document.querySelector('.lost') !== null")
    page.wait("document.querySelector('.lost') === null")
    page.wait(LAST)
    number = shown(page)
    page.evaluate("window.sheetsplat.set({mode: 'mip'})")
    complete_after(page, number)
    assert viewer.scene.mode == "mip"


def test_no_older_frame_follows_a_newer_one(paged):
    _, page = paged(values())
    x, y = middle_of(page, ".stage")
    page.evaluate(
        "window.seen = []; setInterval(() => { const n = window.sheetsplat.view.drawn.number;"
        " if (n !== window.seen.at(-1)) window.seen.push(n) }, 2)"
    )
    page.drag((x, y), (x + 150, y + 60), steps=60)
    page.wait(LAST)
    time.sleep(0.2)
    seen = page.evaluate("window.seen")
    assert len(seen) > 3 and seen == sorted(set(seen))
    assert page.evaluate("window.sheetsplat.view.drawn.camera.eye[0] - window.sheetsplat.view.camera.eye[0]") == 0


def random_input(page, viewer, seconds, seed=1):
    """Do at random what hands and keys can do; return how many things were done."""
    rng = random.Random(seed)
    width, height = SIZE
    end, count = time.monotonic() + seconds, 0
    while time.monotonic() < end:
        count += 1
        at = (rng.uniform(5, width - 5), rng.uniform(5, height - 5))
        kind = rng.randrange(6)
        if kind == 0:
            page.drag(at, (rng.uniform(5, width), rng.uniform(5, height)), steps=4, modifiers=rng.choice((0, 0, 2, 8)))
        elif kind == 1:
            page.mouse("mouseWheel", at, deltaX=0, deltaY=rng.uniform(-200, 200))
        elif kind == 2:
            page.evaluate("document.querySelector('.stage').focus()")
            page.key(rng.choice([*"rxyzqep+-123456b", "ArrowLeft", "ArrowUp"]))
        elif kind == 3:
            page.click(at, count=rng.choice((1, 2)))
        elif kind == 4:
            page.mouse("mouseMoved", at)
        else:
            page.evaluate(
                "(all => { const one = all[Math.floor(Math.random() * all.length)];"
                " if (!one) return;"
                " if (one.type === 'range') { one.value = Math.random() * 1000; one.dispatchEvent(new Event('input')) }"
                " else if (one.type === 'checkbox') one.click() })"
                "([...document.querySelectorAll('aside input')].filter(e => e.offsetParent && e.type !== 'color'))"
            )
        page.evaluate("document.querySelectorAll('dialog').forEach(d => d.close())")
    return count


def test_random_input_leaves_the_viewer_working(paged):
    viewer, page = paged(values())
    page.command("Page.setDownloadBehavior", behavior="deny")
    page.evaluate("document.querySelectorAll('details').forEach(d => { d.open = true })")
    assert random_input(page, viewer, 5.0) > 5
    page.evaluate("window.sheetsplat.set({automatic: true})")
    page.evaluate("window.sheetsplat.set({mode: 'composite'})")
    page.wait("window.sheetsplat.view.state.mode === 'composite'")
    number = shown(page)
    page.evaluate("window.sheetsplat.set({background: '#ff0000'})")
    complete_after(page, number)


def test_a_widget_says_that_it_is_there_and_comes_again_where_it_was_forgotten(paged):
    _, page = paged(values())
    script = files.widget_script().rpartition("function widgetLine")[2].partition("function render")[0]
    page.evaluate(
        f"(() => {{ function widgetLine{script}"
        """
        const model = {get: () => 0.05, send: (told) => sent.push(told), on: (_, take) => { window.take = take; }};
        Object.assign(window, {sent: [], hellos: 0, model: {...model, off: () => {}}});
        window.line = widgetLine(window.model, {open: () => { hellos += 1; }, message: () => {}}); })()"""
    )
    page.wait("hellos === 1 && sent.filter((one) => one.type === 'alive').length > 2")
    page.evaluate("take({type: 'forgotten', place: 'of another'})")
    page.evaluate("take({type: 'forgotten', place: sent[0].place})")
    assert page.evaluate("hellos") == 2
    page.evaluate("line.close()")
    said = page.evaluate("sent.length")
    time.sleep(0.2)
    assert page.evaluate("[sent.length, sent.at(-1).type]") == [said, "bye"]
